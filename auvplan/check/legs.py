"""Consistency checks of a saved run: legs, places, edges and times. Plain NumPy."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from auvplan.runtime.files import MISSION, SUMMARY, ResultError

Array = NDArray[np.floating]

#: Times may differ by so much where they should agree, s: far above rounding, far below a time step.
TIME_TOLERANCE = 0.01
#: A leg begins and ends within this distance of its waypoints and of the leg before, m.
PLACE_TOLERANCE = 2.0

_SUMMARY_FIELDS = ("t_available", "t_mission", "t_residual", "success", "tasks", "total_priority")
_LEG_FIELDS = ("from", "to", "t_expected", "t_path", "t_task", "priority", "arrived")
_VARIABLES = {
    "time": ("obs",), "x": ("obs",), "y": ("obs",), "depth": ("obs",), "leg_index": ("obs",),
    "row_size": ("leg",), "leg_from": ("leg",), "leg_to": ("leg",), "leg_t_path": ("leg",),
    "leg_t_expected": ("leg",), "leg_t_task": ("leg",), "leg_priority": ("leg",), "leg_arrived": ("leg",),
    "waypoint_position": ("waypoint", "axis"), "adjacency": ("waypoint", "waypoint_to"),
    "task_priority": ("waypoint", "waypoint_to"), "task_duration": ("waypoint", "waypoint_to"),
    "waypoint_priority": ("waypoint",), "waypoint_duration": ("waypoint",),
} | dict.fromkeys(("course", "yaw", "pitch", "surge", "sway", "heave"), ("obs",))  # fmt: skip
#: Variables of which a run has all or none.
_TOGETHER: tuple[dict[str, tuple[str, ...]], ...] = (
    {"obstacle_position": ("obs", "obstacle", "axis"), "obstacle_radius": ("leg", "obstacle")},
    {"passability": ("chart_x", "chart_y"), "chart_origin": ("horizontal",), "chart_pixel_size": ()},
    {"seabed_depth": ("seabed_x", "seabed_y"), "seabed_origin": ("horizontal",), "seabed_pixel_size": ()},
)
_ATTRIBUTES = (
    "vehicle_speed", "t_available", "t_mission", "start", "goal", "arrived", "charged_compute", "scenario",
    "scenario_folder",
)  # fmt: skip


@dataclass(frozen=True)
class Leg:
    """One leg as the file has it: n observations (none where it was refused), M obstacles."""

    number: int
    start: int
    goal: int
    t_path: float
    t_task: float
    priority: float
    arrived: bool
    times: Array  # [n] s
    positions: Array  # [n, 3] m
    obstacles: Array  # [n, M, 3] m
    radii: Array  # [M] m
    t_hold: float = 0.0
    t_wait: float = 0.0
    missed: bool = False
    t_expected: float = np.nan
    rows: slice = field(default_factory=lambda: slice(0))  # of the observations in the file

    def __str__(self) -> str:
        return f"leg {self.number} ({self.start} to {self.goal})"

    @property
    def begins(self) -> float:
        """When it is begun, s; NaN where it was refused."""
        return float(self.times[0]) if len(self.times) else np.nan

    @property
    def executed(self) -> bool:
        """Whether the leg has a track."""
        return len(self.times) > 0


def require(summary: dict[str, Any], dataset: xr.Dataset, folder: Path) -> None:
    """Raise on what is not there, so that nothing passes for want of data.

    Raises:
        ResultError: a field, variable or attribute is missing or of the wrong kind; one line that names it.
    """

    def need(fine: Any, file: str, words: str) -> None:
        if not fine:
            raise ResultError(f"{folder / file}: {words}")

    def need_fields(table: Any, names: tuple[str, ...], prefix: str = "", kind: Any = int | float) -> None:
        for name in names:
            need(isinstance(table, Mapping) and name in table, SUMMARY, f"{prefix}{name} is missing")
            what = "number" if kind == int | float else "table"
            need(isinstance(table[name], kind), SUMMARY, f"{prefix}{name} is not a {what}")

    need_fields(summary, _SUMMARY_FIELDS)
    need_fields(summary, ("legs", "cpu"), kind=list | Mapping)
    for k, row in enumerate(summary["legs"] if isinstance(summary["legs"], list) else ()):
        need_fields(row, _LEG_FIELDS, f"legs[{k}].")
    need_fields(summary["cpu"], ("charged_s",), "cpu.")
    needed = dict(_VARIABLES)
    for group in _TOGETHER:
        if any(name in dataset for name in group):
            needed |= group
    for name, dims in needed.items():
        need(name in dataset, MISSION, f"variable {name} is missing")
        there = dataset[name].dims
        need(there == dims, MISSION, f"variable {name} has dimensions {there}, not {dims}")
    for name in (*_ATTRIBUTES, *(("seabed_clearance",) if "seabed_depth" in dataset else ())):
        need(name in dataset.attrs, MISSION, f"attribute {name} is missing")
    rows = dataset["row_size"]
    whole = (rows >= 0).all() and rows.sum() == dataset.sizes["obs"]
    need(whole, MISSION, "row_size does not add up to the number of observations")


def read_legs(dataset: xr.Dataset) -> Iterator[Leg]:
    """Yield the legs in the order of the file."""
    table = {name: dataset[name].values for name in dataset.variables}
    place = np.stack([table["x"], table["y"], table["depth"]], axis=1).astype(float)
    obstacles = np.asarray(table.get("obstacle_position", np.zeros((len(place), 0, 3))), float)
    radii = np.asarray(table.get("obstacle_radius", np.zeros((len(table["row_size"]), 0))), float)
    ends, still = np.cumsum(table["row_size"]), np.zeros(len(table["row_size"]))
    holds, waits = table.get("leg_t_hold", still), table.get("leg_t_wait", still)
    missed, expected = table.get("leg_missed", still), table["leg_t_expected"]
    for k, end in enumerate(ends):
        part = slice(int(end - table["row_size"][k]), int(end))
        real = np.isfinite(radii[k])
        yield Leg(
            k, int(table["leg_from"][k]), int(table["leg_to"][k]),
            float(table["leg_t_path"][k]), float(table["leg_t_task"][k]), float(table["leg_priority"][k]),
            bool(table["leg_arrived"][k]), np.asarray(table["time"][part], float), place[part],
            obstacles[part][:, real], radii[k][real], float(holds[k]), float(waits[k]),
            bool(missed[k]), float(expected[k]), part,
        )  # fmt: skip


def scenario_of(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the settings of a saved run's scenario."""
    return json.loads(str(dataset.attrs["scenario"]))


