"""Scenarios against their schema, and against the files that they name."""

import json
import re
from datetime import datetime

import numpy as np
import pytest
import yaml

import auvplan as ap
from auvplan.errors import ScenarioError
from auvplan.io.examine import examine_folder, examine_scenario
from auvplan.io.geo import GeoError, read_jobs
from auvplan.mission.graph import MissionGraph
from auvplan.scenario.file import scenario_schema, validate_scenario
from auvplan.scenario.waypoints import slope_warnings
from auvplan.site import Site
from tests.io.bad_input import everywhere
from tests.io.refusals import refusal
from tests.io.small_site import CENTRE, SmallSite, square


def _plain(value):
    """As JSON has it: dates are text."""
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_plain(part) for part in value]
    return value.isoformat() if isinstance(value, datetime) else value


def test_the_schema_knows_what_is_shipped_and_refuses_slips():
    jsonschema = pytest.importorskip("jsonschema")
    from importlib.resources import files

    schema = scenario_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    data = files("auvplan") / "data"
    texts = [entry.read_text() for entry in (data / "scenarios").iterdir() if entry.name.endswith(".yaml")]
    texts.append((data / "example" / "scenario.yaml").read_text())
    assert len(texts) >= 5
    for text in texts:
        validator.validate(_plain(yaml.safe_load(text)))
    colours = {"water": "white", "land": ["tan"]}  # one or several
    validator.validate({"chart": {"source": "image", "image": "map.png", "colours": colours}})
    for bad in (
        {"vehicle": {"speed": -1}},
        {"mission": {"prioritys": [1, 2]}},
        {"mission": {"start": [1, 2]}},
        {"mission": {"start": {"longitude": 1}}},
        {"planning": {"preset": "best"}},
        {"chart": {"source": "image", "image": "map.png", "colours": {"watre": "white"}}},
    ):
        assert not validator.is_valid(bad), bad


def test_the_schema_tells_defaults_and_units():
    schema = scenario_schema()
    assert schema["$schema"].endswith("2020-12/schema")
    assert schema["title"]
    mission = schema["$defs"]["MissionSettings"]["properties"]
    assert mission["time_available"]["default"] == 14_400.0
    assert "m north, east, depth" in mission["start"]["description"]
    for section in ("ObstacleSettings", "SensorSettings", "BathymetrySettings"):
        for name, field in schema["$defs"][section]["properties"].items():
            if field.get("type") == "number" or name in ("radius", "clearance"):
                assert field.get("description"), (section, name)


def test_waypoints_that_no_straight_edge_leads_to_flatly_enough_are_told():
    """A job 60 m below and 80 m beside the start: 37 degrees, and 120 m of way at 30."""
    places = np.array([[0.0, 0.0, 10.0], [80.0, 0.0, 70.0], [800.0, 0.0, 10.0]])
    linked = ~np.eye(3, dtype=bool)
    graph = MissionGraph(places, linked, np.zeros((3, 3)), np.zeros((3, 3)))
    names = ["start", "wreck", "goal"]

    def told(graph, **vehicle):
        return slope_warnings(validate_scenario({"vehicle": vehicle}), graph, names)

    assert told(graph) == []  # there is a flat edge from the goal
    linked[:, 1] = [True, False, False]
    (line,) = told(MissionGraph(places, linked, np.zeros((3, 3)), np.zeros((3, 3))))
    assert line == (
        "wreck lies 60 m below start, 100 m away: 37 degrees where vehicle.pitch_max allows 30, and a path "
        "must be 120 m long"
    )
    assert told(graph, pitch_max="none") == []
    (slow,) = told(graph, pitch_max="none", dive_rate_max=0.15)
    assert "wreck lies 60 m below goal" in slow
    assert "where vehicle.dive_rate_max allows 3, and a path must be 1,000 m long" in slow


