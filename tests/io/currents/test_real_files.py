"""Files of models' real output: what is read is what xarray and NumPy alone find in them."""

from datetime import UTC, datetime

import numpy as np
import pytest
import shapely
import xarray as xr
from pyproj import Proj

from auvplan.io.currents import open_ocean, read_current
from auvplan.ocean.gridded import CurrentError
from auvplan.site import Site


def raw(path):
    """A file's variables as xarray reads them, times as they stand."""
    with xr.open_dataset(path, decode_times=False, engine=None) as data:
        return data.load()


def turned(east, north, angle):
    """Components along axes turned from east by an angle, as east and north."""
    both = (east + 1j * north) * np.exp(1j * angle)
    return both.real, both.imag


def faces(mask, u, v):
    """Means over the wet faces of each cell [..., ny, nx]; u[i] lies between the points i and i + 1."""
    wet, found = mask == 1, []
    for part, axis in ((u, -1), (v, -2)):
        inner = [slice(None)] * part.ndim
        inner[axis] = slice(0, wet.shape[axis] - 1)
        pair = np.moveaxis(wet, axis, -1)
        both = np.moveaxis(pair[..., :-1] & pair[..., 1:], -1, axis)
        side = np.where(both, part[tuple(inner)].astype(float), np.nan)
        pad = [[(0, 0)] * (part.ndim + axis) + [ends] + [(0, 0)] * (-axis - 1) for ends in ((1, 0), (0, 1))]
        sides = np.stack([np.pad(side, ends, constant_values=np.nan) for ends in pad])
        with np.errstate(invalid="ignore"):
            found.append(np.where(wet, np.nansum(sides, axis=0) / np.isfinite(sides).sum(axis=0), np.nan))
    return found


def s_levels(grid, data, zeta):
    """Depth of the levels of ROMS below the surface [K, ny, nx], m."""
    h, hc = grid["h"].values, float(data["hc"])
    s, curve = (data[name].values[:, None, None] for name in ("s_rho", "Cs_r"))
    if float(data.get("Vtransform", 2.0)) == 1.0:
        return -(hc * s + (h - hc) * curve)
    return -(hc * s + h * curve) / (hc + h) * (np.nan_to_num(zeta) + h)


# Each function yields longitude, latitude and depth of points, the number of a time, and the current there.


