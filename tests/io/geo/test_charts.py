"""Charts from georeferenced pictures and rasters of classes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image
from pyproj import Transformer

from auvplan.io.geo import chart_and_notes, chart_from_raster
from auvplan.io.geo.grid import Extent
from auvplan.ocean.chart import ChartError
from auvplan.ocean.classify import UNCERTAIN_MAX
from auvplan.ocean.palette import ChartColours, to_hex
from auvplan.site import Site
from tests.io.geo.files import SITE, write_geotiff
from tests.io.refusals import refusal

LAND, REEF, WATER = (120, 140, 80), (150, 214, 204), (40, 95, 160)
MEANINGS = {0: 0.0, 1: 0.35, 2: 1.0}
PLACED: dict[str, Any] = {"corner": (SITE.longitude - 0.003, SITE.latitude + 0.002), "scale": (1e-4, 1e-4)}
WHOLE: dict[str, Any] = {"lower": (-210.0, -300.0), "upper": (210.0, 305.0)}


def kinds(chart):
    raster = np.asarray(chart.passability)
    return np.where(raster == 0.0, 0, np.where(raster == 1.0, 2, 1))


def test_the_whitsunday_picture_agrees_with_its_truth(shared):
    """Of a site in its middle with an origin of its own; how the classes are read, other tests ask."""
    maps = shared / "data" / "maps"
    middle = Transformer.from_crs(32755, 4326, always_xy=True).transform(702_200.0, 7_769_100.0)
    site = Site(*middle, origin=(5000.0, 4000.0))
    extent = Extent(lower=(700.0, 300.0), upper=(9300.0, 7100.0))
    chart = chart_from_raster(maps / "whitsunday_hook_passage_rgb.tif", site, extent)
    assert chart.shape == (860, 680)
    np.testing.assert_array_equal(chart.origin, (700.0, 300.0))
    truth = chart_from_raster(maps / "whitsunday_hook_passage_class.tif", site, extent, classes=MEANINGS)
    assert (kinds(chart) == kinds(truth)).mean() > 0.995
    assert (kinds(chart)[::-1] == kinds(truth)).mean() < 0.9


def picture(tmp_path, size=(40, 60), scale=(0.0001, 0.0001)):
    """Land in the north-western corner, reef in the south-eastern one; about 11 m a pixel."""
    colours = np.empty((*size, 3), np.uint8)
    colours[:] = WATER
    colours[: size[0] // 4, : size[1] // 3] = LAND
    colours[-size[0] // 4 :, -size[1] // 3 :] = REEF
    corner = SITE.longitude - size[1] / 2 * scale[0], SITE.latitude + size[0] / 2 * scale[1]
    return write_geotiff(tmp_path / "c.tif", colours, corner=corner, scale=scale)


def test_corners_of_a_small_picture(tmp_path):
    path = picture(tmp_path)
    chart = chart_from_raster(path, SITE, Extent(**WHOLE, pixel_size=5.0))
    assert chart.shape == (84, 121)
    assert not chart.is_water(200.0, -290.0)
    assert chart.is_water([-200.0, 200.0, 0.0], [-290.0, 290.0, 0.0]).all()
    assert 0.0 < float(chart.passability_at(-200.0, 290.0)) <= UNCERTAIN_MAX


@pytest.mark.parametrize("turn", [-360.0, 360.0])
def test_longitudes_of_another_turn(tmp_path, turn):
    classes = np.full((10, 10), 2, np.uint8)
    classes[0, 0] = 0
    path = write_geotiff(tmp_path / "c.tif", classes, corner=(179.995 + turn, 0.005))
    area = {"lower": (-500.0, -500.0), "upper": (500.0, 500.0)}
    chart = chart_from_raster(path, Site(180.0, 0.0), Extent(**area), classes=MEANINGS)
    assert not chart.is_water(495.0, -495.0)
    assert chart.is_water([495.0, -495.0, -495.0], [495.0, -495.0, 495.0]).all()


def test_small_land_is_not_lost_between_coarse_pixels(tmp_path):
    classes = np.full((90, 90), 2, np.uint8)
    classes[40, 33] = 0
    path = write_geotiff(tmp_path / "c.tif", classes, corner=(148.9, -20.3), epsg=4326)
    north, east = SITE.to_local(148.9 + 0.0335, -20.3 - 0.0405)
    for size in (50.0, 200.0, 333.0, 700.0):
        extent = Extent(lower=(-4000.0, -4000.0), upper=(4000.0, 3000.0), pixel_size=size)
        chart = chart_from_raster(path, SITE, extent, classes=MEANINGS)
        assert not chart.is_water(north, east)
        assert chart.shares()["coast"] * np.prod(chart.shape) <= max(9, 150.0**2 / size**2)


@pytest.mark.parametrize("angle", [0.0, 20.0, 30.0, 45.0])
def test_land_is_not_lost_in_the_corners_of_pixels_that_lie_across_a_raster(tmp_path, angle):
    """Islets of 2 m in a raster of about 1 m that is turned: a pixel that each reaches into is coast."""
    north_west = np.random.default_rng(0).integers(95, 205, (300, 2)) * 2
    corners = north_west[:, None] + np.stack(np.meshgrid([0, 1], [0, 1]), axis=-1).reshape(1, 4, 2)
    values = np.full((600, 600), 2, np.uint8)
    values[corners[..., 0], corners[..., 1]] = 0
    place = rasterio.Affine.translation(SITE.longitude, SITE.latitude) @ rasterio.Affine.rotation(angle)
    place = place @ rasterio.Affine.scale(1e-5, -1e-5) @ rasterio.Affine.translation(-300.0, -300.0)
    path = write_geotiff(tmp_path / "c.tif", values, transform=place)
    extent = Extent((-190.0, -190.0), (190.0, 190.0), 10.0)
    chart = chart_from_raster(path, SITE, extent, classes=MEANINGS)
    land = SITE.to_local(*(place @ (corners[..., 1] + 0.5, corners[..., 0] + 0.5)))
    assert not np.asarray(chart.is_water(*land)).all(axis=1).any()


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [
        ((-210.0, -500.0), (210.0, 300.0), r"beyond the picture by 18\d m in the west$"),
        ((-210.0, -300.0), (300.0, 400.0), r"by 7\d m in the north and 8\d m in the east"),
        ((-321.0, -300.0), (200.0, 300.0), r"by 100 m in the south|by 9\d m in the south"),
        ((1e6, 1e6), (1.001e6, 1.001e6), "beyond the picture by .* in the north"),
        ((210.0, 0.0), (-210.0, 300.0), "south-west"),
        ((0.0, float("nan")), (1.0, 1.0), "finite"),
        ((-1e5, -1e5), (1e5, 1e5), "pixel_size 10 m makes .* pixels, more than"),
    ],
)
def test_rectangles_that_the_picture_does_not_cover(tmp_path, lower, upper, words):
    extent = Extent(lower=lower, upper=upper)
    refusal(ChartError, words, chart_from_raster, picture(tmp_path), SITE, extent)


def test_classes_need_a_meaning(tmp_path):
    classes = np.full((10, 10), 2, np.uint8)
    classes[3, 4:6] = 7, 9
    path = write_geotiff(tmp_path / "k.tif", classes, nodata=9, corner=(148.955, -20.335))
    where, colours = Extent(lower=(-200.0, -200.0), upper=(200.0, 200.0)), picture(tmp_path)
    depths = write_geotiff(tmp_path / "f.tif", classes.astype(np.float32), corner=(148.955, -20.335))
    for source, given, words in (
        (path, None, r"k\.tif: a single band of values: say by classes"),
        (path, MEANINGS, r"k\.tif: classes give no meaning to the values 7$"),
        (path, MEANINGS | {7: 0.5}, r"class 7 must be 0, in \(0, 0.35\] or 1, got 0.5"),
        (colours, MEANINGS, "it has three"),
        (depths, MEANINGS, "classes are whole numbers, and its values are float32"),
    ):
        refusal(ChartError, words, chart_from_raster, source, SITE, where, classes=given)
    chart = chart_from_raster(path, SITE, where, classes={**MEANINGS, 7: 0.35})
    assert set(np.unique(kinds(chart))) == {0, 1, 2}  # what is no data is coast


def test_a_picture_of_told_greys(tmp_path):
    grey = np.full((40, 60), 232, np.uint8)
    grey[:10, :20] = 128
    path = write_geotiff(tmp_path / "g.tif", grey, **PLACED)
    refusal(ChartError, r"chart\.colours", chart_from_raster, path, SITE, Extent(**WHOLE))
    colours = ChartColours(water=("#e8e8e8",), land=("grey",))
    chart = chart_from_raster(path, SITE, Extent(**WHOLE), colours=colours)
    assert not chart.is_water(200.0, -290.0)
    assert chart.is_water([-200.0, 200.0, 0.0], [-290.0, 290.0, 0.0]).all()


def half(shade: int = 0) -> np.ndarray:
    """A picture of water, 40 by 60 pixels of 11 m, whose western third shows nothing."""
    colours = np.full((40, 60, 3), WATER, np.uint8)
    colours[:, :20] = shade
    return colours


def by_value(folder: Path) -> Path:
    return write_geotiff(folder / "n.tif", half(), nodata=0, **PLACED)


def by_alpha(folder: Path) -> Path:
    seen = np.full((40, 60), 255, np.uint8)
    seen[:, :20] = 0
    Image.fromarray(np.dstack([half(77), seen])).save(folder / "n.png")
    (west, north), (x, y) = PLACED["corner"], PLACED["scale"]
    (folder / "n.pgw").write_text(f"{x}\n0\n0\n{-y}\n{west + x / 2}\n{north - y / 2}\n")
    return folder / "n.png"


def by_mask(folder: Path, inside: bool = True) -> Path:
    shown = np.arange(60)[None] + np.zeros((40, 1)) >= 20
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=inside):
        path = write_geotiff(folder / "n.tif", half(77), mask=shown, **PLACED)
    assert (folder / "n.tif.msk").exists() == (not inside)
    return path


def by_mask_beside(folder: Path) -> Path:
    return by_mask(folder, inside=False)


@pytest.mark.parametrize("hide", [by_value, by_alpha, by_mask, by_mask_beside])
def test_what_shows_nothing_is_off_the_chart(tmp_path, hide):
    path = hide(tmp_path)
    options: dict[str, Any] = {"crs": 4326} if path.suffix == ".png" else {}
    words = r"n\.\w+: the area reaches with 33.3% of it into what shows no sea area.*"
    words += "between -210 and 210 m north, -300 and -100 m east"
    refusal(ChartError, words, chart_and_notes, path, SITE, Extent(**WHOLE), **options)
    chart, notes = chart_and_notes(path, SITE, Extent(lower=(-210.0, -85.0), upper=(210.0, 305.0)), **options)
    assert np.asarray(chart.passability).min() == 1.0
    (note,) = notes
    assert note.startswith(f"{path}: what is see-through or no data, 33.3% of the picture")


def test_a_hole_in_a_picture_is_closed(tmp_path):
    colours = np.full((40, 60, 3), WATER, np.uint8)
    colours[10:20, 30:40] = 0
    path = write_geotiff(tmp_path / "h.tif", colours, nodata=0, **PLACED)
    chart = chart_from_raster(path, SITE, Extent(**WHOLE))
    assert chart.shares()["coast"] == pytest.approx(0.041, abs=0.005)


@pytest.mark.parametrize("shade", [0, 255])
def test_the_corners_of_a_turned_raster_are_off_the_chart(tmp_path, shade):
    plain = np.full((300, 300, 3), WATER, np.uint8)
    plain[100:140, 120:190] = (214, 196, 146)
    turned = Image.fromarray(plain).rotate(20, expand=True, fillcolor=(shade, shade, shade))
    size = turned.size[0]
    corner = SITE.longitude - 5e-5 * size, SITE.latitude + 5e-5 * size
    path = write_geotiff(tmp_path / "t.tif", np.asarray(turned), corner=corner, scale=(1e-4, 1e-4))
    wide = Extent(lower=(-1800.0, -1800.0), upper=(1800.0, 1800.0))
    words = r"t\.tif: the area reaches with \d+\.\d% of it into what shows no sea"
    refusal(ChartError, words, chart_from_raster, path, SITE, wide)
    chart = chart_from_raster(path, SITE, Extent(lower=(-1000.0, -1000.0), upper=(1000.0, 1000.0)))
    assert 0.05 < chart.shares()["coast"] < 0.1
    named = ChartColours(water=(to_hex(np.array(WATER)),), land=("#d6c492", "black", "white"))
    whole = chart_from_raster(path, SITE, wide, colours=named)
    assert not whole.is_water(1790.0, 1790.0)
