"""Obstacle kinds, their motion, and the growth of the collision boundary."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.ocean.obstacles import CONFIDENCE

STREAM = ap.UniformCurrent(0.4, -0.2, 0.0)


def test_three_kinds_move_as_named():
    place = [[0.0, 0.0, 10.0]]
    kinds = (
        ap.Obstacles.static(place, [5.0])
        + ap.Obstacles.afloat(place, [5.0])
        + ap.Obstacles.self_motivated(place, [5.0], [[0.1, 0.1, 0.0]])
    )
    moved = kinds.resolved(STREAM).velocity
    np.testing.assert_allclose(moved, [[0, 0, 0], [0.4, -0.2, 0], [0.5, -0.1, 0]], atol=1e-7)


def test_resolving_twice_changes_nothing():
    once = ap.Obstacles.afloat([[0.0, 0.0, 0.0]], [5.0]).resolved(STREAM)
    np.testing.assert_array_equal(once.velocity, once.resolved(STREAM).velocity)


def test_boundary_grows_with_time_since_the_last_look():
    known = {"position_std": 3.0, "radius_std": 4.0, "observed_at": 100.0}
    one = ap.Obstacles.static([[0.0, 0.0, 0.0]], [20.0], growth=0.5, growth_max=30.0, **known)
    known = 20.0 + CONFIDENCE * 5.0
    for t, expected in ((50.0, known), (100.0, known), (120.0, known + 10.0), (1e4, known + 30.0)):
        np.testing.assert_allclose(one.boundary(jnp.asarray(t)), [expected], rtol=1e-6)


def test_padding_is_inactive_and_bounded():
    padded = ap.Obstacles.static([[1.0, 2.0, 3.0]], [4.0]).padded(3)
    assert len(padded) == 3
    np.testing.assert_array_equal(padded.active, [True, False, False])
    assert len(ap.Obstacles.none()) == 0
    assert not ap.Obstacles.none().padded(2).active.any()
    with pytest.raises(ValueError, match="capacity"):
        padded.padded(2)


def test_padding_keeps_leading_axes():
    one = ap.Obstacles.static([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], [4.0, 5.0])
    both = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), one).padded(4)
    for stacked, leaf in zip(jax.tree.leaves(both), jax.tree.leaves(one.padded(4)), strict=True):
        np.testing.assert_array_equal(stacked, [leaf, leaf])


@pytest.mark.parametrize(
    ("radii", "extra", "message"),
    [
        ([-1.0], {}, "negative"),
        ([1.0, 2.0], {}, "radii"),
        ([1.0], {"growth": [0.1, 0.2]}, "growth"),
        ([np.inf], {}, "radii must be finite, got inf"),
        ([1.0], {"growth_max": np.nan}, "growth_max must be finite"),
        ([1.0], {"growth": -1.0}, "growth must not be negative"),
        ([1.0], {"position_std": -1.0}, "position_std must not be negative"),
        ([1.0], {"observed_at": -np.inf}, "observed_at must be finite, got -inf"),
    ],
)
def test_bad_input_is_named(radii, extra, message):
    with pytest.raises(ValueError, match=message):
        ap.Obstacles.static([[0.0, 0.0, 0.0]], radii, **extra)


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_places_and_velocities_must_be_finite(wrong):
    with pytest.raises(ValueError, match=f"positions must be finite, got {wrong}"):
        ap.Obstacles.static([[1.0, 2.0, 3.0], [wrong, 0.0, 0.0]], [5.0, 5.0])
    with pytest.raises(ValueError, match=f"velocity must be finite, got {wrong}"):
        ap.Obstacles.self_motivated([[1.0, 2.0, 3.0]], [5.0], [[0.0, wrong, 0.0]])
    assert ap.Obstacles.static([[1.0, 2.0, 3.0]], [5.0], growth_max=np.inf).growth_max[0] == np.inf
    slope = jax.grad(lambda x: ap.Obstacles.static([[x, 2.0, 3.0]], [5.0]).position.sum())(1.0)
    assert slope == 1.0
