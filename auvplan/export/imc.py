"""A PlanSpecification of LSTS's Inter-Module Communication (IMC 5.4), as XML.

Messages are elements by their abbreviation, fields elements by theirs, lists of messages elements in one:
what imcjava's `IMCMessage.asXml` writes and Neptus reads.

Speeds are those to command DUNE so that it makes the planned ones, by a model of its speed control. It holds
what it makes over ground along its hull, by its Doppler log (Control/AUV/Speed). An integral part learns what
a current adds, and until it has, the vehicle is faster with the current and slower against it. A task is a
circle about its place, which the vehicle leaves where its time ends: the next leg begins there.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
from pyproj import Geod

from auvplan.export.itinerary import ExportError, Itinerary, PlannedLeg, geographic, metres, stays_for
from auvplan.export.markup import Element, child, xml_text
from auvplan.export.speeds import LEAST, Stretch, approach, speed_note, stretches
from auvplan.runtime.arrays import Array
from auvplan.site import as_utc

#: Definitions that the fields are from.
VERSION = "5.4.11"

#: s, largest number in IMC's fields for timeouts and durations, of 16 bits.
_LONGEST = 65_535

#: A manoeuvre counts as failed after its planned time by this factor, and these s more.
_PATIENCE, _SLACK = 2.0, 600.0

#: m; a depth that small is the surface.
_SURFACE = 1e-3

#: A field's text, or the messages in it.
_Fields = dict[str, "str | Sequence[Element]"]


#: m, radius of station keeping and of loitering: inside a planner's default distance to the coast.
RADIUS = 10.0

#: Radius that is gone by that of the message, and radians of the circle, past its course, at which the time
#: of a task begins to count; by DUNE's log.
_WIDER, _COUNTS = 1.044, 0.03

#: s in which all but 1/e of a current is learnt, by DUNE's log: 25 rpm for every m/s and s that it is off,
#: where a thousand rpm make about a metre a second (etc/auv/control.ini).
_LEARNS = 31.0

#: m/s that it has learnt, wrongly, when it has got under way from rest; by DUNE's log.
_RISING = -0.23

#: m, radius of the turn from the circle onto the next leg; by DUNE's log.
_TURN = 5.5

#: How many times the planned speed is asked for at most: on a short leg more would be, which may not be had.
_MOST = 1.35

#: s of a task after which it cannot be said where on its circle the vehicle is; and s of a step.
_LOST, _STEP = 300.0, 0.2


def imc_text(itinerary: Itinerary) -> bytes:
    """Return an XML document of one PlanSpecification.

    The vehicle goes to the first waypoint, follows each leg's path and then does its task: it loiters at the
    task's depth, or keeps station where that is the surface, because IMC's station keeping surfaces. Where
    the plan surfaces for a fix it pops up after the task. At the end it stays for good: at the surface, or at
    depth, where keeping station is loitering too.

    Raises:
        ExportError: a leg or task is longer than IMC's fields can hold.
    """
    root = plan_specification(itinerary)
    departure = itinerary.site.utc(float(itinerary.legs[0].times[0]))
    unknown = {"src": "65535", "dst": "65535", "src_ent": "255", "dst_ent": "255"}
    time = 0.0 if departure is None else as_utc(departure).timestamp()
    root.attrib.update({"imcv": VERSION, "time": f"{time:.3f}"} | unknown)
    return xml_text(root)


def plan_specification(itinerary: Itinerary) -> Element:
    """Return the message of an itinerary.

    Raises:
        ExportError: a leg or task is longer than IMC's fields can hold.
    """
    description = f"{itinerary.description}; {speed_note(itinerary)}"
    return _plan(itinerary.name, description, _manoeuvres(itinerary))


def stay_specification(itinerary: Itinerary, position: Array, name: str) -> Element:
    """Return the message of a plan to stay at a place, [3] m, until commanded otherwise."""
    return _plan(name, "stay", [("stay", _stay(itinerary, position, 0, _LONGEST))])


def _plan(name: str, description: str, manoeuvres: list[tuple[str, Element]]) -> Element:
    """Return a PlanSpecification of manoeuvres, one after the other."""
    names = [name for name, _ in manoeuvres]
    plaintext = description.encode("ascii", "replace").decode("ascii")  # as IMC has it
    return _message("PlanSpecification", {
        "plan_id": plan_identifier(name), "description": plaintext,
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
        if leg.hold > leg.rise:
            seconds, kind = math.ceil(leg.hold - leg.rise), stays_for(leg)
            what = f"{kind} of leg {leg.number}"
            if seconds > _LONGEST:
                raise ExportError(f"IMC plan: the {what} takes {seconds} s, at most {_LONGEST}")
            stay = _stay(itinerary, leg.waypoints[-1], seconds, _timeout(float(seconds), what))
            found.append((f"{kind}{leg.number}", stay))
        if leg.rise > 0.0:
            found.append((f"fix{leg.number}", _surfacing(itinerary, leg)))
    end = itinerary.legs[-1].waypoints[-1].copy()
    if itinerary.end == "surface":
        end[2] = 0.0
    return [*found, ("end", _stay(itinerary, end, 0, _LONGEST))]


def _leg(itinerary: Itinerary, leg: PlannedLeg, parts: list[Stretch]) -> list[tuple[str, Element]]:
    """Return names and messages that go along a leg by its stretches."""
    name, last = f"leg{leg.number}", len(leg.kept) - 1
    patience = _timeout(float(leg.kept_times[-1] - leg.kept_times[0]), f"leg {leg.number}")
    if last == 0:
        return [(name, _goto(itinerary, leg.waypoints[0], itinerary.through_water(leg), patience))]
    found = []
    for part in parts:
        called = f"{name}_last{last - part.first}" if part.first else name
        first, end = leg.waypoints[part.first], leg.waypoints[part.last]
        seconds = math.ceil(leg.kept_times[part.last] - leg.kept_times[part.first])
        if not (end - first).any():
            rest = _stay(itinerary, end, seconds, _timeout(float(seconds), f"rest on leg {leg.number}"))
            found.append((called, rest))
        elif part.last - part.first > 1:
            found.append((called, _follow_path(itinerary, leg, part, patience)))
        else:
            found.append((called, _goto(itinerary, end, part.speed, patience)))
    return found


def _follow_path(itinerary: Itinerary, leg: PlannedLeg, part: Stretch, timeout: int) -> Element:
    """Points by their true north, east and down offsets from the first."""
    waypoints = leg.waypoints[part.first : part.last + 1]
    longitude, latitude, _ = geographic(itinerary.site, waypoints).T
    bearing, _, distance = Geod(ellps="WGS84").inv(
        np.full_like(longitude, longitude[0]), np.full_like(latitude, latitude[0]), longitude, latitude
    )
    angle = np.radians(bearing)
    offsets = np.stack(
        [distance * np.cos(angle), distance * np.sin(angle), waypoints[:, 2] - waypoints[0, 2]], axis=1
    )
    points = [_message("PathPoint", dict(zip("xyz", map(metres, offset), strict=True))) for offset in offsets]
    return _message("FollowPath", {
        "timeout": str(timeout), **_place(itinerary, waypoints[0]), **_speed(part.speed), "points": points,
        "custom": "",
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


def _surfacing(itinerary: Itinerary, leg: PlannedLeg) -> Element:
    """Surface at a leg's end and keep station there for a fix; the next manoeuvre leads down again."""
    timeout = _timeout(leg.rise, f"surfacing after leg {leg.number}")
    return _message("PopUp", {
        "timeout": str(timeout), **_place(itinerary, leg.waypoints[-1]), **_speed(itinerary.speed),
        "duration": str(math.ceil(leg.fix)), "radius": metres(RADIUS),
        "flags": "WAIT_AT_SURFACE|STATION_KEEP", "custom": "",
    })  # fmt: skip


