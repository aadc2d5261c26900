"""Components on the edges of cells, in the forms of NEMO, MOM6 and MITgcm."""

import numpy as np
import pytest
import xarray as xr

from auvplan.io.currents import open_ocean
from auvplan.ocean.gridded import CurrentError
from tests.io.currents.samples import HOURS, LAT, LON, START, flow, turned_grid, write

STEP = 0.01
#: Middles of 7 x 9 cells.
EAST, NORTH = LON + STEP * np.arange(9), LAT + STEP * np.arange(7)
DEPTH, TIMES = np.array([0.0, 10.0, 30.0]), np.array([0.0, 1.0])
SPEED = {"units": "m/s"}


def stated(lon, lat, which):
    """One component [T, K, ...] of `flow` at places."""
    shape = (-1, *(1,) * (1 + np.ndim(lon)))
    hours, depths = TIMES.reshape(shape), DEPTH.reshape((1, -1, *(1,) * np.ndim(lon)))
    return flow(lon, lat, depths, hours)[which]


def axes():
    return {
        "time": ("time", TIMES, HOURS),
        "depth": ("depth", DEPTH, {"units": "m", "positive": "down", "standard_name": "depth"}),
    }


def expect(ocean, lon, lat, atol=1e-6):
    """The current amid the cells is `flow`."""
    for depth, hour in ((0.0, 0.0), (7.0, 0.5), (25.0, 1.0)):
        found = ocean.at(lon, lat, depth, START + 3600.0 * hour)
        np.testing.assert_allclose(found[:2], flow(lon, lat, depth, hour), atol=atol)


@pytest.mark.parametrize("symmetric", [True, False])
def test_mom6(tmp_path, symmetric):
    more = [-0.5] if symmetric else []
    xq, yq = (
        LON + STEP * np.append(more, np.arange(9) + 0.5),
        LAT + STEP * np.append(more, np.arange(7) + 0.5),
    )
    east, north = (*np.meshgrid(xq, NORTH),), (*np.meshgrid(EAST, yq),)
    degrees = {"x": {"units": "degrees_east"}, "y": {"units": "degrees_north"}}
    along = [SPEED | {"standard_name": f"sea_water_{axis}_velocity"} for axis in "xy"]
    data = xr.Dataset(
        {
            "uo": (("time", "depth", "yh", "xq"), stated(*east, 0), along[0]),
            "vo": (("time", "depth", "yq", "xh"), stated(*north, 1), along[1]),
        },
        axes()
        | {"xh": ("xh", EAST, degrees["x"]), "yh": ("yh", NORTH, degrees["y"])}
        | {"xq": ("xq", xq, degrees["x"]), "yq": ("yq", yq, degrees["y"])},
    )
    with open_ocean(write(data, tmp_path / "mom6.nc")) as ocean:
        assert ocean.kind == "roms"
        expect(ocean, LON + STEP * np.array([1.0, 2.3, 6.5]), LAT + STEP * np.array([1.0, 3.6, 4.2]), 2e-5)


def test_mitgcm(tmp_path):
    """Edges lie west and south of the middles of the same index."""
    east, north = (*np.meshgrid(EAST - STEP / 2, NORTH),), (*np.meshgrid(EAST, NORTH - STEP / 2),)
    data = xr.Dataset(
        {
            "UVEL": (("time", "depth", "YC", "XG"), stated(*east, 0), SPEED),
            "VVEL": (("time", "depth", "YG", "XC"), stated(*north, 1), SPEED),
        },
        axes()
        | {"XC": ("XC", EAST, {"units": "degrees_east"}), "YC": ("YC", NORTH, {"units": "degrees_north"})}
        | {"XG": ("XG", EAST - STEP / 2), "YG": ("YG", NORTH - STEP / 2)},
    )
    with open_ocean(write(data, tmp_path / "mit.nc")) as ocean:
        expect(ocean, LON + STEP * np.array([1.0, 2.3, 6.5]), LAT + STEP * np.array([1.0, 3.6, 4.2]), 2e-5)
    lost = data.isel(XG=slice(0, 5))
    with pytest.raises(CurrentError, match="5 edges along XG do not fit 9 middles along XC"):
        open_ocean(write(lost, tmp_path / "lost.nc"))


def nemo(folder, angle=0.5):
    """NEMO's files of each component and of the mesh, on a turned grid."""
    lon, lat = turned_grid(angle=angle)
    rows = [np.diff(axis, axis=1, append=2 * axis[:, -1:] - axis[:, -2:-1]) / 2 for axis in (lon, lat)]
    columns = [np.diff(axis, axis=0, append=2 * axis[-1:] - axis[-2:-1]) / 2 for axis in (lon, lat)]
    places = {"u": [axis + half for axis, half in zip((lon, lat), rows, strict=True)]}
    places["v"] = [axis + half for axis, half in zip((lon, lat), columns, strict=True)]
    paths = []
    for name, kind, sign in (("vozocrtx", "u", 1.0), ("vomecrty", "v", -1.0)):
        parts = [stated(*places[kind], which) for which in (0, 1)]
        along = parts[0] * np.cos(angle) + parts[1] * np.sin(angle)
        across = parts[1] * np.cos(angle) - parts[0] * np.sin(angle)
        depth = f"depth{kind}"
        data = xr.Dataset(
            {
                name: (("time_counter", depth, "y", "x"), along if sign > 0 else across, SPEED),
                "nav_lon": (("y", "x"), places[kind][0]),
                "nav_lat": (("y", "x"), places[kind][1]),
            },
            {
                "time_counter": ("time_counter", TIMES, HOURS),
                depth: (depth, DEPTH, {"units": "m", "positive": "down"}),
            },
        )
        paths.append(write(data, folder / f"grid_{kind}.nc"))
    dims = ("t", "y", "x")
    wet = np.ones((1, *lon.shape))
    wet[0, :2, :2] = 0
    mesh = {
        "glamt": (dims, lon[None]),
        "gphit": (dims, lat[None]),
        "tmask": (("t", "z", "y", "x"), wet[None]),
    }
    return paths, write(xr.Dataset(mesh), folder / "mesh_mask.nc"), lon, lat


def test_nemo_with_its_mesh_file(tmp_path):
    paths, mesh, lon, lat = nemo(tmp_path)
    with pytest.raises(
        CurrentError, match=r"nav_l.. differs, as on the edges of cells: name the model's mesh file"
    ):
        open_ocean(paths)
    with open_ocean([*paths, mesh]) as ocean:
        assert ocean.kind == "roms"
        expect(ocean, lon[3:7, 3:9].ravel(), lat[3:7, 3:9].ravel(), 2e-3)
        assert np.isnan(ocean.at(lon[0, 0], lat[0, 0], 0.0, START)[0])
