"""A saved run as it was: what was planned and executed, for exports and pictures."""

import json
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import xarray as xr
from numpy.typing import NDArray

from auvplan.check.legs import read_legs, require
from auvplan.errors import AuvplanError
from auvplan.files import MISSION, ResultError, read_mission, read_summary
from auvplan.io.area import load_closures, load_truth
from auvplan.io.fields import chart_of, history_of, motion_of, seabed_of, site_of, vortices_of
from auvplan.mission import MissionGraph
from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.mission.survey import LinePart
from auvplan.mission.timetable import Timetable
from auvplan.ocean.closures import Closure, Zone
from auvplan.ocean.currents import Current
from auvplan.ocean.known import KnownObstacle
from auvplan.records import LegRecord, MissionRun, PlanRecord, RouteRecord
from auvplan.scenario.file import validate_scenario
from auvplan.vehicle import VERTICAL_LIMITS, Vehicle


def restore_run(folder: str | Path) -> MissionRun:
    """A saved run with its routes, its plans, how they were searched for, and the currents they were made in.

    Files do not keep `first_route`, the first route as planned, which is None; `bound` is the one that was
    saved. A file without histories leaves `PlanRecord.history` empty. Currents of an ocean
    model's files are read again from where they were.

    Args:
        folder: that `save_run` wrote.

    Raises:
        ResultError: a file is missing, damaged or incomplete; one line that names it.
        ScenarioError, CurrentError and the like: the scenario's own files cannot be read any more.
    """
    summary, dataset = read_summary(folder), read_mission(folder)
    require(summary, dataset, Path(folder))
    attributes = dataset.attrs
    try:
        settings = json.loads(attributes["scenario"])
        names = [name for name in json.loads(attributes["waypoint_names"]) if isinstance(name, str)]
        home = str(attributes["scenario_folder"])
        vehicle = {name.removeprefix("vehicle_"): float(attributes[name]) for name in _limits(attributes)}
        # A limit in the vertical that is not stated is one that the vehicle does not have.
        limits: dict[str, Any] = dict.fromkeys(VERTICAL_LIMITS.values()) | vehicle
        graph = MissionGraph(
            dataset["waypoint_position"].values,
            dataset["adjacency"].values.astype(bool),
            dataset["task_priority"].values,
            dataset["task_duration"].values,
            waypoint_priority=dataset["waypoint_priority"].values,
            waypoint_duration=dataset["waypoint_duration"].values,
        )
        graph = _with_windows(graph, dataset, settings, vehicle["speed"])
        closed = json.loads(attributes.get("closed_areas", "[]"))
        chart = chart_of(dataset)
        run = MissionRun(
            settings,
            int(attributes["seed"]),
            Vehicle(**limits),
            graph,
            chart,
            int(attributes["start"]),
            int(attributes["goal"]),
            float(attributes["t_available"]),
            routes=_routes(dataset),
            legs=_legs(dataset, settings, home),
            t_mission=float(attributes["t_mission"]),
            arrived=bool(attributes["arrived"]),
            reason=str(attributes["reason"]),
            estimate_seconds=float(summary["cpu"].get("travel_times_s", 0.0)),
            charged_compute=float(attributes["charged_compute"]),
            compile_seconds=float(summary["cpu"].get("compile_s", 0.0)),
            folder=home,
            site=site_of(dataset),
            seabed=seabed_of(dataset),
            names=names,
            simulated=bool(attributes.get("simulated", True)),
            departed=float(attributes.get("departed", 0.0)),
            obstacles=tuple(
                _obstacle(stated) for stated in json.loads(attributes.get("known_obstacles", "[]"))
            ),
            assumed=tuple(json.loads(attributes.get("assumed", "[]"))),
            closures=_closures(settings, dataset, home),
            followable=dataset["task_followable"].values if "task_followable" in dataset else None,
            coast=chart_of(dataset, "coast", "coast") or (None if closed else chart),
            zones=tuple(Zone(name, shapely.from_wkt(text)) for name, text in closed),
            jobs=_jobs(json.loads(attributes.get("jobs", "null"))),
            sources=json.loads(attributes.get("sources", "null")),
            saved_bound=float(summary.get("priority_bound", 0.0)),
        )
    except AuvplanError:
        raise
    except Exception as error:  # whatever values of the wrong kind lead to
        line = " ".join(str(error).split())[:200] or type(error).__name__
        raise ResultError(f"{Path(folder) / MISSION}: incomplete ({line})") from None
    return run


