"""Fetches the part of a data set that a request names, and writes it whole or not at all."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from auvplan.files import OutputError, write_dataset
from auvplan.io.currents.files import File
from auvplan.io.currents.ocean import ocean_of
from auvplan.io.forecasts.copernicus import open_copernicus
from auvplan.io.forecasts.cutting import Cut, Indices, cut_of, reference_time
from auvplan.io.forecasts.erddap import open_erddap
from auvplan.io.forecasts.opendap import open_opendap
from auvplan.io.forecasts.remote import Remote
from auvplan.io.forecasts.request import Request
from auvplan.scenario.provenance import ORIGIN

#: Bytes that are fetched at most, and about so many with one request.
_MOST, _AT_ONCE = 2_000_000_000, 50_000_000
_OPENERS: dict[str, Callable[[Request, float], Remote]] = {
    "copernicus": open_copernicus,
    "erddap": open_erddap,
    "thredds": open_opendap,
}
#: How attributes begin that tell of a storage format, of the server's own work and its time of day, or of the
#: extent of the whole data set.
_UNWANTED = (
    "history", "CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "DODS", "actual_range", "geospatial_",
    "time_coverage_", "Northernmost_", "Southernmost_", "Easternmost_", "Westernmost_",
)  # fmt: skip


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
    progress: Callable[[float, str], None] = lambda share, words: None,
) -> Fetched:
    """Fetch a current from a server and write it as NetCDF, with where it is from.

    Args:
        request: what is asked for.
        path: of the file.
        timeout: s that the server may be silent.
        progress: called with the share that is done and words for it.

    Raises:
        ForecastError: one line on what is wrong and what would do.
        CurrentError: the data set has no current that can be read.
        OutputError: the file cannot be written.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise OutputError(f"cannot write {target}: there is no folder {target.parent}")
    progress(0.0, f"asking {request.dataset}")
    remote = _OPENERS[request.server](request, timeout)
    cut = cut_of(remote.file, request)
    data = _fetched(remote, cut, request, progress)
    _require_current(data, request)
    data.attrs |= origin_of(request, remote.file)
    return Fetched(write_dataset(data, target), cut.notes)


def origin_of(request: Request, head: File) -> dict[str, str]:
    """Return the attributes that tell where a current is from."""
    server, dataset = "Copernicus Marine", request.dataset
    if request.server != "copernicus":
        server, _, dataset = request.dataset.rpartition("/")
    stated = {
        "server": server,
        "dataset": dataset,
        "run": reference_time(head),
        "request": request.text,
        "request_sha256": request.sha256,
    }
    return {f"{ORIGIN}{name}": value for name, value in stated.items() if value}


def _fetched(
    remote: Remote, cut: Cut, request: Request, progress: Callable[[float, str], None]
) -> xr.Dataset:
    """Return the values of a part of a data set as the server stores them."""
    sizes = {name: _size(remote.raw[name], cut.picks) for name in cut.names}
    total = sum(sizes.values())
    if total > _MOST:
        raise request.fail(
            f"the request holds {total / 1e9:.1f} GB, at most {_MOST / 1e9:.0f} GB are fetched: ask for a "
            "smaller box, less time or fewer depths"
        )
    done, variables = 0, {}
    for name in cut.names:
        raw, parts = remote.raw[name], []
        for picks in _portions(raw, cut.picks):
            progress(done / max(total, 1), f"fetching {name}")
            part = _read(remote, name, picks, request)
            parts.append(part)
            done += part.nbytes
        values = np.concatenate(parts) if raw.ndim else parts[0]
        if name == cut.seam:
            values = np.unwrap(values, period=360.0)
        variables[name] = xr.Variable(raw.dims, values, _plain(raw.attrs))
    return xr.Dataset(variables, attrs=_plain(remote.attributes))


def _picked(variable: xr.Variable, picks: Mapping[str, Indices]) -> dict[str, Indices]:
    """Indices along each dimension of a variable."""
    return {
        str(dim): picks[str(dim)] if dim in picks else np.arange(size) for dim, size in variable.sizes.items()
    }


def _size(variable: xr.Variable, picks: Mapping[str, Indices]) -> int:
    """Bytes of a part of a variable."""
    count = math.prod(len(indices) for indices in _picked(variable, picks).values())
    return count * variable.dtype.itemsize


def _portions(variable: xr.Variable, picks: Mapping[str, Indices]) -> Iterator[dict[str, Indices]]:
    """Parts along the first dimension that are small enough for one request."""
    wanted = _picked(variable, picks)
    if not wanted:
        yield {}
        return
    first, *_ = wanted
    rows = len(wanted[first])
    step = max(1, _AT_ONCE // max(_size(variable, picks) // max(rows, 1), 1))
    for start in range(0, rows, step):
        yield wanted | {first: wanted[first][start : start + step]}


def _read(remote: Remote, name: str, picks: Mapping[str, Indices], request: Request) -> np.ndarray:
    """Return values at indices, each run of which is a request of its own."""
    runs = [np.split(indices, np.flatnonzero(np.diff(indices) != 1) + 1) for indices in picks.values()]
    shape = [len(indices) for indices in picks.values()]
    found = np.empty(shape, remote.raw[name].dtype.newbyteorder("="))
    starts = [np.cumsum([0, *(len(run) for run in parts)]) for parts in runs]
    for numbers in product(*(range(len(parts)) for parts in runs)):
        chosen = [parts[k] for parts, k in zip(runs, numbers, strict=True)]
        ranges = {dim: slice(int(run[0]), int(run[-1]) + 1) for dim, run in zip(picks, chosen, strict=True)}
        place = tuple(slice(at[k], at[k + 1]) for at, k in zip(starts, numbers, strict=True))
        values = remote.read(name, ranges)
        if values.shape != found[place].shape:
            raise request.fail(f"the server broke off its answer at {name}: try again, or a smaller request")
        found[place] = values
    return found


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


def _require_current(data: xr.Dataset, request: Request) -> None:
    """Refuse what cannot be read as a current, or holds none."""
    decoded = xr.decode_cf(data, decode_times=False, decode_coords=False, decode_timedelta=False)
    variables = {str(name): variable for name, variable in decoded.variables.items()}
    ocean = ocean_of((File(request.dataset, variables, decoded.attrs, lambda: None),))
    if not np.isfinite(variables[str(ocean.source("uo"))].values).any():
        raise request.fail("the box holds no water at these times: look at --box")
