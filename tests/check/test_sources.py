"""Land and sea bed of a run's files, looked at on request, against files known in closed form."""

import json
import sys
import zipfile

import numpy as np
import pytest
import shapely
import xarray as xr
from pyproj import Transformer

from auvplan.check.inputs import places_of
from auvplan.check.run import check_run
from auvplan.check.sources import read_sources
from auvplan.io import save_run
from auvplan.site import Site
from tests.io.geo.files import SITE, geographic, ring, write_geojson, write_geotiff
from tests.io.geo.files import feature as geo_feature
from tests.io.geo.sea_floors import SITE as FLOOR_SITE
from tests.io.geo.sea_floors import sea_floor, write_grid
from tests.io.sample_run import make_run


def saved(folder, site=SITE, **scenario):
    """A data set that names the files of a scenario."""
    attributes = {
        "scenario": json.dumps(scenario),
        "scenario_folder": str(folder),
        "site_longitude": site.longitude,
        "site_latitude": site.latitude,
        "site_origin": np.asarray(site.origin),
    }
    return xr.Dataset(attrs=attributes)


def only(dataset):
    notes = []
    (source,) = read_sources(dataset, notes)
    assert notes == []
    return source


def test_places_are_the_sites(tmp_path):
    site = Site(12.5, 61.0, origin=(300.0, -700.0))
    north, east = np.array([0.0, 5e3, -2e4]), np.array([100.0, -8e3, 4e4])
    found = places_of(saved(tmp_path, site))(north, east)
    np.testing.assert_allclose(np.stack(found, -1), geographic(north, east, site), atol=1e-10)


@pytest.mark.parametrize("settings", [{"source": "polygons", "file": "l.json"}, {"no_go": "l.json"}])
def test_polygons_with_holes(tmp_path, settings):
    outer, hole = ring((0, 0), (0, 1000), (1000, 1000), (1000, 0)), ring((400, 400), (400, 600), (600, 500))
    write_geojson(tmp_path / "l.json", geo_feature("Polygon", [outer, hole]))
    source = only(saved(tmp_path, chart=settings))
    assert (source.name, source.kind) == ("l.json", "land")
    north, east = np.array([500.0, 450.0, -1.0, 999.0]), np.array([500.0, 50.0, 500.0, 999.0])
    places = geographic(north, east).T
    assert source.blocked(*places, np.zeros(4)).tolist() == [False, True, False, True]
    assert source.blocked(places[0] + 360.0, places[1], np.zeros(4)).tolist() == [False, True, False, True]


@pytest.mark.parametrize("name", ["l.gpkg", "l.shp", "l.fgb"])
@pytest.mark.parametrize("crs", [4326, 32755])
def test_polygons_of_other_formats(tmp_path, name, crs):
    raw = pytest.importorskip("pyogrio.raw")
    outer, hole = ring((0, 0), (0, 1000), (1000, 1000), (1000, 0)), ring((400, 400), (400, 600), (600, 500))
    turn = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    shapes = [shapely.Polygon(outer, [hole]), shapely.Polygon(ring((2000, 0), (2000, 500), (2500, 0)))]
    placed = [shapely.transform(one, lambda at: np.column_stack(turn.transform(*at.T))) for one in shapes]
    kept = {"fields": ["windows"], "crs": f"EPSG:{crs}", "geometry_type": "Polygon"}
    windows = [np.array(["", "06:00/09:00"], object)]
    raw.write(tmp_path / name, np.array([one.wkb for one in placed], object), windows, **kept)
    north, east = np.array([500.0, 450.0, -1.0, 999.0, 2100.0]), np.array([500.0, 50.0, 500.0, 999.0, 100.0])
    places = geographic(north, east).T
    source = only(saved(tmp_path, chart={"source": "polygons", "file": name}))
    assert source.blocked(*places, np.zeros(5)).tolist() == [False, True, False, True, True]
    (always,) = read_sources(saved(tmp_path, chart={"no_go": name}), [])
    assert always.blocked(*places, np.zeros(5)).tolist() == [False, True, False, True, False]
    settings = {"no_go": name, "no_go_windows": "06:00/09:00"}
    assert read_sources(saved(tmp_path, chart=settings), []) == ()


