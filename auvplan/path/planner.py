"""Two points to a timed, checked trajectory, for any number of legs by one compiled search (section 3.2)."""

from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from auvplan.bbo import Result, search
from auvplan.bbo.refine import descend
from auvplan.compiled import compiled
from auvplan.ocean.currents import Current, divided, is_gradual, united
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path import habitats
from auvplan.path.bspline import basis_matrix, fit_matrix
from auvplan.path.clearance import FAR
from auvplan.path.config import PathConfig
from auvplan.path.cost import VIOLATIONS, Flight, curves, fly, guide, score, violations
from auvplan.path.ends import check_ends
from auvplan.path.kinematics import PacedCurrent, norm
from auvplan.path.passages import trace_passages
from auvplan.path.plan import PathPlan, PathPlans
from auvplan.path.scaling import factor_of, scaled
from auvplan.path.sensitivity import Conditions
from auvplan.rows import over_rows
from auvplan.vehicle import Vehicle


def plan_path(
    start: ArrayLike,
    goal: ArrayLike,
    env: Environment,
    vehicle: Vehicle | None = None,
    *,
    key: jax.Array,
    config: PathConfig | None = None,
    depart: float = 0.0,
    population: ArrayLike | None = None,
) -> PathPlan:
    """Plan the fastest safe path from start to goal.

    Args:
        start: [3] m, north, east, depth.
        goal: [3] m.
        env: current, chart, obstacles, box and sea bed.
        vehicle: speed and limits; defaults to `Vehicle()`.
        key: PRNG key, consumed; the same key gives the same plan.
        config: settings; defaults to `PathConfig()`.
        depart: s since the epoch.
        population: [P, 3 n] m, habitats to start from, as in `PathPlan.population`.

    Returns:
        The best path found, feasible or not: see `PathPlan.feasible`, `.status` and `.reason`.

    Raises:
        ValueError: start or goal lies on land, below the sea bed, outside the chart or outside the box, the
            goal nearer to the sea bed than its clearance, or they coincide.

    Example:
        >>> import jax, auvplan as ap
        >>> stream = lambda x, y, z, t: (0.0, 0.5, 0.0)
        >>> env = ap.Environment(stream, lower=(-500, -500, 0), upper=(2500, 1500, 0))
        >>> plan = ap.plan_path((0, 0, 0), (2000, 0, 0), env, key=jax.random.key(0))
        >>> plan.feasible, round(plan.travel_time)
        (True, 816)
    """
    given = None if population is None else jnp.asarray(population)[None]
    return plan_paths(
        np.asarray(start, float)[None],
        np.asarray(goal, float)[None],
        env,
        vehicle,
        key=key,
        config=config,
        depart=depart,
        population=given,
    )[0]


def plan_paths(
    starts: ArrayLike,
    goals: ArrayLike,
    env: Environment,
    vehicle: Vehicle | None = None,
    *,
    key: jax.Array,
    config: PathConfig | None = None,
    depart: ArrayLike = 0.0,
    population: ArrayLike | None = None,
    world_per_leg: bool = False,
) -> PathPlans:
    """Plan B legs by one compiled program, as many at once as the device does best.

    Args:
        starts: [B, 3] m, north, east, depth.
        goals: [B, 3] m.
        env: the world of all legs; with `world_per_leg` its current and obstacles carry a leading axis B.
        vehicle: speed and limits; defaults to `Vehicle()`.
        key: one PRNG key, split over the legs, or B keys; leg b's plan depends on its own key alone.
        config: settings; defaults to `PathConfig()`.
        depart: s since the epoch, one or [B].
        population: [B, P, 3 n] m, habitats to start from.
        world_per_leg: whether current and obstacles differ by leg.

    Raises:
        ValueError: as `plan_path`, naming the leg; or shapes do not fit.
    """
    config = config or PathConfig()
    start, goal = np.asarray(starts, float), np.asarray(goals, float)
    if start.ndim != 2 or start.shape[1] != 3 or start.shape != goal.shape:
        raise ValueError(f"starts and goals must be [B, 3], got shapes {start.shape} and {goal.shape}")
    check_ends(start, goal, env)
    legs = start.shape[0]
    keys = jax.random.split(key, legs) if key.ndim == 0 else key
    if population is not None:
        shape = (legs, config.bbo.population, 3 * config.control_points)
        if np.shape(population) != shape:
            raise ValueError(
                f"population must be [B, P, 3 n], {shape} here, got shape {np.shape(population)}"
            )
    departs = np.broadcast_to(np.asarray(depart, float), (legs,))
    world, shared = split(env, world_per_leg)
    conditions = Conditions(env, vehicle or Vehicle(), config, 0 if world_per_leg else None)
    # What is planned again does not change the program of what is planned at first.
    program = partial(_plan, shared=shared, vehicle=conditions.vehicle, config=config.replace(finer=1))
    found = over_rows(program, keys, start, goal, departs, population, world)
    found = plan_finely(found, (keys, start, goal, departs), world, shared, conditions.vehicle, config)
    return PathPlans(**found, conditions=conditions)


