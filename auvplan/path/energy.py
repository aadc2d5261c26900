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
from auvplan.energy.use import energy_of_steps
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path.config import PathConfig
from auvplan.path.cost import VIOLATIONS, Track, evaluate
from auvplan.path.ends import as_point, check_given
from auvplan.path.kinematics import vertical_speeds
from auvplan.path.plan import PathPlan
from auvplan.path.planner import plan_path, sketch_paths
from auvplan.path.profile import timed
from auvplan.path.replanner import replan_path
from auvplan.runtime.compiled import compiled
from auvplan.runtime.prng import as_key
from auvplan.vehicle import Vehicle, along_track

Array = NDArray[np.floating]

#: Speeds that are compared in each round, the next of which lies between the neighbours of the best.
_SPEEDS = 24

#: A speed that breaks a limit costs so many times its energy for each unit of mean excess; limits that count.
_PENALTY_WEIGHT, _LIMITS = 1e3, [VIOLATIONS.index(name) for name in ("surge", "current")]

#: Share of its energy that another speed must spare along a path for which it is planned once more.
_WORTH = 1e-3

#: Speeds that segments choose from.
_CHOICES = 96


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
        ValueError: as `plan_path`; the vehicle has no power model, or speeds are not positive and rising.
        TypeError: as `plan_path`.

    Example:
        >>> import jax, auvplan as ap
        >>> from auvplan.energy import PowerLaw, PowerModel, energy_of_plan
        >>> from auvplan.path import plan_least_energy
        >>> env = ap.Environment(ap.UniformCurrent(0.0, 0.0), lower=(-500, -500, 0), upper=(2500, 500, 0))
        >>> power = PowerModel(PowerLaw(0.0, 20.0), hotel=40.0)
        >>> vehicle = ap.Vehicle(power=power)
        >>> plan = plan_least_energy((0, 0, 0), (2000, 0, 0), env, vehicle, key=jax.random.key(0))
        >>> round(float(plan.conditions.vehicle.speed), 2)
        1.0
        >>> round(energy_of_plan(plan, power), 1)  # Wh, of 60 W for 2000 s
        33.3
    """
    check_given(env, vehicle)
    if (power := vehicle.power) is None:
        raise ValueError("paths of least energy need a power model: give Vehicle(power=...)")
    least, most = limits = speeds or speed_range(power)
    if not 0.0 < least < most < np.inf:
        raise ValueError(f"speeds must be positive and rising, got {least} and {most}")
    start, goal, config = as_point("start", start), as_point("goal", goal), config or PathConfig()
    first_key, second_key = jax.random.split(as_key(key))
    given = {"env": env, "vehicle": vehicle, "config": config, "depart": depart, "price": price}
    along = partial(_best_along, **given)

    def at(speed: float) -> Vehicle:
        return replace(vehicle, speed=speed).with_tolls(power, price)

    ends = np.asarray(start, float)[None], np.asarray(goal, float)[None]
    line = ends[0] + np.linspace(0.0, 1.0, config.samples)[:, None] * (ends[1] - ends[0])
    first = at(along(line, limits)[1]).without_power()
    sketches = sketch_paths(*ends, np.full(1, depart), env, first, config)[0]
    speed = min(along(path, limits) for path in sketches)[1]
    plan = plan_path(start, goal, env, at(speed), key=first_key, config=config, depart=depart)
    # At the usual samples, whatever it was polished with.
    track = np.asarray(plan.positions)[:: (len(plan.positions) - 1) // (config.samples - 1)]
    (best, better), (spent, _) = along(track, limits), along(track, (speed, speed))
    if best > (1.0 - _WORTH) * spent:
        return plan
    again = replan_path(plan, start, depart, env, at(better), key=second_key, config=config)

    def rank(plan: PathPlan) -> tuple[bool, float]:
        own = float(np.asarray(plan.conditions.vehicle.speed))
        drawn = float((power.power(own) + price) * plan.travel_time)
        return not plan.feasible, drawn + _dived(plan.positions, power)

    return min(plan, again, key=rank)


def speeds_along(
    plan: PathPlan, power: PowerModel, price: float = 0.0, limits: tuple[float, float] | None = None
) -> tuple[Array, Array]:
    """Return the speeds of least energy along a plan's path, one for each segment, and the times that result.

    Limits on speed over ground, on progress against the current and in the vertical are kept; where no speed
    keeps them the plan's own stays. In a current that changes with time the water is that which the plan met.

    Args:
        plan: whose path and water count.
        power: of the vehicle.
        price: W, what a second is worth.
        limits: least and greatest speed, m/s; defaults to `energy.speed_range`.

    Returns:
        Speeds through the water [S - 1], m/s, and times [S], s since the epoch.
    """
    vehicle, reading = plan.conditions.vehicle, plan.conditions.config.speed_reading
    own = float(np.asarray(vehicle.speed))
    speeds = np.append(np.geomspace(*(limits or speed_range(power)), _CHOICES), own)
    way, water = np.diff(np.asarray(plan.positions, float), axis=0).T, np.asarray(plan.water, float).T
    gap = np.maximum(np.linalg.norm(way, axis=0), 1e-9)
    along = (way * water).sum(axis=0) / gap
    across = np.sqrt(np.maximum((water**2).sum(axis=0) - along**2, 0.0))
    takes, lasts = (np.empty((len(speeds), len(gap))) for _ in range(2))
    for k, speed in enumerate(speeds):
        ground, shortfall = along_track(reading, speed, along, across)
        at = replace(vehicle, speed=speed)
        steep = vertical_speeds(tuple(water), tuple(way), gap, ground, at, reading)  # type: ignore[arg-type]
        kept = (shortfall <= 0.0) & (ground <= vehicle.surge_max)
        for vertical, limit in steep.values():
            kept &= np.asarray(vertical) <= float(limit)
        lasts[k] = gap / ground
        takes[k] = np.where(kept | (k == _CHOICES), (float(power.power(speed)) + price) * lasts[k], np.inf)
    best = np.argmin(takes, axis=0)
    seconds = np.take_along_axis(lasts, best[None], axis=0)[0]
    return speeds[best], float(plan.times[0]) + np.concatenate([[0.0], np.cumsum(seconds)])


def _dived(positions: Array, power: PowerModel) -> float:
    """Energy of the changes in depth along positions [S, 3] m, J."""
    spent = energy_of_steps(power, 0.0, 0.0, np.diff(np.asarray(positions, float)[:, 2]), 0.0)
    return float((spent["dive"] + spent["climb"]).sum())


def _best_along(
    positions: Array,
    limits: tuple[float, float],
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
    depart: float,
    price: float,
) -> tuple[float, float]:
    """Return the least energy and price along positions [S, 3] m, J, and the speed that it takes, m/s."""
    power, (low, high) = vehicle.power, limits
    assert power is not None
    env = replace(env, chart=None, obstacles=Obstacles.none(), seabed=None, closures=(), price=None)
    config, vehicle = timed(config, env.current).only(), replace(vehicle, power=None, depth_toll=None)
    track = Track.through(*(jnp.asarray(positions[:, axis, None], float) for axis in range(3)))
    while True:
        speeds = np.linspace(low, high, _SPEEDS)
        times = _times(
            track, jnp.asarray(depart, float), env, vehicle, jnp.asarray(speeds, float), config=config
        )
        spent = np.asarray(power.power(speeds) + price) * np.asarray(times, float)
        k = int(np.argmin(spent))
        low, high = speeds[max(k - 1, 0)], speeds[min(k + 1, _SPEEDS - 1)]
        if high - low < 1e-3 * speeds[k]:
            return float(spent[k]) + _dived(positions, power), float(speeds[k])


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
