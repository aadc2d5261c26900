"""Gridded data sets of ERDDAP servers, by the addresses of its griddap and info pages."""

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from auvplan.io.forecasts.remote import Remote, answering, session
from auvplan.io.forecasts.request import ForecastError, Request

_ADDRESS = re.compile(r"(?P<server>https?://\S+)/griddap/(?P<dataset>[^/?#\s]+?)(\.\w+)?")
_COUNT = re.compile(r"nValues=(\d+)")
#: ERDDAP's types, which are Java's.
_TYPES = {
    "double": "f8", "float": "f4", "long": "i8", "int": "i4", "short": "i2", "byte": "i1",
    "ulong": "u8", "uint": "u4", "ushort": "u2", "ubyte": "u1",
}  # fmt: skip


def open_erddap(request: Request, timeout: float) -> Remote:
    """Open a data set by the address of its griddap page; nothing but its head and axes is fetched.

    Args:
        request: whose data set is the address, such as https://server/erddap/griddap/DATASET.
        timeout: s that the server may be silent.

    Raises:
        ForecastError: one line; the server cannot be reached, refuses, or has no such data set.
    """
    found = _ADDRESS.fullmatch(request.dataset)
    if found is None:
        raise ForecastError(
            f"--from erddap:{request.dataset}: give the address of the data set's griddap page, such as "
            "https://server/erddap/griddap/DATASET"
        )
    server, dataset = found["server"], found["dataset"]
    connection = session(request)

    def get(address: str) -> bytes:
        with answering(request, timeout):
            answer = connection.get(address, timeout=timeout)
            answer.raise_for_status()
            return answer.content

    def cut(parts: Mapping[str, tuple[slice, ...]]) -> xr.Dataset:
        query = ",".join(
            name + "".join(f"[{part.start}:1:{part.stop - 1}]" for part in picks)
            for name, picks in parts.items()
        )
        content = get(f"{server}/griddap/{dataset}.nc?{query}")
        with answering(request, timeout):
            return xr.open_dataset(
                content, decode_cf=False, engine="h5netcdf" if content.startswith(b"\x89HDF") else "scipy"
            ).load()

    stated = get(f"{server}/info/{dataset}/index.json")
    with answering(request, timeout):
        dims, variables, attributes = _head(json.loads(stated))
    axes = cut({name: (slice(0, size),) for name, size in dims.items()})
    head: dict[str, xr.Variable] = {str(name): axes.variables[name] for name in dims}
    for name, (kind, along) in variables.items():
        # Of the shape and type that it has, without values.
        empty = np.broadcast_to(np.zeros((), kind), tuple(dims[dim] for dim in along))
        head[name] = xr.Variable(along, empty, attributes.get(name, {}))

    def read(name: str, picks: Mapping[str, slice]) -> np.ndarray:
        own = head[name]
        whole = tuple(picks.get(str(dim), slice(0, size)) for dim, size in own.sizes.items())
        if name in dims:
            return own.values[whole]
        return cut({name: whole})[name].values

    with answering(request, timeout):
        return Remote.of(request.dataset, xr.Dataset(head), read, attributes.get("NC_GLOBAL", {}))


def _head(stated: Any) -> tuple[dict[str, int], dict[str, tuple[str, tuple[str, ...]]], dict[str, dict]]:
    """Sizes by dimension, type and dimensions by variable, and attributes by variable, of an info page."""
    dims: dict[str, int] = {}
    variables: dict[str, tuple[str, tuple[str, ...]]] = {}
    attributes: dict[str, dict] = {}
    for kind, name, attribute, type_, value in stated["table"]["rows"]:
        if kind == "dimension":
            count = _COUNT.search(value)
            if count is None:
                raise ValueError(f"dimension {name} has no nValues")
            dims[name] = int(count[1])
        elif kind == "variable" and type_ in _TYPES:
            variables[name] = _TYPES[type_], tuple(part.strip() for part in value.split(","))
        elif kind == "attribute":
            attributes.setdefault(name, {})[attribute] = _value(type_, value)
    return dims, variables, attributes


def _value(type_: str, value: str) -> Any:
    if type_ not in _TYPES:
        return value
    numbers = np.array([float(part) for part in value.split(",")]).astype(_TYPES[type_])
    return numbers[0] if numbers.size == 1 else numbers
