"""Files of every model: the current that they stand for comes out of the sampler and of what is written."""

import json

import numpy as np
import pytest
import xarray as xr
from pyproj import CRS

from auvplan.io.currents import open_ocean, read_current
from auvplan.io.currents.levels import s_depths
from auvplan.io.currents.ocean import summary_of
from auvplan.ocean.gridded import CurrentError
from auvplan.site import Site
from tests.io.currents import samples
from tests.io.currents.samples import (
    HOURS,
    LAT,
    LON,
    MERIDIANS,
    PARALLELS,
    START,
    TIMES,
    check,
    flow,
    fvcom,
    mesh,
    refused,
    regular,
    roms,
    turned_grid,
    ugrid,
    write,
)
from tests.io.refusals import refusal

#: Longitude, latitude inside every sample but none of their nodes; the second's water is more than 20 m deep.
PLACES = LON + np.array([0.0213, 0.0441]), LAT + np.array([0.0121, 0.0333])
#: Amid the grid that is turned.
AMID = tuple(axis[3:6, 4:8] - 1e-4 for axis in turned_grid()[:2])
#: Data sets of `flow` on a mesh that say less, or say it elsewhere, and depths of the comparison.
SCANT = {
    "fvcom without middles": (lambda: fvcom(middles=False), 20.0),
    "ugrid in cells": (lambda: ugrid("face"), 0.0),
    "points without cells": (lambda: ugrid().drop_vars(["mesh", "mesh_faces"]), 0.0),
}


@pytest.mark.parametrize("name", SCANT)
def test_meshes_that_say_less(name):
    make, depth = SCANT[name]
    assert check(make(), *PLACES, depth, 0.5).kind == "triangles"


def test_edges_without_the_outermost():
    assert check(samples.c_grid("mom6", symmetric=False), *PLACES, 7.0, 0.5, atol=2e-5).kind == "roms"


def test_the_summary_and_the_command(tmp_path, call):
    path = write(regular(), tmp_path / "made.nc")
    with open_ocean(path) as ocean:
        found = summary_of(ocean)
    assert found["points"] == "6 x 8"
    assert found["longitude"] == f"{LON:.4f} to {LON + 0.07:.4f}"
    assert found["latitude"] == f"{LAT:.4f} to {LAT + 0.05:.4f}"
    assert (found["times"], found["from"]) == (3, "2020-01-01T00:00:00Z")
    assert found["levels"] == "3, 0 to 30 m"
    code, out, _ = call("currents", path, "--json", "--to", tmp_path / "cf.nc")
    assert code == 0
    assert json.loads(out) == found | {"notes": []}
    with open_ocean(tmp_path / "cf.nc") as again:
        assert again.times[0] == START


# Components on the edges of cells.


def test_roms_ends_at_the_sea_bed_below_the_surface():
    data = roms()
    with open_ocean(data) as ocean:
        lon, lat, floor = (float(data[name][4, 5]) for name in ("lon_rho", "lat_rho", "h"))
        above, below = ocean.at([lon, lon], lat, [floor + 0.39, floor + 0.41], START)[0]
        assert np.isfinite(above)
        assert np.isnan(below)
        first = (data[name].values[:1] for name in ("s_rho", "Cs_r"))
        lowest = s_depths(*first, 20.0, 2, np.array([floor]), np.array([[0.4]]))
        assert above == ocean.at(lon, lat, float(lowest[0, 0, 0]), START)[0]


def test_roms_land_stays_missing():
    data = roms(land=[(3, 4), (3, 5), (6, 8)])
    with open_ocean(data) as ocean:
        lon, lat = (data[name].values for name in ("lon_rho", "lat_rho"))
        found = np.isfinite(ocean.at(lon, lat, 1.0, START)[0])
        assert (found == (data["mask_rho"].values > 0)).all()
        # Beside land one face is left: half a cell off, of a field that is linear.
        e, _, _ = ocean.at(lon[3, 6], lat[3, 6], 1.0, START)
        assert abs(e - ocean.at(lon[2, 6], lat[2, 6], 1.0, START)[0]) < 0.1


