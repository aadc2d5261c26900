"""The ruler against closed forms: currents, limits, climbs, spheres, the sea bed, and what moves."""

from dataclasses import replace

import numpy as np
import pytest

import auvplan as ap
from benchmarks.paths.problems import PathProblem, unlimited_vehicle
from benchmarks.paths.ruler import LIMIT_TOLERANCE, evaluate

SIDE, SPEED = 4000.0, 2.0
START, GOAL = (0.0, 500.0, 20.0), (1000.0, 500.0, 20.0)


def planar(current=None, obstacles=None, depart=0.0, **limits):
    env = ap.Environment(current, None, obstacles, (0, 0, 0), (SIDE, SIDE, 0))
    vehicle = replace(unlimited_vehicle(SPEED), **limits)
    return PathProblem("own", "own", env, (1000.0, 1000.0, 0.0), (3000.0, 1000.0, 0.0), vehicle, depart)


def deep(current=None, obstacles=None, seabed=None, pitch_max=None):
    env = ap.Environment(current, None, obstacles, (-100, 0, 0), (1100, 1000, 200), seabed)
    return PathProblem("own", "own", env, START, GOAL, replace(unlimited_vehicle(SPEED), pitch_max=pitch_max))


def straight(problem, count=41):
    return np.linspace(problem.start, problem.goal, count)


def dive(depth, reach=100.0):
    return np.array([START, (reach, 500.0, depth), (1000.0 - reach, 500.0, depth), GOAL])


def crab(x, y, z, t):
    return 0.4, -0.9, 0.0


def test_a_crab_is_timed_in_closed_form():
    problem = planar(crab)
    score = evaluate(problem, straight(problem))
    assert score.travel_time == pytest.approx(2000.0 / (0.4 + np.sqrt(SPEED**2 - 0.9**2)), rel=1e-6)
    assert score.feasible
    assert score.length == pytest.approx(2000.0)


def test_a_dive_is_timed_in_closed_form():
    score = evaluate(deep(lambda x, y, z, t: (0.0 * z, 0.0, 0.0)), dive(120.0))
    length = 2.0 * np.hypot(100.0, 100.0) + 800.0
    assert score.travel_time == pytest.approx(length / SPEED, rel=1e-9)
    assert score.length == pytest.approx(length)
    assert score.feasible


def test_the_current_counts_at_its_depth_and_upright():
    score = evaluate(deep(lambda x, y, z, t: (0.01 * z, 0.0, 0.3)), np.array([START, GOAL]))
    assert score.travel_time == pytest.approx(1000.0 / (0.2 + np.sqrt(SPEED**2 - 0.3**2)), rel=1e-6)


ARC = np.column_stack([
    2000.0 - 1000.0 * np.cos(np.linspace(0.0, np.pi, 101)),
    1000.0 + 1000.0 * np.sin(np.linspace(0.0, np.pi, 101)),
])  # fmt: skip


@pytest.mark.parametrize(
    ("limit", "value", "current", "path", "within"),
    [
        ("surge_max", 0.4 + np.sqrt(SPEED**2 - 0.9**2), crab, None, 1e-5),
        ("sway_max", 0.9, crab, None, 1e-5),
        ("turn_rate_max", SPEED / 1000.0, None, ARC, 1e-3),
    ],
)
def test_limits_of_the_vehicle_are_judged(limit, value, current, path, within):
    for share, kept in ((1.0 - 2.0 * LIMIT_TOLERANCE, False), (1.0 + 2.0 * LIMIT_TOLERANCE, True)):
        problem = planar(current, **{limit: share * value})
        score = evaluate(problem, straight(problem) if path is None else path)
        assert score.feasible == kept
        assert score.excess == pytest.approx(1.0 / share - 1.0, abs=within)


@pytest.mark.parametrize("up", [-0.2, 0.0, 0.2])
def test_pitch_is_judged_through_the_water(up):
    """A climb against water that sinks needs more pitch than its slope, one that rises less."""
    # Both ramps are at 45 degrees; the one that the water is against needs most.
    along, across = np.array([-up, up]) / np.sqrt(2.0), abs(up) / np.sqrt(2.0)
    ground = along + np.sqrt(SPEED**2 - across**2)
    pitch = np.arcsin(np.abs(ground * np.sqrt(0.5) + np.array([up, -up])).max() / SPEED)
    for share, kept in ((0.95, False), (1.05, True), (None, True)):
        problem = deep(lambda x, y, z, t: (0.0, 0.0, -up), pitch_max=share and share * pitch)
        assert evaluate(problem, dive(120.0)).feasible == kept


def test_spheres_are_passed_above_and_below():
    problem = deep(obstacles=ap.Obstacles.static([[500.0, 500.0, 20.0]], [90.0]))
    assert not evaluate(problem, dive(20.0)).feasible
    score = evaluate(problem, dive(120.0, reach=300.0))
    assert score.feasible
    assert score.clearance == pytest.approx(10.0 - ap.PathConfig().obstacle_margin, abs=0.05)


def test_paths_keep_above_the_sea_bed_and_in_the_box():
    bed = ap.Seabed.from_depth(np.full((40, 40), 100.0), 40.0, (-200.0, -200.0), clearance=5.0)
    for depth, feasible in ((94.0, True), (96.0, False)):
        score = evaluate(deep(seabed=bed), dive(depth))
        assert score.feasible == feasible
        assert min(score.clearance, 0.0) == pytest.approx(min(95.0 - depth, 0.0), abs=1e-3)
    assert not evaluate(deep(), dive(-1.0)).feasible


def test_what_moves_is_met_at_the_time_of_arrival():
    rng = np.random.default_rng(2)
    count, depart, drift = 4, 300.0, np.array([0.0, 1.0, 1.0, 0.0])
    places, level = rng.uniform(500.0, 3500.0, (count, 2)), np.zeros(count)
    radii, own = rng.uniform(20.0, 90.0, count), rng.uniform(-1.0, 1.0, (count, 2))
    obstacles = ap.Obstacles.create(
        np.c_[places, level], radii, velocity=np.c_[own, level], drift=drift, growth=0.05, growth_max=30.0,
        observed_at=100.0,
    )  # fmt: skip
    problem = planar(lambda x, y, z, t: (0.3, 0.0, 0.0), obstacles.padded(7), depart)
    score = evaluate(problem, straight(problem))
    # Walked in plain NumPy: 2.3 m/s along x from the start on.
    elapsed = np.linspace(0.0, 2000.0 / 2.3, 20_001)[:, None]
    since = depart + elapsed - 100.0
    place = np.array([1000.0, 1000.0]) + elapsed * np.array([2.3, 0.0])
    centres = places + since[..., None] * (own + drift[:, None] * [0.3, 0.0])
    away = np.linalg.norm(place[:, None] - centres, axis=2) - radii - np.minimum(0.05 * since, 30.0)
    assert score.clearance == pytest.approx(away.min() - ap.PathConfig().obstacle_margin, abs=0.05)


@pytest.mark.parametrize(("late", "feasible"), [(0.0, False), (-200.0, True), (200.0, True)])
def test_what_moves_leaves_the_way_free_again(late, feasible):
    """An obstacle is on the straight line so many seconds before the vehicle."""
    start = [2000.0, 1000.0 - (500.0 - late), 0.0]
    problem = planar(obstacles=ap.Obstacles.create([start], [50.0], velocity=[[0.0, 1.0, 0.0]]))
    assert evaluate(problem, straight(problem)).feasible == feasible
