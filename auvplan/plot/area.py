"""The map of a scenario before anything is planned: what its files contain, in layers."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch, Rectangle
from matplotlib.path import Path as Outline

from auvplan.ocean.currents import evaluated
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.plot import style
from auvplan.plot.maps import Map
from auvplan.runtime.formatting import counted
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.site import at_time

#: Arrows of the current along the longer side.
_ARROWS = 22


def plot_area(scenario: Scenario, area: OperatingArea, closed: Sequence[Any] = ()) -> Figure:
    """Return the map of a scenario.

    Chart, sea bed, closed areas, area, start, goal, jobs, current at departure.

    Args:
        scenario: whose fields are sound.
        area: as far as they could be read; the chart without closed areas.
        closed: areas with a name and a shapely polygon in local (north, east), m.
    """
    low, high = (np.asarray(corner, float)[:2] for corner in scenario.box)
    points = np.concatenate([[low, high], *_ends(scenario), *(place for _, place in _jobs(area))])
    bottom, top = points.min(axis=0), points.max(axis=0)
    # Places far off, which are at fault, must not shrink the rest to a dot.
    edge = high - low
    bottom, top = np.maximum(bottom, low - edge), np.minimum(top, high + edge)
    margin = 0.04 * float((top - bottom).max())
    bottom, top = bottom - margin, top + margin
    tall, wide = top - bottom
    figure = style.new_figure(9.4, float(np.clip(8.6 * tall / wide, 4.0, 11.0)) + 1.3)
    pen = Map(figure.subplots(), bottom, top)
    pen.coast(area.chart)
    pen.depths(area.seabed)
    for polygon in (part for zone in closed for part in getattr(zone.polygon, "geoms", [zone.polygon])):
        rings = (polygon.exterior, *polygon.interiors)
        outlines = (Outline(pen.flat(ring.coords), closed=True) for ring in rings)
        pen.axes.add_patch(PathPatch(Outline.make_compound_path(*outlines), zorder=1.0, **style.CLOSED))
    if closed:
        pen.handles.append(Patch(label="closed area", **style.CLOSED))
    pen.known(area.obstacles, scenario.mission.time_available, zorder=2)
    _draw_current(pen, scenario, area)
    corner, size = pen.flat(low), pen.flat(edge)
    dashed: dict[str, Any] = {"lw": 1.2, "ls": (0, (6, 3))}
    pen.axes.add_patch(Rectangle(tuple(corner), *size, fill=False, ec="black", zorder=3, **dashed))
    pen.handles.append(style.line("area", color="black", **dashed))
    _draw_jobs(pen, area)
    if scenario.mission.start is not None:
        pen.end(scenario.mission.start, style.START, "start")
    if scenario.mission.goal is not None:
        pen.end(scenario.mission.goal, style.GOAL, "destination")
    style.legend_below(figure, pen.handles)
    pen.title(_title(scenario, area), area.site)
    _draw_names(pen, scenario, area, closed)
    return figure


def _title(scenario: Scenario, area: OperatingArea) -> str:
    low, high = scenario.box
    depths = f"depths {low[2]:g} to {high[2]:g} m"
    tasks = ""
    if area.jobs is not None:
        numbers = (len(area.jobs.points), "point"), (len(area.jobs.lines), "survey line")
        tasks = " and ".join(counted(count, noun) for count, noun in numbers if count) + ", "
    return f"{scenario.name}: {tasks}{scenario.mission.time_available:,.0f} s, {depths}"


def _ends(scenario: Scenario) -> list[style.Array]:
    mission = scenario.mission
    return [np.asarray([end[:2]]) for end in (mission.start, mission.goal) if end is not None]


def _jobs(area: OperatingArea) -> list[tuple[str, style.Array]]:
    """Name and places [n, 2] m of each job."""
    if area.jobs is None:
        return []
    points = [(job.name, np.asarray([job.position[:2]])) for job in area.jobs.points]
    return points + [(job.name, np.asarray(job.positions)[:, :2]) for job in area.jobs.lines]


def _draw_current(pen: Map, scenario: Scenario, area: OperatingArea) -> None:
    """Arrows of the forecast at departure at the least depth, where there is water."""
    current = area.forecast
    if current is None:
        return
    low, high = (np.asarray(corner, float) for corner in scenario.box)
    step = float((high - low)[:2].max()) / _ARROWS
    north, east = (np.arange(low[k] + step / 2, high[k], step) for k in range(2))
    x, y = (axis.ravel() for axis in np.meshgrid(north, east, indexing="ij"))
    if area.chart is not None:
        wet = area.chart.is_water(x, y)
    elif isinstance(current, HarmonicCurrent):
        wet = np.ones(x.shape, bool)
    else:
        nodes = (
            np.rint((at - float(current.origin[k])) / float(current.spacing[k])).astype(int)
            for k, at in enumerate((x, y))
        )
        surface = np.asarray(current.water)[0]
        i, j = (np.clip(at, 0, size - 1) for at, size in zip(nodes, surface.shape, strict=True))
        wet = surface[i, j]
    x, y = x[wet], y[wet]
    if not len(x):
        return
    depth = np.full_like(x, low[2])
    u, v, _ = (np.asarray(part) for part in evaluated(current, x, y, depth, np.zeros_like(x)))
    fastest = max(float(np.hypot(u, v).max()), 1e-6)
    pen.axes.quiver(
        *(pen.flat(np.stack([x, y], axis=1)).T), v, u,
        color=style.BLUE, alpha=0.75, zorder=1.5, angles="xy", scale_units="xy",
        scale=fastest * pen.metres / step / 0.9, width=0.0022,
    )  # fmt: skip
    when = at_time(0.0, area.site.epoch if area.site else None)
    label = f"current {when} at {low[2]:g} m, up to {fastest:.2f} m/s"
    pen.handles.append(style.line(label, color=style.BLUE, ls="", marker=r"$\rightarrow$", ms=12))


def _draw_jobs(pen: Map, area: OperatingArea) -> None:
    jobs = area.jobs
    if jobs is None:
        return
    mark: dict[str, Any] = {"ls": "", "marker": "o", "ms": 6, "color": "white", "mec": style.PURPLE}
    mark["mew"] = 1.4
    if jobs.points:
        pen.axes.plot(*pen.flat([job.position for job in jobs.points]).T, zorder=5, **mark)
        pen.handles.append(style.line("job", **mark))
    for job in jobs.lines:
        pen.line(job.positions, color=style.PURPLE, lw=1.8, zorder=4.5, path_effects=style.halo(3.4))
    if jobs.lines:
        pen.handles.append(style.line("line to survey", color=style.PURPLE, lw=1.8))


def _draw_names(pen: Map, scenario: Scenario, area: OperatingArea, closed: Sequence[Any]) -> None:
    """Names of jobs and closed areas, where these are seen."""
    jobs = _jobs(area)
    named = [(obstacle.name, np.asarray(obstacle.position)[:2], style.RED) for obstacle in area.obstacles]
    named += [(name, places[len(places) // 2], style.PURPLE) for name, places in jobs]
    for zone in closed:
        inside = zone.polygon.representative_point()
        named.append((zone.name, np.array([inside.x, inside.y]), style.RED))
    low, high = np.asarray([pen.axes.get_xlim(), pen.axes.get_ylim()]).T
    seen = [one for one in named if ((low <= pen.flat(one[1])) & (pen.flat(one[1]) <= high)).all()]
    taken = np.concatenate([*_ends(scenario), *(places for _, places in jobs), np.zeros((0, 2))])
    for colour in (style.PURPLE, style.RED):
        own = [(name, place) for name, place, shade in seen if shade == colour]
        texts = [name if len(name) <= 24 else f"{name[:23]}…" for name, _ in own]
        pen.labels([place for _, place in own], texts, taken, fontsize=8, color=colour, zorder=8)
