"""Pictures of a Monte Carlo study: use of time, expected times, planning time, routes (Figs 12 to 15).

Each shows missions of one setting, in order of seed.
"""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

from auvplan.plot import style
from auvplan.plot.maps import Map
from auvplan.plot.sweep import plot_paired, plot_sweep, set_title
from auvplan.runtime.arrays import Array
from auvplan.runtime.files import output_folder
from auvplan.runtime.formatting import counted
from auvplan.runtime.formatting import figure as number_in_words
from auvplan.study import statistics
from auvplan.study.table import flag_names, study_chart
from auvplan.view.scene import window

#: Missions that get boxes of their own.
_BOXES = 25
#: Failed missions that are named, and routes that get a map.
_NAMED, _MAPS = 8, 6
_EXECUTED = "executed, $T_{path}$"


def draw_study(dataset: xr.Dataset, folder: str | Path, seed: int | None = None) -> list[Path]:
    """Write all figures of a study; those of a single setting show the first values of a sweep.

    Args:
        dataset: of many missions, with or without leading dimensions of settings, which the attribute
            `sweep` names.
        folder: created if needed.
        seed: of the mission whose routes are shown; that with most of them where not given.

    Raises:
        ValueError: the study has no mission of that seed.
        OutputError: the folder or a file cannot be written; one line that names it.
    """
    dataset = dataset.sortby("seed")
    dims = statistics.sweep_dims(dataset)
    first = dataset.isel(dict.fromkeys(dims, 0))
    shown_mission(first, seed)
    figures: dict[str, Callable[[], Figure]] = {
        "time_use.png": partial(plot_time_use, first),
        "expected_times.png": partial(plot_expected_times, first),
        "planning_time.png": partial(plot_planning_time, first),
        "replans.png": partial(plot_replans, first, seed),
    }
    if dims:
        figures["sweep.png"] = partial(plot_sweep, dataset)
        if dataset.sizes[dims[0]] > 1:
            figures["sweep_paired.png"] = partial(plot_paired, dataset)
    target = output_folder(folder)
    return [style.save(plot(), target / name) for name, plot in figures.items()]


def plot_time_use(dataset: xr.Dataset) -> Figure:
    """Time of every mission against the time available, and what was left of it (Fig. 12)."""
    available, used, left = (dataset[f"t_{name}"].values for name in ("available", "mission", "residual"))
    success = dataset["success"].values == 1
    place = np.arange(len(used))
    figure = style.new_figure(11.0, 6.4)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    size = mark_size(len(place))
    for kept, kind in (
        (success, {"marker": "o", "ms": size, "color": style.BLUE, "label": "on time"}),
        (~success, {"marker": "x", "ms": size + 3, "mew": 1.8, "color": style.RED, "label": "failed"}),
    ):
        if kept.any():
            upper.plot(place[kept], used[kept], ls="none", **kind)
        lower.bar(place[kept], left[kept], width=0.8, color=kind["color"])
    mission_axis(lower, dataset)
    edges = np.concatenate([lower.get_xlim()[:1], place, lower.get_xlim()[1:]])
    limit = np.concatenate([available[:1], available, available[-1:]])
    upper.plot(edges, limit, color="red", lw=2.0, drawstyle="steps-mid", zorder=1, label="$T_{available}$")
    lower.axhline(0.0, color="black", lw=0.8)
    upper.set_ylabel("$T_{mission}$ [s]")
    lower.set_ylabel("$T_{residual}$ [s]")
    _dress(upper, lower)
    upper.margins(y=0.12)
    style.legend_below(figure, ncols=3)
    share = float(statistics.over_finite(statistics.use_of_time(dataset), np.nanmean))
    text = f"mean use of time {share:.1f} %, {success.sum()} of {counted(len(place), 'mission')} on time"
    failed = [str(seed) for seed in dataset["seed"].values[~success]]
    if failed:
        more = ", …" if len(failed) > _NAMED else ""
        text += f"; failed: seed {', '.join(failed[:_NAMED])}{more}"
    set_title(figure, dataset, text)
    return figure


