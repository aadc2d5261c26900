"""The map of a mission (Figs 10, 15): coast, waypoints, the track, where the route was re-planned."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from auvplan.export.section import run_sections
from auvplan.plot import style
from auvplan.plot.depths import SECTION, add_section, draw_depths
from auvplan.plot.legs import refused_legs
from auvplan.records import LegRecord, MissionRun
from auvplan.words import figure, hours


def plot_mission(run: MissionRun, *, ax: Axes | None = None) -> Axes:
    """Draw the map of a mission, east to the right and north up.

    In a figure of its own the vertical section along its legs is below, if anything differs with depth.

    Args:
        run: as executed; a leg of its own, open water and a mission that was never begun are fine.
        ax: axes to draw in; those of a new figure if absent.

    Returns:
        The axes of the map.
    """
    waypoints = np.asarray(run.graph.positions, float)
    executed = [leg for leg in run.legs if len(leg.times)]
    points = np.concatenate([waypoints, *(leg.positions for leg in executed)])
    low, high = style.frame_on_chart(points, run.chart, margin=0.05)
    unit = style.Unit.for_extent(float((high - low).max()))
    tall, wide = high - low
    sections = run_sections(run) if ax is None else []
    below = SECTION if sections else 0.0
    axes = style.own_axes(ax, 9.4, float(np.clip(7.9 * tall / wide, 4.0, 11.0)) + 1.1 + below)
    in_section = add_section(axes, sections, run)
    style.map_axes(axes, low, high, unit)
    handles: list[Any] = list(style.draw_coast(axes, run.coast, unit))
    handles += draw_depths(axes, run.seabed, unit)
    handles += style.draw_closures(axes, run, unit)
    handles += _draw_graph(axes, run, unit)
    if executed:
        track = _draw_track(axes, executed, unit)
        bar = axes.figure.colorbar(track, ax=axes, shrink=0.8, pad=0.02)
        bar.set_label("time [s]")
    handles += _draw_refused(axes, run, unit)
    handles += style.draw_known(axes, run.obstacles, run.t_mission, unit)
    for node, kind, label in ((run.start, style.START, "start"), (run.goal, style.GOAL, "destination")):
        handles.append(style.draw_end(axes, waypoints[node], kind, label, unit))
    marks = _replan_marks(run) if run.simulated else {}
    handles += _draw_replans(axes, run, marks, unit)
    if any(leg.priority > 0 for leg in executed):
        handles.append(
            Line2D([], [], ls="", marker="$ρ3$", ms=13, color=style.BLUE, label="priority of the task")
        )
    handles += in_section.values()
    style.add_legend(axes, handles, ax)
    style.title_map(axes, _title(run), run.site, unit, style.flat(points, unit))
    _draw_labels(axes, run, executed, marks, unit)
    return axes


def _title(run: MissionRun) -> str:
    name = run.scenario.get("name") or "mission"
    what = f"seed {run.seed}" if run.simulated else "plan"
    tasks = f"{run.tasks} task{'' if run.tasks == 1 else 's'} of total priority {figure(run.total_priority)}"
    seconds = f"{run.t_mission:,.0f} of {run.t_available:,.0f} s"
    return f"{name}, {what}: {tasks}, {hours(run.t_mission)} of {hours(run.t_available)} ({seconds})"


def _draw_graph(axes: Axes, run: MissionRun, unit: style.Unit) -> list[Any]:
    places = style.flat(run.graph.positions, unit)
    adjacency = np.asarray(run.graph.adjacency)
    pairs = np.argwhere(np.triu(adjacency | adjacency.T, 1))
    axes.add_collection(LineCollection(list(places[pairs]), colors=style.GREY, lw=0.6, alpha=0.45, zorder=1))
    axes.scatter(*places.T, s=16, color="white", edgecolors="black", linewidths=0.8, zorder=4)
    return [
        Line2D([], [], color=style.GREY, lw=0.8, alpha=0.6, label="edge of the task graph"),
        Line2D([], [], ls="", marker="o", ms=4, color="white", mec="black", label="waypoint"),
    ]


def _draw_track(axes: Axes, executed: list[LegRecord], unit: style.Unit) -> LineCollection:
    """Draw the track, coloured by time, an arrow head on every leg."""
    first, last = executed[0].times[0], executed[-1].times[-1]
    pieces, times = [], []
    for leg in executed:
        line = style.flat(leg.positions, unit)
        axes.plot(*line.T, color="black", lw=3.4, zorder=2, solid_capstyle="round")
        pieces.append(np.stack([line[:-1], line[1:]], axis=1))
        times.append(0.5 * (leg.times[:-1] + leg.times[1:]))
    track = LineCollection(list(np.concatenate(pieces)), cmap=style.TIME, lw=2.2, zorder=3, capstyle="round")
    track.set_array(np.concatenate(times))
    track.set_clim(first, max(last, first + 1.0))
    axes.add_collection(track)
    for leg in executed:
        line = style.flat(leg.positions, unit)
        middle = _middle(line)
        if middle and (line[middle] != line[middle - 1]).any():
            axes.annotate(
                "",
                xy=line[middle],
                xytext=line[middle - 1],
                arrowprops={
                    "arrowstyle": "-|>",
                    "color": "black",
                    "mutation_scale": 15,
                    "shrinkA": 0,
                    "shrinkB": 0,
                },
                zorder=3.5,
            )
    return track


def _draw_refused(axes: Axes, run: MissionRun, unit: style.Unit) -> list[Line2D]:
    """Paths that were planned and refused, each with a cross half the way; returns legend handles."""
    lines = [style.flat(leg.plans[-1].positions, unit) for leg in refused_legs(run)]
    if not lines:
        return []
    kind: dict[str, Any] = {"color": style.REFUSED, "ls": ":", "lw": 1.2, "marker": "x", "ms": 5, "mew": 1.3}
    for line in lines:
        axes.plot(*line.T, markevery=[_middle(line)], zorder=1.8, **kind)
    return [Line2D([], [], label="planned and refused", **kind)]


def _middle(line: style.Array) -> int:
    """Index of the point of [n, 2] nearest to half the way."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return int(np.searchsorted(way, 0.5 * way[-1]))


