"""The sea floor from NetCDF and GeoTIFF."""

import numpy as np
import pytest
import rasterio
import rasterio.shutil
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import CRS, Transformer
from scipy.ndimage import map_coordinates

from auvplan.io.geo import GeoError, fall, read_raster
from auvplan.ocean.seabed import Seabed
from auvplan.site import Site
from tests.io.geo.files import geographic, write_geotiff
from tests.io.geo.sea_floors import LATITUDE, LONGITUDE, SITE, expected, floor_of, grid, sea_floor, write_grid
from tests.io.refusals import refusal


@pytest.mark.parametrize(
    ("name", "sign", "attributes"),
    [
        ("elevation", -1, {"units": "m", "standard_name": "height_above_reference_ellipsoid"}),
        ("elevation", -1, {"units": "m"}),
        ("z", -1, {"units": "meters", "positive": "up"}),
        ("h", 1, {"units": "meter"}),
        ("depth", 1, {"units": "m", "positive": "down"}),
        ("deptho", 1, {"units": "m", "standard_name": "sea_floor_depth_below_geoid"}),
        ("bed", 1, {"units": "m", "standard_name": "sea_floor_depth_below_sea_level"}),
        ("topo", -1, {"units": "m", "standard_name": "surface_altitude"}),
        ("sea_floor_depth_below_sea_level", 1, {"units": "m"}),
        ("depth", 1 / 1.8288, {"units": "fathoms"}),
        ("depth", 3937 / 1200, {"units": "US survey foot"}),
    ],
)
def test_both_senses_and_all_units(name, sign, attributes):
    found = floor_of(grid(name, sign=sign, attributes=attributes), 100.0)
    assert found.depth.shape == (50, 45)
    assert found.depth.dtype == np.float32
    assert found.origin == (-1000.0, -1500.0)
    assert found.notes == ()
    np.testing.assert_allclose(found.depth, sea_floor(*expected(found)), atol=2e-3)
    assert found.depth.min() < 0.0 < found.depth.max()


@pytest.mark.parametrize(
    "axes",
    [
        {"lat": LATITUDE[::-1], "lon": LONGITUDE + 360.0},
        {"lat": 56.43 + 0.02 * np.linspace(-3, 3, 9) ** 3 / 3},
        {"lon": np.arange(-180.0, 180.0, 0.5)},
        {"lon": np.arange(0.25, 360.0, 0.5)},
        {"lon": np.linspace(-180.0, 180.0, 721)},
    ],
)
def test_axes_of_all_kinds(axes):
    found = floor_of(grid(**axes), 250.0)
    np.testing.assert_allclose(found.depth, sea_floor(*expected(found)), atol=2e-3)


@pytest.mark.parametrize("longitude", [-180.0, 180.0, 0.0])
@pytest.mark.parametrize("first", [-180.0, 0.25, -179.75])
def test_the_seam_of_a_global_grid(longitude, first):
    """No step where the last column meets the first one."""
    site, lon = Site(longitude, 10.0), np.arange(first, first + 360.0, 0.5)
    lat = np.arange(8.0, 12.1, 0.5)
    values = -(50.0 + 30.0 * np.sin(np.deg2rad(lon))[None, :] + lat[:, None])
    area = {"lower": (-50_000, -80_000), "upper": (50_000, 60_000)}
    found = floor_of(grid(values=values, lat=lat, lon=lon), 5000.0, site, **area)
    x, y = expected(found, site)
    np.testing.assert_allclose(found.depth, 50.0 + 30.0 * np.sin(np.deg2rad(x)) + y, atol=0.02)


def test_default_pixels():
    spacing = 0.01 * 111_350.0
    assert floor_of(grid()).pixel_size == pytest.approx(500.0)
    fine = grid(lat=np.arange(56.38, 56.48, 0.001), lon=np.arange(-5.75, -5.55, 0.004))
    assert floor_of(fine).pixel_size == pytest.approx(spacing / 20, rel=0.01)
    dense = grid(lat=np.arange(56.4, 56.42, 5e-5), lon=np.arange(-5.68, -5.66, 1e-4))
    found = floor_of(dense, lower=(0.0, 100.0), upper=(700.0, 900.0))
    assert found.pixel_size == 10.0


