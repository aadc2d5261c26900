"""Files that are none, or contradict themselves: one clear line that names the file and what is wrong."""

import numpy as np
import pytest
import xarray as xr

from auvplan.io.currents import files as files_module
from auvplan.io.currents import open_ocean, read_current, reader
from auvplan.ocean.gridded import CurrentError
from tests.io.currents.samples import (
    BOX,
    LAT,
    LON,
    NORTH,
    SITE,
    START,
    fvcom,
    regular,
    roms,
    ugrid,
    write,
    write_plain,
)


def attrs(name, **changes):
    """A change of a variable's attributes; None takes one away."""

    def change(data):
        for key, value in changes.items():
            data[name].attrs.pop(key, None)
            if value is not None:
                data[name].attrs[key] = value
        return data

    return change


def values(name, new):
    def change(data):
        old = data[name]
        return data.assign({name: (old.dims, new(old.values.astype(float)), old.attrs)})

    return change


def put(index, value):
    """A change of one value."""

    def change(array):
        array = array.copy()
        array[index] = value
        return array

    return change


MALFORMED = {
    "no current": (lambda d: d.drop_vars(["uo", "vo"]), "no current: neither a variable with standard_name"),
    "no partner": (lambda d: d.drop_vars("vo"), "uo has no partner northward_sea_water_velocity"),
    "two northward": (attrs("uo", standard_name=NORTH["standard_name"]), "uo and vo have standard names"),
    "no time": (lambda d: d.drop_vars("time"), "no time coordinate"),
    "no longitude": (lambda d: d.drop_vars("longitude"), "uo has no longitude"),
    "no depths": (lambda d: d.drop_vars("depth"), "uo has levels along depth, but no depths of them"),
    "levels without metres": (attrs("depth", units="level"), "depth has units 'level', which are no length"),
    "unknown unit": (attrs("uo", units="furlongs"), "uo has units 'furlongs', which are no speed"),
    "falling and rising": (values("latitude", put(2, LAT)), "latitude neither rises nor falls"),
    "twisted longitude": (values("longitude", put(3, LON)), "longitude neither rises nor falls"),
    "twisted depths": (values("depth", put(2, 5.0)), "depths depth neither rise nor fall"),
    "not finite": (values("longitude", put(3, np.inf)), "longitude has values that are not finite"),
    "missing place": (values("latitude", put(0, np.nan)), "latitude has values that are not finite"),
    "no degrees": (values("latitude", lambda v: v * 1e5), "longitude and latitude are no degrees"),
    "missing date": (values("time", put(1, np.nan)), "time has missing dates"),
    "times run back": (values("time", put(2, -5.0)), "time does not rise"),
    "endless time": (values("time", put(2, 1e30)), "time has dates that are none"),
    "odd time units": (attrs("time", units="hours since the flood 1"), "dates cannot be understood"),
    "unknown calendar": (attrs("time", calendar="martian"), "dates cannot be understood"),
    "down, but negative": (values("depth", lambda v: -v), "positive = down, but its values are negative"),
    "up, but positive": (attrs("depth", positive="up"), "says positive = up, but its values are positive"),
    "both signs": (values("depth", put(0, -3.0)), "depths depth are of both signs"),
    "sideways": (attrs("depth", positive="left"), "positive = 'left', neither up nor down"),
    "undeclared fill": (values("uo", put((0, 0, 2, 3), 9999.0)), "uo reaches 9999 m/s, which is implausible"),
    "infinite": (values("uo", put((0, 0, 2, 3), np.inf)), "uo reaches inf m/s, which is implausible"),
    "missing everywhere": (values("uo", lambda v: v * np.nan), "missing everywhere in the box"),
    "members": (lambda d: d.expand_dims(member=2), "of which one is neither level nor place"),
    "words": (lambda d: d.assign(uo=d.uo.astype("S1")), "uo holds no numbers"),
}  # fmt: skip


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_regular_files(tmp_path, case):
    change, words = MALFORMED[case]
    path = write(change(regular()), tmp_path / "broken.nc")
    refused(path, words)


def refused(path, words, site=SITE, box=BOX):
    with pytest.raises(CurrentError) as caught:
        read_current(path, site, **box)
    message = str(caught.value)
    assert words in message
    assert str(getattr(path, "name", path)) in message
    assert "\n" not in message


def test_missing_units_of_a_fast_current(tmp_path):
    data = values("uo", lambda v: v * 100)(regular())
    path = write(attrs("uo", units=None)(data), tmp_path / "broken.nc")
    refused(path, "uo has no units and reaches")


ROMS = {
    "no h": (lambda d: d.drop_vars("h"), "h is missing"),
    "no curve": (lambda d: d.drop_vars("Cs_r"), "levels along s_rho need Cs_r, which is missing"),
    "no hc": (lambda d: d.drop_vars("hc"), "levels along s_rho need hc, which is missing"),
    "transform 3": (lambda d: d.assign(Vtransform=3), "Vtransform is 3, neither 1 nor 2"),
    "places at zero": (lambda d: d.assign(lon_rho=d.lon_rho * 0), "staggered grid, but lon_rho is missing"),
    "too few faces": (lambda d: d.isel(xi_u=slice(0, -2)), "u has 9 x 9 points, 9 x 11 fit the grid"),
    "not s": (lambda d: d.assign(Cs_r=d.Cs_r - 7), "is not between -1 and 0"),
}


