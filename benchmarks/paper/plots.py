"""The paper's figures, drawn of what was run: those that the paper alone has, and the package's own."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from auvplan.ocean.chart import Chart
from auvplan.ocean.whitsunday import render, whitsunday_chart
from auvplan.plot import style
from auvplan.plot.convergence import BARS, LABELS, draw_errors, dress
from auvplan.plot.maps import Map
from auvplan.plot.paths import plot_currents
from auvplan.plot.space import Space
from auvplan.plot.study import mark_size, mission_axis, plot_expected_times, plot_replans, plot_time_use
from auvplan.plot.sweep import set_title
from auvplan.plot.timeline import plot_timeline
from auvplan.records import LegRecord, MissionRun, PlanRecord
from auvplan.runtime.files import output_folder
from auvplan.study import statistics
from auvplan.view import scene
from benchmarks.paper.claims import NO_VIOLATION, Evidence, no_violation
from benchmarks.paper.legs import SHOWN_RATE, Legs, changed, displacement, followed, leg_of, shown_leg

Array = style.Array

#: Colours of the clusters: forbidden, risky, valid.
_COAST, _UNCERTAIN, _WATER = "black", "#9a9a9a", "white"
#: Points along each edge of a layer of current: of its colours and of its arrows. Height of its box.
_FINE, _ARROWS, _HEIGHT = 50, 8, 0.75


#: Re-plans of the paper's example of a mission.
_REPLANS = 3


def draw_paper(
    legs: Legs, evidence: Evidence, run_again: Callable[[int], MissionRun], folder: Path
) -> list[Path]:
    """Write Figs 1 and 8 to 15 under the names that the paper counts them by.

    Args:
        legs: runs of the three scenarios.
        evidence: of them and of the missions.
        run_again: the mission of a seed, which is drawn as Fig. 15.
        folder: created if needed.
    """
    missions, crop = evidence.missions, changed("scenario-3", "paper").chart.window
    assert crop is not None
    seed, met = example_seed(missions), no_violation(evidence.legs)
    figures: dict[str, Callable[[], Any]] = {
        "fig01_clusters.png": lambda: plot_clusters(whitsunday_chart(), render(), crop),
        "fig08_currents.png": partial(_currents, legs),
        "fig09_obstacles.png": lambda: plot_layers(shown_leg(legs.scenarios["scenario-2"])),
        "fig10_windows.png": lambda: plot_windows(shown_leg(legs.scenarios["scenario-3"])),
        "fig11_convergence.png": lambda: plot_populations(evidence.legs, met, NO_VIOLATION),
        "fig12_time_use.png": lambda: plot_time_use(missions),
        "fig13_expected_times.png": lambda: plot_expected_times(missions),
        "fig14_planning_time.png": lambda: plot_call_times(missions, evidence.calls, evidence.interval),
        "fig15_routes.png": lambda: plot_timeline(run_again(seed)),
        "fig15_maps.png": lambda: plot_replans(missions, seed),
    }
    target = output_folder(folder)
    return [style.save(plot(), target / name) for name, plot in figures.items()]


def example_seed(missions: xr.Dataset) -> int:
    """Seed of the mission with nearest to the paper's number of re-plans, one on time where there is any."""
    success, replans = missions["success"].values == 1, missions["mission_replans"].values
    # Ties go to more path calls: the paper's mission is no short one.
    rank = np.lexsort((-missions["path_calls"].values, np.abs(replans - _REPLANS), ~success))
    return int(missions["seed"].values[rank[0]])


def _currents(legs: Legs) -> NDArray[Any]:
    run = shown_leg(legs.rates[SHOWN_RATE], largest=True)
    count = len(legs.rates[SHOWN_RATE])
    note = (
        f"scenario-1 with $U_R^C$ = {SHOWN_RATE:g}; seed {run.seed}, whose re-plans lead farthest aside of "
        f"{count}: by {displacement(leg_of(run)):,.0f} m"
    )
    return plot_currents(run, followed(leg_of(run)), note=note)


