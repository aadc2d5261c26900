"""Jobs from files that other programs write: GPX, KML and KMZ, QGroundControl's plans."""

import json
import zipfile

import fastkml
import gpxpy.gpx
import numpy as np
import pygeoif
import pytest

from auvplan.errors import ScenarioWarning
from auvplan.io.geo import GeoError, read_jobs
from auvplan.site import Site
from tests.io.refusals import refusal

SITE = Site(148.96, -20.34)


def close(found, places):
    """Local positions against places of longitude, latitude and depth."""
    north, east = SITE.to_local(*np.transpose([place[:2] for place in places]))
    expected = np.stack([north, east, [place[2] for place in places]], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_gpx_waypoints_as_gpxpy_writes_them(tmp_path):
    made = gpxpy.gpx.GPX()
    made.waypoints = [
        gpxpy.gpx.GPXWaypoint(-20.344, 148.9415, elevation=-12.5, name="tide gauge", symbol="Flag"),
        gpxpy.gpx.GPXWaypoint(-20.313, 148.94, comment="no name, no depth"),
    ]
    path = tmp_path / "jobs.gpx"
    path.write_text(made.to_xml())
    jobs = read_jobs(path, SITE, default_depth=3.0)
    found = [(job.name, job.priority, job.duration) for job in jobs.points]
    assert found == [("tide gauge", 1, 0), ("2", 1, 0)]
    close([job.position for job in jobs.points], [(148.9415, -20.344, 12.5), (148.94, -20.313, 3.0)])
    assert jobs.notes == (
        f"{path}: priority is not given by 2 of 2 jobs: taken as 1",
        f"{path}: duration is not given by 2 of 2 jobs: taken as 0 s",
        f"{path}: depth is not given by 1 of 2 jobs: taken as 3 m",
    )
    made.routes = [gpxpy.gpx.GPXRoute("r")]
    path.write_text(made.to_xml(version="1.0"))
    with pytest.warns(ScenarioWarning, match="routes and tracks are ignored"):
        assert len(read_jobs(path, SITE).points) == 2


def zipped(path, **files):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(name, text)


def placemarks(*marks):
    """A document of placemarks (name, geometry, extended data, altitude mode), as fastkml writes it."""
    features = []
    for name, shape, data, mode in marks:
        stated = [fastkml.Data(name=key, value=str(value)) for key, value in data.items()]
        parts = {
            "kml_geometry": fastkml.geometry.create_kml_geometry(shape, altitude_mode=mode),
            "extended_data": fastkml.ExtendedData(elements=stated),
        }
        features.append(fastkml.Placemark(name=name, **parts))
    document = fastkml.Document(features=[fastkml.Folder(features=features)])
    return fastkml.KML(features=[document]).to_string()


ABSOLUTE = fastkml.enums.AltitudeMode.absolute
MARKS = [
    ("wreck", pygeoif.Point(148.989, -20.366, -22.0), {"Priority": 5, "duration": 300}, ABSOLUTE),
    ("buoy", pygeoif.Point(148.95, -20.35, 0.0), {"depth": 8}, None),
    ("sound", pygeoif.LineString([(148.945, -20.327, -12.0), (148.937, -20.323, -14.0)]), {"priority": 4},
     ABSOLUTE),
    ("plain", pygeoif.Point(148.94, -20.33), {}, None),
]  # fmt: skip


@pytest.mark.parametrize("name", ["jobs.kml", "jobs.kmz"])
def test_kml_placemarks_as_fastkml_writes_them(tmp_path, name):
    path = tmp_path / name
    if name.endswith("kmz"):
        zipped(path, **{"files/icon.png": "", "doc.kml": placemarks(*MARKS)})
    else:
        path.write_text(placemarks(*MARKS))
    jobs = read_jobs(path, SITE, default_depth=2.0)
    stated = [(job.name, job.priority, job.duration) for job in (*jobs.points, *jobs.lines)]
    assert stated == [("wreck", 5, 300), ("buoy", 1, 0), ("plain", 1, 0), ("sound", 4, 0)]
    places = [(148.989, -20.366, 22), (148.95, -20.35, 8), (148.94, -20.33, 2)]
    close([job.position for job in jobs.points], places)
    close(jobs.lines[0].positions, [(148.945, -20.327, 12), (148.937, -20.323, 14)])
    assert [note.partition(": ")[2] for note in jobs.notes] == [
        "priority is not given by 2 of 4 jobs: taken as 1",
        "duration is not given by 3 of 4 jobs: taken as 0 s",
        "depth is not given by 1 of 4 jobs: taken as 2 m",
    ]


def test_kml_as_gdal_writes_it(tmp_path):
    raw = pytest.importorskip("pyogrio.raw")
    import shapely

    path = tmp_path / "jobs.kml"
    places = shapely.to_wkb(shapely.points([[148.95, -20.35], [148.96, -20.36]]))
    fields = [np.array(["a", "b"], object), np.array([3, 2]), np.array([7.5, 9.0])]
    kept = {"driver": "KML", "geometry_type": "Point", "crs": "EPSG:4326"}
    raw.write(str(path), places, fields, ["Name", "priority", "depth"], **kept)
    found = [(job.name, job.priority, job.position[2]) for job in read_jobs(path, SITE).points]
    assert found == [("a", 3, 7.5), ("b", 2, 9.0)]


def item(command=16, hold=0, place=(-20.35, 148.95, -9.0), **more):
    params = [hold, 5, 0, None, *place]
    made = {"type": "SimpleItem", "command": command, "frame": 3, "params": params, "autoContinue": True}
    return made | {"Altitude": place[2], "AltitudeMode": 1, "AMSLAltAboveTerrain": None, "doJumpId": 1} | more


def survey(depth=15.0, **more):
    """As QGroundControl 4 saves one."""
    points = [[-20.33, 148.95], [-20.34, 148.95], [-20.34, 148.952], [-20.33, 148.952]]
    camera = {"CameraName": "Manual (no camera specs)", "DistanceToSurface": -depth, "version": 2}
    style = {"CameraCalc": camera, "Items": [], "VisualTransectPoints": points, "version": 2} | more
    kind = {"angle": 0, "complexItemType": "survey", "type": "ComplexItem", "version": 5}
    return kind | {"polygon": points, "TransectStyleComplexItem": style}


def plan(path, *items):
    mission = {"items": list(items), "version": 2, "plannedHomePosition": [-20.34, 148.96, 0]}
    path.write_text(json.dumps({"fileType": "Plan", "version": 1, "mission": mission}))
    return path


def test_plans_of_qgroundcontrol(tmp_path):
    speed = {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 1.5, -1, 0, 0, 0, 0]}
    items = speed, item(hold=60), item(19, 30, (-20.36, 148.96, -4)), survey(), item(21)
    path = plan(tmp_path / "a.plan", *items)
    jobs = read_jobs(path, SITE, default_depth=2.0)
    assert [(job.name, job.priority, job.duration) for job in jobs.points] == [("2", 1, 60), ("3", 1, 30)]
    close([job.position for job in jobs.points], [(148.95, -20.35, 9), (148.96, -20.36, 4)])
    (line,) = jobs.lines
    assert (line.name, line.priority, line.duration) == ("survey 4", 1, 0)
    corners = survey()["TransectStyleComplexItem"]["VisualTransectPoints"]
    close(line.positions, [(lon, lat, 15.0) for lat, lon in corners])
    assert f"{path}: items that are no waypoints or surveys are ignored: 1 (178), 5 (21)" in jobs.notes


