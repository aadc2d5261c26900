"""Scenarios against their schema, and against the files that they name."""

import re
from datetime import datetime

import pytest
import yaml

from auvplan.io.examine import examine_folder, examine_scenario
from auvplan.io.geo import GeoError, read_jobs
from auvplan.scenario.file import scenario_schema
from tests.io.small_site import SmallSite
from tests.io.variants import scaled


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


def test_missing_files_and_faulty_rows_are_told_beside_bad_fields(tmp_path):
    text = FILES.replace("  no_go: closed.geojson\n", "  no_go: closed.geojson\n  pixel_size: -1\n")
    (tmp_path / "my.yaml").write_text(text)
    (tmp_path / "jobs.csv").write_text(
        "lon,lat,priority\n148.96,-20.34,high\n148.97,-20.34,1\n148.96,,2\n148.95,-20.34,-1\n"
    )
    found = examine_scenario(tmp_path / "my.yaml")
    assert [fault.field for fault in found.faults] == [
        "chart.file", "chart.no_go", "chart.pixel_size", "bathymetry.file", "current.files", "current.truth",
        "mission.jobs", "mission.jobs", "mission.jobs",
    ]  # fmt: skip
    rows = [fault.reason for fault in found.faults[-3:]]
    assert [re.search(r"row (\d)", row)[1] for row in rows] == ["2", "4", "5"]


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
    with pytest.raises(GeoError, match="row 3") as caught:
        read_jobs(tmp_path / "jobs.csv", None)
    assert len(caught.value.lines) == 1


def test_warnings_of_a_file_are_told_of_each_scenario_that_names_it(tmp_path):
    site = SmallSite(tmp_path / "site")
    scaled(0.0)(site)
    text = (site.folder / "scenario.yaml").read_text()
    site.write("second.yaml", text)
    stated = [examined.warnings for examined in examine_folder(site.folder)]
    assert len(stated) == 2
    assert all(len(lines) == 1 and "0 everywhere" in lines[0] for lines in stated)
