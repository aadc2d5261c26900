"""A current written as one CF data set is the same current when it is read again."""

import json

import numpy as np
import pytest

from auvplan.io.currents import open_ocean, to_cf
from auvplan.io.currents.ocean import summary_of
from auvplan.runtime.files import write_dataset
from tests.io.currents.samples import LAT, LON, START, fvcom, regular, roms, schism, ugrid, write

MADE = {
    "regular": regular,
    "roms": lambda: roms(land=[(3, 4)]),
    "fvcom": fvcom,
    "nodes": lambda: ugrid("node"),
    "faces": lambda: ugrid("face"),
    "schism": schism,
}
REAL = [
    ["currents/norfjords160_roms_native_24h.nc"],
    ["currents/norkyst_v3_800m_5h.nc"],
    ["elsewhere/creofs_selfe_noaa.nc"],
    ["elsewhere/arctic20_polar_stereographic.nc"],
    ["elsewhere/dflowfm_simplebox_projected.nc"],
    ["elsewhere/mom5_access_om2_u.nc", "elsewhere/mom5_access_om2_v.nc"],
]


@pytest.mark.parametrize("kind", MADE)
def test_the_form_has_the_current_of_every_model_at_its_points(kind):
    with open_ocean(MADE[kind]()) as ocean:
        form, points = ocean.form, ocean.geometry.dims
        assert form["uo"].dims == form["vo"].dims == ("time", "level", *points)
        assert form["depth"].dims in (("level",), ("level", *points), ("time", "level", *points))
        assert form["time"].values.tolist() == ocean.times.tolist()
        depth = form["depth"].broadcast_like(form["uo"]).transpose(*form["uo"].dims).values
        assert (np.diff(np.where(np.isfinite(depth), depth, 1e9), axis=1) >= 0.0).all()
        place = {name: form[name].broadcast_like(form["uo"]).transpose(*form["uo"].dims).values.ravel()
                 for name in ("longitude", "latitude", "time")}  # fmt: skip
        turn = form["angle"].values if "angle" in form else 0.0
        water = form["mask"].values if "mask" in form else True
        both = np.where(
            water, (form["uo"].values + 1j * form["vo"].values) * np.exp(1j * turn), np.nan
        ).ravel()
        there = np.isfinite(both) & np.isfinite(depth.ravel())
        assert there.mean() > 0.5
        found = ocean.at(*(place[n][there] for n in ("longitude", "latitude")), depth.ravel()[there],
                         place["time"][there])  # fmt: skip
        np.testing.assert_allclose(found[0] + 1j * found[1], both[there], atol=1e-9)


def compare(paths, tmp_path, count=300):
    """Both at random places, depths and times within the first."""
    rng = np.random.default_rng(0)
    with open_ocean(paths) as one:
        written = write_dataset(to_cf(one), tmp_path / "cf.nc")
        with open_ocean(written) as two:
            np.testing.assert_allclose(two.times, one.times)
            assert (two.levels is None) == (one.levels is None)
            lon, lat = one.longitude.ravel(), one.latitude.ravel()
            if one.kind != "regular":
                pick = rng.integers(0, len(lon), count)
                lon, lat = lon[pick], lat[pick]
            else:
                lon, lat = rng.uniform(lon.min(), lon.max(), count), rng.uniform(lat.min(), lat.max(), count)
            depth, when = rng.uniform(0.0, 30.0, count), rng.uniform(one.times[0], one.times[-1], count)
            first, second = (np.stack(ocean.at(lon, lat, depth, when)[:2]) for ocean in (one, two))
    np.testing.assert_array_equal(np.isfinite(first), np.isfinite(second))
    assert np.isfinite(first).any()
    np.testing.assert_allclose(second, first, atol=2e-6)


@pytest.mark.parametrize("kind", MADE)
def test_round_trip_of_made_files(tmp_path, kind):
    compare(write(MADE[kind](), tmp_path / "made.nc"), tmp_path)


@pytest.mark.parametrize("names", REAL, ids=lambda names: names[0].split("/")[1])
def test_round_trip_of_real_files(tmp_path, shared, names):
    compare([shared / "data" / name for name in names], tmp_path)


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
    code, _, err = call("currents", tmp_path / "none.nc")
    assert (code, err) == (2, f"auvplan: {tmp_path / 'none.nc'}: no such file\n")
