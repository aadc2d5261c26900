"""Sea floors that are refused, or read with a note."""

import numpy as np
import pytest
import xarray as xr

from auvplan.io.geo import GeoError
from tests.io.geo.files import write_geotiff
from tests.io.geo.sea_floors import LATITUDE, LONGITUDE, expected, floor_of, grid, sea_floor
from tests.io.refusals import refusal

LAND = np.full((14, 9), 30.0)
FLOOR = sea_floor(LONGITUDE[None, :], LATITUDE[:, None])


def refused(words, source, **arguments):
    refusal(GeoError, words, floor_of, source, **arguments)


def places(longitude, latitude, dims=(("y", "x"), ("y", "x")), **about):
    """A floor of 30 m at degrees that lie along these dimensions."""
    axes = {"longitude": (dims[0], longitude), "latitude": (dims[1], latitude)}
    values = np.full((len(LATITUDE), len(LONGITUDE)), -30.0)
    array = xr.DataArray(values, dims=("y", "x"), coords=axes, name="elevation")
    return array.assign_attrs(units="m", positive="up", **about)


EAST, NORTH = np.meshgrid(LONGITUDE, LATITUDE)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (places(np.nan * EAST, NORTH), "its longitudes and latitudes are no grid"),
        (places(0.0 * EAST + LONGITUDE[4], 0.0 * NORTH + LATITUDE[4]), "are no grid"),
        (places(LONGITUDE, NORTH, ("x", ("y", "x"))), "are neither two axes nor two grids of its dimensions"),
    ],
)
def test_degrees_that_make_no_grid(source, words):
    refused(f"elevation: .*{words}", source)


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"crs_wkt": "EPSG:32755", "GeoTransform": "0 0 0 0 0 0"}, "its pixels have no size"),
        ({"grid_mapping_name": "nonsense"}, "its grid mapping names no coordinate reference system"),
    ],
)
def test_grid_mappings_that_place_nothing(mapping, words):
    bare = places(EAST, NORTH, grid_mapping="crs").drop_vars(["longitude", "latitude"])
    refused(words, bare.assign_coords(crs=((), 0, mapping)))


def tiff(path, values):
    corner = (LONGITUDE[0], LATITUDE[-1])
    return write_geotiff(path, values[::-1], corner=corner, scale=(0.02, 0.01), point=True)


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [
        ((-1000.0, -20_000.0), (4000.0, 3000.0), r"beyond the data by 1\d{4} m in the west$"),
        ((-1000.0, -1500.0), (40_000.0, 30_000.0), r"by 3\d{4} m in the north and 2\d{4} m in the east"),
        ((5e6, 0.0), (5.1e6, 1e5), "beyond the data"),
        ((0.0, 0.0), (0.0, 1.0), "south-west"),
    ],
)
def test_rectangles_beyond_the_data(tmp_path, lower, upper, words):
    for source in (grid(), tiff(tmp_path / "b.tif", -FLOOR)):
        refused(words, source, lower=lower, upper=upper)


@pytest.mark.parametrize("form", ["grid", "tiff"])
def test_values_of_both_signs_are_heights_wherever_the_area_lies(tmp_path, form):
    """Of a file whose larger part is land, of an area that holds one sign alone."""
    heights = 60.0 - FLOOR
    path = grid("ROSE", values=heights) if form == "grid" else tiff(tmp_path / "b.tif", heights)
    for south, west in ((-1000.0, 1000.0), (3000.0, -1500.0)):
        found = floor_of(path, lower=(south, west), upper=(south + 1000.0, west + 2000.0))
        np.testing.assert_allclose(found.depth, sea_floor(*expected(found)) - 60.0, atol=1e-3)
        assert any("was taken as positive up: its values are of both signs" in note for note in found.notes)


