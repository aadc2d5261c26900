"""Speeds by line: what is gone at them takes the planned times, at the planned speed through the water."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.export import Itinerary, PlannedLeg
from auvplan.export.imc import commanded, first_begun, plan_specification
from auvplan.export.qgroundcontrol import item_speeds, qgc_notes, qgc_plan, validate_plan
from auvplan.export.speeds import LEAST, led, stretches
from auvplan.path.motion import Motion
from tests.export.sample import CORNERS, SITE, SPEED, in_current

streams = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)).map(lambda c: (*c, 0.0))


@settings(deadline=None)
@given(streams)
def test_lines_make_the_closed_form_over_ground_and_along_the_hull(stream):
    leg = in_current(stream).legs[0]
    way = np.diff(leg.waypoints, axis=0)
    tangent = way / np.linalg.norm(way, axis=1, keepdims=True)
    along = tangent @ stream
    across = np.sqrt(np.maximum(np.dot(stream, stream) - along**2, 0.0))
    over_ground = along + np.sqrt(SPEED**2 - across**2)
    found = led(leg)
    assert np.isnan(found[0]).all(), "nothing leads to where a leg begins"
    assert found[1:, 0] == pytest.approx(over_ground, rel=1e-9)
    # By the triangle of velocities: u = (g^2 + v^2 - c^2) / (2 v).
    surge = (over_ground**2 + SPEED**2 - np.dot(stream, stream)) / (2.0 * SPEED)
    assert found[1:, 1] == pytest.approx(surge, rel=1e-9)


@settings(deadline=None)
@given(streams)
def test_stretches_take_the_planned_time_and_are_as_many_as_pay(stream):
    itinerary = in_current(stream)
    for leg in itinerary.legs:
        parts = stretches(itinerary, leg)
        assert [part.first for part in parts] == [0, *(part.last for part in parts[:-1])]
        assert parts[-1].last == len(leg.kept) - 1
        lengths = np.linalg.norm(np.diff(leg.waypoints, axis=0), axis=1)
        made = led(leg)[1:, 0]
        for part in parts:
            seconds = leg.kept_times[part.last] - leg.kept_times[part.first]
            assert lengths[part.first : part.last].sum() / part.speed == pytest.approx(seconds)
            assert (np.abs(made[part.first : part.last] / part.speed - 1.0) <= 0.05 + 1e-9).all()


def test_without_a_current_there_is_one_speed():
    itinerary = in_current((0.0, 0.0, 0.0))
    assert [part.speed for part in stretches(itinerary, itinerary.legs[0])] == pytest.approx([SPEED])
    assert item_speeds(itinerary) == pytest.approx([SPEED] * 7)
    assert [item["command"] for item in qgc_plan(itinerary)["mission"]["items"]] == [178, *[16] * 7, 21]


def test_what_was_planned_without_attitude_counts_as_along_the_hull():
    itinerary = in_current((0.3, 0.1, 0.0))
    leg = itinerary.legs[0]
    bare = replace(leg, motion=Motion.none(len(leg.positions)))
    assert led(bare)[1:, 1] == pytest.approx(led(leg)[1:, 0])


def test_a_line_that_stands_still_is_asked_for_the_least():
    leg = PlannedLeg.of(1, 0, 1, [[0, 0, 5], [10, 0, 5]], [0.0, 1000.0])
    itinerary = Itinerary("slow", SITE, SPEED, (leg,))
    assert [part.speed for part in stretches(itinerary, leg)] == [LEAST]


@pytest.mark.parametrize("stream", [(0.3, 0.0, 0.0), (-0.2, 0.25, 0.0)])
def test_a_vehicle_that_goes_by_its_items_keeps_the_planned_times(stream):
    itinerary = in_current(stream)
    plan = qgc_plan(itinerary)
    validate_plan(plan)
    speed, now, place, reached = np.nan, 0.0, CORNERS[0], []
    for item in plan["mission"]["items"][:-1]:
        if item["command"] == 178:
            assert item["params"][0] == 1, "a speed over ground"
            speed = item["params"][1]
            continue
        hold, _, _, _, latitude, longitude, altitude = item["params"]
        there = np.array([*itinerary.site.to_local(longitude, latitude), -altitude])
        now += float(np.linalg.norm(there - place)) / speed
        reached.append(now)
        place, now = there, now + hold
    planned = [*itinerary.legs[0].kept_times, *itinerary.legs[1].kept_times[1:]]
    assert reached == pytest.approx(planned, rel=0.01, abs=0.1)
    for end in (5, 6):  # of the legs
        assert reached[end] == pytest.approx(planned[end], rel=1e-3)


@pytest.mark.parametrize("stream", [(0.3, 0.0, 0.0), (-0.2, 0.25, 0.0)])
def test_imc_has_a_manoeuvre_for_each_speed_named_by_what_is_left(stream):
    itinerary = in_current(stream)
    parts = stretches(itinerary, itinerary.legs[0], along_hull=True)
    assert len(parts) > 1
    root = plan_specification(itinerary)
    moves = {move.findtext("maneuver_id"): move.find("data")[0] for move in root.iter("PlanManeuver")}  # type: ignore[index]
    names = [f"leg1_last{5 - part.first}" if part.first else "leg1" for part in parts]
    assert list(moves) == ["start", *names, "task1", "leg2", "end"]
    told, _ = commanded(itinerary, itinerary.legs[0], first_begun(itinerary))
    for name, part in zip(names, told, strict=True):
        assert float(moves[name].findtext("speed") or 0) == pytest.approx(part.speed, abs=1e-4)
        points = moves[name].findall("points/PathPoint")
        assert len(points) == (part.last - part.first + 1 if part.last - part.first > 1 else 0)
    assert float(moves["task1"].findtext("speed") or 0) == SPEED


def test_files_say_what_their_speeds_are():
    over_ground = in_current((0.3, 0.0, 0.0))
    through_water = replace(over_ground, over_ground=False)
    for itinerary, words in ((over_ground, "speeds are over ground"), (through_water, "through the water")):
        assert words in qgc_plan(itinerary)["comment"]
        assert words in (plan_specification(itinerary).findtext("description") or "")
        assert words in " ".join(qgc_notes(itinerary))
    items = qgc_plan(through_water)["mission"]["items"]
    assert [item["params"][1] for item in items if item["command"] == 178] == [SPEED]
