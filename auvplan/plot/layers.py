"""A leg in three dimensions with a layer of current for every update (Fig. 9)."""

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from auvplan.plot import style
from auvplan.plot.legs import busiest_leg, current_at, extent_points, until_next
from auvplan.plot.windows import boundaries
from auvplan.records import LegRecord, MissionRun, PlanRecord

#: Points along each edge of a layer: of its colours and of its arrows.
_FINE, _ARROWS = 50, 8
#: Height of the box beside its horizontal edges.
_HEIGHT = 0.75


def plot_layers(run: MissionRun, leg: LegRecord | None = None) -> Figure:
    """Draw a leg's paths among its obstacles, with the current of every time step in a layer of its own.

    Obstacles are drawn where they truly were at the last step, with their tracks; the rings are their
    boundaries at each step, which grow until the vehicle sees them again.

    Args:
        run: as executed.
        leg: that of `busiest_leg` where not given.
    """
    leg = leg or busiest_leg(run)
    if leg is None:
        return style.empty_figure("no path was planned")
    plans = leg.followed_plans
    figure = style.new_figure(9.6, 7.4)
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    low, high = style.frame_of(extent_points(leg), margin=0.04)
    depths = extent_points(leg)[:, 2]
    top, bottom = float(min(depths.min(), 0.0)), float(depths.max()) * 1.1 + 10.0
    unit = style.Unit.for_extent(float((high - low).max()))
    speeds = _draw_currents(axes, plans, low, high, np.linspace(top, bottom, len(plans) + 2)[1:-1], unit)

    def inside(place: style.Array) -> bool:
        return bool((place[:2] > low).all() and (place[:2] < high).all())

    kinds = _draw_obstacles(axes, run, leg, [plan.made_at for plan in plans], unit, inside)
    style.line_in_space(axes, plans[0].positions, unit, color=style.RED, ls="--", lw=1.5, zorder=4)
    for number in range(1, len(plans)):
        executed, given_up = until_next(plans, number)
        style.line_in_space(axes, given_up, unit, color="black", ls=":", lw=1.1, zorder=4)
        style.line_in_space(axes, executed, unit, color="black", lw=2.8, zorder=4)
    style.draw_ends_in_space(axes, plans, unit)
    style.set_up_space(axes, low, high, (top, bottom), _HEIGHT, unit, pad=8)
    axes.view_init(elev=24, azim=-62)
    bar = figure.colorbar(ScalarMappable(speeds, "cividis"), ax=axes, shrink=0.55, pad=0.08)
    bar.set_label("current [m/s]")
    figure.legend(handles=_legend(kinds), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    times = ", ".join(f"{plan.made_at:,.0f}" for plan in plans)
    stretch = _HEIGHT * float((high - low)[0]) / (bottom - top)
    name = run.scenario.get("name") or "leg"
    figure.suptitle(
        f"{name}, seed {run.seed}: layers of the current at {times} s, the first on top\n"
        f"vertical exaggeration {stretch:.1f}; obstacles are stretched with it",
        fontsize=11,
    )
    return figure


def _draw_currents(
    axes: Any,
    plans: list[PlanRecord],
    low: style.Array,
    high: style.Array,
    depths: style.Array,
    unit: style.Unit,
) -> Normalize:
    """Draw a plane for each plan, coloured by speed, with arrows."""
    planes = [_plane(plan, low, high, float(z), _FINE) for plan, z in zip(plans, depths, strict=True)]
    fastest = max(float(np.quantile([np.hypot(u, v) for *_, u, v in planes], 0.995)), 1e-3)
    norm = Normalize(0.0, fastest)
    levels = np.linspace(0.0, fastest, 12)
    reach = 0.8 * float((high - low)[0]) / _ARROWS / fastest / unit.metres
    for plan, (north, east, u, v), depth in zip(plans, planes, depths, strict=True):
        axes.contourf(
            east / unit.metres, north / unit.metres, np.minimum(np.hypot(u, v), fastest), levels, zdir="z",
            offset=depth, cmap="cividis", norm=norm, alpha=0.3, antialiased=False, zorder=0,
        )  # fmt: skip
        north, east, u, v = (part.ravel() for part in _plane(plan, low, high, float(depth), _ARROWS))
        axes.quiver(
            east / unit.metres, north / unit.metres, np.full(len(u), depth), v * reach, u * reach, 0.0 * u,
            color="#444444", lw=0.6, arrow_length_ratio=0.25, zorder=1,
        )  # fmt: skip
    return norm


def _plane(
    plan: PlanRecord, low: style.Array, high: style.Array, depth: float, count: int
) -> tuple[style.Array, ...]:
    """North and east [m], and the current's north and east components [m/s], [count, count] each."""
    edges = [np.linspace(low[k], high[k], 2 * count + 1)[1::2] for k in range(2)]
    north, east = np.meshgrid(*edges, indexing="ij")
    u, v, _ = current_at(plan, north, east, depth)
    return north, east, u, v


def _draw_obstacles(
    axes: Any, run: MissionRun, leg: LegRecord, times: list[float], unit: style.Unit, inside: Any
) -> dict[str, str]:
    """Draw each obstacle as a sphere where the leg ends, its track, and rings: its boundary at each time."""
    kinds: dict[str, str] = {}
    around, up = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 21), np.linspace(0.0, np.pi, 11))
    circle = np.linspace(0.0, 2.0 * np.pi, 40)
    steps = [boundaries(run, leg, time) for time in times]
    for k, (radius, kind) in enumerate(zip(leg.obstacle_radii, leg.obstacle_kinds, strict=True)):
        track = np.stack([places[k] for places, _ in steps])
        if not inside(track[-1]):
            continue
        colour = kinds[kind] = style.KIND_COLOURS.get(kind, style.GREY)
        north, east, depth = track[-1]
        axes.plot_surface(
            (east + radius * np.cos(around) * np.sin(up)) / unit.metres,
            (north + radius * np.sin(around) * np.sin(up)) / unit.metres,
            depth + radius * np.cos(up), color=colour, alpha=0.45, lw=0, zorder=2,
        )  # fmt: skip
        style.line_in_space(axes, track, unit, color=colour, lw=1.0, zorder=2)
        for number, (places, grown) in enumerate(steps):
            north, east, depth = places[k]
            axes.plot(
                (east + grown[k] * np.cos(circle)) / unit.metres,
                (north + grown[k] * np.sin(circle)) / unit.metres,
                depth, color=colour, lw=1.1, alpha=0.3 + 0.7 * (number + 1) / len(steps), zorder=3,
            )  # fmt: skip
    return kinds


def _legend(kinds: dict[str, str]) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=style.RED, ls="--", lw=1.5, label="first path"),
        Line2D([], [], color="black", lw=2.8, label="planned anew"),
        Line2D([], [], color="black", ls=":", lw=1.1, label="given up at the next re-plan"),
    ]
    for kind, size, label in (
        (style.START, 8, "start"), (style.VEHICLE, 7, "vehicle at a re-plan"), (style.GOAL, 12, "target"),
    ):  # fmt: skip
        handles.append(
            Line2D(
                [], [], ls="", marker=kind["marker"], ms=size, color=kind["color"], mec="black", label=label
            )
        )
    handles += [
        Patch(facecolor=colour, alpha=0.6, label=f"{kind} obstacle, boundaries as rings")
        for kind, colour in kinds.items()
    ]
    return handles
