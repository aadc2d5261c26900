"""The scenario that `auvplan init --at` writes anywhere at the world's coasts."""

import json

import numpy as np
import pytest
import shapely

from auvplan.errors import ScenarioError
from auvplan.io.area import load_area
from auvplan.io.examine import examine_scenario
from auvplan.io.example import write_example
from auvplan.io.example_at import CAUTION, distance_to_coast, land_within, write_example_at
from auvplan.runtime.files import OutputError
from auvplan.scenario.file import load_scenario

#: Latitude and longitude of coasts, of islands on the antimeridian, and of the open sea.
PLACES = {
    "Oban": (56.4, -5.5),
    "Auckland": (-36.85, 174.85),
    "Taveuni": (-16.65, 180.0),
    "Bering Strait": (65.7, -168.9),
    "Atlantic": (0.0, 0.0),
}


@pytest.mark.parametrize("name", PLACES)
def test_it_is_valid_and_its_jobs_are_in_water(tmp_path, name):
    begun = write_example_at(tmp_path / "one", *PLACES[name])
    found = examine_scenario(begun.paths[0])
    assert (found.lines, found.warnings) == ([], ())
    scenario = load_scenario(begun.paths[0])
    area = load_area(scenario, tmp_path / "one")
    assert area.jobs is not None
    places = np.array([job.position for job in area.jobs.points])
    assert len(places) == 6
    assert (np.abs(places[:, :2]) < 5000.0).all()
    ends = [scenario.mission.start, scenario.mission.goal]
    assert all(end is not None for end in ends)
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


def test_the_coast_is_that_of_the_packaged_land(tmp_path):
    begun = write_example_at(tmp_path, *PLACES["Oban"])
    west, south, east, north = begun.box
    box = shapely.box(west, south, east, north)
    features = json.loads((tmp_path / "coast.geojson").read_text())["features"]
    written = shapely.union_all([shapely.geometry.shape(feature["geometry"]) for feature in features])
    packaged = shapely.union_all(land_within(*box.bounds))
    assert packaged.area > 0.3 * box.area
    assert shapely.symmetric_difference(shapely.intersection(written, box), packaged).area < 1e-4 * box.area
    assert "Natural Earth" in (tmp_path / "NOTICE.md").read_text()
    write_example(tmp_path / "plain")
    assert "Natural Earth" not in (tmp_path / "plain" / "NOTICE.md").read_text(), "it has another coast"


LAND = [(2.35, 48.85), (133.0, -25.0), (178.0, 67.0), (-178.0, 67.0), (0.0, -85.0)]
WATER = [(-30.0, 40.0), (179.5, 63.5), (-175.0, -79.9)]


@pytest.mark.parametrize(("longitude", "latitude"), LAND + WATER)
def test_land_of_the_world(longitude, latitude):
    for turn in (0.0, 360.0):
        west, east = longitude + turn - 0.01, longitude + turn + 0.01
        found = land_within(west, latitude - 0.01, east, latitude + 0.01)
        assert bool(found) == ((longitude, latitude) in LAND)


def test_the_distance_to_the_coast():
    assert 120e3 < distance_to_coast(2.35, 48.85) < 180e3, "Paris"
    assert 1000e3 < distance_to_coast(-40.0, 32.0) < 1300e3, "from the Azores"


def test_refusals_are_one_line_and_leave_nothing(tmp_path):
    for place, words in (
        ((48.85, 2.35), "is on land, 1[0-9]{2} km from the sea"),
        ((95.0, 0.0), "give latitude"),
        ((56.4, -5.5, 500.0), "--size 500"),
        ((56.8, -4.2, 5.0), "too little water"),
    ):
        with pytest.raises(ScenarioError, match=words) as stated:
            write_example_at(tmp_path / "none", *place)
        assert "\n" not in str(stated.value)
    assert not (tmp_path / "none").exists()
    (tmp_path / "jobs.geojson").write_text("mine")
    with pytest.raises(OutputError, match=r"jobs\.geojson.*--force"):
        write_example_at(tmp_path, *PLACES["Oban"])
    assert [path.name for path in tmp_path.iterdir()] == ["jobs.geojson"]


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
