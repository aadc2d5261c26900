"""`docs/first-plan.md` as it stands: its blocks make the files, its commands the vehicle's files."""

import contextlib
import csv
import hashlib
import io
import json
import re
import shlex
from pathlib import Path

import fastkml
import numpy as np
import pytest
import shapely
import xarray as xr
from fastkml.utils import find_all
from lxml import etree
from PIL import Image
from pyproj import Transformer

from auvplan import cli

pytestmark = pytest.mark.slow

PAGE = Path(__file__).parent.parent / "docs" / "first-plan.md"
BLOCK = re.compile(r"^```(.+?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LAND = (0xD8, 0xB2, 0x6E)
UTM = Transformer.from_crs(4326, 32626, always_xy=True)


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """Each command, what it says on the page, and what it said; all files are in the current folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("bay"))
        patch.setenv("COLUMNS", "100")
        yield list(run_page(patch))


def run_page(patch):
    command, words = [], io.StringIO()
    for info, body in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        match info.split():
            case ["python"]:
                exec(compile(body, str(PAGE), "exec"), {})
            case [_, name]:
                Path(name).write_text(body, encoding="utf-8")
            case ["sh"]:
                (line,) = body.splitlines()
                command = shlex.split(line)
                assert command[0] == "auvplan"
                patch.setattr("sys.argv", command)
                words = io.StringIO()
                with pytest.raises(SystemExit) as stop, contextlib.redirect_stdout(words):
                    cli.main()
                assert stop.value.code in (0, None), line
            case ["text"]:
                yield command[1], body, words.getvalue()
            case _:
                pytest.fail(f"a block of another kind: {info}")


@pytest.fixture(scope="module")
def out(said):
    return Path("out/bay")


@pytest.fixture(scope="module")
def jobs(said):
    with open("jobs.csv", newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


@pytest.fixture(scope="module")
def done(out, jobs):
    """Names of the jobs that the plan does, in order."""
    stops = json.loads((out / "summary.json").read_text())["sheet"]["stops"]
    return [stop["name"] for stop in stops if stop["task"]]


@pytest.fixture(scope="module")
def plan(said):
    return json.loads(Path("vehicle/itinerary.plan").read_text())


def test_the_page_runs_and_its_commands_say_what_it_shows(said):
    assert [command for command, *_ in said] == ["validate", "plan", "check", "export"]
    for command, shown, words in said:
        # Figures differ in their last digits from machine to machine, and so do files' hashes.
        shown, words = (
            [re.sub(r"SHA-256 \w+|[\d.,]+", "0", line).strip() for line in text.splitlines() if line.strip()]
            for text in (shown, words)
        )
        if command != "plan":
            assert words == shown
        assert words[-1] == shown[-1]
    files = [Path(line.strip()) for line in said[-1][2].splitlines() if line.startswith("  ")]
    assert len(files) == 2
    assert all(file.is_file() for file in files)


def places(plan):
    """Items that are no speed."""
    return [item for item in plan["mission"]["items"] if item["command"] != 178]


def test_every_job_is_done_at_most_once(done, jobs):
    assert done
    assert set(done) <= set(jobs)
    assert len(done) == len(set(done))


def test_fences_are_known_obstacles_and_land_and_waypoints_lie_outside_of_them(plan):
    expected = sorted(
        (*feature["geometry"]["coordinates"][::-1], feature["properties"]["radius"]) for feature in known()
    )
    circles, polygons = plan["geoFence"]["circles"], plan["geoFence"]["polygons"]
    assert not any(fence["inclusion"] for fence in (*circles, *polygons))
    found = sorted((*one["circle"]["center"], one["circle"]["radius"]) for one in circles)
    assert np.array(found) == pytest.approx(np.array(expected), abs=1e-6)
    pixels = np.asarray(Image.open("chart.png").convert("RGB"))
    rows, columns = np.nonzero((pixels == LAND).all(axis=2))
    land = np.stack([359000 + 5.0 * columns + 2.5, 4263400 - 5.0 * rows - 2.5], axis=1)
    shapes = [
        shapely.Polygon(np.stack(UTM.transform(*np.array(one["polygon"]).T[::-1]), axis=1))
        for one in polygons
    ]
    assert shapes
    for shape in shapes:
        inside = shapely.contains_xy(shape, *land.T).sum() * 25.0
        assert inside > 0.5 * shape.area, "a fence is more land than water"
    fenced = shapely.union_all(shapes)
    for item in places(plan):
        latitude, longitude = item["params"][4:6]
        assert not fenced.contains(shapely.Point(UTM.transform(longitude, latitude)))


def known():
    """Obstacles of the page."""
    return json.loads(Path("obstacles.geojson").read_text())["features"]


def test_paths_pass_clear_of_obstacles(out):
    features = json.loads((out / "itinerary.geojson").read_text())["features"]
    for one in (one for one in features if one["properties"]["kind"] == "plan"):
        line = shapely.LineString([UTM.transform(*place[:2]) for place in one["geometry"]["coordinates"]])
        for obstacle in known():
            centre = shapely.Point(UTM.transform(*obstacle["geometry"]["coordinates"]))
            assert line.distance(centre) > obstacle["properties"]["radius"] + 10 - 0.1


def test_vehicles_hold_at_each_job_for_its_time(plan, out, done, jobs):
    held = [item["params"] for item in places(plan) if item["params"][0]]
    found = [(params[0], *params[4:6], -params[6]) for params in held]
    order = ("duration", "latitude", "longitude", "depth")
    assert np.array(found) == pytest.approx(
        np.array([[float(jobs[n][of]) for of in order] for n in done]), abs=1e-4
    )
    loiters = etree.parse(out / "itinerary.imc.xml").findall(".//Loiter")
    found = [[float(one.findtext(of)) for of in ("duration", "lat", "lon")] for one in loiters]
    found = np.array(found) * [1.0, *np.degrees([1.0, 1.0])]
    assert found == pytest.approx(
        np.array([[float(jobs[n][of]) for of in order[:3]] for n in done]), abs=1e-4
    )


def test_every_file_names_the_jobs_in_their_order(out, done, jobs):
    document = fastkml.KML.parse(out / "itinerary.kml")
    assert set(done) <= {mark.name for mark in find_all(document, of_type=fastkml.Placemark)}
    route = etree.parse("vehicle/itinerary.gpx").iterfind(".//{*}rtept/{*}name")
    assert [point.text for point in route if point.text in done] == done
    with open(out / "itinerary.csv", newline="") as file:
        held = {row["name"]: float(row["hold"]) for row in csv.DictReader(file) if float(row["hold"])}
    assert list(held.items()) == [(name, float(jobs[name]["duration"])) for name in done]
    features = json.loads((out / "itinerary.geojson").read_text())["features"]
    assert [one["properties"]["name"] for one in features if one["properties"].get("task")] == done
    with xr.open_dataset(out / "itinerary.nc", engine="netcdf4") as track:
        assert track.attrs["featureType"] == "trajectory"
        assert track.sizes["trajectory"] == len(done) + 1
        assert int(track["row_size"].sum()) == track.sizes["obs"]
        assert 2 - 1e-3 <= float(track["depth"].min()) <= float(track["depth"].max()) <= 30 + 1e-3


def test_the_mission_sheet_names_every_job_and_the_files_by_their_hashes(out, jobs):
    page = (out / "sheet.html").read_text(encoding="utf-8")
    cells = etree.parse(out / "sheet.html", etree.HTMLParser()).iterfind(".//td")
    assert set(jobs) <= {"".join(cell.itertext()).strip() for cell in cells}
    for name in ("jobs.csv", "chart.png"):
        assert hashlib.sha256(Path(name).read_bytes()).hexdigest()[:16] in page
