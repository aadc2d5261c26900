"""What all figures share: colours, units, axes, the coast, labels that keep apart.

Figures are made without pyplot, so that no state is shared and no display is needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from auvplan.io.files import write_atomically
from auvplan.ocean.chart import Chart

Array = NDArray[np.floating]

DPI = 150

#: Okabe and Ito's colours, which the colour-blind can tell apart.
BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, RED, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
COAST, UNCERTAIN, WATER, GREY = "#b9a77c", "#e6dcc0", "#f2f7fb", "#8c8c8c"
#: The coast over a colour map, none of whose colours it is.
LAND = "#f0efec"

#: The figures' own names for the kinds of obstacles.
KIND_COLOURS = {"static": PURPLE, "afloat": ORANGE, "self-motivated": SKY}

#: Time along a route: dark to bright, without the palest end, which would be lost on the water.
TIME = LinearSegmentedColormap.from_list("time", ["#0d0887", "#7e03a8", "#cc4778", "#f89540", "#f6d543"])

START = {"marker": "o", "s": 90, "color": YELLOW, "edgecolors": BLACK, "linewidths": 1.0}
GOAL = {"marker": "*", "s": 230, "color": GREEN, "edgecolors": BLACK, "linewidths": 0.8}
VEHICLE = {"marker": "o", "s": 60, "color": RED, "edgecolors": "white", "linewidths": 1.0}


@dataclass(frozen=True)
class Unit:
    """Unit of length of a figure's axes: `name`, which is `metres` long."""

    name: str
    metres: float

    @classmethod
    def for_extent(cls, metres: float) -> "Unit":
        """Kilometres for areas of several of them."""
        return cls("km", 1000.0) if metres > 4000.0 else cls("m", 1.0)


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches."""
    return Figure(figsize=(width, height), dpi=DPI, layout="constrained")


def empty_figure(text: str) -> Figure:
    """A figure that says why there is nothing to see."""
    figure = new_figure(6.0, 2.0)
    figure.text(0.5, 0.5, text, ha="center", va="center", fontsize=11)
    return figure


def save(figure: Figure, path: Path) -> Path:
    """Write a figure whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_atomically(path, lambda temporary: figure.savefig(temporary, dpi=DPI))


def halo(width: float = 2.5, colour: str = "white") -> list[Any]:
    """Path effects that set a line or letters off what lies under them."""
    return [withStroke(linewidth=width, foreground=colour)]


def map_axes(axes: Axes, lower: Array, upper: Array, unit: Unit) -> None:
    """East to the right, north up, equal scales.

    Args:
        axes: to set up.
        lower: [2] m, north and east.
        upper: [2] m, north and east.
        unit: of both axes.
    """
    axes.set_aspect("equal")
    axes.set_xlim(lower[1] / unit.metres, upper[1] / unit.metres)
    axes.set_ylim(lower[0] / unit.metres, upper[0] / unit.metres)
    axes.set_xlabel(f"east [{unit.name}]")
    axes.set_ylabel(f"north [{unit.name}]")
    axes.tick_params(labelsize=8)


def draw_coast(axes: Axes, chart: Chart | None, unit: Unit, see_through: bool = False) -> list[Patch]:
    """Paint coast and uncertain area; returns what a legend says about them.

    Args:
        axes: whose limits stay as they are.
        chart: or None for open water.
        unit: of the axes.
        see_through: paint the coast alone, with an outline, over something else.
    """
    if chart is None:
        return []
    passability = np.asarray(chart.passability)
    colours = np.zeros((*passability.shape, 4))
    uncertain = (passability > 0.0) & (passability < 1.0)
    coast = LAND if see_through else COAST
    colours[passability == 0.0] = (*to_rgb(coast), 1.0)
    if not see_through:
        colours[passability == 1.0] = (*to_rgb(WATER), 1.0)
        colours[uncertain] = (*to_rgb(UNCERTAIN), 1.0)
    low, high = np.asarray(chart.lower) / unit.metres, np.asarray(chart.upper) / unit.metres
    limits = axes.get_xlim(), axes.get_ylim()
    axes.imshow(
        colours,
        origin="lower",
        extent=(low[1], high[1], low[0], high[0]),
        interpolation="nearest",
        zorder=0.5 if see_through else 0.0,
    )
    if see_through and 0 < (passability == 0.0).sum() < passability.size:
        centres = [np.linspace(low[k], high[k], 2 * passability.shape[k] + 1)[1::2] for k in range(2)]
        axes.contour(
            centres[1], centres[0], passability == 0.0, [0.5], colors="black", linewidths=0.9, zorder=0.6
        )
    axes.set_xlim(*limits[0])
    axes.set_ylim(*limits[1])
    found = [Patch(facecolor=coast, edgecolor=GREY, label="coast")] if (passability == 0.0).any() else []
    if uncertain.any() and not see_through:
        found.append(Patch(facecolor=UNCERTAIN, edgecolor=GREY, label="uncertain area"))
    return found


