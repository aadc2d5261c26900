"""Batched calls of the path planner on what the vehicles believe, timed and booked."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.bbo import History
from auvplan.executive.belief import as_obstacles
from auvplan.executive.context import Array, Mission, SimulationContext
from auvplan.executive.lines import follow, rows_of
from auvplan.mission.travel_times import TURN_TO
from auvplan.ocean.currents import Current, evaluated
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path import PathPlan, PathPlans, plan_paths, replan_paths
from auvplan.path.cost import VIOLATIONS
from auvplan.path.planner import sketch_paths
from auvplan.path.sensitivity import Conditions
from auvplan.records import PlanRecord
from auvplan.runtime import prng
from auvplan.simulation.sea import stacked


@dataclass(frozen=True)
class Offer:
    """A path that a vehicle may follow: the plan, "leg", "window" or "hazard", and s that it took to make."""

    plan: PathPlan
    cause: str
    seconds: float


def plan_legs(
    context: SimulationContext,
    missions: list[Mission],
    causes: Sequence[str],
    cold: bool = False,
    growing: bool = True,
) -> None:
    """Plan paths from where the vehicles are, and follow them; arguments as `offered`."""
    for mission, offer in zip(missions, offered(context, missions, causes, cold, growing), strict=True):
        take(mission, offer, context.rules.lower_bounds)


def offered(
    context: SimulationContext,
    missions: list[Mission],
    causes: Sequence[str],
    cold: bool = False,
    growing: bool = True,
    forecasts: Sequence[Current] | None = None,
) -> list[Offer]:
    """Plan paths from where the vehicles are; none is followed yet.

    Args:
        context: what the missions share.
        missions: B missions on a leg that needs a path.
        causes: [B], "leg", "window" or "hazard", for the record.
        cold: search afresh; otherwise from the kept population.
        growing: whether boundaries of all obstacles grow until they are seen again; otherwise of those alone
            that the vehicle may meet before it has looked at them from near.
        forecasts: B currents to plan in; drawn if absent.
    """
    found = {
        row: Offer(_staying(context, mission), "leg", 0.0)
        for row, mission in enumerate(missions)
        if mission.active_leg.stays
    }
    if going := [row for row in range(len(missions)) if row not in found]:
        those = [missions[row] for row in going]
        currents = None if forecasts is None else [forecasts[row] for row in going]
        keys = prng.stacked([mission.path_key() for mission in those])
        env = believed(context, those, currents)
        if not growing:
            env = replace(env, obstacles=replace(env.obstacles, growth=_growth_of_near(context, those)))
        plans, seconds = context.clock.time(partial(_call, context, those, env, keys, cold))
        for row, plan in zip(going, plans, strict=True):
            found[row] = Offer(plan, causes[row], seconds / len(going))
    return [found[row] for row in range(len(missions))]


def _growth_of_near(context: SimulationContext, missions: list[Mission]) -> NDArray[np.floating]:
    """[B, M] m/s, growth of the boundaries that vehicles may meet before they have seen them from near."""
    legs = [mission.active_leg for mission in missions]
    near = [leg.belief.within(leg.position, context.lookahead, context.speed) for leg in legs]
    return np.stack([leg.belief.growth * soon for leg, soon in zip(legs, near, strict=True)])


def _staying(context: SimulationContext, mission: Mission) -> PathPlan:
    """Return the plan of a leg between two waypoints in one place: station is kept there for a moment."""
    leg, config, forecast = mission.active_leg, context.path_config, mission.sea.forecast()
    share = np.linspace(0.0, 1.0, config.samples)
    positions = leg.origin + share[:, None] * (leg.target - leg.origin)
    times, middle = mission.now + TURN_TO * share, 0.5 * (positions[1:] + positions[:-1])
    none, limits = jnp.zeros(0), len(VIOLATIONS)
    return PathPlan(
        travel_time=TURN_TO,
        length=float(np.linalg.norm(leg.target - leg.origin)),
        positions=positions,
        times=times,
        control_points=positions[[0, -1]],
        violations=np.zeros(limits),
        clearance=np.inf,
        altitude=np.inf,
        cost=TURN_TO,
        population=jnp.zeros((0, 3 * config.control_points)),
        history=History(*[none] * len(History.__dataclass_fields__)),
        excess=np.zeros((limits, config.samples - 1)),
        water=np.stack(evaluated(forecast, *middle.T, t=times[:-1]), axis=1),
        conditions=Conditions(context.environment(forecast), context.vehicle, config),
    )


def believed(
    context: SimulationContext, missions: list[Mission], forecasts: Sequence[Current] | None = None
) -> Environment:
    """Return the world as the vehicles know it now; current and obstacles have a leading axis."""
    obstacles = as_obstacles([mission.active_leg.belief for mission in missions], context.scenario.sensors)
    currents = [mission.sea.forecast() for mission in missions] if forecasts is None else forecasts
    return context.environment(stacked(currents), obstacles)


def sketched(
    context: SimulationContext, mission: Mission, starts: Array, goals: Array, departs: Array
) -> list[Array]:
    """Return paths [K, S, 3] m between B pairs of places, nearly as quick as those that legs would have.

    What was found between two places is kept.

    Args:
        starts, goals: [B, 3] m.
        departs: [B] s since the epoch.
    """
    keys = [ends.tobytes() for ends in np.concatenate([starts, goals], axis=1)]
    if rows := [row for row, key in enumerate(keys) if key not in mission.sketches]:
        # Worlds are shaped as those of legs are, whose programs serve.
        places = mission.faults.places if context.simulated else 0
        known = context.known_obstacles(mission.now)
        still = Obstacles.static(known.position, known.radius).padded(
            len(known.radius) + context.surprises + places
        )
        each = jax.tree.map(lambda leaf: np.stack([np.asarray(leaf)] * len(rows)), still)
        env = context.environment(stacked([mission.sea.forecast()] * len(rows)), each)
        posed = starts[rows], goals[rows], departs[rows], env, context.vehicle, context.path_config
        paths = sketch_paths(*posed, world_per_leg=True)
        mission.sketches |= {keys[row]: path for row, path in zip(rows, paths, strict=True)}
    return [mission.sketches[key] for key in keys]


def _call(
    context: SimulationContext, missions: list[Mission], env: Environment, keys: jax.Array, cold: bool
) -> Sequence[PathPlan]:
    """Return a plan each: along its survey line, or the planner's."""
    lines = [mission.active_leg.record.line for mission in missions]
    if not any(lines):
        return list(_searched(context, missions, env, keys, cold))
    found = {
        row: follow(context, line, mission.active_leg.position, mission.now, rows_of(env, [row]), keys[row])
        for row, (mission, line) in enumerate(zip(missions, lines, strict=True))
        if line is not None
    }
    if free := [row for row, line in enumerate(lines) if line is None]:
        chosen = [missions[row] for row in free], rows_of(env, free), keys[np.asarray(free)]
        found |= dict(zip(free, _searched(context, *chosen, cold), strict=True))
    return [found[row] for row in range(len(missions))]


