"""The independent checker: walks every sailed metre of a saved run and re-adds every second.

It reads files and uses NumPy, and shares no code with the planners or the simulator, so that a fault of theirs
cannot hide itself here.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from auvplan.io.files import MISSION, SUMMARY, ResultError, read_mission, read_summary
from auvplan.io.sightings import Coast, Walk, events

Array = NDArray[np.floating]

#: Times may differ by so much where they should agree, s: far above rounding, far below a time step.
TIME_TOLERANCE = 0.01
#: A leg begins and ends within this distance of its waypoints and of the leg before, m.
PLACE_TOLERANCE = 2.0
#: No current is faster, m/s.
CURRENT_MAX = 5.0

_SUMMARY_FIELDS = (
    "t_available", "t_mission", "t_residual", "success", "tasks", "total_priority", "legs", "cpu", "collisions",
)  # fmt: skip
_LEG_FIELDS = ("from", "to", "t_expected", "t_path", "t_task", "priority", "arrived")
_VARIABLES = {
    "time": ("obs",), "x": ("obs",), "y": ("obs",), "depth": ("obs",), "leg_index": ("obs",),
    "row_size": ("leg",), "leg_from": ("leg",), "leg_to": ("leg",), "leg_t_path": ("leg",),
    "leg_t_task": ("leg",), "leg_priority": ("leg",), "leg_arrived": ("leg",),
    "waypoint_position": ("waypoint", "axis"), "adjacency": ("waypoint", "waypoint_to"),
    "task_priority": ("waypoint", "waypoint_to"), "task_duration": ("waypoint", "waypoint_to"),
}  # fmt: skip
_OPTIONAL = {
    "obstacle_position": ("obs", "obstacle", "axis"), "obstacle_radius": ("leg", "obstacle"),
    "passability": ("chart_x", "chart_y"), "chart_origin": ("horizontal",), "chart_pixel_size": (),
}  # fmt: skip
_ATTRIBUTES = (
    "vehicle_speed", "t_available", "t_mission", "start", "goal", "arrived", "charged_compute",
)  # fmt: skip


@dataclass
class CheckReport:
    """What the checker found.

    Attributes:
        coast_hits: separate stretches on land.
        coast_metres: m sailed on land.
        obstacle_hits: separate stretches inside a true obstacle at the true time.
        obstacle_metres: m sailed inside one.
        coast_clearance: m, least distance to a coast pixel's edge; infinite without a coast.
        obstacle_clearance: m, least distance to a true obstacle's surface, negative inside; infinite
            without obstacles.
        length: m walked.
        legs: sailed legs.
        faults: one line each.
    """

    coast_hits: int = 0
    coast_metres: float = 0.0
    obstacle_hits: int = 0
    obstacle_metres: float = 0.0
    coast_clearance: float = np.inf
    obstacle_clearance: float = np.inf
    length: float = 0.0
    legs: int = 0
    faults: list[str] = field(default_factory=list)

    @property
    def collisions(self) -> int:
        """Separate stretches on land or inside an obstacle."""
        return self.coast_hits + self.obstacle_hits

    @property
    def ok(self) -> bool:
        """Whether no fault was found."""
        return not self.faults

    def __str__(self) -> str:
        lines = [
            f"walked {self.length:.0f} m on {self.legs} legs",
            f"collisions: {self.coast_hits} with the coast ({self.coast_metres:.1f} m), "
            f"{self.obstacle_hits} with obstacles ({self.obstacle_metres:.1f} m)",
            f"least clearance: coast {_metres(self.coast_clearance)}, obstacles {_metres(self.obstacle_clearance)}",
            *(f"fault: {fault}" for fault in self.faults),
            "no faults" if self.ok else f"{len(self.faults)} faults",
        ]
        return "\n".join(lines)


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

    def __str__(self) -> str:
        return f"leg {self.number} ({self.start} to {self.goal})"

    @property
    def sailed(self) -> bool:
        return len(self.times) > 0


def check_run(folder: str | Path) -> CheckReport:
    """Check a saved run: coast, obstacles, times, places and edges of every sailed leg.

    Args:
        folder: that `save_run` wrote.

    Returns:
        What was found; `CheckReport.ok` tells whether it is free of faults.

    Raises:
        ResultError: a file is missing, damaged or incomplete; one line that names it.
    """
    summary, dataset = read_summary(folder), read_mission(folder)
    _require(summary, Path(folder) / SUMMARY, dataset, Path(folder) / MISSION)
    legs = list(_legs(dataset))
    if dataset["row_size"].sum() != dataset.sizes.get("obs", 0):
        raise ResultError(f"{Path(folder) / MISSION}: row_size does not add up to the number of observations")
    report = CheckReport()
    report.faults += _graph_faults(dataset, legs)
    report.faults += _place_faults(dataset, legs)
    report.faults += _time_faults(dataset, summary, legs)
    report.faults += _figure_faults(summary, dataset, legs)
    coast = Coast.of(dataset) if "passability" in dataset else None
    for leg in legs:
        if leg.sailed:
            _walk(leg, coast, float(dataset.attrs["vehicle_speed"]) + CURRENT_MAX, report)
    return report


def _require(summary: dict[str, Any], summary_file: Path, dataset: xr.Dataset, mission_file: Path) -> None:
    """Raise on what is not there, so that nothing passes for want of data."""
    rows = summary.get("legs")
    tables: list[tuple[Any, tuple[str, ...], str]] = [(summary, _SUMMARY_FIELDS, "")]
    if isinstance(rows, list):
        tables += [(row, _LEG_FIELDS, f"legs[{k}].") for k, row in enumerate(rows)]
    tables.append((summary.get("cpu"), ("charged_s",), "cpu."))
    for table, names, prefix in tables:
        for name in names:
            if not isinstance(table, Mapping) or name not in table:
                raise ResultError(f"{summary_file}: {prefix}{name} is missing")
            if name in ("legs", "cpu"):
                if not isinstance(table[name], list | Mapping):
                    raise ResultError(f"{summary_file}: {name} is not a table")
            elif not isinstance(table[name], int | float):
                raise ResultError(f"{summary_file}: {prefix}{name} is not a number")
    needed = dict(_VARIABLES)
    for group in (("obstacle_position", "obstacle_radius"), ("passability", "chart_origin", "chart_pixel_size")):
        if any(name in dataset for name in group):
            needed |= {name: _OPTIONAL[name] for name in group}
    for name, dims in needed.items():
        if name not in dataset:
            raise ResultError(f"{mission_file}: variable {name} is missing")
        if dataset[name].dims != dims:
            raise ResultError(f"{mission_file}: variable {name} has dimensions {dataset[name].dims}, not {dims}")
    for name in _ATTRIBUTES:
        if name not in dataset.attrs:
            raise ResultError(f"{mission_file}: attribute {name} is missing")


def _legs(dataset: xr.Dataset) -> Iterator[Leg]:
    table = {name: dataset[name].values for name in dataset.variables}
    place = np.stack([table["x"], table["y"], table["depth"]], axis=1).astype(float)
    obstacles = np.asarray(table.get("obstacle_position", np.zeros((len(place), 0, 3))), float)
    radii = np.asarray(table.get("obstacle_radius", np.zeros((len(table["row_size"]), 0))), float)
    ends = np.cumsum(table["row_size"])
    for k, end in enumerate(ends):
        part = slice(int(end - table["row_size"][k]), int(end))
        real = np.isfinite(radii[k])
        yield Leg(
            k, int(table["leg_from"][k]), int(table["leg_to"][k]),
            float(table["leg_t_path"][k]), float(table["leg_t_task"][k]), float(table["leg_priority"][k]),
            bool(table["leg_arrived"][k]), np.asarray(table["time"][part], float), place[part],
            obstacles[part][:, real], radii[k][real],
        )  # fmt: skip


def _graph_faults(dataset: xr.Dataset, legs: list[Leg]) -> Iterator[str]:
    """Edges that are not there, that carry another task, or that are taken twice."""
    adjacency = dataset["adjacency"].values.astype(bool)
    priority, duration = dataset["task_priority"].values, dataset["task_duration"].values
    symmetric = np.array_equal(adjacency, adjacency.T)
    used: dict[Any, Leg] = {}
    for leg in legs:
        edge = (leg.start, leg.goal)
        if not all(0 <= node < len(adjacency) for node in edge) or leg.start == leg.goal or not adjacency[edge]:
            yield f"{leg}: no such edge in the graph"
            continue
        if abs(priority[edge] - leg.priority) > 1e-6 or abs(duration[edge] - leg.t_task) > TIME_TOLERANCE:
            yield f"{leg}: its task is not the edge's"
        if leg.sailed:
            name = frozenset(edge) if symmetric else edge
            if name in used:
                yield f"{leg}: the edge was taken before, by {used[name]}"
            used.setdefault(name, leg)


def _place_faults(dataset: xr.Dataset, legs: list[Leg]) -> Iterator[str]:
    """Legs that do not join up with each other or with their waypoints."""
    waypoints = dataset["waypoint_position"].values
    sailed = [leg for leg in legs if leg.sailed and max(leg.start, leg.goal) < len(waypoints)]
    here, place = int(dataset.attrs["start"]), None
    for leg in sailed:
        if leg.start != here:
            yield f"{leg}: begins at waypoint {leg.start}, the vehicle is at {here}"
        if place is not None and not _near(leg.positions[0], place):
            yield f"{leg}: begins {np.linalg.norm(leg.positions[0] - place):.1f} m from where the last leg ended"
        if not _near(leg.positions[0], waypoints[leg.start]):
            yield f"{leg}: begins off waypoint {leg.start}"
        if leg.arrived and not _near(leg.positions[-1], waypoints[leg.goal]):
            yield f"{leg}: ends off waypoint {leg.goal}"
        if not leg.arrived and leg is not sailed[-1]:
            yield f"{leg}: did not arrive, yet the mission went on"
        here, place = (leg.goal if leg.arrived else -1), leg.positions[-1]
    if bool(dataset.attrs["arrived"]) != (here == int(dataset.attrs["goal"])):
        yield f"the mission's end does not fit: arrived is {bool(dataset.attrs['arrived'])}, last waypoint {here}"


def _time_faults(dataset: xr.Dataset, summary: dict[str, Any], legs: list[Leg]) -> Iterator[str]:
    """Times that do not add up, in the file or in the summary."""
    charged, now = float(summary["cpu"]["charged_s"]), 0.0
    spent = 0.0
    for leg in (leg for leg in legs if leg.sailed):
        if not _same(leg.times[-1] - leg.times[0], leg.t_path):
            yield f"{leg}: took {leg.times[-1] - leg.times[0]:.2f} s, its travel time is given as {leg.t_path:.2f} s"
        gap = leg.times[0] - now
        # Between two legs nothing but planning passes, and that only where it is charged.
        if gap < -TIME_TOLERANCE or gap > charged + TIME_TOLERANCE or not np.isfinite(gap):
            yield f"{leg}: begins at {leg.times[0]:.2f} s, the last leg and its task end at {now:.2f} s"
        task = leg.t_task if leg.arrived else 0.0
        now, spent = leg.times[-1] + task, spent + leg.t_path + task
    if not _same(spent + charged, summary["t_mission"]):
        yield f"legs, tasks and planning add up to {spent + charged:.2f} s, t_mission is {summary['t_mission']:.2f} s"
    if not _same(summary["t_available"] - summary["t_mission"], summary["t_residual"]):
        yield f"t_residual is {summary['t_residual']:.2f} s, not t_available less t_mission"
    success = bool(dataset.attrs["arrived"]) and summary["t_residual"] > 0
    if bool(summary["success"]) != success:
        yield f"success is {bool(summary['success'])}, the times and the last waypoint say {success}"


def _figure_faults(summary: dict[str, Any], dataset: xr.Dataset, legs: list[Leg]) -> Iterator[str]:
    """Figures of the summary that differ from the file's."""
    for name, other in (("t_available", "t_available"), ("t_mission", "t_mission")):
        if not _same(summary[name], dataset.attrs[other]):
            yield f"{name} is {summary[name]} in {SUMMARY}, {dataset.attrs[other]} in {MISSION}"
    if not _same(summary["cpu"]["charged_s"], dataset.attrs["charged_compute"]):
        yield f"charged planning time differs between {SUMMARY} and {MISSION}"
    rows = summary["legs"]
    if len(rows) != len(legs):
        yield f"{len(rows)} legs in {SUMMARY}, {len(legs)} in {MISSION}"
    for row, leg in zip(rows, legs, strict=False):
        given = (row["from"], row["to"], bool(row["arrived"]), row["priority"])
        if given != (leg.start, leg.goal, leg.arrived, leg.priority):
            yield f"{leg}: waypoints, task or arrival differ between {SUMMARY} and {MISSION}"
        if not (_same(row["t_path"], leg.t_path) and _same(row["t_task"], leg.t_task)):
            yield f"{leg}: its times differ between {SUMMARY} and {MISSION}"
    done = [leg for leg in legs if leg.arrived]
    tasks, total = sum(leg.priority > 0 for leg in done), sum(leg.priority for leg in done)
    if summary["tasks"] != tasks or abs(summary["total_priority"] - total) > 1e-6:
        yield f"{summary['tasks']} tasks of {summary['total_priority']:g} in {SUMMARY}, {tasks} of {total:g} sailed"


