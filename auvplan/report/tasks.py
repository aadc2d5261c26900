"""The tasks of a run: those that were done, and those that were left with what stood against them."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import shortest_path

from auvplan.export.sheet import waypoint_name
from auvplan.records import MissionRun
from auvplan.words import hours


def task_data(run: MissionRun, stated: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the tasks that were done, in order, and then those that were left.

    Args:
        run: as executed, or a plan.
        stated: the run's mission sheet as plain data.
    """
    done = [
        {"name": stop["task"], "priority": stop["priority"], "done": True, "at": stop["arrival"],
         "duration": stop["hold"], "why": ""}
        for stop in stated.get("stops", [])
        if stop["task"]
    ]  # fmt: skip
    left = [
        {"name": job["name"], "priority": job["priority"], "done": False, "at": None, "duration": None,
         "why": job["reason"]}
        for job in stated.get("left_out", [])
    ]  # fmt: skip
    return [*done, *(left if run.names else _unvisited(run))]


def _unvisited(run: MissionRun) -> list[dict[str, Any]]:
    """Waypoints that were never visited, with the shortest detour to each at the vehicle's speed.

    Tasks of waypoints without names lie on the edges between them: stated is the highest priority of an edge
    that leads there.
    """
    route, priority = run.route, np.asarray(run.graph.priority, float)
    times = np.asarray(run.graph.leg_times(float(run.vehicle.speed)))  # type: ignore[arg-type]
    travel = times - np.asarray(run.graph.duration)
    edges = np.nonzero(np.isfinite(travel))
    ways = shortest_path(csr_array((travel[edges], edges), shape=travel.shape))
    rows = []
    for node in sorted(set(range(len(travel))) - set(route)):
        detours = [ways[i, node] + ways[node, j] - travel[i, j] for i, j in pairwise(route)]
        rows.append(
            {
                "name": waypoint_name(run, node),
                "priority": float(priority[:, node].max()),
                "done": False,
                "at": None,
                "duration": None,
                "why": _why_unvisited(run, float(min(detours, default=np.inf))),
            }
        )
    return sorted(rows, key=lambda row: -row["priority"])


def _why_unvisited(run: MissionRun, extra: float) -> str:
    if not run.arrived:
        return "the mission ended before"
    if not np.isfinite(extra):
        return "no way leads there"
    if extra > run.t_residual:
        return f"the detour takes about {hours(extra)} in still water, {hours(run.t_residual)} were left"
    return (
        f"the detour takes about {hours(extra)} in still water: current, reserve and the worth of the tasks "
        "passed over stood against it"
    )
