"""A leg on one map: coast, obstacles at every window, the path as planned and planned anew (Fig. 10)."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from auvplan.plot import style
from auvplan.plot.legs import busiest_leg, extent_points, until_next
from auvplan.records import LegRecord, MissionRun


def plot_windows(run: MissionRun, leg: LegRecord | None = None) -> Figure:
    """Draw the first path of a leg and every later one that was followed, on one map.

    Obstacles are drawn where they truly were at each re-plan, within the boundary that had grown around them
    since the vehicle last saw them; the errors of measurement, which widen it further, are left out.

    Args:
        run: as executed.
        leg: that of `busiest_leg` where not given.
    """
    leg = leg or busiest_leg(run)
    if leg is None:
        return style.empty_figure("no path was planned")
    plans = leg.followed_plans
    low, high = style.frame_on_chart(extent_points(leg), run.chart, margin=0.06)
    unit = style.Unit.for_extent(float((high - low).max()))
    tall, wide = high - low
    figure = style.new_figure(8.6, float(np.clip(7.6 * tall / wide, 4.0, 10.0)) + 1.4)
    axes = figure.subplots()
    style.map_axes(axes, low, high, unit)
    handles: list[Any] = [*style.draw_coast(axes, run.coast, unit), *style.draw_closures(axes, run, unit)]
    handles += _draw_obstacles(axes, run, leg, [plan.made_at for plan in plans], unit)
    for number, plan in enumerate(plans):
        if number == 0:
            _line(axes, plan.positions, unit, lw=1.4, ls="--", zorder=4)
            continue
        executed, given_up = until_next(plans, number)
        _line(axes, given_up, unit, lw=1.2, ls=":", zorder=3)
        _line(axes, executed, unit, lw=2.8, zorder=5)
        axes.scatter(*(plan.positions[0, [1, 0]] / unit.metres), **(style.VEHICLE | {"zorder": 7}))
    ends = plans[0].positions[[0, -1]][:, [1, 0]] / unit.metres
    axes.scatter(*ends[0], **(style.START | {"zorder": 6}))
    axes.scatter(*ends[1], **(style.GOAL | {"zorder": 6}))
    handles += [
        Line2D([], [], color="black", ls="--", lw=1.4, label="first path"),
        Line2D([], [], color="black", lw=2.8, label="planned anew"),
        Line2D([], [], color="black", ls=":", lw=1.2, label="given up at the next re-plan"),
    ]
    for kind, size, label in (
        (style.START, 8, "start"),
        (style.VEHICLE, 7, "vehicle at a re-plan"),
        (style.GOAL, 12, "target"),
    ):
        mark: dict[str, Any] = {"ls": "", "marker": kind["marker"], "color": kind["color"], "mec": "black"}
        handles.append(Line2D([], [], ms=size, label=label, **mark))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    causes = [plan.cause for plan in plans[1:]]
    count = ", ".join(f"{causes.count(cause)} by {cause}" for cause in dict.fromkeys(causes)) or "none"
    name = run.scenario.get("name") or "leg"
    axes.set_title(f"{name}, seed {run.seed}: re-plans {count}; {leg.t_path:,.0f} s", fontsize=11)
    if len(plans) > 1:
        places = np.stack([plan.positions[0, [1, 0]] / unit.metres for plan in plans[1:]])
        texts = [f"{plan.made_at:,.0f} s" for plan in plans[1:]]
        style.place_labels(axes, places, texts, ends, fontsize=8, color=style.RED, weight="bold", zorder=8)
    return figure


def _line(axes: Axes, positions: style.Array, unit: style.Unit, **kind: Any) -> None:
    flat = positions[:, [1, 0]] / unit.metres
    axes.plot(*flat.T, color="black", path_effects=style.halo(kind["lw"] + 1.4), **kind)


def boundaries(run: MissionRun, leg: LegRecord, time: float) -> tuple[style.Array, style.Array]:
    """Where the obstacles of a leg truly were at a time, and their radii grown since they were last seen.

    Returns:
        [M, 3] m and [M] m. The vehicle looks at those within sensor range every `sensors.interval`; before
        its first look they count as seen when the leg began.
    """
    sensors = run.scenario["sensors"]
    tracks = np.asarray(leg.obstacle_positions, float)
    if not len(leg.times) or not tracks.size:
        return np.zeros((0, 3)), np.zeros(0)
    now = int(np.searchsorted(leg.times, time + 1e-6) - 1)
    looks = np.arange(leg.times[0] + sensors["interval"], time + 1e-6, sensors["interval"])
    when = np.clip(np.searchsorted(leg.times, looks), 0, len(leg.times) - 1)
    away = np.linalg.norm(tracks[when] - leg.positions[when, None], axis=2) - leg.obstacle_radii
    seen = np.where(away <= sensors["range"], leg.times[when, None], leg.times[0])
    last = seen.max(axis=0, initial=float(leg.times[0]))
    grown = np.minimum(sensors["growth"] * np.maximum(time - last, 0.0), sensors["growth_max"])
    return tracks[max(now, 0)], leg.obstacle_radii + grown


def _draw_obstacles(
    axes: Axes, run: MissionRun, leg: LegRecord, times: list[float], unit: style.Unit
) -> list[Any]:
    """Draw a disk for each obstacle at each time, the later the darker; return legend handles."""
    kinds: dict[str, str] = {}
    for number, time in enumerate(times):
        places, radii = boundaries(run, leg, time)
        strength = 0.25 + 0.6 * (number + 1) / len(times)
        for place, radius, true, kind in zip(
            places, radii, leg.obstacle_radii, leg.obstacle_kinds, strict=False
        ):
            colour = kinds[kind] = style.KIND_COLOURS.get(kind, style.GREY)
            at = (place[1] / unit.metres, place[0] / unit.metres)
            axes.add_patch(Circle(at, true / unit.metres, fc=colour, alpha=strength, lw=0, zorder=2))
            axes.add_patch(
                Circle(at, radius / unit.metres, fill=False, ec=colour, alpha=strength, lw=1.1, zorder=2)
            )
    return [
        Patch(facecolor=colour, alpha=0.7, label=f"{kind} obstacle, later darker")
        for kind, colour in kinds.items()
    ]
