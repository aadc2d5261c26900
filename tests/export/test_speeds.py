"""Speeds by line and by leg: what is gone at them takes the planned times; what every file says of them."""

import csv
import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.export import FORMATS, ExportError, Itinerary, PlannedLeg, export, export_notes, itinerary_of
from auvplan.export.geojson import geojson_text
from auvplan.export.imc import Begun, commanded, first_begun, imc_text, plan_specification
from auvplan.export.qgroundcontrol import item_speeds, qgc_notes, qgc_plan, validate_plan
from auvplan.export.speeds import ALIKE, LEAST, led, stretches, track_notes
from auvplan.path.motion import Motion
from auvplan.site import Site
from tests.export.compare import written
from tests.export.sample import SITE, SPEED, SPEEDS, at_speeds, in_current
from tests.io import sample_run

OWN = [speed or SPEED for speed in SPEEDS]
streams = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)).map(lambda c: (*c, 0.0))


def by_qgc(itinerary):
    """By waypoint: the speed that it is gone to at, and s when it is reached and when it is left."""
    speed, now, place, found = np.nan, 0.0, itinerary.legs[0].waypoints[0], []
    plan = qgc_plan(itinerary)
    validate_plan(plan)
    for item in plan["mission"]["items"][:-1]:
        if item["command"] == 178:
            assert item["params"][0] == 1, "a speed over ground"
            speed = item["params"][1]
            continue
        hold, _, _, _, latitude, longitude, altitude = item["params"]
        there = np.array([*itinerary.site.to_local(longitude, latitude), -altitude])
        now += float(np.linalg.norm(there - place)) / speed
        found.append((speed, now))
        place, now = there, now + hold
    return np.array(found).T


def by_imc(itinerary):
    """Manoeuvres by name: m/s."""
    root = ElementTree.fromstring(imc_text(itinerary))
    assert {units.text for units in root.iter("speed_units")} == {"METERS_PS"}
    return {
        str(move.findtext("maneuver_id")): float(move.findtext("data/*/speed") or "nan")
        for move in root.iter("PlanManeuver")
    }


def test_through_the_water_every_leg_has_its_speed():
    itinerary = replace(at_speeds((0.2, -0.1, 0.0)), over_ground=False)
    assert by_qgc(itinerary)[0].tolist() == [OWN[0]] * 3 + [OWN[1]] + [OWN[2]] * 2
    changes = [item for item in qgc_plan(itinerary)["mission"]["items"] if item["command"] == 178]
    assert [item["params"][1] for item in changes] == OWN
    moves = {"start": OWN[0], "leg1": OWN[0], "task1": SPEED, "leg2": OWN[1], "leg3": OWN[2], "end": SPEED}
    assert by_imc(itinerary) == moves
    said = "the speed of each leg, 0.90 to 1.50 m/s, is through the water"
    assert said in qgc_plan(itinerary)["comment"]
    assert said in imc_text(itinerary).decode()
    notes = [note for note in export_notes(itinerary, ["qgc", "imc"]) if said in note]
    assert [note.split(":")[0] for note in notes] == [FORMATS["imc"].file, ".plan"]


@settings(deadline=None, max_examples=40)
@given(streams, st.tuples(*[st.floats(0.8, 2.0)] * 3))
def test_over_ground_the_planned_times_are_kept_at_any_speeds(stream, speeds):
    itinerary = at_speeds(stream, speeds)
    planned = np.concatenate([leg.kept_times[k > 0 :] for k, leg in enumerate(itinerary.legs)])
    assert by_qgc(itinerary)[1] == pytest.approx(planned, rel=ALIKE, abs=0.2)  # lines alike are gone at one
    for leg, speed in zip(itinerary.legs, speeds, strict=True):
        found, way = led(leg), np.diff(leg.waypoints, axis=0)
        assert np.isnan(found[0]).all(), "nothing leads to where a leg begins"
        along = way @ stream / np.linalg.norm(way, axis=1)
        across = np.maximum(np.dot(stream, stream) - along**2, 0.0)
        assert found[1:, 0] == pytest.approx(along + np.sqrt(speed**2 - across), rel=1e-9)
        # By the triangle of velocities, with the leg's own speed.
        made, hull = found[1:].T
        assert hull == pytest.approx((made**2 + speed**2 - np.dot(stream, stream)) / (2.0 * speed), rel=1e-9)


