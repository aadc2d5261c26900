"""Variants of files by the conventions of models and products: read right, or refused with what would do."""

import zipfile
from datetime import datetime

import numpy as np
import pytest
import xarray as xr

from auvplan.io.currents import open_ocean
from auvplan.io.currents.units import speed_factor
from auvplan.ocean.gridded import CurrentError
from tests.io.currents.samples import (
    EAST,
    HOURS,
    LAT,
    LON,
    NORTH,
    PLACE,
    START,
    check,
    flow,
    regular,
    turned_grid,
    write,
)

DIMS = ("time", "depth", "latitude", "longitude")


def refused(path, *words):
    with pytest.raises(CurrentError) as caught, open_ocean(path):
        pass
    message = str(caught.value)
    for part in words:
        assert part in message


def described(data, **attributes):
    """The components without other attributes than their unit and these, `{}` being east and north."""
    for name, way in (("uo", "east"), ("vo", "north")):
        data[name].attrs = {"units": "m s-1"} | {k: v.format(way) for k, v in attributes.items()}
    return data


def timed(values=(0.0, 1.0), units=None):
    """Two times, an hour apart unless they are others."""
    data = regular(hours=[0.0, 1.0])
    data["time"] = ("time", np.asarray(values), {"units": units} if units else {})
    return data


def other_levels(name, values=None, **attributes):
    """Levels along a dimension of another name, with or without an axis."""
    data = regular().rename(depth=name).drop_vars(name)
    return data if values is None else data.assign_coords({name: (name, values, attributes)})


def over_a_bed(depth, **attributes):
    """Shares of the depth as levels."""
    data = other_levels("sigma", **attributes)
    return data.assign(h=(DIMS[2:], np.full((6, 8), depth), {"units": "m"}))


def stations(**stated):
    data = regular().isel(latitude=[0, 2, 3, 5], longitude=[1, 4])
    return data.stack(station=("latitude", "longitude")).reset_index("station").assign_attrs(stated)


def named(east, north, **attributes):
    return described(regular(), **attributes).rename(uo=east, vo=north)


def speed_and_direction():
    data = regular().rename(uo="s", vo="d")
    data["s"].attrs = {"units": "m s-1", "standard_name": "sea_water_speed"}
    data["d"].attrs = {"units": "degree", "standard_name": "sea_water_velocity_to_direction"}
    return data


