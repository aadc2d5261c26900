"""Small files by the conventions of ocean models, with the current that they stand for in closed form."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from pyproj import CRS, Proj, Transformer
from scipy.spatial import Delaunay

from benchmarks.file_references import Table, halves

LON, LAT, STEP = 5.0, 60.0, 0.01
MERIDIANS, PARALLELS = LON + STEP * np.arange(9), LAT + STEP * np.arange(7)
#: 2020-01-01 in s since 1970.
START = 1577836800.0
HOURS = np.array([0.0, 1.0, 3.0])
DEPTHS = np.array([0.0, 10.0, 30.0])
CLOCK = {"units": "hours since 2020-01-01 00:00:00", "standard_name": "time"}
DOWN = {"units": "m", "positive": "down", "standard_name": "depth"}
EAST = {"units": "m s-1", "standard_name": "eastward_sea_water_velocity"}
NORTH = {"units": "m s-1", "standard_name": "northward_sea_water_velocity"}
ALONG_X = {"units": "m s-1", "standard_name": "sea_water_x_velocity"}
ALONG_Y = {"units": "m s-1", "standard_name": "sea_water_y_velocity"}
DEGREES_EAST, DEGREES_NORTH = {"units": "degrees_east"}, {"units": "degrees_north"}

#: Variables that many files have: the time, levels, and places in degrees.
TIMES = {"time": (("time",), HOURS, CLOCK)}
LEVELS = {"depth": (("depth",), DEPTHS, DOWN)}
LONGITUDE = {"standard_name": "longitude"} | DEGREES_EAST
LATITUDE = {"standard_name": "latitude"} | DEGREES_NORTH

#: Files, options of `open_ocean`, and the current.
Made = tuple[list[Path], dict[str, Any], Table]


def flow(lon: Any, lat: Any, depth: Any = 0.0, hour: Any = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Eastward and northward m/s: linear in all, another in each direction."""
    x, y, shade = np.asarray(lon) - LON, np.asarray(lat) - LAT, 1.0 - 0.01 * np.asarray(depth)
    return (0.3 + 2.0 * x - y) * shade + 0.01 * hour, (-0.2 + x + 3.0 * y) * shade - 0.02 * hour


def table(
    lon: Any, lat: Any, depths: Any = DEPTHS, hours: Any = HOURS, about: float = LON, **more: Any
) -> Table:
    """`flow` at points [P], levels [K] or [T, K, P] and hours, as if LON were at longitude `about`."""
    depth = np.asarray(depths, float)
    depth = depth[None, :, None] if depth.ndim == 1 else depth
    near = LON + (np.asarray(lon) - about + 180.0) % 360.0 - 180.0
    east, north = flow(near, lat, depth, np.asarray(hours)[:, None, None])
    shape = (len(hours), depth.shape[1], np.size(lon))
    parts = [np.where(np.isfinite(depth), np.broadcast_to(part, shape), np.nan) for part in (east, north)]
    return Table(np.ravel(lon), np.ravel(lat), depth, *parts, START + 3600.0 * np.asarray(hours), **more)


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


