"""Files of other projects: what is read is what xarray alone finds in them."""

from datetime import UTC, datetime

import numpy as np
import pytest
import xarray as xr
from pyproj import Proj

from auvplan.io.currents import open_ocean, read_current
from auvplan.ocean.gridded import CurrentError
from auvplan.site import Site

#: Places are compared in single precision of degrees; velocities are turned by angles of their own making.
TOLERANCE = 2e-6


@pytest.fixture
def elsewhere(shared):
    folder = shared / "data" / "elsewhere"
    if not folder.is_dir():
        pytest.skip(f"needs real data in {folder}")
    return folder


def raw(path):
    """A file's variables as xarray reads them, times as they stand."""
    with xr.open_dataset(path, decode_times=False, engine=None) as data:
        return data.load()


def turned(east, north, angle):
    """Components along axes turned from east by an angle, as east and north."""
    both = (east + 1j * north) * np.exp(1j * angle)
    return both.real, both.imag


def compare(ocean, longitude, latitude, depth, second, expected, seed=0, count=200, atol=TOLERANCE):
    """Compare east and north [P] at up to 200 places with those of `ocean`; NaN is NaN."""
    wet = np.flatnonzero(np.isfinite(expected[0]) & np.isfinite(depth))
    assert len(wet)
    chosen = np.random.default_rng(seed).choice(wet, min(count, len(wet)), replace=False)
    found = ocean.at(longitude[chosen], latitude[chosen], depth[chosen], second)
    np.testing.assert_allclose(found[:2], [part[chosen] for part in expected], atol=atol)
    return len(chosen)


def test_selfe_with_heights_of_its_levels(elsewhere):
    path = elsewhere / "creofs_selfe_noaa.nc"
    data = raw(path)
    with open_ocean(path) as ocean:
        assert (ocean.kind, ocean.levels) == ("triangles", None)
        heights = data["zval"].values[0].astype(float)
        surface = heights.max(axis=0)
        for level in range(heights.shape[0]):
            parts = [data[name].values[0, level].astype(float) for name in ("u", "v")]
            count = compare(
                ocean, data["lon"].values.astype(float), data["lat"].values.astype(float),
                surface - heights[level], float(ocean.times[0]), parts,
            )  # fmt: skip
            assert count == 200


def faces(data, u, v):
    """Means over the wet faces of each cell [K, ny, nx]; u[i] lies between the points i and i + 1."""
    mask = data["mask_rho"].values == 1
    ny, nx = mask.shape
    east, north = (np.full((u.shape[0], ny, nx), np.nan) for _ in range(2))
    for j, i in zip(*np.nonzero(mask), strict=True):
        for out, sides in (
            (east, [(u[:, j, k], mask[j, k] and mask[j, k + 1]) for k in (i - 1, i) if 0 <= k < nx - 1]),
            (north, [(v[:, k, i], mask[k, i] and mask[k + 1, i]) for k in (j - 1, j) if 0 <= k < ny - 1]),
        ):
            wet = [side for side, both in sides if both and np.isfinite(side).all()]
            if wet:
                out[:, j, i] = sum(wet) / len(wet)
    return east, north


def test_roms_cut_by_one_range_on_all_axes(elsewhere):
    paths = [elsewhere / f"nordic_roms_native_day{day}.nc" for day in (1, 2)]
    with open_ocean(paths) as ocean:
        assert ocean.kind == "roms"
        assert len(ocean.times) == 2
        for second, path in zip(ocean.times, paths, strict=True):
            data = raw(path)
            shape = data["lon_rho"].shape
            u, v = (data[name].values[0].astype(float) for name in ("u", "v"))
            assert u.shape[1:] == v.shape[1:] == shape
            east, north = turned(*faces(data, u, v), data["angle"].values)
            h, zeta, hc = data["h"].values, np.nan_to_num(data["zeta"].values[0]), float(data["hc"])
            s, curve = (data[name].values[:, None, None] for name in ("s_rho", "Cs_r"))
            depth = -(hc * s + h * curve) / (hc + h) * (zeta + h)
            for level in (34, 20, 5):
                compare(
                    ocean, data["lon_rho"].values.ravel(), data["lat_rho"].values.ravel(),
                    depth[level].ravel(), float(second), (east[level].ravel(), north[level].ravel()),
                )  # fmt: skip


