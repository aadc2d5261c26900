"""Where the values of a georeferenced array lie: its axes, its reference system, and how places are found.

Rasters and sea beds share one form: an `xarray.DataArray` on two dimensions, with one of

- `longitude` and `latitude` (CF names, units or standard names), degrees, as two axes or as two grids,
- `x` and `y` of the pixels' centres and a reference system: a grid mapping (CF), `spatial_ref` as rioxarray
  writes it, or an attribute `crs`,
- a reference system whose grid mapping has a `GeoTransform`, where pixels are turned or skewed.

A coordinate `mask` (ROMS: `mask_rho`) on the same dimensions is 0 where values are missing.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray
from pyproj import CRS, Transformer

from auvplan.io.currents.geometry import Curvilinear
from auvplan.io.currents.names import DEGREES
from auvplan.io.currents.projection import as_crs, of_mapping, same_crs
from auvplan.io.geo.error import GeoError
from auvplan.io.geo.grid import OUTLINE, LocalGrid
from auvplan.site import Site, swapped_hint

Array = NDArray[np.floating]
#: A file, or an array in the form above.
Source = str | Path | xr.DataArray
Find = Callable[[Array, Array], tuple[Array, Array]]
Index = NDArray[np.integer]

_MASKS = ("mask", "mask_rho")
#: Places that are less than this many times as far apart as nodes are as close: a map's metres are not exact.
_STRETCH = 1.01
#: Values that differ by less are the same, m.
_SAME = 1e-3
#: Depth of water that stays water, m.
_AWASH = 0.1


@dataclass(frozen=True)
class Nodes:
    """Where the values of an array lie."""

    #: Longitude and latitude, degrees, to row and column, whole at the nodes (pixels' centres); else NaN.
    find: Find
    #: Row and column, whole, to longitude and latitude.
    at: Callable[[Index, Index], tuple[Array, Array]]
    shape: tuple[int, int]  # rows and columns
    #: Longitude of their middle, degrees, where columns go by longitude: it decides which of the longitudes
    #: that name one place is meant. None in projected coordinates.
    middle: float | None = None
    cyclic: bool = False  # whether the first column follows upon the last one


class View:
    """Where a local grid lies among nodes."""

    def __init__(self, nodes: Nodes, site: Site, grid: LocalGrid) -> None:
        """Look at nodes from a site, at whose place local coordinates begin."""
        self.nodes, self._site, self._grid = nodes, site, grid
        self._corners = low, high = np.asarray(grid.lower), np.asarray(grid.upper)
        self._centre = float(site.to_geographic(*((low + high) / 2))[0])
        if nodes.middle is not None:
            self._centre += 360.0 * np.round((nodes.middle - self._centre) / 360.0)

    def find(self, north: Array, east: Array) -> tuple[Array, Array]:
        """Local north and east, m, to row and column, continuous over the grid; NaN where there are none."""
        longitude, latitude = self._site.to_geographic(north, east)
        near = self._centre + (longitude - self._centre + 180.0) % 360.0 - 180.0
        row, column = self.nodes.find(near, latitude)
        finite = np.isfinite(row) & np.isfinite(column)
        return np.where(finite, row, np.nan), np.where(finite, column, np.nan)

    def pixels(self, grid: LocalGrid, row: Index, column: Index) -> tuple[Array, Array]:
        """Row and column, whole, to those among the centres of a grid's pixels, continuous."""
        return grid.indices(*self._site.to_local(*self.nodes.at(row, column)))

    def steps(self) -> Array:
        """[2, 2] m: displacement (north, east) of one row, and of one column, in the middle of the grid."""
        low, high = self._corners
        h = min(1.0, 0.01 * float(np.min(high - low)))
        around = (low + high) / 2 + h * np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]])
        at = np.stack(self.find(around[:, 0], around[:, 1]), axis=-1)
        slopes = np.stack([at[0] - at[1], at[2] - at[3]], axis=-1) / (2 * h)
        with np.errstate(all="ignore"):
            if not np.isfinite(slopes).all() or abs(np.linalg.det(slopes)) < 1e-30:
                return np.full((2, 2), np.nan)
            return np.linalg.inv(slopes).T

    def refuse_beyond(self, path: object, what: str, slack: float) -> None:
        """Refuse a grid that reaches more than `slack` rows or columns beyond the outer nodes of a file.

        Raises:
            GeoError: one line that says by how much, on which side, and whether it would not with longitude
                and latitude swapped.
        """
        if beyond := self._beyond(what, slack):
            hint = swapped_hint(
                self._site, lambda other: not View(self.nodes, other, self._grid)._beyond(what, slack)
            )
            raise GeoError(f"{path}: the area {beyond}{hint}")

    def _beyond(self, what: str, slack: float) -> str:
        """Return in words how far the grid reaches beyond the nodes; empty where it does not."""
        row, column = self.find(*self._grid.outline())
        steps, (rows, columns) = self.steps(), self.nodes.shape
        if np.isnan(row).all() or (np.isnan(steps).any() and not np.isnan(row).any()):
            return f"lies wholly beyond the {what}"
        over: dict[str, float] = {}
        for at, size, step, ends in (
            (row, rows, steps[0], True),
            (column, columns, steps[1], not self.nodes.cyclic),
        ):
            past = (-np.nanmin(at), np.nanmax(at) - (size - 1))
            for by, sense in zip(past, (-1.0, 1.0), strict=True):
                if by > slack and ends:
                    north, east = (sense * step).tolist()
                    along, names = (north, "south north") if abs(north) >= abs(east) else (east, "west east")
                    over[names.split()[along > 0]] = float((by - 0.5) * np.hypot(*step))
        if over:
            sides = " and ".join(f"{metres:.0f} m in the {side}" for side, metres in over.items())
            return f"reaches beyond the {what} by {sides}"
        gone = np.isnan(row).reshape(4, OUTLINE).mean(axis=1)
        tall, wide = self._corners[1] - self._corners[0]
        lost = dict(zip(("west", "east", "south", "north"), gone * (tall, tall, wide, wide), strict=True))
        sides = " and ".join(f"{m:.0f} m of its edge in the {side}" for side, m in lost.items() if m > 0)
        return sides and f"reaches beyond the {what} with {sides}"


