"""A picture and the chart that was made of it (Fig. 1)."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from PIL import Image

from auvplan.io.files import output_folder
from auvplan.ocean.chart import Chart
from auvplan.plot import style

#: Longest edge at which the picture is drawn, pixels.
_EDGE = 1200


def plot_chart(
    chart: Chart, image: str | Path | None = None, *, ax: Axes | None = None
) -> Axes | NDArray[Any]:
    """The clustered chart, beside the picture it was made of where that is given.

    Args:
        chart: to draw.
        image: a picture with north up that covers the same area.
        ax: axes to draw in; with a picture, of a grid, whose place both take; a new figure if absent.

    Returns:
        The axes; with a picture [2], its own and the chart's.
    """
    low, high = np.asarray(chart.lower, float), np.asarray(chart.upper, float)
    unit = style.Unit.for_extent(float((high - low).max()))
    alone = None if image else style.own_axes(ax, 6.4, 6.2)
    grid = np.array([alone]) if alone is not None else style.room_of(ax, 11.0, 6.2).subplots(1, 2)
    for axes in grid:
        style.map_axes(axes, low, high, unit)
    if image:
        with Image.open(image) as opened:
            picture = opened.convert("RGB")
        picture.thumbnail((_EDGE, _EDGE))
        extent = (low[1] / unit.metres, high[1] / unit.metres, low[0] / unit.metres, high[0] / unit.metres)
        grid[0].imshow(np.asarray(picture), extent=extent)
        grid[0].set_title("picture", fontsize=10)
    handles = style.draw_coast(grid[-1], chart, unit)
    shares = chart.shares()
    parts = ", ".join(f"{name} {shares[name]:.1%}" for name in ("coast", "uncertain", "water"))
    grid[-1].set_title(f"chart: {parts}", fontsize=10)
    if handles:
        style.add_legend(grid[-1], handles, None if image else ax, ncols=2)
    return grid if alone is None else alone


def draw_chart(chart: Chart, image: str | Path | None, folder: str | Path) -> Path:
    """Write `chart.png`.

    Raises:
        OutputError: the folder or the file cannot be written.
    """
    return style.save(plot_chart(chart, image), output_folder(folder) / "chart.png")
