"""What all figures share: colours, units, axes, the coast, labels that keep apart.

Figures are made without pyplot, so that no state is shared and no display is needed. Those of the public
functions are pyplot's in a notebook, or where pyplot is loaded anyway, so that they are shown as any other.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from auvplan.files import write_atomically
from auvplan.ocean.chart import Chart
from auvplan.ocean.known import KnownObstacle
from auvplan.records import MissionRun, PlanRecord
from auvplan.schedule import closures_in_words, stated_closures
from auvplan.site import Site

Array = NDArray[np.floating]

DPI = 150

#: Okabe and Ito's colours, which the colour-blind can tell apart.
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


def room_of(ax: Axes | None, width: float, height: float) -> Figure | SubFigure:
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


def add_legend(axes: Axes, handles: Sequence[Any], ax: Axes | None, ncols: int = 4) -> None:
    """A legend below a figure of its own, within axes that were given."""
    if ax is None:
        place: dict[str, Any] = {"loc": "outside lower center", "frameon": False}
        axes.figure.legend(handles=handles, ncols=ncols, fontsize=8, **place)
    elif handles:
        axes.legend(handles=handles, loc="best", fontsize=7)


def say_why(ax: Axes | None, text: str) -> Axes:
    """Axes that say why there is nothing to see."""
    axes = own_axes(ax, 6.0, 2.0)
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center", va="center", fontsize=11, transform=axes.transAxes)
    return axes


def empty_figure(text: str) -> Figure:
    """Return a figure that says why there is nothing to see."""
    figure = new_figure(6.0, 2.0)
    figure.text(0.5, 0.5, text, ha="center", va="center", fontsize=11)
    return figure


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


def flat(places: ArrayLike, unit: Unit) -> Array:
    """[..., >= 2] m north, east to [..., 2] east, north in the axes' unit."""
    return np.asarray(places, float)[..., [1, 0]] / unit.metres


def title_map(axes: Axes, title: str, site: Site | None, unit: Unit, taken: Array | None = None) -> None:
    """A title, a compass, and degrees along the edges where the map is somewhere on Earth.

    Args:
        axes: with their final limits.
        title: one line.
        site: or None.
        unit: of the axes.
        taken: [n, 2] places in the axes' unit that the compass keeps off.
    """
    axes.set_title(title, fontsize=11, pad=None if site is None else 20.0)
    draw_compass(axes, unit, taken)
    if site is not None:
        draw_graticule(axes, site, unit)


def draw_end(axes: Axes, place: ArrayLike, kind: dict[str, Any], label: str, unit: Unit) -> Line2D:
    """Draw a mark at a place, m north, east: `kind` is `START` or `GOAL`; return its legend handle."""
    axes.scatter(*flat(place, unit), **(kind | {"zorder": 6}))
    mark: dict[str, Any] = {name: kind[name] for name in ("marker", "color")}
    size = 12 if kind["marker"] == "*" else 8
    return Line2D([], [], ls="", ms=size, mec=BLACK, label=label, **mark)


def draw_known(
    axes: Axes, obstacles: Sequence[KnownObstacle], seconds: float, unit: Unit, zorder: float = 3
) -> list[Line2D]:
    """Known obstacles at the departure, and where they go within some seconds; returns legend handles."""
    colour = KIND_COLOURS["known"]
    for known in obstacles:
        place = flat(known.position, unit)
        size = known.radius / unit.metres
        axes.add_patch(Circle(tuple(place), size, fc=colour, ec=BLACK, alpha=0.6, zorder=zorder))
        if known.moves:
            tip = flat(known.after(seconds).position, unit)
            arrow = {"arrowstyle": "->", "color": colour, "linestyle": ":"}
            axes.annotate("", tuple(tip), tuple(place), arrowprops=arrow, zorder=zorder)
    mark: dict[str, Any] = {"ls": "", "marker": "o", "ms": 7, "color": colour, "mec": BLACK}
    return [Line2D([], [], label="known obstacle", **mark)] if obstacles else []


