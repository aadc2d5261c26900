"""Speeds of least energy per metre against brute force, and their derivatives."""

from itertools import product

import jax
import numpy as np
import pytest

from auvplan.energy import (
    PowerLaw,
    PowerModel,
    PowerTable,
    best_speed,
    cubic_best_speed,
    energy_per_metre,
    speed_range,
)

LAW = PowerModel(PowerLaw(10.0, 15.0), hotel=35.0)
SHALLOW = PowerModel(PowerLaw(2.0, 12.0, 1.7), hotel=20.0, payload=10.0)
TABLE = PowerModel(
    PowerTable([0.0, 0.5556, 0.9444, 1.0, 1.3, 1.6], [0.0, 14, 20, 24.25, 45.5, 70]), hotel=36.0
)
LIMITS = 0.2, 3.0
compiled = jax.jit(best_speed)
CASES = list(product((-0.8, -0.2, 0.0, 0.5), (0.0, 0.4), (0.0, 60.0)))


def brute_force(model, along, across, price, limits):
    """The best of a fine grid of speeds at which the current does not beat the vehicle, in plain NumPy."""
    speeds = np.linspace(*limits, 400_001)
    with np.errstate(invalid="ignore", divide="ignore"):
        ground = along + np.sqrt(speeds**2 - across**2)
        cost = np.where(ground > 0.05 * speeds, (model.power(speeds) + price) / ground, np.inf)
    return float(speeds[np.nanargmin(cost)]), float(np.nanmin(cost))


@pytest.mark.parametrize("model", [LAW, SHALLOW, TABLE], ids=["cubic", "power law", "table"])
def test_the_best_speed_is_that_of_brute_force(model):
    along, across, price = (np.asarray(part) for part in zip(*CASES, strict=True))
    found = compiled(model, along, across, price, LIMITS)
    for case, speed in zip(CASES, np.asarray(found), strict=True):
        best, least = brute_force(model, *case, LIMITS)
        assert float(energy_per_metre(model, speed, *case)) == pytest.approx(least, rel=1e-4)
        assert speed == pytest.approx(best, rel=1e-3)


def test_the_closed_form_of_a_cubic():
    for constant, factor, along in product((5.0, 45.0, 300.0), (4.0, 15.0), (-1.5, -0.3, 0.0, 0.3, 1.5, 3.0)):
        speed = float(cubic_best_speed(constant, factor, along))
        root = 2.0 * factor * speed**3 + 3.0 * factor * along * speed**2 - constant
        assert abs(root) < 1e-4 * constant + 1e-3 * factor * speed**3
        assert speed + along > 0.0
        limits = max(0.02, -along * 1.1), 8.0
        best, _ = brute_force(PowerModel(PowerLaw(constant, factor)), along, 0.0, 0.0, limits)
        assert speed == pytest.approx(best, rel=1e-3)


@pytest.mark.usefixtures("x64")
def test_both_forms_agree_and_so_do_their_derivatives():
    def closed(hotel, factor, along, price):
        return cubic_best_speed(10.0 + hotel + price, factor, along)

    def general(hotel, factor, along, price):
        model = PowerModel(PowerLaw(10.0, factor), hotel=hotel)
        return best_speed(model, along, 0.0, price, LIMITS)

    forms = [jax.jit(jax.value_and_grad(form, argnums=(0, 1, 2, 3))) for form in (general, closed)]
    for given in (
        (35.0, 15.0, 0.3, 0.0),
        (35.0, 15.0, -0.4, 20.0),
        (20.0, 5.0, 0.0, 0.0),
        (1.0, 15.0, 1.2, 0.0),
    ):
        (speed, slopes), (expected, differentials) = (form(*given) for form in forms)
        assert float(speed) == pytest.approx(float(expected), rel=1e-8)
        np.testing.assert_allclose(slopes, differentials, rtol=1e-4, atol=1e-8)


@pytest.mark.usefixtures("x64")
def test_derivatives_across_a_current_against_differences():
    speed = jax.jit(jax.value_and_grad(lambda across: best_speed(LAW, -0.2, across, 10.0, LIMITS)))
    step = 1e-4
    differences = (speed(0.4 + step)[0] - speed(0.4 - step)[0]) / (2.0 * step)
    assert float(speed(0.4)[1]) == pytest.approx(float(differences), rel=1e-4)


def test_limits_and_corners():
    found = jax.jit(jax.value_and_grad(best_speed, argnums=(3, 4)))

    def at(model, limits, along=0.0, price=0.0):
        return found(model, along, 0.0, price, limits)

    low, slopes = at(LAW, (1.8, 3.0))
    assert float(low) == pytest.approx(1.8)
    assert float(slopes[1][0]) == pytest.approx(1.0)
    assert float(at(LAW, (0.2, 2.0), price=1e5)[0]) == pytest.approx(2.0)
    assert float(at(TABLE, LIMITS, price=1.0)[1][0]) == 0.0
    assert float(at(LAW, (0.2, 3.0), along=-4.0)[0]) == pytest.approx(3.0), "beaten at any speed"
    assert speed_range(TABLE) == (0.5556, 1.6)
    assert speed_range(LAW) == (0.1, 5.0)
