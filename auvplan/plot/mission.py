"""The map of a mission (Figs 10, 15): coast, waypoints, the track, where the route was re-planned."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from auvplan.plot import style
from auvplan.plot.maps import Map
from auvplan.plot.section import SECTION, add_section
from auvplan.plot.style import Array
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime.formatting import counted, figure, hours
from auvplan.view.scene import executed_legs, refused_legs, window
from auvplan.view.section import run_sections


def plot_mission(run: MissionRun, *, ax: Axes | None = None) -> Axes:
    """Draw the map of a mission, east to the right and north up.

    In a figure of its own the vertical section along its legs is below, if anything differs with depth.

    Args:
        run: as executed; a leg of its own, open water and a mission that was never begun are fine.
        ax: axes to draw in; those of a new figure if absent.
    """
    waypoints = np.asarray(run.graph.positions, float)
    executed = executed_legs(run)
    points = np.concatenate([waypoints, *(leg.positions for leg in executed)])
    low, high = window(points, 0.05, run.chart)
    tall, wide = high - low
    sections = run_sections(run) if ax is None else []
    below = SECTION if sections else 0.0
    axes = style.own_axes(ax, 9.4, float(np.clip(7.9 * tall / wide, 4.0, 11.0)) + 1.1 + below)
    in_section = add_section(axes, sections, run)
    pen = Map(axes, low, high)
    pen.coast(run.coast)
    pen.depths(run.seabed)
    pen.closures(run)
    _draw_graph(pen, run)
    if executed:
        bar = axes.figure.colorbar(_draw_track(pen, executed), ax=axes, shrink=0.8, pad=0.02)
        bar.set_label("time [s]")
    _draw_refused(pen, run)
    _draw_turns(pen, run)
    pen.known(run.obstacles, run.t_mission)
    pen.end(waypoints[run.start], style.START, "start")
    pen.end(waypoints[run.goal], style.GOAL, "destination")
    numbers: dict[int, list[str]] = {}
    for number, route in enumerate(run.routes[1:] if run.simulated else (), start=1):
        if route.nodes:
            numbers.setdefault(route.nodes[0], []).append(str(number))
    marks = {node: "R" + ",".join(here) for node, here in numbers.items()}
    if marks:
        box: dict[str, Any] = {"s": 75, "marker": "s", "color": "none", "edgecolors": style.RED}
        pen.dots(waypoints[list(marks)], linewidths=1.8, zorder=5, **box)
        shown: dict[str, Any] = {"ls": "", "marker": "s", "ms": 8, "mfc": "none", "mew": 1.8}
        pen.handles.append(style.line("mission re-plan (R1, ...)", mec=style.RED, **shown))
    if any(leg.priority > 0 for leg in executed):
        rho = style.line("priority of the task", ls="", marker="$ρ3$", ms=13, color=style.BLUE)
        pen.handles.append(rho)
    pen.handles += in_section.values()
    style.add_legend(axes, pen.handles, ax)
    pen.title(_title(run), run.site, points)
    _draw_labels(pen, run, executed, marks)
    return axes


def _title(run: MissionRun) -> str:
    name = run.scenario.get("name") or "mission"
    what = f"seed {run.seed}" if run.simulated else "plan"
    tasks = f"{counted(run.tasks, 'task')} of total priority {figure(run.total_priority)}"
    seconds = f"{run.t_mission:,.0f} of {run.t_available:,.0f} s"
    return f"{name}, {what}: {tasks}, {hours(run.t_mission)} of {hours(run.t_available)} ({seconds})"


def _draw_graph(pen: Map, run: MissionRun) -> None:
    places = pen.flat(run.graph.positions)
    adjacency = np.asarray(run.graph.adjacency)
    pairs = np.argwhere(np.triu(adjacency | adjacency.T, 1))
    edges = LineCollection(list(places[pairs]), colors=style.GREY, lw=0.6, alpha=0.45, zorder=1)
    pen.axes.add_collection(edges)
    pen.axes.scatter(*places.T, s=16, color="white", edgecolors="black", linewidths=0.8, zorder=4)
    pen.handles += [
        style.line("edge of the task graph", color=style.GREY, lw=0.8, alpha=0.6),
        style.line("waypoint", ls="", marker="o", ms=4, color="white", mec="black"),
    ]


def _draw_track(pen: Map, executed: list[LegRecord]) -> LineCollection:
    """Draw the track, coloured by time, an arrow head on every leg."""
    first, last = executed[0].times[0], executed[-1].times[-1]
    lines = [pen.flat(leg.positions) for leg in executed]
    for line in lines:
        pen.axes.plot(*line.T, color="black", lw=3.4, zorder=2, solid_capstyle="round")
    pieces = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])
    track = LineCollection(list(pieces), cmap=style.TIME, lw=2.2, zorder=3, capstyle="round")
    track.set_array(np.concatenate([0.5 * (leg.times[:-1] + leg.times[1:]) for leg in executed]))
    track.set_clim(first, max(last, first + 1.0))
    pen.axes.add_collection(track)
    head = {"arrowstyle": "-|>", "color": "black", "mutation_scale": 15, "shrinkA": 0, "shrinkB": 0}
    for line in lines:
        middle = _middle(line)
        if middle and (line[middle] != line[middle - 1]).any():
            pen.axes.annotate("", xy=line[middle], xytext=line[middle - 1], arrowprops=head, zorder=3.5)
    return track


def _draw_refused(pen: Map, run: MissionRun) -> None:
    """Draw paths that were planned and refused, each with a cross at half their length."""
    lines = [pen.flat(leg.plans[-1].positions) for leg in refused_legs(run)]
    kind: dict[str, Any] = {"color": style.REFUSED, "ls": ":", "lw": 1.2, "marker": "x", "ms": 5, "mew": 1.3}
    for line in lines:
        pen.axes.plot(*line.T, markevery=[_middle(line)], zorder=1.8, **kind)
    if lines:
        pen.handles.append(style.line("planned and refused", **kind))


def _draw_turns(pen: Map, run: MissionRun) -> None:
    """Draw the paths that a plan's rule takes if the vehicle is late."""
    kind: dict[str, Any] = {"color": style.ORANGE, "ls": "--", "lw": 1.0}
    turns = () if run.promise is None else run.promise.turns
    for turn in turns:
        pen.axes.plot(*pen.flat(np.asarray(turn.positions)).T, zorder=1.7, alpha=0.8, **kind)
    if turns:
        pen.handles.append(style.line("path if late", **kind))


