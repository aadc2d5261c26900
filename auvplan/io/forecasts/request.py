"""What is asked of a server of ocean forecasts: a data set, a box, times and depths."""

import hashlib
import math
import re
from dataclasses import dataclass
from datetime import datetime, timedelta

from auvplan.errors import AuvplanError
from auvplan.io.currents.times import seconds_of, stamp
from auvplan.site import as_utc

#: Kinds of servers, each with an example of what follows the colon.
SERVERS = {
    "copernicus": "copernicus:cmems_mod_glo_phy-cur_anfc_0.083deg_PT6H-i",
    "erddap": "erddap:https://server/erddap/griddap/DATASET",
    "thredds": "thredds:https://server/thredds/dodsC/path/file.nc",
}
_DURATION = re.compile(r"\+(\d+(?:\.\d+)?)(min|h|d)")
_UNITS = {"min": 60.0, "h": 3600.0, "d": 86_400.0}


class ForecastError(AuvplanError):
    """A forecast that cannot be fetched; the message is one line."""


@dataclass(frozen=True)
class Request:
    """A part of a data set of currents.

    Attributes:
        server: "copernicus", "erddap" or "thredds".
        dataset: its address, or its identifier with Copernicus Marine.
        box: west, south, east, north, degrees; west may be greater than east across the antimeridian.
        times: first and last, s since 1970-01-01 UTC.
        depths: least and greatest, m below the surface; None for all.
    """

    server: str
    dataset: str
    box: tuple[float, float, float, float]
    times: tuple[float, float]
    depths: tuple[float, float] | None = None

    @classmethod
    def of(cls, source: str, box: str, time: str, depth: str | None = None) -> "Request":
        """Return the request of the texts of a command's options.

        Args:
            source: "copernicus:DATASET", "erddap:ADDRESS" or "thredds:ADDRESS".
            box: "W,S,E,N", degrees.
            time: "FROM,TO", ISO 8601, UTC unless it says so; TO may be a duration such as +12h.
            depth: "MIN,MAX", m.

        Raises:
            ForecastError: one line that names the option and what would do.
        """
        server, colon, dataset = source.partition(":")
        if not colon or server not in SERVERS or not dataset:
            raise ForecastError(f"--from {source!r}: give it as {', '.join(SERVERS.values())}")
        if server != "copernicus" and not re.match(r"https?://[^/\s]+/\S", dataset):
            raise ForecastError(f"--from {source!r}: {server} needs an address, such as {SERVERS[server]}")
        west, south, east, north = _numbers(
            "--box", box, "W,S,E,N in degrees, such as -5.6,56.2,-5.2,56.5", 4
        )
        if not (-180.0 <= west <= 360.0 and -180.0 <= east <= 360.0 and -90.0 <= south < north <= 90.0):
            raise ForecastError(
                f"--box {box!r}: longitudes lie in [-180, 360], latitudes in [-90, 90], south before north"
            )
        if not 0.0 < (east - west) % 360.0 <= 180.0:
            raise ForecastError(f"--box {box!r}: west and east must differ, by at most 180 degrees eastward")
        depths = None
        if depth is not None:
            least, most = _numbers("--depth", depth, "MIN,MAX in metres, such as 0,50", 2)
            if not 0.0 <= least <= most:
                raise ForecastError(f"--depth {depth!r}: must be 0 or more, the least and then the greatest")
            depths = least, most
        if server != "copernicus":
            dataset = dataset.rstrip("/")
        return cls(server, dataset, (west, south, east, north), _times(time), depths)

    @property
    def text(self) -> str:
        """The request on one line, the same however its options were written."""
        box = ",".join(f"{degrees:.6g}" for degrees in self.box)
        parts = [f"from {self.server}:{self.dataset} box {box} time {','.join(map(stamp, self.times))}"]
        if self.depths is not None:
            parts.append(f"depth {','.join(f'{depth:g}' for depth in self.depths)}")
        return " ".join(parts)

    @property
    def sha256(self) -> str:
        """The hash of `text`, hexadecimal."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def fail(self, reason: str) -> ForecastError:
        """Return an error that names the data set."""
        return ForecastError(f"{self.dataset}: {reason}")


def _numbers(option: str, given: str, form: str, count: int) -> list[float]:
    try:
        found = [float(part) for part in given.split(",")]
    except ValueError:
        found = []
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ForecastError(f"{option} {given!r}: give it as {form}")
    return found


def _times(given: str) -> tuple[float, float]:
    form = "FROM,TO, such as 2026-03-01T00:00Z,2026-03-01T12:00Z or 2026-03-01T00:00Z,+12h"
    first, _, last = (part.strip() for part in given.partition(","))
    try:
        begin = as_utc(datetime.fromisoformat(first))
        span = _DURATION.fullmatch(last)
        if span is not None:
            end = begin + timedelta(seconds=float(span[1]) * _UNITS[span[2]])
        else:
            end = as_utc(datetime.fromisoformat(last))
    except (ValueError, OverflowError):
        raise ForecastError(f"--time {given!r}: give it as {form}") from None
    if end < begin:
        raise ForecastError(f"--time {given!r}: ends before it begins")
    return float(seconds_of(begin)), float(seconds_of(end))
