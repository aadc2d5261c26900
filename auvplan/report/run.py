"""The page of one mission, one plan or one leg: what its scripts show."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.mission.graph import shortest_times
from auvplan.records import LegRecord, MissionRun, PlanRecord
from auvplan.report.area import current_data, map_data, section_data
from auvplan.report.page import packed
from auvplan.runtime.arrays import Array
from auvplan.runtime.formatting import hours
from auvplan.scenario.provenance import changed_settings
from auvplan.view import scene
from auvplan.view.margins import Margins
from auvplan.view.sheet import leg_depths, sheet_of
from auvplan.view.timeline import Bar, closed_areas, doings, executed_bars, lateness, planned_bars

#: Records of the track in a page at most; of longer ones some are left out.
_RECORDS = 20_000
#: Records of a leg from one that holds where the obstacles were to the next.
_EVERY = 5
#: Figures of the summary that the page's head and its costs show.
_FIGURES = (
    *("t_available", "t_mission", "t_residual", "tasks", "total_priority", "priority_bound"),
    *("path_calls", "path_replans", "mission_replans", "cost_mission", "cost_total", "collisions"),
    *("cpu", "forecast"),
)


def run_data(run: MissionRun, summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page of a run shows, of its summary as it is saved; a "sheet" is made if absent."""
    stated = summary.get("sheet") or sheet_of(run).plain()
    records = _Records.of(run)
    legs = [_leg(run, leg, records, part) for leg, part in zip(run.legs, records.parts, strict=True)]
    planned = [scene.as_filed(plan.positions) for leg in run.legs for plan in leg.plans]
    points = np.concatenate([np.asarray(run.graph.positions, float), records.places, *planned])
    low, high = scene.window(points, 0.07, run.chart, slender=0.55, least=200.0)
    least, safety = records.margins.least(), run.safety
    margins = {"coast": safety.coast, "closed": safety.coast, "obstacle": safety.obstacles}
    margins["bed"] = safety.seabed
    begin = float(min((route.made_at for route in run.routes), default=0.0))
    begin = float(records.times[0]) if len(records.times) else begin
    return {
        "kind": "leg" if len(run.graph.positions) == 2 else "mission" if run.simulated else "plan",
        "name": str(run.scenario.get("name") or "mission"),
        "description": str(run.scenario.get("description") or ""),
        "simulated": run.simulated,
        "success": run.success,
        "reason": run.reason,
        "seed": run.seed,
        "begin": begin,
        "end": max([begin, run.t_mission, *records.times[-1:]]),
        "available": run.t_available,
        "epoch": None if run.site is None else run.site.epoch,
        "figures": {name: summary[name] for name in _FIGURES},
        "energy": summary.get("energy"),
        "promise": None if run.promise is None else asdict(run.promise),
        "warnings": list(stated.get("warnings", [])),
        "map": map_data(low, high, run.coast, run.seabed, run.site),
        "accuracy": stated.get("accuracy", 0.0),
        "reach": None if np.isinf(run.coast_reach) else run.coast_reach,
        "current": current_data(run, low, high, records.times, records.places[:, 2]),
        "section": section_data(run),
        "waypoints": _waypoints(run),
        "start": run.start,
        "goal": run.goal,
        "track": _track(records),
        "legs": legs,
        "plans": [_plan(number, leg, plan) for number, leg in enumerate(run.legs) for plan in leg.plans],
        "doing": doings(run),
        "closures": [
            {
                "name": area.name,
                "spans": np.clip(area.spans, -1e9, 1e9),
                "rings": [np.round(ring, 1) for ring in area.rings],
            }
            for area in closed_areas(run)
        ],
        "known": [asdict(obstacle) for obstacle in run.obstacles],
        "sensing": scene.sensing_data(run),
        "routes": _routes(run),
        "tasks": task_data(run, stated),
        "limits": [{"name": of, "margin": margin, "least": least[of]} for of, margin in margins.items()],
        "provenance": {
            "files": list(stated.get("files", [])),
            "assumed": list(stated.get("assumed", [])),
            "seed": run.seed,
            "versions": {"auvplan": summary.get("version", "")},
            "settings": changed_settings(run.scenario),
        },
    }


