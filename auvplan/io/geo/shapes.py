"""Polygons from longitude and latitude to local metres, and from there to pixels."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon

from auvplan.io.geo.grid import LocalGrid
from auvplan.site import Site

# An edge of GeoJSON is straight in longitude and latitude; pieces of so many degrees are straight in both,
# to a few centimetres.
_PIECE = 0.01
_NONE, _PART, _ALL = 0, 1, 2
# By this share of a pixel two that merely share an edge are kept apart.
_OPEN = 1e-6


def to_local(shape: Any, site: Site) -> Any:
    """Return a shapely geometry in longitude and latitude, degrees, as one in local (north, east), m."""

    def local(places: NDArray) -> NDArray:
        return np.stack(site.to_local(places[:, 0], places[:, 1]), axis=-1)

    moved = shapely.transform(shapely.segmentize(shape, _PIECE), local)
    # Rounding may fold what all but touched.
    return moved if shapely.is_valid(moved) else shapely.make_valid(moved)


def near(shapes: Sequence[Any], site: Site, grid: LocalGrid, margin: float) -> Any:
    """The union of shapes in longitude and latitude, cut to a grid and `margin` m around it, in local metres.

    Of longitudes that name one place (-170 and 190) either is found.
    """
    found = []
    all_shapes = np.asarray(shapes, object)
    for box in around(site, grid, margin).geoms:
        for shape in all_shapes[shapely.intersects(box, all_shapes)]:
            cut = shapely.intersection(shape, box)
            if not shapely.is_empty(cut):
                found.append(to_local(cut, site))
    return shapely.union_all(found)


def around(site: Site, grid: LocalGrid, margin: float) -> MultiPolygon:
    """Return boxes in longitude and latitude, degrees, that hold a grid and `margin` m around it.

    There is one for each way to write the longitudes.
    """
    west, south, east, north = _bounds(site, grid, margin)
    turns = (-360.0, 0.0, 360.0)
    return MultiPolygon([shapely.box(west + turn, south, east + turn, north) for turn in turns])


def touched(shape: Any, grid: LocalGrid) -> NDArray[np.bool_]:
    """[nx, ny]: pixels that a shape in local (north, east), m, reaches into; a shared edge is not enough.

    Squares are halved where the shape neither fills nor leaves them, so that the work goes with the length of
    its outline.
    """
    shapely.prepare(shape)
    state = np.full((1, 1), _PART, np.uint8)
    for level in range(int(np.ceil(np.log2(max(grid.shape)))), -1, -1):
        size = grid.pixel_size * 2**level
        i, j = np.nonzero(state == _PART)
        gap = _OPEN * grid.pixel_size
        south, west = grid.lower[0] + i * size, grid.lower[1] + j * size
        squares = shapely.box(south + gap, west + gap, south + size - gap, west + size - gap)
        reached = np.where(shapely.intersects(shape, squares), _PART, _NONE)
        state[i, j] = np.where(shapely.contains_properly(shape, squares), _ALL, reached) if level else reached
        if level:
            rows, columns = (-(-pixels // 2 ** (level - 1)) for pixels in grid.shape)
            state = state.repeat(2, axis=0)[:rows].repeat(2, axis=1)[:, :columns]
    return state != _NONE


def _bounds(site: Site, grid: LocalGrid, margin: float) -> tuple[float, float, float, float]:
    """West, south, east and north, degrees, of a grid and the margin; west and east around the site."""
    low, high = np.asarray(grid.lower) - margin, np.asarray(grid.upper) + margin
    grown = LocalGrid(tuple(low), tuple(high), grid.pixel_size, grid.shape)
    longitude, latitude = site.to_geographic(*grown.outline())
    around = site.longitude + (longitude - site.longitude + 180.0) % 360.0 - 180.0
    # Between the points of the outline it may bulge.
    spare = 0.02 * (np.ptp(latitude) + 1e-6)
    west, east = around.min() - 0.02 * np.ptp(around) - 1e-6, around.max() + 0.02 * np.ptp(around) + 1e-6
    south, north = max(latitude.min() - spare, -90.0), min(latitude.max() + spare, 90.0)
    for pole in (-90.0, 90.0):
        at = np.ravel(site.to_local(0.0, pole))
        if (low <= at).all() and (at <= high).all():
            west, east = site.longitude - 180.0, site.longitude + 180.0
            south, north = min(south, pole), max(north, pole)
    return float(west), float(south), float(east), float(north)
