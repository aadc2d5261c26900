"""Attitude and velocities along plans and tracks (Eqs 6-8, 10), against closed forms and each other."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import auvplan as ap
from auvplan.path.motion import Motion, ground_velocity, orientation, rotation
from tests.path.worlds import CONFIG, GOAL, START, world

SPEED = 2.5
angles = st.floats(-1.4, 1.4)
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(yaw=angles, pitch=angles)
@settings(max_examples=25, deadline=None)
def test_rotation_carries_surge_along_the_orientation(yaw, pitch):
    matrix = rotation(yaw, pitch)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(orientation(matrix @ [1.0, 0.0, 0.0]), [yaw, pitch], atol=1e-12)
    # Sway stays level at zero roll.
    assert matrix[2, 1] == 0.0


def test_ground_velocity_is_the_sum_of_eq8():
    yaw, pitch = orientation([3.0, 4.0, 0.0])
    np.testing.assert_allclose(ground_velocity(SPEED, yaw, pitch, [0.1, -0.2, 0.3]), [1.6, 1.8, 0.3])
    # Nose up is towards smaller depth.
    assert ground_velocity(SPEED, 0.0, 0.3, np.zeros(3))[2] < 0


def test_crabbing_in_closed_form():
    """A stream of 1.5 m/s to the east, a track to the north: 2 m/s over ground, the nose to the west."""
    motion = Motion.along("track", SPEED, [[100.0, 0.0, 0.0]], [[0.0, 1.5, 0.0]])
    np.testing.assert_allclose(motion.ground_velocity, [[2.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose([motion.yaw[0], motion.pitch[0]], [-np.arcsin(0.6), 0.0], atol=1e-12)
    np.testing.assert_allclose(motion.course, 0.0, atol=1e-12)
    # 2 m/s to the north seen from a hull that points 36.9 degrees to the west.
    np.testing.assert_allclose(motion.body_velocity, [[1.6, 1.2, 0.0]], atol=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_the_hull_turns_faster_than_the_course_in_a_following_current(share):
    """By ground speed over speed through the water along the track: at most 1 + share, the current astern."""
    bearing = np.linspace(0.0, 2.0 * np.pi, 2000)
    way = np.stack([np.cos(bearing), np.sin(bearing), np.zeros(2000)], axis=1)
    water = np.tile([share * SPEED, 0.0, 0.0], (2000, 1))
    motion = Motion.along("track", SPEED, way, water)
    hull, course = (np.diff(np.unwrap(angle)) for angle in (motion.yaw, motion.course))
    over_ground = np.linalg.norm(motion.ground_velocity, axis=1)
    along = ((motion.ground_velocity - water) * way).sum(axis=1)
    ratio = over_ground / along
    np.testing.assert_allclose(hull / course, 0.5 * (ratio[1:] + ratio[:-1]), rtol=1e-3, atol=1e-3)
    assert (hull / course).max() == pytest.approx(1.0 + share, rel=1e-4)


def test_drifting_in_closed_form():
    """The same in Eq. 8's reading: the nose along the segment, carried off it to the east."""
    motion = Motion.along("eq8", SPEED, [[100.0, 0.0, 0.0]], [[0.0, 1.5, 0.0]])
    np.testing.assert_allclose([motion.yaw[0], motion.pitch[0]], 0.0, atol=1e-12)
    np.testing.assert_allclose(motion.course, np.arctan2(1.5, 2.5))
    np.testing.assert_allclose(motion.body_velocity, [[2.5, 1.5, 0.0]], atol=1e-12)


@given(
    st.sampled_from(["track", "eq8", "eq11"]), st.lists(st.tuples(vectors, vectors), min_size=1, max_size=5)
)
@settings(max_examples=30, deadline=None)
def test_eq7_turns_body_velocities_into_ground_velocities(reading, pairs):
    way, water = (np.asarray(part) for part in zip(*pairs, strict=True))
    motion = Motion.along(reading, SPEED, 100.0 * way, 0.9 * water)
    back = np.einsum("nij,nj->ni", rotation(motion.yaw, motion.pitch), motion.body_velocity)
    np.testing.assert_allclose(back, motion.ground_velocity, atol=1e-12)
    same = Motion.of_body(motion.yaw, motion.pitch, motion.body_velocity)
    np.testing.assert_allclose(same.ground_velocity, motion.ground_velocity, atol=1e-12)
    assert np.isfinite(motion.course).all()


def test_where_the_current_beats_it_a_vehicle_is_too_slow_for_its_track():
    motion = Motion.along("track", SPEED, [[100.0, 0.0, 0.0]], [[0.0, 3.0, 0.0]])
    through_water = motion.ground_velocity - [[0.0, 3.0, 0.0]]
    assert np.linalg.norm(through_water) > SPEED


@pytest.fixture(
    scope="module",
    params=["track", *(pytest.param(name, marks=pytest.mark.slow) for name in ("eq8", "eq11"))],
)
def plan(request):
    """A plan through vortices and over some depth, in each reading of speed."""
    config = CONFIG.replace(speed_reading=request.param)
    return ap.plan_path(START, GOAL, world(), key=jax.random.key(2), config=config, depart=50.0)


def test_plans_carry_attitude_and_velocities(plan):
    reading, segments = plan.conditions.config.speed_reading, len(plan.times) - 1
    way = np.diff(np.asarray(plan.positions, float), axis=0)
    psi, theta = orientation(way)  # Eq. 10
    assert plan.course.shape == plan.yaw.shape == plan.pitch.shape == (segments,)
    assert plan.body_velocity.shape == plan.ground_velocity.shape == plan.water.shape == (segments, 3)
    back = np.einsum("nij,nj->ni", rotation(plan.yaw, plan.pitch), plan.body_velocity)  # Eq. 7
    np.testing.assert_allclose(back, plan.ground_velocity, atol=1e-12)
    if reading == "track":
        np.testing.assert_allclose(np.cos(plan.course - psi), 1.0, atol=1e-12)
        through_water = np.linalg.norm(plan.ground_velocity - plan.water, axis=1)
        np.testing.assert_allclose(through_water, SPEED, rtol=1e-12)
        assert np.abs(plan.yaw - psi).max() > 0.01
    else:
        np.testing.assert_allclose(np.cos(plan.yaw - psi), 1.0, atol=1e-12)
        np.testing.assert_allclose(plan.pitch, theta, atol=1e-12)
    met = plan.water if reading != "eq11" else np.zeros_like(plan.water)
    summed = ground_velocity(SPEED, plan.yaw, plan.pitch, met)  # Eq. 8
    np.testing.assert_allclose(summed, plan.ground_velocity, atol=1e-12)
    # The planned times go with the progress along each segment.
    progress = (plan.ground_velocity * way).sum(axis=1) / np.linalg.norm(way, axis=1)
    np.testing.assert_allclose(progress * np.diff(plan.times), np.linalg.norm(way, axis=1), rtol=2e-4)


def test_unknown_motion_is_nan():
    nothing = Motion.none(2)
    assert len(nothing) == 2
    for part in (nothing.yaw, nothing.course, nothing.body_velocity):
        assert np.isnan(part).all()
    assert Motion.none().body_velocity.shape == (0, 3)