def roms(ocean, *parts):
    for number, data in enumerate(parts):
        zeta = data["zeta"].values
        frame = len(zeta) // 2
        u, v = (data[name].values[frame] for name in ("u", "v"))
        parts_ = turned(*faces(data["mask_rho"].values, u, v), data["angle"].values)
        depth = s_levels(data, data, zeta[frame])
        for level in (-1, len(depth) // 2, 5):
            yield data["lon_rho"], data["lat_rho"], depth[level], number + frame, [p[level] for p in parts_]


def roms_with_its_grid(ocean, his, grid):
    assert "mask_rho says land everywhere: left out" in ocean.notes
    np.testing.assert_allclose(ocean.times, his["ocean_time"].values)
    east, north = faces(np.ones(grid["h"].shape), his["u"].values[2], his["v"].values[2])
    depth = s_levels(grid, his, 0.0)
    for k in range(3):
        yield grid["lon_rho"], grid["lat_rho"], depth[k], 2, (east[k], north[k])


def regular(ocean, *parts):
    """Files of each component, or one of both."""
    data = xr.merge(parts, compat="override") if len(parts) > 1 else parts[0]
    u = next(name for name in ("uo", "water_u", "u_eastward", "u") if name in data)
    v = {"uo": "vo", "water_u": "water_v", "u_eastward": "v_northward", "u": "v"}[u]
    dims = data[u].dims
    places = [next(n for n in names if n in data) for names in (("lon", "longitude", "xu_ocean"),
                                                                ("lat", "latitude", "yu_ocean"))]  # fmt: skip
    lon, lat = (data[name] for name in places)
    if lon.ndim == 1:
        lat, lon = xr.broadcast(lat, lon)
    angle = 0.0
    if "polar_stereographic" in data:
        # Seen from above the pole, x turns from east by as much as the meridian from the straight one.
        straight = float(data["polar_stereographic"].attrs["straight_vertical_longitude_from_pole"])
        angle = np.deg2rad(straight - lon.values)
    level = next((dim for dim in dims if dim in ("depth", "st_ocean")), None)
    for number in {0, len(ocean.times) - 1}:
        for k, depth in enumerate(data[level].values if level else [0.0]):
            parts_ = [data[n].isel({dims[0]: number} | ({level: k} if level else {})).values for n in (u, v)]
            yield lon, lat, np.full(lon.shape, float(depth)), number, turned(*parts_, angle)


def selfe(ocean, data):
    heights = data["zval"].values[0].astype(float)
    for level in range(heights.shape[0]):
        parts = [data[name].values[0, level] for name in ("u", "v")]
        yield data["lon"], data["lat"], heights.max(axis=0) - heights[level], 0, parts


def fvcom(ocean, data):
    yield data["lonc"], data["latc"], np.zeros(data.sizes["nele"]), 0, [data[n].values[0] for n in ("u", "v")]


def convergence(zone, x, y):
    longitude, latitude = zone(x, y, inverse=True)
    angle = -np.deg2rad(zone.get_factors(longitude, latitude).meridian_convergence)
    return longitude, latitude, angle


def dflow(ocean, data):
    longitude, latitude, angle = convergence(
        Proj("EPSG:28992"), *(data[f"mesh2d_face_{axis}"].values for axis in "xy")
    )
    # The ellipsoid of the projection lies some 100 m off that of GPS.
    np.testing.assert_allclose(ocean.longitude, longitude, atol=3e-3)
    np.testing.assert_allclose(ocean.latitude, latitude, atol=3e-3)
    parts = [data[f"mesh2d_uc{axis}"].values[7].astype(float) for axis in "xy"]
    yield ocean.longitude, ocean.latitude, np.zeros(len(longitude)), 7, turned(*parts, angle)


#: Files, what kind they are, their values, options, and the tolerance: places are compared in single
#: precision of degrees; velocities are turned by angles of their own making.
FILES = {
    "norfjords": (["currents/norfjords160_roms_native_24h.nc"], "roms", roms, {}, 2e-6),
    "norkyst": (["currents/norkyst_v3_800m_5h.nc"], "curvilinear", regular, {}, 2e-6),
    "cmems": (["currents/cmems_glo12_uo_vo_northsea.nc"], "regular", regular, {}, 2e-6),
    "rtofs": (["currents/rtofs_water_u_v_washington_64x3h.nc"], "regular", regular, {}, 2e-6),
    "selfe": (["elsewhere/creofs_selfe_noaa.nc"], "triangles", selfe, {}, 2e-6),
    "nordic": ([f"elsewhere/nordic_roms_native_day{day}.nc" for day in (1, 2)], "roms", roms, {}, 2e-6),
    "arctic20": (["elsewhere/arctic20_polar_stereographic.nc"], "curvilinear", regular, {}, 1e-6),
    "mom5": ([f"elsewhere/mom5_access_om2_{name}.nc" for name in "vu"], "regular", regular, {}, 2e-6),
    "dflow": (["elsewhere/dflowfm_simplebox_projected.nc"], "triangles", dflow, {}, 5e-5),
    "separate": ([f"elsewhere/roms_separate_{name}.nc" for name in ("his", "grid")], "roms",
                 roms_with_its_grid, {"epoch": datetime(1970, 1, 1, tzinfo=UTC)}, 1e-4),
    "fvcom": (["elsewhere/ngofs_fvcom_small.nc"], "triangles", fvcom, {}, 2e-6),
}  # fmt: skip


def compare(ocean, rows, atol):
    """Compare east and north at 200 places of each row; on the land of the first there is no current."""
    for count, (longitude, latitude, depth, number, expected) in enumerate(rows):
        flat = [np.asarray(part, float).ravel() for part in (longitude, latitude, depth, *expected)]
        wet = np.isfinite(flat).all(axis=0)
        chosen = np.random.default_rng(0).choice(np.flatnonzero(wet), min(200, wet.sum()), replace=False)
        lon, lat, z, east, north = (part[chosen] for part in flat)
        found = ocean.at(lon, lat, z, float(ocean.times[number]))
        np.testing.assert_allclose(found[:2], (east, north), atol=atol)
        if count == 0 and ocean.kind != "triangles":
            dry = np.isfinite(flat[2]) & ~np.isfinite(flat[3]) & ~np.isfinite(flat[4])
            places = (part[np.flatnonzero(dry)[:20]] for part in flat[:3])
            assert np.isnan(ocean.at(*places, float(ocean.times[number]))[0]).all()


@pytest.mark.parametrize("name", FILES)
def test_the_current_is_that_of_the_file_at_its_own_points(shared, name):
    names, kind, rows, options, atol = FILES[name]
    paths = [shared / "data" / part for part in names]
    if not paths[0].is_file():
        pytest.skip(f"needs real data in {paths[0].parent}")
    with open_ocean(paths, **options) as ocean:
        assert ocean.kind == kind
        assert len(ocean.times) >= len(paths) or name in ("mom5", "separate")
        compare(ocean, rows(ocean, *map(raw, paths)), atol)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["mom5_access_om2_v"], "v has no partner"),
        (["roms_separate_his"], "u has no longitude: name the model's grid file beside it"),
        (["roms_separate_his", "roms_separate_grid"],
         r"ocean_time does not tell the date .*: say current\.epoch"),
    ],
)  # fmt: skip
def test_files_that_need_another_or_a_setting(shared, names, words):
    with pytest.raises(CurrentError, match=words):
        open_ocean([shared / "data" / "elsewhere" / f"{name}.nc" for name in names])


