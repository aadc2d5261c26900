"""The example that `auvplan init` writes: sound, deterministic, and physically what it says."""

import json
from datetime import UTC, datetime

import numpy as np
import pytest
import xarray as xr

from auvplan.io.area import load_area
from auvplan.io.example import SCENARIO, sea_bed, tide, write_example
from auvplan.runtime.files import OutputError
from auvplan.scenario.file import load_scenario
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.waypoints import make_graph


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("example") / "new" / "one"
    write_example(folder)
    return folder


@pytest.fixture(scope="module")
def area(folder):
    return load_area(load_scenario(folder / SCENARIO), folder)


def test_its_graph_holds_every_job(folder, area):
    scenario = load_scenario(folder / SCENARIO)
    graph, names = make_graph(scenario, area, np.random.default_rng(0))
    assert area.jobs is not None
    assert 6 <= len(area.jobs.points) <= 10
    assert 1 <= len(area.jobs.lines) <= 2
    assert (
        len(names)
        == graph.size
        == 2 + len(area.jobs.points) + sum(len(line.positions) for line in area.jobs.lines)
    )
    assert area.notes == ()
    total = sum(job.priority for job in (*area.jobs.points, *area.jobs.lines))
    assert total > 20.0


def test_jobs_keep_clear_of_land_and_of_the_sea_bed(area):
    assert area.chart is not None
    assert area.seabed is not None
    assert area.jobs is not None
    places = [job.position for job in area.jobs.points]
    places += [place for job in area.jobs.lines for place in job.positions]
    north, east, depth = np.array(places).T
    assert np.asarray(area.chart.distance(north, east)).min() > 200.0
    assert (np.asarray(area.seabed.shallowest_at(north, east)) - depth).min() > 5.0


def test_departure_is_the_first_time_of_the_current(folder):
    scenario = load_scenario(folder / SCENARIO)
    with xr.open_dataset(folder / "current.nc", engine="h5netcdf") as data:
        first = data["time"].values[0]
        assert len(data["time"]) == 9
        assert 5 <= len(data["depth"]) <= 6
    assert scenario.site is not None
    assert scenario.site.departure == datetime.fromisoformat(str(first)[:19]).replace(tzinfo=UTC)
    assert scenario.mission.time_available == 10_800.0
    assert scenario.vehicle.depth_max is not None


def test_the_tide_turns_slows_near_land_and_is_none_there():
    data = tide()
    east, north = data["uo"].values, data["vo"].values
    speed = np.hypot(east, north)
    assert 0.7 < np.nanmax(speed) <= 0.8
    assert np.isnan(east[0, 0]).any()
    assert (np.isnan(east) == np.isnan(north)).all()
    assert (np.isnan(east) == np.isnan(east[:1])).all(), "land does not move"
    offshore = np.unravel_index(np.nanargmax(speed[2, 0]), speed.shape[2:])
    flood, ebb = (north[:, 0, *offshore][k] for k in (2, 8))
    assert flood > 0.5 > -0.5 > ebb, "six hours lie between flood and ebb"
    deeper = speed[2, :, *offshore]
    assert (np.diff(deeper[np.isfinite(deeper)]) < 0.0).all(), "slower towards the bed"


def test_an_independent_formula_gives_the_tide_far_off_the_coast():
    data = tide()
    corner = data.isel(latitude=0, longitude=-1, depth=0)
    hours = np.arange(9.0)
    phase = 2.0 * np.pi * (hours - 2.0) / (44_714.0 / 3600.0)
    along = corner["uo"] * np.sin(np.deg2rad(330)) + corner["vo"] * np.cos(np.deg2rad(330))
    across = corner["uo"] * np.cos(np.deg2rad(330)) - corner["vo"] * np.sin(np.deg2rad(330))
    np.testing.assert_allclose(along, 0.8 * np.cos(phase), atol=1e-3)
    np.testing.assert_allclose(across, 0.12 * np.sin(phase), atol=1e-3)


def test_the_sea_bed_falls_off_from_the_coast():
    depth = sea_bed()["depth"].values
    assert np.isfinite(depth).all()
    assert 40.0 < depth.max() < 60.0
    assert depth.min() < 0.0, "land stands above the sea"


def test_files_follow_cf_and_say_that_they_are_made_up(folder):
    for name, standard in (
        ("current.nc", {"eastward_sea_water_velocity", "northward_sea_water_velocity"}),
        ("bathymetry.nc", {"sea_floor_depth_below_sea_level"}),
    ):
        with xr.open_dataset(folder / name, engine="h5netcdf") as data:
            assert "synthetic" in data.attrs["source"]
            assert data.attrs["Conventions"].startswith("CF-")
            assert standard == {field.attrs["standard_name"] for field in data.data_vars.values()}
            assert data["latitude"].attrs["units"] == "degrees_north"
    assert "OpenStreetMap" in (folder / "NOTICE.md").read_text()
    assert sum(path.stat().st_size for path in folder.iterdir()) < 1_000_000


def test_every_section_is_in_it(folder):
    text = (folder / SCENARIO).read_text()
    for name in Scenario.model_fields:
        assert f"\n{name}:" in text
    assert all(len(line) < 121 for line in text.splitlines())


def test_the_same_is_written_again(folder, tmp_path):
    for path in write_example(tmp_path / "two"):
        assert path.read_bytes() == (folder / path.name).read_bytes(), path.name


def test_nothing_is_overwritten_unless_it_is_asked_for(tmp_path):
    (tmp_path / "jobs.geojson").write_text("mine")
    with pytest.raises(OutputError, match=r"jobs\.geojson.*--force"):
        write_example(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["jobs.geojson"], "all or nothing"
    assert (tmp_path / "jobs.geojson").read_text() == "mine"
    write_example(tmp_path, force=True)
    assert json.loads((tmp_path / "jobs.geojson").read_text())["features"]


def test_a_folder_that_cannot_be_is_one_line(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="file"):
        write_example(tmp_path / "file" / "example")
    (tmp_path / "taken" / "current.nc").mkdir(parents=True)
    with pytest.raises(OutputError, match=r"current\.nc"):
        write_example(tmp_path / "taken", force=True)