def test_roms_without_an_angle_follows_the_rows_of_its_grid():
    data = roms()
    lon, lat = (data[name].values[INNER] + 1e-4 for name in ("lon_rho", "lat_rho"))
    with open_ocean(data) as stated, open_ocean(data.drop_vars("angle")) as untold:
        pair = [np.stack(ocean.at(lon, lat, 3.0, START)[:2]) for ocean in (stated, untold)]
    np.testing.assert_allclose(pair[1], pair[0], atol=3e-3 * np.abs(pair[0]).max())


def test_walls_of_mitgcm_hold_zeros():
    """On MITgcm's edges beside land is 0, which is no current; hFacC tells land by level."""
    open_ = np.ones((3, 7, 9))
    open_[:, :, :3] = 0.0
    open_[1, :, 7:] = 0.0
    walls = open_ * np.roll(open_, 1, axis=2), open_ * np.roll(open_, 1, axis=1)
    data = samples.c_grid(walls=walls).assign(hFacC=(("depth", "YC", "XC"), 0.3 * open_))
    with open_ocean(data) as ocean:
        assert np.isnan(ocean.at(MERIDIANS[1], PARALLELS[3], 0.0, START)[0])
        assert np.isnan(ocean.at(MERIDIANS[8], PARALLELS[3], 10.0, START)[0])
        beside = ocean.at(MERIDIANS[6], PARALLELS[3], 10.0, START)[0]
        np.testing.assert_allclose(beside, flow(MERIDIANS[6] - 0.005, PARALLELS[3], 10.0)[0])
    check(data, MERIDIANS[4], PARALLELS[3], 10.0, 0.0)


def test_nemo_needs_its_mesh_file():
    *parts, grid = samples.nemo()
    words = r"nav_l.. differs, as on the edges of cells: name the model's mesh"
    refusal(CurrentError, words, open_ocean, parts)
    with open_ocean([*parts, grid]) as ocean:
        assert np.isnan(ocean.at(*(grid[name].values[0, 0, 0] for name in ("glamt", "gphit")), 0.0, START)[0])


# Directions of axes.


@pytest.mark.parametrize("standard", ["", "sea_water_{}_velocity"])
def test_curvilinear_components_along_the_grid_are_turned(standard):
    lon, lat, angle = turned_grid()
    dims, parts = ("time", "y", "x"), samples.along(*flow(lon, lat), angle)
    fields = {}
    for name, part, axis in zip("ab" if standard else "uv", parts, "xy", strict=True):
        about = {"standard_name": standard.format(axis)} if standard else {}
        fields[name] = dims, part[None], {"units": "m/s"} | about
    places = {"lon": (dims[1:], lon, samples.EASTWARD), "lat": (dims[1:], lat, samples.NORTHWARD)}
    places |= {"time": ("time", [0.0], HOURS)}
    turn = {"angle": (dims[1:], np.rad2deg(angle), {"units": "degrees"})}
    assert check(xr.Dataset(fields | places | turn), *AMID, 0.0, 0.0).kind == "curvilinear"
    data = xr.Dataset(fields | places)
    if not standard:
        refused(data, "angle, which gives how, is missing")
        return
    ocean = check(data, *AMID, 0.0, 0.0, atol=2e-3)
    assert any("angle is not given" in note for note in ocean.notes)


def test_eastward_on_s_levels_is_not_turned_again():
    data = roms()
    lon, lat = data["lon_rho"].values, data["lat_rho"].values
    dims, speed = ("ocean_time", "s_rho", "eta_rho", "xi_rho"), {"units": "meter second-1"}
    parts = (np.broadcast_to(part, (len(TIMES), 6, *lon.shape)) for part in flow(lon, lat))
    east, north = ((dims, part, speed) for part in parts)
    with open_ocean(data.assign(u_eastward=east, v_northward=north).drop_vars(["u", "v"])) as ocean:
        assert ocean.kind == "curvilinear"
        for depth in (0.0, 3.0, 30.0):
            np.testing.assert_allclose(ocean.at(*AMID, depth, START)[:2], flow(*AMID), atol=1e-6)


