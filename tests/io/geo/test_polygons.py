"""Charts from polygons of land, reefs and closed areas."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import Point, Polygon, box

from auvplan.io.geo import GeoError, Zone, chart_from_polygons, read_zones, with_no_go
from auvplan.io.geo.grid import Extent, touched
from auvplan.ocean.chart import Chart, ChartError
from auvplan.ocean.classify import UNCERTAIN_MAX
from auvplan.site import Site
from tests.io.geo.files import SITE, feature, geographic, ring, write_geojson, written
from tests.io.geo.test_charts import kinds
from tests.io.refusals import refusal

AREA = {"lower": (-1000.0, -800.0), "upper": (1000.0, 1203.0)}


def test_land_with_a_hole_a_fringe_and_reefs(tmp_path):
    shore = ring((100, 200), (100, 700), (600, 700), (600, 200))
    lake = ring((300, 400), (440, 400), (440, 540), (300, 540))
    land = write_geojson(tmp_path / "land.geojson", feature("Polygon", [shore, lake]))
    shoal = ring((-900, -700), (-900, -500), (-700, -600))
    reef = write_geojson(tmp_path / "reef.geojson", feature("Polygon", [shoal]))
    chart = chart_from_polygons(land, SITE, Extent(**AREA), fringe=60.0, uncertain=reef)
    assert chart.shape == (200, 201)
    assert not chart.is_water([150.0, 350.0, 590.0], [250.0, 390.0, 690.0]).any()
    assert chart.is_water([350.0, 50.0], [450.0, 250.0]).all()
    doubtful = chart.passability_at([370.0, 55.0, 645.0, -850.0], [470.0, 255.0, 500.0, -600.0])
    np.testing.assert_allclose(doubtful, [1.0, UNCERTAIN_MAX, UNCERTAIN_MAX, UNCERTAIN_MAX], atol=1e-6)
    assert float(chart.passability_at(20.0, 450.0)) == 1.0
    # By the number of pixels: an area of (500^2 - 140^2) m2, and the pixels along its edges.
    assert chart.shares()["coast"] * np.prod(chart.shape) == pytest.approx(2400, abs=250)


@pytest.mark.parametrize(
    "wrap", ["FeatureCollection", "Feature", "bare", "GeometryCollection", "MultiPolygon"]
)
def test_the_same_land_however_it_is_stated(tmp_path, wrap):
    corners = ring((100, 200), (100, 700), (600, 200))
    alone = {"type": "Polygon", "coordinates": [corners]}
    stated = {
        "FeatureCollection": {"type": "FeatureCollection", "features": [feature("Polygon", [corners])]},
        "Feature": feature("Polygon", [corners]),
        "bare": alone,
        "GeometryCollection": {"type": "GeometryCollection", "geometries": [alone]},
        "MultiPolygon": {"type": "MultiPolygon", "coordinates": [[corners]]},
    }[wrap]
    path = written(tmp_path / "land.json", "\ufeff" + json.dumps(stated))
    chart = chart_from_polygons(path, SITE, Extent(**AREA))
    twin = with_no_go(None, [Polygon([(100, 200), (100, 700), (600, 200)])], Extent(**AREA))
    assert (kinds(chart) != kinds(twin)).mean() < 0.005
    assert not chart.is_water(110.0, 210.0)
    assert chart.is_water(590.0, 690.0)


def test_land_across_the_antimeridian(tmp_path):
    """Split as RFC 7946 asks, or in longitudes from 0 to 360."""
    split = feature("MultiPolygon", [
        [[[179.99, 0], [180, 0], [180, 0.01], [179.99, 0.01], [179.99, 0]]],
        [[[-180, 0], [-179.99, 0], [-179.99, 0.01], [-180, 0.01], [-180, 0]]],
    ])  # fmt: skip
    whole = feature("Polygon", [[[179.99, 0], [180.01, 0], [180.01, 0.01], [179.99, 0.01], [179.99, 0]]])
    area = {"lower": (-2000.0, -2000.0), "upper": (2000.0, 2000.0), "pixel_size": 50.0}
    charts = [
        kinds(chart_from_polygons(write_geojson(tmp_path / "l.json", land), site, Extent(**area)))
        for land in (split, whole)
        for site in (Site(180.0, 0.0), Site(-180.0, 0.0))
    ]
    assert 0.1 < (charts[0] == 0).mean() < 0.2
    for other in charts[1:]:
        np.testing.assert_array_equal(charts[0], other)


def test_closed_areas_across_the_antimeridian(tmp_path):
    """Halves that meet there are one area with its lake; parts a turn of longitude apart may overlap."""
    lake = [[179.995, 0.003], [179.995, 0.006], [180.004, 0.006], [180.004, 0.003], [179.995, 0.003]]
    shore = [[179.99, 0], [180.01, 0], [180.01, 0.01], [179.99, 0.01], [179.99, 0]]
    west = [[179.99, 0], [180, 0], [180, 0.003], [179.995, 0.003], [179.995, 0.006], [180, 0.006]]
    east = [[-179.99, 0], [-180, 0], [-180, 0.003], [-179.996, 0.003], [-179.996, 0.006], [-180, 0.006]]
    halves = [
        [[*near, [turn, 0.01], [x, 0.01], near[0]]]
        for near, turn, x in ((west, 180, 179.99), (east, -180, -179.99))
    ]
    beside = [[-179.995, 0], [-179.985, 0], [-179.985, 0.01], [-179.995, 0.01], [-179.995, 0]]
    polar = [[[-180, 80], [-180, 90], [180, 90], [180, 80], [0, 80], [-180, 80]]]
    site = Site(180.0, 0.0)
    whole, split, shifted, cap = (
        zone.polygon
        for stated, near in (
            (feature("Polygon", [shore, lake]), site),
            (feature("MultiPolygon", halves), site),
            (feature("MultiPolygon", [[shore, lake], [beside]]), site),
            (feature("Polygon", polar), Site(180.0, 85.0)),
        )
        for zone in read_zones(write_geojson(tmp_path / "z.json", stated), near)
    )
    assert split.symmetric_difference(whole).area < 1e-3
    assert not split.contains(Point(500.0, 0.0))
    assert shifted.difference(whole).area == pytest.approx(0.25 * Polygon(whole.exterior).area, rel=0.01)
    assert whole.difference(shifted).area < 1e-3
    assert cap.geom_type == "Polygon"
    extent = Extent((-2000.0, -2000.0), (2000.0, 2000.0), 50.0)
    np.testing.assert_array_equal(*(kinds(with_no_go(None, [one], extent)) for one in (whole, split)))


def test_a_closed_area_without_an_area_in_metres_is_refused(tmp_path):
    far, (x, y) = Site(148.96, -20.34, origin=(1e7, 1e7)), (148.96, -20.34)
    thread = [[x, y], [x + 0.01, y], [x + 0.01, y + 1e-14], [x, y + 1e-14], [x, y]]
    path = write_geojson(tmp_path / "z.json", feature("Polygon", [thread]))
    refusal(GeoError, "feature 1: is no polygon with an area", read_zones, path, far)


corner = st.tuples(*(st.integers(-300, 1500).map(lambda tenths: tenths / 10) for _ in range(2)))


@settings(max_examples=60, deadline=None)
@given(st.lists(corner, min_size=3, max_size=7), st.sampled_from([3.0, 10.0, 37.0]))
def test_pixels_that_a_polygon_reaches_into(corners, size):
    """Against every pixel by itself."""
    polygon = shapely.convex_hull(shapely.multipoints(corners))
    assume(polygon.area > 0.0)
    grid = Extent((0.0, 0.0), (100.0, 130.0), size).grid()
    south, west = np.meshgrid(*(np.arange(n) * size for n in grid.shape), indexing="ij")
    squares = shapely.box(south, west, south + size, west + size)
    shared_area = shapely.area(shapely.intersection(squares, polygon))
    marked = touched(polygon, grid)
    assert marked[shared_area > 1e-3].all()
    assert not marked[shapely.distance(squares, polygon) > 1e-3].any()


def test_closed_areas_become_coast():
    chart = with_no_go(None, [box(100, 200, 300, 500)], Extent(**AREA))
    mask = np.ones((200, 201), bool)
    mask[110:130, 100:130] = False
    twin = Chart.from_mask(mask, 10.0, (-1000.0, -800.0))
    np.testing.assert_array_equal(chart.passability, twin.passability)
    np.testing.assert_array_equal(chart.signed_distance, twin.signed_distance)
    more = with_no_go(chart, [Zone("cable", Point(-500.0, 0.0).buffer(100.0))])
    assert not more.is_water([-500.0, 150.0], [0.0, 300.0]).any()
    assert float(more.distance(-350.0, 0.0)) < 50.0
    north, east = np.meshgrid(np.arange(-990, 1000, 60.0), np.arange(-790, 1190, 60.0))
    assert (np.asarray(more.distance(north, east)) <= np.asarray(chart.distance(north, east)) + 1e-4).all()
    assert with_no_go(chart, []).shape == chart.shape


def test_a_crop_keeps_what_it_knows_of_a_coast_beyond_it():
    chart = with_no_go(None, [box(100, 200, 300, 500)], Extent(**AREA)).crop(132, 100, 20, 30)
    near = float(chart.distance(330.0, 350.0))
    assert 15.0 < near < 30.0
    assert float(with_no_go(chart, [box(480, 200, 500, 220)]).distance(330.0, 350.0)) == near


def test_zones(tmp_path):
    site = Site(148.96, -20.34, origin=(300.0, -200.0))
    places = geographic(*np.array([(100, 200), (100, 700), (600, 200)], float).T, site).tolist()
    areas = [feature("Polygon", [[*places, places[0]]], **name) for name in ({"Name": "cable"}, {})]
    zones = read_zones(write_geojson(tmp_path / "z.json", *areas), site)
    assert [zone.name for zone in zones] == ["cable", "2"]
    twin = Polygon([(100, 200), (100, 700), (600, 200)])
    assert zones[0].polygon.symmetric_difference(twin).area < 1.0
    chart = with_no_go(None, zones, Extent(**AREA))
    assert not chart.is_water(110.0, 210.0)
    assert isinstance(chart.passability, jnp.ndarray)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (Polygon([(0, 0), (10, 10), (10, 0), (0, 10)]), "no-go area 1: .*intersection"),
        (Polygon(), "no-go area 1: is no polygon"),
        (Point(0, 0), "no-go area 1: is no polygon"),
        (Zone("cable", Polygon([(0, 0), (1, float("inf")), (2, 3)])),
         "no-go area 'cable': a coordinate is not finite"),
    ],
)  # fmt: skip
def test_areas_that_cannot_be_closed(given, words):
    refusal(ChartError, words, with_no_go, None, [given], Extent(**AREA))
    refusal(ChartError, "an extent is needed", with_no_go, None, [given])
