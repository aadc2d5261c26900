"""How paths follow the current (Fig. 8)."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from auvplan.plot import style
from auvplan.plot.legs import busiest_leg, chosen_plans, current_at, extent_points, plan_name, sailed_until
from auvplan.voyage.records import LegRecord, MissionRun

#: Panels at most.
PANELS = 4
#: Points along each edge of the colour map and of the arrows.
_FINE, _COARSE = 90, 17


def plot_currents(run: MissionRun, leg: LegRecord | None = None, note: str = "") -> Figure:
    """Current and paths at each re-plan of a leg: lighter is faster water.

    Args:
        run: as sailed.
        leg: the one with most re-plans where not given.
        note: a second line of the title.
    """
    leg = leg or busiest_leg(run)
    if leg is None:
        return style.empty_figure("no path was planned")
    chosen = chosen_plans(leg, PANELS)
    columns = 3 if len(chosen) == 3 else min(len(chosen), 2)
    rows = -(-len(chosen) // columns)
    figure = style.new_figure(4.6 * columns + 1.0, 4.3 * rows + 0.9)
    grid = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    low, high = style.frame_of(extent_points(leg))
    unit = style.Unit.for_extent(float((high - low).max()))
    depth = float(np.mean(np.concatenate([plan.positions[:, 2] for plan in leg.plans])))
    north, east = (np.linspace(low[k], high[k], _FINE) for k in range(2))
    mesh = np.meshgrid(north, east, indexing="ij")
    fields = [current_at(leg.plans[index], mesh[0], mesh[1], depth) for index in chosen]
    speeds = np.stack([np.hypot(u, v) for u, v, _ in fields])
    # The core of one strong vortex would darken all the rest.
    fastest, slowest = max(float(np.quantile(speeds, 0.995)), 1e-3), float(speeds.min())
    image, coast = None, []
    for axes, index, (u, v, _) in zip(grid, chosen, fields, strict=False):
        extent = (low[1], high[1], low[0], high[0])
        image = axes.imshow(
            np.hypot(u, v),
            origin="lower",
            extent=tuple(edge / unit.metres for edge in extent),
            cmap="cividis",
            vmin=slowest,
            vmax=fastest,
            interpolation="bilinear",
        )
        style.map_axes(axes, low, high, unit)
        step = _FINE // _COARSE
        part = (slice(step // 2, None, step),) * 2
        axes.quiver(
            mesh[1][part] / unit.metres, mesh[0][part] / unit.metres, v[part], u[part],
            color="white", alpha=0.75, zorder=0.3, scale=fastest * _COARSE * 1.1, width=0.003,
        )  # fmt: skip
        coast = style.draw_coast(axes, run.chart, unit, see_through=True)
        _draw_paths(axes, leg, index, unit)
        axes.set_title(plan_name(leg, index), fontsize=9)
    for axes in grid[len(chosen) :]:
        axes.set_visible(False)
    for axes in grid:
        axes.label_outer()
    assert image is not None
    beyond = "max" if float(speeds.max()) > 1.02 * fastest else "neither"
    bar = figure.colorbar(image, ax=grid, shrink=0.8, pad=0.02, extend=beyond)
    bar.set_label(f"current at {depth:.0f} m depth [m/s]")
    figure.legend(
        handles=[*_legend(), *coast], loc="outside lower center", ncols=4, fontsize=8, frameon=False
    )
    figure.suptitle(
        f"Paths and current, leg {leg.start} → {leg.goal}" + f"\n{note}" * bool(note), fontsize=11
    )
    return figure


def _draw_paths(axes: Axes, leg: LegRecord, index: int, unit: style.Unit) -> None:
    """The plan of one panel, those before it, and the way sailed so far."""

    def line(positions: style.Array, **kind: object) -> None:
        axes.plot(positions[:, 1] / unit.metres, positions[:, 0] / unit.metres, **kind)  # type: ignore[arg-type]

    for plan in leg.plans[:index]:
        line(plan.positions, color=style.RED, ls="--", lw=1.3, path_effects=style.halo(2.4), zorder=3)
    plan = leg.plans[index]
    sailed = sailed_until(leg, plan.made_at)
    if len(sailed) > 1:
        line(sailed, color="white", lw=1.6, path_effects=style.halo(3.0, "black"), zorder=4)
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
        Line2D([], [], color="white", lw=1.6, path_effects=style.halo(3.0, "black"), label="sailed"),
        dot(style.START, "start", 8),
        dot(style.VEHICLE, "vehicle", 7),
        dot(style.GOAL, "target", 12),
    ]