def gpx(body):
    return f'<?xml version="1.0"?><gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1">{body}</gpx>'


def kml(body):
    mark = f"<Document><Placemark><name>a</name>{body}</Placemark></Document>"
    return f'<kml xmlns="http://www.opengis.net/kml/2.2">{mark}</kml>'


def point(coordinates, mode=""):
    mode = mode and f"<altitudeMode>{mode}</altitudeMode>"
    return kml(f"<Point>{mode}<coordinates>{coordinates}</coordinates></Point>")


BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
FAULTS = [
    ("a.gpx", gpx("<rte/>"), r"no waypoints \(wpt\)"),
    ("a.gpx", gpx('<wpt lat="-20"><name>w</name></wpt>'), "waypoint 1 'w': lon must be a number, got ''"),
    ("a.gpx", gpx('<wpt lat="-20" lon="149"><ele>deep</ele></wpt>'), "waypoint 1: ele must be a number"),
    ("a.gpx", gpx('<wpt lat="149" lon="-20"/>'), "waypoint 1: .*longitude and latitude seem swapped"),
    ("a.gpx", "<kml/>", "is no GPX: its root is kml"),
    ("a.gpx", "<gpx>\n<wpt>", "line 2, column 6: not valid XML"),
    ("a.gpx", BOMB + "<gpx>&b;</gpx>", "document type or entities"),
    ("a.kml", "<kml/>", "has no placemarks"),
    ("a.kml", kml("<Polygon/>"), "placemark 1 'a': a Polygon, where Point or LineString is wanted"),
    ("a.kml", kml(""), "placemark 1 'a': has no geometry"),
    ("a.kml", point("148.9, -20.3"), "placemark 1 'a': coordinates must be a number, got ''"),
    ("a.kml", point("148.9,-20.3,5", "relativeToSeaFloor"),
     "altitudeMode relativeToSeaFloor counts from the sea bed"),
    ("a.kml", point("148.9,-20.3,5", "absolute"), "placemark 1 'a': elevation 5 m is above the sea"),
    ("a.kmz", "text", "a.kmz: "),
    ("a.kmz", ("a.kml", "doc.kml"), r"a\.kmz: holds 2 \.kml, a\.kml, doc\.kml: it must hold one"),
    ("a.kmz", ("a.png",), r"a\.kmz: has no \.kml inside"),
    ("a.plan", "{}", "no mission.items"),
    ("a.plan", "{", "not valid JSON"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "words"), FAULTS)
