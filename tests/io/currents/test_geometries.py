"""Grids of every kind: currents known in closed form come out of the sampler and of the local grid."""

import numpy as np
import pytest
import xarray as xr

from auvplan.io.currents import open_ocean, read_current
from auvplan.io.currents.levels import s_depths
from auvplan.ocean.gridded import CurrentError
from auvplan.site import Site
from tests.io.currents.samples import (
    LAT,
    LON,
    START,
    check,
    flow,
    fvcom,
    mesh,
    refused,
    regular,
    roms,
    schism,
    solid_body,
    turned_grid,
    ugrid,
)

#: Longitude, latitude inside every sample but none of their nodes.
PLACES = np.array([[LON + 0.0213, LON + 0.0341], [LAT + 0.0121, LAT + 0.0333]])


def on_grid(found, site):
    """Longitude, latitude and bearing of true north at the nodes of a local grid."""
    axes = [found.origin[k] + found.spacing[k] * np.arange(found.field.u.shape[2 + k]) for k in range(2)]
    places = site.to_geographic(*np.meshgrid(*axes, indexing="ij"))
    return *places, site.true_north(*places)


def test_regular_is_linear_in_place_depth_and_time():
    ocean = check(regular(), PLACES[0][:, None], PLACES[1][:, None], np.array([0.0, 4.0, 10.0, 22.0]), 1.7)
    assert ocean.kind == "regular"


@pytest.mark.filterwarnings("ignore:.*reaches 9.5 m/s:auvplan.errors.ScenarioWarning")
def test_vectors_are_turned_into_the_local_frame():
    path = regular(LON + 0.5 * np.arange(10), LAT + 0.5 * np.arange(8))
    site = Site(LON + 0.4, LAT + 1.5)
    found = read_current(path, site, lower=(-20e3, 0, 0), upper=(20e3, 150e3, 10), spacing=10e3)
    lon, lat, bearing = on_grid(found, site)
    assert np.abs(bearing).max() > 0.03
    e, n = flow(lon, lat, 10.0, 3.0)
    expected = n * np.cos(bearing) - e * np.sin(bearing), n * np.sin(bearing) + e * np.cos(bearing)
    np.testing.assert_allclose(found.field.u[-1, 1], expected[0], atol=2e-6)
    np.testing.assert_allclose(found.field.v[-1, 1], expected[1], atol=2e-6)
    # A velocity keeps its size and, going by where it leads, its direction.
    x, y = site.to_local(lon + 1e-5 * e / np.cos(np.deg2rad(lat)), lat + 1e-5 * n)
    here = site.to_local(lon, lat)
    way = np.arctan2(y - here[1], x - here[0])
    np.testing.assert_allclose(np.cos(way - np.arctan2(expected[1], expected[0])), 1.0, atol=3e-5)


@pytest.mark.parametrize("transform", [1, 2])
def test_roms_turns_like_a_solid_body(transform):
    data = roms(transform)
    with open_ocean(data) as ocean:
        assert ocean.kind == "roms"
        assert ocean.levels is None
        lon, lat = (data[name].values[1:-1, 1:-1] for name in ("lon_rho", "lat_rho"))
        floor, zeta = data["h"].values[1:-1, 1:-1], 0.4
        s, curve = data["s_rho"].values, data["Cs_r"].values
        for k in range(len(s)):
            # Written out once more, from the definition of z as height above the datum.
            if transform == 1:
                still = 20.0 * s[k] + (floor - 20.0) * curve[k]
                z = still + zeta * (1.0 + still / floor)
            else:
                z = zeta + (zeta + floor) * (20.0 * s[k] + floor * curve[k]) / (20.0 + floor)
            e, n, _ = ocean.at(lon, lat, zeta - z, START)
            expected = solid_body(lon, lat)
            np.testing.assert_allclose(e, expected[0] * (1 + s[k]), atol=1e-9)
            np.testing.assert_allclose(n, expected[1] * (1 + s[k]), atol=1e-9)
        _, _, up = ocean.at(lon, lat, 0.0, START)
        np.testing.assert_allclose(up, 1e-3)


