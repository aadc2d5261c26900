"""Currents fetched from servers on loopback are those of their data sets, and nothing more is asked."""

import json
from types import ModuleType

import h5py
import numpy as np
import pytest
import xarray as xr

from auvplan.io.currents import open_ocean, to_cf
from auvplan.io.forecasts import ForecastError, Request, fetch_current
from auvplan.ocean.gridded import CurrentError
from auvplan.runtime.files import OutputError, write_dataset
from auvplan.scenario.provenance import source_files
from tests.io.currents.samples import LAT, LON, START, regular, roms, ugrid
from tests.io.forecasts.servers import serving
from tests.io.refusals import refusal

BOX = "5.025,60.012,5.032,60.025"
TIME = "2020-01-01T00:10Z,+40min"


def hycom():
    """Packed numbers round the globe from 0 degrees, latitudes from the north, heights as levels."""
    lon, lat = np.arange(0.0, 360.0, 2.0), np.arange(66.0, 54.0, -2.0)
    t, z, y, x = np.meshgrid(range(3), range(3), range(len(lat)), range(len(lon)), indexing="ij")
    dims = ("time", "lev", "lat", "lon")
    packed = {"units": "m/s", "scale_factor": 0.001, "add_offset": 0.5, "_FillValue": np.int16(-30000)}
    u = (t * 1000 + z * 300 + y * 20 + x - 600).astype("i2")
    u[:, :, 2, 178] = -30000
    return xr.Dataset(
        {
            "water_u": (dims, u, packed),
            "water_v": (dims, (-u.astype(int) % 700).astype("i2"), packed),
            "salinity": (dims, u, {"units": "psu"}),
            "ssh": (dims[:1] + dims[2:], u[:, 0].astype("f4") / 1e4, {"units": "m"}),
        },
        {
            "time": ("time", np.arange(3.0), {"units": "hours since 2020-01-01 00:00:00"}),
            "lev": ("lev", np.array([0.0, -10.0, -50.0]), {"units": "m", "positive": "up"}),
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon": ("lon", lon, {"units": "degrees_east"}),
        },
        {"title": "a model", "bulletin_date": "2019-12-31", "history": "Mon Nov 23 06:36:26 UTC 2026"},
    )


def forecast():
    """The sample on a regular grid, with what is not to be fetched."""
    data = regular()
    data["thetao"] = data["uo"].dims, data["uo"].values, {"units": "degC"}
    run = {"standard_name": "forecast_reference_time", "units": "hours since 2020-01-01 00:00:00"}
    data["run"] = (), -6.0, run
    return data


@pytest.fixture(scope="module")
def server():
    mesh = ugrid("node").drop_vars("mesh")
    with serving(a=forecast(), h=hycom(), r=roms(land=[(3, 4)]), t=forecast()[["thetao"]], m=mesh) as one:
        yield one


@pytest.fixture(autouse=True)
def well(server):
    """Each test finds a healthy server."""
    server.ill.clear()
    server.asked.clear()


def dap(server, name="a"):
    return f"thredds:{server.address}/dodsC/{name}"


def griddap(server, name="a"):
    return f"erddap:{server.address}/erddap/griddap/{name}"


def fetch(source, path, box=BOX, time=TIME, depth="0,5", **more):
    fetched = fetch_current(Request.of(source, box, time, depth), path, **more)
    with xr.open_dataset(fetched.path, engine="h5netcdf", decode_cf=False) as data:
        return data.load()


@pytest.mark.parametrize("of", [dap, griddap])
def test_the_box_times_and_depths_asked_for_and_no_other_variable(server, tmp_path, of):
    found = fetch(of(server), tmp_path / "f.nc")
    expected = forecast().isel(time=[0, 1], depth=[0, 1], latitude=range(5), longitude=range(1, 6))
    for name in ("uo", "vo", "time", "depth", "latitude", "longitude"):
        np.testing.assert_array_equal(found[name].values, expected[name].values)
    assert found["uo"].attrs["standard_name"] == "eastward_sea_water_velocity"
    asked = [line.partition("?")[2].removeprefix("uo.") for line in server.asked if "uo" in line]
    assert asked == ["uo[0:1:1][0:1:1][0:1:4][1:1:5]"]
    assert not any("thetao" in line for line in server.asked)
    with open_ocean(tmp_path / "f.nc") as ocean:
        (east, _, _) = ocean.at(5.03, 60.02, 3.0, START + 1800.0)
    with_all = write_dataset(forecast(), tmp_path / "all.nc")
    with open_ocean(with_all) as ocean:
        np.testing.assert_allclose(east, ocean.at(5.03, 60.02, 3.0, START + 1800.0)[0])


