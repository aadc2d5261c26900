"""How one mission's route changed on the way, after Fig. 15."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from auvplan.plot import style
from auvplan.plot.sweep import set_title
from auvplan.study.table import study_chart
from auvplan.words import counted, figure

#: Routes that get a map.
_MAPS = 6


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
        return style.empty_figure(f"seed {int(one['seed'])}: no route was made")
    chart = study_chart(dataset)
    low, high = style.frame_of(places[known], margin=0.06)
    if chart is not None:
        low, high = np.maximum(low, np.asarray(chart.lower)), np.minimum(high, np.asarray(chart.upper))
    unit = style.Unit.for_extent(float((high - low).max()))
    chosen = np.unique(np.rint(np.linspace(0, len(made) - 1, min(len(made), _MAPS))).astype(int))
    columns = 2 if len(chosen) == 4 else min(len(chosen), 3)
    rows = -(-len(chosen) // columns)
    tall = float(np.clip((high - low)[0] / (high - low)[1], 0.5, 2.0))
    figure = style.new_figure(max(4.5 * columns, 7.5), (4.3 * tall + 0.6) * rows + 1.0)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    done = _visited(one, made)
    handles: list[Any] = []
    for k, (axes, number) in enumerate(zip(grid, chosen, strict=False)):
        style.map_axes(axes, low, high, unit)
        below, beside = k + columns < len(chosen), k % columns > 0
        axes.tick_params(labelbottom=not below, labelleft=not beside)
        if below:
            axes.set_xlabel("")
        if beside:
            axes.set_ylabel("")
        handles = list(style.draw_coast(axes, chart, unit))
        handles += _draw_route(axes, one, int(made[number]), done[number], unit)
        axes.set_title(_route_name(one, int(made[number]), int(number)), fontsize=9)
    for axes in grid[len(chosen) :]:
        axes.set_visible(False)
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    ending = "on time" if int(one["success"]) == 1 else "failed"
    text = f"seed {int(one['seed'])}: {counted(len(made) - 1, 'mission re-plan')}, {ending}"
    set_title(figure, dataset, text + (f"; {len(chosen)} routes of {len(made)}" * (len(chosen) < len(made))))
    for axes, number in zip(grid, chosen, strict=False):
        _label_route(axes, one, int(made[number]), done[number], unit)
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
    """For each route, the waypoints from the start to where the vehicle was when it was made."""
    reached = one["leg_arrived"].values == 1
    stops = [_nodes(one, route)[0] for route in made]
    way = [stops[0], *(int(node) for node in one["leg_to"].values[reached])]
    found, legs = [], 0
    for here in stops:
        legs = next((k for k in range(legs, len(way)) if way[k] == here), legs)
        found.append(way[: legs + 1])
    return found


def _nodes(one: xr.Dataset, route: int) -> list[int]:
    return [int(node) for node in one["route_nodes"].values[route] if node >= 0]


def _route_name(one: xr.Dataset, route: int, number: int) -> str:
    """Return what a route was made for, when, and what it holds; `number` counts from the first route, 0."""
    causes = one["route_cause"]
    meanings = str(causes.attrs.get("flag_meanings", "")).split()
    flags = np.atleast_1d(causes.attrs.get("flag_values", [])).tolist()
    cause = dict(zip(flags, meanings, strict=False)).get(int(causes.values[route]), "")
    name = "first route" if number == 0 else ", ".join(filter(None, [f"re-plan R{number}", cause]))
    legs = max(len(_nodes(one, route)) - 1, 0)
    at, time, priority = (float(one[f"route_{key}"].values[route]) for key in ("made_at", "time", "priority"))
    return (
        f"{name}, at {at:,.0f} s\n{counted(legs, 'leg')} left, priority {figure(priority)}, "
        f"{time:,.0f} s of {float(one['t_available']) - at:,.0f} s"
    )


def _draw_route(axes: Axes, one: xr.Dataset, route: int, done: list[int], unit: style.Unit) -> list[Any]:
    """Waypoints, the part executed in grey, the route with an arrow for each leg; returns legend handles."""
    flat = one["waypoint_position"].values[:, [1, 0]] / unit.metres
    nodes = _nodes(one, route)
    places = flat[nodes]
    axes.scatter(*flat.T, s=14, color="white", edgecolors="black", linewidths=0.7, zorder=3)
    axes.plot(*flat[done].T, color=style.GREY, lw=2.6, zorder=2, solid_capstyle="round")
    steps = np.diff(places, axis=0)
    if len(steps):
        axes.quiver(
            *places[:-1].T, *steps.T, angles="xy", scale_units="xy", scale=1.0, color=style.BLUE, width=0.006,
            headwidth=4.5, headlength=6.0, headaxislength=5.5, zorder=4,
        )  # fmt: skip
    kinds = {
        "start": (style.START, done[0], 0.7),
        "destination": (style.GOAL, nodes[-1], 0.4),
        "vehicle": (style.VEHICLE, nodes[0], 0.45),
    }
    for kind, node, scale in kinds.values():
        axes.scatter(*flat[node], zorder=5, **(kind | {"s": scale * kind["s"]}))
    return [
        Line2D([], [], ls="", marker="o", ms=4, color="white", mec="black", label="waypoint"),
        Line2D([], [], color=style.GREY, lw=2.6, label="executed"),
        Line2D([], [], color=style.BLUE, lw=1.8, marker=">", ms=5, label="route"),
        *(
            Line2D([], [], ls="", marker=kind["marker"], ms=8, color=kind["color"], mec="black", label=name)
            for name, (kind, _, _) in kinds.items()
        ),
    ]


def _label_route(axes: Axes, one: xr.Dataset, route: int, done: list[int], unit: style.Unit) -> None:
    """Numbers of the waypoints in a route, off the lines."""
    flat = one["waypoint_position"].values[:, [1, 0]] / unit.metres
    nodes, share = _nodes(one, route), np.linspace(0.0, 1.0, 20)[:, None, None]
    lines = [(flat[way][:-1] + share * np.diff(flat[way], axis=0)).reshape(-1, 2) for way in (nodes, done)]
    taken = np.concatenate([flat[np.isfinite(flat).all(axis=-1)], *lines])
    style.place_labels(axes, flat[nodes], [str(node) for node in nodes], taken, zorder=8)
