"""Small ocean files whose currents are known in closed form."""

import numpy as np
import xarray as xr
from pyproj import CRS, Proj, Transformer

from auvplan.io.currents import open_ocean, read_current
from auvplan.ocean.gridded import CurrentError
from auvplan.site import Site
from tests.io.refusals import refusal

#: Degrees; metres in a degree here need not be exact: fields are given in degrees.
LON, LAT, STEP = 5.0, 60.0, 0.01
#: Hours since `START`, and m.
TIMES, DEPTHS = np.array([0.0, 1.0, 3.0]), np.array([0.0, 10.0, 30.0])
#: The middles of the cells of `c_grid`.
MERIDIANS, PARALLELS = LON + STEP * np.arange(9), LAT + STEP * np.arange(7)
#: 2020-01-01 in s since 1970.
START = 1577836800.0
EAST = {"units": "m s-1", "standard_name": "eastward_sea_water_velocity"}
NORTH = {"units": "m s-1", "standard_name": "northward_sea_water_velocity"}
ALONG_X, ALONG_Y = ({"units": "m s-1", "standard_name": f"sea_water_{axis}_velocity"} for axis in "xy")
EASTWARD, NORTHWARD = {"units": "degrees_east"}, {"units": "degrees_north"}
LONGITUDE, LATITUDE = {"standard_name": "longitude"} | EASTWARD, {"standard_name": "latitude"} | NORTHWARD
DOWN = {"units": "m", "positive": "down", "standard_name": "depth"}
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
    message = str(
        refusal(CurrentError, getattr(source, "name", "dataset"), read_current, source, site, **box)
    )
    assert all(part in message for part in words), message


def turned_grid(angle=0.7, right=0.0, up=0.0, rows=9, columns=12, step=450.0):
    """Longitude, latitude and angle [rows, columns] of a grid with points every `step` m.

    Rows head `angle` rad from east to north in the corner, and as the angles say elsewhere. `right` and `up`
    move all by shares of cells.
    """
    j, i = np.meshgrid(np.arange(rows) + up, np.arange(columns) + right, indexing="ij")
    x, y = i * np.cos(angle) - j * np.sin(angle), i * np.sin(angle) + j * np.cos(angle)
    local = Proj(proj="aeqd", lon_0=LON, lat_0=LAT, datum="WGS84")
    lon, lat = (np.asarray(axis) for axis in local(step * x, step * y, inverse=True))
    return lon, lat, angle - np.deg2rad(local.get_factors(lon, lat).meridian_convergence)


def along(east, north, angle):
    """Components along axes turned by an angle from east."""
    both = (east + 1j * north) * np.exp(-1j * angle)
    return both.real, both.imag


def component(which, lon, lat, angle=0.0):
    """[T, K, *places] m/s of `flow` along one of two axes turned by an angle."""
    ones = (1,) * np.ndim(lon)
    return along(*flow(lon, lat, DEPTHS.reshape(1, -1, *ones), TIMES.reshape(-1, 1, *ones)), angle)[which]


def nemo(angle=0.5):
    """NEMO: u and v east and north of the middle with the same index, in files of their own; its mesh."""
    parts = []
    for k, (name, kind) in enumerate((("vozocrtx", "u"), ("vomecrty", "v"))):
        x, y, turn = turned_grid(angle, right=0.5 * (k == 0), up=0.5 * (k == 1))
        dims = ("time_counter", f"depth{kind}", "y", "x")
        fields = {
            name: (dims, component(k, x, y, turn), {"units": "m/s"}),
            "nav_lon": (dims[2:], x),
            "nav_lat": (dims[2:], y),
            "time_counter": ("time_counter", TIMES, HOURS),
            dims[1]: (dims[1], DEPTHS, {"units": "m", "positive": "down"}),
        }
        parts.append(xr.Dataset(fields))
    lon, lat, _ = turned_grid(angle)
    wet = np.ones((1, 1, *lon.shape))
    wet[..., :2, :2] = 0
    mesh = {"glamt": (("t", "y", "x"), lon[None]), "gphit": (("t", "y", "x"), lat[None])}
    return [*parts, xr.Dataset(mesh | {"tmask": (("t", "z", "y", "x"), wet)})]


