"""What files have in common and how they differ: names, axes, units, calendars, masks, containers."""

import sys
import warnings
from datetime import UTC, datetime

import numpy as np
import pytest
import xarray as xr

from auvplan.io.currents import open_ocean, read_current
from auvplan.io.currents.units import length_factor, speed_factor
from auvplan.ocean.gridded import CurrentError
from tests.io.currents.samples import (
    BOX,
    DIMS,
    EAST,
    HOURS,
    LAT,
    LON,
    NORTH,
    PLACE,
    SIGMA,
    SITE,
    START,
    TIMES,
    check,
    described,
    flow,
    fvcom,
    named,
    on_nodes,
    over_a_bed,
    regular,
    timed,
    turned_grid,
    write,
)
from tests.io.refusals import refusal

HOUR = np.array([0.0, 1.0]) / 24.0


def surface(**options):
    return regular(depth=[0.0]).isel(depth=0, **options)


def member(data):
    return data.expand_dims("member", axis=2).drop_vars("member", errors="ignore")


def without_units():
    data = regular()
    del data["uo"].attrs["units"], data["vo"].attrs["units"]
    return data


def opposed(data):
    """Components of the right names that are others by their attributes."""
    data = data.rename(uo="east", vo="north")
    for name, way in (("uo", "east"), ("vo", "north")):
        data[name] = (data[way].dims, -data[way].values, {"units": "m/s"})
    return data.assign(u=data["east"].assign_attrs(standard_name="eastward_wind"))


def with_extremes(data):
    for name, own, attributes in (("a", "uo", EAST), ("b", "vo", NORTH)):
        data[name] = (2.0 * data[own]).assign_attrs(attributes | {"cell_methods": "time: maximum"})
    return data[["a", "b", "uo", "vo"]]


def with_a_surface(standard):
    """Components at all levels beside those at the surface, which are zero."""
    data = regular().rename(uo="u", vo="v")
    for name, axis, way in (("u", "x", "east"), ("v", "y", "north")):
        data[f"{name}_top"] = 0.0 * data[name].isel(depth=0, drop=True)
        data[f"{name}_top"].attrs = {"units": "m/s", "standard_name": f"surface_{way}ward_sea_water_velocity"}
        data[name].attrs = {"units": "m/s"} | ({"standard_name": standard.format(axis)} if standard else {})
    return data


def depths_of_points(sign, surface, **attributes):
    """Depths below the surface as it is, or heights above a datum, of each point."""
    data = regular(depth=[1.0, 10.0, 30.0])
    levels = np.broadcast_to((sign * data["depth"].values + surface)[:, None, None], (3, 6, 8)).copy()
    data = data.rename(depth="k").drop_vars("k")
    data["zos"] = (("time", *DIMS[2:]), np.full((3, 6, 8), 2.0), {"units": "m"})
    return data.assign(z_rho=(("k", *DIMS[2:]), levels, {"units": "m"} | attributes))


def own_depths(shift=0.0):
    data = regular()
    east, north = data[["uo"]].rename(depth="depthu"), data[["vo"]].rename(depth="depthv")
    north["depthv"] = north["depthv"] + shift
    return xr.merge([east, north])


def own_places(shift=0.0):
    data = on_nodes(regular(), lon_u=0.0, lat_u=0.0, lon_v=shift, lat_v=0.0)
    for kind, name in (("u", "uo"), ("v", "vo")):
        data[name].attrs["coordinates"] = f"lon_{kind} lat_{kind}"
    return data


def two_grids(named_one=False):
    data = on_nodes(named("u_eastward", "v_northward"), TLONG=0.005, TLAT=0.005, ULONG=0.0, ULAT=0.0)
    for name in ("u_eastward", "v_northward") if named_one else ():
        data[name].attrs["coordinates"] = "ULONG ULAT"
    return data


def in_radians(unit):
    """As ICON-O has the middles of its cells."""
    data = regular().stack(ncells=DIMS[2:]).reset_index("ncells")
    for name, short in (("longitude", "clon"), ("latitude", "clat")):
        data[short] = ("ncells", np.deg2rad(data[name].values), {"units": unit, "standard_name": name})
    return data.drop_vars(["longitude", "latitude"])