def placed(
    what: object, array: xr.DataArray, site: Site, grid: LocalGrid, crs: Any = None
) -> tuple[xr.DataArray, Nodes]:
    """Find where the values of an array lie.

    Args:
        site: where local coordinates count from.
        grid: where values will be wanted, which is what two-dimensional coordinates are searched for.
        crs: reference system of x and y, as pyproj takes it, where the array has none.

    Returns:
        The array [rows, columns], with a coordinate `mask` if it has one, and its nodes. A last column that
        repeats the first one is left out.

    Raises:
        GeoError: one line; the array has no such coordinates, or they contradict themselves.
    """
    if array.ndim != 2:
        raise GeoError(f"{what} has dimensions {listed(array.dims)}, not two")
    axes = {name: axis for name, axis in array.coords.items() if axis.ndim}
    longitude, latitude = (
        next((axis for name, axis in axes.items() if is_degrees(name, axis.attrs, kind)), None)
        for kind in DEGREES
    )
    if longitude is None or latitude is None:
        x, y, own = _axis(array, "x"), _axis(array, "y"), None
        if stated := {key: value for key, value in _grid_mapping(array).items() if key != "GeoTransform"}:
            if (own := of_mapping(stated)) is None:
                raise GeoError(f"{what}: its grid mapping names no coordinate reference system")
        elif "crs" in array.attrs:
            own = as_crs(array.attrs["crs"], GeoError)
        system = agreed_crs(what, own, crs)
        if system is not None and x is not None and y is not None:
            return _on_axes(what, array, x, y, system)
        if system is not None and "GeoTransform" in _grid_mapping(array):
            return _masked(array), _on_pixels(what, array, system)
        longitude = _if_degrees(x) if longitude is None else longitude
        latitude = _if_degrees(y) if latitude is None else latitude
    if longitude is None or latitude is None:
        kind = "longitude" if longitude is None else "latitude"
        raise GeoError(
            f"{what} has no {kind} on its dimensions {listed(array.dims)}, nor x and y with a reference "
            "system: use gdalwarp -t_srs EPSG:4326"
        )
    if longitude.ndim == latitude.ndim == 2:
        places = (axis.transpose(*array.dims).values.astype(float) for axis in (longitude, latitude))
        return _masked(array), _scattered(what, *places, site=site, grid=grid)
    if not longitude.ndim == latitude.ndim == 1 or longitude.dims == latitude.dims:
        raise GeoError(f"{what}: longitude and latitude are neither two axes nor two grids of its dimensions")
    return _on_axes(what, array, longitude, latitude, None)


