"""Gradient polish: it descends, never returns what is worse, keeps bounds, and heeds what judges it."""

import jax.numpy as jnp
import numpy as np

from auvplan.bbo.refine import descend, refine

LOWER, UPPER = jnp.full(3, -2.0), jnp.full(3, 2.0)
STARTS = jnp.array([[1.5, -1.0, 0.3], [-1.9, 1.9, 0.0]])


def bowl(population, centre):
    return ((population - centre) ** 2).sum(axis=1)


def test_reaches_the_minimum_of_a_bowl():
    centre = jnp.array([0.5, -0.2, 1.0])
    found, cost, violation = refine(bowl, STARTS, LOWER, UPPER, 200, (centre,), 0.05)
    np.testing.assert_allclose(found, jnp.broadcast_to(centre, found.shape), atol=2e-2)
    np.testing.assert_allclose(cost, bowl(found, centre), atol=1e-6)
    assert (violation == 0.0).all()


def test_stops_at_the_bounds():
    found, _, _ = refine(bowl, STARTS, LOWER, UPPER, 200, (jnp.full(3, 5.0),), 0.05)
    np.testing.assert_allclose(found, jnp.broadcast_to(UPPER, found.shape), atol=1e-5)


def test_never_worse_than_the_start():
    # A step far too long: every move climbs.
    at_best = jnp.zeros((1, 3))
    found, cost, _ = refine(bowl, at_best, LOWER, UPPER, 20, (jnp.zeros(3),), 0.5)
    assert float(cost[0]) == 0.0
    np.testing.assert_array_equal(found, at_best)


def test_the_cost_judges_what_the_guide_finds():
    # The guide leads to 1; the cost forbids what lies beyond 0.5.
    def guide(population):
        cost = jnp.where(population[:, 0] > 0.5, jnp.nan, bowl(population, 1.0))
        return bowl(population, 1.0), (cost, jnp.zeros(len(population)))

    start = jnp.array([[-1.0, 1.0, 1.0]])
    found, cost, _ = descend(guide, start, LOWER, UPPER, 100, (), 0.02)
    assert 0.3 < float(found[0, 0]) <= 0.5
    assert np.isfinite(cost).all()
    assert float(cost[0]) < float(bowl(start, 1.0)[0])


def test_no_slope_where_the_cost_is_not_a_number():
    def broken(population):
        return jnp.full(len(population), jnp.nan) * population[:, 0]

    found, cost, _ = refine(broken, STARTS, LOWER, UPPER, 5)
    assert np.isinf(cost).all()
    np.testing.assert_allclose(found, STARTS, atol=1e-6)
