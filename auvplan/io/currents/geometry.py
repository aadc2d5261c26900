"""The places of a source's points: which make up a place, with what weights, and what to read for them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from auvplan.site import Site

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Smaller weights come from rounding: a source's own point must depend on itself alone.
_TINY = 1e-9
#: A place so near to a triangle, m, is in it: edges that are straight in degrees bulge in metres.
_SLACK = 0.5
#: At least this share of the weight must lie on points that have a value.
ENOUGH = 0.5 - 1e-9
#: Metres in a degree of latitude, near enough for telling how far outside a place is.
DEGREE = 111_195.0
#: Points farther apart than this many times the usual distance are no neighbours.
_TORN = 30.0
#: At the folds of sound grids up to this share of cells lies the other way round.
_FOLDED = 0.05
#: Places beyond an axis by less, in degrees, are taken to be on its end.
_EDGE = 1e-6

#: A run of indices of a dimension.
Run = slice | NDArray[np.int64]
#: The form's variables that define places, by name: their dimensions and values.
Coordinates = dict[str, tuple[tuple[str, ...], NDArray[Any]]]


@dataclass(frozen=True)
class Weights:
    """M places as mixtures of C source points each."""

    index: Index  # [M, C] source points
    weight: Array  # [M, C], not negative, rows sum to 1, or to 0 where there is land
    #: [M, 2] m north and east, from the nearest place that the source covers; 0 where it is covered.
    beyond: Array

    @property
    def outside(self) -> NDArray[np.bool_]:
        """[M], whether a place is not covered."""
        return (self.beyond != 0.0).any(axis=1)


@dataclass(frozen=True)
class Window:
    """The part of a source that is read."""

    picks: dict[str, Run]  # indices by dimension of the points
    used: Index  # [P] its points, in the order of the dimensions
    index: Index  # the points that were asked for, numbered as in the window


class _Grid:
    """Points in rows and columns."""

    longitude: Array
    latitude: Array
    dims: ClassVar[tuple[str, ...]]  # the form's, of rows and columns
    _around: ClassVar[bool] = False  # whether columns may run over the wrap-around of a globe

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of rows and columns."""
        return self.longitude.shape if self.longitude.ndim == 2 else (self.latitude.size, self.longitude.size)

    @property
    def coordinates(self) -> Coordinates:
        """The form's variables that define the places."""
        north, east = (self.dims, self.dims) if self.longitude.ndim == 2 else (self.dims[:1], self.dims[1:])
        return {"latitude": (north, self.latitude), "longitude": (east, self.longitude)}

    def window(self, index: Index) -> Window:
        """Return the rows and columns that hold some points, across the wrap-around if that is shorter."""
        runs, inside = {}, []
        for dim, size, used in zip(self.dims, self.shape, np.divmod(index, self.shape[1]), strict=True):
            run = _run(used, size if self._around and dim == self.dims[1] else None)
            order = np.argsort(run)
            runs[dim] = run if (np.diff(run) < 0).any() else slice(int(run[0]), int(run[-1]) + 1)
            inside.append((run, order[np.searchsorted(run[order], used)]))
        (rows, row), (columns, column) = inside
        used = (rows[:, None] * self.shape[1] + columns).ravel()
        return Window(runs, used, row * len(columns) + column)

    def places(self, index: Index) -> tuple[Array, Array]:
        """Longitude and latitude of points, degrees."""
        if self.longitude.ndim == 2:
            return self.longitude.ravel()[index], self.latitude.ravel()[index]
        row, column = np.divmod(index, self.shape[1])
        return self.longitude[column], self.latitude[row]


