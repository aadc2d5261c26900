"""One leg as the kernels of the search see it, and its scaling to unit size.

Lengths and times are scaled alike, so that speeds do not change. A search that sees every leg as long as
every other one cannot depend on the unit of length: its margins, scales and roundings mean the same in a tank
as in a strait.
"""

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp

from auvplan.ocean.currents import Current, Velocity, is_quasi_steady, is_steady
from auvplan.ocean.environment import Environment, ScaledPrice
from auvplan.path.config import PathConfig
from auvplan.path.kinematics import TINY
from auvplan.vehicle import Vehicle

#: m, straight from start to goal of every leg as the search sees it.
WAY = 4000.0


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Problem:
    """What paths are searched for and judged by.

    Attributes:
        start, goal: [3] m, north, east, depth.
        depart: s since the epoch.
        env: the world, obstacles resolved.
        vehicle: speed and limits.
    """

    start: Any
    goal: Any
    depart: Any
    env: Environment
    vehicle: Vehicle

    @property
    def ends(self) -> tuple[Any, Any]:
        """Start and goal."""
        return self.start, self.goal

    @property
    def straight_time(self) -> jax.Array:
        """Time, s, straight from start to goal in still water."""
        return jnp.sqrt(((self.goal - self.start) ** 2).sum() + TINY) / self.vehicle.speed


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ScaledCurrent:
    """A current whose lengths and times are `factor` times as great; its velocities stay."""

    current: Current
    factor: jax.Array

    @property
    def steady(self) -> bool:
        """Whether the current does not change in time."""
        return is_steady(self.current)

    @property
    def gradual(self) -> bool:
        """Whether the current is quasi-steady."""
        return is_quasi_steady(self.current)

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        return self.current(*(axis / self.factor for axis in (x, y, z, t)))


def scaled(problem: Problem, config: PathConfig) -> tuple[Problem, PathConfig, jax.Array]:
    """Return a leg that is `WAY` long, its settings, and the factor of all lengths and times.

    Args:
        problem: the leg.
        config: settings; those returned hold traced margins and serve within one traced function only.
    """
    env, vehicle, factor = problem.env, problem.vehicle, factor_of(problem.start, problem.goal)
    chart, bed = env.chart, env.seabed
    if chart is not None:
        chart = _multiplied(chart, factor, "signed_distance", "origin", "pixel_size")
    if bed is not None:
        bed = _multiplied(bed, factor, "depth", "shallow", "reach", "origin", "pixel_size", "clearance")
    lengths = "position", "radius", "position_std", "radius_std", "growth_max"
    obstacles = _multiplied(env.obstacles, factor, *lengths, "observed_at")
    current = ScaledCurrent(env.current, factor)
    closures = tuple(
        _multiplied(
            replace(one, chart=_multiplied(one.chart, factor, "signed_distance", "origin", "pixel_size")),
            factor,
            "begins",
            "ends",
        )
        for one in env.closures
    )
    price = None if env.price is None else ScaledPrice(env.price, factor)
    box = env.lower * factor, env.upper * factor
    world = Environment(current, chart, obstacles, *box, bed, closures, price)
    depths = {name: getattr(vehicle, name) for name in ("transit_depth", "transit_altitude")}
    depths = {name: depth * factor for name, depth in depths.items() if depth is not None}
    known = None if vehicle.navigation is None else vehicle.navigation.scaled(factor)
    slower = replace(vehicle, turn_rate_max=vehicle.turn_rate_max / factor, navigation=known, **depths)
    margins = {name: getattr(config, name) * factor for name in ("coast_margin", "obstacle_margin")}
    leg = Problem(problem.start * factor, problem.goal * factor, problem.depart * factor, world, slower)
    return leg, config.replace(**margins), factor


def _multiplied(of: object, factor: jax.Array, *names: str):
    """Return a dataclass with some of its arrays multiplied."""
    changes = {name: getattr(of, name) * factor.astype(getattr(of, name).dtype) for name in names}
    return replace(of, **changes)  # type: ignore[type-var]


def factor_of(start: jax.Array, goal: jax.Array) -> jax.Array:
    """Return what makes the straight line between two points [3] m `WAY` long."""
    return WAY / jnp.sqrt(((goal - start) ** 2).sum())
