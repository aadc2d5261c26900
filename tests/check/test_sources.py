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
from auvplan.check.run import check_dataset, check_run
from auvplan.check.saved import Saved
from auvplan.check.sources import read_sources
from auvplan.io.results import to_dataset
from auvplan.site import Site
from tests.io.geo.files import SITE, geographic, ring, write_geojson, write_geotiff
from tests.io.geo.files import feature as geo_feature
from tests.io.geo.sea_floors import SITE as FLOOR_SITE
from tests.io.geo.sea_floors import sea_floor, write_grid
from tests.io.sample_run import make_run


def saved(folder, site=SITE, **scenario):
    """A run that names the files of a scenario."""
    attributes = {
        "scenario": json.dumps(scenario),
        "scenario_folder": str(folder),
        "site_longitude": site.longitude,
        "site_latitude": site.latitude,
        "site_origin": np.asarray(site.origin),
    }
    return Saved({}, xr.Dataset(attrs=attributes), [])


def only(run):
    (source,) = read_sources(run)
    assert run.notes == []
    return source


def test_places_are_the_sites(tmp_path):
    site = Site(12.5, 61.0, origin=(300.0, -700.0))
    north, east = np.array([0.0, 5e3, -2e4]), np.array([100.0, -8e3, 4e4])
    found = places_of(saved(tmp_path, site))(north, east)
    np.testing.assert_allclose(np.stack(found, -1), geographic(north, east, site), atol=1e-10)


OUTER, HOLE = ring((0, 0), (0, 1000), (1000, 1000), (1000, 0)), ring((400, 400), (400, 600), (600, 500))
ISLET = ring((2000, 0), (2000, 500), (2500, 0))
PLACES = np.array([500.0, 450.0, -1.0, 999.0, 2100.0]), np.array([500.0, 50.0, 500.0, 999.0, 100.0])


def write_land(folder, name, crs):
    """An island with a lake that is always closed, and an islet that is at certain hours, if hours count."""
    if name == "l.json":
        islet = geo_feature("Polygon", [ISLET], windows="06:00/09:00")
        write_geojson(folder / name, geo_feature("Polygon", [OUTER, HOLE]), islet)
        return
    raw = pytest.importorskip("pyogrio.raw")
    turn = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    shapes = [shapely.Polygon(OUTER, [HOLE]), shapely.Polygon(ISLET)]
    placed = [shapely.transform(one, lambda at: np.column_stack(turn.transform(*at.T))) for one in shapes]
    kept = {"fields": ["windows"], "crs": f"EPSG:{crs}", "geometry_type": "Polygon"}
    (folder / "parts").mkdir()
    path = folder / "parts" / name.replace("zip", "shp")
    columns = [np.array(["", "06:00/09:00"], object)]
    raw.write(path, np.array([one.wkb for one in placed], object), columns, **kept)
    if name == "l.zip":
        with zipfile.ZipFile(folder / name, "w") as archive:
            for part in path.parent.iterdir():
                archive.write(part, f"land/{part.name}")
        return
    for part in path.parent.iterdir():
        part.rename(folder / part.name)


@pytest.mark.parametrize(
    ("name", "crs"),
    [("l.json", 4326), *((f"l.{suffix}", crs) for suffix in ("gpkg", "shp", "fgb") for crs in (4326, 32755)),
     ("l.zip", 4326)],
)  # fmt: skip
def test_polygons_with_holes(tmp_path, name, crs):
    write_land(tmp_path, name, crs)
    places, deep = geographic(*PLACES).T, np.zeros(5)
    source = only(saved(tmp_path, chart={"source": "polygons", "file": name}))
    assert (source.name, source.kind) == (name, "land")
    assert source.blocked(*places, deep).tolist() == [False, True, False, True, True]
    assert source.blocked(places[0] + 360.0, places[1], deep).tolist() == [False, True, False, True, True]
    (always,) = read_sources(saved(tmp_path, chart={"no_go": name}))
    assert always.blocked(*places, deep).tolist() == [False, True, False, True, False]
    settings = {"no_go": name, "no_go_windows": "06:00/09:00"}
    assert read_sources(saved(tmp_path, chart=settings)) == ()


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


