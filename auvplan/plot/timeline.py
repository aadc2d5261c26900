"""Routes over time (Fig. 15): every route as planned, and the mission as executed under them."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, Normalize
from matplotlib.patches import Patch

from auvplan.plot import style
from auvplan.records import MissionRun
from auvplan.runtime.formatting import figure, hours
from auvplan.view.scene import refused_legs
from auvplan.view.timeline import Bar, closures_in_words, executed_bars, lateness, planned_bars, windows_of

#: Pale to dark blue: priorities.
_PRIORITY = LinearSegmentedColormap.from_list("priority", ["#e3eef9", "#6aaed6", "#08306b"])
#: Where a leg was refused.
_REFUSED: dict[str, Any] = {"ls": "", "marker": "x", "ms": 5, "mew": 1.3, "color": style.REFUSED}
#: Size of the labels on bars, points.
_FONT = 7.0


def plot_timeline(run: MissionRun, *, ax: Axes | None = None) -> Axes:
    """Draw a row for each route, first at the top, as planned; the lowest row is the mission as executed.

    A plan is one row.

    Args:
        run: as executed, or a plan.
        ax: axes to draw in; those of a new figure if absent.
    """
    routes = run.routes if run.simulated else []
    rows = len(routes) + 1
    axes = style.own_axes(
        ax, 13.0, 1.9 + 0.3 * len(run.closures) + rows * float(np.clip(8.0 / rows, 0.4, 0.6))
    )
    # Axes of their own figure will take about 85 % of it.
    width = 0.85 * 13.0 if ax is None else ax.get_window_extent().width / style.figure_of(ax).dpi
    planned = [planned_bars(run, route) for route in routes]
    executed = executed_bars(run)
    bars = [bar for row in [*planned, executed] for bar in row]
    last = max([run.t_available, run.t_mission, *(bar.ends for bar in bars)])
    axes.set_xlim(0.0, 1.02 * last)
    axes.set_ylim(rows - 0.35 + 0.6 * len(run.closures), -0.65)
    priority = np.asarray(run.graph.priority, float)
    top = max(float(priority.max()), 1.0)
    norm = Normalize(0.0, top)
    if 1.0 < top <= 12 and (priority == np.rint(priority)).all():  # few whole numbers are steps
        norm = BoundaryNorm(np.arange(0.5, top + 1.0), _PRIORITY.N)
    # How wide a letter is on the time axis.
    letter = 0.62 * _FONT / 72.0 / width * 1.02 * last
    for row, route in enumerate(planned):
        _draw(axes, row, route, norm, letter)
    _draw(axes, rows - 1, executed, norm, letter)
    windows = _draw_windows(axes, run, rows - 1, executed)
    closure_rows = [rows - 0.05 + 0.6 * number for number in range(len(run.closures))]
    for row, closure in zip(closure_rows, run.stated_closures, strict=True):
        for begins, ends in closure.spans:
            begin, end = max(begins, 0.0), min(ends, 1.02 * last)
            if begin < end:
                axes.barh(row, end - begin, left=begin, height=0.4, **style.CLOSED)
    for row, route in enumerate(routes[1:], start=1):
        axes.plot([route.made_at] * 2, [row - 0.48, row + 0.48], color=style.RED, lw=1.6, zorder=4)
    refused = [leg.plans[-1].made_at for leg in refused_legs(run)]
    if refused:
        axes.plot(refused, [rows - 1.43] * len(refused), **_REFUSED, zorder=4)
    if routes:
        axes.axhline(rows - 1.5, color="black", lw=0.8)
    axes.axvline(run.t_available, color="red", lw=2.0, zorder=5)
    executed_name = f"{'executed' if run.simulated else 'plan'}\npriority {figure(run.total_priority)}, "
    executed_name += f"{run.t_mission:,.0f} s ({hours(run.t_mission)})"
    names = [*(_name(run, k) for k in range(len(routes))), executed_name, *closures_in_words(run)]
    axes.set_yticks([*range(rows), *closure_rows], names)
    axes.set_xlabel("time since the mission began [s]")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
    style.grid(axes, axis="x")
    bar = axes.figure.colorbar(ScalarMappable(norm, _PRIORITY), ax=axes, pad=0.01, fraction=0.03)
    if isinstance(norm, BoundaryNorm):
        bar.set_ticks((norm.boundaries[1:] - 0.5).tolist())
    bar.set_label("priority of the task [-]")
    style.add_legend(axes, _legend(run, bool(refused), windows), ax, ncols=5)
    what = "as planned and as executed" if routes else "as planned"
    axes.set_title(f"Route{'s' * bool(routes)}, {what}; legs from → to waypoint", fontsize=11)
    return axes


def _draw_windows(axes: Axes, run: MissionRun, row: int, bars: list[Bar]) -> bool:
    """Draw when tasks may begin, as far as the legs' own bars reach; return whether there are windows."""
    table = run.graph.timetable
    found = False
    for bar in bars:
        spans = [] if table is None or not bar.task else windows_of(table, bar.start, bar.goal)
        for opens, closes in spans:
            begin, end = max(opens, bar.begin), min(closes, bar.ends)
            if begin <= end:
                axes.plot([begin, end], [row + 0.43] * 2, color=style.GREEN, lw=3.0, solid_capstyle="butt")
                found = True
    return found


