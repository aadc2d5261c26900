"""Land from GeoPackages, Shapefiles and the like."""

import zipfile

import numpy as np
import pytest
import shapely
from pyproj import Transformer

from auvplan.io.geo import GeoError, chart_from_polygons, read_zones
from auvplan.io.geo.grid import Extent
from auvplan.io.geo.polygons import read_vector_polygons
from auvplan.ocean.chart import ChartError
from auvplan.site import Site
from tests.io.geo.files import SITE, feature, geographic, write_geojson
from tests.io.refusals import refusal

AREA = {"lower": (0.0, 0.0), "upper": (1000.0, 1000.0), "pixel_size": 20.0}
CORNERS = [(105.0, 207.0), (109.0, 713.0), (611.0, 705.0), (353.0, 449.0)]
#: Of the polygon of these corners, m2.
AREA_M2 = shapely.Polygon(CORNERS).area


def square():
    """A polygon in longitude and latitude."""
    return shapely.Polygon(geographic(*np.array(CORNERS).T))


def written(path, shapes, crs="EPSG:4326", layer=None, kind="Polygon", **columns):
    raw = pytest.importorskip("pyogrio.raw")
    shapes, values = shapely.to_wkb(np.asarray(shapes, object)), [np.asarray(v) for v in columns.values()]
    kept = {"geometry_type": kind, "crs": crs, "layer": layer}
    raw.write(path, shapes, values, list(columns), append=path.exists() and layer is not None, **kept)
    return path


@pytest.mark.parametrize("name", ["land.gpkg", "land.shp", "land.fgb"])
@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:32755"])
def test_the_same_chart_as_from_geojson(tmp_path, name, crs):
    shape = square()
    outline = np.array(shape.exterior.coords).tolist()
    twin = write_geojson(tmp_path / "land.json", feature("Polygon", [outline]))
    if crs != "EPSG:4326":
        there = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
        dense = shapely.segmentize(shape, 1e-4)
        shape = shapely.transform(dense, lambda places: np.stack(there.transform(*places.T), -1))
    path = written(tmp_path / name, [shape], crs)
    charts = (chart_from_polygons(file, SITE, Extent(**AREA)) for file in (twin, path))
    one, two = (np.asarray(chart.passability) for chart in charts)
    assert 0.05 < (one == 0.0).mean() < 0.5
    assert (one != two).mean() <= (0.0 if crs == "EPSG:4326" else 0.002)


def test_names_and_hours_of_closed_areas(tmp_path):
    columns = {"NAME": ["anchorage", "cable"], "from": [600.0, np.nan]}
    zones = read_zones(written(tmp_path / "closed.gpkg", [square(), square()], **columns), SITE)
    assert [(zone.name, zone.hours) for zone in zones] == [("anchorage", {"from": 600.0}), ("cable", {})]


def test_what_is_refused(tmp_path):
    bare = written(tmp_path / "bare.shp", [square()])
    bare.with_suffix(".prj").unlink()
    words = r"has no coordinate reference system: a Shapefile's is in the \.prj"
    refusal(ChartError, words, chart_from_polygons, bare, SITE, Extent(**AREA))
    (tmp_path / "broken.gpkg").write_bytes(b"SQLite format 3\0" + bytes(200))
    refusal(GeoError, r"broken\.gpkg: cannot be read", read_zones, tmp_path / "broken.gpkg", SITE)
    for layer in ("country", "islands"):
        path = written(tmp_path / "land.gpkg", [square()], layer=layer)
    words = r"2 layers that may be land, country, islands: keep one .* country`"
    refusal(ChartError, words, chart_from_polygons, path, SITE, Extent(**AREA))
    leap = shapely.Polygon([(179.99, -20), (-179.99, -20), (-179.99, -20.1)])
    words = r"feature 1: an edge spans 359\.98 degrees .* split it at the antimer"
    path = written(tmp_path / "leap.gpkg", [leap])
    refusal(ChartError, words, chart_from_polygons, path, SITE, Extent(**AREA))


