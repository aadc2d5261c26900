"""Speeds to command DUNE so that it makes the planned ones: a model of its speed control.

DUNE holds what it makes over ground along its hull, by its Doppler log (Control/AUV/Speed). An integral part
learns what a current adds, and until it has, the vehicle is faster with the current and slower against it. A
task is a circle about its place, which the vehicle leaves where its time ends: the way on begins there.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auvplan.export.itinerary import Itinerary, PlannedLeg
from auvplan.export.speeds import LEAST, Stretch, stretches

Array = NDArray[np.floating]

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

#: m, radius of the turn from the circle onto the way on; by DUNE's log.
_TURN = 5.5

#: How many times the planned speed is asked for at most: on a short leg more would be, which may not be had.
_MOST = 1.35

#: s of a task after which it cannot be said where on its circle the vehicle is; and s of a step.
_LOST, _STEP = 300.0, 0.2


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
        return Begun(leg.led[1] - itinerary.speed)
    return Begun(_RISING if leg.number == 1 else 0.0)


def commanded(itinerary: Itinerary, leg: PlannedLeg, begun: Begun) -> tuple[list[Stretch], Begun]:
    """Return a leg's stretches at speeds by which they take the planned times, and how the next is begun."""
    parts = stretches(itinerary, leg, along_hull=True)
    if not itinerary.over_ground:
        return parts, Begun()
    found, learnt = [], begun.learnt
    for part in parts:
        seconds = max(float(leg.kept_times[part.last] - leg.kept_times[part.first]), 1e-9)
        current, left = part.speed - itinerary.speed, math.exp(-seconds / _LEARNS)
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
    way = leg.waypoints[1][:2] - begun.place
    gap = math.hypot(*way, float(leg.waypoints[1][2] - leg.waypoints[0][2]))
    turn = abs(math.remainder(math.atan2(way[1], way[0]) - begun.course, 2.0 * math.pi))
    detour = turn - math.sin(turn) if math.isfinite(turn) else 0.5 * math.pi - 2.0 / math.pi
    return float((lines.sum() - lines[0] + gap + _TURN * detour) / max(lines.sum(), 1e-9))


def _after_task(itinerary: Itinerary, leg: PlannedLeg, learnt: float) -> Begun:
    """Return how the leg after a task is begun; the circle is gone clockwise."""
    hold, radius = math.ceil(leg.hold), _WIDER * RADIUS
    if hold > _LOST or leg.waypoints[-1][2] <= 0.0 or len(leg.waypoints) < 2:
        return Begun(0.0, leg.waypoints[-1][:2])
    current, way = _current(itinerary, leg), leg.waypoints[-1] - leg.waypoints[-2]
    right = np.array([-way[1], way[0]]) / max(float(np.hypot(way[0], way[1])), 1e-9)
    crab = -math.asin(float(np.clip(current @ right / itinerary.speed, -1.0, 1.0)))
    angle, total = math.atan2(way[1], way[0]) + _COUNTS + crab, float(current @ current)
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
    found = last.ground_velocity[0, :2] - itinerary.speed * hull[0]
    return found if np.isfinite(found).all() else np.zeros(2)
