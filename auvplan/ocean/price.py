"""What a second at a place costs beside its time."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp

from auvplan.ocean.functions import PlainFunction, as_pytree, register_function


@runtime_checkable
class Price(Protocol):
    """Seconds charged for a second at position [m] and time [s], for any reason but the time itself.

    Say, noise of a shipping lane, or distance to the nearest acoustic modem.
    """

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> jax.Array:
        """Return the price [s/s] at places [m] and times [s], elementwise, not negative."""
        ...


@register_function
@dataclass(frozen=True)
class FunctionPrice(PlainFunction):
    """A plain Python function as a price."""

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> jax.Array:
        """Return the price [s/s] at places [m] and times [s], elementwise."""
        shape = jnp.broadcast_shapes(jnp.shape(x), jnp.shape(y), jnp.shape(z), jnp.shape(t))
        found = self.function(x, y, z, t)
        if isinstance(found, tuple | list):
            raise ValueError(f"a price returns one number for each place; the function returned {len(found)}")
        return jnp.broadcast_to(jnp.asarray(found, jnp.result_type(x)), shape)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ScaledPrice:
    """A price whose lengths and times are `factor` times as great."""

    price: Price
    factor: jax.Array

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> jax.Array:
        """Return the price [s/s] at places [m] and times [s], elementwise."""
        return self.price(*(axis / self.factor for axis in (x, y, z, t)))


def as_price(price: object) -> Price | None:
    """Accept a price, a plain function of the same signature, or None for none.

    Raises:
        TypeError: `price` cannot be called as one, or is a function that JAX cannot trace.
        ValueError: the function does not return one number for each place.
    """
    return as_pytree(price, FunctionPrice, "price", "s/s")
