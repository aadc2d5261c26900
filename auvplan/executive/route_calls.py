"""Batched calls of the mission planner: travel times in the forecast current, then routes."""

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from auvplan.executive.context import AtSpeed, ByDeparture, Mission
from auvplan.executive.lines import as_followed, line_times
from auvplan.executive.path_calls import sketched
from auvplan.executive.speeds import drawn, offer_speeds, travel_times, way_home, with_still_water
from auvplan.executive.surfacing import charged
from auvplan.mission import MissionConfig, MissionGraph, MissionRoute, MissionStatus, plan_missions
from auvplan.mission.graph import shortest_path
from auvplan.mission.jobs import edges_off_lines
from auvplan.mission.timetable import Array, Timetable
from auvplan.mission.travel_times import TravelTimeConfig
from auvplan.path import PathConfig
from auvplan.records import RouteRecord
from auvplan.runtime import prng

#: Departures of a mission at which edges are bent to the current.
_BENDS = 5

#: s of departures for which edges are timed where the time available is over.
_LATE = 600.0

#: s added for each visited waypoint on a way, so that the way passes as few of them as can be.
_PASSED = 1e7


def effort(config: PathConfig) -> TravelTimeConfig:
    """Return the estimate's settings that go with a path planner's.

    Its limits and margins, on fewer samples.
    """
    return TravelTimeConfig(path=config.replace(control_points=6, samples=64))


def time_edges(missions: list[Mission]) -> None:
    """Estimate the travel times of the edges that are left, from the forecast now.

    Where files forecast changing currents they are estimated once, for all departures of the mission.
    """
    for mission in missions:
        _time(mission)
        if mission.context.speeds is not None:
            offer_speeds(mission, _at_speeds(mission))
        if (timetable := mission.timed.timetable) is not None:
            mission.timed = replace(mission.timed, timetable=timetable.since(mission.now))


def _time(mission: Mission) -> None:
    """Estimate them at the vehicle's speed; times of departure count from the epoch."""
    context, planning = mission.context, mission.context.rules
    mission.timed, seconds = mission.graph, 0.0
    if context.by_clock:
        if mission.by_departure is None or context.area.forecast is None:
            mission.by_departure, seconds = _time_departures(mission)
        mission.timed = _with_times(mission, mission.graph, *mission.by_departure)
    elif planning.travel_times == "learnt":
        mission.timed = _as_learnt(mission)
    elif planning.travel_times == "sea":
        mission.sea.advance(mission.now)
        now = context.environment(mission.sea.forecast()), context.vehicle, mission.now
        timed, seconds = context.clock.time(
            lambda: mission.graph.with_travel_times(*now, effort(context.path_config), **_ways(mission))
        )
        mission.timed = _along_lines(mission, timed)
        if timed.timetable is not None:
            closed = np.where(timed.adjacency, mission.timed.travel_time, np.inf)
            mission.timed = _with_times(mission, mission.timed, np.zeros(1), closed[None])
    mission.timed = as_followed(mission, mission.timed)
    mission.run.estimate_seconds += seconds
    if seconds and planning.charge_compute:
        mission.charge(seconds)
    if mission.pace != 1.0 and (timetable := mission.timed.timetable) is not None:
        timetable = replace(timetable, travel_time=timetable.travel_time / mission.pace)
        mission.timed = replace(mission.timed, timetable=timetable)
    elif mission.pace != 1.0 and mission.timed.travel_time is not None:
        mission.timed = replace(mission.timed, travel_time=mission.timed.travel_time / mission.pace)
    mission.timed = charged(mission, mission.timed)
    if context.speeds is None:
        for (i, j), seconds in mission.learnt.items():
            mission.timed = mission.timed.with_travel_time(i, j, seconds)


