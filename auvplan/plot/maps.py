"""Maps: east to the right, north up, equal scales; coast, sea bed, closed areas, compass and degrees."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle, Patch, Polygon
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from auvplan.ocean.chart import Chart
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.seabed import Seabed
from auvplan.plot import style
from auvplan.plot.style import Array
from auvplan.records import MissionRun
from auvplan.site import Site
from auvplan.view.timeline import closed_areas

#: Contours of depth at most, and pixels along an edge from which on they are drawn from fewer.
_LEVELS, _EDGE = 7, 400
_DEPTHS = "#7fa6c4"


def unit_of(metres: float) -> tuple[str, float]:
    """Return the unit of length of a figure's axes and its metres: kilometres for several of them."""
    return ("km", 1000.0) if metres > 4000.0 else ("m", 1.0)


class Map:
    """Axes as a map, and the pen that draws on it.

    Places are [..., >= 2] m, north and east first; sizes are m.

    Attributes:
        axes: that are drawn in.
        low, high: [2] m, corners of what they show.
        metres: that a unit of the axes is long.
        handles: what a legend says of what was drawn.
    """

    def __init__(self, axes: Axes, low: Array, high: Array) -> None:
        """Set axes up to show what is between two corners, [2] m north and east."""
        name, self.metres = unit_of(float((high - low).max()))
        self.axes, self.low, self.high, self.handles = axes, low, high, []
        axes.set_aspect("equal")
        axes.set_xlim(low[1] / self.metres, high[1] / self.metres)
        axes.set_ylim(low[0] / self.metres, high[0] / self.metres)
        axes.set_xlabel(f"east [{name}]")
        axes.set_ylabel(f"north [{name}]")
        axes.tick_params(labelsize=8)

    @classmethod
    def on(cls, axes: Axes) -> "Map":
        """Return the pen for axes that are a map already."""
        pen = cls.__new__(cls)
        pen.axes, pen.handles, pen.metres = axes, [], 1000.0 if "[km]" in axes.get_xlabel() else 1.0
        pen.low, pen.high = pen.metres * np.asarray([axes.get_ylim(), axes.get_xlim()], float).T
        return pen

    def flat(self, places: ArrayLike) -> Array:
        """Return places as [..., 2] east, north in the axes' unit."""
        return np.asarray(places, float)[..., [1, 0]] / self.metres

    def line(self, places: ArrayLike, label: str = "", **kind: Any) -> None:
        """Draw a line through places [n, >= 2]; a label is for the legend."""
        self.axes.plot(*self.flat(places).T, **kind)
        if label:
            shown = {name: kind[name] for name in ("color", "lw", "ls", "path_effects") if name in kind}
            self.handles.append(style.line(label, **shown))

    def dots(self, places: ArrayLike, **kind: Any) -> None:
        """Mark places [..., >= 2], such as by `style.START`."""
        self.axes.scatter(*self.flat(places).T, **kind)

    def end(self, place: ArrayLike, kind: dict[str, Any], label: str, size: float = 1.0) -> None:
        """Mark a place by `style.START` or another, of a relative size, and say so in the legend."""
        self.dots(place, **(kind | {"zorder": 6, "s": size * kind["s"]}))
        self.handles.append(style.mark(kind, label))

    def disc(self, place: ArrayLike, radius: float, **kind: Any) -> None:
        """Draw a disc of a radius in m."""
        self.axes.add_patch(Circle(tuple(self.flat(place)), radius / self.metres, **kind))

    def image(self, raster: Any, low: ArrayLike, high: ArrayLike, **kind: Any) -> Any:
        """Lay a raster [north, east, ...] between two corners; the axes' limits stay as they are."""
        limits = self.axes.get_xlim(), self.axes.get_ylim()
        (west, south), (east, north) = self.flat(low), self.flat(high)
        image = self.axes.imshow(raster, origin="lower", extent=(west, east, south, north), **kind)
        self.axes.set(xlim=limits[0], ylim=limits[1])
        return image

    def coast(self, chart: Chart | None, see_through: bool = False) -> None:
        """Paint coast and uncertain area; nothing without a chart. See-through, the coast alone."""
        if chart is None:
            return
        passability, low, high = self._seen(chart)
        land = passability == 0.0
        uncertain = (passability > 0.0) & (passability < 1.0)
        coast = style.LAND if see_through else style.COAST
        palette = [[*to_rgb(colour), 1.0] for colour in (coast, style.UNCERTAIN, style.WATER)]
        if see_through:
            palette[1:] = [[0.0] * 4] * 2
        painted = np.round(255.0 * np.asarray(palette)).astype(np.uint8)
        kinds = np.where(land, 0, np.where(uncertain, 1, 2))
        order = 0.5 if see_through else 0.0
        self.image(painted[kinds], low, high, interpolation="nearest", zorder=order)
        if see_through and 0 < land.sum() < land.size:
            limits = self.axes.get_xlim(), self.axes.get_ylim()
            (west, south), (east, north) = self.flat(low), self.flat(high)
            x = np.linspace(west, east, 2 * land.shape[1] + 1)[1::2]
            y = np.linspace(south, north, 2 * land.shape[0] + 1)[1::2]
            self.axes.contour(x, y, land, [0.5], colors="black", linewidths=0.9, zorder=0.6)
            self.axes.set(xlim=limits[0], ylim=limits[1])
        if land.any():
            self.handles.append(Patch(facecolor=coast, edgecolor=style.GREY, label="coast"))
        if uncertain.any() and not see_through:
            shown = Patch(facecolor=style.UNCERTAIN, edgecolor=style.GREY, label="uncertain area")
            self.handles.append(shown)

    def _seen(self, chart: Chart) -> tuple[Array, Array, Array]:
        """Passability of what the axes show of a chart, and its corners, m."""
        passability, size = np.asarray(chart.passability), float(chart.pixel_size)
        corner = np.asarray(chart.lower, float)
        limits = np.asarray([self.axes.get_ylim(), self.axes.get_xlim()], float)
        shown = np.sort(limits, axis=1) * self.metres  # north, east
        # A pixel more on every side; all of it where the limits say nothing about it.
        begin = np.clip(np.floor((shown[:, 0] - corner) / size).astype(int) - 1, 0, passability.shape)
        end = np.clip(np.ceil((shown[:, 1] - corner) / size).astype(int) + 1, 0, passability.shape)
        if (end - begin < 2).any():
            begin, end = np.zeros(2, int), np.asarray(passability.shape)
        part = passability[begin[0] : end[0], begin[1] : end[1]]
        return part, corner + begin * size, corner + end * size

    def depths(self, seabed: Seabed | None) -> None:
        """Draw contours of depth with their metres, at round numbers; nothing without a sea bed."""
        if seabed is None:
            return
        step = max(1, max(seabed.shape) // _EDGE)
        depth = np.asarray(seabed.depth)[::step, ::step]
        size, corner = float(np.asarray(seabed.pixel_size)), np.asarray(seabed.origin, float)
        north, east = (
            (corner[k] + size * (step * np.arange(depth.shape[k]) + 0.5)) / self.metres for k in range(2)
        )
        deepest = float(depth.max())
        levels = MaxNLocator(_LEVELS).tick_values(0.0, max(deepest, 1.0))
        levels = [level for level in levels if 0 < level < deepest]
        if min(depth.shape) < 2 or not levels:
            return
        limits = self.axes.get_xlim(), self.axes.get_ylim()
        lines = self.axes.contour(east, north, depth, levels, colors=_DEPTHS, linewidths=0.7, zorder=0.2)
        self.axes.clabel(lines, fmt="%g", fontsize=6.5, inline_spacing=2)
        self.axes.set(xlim=limits[0], ylim=limits[1])
        self.handles.append(style.line("depth [m]", color=_DEPTHS, lw=0.9))

    def closures(self, run: MissionRun) -> None:
        """Draw closed areas with their names, and their hours if they have any."""
        areas = closed_areas(run)
        for area in areas:
            rings = [self.flat(ring) for ring in area.rings]
            for ring in rings:
                self.axes.add_patch(Polygon(ring, closed=True, zorder=1.0, **style.CLOSED))
            if rings:
                kind: dict[str, Any] = {"fontsize": 8.5, "ha": "center", "va": "center", "color": "#a8320f"}
                kind |= {"weight": "bold", "path_effects": style.halo(3.5), "zorder": 6, "clip_on": True}
                east, north = max(rings, key=len).mean(axis=0)
                self.axes.text(east, north, area.name, **kind)
        if areas:
            hours = ", at the hours stated" if run.closures and not run.zones else ""
            self.handles.append(Patch(label="closed area" + hours, **style.CLOSED))

    def known(self, obstacles: Sequence[KnownObstacle], seconds: float, zorder: float = 3) -> None:
        """Draw known obstacles at the departure, and where they go within some seconds."""
        colour = style.KIND_COLOURS["known"]
        for known in obstacles:
            self.disc(known.position, known.radius, fc=colour, ec=style.BLACK, alpha=0.6, zorder=zorder)
            if known.moves:
                tip = self.flat(known.after(seconds).position)
                arrow = {"arrowstyle": "->", "color": colour, "linestyle": ":"}
                place = tuple(self.flat(known.position))
                self.axes.annotate("", tuple(tip), place, arrowprops=arrow, zorder=zorder)
        if obstacles:
            dot = style.line("known obstacle", ls="", marker="o", ms=7, color=colour, mec=style.BLACK)
            self.handles.append(dot)

    def labels(self, places: ArrayLike, texts: Sequence[str], taken: ArrayLike, **kind: Any) -> None:
        """Write labels beside places [n, >= 2], off the places `taken`; see `style.place_labels`."""
        if len(texts):
            style.place_labels(self.axes, self.flat(places), texts, self.flat(taken), **kind)

    def title(self, title: str, site: Site | None, taken: ArrayLike | None = None) -> None:
        """A title, a compass, and degrees along the edges where the map is somewhere on Earth.

        The compass keeps off the places taken [n, >= 2] m.
        """
        self.axes.set_title(title, fontsize=11, pad=None if site is None else 20.0)
        self.compass(taken)
        if site is not None:
            self._graticule(site)

    def compass(self, taken: ArrayLike | None = None) -> None:
        """A scale bar and an arrow to the north, in the corner with least of the places taken [n, >= 2].

        The axes have their final limits; the lower left corner is the first.
        """
        (west, east), (south, north) = sorted(self.axes.get_xlim()), sorted(self.axes.get_ylim())
        wide, tall = east - west, north - south
        # 1, 2 or 5 times a power of ten.
        longest = 0.2 * wide * self.metres
        power = 10.0 ** np.floor(np.log10(longest))
        length = float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest)) / self.metres
        size = np.array([max(length, 0.04 * wide), 0.17 * tall])
        margin = 0.03 * np.array([wide, tall])
        first, last = np.array([west, south]) + margin, np.array([east, north]) - margin - size
        corners = [np.array([x, y]) for y in (first[1], last[1]) for x in (first[0], last[0])]
        if taken is not None:
            flat, near = self.flat(taken), 0.5 * margin
            corners.sort(key=lambda low: ((flat > low - near) & (flat < low + size + near)).all(axis=1).sum())
        x, y = corners[0]
        self.axes.plot([x, x + length], [y, y], color="black", lw=3.0, zorder=9, path_effects=style.halo())
        metres = length * self.metres
        text = f"{metres / 1000.0:g} km" if metres >= 1000.0 else f"{metres:g} m"
        common: dict[str, Any] = {"fontsize": 8, "zorder": 9, "path_effects": style.halo()}
        self.axes.text(x + 0.5 * length, y, text, ha="center", va="bottom", **common)
        self.axes.annotate(
            "N", (x + 0.02 * wide, y + 0.13 * tall), (x + 0.02 * wide, y + 0.05 * tall),
            ha="center", va="bottom", arrowprops={"arrowstyle": "-|>", "color": "black"}, **common,
        )  # fmt: skip

    def _graticule(self, site: Site) -> None:
        """Longitude above and latitude to the right of the map, along its middle lines."""
        axes = self.axes
        (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
        middle = 0.5 * (south + north) * self.metres, 0.5 * (west + east) * self.metres
        top, right = axes.secondary_xaxis("top"), axes.secondary_yaxis("right")
        for k, (axis, low, high) in enumerate(((top.xaxis, west, east), (right.yaxis, south, north))):
            ends = np.array([low, high]) * self.metres
            across = np.full(2, middle[k])
            found = site.to_geographic(*((across, ends) if k == 0 else (ends, across)))[k]
            first, last = np.unwrap(found, period=360.0)  # longitudes go on beyond 180 degrees
            ticks = MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(first, last)
            ticks = ticks[(ticks >= first) & (ticks <= last)]
            where = low + (ticks - first) / (last - first) * (high - low)
            within = np.where(np.abs(ticks) > 180.0, ticks - np.copysign(360.0, ticks), ticks)
            axis.set_ticks(where, [f"{tick:.3f}".rstrip("0").rstrip(".") + "°" for tick in within])
            axis.set_tick_params(labelsize=7, length=3)
