"""Gridded currents: what they are made from, what stands where there is no water, and where they hold."""

import chex
import jax
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

import auvplan as ap
from auvplan.ocean import CurrentError, GriddedCurrent
from auvplan.ocean.currents import SumCurrent, is_quasi_steady, is_steady
from tests.ocean.grids import arrays, edges, grid, look_up, places

GOOD = {
    "u": np.ones((2, 3, 4, 5)),
    "v": np.ones((2, 3, 4, 5)),
    "spacing": 100.0,
    "depths": [0.0, 5.0, 10.0],
    "times": [0.0, 3600.0],
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"u": np.ones((2, 3, 4, 4))}, r"one shape, got \(2, 3, 4, 4\), \(2, 3, 4, 5\)"),
        ({"w": np.ones((2, 3, 4))}, r"one shape, got .*\(2, 3, 4\)"),
        ({"u": np.ones((4, 5)), "v": np.ones((4, 5))}, r"\[T, Z, X, Y\]"),
        ({"u": np.ones((2, 3, 0, 5)), "v": np.ones((2, 3, 0, 5))}, r"\[T, Z, X, Y\]"),
        ({"u": "fast"}, "u must be given in numbers, got 'fast'"),
        ({"w": [[1.0], [1.0, 2.0]]}, "w must be an array of numbers"),
        ({"depths": [0.0, 5.0]}, r"depths must be 3 finite rising numbers, got \[0.0, 5.0\]"),
        ({"depths": [0.0, 5.0, 5.0]}, "depths must be 3 finite rising"),
        ({"depths": [10.0, 5.0, 0.0]}, "depths must be 3 finite rising"),
        ({"depths": ["top", "middle", "bottom"]}, "depths must be given in numbers, got 'top'"),
        ({"times": [0.0, np.nan]}, "times must be 2 finite rising"),
        ({"times": np.arange(6.0)}, "times must be 2 finite rising numbers, got 6 from 0 to 5"),
        ({"times": [3600.0, 0.0]}, "times must be 2 finite rising"),
        ({"times": [1.7e9, 1.7e9 + 3600.0]}, "times .* too far from zero for steps of 3600"),
        (
            {"times": np.array(["2026-01-01T00", "2026-01-01T01"], "M8[h]")},
            "times must be given in numbers, got da",
        ),
        ({"u": np.where(np.arange(5) == 2, 1e20, np.ones((2, 3, 4, 5)))}, r"reaches 1e\+20 m/s, which none"),
        ({"v": np.full((2, 3, 4, 5), -101.0)}, "reaches 101 m/s, which none does"),
        ({"spacing": 0.0}, "spacing must be positive, got 0.0"),
        ({"spacing": (100.0, -1.0)}, "spacing must be positive"),
        ({"spacing": (100.0, 100.0, 5.0)}, "spacing must be two finite numbers"),
        ({"spacing": np.inf}, "spacing must be two finite numbers"),
        ({"origin": (0.0, np.nan)}, "origin must be two finite numbers"),
        ({"origin": (0.0, 0.0, 0.0)}, "origin must be two finite numbers"),
        ({"v": np.full((2, 3, 4, 5), np.nan)}, "no value anywhere"),
    ],
)
def test_what_cannot_be_a_current_is_refused(change, message):
    with pytest.raises(CurrentError, match=message) as refused:
        GriddedCurrent.from_arrays(**(GOOD | change))
    assert "\n" not in str(refused.value)


def test_attributes_and_properties():
    field = grid("even")
    np.testing.assert_array_equal(field.u, arrays("even")[0].astype(np.float32))
    assert float(field.step) == 600.0
    assert grid("uneven").step is None
    assert (field.steady, is_quasi_steady(field)) == (False, True)
    one = grid("one time")
    assert (one.steady, is_quasi_steady(one)) == (True, False)
    assert is_steady(SumCurrent(one, ap.UniformCurrent(0.1)))
    assert is_quasi_steady(SumCurrent(field, ap.UniformCurrent(0.1)))
    speeds = np.hypot(*arrays("even")[:2])
    assert field.fastest == pytest.approx(speeds.max(), rel=1e-6)
    still = grid("even", vertical=False)
    assert still.w is None
    np.testing.assert_array_equal(look_up(still, *places(still, 9))[2], 0.0)