def plot_clusters(chart: Chart, picture: NDArray[np.uint8], window: tuple[int, int, int, int]) -> Figure:
    """Draw the picture and its clusters side by side, the whole map above and a window of it below.

    Args:
        chart: made of the picture.
        picture: [rows, columns, 3] RGB, row 0 in the north.
        window: first row (north), first column (east), rows and columns, pixels.
    """
    row, column, rows, columns = window
    figure = style.new_figure(9.6, 9.8)
    grid = figure.subplots(2, 2)
    raster = np.asarray(chart.passability)[::-1]  # rows from the north
    colours = [to_rgb(colour) for colour in (_COAST, _UNCERTAIN, _WATER)]
    coloured = np.asarray(colours)[np.where(raster == 0.0, 0, np.where(raster == 1.0, 2, 1))]
    size = (np.asarray(chart.upper, float) - np.asarray(chart.lower, float))[0] / raster.shape[0]
    parts = ((slice(None), slice(None)), (slice(row, row + rows), slice(column, column + columns)))
    for line, part in zip(grid, parts, strict=True):
        for axes, image in zip(line, (picture[part], coloured[part]), strict=True):
            north, east = size / 1000.0 * np.asarray(image.shape[:2])
            axes.imshow(image, extent=(0.0, east, 0.0, north), interpolation="none")
            axes.set_xlabel("east [km]")
            axes.set_ylabel("north [km]")
            axes.tick_params(labelsize=8)
        line[0].set_title(f"picture, {image.shape[0]} × {image.shape[1]} pixels of {size:g} m", fontsize=10)
        coast, water = float((raster[part] == 0.0).mean()), float((raster[part] == 1.0).mean())
        shares = f"coast {coast:.1%}, uncertain {1.0 - coast - water:.1%}, water {water:.1%}"
        line[1].set_title(f"clusters: {shares}", fontsize=10)
    for axes in grid[0]:
        edge = np.asarray([column, raster.shape[0] - row - rows]) * size / 1000.0
        place = (float(edge[0]), float(edge[1]))
        axes.add_patch(
            Rectangle(place, columns * size / 1e3, rows * size / 1e3, fill=False, ec=style.RED, lw=1.8)
        )
    handles = [
        Patch(facecolor=colour, edgecolor=style.GREY, label=label)
        for colour, label in (
            (_COAST, "coast, 0: forbidden"),
            (_UNCERTAIN, "uncertain, (0, 0.35]: risky"),
            (_WATER, "water, 1: valid"),
        )
    ]
    handles.append(Patch(facecolor="none", edgecolor=style.RED, lw=1.8, label="window of the path planner"))
    style.legend_below(figure, handles, fontsize=9)
    figure.suptitle("Map of the mission planner (above) and of the path planner (below)", fontsize=11)
    return figure


def plot_layers(run: MissionRun) -> Figure:
    """Draw the paths of a run of one leg among its obstacles, with the current of each step in a layer.

    Obstacles are drawn where they truly were at the last step, with their tracks; the rings are their
    boundaries at each step, which grow until the vehicle sees them again.
    """
    leg = leg_of(run)
    plans = leg.followed_plans
    figure = style.new_figure(9.6, 7.4)
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    low, high = scene.window(scene.extent_points(leg), 0.04)
    pen = Space(axes, low, high)
    depths = scene.extent_points(leg)[:, 2]
    top, bottom = float(min(depths.min(), 0.0)), float(depths.max()) * 1.1 + 10.0
    speeds = _draw_currents(pen, plans, np.linspace(top, bottom, len(plans) + 2)[1:-1])
    kinds = _draw_boundaries(pen, run, leg, [plan.made_at for plan in plans])
    pen.line(plans[0].positions, color=style.RED, ls="--", lw=1.5, zorder=4)
    for number in range(1, len(plans)):
        executed, given_up = until_next(plans, number)
        pen.line(given_up, color="black", ls=":", lw=1.1, zorder=4)
        pen.line(executed, color="black", lw=2.8, zorder=4)
    pen.finish(plans, (top, bottom), _HEIGHT, pad=8)
    axes.view_init(elev=24, azim=-62)
    bar = figure.colorbar(ScalarMappable(speeds, "cividis"), ax=axes, shrink=0.55, pad=0.08)
    bar.set_label("current [m/s]")
    style.legend_below(figure, [
        style.line("first path", color=style.RED, ls="--", lw=1.5),
        style.line("re-planned", color="black", lw=2.8),
        style.line("given up at the next re-plan", color="black", ls=":", lw=1.1),
        *style.marks(vehicle="vehicle at a re-plan"),
        *style.obstacle_patches(kinds, ", boundaries as rings", alpha=0.6),
    ])  # fmt: skip
    times = ", ".join(f"{plan.made_at:,.0f}" for plan in plans)
    stretch = _HEIGHT * float((high - low)[0]) / (bottom - top)
    name = run.scenario.get("name") or "leg"
    figure.suptitle(
        f"{name}, seed {run.seed}: layers of the current at {times} s, the first on top\n"
        f"vertical exaggeration {stretch:.1f}; obstacles are stretched with it",
        fontsize=11,
    )
    return figure