def _closures(settings: dict, dataset: xr.Dataset, home: str) -> tuple[Closure, ...]:
    """Return the areas that were closed at some hours, read again from where they were."""
    if not settings["chart"].get("no_go"):
        return ()
    scenario = validate_scenario(settings, "saved scenario")
    departed = float(dataset.attrs.get("departed", 0.0))
    site = site_of(dataset)
    if site is not None and site.epoch is not None:
        site = replace(site, epoch=site.epoch - timedelta(seconds=departed))
    over = departed + float(dataset.attrs["t_available"])
    return tuple(closure.after(departed) for closure in load_closures(scenario, site, home, over))


def _with_windows(graph: MissionGraph, dataset: xr.Dataset, settings: dict, speed: float) -> MissionGraph:
    """Return the graph with the time windows of its tasks, if it has any."""
    hours = {
        name: np.broadcast_to(
            dataset[f"window_{name}"].values, (graph.size, *dataset[f"window_{name}"].shape)
        )
        for name in ("opens", "closes")
        if f"window_{name}" in dataset
    }
    along = ("enters", "until", "falls", "drops")
    hours |= {name: dataset[f"edge_{name}"].values for name in along if f"edge_{name}" in dataset}
    if not hours:
        return graph
    still = graph.leg_times(speed) - graph.duration
    waiting = settings["mission"].get("wait") != "none"
    return graph.with_timetable(Timetable(np.zeros(1), still[None], **hours, waiting=waiting))


def _jobs(stated: dict | None) -> Jobs | None:
    """Return the jobs of a file from JSON."""
    if stated is None:
        return None

    def rest(job: dict) -> tuple[Any, ...]:
        windows = tuple(
            (-np.inf if opens is None else opens, np.inf if closes is None else closes)
            for opens, closes in job["windows"]
        )
        return job["priority"], job["duration"], windows, tuple(map(tuple, job["falls"]))

    points = [JobPoint(job["name"], tuple(job["position"]), *rest(job)) for job in stated["points"]]
    places = [tuple(map(tuple, job["positions"])) for job in stated["lines"]]
    lines = [JobLine(job["name"], at, *rest(job)) for job, at in zip(stated["lines"], places, strict=True)]
    return Jobs(tuple(points), tuple(lines))


def _obstacle(stated: dict) -> KnownObstacle:
    """Return a known obstacle from JSON."""
    deepest = np.inf if stated["depth_max"] is None else float(stated["depth_max"])
    (north, east), (u, v) = stated["position"], stated["velocity"]
    return KnownObstacle(
        stated["name"], (north, east), stated["radius"], stated["depth_min"], deepest, (u, v)
    )


def _limits(attributes: dict) -> list[str]:
    return [name for name in attributes if name.startswith("vehicle_")]


def _routes(dataset: xr.Dataset) -> list[RouteRecord]:
    """Return the routes."""
    if "route_nodes" not in dataset:
        return []
    causes = str(dataset["route_cause"].attrs["flag_meanings"]).split()
    return [
        RouteRecord(
            float(dataset["route_made_at"].values[row]),
            [int(node) for node in nodes if node >= 0],
            float(dataset["route_time"].values[row]),
            float(dataset["route_priority"].values[row]),
            float(dataset["route_cpu"].values[row]),
            causes[int(dataset["route_cause"].values[row])],
            _leg_times(dataset, row, "route_leg_time"),
            _leg_times(dataset, row, "route_wait"),
        )
        for row, nodes in enumerate(dataset["route_nodes"].values)
    ]


def _leg_times(dataset: xr.Dataset, route: int, name: str) -> list[float]:
    """Return what a route expected of its legs, s."""
    if name not in dataset:
        return []
    times = dataset[name].values[route]
    return [float(seconds) for seconds in times if np.isfinite(seconds)]


