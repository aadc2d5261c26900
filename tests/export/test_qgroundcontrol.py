"""QGroundControl's plans: fields as documented, places, fences, depth and its pitfalls."""

import copy
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from auvplan.export import ExportError, Itinerary, export_notes, validate_plan
from auvplan.export.qgroundcontrol import qgc_notes, qgc_plan, qgc_text
from tests.export.compare import written
from tests.export.sample import make_itinerary


@pytest.fixture
def itinerary() -> Itinerary:
    return make_itinerary()


@pytest.fixture
def plan(itinerary: Itinerary) -> dict:
    return json.loads(qgc_text(itinerary))


def shallow(itinerary: Itinerary, depth: float) -> Itinerary:
    leg = itinerary.legs[1]
    places = leg.positions.copy()
    places[-1, 2] = depth
    return replace(itinerary, legs=(itinerary.legs[0], replace(leg, positions=places)))


def test_items_are_a_speed_and_the_waypoints(itinerary: Itinerary, plan: dict):
    validate_plan(plan)
    mission = plan["mission"]
    assert (mission["firmwareType"], mission["vehicleType"]) == (3, 12)
    speed, *items, end = mission["items"]
    assert speed["command"] == 178
    assert speed["params"][:3] == [1, 1.75, -1]
    assert [item["doJumpId"] for item in mission["items"]] == [1, 2, 3, 4, 5, 6, 7]
    assert (end["command"], end["params"]) == (21, [0, 0, 0, None, *items[-1]["params"][4:6], 0.0])
    expected = np.concatenate([itinerary.legs[0].waypoints, itinerary.legs[1].waypoints[1:]])
    for item, place in zip(items, expected, strict=True):
        hold, accept, passing, yaw, latitude, longitude, altitude = item["params"]
        north, east = itinerary.site.to_local(longitude, latitude)
        assert [north, east, -altitude] == pytest.approx(place, abs=0.1)
        assert (item["command"], item["frame"], accept, passing, yaw) == (16, 3, 5.0, 0, None)
        assert (item["Altitude"], item["AltitudeMode"]) == (altitude, 1)
        assert isinstance(hold, int)
    assert [item["params"][0] for item in items] == [0, 0, 0, 46, 0]
    assert mission["plannedHomePosition"] == [*items[0]["params"][4:6], 0.0]
    assert "6 of 18 samples kept" in plan["comment"]


@pytest.mark.parametrize("end", ["station", "loiter"])
def test_a_vehicle_may_stay_at_depth_at_the_end(itinerary: Itinerary, end: str):
    there = replace(itinerary, end=end)
    validate_plan(plan := qgc_plan(there))
    *_, last, stay = plan["mission"]["items"]
    assert stay["command"] == 17
    assert stay["params"][4:] == last["params"][4:]
    assert ("loiters on the spot" in " ".join(qgc_notes(there))) == (end == "loiter")


def test_fences_exclude_and_run_clockwise(itinerary: Itinerary, plan: dict):
    fences = plan["geoFence"]
    first, second, circle = itinerary.fences
    for found, fence in zip(fences["polygons"], (first, second), strict=True):
        assert found["inclusion"] is False
        latitude, longitude = np.asarray(found["polygon"]).T
        north, east = itinerary.site.to_local(longitude, latitude)
        # Corners may begin elsewhere and run the other way round.
        ring = shapely.LinearRing(np.stack([east, north], axis=1))
        assert not shapely.is_ccw(ring)
        corners = np.sort(fence.corners.astype(complex) @ [1, 1j])  # type: ignore[union-attr]
        assert np.sort(north + 1j * east) == pytest.approx(corners, abs=0.1)
    (found,) = fences["circles"]
    latitude, longitude = found["circle"]["center"]
    assert itinerary.site.to_local(longitude, latitude) == pytest.approx(circle.centre, abs=0.1)  # type: ignore[union-attr]
    assert (found["circle"]["radius"], found["inclusion"]) == (85.0, False)


def test_a_waypoint_above_the_surface_is_refused(itinerary: Itinerary, tmp_path: Path):
    with pytest.raises(ExportError, match=r"mooring <7> \(leg 2\) lies 0.5 m above the surface"):
        written(shallow(itinerary, -0.5), tmp_path, "qgc")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("depth", [0.0, -0.0, -4e-4, 6e-4])
def test_the_surface_is_altitude_zero_and_warned_of(itinerary: Itinerary, depth: float):
    there = shallow(itinerary, depth)
    altitude = qgc_plan(there)["mission"]["items"][-2]["params"][6]
    assert str(altitude) == "0.0"
    (note,) = [note for note in export_notes(there, ["qgc"]) if "altitude 0" in note]
    assert "1 waypoints" in note
    assert "mooring <7>" in note
    assert not [note for note in export_notes(itinerary, ["qgc"]) if "altitude 0" in note]


def test_too_long_a_task_is_refused(itinerary: Itinerary):
    leg = replace(itinerary.legs[0], hold=65_535.5)
    with pytest.raises(ExportError, match=r"the task at wreck & reef \(leg 1\) takes 65536 s"):
        qgc_plan(replace(itinerary, legs=(leg,)))


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (("fileType",), "Mission", r"plan\.fileType"),
        (("mission", "vehicleType"), None, r"mission\.vehicleType"),
        (("mission", "items"), [], r"mission\.items"),
        (("mission", "items", 2, "doJumpId"), 1, r"mission\.items\[2\]\.doJumpId"),
        (("mission", "items", 3, "params"), [0] * 6, r"mission\.items\[3\]\.params"),
        (("mission", "items", 3, "Altitude"), 1.0, r"mission\.items\[3\]\.Altitude"),
        (("mission", "plannedHomePosition"), [100.0, 0.0, 0.0], r"mission\.plannedHomePosition"),
        (("geoFence", "circles", 0, "circle", "radius"), -1.0, r"geoFence\.circles\[0\]\.circle"),
        (("geoFence", "polygons", 1, "polygon"), [[0.0, 0.0]] * 2, r"geoFence\.polygons\[1\]\.polygon"),
        (("geoFence", "polygons", 0, "inclusion"), 0, r"geoFence\.polygons\[0\]\.inclusion"),
        (("rallyPoints", "version"), 1, r"rallyPoints\.version"),
    ],
)
def test_validation_names_the_field_at_fault(plan: dict, where: tuple, value, message: str):
    broken = copy.deepcopy(plan)
    *path, last = where
    part = broken
    for key in path:
        part = part[key]
    part[last] = value
    with pytest.raises(ExportError, match=message):
        validate_plan(broken)
    del part[last]
    with pytest.raises(ExportError):
        validate_plan(broken)
