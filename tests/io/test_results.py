"""Runs to files and back."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from auvplan.check.run import ResultError
from auvplan.io import load_run, save_run
from auvplan.io.results import to_dataset
from auvplan.ocean.chart import Chart
from auvplan.path.motion import Motion
from auvplan.runtime.files import OutputError, output_folder, read_mission, write_atomically
from tests.io.sample_run import SPIT, make_run, refused_leg


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A run, one of whose legs was refused, the folder that it was saved to, and what is in it."""
    run, folder = make_run(), tmp_path_factory.mktemp("saved") / "out"
    run.legs.insert(1, refused_leg(run))
    save_run(run, folder)
    return run, folder, load_run(folder)


def test_summary_is_that_of_the_run(saved):
    run, folder, _ = saved
    assert json.loads((folder / "summary.json").read_text()) == json.loads(json.dumps(run.summary()))


def test_legs_come_back(saved):
    run, _, data = saved
    ends = np.cumsum(data.row_size.values)
    assert data.row_size.values[1] == 0
    assert data.row_size.sum() == data.sizes["obs"]
    for k, leg in enumerate(run.legs):
        part, count = slice(ends[k] - data.row_size.values[k], ends[k]), len(leg.obstacle_radii)
        np.testing.assert_allclose(data.obstacle_radius[k, :count], leg.obstacle_radii)
        if k == 1:
            continue
        np.testing.assert_array_equal(data.time[part], leg.times)
        np.testing.assert_array_equal(
            np.stack([data.x[part], data.y[part], data.depth[part]], 1), leg.positions
        )
        np.testing.assert_allclose(data.obstacle_position[part], leg.obstacle_positions, rtol=1e-6)
        assert (data.leg_index[part] == k).all()
        assert data.leg_t_path[k] == leg.t_path
        assert bool(data.leg_arrived[k])


def test_course_attitude_and_body_velocities_come_back(saved):
    run, _, data = saved
    motion = Motion.joined([leg.motion for leg in run.legs if len(leg.times)])
    for name, values in (
        ("course", motion.course % (2 * np.pi)),
        ("yaw", motion.yaw),
        ("pitch", motion.pitch),
    ):
        assert data[name].attrs["units"] == "degree"
        np.testing.assert_allclose(data[name], np.degrees(values), atol=1e-4)
    body = np.stack([data[name] for name in ("surge", "sway", "heave")], axis=1)
    np.testing.assert_allclose(body, motion.body_velocity, atol=1e-6)
    plans = [plan for leg in run.legs for plan in leg.plans]
    np.testing.assert_allclose(np.radians(data.plan_yaw), [plan.motion.yaw for plan in plans], atol=1e-6)
    surge = [plan.motion.body_velocity[:, 0] for plan in plans]
    np.testing.assert_allclose(data.plan_surge, surge, rtol=1e-6)


def test_plans_routes_and_graph_come_back(saved):
    run, _, data = saved
    plans = [plan for leg in run.legs for plan in leg.plans]
    np.testing.assert_allclose(data.plan_position, [plan.positions for plan in plans], rtol=1e-6)
    np.testing.assert_array_equal(data.plan_time, [plan.times for plan in plans])
    assert data.plan_leg.values.tolist() == [0, 0, 1, 2, 2, 3, 3]
    assert data.route_nodes.values.tolist() == [[0, 1, 3, 2], [1, 3, 2, -1]]
    np.testing.assert_array_equal(data.adjacency.astype(bool), run.graph.adjacency)
    np.testing.assert_array_equal(data.waypoint_position, run.graph.positions)
    meanings = data.plan_cause.flag_meanings.split()
    assert [meanings[code] for code in data.plan_cause.values] == [plan.cause for plan in plans]
    assert json.loads(data.attrs["scenario"]) == run.scenario
    assert data.attrs["seed"] == 7


def test_coast_stays_exactly_zero_and_nothing_else_is(saved):
    run, _, data = saved
    raster, land = data.passability.values, np.zeros(data.passability.shape, bool)
    land[SPIT] = True
    np.testing.assert_array_equal(raster == 0.0, land)
    assert np.abs(raster - np.asarray(run.chart.passability)).max() <= 0.5 / 255 + 1e-6
    assert (raster[0, 0]) == 1.0
    run = make_run()
    run.chart = Chart.from_passability(np.full((4, 4), 1e-4), 500.0)
    assert (to_dataset(run).passability > 0).all(), "hardly passable is not made coast"


