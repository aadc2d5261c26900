"""One planned path in the sea that it was planned for."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from auvplan.export.section import plan_section
from auvplan.ocean.environment import Environment
from auvplan.path.plan import PathPlan
from auvplan.plot import style
from auvplan.plot.currents import Field, speed_range
from auvplan.plot.depths import SECTION, add_section

#: Obstacles farther from the path than this many times the frame's edge are left out.
_FAR = 0.6


def plot_path(plan: PathPlan, *, ax: Axes | None = None) -> Axes:
    """Draw a path over the current at its departure, the coast, and obstacles where the path passes them.

    In a figure of its own the vertical section along the path is below, if anything differs with depth.

    Args:
        plan: feasible or not.
        ax: axes to draw in; those of a new figure if absent. In axes of a map with something in them the path
            alone is drawn over what is there.

    Returns:
        The axes of the map.

    Example:
        >>> import jax, auvplan as ap
        >>> from auvplan.plot import plot_path
        >>> env = ap.Environment(ap.UniformCurrent(0.0, 0.5), lower=(-500, -500, 0), upper=(2500, 1500, 0))
        >>> plan = ap.plan_path((0, 0, 0), (2000, 0, 0), env, key=jax.random.key(0))
        >>> plot_path(plan).get_xlabel()
        'east [m]'
    """
    if ax is not None and ax.has_data():
        metres = 1000.0 if "[km]" in ax.get_xlabel() else 1.0
        _draw_way(ax, plan, style.Unit("km" if metres > 1.0 else "m", metres))
        return ax
    world = plan.conditions.world()
    positions = np.asarray(plan.positions, float)
    low, high = style.frame_of(positions)
    unit = style.Unit.for_extent(float((high - low).max()))
    section = plan_section(plan) if ax is None else None
    axes = style.own_axes(ax, 7.4, 7.2 + (0.0 if section is None else SECTION))
    below = add_section(axes, [] if section is None else [section])
    style.map_axes(axes, low, high, unit)
    depth = float(positions[:, 2].mean())
    field = Field.of(world.current, low, high, depth, float(plan.times[0]))
    slowest, fastest, beyond = speed_range([field])
    image = field.draw(axes, unit, slowest, fastest)
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02, extend=beyond)
    bar.set_label(f"current at {depth:.0f} m depth, at departure [m/s]")
    handles: list[Any] = list(style.draw_coast(axes, world.chart, unit, see_through=True))
    handles += _draw_obstacles(axes, plan, world, unit)
    handles += _draw_way(axes, plan, unit)
    handles += [handle for name, handle in below.items() if name not in ("path", "obstacle")]
    style.add_legend(axes, handles, ax)
    broken = "" if plan.feasible else f"\nnot feasible: {', '.join(plan.broken())}"
    axes.set_title(f"{plan.travel_time:,.0f} s over {plan.length:,.0f} m{broken}", fontsize=11)
    return axes


def _draw_way(axes: Axes, plan: PathPlan, unit: style.Unit) -> list[Line2D]:
    """Draw the path and its ends; return legend handles."""
    places = np.asarray(plan.positions, float)
    lines = "-" if plan.feasible else "--"
    axes.plot(
        *style.flat(places, unit).T, color="black", ls=lines, lw=2.4, path_effects=style.halo(4.0), zorder=5
    )
    found = [Line2D([], [], color="black", ls=lines, lw=2.4, label="path")]
    for place, kind, label in ((places[0], style.START, "start"), (places[-1], style.GOAL, "goal")):
        found.append(style.draw_end(axes, place, kind, label, unit))
    return found


def _draw_obstacles(axes: Axes, plan: PathPlan, world: Environment, unit: style.Unit) -> list[Any]:
    """Obstacles and their collision boundaries when the path is nearest to them; returns legend handles."""
    known = np.flatnonzero(np.asarray(world.obstacles.active)) if len(world.obstacles) else np.zeros(0, int)
    if not known.size:
        return []
    moving = world.obstacles.resolved(world.current)
    positions, times = np.asarray(plan.positions, float), np.asarray(plan.times, float)
    since = times[:, None, None] - np.asarray(moving.observed_at)[:, None]
    tracks = np.asarray(moving.position) + since * np.asarray(moving.velocity)
    nearest = np.linalg.norm(tracks - positions[:, None], axis=2).argmin(axis=0)
    edge = float(np.ptp(axes.get_xlim())) * unit.metres
    middle = 0.5 * (positions[:, :2].min(axis=0) + positions[:, :2].max(axis=0))
    shown = 0
    for m in known:
        place = tracks[nearest[m], m, :2]
        if np.abs(place - middle).max() > _FAR * edge:
            continue
        shown += 1
        at = (place[1] / unit.metres, place[0] / unit.metres)
        bound = float(moving.boundary(jnp.asarray(times[nearest[m]]))[m]) / unit.metres
        solid = float(moving.radius[m]) / unit.metres
        axes.add_patch(Circle(at, solid, fc=style.ORANGE, ec="black", lw=0.6, alpha=0.85, zorder=3))
        axes.add_patch(Circle(at, bound, fill=False, ec=style.ORANGE, lw=1.4, ls="--", zorder=3))
    hidden = len(known) - shown
    note = f" ({hidden} out of view)" if hidden else ""
    return [
        Patch(facecolor=style.ORANGE, edgecolor="black", label=f"obstacle when passed{note}"),
        Line2D([], [], color=style.ORANGE, ls="--", lw=1.4, label="its collision boundary"),
    ]
