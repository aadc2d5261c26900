"""Reactive re-planning from the vehicle's position with the kept population (section 3.2.2, Fig. 5).

State in, plan out: nothing here needs the simulator, so a vehicle's software calls it as it stands.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from auvplan.ocean.environment import Environment
from auvplan.path import habitats
from auvplan.path.config import PathConfig
from auvplan.path.ends import as_point, check_given, check_moment
from auvplan.path.plan import PathPlan, PathPlans
from auvplan.path.planner import search_and_polish
from auvplan.path.samples import in_samples
from auvplan.path.sensitivity import Conditions
from auvplan.path.stages import Batch, Legs, search_legs
from auvplan.runtime.arguments import instance, numbers, per_row
from auvplan.runtime.budget import Budget
from auvplan.runtime.compiled import compiled
from auvplan.runtime.prng import key_per
from auvplan.vehicle import Vehicle


def replan_path(
    plan: PathPlan,
    position: ArrayLike,
    now: float,
    env: Environment,
    vehicle: Vehicle | None = None,
    *,
    key: jax.Array,
    config: PathConfig | None = None,
    budget: float | None = None,
) -> PathPlan:
    """Refine a path from where the vehicle is, with the current and obstacles known now.

    Args:
        plan: the plan being followed; its population is kept.
        position: [3] m, where the vehicle is.
        now: s since the epoch.
        env: the updated world.
        vehicle: speed and limits.
        key: PRNG key, consumed.
        config: settings; defaults to `PathConfig()`, as for `plan_path`; of them `config.window()` is run.
        budget: s of wall-clock time, as for `plan_path`.

    Returns:
        A plan from `position` to the old goal, departing now.

    Differences from the paper:
        It preserves "a part of information from the previous solution" without saying which; here every
        habitat is carried over by `habitats.transfer`, and `config.fresh_share` of them redrawn, none by the
        paper's preset.

    Raises:
        ValueError: the position lies on land, below the sea bed or outside, or at the goal; the current is
            NaN on the way; or `now` is not finite, or too far from the epoch for single precision.
        TypeError: as `plan_path`.
    """
    position = as_point("position", position)
    at = position[None], now
    return replan_paths([plan], *at, env, vehicle, key=key, config=config, budget=budget)[0]


def replan_paths(
    plans: Sequence[PathPlan],
    positions: ArrayLike,
    now: ArrayLike,
    env: Environment,
    vehicle: Vehicle | None = None,
    *,
    key: jax.Array,
    config: PathConfig | None = None,
    world_per_leg: bool = False,
    budget: float | None = None,
) -> PathPlans:
    """Re-plan B legs by the same compiled programs; arguments as `replan_path` and `plan_paths`.

    Args:
        plans: B plans being followed.
        positions: [B, 3] m.
        now: s since the epoch, one or [B].
        env: the updated world; with `world_per_leg` current and obstacles carry a leading axis B.
        vehicle: speed and limits.
        key: one PRNG key, or B keys.
        config: settings.
        world_per_leg: whether current and obstacles differ by leg.
        budget: s of wall-clock time for all legs together.

    Raises:
        ValueError, TypeError: as `replan_path` and `plan_paths`.
    """
    keys = key_per("leg", key, len(plans))
    check_given(env, vehicle, config)
    check_moment("now", now)
    position = numbers("positions", positions)
    if not len(plans) or position.shape != (len(plans), 3):
        got = f"got shape {position.shape} and {len(plans)} plans"
        raise ValueError(f"positions must be [B, 3] m, one for each of at least one plan, {got}")
    watch, departs = None if budget is None else Budget(budget, len(plans)), per_row("now", now, len(plans))
    for plan in plans:
        instance("plan", plan, PathPlan, "what ap.plan_path returned")
    goals, starts = (np.stack([plan.control_points[end] for plan in plans]) for end in (-1, 0))
    conditions = Conditions.of(env, vehicle, config, world_per_leg)
    reached = [progress(plan, point) for plan, point in zip(plans, position, strict=True)]
    kept = np.stack([plan.population for plan in plans]), starts, np.asarray(reached)
    return search_and_polish(_search_on, kept, (position, goals), departs, keys, conditions, watch)


def progress(plan: PathPlan, position: np.ndarray) -> float:
    """Spline parameter in [0, 1) of the point on the plan nearest to a position [3] m."""
    nearest = int(np.argmin(np.linalg.norm(plan.positions - position, axis=1)))
    return min(nearest / (len(plan.positions) - 1), 0.999)


def _search_on(
    keys: jax.Array,
    batch: Batch,
    kept: tuple[jax.Array, ...],
    config: PathConfig,
    budget: Budget | None = None,
) -> dict[str, Any]:
    """As `search_legs`, from populations of paths from other starts and how far these have been followed."""
    keeping = config.only("start_shape", "width", "depth_width")
    fresh = round(config.fresh_share * config.bbo.population)
    population, keys = _kept(batch, keys, *kept, config=keeping, fresh=fresh)
    return in_samples(search_legs, keys, batch, population, config=config, window=True, budget=budget)


@partial(compiled, static_argnames=("config", "fresh"), wide=True, quick=True)
def _kept(
    batch: Batch,
    keys: jax.Array,
    populations: jax.Array,
    starts: jax.Array,
    reached: jax.Array,
    config: PathConfig,
    fresh: int,
) -> tuple[jax.Array, jax.Array]:
    """Populations [B, P, 3 n] m carried over to where the vehicles are, and keys to search with."""

    def one(
        leg: Legs, key: jax.Array, population: jax.Array, start: jax.Array, reached: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        fresh_key, search_key = jax.random.split(key)
        kept = habitats.transfer(population, start, leg.goal, reached, leg.start, config)
        if fresh:
            # The worst of the kept ones make room for new detours: an obstacle may have closed the passage.
            problem = batch.problem(leg)
            lower, upper = habitats.bounds(problem, config)
            new = habitats.initial(fresh_key, fresh, problem, lower, upper, config)
            kept = jnp.concatenate([kept[: kept.shape[0] - fresh], new])
        return kept, search_key

    return batch.over_legs(one, keys, populations, starts, reached)