def test_schism_with_variables_in_files_of_their_own(shared, tmp_path):
    """SCHISM's scribed output: mesh, levels and each component in a file of its own."""
    paths = [shared / "data" / "elsewhere" / f"schism_{name}_1.nc" for name in ("out2d", "zCoordinates")]
    data = raw(paths[1])
    heights = data["zCoordinates"].drop_vars(["SCHISM_hgrid_node_x", "SCHISM_hgrid_node_y"])
    values = []
    for k, name in enumerate(("horizontalVelX", "horizontalVelY")):
        part = (0.3 - 0.5 * k) * (1.0 + 0.01 * heights + 0.001 * np.arange(heights.shape[1])[None, :, None])
        part = part.astype("float32").rename(name)
        part.attrs = {"mesh": "SCHISM_hgrid", "location": "node"}
        part.to_netcdf(tmp_path / f"{name}.nc", engine="h5netcdf")
        paths.append(tmp_path / f"{name}.nc")
        values.append(part.values.astype(float))
    with pytest.raises(CurrentError, match=r"does not name: say current\.crs, such as EPSG:32633"):
        open_ocean(paths)
    corners = [data[f"SCHISM_hgrid_node_{axis}"].values for axis in "xy"]
    longitude, _, angle = convergence(Proj("EPSG:26910"), *corners)
    level = heights.values[3].astype(float)
    with open_ocean(paths, crs=26910) as ocean:
        np.testing.assert_allclose(ocean.longitude, longitude, atol=1e-5)
        rows = (
            (ocean.longitude, ocean.latitude, np.nanmax(level, axis=1) - level[:, k], 3,
             turned(*(part[3, :, k] for part in values), angle))
            for k in (22, 15)
        )  # fmt: skip
        compare(ocean, rows, 1e-5)


def test_beyond_a_mesh_there_is_land(shared):
    """The corners of a box over an estuary lie outside its cells, with either answer to what lies outside."""
    path = shared / "data" / "elsewhere" / "creofs_selfe_noaa.nc"
    data, site = raw(path), Site(-123.75, 46.2)
    box = {"lower": (-9000.0, -16000.0, 0.0), "upper": (9000.0, 16000.0, 5.0), "spacing": 250.0}
    corners = data["ele"].values.astype(int).T - 1
    places = site.to_local(*(data[name].values.astype(float) for name in ("lon", "lat")))
    ring = np.stack([axis[corners] for axis in places], axis=-1)
    cells = shapely.STRtree(shapely.polygons(np.concatenate([ring, ring[:, :1]], axis=1)))
    with pytest.raises(CurrentError, match=r"of the box is not covered"):
        read_current(path, site, **box)
    for options in ({"outside": "clamp"}, {"land": "mesh"}, {"land": lambda north, east: north > -1e9}):
        found = read_current(path, site, **box, **options)
        water = shapely.points(np.argwhere(found.water) * found.spacing + found.origin)
        inside = cells.query(water, predicate="dwithin", distance=0.5)[0]
        assert len(set(inside.tolist())) == len(water)
        assert 0.05 < found.water.mean() < 0.9
        assert np.isnan(found.sea_floor[~found.covered]).all()


#: Of four files: a site in each, half the side of a box that it covers, m, and a depth.
BOXES = {
    "norfjords": (Site(5.673, 59.031), 350.0, 30.0),
    "norkyst": (Site(5.99, 55.947), 2000.0, 6.0),
    "cmems": (Site(4.2, 53.5), 40e3, 6.0),
    "rtofs": (Site(-125.6, 47.9), 30e3, 0.0),
}


@pytest.fixture(scope="module", params=BOXES)
def real(request):
    from tests.conftest import SHARED

    path = SHARED / "data" / FILES[request.param][0][0]
    if not path.is_file():
        pytest.skip(f"needs real data in {path}")
    site, half, depth = BOXES[request.param]
    found = read_current(path, site, lower=(-half, -half, 0), upper=(half, half, depth))
    yield path, site, found
    found.source.close()


