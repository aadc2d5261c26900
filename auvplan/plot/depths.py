"""Depth contours of the sea bed on maps."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from auvplan.ocean.seabed import Seabed
from auvplan.plot import style

#: Contours at most, and pixels along an edge from which on they are drawn from fewer.
_LEVELS, _EDGE = 7, 400
_COLOUR = "#7fa6c4"


def draw_depths(axes: Axes, seabed: Seabed | None, unit: style.Unit) -> list[Line2D]:
    """Contours of depth with their metres, at round numbers; returns what a legend says about them.

    Args:
        axes: whose limits stay as they are.
        seabed: or None, then nothing is drawn.
        unit: of the axes.
    """
    if seabed is None:
        return []
    step = max(1, max(seabed.shape) // _EDGE)
    depth = np.asarray(seabed.depth)[::step, ::step]
    size, corner = float(np.asarray(seabed.pixel_size)), np.asarray(seabed.origin, float)
    north, east = (
        (corner[k] + size * (step * np.arange(depth.shape[k]) + 0.5)) / unit.metres for k in range(2)
    )
    deepest = float(depth.max())
    levels = [
        level for level in MaxNLocator(_LEVELS).tick_values(0.0, max(deepest, 1.0)) if 0 < level < deepest
    ]
    if min(depth.shape) < 2 or not levels:
        return []
    limits = axes.get_xlim(), axes.get_ylim()
    lines = axes.contour(east, north, depth, levels, colors=_COLOUR, linewidths=0.7, zorder=0.2)
    axes.clabel(lines, fmt="%g", fontsize=6.5, inline_spacing=2)
    axes.set_xlim(*limits[0])
    axes.set_ylim(*limits[1])
    return [Line2D([], [], color=_COLOUR, lw=0.9, label="depth [m]")]