def _draw_currents(pen: Space, plans: Sequence[PlanRecord], depths: Array) -> Normalize:
    """Draw a plane for each plan, coloured by speed, with arrows."""

    def plane(plan: PlanRecord, depth: float, count: int) -> tuple[Array, ...]:
        """East and north in the axes' unit, and the current's components there, m/s, [count, count] each."""
        x, y = (np.linspace(pen.low[k], pen.high[k], 2 * count + 1)[1::2] for k in range(2))
        north, east = np.meshgrid(x, y, indexing="ij")
        u, v = scene.current_on(plan.current, x, y, depth, plan.made_at)
        return east / pen.metres, north / pen.metres, u, v

    planes = [plane(plan, float(z), _FINE) for plan, z in zip(plans, depths, strict=True)]
    fastest = max(float(np.quantile([np.hypot(u, v) for *_, u, v in planes], 0.995)), 1e-3)
    norm, levels = Normalize(0.0, fastest), np.linspace(0.0, fastest, 12)
    reach = 0.8 * float((pen.high - pen.low)[0]) / _ARROWS / fastest / pen.metres
    for plan, (east, north, u, v), depth in zip(plans, planes, depths, strict=True):
        pen.axes.contourf(
            east, north, np.minimum(np.hypot(u, v), fastest), levels, zdir="z",
            offset=depth, cmap="cividis", norm=norm, alpha=0.3, antialiased=False, zorder=0,
        )  # fmt: skip
        east, north, u, v = (part.ravel() for part in plane(plan, float(depth), _ARROWS))
        pen.axes.quiver(
            east, north, np.full(len(u), depth), v * reach, u * reach, 0.0 * u,
            color="#444444", lw=0.6, arrow_length_ratio=0.25, zorder=1,
        )  # fmt: skip
    return norm


def _draw_boundaries(pen: Space, run: MissionRun, leg: LegRecord, times: list[float]) -> list[str]:
    """Draw each obstacle at the last time, its track, and rings: its boundary at each; return their kinds."""
    kinds, circle = [], np.linspace(0.0, 2.0 * np.pi, 40)
    steps = [boundaries(run, leg, time) for time in times]
    for k, m in enumerate(scene.near_obstacles(leg)):
        track = np.stack([places[k] for places, _ in steps])
        if not ((track[-1, :2] > pen.low) & (track[-1, :2] < pen.high)).all():
            continue
        kinds.append(leg.obstacle_kinds[m])
        colour = style.KIND_COLOURS.get(kinds[-1], style.GREY)
        pen.sphere(track[-1], float(leg.obstacle_radii[m]), kinds[-1], 10, zorder=2)
        pen.line(track, color=colour, lw=1.0, zorder=2)
        for number, (place, (_, radii)) in enumerate(zip(track, steps, strict=True), 1):
            around = np.stack([np.sin(circle), np.cos(circle), np.zeros(len(circle))], axis=1)
            kind = {"color": colour, "lw": 1.1, "alpha": 0.3 + 0.7 * number / len(steps)}
            pen.line(place + radii[k] * around, zorder=3, **kind)
    return kinds


