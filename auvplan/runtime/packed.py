"""Arrays on grids whose sizes are data to compiled programs: one program serves grids of many sizes."""

from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from auvplan.runtime.pytree import is_ours

#: Lengths that flat arrays are padded to; beyond, multiples of the last.
_LENGTHS = (1 << 12, 1 << 14, 1 << 16, *(1 << power for power in range(17, 22)))
#: Lengths that nodes of one axis are padded to before those.
_AXIS = (16, 48, 256, 1024)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Packed:
    """An array on a grid, flat, in a length that grids of many sizes share.

    Attributes:
        values: [..., P], those of each grid in order, then padding that is never looked up.
        counts: [D] int32, nodes along each axis of the grid.
        several: [D] whether there is more than one.
    """

    values: jax.Array
    counts: jax.Array
    several: tuple[bool, ...] = field(metadata={"static": True})

    @classmethod
    def of(cls, array: Any, axes: int) -> Self:
        """Pack an array [..., *sizes] whose last `axes` axes are those of the grid, rising nodes where 1."""
        values = np.asarray(array)
        kept, grid = np.split(values.shape, [values.ndim - axes])
        count, lengths, last = int(grid.prod()), (_AXIS if axes == 1 else ()) + _LENGTHS, _LENGTHS[-1]
        length = next((length for length in lengths if length >= count), -(-count // last) * last)
        padding = [(0, 0)] * len(kept) + [(0, length - count)]
        rows = np.pad(values.reshape(*kept, count), padding, constant_values=np.inf if axes == 1 else 0)
        with jax.ensure_compile_time_eval():  # what is kept outlasts the trace that first asks for it
            values, counts = jax.device_put((rows, grid.astype(np.int32)))
        return cls(values, counts, tuple((grid > 1).tolist()))

    @property
    def dtype(self) -> np.dtype:
        """The type of the values."""
        return self.values.dtype

    def __mul__(self, factor: jax.Array) -> Self:
        """Return a multiple."""
        return replace(self, values=self.values * factor)


class Packable:
    """A dataclass of arrays on grids that compiled programs take packed."""

    def grids(self) -> dict[str, tuple[int, int]]:
        """Return the arrays to be packed by name: all axes, and how many of the last are those of a grid."""
        raise NotImplementedError

    @cached_property
    def packed(self) -> Self:
        """The same with its arrays packed; itself where JAX traces them, or a batch is stacked."""
        arrays = [(name, getattr(self, name), *axes) for name, axes in self.grids().items()]
        if any(isinstance(array, Tracer | Packed) or np.ndim(array) != all_ for _, array, all_, _ in arrays):
            return self
        parts = {name: Packed.of(array, axes) for name, array, _, axes in arrays}
        return replace(self, **parts)  # type: ignore[type-var]

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is packed."""
        return {each.name: getattr(self, each.name) for each in fields(self)}  # type: ignore[arg-type]


def with_packed(tree: Any) -> Any:
    """Return a tree of arguments whose grids are packed, but for those that classes of others hold.

    These may look at their arrays.
    """
    leaves, form = jax.tree.flatten(tree, is_leaf=lambda part: not _is_opened(type(part)))
    packable = [_is_packable(type(leaf)) for leaf in leaves]
    if not any(packable):
        return tree
    pairs = zip(leaves, packable, strict=True)
    return form.unflatten([leaf.packed if ours else leaf for leaf, ours in pairs])


def in_form_of(given: Any, slopes: list[Any]) -> list[jax.Array]:
    """Return derivatives by the leaves of `with_packed(given)` as those by the leaves of `given`.

    What is packed has one place more for each grid, and padding; it knows no times beyond the first of even
    ones, whose others follow from it.
    """
    form, is_leaf = jax.tree.structure(with_packed(given)), lambda part: isinstance(part, Packed)
    by_part = jax.tree.leaves(form.unflatten(slopes), is_leaf=is_leaf)
    packed = jax.tree.leaves(with_packed(given), is_leaf=is_leaf)
    found = []
    for slope, part, leaf in zip(by_part, packed, jax.tree.leaves(given), strict=True):
        if isinstance(part, Packed):
            kept, known = np.shape(leaf)[: np.ndim(leaf) - len(part.several)], int(np.prod(part.counts))
            values = jnp.zeros(np.shape(leaf)).reshape(*kept, -1)
            if np.ndim(slope.values):  # of what is no float there is none
                values = values.at[..., :known].set(slope.values[..., :known])
            slope = values.reshape(np.shape(leaf))
        found.append(slope[tuple(map(slice, np.shape(leaf)))] if np.ndim(slope) else slope)
    return found


@cache
def _is_packable(kind: type) -> bool:
    return issubclass(kind, Packable) and is_ours(kind)


@cache
def _is_opened(kind: type) -> bool:
    return is_ours(kind) and not issubclass(kind, Packable)


def flat(array: Any) -> jax.Array:
    """Return the values of an array, packed or not, in one row."""
    return (array.values if isinstance(array, Packed) else array).reshape(-1)


def sizes(array: Any, axes: int) -> tuple[Any, ...]:
    """Return the nodes along the last axes of an array: numbers, or traced ones where it is packed.

    Where there is one, it is a number.
    """
    if isinstance(array, Packed):
        return tuple(array.counts[k] if several else 1 for k, several in enumerate(array.several))
    return array.shape[array.ndim - axes :]


def is_one(size: Any) -> bool:
    """Return whether a size of `sizes` is one."""
    return isinstance(size, int) and size == 1
