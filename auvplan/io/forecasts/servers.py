"""Data sets on servers, opened without their values: Copernicus Marine, ERDDAP's griddap, OPeNDAP."""

import json
import logging
import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote, urlsplit, urlunsplit

import numpy as np
import xarray as xr

from auvplan.errors import AuvplanError, reason_of
from auvplan.io.currents.files import File
from auvplan.io.currents.times import moment_of, seconds_of
from auvplan.io.forecasts.request import ForecastError, Request

if TYPE_CHECKING:
    import requests

#: What an installation needs for servers.
_NEEDED = "pip install 'auvplan[forecasts]'"
#: Longer explanations of a server are cut.
_LONGEST = 200
#: Degrees around the box that Copernicus is asked for too: a cell of most of the service's grids.
_WIDER = 0.1
_SECONDS = {"units": "seconds since 1970-01-01 00:00:00"}
#: ERDDAP's addresses, and its types, which are Java's.
_GRIDDAP = re.compile(r"(?P<server>https?://\S+)/griddap/(?P<dataset>[^/?#\s]+?)(\.\w+)?")
_COUNT = re.compile(r"nValues=(\d+)")
_TYPES = {
    "double": "f8", "float": "f4", "long": "i8", "int": "i4", "short": "i2", "byte": "i1",
    "ulong": "u8", "uint": "u4", "ushort": "u2", "ubyte": "u1",
}  # fmt: skip
#: What of an OPeNDAP constraint goes as it is, as other clients send it.
_PLAIN = ":,.&=<>!~/"


@dataclass(frozen=True)
class Remote:
    """A data set on a server, of which nothing but head and axes is known yet."""

    file: File  # its head, decoded but for times, as the readers of currents look at it
    raw: Mapping[str, xr.Variable]  # its variables as the server stores them; their values are not to be read
    #: Values of a variable in a range of indices of each of its dimensions, as the server stores them.
    read: Callable[[str, Mapping[str, slice]], np.ndarray]

    @classmethod
    def of(cls, label: str, dataset: xr.Dataset, read: Callable) -> "Remote":
        """Return the remote of an undecoded data set."""
        raw = {str(name): variable for name, variable in dataset.variables.items()}
        return cls(as_file(label, dataset), raw, read)


def as_file(label: str, dataset: xr.Dataset) -> File:
    """Return an undecoded data set as a file, decoded but for times; the label names it in messages."""
    decoded = xr.decode_cf(dataset, decode_times=False, decode_coords=False, decode_timedelta=False)
    variables = {str(name): variable for name, variable in decoded.variables.items()}
    return File(label, variables, decoded.attrs, lambda: None)


def open_copernicus(request: Request, timeout: float) -> Remote:
    """Open a data set by its identifier; nothing but its head is fetched.

    Args:
        timeout: s that the service may be silent; the client asks some times.

    Raises:
        ForecastError: one line; there are no valid credentials, no such data set, or no way to the service.
    """
    # The client reads it when it is loaded.
    os.environ.setdefault("COPERNICUSMARINE_HTTPS_TIMEOUT", f"{timeout:g}")
    try:
        client: Any = import_module("copernicusmarine")
    except ImportError:
        raise _missing(request) from None
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
        return Remote.of(request.dataset, dataset, read)


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
    kind, said = type(error).__name__, " ".join(str(error).split())[:_LONGEST]
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
    changed = {}
    for name, variable in dataset.variables.items():
        if variable.dtype.kind == "M":
            kept = {key: value for key, value in variable.attrs.items() if key not in ("units", "calendar")}
            changed[name] = xr.Variable(variable.dims, seconds_of(variable.values), kept | _SECONDS)
    return dataset.drop_vars(list(changed)).assign(changed)


def open_erddap(request: Request, timeout: float) -> Remote:
    """Open a data set by the address of its griddap page; nothing but its head and axes is fetched.

    Args:
        request: whose data set is the address, such as https://server/erddap/griddap/DATASET.
        timeout: s that the server may be silent.

    Raises:
        ForecastError: one line; the server cannot be reached, refuses, or has no such data set.
    """
    found = _GRIDDAP.fullmatch(request.dataset)
    if found is None:
        raise ForecastError(
            f"--from erddap:{request.dataset}: give the address of the data set's griddap page, such as "
            "https://server/erddap/griddap/DATASET"
        )
    server, dataset = found["server"], found["dataset"]
    connection = _session(request)

    def get(address: str) -> bytes:
        with _answering(request, timeout):
            answer = connection.get(address, timeout=timeout)
            answer.raise_for_status()
            return answer.content

    def cut(parts: Mapping[str, tuple[slice, ...]]) -> xr.Dataset:
        query = ",".join(
            name + "".join(f"[{part.start}:1:{part.stop - 1}]" for part in picks)
            for name, picks in parts.items()
        )
        content = get(f"{server}/griddap/{dataset}.nc?{query}")
        with _answering(request, timeout):
            return xr.open_dataset(
                content, decode_cf=False, engine="h5netcdf" if content.startswith(b"\x89HDF") else "scipy"
            ).load()

    stated = get(f"{server}/info/{dataset}/index.json")
    with _answering(request, timeout):
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

    with _answering(request, timeout):
        undecoded = xr.Dataset(head, attrs=attributes.get("NC_GLOBAL", {}))
        return Remote.of(request.dataset, undecoded, read)


