"""The map of a mission (Figs 10, 15): coast, waypoints, the route as sailed, where tasks were re-ordered."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from auvplan.plot import style
from auvplan.plot.depths import draw_depths
from auvplan.site import hours
from auvplan.voyage.records import LegRecord, MissionRun


def plot_mission(run: MissionRun) -> Figure:
    """The map of a mission, east to the right and north up.

    Args:
        run: as sailed; a leg of its own, open water and a mission that was never begun are fine.
    """
    waypoints = np.asarray(run.graph.positions, float)
    sailed = [leg for leg in run.legs if len(leg.times)]
    points = np.concatenate([waypoints, *(leg.positions for leg in sailed)])
    low, high = style.frame_on_chart(points, run.chart, margin=0.05)
    unit = style.Unit.for_extent(float((high - low).max()))
    tall, wide = high - low
    figure = style.new_figure(9.4, float(np.clip(7.9 * tall / wide, 4.0, 11.0)) + 1.1)
    axes = figure.subplots()
    style.map_axes(axes, low, high, unit)
    handles: list[Any] = list(style.draw_coast(axes, run.chart, unit))
    handles += draw_depths(axes, run.seabed, unit)
    handles += _draw_graph(axes, run, unit)
    if sailed:
        route = _draw_route(axes, sailed, unit)
        bar = figure.colorbar(route, ax=axes, shrink=0.8, pad=0.02)
        bar.set_label("time [s]")
    handles += _draw_known(axes, run, unit)
    handles += _draw_ends(axes, run, unit)
    marks = _replan_marks(run) if run.simulated else {}
    handles += _draw_replans(axes, run, marks, unit)
    if any(leg.priority > 0 for leg in sailed):
        handles.append(
            Line2D([], [], ls="", marker="$ρ3$", ms=13, color=style.BLUE, label="priority of the task")
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    axes.set_title(_title(run), fontsize=11, pad=None if run.site is None else 20.0)
    style.draw_compass(axes, unit)
    if run.site is not None:
        style.draw_graticule(axes, run.site, unit)
    _draw_labels(axes, run, sailed, marks, unit)
    return figure


def _title(run: MissionRun) -> str:
    name = run.scenario.get("name") or "mission"
    what = f"seed {run.seed}" if run.simulated else "plan"
    tasks = f"{run.tasks} task{'' if run.tasks == 1 else 's'} of total priority {run.total_priority:.3g}"
    seconds = f"{run.t_mission:,.0f} of {run.t_available:,.0f} s"
    return f"{name}, {what}: {tasks}, {hours(run.t_mission)} of {hours(run.t_available)} ({seconds})"


def _flat(positions: style.Array, unit: style.Unit) -> style.Array:
    """[n, 3] m north, east, depth to [n, 2] east, north in the axes' unit."""
    return np.asarray(positions, float)[..., [1, 0]] / unit.metres


def _draw_graph(axes: Axes, run: MissionRun, unit: style.Unit) -> list[Any]:
    places = _flat(run.graph.positions, unit)
    adjacency = np.asarray(run.graph.adjacency)
    pairs = np.argwhere(np.triu(adjacency | adjacency.T, 1))
    axes.add_collection(LineCollection(list(places[pairs]), colors=style.GREY, lw=0.6, alpha=0.45, zorder=1))
    axes.scatter(*places.T, s=16, color="white", edgecolors="black", linewidths=0.8, zorder=4)
    return [
        Line2D([], [], color=style.GREY, lw=0.8, alpha=0.6, label="edge of the task graph"),
        Line2D([], [], ls="", marker="o", ms=4, color="white", mec="black", label="waypoint"),
    ]


