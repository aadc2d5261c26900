"""Small ocean files whose currents are known in closed form."""

import numpy as np
import pytest
import xarray as xr

from auvplan.io.currents import open_ocean, read_current
from auvplan.ocean.gridded import CurrentError
from auvplan.site import Site

#: Degrees; metres in a degree here need not be exact: fields are given in degrees.
LON, LAT = 5.0, 60.0
#: 2020-01-01 in s since 1970.
START = 1577836800.0
EAST = {"units": "m s-1", "standard_name": "eastward_sea_water_velocity"}
NORTH = {"units": "m s-1", "standard_name": "northward_sea_water_velocity"}
PLACE = (LON + 0.033, LAT + 0.024)
#: Within the samples' 8 x 6 nodes of 0.01 degrees.
SITE = Site(LON + 0.035, LAT + 0.025)
BOX = {"lower": (-2000.0, -1500.0, 0.0), "upper": (2000.0, 1500.0, 25.0)}
DIMS = ("time", "depth", "latitude", "longitude")
HOURS = {"units": "hours since 2020-01-01 00:00:00", "standard_name": "time"}


def flow(lon, lat, depth=0.0, hour=0.0):
    """Eastward and northward m/s: linear in everything, another in each direction; no symmetry."""
    x, y = np.asarray(lon) - LON, np.asarray(lat) - LAT
    shade = 1.0 - 0.01 * np.asarray(depth)
    return (0.3 + 2.0 * x - y) * shade + 0.01 * hour, (-0.2 + x + 3.0 * y) * shade - 0.02 * hour


def nearby(lon, about):
    """Longitudes moved from about one place to LON, the shorter way round."""
    return LON + np.mod(np.asarray(lon) - about + 180.0, 360.0) - 180.0


def regular(lon=None, lat=None, depth=(0.0, 10.0, 30.0), hours=(0.0, 1.0, 3.0), about=LON):
    """A CF dataset on a regular grid; `flow` as if LON were at longitude `about`."""
    lon = LON + 0.01 * np.arange(8) if lon is None else np.asarray(lon, float)
    lat = LAT + 0.01 * np.arange(6) if lat is None else np.asarray(lat, float)
    depth, hours = np.asarray(depth, float), np.asarray(hours, float)
    t, z, y, x = np.meshgrid(hours, depth, lat, nearby(lon, about), indexing="ij")
    east, north = flow(x, y, z, t)
    return xr.Dataset(
        {"uo": (DIMS, east, dict(EAST)), "vo": (DIMS, north, dict(NORTH))},
        {
            "time": ("time", hours, dict(HOURS)),
            "depth": ("depth", depth, {"units": "m", "positive": "down", "axis": "Z"}),
            "latitude": ("latitude", lat, {"units": "degrees_north"}),
            "longitude": ("longitude", lon, {"units": "degrees_east"}),
        },
    )


def described(data, **attributes):
    """The components without other attributes than their unit and these, `{}` being east and north."""
    for name, way in (("uo", "east"), ("vo", "north")):
        if "{}_v" in attributes.get("standard_name", ""):
            way = {"east": "x", "north": "y"}[way]
        data[name].attrs = {"units": "m s-1"} | {k: v.format(way) for k, v in attributes.items()}
    return data


def named(east, north, **attributes):
    return described(regular(), **attributes).rename(uo=east, vo=north)


def timed(values=(0.0, 1.0), units=None):
    """Two times, an hour apart unless they are others."""
    data = regular(hours=[0.0, 1.0])
    data["time"] = ("time", np.asarray(values), {"units": units} if units else {})
    return data


def other_levels(name, values=None, **attributes):
    """Levels along a dimension of another name, with or without an axis."""
    data = regular().rename(depth=name).drop_vars(name)
    return data if values is None else data.assign_coords({name: (name, values, attributes)})


SIGMA = {"values": [0.0, -1.0 / 3.0, -1.0], "standard_name": "ocean_sigma_coordinate"}