def test_windows_of_means_are_fetched_too(tmp_path):
    data = regular(hours=[0.0, 1.0, 2.0])
    data["time_bnds"] = ("time", "nv"), np.array([[-1.0, 0.0], [0.0, 1.0], [1.0, 2.0]])
    data["time"].attrs["bounds"] = "time_bnds"
    for name in ("uo", "vo"):
        data[name].attrs["cell_methods"] = "time: mean"
    with serving(a=data) as other:
        found = fetch(dap(other), tmp_path / "f.nc", time="2020-01-01T00:40Z,+40min")
    np.testing.assert_array_equal(found["time_bnds"].values, data["time_bnds"].values[1:])
    with open_ocean(tmp_path / "f.nc") as ocean:
        np.testing.assert_allclose(ocean.times, START + np.array([1800.0, 5400.0]))


@pytest.mark.parametrize(("most", "requests"), [(800, 1), (400, 2), (200, 4), (40, 20), (8, 100), (1, 100)])
def test_a_request_is_no_larger_than_is_well_answered(server, tmp_path, monkeypatch, most, requests):
    """2 times, 2 depths, 5 rows, 5 columns of 8 bytes: in parts of as many first dimensions as it takes."""
    monkeypatch.setattr("auvplan.io.forecasts.fetching._AT_ONCE", most)
    found = fetch(dap(server), tmp_path / "f.nc")
    expected = forecast().isel(time=[0, 1], depth=[0, 1], latitude=range(5), longitude=range(1, 6))
    np.testing.assert_array_equal(found["uo"].values, expected["uo"].values)
    assert sum(".dods?uo.uo[" in line for line in server.asked) == requests


@pytest.mark.parametrize("of", [dap, griddap])
def test_packed_numbers_over_the_seam_of_a_globe(server, tmp_path, of):
    found = fetch(of(server, "h"), tmp_path / "h.nc", "-3,57,1,60.5", "2020-01-01,2020-01-01T01:00", "5,8")
    rows, columns = [1, 2, 3, 4, 5], [177, 178, 179, 0, 1, 2]
    expected = hycom().isel(time=[0, 1], lev=[0, 1], lat=rows, lon=columns)
    assert ("ssh" in found) == (of is dap), "griddap has variables of all axes alone"
    for name in set(found.data_vars) | {"lat", "lev"}:
        np.testing.assert_array_equal(found[name].values, expected[name].values)
        assert found[name].dtype == expected[name].dtype
    np.testing.assert_array_equal(found["lon"].values, [354, 356, 358, 360, 362, 364])
    assert found["water_u"].attrs["scale_factor"] == 0.001
    assert "salinity" not in found
    assert "history" not in found.attrs
    with open_ocean(tmp_path / "h.nc") as ocean:
        east, _, _ = ocean.at([-2.0, 358.0], [58.0, 58.0], [0.0, 10.0], START)
        np.testing.assert_allclose(east, 0.001 * hycom()["water_u"].values[0, [0, 1], 4, 179] + 0.5)
        assert np.isnan(ocean.at(-4.0, 62.0, 0.0, START)[0]), "what is missing there is missing here"


def test_native_roms_with_its_grid(server, tmp_path):
    box = f"{LON - 0.002},{LAT + 0.018},{LON + 0.006},{LAT + 0.022}"
    found = fetch(dap(server, "r"), tmp_path / "r.nc", box, "2020-01-01T00:30,+1h")
    whole = roms(land=[(3, 4)])
    assert found.sizes["eta_rho"] < whole.sizes["eta_rho"]
    assert found.sizes["xi_u"] == found.sizes["xi_rho"] - 1
    assert {"zeta", "h", "angle", "mask_rho", "Cs_r", "hc"} <= set(found.variables)
    write_dataset(whole, tmp_path / "whole.nc")
    rng = np.random.default_rng(0)
    lon, lat = rng.uniform(LON - 0.002, LON + 0.006, 50), rng.uniform(LAT + 0.018, LAT + 0.022, 50)
    values = []
    for name in ("whole.nc", "r.nc"):
        with open_ocean(tmp_path / name) as ocean:
            values.append(ocean.at(lon, lat, 7.0, START + 3000.0))
    np.testing.assert_array_equal(values[0], values[1])


