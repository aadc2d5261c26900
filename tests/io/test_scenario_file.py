"""Scenario files: every fault at once, each with its line, column and field."""

import math
import re
from datetime import UTC, datetime

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.errors import ScenarioError, ScenarioWarning
from auvplan.scenario.fields import check_fields
from auvplan.scenario.file import check_scenario, load_scenario, shipped_scenarios, validate_scenario
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.yaml_lines import YamlError, read_yaml
from auvplan.simulation.world import make_vehicle
from tests.io.refusals import refusal


def faults_of(tmp_path, text):
    """Field, place and reason of each fault of a text."""
    path = tmp_path / "my.yaml"
    path.write_text(text)
    _, faults, _, _ = check_scenario(path)
    return [(fault.field, fault.place, fault.reason) for fault in faults]


def test_every_fault_is_told_at_once_in_the_order_of_the_file(tmp_path):
    text = """\
name: many faults
vehicle:
  speed: -1
  dept_max: 30
mission:
  time_available: soon
  start: [1, 2]
  waypoints: 1
prioritys: [1, 2]
planning: {preset: best, t_series: 99}
"""
    assert faults_of(tmp_path, text) == [
        ("vehicle.speed", (3, 10), "must be greater than 0, got -1"),
        ("vehicle.dept_max", (4, 3), "unknown key 'dept_max', did you mean 'depth_max'?"),
        ("mission.time_available", (6, 19),
         "must be a valid number, unable to parse string as a number, got 'soon'"),
        ("mission.start", (7, 10), "has too few entries: 2"),
        ("mission.waypoints", (8, 14), "must be greater than or equal to 2, got 1"),
        ("prioritys", (9, 1), "unknown key 'prioritys', did you mean 'mission.priority'?"),
        ("planning.preset", (10, 20), "must be 'default' or 'paper', got 'best'"),
        ("planning.t_series", (10, 36), "must be less than or equal to 20, got 99"),
    ]  # fmt: skip


PLACES = """\
site: {longitude: 148.96, latitude: -20.34}
area:
  lower: {longitude: 149.0, latitude: -20.3}
  upper: {longitude: 148.9, latitude: -20.2}
mission:
  start: {longitude: 1000, latitude: -20.3}
  goal:
    lon: 148.9
    lat: -20.3
  waypoints: 1
"""
SECTIONS = """\
vehicle: {speed: -1}
chart: {source: polygons, file: coast.geojson}
current: {source: file, files: tide.nc}
bathymetry: {source: current, positive: sideways}
mission: {start: [20000, 1, 1]}
"""
#: An area that is none says nothing of the start, nor a chart's source that is none of its file.
FOLLOWING = """\
area: {lower: [0, 0, 0], upper: [100, wide, 100]}
chart: {source: polygon, file: coast.geojson}
mission: {start: [9999, 50, 5], jobs: jobs.csv, goal: here}
"""
ORIGIN = "site: {longitude: 0, latitude: 0}\n"
#: Texts, and field, line and words of each fault.
TEXTS = [
    ("mision: {}", [("mision", 1, "did you mean 'mission'?")]),
    ("mission: {prioritys: [1, 2]}", [("mission.prioritys", 1, "did you mean 'priority'?")]),
    ("time_available: 5", [("time_available", 1, "did you mean 'mission.time_available'?")]),
    ("mission: {turn_rate_max: 1}", [("mission.turn_rate_max", 1, "mean 'vehicle.turn_rate_max'?")]),
    ("xyzzy: 1", [("xyzzy", 1, "unknown key 'xyzzy'")]),
    (PLACES, [("area.lower", 3, "south-western corner"), ("mission.start", 6, "no place on Earth"),
              ("mission.goal", 7, "must have longitude, latitude"), ("mission.waypoints", 10, "")]),
    *((f"{ORIGIN}mission: {{start: {{longitude: {number}, latitude: 0}}}}\n",
       [("mission.start", 2, "numbers")]) for number in ("1" + "0" * 400, ".inf", "east", "[1]")),
    ("mission: {start: {longitude: 1, latitude: 2}}", [("mission.start", 1, "needs the section site")]),
    ("site: {longitude: 1}\nmission: {start: {longitude: 1, latitude: 0}}", [("site.latitude", 1, "")]),
    (ORIGIN + "area: {lower: {longitude: 0, latitude: 0}, upper: [1, 1, 1]}\n", [("area.lower", 2, "both")]),
    (SECTIONS, [("vehicle.speed", 1, ""), ("chart.source", 2, "needs the section site"),
                ("current.source", 3, ""), ("bathymetry.positive", 4, ""),
                ("mission.start", 5, "lies outside the area")]),
    (FOLLOWING, [("area.upper.1", 1, ""), ("chart.source", 2, ""), ("mission.goal", 3, "")]),
    ("chart: {source: none, image: a.png, uncertain: b}",
     [("chart.image", 1, ""), ("chart.uncertain", 1, "")]),
    ("name: !!python/object/apply:os.system ['true']\nvehicle: {speed: -1}\n",
     [("name", 1, "tag"), ("vehicle.speed", 2, "")]),
    *((f"name: {value}\nvehicle: {{speed: -1}}\n", [("name", 1, words), ("vehicle.speed", 2, "")])
      for value, words in (("!!binary aGk=", "tag"), ("2026-02-30", "day"), ("9" * 5000, "no value"),
                           ("!!int many", "no value"))),
    ("name: a\nvehicle: {speed: 1, speed: 2}\nname: b\n", [("vehicle.speed", 2, ""), ("name", 3, "")]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "expected"), TEXTS)
