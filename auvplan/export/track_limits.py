"""What a vehicle meets on the straight lines between waypoints: ground speed, turns, dives."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from auvplan.export.itinerary import PlannedLeg

Array = NDArray[np.floating]

#: Share of the speed through the water below which a leg counts as slow over ground.
SLOW = 0.5

#: m, lines shorter than this lead from one task to another in the same place.
_NO_WAY = 0.5

#: Degrees, steepest dive of common vehicles.
STEEPEST = 30.0

#: Degrees by which a line may be steeper: it is as steep as the vehicle's own limit where that binds.
_HAIR = 0.05


def ground_share(leg: "PlannedLeg", speed: float) -> float:
    """Return the least share of a speed, m/s, that a leg's straight lines are planned to make over ground.

    A leg that leads nowhere has 1.
    """
    gaps = np.linalg.norm(np.diff(leg.waypoints, axis=0), axis=1)
    shares = gaps / np.maximum(np.diff(leg.kept_times), 1e-9) / speed
    return float(shares[gaps > _NO_WAY].min()) if (gaps > _NO_WAY).any() else 1.0


def track_notes(
    legs: Sequence["PlannedLeg"],
    speed: float,
    turn_rate_max: float,
    slow: float = SLOW,
    pitch_max: float | None = None,
) -> list[str]:
    """Return lines on legs that are slow over ground, turn too sharply or dive too steeply.

    A corner is too sharp where a turn of radius speed / turn rate does not fit into the halves of its lines.

    Args:
        legs: thinned.
        speed: through the water, m/s.
        turn_rate_max: rad/s.
        slow: share of the speed.
        pitch_max: rad, the vehicle's; that of common vehicles counts where it has none.
    """
    notes, radius = [], speed / turn_rate_max
    steepest = STEEPEST if pitch_max is None else float(np.degrees(pitch_max))
    whose = "common vehicles do" if pitch_max is None else "the vehicle's pitch_max is"
    for leg in legs:
        share = ground_share(leg, speed)
        if share < slow:
            notes.append(
                f"leg {leg.number} is slow: on its slowest line it makes {100.0 * share:.0f} % of its "
                "speed over ground"
            )
        ways = np.diff(leg.waypoints, axis=0)
        level, sink = np.linalg.norm(ways[:, :2], axis=1), np.abs(ways[:, 2])
        needed = radius * np.tan(0.5 * _turns(ways))
        sharp = np.flatnonzero(needed > 0.5 * np.minimum(level[:-1], level[1:]))
        if len(sharp):
            notes.append(
                f"leg {leg.number} turns too sharply for {radius:.0f} m at {_at(sharp + 1)}: "
                "the vehicle leaves its lines"
            )
        angles = np.degrees(np.arctan2(sink, level))
        steep = np.flatnonzero(angles > steepest + _HAIR)
        if len(steep):
            rate = speed * np.sin(np.radians(angles.max()))
            notes.append(
                f"leg {leg.number} dives or climbs at {angles.max():.0f} degrees, {rate:.1f} m/s, after "
                f"{_at(steep)}: {whose} {steepest:.0f}"
            )
    return notes


def _turns(ways: Array) -> Array:
    """Return [k - 1] rad, changes of course between [k, 3] m."""
    course = np.arctan2(ways[:, 1], ways[:, 0])
    turn = np.abs(np.diff(course))
    return np.minimum(np.minimum(turn, 2.0 * np.pi - turn), 0.99 * np.pi)


def _at(corners: NDArray[np.integer]) -> str:
    return f"waypoint {', '.join(str(int(k)) for k in corners)}"
