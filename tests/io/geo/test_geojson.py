"""GeoJSON that is none: what is said of it."""

import numpy as np
import pytest
import shapely

from auvplan.errors import ScenarioWarning
from auvplan.io.geo import GeoError, chart_from_polygons, read_jobs, read_zones
from auvplan.io.geo.grid import Extent
from auvplan.io.geo.polygons import read_polygons
from auvplan.ocean.chart import ChartError
from auvplan.site import Site
from tests.io.geo.files import SITE, feature, ring, written
from tests.io.refusals import refusal
from tests.io.small_site import ring_of

GOOD = feature("Polygon", [ring((0, 0), (0, 50), (50, 0))])
SQUARE = [[0, 0], [0, 1], [1, 1], [1, 0], [0, 0]]
EMPTY = {"type": "GeometryCollection", "geometries": []}
BOW = [[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]
STAR = [[np.cos(angle), np.sin(angle)] for angle in 2.0 * np.pi * np.arange(41) * 20.0 / 41.0]
STAR.append(STAR[0])


def collection(*features, **more):
    return {"type": "FeatureCollection", "features": list(features), **more}


def one(coordinates):
    return collection(feature("Polygon", coordinates))


def named(name):
    return {"type": "name", "properties": {"name": name}}


FAULTS = [
    ("not json", "not valid JSON"),
    ('<?xml version="1.0"?>\n<gpx version="1.1"/>', "is no GeoJSON but GPX, which `ogr2ogr"),
    ("[" * 100_000, "not valid JSON"),
    (b"\xff\xfe{}", "not UTF-8 text"),
    ([], "not GeoJSON: it has no type"),
    ({"type": "Topology"}, "'Topology' is no type of GeoJSON"),
    (collection(), "has no features"),
    ({"type": "FeatureCollection"}, "without a list of features"),
    (collection(GOOD, 3), "feature 2: is no Feature"),
    (collection(GOOD, {"type": "Feature", "geometry": None}), "feature 2: has no geometry"),
    (collection({**GOOD, "properties": [1]}), "feature 1: properties must be a mapping, got list"),
    (collection(GOOD, feature("Point", [0, 0])), "feature 2: a Point, where Polygon or MultiPolygon is"),
    (collection(feature("Circle", [0, 0])), "feature 1: 'Circle' is no type of geometry"),
    (one([]), "every polygon is empty"),
    (collection(GOOD, feature("Polygon", [[]])), "feature 2: needs at least 4 positions, got 0"),
    (one(5), "feature 1: a polygon without rings"),
    (collection(GOOD, GOOD, feature("Polygon", [STAR])), "feature 3: the polygon crosses itself at "),
    (one([[*SQUARE[:4], [0, 0.5]]]), "feature 1: a ring is not closed"),
    (one([[[0, 0], [0, 0], [0, 0], [0, 0]]]), "feature 1: no valid polygon: too few points"),
    (one([SQUARE, [[2, 2], [2, 3], [3, 3], [2, 2]]]), "feature 1: no valid polygon: hole"),
    (one([[[0, 0], [361, 1], [1, 1], [0, 0]]]), r"feature 1: \(361, 1\) is no longitude"),
    (one([[[0, 0], [1, float("nan")], [1, 1], [0, 0]]]), "feature 1: .* is not finite"),
    (one([[[0, 0], [1, "1"], [1, 1], [0, 0]]]), r"feature 1: \[1, '1'\] is no position"),
    (one([[[0, 0], [10**400, 1], [1, 1], [0, 0]]]), "feature 1: .* is no position"),
    (one([[[179, 0], [-179, 0], [-179, 1], [179, 0]]]), "feature 1: .*antimeridian"),
    (collection(feature("MultiPolygon", [[SQUARE], [SQUARE]])), "feature 1: "),
    (collection(GOOD, crs=named("EPSG:32755")), "crs is 'EPSG:32755': GeoJSON is in WGS 84"),
    (collection({"type": "Feature", "geometry": EMPTY}), "feature 1: an empty GeometryCollection"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "words"), FAULTS)
def test_one_line_that_names_the_file_and_the_feature(tmp_path, content, words):
    path = written(tmp_path / "l.geojson", content)
    extent = Extent(lower=(-2e5, -2e5), upper=(2e5, 2e5), pixel_size=1e4)
    zones = refusal(GeoError, words, read_zones, path, SITE)
    chart = refusal(ChartError, ".", chart_from_polygons, path, Site(1.0, 1.0), extent)
    for line in map(str, (zones, chart)):
        assert line.startswith(str(path))
        assert len(line) < 400


WGS_84 = [
    "urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:OGC::CRS84", "OGC:CRS84", "EPSG:4326", "WGS84",
    "urn:ogc:def:crs:EPSG::4326", "http://www.opengis.net/def/crs/EPSG/0/4326",
    "http://www.opengis.net/def/crs/OGC/1.3/CRS84",
]  # fmt: skip


def test_names_of_wgs_84(tmp_path):
    for name in WGS_84:
        path = written(tmp_path / "l.geojson", collection(GOOD, crs=named(name)))
        assert len(read_zones(path, SITE)) == 1


def test_empty_polygons_among_others_are_passed_over(tmp_path):
    path = written(tmp_path / "l.geojson", collection(feature("Polygon", []), GOOD))
    assert [zone.name for zone in read_zones(path, SITE)] == ["2"]


def test_missing_files(tmp_path):
    for read in (read_zones, read_jobs):
        refusal(GeoError, r"nowhere\.geojson: No such file", read, tmp_path / "nowhere.geojson", SITE)
    square = Extent(lower=(0, 0), upper=(1, 1))
    words = "fringe must not be negative"
    refusal(ChartError, words, chart_from_polygons, tmp_path / "a", SITE, square, fringe=-1.0)


def test_polygons_far_from_the_area_may_be_faulty(tmp_path):
    path = written(tmp_path / "l.geojson", collection(feature("Polygon", [BOW]), GOOD))
    chart = chart_from_polygons(path, SITE, Extent(lower=(0, 0), upper=(100, 100)))
    assert 0.1 < (np.asarray(chart.passability) == 0.0).mean() < 0.3


def test_a_ring_that_touches_itself_is_parted_with_a_warning(tmp_path):
    square, notch = [[0, 0], [4, 0], [4, 4], [2, 4]], [[1, 2], [3, 2], [2, 4], [0, 4], [0, 0]]
    path = written(tmp_path / "l.geojson", one([square + notch]))
    words = r"feature 1: a ring touches itself at \(2, 4\): it is parted there"
    with pytest.warns(ScenarioWarning, match=words):
        (zone,) = read_zones(path, Site(2.0, 2.0))
    assert zone.polygon.is_valid
    hole = abs(shapely.Polygon([[2, 4], [1, 2], [3, 2]]).area)
    degrees = zone.polygon.area / (111_195.0**2)
    assert degrees == pytest.approx(16.0 - hole, rel=0.01)


@pytest.mark.parametrize(
    ("rings", "area"),
    [
        ([BOW], 0.5),
        ([[[0, 0], [4, 0], [4, 3], [1, 3], [1, 1], [5, 1], [5, 4], [0, 4], [0, 0]]], 19.0),  # around twice
        ([SQUARE, ring_of((0.5, 0.2), (1.5, 0.2), (1.5, 0.6), (0.5, 0.6))], 1.0),  # a hole across the shore
    ],
)
def test_a_ring_that_crosses_itself_keeps_all_land_that_may_be_meant(tmp_path, rings, area):
    path = written(tmp_path / "l.geojson", one(rings))
    words = r"feature 1: the polygon crosses itself at .*: it is repaired, with"
    with pytest.warns(ScenarioWarning, match=words):
        (shape,) = (found.shape for found in read_polygons(path))
    assert shape.is_valid
    assert shape.area >= area - 1e-9
    places = np.random.default_rng(0).uniform(0.0, 5.0, (2000, 2))
    odd = np.zeros(2000, bool)
    for ring_ in rings:
        odd ^= _times_around(np.array(ring_, float), places) % 2 == 1
    assert shapely.contains_xy(shape, *places[odd].T).all()


def _times_around(ring, places):
    """Winding number of a closed ring about each of some places."""
    angles = np.unwrap(np.arctan2(*(ring[:, None] - places).transpose(2, 1, 0)[::-1]), axis=1)
    return np.rint(np.abs(angles[:, -1] - angles[:, 0]) / (2.0 * np.pi)).astype(int)


def test_many_rings_that_cross_are_refused_at_once(tmp_path, monkeypatch):
    """To make them valid takes minutes and gigabytes."""
    monkeypatch.setattr("shapely.make_valid", lambda shape: pytest.fail("made valid"))
    path = written(tmp_path / "a.geojson", one([BOW] * 3000))
    refusal(GeoError, "feature 1: the polygon crosses itself", read_polygons, path)


def test_a_line_on_a_long_word_is_short(tmp_path):
    refusal(GeoError, ".", read_polygons, written(tmp_path / "a.geojson", {"type": "x" * 1_000_000}))