def test_two_dimensional_coordinates_of_a_turned_grid():
    """ROMS: a grid at 37 degrees to the axes, with islets that the mask tells."""
    angle = np.deg2rad(37.0)
    a, b = np.meshgrid(np.arange(-9000.0, 9001, 500), np.arange(-8000.0, 8001, 400), indexing="ij")
    places = geographic(
        1500 + a * np.cos(angle) - b * np.sin(angle), 700 + a * np.sin(angle) + b * np.cos(angle), SITE
    )
    mask = np.ones(a.shape)
    mask[18, 20] = 0.0
    rho = ("eta_rho", "xi_rho")
    dataset = xr.Dataset(
        {
            "h": (rho, sea_floor(places[..., 0], places[..., 1]), {"units": "meter"}),
            "lon_rho": (rho, places[..., 0]),
            "lat_rho": (rho, places[..., 1]),
            "lon_u": (("eta_u", "xi_u"), np.zeros((3, 4))),
            "lat_u": (("eta_u", "xi_u"), np.zeros((3, 4))),
            "mask_rho": (rho, mask),
        }
    )
    found = floor_of(dataset, 250.0)
    known = np.isfinite(found.depth)
    np.testing.assert_allclose(found.depth[known], sea_floor(*expected(found))[known], atol=0.05)
    assert 0.0 < (~known).mean() < 0.1
    assert not known[int((1500 + 1000) / 250), int((700 + 1500) / 250)]
    assert any("mask_rho" in note for note in found.notes)
    words = r"the area reaches beyond the data .* of its edge in the"
    refusal(GeoError, words, floor_of, dataset, upper=(15_000.0, 3000.0))
    dataset["lat_rho"] = (rho, np.minimum(places[..., 1], places[::-1, ::-1, 1]))
    refusal(GeoError, "contradict each other, the grid folds", floor_of, dataset)


def test_missing_values_stay_missing():
    values = -sea_floor(LONGITUDE[None, :], LATITUDE[:, None])
    values[6, 4], values[0] = np.nan, np.nan
    found = floor_of(grid(values=values), 100.0)
    unknown = np.isnan(found.depth)
    x, y = expected(found)
    # The four cells about the missing node, no more and no less.
    near = (np.abs(x - LONGITUDE[4]) < 0.02) & (np.abs(y - LATITUDE[6]) < 0.01)
    np.testing.assert_array_equal(unknown, near)
    assert found.notes == (f"{near.sum()} of {near.size} pixels have no depth: NaN",)


def test_numbers_that_stand_for_none(tmp_path):
    values = -sea_floor(LONGITUDE[None, :], LATITUDE[:, None])
    values[6, 4], values[5, 2] = -32768.0, -9999.0
    found = floor_of(grid(values=values), 100.0)
    assert np.isnan(found.depth).any()
    assert "2 values that no sea floor has" in " ".join(found.notes)
    assert np.nanmax(np.abs(found.depth)) < 500.0
    flipped = np.where(np.abs(values) > 5000, -3.4e38, values).astype(np.float32)[::-1]
    corner = (LONGITUDE[0], LATITUDE[-1])
    tif = write_geotiff(
        tmp_path / "b.tif", flipped, corner=corner, scale=(0.02, 0.01), point=True, nodata=-3.4e38
    )
    twin = floor_of(tif, 100.0, positive="up")
    np.testing.assert_array_equal(np.isnan(twin.depth), np.isnan(found.depth))
    np.testing.assert_allclose(twin.depth, found.depth, atol=1e-3)


