"""Linear interpolation in a column of water."""

import numpy as np
from numpy.typing import NDArray

from auvplan.io.currents.series import Array


def at_depth(
    values: tuple[Array, ...], depths: Array, wanted: Array, floor: Array | None = None
) -> tuple[Array, ...]:
    """Return values of N columns at a depth.

    Between levels it is linear. Above the first level, the first holds. Below the deepest level that has a
    value, that holds down to the sea bed and no further than the next level; where the bed is not known, down
    to half-way to the next level, and without end below the last. Elsewhere there is no value, NaN.

    Args:
        values: each [K, N].
        depths: [K, N] or [K, 1] m, rising.
        wanted: [N] or [1] m.
        floor: [N] or [1] m, the sea bed; None where it is not known.

    Returns:
        Each [N].
    """
    count = len(depths)
    below = (depths < wanted).sum(axis=0)
    upper, lower = np.maximum(below - 1, 0), np.minimum(below, count - 1)
    first, second = _take(depths, upper), _take(depths, lower)
    with np.errstate(invalid="ignore"):  # columns of land have no levels: all are infinitely deep
        apart = np.where(second > first, second - first, np.inf)
        share = np.clip((wanted - first) / apart, 0.0, 1.0)
    share = np.where(lower == upper, 0.0, share)
    grounded = False if floor is None else wanted > floor
    found = []
    for field in values:
        above, beneath = _take(field, upper), _take(field, lower)
        between = np.where(share >= 1.0, beneath, above + share * (beneath - above))
        between = np.where(share <= 0.0, above, between)
        held = np.isnan(beneath) & (share < 1.0) | (below == count)
        dry = grounded if floor is not None else np.isnan(beneath) & (share > 0.5)
        result = np.where(held, np.where(dry, np.nan, above), between)
        found.append(np.where(np.isnan(first), np.nan, result))
    return tuple(found)


def _take(array: Array, level: NDArray[np.int64]) -> Array:
    """[N] or [1], each column's value at a level of its own; either argument may be of one column."""
    if level.size == 1:
        return array[int(level[0])]
    if array.shape[1] == 1:
        return array[level, 0]
    return np.take_along_axis(array, level[None], axis=0)[0]
