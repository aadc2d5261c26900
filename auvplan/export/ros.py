"""A geographic_msgs/GeoPath of ROS 2 as CDR bytes, as its middleware and bags carry messages.

Altitude is minus depth; the attitude is the course to the next waypoint, level, in ROS's frame of true east,
north and up.
"""

import math
import struct

import numpy as np

from auvplan.export.itinerary import ExportError, Itinerary, elevation, waypoints
from auvplan.site import as_utc

#: Name of the message's type.
TYPE = "geographic_msgs/msg/GeoPath"

#: Plain CDR, little-endian.
_ENCAPSULATION = bytes((0, 1, 0, 0))

#: Frame of latitude, longitude and height on the WGS 84 ellipsoid.
_FRAME = "wgs84"


def geo_path(itinerary: Itinerary) -> bytes:
    """Return the waypoints with times of arrival, since 1970 or, without a date, since the epoch.

    Raises:
        ExportError: a time is beyond those of ROS.
    """
    rows, cdr = waypoints(itinerary), _Cdr()
    # In the local frame, to the next waypoint; at the last, the course there.
    steps = np.diff(np.asarray([row.position for row in rows]), axis=0)
    courses = np.append(np.arctan2(steps[:, 1], steps[:, 0]), 0.0)
    courses[-1] = courses[max(len(steps) - 1, 0)]
    courses -= itinerary.site.true_north([row.longitude for row in rows], [row.latitude for row in rows])
    _header(cdr, itinerary, float(itinerary.legs[0].times[0]))
    cdr.number("I", len(rows))
    for row, course in zip(rows, courses.tolist(), strict=True):
        _header(cdr, itinerary, row.seconds)
        angle = 0.5 * (0.5 * math.pi - course)
        place = row.latitude, row.longitude, elevation(row.depth)
        for value in (*place, 0.0, 0.0, math.sin(angle), math.cos(angle)):
            cdr.number("d", value)
    return _ENCAPSULATION + bytes(cdr.data)


def _header(cdr: "_Cdr", itinerary: Itinerary, seconds: float) -> None:
    then = itinerary.site.utc(seconds)
    nanoseconds = round((seconds if then is None else as_utc(then).timestamp()) * 1e6) * 1000
    if not -(2**31) <= nanoseconds // 10**9 < 2**31:
        raise ExportError("GeoPath: a ROS time is from 1901 to 2038")
    cdr.number("i", nanoseconds // 10**9)
    cdr.number("I", nanoseconds % 10**9)
    cdr.text(_FRAME)


class _Cdr:
    """Values one after the other, each at a multiple of its size."""

    def __init__(self) -> None:
        self.data = bytearray()

    def number(self, kind: str, value: float) -> None:
        self.data += bytes(-len(self.data) % struct.calcsize(kind)) + struct.pack(f"<{kind}", value)

    def text(self, value: str) -> None:
        content = value.encode() + b"\0"
        self.number("I", len(content))
        self.data += content