def waypoint_names(dataset: xr.Dataset) -> list[str]:
    """Return the names of a saved run's waypoints; empty where they have none."""
    return json.loads(str(dataset.attrs.get("waypoint_names", "[]")))


def site_faults(dataset: xr.Dataset) -> Iterator[str]:
    """Yield that a run is not where and when, or its vehicle not as fast, as its scenario says."""
    settings = scenario_of(dataset)
    site, speed = settings.get("site"), (settings.get("vehicle") or {}).get("speed")
    if speed is not None and abs(float(dataset.attrs["vehicle_speed"]) - speed) > 1e-6:
        yield f"vehicle_speed is {float(dataset.attrs['vehicle_speed']):g} m/s, the scenario says {speed:g}"
    if not site or "site_longitude" not in dataset.attrs:
        return
    places = {"site_longitude": site["longitude"], "site_latitude": site["latitude"]}
    for name, value in places.items():
        if abs(float(dataset.attrs[name]) - value) > 1e-9:
            yield f"{name} is {float(dataset.attrs[name]):g}, the scenario says {value:g}"
    origin = np.asarray(dataset.attrs["site_origin"], float)
    if "origin" in site and np.abs(origin - site["origin"]).max() > 1e-3:
        yield f"site_origin is {origin.tolist()} m, the scenario says {site['origin']} m"
    if site.get("departure") and "site_epoch" in dataset.attrs:
        # The departure that was planned for: a plan for another moment than the scenario's has it moved.
        departs = datetime.fromisoformat(site["departure"])
        off = (datetime.fromisoformat(str(dataset.attrs["site_epoch"])) - departs).total_seconds()
        if abs(off) > TIME_TOLERANCE:
            yield f"it departs {off:+.0f} s off the scenario's departure"


