"""Components on the edges of cells, in the forms of NEMO, MOM6 and MITgcm."""

import numpy as np
import pytest
import xarray as xr

from auvplan.io.currents import open_ocean
from auvplan.ocean.gridded import CurrentError
from tests.io.currents.samples import HOURS, LAT, LON, START, check, flow, refused, turned_grid

STEP = 0.01
#: Middles of 7 x 9 cells, and places amid them.
EAST, NORTH = LON + STEP * np.arange(9), LAT + STEP * np.arange(7)
AMID = LON + STEP * np.array([1.0, 2.3, 6.5]), LAT + STEP * np.array([1.0, 3.6, 4.2])
DEPTH, TIMES = np.array([0.0, 10.0, 30.0]), np.array([0.0, 1.0])
SPEED = {"units": "m/s"}
AXES = {
    "time": ("time", TIMES, HOURS),
    "depth": ("depth", DEPTH, {"units": "m", "positive": "down", "standard_name": "depth"}),
}


def stated(lon, lat, which):
    """One component [T, K, ...] of `flow` at places."""
    shape = (-1, *(1,) * (1 + np.ndim(lon)))
    hours, depths = TIMES.reshape(shape), DEPTH.reshape((1, -1, *(1,) * np.ndim(lon)))
    return flow(lon, lat, depths, hours)[which]


def on_edges(names, axes, xq, yq, walls=(1.0, 1.0), own=({}, {})):
    """Components on the edges at `xq` and `yq`; names of the components, of x and y of middles and edges."""
    x, y, x_edge, y_edge = axes
    units = {x: "degrees_east", x_edge: "degrees_east", y: "degrees_north", y_edge: "degrees_north"}
    places = {x: EAST, y: NORTH, x_edge: xq, y_edge: yq}
    east, north = stated(*np.meshgrid(xq, NORTH), 0), stated(*np.meshgrid(EAST, yq), 1)
    fields = {
        names[0]: (("time", "depth", y, x_edge), east * walls[0], SPEED | own[0]),
        names[1]: (("time", "depth", y_edge, x), north * walls[1], SPEED | own[1]),
    }
    return xr.Dataset(fields, AXES | {name: (name, places[name], {"units": units[name]}) for name in axes})


def expect(data, lon, lat, atol):
    for depth, hour in ((0.0, 0.0), (7.0, 0.5), (25.0, 1.0)):
        ocean = check(data, lon, lat, depth, hour, atol=atol)
    return ocean


@pytest.mark.parametrize("symmetric", [True, False])
def test_mom6(symmetric):
    more = [-0.5] if symmetric else []
    xq, yq = (first + STEP * np.append(more, np.arange(n) + 0.5) for first, n in ((LON, 9), (LAT, 7)))
    own = [{"standard_name": f"sea_water_{axis}_velocity"} for axis in "xy"]
    data = on_edges(("uo", "vo"), ("xh", "yh", "xq", "yq"), xq, yq, own=own)
    assert expect(data, *AMID, 2e-5).kind == "roms"


MITGCM = ("UVEL", "VVEL"), ("XC", "YC", "XG", "YG"), EAST - STEP / 2, NORTH - STEP / 2


def test_mitgcm():
    """Edges lie west and south of the middles of the same index."""
    data = on_edges(*MITGCM)
    expect(data, *AMID, 2e-5)
    refused(data.isel(XG=slice(0, 5)), "5 edges along XG do not fit 9 middles along XC")


def test_walls_of_mitgcm_hold_zeros():
    """On MITgcm's edges beside land is 0, which is no current; hFacC tells land by level."""
    open_ = np.ones((3, 7, 9))
    open_[:, :, :3] = 0.0
    open_[1, :, 7:] = 0.0
    walls = open_ * np.roll(open_, 1, axis=2), open_ * np.roll(open_, 1, axis=1)
    data = on_edges(*MITGCM, walls=walls).assign(hFacC=(("depth", "YC", "XC"), 0.3 * open_))
    with open_ocean(data) as ocean:
        assert np.isnan(ocean.at(EAST[1], NORTH[3], 0.0, START)[0])
        assert np.isnan(ocean.at(EAST[8], NORTH[3], 10.0, START)[0])
        beside, expected = ocean.at(EAST[6], NORTH[3], 10.0, START), flow(EAST[6] - 0.005, NORTH[3], 10.0)
        np.testing.assert_allclose(beside[0], expected[0])
    check(data, EAST[4], NORTH[3], 10.0, 0.0)


def nemo(angle=0.5):
    """NEMO's data of each component and of the mesh, on a turned grid; its middles."""
    lon, lat = turned_grid(angle=angle)
    rows = [np.diff(axis, axis=1, append=2 * axis[:, -1:] - axis[:, -2:-1]) / 2 for axis in (lon, lat)]
    columns = [np.diff(axis, axis=0, append=2 * axis[-1:] - axis[-2:-1]) / 2 for axis in (lon, lat)]
    parts = []
    for name, kind, (right, up) in (("vozocrtx", "u", rows), ("vomecrty", "v", columns)):
        places, depth = (lon + right, lat + up), f"depth{kind}"
        east, north = (stated(*places, which) for which in (0, 1))
        along = {"u": east * np.cos(angle) + north * np.sin(angle),
                 "v": north * np.cos(angle) - east * np.sin(angle)}[kind]  # fmt: skip
        fields = {
            name: (("time_counter", depth, "y", "x"), along, SPEED),
            "nav_lon": (("y", "x"), places[0]),
            "nav_lat": (("y", "x"), places[1]),
        }
        axes = {
            "time_counter": ("time_counter", TIMES, HOURS),
            depth: (depth, DEPTH, {"units": "m", "positive": "down"}),
        }
        parts.append(xr.Dataset(fields, axes))
    wet = np.ones((1, 1, *lon.shape))
    wet[..., :2, :2] = 0
    mesh = {"tmask": (("t", "z", "y", "x"), wet)}
    mesh |= {name: (("t", "y", "x"), axis[None]) for name, axis in (("glamt", lon), ("gphit", lat))}
    return parts, xr.Dataset(mesh), lon, lat


def test_nemo_with_its_mesh_file():
    parts, mesh, lon, lat = nemo()
    with pytest.raises(
        CurrentError, match=r"nav_l.. differs, as on the edges of cells: name the model's mesh file"
    ):
        open_ocean(parts)
    assert expect([*parts, mesh], lon[3:7, 3:9].ravel(), lat[3:7, 3:9].ravel(), 2e-3).kind == "roms"
    with open_ocean([*parts, mesh]) as ocean:
        assert np.isnan(ocean.at(lon[0, 0], lat[0, 0], 0.0, START)[0])
