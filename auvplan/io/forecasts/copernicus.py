"""Data sets of the Copernicus Marine Service, by its own client."""

import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np
import xarray as xr

from auvplan.errors import AuvplanError
from auvplan.io.currents.times import moment_of
from auvplan.io.forecasts.remote import Remote, missing
from auvplan.io.forecasts.request import ForecastError, Request

#: Degrees around the box that are asked for too: a cell of most of the service's grids.
_WIDER = 0.1
_SECONDS = {"units": "seconds since 1970-01-01 00:00:00"}


def open_copernicus(request: Request, timeout: float) -> Remote:
    """Open a data set by its identifier; nothing but its head is fetched.

    Args:
        request: whose data set is the identifier.
        timeout: s that the service may be silent; the client asks some times.

    Raises:
        ForecastError: one line; there are no valid credentials, no such data set, or no way to the service.
    """
    # The client reads it when it is loaded.
    os.environ.setdefault("COPERNICUSMARINE_HTTPS_TIMEOUT", f"{timeout:g}")
    try:
        client: Any = import_module("copernicusmarine")
    except ImportError:
        raise missing(request) from None
    west, south, east, north = request.box
    least, most = request.depths or (None, None)
    begin, end = (moment_of(second).replace(tzinfo=None) for second in request.times)
    with _guarded(request):
        # Without it the client would ask for a name and a password on the terminal.
        if not client.login(check_credentials_valid=True):
            raise request.fail(
                "Copernicus Marine knows no valid name and password: run `copernicusmarine login`, or set "
                "COPERNICUSMARINE_SERVICE_USERNAME and COPERNICUSMARINE_SERVICE_PASSWORD"
            )
        dataset = client.open_dataset(
            dataset_id=request.dataset,
            minimum_longitude=west - _WIDER,
            maximum_longitude=(east if east > west else east + 360.0) + _WIDER,
            minimum_latitude=max(south - _WIDER, -90.0),
            maximum_latitude=min(north + _WIDER, 90.0),
            minimum_depth=least,
            maximum_depth=most,
            start_datetime=begin,
            end_datetime=end,
            coordinates_selection_method="outside",
        )
        if dataset is None:
            raise request.fail("Copernicus Marine's client gave up without a reason")
        dataset = _without_dates(dataset.drop_encoding())

    def read(name: str, picks: Mapping[str, slice]) -> np.ndarray:
        with _guarded(request):
            return np.asarray(dataset.variables[name].isel(picks).values)

    with _guarded(request):
        return Remote.of(request.dataset, dataset, read, dataset.attrs)


@contextmanager
def _guarded(request: Request) -> Iterator[None]:
    """What the client raises is one line, and what it logs is not shown."""
    log = logging.getLogger("copernicusmarine")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    except AuvplanError:
        raise
    except Exception as error:
        raise _refused(request, error) from None
    finally:
        log.setLevel(level)


def _refused(request: Request, error: Exception) -> ForecastError:
    """Return the line for what the client raised; its exceptions are known by their names."""
    kind, said = type(error).__name__, " ".join(str(error).split())[:200]
    if "Credentials" in kind or "UsernameOrPassword" in kind:
        return request.fail(
            f"Copernicus Marine refuses the name or the password ({said}): run `copernicusmarine login`"
        )
    if kind in ("DatasetNotFound", "DatasetVersionNotFound", "DatasetVersionPartNotFound"):
        return request.fail(
            "Copernicus Marine has no such data set: `copernicusmarine describe` lists what there is"
        )
    if kind == "CoordinatesOutOfDatasetBounds":
        return request.fail(f"the request lies outside the data ({said})")
    if isinstance(error, OSError) or "Connect" in kind or "Timeout" in kind:
        return request.fail(f"Copernicus Marine cannot be reached ({said or kind}): try again later")
    return request.fail(f"Copernicus Marine's client failed ({kind}: {said})")


def _without_dates(dataset: xr.Dataset) -> xr.Dataset:
    """Return a data set with times as seconds since 1970, in which all servers' times are compared."""
    changed: dict[Any, Any] = {}
    for name, variable in dataset.variables.items():
        if variable.dtype.kind == "M":
            seconds = (variable.values - np.datetime64(0, "s")) / np.timedelta64(1, "s")
            kept = {key: value for key, value in variable.attrs.items() if key not in ("units", "calendar")}
            changed[name] = variable.dims, seconds, kept | _SECONDS
    plain = dataset.drop_vars([name for name in changed if name in dataset.variables])
    return plain.assign({name: xr.Variable(*parts) for name, parts in changed.items()})