def _walk(leg: Leg, coast: Coast | None, speed: float, report: CheckReport) -> None:
    """Walk one leg in steps of at most a metre and book what it meets."""
    report.legs += 1
    for name, values in (("time", leg.times), ("position", leg.positions), ("obstacle", leg.obstacles)):
        if not np.isfinite(values).all():
            report.faults.append(f"{leg}: a {name} is not a number")
            return
    elapsed = np.diff(leg.times)
    gaps = np.linalg.norm(np.diff(leg.positions, axis=0), axis=1)
    if (elapsed <= 0.0).any():
        report.faults.append(f"{leg}: time does not advance after {leg.times[:-1][elapsed <= 0.0][0]:.2f} s")
    for k in np.flatnonzero(gaps > speed * np.maximum(elapsed, 0.0) + 0.01)[:1]:
        report.faults.append(f"{leg}: {gaps[k]:.1f} m in {elapsed[k]:.2f} s after {leg.times[k]:.2f} s is too fast")
    walk = Walk.of(leg.times, leg.positions, leg.obstacles)
    report.length += float(gaps.sum())
    if (walk.positions[:, 2] < -0.01).any():
        report.faults.append(f"{leg}: above the surface by {-walk.positions[:, 2].min():.2f} m")
    if coast is not None:
        land, outside = coast.on_land(walk.positions), coast.outside(walk.positions)
        report.coast_clearance = min(report.coast_clearance, coast.clearance(walk.positions))
        report.coast_metres += float(walk.metres[land].sum())
        for first, last in events(land):
            report.coast_hits += 1
            report.faults.append(f"{leg}: on land {walk.between(first, last)}")
        for first, last in events(outside):
            report.faults.append(f"{leg}: outside the chart {walk.between(first, last)}")
    clearance = np.linalg.norm(walk.obstacles - walk.positions[:, None], axis=2) - leg.radii
    report.obstacle_clearance = min(report.obstacle_clearance, clearance.min(initial=np.inf))
    report.obstacle_metres += float(walk.metres[(clearance < 0.0).any(axis=1)].sum())
    for number, inside in enumerate((clearance < 0.0).T):
        for first, last in events(inside):
            report.obstacle_hits += 1
            report.faults.append(f"{leg}: inside obstacle {number} {walk.between(first, last)}")


def _near(a: Array, b: Array) -> bool:
    return bool(np.linalg.norm(a - b) <= PLACE_TOLERANCE)


def _same(a: float, b: float) -> bool:
    """Whether two times agree; never where one is not a number."""
    return bool(abs(a - b) <= TIME_TOLERANCE)


def _metres(value: float) -> str:
    return "none near" if np.isinf(value) else f"{value:.1f} m"


__all__ = ["CheckReport", "ResultError", "check_run"]
