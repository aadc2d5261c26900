"""The currents of ``benchmarks.files``: real files, cuts of them, and made ones, with another reading."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from benchmarks import file_models, file_references
from benchmarks.file_models import Prepared, copied
from benchmarks.file_references import Table
from benchmarks.harness import SHARED

Reading = Callable[..., Table]


@dataclass(frozen=True)
class Currents:
    """Files of a current."""

    name: str
    model: str
    origin: str  # "real", "cut" (real, changed as the name says) or "made"
    # a folder to the files there, and the options of `open_ocean`
    prepare: Callable[[Path], Prepared]
    reading: Reading  # paths, and new names of variables as `renamed`, to what an independent reading finds
    # names that mutations look at: east, north, longitude, latitude, depth, time
    variables: tuple[str, ...] = field(default=())


def _changed(name: str, change: Callable[[xr.Dataset], xr.Dataset], form: Any = "NETCDF4") -> Any:
    def prepare(folder: Path) -> Prepared:
        with xr.open_dataset(SHARED / name, engine="netcdf4", decode_cf=False) as data:
            path = folder / f"cut_{Path(name).stem}.nc"
            change(data).to_netcdf(path, engine="netcdf4", format=form)
        return [path], {}

    return prepare


def _schism(folder: Path) -> Prepared:
    """The real mesh and levels, with velocities on them, which the real output lacks."""
    names = ("elsewhere/schism_out2d_1.nc", "elsewhere/schism_zCoordinates_1.nc")
    paths, _ = copied(*names)(folder)
    with netCDF4.Dataset(str(paths[1])) as data:
        variable = data["zCoordinates"]
        height = np.ma.filled(variable[...].astype(float), np.nan)
        dims, times, clock = variable.dimensions, data["time"][...], data["time"].units
    for k, name in enumerate(("horizontalVelX", "horizontalVelY")):
        speed = (0.3 - 0.5 * k) * (1.0 + 0.01 * height + 0.001 * np.arange(height.shape[1])[None, :, None])
        stated = {"mesh": "SCHISM_hgrid", "location": "node"}
        fields = {
            name: (dims, speed.astype(np.float32), stated),
            "time": (("time",), times, {"units": clock}),
        }
        paths.append(file_models.save(folder / f"{name}.nc", fields))
    return paths, {"crs": 26910}


_CMEMS = "currents/cmems_glo12_uo_vo_northsea.nc"
_NORKYST = "currents/norkyst_v3_800m_5h.nc"
_ARCTIC = "elsewhere/arctic20_polar_stereographic.nc"
_FJORD = "currents/norfjords160_roms_native_24h.nc"
_UO = "uo vo longitude latitude time"
_EPOCH = {"epoch": datetime(1970, 1, 1, tzinfo=UTC)}

_ROMS = "u", "v", "lon_rho", "lat_rho", "s_rho", "ocean_time"


def _days(paths: Sequence[Path], **options: Any) -> Table:
    return file_references.joined([file_references.roms([path], **options) for path in paths])


def _grid(names: str, depth: str | None = "depth", **options: Any) -> tuple[Reading, tuple[str, ...]]:
    """The reading of a grid, and the variables that it looks at."""
    *places, time = names.split()
    reading = partial(file_references.grid, names=names.split(), depth=depth, **options)
    return reading, (*places, depth or "", time)


def _mesh(names: str, heights: str | None = None, **options: Any) -> tuple[Reading, tuple[str, ...]]:
    *places, time = names.split()
    reading = partial(file_references.mesh, names=names.split(), heights=heights, **options)
    return reading, (*places, heights or "", time)


REAL = (
    Currents("norfjords160_roms_native_24h.nc", "ROMS, C-grid", "real", copied(_FJORD), file_references.roms,
             _ROMS),
    Currents("norkyst_v3_800m_5h.nc", "NorKyst (ROMS on z-levels)", "real", copied(_NORKYST),
             *_grid("u_eastward v_northward lon lat time", floor="h")),
    Currents("cmems_glo12_uo_vo_northsea.nc", "Copernicus GLO12", "real", copied(_CMEMS), *_grid(_UO)),
    Currents("rtofs_water_u_v_washington_64x3h.nc", "RTOFS (HYCOM)", "real",
             copied("currents/rtofs_water_u_v_washington_64x3h.nc"),
             *_grid("water_u water_v lon lat time", depth=None)),
    Currents("creofs_selfe_noaa.nc", "SELFE", "real", copied("elsewhere/creofs_selfe_noaa.nc"),
             *_mesh("u v lon lat time", nodes=("lon", "lat"), connectivity="ele", heights="zval")),
    Currents("nordic_roms_native_day1.nc, _day2.nc", "ROMS, cut by one range on all axes", "real",
             copied("elsewhere/nordic_roms_native_day1.nc", "elsewhere/nordic_roms_native_day2.nc"), _days,
             _ROMS),
    Currents("arctic20_polar_stereographic.nc", "ROMS on z-levels, along x and y", "real", copied(_ARCTIC),
             *_grid("u v longitude latitude time", floor="h", angle=file_references.polar)),
    Currents("schism_out2d_1.nc, schism_zCoordinates_1.nc", "SCHISM scribed (velocities made)", "real",
             _schism, *_mesh("horizontalVelX horizontalVelY SCHISM_hgrid_node_x SCHISM_hgrid_node_y time",
                             nodes=("SCHISM_hgrid_node_x", "SCHISM_hgrid_node_y"), heights="zCoordinates",
                             connectivity="SCHISM_hgrid_face_nodes", dry="dryFlagNode", crs=26910)),
    Currents("mom5_access_om2_u.nc, _v.nc", "MOM5, B-grid, NOLEAP", "real",
             copied("elsewhere/mom5_access_om2_u.nc", "elsewhere/mom5_access_om2_v.nc"),
             *_grid("u v xu_ocean yu_ocean time", depth="st_ocean")),
    Currents("dflowfm_simplebox_projected.nc", "D-Flow FM, UGRID in metres", "real",
             copied("elsewhere/dflowfm_simplebox_projected.nc"),
             *_mesh("mesh2d_ucx mesh2d_ucy mesh2d_face_x mesh2d_face_y time",
                    nodes=("mesh2d_node_x", "mesh2d_node_y"), connectivity="mesh2d_face_nodes", in_cells=True,
                    crs=28992)),
    Currents("roms_separate_his.nc, roms_separate_grid.nc", "ROMS, grid in another file, no dates", "real",
             copied("elsewhere/roms_separate_his.nc", "elsewhere/roms_separate_grid.nc", **_EPOCH),
             partial(file_references.roms, epoch=0.0, aligned=True), _ROMS),
    Currents("ngofs_fvcom_small.nc", "FVCOM, two-dimensional", "real",
             copied("elsewhere/ngofs_fvcom_small.nc"),
             *_mesh("u v lonc latc time", nodes=("lon", "lat"), connectivity="nv", in_cells=True)),
)  # fmt: skip

CUTS = (
    Currents("cmems_glo12, longitudes + 360, NetCDF-3", "Copernicus GLO12", "cut",
             _changed(_CMEMS, lambda data: data.assign_coords(longitude=(
                 "longitude", data["longitude"].values + 360.0, data["longitude"].attrs)), "NETCDF3_64BIT"),
             *_grid(_UO)),
    Currents("cmems_glo12, dimensions transposed, depths and latitudes falling", "Copernicus GLO12", "cut",
             _changed(_CMEMS, lambda data: data.isel(
                 depth=slice(None, None, -1), latitude=slice(None, None, -1)).transpose(
                 "longitude", "depth", "latitude", "time")), *_grid(_UO)),
    Currents("norkyst_v3 without longitude and latitude", "NorKyst", "cut",
             _changed(_NORKYST, lambda data: _bare(data, ("lon", "lat"))),
             lambda paths, **more: file_references.grid(
                 [*paths, SHARED / _NORKYST], ["u_eastward", "v_northward", "lon", "lat", "time"], floor="h",
                 **more)),
    Currents("norfjords160, cells 2 to 8 by 3 to 13", "ROMS, C-grid", "cut",
             _changed(_FJORD, lambda data: data.isel(
                 eta_rho=slice(2, 9), xi_rho=slice(3, 14), eta_u=slice(2, 9), xi_u=slice(3, 13),
                 eta_v=slice(2, 8), xi_v=slice(3, 14))), file_references.roms),
)  # fmt: skip


def _bare(data: xr.Dataset, names: tuple[str, str]) -> xr.Dataset:
    data = data.drop_vars(names)
    for variable in data.variables.values():
        variable.attrs.pop("coordinates", None)
    return data


def made(folder: Path) -> list[Currents]:
    """The made files, written once into a folder."""
    found = []
    for name, model, maker in file_models.MADE:
        paths, options, known = maker(folder)
        given, reading = (lambda _, given=(paths, options): given), (lambda *_, known=known, **__: known)
        found.append(Currents(name, model, "made", given, reading))
    return found