def test_faults_have_a_field_a_line_and_a_reason(tmp_path, text, expected):
    found = faults_of(tmp_path, text)
    assert [(field, place and place[0]) for field, place, _ in found] == [row[:2] for row in expected]
    for (_, _, reason), (_, _, words) in zip(found, expected, strict=True):
        assert words in reason
        assert "mean" not in reason or "mean" in words


@pytest.mark.parametrize(
    ("site", "spellings"),
    [
        (180.0, [(179.985, 180.015), (179.985, -179.985)]),
        (0.0, [(-0.01, 0.01), (359.99, 0.01)]),
    ],
)
def test_an_area_lies_across_any_meridian(site, spellings):
    def area(west, east):
        corners = {
            "lower": {"longitude": west, "latitude": -20.3},
            "upper": {"longitude": east, "latitude": -20.2},
        }
        corners["upper"]["depth"] = 30.0
        return validate_scenario({"site": {"longitude": site, "latitude": -20.25}, "area": corners}).area

    first, *others = (area(*ends) for ends in spellings)
    assert 1000.0 < first.upper[1] - first.lower[1] < 4000.0
    assert all(other == first for other in others)


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("name: a\nvehicle: {speed: 2", 2, 19, "but got"),
        ("name: a\n\tb: 3", 2, 1, "cannot start any token"),
        ("a: &x [1]\nb: *x\n", 2, 4, "aliases"),
        ("a: 1\n---\nb: 2\n", 2, 1, "another document"),
        ("a: 1\nb: \x01", 2, 4, "no text"),
        ("a:\n  " + "[" * 99, 2, 35, "deeply"),
    ],
)
def test_yaml_that_is_none_has_a_line_and_a_column(text, line, column, words):
    assert refusal(YamlError, words, read_yaml, text).place == (line, column)


def test_one_line_with_the_line_number_and_how_many_more(tmp_path):
    path = tmp_path / "my.yaml"
    path.write_text("name: a\n\nmission:\n  waypoints: 1\n")
    line = f"^{path}:4: mission.waypoints: must be greater than or equal to 2, got 1$"
    refusal(ScenarioError, line, load_scenario, path)
    path.write_text("mission: {waypoints: 1, time: 1}\nx: 1\n")
    more = rf"\(and 2 more: auvplan validate {path} lists all\)$"
    refusal(ScenarioError, more, load_scenario, path)


