"""Values between and at the nodes of a raster."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


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
