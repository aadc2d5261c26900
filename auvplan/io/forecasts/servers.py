"""Data sets on servers, opened without their values: Copernicus Marine, ERDDAP's griddap, OPeNDAP."""

import logging
import os
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any
from urllib.parse import quote, unquote, urlsplit, urlunsplit

import xarray as xr

from auvplan.errors import AuvplanError, reason_of
from auvplan.io.currents.files import File
from auvplan.io.currents.times import moment_of, seconds_of
from auvplan.io.forecasts.request import ForecastError, Request

#: What an installation needs for servers.
_NEEDED = "pip install 'auvplan[forecasts]'"
#: Longer explanations of a server are cut.
_LONGEST = 200
#: Degrees around the box that Copernicus is asked for too: a cell of most of the service's grids.
_WIDER = 0.1
_SECONDS = {"units": "seconds since 1970-01-01 00:00:00"}
#: ERDDAP's address of a data set, which is that of OPeNDAP too, and the suffix of a page.
_GRIDDAP = re.compile(r"(https?://\S+/griddap/[^/?#\s]+?)(\.\w+)?")
#: What is said of errors, the first that has a part of the names of their classes.
_FAULTS: dict[str, tuple[tuple[tuple[str, ...], str], ...]] = {
    "copernicus": (
        (("Credentials", "UsernameOrPassword"),
         "Copernicus Marine refuses the name or the password ({text}): run `copernicusmarine login`"),
        (("DatasetNotFound", "DatasetVersionNotFound", "DatasetVersionPartNotFound"),
         "Copernicus Marine has no such data set: `copernicusmarine describe` lists what there is"),
        (("CoordinatesOutOfDatasetBounds",), "the request lies outside the data ({text})"),
        (("Connect", "Timeout", "OSError"), "Copernicus Marine cannot be reached ({text}): try again later"),
        (("",), "Copernicus Marine's client failed ({kind}: {text})"),
    ),
    "http": (
        (("Timeout",), "the server did not answer within {timeout:g} s: try again, or a longer --timeout"),
        (("SSLError",), "the server's certificate is not trusted ({why})"),
        (("ChunkedEncodingError", "ContentDecodingError"),
         "the server broke off its answer: try again, or a smaller request"),
        (("ConnectionError",), "the server cannot be reached: look at the address and the network"),
        (("RequestException",), "the server cannot be asked ({why})"),
        # What is no answer of such a server is met with whatever a client stumbles over.
        (("",), "the answer is not {protocol} ({why}): look at the address"),
    ),
}  # fmt: skip
_STATUS = {
    **dict.fromkeys((401, 403), "the server wants a login or refuses it (status {status}){text}"),
    **dict.fromkeys((404, 410), "the server has no such data set (status {status}){text}: look it up there"),
    413: "the request is too large for the server (status 413){text}: ask for less",
}
#: What of an OPeNDAP constraint goes as it is, as other clients send it.
_PLAIN = ":,.&=<>!~/"


def open_remote(request: Request, timeout: float) -> tuple[File, xr.Dataset]:
    """Open the data set of a request; nothing but its head and axes is fetched.

    Args:
        timeout: s that the server may be silent; the client of Copernicus asks some times.

    Returns:
        Its head, decoded but for times, as the readers of currents look at it; and the data set as the server
        stores it, to be read within `answering`.

    Raises:
        ForecastError: one line; packages or valid credentials are missing, there is no such data set, the
            server refuses or cannot be reached.
    """
    with answering(request, timeout):
        dataset = (_copernicus if request.server == "copernicus" else _opendap)(request, timeout)
        return as_file(request.dataset, dataset), dataset


def as_file(label: str, dataset: xr.Dataset) -> File:
    """Return an undecoded data set as a file, decoded but for times; the label names it in messages."""
    decoded = xr.decode_cf(dataset, decode_times=False, decode_coords=False, decode_timedelta=False)
    variables = {str(name): variable for name, variable in decoded.variables.items()}
    return File(label, variables, decoded.attrs, lambda: None)