@pytest.mark.parametrize("case", ROMS)
def test_malformed_roms(tmp_path, case):
    change, words = ROMS[case]
    with pytest.raises(CurrentError, match=words):
        open_ocean(write(change(roms()), tmp_path / "roms.nc"))


def test_parameters_of_roms_that_can_be_assumed(tmp_path):
    path = write(roms(transform=1).drop_vars(["Vtransform", "zeta", "s_rho"]), tmp_path / "roms.nc")
    with open_ocean(path) as ocean:
        assert "Vtransform is missing: taken as 1" in ocean.notes
        assert "the surface's height zeta is not given: taken as 0" in ocean.notes
        assert "the s-levels along s_rho are not given: taken as evenly spaced" in ocean.notes


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("nv", lambda v: v + 1000, "connectivity nv does not fit the 56 nodes"),
        ("h", None, "h is missing"),
        ("siglay", lambda v: v * 50, "siglay are no shares of the depth"),
        ("lat", lambda v: v * np.nan, "lat has values that are not finite"),
    ],
)
def test_malformed_fvcom(tmp_path, name, change, words):
    variables = fvcom()
    dims, old, own = variables.pop(name)
    if change is not None:
        variables[name] = (dims, change(old), own)
    with pytest.raises(CurrentError, match=words):
        open_ocean(write_plain(variables, tmp_path / "fvcom.nc"))


def test_malformed_ugrid(tmp_path):
    variables = ugrid()
    del variables["mesh_faces"]
    with pytest.raises(
        CurrentError, match="the mesh topology mesh names mesh_faces, which is missing: name the model's grid"
    ):
        open_ocean(write_plain(variables, tmp_path / "mesh.nc"))


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
    refused(str(tmp_path / "no*.nc"), "no such file")
    (tmp_path / "folder").mkdir()
    refused(tmp_path / "folder", "a folder that is no Zarr store")
    with pytest.raises(CurrentError, match="no file of currents is named"):
        open_ocean([])


@pytest.mark.parametrize("suffix", ["nc", "nc3"])
def test_damaged_files_raise_nothing_else(tmp_path, suffix):
    path = write(regular(), tmp_path / f"damaged.{suffix}")
    whole, rng, messages = path.read_bytes(), np.random.default_rng(5), []
    for number in range(60):
        damaged = bytearray(whole if number % 2 else whole[: rng.integers(4, len(whole))])
        for _ in range(20):
            damaged[rng.integers(4, max(5, min(len(damaged), 6000)))] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            read_current(path, SITE, **BOX).source.close()
        except CurrentError as error:
            messages.append(str(error))
    assert len(messages) > 20
    assert all("damaged" in message and "\n" not in message for message in messages)


def test_levels_that_would_cross_by_the_first_transform(tmp_path):
    data = roms(transform=2).drop_vars("Vtransform")
    data = data.assign(hc=data.hc * 0.0 + 1.5 * float(data.h.min()))
    with open_ocean(write(data, tmp_path / "roms.nc")) as ocean:
        assert "Vtransform is missing: taken as 2" in ocean.notes


def test_series_that_do_not_fit(tmp_path):
    data = regular(hours=[0.0, 2.0, 4.0])
    first = write(data, tmp_path / "a.nc")
    cases = {
        "overlap": (values("time", lambda v: v + 1), "its times overlap those of"),
        "grid": (lambda d: values("longitude", lambda v: v + 0.001)(d).assign_coords(
            time=("time", [6.0, 7.0, 8.0], d.time.attrs)), "the grids differ in longitude"),
        "names": (lambda d: d.rename(uo="u_eastward"), "has no uo, which"),
        "dimensions": (lambda d: d.isel(depth=0), "uo has other dimensions"),
        "units": (attrs("vo", units="cm s-1"), "vo is in 'cm s-1' and in 'm s-1', which must be one unit"),
    }  # fmt: skip
    for name, (change, words) in cases.items():
        other = write(change(data), tmp_path / f"{name}.nc")
        with pytest.raises(CurrentError, match=words):
            open_ocean([first, other])


@pytest.mark.parametrize("name", ["s_rho", "Cs_r", "h", "hc", "angle"])
def test_series_whose_levels_or_directions_differ(tmp_path, name):
    first, second = roms(), roms()
    second["ocean_time"] = second["ocean_time"] + 7200.0
    second["ocean_time"].attrs = first["ocean_time"].attrs
    values = second[name].values
    second[name] = (second[name].dims, values[::-1] if values.ndim == 1 else values * 1.1, second[name].attrs)
    paths = [write(data, tmp_path / f"{k}.nc") for k, data in enumerate((first, second))]
    with pytest.raises(CurrentError, match=rf"1\.nc and 0\.nc: the grids differ in {name}"):
        open_ocean(paths)


