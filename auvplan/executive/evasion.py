"""Collision-avoidance fallback where no plan is clear ahead: keep station, or move out of the way."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from auvplan.executive.context import MissionContext

Array = NDArray[np.floating]

#: Share of the speed through the water that an escape is made at; the rest is left to the current.
ESCAPE_SPEED = 0.4


def escape_track(
    context: MissionContext,
    position: Array,
    now: float,
    seconds: float,
    clearance: Callable[[Array, Array], Array],
    speed: float,
    stay: float = 0.0,
) -> Array | None:
    """Return the straight track of most clearance among sixteen headings, off coast, sea bed and box.

    Args:
        context: of the mission.
        position, now: [3] m and s, where and when the vehicle is.
        seconds: how long the escape lasts.
        clearance: [n] m, of places [n, 3] m at [n] s to the nearest obstacle.
        speed: m/s over ground that are reckoned with.
        stay: s that station is kept at its end.

    Returns:
        [S, 3] m, or None where keeping station is as good.
    """
    (lower, upper), chart, seabed = context.box, context.area.chart, context.area.seabed
    samples = context.path_config.samples
    parts = np.linspace(0.0, 1.0, samples)
    times = now + parts * (seconds + stay)
    gone = np.minimum(parts * (1.0 + stay / seconds), 1.0)
    best, choice = _worth(clearance(np.broadcast_to(position, (samples, 3)), times)), None
    for heading in np.arange(16) * np.pi / 8.0:
        way = speed * seconds * np.array([np.cos(heading), np.sin(heading), 0.0])
        track = position + gone[:, None] * way
        if (track[-1] < lower).any() or (track[-1] > upper).any():
            continue
        if chart is not None and float(np.min(np.asarray(chart.distance(track[:, 0], track[:, 1])))) < 20.0:
            continue
        if seabed is not None and seabed.altitude(track).min() < float(seabed.clearance):
            continue
        worth = _worth(clearance(track, times))
        if worth > best + 1.0:
            best, choice = worth, track
    return choice


def _worth(apart: Array) -> float:
    """Return how well a track keeps clear, m, from its clearance [n] m.

    Where it begins inside a boundary, no track has more at its least: how soon it leaves distinguishes them.
    """
    return float(apart.min() + min(apart[len(apart) // 4 :].min(), 0.0))