def test_times_that_are_nearly_even_are_even_and_no_others():
    def step(times):
        ones = np.ones((len(times), 1, 2, 2))
        return GriddedCurrent.from_arrays(ones, ones, spacing=1.0, times=times).step

    hours = 3600.0 * np.arange(48)
    assert float(step(hours + np.random.default_rng(0).uniform(-0.1, 0.1, 48))) == pytest.approx(
        3600.0, rel=1e-5
    )
    # Each step differs from its neighbours by little, but the middle is half a minute late.
    assert step(hours + 30.0 * np.sin(np.pi * np.arange(48) / 47.0)) is None


def test_a_current_is_a_pytree_that_goes_through_jit():
    field = grid("uneven")
    points = places(field, 6)
    copy = jax.tree.unflatten(jax.tree.structure(field), jax.tree.leaves(field))
    assert isinstance(copy, GriddedCurrent)
    np.testing.assert_allclose(look_up(field, *points), look_up(copy, *points), atol=2e-6)
    doubled = jax.tree.map(lambda leaf: leaf, field)
    assert jax.tree.structure(doubled) == jax.tree.structure(field)
    assert jax.tree.structure(grid("uneven", vertical=False)) != jax.tree.structure(field)


def lake():
    """u, v of a round lake whose water moves at its level's number plus 1 m/s; dry around and below it."""
    north, east = np.meshgrid(np.arange(12.0), np.arange(10.0), indexing="ij")
    away = np.hypot(north - 5.0, east - 4.0)
    wet = np.stack([away < 3.5, away < 2.0, away < 0.0])  # the third level lies below the bed
    u = np.where(wet, 1.0 + np.arange(3.0)[:, None, None], np.nan)[None].repeat(2, axis=0)
    return u, -u, wet


def test_no_value_never_becomes_still_water():
    u, v, wet = lake()
    field = GriddedCurrent.from_arrays(u, v, spacing=50.0, depths=[0.0, 10.0, 40.0], times=[0.0, 600.0])
    np.testing.assert_array_equal(field.water, wet)
    # Land has its level's nearest water; below the last water of a column stands that.
    np.testing.assert_array_equal(field.u[:, 0], 1.0)
    deeper = np.where(wet[0] & ~wet[1], 1.0, 2.0)
    np.testing.assert_array_equal(field.u[:, 1:], np.broadcast_to(deeper, (2, 2, *deeper.shape)))
    assert field.fastest == pytest.approx(np.hypot(2.0, 2.0))
    x, y, z, t = np.random.default_rng(0).uniform((-50, -50, -5, -9), (650, 550, 90, 700), (300, 4)).T
    found = np.asarray(look_up(field, x, y, z, t)[0])
    places = np.clip(x / 50.0, 0.0, 11.0), np.clip(y / 50.0, 0.0, 9.0)
    share = RegularGridInterpolator((np.arange(12.0), np.arange(10.0)), deeper - 1.0)(
        np.stack(places, axis=1)
    )
    np.testing.assert_allclose(found, 1.0 + share * np.clip(z / 10.0, 0.0, 1.0), rtol=1e-6)


def test_the_last_water_of_a_column_holds_to_its_bed():
    """A plateau of 48 m beside a trench, whose water of the next depth is none of the plateau's."""
    depths, plateau = np.array([0.0, 10.0, 30.0, 50.0, 75.0]), np.arange(9) < 5
    u = np.where(plateau, 0.3, -0.5)[None, None, :, None] * np.ones((1, len(depths), 9, 3))
    u[:, 3:, plateau] = np.nan
    field = GriddedCurrent.from_arrays(u, 0.0 * u, spacing=500.0, depths=depths)
    x, z = np.meshgrid([0.0, 900.0, 2000.0], [25.0, 35.0, 44.0, 48.0])
    np.testing.assert_allclose(look_up(field, x.ravel(), 500.0, z.ravel(), 0.0)[0], 0.3, rtol=1e-6)
    np.testing.assert_allclose(look_up(field, 4000.0, 500.0, 60.0, 0.0)[0], -0.5, rtol=1e-6)


