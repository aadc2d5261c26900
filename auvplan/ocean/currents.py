"""Ocean currents as pure functions of position and time.

A current is any pytree callable ``current(x, y, z, t) -> (u, v, w)``: arrays broadcast elementwise, metres
and seconds in, m/s north, east and down out. An attribute ``steady`` that is True says that t does not
matter, one ``gradual`` that it matters little within minutes: both spare planners the timing of segments one
after the other. ``barotropic`` says that z does not matter, which spares them the search in depth.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache, partial, reduce
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.interpreters import partial_eval
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.ocean.deviation import deviation
from auvplan.ocean.functions import PlainFunction, as_pytree, register_function
from auvplan.runtime.arguments import numbers
from auvplan.runtime.captured import Captured
from auvplan.runtime.compiled import compiled
from auvplan.runtime.rows import elementwise

Velocity = tuple[jax.Array, jax.Array, jax.Array]

#: Places that one call of `evaluated` takes.
_POINTS = 4096


@runtime_checkable
class Current(Protocol):
    """Velocity of the water, m/s north, east, down, at position [m] and time [s]."""

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        ...


@register_function
@dataclass(frozen=True)
class FunctionCurrent(PlainFunction):
    """A plain Python function as a current."""

    @property
    def steady(self) -> bool:
        """Whether its values do not depend on time."""
        return not axes_used(self, vertical=True)[3]

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        shape = jnp.broadcast_shapes(jnp.shape(x), jnp.shape(y), jnp.shape(z), jnp.shape(t))
        dtype, found = jnp.result_type(x), Captured(self.function)(x, y, z, t)
        try:
            u, v, w = found
        except (TypeError, ValueError):
            got = f"{len(found)} values" if hasattr(found, "__len__") else type(found).__name__
            raise ValueError(
                f"a current returns (u, v, w), m/s north, east and down; the function returned {got}"
            ) from None
        u, v, w = (jnp.broadcast_to(jnp.asarray(component, dtype), shape) for component in (u, v, w))
        return u, v, w


def evaluated(
    current: Current, x: ArrayLike, y: ArrayLike, z: ArrayLike, t: ArrayLike
) -> tuple[NDArray[np.float64], ...]:
    """Return a current at places and times, in one compiled program.

    For use on the host, where arrays are large.
    """
    found = elementwise(partial(_evaluated, current), x, y, z, t, together=_POINTS)
    return tuple(np.asarray(component, float) for component in found)


@compiled
def _evaluated(current: Current, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
    return current(x, y, z, t)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class UniformCurrent:
    """The same velocity everywhere and always, m/s north, east, down.

    Raises:
        TypeError: components are not numbers, one by one.
    """

    u: ArrayLike = 0.0
    v: ArrayLike = 0.0
    w: ArrayLike = 0.0
    steady = True

    def __post_init__(self) -> None:
        if any(isinstance(part, list | tuple) for part in (self.u, self.v, self.w)):
            raise TypeError("u, v and w are given one by one, as in UniformCurrent(0.3, -0.1)")
        for name, part in (("u", self.u), ("v", self.v), ("w", self.w)):
            if isinstance(part, str | timedelta | np.generic):
                numbers(name, part)

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        zero = jnp.zeros(jnp.broadcast_shapes(jnp.shape(x), jnp.shape(y), jnp.shape(z)), jnp.result_type(x))
        return zero + self.u, zero + self.v, zero + self.w

    def deviation(self, places: Sequence[Any], edges: Sequence[Any]) -> NDArray[np.floating]:
        """Return zeros, see `auvplan.ocean.deviation`."""
        return np.zeros(np.shape(places[0]))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SumCurrent:
    """A current that all vehicles share, and one of each vehicle's own that is added to it.

    Where worlds are batched, the leaves of `own` alone carry a leading axis.

    Attributes:
        shared: say, a forecast.
        own: say, its error; or None.
    """

    shared: Current
    own: Current | None = None

    @property
    def steady(self) -> bool:
        """Whether no part changes in time."""
        return all(is_steady(part) for part in self.parts)

    @property
    def gradual(self) -> bool:
        """Whether every part is steady or quasi-steady."""
        return all(is_steady(part) or is_quasi_steady(part) for part in self.parts)

    @property
    def parts(self) -> tuple[Current, ...]:
        """One or both."""
        return (self.shared,) if self.own is None else (self.shared, self.own)

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        found = [part(x, y, z, t) for part in self.parts]
        u, v, w = (reduce(jnp.add, components) for components in zip(*found, strict=True))
        return u, v, w

    def deviation(self, places: Sequence[Any], edges: Sequence[Any]) -> NDArray[np.floating] | None:
        """Bound the departure from means within boxes, see `auvplan.ocean.deviation`."""
        found = [deviation(part, places, edges) for part in self.parts]
        known = [one for one in found if one is not None]
        return np.sum(known, axis=0) if len(known) == len(found) else None


def partition(current: Current) -> tuple[Current | None, Current | None]:
    """Return what vehicles share of a current, and what is each one's own, as batched worlds have it."""
    return (current.shared, current.own) if isinstance(current, SumCurrent) else (None, current)


