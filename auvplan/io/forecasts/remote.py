"""A data set on a server, and the one way in which all servers are asked for it."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from auvplan.errors import AuvplanError
from auvplan.io.currents.files import File
from auvplan.io.forecasts.request import ForecastError, Request

if TYPE_CHECKING:
    import requests

#: What an installation needs for servers.
NEEDED = "pip install 'auvplan[forecasts]'"
#: Longer explanations of a server are cut.
_LONGEST = 200


@dataclass(frozen=True)
class Remote:
    """A data set on a server, of which nothing but head and axes is known yet.

    Attributes:
        file: its head, decoded but for times, as the readers of currents look at it.
        raw: its variables as the server stores them; their values are not to be read.
        attributes: of the whole data set.
        read: values of a variable in a range of indices of each of its dimensions, as the server stores them.
    """

    file: File
    raw: Mapping[str, xr.Variable]
    attributes: Mapping[str, Any]
    read: Callable[[str, Mapping[str, slice]], np.ndarray]

    @classmethod
    def of(cls, label: str, dataset: xr.Dataset, read: Callable, attributes: Mapping[str, Any]) -> "Remote":
        """Return the remote of an undecoded data set.

        Args:
            label: its name for messages.
            dataset: its head.
            read, attributes: as above.
        """
        decoded = xr.decode_cf(dataset, decode_times=False, decode_coords=False, decode_timedelta=False)
        variables = {str(name): variable for name, variable in decoded.variables.items()}
        raw = {str(name): variable for name, variable in dataset.variables.items()}
        return cls(File(label, variables, attributes, lambda: None), raw, attributes, read)


@contextmanager
def answering(request: Request, timeout: float) -> Iterator[None]:
    """Turn what goes wrong on the way to a server into one line that says what would do."""
    import requests

    try:
        yield
    except requests.exceptions.Timeout:
        raise request.fail(
            f"the server did not answer within {timeout:g} s: try again, or a longer --timeout"
        ) from None
    except requests.exceptions.HTTPError as error:
        raise _refused(request, error) from None
    except requests.exceptions.SSLError as error:
        raise request.fail(f"the server's certificate is not trusted ({_line(error)})") from None
    except requests.exceptions.ConnectionError as error:
        if "IncompleteRead" in str(error) or "Read timed out" in str(error):
            raise request.fail("the server broke off its answer: try again, or a smaller request") from None
        raise request.fail("the server cannot be reached: look at the address and the network") from None
    except (requests.exceptions.ChunkedEncodingError, requests.exceptions.ContentDecodingError):
        raise request.fail("the server broke off its answer: try again, or a smaller request") from None
    except requests.exceptions.RequestException as error:
        raise request.fail(f"the server cannot be asked ({_line(error)})") from None
    except AuvplanError:
        raise
    # What is no answer of such a server is met with whatever a client stumbles over.
    except Exception as error:
        kind = "ERDDAP griddap" if request.server == "erddap" else "OPeNDAP"
        raise request.fail(f"the answer is not {kind} ({_line(error)}): look at the address") from None


def session(request: Request) -> "requests.Session":
    """Return a session of requests; no request is sent yet.

    Raises:
        ForecastError: the packages for servers are not installed.
    """
    try:
        import requests
    except ImportError:
        raise missing(request) from None
    return requests.Session()


def missing(request: Request) -> ForecastError:
    """Return what to say where packages are not installed."""
    return ForecastError(f"--from {request.server}: needs further packages: {NEEDED}")


def _refused(request: Request, error: "requests.exceptions.HTTPError") -> ForecastError:
    """Return the line for a status that is an error."""
    status = None if error.response is None else error.response.status_code
    said = "" if error.response is None else _said(error.response.text)
    if status in (401, 403):
        return request.fail(f"the server wants a login or refuses it (status {status}){said}")
    if status in (404, 410):
        return request.fail(f"the server has no such data set (status {status}){said}: look it up there")
    if status == 413:
        return request.fail(f"the request is too large for the server (status 413){said}: ask for less")
    return request.fail(f"the server answers with status {status}{said}: try again later")


def _said(text: str) -> str:
    """Return the words of a server's error message, in brackets; none of a page."""
    _, mark, rest = text.partition('message="')
    if not mark:
        return ""
    words = " ".join(rest.split('";')[0].replace('\\"', '"').split())
    return f" ({words[:_LONGEST]})"


def _line(error: Exception) -> str:
    return (" ".join(str(error).split()) or type(error).__name__)[:_LONGEST]