def _draw(axes: Axes, row: int, bars: list[Bar], norm: Normalize, letter: float) -> None:
    for bar in bars:
        colour = _PRIORITY(norm(bar.priority)) if bar.priority > 0 else (1.0, 1.0, 1.0, 1.0)
        common: dict[str, Any] = {"color": colour, "edgecolor": "black", "linewidth": 0.7}
        axes.barh(row, bar.travel, left=bar.begin, height=0.74, **common)
        axes.barh(row, bar.task, left=bar.begin + bar.travel + bar.wait, height=0.3, **common)
        if bar.wait:
            axes.plot([bar.begin + bar.travel, bar.begin + bar.travel + bar.wait], [row] * 2, "k:", lw=1.2)
        text, width = f"{bar.start}→{bar.goal}", bar.travel
        if width < 1.4 * letter:
            continue
        upright = width < letter * (len(text) + 1.2)
        dark = float(np.dot(colour[:3], [0.299, 0.587, 0.114])) < 0.55
        axes.text(
            bar.begin + 0.5 * width, row, text,
            rotation=90 if upright else 0, ha="center", va="center", fontsize=_FONT - upright,
            color="white" if dark else "black", clip_on=True, zorder=3,
        )  # fmt: skip


def _name(run: MissionRun, number: int) -> str:
    route = run.routes[number]
    title = f"re-plan R{number} at {route.made_at:,.0f} s, {route.cause}" if number else "first route"
    if route.cause == "late" and (why := lateness(run, route)):
        title += f":\n{why}"
    spent = f", {sum(route.energies) / 3600.0:,.0f} Wh" if route.energies else ""
    return f"{title}\npriority {figure(route.priority)}, {route.time:,.0f} s{spent}"


def _legend(run: MissionRun, refused: bool, windows: bool) -> list[Any]:
    handles: list[Any] = [
        Patch(facecolor="#6aaed6", edgecolor="black", label="travel"),
        Patch(facecolor="#6aaed6", edgecolor="black", label="on-station time (half height)"),
        style.line(f"time available, {run.t_available:,.0f} s", color="red", lw=2.0),
    ]
    if len(run.routes) > 1 and run.simulated:
        handles.append(style.line("re-planned", color=style.RED, lw=1.6))
    if windows:
        handles.append(style.line("the task may begin", color=style.GREEN, lw=3.0))
    if run.closures:
        handles.append(Patch(label="area closed", **style.CLOSED))
    if refused:
        handles.append(style.line("a leg planned and refused", **_REFUSED))
    return handles