def plot_expected_times(dataset: xr.Dataset) -> Figure:
    """Travel times of legs as expected and as executed, by mission and leg by leg (Fig. 13)."""
    expected, executed = statistics.leg_times(dataset)
    both = np.isfinite(expected) & np.isfinite(executed)
    if not both.any():
        return style.figure_of(style.annotate_empty(None, "no leg was executed to its end"))
    # Where tasks are done along the path, t_ij holds their time and no leg takes it.
    apart = (dataset["leg_t_task"].values[both] > 0.0).any()
    awaited = "expected, $t_{ij}$ − $δ_{ij}$" if apart else "expected, $t_{ij}$"
    figure = style.new_figure(14.5, 6.0)
    left, right = figure.subplots(1, 2, width_ratios=[2.2, 1])
    count = len(both)
    shown = [mission for mission in range(min(count, _BOXES)) if both[mission].any()]
    for times, name, width, face, edge, alpha in (
        (executed, _EXECUTED, 0.84, style.YELLOW, "#8a7d00", 0.55),
        (expected, awaited, 0.34, style.BLUE, style.BLACK, 1.0),
    ):
        left.boxplot(
            [times[mission][both[mission]] for mission in shown], positions=shown, widths=width,
            patch_artist=True, manage_ticks=False, label=name,
            boxprops={"facecolor": face, "edgecolor": edge, "alpha": alpha},
            medianprops={"color": edge if alpha < 1.0 else "white", "lw": 1.8},
            whiskerprops={"color": edge}, capprops={"color": edge},
            flierprops={"marker": "o" if alpha < 1.0 else ".", "ms": 4, "mec": edge},
        )  # fmt: skip
    mission_axis(left, dataset, _BOXES)
    left.set_ylabel("travel time of a leg, without its task [s]" if apart else "time of a leg [s]")
    left.legend(loc="upper left", ncols=2, fontsize=8)
    low, high = left.get_ylim()
    left.set_ylim(low, high + 0.1 * (high - low))
    which = f"the first {_BOXES} of {count} missions" if count > _BOXES else counted(count, "mission")
    left.set_title(f"legs of {which} in order of seed", fontsize=10)
    _draw_scatter(right, expected[both], executed[both], statistics.relative_errors(dataset)[both])
    right.set_xlabel(f"{awaited} [s]")
    _dress(left, right)
    set_title(figure, dataset, "travel times of legs as expected and as executed")
    return figure


def plot_planning_time(dataset: xr.Dataset) -> Figure:
    """CPU time of one path planning call beside that of all planning of its mission (Fig. 14)."""
    calls = statistics.positive(dataset["plan_cpu"].values)
    low, middle, high = statistics.call_times(dataset)
    whole = statistics.positive(statistics.planning_time(dataset))
    place = np.arange(len(whole))
    figure = style.new_figure(11.0, 5.4)
    axes = figure.subplots()
    axes.set_yscale("log")
    size = mark_size(len(place))
    marks: dict[str, Any] = {"ls": "none", "ms": size}
    every = "all planning of the mission: paths, routes, travel times"
    axes.plot(place, whole, marker="s", color=style.RED, label=every, **marks)
    band = "path planning calls, 5 to 95 %"
    axes.vlines(place, low, high, color=style.SKY, lw=max(0.8, 0.8 * size), label=band)
    axes.plot(place, middle, marker="o", color=style.BLUE, label="one path planning call, median", **marks)
    axes.set_ylabel("CPU time of planning [s]")
    style.grid(axes, which="both", axis="y")
    mission_axis(axes, dataset)
    style.legend_below(figure, ncols=3)
    one, total = (float(statistics.over_finite(values.ravel(), np.nanmedian)) for values in (calls, whole))
    text = f"median of a path planning call {one:.3g} s, of a mission's planning {total:.3g} s"
    set_title(figure, dataset, text)
    return figure