def test_one_variable_of_several():
    both = grid()
    both["tid"] = both["elevation"] * 0 + 11
    both["deep"] = (("time", "lat", "lon"), both["elevation"].values[None] * 2)
    first = floor_of(both)
    deep = floor_of(both, variable="deep", positive="up")
    np.testing.assert_allclose(deep.depth, 2 * first.depth, rtol=1e-5)
    assert deep.notes == ("units are not given: metres",)


def floor_tiff(path, *, per_metre=-1.0, dtype="float32", epsg=4326, **options):
    """A GeoTIFF of `sea_floor`."""
    longitude, latitude = np.linspace(-5.75, -5.57, 91), np.linspace(56.37, 56.49, 61)[::-1]
    values = per_metre * sea_floor(longitude[None, :], latitude[:, None])
    values = (np.rint(values) if dtype == "int16" else values).astype(dtype)
    where = {"corner": (longitude[0], latitude[0]), "scale": (0.002, 0.002), "point": True}
    return write_geotiff(path, values, epsg=epsg, **where, **options)


@pytest.mark.parametrize(
    ("stored", "arguments", "notes"),
    [
        ({}, {}, 2),
        ({"epsg": None}, {"crs": 4326}, 2),
        ({"per_metre": 1.0}, {"positive": "down"}, 1),
        ({"per_metre": 1.0, "band": {"positive": "down", "units": "m"}}, {}, 0),
        ({"band": {"NETCDF_VARNAME": "elevation", "units": "m"}}, {"variable": "elevation"}, 0),
        ({"per_metre": -10.0, "dtype": "int16", "band": {"scales": 0.1, "units": "metre"}}, {}, 1),
        ({"per_metre": -3937 / 1200, "epsg": "EPSG:4326+6360"}, {}, 1),
        ({"epsg": "EPSG:4326+5703"}, {}, 1),
        ({"per_metre": 1.0, "epsg": "EPSG:4326+5861"}, {}, 0),
    ],
)  # fmt: skip
def test_geotiffs(tmp_path, stored, arguments, notes):
    """Sense and unit of a band, by its tags, or by a vertical reference system."""
    path = floor_tiff(tmp_path / "b.tif", **stored)
    found = floor_of(path, 100.0, **arguments)
    tolerance = 0.06 if stored.get("dtype") else 2e-3
    np.testing.assert_allclose(found.depth, sea_floor(*expected(found)), atol=tolerance)
    assert len(found.notes) == notes


@pytest.mark.parametrize("inside", [True, False])
def test_masked_values_of_a_geotiff_are_missing(tmp_path, inside):
    mask = np.ones((61, 91), bool)
    mask[25:35, 40:50] = False
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=inside):
        path = floor_tiff(tmp_path / "b.tif", mask=mask)
    found = floor_of(path, 100.0)
    longitude, latitude = expected(found)
    hidden = (np.abs(longitude + 5.66) < 0.008) & (np.abs(latitude - 56.431) < 0.008)
    assert np.isnan(found.depth[hidden]).all()
    open_ = (np.abs(longitude + 5.66) > 0.015) | (np.abs(latitude - 56.431) > 0.015)
    np.testing.assert_allclose(found.depth[open_], sea_floor(longitude, latitude)[open_], atol=2e-3)


def test_a_sidecar_gives_scale_unit_and_no_data(tmp_path):
    path = floor_tiff(tmp_path / "b.tif", per_metre=-10.0 / 0.3048, dtype="int16")
    whole = floor_of(path, 100.0)
    least = round(float(np.nanmin(whole.depth)))
    band = f"<NoDataValue>{-least}</NoDataValue><UnitType>ft</UnitType><Offset>0</Offset><Scale>0.1</Scale>"
    beside = tmp_path / "b.tif.aux.xml"
    beside.write_text(f'<PAMDataset><PAMRasterBand band="1">{band}</PAMRasterBand></PAMDataset>')
    found = floor_of(path, 100.0)
    known = np.isfinite(found.depth)
    assert 0.95 < known.mean() <= 1.0
    # Stored to 0.03 m: of such steps the shallower count.
    off = (found.depth - sea_floor(*expected(found)))[known]
    assert -0.04 < off.min() <= off.max() < 0.02


