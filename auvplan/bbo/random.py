"""Cheap random numbers for the search: a hash of a counter, seeded by a JAX key.

JAX's own generator spends most of an iteration of a small search on a CPU. A search needs numbers without
visible pattern, not unpredictable ones: two rounds of a 32-bit integer hash are enough and ten times cheaper.
"""

import math

import jax
import jax.numpy as jnp


def _mixed(word: jax.Array) -> jax.Array:
    """Return a 32-bit hash of little bias: Wellons (2018), Prospecting for hash functions, as revised."""
    word = (word ^ (word >> 16)) * jnp.uint32(0x21F0AAAD)
    word = (word ^ (word >> 15)) * jnp.uint32(0x735A2D97)
    return word ^ (word >> 15)


def uniform(key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
    """Uniform numbers in (0, 1), in steps of 2^-24, float32; equal keys give equal ones."""
    words = jax.random.key_data(key)
    count = jnp.arange(math.prod(shape), dtype=jnp.uint32).reshape(shape)
    bits = _mixed(_mixed(count + words[..., 0]) + words[..., -1])
    return ((bits >> 8).astype(jnp.float32) + 0.5) * jnp.float32(2.0**-24)


def normal(key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
    """Standard normal numbers, float32, by inversion; see `uniform`."""
    return jnp.sqrt(jnp.float32(2.0)) * jax.lax.erf_inv(2.0 * uniform(key, shape) - 1.0)