def _at_speeds(mission: Mission) -> dict[float, Array]:
    """Return travel times at the vehicle's speed, and at the least and the greatest to choose from, s.

    The latter are estimated where a route is due; until then they change as those at the vehicle's speed do.
    """
    context, own = mission.context, travel_times(mission.timed, mission.context.speed)
    known = {context.speed: own}
    assert context.speeds is not None
    for speed in {context.speeds.item(0), context.speeds.item(-1)} - set(known):
        kept = mission.slow_and_fast.get(speed)
        if kept is None or mission.cause:
            there = replace(context, vehicle=replace(context.vehicle, speed=speed))
            other = mission.fork(context=there, by_departure=None if kept is None else kept.by_departure)
            _time(other)
            kept = AtSpeed(travel_times(other.timed, speed), own, other.by_departure)
            mission.slow_and_fast[speed] = kept
        alike = np.isfinite(own) & np.isfinite(kept.beside)
        changed = np.where(alike, own, 1.0) / np.where(alike, kept.beside, 1.0)
        known[speed] = kept.lasts * changed
    return known


def _as_learnt(mission: Mission) -> MissionGraph:
    """Return the graph with times d / |v| as much longer as the legs so far took than that."""
    graph, done, speed = mission.graph, mission.run.done, mission.context.speed
    straight = np.asarray(graph.leg_times(speed) - graph.duration)
    still = mission.run.graph.leg_times(speed) - mission.run.graph.duration
    expected = sum(float(still[leg.start, leg.goal]) for leg in done)
    share = sum(leg.t_path for leg in done) / expected if expected else 1.0
    return replace(graph, travel_time=np.where(np.isfinite(straight), share * straight, np.nan))


def _with_times(mission: Mission, graph: MissionGraph, departures: Array, travel_time: Array) -> MissionGraph:
    """Return a graph with times by departure, s since the epoch, and the windows that its tasks have."""
    windows = graph.timetable
    if windows is None:
        waiting = mission.context.scenario.mission.wait != "none"
        return graph.with_timetable(Timetable(departures, travel_time, waiting=waiting))
    return graph.with_timetable(replace(windows, departures=departures, travel_time=travel_time))


def _detour(mission: Mission) -> float:
    """Return s that an edge is taken to be longer for obstacles that are not known yet."""
    return mission.context.rules.detour * mission.context.surprises


def _time_departures(mission: Mission) -> tuple[ByDeparture, float]:
    """Time all edges at all departures; return the wall-clock seconds that took as well."""
    context = mission.context
    mission.sea.advance(mission.now)
    env = context.environment(mission.sea.forecast())
    until = mission.run.t_available
    if until <= mission.now:  # too late for all of them, but the rest is timed
        until = mission.now + _LATE
    departures = np.linspace(mission.now, until, context.rules.departures)
    at = env, context.vehicle, departures, effort(context.path_config)
    times, seconds = context.clock.time(
        lambda: mission.run.graph.times_at(*at, bends=_BENDS, **_ways(mission))
    )
    edges, along = line_times(mission, departures)
    for (i, j), lasts in zip(edges, along.T, strict=True):
        times[:, i, j] = lasts
    return ByDeparture(departures, times + _detour(mission)), seconds


def _along_lines(mission: Mission, timed: MissionGraph) -> MissionGraph:
    """Return a timed graph with detours and the times of survey lines; some may be closed or open."""
    detour = _detour(mission)
    times, open_ = np.array(timed.travel_time + detour), np.array(timed.adjacency)
    edges, along = line_times(mission, np.asarray([mission.now]))
    if not edges:
        return replace(timed, travel_time=times)
    for edge, lasts in zip(edges, along[0], strict=True):
        times[edge], open_[edge] = lasts + detour, np.isfinite(lasts)
    return replace(timed, travel_time=np.where(open_, times, np.nan), adjacency=open_)


def _ways(mission: Mission) -> dict[str, Any]:
    """Return what finds paths between jobs, and over a sea bed that hinders where passages are looked for."""
    context = mission.context
    return {
        "around": context.around.paths if mission.run.names else None,
        "sketch": partial(sketched, mission) if context.path_config.passages else None,
    }


@dataclass(frozen=True)
class _Attempt:
    """What a call of the mission planner may count on.

    Attributes:
        share: of reserve, allowance and return margin that it keeps.
        passing: "" or how visited waypoints may be passed on the way to the destination: as "few" of them as
            can be, or on the "quickest" way.
        untimed: whether edges that the estimate closed are tried: a path may be found yet.
        leaving: whether a survey line that should be surveyed whole may be left.
    """

    share: float
    passing: Literal["", "few", "quickest"] = ""
    untimed: bool = False
    leaving: bool = False