UNREAD = "was not looked at: pictures, S-57 cells and files of currents are not looked at"
CURRENT = {"files": ["a.nc", "b.nc"]}
STATED = [
    ({"chart": {"source": "raster", "file": "c.tif"}}, f"land of c.tif {UNREAD}"),
    ({"chart": {"source": "enc", "file": "cells"}}, f"land of cells {UNREAD}"),
    ({"chart": {"source": "current"}, "current": CURRENT}, f"land of a.nc {UNREAD}"),
    ({"bathymetry": {"source": "current"}, "current": CURRENT},
     f"sea bed of a.nc {UNREAD}"),
    ({"chart": {"source": "polygons", "file": "doc.zip"}},
     "land of doc.zip was not looked at: its archive holds 0 files of polygons"),
    ({"chart": {"no_go": "none.json"}}, "land of none.json was not looked at: "),
    ({"bathymetry": {"source": "file", "file": "b.nc"}}, "sea bed of b.nc was not looked at: "),
    ({}, None),
]  # fmt: skip


@pytest.mark.parametrize(("settings", "line"), STATED)
def test_what_is_not_looked_at_is_stated(tmp_path, settings, line):
    (tmp_path / "b.nc").write_bytes(b"CDF")
    with zipfile.ZipFile(tmp_path / "doc.zip", "w") as archive:
        archive.writestr("doc.kml", "<kml/>")
    run = saved(tmp_path, **settings)
    assert read_sources(run) == ()
    assert len(run.notes) == (line is not None)
    assert all(note.startswith(line) and (line.endswith(": ") or note == line) for note in run.notes)


@pytest.mark.parametrize("package", ["pyogrio", "rasterio"])
def test_a_package_that_is_not_installed_is_stated(tmp_path, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    write_geojson(tmp_path / "l.json", geo_feature("Polygon", [ring((0, 0), (0, 9), (9, 9))]))
    write_geotiff(tmp_path / "b.tif", np.zeros((4, 4)))
    chart, bed = {"source": "polygons", "file": "l.json"}, {"source": "file", "file": "b.tif"}
    run = saved(tmp_path, chart=chart, bathymetry=bed)
    (other,) = read_sources(run)
    kind, name = {"pyogrio": ("land", "l.json"), "rasterio": ("sea bed", "b.tif")}[package]
    assert run.notes == [f"{kind} of {name} was not looked at: {package} is not installed"]
    assert other.kind != kind


def test_a_run_on_land_of_its_sources(tmp_path):
    """What the planner misread does not vouch for itself, and what both know counts once."""
    run = make_run()
    summary, data = run.summary(), to_dataset(run)
    assert check_dataset(summary, data, sources=True).ok
    shore = ring((450, 500), (450, 700), (550, 700), (550, 500))
    write_geojson(tmp_path / "land.json", geo_feature("Polygon", [shore]))
    attributes = saved(tmp_path, chart={"source": "polygons", "file": "land.json"}).data.attrs
    scenario = json.loads(data.attrs["scenario"]) | json.loads(attributes["scenario"])
    data.attrs |= attributes | {"scenario": json.dumps(scenario)}
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    data.to_netcdf(tmp_path / "mission.nc", engine="h5netcdf")
    assert check_run(tmp_path, sources=True).coast_hits == 1
    for known, where in ((False, "on land of land.json for"), (True, "on land for")):
        if known:
            data["passability"][45:55, 50:70] = 0
        assert check_dataset(summary, data).coast_hits == known, "files are looked at on request"
        report = check_dataset(summary, data, sources=True)
        assert report.coast_hits == 1
        assert sum(where in fault for fault in report.faults) == 1
        # The first leg goes 400 m north and 600 m east: it is on that land for 100 m north.
        metres = 100.0 * np.linalg.norm([400.0, 600.0, 20.0]) / 400.0
        assert report.coast_metres == pytest.approx(metres, abs=2.0)