def over_a_bed(depth, more=None, **attributes):
    """Shares of the depth as levels."""
    data = other_levels("sigma", **attributes)
    return data.assign(h=(DIMS[2:], np.full((6, 8), depth), {"units": "m"} | (more or {})))


def on_nodes(data, **shifts):
    """Places of the nodes as arrays [6, 8] of some names in place of axes, moved by so many degrees."""
    data = data.rename(longitude="x", latitude="y").drop_vars(["x", "y"])
    lon, lat = np.meshgrid(LON + 0.01 * np.arange(8), LAT + 0.01 * np.arange(6))
    for name, shift in shifts.items():
        values, unit = (lon, "degrees_east") if "lon" in name.lower() else (lat, "degrees_north")
        data[name] = (("y", "x"), values + shift, {"units": unit})
    return data


def write(dataset, path, **encoding):
    """Write as NetCDF-4, or as NetCDF-3 where the name ends in nc3."""
    engine = "scipy" if str(path).endswith(".nc3") else "h5netcdf"
    dataset.to_netcdf(path, engine=engine, encoding=encoding)
    return path


def check(source, lon=PLACE[0], lat=PLACE[1], depth=7.0, hour=0.6, about=LON, atol=1e-6, **options):
    """Compare the current of a file or data set at places with `flow`, and give it back closed."""
    with open_ocean(source, **options) as ocean:
        found = ocean.at(lon, lat, depth, START + 3600.0 * np.asarray(hour))
        np.testing.assert_allclose(found[:2], flow(nearby(lon, about), lat, depth, hour), atol=atol)
        return ocean


def refused(source, *words, site=SITE, box=BOX):
    """A file or data set is refused in one line that holds some words."""
    with pytest.raises(CurrentError) as caught:
        read_current(source, site, **box)
    message = str(caught.value)
    assert all(part in message for part in words), message
    assert getattr(source, "name", "dataset") in message
    assert "\n" not in message


def turned_grid(rows=9, columns=12, angle=0.7, step=0.004):
    """Longitude and latitude [rows, columns] of a grid whose rows head `angle` rad from east to north."""
    j, i = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    east, north = i * np.cos(angle) - j * np.sin(angle), i * np.sin(angle) + j * np.cos(angle)
    return LON + step * east / np.cos(np.deg2rad(LAT)), LAT + step * north


def solid_body(lon, lat, omega=1e-4):
    """Eastward and northward m/s of water that turns like a solid body about (LON, LAT)."""
    x = (lon - LON) * np.cos(np.deg2rad(LAT)) * 111_195.0
    y = (lat - LAT) * 111_195.0
    return -omega * y, omega * x