#: An area that is closed.
CLOSED: dict[str, Any] = {"facecolor": "#d55e0022", "edgecolor": RED, "hatch": "///", "linewidth": 0.9}


def draw_closures(axes: Axes, run: MissionRun, unit: Unit) -> list[Patch]:
    """Draw closed areas with their names, and their hours if they have any; return what a legend says."""
    areas = [*zip(stated_closures(run), closures_in_words(run), strict=True)]
    for area, words in [*areas, *((zone, zone.name) for zone in run.zones)]:
        rings = [flat(ring, unit) for ring in area.rings]
        for ring in rings:
            axes.add_patch(Polygon(ring, closed=True, zorder=1.0, **CLOSED))
        if rings:
            east, north = max(rings, key=len).mean(axis=0)
            kind: dict[str, Any] = {"fontsize": 8.5, "ha": "center", "va": "center", "color": "#a8320f"}
            kind |= {"weight": "bold", "path_effects": halo(3.5), "zorder": 6, "clip_on": True}
            axes.text(east, north, words, **kind)
    label = "closed area" + (", at the hours stated" if run.closures and not run.zones else "")
    return [Patch(label=label, **CLOSED)] if areas or run.zones else []


def draw_compass(axes: Axes, unit: Unit, taken: Array | None = None) -> None:
    """A scale bar and an arrow to the north in a corner of a map.

    Args:
        axes: with their final limits.
        unit: of the axes.
        taken: [n, 2] places in that unit; the corner with least of them is taken, the lower left first.
    """
    (west, east), (south, north) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    wide, tall = east - west, north - south
    length = float(_round_below(0.2 * wide * unit.metres)) / unit.metres
    size = np.array([max(length, 0.04 * wide), 0.17 * tall])
    margin = 0.03 * np.array([wide, tall])
    first, last = np.array([west, south]) + margin, np.array([east, north]) - margin - size
    corners = [np.array([x, y]) for y in (first[1], last[1]) for x in (first[0], last[0])]
    if taken is not None:
        near = 0.5 * margin
        corners.sort(key=lambda low: np.all((taken > low - near) & (taken < low + size + near), axis=1).sum())
    x, y = corners[0]
    axes.plot([x, x + length], [y, y], color="black", lw=3.0, zorder=9, path_effects=halo())
    metres = length * unit.metres
    text = f"{metres / 1000.0:g} km" if metres >= 1000.0 else f"{metres:g} m"
    common: dict[str, Any] = {"fontsize": 8, "zorder": 9, "path_effects": halo()}
    axes.text(x + 0.5 * length, y, text, ha="center", va="bottom", **common)
    axes.annotate(
        "N", (x + 0.02 * wide, y + 0.13 * tall), (x + 0.02 * wide, y + 0.05 * tall),
        ha="center", va="bottom", arrowprops={"arrowstyle": "-|>", "color": "black"}, **common,
    )  # fmt: skip


def _round_below(value: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is no more than a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value))