def frame_of(points: Array, margin: float = 0.12, least: float = 100.0) -> tuple[Array, Array]:
    """Lower and upper corner, (north, east) m, of a square around points [n, >= 2] m.

    Args:
        points: north and east first.
        margin: share of the edge left free on each side.
        least: m, shortest edge.
    """
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    half = max(float((high - low).max()), least) * (0.5 + margin)
    middle = 0.5 * (low + high)
    return middle - half, middle + half


def frame_on_chart(points: Array, chart: Chart | None, margin: float) -> tuple[Array, Array]:
    """`frame_of`, as far as the chart reaches where there is one."""
    low, high = frame_of(points, margin=margin)
    if chart is None:
        return low, high
    return np.maximum(low, np.asarray(chart.lower)), np.minimum(high, np.asarray(chart.upper))


def place_labels(
    axes: Axes, places: Array, texts: Sequence[str], taken: Array | None = None, **style: Any
) -> None:
    """Write labels beside points so that they cover neither each other nor other points where that can be.

    Args:
        axes: with their final limits; nothing about their size may change afterwards.
        places: [n, 2] in data coordinates.
        texts: n labels; the first ones choose first.
        taken: [m, 2] further points to keep off.
        style: passed on to `Axes.annotate`; `fontsize` in points.
    """
    figure = axes.figure.get_figure(root=True)
    assert figure is not None
    boxes: list[Bbox] | None = getattr(axes, "_labels_placed", None)
    if boxes is None:
        boxes = []
        # The layout is settled by drawing; labels are no part of it.
        figure.draw_without_rendering()
    pixel = figure.dpi / 72.0
    size = style.setdefault("fontsize", 7)
    points = axes.transData.transform(places if taken is None else np.concatenate([places, taken]))
    angles = np.deg2rad([45, 135, -45, -135, 0, 180, 90, -90])
    for (x, y), text in zip(axes.transData.transform(places), texts, strict=True):
        width, height = 0.62 * size * len(text) * pixel, 1.15 * size * pixel
        best, least, chosen = (0.0, 0.0), np.inf, None
        for distance in (4.0, 8.0, 13.0, 19.0):
            for angle in angles:
                reach = distance * pixel
                middle = (
                    x + np.cos(angle) * (reach + 0.5 * width),
                    y + np.sin(angle) * (reach + 0.5 * height),
                )
                box = Bbox.from_bounds(middle[0] - 0.5 * width, middle[1] - 0.5 * height, width, height)
                room = box.padded(2.0 * pixel)
                price = 10.0 * sum(box.overlaps(other) for other in boxes)
                price += 3.0 * room.count_contains(points) + 0.1 * distance
                price += (
                    0.0 if axes.bbox.fully_contains(*box.min) and axes.bbox.fully_contains(*box.max) else 50.0
                )
                if price < least:
                    best, least, chosen = middle, price, box
        assert chosen is not None
        boxes.append(chosen)
        at = axes.transData.inverted().transform(best)
        note = axes.text(at[0], at[1], text, ha="center", va="center", path_effects=halo(1.8), **style)
        note.set_in_layout(False)
    axes._labels_placed = boxes  # type: ignore[attr-defined]
