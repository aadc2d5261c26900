"""Pages hold all that a result has, in one file that asks for nothing and is the same each time."""

import base64
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from auvplan.report import write_report, write_run_report
from auvplan.report.area import current_data, map_data
from auvplan.report.page import asset, packed, plain, script_json
from auvplan.report.run import obstacle_data, run_data
from auvplan.report.study import study_data
from auvplan.runtime.files import REPORT, RESULTS, ResultError, write_dataset
from auvplan.scenario.scenario import Scenario
from auvplan.site import Site
from auvplan.view.sheet import waypoint_name
from tests.io.sample_run import make_closure, make_run, refused_leg
from tests.plot.sample_study import make_study, without_legs
from tests.report.conftest import HOSTILE, save

#: What a page would load something with.
LOADS = re.compile(
    r"""(?:src|href|action|poster|srcset)\s*=\s*["']?\s*(?:https?:)?//|url\(\s*["']?(?:https?:)?//|@import"""
    r"""|\bfetch\(|XMLHttpRequest|\bimport\(|WebSocket|sendBeacon|EventSource""",
    re.IGNORECASE,
)


def data_of(page):
    text = page.read_text(encoding="utf-8")
    return json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])


def unpacked(array):
    kinds = {"f32": "<f4", "i16": "<i2", "i32": "<i4"}
    values = np.frombuffer(base64.b64decode(array["data"]), kinds[array["kind"]])
    return values.reshape(array["shape"]) * array["step"]


def test_areas_that_close_are_in_the_page():
    run = make_run()
    run.closures = (make_closure().widened(run.safety.closing - 30.0),)
    (closure,) = run_data(run, run.summary())["closures"]
    assert closure["name"].startswith("band")
    np.testing.assert_allclose(closure["spans"], [[100.0, 200.0]])
    (ring,) = closure["rings"]
    np.testing.assert_allclose(
        [ring.min(axis=0), ring.max(axis=0)], [[500.0, 0.0], [700.0, 2000.0]], atol=0.2
    )


def test_a_run_is_in_its_page(run, run_page):
    data = data_of(run_page)
    assert len(data["legs"]) == len(run.legs)
    assert [leg["to"] for leg in data["legs"]] == [leg.goal for leg in run.legs]
    assert [leg["executed"] for leg in data["legs"]] == pytest.approx([leg.t_path for leg in run.legs])
    assert len(data["plans"]) == sum(len(leg.plans) for leg in run.legs)
    track = {
        name: unpacked(data["track"][name]) for name in ("time", "north", "east", "depth", "bed", "coast")
    }
    times = np.concatenate([leg.times for leg in run.legs])
    places = np.concatenate([leg.positions for leg in run.legs])
    np.testing.assert_allclose(track["time"], times, atol=1e-2)
    np.testing.assert_allclose(
        np.stack([track["north"], track["east"], track["depth"]], 1), places, atol=1e-2
    )
    # The least on the way to the next record.
    ways = [np.linspace(leg.positions, [*leg.positions[1:], leg.positions[-1]], 61) for leg in run.legs]
    beds = [run.seabed.altitude(way.reshape(-1, 3)).reshape(way.shape[:2]).min(axis=0) for way in ways]
    np.testing.assert_allclose(track["bed"], np.concatenate(beds), atol=0.06)
    size, corner = float(run.chart.pixel_size), np.asarray(run.chart.origin)[:2]
    land = corner + size * (np.argwhere(np.asarray(run.chart.passability) == 0.0) + 0.5)

    def to_land(way):
        beyond = np.maximum(np.abs(way[..., None, :2] - land) - 0.5 * size, 0.0)
        return np.linalg.norm(beyond, axis=-1).min(axis=(0, 2))

    np.testing.assert_allclose(track["coast"], np.concatenate([to_land(way) for way in ways]), atol=0.06)
    assert data["tasks"][0]["done"]
    assert [route["cause"] for route in data["routes"]] == ["start", "late", "done"]
    assert len(data["routes"][-1]["bars"]) == len(run.legs)