def test_archives_are_looked_into(tmp_path):
    raw = pytest.importorskip("pyogrio.raw")
    square = shapely.Polygon(ring((0, 0), (0, 1000), (1000, 1000), (1000, 0)))
    (tmp_path / "parts").mkdir()
    shapes, kept = np.array([square.wkb], object), {"crs": "EPSG:4326", "geometry_type": "Polygon"}
    raw.write(tmp_path / "parts" / "l.shp", shapes, [np.array([1])], ["a"], **kept)
    with zipfile.ZipFile(tmp_path / "l.zip", "w") as archive:
        for part in (tmp_path / "parts").iterdir():
            archive.write(part, f"land/{part.name}")
    settings = {"source": "polygons", "file": "l.zip"}
    source = only(saved(tmp_path, chart=settings))
    places = geographic(np.array([500.0, -10.0]), np.array([500.0, 500.0])).T
    assert source.blocked(*places, np.zeros(2)).tolist() == [True, False]
    with zipfile.ZipFile(tmp_path / "l.zip", "w") as archive:
        archive.writestr("doc.kml", "<kml/>")
    notes = []
    assert read_sources(saved(tmp_path, chart=settings), notes) == ()
    assert notes == ["land of l.zip was not looked at: its archive holds 0 files of polygons"]


@pytest.mark.parametrize("form", ["elevation", "h", "tiff", "fathoms", "utm", "bag"])
def test_the_sea_bed_and_its_water_level(tmp_path, form):
    latitude, longitude = 56.36 + 0.01 * np.arange(14), -5.74 + 0.02 * np.arange(9)
    if form == "tiff":
        heights = -sea_floor(longitude[None, :], latitude[::-1, None])
        corner = (longitude[0], latitude[-1])
        write_geotiff(tmp_path / "b", heights, corner=corner, scale=(0.02, 0.01), point=True)
    elif form in ("utm", "bag"):  # the first in tenths of feet
        rasterio = pytest.importorskip("rasterio")
        shutil, feet = pytest.importorskip("rasterio.shutil"), form == "utm"
        turn = Transformer.from_crs("EPSG:4326", "EPSG:32630", always_xy=True)
        west, north = turn.transform(-5.72, 56.48)
        x, y = west + 50.0 * np.arange(200), north - 50.0 * np.arange(200)
        depth = sea_floor(*turn.transform(*np.meshgrid(x, y), direction="INVERSE"))
        place = rasterio.Affine(50.0, 0.0, west - 25.0, 0.0, -50.0, north + 25.0)
        size = {"width": 200, "height": 200, "count": 1 if feet else 2, "dtype": "float32"}
        with rasterio.open(tmp_path / "b", "w", "GTiff", crs=32630, transform=place, **size) as file:
            file.write((-depth / (0.03048 if feet else 1.0)).astype(np.float32), 1)
            if feet:
                file.scales, file.units = (0.1,), ("ft",)
        if not feet:
            shutil.copy(tmp_path / "b", tmp_path / "b.bag", driver="BAG")
    elif form == "fathoms":
        write_grid(tmp_path / "b", "depth", sign=1.0 / 1.8288, attributes={"units": "fathoms"})
    else:
        write_grid(tmp_path / "b", form, sign=1.0 if form == "h" else -1.0)
    places = np.array([[-5.66, 56.42], [-5.615, 56.475]])
    bed = sea_floor(*places.T)
    for level, clear in ((0.0, 0.4), (-2.0, -1.6)):
        name = "b.bag" if form == "bag" else "b"
        settings = {"source": "file", "file": name, "water_level": level}
        source = only(saved(tmp_path, FLOOR_SITE, bathymetry=settings))
        assert source.kind == "sea bed"
        assert not source.blocked(*places.T, bed + clear).any()
        assert source.blocked(*places.T, bed + clear + 0.3).all()


