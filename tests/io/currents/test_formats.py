"""What files have in common and how they differ: axes, units, calendars, packing, containers."""

import sys
import warnings
from datetime import UTC, datetime

import numpy as np
import pytest

from auvplan.io.currents import open_ocean, read_current
from auvplan.io.currents.units import length_factor, speed_factor
from auvplan.ocean.gridded import CurrentError
from tests.io.currents.samples import (
    BOX,
    LAT,
    LON,
    PLACE,
    SITE,
    START,
    check,
    regular,
    write,
)


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
def test_netcdf_4_and_3(tmp_path, engine):
    regular().to_netcdf(tmp_path / "a.nc", engine=engine)
    assert check(tmp_path / "a.nc").kind == "regular"


@pytest.mark.parametrize("zarr_format", [2, 3])
def test_zarr(tmp_path, zarr_format):
    pytest.importorskip("zarr")
    regular().to_zarr(tmp_path / "a.zarr", zarr_format=zarr_format, consolidated=False)
    check(tmp_path / "a.zarr")


def test_zarr_without_its_package(tmp_path, monkeypatch):
    (tmp_path / "a.zarr").mkdir()
    (tmp_path / "a.zarr" / "zarr.json").write_text("{}")
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(CurrentError, match=r"a\.zarr: .*pip install 'auvplan\[readers\]'"):
        open_ocean(tmp_path / "a.zarr")


@pytest.mark.parametrize(
    ("lon", "at"),
    [
        (np.array([359.97, 359.98, 359.99, 0.0, 0.01, 0.02]), (-0.005, 0.004)),
        (np.arange(-3, 4) * 0.01 + 360.0, (-0.005, 0.004)),
        (np.array([179.98, 179.99, -180.0, -179.99, -179.98]), (179.995, -179.987)),
        (np.array([179.98, 179.99, 180.0, 180.01, 180.02]), (179.995, -179.987)),
        (LON + 0.01 * np.arange(8)[::-1], (LON + 0.033,)),
    ],
)
def test_longitudes_of_all_spellings(tmp_path, lon, at):
    """0 to 360, across 0, across 180, falling; asked for in another spelling."""
    path = write(regular(lon=lon, about=lon[2]), tmp_path / "a.nc")
    for place in at:
        check(path, lon=place, about=lon[2])
        check(path, lon=place % 360.0, about=lon[2])
    with open_ocean(path) as ocean, pytest.raises(CurrentError, match="outside the data"):
        ocean.at(at[0] + 1.0, PLACE[1], 0.0, START)


def test_round_the_globe(tmp_path):
    """Between the last column and the first there is water, and a box over the seam reads few columns."""
    lon = np.arange(0.0, 360.0, 2.0)
    data = regular(lon=lon, lat=np.arange(-4.0, 5.0, 2.0))
    data["uo"][:] = np.cos(np.deg2rad(lon))
    data["vo"][:] = 0.0
    path = write(data, tmp_path / "globe.nc")
    with open_ocean(path) as ocean:
        e, _, _ = ocean.at([359.0, -0.5, 0.5], 1.0, 0.0, START)
        half = np.cos(np.deg2rad(2.0))
        np.testing.assert_allclose(e, [(1 + half) / 2, 1 - (1 - half) / 4, 1 - (1 - half) / 4])
        window = ocean.geometry.window(ocean.geometry.locate(np.array([358.5, 1.5]), np.zeros(2)).index)
        assert window.picks["longitude"].tolist() == [179, 0, 1]


def test_falling_latitudes_and_depths(tmp_path):
    data = regular()
    check(write(data.isel(latitude=slice(None, None, -1)), tmp_path / "lat.nc"))
    check(write(data.isel(depth=slice(None, None, -1)), tmp_path / "depth.nc"))