def combine(shared: Current | None, own: Current | None) -> Current:
    """Return the current whose parts `partition` gave."""
    if shared is not None:
        return SumCurrent(shared, own)
    assert own is not None
    return own


def as_current(current: object) -> Current:
    """Accept a current, or a plain function of the same signature, or None for still water.

    Raises:
        TypeError: `current` cannot be called as one, or is a function that JAX cannot trace.
        ValueError: the function does not return three components.
    """
    if current is None:
        return UniformCurrent()
    return as_pytree(current, FunctionCurrent, "current", "(u, v, w)")


def is_steady(current: Current) -> bool:
    """Return whether the current is known not to depend on time."""
    return bool(getattr(current, "steady", False))


def varies_with_depth(current: Current) -> bool:
    """Return whether horizontal components of a current may depend on depth, by its program alone."""
    if isinstance(current, SumCurrent):
        return any(varies_with_depth(part) for part in current.parts)
    return not getattr(current, "barotropic", False) and axes_used(current)[2]


def varies_in_space(current: Current) -> bool:
    """Return whether horizontal components of a current may depend on the place, as `varies_with_depth`."""
    if isinstance(current, SumCurrent):
        return any(varies_in_space(part) for part in current.parts)
    return any(axes_used(current)[:2]) or varies_with_depth(current)


def axes_used(current: Current, vertical: bool = False) -> tuple[bool, ...]:
    """Return whether u or v of a current, or vertical w, is computed from x, from y, from z and from t."""
    leaves, tree = jax.tree.flatten(current)
    kinds = tuple(jax.ShapeDtypeStruct(jnp.shape(leaf), jnp.result_type(leaf)) for leaf in leaves)
    return _axes_used_by(tree, kinds, vertical)


@lru_cache(maxsize=256)
def _axes_used_by(tree: Any, kinds: tuple[jax.ShapeDtypeStruct, ...], vertical: bool) -> tuple[bool, ...]:
    """Return `axes_used` of a current with leaves of these kinds."""
    place = jax.ShapeDtypeStruct((), jnp.result_type(float))

    def found(leaves: Sequence[jax.Array], *where: jax.Array) -> Velocity:
        return tree.unflatten(leaves)(*where)

    program = jax.make_jaxpr(found)(list(kinds), place, place, place, place).jaxpr
    _, used = partial_eval.dce_jaxpr(program, [True, True, vertical])
    return tuple(used[len(kinds) :])


def is_quasi_steady(current: Current) -> bool:
    """Return whether the current changes in time, but little in the time that paths of one leg differ by."""
    return bool(getattr(current, "gradual", False)) and not is_steady(current)
