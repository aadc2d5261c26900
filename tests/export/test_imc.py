"""IMC plans: messages and fields as IMC 5.4 names them, places in radians, offsets to true north, limits."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from pyproj import Geod

from auvplan.export import ExportError, Itinerary
from tests.export.compare import near, written
from tests.export.sample import EPOCH, make_itinerary


def test_imc(itinerary: Itinerary, tmp_path: Path):
    root = ElementTree.parse(written(itinerary, tmp_path, "imc")).getroot()
    assert (root.tag, root.get("imcv")) == ("PlanSpecification", "5.4.11")
    assert root.findtext("plan_id") == "reef_day_2"
    said = "; the speed is through the water"
    assert root.findtext("description") == itinerary.description + said
    departure = 0.0 if itinerary.site.epoch is None else EPOCH.timestamp() + 60.0
    assert float(root.get("time") or "nan") == pytest.approx(departure, abs=1e-3)
    steps = root.findall("maneuvers/PlanManeuver")
    names = [step.findtext("maneuver_id") for step in steps]
    assert names == ["start", "leg1", "task1", "leg2", "end"]
    assert root.findtext("start_man_id") == "start"
    moves = [tuple(move.findtext(field) for field in ("source_man", "dest_man", "conditions"))
             for move in root.findall("transitions/PlanTransition")]  # fmt: skip
    assert moves == [(a, b, "ManeuverIsDone") for a, b in pairwise(names)]
    start, path, task, last, end = (step.find("data")[0] for step in steps)  # type: ignore[index]
    assert [part.tag for part in (start, path, task, last)] == ["Goto", "FollowPath", "Loiter", "Goto"]
    first, second = itinerary.legs
    places = [imc_place(part) for part in (start, path, task, last)]
    corners = [first.waypoints[0], first.waypoints[0], first.waypoints[-1], second.waypoints[-1]]
    near(itinerary, places, np.stack(corners))
    for part in (start, path, task, last):
        assert (part.findtext("z_units"), part.findtext("speed_units")) == ("DEPTH", "METERS_PS")
        assert float(part.findtext("speed") or 0) == 1.75
        assert 0 < int(part.findtext("timeout") or 0) <= 65_535
    assert task.findtext("duration") == "46"
    assert (end.tag, end.findtext("z"), end.findtext("duration")) == ("StationKeeping", "0.0000", "0")
    assert imc_place(end)[:2] == pytest.approx(imc_place(last)[:2])
    offsets = np.array(
        [
            [float(point.findtext(axis) or "nan") for axis in "xyz"]
            for point in path.findall("points/PathPoint")
        ]
    )
    # True north at the start, not the local frame's: by the geodesic, as the vehicle will take it.
    longitude, latitude, depth = places[1]
    azimuth = np.degrees(np.arctan2(offsets[:, 1], offsets[:, 0]))
    ones = np.ones(len(offsets))
    east, north, _ = Geod(ellps="WGS84").fwd(
        longitude * ones, latitude * ones, azimuth, np.hypot(*offsets.T[:2])
    )
    near(itinerary, np.column_stack([east, north, depth + offsets[:, 2]]), first.waypoints)


def imc_place(part: ElementTree.Element) -> list[float]:
    longitude, latitude, depth = (float(part.findtext(name) or "nan") for name in ("lon", "lat", "z"))
    return [math.degrees(longitude), math.degrees(latitude), depth]


def test_a_task_at_the_surface_keeps_station(tmp_path: Path):
    itinerary = make_itinerary()
    leg = itinerary.legs[0]
    places = leg.positions * np.array([1.0, 1.0, 0.0])
    path = written(replace(itinerary, legs=(replace(leg, positions=places),)), tmp_path, "imc")
    task = ElementTree.parse(path).getroot().find("maneuvers/PlanManeuver[3]/data/StationKeeping")
    assert task is not None
    assert (task.findtext("duration"), task.findtext("z")) == ("46", "0.0000")


@pytest.mark.parametrize("behaviour", ["station", "loiter"])
def test_a_vehicle_may_stay_at_depth_at_the_end(tmp_path: Path, itinerary: Itinerary, behaviour: str):
    root = ElementTree.parse(written(replace(itinerary, end=behaviour), tmp_path, "imc")).getroot()
    last, end = list(root.iter("PlanManeuver"))[-2:]
    stay = end.find("data/Loiter")
    assert stay is not None
    assert stay.findtext("duration") == "0"
    assert stay.findtext("z") == last.findtext("data/*/z")


def test_a_wait_alone_is_called_a_wait(tmp_path: Path):
    itinerary = make_itinerary()
    first, *rest = itinerary.legs
    for given, name in (
        ({"wait": first.hold, "priority": 0.0}, "wait1"),
        ({"onward": first.hold, "priority": 0.0}, "wait1"),
        ({"onward": first.hold / 2.0, "priority": 0.0}, "task1"),
        ({"wait": first.hold, "priority": 3.0}, "task1"),
    ):
        some = replace(itinerary, legs=(replace(first, **given), *rest))
        root = ElementTree.parse(written(some, tmp_path, "imc")).getroot()
        names = [step.findtext("maneuver_id") for step in root.iter("PlanManeuver")]
        assert names == ["start", "leg1", name, "leg2", "end"]
    alone = replace(first, hold=70_000.0, wait=70_000.0, priority=0.0)
    for kind, words in (("imc", "IMC plan: the wait of leg 1"), ("qgc", ".plan: the wait at")):
        with pytest.raises(ExportError, match=f"{words}.* takes 70000 s"):
            written(replace(itinerary, legs=(alone, *rest)), tmp_path, kind)


def test_too_long_a_leg_or_task_is_refused(tmp_path: Path):
    itinerary = make_itinerary()
    leg = itinerary.legs[0]
    with pytest.raises(ExportError, match="IMC plan: the task of leg 1 takes 70000 s"):
        written(replace(itinerary, legs=(replace(leg, hold=70_000.0),)), tmp_path, "imc")
    slow = replace(leg, kept_times=leg.kept_times * 1000.0)
    with pytest.raises(ExportError, match="IMC plan: leg 1 takes"):
        written(replace(itinerary, legs=(slow,)), tmp_path, "imc")
    assert not list(tmp_path.iterdir())
