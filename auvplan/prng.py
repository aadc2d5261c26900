"""PRNG keys on the host: JAX's own functions, each as one stored program in place of several small ones."""

from functools import partial

import jax
import numpy as np
from numpy.typing import ArrayLike

from auvplan.compiled import compiled


def of_seeds(seeds: ArrayLike) -> jax.Array:
    """[B] PRNG keys of B seeds, those of `jax.random.key`."""
    return _of_seeds(np.asarray(seeds))


def parts(key: jax.Array, count: int) -> tuple[jax.Array, ...]:
    """A key split into so many, those of `jax.random.split`."""
    return _parts(key, count=count)


def folded(key: jax.Array, *numbers: int) -> jax.Array:
    """A key with numbers folded into it one after the other, as by `jax.random.fold_in`."""
    return _folded(key, np.asarray(numbers))


def stacked(keys: list[jax.Array]) -> jax.Array:
    """[B] keys from B single ones."""
    data = np.stack([np.asarray(jax.random.key_data(key)) for key in keys])
    return jax.random.wrap_key_data(jax.device_put(data), impl=jax.random.key_impl(keys[0]))


@compiled
def _of_seeds(seeds: jax.Array) -> jax.Array:
    return jax.vmap(jax.random.key)(seeds)


@partial(compiled, static_argnames=("count",))
def _parts(key: jax.Array, count: int) -> tuple[jax.Array, ...]:
    split = jax.random.split(key, count)
    return tuple(split[k] for k in range(count))


@compiled
def _folded(key: jax.Array, numbers: jax.Array) -> jax.Array:
    for k in range(numbers.shape[0]):
        key = jax.random.fold_in(key, numbers[k])
    return key
