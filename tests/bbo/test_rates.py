"""Species model: Eqs 3-5."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.stats import binom

from auvplan.bbo import rates


@pytest.mark.parametrize("count", [1, 2, 10, 99, 400])
def test_stationary_law_is_binomial(count: int) -> None:
    expected = binom.pmf(np.arange(count + 1), count, 0.5)
    np.testing.assert_allclose(rates.species_law(count), expected, atol=1e-6 * expected.max(), rtol=1e-6)


def test_stationary_law_does_not_depend_on_the_common_scale() -> None:
    np.testing.assert_allclose(rates.species_law(30, 0.3, 0.3), rates.species_law(30), rtol=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 30), st.integers(0, 2**32 - 1))
def test_stationary_law_balances_any_rates(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    up, down = rng.uniform(0.05, 1.0, (2, count + 1))
    law = rates.stationary_law(up, down)
    assert law.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(rates.species_derivative(law, up, down), 0.0, atol=1e-12)
    anything = rng.dirichlet(np.ones(count + 1))
    assert rates.species_derivative(anything, up, down).sum() == pytest.approx(0.0, abs=1e-12)


def test_derivative_by_hand() -> None:
    # Two species levels above zero: dP_0 = -lambda_0 P_0 + mu_1 P_1 and so on (Eq. 4).
    probability, up, down = np.array([0.5, 0.3, 0.2]), np.array([1.0, 0.4, 9.0]), np.array([9.0, 0.6, 0.7])
    expected = [-0.5 + 0.18, -(0.4 + 0.6) * 0.3 + 0.5 + 0.14, 0.12 - 0.14]
    np.testing.assert_allclose(rates.species_derivative(probability, up, down), expected)


def test_eq4_integrates_to_the_stationary_law() -> None:
    count = 12
    species = np.arange(count + 1)
    up, down = 1.0 - species / count, species / count
    start = np.zeros(count + 1)
    start[0] = 1.0
    solved = solve_ivp(
        lambda _, law: rates.species_derivative(law, up, down), (0.0, 200.0), start, rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(solved.y[:, -1], rates.species_law(count), atol=1e-7)


@given(st.integers(2, 300), st.floats(0.0, 1.0))
@settings(max_examples=40, deadline=None)
def test_mutation_rate_stays_within_its_maximum(size: int, largest: float) -> None:
    found = rates.mutation_rates(size, largest)
    assert found.shape == (size,)
    assert (found >= 0.0).all()
    assert (found <= largest).all()


def test_most_ranks_mutate_at_nearly_the_maximum() -> None:
    found = rates.mutation_rates(100, 0.1)
    assert np.mean(found >= 0.9 * 0.1) == pytest.approx(0.79, abs=0.02)
    assert found.argmin() in (49, 50)


def test_migration_rates() -> None:
    immigration, emigration = rates.linear_rates(5)
    np.testing.assert_allclose(emigration, np.linspace(1.0, 0.0, 5))
    np.testing.assert_allclose(immigration, 1.0 - emigration)
    immigration, emigration = rates.constant_rates(4)
    np.testing.assert_allclose(immigration, 0.8)
    np.testing.assert_allclose(emigration, 0.2)