def regular_file(
    folder: Path, name: str, *, lon: np.ndarray = MERIDIANS, lat: np.ndarray = PARALLELS,
    names: tuple[str, ...] = ("uo", "vo", "longitude", "latitude", "depth", "time"),
    about: tuple[dict, dict] = (EAST, NORTH), clock: dict = CLOCK, times: Any = HOURS,
    levels: tuple[Any, dict] | None = (DEPTHS, DOWN), middle: float = LON, packed: float | None = None,
    factor: float = 1.0, form: str = "NETCDF4", more: dict | None = None,
) -> Made:  # fmt: skip
    places = np.meshgrid(lon, lat)
    rows = np.arange(places[0].size).reshape(places[0].shape)
    known = table(*map(np.ravel, places), DEPTHS if levels else np.zeros(1), about=middle, rows=rows)
    shape = (len(HOURS), *((3,) if levels else ()), len(lat), len(lon))
    u, v, x, y, z, t = names
    dims = (t, *((z,) if levels else ()), y, x)
    fields: dict[str, tuple] = {}
    for field, part, stated in ((u, known.east, about[0]), (v, known.north, about[1])):
        values = part.reshape(shape) * factor
        if packed is None:
            fields[field] = dims, values, stated
        else:
            pack = {"scale_factor": packed, "add_offset": 0.5, "_FillValue": np.int16(-30000)}
            fields[field] = dims, np.rint((values - 0.5) / packed).astype(np.int16), stated | pack
    if packed is not None:
        exact = [fields[f][1].astype(float) * packed + 0.5 for f in (u, v)]
        east, north = (part.reshape(known.east.shape) / factor for part in exact)
        known = replace(known, east=east, north=north)
    fields |= {
        x: ((x,), lon, DEGREES_EAST),
        y: ((y,), lat, DEGREES_NORTH),
        t: ((t,), np.asarray(times), clock),
    }
    if levels:
        fields[z] = (z,), levels[0], levels[1]
    return [save(folder / f"{name}.nc", fields | (more or {}), form)], {}, known


def turned_grid(
    rows: float = 8, columns: float = 10, right: float = 0.0, up: float = 0.0
) -> tuple[np.ndarray, ...]:
    """Longitude, latitude and angle [rows, columns] of a grid whose rows head some 29 degrees north of east.

    The angle, rad, is from east to the rows, counter-clockwise. `right` and `up` move all by shares of cells.
    """
    j, i = np.meshgrid(np.arange(rows) + up, np.arange(columns) + right, indexing="ij")
    x, y = i * np.cos(0.5) - j * np.sin(0.5), i * np.sin(0.5) + j * np.cos(0.5)
    local = Proj(proj="aeqd", lon_0=LON, lat_0=LAT, datum="WGS84")
    lon, lat = (np.asarray(axis) for axis in local(450.0 * x, 450.0 * y, inverse=True))
    return lon, lat, 0.5 - np.deg2rad(local.get_factors(lon, lat).meridian_convergence)


def along(east: np.ndarray, north: np.ndarray, angle: Any) -> tuple[np.ndarray, np.ndarray]:
    """Components along axes turned by an angle from east."""
    both = (east + 1j * north) * np.exp(-1j * angle)
    return both.real, both.imag


def component(which: int, lon: np.ndarray, lat: np.ndarray, angle: Any = 0.0) -> np.ndarray:
    """[T, K, *places] m/s along one of two axes turned by an angle."""
    ones = (1,) * np.ndim(lon)
    parts = flow(lon, lat, DEPTHS.reshape(1, -1, *ones), HOURS.reshape(-1, 1, *ones))
    return along(*parts, angle)[which]


def inner(known: Table, shape: tuple[int, int], beside: Any = False) -> Table:
    """The table without the rim of a grid, and without places beside land."""
    rim = np.ones(shape, bool)
    rim[1:-1, 1:-1] = False
    for part in (known.east, known.north):
        part[..., (rim | beside).ravel()] = np.nan
    return known


def nemo(folder: Path) -> Made:
    """NEMO: u and v east and north of the middle with the same index, in files of their own; its mesh."""
    lon, lat, _ = turned_grid()
    size, paths = lon.shape, []
    for k, (name, kind) in enumerate((("vozocrtx", "u"), ("vomecrty", "v"))):
        x, y, angle = turned_grid(right=0.5 * (k == 0), up=0.5 * (k == 1))
        fields = {
            name: (("time_counter", f"depth{kind}", "y", "x"), component(k, x, y, angle), {"units": "m/s"}),
            "nav_lon": (("y", "x"), x, {}),
            "nav_lat": (("y", "x"), y, {}),
            "time_counter": (("time_counter",), HOURS, CLOCK),
            f"depth{kind}": ((f"depth{kind}",), DEPTHS, {"units": "m", "positive": "down"}),
        }
        paths.append(save(folder / f"nemo_grid_{kind}.nc", fields))
    wet = np.ones((1, 1, *size))
    wet[..., :2, :2] = 0
    dims = ("t", "y", "x")
    fields = {"glamt": (dims, lon[None], {}), "gphit": (dims, lat[None], {}),
              "tmask": (("t", "z", "y", "x"), wet, {})}  # fmt: skip
    paths.append(save(folder / "nemo_mesh_mask.nc", fields))
    known = table(lon.ravel(), lat.ravel(), triangles=halves(*size))
    # The outer cells have one face only; land and what is beside it have none.
    beside = np.zeros(size, bool)
    beside[:3, :3] = True
    return paths, {}, inner(known, size, beside)