@pytest.mark.parametrize(
    ("name", "values"), [("relief", 100.0), ("bathymetry", 100.0), ("bathymetry", 0.0), ("band_depth", 0.0)]
)
def test_a_sense_that_nothing_tells_is_asked_for(name, values):
    path = grid(name, values=FLOOR + values)
    refused(r'are heights or depths: say positive="up" or "down" \(bathymetry\.p', path)
    found = floor_of(path, positive="down")
    np.testing.assert_allclose(found.depth, sea_floor(*expected(found)) + values, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "values", "attributes", "depth", "notes"),
    [
        ("bathymetry", -LAND, {}, 30.0, ("bathymetry was taken as positive up: its values are negative",
                                         "units are not given: metres")),
        ("elevation", LAND, {"units": "m"}, -30.0, ("no pixel lies below the sea surface",)),
    ],
)  # fmt: skip
def test_what_is_assumed_is_noted(name, values, attributes, depth, notes):
    found = floor_of(grid(name, values=values, attributes=attributes))
    assert (found.depth == depth).all()
    assert found.notes == notes


def test_the_argument_overrides_a_name():
    found = floor_of(grid("h", sign=-1), positive="up")
    np.testing.assert_allclose(found.depth, sea_floor(*expected(found)), atol=1e-3)


@pytest.mark.parametrize(
    ("name", "stated", "values", "arguments", "words"),
    [
        ("h", {"units": "m"}, -LAND, {}, r'h is positive down by its name, but all .* say positive="up"'),
        ("z", {"units": "m", "positive": "down"}, -LAND, {}, "positive down by its attribute"),
        ("z", {"positive": "down"}, LAND, {"positive": "up"}, "convention: its attribute positive says down"),
        ("z", {"standard_name": "sea_floor_depth_below_geoid"}, LAND, {"positive": "up"}, "contradictory"),
        ("z", {"standard_name": "sea_floor_depth", "positive": "up"}, LAND, {}, "z has a contradictory"),
        ("z", {"units": "dbar"}, LAND, {}, "z is in 'dbar', not in m, km, cm, fathoms or ft"),
        ("z", {"units": "m"}, LAND * np.nan, {}, "z has no values in the area"),
        ("z", {"units": "m"}, LAND, {"positive": "north"}, 'positive must be "up" or "down"'),
        ("salt", {"units": "m"}, LAND, {"variable": "lat"}, "lat has dimensions lat, not two"),
        ("salt", {"units": "m"}, LAND, {"variable": "floor"}, "no variable 'floor'; it has salt, lat, lon"),
        ("z", {"units": "m"}, LAND, {"pixel_size": 0.01}, "pixels, more than"),
        ("z", {"units": "m"}, LAND, {"pixel_size": -1.0}, "pixel_size must be positive"),
    ],
)  # fmt: skip
def test_grids_that_are_refused(name, stated, values, arguments, words):
    refused(words, grid(name, attributes=stated, values=values), **arguments)


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ({"lat": LATITUDE[[0, 2, 1, *range(3, 14)]]}, "latitude neither rises nor falls"),
        ({"lat": LATITUDE * 1000}, "latitude reaches beyond 90 degrees"),
        ({"lon": LONGITUDE * np.nan}, "longitude has values that are not finite"),
    ],
)
def test_axes_that_are_none(axes, words):
    refused(rf"elevation: {words}", grid(values=-LAND, **axes))


def test_files_that_are_none(tmp_path):
    path = tmp_path / "f.nc"
    refused(r"nowhere\.nc: No such file", tmp_path / "nowhere.nc")
    for content, words in (
        (b"letter", "not a picture or grid that can be read"),
        (b"", "is empty, neither NetCDF nor a raster"),
        (b"\x89HDF\r\n\x1a\n", "f.nc: "),
        (b"CDF\x01", "f.nc: "),
    ):
        path.write_bytes(content)
        refused(words, path)
    bare = xr.Dataset({"t": ("x", np.zeros(3))})
    refused("no variable is known for a sea floor: name one of t", bare)
    refused("h has no longitude on its dimensions x, y", xr.Dataset({"h": (("x", "y"), np.zeros((3, 3)))}))
    words = "the given DataArray: elevation has no longitude on its dimensions y, x"
    refused(words, xr.DataArray(LAND, dims=("y", "x")))
    array = xr.DataArray(LAND[0], {"lon": LONGITUDE})
    refused("the given DataArray: elevation has dimensions lon, not two", array)
    colours = write_geotiff(tmp_path / "c.tif", np.zeros((9, 9, 3), np.uint8))
    refused(r"c\.tif: three bands are colours, not depths", colours)
