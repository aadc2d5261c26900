"""The local raster that files are brought to, how places in a file are found from it, and look-ups there."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.io.geo.error import GeoError
from auvplan.ocean.picture import MAX_PIXELS
from auvplan.site import Site, swapped_hint

Array = NDArray[np.floating]

#: Pixels that are placed at a time.
_BLOCK = 1_000_000
_OUTLINE = 65


@dataclass(frozen=True)
class LocalGrid:
    """Square pixels over a rectangle of local metres; [i, j] runs north and east.

    Attributes:
        lower: south-western corner (north, east), m.
        upper: north-eastern corner asked for, m; the last pixels may reach beyond it.
        pixel_size: m.
        shape: pixels north and east.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    pixel_size: float
    shape: tuple[int, int]

    def widened(self, metres: float) -> "LocalGrid":
        """Return the grid with so many metres of whole pixels more on every side."""
        more = max(int(np.ceil(metres / self.pixel_size - 1e-6)), 0)
        lower = (self.lower[0] - more * self.pixel_size, self.lower[1] - more * self.pixel_size)
        upper = (self.upper[0] + more * self.pixel_size, self.upper[1] + more * self.pixel_size)
        return LocalGrid(lower, upper, self.pixel_size, (self.shape[0] + 2 * more, self.shape[1] + 2 * more))

    def outline(self) -> tuple[Array, Array]:
        """North and east of points around the rectangle asked for, m."""
        (south, west), (north, east) = self.lower, self.upper
        n, e = np.linspace(south, north, _OUTLINE), np.linspace(west, east, _OUTLINE)
        sides = [(n, np.full(_OUTLINE, side)) for side in (west, east)]
        sides += [(np.full(_OUTLINE, side), e) for side in (south, north)]
        return np.concatenate([s[0] for s in sides]), np.concatenate([s[1] for s in sides])

    def blocks(self) -> Iterator[tuple[slice, Array, Array]]:
        """Rows of pixels, a block at a time: which rows, and north and east of their centres, m."""
        step = max(_BLOCK // self.shape[1], 1)
        east = self.lower[1] + (np.arange(self.shape[1]) + 0.5) * self.pixel_size
        for start in range(0, self.shape[0], step):
            rows = np.arange(start, min(start + step, self.shape[0]))
            north = self.lower[0] + (rows + 0.5) * self.pixel_size
            n, e = np.meshgrid(north, east, indexing="ij")
            yield slice(start, start + len(rows)), n, e


def local_grid(lower: Any, upper: Any, pixel_size: float | None) -> LocalGrid:
    """Return the pixels from one corner (north, east) to the other, m, rounded up to whole ones.

    Without a size there are 64 of them along the longer side.

    Raises:
        GeoError: the corners are no corners, or the pixels no size or too many.
    """
    low, high = (tuple(float(c) for c in np.ravel(corner)[:2]) for corner in (lower, upper))
    if len(low) != 2 or len(high) != 2 or not np.isfinite((*low, *high)).all():
        raise GeoError(f"lower and upper must be finite (north, east), m, got {lower} and {upper}")
    if low[0] >= high[0] or low[1] >= high[1]:
        raise GeoError(f"lower must lie south-west of upper, got {low} and {high}")
    if pixel_size is None:
        pixel_size = max(b - a for a, b in zip(low, high, strict=True)) / 64
    if not (np.isfinite(pixel_size) and pixel_size > 0.0):
        raise GeoError(f"pixel_size must be positive, got {pixel_size}")
    # Less a whisker, or 100 m of 0.1 m pixels would be 1001 of them.
    north, east = (int(np.ceil((b - a) / pixel_size - 1e-6)) for a, b in zip(low, high, strict=True))
    north, east = max(north, 1), max(east, 1)
    if north * east > MAX_PIXELS:
        makes = f"{pixel_size:g} m makes {north} x {east} pixels, more than {MAX_PIXELS}"
        raise GeoError(makes, field="pixel_size")
    return LocalGrid(low, high, float(pixel_size), (north, east))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Nodes:
    """Where the values of a file lie.

    Attributes:
        find: longitude and latitude, degrees, to row and column, whole numbers at the nodes, which are pixel
            centres; NaN where there is none.
        shape: rows and columns.
        middle: longitude of their middle, degrees, where columns go by longitude: it tells which of
            the longitudes that name one place is meant. None in projected coordinates.
        cyclic: whether the first column follows upon the last one.
    """

    find: Callable[[Array, Array], tuple[Array, Array]]
    shape: tuple[int, int]
    middle: float | None = None
    cyclic: bool = False

    def seen_from(self, site: Site, grid: LocalGrid) -> Callable[[Array, Array], tuple[Array, Array]]:
        """Local north and east, m, to row and column, continuous over the grid."""
        low, high = np.asarray(grid.lower), np.asarray(grid.upper)
        centre = float(site.to_geographic(*((low + high) / 2))[0])
        if self.middle is not None:
            centre += 360.0 * np.round((self.middle - centre) / 360.0)

        def find(north: Array, east: Array) -> tuple[Array, Array]:
            longitude, latitude = site.to_geographic(north, east)
            near = centre + (longitude - centre + 180.0) % 360.0 - 180.0
            row, column = self.find(near, latitude)
            finite = np.isfinite(row) & np.isfinite(column)
            return np.where(finite, row, np.nan), np.where(finite, column, np.nan)

        return find


def steps(find: Callable, grid: LocalGrid) -> Array:
    """[2, 2] m: the local way (north, east) of one row, and of one column, in the middle of the grid."""
    middle = (np.asarray(grid.lower) + np.asarray(grid.upper)) / 2
    h = min(1.0, 0.01 * float(np.min(np.asarray(grid.upper) - np.asarray(grid.lower))))
    around = middle + h * np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]])
    at = np.stack(find(around[:, 0], around[:, 1]), axis=-1)
    slopes = np.stack([at[0] - at[1], at[2] - at[3]], axis=-1) / (2 * h)
    with np.errstate(all="ignore"):
        if not np.isfinite(slopes).all() or abs(np.linalg.det(slopes)) < 1e-30:
            return np.full((2, 2), np.nan)
        return np.linalg.inv(slopes).T


