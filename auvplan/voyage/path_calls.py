"""Batched calls of the path planner on what the vehicles believe, timed and booked."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.environment import Environment
from auvplan.path import PathPlan, PathPlans, plan_paths, replan_paths
from auvplan.voyage.belief import as_obstacles
from auvplan.voyage.fleet import Fleet, Leg
from auvplan.voyage.records import PlanRecord


def plan_legs(fleet: Fleet, legs: list[Leg], cause: str, cold: bool = False) -> None:
    """Plan paths from where the vehicles are, and follow them.

    Args:
        fleet: the missions.
        legs: that need a path.
        cause: "leg", "window" or "hazard", for the record.
        cold: search afresh; otherwise from the kept population.
    """
    keys = jnp.stack([fleet.key(leg.mission) for leg in legs])
    env = _believed(fleet, legs)
    # What a compiled program is made for: the settings and the shapes of the world.
    shapes = [leaf.shape[1:] for leaf in jax.tree.leaves((env.current, env.obstacles))]
    signature = ("path", cold, fleet.config, *shapes, fleet.chart and fleet.chart.shape)
    plans, seconds = fleet.clock.time(signature, partial(_call, fleet, legs, env, keys, cold))
    for leg, plan in zip(legs, plans, strict=True):
        _follow(fleet, leg, plan, cause, seconds / len(legs))


def _believed(fleet: Fleet, legs: list[Leg]) -> Environment:
    """The world as the vehicles know it now; current and obstacles have a leading axis."""
    area, index = fleet.scenario.area, [leg.mission for leg in legs]
    return Environment(
        fleet.current.told(index, fleet.scenario.current.forecast_error),
        fleet.chart,
        as_obstacles([leg.belief for leg in legs], fleet.scenario.sensors),
        area.lower,  # type: ignore[arg-type]
        area.upper,  # type: ignore[arg-type]
    )


def _call(fleet: Fleet, legs: list[Leg], env: Environment, keys: jax.Array, cold: bool) -> PathPlans:
    """The planning call."""
    area, now = fleet.scenario.area, fleet.now[[leg.mission for leg in legs]]
    places = np.stack([np.clip(leg.position, area.lower, area.upper) for leg in legs])
    common: dict[str, Any] = {"key": keys, "config": fleet.config, "world_per_leg": True}
    if cold:
        goals = np.stack([leg.target for leg in legs])
        return plan_paths(places, goals, env, fleet.vehicle, depart=now, **common)
    return replan_paths([leg.followed for leg in legs], places, now, env, fleet.vehicle, **common)


def _follow(fleet: Fleet, leg: Leg, plan: PathPlan, cause: str, seconds: float) -> None:
    """Take a new plan and book it."""
    history = {
        name: np.asarray(getattr(plan.history, name))
        for name in ("best", "mean", "std", "violation_best", "violation_mean", "violation_std")
    }
    now = float(fleet.now[leg.mission])
    record = PlanRecord(
        now, plan.positions, plan.times, plan.feasible, cause, seconds, history, fleet.current.at(leg.mission)
    )
    leg.record.plans.append(record)
    leg.plan, leg.track, leg.arc = plan, plan.positions, 0.0
    leg.moving, leg.escaping = True, False
