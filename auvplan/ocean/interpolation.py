"""Interpolation on a grid, linear in north, east, depth and time, with slopes from the same corners."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from auvplan.runtime.compiled import compiled
from auvplan.runtime.packed import flat, is_one, sizes
from auvplan.runtime.pytree import instantiated, is_symbolic_zero

#: Uneven nodes up to which all are compared with, which beats a search; more would only make code longer.
_FEW = 48

#: North, east, depth, time of N points, [N] each.
_Places = tuple[jax.Array, ...]


@jax.custom_jvp
def _interpolated(fields: tuple[jax.Array, ...], axes: tuple, places: _Places) -> tuple[jax.Array, ...]:
    """Return each of the fields [T, Z, X, Y] at N places, linear between nodes; all may be packed."""
    return _apart(lambda: tuple(value for value, _ in _with_slopes(fields, axes, places)), axes)


@partial(_interpolated.defjvp, symbolic_zeros=True)
def _interpolated_jvp(primals: tuple, tangents: tuple) -> tuple[tuple, tuple]:
    """Take the slopes from the corners that the value is from: nothing is looked up twice."""
    if not is_symbolic_zero(tangents[:2]):
        return jax.jvp(_interpolated.__wrapped__, primals, instantiated(tangents, primals))
    moves = tangents[2]
    values, changes = [], []
    for value, slopes in _apart(
        lambda: _with_slopes(*primals, wanted=[not is_symbolic_zero(move) for move in moves]), primals[1]
    ):
        terms = [slope * move for slope, move in zip(slopes, moves, strict=True) if slope is not None]
        values.append(value)
        changes.append(sum(terms, jnp.zeros_like(value)))
    return tuple(values), tuple(changes)


def _with_slopes(
    fields: tuple[jax.Array, ...], axes: tuple, places: _Places, wanted: Sequence[bool] = (False,) * 4
) -> list[tuple[jax.Array, list]]:
    """Value, and the wanted slopes along north, east, depth and time, of each field.

    A slope is None where it is not wanted, or the axis has one node.
    """
    shape = sizes(fields[0], 4)
    corner, shares, spans = _located(shape, axes, places)
    found = []
    for field in fields:
        corners = [values.astype(places[0].dtype) for values in _corners(field, shape, corner)]
        value, across = _blend(corners, shares)
        slopes = [
            change / span if want and span is not None else None
            for change, span, want in zip(across, spans, wanted, strict=True)
        ]
        found.append((value, slopes))
    return found


def _apart(look_up: Callable[[], Any], axes: tuple) -> Any:
    """Return what `look_up` finds, stored before it is used; not a number where the spacing is not positive.

    XLA on a CPU fuses operations into every expression that uses their results, and would look the corners up
    again for each. It fuses nothing across a branch, so here is one that is always taken.
    """
    if jax.default_backend() != "cpu":
        return look_up()

    def nothing() -> Any:
        return jax.tree.map(lambda row: jnp.full(row.shape, jnp.nan, row.dtype), jax.eval_shape(look_up))

    return jax.lax.cond(_positive(jax.lax.stop_gradient(axes[1])), look_up, nothing)


@jax.custom_batching.custom_vmap
def _positive(spacing: jax.Array) -> jax.Array:
    """Return whether all of a spacing is positive.

    One answer for a batch, or JAX would compute both branches.
    """
    return jnp.min(spacing) > 0.0


@_positive.def_vmap
def _positive_in_batch(_: int, __: list, spacing: jax.Array) -> tuple[jax.Array, bool]:
    return _positive(jnp.min(spacing, axis=0)), False


#: Compiled, or every call outside a compiled program would run operation by operation.
interpolated = compiled(_interpolated)


def _located(shape: tuple[Any, ...], axes: tuple, places: _Places) -> tuple[jax.Array, tuple, tuple]:
    """Locate places in the grid.

    Returns:
        Flat index of the lowest corner of each place's cell, shares of the way to the highest one along
        north, east, depth, time, and the spans of the cell along them; both None along an axis of one node.
    """
    origin, spacing, depths, times, step = axes
    x, y, z, t = places
    cells = (
        _cell((x - origin[0]) / spacing[0], shape[2], spacing[0]),
        _cell((y - origin[1]) / spacing[1], shape[3], spacing[1]),
        _cell_between(z, depths),
        _cell_between(t, times) if step is None else _cell((t - flat(times)[0]) / step, shape[0], step),
    )
    north, east, depth, time = (cell[0] for cell in cells)
    corner = ((time * shape[1] + depth) * shape[2] + north) * shape[3] + east
    return corner, tuple(cell[1] for cell in cells), tuple(cell[2] for cell in cells)


def _cell(place: jax.Array, size: Any, span: jax.Array) -> tuple[jax.Array, Any, Any]:
    """Index, share and span of the cell of a place in steps from the first of `size` even nodes.

    The span is infinite where the place is beyond the nodes: nothing changes there.
    """
    if is_one(size):
        return jnp.zeros(place.shape, jnp.int32), None, None
    within = (place > 0.0) & (place < size - 1.0)
    place = jnp.clip(place, 0.0, size - 1.0)
    first = jnp.minimum(place.astype(jnp.int32), size - 2)
    return first, place - first, jnp.where(within, span, jnp.inf)


def _cell_between(place: jax.Array, nodes: Any) -> tuple[jax.Array, Any, Any]:
    """As `_cell`, between rising nodes; padding is infinite."""
    (size,), nodes = sizes(nodes, 1), flat(nodes)
    if is_one(size):
        return jnp.zeros(place.shape, jnp.int32), None, None
    if len(nodes) > _FEW:
        first = jnp.searchsorted(nodes[1:], place, side="right").astype(jnp.int32)
    else:
        first = jnp.zeros(place.shape, jnp.int32)
        for node in range(1, len(nodes)):
            first = first + (place >= nodes[node]).astype(jnp.int32)
    first = jnp.minimum(first, size - 2)
    low, high, end = (
        nodes.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)
        for index in (first, first + 1, size - 1)
    )
    share = (place - low) / (high - low)
    within = (place > nodes[0]) & (place < end)
    return first, jnp.clip(share, 0.0, 1.0), jnp.where(within, high - low, jnp.inf)


def _corners(field: Any, shape: tuple[Any, ...], corner: jax.Array) -> list[jax.Array]:
    """Return values at the corners of each place's cell, [N] each, time first and east last, low before high.

    An axis with one node has one corner.
    """
    row = flat(field)
    strides = (shape[1] * shape[2] * shape[3], shape[2] * shape[3], shape[3], 1)
    offsets: list[Any] = [0]
    for stride, size in zip(strides, shape, strict=True):
        offsets = [offset + high for offset in offsets for high in ((0,) if is_one(size) else (0, stride))]
    return [
        row.at[corner + offset].get(mode="promise_in_bounds", wrap_negative_indices=False)
        for offset in offsets
    ]


def _blend(corners: list[jax.Array], shares: tuple[jax.Array | None, ...]) -> tuple[jax.Array, list[Any]]:
    """Value, and its change across the cell along north, east, depth, time; nothing along one node."""
    north, east, depth, time = shares
    values, slopes = corners, []
    for share in (east, north, depth, time):
        if share is None:
            slopes.append([0.0])
            continue
        ends = list(zip(values[::2], values[1::2], strict=True))
        across = [high - low for low, high in ends]
        slopes = [_halved(slope, share) for slope in slopes]
        slopes.append(across)
        values = [low + share * change for (low, _), change in zip(ends, across, strict=True)]
    along_east, along_north, along_depth, along_time = (slope[0] for slope in slopes)
    return values[0], [along_north, along_east, along_depth, along_time]


def _halved(values: list[Any], share: jax.Array) -> list[Any]:
    """Blended in pairs; what is zero along an axis of one node stays so."""
    if len(values) == 1:
        return values
    return [low + share * (high - low) for low, high in zip(values[::2], values[1::2], strict=True)]
