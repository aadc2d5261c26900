"""Batched calls of the mission planner: travel times in the forecast current, then routes."""

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Literal

import numpy as np

from auvplan.executive.context import Mission, SimulationContext
from auvplan.executive.lines import as_followed, line_times
from auvplan.executive.path_calls import sketched
from auvplan.mission import MissionConfig, MissionGraph, MissionRoute, plan_missions
from auvplan.mission.graph import shortest_way
from auvplan.mission.jobs import ways_off_lines
from auvplan.mission.timetable import Array, Timetable
from auvplan.mission.travel_times import Sketch, TravelTimeConfig
from auvplan.path import PathConfig
from auvplan.records import RouteRecord
from auvplan.runtime import prng

#: Departures of a mission at which edges are bent to the current.
_BENDS = 5

#: s added for each visited waypoint on a way, so that the way passes as few of them as can be.
_PASSED = 1e7


def effort(config: PathConfig) -> TravelTimeConfig:
    """Return the estimate's settings that go with a path planner's.

    Its limits and margins, on fewer samples.
    """
    return TravelTimeConfig(path=config.replace(control_points=6, samples=64))


def time_edges(context: SimulationContext, missions: list[Mission]) -> None:
    """Estimate the travel times of the edges that are left, from the forecast now.

    Where files forecast changing currents they are estimated once, for all departures of the mission.
    """
    planning = context.rules
    detour = planning.detour * context.surprises
    for mission in missions:
        mission.timed, seconds = mission.graph, 0.0
        if context.by_clock:
            if mission.travel_time is None or context.area.forecast is None:
                seconds = _time_departures(context, mission, detour)
            assert mission.departures is not None
            assert mission.travel_time is not None
            mission.timed = _with_times(context, mission.graph, mission.departures, mission.travel_time)
        elif planning.travel_times == "learnt":
            mission.timed = _as_learnt(mission, context.speed)
        elif planning.travel_times == "sea":
            mission.sea.advance(mission.now)
            timed, seconds = _timed(context, mission)
            mission.timed = _along_lines(
                context, mission, replace(timed, travel_time=timed.travel_time + detour), detour
            )
            if timed.timetable is not None:
                closed = np.where(timed.adjacency, mission.timed.travel_time, np.inf)
                mission.timed = _with_times(context, mission.timed, np.zeros(1), closed[None])
        mission.timed = as_followed(context, mission, mission.timed)
        mission.run.estimate_seconds += seconds
        if seconds and planning.charge_compute:
            mission.charge(seconds)
        if mission.pace != 1.0:
            mission.timed = _slower(mission.timed, mission.pace)
        for (i, j), seconds in mission.learnt.items():
            mission.timed = mission.timed.with_travel_time(i, j, seconds)
        if (timetable := mission.timed.timetable) is not None:
            mission.timed = replace(mission.timed, timetable=timetable.since(mission.now))


def _as_learnt(mission: Mission, speed: float) -> MissionGraph:
    """Return the graph with times d / |v| as much longer as the legs so far took than that."""
    graph, done = mission.graph, mission.run.done
    straight = np.asarray(graph.leg_times(speed) - graph.duration)
    still = mission.run.graph.leg_times(speed) - mission.run.graph.duration
    expected = sum(float(still[leg.start, leg.goal]) for leg in done)
    share = sum(leg.t_path for leg in done) / expected if expected else 1.0
    return replace(graph, travel_time=np.where(np.isfinite(straight), share * straight, np.nan))


def _slower(graph: MissionGraph, pace: float) -> MissionGraph:
    """Return a graph with the travel times of a vehicle that makes a share of its speed."""
    if graph.timetable is not None:
        timetable = replace(graph.timetable, travel_time=graph.timetable.travel_time / pace)
        return replace(graph, timetable=timetable)
    return graph if graph.travel_time is None else replace(graph, travel_time=graph.travel_time / pace)


def _with_times(
    context: SimulationContext, graph: MissionGraph, departures: Array, travel_time: Array
) -> MissionGraph:
    """Return a graph with times by departure, s since the epoch, and the windows that its tasks have."""
    windows = graph.timetable
    if windows is None:
        waiting = context.scenario.mission.wait != "none"
        return graph.with_timetable(Timetable(departures, travel_time, waiting=waiting))
    return graph.with_timetable(replace(windows, departures=departures, travel_time=travel_time))


