"""How paths follow the current (Fig. 8)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from auvplan.ocean.currents import Current, evaluated
from auvplan.plot import style
from auvplan.plot.legs import busiest_leg, chosen_plans, executed_until, extent_points, leg_title, plan_name
from auvplan.records import LegRecord, MissionRun

#: Panels at most.
PANELS = 4
#: Points along each edge of the colour map and of the arrows.
_FINE, _COARSE = 90, 17


def plot_currents(
    run: MissionRun, leg: LegRecord | None = None, note: str = "", *, ax: Axes | None = None
) -> NDArray[Any]:
    """Current and paths at each re-plan of a leg: lighter is faster water.

    Args:
        run: as executed.
        leg: that of `busiest_leg` where not given.
        note: a second line of the title.
        ax: axes of a grid, whose place the panels take; a new figure if absent.

    Returns:
        The axes of the panels.
    """
    leg = leg or busiest_leg(run)
    if leg is None:
        return np.array([style.say_why(ax, "no path was planned")])
    chosen = chosen_plans(leg, PANELS)
    columns = 3 if len(chosen) == 3 else min(len(chosen), 2)
    rows = -(-len(chosen) // columns)
    figure = style.room_of(ax, 4.6 * columns + 1.0, 4.3 * rows + 0.9)
    grid = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    low, high = style.frame_of(extent_points(leg))
    unit = style.Unit.for_extent(float((high - low).max()))
    depth = float(np.mean(np.concatenate([plan.positions[:, 2] for plan in leg.plans])))
    fields = [
        Field.of(leg.plans[index].current, low, high, depth, leg.plans[index].made_at) for index in chosen
    ]
    slowest, fastest, beyond = speed_range(fields)
    image, coast = None, []
    for axes, index, field in zip(grid, chosen, fields, strict=False):
        style.map_axes(axes, low, high, unit)
        image = field.draw(axes, unit, slowest, fastest)
        coast = style.draw_coast(axes, run.coast, unit, see_through=True)
        _draw_paths(axes, leg, index, unit)
        axes.set_title(plan_name(leg, index), fontsize=9)
    for axes in grid[len(chosen) :]:
        axes.set_visible(False)
    for axes in grid:
        axes.label_outer()
    assert image is not None
    bar = figure.colorbar(image, ax=grid, shrink=0.8, pad=0.02, extend=beyond)
    bar.set_label(f"current at {depth:.0f} m depth [m/s]")
    figure.legend(
        handles=[*_legend(), *coast], loc="outside lower center", ncols=4, fontsize=8, frameon=False
    )
    figure.suptitle(f"Paths and current, {leg_title(run, leg)}" + f"\n{note}" * bool(note), fontsize=11)
    return np.array(grid[: len(chosen)])


@dataclass(frozen=True)
class Field:
    """A current over a frame at one depth and time.

    Attributes:
        low, high: [2] m, north and east.
        north, east: [n] m.
        u, v: [n, n] m/s north and east.
    """

    low: style.Array
    high: style.Array
    north: style.Array
    east: style.Array
    u: style.Array
    v: style.Array

    @classmethod
    def of(cls, current: Current, low: style.Array, high: style.Array, depth: float, time: float) -> "Field":
        """Look a current up over a frame, at a depth in m and a time in s."""
        north, east = (np.linspace(low[k], high[k], _FINE) for k in range(2))
        x, y = np.meshgrid(north, east, indexing="ij")
        u, v, _ = evaluated(current, x, y, np.full_like(x, depth), np.full_like(x, time))
        return cls(low, high, north, east, u, v)

    @property
    def speed(self) -> style.Array:
        """[n, n] m/s."""
        return np.hypot(self.u, self.v)

    def draw(self, axes: Axes, unit: style.Unit, slowest: float, fastest: float) -> AxesImage:
        """Paint the speed and arrows over it; the limits of the axes are the frame's then."""
        edges = (self.low[1], self.high[1], self.low[0], self.high[0])
        limits = axes.get_xlim(), axes.get_ylim()
        image = axes.imshow(
            self.speed,
            origin="lower",
            extent=tuple(edge / unit.metres for edge in edges),  # type: ignore[arg-type]
            cmap="cividis",
            vmin=slowest,
            vmax=fastest,
            interpolation="bilinear",
        )
        axes.set(xlim=limits[0], ylim=limits[1])
        step = slice(_FINE // _COARSE // 2, None, _FINE // _COARSE)
        x, y = np.meshgrid(self.north[step], self.east[step], indexing="ij")
        axes.quiver(
            y / unit.metres, x / unit.metres, self.v[step, step], self.u[step, step],
            color="white", alpha=0.75, zorder=0.3, scale=fastest * _COARSE * 1.1, width=0.003,
        )  # fmt: skip
        return image


def speed_range(fields: Sequence[Field]) -> tuple[float, float, Literal["max", "neither"]]:
    """Least and greatest speed of a colour scale, m/s, and where the scale is exceeded.

    The core of one strong vortex would darken all the rest: it exceeds the scale.
    """
    speeds = np.stack([field.speed for field in fields])
    fastest = max(float(np.quantile(speeds, 0.995)), 1e-3)
    return float(speeds.min()), fastest, "max" if float(speeds.max()) > 1.02 * fastest else "neither"


def _draw_paths(axes: Axes, leg: LegRecord, index: int, unit: style.Unit) -> None:
    """The plan of one panel, those before it, and the way taken so far."""

    def line(positions: style.Array, **kind: object) -> None:
        axes.plot(positions[:, 1] / unit.metres, positions[:, 0] / unit.metres, **kind)  # type: ignore[arg-type]

    for plan in leg.plans[:index]:
        line(plan.positions, color=style.RED, ls="--", lw=1.3, path_effects=style.halo(2.4), zorder=3)
    plan = leg.plans[index]
    executed = executed_until(leg, plan.made_at)
    if len(executed) > 1:
        line(executed, color="white", lw=1.6, path_effects=style.halo(3.0, "black"), zorder=4)
    line(plan.positions, color="black", lw=2.4, path_effects=style.halo(4.0), zorder=5)
    ends = ((leg.plans[0].positions[0], style.START), (leg.plans[0].positions[-1], style.GOAL))
    for place, kind in ends:
        axes.scatter(place[1] / unit.metres, place[0] / unit.metres, zorder=6, **kind)
    if index:
        here = plan.positions[0]
        axes.scatter(here[1] / unit.metres, here[0] / unit.metres, zorder=7, **style.VEHICLE)


def _legend() -> list[Line2D]:
    def dot(kind: dict, label: str, size: float) -> Line2D:
        return Line2D(
            [], [], ls="", marker=kind["marker"], ms=size, color=kind["color"], mec="black", label=label
        )

    return [
        Line2D([], [], color="black", lw=2.4, label="new path"),
        Line2D([], [], color=style.RED, ls="--", lw=1.3, label="earlier paths"),
        Line2D([], [], color="white", lw=1.6, path_effects=style.halo(3.0, "black"), label="executed"),
        dot(style.START, "start", 8),
        dot(style.VEHICLE, "vehicle", 7),
        dot(style.GOAL, "target", 12),
    ]
