"""A picture, its clusters and the chart that was made of it (Fig. 1)."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from numpy.typing import NDArray
from PIL import Image

from auvplan.ocean.chart import Chart
from auvplan.ocean.classify import Classified
from auvplan.plot import style
from auvplan.plot.maps import Map
from auvplan.runtime.files import output_folder

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
    tall = 6.2 if classified is None else 6.9
    alone = None if image else style.own_axes(ax, 6.4, tall)
    grid = np.array([alone]) if alone is not None else style.figure_for(ax, 11.0, tall).subplots(1, 2)
    pens = [Map(axes, low, high) for axes in grid]
    if image:
        with Image.open(image) as opened:
            picture = opened.convert("RGB")
        picture.thumbnail((_EDGE, _EDGE))
        pens[0].image(np.asarray(picture)[::-1], low, high)
        grid[0].set_title("picture", fontsize=10)
    pens[-1].coast(chart)
    handles = pens[-1].handles
    shares = chart.shares()
    parts = ", ".join(f"{name} {shares[name]:.1%}" for name in ("coast", "uncertain", "water"))
    title = f"chart: {parts}"
    if classified is not None and classified.doubts:
        title = "\n".join([f"in doubt, {title}", *classified.doubts])
    grid[-1].set_title(title, fontsize=10)
    if classified is not None:
        named = {f"{one.colour}, {one.share:.1%}: {one.kind}": one.colour for one in classified.clusters}
        listed = [Patch(facecolor=face, edgecolor=style.GREY, label=label) for label, face in named.items()]
        title = "colours of the picture, their shares and what they were taken for"
        legend = style.legend_below(style.figure_of(grid[-1]), listed, loc="outside lower left", title=title)
        legend.get_title().set_fontsize(8)
    if handles:
        if classified is None:
            style.add_legend(grid[-1], handles, None if image else ax, ncols=2)
        else:
            style.legend_below(style.figure_of(grid[-1]), handles, ncols=2, loc="outside lower right")
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
