"""All missions of a study as one dataset with CF attributes: a row a mission, legs and calls padded."""

import json
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr

from auvplan.files import ResultError
from auvplan.io.fields import chart_variables
from auvplan.ocean.chart import UNCERTAIN_MAX, Chart
from auvplan.study.design import Design
from auvplan.study.row import VARIABLES, Row, Variable


def table(design: Design, rows: Sequence[Row], chart: Chart | None) -> xr.Dataset:
    """Return the dataset of a finished study.

    Args:
        design: what was run.
        rows: one for each of `Design.tasks`, in their order.
        chart: that all missions share, or None.
    """
    lead = (*(sweep.dim for sweep in design.sweeps), "mission")
    shape = (*design.shape, design.count)
    variables = {
        name: _variable(variable, [row[name] for row in rows], lead, shape)
        for name, variable in VARIABLES.items()
    }
    coords = {sweep.dim: _values(sweep.field, sweep.values) for sweep in design.sweeps}
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


def _values(field: str, values: Sequence[Any]) -> xr.Variable:
    """Return the values of a sweep as a coordinate; other than numbers as their text."""
    numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values)
    found = np.asarray(values, float) if numbers else np.asarray([str(value) for value in values], object)
    return xr.Variable(field.replace(".", "_"), found, {"long_name": field, "field": field})


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


def study_chart(dataset: xr.Dataset) -> Chart | None:
    """Return the chart that all missions share; None for open water.

    Stored steps may miss the values of a chart by a hair.
    """
    if "passability" not in dataset:
        return None
    north, east = dataset["chart_x"].values, dataset["chart_y"].values
    raster = np.nan_to_num(dataset["passability"].values, nan=1.0)
    raster = np.where(raster > 0.99, 1.0, np.clip(raster, 0.0, UNCERTAIN_MAX))
    size = float(north[1] - north[0]) if len(north) > 1 else float(east[-1] - east[0]) / max(len(east) - 1, 1)
    return Chart.from_passability(raster, size, (float(north[0]) - 0.5 * size, float(east[0]) - 0.5 * size))