def test_faults_are_one_line(tmp_path, name, text, words):
    path = tmp_path / name
    if isinstance(text, tuple):
        zipped(path, **dict.fromkeys(text, "<kml/>"))
    else:
        path.write_text(text)
    assert str(refusal(GeoError, words, read_jobs, path, SITE)).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (item(place=(-20.35, 148.95, 9.0)), "item 1: elevation 9 m is above the sea"),
        (item(frame=10), "item 1: frame 10"),
        (item(params=[0, 0, 0, None, "x", 148.95, -9]), "item 1: params must give"),
        (item(params=[1]), "item 1: params must be seven"),
        (survey(depth=-50.0), "item 1: elevation 50 m is above the sea"),
        (survey(VisualTransectPoints=[]), "item 1: the survey has no VisualTransectPoints"),
        (survey(VisualTransectPoints=[[1, 2], ["x", 3]]), "VisualTransectPoints must be"),
        ("item", "item 1: is no mission item"),
    ],
)
def test_faults_of_plans_name_the_item(tmp_path, wrong, words):
    path = plan(tmp_path / "a.plan", wrong, item(hold="long"))
    lines = refusal(GeoError, words, read_jobs, path, SITE).lines
    assert lines[1] == f"{path}: item 2: duration must be a finite number, got 'long'"


def test_altitudes_that_kml_lays_on_the_ground(tmp_path):
    path = tmp_path / "a.kml"
    path.write_text(point("148.95,-20.35,120"))
    jobs = read_jobs(path, SITE, default_depth=1.0)
    assert jobs.points[0].position[2] == 1.0
    assert any("are ignored" in note for note in jobs.notes)
    path.write_text(point("148.95,-20.35,-7"))
    assert read_jobs(path, SITE, default_depth=1.0).points[0].position[2] == 7.0
