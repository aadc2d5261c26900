"""Known obstacles from GeoJSON: places, depths, motion, and one clear line for each fault."""

import numpy as np
import pytest

from auvplan.io.geo import GeoError, read_obstacles
from tests.io.geo.files import SITE, feature, write_geojson


def written(tmp_path, *properties, kind="Point", place=(148.97, -20.34)):
    features = [feature(kind, list(place), **stated) for stated in properties]
    return write_geojson(tmp_path / "obstacles.geojson", *features)


def test_an_obstacle_stands_where_the_file_has_it_from_surface_to_bed(tmp_path):
    (buoy,) = read_obstacles(written(tmp_path, {"radius": 40, "name": "buoy"}), SITE)
    north, east = (float(axis) for axis in SITE.to_local(148.97, -20.34))
    assert buoy.position == pytest.approx((north, east))
    assert (buoy.name, buoy.radius, buoy.depth_min, buoy.depth_max) == ("buoy", 40.0, 0.0, np.inf)
    assert not buoy.moves


def test_course_and_speed_are_a_velocity_north_and_east(tmp_path):
    ship = {"radius": 40, "course": 90, "speed": 2.0, "depth_max": 8}
    (found,) = read_obstacles(written(tmp_path, ship), SITE)
    assert found.velocity == pytest.approx((0.0, 2.0), abs=1e-12)
    assert found.moves
    assert found.name == "obstacle 1"
    later = found.after(100.0)
    assert later.position[1] - found.position[1] == pytest.approx(200.0)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({}, "radius is missing"),
        ({"radius": -1}, "radius must be greater than 0"),
        ({"radius": "wide"}, "radius must be a valid number"),
        ({"radius": 10, "depth": 5}, "depth is unknown; an obstacle has radius"),
        ({"radius": 10, "depthmax": 9}, "did you mean 'depth_max'?"),
        ({"radius": 10, "speed": 1}, "speed needs a course"),
        ({"radius": 10, "course": 400, "speed": 1}, "course must be less than or equal to 360"),
        ({"radius": 10, "depth_min": 9, "depth_max": 3}, "depth_max 3 m lies above depth_min 9 m"),
    ],
)
def test_a_fault_is_one_line_with_file_and_feature(tmp_path, stated, words):
    path = written(tmp_path, {"radius": 5}, stated)
    with pytest.raises(GeoError, match="feature 2") as error:
        read_obstacles(path, SITE)
    assert str(path) in str(error.value)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_swapped_places_are_said_once(tmp_path):
    path = written(tmp_path, {"radius": 5}, {"radius": 6}, place=(-20.34, 148.97))
    with pytest.raises(GeoError, match=r"feature 1: .* seem swapped \(so in all 2 places of the file\)$"):
        read_obstacles(path, SITE)


def test_an_obstacle_is_a_point(tmp_path):
    with pytest.raises(GeoError, match="feature 1"):
        read_obstacles(written(tmp_path, {"radius": 5}, kind="LineString", place=([0, 0], [1, 1])), SITE)
