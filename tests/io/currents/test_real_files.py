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
from tests.io.refusals import refusal

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
        refusal(CurrentError, r"does not name: say current\.crs, such as EPSG:32633", open_ocean, paths)
    with open_ocean(paths, **options) as ocean:
        assert ocean.kind == kind
        np.testing.assert_allclose(ocean.times, table.times, atol=1e-3)
        far = farthest(ocean, at_nodes(table, np.random.default_rng(0)))
        assert far < (5e-5 if "D-Flow" in case.model else 1e-6)
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
    refusal(CurrentError, words, open_ocean, [shared / "data" / "elsewhere" / f"{name}.nc" for name in names])


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
    refusal(CurrentError, "of the box is not covered", read_current, path, site, **box)
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


@pytest.mark.parametrize("name", BOXES)
def test_nodes_of_the_local_grid_are_the_samplers_values(shared, name):
    site, half, depth = BOXES[name]
    path, box = shared / "data" / "currents" / f"{name}.nc", ((-half, -half, 0), (half, half, depth))
    found = read_current(path, site, lower=box[0], upper=box[1])
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
    found.source.close()


def found_depth(found, depth):
    """The depth in double precision: the field's is single."""
    levels = found.source.levels
    return depth if levels is None else levels[np.abs(levels - depth).argmin()]
