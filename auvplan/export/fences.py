"""Fences: polygons and circles not to enter, few and simple enough for autopilots, clear of planned paths."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from auvplan.ocean.chart import Chart
from auvplan.runtime.arrays import Array

#: m around the paths within which coast and obstacles are fenced in.
REACH = 1000.0

#: Polygons at most.
MOST = 100

#: m, islands that a circle of this radius covers become circles.
ISLET = 60.0

#: m, islands nearer to each other than twice this become one where there are too many; then twice as far.
_BRIDGE = 20.0

#: Corners of a polygon around a circle.
_AROUND = 48

#: m, room between a path and a fence that is drawn around land beside it.
_LANE = 1.0

#: m that an outline may reach out at a time for every corner saved.
DETAIL = 50.0

#: Corners above which an outline reaches out as far as it can.
CORNERS = 40


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
        angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
        reach = self.radius / np.cos(np.pi / _AROUND)
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
    """Choose the fences that an autopilot with `most` points has room for, those nearest to a route first.

    Returns:
        ``(chosen, note)``: in their order, and what was left out; empty where nothing was.
    """
    if sum(map(points, fences)) <= most:
        return tuple(fences), ""
    paths = shapely.MultiLineString([np.asarray(line)[:, 1::-1] for line in lines])
    away, chosen, room = [], set(), most
    for fence in fences:
        if isinstance(fence, Circle):
            away.append(float(shapely.distance(paths, shapely.Point(fence.centre[::-1]))) - fence.radius)
        else:
            away.append(float(shapely.distance(paths, shapely.Polygon(fence.corners[:, ::-1]))))
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
    return [whole for piece in _pieces(land) for whole in _without_holes(piece, paths)]


def _pieces(*land: BaseGeometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(land) if part.area > 0.0]


def _without_holes(land: shapely.Polygon, paths: BaseGeometry) -> list[shapely.Polygon]:
    """Fill the lakes; cut the land where a path is in one: fences have no holes."""
    lakes = [ring for ring in land.interiors if shapely.intersects(shapely.Polygon(ring), paths)]
    if not lakes:
        return [shapely.Polygon(land.exterior)]
    west, south, east, north = land.bounds
    middle = lakes[0].centroid.x
    halves = (shapely.box(west, south, middle, north), shapely.box(middle, south, east, north))
    pieces = _pieces(*(shapely.Polygon(land.exterior, lakes).intersection(half) for half in halves))
    return [whole for piece in pieces for whole in _without_holes(piece, paths)]


def _fence(land: shapely.Polygon, paths: BaseGeometry, pixel: float) -> Fence:
    """Return a circle around an islet, or else a polygon of few corners around land."""
    circle = shapely.minimum_bounding_circle(land)
    centre, radius = circle.centroid, float(shapely.minimum_bounding_radius(land))
    if radius <= ISLET and shapely.distance(paths, centre) > radius + _LANE:
        return Circle((centre.y, centre.x), radius)
    return Polygon(outline(land, paths, pixel)[:, ::-1])


def outline(land: shapely.Polygon, paths: BaseGeometry, pixel: float) -> Array:
    """Corners [k, 2] of a polygon that covers land without holes and touches no path.

    Corners go one by one, the cheapest in area first: one that points inwards is cut off; two that point
    outwards give way to where their neighbours' sides meet. Land only ever gains.

    Args:
        land: coordinates east, north, m.
        paths: what must stay outside.
        pixel: m, of the raster that the land is from; its steps are smoothed away first.

    Returns:
        East, north, m, clockwise on the map, at least three.
    """
    shapely.prepare(paths)
    smoothed = _smoothed(land, paths, min(0.75 * pixel, 0.3 * float(shapely.distance(land, paths))))
    ring = np.asarray(shapely.orient_polygons(smoothed).exterior.coords)[:-1]
    while len(ring) > 3:
        step = _cheapest(ring, paths, None if len(ring) > CORNERS else DETAIL)
        if step is None:
            break
        ring = step
    return ring[::-1]


def _smoothed(land: shapely.Polygon, paths: BaseGeometry, tolerance: float) -> shapely.Polygon:
    """Land without its raster's steps: widened by a tolerance, m, which simplifying may take away again."""
    if tolerance > 0.0:
        wider = shapely.Polygon(land.buffer(tolerance, join_style="mitre").exterior)
        # Simplifying keeps to its tolerance nearly always.
        for share in (1.0, 0.5, 0.0):
            coarse = shapely.Polygon(shapely.get_exterior_ring(wider.simplify(share * tolerance)))
            if coarse.covers(land) and not shapely.intersects(paths, coarse):
                return coarse
    return land


def _cheapest(ring: Array, paths: BaseGeometry, deepest: float | None) -> Array | None:
    """Return the ring with a corner less, at the least area; None where there is none.

    Args:
        ring: [k, 2], counter-clockwise, the first corner not repeated.
        paths: what no added triangle may touch.
        deepest: m that a side may move at most; None for any distance.
    """
    before, here, after = np.roll(ring, 1, axis=0), ring, np.roll(ring, -1, axis=0)
    beyond = np.roll(ring, -2, axis=0)
    along = after - here
    inward = _cross(here - before, along)  # negative where the corner at `here` points inwards
    cut = np.where(inward <= 0.0, -0.5 * inward, np.inf)
    cut_depth = -inward / np.maximum(np.linalg.norm(after - before, axis=1), 1e-9)

    # The sides before and after `along`, drawn out, meet in a tip.
    first, last = here - before, after - beyond
    turn = _cross(first, last)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = _cross(along, last) / turn
        tip = here + share[:, None] * first
    convex = (inward > 0.0) & (np.roll(inward, -1) > 0.0) & (turn < 0.0) & (share > 0.0)
    tip = np.where(convex[:, None], tip, here)
    area = np.abs(_cross(along, tip - here))
    extend = np.where(convex, 0.5 * area, np.inf)
    extend_depth = area / np.maximum(np.linalg.norm(along, axis=1), 1e-9)

    cost, depth = np.concatenate([cut, extend]), np.concatenate([cut_depth, extend_depth])
    if deepest is not None:
        cost = np.where(depth <= deepest, cost, np.inf)
    for choice in np.argsort(cost):
        if not np.isfinite(cost[choice]):
            return None
        k, drawn_out = int(choice) % len(ring), choice >= len(ring)
        added = [here[k], tip[k], after[k]] if drawn_out else [before[k], here[k], after[k]]
        if cost[choice] > 0.0 and shapely.intersects(paths, shapely.Polygon(added)):
            continue
        shorter = np.delete(ring, (k + 1) % len(ring) if drawn_out else k, axis=0)
        if drawn_out:
            shorter[k - (k == len(ring) - 1)] = tip[k]
        if shapely.LinearRing(shorter).is_simple:
            return shorter
    return None


def _cross(a: Array, b: Array) -> Array:
    """Third components [k] of the cross products of vectors [k, 2]."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
