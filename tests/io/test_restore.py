"""Saved runs come back as they were."""

import csv
import json
from datetime import UTC, datetime

import h5netcdf
import h5py
import numpy as np
import pytest
import xarray as xr

from auvplan.check.run import check_run
from auvplan.export import ExportError, export_run, itinerary_of
from auvplan.io import save_run
from auvplan.io.restore import restore_run
from auvplan.mission.timetable import Timetable
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.seabed import Seabed
from auvplan.runtime.files import ResultError
from auvplan.scenario.scenario import Scenario
from auvplan.site import Site
from tests.io.sample_run import make_run, refused_leg

SITE = Site(148.96, -20.34, datetime(2026, 11, 22, 6, tzinfo=UTC), (5000.0, 3000.0))


@pytest.fixture
def run():
    made = make_run()
    made.scenario = Scenario().model_dump(mode="json")
    made.site, made.names = SITE, ["alpha", "bravo", "charlie", "delta"]
    made.seabed = Seabed.from_depth(np.full((40, 30), 300.0), 100.0, (-500.0, -400.0), clearance=7.0)
    return made


def test_plans_tracks_and_their_currents_come_back(run, tmp_path):
    back = restore_run(save_run(run, tmp_path))
    assert (back.seed, back.start, back.goal, back.arrived) == (run.seed, run.start, run.goal, run.arrived)
    assert back.site == SITE
    assert back.names == run.names
    assert back.t_mission == run.t_mission
    np.testing.assert_array_equal(back.chart.passability, run.chart.passability)
    assert float(back.seabed.clearance) == 7.0
    np.testing.assert_allclose(back.seabed.depth_at(100.0, 200.0), 300.0)
    assert len(back.legs) == len(run.legs)
    for leg, was in zip(back.legs, run.legs, strict=True):
        assert (leg.start, leg.goal, leg.arrived, leg.followed) == (
            was.start,
            was.goal,
            was.arrived,
            was.followed,
        )
        np.testing.assert_allclose(leg.positions, was.positions, atol=1e-3)
        np.testing.assert_allclose(leg.motion.ground_velocity, was.motion.ground_velocity, atol=1e-5)
        assert leg.obstacle_kinds == list(was.obstacle_kinds)
        for plan, made in zip(leg.plans, was.plans, strict=True):
            assert plan.cause == made.cause
            np.testing.assert_allclose(plan.positions, made.positions, atol=1e-2)
            np.testing.assert_allclose(plan.motion.ground_velocity, made.motion.ground_velocity, atol=1e-5)
            here = (500.0, 700.0, 10.0, 0.0)
            np.testing.assert_allclose(plan.current(*here), made.current(*here), rtol=1e-5)


def test_routes_histories_and_figures_come_back(run, tmp_path):
    run.estimate_seconds, run.compile_seconds, run.saved_bound = 0.5, 7.25, 12.0
    run.legs.insert(1, refused_leg(run))
    run.legs[0].plans[0].history["mean"][:3] = np.inf
    back = restore_run(save_run(run, tmp_path))
    assert back.routes == run.routes
    assert back.bound == 12.0
    assert back.first_route is None
    for leg, was in zip(back.legs, run.legs, strict=True):
        for plan, made in zip(leg.plans, was.plans, strict=True):
            assert plan.history.keys() == made.history.keys()
            for name, values in made.history.items():
                np.testing.assert_allclose(plan.history[name], values, rtol=1e-6)
    again, first = back.summary(), json.loads((tmp_path / "summary.json").read_text())
    assert again == first


