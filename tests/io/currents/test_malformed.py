"""Files that are none, or contradict themselves: one clear line that names the file and what is wrong."""

import zipfile

import h5py
import numpy as np
import pytest

from auvplan.io.currents import open_ocean, read_current
from auvplan.ocean.gridded import CurrentError
from tests.io.currents.samples import (
    BOX,
    LAT,
    LON,
    NORTH,
    SIGMA,
    SITE,
    START,
    c_grid,
    fvcom,
    named,
    nodes,
    other_levels,
    over_a_bed,
    refused,
    regular,
    roms,
    timed,
    ugrid,
    write,
)
from tests.io.currents.test_formats import beside_a_height, described, own_depths, own_places, two_grids
from tests.io.refusals import refusal


def attrs(name, **changes):
    """A change of a variable's attributes; None takes one away."""

    def change(data):
        kept = {key: value for key, value in (data[name].attrs | changes).items() if value is not None}
        data[name].attrs = kept
        return data

    return change


def values(name, new):
    return lambda data: data.assign({name: (data[name].dims, new(data[name].values * 1.0), data[name].attrs)})


def put(index, value):
    """A change of one value."""

    def change(array):
        array[index] = value
        return array

    return change


def stations(**stated):
    data = regular().isel(latitude=[0, 2, 3, 5], longitude=[1, 4])
    return data.stack(station=("latitude", "longitude")).reset_index("station").assign_attrs(stated)


def speed_and_direction():
    data = regular().rename(uo="s", vo="d")
    data["s"].attrs = {"units": "m s-1", "standard_name": "sea_water_speed"}
    data["d"].attrs = {"units": "degree", "standard_name": "sea_water_velocity_to_direction"}
    return data


def folded(name):
    """A grid that lies over itself in its first columns."""
    data = roms(angle=0.1)
    data[name].values[:, :4] = np.flip(data[name].values[:, :4], -1 if name == "lon_rho" else 0)
    return data


def shuffled(data):
    data["mesh_y"].values[:] = np.random.default_rng(0).permutation(data["mesh_y"].values)
    return data


PASSED = ("no current", "u, v are by their attributes of wind")
MEMBERS = ("levels along member, but no depths", "ncks -d member,0")
AXIS = {"axis": "Z", "positive": "down"}
#: Changes of the sample on a regular grid, and words of the line.
ALTERED = {
    "no current": (lambda d: d.drop_vars(["uo", "vo"]), "no current: neither a variable with standard_name"),
    "no partner": (lambda d: d.drop_vars("vo"), "uo has no partner northward_sea_water_velocity"),
    "two northward": (attrs("uo", standard_name=NORTH["standard_name"]), "uo and vo have standard names"),
    "no time": (lambda d: d.drop_vars("time"), "no time coordinate"),
    "no longitude": (lambda d: d.drop_vars("longitude"), "uo has no longitude"),
    "no depths": (lambda d: d.drop_vars("depth"), "uo has levels along depth, but no depths of them"),
    "levels without metres": (attrs("depth", units="level"), "depth has units 'level', which are no length"),
    "unknown unit": (attrs("uo", units="furlongs"), "uo has units 'furlongs', which are no speed"),
    "falling and rising": (values("latitude", put(2, LAT)), "latitude neither rises nor falls"),
    "twisted depths": (values("depth", put(2, 5.0)), "depths depth neither rise nor fall"),
    "not finite": (values("longitude", put(3, np.inf)), "longitude has values that are not finite"),
    "no degrees": (values("latitude", lambda v: v * 1e5), "longitude and latitude are no degrees"),
    "missing date": (values("time", put(1, np.nan)), "time has missing dates"),
    "times run back": (values("time", put(2, -5.0)), "time does not rise"),
    "endless time": (values("time", put(2, 1e30)), "time has dates that are none"),
    "odd time units": (attrs("time", units="hours since the flood 1"), "dates cannot be understood"),
    "down, but negative": (values("depth", lambda v: -v), "positive = down, but its values are negative"),
    "up, but positive": (attrs("depth", positive="up"), "says positive = up, but its values are positive"),
    "both signs": (values("depth", put(0, -3.0)), "depths depth are of both signs"),
    "sideways": (attrs("depth", positive="left"), "positive = 'left', neither up nor down"),
    "undeclared fill": (values("uo", put((0, 0, 2, 3), 9999.0)), "uo reaches 9999 m/s, which is implausible"),
    "missing everywhere": (values("uo", lambda v: v * np.nan), "missing everywhere in the box"),
    "fast, without units": (lambda d: attrs("uo", units=None)(values("uo", lambda v: v * 100)(d)),
                            "uo has no units and reaches"),
    "members": (lambda d: d.expand_dims(member=2), "of which one is neither level nor place",
                "member and depth", "ncks -d member,0"),
    "words": (lambda d: d.assign(uo=d.uo.astype("S1")), "uo holds no numbers"),
}  # fmt: skip

