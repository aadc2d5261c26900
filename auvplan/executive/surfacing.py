"""Surfacing for a fix: whether before the next leg, what it takes, and how well a leg's end must be known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely

from auvplan.energy import energy_of_steps
from auvplan.energy.use import surfacing_steps
from auvplan.executive.context import Mission
from auvplan.mission import MissionGraph
from auvplan.mission.fixes import Order, surfacings
from auvplan.navigation import AT_SURFACE, Navigation
from auvplan.path.clearance import distance_to_land
from auvplan.path.risk import exposed
from auvplan.runtime.arrays import Array

#: Places on the straight line between two waypoints at which it is asked whether there is bottom lock.
_PROBES = 16

#: Times the error of a fix from which on one helps.
_HELPS = 1.2


def limits(mission: Mission, near_coast: bool = False) -> Array:
    """Return the standard deviation that the position may have on arrival at each waypoint, [N] m.

    Args:
        mission: whose waypoints they are.
        near_coast: whether those count, too, beyond which no path keeps off the coast near its goal.
    """
    context, graph = mission.context, mission.run.graph
    most = None if context.fixes is None else context.fixes.most
    found = np.full(graph.size, np.inf if most is None else most)
    if (jobs := context.area.jobs) is not None:
        errors = [job.max_error for job in jobs.points]
        errors += [line.max_error for line in jobs.lines for _ in line.positions]
        stated = np.array([np.inf if error is None else error for error in errors], float)
        found[1 : 1 + len(stated)] = np.minimum(found[1 : 1 + len(stated)], stated)
    chart, known = context.area.chart, context.navigation
    if near_coast and chart is not None and known is not None and float(np.asarray(known.confidence)):
        x, y, _ = np.asarray(graph.positions, np.float32).T
        room = np.asarray(distance_to_land(chart, x, y), float) - context.path_config.coast_margin
        found = np.minimum(found, np.maximum(room, 0.0) / float(np.asarray(known.confidence)))
    return found


def way_down(mission: Mission, node: int) -> tuple[float, float]:
    """Return s from a waypoint up to the surface, and from there down, at the vehicle's own speed."""
    own = replace(mission.context.vehicle, speed=mission.pace * mission.context.speed)
    return own.vertical_times(float(mission.run.graph.positions[node][2]))


def takes(mission: Mission, node: int) -> float:
    """Return s that surfacing at a waypoint takes: up, for a fix, and down again."""
    fixes = mission.context.fixes
    seconds = 60.0 if fixes is None or fixes.fix_time is None else fixes.fix_time
    return sum(way_down(mission, node)) + seconds


def allowed(mission: Mission, node: int) -> bool:
    """Return whether a vehicle may surface at a waypoint: in no area where that is forbidden, or closed."""
    area, (north, east, _) = mission.context.area, np.asarray(mission.run.graph.positions[node], float)
    zones = *area.no_surfacing, *area.zones
    return not any(shapely.intersects_xy(zone.polygon, north, east) for zone in zones)


def helps(mission: Mission) -> bool:
    """Return whether the vehicle may surface where it is, and would know better where that is."""
    known = mission.known
    if known is None or mission.at_surface or not allowed(mission, mission.here):
        return False
    return float(np.asarray(known.std)) > _HELPS * float(np.asarray(known.fixed().std))


def due(mission: Mission) -> bool:
    """Return whether the vehicle surfaces before its next leg, so that the rest of its route keeps limits."""
    rest, known = mission.rest, mission.known
    if known is None or len(rest) < 2 or not helps(mission):
        return False
    most = limits(mission, near_coast=True)[rest[1:]]
    return bool(np.isfinite(most).any()) and 0 in surfacings(known, _order(mission, rest, most)).at


def _order(mission: Mission, rest: list[int], most: Array) -> Order:
    """Return the rest of a route by the times that its legs are expected to take."""
    graph, fixes = mission.run.graph, mission.context.fixes
    risk = 0.0 if fixes is None or fixes.surfacing_price is None else fixes.surfacing_price
    places, edges = np.asarray(graph.positions, float), list(pairwise(rest))
    lasts = mission.timed.leg_times(mission.context.speed) - np.asarray(graph.duration)
    speeds = [mission.pace * (mission.chosen_speed(edge) or mission.context.speed) for edge in edges]
    still = np.linalg.norm(np.diff(places[rest], axis=0), axis=1) / speeds
    travel = [max(float(lasts[edge]), straight) for edge, straight in zip(edges, still, strict=True)]
    share = np.linspace(0.0, 1.0, _PROBES)[:, None]
    legs = [
        _drift(mission, seconds, (1.0 - share) * places[i] + share * places[j], speed)
        for (i, j), seconds, speed in zip(edges, travel, speeds, strict=True)
    ]
    stays = [(0.0, 0.0)]
    stays += [_drift(mission, float(graph.duration[i, j]), places[[j]]) for i, j in edges[:-1]]
    dives, price = [], []
    for node in rest[:-1]:
        surface = places[node, 2] <= AT_SURFACE
        dives.append(_drift(mission, 0.0 if surface else way_down(mission, node)[1], places[[node]]))
        price.append(0.0 if surface else takes(mission, node) + risk if allowed(mission, node) else np.inf)
    return Order(np.array(legs), np.array(stays), np.array(dives), np.array(price), most)


