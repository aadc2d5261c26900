"""Linear interpolation in the horizontal: which source points make up a place, and with what weights."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import Delaunay, KDTree, QhullError

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Smaller weights come from rounding: a source's own point must depend on itself alone.
_TINY = 1e-9
#: A place so near to a triangle, m, is in it: edges that are straight in degrees bulge in metres.
_SLACK = 0.5
#: At least so much of the weight must lie on points that have a value.
ENOUGH = 0.5 - 1e-9


@dataclass(frozen=True)
class Weights:
    """M places as mixtures of C source points each.

    Attributes:
        index: [M, C] source points.
        weight: [M, C], not negative, rows sum to 1, or to 0 where there is land.
        beyond: [M, 2] m north and east, from the nearest place that the source covers; 0 where it is covered.
    """

    index: Index
    weight: Array
    beyond: Array

    @property
    def outside(self) -> NDArray[np.bool_]:
        """[M], whether a place is not covered."""
        return (self.beyond != 0.0).any(axis=1)

    def matrix(self, points: int) -> csr_array:
        """Return the weights as a sparse matrix [M, points]."""
        places, corners = self.index.shape
        rows = np.repeat(np.arange(places), corners)
        return csr_array((self.weight.ravel(), (rows, self.index.ravel())), (places, points))


def weights_of(index: Index, weight: Array, beyond: Array) -> Weights:
    """Weights [M, C] rid of rounding, with rows that sum to 1."""
    clean = np.where(weight < _TINY, 0.0, weight)
    return Weights(index, clean / clean.sum(axis=1, keepdims=True), beyond)


def mix(matrix: csr_array, *fields: Array) -> tuple[Array, ...]:
    """Fields [F, P] at the places of a matrix [M, P], each [F, M].

    A point that lacks one of the fields lacks all. What is missing is left out; a place is missing where less
    than half of its weight is left.
    """
    return _mixed(lambda values: (matrix @ values.T).T, fields)


def mix_gathered(weight: Array, *fields: Array) -> tuple[Array, ...]:
    """`mix` of fields [M, C] that are already at hand at the corners of each place, each [M]."""
    return _mixed(lambda values: (weight * values).sum(axis=1), fields)


def _mixed(total: Callable[[Array], Array], fields: tuple[Array, ...]) -> tuple[Array, ...]:
    valid = np.logical_and.reduce([np.isfinite(field) for field in fields])
    left = total(valid.astype(float))
    there = left >= ENOUGH
    whole = np.where(there, left, 1.0)
    return tuple(np.where(there, total(np.where(valid, field, 0.0)) / whole, np.nan) for field in fields)


def along(axis: Array, value: Array) -> tuple[Index, Array, Array]:
    """Cell [M], share [M] of the way to the next node, and how far beyond the axis's ends [M].

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


def barycentric(points: Array, triangles: Index, places: Array) -> Weights:
    """Weights within triangles; a place in none of them is given to the nearest point.

    Args:
        points: [P, 2] m north and east.
        triangles: [N, 3] points.
        places: [M, 2] m north and east.
    """
    found = find_triangle(points, triangles, places)
    inside = found >= 0
    corners = triangles[np.where(inside, found, 0)]
    a, b, c = (points[corners[:, k]] for k in range(3))
    area = _cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        share_b, share_c = _cross(places - a, c - a) / area, _cross(b - a, places - a) / area
    weight = np.clip(np.stack([1.0 - share_b - share_c, share_b, share_c], axis=1), 0.0, 1.0)
    beyond = np.zeros_like(places)
    if not inside.all():
        used = np.unique(triangles)
        nearest = used[KDTree(points[used]).query(places[~inside])[1]]
        corners, weight = corners.copy(), weight.copy()
        corners[~inside] = nearest[:, None]
        weight[~inside] = (1.0, 0.0, 0.0)
        beyond[~inside] = places[~inside] - points[nearest]
    return weights_of(corners, weight, beyond)


def find_triangle(points: Array, triangles: Index, places: Array) -> Index:
    """Return the triangle [M] that holds each place, or is within `_SLACK` of it; -1 where none is."""
    # It takes a third of a second to import and is needed by curvilinear and unstructured grids only.
    from matplotlib.tri import Triangulation

    used, local = np.unique(triangles, return_inverse=True)
    local = local.reshape(triangles.shape)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    whole = np.flatnonzero(np.abs(_cross(b - a, c - a)) > 1e-6)
    if not len(whole):
        return np.full(len(places), -1, np.int64)
    y, x = points[used].T
    try:
        finder = Triangulation(x, y, local[whole]).get_trifinder()
    except RuntimeError:
        # Grids that overlap themselves, as tripolar ones do at their seam, are searched triangle by triangle.
        return search(points, triangles, whole, places)
    found = np.asarray(finder(places[:, 1], places[:, 0]), np.int64)
    found = np.where(found >= 0, whole[found], -1)
    out = np.flatnonzero(found < 0)
    if len(out):
        tree = shapely.STRtree(np.asarray(shapely.polygons(points[triangles[whole]]), object))
        at = np.asarray(shapely.points(places[out]), object).reshape(-1)
        place, triangle = tree.query(at, predicate="dwithin", distance=_SLACK)
        found[out[place]] = whole[triangle]
    return found


def triangulate(points: Array) -> Index:
    """Delaunay's triangles [N, 3] of points [P, 2]; none where the points lie on a line."""
    try:
        return np.asarray(Delaunay(points).simplices, np.int64)
    except (QhullError, ValueError):
        return np.zeros((0, 3), np.int64)


def search(points: Array, triangles: Index, whole: Index, places: Array) -> Index:
    """Return the triangle that holds each place among the sixteen with the nearest centres."""
    centres = points[triangles[whole]].mean(axis=1)
    nearest = KDTree(centres).query(places, k=min(16, len(whole)))[1]
    near = whole[np.reshape(nearest, (len(places), -1))]
    a, b, c = (points[triangles[near][..., k]] for k in range(3))
    place, area = places[:, None], _cross(b - a, c - a)
    shares = np.stack([_cross(place - a, c - a), _cross(b - a, place - a)]) / area
    holds = (shares >= -_TINY).all(axis=0) & (shares.sum(axis=0) <= 1.0 + _TINY)
    first = holds.argmax(axis=1)
    return np.where(holds.any(axis=1), near[np.arange(len(places)), first], -1)


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