@dataclass(frozen=True)
class Regular(_Grid):
    """Points at every pair of a latitude and a longitude; these rise or fall, and may cross 180 degrees."""

    longitude: Array  # [nx] degrees
    latitude: Array  # [ny] degrees
    kind: str = "regular"
    torn: int = 0
    dims = ("latitude", "longitude")
    _around = True

    @cached_property
    def _axes(self) -> tuple[Array, Index, Array, Index]:
        """Rising latitudes and longitudes, and the row or column of each; round the globe the first again."""
        rows, columns = np.arange(len(self.latitude)), np.arange(len(self.longitude))
        east = np.unwrap(self.longitude, period=360.0)
        if self.latitude[0] > self.latitude[-1]:
            rows = rows[::-1]
        if east[0] > east[-1]:
            columns = columns[::-1]
        north, east = self.latitude[rows], east[columns]
        gap = east[0] + 360.0 - east[-1]
        if len(east) > 1 and 1e-6 < gap <= 1.5 * float(np.median(np.diff(east))):
            columns, east = np.append(columns, columns[0]), np.append(east, east[0] + 360.0)
        return north, rows, east, columns

    def locate(self, longitude: Array, latitude: Array) -> Weights:
        """Bilinear in latitude and longitude."""
        north, rows, east, columns = self._axes
        turned = east[0] + np.mod(longitude - east[0], 360.0)
        turned = np.where(turned - east[-1] > east[0] + 360.0 - turned, turned - 360.0, turned)
        row, up, north_of = along(north, latitude)
        column, right, east_of = along(east, turned)
        next_row, next_column = np.minimum(row + 1, len(north) - 1), np.minimum(column + 1, len(east) - 1)
        width = len(self.longitude)
        corners = (row, column), (row, next_column), (next_row, column), (next_row, next_column)
        index = np.stack([rows[j] * width + columns[i] for j, i in corners], axis=1)
        weight = [(1 - up) * (1 - right), (1 - up) * right, up * (1 - right), up * right]
        beyond = np.stack([north_of, east_of], axis=1)
        beyond = np.where(np.abs(beyond) < _EDGE, 0.0, beyond) * DEGREE
        beyond[:, 1] *= np.cos(np.deg2rad(latitude))
        return weights_of(index, np.stack(weight, axis=1), beyond)


@dataclass(frozen=True)
class Curvilinear(_Grid):
    """Curvilinear grid: points in rows and columns anywhere."""

    longitude: Array  # [ny, nx] degrees
    latitude: Array
    kind: str = "curvilinear"  # "curvilinear", or "roms" where velocities are on the cells' edges
    dims = ("y", "x")

    @property
    def torn(self) -> int:
        """How many sides of cells are too long to be any."""
        return sum(int((step > self.longest).sum()) for step in self.steps)

    @property
    def straight(self) -> bool:
        """Whether the rows are parallels and the columns meridians, or the other way round."""

        def even(east: int, north: int) -> bool:
            axes = (east, self.longitude), (north, self.latitude)
            return all(np.allclose(axis, axis.take([0], k), rtol=0.0, atol=1e-6) for k, axis in axes)

        return even(0, 1) or even(1, 0)

    @cached_property
    def steps(self) -> tuple[Array, Array]:
        """Distances, m, near enough, between neighbours along rows and along columns."""
        shrunk = np.cos(np.deg2rad(self.latitude))
        across, along = (
            DEGREE
            * np.hypot(_wrapped(np.diff(self.longitude, axis=k)) * part, np.diff(self.latitude, axis=k))
            for k, part in ((1, shrunk[:, 1:]), (0, shrunk[1:]))
        )
        return across, along

    @cached_property
    def longest(self) -> float:
        """Longest side, m, of a cell: beyond it the nodes are no neighbours."""
        usual = [float(np.median(step[step > 0.0])) for step in self.steps if (step > 0.0).any()]
        return _TORN * max(usual, default=np.inf)

    @property
    def folds(self) -> bool:
        """Whether a part of the cells lies the other way round than the rest."""
        east = [_wrapped(np.diff(self.longitude, axis=k)) for k in (1, 0)]
        north = [np.diff(self.latitude, axis=k) for k in (1, 0)]
        turn = east[0][:-1] * north[1][:, :-1] - east[1][:, :-1] * north[0][:-1]
        across, along = (step <= self.longest for step in self.steps)
        turn = turn[across[:-1] & across[1:] & along[:, :-1] & along[:, 1:] & (turn != 0.0)]
        return bool(min((turn > 0.0).sum(), (turn < 0.0).sum()) > _FOLDED * len(turn))

    def locate(self, longitude: Array, latitude: Array) -> Weights:
        """Linear in the two triangles of each cell, in metres about the places.

        Nodes without a place, as models leave them on land, are no corners; cells between nodes that lie far
        apart, as where models leave places at zero, are none.
        """
        middle, apart = bounds(longitude, latitude)
        placed = np.isfinite(self.longitude) & np.isfinite(self.latitude)
        near = placed.copy()
        for degrees, half in zip(offset(middle, self.longitude, self.latitude), apart, strict=True):
            # A cell may hold a place though none of its corners lies among the places.
            near &= np.abs(degrees) <= half + 2.0 * _cell_size(degrees) + 1e-9
        if not near.any():
            near.flat[nearest(self.longitude, self.latitude, middle)] = True  # far away: shows how far
        row, column = np.nonzero(near[:-1, :-1] | near[1:, :-1] | near[:-1, 1:] | near[1:, 1:])
        width = self.longitude.shape[1]
        first = row * width + column
        corners = np.stack([first, first + 1, first + width + 1, first + width], axis=1)
        triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
        triangles = triangles[placed.ravel()[triangles].all(axis=1)]
        lengths = edge_lengths(self.longitude.ravel(), self.latitude.ravel(), triangles)
        triangles = triangles[(lengths <= self.longest).all(axis=1)]
        if not len(triangles):
            triangles = np.full((1, 3), nearest(self.longitude, self.latitude, middle))
        return within((self.longitude, self.latitude), triangles, middle, longitude, latitude)