def c_grid(model="mitgcm", symmetric=True, walls=(1.0, 1.0)):
    """MOM6, whose outermost edges too are there if it is symmetric; MITgcm, edges west and south of middles.

    Components are times `walls`.
    """
    if model == "mom6":
        x, y = (
            np.append(axis[:1] - STEP if symmetric else [], axis) + STEP / 2
            for axis in (MERIDIANS, PARALLELS)
        )
        names, units = ("uo", "vo", "xh", "yh", "xq", "yq"), (ALONG_X, ALONG_Y)
    else:
        x, y = MERIDIANS - STEP / 2, PARALLELS - STEP / 2
        names, units = ("UVEL", "VVEL", "XC", "YC", "XG", "YG"), ({"units": "m/s"}, {"units": "m/s"})
    u, v, east, north, edge_x, edge_y = names
    fields = {
        u: (("time", "depth", north, edge_x), component(0, *np.meshgrid(x, PARALLELS)) * walls[0], units[0]),
        v: (("time", "depth", edge_y, east), component(1, *np.meshgrid(MERIDIANS, y)) * walls[1], units[1]),
        "time": ("time", TIMES, HOURS),
        "depth": ("depth", DEPTHS, DOWN),
    }
    axes = {east: MERIDIANS, north: PARALLELS, edge_x: x, edge_y: y}
    units_of = {name: EASTWARD if name in (east, edge_x) else NORTHWARD for name in axes}
    return xr.Dataset(fields | {name: (name, axis, units_of[name]) for name, axis in axes.items()})


def pop():
    """POP: curvilinear, ANGLE, cm/s, depths in cm."""
    lon, lat, angle = turned_grid()
    dims = ("time", "z_t", "nlat", "nlon")
    about = {"units": "centimeter/s", "coordinates": "ULONG ULAT z_t time"}
    fields = {
        name: (dims, 100.0 * component(k, lon, lat, angle), about) for k, name in enumerate(("UVEL", "VVEL"))
    }
    fields |= {"ULONG": (dims[2:], lon, EASTWARD), "ULAT": (dims[2:], lat, NORTHWARD)}
    fields |= {"ANGLE": (dims[2:], angle, {"units": "radians"}), "time": ("time", TIMES, HOURS)}
    fields["z_t"] = ("z_t", 100.0 * DEPTHS, {"units": "centimeters", "positive": "down"})
    return xr.Dataset(fields)


def roms(transform=2, angle=0.7, land=(), levels=6, zeta=0.4, croco=False):
    """Native ROMS, or CROCO, whose parameters are attributes: w = 1e-3 (1 + s), and `flow` times 1 + s."""
    lon, lat, turn = turned_grid(angle)
    rows, columns = lon.shape
    floor = 40.0 + 3.0 * np.arange(columns) + 2.0 * np.arange(rows)[:, None]
    s_w = np.linspace(-1.0, 0.0, levels + 1)
    s = (s_w[1:] + s_w[:-1]) / 2
    curves = [(1 - np.cosh(2.0 * part)) / (np.cosh(2.0) - 1) for part in (s, s_w)]
    mask = np.ones((rows, columns))
    for j, i in land:
        mask[j, i] = 0
    shade = (1.0 + s)[None, :, None, None]
    parts = along(*(part * shade for part in flow(lon, lat, 0.0, TIMES[:, None, None, None])), turn)
    u, v = (parts[0][..., 1:] + parts[0][..., :-1]) / 2, (parts[1][..., 1:, :] + parts[1][..., :-1, :]) / 2
    u = np.where(mask[:, 1:] * mask[:, :-1] > 0, u, np.nan)
    v = np.where(mask[1:] * mask[:-1] > 0, v, np.nan)
    rising = 1e-3 * (1 + s_w)[None, :, None, None] * np.ones((len(TIMES), 1, rows, columns))
    rho, level = ("eta_rho", "xi_rho"), ("time" if croco else "ocean_time", "s_rho")
    rise = np.broadcast_to(zeta * np.where(mask > 0, 1.0, np.nan), (len(TIMES), rows, columns))
    speed = {"units": "meter second-1"}
    fields = {
        "u": ((*level, "eta_rho" if croco else "eta_u", "xi_u"), u, speed),
        "v": ((*level, "eta_v", "xi_rho" if croco else "xi_v"), v, speed),
        "zeta": ((level[0], *rho), rise, {"units": "meter"}),
        "h": (rho, floor, {"units": "meter"}),
        "mask_rho": (rho, mask),
        "angle": (rho, turn, {"units": "radians"}),
        "lon_rho": (rho, lon, {"units": "degree_east"}),
        "lat_rho": (rho, lat, {"units": "degree_north"}),
        level[0]: (level[0], TIMES, HOURS),
    }
    if croco:
        fields["s_rho"] = "s_rho", s, {"standard_name": "ocean_s_coordinate_g2", "positive": "up"}
        return xr.Dataset(fields, attrs={"Cs_rho": curves[0], "sc_r": s, "hc": 20.0, "VertCoordType": "NEW"})
    fields |= {
        "w": (("ocean_time", "s_w", *rho), rising, speed),
        "Vtransform": ((), np.int32(transform)),
        "hc": ((), 20.0),
        "Cs_r": ("s_rho", curves[0]),
        "Cs_w": ("s_w", curves[1]),
        "s_rho": ("s_rho", s),
        "s_w": ("s_w", s_w),
        # Coordinates of grids that are not written stay zero.
        "lon_u": (("eta_u", "xi_u"), np.zeros(u.shape[2:])),
        "lat_u": (("eta_u", "xi_u"), np.zeros(u.shape[2:])),
    }
    return xr.Dataset(fields)