def test_what_is_sound_is_left():
    document = read_yaml("site: {longitude: 1}\nvehicle: {speed: 2, surge_max: -1}\nmision: {}\n")
    left, faults, taken = check_fields(document, Scenario)
    assert (left.vehicle.speed, len(faults)) == (2.0, 3)
    assert taken == {("site", "latitude"), ("vehicle", "surge_max"), ("mision",)}
    assert check_fields(read_yaml("site: {longitude: 1}"), Scenario)[0] is not None


def test_plain_data_has_no_lines_and_no_advice_and_is_left_as_it_is():
    plain = {"vehicle": {"speed": 0}, "x": 1}
    words = r"^sweep: vehicle\.speed: must be .* \(and 1 more\)$"
    refusal(ScenarioError, words, validate_scenario, plain, "sweep")
    assert plain == {"vehicle": {"speed": 0}, "x": 1}


def test_shipped_scenarios_are_what_pydantic_makes_of_them():
    for scenario in shipped_scenarios().values():
        assert Scenario.model_validate(scenario.model_dump(mode="json")) == scenario
        assert validate_scenario(scenario.model_dump(mode="json")) == scenario


def test_places_and_dates_come_out_as_before(tmp_path):
    path = tmp_path / "my.yaml"
    path.write_bytes(
        b"\xef\xbb\xbfsite: {longitude: 148.96, latitude: -20.34, departure: 2026-03-01 02:00:00 +02:00}\n"
        b"mission: {start: {longitude: 149.0, latitude: -20.30, depth: 5}}\n"
    )
    scenario = load_scenario(path)
    assert scenario.site is not None
    assert scenario.site.departure == datetime(2026, 3, 1, tzinfo=UTC)
    north, east = scenario.site.site.to_local(149.0, -20.30)
    assert scenario.mission.start == pytest.approx((float(north), float(east), 5.0), abs=0.01)


_WORDS = st.sampled_from(
    ["name", "site", "area", "mission", "start", "speed", "vehicle", "longitude", "jobs", "x"]
)
_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**20), 10**20) | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_WORDS, inner, max_size=4),
    max_leaves=12,
)
_SECTIONS = st.fixed_dictionaries(
    {}, optional={name: _VALUES for name in Scenario.model_fields if name not in ("name", "description")}
)


@settings(max_examples=75, deadline=None)
@given(_SECTIONS)
def test_whatever_is_in_it_a_scenario_is_valid_or_has_faults_that_can_be_printed(plain):
    """The check agrees with pydantic on what is valid, and its faults stay on their lines."""
    document = read_yaml(yaml.safe_dump(plain, allow_unicode=True))
    scenario, faults, _ = check_fields(document, Scenario)
    try:
        expected = Scenario.model_validate(document.data)
    except Exception:
        expected = None
    assert (None if faults else scenario) == expected
    assert (expected is None) == bool(faults)
    for fault in faults:
        line = fault.line("f.yaml")
        assert len(line.splitlines()) == 1
        assert line.startswith("f.yaml:")


@given(st.text(max_size=60))
@settings(max_examples=150, deadline=None)
def test_any_text_is_data_or_a_fault(text):
    try:
        said = ""
        read_yaml(text)
    except YamlError as error:
        said = str(error)
    assert len(said.splitlines()) <= 1


def test_a_setting_that_the_papers_preset_fixes_is_warned_of_with_both_values():
    with pytest.warns(ScenarioWarning, match=r"planning.reserve is 60.0, preset 'paper' has 0.0"):
        scenario = validate_scenario({"planning": {"preset": "paper", "reserve": 60}})
    assert scenario.planning.resolved.reserve == 60.0