def c_grid(folder: Path, model: str) -> Made:
    """MOM6 (symmetric, edges also outside) and MITgcm (edges west and south of the middle)."""
    lon, lat = MERIDIANS, PARALLELS
    if model == "mom6":
        x, y = (np.append(axis[0] - STEP / 2, axis + STEP / 2) for axis in (lon, lat))
        names, units = ("uo", "vo", "xh", "yh", "xq", "yq"), (ALONG_X, ALONG_Y)
    else:
        x, y = lon - STEP / 2, lat - STEP / 2
        names, units = ("UVEL", "VVEL", "XC", "YC", "XG", "YG"), ({"units": "m/s"}, {"units": "m/s"})
    u, v, east, north, edge_x, edge_y = names
    fields = {
        u: (("time", "depth", north, edge_x), component(0, *np.meshgrid(x, lat)), units[0]),
        v: (("time", "depth", edge_y, east), component(1, *np.meshgrid(lon, y)), units[1]),
        east: ((east,), lon, DEGREES_EAST),
        north: ((north,), lat, DEGREES_NORTH),
        edge_x: ((edge_x,), x, DEGREES_EAST),
        edge_y: ((edge_y,), y, DEGREES_NORTH),
    }
    places = np.meshgrid(lon, lat)
    known = table(places[0].ravel(), places[1].ravel(), triangles=halves(7, 9))
    return [save(folder / f"{model}.nc", fields | TIMES | LEVELS)], {}, inner(known, (7, 9))


def roms(folder: Path, name: str, transform: int, croco: bool = False) -> Made:
    """Native ROMS on a turned grid, or CROCO, whose parameters are attributes of the file."""
    levels, rise, critical = 6, 0.4, 20.0
    lon, lat, angle = turned_grid()
    rows, columns = lon.shape
    floor = 40.0 + 3.0 * np.arange(columns) + 2.0 * np.arange(rows)[:, None]
    s = (np.arange(levels) + 0.5) / levels - 1.0
    curve = (1 - np.cosh(2.0 * s)) / (np.cosh(2.0) - 1)
    shape = (len(HOURS), levels, rows, columns)
    hour, shade = HOURS[:, None, None, None], (1.0 + s)[None, :, None, None]
    parts = [part * shade for part in flow(lon, lat, 0.0, hour)]
    turned = along(*np.broadcast_arrays(*parts), angle)
    u, v = (
        (turned[0][..., 1:] + turned[0][..., :-1]) / 2,
        (turned[1][..., 1:, :] + turned[1][..., :-1, :]) / 2,
    )
    rho, level = ("eta_rho", "xi_rho"), ("time" if croco else "ocean_time", "s_rho")
    fields = {
        "u": ((*level, "eta_rho" if croco else "eta_u", "xi_u"), u, {"units": "meter second-1"}),
        "v": ((*level, "eta_v", "xi_rho" if croco else "xi_v"), v, {"units": "meter second-1"}),
        "zeta": ((level[0], *rho), np.full((len(HOURS), rows, columns), rise), {"units": "meter"}),
        "h": (rho, floor, {"units": "meter"}),
        "mask_rho": (rho, np.ones((rows, columns)), {}),
        "angle": (rho, angle, {"units": "radians"}),
        "lon_rho": (rho, lon, {"units": "degree_east"}),
        "lat_rho": (rho, lat, {"units": "degree_north"}),
        level[0]: ((level[0],), HOURS, CLOCK),
    }
    stated: dict[str, Any] = {}
    if croco:
        stated = {"Cs_rho": curve, "sc_r": s, "hc": critical, "VertCoordType": "NEW"}
        fields["s_rho"] = ("s_rho",), s, {"standard_name": "ocean_s_coordinate_g2", "positive": "up"}
    else:
        fields |= {"s_rho": (("s_rho",), s, {}), "Cs_r": (("s_rho",), curve, {}), "hc": ((), critical, {}),
                   "Vtransform": ((), np.int32(transform), {})}  # fmt: skip
    s, curve = s[:, None, None], curve[:, None, None]
    if transform == 2:
        depth = -(critical * s + floor * curve) / (critical + floor) * (floor + rise)
    else:
        still = critical * s + (floor - critical) * curve
        depth = -still - rise * still / floor
    east, north = (np.broadcast_to(part, shape).reshape(*shape[:2], -1).copy() for part in parts)
    known = Table(
        lon.ravel(), lat.ravel(), depth.reshape(1, levels, -1), east, north, START + 3600.0 * HOURS,
        (floor + rise).reshape(1, -1), None, halves(rows, columns),
    )  # fmt: skip
    # A cell's value is the mean of its faces; those of the rim are other places' by half.
    return [save(folder / f"{name}.nc", fields, **stated)], {}, inner(known, (rows, columns))