def mesh(hole=None):
    """Nodes [P] and triangles [N, 3] of an uneven mesh; the square of cells about node `hole` is left out."""
    rows, columns = 7, 8
    rng = np.random.default_rng(3)
    j, i = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    inner = (j > 0) & (j < rows - 1) & (i > 0) & (i < columns - 1)
    shift = rng.uniform(-0.2, 0.2, (2, rows, columns)) * inner
    lon, lat = LON + STEP * (i + shift[0]), LAT + STEP * (j + shift[1])
    first = (j * columns + i)[:-1, :-1].ravel()
    quads = np.stack([first, first + 1, first + columns + 1, first + columns], axis=1)
    if hole is not None:
        quads = quads[~(quads == hole).any(axis=1)]
    return lon.ravel(), lat.ravel(), np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


def fvcom(hole=None, middles=True, crs=None):
    """FVCOM: velocities in cells, h, zeta, siglay at nodes; float32 time, exact Itime and Itime2.

    Args:
        middles: whether the middles of the cells are given; FVCOM leaves them at zero otherwise.
        crs: projection of x and y, along which the velocities are; longitudes and latitudes are zero then.
    """
    lon, lat, triangles = mesh(hole)
    sigma, depth, speed = -np.array([0.1, 0.5, 0.9]), 50.0, {"units": "meters s-1"}
    centre, plane, angle = [axis[triangles].mean(axis=1) for axis in (lon, lat)], {}, 0.0
    if crs is not None:
        system = Proj(f"EPSG:{crs}")
        corners = system(lon, lat)
        middle = [np.asarray(axis)[triangles].mean(axis=1) for axis in corners]
        centre = system(*middle, inverse=True)
        angle = -np.deg2rad(system.get_factors(*centre).meridian_convergence)
        metres = {"units": "meters"}
        plane = {"x": ("node", corners[0], metres), "y": ("node", corners[1], metres)}
        plane |= {"xc": ("nele", middle[0], metres), "yc": ("nele", middle[1], metres)}
    u, v = along(*flow(*centre, depth * -sigma[None, :, None], TIMES[:, None, None]), angle)
    days = 58849.0 + TIMES / 24.0
    levels, since = ("time", "siglay", "nele"), {"units": "days since 1858-11-17 00:00:00"}
    known, east, north = crs is None, EAST | speed, NORTH | speed
    north["standard_name"] = north["standard_name"].capitalize()
    variables = {
        "u": (levels, u, east if known else speed),
        "v": (levels, v, north if known else speed),
        "ww": (levels, np.full(u.shape, 2e-3), speed),
        "h": ("node", np.full(len(lon), depth), {"units": "m"}),
        "zeta": (("time", "node"), np.zeros((len(TIMES), len(lon))), {"units": "meters"}),
        "siglay": (("siglay", "node"), np.repeat(sigma[:, None], len(lon), axis=1),
                   {"standard_name": "ocean_sigma/general_coordinate", "positive": "up"}),
        "nv": (("three", "nele"), (triangles.T + 1).astype(np.int32)),
        "lon": ("node", lon * known, LONGITUDE),
        "lat": ("node", lat * known, LATITUDE),
        "lonc": ("nele", centre[0] * (known and middles), LONGITUDE),
        "latc": ("nele", centre[1] * (known and middles), LATITUDE),
        "time": ("time", days.astype(np.float32), since),
        "Itime": ("time", np.floor(days).astype(np.int32), since),
        "Itime2": ("time", np.round(days % 1 * 86_400_000).astype(np.int32),
                   {"units": "msec since 00:00:00"}),
    }  # fmt: skip
    return xr.Dataset(variables | plane)


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
    east, north = flow(x, y, 0.0, TIMES[:, None])
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
            "time": ("time", TIMES, HOURS),
        }
    )  # fmt: skip


