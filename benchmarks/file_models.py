"""The currents of ``benchmarks.files``, with another reading: real files, cuts of them, and made ones.

Those that are made follow the conventions of ocean models; the current that they stand for is a closed form.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import shapely
import xarray as xr
from pyproj import CRS, Proj
from scipy.spatial import Delaunay

from benchmarks import file_references
from benchmarks.file_references import Table, halves
from benchmarks.harness import SHARED
from tests.io.currents import samples
from tests.io.currents.samples import DEPTHS, LAT, LON, MERIDIANS, PARALLELS, START, STEP, TIMES

#: Files, and options of `open_ocean`.
Prepared = tuple[list[Path], dict[str, Any]]
#: The same, and the current.
Made = tuple[list[Path], dict[str, Any], Table]
Change = Callable[[xr.Dataset], xr.Dataset]
#: Paths, and new names of variables as `renamed`, to what an independent reading finds.
Reading = Callable[..., Table]


@dataclass(frozen=True)
class Currents:
    """Files of a current."""

    name: str
    model: str
    origin: str  # "real", "cut" (real, changed as the name says) or "made"
    # a folder to the files there, and the options of `open_ocean`
    prepare: Callable[[Path], Prepared]
    reading: Reading
    # names that mutations look at: east, north, longitude, latitude, depth, time
    variables: tuple[str, ...] = field(default=())


def table(lon: Any, lat: Any, depths: Any = DEPTHS, parts: Any = None, **more: Any) -> Table:
    """A current at points [P] and levels [K] or [1, K, P]: east and north [T, K, P], by default `flow`."""
    lon, lat, depth = np.ravel(lon), np.ravel(lat), np.asarray(depths, float)
    depth = depth[None, :, None] if depth.ndim == 1 else depth
    parts = samples.flow(lon, lat, depth, TIMES[:, None, None]) if parts is None else parts
    shape = (len(TIMES), depth.shape[1], lon.size)
    east, north = (np.where(np.isfinite(depth), np.reshape(part, shape), np.nan) for part in parts)
    return Table(lon, lat, depth, east, north, START + 3600.0 * TIMES, **more)


def save(path: Path, data: xr.Dataset, form: Any = "NETCDF4") -> Path:
    """Write variables and their attributes as they are."""
    plain = {
        name: {"_FillValue": None}
        for name, own in data.variables.items()
        if not {"_FillValue"} & {*own.attrs, *own.encoding}
    }
    data.reset_coords().to_netcdf(path, engine="netcdf4", format=form, encoding=plain)
    return path


def copied(*names: str, **options: Any) -> Callable[[Path], Prepared]:
    """Return what copies shared files to a folder, and states the options of `open_ocean` that they need."""
    return lambda folder: ([Path(shutil.copy(SHARED / name, folder)) for name in names], options)


def written(folder: Path, name: str, *parts: xr.Dataset, form: Any = "NETCDF4") -> list[Path]:
    """Write data sets, one of them by a name, more of them numbered."""
    names = [name] if len(parts) == 1 else [f"{name}{number}" for number in range(len(parts))]
    return [save(folder / f"{own}.nc", data, form) for own, data in zip(names, parts, strict=True)]


def regular_file(
    folder: Path, name: str, change: Change = lambda data: data, *, lon: Any = MERIDIANS,
    lat: Any = PARALLELS, middle: float = LON, form: str = "NETCDF4", pack: float | None = None,
) -> Made:  # fmt: skip
    """A regular grid, changed; packed into 16 bits where a step is given."""
    data = samples.regular(lon, lat, DEPTHS, TIMES, about=middle)
    if pack is not None:
        packed = {"dtype": "int16", "scale_factor": pack, "add_offset": 0.5, "_FillValue": -30000}
        data["uo"].encoding = data["vo"].encoding = packed
    places = np.meshgrid(lon, lat)
    data, rows = change(data), np.arange(places[0].size).reshape(places[0].shape)
    parts = samples.flow(
        samples.nearby(places[0], middle), places[1], DEPTHS[:, None, None], TIMES[:, None, None, None]
    )
    if pack is not None:
        parts = [np.rint((part - 0.5) / pack) * pack + 0.5 for part in parts]
    depths = DEPTHS if len([dim for dim in data.sizes if data.sizes[dim] > 1]) > 3 else DEPTHS[:1]
    known = table(*places, depths, [part[:, : len(depths)] for part in parts], rows=rows)
    return written(folder, name, data, form=form), {}, known


def spelt(units: str, factor: float, **standard: str) -> Change:
    """A change of the unit of speed, and of standard names."""

    def change(data: xr.Dataset) -> xr.Dataset:
        for name in ("uo", "vo"):
            stated = {"units": units} | ({"standard_name": standard[name]} if standard else {})
            data[name] = (data[name] * factor).assign_attrs(data[name].attrs | stated)
        return data

    return change


def axis(name: str, values: Any = None, **stated: Any) -> Change:
    def change(data: xr.Dataset) -> xr.Dataset:
        own = data[name].values if values is None else values
        return data.assign_coords({name: (name, own, data[name].attrs | stated)})

    return change


def inner(known: Table, shape: tuple[int, ...], beside: Any = False) -> Table:
    """The table without the rim of a grid, and without places beside land."""
    rim = np.ones(shape, bool)
    rim[1:-1, 1:-1] = False
    for part in (known.east, known.north):
        part[..., (rim | beside).ravel()] = np.nan
    return known


def nemo(folder: Path) -> Made:
    """NEMO: components and mesh in files of their own; cells at the rim and by land have one face only."""
    parts = samples.nemo()
    lon, lat = (parts[-1][name].values[0] for name in ("glamt", "gphit"))
    beside = np.zeros(lon.shape, bool)
    beside[:3, :3] = True
    known = table(lon, lat, triangles=halves(*lon.shape))
    return written(folder, "nemo", *parts), {}, inner(known, lon.shape, beside)


def c_grid(folder: Path, model: str) -> Made:
    """MOM6 and MITgcm."""
    known = table(*np.meshgrid(MERIDIANS, PARALLELS), triangles=halves(7, 9))
    return written(folder, model, samples.c_grid(model)), {}, inner(known, (7, 9))


def roms(folder: Path, name: str, transform: int, croco: bool = False) -> Made:
    """Native ROMS on a turned grid, or CROCO."""
    data, rise, critical = samples.roms(transform, croco=croco), 0.4, 20.0
    lon, lat, floor = (data[name].values for name in ("lon_rho", "lat_rho", "h"))
    own = data["s_rho"].values, data.attrs["Cs_rho"] if croco else data["Cs_r"].values
    s, curve = (part[:, None, None] for part in own)
    if transform == 2:
        depth = -(critical * s + floor * curve) / (critical + floor) * (floor + rise)
    else:
        still = critical * s + (floor - critical) * curve
        depth = -still - rise * still / floor
    parts = [(1.0 + s) * part for part in samples.flow(lon, lat, 0.0, TIMES[:, None, None, None])]
    known = table(lon, lat, depth.reshape(1, len(s), -1), parts, floor=(floor + rise).reshape(1, -1),
                  triangles=halves(*lon.shape))  # fmt: skip
    # A cell's value is the mean of its faces; those of the rim are other places' by half.
    return written(folder, name, data), {}, inner(known, lon.shape)


def pop(folder: Path) -> Made:
    data = samples.pop()
    lon, lat = data["ULONG"].values, data["ULAT"].values
    return written(folder, "pop", data), {}, table(lon, lat, triangles=halves(*lon.shape))


def in_cells(lon: np.ndarray, lat: np.ndarray, depths: Any, floor: float) -> Table:
    """`flow` at the middles of the cells of the mesh, linear between them."""
    *nodes, triangles = samples.mesh()
    cells = shapely.polygons(np.stack([axis[triangles] for axis in nodes], axis=-1))
    local = Proj(proj="aeqd", lon_0=LON, lat_0=LAT, datum="WGS84")
    between = Delaunay(np.stack(local(lon, lat), axis=1)).simplices
    return table(lon, lat, depths, floor=np.full((1, len(lon)), floor), triangles=between,
                 cells=np.asarray(cells, object))  # fmt: skip


def fvcom(folder: Path, name: str, crs: int | None = None) -> Made:
    """FVCOM, in degrees or in metres of a projection."""
    data = samples.fvcom(crs=crs)
    middle = [data[axis].values for axis in ("lonc", "latc")]
    if crs is not None:
        middle = Proj(f"EPSG:{crs}")(data["xc"].values, data["yc"].values, inverse=True)
    known = in_cells(*middle, 50.0 * np.array([0.1, 0.5, 0.9]), 50.0)
    return written(folder, name, data), {} if crs is None else {"crs": crs}, known


def dflow(folder: Path) -> Made:
    """D-Flow FM in three dimensions."""
    data = samples.dflow()
    middle = (data[f"mesh2d_face_{axis}"].values for axis in "xy")
    return written(folder, "dflow3d", data), {}, in_cells(*middle, 51.0 * np.array([0.1, 0.5, 0.9]), 51.0)


def nodes(folder: Path, model: str) -> Made:
    """FESOM, SELFE, SCHISM and UGRID, whose current is at the nodes of the mesh."""
    lon, lat, triangles = samples.mesh()
    data, depths, floor = samples.ugrid() if model == "ugrid" else samples.nodes(model), DEPTHS, None
    if model == "ugrid":
        parts = samples.flow(lon, lat, DEPTHS[:, None], TIMES[:, None, None])
        for name, part in zip(("ucx", "ucy"), parts, strict=True):
            data[name] = ("time", "depth", "n_node"), part, data[name].attrs
        data["depth"] = "depth", DEPTHS, samples.DOWN
    elif model == "selfe":
        floor = (data["h"].values + 2.0)[None]
        depths = -data["sigma"].values[::-1, None] * floor[:, None]
    elif model == "schism":
        depths = 0.5 - data["zcor"].values[:1].transpose(0, 2, 1)
    return written(folder, model, data), {}, table(lon, lat, depths, triangles=triangles, floor=floor)


def projected(folder: Path, name: str, crs: Any, x: np.ndarray, y: np.ndarray, kind: str) -> Made:
    """A grid along the axes of a projection or of a turned pole, without longitude and latitude."""
    system = CRS.from_user_input(crs)
    mapping = {key: value for key, value in system.to_cf().items() if kind != "cf" or key != "crs_wkt"}
    data, lon, lat, *parts = samples.projected(crs, x, y, mapping)
    return written(folder, name, data), {}, table(lon, lat, DEPTHS, parts, triangles=halves(*lon.shape))


def zarr_store(folder: Path) -> Made:
    paths, options, known = regular_file(folder, "for_zarr")
    with xr.open_dataset(paths[0], engine="netcdf4", decode_times=False) as data:
        data.load().drop_encoding().to_zarr(folder / "grid.zarr", consolidated=False)
    return [folder / "grid.zarr"], options, known


Maker = Callable[[Path], Made]
_LINE = np.array([179.96, 179.97, 179.98, 179.99, -180.0, -179.99, -179.98, -179.97, -179.96])
_SURFACE = {"uo": "surface_eastward_sea_water_velocity", "vo": "surface_northward_sea_water_velocity"}


def _hycom(data: xr.Dataset) -> xr.Dataset:
    names = {"uo": "water_u", "vo": "water_v", "longitude": "lon", "latitude": "lat"}
    return data.rename(names).assign(tau=("time", np.zeros(3), {"units": "hours since analysis"}))


def _radar(data: xr.Dataset) -> xr.Dataset:
    names = {"uo": "u", "vo": "v", "longitude": "lon", "latitude": "lat"}
    return spelt("cm/s", 100.0, **_SURFACE)(data.isel(depth=0, drop=True)).rename(names)


def _noleap(data: xr.Dataset) -> xr.Dataset:
    stated = {"units": "hours since 2000-01-01", "calendar": "noleap"}
    return axis("time", 365.0 * 20 * 24 + TIMES, **stated)(axis("depth", -DEPTHS, positive="up")(data))


#: (what the file is, the model, its maker).
MADE: tuple[tuple[str, str, Maker], ...] = (
    ("C-grid, u, v and mesh in files of their own, turned by 29 degrees", "NEMO", nemo),
    ("C-grid, symmetric", "MOM6", lambda folder: c_grid(folder, "mom6")),
    ("C-grid, XC, YC, XG, YG", "MITgcm", lambda folder: c_grid(folder, "mitgcm")),
    ("C-grid, Vtransform 1", "ROMS", lambda folder: roms(folder, "roms1", 1)),
    ("C-grid, parameters in attributes", "CROCO", lambda folder: roms(folder, "croco", 2, croco=True)),
    ("curvilinear, ANGLE, cm/s, depths in cm", "POP", pop),
    ("combined output: hvel, zcor, elev", "SCHISM", lambda folder: nodes(folder, "schism")),
    ("sigma levels at nodes", "SELFE", lambda folder: nodes(folder, "selfe")),
    ("unod, vnod at nodes, 1-based triangles", "FESOM", lambda folder: nodes(folder, "fesom")),
    ("UGRID at nodes, levels in m", "UGRID", lambda folder: nodes(folder, "ugrid")),
    ("cells in degrees, sigma levels", "FVCOM", lambda folder: fvcom(folder, "fvcom")),
    ("cells in metres of UTM 32N", "FVCOM", lambda folder: fvcom(folder, "fvcom_metres", 32632)),
    ("cells, sigma layers, bed as altitude", "D-Flow FM", dflow),
    ("metres of UTM 31N alone", "CF", lambda folder: projected(
        folder, "utm", 32631, 600_000.0 + 500.0 * np.arange(9), 6_650_000.0 + 500.0 * np.arange(7), "wkt")),
    ("polar stereographic by CF's attributes", "CF", lambda folder: projected(
        folder, "polar", "+proj=stere +lat_0=90 +lat_ts=60 +lon_0=70 +datum=WGS84",
        -2_000_000.0 + 800.0 * np.arange(9), 1_000_000.0 + 800.0 * np.arange(7), "cf")),
    ("turned pole", "CF (COSMO, HIRHAM)", lambda folder: projected(
        folder, "rotated", CRS.from_cf({"grid_mapping_name": "rotated_latitude_longitude",
                                        "grid_north_pole_latitude": 40.0,
                                        "grid_north_pole_longitude": -170.0}),
        -3.0 + 0.02 * np.arange(9), 9.0 + 0.02 * np.arange(7), "cf")),
    ("packed int16, longitudes 0 to 360, tau", "HYCOM", lambda folder: regular_file(
        folder, "hycom", _hycom, lon=300.0 + STEP * np.arange(9), middle=-60.0, pack=1e-4)),
    ("calendar gregorian_proleptic, falling latitudes", "CF", lambda folder: regular_file(
        folder, "proleptic", axis("time", calendar="gregorian_proleptic"), lat=PARALLELS[::-1])),
    ("calendar noleap, depths negative up", "CF", lambda folder: regular_file(folder, "noleap", _noleap)),
    ("calendar julian", "CF", lambda folder: regular_file(
        folder, "julian", axis("time", units="hours since 2019-12-19", calendar="julian"))),
    ("knots, NetCDF-3", "CF", lambda folder: regular_file(
        folder, "knots", spelt("knots", 3600.0 / 1852.0), form="NETCDF3_CLASSIC")),
    ("across the date line", "CF", lambda folder: regular_file(folder, "line", lon=_LINE, middle=179.96)),
    ("surface only, cm/s", "HF radar", lambda folder: regular_file(folder, "radar", _radar)),
    ("Zarr folder", "CF", zarr_store),
)  # fmt: skip


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
        fields = {name: (dims, speed.astype(np.float32), stated), "time": ("time", times, {"units": clock})}
        paths.append(save(folder / f"{name}.nc", xr.Dataset(fields)))
    return paths, {"crs": 26910}


_CMEMS = "currents/cmems_glo12_uo_vo_northsea.nc"
_NORKYST = "currents/norkyst_v3_800m_5h.nc"
_ARCTIC = "elsewhere/arctic20_polar_stereographic.nc"
_FJORD = "currents/norfjords160_roms_native_24h.nc"
_UO = "uo vo longitude latitude time"
_EPOCH = {"epoch": datetime(1970, 1, 1, tzinfo=UTC)}

_ROMS = "u", "v", "lon_rho", "lat_rho", "s_rho", "ocean_time"


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
             copied("elsewhere/nordic_roms_native_day1.nc", "elsewhere/nordic_roms_native_day2.nc"),
             lambda paths, **more: file_references.joined(
                 [file_references.roms([path], **more) for path in paths]), _ROMS),
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
    found = []
    for name, model, maker in MADE:
        paths, options, known = maker(folder)
        given, reading = (lambda _, given=(paths, options): given), (lambda *_, known=known, **__: known)
        found.append(Currents(name, model, "made", given, reading))
    return found
