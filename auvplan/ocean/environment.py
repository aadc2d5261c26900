"""The world that a planner is given: current, chart, obstacles, box, sea bed, and what places cost."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.chart import Chart
from auvplan.ocean.closures import Closure
from auvplan.ocean.currents import Current, as_current
from auvplan.ocean.functions import PlainFunction, as_pytree, register_function
from auvplan.ocean.obstacles import Obstacles
from auvplan.ocean.raster import is_traced
from auvplan.ocean.seabed import Seabed
from auvplan.runtime.arguments import instance, numbers
from auvplan.runtime.captured import Captured
from auvplan.runtime.pytree import register_without_init


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
        found = Captured(self.function)(x, y, z, t)
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


@register_without_init
@dataclass(frozen=True, eq=False)
class Environment:
    """The world as a planner believes it.

    Attributes:
        current: any `Current`, or a plain function ``(x, y, z, t) -> (u, v, w)``, or None for still water.
        chart: coast and uncertain areas, or None for open water.
        obstacles: M obstacles, or None.
        lower: [3] m, north, east, depth; the box that every path stays in. Without one it is the waters below
            the surface, as far as chart and sea bed reach where they are given.
        upper: [3] m. Equal depths make the problem planar.
        seabed: depth and the clearance to be kept above it, or None where it is out of reach.
        closures: areas that are closed at some hours.
        price: any `Price`, or a plain function ``(x, y, z, t) -> s/s``, not negative: what a second at a
            place adds to the cost of a path (Eq. 12), beside the second itself; or None.

    Raises:
        TypeError: `current` or `price` is not callable as one, or is a function that JAX cannot trace; or
            another field is of another kind.
        ValueError: a function does not return what it should; the box is not two corners, the
            lower one first, or reaches beyond the sea bed; JAX traces the box, or where chart or sea bed lie.
    """

    current: Current
    chart: Chart | None = None
    obstacles: Obstacles = None  # type: ignore[assignment]
    lower: jax.Array = (-np.inf, -np.inf, 0.0)  # type: ignore[assignment]
    upper: jax.Array = (np.inf, np.inf, np.inf)  # type: ignore[assignment]
    seabed: Seabed | None = None
    closures: tuple[Closure, ...] = ()
    price: Price | None = None

    def __post_init__(self) -> None:
        # One that is made from another, perhaps while JAX traces, is complete.
        if isinstance(self.lower, jax.Array) and self.obstacles is not None:
            return
        kinds = {
            "chart": (Chart, "from_mask"),
            "obstacles": (Obstacles, "static"),
            "seabed": (Seabed, "from_depth"),
        }
        for name, (kind, make) in kinds.items():
            if (part := getattr(self, name)) is not None:
                instance(name, part, kind, f"ap.{kind.__name__}.{make}(...)")
        if not isinstance(self.closures, tuple) or not all(isinstance(one, Closure) for one in self.closures):
            raise TypeError(f"closures must be a tuple of Closure, got {self.closures!r:.80}")
        rasters = [raster for raster in (self.chart, self.seabed) if raster is not None]
        if is_traced(self.lower, self.upper, [(raster.origin, raster.pixel_size) for raster in rasters]):
            raise ValueError(
                "no environment is built from a chart, sea bed or box that JAX traces: build one before, and "
                "put the traced part into it by dataclasses.replace(env, chart=...)"
            )
        given = (("lower", self.lower), ("upper", self.upper))
        corners = lower, upper = [np.array(numbers(f"environment {name}", value)) for name, value in given]
        if any(corner.shape != (3,) for corner in corners) or not (lower <= upper).all():
            raise ValueError("environment lower and upper must be (x, y, z) with lower <= upper")
        for corner, known, innermost in (
            (lower, [raster.lower for raster in rasters], np.max),
            (upper, [raster.upper for raster in rasters], np.min),
        ):
            if known:
                reach = innermost(np.asarray(known, float), axis=0)
                corner[:2] = np.where(np.isinf(corner[:2]), reach, corner[:2])
        object.__setattr__(self, "current", as_current(self.current))
        object.__setattr__(self, "price", as_price(self.price))
        object.__setattr__(self, "obstacles", Obstacles.none() if self.obstacles is None else self.obstacles)
        object.__setattr__(self, "lower", jnp.asarray(corners[0], float))
        object.__setattr__(self, "upper", jnp.asarray(corners[1], float))
        if (bed := self.seabed) is not None:
            beyond = np.max([np.asarray(bed.lower) - lower[:2], upper[:2] - np.asarray(bed.upper)])
            if beyond > float(bed.pixel_size):
                raise ValueError(f"the environment's box reaches {beyond:.0f} m beyond the sea bed's raster")