#: Slack is kept for the last legs, which no re-planning can mend; where nothing fits with it, it is halved
#: and in the end given up. Only where no way is left are survey lines left, or do visited waypoints or closed
#: edges serve.
_ATTEMPTS = (
    _Attempt(1.0),
    _Attempt(0.5),
    _Attempt(0.0),
    _Attempt(0.0, leaving=True),
    _Attempt(0.0, "few"),
    _Attempt(0.0, "quickest"),
    _Attempt(0.0, untimed=True),
    _Attempt(0.0, "few", untimed=True),
)


def plan_routes(missions: list[Mission]) -> None:
    """Plan the route for the missions that need one, from where each stands."""
    for attempt in _ATTEMPTS:
        groups: dict[tuple[MissionConfig, bool], list[Mission]] = {}
        for mission in missions:
            if mission.cause and not mission.ended and _prepare(mission, attempt):
                begun, context = mission.route is not None, mission.context
                config = context.route_configs[begun]
                # Places for neighbours come from its own graph alone.
                most = int(np.asarray(mission.run.graph.adjacency).sum(axis=1).max())
                config = config.replace(degree=max(config.degree, 1 << (most - 1).bit_length()))
                kept = begun and context.rules.routes_from == "kept"
                groups.setdefault((config, kept), []).append(mission)
        for (config, kept), group in groups.items():
            _plan_routes(group, config, kept, attempt.share)
    for mission in missions:
        if not mission.cause or mission.ended:
            continue
        rest = mission.rest
        if len(rest) > 1 and mission.graph.adjacency[rest[:-1], rest[1:]].all():
            mission.cause = ""  # it goes on as before
            continue
        refused = f"; refused before: {mission.obstruction}" if mission.obstruction else ""
        mission.end(f"no route from {mission.run.place(mission.here)}: {mission.no_route}{refused}")


def _prepare(mission: Mission, attempt: _Attempt) -> bool:
    """Open what an attempt opens; return whether it has anything to try that the last one had not."""
    planning = mission.context.rules
    if attempt.leaving and not _leave_line(mission):
        return False
    if attempt.passing and not _open_passages(mission, attempt.passing):
        return False
    if attempt.untimed:
        if np.array_equal(mission.timed.adjacency, mission.graph.adjacency):
            return False
        mission.timed = _untimed(mission)
    opens = attempt.leaving or attempt.passing or attempt.untimed
    return bool(
        opens or attempt.share == 1.0 or any((planning.reserve, mission.allowance, planning.return_margin))
    )


def _untimed(mission: Mission) -> MissionGraph:
    """Return the graph with the edges that the estimate closed, as long as they are in still water."""
    adjacency, timetable = mission.graph.adjacency, mission.timed.timetable
    if mission.timed.options is not None:
        return with_still_water(mission.timed, mission.graph)
    if timetable is None:
        return replace(mission.timed, adjacency=adjacency)
    still = mission.graph.still_times(mission.context.speed)
    known = np.isfinite(timetable.travel_time)
    filled = np.where(known, timetable.travel_time, still)
    return mission.graph.with_timetable(replace(timetable, travel_time=filled))


def _leave_line(mission: Mission) -> bool:
    """Open the ways off a survey line from where the vehicle is; return whether there are any."""
    if mission.context.scenario.mission.lines != "whole":
        return False
    shut = edges_off_lines(mission.run.jobs, np.asarray(mission.run.graph.adjacency))
    closed = mission.barred | {(mission.here, node) for node in mission.visited}
    ways = [(i, j) for i, j in shut if i == mission.here and (i, j) not in closed]
    mission.graph = mission.graph.with_edges(ways)
    if ways:
        time_edges([mission])
    return bool(ways)


