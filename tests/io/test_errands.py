"""The checker's own reading of jobs and obstacles, against the planner's."""

import json
import zipfile

import numpy as np
import pytest
from auvplan.io.errands import jobs_of, obstacles_of
from auvplan.io.originals import metres_of

from auvplan.io.geo import read_jobs, read_obstacles
from auvplan.site import Site
from tests.io.geo.files import feature, write_geojson
from tests.io.test_sources import saved

SITE = Site(10.0, 50.0, origin=(300.0, -700.0))
KML = """<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Folder>
<Placemark><name>a</name><ExtendedData><Data name="priority"><value>3</value></Data>
<SchemaData><SimpleData name="duration">40</SimpleData></SchemaData></ExtendedData>
<Point><altitudeMode>absolute</altitudeMode><coordinates>10.01,50.01,-7</coordinates></Point></Placemark>
<Placemark><name>b</name><MultiGeometry><Point><coordinates>10.02,50.0,12</coordinates></Point>
<LineString><coordinates>10.0,50.02,-3 10.01,50.02,-4</coordinates></LineString></MultiGeometry></Placemark>
</Folder></Document></kml>"""
GPX = """<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">
<wpt lat="50.01" lon="10.02"><ele>-6</ele><name>a</name></wpt><wpt lat="50.02" lon="10.02"/></gpx>"""
SURVEY = {
    "VisualTransectPoints": [[50.0, 10.01], [50.01, 10.01], [50.01, 10.01], [50.01, 10.02]],
    "CameraCalc": {"DistanceToSurface": -9.0},
}
PLAN = {
    "fileType": "Plan",
    "mission": {
        "items": [
            {"type": "SimpleItem", "command": 22, "frame": 3, "params": [0.0] * 7},
            {
                "type": "SimpleItem",
                "command": 16,
                "frame": 3,
                "Altitude": -5,
                "params": [30, 0, 0, None, 50.01, 10.02, -4],
            },
            {"type": "ComplexItem", "complexItemType": "survey", "TransectStyleComplexItem": SURVEY},
        ]
    },
}
FEATURES = (
    feature("Point", [10.01, 50.02, -4.0], name="a", priority=2, Duration=60),
    feature("MultiPoint", [[10.02, 50.02], [10.03, 50.02]], depth=6),
    feature("LineString", [[10.0, 50.01, -5], [10.01, 50.01, -5]], priority=None),
)
TABLES = {
    "comma.csv": "Longitude,latitude,depth,name,priority\n10.01,50.02,4,a,2\n\n10.02,50.02,,,\n",
    "semicolon.csv": "\ufeffname;lon;lat;depth;duration\r\na;10,01;50,02;4,5;60\r\n;10,02;50,02;;\r\n",
    "tabs.tsv": "lat\tlon\tpriority\n50,02\t10,01\t2,5\n",
    "told.csv": "sep=|\nlat|lon|priority\n50.02|10.01|2.5\n",
    "lines.csv": "north,east,depth,line,priority,duration\n1,2,3,s,4,\n5,6,7,s,,9\n8,8,1,,,\n"
    "9,9,,t,,\n9,8,,t,,\n",
}


def agree(path):
    """Whether both read the same; names of the planner's points."""
    theirs = read_jobs(path, SITE, default_depth=2.0)
    ours = jobs_of(path, metres_of(saved(path.parent, SITE)), 2.0)
    for kind in ("points", "lines"):
        one, two = getattr(ours, kind), getattr(theirs, kind)
        assert [(job.name, job.priority, job.duration) for job in one] == [
            (job.name, job.priority, job.duration) for job in two
        ]
        for a, b in zip(one, two, strict=True):
            places = [np.asarray(job.positions if kind == "lines" else job.position, float) for job in (a, b)]
            np.testing.assert_allclose(*places, atol=1e-6)
    return len(ours.points), len(ours.lines)


@pytest.mark.filterwarnings("ignore::auvplan.errors.ScenarioWarning")
def test_jobs_of_all_formats(tmp_path):
    assert agree(write_geojson(tmp_path / "j.geojson", *FEATURES)) == (3, 1)
    for name, text, counts in (
        ("j.gpx", GPX, (2, 0)),
        ("j.kml", KML, (2, 1)),
        ("j.plan", json.dumps(PLAN), (1, 1)),
    ):
        (tmp_path / name).write_text(text)
        assert agree(tmp_path / name) == counts
    with zipfile.ZipFile(tmp_path / "j.kmz", "w") as archive:
        archive.write(tmp_path / "j.kml", "files/doc.kml")
    assert agree(tmp_path / "j.kmz") == (2, 1)


@pytest.mark.parametrize("name", list(TABLES))
def test_tables_of_jobs(tmp_path, name):
    (tmp_path / name).write_text(TABLES[name], newline="")
    assert sum(agree(tmp_path / name)) >= 1


def test_obstacles(tmp_path):
    path = write_geojson(
        tmp_path / "o.geojson",
        feature("Point", [10.01, 50.02], radius=40, name="buoy", depth_max=5),
        feature("Point", [10.02, 50.03], radius=30.5, course=120, speed=1.5, depth_min=3),
    )
    theirs, ours = read_obstacles(path, SITE), obstacles_of(path, metres_of(saved(tmp_path, SITE)))
    for a, b in zip(ours, theirs, strict=True):
        assert (a.name, a.radius, a.depth_min, a.depth_max) == (b.name, b.radius, b.depth_min, b.depth_max)
        np.testing.assert_allclose([*a.position, *a.velocity], [*b.position, *b.velocity], atol=1e-6)
