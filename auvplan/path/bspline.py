"""Clamped uniform B-splines (Eq. 9) as a constant basis matrix: a curve is a matrix product."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def clamped_knots(controls: int, degree: int) -> Array:
    """Uniform knots on [0, 1] with full multiplicity at both ends, [controls + degree + 1]."""
    inner = np.linspace(0.0, 1.0, controls - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.ones(degree)])


def basis_at(parameter: Array, controls: int, degree: int) -> Array:
    """Blending functions B_{i,K} at each parameter by the Cox-de Boor recursion.

    Args:
        parameter: [S] in [0, 1].
        controls: number of control points n, more than `degree`.
        degree: of the polynomial pieces, K - 1 for a curve of order K; 3 is cubic.

    Returns:
        [S, n]; rows sum to one.

    Raises:
        ValueError: too few control points for the degree.
    """
    if controls <= degree:
        raise ValueError(f"{controls} control points are too few for degree {degree}")
    knots = clamped_knots(controls, degree)
    u = np.asarray(parameter, float)[:, None]
    last = controls - 1
    span = np.clip(np.searchsorted(knots, u[:, 0], side="right") - 1, degree, last)
    basis = (np.arange(len(knots) - 1)[None] == span[:, None]).astype(float)
    for order in range(1, degree + 1):
        left_width = knots[order:-1] - knots[: -order - 1]
        right_width = knots[order + 1 :] - knots[1:-order]
        left = np.divide(
            u - knots[: -order - 1], left_width, out=np.zeros_like(basis[:, :-1]), where=left_width > 0
        )
        right = np.divide(
            knots[order + 1 :] - u, right_width, out=np.zeros_like(basis[:, :-1]), where=right_width > 0
        )
        basis = left * basis[:, :-1] + right * basis[:, 1:]
    return basis


@lru_cache(maxsize=64)
def basis_matrix(samples: int, controls: int, degree: int) -> Array:
    """`basis_at` evenly spaced parameters from 0 to 1, [samples, controls]; read-only, cached."""
    basis = basis_at(np.linspace(0.0, 1.0, samples), controls, degree)
    basis.setflags(write=False)
    return basis


@lru_cache(maxsize=64)
def fit_matrix(samples: int, controls: int, degree: int) -> Array:
    """Least-squares control points from samples, [controls - 2, samples + 2]: inner points from a curve.

    Multiply with ``[curve samples, first point, last point]`` stacked: the two ends are interpolated and only
    the inner control points are fitted.
    """
    basis = basis_matrix(samples, controls, degree)
    inner = np.linalg.pinv(basis[:, 1:-1])
    fit = np.concatenate([inner, -inner @ basis[:, :1], -inner @ basis[:, -1:]], axis=1).astype(float)
    fit.setflags(write=False)
    return fit


def greville_abscissae(controls: int, degree: int) -> Array:
    """Parameters at which control points on a straight line reproduce uniform motion along it, [controls]."""
    knots = clamped_knots(controls, degree)
    return np.array([knots[i + 1 : i + degree + 1].mean() for i in range(controls)])
