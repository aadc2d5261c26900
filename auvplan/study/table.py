"""All missions of a study as one dataset with CF attributes: a row a mission, legs and calls padded."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from auvplan.check.run import check_dataset
from auvplan.io.fields import chart_variables
from auvplan.io.results import to_dataset
from auvplan.io.schema import LEG, PLAN, ROUTE, TIME_UNITS, Column, padded
from auvplan.ocean.chart import UNCERTAIN_MAX, Chart
from auvplan.records import MissionRun
from auvplan.runtime.files import ResultError
from auvplan.study.design import Design

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


#: Columns of a run's legs, plans and routes that a study keeps as well, in its order.
_KEPT = {
    column.name: column
    for column in (*LEG, *PLAN, *ROUTE)
    if column.name in {
        "leg_from", "leg_to", "leg_t_expected", "leg_t_path", "leg_t_task", "leg_priority", "leg_revisit",
        "leg_arrived", "plan_cause", "plan_cost", "plan_cpu", "route_made_at", "route_time", "route_priority",
        "route_cause", "route_cpu",
    }
}  # fmt: skip


def _of(column: Column) -> Variable:
    """Return a run's column as a study has it."""
    dims, kind = (column.name.split("_")[0],), column.kind
    units = "s" if column.units == TIME_UNITS else column.units
    fill = np.nan if kind is float else 0 if isinstance(kind, tuple) else -1
    meanings = kind if isinstance(kind, tuple) else ("yes",) if kind is bool else ()
    words = column.words + "; -1 pads" * (kind is bool)
    return Variable(dims, words, units, fill, column.name.endswith("_cpu"), meanings)


#: Every variable of a row.
VARIABLES = {
    "t_available": Variable((), "available time", "s"),
    "t_mission": Variable((), "time of the mission", "s"),
    "t_residual": Variable((), "time left at the end", "s"),
    "success": Variable((), "destination reached with time left", fill=-1, meanings=("yes",)),
    "reason": Variable((), "how the mission ended", fill=""),
    "tasks": Variable((), "tasks done", "1", -1),
    "total_priority": Variable((), "total priority of the tasks done", "1"),
    "priority_bound": Variable((), "bound on the total priority of the mission", "1"),
    "revisits": Variable((), "waypoints visited again", "1", -1),
    "path_calls": Variable((), "legs planned", "1", -1),
    "path_replans": Variable((), "paths re-planned on the way", "1", -1),
    "mission_replans": Variable((), "routes re-planned", "1", -1),
    "cost_mission": Variable((), "cost of the mission as done (Eq. 15)", "1"),
    "cost_total": Variable((), "the same with the computing time of re-plans (Eq. 16)", "1", clock=True),
    "collisions": Variable((), "collisions found by the independent checker", "1", -1),
    "faults": Variable((), "faults found by the independent checker", "1", -1),
    "coast_clearance": Variable((), "least distance to the coast; infinite without one", "m"),
    "obstacle_clearance": Variable((), "least distance to an obstacle; infinite without one", "m"),
    "seabed_altitude": Variable((), "least altitude above the sea bed; infinite without one", "m"),
    "length": Variable((), "length travelled", "m"),
    "path_cpu": Variable((), "wall-clock time of all path planning calls", "s", clock=True),
    "mission_cpu": Variable((), "wall-clock time of all mission planning calls", "s", clock=True),
    "mission_replan_cpu": Variable(
        (), "wall-clock time of mission re-planning, sum of T_compute", "s", clock=True
    ),
    "travel_time_cpu": Variable((), "wall-clock time of all estimates of travel times", "s", clock=True),
    **{name: _of(column) for name, column in _KEPT.items()},
    "leg_path_replans": Variable(("leg",), "paths re-planned on the way", "1", -1),
    "leg_distance": Variable(("leg",), "straight line between the waypoints", "m"),
    "leg_line_covered": Variable(("leg",), "length covered of a survey line", "m"),
    "leg_cpu": Variable(("leg",), "wall-clock time of the leg's path planning calls", "s", clock=True),
    "plan_leg": Variable(("plan",), "index of the leg; -1 pads", fill=-1),
    "route_nodes": Variable(("route", "stop"), "waypoints in order of visit; -1 pads", fill=-1),
    "waypoint_position": Variable(("waypoint", "axis"), "place of the waypoint: north, east, down", "m"),
}


def row_of(run: MissionRun) -> Row:
    """Return the figures of a mission that was executed, by the names of `VARIABLES`.

    The checker walks it first.
    """
    summary, legs, routes = run.summary(), run.legs, run.routes
    report = check_dataset(summary, to_dataset(run))
    records = {"leg": legs, "plan": [plan for leg in legs for plan in leg.plans], "route": routes}
    places = np.asarray(run.graph.positions, float)
    ends = np.asarray([(leg.start, leg.goal) for leg in legs], np.int32).reshape(-1, 2)
    cpu = {name.removesuffix("_s"): value for name, value in summary["cpu"].items()}
    figures = summary | {
        "collisions": report.collisions,
        "faults": len(report.faults),
        "coast_clearance": report.coast_clearance,
        "obstacle_clearance": report.obstacle_clearance,
        "seabed_altitude": report.seabed_altitude,
        "length": report.length,
        "path_cpu": cpu["path"],
        "mission_cpu": cpu["mission"],
        "mission_replan_cpu": cpu["mission_replans"],
        "travel_time_cpu": cpu["travel_times"],
        "leg_path_replans": [leg.path_replans for leg in legs],
        "leg_distance": np.linalg.norm(places[ends[:, 1]] - places[ends[:, 0]], axis=1),
        "leg_line_covered": [leg.coverage.length if leg.coverage else 0.0 for leg in legs],
        "leg_cpu": [leg.cpu for leg in legs],
        "plan_leg": np.repeat(np.arange(len(legs)), [len(leg.plans) for leg in legs]),
        "route_nodes": padded([route.nodes for route in routes], -1) if routes else np.zeros((0, 0)),
        "waypoint_position": places,
    }
    row = {name: column.values(records[name.split("_")[0]]) for name, column in _KEPT.items()}
    for name in VARIABLES.keys() - row.keys() - {"reason"}:
        counts = VARIABLES[name].fill == -1
        row[name] = np.asarray(figures[name], np.int32 if counts else float)
    return row | {"reason": np.asarray(summary["reason"])}