FILES = """\
site: {longitude: 148.96, latitude: -20.34, departure: 2026-03-01T00:00:00Z}
area: {lower: [-2000, -2000, 0], upper: [2000, 2000, 30]}
chart:
  source: polygons
  file: coast.geojson
  no_go: closed.geojson
bathymetry:
  source: file
  file: bed.nc
current:
  source: file
  files: tide.nc
  truth: other.nc
mission:
  jobs: jobs.csv
  start: [0, 0, 5]
  goal: [500, 500, 5]
"""


def test_places_on_land_are_all_told_though_another_file_is_at_fault(tmp_path):
    text = FILES.replace("source: file\n  files: tide.nc\n  truth: other.nc", "vortices: 0")
    (tmp_path / "my.yaml").write_text(text.replace("  no_go: closed.geojson\n", ""))
    ring = square(148.955, -20.345, 0.01)
    (tmp_path / "coast.geojson").write_text(f'{{"type": "Polygon", "coordinates": [{ring}]}}')
    (tmp_path / "jobs.csv").write_text(
        "north,east,depth,name\n100,100,5,a\n1000,1000,5,b\n-1000,0,99,c\n5000,0,1,d\n"
    )
    found = examine_scenario(tmp_path / "my.yaml")
    reasons = [(fault.field, fault.reason) for fault in found.faults]
    expected = [
        ("bathymetry.file", ""), ("mission.jobs", "'a' .* on land"),
        ("mission.jobs", "'c' .* depths 0 to 30 m"), ("mission.jobs", "'d' .* outside the area"),
        ("mission.start", "on land"), ("mission.goal", "on land"),
    ]  # fmt: skip
    assert [field for field, _ in reasons] == [field for field, _ in expected]
    assert all(re.search(words, reason) for (_, reason), (_, words) in zip(reasons, expected, strict=True))


def test_missing_files_and_faulty_rows_are_told_beside_bad_fields(tmp_path):
    text = FILES.replace("  no_go: closed.geojson\n", "  no_go: closed.geojson\n  pixel_size: -1\n")
    (tmp_path / "my.yaml").write_text(text)
    (tmp_path / "jobs.csv").write_text(
        "lon,lat,priority\n148.96,-20.34,high\n148.97,-20.34,1\n148.96,,2\n148.95,-20.34,-1\n"
    )
    (tmp_path / "bed.nc").write_text("no NetCDF")
    found = examine_scenario(tmp_path / "my.yaml")
    assert [(fault.field, fault.place and fault.place[0]) for fault in found.faults] == [
        ("chart.file", 5), ("chart.no_go", 6), ("chart.pixel_size", 7), ("bathymetry.file", 10),
        ("current.files", 13), ("current.truth", 14), *[("mission.jobs", 16)] * 3,
    ]  # fmt: skip
    assert found.lines[0].startswith(f"{tmp_path / 'my.yaml'}:5:9 chart.file: ")
    rows = [fault.reason for fault in found.faults[-3:]]
    assert [re.search(r"row (\d)", row)[1] for row in rows] == ["2", "4", "5"]


def test_forecasts_that_are_missing_are_reported_at_their_field(tmp_path):
    members = "  truth: other.nc\n  members:\n    files: [old.nc, older.nc]\n"
    (tmp_path / "my.yaml").write_text(FILES.replace("  truth: other.nc\n", members))
    found = [fault for fault in examine_scenario(tmp_path / "my.yaml").faults if "members" in fault.field]
    (fault,) = found
    assert (fault.field, fault.place) == ("current.members.files", (15, 12))
    assert re.search(r"old\.nc: no such file \(nor 1 more\)", fault.reason)


def test_what_follows_from_a_fault_is_not_stated(tmp_path):
    text = FILES.replace(
        "source: polygons\n  file: coast.geojson\n  no_go: closed.geojson", "source: current"
    )
    text = text.replace("source: file\n  file: bed.nc", "source: current").replace("  truth: other.nc\n", "")
    (tmp_path / "my.yaml").write_text(text)
    (tmp_path / "jobs.csv").write_text("lon,lat\n148.96,-20.34\n")
    found = examine_scenario(tmp_path / "my.yaml")
    assert [fault.field for fault in found.faults] == ["current.files"]


