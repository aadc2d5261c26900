"""The four files of real model output: what is read is what is in them."""

import numpy as np
import pytest
import xarray as xr

from auvplan.io.currents import open_ocean, read_current
from auvplan.site import Site

#: File, a site in it, half the side of a box that it covers, m, and a depth.
FILES = {
    "norfjords160_roms_native_24h.nc": (Site(5.673, 59.031), 350.0, 30.0),
    "norkyst_v3_800m_5h.nc": (Site(5.99, 55.947), 2000.0, 6.0),
    "cmems_glo12_uo_vo_northsea.nc": (Site(4.2, 53.5), 40e3, 6.0),
    "rtofs_water_u_v_washington_64x3h.nc": (Site(-125.6, 47.9), 30e3, 0.0),
}


@pytest.fixture(scope="module", params=FILES)
def real(request):
    from tests.conftest import SHARED

    path = SHARED / "data" / "currents" / request.param
    if not path.is_file():
        pytest.skip(f"needs real data in {path}")
    site, half, depth = FILES[request.param]
    found = read_current(path, site, lower=(-half, -half, 0), upper=(half, half, depth))
    yield path, site, found
    found.source.close()


def table(path):
    """East, north [T, K, points], longitude, latitude, depths [T, K, points], times, by xarray and NumPy."""
    engine = "scipy" if "rtofs" in path.name else "h5netcdf"
    with xr.open_dataset(path, engine=engine) as data:
        data.load()
    if "norfjords" in path.name:
        return roms_table(data)
    names = [name for name in ("uo", "water_u", "u_eastward") if name in data]
    pair = names[0], {"uo": "vo", "water_u": "water_v", "u_eastward": "v_northward"}[names[0]]
    longitude = data["lon"] if "lon" in data else data["longitude"]
    latitude = data["lat"] if "lat" in data else data["latitude"]
    if longitude.ndim == 1:
        latitude, longitude = np.meshgrid(latitude.values, longitude.values, indexing="ij")
    east, north = (data[name].values.astype(float) for name in pair)
    depths = data["depth"].values.astype(float) if "depth" in data else np.zeros(1)
    shape = (len(data["time"]), len(depths), np.size(longitude))
    levels = np.broadcast_to(depths[:, None], shape)
    places = [np.asarray(values, float).ravel() for values in (longitude, latitude)]
    return east.reshape(shape), north.reshape(shape), *places, levels, data["time"].values


def roms_table(data):
    """Means over the two faces of each cell that are water, turned by the angle; levels by Vtransform 2."""
    with np.errstate(invalid="ignore"):
        u, v = data["u"].values, data["v"].values
        east, north = (np.full((24, 35, 10, 15), np.nan) for _ in range(2))
        for j, i in zip(*np.nonzero(data["mask_rho"].values == 1), strict=True):
            for out, faces in (
                (east, [u[:, :, j, k] for k in (i - 1, i) if 0 <= k < 14]),
                (north, [v[:, :, k, i] for k in (j - 1, j) if 0 <= k < 9]),
            ):
                wet = [face for face in faces if np.isfinite(face).all()]
                if wet:
                    out[:, :, j, i] = sum(wet) / len(wet)
    turned = (east + 1j * north) * np.exp(1j * data["angle"].values)
    h, zeta, hc = data["h"].values, np.nan_to_num(data["zeta"].values)[:, None], float(data["hc"])
    s, curve = (data[name].values[:, None, None] for name in ("s_rho", "Cs_r"))
    z = zeta + (zeta + h) * (hc * s + h * curve) / (hc + h)
    levels = (zeta - z)[:, ::-1]
    shape = (24, 35, 150)
    values = [part[:, ::-1].reshape(shape) for part in (turned.real, turned.imag)]
    places = [data[name].values.ravel() for name in ("lon_rho", "lat_rho")]
    return *values, *places, levels.reshape(shape), data["ocean_time"].values


def test_sampler_is_exact_at_the_files_own_points(real):
    path, _, found = real
    east, north, longitude, latitude, levels, times = table(path)
    rng = np.random.default_rng(1)
    water = np.argwhere(np.isfinite(east) & np.isfinite(north))
    t, k, p = water[rng.choice(len(water), 60, replace=False)].T
    e, n, _ = found.source.at(longitude[p], latitude[p], levels[t, k, p], times[t])
    np.testing.assert_allclose(e, east[t, k, p], atol=2e-6)
    np.testing.assert_allclose(n, north[t, k, p], atol=2e-6)


