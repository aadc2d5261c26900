"""Which variables of a data set, and which indices of its dimensions, a request needs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.io.currents.files import File, text
from auvplan.io.currents.names import MASK_NAMES, MASKS, is_vertical
from auvplan.io.currents.ocean import OceanData, describe, ocean_of
from auvplan.io.currents.times import decode_times, find_time, stamp
from auvplan.io.forecasts.request import Request

#: Places along a side of the box at which the grid's cells are looked up.
_ALONG = 201
#: s by which times of a request may lie beyond the data's.
_SLACK = 0.5
#: What belongs to a grid beside places and levels, by name: angle, masks and the parameters of s-levels.
_GRID = (
    *MASKS, "angle", "ANGLE", "wetdry_mask_rho", "wetdry_mask",
    "s_rho", "sc_r", "Cs_r", "Cs_rho", "hc", "Vtransform", "s_w", "sc_w", "Cs_w",
)  # fmt: skip
_RUN = "forecast_reference_time"
_RUN_ATTRIBUTES = (
    "forecast_reference_time", "bulletin_date", "model_initialization_time", "analysis_time", "run_time",
)  # fmt: skip

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Cut:
    """A part of a data set.

    Attributes:
        names: of the variables, each once.
        picks: indices by dimension, in the order in which they are to follow each other; dimensions that are
            not named are taken whole.
        seam: the longitudes, where the part reaches over the seam of a grid round the globe; or None.
        notes: what is to be noted of it.
    """

    names: tuple[str, ...]
    picks: dict[str, Indices]
    seam: str | None
    notes: tuple[str, ...]


def cut_of(file: File, request: Request) -> Cut:
    """Return the part of a data set that holds a request, with a rim of a cell around its box.

    Args:
        file: the head of the data set.
        request: box, times and depths.

    Raises:
        ForecastError: one line; the box or the times lie outside the data, or the grid cannot be cut.
        CurrentError: the data set has no current that can be read.
    """
    ocean = ocean_of((file,))
    east, north = (ocean.form.variables[name].encoding for name in ("uo", "vo"))
    places, notes = ocean.form.variables["longitude"].encoding, list(ocean.notes)
    if ocean.kind == "triangles":
        raise request.fail(
            "is a mesh, which is not cut: download its files whole, and name them in current.files"
        )
    rows, columns = _around(ocean, request)
    picks = dict(zip(places["dims"], (rows, columns), strict=True))
    if ocean.kind == "roms":
        # Edges lie between points: there is one less of them.
        picks |= dict(zip(east["dims"], (rows, columns[:-1]), strict=True))
        picks |= dict(zip(north["dims"], (rows[:-1], columns), strict=True))
    times = _times(ocean, request)
    if (time_dim := ocean.form.variables["time"].encoding["dims"]) is not None:
        picks[time_dim] = times
    if (level := east["level"]) is not None:
        picks[level] = _levels(ocean, request, notes)
    names = _names(file, ocean, set(picks))
    for name in names:
        for dim, size in file.variables[name].sizes.items():
            if dim in picks and picks[str(dim)].max(initial=0) >= size:
                raise request.fail(
                    f"{name} lies on the edges of cells in a way that is not cut: download its files whole, "
                    "and name them in current.files"
                )
    over = ocean.kind == "regular" and (np.diff(columns) < 0).any()
    return Cut(names, picks, places["source"] if over else None, tuple(notes))


def reference_time(file: File) -> str:
    """Return when the run that made a forecast began, ISO 8601 in UTC, where the data set tells; else "".

    Where it holds several runs, it is the latest one's.
    """
    for name in file.variables:
        if file.standard_name(name) == _RUN and file.variables[name].ndim < 2:
            seconds, _ = decode_times(file, name)
            return stamp(seconds.max())
    stated = (text(file.attributes, name) for name in _RUN_ATTRIBUTES)
    return next((value for value in stated if value), "")


def _around(ocean: OceanData, request: Request) -> list[Indices]:
    """Rows and columns of the points around a box, with one more at each end where there is one."""
    grid, (west, south, east, north) = ocean.geometry, request.box
    along = np.linspace(0.0, 1.0, _ALONG)
    x, y = west + along * ((east - west) % 360.0), south + along * (north - south)
    sides = (x, np.full_like(x, south)), (x, np.full_like(x, north)), (np.full_like(y, west), y)
    sides += ((np.full_like(y, x[-1]), y),)
    weights = grid.locate(*(np.concatenate(axis) for axis in zip(*sides, strict=True)))
    if weights.outside.any():
        least, most = np.nanmin(grid.longitude), np.nanmax(grid.longitude)
        low, high = np.nanmin(grid.latitude), np.nanmax(grid.latitude)
        raise request.fail(
            f"the box reaches beyond the data {describe(weights.beyond)}: they cover longitudes {least:.6g} "
            f"to {most:.6g} and latitudes {low:.6g} to {high:.6g}"
        )
    found = []
    for (dim, pick), size in zip(grid.window(weights.index).picks.items(), grid.shape, strict=True):
        run = np.arange(pick.start, pick.stop) if isinstance(pick, slice) else pick
        wider = np.arange(run[0] - 1, run[0] + len(run) + 1)
        if dim == "longitude" and _closed(grid.longitude):
            found.append(wider % size if len(wider) < size else np.arange(size))
        else:
            found.append(wider[(wider >= 0) & (wider < size)])
    return found


def _closed(longitude: NDArray[np.float64]) -> bool:
    """Return whether columns go round the globe."""
    steps = np.abs(np.diff(np.unwrap(longitude, period=360.0)))
    step = float(np.median(steps)) if len(steps) else np.nan
    return abs(float(steps.sum()) + step - 360.0) < 0.5 * step


def _times(ocean: OceanData, request: Request) -> Indices:
    """Indices of the times from the last before the request to the first after it."""
    begin, end = request.times
    times = ocean.times
    if begin < times[0] - _SLACK or end > times[-1] + _SLACK:
        raise request.fail(
            f"the times asked for, {stamp(begin)} to {stamp(end)}, lie outside the data, which are from "
            f"{stamp(times[0])} to {stamp(times[-1])}"
        )
    found = ocean.form.variables["time"].encoding["frames"][ocean.frames(begin, end)]
    return np.arange(found.min(), found.max() + 1)


def _levels(ocean: OceanData, request: Request, notes: list[str]) -> Indices:
    """Indices of the levels around the depths asked for; all where they follow the sea bed."""
    levels, count = ocean.levels, ocean.form.sizes["level"]
    if request.depths is None:
        return np.arange(count)
    if levels is None:
        notes.append("the levels follow the sea bed: all of them are taken")
        return np.arange(count)
    least, most = request.depths
    if least > levels[-1] + 1e-6:
        raise request.fail(f"--depth begins at {least:g} m, and the deepest level is {levels[-1]:g} m")
    if most > levels[-1] + 1e-6:
        notes.append(f"the deepest level is {levels[-1]:g} m, {most:g} m were asked for")
    first = max(int(np.searchsorted(levels, least + 1e-6, "right")) - 1, 0)
    last = min(int(np.searchsorted(levels, most - 1e-6)), count - 1)
    return np.sort(
        np.arange(count)[ocean.form.variables["uo"].encoding["order"]][first : max(first, last) + 1]
    )


def _names(file: File, ocean: OceanData, dims: set[str]) -> tuple[str, ...]:
    """Velocities, the height of the surface, and what tells where and when they are."""
    form = ocean.form.variables
    level = form["uo"].encoding["level"]
    wanted = ["uo", "vo", "zos", "deptho", "longitude", "latitude"]
    if "wo" in form and (form["wo"].encoding["level"] in dims or ocean.levels is None):
        wanted.insert(2, "wo")
    stated = [form[name].encoding["source"] for name in wanted if name in form]
    stated.append(find_time(file, tuple(str(dim) for dim in file.variables[stated[0]].dims)))
    hints = _hints(file, stated)
    for name, variable in file.variables.items():
        grid = name in _GRID or file.standard_name(name) in (*MASK_NAMES, _RUN)
        axis = name in dims or (variable.ndim == 1 and variable.dims[0] == level)
        axis = axis or (level in variable.dims and is_vertical(file, name))
        if grid or axis or name in hints:
            stated.append(name)
    return tuple(dict.fromkeys(name for name in stated if name in file.variables))


def _hints(file: File, names: Sequence[str]) -> set[str]:
    """Grid mappings of variables, and their coordinates without dimensions."""
    found: set[str] = set()
    for name in names:
        variable = file.variables.get(name)
        if variable is None:
            continue
        attributes: Any = {**variable.encoding, **variable.attrs}
        found |= set(text(attributes, "grid_mapping").replace(":", " ").split())
        scalar = text(attributes, "coordinates").split()
        found |= {hint for hint in scalar if hint in file.variables and not file.variables[hint].ndim}
    return found