def _head(page: Any) -> tuple[dict[str, int], dict[str, tuple[str, tuple[str, ...]]], dict[str, dict]]:
    """Sizes by dimension, type and dimensions by variable, and attributes by variable, of an info page."""
    dims: dict[str, int] = {}
    variables: dict[str, tuple[str, tuple[str, ...]]] = {}
    attributes: dict[str, dict] = {}
    for kind, name, attribute, type_, value in page["table"]["rows"]:
        if kind == "dimension":
            count = _COUNT.search(value)
            if count is None:
                raise ValueError(f"dimension {name} has no nValues")
            dims[name] = int(count[1])
        elif kind == "variable" and type_ in _TYPES:
            variables[name] = _TYPES[type_], tuple(part.strip() for part in value.split(","))
        elif kind == "attribute":
            stated: Any = value
            if type_ in _TYPES:
                numbers = np.array([float(part) for part in value.split(",")]).astype(_TYPES[type_])
                stated = numbers[0] if numbers.size == 1 else numbers
            attributes.setdefault(name, {})[attribute] = stated
    return dims, variables, attributes


def open_opendap(request: Request, timeout: float) -> Remote:
    """Open a data set by its OPeNDAP address; nothing but its head is fetched.

    Args:
        timeout: s that the server may be silent.

    Raises:
        ForecastError: one line; the server cannot be reached, refuses, or has no such data set.
    """
    try:
        from pydap.client import open_url  # noqa: F401 - what xarray opens it with
    except ImportError:
        raise _missing(request) from None
    carry = _carrier(request, timeout)
    with _quiet(request, timeout):
        dataset = xr.open_dataset(
            request.dataset, engine="pydap", application=carry, decode_cf=False,
            create_default_indexes=False, cache=False,
        )  # fmt: skip

    def read(name: str, picks: Mapping[str, slice]) -> np.ndarray:
        with _quiet(request, timeout):
            return np.asarray(dataset.variables[name].isel(picks).values)

    with _quiet(request, timeout):
        return Remote.of(request.dataset, dataset, read)


def _carrier(request: Request, timeout: float) -> Callable[[dict[str, Any], Callable], list[bytes]]:
    """Return what carries the client's requests to the server, as a WSGI application.

    The client's own way would ask six times, and where TLS fails once more without it.
    """
    connection, parts = _session(request), urlsplit(request.dataset)

    def carry(environ: dict[str, Any], start: Callable) -> list[bytes]:
        path, query = quote(environ["PATH_INFO"]), quote(unquote(environ["QUERY_STRING"]), _PLAIN)
        address = urlunsplit((parts.scheme, parts.netloc, path, query, ""))
        answer = connection.get(address, timeout=timeout)
        answer.raise_for_status()
        start("200 OK", [("Content-Type", answer.headers.get("Content-Type", "application/octet-stream"))])
        return [answer.content]

    return carry


@contextmanager
def _quiet(request: Request, timeout: float) -> Iterator[None]:
    """What goes wrong within is one line, and what the client warns of is not shown."""
    with warnings.catch_warnings(), _answering(request, timeout):
        warnings.simplefilter("ignore")
        yield


@contextmanager
def _answering(request: Request, timeout: float) -> Iterator[None]:
    """Turn what goes wrong on the way to a server into one line that says what would do."""
    import requests

    try:
        yield
    except requests.exceptions.Timeout:
        raise request.fail(
            f"the server did not answer within {timeout:g} s: try again, or a longer --timeout"
        ) from None
    except requests.exceptions.HTTPError as error:
        raise _status(request, error) from None
    except requests.exceptions.SSLError as error:
        raise request.fail(f"the server's certificate is not trusted ({reason_of(error)})") from None
    except requests.exceptions.RequestException as error:
        cut = (requests.exceptions.ChunkedEncodingError, requests.exceptions.ContentDecodingError)
        if isinstance(error, cut) or "IncompleteRead" in str(error) or "Read timed out" in str(error):
            raise request.fail("the server broke off its answer: try again, or a smaller request") from None
        if isinstance(error, requests.exceptions.ConnectionError):
            raise request.fail("the server cannot be reached: look at the address and the network") from None
        raise request.fail(f"the server cannot be asked ({reason_of(error)})") from None
    except AuvplanError:
        raise
    # What is no answer of such a server is met with whatever a client stumbles over.
    except Exception as error:
        kind = "ERDDAP griddap" if request.server == "erddap" else "OPeNDAP"
        raise request.fail(f"the answer is not {kind} ({reason_of(error)}): look at the address") from None


def _session(request: Request) -> "requests.Session":
    """Return a session of requests; no request is sent yet."""
    try:
        import requests
    except ImportError:
        raise _missing(request) from None
    return requests.Session()


def _missing(request: Request) -> ForecastError:
    """Return what to say where packages are not installed."""
    return ForecastError(f"--from {request.server}: needs further packages: {_NEEDED}")


def _status(request: Request, error: "requests.exceptions.HTTPError") -> ForecastError:
    """Return the line for a status that is an error, with the words of the server's message."""
    status, said = None, ""
    if error.response is not None:
        status, (_, mark, rest) = error.response.status_code, error.response.text.partition('message="')
        words = " ".join(rest.split('";')[0].replace('\\"', '"').split())
        said = f" ({words[:_LONGEST]})" if mark else ""
    if status in (401, 403):
        return request.fail(f"the server wants a login or refuses it (status {status}){said}")
    if status in (404, 410):
        return request.fail(f"the server has no such data set (status {status}){said}: look it up there")
    if status == 413:
        return request.fail(f"the request is too large for the server (status 413){said}: ask for less")
    return request.fail(f"the server answers with status {status}{said}: try again later")


#: What opens a data set of each kind of server, with the seconds that it may be silent.
OPENERS: dict[str, Callable[[Request, float], Remote]] = {
    "copernicus": open_copernicus,
    "erddap": open_erddap,
    "thredds": open_opendap,
}