UTM = 3e5 + 500.0 * np.arange(8), 6.6e6 + 500.0 * np.arange(7)
POLAR = CRS.from_user_input("+proj=stere +lat_0=90 +lat_ts=60 +lon_0=58 +a=6371000 +b=6371000")
PLANE = 1e6 + 4e3 * np.arange(8), -1.2e6 + 4e3 * np.arange(7)


def in_plane(made, change=lambda data: data, atol=1e-6, **options):
    """Compare what is read of a grid along the axes of a projection with what it stands for."""
    data, lon, lat, east, north = made
    with open_ocean(change(data), **options) as ocean:
        found = ocean.at(lon[2:5, 2:5], lat[2:5, 2:5], 10.0, START + 3600.0)[:2]
        np.testing.assert_allclose(found, [part[1, 1, 2:5, 2:5] for part in (east, north)], atol=atol)
        return ocean


def cf(crs):
    return {key: value for key, value in crs.to_cf().items() if key != "crs_wkt"}


@pytest.mark.parametrize("stated", ["wkt", "epsg", "cf", "setting"])
def test_metres_of_a_projection_alone(stated):
    crs = CRS.from_epsg(32633)
    epsg = {"grid_mapping_name": "unknown", "epsg": np.int32(32633)}
    mapping = {"wkt": {"crs_wkt": crs.to_wkt()}, "epsg": epsg, "cf": cf(crs), "setting": {}}[stated]
    made = samples.projected(crs, *UTM, mapping)
    in_plane(made, crs=32633 if stated == "setting" else None)
    wrong, words = 32632, r"not WGS 84 / UTM zone 32N as current\.crs says"
    if stated == "setting":
        wrong, words = None, r"that the file does not name: say current\.crs"
    refusal(CurrentError, words, open_ocean, made[0], crs=wrong)


def test_axes_in_hundreds_of_kilometres():
    """TOPAZ and others of the Arctic count in units of 100 km."""
    in_plane(samples.projected(POLAR, *PLANE, cf(POLAR), "100 km", 1e5))
    cells = samples.projected(POLAR, *PLANE, cf(POLAR), "cells")[0]
    refused(cells, "x has units 'cells', which are no length")


@pytest.fixture(scope="module")
def polar():
    """A polar stereographic grid with longitude and latitude too; x and y are given as axes."""
    data, lon, lat, *parts = samples.projected(POLAR, *PLANE, cf(POLAR))
    places = {"lon": (("y", "x"), lon, samples.EASTWARD), "lat": (("y", "x"), lat, samples.NORTHWARD)}
    return data.assign(places), lon, lat, *parts


@pytest.mark.parametrize("order", [("time", "depth", "y", "x"), ("x", "y", "depth", "time")])
@pytest.mark.parametrize("falling", [[], ["x"], ["y"]])
@pytest.mark.parametrize("mapped", [True, False])
def test_x_runs_where_its_coordinate_says(polar, order, falling, mapped):
    def change(data):
        data = data.isel(dict.fromkeys(falling, slice(None, None, -1))).transpose(*order)
        return data if mapped else data.drop_vars("crs")

    # By the places alone the ellipsoid counts, which the model's sphere has not.
    in_plane(polar, change, 1e-6 if mapped else 2e-3)


def test_a_projection_that_does_not_fit_the_places_is_left_out(polar):
    data, *known = polar
    data = data.copy(deep=True)
    data["crs"].attrs["straight_vertical_longitude_from_pole"] = 0.0
    ocean = in_plane((data, *known), atol=2e-3)
    assert any("do not follow the places of the grid's points: left out" in note for note in ocean.notes)


# Changes of a file that say the same.


def without_places(data, where, value):
    """As models leave coordinates of points on land."""
    return data.assign({name: data[name].where(~where, value) for name in ("lon_rho", "lat_rho")})


def with_a_block_at_zero(data):
    where = np.zeros(data["lon_rho"].shape, bool)
    where[2:4, 3:6] = True
    return without_places(data, where, 0.0)


