"""B-splines (Eq. 9) against SciPy and their known properties."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from auvplan.path.bspline import basis_at, basis_matrix, clamped_knots, fit_matrix, greville_abscissae


@pytest.mark.parametrize(("controls", "degree"), [(4, 3), (5, 1), (7, 2), (12, 3), (18, 4)])
def test_matches_scipy(controls, degree):
    rng = np.random.default_rng(controls)
    points = rng.normal(size=(controls, 3))
    u = np.linspace(0.0, 1.0, 77)
    expected = BSpline(clamped_knots(controls, degree), points, degree)(u)
    np.testing.assert_allclose(basis_at(u, controls, degree) @ points, expected, atol=1e-12)


@pytest.mark.parametrize(("controls", "degree"), [(4, 3), (12, 3), (9, 2)])
def test_partition_of_unity_hull_and_ends(controls, degree):
    basis = basis_matrix(101, controls, degree)
    np.testing.assert_allclose(basis.sum(axis=1), 1.0, atol=1e-12)
    assert (basis >= -1e-15).all()
    np.testing.assert_allclose(basis[[0, -1]][:, [0, -1]], np.eye(2), atol=1e-12)


def test_greville_points_reproduce_a_straight_line():
    points = greville_abscissae(12, 3)
    np.testing.assert_allclose(basis_matrix(50, 12, 3) @ points, np.linspace(0, 1, 50), atol=1e-12)


def test_fit_recovers_control_points():
    rng = np.random.default_rng(0)
    points = rng.normal(size=12)
    curve = basis_matrix(128, 12, 3) @ points
    inner = fit_matrix(128, 12, 3) @ np.concatenate([curve, points[[0, -1]]])
    np.testing.assert_allclose(inner, points[1:-1], atol=1e-9)


def test_too_few_control_points():
    with pytest.raises(ValueError, match="too few"):
        basis_at(np.zeros(1), 3, 3)
