"""Following straight lines, and leaving them around what stands in them."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from auvplan.mission.survey import LinePart
from auvplan.ocean.chart import Chart
from auvplan.ocean.currents import UniformCurrent
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path import PathConfig
from auvplan.path.cost import VIOLATIONS
from auvplan.path.follow import blocked_on, follow_line
from auvplan.path.plan import PathPlan
from auvplan.path.sensitivity import Conditions
from auvplan.vehicle import Vehicle

START, END = np.array([200.0, 1000.0, 10.0]), np.array([3200.0, 1000.0, 10.0])
CONFIG, VEHICLE = PathConfig.quick(), Vehicle(speed=2.0)
BOX = (0.0, 0.0, 0.0), (4000.0, 2000.0, 50.0)


def world(centres=(), radii=(), land=None, current=(0.0, 0.0)):
    chart = None
    if land is not None:
        passability = np.ones((400, 200))
        passability[land] = 0.0
        chart = Chart.from_passability(passability, 10.0)
    known = Obstacles.static(np.array(centres), np.array(radii)) if len(centres) else None
    return Environment(UniformCurrent(*current), chart, known, *BOX)


def around(env):
    """Stands for the path planner: 200 m aside and back."""
    calls = []

    def detour(start, goal, depart):
        calls.append((start, goal, depart))
        aside = np.array([0.0, 200.0, 0.0])
        corners = np.stack([start, start + aside, goal + aside, goal])
        share = np.linspace(0.0, 3.0, CONFIG.samples)
        places = np.stack([np.interp(share, range(4), axis) for axis in corners.T], axis=1)
        marks = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
        none = np.zeros((len(VIOLATIONS), CONFIG.samples - 1))
        water = np.tile([env.current.u, env.current.v, 0.0], (CONFIG.samples - 1, 1))
        return PathPlan(
            marks[-1] / 2.0, marks[-1], places, depart + marks / 2.0, corners, none.mean(axis=1), 1e6, 1e6,
            marks[-1] / 2.0, jnp.zeros((0, 3)), None, none, water,
            Conditions(env, VEHICLE, CONFIG),
        )  # fmt: skip

    detour.calls = calls
    return detour


def followed(env, place=START, depart=500.0):
    detour = around(env)
    return follow_line(place, (START, END), env, VEHICLE, CONFIG, depart, detour), detour.calls


def test_a_free_line_is_followed_straight_at_the_speed_that_the_current_leaves():
    plan, calls = followed(world(current=(0.5, 1.2)))
    assert not calls
    assert plan.feasible
    assert len(plan.positions) == CONFIG.samples
    np.testing.assert_allclose(plan.positions[:, 1:], np.broadcast_to([1000.0, 10.0], (64, 2)), atol=1e-3)
    assert plan.travel_time == pytest.approx(3000.0 / (0.5 + 1.6), rel=1e-4)
    np.testing.assert_allclose(plan.ground_velocity[:, 0], 2.1, rtol=1e-3)


@pytest.mark.parametrize(
    ("env", "stands"),
    [
        (world([(1500.0, 1020.0, 10.0)], [60.0]), (1500.0, 70.0)),
        (world(land=(slice(145, 155), slice(60, 104))), (1500.0, 70.0)),
    ],
    ids=["obstacle", "land or closed area"],
)
def test_a_line_is_left_just_before_what_stands_in_it_and_taken_up_just_after(env, stands):
    plan, ((leaves, meets, depart),) = followed(env)
    middle, reach = stands
    assert middle - reach - 30.0 < leaves[0] < middle < meets[0] < middle + reach + 30.0
    assert depart == pytest.approx(500.0 + (leaves[0] - 200.0) / 2.0, abs=0.1)
    part = LinePart(tuple(START), tuple(END), 5.0)
    covered = part.covered(plan.positions)
    # An arc of a quarter turn begins its radius before the corner and is within the tolerance for some of it;
    # it ends at a sample of the detour.
    between = 200.0 / ((CONFIG.samples - 1) / 3)
    radius = between * np.ceil(VEHICLE.speed / VEHICLE.turn_rate_max / between)
    lost = radius - np.sqrt(radius**2 - (radius - part.tolerance) ** 2)
    expected = 3000.0 - (meets[0] - leaves[0]) - 2.0 * lost
    assert covered.length == pytest.approx(expected, abs=1.0)
    assert covered.worst <= part.tolerance + 1e-3
    # The plan is one path that ends where the line does.
    np.testing.assert_allclose(plan.positions[-1], END, atol=0.01)
    assert (np.diff(plan.times) > 0.0).all()
    (low, high), *more = blocked_on(START, END, env, VEHICLE, CONFIG)
    assert not more
    assert (200.0 + low, 200.0 + high) == pytest.approx((leaves[0], meets[0]), abs=0.1)


def turn_rates(plan):
    steps = np.diff(np.asarray(plan.positions, float)[:, :2], axis=0)
    courses, lasts = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])), np.diff(plan.times)
    return np.abs(np.diff(courses)) / (0.5 * (lasts[1:] + lasts[:-1]))


@pytest.mark.parametrize("current", [(0.0, 0.0), (0.5, -0.4)])
@pytest.mark.parametrize("turn_rate_max", [0.1, 0.25])
def test_corners_between_line_and_detour_keep_the_turn_rate(current, turn_rate_max):
    env = world([(1500.0, 1020.0, 10.0)], [60.0], current=current)
    vehicle = replace(VEHICLE, turn_rate_max=turn_rate_max)
    detour = around(env)
    plan = follow_line(START, (START, END), env, vehicle, CONFIG, 500.0, detour)
    # Both corners are quarter turns; those of the detour itself are farther off.
    rates = turn_rates(plan)[np.abs(plan.positions[1:-1, 1] - 1000.0) < 100.0]
    assert 0.3 * turn_rate_max < rates.max() <= 1.05 * turn_rate_max
    assert plan.feasible
    off_line = np.abs(plan.positions[:, 1] - 1000.0) > 1.0
    assert off_line.any()
    radius = vehicle.speed / turn_rate_max
    for leaves, meets, _ in detour.calls[-1:]:
        first, last = plan.positions[off_line][[0, -1], 0]
        assert (
            leaves[0] - 2.0 * radius - 10.0
            < first
            < leaves[0]
            < meets[0]
            < last
            < meets[0] + 2.0 * radius + 10.0
        )


def test_a_line_is_left_earlier_where_an_arc_would_lead_too_near():
    corner = followed(world([(1500.0, 1020.0, 10.0)], [60.0]))[1][0][0]
    # On the inside of the corner, nearer to an arc of 20 m than to its tangents.
    beside = corner + np.array([-CONFIG.obstacle_margin - 6.5, CONFIG.obstacle_margin + 6.5, 0.0])
    plan, (first, second) = followed(world([(1500.0, 1020.0, 10.0), beside], [60.0, 1.0]))
    np.testing.assert_allclose(first[0], corner)
    assert second[0][0] < corner[0] - 15.0
    assert plan.feasible
    assert plan.clearance >= CONFIG.obstacle_margin
    assert (
        turn_rates(plan)[np.abs(plan.positions[1:-1, 1] - 1000.0) < 100.0].max()
        <= 1.05 * VEHICLE.turn_rate_max
    )


def test_two_obstacles_side_by_side_are_passed_in_one_detour_and_others_in_two():
    near = world([(1500.0, 1000.0, 10.0), (1630.0, 1000.0, 10.0)], [40.0, 40.0])
    assert len(followed(near)[1]) == 1
    far = world([(1000.0, 1000.0, 10.0), (2000.0, 1000.0, 10.0)], [40.0, 40.0])
    plan, calls = followed(far)
    assert len(calls) == 2
    assert len(plan.positions) == 3 * CONFIG.samples


@pytest.mark.parametrize(("off", "ahead"), [(100.0, 100.0), (5.0, 20.0)])
def test_a_vehicle_off_the_line_joins_it_ahead(off, ahead):
    """From nearby along twice the root of the turning radius, 20 m, times the distance."""
    plan, ((start, goal, _), *_) = followed(world(), np.array([1000.0, 1000.0 + off, 10.0]))
    np.testing.assert_allclose(start, [1000.0, 1000.0 + off, 10.0])
    np.testing.assert_allclose(goal, [1000.0 + ahead, 1000.0, 10.0])
    np.testing.assert_allclose(plan.positions[-1], END, atol=1e-2)


def test_a_current_that_beats_the_vehicle_on_the_line_breaks_a_limit():
    plan, _ = followed(world(current=(0.0, 1.9)))
    assert plan.broken()[0] == "sway"