def with_a_mask_in_time():
    mask = np.zeros((3, 6, 8))
    mask[0, 0, 0] = 1.0
    return regular().assign(wet=(("time", *DIMS[2:]), mask))


def beside_a_height(**attributes):
    height = ((), 10.0, {"units": "m", "standard_name": "height"} | attributes)
    return surface(drop=True).assign(height=height)


LONG_NAMES = "{}ward current with wind", "{}ward sea water velocity", "ocean {}"
SPELT = [("uo", "vo"), ("utotal", "vtotal"), ("water_u", "water_v"), ("u_eastward", "v_northward"),
         ("u", "v"), ("u_sur", "v_sur")]  # fmt: skip
STANDARD = ["surface_{}ward_sea_water_velocity", "{}ward_sea_water_velocity_assuming_no_tide",
            "sea_water_{}_velocity"]  # fmt: skip
#: Data sets that are all read as the sample; other places and times of the comparison; a note that is made.
READ = {
    "latitudes from the north": (regular().isel(latitude=slice(None, None, -1)), {}, None),
    "depths from the bed": (regular().isel(depth=slice(None, None, -1)), {}, None),
    "one depth": (surface(), {"depth": 0.0}, None),
    "no depth": (surface(drop=True), {"depth": 0.0},
                 "uo has no levels: taken as the current at the surface"),
    "one depth below the surface": (regular(depth=[10.0]).isel(depth=0), {"depth": 10.0}, None),
    "one member": (member(regular(depth=[0.0])), {"depth": 0.0}, None),
    "one member without depth": (member(surface(drop=True)), {"depth": 0.0}, None),
    "no units": (without_units(), {}, "uo has no units: taken as m/s"),
    **{names[0]: (named(*names), {}, None) for names in SPELT},
    **{name: (named("a", "b", standard_name=name), {}, None) for name in STANDARD},
    **{name: (named("u", "v", long_name=name), {}, None) for name in LONG_NAMES},
    "u-vel": (named("u-vel", "v-vel", standard_name="{}ward_water_velocity"), {}, None),
    "UVEL": (named("UVEL", "VVEL", standard_name="{}VEL"), {}, None),
    "standard names before names": (opposed(regular()), {}, None),
    "means before extremes": (with_extremes(regular()), {}, None),
    "levels before the surface": (with_a_surface("sea_water_{}_velocity"), {}, None),
    "levels before the surface by name": (with_a_surface(None), {}, None),
    "depths of points": (depths_of_points(1.0, 0.0, standard_name="depth", positive="down"), {}, None),
    "heights of points": (depths_of_points(-1.0, 2.0, standard_name="height_above_geoid", positive="up"), {},
                          None),
    "depths of each component": (own_depths(), {}, None),
    "places of each component": (own_places(), {"atol": 1e-5}, None),
    "a grid along parallels": (on_nodes(named("u", "v"), lon=0.0, lat=0.0), {"atol": 1e-5}, None),
    "the grid that is named": (two_grids(named_one=True), {"atol": 1e-5}, None),
    "radian": (in_radians("radian"), {"atol": 1e-5}, "cells between the points along ncells are not given"),
    "rad": (in_radians("rad"), {"atol": 1e-5}, "cells between the points along ncells are not given"),
    "a bed as a height": (over_a_bed(-30.0, **SIGMA), {}, None),
    "a bed as a height, stated": (over_a_bed(-30.0, {"positive": "up"}, **SIGMA), {}, None),
    "a mask that changes in time": (with_a_mask_in_time(), {}, None),
    "a height of the wind": (beside_a_height(positive="up"), {"depth": 0.0}, None),
    "a calendar misspelt": (regular().assign_coords(time=("time", [0.0, 1.0, 3.0], HOURS | {
        "calendar": "gregorian_proleptic"})), {}, None),
}  # fmt: skip


@pytest.mark.parametrize("case", READ)
def test_it_is_read_as_the_sample(case):
    data, options, note = READ[case]
    ocean = check(data, **options)
    assert note is None or any(note in line for line in ocean.notes)
    if "member" in case:
        assert ocean.levels == [0.0]


