"""Waypoints as a table of comma-separated values, a row each."""

import csv
import io
from pathlib import Path

from auvplan.export.itinerary import Itinerary
from auvplan.export.places import degrees, metres, moment, waypoints
from auvplan.io.files import write_atomically

#: Degrees; metres, north and east in the local frame, depth positive down; UTC; s; the task's priority.
COLUMNS = (
    "leg", "seq", "name", "lon", "lat", "depth", "time", "north", "east", "hold", "task", "note",
)  # fmt: skip


def write_csv(itinerary: Itinerary, path: str | Path) -> Path:
    """Write a `.csv` file; times are empty where the site has no epoch, notes stand where legs end.

    Raises:
        OutputError: the operating system refused; one line that names the file.
    """
    notes = {leg.number: leg.note for leg in itinerary.legs}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for sequence, row in enumerate(waypoints(itinerary), 1):
        writer.writerow((
            row.leg, sequence, row.name, degrees(row.longitude), degrees(row.latitude), metres(row.depth),
            moment(itinerary.site, row.seconds) or "", metres(row.position[0]), metres(row.position[1]),
            f"{row.hold:.1f}", f"{row.priority:g}", notes[row.leg] if row.ends_leg else "",
        ))  # fmt: skip
    return write_atomically(path, lambda part: part.write_text(text.getvalue(), encoding="utf-8"))
