"""A picture and its clusters, the whole map and the window of the path planner (Fig. 1)."""

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from auvplan.ocean.chart import Chart
from auvplan.plot import style

#: Colours of the paper's figure: forbidden, risky, valid.
_COAST, _UNCERTAIN, _WATER = "black", "#9a9a9a", "white"


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
    size = (np.asarray(chart.upper, float) - np.asarray(chart.lower, float))[0] / raster.shape[0]
    parts = ((slice(None), slice(None)), (slice(row, row + rows), slice(column, column + columns)))
    for line, part in zip(grid, parts, strict=True):
        for axes, image in zip(line, (picture[part], _coloured(raster[part])), strict=True):
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
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    figure.suptitle("Map of the mission planner (above) and of the path planner (below)", fontsize=11)
    return figure


def _coloured(raster: style.Array) -> style.Array:
    image = np.empty((*raster.shape, 3))
    image[:] = to_rgb(_UNCERTAIN)
    image[raster == 0.0], image[raster == 1.0] = to_rgb(_COAST), to_rgb(_WATER)
    return image
