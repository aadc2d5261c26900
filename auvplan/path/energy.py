"""Paths of least energy, and the speed through the water at which they take it."""

from dataclasses import replace
from functools import partial, reduce

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.energy.power import PowerModel
from auvplan.energy.speeds import speed_range
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path.config import PathConfig
from auvplan.path.cost import VIOLATIONS, Track, evaluate
from auvplan.path.ends import as_point, check_given, check_moment
from auvplan.path.kinematics import vertical_speeds
from auvplan.path.plan import PathPlan
from auvplan.path.planner import plan_path, sketch_paths
from auvplan.path.profile import timed
from auvplan.path.replanner import replan_path
from auvplan.runtime.arguments import numbers
from auvplan.runtime.compiled import compiled
from auvplan.runtime.prng import as_key
from auvplan.vehicle import Vehicle, along_track

Array = NDArray[np.floating]

#: Speeds compared in a round; the next lies between the best one's neighbours. Segments have 4 times as many.
_SPEEDS = 24

#: Times its energy that a speed costs for each unit of mean excess over a limit; limits that count.
_PENALTY_WEIGHT, _LIMITS = 1e3, [VIOLATIONS.index(name) for name in ("surge", "current")]

#: Share of its energy that another speed must spare along a path for which it is planned once more.
_WORTH = 1e-3


