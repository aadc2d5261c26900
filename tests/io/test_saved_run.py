"""Runs to files and back: the tables of a run, what `restore_run` makes of them, and damaged files."""

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
from auvplan.io import load_run, save_run
from auvplan.io.restore import restore_run
from auvplan.io.results import to_dataset
from auvplan.mission.timetable import Timetable
from auvplan.ocean.chart import Chart
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.seabed import Seabed
from auvplan.path.motion import Motion
from auvplan.runtime.files import ResultError, read_mission
from auvplan.scenario.scenario import Scenario
from auvplan.site import Site
from tests.io.refusals import refusal
from tests.io.sample_run import SPIT, at_speeds, make_run, refused_leg

SITE = Site(148.96, -20.34, datetime(2026, 11, 22, 6, tzinfo=UTC), (5000.0, 3000.0))


def dated():
    """A run with a site, a sea bed and a refused leg."""
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
    """The run, the folder that it was saved to, what came back, and the dataset."""
    made = dated()
    folder = save_run(made, tmp_path_factory.mktemp("written"))
    return made, folder, restore_run(folder), load_run(folder)


@pytest.fixture
def folder(written, tmp_path):
    """A copy of the saved run, to be spoiled."""
    return Path(shutil.copytree(written[1], tmp_path / "spoiled"))


def test_figures_of_the_run_come_back(written):
    run, folder, back, data = written
    kept = json.loads((folder / "summary.json").read_text())
    assert kept == json.loads(json.dumps(run.summary())) == back.summary()
    for name in ("seed", "start", "goal", "arrived", "site", "names", "t_mission", "routes"):
        assert getattr(back, name) == getattr(run, name), name
    assert (back.bound, back.first_route) == (12.0, None)
    assert float(back.seabed.clearance) == 7.0
    np.testing.assert_allclose(back.seabed.depth_at(100.0, 200.0), 300.0)
    np.testing.assert_array_equal(back.graph.adjacency, run.graph.adjacency)
    np.testing.assert_array_equal(back.graph.positions, run.graph.positions)
    assert json.loads(data.attrs["scenario"]) == run.scenario
    assert data.attrs["seed"] == 7


def test_legs_and_plans_come_back(written):
    run, _, back, data = written
    assert data.row_size.values[1] == 0
    assert data.plan_leg.values.tolist() == [0, 0, 1, 2, 2, 3, 3]
    assert data.route_nodes.values.tolist() == [[0, 1, 3, 2], [1, 3, 2, -1]]
    for k, (leg, was) in enumerate(zip(back.legs, run.legs, strict=True)):
        for name in ("start", "goal", "arrived", "followed", "t_path", "obstacle_kinds"):
            assert getattr(leg, name) == getattr(was, name), name
        assert (data.leg_index[data.leg_index == k].size, data.leg_t_path[k]) == (len(was.times), was.t_path)
        np.testing.assert_array_equal(leg.times, was.times)
        np.testing.assert_array_equal(leg.positions, was.positions)
        np.testing.assert_allclose(leg.obstacle_radii, was.obstacle_radii)
        if len(was.times):
            np.testing.assert_allclose(leg.obstacle_positions, was.obstacle_positions, rtol=1e-6)
            np.testing.assert_allclose(leg.motion.ground_velocity, was.motion.ground_velocity, atol=1e-5)
        for plan, made in zip(leg.plans, was.plans, strict=True):
            assert plan.cause == made.cause
            np.testing.assert_array_equal(plan.times, made.times)
            np.testing.assert_allclose(plan.positions, made.positions, rtol=1e-6)
            np.testing.assert_allclose(plan.motion.ground_velocity, made.motion.ground_velocity, atol=1e-5)
            here = (500.0, 700.0, 10.0, 0.0)
            np.testing.assert_allclose(plan.current(*here), made.current(*here), rtol=1e-5)
            assert plan.history.keys() == made.history.keys()
            for name, values in made.history.items():
                np.testing.assert_allclose(plan.history[name], values, rtol=1e-6)


