"""Pictures that a scenario names as its chart: stated colours, and what is said of the file."""

import warnings

import numpy as np
import pytest
from PIL import Image

from auvplan.errors import ScenarioWarning
from auvplan.io.area import load_area
from auvplan.io.examine import examine_scenario
from auvplan.ocean.chart import ChartError
from auvplan.ocean.whitsunday import classes
from auvplan.scenario.file import load_scenario, validate_scenario
from tests.io.geo.files import write_geotiff
from tests.io.refusals import refusal
from tests.ocean.chart_pictures import STYLES, paint, satellite, shares_right

INVERTED = STYLES["inverted"]
AREA = {"lower": [0, 0, 0], "upper": [3000, 3000, 40]}
SITE = {"longitude": 147.0, "latitude": -20.127, "origin": [1500, 1500]}


def scenario(site=None, **chart):
    plain = {"name": "leg", "area": AREA, "chart": chart} | ({"site": site} if site else {})
    return validate_scenario(plain, "test")


@pytest.fixture
def picture(tmp_path):
    Image.fromarray(paint(INVERTED, 300)).save(tmp_path / "map.png")
    return tmp_path


def test_told_colours_of_an_image(picture):
    plain = scenario(source="image", image="map.png")
    refusal(ChartError, r"map\.png: .*chart\.colours", load_area, plain, picture)
    stated = scenario(source="image", image="map.png", colours=INVERTED.named)
    chart = load_area(stated, picture).chart
    assert min(shares_right(np.asarray(chart.passability)[::-1], classes(300)).values()) > 0.98
    # The other way round: what is kept of one clustering does not serve for other colours.
    other = INVERTED.named | {"water": INVERTED.named["land"], "land": INVERTED.named["water"]}
    turned = load_area(scenario(source="image", image="map.png", colours=other), picture).chart
    assert (np.asarray(turned.passability)[np.asarray(chart.passability) == 1.0] == 0.0).mean() > 0.98


def test_one_colour_or_several_in_any_notation():
    image = {"source": "image", "image": "map.png"}
    one = scenario(**image, colours={"water": "WHITE", "land": "tan"})
    several = scenario(**image, colours={"water": ["#fff"], "land": ["tan", "#D2B48C"]})
    assert one.chart.colours.given == several.chart.colours.given
    assert validate_scenario(one.model_dump(mode="json"), "again").chart == one.chart


def test_told_colours_of_a_raster(tmp_path):
    """30 m pixels in UTM zone 55 S, on whose middle meridian the site lies."""
    path = write_geotiff(
        tmp_path / "map.tif",
        paint(INVERTED, 300),
        corner=(500_000.0 - 4500.0, 7_774_400.0 + 4500.0),
        scale=(30.0, 30.0),
        epsg=32755,
    )
    settings = {"source": "raster", "file": path.name, "pixel_size": 30}
    refusal(ChartError, r"map\.tif: .*chart\.colours", load_area, scenario(SITE, **settings), tmp_path)
    area = load_area(scenario(SITE, **settings, colours=INVERTED.named), tmp_path)
    shares = area.chart.shares()
    assert shares["water"] > 0.3
    assert shares["coast"] > 0.1


def test_notes_of_a_picture_reach_whoever_validates(picture):
    inner = paint(STYLES["white deep water"], 300)
    framed = np.zeros((340, 340, 3), np.uint8)
    framed[20:320, 20:320] = inner
    Image.fromarray(framed).save(picture / "framed.png")
    (picture / "framed.pgw").write_text("25\n0\n0\n-25\n697205\n7774095\n")
    notes = load_area(scenario(source="image", image="framed.png"), picture).notes
    assert any("black frame" in note for note in notes)
    assert any("deep water" in note for note in notes)
    assert any("chart.pixel_size is 10 m, the file says 25 m" in note for note in notes)
    stated = scenario(source="image", image="framed.png", pixel_size=25)
    assert not any("pixel_size" in note for note in load_area(stated, picture).notes)


def test_doubts_are_faults_of_the_picture(picture):
    path = picture / "scenario.yaml"
    path.write_text(
        "name: leg\narea: {lower: [0, 0, 0], upper: [3000, 3000, 40]}\n"
        "chart:\n  source: image\n  image: map.png\n"
    )
    (line,) = examine_scenario(path).lines
    assert "scenario.yaml:5:" in line
    assert "chart.image" in line
    assert "--water" in line


def test_a_picture_from_space_is_warned_of_and_noted_once(tmp_path, call):
    Image.fromarray(satellite(1.0, 0)).save(tmp_path / "view.png")
    (tmp_path / "view.yaml").write_text(
        "name: view\narea: {lower: [0, 0, 0], upper: [2000, 2000, 10]}\nmission: {waypoints: 3}\n"
        "chart: {source: image, image: view.png, pixel_size: 10,\n"
        "        colours: {water: '#0f2744', land: '#62614a'}}\n"
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ScenarioWarning)
        area = load_area(load_scenario(tmp_path / "view.yaml"))
    assert any("view.png looks more like a photograph than a chart" in str(one.message) for one in caught)
    assert any("looks more like a photograph" in note for note in area.notes)
    _, said, errors = call("validate", tmp_path / "view.yaml")
    assert (said + errors).count("looks more like a photograph") == 1
