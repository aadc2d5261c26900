"""Saved runs come back as they were."""

import csv
import json
import shutil
from datetime import UTC, datetime
from pathlib import Path

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


def dated():
    made = make_run()
    made.scenario = Scenario().model_dump(mode="json")
    made.site, made.names = SITE, ["alpha", "bravo", "charlie", "delta"]
    made.seabed = Seabed.from_depth(np.full((40, 30), 300.0), 100.0, (-500.0, -400.0), clearance=7.0)
    made.estimate_seconds, made.compile_seconds, made.saved_bound = 0.5, 7.25, 12.0
    made.legs.insert(1, refused_leg(made))
    made.legs[0].plans[0].history["mean"][:3] = np.inf
    return made


@pytest.fixture
def run():
    return dated()


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A run with a site, a sea bed and a refused leg, the folder that it was saved to, and what came back."""
    made = dated()
    folder = save_run(made, tmp_path_factory.mktemp("written"))
    return made, folder, restore_run(folder)


@pytest.fixture
def folder(written, tmp_path):
    """A copy of the saved run, to be spoiled."""
    return Path(shutil.copytree(written[1], tmp_path / "spoiled"))


def test_plans_tracks_and_their_currents_come_back(written):
    run, _, back = written
    assert (back.seed, back.start, back.goal, back.arrived) == (run.seed, run.start, run.goal, run.arrived)
    assert back.site == SITE
    assert back.names == run.names
    assert back.t_mission == run.t_mission
    np.testing.assert_array_equal(back.chart.passability, run.chart.passability)
    assert float(back.seabed.clearance) == 7.0
    np.testing.assert_allclose(back.seabed.depth_at(100.0, 200.0), 300.0)
    assert len(back.legs) == len(run.legs)
    for leg, was in zip(back.legs, run.legs, strict=True):
        for name in ("start", "goal", "arrived", "followed"):
            assert getattr(leg, name) == getattr(was, name)
        assert len(leg.times) == len(was.times)
        if len(was.times):
            np.testing.assert_allclose(leg.positions, was.positions, atol=1e-3)
            np.testing.assert_allclose(leg.motion.ground_velocity, was.motion.ground_velocity, atol=1e-5)
        assert leg.obstacle_kinds == list(was.obstacle_kinds)
        for plan, made in zip(leg.plans, was.plans, strict=True):
            assert plan.cause == made.cause
            np.testing.assert_allclose(plan.positions, made.positions, atol=1e-2)
            np.testing.assert_allclose(plan.motion.ground_velocity, made.motion.ground_velocity, atol=1e-5)
            here = (500.0, 700.0, 10.0, 0.0)
            np.testing.assert_allclose(plan.current(*here), made.current(*here), rtol=1e-5)


def test_routes_histories_and_figures_come_back(written):
    run, folder, back = written
    assert back.routes == run.routes
    assert back.bound == 12.0
    assert back.first_route is None
    for leg, was in zip(back.legs, run.legs, strict=True):
        for plan, made in zip(leg.plans, was.plans, strict=True):
            assert plan.history.keys() == made.history.keys()
            for name, values in made.history.items():
                np.testing.assert_allclose(plan.history[name], values, rtol=1e-6)
    assert back.summary() == json.loads((folder / "summary.json").read_text())


@pytest.mark.parametrize("change", ["as it is", "bounded plan without histories", "bare"])
def test_a_run_that_came_back_is_saved_as_it_was(written, run, tmp_path, change):
    _, one, back = written
    if change == "bare":
        run = make_run((0, 1), chart=False, obstacles=False)
        run.scenario = Scenario().model_dump(mode="json")
    elif change != "as it is":
        for plan in (plan for leg in run.legs for plan in leg.plans):
            plan.history, plan.lower_bound = {}, 100.0
        run.legs[0].current = np.full((len(run.legs[0].times), 2), 0.25)
        run.simulated, run.departed = False, 60.0
        run.obstacles = (KnownObstacle("buoy", (500.0, 600.0), 20.0, 0.0, np.inf, (0.1, 0.0)),)
    if change != "as it is":
        one = save_run(run, tmp_path / "one")
        back = restore_run(one)
    save_run(back, tmp_path / "two")
    for name in ("mission.nc", "summary.json"):
        assert (one / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    histories = [plan.history for leg in back.legs for plan in leg.plans]
    assert ("without histories" in change) == (not any(histories))


def test_a_restored_run_is_exported_as_the_run_itself(written, tmp_path):
    run, _, back = written
    export_run(run, tmp_path / "one", ["csv", "geojson"])
    export_run(back, tmp_path / "two", ["csv", "geojson"])
    for name in ("itinerary.csv", "itinerary.geojson"):
        one, two = ((tmp_path / part / name).read_text() for part in ("one", "two"))
        assert len(one.splitlines()) == len(two.splitlines())
    with (tmp_path / "two" / "itinerary.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {round(float(row["surge"]), 2) for row in rows} == {2.5}
    assert "2026-11-22T06:" in one


def test_times_and_places_of_a_dated_run_are_true_ones(written):
    run, folder, _ = written
    with xr.open_dataset(folder / "mission.nc", engine="h5netcdf") as dataset:
        first = run.legs[0]
        since = np.timedelta64(int(first.times[0] * 1e9), "ns")
        assert dataset["time"].values[0] == np.datetime64("2026-11-22T06:00:00") + since
        place = SITE.to_geographic(first.positions[0, 0], first.positions[0, 1])
        for name, degrees in zip(("longitude", "latitude"), place, strict=True):
            assert float(dataset[name][0]) == pytest.approx(float(degrees), abs=1e-6)
    assert check_run(folder).seabed_hits == 0


def test_a_run_without_a_site_names_what_is_missing(run):
    run.site = None
    with pytest.raises(ExportError, match="section site"):
        itinerary_of(run)


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


def attribute(name, value):
    def spoil(folder):
        with h5py.File(folder / "mission.nc", "r+") as file:
            file.attrs[name] = value

    return spoil


def vast(folder):
    with h5netcdf.File(folder / "mission.nc", "a") as file:
        file.dimensions["rows"] = file.dimensions["columns"] = 10**6
        file.create_variable("vast", ("rows", "columns"), "f8", chunks=(1000, 1000))


def linked(folder):
    with h5py.File(folder / "mission.nc", "r+") as file:
        file["more"] = h5py.ExternalLink(str(folder / "other.nc"), "/")


def summary(text):
    return lambda folder: (folder / "summary.json").write_text(text)


@pytest.mark.parametrize(
    ("spoil", "reads", "words"),
    [
        (attribute("scenario", "[1]"), [restore_run], r"mission\.nc: incomplete \("),
        (attribute("scenario", "[" * 60_000), [restore_run], r"mission\.nc: incomplete \("),
        (attribute("seed", "x"), [restore_run], r"mission\.nc: incomplete \("),
        (attribute("known_obstacles", '[{"depth_max": 1}]'), [restore_run], r"mission\.nc: incomplete \("),
        (attribute("scenario", "{"), [check_run], r"mission\.nc: cannot be checked \(JSONDecodeError"),
        (vast, [restore_run, check_run], "bytes of values in a file of"),
        (linked, [restore_run, check_run], "more is a link to another file"),
        (summary('{"tasks": ' + "9" * 9000 + "}"), [restore_run], r"summary\.json: not valid JSON"),
        (summary('{"legs": []}'), [restore_run], r"summary\.json: .* is missing"),
    ],
)
def test_what_is_wrong_with_a_saved_run_is_one_line(folder, spoil, reads, words):
    spoil(folder)
    for read in reads:
        with pytest.raises(ResultError, match=words) as stated:
            read(folder)
        assert len(str(stated.value)) < 600