def draw_graticule(axes: Axes, site: Site, unit: Unit) -> None:
    """Longitude above and latitude to the right of a map, along its middle lines."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    middle = 0.5 * (south + north) * unit.metres, 0.5 * (west + east) * unit.metres

    def longitudes(x: ArrayLike) -> Array:
        across = np.asarray(x, float) * unit.metres
        return site.to_geographic(np.full_like(across, middle[0]), across)[0]

    def latitudes(y: ArrayLike) -> Array:
        up = np.asarray(y, float) * unit.metres
        return site.to_geographic(up, np.full_like(up, middle[1]))[1]

    top, right = axes.secondary_xaxis("top"), axes.secondary_yaxis("right")
    for axis, (low, high), degrees in (
        (top.xaxis, (west, east), longitudes),
        (right.yaxis, (south, north), latitudes),
    ):
        first, last = degrees(np.array([low, high]))
        ticks = MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(first, last)
        ticks = ticks[(ticks >= first) & (ticks <= last)]
        where = low + (ticks - first) / (last - first) * (high - low)
        axis.set_ticks(where, [f"{tick:.3f}".rstrip("0").rstrip(".") + "°" for tick in ticks])
        axis.set_tick_params(labelsize=7, length=3)


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
    limits = axes.get_xlim(), axes.get_ylim()
    passability, low, high = _seen(chart, limits, unit)
    uncertain = (passability > 0.0) & (passability < 1.0)
    coast = LAND if see_through else COAST
    kinds = np.where(passability == 0.0, 0, np.where(uncertain, 1, 2))
    palette = [[*to_rgb(colour), 1.0] for colour in (coast, UNCERTAIN, WATER)]
    if see_through:
        palette[1:] = [[0.0] * 4] * 2
    axes.imshow(
        np.round(255.0 * np.asarray(palette)).astype(np.uint8)[kinds],
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


def _seen(chart: Chart, limits: tuple, unit: Unit) -> tuple[Array, Array, Array]:
    """Passability of what axes of these limits show of a chart, and its corners in their unit."""
    passability, size = np.asarray(chart.passability), float(chart.pixel_size)
    corner = np.asarray(chart.lower, float)
    shown = np.sort(np.asarray(limits, float)[::-1], axis=1) * unit.metres  # north, east
    # A pixel more on every side; all of it where the limits say nothing about it.
    begin = np.clip(np.floor((shown[:, 0] - corner) / size).astype(int) - 1, 0, passability.shape)
    end = np.clip(np.ceil((shown[:, 1] - corner) / size).astype(int) + 1, 0, passability.shape)
    if (end - begin < 2).any():
        begin, end = np.zeros(2, int), np.asarray(passability.shape)
    part = passability[begin[0] : end[0], begin[1] : end[1]]
    return part, (corner + begin * size) / unit.metres, (corner + end * size) / unit.metres


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


def set_up_space(
    axes: Any, low: Array, high: Array, depths: tuple[float, float], height: float, unit: Unit, pad: float
) -> None:
    """Set limits, proportions and labels of three-dimensional axes: east, north, depth downwards.

    Args:
        axes: three-dimensional.
        low, high: [2] m north, east.
        depths: m, at the top and at the bottom.
        height: of the box beside its horizontal edges.
        unit: of the horizontal axes.
        pad: points between a horizontal axis and its label.
    """
    axes.set_xlim(low[1] / unit.metres, high[1] / unit.metres)
    axes.set_ylim(low[0] / unit.metres, high[0] / unit.metres)
    axes.set_zlim(depths[1], depths[0])
    axes.set_box_aspect((1.0, 1.0, height), zoom=1.12)
    axes.set_xlabel(f"east [{unit.name}]", labelpad=pad)
    axes.set_ylabel(f"north [{unit.name}]", labelpad=pad)
    axes.set_zlabel("depth [m]", labelpad=pad - 2)
    axes.tick_params(labelsize=8)


def line_in_space(axes: Any, positions: Array, unit: Unit, **kind: Any) -> None:
    """Draw a line through positions [n, 3] m on three-dimensional axes."""
    axes.plot(positions[:, 1] / unit.metres, positions[:, 0] / unit.metres, positions[:, 2], **kind)


def draw_ends_in_space(axes: Any, plans: Sequence[PlanRecord], unit: Unit) -> None:
    """Mark where the first plan begins and ends, and where each later one begins, in three dimensions."""
    marks = [(plans[0].positions[0], START), (plans[0].positions[-1], GOAL)]
    marks += [(plan.positions[0], VEHICLE) for plan in plans[1:]]
    for place, kind in marks:
        flat = place[1] / unit.metres, place[0] / unit.metres, place[2]
        axes.scatter(*flat, zorder=5, depthshade=False, **kind)


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
    boxes: Array | None = getattr(axes, "_labels_placed", None)
    if boxes is None:
        boxes = np.zeros((0, 4))
        # The layout is settled by drawing; labels are no part of it.
        figure.draw_without_rendering()
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
        price = 10.0 * _overlaps(tried, boxes).sum(axis=1) + 0.1 * distances[:, 0]
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
