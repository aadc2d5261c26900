"""Every format is parsed back and compared with the itinerary: places within 0.1 m, times, notes, errors."""

import csv
import importlib.util
import json
import math
from dataclasses import replace
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import xarray as xr
from pyproj import Geod

from auvplan.export import Itinerary, Track
from auvplan.records import TurnBack
from tests.export.compare import azimuth, kept, kept_seconds, near, same_times, written
from tests.export.sample import EPOCH, SITE, make_itinerary

KML, GX = "{http://www.opengis.net/kml/2.2}", "{http://www.google.com/kml/ext/2.2}"
GPX = "{http://www.topografix.com/GPX/1/1}"


def numbers(text: str, comma: str) -> list[list[float]]:
    rows = [
        [float(value) for value in row.split(comma)] for row in text.split(None if comma == "," else "\n")
    ]
    return [[x, y, -z] for x, y, z in rows]


def test_geojson(itinerary: Itinerary, tmp_path: Path):
    data = json.loads(written(itinerary, tmp_path, "geojson").read_text(encoding="utf-8"))
    assert data["type"] == "FeatureCollection"
    assert "crs" not in data
    assert data["description"] == itinerary.description
    kinds = {kind: [f for f in data["features"] if f["properties"]["kind"] == kind]
             for kind in ("plan", "waypoint", "executed", "exclusion")}  # fmt: skip
    tracks = [Track(leg.times, leg.positions) for leg in itinerary.legs]
    for features, expected in ((kinds["plan"], tracks), (kinds["executed"], itinerary.executed)):
        for feature, track in zip(features, expected, strict=True):
            near(itinerary, joined(feature["geometry"]), track.positions)
            own, about = uncut(feature["geometry"]), feature["properties"]
            seconds = [time for time, whole in zip(about["seconds"], own, strict=True) if whole]
            assert seconds == pytest.approx(track.times)
            days = (
                [time for time, whole in zip(about["times"], own, strict=True) if whole]
                if about["times"]
                else []
            )
            same_times(itinerary, days, track.times)
    assert [f["properties"]["note"] for f in kinds["plan"]] == [leg.note for leg in itinerary.legs]
    places = [f["geometry"]["coordinates"] for f in kinds["waypoint"]]
    near(itinerary, [[x, y, -z] for x, y, z in places], kept(itinerary))
    about = [f["properties"] for f in kinds["waypoint"]]
    assert [row["hold_s"] for row in about] == [0.0, 0.0, 0.0, 45.5, 0.0]
    assert [row["name"] for row in about] == [
        *("harbour", "leg 1, 1", "leg 1, 2", "wreck & reef", "mooring <7>")
    ]
    same_times(itinerary, [row["time"] or "" for row in about], kept_seconds(itinerary))
    assert len(kinds["exclusion"]) == 3
    for feature, fence in zip(kinds["exclusion"], itinerary.fences, strict=True):
        area(itinerary, feature["geometry"], fence)


def test_ways_home_are_lines_of_geojson(itinerary: Itinerary, tmp_path: Path):
    way = itinerary.legs[1].positions[:2]
    turn = TurnBack(0, 300.0, 0.1, 45.0, tuple(map(tuple, way.tolist())))
    data = json.loads(written(replace(itinerary, turns=(turn,)), tmp_path, "geojson").read_text("utf-8"))
    (found,) = [one for one in data["features"] if one["properties"]["kind"] == "turn back"]
    near(itinerary, joined(found["geometry"]), way)
    about = found["properties"]
    assert about["from"] == itinerary.legs[0].goal_name
    assert (about["leg"], about["leave_later_than_s"], about["takes_s"]) == (1, 300.0, 45.0)


def joined(geometry: dict) -> list[list[float]]:
    """Longitude, latitude, depth of a line without the points where it was cut."""
    if geometry["type"] == "LineString":
        assert len(geometry["coordinates"]) > 1
        return [[x, y, -z] for x, y, z in geometry["coordinates"]]
    parts = geometry["coordinates"]
    assert len(parts) > 1
    for before, after in pairwise(parts):
        assert abs(before[-1][0]) == 180.0
        assert after[0] == [-before[-1][0], *before[-1][1:]]
    for part in parts:
        assert len({x > 0 for x, _, _ in part}) == 1  # each on one side
    return [[x, y, -z] for part in parts for x, y, z in part if abs(x) != 180.0]


