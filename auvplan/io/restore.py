"""A saved run as it was: what was planned and sailed, for exports and pictures."""

import json
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from auvplan.io.fields import chart_of, motion_of, seabed_of, site_of, vortices_of
from auvplan.io.files import MISSION, ResultError, read_mission, read_summary
from auvplan.io.ledger import read_legs, require
from auvplan.io.scenario_file import validate_scenario
from auvplan.io.waters import load_truth
from auvplan.mission import MissionGraph
from auvplan.ocean.currents import Current
from auvplan.ocean.known import KnownObstacle
from auvplan.vehicle import Vehicle
from auvplan.voyage.records import LegRecord, MissionRun, PlanRecord


def restore_run(folder: str | Path) -> MissionRun:
    """A saved run with its plans and the currents that they were made in.

    Histories of the searches are not kept in files. Currents of an ocean model's files are read again from
    where they were.

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
        graph = MissionGraph(
            dataset["waypoint_position"].values,
            dataset["adjacency"].values.astype(bool),
            dataset["task_priority"].values,
            dataset["task_duration"].values,
            waypoint_priority=dataset["waypoint_priority"].values,
            waypoint_duration=dataset["waypoint_duration"].values,
        )
        run = MissionRun(
            settings,
            int(attributes["seed"]),
            Vehicle(**vehicle),
            graph,
            chart_of(dataset),
            int(attributes["start"]),
            int(attributes["goal"]),
            float(attributes["t_available"]),
            legs=_legs(dataset, settings, home),
            t_mission=float(attributes["t_mission"]),
            arrived=bool(attributes["arrived"]),
            reason=str(attributes["reason"]),
            charged_compute=float(attributes["charged_compute"]),
            folder=home,
            site=site_of(dataset),
            seabed=seabed_of(dataset),
            names=names,
            simulated=bool(attributes.get("simulated", True)),
            obstacles=tuple(_obstacle(told) for told in json.loads(attributes.get("known_obstacles", "[]"))),
        )
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ResultError(f"{Path(folder) / MISSION}: incomplete ({' '.join(str(error).split())})") from None
    return run


def _obstacle(told: dict) -> KnownObstacle:
    """A known obstacle from JSON."""
    deepest = np.inf if told["depth_max"] is None else float(told["depth_max"])
    (north, east), (u, v) = told["position"], told["velocity"]
    return KnownObstacle(told["name"], (north, east), told["radius"], told["depth_min"], deepest, (u, v))


def _limits(attributes: dict) -> list[str]:
    return [name for name in attributes if name.startswith("vehicle_")]


def _legs(dataset: xr.Dataset, settings: dict, home: str) -> list[LegRecord]:
    """The legs with their plans."""
    model = None
    if settings["current"]["source"] == "file" and "plan_leg" in dataset:
        model = load_truth(validate_scenario(settings, "saved scenario"), home)
    kinds, motion = _kinds(dataset), motion_of(dataset)
    begins = np.cumsum(dataset["row_size"].values) - dataset["row_size"].values
    legs = []
    for number, leg in enumerate(read_legs(dataset)):
        record = LegRecord(
            leg.start, leg.goal, float(dataset["leg_t_expected"].values[number]), leg.t_task, leg.priority
        )
        record.revisit = bool(dataset["leg_revisit"].values[number])
        record.followed = int(dataset["leg_followed"].values[number])
        record.current_difference = float(dataset["leg_current_difference"].values[number])
        record.times, record.positions, record.obstacle_positions = leg.times, leg.positions, leg.obstacles
        record.motion = motion[begins[number] : begins[number] + len(leg.times)]
        record.obstacle_radii, record.obstacle_kinds = leg.radii, kinds[number][: len(leg.radii)]
        record.arrived = leg.arrived
        record.plans = _plans(dataset, number, model)
        legs.append(record)
    return legs


def _plans(dataset: xr.Dataset, leg: int, model: Current | None) -> list[PlanRecord]:
    """The plans of a leg."""
    if "plan_leg" not in dataset:
        return []
    causes = str(dataset["plan_cause"].attrs["flag_meanings"]).split()
    motion, plans = motion_of(dataset, "plan_"), []
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
                {},
                current,
                motion[row, : real.sum() - 1],
            )
        )
    return plans


def _kinds(dataset: xr.Dataset) -> list[list[str]]:
    """Names of the kinds of each leg's obstacles."""
    if "obstacle_kind" not in dataset:
        return [[] for _ in range(dataset.sizes["leg"])]
    codes: NDArray[np.int_] = dataset["obstacle_kind"].values
    names = str(dataset["obstacle_kind"].attrs["flag_meanings"]).split()
    return [[names[int(code)] for code in row] for row in codes]
