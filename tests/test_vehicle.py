"""The three readings of speed along the track against closed forms; vehicles that are refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from auvplan.vehicle import SPEED_FLOOR, Vehicle, along_track


@pytest.mark.parametrize(
    ("along", "across", "expected"),
    [(0.0, 0.0, 2.5), (1.0, 0.0, 3.5), (-1.0, 0.0, 1.5), (0.0, 1.5, 2.0), (0.7, 2.0, 2.2)],
)
@pytest.mark.usefixtures("x64")
def test_ground_speed_closed_forms(along, across, expected):
    ground, shortfall = along_track("track", 2.5, jnp.asarray(along), jnp.asarray(across))
    assert float(ground) == pytest.approx(expected, rel=1e-12)
    assert float(shortfall) == 0.0


def test_other_readings():
    along, across = jnp.asarray(0.6), jnp.asarray(0.8)
    assert float(along_track("eq8", 2.5, along, across)[0]) == pytest.approx(3.1)
    assert float(along_track("eq11", 2.5, along, across)[0]) == pytest.approx(2.5)


@pytest.mark.parametrize("reading", ["track", "eq8", "eq11"])
@pytest.mark.usefixtures("x64")
def test_arrays_of_numpy_and_of_jax_give_the_same(reading):
    along, across = np.linspace(-3.0, 3.0, 13), np.linspace(0.0, 3.0, 13)
    host, device = (along_track(reading, 2.5, xp.asarray(along), xp.asarray(across)) for xp in (np, jnp))
    assert all(isinstance(part, np.ndarray) for part in host)
    np.testing.assert_allclose(host, device, rtol=1e-12)


@pytest.mark.parametrize(("along", "across"), [(-3.0, 0.0), (0.0, 3.0), (-2.5, 0.0), (0.0, 2.5), (-1.0, 2.4)])
def test_beaten_vehicle_is_a_violation_with_finite_gradient(along, across):
    ground, shortfall = along_track("track", 2.5, jnp.asarray(along), jnp.asarray(across))
    assert float(shortfall) > 0.0
    assert float(ground) >= SPEED_FLOOR * 2.5 * (1 - 1e-6)
    slope = jax.grad(lambda p: sum(along_track("track", p[2], p[0], p[1])))(jnp.array([along, across, 2.5]))
    assert np.isfinite(slope).all()


@pytest.mark.parametrize("field", ["speed", "surge_max", "sway_max", "turn_rate_max"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_vehicles_are_refused(field, value):
    with pytest.raises(ValueError, match=field):
        Vehicle(**{field: value})


@pytest.mark.parametrize("field", ["speed", "surge_max", "sway_max", "turn_rate_max"])
@pytest.mark.parametrize("value", ["3 kn", None, 2.5j, [2.5], np.array(["2.5"]), object()])
def test_values_that_are_no_numbers_are_refused(field, value):
    with pytest.raises(TypeError, match=f"^vehicle {field} must be a number of [^\n]+$"):
        Vehicle(**{field: value})


@pytest.mark.parametrize("field", ["pitch_max", "climb_rate_max", "dive_rate_max"])
def test_limits_in_the_vertical_may_be_absent(field):
    assert getattr(Vehicle(**{field: None}), field) is None
    assert field not in {path[-1].name for path, _ in jax.tree.leaves_with_path(Vehicle(**{field: None}))}
    for value in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match=field):
            Vehicle(**{field: value})
    with pytest.raises(TypeError, match=field):
        Vehicle(**{field: "30 deg"})


def test_a_transit_has_a_depth_or_an_altitude():
    assert not Vehicle().has_transit
    assert Vehicle(transit_depth=0.0).has_transit
    assert not Vehicle(transit_altitude=5.0).without_transit().has_transit
    for given in ({"transit_depth": -1.0}, {"transit_altitude": 0.0}, {"transit_depth": float("nan")}):
        with pytest.raises(ValueError, match="transit"):
            Vehicle(**given)
    with pytest.raises(ValueError, match="exclude each other"):
        Vehicle(transit_depth=5.0, transit_altitude=5.0)


def test_pitch_is_at_most_a_right_angle():
    assert Vehicle(pitch_max=0.5 * np.pi).pitch_max == 0.5 * np.pi
    assert Vehicle().pitch_max == pytest.approx(np.radians(30.0))
    with pytest.raises(ValueError, match="pitch_max must be at most a right angle"):
        Vehicle(pitch_max=30.0)


def test_vehicles_of_arrays_are_checked_and_rebuilt():
    with pytest.raises(ValueError, match="speed"):
        Vehicle(speed=jnp.array([2.5, -1.0]))
    assert jax.tree.map(lambda _: None, Vehicle(), is_leaf=lambda leaf: leaf is None).speed is None
    assert jax.jit(lambda speed: Vehicle(speed).speed)(3.0) == 3.0