def test_where_it_is_from_stays_with_the_file(server, tmp_path):
    found = fetch(dap(server), tmp_path / "f.nc")
    request = Request.of(dap(server), BOX, TIME, "0,5")
    times = "2020-01-01T00:10:00Z,2020-01-01T00:50:00Z"
    assert request.text == f"from thredds:{server.address}/dodsC/a box {BOX} time {times} depth 0,5"
    stated = {"server": f"{server.address}/dodsC", "dataset": "a", "run": "2019-12-31T18:00:00Z"}
    stated |= {"request": request.text, "request_sha256": request.sha256}
    found = {key.removeprefix("fetched_"): part for key, part in found.attrs.items() if "fetched" in key}
    assert found == stated
    with open_ocean(tmp_path / "f.nc") as ocean:
        write_dataset(to_cf(ocean), tmp_path / "cf.nc")
    for name in ("f.nc", "cf.nc"):
        (file,) = source_files({"current": {"files": name}}, tmp_path)
        assert file.origin == stated
        assert file.fetched == f"a from {server.address}/dodsC, run of 2019-12-31T18:00:00Z"
    again = fetch_current(request, tmp_path / "again.nc").path
    assert again.read_bytes() == (tmp_path / "f.nc").read_bytes(), "the same request, the same file"
    packed = fetch(dap(server, "h"), tmp_path / "h.nc", "-3,57,1,60.5", "2020-01-01,+1h", None)
    assert packed.attrs["fetched_run"] == "2019-12-31"


ASKED = [
    ({"source": "a"}, "--from 'a'"),
    ({"source": "thredds:a.nc"}, "needs an address"),
    ({"box": "1,2,3"}, "--box '1,2,3'"),
    ({"box": "1,3,2,2"}, "south before north"),
    ({"time": "tomorrow,+1h"}, "--time"),
    ({"time": "2020-01-02,2020-01-01"}, "ends before"),
    ({"depth": "5,1"}, "--depth '5,1'"),
    ({"box": "5.01,60.01,5.09,60.02"}, "beyond the data by up to .* east.* longitudes 5 to 5.07"),
    ({"box": "-40,10,-39,11"}, "beyond the data"),
    ({"time": "2020-01-01T02:00,+2h"}, "from 2020-01-01T00:00:00Z to 2020-01-01T03:00:00Z"),
    ({"depth": "40,50"}, "deepest level is 30 m"),
]


