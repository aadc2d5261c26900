"""What is reported from outside while a mission is under way: obstacles and currents, as lines of a file.

Each line is a JSON object. Other programs append to the file; it is read on as it grows.
"""

import json
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from auvplan.errors import AuvplanError
from auvplan.link.vehicle import one_line
from auvplan.ocean.known import KnownObstacle
from auvplan.runtime.arrays import Array
from auvplan.site import Site

_PLACE = "longitude", "latitude", "north", "east"

#: m, depths that may be stated.
_DEPTHS = 0.0, 12_000.0

#: Each line has one of them, and may have these fields more.
_KINDS = {
    "obstacle": (*_PLACE, "radius", "course", "speed", "depth_min", "depth_max"),
    "current": (*_PLACE, "depth"),
    "gone": (),
}


@dataclass(frozen=True)
class ObstacleNotice:
    """An obstacle where it is now: its position is that of the moment when it is reported."""

    obstacle: KnownObstacle


@dataclass(frozen=True)
class CurrentNotice:
    """A current that was measured.

    Attributes:
        velocity: [3] m/s north, east, down.
        position: [3] m, where; None for where the vehicle is.
    """

    velocity: Array
    position: Array | None = None


@dataclass(frozen=True)
class GoneNotice:
    """An obstacle of this name, that was reported before, is gone."""

    name: str


Notice = ObstacleNotice | CurrentNotice | GoneNotice


class Notices(Protocol):
    """A source of notices."""

    def read(self) -> Iterator[Notice | str]:
        """Yield what is new; text where a notice cannot be understood."""
        ...


class AllNotices:
    """Several sources of notices, or none."""

    def __init__(self, *sources: Notices) -> None:
        """Gather sources."""
        self._sources = sources

    def read(self) -> Iterator[Notice | str]:
        """Yield what is new from each."""
        for source in self._sources:
            yield from source.read()