def roms(transform=2, angle=0.7, land=(), levels=6, zeta=0.4):
    """Native ROMS output of a solid body's turn times 1 + s, to 0 at the bed; w = 1e-3 (1 + s)."""
    lon, lat = turned_grid(angle=angle)
    rows, columns = lon.shape
    floor = 40.0 + 3.0 * np.arange(columns) + 2.0 * np.arange(rows)[:, None]
    s_w = np.linspace(-1.0, 0.0, levels + 1)
    s = (s_w[1:] + s_w[:-1]) / 2
    curves = [(1 - np.cosh(2.0 * part)) / (np.cosh(2.0) - 1) for part in (s, s_w)]
    east, north = solid_body(lon, lat)
    along, across = east * np.cos(angle) + north * np.sin(angle), north * np.cos(angle) - east * np.sin(angle)
    mask = np.ones((rows, columns))
    for j, i in land:
        mask[j, i] = 0
    u, v = (along[:, 1:] + along[:, :-1]) / 2, (across[1:] + across[:-1]) / 2
    u = np.where(mask[:, 1:] * mask[:, :-1] > 0, u, np.nan)
    v = np.where(mask[1:] * mask[:-1] > 0, v, np.nan)
    hours = np.array([0.0, 2.0])
    shade = (1.0 + s)[None, :, None, None] * np.ones((2, 1, 1, 1))
    rising = 1e-3 * (1 + s_w)[None, :, None, None] * np.ones((2, 1, rows, columns))
    level, rho = ("ocean_time", "s_rho"), ("eta_rho", "xi_rho")
    rise = zeta * (1.0 + 0.0 * hours)[:, None, None] * np.where(mask > 0, 1.0, np.nan)
    speed = {"units": "meter second-1"}
    return xr.Dataset(
        {
            "u": ((*level, "eta_u", "xi_u"), shade * u, speed),
            "v": ((*level, "eta_v", "xi_v"), shade * v, speed),
            "w": (("ocean_time", "s_w", *rho), rising, speed),
            "zeta": (("ocean_time", *rho), rise, {"units": "meter"}),
            "h": (rho, floor, {"units": "meter"}),
            "mask_rho": (rho, mask),
            "angle": (rho, np.full((rows, columns), angle), {"units": "radians"}),
            "Vtransform": ((), np.int32(transform)),
            "hc": ((), 20.0),
            "Cs_r": ("s_rho", curves[0]),
            "Cs_w": ("s_w", curves[1]),
            "s_rho": ("s_rho", s),
            "s_w": ("s_w", s_w),
            "ocean_time": ("ocean_time", hours * 3600.0, {"units": "seconds since 2020-01-01 00:00:00"}),
            "lon_rho": (rho, lon, {"units": "degree_east"}),
            "lat_rho": (rho, lat, {"units": "degree_north"}),
            # Coordinates of grids that are not written stay zero.
            "lon_u": (("eta_u", "xi_u"), np.zeros(u.shape)),
            "lat_u": (("eta_u", "xi_u"), np.zeros(u.shape)),
        }
    )


def mesh(rows=7, columns=8, step=0.01, hole=None):
    """Nodes [P] and triangles [N, 3] of an uneven mesh; the square of cells about node `hole` is left out."""
    rng = np.random.default_rng(3)
    j, i = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    inner = (j > 0) & (j < rows - 1) & (i > 0) & (i < columns - 1)
    shift = rng.uniform(-0.2, 0.2, (2, rows, columns)) * inner
    lon, lat = LON + step * (i + shift[0]), LAT + step * (j + shift[1])
    first = (j * columns + i)[:-1, :-1].ravel()
    quads = np.stack([first, first + 1, first + columns + 1, first + columns], axis=1)
    if hole is not None:
        quads = quads[~(quads == hole).any(axis=1)]
    return lon.ravel(), lat.ravel(), np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


LONGITUDE = {"standard_name": "longitude", "units": "degrees_east"}
LATITUDE = {"standard_name": "latitude", "units": "degrees_north"}


def fvcom(hole=None, middles=True):
    """FVCOM output: velocities in cells, h, zeta, siglay at nodes; float32 time, exact Itime and Itime2."""
    lon, lat, triangles = mesh(hole=hole)
    lonc, latc = lon[triangles].mean(axis=1), lat[triangles].mean(axis=1)
    sigma, hours, depth = -np.array([0.1, 0.5, 0.9]), np.array([0.0, 1.0]), 50.0
    east, north = flow(lonc, latc, depth * -sigma[None, :, None], hours[:, None, None])
    days = 58849.0 + hours / 24.0
    levels, since = ("time", "siglay", "nele"), {"units": "days since 1858-11-17 00:00:00"}
    speed = {"units": "meters s-1"}
    variables = {
        "u": (levels, east, EAST | speed),
        "v": (levels, north, speed | {"standard_name": "Northward_sea_water_velocity"}),
        "ww": (levels, np.full(east.shape, 2e-3), speed),
        "h": ("node", np.full(len(lon), depth), {"units": "m"}),
        "zeta": (("time", "node"), np.zeros((2, len(lon))), {"units": "meters"}),
        "siglay": (("siglay", "node"), np.repeat(sigma[:, None], len(lon), axis=1),
                   {"standard_name": "ocean_sigma/general_coordinate", "positive": "up"}),
        "nv": (("three", "nele"), triangles.T + 1),
        "lon": ("node", lon, LONGITUDE),
        "lat": ("node", lat, LATITUDE),
        "lonc": ("nele", lonc * middles, LONGITUDE),
        "latc": ("nele", latc * middles, LATITUDE),
        "time": ("time", days.astype(np.float32), since),
        "Itime": ("time", np.floor(days).astype(np.int32), since),
        "Itime2": ("time", np.round(days % 1 * 86_400_000).astype(np.int32),
                   {"units": "msec since 00:00:00"}),
    }  # fmt: skip
    return xr.Dataset(variables)


