"""From files to a box: several files, times, the local grid, what lies outside, what is read."""

from datetime import UTC, datetime, timedelta

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from auvplan.io.currents import open_ocean, read_current
from auvplan.io.currents.levels import at_depth
from auvplan.ocean.gridded import CurrentError
from auvplan.site import Site
from tests.io.currents.samples import (
    BOX,
    DIMS,
    EAST,
    HOURS,
    LAT,
    LON,
    NORTH,
    PLACE,
    SITE,
    START,
    check,
    fvcom,
    regular,
    roms,
    ugrid,
    write,
)
from tests.io.refusals import refusal


def test_files_split_over_time(tmp_path):
    data = regular(hours=[0.0, 1.0, 3.0, 4.0, 6.0])
    for number, part in enumerate((slice(2, 4), slice(0, 2), slice(3, 5))):
        write(data.isel(time=part), tmp_path / f"part{number}.nc")
    ocean = check(tmp_path / "part*.nc", hour=2.2)
    np.testing.assert_allclose(ocean.times, START + 3600.0 * np.array([0.0, 1.0, 3.0, 4.0, 6.0]))
    assert "1 times are given twice; the first is used" in ocean.notes
    check([tmp_path / "part2.nc", tmp_path / "part0.nc"], hour=5.2)
    whole = read_current(write(data, tmp_path / "whole.nc"), SITE, times=(5000.0, 20000.0), **BOX)
    parts = read_current(str(tmp_path / "part*.nc"), SITE, times=(5000.0, 20000.0), **BOX)
    np.testing.assert_array_equal(whole.field.u, parts.field.u)
    np.testing.assert_array_equal(whole.field.times, 3600.0 * np.array([1.0, 3.0, 4.0, 6.0]))


@pytest.mark.parametrize(("make", "decode"), [(regular, True), (roms, False)])
def test_a_dataset_goes_in_where_a_file_does(make, decode, tmp_path):
    path = tmp_path / "a.nc"
    make().to_netcdf(path)
    of_file = read_current(path, SITE, outside="clamp", **BOX)
    with xr.open_dataset(path, decode_times=decode) as dataset:
        for given in (dataset, [dataset]):
            found = read_current(given, SITE, outside="clamp", **BOX)
            np.testing.assert_array_equal(found.field.u, of_file.field.u)
            np.testing.assert_array_equal(found.field.times, of_file.field.times)
            assert found.epoch == of_file.epoch
    bare = xr.Dataset({"u": ("x", [0.0])})
    refusal(CurrentError, "^dataset: ", read_current, bare, SITE, **BOX)


def test_no_file_stays_open_once_it_is_read(tmp_path):
    def open_files():
        return h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE)

    path, before = write(regular(), tmp_path / "a.nc"), open_files()
    found = read_current(path, SITE, **BOX)
    assert open_files() == before
    places = (np.full(1, axis) for axis in PLACE)
    assert np.isfinite(found.source.at(*places, 1.0, found.source.moments[0])[:2]).all()  # it opens again


def test_single_time_is_steady():
    data = regular(hours=[0.0])
    found = read_current(data, SITE, **BOX)
    assert found.field.steady
    assert read_current(data, SITE, times=(0.0, 0.0), **BOX).field.steady
    words = "the file covers 2020-01-01T00:00:00Z only"
    refusal(CurrentError, words, read_current, data, SITE, times=(0.0, 60.0), **BOX)
    assert read_current(data, SITE, times=(0.0, 60.0), outside="clamp", **BOX).field.steady


def test_epoch():
    data = regular()
    found = read_current(data, SITE, **BOX)
    assert found.epoch == datetime(2020, 1, 1, tzinfo=UTC)
    np.testing.assert_allclose(found.field.times, [0.0, 3600.0, 10800.0])
    epoch = datetime(2020, 1, 1, 0, 30, tzinfo=UTC)
    later = read_current(data, Site(SITE.longitude, SITE.latitude, epoch), times=(0.0, 600.0), **BOX)
    np.testing.assert_allclose(later.field.times, [-1800.0, 1800.0])
    assert later.epoch == epoch


def test_moments_of_all_kinds():
    with open_ocean(regular()) as ocean:
        moment = datetime(2020, 1, 1, 0, 30)
        zoned = (moment + timedelta(hours=2)).replace(tzinfo=UTC) - timedelta(hours=2)
        given = [moment, zoned, np.datetime64(moment), START + 1800.0]
        assert len({float(ocean.at(*PLACE, 0.0, when)[0]) for when in given}) == 1
        refusal(CurrentError, "a moment must be a datetime", ocean.at, *PLACE, 0.0, "noon")