def mesh() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes [P] and triangles [N, 3] of an uneven mesh."""
    rng = np.random.default_rng(3)
    j, i = np.meshgrid(np.arange(7), np.arange(8), indexing="ij")
    inner = (j > 0) & (j < 6) & (i > 0) & (i < 7)
    shift = rng.uniform(-0.2, 0.2, (2, 7, 8)) * inner
    return LON + STEP * (i + shift[0]).ravel(), LAT + STEP * (j + shift[1]).ravel(), halves(7, 8)


def centre_table(lon: np.ndarray, lat: np.ndarray, corners: tuple, **more: Any) -> Table:
    """`table` at the middles of cells, linear between them."""
    import shapely

    local = Proj(proj="aeqd", lon_0=LON, lat_0=LAT, datum="WGS84")
    triangles = Delaunay(np.stack(local(lon, lat), axis=1)).simplices
    cells = shapely.polygons(np.stack(corners, axis=-1))
    return table(lon, lat, triangles=triangles, cells=np.asarray(cells, object), **more)


def fvcom(folder: Path, name: str, crs: int | None = None) -> Made:
    """FVCOM: velocities in cells, sigma levels, h and zeta at nodes; exact times in Itime and Itime2."""
    lon, lat, triangles = mesh()
    sigma, depth = -np.array([0.1, 0.5, 0.9]), 50.0
    middle = lon[triangles].mean(axis=1), lat[triangles].mean(axis=1)
    corners, centre, stated = (lon, lat), [lon, lat], {}
    angle: Any = 0.0
    if crs is not None:
        system = Proj(f"EPSG:{crs}")
        corners = system(lon, lat)
        centre = [np.asarray(axis)[triangles].mean(axis=1) for axis in corners]
        middle = system(*centre, inverse=True)
        angle = -np.deg2rad(system.get_factors(*middle).meridian_convergence)
        stated = {"crs": crs}
    parts = flow(*middle, depth * -sigma[None, :, None], HOURS[:, None, None])
    u, v = along(*np.broadcast_arrays(*parts), angle)
    days = 58849.0 + HOURS / 24.0
    mjd = {"units": "days since 1858-11-17 00:00:00"}
    zero = crs is not None
    fields = {
        "u": (("time", "siglay", "nele"), u, {"units": "meters s-1"} | ({} if zero else EAST)),
        "v": (("time", "siglay", "nele"), v, {"units": "meters s-1"} | ({} if zero else NORTH)),
        "h": (("node",), np.full(len(lon), depth), {"units": "m"}),
        "zeta": (("time", "node"), np.zeros((len(HOURS), len(lon))), {"units": "meters"}),
        "siglay": (("siglay", "node"), np.repeat(sigma[:, None], len(lon), axis=1),
                   {"standard_name": "ocean_sigma/general_coordinate", "positive": "up"}),
        "nv": (("three", "nele"), (triangles.T + 1).astype(np.int32), {}),
        "lon": (("node",), lon * (not zero), LONGITUDE),
        "lat": (("node",), lat * (not zero), LATITUDE),
        "lonc": (("nele",), middle[0] * (not zero), LONGITUDE),
        "latc": (("nele",), middle[1] * (not zero), LATITUDE),
        "time": (("time",), days.astype(np.float32), mjd),
        "Itime": (("time",), np.floor(days).astype(np.int32), mjd),
        "Itime2": (("time",), np.round(days % 1 * 86_400_000).astype(np.int32),
                   {"units": "msec since 00:00:00"}),
    }  # fmt: skip
    if zero:
        fields["x"], fields["y"] = ((("node",), axis, {"units": "meters"}) for axis in corners)
        fields["xc"], fields["yc"] = ((("nele",), axis, {"units": "meters"}) for axis in centre)
    known = centre_table(*middle, (lon[triangles], lat[triangles]), depths=-sigma * depth,
                         floor=np.full((1, len(middle[0])), depth))  # fmt: skip
    return [save(folder / f"{name}.nc", fields)], stated, known


def nodes_mesh(folder: Path, model: str) -> Made:
    """FESOM, UGRID and POM-like meshes with the current at nodes; SCHISM with heights of its levels."""
    lon, lat, triangles = mesh()
    if model == "schism":
        levels, rise = np.array([-30.0, -10.0, -5.0, 0.0]), 0.5
        floor = np.where(lon < LON + 0.035, 10.0, 30.0)
        height = np.where(levels >= -floor[:, None], levels, np.nan)
        height[:, -1] = rise
        depth = (rise - height).T[None]
        known = table(lon, lat, depths=depth, triangles=triangles)
        dims = ("time", "nSCHISM_hgrid_node", "nSCHISM_vgrid_layers")
        both = np.stack([np.moveaxis(part, 1, 2) for part in (known.east, known.north)], axis=-1)
        faces = np.concatenate([triangles + 1, np.full((len(triangles), 1), -1)], axis=1)
        fields = {
            "hvel": ((*dims, "two"), both, {"units": "m/s"}),
            "zcor": (dims, np.repeat(height[None], len(HOURS), axis=0), {"units": "m"}),
            "elev": (dims[:2], np.full((len(HOURS), len(lon)), rise), {"units": "m"}),
            "SCHISM_hgrid_node_x": (dims[1:2], lon, LONGITUDE),
            "SCHISM_hgrid_node_y": (dims[1:2], lat, LATITUDE),
            "SCHISM_hgrid_face_nodes": (("faces", "corners"), faces.astype(np.int32),
                                        {"start_index": np.int32(1), "_FillValue": np.int32(-1)}),
        }  # fmt: skip
        return [save(folder / "schism.nc", fields | TIMES)], {}, known
    if model == "selfe":
        sigma, rise = -np.array([1.0, 0.6, 0.2, 0.0]), 2.0
        floor = 40.0 + 1000.0 * (lon - LON)
        depth = (-sigma[:, None] * (floor + rise))[::-1][None]
        known = table(lon, lat, depths=depth, triangles=triangles, floor=(floor + rise)[None])
        dims = ("time", "nv", "node")
        fields = {
            "u": (dims, known.east[:, ::-1], {"units": "m/s"}),
            "v": (dims, known.north[:, ::-1], {"units": "m/s"}),
            "sigma": (("nv",), sigma, {"standard_name": "ocean_sigma_coordinate", "positive": "up"}),
            "h": (("node",), floor, {"units": "m"}),
            "zeta": (("time", "node"), np.full((len(HOURS), len(lon)), rise), {"units": "m"}),
            "ele": (("nface", "nele"), (triangles.T + 1).astype(np.int32), {}),
            "lon": (("node",), lon, DEGREES_EAST),
            "lat": (("node",), lat, DEGREES_NORTH),
        }
        return [save(folder / "selfe.nc", fields | TIMES)], {}, known
    known = table(lon, lat, triangles=triangles)
    if model == "fesom":
        fields = {
            "unod": (("time", "nz1", "nod2"), known.east, {"units": "m/s"}),
            "vnod": (("time", "nz1", "nod2"), known.north, {"units": "m/s"}),
            "nz1": (("nz1",), DEPTHS, {"units": "m", "positive": "down"}),
            "elem": (("n3", "elem"), (triangles.T + 1).astype(np.int32), {}),
            "lon": (("nod2",), lon, DEGREES_EAST),
            "lat": (("nod2",), lat, DEGREES_NORTH),
        }
        return [save(folder / "fesom.nc", fields | TIMES)], {}, known
    quads = np.concatenate([triangles, np.full((len(triangles), 1), -1)], axis=1).astype(np.int32)
    fields = {
        "mesh": ((), np.int32(0), {"cf_role": "mesh_topology", "topology_dimension": np.int32(2),
                                   "node_coordinates": "mesh_x mesh_y", "face_node_connectivity": "faces"}),
        "mesh_x": (("n_node",), lon, LONGITUDE),
        "mesh_y": (("n_node",), lat, LATITUDE),
        "faces": (("n_face", "n_corner"), quads, {"_FillValue": np.int32(-1), "start_index": np.int32(0)}),
        "ucx": (("time", "depth", "n_node"), known.east, EAST | {"location": "node", "mesh": "mesh"}),
        "ucy": (("time", "depth", "n_node"), known.north, NORTH | {"location": "node", "mesh": "mesh"}),
    }  # fmt: skip
    return [save(folder / "ugrid.nc", fields | LEVELS | TIMES)], {}, known


def dflow(folder: Path) -> Made:
    """D-Flow FM in three dimensions: sigma layers, the bed as an altitude of the cells."""
    lon, lat, triangles = mesh()
    middle = lon[triangles].mean(axis=1), lat[triangles].mean(axis=1)
    sigma, bed, rise = -np.array([0.9, 0.5, 0.1]), 50.0, 1.0
    depth = -sigma[::-1] * (bed + rise)
    known = centre_table(*middle, (lon[triangles], lat[triangles]), depths=depth,
                         floor=np.full((1, len(middle[0])), bed + rise))  # fmt: skip
    dims = ("time", "nmesh2d_face", "mesh2d_nLayers")
    place = {"mesh": "mesh2d", "location": "face", "coordinates": "mesh2d_face_x mesh2d_face_y"}
    topology = {"cf_role": "mesh_topology", "topology_dimension": np.int32(2),
                "node_coordinates": "mesh2d_node_x mesh2d_node_y",
                "face_node_connectivity": "mesh2d_face_nodes",
                "face_coordinates": "mesh2d_face_x mesh2d_face_y"}  # fmt: skip
    count = len(middle[0])
    fields = {
        "mesh2d": ((), np.int32(0), topology),
        "mesh2d_node_x": (("nmesh2d_node",), lon, LONGITUDE),
        "mesh2d_node_y": (("nmesh2d_node",), lat, LATITUDE),
        "mesh2d_face_x": (("nmesh2d_face",), middle[0], LONGITUDE),
        "mesh2d_face_y": (("nmesh2d_face",), middle[1], LATITUDE),
        "mesh2d_face_nodes": (("nmesh2d_face", "max_nodes"), (triangles + 1).astype(np.int32),
                              {"start_index": np.int32(1), "cf_role": "face_node_connectivity"}),
        "mesh2d_ucx": (dims, np.moveaxis(known.east[:, ::-1], 1, 2), EAST | place),
        "mesh2d_ucy": (dims, np.moveaxis(known.north[:, ::-1], 1, 2), NORTH | place),
        "mesh2d_layer_sigma": (("mesh2d_nLayers",), sigma,
                               {"standard_name": "ocean_sigma_coordinate", "positive": "up",
                                "formula_terms": "sigma: mesh2d_layer_sigma eta: mesh2d_s1 "
                                                 "depth: mesh2d_flowelem_bl"}),
        "mesh2d_flowelem_bl": (("nmesh2d_face",), np.full(count, -bed),
                               {"standard_name": "altitude", "units": "m", "positive": "up"} | place),
        "mesh2d_s1": (("time", "nmesh2d_face"), np.full((len(HOURS), count), rise),
                      {"standard_name": "sea_surface_height", "units": "m"} | place),
    }  # fmt: skip
    return [save(folder / "dflow3d.nc", fields | TIMES)], {}, known


def projected(folder: Path, name: str, crs: Any, x: np.ndarray, y: np.ndarray, kind: str) -> Made:
    """A grid along the axes of a projection or of a turned pole, without longitude and latitude."""
    system = CRS.from_user_input(crs)
    back = Transformer.from_crs(system, 4326, always_xy=True)
    lon, lat = back.transform(*np.meshgrid(x, y))
    there = Transformer.from_crs(4326, system, always_xy=True)
    ends = [np.stack(there.transform(lon, lat + side)) for side in (-1e-4, 1e-4)]
    across, up = ends[1] - ends[0]
    if system.is_geographic:  # a degree of longitude of the turned sphere is the shorter one
        across = across * np.cos(np.deg2rad(y))[:, None]
    angle = np.arctan2(across, up)
    rows = np.arange(lon.size).reshape(lon.shape)
    known = table(lon.ravel(), lat.ravel(), about=float(lon.mean()), triangles=halves(*lon.shape))
    scale = 0.02 / max(np.ptp(lon), np.ptp(lat), 0.02)
    parts = [0.3 + scale * (part - 0.3) for part in (known.east, known.north)]
    known = replace(known, east=parts[0], north=parts[1])
    u, v = along(*(part[..., rows] for part in parts), angle)
    mapping = {key: value for key, value in system.to_cf().items() if kind != "cf" or key != "crs_wkt"}
    units = {"units": "degrees" if system.is_geographic else "m"}
    names = ("grid_longitude", "grid_latitude") if system.is_geographic else (
        "projection_x_coordinate", "projection_y_coordinate")  # fmt: skip
    fields = {
        "u": (("time", "depth", "y", "x"), u, ALONG_X | {"grid_mapping": "crs"}),
        "v": (("time", "depth", "y", "x"), v, ALONG_Y | {"grid_mapping": "crs"}),
        "x": (("x",), x, units | {"standard_name": names[0]}),
        "y": (("y",), y, units | {"standard_name": names[1]}),
        "crs": ((), np.int32(0), {k: v for k, v in mapping.items() if isinstance(v, str | float | int)}),
    }
    return [save(folder / f"{name}.nc", fields | LEVELS | TIMES)], {}, known


def pop(folder: Path) -> Made:
    """POP: curvilinear, ANGLE, cm/s, depths in cm."""
    lon, lat, angle = turned_grid()
    known = table(lon.ravel(), lat.ravel(), triangles=halves(*lon.shape))
    u, v = (100.0 * component(k, lon, lat, angle) for k in (0, 1))
    dims = ("time", "z_t", "nlat", "nlon")
    about = {"units": "centimeter/s", "coordinates": "ULONG ULAT z_t time"}
    fields = {
        "UVEL": (dims, u, about),
        "VVEL": (dims, v, about),
        "ULONG": (dims[2:], lon, DEGREES_EAST),
        "ULAT": (dims[2:], lat, DEGREES_NORTH),
        "ANGLE": (dims[2:], angle, {"units": "radians"}),
        "z_t": (("z_t",), 100.0 * DEPTHS, {"units": "centimeters", "positive": "down"}),
    }
    return [save(folder / "pop.nc", fields | TIMES)], {}, known


def zarr_store(folder: Path) -> Made:
    paths, options, known = regular_file(folder, "for_zarr")
    with xr.open_dataset(paths[0], engine="netcdf4", decode_times=False) as data:
        data.load().drop_encoding().to_zarr(folder / "grid.zarr", consolidated=False)
    return [folder / "grid.zarr"], options, known


Maker = Callable[[Path], Made]
_LINE = np.array([179.96, 179.97, 179.98, 179.99, -180.0, -179.99, -179.98, -179.97, -179.96])
_NAMES = {
    "hycom": ("water_u", "water_v", "lon", "lat", "depth", "time"),
    "plain": ("u", "v", "lon", "lat", "depth", "time"),
}

#: (what the file is, the model, its maker).
MADE: tuple[tuple[str, str, Maker], ...] = (
    ("C-grid, u, v and mesh in files of their own, turned by 29 degrees", "NEMO", nemo),
    ("C-grid, symmetric", "MOM6", lambda folder: c_grid(folder, "mom6")),
    ("C-grid, XC, YC, XG, YG", "MITgcm", lambda folder: c_grid(folder, "mitgcm")),
    ("C-grid, Vtransform 1", "ROMS", lambda folder: roms(folder, "roms1", 1)),
    ("C-grid, parameters in attributes", "CROCO", lambda folder: roms(folder, "croco", 2, croco=True)),
    ("curvilinear, ANGLE, cm/s, depths in cm", "POP", pop),
    ("combined output: hvel, zcor, elev", "SCHISM", lambda folder: nodes_mesh(folder, "schism")),
    ("sigma levels at nodes", "SELFE", lambda folder: nodes_mesh(folder, "selfe")),
    ("unod, vnod at nodes, 1-based triangles", "FESOM", lambda folder: nodes_mesh(folder, "fesom")),
    ("UGRID at nodes, levels in m", "UGRID", lambda folder: nodes_mesh(folder, "ugrid")),
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
        folder, "hycom", lon=300.0 + STEP * np.arange(9), names=_NAMES["hycom"], middle=-60.0, packed=1e-4,
        more={"tau": (("time",), np.zeros(3), {"units": "hours since analysis"})})),
    ("calendar gregorian_proleptic, falling latitudes", "CF", lambda folder: regular_file(
        folder, "proleptic", lat=PARALLELS[::-1],
        clock=CLOCK | {"calendar": "gregorian_proleptic"})),
    ("calendar noleap, depths negative up", "CF", lambda folder: regular_file(
        folder, "noleap", times=365.0 * 20 * 24 + HOURS, levels=(-DEPTHS, {"units": "m", "positive": "up"}),
        clock={"units": "hours since 2000-01-01", "calendar": "noleap"})),
    ("calendar julian", "CF", lambda folder: regular_file(
        folder, "julian", clock={"units": "hours since 2019-12-19", "calendar": "julian"})),
    ("knots, NetCDF-3", "CF", lambda folder: regular_file(
        folder, "knots", factor=3600.0 / 1852.0, form="NETCDF3_CLASSIC",
        about=(EAST | {"units": "knots"}, NORTH | {"units": "knots"}))),
    ("across the date line", "CF", lambda folder: regular_file(folder, "line", lon=_LINE, middle=179.96)),
    ("surface only, cm/s", "HF radar", lambda folder: regular_file(
        folder, "radar", names=_NAMES["plain"], levels=None, factor=100.0,
        about=({"units": "cm/s", "standard_name": "surface_eastward_sea_water_velocity"},
               {"units": "cm/s", "standard_name": "surface_northward_sea_water_velocity"}))),
    ("Zarr folder", "CF", zarr_store),
)  # fmt: skip