def test_a_line_with_a_faulty_row_has_no_further_fault(tmp_path):
    (tmp_path / "jobs.csv").write_text("north,east,line\n1,2,a\n3,far,a\n5,6,b\n7,8,b\n")
    assert len(refusal(GeoError, "row 3", read_jobs, tmp_path / "jobs.csv", None).lines) == 1


def test_warnings_of_a_file_are_told_of_each_scenario_that_names_it(tmp_path):
    site = SmallSite(tmp_path / "site")
    site.tide(lambda data: everywhere("uo", 0.0)(everywhere("vo", 0.0)(data)))
    text = (site.folder / "scenario.yaml").read_text()
    site.write("second.yaml", text)
    stated = [examined.warnings for examined in examine_folder(site.folder)]
    assert len(stated) == 2
    assert all(len(lines) == 1 and "0 everywhere" in lines[0] for lines in stated)


BAY = """\
site: {longitude: 147.4, latitude: -43.06, departure: 2026-03-01T20:30:00Z}
area: {lower: [-2000, -2000, 0], upper: [2000, 2000, 30]}
chart: {source: none, no_go: closed.geojson}
current: {source: harmonic, constituents: tide.yaml}
obstacles: {file: obstacles.geojson}
vehicle: {speed: %s}
mission: {jobs: jobs.csv, start: [0, 0, 5], goal: [500, 500, 5], time_available: 7200}
"""

#: Two faults a file, and what is said of each.
FAULTY = {
    "closed.geojson": '{"type": "FeatureCollection", "features": ['
    '{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [[[147.4, -430],'
    " [147.5, -43], [147.4, -43.1], [147.4, -430]]]}}, "
    '{"type": "Feature", "properties": {}, "geometry": null}]}',
    "tide.yaml": "constituents:\n  M2x: {u: [0.1, 40], v: [0.3, 60]}\n  O1: {u: [0.1], v: [0.1, 120]}\n",
    "obstacles.geojson": '{"type": "FeatureCollection", "features": ['
    '{"type": "Feature", "properties": {"radius": -5, "coarse": 3}, "geometry": {"type": "Point", '
    '"coordinates": [147.41, -43.06]}}]}',
    "jobs.csv": "lon,lat,depht,priority,name,lat,from,to\n147.4,-43.06,5,2,a,,,\n147.41,-43.06,x,-2,b,,,\n"
    "147.41,-43.05,5,1,c,,2026-02-01T00:00Z,2026-02-01T02:00Z\n",
}
REPORTED = [
    ("chart.no_go", "feature 2: has no geometry"),
    ("current.constituents", "M2x: is none that is known"),
    ("current.constituents", "O1.u: has too few entries: 1"),
    ("obstacles.file", "feature 1: radius must be greater than 0"),
    ("obstacles.file", "feature 1: unknown key 'coarse', did you mean 'course'"),
    ("mission.jobs", "unknown name 'depht', did you mean 'depth'"),
    ("mission.jobs", "two columns map to lat"),
    ("mission.jobs", "row 3: depth must be a finite number, got 'x'"),
    ("mission.jobs", "row 3: priority must be at least 0"),
    ("mission.jobs", "job 'c': all its windows are over at the departure, 2026-03-01 20:30 UTC"),
]


@pytest.mark.parametrize("speed", ["2.0", "fast"])
def test_faults_of_a_file_hide_neither_each_other_nor_those_of_other_files(tmp_path, speed):
    (tmp_path / "scenario.yaml").write_text(BAY % speed)
    for name, text in FAULTY.items():
        (tmp_path / name).write_text(text)
    faults = examine_scenario(tmp_path / "scenario.yaml").faults
    expected = REPORTED + ([("vehicle.speed", "must be a valid number")] if speed == "fast" else [])
    for field, reason in expected:
        assert any(fault.field == field and reason in fault.reason for fault in faults), reason
    assert len(faults) == len(expected)


