"""Grids along the axes of projections and of turned poles."""

import numpy as np
import pytest
import xarray as xr
from pyproj import CRS, Proj, Transformer

from auvplan.io.currents import open_ocean
from auvplan.ocean.gridded import CurrentError
from tests.io.currents.samples import HOURS, LAT, LON, START, fvcom, write, write_plain

ALONG = [{"units": "m/s", "standard_name": f"sea_water_{axis}_velocity"} for axis in "xy"]
EAST, NORTH = 0.3, -0.2


def from_east(crs, lon, lat):
    """Angle, rad, from east to x, counter-clockwise: as far as north lies clockwise of y."""
    there = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    south, north = (np.stack(there.transform(lon, lat + step)) for step in (-1e-3, 1e-3))
    east, up = north - south
    if crs.is_geographic:  # degrees of a turned pole's longitude are shorter
        east = east * np.cos(np.deg2rad(south[1]))
    return np.arctan2(east, up)


def grid(crs, x, y, mapping, **options):
    """An even current stated along a projection's axes, with no longitude or latitude in the file."""
    back = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    lon, lat = back.transform(*np.meshgrid(x, y))
    angle = from_east(crs, lon, lat)
    along = EAST * np.cos(angle) + NORTH * np.sin(angle), NORTH * np.cos(angle) - EAST * np.sin(angle)
    names, units = options["names"], options["units"]
    fields = {
        name: (("time", "y", "x"), part[None], about | ({"grid_mapping": "crs"} if mapping else {}))
        for name, part, about in zip("uv", along, ALONG, strict=True)
    }
    axes = {
        "x": ("x", x, {"units": units, "standard_name": names[0]}),
        "y": ("y", y, {"units": units, "standard_name": names[1]}),
        "time": ("time", [0.0], HOURS),
    }
    extra = {"crs": ((), 0, mapping)} if mapping else {}
    return xr.Dataset(fields | extra, axes), lon, lat


def expect(ocean, lon, lat, atol=2e-5):
    found = ocean.at(lon[2:5, 2:5], lat[2:5, 2:5], 0.0, START)
    np.testing.assert_allclose(found[0], EAST, atol=atol)
    np.testing.assert_allclose(found[1], NORTH, atol=atol)


@pytest.mark.parametrize("stated", ["wkt", "epsg", "cf", "setting"])
def test_metres_of_a_projection_alone(tmp_path, stated):
    crs = CRS.from_epsg(32633)
    mapping = {
        "wkt": {"crs_wkt": crs.to_wkt()},
        "epsg": {"grid_mapping_name": "unknown", "epsg": np.int32(32633)},
        "cf": {key: value for key, value in crs.to_cf().items() if key != "crs_wkt"},
        "setting": {},
    }[stated]
    x, y = 300_000.0 + 500.0 * np.arange(8), 6_600_000.0 + 500.0 * np.arange(7)
    names = {"names": ("projection_x_coordinate", "projection_y_coordinate"), "units": "m"}
    data, lon, lat = grid(crs, x, y, mapping, **names)
    path = write(data, tmp_path / "utm.nc")
    with open_ocean(path, crs=32633 if stated == "setting" else None) as ocean:
        expect(ocean, lon, lat)
    if stated == "setting":
        with pytest.raises(CurrentError, match=r"that the file does not name: say current\.crs"):
            open_ocean(path)
    else:
        with pytest.raises(CurrentError, match=r"not WGS 84 / UTM zone 32N as current\.crs says"):
            open_ocean(path, crs=32632)


def test_a_turned_pole(tmp_path):
    crs = CRS.from_cf(
        {
            "grid_mapping_name": "rotated_latitude_longitude",
            "grid_north_pole_latitude": 40.0,
            "grid_north_pole_longitude": -170.0,
        }
    )
    mapping = {
        "grid_mapping_name": "rotated_latitude_longitude",
        "grid_north_pole_latitude": 40.0,
        "grid_north_pole_longitude": -170.0,
    }
    x, y = -3.0 + 0.05 * np.arange(8), 9.0 + 0.05 * np.arange(7)
    names = {"names": ("grid_longitude", "grid_latitude"), "units": "degrees"}
    data, lon, lat = grid(crs, x, y, mapping, **names)
    with open_ocean(write(data, tmp_path / "turned.nc")) as ocean:
        np.testing.assert_allclose(ocean.longitude, lon, atol=1e-9)
        expect(ocean, lon, lat, 1e-6)


def polar_grid(change):
    """A polar stereographic grid with longitude and latitude too, changed; x and y are given as axes."""
    crs = CRS.from_user_input("+proj=stere +lat_0=90 +lat_ts=60 +lon_0=58 +a=6371000 +b=6371000")
    mapping = {key: value for key, value in crs.to_cf().items() if key != "crs_wkt"}
    x, y = 1e6 + 4e3 * np.arange(8), -1.2e6 + 4e3 * np.arange(7)
    names = {"names": ("projection_x_coordinate", "projection_y_coordinate"), "units": "m"}
    data, lon, lat = grid(crs, x, y, mapping, **names)
    places = {
        "lon": (("y", "x"), lon, {"units": "degrees_east"}),
        "lat": (("y", "x"), lat, {"units": "degrees_north"}),
    }
    return change(data.assign(places)), lon, lat


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
def test_x_runs_where_its_coordinate_says(tmp_path, change, mapped):
    data, lon, lat = polar_grid(change)
    data = data if mapped else data.drop_vars("crs")
    with open_ocean(write(data, tmp_path / "polar.nc")) as ocean:
        # By the places alone the ellipsoid counts, which the model's sphere has not.
        expect(ocean, lon, lat, 1e-6 if mapped else 2e-3)


def test_a_projection_that_does_not_fit_the_places_is_left_out(tmp_path):
    data, lon, lat = polar_grid(lambda data: data)
    data["crs"].attrs["straight_vertical_longitude_from_pole"] = 0.0
    with open_ocean(write(data, tmp_path / "wrong.nc")) as ocean:
        assert any("do not follow the places of the grid's points: left out" in note for note in ocean.notes)
        expect(ocean, lon, lat, 2e-3)


def test_fvcom_in_metres(tmp_path):
    """Longitude and latitude are left at zero, as FVCOM does in Cartesian runs."""
    data = fvcom()
    zone = Proj("EPSG:32632")
    metres = zone(data["lon"][1], data["lat"][1])
    for name, values in zip(("x", "y"), metres, strict=True):
        data[name] = (data["lon"][0], np.asarray(values), {"units": "meters"})
    for name in ("lon", "lat", "lonc", "latc"):
        if name in data:
            data[name] = (data[name][0], np.zeros_like(data[name][1]), data[name][2])
    path = write_plain(data, tmp_path / "metres.nc")
    with open_ocean(path, crs=32632) as ocean:
        assert ocean.kind == "triangles"
        assert abs(ocean.longitude.mean() - LON - 0.035) < 0.02
        assert abs(ocean.latitude.mean() - LAT - 0.03) < 0.02
