"""The tables of a saved run, each written and read back: legs, plans, routes, tasks, what was known."""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import shapely
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from auvplan.energy.power import PowerLaw, PowerModel, PowerTable
from auvplan.io.fields import (
    Variables,
    history_of,
    history_variables,
    motion_of,
    motion_variables,
    padded,
    variable,
    vortices_of,
)
from auvplan.mission import MissionGraph
from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.mission.survey import LinePart
from auvplan.mission.timetable import Timetable
from auvplan.navigation import Navigation
from auvplan.ocean.closures import Zone
from auvplan.ocean.currents import Current
from auvplan.ocean.known import KnownObstacle
from auvplan.path.motion import Motion
from auvplan.records import LegRecord, MissionRun, PlanRecord, Promise, TurnBack

#: The scenario's epoch has no date of its own; this one stands for it.
TIME_UNITS = "seconds since 2000-01-01 00:00:00"

#: Names that a flag may take, by their codes from 1; others are added as they appear.
KINDS = ("static", "afloat", "self-motivated", "known")
#: Why a path or a route was planned.
PLAN_CAUSES = ("leg", "window", "hazard")
ROUTE_CAUSES = ("start", "late", "early", "refused", "charge", "spare")


@dataclass(frozen=True)
class Column:
    """A figure that files hold of every leg, plan or route."""

    name: str  # of its variable; what stands before the first "_" is its dimension
    words: str  # what it is
    units: str | None = None  # or None for indices and flags
    #: Of its values: float, int, bool, or the names that it may take; of arrays NumPy's.
    kind: type | tuple[str, ...] = float
    field: str = ""  # of the record that has it; the rest of the name if absent
    kept: bool = True  # whether the record is made from it; otherwise it follows from the rest
    along: tuple[str, ...] = ()  # dimensions of a record's row; the first is padded to the longest, or none
    some: bool = False  # whether only some records have it; there is no variable where none does

    @property
    def attribute(self) -> str:
        """The record's attribute."""
        return self.field or self.name.split("_", 1)[1]

    def values(self, records: Iterable[Any], length: int | None = None) -> NDArray[Any]:
        """Return the figure of each record, NaN of those without it; names as their codes from 1.

        Args:
            length: that rows are padded to; the longest one's if absent.
        """
        values = [getattr(record, self.attribute) for record in records]
        if isinstance(self.kind, tuple):
            return np.asarray([self.kind.index(value) + 1 for value in values], np.int32)
        kind = np.int32 if self.kind is int else self.kind
        if self.along:
            return padded(values, -1 if self.kind is int else np.nan, kind, length)
        return np.asarray([np.nan if value is None else value for value in values], kind)

    def variable(self, records: Sequence[Any], length: int | None = None) -> xr.Variable | None:
        """Return the column of some records; None where none of them has it."""
        dims: tuple[str, ...] = (self.name.split("_", 1)[0], *self.along)
        if isinstance(self.kind, tuple):
            codes, about = flags(np.asarray([getattr(one, self.attribute) for one in records]), self.kind)
            return variable(dims, codes, self.words, **about)
        values = self.values(records, length)
        if self.some and np.isnan(values).all():
            return None
        if self.kind is bool:
            return yes_or_no(dims, values, self.words)
        return variable(dims, values, self.words, self.units)

    def read(self, dataset: xr.Dataset) -> list[Any]:
        """Return the figures that `variable` wrote; None of records without it."""
        values = dataset[self.name].values
        if isinstance(self.kind, tuple):
            names = str(dataset[self.name].attrs["flag_meanings"]).split()
            return [names[int(code)] for code in values]
        if self.along:
            there = values >= 0 if self.kind is int else np.isfinite(values)
            rows = [row[own.reshape(len(own), -1)[:, 0]] for row, own in zip(values, there, strict=True)]
            arrays = self.kind not in (int, float)
            return [row.astype(float) if arrays else row.astype(self.kind).tolist() for row in rows]
        return [None if self.some and np.isnan(value) else self.kind(value) for value in values]


