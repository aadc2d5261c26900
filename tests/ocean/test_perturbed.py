"""Currents scaled, and with a uniform one added."""

import jax
import numpy as np
import pytest

import auvplan as ap
from auvplan.ocean.currents import SumCurrent
from auvplan.ocean.ensemble import perturbed
from auvplan.ocean.tides import HarmonicCurrent

PLACES = np.array([300.0, 900.0]), np.array([200.0, 700.0]), np.array([5.0, 5.0]), np.array([0.0, 50.0])


def gridded():
    u = np.arange(8.0).reshape(2, 1, 2, 2) / 10.0
    return ap.GriddedCurrent.from_arrays(u, -u, origin=(0.0, 0.0), spacing=1000.0, times=(0.0, 100.0))


def tidal(shares=(1.0, 1.0)):
    """One constituent of a quarter of a day at two places, with a mean."""
    rng = np.random.default_rng(0)
    parts = [rng.uniform(0.1, 0.5, (2, 2, 1)).astype(np.float32) for _ in range(2)]
    places, rate = np.array([[0.0, 0.0], [1000.0, 0.0]], np.float32), np.array([2.9e-4], np.float32)
    mean, depths = np.array([[0.1, 0.2], [0.0, -0.1]], np.float32), np.array([0.0, 50.0], np.float32)
    return HarmonicCurrent(places, rate, *parts, mean, depths, np.array(shares, np.float32))


@pytest.mark.parametrize("kind", ["vortices", "gridded", "sum", "tidal"])
def test_a_current_is_scaled_and_stepped(kind):
    vortices = ap.random_vortices(jax.random.key(0), (0, 0, 0), (1000, 1000, 0), count=3)
    current = {
        "vortices": vortices, "gridded": gridded(), "sum": SumCurrent(gridded(), vortices), "tidal": tidal(),
    }[kind]  # fmt: skip
    before = np.stack(current(*PLACES))
    after = np.stack(perturbed(current, 0.5, np.array([0.3, -0.2, 0.0]))(*PLACES))
    np.testing.assert_allclose(after, 0.5 * before + np.array([[0.3], [-0.2], [0.0]]), atol=1e-5)


def test_an_offset_of_a_tide_is_the_same_at_all_depths():
    current, deep = tidal(shares=(1.0, 0.2)), (100.0, 300.0, 50.0, 60.0)
    gained = np.stack(perturbed(current, offset=(0.3, -0.2, 0.1))(*deep)) - np.stack(current(*deep))
    np.testing.assert_allclose(gained, [0.3, -0.2, 0.1], atol=1e-6)


def test_a_current_of_another_kind_is_refused():
    with pytest.raises(TypeError, match="UniformCurrent"):
        perturbed(ap.UniformCurrent(1.0, 0.0, 0.0), 1.0, np.zeros(3))