def uncut(geometry: dict) -> list[bool]:
    """Whether each vertex of a line, part after part, is one of its own and none where it was cut."""
    if geometry["type"] == "LineString":
        return [True] * len(geometry["coordinates"])
    return [abs(x) != 180.0 for part in geometry["coordinates"] for x, _, _ in part]


def area(itinerary: Itinerary, geometry: dict, fence) -> None:
    """Rings are closed and counter-clockwise, lie in one world, and have the fence's area together."""
    rings = [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]
    size = 0.0
    for (ring,) in rings:
        assert ring[0] == ring[-1]
        assert shapely.is_ccw(shapely.LinearRing(ring))
        places = np.asarray(ring)
        assert np.ptp(places[:, 0]) < 1.0
        size += Geod(ellps="WGS84").polygon_area_perimeter(places[:, 0], places[:, 1])[0]
    if hasattr(fence, "radius"):
        circle = math.pi * fence.radius**2
        assert circle < size < 1.003 * circle
    else:
        assert size == pytest.approx(shapely.Polygon(fence.corners).area, rel=2e-3)


def test_lines_and_areas_are_cut_at_the_antimeridian(tmp_path: Path):
    data = json.loads(written(make_itinerary(), tmp_path, "geojson").read_text(encoding="utf-8"))
    types = [f["geometry"]["type"] for f in data["features"] if f["properties"]["kind"] != "waypoint"]
    assert types.count("MultiLineString") == 2
    assert types.count("MultiPolygon") == 1


def test_lines_cut_at_the_antimeridian_have_a_time_for_each_vertex(tmp_path: Path):
    """Where a line is cut, both ends have the time at which a vehicle of steady speed is there."""
    data = json.loads(written(make_itinerary(), tmp_path, "geojson").read_text(encoding="utf-8"))
    cut = [f for f in data["features"] if f["geometry"]["type"] == "MultiLineString"]
    assert cut
    for feature in cut:
        places = [place for part in feature["geometry"]["coordinates"] for place in part]
        seconds, days = feature["properties"]["seconds"], feature["properties"]["times"]
        assert len(places) == len(seconds) == len(days)
        east, depth = np.array(places)[:, 0] % 360.0, np.array(places)[:, 2]
        (before,) = np.flatnonzero(np.diff(seconds) == 0.0)
        assert set(east[[before, before + 1]]) == {180.0}
        assert days[before] == days[before + 1]
        for axis in (east, depth):
            there = np.interp(seconds[before], *np.array([seconds, axis])[:, [before - 1, before + 2]])
            assert there == pytest.approx(axis[before], abs=1e-3)
        assert (np.diff(seconds) >= 0.0).all()


