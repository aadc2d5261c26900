"""Land from GeoPackages, Shapefiles and the like."""

import zipfile

import numpy as np
import pytest
import shapely
from pyproj import Transformer

from auvplan.errors import ScenarioWarning
from auvplan.io.geo import GeoError, chart_from_polygons, read_zones
from auvplan.ocean.chart import ChartError
from tests.io.geo.files import SITE, feature, geographic, write_geojson

AREA = {"lower": (0.0, 0.0), "upper": (1000.0, 1000.0), "pixel_size": 20.0}
CORNERS = [(105.0, 207.0), (109.0, 713.0), (611.0, 705.0), (353.0, 449.0)]


def square():
    """A polygon in longitude and latitude."""
    return shapely.Polygon(geographic(*np.array(CORNERS).T))


def written(path, shapes, crs="EPSG:4326", **columns):
    pyogrio = pytest.importorskip("pyogrio")
    names = list(columns)
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(np.asarray(shapes, object)),
        field_data=[np.asarray(columns[name]) for name in names],
        fields=names,
        geometry_type="Polygon",
        crs=crs,
    )
    return path


@pytest.mark.parametrize("name", ["land.gpkg", "land.shp", "land.fgb"])
@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:32755"])
def test_the_same_chart_as_from_geojson(tmp_path, name, crs):
    shape = square()
    twin = write_geojson(
        tmp_path / "land.json", feature("Polygon", [np.array(shape.exterior.coords).tolist()])
    )
    if crs != "EPSG:4326":
        there = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
        dense = shapely.segmentize(shape, 1e-4)
        shape = shapely.transform(dense, lambda places: np.stack(there.transform(*places.T), -1))
    path = written(tmp_path / name, [shape], crs)
    one, two = (np.asarray(chart_from_polygons(file, SITE, **AREA).passability) for file in (twin, path))
    assert 0.05 < (one == 0.0).mean() < 0.5
    assert (one != two).mean() <= (0.0 if crs == "EPSG:4326" else 0.002)


def test_names_of_closed_areas(tmp_path):
    path = written(tmp_path / "closed.gpkg", [square(), square()], NAME=["anchorage", "cable"])
    assert [zone.name for zone in read_zones(path, SITE)] == ["anchorage", "cable"]


def test_what_is_refused(tmp_path):
    bare = written(tmp_path / "bare.shp", [square()])
    bare.with_suffix(".prj").unlink()
    with pytest.raises(
        ChartError, match=r"tells no coordinate reference system: a Shapefile's is in the \.prj"
    ):
        chart_from_polygons(bare, SITE, **AREA)
    (tmp_path / "broken.gpkg").write_bytes(b"SQLite format 3\0" + bytes(200))
    with pytest.raises(GeoError, match=r"broken\.gpkg: cannot be read"):
        read_zones(tmp_path / "broken.gpkg", SITE)
    turns = np.deg2rad(360.0 * np.arange(41) * 20.0 / 41.0)
    star = shapely.Polygon(geographic(500.0 * np.cos(turns), 500.0 * np.sin(turns)))
    with pytest.raises(GeoError, match="feature 1: the polygon crosses itself"):
        read_zones(written(tmp_path / "star.gpkg", [star]), SITE)


def test_rings_that_cross_are_repaired_with_a_warning(tmp_path):
    bow = shapely.Polygon(geographic(*np.array([(0, 0), (500, 500), (500, 0), (0, 500)], float).T))
    with pytest.warns(ScenarioWarning, match="feature 1: the polygon crosses itself at .* it is repaired"):
        (zone,) = read_zones(written(tmp_path / "bow.gpkg", [bow]), SITE)
    assert zone.polygon.area == pytest.approx(125_000.0, rel=1e-3)


def test_other_formats_under_a_known_name_are_not_given_to_gdal(tmp_path):
    """Some name files or servers that GDAL would read."""
    twin = write_geojson(
        tmp_path / "twin.json", feature("Polygon", [geographic(*np.array(CORNERS).T).tolist()])
    )
    source = f"<SrcDataSource>{twin}</SrcDataSource>"
    virtual = f'<OGRVRTDataSource><OGRVRTLayer name="twin">{source}</OGRVRTLayer></OGRVRTDataSource>'
    (tmp_path / "land.gpkg").write_text(virtual)
    with zipfile.ZipFile(tmp_path / "land.zip", "w") as archive:
        archive.writestr("land.gpkg", virtual)
    for name in ("land.gpkg", "land.zip"):
        with pytest.raises(
            GeoError, match=r"land\.gpkg is neither a GeoPackage, a Shapefile nor a FlatGeobuf"
        ):
            read_zones(tmp_path / name, SITE)


def test_a_shapefile_in_an_archive(tmp_path):
    (tmp_path / "parts").mkdir()
    written(tmp_path / "parts" / "land.shp", [square()], name=["a"])
    with zipfile.ZipFile(tmp_path / "land.zip", "w") as archive:
        for part in sorted((tmp_path / "parts").iterdir()):
            archive.write(part, part.name)
    assert [zone.name for zone in read_zones(tmp_path / "land.zip", SITE)] == ["a"]
