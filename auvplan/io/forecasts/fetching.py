"""Fetches the part of a data set that a request names, and writes it whole or not at all."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from auvplan.io.currents.files import File, text
from auvplan.io.currents.names import MASK_NAMES, MASKS, is_vertical
from auvplan.io.currents.ocean import OceanData, describe
from auvplan.io.currents.times import decode_times, find_time, stamp
from auvplan.io.forecasts.request import Request
from auvplan.io.forecasts.servers import answering, as_file, open_remote
from auvplan.runtime.files import OutputError, write_dataset
from auvplan.scenario.provenance import ORIGIN

#: Bytes that are fetched at most, in all and, about, with one request.
_MOST, _AT_ONCE = 2_000_000_000, 50_000_000
#: How attributes begin that are of a storage format, of the server's own work and its time of day, or of the
#: extent of the whole data set.
_UNWANTED = (
    "history", "CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "DODS", "actual_range", "geospatial_",
    "time_coverage_", "Northernmost_", "Southernmost_", "Easternmost_", "Westernmost_",
)  # fmt: skip
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
#: Takes the share that is done and words for it.
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Fetched:
    """A current that was fetched.

    Attributes:
        path: of the file.
        notes: what was assumed, a line each.
    """

    path: Path
    notes: tuple[str, ...]


def fetch_current(
    request: Request,
    path: str | Path,
    *,
    timeout: float = 60.0,
    progress: Progress = lambda share, words: None,
) -> Fetched:
    """Fetch a current from a server and write it as NetCDF, with where it is from.

    The server may be silent for `timeout` s; `progress` is called with the share that is done and words.

    Raises:
        ForecastError: one line on what is wrong and what would do.
        CurrentError: the data set has no current that can be read.
        OutputError: the file cannot be written.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise OutputError(f"cannot write {target}: there is no folder {target.parent}")
    progress(0.0, f"asking {request.dataset}")
    file, remote = open_remote(request, timeout)
    ocean = OceanData.of((file,))
    notes = list(ocean.notes)
    picks = _picks(ocean, request, notes)
    names = _names(file, ocean, picks, request)
    data = _fetched(remote, names, picks, request, timeout, progress)
    columns = picks[ocean.model.source.dims[-1]]
    if ocean.kind == "regular" and (np.diff(columns) < 0).any():
        # Over the wrap-around of a grid round the globe, longitudes go on.
        longitude = data[str(ocean.model.source.places and ocean.model.source.places[0])]
        turned = np.unwrap(longitude.values, period=360.0)
        data = data.assign({str(longitude.name): (longitude.dims, turned, longitude.attrs)})
    east = as_file(request.dataset, data).variables[ocean.names["uo"]]
    if not np.isfinite(east.values).any():
        raise request.fail("the box holds no water at these times: look at --box")
    server, dataset = "Copernicus Marine", request.dataset
    if request.server != "copernicus":
        server, _, dataset = request.dataset.rpartition("/")
    # When the run that made it began, of several runs the latest, ISO 8601 in UTC where the data states it.
    runs = [name for name in file.variables if file.standard_name(name) == _RUN]
    runs = [stamp(decode_times(file, name)[0].max()) for name in runs if file.variables[name].ndim < 2]
    runs += [text(file.attributes, name) for name in _RUN_ATTRIBUTES]
    origin = {"server": server, "dataset": dataset, "run": next(filter(None, runs), "")}
    origin |= {"request": request.text, "request_sha256": request.sha256}
    data.attrs |= {f"{ORIGIN}{name}": value for name, value in origin.items() if value}
    return Fetched(write_dataset(data, target), tuple(notes))