def test_other_formats_under_a_known_name_are_not_given_to_gdal(tmp_path):
    """Some name files or servers that GDAL would read."""
    outline = geographic(*np.array(CORNERS).T).tolist()
    twin = write_geojson(tmp_path / "twin.json", feature("Polygon", [outline]))
    source = f"<SrcDataSource>{twin}</SrcDataSource>"
    virtual = f'<OGRVRTDataSource><OGRVRTLayer name="twin">{source}</OGRVRTLayer></OGRVRTDataSource>'
    (tmp_path / "land.gpkg").write_text(virtual)
    with zipfile.ZipFile(tmp_path / "land.zip", "w") as archive:
        archive.writestr("land.gpkg", virtual)
    words = r"land\.gpkg is neither a GeoPackage, a Shapefile nor a FlatGeobuf"
    for name in ("land.gpkg", "land.zip"):
        refusal(GeoError, words, read_zones, tmp_path / name, SITE)


@pytest.mark.parametrize("folder", ["", "land/"])
def test_a_shapefile_in_an_archive(tmp_path, folder):
    (tmp_path / "parts").mkdir()
    written(tmp_path / "parts" / "land.shp", [square()], name=["a"])
    with zipfile.ZipFile(tmp_path / "land.zip", "w") as archive:
        for part in sorted((tmp_path / "parts").iterdir()):
            archive.write(part, folder + part.name)
    assert [zone.name for zone in read_zones(tmp_path / "land.zip", SITE)] == ["a"]
    with zipfile.ZipFile(tmp_path / "land.zip", "a") as archive:
        archive.write(tmp_path / "parts" / "land.shp", "b.shp")
    words = rf"land\.zip: holds 2 files of land, {folder}land\.shp, b\.shp: it must"
    refusal(GeoError, words, read_zones, tmp_path / "land.zip", SITE)


def test_layers_of_any_geometry(tmp_path):
    (tmp_path / "one").mkdir()
    bag = shapely.GeometryCollection([shapely.MultiPolygon([square()])])
    path = written(tmp_path / "one" / "land.gpkg", [bag, square()], kind="Unknown")
    assert [round(zone.polygon.area, -2) for zone in read_zones(path, SITE)] == [round(AREA_M2, -2)] * 2
    for shape in (square().exterior, shapely.GeometryCollection([square(), shapely.Point(0, 0)])):
        path = written(tmp_path / "mixed.gpkg", [square(), shape], kind="Unknown")
        refusal(GeoError, r"feature 2: a \w+, where polygons are wanted", read_zones, path, SITE)
        path.unlink()


def test_an_empty_polygon_of_a_projection_is_left_out(tmp_path):
    square = shapely.box(5e5, 7.7e6, 5.01e5, 7.701e6)
    for number, shapes in enumerate(([square], [square, shapely.Polygon(), None])):
        path = written(tmp_path / f"{number}.gpkg", shapes, "EPSG:32755", kind="Unknown")
        assert [one.number for one in read_vector_polygons(path)] == [1]


@pytest.mark.parametrize("pole", [False, True])
def test_projected_land_across_the_antimeridian_and_around_a_pole(tmp_path, pole):
    """In metres of polar stereographic, an island with a lake at 180 degrees, or all south of 70 degrees."""
    site = Site(180.0, -70.0)
    if pole:
        way = np.arange(0.0, 360.0, 0.5)
        shape = shapely.Polygon(np.stack([way, np.full(len(way), -70.0)], -1))
        places = np.array([(-5e3, 0.0), (5e3, 0.0)])
    else:
        outer, lake = np.array([(-4, -4), (-4, 4), (4, 4), (4, -4)]), np.array([(1, 1), (1, 2), (2, 1)])
        shape = shapely.Polygon(geographic(*1e3 * outer.T, site), [geographic(*1e3 * lake.T, site)])
        places = np.array([(-3e3, -3e3), (3e3, 3e3), (1.2e3, 1.2e3), (6e3, 0.0)])
    there = Transformer.from_crs("EPSG:4326", "EPSG:3031", always_xy=True)
    shape = shapely.transform(shape, lambda at: np.stack(there.transform(*at.T), -1))
    path = written(tmp_path / "land.gpkg", [shape], "EPSG:3031")
    area = {"lower": (-8e3, -8e3), "upper": (8e3, 8e3), "pixel_size": 50.0}
    water = np.asarray(chart_from_polygons(path, site, Extent(**area)).is_water(*places.T))
    assert water.tolist() == ([False, True] if pole else [False, False, True, True])