def test_roms_ends_at_the_sea_bed_below_the_surface():
    data = roms()
    with open_ocean(data) as ocean:
        lon, lat, floor = (float(data[name][4, 5]) for name in ("lon_rho", "lat_rho", "h"))
        above, below = ocean.at([lon, lon], lat, [floor + 0.39, floor + 0.41], START)[0]
        assert np.isfinite(above)
        assert np.isnan(below)
        lowest = s_depths(
            data["s_rho"].values[:1], data["Cs_r"].values[:1], 20.0, 2, np.array([floor]), np.array([[0.4]])
        )
        assert above == ocean.at(lon, lat, float(lowest[0, 0, 0]), START)[0]


def test_roms_land_stays_missing():
    land = [(3, 4), (3, 5), (6, 8)]
    data = roms(land=land)
    with open_ocean(data) as ocean:
        lon, lat = (data[name].values for name in ("lon_rho", "lat_rho"))
        found = np.isfinite(ocean.at(lon, lat, 1.0, START)[0])
        assert (found == (data["mask_rho"].values > 0)).all()
        # Beside land one face is left: half a cell off, of a field that is linear.
        e, _, _ = ocean.at(lon[3, 6], lat[3, 6], 1.0, START)
        assert abs(e - ocean.at(lon[2, 6], lat[2, 6], 1.0, START)[0]) < 0.1


def without_places(data, where, value):
    """As models leave coordinates of points on land."""
    places = {name: data[name].where(~where, value) for name in ("lon_rho", "lat_rho")}
    return data.assign(places)


def with_a_block_at_zero(data):
    where = np.zeros(data["lon_rho"].shape, bool)
    where[2:4, 3:6] = True
    return without_places(data, where, 0.0)


