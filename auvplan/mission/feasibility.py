"""The five rules of a valid mission (section 3.3), in plain NumPy and independent of the decoder."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from auvplan.mission.graph import MissionGraph


@dataclass(frozen=True)
class RouteCheck:
    """Verdict on a sequence of waypoints, a bool for each rule of section 3.3.

    Attributes:
        ends: it begins at the start and ends at the destination.
        edges_exist: it takes only edges of the graph.
        nodes_once: it visits no waypoint twice.
        edges_once: it takes no edge twice.
        in_time: its total time is strictly below the time available.
        time: s, total time of travel and tasks.
        reasons: one line for each broken rule.
    """

    ends: bool
    edges_exist: bool
    nodes_once: bool
    edges_once: bool
    in_time: bool
    time: float
    reasons: tuple[str, ...]

    @property
    def valid(self) -> bool:
        """Whether all rules are kept."""
        return not self.reasons

    def __bool__(self) -> bool:
        return self.valid


def check_route(
    graph: MissionGraph,
    nodes: Sequence[int] | np.ndarray,
    start: int,
    goal: int,
    time_available: float,
    speed: float,
) -> RouteCheck:
    """Check a sequence of waypoints against the five rules of section 3.3.

    Args:
        graph: one graph of N waypoints.
        nodes: indices in the order of visit.
        start, goal: where it must begin and end.
        time_available: T_available, s.
        speed: |v|, m/s.

    Where the graph has a timetable, legs take the time that they do by the clock, waiting included; one that
    is never open, or whose task's windows are missed, takes infinitely long.

    An edge taken both ways counts as taken twice where the graph is undirected (all fields symmetric).
    """
    route = [int(node) for node in nodes]
    known = all(0 <= node < graph.size for node in route)
    legs = list(pairwise(route))
    inside = [leg for leg in legs if all(0 <= node < graph.size for node in leg)]
    missing = [leg for leg in legs if leg not in inside or leg[0] == leg[1] or not graph.adjacency[leg]]
    fields = graph.adjacency, graph.priority, graph.duration
    symmetric = all(np.array_equal(field, field.T) for field in fields)
    edges = [tuple(sorted(leg)) if symmetric else leg for leg in legs]
    time = 0.0
    for i, j in inside:  # whether or not the edge exists, so that each rule is judged by itself
        straight = float(np.linalg.norm(graph.positions[j] - graph.positions[i])) / speed
        travel = float(graph.travel_time[i, j])
        time += (straight if np.isnan(travel) else travel) + float(graph.duration[i, j])
    if graph.timetable is not None and not missing and known and inside:
        time = float(graph.itinerary(route, speed).ends[-1])

    ends = bool(route) and route[0] == start and route[-1] == goal
    brief = f"it leads from {route[0]} to {route[-1]}" if route else "it is empty"
    verdicts = {
        "ends": (ends, f"does not lead from {start} to {goal}: {brief}"),
        "edges_exist": (not missing and known, f"takes edges that are not in the graph: {missing or route}"),
        "nodes_once": (len(set(route)) == len(route), f"visits waypoints twice: {_repeated(route)}"),
        "edges_once": (len(set(edges)) == len(edges), f"takes edges twice: {_repeated(edges)}"),
        "in_time": (time < time_available, f"takes {time:.1f} s, {time_available:.1f} s are available"),
    }
    reasons = tuple(reason for kept, reason in verdicts.values() if not kept)
    return RouteCheck(**{rule: kept for rule, (kept, _) in verdicts.items()}, time=time, reasons=reasons)


def _repeated(items: list) -> list:
    return sorted({item for item in items if items.count(item) > 1})
