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
from auvplan.path.config import PathConfig
from auvplan.path.cost import curves, fly, guide, score, violations
from auvplan.path.ends import check_ends
from auvplan.path.kinematics import PacedCurrent, norm
from auvplan.path.passages import trace_passages
from auvplan.path.plan import PathPlan, PathPlans
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
    program = partial(_plan, shared=shared, vehicle=conditions.vehicle, config=config)
    found = over_rows(program, keys, start, goal, departs, population, world)
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
    """One leg's search, traceable: the fields of a `PathPlan` by name. Obstacles must be resolved."""
    lower, upper = habitats.bounds(start, goal, env, config)
    first_key, run_key = jax.random.split(key)
    problem = (start, goal, depart, _paced(start, goal, depart, env, vehicle, config), vehicle)
    if population is None:
        count = config.bbo.population
        population = habitats.initial(first_key, count, start, goal, lower, upper, config, env)
    population = jnp.clip(population, lower, upper)
    if config.passages:
        population = _with_passages(population, lower, upper, problem, config)
    cost = partial(score, config=config)
    result = search.run(run_key, cost, population, lower, upper, config.bbo, problem)
    if config.refine_steps:
        result = _polished(result, lower, upper, problem, config)

    best = result.state.population[:1]
    track = curves(best, start, goal, config)
    flight = fly(track, depart, env, vehicle, config)
    inner = best.reshape(3, -1).T
    return {
        "travel_time": flight.travel_time[0],
        "length": flight.length[0],
        "positions": jnp.stack([flight.x[:, 0], flight.y[:, 0], flight.z[:, 0]], axis=1),
        "times": flight.times[:, 0],
        "control_points": jnp.concatenate([start[None], inner, goal[None]]),
        "violations": violations(flight)[:, 0],
        "clearance": flight.clearance.min(),
        "altitude": flight.altitude.min(),
        "cost": result.state.cost[0],
        "population": result.state.population,
        "history": result.history,
        "excess": jnp.stack(flight.excess)[:, :, 0],
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
    population: jax.Array, lower: jax.Array, upper: jax.Array, problem: tuple, config: PathConfig
) -> jax.Array:
    """Put polished paths through the passages that there are in place of the last habitats."""
    found, times = trace_passages(*problem, count=config.passages, config=config)
    replaced = population[-config.passages :]
    found = jnp.where(jnp.isfinite(times)[:, None], jnp.clip(found, lower, upper), replaced)
    if config.passage_steps:
        steps, size = config.passage_steps, config.refine_step_size
        found, _, _ = _descend(found, lower, upper, problem, config, steps, size)
    return population.at[-config.passages :].set(found)


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
