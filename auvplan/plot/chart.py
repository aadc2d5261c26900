"""A picture and the chart that was made of it (Fig. 1)."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from numpy.typing import NDArray
from PIL import Image

from auvplan.files import output_folder
from auvplan.ocean.chart import Chart
from auvplan.ocean.classify import Classified
from auvplan.plot import style

#: Longest edge at which the picture is drawn, pixels.
_EDGE = 1200


def plot_chart(
    chart: Chart,
    image: str | Path | None = None,
    classified: Classified | None = None,
    *,
    ax: Axes | None = None,
) -> Axes | NDArray[Any]:
    """Draw the clustered chart, beside the picture it was made of where that is given.

    Args:
        chart: to draw.
        image: a picture with north up that covers the same area.
        classified: its clusters, which are listed with their colours, shares and what they were taken for.
        ax: axes to draw in; with a picture, of a grid, whose place both take; a new figure if absent.

    Returns:
        The axes; with a picture [2], its own and the chart's.
    """
    low, high = np.asarray(chart.lower, float), np.asarray(chart.upper, float)
    unit = style.Unit.for_extent(float((high - low).max()))
    tall = 6.2 if classified is None else 6.9
    alone = None if image else style.own_axes(ax, 6.4, tall)
    grid = np.array([alone]) if alone is not None else style.room_of(ax, 11.0, tall).subplots(1, 2)
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
    title = f"chart: {parts}"
    if classified is not None and classified.doubts:
        title = "\n".join([f"in doubt, {title}", *classified.doubts])
    grid[-1].set_title(title, fontsize=10)
    if classified is not None:
        listed = [
            Patch(
                facecolor=cluster.colour,
                edgecolor=style.GREY,
                label=f"{cluster.colour}, {cluster.share:.1%}: {cluster.kind}",
            )
            for cluster in classified.clusters
        ]
        title = "colours of the picture, their shares and what they were taken for"
        style.figure_of(grid[-1]).legend(
            handles=listed, loc="outside lower left", ncols=4, fontsize=8, frameon=False, title=title
        ).get_title().set_fontsize(8)
    if handles:
        if classified is None:
            style.add_legend(grid[-1], handles, None if image else ax, ncols=2)
        else:
            common = {"loc": "outside lower right", "ncols": 2, "fontsize": 8, "frameon": False}
            style.figure_of(grid[-1]).legend(handles=handles, **common)
    return grid if alone is None else alone


def draw_chart(
    chart: Chart, image: str | Path | None, folder: str | Path, classified: Classified | None = None
) -> Path:
    """Write `chart.png`, or `chart-drawn.png` where the picture itself is that file.

    Raises:
        OutputError: the folder or the file cannot be written.
    """
    target = output_folder(folder) / "chart.png"
    if image and target.exists() and target.samefile(image):
        target = target.with_name("chart-drawn.png")
    return style.save(plot_chart(chart, image, classified), target)