def test_arrows_are_the_current_of_the_plan_at_the_vehicles_depth(run, run_page):
    found = data_of(run_page)["current"]
    u, v = unpacked(found["u"]), unpacked(found["v"])
    assert u.shape == (len(found["times"]), len(found["north"]), len(found["east"]))
    plan = run.legs[0].plans[0]
    for k in (0, 3):
        assert found["times"][k] < run.legs[0].plans[1].made_at
        i, j = 2, 5
        there = plan.current(found["north"][i], found["east"][j], found["depths"][k], found["times"][k])
        np.testing.assert_allclose([u[k, i, j], v[k, i, j]], np.asarray(there)[:2], atol=1e-3)
    times, depths = run.legs[0].times, run.legs[0].positions[:, 2]
    assert found["depths"][3] == pytest.approx(np.interp(found["times"][3], times, depths), abs=0.1)


def test_land_has_a_colour_and_no_arrows(run):
    low, high = np.array([1300.0, 1450.0]), np.array([1450.0, 1560.0])
    chart = map_data(low, high, run.chart, run.seabed, run.site)["chart"]
    with Image.open(io.BytesIO(base64.b64decode(chart["light"].partition(",")[2]))) as picture:
        kinds = np.asarray(picture)[::-1]
    np.testing.assert_array_equal(kinds == 1, np.asarray(run.chart.passability)[130:145, 145:156] == 0.0)
    assert set(np.unique(kinds)) == {1, 2}
    assert chart["uncertain"]
    found = current_data(run, low, high, run.legs[0].times, run.legs[0].positions[:, 2])
    on_land = ~run.chart.is_water(*np.meshgrid(found["north"], found["east"], indexing="ij"))
    assert on_land.any()
    assert (unpacked(found["u"])[:, on_land] == -32768 * 0.001).all()
    assert (unpacked(found["u"])[:, ~on_land] > -5.0).all()


def test_longitudes_of_a_map_go_on_beyond_180_degrees():
    site = Site(179.99, -17.0)
    frame = np.array([-3000.0, -2200.0]), np.array([3000.0, 2200.0])
    corners = np.asarray(map_data(*frame, None, None, site)["corners"])
    assert (corners[[1, 3], 0] > 180.0).all()
    assert (np.ptp(corners, axis=0) < 0.1).all()
    north, east = site.to_local(*corners.T)
    np.testing.assert_allclose(north, [-3000.0, -3000.0, 3000.0, 3000.0], atol=0.01)
    np.testing.assert_allclose(east, [-2200.0, 2200.0, -2200.0, 2200.0], atol=0.01)


def test_boundaries_are_told_by_looks_within_range_of_obstacles_that_are_anywhere_near(run):
    leg = run.legs[0]
    found = obstacle_data(run, leg, np.arange(len(leg.times)))
    assert found["kinds"] == leg.obstacle_kinds
    np.testing.assert_allclose(unpacked(found["places"]), leg.obstacle_positions, atol=1e-2)
    for m, looks in enumerate(found["looks"]):
        at = np.searchsorted(leg.times, looks)
        away = np.linalg.norm(leg.positions[at] - leg.obstacle_positions[at, m], axis=1)
        assert (away - leg.obstacle_radii[m] <= 600.0).all()
        np.testing.assert_allclose(np.diff(looks) % 30.0, 0.0, atol=1e-9)
        assert looks[0] > leg.times[0]
    away = replace(leg, obstacle_positions=leg.obstacle_positions + np.array([[[0.0], [1e6]]]))
    assert obstacle_data(run, away, np.arange(3))["kinds"] == leg.obstacle_kinds[:1]


