"""Bounds on the difference between a current at a place and means of it around that place."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.floating]

#: North, east, depth [m] and time [s] of the centres of boxes.
Places = Sequence[Array]

#: How far boxes reach along each, numbers or of their shape.
Edges = Sequence[Any]


def deviation(current: object, places: Places, edges: Edges) -> Array | None:
    """Bound the departure of a current from means within boxes, m/s, by its own method of this name.

    In every box it is an upper bound on |c(mean of p) - mean of c(p)| for any points p of it and any
    weights: zero for a current that is linear there, and falling with the square of the size for a
    smooth one.

    Args:
        current: any; its method takes the other arguments and returns the same.
        places: centres of boxes, north, east, depth, time, of one shape.
        edges: their lengths along each, numbers or of that shape.

    Returns:
        Of that shape; None where it is not known.
    """
    own = getattr(current, "deviation", None)
    return own(places, edges) if own is not None else None


def interpolation_deviation(
    fields: Sequence[Array], nodes: Sequence[Array], places: Places, edges: Edges
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
    """
    widest = [float(np.max(edge, initial=0.0)) for edge in edges]
    lines, cut = zip(*map(_held, nodes, places, widest), strict=True)
    parts = [np.asarray(field, float)[np.ix_(*cut)] for field in fields]
    count, spans = len(lines), []
    gaps = [np.expand_dims(np.diff(line), [*range(k), *range(k + 1, count)]) for k, line in enumerate(lines)]
    for line, place, edge in zip(lines, places, edges, strict=True):
        # The first node within each box, and the first beyond it.
        half = 0.5 * np.asarray(edge)
        first = np.searchsorted(line, place - half, "right")
        spans.append((first, np.maximum(first, np.searchsorted(line, place + half, "left"))))
    # The node at or before each box's beginning, and how many there are at most from it to beyond its end.
    before = [np.clip(first - 1, 0, len(line) - 2) for (first, _), line in zip(spans, lines, strict=True)]
    across = [
        int(np.max(last - start, initial=1)) + 1 for (_, last), start in zip(spans, before, strict=True)
    ]
    total = np.zeros(np.shape(places[0]))
    for i in range(count):
        if widest[i] == 0.0:
            continue
        slopes = [np.diff(part, axis=i) / gaps[i] for part in parts]
        bends = [np.diff(slope, axis=i) for slope in slopes]
        jump = _most(
            np.sqrt(sum(bend**2 for bend in bends)), [1 if k == i else across[k] for k in range(count)]
        )
        # Jumps are at the nodes but the outer ones: sums of those before each.
        sums = np.pad(
            np.cumsum(jump, axis=i), [(2, 1) if k == i else (0, 0) for k in range(count)], mode="edge"
        )
        sums[tuple(slice(2) if k == i else slice(None) for k in range(count))] = 0.0
        ends = [sums[tuple(end if k == i else before[k] for k in range(count))] for end in spans[i]]
        total = total + 0.25 * np.asarray(edges[i]) * (ends[1] - ends[0])
        for j in range(i):
            if widest[j] == 0.0:
                continue
            twist = np.sqrt(sum((np.diff(slope, axis=j) / gaps[j]) ** 2 for slope in slopes))
            twist = _most(twist, [across[k] - (k in (i, j)) for k in range(count)])
            total = total + 0.25 * np.asarray(edges[i]) * np.asarray(edges[j]) * twist[tuple(before)]
    return total


def _most(values: Array, sizes: Sequence[int]) -> Array:
    """Return the most of a number of values along each axis, from each one on."""
    for axis, size in enumerate(sizes):
        values = scipy.ndimage.maximum_filter1d(values, size, axis=axis, origin=-(size // 2), mode="nearest")
    return values


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
