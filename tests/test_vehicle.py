"""Kinematics (Eqs 6-8, 10) and the three readings of speed along the track, against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.vehicle import SPEED_FLOOR, Vehicle, along_track, ground_velocity, orientation, rotation

angles = st.floats(-1.4, 1.4)


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


@pytest.mark.parametrize(("along", "across"), [(-3.0, 0.0), (0.0, 3.0), (-2.5, 0.0), (0.0, 2.5), (-1.0, 2.4)])
def test_beaten_vehicle_is_a_violation_with_finite_gradient(along, across):
    ground, shortfall = along_track("track", 2.5, jnp.asarray(along), jnp.asarray(across))
    assert float(shortfall) > 0.0
    assert float(ground) >= SPEED_FLOOR * 2.5 * (1 - 1e-6)
    slope = jax.grad(lambda p: sum(along_track("track", p[2], p[0], p[1])))(jnp.array([along, across, 2.5]))
    assert np.isfinite(slope).all()


@given(yaw=angles, pitch=angles)
@settings(max_examples=25, deadline=None)
def test_rotation_carries_surge_along_the_orientation(yaw, pitch):
    matrix = np.asarray(rotation(yaw, pitch))
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-6)
    north, east, down = matrix @ [1.0, 0.0, 0.0]
    back = orientation(north, east, down)
    np.testing.assert_allclose(back, [yaw, pitch], atol=1e-5)


def test_ground_velocity_adds_the_current():
    yaw, pitch = orientation(3.0, 4.0, 0.0)
    np.testing.assert_allclose(ground_velocity(2.5, yaw, pitch, (0.1, -0.2, 0.3)), [1.6, 1.8, 0.3], rtol=1e-6)
    # Nose up is towards smaller depth.
    assert float(ground_velocity(2.5, 0.0, 0.3, (0.0, 0.0, 0.0))[2]) < 0


@pytest.mark.parametrize("field", ["speed", "surge_max", "sway_max", "turn_rate_max"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_vehicles_are_refused(field, value):
    with pytest.raises(ValueError, match=field):
        Vehicle(**{field: value})