def _place(itinerary: Itinerary, position: Array) -> dict[str, str]:
    """Latitude and longitude in radians, and depth."""
    ((longitude, latitude, _),) = geographic(itinerary.site, position[None]).tolist()
    return {
        "lat": f"{math.radians(latitude):.12f}",
        "lon": f"{math.radians(longitude):.12f}",
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


def plan_identifier(name: str) -> str:
    """Letters, digits, dashes and underscores, as plan names are files and keys to many tools."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_") or "mission"


@dataclass(frozen=True)
class Begun:
    """How a vehicle begins a leg.

    Attributes:
        learnt: m/s, what its speed control takes for the current along the hull.
        place: [2] m north and east, where it leaves the circle of a task; None where there was none.
        course: rad, there; NaN where not known.
    """

    learnt: float = 0.0
    place: Array | None = None
    course: float = math.nan


def first_begun(itinerary: Itinerary) -> Begun:
    """Return how an itinerary's first leg is begun: at rest, or under way where a leg before was cut."""
    leg = itinerary.legs[0]
    if np.isfinite(leg.led[1]):
        return Begun(leg.led[1] - itinerary.through_water(leg))
    return Begun(_RISING if leg.number == 1 else 0.0)


def commanded(itinerary: Itinerary, leg: PlannedLeg, begun: Begun) -> tuple[list[Stretch], Begun]:
    """Return a leg's stretches at speeds by which they take the planned times, and how the next is begun."""
    parts = stretches(itinerary, leg, along_hull=True)
    if not itinerary.over_ground:
        return parts, Begun()
    found, learnt = [], begun.learnt
    for part in parts:
        seconds = max(float(leg.kept_times[part.last] - leg.kept_times[part.first]), 1e-9)
        current, left = part.speed - itinerary.through_water(leg), math.exp(-seconds / _LEARNS)
        ahead = (current - learnt) * (1.0 - left) * _LEARNS / seconds
        longer = _longer(leg, part, begun) if part.first == 0 else 1.0
        speed = min(part.speed * longer - ahead, part.speed * _MOST)
        found.append(part._replace(speed=max(speed, LEAST)))
        learnt = current - (current - learnt) * left
    return found, _after_task(itinerary, leg, learnt) if leg.hold > 0.0 else Begun(learnt)


def _longer(leg: PlannedLeg, part: Stretch, begun: Begun) -> float:
    """Return by what factor a leg's first stretch is longer from where the vehicle is, its turn included."""
    if begun.place is None:
        return 1.0
    lines = np.linalg.norm(np.diff(leg.waypoints[part.first : part.last + 1], axis=0), axis=1)
    step = leg.waypoints[1][:2] - begun.place
    gap = math.hypot(*step, float(leg.waypoints[1][2] - leg.waypoints[0][2]))
    turn = abs(math.remainder(math.atan2(step[1], step[0]) - begun.course, 2.0 * math.pi))
    detour = turn - math.sin(turn) if math.isfinite(turn) else 0.5 * math.pi - 2.0 / math.pi
    return float((lines.sum() - lines[0] + gap + _TURN * detour) / max(lines.sum(), 1e-9))


def _after_task(itinerary: Itinerary, leg: PlannedLeg, learnt: float) -> Begun:
    """Return how the leg after a task is begun; the circle is gone clockwise."""
    hold, radius = math.ceil(leg.hold), _WIDER * RADIUS
    if leg.rise or hold > _LOST or leg.waypoints[-1][2] <= 0.0 or len(leg.waypoints) < 2:
        return Begun(0.0, leg.waypoints[-1][:2])
    current, step = _current(itinerary, leg), leg.waypoints[-1] - leg.waypoints[-2]
    right = np.array([-step[1], step[0]]) / max(float(np.hypot(step[0], step[1])), 1e-9)
    crab = -math.asin(float(np.clip(current @ right / itinerary.through_water(leg), -1.0, 1.0)))
    angle, total = math.atan2(step[1], step[0]) + _COUNTS + crab, float(current @ current)
    for _ in range(round(hold / _STEP)):
        along = float(current @ [-math.sin(angle), math.cos(angle)])
        water = max(itinerary.speed - learnt, LEAST)
        made = along + math.sqrt(max(water**2 - total + along**2, 0.0))
        learnt += _STEP / _LEARNS * ((made * along - total) / water - learnt)
        angle += _STEP * made / radius
    place = leg.waypoints[-1][:2] + radius * np.array([math.cos(angle), math.sin(angle)])
    return Begun(learnt, place, angle + 0.5 * math.pi)


def _current(itinerary: Itinerary, leg: PlannedLeg) -> Array:
    """Return [2] m/s north and east that are planned for at a leg's end; 0 where not known."""
    last = leg.motion[-1:]
    level = np.cos(last.pitch)
    hull = np.stack([level * np.cos(last.yaw), level * np.sin(last.yaw)], axis=1)
    found = last.ground_velocity[0, :2] - leg.pace * itinerary.through_water(leg) * hull[0]
    return found if np.isfinite(found).all() else np.zeros(2)