def _on_axes(
    what: object, array: xr.DataArray, across: xr.DataArray, along: xr.DataArray, system: CRS | None
) -> tuple[xr.DataArray, Nodes]:
    """`placed` of two axes: x and y of a reference system, or longitude and latitude without one."""
    array = _masked(array.transpose(*along.dims, *across.dims))
    x, y = np.asarray(across.values, float), np.asarray(along.values, float)
    degrees = _in_degrees(system)
    if degrees:
        if not np.isfinite(x).all():
            raise GeoError(f"{what}: longitude has values that are not finite")
        x = np.unwrap(x, period=360.0)
        if x.size > 2 and abs(x[-1] - x[0]) > 360.0 - 1e-6:
            x = x[:-1]  # the first meridian is given again at the end
        if np.abs(x).max() > 720.0 or abs(x[-1] - x[0]) > 360.0:
            raise GeoError(f"{what}: longitude runs from {x[0]:g} to {x[-1]:g}, which are no degrees")
        array = array.isel({array.dims[1]: slice(0, x.size)})
    for name, axis in zip(("longitude", "latitude") if degrees else "xy", (x, y), strict=True):
        if axis.size < 2:
            raise GeoError(f"{what}: {name} has {axis.size} value, at least two are needed")
        gaps = np.diff(axis)
        if not np.isfinite(axis).all() or not ((gaps > 0).all() or (gaps < 0).all()):
            raise GeoError(f"{what}: {name} neither rises nor falls throughout")
    if system is None and np.abs(y).max() > 90.001:
        raise GeoError(f"{what}: latitude reaches beyond 90 degrees")
    forward, backward = _forward(system), _backward(system)

    def find(longitude: Array, latitude: Array) -> tuple[Array, Array]:
        at_x, at_y = forward(longitude, latitude)
        return _index(y, at_y), _index(x, at_x)

    def at(row: Index, column: Index) -> tuple[Array, Array]:
        return backward(x[column % x.size], y[row])

    step = abs(x[-1] - x[0]) / (x.size - 1)
    cyclic = degrees and bool(abs(step * x.size - 360.0) < 0.01 * step)
    return array, Nodes(find, at, (y.size, x.size), float(x[0] + x[-1]) / 2 if degrees else None, cyclic)


