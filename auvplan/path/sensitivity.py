"""Sensitivities of a planned travel time to departure, speed and current."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.compiled import compiled
from auvplan.ocean.currents import Current, Velocity, combine, is_steady, partition
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path.config import PathConfig
from auvplan.path.cost import Track, evaluate
from auvplan.vehicle import Vehicle


@dataclass(frozen=True)
class Conditions:
    """What a path was planned for: the world, one leg's of a batch or that of all, vehicle and settings."""

    env: Environment
    vehicle: Vehicle
    config: PathConfig
    leg: int | None = None

    def world(self) -> Environment:
        """Return the leg's own world."""
        if self.leg is None:
            return self.env
        shared, current = partition(self.env.current)
        own = jax.tree.map(lambda leaf: leaf[self.leg], (current, self.env.obstacles))
        return replace(self.env, current=combine(shared, own[0]), obstacles=own[1])


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of the travel time, times[-1] - times[0], along a path that stays as it is.

    Around the fastest path they are those of the fastest travel time as well, as long as no limit of the path
    binds: a small change of the path changes its time by nothing then. The time of arrival, times[-1], moves
    by one second more for each second of later departure, as do all of times[1:]: times[0] is the departure.

    Arrival times are followed segment by segment in every current, gradual ones included, and nothing on that
    way stops a derivative. Two kinds of kinks remain. Where the current beats the vehicle, progress stays at
    `SPEED_FLOOR` of its speed and no longer answers to the current. Between the nodes of a gridded current
    slopes in time and place are those of its interpolation, constant within a cell along each axis.

    Attributes:
        departure: s per s of later departure; 0 in a steady current.
        speed: s per m/s of speed through the water; negative.
        current: s per unit of relative strength of the current: a hundredth of it for one per cent more.
    """

    departure: float
    speed: float
    current: float


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Scaled:
    """A current made `factor` times as strong."""

    current: Current
    factor: jax.Array

    @property
    def steady(self) -> bool:
        return is_steady(self.current)

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        u, v, w = self.current(x, y, z, t)
        return u * self.factor, v * self.factor, w * self.factor


def sensitivity(positions: np.ndarray, depart: float, conditions: Conditions) -> Sensitivity:
    """Derivatives along a path through positions [S, 3] m that departs at a time, s since the epoch."""
    slopes = _slopes(
        jnp.asarray(positions, float),
        jnp.asarray(depart, float),
        conditions.world(),
        conditions.vehicle,
        config=conditions.config,
    )
    return Sensitivity(*(float(slope) for slope in slopes))


@partial(compiled, static_argnames=("config",))
def _slopes(
    positions: jax.Array, depart: jax.Array, env: Environment, vehicle: Vehicle, config: PathConfig
) -> tuple[jax.Array, ...]:
    x, y, z = (positions[:, axis, None] for axis in range(3))
    track = Track.through(x, y, z)
    bare = replace(env, chart=None, obstacles=Obstacles.none(), seabed=None, closures=())

    def travel_time(depart: jax.Array, speed: jax.Array, factor: jax.Array) -> jax.Array:
        world = replace(bare, current=_Scaled(env.current, factor))
        return evaluate(track, depart, world, replace(vehicle, speed=speed), config).travel_time[0]

    slopes: Callable[..., tuple[jax.Array, ...]] = jax.grad(travel_time, argnums=(0, 1, 2))
    return slopes(depart, jnp.asarray(vehicle.speed, positions.dtype), jnp.ones((), positions.dtype))
