"""A PlanSpecification of LSTS's Inter-Module Communication (IMC 5.4), as XML.

Messages are elements by their abbreviation, fields elements by theirs, lists of messages elements in one:
what imcjava's `IMCMessage.asXml` writes and Neptus reads.
"""

import math
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from pyproj import Geod

from auvplan.export.dune import RADIUS, commanded, first_begun
from auvplan.export.itinerary import ExportError, Itinerary, PlannedLeg
from auvplan.export.markup import Element, child, write_xml
from auvplan.export.places import metres
from auvplan.export.speeds import Stretch, approach, speed_note
from auvplan.site import as_utc

Array = NDArray[np.floating]

#: Definitions that the fields are from.
VERSION = "5.4.11"

#: s, largest number in IMC's fields for timeouts and durations, of 16 bits.
_LONGEST = 65_535

#: A manoeuvre is given so many times its planned time, and so many s more, before it counts as failed.
_PATIENCE, _SLACK = 2.0, 600.0

#: m; a depth that small is the surface.
_SURFACE = 1e-3

#: A field's text, or the messages in it.
_Fields = dict[str, "str | Sequence[Element]"]


def write_imc(itinerary: Itinerary, path: str | Path) -> Path:
    """Write an `.xml` file of one PlanSpecification.

    The vehicle goes to the first waypoint, follows each leg's path and then does its task: it loiters at the
    task's depth, or keeps station where that is the surface, because IMC's station keeping surfaces. At the
    end it does so for good: at the surface, or at depth, where keeping station is loitering too.

    Raises:
        ExportError: a leg or task is longer than IMC's fields can tell.
        OutputError: the operating system refused; one line that names the file.
    """
    root = plan_specification(itinerary)
    departure = itinerary.site.utc(float(itinerary.legs[0].times[0]))
    unknown = {"src": "65535", "dst": "65535", "src_ent": "255", "dst_ent": "255"}
    time = 0.0 if departure is None else as_utc(departure).timestamp()
    root.attrib.update({"imcv": VERSION, "time": f"{time:.3f}"} | unknown)
    return write_xml(root, path)


def plan_specification(itinerary: Itinerary) -> Element:
    """Return the message of an itinerary.

    Raises:
        ExportError: a leg or task is longer than IMC's fields can tell.
    """
    description = f"{itinerary.description}; {speed_note(itinerary)}"
    return _plan(itinerary.name, description, _manoeuvres(itinerary))


def stay_specification(itinerary: Itinerary, position: Array, name: str) -> Element:
    """Return the message of a plan to stay at a place, [3] m, until told otherwise."""
    return _plan(name, "stay", [("stay", _stay(itinerary, position, 0, _LONGEST))])


def _plan(name: str, description: str, manoeuvres: list[tuple[str, Element]]) -> Element:
    """Return a PlanSpecification of manoeuvres, one after the other."""
    names = [name for name, _ in manoeuvres]
    return _message("PlanSpecification", {
        "plan_id": plan_identifier(name), "description": _ascii(description),
        "vnamespace": "", "variables": (), "start_man_id": names[0],
        "maneuvers": [
            _message("PlanManeuver", {
                "maneuver_id": name, "data": [data], "start_actions": (), "end_actions": (),
            }) for name, data in manoeuvres
        ],
        "transitions": [
            _message("PlanTransition", {
                "source_man": source, "dest_man": target, "conditions": "ManeuverIsDone", "actions": (),
            }) for source, target in pairwise(names)
        ],
        "start_actions": (), "end_actions": (),
    })  # fmt: skip


def _manoeuvres(itinerary: Itinerary) -> list[tuple[str, Element]]:
    """Return names and messages in order.

    A leg that is gone at several speeds is as many manoeuvres, as IMC has one speed for each. The later ones
    are called by the waypoints that are left.
    """
    first = itinerary.legs[0]
    begin = approach(itinerary, first, along_hull=True)
    found = [("start", _goto(itinerary, first.waypoints[0], begin, _LONGEST))]
    begun = first_begun(itinerary)
    for leg in itinerary.legs:
        parts, begun = commanded(itinerary, leg, begun)
        found += _leg(itinerary, leg, parts)
        if leg.hold > 0.0:
            seconds, what = math.ceil(leg.hold), f"task of leg {leg.number}"
            if seconds > _LONGEST:
                raise ExportError(f"IMC plan: the {what} takes {seconds} s, at most {_LONGEST}")
            task = _stay(itinerary, leg.waypoints[-1], seconds, _timeout(float(seconds), what))
            found.append((f"task{leg.number}", task))
    end = itinerary.legs[-1].waypoints[-1].copy()
    if itinerary.end == "surface":
        end[2] = 0.0
    return [*found, ("end", _stay(itinerary, end, 0, _LONGEST))]


