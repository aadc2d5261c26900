"""Samples of currents given as functions, against the functions."""

import jax.numpy as jnp
import numpy as np
import pytest

from auvplan.ocean.currents import FunctionCurrent, evaluated, is_steady
from auvplan.ocean.sampled import sampled

BOX = (-1000.0, -2000.0, 0.0), (5000.0, 2000.0, 80.0)


def eddies(x, y, z, t):
    return 0.5 * jnp.sin(y / 500.0), 0.4 * jnp.sin(x / 700.0), 0.0 * z


def layers(x, y, z, t):
    return 0.6 * jnp.tanh((z - 30.0) / 3.0), 0.1 * jnp.cos(x / 2000.0), 0.0 * z


def tide(x, y, z, t):
    return 0.6 * jnp.cos(t / 7000.0), 0.2 * jnp.sin(x / 900.0 - t / 7000.0), 0.0 * z


def both(x, y, z, t):
    u, v, _ = layers(x, y, z, t)
    return u * jnp.cos(t / 7000.0), v, 1e-3 * z


@pytest.mark.parametrize(
    ("function", "steady", "planar"),
    [(eddies, True, True), (layers, True, False), (tide, False, True), (both, False, False)],
)
def test_samples_are_as_near_as_they_say(function, steady, planar):
    current = FunctionCurrent(function)
    grid, error = sampled(current, *BOX, 0.0, 10_000.0, 0.03)
    assert (is_steady(grid), grid.barotropic, error <= 0.03) == (steady, planar, True)
    rng = np.random.default_rng(1)
    low, high = np.array(BOX)
    x, y, z = (low + (high - low) * rng.random((20_000, 3))).T
    t = rng.uniform(0.0, 10_000.0, 20_000)
    pairs = zip(evaluated(current, x, y, z, t), evaluated(grid, x, y, z, t), strict=True)
    apart = np.sqrt(sum((one - other) ** 2 for one, other in pairs))
    assert apart.max() < 1.5 * error
    assert (grid.w is None) is (function is not both)


@pytest.mark.parametrize(
    "function",
    [
        lambda x, y, z, t: (jnp.where(x > 2000.0, 0.5, -0.2), 0.0, 0.0),
        lambda x, y, z, t: (jnp.where(t > 5000.0, 0.5, -0.2), 0.0, 0.0),
        lambda x, y, z, t: (0.8 * jnp.exp(-(((y - 400.0) / 5.0) ** 2)), 0.0, 0.0),
        lambda x, y, z, t: (jnp.where(x > 4000.0, jnp.nan, 0.2), 0.0, 0.0),
    ],
)
def test_what_samples_do_not_follow_is_not_sampled(function):
    """A front, a current that sets in, a jet narrower than a node, and a current that is no number."""
    assert sampled(FunctionCurrent(function), *BOX, 0.0, 10_000.0, 0.03) is None


def test_times_that_single_precision_does_not_tell_apart_are_not_sampled():
    assert sampled(FunctionCurrent(tide), *BOX, 0.0, 8192.0, 0.03) is not None
    assert sampled(FunctionCurrent(tide), *BOX, 1.7e9, 1.7e9 + 8192.0, 0.03) is None
