"""Files of models' real output: what is read is what netCDF4, xarray and NumPy alone find in them."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
import xarray as xr

from auvplan.io.currents import open_ocean, read_current
from auvplan.ocean.gridded import CurrentError
from auvplan.site import Site
from benchmarks.file_cases import CUTS, REAL
from benchmarks.files import at_nodes, farthest
from tests.conftest import SHARED

KINDS = (
    "roms", "curvilinear", "regular", "regular", "triangles", "roms", "curvilinear", "triangles", "regular",
    "triangles", "roms", "triangles", "regular", "regular", "curvilinear", "roms",
)  # fmt: skip


CASES = {case.name: (case, kind) for case, kind in zip([*REAL, *CUTS], KINDS, strict=True)}


@pytest.mark.parametrize("name", CASES)
def test_the_current_is_that_of_the_file_at_its_own_points(shared, tmp_path, name):
    """Without a current on land; D-Flow's axes are turned by true north of another ellipsoid."""
    case, kind = CASES[name]
    paths, options = case.prepare(tmp_path)
    table = case.reading(paths)
    first = np.zeros(table.east.shape, bool)
    first[[0, len(table.times) // 2]] = True
    table = replace(table, east=np.where(first, table.east, np.nan))
    if "crs" in options:
        with pytest.raises(CurrentError, match=r"does not name: say current\.crs, such as EPSG:32633"):
            open_ocean(paths)
    with open_ocean(paths, **options) as ocean:
        assert ocean.kind == kind
        np.testing.assert_allclose(ocean.times, table.times, atol=1e-3)
        assert farthest(ocean, at_nodes(table, np.random.default_rng(0))) < (
            5e-5 if "D-Flow" in case.model else 1e-6
        )
        dry = first & np.isnan(table.east) & np.isnan(table.north) & np.isfinite(table.depth)
        _, k, p = np.argwhere(dry & (kind != "triangles"))[:20].T
        depth = np.broadcast_to(table.depth[:1], table.east[:1].shape)[0, k, p]
        known = np.isfinite(table.longitude[p]) & np.isfinite(table.latitude[p])
        found = ocean.at(table.longitude[p][known], table.latitude[p][known], depth[known], ocean.times[0])
        assert np.isnan(found[0]).all()


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["mom5_access_om2_v"], "v has no partner"),
        (["roms_separate_his"], "u has no longitude: name the model's grid file beside it"),
        (["roms_separate_his", "roms_separate_grid"],
         r"ocean_time does not state the date .*: say current\.epoch"),
    ],
)  # fmt: skip
def test_files_that_need_another_or_a_setting(shared, names, words):
    with pytest.raises(CurrentError, match=words):
        open_ocean([shared / "data" / "elsewhere" / f"{name}.nc" for name in names])


def test_beyond_a_mesh_there_is_land(shared):
    """The corners of a box over an estuary lie outside its cells, with either answer to what lies outside."""
    path = shared / "data" / "elsewhere" / "creofs_selfe_noaa.nc"
    site = Site(-123.75, 46.2)
    with xr.open_dataset(path, decode_times=False, engine=None) as data:
        data.load()
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
    "norfjords160_roms_native_24h": (Site(5.673, 59.031), 350.0, 30.0),
    "norkyst_v3_800m_5h": (Site(5.99, 55.947), 2000.0, 6.0),
    "cmems_glo12_uo_vo_northsea": (Site(4.2, 53.5), 40e3, 6.0),
    "rtofs_water_u_v_washington_64x3h": (Site(-125.6, 47.9), 30e3, 0.0),
}


@pytest.fixture(scope="module", params=BOXES)
def real(request):
    path = SHARED / "data" / "currents" / f"{request.param}.nc"
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


def test_time_between_hours_is_linear(real):
    _, _, found = real
    source = found.source
    if source.kind == "roms":
        pytest.skip("levels move with the tide between hours")
    longitude, latitude = np.asarray(source.longitude).ravel()[7], np.asarray(source.latitude).ravel()[7]
    first, second = (source.at(longitude, latitude, 0.0, source.times[k])[0] for k in (0, 1))
    between = source.times[0] + (source.times[1] - source.times[0]) / 4
    assert np.isfinite(first)
    assert source.at(longitude, latitude, 0.0, between)[0] == pytest.approx(0.75 * first + 0.25 * second)


def test_the_field_is_the_files_current_between_the_nodes(real):
    """The planner's field and the file itself, rotated independently, at random places and times."""
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
    path = shared / "data" / "currents" / f"{next(iter(BOXES))}.nc"
    with xr.open_dataset(path, engine="h5netcdf") as data:
        longitude, latitude, depth = (data[name].values for name in ("lon_rho", "lat_rho", "h"))
        angle = float(data["angle"].values[5, 12])
    # Rows 3 and 5 of the mask have the sound's middle in columns 11 and 12.
    east = (longitude[5, 12] - longitude[3, 11]) * np.cos(np.deg2rad(latitude[4, 12]))
    axis = east + 1j * (latitude[5, 12] - latitude[3, 11])
    axis /= abs(axis)
    j, i = [4, 4, 4, 5], [11, 12, 13, 12]
    level = np.append(0.0, np.linspace(0.02, 0.98, 12))[:, None, None] * depth[j, i]
    with open_ocean(path) as ocean:
        e, n, _ = ocean.at(longitude[j, i], latitude[j, i], level, ocean.times[:, None])
    for part in (slice(0, 1), slice(1, None)):  # at the surface, and over the depth
        flow = (e + 1j * n)[part].mean(axis=0)
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