@pytest.mark.parametrize(
    ("values", "attrs", "note"),
    [
        ([0.0, 10.0, 30.0], {"positive": "down"}, None),
        ([0.0, -10.0, -30.0], {"positive": "up"}, None),
        ([-30.0, -10.0, 0.0], {"positive": "up"}, None),
        ([0.0, 10.0, 30.0], {}, "which way is positive: down"),
        ([0.0, -10.0, -30.0], {}, "which way is positive: up"),
        ([0.0, 1000.0, 3000.0], {"units": "cm"}, "down"),
        ([0.0, 0.01, 0.03], {"units": "km", "positive": "down"}, None),
    ],
)
def test_depth_axes(tmp_path, values, attrs, note):
    data = regular()
    if values[0] == -30.0:
        data = data.isel(depth=slice(None, None, -1))
    data = data.assign_coords(depth=("depth", values, {"units": "m", "axis": "Z"} | attrs))
    ocean = check(write(data, tmp_path / "a.nc"))
    np.testing.assert_allclose(ocean.levels, [0.0, 10.0, 30.0])
    assert (note is None) == (ocean.notes == ())
    assert note is None or note in ocean.notes[0]


@pytest.mark.parametrize(
    ("units", "factor"),
    [("m s-1", 1), ("ms-1", 1), ("m/s", 1), ("meter second-1", 1), ("meters s-1", 1),
     ("metres per second", 1),
     ("m.s-1", 1), ("m s^-1", 1), ("m s**-1", 1), ("cm/s", 100), ("cm s-1", 100), ("cm.s-1", 100),
     ("knots", 3600 / 1852), ("km/h", 3.6), ("km h-1", 3.6)],
)  # fmt: skip
def test_units_of_speed(tmp_path, units, factor):
    data = regular()
    for name in ("uo", "vo"):
        data[name] = data[name] * factor
        data[name].attrs["units"] = units
    data["uo"].attrs["standard_name"] = "eastward_sea_water_velocity"
    check(write(data, tmp_path / "a.nc"))


@pytest.mark.parametrize(
    "units", ["m", "m s", "m/s-1", "1", "degrees", "m2 s-1", "kg m-2 s-1", "Pa", "m s-2"]
)
def test_what_is_no_speed(units):
    assert speed_factor(units) is None


def test_units_of_length():
    lengths = {"m": 1.0, "Meter": 1.0, "metres": 1.0, "cm": 0.01, "km": 1000.0, "100 km": 1e5}
    assert {units: length_factor(units) for units in lengths} == lengths
    assert [length_factor(units) for units in ("dbar", "level", "1", "100")] == [None] * 4


def test_missing_units_are_metres_a_second(tmp_path):
    data = regular()
    del data["uo"].attrs["units"], data["vo"].attrs["units"]
    ocean = check(write(data, tmp_path / "a.nc"))
    assert "uo has no units: taken as m/s" in ocean.notes


def test_packed_values(tmp_path):
    packing = {"dtype": "int16", "scale_factor": 1e-4, "add_offset": 0.5, "_FillValue": -32767}
    data = regular()
    data["uo"][:, :, 0, 0] = np.nan
    path = write(data, tmp_path / "a.nc", uo=packing, vo=packing)
    check(path, atol=1e-4)
    with open_ocean(path) as ocean:
        assert np.isnan(ocean.at(LON, LAT, 0.0, START)[0])


@pytest.mark.parametrize(
    ("names", "standard"),
    [
        (("uo", "vo"), None), (("utotal", "vtotal"), None), (("water_u", "water_v"), None),
        (("u_eastward", "v_northward"), None), (("u", "v"), None), (("u_sur", "v_sur"), None),
        (("a", "b"), "surface_{}ward_sea_water_velocity"),
        (("a", "b"), "{}ward_sea_water_velocity_assuming_no_tide"),
        (("a", "b"), "sea_water_{}_velocity"),
    ],
)  # fmt: skip
def test_names_of_the_components(tmp_path, names, standard):
    data = regular().rename(uo=names[0], vo=names[1])
    for name, way in zip(names, ("east", "north"), strict=True):
        way = {"east": "x", "north": "y"}[way] if standard and "{}_v" in standard else way
        data[name].attrs = {"units": "m/s"} | ({"standard_name": standard.format(way)} if standard else {})
    check(write(data, tmp_path / "a.nc"))


