"""Rasters that know where on Earth they lie."""

import contextlib
import shutil
import sys

import numpy as np
import pytest
import tifffile
from PIL import Image
from pyproj import CRS, Transformer

from auvplan.io.geo import GeoError, pixel_size, read_raster
from auvplan.ocean.picture import MAX_PIXELS
from tests.io.geo.files import write_geotiff
from tests.ocean.test_chart_files import png_header

RNG = np.random.default_rng(3)
VALUES = RNG.integers(0, 200, (7, 5)).astype(np.int16)
COLOURS = RNG.integers(0, 255, (7, 5, 3)).astype(np.uint8)


def place(raster, row, column):
    """x and y of a point in pixels from the outer corner of the first."""
    a, b, c, d, e, f = raster.affine
    return a * column + b * row + c, d * column + e * row + f


def test_pixels_of_areas_and_of_points(tmp_path):
    area = read_raster(write_geotiff(tmp_path / "a.tif", VALUES, corner=(148.0, -20.0), scale=(0.5, 0.25)))
    assert place(area, 0, 0) == (148.0, -20.0)
    assert place(area, 7, 5) == pytest.approx((150.5, -21.75))
    assert area.crs == CRS.from_epsg(4326)
    np.testing.assert_array_equal(area.values, VALUES)
    path = write_geotiff(tmp_path / "p.tif", VALUES, corner=(148.0, -20.0), scale=(0.5, 0.25), point=True)
    assert place(read_raster(path), 0.5, 0.5) == pytest.approx((148.0, -20.0))


def test_nodes_find_pixel_centres_by_longitude_and_latitude(tmp_path):
    path = write_geotiff(tmp_path / "a.tif", VALUES, corner=(148.0, -20.0), scale=(0.5, 0.25))
    row, column = (
        read_raster(path).nodes().find(np.array([148.0 + 3.5 * 0.5]), np.array([-20.0 - 2.5 * 0.25]))
    )
    np.testing.assert_allclose((row[0], column[0]), (2.0, 3.0), atol=1e-9)


def test_a_matrix_turns_and_skews(tmp_path):
    matrix = np.array([[8.0, 6.0, 0, 697_000.0], [6.0, -8.0, 0, 7_774_000.0], [0, 0, 0, 0], [0, 0, 0, 1.0]])
    raster = read_raster(write_geotiff(tmp_path / "m.tif", COLOURS, matrix=matrix, epsg=32755))
    assert place(raster, 2, 3) == (697_000.0 + 36.0, 7_774_000.0 + 2.0)
    shifted = read_raster(write_geotiff(tmp_path / "q.tif", COLOURS, matrix=matrix, epsg=32755, point=True))
    assert place(shifted, 2.5, 3.5) == pytest.approx(place(raster, 2, 3))