def _leg(itinerary: Itinerary, leg: PlannedLeg, parts: list[Stretch]) -> list[tuple[str, Element]]:
    """Return names and messages that go along a leg by its stretches."""
    name, last = f"leg{leg.number}", len(leg.kept) - 1
    patience = _timeout(float(leg.kept_times[-1] - leg.kept_times[0]), f"leg {leg.number}")
    if last == 0:
        return [(name, _goto(itinerary, leg.waypoints[0], itinerary.speed, patience))]
    found = []
    for part in parts:
        called = f"{name}_last{last - part.first}" if part.first else name
        if part.last - part.first > 1:
            found.append((called, _follow_path(itinerary, leg, part, patience)))
        else:
            found.append((called, _goto(itinerary, leg.waypoints[part.last], part.speed, patience)))
    return found


def _follow_path(itinerary: Itinerary, leg: PlannedLeg, part: Stretch, timeout: int) -> Element:
    """Points by their true north, east and down offsets from the first."""
    waypoints = leg.waypoints[part.first : part.last + 1]
    place = _place(itinerary, waypoints[0])
    longitude, latitude = itinerary.site.to_geographic(waypoints[:, 0], waypoints[:, 1])
    bearing, _, distance = Geod(ellps="WGS84").inv(
        np.full_like(longitude, longitude[0]), np.full_like(latitude, latitude[0]), longitude, latitude
    )
    angle = np.radians(bearing)
    offsets = np.stack(
        [distance * np.cos(angle), distance * np.sin(angle), waypoints[:, 2] - waypoints[0, 2]], axis=1
    )
    points = [_message("PathPoint", dict(zip("xyz", map(metres, offset), strict=True))) for offset in offsets]
    return _message("FollowPath", {
        "timeout": str(timeout), **place, **_speed(part.speed), "points": points, "custom": "",
    })  # fmt: skip


def _goto(itinerary: Itinerary, position: Array, speed: float, timeout: int) -> Element:
    attitude = {"roll": "-1.0", "pitch": "-1.0", "yaw": "-1.0"}  # which leaves it to the vehicle
    return _message("Goto", {
        "timeout": str(timeout), **_place(itinerary, position), **_speed(speed), **attitude, "custom": "",
    })  # fmt: skip


def _stay(itinerary: Itinerary, position: Array, seconds: int, timeout: int) -> Element:
    """Stay about a place for so long; 0 s is without an end."""
    place, speed, radius = _place(itinerary, position), _speed(itinerary.speed), metres(RADIUS)
    if position[2] <= _SURFACE:
        return _message("StationKeeping", {
            **place, "radius": radius, "duration": str(seconds), **speed, "custom": "",
        })  # fmt: skip
    return _message("Loiter", {
        "timeout": str(timeout), **place, "duration": str(seconds), **speed,
        "type": "CIRCULAR", "radius": radius, "length": "1.0", "bearing": "0.0", "direction": "VDEP",
        "custom": "",
    })  # fmt: skip


def _place(itinerary: Itinerary, position: Array) -> dict[str, str]:
    """Latitude and longitude in radians, and depth."""
    longitude, latitude = itinerary.site.to_geographic(position[0], position[1])
    return {
        "lat": f"{math.radians(float(latitude)):.12f}",
        "lon": f"{math.radians(float(longitude)):.12f}",
        "z": metres(position[2]),
        "z_units": "DEPTH",
    }


def _speed(speed: float) -> dict[str, str]:
    return {"speed": metres(speed), "speed_units": "METERS_PS"}


def _timeout(seconds: float, what: str) -> int:
    if seconds > _LONGEST:
        raise ExportError(f"IMC plan: {what} takes {seconds:.0f} s, at most {_LONGEST}")
    return min(_LONGEST, math.ceil(_PATIENCE * seconds + _SLACK))


def _message(name: str, fields: _Fields) -> Element:
    element = ElementTree.Element(name)
    for field, value in fields.items():
        if isinstance(value, str):
            child(element, field, value)
        else:
            child(element, field).extend(value)
    return element


def _ascii(text: str) -> str:
    """IMC's plaintext is ASCII."""
    return text.encode("ascii", "replace").decode("ascii")


def plan_identifier(name: str) -> str:
    """Letters, digits, dashes and underscores, as plan names are files and keys to many tools."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_") or "mission"