def test_standard_name_goes_before_the_name(tmp_path):
    data = regular().rename(uo="east", vo="north")
    for name, way in (("uo", "east"), ("vo", "north")):
        data[name] = (data[way].dims, -data[way].values, {"units": "m/s"})
    data["u"] = data["east"].assign_attrs(standard_name="eastward_wind")
    check(write(data, tmp_path / "a.nc"))


@pytest.mark.parametrize("name", ["w", "wo", "rise"])
def test_upward_velocity_is_negated(tmp_path, name):
    data = regular()
    attrs = {"units": "cm/s"} | ({"standard_name": "upward_sea_water_velocity"} if name == "rise" else {})
    data[name] = (data["uo"].dims, np.full(data["uo"].shape, 0.4), attrs)
    found = read_current(write(data, tmp_path / "a.nc"), SITE, **BOX)
    np.testing.assert_allclose(found.field.w, -0.004, rtol=1e-6)
    assert found.source.at(*PLACE, 3.0, START)[2] == pytest.approx(0.004)


def test_sea_floor_by_standard_name(tmp_path):
    data = regular()
    lon, _ = np.meshgrid(data.longitude, data.latitude)
    attrs = {"standard_name": "sea_floor_depth_below_geoid", "units": "km"}
    data["deep"] = (("latitude", "longitude"), (20.0 + 1000.0 * (lon - LON)) / 1000.0, attrs)
    path = write(data, tmp_path / "a.nc")
    found = read_current(path, SITE, **BOX)
    x = found.origin[1] + found.spacing[1] * np.arange(found.sea_floor.shape[1])
    lon = SITE.to_geographic(np.zeros_like(x), x)[0]
    np.testing.assert_allclose(found.sea_floor[len(found.sea_floor) // 2], 20 + 1000 * (lon - LON), atol=0.1)
    with open_ocean(path) as ocean:
        held = ocean.at(LON + 0.03, LAT + 0.02, [30.0, 49.9, 50.1], START)[0]
        assert held[0] == held[1]
        assert np.isnan(held[2])


@pytest.mark.parametrize("calendar", ["noleap", "360_day", "julian"])
def test_other_calendars(tmp_path, calendar):
    pytest.importorskip("cftime")
    data = regular()
    days = {"noleap": 59, "360_day": 61, "julian": 60}[calendar]
    data["time"] = ("time", days + data["time"].values / 24.0,
                    {"units": "days since 2019-01-01", "calendar": calendar})  # fmt: skip
    with open_ocean(write(data, tmp_path / "a.nc")) as ocean:
        # A Julian day is 13 days later in today's calendar.
        first = {"noleap": (3, 1), "360_day": (3, 2), "julian": (3, 15)}[calendar]
        assert ocean.moments[0] == datetime(2019, *first, tzinfo=UTC)
        np.testing.assert_allclose(np.diff(ocean.times), [3600.0, 7200.0], atol=1e-3)
        assert any(calendar in note for note in ocean.notes) == (calendar != "julian")


def test_single_level_and_no_depth(tmp_path):
    data = regular(depth=[0.0]).isel(depth=0)
    assert "depth" in data.coords
    check(write(data, tmp_path / "scalar.nc"), depth=0.0)
    ocean = check(write(data.drop_vars("depth"), tmp_path / "none.nc"), depth=0.0)
    assert "uo has no levels: taken as the current at the surface" in ocean.notes


def test_netcdf_5_by_the_fallback(tmp_path):
    """Type CDF-5 is opened by netCDF4 alone, where that is installed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pytest.importorskip("netCDF4")
    path = tmp_path / "five.nc"
    regular().to_netcdf(path, engine="netcdf4", format="NETCDF3_64BIT_DATA")
    assert path.read_bytes()[:4] == b"CDF\x05"
    check(path)