def plot_windows(run: MissionRun) -> Figure:
    """Draw the first path of a run of one leg and every later one that was followed, on one map.

    Obstacles are drawn where they truly were at each re-plan, the later the darker, within the boundary that
    had grown around them since the vehicle last saw them; the errors of measurement, which widen it further,
    are left out.
    """
    leg = leg_of(run)
    plans = leg.followed_plans
    low, high = scene.window(scene.extent_points(leg), 0.06, run.chart)
    tall, wide = high - low
    figure = style.new_figure(8.6, float(np.clip(7.6 * tall / wide, 4.0, 10.0)) + 1.4)
    pen = Map(figure.subplots(), low, high)
    pen.coast(run.coast)
    pen.closures(run)
    kinds = [leg.obstacle_kinds[m] for m in scene.near_obstacles(leg)]
    for number, plan in enumerate(plans, 1):
        strength = 0.25 + 0.6 * number / len(plans)
        places, radii = boundaries(run, leg, plan.made_at)
        for place, radius, m in zip(places, radii, scene.near_obstacles(leg), strict=True):
            colour = style.KIND_COLOURS.get(leg.obstacle_kinds[m], style.GREY)
            pen.disc(place, leg.obstacle_radii[m], fc=colour, alpha=strength, lw=0, zorder=2)
            pen.disc(place, radius, fill=False, ec=colour, alpha=strength, lw=1.1, zorder=2)
    pen.handles += style.obstacle_patches(kinds, ", later darker", alpha=0.7)
    lines: dict[str, dict[str, Any]] = {
        "first path": {"ls": "--", "lw": 1.4, "zorder": 4},
        "re-planned": {"lw": 2.8, "zorder": 5},
        "given up at the next re-plan": {"ls": ":", "lw": 1.2, "zorder": 3},
    }
    first, followed, dropped = (
        kind | {"color": "black", "path_effects": style.halo(kind["lw"] + 1.4)} for kind in lines.values()
    )
    pen.line(plans[0].positions, **first)
    for number, plan in enumerate(plans[1:], start=1):
        executed, given_up = until_next(plans, number)
        pen.line(given_up, **dropped)
        pen.line(executed, **followed)
        pen.dots(plan.positions[0], **(style.VEHICLE | {"zorder": 7}))
    pen.dots(plans[0].positions[0], **(style.START | {"zorder": 6}))
    pen.dots(plans[0].positions[-1], **(style.GOAL | {"zorder": 6}))
    pen.handles += [style.line(label, color="black", **kind) for label, kind in lines.items()]
    style.legend_below(figure, pen.handles + style.marks(vehicle="vehicle at a re-plan"))
    causes = [plan.cause for plan in plans[1:]]
    count = ", ".join(f"{causes.count(cause)} by {cause}" for cause in dict.fromkeys(causes)) or "none"
    name = run.scenario.get("name") or "leg"
    pen.axes.set_title(f"{name}, seed {run.seed}: re-plans {count}; {leg.t_path:,.0f} s", fontsize=11)
    texts = [f"{plan.made_at:,.0f} s" for plan in plans[1:]]
    where = [plan.positions[0] for plan in plans[1:]]
    kind: dict[str, Any] = {"fontsize": 8, "color": style.RED, "weight": "bold", "zorder": 8}
    pen.labels(where, texts, plans[0].positions[[0, -1]], **kind)
    return figure


def until_next(plans: Sequence[PlanRecord], index: int) -> tuple[Array, Array]:
    """Split a followed plan at the next re-plan: the part executed and the part given up, [n, 3] m each."""
    positions = plans[index].positions
    if index + 1 == len(plans):
        return positions, positions[:0]
    end = plans[index + 1].positions[0]
    last = int(np.argmin(np.linalg.norm(positions - end, axis=1)))
    return (np.concatenate([positions[:last], end[None]]), np.concatenate([end[None], positions[last + 1 :]]))


def boundaries(run: MissionRun, leg: LegRecord, time: float) -> tuple[Array, Array]:
    """Return where `near_obstacles` truly are at a time, [M, 3] m, and their radii as grown by then, [M] m.

    Known ones do not grow; the errors of measurement, which widen boundaries further, are left out.
    """
    near, shown = scene.near_obstacles(leg), scene.shown_obstacles(leg)
    grew = scene.grown(run, leg, np.array([time]), errors=False)[0] if shown else ()
    growth = dict(zip(shown, grew, strict=True))
    places = [scene.track_at(leg, leg.obstacle_positions[:, m], time) for m in near]
    radii = [leg.obstacle_radii[m] + growth.get(m, 0.0) for m in near]
    return np.reshape(places, (-1, 3)), np.asarray(radii, float)


