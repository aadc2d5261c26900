"""Waypoints of an itinerary in a row, with longitude, latitude and time of day as files give them."""

from dataclasses import dataclass, field
from datetime import UTC

import numpy as np
from numpy.typing import NDArray

from auvplan.export.itinerary import Itinerary
from auvplan.site import Site, as_utc
from auvplan.words import figure

Array = NDArray[np.floating]

#: m within which the end of a leg and the start of the next are one waypoint.
_SAME = 1.0

#: Decimal places of degrees in files: a millimetre.
DEGREES = 8


@dataclass(frozen=True)
class Waypoint:
    """A waypoint of the whole itinerary.

    Attributes:
        leg: number of the leg that ends there or passes it, from 1.
        name: of the mission's waypoint; of those between, the leg and their number on it.
        position: [3] m, north, east, depth.
        longitude, latitude: degrees.
        seconds: since the epoch, when the planned path is there, as on the mission sheet. Straight lines take
            a little more or less; by how much, the leg's note says.
        hold: s, of the task there; 0 where there is none.
        priority: of that task.
        ends_leg: whether the leg ends there.
        yaw, pitch: degrees, attitude that was planned for the path there; NaN where not known.
        body_velocity: [3] m/s, surge, sway and heave that were.
    """

    leg: int
    name: str
    position: Array
    longitude: float
    latitude: float
    seconds: float
    hold: float = 0.0
    priority: float = 0.0
    ends_leg: bool = False
    yaw: float = np.nan
    pitch: float = np.nan
    body_velocity: Array = field(default_factory=lambda: np.full(3, np.nan))

    @property
    def depth(self) -> float:
        """m, positive down, to a tenth of a millimetre and never -0."""
        return round(float(self.position[2]), 4) + 0.0

    @property
    def task(self) -> str:
        """One line on the task, or nothing."""
        return (
            f"task of priority {figure(self.priority)}, {self.hold:.0f} s"
            if self.hold or self.priority
            else ""
        )


def waypoints(itinerary: Itinerary) -> list[Waypoint]:
    """Return all waypoints in order.

    Where a leg begins at the end of the one before, that place comes once.
    """
    rows: list[Waypoint] = []
    for leg in itinerary.legs:
        longitude, latitude = itinerary.site.to_geographic(leg.waypoints[:, 0], leg.waypoints[:, 1])
        last, motion = len(leg.kept) - 1, leg.motion[leg.kept]
        body = motion.body_velocity
        for k, place in enumerate(leg.waypoints):
            if k == 0 and rows and np.linalg.norm(rows[-1].position - place) < _SAME:
                continue
            between = f"leg {leg.number}, {k}"
            rows.append(
                Waypoint(
                    leg.number,
                    leg.start_name if k == 0 else leg.goal_name if k == last else between,
                    place,
                    float(longitude[k]),
                    float(latitude[k]),
                    float(leg.times[leg.kept[k]]),
                    leg.hold if k == last else 0.0,
                    leg.priority if k == last else 0.0,
                    k == last,
                    float(np.degrees(motion.yaw[k])),
                    float(np.degrees(motion.pitch[k])),
                    body[k],
                )
            )
    return rows


def moment(site: Site, seconds: float) -> str | None:
    """Time of day by ISO 8601 in UTC, to the millisecond; None where the site has no epoch."""
    then = site.utc(seconds)
    if then is None:
        return None
    return as_utc(then).astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def elevation(depth: float) -> float:
    """M above the surface, to a tenth of a millimetre and never -0."""
    return round(-float(depth), 4) + 0.0


def degrees(value: float) -> str:
    """Degrees in decimal notation, as XML schemas ask for it."""
    return f"{value:.{DEGREES}f}"


def metres(value: float) -> str:
    """Return metres in decimal notation, never -0."""
    return f"{round(float(value), 4) + 0.0:.4f}"