def test_netcdf_of_type_cdf5_is_opened_by_netcdf4(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pytest.importorskip("netCDF4")
    regular().to_netcdf(tmp_path / "a.nc", engine="netcdf4", format="NETCDF3_64BIT_DATA")
    assert (tmp_path / "a.nc").read_bytes().startswith(b"CDF\x05")
    assert check(tmp_path / "a.nc").kind == "regular"


def test_zarr_of_the_older_type(tmp_path):
    pytest.importorskip("zarr")
    regular().to_zarr(tmp_path / "a.zarr", zarr_format=2, consolidated=False)
    check(tmp_path / "a.zarr")


def test_zarr_without_its_package(tmp_path, monkeypatch):
    (tmp_path / "a.zarr").mkdir()
    (tmp_path / "a.zarr" / "zarr.json").write_text("{}")
    monkeypatch.setitem(sys.modules, "zarr", None)
    words = r"a\.zarr: .*pip install 'auvplan\[readers\]'"
    refusal(CurrentError, words, open_ocean, tmp_path / "a.zarr")


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
def test_longitudes_of_all_spellings(lon, at):
    """0 to 360, across 0, across 180, falling; asked for in another spelling."""
    data = regular(lon=lon, about=lon[2])
    for place in at:
        check(data, lon=place, about=lon[2])
        check(data, lon=place % 360.0, about=lon[2])
    with open_ocean(data) as ocean:
        refusal(CurrentError, "outside the data", ocean.at, at[0] + 1.0, PLACE[1], 0.0, START)


def test_round_the_globe():
    """Between the last column and the first there is water, and a box over the seam reads few columns."""
    lon = np.arange(0.0, 360.0, 2.0)
    data = regular(lon=lon, lat=np.arange(-4.0, 5.0, 2.0))
    data["uo"][:] = np.cos(np.deg2rad(lon))
    data["vo"][:] = 0.0
    with open_ocean(data) as ocean:
        e, _, _ = ocean.at([359.0, -0.5, 0.5], 1.0, 0.0, START)
        half = np.cos(np.deg2rad(2.0))
        np.testing.assert_allclose(e, [(1 + half) / 2, 1 - (1 - half) / 4, 1 - (1 - half) / 4])
        window = ocean.geometry.window(ocean.geometry.locate(np.array([358.5, 1.5]), np.zeros(2)).index)
        assert window.picks["longitude"].tolist() == [179, 0, 1]


def test_degrees_west_and_south():
    data = regular(lon=-20.0 + 0.01 * np.arange(8), about=-20.0)
    for name, units in (("longitude", "degrees_west"), ("latitude", "degrees_south")):
        data[name] = (name, -data[name].values, {"units": units})
    with open_ocean(data) as ocean:
        np.testing.assert_allclose(ocean.longitude, -20.0 + 0.01 * np.arange(8))
        found = ocean.at(-20.0 + 0.033, PLACE[1], 0.0, START)[:2]
        np.testing.assert_allclose(found, flow(LON + 0.033, PLACE[1]), atol=1e-6)
    for name in ("longitude", "latitude"):
        data[name] = (name, -data[name].values, {"units": "degrees"})
    with open_ocean(data) as ocean:
        np.testing.assert_allclose(ocean.latitude, LAT + 0.01 * np.arange(6))


@pytest.mark.parametrize("dims", [("i", "j"), ("nx", "ny"), ("xi", "y")])
def test_rows_along_the_first_dimension(dims):
    """The name of a dimension decides which of them x follows."""
    lon, lat, _ = turned_grid(angle=0.0)
    east, north = flow(lon, lat)
    data = xr.Dataset(coords={"time": ("time", [0.0], HOURS)})
    for name, values, axis in (("uo", east, "x"), ("vo", north, "y")):
        attributes = {"units": "m s-1", "standard_name": f"sea_water_{axis}_velocity"}
        data[name] = (("time", *dims), values.T[None], attributes)
    data["lon"] = (dims, lon.T + 1e-5 * lat.T, {"units": "degrees_east"})
    data["lat"] = (dims, lat.T + 1e-5 * lon.T, {"units": "degrees_north"})
    with open_ocean(data) as ocean:
        place = data["lon"].values[5, 4], data["lat"].values[5, 4]
        np.testing.assert_allclose(ocean.at(*place, 0.0, START)[:2], (east[4, 5], north[4, 5]), atol=1e-3)


def test_curvilinear_components_eastward_by_their_long_name():
    lon, lat, _ = turned_grid()
    east, north = flow(lon, lat)
    fields = {
        "u": (("time", "j", "i"), east[None], {"units": "m s-1", "long_name": "Eastward current"}),
        "v": (("time", "j", "i"), north[None], {"units": "m s-1", "long_name": "Northward current"}),
        "longitude": (("j", "i"), lon, {"units": "degrees_east"}),
        "latitude": (("j", "i"), lat, {"units": "degrees_north"}),
    }
    data = xr.Dataset(fields, {"time": ("time", [0.0], HOURS)})
    ocean = check(data, lon[4, 6], lat[4, 6], depth=0.0, hour=0.0)
    assert "u and v are eastward and northward by their long_name" in ocean.notes


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
def test_depth_axes(values, attrs, note):
    data = regular()
    if values[0] == -30.0:
        data = data.isel(depth=slice(None, None, -1))
    ocean = check(data.assign_coords(depth=("depth", values, {"units": "m", "axis": "Z"} | attrs)))
    np.testing.assert_allclose(ocean.levels, [0.0, 10.0, 30.0])
    assert (note is None) == (ocean.notes == ())
    assert note is None or note in ocean.notes[0]


def test_units_of_speed():
    units = {
        1.0: ("m s-1", "ms-1", "m/s", "meter second-1", "meters s-1", "metres per second", "m.s-1", "m s^-1",
              "m s**-1"),
        0.01: ("cm/s", "cm s-1", "cm.s-1", "0.01 m s-1"), 1e-3: ("1e-3 m/s",), 0.3048: ("ft/s",),
        1852 / 3600: ("knots", "nmi/h"), 1 / 3.6: ("km/h", "km h-1"),
    }  # fmt: skip
    for factor, names in units.items():
        assert [speed_factor(name) for name in names] == pytest.approx([factor] * len(names))
    for name in ("m", "m s", "m/s-1", "1", "degrees", "m2 s-1", "kg m-2 s-1", "Pa", "m s-2"):
        assert speed_factor(name) is None


def test_units_of_length():
    lengths = {"m": 1.0, "Meter": 1.0, "metres": 1.0, "cm": 0.01, "km": 1000.0, "100 km": 1e5}
    assert {units: length_factor(units) for units in lengths} == lengths
    assert [length_factor(units) for units in ("dbar", "level", "1", "100")] == [None] * 4


def test_values_far_beyond_the_valid_range_are_missing():
    data = regular()
    for name in ("uo", "vo"):
        data[name] = data[name].copy(data=100.0 * data[name].values)
        data[name].values[:, :, 2, 3] = -999.0
        data[name].attrs |= {"units": "cm/s", "valid_min": -300.0, "valid_max": 300.0}
    with open_ocean(data) as ocean:
        assert np.isnan(ocean.at(LON + 0.03, LAT + 0.02, 0.0, START)[0])
        np.testing.assert_allclose(ocean.at(LON, LAT, 0.0, START)[0], 0.3, atol=1e-6)


@pytest.mark.parametrize(("standard", "wet"), [("land_binary_mask", 0.0), ("sea_binary_mask", 1.0)])
@pytest.mark.parametrize("dims", [DIMS[2:], DIMS[1:]])
def test_masks_over_zeros(standard, wet, dims):
    """A mask may be of land or of water, and of the points or of all levels."""
    data = regular()
    mask = np.full(tuple(data.sizes[dim] for dim in dims), wet)
    mask[..., :2] = 1.0 - wet
    data["land"] = (dims, mask, {"standard_name": standard})
    for name in ("uo", "vo"):
        data[name] = data[name].where(data["land"] == wet, 0.0).assign_attrs(data[name].attrs)
    check(data, depth=0.0)
    with open_ocean(data) as ocean:
        assert np.isnan(ocean.at(LON, LAT, 0.0, START)[0])


@pytest.mark.parametrize("name", ["w", "wo", "rise"])
def test_upward_velocity_is_negated(name):
    attrs = {"units": "cm/s"} | ({"standard_name": "upward_sea_water_velocity"} if name == "rise" else {})
    data = regular()
    found = read_current(data.assign({name: (DIMS, np.full(data["uo"].shape, 0.4), attrs)}), SITE, **BOX)
    np.testing.assert_allclose(found.field.w, -0.004, rtol=1e-6)
    assert found.source.at(*PLACE, 3.0, START)[2] == pytest.approx(0.004)


def test_sea_floor_by_standard_name():
    data = regular()
    lon, _ = np.meshgrid(data.longitude, data.latitude)
    attrs = {"standard_name": "sea_floor_depth_below_geoid", "units": "km"}
    data["deep"] = (DIMS[2:], (20.0 + 1000.0 * (lon - LON)) / 1000.0, attrs)
    found = read_current(data, SITE, **BOX)
    x = found.origin[1] + found.spacing[1] * np.arange(found.sea_floor.shape[1])
    lon = SITE.to_geographic(np.zeros_like(x), x)[0]
    np.testing.assert_allclose(found.sea_floor[len(found.sea_floor) // 2], 20 + 1000 * (lon - LON), atol=0.1)
    held = found.source.at(LON + 0.03, LAT + 0.02, [30.0, 49.9, 50.1], START)[0]
    assert held[0] == held[1]
    assert np.isnan(held[2])


@pytest.mark.parametrize(
    ("standard", "note"),
    [
        ("surface_geostrophic_{}ward_sea_water_velocity", "its geostrophic part"),
        ("barotropic_{}ward_sea_water_velocity", "its mean over the depth"),
    ],
)
def test_parts_of_a_current_are_read_where_nothing_else_is_given(standard, note):
    part = described(surface(drop=True), standard_name=standard).rename(uo="a", vo="b")
    assert any(note in line for line in check(part, depth=0.0).notes)
    whole = named("u", "v")
    for name in ("a", "b"):
        whole[name] = (0.0 * part[name]).assign_attrs(part[name].attrs)
    check(whole)


def test_a_calendar_of_months_of_30_days():
    pytest.importorskip("cftime")
    data, about = regular(), {"units": "days since 2019-01-01", "calendar": "360_day"}
    data["time"] = "time", 61 + data["time"].values / 24.0, about
    with open_ocean(data) as ocean:
        assert ocean.moments[0] == datetime(2019, 3, 2, tzinfo=UTC)
        np.testing.assert_allclose(np.diff(ocean.times), [3600.0, 7200.0], atol=1e-3)
        assert any("360_day" in note for note in ocean.notes)


@pytest.mark.parametrize(
    ("units", "values"),
    [
        ("Hours Since 2020-01-01 00:00:00", [0.0, 1.0]),
        ("minutes since 2019-12-31T23:00:00-01:00", [0.0, 60.0]),
        ("hours since 1968-05-23 00:00:00 GMT", 24.0 * (18262.0 + 588.0 + HOUR)),
        ("seconds since 1970-01-01", START + 86400.0 * HOUR),
        ("days since 1950-01-01", 25567.0 + HOUR),
        # In CF's default calendar, which has Julian years before 1582.
        ("days since 0001-01-01 00:00:00", datetime(2020, 1, 1).toordinal() + 1.0 + HOUR),
        ("hours since 2020-01-01 02:00:00 +2:00", [0.0, 1.0]),
        ("julian_day", 2458849.5 + HOUR),
        ("day as %Y%m%d.%f", 20200101.0 + HOUR),
        ("modified julian day", 58849.0 + HOUR),
        ("MJD", 58849.0 + HOUR),
        (None, ["2020-01-01T00:00:00Z", "2020-01-01T01:00:00Z"]),
        (None, ["2020-01-01_00:00:00", "2020-01-01_01:00:00"]),
    ],
)
def test_spellings_of_dates(tmp_path, units, values):
    data = timed(values, units)
    with open_ocean(data if units else write(data, tmp_path / "a.nc")) as ocean:
        np.testing.assert_allclose(ocean.times, START + np.array([0.0, 3600.0]), atol=1e-3)


def test_dates_in_an_array_of_characters(tmp_path):
    """Of the name of a time, and FVCOM's to the microsecond."""
    data = regular(hours=[0.0, 1.0]).drop_vars("time")
    data["time_string"] = ("time", np.array([b"2020-01-01 00:00:00", b"2020-01-01 01:00:00"]))
    stamps = [f"2020-01-01T0{hour}:00:00.250000" for hour in TIMES.astype(int)]
    text = ("time", "DateStrLen"), np.array([list(stamp) for stamp in stamps], "S1")
    mesh = fvcom().drop_vars(["Itime", "Itime2"]).assign(Times=text)
    for given, hours, late in ((write(data, tmp_path / "a.nc3"), TIMES[:2], 0.0), (mesh, TIMES, 0.25)):
        with open_ocean(given) as ocean:
            np.testing.assert_allclose(ocean.times, START + 3600.0 * hours + late, atol=1e-6)


def means(label, method="time: mean (interval: 10 minutes)", bounds=None):
    """Means over an hour of the sample, whose middles are at 0.5, 1.5 and 2.5 h, labelled `label` h later."""
    data, begin = regular(hours=[0.5, 1.5, 2.5]), np.arange(3.0)
    data["time"] = "time", begin + 0.5 + label, HOURS | {"bounds": "time_bnds"}
    stated = np.stack([begin, begin + 1.0], axis=1) if bounds is None else np.asarray(bounds)
    data["time_bnds"] = ("time", "nv"), stated
    for name in ("uo", "vo"):
        data[name].attrs["cell_methods"] = method
    return data


@pytest.mark.parametrize(
    "method", ["time: mean (interval: 10 minutes)", "area: time: mean", "depth: sum time: mean"]
)
@pytest.mark.parametrize("label", [-0.5, 0.5, 0.1])
def test_means_belong_to_the_middle_of_their_window(tmp_path, label, method):
    path = write(means(label, method), tmp_path / "a.nc")
    decoded = xr.open_dataset(path, decode_coords="all")
    other = means(label, method)
    other["time_bnds"] = other["time_bnds"].dims, other["time_bnds"].values * 60.0 + 60.0
    other["time_bnds"].attrs["units"] = "minutes since 2019-12-31T23:00:00"
    for source in (path, decoded, other):
        ocean = check(source, hour=1.7)
        np.testing.assert_allclose(ocean.times, START + 3600.0 * np.array([0.5, 1.5, 2.5]))
        words = f"windows (time_bnds): time labels them up to {abs(label):g} h from there"
        assert any(words in note for note in ocean.notes)
    decoded.close()
    cuts = [means(label, method).isel(time=slice(k, k + 1)) for k in range(3)]
    check([write(cut, tmp_path / f"part{k}.nc") for k, cut in enumerate(cuts)], hour=1.7)
    with open_ocean(means(label, method).isel(time=1)) as ocean:
        np.testing.assert_allclose(ocean.times, [START + 5400.0])


@pytest.mark.parametrize(
    ("data", "note"),
    [
        (means(0.0), ""),
        (means(0.5, "time: point"), ""),
        (means(0.5, "area: mean time: point"), ""),
        (means(0.5, ""), ""),
        (means(0.5).drop_vars("time_bnds"), ""),
        (means(0.5, bounds=np.zeros((3, 2))), "does not hold the times"),
        (means(0.5, bounds=np.full((3, 2), np.nan)), "does not hold the times"),
        (means(0.5, bounds=np.full((3, 2), 1e30)), "does not hold the times"),
        (means(0.5, bounds=np.zeros((3, 3))), "does not hold the times"),
    ],
)
def test_other_times_are_taken_as_they_are(data, note):
    with open_ocean(data) as ocean:
        np.testing.assert_array_equal(ocean.times, START + 3600.0 * data["time"].values)
        assert any(note in line for line in ocean.notes) if note else ocean.notes == ()


def test_times_in_single_precision_are_noted():
    data = timed((58849.0 + HOUR).astype(np.float32), "days since 1858-11-17 00:00:00")
    with open_ocean(data) as ocean:
        assert any("single precision, in steps of 338 s" in note for note in ocean.notes)
