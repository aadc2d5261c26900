"""Boxes of an environment: given ones, defaults, what chart and sea bed leave of them."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from tests.path.worlds import CONFIG, GOAL, START, chart_with_island, world


def test_without_a_box_it_is_the_waters_below_the_surface():
    env = ap.Environment(None)
    np.testing.assert_array_equal(env.lower, [-np.inf, -np.inf, 0.0])
    np.testing.assert_array_equal(env.upper, np.inf)


def test_chart_and_sea_bed_bound_what_has_no_box():
    bed = ap.Seabed.from_depth(np.full((30, 40), 80.0), 50.0, (100.0, -200.0))
    env = ap.Environment(None, chart_with_island(), seabed=bed)
    np.testing.assert_allclose(env.lower, [100.0, 0.0, 0.0])
    np.testing.assert_allclose(env.upper, [1600.0, 1800.0, np.inf])
    given = ap.Environment(None, seabed=bed, lower=(500, 0, 0), upper=(np.inf, 900, 60))
    np.testing.assert_allclose(given.lower, [500.0, 0.0, 0.0])
    np.testing.assert_allclose(given.upper, [1600.0, 900.0, 60.0])


@pytest.mark.parametrize(
    ("lower", "upper"),
    [((0, 0, 5), (9, 9, 4)), ((0, 0), (9, 9)), ((np.nan, 0, 0), (9, 9, 9)), ((0, 0, 0), (9, np.nan, 9))],
)
def test_what_is_no_box_is_refused(lower, upper):
    with pytest.raises(ValueError, match="lower <= upper"):
        ap.Environment(None, lower=lower, upper=upper)


def test_what_jax_traces_goes_into_a_whole_environment():
    chart, at = chart_with_island(), (jnp.asarray(400.0), jnp.asarray(500.0))

    def distance(env):
        return env.chart.distance(*at)

    def built(chart):
        return distance(ap.Environment(None, chart))

    with pytest.raises(ValueError, match=r"^no environment is built .*replace\(env, chart=\.\.\.\)"):
        jax.grad(built)(chart)
    with pytest.raises(ValueError, match="no environment is built"):
        jax.jit(lambda top: ap.Environment(None, lower=(0, 0, top)).lower)(1.0)
    env = ap.Environment(None, chart)
    slope = jax.grad(lambda chart: distance(replace(env, chart=chart)))(chart)
    alone = jax.grad(lambda plane: built(replace(chart, signed_distance=plane)))(chart.signed_distance)
    np.testing.assert_array_equal(slope.signed_distance, alone)
    assert np.asarray(alone).any()


def test_corners_may_be_arrays_of_jax():
    def stream(x, y, z, t):
        return 0.3 + 0.0 * x, 0.0 * y, 0.0 * z

    corners = {"lower": np.zeros(3), "upper": np.array([900.0, 800.0, 50.0])}
    plain = ap.Environment(stream, **corners)
    env = ap.Environment(stream, **{name: jnp.asarray(corner) for name, corner in corners.items()})
    assert len(env.obstacles) == 0
    assert float(env.current(0.0, 0.0, 0.0, 0.0)[0]) == pytest.approx(0.3)
    np.testing.assert_array_equal(env.upper, plain.upper)
    with pytest.raises(ValueError, match="lower <= upper"):
        ap.Environment(stream, lower=jnp.ones(3), upper=jnp.zeros(3))


@pytest.mark.slow
def test_paths_are_planned_without_a_box():
    """The README's shortest call: in a stream across, 2 m/s over ground remain of 2.5 m/s."""
    env = ap.Environment(lambda x, y, z, t: (0.0, 1.5, 0.0))
    plan = ap.plan_path((0, 0, 10), (2000, 0, 30), env, key=jax.random.key(0), config=CONFIG)
    assert plan.feasible
    assert np.isfinite(plan.positions).all()
    assert plan.positions[:, 2].min() >= 0.0
    assert plan.travel_time == pytest.approx(1000.0, rel=0.01)
    slopes = plan.sensitivity()
    assert np.isfinite([slopes.departure, slopes.speed, slopes.current]).all()


@pytest.mark.slow
def test_a_box_that_binds_nothing_changes_nothing():
    boxed = world()
    free = ap.Environment(boxed.current, boxed.chart, boxed.obstacles)
    wide = ap.Environment(boxed.current, boxed.chart, boxed.obstacles, (-1e4, -1e4, 0.0), (1e4, 1e4, 1e4))
    one, two = (ap.plan_path(START, GOAL, env, key=jax.random.key(1), config=CONFIG) for env in (free, wide))
    assert one.feasible
    assert one.travel_time == pytest.approx(two.travel_time, rel=0.02)