def test_sections_whose_fields_are_at_fault_are_not_blamed_for_what_they_lack(tmp_path):
    text = BAY.replace("closed.geojson", "closed.geojson, no_go_windows: 3").replace("7200", "soon")
    (tmp_path / "scenario.yaml").write_text(text % "2.0")
    for name, content in FAULTY.items():
        (tmp_path / name).write_text(content)
    fields = {fault.field for fault in examine_scenario(tmp_path / "scenario.yaml").faults}
    assert "mission.time_available" in fields
    assert fields >= {"current.constituents", "obstacles.file"}
    assert not fields & {"mission.start", "mission.goal"}


def test_an_area_is_not_held_against_a_chart_that_the_scenario_does_not_name(tmp_path):
    (tmp_path / "tide.yaml").write_text("constituents:\n  M2: {u: [0.1, 0.0], v: [0.2, 0.0]}\n")
    text = BAY.replace("source: none, no_go", "source: world, no_go")
    (tmp_path / "scenario.yaml").write_text(text % "2.0")
    (tmp_path / "jobs.csv").write_text("name,longitude,latitude\na,147.4,-43.06\n")
    fields = [fault.field for fault in examine_scenario(tmp_path / "scenario.yaml").faults]
    assert "chart.source" in fields
    assert "area" not in fields


def test_jobs_that_known_obstacles_keep_a_vehicle_off_are_warned_of(tmp_path):
    """Points and vertices of lines, each with the obstacle; the others are not, nor are any if it moves."""
    site, place = SmallSite(tmp_path / "site"), Site(*CENTRE).to_geographic
    wreck, beyond = ([float(part) for part in place(*at)] for at in ((-530.0, 1000.0), (-530.0, 1400.0)))
    site.obstacles(wreck, name="wreck", radius=60)
    for jobs, said in (
        ("jobs.csv", "'a' is left out: it"),
        ("lines.geojson", "'l' is left out in part: its vertex 2"),
    ):
        site.features("lines.geojson", "LineString", [[*beyond, -5], [*wreck, -5]], name="l")
        site.set(mission={"jobs": jobs})
        found = examine_scenario(site.folder / "scenario.yaml")
        assert not found.faults
        (line,) = (line for line in found.warnings if "is left out" in line)
        assert f"{jobs}: job {said} lies within the known obstacle 'wreck': move it" in line
    assert any("400 of its 400 m are left out" in line for line in found.warnings)
    site.obstacles(wreck, name="wreck", radius=60, course=90, speed=0.1)
    found = examine_scenario(site.folder / "scenario.yaml")
    assert not [line for line in found.warnings if "is left out" in line]


def test_a_goal_within_a_known_obstacle_is_said_before_anything_is_planned(tmp_path):
    """One that stands; a job may lie in one, and others are done."""
    text = (
        "site: {longitude: 148.96, latitude: -20.34}\n"
        "area: {lower: [0, 0, 0], upper: [3000, 3000, 30]}\n"
        "chart: {source: none}\n"
        "obstacles: {file: obstacles.geojson}\n"
        "mission: {jobs: jobs.csv, start: [200, 200, 5], goal: [2800, 2800, 5]}\n"
    )
    (tmp_path / "my.yaml").write_text(text)
    (tmp_path / "jobs.csv").write_text("name,north,east,depth\nwreck,1000,1000,5\n")
    site, places = Site(148.96, -20.34), [(2790.0, 2800.0), (1000.0, 1000.0)]
    points = [[float(part) for part in site.to_geographic(*place)] for place in places]
    features = [
        {
            "type": "Feature",
            "properties": {"name": f"wreck {k}", "radius": 60},
            "geometry": {"type": "Point", "coordinates": point},
        }
        for k, point in enumerate(points)
    ]
    file = tmp_path / "obstacles.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    (fault,) = examine_scenario(tmp_path / "my.yaml").faults
    assert fault.field == "mission.goal"
    assert "lies within the known obstacle 'wreck 0'" in fault.reason
    with pytest.raises(ScenarioError, match=r"mission\.goal .* within the known obstacle 'wreck 0'"):
        ap.plan_scenario(ap.load_scenario(tmp_path / "my.yaml"))
    for feature in features:
        feature["properties"] |= {"course": 90, "speed": 0.5}
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    assert not examine_scenario(tmp_path / "my.yaml").faults