def _legs(dataset: xr.Dataset, settings: dict, home: str) -> list[LegRecord]:
    """Return the legs with their plans."""
    model = None
    if settings["current"]["source"] in ("file", "harmonic") and "plan_leg" in dataset:
        model = load_truth(validate_scenario(settings, "saved scenario"), home)
    kinds, motion = _kinds(dataset), motion_of(dataset)
    begins = np.cumsum(dataset["row_size"].values) - dataset["row_size"].values
    legs = []
    for number, leg in enumerate(read_legs(dataset)):
        record = LegRecord(
            leg.start, leg.goal, float(dataset["leg_t_expected"].values[number]), leg.t_task, leg.priority
        )
        record.t_hold, record.t_wait, record.missed = leg.t_hold, leg.t_wait, leg.missed
        record.revisit = bool(dataset["leg_revisit"].values[number])
        record.followed = int(dataset["leg_followed"].values[number])
        record.current_difference = float(dataset["leg_current_difference"].values[number])
        record.times, record.positions, record.obstacle_positions = leg.times, leg.positions, leg.obstacles
        record.motion = motion[begins[number] : begins[number] + len(leg.times)]
        record.obstacle_radii, record.obstacle_kinds = leg.radii, kinds[number][: len(leg.radii)]
        record.arrived = leg.arrived
        if "current_north" in dataset and leg.executed:
            part = slice(begins[number], begins[number] + len(leg.times))
            known = [dataset[f"current_{name}"].values[part] for name in ("north", "east")]
            record.current = np.stack(known, axis=1).astype(float)
        record.line = _line(dataset, number)
        record.plans = _plans(dataset, number, model)
        legs.append(record)
    return legs


def _line(dataset: xr.Dataset, leg: int) -> LinePart | None:
    """Return the part of a survey line that a leg follows, or None."""
    if "leg_line_tolerance" not in dataset or np.isnan(dataset["leg_line_tolerance"].values[leg]):
        return None
    places = dataset["waypoint_position"].values.astype(float)
    start, end = (tuple(places[int(dataset[name].values[leg])].tolist()) for name in ("leg_from", "leg_to"))
    return LinePart(start, end, float(dataset["leg_line_tolerance"].values[leg]))


def _plans(dataset: xr.Dataset, leg: int, model: Current | None) -> list[PlanRecord]:
    """Return the plans of a leg."""
    if "plan_leg" not in dataset:
        return []
    causes = str(dataset["plan_cause"].attrs["flag_meanings"]).split()
    motion, plans = motion_of(dataset, "plan_"), []
    bounds = dataset["plan_lower_bound"].values if "plan_lower_bound" in dataset else None
    for row in np.flatnonzero(dataset["plan_leg"].values == leg):
        times = np.asarray(dataset["plan_time"].values[row], float)
        real = np.isfinite(times)
        current = vortices_of(dataset, int(row)) or model
        if current is None:
            raise KeyError("the current of a plan")
        plans.append(
            PlanRecord(
                float(dataset["plan_made_at"].values[row]),
                np.asarray(dataset["plan_position"].values[row], float)[real],
                times[real],
                float(dataset["plan_cost"].values[row]),
                bool(dataset["plan_feasible"].values[row]),
                causes[int(dataset["plan_cause"].values[row])],
                float(dataset["plan_cpu"].values[row]),
                history_of(dataset, int(row)),
                current,
                motion[row, : real.sum() - 1],
                np.nan if bounds is None else float(bounds[row]),
            )
        )
    return plans


def _kinds(dataset: xr.Dataset) -> list[list[str]]:
    """Return names of the kinds of each leg's obstacles."""
    if "obstacle_kind" not in dataset:
        return [[] for _ in range(dataset.sizes["leg"])]
    codes: NDArray[np.int_] = dataset["obstacle_kind"].values
    names = str(dataset["obstacle_kind"].attrs["flag_meanings"]).split()
    return [[names[int(code)] for code in row] for row in codes]