def test_axes_of_a_polar_stereographic_projection(elsewhere):
    path = elsewhere / "arctic20_polar_stereographic.nc"
    data = raw(path)
    longitude, latitude = data["longitude"].values.ravel(), data["latitude"].values.ravel()
    straight = float(data["polar_stereographic"].attrs["straight_vertical_longitude_from_pole"])
    # Seen from above the pole, x turns from east by as much as the meridian from the straight one.
    angle = np.deg2rad(straight - longitude)
    with open_ocean(path) as ocean:
        assert ocean.kind == "curvilinear"
        for k, depth in enumerate(data["depth"].values):
            parts = [data[name].values[1, k].astype(float).ravel() for name in ("u", "v")]
            parts = turned(*parts, angle)
            level, second = np.full(len(angle), float(depth)), float(ocean.times[1])
            compare(ocean, longitude, latitude, level, second, parts, atol=1e-6)


def test_mom_with_components_in_files_of_their_own(elsewhere):
    paths = [elsewhere / f"mom5_access_om2_{name}.nc" for name in "vu"]
    data = [raw(path) for path in paths]
    with open_ocean(paths) as ocean:
        latitude, longitude = np.meshgrid(data[0]["yu_ocean"], data[0]["xu_ocean"], indexing="ij")
        for k, depth in enumerate(data[0]["st_ocean"].values):
            parts = [data[1]["u"].values[2, k].ravel(), data[0]["v"].values[2, k].ravel()]
            compare(
                ocean, longitude.ravel(), latitude.ravel(), np.full(longitude.size, float(depth)),
                float(ocean.times[2]), [part.astype(float) for part in parts],
            )  # fmt: skip
    with pytest.raises(CurrentError, match="v has no partner"):
        open_ocean(paths[0])


def test_a_mesh_in_projected_metres(elsewhere):
    path = elsewhere / "dflowfm_simplebox_projected.nc"
    data = raw(path)
    dutch = Proj("EPSG:28992")
    x, y = (data[f"mesh2d_face_{axis}"].values for axis in "xy")
    longitude, latitude = dutch(x, y, inverse=True)
    angle = -np.deg2rad(dutch.get_factors(longitude, latitude).meridian_convergence)
    parts = [data[f"mesh2d_uc{axis}"].values[7].astype(float) for axis in "xy"]
    with open_ocean(path) as ocean:
        # The ellipsoid of the projection lies some 100 m off that of GPS.
        np.testing.assert_allclose(ocean.longitude, longitude, atol=3e-3)
        np.testing.assert_allclose(ocean.latitude, latitude, atol=3e-3)
        compare(
            ocean, ocean.longitude, ocean.latitude, np.zeros(len(x)), float(ocean.times[7]),
            turned(*parts, angle), atol=5e-5,
        )  # fmt: skip


@pytest.fixture
def schism(elsewhere, tmp_path):
    """SCHISM's scribed output: mesh, levels and each component in a file of its own; the data."""
    mesh, levels = (elsewhere / f"schism_{name}_1.nc" for name in ("out2d", "zCoordinates"))
    data = raw(levels)
    heights = data["zCoordinates"]
    paths, values = [mesh, levels], []
    for k, name in enumerate(("horizontalVelX", "horizontalVelY")):
        part = (0.3 - 0.5 * k) * (1.0 + 0.01 * heights + 0.001 * np.arange(heights.shape[1])[None, :, None])
        part = part.astype("float32").rename(name)
        part.attrs = {"mesh": "SCHISM_hgrid", "location": "node"}
        part = part.drop_vars(["SCHISM_hgrid_node_x", "SCHISM_hgrid_node_y"])
        part.to_netcdf(tmp_path / f"{name}.nc", engine="h5netcdf")
        paths.append(tmp_path / f"{name}.nc")
        values.append(part.values.astype(float))
    return paths, data, values