#: Current (or None, where all of it is shared) and obstacles; None where the legs share both.
World = tuple[Current | None, Obstacles] | None


def split(env: Environment, world_per_leg: bool) -> tuple[World, Environment]:
    """What differs by leg, and what is the same for all."""
    if not world_per_leg:
        return None, env
    current, own = divided(env.current)
    return (own, env.obstacles), replace(env, current=current, obstacles=None)


def world_of(own: World, shared: Environment) -> Environment:
    """The world of one leg, obstacles resolved."""
    if own is None:
        current, obstacles = shared.current, shared.obstacles
    else:
        current, obstacles = united(shared.current, own[0]), own[1]
    resolved = obstacles.resolved(current)
    return Environment(current, shared.chart, resolved, shared.lower, shared.upper, shared.seabed)


#: Paths of a leg are taken to make at least this share of the speed through the water over ground.
_SLOWEST = 0.3


def plan_finely(
    found: dict[str, Any],
    legs: tuple[Any, ...],
    world: World,
    shared: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> dict[str, Any]:
    """Plan legs again with more control points and samples where the paths found leave something wanting.

    Winding ways have more bends than the usual control points can follow, and narrow ones are certified only
    between samples that lie close together.

    Args:
        found: fields of `PathPlans` by name, and `wanting`, which is taken out.
        legs: keys, starts [B, 3] m, goals [B, 3] m, departures [B] s.
        world, shared: as `split` gives them.
        vehicle: speed and limits.
        config: static settings, those of the paths found.

    Returns:
        The fields, with better paths where there are any; then all legs have `finer` times as many segments.
    """
    again = np.flatnonzero(found.pop("wanting"))
    times = config.finer
    if times == 1 or not len(again):
        return found
    segments = times * (config.samples - 1)
    fine = config.replace(control_points=times * config.control_points, samples=segments + 1, finer=1)
    chosen = jax.tree.map(lambda leaf: leaf[again], (*legs, None, world))
    better = over_rows(partial(_plan, shared=shared, vehicle=vehicle, config=fine), *chosen)
    broken = [plans["violations"].sum(axis=1) for plans in (better, found)]
    less = (broken[0] < broken[1][again]) | (
        (broken[0] == broken[1][again]) & (better["cost"] < found["cost"][again])
    )
    if not less.any():
        return found
    found = found | _divided(found, times)
    better = {name: value for name, value in better.items() if name != "wanting"}
    better |= _with_fewer_points(better, legs[1][again], legs[2][again], fine, config)

    def replaced(old: Any, new: Any) -> Any:
        old = np.array(old)
        old[again[less]] = np.asarray(new)[less]
        return old

    return jax.tree.map(replaced, found, better)


def _divided(found: dict[str, Any], parts: int) -> dict[str, Any]:
    """Positions, times, excess and water of paths whose segments are divided into so many parts."""
    share = np.arange(parts * (found["times"].shape[1] - 1) + 1) / parts
    first = np.minimum(share.astype(int), found["times"].shape[1] - 2)
    share = (share - first).astype(found["times"].dtype)
    positions, times = found["positions"], found["times"]
    return {
        "positions": positions[:, first] + share[:, None] * (positions[:, first + 1] - positions[:, first]),
        "times": times[:, first] + share * (times[:, first + 1] - times[:, first]),
        "excess": np.repeat(found["excess"], parts, axis=2),
        "water": np.repeat(found["water"], parts, axis=1),
    }


def _with_fewer_points(
    found: dict[str, Any], starts: np.ndarray, goals: np.ndarray, fine: PathConfig, config: PathConfig
) -> dict[str, Any]:
    """Population and control points of paths, fitted by as many points as the settings have."""
    basis = basis_matrix(config.samples, fine.control_points + 2, config.degree)
    fit = fit_matrix(config.samples, config.control_points + 2, config.degree)
    # What takes inner control points, start and goal to fewer inner ones.
    ends = np.eye(2)
    along = np.concatenate([basis[:, 1:-1], basis[:, :1], basis[:, -1:]], axis=1)
    fewer = fit @ np.concatenate([along, np.concatenate([np.zeros((2, fine.control_points)), ends], axis=1)])
    population = np.asarray(found["population"])
    planes = population.reshape(*population.shape[:2], 3, fine.control_points)
    both = np.broadcast_to(np.stack([starts, goals], axis=2)[:, None], (*planes.shape[:3], 2))
    inner = np.concatenate([planes, both], axis=3) @ fewer.T
    population = inner.reshape(*inner.shape[:2], -1).astype(population.dtype)
    points = np.concatenate([starts[:, None], inner[:, 0].swapaxes(1, 2), goals[:, None]], axis=1)
    return {"population": population, "control_points": points.astype(population.dtype)}


@partial(compiled, static_argnames=("config",))
def _plan(
    keys: jax.Array,
    starts: jax.Array,
    goals: jax.Array,
    departs: jax.Array,
    populations: jax.Array | None,
    worlds: World,
    shared: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> dict[str, Any]:
    """The fields of `PathPlans` by name."""

    def one(
        key: jax.Array,
        start: jax.Array,
        goal: jax.Array,
        depart: jax.Array,
        population: jax.Array | None,
        own: World,
    ) -> dict[str, Any]:
        return search_leg(key, start, goal, depart, world_of(own, shared), vehicle, population, config)

    return jax.vmap(one)(keys, starts, goals, departs, populations, worlds)


def search_leg(
    key: jax.Array,
    start: jax.Array,
    goal: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    population: jax.Array | None,
    config: PathConfig,
) -> dict[str, Any]:
    """Search for the path of one leg, traceable: the fields of a `PathPlan` by name, and `wanting`.

    Obstacles must be resolved. `wanting` tells that fields know a path that breaks no limit, and that the one
    found is slower or breaks one.
    """
    factor = factor_of(start, goal)
    ends, depart = (start * factor, goal * factor), depart * factor
    env, vehicle, config = scaled(env, vehicle, config, factor)
    lower, upper = habitats.bounds(*ends, env, config)
    first_key, run_key = jax.random.split(key)
    problem = (*ends, depart, _paced(*ends, depart, env, vehicle, config), vehicle)
    if population is None:
        population = habitats.initial(first_key, config.bbo.population, *ends, lower, upper, config, env)
    else:
        population = population * factor
    closed, known = jnp.zeros((), lower.dtype), jnp.full((), jnp.inf, lower.dtype)
    if config.passages:
        found, times, closed, known = trace_passages(*problem, count=config.passages, config=config)
        lower, upper = habitats.widened(lower, upper, found, env)
        population = jnp.clip(population, lower, upper)
        population = _with_passages(population, found, times, lower, upper, problem, config)
    else:
        population = jnp.clip(population, lower, upper)
    cost = partial(score, config=config)
    result = search.run(run_key, cost, population, lower, upper, config.bbo, problem)
    if config.refine_steps:
        result = _polished(result, lower, upper, problem, config)

    best = result.state.population[:1]
    flight = fly(curves(best, *ends, config), depart, env, vehicle, config)
    wanting = jnp.isfinite(known) & ((flight.travel_time[0] > known) | (violations(flight)[:, 0].sum() > 0.0))
    return _in_own_units(best, flight, result, closed, start, goal, factor) | {"wanting": wanting}


def _in_own_units(
    best: jax.Array,
    flight: Flight,
    result: Result,
    closed: jax.Array,
    start: jax.Array,
    goal: jax.Array,
    factor: jax.Array,
) -> dict[str, Any]:
    """The fields of a `PathPlan` by name, from what was found in a world `factor` times as great."""
    inner = best.reshape(3, -1).T / factor
    # Excess counts metres of missing clearance and altitude, and shares of all other limits.
    metres = [name in ("coast", "obstacle", "seabed") for name in VIOLATIONS]
    excess = jnp.stack(flight.excess)[:, :, 0]
    excess = jnp.where(np.asarray(metres)[:, None], excess / factor, excess)
    clearance, altitude = flight.clearance.min(), flight.altitude.min()
    history = result.history
    return {
        "travel_time": flight.travel_time[0] / factor,
        "length": flight.length[0] / factor,
        "positions": jnp.stack([flight.x[:, 0], flight.y[:, 0], flight.z[:, 0]], axis=1) / factor,
        "times": flight.times[:, 0] / factor,
        "control_points": jnp.concatenate([start[None], inner, goal[None]]),
        "violations": excess.mean(axis=1),
        "clearance": jnp.where(clearance < FAR, clearance / factor, FAR),
        "altitude": jnp.where(altitude < FAR, altitude / factor, FAR),
        "cost": result.state.cost[0] / factor,
        "population": result.state.population / factor,
        "history": replace(
            history, **{name: getattr(history, name) / factor for name in ("best", "mean", "std")}
        ),
        "excess": excess,
        "closed": closed / factor,
        "water": jnp.stack(flight.water, axis=-1)[:, 0],
    }


def _paced(
    start: jax.Array,
    goal: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> Environment:
    """The world that paths are compared in: a gradual current is met at the pace of the straight line.

    Which spares the search the sailing of segments one after the other; the path that it finds is timed so.
    """
    if not is_gradual(env.current):
        return env
    line = curves(habitats.straight_line(start, goal, config)[None], start, goal, config)
    bare = replace(env, chart=None, obstacles=Obstacles.none(), seabed=None)
    flight = fly(line, depart, bare, vehicle, config)
    gap = norm(*line.way)[:, 0]
    pace = jnp.maximum(gap / jnp.diff(flight.times[:, 0]), _SLOWEST * vehicle.speed)
    return replace(env, current=PacedCurrent(env.current, pace))


def _with_passages(
    population: jax.Array,
    found: jax.Array,
    times: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    problem: tuple,
    config: PathConfig,
) -> jax.Array:
    """Put polished paths through the passages that there are in place of the last habitats."""
    count, steps = config.passages, config.passage_steps
    replaced = population[-count:]
    found = jnp.where(jnp.isfinite(times)[:, None], jnp.clip(found, lower, upper), replaced)
    if not steps:
        return population.at[-count:].set(found)
    # All passages at first, then the better half of them: a few steps tell which ones lead nowhere.
    size, first = config.refine_step_size, steps // 3
    found, cost, _ = _descend(found, lower, upper, problem, config, first, size)
    found = found[jnp.argsort(cost)]
    half = -(-count // 2)
    better, _, _ = _descend(found[:half], lower, upper, problem, config, steps - first, size)
    found = jnp.concatenate([better, found[half:]])
    return population.at[-count:].set(found)


def _descend(
    found: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    problem: tuple,
    config: PathConfig,
    steps: int,
    step_size: float,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    return descend(partial(guide, config=config), found, lower, upper, steps, problem, step_size)


def _polished(
    result: Result, lower: jax.Array, upper: jax.Array, problem: tuple, config: PathConfig
) -> Result:
    """Polish the elite by gradients, and rank the outcome into the population."""
    state = result.state
    chosen = slice(0, config.refine_count)
    step_size = config.refine_step_size / 3.0
    better = _descend(state.population[chosen], lower, upper, problem, config, config.refine_steps, step_size)
    merged = (
        state.population.at[chosen].set(better[0]),
        state.cost.at[chosen].set(better[1]),
        state.violation.at[chosen].set(better[2]),
    )
    state = search.init(*merged)
    last = search.statistics(state)
    history = jax.tree.map(lambda a, b: jnp.concatenate([a, b[None]]), result.history, last)
    return Result(state.population[0], state.cost[0], state.violation[0], state, history)
