"""Outlines of few corners that cover a piece of land and stay clear of paths."""

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

Array = NDArray[np.floating]

#: m that an outline may reach out at a time for every corner saved.
DETAIL = 50.0

#: Corners above which an outline reaches out as far as it can.
CORNERS = 40


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
    """Return the ring with a corner less, at the least area; None where every way is barred.

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