@pytest.mark.parametrize(("other", "words"), ASKED)
def test_what_cannot_be_fetched_is_one_line(server, tmp_path, other, words):
    options = {"source": dap(server), "box": BOX, "time": TIME, "depth": "0,5"} | other
    refusal(ForecastError, words, lambda: fetch_current(Request.of(**options), tmp_path / "f.nc"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("of", [dap, griddap])
@pytest.mark.parametrize(
    ("part", "ill", "words"),
    [
        ("", 404, "no such data set"),
        ("", 401, "wants a login"),
        ("uo", 500, "status 500"),
        ("uo", "cut", "broke off"),
        ("", "hang", "did not answer within 0.2 s"),
        ("uo", "hang", "did not answer within 0.2 s"),
    ],
)
def test_what_servers_do_wrong_is_one_line_and_no_file(server, tmp_path, of, part, ill, words):
    server.ill[part] = ill
    patience = 0.2 if ill == "hang" else 20.0
    line = refusal(ForecastError, words, fetch, of(server), tmp_path / "f.nc", timeout=patience)
    assert server.address in str(line)
    assert list(tmp_path.iterdir()) == []


def test_other_answers_and_no_server(server, tmp_path):
    with serving() as gone:
        address = dap(gone)
    path = tmp_path / "f.nc"
    for kind, words, source in (
        (ForecastError, "no such data set", dap(server, "none")),
        (ForecastError, "is a mesh, which is not cut", dap(server, "m")),
        (ForecastError, "griddap page", f"erddap:{server.address}/a"),
        (ForecastError, "cannot be reached", address),
        (CurrentError, "no current", dap(server, "t")),
    ):
        refusal(kind, words, fetch, source, path)
    refusal(OutputError, "no folder", fetch, dap(server), tmp_path / "none" / "f.nc")
    path.write_text("mine")
    server.ill["vo"] = "cut"
    refusal(ForecastError, "broke off", fetch, dap(server), path)
    assert path.read_text() == "mine"


class Client(ModuleType):
    """Stands for the Copernicus Marine client."""

    def __init__(self, known=True, error=None):
        super().__init__("copernicusmarine")
        self.known, self.error, self.asked = known, error, {}

    def login(self, check_credentials_valid=False):
        assert check_credentials_valid, "it would ask on the terminal"
        return self.known

    def open_dataset(self, **asked):
        self.asked = asked
        if self.error is not None:
            raise self.error
        return xr.decode_cf(forecast()).chunk()


def named(name):
    return type(name, (Exception,), {})("a reason\non two lines")


@pytest.fixture
def client(monkeypatch):
    def stand_in(*given, **more):
        made = Client(*given, **more)
        monkeypatch.setitem(__import__("sys").modules, "copernicusmarine", made)
        return made

    return stand_in


def test_copernicus_by_its_client(client, tmp_path):
    made = client()
    found = fetch("copernicus:cmems_mod", tmp_path / "f.nc")
    expected = forecast().isel(time=[0, 1], depth=[0, 1], latitude=range(5), longitude=range(1, 6))
    for name in ("uo", "vo", "depth", "latitude", "longitude"):
        np.testing.assert_array_equal(found[name].values, expected[name].values)
    assert "thetao" not in found
    assert made.asked["dataset_id"] == "cmems_mod"
    least, most = (made.asked[f"{side}_longitude"] for side in ("minimum", "maximum"))
    assert 4.9 < least <= 5.015
    assert 5.042 <= most < 5.2
    assert made.asked["coordinates_selection_method"] == "outside"
    with open_ocean(tmp_path / "f.nc") as ocean:
        np.testing.assert_array_equal(ocean.times, START + np.array([0.0, 3600.0]))
    with h5py.File(tmp_path / "f.nc") as file:
        assert file.attrs["fetched_server"] == "Copernicus Marine"
        assert file.attrs["fetched_run"] == "2019-12-31T18:00:00Z"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"known": False}, "copernicusmarine login"),
        ({"error": named("CouldNotConnectToAuthenticationSystem")}, "cannot be reached"),
        ({"error": named("InvalidUsernameOrPassword")}, "refuses the name or the password"),
        ({"error": named("DatasetNotFound")}, "no such data set"),
        ({"error": named("CoordinatesOutOfDatasetBounds")}, "outside the data"),
        ({"error": TimeoutError("slow")}, "cannot be reached"),
        ({"error": ValueError("odd")}, "ValueError: odd"),
    ],
)
def test_what_copernicus_refuses_is_one_line(client, tmp_path, options, words):
    client(**options)
    refusal(ForecastError, words, fetch, "copernicus:cmems_mod", tmp_path / "f.nc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("module", "source"),
    [("copernicusmarine", "copernicus:a"), ("requests", "erddap:"), ("pydap.client", "thredds:")],
)
def test_without_the_packages(server, tmp_path, monkeypatch, module, source):
    monkeypatch.setitem(__import__("sys").modules, module, None)
    source = {"erddap:": griddap(server), "thredds:": dap(server)}.get(source, source)
    refusal(ForecastError, r"pip install 'auvplan\[forecasts\]'", fetch, source, tmp_path / "f.nc")


def test_the_command(server, tmp_path, call, refused):
    path = tmp_path / "forecast.nc"
    options = ["--from", griddap(server), "--box", BOX, "--time", TIME, "--out", path]
    code, out, _ = call("currents", *options, "--json")
    assert code == 0
    stated = json.loads(out)
    assert (stated["times"], stated["points"]) == (2, "5 x 5")
    code, out, _ = call("currents", *options)
    assert code == 0
    assert f"written: {path}" in out
    path.unlink()
    for left, words in ((2, "--box"), (4, "--time"), (6, "--out")):
        assert f"needs {words} too" in refused("currents", *options[:left], *options[left + 2 :])
    for given in ([], [path, "--box", BOX], [path, *options]):
        refused("currents", *given)
    server.ill["uo"] = "cut"
    assert "broke off" in refused("currents", *options)
    assert not path.exists()