def _replan_marks(run: MissionRun) -> dict[int, str]:
    """Waypoint to the numbers of the mission re-plans made there; the first route is none."""
    marks: dict[int, list[int]] = {}
    for number, route in enumerate(run.routes[1:], start=1):
        if route.nodes:
            marks.setdefault(route.nodes[0], []).append(number)
    return {node: "R" + ",".join(map(str, numbers)) for node, numbers in marks.items()}


def _draw_replans(axes: Axes, run: MissionRun, marks: dict[int, str], unit: style.Unit) -> list[Any]:
    if not marks:
        return []
    places = style.flat(np.asarray(run.graph.positions)[list(marks)], unit)
    axes.scatter(*places.T, s=75, marker="s", color="none", edgecolors=style.RED, linewidths=1.8, zorder=5)
    return [
        Line2D(
            [],
            [],
            ls="",
            marker="s",
            ms=8,
            mfc="none",
            mec=style.RED,
            mew=1.8,
            label="mission re-plan (R1, ...)",
        )
    ]


def _draw_labels(
    axes: Axes, run: MissionRun, executed: list[LegRecord], marks: dict[int, str], unit: style.Unit
) -> None:
    """Re-plans, priorities and waypoint numbers, the more important ones first."""
    places = style.flat(run.graph.positions, unit)
    track = np.concatenate([np.zeros((0, 2)), *(style.flat(leg.positions, unit)[::6] for leg in executed)])
    taken = np.concatenate([places, track])
    if marks:
        style.place_labels(
            axes,
            places[list(marks)],
            list(marks.values()),
            taken,
            fontsize=9,
            color=style.RED,
            weight="bold",
            zorder=8,
        )
    tasks = [leg for leg in executed if leg.priority > 0]
    if tasks:
        lines = [style.flat(leg.positions, unit) for leg in tasks]
        middles = np.stack([line[_middle(line)] for line in lines])
        texts = [f"ρ{figure(leg.priority)}" for leg in tasks]
        style.place_labels(
            axes, middles, texts, taken, fontsize=8.5, color=style.BLUE, weight="bold", zorder=8
        )
    visited = list(dict.fromkeys(node for leg in executed for node in (leg.start, leg.goal)))
    others = [node for node in range(len(places)) if node not in visited]
    for nodes, colour in ((visited, "black"), (others, "#555555")):
        if nodes:
            names = [run.called(node) for node in nodes]
            style.place_labels(axes, places[nodes], names, taken, fontsize=7, color=colour, zorder=7)
