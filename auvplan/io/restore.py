"""A saved run as it was: what was planned and executed, for exports and pictures."""

import json
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import xarray as xr

from auvplan.check.saved import require
from auvplan.errors import AuvplanError, reason_of
from auvplan.io.area import AreaFiles, load_closures
from auvplan.io.fields import chart_of, seabed_of, site_of
from auvplan.io.results import OF_RUN
from auvplan.io.schema import ROUTE, graph_of, legs_of, read_stated, rows_of
from auvplan.navigation import Navigation
from auvplan.records import MissionRun, RouteRecord
from auvplan.runtime.files import MISSION, ResultError, read_mission, read_summary
from auvplan.scenario.file import validate_scenario
from auvplan.scenario.power import PowerSettings
from auvplan.scenario.provenance import changed_source
from auvplan.scenario.vehicles import power_model
from auvplan.vehicle import VERTICAL_LIMITS, Vehicle


def restore_run(folder: str | Path) -> MissionRun:
    """A saved run with its routes, its plans, how they were searched for, and the currents they were made in.

    Files do not keep `first_route`, the first route as planned, which is None; `bound` is the one that was
    saved. A file without histories leaves `PlanRecord.history` empty. Currents of an ocean
    model's files are read again from where they were.

    Args:
        folder: that `save_run` wrote.

    Raises:
        ResultError: a file is missing, damaged or incomplete, or one that is read again is not what the run
            was made from; one line that names it.
        ScenarioError, CurrentError and the like: the scenario's own files cannot be read any more.
    """
    summary, dataset = read_summary(folder), read_mission(folder)
    require(summary, dataset, Path(folder))
    try:
        return _run_of(summary, dataset, Path(folder))
    except AuvplanError:
        raise
    except Exception as error:  # whatever values of the wrong kind lead to
        raise ResultError(f"{Path(folder) / MISSION}: incomplete ({reason_of(error)})") from None


def _run_of(summary: dict[str, Any], dataset: xr.Dataset, folder: Path) -> MissionRun:
    attributes = dataset.attrs
    settings, home = json.loads(attributes["scenario"]), str(attributes["scenario_folder"])
    sources, current = json.loads(attributes.get("sources", "null")), settings["current"]
    # Currents and closed areas are read from files: from those that the run was made from alone.
    read = {
        "current": {name: current.get(name) for name in ("files", "constituents", "truth")},
        "chart": {"no_go": settings["chart"].get("no_go")},
    }
    if sources is not None and (changed := changed_source(sources, read, home)):
        line = "put back what the run was made from, or make the run again"
        raise ResultError(f"{folder / MISSION}: {changed}: {line}")
    power, reckons = (json.loads(attributes.get(name, "null")) for name in ("power_model", "navigation"))
    prefix = "vehicle_"
    stated = {k.removeprefix(prefix): float(v) for k, v in attributes.items() if k.startswith(prefix)}
    # A limit in the vertical that is not stated is one that the vehicle does not have.
    limits: dict[str, Any] = dict.fromkeys(VERTICAL_LIMITS.values()) | stated
    model = None
    if current["source"] in ("file", "harmonic") and "plan_leg" in dataset:
        model = AreaFiles(validate_scenario(settings, "saved scenario"), home).true_current
    site, closures = site_of(dataset), ()
    if settings["chart"].get("no_go"):  # areas that were closed at some hours are read again
        departed = float(attributes.get("departed", 0.0))
        at = site and replace(site, epoch=site.epoch and site.epoch - timedelta(seconds=departed))
        until = departed + float(attributes["t_available"])
        found = load_closures(validate_scenario(settings, "saved scenario"), at, home, until, departed)
        closures = tuple(closure.after(departed) for closure in found)
    known, chart = read_stated(attributes), chart_of(dataset)
    waiting = settings["mission"].get("wait") != "none"
    # Two of them are younger than the others: files without them are of simulated missions.
    young = {"simulated", "departed"} - attributes.keys()
    own = {name: kind(attributes[name]) for name, kind in OF_RUN.items() if name not in young}
    return MissionRun(
        settings,
        vehicle=Vehicle(
            **limits,
            power=power_model(power and PowerSettings.model_validate(power)),
            navigation=None if reckons is None else Navigation(**reckons),
        ),
        graph=graph_of(dataset, stated["speed"], waiting),
        chart=chart,
        routes=[RouteRecord(**row) for row in rows_of(ROUTE, dataset)] if "route_nodes" in dataset else [],
        legs=legs_of(dataset, model),
        estimate_seconds=float(summary["cpu"].get("travel_times_s", 0.0)),
        compile_seconds=float(summary["cpu"].get("compile_s", 0.0)),
        folder=home,
        site=site,
        seabed=seabed_of(dataset),
        closures=closures,
        followable=dataset["task_followable"].values if "task_followable" in dataset else None,
        coast=chart_of(dataset, "coast", "coast") or (None if known["zones"] else chart),
        sources=sources,
        saved_bound=float(summary.get("priority_bound", 0.0)),
        **own,
        **known,
    )
