"""The ruler in depth: closed forms of climbs, spheres and the sea bed."""

from dataclasses import replace

import numpy as np
import pytest

import auvplan as ap
from benchmarks.path_problems import PathProblem, unlimited_vehicle
from benchmarks.path_ruler import evaluate

START, GOAL, SPEED = (0.0, 500.0, 20.0), (1000.0, 500.0, 20.0), 2.0


def deep(current=None, obstacles=None, seabed=None, pitch_max=None):
    env = ap.Environment(current, None, obstacles, (-100, 0, 0), (1100, 1000, 200), seabed)
    vehicle = replace(unlimited_vehicle(SPEED), pitch_max=pitch_max)
    return PathProblem("own", "own", env, START, GOAL, vehicle)


def dive(depth, reach=100.0):
    return np.array([START, (reach, 500.0, depth), (1000.0 - reach, 500.0, depth), GOAL])


def test_a_dive_is_timed_in_closed_form():
    score = evaluate(deep(lambda x, y, z, t: (0.0 * z, 0.0, 0.0)), dive(120.0))
    length = 2.0 * np.hypot(100.0, 100.0) + 800.0
    assert score.travel_time == pytest.approx(length / SPEED, rel=1e-9)
    assert score.length == pytest.approx(length)
    assert score.feasible


def test_the_current_counts_at_its_depth_and_upright():
    problem = deep(lambda x, y, z, t: (0.01 * z, 0.0, 0.3))
    path = np.array([START, (1000.0, 500.0, 20.0)])
    score = evaluate(problem, path)
    assert score.travel_time == pytest.approx(1000.0 / (0.2 + np.sqrt(SPEED**2 - 0.3**2)), rel=1e-6)


def test_spheres_are_passed_above_and_below():
    sphere = ap.Obstacles.static([[500.0, 500.0, 20.0]], [90.0])
    problem, margin = deep(obstacles=sphere), ap.PathConfig().obstacle_margin
    assert not evaluate(problem, dive(20.0)).feasible
    score = evaluate(problem, dive(120.0, reach=300.0))
    assert score.feasible
    assert score.clearance == pytest.approx(10.0 - margin, abs=0.05)


def test_paths_keep_above_the_sea_bed_and_in_the_box():
    bed = ap.Seabed.from_depth(np.full((40, 40), 100.0), 40.0, (-200.0, -200.0), clearance=5.0)
    problem = deep(seabed=bed)
    for depth, feasible in ((94.0, True), (96.0, False)):
        score = evaluate(problem, dive(depth))
        assert score.feasible == feasible
        assert min(score.clearance, 0.0) == pytest.approx(min(95.0 - depth, 0.0), abs=1e-3)
    assert not evaluate(deep(), dive(-1.0)).feasible


@pytest.mark.parametrize("up", [-0.2, 0.0, 0.2])
def test_pitch_is_judged_through_the_water(up):
    """A climb against water that sinks needs more pitch than its slope, one that rises less."""
    problem = deep(lambda x, y, z, t: (0.0, 0.0, -up))
    score = evaluate(problem, dive(120.0))
    # Both ramps are at 45 degrees; the one that the water is against needs most.
    along, across = np.array([-up, up]) / np.sqrt(2.0), abs(up) / np.sqrt(2.0)
    ground = along + np.sqrt(SPEED**2 - across**2)
    pitch = np.arcsin(np.abs(ground * np.sqrt(0.5) + np.array([up, -up])).max() / SPEED)
    for share, kept in ((0.95, False), (1.05, True)):
        assert (
            evaluate(deep(problem.environment.current, pitch_max=share * pitch), dive(120.0)).feasible == kept
        )
    assert score.feasible