def nodes(model):
    """At the nodes of `mesh`: FESOM at fixed depths, SELFE at shares of the depth, SCHISM at heights.

    SCHISM's `hvel` has both components along a last dimension, its levels are from the bed, 10 or 30 m deep.
    """
    lon, lat, triangles = mesh()
    corners = (triangles.T + 1).astype(np.int32)
    if model == "fesom":
        dims = ("time", "nz1", "nod2")
        east, north = flow(lon, lat, DEPTHS[:, None], TIMES[:, None, None])
        fields = {
            "unod": (dims, east, {"units": "m/s"}),
            "vnod": (dims, north, {"units": "m/s"}),
            "nz1": ("nz1", DEPTHS, {"units": "m", "positive": "down"}),
            "elem": (("n3", "elem"), corners),
            "lon": ("nod2", lon, EASTWARD),
            "lat": ("nod2", lat, NORTHWARD),
        }
    elif model == "selfe":
        dims, sigma, rise = ("time", "nv", "node"), -np.array([1.0, 0.6, 0.2, 0.0]), 2.0
        floor = 40.0 + 1000.0 * (lon - LON)
        east, north = flow(lon, lat, -sigma[:, None] * (floor + rise), TIMES[:, None, None])
        fields = {
            "u": (dims, east, {"units": "m/s"}),
            "v": (dims, north, {"units": "m/s"}),
            "sigma": ("nv", sigma, {"standard_name": "ocean_sigma_coordinate", "positive": "up"}),
            "h": ("node", floor, {"units": "m"}),
            "zeta": (("time", "node"), np.full((len(TIMES), len(lon)), rise), {"units": "m"}),
            "ele": (("nface", "nele"), corners),
            "lon": ("node", lon, EASTWARD),
            "lat": ("node", lat, NORTHWARD),
        }
    else:
        dims, rise = ("time", "nSCHISM_hgrid_node", "nSCHISM_vgrid_layers"), 0.5
        floor, levels = np.where(lon < LON + 0.035, 10.0, 30.0), np.array([-30.0, -10.0, -5.0, 0.0])
        height = np.where(levels >= -floor[:, None], levels, np.nan) + 0.0
        height[:, -1] = rise
        parts = flow(lon[:, None], lat[:, None], rise - height, TIMES[:, None, None])
        faces = np.concatenate([corners.T, np.full((len(triangles), 1), -1, np.int32)], axis=1)
        fields = {
            "hvel": ((*dims, "two"), np.stack(parts, axis=-1), {"units": "m/s"}),
            "zcor": (dims, np.stack([height] * len(TIMES)), {"units": "m"}),
            "elev": (dims[:2], np.full((len(TIMES), len(lon)), rise), {"units": "m"}),
            "SCHISM_hgrid_node_x": (dims[1], lon, LONGITUDE),
            "SCHISM_hgrid_node_y": (dims[1], lat, LATITUDE),
            "SCHISM_hgrid_face_nodes": (("nSCHISM_hgrid_face", "nMaxSCHISM_hgrid_face_nodes"), faces,
                                        {"start_index": np.int32(1), "_FillValue": np.int32(-1)}),
        }  # fmt: skip
    return xr.Dataset(fields | {"time": ("time", TIMES, HOURS)})


