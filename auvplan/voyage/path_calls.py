"""Batched calls of the path planner on what the vehicles believe, timed and booked."""

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.environment import Environment
from auvplan.path import PathPlan, PathPlans, plan_paths, replan_paths
from auvplan.voyage.batching import chunks
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
    for batch, real in chunks(legs):
        fresh = {leg.mission: fleet.key(leg.mission) for leg in batch[:real]}
        keys = jnp.stack([fresh[leg.mission] for leg in batch])
        signature = ("path", cold, len(batch), fleet.config, len(batch[0].truth.radius), fleet.chart is None)
        call = _call(fleet, batch, keys, cold)
        plans, seconds = fleet.clock.time(signature, call)
        for leg, plan in zip(batch[:real], plans, strict=False):
            _follow(fleet, leg, plan, cause, seconds / real)


def _call(fleet: Fleet, batch: list[Leg], keys: jax.Array, cold: bool):
    """The planning call of one padded batch, ready to be made."""
    area = fleet.scenario.area
    index = [leg.mission for leg in batch]
    env = Environment(
        fleet.current.told(index, fleet.scenario.current.forecast_error),
        fleet.chart,
        as_obstacles([leg.belief for leg in batch], fleet.scenario.sensors),
        area.lower,  # type: ignore[arg-type]
        area.upper,  # type: ignore[arg-type]
    )
    places = np.stack([np.clip(leg.position, area.lower, area.upper) for leg in batch])
    now, config, vehicle = fleet.now[index], fleet.config, fleet.vehicle

    def call() -> PathPlans:
        if cold:
            goals = np.stack([leg.target for leg in batch])
            return plan_paths(
                places, goals, env, vehicle, key=keys, config=config, depart=now, world_per_leg=True
            )
        old = [leg.followed for leg in batch]
        return replan_paths(old, places, now, env, vehicle, key=keys, config=config, world_per_leg=True)

    return call


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