#: What makes other data sets, and words of the line.
REFUSED = {
    # other names and conventions, with what would do
    "unknown names": (lambda: named("U1", "V1"), "no current", "ncrename -v U1,uo -v V1,vo"),
    "wind": (lambda: named("u", "v", long_name="10 metre {}ward wind"), *PASSED),
    "ice": (lambda: named("u", "v", long_name="sea ice drift, {}ward"), *PASSED),
    "air": (lambda: named("u", "v", standard_name="{}ward_air_velocity"), *PASSED),
    "waves": (lambda: named("u", "v", standard_name="sea_surface_wave_stokes_drift_{}ward_velocity"),
              *PASSED),
    "extremes": (lambda: named("u", "v", standard_name="{}ward_sea_water_velocity",
                               cell_methods="time: maximum"), *PASSED),
    "a height of the wind": (lambda: described(beside_a_height(positive="up")).rename(uo="u", vo="v"),
                             "height is height, and positive"),
    "speed and direction": (speed_and_direction, "no current", "from s and d", "speed sin(direction)"),
    "member for level": (lambda: other_levels("member"), *MEMBERS),
    "numbers from 1": (lambda: other_levels("member", [1.0, 2.0, 3.0], **AXIS), *MEMBERS),
    "shares": (lambda: other_levels("level", -(np.arange(3) + 0.5) / 3, positive="up"),
               "level has no units and lies between", "ncatted"),
    "heights": (lambda: other_levels("depth", [0.0, 9.0, 30.0], units="m",
                                     standard_name="height_above_sea_floor"),
                "depth is height_above_sea_floor, and positive: depths below the surface"),
    "from the bed": (lambda: over_a_bed(30.0, values=[1.0, 0.5, 0.0], positive="up"),
                     "sigma are positive upward, from the bed"),
    "depths that differ": (lambda: own_depths(1.0), "along depthv", "depthu, and they differ"),
    "places that differ": (lambda: own_places(0.005), "uo lies at lon_u and vo at lon_v"),
    "two grids": (two_grids, "may be TLONG or ULONG", "ncatted -a coordinates,u_eastward"),
    "dates in words": (lambda: timed(["noon", "one"]), "dates cannot be understood: 'noon'"),
    **{units: (lambda units=units: timed(units=units), words, units) for units, words in (
        ("hours since 2020-01-01 02:00:00 CEST", "the time zone CEST"),
        ("hours since 2020-01-01 02:00:00 UTC+2", "the time zone UTC+2"),
        ("hours since 01-02-2020 00:00:00", "may begin with the day or the month"),
        ("months since 2020-01-01", "dates cannot be understood"))},
    "a time series": (lambda: stations(featureType="timeSeries"),
                      "holds single places (timeSeries)", "grid or a mesh is needed"),
    "stations": (stations, "holds single places (station)", "grid or a mesh is needed"),
    "a surface far from the sea": (
        lambda: over_a_bed(30.0, **SIGMA).assign(
            zeta=(("time", "latitude", "longitude"), np.full((3, 6, 8), 9999.0), {"units": "m"})),
        "zeta reaches 9999 m"),
    # staggered grids and meshes
    "ROMS without h": (lambda: roms().drop_vars("h"), "h is missing"),
    "ROMS without a curve": (lambda: roms().drop_vars("Cs_r"),
                             "levels along s_rho need Cs_r, which is missing"),
    "transform 3": (lambda: roms().assign(Vtransform=3), "Vtransform is 3, neither 1 nor 2"),
    "places at zero": (lambda: roms().assign(lon_rho=roms().lon_rho * 0),
                       "staggered grid, but lon_rho is missing"),
    "too few faces": (lambda: roms().isel(xi_u=slice(0, -2)), "u has 9 x 9 points, 9 x 11 fit the grid"),
    "not s": (lambda: roms().assign(Cs_r=roms().Cs_r - 7), "is not between -1 and 0"),
    "other nodes": (lambda: fvcom().assign(nv=fvcom().nv + 1000),
                    "connectivity nv does not fit the 56 nodes"),
    "FVCOM without h": (lambda: fvcom().drop_vars("h"), "h is missing"),
    "no shares": (lambda: values("siglay", lambda v: v * 50)(fvcom()), "siglay are no shares of the depth"),
    "no latitudes": (lambda: values("lat", lambda v: v * np.nan)(fvcom()),
                     "lat has values that are not finite"),
    "folded": (lambda: folded("lat_rho"), "the grid of lon_rho and lat_rho folds over itself"),
    "too few edges": (lambda: c_grid().isel(XG=slice(0, 5)), "5 edges along XG do not fit 9 middles"),
    "cells that overlap": (lambda: shuffled(ugrid()), "the cells of the mesh lie over each other"),
    "heights of the fill value": (lambda: nodes("schism").fillna({"zcor": 9.96921e36}),
                                  "zcor reaches 9.96921e+36 m"),
    "no faces": (lambda: ugrid().drop_vars("mesh_faces"),
                 "the mesh topology mesh names mesh_faces, which is missing: name the model's grid"),
}  # fmt: skip


