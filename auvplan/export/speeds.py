"""Speeds that a vehicle is given for its lines, and what it may not be able to follow on them.

Autopilots hold a speed over ground where they see the ground, and the plan keeps one through the water: over
ground it makes more on one line than on another. A vehicle that is given what each line is planned to make
keeps the plan's times, and its speed through the water.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from auvplan.runtime.arrays import Array

if TYPE_CHECKING:
    from auvplan.export.itinerary import Itinerary, PlannedLeg

#: m/s, least that is asked for: ArduSub takes no less (AC_WPNav), and to DUNE less is to stop
#: (Control/AUV/Speed).
LEAST = 0.1

#: Lines one after the other whose speeds are within such a share of their mean are given that.
ALIKE = 0.05

#: Share of the speed through the water below which a leg counts as slow over ground.
SLOW = 0.5

#: m, lines shorter than this lead from one task to another in the same place.
_NOWHERE = 0.5

#: Degrees, steepest dive of common vehicles.
STEEPEST = 30.0

#: Degrees by which a line may be steeper: it is as steep as the vehicle's own limit where that binds, and
#: lines in place of a path may take a hundredth of a metre a second more (`thin`).
_ROUNDING = 0.5


class Stretch(NamedTuple):
    """Lines of a leg that are gone at one speed.

    Attributes:
        first, last: waypoints of the leg that it leads from and to.
        speed: m/s.
    """

    first: int
    last: int
    speed: float


def led(leg: "PlannedLeg") -> Array:
    """Return [k, 2] m/s that are asked for on a leg's lines over ground, and of it along the hull.

    It is to each waypoint; of it the vehicle makes `PlannedLeg.pace`. The hull points where the vehicle moves
    through the water, so that across a current it sees less than it makes. What leads to the first waypoint
    is known of a leg that was cut; NaN where it is not.
    """
    gaps = np.linalg.norm(np.diff(leg.waypoints, axis=0), axis=1)
    over_ground = gaps / np.maximum(np.diff(leg.kept_times), 1e-9) / leg.pace
    body = leg.motion.body_velocity
    length = np.linalg.norm(body, axis=1)
    ahead = np.where(length > 0.0, body[:, 0] / np.where(length > 0.0, length, 1.0), np.nan)
    shares = []
    for first, last in pairwise(leg.kept):
        known = ahead[first:last][np.isfinite(ahead[first:last])]
        shares.append(float(known.mean()) if len(known) else 1.0)
    lines = np.stack([over_ground, over_ground * np.asarray(shares)], axis=1).reshape(-1, 2)
    return np.concatenate([[leg.led], lines])


def stretches(itinerary: "Itinerary", leg: "PlannedLeg", *, along_hull: bool = False) -> list[Stretch]:
    """Return the lines of a leg by the speeds that they are gone at, in order.

    Args:
        itinerary: which says whether vehicles are given speeds over ground, or that through the water.
        leg: of it.
        along_hull: whether the vehicle holds what it makes over ground along its hull, as one does whose
            Doppler log is its measure.
    """
    last = len(leg.kept) - 1
    if not itinerary.over_ground:
        return [Stretch(0, last, itinerary.through_water(leg))] if last else []
    speeds, times = led(leg)[1:, int(along_hull)], np.maximum(np.diff(leg.kept_times), 1e-9)
    found, begin = [], 0
    for end in range(1, last + 1):
        mean = _over(speeds, times, begin, end)
        if end < last:
            longer = speeds[begin : end + 1] / _over(speeds, times, begin, end + 1)
            if (np.abs(longer - 1.0) <= ALIKE).all():
                continue
        found.append(Stretch(begin, end, max(mean, LEAST)))
        begin = end
    return found


def approach(itinerary: "Itinerary", leg: "PlannedLeg", *, along_hull: bool = False) -> float:
    """Return m/s at which the first waypoint of a leg is gone to."""
    known = leg.led[int(along_hull)]
    given = itinerary.over_ground and np.isfinite(known)
    return max(float(known), LEAST) if given else itinerary.through_water(leg)


def speed_note(itinerary: "Itinerary") -> str:
    """Return what the speeds in a vehicle's file are, in words."""
    if itinerary.over_ground:
        return "speeds are over ground, line by line as planned in the forecast current"
    return f"the speed {f'of each leg, {itinerary.speeds}, ' if itinerary.speeds else ''}is through the water"


def _over(speeds: Array, times: Array, begin: int, end: int) -> float:
    """Return m/s, the mean over the time of some lines."""
    return float(speeds[begin:end] @ times[begin:end] / times[begin:end].sum())


def ground_share(leg: "PlannedLeg", speed: float) -> float:
    """Return the least share of a speed, m/s, that a leg's straight lines are planned to make over ground.

    A leg that leads nowhere has 1.
    """
    gaps = np.linalg.norm(np.diff(leg.waypoints, axis=0), axis=1)
    shares = gaps / np.maximum(np.diff(leg.kept_times), 1e-9) / speed
    return float(shares[gaps > _NOWHERE].min()) if (gaps > _NOWHERE).any() else 1.0


def track_notes(
    legs: Sequence["PlannedLeg"],
    speed: float,
    turn_rate_max: float,
    slow: float = SLOW,
    pitch_max: float | None = None,
) -> list[str]:
    """Return lines on thinned legs that are slow over ground, turn too sharply or dive too steeply.

    A corner is too sharp where a turn of radius speed / turn rate, m/s and rad/s, does not fit into the
    halves of its lines. Legs may have a speed of their own. Where a vehicle has no `pitch_max`, rad, that of
    common ones counts.
    """
    notes = []
    steepest = STEEPEST if pitch_max is None else float(np.degrees(pitch_max))
    whose = "common vehicles do" if pitch_max is None else "the vehicle's pitch_max is"
    for leg in legs:
        own = speed if leg.speed is None else leg.speed
        share, radius = ground_share(leg, own), own / turn_rate_max
        if share < slow:
            notes.append(
                f"leg {leg.number} is slow: on its slowest line it makes {100.0 * share:.0f} % of its "
                "speed over ground"
            )
        lines = np.diff(leg.waypoints, axis=0)
        level, sink = np.linalg.norm(lines[:, :2], axis=1), np.abs(lines[:, 2])
        turns = np.abs(np.diff(np.arctan2(lines[:, 1], lines[:, 0])))
        turns = np.minimum(np.minimum(turns, 2.0 * np.pi - turns), 0.99 * np.pi)
        needed = radius * np.tan(0.5 * turns)
        rests = np.logical_not(lines.any(axis=1))
        sharp = (needed > 0.5 * np.minimum(level[:-1], level[1:])) & ~(rests[:-1] | rests[1:])
        sharp = np.flatnonzero(sharp)
        if len(sharp):
            notes.append(
                f"leg {leg.number} turns too sharply for {radius:.0f} m at {_at(sharp + 1)}: "
                "the vehicle leaves its lines"
            )
        # Of the vehicle through the water: against a current its track over ground is steeper.
        rates = sink / np.maximum(np.diff(leg.kept_times), 1e-9)
        angles = np.degrees(np.arcsin(np.minimum(rates / own, 1.0)))
        steep = np.flatnonzero(angles > steepest + _ROUNDING)
        if len(steep):
            notes.append(
                f"leg {leg.number} dives or climbs at {angles.max():.0f} degrees, {rates.max():.1f} m/s, "
                f"after {_at(steep)}: {whose} {steepest:.0f}"
            )
    return notes


def _at(corners: NDArray[np.integer]) -> str:
    return f"waypoint {', '.join(str(int(k)) for k in corners)}"