def plot_populations(legs: xr.Dataset, met: style.Array, least: float) -> Figure:
    """Cost and violation of the population by iteration, a column for each scenario (Fig. 11).

    Lines are means over the seeds of the population's mean, error bars those of its standard deviation.

    Args:
        legs: `cost_mean`, `cost_std`, `violation_mean` and `violation_std` over scenario, seed and iteration.
        met: [scenarios, seeds] bool, whether the mean violation fell below `least`.
        least: mean violation that counts as none.
    """
    names = legs["scenario"].values
    figure = style.new_figure(4.3 * len(names) + 0.6, 6.8)
    grid = figure.subplots(2, len(names), sharex=True, squeeze=False)
    for column, name in enumerate(names):
        one = legs.sel(scenario=name)
        for axes, key, label in zip(grid[:, column], ("cost", "violation"), LABELS, strict=True):
            each = one[f"{key}_mean"].values
            mean, spread = each.mean(axis=0), one[f"{key}_std"].values.mean(axis=0)
            at = np.arange(len(mean))
            draw_errors(axes, at, mean, spread, BARS, "standard deviation over the population")
            lines = axes.plot(at, each.T, color=style.ORANGE, lw=0.7, zorder=3)
            lines[0].set_label("mean of one seed")
            axes.plot(at, mean, color="black", lw=1.8, zorder=4, label="mean")
            dress(axes, np.concatenate([mean, mean + spread]))
            axes.set_ylabel(label if column == 0 else "")
        if least > 0.0:
            grid[1, column].axhline(least, color=style.GREY, ls="--", lw=1.0, label=f"{least:g}")
        share = 100.0 * float(np.mean(met[column]))
        grid[0, column].set_title(str(name), fontsize=10)
        below = f"mean violation below {least:g}: {share:.0f} % of {met.shape[1]} seeds"
        grid[1, column].set_title(below, fontsize=9)
        grid[1, column].set_xlabel("iteration [-]")
    style.legend_below(figure, ncols=3)
    figure.suptitle("First plans of a leg: cost and violation of the population by iteration", fontsize=11)
    return figure


def plot_call_times(dataset: xr.Dataset, calls: xr.Dataset, interval: float) -> Figure:
    """Single path planning calls in one thread beside all planning of a mission (Fig. 14).

    Args:
        dataset: without a sweep, missions in order of seed.
        calls: `first_cpu` and `window_cpu` [mission] s, CPU time of single calls in one thread, by `seed`.
        interval: s between two measurements by the vehicle's sensors.
    """
    figure = style.new_figure(11.6, 5.6)
    left, right = figure.subplots(1, 2, width_ratios=[3.2, 1], sharey=True)
    place, whole = np.arange(dataset.sizes["mission"]), np.nan_to_num(statistics.planning_time(dataset))
    at = np.searchsorted(dataset["seed"].values, calls["seed"].values)
    shown = (
        (place, whole, "s", style.RED, "all planning of the mission, wall-clock time"),
        (at, calls["first_cpu"].values, "o", style.BLUE, "one path call, a leg, CPU time in one thread"),
        (at, calls["window_cpu"].values, "^", style.GREEN, "one path call, a re-plan, the same"),
    )
    for x, values, marker, colour, label in shown:
        left.plot(x, values, ls="none", marker=marker, ms=mark_size(len(x)), color=colour, label=label)
    right.boxplot(
        [values for _, values, *_ in shown], widths=0.6, whis=(5, 95), patch_artist=True,
        boxprops={"facecolor": "#dddddd"}, medianprops={"color": "black"},
    )  # fmt: skip
    medians = [float(np.median(values)) for _, values, *_ in shown]
    names = ("mission", "leg", "re-plan")
    right.set_xticklabels([f"{name}\n{value:.2g} s" for name, value in zip(names, medians, strict=True)])
    right.set_title("box: quartiles; whiskers: 5-95 %\nbelow: medians", fontsize=9)
    for axes in (left, right):
        axes.axhline(interval, color=style.GREY, ls="--", lw=1.3, label=f"between two looks, {interval:g} s")
        axes.set_yscale("log")
        style.grid(axes, which="both", axis="y")
    left.set_ylabel("time of planning [s]")
    mission_axis(left, dataset)
    style.legend_below(figure, ncols=2)
    share = 100.0 * medians[1] / medians[0]
    set_title(figure, dataset, f"a path call takes {share:.2g} % of a mission's planning (medians)")
    return figure