def test_land_is_missing_and_never_zero(real):
    path, _, found = real
    east, north, longitude, latitude, levels, times = table(path)
    land = np.argwhere(~(np.isfinite(east) & np.isfinite(north)).any(axis=(0, 1))).ravel()[:20]
    if not len(land):
        pytest.skip("no land in this file")
    e, n, _ = found.source.at(longitude[land], latitude[land], levels[0, 0, land], times[0])
    assert np.isnan(e).all()
    assert np.isnan(n).all()


def test_nodes_of_the_local_grid_are_the_samplers_values(real):
    _, site, found = real
    field = found.field
    nodes = [found.origin[k] + found.spacing[k] * np.arange(field.u.shape[2 + k]) for k in range(2)]
    x, y = np.meshgrid(*nodes, indexing="ij")
    longitude, latitude = site.to_geographic(x, y)
    bearing = site.true_north(longitude, latitude)
    for frame in (0, len(field.times) - 1):
        for k, depth in enumerate(np.asarray(field.depths)):
            moment = found.source.times[frame]
            e, n, up = found.source.at(longitude, latitude, found_depth(found, depth), moment)
            wet = np.asarray(field.water)[k]
            u = n * np.cos(bearing) - e * np.sin(bearing)
            v = n * np.sin(bearing) + e * np.cos(bearing)
            np.testing.assert_allclose(np.asarray(field.u)[frame, k][wet], u[wet], atol=1e-6)
            np.testing.assert_allclose(np.asarray(field.v)[frame, k][wet], v[wet], atol=1e-6)
            assert (field.w is None) == (up is None)
            if up is not None:
                np.testing.assert_allclose(np.asarray(field.w)[frame, k][wet], -up[wet], atol=1e-7)


def found_depth(found, depth):
    """The depth in double precision: the field's is single."""
    levels = found.source.levels
    return depth if levels is None else levels[np.abs(levels - depth).argmin()]


def test_time_between_hours_is_linear(real):
    path, _, found = real
    east, _, longitude, latitude, levels, times = table(path)
    if found.source.kind == "roms":
        pytest.skip("levels move with the tide between hours")
    t, k, p = np.argwhere(np.isfinite(east[:-1]) & np.isfinite(east[1:]))[7]
    between = times[t] + (times[t + 1] - times[t]) // 4
    e, _, _ = found.source.at(longitude[p], latitude[p], levels[t, k, p], between)
    assert e == pytest.approx(0.75 * east[t, k, p] + 0.25 * east[t + 1, k, p], abs=1e-6)


def test_the_field_is_the_files_current_between_the_nodes(real):
    """The planner's field and the file itself, both rotated independently, at random places and times."""
    _, site, found = real
    rng = np.random.default_rng(2)
    field, half = found.field, -found.origin[0]
    x, y = rng.uniform(-half, half, (2, 200))
    z = rng.uniform(float(field.depths[0]), float(field.depths[-1]) + 1e-6, 200)
    t = rng.uniform(0.0, float(field.times[-1]), 200)
    u, v, _ = (np.asarray(part) for part in field(x, y, z, t))
    places = site.to_geographic(x, y)
    e, n, _ = found.source.at(*places, z, found.source.times[0] + t)
    wet = np.isfinite(e)
    assert wet.mean() > 0.5
    error = np.hypot(u - n, v - e)[wet]
    # The site is near enough for true north; what is left is the interpolation on another grid.
    assert np.median(error) < 0.15 * np.median(np.hypot(e, n)[wet])


def test_sound_currents_run_along_the_sound(shared):
    """Between the islet and the mainland the water can only go along; unrotated it would go across."""
    path = shared / "data" / "currents" / "norfjords160_roms_native_24h.nc"
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
            cosine = np.abs((flow * axis.conj()).real) / np.abs(flow)
            unturned = np.abs((flow * np.exp(-1j * angle) * axis.conj()).real) / np.abs(flow)
            assert cosine.mean() > 0.94
            assert unturned.mean() < 0.45


def test_real_notes_and_floor(real):
    path, _, found = real
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