def edge_lengths(longitude: Array, latitude: Array, triangles: Index) -> Array:
    """[N, 3] m, near enough, of the edges of triangles [N, 3] of places in degrees."""
    east, north = longitude[triangles], latitude[triangles]
    over, up = _wrapped(np.roll(east, 1, axis=1) - east), np.roll(north, 1, axis=1) - north
    return DEGREE * np.hypot(over * np.cos(np.deg2rad(north)), up)


def bounds(longitude: Array, latitude: Array) -> tuple[Array, Array]:
    """Middle [2] and half the extent [2] of places, degrees east and north."""
    # Places on both sides of the antimeridian are turned to the first of them before they are compared.
    east = longitude[0] + _wrapped(longitude - longitude[0])
    spans = [(values.min(), values.max()) for values in (east, latitude)]
    return np.asarray([sum(span) / 2 for span in spans]), np.asarray([np.ptp(span) / 2 for span in spans])


def metres(middle: Array, longitude: Array, latitude: Array) -> Array:
    """[M, 2] m north and east of a place."""
    return np.stack(Site(float(middle[0]), float(middle[1])).to_local(longitude, latitude), axis=-1)


def offset(middle: Array, longitude: Array, latitude: Array) -> tuple[Array, Array]:
    """Degrees east, the shorter way round, and north of a place."""
    return _wrapped(longitude - middle[0]), latitude - middle[1]


def nearest(longitude: Array, latitude: Array, middle: Array) -> int:
    """Return the point nearest to a place, near enough for telling how far it is."""
    east, north = offset(middle, longitude, latitude)
    return int(np.nanargmin(np.hypot(east * np.cos(np.deg2rad(middle[1])), north)))


def within(
    points: tuple[Array, Array], triangles: Index, middle: Array, longitude: Array, latitude: Array
) -> Weights:
    """Linear in triangles [N, 3] of points in degrees, in metres about a place; the nearest point in none."""
    used, inverse = np.unique(triangles, return_inverse=True)
    nodes, local = metres(middle, *(axis.ravel()[used] for axis in points)), inverse.reshape(-1, 3)
    places = metres(middle, longitude, latitude)
    found = find_triangle(nodes, local, places)
    inside = found >= 0
    corners = local[np.where(inside, found, 0)]
    a, b, c = (nodes[corners[:, k]] for k in range(3))
    area = _cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        share_b, share_c = _cross(places - a, c - a) / area, _cross(b - a, places - a) / area
    weight = np.clip(np.stack([1.0 - share_b - share_c, share_b, share_c], axis=1), 0.0, 1.0)
    beyond = np.zeros_like(places)
    if not inside.all():
        nearest = np.asarray(KDTree(nodes).query(places[~inside])[1])
        corners[~inside] = nearest[:, None]
        weight[~inside] = (1.0, 0.0, 0.0)
        beyond[~inside] = places[~inside] - nodes[nearest]
    return weights_of(used[corners], weight, beyond)