def test_grid_fits_the_box():
    data = regular()
    found = read_current(data, SITE, spacing=300.0, depths=[1.0, 4.0], **BOX)
    assert found.field.u.shape == (3, 2, 15, 11)
    assert found.origin == (-2000.0, -1500.0)
    assert found.spacing == pytest.approx((4000 / 14, 300.0))
    np.testing.assert_allclose(found.field.depths, [1.0, 4.0])
    refusal(CurrentError, "more than 512", read_current, data, SITE, spacing=1.0, **BOX)


def to_the_edge():
    """The largest box within the samples' nodes, whose outermost rows and columns are not straight in it."""
    lon, lat = LON + 0.01 * np.array([0.0, 3.5, 7.0]), LAT + 0.01 * np.array([0.0, 2.5, 5.0])
    south, north = (SITE.to_local(lon, np.full(3, edge))[0] for edge in lat[[0, -1]])
    west, east = (SITE.to_local(np.full(3, edge), lat)[1] for edge in lon[[0, -1]])
    return {"lower": (south.max(), west.max(), 0.0), "upper": (north.min(), east.min(), 25.0)}


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("box", [BOX, to_the_edge()], ids=["within", "to the edge"])
def test_between_the_nodes_of_a_grid_the_current_is_the_files(turned, box):
    """Values without any order: interpolated twice, on nodes between them, they would be half gone."""
    data = regular()
    rng = np.random.default_rng(3)
    for name in ("uo", "vo"):
        data[name] = data[name].copy(data=rng.normal(0.0, 0.5, data[name].shape))
    turned_ = data.isel(latitude=slice(None, None, -1)) if turned else data
    found = read_current(turned_, SITE, **box)
    assert found.field.u.shape[2:] == (6, 8)
    x, y = rng.uniform(box["lower"][:2], box["upper"][:2], (500, 2)).T
    z, t = rng.uniform(0.0, 25.0, 500), rng.uniform(0.0, 10_800.0, 500)
    longitude, latitude = SITE.to_geographic(x, y)
    places = {"time": t / 3600.0, "depth": z, "latitude": latitude, "longitude": longitude}
    there = data.interp({name: xr.DataArray(axis, dims="place") for name, axis in places.items()})
    u, v, _ = found.field(x, y, z, t)
    # A row is 1,114 m long, and its nodes lie up to 3 m beside the file's.
    np.testing.assert_allclose(u, there["vo"], atol=0.01)
    np.testing.assert_allclose(v, there["uo"], atol=0.01)


def test_where_rows_are_not_even_nodes_are_denser():
    lat = LAT + np.array([0.0, 0.01, 0.016, 0.03, 0.035, 0.05])
    data = regular(lat=lat)
    found = read_current(data, SITE, **BOX)
    assert found.spacing == pytest.approx((4000 / 29, 3000 / 22), rel=0.03)


def layers(thick, top=31.0):
    """Water to the north above a depth and to the south below, on 40 levels above a bed of 45 to 52 m."""
    sigma, longitude, latitude = (
        (np.arange(40) + 0.5) / 40.0 - 1.0,
        LON + 0.01 * np.arange(8),
        LAT + 0.01 * np.arange(6),
    )
    floor = np.broadcast_to(45.0 + np.arange(8.0), (6, 8))
    depth = -sigma[:, None, None] * floor
    north = np.interp(depth, [top, top + thick], [0.4, -0.3])[None]
    dims = "time", "sigma", *DIMS[2:]
    return xr.Dataset(
        {"uo": (dims, 0.0 * north, EAST), "vo": (dims, north, NORTH), "h": (dims[2:], floor, {"units": "m"})},
        {"time": ("time", [0.0], HOURS), "latitude": latitude, "longitude": longitude,
         "sigma": ("sigma", sigma, {"standard_name": "ocean_sigma_coordinate", "positive": "up"})},
    )  # fmt: skip


@pytest.mark.parametrize("thick", [5.0, 12.0])
def test_between_depths_the_current_is_the_files_down_to_the_bed(thick):
    """Standard depths alone, 30 and 50 m, would miss the lower layer."""
    found = read_current(layers(thick), SITE, lower=(-1500, -1000, 0), upper=(1500, 1000, 44))
    rng = np.random.default_rng(4)
    x, y, z = rng.uniform((-1500, -1000, 0), (1500, 1000, 44.9), (400, 3)).T
    longitude, latitude = SITE.to_geographic(x, y)
    with found.source as source:
        east, north, _ = source.at(longitude, latitude, z, START)
    assert np.hypot(found.field(x, y, z, 0.0)[0] - north, found.field(x, y, z, 0.0)[1] - east).max() < 0.05
    assert len(found.field.depths) <= 32
    assert not any("off by" in note for note in found.notes)