def test_kml(itinerary: Itinerary, tmp_path: Path):
    root = ElementTree.parse(written(itinerary, tmp_path, "kml")).getroot()
    document = root.find(f"{KML}Document")
    assert document is not None
    assert document.findtext(f"{KML}description") == itinerary.description
    folders = {folder.findtext(f"{KML}name"): folder for folder in document.findall(f"{KML}Folder")}
    tracks = [Track(leg.times, leg.positions) for leg in itinerary.legs]
    for name, expected in (("plan", tracks), ("executed", itinerary.executed)):
        for mark, track in zip(folders[name].findall(f"{KML}Placemark"), expected, strict=True):
            if itinerary.site.epoch is None:
                (line,) = mark.findall(f"{KML}LineString")
                places = numbers(line.findtext(f"{KML}coordinates") or "", ",")
            else:
                (line,) = mark.findall(f"{GX}Track")
                places = [numbers(coord.text or "", " ")[0] for coord in line.findall(f"{GX}coord")]
                same_times(itinerary, [when.text for when in line.findall(f"{KML}when")], track.times)
            assert line.findtext(f"{KML}altitudeMode") == "absolute"
            near(itinerary, places, track.positions)
    marks = folders["waypoints"].findall(f"{KML}Placemark")
    found = [numbers(mark.findtext(f"{KML}Point/{KML}coordinates") or "", ",")[0] for mark in marks]
    near(itinerary, found, kept(itinerary))
    found = [mark.findtext(f"{KML}TimeStamp/{KML}when") or "" for mark in marks]
    same_times(itinerary, found, kept_seconds(itinerary))
    assert marks[3].findtext(f"{KML}name") == "wreck & reef"
    marks = folders["fences"].findall(f"{KML}Placemark")
    for mark, fence in zip(marks, itinerary.fences, strict=True):
        rings = [
            numbers(ring.text or "", ",")
            for ring in mark.iterfind(
                f".//{KML}Polygon/{KML}outerBoundaryIs/{KML}LinearRing/{KML}coordinates"
            )
        ]
        assert all(height == 0.0 for ring in rings for *_, height in ring)
        flat = [[[place[:2] for place in ring]] for ring in rings]
        one = {"type": "Polygon", "coordinates": flat[0]}
        area(itinerary, one if len(flat) == 1 else {"type": "MultiPolygon", "coordinates": flat}, fence)
        assert (mark.find(f"{KML}MultiGeometry") is not None) == (len(flat) > 1)


@pytest.mark.parametrize("epoch", [EPOCH, None])
def test_kml_is_valid_by_the_schema_with_googles_extensions(epoch: datetime | None, tmp_path: Path):
    lxml = pytest.importorskip("lxml.etree", reason="needs lxml")
    package = importlib.util.find_spec("fastkml")
    if package is None or package.origin is None:
        pytest.skip("needs fastkml, which ships the schemas of KML")
    schema = lxml.XMLSchema(lxml.parse(str(Path(package.origin).parent / "schema" / "kml22gx.xsd")))
    path = written(make_itinerary(replace(SITE, epoch=epoch)), tmp_path, "kml")
    schema.assertValid(lxml.parse(str(path)))


def test_gpx(itinerary: Itinerary, tmp_path: Path):
    root = ElementTree.parse(written(itinerary, tmp_path, "gpx")).getroot()
    assert root.tag == f"{GPX}gpx"
    assert root.get("version") == "1.1"
    assert root.findtext(f"{GPX}metadata/{GPX}desc") == itinerary.description
    (route,) = root.findall(f"{GPX}rte")
    rows = route.findall(f"{GPX}rtept")
    near(itinerary, [gpx_place(row) for row in rows], kept(itinerary))
    assert [row.findtext(f"{GPX}name") for row in rows][::4] == ["harbour", "mooring <7>"]
    same_times(itinerary, [row.findtext(f"{GPX}time") or "" for row in rows], kept_seconds(itinerary))
    assert all(leg.note in (route.findtext(f"{GPX}desc") or "") for leg in itinerary.legs)
    for segment, track in zip(root.findall(f"{GPX}trk/{GPX}trkseg"), itinerary.executed, strict=True):
        near(itinerary, [gpx_place(point) for point in segment], track.positions)
        same_times(itinerary, [point.findtext(f"{GPX}time") or "" for point in segment], track.times)
    order = ("ele", "time", "name", "desc")
    for point in [*rows, *root.iter(f"{GPX}trkpt")]:
        tags = [element.tag.removeprefix(GPX) for element in point]
        assert tags == sorted(tags, key=order.index)
    assert [element.tag.removeprefix(GPX) for element in root] == ["metadata", "rte", "trk"]


def gpx_place(point: ElementTree.Element) -> list[float]:
    longitude, latitude = float(point.get("lon") or "nan"), float(point.get("lat") or "nan")
    assert -180.0 <= longitude < 180.0
    return [longitude, latitude, -float(point.findtext(f"{GPX}ele") or "nan")]