def _drift(
    mission: Mission, seconds: float, places: Array, speed: float | None = None
) -> tuple[float, float]:
    """Return m through the water and s out of bottom lock, of a time that is spent along places [n, 3] m.

    Through the water it makes a speed, m/s; that of the mission now if absent.
    """
    reach = None if mission.navigation is None else mission.navigation.bottom_lock
    bed, share = mission.context.area.seabed, 1.0
    if reach is not None and bed is not None:
        share = float((bed.altitude(places) > float(np.asarray(reach))).mean())
    return (mission.speed if speed is None else speed) * seconds, share * seconds


def charged(mission: Mission, graph: MissionGraph) -> MissionGraph:
    """Return a timed graph whose edges take longer by the share of a surfacing that they use up.

    An edge that takes as long as the error needs to grow to what its end allows, from a fix on and out of
    bottom lock, is charged with a whole one at its beginning, others with less: routes have time for about
    the fixes that they need, whose places are chosen once their order is known.
    """
    if (charges := _charges(mission)) is None:
        return graph
    reach, price = charges

    def longer(times: Array) -> Array:
        # Where there is no edge, times are infinite.
        return times + price[:, None] * np.minimum(np.where(times < np.inf, times, 0.0) / reach, 1.0)

    if (table := graph.timetable) is not None:
        return replace(graph, timetable=replace(table, travel_time=longer(np.asarray(table.travel_time))))
    own = graph.travel_time
    if own is None:
        own = graph.leg_times(mission.context.speed) - np.asarray(graph.duration)
    return replace(graph, travel_time=longer(np.asarray(own)))


def energy_charged(mission: Mission, travel: Array, drift: Array) -> Array | float:
    """Return J [N, N] that the surfacings charged on edges take beyond what going on for as long does.

    Args:
        mission: whose vehicle has power.
        travel: [N, N] s that edges take, as `charged` has them.
        drift: [N] m/s through the water where the vehicle stays at a waypoint.
    """
    power, speed = mission.context.power, mission.context.speed
    if power is None or (charges := _charges(mission)) is None:
        return 0.0
    reach, price = charges
    more = np.zeros(len(price))
    for node in np.flatnonzero(price).tolist():
        depth = float(mission.run.graph.positions[node][2])
        steps = surfacing_steps(depth, price[node], way_down(mission, node), speed, drift[node])
        spent = sum(part.sum() for part in energy_of_steps(power, *steps, np.zeros(3)).values())
        more[node] = spent - float(power.power(speed)) * price[node]
    share = np.minimum(np.where(np.isfinite(travel), travel, 0.0) / (reach + price[:, None]), 1.0)
    return more[:, None] * share


def _charges(mission: Mission) -> tuple[Array, Array] | None:
    """Return what surfacings are charged by; None where nothing asks for fixes.

    Returns:
        ``(reach [N] s, price [N] s)``: in what time the error grows to what the end of an edge allows, and
        what surfacing at its beginning takes.
    """
    known = mission.navigation
    if known is None or (most := limits(mission, near_coast=True)).min() == np.inf:
        return None
    fix, drift, current = (float(np.asarray(part)) for part in (known.fix, known.drift, known.current_error))
    growth = max(np.hypot(drift * mission.context.speed, current), 1e-12)
    reach = np.maximum(np.sqrt(np.maximum(most**2 - fix**2, 0.0)) / growth, 1e-3)
    places = np.asarray(mission.run.graph.positions)[:, 2]
    price = np.array([
        takes(mission, node) if depth > AT_SURFACE and allowed(mission, node) else 0.0
        for node, depth in enumerate(places)
    ])  # fmt: skip
    return reach, price


def surface(mission: Mission) -> float:
    """Let the vehicle surface where it is; return s that it takes."""
    seconds = takes(mission, mission.here)
    mission.now += seconds
    mission.navigate(after_fix(mission))
    return seconds


def after_fix(mission: Mission) -> Navigation | None:
    """Return how well a vehicle knows where it is when it leaves the waypoint reached, of a fix there."""
    down = way_down(mission, mission.here)[1]
    place = np.asarray(mission.run.graph.positions[[mission.here]], float)
    return mission.navigation and mission.navigation.since(*_drift(mission, down, place))


def lost(mission: Mission) -> str:
    """Return why the end of a leg's path is not known well enough, or an empty string."""
    leg = mission.active_leg
    met = None if leg.stays or mission.navigation is None else exposed(leg.followed)
    most = float(limits(mission)[leg.record.goal]) if met is not None else np.inf
    if met is None or met.std[-1] <= most:
        return ""
    return f"its end would be known to {met.std[-1]:.0f} m (1 sigma) only, {most:g} m are asked for"
