"""The local grid of pixels that files are brought to, and polygons on it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Polygon

from auvplan.io.geo.error import GeoError
from auvplan.ocean.chart import Chart
from auvplan.ocean.picture import MAX_PIXELS
from auvplan.site import Site

Array = NDArray[np.floating]

#: Pixels that are placed at a time.
_BLOCK = 1_000_000
#: Points along each side of its outline.
OUTLINE = 65
# An edge of GeoJSON is straight in longitude and latitude; pieces of this length, degrees, are so in metres,
# to a few centimetres.
_PIECE = 0.01
# By this share of a pixel two that merely share an edge are kept apart.
_OPEN = 1e-6


@dataclass(frozen=True)
class LocalGrid:
    """Square pixels over a rectangle of local metres; [i, j] runs north and east."""

    lower: tuple[float, float]  # south-western corner (north, east), m
    upper: tuple[float, float]  # north-eastern corner asked for, m; the last pixels may reach beyond it
    pixel_size: float  # m
    shape: tuple[int, int]  # pixels north and east

    @property
    def box(self) -> Polygon:
        """The rectangle asked for, in local (north, east), m."""
        return shapely.box(*self.lower, *self.upper)

    def chart(self, passability: NDArray) -> Chart:
        """Return a chart of the grid, with a passability for each pixel."""
        return Chart.from_passability(passability, self.pixel_size, self.lower)

    def widened(self, metres: float) -> "LocalGrid":
        """Return the grid widened by a distance, in whole pixels, on every side."""
        more = max(int(np.ceil(metres / self.pixel_size - 1e-6)), 0)
        lower = (self.lower[0] - more * self.pixel_size, self.lower[1] - more * self.pixel_size)
        upper = (self.upper[0] + more * self.pixel_size, self.upper[1] + more * self.pixel_size)
        return LocalGrid(lower, upper, self.pixel_size, (self.shape[0] + 2 * more, self.shape[1] + 2 * more))

    def outline(self, centres: bool = False) -> tuple[Array, Array]:
        """North and east of points around the rectangle asked for, m: even, or by the pixels' centres."""
        (south, west), (north, east) = self.lower, self.upper
        n, e = np.linspace(south, north, OUTLINE), np.linspace(west, east, OUTLINE)
        if centres:
            n, e = self._axes(around=True)
        rows = [n, n, np.full(e.size, south), np.full(e.size, north)]
        return np.concatenate(rows), np.concatenate([np.full(n.size, west), np.full(n.size, east), e, e])

    def indices(self, north: Array, east: Array) -> tuple[Array, Array]:
        """Local north and east, m, to row and column among the pixels' centres, continuous."""
        (south, west), size = self.lower, self.pixel_size
        return (north - south) / size - 0.5, (east - west) / size - 0.5

    def _axes(self, around: bool) -> tuple[Array, Array]:
        """North and east of the pixels' centres, and of the edges of the rectangle asked for, m."""
        north, east = (
            low + (np.arange(count) + 0.5) * self.pixel_size
            for low, count in zip(self.lower, self.shape, strict=True)
        )
        if around:
            (south, west), (top, right) = self.lower, self.upper
            north, east = np.r_[south, north, top], np.r_[west, east, right]
        return north, east

    def degrees(self, site: Site, offset: float = 0.5) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """[nx, ny] longitude and latitude, degrees, of pixels' centres; [nx + 1, ny + 1] of corners.

        Args:
            offset: of the places in their pixels, 0.5 or, for corners, 0.
        """
        more = int(offset == 0.0)
        axes = (
            self.lower[k] + self.pixel_size * (np.arange(count + more) + offset)
            for k, count in enumerate(self.shape)
        )
        return site.to_geographic(*np.meshgrid(*axes, indexing="ij"))

    def blocks(self, around: bool = False) -> Iterator[tuple[slice, Array, Array]]:
        """Rows of pixels, a block at a time: which rows, and north and east of their centres, m.

        Args:
            around: whether the centres on every side of a block are given as well; beyond the outer pixels
                the edges of the rectangle asked for stand for them.
        """
        step, more = max(_BLOCK // self.shape[1], 1), 2 * around
        north, east = self._axes(around)
        for start in range(0, self.shape[0], step):
            stop = min(start + step, self.shape[0])
            n, e = np.meshgrid(north[start : stop + more], east, indexing="ij")
            yield slice(start, stop), n, e


class Extent(NamedTuple):
    """A rectangle of local metres, and the pixels that it is read on.

    Attributes:
        lower, upper: south-western and north-eastern corner (north, east), m; pixels may reach beyond it.
        pixel_size: m; None for what the reader chooses: 10 m of charts, as fine as the source of sea beds.
        beyond: m around the rectangle that charts cover as well; water where the source ends before.
    """

    lower: Any
    upper: Any
    pixel_size: float | None = None
    beyond: float = 0.0

    def grid(self, pixel_size: float | None = 10.0) -> LocalGrid:
        """Return its pixels, of another size where it has none, rounded up to whole ones.

        Without any size there are 64 of them along the longer side.

        Raises:
            GeoError: the corners are no corners, or the pixels no size or too many.
        """
        low, high = (tuple(float(c) for c in np.ravel(corner)[:2]) for corner in (self.lower, self.upper))
        if len(low) != 2 or len(high) != 2 or not np.isfinite((*low, *high)).all():
            raise GeoError(
                f"lower and upper must be finite (north, east), m, got {self.lower} and {self.upper}"
            )
        if low[0] >= high[0] or low[1] >= high[1]:
            raise GeoError(f"lower must lie south-west of upper, got {low} and {high}")
        size = pixel_size if self.pixel_size is None else self.pixel_size
        size = max(np.subtract(high, low)) / 64 if size is None else size
        if not (np.isfinite(size) and size > 0.0):
            raise GeoError(f"pixel_size must be positive, got {size}")
        # Less a rounding error, or 100 m of 0.1 m pixels would be 1001 of them.
        north, east = np.maximum(np.ceil(np.subtract(high, low) / size - 1e-6), 1).astype(int).tolist()
        if north * east > MAX_PIXELS:
            makes = f"{size:g} m makes {north} x {east} pixels, more than {MAX_PIXELS}"
            raise GeoError(makes, field="pixel_size")
        return LocalGrid(low, high, float(size), (north, east))  # type: ignore[arg-type]


def to_local(shape: Any, site: Site) -> Any:
    """Return a shapely geometry in longitude and latitude, degrees, as one in local (north, east), m.

    Polygons stay polygons; those of one shape that meet at the antimeridian become one.
    """

    def local(places: NDArray) -> NDArray:
        return np.stack(site.to_local(places[:, 0], places[:, 1]), axis=-1)

    moved = shapely.transform(shapely.segmentize(shape, _PIECE), local)
    if shapely.is_valid(moved):
        return moved
    # Rounding may fold what all but touched, and parts meet that were a turn of longitude apart.
    sound = [shapely.make_valid(part) for part in shapely.get_parts(moved)]
    whole = shapely.union_all(sound)
    return areas(whole) if isinstance(moved, Polygon | MultiPolygon) else whole


def areas(shape: Any) -> Polygon | MultiPolygon:
    """Return the polygons of a geometry, which may lie among points and lines; an empty one without any."""
    if isinstance(shape, Polygon | MultiPolygon):
        return shape
    parts = [part for part in shapely.get_parts(shape) if isinstance(part, Polygon | MultiPolygon)]
    union = shapely.union_all(parts)
    return union if isinstance(union, Polygon | MultiPolygon) else Polygon()


def near(shapes: Sequence[Any], site: Site, grid: LocalGrid, margin: float) -> Any:
    """The union of shapes in longitude and latitude, cut to a grid and `margin` m around it, in local metres.

    Of longitudes that name one place (-170 and 190) either is found.
    """
    given, found = np.asarray(shapes, object), []
    for box in around(site, grid, margin).geoms:
        cuts = shapely.intersection(given[shapely.intersects(box, given)], box)
        found += [to_local(cut, site) for cut in cuts[~shapely.is_empty(cuts)]]
    return shapely.union_all(found)


def around(site: Site, grid: LocalGrid, margin: float) -> MultiPolygon:
    """Return boxes in longitude and latitude, degrees, that hold a grid and `margin` m around it.

    There is one for each way to write the longitudes.
    """
    low, high = np.asarray(grid.lower) - margin, np.asarray(grid.upper) + margin
    grown = replace(grid, lower=tuple(low), upper=tuple(high))
    longitude, latitude = site.to_geographic(*grown.outline())
    longitude = site.longitude + (longitude - site.longitude + 180.0) % 360.0 - 180.0
    # Between the points of the outline it may bulge.
    wide, tall = 0.02 * np.ptp(longitude), 0.02 * (np.ptp(latitude) + 1e-6)
    west, east = longitude.min() - wide - 1e-6, longitude.max() + wide + 1e-6
    south, north = max(latitude.min() - tall, -90.0), min(latitude.max() + tall, 90.0)
    for pole in (-90.0, 90.0):
        at = np.ravel(site.to_local(0.0, pole))
        if (low <= at).all() and (at <= high).all():
            west, east = site.longitude - 180.0, site.longitude + 180.0
            south, north = min(south, pole), max(north, pole)
    return MultiPolygon(
        [shapely.box(west + turn, south, east + turn, north) for turn in (-360.0, 0.0, 360.0)]
    )


def touched(shape: Any, grid: LocalGrid) -> NDArray[np.bool_]:
    """[nx, ny]: pixels that a shape in local (north, east), m, reaches into; a shared edge is not enough.

    Squares are halved where the shape neither fills nor leaves them, so that the work goes with the length of
    its outline.
    """
    nothing, part, whole = 0, 1, 2
    shapely.prepare(shape)
    state, gap = np.full((1, 1), part, np.uint8), _OPEN * grid.pixel_size
    for level in range(int(np.ceil(np.log2(max(grid.shape)))), -1, -1):
        size = grid.pixel_size * 2**level
        i, j = np.nonzero(state == part)
        south, west = grid.lower[0] + i * size, grid.lower[1] + j * size
        squares = shapely.box(south + gap, west + gap, south + size - gap, west + size - gap)
        reached = np.where(shapely.intersects(shape, squares), part, nothing)
        state[i, j] = (
            np.where(shapely.contains_properly(shape, squares), whole, reached) if level else reached
        )
        if level:
            rows, columns = (-(-pixels // 2 ** (level - 1)) for pixels in grid.shape)
            state = state.repeat(2, axis=0)[:rows].repeat(2, axis=1)[:, :columns]
    return state != nothing