def beside_rivers(data):
    """The one-dimensional part of D-Flow, whose topology comes first in the file."""
    network = {"cf_role": "mesh_topology", "topology_dimension": np.int32(1), "node_coordinates": "rx ry"}
    rivers = {
        "river": ((), np.int32(0), network),
        "rx": ("r_node", np.arange(3.0), samples.LONGITUDE),
        "ry": ("r_node", np.arange(3.0), samples.LATITUDE),
        "river_u": (("time", "r_node"), np.zeros((3, 3)), {**data["ucx"].attrs, "mesh": "river"}),
    }
    return xr.Dataset(rivers).merge(data)


INNER = np.s_[2:6, 2:9]
#: A data set, a change that says the same, the nodes near which both are compared, a note.
SAME = {
    "zeros behind the mask": (roms(land=[(4, 4), (5, 6)]), lambda d: d.fillna(0.0), np.s_[:], None),
    "a mask that was never written": (roms(), lambda d: d.assign(mask_rho=0.0 * d["mask_rho"]), INNER,
                                      "mask_rho says land everywhere: left out"),
    "no places on land": (roms(land=[(0, 0), (0, 1), (1, 0)]),
                          lambda d: without_places(d, d["mask_rho"] == 0, np.nan), np.s_[3:6, 4:8], None),
    "places on land at zero": (roms(angle=0.1), with_a_block_at_zero, np.s_[5:],
                               "far longer than usual: there are no cells there"),
    "rivers beside the mesh": (ugrid(), beside_rivers, np.s_[:], None),
}  # fmt: skip


@pytest.mark.parametrize("case", SAME)
def test_it_is_the_same_current(case):
    data, change, nodes, note = SAME[case]
    names = ("lon_rho", "lat_rho") if "lon_rho" in data else ("mesh_x", "mesh_y")
    lon, lat = (data[name].values[nodes] for name in names)
    with open_ocean(data) as one, open_ocean(change(data)) as other:
        for k in range(2):
            places = lon - 1e-4 * k * (lon - lon.mean()), lat - 1e-4 * k * (lat - lat.mean())
            found = one.at(*places, 0.5, START)[:2]
            assert np.isfinite(found).any()
            np.testing.assert_array_equal(found, other.at(*places, 0.5, START)[:2])
        assert note is None or any(note in line for line in other.notes)
        if case == "places on land at zero":
            assert other.geometry.locate(*(data[name].values[2:3, 4] for name in names)).outside.all()


# Meshes.


def test_fvcom_in_its_cells_and_on_the_local_grid():
    """Velocities in cells, also where their middles are left at zero; times to the millisecond."""
    data = fvcom()
    with open_ocean(data) as ocean:
        np.testing.assert_allclose(ocean.times, START + 3600.0 * TIMES, atol=1e-3)
        check(data, ocean.longitude, ocean.latitude, 25.0, 1.0)
        assert ocean.at(LON + 0.02, LAT + 0.02, 20.0, START)[2] == pytest.approx(2e-3)
        # At the rim, beyond the middles of cells, the cell's own value holds.
        corner = np.argmin(np.hypot(ocean.longitude - LON, ocean.latitude - LAT))
        e, _, _ = ocean.at(LON + 1e-5, LAT + 1e-5, 5.0, START)
        near = ocean.at(ocean.longitude, ocean.latitude, 5.0, START)[0]
        assert e in near
        assert e == pytest.approx(near[corner], abs=0.05)
        assert np.isnan(ocean.at(LON + 0.02, LAT + 0.02, 51.0, START)[0])
    site = Site(LON + 0.035, LAT + 0.03)
    found = read_current(data, site, lower=(-2500, -1200, 0), upper=(2500, 1200, 30))
    np.testing.assert_allclose(found.field.w, -2e-3, rtol=1e-6)
    np.testing.assert_allclose(found.sea_floor, 50.0)