@pytest.mark.parametrize("name", ["b.xyz", "b.csv", "b.asc", "b.bag"])
def test_grids_that_gdal_reads(tmp_path, name):
    crs = None if name == "b.bag" else 4326
    twin = floor_tiff(tmp_path / "t.tif", epsg=4326 if crs is None else None)
    stated = floor_of(twin, 100.0, crs=4326)
    driver = {".asc": "AAIGrid", ".bag": "BAG"}.get(name[1:], "XYZ")
    if name == "b.bag":  # metres of a projection, with the uncertainty as second band
        twin = projected(tmp_path / "u.tif")
    options = {"ADD_HEADER_LINE": "YES", "COLUMN_SEPARATOR": ","} if name == "b.csv" else {}
    options |= {"FORCE_CELLSIZE": "YES"} if name == "b.asc" else {}
    rasterio.shutil.copy(twin, tmp_path / name, driver=driver, **options)
    if crs is not None:
        refusal(GeoError, "has no coordinate reference system: set crs, such as", floor_of, tmp_path / name)
    found = floor_of(tmp_path / name, 100.0, crs=crs)
    np.testing.assert_allclose(found.depth, stated.depth, atol=0.05)


def projected(path):
    """A GeoTIFF of the sea floor in metres of UTM, with a second band."""
    turn = Transformer.from_crs("EPSG:32630", "EPSG:4326", always_xy=True)
    west, north = turn.transform(-5.75, 56.49, direction="INVERSE")
    x, y = west + 100.0 * np.arange(115), north - 100.0 * np.arange(140)
    heights = -sea_floor(*turn.transform(*np.meshgrid(x, y))).astype(np.float32)
    where = {"corner": (west - 50.0, north + 50.0), "scale": (100.0, 100.0), "epsg": 32630, "nodata": 1e6}
    return write_geotiff(path, np.dstack([heights, np.ones_like(heights)]), photometric="MINISBLACK", **where)


def test_arrays_in_place_of_files(tmp_path):
    path, classic = write_grid(tmp_path / "b.nc"), write_grid(tmp_path / "c.nc", form="NETCDF3_CLASSIC")
    wanted = floor_of(path, 100.0)
    heights = -sea_floor(LONGITUDE[None, :], LATITUDE[:, None])
    plain = xr.DataArray(heights, {"lat": LATITUDE, "lon": LONGITUDE}, attrs={"units": "m"})
    grids = np.meshgrid(LONGITUDE, LATITUDE)
    turned = xr.DataArray(
        heights, {k: (("j", "i"), v) for k, v in zip(("lon", "lat"), grids, strict=True)}, ("j", "i")
    )
    tiff = floor_tiff(tmp_path / "b.tif")
    for source in (
        xr.open_dataset(path), classic, plain, plain.T,
        (-100.0 * plain).rename("depth").assign_attrs(units="cm"),
        plain.rename(lon="x", lat="y").assign_attrs(crs=4326, units="m"), turned,
        read_raster(tiff), plain.to_dataset(name="z"),
    ):  # fmt: skip
        found = floor_of(source, 100.0)
        np.testing.assert_allclose(found.depth, wanted.depth, atol=0.05 if source is turned else 2e-3)
    missing = floor_of(plain.where(plain.lat < 56.43), 100.0)
    assert 0.3 < np.isnan(missing.depth).mean() < 0.8


#: East and north of the site's local metres as x and y of a projection.
LOCAL = CRS.from_user_input("+proj=aeqd +lat_0=56.43 +lon_0=-5.66 +x_0=1000 +y_0=2000 +datum=WGS84").to_wkt()


def nodes_of(place, shape):
    """[2, rows, columns] m north and east of a grid's nodes, by an affine map to east and north."""
    rows, columns = np.indices(shape) + 0.5
    return np.stack((place @ (columns, rows))[::-1])