def table(columns: Iterable[Column], records: Sequence[Any]) -> Variables:
    """Return the columns of some records, by the names of their variables; their rows are equally long."""
    columns = list(columns)
    rows = [getattr(record, one.attribute) for one in columns if one.along for record in records]
    longest = max(map(len, rows), default=0)
    made = {column.name: column.variable(records, longest) for column in columns}
    return {name: found for name, found in made.items() if found is not None}


def rows_of(columns: Iterable[Column], dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return what records are made from, by their attributes; what is not there is left out."""
    known = [one for one in columns if one.kept and (one.name in dataset or not (one.some or one.along))]
    read = zip(*(column.read(dataset) for column in known), strict=True)
    names = [column.attribute for column in known]
    found = (zip(names, row, strict=True) for row in read)
    return [{name: value for name, value in row if value is not None} for row in found]


LEG = (
    Column("leg_from", "waypoint left", None, int, "start"),
    Column("leg_to", "waypoint headed for", None, int, "goal"),
    Column("leg_t_expected", "expected time, the task included", "s"),
    Column("leg_t_path", "travel time, executed", "s", kept=False),
    Column("leg_t_hold", "time waited for the way to open", "s"),
    Column("leg_t_wait", "time waited for the task's window", "s"),
    Column("leg_t_task", "time of the task", "s"),
    Column("leg_priority", "priority of the task, 0 without one", "1"),
    Column("leg_revisit", "whether the waypoint headed for had been visited before", None, bool),
    Column("leg_missed", "whether the task's window was missed", None, bool),
    Column("leg_arrived", "whether the waypoint was reached", None, bool),
    Column("leg_followed", "which of its plans the leg was begun with", None, int),
    Column(
        "leg_current_difference", "root mean square of the current's forecast error along the track", "m s-1"
    ),
    Column(
        "leg_speed", "speed through the water that the leg is gone at, none where it is the vehicle's",
        "m s-1", some=True,
    ),
    Column(
        "leg_t_fix", "time surfaced for a fix at the waypoint left, part of the time waited there", "s",
        some=True,
    ),
    Column(
        "leg_position_std",
        "standard deviation of the position along each horizontal axis at the leg's end", "m", some=True,
    ),
    Column("leg_risk", "chance of touching coast or an obstacle on the leg, at most", "1", some=True),
)  # fmt: skip
PLAN = (
    Column("plan_lower_bound", "travel time that no path can beat", "s", some=True),
    Column("plan_position", "planned place", "m", np.float32, "positions", along=("sample", "axis")),
    Column("plan_time", "planned time of the sample", TIME_UNITS, np.float64, "times", along=("sample",)),
    Column("plan_made_at", "when it was made", TIME_UNITS),
    Column("plan_cost", "cost of the path (Eq. 12)", "s"),
    Column("plan_feasible", "whether the planner saw every limit kept", None, bool),
    Column("plan_cpu", "wall-clock time of planning", "s"),
    Column("plan_cause", "why it was made", None, PLAN_CAUSES),
)
ROUTE = (
    Column("route_nodes", "waypoints in order of visit; -1 pads", None, int, along=("stop",)),
    Column(
        "route_leg_time", "time expected of the leg from each stop, waiting and task included", "s",
        field="leg_times", along=("stop",),
    ),
    Column("route_wait", "part of it that waits for the task's window", "s", field="waits", along=("stop",)),
    Column(
        "route_speed", "speed through the water of the leg from each stop", "m s-1",
        field="speeds", along=("stop",), some=True,
    ),
    Column(
        "route_energy", "energy expected of the leg from each stop with its task", "J",
        field="energies", along=("stop",), some=True,
    ),
    Column("route_made_at", "when it was made", TIME_UNITS),
    Column("route_time", "expected time", "s"),
    Column("route_priority", "total priority", "1"),
    Column("route_cpu", "wall-clock time of planning", "s"),
    Column("route_cause", "why it was made", None, ROUTE_CAUSES),
)  # fmt: skip
#: What survey lines come to, by the figures of `LinePart`; NaN of legs without one.
_LINE = {
    "length": "length of the part of a survey line that the leg follows, none of others",
    "tolerance": "distance off the line within which it counts as covered",
    "covered": "length of it that is covered",
    "across_mean": "mean distance off the line, where it is covered",
    "across_worst": "greatest distance off the line, where it is covered",
}
_SQUARE = ("waypoint", "waypoint_to")
#: Figures of the graph of tasks by variable: attribute of the graph, dimensions, what they are, units.
_GRAPH = {
    "waypoint_position": ("positions", ("waypoint", "axis"), "place of the waypoint", "m"),
    "task_priority": ("priority", _SQUARE, "priority of the edge's task, 0 without one", "1"),
    "task_duration": ("duration", _SQUARE, "time of the edge's task", "s"),
    "waypoint_priority": (
        "waypoint_priority", "waypoint",
        "part of the priority of edges into the waypoint that belongs to a task there, done once", "1",
    ),
    "waypoint_duration": ("waypoint_duration", "waypoint", "the same part of their time", "s"),
}  # fmt: skip
#: Of tasks along edges: names of the two arrays of their windows, of the second's unit, and what they are.
_ALONG = (
    ("enters", "until", "s", "in one of which the edge is entered and its task is done"),
    ("falls", "drops", "1", "after each of which the task is worth so much less"),
)


def yes_or_no(dims: str | tuple[str, ...], values: ArrayLike, name: str) -> xr.Variable:
    """Truth values as 0 and 1: NetCDF has no type for them."""
    about = {"flag_values": np.asarray([0, 1], np.int8), "flag_meanings": "no yes"}
    return variable(dims, np.asarray(values, bool).astype(np.int8), name, **about)


def flags(names: NDArray[np.str_], known: Sequence[str]) -> tuple[NDArray[np.int8], dict[str, Any]]:
    """Return names as CF flags: codes from 1 in the order of `known`; 0 where there is none."""
    meanings = ["none", *known, *sorted(set(names.ravel()) - {"", "none", *known})]
    code = {meaning: number for number, meaning in enumerate(meanings)} | {"": 0}
    values = np.asarray([code[str(name)] for name in names.ravel()], np.int8).reshape(names.shape)
    return values, {
        "flag_values": np.arange(len(meanings), dtype=np.int8),
        "flag_meanings": " ".join(meaning.replace(" ", "_") for meaning in meanings),
    }


# --- legs --------------------------------------------------------------------------------------------


def leg_variables(legs: Sequence[LegRecord]) -> Variables:
    """Return the table of the legs, their tracks, the true current and the obstacles along them."""
    time = np.concatenate([np.zeros(0), *(leg.times for leg in legs)])
    place = np.concatenate([np.zeros((0, 3)), *(np.reshape(leg.positions, (-1, 3)) for leg in legs)])
    counts = np.asarray([len(leg.times) for leg in legs], np.int32)
    index = np.repeat(np.arange(len(legs), dtype=np.int32), counts)
    words = "observations of the leg; none where it was refused"
    covered = [{} if leg.line is None else leg.line.figures(leg.coverage) for leg in legs]
    lines = {
        f"leg_line_{name}": variable("leg", [float(row.get(name, np.nan)) for row in covered], what, "m")
        for name, what in _LINE.items()
        if any(covered)
    }
    unknown = [np.full((len(leg.times), 2), np.nan) if leg.current is None else leg.current for leg in legs]
    known = np.concatenate([np.zeros((0, 2)), *unknown]).astype(np.float32)
    currents = {
        f"current_{way}": variable(
            "obs", known[:, axis], f"true current {way}wards, from the time to the next one", "m s-1",
            standard_name=f"{way}ward_sea_water_velocity",
        )
        for axis, way in enumerate(("north", "east"))
        if any(leg.current is not None for leg in legs)
    }  # fmt: skip
    return {
        "time": variable(
            "obs", time, "time since the scenario's epoch", TIME_UNITS,
            standard_name="time", calendar="standard", axis="T",
        ),
        # CF calls the eastward coordinate x; this project's x is north.
        "x": variable("obs", place[:, 0], "north", "m", standard_name="projection_y_coordinate", axis="Y"),
        "y": variable("obs", place[:, 1], "east", "m", standard_name="projection_x_coordinate", axis="X"),
        "depth": variable(
            "obs", place[:, 2], "depth below the surface", "m",
            standard_name="depth", positive="down", axis="Z",
        ),
        "leg_index": variable("obs", index, "index of the leg"),
        "trajectory": variable(
            "leg", np.arange(len(legs), dtype=np.int32), "number of the leg", cf_role="trajectory_id"
        ),
        "row_size": variable("leg", counts, words, "1", sample_dimension="obs"),
        **table(LEG, legs),
        **lines,
        **_obstacles(legs),
        **currents,
        **motion_variables("obs", Motion.joined([leg.motion for leg in legs])),
    }  # fmt: skip


def _obstacles(legs: Sequence[LegRecord]) -> Variables:
    """True obstacles along the legs, padded to the leg that has most of them."""
    most = max((len(leg.obstacle_radii) for leg in legs), default=0)
    if most == 0:
        return {}
    tracks = [np.zeros((0, most, 3), np.float32)]
    for leg in legs:
        track = np.full((len(leg.times), most, 3), np.nan, np.float32)
        if len(leg.times):
            track[:, : len(leg.obstacle_radii)] = leg.obstacle_positions
        tracks.append(track)
    kinds = [[*leg.obstacle_kinds, *[""] * (most - len(leg.obstacle_kinds))] for leg in legs]
    codes, about = flags(np.asarray(kinds), KINDS)
    radii = padded([leg.obstacle_radii for leg in legs], np.nan, np.float32, most)
    return {
        "obstacle_position": variable(
            ("obs", "obstacle", "axis"), np.concatenate(tracks), "true place of the obstacle's centre", "m"
        ),
        "obstacle_radius": variable(("leg", "obstacle"), radii, "true radius", "m"),
        "obstacle_kind": variable(("leg", "obstacle"), codes, "kind of obstacle", **about),
    }


def legs_of(dataset: xr.Dataset, model: Current | None) -> list[LegRecord]:
    """Return the legs with their plans.

    Args:
        model: the true current where it is no vortices, which files keep.
    """
    motion, plans = motion_of(dataset), _plans_of(dataset, model)
    refusals = json.loads(dataset.attrs.get("refusals", "[]")) or [""] * len(plans)
    place = np.stack([dataset[name].values for name in ("x", "y", "depth")], axis=1).astype(float)
    ends, counts = np.cumsum(dataset["row_size"].values), dataset["row_size"].values
    codes = dataset.get("obstacle_kind")
    names = [] if codes is None else str(codes.attrs["flag_meanings"]).split()
    places = dataset["waypoint_position"].values.astype(float)
    tolerances = dataset.get("leg_line_tolerance")  # of survey lines
    legs = []
    for row, figures in enumerate(rows_of(LEG, dataset)):
        part = slice(int(ends[row] - counts[row]), int(ends[row]))
        leg = LegRecord(**figures, plans=plans[row], refused=refusals[row])
        leg.times, leg.positions = np.asarray(dataset["time"].values[part], float), place[part]
        leg.motion = motion[part]
        if tolerances is not None and not np.isnan(tolerances.values[row]):
            start, end = (tuple(places[node].tolist()) for node in (leg.start, leg.goal))
            leg.line = LinePart(start, end, float(tolerances.values[row]))
        leg.obstacle_positions = np.zeros((len(leg.times), 0, 3))
        if codes is not None:
            radii = dataset["obstacle_radius"].values[row].astype(float)
            real = np.isfinite(radii)
            leg.obstacle_radii = radii[real]
            leg.obstacle_positions = dataset["obstacle_position"].values[part][:, real].astype(float)
            leg.obstacle_kinds = [names[int(code)] for code in codes.values[row][: real.sum()]]
        if "current_north" in dataset and len(leg.times):
            known = [dataset[f"current_{name}"].values[part] for name in ("north", "east")]
            leg.current = np.stack(known, axis=1).astype(float)
        legs.append(leg)
    return legs


# --- energy ------------------------------------------------------------------------------------------


def energy_variables(run: MissionRun) -> Variables:
    """Return the state of charge along the mission; nothing without a power model and its battery."""
    energy = run.energy
    if energy is None or energy.power.battery is None:
        return {}
    times = np.concatenate([np.zeros(0), *(leg.times for leg in run.legs)])
    words = "share of the battery's usable energy that is left"
    return {"charge": variable("obs", energy.charge_at(times), words, "1")}


def plain_power(power: PowerModel) -> dict[str, Any]:
    """Return a power model as plain data, as `vehicle.power` of a scenario has it.

    Raises:
        ValueError: its propulsion is neither a table nor a law.
    """

    def numbers(part: Any, *apart: str) -> dict[str, Any]:
        names = (entry.name for entry in fields(part) if entry.name not in apart)
        return {name: np.asarray(getattr(part, name), float).tolist() for name in names}

    if not isinstance(power.propulsion, PowerTable | PowerLaw):
        raise ValueError(
            f"a {type(power.propulsion).__name__} cannot be saved: give a PowerTable or a PowerLaw"
        )
    own = {"propulsion": numbers(power.propulsion)}
    own |= {} if power.battery is None else {"battery": numbers(power.battery)}
    return numbers(power, "propulsion", "battery") | own


def plain_navigation(known: Navigation) -> dict[str, float]:
    """Return the navigation of a vehicle at a fix as plain data."""
    found: dict[str, Any] = {entry.name: getattr(known, entry.name) for entry in fields(known)}
    stated = found.keys() - {"way", "unlocked"}
    return {name: float(np.asarray(found[name])) for name in sorted(stated) if found[name] is not None}


# --- plans -------------------------------------------------------------------------------------------


def plan_variables(legs: Sequence[LegRecord]) -> Variables:
    """Return every path plan of every leg."""
    plans = [plan for leg in legs for plan in leg.plans]
    if not plans:
        return {}
    numbers = np.repeat(np.arange(len(legs), dtype=np.int32), [len(leg.plans) for leg in legs])
    motion = Motion.padded([plan.motion for plan in plans], max(len(plan.times) for plan in plans) - 1)
    return {
        "plan_leg": variable("plan", numbers, "index of the leg"),
        **table(PLAN, plans),
        **history_variables([plan.history for plan in plans]),
        **motion_variables(("plan", "segment"), motion, "plan_"),
    }


def _plans_of(dataset: xr.Dataset, model: Current | None) -> list[list[PlanRecord]]:
    """Return the plans of each leg."""
    found: list[list[PlanRecord]] = [[] for _ in range(dataset.sizes["leg"])]
    if "plan_leg" not in dataset:
        return found
    motion, legs = motion_of(dataset, "plan_"), dataset["plan_leg"].values
    for row, figures in enumerate(rows_of(PLAN, dataset)):
        current = vortices_of(dataset, row) or model
        if current is None:
            raise KeyError("the current of a plan")
        own = motion[row, : len(figures["times"]) - 1]
        plan = PlanRecord(**figures, history=history_of(dataset, row), current=current, motion=own)
        found[int(legs[row])].append(plan)
    return found


# --- the graph of tasks ------------------------------------------------------------------------------


def graph_variables(run: MissionRun) -> Variables:
    """Return waypoints and tasks as they were at the start, and when they may be done."""
    graph = run.graph
    found = {
        name: variable(dims, np.asarray(getattr(graph, own), float), words, units)
        for name, (own, dims, words, units) in _GRAPH.items()
    }
    found["adjacency"] = yes_or_no(_SQUARE, np.asarray(graph.adjacency), "whether an edge leads there")
    if (table := graph.timetable) is not None:
        for first, last, unit, what in _ALONG:
            if getattr(table, first).shape[-1]:
                what, dims = f"of the times since the epoch {what}", (*_SQUARE, first)
                found[f"edge_{first}"] = variable(dims, getattr(table, first), f"beginnings {what}", "s")
                found[f"edge_{last}"] = variable(dims, getattr(table, last), f"ends {what}", unit)
        if table.opens.shape[-1]:
            into = np.arange(graph.size) - 1, np.arange(graph.size)  # the same for all edges into a waypoint
            what = "of the times in which the task at the waypoint may begin, since the epoch"
            for name, end in (("opens", "beginnings"), ("closes", "ends")):
                values = getattr(table, name)[into]
                found[f"window_{name}"] = variable(("waypoint", "window"), values, f"{end} {what}", "s")
    if run.followable is not None:
        words = (
            "share of the edge's own task that can be done, known obstacles and the coast being as they are"
        )
        found["task_followable"] = variable(_SQUARE, run.followable, words, "1")
    return found


def graph_of(dataset: xr.Dataset, speed: float, waiting: bool) -> MissionGraph:
    """Return the graph that `graph_variables` wrote; `waiting` says whether missions wait for a window."""
    figures: dict[str, Any] = {own: dataset[name].values for name, (own, *_) in _GRAPH.items()}
    graph = MissionGraph(adjacency=dataset["adjacency"].values.astype(bool), **figures)
    hours = {}
    for name in ("opens", "closes"):
        if f"window_{name}" in dataset:
            values = dataset[f"window_{name}"].values
            hours[name] = np.broadcast_to(values, (graph.size, *values.shape))
    for name in (name for along in _ALONG for name in along[:2]):
        if f"edge_{name}" in dataset:
            hours[name] = dataset[f"edge_{name}"].values
    if not hours:
        return graph
    still = graph.leg_times(speed) - graph.duration
    return graph.with_timetable(Timetable(np.zeros(1), still[None], **hours, waiting=waiting))


# --- what files were read for, as attributes ---------------------------------------------------------


def stated(run: MissionRun) -> dict[str, str]:
    """Return obstacles, closed areas, jobs and names as JSON, which knows no infinity: it is null there."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: plain(part) for name, part in value.items()}
        if isinstance(value, list | tuple):
            return [plain(part) for part in value]
        return None if isinstance(value, float) and math.isinf(value) else value

    found = {
        "known_obstacles": [asdict(obstacle) for obstacle in run.obstacles],
        "assumed": run.assumed,
        "closed_areas": [
            (zone.name, shapely.to_wkt(zone.polygon, rounding_precision=2)) for zone in run.zones
        ],
        "waypoint_names": run.names,
        "refusals": [leg.refused for leg in run.legs],
        "jobs": run.jobs and {
            kind: [asdict(job) for job in getattr(run.jobs, kind)] for kind in ("points", "lines")
        },
        "closures": [
            {"name": area.name, "area": area.outline, "closed": area.spans} for area in run.stated_closures
        ],
        **({} if run.promise is None else {"promise": asdict(run.promise)}),
    }  # fmt: skip
    return {name: json.dumps(plain(value)) for name, value in found.items()}


def read_stated(attributes: dict[str, Any]) -> dict[str, Any]:
    """Return what `stated` wrote by the names of `MissionRun`, but for the areas closed at some hours."""

    def read(name: str, absent: str = "[]") -> Any:
        return _frozen(json.loads(attributes.get(name, absent)))

    def job(kind: type, values: dict[str, Any]) -> Any:
        spans = ((-np.inf if a is None else a, np.inf if b is None else b) for a, b in values["windows"])
        return kind(**(values | {"windows": tuple(spans)}))

    jobs, promise = read("jobs", "null"), read("promise", "null")
    return {
        "obstacles": tuple(
            KnownObstacle(**(one | {"depth_max": np.inf if one["depth_max"] is None else one["depth_max"]}))
            for one in read("known_obstacles")
        ),
        "assumed": read("assumed"),
        "promise": promise
        and Promise(**(promise | {"turns": tuple(TurnBack(**one) for one in promise.get("turns", ()))})),
        "zones": tuple(Zone(name, shapely.from_wkt(text)) for name, text in read("closed_areas")),
        "names": [name for name in json.loads(attributes["waypoint_names"]) if isinstance(name, str)],
        "jobs": jobs and Jobs(
            tuple(job(JobPoint, values) for values in jobs["points"]),
            tuple(job(JobLine, values) for values in jobs["lines"]),
        ),
    }  # fmt: skip


def _frozen(value: Any) -> Any:
    """Return plain data with tuples in place of its lists."""
    if isinstance(value, dict):
        return {name: _frozen(part) for name, part in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value