def _on_pixels(what: object, array: xr.DataArray, system: CRS) -> Nodes:
    """Return nodes of a raster by the transformation from its pixels to coordinates."""
    c, a, b, f, d, e = (float(word) for word in str(_grid_mapping(array)["GeoTransform"]).split())
    matrix = np.array([[a, b], [d, e]])
    if not np.isfinite((*matrix.flat, c, f)).all() or not abs(np.linalg.det(matrix)) > 0.0:
        raise GeoError(f"{what}: its pixels have no size: {matrix.tolist()}")
    inverse, forward, backward = np.linalg.inv(matrix), _forward(system), _backward(system)

    def find(longitude: Array, latitude: Array) -> tuple[Array, Array]:
        x, y = forward(longitude, latitude)
        column, row = (by_x * (x - c) + by_y * (y - f) - 0.5 for by_x, by_y in inverse)
        return row, column

    def at(row: Index, column: Index) -> tuple[Array, Array]:
        return backward(
            *(a * (column + 0.5) + b * (row + 0.5) + c for (a, b), c in zip(matrix, (c, f), strict=True))
        )

    rows, columns = array.shape
    middle = float(a * columns / 2 + b * rows / 2 + c)
    return Nodes(find, at, (rows, columns), middle if _in_degrees(system) else None)


def _in_degrees(system: CRS | None) -> bool:
    return system is None or (system.is_geographic and system.axis_info[0].unit_name == "degree")


def _forward(system: CRS | None) -> Find:
    """Longitude and latitude, degrees, to coordinates of a system, in the turn of the longitude given."""
    if system is None or system == CRS.from_epsg(4326):
        return lambda longitude, latitude: (longitude, latitude)
    transformer, degrees = Transformer.from_crs("EPSG:4326", system, always_xy=True), _in_degrees(system)

    def forward(longitude: Array, latitude: Array) -> tuple[Array, Array]:
        x, y = transformer.transform(longitude, latitude)
        return x + 360.0 * np.round((longitude - x) / 360.0) if degrees else x, y

    return forward


def _backward(system: CRS | None) -> Find:
    """Coordinates of a system to longitude and latitude, degrees."""
    if system is None or system == CRS.from_epsg(4326):
        return lambda longitude, latitude: (longitude, latitude)
    return Transformer.from_crs(system, "EPSG:4326", always_xy=True).transform


def agreed_crs(what: object, own: CRS | None, given: Any) -> CRS | None:
    """Return the reference system of a file, which it has itself or else is given.

    Raises:
        GeoError: one line; both are there and differ, or it is neither geographic nor projected.
    """
    wanted = None if given is None else as_crs(given, GeoError)
    if own is not None and wanted is not None and not same_crs(own, wanted):
        raise GeoError(f"{what}: is in {own.name}, not in {wanted.name} as crs says")
    system = own or wanted
    if system is not None and not (system.is_geographic or system.is_projected):
        raise GeoError(f"{what}: {system.name} is neither geographic nor projected")
    return system


def _grid_mapping(array: xr.DataArray) -> dict[str, Any]:
    name = array.attrs.get("grid_mapping") or array.encoding.get("grid_mapping") or "spatial_ref"
    return dict(array.coords[name].attrs) if name in array.coords else {}


def _axis(array: xr.DataArray, name: str) -> xr.DataArray | None:
    """Return the axis that is x or y by its standard name or its own."""
    for key, axis in array.coords.items():
        standard = axis.attrs.get("standard_name", "")
        if axis.ndim == 1 and (standard == f"projection_{name}_coordinate" or str(key).lower() == name):
            return axis
    return None


def _if_degrees(axis: xr.DataArray | None) -> xr.DataArray | None:
    """Return an axis x or y that may be degrees, as plain grids call longitude and latitude."""
    plain = axis is not None and str(axis.attrs.get("units", "")).lower() in ("", "degree", "degrees")
    return axis if plain else None


def is_degrees(name: Any, attributes: Mapping[Any, Any], kind: str) -> bool:
    """Return whether a variable is a "longitude" or "latitude", by standard name, units or its own name."""
    if standard := str(attributes.get("standard_name", "")).lower():
        return standard == kind
    named = re.fullmatch(rf"(nav_)?{kind[:3]}({kind[3:]})?(_\w+)?", str(name), re.IGNORECASE)
    return named is not None or DEGREES[kind].fullmatch(str(attributes.get("units", ""))) is not None