def turned_grid(values, place, form):
    """A source of depths [rows, columns] whose nodes lie as `nodes_of` says."""
    source = xr.DataArray(values, dims=("y", "x"), name="depth", attrs={"units": "m"})
    if form == "pixels":
        mapping = {"crs_wkt": LOCAL, "GeoTransform": " ".join(map(repr, place.to_gdal()))}
        return source.assign_coords(spatial_ref=xr.Variable((), 0, mapping))
    places = geographic(*nodes_of(place, values.shape), SITE)
    return source.assign_coords(lon=(("y", "x"), places[..., 0]), lat=(("y", "x"), places[..., 1]))


def bed_of(source, pixel_size, half):
    """The bed that paths keep above, in a rectangle about (2000, 1000), and what is noted of it."""
    box = {"lower": np.subtract((2000, 1000), half), "upper": np.add((2000, 1000), half)}
    found = floor_of(source, pixel_size, keep_shoals=True, **box)
    return Seabed.from_depth(found.depth, found.pixel_size, found.origin), found


@pytest.mark.parametrize("form", ["pixels", "grid"])
@pytest.mark.parametrize("width", [2, 6])
def test_a_ridge_narrower_than_the_pixels_is_there(form, width):
    """From 50 m up to 8 m, across the area, in a raster of 1 m on pixels of 10 m."""
    values = np.full((120, 120), 50.0)
    values[63 : 63 + width] = 8.0
    place = rasterio.Affine(1.0, 0.0, 940.0, 0.0, -1.0, 2060.0)
    bed, found = bed_of(turned_grid(values, place, form), None, (40.0, 40.0))
    assert found.pixel_size == 10.0
    assert found.notes == (
        "its data is finer than the pixels of 10 m: each has the shallowest depth within a pixel of it",
    )
    crest, east = np.meshgrid(2060.0 - 63.5 - np.arange(width), np.linspace(960.0, 1040.0, 50))
    assert float(bed.depth_at(crest, east).max()) <= 8.0
    assert float(bed.depth_at(1970.0, 1000.0)) == 50.0


@settings(max_examples=20, deadline=None)
@given(
    st.integers(0, 10**6), st.sampled_from([0.0, 20.0, 45.0, 77.0]), st.floats(1.5, 13.0),
    st.floats(1.5, 9.8), st.sampled_from([10.0, 10.0, 23.0]), st.sampled_from(["pixels", "grid"]),
)  # fmt: skip
def test_nowhere_is_a_bed_deeper_than_its_finer_source(seed, angle, across, down, pixel_size, form):
    """Nor shallower than all around. The source is turned, and has pinnacles of one value."""
    rng = np.random.default_rng(seed)
    half = rng.uniform(15.0, 50.0, 2)
    shape = np.ceil(2.0 * (np.hypot(*half) + 20.0) / np.array([down, across])).astype(int)
    values = np.where(rng.random(shape) < 0.02, 5.0, rng.uniform(40.0, 60.0, shape)).astype(np.float32)
    place = rasterio.Affine.translation(1000.0, 2000.0) @ rasterio.Affine.rotation(angle)
    place = place @ rasterio.Affine.scale(across, -down) @ rasterio.Affine.translation(*(-shape[::-1] / 2))
    bed, found = bed_of(turned_grid(values, place, form), pixel_size, half)
    assert any("finer than the pixels" in note for note in found.notes)
    low, high = (np.array([[2000.0], [1000.0]]) + sign * half[:, None] for sign in (-1.0, 1.0))
    nodes = nodes_of(place, shape).reshape(2, -1)
    inside = ((low <= nodes) & (nodes <= high)).all(axis=0)
    for north, east in (nodes[:, inside], rng.uniform(low, high, (2, 300))):
        column, row = ~place @ (east, north)
        true = map_coordinates(values, [row - 0.5, column - 0.5], order=1, mode="nearest", output=float)
        read = np.asarray(bed.depth_at(north, east))
        assert (read <= true + 1e-3).all()
    apart = np.maximum(np.abs(nodes[0] - north[:, None]), np.abs(nodes[1] - east[:, None]))
    reach = 3.0 * pixel_size + np.hypot(across, down)
    assert (read >= np.where(apart < reach, values.ravel(), np.inf).min(axis=1) - 1e-3).all()