def _wrapped(degrees: Array) -> Array:
    """Angles the shorter way round, in [-180, 180)."""
    return np.mod(degrees + 180.0, 360.0) - 180.0


def _cell_size(degrees: Array) -> Array:
    """[ny, nx], how far a coordinate moves to the next node, along rows plus along columns, at most."""
    size = np.zeros(degrees.shape)
    for axis in range(2):
        step = np.abs(_wrapped(np.diff(degrees, axis=axis)))
        ends = [[(0, 0), (0, 0)] for _ in range(2)]
        ends[0][axis], ends[1][axis] = (1, 0), (0, 1)
        size += np.fmax(*(np.pad(step, end) for end in ends))
    return size


def _run(used: Index, around: int | None) -> Index:
    """Return the shortest run of indices that holds some, over the end of an axis round the globe."""
    values = np.unique(used)
    if around is not None and len(values) > 1:
        gaps = np.diff(np.append(values, values[0] + around))
        first = (int(gaps.argmax()) + 1) % len(values)
        if first:
            return (values[first] + np.arange(around - int(gaps.max()) + 1)) % around
    return np.arange(values[0], values[-1] + 1)


def weights_of(index: Index, weight: Array, beyond: Array) -> Weights:
    """Weights [M, C] rid of rounding, with rows that sum to 1."""
    clean = np.where(weight < _TINY, 0.0, weight)
    return Weights(index, clean / clean.sum(axis=1, keepdims=True), beyond)


def mix(weights: csr_array | Array, *fields: Array) -> tuple[Array, ...]:
    """Fields [F, P] at the places of a matrix [M, P], each [F, M]; or [M, C] at the corners of each, [M].

    A point that lacks one of the fields lacks all. What is missing is left out; a place is missing where less
    than half of its weight is left.
    """

    def total(values: Array) -> Array:
        return (weights @ values.T).T if isinstance(weights, csr_array) else (weights * values).sum(axis=1)

    valid = np.logical_and.reduce([np.isfinite(field) for field in fields])
    left = total(valid.astype(float))
    there = left >= ENOUGH
    whole = np.where(there, left, 1.0)
    return tuple(np.where(there, total(np.where(valid, field, 0.0)) / whole, np.nan) for field in fields)


def along(axis: Array, value: Array) -> tuple[Index, Array, Array]:
    """Cell [M], share [M] of the distance to the next node, and how far beyond the axis's ends [M].

    Args:
        axis: [n] rising.
        value: [M] in the axis's unit; beyond the ends the nearest end holds.
    """
    held = np.clip(value, axis[0], axis[-1])
    if len(axis) == 1:
        return np.zeros(len(value), np.int64), np.zeros(len(value)), value - held
    cell = np.clip(np.searchsorted(axis, held, side="right") - 1, 0, len(axis) - 2)
    share = (held - axis[cell]) / (axis[cell + 1] - axis[cell])
    return cell, share, value - held


def find_triangle(points: Array, triangles: Index, places: Array) -> Index:
    """Return the triangle [M] that holds each place, or is within `_SLACK` of it; -1 where none is."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    whole = np.flatnonzero(np.abs(_cross(b - a, c - a)) > 1e-6)
    tree = shapely.STRtree(np.asarray(shapely.polygons(points[triangles[whole]]), object))
    found = np.full(len(places), -1, np.int64)
    looks: tuple[dict[str, Any], ...] = (
        {"predicate": "intersects"},
        {"predicate": "dwithin", "distance": _SLACK},
    )
    for how in looks:
        left = np.flatnonzero(found < 0)
        place, triangle = tree.query(np.asarray(shapely.points(places[left]), object).reshape(-1), **how)
        found[left[place]] = whole[triangle]
    return found


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
