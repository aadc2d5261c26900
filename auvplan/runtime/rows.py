"""A compiled program over the rows of a batch, as the device does it best.

XLA on a CPU runs the small operations of one program one after the other, so a batch in one call leaves cores
idle. The same program on several rows at once, one a thread, keeps them all busy, and one compilation serves
every number of rows. An accelerator takes all rows in one call.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvplan.runtime import cores

#: Batches of one call are padded to these sizes, so that their number never causes a compilation.
SIZES = (1, 8, 32, 128)

T = TypeVar("T")


def batch_map(program: Callable[..., T], *rows: Any) -> T:
    """Apply a compiled program to every row of a batch.

    Args:
        program: takes trees of arrays that share a leading axis, and returns such a tree, row by row.
        rows: the trees, of arrays or PRNG keys with a leading axis B >= 1.

    Returns:
        What the program returns for all B rows, as NumPy arrays.
    """
    leaves, tree = jax.tree.flatten(rows)
    leaves = [_Leaf(leaf) for leaf in leaves]
    count = len(leaves[0].values)

    def call(index: NDArray[np.int_]) -> T:
        return jax.device_get(program(*tree.unflatten([leaf[index] for leaf in leaves])))

    if jax.default_backend() == "cpu":
        parts = _threaded(call, [np.array([row]) for row in range(count)])
    else:
        parts = [
            jax.tree.map(lambda leaf, real=real: leaf[:real], call(index))
            for index, real in padded_batches(count)
        ]
    return jax.tree.map(lambda *part: np.concatenate(part), *parts)


def over_rows(function: Callable[..., T]) -> Callable[..., T]:
    """`jax.vmap`, but for batches of one, which are traced without their axis.

    What `batch_map` calls on a CPU has one row: a program without the axis takes a quarter less to compile.
    """

    def mapped(*rows: Any) -> T:
        if len(jax.tree.leaves(rows)[0]) > 1:
            return jax.vmap(function)(*rows)
        result = function(*jax.tree.map(lambda leaf: leaf[0], rows))
        return jax.tree.map(lambda leaf: jnp.expand_dims(leaf, 0), result)

    return mapped


class _Leaf:
    """One array on the host; PRNG keys as their data."""

    def __init__(self, leaf: Any):
        keys = isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        self.kind = jax.random.key_impl(leaf) if keys else None
        self.values = np.asarray(jax.random.key_data(leaf) if keys else leaf)

    def __getitem__(self, index: NDArray[np.int_]) -> Any:
        chosen = self.values[index]
        if self.kind is None:
            return chosen
        return jax.random.wrap_key_data(jax.device_put(chosen), impl=self.kind)


def _threaded(call: Callable[[NDArray[np.int_]], T], rows: list[NDArray[np.int_]]) -> list[T]:
    """Results in order; the first row goes ahead alone, so that the program is compiled once."""
    first = [call(rows[0])]
    if len(rows) == 1:
        return first
    precise = jax.config.read("jax_enable_x64")

    def in_thread(index: NDArray[np.int_]) -> T:
        # A thread does not inherit the precision that a context manager has chosen.
        with jax.enable_x64(precise):
            return call(index)

    with ThreadPoolExecutor(min(len(rows) - 1, cores.count())) as pool:
        return first + list(pool.map(in_thread, rows[1:]))


def padded_batches(count: int, sizes: tuple[int, ...] = SIZES) -> Iterator[tuple[NDArray[np.int_], int]]:
    """Indices below `count` in batches of the given sizes, padded by the first, and how many are real."""
    begin = 0
    while begin < count:
        left = count - begin
        # The smallest size that holds the rest, or else the largest.
        size = next((s for s in sizes if s >= left), sizes[-1])
        real = min(size, left)
        index = np.full(size, begin)
        index[:real] = np.arange(begin, begin + real)
        yield index, real
        begin += real


def elementwise(program: Callable[..., T], *arrays: ArrayLike, together: int) -> T:
    """Apply a compiled program to the elements of arrays, in calls of one size: their number never compiles.

    Args:
        program: takes as many rows [together] as there are arrays, and returns a tree of such rows.
        arrays: that broadcast with each other.
        together: elements of one call.

    Returns:
        What the program returns, in NumPy, in the arrays' shape.
    """
    spread = np.broadcast_arrays(*arrays)
    shape, size = spread[0].shape, spread[0].size
    rows = [axis.ravel() if size else np.zeros(1, axis.dtype) for axis in spread]
    parts = []
    for index, real in padded_batches(max(size, 1), (together,)):
        found = program(*(row[index] for row in rows))
        parts.append(jax.tree.map(lambda leaf, real=real: np.asarray(leaf)[:real], found))
    return jax.tree.map(lambda *part: np.concatenate(part)[:size].reshape(shape), *parts)