def test_cf_conventions(saved):
    _, folder, _ = saved
    with xr.open_dataset(folder / "mission.nc", engine="h5netcdf", decode_cf=False) as raw:
        assert raw.attrs["Conventions"] == "CF-1.11"
        assert raw.attrs["featureType"] == "trajectory"
        assert raw.trajectory.attrs["cf_role"] == "trajectory_id"
        assert raw.row_size.attrs["sample_dimension"] == "obs"
        assert raw.depth.attrs["standard_name"] == "depth"
        assert raw.depth.attrs["positive"] == "down"
        assert raw.time.attrs["units"].startswith("seconds since ")
        assert set(raw.obstacle_position.attrs["coordinates"].split()) == {"time", "x", "y", "depth"}
        for name in ("time", "x", "y", "depth"):
            assert "_FillValue" not in raw[name].attrs
        for name, variable in raw.variables.items():
            assert variable.attrs["long_name"], name
    # Any reader that knows CF gets dates of it.
    with xr.open_dataset(folder / "mission.nc", engine="h5netcdf") as decoded:
        assert decoded.time.dtype.kind == "M"


@pytest.mark.parametrize("legs", [0, 1])
def test_little_to_save(tmp_path, legs):
    run = make_run((0, 1), chart=False, obstacles=False)
    if legs == 0:
        run.legs, run.routes, run.arrived, run.t_mission, run.reason = [], [], False, 0.0, ""
    save_run(run, tmp_path)
    data = load_run(tmp_path)
    assert data.sizes["leg"] == legs
    assert "passability" not in data
    assert "obstacle_position" not in data


def test_saving_again_replaces(saved, tmp_path):
    folder = Path(shutil.copytree(saved[1], tmp_path / "again"))
    save_run(make_run((0, 1), chart=False, obstacles=False), folder)
    assert load_run(folder).sizes["leg"] == 1
    assert sorted(path.name for path in folder.iterdir()) == ["mission.nc", "summary.json"]


def test_failing_writer_leaves_nothing_behind(tmp_path):
    target = tmp_path / "file.txt"
    target.write_text("old")

    def fail(path):
        path.write_text("half")
        raise RuntimeError("stopped")

    with pytest.raises(RuntimeError, match="stopped"):
        write_atomically(target, fail)
    assert [path.name for path in tmp_path.iterdir()] == ["file.txt"]
    assert target.read_text() == "old"


def test_writer_sees_suffix_and_folder(tmp_path):
    seen = []

    def write(path):
        seen.append(path)
        path.write_text("new")

    assert write_atomically(tmp_path / "picture.png", write).read_text() == "new"
    assert seen[0].suffix == ".png"
    assert seen[0].parent == tmp_path
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]


def test_refusing_system_is_one_line(tmp_path):
    with pytest.raises(OutputError, match=r"cannot write .*none/file\.txt: No such file") as raised:
        write_atomically(tmp_path / "none" / "file.txt", lambda path: path.touch())
    assert "\n" not in str(raised.value)


def test_folder_is_made_and_left_empty(tmp_path):
    folder = output_folder(tmp_path / "a" / "b")
    assert folder.is_dir()
    assert not list(folder.iterdir())


def test_folder_that_is_a_file(tmp_path):
    (tmp_path / "taken").touch()
    for path in (tmp_path / "taken", tmp_path / "taken" / "below"):
        with pytest.raises(OutputError, match=r"cannot write to folder .*taken"):
            output_folder(path)


def test_unwritable_folder(tmp_path, monkeypatch):
    # Root may write anywhere, so the system's refusal is played.
    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.touch", refuse)
    with pytest.raises(OutputError, match=r"cannot write to folder .*: Permission denied$"):
        output_folder(tmp_path)


def test_load_names_the_missing_file(tmp_path):
    with pytest.raises(ResultError, match=r"mission\.nc: no such file"):
        load_run(tmp_path)


def test_a_heap_without_an_end_is_refused(saved, tmp_path):
    """HDF5 would look for its end for ever."""
    whole = bytearray((saved[1] / "mission.nc").read_bytes())
    place = whole.find(b"GCOL")
    assert place > 0
    whole[place + 16 : place + 400] = bytes(384)
    (tmp_path / "mission.nc").write_bytes(whole)
    with pytest.raises(ResultError, match="has no end"):
        read_mission(tmp_path)