def _searched(
    context: SimulationContext, missions: list[Mission], env: Environment, keys: jax.Array, cold: bool
) -> PathPlans:
    """Return the planning call of legs that are free to go any way."""
    legs = [mission.active_leg for mission in missions]
    now = np.asarray([mission.now for mission in missions])
    places = np.stack([np.clip(leg.position, *context.box) for leg in legs])
    common: dict[str, Any] = {"key": keys, "config": context.path_config, "world_per_leg": True}
    common["budget"] = context.rules.budget
    if cold:
        goals = np.stack([leg.target for leg in legs])
        return plan_paths(places, goals, env, context.vehicle, depart=now, **common)
    return replan_paths([leg.followed for leg in legs], places, now, env, context.vehicle, **common)


def take(mission: Mission, offer: Offer, bounded: bool = False) -> None:
    """Follow a new plan, and book it, `bounded` with what no path could beat."""
    plan, leg = offer.plan, mission.active_leg
    history = {
        name: np.asarray(getattr(plan.history, name))
        for name in ("best", "mean", "std", "violation_best", "violation_mean", "violation_std")
    }
    leg.record.plans.append(
        PlanRecord(
            mission.now,
            plan.positions,
            plan.times,
            float(plan.cost),
            plan.feasible,
            offer.cause,
            offer.seconds,
            history,
            mission.sea.field,
            plan.motion,
            plan.lower_bound if bounded and plan.feasible else math.nan,
        )
    )
    leg.follow(plan)
