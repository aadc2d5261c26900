"""A leg among its obstacles in three dimensions (Fig. 9)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from auvplan.plot import style
from auvplan.plot.maps import unit_of
from auvplan.plot.style import Array
from auvplan.records import LegRecord, MissionRun, PlanRecord
from auvplan.view import scene

#: Obstacles farther than this many times the frame's edge are left out.
_FAR = 0.6
#: Height of the box beside its horizontal edges, and greatest vertical exaggeration.
_HEIGHT, _STRETCH = 0.5, 3.0


class Space:
    """Three-dimensional axes, east, north and depth downwards, and the pen that draws in them.

    Places are [..., 3] m north, east, depth.
    """

    def __init__(self, axes: Any, low: Array, high: Array) -> None:
        """Draw in axes what is between two corners, [2] m north and east."""
        self.axes, self.low, self.high = axes, low, high
        self.name, self.metres = unit_of(float((high - low).max()))

    def line(self, positions: Array, **kind: Any) -> None:
        """Draw a line through places [n, 3]."""
        self.axes.plot(positions[:, 1] / self.metres, positions[:, 0] / self.metres, positions[:, 2], **kind)

    def sphere(self, centre: Array, radius: float, kind: str, parts: int, **more: Any) -> None:
        """Draw an obstacle of a kind, in `parts` bands from the top to the bottom."""
        around, up = np.meshgrid(
            np.linspace(0.0, 2.0 * np.pi, 2 * parts + 1), np.linspace(0.0, np.pi, parts + 1)
        )
        east = centre[1] + radius * np.cos(around) * np.sin(up)
        north = centre[0] + radius * np.sin(around) * np.sin(up)
        colour = style.KIND_COLOURS.get(kind, style.GREY)
        deep = centre[2] + radius * np.cos(up)
        more = {"color": colour, "alpha": 0.45, "lw": 0} | more
        self.axes.plot_surface(east / self.metres, north / self.metres, deep, **more)

    def finish(
        self, plans: Sequence[PlanRecord], depths: tuple[float, float], height: float, pad: float
    ) -> None:
        """Mark the ends of the first plan and where each later one begins; set limits and labels.

        Args:
            plans: of the leg, at least one.
            depths: m, at the top and at the bottom.
            height: of the box beside its horizontal edges.
            pad: points between a horizontal axis and its label.
        """
        marks = [(plans[0].positions[0], style.START), (plans[0].positions[-1], style.GOAL)]
        marks += [(plan.positions[0], style.VEHICLE) for plan in plans[1:]]
        for (north, east, depth), kind in marks:
            place = east / self.metres, north / self.metres, depth
            self.axes.scatter(*place, zorder=5, depthshade=False, **kind)
        self.axes.set_xlim(self.low[1] / self.metres, self.high[1] / self.metres)
        self.axes.set_ylim(self.low[0] / self.metres, self.high[0] / self.metres)
        self.axes.set_zlim(depths[1], depths[0])
        self.axes.set_box_aspect((1.0, 1.0, height), zoom=1.12)
        self.axes.set_xlabel(f"east [{self.name}]", labelpad=pad)
        self.axes.set_ylabel(f"north [{self.name}]", labelpad=pad)
        self.axes.set_zlabel("depth [m]", labelpad=pad - 2)
        self.axes.tick_params(labelsize=8)


def plot_obstacles(run: MissionRun, leg: LegRecord | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw the track and earlier paths, and each obstacle where it was when the vehicle came nearest.

    Args:
        run: as executed.
        leg: that of `busiest_leg` where not given.
        ax: three-dimensional axes to draw in; those of a new figure if absent.

    Raises:
        ValueError: the axes given are flat.
    """
    leg = leg or scene.busiest_leg(run)
    if leg is None:
        return style.annotate_empty(ax, "no path was planned")
    if ax is not None and ax.name != "3d":
        raise ValueError('ax must be three-dimensional: figure.add_subplot(projection="3d")')
    axes: Any = style.own_axes(ax, 8.4, 6.4, projection="3d", computed_zorder=False)
    low, high = scene.window(scene.extent_points(leg), 0.1)
    pen, kinds = Space(axes, low, high), leg.obstacle_kinds
    # True tracks, and places at the time of least distance to the vehicle.
    tracks, nearest = np.zeros((0, 0, 3)), np.zeros((0, 3))
    if len(leg.times) and leg.obstacle_positions.size:
        tracks = np.asarray(leg.obstacle_positions, float)
        when = np.linalg.norm(tracks - leg.positions[:, None], axis=2).argmin(axis=0)
        nearest = tracks[when, np.arange(tracks.shape[1])]
    edge, middle = float((high - low).max()), 0.5 * (low + high)
    seen = [k for k in range(len(nearest)) if np.abs(nearest[k, :2] - middle).max() < _FAR * edge]
    depths = [scene.extent_points(leg)[:, 2]]
    depths += [nearest[k, 2] + leg.obstacle_radii[k] * np.array([-1.0, 1.0]) for k in seen]
    top, bottom = min(d.min() for d in depths), max(d.max() for d in depths)
    top, bottom = top - 0.1 * (bottom - top) - 5.0, bottom + 0.1 * (bottom - top) + 5.0
    # Room above and below keeps the spheres from being drawn out beyond recognition.
    missing = max(_HEIGHT * edge / _STRETCH - (bottom - top), 0.0)
    above = min(0.5 * missing, max(top + 5.0, 0.0))
    top, bottom = top - above, bottom + missing - above
    for k in seen:
        pen.sphere(nearest[k], float(leg.obstacle_radii[k]), kinds[k], 12, zorder=1)
        near = np.abs(tracks[:, k, :2] - middle).max(axis=1) < _FAR * edge
        colour = style.KIND_COLOURS.get(kinds[k], style.GREY)
        pen.line(tracks[near, k], color=colour, lw=1.2, zorder=2)
    for plan in leg.plans[:-1]:
        pen.line(plan.positions, color=style.RED, ls="--", lw=1.2, zorder=3)
    # A leg that was refused was never executed: its plan is shown.
    executed = len(leg.positions) > 0
    pen.line(leg.positions if executed else leg.plans[-1].positions, color="black", lw=2.6, zorder=4)
    pen.finish(leg.plans, (top, bottom), _HEIGHT, pad=6)
    axes.view_init(elev=28, azim=-60)
    track = "executed" if executed and run.simulated else "planned"
    track += "" if executed else ", not executed"
    handles: list[Any] = [style.line(track, color="black", lw=2.6)]
    if len(leg.plans) > 1:
        handles.append(style.line("earlier plans", color=style.RED, ls="--", lw=1.2))
    handles += [style.mark(style.START, "start"), style.mark(style.GOAL, "target")]
    if len(leg.plans) > 1:
        handles.append(style.mark(style.VEHICLE, "re-plan"))
    handles += style.obstacle_patches([kinds[k] for k in seen], " and its track", alpha=0.6)
    style.add_legend(axes, handles, ax)
    hidden = len(leg.obstacle_radii) - len(seen)
    note = f", {hidden} of {len(leg.obstacle_radii)} obstacles out of view" if hidden and len(nearest) else ""
    stretch = _HEIGHT * edge / (bottom - top)
    (axes.figure.suptitle if ax is None else axes.set_title)(
        f"Closest points of approach, {scene.leg_title(run, leg)}\nvertical exaggeration {stretch:.1f}{note}",
        fontsize=11,
    )
    return axes
