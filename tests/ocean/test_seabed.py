"""Sea beds: geometry, interpolation, and the depths that look-ups vouch for."""

from dataclasses import replace

import chex
import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

import auvplan as ap
from auvplan.ocean.seabed import UNKNOWN, Seabed, SeabedError

ORIGIN = np.array([300.0, -150.0])


def rough(shape, seed, kind="rough"):
    """Depths [nx, ny] m: gentle hills, noise, or cliffs with dry pixels among them."""
    rng = np.random.default_rng(seed)
    depth = 60.0 + 30.0 * ndimage.gaussian_filter(rng.normal(size=shape), 2.0)
    if kind == "rough":
        depth += rng.normal(0.0, 5.0, shape)
    if kind == "cliffs":
        depth[rng.random(shape) < 0.05] = np.nan
    return depth


def naive_depth(depth, size, x, y):
    """Bilinear interpolation of raw depths, unknown ones as dry land."""
    index = np.stack([(x - ORIGIN[0]) / size - 0.5, (y - ORIGIN[1]) / size - 0.5])
    return ndimage.map_coordinates(np.nan_to_num(depth, nan=UNKNOWN), index, order=1, mode="nearest")


@pytest.mark.parametrize(
    ("shape", "size"), [((12, 9), 45.0), ((30, 20), 7.0), ((1, 5), 30.0), ((1, 1), 10.0)]
)
def test_depth_is_bilinear_however_pixels_are_divided(shape, size):
    depth = rough(shape, 1, "cliffs")
    depth[0, 0] = -20.0
    bed = Seabed.from_depth(depth, size, ORIGIN)
    assert float(bed.pixel_size) <= 10.0
    np.testing.assert_allclose(bed.upper, ORIGIN + size * np.array(shape), rtol=1e-6)
    low, high = ORIGIN - 30.0, ORIGIN + size * np.array(shape) + 30.0
    x, y = np.random.default_rng(0).uniform(low[:, None], high[:, None], (2, 500))
    expected = naive_depth(depth, size, x, y)
    np.testing.assert_allclose(bed.depth_at(x, y), expected, atol=2e-3)
    places = np.stack([x, y, 0.1 * x], axis=1)
    np.testing.assert_allclose(bed.altitude(places), expected - 0.1 * x, atol=2e-3)
    assert bed.altitude(places[0]) == bed.altitude(places)[0]
    # A sea bed made of one's depths is the same: files hold no more than these.
    again = Seabed.from_depth(bed.depth, float(bed.pixel_size), ORIGIN)
    assert again.shape == bed.shape


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["hills", "rough", "cliffs"]),
    st.sampled_from([4.0, 25.0]),
    st.sampled_from([None, 0.0, 12.5, 60.0]),
    st.floats(1.0, 900.0),
)
def test_no_segment_passes_over_less_than_its_ends_vouch_for(seed, kind, size, reach, longest):
    depth = rough((24, 18), seed % 1000, kind)
    bed = Seabed.from_depth(depth, size, ORIGIN, reach=reach)
    rng = np.random.default_rng(seed)
    low, high = ORIGIN - 20.0, ORIGIN + size * np.array(depth.shape) + 20.0
    first = rng.uniform(low, high, (20, 2))
    length, angle = rng.uniform(0.0, longest, (20, 1)), rng.uniform(0.0, 2 * np.pi, 20)
    last = first + length * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = np.stack([first, last])
    vouched = np.asarray(bed.shallowest_at(ends[..., 0], ends[..., 1], length[:, 0])).min(axis=0)
    share = np.linspace(0.0, 1.0, int(np.ceil(longest)) + 1)[:, None, None]
    walked = first * (1.0 - share) + last * share
    least = naive_depth(depth, size, walked[..., 0], walked[..., 1]).min(axis=0)
    assert (vouched <= least + 1e-2).all()


@pytest.mark.parametrize("size", [10.0, 30.0, 200.0])
def test_what_is_vouched_for_is_worth_having(size):
    # On a plane a look-up loses the slope times the reach of its layer.
    north = (np.arange(60) + 0.5) * size
    bed = Seabed.from_depth(np.broadcast_to(50.0 + 0.05 * north[:, None], (60, 60)), size)
    middle, fine = 30.0 * size, float(bed.pixel_size)
    for length in (0.5, 2.0, 8.0, 30.0):
        length = length * fine
        lost = float(bed.depth_at(middle, middle) - bed.shallowest_at(middle, middle, length))
        assert 0.05 * 0.5 * length <= lost + 1e-3
        assert lost <= 0.05 * max(length, fine) + 1e-3
    assert float(bed.steepest) == pytest.approx(0.05, rel=1e-3)
    far = 2.0 * float(bed.reach[-1])
    near, beyond = (float(bed.shallowest_at(middle, middle, far + more)) for more in (0.0, 500.0))
    assert near - beyond == pytest.approx(250.0 * 0.05, rel=1e-3)