SIGMA = {"values": [0.0, -1.0 / 3.0, -1.0], "standard_name": "ocean_sigma_coordinate"}
PASSED = ("no current", "u, v are by their attributes of wind")
MEMBERS = ("levels along member, but no depths", "ncks -d member,0")
REFUSED = {
    "wind": (lambda: named("u", "v", long_name="10 metre {}ward wind"), *PASSED),
    "ice": (lambda: named("u", "v", long_name="sea ice drift, {}ward"), *PASSED),
    "air": (lambda: named("u", "v", standard_name="{}ward_air_velocity"), *PASSED),
    "waves": (
        lambda: named("u", "v", standard_name="sea_surface_wave_stokes_drift_{}ward_velocity"), *PASSED,
    ),
    "extremes": (
        lambda: named("u", "v", standard_name="{}ward_sea_water_velocity", cell_methods="time: maximum"),
        *PASSED,
    ),
    "speed and direction": (speed_and_direction, "no current", "from s and d", "speed sin(direction)"),
    "members": (lambda: other_levels("member"), *MEMBERS),
    "numbers from 0": (lambda: other_levels("member", [0, 1, 2], axis="Z", positive="down"), *MEMBERS),
    "numbers from 1": (lambda: other_levels("member", [1.0, 2.0, 3.0], axis="Z", positive="down"), *MEMBERS),
    "members and levels": (
        lambda: regular().expand_dims(member=2), "member and depth", "ncks -d member,0",
    ),
    "shares": (
        lambda: other_levels("level", -(np.arange(3) + 0.5) / 3, positive="up"),
        "level has no units and lies between", "ncatted",
    ),
    **{
        name: (
            lambda name=name: other_levels(
                "depth", [0.0, 10.0, 30.0], units="m", standard_name=name, axis="Z"
            ),
            f"depth is {name}, and positive: depths below the surface",
        )
        for name in ("height_above_sea_floor", "altitude")
    },
    "from the bed": (
        lambda: over_a_bed(30.0, values=[1.0, 0.5, 0.0], positive="up"),
        "sigma are positive upward, from the bed",
    ),
    "words": (lambda: timed(["noon", "one"]), "dates cannot be understood: 'noon'"),
    **{
        units: (lambda units=units: timed(units=units), words, units)
        for units, words in (
            ("hours since 2020-01-01 02:00:00 CEST", "the time zone CEST"),
            ("hours since 2020-01-01 02:00:00 UTC+2", "the time zone UTC+2"),
            ("hours since 01-02-2020 00:00:00", "may begin with the day or the month"),
            ("months since 2020-01-01", "dates cannot be understood"),
        )
    },
    "a time series": (
        lambda: stations(featureType="timeSeries"),
        "holds single places (timeSeries)", "grid or a mesh is needed",
    ),
    "stations": (stations, "holds single places (station)", "grid or a mesh is needed"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused_with_what_would_do(tmp_path, case):
    make, *words = REFUSED[case]
    refused(write(make(), tmp_path / "a.nc"), *words)


HOUR = np.array([0.0, 1.0]) / 24.0


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
    with open_ocean(write(timed(values, units), tmp_path / "a.nc")) as ocean:
        np.testing.assert_allclose(ocean.times, START + np.array([0.0, 3600.0]), atol=1e-3)


def test_dates_in_an_array_of_characters(tmp_path):
    data = regular(hours=[0.0, 1.0]).drop_vars("time")
    data["time_string"] = ("time", np.array([b"2020-01-01 00:00:00", b"2020-01-01 01:00:00"]))
    with open_ocean(write(data, tmp_path / "a.nc3")) as ocean:
        np.testing.assert_allclose(ocean.times, START + np.array([0.0, 3600.0]))


@pytest.mark.parametrize("long_name", ["{}ward current with wind", "{}ward sea water velocity", "ocean {}"])
def test_currents_whose_words_name_the_wind_are_read(tmp_path, long_name):
    check(write(described(regular(), long_name=long_name).rename(uo="u", vo="v"), tmp_path / "a.nc"))


def test_means_go_before_extremes(tmp_path):
    data = regular()
    data["a"], data["b"] = 2.0 * data["uo"], 2.0 * data["vo"]
    for name, attributes in (("a", EAST), ("b", NORTH)):
        data[name].attrs = attributes | {"cell_methods": "time: maximum"}
    check(write(data[["a", "b", "uo", "vo"]], tmp_path / "a.nc"))


@pytest.mark.parametrize(
    ("standard", "note"),
    [
        ("surface_geostrophic_{}ward_sea_water_velocity", "its geostrophic part"),
        ("barotropic_{}ward_sea_water_velocity", "its mean over the depth"),
    ],
)
def test_parts_of_a_current_are_read_where_nothing_else_is_given(tmp_path, standard, note):
    data = regular(depth=[0.0]).isel(depth=0, drop=True)
    part = described(data.copy(), standard_name=standard).rename(uo="a", vo="b")
    ocean = check(write(part, tmp_path / "part.nc"), depth=0.0)
    assert any(note in line for line in ocean.notes)
    whole = described(regular()).rename(uo="u", vo="v")
    for name in ("a", "b"):
        whole[name] = 0.0 * part[name]
        whole[name].attrs = part[name].attrs
    check(write(whole, tmp_path / "whole.nc"))


@pytest.mark.parametrize(("names", "standard"), [(("u-vel", "v-vel"), "{}ward_water_velocity"),
                                                 (("UVEL", "VVEL"), "{}VEL")])  # fmt: skip
def test_standard_names_that_cf_does_not_know(tmp_path, names, standard):
    data = described(regular(), standard_name=standard).rename(uo=names[0], vo=names[1])
    check(write(data, tmp_path / "a.nc"))


def test_unknown_components_are_listed_with_a_way_to_rename_them(tmp_path):
    data = described(regular()).rename(uo="U1", vo="V1")
    refused(write(data, tmp_path / "a.nc"), "no current", "ncrename -v U1,uo -v V1,vo")
    check(write(data.rename(U1="uo", V1="vo"), tmp_path / "b.nc"))


def test_units_with_a_number_and_in_feet():
    found = [speed_factor(units) for units in ("0.01 m s-1", "1e-3 m/s", "ft/s", "nmi/h", "knots")]
    assert found == pytest.approx([0.01, 1e-3, 0.3048, 1852 / 3600, 1852 / 3600])


@pytest.mark.parametrize("with_depth", [True, False])
def test_one_member_is_no_level(tmp_path, with_depth):
    data = regular(depth=[0.0]).expand_dims("member", axis=2).drop_vars("member", errors="ignore")
    if not with_depth:
        data = data.isel(depth=0, drop=True)
    ocean = check(write(data, tmp_path / "a.nc"), depth=0.0)
    assert ocean.levels == [0.0]


@pytest.mark.parametrize(
    ("attributes", "sign", "surface"),
    [
        ({"standard_name": "depth", "positive": "down"}, 1.0, 0.0),
        ({"standard_name": "height_above_geoid", "positive": "up"}, -1.0, 2.0),
    ],
)
def test_depths_of_each_point(tmp_path, attributes, sign, surface):
    """Depths are below the surface as it is, heights above a datum."""
    data = regular(depth=[1.0, 10.0, 30.0])
    depth = data["depth"].values
    data = data.rename(depth="k").drop_vars("k")
    shape = data["uo"].shape
    data["zos"] = (("time", "latitude", "longitude"), np.full((shape[0], *shape[2:]), 2.0), {"units": "m"})
    levels = np.broadcast_to(sign * depth[:, None, None] + surface, shape[1:])
    data["z_rho"] = (("k", *DIMS[2:]), levels.copy(), {"units": "m"} | attributes)
    check(write(data, tmp_path / "a.nc"))


def test_components_with_depths_of_their_own(tmp_path):
    data = regular()
    east = data[["uo"]].rename(depth="depthu")
    north = data[["vo"]].rename(depth="depthv")
    check(write(xr.merge([east, north]), tmp_path / "a.nc"))
    north["depthv"] = north["depthv"] + 1.0
    refused(write(xr.merge([east, north]), tmp_path / "b.nc"), "along depthv", "depthu, and they differ")


def test_components_at_other_places_than_each_other(tmp_path):
    data = regular().rename(longitude="x", latitude="y").drop_vars(["x", "y"])
    lon, lat = np.meshgrid(LON + 0.01 * np.arange(8), LAT + 0.01 * np.arange(6))
    for kind, name, shift in (("u", "uo", 0.0), ("v", "vo", 0.005)):
        data[f"lon_{kind}"] = (("y", "x"), lon + shift, {"units": "degrees_east"})
        data[f"lat_{kind}"] = (("y", "x"), lat, {"units": "degrees_north"})
        data[name].attrs["coordinates"] = f"lon_{kind} lat_{kind}"
    refused(write(data, tmp_path / "a.nc"), "uo lies at lon_u and vo at lon_v")
    data["lon_v"] = data["lon_v"] - 0.005
    check(write(data, tmp_path / "b.nc"), atol=1e-5)


@pytest.mark.parametrize("unit", ["radian", "rad"])
def test_places_in_radians(tmp_path, unit):
    """ICON-O tells the middles of its cells in radians."""
    data = regular().stack(ncells=("latitude", "longitude")).reset_index("ncells")
    for name, short in (("longitude", "clon"), ("latitude", "clat")):
        data[short] = ("ncells", np.deg2rad(data[name].values), {"units": unit, "standard_name": name})
    ocean = check(write(data.drop_vars(["longitude", "latitude"]), tmp_path / "a.nc"), atol=1e-5)
    assert any("cells between the points along ncells are not given" in note for note in ocean.notes)


def polar(unit):
    """Currents of 0.3 m/s east and -0.2 m/s north on a polar stereographic grid in steps of 12.5 km."""
    radius, first = 6378273.0, -45.0
    x, y = np.meshgrid(12500.0 * np.arange(20, 29), 12500.0 * np.arange(-30, -22))
    lat = 90.0 - 2.0 * np.rad2deg(np.arctan2(np.hypot(x, y), 2.0 * radius))
    lon = np.rad2deg(np.arctan2(x, -y)) + first
    angle = -np.deg2rad(lon - first)
    along = 0.3 * np.cos(angle) - 0.2 * np.sin(angle), -0.3 * np.sin(angle) - 0.2 * np.cos(angle)
    attributes = {"units": "m s-1", "grid_mapping": "stereographic"}
    data = xr.Dataset(coords={"time": ("time", [0.0], HOURS)})
    for name, values, axis in (("vxo", along[0], "x"), ("vyo", along[1], "y")):
        standard = {"standard_name": f"sea_water_{axis}_velocity"}
        data[name] = (("time", "y", "x"), values[None], attributes | standard)
    data["stereographic"] = ((), np.int32(0), {
        "grid_mapping_name": "polar_stereographic", "latitude_of_projection_origin": 90.0,
        "straight_vertical_longitude_from_pole": first, "scale_factor_at_projection_origin": 1.0,
        "false_easting": 0.0, "false_northing": 0.0, "semi_major_axis": radius, "semi_minor_axis": radius,
    })  # fmt: skip
    for name, axis in (("x", x[0]), ("y", y[:, 0])):
        data[name] = (name, axis / 1e5, {"units": unit, "standard_name": f"projection_{name}_coordinate"})
    return data, lon, lat


def test_projected_axes_in_hundreds_of_kilometres(tmp_path):
    """TOPAZ and others of the Arctic count in units of 100 km."""
    data, lon, lat = polar("100 km")
    with open_ocean(write(data, tmp_path / "a.nc")) as ocean:
        east, north, _ = ocean.at(lon[3, 4], lat[3, 4], 0.0, START)
        np.testing.assert_allclose([east, north], [0.3, -0.2], atol=1e-6)
    refused(write(polar("cells")[0], tmp_path / "b.nc"), "x has units 'cells', which are no length")


def test_curvilinear_components_eastward_by_their_long_name(tmp_path):
    lon, lat = turned_grid()
    east, north = flow(lon, lat)
    data = xr.Dataset(
        {
            "u": (("time", "j", "i"), east[None], {"units": "m s-1", "long_name": "Eastward current"}),
            "v": (("time", "j", "i"), north[None], {"units": "m s-1", "long_name": "Northward current"}),
            "longitude": (("j", "i"), lon, {"units": "degrees_east"}),
            "latitude": (("j", "i"), lat, {"units": "degrees_north"}),
        },
        {"time": ("time", [0.0], HOURS)},
    )
    ocean = check(write(data, tmp_path / "a.nc"), lon[4, 6], lat[4, 6], depth=0.0, hour=0.0)
    assert "u and v are eastward and northward by their long_name" in ocean.notes


def test_times_in_single_precision_are_noted(tmp_path):
    data = timed((58849.0 + HOUR).astype(np.float32), "days since 1858-11-17 00:00:00")
    with open_ocean(write(data, tmp_path / "a.nc")) as ocean:
        assert any("single precision, in steps of 338 s" in note for note in ocean.notes)


@pytest.mark.parametrize(("standard", "wet"), [("land_binary_mask", 0.0), ("sea_binary_mask", 1.0)])
@pytest.mark.parametrize("dims", [DIMS[2:], DIMS[1:]])
def test_masks_over_zeros(tmp_path, standard, wet, dims):
    """A mask may be of land or of water, and of the points or of all levels."""
    data = regular()
    shape = tuple(data.sizes[dim] for dim in dims)
    mask = np.full(shape, wet)
    mask[..., :2] = 1.0 - wet
    data["land"] = (dims, mask, {"standard_name": standard})
    for name in ("uo", "vo"):
        data[name] = data[name].where(data["land"] == wet, 0.0).assign_attrs(data[name].attrs)
    with open_ocean(write(data, tmp_path / "a.nc")) as ocean:
        assert np.isnan(ocean.at(LON, LAT, 0.0, START)[0])
        np.testing.assert_allclose(ocean.at(*PLACE, 0.0, START)[:2], flow(*PLACE), atol=1e-6)


def test_walls_of_mitgcm_hold_zeros(tmp_path):
    """On MITgcm's edges beside land is 0, which is no current; hFacC tells land by level."""
    lon, lat, depth = LON + 0.01 * np.arange(8), LAT + 0.01 * np.arange(6), np.array([5.0, 15.0])
    open_ = np.ones((2, 6, 8))
    open_[:, :, :3] = 0.0
    open_[1, :, 6:] = 0.0
    edges = open_ * np.roll(open_, 1, axis=2), open_ * np.roll(open_, 1, axis=1)
    fields = []
    for which, (x, y) in enumerate(((lon - 0.005, lat), (lon, lat - 0.005))):
        z, j, i = np.meshgrid(depth, y, x, indexing="ij")
        fields.append(flow(i, j, z)[which] * edges[which])
    data = xr.Dataset(
        {
            "UVEL": (("time", "Z", "YC", "XG"), fields[0][None], {"units": "m/s", "standard_name": "UVEL"}),
            "VVEL": (("time", "Z", "YG", "XC"), fields[1][None], {"units": "m/s", "standard_name": "VVEL"}),
            "hFacC": (("Z", "YC", "XC"), 0.3 * open_),
        },
        {"time": ("time", [0.0], HOURS), "Z": ("Z", -depth, {"units": "m", "positive": "up"})},
    )
    for name, values in (("XC", lon), ("XG", lon - 0.005), ("YC", lat), ("YG", lat - 0.005)):
        data[name] = (name, values, {"units": "degrees_east" if name[0] == "X" else "degrees_north"})
    with open_ocean(write(data, tmp_path / "a.nc")) as ocean:
        assert np.isnan(ocean.at(lon[1], lat[3], 5.0, START)[0])
        assert np.isnan(ocean.at(lon[7], lat[3], 15.0, START)[0])
        np.testing.assert_allclose(
            ocean.at(lon[5], lat[3], 15.0, START)[0], flow(lon[5] - 0.005, lat[3], 15.0)[0]
        )
        np.testing.assert_allclose(
            ocean.at(lon[4], lat[3], 15.0, START)[:2], flow(lon[4], lat[3], 15.0), atol=1e-6
        )


def test_groups_and_archives_are_refused_with_what_would_do(tmp_path):
    path = tmp_path / "a.nc"
    regular().to_netcdf(path, engine="h5netcdf", group="forecast")
    refused(path, "in the groups forecast", "ncks -G : -g forecast")
    archive = tmp_path / "a.zarr.zip"
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr(".zgroup", "{}")
    refused(archive, "a ZIP archive, not a NetCDF file: unpack it first")


def test_the_depth_of_a_single_level(tmp_path):
    data = regular(depth=[10.0]).isel(depth=0)
    data["depth"].attrs = {"units": "m"}
    ocean = check(write(data, tmp_path / "a.nc"), depth=10.0)
    assert ocean.levels == [10.0]


def test_a_height_beside_components_without_standard_names_is_that_of_a_wind(tmp_path):
    data = regular(depth=[0.0]).isel(depth=0, drop=True)
    data["height"] = ((), 10.0, {"units": "m", "standard_name": "height", "positive": "up"})
    check(write(data, tmp_path / "current.nc"), depth=0.0)
    data = described(data).rename(uo="u", vo="v")
    refused(write(data, tmp_path / "wind.nc"), "height is height, and positive")


def test_degrees_west_and_south(tmp_path):
    data = regular(lon=-20.0 + 0.01 * np.arange(8), about=-20.0)
    for name, units in (("longitude", "degrees_west"), ("latitude", "degrees_south")):
        data[name] = (name, -data[name].values, {"units": units})
    with open_ocean(write(data, tmp_path / "a.nc")) as ocean:
        np.testing.assert_allclose(ocean.longitude, -20.0 + 0.01 * np.arange(8))
        found = ocean.at(-20.0 + 0.033, PLACE[1], 0.0, START)[:2]
        np.testing.assert_allclose(found, flow(LON + 0.033, PLACE[1]), atol=1e-6)
    for name in ("longitude", "latitude"):
        data[name] = (name, -data[name].values, {"units": "degrees"})
    with open_ocean(write(data, tmp_path / "b.nc")) as ocean:
        np.testing.assert_allclose(ocean.latitude, LAT + 0.01 * np.arange(6))


@pytest.mark.parametrize("attributes", [{}, {"positive": "up"}])
def test_a_bed_that_is_told_as_a_height(tmp_path, attributes):
    data = over_a_bed(-30.0, **SIGMA)
    data["h"].attrs |= attributes
    check(write(data, tmp_path / "a.nc"))


def test_a_surface_far_from_the_sea_is_refused(tmp_path):
    data = over_a_bed(30.0, **SIGMA)
    data["zeta"] = (("time", *DIMS[2:]), np.full((3, 6, 8), 9999.0), {"units": "m"})
    with (
        open_ocean(write(data, tmp_path / "a.nc")) as ocean,
        pytest.raises(CurrentError, match="zeta reaches"),
    ):
        ocean.at(*PLACE, 0.0, START)


def test_a_grid_along_parallels_and_meridians_needs_no_turn(tmp_path):
    data = described(regular()).rename(uo="u", vo="v", longitude="x", latitude="y")
    lon, lat = np.meshgrid(data["x"].values, data["y"].values)
    data = data.drop_vars(["x", "y"])
    data["lon"] = (("y", "x"), lon, {"units": "degrees_east"})
    data["lat"] = (("y", "x"), lat, {"units": "degrees_north"})
    check(write(data, tmp_path / "a.nc"), atol=1e-5)


@pytest.mark.parametrize("standard", ["sea_water_{}_velocity", None])
def test_all_levels_go_before_the_surface(tmp_path, standard):
    data = regular().rename(uo="u", vo="v")
    for name, axis, way in (("u", "x", "east"), ("v", "y", "north")):
        data[f"{name}_top"] = 0.0 * data[name].isel(depth=0, drop=True)
        data[f"{name}_top"].attrs = {"units": "m/s", "standard_name": f"surface_{way}ward_sea_water_velocity"}
        data[name].attrs = {"units": "m/s"} | ({"standard_name": standard.format(axis)} if standard else {})
    check(write(data, tmp_path / "a.nc"))


def test_a_mask_that_changes_in_time_is_no_mask_of_land(tmp_path):
    data = regular()
    data["wet"] = (("time", *DIMS[2:]), np.zeros((3, 6, 8)))
    data["wet"][0, 0, 0] = 1.0
    check(write(data, tmp_path / "a.nc"))


def test_two_likely_longitudes_are_refused_until_one_is_named(tmp_path):
    data = described(regular()).rename(uo="u_eastward", vo="v_northward", longitude="x", latitude="y")
    lon, lat = np.meshgrid(data["x"].values, data["y"].values)
    data = data.drop_vars(["x", "y"])
    for letter, shift in (("T", 0.005), ("U", 0.0)):
        data[f"{letter}LONG"] = (("y", "x"), lon + shift, {"units": "degrees_east"})
        data[f"{letter}LAT"] = (("y", "x"), lat + shift, {"units": "degrees_north"})
    refused(write(data, tmp_path / "a.nc"), "may be TLONG or ULONG", "ncatted -a coordinates,u_eastward")
    for name in ("u_eastward", "v_northward"):
        data[name].attrs["coordinates"] = "ULONG ULAT"
    check(write(data, tmp_path / "b.nc"), atol=1e-5)


@pytest.mark.parametrize("dims", [("i", "j"), ("nx", "ny"), ("xi", "eta_y")])
def test_rows_along_the_first_dimension(tmp_path, dims):
    """What a dimension is called tells which of them x follows."""
    lon, lat = turned_grid(angle=0.0)
    east, north = flow(lon, lat)
    data = xr.Dataset(coords={"time": ("time", [0.0], HOURS)})
    for name, values, axis in (("uo", east, "x"), ("vo", north, "y")):
        attributes = {"units": "m s-1", "standard_name": f"sea_water_{axis}_velocity"}
        data[name] = (("time", *dims), values.T[None], attributes)
    data["lon"] = (dims, lon.T + 1e-5 * lat.T, {"units": "degrees_east"})
    data["lat"] = (dims, lat.T + 1e-5 * lon.T, {"units": "degrees_north"})
    if dims[1].startswith("eta"):
        data = data.rename({"eta_y": "y"})
    with open_ocean(write(data, tmp_path / "a.nc")) as ocean:
        place = data["lon"].values[5, 4], data["lat"].values[5, 4]
        np.testing.assert_allclose(ocean.at(*place, 0.0, START)[:2], (east[4, 5], north[4, 5]), atol=1e-3)


def test_values_far_beyond_the_valid_range_are_missing(tmp_path):
    data = regular()
    for name in ("uo", "vo"):
        data[name] = data[name].copy(data=100.0 * data[name].values)
        data[name].values[:, :, 2, 3] = -999.0
        data[name].attrs |= {"units": "cm/s", "valid_min": -300.0, "valid_max": 300.0}
    with open_ocean(write(data, tmp_path / "a.nc")) as ocean:
        assert np.isnan(ocean.at(LON + 0.03, LAT + 0.02, 0.0, START)[0])
        np.testing.assert_allclose(ocean.at(LON, LAT, 0.0, START)[0], 0.3, atol=1e-6)