def test_what_cannot_be_looked_at_is_stated(tmp_path):
    (tmp_path / "b.nc").write_bytes(b"CDF")
    notes = []
    settings = {"source": "file", "file": "b.nc"}
    found = read_sources(saved(tmp_path, bathymetry=settings, chart={"no_go": "none.json"}), notes)
    assert found == ()
    assert [note.split(" was not looked at: ")[0] for note in notes] == [
        "land of none.json",
        "sea bed of b.nc",
    ]
    assert read_sources(xr.Dataset(attrs={"scenario": "{}"}), notes) == ()


@pytest.mark.parametrize(
    ("settings", "kind", "name"),
    [
        ({"chart": {"source": "raster", "file": "c.tif"}}, "land", "c.tif"),
        ({"chart": {"source": "enc", "file": "cells"}}, "land", "cells"),
        ({"chart": {"source": "current"}, "current": {"files": ["a.nc", "b.nc"]}}, "land", "a.nc"),
        ({"bathymetry": {"source": "current"}, "current": {"files": "a.nc"}}, "sea bed", "a.nc"),
    ],
)
def test_what_is_not_looked_at_is_stated(tmp_path, settings, kind, name):
    notes = []
    assert read_sources(saved(tmp_path, **settings), notes) == ()
    reason = "pictures, S-57 cells and files of currents are not looked at"
    assert notes == [f"{kind} of {name} was not looked at: {reason}"]


@pytest.mark.parametrize("package", ["pyogrio", "rasterio"])
def test_a_package_that_is_not_installed_is_stated(tmp_path, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    write_geojson(tmp_path / "l.json", geo_feature("Polygon", [ring((0, 0), (0, 9), (9, 9))]))
    write_geotiff(tmp_path / "b.tif", np.zeros((4, 4)))
    chart, bed = {"source": "polygons", "file": "l.json"}, {"source": "file", "file": "b.tif"}
    notes = []
    (other,) = read_sources(saved(tmp_path, chart=chart, bathymetry=bed), notes)
    kind, name = {"pyogrio": ("land", "l.json"), "rasterio": ("sea bed", "b.tif")}[package]
    assert notes == [f"{kind} of {name} was not looked at: {package} is not installed"]
    assert other.kind != kind


@pytest.mark.parametrize("known", [False, True])
def test_a_run_on_land_of_its_sources(tmp_path, known):
    """What the planner misread does not vouch for itself, and what both know counts once."""
    save_run(make_run(), tmp_path)
    assert check_run(tmp_path, sources=True).ok
    path = tmp_path / "mission.nc"
    with xr.open_dataset(path, decode_cf=False) as file:
        data = file.load()
    write_geojson(
        tmp_path / "land.json", geo_feature("Polygon", [ring((450, 500), (450, 700), (550, 700), (550, 500))])
    )
    attributes = saved(tmp_path, chart={"source": "polygons", "file": "land.json"}).attrs
    data.attrs |= attributes | {
        "scenario": json.dumps(json.loads(data.attrs["scenario"]) | json.loads(attributes["scenario"]))
    }
    if known:
        data["passability"][45:55, 50:70] = 0
    data.to_netcdf(path)
    assert check_run(tmp_path).coast_hits == known, "files are looked at on request"
    report = check_run(tmp_path, sources=True)
    assert report.coast_hits == 1
    where = "on land for" if known else "on land of land.json for"
    assert sum(where in fault for fault in report.faults) == 1
    # The first leg goes 400 m north and 600 m east: it is on that land for 100 m north.
    assert report.coast_metres == pytest.approx(100.0 * np.linalg.norm([400.0, 600.0, 20.0]) / 400.0, abs=2.0)
