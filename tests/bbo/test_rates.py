"""Species model: Eqs 3-5."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.stats import binom

from auvplan.bbo import BBOConfig, rates


@pytest.mark.parametrize("count", [1, 2, 10, 99, 400])
@pytest.mark.parametrize(("largest_in", "largest_out"), [(1.0, 1.0), (0.3, 0.3), (0.9, 0.3)])
def test_stationary_law_of_linear_rates_is_binomial(count, largest_in, largest_out) -> None:
    by_rank = rates.linear_rates(count + 1, largest_in, largest_out)
    law = rates.stationary_law(*(rate[::-1] for rate in by_rank))
    expected = binom.pmf(np.arange(count + 1), count, largest_in / (largest_in + largest_out))
    np.testing.assert_allclose(law, expected, atol=1e-6 * expected.max(), rtol=1e-6)


@pytest.mark.parametrize(("up", "down"), [(0.8, 0.2), (0.2, 0.8), (0.5, 0.5), (1.0, 1e-3)])
@pytest.mark.parametrize("size", [2, 30, 5000])
def test_stationary_law_of_constant_rates_is_geometric(size: int, up: float, down: float) -> None:
    law = rates.stationary_law(*rates.constant_rates(size, up, down))
    # From the likelier end on, so that powers underflow and nothing overflows.
    ratio = min(up / down, down / up)
    expected = ratio ** np.arange(size, dtype=float)
    expected /= expected.sum()
    np.testing.assert_allclose(law if up < down else law[::-1], expected, rtol=1e-9, atol=1e-300)


@settings(max_examples=15, deadline=None)
@given(st.integers(2, 30), st.integers(0, 2**32 - 1))
def test_stationary_law_balances_any_rates(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    up, down = rng.uniform(0.05, 1.0, (2, count + 1))
    law = rates.stationary_law(up, down)
    assert law.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(rates.species_derivative(law, up, down), 0.0, atol=1e-12)
    anything = rng.dirichlet(np.ones(count + 1))
    assert rates.species_derivative(anything, up, down).sum() == pytest.approx(0.0, abs=1e-12)


def test_derivative_and_step_by_hand() -> None:
    # Two species levels above zero: dP_0 = -lambda_0 P_0 + mu_1 P_1 and so on (Eq. 4).
    probability, up, down = np.array([0.5, 0.3, 0.2]), np.array([1.0, 0.4, 9.0]), np.array([9.0, 0.6, 0.7])
    expected = [-0.5 + 0.18, -(0.4 + 0.6) * 0.3 + 0.5 + 0.14, 0.12 - 0.14]
    np.testing.assert_allclose(rates.species_derivative(probability, up, down), expected)
    after = probability + 0.5 * np.array(expected)  # Eq. 3
    np.testing.assert_allclose(rates.species_step(probability, up, down, 0.5), after)


def linear_by_species(count: int) -> tuple[np.ndarray, np.ndarray]:
    """lambda_S and mu_S for S = 0..n under unit linear rates, [n + 1] each."""
    species = np.arange(count + 1)
    return 1.0 - species / count, species / count


def test_eq4_integrates_to_the_stationary_law() -> None:
    up, down = linear_by_species(12)
    start = np.eye(13)[0]
    solved = solve_ivp(
        lambda _, law: rates.species_derivative(law, up, down), (0.0, 200.0), start, rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(solved.y[:, -1], rates.stationary_law(up, down), atol=1e-7)


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 30), st.floats(0.0, 0.5), st.integers(0, 2**32 - 1))
def test_eq3_is_a_step_of_eq4_that_keeps_probabilities(count: int, dt: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    up, down = rng.uniform(0.0, 1.0, (2, count + 1))
    before = rng.dirichlet(np.ones(count + 1))
    after = rates.species_step(before, up, down, dt)
    assert after.sum() == pytest.approx(1.0)
    assert (after >= -1e-15).all()
    np.testing.assert_allclose(after, before + dt * rates.species_derivative(before, up, down), atol=1e-15)


@pytest.mark.parametrize("linear", [True, False])
def test_eq3_iterated_converges_to_the_stationary_law(linear: bool) -> None:
    up, down = linear_by_species(10) if linear else rates.constant_rates(11)
    law = np.eye(11)[0]
    for _ in range(2000):
        law = rates.species_step(law, up, down, 0.5)
    np.testing.assert_allclose(law, rates.stationary_law(up, down), atol=1e-12)


@pytest.mark.parametrize("dt", [-0.1, 1.7, np.nan])
def test_eq3_refuses_steps_that_would_leave_negative_probabilities(dt: float) -> None:
    with pytest.raises(ValueError, match="dt"):
        rates.species_step(np.full(3, 1 / 3), np.full(3, 0.3), np.full(3, 0.3), dt)


@settings(max_examples=20, deadline=None)
@given(
    st.sampled_from(["linear", "constant"]), st.integers(2, 300), st.floats(0.0, 1.0), st.floats(1e-6, 1.0),
    st.floats(0.0, 1.0),
)  # fmt: skip
def test_mutation_rate_stays_within_its_maximum(law, size, immigration, emigration, largest) -> None:
    config = BBOConfig(
        population=size, elites=1, rates=law, immigration=immigration, emigration=emigration,
        mutation_max=largest,
    )  # fmt: skip
    found = config.mutation_rate(dim=3)
    assert found.shape == (size,)
    assert ((found >= 0.0) & (found <= largest)).all()
    assert found.min() == 0.0  # the likeliest rank is spared


def test_under_linear_rates_most_ranks_mutate_at_nearly_the_maximum() -> None:
    found = rates.mutation_rates(*rates.linear_rates(100), 0.1)
    assert np.mean(found >= 0.9 * 0.1) == pytest.approx(0.79, abs=0.02)
    assert found.argmin() in (49, 50)


def test_under_the_constant_rates_of_the_mission_layer_the_best_are_spared() -> None:
    found = rates.mutation_rates(*rates.constant_rates(150), 0.5)
    np.testing.assert_allclose(found, 0.5 * (1.0 - 0.25 ** np.arange(150.0)))


def test_migration_rates() -> None:
    immigration, emigration = rates.linear_rates(5)
    np.testing.assert_allclose(emigration, np.linspace(1.0, 0.0, 5))
    np.testing.assert_allclose(immigration, 1.0 - emigration)
    immigration, emigration = rates.constant_rates(4)
    np.testing.assert_allclose(immigration, 0.8)
    np.testing.assert_allclose(emigration, 0.2)