@pytest.mark.parametrize("stream", [(0.3, 0.0, 0.0), (-0.2, 0.25, 0.0)])
def test_a_vehicle_that_goes_by_its_items_keeps_the_times_of_a_leg_that_turns(stream):
    itinerary = in_current(stream)
    reached = by_qgc(itinerary)[1]
    planned = np.concatenate([itinerary.legs[0].kept_times, itinerary.legs[1].kept_times[1:]])
    assert reached == pytest.approx(planned, rel=0.01, abs=0.1)
    assert reached[5:] == pytest.approx(planned[5:], rel=1e-3)  # ends of the legs


def test_without_a_current_a_vehicle_is_told_the_speeds_of_its_legs():
    itinerary = at_speeds((0.0, 0.0, 0.0))
    assert by_qgc(itinerary)[0] == pytest.approx([OWN[0]] * 3 + [OWN[1]] + [OWN[2]] * 2)
    for leg, speed in zip(itinerary.legs, OWN, strict=True):
        told, begun = commanded(itinerary, leg, Begun())
        assert [part.speed for part in told] == pytest.approx([speed])
        assert begun.learnt == pytest.approx(0.0, abs=0.06)  # on its circle it is at the vehicle's speed


@pytest.mark.parametrize("current", [0.3, -0.3])
def test_what_was_learnt_of_a_current_holds_at_another_speed(current):
    """A leg on in the same direction, slower or faster, takes no more correction."""
    itinerary = at_speeds((0.0, current, 0.0), (1.0, 0.9, 1.6))
    leg = itinerary.legs[2]
    east = replace(leg, positions=leg.positions[1:], times=leg.times[1:], kept=np.array([0, 1]),
                   kept_times=leg.kept_times[1:], motion=leg.motion[1:])  # fmt: skip
    for speed in (0.9, 1.6):
        seconds = 300.0 / (speed + current)
        on = replace(east, speed=speed, kept_times=np.array([0.0, seconds]))
        (made,) = stretches(itinerary, on, along_hull=True)
        (told,), begun = commanded(itinerary, on, Begun(current))
        assert made.speed == pytest.approx(speed + current, rel=1e-3)
        assert told.speed == pytest.approx(made.speed, rel=1e-3)
        assert begun.learnt == pytest.approx(current, abs=2e-3)


