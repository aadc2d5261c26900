"""Speeds and energy under way: what edges take at each speed, and whether the charge does for the rest."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from auvplan.energy.power import WATT_HOUR
from auvplan.executive.context import Array, Mission
from auvplan.executive.surfacing import energy_charged
from auvplan.mission import MissionGraph, time_to_go
from auvplan.mission.speeds import SpeedOptions, picked
from auvplan.ocean.currents import evaluated


def travel_times(graph: MissionGraph, speed: float) -> Array:
    """Return travel times of a graph timed at a speed, m/s: [N, N] s, or [M, N, N] by departure."""
    timetable = graph.timetable
    return graph.leg_times(speed) - graph.duration if timetable is None else timetable.travel_time


def offer_speeds(mission: Mission, known: Mapping[float, Array]) -> None:
    """Let the speed of each edge be chosen among the context's, and time edges at those that are chosen.

    Along one path the speed over ground grows with that through the water: between those known it is taken
    to be linear.

    Args:
        mission: whose edges are timed at the vehicle's speed.
        known: travel times at some speeds, m/s, the least and the greatest among them.
    """
    context, base, power = mission.context, mission.timed, mission.context.power
    speeds = context.speeds
    assert speeds is not None
    assert power is not None
    knots = sorted(known)
    rates: list[Array] = [1.0 / np.maximum(known[knot], 1e-9) for knot in knots]
    travel = np.stack([_between(speed, knots, rates) for speed in speeds.tolist()])
    for (i, j), longer in mission.learnt.items():
        travel[..., i, j] *= longer
    watts = np.asarray([float(power.power(speed)) for speed in speeds.tolist()])
    waiting = None
    if base.timetable is not None:
        departures = base.timetable.departures
        moments = departures if len(departures) > 1 else np.asarray([mission.now])
        waiting = np.asarray(power.power(_drift(mission, moments)))
    options = SpeedOptions(speeds, watts, travel, _fixed(mission), waiting=waiting)
    chosen = mission.chosen
    if chosen is None:
        chosen = np.full(base.adjacency.shape, int(np.abs(speeds - context.speed).argmin()))
    mission.chosen = chosen = options.passable(chosen)
    # Estimates may know times of edges that have left the graph since, or were never offered.
    open_ = mission.graph.adjacency & np.isfinite(options.least).any(axis=0)
    mission.timed = replace(base, adjacency=open_, options=options).at_speeds(chosen)


def _between(speed: float, knots: list[float], rates: list[Array]) -> Array:
    """Return travel times, s, at a speed, from 1 / s at those known; infinite where a slower one is zero."""
    after = int(np.clip(np.searchsorted(knots, speed), 1 if len(knots) > 1 else 0, len(knots) - 1))
    before = max(after - 1, 0)
    share = (speed - knots[before]) / (knots[after] - knots[before]) if after > before else 1.0
    rate = (1.0 - share) * rates[before] + share * rates[after]
    if 0.0 < share < 1.0:
        rate = np.where((rates[before] > 0.0) & (rates[after] > 0.0), rate, 0.0)
    with np.errstate(divide="ignore"):
        return np.where(rate > 0.0, 1.0 / rate, np.inf)


def _drift(mission: Mission, moments: Array) -> Array:
    """Return m/s through the water [M, N] of a vehicle that stays at waypoints at moments [M] s.

    It keeps station in the current of then, or loiters.
    """
    places = np.asarray(mission.graph.positions)
    if mission.context.scenario.mission.wait == "loiter":
        return np.full((len(moments), len(places)), mission.context.speed)
    where, when = np.tile(places, (len(moments), 1)), np.repeat(moments, len(places))
    water = evaluated(mission.sea.forecast(), *where.T, t=when)
    return np.hypot(*(np.asarray(axis) for axis in water[:2])).reshape(len(moments), -1)


def _fixed(mission: Mission) -> Array:
    """Return J [N, N] of edges at any speed: of their change of depth, their tasks and surfacing for fixes.

    A vehicle that stays for a task keeps station in the current of now, or loiters. A survey line starts with
    the edge that leads to it, or from where the vehicle is, unless it is on the line.
    """
    context, graph = mission.context, mission.graph
    power, places = context.power, np.asarray(graph.positions)
    assert power is not None
    depth = np.asarray(power.in_depth(places[None, :, 2] - places[:, None, 2]))
    drift = _drift(mission, np.asarray([mission.now]))[0]
    staying = np.asarray(power.power(drift)) + power.task
    along = np.zeros(graph.adjacency.shape, bool)
    for edge in mission.parts:
        along[edge] = graph.adjacency[edge] and graph.priority[edge] > 0.0
    starts = ((graph.priority > 0.0) | along.any(axis=1)) & ~along
    done = mission.run.done[-1:]
    if not (done and done[0].line is not None and done[0].priority > 0.0 and done[0].goal == mission.here):
        starts[mission.here] |= along[mission.here]
    travel = travel_times(mission.timed, context.speed)
    least = travel if travel.ndim == 2 else travel.min(axis=0)
    fixes = energy_charged(mission, least, drift)
    return np.maximum(depth + graph.duration * staying + power.task_start * starts + fixes, 0.0)


def with_still_water(graph: MissionGraph, whole: MissionGraph) -> MissionGraph:
    """Return a graph with speeds whose closed edges, open in the whole one, are timed as in still water."""
    options = graph.options
    assert options is not None
    times = np.stack([whole.still_times(speed) for speed in options.speeds.tolist()])
    shape = (slice(None), None) if options.clocked else slice(None)
    known = np.isfinite(options.travel_time)
    options = replace(options, travel_time=np.where(known, options.travel_time, times[shape]))
    graph = replace(graph, adjacency=whole.adjacency, options=options)
    return graph.at_speeds(options.passable(np.zeros(graph.adjacency.shape, int)))


def drawn(mission: Mission) -> float:
    """Return what the vehicle has drawn so far, in shares of what its power model says."""
    return mission.run.draw if mission.run.done else 1.0


def hurry_home(mission: Mission) -> None:
    """Choose the speed of the last leg again: none follows on which lost time could be made up.

    The slowest from the chosen one on that is in time with twice the return margin and does for the charge;
    where none is in time, the fastest that does for the charge.
    """
    options, chosen, edge = mission.timed.options, mission.chosen, (mission.here, mission.run.goal)
    assert options is not None
    assert chosen is not None
    longer = 1.0 + 2.0 * mission.last_route.return_margin
    lasts = options.least[:, *edge] + mission.timed.duration[edge]
    place = _fast_enough(mission, longer * lasts, longer * options.energies[:, *edge], int(chosen[edge]))
    if place is not None:
        mission.chosen = chosen.copy()
        mission.chosen[edge] = place
        mission.timed = mission.timed.at_speeds(mission.chosen)


def _fast_enough(mission: Mission, lasts: Array, energies: Array, first: int) -> int | None:
    """Return the slowest speed from `first` on that is in time and does for the charge, by its place.

    Where none is in time, that is the fastest that does for the charge; None where none does.

    Args:
        mission: which has the time and the charge.
        lasts, energies: [K] s and J at each speed, the latter by the model.
        first: place of the slowest that is asked for.
    """
    places = np.arange(first, len(lasts))
    places = places[drawn(mission) * energies[places] <= mission.energy_left]
    in_time = places[lasts[places] <= mission.run.t_available - mission.now]
    if not len(places):
        return None
    return int(in_time[0] if len(in_time) else places[lasts[places].argmin()])


def hurries(mission: Mission) -> bool:
    """Let a vehicle whose path home takes too long go faster, as far as the charge does; return whether."""
    options, leg = mission.timed.options, mission.active_leg
    if options is None or leg.record.speed is None or leg.record.goal != mission.run.goal:
        return False
    now = int(np.searchsorted(options.speeds, leg.record.speed - 1e-9))
    lasts = leg.followed.travel_time * leg.record.speed / options.speeds
    whole = (1.0 + mission.last_route.return_margin) * lasts + leg.record.t_task
    if whole[now] <= mission.run.t_available - mission.now:
        return False
    energies = options.power * lasts + options.fixed[leg.record.start, leg.record.goal]
    place = _fast_enough(mission, whole, energies, now + 1)
    if place is not None:
        leg.record.speed = float(options.speeds[place])
    return place is not None


def way_home(mission: Mission) -> float:
    """Return J of the way of least energy from where a vehicle is to its destination; 0 without one."""
    assert mission.timed.options is not None
    energies = mission.timed.options.energies.min(axis=0)
    energies = np.where(mission.timed.adjacency, energies, np.inf)
    least = float(time_to_go(energies, mission.run.goal)[mission.here])
    return least if np.isfinite(least) else 0.0


def energy_due(mission: Mission) -> str:
    """Return why the route no longer fits the charge, or an empty string: "charge" or "spare"."""
    options, chosen, rest = mission.timed.options, mission.chosen, mission.rest
    if options is None or chosen is None or not np.isfinite(left := mission.energy_left):
        return ""
    legs = np.asarray(rest[:-1]), np.asarray(rest[1:])
    passed = mission.timed.itinerary(rest, mission.context.speed)
    tasks = mission.timed.duration[legs]
    needs = float(options.spent(legs, chosen[legs], passed, tasks, mission.timed.timetable).sum())
    slack, rules = left - drawn(mission) * needs, mission.context.rules
    watts = float(options.power.mean())
    if slack < min(mission.energy_slack, 0.0) - rules.tolerance * watts:
        return "charge"
    return "spare" if slack - mission.energy_slack > rules.gain * watts else ""


def lacking(mission: Mission) -> str:
    """Return what the planned leg would leave too little of for the way back, or an empty string.

    The way back may be gone at any speed: it does where time and charge both do for it on one level.
    """
    options, chosen, leg = mission.timed.options, mission.chosen, mission.active_leg
    assert options is not None
    assert chosen is not None
    edge, duration = (leg.record.start, leg.record.goal), mission.timed.duration
    lasts = leg.followed.travel_time
    left = mission.run.t_available - mission.now - lasts - leg.record.t_task
    own = options.power[chosen[edge]] * lasts + options.fixed[edge]
    charge = mission.energy_left / drawn(mission) - own
    closed = ~np.asarray(mission.timed.adjacency)
    if mission.context.rules.visits == "once":
        closed[:, edge[0]] = True
    lacks = []
    for row in options.chosen(mission.context.route_configs[0].levels):
        back = []
        for values in (options.least + duration, options.energies):
            at = np.where(closed, np.inf, picked(values, row))
            back.append(float(time_to_go(at, mission.run.goal)[edge[1]]))
        seconds, joules = (1.0 + mission.last_route.return_margin) * np.asarray(back)
        lacks.append((seconds - left, joules - charge))
    if not np.isfinite(lacks).any() or min(max(lack) for lack in lacks) <= 0.0:
        return ""
    seconds = min(lack[0] for lack in lacks)
    if seconds > 0.0:
        return f"its path would leave {seconds:.0f} s too little for the way back"
    joules = min(lack[1] for lack in lacks if lack[0] <= 0.0)
    return f"its path would leave {joules / WATT_HOUR:.0f} Wh too little for the way back"