@pytest.mark.parametrize("case", ALTERED | REFUSED)
def test_what_is_refused(tmp_path, case):
    make, *words = (ALTERED | REFUSED)[case]
    data = make(regular()) if case in ALTERED else make()
    text = case in ("words", "dates in words")  # NetCDF has them in types of its own
    refused(write(data, tmp_path / "broken.nc") if text else data, *words)


def test_a_line_names_the_file_and_is_short(tmp_path):
    refused(write(attrs("depth", units="x" * 60_000)(regular()), tmp_path / "a.nc"), "depth has units")


def test_parameters_of_roms_that_can_be_assumed():
    data = roms(transform=1).drop_vars(["Vtransform", "zeta", "s_rho"])
    with open_ocean(data) as ocean:
        assert "Vtransform is missing: taken as 1" in ocean.notes
        assert "the surface's height zeta is not given: taken as 0" in ocean.notes
        assert "the s-levels along s_rho are not given: taken as evenly spaced" in ocean.notes
    # Levels that would cross by the first transform.
    data = roms(transform=2).drop_vars("Vtransform")
    with open_ocean(data.assign(hc=data.hc * 0.0 + 1.5 * float(data.h.min()))) as ocean:
        assert "Vtransform is missing: taken as 2" in ocean.notes


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"this is a letter", "not a NetCDF file"),
        (b"", "not a NetCDF file"),
        (b"GRIB\x00\x00\x00\x02", "a GRIB file, not a NetCDF file"),
        (b"CDF\x01" + b"\x00" * 3, "not a readable NetCDF file"),
        (b"\x89HDF\r\n\x1a\n" + b"\x00" * 90, "not a readable NetCDF file"),
    ],
)
def test_no_netcdf(tmp_path, content, words):
    path = tmp_path / "letter.nc"
    path.write_bytes(content)
    refused(path, words)


def test_no_file(tmp_path):
    refused(tmp_path / "nowhere.nc", "no such file")
    (tmp_path / "folder").mkdir()
    refused(tmp_path / "folder", "a folder that is no Zarr store")
    refusal(CurrentError, r"no\*\.nc: no such file", open_ocean, str(tmp_path / "no*.nc"))
    refusal(CurrentError, "no file of currents", open_ocean, [])


def test_groups_and_archives_are_refused_with_what_would_do(tmp_path):
    regular().to_netcdf(tmp_path / "a.nc", engine="h5netcdf", group="forecast")
    refused(tmp_path / "a.nc", "in the groups forecast", "ncks -G : -g forecast")
    with zipfile.ZipFile(tmp_path / "a.zarr.zip", "w") as file:
        file.writestr(".zgroup", "{}")
    refused(tmp_path / "a.zarr.zip", "a ZIP archive, not a NetCDF file: unpack it first")


def dated(values, **about):
    return regular().assign(time=("time", np.array(values), about))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (
            dated([58.0, 59.0, 60.0], units="days since 2020-01-01", calendar="360_day"),
            "time: 2020-02-30 of the calendar 360_day is no UTC date",
        ),
        (
            dated([20209901.0, 20209902.0, 20209903.0], units="day as %Y%m%d.%f"),
            "time: dates cannot be understood: 20209901",
        ),
        (regular().isel(time=slice(0)), "time has no times"),
        (ugrid("node").isel(n_corner=0), "connectivity .* has 1 dimensions, not 2"),
    ],
)
def test_values_that_cannot_be_used_are_refused_in_one_line(data, words):
    refusal(CurrentError, f"dataset: .*{words}", open_ocean, data)