def _masked(array: xr.DataArray) -> xr.DataArray:
    """Return the array with its mask, if it has one, as coordinate `mask` of the same order."""
    for name in _MASKS:
        if name in array.coords and set(array.coords[name].dims) == set(array.dims):
            return array.assign_coords(mask=array.coords[name].transpose(*array.dims).variable)
    return array


def _index(axis: Array, at: Array) -> Array:
    """Fractional index along a monotonic axis, going on beyond its ends at the pace of its ends."""
    if axis[0] > axis[-1]:
        axis, at = -axis, -at
    last = axis.size - 1
    inside = np.interp(at, axis, np.arange(axis.size, dtype=float))
    before, after = (at - axis[0]) / (axis[1] - axis[0]), last + (at - axis[-1]) / (axis[-1] - axis[-2])
    return np.where(at < axis[0], before, np.where(at > axis[-1], after, inside))


def _scattered(what: object, longitude: Array, latitude: Array, *, site: Site, grid: LocalGrid) -> Nodes:
    """Return nodes of two-dimensional coordinates, interpolated on triangles of local metres."""
    north, east = site.to_local(longitude, np.clip(latitude, -90.0, 90.0))
    known = np.isfinite(north) & np.isfinite(east) & (np.abs(latitude) <= 90.0)
    if known.sum() < 4 or min(longitude.shape) < 2:
        raise GeoError(f"{what}: its longitudes and latitudes are no grid")
    if Curvilinear(np.asarray(longitude, float), np.asarray(latitude, float)).folds:
        raise GeoError(f"{what}: its longitudes and latitudes contradict each other, the grid folds")
    middle = (np.asarray(grid.lower) + np.asarray(grid.upper)) / 2
    gap = np.where(known, np.hypot(north - middle[0], east - middle[1]), np.inf)
    i, j = np.unravel_index(np.argmin(gap), gap.shape)
    around = gap[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]
    reach = np.hypot(*(np.asarray(grid.upper) - grid.lower)) / 2 + 4 * np.max(
        around, where=np.isfinite(around), initial=0.0
    )
    rows, columns = np.nonzero(gap <= reach)
    part = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    r, c = np.nonzero(known[part])
    index = np.stack([r + rows.min(), c + columns.min()], axis=-1).astype(float)
    places = np.stack([north[part][r, c], east[part][r, c]], axis=-1)
    try:
        lookup = scipy.interpolate.LinearNDInterpolator(places, index)
    except scipy.spatial.QhullError:
        raise GeoError(f"{what}: its longitudes and latitudes are no grid") from None

    def find(longitude: Array, latitude: Array) -> tuple[Array, Array]:
        found = lookup(*site.to_local(longitude, latitude))
        return found[..., 0], found[..., 1]

    def at(row: Index, column: Index) -> tuple[Array, Array]:
        return longitude[row, column], latitude[row, column]

    return Nodes(find, at, longitude.shape)  # type: ignore[arg-type]


def nearest(values: NDArray, row: Array, column: Array, cyclic: bool = False) -> NDArray:
    """Return the value of the nearest node, held beyond the outer ones; [rows, columns] at row and column."""
    i = np.clip(np.rint(row), 0, values.shape[0] - 1).astype(int)
    j = np.rint(column).astype(int)
    return values[i, j % values.shape[1] if cyclic else np.clip(j, 0, values.shape[1] - 1)]


def bilinear(values: NDArray, row: Array, column: Array) -> Array:
    """Bilinear interpolation of [rows, columns], held beyond the outer nodes.

    NaN where a node that bears on the place is NaN: a missing value spreads, it is never guessed.
    """
    nowhere = np.isnan(row) | np.isnan(column)
    total = np.where(nowhere, np.nan, 0.0)
    for weight, corner in _corners(values.shape, np.where(nowhere, 0.0, row), np.where(nowhere, 0.0, column)):
        total += np.where(weight > 0.0, weight * values[corner], 0.0)
    return total