def test_slopes_against_finite_differences(x64):
    bed = Seabed.from_depth(rough((20, 14), 5), 10.0, ORIGIN)
    rng = np.random.default_rng(2)
    x, y = rng.uniform(ORIGIN[:, None] + 6.0, ORIGIN[:, None] + np.array([[194.0], [134.0]]), (2, 60))
    # A difference across a line between pixel centres straddles a kink.
    off = np.abs((np.stack([x - ORIGIN[0], y - ORIGIN[1]]) / 10.0) % 1.0 - 0.5).min(axis=0) > 1e-4
    for look in map(jax.jit, (bed.depth_at, lambda x, y: bed.shallowest_at(x, y, 35.0))):
        slopes = jax.jit(jax.vmap(jax.grad(look, argnums=(0, 1))))(x, y)
        for axis, (dx, dy) in enumerate(((1e-5, 0.0), (0.0, 1e-5))):
            difference = (look(x + dx, y + dy) - look(x - dx, y - dy)) / 2e-5
            np.testing.assert_allclose(slopes[axis][off], difference[off], atol=1e-5)


def test_slopes_are_finite_at_cliffs_and_beyond_the_raster():
    bed = Seabed.from_depth([[np.nan, 4000.0], [5000.0, np.nan]], 10.0, ORIGIN)
    x, y = ORIGIN[0] + np.array([0.0, 5.0, 10.0, 1e6]), ORIGIN[1] + np.array([0.0, 5.0, 10.0, -1e6])
    for axis in jax.jit(jax.vmap(jax.grad(bed.shallowest_at, argnums=(0, 1))))(x, y):
        assert np.isfinite(axis).all()


def test_what_a_mask_hides_is_unknown():
    masked = np.ma.masked_values(np.where(np.eye(6), 32767.0, 50.0), 32767.0)
    bed = Seabed.from_depth(masked, 10.0, ORIGIN)
    chex.assert_trees_all_equal(bed, Seabed.from_depth(masked.filled(np.nan), 10.0, ORIGIN))
    assert bed.altitude([[ORIGIN[0] + 25.0, ORIGIN[1] + 25.0, 0.0]]) == UNKNOWN


def test_made_in_double_precision_it_serves_in_single():
    with jax.enable_x64(True):
        bed = Seabed.from_depth(rough((4, 5), 0), 10.0)
    assert {leaf.dtype for leaf in jax.tree.leaves(bed)} == {np.dtype(np.float32)}
    assert bed.shallowest_at(15.0, 15.0).dtype == np.float32


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"depth": np.zeros((0, 3))}, "non-empty"),
        ({"depth": np.zeros(3)}, "non-empty"),
        ({"depth": [[np.inf, 1.0]]}, "finite"),
        ({"depth": [[np.nan, np.nan]]}, "unknown everywhere"),
        ({"pixel_size": 0.0}, "pixel_size"),
        ({"clearance": -1.0}, "clearance"),
        ({"clearance": np.nan}, "clearance"),
        ({"reach": -1.0}, "reach"),
        ({"origin": (1.0, 2.0, 3.0)}, "origin"),
    ],
)
def test_bad_input_is_refused(changes, message):
    with pytest.raises(SeabedError, match=message):
        Seabed.from_depth(**({"depth": np.full((2, 2), 9.0), "pixel_size": 10.0} | changes))


def test_environment_with_a_sea_bed():
    bed = Seabed.from_depth(np.full((20, 30), 50.0), 10.0)
    env = ap.Environment(None, None, None, (0, 0, 0), (200, 300, 40), bed)
    leaves, tree = jax.tree.flatten(env)
    assert tree.unflatten(leaves).seabed.shape == (20, 30)
    assert replace(env, seabed=None).seabed is None
    with pytest.raises(ValueError, match="150 m beyond the sea bed"):
        ap.Environment(None, None, None, (0, 0, 0), (200, 450, 40), bed)


@pytest.mark.parametrize("shape", [(40, 30), (1, 25), (1, 1)])
def test_look_ups_on_the_host_are_those_of_a_program(shape):
    bed = Seabed.from_depth(rough(shape, 3), 20.0, ORIGIN)
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-200.0, 900.0, (2, 7, 60)) + ORIGIN[:, None, None]
    length = 10.0 ** rng.uniform(-1.0, 3.5, 60)
    found = bed.shallowest_at(x, y, length)
    assert found.shape == (7, 60)
    np.testing.assert_allclose(found, jax.jit(Seabed.shallowest_at)(bed, x, y, length), atol=1e-3)
    assert np.isnan(bed.shallowest_at(np.nan, 0.0, 5.0))