def test_series_that_do_not_fit():
    data = regular(hours=[0.0, 2.0, 4.0])

    def elsewhere(data):
        moved = values("longitude", lambda v: v + 0.001)(data)
        return moved.assign_coords(time=("time", [6.0, 7.0, 8.0], data.time.attrs))

    for change, words in (
        (values("time", lambda v: v + 1), "its times overlap those of"),
        (elsewhere, "the grids differ in longitude"),
        (lambda d: d.rename(uo="u_eastward"), "has no uo, which"),
        (lambda d: d.isel(depth=0), "uo has other dimensions"),
        (attrs("vo", units="cm s-1"), "vo is in 'cm s-1' and in 'm s-1', which must be one unit"),
    ):
        refusal(CurrentError, words, open_ocean, [data, change(data.copy(deep=True))])


@pytest.mark.parametrize("name", ["s_rho", "Cs_r", "h", "hc", "angle", "v"])
def test_series_whose_levels_directions_or_faces_differ(name):
    first, second = roms(), roms()
    second["ocean_time"] = (second["ocean_time"] + 7200.0).assign_attrs(first["ocean_time"].attrs)
    if name == "v":
        second, words = second.isel(eta_v=slice(0, -1)), "v has other dimensions"
    else:
        turn = (lambda array: array[::-1]) if second[name].ndim == 1 else (lambda array: array * 1.1)
        second, words = values(name, turn)(second), f"the grids differ in {name}"
    refusal(CurrentError, words, open_ocean, [first, second])


def test_series_name_both_files(tmp_path):
    paths = [write(regular(hours=hours), tmp_path / f"{k}.nc") for k, hours in enumerate(([0, 2], [1, 3]))]
    refusal(CurrentError, r"1\.nc: its times overlap those of .*0\.nc", open_ocean, paths)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"lower": (0, 0)}, "three finite numbers"),
        ({"upper": (-3000.0, 0.0, 10.0)}, "upper must exceed lower"),
        ({"outside": "guess"}, "outside must be 'refuse' or 'clamp'"),
        ({"times": (10.0, 5.0)}, "times must be the first and the last"),
        ({"times": (0.0, 1e6)}, "2020-01-01T00:00:00Z to 2020-01-12T13:46:40Z, the file covers"),
        ({"spacing": -1.0}, "spacing must be positive"),
        ({"depths": [5.0, 1.0]}, "depths must be rising"),
        ({"upper": (2000.0, 2600.0, 5.0)}, r"degrees\) east$"),
    ],
)
def test_wrong_arguments(change, words):
    refusal(CurrentError, words, read_current, regular(), SITE, **(BOX | change))


def test_places_and_moments_outside():
    with open_ocean(regular()) as ocean:
        for (latitude, depth, moment), words in (
            ((LAT - 0.01, 0.0, START), r"outside the data, by up to 111\d m \(0.01 degrees\) south"),
            ((LAT, 0.0, START - 3600.0),
             "the mission needs 2019-12-31T23:00:00Z, the file covers 2020-01-01"),
            ((LAT, -1.0, START), "not negative"),
        ):  # fmt: skip
            refusal(CurrentError, words, ocean.at, LON, latitude, depth, moment)


OTHER = "other.nc"


def virtual(file):
    layout = h5py.VirtualLayout((3, 3, 6, 8), "f8")
    layout[...] = h5py.VirtualSource(OTHER, "secret", shape=(3, 3, 6, 8))
    file.create_virtual_dataset("uo", layout)


def vast(file):
    axis = file.create_dataset("longitude", (10**12,), "f8", chunks=(1000,))
    axis.make_scale("longitude")
    file["uo"].dims[3].attach_scale(axis)
    axis.attrs["units"] = "degrees_east"


#: What is taken out of a file, what is put in its place, and words of the line.
HDF5 = {
    "link": ("uo", lambda file: file.update({"uo": h5py.ExternalLink(OTHER, "/secret")}), "another file"),
    "stored": ("uo", lambda file: file.create_dataset("uo", (3, 3, 6, 8), "f8", external=[(OTHER, 0, 3456)]),
               "another file"),
    "virtual": ("uo", virtual, "another file"),
    "vast": ("longitude", vast, "a.nc"),
    "other size": ("depth", lambda file: file.create_dataset("depth", (3 * 10**8,), "f4", chunks=(1000,)),
                   "not a readable NetCDF file"),
}  # fmt: skip


@pytest.mark.parametrize("how", HDF5)
def test_files_that_hdf5_would_follow_or_never_end_to_read(tmp_path, how):
    """Values in other files, an axis larger than any memory, a variable of other sizes than its dimensions.

    NetCDF's own library, which is tried where h5netcdf fails, ends the process when it reads the last.
    """
    name, put_in, words = HDF5[how]
    path = write(regular(), tmp_path / "a.nc")
    with h5py.File(path, "r+") as file:
        del file[name]
        put_in(file)
    refused(path, words)