def _corners(shape: tuple[int, ...], row: Array, column: Array) -> list[tuple[Array, tuple[Index, Index]]]:
    """Weights of a bilinear interpolation, held beyond the outer nodes, and the nodes that they are of."""
    rows, columns = shape
    row, column = np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)
    i = np.minimum(np.floor(row).astype(int), max(rows - 2, 0))
    j = np.minimum(np.floor(column).astype(int), max(columns - 2, 0))
    a, b = row - i, column - j
    up, right = np.minimum(i + 1, rows - 1), np.minimum(j + 1, columns - 1)
    return [
        ((1 - a) * (1 - b), (i, j)),
        ((1 - a) * b, (i, right)),
        (a * (1 - b), (up, j)),
        (a * b, (up, right)),
    ]


def closer(row: Array, column: Array) -> NDArray[np.bool_]:
    """Return at which places [n, m] nodes lie closer to each other than places do.

    Args:
        row, column: [n + 2, m + 2], where the places [n, m] and those around them lie among the nodes.
    """
    per_place = []
    for at in (row, column):
        north, east = np.abs(np.diff(at[:, 1:-1], axis=0)), np.abs(np.diff(at[1:-1], axis=1))
        # Those at the edges may be half a step away.
        north, east = np.fmax(north[:-1], north[1:]), np.fmax(east[:, :-1], east[:, 1:])
        per_place.append(np.hypot(north, east))
    return np.fmax(*per_place) > _STRETCH


def least_around(values: NDArray, row: Array, column: Array) -> NDArray:
    """Least of the nodes on which anything bears between each place and those around it, [n, m].

    Args:
        values: [rows, columns]; NaN is left out.
        row, column: [n + 2, m + 2], where the places [n, m] and those around them lie among the nodes.

    Returns:
        NaN where all nodes are NaN.
    """
    n, m = row.shape[0] - 2, row.shape[1] - 2
    spans = []
    for at, size in zip((row, column), values.shape, strict=True):
        near = [at[i : i + n, j : j + m] for i in range(3) for j in range(3)]
        ends = np.floor(reduce(np.fmin, near)), np.ceil(reduce(np.fmax, near))
        spans.append([np.clip(np.nan_to_num(end), 0, size - 1).astype(int) for end in ends])
    top = spans[0][0].min()
    values, spans[0] = values[top : spans[0][1].max() + 1], [end - top for end in spans[0]]
    # Of windows whose sides are powers of two four cover any rectangle.
    sides = [np.frexp(last - first + 1)[1] - 1 for first, last in spans]
    found = np.full((n, m), np.nan, values.dtype)
    for tall in range(sides[0].max() + 1):
        values = _doubled(values, tall)
        windows, own = values.T, sides[0] == tall
        for wide in range(sides[1].max(where=own, initial=-1) + 1):
            windows = _doubled(windows, wide)
            here = own & (sides[1] == wide)
            if here.any():
                i, j = (
                    (first[here], last[here] + 1 - 2**side)
                    for (first, last), side in zip(spans, (tall, wide), strict=True)
                )
                found[here] = reduce(np.fmin, [windows[b, a] for a in i for b in j])
    return found


def _doubled(windows: NDArray, power: int) -> NDArray:
    """Return the least values in windows of 2**power rows from those in windows of half as many."""
    half = 2**power // 2
    return np.fmin(windows[:-half], windows[half:]) if half else windows