def _fetched(
    remote: xr.Dataset,
    names: Sequence[str],
    picks: Mapping[str, Indices],
    request: Request,
    timeout: float,
    progress: Progress,
) -> xr.Dataset:
    """Return the values of variables at indices as the server stores them."""
    wanted = {
        name: {str(dim): picks.get(str(dim), np.arange(size)) for dim, size in remote[name].sizes.items()}
        for name in names
    }
    shapes = {name: [len(each) for each in own.values()] for name, own in wanted.items()}
    sizes = {name: math.prod(shape) * remote[name].dtype.itemsize for name, shape in shapes.items()}
    total, done, variables = sum(sizes.values()), 0, {}
    if total > _MOST:
        raise request.fail(
            f"the request holds {total / 1e9:.1f} GB, at most {_MOST / 1e9:.0f} GB are fetched: ask for a "
            "smaller box, less time or fewer depths"
        )
    for name, own in wanted.items():
        raw, runs, left = remote.variables[name], [], sizes[name]
        found = np.empty(shapes[name], raw.dtype.newbyteorder("="))
        for each in own.values():
            # A request is of a range of each dimension, and of the first ones' no more than is well answered.
            ends = {0, len(each), *(np.flatnonzero(np.diff(each) != 1) + 1)}
            if left:
                one = max(left // max(len(each), 1), 1)
                ends |= {*range(0, len(each), max(1, _AT_ONCE // one))}
                left = one if one > _AT_ONCE else 0
            runs.append([slice(int(a), int(b)) for a, b in pairwise(sorted(ends))])
        for place in product(*runs):
            progress(done / max(total, 1), f"fetching {name}")
            chosen = {dim: each[part] for (dim, each), part in zip(own.items(), place, strict=True)}
            with answering(request, timeout):
                ranges = {dim: slice(int(run[0]), int(run[-1]) + 1) for dim, run in chosen.items()}
                values = np.asarray(raw.isel(ranges).values)
            if values.shape != found[place].shape:
                raise request.fail(
                    f"the server broke off its answer at {name}: try again, or a smaller request"
                )
            found[place] = values
            done += values.nbytes
        variables[name] = xr.Variable(raw.dims, found, _plain(raw.attrs))
    return xr.Dataset(variables, attrs=_plain(remote.attrs))


def _picks(ocean: OceanData, request: Request, notes: list[str]) -> dict[str, Indices]:
    """Indices by dimension of the part that holds a request, with a rim of a cell around its box."""
    source, east, north = ocean.model.source, ocean.model.east, ocean.model.north
    if ocean.kind == "triangles":
        raise request.fail(
            "is a mesh, which is not cut: download its files whole, and name them in current.files"
        )
    rows, columns = _around(ocean, request)
    picks = dict(zip(source.dims, (rows, columns), strict=True))
    if source.staggered:
        # Edges lie between points: there is one less of them.
        picks |= dict(zip(east.dims, (rows, columns[:-1]), strict=True))
        picks |= dict(zip(north.dims, (rows[:-1], columns), strict=True))
    (begin, end), first, last = request.times, ocean.times[0], ocean.times[-1]
    if begin < first - _SLACK or end > last + _SLACK:
        raise request.fail(
            f"the times asked for, {stamp(begin)} to {stamp(end)}, lie outside the data, which are from "
            f"{stamp(first)} to {stamp(last)}"
        )
    if source.series.time_dim is not None:
        found = source.series.frames[ocean.frames(begin, end), 1]
        picks[source.series.time_dim] = np.arange(found.min(), found.max() + 1)
    if east.levels.dim is not None:
        picks[east.levels.dim] = _levels(ocean, request, notes)
    return picks


def _around(ocean: OceanData, request: Request) -> list[Indices]:
    """Rows and columns of the points around a box, with one more at each end where there is one."""
    grid, (west, south, east, north) = ocean.geometry, request.box
    along = np.linspace(0.0, 1.0, _ALONG)
    x, y = west + along * ((east - west) % 360.0), south + along * (north - south)
    longitude = np.concatenate([x, x, np.full_like(y, west), np.full_like(y, x[-1])])
    latitude = np.concatenate([np.full_like(x, south), np.full_like(x, north), y, y])
    weights = grid.locate(longitude, latitude)
    if weights.outside.any():
        least, most = np.nanmin(grid.longitude), np.nanmax(grid.longitude)
        low, high = np.nanmin(grid.latitude), np.nanmax(grid.latitude)
        raise request.fail(
            f"the box reaches beyond the data {describe(weights.beyond)}: they cover longitudes {least:.6g} "
            f"to {most:.6g} and latitudes {low:.6g} to {high:.6g}"
        )
    found, steps = [], np.abs(np.diff(np.unwrap(grid.longitude, period=360.0)))
    step = float(np.median(steps)) if steps.size else np.nan
    around = abs(float(steps.sum()) + step - 360.0) < 0.5 * step
    for (dim, pick), size in zip(grid.window(weights.index).picks.items(), grid.shape, strict=True):
        run = np.arange(pick.start, pick.stop) if isinstance(pick, slice) else pick
        wider = np.arange(run[0] - 1, run[0] + len(run) + 1)
        if dim == "longitude" and around:
            found.append(wider % size if len(wider) < size else np.arange(size))
        else:
            found.append(wider[(wider >= 0) & (wider < size)])
    return found


def _levels(ocean: OceanData, request: Request, notes: list[str]) -> Indices:
    """Indices of the levels around the depths asked for; all where they follow the sea bed."""
    levels, count = ocean.levels, ocean.model.east.levels.count
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
    return np.sort(np.arange(count)[ocean.model.east.levels.order][first : max(first, last) + 1])


def _names(file: File, ocean: OceanData, picks: Mapping[str, Indices], request: Request) -> tuple[str, ...]:
    """Velocities, the height of the surface, and what states where and when they are."""
    up, level = ocean.model.up, ocean.model.east.levels.dim
    flat = up is not None and up.levels.dim not in picks and ocean.levels is not None
    stated = [name for kind, name in ocean.names.items() if not (kind == "wo" and flat)]
    stated += [name for name in ocean.model.source.places or () if name in file.variables]
    stated.append(time := find_time(file, tuple(str(dim) for dim in file.variables[stated[0]].dims)))
    stated += [name for name in (file.text(time, "bounds"),) if name in file.variables]
    hints: set[str] = set()
    for name in stated:
        attributes: Any = {**file.variables[name].encoding, **file.variables[name].attrs}
        hints |= set(text(attributes, "grid_mapping").replace(":", " ").split())
        scalar = text(attributes, "coordinates").split()
        hints |= {hint for hint in scalar if hint in file.variables and not file.variables[hint].ndim}
    for name, variable in file.variables.items():
        grid = name in _GRID or file.standard_name(name) in (*MASK_NAMES, _RUN)
        axis = (
            name in picks or variable.dims == (level,) or (level in variable.dims and is_vertical(file, name))
        )
        if grid or axis or name in hints:
            stated.append(name)
    for name in dict.fromkeys(stated):
        for dim, size in file.variables[name].sizes.items():
            if dim in picks and picks[str(dim)].max(initial=0) >= size:
                raise request.fail(
                    f"{name} lies on the edges of cells in a way that is not cut: download its files whole, "
                    "and name them in current.files"
                )
    return tuple(dict.fromkeys(stated))


def _plain(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the attributes that are texts or numbers and mean something outside the server."""
    kept = {}
    for name, value in attributes.items():
        hidden = str(name).startswith("_") and name not in ("_FillValue", "_Unsigned")
        if hidden or str(name).startswith(_UNWANTED):
            continue
        if isinstance(value, str) or np.asarray(value).dtype.kind in "fiu":
            kept[str(name)] = value
    return kept