def test_csv(itinerary: Itinerary, tmp_path: Path):
    with written(itinerary, tmp_path, "csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    near(itinerary, [[row["lon"], row["lat"], row["depth"]] for row in rows], kept(itinerary))
    local = np.array([[row["north"], row["east"], row["depth"]] for row in rows], float)
    assert local == pytest.approx(kept(itinerary), abs=1e-3)
    same_times(itinerary, [row["time"] for row in rows], kept_seconds(itinerary))
    assert [row["seq"] for row in rows] == ["1", "2", "3", "4", "5"]
    assert [row["leg"] for row in rows] == ["1", "1", "1", "1", "2"]
    assert [(row["hold"], row["task"]) for row in rows if float(row["hold"])] == [("45.5", "3")]
    assert [row["note"] for row in rows if row["note"]] == [leg.note for leg in itinerary.legs]
    # What the first leg's path was planned at; nothing is known of the second one.
    first = itinerary.legs[0].motion[itinerary.legs[0].kept]
    attitude = np.array([[row["yaw"], row["pitch"]] for row in rows[:4]], float)
    yaw = azimuth(itinerary, itinerary.legs[0].waypoints, first.yaw)
    assert attitude == pytest.approx(np.stack([yaw, np.degrees(first.pitch)], axis=1), abs=0.006)
    body = np.array([[row[name] for name in ("surge", "sway", "heave")] for row in rows[:4]], float)
    assert body == pytest.approx(first.body_velocity, abs=6e-4)
    assert [rows[4][name] for name in ("yaw", "pitch", "surge", "sway", "heave")] == [""] * 5


def test_netcdf(itinerary: Itinerary, tmp_path: Path):
    data = xr.load_dataset(written(itinerary, tmp_path, "netcdf"), engine="h5netcdf", decode_times=False)
    assert data.attrs["featureType"] == "trajectory"
    assert data["trajectory"].attrs["cf_role"] == "trajectory_id"
    assert data["row_size"].attrs["sample_dimension"] == "obs"
    assert data["depth"].attrs["positive"] == "down"
    tracks = [*(Track(leg.times, leg.positions) for leg in itinerary.legs), *itinerary.executed]
    assert data["row_size"].values.tolist() == [len(track.times) for track in tracks]
    assert data["kind"].values.tolist() == [0, 0, 1, 1]
    names = [f"{kind}, leg {number}" for kind in ("plan", "executed") for number in (1, 2)]
    assert data["trajectory"].values.tolist() == names
    places = np.concatenate([track.positions for track in tracks])
    near(itinerary, np.stack([data[name].values for name in ("lon", "lat", "depth")], axis=1), places)
    assert data["time"].values == pytest.approx(np.concatenate([track.times for track in tracks]))
    motion = itinerary.legs[0].motion
    for name, angle in (("yaw", motion.yaw), ("course", motion.course)):
        true = azimuth(itinerary, itinerary.legs[0].positions, angle)
        off = (data[name].values[:9] - true + 180.0) % 360.0 - 180.0
        assert off == pytest.approx(0.0, abs=1e-4)
    assert data["course"].attrs["standard_name"] == "platform_course"
    assert data["sway"].values[:9] == pytest.approx(motion.body_velocity[:, 1], abs=1e-6)
    assert np.isnan(data["sway"].values[9:]).all()
    epoch = "2000-01-01 00:00:00" if itinerary.site.epoch is None else "2024-02-28 23:59:30.500000"
    assert data["time"].attrs["units"] == f"seconds since {epoch}"
    assert ("no date" in data.attrs["comment"]) == (itinerary.site.epoch is None)
    assert np.flatnonzero(data["waypoint"].values).tolist() == [0, 3, 5, 8, 9, 17]
    assert (data.attrs["seed"], data.attrs["configuration"]) == (42, '{"name": "reef"}')
    assert data.attrs["auvplan_version"] == "9.8.7"
    decoded = xr.decode_cf(data)
    if itinerary.site.epoch is not None:
        first = EPOCH.replace(tzinfo=None) + timedelta(seconds=60)
        assert abs(decoded["time"].values[0] - np.datetime64(first)) < np.timedelta64(1, "ms")