def test_schism_with_variables_in_files_of_their_own(schism):
    paths, data, values = schism
    with pytest.raises(CurrentError, match=r"does not name: say current\.crs, such as EPSG:32633"):
        open_ocean(paths)
    zone = Proj("EPSG:26910")
    corners = [data[f"SCHISM_hgrid_node_{axis}"].values for axis in "xy"]
    longitude, latitude = zone(*corners, inverse=True)
    angle = -np.deg2rad(zone.get_factors(longitude, latitude).meridian_convergence)
    with open_ocean(paths, crs=26910) as ocean:
        np.testing.assert_allclose(ocean.longitude, longitude, atol=1e-5)
        heights = data["zCoordinates"].values[3].astype(float)
        surface = np.nanmax(heights, axis=1)
        for level in (22, 15):
            parts = turned(values[0][3, :, level], values[1][3, :, level], angle)
            depth, second = surface - heights[:, level], float(ocean.times[3])
            compare(ocean, ocean.longitude, ocean.latitude, depth, second, parts, atol=1e-5)


def test_roms_with_its_grid_in_another_file_and_no_date(elsewhere):
    paths = [elsewhere / f"roms_separate_{name}.nc" for name in ("his", "grid")]
    with pytest.raises(CurrentError, match=r"u has no longitude: name the model's grid file beside it"):
        open_ocean(paths[0])
    with pytest.raises(CurrentError, match=r"ocean_time does not tell the date .*: say current\.epoch"):
        open_ocean(paths)
    his, grid = (raw(path) for path in paths)
    with open_ocean(paths, epoch=datetime(1970, 1, 1, tzinfo=UTC)) as ocean:
        np.testing.assert_allclose(ocean.times, his["ocean_time"].values)
        assert "mask_rho says land everywhere: left out" in ocean.notes
        u, v = (his[name].values[2].astype(float) for name in ("u", "v"))
        east, north = faces(grid.assign(mask_rho=grid["mask_rho"] + 1.0), u, v)
        h, hc = grid["h"].values, float(his["hc"])
        s, curve = (his[name].values[:, None, None] for name in ("s_rho", "Cs_r"))
        depth = -(hc * s + (h - hc) * curve)
        assert float(his["Vtransform"]) == 1.0
        for level in range(3):
            compare(
                ocean, grid["lon_rho"].values.ravel(), grid["lat_rho"].values.ravel(), depth[level].ravel(),
                float(ocean.times[2]), (east[level].ravel(), north[level].ravel()), atol=1e-4,
            )  # fmt: skip


def test_fvcom_of_one_time(elsewhere):
    path = elsewhere / "ngofs_fvcom_small.nc"
    data = raw(path)
    with open_ocean(path) as ocean:
        parts = [data[name].values[0].astype(float) for name in ("u", "v")]
        places = [data[name].values.astype(float) for name in ("lonc", "latc")]
        compare(ocean, *places, np.zeros(len(parts[0])), float(ocean.times[0]), parts)


def test_beyond_a_mesh_there_is_land(elsewhere):
    """The corners of a box over an estuary lie outside its cells, with either answer to what lies outside."""
    path = elsewhere / "creofs_selfe_noaa.nc"
    site = Site(-123.75, 46.2)
    box = {"lower": (-9000.0, -16000.0, 0.0), "upper": (9000.0, 16000.0, 5.0), "spacing": 100.0}
    inside = in_a_cell(raw(path), "ele", "lon", "lat", site)
    with pytest.raises(CurrentError, match=r"of the box is not covered"):
        read_current(path, site, **box)
    for options in ({"outside": "clamp"}, {"land": "mesh"}, {"land": lambda north, east: north > -1e9}):
        found = read_current(path, site, **box, **options)
        water = np.array([inside(x, y) for x, y in np.argwhere(found.water) * found.spacing + found.origin])
        assert water.all()
        assert 0.05 < found.water.mean() < 0.9
        assert np.isnan(found.sea_floor[~found.covered]).all()


def in_a_cell(data, cells, longitude, latitude, site):
    """Whether a local place lies in a cell of a mesh, by shapely."""
    import shapely

    north, east = site.to_local(data[longitude].values.astype(float), data[latitude].values.astype(float))
    corners = data[cells].values.astype(int).T - 1
    ring = np.stack([north[corners], east[corners]], axis=-1)
    polygons = shapely.polygons(np.concatenate([ring, ring[:, :1]], axis=1))
    tree = shapely.STRtree(polygons)

    def inside(x, y):
        return len(tree.query(shapely.Point(x, y), predicate="dwithin", distance=0.5)) > 0

    return inside