def _draw_route(axes: Axes, sailed: list[LegRecord], unit: style.Unit) -> LineCollection:
    """The route, coloured by time, an arrow head on every leg."""
    first, last = sailed[0].times[0], sailed[-1].times[-1]
    pieces, times = [], []
    for leg in sailed:
        line = _flat(leg.positions, unit)
        axes.plot(*line.T, color="black", lw=3.4, zorder=2, solid_capstyle="round")
        pieces.append(np.stack([line[:-1], line[1:]], axis=1))
        times.append(0.5 * (leg.times[:-1] + leg.times[1:]))
    route = LineCollection(list(np.concatenate(pieces)), cmap=style.TIME, lw=2.2, zorder=3, capstyle="round")
    route.set_array(np.concatenate(times))
    route.set_clim(first, max(last, first + 1.0))
    axes.add_collection(route)
    for leg in sailed:
        line = _flat(leg.positions, unit)
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
    return route


def _middle(line: style.Array) -> int:
    """Index of the point of [n, 2] nearest to half the way."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return int(np.searchsorted(way, 0.5 * way[-1]))


def _draw_known(axes: Axes, run: MissionRun, unit: style.Unit) -> list[Any]:
    """Obstacles that were known beforehand, where they are at the departure, and where they go."""
    for obstacle in run.obstacles:
        north, east = (part / unit.metres for part in obstacle.position)
        axes.add_patch(
            Circle(
                (east, north), obstacle.radius / unit.metres, fc=style.RED, ec="black", alpha=0.6, zorder=3
            )
        )
        if obstacle.moves:
            way = [part * run.t_mission / unit.metres for part in obstacle.velocity]
            arrow = {"arrowstyle": "->", "color": style.RED, "linestyle": ":"}
            axes.annotate("", (east + way[1], north + way[0]), (east, north), arrowprops=arrow, zorder=3)
    if not run.obstacles:
        return []
    return [Line2D([], [], ls="", marker="o", ms=7, color=style.RED, mec="black", label="known obstacle")]


def _draw_ends(axes: Axes, run: MissionRun, unit: style.Unit) -> list[Any]:
    handles = []
    for index, kind, label, size in (
        (run.start, style.START, "start", 8),
        (run.goal, style.GOAL, "destination", 12),
    ):
        axes.scatter(*_flat(run.graph.positions[index], unit), zorder=6, **kind)
        handles.append(
            Line2D(
                [], [], ls="", marker=kind["marker"], ms=size, color=kind["color"], mec="black", label=label
            )
        )
    return handles


def _replan_marks(run: MissionRun) -> dict[int, str]:
    """Waypoint to the numbers of the mission re-plans made there; the first order is none."""
    marks: dict[int, list[int]] = {}
    for number, order in enumerate(run.orders[1:], start=1):
        if order.nodes:
            marks.setdefault(order.nodes[0], []).append(number)
    return {node: "R" + ",".join(map(str, numbers)) for node, numbers in marks.items()}


def _draw_replans(axes: Axes, run: MissionRun, marks: dict[int, str], unit: style.Unit) -> list[Any]:
    if not marks:
        return []
    places = _flat(np.asarray(run.graph.positions)[list(marks)], unit)
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
    axes: Axes, run: MissionRun, sailed: list[LegRecord], marks: dict[int, str], unit: style.Unit
) -> None:
    """Re-plans, priorities and waypoint numbers, the more important ones first."""
    places = _flat(run.graph.positions, unit)
    route = np.concatenate([np.zeros((0, 2)), *(_flat(leg.positions, unit)[::6] for leg in sailed)])
    taken = np.concatenate([places, route])
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
    tasks = [leg for leg in sailed if leg.priority > 0]
    if tasks:
        lines = [_flat(leg.positions, unit) for leg in tasks]
        middles = np.stack([line[_middle(line)] for line in lines])
        texts = [f"ρ{leg.priority:.3g}" for leg in tasks]
        style.place_labels(
            axes, middles, texts, taken, fontsize=8.5, color=style.BLUE, weight="bold", zorder=8
        )
    visited = list(dict.fromkeys(node for leg in sailed for node in (leg.start, leg.goal)))
    others = [node for node in range(len(places)) if node not in visited]
    for nodes, colour in ((visited, "black"), (others, "#555555")):
        if nodes:
            names = [run.names[node] if run.names else str(node) for node in nodes]
            style.place_labels(axes, places[nodes], names, taken, fontsize=7, color=colour, zorder=7)