def dflow():
    """D-Flow FM in three dimensions: sigma layers, the bed as an altitude of the cells."""
    lon, lat, triangles = mesh()
    x, y = lon[triangles].mean(axis=1), lat[triangles].mean(axis=1)
    sigma, bed, rise = -np.array([0.9, 0.5, 0.1]), 50.0, 1.0
    east, north = flow(x[:, None], y[:, None], -sigma * (bed + rise), TIMES[:, None, None])
    dims, count = ("time", "nmesh2d_face", "mesh2d_nLayers"), len(x)
    place = {"mesh": "mesh2d", "location": "face", "coordinates": "mesh2d_face_x mesh2d_face_y"}
    topology = {"cf_role": "mesh_topology", "topology_dimension": np.int32(2),
                "node_coordinates": "mesh2d_node_x mesh2d_node_y",
                "face_node_connectivity": "mesh2d_face_nodes",
                "face_coordinates": "mesh2d_face_x mesh2d_face_y"}  # fmt: skip
    terms = "sigma: mesh2d_layer_sigma eta: mesh2d_s1 depth: mesh2d_flowelem_bl"
    layers = {"standard_name": "ocean_sigma_coordinate", "positive": "up", "formula_terms": terms}
    return xr.Dataset({
        "mesh2d": ((), np.int32(0), topology),
        "mesh2d_node_x": ("nmesh2d_node", lon, LONGITUDE),
        "mesh2d_node_y": ("nmesh2d_node", lat, LATITUDE),
        "mesh2d_face_x": ("nmesh2d_face", x, LONGITUDE),
        "mesh2d_face_y": ("nmesh2d_face", y, LATITUDE),
        "mesh2d_face_nodes": (("nmesh2d_face", "max_nodes"), (triangles + 1).astype(np.int32),
                              {"start_index": np.int32(1), "cf_role": "face_node_connectivity"}),
        "mesh2d_ucx": (dims, east, EAST | place),
        "mesh2d_ucy": (dims, north, NORTH | place),
        "mesh2d_layer_sigma": ("mesh2d_nLayers", sigma, layers),
        "mesh2d_flowelem_bl": ("nmesh2d_face", np.full(count, -bed),
                               {"standard_name": "altitude", "units": "m", "positive": "up"} | place),
        "mesh2d_s1": (dims[:2], np.full((len(TIMES), count), rise),
                      {"standard_name": "sea_surface_height", "units": "m"} | place),
        "time": ("time", TIMES, HOURS),
    })  # fmt: skip


def projected(crs, x, y, mapping=None, units=None, unit=1.0):
    """A current along the axes of a projection or of a turned pole, with x and y alone.

    Args:
        mapping: attributes of the grid mapping; none is there if they are empty, all of the projection's if
            they are not given.
        units: of x and y, each of `unit` metres or degrees.

    Returns:
        The data set; longitude and latitude [ny, nx], and east and north [T, K, ny, nx] m/s of its points.
    """
    system = CRS.from_user_input(crs)
    lon, lat = Transformer.from_crs(system, 4326, always_xy=True).transform(*np.meshgrid(x, y))
    there = Transformer.from_crs(4326, system, always_xy=True)
    south, north = (np.stack(there.transform(lon, lat + side)) for side in (-1e-4, 1e-4))
    across, up = north - south
    if system.is_geographic:  # a degree of longitude of the turned sphere is the shorter one
        across = across * np.cos(np.deg2rad(y))[:, None]
    scale = 0.02 / max(np.ptp(lon), np.ptp(lat), 0.02)
    parts = [
        0.3 + scale * (part - 0.3)
        for part in flow(nearby(lon, lon.mean()), lat, DEPTHS[:, None, None], TIMES[:, None, None, None])
    ]
    stated = system.to_cf() if mapping is None else mapping
    stated = {
        key: value for key, value in stated.items() if isinstance(value, str | float | int | np.integer)
    }
    names = ("grid_longitude", "grid_latitude") if system.is_geographic else (
        "projection_x_coordinate", "projection_y_coordinate")  # fmt: skip
    units = units or ("degrees" if system.is_geographic else "m")
    fields = {
        name: (("time", "depth", "y", "x"), part, about | ({"grid_mapping": "crs"} if stated else {}))
        for name, part, about in zip(
            "uv", along(*parts, np.arctan2(across, up)), (ALONG_X, ALONG_Y), strict=True
        )
    }
    fields |= {
        "x": ("x", x / unit, {"units": units, "standard_name": names[0]}),
        "y": ("y", y / unit, {"units": units, "standard_name": names[1]}),
        "depth": ("depth", DEPTHS, DOWN),
        "time": ("time", TIMES, HOURS),
    }
    return xr.Dataset(fields | ({"crs": ((), np.int32(0), stated)} if stated else {})), lon, lat, *parts