def test_a_series_whose_second_file_has_fewer_faces(tmp_path):
    first, second = roms(), roms().isel(eta_v=slice(0, -1))
    second["ocean_time"] = second["ocean_time"] + 7200.0
    second["ocean_time"].attrs = first["ocean_time"].attrs
    paths = [write(data, tmp_path / f"{k}.nc") for k, data in enumerate((first, second))]
    with pytest.raises(CurrentError, match=r"1\.nc and 0\.nc: v has other dimensions"):
        open_ocean(paths)


def test_absurd_sizes_are_refused_before_they_are_read(tmp_path, monkeypatch):
    path = write(regular(), tmp_path / "a.nc")
    monkeypatch.setattr(reader, "MAX_VALUES", 100)
    refused(path, "values, more than 100")
    monkeypatch.setattr(files_module, "MAX_COORDINATE", 5)
    refused(path, "coordinate longitude has 8 values, more than 5 are not read")


def test_a_head_that_promises_too_much(tmp_path):
    """A sparse file whose axis has more values than any memory."""
    h5py = pytest.importorskip("h5py")
    path = write(regular(), tmp_path / "vast.nc")
    with h5py.File(path, "a") as file:
        del file["longitude"]
        vast = file.create_dataset("longitude", (10**12,), "f8", chunks=(1000,))
        vast.make_scale("longitude")
        file["uo"].dims[3].attach_scale(vast)
        vast.attrs["units"] = "degrees_east"
    with pytest.raises(CurrentError, match=r"vast\.nc"):
        open_ocean(path)


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
def test_wrong_arguments(tmp_path, change, words):
    path = write(regular(), tmp_path / "a.nc")
    with pytest.raises(CurrentError, match=words):
        read_current(path, SITE, **(BOX | change))


def test_places_and_moments_outside(tmp_path):
    with open_ocean(write(regular(), tmp_path / "a.nc")) as ocean:
        with pytest.raises(CurrentError, match=r"outside the data, by up to 111\d m \(0.01 degrees\) south"):
            ocean.at(LON, LAT - 0.01, 0.0, START)
        with pytest.raises(
            CurrentError, match="the mission needs 2019-12-31T23:00:00Z, the file covers 2020-01-01"
        ):
            ocean.at(LON, LAT, 0.0, START - 3600.0)
        with pytest.raises(CurrentError, match="not negative"):
            ocean.at(LON, LAT, -1.0, START)
        assert isinstance(ocean.form.variables["uo"], xr.Variable)


@pytest.mark.parametrize("how", ["link", "group", "stored", "virtual"])
def test_values_in_other_files_are_not_read(tmp_path, how):
    """HDF5 would follow a link, or read whatever file a variable says that its values are in."""
    h5py = pytest.importorskip("h5py")
    path, other = write(regular(), tmp_path / "a.nc"), tmp_path / "other.nc"
    shape = (3, 3, 6, 8)
    with h5py.File(other, "w") as file:
        file["secret"] = np.ones(shape)
    with h5py.File(path, "r+") as file:
        if how == "group":
            file["more"] = h5py.ExternalLink(str(other), "/")
        else:
            del file["uo"]
        if how == "link":
            file["uo"] = h5py.ExternalLink(str(other), "/secret")
        if how == "stored":
            file.create_dataset("uo", shape, "f8", external=[(str(other), 0, h5py.h5f.UNLIMITED)])
        if how == "virtual":
            layout = h5py.VirtualLayout(shape, "f8")
            layout[...] = h5py.VirtualSource(str(other), "secret", shape=shape)
            file.create_virtual_dataset("uo", layout)
    refused(path, "another file")


def test_a_variable_of_other_sizes_than_its_dimensions(tmp_path):
    """NetCDF's own library, which is tried where h5netcdf fails, ends the process when it reads one."""
    h5py = pytest.importorskip("h5py")
    pytest.importorskip("netCDF4")
    path = write(regular(), tmp_path / "a.nc")
    with h5py.File(path, "r+") as file:
        del file["depth"]
        file.create_dataset("depth", (3 * 10**8,), "f4", chunks=(1000,))
    refused(path, "not a readable NetCDF file")


@pytest.mark.parametrize("word", [b"latitude", b"units", b"m s-1"])
def test_a_length_in_a_classic_head_beyond_the_file(tmp_path, word):
    path = write(regular(), tmp_path / "a.nc3")
    content = path.read_bytes()
    at = content.index(word)
    path.write_bytes(content[: at - 4] + b"\x7f\xff\xff\xf0" + content[at:])
    refused(path, "not a readable NetCDF file")


def test_a_line_on_an_endless_unit_is_short(tmp_path):
    path = write(attrs("depth", units="x" * 60_000)(regular()), tmp_path / "a.nc")
    with pytest.raises(CurrentError, match="depth has units") as stated:
        open_ocean(path)
    assert len(str(stated.value)) <= 1000
