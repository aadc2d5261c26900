"""Small files by the conventions of ocean models, with the current that they stand for in closed form."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import shapely
import xarray as xr
from pyproj import CRS, Proj
from scipy.spatial import Delaunay

from benchmarks.file_references import Table, halves
from benchmarks.harness import SHARED
from tests.io.currents import samples
from tests.io.currents.samples import DEPTHS, LAT, LON, MERIDIANS, PARALLELS, START, STEP, TIMES

#: Files, and options of `open_ocean`.
Prepared = tuple[list[Path], dict[str, Any]]
#: The same, and the current.
Made = tuple[list[Path], dict[str, Any], Table]
Change = Callable[[xr.Dataset], xr.Dataset]


def table(lon: Any, lat: Any, depths: Any = DEPTHS, parts: Any = None, **more: Any) -> Table:
    """A current at points [P] and levels [K] or [1, K, P]: east and north [T, K, P], by default `flow`."""
    lon, lat, depth = np.ravel(lon), np.ravel(lat), np.asarray(depths, float)
    depth = depth[None, :, None] if depth.ndim == 1 else depth
    parts = samples.flow(lon, lat, depth, TIMES[:, None, None]) if parts is None else parts
    shape = (len(TIMES), depth.shape[1], lon.size)
    east, north = (np.where(np.isfinite(depth), np.reshape(part, shape), np.nan) for part in parts)
    return Table(lon, lat, depth, east, north, START + 3600.0 * TIMES, **more)


def save(path: Path, variables: dict[str, tuple], form: Any = "NETCDF4", **attributes: Any) -> Path:
    """Write variables (dimensions, values, attributes) as they are; `_FillValue` among the attributes."""
    with netCDF4.Dataset(str(path), "w", format=form) as file:
        for dims, values, _ in variables.values():
            for dim, size in zip(dims, np.shape(values), strict=True):
                if dim not in file.dimensions:
                    file.createDimension(dim, size)
        for name, (dims, values, about) in variables.items():
            values = np.asarray(values)
            fill = about.get("_FillValue")
            variable = file.createVariable(name, values.dtype, dims, fill_value=fill)
            variable.set_auto_maskandscale(False)
            variable.setncatts({key: value for key, value in about.items() if key != "_FillValue"})
            variable[...] = values
        file.setncatts(attributes)
    return path


def copied(*names: str, **options: Any) -> Callable[[Path], Prepared]:
    """Return what copies shared files to a folder, and states the options of `open_ocean` that they need."""
    return lambda folder: ([Path(shutil.copy(SHARED / name, folder)) for name in names], options)


def written(folder: Path, name: str, *parts: xr.Dataset, form: Any = "NETCDF4") -> list[Path]:
    """Write data sets, one of them by a name, more of them numbered."""
    paths = []
    for number, data in enumerate(parts):
        path = folder / (f"{name}.nc" if len(parts) == 1 else f"{name}{number}.nc")
        fields = {str(key): (own.dims, own.values, own.attrs) for key, own in data.variables.items()}
        paths.append(save(path, fields, form, **data.attrs))
    return paths


def regular_file(
    folder: Path, name: str, change: Change = lambda data: data, *, lon: Any = MERIDIANS,
    lat: Any = PARALLELS, middle: float = LON, form: str = "NETCDF4", pack: float | None = None,
) -> Made:  # fmt: skip
    """A regular grid, changed; packed into 16 bits where a step is given."""
    data = samples.regular(lon, lat, DEPTHS, TIMES, about=middle)
    if pack is not None:
        for own in ("uo", "vo"):
            whole = np.rint((data[own].values - 0.5) / pack).astype(np.int16)
            stated = data[own].attrs | {
                "scale_factor": pack,
                "add_offset": 0.5,
                "_FillValue": np.int16(-30000),
            }
            data[own] = data[own].dims, whole, stated
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
    """A change of the values of an axis, and of its attributes."""

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
    """POP."""
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
