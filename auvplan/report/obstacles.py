"""Obstacles of a run: how near they came, where they were, and when the vehicle measured them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.export.margins import shown_obstacles, true_obstacles
from auvplan.export.section import looks
from auvplan.records import LegRecord, MissionRun
from auvplan.report.packing import packed


def obstacle_data(run: MissionRun, leg: LegRecord, rows: NDArray[np.int_]) -> dict[str, Any]:
    """Return the true obstacles of a leg that were not known before: places, and when the vehicle saw them.

    Args:
        run: that the leg belongs to.
        leg: as executed.
        rows: [k] records of the leg at which places are given.
    """
    shown = shown_obstacles(leg)
    if not shown or not len(rows):
        return {"kinds": [], "radii": [], "times": None, "places": None, "looks": []}
    tracks, radii = true_obstacles(leg)
    return {
        "kinds": [leg.obstacle_kinds[m] for m in shown],
        "radii": radii,
        "times": packed(leg.times[rows]),
        "places": packed(tracks[rows]),
        "looks": looks(run, leg),
    }
