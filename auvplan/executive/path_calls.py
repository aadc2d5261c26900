"""Batched calls of the path planner on what the vehicles believe, timed and booked."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import numpy as np

from auvplan.executive.belief import as_obstacles
from auvplan.executive.context import Array, Mission
from auvplan.executive.lines import follow, rows_of
from auvplan.mission.travel_times import TURN_TO
from auvplan.ocean.currents import Current, evaluated
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path import PathPlan, plan_paths, replan_paths
from auvplan.path.cost import VIOLATIONS
from auvplan.path.planner import sketch_paths
from auvplan.path.saw_tooth import saw_tooth_plan
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


def plan_legs(missions: list[Mission], cause: str, cold: bool = False, growing: bool = True) -> None:
    """Plan paths from where the vehicles are, and follow them; arguments as `offered`."""
    causes = [cause] * len(missions)
    for mission, offer in zip(missions, offered(missions, causes, cold, growing), strict=True):
        take(mission, offer, mission.context.rules.lower_bounds)


def offered(
    missions: list[Mission],
    causes: Sequence[str],
    cold: bool = False,
    growing: bool = True,
    forecasts: Sequence[Current] | None = None,
) -> list[Offer]:
    """Plan paths from where the vehicles are; none is followed yet.

    Args:
        missions: B missions on a leg that needs a path.
        causes: [B], "leg", "window" or "hazard", for the record.
        cold: search afresh; otherwise from the kept population.
        growing: whether boundaries of all obstacles grow until they are seen again; otherwise of those alone
            that the vehicle may meet before it has looked at them from near.
        forecasts: B currents to plan in; drawn if absent.
    """
    found = {
        row: Offer(_staying(mission), "leg", 0.0)
        for row, mission in enumerate(missions)
        if mission.active_leg.stays
    }
    if going := [row for row in range(len(missions)) if row not in found]:
        those = [missions[row] for row in going]
        currents = None if forecasts is None else [forecasts[row] for row in going]
        keys = prng.stacked([mission.path_key() for mission in those])
        env = believed(those, currents)
        context, legs = those[0].context, [mission.active_leg for mission in those]
        if not growing:
            met = [(leg.position, context.lookahead, one.speed) for one, leg in zip(those, legs, strict=True)]
            growth = [leg.belief.growth * leg.belief.within(*at) for leg, at in zip(legs, met, strict=True)]
            env = replace(env, obstacles=replace(env.obstacles, growth=np.stack(growth)))
        if (saw := context.saw_tooth) is not None:
            env = replace(env, seabed=saw.with_room(env.seabed))
        plans, seconds = context.clock.time(partial(_call, those, env, keys, cold))
        if saw is not None:
            plans = [saw_tooth_plan(plan, saw, context.as_built, context.area.seabed) for plan in plans]
        for row, plan in zip(going, plans, strict=True):
            found[row] = Offer(plan, causes[row], seconds / len(going))
    return [found[row] for row in range(len(missions))]


def _staying(mission: Mission) -> PathPlan:
    """Return the plan of a leg between two waypoints in one place: station is kept there for a moment."""
    context, leg, forecast = mission.context, mission.active_leg, mission.sea.forecast()
    samples = context.path_config.samples
    share = np.linspace(0.0, 1.0, samples)
    positions = leg.origin + share[:, None] * (leg.target - leg.origin)
    times, middle = mission.now + TURN_TO * share, 0.5 * (positions[1:] + positions[:-1])
    return PathPlan.unsearched(
        Conditions(context.environment(forecast), mission.vehicle, context.path_config),
        travel_time=TURN_TO,
        length=float(np.linalg.norm(leg.target - leg.origin)),
        positions=positions,
        times=times,
        control_points=positions[[0, -1]],
        clearance=np.inf,
        altitude=np.inf,
        cost=TURN_TO,
        excess=np.zeros((len(VIOLATIONS), samples - 1)),
        water=np.stack(evaluated(forecast, *middle.T, t=times[:-1]), axis=1),
    )


def believed(missions: list[Mission], forecasts: Sequence[Current] | None = None) -> Environment:
    """Return the world as the vehicles know it now; current and obstacles have a leading axis."""
    context = missions[0].context
    obstacles = as_obstacles([mission.active_leg.belief for mission in missions], context.scenario.sensors)
    currents = [mission.sea.forecast() for mission in missions] if forecasts is None else forecasts
    return context.environment(stacked(currents), obstacles)


def sketched(mission: Mission, starts: Array, goals: Array, departs: Array) -> list[Array]:
    """Return paths [K, S, 3] m between B pairs of places, nearly as quick as those that legs would have.

    What was found between two places is kept.

    Args:
        starts, goals: [B, 3] m.
        departs: [B] s since the epoch.
    """
    context = mission.context
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


def _call(missions: list[Mission], env: Environment, keys: jax.Array, cold: bool) -> list[PathPlan]:
    """Return a plan each: along its survey line, or the planner's, which is called for each speed."""
    found, free = dict[int, PathPlan](), dict[float, list[int]]()
    for row, mission in enumerate(missions):
        if (line := mission.active_leg.record.line) is None:
            free.setdefault(mission.speed, []).append(row)
        else:
            found[row] = follow(mission, line, mission.active_leg.position, rows_of(env, [row]), keys[row])
    for rows in free.values():
        world, own = env, keys
        if len(rows) < len(missions):
            world, own = rows_of(env, rows), keys[np.asarray(rows)]
        found |= dict(zip(rows, _searched([missions[row] for row in rows], world, own, cold), strict=True))
    return [found[row] for row in range(len(missions))]


def _searched(missions: list[Mission], env: Environment, keys: jax.Array, cold: bool) -> list[PathPlan]:
    """Return the planning call of legs that are free to go any way, all at one speed."""
    context = missions[0].context
    vehicle = missions[0].vehicle
    legs = [mission.active_leg for mission in missions]
    now = np.asarray([mission.now for mission in missions])
    if context.navigation is not None:
        states = [mission.known or context.navigation for mission in missions]
        since = (np.asarray([float(getattr(one, part)) for one in states]) for part in ("way", "unlocked"))
        vehicle = replace(vehicle, navigation=context.navigation.since(*since))
    places = np.stack([np.clip(leg.position, *context.box) for leg in legs])
    common: dict[str, Any] = {"key": keys, "config": context.path_config, "world_per_leg": True}
    common["budget"] = context.rules.budget
    if cold:
        goals = np.stack([leg.target for leg in legs])
        return list(plan_paths(places, goals, env, vehicle, depart=now, **common))
    return list(replan_paths([leg.followed for leg in legs], places, now, env, vehicle, **common))


def take(mission: Mission, offer: Offer, bounded: bool = False) -> None:
    """Follow a new plan, and book it, `bounded` with what no path could beat."""
    plan, leg = offer.plan, mission.active_leg
    names = "best", "mean", "std", "violation_best", "violation_mean", "violation_std"
    history = {name: np.asarray(getattr(plan.history, name)) for name in names}
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