def test_course_attitude_and_body_velocities_are_filed(written):
    run, _, _, data = written
    motion = Motion.joined([leg.motion for leg in run.legs if len(leg.times)])
    for name, values in (
        ("course", motion.course % (2 * np.pi)),
        ("yaw", motion.yaw),
        ("pitch", motion.pitch),
    ):
        assert data[name].attrs["units"] == "degree"
        np.testing.assert_allclose(data[name], np.degrees(values), atol=1e-4)
    for name in ("course", "yaw", "plan_course", "plan_yaw"):
        assert data[name].attrs["long_name"].endswith("clockwise from the local frame's north")
        assert "standard_name" not in data[name].attrs
    body = np.stack([data[name] for name in ("surge", "sway", "heave")], axis=1)
    np.testing.assert_allclose(body, motion.body_velocity, atol=1e-6)
    plans = [plan.motion for leg in run.legs for plan in leg.plans]
    np.testing.assert_allclose(np.radians(data.plan_yaw), [plan.yaw for plan in plans], atol=1e-6)
    np.testing.assert_allclose(data.plan_surge, [plan.body_velocity[:, 0] for plan in plans], rtol=1e-6)


def test_coast_stays_exactly_zero_and_nothing_else_is(written):
    run, _, back, data = written
    raster, land = data.passability.values, np.zeros(data.passability.shape, bool)
    land[SPIT] = True
    np.testing.assert_array_equal(raster == 0.0, land)
    np.testing.assert_array_equal(back.chart.passability, run.chart.passability)
    assert np.abs(raster - np.asarray(run.chart.passability)).max() <= 0.5 / 255 + 1e-6
    assert (raster[0, 0]) == 1.0
    run = make_run()
    run.chart = Chart.from_passability(np.full((4, 4), 1e-4), 500.0)
    assert (to_dataset(run).passability > 0).all(), "hardly passable is not made coast"


def test_cf_conventions(written):
    run, folder, _, _ = written
    with xr.open_dataset(folder / "mission.nc", engine="h5netcdf", decode_cf=False) as raw:
        assert raw.attrs["Conventions"] == "CF-1.11"
        assert raw.attrs["featureType"] == "trajectory"
        assert raw.trajectory.attrs["cf_role"] == "trajectory_id"
        assert raw.row_size.attrs["sample_dimension"] == "obs"
        assert raw.depth.attrs["standard_name"] == "depth"
        assert raw.depth.attrs["positive"] == "down"
        coordinates = {"time", "x", "y", "depth", "longitude", "latitude"}
        assert set(raw.obstacle_position.attrs["coordinates"].split()) == coordinates
        for name in ("time", "x", "y", "depth"):
            assert "_FillValue" not in raw[name].attrs
        for name, variable in raw.variables.items():
            assert variable.attrs["long_name"], name
            assert len(variable.attrs.get("units", "")) < 40, name
    # Any reader that knows CF gets dates of it.
    first = run.legs[0]
    place = SITE.to_geographic(first.positions[0, 0], first.positions[0, 1])
    with xr.open_dataset(folder / "mission.nc", engine="h5netcdf") as dataset:
        since = np.timedelta64(int(first.times[0] * 1e9), "ns")
        assert dataset["time"].values[0] == np.datetime64("2026-11-22T06:00:00") + since
        for name, degrees in zip(("longitude", "latitude"), place, strict=True):
            assert float(dataset[name][0]) == pytest.approx(float(degrees), abs=1e-6)
    assert check_run(folder).seabed_hits == 0


def test_little_to_save_replaces_what_was_there(folder):
    run = make_run((0, 1), chart=False, obstacles=False)
    run.legs, run.routes, run.arrived, run.t_mission, run.reason = [], [], False, 0.0, ""
    save_run(run, folder)
    data = load_run(folder)
    assert data.sizes["leg"] == 0
    assert "passability" not in data
    assert "obstacle_position" not in data
    assert sorted(path.name for path in folder.iterdir()) == ["mission.nc", "summary.json"]