def _time_departures(context: SimulationContext, mission: Mission, detour: float) -> float:
    """Time all edges at all departures, longer by a detour; return the wall-clock seconds that took."""
    mission.sea.advance(mission.now)
    env = context.environment(mission.sea.forecast())
    departures = np.linspace(mission.now, mission.run.t_available, context.rules.departures)
    times, seconds = context.clock.time(
        lambda: mission.run.graph.times_at(
            env,
            context.vehicle,
            departures,
            effort(context.path_config),
            bends=_BENDS,
            around=context.around.paths if mission.run.names else None,
            sketch=_sketch(context, mission),
        )
    )
    edges, along = line_times(context, mission, departures)
    for (i, j), lasts in zip(edges, along.T, strict=True):
        times[:, i, j] = lasts
    mission.departures, mission.travel_time = departures, times + detour
    return seconds


def _along_lines(
    context: SimulationContext, mission: Mission, timed: MissionGraph, detour: float
) -> MissionGraph:
    """Return a timed graph with the times of survey lines, longer by a detour; some may be closed or open."""
    edges, along = line_times(context, mission, np.asarray([mission.now]))
    if not edges:
        return timed
    times, open_ = np.array(timed.travel_time), np.array(timed.adjacency)
    for edge, lasts in zip(edges, along[0], strict=True):
        times[edge], open_[edge] = lasts + detour, np.isfinite(lasts)
    return replace(timed, travel_time=np.where(open_, times, np.nan), adjacency=open_)


def _sketch(context: SimulationContext, mission: Mission) -> Sketch | None:
    """Return what finds paths over a sea bed that hinders; None where the planner looks for no passages."""
    return partial(sketched, context, mission) if context.path_config.passages else None


def _timed(context: SimulationContext, mission: Mission) -> tuple[MissionGraph, float]:
    """Return the timed graph and the wall-clock seconds that took, free of compilation."""
    env = context.environment(mission.sea.forecast())
    config = effort(context.path_config)
    around = context.around.paths if mission.run.names else None
    return context.clock.time(
        lambda: mission.graph.with_travel_times(
            env, context.vehicle, mission.now, config, around=around, sketch=_sketch(context, mission)
        )
    )


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


def plan_routes(context: SimulationContext, missions: list[Mission]) -> None:
    """Plan the route for the missions that need one, from where each stands."""
    planning = context.rules
    plain = planning.reserve == planning.allowance == planning.return_margin == 0.0
    for attempt in _ATTEMPTS:
        due = [mission for mission in missions if mission.cause and not mission.ended]
        if attempt.leaving:
            due = [mission for mission in due if _leave_line(context, mission)]
        elif attempt.passing:
            due = [mission for mission in due if _open_passages(context, mission, attempt.passing)]
        elif attempt.share < 1.0 and plain and not attempt.untimed:
            continue  # there is no slack to give up
        if attempt.untimed:
            due = [mission for mission in due if not _all_timed(mission)]
            for mission in due:
                mission.timed = _untimed(context, mission)
        groups: dict[tuple[MissionConfig, bool], list[Mission]] = {}
        for mission in due:
            groups.setdefault((_config(context, mission), _keeps(context, mission)), []).append(mission)
        for (config, kept), group in groups.items():
            _plan_routes(context, group, config, kept, attempt.share)
    for mission in missions:
        if mission.cause and not mission.ended:
            _go_on(mission)


def _untimed(context: SimulationContext, mission: Mission) -> MissionGraph:
    """Return the graph with the edges that the estimate closed, as long as they are in still water."""
    adjacency, timetable = mission.graph.adjacency, mission.timed.timetable
    if timetable is None:
        return replace(mission.timed, adjacency=adjacency)
    still = replace(mission.graph, travel_time=None, duration=0.0 * mission.graph.duration)
    filled = np.where(
        np.isfinite(timetable.travel_time), timetable.travel_time, still.leg_times(context.speed)
    )
    return mission.graph.with_timetable(replace(timetable, travel_time=filled))


def _all_timed(mission: Mission) -> bool:
    """Return whether the estimate closed no edge."""
    return bool(np.array_equal(mission.timed.adjacency, mission.graph.adjacency))


