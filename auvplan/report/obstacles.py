"""Obstacles of a run: how near they came, where they were, and when the vehicle measured them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.ocean.obstacles import CONFIDENCE
from auvplan.records import LegRecord, MissionRun
from auvplan.report.packing import packed
from auvplan.scenario.settings import SensorSettings
from auvplan.simulation.simulator import TIME_STEP
from auvplan.simulation.world import KNOWN

Array = NDArray[np.floating]

#: m; what is farther away is not there.
FAR = 1e5


def to_obstacles(run: MissionRun, leg: LegRecord) -> Array:
    """Distance to the surface of the nearest obstacle, true or known, [n] m; infinite without one."""
    least = np.full(len(leg.times), np.inf)
    tracks, radii = _truth(leg)
    for m in _shown(leg):
        away = np.linalg.norm(leg.positions - tracks[:, m], axis=1)
        least = np.minimum(least, away - radii[m])
    for obstacle in run.obstacles:
        least = np.minimum(least, obstacle.distance(np.reshape(leg.positions, (-1, 3)), leg.times))
    return least


def _truth(leg: LegRecord) -> tuple[Array, Array]:
    """Places [n, M, 3] m and radii [M] m, as single precision has them: that is how files keep them."""
    tracks, radii = (np.asarray(part, np.float32) for part in (leg.obstacle_positions, leg.obstacle_radii))
    return tracks.astype(float), radii.astype(float)


def _shown(leg: LegRecord) -> list[int]:
    """Numbers of the obstacles that were not known before and are anywhere near.

    The simulator puts those that find no room on a leg out of the way.
    """
    if not len(leg.times):
        return []
    away = np.abs(leg.obstacle_positions[0] - leg.positions[0]).max(axis=1, initial=0.0)
    return [m for m, kind in enumerate(leg.obstacle_kinds) if kind != KNOWN and away[m] < FAR]


def obstacle_data(run: MissionRun, leg: LegRecord, rows: NDArray[np.int_]) -> dict[str, Any]:
    """Return the true obstacles of a leg that were not known before: places, and when the vehicle saw them.

    Args:
        run: that the leg belongs to.
        leg: as executed.
        rows: [k] records of the leg at which places are given.
    """
    shown = _shown(leg)
    if not shown or not len(rows):
        return {"kinds": [], "radii": [], "times": None, "places": None, "looks": []}
    tracks, radii = _truth(leg)
    return {
        "kinds": [leg.obstacle_kinds[m] for m in shown],
        "radii": radii[shown],
        "times": packed(leg.times[rows]),
        "places": packed(tracks[rows][:, shown]),
        "looks": _looks(run, leg, shown),
    }


def _looks(run: MissionRun, leg: LegRecord, shown: Sequence[int]) -> list[Array]:
    """Return the moments, s, at which the vehicle measured each obstacle within sensor range on its way."""
    sensors = _sensors(run)
    apart = max(1, round(sensors.interval / TIME_STEP)) * TIME_STEP
    times = np.arange(leg.times[0] + apart, leg.times[-1], apart)

    def at(track: Array) -> Array:
        return np.stack([np.interp(times, leg.times, axis) for axis in np.asarray(track, float).T], axis=1)

    vehicle, (tracks, radii) = at(leg.positions), _truth(leg)
    away = [np.linalg.norm(at(tracks[:, m]) - vehicle, axis=1) - radii[m] for m in shown]
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