def fall(own: Array, i: Array, j: Array, most: Array) -> Array:
    """By how much nodes are to fall for their bilinear interpolation not to exceed values at places, [n, m].

    What is too much at a place is taken from the nodes around it in proportion to their weights, but no node
    that is water becomes land as long as the value is water. Each falls by the most that is asked of it.

    Args:
        own: [n, m] m below the surface, of the nodes; one that is NaN asks nothing of those around it.
        i, j: [P], where the places lie among the nodes; those half a node beyond the outer ones, whose values
            hold there, ask too, those farther out nothing.
        most: [P] m below the surface; NaN asks nothing.
    """
    found, inside = np.zeros(own.shape), np.isfinite(most)
    for at, count in zip((i, j), own.shape, strict=True):
        inside &= (at >= -0.5 - 1e-6) & (at <= count - 0.5 + 1e-6)
    most, corners = most[inside], _corners(own.shape, i[inside], j[inside])
    weights = np.stack([weight for weight, _ in corners])
    nodes = np.stack([own[corner] for _, corner in corners])
    over = np.sum(weights * nodes, axis=0) - most
    asked = over > _SAME
    weights, nodes, over, most = weights[:, asked], nodes[:, asked], over[asked], most[asked]
    farthest = np.where(weights > 0.0, nodes - np.minimum(np.minimum(nodes.min(axis=0), most), _AWASH), 0.0)
    share = weights * over / np.sum(weights**2, axis=0)
    # At each round one more node may have fallen as far as it can.
    for _ in range(3):
        free = share < farthest
        left = over - np.sum(weights * farthest, axis=0, where=~free)
        pace = left / np.maximum(np.sum(weights**2, axis=0, where=free), 1e-30)
        share = np.minimum(np.where(free, weights * pace, farthest), farthest)
    for one, (_, (row, column)) in zip(share, corners, strict=True):
        np.maximum.at(found, (row[asked], column[asked]), one)
    return found


def fall_between(own: Array, i: Array, j: Array, values: NDArray) -> Array:
    """By how much places [n, m] are to fall for their interpolation to exceed that of nodes nowhere.

    Both are bilinear. Where places and nodes lie in rows and columns along each other, the first exceeds the
    second most at a node, or where a line between two nodes crosses one between places; where they are turned
    it is compared at every quarter of the nodes' cells as well. A plane stays as it is, but for its outermost
    places, which hold for half a place beyond.

    Args:
        own: [n, m] m below the surface, interpolated between the nodes.
        i, j: [rows, columns], where the nodes lie among the places; NaN where that is not known.
        values: [rows, columns] m below the surface, of the nodes.
    """
    places = _compared(np.stack([i, j, values]), own.shape)
    return reduce(np.maximum, (fall(own, *part) for part in places))


def _compared(nodes: Array, shape: tuple[int, ...]) -> Iterator[Array]:
    """Where `fall_between` compares: [3, P], i, j and value, from those of the nodes [3, rows, columns]."""
    yield nodes.reshape(3, -1)
    turned, (a, b) = False, (nodes.shape[1] - 1, nodes.shape[2] - 1)
    for one, other in ((nodes[..., :b], nodes[..., 1:]), (nodes[:, :a], nodes[:, 1:])):
        start, step = one.reshape(3, -1), (other - one).reshape(3, -1)
        known = np.isfinite(step).all(axis=0)
        start, step = start[:, known], step[:, known]
        far = np.abs(step[:2])
        turned |= bool((far.min(axis=0) > 0.03 * far.max(axis=0)).any())
        for axis in range(2):
            first = np.floor(np.minimum(start[axis], start[axis] + step[axis])) + 1.0
            between = (first + line for line in range(int(np.ceil(far[axis].max(initial=0.0)))))
            for line in (*between, -0.5, shape[axis] - 0.5):
                with np.errstate(invalid="ignore", divide="ignore"):
                    t = (line - start[axis]) / step[axis]
                met = (t > 0.0) & (t < 1.0)
                yield start[:, met] + t[met] * step[:, met]
    if turned:
        corners = np.stack([nodes[:, m : m + a, n : n + b] for m in (0, 1) for n in (0, 1)])
        for s, t in product(np.arange(5) / 4, repeat=2):
            shares = np.array([(1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t])
            yield np.tensordot(shares, corners, axes=1).reshape(3, -1)


def listed(names: Any) -> str:
    """Return names for a message, a dozen at most."""
    every = [str(name) for name in names]
    return ", ".join(every[:12]) + (" ..." if len(every) > 12 else "")