def ugrid(location="node"):
    """A UGRID file with the current at nodes or in cells, one of them with four corners; one level."""
    lon, lat, triangles = mesh()
    cells = np.full((len(triangles), 4), -1)
    cells[:, :3] = triangles
    # Two triangles that share a side are one cell with four corners.
    half = len(triangles) // 2
    merged = np.concatenate([triangles[:1], triangles[half : half + 1, 2:]], axis=1)
    cells = np.concatenate([merged, np.delete(cells, [0, half], axis=0)])
    means = [np.array([part[row[row >= 0]].mean() for row in cells]) for part in (lon, lat)]
    x, y = (lon, lat) if location == "node" else means
    dims, on = ("time", f"n_{location}"), {"location": location, "mesh": "mesh"}
    hours = np.array([0.0, 1.0])
    east, north = flow(x, y, 0.0, hours[:, None])
    topology = {"cf_role": "mesh_topology", "topology_dimension": np.int32(2),
                "node_coordinates": "mesh_x mesh_y", "face_node_connectivity": "mesh_faces"}  # fmt: skip
    return xr.Dataset(
        {
            "mesh": ((), np.int32(0), topology),
            "mesh_x": ("n_node", lon, LONGITUDE),
            "mesh_y": ("n_node", lat, LATITUDE),
            "mesh_faces": (("n_face", "n_corner"), cells.astype(np.int32),
                           {"_FillValue": np.int32(-1), "start_index": np.int32(0)}),
            "ucx": (dims, east, EAST | on),
            "ucy": (dims, north, NORTH | on),
            "time": ("time", hours, HOURS),
        }
    )  # fmt: skip


def schism():
    """SCHISM output: hvel(time, node, level, two), zcor, elev; levels from the bed, 10 or 30 m deep."""
    lon, lat, triangles = mesh()
    hours, elev = np.array([0.0, 1.0]), 0.5
    floor, levels = np.where(lon < LON + 0.035, 10.0, 30.0), np.array([-30.0, -10.0, -5.0, 0.0])
    zcor = np.where(levels >= -floor[:, None], levels, np.nan) + 0.0
    zcor[:, -1] = elev
    east, north = flow(lon[:, None], lat[:, None], elev - zcor, hours[:, None, None])
    corners = np.concatenate([triangles + 1, np.full((len(triangles), 1), -1)], axis=1).astype(np.int32)
    dims = ("time", "nSCHISM_hgrid_node", "nSCHISM_vgrid_layers")
    return xr.Dataset(
        {
            "hvel": ((*dims, "two"), np.stack([east, north], axis=-1), {"units": "m/s"}),
            "zcor": (dims, np.stack([zcor, zcor]), {"units": "m"}),
            "elev": (dims[:2], np.full((2, len(lon)), elev), {"units": "m"}),
            "SCHISM_hgrid_node_x": (dims[1], lon, LONGITUDE),
            "SCHISM_hgrid_node_y": (dims[1], lat, LATITUDE),
            "SCHISM_hgrid_face_nodes": (("nSCHISM_hgrid_face", "nMaxSCHISM_hgrid_face_nodes"), corners,
                                        {"start_index": np.int32(1), "_FillValue": np.int32(-1)}),
            "time": ("time", hours, HOURS),
        }
    )  # fmt: skip