def plan_least_energy(
    start: ArrayLike,
    goal: ArrayLike,
    env: Environment,
    vehicle: Vehicle,
    *,
    key: jax.Array,
    config: PathConfig | None = None,
    depart: float = 0.0,
    price: float = 0.0,
    speeds: tuple[float, float] | None = None,
) -> PathPlan:
    """Plan the safe path of least energy, or of least energy and time, and its speed through the water.

    The speed is best along sketches of the path; the path is the quickest at that speed where changes in
    depth pay tolls (`Vehicle.with_tolls`). Where another speed is better along it, it is planned once more.
    Energy of turns and tasks plays no part.

    Args:
        start, goal, env, key, config, depart: as for `plan_path`.
        vehicle: limits and power model; its speed plays no part.
        price: W, what a second is worth; zero where energy alone counts.
        speeds: least and greatest speed, m/s; defaults to `energy.speed_range`.

    Returns:
        The plan, at the speed `plan.conditions.vehicle.speed`; see `energy.energy_of_plan` for what it takes.

    Raises:
        ValueError: as `plan_path`; the vehicle has no power model, speeds are not positive and rising, or the
            price is negative.
        TypeError: as `plan_path`.

    Example:
        >>> import jax, auvplan as ap
        >>> from auvplan.energy import PowerLaw, PowerModel
        >>> from auvplan.path import plan_least_energy
        >>> env = ap.Environment(ap.UniformCurrent(0.0, 0.0), lower=(-500, -500, 0), upper=(2500, 500, 0))
        >>> vehicle = ap.Vehicle(power=PowerModel(PowerLaw(0.0, 20.0), hotel=40.0))
        >>> plan = plan_least_energy((0, 0, 0), (2000, 0, 0), env, vehicle, key=jax.random.key(0))
        >>> round(float(plan.conditions.vehicle.speed), 2)
        1.0
    """
    check_given(env, vehicle, config)
    check_moment("depart", depart)
    if (power := vehicle.power) is None:
        raise ValueError("paths of least energy need a power model: give Vehicle(power=...)")
    least, most = speeds or speed_range(power)
    if not 0.0 < least < most < np.inf:
        raise ValueError(f"speeds must be positive and rising, got {least} and {most}")
    if not numbers("price", price) >= 0.0:
        raise ValueError(f"price must not be negative, W, got {price}")
    start, goal, config = as_point("start", start), as_point("goal", goal), config or PathConfig()
    first_key, second_key = jax.random.split(as_key(key))
    bare = replace(env, chart=None, obstacles=Obstacles.none(), seabed=None, closures=(), price=None)
    timing = partial(_times, env=bare, vehicle=replace(vehicle, power=None, depth_toll=None))
    timing = partial(timing, depart=jnp.asarray(depart, float), config=timed(config, env.current).only())

    def at(speed: float) -> Vehicle:
        return replace(vehicle, speed=speed).with_tolls(power, price)

    def best(positions: Array, low: float = least, high: float = most) -> tuple[float, float]:
        """Return the least energy and price along positions [R, 3] m, J, and the speed that it takes, m/s."""
        # At the usual samples, whatever they were polished with.
        x, y, z = np.asarray(positions, float)[:: (len(positions) - 1) // (config.samples - 1)].T
        dived, track = (
            power.in_depth(np.diff(z)).sum(),
            Track.through(*(jnp.asarray(axis[:, None], float) for axis in (x, y, z))),
        )
        while True:
            speeds = np.linspace(low, high, _SPEEDS)
            times = np.asarray(timing(track, speeds=jnp.asarray(speeds, float)), float)
            spent = np.asarray(power.power(speeds) + price) * times
            k = int(np.argmin(spent))
            low, high = speeds[max(k - 1, 0)], speeds[min(k + 1, _SPEEDS - 1)]
            if high - low < 1e-3 * speeds[k]:
                return float(spent[k] + dived), float(speeds[k])

    def spent(plan: PathPlan) -> float:
        speed = float(np.asarray(plan.conditions.vehicle.speed))
        return best(plan.positions, speed, speed)[0]

    ends = np.asarray(start, float)[None], np.asarray(goal, float)[None]
    line = ends[0] + np.linspace(0.0, 1.0, config.samples)[:, None] * (ends[1] - ends[0])
    first = at(best(line)[1]).without_power()
    speed = min(map(best, sketch_paths(*ends, np.full(1, depart), env, first, config)[0]))[1]
    plan = plan_path(start, goal, env, at(speed), key=first_key, config=config, depart=depart)
    possible, speed = best(plan.positions)
    if possible > (1.0 - _WORTH) * spent(plan):
        return plan
    again = replan_path(plan, start, depart, env, at(speed), key=second_key, config=config)
    return min(plan, again, key=lambda plan: (not plan.feasible, spent(plan)))


def speeds_along(
    plan: PathPlan, power: PowerModel, price: float = 0.0, limits: tuple[float, float] | None = None
) -> tuple[Array, Array]:
    """Return the speeds of least energy along a plan's path, one for each segment, and the times that result.

    Limits on speed over ground, on progress against the current and in the vertical are kept; where no speed
    keeps them the plan's own stays. In a current that changes with time the water is that which the plan met.

    Args:
        plan: whose path and water count.
        power, price, limits: as for `plan_least_energy`, its `speeds` last.

    Returns:
        Speeds through the water [S - 1], m/s, and times [S], s since the epoch.
    """
    vehicle, reading = plan.conditions.vehicle, plan.conditions.config.speed_reading
    choices = np.geomspace(*(limits or speed_range(power)), 4 * _SPEEDS)
    speeds = np.append(choices, float(np.asarray(vehicle.speed)))[:, None]  # the plan's own comes last
    way, water = np.diff(np.asarray(plan.positions, float), axis=0).T, np.asarray(plan.water, float).T
    gap = np.maximum(np.linalg.norm(way, axis=0), 1e-9)
    along = (way * water).sum(axis=0) / gap
    across = np.sqrt(np.maximum((water**2).sum(axis=0) - along**2, 0.0))
    ground, shortfall = along_track(reading, speeds, along, across)
    kept = (shortfall <= 0.0) & (ground <= vehicle.surge_max)
    at = replace(vehicle, speed=speeds)
    for vertical, limit in vertical_speeds(tuple(water), tuple(way), gap, ground, at, reading).values():  # type: ignore[arg-type]
        kept &= np.asarray(vertical <= limit)
    kept[-1] |= ~kept.any(axis=0)
    takes = np.where(kept, (np.asarray(power.power(speeds)) + price) * gap / ground, np.inf)
    best = np.argmin(takes, axis=0)
    seconds = gap / np.take_along_axis(ground, best[None], axis=0)[0]
    return speeds[best, 0], float(plan.times[0]) + np.concatenate([[0.0], np.cumsum(seconds)])


@partial(compiled, static_argnames=("config",))
def _times(
    track: Track, depart: jax.Array, env: Environment, vehicle: Vehicle, speeds: jax.Array, config: PathConfig
) -> jax.Array:
    """Times along a track at V speeds, longer where one is too slow or too fast, [V] s."""

    def one(speed: jax.Array) -> jax.Array:
        trajectory = evaluate(track, depart, env, replace(vehicle, speed=speed), config)
        broken = reduce(jnp.add, [trajectory.excess[k].mean() for k in _LIMITS])
        return trajectory.travel_time[0] * (1.0 + _PENALTY_WEIGHT * broken)

    return jax.lax.map(one, speeds)
