"""PRNG keys on the host: JAX's own functions, each as one stored program in place of several small ones."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from auvplan.runtime import MAX_SEED
from auvplan.runtime.compiled import compiled


def as_key(key: Any, name: str = "key", instead: str = "") -> jax.Array:
    """Return a PRNG key, or by the name "keys" several [B]; old-style ones as keys of the new style.

    Raises:
        TypeError: it is something else, such as a seed; one line that says what is wanted.
        ValueError: there are several in place of one, or one in place of several.
    """
    found = _keys(key, name, instead)
    if found.ndim != (name == "keys"):
        raise ValueError(f"{name} must be {'[B]' if name == 'keys' else 'one'}, got shape {found.shape}")
    return found


def key_per(row: str, key: Any, count: int) -> jax.Array:
    """Return keys [count], one for each row, such as a "leg": one key split over them, or as many as given.

    Raises:
        TypeError: as `as_key`.
        ValueError: there are more keys, or fewer.
    """
    found = _keys(key, "key", "")
    if found.ndim and found.shape != (count,):
        raise ValueError(f"key must be one, or [{count}], one for each {row}, got shape {found.shape}")
    return found if found.ndim else jax.random.split(found, count)


def _keys(key: Any, name: str, instead: str) -> jax.Array:
    """Return PRNG keys of any shape; old-style ones, of plain numbers, as keys of the new style."""
    if isinstance(key, jax.Array) and jnp.issubdtype(key.dtype, jax.dtypes.prng_key):
        return key
    if isinstance(key, jax.Array | np.ndarray) and key.dtype == np.uint32 and key.ndim and key.shape[-1] == 2:
        return jax.random.wrap_key_data(jnp.asarray(key))
    got = repr(key) if isinstance(key, int | np.integer) else type(key).__name__
    wanted = "jax.random.key(0)" if name == "key" else "jax.random.split(jax.random.key(0), B)"
    kind = "a PRNG key" if name == "key" else "PRNG keys"
    raise TypeError(f"{name} must be {kind}, got {got}: give {wanted}{instead}")


def of_seeds(seeds: ArrayLike) -> jax.Array:
    """[B] PRNG keys of B seeds, those of `jax.random.key`.

    Raises:
        ValueError: a seed is not whole, negative or above `MAX_SEED`: its key would be that of another one.
    """
    if np.ndim(seeds) != 1:
        raise ValueError(f"seeds must be [B] whole numbers, got {seeds!r:.80}")
    for seed in np.asarray(seeds, object):
        if not isinstance(seed, int | np.integer) or not 0 <= seed <= MAX_SEED:
            raise ValueError(f"a seed is a whole number from 0 to {MAX_SEED}, got {seed!r:.80}")
    return _of_seeds(np.asarray(seeds))


def parts(key: jax.Array, count: int) -> tuple[jax.Array, ...]:
    """Return a key split into `count`, those of `jax.random.split`."""
    return _parts(key, count=count)


def folded(key: jax.Array, *numbers: int) -> jax.Array:
    """Return a key with numbers folded into it one after the other, as by `jax.random.fold_in`."""
    return _folded(key, np.asarray(numbers))


def folded_rows(keys: jax.Array, number: int) -> jax.Array:
    """[B] keys with a number folded into each."""
    return stacked([folded(key, number) for key in single(keys)])


def single(keys: jax.Array) -> list[jax.Array]:
    """Return the single ones of [B] keys."""
    data, kind = np.asarray(jax.random.key_data(keys)), jax.random.key_impl(keys)
    return [jax.random.wrap_key_data(jax.device_put(row), impl=kind) for row in data]


def generator(key: jax.Array) -> np.random.Generator:
    """Return NumPy's source of chance made from a key."""
    return np.random.default_rng(np.asarray(jax.random.key_data(key)).tolist())


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