def test_a_page_loads_nothing_and_is_small_and_names_stay_texts(run_page, study_page):
    library = asset("plotly-cartesian.min.js")
    for page in (run_page, study_page):
        text = page.read_text(encoding="utf-8")
        assert library in text
        assert not LOADS.search(text.replace(library, ""))
        # The library knows how to ask a server for maps of the world; the browser does not let it.
        assert "default-src 'none'" in text
        assert page.stat().st_size < 2_500_000
        assert text.count("</script>") == 3
    text, data = run_page.read_text(encoding="utf-8"), data_of(run_page)
    assert "<script>alert" not in text
    assert "<title>&lt;/script&gt;" in text
    assert (data["name"], data["waypoints"][1]["name"]) == (HOSTILE, HOSTILE)


def test_the_same_bytes_again_and_from_the_run_itself(run, run_page, tmp_path):
    first = run_page.read_bytes()
    assert write_report(run_page.parent).read_bytes() == first
    summary = json.loads((run_page.parent / "summary.json").read_text())
    assert write_run_report(run, summary, tmp_path).read_bytes() == first
    assert sorted(path.name for path in tmp_path.iterdir()) == [REPORT]
    assert REPORT in RESULTS, "a run that begins anew replaces the page"


#: Kinds of runs whose pages differ little from those of others.
RARER = "not begun", "open leg"


@pytest.mark.parametrize(
    "change", ["refused", "no legs", "plan", *(pytest.param(kind, marks=pytest.mark.slow) for kind in RARER)]
)
def test_runs_of_all_kinds_have_pages(tmp_path, change):
    run = make_run((0, 1), chart=False, obstacles=False) if change == "open leg" else make_run()
    run.scenario = Scenario().model_dump(mode="json")
    if change == "refused":
        run.legs.insert(1, refused_leg(run))
    elif change == "not begun":
        run.legs = [refused_leg(run)]
    elif change == "no legs":
        run.legs, run.routes = [], []
    elif change == "plan":
        run.simulated = False
    page = write_report(save(run, tmp_path))
    data = data_of(page)
    assert len(data["legs"]) == len(run.legs)
    assert data["kind"] == ("plan" if change == "plan" else "mission")
    left = {task["name"] for task in data["tasks"] if not task["done"]}
    assert left == {waypoint_name(run, node) for node in set(range(4)) - set(run.route)}


def test_a_long_run_is_thinned(run, monkeypatch):
    monkeypatch.setattr("auvplan.report.run._RECORDS", 100)
    data = run_data(run, run.summary())
    times = unpacked(data["track"]["time"])
    assert 50 < len(times) <= 100 + 2 * len(run.legs)
    for leg in run.legs:
        assert np.isclose(times, leg.times[-1], atol=1e-2).any()


def test_a_study_is_in_its_page(study_page):
    data, study = data_of(study_page), make_study(8, {"vehicle.speed": [2.0, 2.5]}, first_seed=3)
    assert data["sweeps"] == [{"field": "vehicle.speed", "values": [2.0, 2.5]}]
    assert data["runs"] == ["0001-00000004"]
    assert data["scenario"] == "whitsunday"
    assert len(data["cases"]) == 2
    for k, case in enumerate(data["cases"]):
        assert case["figures"]["t_mission"] == pytest.approx(study["t_mission"].values[k], rel=1e-5)
        assert case["success"] == [seed != 5 for seed in data["seeds"]]
        assert len(case["missions"]) == 8
        legs = case["missions"][0]["legs"]
        assert [leg[1] for leg in legs] == [node for node in study["leg_to"].values[k, 0] if node >= 0]
        assert len(unpacked(case["legs"]["executed"])) == int((study["leg_arrived"].values[k] == 1).sum())


def test_a_large_study_holds_details_of_some_and_figures_of_all(monkeypatch):
    monkeypatch.setattr("auvplan.report.study._DETAILED", 3)
    data = study_data(make_study(8))
    assert len(data["cases"][0]["missions"]) == 3
    assert len(data["cases"][0]["figures"]["t_mission"]) == 8