@dataclass(frozen=True)
class _Records:
    """The legs as executed, or as planned, in a row: n records.

    Attributes:
        times: [n] s.
        places: [n, 3] m.
        margins: [n], see `Margins`.
        parts: the records of each leg.
    """

    times: Array
    places: Array
    margins: Margins
    parts: list[slice]

    @classmethod
    def of(cls, run: MissionRun) -> "_Records":
        times = np.concatenate([np.zeros(0), *(leg.times for leg in run.legs)])
        places = np.concatenate([np.zeros((0, 3)), *(np.reshape(leg.positions, (-1, 3)) for leg in run.legs)])
        margins = Margins.joined([Margins.of(run, leg) for leg in run.legs])
        ends = np.cumsum([0, *(len(leg.times) for leg in run.legs)])
        return cls(times, places, margins, [slice(*pair) for pair in pairwise(ends.tolist())])

    @property
    def stride(self) -> int:
        """Of how many records one is kept."""
        return max(1, -(-len(self.times) // _RECORDS))


def _kept(count: int, stride: int) -> NDArray[np.int_]:
    """Indices of every `stride`-th record, and of the last."""
    return np.unique(np.append(np.arange(0, count, stride), count - 1)) if count else np.zeros(0, int)


def _track(records: _Records) -> dict[str, Any]:
    """The track with what lies beside it and below."""
    kept = [part.start + _kept(part.stop - part.start, records.stride) for part in records.parts]
    rows = np.concatenate([np.zeros(0, int), *kept])
    north, east, depth = records.places[rows].T
    found = {"time": records.times[rows], "north": north, "east": east, "depth": depth}
    for name, values in vars(records.margins).items():
        if len(rows) and np.isfinite(values).any():
            found[name] = np.round(values[rows], 1)
    return {name: packed(values) for name, values in found.items()}


def _waypoints(run: MissionRun) -> list[dict[str, Any]]:
    done = {leg.goal for leg in run.earning}
    visited = set(run.route)
    return [
        {
            "name": scene.short_name(run, node),
            "place": np.round(place, 2),
            "state": "task" if node in done else "visited" if node in visited else "left",
        }
        for node, place in enumerate(np.asarray(run.graph.positions, float))
    ]


def _leg(run: MissionRun, leg: LegRecord, records: _Records, part: slice) -> dict[str, Any]:
    causes = [plan.cause for plan in leg.plans if plan.cause != "leg"]
    executed = len(leg.times) > 0
    return {
        "from": leg.start,
        "to": leg.goal,
        "priority": leg.priority,
        "arrived": leg.arrived,
        "begin": leg.times[0] if executed else None,
        "end": leg.times[-1] if executed else None,
        "expected": leg.t_expected - leg.t_task,
        "planned": leg.t_planned,
        "executed": leg.t_path if executed else None,
        "task": leg.t_task,
        "replans": {cause: causes.count(cause) for cause in dict.fromkeys(causes)},
        "length": float(np.linalg.norm(np.diff(records.places[part], axis=0), axis=1).sum()),
        "depths": np.round(leg_depths(leg.times, records.places[part]), 1) if executed else None,
        **records.margins.least(part),
        **({"speed": float(np.asarray(run.vehicle_on(leg).speed))} if run.speeds else {}),
        "followed": leg.followed_numbers,
        "obstacles": obstacle_data(run, leg, _kept(len(leg.times), _EVERY * records.stride)),
    }


def _plan(number: int, leg: LegRecord, plan: PlanRecord) -> dict[str, Any]:
    broken = np.asarray(plan.history.get("violation_best", ()), np.float32)
    return {
        "leg": number,
        "made": plan.made_at,
        "cause": plan.cause,
        "cost": plan.cost,
        "time": float(plan.times[-1] - plan.times[0]),
        "feasible": plan.feasible,
        "violation": float(broken[-1]) if len(broken) else None,
        "cpu": plan.cpu,
        "places": packed(np.round(scene.as_filed(plan.positions), 2)),
        "times": packed(plan.times),
    }


def _routes(run: MissionRun) -> list[dict[str, Any]]:
    """Rows of the time line: every route as planned, and the mission as executed."""
    rows = [
        {
            "cause": route.cause,
            "why": lateness(run, route) if route.cause == "late" else "",
            "made": route.made_at,
            "nodes": route.nodes,
            "bars": _bars(planned_bars(run, route)),
        }
        for route in (run.routes if run.simulated else [])
    ]
    return [*rows, {"cause": "done", "nodes": run.route, "bars": _bars(executed_bars(run))}]


def _bars(bars: Sequence[Bar]) -> list[list[float]]:
    return [[bar.start, bar.goal, bar.begin, bar.travel, bar.task, bar.priority] for bar in bars]


def obstacle_data(run: MissionRun, leg: LegRecord, rows: NDArray[np.int_]) -> dict[str, Any]:
    """Return the true obstacles of a leg that were not known before: places at some records, and looks."""
    shown = scene.shown_obstacles(leg)
    if not shown or not len(rows):
        return {"kinds": [], "radii": [], "times": None, "places": None, "looks": []}
    tracks, radii = scene.true_obstacles(leg)
    return {
        "kinds": [leg.obstacle_kinds[m] for m in shown],
        "radii": radii,
        "times": packed(leg.times[rows]),
        "places": packed(tracks[rows]),
        "looks": scene.looks(run, leg),
    }


def task_data(run: MissionRun, stated: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the tasks that were done, in order, and then those left, by the stated sheet."""
    done = [
        {"name": stop["task"], "priority": stop["priority"], "done": True, "at": stop["arrival"],
         "duration": stop["hold"], "why": ""}
        for stop in stated.get("stops", [])
        if stop["task"]
    ]  # fmt: skip
    left = [(job["name"], job["priority"], job["reason"]) for job in stated.get("left_out", [])]
    return done + [
        {"name": name, "priority": priority, "done": False, "at": None, "duration": None, "why": why}
        for name, priority, why in (_unvisited(run) if run.jobs is None else left)
    ]


def _unvisited(run: MissionRun) -> list[tuple[str, float, str]]:
    """Name, priority and why not of waypoints never visited, by the shortest detour at the vehicle's speed.

    Tasks of waypoints without names lie on the edges between them: stated is the highest priority of an edge
    that leads there.
    """
    priority = np.asarray(run.graph.priority, float).max(axis=0)
    travel = np.asarray(run.graph.leg_times(float(run.vehicle.speed)))  # type: ignore[arg-type]
    travel = travel - np.asarray(run.graph.duration)
    shortest = shortest_times(travel)
    rows = []
    for node in sorted(set(range(len(travel))) - set(run.route)):
        detours = [shortest[i, node] + shortest[node, j] - travel[i, j] for i, j in pairwise(run.route)]
        extra = float(min(detours, default=np.inf))
        detour = f"the detour takes about {hours(extra)} in still water" if np.isfinite(extra) else ""
        if not run.arrived:
            why = "the mission ended before"
        elif not detour:
            why = "no path leads there"
        elif extra > run.t_residual:
            why = f"{detour}, {hours(run.t_residual)} were left"
        else:
            why = f"{detour}: current, reserve and the worth of the tasks passed over stood against it"
        rows.append((scene.waypoint_name(run, node), float(priority[node]), why))
    return sorted(rows, key=lambda row: -row[1])
