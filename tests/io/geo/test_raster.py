"""Georeferenced rasters: the form, and the files that are read into it or refused."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import rasterio.shutil
import xarray as xr
from PIL import Image
from pyproj import CRS, Transformer

from auvplan.io.geo import GeoError, chart_from_raster, pixel_size, read_raster
from auvplan.io.geo.grid import Extent
from auvplan.io.geo.nodes import placed
from auvplan.ocean.picture import MAX_PIXELS
from auvplan.site import Site
from tests.io.geo.files import write_geotiff, written
from tests.io.refusals import refusal
from tests.io.small_site import png_head

RNG = np.random.default_rng(3)
VALUES = RNG.integers(0, 200, (7, 5)).astype(np.int16)
COLOURS = RNG.integers(0, 255, (7, 5, 3)).astype(np.uint8)
TURNED = rasterio.Affine(8.0, 6.0, 697_000.0, 6.0, -8.0, 7_774_000.0)
WORLD = "10.0\n1.0\n2.0\n-20.0\n697205.0\n7774095.0\n"


def transform(raster: xr.DataArray) -> rasterio.Affine:
    return rasterio.Affine.from_gdal(*map(float, raster.spatial_ref.attrs["GeoTransform"].split()))


def check_form(raster: xr.DataArray) -> None:
    """The contract of `read_raster`."""
    assert raster.dims in (("y", "x"), ("band", "y", "x"))
    assert raster.ndim == 2 or (raster.sizes["band"] == 3 and raster.dtype == np.uint8)
    system = CRS.from_wkt(raster.spatial_ref.attrs["crs_wkt"])
    assert system.is_geographic or system.is_projected
    place = transform(raster)
    assert ("x" in raster.coords) == ("y" in raster.coords) == (place.b == place.d == 0.0)
    if "x" in raster.coords:
        for k in (0, -1):
            centre = place @ (np.arange(raster.sizes["x"])[k] + 0.5, np.arange(raster.sizes["y"])[k] + 0.5)
            np.testing.assert_allclose((raster.x[k], raster.y[k]), centre, rtol=1e-13)
    if "mask" in raster.coords:
        assert raster.mask.dims == ("y", "x")
        assert raster.mask.dtype == bool


def tiff(values: np.ndarray, **options: Any) -> Callable[[Path], Path]:
    return lambda folder: write_geotiff(folder / "a.tif", values, **options)


def by_gdal(driver: str, name: str, values: np.ndarray, **options: Any) -> Callable[[Path], Path]:
    """What GDAL makes of a GeoTIFF, in degrees from 148 E and 20 S."""

    def write(folder: Path) -> Path:
        path = write_geotiff(
            folder / "t.tif", values, corner=(148.0, -20.0), nodata=options.pop("nodata", None)
        )
        rasterio.shutil.copy(path, folder / name, driver=driver, **options)
        return folder / name

    return write


def palette(folder: Path) -> Path:
    path = write_geotiff(folder / "p.tif", np.array([[0, 1], [1, 1]], np.uint8), photometric="PALETTE")
    with rasterio.open(path, "r+") as file:
        file.write_colormap(1, {0: (0, 0, 0, 255), 1: (18, 255, 7, 255)})
    return path


ALPHA = np.dstack([COLOURS, np.where(COLOURS[..., 0] > 100, 255, 0).astype(np.uint8)])
HEIGHTS = RNG.uniform(-90.0, 10.0, (64, 80)).astype(np.float32)
HEIGHTS[3, 4] = -9999.0
SHADES = np.stack(np.broadcast_arrays(*np.mgrid[:40, :52], 7), axis=-1).astype(np.uint8) * 4
DEFLATED = {"compress": "deflate", "tiled": True, "blockxsize": 16, "blockysize": 16}
ON_WHITE = np.where(ALPHA[..., 3:] == 255, COLOURS, 255)


@pytest.mark.parametrize(
    ("write", "values", "options"),
    [
        (tiff(VALUES), VALUES, {}),
        (tiff(VALUES, epsg=None), VALUES, {"crs": "EPSG:4326"}),
        (tiff(COLOURS, transform=TURNED, epsg=32755), COLOURS, {}),
        (tiff(COLOURS.astype(np.uint16) * 257), COLOURS, {}),
        (tiff(ALPHA, alpha="YES"), ON_WHITE, {}),
        (tiff(SHADES, interleave="band", compress="lzw"), SHADES, {}),
        (tiff(SHADES, **DEFLATED), SHADES, {}),
        (tiff(VALUES, compress="lerc"), VALUES, {}),
        (tiff(COLOURS[..., 0], photometric="MINISWHITE"), 255 - COLOURS[..., 0], {}),
        (tiff(COLOURS[..., 0], photometric="MINISWHITE"), COLOURS[..., 0], {"numbers": True}),
        (palette, [[[0, 0, 0], [18, 255, 7]], [[18, 255, 7]] * 2], {}),
        (palette, [[0, 1], [1, 1]], {"numbers": True}),
        (by_gdal("AAIGrid", "a.asc", HEIGHTS, nodata=-9999.0), HEIGHTS, {"crs": 4326}),
        (by_gdal("GSBG", "s.grd", HEIGHTS, nodata=-9999.0), HEIGHTS, {"crs": 4326}),
        (by_gdal("HFA", "e.img", HEIGHTS, nodata=-9999.0), HEIGHTS, {}),
        (by_gdal("JP2OpenJPEG", "j.jp2", SHADES, QUALITY="100", REVERSIBLE="YES"), SHADES, {}),
        (by_gdal("GPKG", "g.gpkg", SHADES, TILE_FORMAT="PNG"), SHADES, {}),
    ],
)
def test_files_of_all_kinds(tmp_path, write, values, options):
    raster = read_raster(write(tmp_path), **options)
    check_form(raster)
    found, values = raster.transpose("y", "x", ...).values, np.asarray(values)
    missing = values == -9999.0
    np.testing.assert_allclose(found[~missing], values[~missing], rtol=1e-5)
    assert (found[missing] == raster.attrs.get("_FillValue")).all()
    assert ("mask" in raster.coords) == (values is ON_WHITE)


def test_pixels_of_areas_and_of_points(tmp_path):
    where: dict[str, Any] = {"corner": (148.0, -20.0), "scale": (0.5, 0.25)}
    area = read_raster(write_geotiff(tmp_path / "a.tif", VALUES, **where))
    np.testing.assert_allclose(area.x, 148.25 + 0.5 * np.arange(5))
    np.testing.assert_allclose(area.y, -20.125 - 0.25 * np.arange(7))
    point = read_raster(write_geotiff(tmp_path / "p.tif", VALUES, point=True, **where))
    np.testing.assert_allclose((point.x[0], point.y[0]), (148.0, -20.0))


@pytest.mark.parametrize(
    "system", [4326, 32755, "+proj=laea +lat_0=-20 +lon_0=149 +datum=WGS84 +units=us-ft"]
)
@pytest.mark.parametrize("skew", [0.0, 0.2])
def test_nodes_are_pixel_centres(tmp_path, system, skew):
    forward = Transformer.from_crs("EPSG:4326", system, always_xy=True)
    x, y = forward.transform(149.0, -20.0)
    step = 1e-3 if system == 4326 else 50.0
    place = rasterio.Affine(step, skew * step, x, -skew * step, -step, y)
    path = write_geotiff(tmp_path / "a.tif", VALUES, transform=place, epsg=system)
    site = Site(149.0, -20.0)
    array, nodes = placed("a", read_raster(path), site, Extent((-300.0, 0.0), (0.0, 300.0), 50.0).grid())
    assert array.shape == nodes.shape == (7, 5)
    row, column = np.array([2.0, 4.25]), np.array([3.0, 0.5])
    places = forward.transform(*(place @ (column + 0.5, row + 0.5)), direction="INVERSE")
    np.testing.assert_allclose(nodes.find(*map(np.asarray, places)), (row, column), atol=2e-4)


def test_what_shows_nothing(tmp_path):
    colours = np.array(COLOURS)
    colours[2:4] = 0
    raster = read_raster(write_geotiff(tmp_path / "n.tif", colours, nodata=0))
    assert (np.flatnonzero(~raster.mask.any("x")) == [2, 3]).all()
    shown = np.arange(35).reshape(7, 5) % 3 > 0
    raster = read_raster(write_geotiff(tmp_path / "m.tif", VALUES, mask=shown))
    np.testing.assert_array_equal(raster.mask, shown)


@pytest.mark.parametrize(
    ("name", "world"),
    [("a.png", "a.pgw"), ("a.jpg", "a.JGW"), ("a.png", "a.wld"), ("a.tif", "a.tfw"), ("A.PNG", "a.pngw")],
)
def test_a_world_file_gives_the_centre_of_the_first_pixel(tmp_path, name, world):
    Image.fromarray(COLOURS).save(tmp_path / name)
    (tmp_path / world).write_text(WORLD)
    place = transform(read_raster(tmp_path / name, crs=32755))
    assert place @ (0.5, 0.5) == (697205.0, 7774095.0)
    assert place @ (1.5, 0.5) == (697215.0, 7774096.0)
    assert place @ (0.5, 1.5) == (697207.0, 7774075.0)
    (tmp_path / "a.prj").write_text(CRS.from_epsg(32755).to_wkt("WKT1_ESRI"))
    if name[0] == "a":
        check_form(read_raster(tmp_path / name))
        refusal(GeoError, r"not in WGS 84 as crs says", read_raster, tmp_path / name, crs=4326)


def test_what_a_sidecar_gives(tmp_path):
    """As ArcGIS and GDAL write it beside files that have no place of their own."""
    place = rasterio.Affine(20.0, 3.0, 697200.0, 2.0, -20.0, 7774100.0)
    for driver, name in (("PNG", "p.png"), ("GTiff", "b.tif")):
        write_geotiff(tmp_path / "t.tif", COLOURS, epsg=32755, transform=place)
        more = {"PROFILE": "BASELINE"} if driver == "GTiff" else {}
        rasterio.shutil.copy(tmp_path / "t.tif", tmp_path / name, driver=driver, **more)
        assert (tmp_path / f"{name}.aux.xml").exists()
        raster = read_raster(tmp_path / name)
        assert transform(raster).almost_equals(place)
        np.testing.assert_array_equal(raster.transpose("y", "x", "band"), COLOURS)
        size = pixel_size(tmp_path / name)
        assert size is not None
        assert size.metres == pytest.approx(20.1, rel=0.01)
    kept = (tmp_path / "b.tif.aux.xml").read_text()
    path = write_geotiff(tmp_path / "b.tif", COLOURS, corner=(148.0, -20.0))
    for text, words in (
        (kept, r"b\.tif: lies elsewhere by its tags than by b\.tif\.aux\.xml"),
        ("<PAMDataset><SRS>EPSG:32755</SRS></PAMDataset>", "is in WGS 84, but by b.tif.aux.xml in"),
        ("<PAMDataset>", r"b\.tif\.aux\.xml: is damaged"),
    ):
        (tmp_path / "b.tif.aux.xml").write_text(text)
        refusal(GeoError, words, read_raster, path)


def picture(**options: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        Image.fromarray(COLOURS).save(folder / "f.png")
        for name, text in options.items():
            (folder / f"f.{name}").write_text(text)
        return folder / "f.png"

    return write


def content(name: str, data: bytes) -> Callable[[Path], Path]:
    return lambda folder: written(folder / name, data)


def cut(folder: Path) -> Path:
    path = write_geotiff(folder / "c.tif", RNG.integers(0, 255, (64, 64, 3)).astype(np.uint8), compress="lzw")
    path.write_bytes(path.read_bytes()[:6000])
    return path


@pytest.mark.parametrize(
    ("write", "crs", "words"),
    [
        (lambda folder: folder / "nowhere.tif", None, r"nowhere\.tif: No such file"),
        (content("f.png", png_head(10_000, 9_000)), None, f"10000 x 9000 pixels .* than {MAX_PIXELS}"),
        (content("f.png", b"this is a letter"), None, "not a picture"),
        (content("f.tif", b""), None, "not a picture"),
        (content("f.tif", b"II*\0\x08\0\0\0\x05\0"), None, "f.tif: "),
        (cut, None, r"c\.tif: "),
        (picture(), 32755, r"not georeferenced, by its own tags or by a world file: f\.wld or f\.pngw"),
        (picture(pgw=WORLD), None, "set crs"),
        (picture(pgw=WORLD), "EPSG:1", "is no coordinate reference system"),
        (picture(pgw=WORLD), 4978, "neither geographic nor projected"),
        (picture(pgw="1 2 3"), 32755, r"f\.pgw: a world file holds six numbers"),
        (picture(pgw="0\n0\n0\n0\n1\n1\n"), 32755, "sizes are not zero"),
        (picture(pgw=WORLD, prj="here"), None, r"f.prj: holds no coordinate"),
        (tiff(VALUES, epsg=None), None, r"a\.tif: has no coordinate reference system: set crs"),
        (tiff(VALUES), 32755, "is in WGS 84, not in WGS 84 / UTM zone 55S as crs says"),
        (tiff(np.zeros((4, 4, 2), np.uint8), photometric="MINISBLACK"), 4326, "2 bands"),
        (tiff(COLOURS, photometric="MINISBLACK"), 4326, "no red, green and blue"),
        (tiff(COLOURS.astype(np.float32)), 4326, "must be colours of 8 or 16 bit, got float32"),
    ],
)  # fmt: skip
def test_files_that_are_refused(tmp_path, write, crs, words):
    refusal(GeoError, words, lambda: read_raster(write(tmp_path), crs))


# Arrays of a user's own


def chart(array: xr.DataArray | Path, **options: Any) -> np.ndarray:
    area = {"lower": (-600.0, 100.0), "upper": (-100.0, 400.0), "pixel_size": 50.0}
    meanings = {int(value): float(value % 2) for value in np.unique(VALUES)}
    found = chart_from_raster(array, Site(148.0, -20.0), Extent(**area), classes=meanings, **options)
    return np.asarray(found.passability)


def test_arrays_in_place_of_files(tmp_path):
    path = write_geotiff(tmp_path / "a.tif", VALUES, corner=(148.0, -20.0))
    expected = chart(path)
    assert 0.0 < expected.mean() < 1.0
    axes = {"y": -20.0005 - 0.001 * np.arange(7), "x": 148.0005 + 0.001 * np.arange(5)}
    by_hand = xr.DataArray(VALUES, axes)
    named = by_hand.rename(x="lon", y="lat")
    for array in (read_raster(path), by_hand.assign_attrs(crs=4326), named, named[::-1], named.T):
        np.testing.assert_array_equal(chart(array), expected)
    np.testing.assert_array_equal(chart(by_hand, crs=4326), expected)
    masked = by_hand.assign_coords(mask=(("y", "x"), np.zeros((7, 5))))
    assert (chart(masked, crs=4326) == 0.0).all()


# How large the pixels are


@pytest.mark.parametrize(
    ("where", "metres", "tolerance"),
    [
        ({"corner": (148.0, 0.0)}, 111.0, 0.005),
        ({"corner": (1e6, 8_399_738.0), "scale": (300.0, 300.0), "epsg": 3857}, 150.0, 0.01),  # at 60 N
        ({"corner": (5e5, 7_774_100.0), "scale": (300.0, 300.0), "epsg": 32755}, 300.0, 1e-3),
        ({"corner": (10.0, 60.0)}, 111.4 * np.sqrt(0.5), 0.01),
    ],
)
def test_pixels_of_a_geotiff_are_measured_on_the_ellipsoid(tmp_path, where, metres, tolerance):
    size = pixel_size(write_geotiff(tmp_path / "d.tif", COLOURS, **where))
    assert size is not None
    assert size.metres == pytest.approx(metres, rel=tolerance)
    assert size.crs
    assert ["55.81 m by 111.4 m" in note for note in size.notes] == [True] * (where["corner"][0] == 10.0)


@pytest.mark.parametrize(
    ("world", "system", "metres", "note"),
    [
        ("300\n0\n0\n-300\n697205\n7774095\n", "", 300.0, "taken for metres"),
        ("300\n0\n0\n-300\n697205\n7774095\n", CRS.from_epsg(32755).to_wkt("WKT1_ESRI"), 300.0, ""),
        ("0.001\n0\n0\n-0.001\n148\n0.5\n", "", 111.0, "taken for degrees"),
    ],
    ids=["metres", "projection", "degrees"],
)
def test_pixels_of_a_world_file(tmp_path, world, system, metres, note):
    path = picture()(tmp_path)
    assert pixel_size(path) is None
    size = pixel_size(picture(pgw=world, **({"prj": system} if system else {}))(tmp_path))
    assert size is not None
    assert size.metres == pytest.approx(metres, rel=0.005)
    assert (size.crs, note in "".join(size.notes), bool(note)) == (bool(system), True, bool(size.notes))