def test_tables_have_the_speed_of_each_leg(tmp_path):
    itinerary = at_speeds((0.2, -0.1, 0.0))
    with written(itinerary, tmp_path, "csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["speed"]) for row in rows] == [OWN[int(row["leg"]) - 1] for row in rows]
    plans = [
        feature["properties"]
        for feature in json.loads(geojson_text(itinerary))["features"]
        if feature["properties"]["kind"] == "plan"
    ]
    assert [plan.get("speed_m_s") for plan in plans] == list(SPEEDS)
    for leg, plan, speed in zip(itinerary.legs, plans, OWN, strict=True):
        slowest = min(np.linalg.norm(leg.motion.ground_velocity[:-1], axis=1)) / speed
        assert plan["ground_speed_share"] == pytest.approx(slowest, abs=1e-3)
    data = xr.load_dataset(written(itinerary, tmp_path, "netcdf"), engine="h5netcdf", decode_times=False)
    assert data["leg_speed"].values == pytest.approx(OWN)
    assert data["leg_speed"].attrs["units"] == "m s-1"
    for name in ("kml", "gpx"):
        text = written(itinerary, tmp_path, name).read_text(encoding="utf-8")
        assert "at 0.90 m/s through the water" in text
        assert "at 1.50 m/s through the water" in text


def test_a_file_that_has_no_speeds_says_so():
    itinerary = at_speeds((0.0, 0.0, 0.0))
    notes = export_notes(itinerary)
    found = [note.split(":")[0] for note in notes if "has the speeds of legs, 0.90 to 1.50 m/s" in note]
    assert found == [FORMATS[name].file for name in ("kml", "gpx", "ros")]
    common = at_speeds((0.0, 0.0, 0.0), (None,) * 3)
    assert not any("speeds of legs" in note for note in export_notes(common))


def test_without_speeds_of_their_own_files_are_as_if_there_were_none(tmp_path):
    """Those of legs that have the vehicle's speed for their own differ in nothing that a vehicle reads."""
    common, stated = (at_speeds((0.2, 0.1, 0.0), (own,) * 3) for own in (None, SPEED))
    for name in ("qgc", "imc", "gpx", "kml", "csv", "geojson"):
        (path,) = export(common, tmp_path, [name])
        text = path.read_text(encoding="utf-8")
        assert "m/s through the water" not in text, name
        assert "speed_m_s" not in text, name
    assert qgc_plan(common)["mission"] == qgc_plan(stated)["mission"]
    assert by_imc(common) == by_imc(stated)
    data = xr.load_dataset(written(common, tmp_path, "netcdf"), engine="h5netcdf", decode_times=False)
    assert "leg_speed" not in data


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf")])
def test_a_speed_that_is_none_is_refused(speed):
    itinerary = at_speeds((0.0, 0.0, 0.0))
    legs = (*itinerary.legs[:2], replace(itinerary.legs[2], speed=speed))
    with pytest.raises(ExportError, match=r"leg 3's speed must be positive, got"):
        replace(itinerary, legs=legs)


def test_what_a_vehicle_cannot_follow_goes_by_the_legs_speed():
    leg = at_speeds((0.0, 0.0, 0.0)).legs[2]  # a corner of 45 degrees between lines of 300 m and more
    assert track_notes([leg], SPEED, 0.005) == track_notes([replace(leg, speed=0.4)], SPEED, 0.005) == []
    (sharp,) = track_notes([replace(leg, speed=3.0)], SPEED, 0.005)
    assert "leg 3 turns too sharply for 600 m at waypoint 1" in sharp
    (slow,) = track_notes([replace(leg, speed=4.0)], SPEED, 1.0)
    assert "makes 37 % of its speed over ground" in slow or "makes 38 %" in slow


@pytest.mark.parametrize(("lasts", "steep"), [(110.0, ""), (70.0, "46 degrees, 1.1 m/s, after waypoint 0")])
def test_a_dive_is_as_steep_as_it_is_through_the_water(lasts, steep):
    """Against a current a line over ground of 37 degrees is a dive of 27; with one, one of 46."""
    leg = PlannedLeg.of(1, 0, 1, np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 75.0]]), [0.0, lasts])
    notes = track_notes([leg], 1.5, 1.0, slow=0.0, pitch_max=np.radians(30.0))
    assert len(notes) == bool(steep)
    assert all(steep in note for note in notes)


def test_a_run_is_exported_at_the_speeds_of_its_legs():
    speeds = (2.0, None, 3.0)
    run = sample_run.at_speeds(sample_run.make_run(), speeds)
    itinerary = itinerary_of(run, Site(148.96, -20.34))
    assert [leg.speed for leg in itinerary.legs] == list(speeds)
    for leg, record, speed in zip(itinerary.legs, run.done, speeds, strict=True):
        assert abs(leg.time_change) < 0.02
        seconds = leg.kept_times[-1] - leg.kept_times[0]
        assert seconds == pytest.approx(record.plans[0].travel_time, rel=0.02)
        length = np.linalg.norm(np.diff(leg.waypoints, axis=0), axis=1).sum()
        assert length / seconds == pytest.approx(speed or 2.5, rel=0.02)


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
