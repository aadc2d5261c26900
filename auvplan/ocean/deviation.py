"""Bounds on the difference between a current at a place and means of it around that place."""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.floating]

#: North, east, depth [m] and time [s] of the centres of boxes.
Places = Sequence[Array]

#: How far boxes reach along each, numbers or of their shape.
Edges = Sequence[Any]


@runtime_checkable
class Bounded(Protocol):
    """A current with a bound on its departure from means."""

    def deviation(self, places: Places, edges: Edges) -> Array | None:
        """Bound the departure of the current from means within boxes, m/s.

        In every box it is an upper bound on |c(mean of p) - mean of c(p)| for any points p of it and any
        weights: zero for a current that is linear there, and falling with the square of the size for a
        smooth one.

        Args:
            places: centres of boxes, north, east, depth, time, of one shape.
            edges: their lengths along each, numbers or of that shape.

        Returns:
            Of that shape; None where it is not known.
        """
        ...


def deviation(current: object, places: Places, edges: Edges) -> Array | None:
    """Return `Bounded.deviation` of a current; None where it has none."""
    return current.deviation(places, edges) if isinstance(current, Bounded) else None


def interpolation_deviation(
    fields: Sequence[Array], nodes: Sequence[Array], places: Places, edges: Edges, upward: bool = False
) -> Array:
    """Bound the departure of multilinear interpolation from means within boxes, in the fields' unit.

    Within a cell of the nodes it comes of mixed slopes, at most a quarter of slope times both edges for each
    pair of axes; at each plane of nodes in the box, of the jump of the slope across it, a quarter of jump
    times edge. (Along one axis a kink departs from chords by no more than that, and the product of two
    distances from their means has a mean of at most a quarter of the edges' product.)

    Args:
        fields: components of a vector, on the nodes.
        nodes: rising, along each axis; values are held beyond the outer ones.
        places, edges: of boxes along these axes.
        upward: of one field, only by how much it may exceed means: where slopes fall.
    """
    widest = [float(np.max(edge, initial=0.0)) for edge in edges]
    lines, cut = zip(*map(_held, nodes, places, widest), strict=True)
    parts = [np.asarray(field, float)[np.ix_(*cut)] for field in fields]
    count = len(lines)
    gaps = [_along(np.diff(line), k, count) for k, line in enumerate(lines)]
    # Nodes around a place that can lie in its box, and one more for the cell that it is in.
    reach = [int(np.ceil(0.5 * edge / gap.min())) + 1 for edge, gap in zip(widest, gaps, strict=True)]
    index = tuple(
        np.clip(np.searchsorted(line, place), 0, len(line) - 1)
        for line, place in zip(lines, places, strict=True)
    )
    total = np.zeros(np.shape(places[0]))
    for i in range(count):
        if widest[i] == 0.0:
            continue
        slopes = [np.diff(part, axis=i) / gaps[i] for part in parts]
        bends = [np.diff(slope, axis=i) for slope in slopes]
        jump = np.maximum(-bends[0], 0.0) if upward else np.sqrt(sum(bend**2 for bend in bends))
        jump = np.pad(jump, [(1, 1) if k == i else (0, 0) for k in range(count)])
        jump = ndimage.maximum_filter(jump, [1 if k == i else 2 * reach[k] + 1 for k in range(count)])
        sums = ndimage.convolve1d(jump, np.ones(2 * reach[i] + 1), axis=i, mode="constant")
        total = total + 0.25 * np.asarray(edges[i]) * sums[index]
        for j in range(i):
            if widest[j] == 0.0:
                continue
            twist = np.sqrt(sum((np.diff(slope, axis=j) / gaps[j]) ** 2 for slope in slopes))
            twist = np.pad(twist, [(0, 1) if k in (i, j) else (0, 0) for k in range(count)], mode="edge")
            twist = ndimage.maximum_filter(twist, [2 * span + 1 for span in reach])
            total = total + 0.25 * np.asarray(edges[i]) * np.asarray(edges[j]) * twist[index]
    return total


def _held(line: Array, place: Array, edge: float) -> tuple[Array, NDArray[np.int_]]:
    """Return the nodes of an axis about some places and one more at both ends, and whose values they have."""
    line = np.asarray(line, float)
    first = max(0, int(np.searchsorted(line, np.min(place) - edge)) - 2)
    last = min(len(line), int(np.searchsorted(line, np.max(place) + edge)) + 2)
    first = min(first, len(line) - 1)
    gap = line[1] - line[0] if len(line) > 1 else 1.0
    low = line[first - 1] if first > 0 else line[0] - gap
    high = line[last] if last < len(line) else line[-1] + gap
    return np.r_[low, line[first:last], high], np.clip(np.arange(first - 1, last + 1), 0, len(line) - 1)


def _along(values: Array, axis: int, count: int) -> Array:
    return values.reshape([-1 if k == axis else 1 for k in range(count)])