def graph_faults(dataset: xr.Dataset, legs: list[Leg]) -> Iterator[str]:
    """Yield edges that are not there or that are taken twice."""
    adjacency = dataset["adjacency"].values.astype(bool)
    symmetric = np.array_equal(adjacency, adjacency.T)
    used: dict[Any, Leg] = {}
    for leg in legs:
        edge = (leg.start, leg.goal)
        known = leg.start != leg.goal and all(0 <= node < len(adjacency) for node in edge)
        if not (known and adjacency[edge]):
            yield f"{leg}: no such edge in the graph"
            continue
        if leg.executed:
            name = frozenset(edge) if symmetric else edge
            if name in used:
                yield f"{leg}: the edge was taken before, by {used[name]}"
            used.setdefault(name, leg)


def place_faults(dataset: xr.Dataset, legs: list[Leg]) -> Iterator[str]:
    """Legs that do not join up with each other or with their waypoints."""
    waypoints = dataset["waypoint_position"].values
    known = range(len(waypoints))
    executed = [leg for leg in legs if leg.executed and leg.start in known and leg.goal in known]
    here, place = int(dataset.attrs["start"]), None
    for leg in executed:
        if leg.start != here:
            yield f"{leg}: begins at waypoint {leg.start}, the vehicle is at {here}"
        if place is not None and not near(leg.positions[0], place):
            gap = np.linalg.norm(leg.positions[0] - place)
            yield f"{leg}: begins {gap:.1f} m from where the last leg ended"
        if not near(leg.positions[0], waypoints[leg.start]):
            yield f"{leg}: begins off waypoint {leg.start}"
        if leg.arrived and not near(leg.positions[-1], waypoints[leg.goal]):
            yield f"{leg}: ends off waypoint {leg.goal}"
        if not leg.arrived and leg is not executed[-1]:
            yield f"{leg}: did not arrive, yet the mission went on"
        here, place = (leg.goal if leg.arrived else -1), leg.positions[-1]
    arrived, goal = bool(dataset.attrs["arrived"]), int(dataset.attrs["goal"])
    if arrived != (here == goal):
        yield f"arrived is {arrived}, yet the legs end {f'at waypoint {here}' if here >= 0 else 'under way'}"


def time_faults(dataset: xr.Dataset, summary: dict[str, Any], legs: list[Leg]) -> Iterator[str]:
    """Times that do not add up, in the file or in the summary."""
    charged, now, spent = float(summary["cpu"]["charged_s"]), 0.0, 0.0
    for leg in (leg for leg in legs if leg.executed):
        taken = leg.times[-1] - leg.times[0]
        if not _same(taken, leg.t_path):
            yield f"{leg}: took {taken:.2f} s, its travel time is given as {leg.t_path:.2f} s"
        gap = leg.times[0] - now - leg.t_hold
        # Between two legs nothing but waiting passes, and planning where it is charged.
        if gap < -TIME_TOLERANCE or gap > charged + TIME_TOLERANCE or not np.isfinite(gap):
            yield f"{leg}: begins at {leg.times[0]:.2f} s, the last leg and its task end at {now:.2f} s"
        task, waited = (leg.t_task, leg.t_wait) if leg.arrived else (0.0, 0.0)
        now = leg.times[-1] + waited + task
        spent += leg.t_hold + leg.t_path + waited + task
    total = spent + charged
    if not _same(total, summary["t_mission"]):
        yield f"legs, tasks and planning add up to {total:.2f} s, t_mission is {summary['t_mission']:.2f} s"
    if not _same(summary["t_available"] - summary["t_mission"], summary["t_residual"]):
        yield f"t_residual is {summary['t_residual']:.2f} s, not t_available less t_mission"
    success = bool(dataset.attrs["arrived"]) and summary["t_residual"] > 0
    if bool(summary["success"]) != success:
        yield f"success is {bool(summary['success'])}, the times and the last waypoint say {success}"


