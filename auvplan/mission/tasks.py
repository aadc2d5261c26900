"""Graphs from lists of edges and tasks: several tasks on an edge, tasks at waypoints, one-way edges."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from auvplan.mission.graph import MissionGraph


def task_graph(
    positions: Any,
    edges: Iterable[tuple[int, int]],
    edge_tasks: Iterable[tuple[int, int, float, float]] = (),
    waypoint_tasks: Iterable[tuple[int, float, float]] = (),
    directed: bool = False,
) -> MissionGraph:
    """Build a graph from its edges and the tasks on them.

    Tasks on one edge add up, in priority and in duration: whoever takes the edge does them all. A task at a
    waypoint is put on every edge that leads into it and is done once, on the first arrival: within a route
    because no waypoint is visited twice, over a mission because `MissionGraph.without_task_at` takes it off
    those edges. The task of the waypoint from which a mission starts is never done.

    Args:
        positions: [N, 3] m.
        edges: pairs (i, j), either way unless `directed`. An edge without a task is a mere passage.
        edge_tasks: (i, j, priority, duration s), as many to an edge as there are, in either direction unless
            `directed`.
        waypoint_tasks: (j, priority, duration s), as many to a waypoint as there are.
        directed: whether (i, j) is an edge, and its task one, from i to j only.

    Raises:
        ValueError: an index is out of range, or a task lies on an edge that does not exist.

    Example:
        >>> import numpy as np
        >>> graph = task_graph(np.zeros((3, 3)), [(0, 1), (1, 2)], [(0, 1, 2.0, 60.0), (0, 1, 1.0, 30.0)])
        >>> float(graph.priority[0, 1]), float(graph.duration[1, 0]), float(graph.priority[1, 2])
        (3.0, 90.0, 0.0)
    """
    size = len(positions)
    adjacency = np.zeros((size, size), bool)
    priority, duration = np.zeros((2, size, size))
    at_waypoint, stay = np.zeros((2, size))
    for i, j in edges:
        if not (0 <= i < size and 0 <= j < size) or i == j:
            raise ValueError(f"edge ({i}, {j}) must join two of the {size} waypoints")
        adjacency[i, j] = True
        adjacency[j, i] |= not directed
    for i, j, rho, seconds in edge_tasks:
        if not (0 <= i < size and 0 <= j < size and adjacency[i, j]):
            raise ValueError(f"a task lies on ({i}, {j}), which is not an edge")
        for leg in {(i, j)} if directed else {(i, j), (j, i)}:
            priority[leg] += rho
            duration[leg] += seconds
    for j, rho, seconds in waypoint_tasks:
        if not 0 <= j < size:
            raise ValueError(f"a task lies at waypoint {j}, which is not one of the {size}")
        at_waypoint[j] += rho
        stay[j] += seconds
    priority += np.where(adjacency, at_waypoint, 0.0)
    duration += np.where(adjacency, stay, 0.0)
    return MissionGraph(
        positions, adjacency, priority, duration, waypoint_priority=at_waypoint, waypoint_duration=stay
    )