def test_a_study_without_legs_has_a_page():
    data = study_data(without_legs(make_study(3, chart=False)))
    assert data["map"] is None or data["map"]["chart"] is None
    assert all(mission["legs"] == [] for mission in data["cases"][0]["missions"])
    script_json(data)


#: A table of one departure.
TABLE = "departure_utc,feasible,best,total_priority,reason\n2026-03-01T00:00:00Z,true,true,7,\n"


def test_departures_have_a_page(tmp_path):
    head = "departure_utc,departure_s,feasible,best,time_s,tasks,total_priority,waypoints,current_m_s,reason"
    rows = ["2026-03-01T00:00:00Z,0.0,true,true,900.5,2,7,a > b,0.4,", ",3600.0,false,false,,,,,0.9,too late"]
    (tmp_path / "departures.csv").write_text("\n".join([head, *rows]) + "\n")
    data = data_of(write_report(tmp_path))
    assert [row["feasible"] for row in data["departures"]] == [True, False]
    assert data["departures"][0]["total_priority"] == 7
    assert data["departures"][1]["time_s"] is None
    assert data["provenance"]["settings"] is None
    stated = {"scenario": Scenario(name="tide").model_dump(mode="json"), "seed": 4}
    (tmp_path / "departures.json").write_text(json.dumps(stated))
    data = data_of(write_report(tmp_path))
    assert (data["name"], data["provenance"]["seed"]) == ("tide", 4)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such folder"),
        ({}, "no run, study or departures in it"),
        ({"departures.csv": "a,b\n1,2\n"}, "departures.csv: not a table of departures"),
        ({"departures.csv": "departure_utc,reason,feasible,best\n"}, "no departures in it"),
        ({"departures.csv": TABLE, "departures.json": '{"scenario": 3}'}, "scenario is not a table"),
        ({"departures.csv": TABLE, "departures.json": '{"notes": {}}'}, "notes is not a list"),
        ({"departures.csv": TABLE, "departures.json": '{"seed": ' + "9" * 9000 + "}"}, "not valid JSON"),
        (
            {"departures.csv": TABLE, "departures.json": '{"scenario": {"mission": 1}}'},
            "mission is not a table",
        ),
        ({"mission.nc": "nonsense"}, "summary.json: no such file"),
        ({"study.json": "{}"}, "missions.nc: no such file"),
    ],
)
def test_what_is_no_result_is_named_in_one_line(tmp_path, content, words):
    folder = tmp_path / "out"
    if content is not None:
        folder.mkdir()
        for name, text in content.items():
            (folder / name).write_text(text)
    with pytest.raises(ResultError, match=re.escape(words)) as error:
        write_report(folder)
    assert len(str(error.value).splitlines()) == 1
    assert not (folder / REPORT).exists()


def test_packed_numbers_come_back():
    values = np.array([[0.0, -1.25], [3.5, 7.0]])
    np.testing.assert_array_equal(unpacked(packed(values)), values)
    np.testing.assert_allclose(unpacked(packed(values, "i16", 0.01)), values, atol=0.005)
    assert plain({"a": np.float64(np.nan), 2: (np.int64(3), 1.23456789)}) == {"a": None, "2": [3, 1.234568]}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda study: study.drop_vars("cost_mission"), "variable cost_mission is missing"),
        (lambda study: study.assign(tasks=study["tasks"].expand_dims("x")), "variable tasks has dimensions"),
        (lambda study: study.assign(tasks=study["tasks"].isel(mission=0)), "variable tasks has dimensions"),
        (lambda study: study.assign(tasks=study["tasks"].astype(str)), "variable tasks holds no numbers"),
    ],
)
def test_a_study_without_what_its_page_shows(tmp_path, change, words):
    (tmp_path / "study.json").write_text("{}")
    write_dataset(change(make_study(3)), tmp_path / "missions.nc")
    with pytest.raises(ResultError, match=words):
        write_report(tmp_path)
