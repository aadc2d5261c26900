"""What all figures share: colours, figures and their legends, labels that keep apart.

Figures are made without pyplot, so that no state is shared and no display is needed. Those of the public
functions are pyplot's in a notebook, or where pyplot is loaded anyway, so that they are shown as any other.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from auvplan.runtime.arrays import Array
from auvplan.runtime.files import write_atomically

DPI = 150

#: Okabe and Ito's colours, which the colour-blind can distinguish.
BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, RED, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
COAST, UNCERTAIN, WATER, GREY = "#b9a77c", "#e6dcc0", "#f2f7fb", "#8c8c8c"
#: The coast over a colour map, none of whose colours it is.
LAND = "#f0efec"

#: What was planned and given up.
REFUSED = "#5a5a5a"

#: The figures' own names for the kinds of obstacles.
KIND_COLOURS = {"static": PURPLE, "afloat": ORANGE, "self-motivated": SKY, "known": RED}

#: Time along a route: dark to bright, without the palest end, which would be lost on the water.
TIME = LinearSegmentedColormap.from_list("time", ["#0d0887", "#7e03a8", "#cc4778", "#f89540", "#f6d543"])

START: dict[str, Any] = {"marker": "o", "s": 90, "color": YELLOW, "edgecolors": BLACK, "linewidths": 1.0}
GOAL: dict[str, Any] = {"marker": "*", "s": 230, "color": GREEN, "edgecolors": BLACK, "linewidths": 0.8}
VEHICLE: dict[str, Any] = {"marker": "o", "s": 60, "color": RED, "edgecolors": "white", "linewidths": 1.0}

#: An area that is closed.
CLOSED: dict[str, Any] = {"facecolor": "#d55e0022", "edgecolor": RED, "hatch": "///", "linewidth": 0.9}


# --- figures -----------------------------------------------------------------------------------------


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, inches."""
    return Figure(figsize=(width, height), dpi=DPI, layout="constrained")


def own_figure(width: float, height: float) -> Figure:
    """Return an empty figure, inches, for a person at a prompt."""
    if not {"IPython", "matplotlib.pyplot"} & sys.modules.keys():
        return new_figure(width, height)
    from matplotlib import pyplot

    return pyplot.figure(figsize=(width, height), dpi=DPI, layout="constrained")


def own_axes(ax: Axes | None, width: float, height: float, **kind: Any) -> Axes:
    """Return the axes given, or those of a figure of their own, inches."""
    return own_figure(width, height).add_subplot(**kind) if ax is None else ax


def figure_for(ax: Axes | None, width: float, height: float) -> Figure | SubFigure:
    """Return where several panels go: in the place of the axes given, or a figure of their own, inches.

    Raises:
        ValueError: the axes have no place in a grid.
    """
    if ax is None:
        return own_figure(width, height)
    place, figure = ax.get_subplotspec(), ax.figure
    if place is None:
        raise ValueError("ax must be one of a grid, such as figure.subplots() makes, to make room for panels")
    ax.remove()
    return figure.add_subfigure(place)


def figure_of(drawn: "Axes | Sequence[Axes] | Array") -> Figure:
    """Return the figure that axes belong to."""
    figure = np.ravel(np.asarray(drawn, object))[0].get_figure(root=True)
    assert isinstance(figure, Figure)
    return figure


def annotate_empty(ax: Axes | None, text: str) -> Axes:
    """Return axes that say why there is nothing to see."""
    axes = own_axes(ax, 6.0, 2.0)
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center", va="center", fontsize=11, transform=axes.transAxes)
    return axes