def test_land_takes_the_nearest_water_by_metres():
    u = np.full((1, 1, 5, 5), np.nan)
    u[0, 0, 4, 2], u[0, 0, 2, 0] = 1.0, 3.0  # from node (2, 2): two nodes north, two nodes west
    for spacing, nearest in (((10.0, 100.0), 1.0), ((100.0, 10.0), 3.0)):
        field = GriddedCurrent.from_arrays(u, 0.0 * u, spacing=spacing)
        assert float(field.u[0, 0, 2, 2]) == nearest


def test_dry_levels_above_the_first_water_take_it():
    u, v, wet = lake()
    field = GriddedCurrent.from_arrays(u[:, ::-1], v[:, ::-1], spacing=50.0, depths=[0, 5, 9], times=[0, 600])
    np.testing.assert_array_equal(field.u[0, 0], 2.0)
    np.testing.assert_array_equal(field.u[0, 2], 1.0)
    np.testing.assert_array_equal(field.water, wet[::-1])


def test_dry_at_one_time_or_in_one_component_is_dry():
    u, v, w = (np.ones((3, 1, 3, 3)) * value for value in (1.0, 2.0, 3.0))
    u[1, 0, 0, 0], v[2, 0, 1, 1], w[0, 0, 2, 2] = np.nan, np.inf, np.nan
    u[0, 0, 0, 0] = 99.0
    field = GriddedCurrent.from_arrays(u, v, w, spacing=1.0, times=[0, 1, 2])
    np.testing.assert_array_equal(np.asarray(field.water[0]), ~np.eye(3, dtype=bool))
    for component, value in zip((field.u, field.v, field.w), (1.0, 2.0, 3.0), strict=True):
        np.testing.assert_array_equal(component, value)


def test_what_a_mask_hides_is_no_water():
    u, v = np.random.default_rng(3).normal(0.0, 0.3, (2, 2, 3, 4, 5))
    hidden = np.broadcast_to(np.arange(5) == 2, u.shape)
    masked = np.ma.array(np.where(hidden, 9.96921e36, u), mask=hidden)
    found = GriddedCurrent.from_arrays(**(GOOD | {"u": masked, "v": v}))
    assert not np.asarray(found.water)[..., 2].any()
    chex.assert_trees_all_equal(
        found, GriddedCurrent.from_arrays(**(GOOD | {"u": masked.filled(np.nan), "v": v}))
    )


@pytest.mark.parametrize("unit", ["m8[h]", "m8[s]", "m8[ns]"])
def test_durations_are_taken_in_seconds(unit):
    found = GriddedCurrent.from_arrays(**(GOOD | {"times": np.array([0, 1], "m8[h]").astype(unit)}))
    np.testing.assert_array_equal(found.times, [0.0, 3600.0])


def test_covers():
    field = grid("uneven")
    (north, east, _, first), (far_north, far_east, _, last) = edges(field)
    x, y, t = 0.5 * (north + far_north), 0.5 * (east + far_east), 0.5 * (first + last)
    assert field.covers(x, y, t)
    assert field.covers([north, far_north], [east, far_east], [first, last]).all()
    outside = [
        (north - 1.0, y, t), (far_north + 1.0, y, t), (x, east - 1.0, t), (x, far_east + 1.0, t),
        (x, y, first - 1.0), (x, y, last + 1.0),
    ]  # fmt: skip
    assert not field.covers(*np.array(outside).T).any()
    assert field.covers(np.array([[x], [north - 9.0]]), [y, y, y], t).tolist() == [[True] * 3, [False] * 3]
    assert grid("one time").covers(x, y, 1e9)