def figure_faults(summary: dict[str, Any], dataset: xr.Dataset, legs: list[Leg]) -> Iterator[str]:
    """Yield figures of the summary that differ from the legs, plans and routes of the file."""
    for name in ("t_available", "t_mission"):
        if not _same(summary[name], dataset.attrs[name]):
            yield f"{name} is {summary[name]} in {SUMMARY}, {dataset.attrs[name]} in {MISSION}"
    rows = summary["legs"]
    if len(rows) != len(legs):
        yield f"{len(rows)} legs in {SUMMARY}, {len(legs)} in {MISSION}"
    booked = list(_leg_figures(dataset, legs))
    made = dataset["route_cpu"].values if "route_cpu" in dataset else np.zeros(0)
    computing = {
        "charged_s": float(dataset.attrs["charged_compute"]),
        "path_s": sum(figures["cpu_s"] for figures in booked),
        "mission_s": made.sum(),
        "mission_replans_s": made[1:].sum(),
    }
    tables: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
        *((f"{leg}: ", row, figures) for row, leg, figures in zip(rows, legs, booked, strict=False)),
        ("", summary, _totals(summary, dataset, made, booked)),
        ("cpu.", summary["cpu"], computing),
    ]
    for prefix, stated, figures in tables:
        for name, value in figures.items():
            if not _agrees(stated.get(name, value), value):
                yield f"{prefix}{name} is {stated[name]} in {SUMMARY}, {value:g} by {MISSION}"
    if summary.get("priority_bound", np.inf) < summary["total_priority"] - 1e-6:
        yield f"priority_bound, {summary['priority_bound']:g}, is less than the total priority"


def _leg_figures(dataset: xr.Dataset, legs: list[Leg]) -> Iterator[dict[str, float]]:
    """Yield what the summary says of a leg, from the file."""
    count = len(legs)
    revisits = dataset["leg_revisit"].values if "leg_revisit" in dataset else np.zeros(count)
    followed = dataset["leg_followed"].values if "leg_followed" in dataset else np.zeros(count, int)
    owner, cause, cpu, planned = _plans(dataset)
    for leg in legs:
        own = np.flatnonzero(owner == leg.number)
        yield {
            "from": leg.start, "to": leg.goal, "arrived": leg.arrived, "priority": leg.priority,
            "revisit": bool(revisits[leg.number]), "t_expected": leg.t_expected, "t_path": leg.t_path,
            "t_task": leg.t_task, "t_hold": leg.t_hold, "t_wait": leg.t_wait,
            "t_planned": float(planned[own[followed[leg.number]]]) if len(own) else np.nan,
            "path_replans": int((cause[own] != "leg").sum()), "cpu_s": float(cpu[own].sum()),
        }  # fmt: skip


def _plans(dataset: xr.Dataset) -> tuple[NDArray[Any], ...]:
    """Return of every plan the leg [P], why it was made [P], s of wall-clock time [P] and s planned [P]."""
    if "plan_leg" not in dataset:
        return np.zeros(0, int), np.zeros(0, str), np.zeros(0), np.zeros(0)
    codes, times = dataset["plan_cause"], dataset["plan_time"].values
    names = np.array(str(codes.attrs["flag_meanings"]).split())
    ends = np.nanmax(times, axis=1) - np.nanmin(times, axis=1)
    return dataset["plan_leg"].values, names[codes.values], dataset["plan_cpu"].values, ends