def _keeps(context: SimulationContext, mission: Mission) -> bool:
    """Return whether the population of the last route is planned from."""
    return mission.route is not None and context.rules.routes_from == "kept"


def _leave_line(context: SimulationContext, mission: Mission) -> bool:
    """Open the ways off a survey line from where the vehicle is; return whether there are any."""
    if context.scenario.mission.lines != "whole":
        return False
    shut = ways_off_lines(mission.run.names, np.asarray(mission.run.graph.adjacency))
    closed = mission.barred | {(mission.here, node) for node in mission.visited}
    ways = [(i, j) for i, j in shut if i == mission.here and (i, j) not in closed]
    mission.graph = mission.graph.with_edges(ways)
    if ways:
        time_edges(context, [mission])
    return bool(ways)


def _open_passages(context: SimulationContext, mission: Mission, passing: str) -> bool:
    """Open the way over visited waypoints to the destination, as passages without a task.

    Returns:
        Whether there is such a way, and it needs them.
    """
    if not mission.visited or context.rules.visits != "once":
        return False
    run, revisited = mission.run, np.zeros(mission.graph.size, bool)
    revisited[list(mission.visited - {mission.here})] = True
    times = run.graph.without_edges(mission.barred).leg_times(context.speed)
    times[:, mission.here] = np.inf
    if passing == "few":
        times = times + _PASSED * revisited
    way = shortest_way(times, mission.here, run.goal)
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
    time_edges(context, [mission])
    return True


def _config(context: SimulationContext, mission: Mission) -> MissionConfig:
    """Settings for the mission's next route; places for neighbours come from its own graph alone."""
    first, later = context.route_configs
    most = int(np.asarray(mission.run.graph.adjacency).sum(axis=1).max())
    config = first if mission.route is None else later
    return config.replace(degree=max(config.degree, 1 << (most - 1).bit_length()))


def _plan_routes(
    context: SimulationContext, missions: list[Mission], config: MissionConfig, kept: bool, share: float
) -> None:
    """One call of the mission planner that keeps a share of the slack, and what it found."""
    planning = context.rules
    reserve, longer = share * planning.reserve, 1.0 + share * planning.allowance
    left = [(mission.run.t_available - mission.now - reserve) / longer for mission in missions]
    populations = np.stack([mission.last_route.population for mission in missions]) if kept else None
    routes, seconds = context.clock.time(
        partial(
            plan_missions,
            MissionGraph.stack(mission.timed for mission in missions),
            np.asarray([mission.here for mission in missions]),
            np.asarray([mission.run.goal for mission in missions]),
            np.maximum(left, 1.0),
            speed=context.vehicle.speed,
            key=prng.stacked([mission.route_key() for mission in missions]),
            population=populations,
            config=config,
            return_margin=share * planning.return_margin,
            known_routes=[mission.rest or None for mission in missions],
        ),
    )
    for mission, route in zip(missions, routes, strict=True):
        _take(context, mission, route, seconds / len(missions))


def _take(context: SimulationContext, mission: Mission, route: MissionRoute, seconds: float) -> None:
    """Book a new route, or why there is none."""
    run, planning = mission.run, context.rules
    mission.no_route = "" if route.feasible else route.reason
    if not route.feasible:
        return
    nodes = [int(node) for node in route.nodes]
    run.first_route = run.first_route or route
    figures = float(route.time), float(route.priority), seconds
    legs, waits = ([float(seconds) for seconds in of] for of in (route.leg_times, route.waits))
    run.routes.append(RouteRecord(mission.now, nodes, *figures, mission.cause, legs, waits))
    mission.route, mission.step, mission.cause = route, 0, ""
    mission.slack = run.t_available - planning.reserve - (mission.now + float(route.time))
    if planning.charge_compute:
        mission.charge(seconds)


def _go_on(mission: Mission) -> None:
    """Follow the rest of the last route where no new one was found, or end the mission."""
    rest = mission.rest
    if len(rest) > 1 and mission.graph.adjacency[rest[:-1], rest[1:]].all():
        mission.cause = ""
        return
    refused = f"; refused before: {mission.obstruction}" if mission.obstruction else ""
    here = mission.run.called(mission.here) if mission.run.names else f"waypoint {mission.here}"
    mission.end(f"no route from {here}: {mission.no_route}{refused}")
