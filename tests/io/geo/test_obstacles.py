"""Known obstacles from GeoJSON: places, depths, motion, and one clear line for each fault."""

import numpy as np
import pytest
from pyproj import Geod

from auvplan.io.geo import GeoError, read_obstacles
from auvplan.site import Site
from tests.io.geo.files import SITE, feature, write_geojson
from tests.io.refusals import refusal


def stated(tmp_path, *properties, kind="Point", place=(148.97, -20.34)):
    features = [feature(kind, list(place), **each) for each in properties]
    return write_geojson(tmp_path / "obstacles.geojson", *features)


def test_an_obstacle_stands_or_moves_where_the_file_has_it(tmp_path):
    """From surface to bed, unless it has depths; course and speed are a velocity north and east."""
    ship = {"radius": 40, "course": 90, "speed": 2.0, "depth_max": 8}
    buoy, found = read_obstacles(stated(tmp_path, {"radius": 40, "name": "buoy"}, ship), SITE)
    north, east = (float(axis) for axis in SITE.to_local(148.97, -20.34))
    assert buoy.position == pytest.approx((north, east))
    assert (buoy.name, buoy.radius, buoy.depth_min, buoy.depth_max) == ("buoy", 40.0, 0.0, np.inf)
    assert not buoy.moves
    assert (found.moves, found.name, found.depth_max) == (True, "obstacle 2", 8.0)
    there = Geod(ellps="WGS84").fwd(148.97, -20.34, 90.0, 200.0)[:2]
    assert found.after(100.0).position == pytest.approx(SITE.to_local(*there), abs=1e-3)
    (on_the_meridian,) = read_obstacles(stated(tmp_path, ship, place=(148.96, -20.3)), SITE)
    assert on_the_meridian.velocity == pytest.approx((0.0, 2.0), abs=1e-12)


@pytest.mark.parametrize("course", [0.0, 130.0, 360.0])
def test_a_course_is_from_true_north(tmp_path, course):
    """Far north the local frame's own north differs: 1.3 degrees at 20 km from the site."""
    site = Site(30.0, 82.0, origin=(500.0, -200.0))
    longitude, latitude, _ = Geod(ellps="WGS84").fwd(30.0, 82.0, 90.0, 20_000.0)
    ship = {"radius": 50, "course": course, "speed": 1.0}
    (found,) = read_obstacles(stated(tmp_path, ship, place=(longitude, latitude)), site)
    there = Geod(ellps="WGS84").fwd(longitude, latitude, course, 18_000.0)[:2]
    assert found.after(18_000.0).position == pytest.approx(site.to_local(*there), abs=1.0)


@pytest.mark.parametrize(
    ("properties", "words"),
    [
        ({}, "radius is missing"),
        ({"radius": -1}, "radius must be greater than 0"),
        ({"radius": "wide"}, "radius must be a valid number"),
        ({"radius": 10, "depth": 5}, r"unknown key 'depth', did you mean 'depth_min'\?"),
        ({"radius": 10, "depthmax": 9}, r"did you mean 'depth_max'\?"),
        ({"radius": 10, "speed": 1}, "speed needs a course"),
        ({"radius": 10, "course": 400, "speed": 1}, "course must be less than or equal to 360"),
        ({"radius": 10, "depth_min": 9, "depth_max": 3}, "depth_max 3 m lies above depth_min 9 m"),
    ],
)
def test_a_fault_is_one_line_with_file_and_feature(tmp_path, properties, words):
    path = stated(tmp_path, {"radius": 5}, properties)
    refusal(GeoError, rf"obstacles\.geojson: feature 2: .*{words}", read_obstacles, path, SITE)


def test_swapped_places_are_said_once_and_an_obstacle_is_a_point(tmp_path):
    path = stated(tmp_path, {"radius": 5}, {"radius": 6}, place=(-20.34, 148.97))
    words = r"feature 1: .* seem swapped \(so in all 2 places of the file\)$"
    refusal(GeoError, words, read_obstacles, path, SITE)
    line = stated(tmp_path, {"radius": 5}, kind="LineString", place=([0, 0], [1, 1]))
    refusal(GeoError, "feature 1: a LineString", read_obstacles, line, SITE)
