"""A leg among its obstacles in three dimensions (Fig. 9)."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from auvplan.plot import style
from auvplan.plot.legs import busiest_leg, extent_points, leg_title
from auvplan.records import LegRecord, MissionRun

#: Height of the box beside its longer horizontal edge.
_HEIGHT = 0.5
#: Depths are drawn at most so many times as large as the horizontal.
_STRETCH = 3.0
#: Obstacles farther than this many times the frame's edge are left out.
_FAR = 0.6


def plot_obstacles(run: MissionRun, leg: LegRecord | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw the track and earlier paths, and each obstacle where it was when the vehicle came nearest.

    Args:
        run: as executed.
        leg: that of `busiest_leg` where not given.
        ax: three-dimensional axes to draw in; those of a new figure if absent.

    Returns:
        The axes.

    Raises:
        ValueError: the axes given are flat.
    """
    leg = leg or busiest_leg(run)
    if leg is None:
        return style.say_why(ax, "no path was planned")
    if ax is not None and ax.name != "3d":
        raise ValueError('ax must be three-dimensional: figure.add_subplot(projection="3d")')
    axes: Any = style.own_axes(ax, 8.4, 6.4, projection="3d", computed_zorder=False)
    low, high = style.frame_of(extent_points(leg), margin=0.1)
    unit = style.Unit.for_extent(float((high - low).max()))
    tracks, nearest = _nearest(leg)
    edge = float((high - low).max())
    middle = 0.5 * (low + high)
    seen = [k for k in range(len(nearest)) if np.abs(nearest[k, :2] - middle).max() < _FAR * edge]
    depths = [extent_points(leg)[:, 2]]
    depths += [nearest[k, 2] + leg.obstacle_radii[k] * np.array([-1.0, 1.0]) for k in seen]
    top, bottom = min(d.min() for d in depths), max(d.max() for d in depths)
    top, bottom = top - 0.1 * (bottom - top) - 5.0, bottom + 0.1 * (bottom - top) + 5.0
    # Room above and below keeps the spheres from being drawn out beyond recognition.
    missing = max(_HEIGHT * edge / _STRETCH - (bottom - top), 0.0)
    above = min(0.5 * missing, max(top + 5.0, 0.0))
    top, bottom = top - above, bottom + missing - above
    for k in seen:
        _sphere(axes, nearest[k], float(leg.obstacle_radii[k]), leg.obstacle_kinds[k], unit)
        near = np.abs(tracks[:, k, :2] - middle).max(axis=1) < _FAR * edge
        style.line_in_space(
            axes, tracks[near, k], unit, color=_colour(leg.obstacle_kinds[k]), lw=1.2, zorder=2
        )
    for plan in leg.plans[:-1]:
        style.line_in_space(axes, plan.positions, unit, color=style.RED, ls="--", lw=1.2, zorder=3)
    # A leg that was refused was never executed: its plan is shown.
    style.line_in_space(
        axes,
        leg.positions if len(leg.positions) else leg.plans[-1].positions,
        unit,
        color="black",
        lw=2.6,
        zorder=4,
    )
    style.draw_ends_in_space(axes, leg.plans, unit)
    style.set_up_space(axes, low, high, (top, bottom), _HEIGHT, unit, pad=6)
    axes.view_init(elev=28, azim=-60)
    style.add_legend(axes, _legend(leg, seen), ax)
    hidden = len(leg.obstacle_radii) - len(seen)
    note = f", {hidden} of {len(leg.obstacle_radii)} obstacles out of view" if hidden and len(nearest) else ""
    stretch = _HEIGHT * edge / (bottom - top)
    (axes.figure.suptitle if ax is None else axes.set_title)(
        f"Closest points of approach, {leg_title(run, leg)}\nvertical exaggeration {stretch:.1f}{note}",
        fontsize=11,
    )
    return axes


def _nearest(leg: LegRecord) -> tuple[style.Array, style.Array]:
    """True tracks [n, M, 3] m, and places [M, 3] m at the time of least distance to the vehicle."""
    tracks = np.asarray(leg.obstacle_positions, float)
    if not len(leg.times) or not tracks.size:
        return np.zeros((0, 0, 3)), np.zeros((0, 3))
    when = np.linalg.norm(tracks - leg.positions[:, None], axis=2).argmin(axis=0)
    return tracks, tracks[when, np.arange(tracks.shape[1])]


def _colour(kind: str) -> str:
    return style.KIND_COLOURS.get(kind, style.GREY)


def _sphere(axes: Any, centre: style.Array, radius: float, kind: str, unit: style.Unit) -> None:
    around, up = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 25), np.linspace(0.0, np.pi, 13))
    east = centre[1] + radius * np.cos(around) * np.sin(up)
    north = centre[0] + radius * np.sin(around) * np.sin(up)
    axes.plot_surface(
        east / unit.metres, north / unit.metres, centre[2] + radius * np.cos(up),
        color=_colour(kind), alpha=0.45, linewidth=0.0, zorder=1,
    )  # fmt: skip


def _legend(leg: LegRecord, seen: list[int]) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D(
            [], [], color="black", lw=2.6, label="executed" if len(leg.positions) else "planned, not executed"
        ),
    ]
    if len(leg.plans) > 1:
        handles.append(Line2D([], [], color=style.RED, ls="--", lw=1.2, label="earlier plans"))
    for label, kind, size in (
        ("start", style.START, 8),
        ("target", style.GOAL, 12),
        ("re-plan", style.VEHICLE, 7),
    ):
        if label != "re-plan" or len(leg.plans) > 1:
            handles.append(
                Line2D(
                    [],
                    [],
                    ls="",
                    marker=kind["marker"],
                    ms=size,
                    color=kind["color"],
                    mec="black",
                    label=label,
                )
            )
    for kind in dict.fromkeys(leg.obstacle_kinds[k] for k in seen):
        handles.append(Patch(facecolor=_colour(kind), alpha=0.6, label=f"{kind} obstacle and its track"))
    return handles