def test_the_same_as_rasterio_reads(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    matrix = np.array([[8.0, 6.0, 0, 697_000.0], [6.0, -8.0, 0, 7_774_000.0], [0, 0, 0, 0], [0, 0, 0, 1.0]])
    paths = [
        write_geotiff(tmp_path / "a.tif", VALUES, corner=(148.0, -20.0), scale=(0.5, 0.25), nodata="-7"),
        write_geotiff(tmp_path / "p.tif", VALUES, corner=(148.0, -20.0), point=True),
        write_geotiff(tmp_path / "m.tif", COLOURS, matrix=matrix, epsg=32755),
    ]
    for path in paths:
        raster = read_raster(path)
        with rasterio.open(path) as twin:
            np.testing.assert_allclose(raster.affine, tuple(twin.transform)[:6], rtol=1e-14)
            assert raster.crs.to_epsg() == twin.crs.to_epsg()
            assert raster.nodata == twin.nodata
            bands = np.moveaxis(twin.read(), 0, -1)
            np.testing.assert_array_equal(raster.values, bands[..., 0] if raster.values.ndim == 2 else bands)


@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_bands_side_by_side_or_one_after_the_other(tmp_path, planar):
    given = COLOURS if planar == "contig" else np.moveaxis(COLOURS, -1, 0)
    path = write_geotiff(tmp_path / "c.tif", given, planarconfig=planar, photometric="rgb")
    np.testing.assert_array_equal(read_raster(path).values, COLOURS)


def test_a_table_of_colours_as_colours_or_as_numbers(tmp_path):
    table = np.zeros((3, 256), np.uint16)
    table[:, 1] = 0x1234, 0xFF00, 0x0080
    path = tmp_path / "t.tif"
    write_geotiff(path, np.array([[0, 1]], np.uint8), photometric="palette", colormap=table)
    assert read_raster(path).values.tolist() == [[[0, 0, 0], [0x12, 0xFF, 0]]]
    assert read_raster(path, indices=True).values.tolist() == [[0, 1]]


def test_see_through_pixels_are_white(tmp_path):
    layer = np.dstack([COLOURS, np.where(COLOURS[..., 0] > 100, 255, 0).astype(np.uint8)])
    path = write_geotiff(tmp_path / "s.tif", layer, photometric="rgb", extrasamples=["unassalpha"])
    values = read_raster(path).values
    opaque = layer[..., 3] == 255
    np.testing.assert_array_equal(values[opaque], COLOURS[opaque])
    assert (values[~opaque] == 255).all()


WORLD = "10.0\n1.0\n2.0\n-20.0\n697205.0\n7774095.0\n"


@pytest.mark.parametrize(
    ("name", "world"),
    [("a.png", "a.pgw"), ("a.jpg", "a.JGW"), ("a.png", "a.wld"), ("a.tif", "a.tfw"), ("A.PNG", "a.pngw")],
)
def test_a_world_file_gives_the_centre_of_the_first_pixel(tmp_path, name, world):
    Image.fromarray(COLOURS).save(tmp_path / name)
    (tmp_path / world).write_text(WORLD)
    raster = read_raster(tmp_path / name, crs=32755)
    assert place(raster, 0.5, 0.5) == (697205.0, 7774095.0)
    assert place(raster, 0.5, 1.5) == (697215.0, 7774096.0)
    assert place(raster, 1.5, 0.5) == (697207.0, 7774075.0)
    assert raster.values.shape == COLOURS.shape


def test_a_projection_file_beside_the_picture(tmp_path):
    Image.fromarray(COLOURS).save(tmp_path / "a.png")
    (tmp_path / "a.pgw").write_text(WORLD)
    (tmp_path / "a.prj").write_text(CRS.from_epsg(32755).to_wkt("WKT1_ESRI"))
    assert read_raster(tmp_path / "a.png").crs.is_projected
    with pytest.raises(GeoError, match=r"not in WGS 84 as crs says"):
        read_raster(tmp_path / "a.png", crs=4326)


def compressed(path, values, compress):
    """A file that rasterio writes."""
    rasterio = pytest.importorskip("rasterio")
    profile = {
        "driver": "GTiff",
        "width": 5,
        "height": 7,
        "count": 1,
        "dtype": values.dtype,
        "crs": "EPSG:4326",
    }
    where = rasterio.Affine(0.1, 0.0, 148.0, 0.0, -0.1, -20.0)
    with rasterio.open(path, "w", **profile, transform=where, compress=compress) as file:
        file.write(values, 1)
    return path


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
def test_compressions_that_tifffile_lacks(tmp_path, dtype):
    values = VALUES.astype(dtype)
    for compress in ("lzw", "lerc"):
        path = compressed(tmp_path / f"{compress}.tif", values, compress)
        np.testing.assert_array_equal(read_raster(path).values, values)


@pytest.mark.parametrize("interleave", ["pixel", "band"])
@pytest.mark.parametrize("compress", ["none", "lzw", "deflate", "packbits", "jpeg", "zstd", "webp"])
@pytest.mark.parametrize("tiled", [False, True])
def test_colours_of_every_layout_and_compression_are_rasterios(tmp_path, interleave, compress, tiled):
    rasterio = pytest.importorskip("rasterio")
    if compress == "webp" and interleave == "band":
        pytest.skip("the format has no such file")
    rows, columns = np.mgrid[:40, :52]
    colours = np.stack([4 * columns, 6 * rows, 255 - 2 * columns - 3 * rows]).astype(np.uint8)
    path = tmp_path / "c.tif"
    options = {"tiled": True, "blockxsize": 16, "blockysize": 16} if tiled else {}
    where = rasterio.Affine(0.1, 0.0, 148.0, 0.0, -0.1, -20.0)
    with rasterio.open(
        path, "w", driver="GTiff", width=52, height=40, count=3, dtype="uint8", crs="EPSG:4326",
        transform=where, compress=compress, interleave=interleave, photometric="RGB", **options,
    ) as file:  # fmt: skip
        file.write(colours)
    with rasterio.open(path) as twin:
        bands = np.moveaxis(twin.read(), 0, -1)
    # Two decoders of JPEG round differently.
    off = np.abs(read_raster(path).values.astype(int) - bands)
    assert off.max() <= (2 if compress == "jpeg" else 0)


def test_a_real_picture_whose_bands_follow_each_other(shared):
    rasterio = pytest.importorskip("rasterio")
    path = shared / "data/elsewhere/world_rgb_lzw_band.tif"
    with rasterio.open(path) as twin:
        np.testing.assert_array_equal(read_raster(path).values, np.moveaxis(twin.read(), 0, -1))


def test_a_compression_that_only_the_extra_reads(tmp_path, monkeypatch):
    path = compressed(tmp_path / "l.tif", VALUES, "lerc")
    with tifffile.TiffFile(path) as file, contextlib.suppress(ValueError):
        file.pages[0].asarray()
        pytest.skip("tifffile reads it here")
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(GeoError, match=r"compressed as LERC, which needs pip install 'auvplan\[readers\]'"):
        read_raster(path)


def tiff_header(width: int, height: int) -> bytes:
    """A TIFF that promises a size and holds no pixels."""
    entries = [(256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 1)]
    entries += [(273, 4, 1, 8), (277, 3, 1, 1), (278, 4, 1, height), (279, 4, 1, 1)]
    words = [
        np.array([tag, kind], "<u2").tobytes() + np.array([n, v], "<u4").tobytes()
        for tag, kind, n, v in entries
    ]
    return b"II*\0" + np.array([8], "<u4").tobytes() + bytes([len(words), 0]) + b"".join(words) + bytes(4)


def good_png(folder):
    Image.fromarray(COLOURS).save(folder / "f.png")
    return (folder / "f.png").read_bytes()


@pytest.mark.parametrize(
    ("name", "content", "beside", "crs", "words"),
    [
        ("f.png", png_header(10_000, 9_000), {}, None, f"10000 x 9000 pixels are more than {MAX_PIXELS}"),
        ("f.tif", tiff_header(100_000, 90_000), {}, None, "100000 x 90000 pixels are more than"),
        ("f.tif", tiff_header(0, 9), {}, None, "are no picture"),
        ("f.png", b"this is a letter", {}, None, "not a picture"),
        ("f.tif", b"", {}, None, "not a picture"),
        ("f.tif", b"II*\0", {}, None, "f.tif: "),
        ("f.tif", b"II*\0\x08\0\0\0\x05\0", {}, None, "f.tif: "),
        ("f.png", good_png, {}, 32755, r"no world file \(f.pgw, f.pngw, f.wld, f.pngw\)|no world file"),
        ("f.png", good_png, {"f.pgw": WORLD}, None, "set crs"),
        ("f.png", good_png, {"f.pgw": WORLD}, "EPSG:1", "is no coordinate reference system"),
        ("f.png", good_png, {"f.pgw": WORLD}, 4978, "neither geographic nor projected"),
        ("f.png", good_png, {"f.pgw": "1 2 3"}, 32755, "six numbers, got '1 2 3'"),
        ("f.png", good_png, {"f.pgw": WORLD.replace(".", ",")}, 32755, "six numbers"),
        ("f.png", good_png, {"f.pgw": "0 0 0 0 1 1"}, 32755, "pixels have no size"),
        ("f.png", good_png, {"f.pgw": "nan 0 0 1 1 1"}, 32755, "pixels have no size"),
        ("f.png", good_png, {"f.pgw": WORLD, "f.prj": "here"}, None, r"f.prj: holds no coordinate"),
    ],
)  # fmt: skip
def test_files_that_are_no_rasters(tmp_path, name, content, beside, crs, words):
    (tmp_path / name).write_bytes(content(tmp_path) if callable(content) else content)
    for other, text in beside.items():
        (tmp_path / other).write_text(text)
    with pytest.raises(GeoError, match=words) as caught:
        read_raster(tmp_path / name, crs)
    assert "\n" not in str(caught.value)


def test_missing_files_and_missing_keys(tmp_path):
    with pytest.raises(GeoError, match=r"nowhere\.tif: No such file"):
        read_raster(tmp_path / "nowhere.tif")
    path = write_geotiff(tmp_path / "k.tif", VALUES, epsg=None)
    with pytest.raises(GeoError, match=r"k\.tif: no GeoTIFF keys tell .* set crs"):
        read_raster(path)
    assert read_raster(path, crs="EPSG:4326").crs.is_geographic
    with pytest.raises(GeoError, match="name no EPSG"):
        read_raster(write_geotiff(tmp_path / "u.tif", VALUES, epsg=32767))
    with pytest.raises(GeoError, match="EPSG:32799 is no coordinate"):
        read_raster(write_geotiff(tmp_path / "e.tif", VALUES, epsg=32799))
    with pytest.raises(GeoError, match="is in WGS 84, not in WGS 84 / UTM zone 55S as crs says"):
        read_raster(write_geotiff(tmp_path / "o.tif", VALUES), crs=32755)
    with pytest.raises(GeoError, match="its pixels have no size"):
        read_raster(write_geotiff(tmp_path / "z.tif", VALUES, scale=(0.0, 1.0)))
    two = tmp_path / "b.tif"
    tifffile.imwrite(two, np.zeros((4, 4, 2), np.uint8), planarconfig="contig", photometric="minisblack")
    with pytest.raises(GeoError, match="2 bands"):
        read_raster(two, crs=4326)


def test_a_cut_off_file(tmp_path):
    path = write_geotiff(
        tmp_path / "c.tif", RNG.integers(0, 255, (64, 64, 3)).astype(np.uint8), compression="zlib"
    )
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(GeoError, match=r"c\.tif: ") as caught:
        read_raster(path)
    assert "\n" not in str(caught.value)


def test_whitsunday_picture_lies_where_its_keys_say(shared, tmp_path):
    maps = shared / "data" / "maps"
    raster = read_raster(maps / "whitsunday_hook_passage_rgb.tif")
    assert raster.affine == (10.0, 0.0, 697_200.0, 0.0, -10.0, 7_774_100.0)
    assert raster.crs.to_epsg() == 32755
    shutil.copy(maps / "whitsunday_hook_passage.png", tmp_path / "hook.png")
    (tmp_path / "hook.pgw").write_text("10\n0\n0\n-10\n697205\n7774095\n")
    twin = read_raster(tmp_path / "hook.png", crs=32755)
    assert twin.affine == raster.affine
    assert twin.values.shape == raster.values.shape


# How large the pixels are


def test_pixels_of_a_geotiff_are_measured_on_the_ellipsoid(tmp_path):
    degrees = write_geotiff(tmp_path / "d.tif", COLOURS, corner=(148.0, 0.0), scale=(0.001, 0.001))
    size = pixel_size(degrees)
    assert size.metres == pytest.approx(111.0, rel=0.005)
    assert size.crs
    assert size.notes == ()
    mercator = write_geotiff(
        tmp_path / "m.tif", COLOURS, corner=(1e6, 8_399_738.0), scale=(300.0, 300.0), epsg=3857
    )
    assert pixel_size(mercator).metres == pytest.approx(150.0, rel=0.01), (
        "the map is stretched twofold at 60 N"
    )
    utm = write_geotiff(
        tmp_path / "u.tif", COLOURS, corner=(5e5, 7_774_100.0), scale=(300.0, 300.0), epsg=32755
    )
    assert pixel_size(utm).metres == pytest.approx(300.0, rel=1e-3)


def test_pixels_that_are_no_squares_are_stated(tmp_path):
    path = write_geotiff(tmp_path / "d.tif", COLOURS, corner=(10.0, 60.0), scale=(0.001, 0.001))
    size = pixel_size(path)
    assert size.metres == pytest.approx(111.4 * np.sqrt(0.5), rel=0.01)
    assert "55.81 m by 111.4 m" in size.notes[0]


@pytest.mark.parametrize(
    ("name", "world"), [("a.png", "a.pgw"), ("a.jpg", "a.jgw"), ("a.tif", "a.tfw"), ("a.png", "a.wld")]
)
def test_pixels_of_a_world_file(tmp_path, name, world):
    Image.fromarray(COLOURS).save(tmp_path / name)
    assert pixel_size(tmp_path / name) is None
    (tmp_path / world).write_text("300\n0\n0\n-300\n697205\n7774095\n")
    size = pixel_size(tmp_path / name)
    assert size.metres == 300.0
    assert not size.crs
    assert "taken for metres" in size.notes[0]
    (tmp_path / "a.prj").write_text(CRS.from_epsg(32755).to_wkt("WKT1_ESRI"))
    size = pixel_size(tmp_path / name)
    assert size.metres == pytest.approx(300.0, rel=1e-3)
    assert size.crs
    assert size.notes == ()
    (tmp_path / "a.prj").unlink()
    (tmp_path / world).write_text("0.001\n0\n0\n-0.001\n148\n0.5\n")
    size = pixel_size(tmp_path / name)
    assert size.metres == pytest.approx(111.0, rel=0.005)
    assert "taken for degrees" in size.notes[0]
    (tmp_path / world).write_text("300\n0\n")
    with pytest.raises(GeoError, match="six numbers"):
        pixel_size(tmp_path / name)


def test_pixels_without_data_are_stated(tmp_path):
    colours = np.array(COLOURS)
    colours[2:4] = 0
    path = write_geotiff(tmp_path / "n.tif", colours, nodata="0")
    assert (np.flatnonzero(read_raster(path).blank.all(axis=1)) == [2, 3]).all()
    layer = np.dstack([COLOURS, np.full((7, 5), 255, np.uint8)])
    layer[0, :, 3] = 0
    Image.fromarray(layer).save(tmp_path / "s.png")
    (tmp_path / "s.pgw").write_text(WORLD)
    assert (np.flatnonzero(read_raster(tmp_path / "s.png", crs=32755).blank.any(axis=1)) == [0]).all()
    assert read_raster(write_geotiff(tmp_path / "v.tif", VALUES)).blank is None


def test_what_a_sidecar_tells_of_the_place(tmp_path):
    """As ArcGIS and GDAL write it beside files that cannot tell themselves."""
    rasterio = pytest.importorskip("rasterio")
    place_ = rasterio.Affine(20.0, 3.0, 697200.0, 2.0, -20.0, 7774100.0)
    size = {"width": 5, "height": 7, "count": 3, "dtype": "uint8"}
    for driver, name in (("PNG", "p.png"), ("GTiff", "b.tif")):
        more = {"PROFILE": "BASELINE"} if driver == "GTiff" else {}
        with rasterio.open(tmp_path / name, "w", driver, crs=32755, transform=place_, **size, **more) as file:
            file.write(np.moveaxis(COLOURS, -1, 0))
        assert (tmp_path / f"{name}.aux.xml").exists()
        raster = read_raster(tmp_path / name)
        np.testing.assert_allclose(raster.affine, tuple(place_)[:6])
        assert raster.crs.to_epsg() == 32755
        np.testing.assert_array_equal(raster.values, COLOURS)
        size_ = pixel_size(tmp_path / name)
        assert size_ is not None
        assert size_.metres == pytest.approx(20.1, rel=0.01)
    beside = tmp_path / "b.tif.aux.xml"
    path = write_geotiff(tmp_path / "b.tif", COLOURS, corner=(148.0, -20.0))
    with pytest.raises(GeoError, match=r"b\.tif: lies elsewhere by its tags than by b\.tif\.aux\.xml"):
        read_raster(path)
    beside.write_text("<PAMDataset><SRS>EPSG:32755</SRS></PAMDataset>")
    with pytest.raises(GeoError, match=r"b\.tif: is in WGS 84, but by b\.tif\.aux\.xml in WGS 84 / UTM zone"):
        read_raster(path)


def test_greys_that_count_from_white_are_turned(tmp_path):
    path = write_geotiff(tmp_path / "w.tif", COLOURS[..., 0], photometric="miniswhite")
    np.testing.assert_array_equal(read_raster(path).values, 255 - COLOURS[..., 0])
    np.testing.assert_array_equal(read_raster(path, indices=True).values, COLOURS[..., 0])


@pytest.mark.parametrize(
    ("driver", "name"),
    [("AAIGrid", "a.asc"), ("GSBG", "s.grd"), ("HFA", "e.img"), ("JP2OpenJPEG", "j.jp2"), ("GPKG", "g.gpkg")],
)
def test_formats_that_gdal_reads(tmp_path, driver, name):
    rasterio = pytest.importorskip("rasterio")
    shutil_ = pytest.importorskip("rasterio.shutil")
    colour = driver in ("JP2OpenJPEG", "GPKG")
    given = np.moveaxis(RNG.integers(0, 255, (64, 80, 3)).astype(np.uint8), -1, 0)
    if not colour:
        given = given[:1].astype(np.float32)
        given[0, 3, 4] = -9999.0
    size = {"width": 80, "height": 64, "count": len(given), "dtype": given.dtype}
    where = rasterio.Affine(0.001, 0.0, 148.9, 0.0, -0.001, -20.2)
    nodata = None if colour else -9999.0
    size |= {"crs": 4326, "transform": where, "nodata": nodata}
    with rasterio.open(tmp_path / "t.tif", "w", "GTiff", **size) as one:
        one.write(given)
    options = {"quality": 100, "reversible": "YES"} if driver == "JP2OpenJPEG" else {}
    options |= {"TILE_FORMAT": "PNG"} if driver == "GPKG" else {}
    shutil_.copy(tmp_path / "t.tif", tmp_path / name, driver=driver, **options)
    raster = read_raster(tmp_path / name, 4326 if driver in ("GSBG", "AAIGrid") else None)
    assert raster.crs.to_epsg(25) == 4326
    np.testing.assert_allclose(raster.affine, tuple(where)[:6], rtol=1e-9, atol=1e-12)
    if colour:
        np.testing.assert_array_equal(raster.values, np.moveaxis(given, 0, -1))
    else:
        assert raster.blank is not None
        assert np.argwhere(raster.blank).tolist() == [[3, 4]]
        np.testing.assert_allclose(raster.values[~raster.blank], given[0][~raster.blank])
    (tmp_path / name).write_bytes(b"no such thing")
    with pytest.raises(GeoError, match=rf"{name}: is no {name[2:].upper()} that can be read"):
        read_raster(tmp_path / name)


def test_a_reference_system_of_the_files_own(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    system = "+proj=laea +lat_0=-20 +lon_0=149 +datum=WGS84 +units=us-ft"
    size = {"width": 5, "height": 7, "count": 3, "dtype": "uint8"}
    where = rasterio.Affine(20.0, 0.0, 0.0, 0.0, -20.0, 0.0)
    with rasterio.open(tmp_path / "o.tif", "w", "GTiff", crs=system, transform=where, **size) as file:
        file.write(np.moveaxis(COLOURS, -1, 0))
    found = read_raster(tmp_path / "o.tif").nodes().find(np.array([149.001]), np.array([-20.001]))
    x, y = Transformer.from_crs("EPSG:4326", system, always_xy=True).transform(149.001, -20.001)
    np.testing.assert_allclose(np.ravel(found), [-y / 20.0 - 0.5, x / 20.0 - 0.5], atol=1e-6)
