"""Data sets that a THREDDS or another server gives by OPeNDAP (DAP 2.0)."""

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import quote, unquote, urlsplit, urlunsplit

import numpy as np
import xarray as xr

from auvplan.io.forecasts.remote import Remote, answering, missing, session
from auvplan.io.forecasts.request import Request

#: What of a constraint goes as it is, as other clients send it.
_PLAIN = ":,.&=<>!~/"


def open_opendap(request: Request, timeout: float) -> Remote:
    """Open a data set by its OPeNDAP address; nothing but its head is fetched.

    Args:
        request: whose data set is the address.
        timeout: s that the server may be silent.

    Raises:
        ForecastError: one line; the server cannot be reached, refuses, or has no such data set.
    """
    try:
        from pydap.client import open_url  # noqa: F401 - what xarray opens it with
    except ImportError:
        raise missing(request) from None
    carry = _carrier(request, timeout)
    with _guarded(request, timeout):
        dataset = xr.open_dataset(
            request.dataset, engine="pydap", application=carry, decode_cf=False,
            create_default_indexes=False, cache=False,
        )  # fmt: skip

    def read(name: str, picks: Mapping[str, slice]) -> np.ndarray:
        with _guarded(request, timeout):
            return np.asarray(dataset.variables[name].isel(picks).values)

    with _guarded(request, timeout):
        return Remote.of(request.dataset, dataset, read, dataset.attrs)


def _carrier(request: Request, timeout: float) -> Callable[[dict[str, Any], Callable], list[bytes]]:
    """Return what carries the client's requests to the server, as a WSGI application.

    The client's own way would ask six times, and where TLS fails once more without it.
    """
    connection, parts = session(request), urlsplit(request.dataset)

    def carry(environ: dict[str, Any], start: Callable) -> list[bytes]:
        path, query = quote(environ["PATH_INFO"]), quote(unquote(environ["QUERY_STRING"]), _PLAIN)
        address = urlunsplit((parts.scheme, parts.netloc, path, query, ""))
        answer = connection.get(address, timeout=timeout)
        answer.raise_for_status()
        start("200 OK", [("Content-Type", answer.headers.get("Content-Type", "application/octet-stream"))])
        return [answer.content]

    return carry


@contextmanager
def _guarded(request: Request, timeout: float) -> Iterator[None]:
    """What goes wrong within is one line, and what the client warns of is not shown."""
    with warnings.catch_warnings(), answering(request, timeout):
        warnings.simplefilter("ignore")
        yield
