"""Files of all models, real and made: what is read is what other means find in them.

Of real files that is what netCDF4, xarray and NumPy alone read, of made ones their closed form.
"""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import shapely
import xarray as xr

from auvplan.io.currents import open_ocean, read_current, to_cf
from auvplan.ocean.gridded import CurrentError
from auvplan.site import Site
from benchmarks.file_models import CUTS, MADE, REAL
from benchmarks.files import at_nodes, between, farthest, inside, on_local_grid
from tests.io.refusals import refusal

KINDS = (
    "roms", "curvilinear", "regular", "regular", "triangles", "roms", "curvilinear", "triangles", "regular",
    "triangles", "roms", "triangles", "regular", "regular", "curvilinear", "roms",
)  # fmt: skip
CASES = {case.name: (case, kind) for case, kind in zip([*REAL, *CUTS], KINDS, strict=True)}
OF_MODELS = {f"{model}: {name}": maker for name, model, maker in MADE}


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


@pytest.mark.parametrize("name", OF_MODELS)
def test_the_current_is_the_models_and_so_is_its_form(tmp_path, name):
    """At points, between them and inside cells; what is indexed of the form is that part of all of it."""
    paths, options, table = OF_MODELS[name](tmp_path)
    rng = np.random.default_rng(0)
    asked = [one for places in (at_nodes, between, inside) for one in islice(places(table, rng), 40)]
    with open_ocean(paths, **options) as ocean:
        assert farthest(ocean, iter(asked)) < 1e-6
        whole, form = to_cf(ocean), ocean.form
        for variable, values in whole.data_vars.items():
            part = {dim: rng.integers(0, size, 2) if k % 2 else slice(0, size, 2) if k else int(size - 1)
                    for k, (dim, size) in enumerate(values.sizes.items())}  # fmt: skip
            np.testing.assert_allclose(form[variable].isel(part), values.isel(part), rtol=1e-6)
        again = open_ocean(whole)
        np.testing.assert_allclose(again.times, ocean.times)
        assert (again.levels is None) == (ocean.levels is None)
        assert farthest(again, iter(asked)) < 2e-6


_LOCAL = [name for name in OF_MODELS if name.split(":")[0] in ("MOM6", "SCHISM", "POP", "FVCOM")]


@pytest.mark.parametrize("name", [*_LOCAL, *(case.name for case in REAL[:2])])
def test_the_planners_grid_has_the_current_of_the_file(request, tmp_path, name):
    """Turned into the local frame, and in single precision."""
    if name in OF_MODELS:
        paths, options, table = OF_MODELS[name](tmp_path)
    else:
        request.getfixturevalue("shared")
        paths, options = CASES[name][0].prepare(tmp_path)
        table = CASES[name][0].reading(paths)
    worst, share = on_local_grid(paths, options, table)
    assert worst < 2e-7
    assert share > 0.3


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