def save(drawn: "Figure | Axes | Array", path: Path) -> Path:
    """Write a figure, or that of axes, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    figure = drawn if isinstance(drawn, Figure) else figure_of(drawn)
    try:
        return write_atomically(path, lambda temporary: figure.savefig(temporary, dpi=DPI))
    finally:
        if pyplot := sys.modules.get("matplotlib.pyplot"):
            pyplot.close(figure)


# --- legends -----------------------------------------------------------------------------------------


def line(label: str, **kind: Any) -> Line2D:
    """Return what a legend shows of a line, or of a marker alone (`ls=""`)."""
    return Line2D([], [], label=label, **kind)


def mark(kind: dict[str, Any], label: str, **more: Any) -> Line2D:
    """Return what a legend shows of `START`, `GOAL` or `VEHICLE`."""
    size = {GREEN: 12, RED: 7}.get(kind["color"], 8)
    shown: dict[str, Any] = {"ls": "", "marker": kind["marker"], "ms": size, "color": kind["color"]}
    return line(label, **(shown | {"mec": BLACK} | more))


def marks(vehicle: str = "vehicle") -> list[Line2D]:
    """Return what a legend shows of the ends of a leg, and of the vehicle, by these words."""
    return [mark(START, "start"), mark(VEHICLE, vehicle), mark(GOAL, "target")]


def obstacle_patches(kinds: Sequence[str], words: str, **kind: Any) -> list[Patch]:
    """Return what a legend shows of kinds of obstacles, each once; `words` follow their names."""
    return [
        Patch(facecolor=KIND_COLOURS.get(name, GREY), label=f"{name} obstacle{words}", **kind)
        for name in dict.fromkeys(kinds)
    ]


def legend_below(
    figure: Figure | SubFigure, handles: Sequence[Any] | None = None, ncols: int = 4, **more: Any
):
    """Write a legend below a figure; of its first axes' own labels where no handles are given."""
    if handles is None:
        handles = figure.axes[0].get_legend_handles_labels()[0]
    place: dict[str, Any] = {"loc": "outside lower center", "frameon": False, "fontsize": 8}
    return figure.legend(handles=handles, ncols=ncols, **(place | more))


def add_legend(axes: Axes, handles: Sequence[Any], ax: Axes | None, ncols: int = 4) -> None:
    """A legend below a figure of its own, within axes that were given."""
    if ax is None:
        legend_below(axes.figure, handles, ncols)
    elif handles:
        axes.legend(handles=handles, loc="best", fontsize=7)


# --- marks, grids and labels -------------------------------------------------------------------------


def halo(width: float = 2.5, colour: str = "white") -> list[Any]:
    """Path effects that set a line or letters off what lies under them."""
    return [withStroke(linewidth=width, foreground=colour)]


def grid(axes: Axes, **which: Any) -> None:
    """A pale grid under everything, and small ticks."""
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25, **which)
    axes.set_axisbelow(True)


def place_labels(
    axes: Axes, places: Array, texts: Sequence[str], taken: Array | None = None, **style: Any
) -> None:
    """Write labels beside points so that they cover neither texts nor other points where that can be.

    Args:
        axes: with their final limits; nothing about their size may change afterwards.
        places: [n, 2] in data coordinates.
        texts: n labels; the first ones choose first.
        taken: [m, 2] further points to keep off.
        style: passed on to `Axes.annotate`; `fontsize` in points.
    """
    figure = axes.figure.get_figure(root=True)
    assert figure is not None
    boxes: Array | None = getattr(axes, "_labels_placed", None)
    if boxes is None:
        # The layout is settled by drawing; labels are no part of it.
        figure.draw_without_rendering()
        boxes = np.array([text.get_window_extent().extents for text in axes.texts]).reshape(-1, 4)
    pixel = figure.dpi / 72.0
    size = style.setdefault("fontsize", 7)
    points = axes.transData.transform(places if taken is None else np.concatenate([places, taken]))
    angles = np.deg2rad([45, 135, -45, -135, 0, 180, 90, -90])
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    distances = np.repeat([4.0, 8.0, 13.0, 19.0], len(angles))[:, None]
    inside = np.asarray(axes.bbox.extents)
    for place, text in zip(axes.transData.transform(places), texts, strict=True):
        half = np.array([0.31 * size * len(text), 0.575 * size]) * pixel
        middles = place + np.tile(around, (4, 1)) * (distances * pixel + half)
        tried = np.concatenate([middles - half, middles + half], axis=1)
        room = 2.0 * pixel * np.array([-1.0, -1.0, 1.0, 1.0])
        price = 40.0 * _overlaps(tried, boxes).sum(axis=1) + 0.1 * distances[:, 0]
        price += 3.0 * _overlaps(tried + room, np.tile(points, (1, 2))).sum(axis=1)
        price += 50.0 * ((tried[:, :2] < inside[:2]) | (tried[:, 2:] > inside[2:])).any(axis=1)
        chosen = int(np.argmin(price))
        boxes = np.concatenate([boxes, tried[chosen, None]])
        at = axes.transData.inverted().transform(middles[chosen])
        note = axes.text(at[0], at[1], text, ha="center", va="center", path_effects=halo(1.8), **style)
        note.set_in_layout(False)
    axes._labels_placed = boxes  # type: ignore[attr-defined]


def _overlaps(these: Array, those: Array) -> NDArray[np.bool_]:
    """[n, m] whether boxes [n, 4] and [m, 4], each of its two corners, overlap."""
    low, high = np.maximum(these[:, None, :2], those[:, :2]), np.minimum(these[:, None, 2:], those[:, 2:])
    return np.all(low <= high, axis=2)