def _open_passages(mission: Mission, passing: str) -> bool:
    """Open the way over visited waypoints to the destination, as passages without a task.

    Returns:
        Whether there is such a way, and it needs them.
    """
    if not mission.visited or mission.context.rules.visits != "once":
        return False
    run, revisited = mission.run, np.zeros(mission.graph.size, bool)
    revisited[list(mission.visited - {mission.here})] = True
    times = run.graph.without_edges(mission.barred).leg_times(mission.context.speed)
    times[:, mission.here] = np.inf
    if passing == "few":
        times = times + _PASSED * revisited
    way = shortest_path(times, mission.here, run.goal)
    if not any(revisited[node] for node in way):
        return False
    legs = list(pairwise(way))
    passages = [(i, j) for i, j in legs if revisited[j]]
    for _, node in passages:
        mission.graph = mission.graph.without_task_at(node)
    mission.graph = mission.graph.with_edges(passages, tasks=False)
    # The way from a passed waypoint on to a new one carries what it always did.
    onward = [(i, j) for i, j in legs if revisited[i] and not revisited[j]]
    mission.graph = mission.graph.with_edges(onward)
    time_edges([mission])
    return True


def _plan_routes(missions: list[Mission], config: MissionConfig, kept: bool, share: float) -> None:
    """One call of the mission planner that keeps a share of the slack, and what it found."""
    context = missions[0].context
    planning = context.rules
    reserve = share * planning.reserve
    longer = np.asarray([1.0 + share * mission.allowance for mission in missions])
    left = (np.asarray([mission.run.t_available - mission.now for mission in missions]) - reserve) / longer
    energy = None  # J that may be taken by the power models; as much as they take where there is no battery
    if context.speeds is not None and all(np.isfinite(mission.energy_left) for mission in missions):
        energy = np.asarray([max(one.energy_left, 0.0) / drawn(one) for one in missions]) / longer
        if share == 0.0:  # where no slack is kept any more, the way home is gone whatever is left
            homes = [way_home(one) if one.route is not None else 0.0 for one in missions]
            energy = np.maximum(energy, 1.02 * np.asarray(homes))
    populations = np.stack([mission.last_route.population for mission in missions]) if kept else None
    routes, seconds = context.clock.time(
        partial(
            plan_missions,
            MissionGraph.stack(mission.timed for mission in missions),
            np.asarray([mission.here for mission in missions]),
            np.asarray([mission.run.goal for mission in missions]),
            np.maximum(left, 1.0),
            speed=context.vehicle.speed,
            energy_available=energy,
            key=prng.stacked([prng.folded(mission.key, 0, len(mission.run.routes)) for mission in missions]),
            population=populations,
            config=config,
            return_margin=share * planning.return_margin,
            known_routes=[mission.rest or None for mission in missions],
        ),
    )
    for mission, route in zip(missions, routes, strict=True):
        mission.no_route = "" if route.feasible else route.reason
        if route.status is MissionStatus.OUT_OF_TIME and context.scenario.current.source != "vortices":
            # Files are read for the mission's time alone, and edges are timed at departures within it.
            mission.no_route += ", by the currents of that time"
        if route.feasible:
            _take(mission, route, seconds / len(missions))


def _take(mission: Mission, route: MissionRoute, seconds: float) -> None:
    """Follow a new route, and keep a record of it."""
    run, planning = mission.run, mission.context.rules
    nodes = [int(node) for node in route.nodes]
    run.first_route = run.first_route or route
    figures = float(route.time), float(route.priority), seconds
    legs, waits = ([float(seconds) for seconds in of] for of in (route.leg_times, route.waits))
    speeds, energies = list[float](), list[float]()
    if route.speeds is not None:
        mission.chosen = np.asarray(route.speeds.chosen)
        mission.timed = mission.timed.at_speeds(mission.chosen)
        energies = [float(joules) for joules in route.speeds.energies]
        speeds = [float(speed) for speed in route.speeds.legs] if len(route.speeds.options.speeds) > 1 else []
        mission.energy_slack = mission.energy_left - drawn(mission) * sum(energies)
    record = RouteRecord(mission.now, nodes, *figures, mission.cause, legs, waits, speeds, energies)
    run.routes.append(record)
    mission.route, mission.step, mission.cause = route, 0, ""
    mission.slack = run.t_available - planning.reserve - (mission.now + float(route.time))
    if planning.charge_compute:
        mission.charge(seconds)
