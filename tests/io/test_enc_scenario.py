"""Missions on S-57 cells: planned, simulated, and looked at again in the cells as GDAL has them."""

import json

import numpy as np
import pytest
import shapely

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.io.examine import examine_scenario
from auvplan.io.restore import restore_run
from tests.io.currents.samples import described, regular, write
from tests.io.geo.enc_cells import Object, write_cell
from tests.io.geo.test_s57 import SEA, SHALLOWS, SLOPE, bay

pytest.importorskip("pyogrio")

SCENARIO = """name: bay
site: {longitude: 10.05, latitude: 50.05}
area: {lower: [-3000, -2500, 0], upper: [3000, 2500, 15]}
chart: {source: enc, file: cells, hazard_radius: 60}
bathymetry: {source: chart, water_level: -0.4}
safety: {seabed: 2}
current: {vortices: 1, peak_speed: 0.3}
simulation: {obstacles: {static: 0, afloat: 0, self_motivated: 0}}
mission: {waypoints: 4, time_available: 7200, start: [-2500, 2000, 3], goal: [2500, 2000, 3]}
"""
ROCK = shapely.Point(10.078, 50.049)  # on the straight way from start to goal
RANGE = shapely.box(10.07, 50.06, 10.074, 50.064)


@pytest.fixture
def scenario(tmp_path):
    """Path of a scenario with a folder of cells."""
    (tmp_path / "cells" / "XX5BAY").mkdir(parents=True)
    more = [
        Object("UWTROC", ROCK, {"WATLEV": 3, "VALSOU": 1.5, "OBJNAM": "Grim"}),
        Object("RESARE", RANGE, {"RESTRN": "7", "OBJNAM": "Range"}),
    ]
    write_cell(tmp_path / "cells" / "XX5BAY" / "XX5BAY01.000", bay(*more))
    path = tmp_path / "bay.yaml"
    path.write_text(SCENARIO)
    return path


def test_the_area_has_chart_sea_bed_and_obstacles_of_the_cells(scenario):
    area, examined = ap.load_area(ap.load_scenario(scenario)), examine_scenario(scenario)
    assert (examined.faults, [zone.name for zone in examined.closed]) == ((), ["Range"])
    assert [one.name for one in examined.area.obstacles] == ["Grim"]
    assert area.chart is not None
    assert area.seabed is not None
    assert area.site is not None
    ((name, radius, top),) = [(one.name, one.radius, one.depth_min) for one in area.obstacles]
    assert (name, radius, top) == ("Grim", 60.0, pytest.approx(1.5 - 0.4))
    assert not area.chart.is_water(*area.site.to_local(RANGE.centroid.x, RANGE.centroid.y))
    assert float(area.seabed.depth_at(2000.0, 0.0)) == pytest.approx(9.6)
    assert any("closed at all times: Range" in note for note in area.notes)


@pytest.mark.parametrize("bathymetry", ["none", "chart"])
def test_rocks_and_bed_are_as_deep_as_at_the_lowest_water_of_the_current(scenario, bathymetry):
    data = 0.1 * regular(10.0 + 0.02 * np.arange(6), 50.0 + 0.02 * np.arange(6), about=10.0, hours=[0, 1, 2])
    rise = np.broadcast_to(np.array([0.4, -0.9, 0.1])[:, None, None], (3, 6, 6))
    data = data.assign(zos=(("time", "latitude", "longitude"), rise, {"units": "m"}))
    write(described(data), scenario.parent / "tide.nc")
    text = SCENARIO.replace("{vortices: 1, peak_speed: 0.3}", "{source: file, files: tide.nc}")
    text = text.replace("{source: chart, water_level: -0.4}", f"{{source: {bathymetry}}}")
    scenario.write_text(text)
    area = ap.load_area(ap.load_scenario(scenario))
    assert [one.depth_min for one in area.obstacles] == pytest.approx([1.5 - 0.9])
    if area.seabed is not None:
        assert float(area.seabed.depth_at(2000.0, 0.0)) == pytest.approx(10.0 - 0.9)


@pytest.mark.slow
@pytest.mark.usefixtures("light_search")
@pytest.mark.parametrize("command", ["plan", "mission"])
def test_a_mission_is_free_of_faults_in_the_cells(scenario, call, command, tmp_path):
    out = tmp_path / "out"
    status, said, errors = call(command, scenario, "--out", out, "--pictures", "none")
    assert status == 0, errors
    assert "XX5BAY01.000: edition 1, update 0 of 2026-01-01, 1:25000" in said + errors
    report = check_run(out)
    assert report.ok, report.faults
    assert report.notes == []
    assert 0.0 < report.obstacle_clearance < 2000.0
    files = json.loads((out / "summary.json").read_text())["sheet"]["files"]
    assert [one["name"] for one in files] == ["cells"]
    _keeps_off(restore_run(out))
    cell = next((scenario.parent / "cells").rglob("*.000"))
    write_cell(cell, bay(Object("UWTROC", ROCK, {"WATLEV": 3, "VALSOU": 2.5, "OBJNAM": "Grim"})))
    assert check_run(out).faults == ["chart.file: cells is not the file that the run was made from"]


def _keeps_off(run):
    """Nothing that the cell closes, no rock and no shoal lies on a run's track."""
    track = np.concatenate([leg.positions for leg in run.legs if len(leg.positions)])
    depth, places = track[:, 2], run.site.to_geographic(track[:, 0], track[:, 1])
    assert shapely.contains_xy(SEA - SHALLOWS - RANGE, *places).all()
    assert depth[shapely.contains_xy(SLOPE, *places)].max(initial=0.0) < 5.0 - 0.4
    away = np.linalg.norm(track[:, :2] - run.site.to_local(ROCK.x, ROCK.y), axis=1)
    assert (away[depth > 1.5 - 0.4] > 60.0).all()


#: What the scenario has, what it has instead, and words of the line.
FAULTS = [
    ("file: cells", "file: cell", "bay.yaml:4:", "chart.file: ", "cell: No such file or directory"),
    ("upper: [3000", "upper: [9000", "chart.file: ",
     "the area reaches beyond what the cells cover (M_COVR) with "),
    ("source: enc, file: cells, hazard_radius: 60", "source: none",
     "bathymetry.source: 'chart' needs chart.source 'enc'"),
    ("goal: [2500, 2000, 3]", "goal: [-1000, -1000, 3]", "mission.goal: ",
     "lies on land or in closed water"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "words"), [(old, new, words) for old, new, *words in FAULTS])
def test_faults_are_told_by_field_and_file(scenario, old, new, words):
    scenario.write_text(SCENARIO.replace(old, new))
    (line,) = examine_scenario(scenario).lines
    assert all(part in line for part in words)


def test_settings_of_cells_count_for_nothing_with_other_charts(tmp_path):
    path = tmp_path / "open.yaml"
    path.write_text("name: a\nchart: {source: none, safety_depth: 3}\nmission: {waypoints: 3}\n")
    assert any("chart.safety_depth: has no effect" in line for line in examine_scenario(path).warnings)


def test_without_a_sea_bed_the_plan_notes_it(scenario):
    area = ap.load_area(ap.load_scenario(scenario).with_({"bathymetry": {"source": "none"}}))
    assert area.seabed is None
    words = "no sea bed is known, bathymetry.source is 'none': nothing keeps the vehicle off the bottom"
    assert words in area.notes