def plot_replans(dataset: xr.Dataset, seed: int | None = None) -> Figure:
    """Maps of one mission's routes: the first and up to five re-plans (Fig. 15).

    Args:
        dataset: without a sweep.
        seed: of the mission; that with most routes among those on time where not given.

    Raises:
        ValueError: the study has no mission of that seed.
    """
    one = dataset.isel(mission=shown_mission(dataset, seed))
    made = np.flatnonzero((one["route_nodes"].values >= 0).any(axis=-1))
    places = one["waypoint_position"].values
    known = np.isfinite(places).all(axis=-1)
    if not made.size or not known.any():
        text = f"seed {int(one['seed'])}: no route was made"
        return style.figure_of(style.annotate_empty(None, text))
    chart = study_chart(dataset)
    low, high = window(places[known], 0.06, chart)
    chosen = np.unique(np.rint(np.linspace(0, len(made) - 1, min(len(made), _MAPS))).astype(int))
    columns = 2 if len(chosen) == 4 else min(len(chosen), 3)
    rows = -(-len(chosen) // columns)
    tall = float(np.clip((high - low)[0] / (high - low)[1], 0.5, 2.0))
    figure = style.new_figure(max(4.5 * columns, 7.5), (4.3 * tall + 0.6) * rows + 1.0)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    done, pens = _visited(one, made), []
    for k, (axes, number) in enumerate(zip(grid, chosen, strict=False)):
        pens.append(pen := Map(axes, low, high))
        below, beside = k + columns < len(chosen), k % columns > 0
        axes.tick_params(labelbottom=not below, labelleft=not beside)
        if below:
            axes.set_xlabel("")
        if beside:
            axes.set_ylabel("")
        pen.coast(chart)
        _draw_route(pen, one, int(made[number]), done[number])
        axes.set_title(_route_name(one, int(made[number]), int(number)), fontsize=9)
    for axes in grid[len(chosen) :]:
        axes.set_visible(False)
    style.legend_below(figure, pens[-1].handles)
    ending = "on time" if int(one["success"]) == 1 else "failed"
    text = f"seed {int(one['seed'])}: {counted(len(made) - 1, 'mission re-plan')}, {ending}"
    set_title(figure, dataset, text + (f"; {len(chosen)} routes of {len(made)}" * (len(chosen) < len(made))))
    for pen, number in zip(pens, chosen, strict=True):
        _label_route(pen, one, int(made[number]), done[number])
    return figure


def shown_mission(dataset: xr.Dataset, seed: int | None = None) -> int:
    """Index of the mission of a seed; without one, of that with most routes, one on time where there is any.

    Raises:
        ValueError: the study has no mission of that seed.
    """
    seeds = dataset["seed"].values
    if seed is None:
        routes = (dataset["route_nodes"].values >= 0).any(axis=-1).sum(axis=-1)
        success = dataset["success"].values == 1
        return max(range(len(seeds)), key=lambda mission: (success[mission], routes[mission]))
    found = np.flatnonzero(seeds == seed)
    if not found.size:
        raise ValueError(f"no mission of seed {seed}; the study's are {seeds.min()} to {seeds.max()}")
    return int(found[0])


def _visited(one: xr.Dataset, made: Iterable[int]) -> list[list[int]]:
    """Return, for each route, the waypoints from the start to where the vehicle was when it was made."""
    reached = one["leg_arrived"].values == 1
    stops = [_nodes(one, route)[0] for route in made]
    visited = [stops[0], *(int(node) for node in one["leg_to"].values[reached])]
    found, legs = [], 0
    for here in stops:
        legs = next((k for k in range(legs, len(visited)) if visited[k] == here), legs)
        found.append(visited[: legs + 1])
    return found


def _nodes(one: xr.Dataset, route: int) -> list[int]:
    return [int(node) for node in one["route_nodes"].values[route] if node >= 0]


def _route_name(one: xr.Dataset, route: int, number: int) -> str:
    """Return what a route was made for, when, and what it holds; `number` counts from the first route, 0."""
    cause = flag_names(one["route_cause"])[route]
    name = "first route" if number == 0 else ", ".join(filter(None, [f"re-plan R{number}", cause]))
    legs = max(len(_nodes(one, route)) - 1, 0)
    at, time, priority = (float(one[f"route_{key}"].values[route]) for key in ("made_at", "time", "priority"))
    return (
        f"{name}, at {at:,.0f} s\n{counted(legs, 'leg')} left, priority {number_in_words(priority)}, "
        f"{time:,.0f} s of {float(one['t_available']) - at:,.0f} s"
    )


def _draw_route(pen: Map, one: xr.Dataset, route: int, done: list[int]) -> None:
    """Waypoints, the part executed in grey, the route with an arrow for each leg."""
    places = one["waypoint_position"].values
    nodes = _nodes(one, route)
    pen.dots(places, s=14, color="white", edgecolors="black", linewidths=0.7, zorder=3)
    pen.line(places[done], color=style.GREY, lw=2.6, zorder=2, solid_capstyle="round")
    flat = pen.flat(places[nodes])
    steps = np.diff(flat, axis=0)
    if len(steps):
        pen.axes.quiver(
            *flat[:-1].T, *steps.T, angles="xy", scale_units="xy", scale=1.0, color=style.BLUE, width=0.006,
            headwidth=4.5, headlength=6.0, headaxislength=5.5, zorder=4,
        )  # fmt: skip
    pen.handles += [
        style.line("waypoint", ls="", marker="o", ms=4, color="white", mec="black"),
        style.line("executed", color=style.GREY, lw=2.6),
        style.line("route", color=style.BLUE, lw=1.8, marker=">", ms=5),
    ]
    pen.end(places[done[0]], style.START, "start", 0.7)
    pen.end(places[nodes[-1]], style.GOAL, "destination", 0.4)
    pen.end(places[nodes[0]], style.VEHICLE, "vehicle", 0.45)


def _label_route(pen: Map, one: xr.Dataset, route: int, done: list[int]) -> None:
    """Numbers of the waypoints in a route, off the lines."""
    places = one["waypoint_position"].values[:, :2]
    nodes, share = _nodes(one, route), np.linspace(0.0, 1.0, 20)[:, None, None]
    lines = [
        (places[visited][:-1] + share * np.diff(places[visited], axis=0)).reshape(-1, 2)
        for visited in (nodes, done)
    ]
    taken = np.concatenate([places[np.isfinite(places).all(axis=-1)], *lines])
    pen.labels(places[nodes], [str(node) for node in nodes], taken, zorder=8)


def _draw_scatter(axes: Axes, expected: Array, executed: Array, errors: Array) -> None:
    """Every leg's time executed against the time expected, [legs] s."""
    axes.scatter(
        expected, executed, s=9, color=style.BLUE,
        alpha=float(np.clip(6.0 / len(executed) ** 0.45, 0.12, 0.8)),
        linewidths=0, rasterized=True,
    )  # fmt: skip
    ends = np.array([min(expected.min(), executed.min()), max(expected.max(), executed.max())])
    axes.plot(ends, ends, color="black", lw=1.2, ls="--")
    middle, half = 0.5 * ends.sum(), 0.54 * max(float(np.ptp(ends)), 1.0)
    axes.set(xlim=(middle - half, middle + half), ylim=(middle - half, middle + half), box_aspect=1.0)
    axes.set_ylabel(f"{_EXECUTED} [s]")
    axes.xaxis.set_major_formatter(_seconds)
    varied = len(executed) > 2 and min(np.ptp(expected), np.ptp(executed)) > 0.0
    text = f"correlation {np.corrcoef(expected, executed)[0, 1]:.3f}\n" if varied else ""
    text += f"median relative error {100.0 * float(statistics.over_finite(errors, np.nanmedian)):.1f} %"
    axes.text(0.03, 0.97, text, transform=axes.transAxes, va="top", fontsize=9, path_effects=style.halo())
    axes.set_title(f"{counted(len(executed), 'leg')} of all missions", fontsize=10)


def mission_axis(axes: Axes, dataset: xr.Dataset, most: int | None = None) -> None:
    """Places 0, 1, ... along x are missions; the ticks are their seeds."""
    seeds = dataset["seed"].values
    count = min(len(seeds), most or len(seeds))
    # Few missions stay slim, and the marks of many stay off the frame.
    margin = max(0.5 * (8 - count), 0.005 * count)
    axes.set_xlim(-0.6 - margin, count - 0.4 + margin)
    every = count <= _BOXES
    axes.xaxis.set_major_locator(FixedLocator(range(count)) if every else MaxNLocator(20, integer=True))
    axes.xaxis.set_major_formatter(
        FuncFormatter(lambda at, _: str(seeds[int(at)]) if at in range(count) else "")
    )
    axes.set_xlabel("seed of the mission [-]")


def _dress(*panels: Axes) -> None:
    """Grid and ticks of panels whose y axis is in s."""
    for axes in panels:
        axes.yaxis.set_major_formatter(_seconds)
        style.grid(axes, axis="y")


def _seconds(value: float, _: Any) -> str:
    return f"{value:,.0f}".replace("-", "−")


def mark_size(count: int) -> float:
    """Size of the marks of `count` missions side by side, points."""
    return float(np.clip(400.0 / count, 1.8, 6.0))
