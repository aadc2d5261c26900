"""An executed mission as files: figures in `summary.json`, the rest in `mission.nc` (CF trajectories)."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from auvplan.files import MISSION, SUMMARY, output_folder, read_mission, write_atomically, write_dataset
from auvplan.io.fields import (
    Variables,
    chart_variables,
    coast_variables,
    history_variables,
    motion_variables,
    seabed_variables,
    variable,
    vortex_variables,
)
from auvplan.mission import MissionGraph
from auvplan.mission.jobs import Jobs
from auvplan.mission.timetable import Timetable
from auvplan.motion import Motion
from auvplan.ocean.closures import Closure
from auvplan.ocean.known import KnownObstacle
from auvplan.records import LegRecord, MissionRun
from auvplan.scenario.provenance import source_digests
from auvplan.schedule import stated_closures
from auvplan.site import Site

#: The scenario's epoch has no date of its own; this one stands for it.
TIME_UNITS = "seconds since 2000-01-01 00:00:00"

#: Names that a flag may take, by their codes from 1; others are added as they appear.
_KINDS = ("static", "afloat", "self-motivated", "known")
#: Why a path or a route was planned.
PLAN_CAUSES = ("leg", "window", "hazard")
ROUTE_CAUSES = ("start", "late", "early", "refused")


def save_run(run: MissionRun, folder: str | Path, sheet: dict[str, Any] | None = None) -> Path:
    """Write `summary.json` and `mission.nc`.

    Args:
        run: as executed.
        folder: created if needed; files of an earlier run are replaced.
        sheet: of the mission, to go into the summary.

    Returns:
        The folder.

    Raises:
        OutputError: one line that names what cannot be written and why.
    """
    target = output_folder(folder)
    write_dataset(to_dataset(run), target / MISSION)
    summary = run.summary() | ({} if sheet is None else {"sheet": sheet})
    text = json.dumps(summary, indent=2) + "\n"
    write_atomically(target / SUMMARY, lambda path: path.write_text(text, encoding="utf-8"))
    return target


def load_run(folder: str | Path) -> xr.Dataset:
    """Return the dataset of a saved run, in memory; times in s since the scenario's epoch.

    Raises:
        ResultError: one line that names the file and what is wrong with it.
    """
    return read_mission(folder)


def to_dataset(run: MissionRun) -> xr.Dataset:
    """Return a run as CF trajectories, one a leg, contiguous and ragged along `obs`."""
    variables = _executed(run) | _legs(run) | _obstacles(run.legs) | _graph(run)
    variables |= (
        _current(run.legs)
        | _routes(run)
        | _executed_motion(run.legs)
        | _plans(run.legs)
        | vortex_variables(run.legs)
    )
    if run.chart is not None:
        variables |= chart_variables(run.chart)
    if run.coast is not None and run.coast is not run.chart:
        variables |= coast_variables(run.coast)
    if run.seabed is not None:
        variables |= seabed_variables(run.seabed)
    if run.site is not None:
        variables |= _places(variables, run.site)
    dataset = xr.Dataset(variables, attrs=_attributes(run))
    known = ("chart_x", "chart_y", "longitude", "latitude")
    places = [name for name in known if name in dataset]
    if run.site is not None and run.site.epoch is not None:
        dated = f"seconds since {run.site.epoch:%Y-%m-%d %H:%M:%S}"
        for name in dataset.variables:
            if dataset[name].attrs.get("units") == TIME_UNITS:
                dataset[name].attrs["units"] = dated
    return dataset.set_coords(["time", "x", "y", "depth", *places])


def _attributes(run: MissionRun) -> dict[str, Any]:
    limits = {limit.name: getattr(run.vehicle, limit.name) for limit in fields(run.vehicle)}
    vehicle = {f"vehicle_{name}": float(limit) for name, limit in limits.items() if limit is not None}
    return {
        "Conventions": "CF-1.11",
        "featureType": "trajectory",
        "title": f"AUV mission, scenario {run.scenario.get('name') or 'unnamed'}, seed {run.seed}",
        "source": f"auvplan {version('auvplan')}, {'simulated' if run.simulated else 'planned'}",
        "simulated": np.int8(run.simulated),
        "departed": float(run.departed),
        "known_obstacles": json.dumps([_plain(obstacle) for obstacle in run.obstacles]),
        "comment": "Local frame: north, east, depth [m]; times count from the scenario's epoch, one without "
        "a date is written as 2000-01-01. Axis order of `axis` dimensions: north, east, down.",
        "auvplan_version": version("auvplan"),
        "scenario": json.dumps(run.scenario),
        "seed": np.int64(run.seed),
        "start": np.int32(run.start),
        "goal": np.int32(run.goal),
        "arrived": np.int8(run.arrived),
        "success": np.int8(run.success),
        "reason": run.reason,
        "t_available": float(run.t_available),
        "t_mission": float(run.t_mission),
        "t_residual": float(run.t_residual),
        "charged_compute": float(run.charged_compute),
        "scenario_folder": run.folder,
        "assumed": json.dumps(run.assumed),
        "coast_reach": run.coast_reach if math.isfinite(run.coast_reach) else 0.0,
        "closed_areas": json.dumps(
            [(zone.name, shapely.to_wkt(zone.polygon, rounding_precision=2)) for zone in run.zones]
        ),
        "waypoint_names": json.dumps(run.names),
        "jobs": json.dumps(None if run.jobs is None else _jobs(run.jobs)),
        "closures": json.dumps([_closed(closure) for closure in stated_closures(run)]),
        "sources": json.dumps(
            source_digests(run.scenario, run.folder) if run.sources is None else run.sources
        ),
        **vehicle,
        **({} if run.site is None else _site_attributes(run.site)),
        **({} if run.seabed is None else {"seabed_clearance": float(np.asarray(run.seabed.clearance))}),
    }


def _site_attributes(site: Site) -> dict[str, Any]:
    """Return where the local frame lies: the azimuthal equidistant projection about a place."""
    dated = {} if site.epoch is None else {"site_epoch": site.epoch.isoformat()}
    return {
        "site_longitude": site.longitude,
        "site_latitude": site.latitude,
        "site_origin": np.asarray(site.origin, float),
        **dated,
    }


def _places(variables: Variables, site: Site) -> Variables:
    """Longitude and latitude of the trajectories."""
    longitude, latitude = site.to_geographic(variables["x"].values, variables["y"].values)
    return {
        "longitude": variable("obs", longitude, "longitude", "degrees_east", standard_name="longitude"),
        "latitude": variable("obs", latitude, "latitude", "degrees_north", standard_name="latitude"),
    }


def _plain(obstacle: KnownObstacle) -> dict[str, Any]:
    """Return an obstacle ready for JSON, which knows no infinity."""
    return {name: None if value == np.inf else value for name, value in asdict(obstacle).items()}


def _jobs(jobs: Jobs) -> dict[str, Any]:
    """Return jobs ready for JSON: moments in s since the departure, null where a window is open."""
    found = {}
    for kind in ("points", "lines"):
        found[kind] = [asdict(job) | {"windows": _spans(job.windows)} for job in getattr(jobs, kind)]
    return found


def _closed(closure: Closure) -> dict[str, Any]:
    """Return areas that are closed at some hours ready for JSON."""
    return {"name": closure.name, "area": closure.outline, "closed": _spans(closure.spans)}


def _spans(spans: Sequence[tuple[float, float]]) -> list[list[float | None]]:
    return [[end if math.isfinite(end) else None for end in span] for span in spans]


def _executed(run: MissionRun) -> Variables:
    """Return the trajectories, all legs in a row."""
    legs = run.legs
    time = np.concatenate([np.zeros(0), *(leg.times for leg in legs)])
    place = np.concatenate([np.zeros((0, 3)), *(np.reshape(leg.positions, (-1, 3)) for leg in legs)])
    index = np.repeat(np.arange(len(legs)), [len(leg.times) for leg in legs])
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
        "leg_index": variable("obs", index.astype(np.int32), "index of the leg"),
    }  # fmt: skip


def _executed_motion(legs: Sequence[LegRecord]) -> Variables:
    """Attitude and velocities along the trajectories, as simulated."""
    return motion_variables("obs", Motion.joined([leg.motion for leg in legs]))


def _current(legs: Sequence[LegRecord]) -> Variables:
    """Return the current along the trajectories, NaN where it is not known; nothing where it nowhere is."""
    if all(leg.current is None for leg in legs):
        return {}
    parts = [np.full((len(leg.times), 2), np.nan) if leg.current is None else leg.current for leg in legs]
    values = np.concatenate([np.zeros((0, 2)), *parts]).astype(np.float32)
    return {
        f"current_{name}": variable(
            "obs", values[:, axis], f"true current {name}wards, from the time to the next one", "m s-1",
            standard_name=f"{name}ward_sea_water_velocity",
        )
        for axis, name in enumerate(("north", "east"))
    }  # fmt: skip


def _legs(run: MissionRun) -> Variables:
    """Return the leg table."""
    legs = run.legs

    def column(values: list, name: str, units: str | None = None, dtype: Any = float) -> xr.Variable:
        return variable("leg", np.asarray(values, dtype), name, units)

    rows = column(
        [len(leg.times) for leg in legs], "observations of the leg; none where it was refused", "1", np.int32
    )
    rows.attrs["sample_dimension"] = "obs"
    identity = column(list(range(len(legs))), "number of the leg", dtype=np.int32)
    identity.attrs["cf_role"] = "trajectory_id"
    return {
        "trajectory": identity,
        "row_size": rows,
        "leg_from": column([leg.start for leg in legs], "waypoint left", dtype=np.int32),
        "leg_to": column([leg.goal for leg in legs], "waypoint headed for", dtype=np.int32),
        "leg_t_expected": column([leg.t_expected for leg in legs], "expected time, the task included", "s"),
        "leg_t_path": column([leg.t_path for leg in legs], "travel time, executed", "s"),
        "leg_t_hold": column([leg.t_hold for leg in legs], "time waited for the way to open", "s"),
        "leg_t_wait": column([leg.t_wait for leg in legs], "time waited for the task's window", "s"),
        "leg_t_task": column([leg.t_task for leg in legs], "time of the task", "s"),
        "leg_priority": column([leg.priority for leg in legs], "priority of the task, 0 without one", "1"),
        "leg_revisit": _yes_or_no(
            "leg", [leg.revisit for leg in legs], "whether the waypoint headed for had been visited before"
        ),
        "leg_missed": _yes_or_no("leg", [leg.missed for leg in legs], "whether the task's window was missed"),
        **_lines(legs),
        "leg_arrived": _yes_or_no("leg", [leg.arrived for leg in legs], "whether the waypoint was reached"),
        "leg_followed": column(
            [leg.followed for leg in legs], "which of its plans the leg was begun with", dtype=np.int32
        ),
        "leg_current_difference": column(
            [leg.current_difference for leg in legs],
            "root mean square of the current's forecast error along the track",
            "m s-1",
        ),
    }


def _lines(legs: Sequence[LegRecord]) -> Variables:
    """Return what of survey lines was covered; nothing where there is none."""
    if not any(leg.line for leg in legs):
        return {}
    rows = [{} if leg.line is None else leg.line.figures(leg.coverage) for leg in legs]
    words = {
        "length": "length of the part of a survey line that the leg follows, none of others",
        "tolerance": "distance off the line within which it counts as covered",
        "covered": "length of it that is covered",
        "across_mean": "mean distance off the line, where it is covered",
        "across_worst": "greatest distance off the line, where it is covered",
    }
    return {
        f"leg_line_{name}": variable("leg", [float(row.get(name, np.nan)) for row in rows], words[name], "m")
        for name in words
    }


def _obstacles(legs: Sequence[LegRecord]) -> Variables:
    """True obstacles along the legs, padded to the leg that has most of them."""
    most = max((len(leg.obstacle_radii) for leg in legs), default=0)
    if most == 0:
        return {}
    radii = np.full((len(legs), most), np.nan, np.float32)
    kinds = [[""] * most for _ in legs]
    tracks = [np.zeros((0, most, 3), np.float32)]
    for row, leg in enumerate(legs):
        count = len(leg.obstacle_radii)
        radii[row, :count] = leg.obstacle_radii
        kinds[row][:count] = leg.obstacle_kinds
        track = np.full((len(leg.times), most, 3), np.nan, np.float32)
        if len(leg.times):
            track[:, :count] = leg.obstacle_positions
        tracks.append(track)
    codes, flags = _flags(np.asarray(kinds), _KINDS)
    return {
        "obstacle_position": variable(
            ("obs", "obstacle", "axis"), np.concatenate(tracks), "true place of the obstacle's centre", "m"
        ),
        "obstacle_radius": variable(("leg", "obstacle"), radii, "true radius", "m"),
        "obstacle_kind": variable(("leg", "obstacle"), codes, "kind of obstacle", **flags),
    }


def _graph(run: MissionRun) -> Variables:
    """Waypoints and tasks as they were at the start."""
    square = ("waypoint", "waypoint_to")
    graph = run.graph
    return {
        "waypoint_position": variable(
            ("waypoint", "axis"), np.asarray(graph.positions, float), "place of the waypoint", "m"
        ),
        "adjacency": _yes_or_no(square, np.asarray(graph.adjacency), "whether an edge leads there"),
        "task_priority": variable(
            square, np.asarray(graph.priority, float), "priority of the edge's task, 0 without one", "1"
        ),
        "task_duration": variable(square, np.asarray(graph.duration, float), "time of the edge's task", "s"),
        "waypoint_priority": variable(
            "waypoint",
            np.asarray(graph.waypoint_priority, float),
            "part of the priority of edges into the waypoint that belongs to a task there, done once",
            "1",
        ),
        "waypoint_duration": variable(
            "waypoint", np.asarray(graph.waypoint_duration, float), "the same part of their time", "s"
        ),
        **_windows(graph),
        **_followable(run),
    }


def _followable(run: MissionRun) -> Variables:
    """Return what share of tasks along survey lines can be done; nothing where there is no line."""
    if run.followable is None:
        return {}
    words = "share of the edge's own task that can be done, known obstacles and the coast being as they are"
    return {"task_followable": variable(("waypoint", "waypoint_to"), run.followable, words, "1")}


def _windows(graph: MissionGraph) -> Variables:
    """Return when tasks may be done and are worth less; nothing where all may at any time."""
    if graph.timetable is None:
        return {}
    table, along = graph.timetable, {}
    words = {
        ("enters", "until"): "in one of which the edge is entered and its task is done",
        ("falls", "drops"): "after each of which the task is worth so much less",
    }
    for (first, last), what in words.items():
        if getattr(table, first).shape[-1]:
            dims, unit = ("waypoint", "waypoint_to", first), "1" if last == "drops" else "s"
            what = f"{{}} of the times since the epoch {what}"
            along[f"edge_{first}"] = variable(dims, getattr(table, first), what.format("beginnings"), "s")
            along[f"edge_{last}"] = variable(dims, getattr(table, last), what.format("ends"), unit)
    return along | _windows_at(graph, table)


def _windows_at(graph: MissionGraph, table: Timetable) -> Variables:
    """Return when tasks at waypoints may begin."""
    if not table.opens.shape[-1]:
        return {}
    into = np.arange(graph.size) - 1, np.arange(graph.size)  # the same for all edges into a waypoint
    words = "beginnings", "ends"
    return {
        f"window_{name}": variable(
            ("waypoint", "window"), getattr(table, name)[into],
            f"{word} of the times in which the task at the waypoint may begin, since the epoch", "s",
        )
        for name, word in zip(("opens", "closes"), words, strict=True)
    }  # fmt: skip


def _routes(run: MissionRun) -> Variables:
    """Return the first route and every re-plan."""
    routes = run.routes
    if not routes:
        return {}
    nodes = np.full((len(routes), max(len(route.nodes) for route in routes)), -1, np.int32)
    legs, waits = np.full(nodes.shape, np.nan), np.full(nodes.shape, np.nan)
    for row, route in enumerate(routes):
        nodes[row, : len(route.nodes)] = route.nodes
        legs[row, : len(route.leg_times)] = route.leg_times
        waits[row, : len(route.waits)] = route.waits
    codes, flags = _flags(np.asarray([route.cause for route in routes]), ROUTE_CAUSES)
    return {
        "route_nodes": variable(("route", "stop"), nodes, "waypoints in order of visit; -1 pads"),
        "route_leg_time": variable(
            ("route", "stop"), legs, "time expected of the leg from each stop, waiting and task included", "s"
        ),
        "route_wait": variable(("route", "stop"), waits, "part of it that waits for the task's window", "s"),
        "route_made_at": variable(
            "route", [route.made_at for route in routes], "when it was made", TIME_UNITS
        ),
        "route_time": variable("route", [route.time for route in routes], "expected time", "s"),
        "route_priority": variable("route", [route.priority for route in routes], "total priority", "1"),
        "route_cpu": variable("route", [route.cpu for route in routes], "wall-clock time of planning", "s"),
        "route_cause": variable("route", codes, "why it was made", **flags),
    }


def _plans(legs: Sequence[LegRecord]) -> Variables:
    """Return every path plan of every leg."""
    plans = [(row, plan) for row, leg in enumerate(legs) for plan in leg.plans]
    if not plans:
        return {}
    most = max(len(plan.times) for _, plan in plans)
    places = np.full((len(plans), most, 3), np.nan, np.float32)
    times = np.full((len(plans), most), np.nan)
    for row, (_, plan) in enumerate(plans):
        places[row, : len(plan.times)] = plan.positions
        times[row, : len(plan.times)] = plan.times
    codes, flags = _flags(np.asarray([plan.cause for _, plan in plans]), PLAN_CAUSES)
    bounds, bounded = np.asarray([plan.lower_bound for _, plan in plans]), {}
    if np.isfinite(bounds).any():
        bounded["plan_lower_bound"] = variable("plan", bounds, "travel time that no path can beat", "s")
    return {
        **bounded,
        "plan_position": variable(("plan", "sample", "axis"), places, "planned place", "m"),
        "plan_time": variable(("plan", "sample"), times, "planned time of the sample", TIME_UNITS),
        "plan_leg": variable("plan", np.asarray([row for row, _ in plans], np.int32), "index of the leg"),
        "plan_made_at": variable("plan", [plan.made_at for _, plan in plans], "when it was made", TIME_UNITS),
        "plan_cost": variable("plan", [plan.cost for _, plan in plans], "cost of the path (Eq. 12)", "s"),
        "plan_feasible": _yes_or_no(
            "plan", [plan.feasible for _, plan in plans], "whether the planner saw every limit kept"
        ),
        "plan_cpu": variable("plan", [plan.cpu for _, plan in plans], "wall-clock time of planning", "s"),
        "plan_cause": variable("plan", codes, "why it was made", **flags),
        **history_variables([plan.history for _, plan in plans]),
        **motion_variables(
            ("plan", "segment"), Motion.padded([plan.motion for _, plan in plans], most - 1), "plan_"
        ),
    }


def _yes_or_no(dims: str | tuple[str, ...], values: ArrayLike, name: str) -> xr.Variable:
    """Truth values as 0 and 1: NetCDF has no type for them."""
    flags = {"flag_values": np.asarray([0, 1], np.int8), "flag_meanings": "no yes"}
    return variable(dims, np.asarray(values, bool).astype(np.int8), name, **flags)


def _flags(names: NDArray[np.str_], known: Sequence[str]) -> tuple[NDArray[np.int8], dict[str, Any]]:
    """Return names as CF flags: codes from 1 in the order of `known`; 0 where there is none."""
    meanings = ["none", *known, *sorted(set(names.ravel()) - {"", "none", *known})]
    code = {meaning: number for number, meaning in enumerate(meanings)} | {"": 0}
    values = np.asarray([code[str(name)] for name in names.ravel()], np.int8).reshape(names.shape)
    return values, {
        "flag_values": np.arange(len(meanings), dtype=np.int8),
        "flag_meanings": " ".join(meaning.replace(" ", "_") for meaning in meanings),
    }
