"""Two points to a timed, checked trajectory, any number of legs by the same programs (section 3.2)."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from auvplan.ocean.environment import Environment
from auvplan.path.bspline import basis_matrix, fit_matrix
from auvplan.path.config import PathConfig
from auvplan.path.ends import check_ends
from auvplan.path.plan import PathPlan, PathPlans
from auvplan.path.sensitivity import Conditions
from auvplan.path.stages import Legs, search_legs, split
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
    """Plan B legs by the same compiled programs, as many at once as the device does best.

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
    problem = {"shared": shared, "vehicle": conditions.vehicle}
    posed = Legs(start, goal, departs, world)
    found = over_rows(partial(search_legs, **problem, config=config), keys, posed, population)
    found, finer = plan_finely(found, keys, posed, **problem, config=config)
    return PathPlans(**found, conditions=conditions, finer=finer)


def plan_finely(
    found: dict[str, Any],
    keys: jax.Array,
    legs: Legs,
    shared: Environment,
    vehicle: Vehicle,
    config: PathConfig,
    window: bool = False,
) -> tuple[dict[str, Any], dict[int, dict[str, Any]]]:
    """Plan legs again with more control points and samples where the paths found leave something wanting.

    Winding ways have more bends than the usual control points can follow, and narrow ones are certified only
    between samples that lie close together.

    Args:
        found: fields of `PathPlans` by name, and `wanting`, which is taken out.
        keys: [B].
        legs: B legs.
        shared, vehicle, config, window: as for `search_legs`.

    Returns:
        The fields, with better paths where there are any, seen at every `finer`-th sample; and by index of
        the leg the fields of these paths at all samples.
    """
    again = np.flatnonzero(found.pop("wanting"))
    times = config.finer
    if times == 1 or not len(again):
        return found, {}
    segments = times * (config.samples - 1)
    fine = config.replace(control_points=times * config.control_points, samples=segments + 1)
    chosen = jax.tree.map(lambda leaf: np.asarray(leaf)[again], legs)
    program = partial(search_legs, shared=shared, vehicle=vehicle, config=fine, window=window)
    better = over_rows(program, keys[again], chosen, None)
    broken = [plans["violations"].sum(axis=1) for plans in (better, found)]
    less = (broken[0] < broken[1][again]) | (
        (broken[0] == broken[1][again]) & (better["cost"] < found["cost"][again])
    )
    if not less.any():
        return found, {}
    del better["wanting"]
    better |= {"population": _fitted(better["population"], chosen, fine, config)}
    better = jax.tree.map(lambda leaf: np.asarray(leaf)[less], better)
    again = again[less]
    finer = {int(leg): jax.tree.map(lambda leaf, k=k: leaf[k], better) for k, leg in enumerate(again)}

    def replaced(old: Any, new: Any) -> Any:
        old = np.array(old)
        old[again] = new
        return old

    return jax.tree.map(replaced, found, better | _thinned(better, times, config)), finer


def _thinned(found: dict[str, Any], times: int, config: PathConfig) -> dict[str, Any]:
    """What paths with so many times as many segments are like at the usual samples and control points."""
    free = config.control_points
    excess, water = found["excess"], found["water"]
    inner = found["population"][:, 0].reshape(-1, 3, free).swapaxes(1, 2)
    ends = found["control_points"][:, :1], found["control_points"][:, -1:]
    return {
        "positions": found["positions"][:, ::times],
        "times": found["times"][:, ::times],
        "control_points": np.concatenate([ends[0], inner, ends[1]], axis=1),
        "excess": excess.reshape(*excess.shape[:2], -1, times).max(axis=3),
        "water": water.reshape(len(water), -1, times, 3).mean(axis=2),
    }


def _fitted(population: Any, legs: Legs, fine: PathConfig, config: PathConfig) -> np.ndarray:
    """Habitats [B, P, 3 n] m of fewer control points, as near as may be to those of finer settings."""
    basis = basis_matrix(config.samples, fine.control_points + 2, config.degree)
    fit = fit_matrix(config.samples, config.control_points + 2, config.degree)
    # What takes inner control points, start and goal to fewer inner ones.
    ends = np.eye(2)
    along = np.concatenate([basis[:, 1:-1], basis[:, :1], basis[:, -1:]], axis=1)
    fewer = fit @ np.concatenate([along, np.concatenate([np.zeros((2, fine.control_points)), ends], axis=1)])
    population = np.asarray(population)
    planes = population.reshape(*population.shape[:2], 3, fine.control_points)
    both = np.broadcast_to(np.stack([legs.start, legs.goal], axis=2)[:, None], (*planes.shape[:3], 2))
    inner = np.concatenate([planes, both], axis=3) @ fewer.T
    return inner.reshape(*inner.shape[:2], -1).astype(population.dtype)
