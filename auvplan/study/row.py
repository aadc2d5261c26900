"""One mission as a row of figures: arrays by name, of the lengths that the mission has."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.check.run import CheckReport, check_dataset
from auvplan.io.results import PLAN_CAUSES, ROUTE_CAUSES, to_dataset
from auvplan.records import MissionRun

Row = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Variable:
    """A variable of a study's dataset.

    Attributes:
        dims: after those of the missions.
        long_name: what it is.
        units: or None for indices and flags.
        fill: what pads it.
        clock: whether it is wall-clock time, which no second run repeats.
        meanings: of flags from 1; 0 is none. Yes and no are ("yes",).
    """

    dims: tuple[str, ...]
    long_name: str
    units: str | None = None
    fill: Any = np.nan
    clock: bool = False
    meanings: tuple[str, ...] = ()


_EACH, _LEG, _PLAN, _ROUTE = (), ("leg",), ("plan",), ("route",)

#: Every variable of a row, in the order in which a dataset shows them.
VARIABLES = {
    "t_available": Variable(_EACH, "available time", "s"),
    "t_mission": Variable(_EACH, "time of the mission", "s"),
    "t_residual": Variable(_EACH, "time left at the end", "s"),
    "success": Variable(_EACH, "destination reached with time left", fill=-1, meanings=("yes",)),
    "reason": Variable(_EACH, "how the mission ended", fill=""),
    "tasks": Variable(_EACH, "tasks done", "1", -1),
    "total_priority": Variable(_EACH, "total priority of the tasks done", "1"),
    "priority_bound": Variable(_EACH, "bound on the total priority of the mission", "1"),
    "revisits": Variable(_EACH, "waypoints visited again", "1", -1),
    "path_calls": Variable(_EACH, "legs planned", "1", -1),
    "path_replans": Variable(_EACH, "paths planned anew on the way", "1", -1),
    "mission_replans": Variable(_EACH, "routes planned anew", "1", -1),
    "cost_mission": Variable(_EACH, "cost of the mission as done (Eq. 15)", "1"),
    "cost_total": Variable(_EACH, "the same with the computing time of re-plans (Eq. 16)", "1", clock=True),
    "collisions": Variable(_EACH, "collisions found by the independent checker", "1", -1),
    "faults": Variable(_EACH, "faults found by the independent checker", "1", -1),
    "coast_clearance": Variable(_EACH, "least distance to the coast; infinite without one", "m"),
    "obstacle_clearance": Variable(_EACH, "least distance to an obstacle; infinite without one", "m"),
    "seabed_altitude": Variable(_EACH, "least altitude above the sea bed; infinite without one", "m"),
    "length": Variable(_EACH, "length travelled", "m"),
    "path_cpu": Variable(_EACH, "wall-clock time of all path planning calls", "s", clock=True),
    "mission_cpu": Variable(_EACH, "wall-clock time of all mission planning calls", "s", clock=True),
    "mission_replan_cpu": Variable(
        _EACH, "wall-clock time of mission re-planning, sum of T_compute", "s", clock=True
    ),
    "travel_time_cpu": Variable(_EACH, "wall-clock time of all estimates of travel times", "s", clock=True),
    "leg_from": Variable(_LEG, "waypoint left", fill=-1),
    "leg_to": Variable(_LEG, "waypoint headed for", fill=-1),
    "leg_t_expected": Variable(_LEG, "t_ij, expected time, the task included", "s"),
    "leg_t_path": Variable(_LEG, "T_path, travel time, executed", "s"),
    "leg_t_task": Variable(_LEG, "time of the task", "s"),
    "leg_priority": Variable(_LEG, "priority of the task, 0 without one", "1"),
    "leg_revisit": Variable(
        _LEG, "whether the waypoint headed for had been visited before; -1 pads", fill=-1, meanings=("yes",)
    ),
    "leg_arrived": Variable(_LEG, "whether the waypoint was reached; -1 pads", fill=-1, meanings=("yes",)),
    "leg_path_replans": Variable(_LEG, "paths planned anew on the way", "1", -1),
    "leg_distance": Variable(_LEG, "straight line between the waypoints", "m"),
    "leg_cpu": Variable(_LEG, "wall-clock time of the leg's path planning calls", "s", clock=True),
    "plan_leg": Variable(_PLAN, "index of the leg; -1 pads", fill=-1),
    "plan_cause": Variable(_PLAN, "why the path was planned", fill=0, meanings=PLAN_CAUSES),
    "plan_cost": Variable(_PLAN, "cost of the path (Eq. 12), its fitness", "s"),
    "plan_cpu": Variable(_PLAN, "wall-clock time of the call", "s", clock=True),
    "route_made_at": Variable(_ROUTE, "mission time when the route was made", "s"),
    "route_time": Variable(_ROUTE, "time that it was expected to take", "s"),
    "route_priority": Variable(_ROUTE, "total priority of its tasks", "1"),
    "route_cause": Variable(_ROUTE, "why the route was planned", fill=0, meanings=ROUTE_CAUSES),
    "route_cpu": Variable(_ROUTE, "wall-clock time of the call", "s", clock=True),
    "route_nodes": Variable(("route", "stop"), "waypoints in order of visit; -1 pads", fill=-1),
    "waypoint_position": Variable(("waypoint", "axis"), "place of the waypoint: north, east, down", "m"),
}


def row_of(run: MissionRun) -> Row:
    """Return the figures of a mission that was executed, by the names of `VARIABLES`.

    The checker walks it first.
    """
    summary = run.summary()
    report = check_dataset(summary, to_dataset(run))
    return _mission(run, summary, report) | _legs(run) | _plans(run) | _routes(run)


def _mission(run: MissionRun, summary: dict[str, Any], report: CheckReport) -> Row:
    names = (
        *("t_available", "t_mission", "t_residual", "total_priority", "priority_bound"),
        *("cost_mission", "cost_total"),
    )
    counts = ("success", "tasks", "revisits", "path_calls", "path_replans", "mission_replans")
    cpu = summary["cpu"]
    return (
        {name: np.asarray(summary[name], float) for name in names}
        | {name: np.asarray(summary[name], np.int32) for name in counts}
        | {
            "reason": np.asarray(summary["reason"]),
            "collisions": np.asarray(report.collisions, np.int32),
            "faults": np.asarray(len(report.faults), np.int32),
            "coast_clearance": np.asarray(report.coast_clearance, float),
            "obstacle_clearance": np.asarray(report.obstacle_clearance, float),
            "seabed_altitude": np.asarray(report.seabed_altitude, float),
            "length": np.asarray(report.length, float),
            "path_cpu": np.asarray(cpu["path_s"], float),
            "mission_cpu": np.asarray(cpu["mission_s"], float),
            "mission_replan_cpu": np.asarray(cpu["mission_replans_s"], float),
            "travel_time_cpu": np.asarray(cpu["travel_times_s"], float),
            "waypoint_position": np.asarray(run.graph.positions, float),
        }
    )


def _legs(run: MissionRun) -> Row:
    legs, places = run.legs, np.asarray(run.graph.positions, float)
    ends = np.asarray([(leg.start, leg.goal) for leg in legs], np.int32).reshape(-1, 2)
    return {
        "leg_from": ends[:, 0],
        "leg_to": ends[:, 1],
        "leg_t_expected": np.asarray([leg.t_expected for leg in legs], float),
        "leg_t_path": np.asarray([leg.t_path for leg in legs], float),
        "leg_t_task": np.asarray([leg.t_task for leg in legs], float),
        "leg_priority": np.asarray([leg.priority for leg in legs], float),
        "leg_revisit": np.asarray([leg.revisit for leg in legs], np.int32),
        "leg_arrived": np.asarray([leg.arrived for leg in legs], np.int32),
        "leg_path_replans": np.asarray([leg.path_replans for leg in legs], np.int32),
        "leg_distance": np.linalg.norm(places[ends[:, 1]] - places[ends[:, 0]], axis=1),
        "leg_cpu": np.asarray([leg.cpu for leg in legs], float),
    }


def _plans(run: MissionRun) -> Row:
    plans = [(number, plan) for number, leg in enumerate(run.legs) for plan in leg.plans]
    return {
        "plan_leg": np.asarray([number for number, _ in plans], np.int32),
        "plan_cause": np.asarray([PLAN_CAUSES.index(plan.cause) + 1 for _, plan in plans], np.int32),
        "plan_cost": np.asarray([plan.cost for _, plan in plans], float),
        "plan_cpu": np.asarray([plan.cpu for _, plan in plans], float),
    }


def _routes(run: MissionRun) -> Row:
    routes = run.routes
    nodes = np.full((len(routes), max((len(route.nodes) for route in routes), default=0)), -1, np.int32)
    for row, route in zip(nodes, routes, strict=True):
        row[: len(route.nodes)] = route.nodes
    return {
        "route_made_at": np.asarray([route.made_at for route in routes], float),
        "route_time": np.asarray([route.time for route in routes], float),
        "route_priority": np.asarray([route.priority for route in routes], float),
        "route_cause": np.asarray([ROUTE_CAUSES.index(route.cause) + 1 for route in routes], np.int32),
        "route_cpu": np.asarray([route.cpu for route in routes], float),
        "route_nodes": nodes,
    }