def table(design: Design, rows: Sequence[Row], chart: Chart | None) -> xr.Dataset:
    """Return the dataset of a finished study; `rows` are those of `Design.tasks`, in their order."""
    lead = (*(sweep.dim for sweep in design.sweeps), "mission")
    shape = (*design.shape, design.count)
    variables = {
        name: _variable(variable, [row[name] for row in rows], lead, shape)
        for name, variable in VARIABLES.items()
    }
    coords: dict[str, xr.Variable] = {}
    for sweep in design.sweeps:  # other than numbers as their text
        numbers = all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in sweep.values
        )
        kind = float if numbers else object
        values = np.asarray(sweep.values if numbers else [str(value) for value in sweep.values], kind)
        named = {"long_name": sweep.field, "field": sweep.field}
        coords[sweep.dim] = xr.Variable(sweep.dim, values, named)
    coords["seed"] = xr.Variable("mission", np.asarray(design.seeds), {"long_name": "seed of the mission"})
    if chart is not None:
        variables |= chart_variables(chart)
    return xr.Dataset(variables, coords, _attributes(design))


def rows_of(dataset: xr.Dataset) -> list[Row]:
    """Return the missions of a study's dataset, in the order of `Design.tasks`, padded as they are there."""
    planes = {}
    for name, variable in VARIABLES.items():
        if name not in dataset:
            raise ResultError(f"the study has no variable {name}, and cannot be extended")
        values = dataset[name].values
        planes[name] = values.reshape(-1, *values.shape[values.ndim - len(variable.dims) :])
    return [
        {name: np.asarray(plane[row]) for name, plane in planes.items()}
        for row in range(dataset["success"].size)
    ]


def _variable(
    variable: Variable, values: Sequence[np.ndarray], lead: tuple[str, ...], shape: tuple[int, ...]
) -> xr.Variable:
    """Return the missions' arrays, padded to the longest."""
    longest = np.max([value.shape for value in values], axis=0).astype(int)
    kind = object if values[0].dtype.kind in "UO" else values[0].dtype
    if variable.meanings:
        kind = np.int8
    padded = np.full((len(values), *longest), variable.fill, kind)
    for row, value in zip(padded, values, strict=True):
        if longest.size:
            row[tuple(slice(length) for length in value.shape)] = value
    if not longest.size:
        padded[:] = [value.item() for value in values]
    attrs: dict[str, Any] = {"long_name": variable.long_name}
    if variable.units:
        attrs["units"] = variable.units
    if variable.meanings:
        names = ("no" if variable.meanings == ("yes",) else "none", *variable.meanings)
        attrs["flag_values"] = np.arange(len(names), dtype=np.int8)
        attrs["flag_meanings"] = " ".join(name.replace(" ", "_") for name in names)
    if variable.clock:
        attrs["comment"] = "wall-clock time: differs from run to run"
    return xr.Variable(lead + variable.dims, padded.reshape(*shape, *longest), attrs)


def _attributes(design: Design) -> dict[str, Any]:
    plain = design.plain()
    name = design.scenario.name or "unnamed"
    return {
        "Conventions": "CF-1.11",
        "title": f"AUV missions, scenario {name}, seeds {design.seed} to {design.seeds[-1]}",
        "source": f"auvplan {version('auvplan')}, simulated",
        "comment": "Local frame: north, east, depth [m] from an origin that is not georeferenced.",
        "auvplan_version": version("auvplan"),
        "versions": json.dumps({name: version(name) for name in ("auvplan", "jax", "numpy", "xarray")}),
        "scenario": json.dumps(plain["scenario"]),
        "sweeps": json.dumps(plain["sweeps"]),
        "sweep": ",".join(sweep.dim for sweep in design.sweeps),
        "first_seed": np.int64(design.seed),
        "missions": np.int64(design.count),
    }


def without_clocks(dataset: xr.Dataset) -> xr.Dataset:
    """Return the dataset without wall-clock times: what a second run repeats to the last bit."""
    return dataset.drop_vars([name for name, variable in VARIABLES.items() if variable.clock])


def flag_names(variable: xr.DataArray) -> list[str]:
    """Return the names of a row of flags; empty ones where the file does not define them."""
    meanings = str(variable.attrs.get("flag_meanings", "")).split()
    names = dict(zip(np.atleast_1d(variable.attrs.get("flag_values", [])).tolist(), meanings, strict=False))
    return [names.get(int(code), "") for code in variable.values]


def study_chart(dataset: xr.Dataset) -> Chart | None:
    """Return the chart that all missions share; None for open water.

    Stored steps may miss the values of a chart by rounding.
    """
    if "passability" not in dataset:
        return None
    north, east = dataset["chart_x"].values, dataset["chart_y"].values
    raster = np.nan_to_num(dataset["passability"].values, nan=1.0)
    raster = np.where(raster > 0.99, 1.0, np.clip(raster, 0.0, UNCERTAIN_MAX))
    size = float(north[1] - north[0]) if len(north) > 1 else float(east[-1] - east[0]) / max(len(east) - 1, 1)
    return Chart.from_passability(raster, size, (float(north[0]) - 0.5 * size, float(east[0]) - 0.5 * size))
