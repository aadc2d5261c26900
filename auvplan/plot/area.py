"""The map of a scenario before anything is planned: what its files tell, on top of each other."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Rectangle
from matplotlib.path import Path as Outline

from auvplan.ocean.currents import evaluated
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.plot import style
from auvplan.plot.depths import draw_depths
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.site import at_time
from auvplan.words import counted

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
    unit = style.Unit.for_extent(float((top - bottom).max()))
    tall, wide = top - bottom
    figure = style.new_figure(9.4, float(np.clip(8.6 * tall / wide, 4.0, 11.0)) + 1.3)
    axes = figure.subplots()
    style.map_axes(axes, bottom, top, unit)
    handles: list[Any] = list(style.draw_coast(axes, area.chart, unit))
    handles += draw_depths(axes, area.seabed, unit)
    handles += _draw_closed(axes, closed, unit)
    handles += style.draw_known(axes, area.obstacles, scenario.mission.time_available, unit, zorder=2)
    handles += _draw_current(axes, scenario, area, unit)
    corner, size = low[::-1] / unit.metres, edge[::-1] / unit.metres
    axes.add_patch(Rectangle(tuple(corner), *size, fill=False, ec="black", lw=1.2, ls=(0, (6, 3)), zorder=3))
    handles.append(Line2D([], [], color="black", lw=1.2, ls=(0, (6, 3)), label="area"))
    handles += _draw_jobs(axes, area, unit)
    mission = scenario.mission
    for place, kind, label in (
        (mission.start, style.START, "start"),
        (mission.goal, style.GOAL, "destination"),
    ):
        if place is not None:
            handles.append(style.draw_end(axes, place, kind, label, unit))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    style.title_map(axes, _title(scenario, area), area.site, unit)
    _draw_names(axes, scenario, area, closed, unit)
    return figure


def draw_area(scenario: Scenario, area: OperatingArea, closed: Sequence[Any], path: Path) -> Path:
    """Write the map of a scenario.

    Raises:
        OutputError: the file cannot be written.
    """
    return style.save(plot_area(scenario, area, closed), path)


def _title(scenario: Scenario, area: OperatingArea) -> str:
    low, high = scenario.box
    depths = f"depths {low[2]:g} to {high[2]:g} m"
    jobs = area.jobs
    tasks = ""
    if jobs is not None:
        numbers = (len(jobs.points), "point"), (len(jobs.lines), "survey line")
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


def _draw_closed(axes: Axes, closed: Sequence[Any], unit: style.Unit) -> list[Patch]:
    for zone in closed:
        for polygon in getattr(zone.polygon, "geoms", [zone.polygon]):
            rings = (polygon.exterior, *polygon.interiors)
            outlines = (Outline(style.flat(ring.coords, unit), closed=True) for ring in rings)
            axes.add_patch(PathPatch(Outline.make_compound_path(*outlines), zorder=1.0, **style.CLOSED))
    return [Patch(label="closed area", **style.CLOSED)] if closed else []


def _draw_current(axes: Axes, scenario: Scenario, area: OperatingArea, unit: style.Unit) -> list[Any]:
    """Arrows of the forecast at departure at the least depth, where there is water."""
    current = area.forecast
    if current is None:
        return []
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
        return []
    u, v, _ = (
        np.asarray(part) for part in evaluated(current, x, y, np.full_like(x, low[2]), np.zeros_like(x))
    )
    fastest = max(float(np.hypot(u, v).max()), 1e-6)
    axes.quiver(
        *(style.flat(np.stack([x, y], axis=1), unit).T), v, u,
        color=style.BLUE, alpha=0.75, zorder=1.5, angles="xy", scale_units="xy",
        scale=fastest * unit.metres / step / 0.9, width=0.0022,
    )  # fmt: skip
    when = at_time(0.0, area.site.epoch if area.site else None)
    label = f"current {when} at {low[2]:g} m, up to {fastest:.2f} m/s"
    return [Line2D([], [], color=style.BLUE, ls="", marker=r"$\rightarrow$", ms=12, label=label)]


def _draw_jobs(axes: Axes, area: OperatingArea, unit: style.Unit) -> list[Line2D]:
    jobs = area.jobs
    if jobs is None:
        return []
    handles = []
    mark: dict[str, Any] = {"color": "white", "mec": style.PURPLE, "mew": 1.4}
    if jobs.points:
        places = style.flat([job.position for job in jobs.points], unit)
        axes.plot(*places.T, ls="", marker="o", ms=6, zorder=5, **mark)
        handles.append(Line2D([], [], ls="", marker="o", ms=6, label="job", **mark))
    for job in jobs.lines:
        line = style.flat(job.positions, unit)
        axes.plot(*line.T, color=style.PURPLE, lw=1.8, zorder=4.5, path_effects=style.halo(3.4))
    if jobs.lines:
        handles.append(Line2D([], [], color=style.PURPLE, lw=1.8, label="line to survey"))
    return handles


def _draw_names(
    axes: Axes, scenario: Scenario, area: OperatingArea, closed: Sequence[Any], unit: style.Unit
) -> None:
    """Names of jobs and closed areas, where these are seen."""
    named = [(obstacle.name, style.flat(obstacle.position, unit), style.RED) for obstacle in area.obstacles]
    named += [
        (name, style.flat(places[len(places) // 2], unit), style.PURPLE) for name, places in _jobs(area)
    ]
    for zone in closed:
        inside = zone.polygon.representative_point()
        named.append((zone.name, np.array([inside.y, inside.x]) / unit.metres, style.RED))
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    shown = [entry for entry in named if west <= entry[1][0] <= east and south <= entry[1][1] <= north]
    ends = [style.flat(end, unit) for end in _ends(scenario)]
    taken = np.concatenate(
        [*ends, *(style.flat(places, unit) for _, places in _jobs(area)), np.zeros((0, 2))]
    )
    for colour in (style.PURPLE, style.RED):
        own = [entry for entry in shown if entry[2] == colour]
        if own:
            places = np.stack([place for _, place, _ in own])
            texts = [name if len(name) <= 24 else f"{name[:23]}…" for name, _, _ in own]
            style.place_labels(axes, places, texts, taken, fontsize=8, color=colour, zorder=8)