class NoticeFile:
    """Notices from a file of JSON lines.

    `{"obstacle": "ferry", "longitude": 148.97, "latitude": -20.35, "radius": 80, "course": 90, "speed": 3}`,
    or `{"current": [0.4, -0.1, 0], "longitude": 148.97, "latitude": -20.35, "depth": 10}`, or
    `{"gone": "ferry"}`; `north` and `east`, metres, may stand for longitude and latitude; a current without a
    place is that at the vehicle. Courses and currents count from true north at places in degrees, and from
    the local frame's north otherwise.
    """

    def __init__(self, path: str | Path, site: Site) -> None:
        """Read from the file's beginning.

        Raises:
            AuvplanError: the file cannot be read; one line.
        """
        self._path, self._site, self._place, self._line = Path(path), site, 0, 0
        self._gone = False
        self._unread = set[str]()  # fields that are not known, as far as they were said
        if self._path.exists() and not self._path.is_file():
            raise AuvplanError(f"{path}: is no file of lines")
        try:
            self._path.open("rb").close()
        except OSError as error:
            raise AuvplanError(
                f"{path}: {error.strerror or error}: create it empty, lines may follow"
            ) from None

    def read(self) -> Iterator[Notice | str]:
        """Yield what whole lines were added, as notices or as text that says what is wrong.

        A file that has become shorter, or was away, was started again, and is read from its beginning.
        """
        try:
            with self._path.open("rb") as file:
                if file.seek(0, os.SEEK_END) < self._place:
                    self._place = self._line = 0
                file.seek(self._place)
                text = file.read()
        except OSError as error:
            if not self._gone:
                yield f"{self._path}: {error.strerror or error}"
            self._gone, self._place, self._line = True, 0, 0
            return
        self._gone = False
        whole = text[: text.rfind(b"\n") + 1]
        self._place += len(whole)
        for line in whole.splitlines():
            self._line += 1
            if not line.strip():
                continue
            try:
                found = json.loads(line)
                yield self._notice(found)
                yield from self._left_out(found)
            except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
                yield f"{self._path}, line {self._line}: {one_line(str(error))[:300]}; not taken in"

    def _notice(self, found: Any) -> Notice:
        if not isinstance(found, dict) or sum(kind in found for kind in _KINDS) != 1:
            raise ValueError(f"must be an object with one of {', '.join(map(repr, _KINDS))}")
        if "gone" in found:
            return GoneNotice(_name(found["gone"]))
        place = self._position(found)
        if "current" in found:
            velocity = found["current"]
            if not isinstance(velocity, list) or len(velocity) not in (2, 3):
                raise ValueError("current: must be [north, east] or [north, east, down] in m/s")
            parts = [_number({"current": part}, "current", (-10.0, 10.0)) for part in velocity]
            depth = _number(found, "depth", _DEPTHS, 0.0)
            at = None if place is None else np.asarray([*place, depth])
            return CurrentNotice(np.asarray([*self._turned(found, *parts[:2]), *parts[2:], 0.0][:3]), at)
        if place is None:
            raise ValueError("obstacle: needs longitude and latitude, or north and east")
        speed = _number(found, "speed", (0.0, 50.0), 0.0)
        course = math.radians(_number(found, "course", (-360.0, 360.0), None if speed else 0.0))
        radius = _number(found, "radius", (0.1, 100_000.0))
        top, bottom = (
            _number(found, "depth_min", _DEPTHS, 0.0),
            _number(found, "depth_max", _DEPTHS, math.inf),
        )
        if bottom < top:
            raise ValueError(f"depth_max: {bottom:g} is above depth_min, {top:g}")
        velocity = self._turned(found, speed * math.cos(course), speed * math.sin(course))
        return ObstacleNotice(KnownObstacle(_name(found["obstacle"]), place, radius, top, bottom, velocity))

    def _left_out(self, found: dict[str, Any]) -> Iterator[str]:
        """Yield what of a notice that was taken in was not, once for each field."""
        kind = next(kind for kind in _KINDS if kind in found)
        if unread := sorted(set(found) - {kind, *_KINDS[kind]} - self._unread):
            self._unread |= set(unread)
            fields, known = ", ".join(map(one_line, unread)), ", ".join(_KINDS[kind]) or "none"
            yield f"{self._path}, line {self._line}: not read: {fields[:200]}; {kind} has {known}"

    def _turned(self, found: dict[str, Any], north: float, east: float) -> tuple[float, float]:
        """Return a velocity in the local frame: at a place in degrees it is given by true north and east."""
        if "longitude" not in found:
            return north, east
        turned = self._site.local_vector(north, east, found["longitude"], found["latitude"])
        return float(turned[0]), float(turned[1])

    def _position(self, found: dict[str, Any]) -> tuple[float, float] | None:
        """Return north and east, m, or None without a place."""
        degrees, metres = ("longitude", "latitude"), ("north", "east")
        if any(name in found for name in degrees) and any(name in found for name in metres):
            raise ValueError("a place is longitude and latitude, or north and east, not both")
        if "longitude" in found or "latitude" in found:
            spans = (-180.0, 360.0), (-90.0, 90.0)
            north, east = self._site.to_local(*map(_number, (found, found), degrees, spans))
            return float(north), float(east)
        if "north" in found or "east" in found:
            return _number(found, "north", (-1e7, 1e7)), _number(found, "east", (-1e7, 1e7))
        return None


def _name(found: Any) -> str:
    return one_line(str(found))[:100] or "obstacle"


def _number(
    found: dict[str, Any], name: str, span: tuple[float, float], default: float | None = None
) -> float:
    """Return a number within limits, or its default."""
    value = default if found.get(name) is None else found[name]
    if value is None:
        raise ValueError(f"{name}: is missing")
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise ValueError(f"{name}: must be a number, got {value!r:.60}")
    if value != default and not span[0] <= value <= span[1]:
        raise ValueError(f"{name}: must be from {span[0]:g} to {span[1]:g}, got {value:g}")
    return float(value)
