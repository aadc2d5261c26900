"""The examples that `auvplan init` writes: sound, deterministic, and physically what they say."""

import json
from datetime import UTC, datetime

import numpy as np
import pytest
import shapely
import xarray as xr

from auvplan.errors import ScenarioError
from auvplan.io.area import load_area
from auvplan.io.examine import examine_scenario
from auvplan.io.example import (
    CAUTION,
    SCENARIO,
    distance_to_coast,
    land_within,
    write_example,
    write_example_at,
)
from auvplan.runtime.files import OutputError
from auvplan.scenario.file import load_scenario
from auvplan.scenario.scenario import Scenario
from tests.io.refusals import refusal
from tests.tool import load_tool


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("example") / "new" / "one"
    write_example(folder)
    return folder


def test_it_has_jobs_in_deep_water_clear_of_land(folder):
    scenario = load_scenario(folder / SCENARIO)
    area = load_area(scenario, folder)
    assert area.jobs is not None
    assert area.chart is not None
    assert area.seabed is not None
    assert area.notes == ()
    assert 6 <= len(area.jobs.points) <= 10
    assert 1 <= len(area.jobs.lines) <= 2
    assert sum(job.priority for job in (*area.jobs.points, *area.jobs.lines)) > 20.0
    north, east, depth = np.array([place for _, place in area.jobs.places]).T
    assert np.asarray(area.chart.distance(north, east)).min() > 200.0
    assert (np.asarray(area.seabed.shallowest_at(north, east)) - depth).min() > 5.0
    assert scenario.mission.time_available == 10_800.0
    assert scenario.vehicle.depth_max is not None
    text = (folder / SCENARIO).read_text()
    assert all(f"\n{name}:" in text for name in Scenario.model_fields)
    assert all(len(line) < 121 for line in text.splitlines())


def test_its_sea_is_what_the_tool_makes_and_a_formula_says(folder):
    tool = load_tool("make_example_sea")
    with xr.open_dataset(folder / "current.nc", engine="h5netcdf", decode_times=False) as data:
        data.load()
    xr.testing.assert_identical(data, tool.tide())
    with xr.open_dataset(folder / "bathymetry.nc", engine="h5netcdf") as bed:
        xr.testing.assert_identical(bed.load(), tool.sea_bed())
    # Far off the coast: a tide of 0.8 m/s along 330 degrees, with the period of M2.
    corner = data.isel(latitude=0, longitude=-1, depth=0)
    phase = 2.0 * np.pi * (np.arange(9.0) - 2.0) / (44_714.0 / 3600.0)
    along = corner["uo"] * np.sin(np.deg2rad(330)) + corner["vo"] * np.cos(np.deg2rad(330))
    across = corner["uo"] * np.cos(np.deg2rad(330)) - corner["vo"] * np.sin(np.deg2rad(330))
    np.testing.assert_allclose(along, 0.8 * np.cos(phase), atol=1e-3)
    np.testing.assert_allclose(across, 0.12 * np.sin(phase), atol=1e-3)
    east, north = data["uo"].values, data["vo"].values
    speed = np.hypot(east, north)
    assert 0.7 < np.nanmax(speed) <= 0.8
    assert np.isnan(east[0, 0]).any()
    assert (np.isnan(east) == np.isnan(north)).all()
    assert (np.isnan(east) == np.isnan(east[:1])).all(), "land does not move"
    deeper = speed[2, :, *np.unravel_index(np.nanargmax(speed[2, 0]), speed.shape[2:])]
    assert (np.diff(deeper[np.isfinite(deeper)]) < 0.0).all(), "slower towards the bed"
    assert bed["depth"].min() < 0.0 < 40.0 < bed["depth"].max() < 60.0


def test_files_follow_cf_and_say_that_they_are_made_up(folder):
    for name, standard in (
        ("current.nc", {"eastward_sea_water_velocity", "northward_sea_water_velocity"}),
        ("bathymetry.nc", {"sea_floor_depth_below_sea_level"}),
    ):
        with xr.open_dataset(folder / name, engine="h5netcdf") as data:
            assert "synthetic" in data.attrs["source"]
            assert data.attrs["Conventions"].startswith("CF-")
            assert standard == {field.attrs["standard_name"] for field in data.data_vars.values()}
            if name == "current.nc":
                departure = datetime.fromisoformat(str(data["time"].values[0])[:19]).replace(tzinfo=UTC)
                assert load_scenario(folder / SCENARIO).site.departure == departure
    notice = (folder / "NOTICE.md").read_text()
    assert ("OpenStreetMap" in notice, "Natural Earth" in notice) == (True, False)


