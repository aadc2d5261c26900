"""A picture, its clusters and the chart that was made of it (Fig. 1)."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray
from PIL import Image

from auvplan.ocean.chart import Chart
from auvplan.ocean.classify import Classified
from auvplan.plot import style
from auvplan.plot.maps import Map
from auvplan.runtime.files import output_folder

#: Longest edge at which the picture is drawn, pixels.
_EDGE = 1200
#: Colours of the paper's figure: forbidden, risky, valid.
_COAST, _UNCERTAIN, _WATER = "black", "#9a9a9a", "white"


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


def plot_clusters(chart: Chart, picture: NDArray[np.uint8], window: tuple[int, int, int, int]) -> Figure:
    """Draw the picture and its clusters side by side, the whole map above and a window of it below.

    Args:
        chart: made of the picture.
        picture: [rows, columns, 3] RGB, row 0 in the north.
        window: first row (north), first column (east), rows and columns, pixels.
    """
    row, column, rows, columns = window
    figure = style.new_figure(9.6, 9.8)
    grid = figure.subplots(2, 2)
    raster = np.asarray(chart.passability)[::-1]  # rows from the north
    colours = [to_rgb(colour) for colour in (_COAST, _UNCERTAIN, _WATER)]
    coloured = np.asarray(colours)[np.where(raster == 0.0, 0, np.where(raster == 1.0, 2, 1))]
    size = (np.asarray(chart.upper, float) - np.asarray(chart.lower, float))[0] / raster.shape[0]
    parts = ((slice(None), slice(None)), (slice(row, row + rows), slice(column, column + columns)))
    for line, part in zip(grid, parts, strict=True):
        for axes, image in zip(line, (picture[part], coloured[part]), strict=True):
            north, east = size / 1000.0 * np.asarray(image.shape[:2])
            axes.imshow(image, extent=(0.0, east, 0.0, north), interpolation="none")
            axes.set_xlabel("east [km]")
            axes.set_ylabel("north [km]")
            axes.tick_params(labelsize=8)
        line[0].set_title(f"picture, {image.shape[0]} × {image.shape[1]} pixels of {size:g} m", fontsize=10)
        coast, water = float((raster[part] == 0.0).mean()), float((raster[part] == 1.0).mean())
        shares = f"coast {coast:.1%}, uncertain {1.0 - coast - water:.1%}, water {water:.1%}"
        line[1].set_title(f"clusters: {shares}", fontsize=10)
    for axes in grid[0]:
        edge = np.asarray([column, raster.shape[0] - row - rows]) * size / 1000.0
        place = (float(edge[0]), float(edge[1]))
        axes.add_patch(
            Rectangle(place, columns * size / 1e3, rows * size / 1e3, fill=False, ec=style.RED, lw=1.8)
        )
    handles = [
        Patch(facecolor=colour, edgecolor=style.GREY, label=label)
        for colour, label in (
            (_COAST, "coast, 0: forbidden"),
            (_UNCERTAIN, "uncertain, (0, 0.35]: risky"),
            (_WATER, "water, 1: valid"),
        )
    ]
    handles.append(Patch(facecolor="none", edgecolor=style.RED, lw=1.8, label="window of the path planner"))
    style.legend_below(figure, handles, fontsize=9)
    figure.suptitle("Map of the mission planner (above) and of the path planner (below)", fontsize=11)
    return figure
