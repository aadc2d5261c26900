"""Fences: polygons and circles not to enter, few and simple enough for autopilots, clear of planned paths."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from auvplan.export.outline import outline
from auvplan.ocean.chart import Chart

Array = NDArray[np.floating]

#: m around the paths within which coast and obstacles are fenced in.
REACH = 1000.0

#: Polygons at most.
MOST = 100

#: m, islands that a circle of this radius covers become circles.
ISLET = 60.0

#: m, islands nearer to each other than twice this become one where there are too many; then twice as far.
_BRIDGE = 20.0

#: Corners of a polygon around a circle.
_CORNERS = 48

#: m, room between a path and a fence that is drawn around land on its way.
_LANE = 1.0


@dataclass(frozen=True)
class Polygon:
    """Where not to go, by corners.

    Attributes:
        corners: [k, 2] m north, east, clockwise on the map; the last is joined to the first.
    """

    corners: Array


@dataclass(frozen=True)
class Circle:
    """Where not to go, around a place.

    Attributes:
        centre: north, east, m.
        radius: m.
        name: of the obstacle, or empty.
    """

    centre: tuple[float, float]
    radius: float
    name: str = ""

    @property
    def corners(self) -> Array:
        """[48, 2] m north, east of a polygon around it, clockwise, whose sides touch it."""
        angle = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
        reach = self.radius / np.cos(np.pi / _CORNERS)
        return np.asarray(self.centre) + reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)


Fence = Polygon | Circle


def fences_around(
    lines: Sequence[Array], chart: Chart | None = None, obstacles: Sequence[tuple[ArrayLike, float, str]] = ()
) -> tuple[list[Fence], list[str]]:
    """Fences around the coast and the obstacles within a kilometre of paths.

    A fence covers all of its land and never a part of a path. It reaches into the water where that saves
    corners.

    Args:
        lines: paths, [n, 3] m north, east, depth each.
        chart: coast: pixels of no passability; None for open water.
        obstacles: centres [3] m, radii, m, and names of what stands still.

    Returns:
        ``(fences, notes)``: the notes say what had to be left out.
    """
    paths = shapely.MultiLineString([np.asarray(line)[:, 1::-1] for line in lines])
    shapely.prepare(paths)
    west, south, east, north = shapely.bounds(paths)
    area = shapely.box(west - REACH, south - REACH, east + REACH, north + REACH)
    fences, notes = [], []
    if chart is not None:
        fences, notes = _around_coast(chart, paths, area)
    for place, radius, name in obstacles:
        x, y, depth = (float(value) for value in np.asarray(place))
        centre = shapely.Point(y, x)
        if shapely.distance(area, centre) > radius:
            continue
        # A fence knows no depth: it would forbid a path that passes above or below.
        if shapely.distance(paths, centre) <= radius:
            where = f"at ({x:.0f}, {y:.0f}, {depth:.0f}) m, radius {radius:.0f} m"
            notes.append(f"no fence around the obstacle {where}: a planned path crosses its circle")
        else:
            fences.append(Circle((x, y), float(radius), name))
    return fences, notes


def points(fence: Fence) -> int:
    """Return the points that an autopilot stores a fence in: its corners, or one for a circle."""
    return 1 if isinstance(fence, Circle) else len(fence.corners)


def nearest_fences(
    fences: Sequence[Fence], lines: Sequence[Array], most: int
) -> tuple[tuple[Fence, ...], str]:
    """Choose the fences that an autopilot has room for, those nearest to the route first.

    Args:
        fences: all of them.
        lines: the route, [n, 3] m north, east, depth each.
        most: points that the autopilot holds.

    Returns:
        ``(chosen, note)``: in their order, and what was left out; empty where nothing was.
    """
    if sum(map(points, fences)) <= most:
        return tuple(fences), ""
    paths = shapely.MultiLineString([np.asarray(line)[:, 1::-1] for line in lines])
    away = [_away(fence, paths) for fence in fences]
    chosen, room = set(), most
    for k in np.argsort(away, kind="stable").tolist():
        if points(fences[k]) <= room:
            chosen.add(k)
            room -= points(fences[k])
    nearest = min(gap for k, gap in enumerate(away) if k not in chosen)
    kept = tuple(fence for k, fence in enumerate(fences) if k in chosen)
    return kept, (
        f"{len(fences) - len(kept)} of {len(fences)} fences are left out, the nearest {nearest:.0f} m from "
        f"the route: all have {sum(map(points, fences))} points, the autopilot holds {most}"
    )


def _away(fence: Fence, paths: BaseGeometry) -> float:
    """Return m from a fence to the paths."""
    if isinstance(fence, Circle):
        return float(shapely.distance(paths, shapely.Point(fence.centre[::-1]))) - fence.radius
    return float(shapely.distance(paths, shapely.Polygon(fence.corners[:, ::-1])))


def _around_coast(chart: Chart, paths: BaseGeometry, area: BaseGeometry) -> tuple[list[Fence], list[str]]:
    """Fences around the land of a chart within an area."""
    west, south, east, north = shapely.bounds(area)
    land, notes = chart.land((south, west), (north, east)), []
    if land.is_empty:
        return [], notes
    if shapely.intersects(land, paths):
        notes.append("a planned path crosses land of the chart: the fence leaves a lane for it")
    parts = _parts(land, paths)
    bridge = _BRIDGE
    while len(parts) > MOST and bridge <= REACH:
        parts = _parts(land.buffer(bridge).buffer(-bridge).union(land), paths)
        bridge *= 2.0
    if len(parts) > MOST:
        parts.sort(key=lambda part: shapely.distance(part, paths))
        notes.append(f"{len(parts) - MOST} islands far from the paths have no fence: there are too many")
    return [_fence(part, paths, float(np.asarray(chart.pixel_size))) for part in parts[:MOST]], notes


def _parts(land: BaseGeometry, paths: BaseGeometry) -> list[shapely.Polygon]:
    """Land in pieces that have no holes and keep off the paths."""
    if shapely.intersects(land, paths):
        land = land.difference(paths.buffer(_LANE))
    pieces = [part for part in shapely.get_parts(land) if part.area > 0.0]
    return [whole for piece in pieces for whole in _without_holes(piece, paths)]


def _without_holes(land: shapely.Polygon, paths: BaseGeometry) -> list[shapely.Polygon]:
    """Fill the lakes; cut the land where a path is in one: fences have no holes."""
    lakes = [ring for ring in land.interiors if shapely.intersects(shapely.Polygon(ring), paths)]
    if not lakes:
        return [shapely.Polygon(land.exterior)]
    west, south, east, north = land.bounds
    middle = lakes[0].centroid.x
    halves = (shapely.box(west, south, middle, north), shapely.box(middle, south, east, north))
    pieces = [
        part
        for half in halves
        for part in shapely.get_parts(shapely.Polygon(land.exterior, lakes).intersection(half))
        if part.area > 0.0
    ]
    return [whole for piece in pieces for whole in _without_holes(piece, paths)]


def _fence(land: shapely.Polygon, paths: BaseGeometry, pixel: float) -> Fence:
    """Return a circle around an islet, or else a polygon of few corners around land."""
    circle = shapely.minimum_bounding_circle(land)
    centre, radius = circle.centroid, float(shapely.minimum_bounding_radius(land))
    if radius <= ISLET and shapely.distance(paths, centre) > radius + _LANE:
        return Circle((centre.y, centre.x), radius)
    return Polygon(outline(land, paths, pixel)[:, ::-1])
