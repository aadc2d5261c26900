"""An executed mission as files: figures in `summary.json`, the rest in `mission.nc` (CF trajectories)."""

import json
import math
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from auvplan.io import schema
from auvplan.io.fields import chart_variables, coast_variables, seabed_variables, variable, vortex_variables
from auvplan.records import MissionRun
from auvplan.runtime.files import MISSION, SUMMARY, output_folder, read_mission, write_dataset, write_json
from auvplan.scenario.provenance import source_digests

#: Attributes of a file that are the run's own, by their types: in the run and, where it differs, in the file.
OF_RUN: dict[str, type] = {
    "simulated": bool, "departed": float, "seed": int, "start": int, "goal": int, "arrived": bool,
    "reason": str, "t_available": float, "t_mission": float, "charged_compute": float,
}  # fmt: skip
_FILED = {"simulated": np.int8, "seed": np.int64, "start": np.int32, "goal": np.int32, "arrived": np.int8}


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
    write_json(target / SUMMARY, summary)
    return target


def load_run(folder: str | Path) -> xr.Dataset:
    """Return the dataset of a saved run, in memory; times in s since the scenario's epoch.

    Raises:
        ResultError: one line that names the file and what is wrong with it.
    """
    return read_mission(folder)


def to_dataset(run: MissionRun) -> xr.Dataset:
    """Return a run as CF trajectories, one a leg, contiguous and ragged along `obs`."""
    variables = schema.leg_variables(run.legs) | schema.energy_variables(run) | schema.graph_variables(run)
    variables |= schema.table(schema.ROUTE, run.routes) if run.routes else {}
    variables |= schema.plan_variables(run.legs) | vortex_variables(run.legs)
    if run.chart is not None:
        variables |= chart_variables(run.chart)
    if run.coast is not None and run.coast is not run.chart:
        variables |= coast_variables(run.coast)
    if run.seabed is not None:
        variables |= seabed_variables(run.seabed)
    if run.site is not None:
        longitude, latitude = run.site.to_geographic(variables["x"].values, variables["y"].values)
        east, north = {"standard_name": "longitude"}, {"standard_name": "latitude"}
        variables["longitude"] = variable("obs", longitude, "longitude", "degrees_east", **east)
        variables["latitude"] = variable("obs", latitude, "latitude", "degrees_north", **north)
    dataset = xr.Dataset(variables, attrs=_attributes(run))
    if run.site is not None and run.site.epoch is not None:
        dated = f"seconds since {run.site.epoch:%Y-%m-%d %H:%M:%S}"
        for name in dataset.variables:
            if dataset[name].attrs.get("units") == schema.TIME_UNITS:
                dataset[name].attrs["units"] = dated
    places = ("time", "x", "y", "depth", "chart_x", "chart_y", "longitude", "latitude")
    return dataset.set_coords([name for name in places if name in dataset])


def _attributes(run: MissionRun) -> dict[str, Any]:
    limits = {limit.name: getattr(run.vehicle, limit.name) for limit in fields(run.vehicle)}
    for apart in ("power", "navigation"):
        limits.pop(apart)
    power, known = run.vehicle.power, run.vehicle.navigation
    place: dict[str, Any] = {}
    if (site := run.site) is not None:  # the azimuthal equidistant projection about a place
        place = {"site_longitude": site.longitude, "site_latitude": site.latitude}
        place["site_origin"] = np.asarray(site.origin, float)
        if site.epoch is not None:
            place["site_epoch"] = site.epoch.isoformat()
    sources = source_digests(run.scenario, run.folder) if run.sources is None else run.sources
    return {
        "Conventions": "CF-1.11",
        "featureType": "trajectory",
        "title": f"AUV mission, scenario {run.scenario.get('name') or 'unnamed'}, seed {run.seed}",
        "source": f"auvplan {version('auvplan')}, {'simulated' if run.simulated else 'planned'}",
        "comment": "Local frame: north, east, depth [m]; times count from the scenario's epoch, one without "
        "a date is written as 2000-01-01. Axis order of `axis` dimensions: north, east, down.",
        "auvplan_version": version("auvplan"),
        "scenario": json.dumps(run.scenario),
        "scenario_folder": run.folder,
        **{name: _FILED.get(name, kind)(getattr(run, name)) for name, kind in OF_RUN.items()},
        "success": np.int8(run.success),
        "t_residual": float(run.t_residual),
        "coast_reach": run.coast_reach if math.isfinite(run.coast_reach) else 0.0,
        **schema.stated(run),
        "sources": json.dumps(sources),
        **{f"vehicle_{name}": float(limit) for name, limit in limits.items() if limit is not None},
        **({} if power is None else {"power_model": json.dumps(schema.plain_power(power))}),
        **({} if known is None else {"navigation": json.dumps(schema.plain_navigation(known))}),
        **place,
        **({} if run.seabed is None else {"seabed_clearance": float(np.asarray(run.seabed.clearance))}),
    }