@pytest.mark.parametrize("change", ["as it is", "refused", "without histories", "bounded", "plan", "bare"])
def test_a_run_that_came_back_is_saved_as_it_was(run, tmp_path, change):
    run.saved_bound, plans = 12.0, [plan for leg in run.legs for plan in leg.plans]
    if change == "refused":
        run.legs.insert(1, refused_leg(run))
    elif change == "without histories":
        for plan in plans:
            plan.history = {}
    elif change == "bounded":
        plans[0].lower_bound = 100.0
        run.legs[0].current = np.full((len(run.legs[0].times), 2), 0.25)
    elif change == "plan":
        run.simulated, run.departed = False, 60.0
        run.obstacles = (KnownObstacle("buoy", (500.0, 600.0), 20.0, 0.0, np.inf, (0.1, 0.0)),)
    elif change == "bare":
        run = make_run((0, 1), chart=False, obstacles=False)
        run.scenario = Scenario().model_dump(mode="json")
    back = restore_run(save_run(run, tmp_path / "one"))
    save_run(back, tmp_path / "two")
    for name in ("mission.nc", "summary.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    histories = [plan.history for leg in back.legs for plan in leg.plans]
    assert (change == "without histories") == (not any(histories))


def test_a_restored_run_is_exported_as_the_run_itself(run, tmp_path):
    folder = save_run(run, tmp_path / "run")
    export_run(run, tmp_path / "one", ["csv", "geojson"])
    export_run(restore_run(folder), tmp_path / "two", ["csv", "geojson"])
    for name in ("itinerary.csv", "itinerary.geojson"):
        one, two = ((tmp_path / part / name).read_text() for part in ("one", "two"))
        assert len(one.splitlines()) == len(two.splitlines())
    with (tmp_path / "two" / "itinerary.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {round(float(row["surge"]), 2) for row in rows} == {2.5}
    assert "2026-11-22T06:" in one


def test_times_and_places_of_a_dated_run_are_true_ones(run, tmp_path):
    save_run(run, tmp_path)
    with xr.open_dataset(tmp_path / "mission.nc", engine="h5netcdf") as dataset:
        first = run.legs[0]
        assert dataset["time"].values[0] == np.datetime64("2026-11-22T06:00:00") + np.timedelta64(
            int(first.times[0] * 1e9), "ns"
        )
        longitude, latitude = SITE.to_geographic(first.positions[0, 0], first.positions[0, 1])
        assert float(dataset["longitude"][0]) == pytest.approx(float(longitude), abs=1e-6)
        assert float(dataset["latitude"][0]) == pytest.approx(float(latitude), abs=1e-6)
    assert check_run(tmp_path).seabed_hits == 0


def test_a_run_without_a_site_names_what_is_missing(run):
    run.site = None
    with pytest.raises(ExportError, match="section site"):
        itinerary_of(run)


def test_a_file_of_another_kind_is_one_line(run, tmp_path):
    save_run(run, tmp_path)
    text = json.loads((tmp_path / "summary.json").read_text())
    (tmp_path / "summary.json").write_text(json.dumps({key: text[key] for key in ("legs",)}))
    with pytest.raises(ResultError, match=r"summary\.json: .* is missing"):
        restore_run(tmp_path)


def test_windows_and_waiting_come_back(run, tmp_path):
    size = run.graph.size
    opens, closes = np.full((size, size, 1), -np.inf), np.full((size, size, 1), np.inf)
    opens[:, 3], closes[:, 3] = 100.0, 900.0
    still = run.graph.leg_times(1.5) - run.graph.duration
    run.graph = run.graph.with_timetable(Timetable(np.zeros(1), still[None], opens, closes))
    run.legs[1].t_wait, run.legs[1].t_hold, run.legs[2].missed = 12.0, 3.0, True
    run.routes[0].waits = [0.0, 12.0, 0.0]
    back = restore_run(save_run(run, tmp_path))
    np.testing.assert_array_equal(back.graph.timetable.opens, opens)
    np.testing.assert_array_equal(back.graph.timetable.closes, closes)
    assert [(leg.t_wait, leg.t_hold, leg.missed) for leg in back.legs] == [
        (leg.t_wait, leg.t_hold, leg.missed) for leg in run.legs
    ]
    assert back.routes[0].waits == run.routes[0].waits


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("scenario", "[1]"),
        ("seed", "x"),
        ("known_obstacles", '[{"depth_max": 1}]'),
        ("scenario", "[" * 60_000),
    ],
)
def test_attributes_of_another_kind_are_one_line(run, tmp_path, name, value):
    save_run(run, tmp_path)
    with h5py.File(tmp_path / "mission.nc", "r+") as file:
        file.attrs[name] = value
    with pytest.raises(ResultError, match=r"mission\.nc: incomplete \(") as stated:
        restore_run(tmp_path)
    assert len(str(stated.value)) < 600


@pytest.mark.parametrize("read", [restore_run, check_run])
def test_a_run_of_very_many_values_that_are_not_there(run, tmp_path, read):
    save_run(run, tmp_path)
    with h5netcdf.File(tmp_path / "mission.nc", "a") as file:
        file.dimensions["rows"] = file.dimensions["columns"] = 10**6
        file.create_variable("vast", ("rows", "columns"), "f8", chunks=(1000, 1000))
    with pytest.raises(ResultError, match="bytes of values in a file of"):
        read(tmp_path)


@pytest.mark.parametrize("read", [restore_run, check_run])
def test_a_run_whose_values_lie_in_another_file(run, tmp_path, read):
    save_run(run, tmp_path)
    with h5py.File(tmp_path / "mission.nc", "r+") as file:
        file["more"] = h5py.ExternalLink(str(tmp_path / "other.nc"), "/")
    with pytest.raises(ResultError, match="more is a link to another file"):
        read(tmp_path)


def test_a_summary_of_a_number_without_end(run, tmp_path):
    save_run(run, tmp_path)
    (tmp_path / "summary.json").write_text('{"tasks": ' + "9" * 9000 + "}")
    with pytest.raises(ResultError, match=r"summary\.json: not valid JSON"):
        restore_run(tmp_path)


def test_a_run_that_cannot_be_checked(run, tmp_path):
    save_run(run, tmp_path)
    with h5py.File(tmp_path / "mission.nc", "r+") as file:
        file.attrs["scenario"] = "{"
    with pytest.raises(ResultError, match=r"mission\.nc: cannot be checked \(JSONDecodeError"):
        check_run(tmp_path)