def test_nothing_is_overwritten_unless_it_is_asked_for(tmp_path):
    (tmp_path / "jobs.geojson").write_text("mine")
    for write in (write_example, lambda folder: write_example_at(folder, *PLACES["Oban"])):
        refusal(OutputError, r"jobs\.geojson.*--force", write, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["jobs.geojson"], "all or nothing"
    assert (tmp_path / "jobs.geojson").read_text() == "mine"
    write_example(tmp_path, force=True)
    assert json.loads((tmp_path / "jobs.geojson").read_text())["features"]
    (tmp_path / "file").write_text("in the way")
    refusal(OutputError, "file", write_example, tmp_path / "file" / "example")
    (tmp_path / "taken" / "current.nc").mkdir(parents=True)
    refusal(OutputError, r"current\.nc", write_example, tmp_path / "taken", force=True)


#: Latitude and longitude of coasts, of islands on the antimeridian, and of the open sea.
PLACES = {
    "Oban": (56.4, -5.5),
    "Auckland": (-36.85, 174.85),
    "Taveuni": (-16.65, 180.0),
    "Atlantic": (0.0, 0.0),
}


@pytest.mark.parametrize("name", PLACES)
def test_one_anywhere_is_valid_and_its_jobs_are_in_water(tmp_path, name):
    begun = write_example_at(tmp_path / "one", *PLACES[name])
    found = examine_scenario(begun.paths[0])
    assert (found.lines, found.warnings) == ([], ())
    area, mission = found.area, found.scenario.mission
    assert None not in (mission.start, mission.goal)
    places = np.array([job.position for job in area.jobs.points])
    assert len(places) == 6
    assert (np.abs(places[:, :2]) < 5000.0).all()
    if area.chart is None:
        assert name == "Atlantic"
        assert not (tmp_path / "one" / "coast.geojson").exists()
        assert "open water" in begun.notes[-1]
    else:
        assert begun.notes[-1] == CAUTION
        assert np.asarray(area.chart.distance(places[:, 0], places[:, 1])).min() > 300.0
        assert (np.asarray(area.chart.passability) == 0.0).any()
    again = write_example_at(tmp_path / "two", *PLACES[name])
    for path, other in zip(begun.paths, again.paths, strict=True):
        assert path.read_bytes() == other.read_bytes()


def test_its_coast_is_that_of_the_packaged_land(tmp_path):
    begun = write_example_at(tmp_path, *PLACES["Oban"])
    box = shapely.box(*begun.box)
    features = json.loads((tmp_path / "coast.geojson").read_text())["features"]
    written = shapely.union_all([shapely.geometry.shape(feature["geometry"]) for feature in features])
    packaged = shapely.union_all(land_within(*box.bounds))
    assert packaged.area > 0.3 * box.area
    assert shapely.symmetric_difference(shapely.intersection(written, box), packaged).area < 1e-4 * box.area
    assert "Natural Earth" in (tmp_path / "NOTICE.md").read_text()


LAND = [(2.35, 48.85), (133.0, -25.0), (178.0, 67.0), (-178.0, 67.0), (0.0, -85.0)]
WATER = [(-30.0, 40.0), (179.5, 63.5), (-175.0, -79.9)]


def test_land_of_the_world():
    for longitude, latitude in LAND + WATER:
        for turn in (0.0, 360.0):
            west, east = longitude + turn - 0.01, longitude + turn + 0.01
            found = land_within(west, latitude - 0.01, east, latitude + 0.01)
            assert bool(found) == ((longitude, latitude) in LAND)
    assert 120e3 < distance_to_coast(2.35, 48.85) < 180e3, "Paris"
    assert 1000e3 < distance_to_coast(-40.0, 32.0) < 1300e3, "from the Azores"


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((48.85, 2.35), "is on land, 1[0-9]{2} km from the sea"),
        ((95.0, 0.0), "give latitude"),
        ((56.4, -5.5, 500.0), "--size 500"),
        ((56.8, -4.2, 5.0), "too little water"),
    ],
)
def test_refusals_are_one_line_and_leave_nothing(tmp_path, place, words):
    refusal(ScenarioError, words, write_example_at, tmp_path / "none", *place)
    assert not (tmp_path / "none").exists()


def test_the_command(tmp_path, call):
    code, out, err = call("init", tmp_path / "a", "--at", "-36.85,174.85", "--size", "20")
    assert code == 0
    assert f"auvplan plan {tmp_path / 'a' / 'scenario.yaml'}" in out
    assert "no chart for navigation" in err
    assert "upper: [10000, 10000, 50]" in (tmp_path / "a" / "scenario.yaml").read_text()
    for given in (["--at", "Oban"], ["--at", "1,2,3"], ["--size", "5"], ["--at", "48.85,2.35"]):
        code, _, err = call("init", tmp_path / "b", *given)
        assert (code, len(err.splitlines())) == (2, 1)
    assert not (tmp_path / "b").exists()


@pytest.mark.slow
def test_it_can_be_planned(tmp_path, call):
    begun = write_example_at(tmp_path, *PLACES["Auckland"])
    code, out, _ = call("plan", begun.paths[0], "--out", tmp_path / "out", "--json")
    assert code == 0
    assert json.loads(out)["success"]