def _copernicus(request: Request, timeout: float) -> xr.Dataset:
    """Open a data set by its identifier, undecoded."""
    # The client reads it when it is loaded.
    os.environ.setdefault("COPERNICUSMARINE_HTTPS_TIMEOUT", f"{timeout:g}")
    client: Any = import_module("copernicusmarine")
    west, south, east, north = request.box
    least, most = request.depths or (None, None)
    begin, end = (moment_of(second).replace(tzinfo=None) for second in request.times)
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
    dataset, changed = dataset.drop_encoding(), {}
    for name, variable in dataset.variables.items():
        if variable.dtype.kind == "M":
            # Times of all servers are numbers.
            kept = {key: value for key, value in variable.attrs.items() if key not in ("units", "calendar")}
            changed[name] = xr.Variable(variable.dims, seconds_of(variable.values), kept | _SECONDS)
    return dataset.drop_vars(list(changed)).assign(changed)


def _opendap(request: Request, timeout: float) -> xr.Dataset:
    """Open a data set by its OPeNDAP address, or that of its page at an ERDDAP, undecoded."""
    import requests
    from pydap.client import open_url  # noqa: F401 - what xarray opens it with

    dataset = request.dataset
    if request.server == "erddap":
        if (found := _GRIDDAP.fullmatch(dataset)) is None:
            raise ForecastError(
                f"--from erddap:{dataset}: give the address of the data set's griddap page, such as "
                "https://server/erddap/griddap/DATASET"
            )
        dataset = found[1]
    connection, parts = requests.Session(), urlsplit(dataset)

    def carry(environ: dict[str, Any], start: Callable) -> list[bytes]:
        """Carry a request to the server, as a WSGI application.

        The client's own way would ask six times, and where TLS fails once more without it.
        """
        path, query = quote(environ["PATH_INFO"]), quote(unquote(environ["QUERY_STRING"]), _PLAIN)
        address = urlunsplit((parts.scheme, parts.netloc, path, query, ""))
        answer = connection.get(address, timeout=timeout)
        answer.raise_for_status()
        start("200 OK", [("Content-Type", answer.headers.get("Content-Type", "application/octet-stream"))])
        return [answer.content]

    options = {"application": carry, "decode_cf": False, "create_default_indexes": False, "cache": False}
    return xr.open_dataset(dataset, engine="pydap", **options)


@contextmanager
def answering(request: Request, timeout: float) -> Iterator[None]:
    """Turn what goes wrong on the way to a server into one line that says what would do; hide logs."""
    log = logging.getLogger("copernicusmarine")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except AuvplanError:
        raise
    except ImportError:
        raise ForecastError(f"--from {request.server}: needs further packages: {_NEEDED}") from None
    except Exception as error:
        kinds = [kind.__name__ for kind in type(error).__mro__]
        answer: Any = getattr(error, "response", None)
        if kinds[0] == "HTTPError" and "RequestException" in kinds and answer is not None:
            status, (_, mark, rest) = answer.status_code, answer.text.partition('message="')
            words = " ".join(rest.split('";')[0].replace('\\"', '"').split())
            line = _STATUS.get(status, "the server answers with status {status}{text}: try again later")
            said = f" ({words[:_LONGEST]})" if mark else ""
            raise request.fail(line.format(status=status, text=said)) from None
        if "RequestException" in kinds and re.search("IncompleteRead|Read timed out", str(error)):
            kinds.append("ChunkedEncodingError")
        faults = _FAULTS["copernicus" if request.server == "copernicus" else "http"]
        words = next(words for marks, words in faults if any(mark in " ".join(kinds) for mark in marks))
        text = " ".join(str(error).split())[:_LONGEST] or kinds[0]
        about = {"kind": kinds[0], "text": text, "why": reason_of(error), "timeout": timeout}
        protocol = "ERDDAP griddap" if request.server == "erddap" else "OPeNDAP"
        raise request.fail(words.format(**about, protocol=protocol)) from None
    finally:
        log.setLevel(level)
