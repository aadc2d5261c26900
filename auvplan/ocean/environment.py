"""The world that a planner is given: current, chart, obstacles and the box to stay in."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.chart import Chart
from auvplan.ocean.currents import Current, as_current
from auvplan.ocean.obstacles import Obstacles
from auvplan.pytree import rebuilt_as_is


@rebuilt_as_is("current", "chart", "obstacles", "lower", "upper")
@dataclass(frozen=True)
class Environment:
    """What a planner believes of the sea.

    Attributes:
        current: any `Current`, or a plain function ``(x, y, z, t) -> (u, v, w)``, or None for still water.
        chart: coast and uncertain areas, or None for open water.
        obstacles: M obstacles, or None.
        lower: [3] m, north, east, depth; the box that every path stays in.
        upper: [3] m. Equal depths make the problem planar.

    Raises:
        TypeError: `current` is not callable.
        ValueError: the box is not two finite corners, the lower one first.
    """

    current: Current
    chart: Chart | None = None
    obstacles: Obstacles = None  # type: ignore[assignment]
    lower: jax.Array = (-np.inf, -np.inf, 0.0)  # type: ignore[assignment]
    upper: jax.Array = (np.inf, np.inf, 0.0)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if isinstance(self.lower, jax.Array):  # made from another one, perhaps while JAX traces: complete
            return
        corners = [np.asarray(corner, float) for corner in (self.lower, self.upper)]
        if (
            any(c.shape != (3,) or not np.isfinite(c).all() for c in corners)
            or (corners[0] > corners[1]).any()
        ):
            raise ValueError("environment lower and upper must be finite (x, y, z) with lower <= upper")
        object.__setattr__(self, "current", as_current(self.current))
        object.__setattr__(self, "obstacles", Obstacles.none() if self.obstacles is None else self.obstacles)
        object.__setattr__(self, "lower", jnp.asarray(corners[0], float))
        object.__setattr__(self, "upper", jnp.asarray(corners[1], float))
