"""Interpolation on a grid against a NumPy twin; its slopes, batches, precision and what XLA makes of it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.ocean import GriddedCurrent, interpolation
from tests.ocean.grids import AXES, ORIGIN, SPACING, axes_of, edges, grid, look_up, places, twin

#: u, v, w of a current at x, y, z, t.
each_row = jax.vmap(lambda field, *at: jnp.stack(field(*at)), in_axes=(0, None, None, None, None))


@pytest.mark.parametrize(("axes", "vertical"), [*((axes, True) for axes in AXES), ("uneven", False)])
def test_equals_the_sum_over_sixteen_corners(axes, vertical):
    field = grid(axes, vertical)
    points = places(field)
    found = look_up(field, *points)
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, twin(field, points), atol=2e-5)


@pytest.mark.usefixtures("x64")
def test_equals_the_twin_in_double_precision():
    field = grid("uneven")
    points = places(field)
    found = look_up(field, *points)
    assert found.dtype == jnp.float64
    np.testing.assert_allclose(found, twin(field, points), atol=1e-12)


@given(
    slopes=st.tuples(*[st.floats(-1.0, 1.0)] * 4),
    share=st.tuples(*[st.floats(0.0, 1.0)] * 4),
    axes=st.sampled_from(["even", "uneven", "two", "many uneven"]),
)
@settings(max_examples=15, deadline=None)
def test_linear_fields_are_exact(slopes, share, axes):
    nodes = axes_of(grid(axes))
    extent = [axis[-1] - axis[0] for axis in nodes]
    x, y, z, t = (
        slope * (axis - axis[0]) / length for slope, axis, length in zip(slopes, nodes, extent, strict=True)
    )
    values = t[:, None, None, None] + z[:, None, None] + x[:, None] + y
    field = GriddedCurrent.from_arrays(
        values, -values, origin=ORIGIN, spacing=SPACING, depths=nodes[2], times=nodes[3]
    )
    place = [axis[0] + part * length for axis, part, length in zip(nodes, share, extent, strict=True)]
    u, v, w = look_up(field, *place)
    assert float(u) == pytest.approx(np.dot(slopes, share), abs=5e-6)
    assert float(v) == -float(u)
    assert float(w) == 0.0


@pytest.mark.parametrize("axes", ["even", "uneven", "one level", "one time"])
@pytest.mark.usefixtures("x64")
def test_slopes_equal_finite_differences(axes):
    field = grid(axes)
    points = places(field, count=30, beyond=0.0)
    mode = jax.jacrev if axes == "uneven" else jax.jacfwd
    slopes = jax.jit(jax.vmap(mode(lambda p: look_up(field, *p))))(jnp.asarray(points.T))
    # The interpolant is linear along each axis, so a difference within one cell is its slope.
    for k in range(4):
        step = np.zeros((4, 1))
        step[k] = 1e-5
        ahead, behind = (look_up(field, *(points + sign * step)) for sign in (1, -1))
        np.testing.assert_allclose(slopes[:, :, k].T, (ahead - behind) / 2e-5, atol=1e-8)


@pytest.mark.parametrize("axes", ["even", "uneven"])
def test_beyond_the_edges_the_nearest_holds_and_slopes_are_zero(axes):
    field = grid(axes)
    low, high = (np.asarray(edge) for edge in edges(field))
    inside = 0.6 * low + 0.4 * high
    slopes = jax.jit(jax.jacfwd(lambda p: look_up(field, *p)))
    for k in range(4):
        for edge, beyond in ((low[k], low[k] - 77.0), (high[k], high[k] + 77.0)):
            at, off = inside.copy(), inside.copy()
            at[k], off[k] = edge, beyond
            np.testing.assert_allclose(look_up(field, *off), look_up(field, *at), atol=1e-6)
            slope = slopes(jnp.asarray(off))
            np.testing.assert_array_equal(slope[:, k], 0.0)
            assert (np.abs(np.delete(slope, k, axis=1)).max(axis=0) > 0.0).all()


def test_derivatives_by_values_are_the_weights_of_the_corners():
    field = grid("uneven")
    at = [axis[1] + 0.25 * (axis[2] - axis[1]) for axis in axes_of(field)]
    slope = jax.jit(jax.grad(lambda u: replace(field, u=u)(*at)[0]))(field.u)
    weights = [0.75, 0.25]
    found = np.asarray(slope[1:3, 1:3, 1:3, 1:3])
    np.testing.assert_allclose(found, np.einsum("a,b,c,d->abcd", *[weights] * 4), atol=1e-5)
    assert float(slope.sum()) == pytest.approx(1.0, abs=1e-6)
    assert int((slope != 0.0).sum()) == 16
    none = jax.jit(jax.grad(lambda u: replace(field, u=u)(*at)[1]))(field.u)
    np.testing.assert_array_equal(none, 0.0)


def test_second_derivatives_mix_axes():
    field = grid("uneven")
    at = jnp.asarray([axis[1] + 0.25 * (axis[2] - axis[1]) for axis in axes_of(field)])
    curved = np.asarray(jax.jit(jax.hessian(lambda p: field(*p)[0]))(at))
    np.testing.assert_allclose(curved, curved.T, atol=1e-8)
    np.testing.assert_allclose(np.diagonal(curved), 0.0, atol=1e-8)
    assert np.abs(curved[0, 1]) > 0.0


def test_batches_equal_single_places_and_shapes_broadcast():
    field = grid("uneven")
    points = places(field, count=24)
    together = look_up(field, *points)
    alone = np.stack([look_up(field, *point) for point in points.T], axis=1)
    np.testing.assert_allclose(together, alone, atol=2e-6)
    plane = look_up(field, *points.reshape(4, 4, 6))
    np.testing.assert_array_equal(plane.reshape(3, -1), together)
    np.testing.assert_allclose(
        jax.jit(jax.vmap(look_up, (None, 0, 0, 0, 0), 1))(field, *points), together, atol=2e-6
    )
    x, y, z, t = points
    crossed = look_up(field, x[:5, None], y[None, :3], z[0], t[0])
    assert crossed.shape == (3, 5, 3)
    np.testing.assert_allclose(crossed[:, 4, 2], look_up(field, x[4], y[2], z[0], t[0]), atol=2e-6)


def test_batches_of_currents():
    fields = [grid("uneven", seed=seed) for seed in (0, 5)]
    both = jax.tree.map(lambda a, b: jnp.stack([a, b]), *fields)
    points = places(fields[0])
    found = jax.jit(each_row)(both, *points)
    for field, row in zip(fields, found, strict=True):
        np.testing.assert_allclose(row, look_up(field, *points), atol=2e-6)
    slope = jax.jit(jax.grad(lambda field: each_row(field, *points)[0].sum(), allow_int=True))(both)
    assert float(jnp.abs(slope.u[0]).sum()) > 0.0
    np.testing.assert_array_equal(slope.u[1], 0.0)


def test_the_branch_keeps_look_ups_apart_and_changes_nothing(monkeypatch):
    field = grid("uneven")
    points = tuple(jnp.asarray(axis, jnp.float32) for axis in places(field, 5000))
    both = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), field)

    def branches(function, *arguments):
        return "stablehlo.case" in jax.jit(function).lower(*arguments).as_text()

    assert branches(lambda *at: field(*at), *points)
    assert branches(each_row, both, *points)  # not both sides of it, as a batched condition would have it
    branched = np.stack(field(*points))
    # As on an accelerator, which has no need of it; not through what is compiled already.
    monkeypatch.setattr(interpolation.jax, "default_backend", lambda: "gpu")
    nodes = field.origin, field.spacing, field.depths, field.times, field.step
    fields = field.u, field.v, field.w
    assert not branches(lambda *at: interpolation._interpolated(fields, nodes, at), *points)
    plain = interpolation._interpolated(fields, nodes, points)
    np.testing.assert_allclose(branched, np.stack(plain), atol=2e-6)


def test_a_grid_without_spacing_has_no_values():
    broken = replace(grid("uneven"), spacing=jnp.zeros(2))
    assert np.isnan(jnp.stack(broken(0.0, 100.0, 5.0, 0.0))).all()