def test_pitch_is_limited_unless_scenario_or_preset_says_otherwise():
    limits = {}
    for preset in ("default", "paper"):
        for stated in (None, "none"):
            scenario = validate_scenario({"planning": {"preset": preset}, "vehicle": {"pitch_max": stated}})
            limits[preset, stated] = scenario.pitch_max
    assert limits.pop(("default", None)) == pytest.approx(math.radians(30.0))
    assert set(limits.values()) == {None}
    assert validate_scenario({"vehicle": {"pitch_max": 0.3}}).pitch_max == 0.3
    for name in ("pitch_max", "climb_rate_max", "dive_rate_max"):
        with pytest.warns(ScenarioWarning, match=f"vehicle.{name} is 0.4, preset 'paper' has no such limit"):
            scenario = validate_scenario({"planning": {"preset": "paper"}, "vehicle": {name: 0.4}})
        assert getattr(scenario.vehicle, name) == 0.4


def test_a_transit_depth_is_a_depth_or_an_altitude():
    bed = {"source": "file", "file": "bed.nc"}
    site = {"longitude": 5.0, "latitude": 60.0}
    level = validate_scenario({"vehicle": {"transit_depth": 20}})
    along = validate_scenario(
        {"vehicle": {"transit_depth": {"altitude": 15}}, "bathymetry": bed, "site": site}
    )
    assert make_vehicle(validate_scenario({})).has_transit is False
    assert make_vehicle(level).transit_depth == 20.0
    assert make_vehicle(along).transit_altitude == 15.0


LISTED = {"jobs": "a.csv", "start": [9, 9, 5], "goal": [99, 99, 5]}
REFUSED = [
    ({"vehicle": {"transit_depth": -1}}, "vehicle.transit_depth"),
    ({"vehicle": {"transit_depth": {"height": 3}}}, "vehicle.transit_depth"),
    ({"vehicle": {"transit_depth": 1e5}},
     "vehicle.transit_depth: 100000 m lies outside the area or the vehicle's depths"),
    ({"vehicle": {"transit_depth": {"altitude": 15}}},
     "vehicle.transit_depth: an altitude needs a sea bed"),
    ({"vehicle": {"pitch_max": 30}},
     "vehicle.pitch_max: must be at most a right angle, 1.571 rad, got 30: 30 degrees are 0.524 rad"),
    ({"vehicle": {"pitch_max": 0}}, "vehicle.pitch_max: must be greater than 0 or must be 'none', got 0"),
    ({"vehicle": {"pitch_max": "flat"}}, "vehicle.pitch_max: must be a valid number"),
    ({"planning": {"task_time": "clock"}}, "planning.task_time: 'clock' goes with preset 'paper' alone"),
    ({"planning": {"preset": "paper", "control_points": 1}},
     "planning.control_points: must be greater than or equal to 2, got 1"),
    ({"planning": {"path_width": 0}}, "planning.path_width: must be greater than 0, got 0"),
    ({"mission": {"time_available": 1e300}},
     "mission.time_available: must be less than or equal to 315360000, got 1e+300"),
    ({"sensors": {"interval": 1e9}}, "sensors.interval: must be less than or equal to 315360000"),
    ({"planning": {"phi": [1, -1]}}, "planning.phi.1: must be greater than or equal to 0, got -1"),
    ({"planning": {"preset": "paper", "task_time": "expected"}, "mission": LISTED},
     "planning.task_time: 'expected' leaves out the time that jobs take"),
]  # fmt: skip


@pytest.mark.parametrize(("sections", "words"), REFUSED)
def test_settings_that_cannot_be_are_refused(sections, words):
    refusal(ScenarioError, re.escape(words), validate_scenario, sections)


def test_jobs_take_their_time_under_the_papers_preset():
    drawn = validate_scenario({"planning": {"preset": "paper"}})
    listed = validate_scenario({"planning": {"preset": "paper"}, "mission": LISTED})
    assert (drawn.tasks_under_way, listed.tasks_under_way) == (True, False)


def test_the_papers_preset_alone_is_warned_of_by_nothing():
    """Warnings are errors in the tests; so are settings that repeat what the preset has."""
    plain = {"planning": {"preset": "paper", "reserve": 0, "visits": "edges", "t_series": 3}}
    plain["vehicle"] = {"pitch_max": "none"}
    assert validate_scenario(plain).overrides == []