def test_nodes_of_the_local_grid_are_the_samplers_values(real):
    _, site, found = real
    field = found.field
    nodes = [found.origin[k] + found.spacing[k] * np.arange(field.u.shape[2 + k]) for k in range(2)]
    longitude, latitude = site.to_geographic(*np.meshgrid(*nodes, indexing="ij"))
    bearing = site.true_north(longitude, latitude)
    for frame in (0, len(field.times) - 1):
        for k, depth in enumerate(np.asarray(field.depths)):
            moment = found.source.times[frame]
            e, n, up = found.source.at(longitude, latitude, found_depth(found, depth), moment)
            wet = np.asarray(field.water)[k]
            parts = [n * np.cos(bearing) - e * np.sin(bearing), n * np.sin(bearing) + e * np.cos(bearing)]
            assert (field.w is None) == (up is None)
            for values, expected in zip((field.u, field.v), parts, strict=True):
                np.testing.assert_allclose(np.asarray(values)[frame, k][wet], expected[wet], atol=1e-6)
            if up is not None:
                np.testing.assert_allclose(np.asarray(field.w)[frame, k][wet], -up[wet], atol=1e-7)


def found_depth(found, depth):
    """The depth in double precision: the field's is single."""
    levels = found.source.levels
    return depth if levels is None else levels[np.abs(levels - depth).argmin()]


def test_the_field_is_the_files_current_between_the_nodes(real):
    """The planner's field and the file itself, both rotated independently, at random places and times."""
    _, site, found = real
    rng = np.random.default_rng(2)
    field, half = found.field, -found.origin[0]
    x, y = rng.uniform(-half, half, (2, 200))
    z = rng.uniform(float(field.depths[0]), float(field.depths[-1]) + 1e-6, 200)
    t = rng.uniform(0.0, float(field.times[-1]), 200)
    u, v, _ = (np.asarray(part) for part in field(x, y, z, t))
    e, n, _ = found.source.at(*site.to_geographic(x, y), z, found.source.times[0] + t)
    wet = np.isfinite(e)
    assert wet.mean() > 0.5
    error = np.hypot(u - n, v - e)[wet]
    # The site is near enough for true north; what is left is the interpolation on another grid.
    assert np.median(error) < 0.15 * np.median(np.hypot(e, n)[wet])


def test_sound_currents_run_along_the_sound(shared):
    """Between the islet and the mainland the water can only go along; unrotated it would go across."""
    path = shared / "data" / FILES["norfjords"][0][0]
    with xr.open_dataset(path, engine="h5netcdf") as data:
        longitude, latitude, depth = (data[name].values for name in ("lon_rho", "lat_rho", "h"))
        angle = float(data["angle"].values[5, 12])
    # Rows 3 and 5 of the mask have the sound's middle in columns 11 and 12.
    east = (longitude[5, 12] - longitude[3, 11]) * np.cos(np.deg2rad(latitude[4, 12]))
    axis = east + 1j * (latitude[5, 12] - latitude[3, 11])
    axis /= abs(axis)
    j, i = [4, 4, 4, 5], [11, 12, 13, 12]
    with open_ocean(path) as ocean:
        for shares in ([0.0], np.linspace(0.02, 0.98, 12)):
            level = np.asarray(shares)[:, None, None] * depth[j, i]
            e, n, _ = ocean.at(longitude[j, i], latitude[j, i], level, ocean.times[:, None])
            flow = (e + 1j * n).mean(axis=0)
            for turn, least, most in ((0.0, 0.94, 1.0), (-angle, 0.0, 0.45)):
                cosine = np.abs((flow * np.exp(1j * turn) * axis.conj()).real) / np.abs(flow)
                assert least < cosine.mean() < most


def test_real_times_notes_and_floor(real):
    path, _, found = real
    with xr.open_dataset(path, engine=None) as data:
        time = next(data[name] for name in ("time", "ocean_time") if name in data.variables)
        seconds = time.values.astype("datetime64[ns]").astype(float) / 1e9
    np.testing.assert_allclose(found.source.times, seconds, atol=1e-3)
    if "rtofs" in path.name:
        assert "water_u has no units: taken as m/s" in found.notes
    if "norkyst" in path.name:
        assert found.notes == ()
        assert 44.0 < found.sea_floor.min() < found.sea_floor.max() < 47.0
    if "norfjords" in path.name:
        assert 5.0 < np.nanmin(found.sea_floor) < np.nanmax(found.sea_floor) < 69.0
        assert (np.isfinite(found.sea_floor) == found.water).all()
    if "cmems" in path.name:
        assert found.sea_floor is None
