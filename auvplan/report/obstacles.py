"""Obstacles of a run: how near they came, where they were, and when the vehicle measured them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.export.margins import shown_obstacles, true_obstacles
from auvplan.ocean.obstacles import CONFIDENCE
from auvplan.records import LegRecord, MissionRun
from auvplan.report.packing import packed
from auvplan.scenario.settings import SensorSettings
from auvplan.simulation.simulator import TIME_STEP

Array = NDArray[np.floating]


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
        "looks": _looks(run, leg),
    }


def _looks(run: MissionRun, leg: LegRecord) -> list[Array]:
    """Return the moments, s, at which the vehicle measured each obstacle within sensor range on its way."""
    sensors = _sensors(run)
    apart = max(1, round(sensors.interval / TIME_STEP)) * TIME_STEP
    times = np.arange(leg.times[0] + apart, leg.times[-1], apart)

    def at(track: Array) -> Array:
        return np.stack([np.interp(times, leg.times, axis) for axis in np.asarray(track, float).T], axis=1)

    vehicle, (tracks, radii) = at(leg.positions), true_obstacles(leg)
    away = [np.linalg.norm(at(tracks[:, m]) - vehicle, axis=1) - radii[m] for m in range(len(radii))]
    return [times[distance <= sensors.range] for distance in away]


def sensing_data(run: MissionRun) -> dict[str, float] | None:
    """How a boundary grows between two looks; None of a plan, which no sensor went into."""
    if not run.simulated:
        return None
    sensors = _sensors(run)
    # The errors of place and radius add up.
    spread = CONFIDENCE * 2.0**0.5
    return {
        "range": sensors.range,
        "interval": sensors.interval,
        "prior": spread * sensors.prior_std,
        "seen": spread * sensors.position_std,
        "growth": sensors.growth,
        "growth_max": sensors.growth_max,
    }


def _sensors(run: MissionRun) -> SensorSettings:
    return SensorSettings.model_validate(run.scenario.get("sensors", {}))