def beside_rivers(data):
    """The one-dimensional part of D-Flow, whose topology comes first in the file."""
    network = {"cf_role": "mesh_topology", "topology_dimension": np.int32(1), "node_coordinates": "rx ry"}
    rivers = {
        "river": ((), np.int32(0), network),
        "rx": ("r_node", np.arange(3.0), {"standard_name": "longitude", "units": "degrees_east"}),
        "ry": ("r_node", np.arange(3.0), {"standard_name": "latitude", "units": "degrees_north"}),
        "river_u": (("time", "r_node"), np.zeros((2, 3)), {**data["ucx"].attrs, "mesh": "river"}),
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
    "rivers beside the mesh": (ugrid("node"), beside_rivers, np.s_[:], None),
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


def test_roms_without_an_angle_follows_the_rows_of_its_grid():
    data = roms()
    lon, lat = (data[name].values[INNER] + 1e-4 for name in ("lon_rho", "lat_rho"))
    with open_ocean(data) as stated, open_ocean(data.drop_vars("angle")) as untold:
        pair = [np.stack(ocean.at(lon, lat, 3.0, START)[:2]) for ocean in (stated, untold)]
    np.testing.assert_allclose(pair[1], pair[0], atol=3e-3 * np.abs(pair[0]).max())


@pytest.mark.parametrize(
    ("names", "standard"),
    [(("u", "v"), ("", "")), (("a", "b"), ("sea_water_x_velocity", "sea_water_y_velocity"))],
)
def test_curvilinear_components_along_the_grid_are_turned(names, standard):
    angle = 0.7
    lon, lat = turned_grid(angle=angle)
    east, north = flow(lon, lat)
    parts = east * np.cos(angle) + north * np.sin(angle), north * np.cos(angle) - east * np.sin(angle)
    dims = ("time", "y", "x")
    fields = {
        name: (dims, part[None], {"units": "m/s"} | ({"standard_name": own} if own else {}))
        for name, part, own in zip(names, parts, standard, strict=True)
    }
    coordinates = {
        "lon": (dims[1:], lon, {"units": "degrees_east"}),
        "lat": (dims[1:], lat, {"units": "degrees_north"}),
        "time": ("time", [0.0], {"units": "hours since 2020-01-01"}),
        "angle": (dims[1:], np.full(lon.shape, np.rad2deg(angle)), {"units": "degrees"}),
    }
    data = xr.Dataset(fields | coordinates)
    places = lon[2:5, 3:7], lat[2:5, 3:7], 0.0, 0.0
    assert check(data, *places).kind == "curvilinear"
    if not standard[0]:
        refused(data.drop_vars("angle"), "angle, which tells how, is missing")
        return
    ocean = check(data.drop_vars("angle"), *places, atol=2e-3)
    assert any("angle is not given" in note for note in ocean.notes)


def test_eastward_on_s_levels_is_not_turned_again():
    data = roms()
    lon, lat = data["lon_rho"].values, data["lat_rho"].values
    east, north = (np.broadcast_to(part, (2, 6, *lon.shape)) for part in flow(lon, lat))
    dims = ("ocean_time", "s_rho", "eta_rho", "xi_rho")
    data = data.assign(
        u_eastward=(dims, east, {"units": "meter second-1"}),
        v_northward=(dims, north, {"units": "meter second-1"}),
    ).drop_vars(["u", "v"])
    with open_ocean(data) as ocean:
        assert ocean.kind == "curvilinear"
        for depth in (0.0, 3.0, 30.0):
            e, n, _ = ocean.at(lon[2:5, 3:7] + 1e-4, lat[2:5, 3:7] + 2e-4, depth, START)
            expected = flow(lon[2:5, 3:7] + 1e-4, lat[2:5, 3:7] + 2e-4)
            np.testing.assert_allclose([e, n], expected, atol=1e-6)


@pytest.mark.parametrize("middles", [True, False])
def test_fvcom(middles):
    """Velocities in cells, also where the cells' middles are left at zero; times to the millisecond."""
    path = fvcom(middles=middles)
    with open_ocean(path) as ocean:
        assert ocean.kind == "triangles"
        np.testing.assert_allclose(ocean.times, START + np.array([0.0, 3600.0]), atol=1e-3)
        check(path, PLACES[0], PLACES[1], 20.0, 0.5)
        check(path, ocean.longitude, ocean.latitude, 25.0, 1.0)
        _, _, up = ocean.at(*PLACES[:, 0], 20.0, START)
        assert up == pytest.approx(2e-3)
        # At the rim, beyond the middles of cells, the cell's own value holds.
        corner = np.argmin(np.hypot(ocean.longitude - LON, ocean.latitude - LAT))
        e, _, _ = ocean.at(LON + 1e-5, LAT + 1e-5, 5.0, START)
        own = ocean.at(ocean.longitude[corner], ocean.latitude[corner], 5.0, START)[0]
        near = {float(value) for value in ocean.at(ocean.longitude, ocean.latitude, 5.0, START)[0]}
        assert float(e) in near
        assert e == pytest.approx(own, abs=0.05)
        assert np.isnan(ocean.at(*PLACES[:, 0], 51.0, START)[0])
    site = Site(LON + 0.035, LAT + 0.03)
    found = read_current(path, site, lower=(-2500, -1200, 0), upper=(2500, 1200, 30))
    assert found.field.w is not None
    np.testing.assert_allclose(found.field.w, -2e-3, rtol=1e-6)
    np.testing.assert_allclose(found.sea_floor, 50.0)
    places = on_grid(found, site)
    e, n = flow(places[0], places[1], 20.0, 1.0)
    k = int(np.flatnonzero(np.asarray(found.field.depths) == 20.0)[0])
    u = n * np.cos(places[2]) - e * np.sin(places[2])
    inner = np.s_[2:-2, 2:-2]
    np.testing.assert_allclose(np.asarray(found.field.u)[1, k][inner], u[inner], atol=1e-4)


def test_holes_of_a_mesh_are_land():
    columns = 8
    hole = 3 * columns + 4
    lon, lat, _ = mesh()
    path = fvcom(hole=hole)
    with open_ocean(path) as ocean:
        assert np.isnan(ocean.at(lon[hole], lat[hole], 5.0, START)[0])
        with pytest.raises(CurrentError, match=r"outside the data, by up to .* west"):
            ocean.at(LON - 0.02, LAT + 0.02, 5.0, START)
    found = read_current(path, Site(LON + 0.035, LAT + 0.03), lower=(-2000, -1000, 0), upper=(2000, 1000, 5))
    assert 0.5 < found.water.mean() < 1.0


@pytest.mark.parametrize("location", ["node", "face"])
def test_ugrid(location):
    ocean = check(ugrid(location), PLACES[0], PLACES[1], 0.0, 0.3)
    assert ocean.kind == "triangles"
    check(ugrid(location), ocean.longitude, ocean.latitude, 0.0, 1.0)


def test_points_without_cells_are_triangulated():
    check(ugrid("node").drop_vars(["mesh", "mesh_faces"]), PLACES[0], PLACES[1], 0.0, 0.3)


def test_schism_heights_of_levels():
    deep = PLACES[0][1] + 0.01, PLACES[1][1], np.array([0.0, 5.5, 10.5, 20.0, 30.4])
    assert check(schism(), *deep, 0.5).kind == "triangles"
    with open_ocean(schism()) as ocean:
        shallow = ocean.at(LON + 0.01, LAT + 0.02, [5.0, 10.4, 10.6], START)[0]
        assert np.isfinite(shallow).tolist() == [True, True, False]


def test_selfe_sigma_levels():
    """One-dimensional sigma, h and zeta at the nodes where the current is."""
    lon, lat, triangles = mesh()
    sigma, hours, rise = -np.array([1.0, 0.6, 0.2, 0.0]), np.array([0.0, 1.0]), 2.0
    floor = 40.0 + 1000.0 * (lon - LON)
    depth = -sigma[:, None] * (floor + rise)
    east, north = flow(lon, lat, depth, hours[:, None, None])
    dims = ("time", "nv", "node")
    data = xr.Dataset(
        {
            "u": (dims, east, {"units": "m/s"}),
            "v": (dims, north, {"units": "m/s"}),
            "sigma": ("nv", sigma, {"standard_name": "ocean_sigma_coordinate", "positive": "up"}),
            "h": ("node", floor, {"units": "m"}),
            "zeta": (("time", "node"), np.full((2, len(lon)), rise), {"units": "m"}),
            "ele": (("nface", "nele"), (triangles.T + 1).astype(np.int32)),
            "lon": ("node", lon, {"units": "degrees_east"}),
            "lat": ("node", lat, {"units": "degrees_north"}),
            "time": ("time", hours, {"units": "hours since 2020-01-01"}),
        }
    )
    check(data, PLACES[0], PLACES[1], 17.0, 0.5)
    check(data, lon[10], lat[10], 0.0, 0.5)


def test_zeros_below_the_bed_are_a_mask():
    data = regular(depth=[0.0, 10.0, 30.0, 60.0])
    stated = {"standard_name": "sea_floor_depth_below_geoid", "units": "m"}
    data["deptho"] = (("latitude", "longitude"), np.full((6, 8), 25.0), stated)
    for name in ("uo", "vo"):
        data[name][:, 2:] = 0.0
    with open_ocean(data) as ocean:
        held = np.stack(ocean.at(*PLACES[:, 0], 10.0, START)[:2])
        np.testing.assert_allclose(np.stack(ocean.at(*PLACES[:, 0], 24.0, START)[:2]), held)
        assert np.isnan(ocean.at(*PLACES[:, 0], 26.0, START)[0])


@pytest.mark.parametrize(("mask", "wet"), [("wet_nodes", 1), ("dryFlagNode", 0)])
def test_flats_that_fall_dry_have_no_current_then(mask, wet):
    data = ugrid("node")
    flags = np.full((2, len(mesh()[0])), wet)
    flags[1] = 1 - wet
    with open_ocean(data.assign({mask: (("time", "n_node"), flags.astype(np.int32))})) as ocean:
        places = ocean.longitude[20], ocean.latitude[20]
        assert np.isfinite(ocean.at(*places, 0.0, ocean.times[0])[0])
        assert np.isnan(ocean.at(*places, 0.0, ocean.times[1])[0])


def test_sigma_layers_over_a_bed_that_is_told_as_an_altitude():
    """D-Flow FM in three dimensions."""
    data = ugrid("face")
    count, layers = data.sizes["n_face"], -np.array([0.9, 0.5, 0.1])
    bed, rise = 50.0 + np.linspace(0.0, 9.0, count), 1.0
    with open_ocean(data) as flat:
        lon, lat = flat.longitude, flat.latitude
    depth = -layers[None, None] * (bed + rise)[None, :, None]
    parts = flow(lon[None, :, None], lat[None, :, None], depth, np.array([0.0, 1.0])[:, None, None])
    for name, part in zip(("ucx", "ucy"), parts, strict=True):
        data[name] = (("time", "n_face", "layer"), part, data[name].attrs)
    height = {"standard_name": "sea_surface_height", "units": "m"}
    data = data.assign(
        layer_sigma=("layer", layers, {"standard_name": "ocean_sigma_coordinate", "positive": "up"}),
        mesh_flowelem_bl=("n_face", -bed, {"standard_name": "altitude", "units": "m"}),
        mesh_s1=(("time", "n_face"), np.full((2, count), rise), height),
    )
    check(data, lon, lat, 25.0, 0.5)
    with open_ocean(data) as ocean:
        assert np.isfinite(ocean.at(lon, lat, bed + rise - 0.1, START)[0]).all()
        assert np.isnan(ocean.at(lon, lat, bed + rise + 0.1, START)[0]).all()
        np.testing.assert_allclose(ocean.sea_floor(lon[20:24], lat[20:24]), bed[20:24], atol=0.1)


@pytest.mark.parametrize("name", ["lon_rho", "lat_rho"])
def test_a_grid_that_folds_over_itself_is_refused(name):
    data = roms(angle=0.1)
    values = data[name].values.copy()
    axis = -1 if name == "lon_rho" else 0
    values[:, :4] = np.flip(values[:, :4], axis)
    data[name] = (data[name].dims, values, data[name].attrs)
    refused(data, "the grid of lon_rho and lat_rho folds over itself")


def test_a_node_far_away_makes_no_cells():
    data = ugrid("node")
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


def test_cells_that_lie_over_each_other_are_refused():
    data = ugrid("node")
    data["mesh_y"].values[:] = np.random.default_rng(0).permutation(data["mesh_y"].values)
    refused(data, "the cells of the mesh lie over each other")


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


def test_heights_of_levels_without_their_fill_value_are_refused():
    data = schism()
    data["zcor"] = data["zcor"].fillna(9.96921e36)
    with open_ocean(data) as ocean, pytest.raises(CurrentError, match=r"zcor reaches 9\.96921e\+36 m"):
        ocean.at(LON + 0.01, LAT + 0.02, 1.0, START)


def test_dates_as_text():
    stamps = ["2020-01-01T00:00:00.000000", "2020-01-01T01:00:00.250000"]
    text = np.array([list(stamp) for stamp in stamps], "S1")
    data = fvcom().drop_vars(["Itime", "Itime2"]).assign(Times=(("time", "DateStrLen"), text))
    with open_ocean(data) as ocean:
        np.testing.assert_allclose(ocean.times, START + np.array([0.0, 3600.25]), atol=1e-6)
