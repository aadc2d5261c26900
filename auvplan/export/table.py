"""Waypoints as a table of comma-separated values, a row each."""

import csv
import io
from pathlib import Path

import numpy as np

from auvplan.export.itinerary import Itinerary
from auvplan.export.places import degrees, metres, moment, waypoints
from auvplan.files import write_atomically

#: Degrees; metres, north and east in the local frame, depth positive down; UTC; s; the task's priority.
#: Yaw and pitch of the hull, degrees, and its surge, sway and heave, m/s, are those of the planned path at
#: that place: the bearing of the straight line to the next waypoint may differ.
COLUMNS = (
    "leg", "seq", "name", "lon", "lat", "depth", "time", "north", "east", "hold", "task", "note",
    "yaw", "pitch", "surge", "sway", "heave",
)  # fmt: skip


def write_csv(itinerary: Itinerary, path: str | Path) -> Path:
    """Write a `.csv` file.

    Times are empty where the site has no epoch, attitude and velocities where they are not known; notes stand
    where legs end, and with the first waypoint what concerns all.

    Raises:
        OutputError: the operating system refused; one line that names the file.
    """
    notes = {leg.number: leg.note for leg in itinerary.legs}
    about = "; ".join((*itinerary.sources, *itinerary.warnings))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for sequence, row in enumerate(waypoints(itinerary), 1):
        note = notes[row.leg] if row.ends_leg else about if sequence == 1 else ""
        writer.writerow((
            row.leg, sequence, row.name, degrees(row.longitude), degrees(row.latitude), metres(row.depth),
            moment(itinerary.site, row.seconds) or "", metres(row.position[0]), metres(row.position[1]),
            f"{row.hold:.1f}", f"{row.priority:g}", note,
            *(_known(value, 2) for value in (row.yaw, row.pitch)),
            *(_known(value, 3) for value in row.body_velocity),
        ))  # fmt: skip
    return write_atomically(path, lambda part: part.write_text(text.getvalue(), encoding="utf-8"))


def _known(value: float, decimals: int) -> str:
    """Return a number, never -0, or nothing where it is NaN."""
    return "" if np.isnan(value) else f"{round(float(value), decimals) + 0.0:.{decimals}f}"