def _middle(line: Array) -> int:
    """Index of the point of [n, 2] nearest to half the length."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return int(np.searchsorted(arc, 0.5 * arc[-1]))


def _draw_labels(pen: Map, run: MissionRun, executed: list[LegRecord], marks: dict[int, str]) -> None:
    """Re-plans, priorities and waypoint numbers, the more important ones first."""
    places = np.asarray(run.graph.positions, float)
    taken = np.concatenate([places[:, :2], *(leg.positions[::6, :2] for leg in executed)])
    bold: dict[str, Any] = {"weight": "bold", "zorder": 8}
    pen.labels(places[list(marks)], list(marks.values()), taken, fontsize=9, color=style.RED, **bold)
    tasks = [leg for leg in executed if leg.priority > 0]
    middles = [leg.positions[_middle(pen.flat(leg.positions))] for leg in tasks]
    texts = [f"ρ{figure(leg.priority)}" for leg in tasks]
    pen.labels(middles, texts, taken, fontsize=8.5, color=style.BLUE, **bold)
    visited = list(dict.fromkeys(node for leg in executed for node in (leg.start, leg.goal)))
    others = [node for node in range(len(places)) if node not in visited]
    for nodes, colour in ((visited, "black"), (others, "#555555")):
        pen.labels(places[nodes], [run.called(node) for node in nodes], taken, color=colour, zorder=7)
