"""Speeds that DUNE is told: by its control, as its log shows it, they take the planned times."""

import math
from dataclasses import replace

import numpy as np
import pytest

from auvplan.export import PlannedLeg
from auvplan.export.imc import Begun, commanded, first_begun, plan_specification
from auvplan.export.speeds import stretches
from auvplan.link import Upload
from tests.export.sample import SPEED, in_current

#: s in which DUNE's control learns a current, and m of its turns: of the logs behind docs/execution.md.
LEARNS, TURN = 31.0, 5.5


def gone(speed: float, current: float, learnt: float, seconds: float) -> tuple[float, float]:
    """Way along the hull, m, and what is learnt: the control stepped through, a twin of the closed form."""
    way, step = 0.0, 0.01
    for _ in range(round(seconds / step)):
        way += step * (speed + current - learnt)
        learnt += step / LEARNS * (current - learnt)
    return way, learnt


@pytest.mark.parametrize("stream", [(0.3, 0.0, 0.0), (-0.2, 0.25, 0.0), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("learnt", [0.0, -0.23, 0.2])
def test_a_control_that_learns_makes_the_planned_way_in_the_planned_time(stream, learnt):
    itinerary = in_current(stream)
    leg = itinerary.legs[0]
    parts, _ = commanded(itinerary, leg, Begun(learnt))
    for part, planned in zip(parts, stretches(itinerary, leg, along_hull=True), strict=True):
        seconds = float(leg.kept_times[part.last] - leg.kept_times[part.first])
        way, learnt = gone(part.speed, planned.speed - SPEED, learnt, seconds)
        assert way == pytest.approx(planned.speed * seconds, rel=1e-3)


def test_without_a_current_only_the_start_and_the_turns_change_the_speed():
    itinerary = in_current((0.0, 0.0, 0.0))
    first, second = itinerary.legs
    parts, begun = commanded(itinerary, first, first_begun(itinerary))
    assert parts[0].speed < SPEED, "from rest it overshoots"
    assert begun.learnt == pytest.approx(0.0, abs=1e-3)
    assert begun.place is not None
    assert np.linalg.norm(begun.place - first.waypoints[-1][:2]) == pytest.approx(10.44)
    (way,), _ = commanded(itinerary, second, begun)
    line = second.waypoints[1][:2] - begun.place
    turn = abs(math.remainder(math.atan2(line[1], line[0]) - begun.course, 2.0 * math.pi))
    longer = math.hypot(*line) + TURN * (turn - math.sin(turn))
    straight = np.linalg.norm(second.waypoints[1] - second.waypoints[0])
    assert way.speed == pytest.approx(SPEED * longer / straight, rel=1e-3)


def test_a_circle_is_gone_clockwise_at_the_speed_over_ground():
    """In still water it turns by speed * time / radius from where it comes through its place."""
    itinerary = in_current((0.0, 0.0, 0.0))
    leg = itinerary.legs[0]
    way = leg.waypoints[-1] - leg.waypoints[-2]
    course = math.atan2(way[1], way[0])
    for hold in (20.0, 55.0, 90.0):
        _, begun = commanded(itinerary, replace(leg, hold=hold), Begun())
        assert begun.place is not None
        off = begun.place - leg.waypoints[-1][:2]
        turned = math.atan2(off[1], off[0]) - course - 0.03
        assert math.cos(turned - SPEED * hold / 10.44) == pytest.approx(1.0, abs=1e-3)
        assert begun.course == pytest.approx(course + 0.03 + SPEED * hold / 10.44 + 0.5 * math.pi, abs=0.03)


def test_what_cannot_be_known_counts_in_the_mean():
    """After long tasks and at the surface the way on begins at the task's place, after half a turn or so."""
    itinerary = in_current((0.2, 0.1, 0.0))
    first, second = itinerary.legs
    _, begun = commanded(itinerary, replace(first, hold=2000.0), Begun())
    assert begun.place == pytest.approx(first.waypoints[-1][:2])
    assert math.isnan(begun.course)
    (mean,), _ = commanded(itinerary, second, replace(begun, learnt=0.0))
    (none,), _ = commanded(itinerary, second, Begun())
    length = np.linalg.norm(second.waypoints[1] - second.waypoints[0])
    planned = stretches(itinerary, second, along_hull=True)[0].speed
    angles = np.linspace(0.0, math.pi, 10_001)
    detour = TURN * float(np.trapezoid(angles - np.sin(angles), angles)) / math.pi
    assert mean.speed - none.speed == pytest.approx(planned * detour / length, rel=1e-3)


@pytest.mark.parametrize("done", range(7))
def test_a_plan_may_begin_at_every_waypoint(done):
    rest = Upload(in_current((0.2, 0.1, 0.0))).without(done).itinerary
    speeds = [float(part.text or "nan") for part in plan_specification(rest).iter("speed")]
    assert len(speeds) >= 3
    assert all(0.7 * SPEED < speed < 1.35 * 1.5 for speed in speeds)


def test_a_short_leg_is_not_caught_up_on_by_a_speed_that_may_not_be_had():
    itinerary = in_current((0.0, 0.0, 0.0))
    near = PlannedLeg.of(2, 1, 2, [[0.0, 0.0, 5.0], [12.0, 0.0, 5.0]], [0.0, 10.0])
    (part,), _ = commanded(itinerary, near, Begun(0.0, np.array([-10.0, 0.0]), math.pi))
    assert part.speed == pytest.approx(1.35 * SPEED)


def test_a_vehicle_without_a_bottom_lock_is_told_its_speed():
    itinerary = replace(in_current((0.3, 0.0, 0.0)), over_ground=False)
    for leg in itinerary.legs:
        parts, _ = commanded(itinerary, leg, Begun(0.3, np.zeros(2), 1.0))
        assert [part.speed for part in parts] == [SPEED]