@pytest.mark.parametrize("pixel_size", [None, 37.0, 100.0, 400.0])
def test_a_bed_as_coarse_as_its_pixels_is_no_finer_source(monkeypatch, pixel_size):
    """Of 400 m, also where metres of its projection are a little shorter than ours."""
    values = np.random.default_rng(3).uniform(-10.0, 90.0, (30, 30))
    values[4, 7] = np.nan
    place = rasterio.Affine(398.0, 0.0, -5000.0, 0.0, -398.0, 8000.0)
    read = [floor_of(turned_grid(values, place, "pixels"), pixel_size, positive="down", keep_shoals=True)]
    monkeypatch.setattr("auvplan.io.geo.bathymetry.closer", lambda row, column: np.zeros(1, bool))
    read.append(floor_of(turned_grid(values, place, "pixels"), pixel_size, positive="down", keep_shoals=True))
    assert read[0].depth.tobytes() == read[1].depth.tobytes()
    assert read[0].notes == read[1].notes
    assert not any("finer" in note for note in read[0].notes)
    plain = floor_of(turned_grid(values, place, "pixels"), pixel_size, positive="down")
    axes = (
        (np.arange(n) + 0.5) * plain.pixel_size + at
        for n, at in zip(plain.depth.shape, plain.origin, strict=True)
    )
    north, east = np.meshgrid(*axes, indexing="ij")
    column, row = ~place @ (east, north)
    true = map_coordinates(np.nan_to_num(values), [row - 0.5, column - 0.5], order=1)
    known = np.isfinite(plain.depth)
    assert known.mean() > 0.9
    np.testing.assert_allclose(plain.depth[known], true[known], atol=0.01)
    assert (read[0].depth <= plain.depth)[known].all()


@settings(max_examples=12, deadline=None)
@given(
    st.integers(0, 10**6), st.sampled_from([0.0, 0.0, 20.0, 45.0, 77.0]), st.sampled_from([1.0, 1.6, 0.7]),
    st.sampled_from([None, 33.0, 100.0]), st.sampled_from(["pixels", "grid"]),
)  # fmt: skip
def test_nowhere_is_a_bed_deeper_than_its_coarser_source(seed, angle, stretch, pixel_size, form):
    """Pinnacles of one node keep their height, and what is planar stays as it is."""
    rng = np.random.default_rng(seed)
    half, spacing = rng.uniform(300.0, 900.0, 2), np.array([100.0, 100.0 * max(stretch, 1.01)])
    shape = np.ceil(2.0 * (np.hypot(*half) + 300.0) / spacing).astype(int)
    values = np.where(rng.random(shape) < 0.05, 8.0, 50.0)
    row, column = np.indices(shape)
    plane = 200.0 + 0.7 * row - 1.3 * column
    place = rasterio.Affine.translation(1000.0, 2000.0) @ rasterio.Affine.rotation(angle)
    place = place @ rasterio.Affine.scale(spacing[1], -spacing[0])
    place = place @ rasterio.Affine.translation(*(rng.uniform(-0.5, 0.5, 2) - shape[::-1] / 2))
    box = {"lower": np.subtract((2000, 1000), half), "upper": np.add((2000, 1000), half)}
    found = floor_of(turned_grid(values, place, form), pixel_size, keep_shoals=True, **box)
    assert not any("finer" in note for note in found.notes)

    def read(bed, north, east):
        at = [(x - low) / bed.pixel_size - 0.5 for x, low in zip((north, east), bed.origin, strict=True)]
        return map_coordinates(bed.depth, at, order=1, mode="nearest", output=float)

    low, high = (np.array([[2000.0], [1000.0]]) + sign * half[:, None] for sign in (-1.0, 1.0))
    nodes = nodes_of(place, shape).reshape(2, -1)
    inside = ((low <= nodes) & (nodes <= high)).all(axis=0)
    # Of turned ones a tenth of what nodes are apart.
    turned = 0.0 if angle == 0.0 else 4.2
    for (north, east), slack in ((nodes[:, inside], 0.0), (rng.uniform(low, high, (2, 2000)), turned)):
        column, row = ~place @ (east, north)
        true = map_coordinates(values, [row - 0.5, column - 0.5], order=1, mode="nearest")
        # Axes of degrees and of metres part by centimetres, where the bed rises by 0.6 m a metre.
        assert (read(found, north, east) <= true + 0.05 + slack).all()
    level = floor_of(turned_grid(plane, place, form), pixel_size, keep_shoals=True, **box)
    column, row = ~place @ (east, north)
    off = read(level, north, east) - (200.0 + 0.7 * (row - 0.5) - 1.3 * (column - 0.5))
    assert off.max() < 0.01
    # Outer pixels hold for half a pixel: they are shallower by its rise in that.
    size = level.pixel_size
    inner = (np.abs(north - 2000.0) < half[0] - 1.5 * size) & (np.abs(east - 1000.0) < half[1] - 1.5 * size)
    np.testing.assert_allclose(off[inner], 0.0, atol=0.01)
    assert off.min() > -2.0 * size * np.hypot(0.7 / spacing[0], 1.3 / spacing[1]) - 0.01


