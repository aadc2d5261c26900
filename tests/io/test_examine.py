"""Scenarios against their schema, and against the files that they name."""

import re
from datetime import datetime

import pytest
import yaml

from auvplan.io.examine import examine_scenario
from auvplan.io.scenario_file import scenario_schema


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
    for bad in (
        {"vehicle": {"speed": -1}},
        {"mission": {"prioritys": [1, 2]}},
        {"mission": {"start": [1, 2]}},
        {"mission": {"start": {"longitude": 1}}},
        {"planning": {"preset": "best"}},
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


def test_every_file_is_tried(tmp_path):
    (tmp_path / "my.yaml").write_text(FILES)
    (tmp_path / "coast.geojson").write_text('{"type": "Polygon", "coordinates": []}')
    (tmp_path / "bed.nc").write_text("no NetCDF")
    (tmp_path / "jobs.csv").write_text("lon,lat,priority\n148.96,-20.34,high\n")
    found = examine_scenario(tmp_path / "my.yaml")
    assert [(fault.field, fault.place and fault.place[0]) for fault in found.faults] == [
        ("chart.file", 5),
        ("chart.no_go", 6),
        ("bathymetry.file", 9),
        ("current.files", 12),
        ("current.truth", 13),
        ("mission.jobs", 15),
    ]
    assert "priority" in found.faults[-1].reason
    assert found.lines[0].startswith(f"{tmp_path / 'my.yaml'}:5:9 chart.file: ")


def test_places_on_land_are_all_told_though_another_file_is_at_fault(tmp_path):
    text = FILES.replace("source: file\n  files: tide.nc\n  truth: other.nc", "vortices: 0")
    (tmp_path / "my.yaml").write_text(text.replace("  no_go: closed.geojson\n", ""))
    ring = [
        [148.955, -20.345],
        [148.965, -20.345],
        [148.965, -20.335],
        [148.955, -20.335],
        [148.955, -20.345],
    ]
    (tmp_path / "coast.geojson").write_text(f'{{"type": "Polygon", "coordinates": [{ring}]}}')
    (tmp_path / "jobs.csv").write_text(
        "north,east,depth,name\n100,100,5,a\n1000,1000,5,b\n-1000,0,99,c\n5000,0,1,d\n"
    )
    found = examine_scenario(tmp_path / "my.yaml")
    reasons = [(fault.field, fault.reason) for fault in found.faults]
    assert [field for field, _ in reasons] == [
        "bathymetry.file", "mission.jobs", "mission.jobs", "mission.jobs", "mission.start", "mission.goal",
    ]  # fmt: skip
    for (_, reason), words in zip(
        reasons[1:],
        ("'a' .* on land", "'c' .* depths 0 to 30 m", "'d' .* outside the area", "on land", "on land"),
        strict=True,
    ):
        assert re.search(words, reason)


def test_shipped_scenarios_have_no_faults():
    for name in ("scenario-1", "scenario-3"):
        assert not examine_scenario(name).faults
