"""Paths on a map: over the current (Fig. 8), a leg with every window (Fig. 10), one plan in its sea."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from numpy.typing import NDArray

from auvplan.ocean.currents import Current
from auvplan.ocean.environment import Environment
from auvplan.path.plan import PathPlan
from auvplan.plot import style
from auvplan.plot.maps import Map
from auvplan.plot.section import SECTION, add_section
from auvplan.records import LegRecord, MissionRun
from auvplan.view import scene
from auvplan.view.scene import current_on, planned_obstacles
from auvplan.view.section import plan_section

#: Panels at most.
PANELS = 4
#: Points along each edge of the colour map and of the arrows.
_FINE, _COARSE = 90, 17
#: Obstacles farther from a path than this many times the frame's edge are left out.
_FAR = 0.6


def _draw_currents(
    pens: Sequence[Map], currents: Sequence[Current], depth: float, times: Sequence[float], label: str
) -> None:
    """Paint the speed of a current on each map, arrows over it; there is one scale of colours."""
    low, high = pens[0].low, pens[0].high
    north, east = (np.linspace(low[k], high[k], _FINE) for k in range(2))
    found = [current_on(one, north, east, depth, time) for one, time in zip(currents, times, strict=True)]
    speeds = [np.hypot(u, v) for u, v in found]
    # The core of one strong vortex would darken all the rest: it exceeds the scale.
    fastest = max(float(np.quantile(speeds, 0.995)), 1e-3)
    scale: dict[str, Any] = {"cmap": "cividis", "vmin": float(np.min(speeds)), "vmax": fastest}
    some = slice(_FINE // _COARSE // 2, None, _FINE // _COARSE)
    for pen, speed, (u, v) in zip(pens, speeds, found, strict=True):
        image = pen.image(speed, low, high, interpolation="bilinear", **scale)
        pen.axes.quiver(
            east[some] / pen.metres, north[some] / pen.metres, v[some, some], u[some, some],
            color="white", alpha=0.75, zorder=0.3, scale=fastest * _COARSE * 1.1, width=0.003,
        )  # fmt: skip
    beyond = "max" if float(np.max(speeds)) > 1.02 * fastest else "neither"
    figure = pens[0].axes.figure
    bar = figure.colorbar(image, ax=[pen.axes for pen in pens], shrink=0.8, pad=0.02, extend=beyond)
    bar.set_label(f"current at {depth:.0f} m depth{label} [m/s]")


def plot_currents(
    run: MissionRun, leg: LegRecord | None = None, note: str = "", *, ax: Axes | None = None
) -> NDArray[Any]:
    """Current and paths at each re-plan of a leg: lighter is faster water.

    Args:
        run: as executed.
        leg: that of `busiest_leg` where not given.
        note: a second line of the title.
        ax: axes of a grid, whose place the panels take; a new figure if absent.
    """
    leg = leg or scene.busiest_leg(run)
    if leg is None:
        return np.array([style.annotate_empty(ax, "no path was planned")])
    chosen = scene.chosen_plans(leg, PANELS)
    columns = 3 if len(chosen) == 3 else min(len(chosen), 2)
    rows = -(-len(chosen) // columns)
    figure = style.figure_for(ax, 4.6 * columns + 1.0, 4.3 * rows + 0.9)
    grid = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    low, high = scene.window(scene.extent_points(leg))
    depth = float(np.mean(np.concatenate([plan.positions[:, 2] for plan in leg.plans])))
    plans = [leg.plans[index] for index in chosen]
    pens = [Map(axes, low, high) for axes in grid[: len(chosen)]]
    _draw_currents(pens, [plan.current for plan in plans], depth, [plan.made_at for plan in plans], "")
    for pen, index in zip(pens, chosen, strict=True):
        pen.coast(run.coast, see_through=True)
        _draw_paths(pen, leg, index)
        pen.axes.set_title(scene.plan_name(leg, index), fontsize=9)
    for axes in grid[len(chosen) :]:
        axes.set_visible(False)
    for axes in grid:
        axes.label_outer()
    done = style.line("executed", color="white", lw=1.6, path_effects=style.halo(3.0, "black"))
    style.legend_below(figure, [
        style.line("new path", color="black", lw=2.4),
        style.line("earlier paths", color=style.RED, ls="--", lw=1.3),
        *[done] * run.simulated, *style.marks(), *pens[-1].handles,
    ])  # fmt: skip
    figure.suptitle(f"Paths and current, {scene.leg_title(run, leg)}" + f"\n{note}" * bool(note), fontsize=11)
    return np.array(grid[: len(chosen)])


def _draw_paths(pen: Map, leg: LegRecord, index: int) -> None:
    """The plan of one panel, those before it, and the path taken so far."""
    for plan in leg.plans[:index]:
        pen.line(plan.positions, color=style.RED, ls="--", lw=1.3, path_effects=style.halo(2.4), zorder=3)
    plan, first = leg.plans[index], leg.plans[0].positions
    executed = leg.positions[leg.times <= plan.made_at] if len(leg.times) else leg.positions
    if len(executed) > 1:
        pen.line(executed, color="white", lw=1.6, path_effects=style.halo(3.0, "black"), zorder=4)
    pen.line(plan.positions, color="black", lw=2.4, path_effects=style.halo(4.0), zorder=5)
    pen.dots(first[0], zorder=6, **style.START)
    pen.dots(first[-1], zorder=6, **style.GOAL)
    if index:
        pen.dots(plan.positions[0], zorder=7, **style.VEHICLE)


def plot_path(plan: PathPlan, *, ax: Axes | None = None) -> Axes:
    """Draw a path over the current at its departure, the coast, and obstacles where the path passes them.

    In a figure of its own the vertical section along the path is below, if anything differs with depth.

    Args:
        plan: feasible or not.
        ax: axes to draw in; those of a new figure if absent. In axes of a map with something in them the path
            alone is drawn over what is there.

    Example:
        >>> import jax, auvplan as ap
        >>> from auvplan.plot import plot_path
        >>> env = ap.Environment(ap.UniformCurrent(0.0, 0.5), lower=(-500, -500, 0), upper=(2500, 1500, 0))
        >>> plan = ap.plan_path((0, 0, 0), (2000, 0, 0), env, key=jax.random.key(0))
        >>> plot_path(plan).get_xlabel()
        'east [m]'
    """
    if ax is not None and ax.has_data():
        _draw_way(Map.on(ax), plan)
        return ax
    world = plan.conditions.world()
    positions = np.asarray(plan.positions, float)
    low, high = scene.window(positions)
    section = plan_section(plan) if ax is None else None
    axes = style.own_axes(ax, 7.4, 7.2 + (0.0 if section is None else SECTION))
    below = add_section(axes, [] if section is None else [section])
    pen = Map(axes, low, high)
    depth = float(positions[:, 2].mean())
    _draw_currents([pen], [world.current], depth, [float(plan.times[0])], ", at departure")
    pen.coast(world.chart, see_through=True)
    _draw_obstacles(pen, plan, world)
    _draw_way(pen, plan)
    pen.handles += [handle for name, handle in below.items() if name not in ("path", "obstacle")]
    style.add_legend(axes, pen.handles, ax)
    broken = "" if plan.feasible else f"\nnot feasible: {', '.join(plan.broken())}"
    axes.set_title(f"{plan.travel_time:,.0f} s over {plan.length:,.0f} m{broken}", fontsize=11)
    return axes


def _draw_way(pen: Map, plan: PathPlan) -> None:
    places, lines = np.asarray(plan.positions, float), "-" if plan.feasible else "--"
    pen.line(places, color="black", ls=lines, lw=2.4, path_effects=style.halo(4.0), zorder=5)
    pen.handles.append(style.line("path", color="black", ls=lines, lw=2.4))
    pen.end(places[0], style.START, "start")
    pen.end(places[-1], style.GOAL, "goal")


def _draw_obstacles(pen: Map, plan: PathPlan, world: Environment) -> None:
    """Draw obstacles and their collision boundaries when the path is nearest to them."""
    positions = np.asarray(plan.positions, float)
    met = planned_obstacles(world, np.asarray(plan.times, float))
    if not met:
        return
    nearest = [int(np.linalg.norm(one.track - positions, axis=1).argmin()) for one in met]
    edge = float(np.ptp(pen.axes.get_xlim())) * pen.metres
    middle = 0.5 * (positions[:, :2].min(axis=0) + positions[:, :2].max(axis=0))
    hidden = len(met)
    for one, k in zip(met, nearest, strict=True):
        if np.abs(one.track[k, :2] - middle).max() <= _FAR * edge:
            solid: dict[str, Any] = {"fc": style.ORANGE, "ec": "black", "lw": 0.6, "alpha": 0.85}
            pen.disc(one.track[k], one.radius, zorder=3, **solid)
            bound: dict[str, Any] = {"fill": False, "ec": style.ORANGE, "lw": 1.4, "ls": "--"}
            pen.disc(one.track[k], float(one.boundary[k]), zorder=3, **bound)
            hidden -= 1
    note = f" ({hidden} out of view)" if hidden else ""
    pen.handles += [
        Patch(facecolor=style.ORANGE, edgecolor="black", label=f"obstacle when passed{note}"),
        style.line("its collision boundary", color=style.ORANGE, ls="--", lw=1.4),
    ]