def _wait_for_windows(run):
    """A run in which a task had to be waited for, and another was missed."""
    size = run.graph.size
    opens, closes = np.full((size, size, 1), -np.inf), np.full((size, size, 1), np.inf)
    opens[:, 3], closes[:, 3] = 100.0, 900.0
    still = run.graph.leg_times(1.5) - run.graph.duration
    run.graph = run.graph.with_timetable(Timetable(np.zeros(1), still[None], opens, closes))
    run.legs[1].t_wait, run.legs[1].t_hold, run.legs[2].missed = 12.0, 3.0, True
    run.routes[0].waits, run.followable = [0.0, 12.0, 0.0], np.full((size, size), 0.25)


@pytest.mark.parametrize("change", ["as it is", "bounded plan without histories", "bare", "at speeds"])
def test_a_run_that_came_back_is_saved_as_it_was(written, run, tmp_path, change):
    _, one, back, _ = written
    if change == "bare":
        run = make_run((0, 1), chart=False, obstacles=False)
        run.scenario = Scenario().model_dump(mode="json")
    elif change == "at speeds":
        run = at_speeds(make_run(), (2.0, None, 3.0))
        run.scenario = Scenario().model_dump(mode="json")
        run.routes[0].energies = [1e5, 2e5, 3e5]
    elif change != "as it is":
        for plan in (plan for leg in run.legs for plan in leg.plans):
            plan.history, plan.lower_bound = {}, 100.0
        run.legs[0].current = np.full((len(run.legs[0].times), 2), 0.25)
        run.simulated, run.departed = False, 60.0
        run.obstacles = (KnownObstacle("buoy", (500.0, 600.0), 20.0, 0.0, np.inf, (0.1, 0.0)),)
        _wait_for_windows(run)
    if change != "as it is":
        one = save_run(run, tmp_path / "one")
        back = restore_run(one)
    save_run(back, tmp_path / "two")
    for name in ("mission.nc", "summary.json"):
        assert (one / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    speeds = [2.0, None, 3.0] if change == "at speeds" else [None] * len(back.legs)
    assert [leg.speed for leg in back.legs] == speeds
    assert ("leg_speed" in load_run(one)) == ("route_speed" in load_run(one)) == (change == "at speeds")
    stated = [row.get("speed") for row in json.loads((one / "summary.json").read_text())["legs"]]
    assert stated == speeds
    for route, was in zip(back.routes, run.routes, strict=True):
        assert (route.waits, route.speeds, route.energies) == (was.waits, was.speeds, was.energies)
    for leg, was in zip(back.legs, run.legs, strict=True):
        assert (leg.t_wait, leg.t_hold, leg.missed) == (was.t_wait, was.t_hold, was.missed)
    for table, was in ((back.graph.timetable, run.graph.timetable), (back, run)):
        for name in ("opens", "closes", "followable"):
            np.testing.assert_array_equal(getattr(table, name, None), getattr(was, name, None))
    histories = [plan.history for leg in back.legs for plan in leg.plans]
    assert ("without histories" in change) == (not any(histories))


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


def endless(folder):
    """A heap for whose end HDF5 would look for ever."""
    whole = bytearray((folder / "mission.nc").read_bytes())
    place = whole.find(b"GCOL")
    assert place > 0
    whole[place + 16 : place + 400] = bytes(384)
    (folder / "mission.nc").write_bytes(whole)


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
        (endless, [read_mission], "has no end"),
        (summary('{"tasks": ' + "9" * 9000 + "}"), [restore_run], r"summary\.json: not valid JSON"),
        (summary('{"legs": []}'), [restore_run], r"summary\.json: .* is missing"),
        (lambda folder: (folder / "mission.nc").unlink(), [load_run], r"mission\.nc: no such file"),
    ],
)
def test_what_is_wrong_with_a_saved_run_is_one_line(folder, spoil, reads, words):
    spoil(folder)
    for read in reads:
        assert len(str(refusal(ResultError, words, read, folder))) < 600