def _totals(
    summary: dict[str, Any], dataset: xr.Dataset, made: Array, booked: list[dict[str, float]]
) -> dict[str, float]:
    """Return what the summary says of the whole mission, from the file; `made`: s that routes took [R]."""
    found: dict[str, float] = {
        "path_calls": len(booked),
        "path_replans": sum(figures["path_replans"] for figures in booked),
        "mission_replans": max(len(made) - 1, 0),
        "revisits": sum(figures["revisit"] for figures in booked if figures["arrived"]),
        "seed": int(dataset.attrs["seed"]),
    }
    reserve = scenario_of(dataset).get("planning", {}).get("reserve")
    if reserve is not None:
        found["reserve_used"] = float(np.clip(reserve - summary["t_residual"], 0.0, reserve))
    if "cost_mission" in summary:
        found["cost_total"] = summary["cost_mission"] + made[1:].sum()
    return found


def route_faults(dataset: xr.Dataset, legs: list[Leg]) -> Iterator[str]:
    """Yield routes whose time is not their legs', and legs that leave their route or expect another time."""
    if "route_leg_time" not in dataset:
        return
    yield from _way_faults(dataset, legs)
    routes, made_at = dataset["route_leg_time"].values, dataset["route_made_at"].values
    for number, (route, total) in enumerate(zip(routes, dataset["route_time"].values, strict=True)):
        if np.isfinite(route).any() and not _same(np.nansum(route), total):
            yield f"route {number}: its legs add up to {np.nansum(route):.2f} s, its time is {total:.2f} s"
    nodes, waits = dataset["route_nodes"].values, np.nan_to_num(dataset["route_wait"].values)
    for leg in legs:
        # A leg that begins when its route is made expects what the route says.
        for number in np.flatnonzero(np.abs(made_at + leg.t_hold - leg.begins) <= TIME_TOLERANCE)[-1:]:
            expected = routes[number, 0] - waits[number, 0] - leg.t_hold
            same = tuple(nodes[number, :2]) == (leg.start, leg.goal) and np.isfinite(expected)
            if same and not _same(expected, leg.t_expected):
                yield f"{leg}: expects {leg.t_expected:.2f} s, its route {expected:.2f} s"


def _way_faults(dataset: xr.Dataset, legs: list[Leg]) -> Iterator[str]:
    """Yield the first leg of each route that does not lead where the route says."""
    nodes, made_at = dataset["route_nodes"].values, dataset["route_made_at"].values
    route, stop, left = -1, 0, False
    for leg in (leg for leg in legs if leg.executed):
        newest = int(np.sum(made_at <= leg.begins - leg.t_hold + TIME_TOLERANCE)) - 1
        if newest != route:
            route, stop, left = newest, 0, False
        if route >= 0 and not left and tuple(nodes[route, stop : stop + 2]) != (leg.start, leg.goal):
            left = True
            yield f"{leg}: route {route} leads from {nodes[route, stop]} elsewhere"
        stop += 1


def _agrees(stated: Any, value: float) -> bool:
    """Return whether a figure of the summary is that of the file; NaN is stored as null."""
    if stated is None or np.isnan(value):
        return stated is None and np.isnan(value)
    return bool(abs(float(stated) - value) <= TIME_TOLERANCE)


def near(a: Array, b: Array) -> bool:
    """Return whether two places [3] m are one, up to `PLACE_TOLERANCE`."""
    return bool(np.linalg.norm(a - b) <= PLACE_TOLERANCE)


def _same(a: float, b: float) -> bool:
    """Return whether two times agree; never where one is not a number."""
    return bool(abs(a - b) <= TIME_TOLERANCE)