def test_holes_of_a_mesh_are_land():
    hole = 28
    lon, lat, _ = mesh()
    data = fvcom(hole)
    with open_ocean(data) as ocean:
        assert np.isnan(ocean.at(lon[hole], lat[hole], 5.0, START)[0])
        words = "outside the data, by up to .* west"
        refusal(CurrentError, words, ocean.at, LON - 0.02, LAT + 0.02, 5.0, START)
    found = read_current(data, Site(LON + 0.035, LAT + 0.03), lower=(-2000, -1000, 0), upper=(2000, 1000, 5))
    assert 0.5 < found.water.mean() < 1.0


@pytest.mark.parametrize(("make", "floor"), [(lambda: samples.nodes("schism"), 10.5), (samples.dflow, 51.0)])
def test_the_water_ends_at_the_bed_of_a_mesh(make, floor):
    """By the lowest height of SCHISM's levels, and by the altitude of D-Flow's cells."""
    with open_ocean(make()) as ocean:
        found = ocean.at(LON + 0.0123, LAT + 0.02, [5.0, floor - 0.1, floor + 0.1], START)[0]
        assert np.isfinite(found).tolist() == [True, True, False]
        if floor == 51.0:
            np.testing.assert_allclose(ocean.sea_floor(*PLACES), 50.0)


def test_zeros_below_the_bed_are_a_mask():
    data = regular(depth=[0.0, 10.0, 30.0, 60.0])
    stated = {"standard_name": "sea_floor_depth_below_geoid", "units": "m"}
    data["deptho"] = (("latitude", "longitude"), np.full((6, 8), 25.0), stated)
    for name in ("uo", "vo"):
        data[name][:, 2:] = 0.0
    with open_ocean(data) as ocean:
        place = PLACES[0][0], PLACES[1][0]
        held = np.stack(ocean.at(*place, 10.0, START)[:2])
        np.testing.assert_allclose(np.stack(ocean.at(*place, 24.0, START)[:2]), held)
        assert np.isnan(ocean.at(*place, 26.0, START)[0])


@pytest.mark.parametrize(("mask", "wet"), [("wet_nodes", 1), ("dryFlagNode", 0)])
def test_flats_that_fall_dry_have_no_current_then(mask, wet):
    flags = np.full((3, len(mesh()[0])), wet, np.int32)
    flags[1] = 1 - wet
    with open_ocean(ugrid().assign({mask: (("time", "n_node"), flags)})) as ocean:
        places = ocean.longitude[20], ocean.latitude[20]
        assert np.isfinite(ocean.at(*places, 0.0, ocean.times[0])[0])
        assert np.isnan(ocean.at(*places, 0.0, ocean.times[1])[0])


def test_a_node_far_away_makes_no_cells():
    data = ugrid()
    data["mesh_x"].values[20] = -120.0
    lon, lat, _ = mesh()
    ocean = check(data, np.delete(lon, 20)[30:40], np.delete(lat, 20)[30:40], 0.0, 0.0)
    assert any("far longer than usual" in note for note in ocean.notes)
    assert ocean.geometry.locate(np.array([-60.0]), lat[20:21]).weight.sum() == 0.0


def test_corners_count_from_one_also_where_the_last_node_is_lost():
    data = fvcom().isel(nele=slice(0, 30))
    assert data["nv"].values.max() < data.sizes["node"]
    ocean = check(data, data["lonc"].values, data["latc"].values, 25.0, 0.5)
    assert ocean.geometry.cells.corners.min() == 0


def test_middles_of_cells_by_the_topology():
    """D-Flow's are no means of the corners; UGRID names them, whatever their attributes are."""
    data = ugrid("face")
    data["mesh"].attrs["face_coordinates"] = "face_a face_b"
    with open_ocean(data) as plain:
        lon, lat = plain.longitude + 2e-4, plain.latitude - 1e-4
    stated = {"face_a": ("n_face", lon, {"standard_name": "latitude"}), "face_b": ("n_face", lat)}
    with open_ocean(data.assign(stated)) as ocean:
        np.testing.assert_allclose(ocean.longitude, lon)
        np.testing.assert_allclose(ocean.latitude, lat)
