"""Grids along the axes of projections and of turned poles."""

import numpy as np
import pytest
import xarray as xr
from pyproj import CRS, Proj, Transformer

from auvplan.io.currents import open_ocean
from auvplan.ocean.gridded import CurrentError
from tests.io.currents.samples import HOURS, LAT, LON, START, fvcom, refused

ALONG = [{"units": "m/s", "standard_name": f"sea_water_{axis}_velocity"} for axis in "xy"]
EAST, NORTH = 0.3, -0.2
PROJECTED = ("projection_x_coordinate", "projection_y_coordinate")


def from_east(crs, lon, lat):
    """Angle, rad, from east to x, counter-clockwise: as far as north lies clockwise of y."""
    there = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    south, north = (np.stack(there.transform(lon, lat + step)) for step in (-1e-3, 1e-3))
    east, up = north - south
    if crs.is_geographic:  # degrees of a turned pole's longitude are shorter
        east = east * np.cos(np.deg2rad(south[1]))
    return np.arctan2(east, up)


def grid(crs, x, y, mapping, names=PROJECTED, units="m", unit=1.0):
    """An even current stated along a projection's axes, with no longitude or latitude in the file."""
    back = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    lon, lat = back.transform(*np.meshgrid(x, y))
    angle = from_east(crs, lon, lat)
    along = EAST * np.cos(angle) + NORTH * np.sin(angle), NORTH * np.cos(angle) - EAST * np.sin(angle)
    fields = {
        name: (("time", "y", "x"), part[None], about | ({"grid_mapping": "crs"} if mapping else {}))
        for name, part, about in zip("uv", along, ALONG, strict=True)
    }
    axes = {
        "x": ("x", x / unit, {"units": units, "standard_name": names[0]}),
        "y": ("y", y / unit, {"units": units, "standard_name": names[1]}),
        "time": ("time", [0.0], HOURS),
    }
    return xr.Dataset(fields | ({"crs": ((), 0, mapping)} if mapping else {}), axes), lon, lat


def expect(data, lon, lat, atol=2e-5, **options):
    with open_ocean(data, **options) as ocean:
        found = ocean.at(lon[2:5, 2:5], lat[2:5, 2:5], 0.0, START)
        np.testing.assert_allclose(found[0], EAST, atol=atol)
        np.testing.assert_allclose(found[1], NORTH, atol=atol)
        return ocean


def cf(crs):
    return {key: value for key, value in crs.to_cf().items() if key != "crs_wkt"}


@pytest.mark.parametrize("stated", ["wkt", "epsg", "cf", "setting"])
def test_metres_of_a_projection_alone(stated):
    crs = CRS.from_epsg(32633)
    epsg = {"grid_mapping_name": "unknown", "epsg": np.int32(32633)}
    mapping = {"wkt": {"crs_wkt": crs.to_wkt()}, "epsg": epsg, "cf": cf(crs), "setting": {}}[stated]
    data, *places = grid(crs, 3e5 + 500.0 * np.arange(8), 6.6e6 + 500.0 * np.arange(7), mapping)
    expect(data, *places, crs=32633 if stated == "setting" else None)
    wrong, words = {
        "setting": (None, r"that the file does not name: say current\.crs"),
    }.get(stated, (32632, r"not WGS 84 / UTM zone 32N as current\.crs says"))
    with pytest.raises(CurrentError, match=words):
        open_ocean(data, crs=wrong)


def test_a_turned_pole():
    mapping = {
        "grid_mapping_name": "rotated_latitude_longitude",
        "grid_north_pole_latitude": 40.0,
        "grid_north_pole_longitude": -170.0,
    }
    x, y = -3.0 + 0.05 * np.arange(8), 9.0 + 0.05 * np.arange(7)
    names = ("grid_longitude", "grid_latitude")
    data, lon, lat = grid(CRS.from_cf(mapping), x, y, mapping, names, "degrees")
    np.testing.assert_allclose(expect(data, lon, lat, 1e-6).longitude, lon, atol=1e-9)


POLAR = CRS.from_user_input("+proj=stere +lat_0=90 +lat_ts=60 +lon_0=58 +a=6371000 +b=6371000")
X, Y = 1e6 + 4e3 * np.arange(8), -1.2e6 + 4e3 * np.arange(7)


def test_axes_in_hundreds_of_kilometres():
    """TOPAZ and others of the Arctic count in units of 100 km."""
    expect(*grid(POLAR, X, Y, cf(POLAR), units="100 km", unit=1e5), atol=1e-6)
    refused(grid(POLAR, X, Y, cf(POLAR), units="cells")[0], "x has units 'cells', which are no length")


def polar_grid():
    """A polar stereographic grid with longitude and latitude too; x and y are given as axes."""
    data, lon, lat = grid(POLAR, X, Y, cf(POLAR))
    places = {
        "lon": (("y", "x"), lon, {"units": "degrees_east"}),
        "lat": (("y", "x"), lat, {"units": "degrees_north"}),
    }
    return data.assign(places), lon, lat


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data,
        lambda data: data.transpose("x", "y", "time"),
        lambda data: data.isel(x=slice(None, None, -1)),
        lambda data: data.isel(y=slice(None, None, -1)).transpose("time", "x", "y"),
    ],
)
@pytest.mark.parametrize("mapped", [True, False])
def test_x_runs_where_its_coordinate_says(change, mapped):
    data, lon, lat = polar_grid()
    data = change(data if mapped else data.drop_vars("crs"))
    # By the places alone the ellipsoid counts, which the model's sphere has not.
    expect(data, lon, lat, 1e-6 if mapped else 2e-3)


def test_a_projection_that_does_not_fit_the_places_is_left_out():
    data, lon, lat = polar_grid()
    data["crs"].attrs["straight_vertical_longitude_from_pole"] = 0.0
    ocean = expect(data, lon, lat, 2e-3)
    assert any("do not follow the places of the grid's points: left out" in note for note in ocean.notes)


def test_fvcom_in_metres():
    """Longitude and latitude are left at zero, as FVCOM does in Cartesian runs."""
    data = fvcom()
    metres = Proj("EPSG:32632")(data["lon"].values, data["lat"].values)
    data = data.assign(
        {name: ("node", at, {"units": "meters"}) for name, at in zip("xy", metres, strict=True)}
    )
    for name in ("lon", "lat", "lonc", "latc"):
        data[name].values[:] = 0.0
    with open_ocean(data, crs=32632) as ocean:
        assert ocean.kind == "triangles"
        assert abs(ocean.longitude.mean() - LON - 0.035) < 0.02
        assert abs(ocean.latitude.mean() - LAT - 0.03) < 0.02