def refuse_beyond(
    path: object, what: str, site: Site, find: Callable, grid: LocalGrid, nodes: Nodes, slack: float
) -> None:
    """Refuse a grid that reaches more than `slack` rows or columns beyond the outer nodes of a file.

    Raises:
        GeoError: one line that says by how much, on which side, and whether it would not with longitude and
            latitude swapped.
    """
    try:
        _refuse_beyond(path, what, find, grid, nodes, slack)
    except GeoError as error:

        def fits(other: Site) -> bool:
            _refuse_beyond(path, what, nodes.seen_from(other, grid), grid, nodes, slack)
            return True

        hint = swapped_hint(site, fits)
        raise GeoError(f"{error}{hint}") from None


def _refuse_beyond(
    path: object, what: str, find: Callable, grid: LocalGrid, nodes: Nodes, slack: float
) -> None:
    row, column = find(*grid.outline())
    ways = steps(find, grid)
    if np.isnan(row).all() or (np.isnan(ways).any() and not np.isnan(row).any()):
        raise GeoError(f"{path}: the area lies wholly beyond the {what}")
    over: dict[str, float] = {}
    for at, size, way, cyclic in (
        (row, nodes.shape[0], ways[0], False),
        (column, nodes.shape[1], ways[1], nodes.cyclic),
    ):
        past = (-np.nanmin(at), np.nanmax(at) - (size - 1))
        for by, sense in zip(past, (-1.0, 1.0), strict=True):
            if by > slack and not cyclic:
                over[_side(sense * way)] = (by - 0.5) * float(np.hypot(*way))
    if over:
        listed = " and ".join(f"{metres:.0f} m in the {side}" for side, metres in over.items())
        raise GeoError(f"{path}: the area reaches beyond the {what} by {listed}")
    if np.isnan(row).any():
        north, east = grid.outline()
        gone = np.isnan(row)
        listed = " and ".join(
            f"{metres:.0f} m of its edge in the {side}" for side, metres in _lost(grid, north, east, gone)
        )
        raise GeoError(f"{path}: the area reaches beyond the {what} with {listed}")


def _side(way: Array) -> str:
    north, east = (float(c) for c in way)
    if abs(north) >= abs(east):
        return "north" if north > 0 else "south"
    return "east" if east > 0 else "west"


def _lost(grid: LocalGrid, north: Array, east: Array, gone: NDArray[np.bool_]) -> list[tuple[str, float]]:
    """Sides of the rectangle with the length, m, of their part that has no place in the file."""
    tall, wide = (b - a for a, b in zip(grid.lower, grid.upper, strict=True))
    sides = ("west", tall), ("east", tall), ("south", wide), ("north", wide)
    shares = gone.reshape(4, _OUTLINE).mean(axis=1)
    return [(side, share * length) for (side, length), share in zip(sides, shares, strict=True) if share > 0]


def nearest(values: NDArray, row: Array, column: Array, cyclic: bool = False) -> NDArray:
    """Return the value of the nearest node, held beyond the outer ones; [rows, columns] at row and column."""
    i = np.clip(np.rint(row), 0, values.shape[0] - 1).astype(int)
    j = np.rint(column).astype(int)
    return values[i, j % values.shape[1] if cyclic else np.clip(j, 0, values.shape[1] - 1)]


def bilinear(values: NDArray, row: Array, column: Array) -> Array:
    """Bilinear interpolation of [rows, columns], held beyond the outer nodes.

    NaN where a node that bears on the place is NaN: a missing value spreads, it is never guessed.
    """
    rows, columns = values.shape
    nowhere = np.isnan(row) | np.isnan(column)
    row = np.clip(np.where(nowhere, 0.0, row), 0, rows - 1)
    column = np.clip(np.where(nowhere, 0.0, column), 0, columns - 1)
    i = np.minimum(np.floor(row).astype(int), max(rows - 2, 0))
    j = np.minimum(np.floor(column).astype(int), max(columns - 2, 0))
    a, b = row - i, column - j
    up, right = np.minimum(i + 1, rows - 1), np.minimum(j + 1, columns - 1)
    total = np.where(nowhere, np.nan, 0.0)
    for weight, at in (
        ((1 - a) * (1 - b), values[i, j]),
        ((1 - a) * b, values[i, right]),
        (a * (1 - b), values[up, j]),
        (a * b, values[up, right]),
    ):
        total += np.where(weight > 0.0, weight * at, 0.0)
    return total