def test_values_that_places_between_are_not_to_exceed():
    """Each is met; those that are no numbers or lie beyond the outer nodes ask nothing."""
    rng = np.random.default_rng(0)
    own, (i, j) = rng.uniform(20.0, 60.0, (7, 9)), rng.uniform(0.0, 1.0, (2, 200))
    i, j = 6.0 * i, 8.0 * j
    most = map_coordinates(own, [i, j], order=1) - rng.exponential(5.0, 200)
    most[::7] = np.nan
    fallen = own - fall(own, i, j, most)
    left = map_coordinates(fallen, [i, j], order=1)
    assert (left <= most + 1e-3)[np.isfinite(most)].all()
    assert (fallen <= own).all()
    for nothing in ((i[::7], j[::7], most[::7]), (i + 7.0, j, most), (i, -1.0 - j, most)):
        np.testing.assert_array_equal(fall(own, *nothing), 0.0)
    four, middle = np.full((2, 2), 50.0), np.full((2, 1), 0.5)
    np.testing.assert_allclose(fall(four, *middle, np.array([8.0])), 42.0)
    # No land where there was none, if that meets the value; land where the value is.
    aside = np.array([[0.0], [0.2]])
    low = four - fall(four, *aside, np.array([1.0]))
    np.testing.assert_allclose(low, [[0.1, 4.6], [50.0, 50.0]])
    assert (four - fall(four, *aside, np.array([-3.0]))).min() == -3.0
    own[3, 4] = np.nan
    assert np.isfinite(fall(own, i, j, most)).all()


def test_what_a_finer_source_does_not_know_stays_as_it_is():
    """Where the middle of a pixel is unknown it is; a value missing elsewhere is no shoal."""
    values = np.full((260, 260), 50.0)
    values[100:140, 100:140], values[30, 34] = np.nan, np.nan
    place = rasterio.Affine(1.0, 0.0, 870.0, 0.0, -1.0, 2130.0)
    _, found = bed_of(turned_grid(values, place, "pixels"), 10.0, (120.0, 120.0))
    unknown = np.isnan(found.depth)
    north, east = 10.0 * np.indices(unknown.shape) + np.array([1885.0, 885.0])[:, None, None]
    inside = (np.abs(north - 2010.0) < 21.0) & (np.abs(east - 990.0) < 21.0)
    np.testing.assert_array_equal(unknown, inside)
    assert (found.depth[~unknown] == 50.0).all()