def test_depths_are_added_where_the_box_is():
    for least in (0, 30):
        found = read_current(layers(2.0, 12.0), SITE, lower=(-1500, -1000, least), upper=(1500, 1000, 44))
        assert (len(found.field.depths) > 8) == (least == 0)


def test_at_the_surface_alone_levels_that_follow_the_bed_are_read():
    found = read_current(layers(5.0), SITE, lower=(-1500, -1000, 0), upper=(1500, 1000, 0))
    np.testing.assert_allclose(found.field.u, 0.4, rtol=1e-6)


def test_depths_that_were_asked_for_are_kept():
    found = read_current(layers(5.0), SITE, depths=[0.0, 30.0, 50.0], **BOX)
    np.testing.assert_array_equal(found.field.depths, [0.0, 30.0, 50.0])


def test_levels_reach_beyond_the_box():
    data = regular(depth=[0.0, 5.0, 10.0, 30.0, 60.0])
    found = read_current(data, SITE, **BOX)
    np.testing.assert_allclose(found.field.depths, [0.0, 5.0, 10.0, 30.0])


def test_clamp_holds_the_nearest():
    data = regular()
    box = {"lower": (-2000.0, -1500.0, 0.0), "upper": (9000.0, 1500.0, 25.0)}
    refusal(CurrentError, r"of the box is not covered: .* degrees\) north$", read_current, data, SITE, **box)
    found = read_current(data, SITE, outside="clamp", spacing=1000.0, **box)
    assert "beyond the data's area, in 58% of the box, its nearest value holds" in found.notes
    np.testing.assert_allclose(found.field.u[:, :, -1], found.field.u[:, :, -3], atol=1e-3)
    # Data ends 2.8 km north of the site; half a cell, 0.56 km, farther it still tells of water.
    north = found.origin[0] + found.spacing[0] * np.arange(len(found.water))
    assert found.water[north < 3200.0].all()
    assert not found.water[north > 3500.0].any()
    assert (found.covered == found.water).all()


def test_half_of_the_weight_must_be_water():
    data = regular()
    data["uo"][:, :, :, 4:] = np.nan
    with open_ocean(data) as ocean:
        e, _, _ = ocean.at(LON + np.array([0.0300, 0.0349, 0.0351, 0.0400]), LAT + 0.02, 0.0, START)
        assert np.isfinite(e).tolist() == [True, True, False, False]
        assert e[1] == pytest.approx(e[0])


@given(
    depth=st.floats(0.0, 80.0),
    levels=st.lists(st.integers(0, 60), min_size=2, max_size=6, unique=True).map(sorted),
    bottom=st.integers(1, 6),
)
def test_columns(depth, levels, bottom):
    """Linear between levels, held above the first and below the deepest with a value, to the bed."""
    levels = np.asarray(levels, float)
    valid = min(bottom, len(levels))
    values = np.where(np.arange(len(levels)) < valid, 1.0 + levels**2, np.nan)
    floor = levels[valid - 1] + 5.0
    (found,) = at_depth((values[:, None],), levels[:, None], np.array([depth]), np.array([floor]))
    if depth <= levels[valid - 1]:
        assert found[0] == pytest.approx(np.interp(depth, levels[:valid], values[:valid]))
    elif depth > floor or (valid < len(levels) and depth >= levels[valid]):
        assert np.isnan(found[0])
    else:
        assert found[0] == values[valid - 1]


def test_boxes_far_away_are_told_how_far():
    """Whatever the grid, without looking through all of it."""
    for data in (regular(), roms(), fvcom()):
        words, far = r"100% of the box is not covered: .*2\d{5} m .*north", Site(LON, LAT + 2.5)
        refusal(CurrentError, words, read_current, data, far, **BOX)


@pytest.mark.parametrize("make", [ugrid, lambda: ugrid("face"), fvcom, regular])
def test_at_its_own_points_the_current_is_the_files(make):
    """All weight is on a point itself, whatever cell or triangle it is found in."""
    data = make()
    with open_ocean(data) as ocean:
        lon, lat = ocean.longitude, ocean.latitude
        if ocean.kind == "regular":
            lon, lat = np.meshgrid(lon, lat)
        depth = 25.0 if ocean.levels is None else 0.0  # FVCOM's middle layer, whose rounding is another
        level = {"siglay": 1, "depth": 0}
        for name, found in zip(
            ocean.names.values(), ocean.at(lon, lat, depth, ocean.times[1])[:2], strict=False
        ):
            own = data[name].isel(time=1).isel(level, missing_dims="ignore").values
            np.testing.assert_allclose(found, own, rtol=0.0, atol=1e-15 if ocean.levels is None else 0.0)
