"""Migration and mutation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.bbo import operators, rates

P, D = 12, 7


LAWS = {"linear": rates.linear_rates(P), "constant": rates.constant_rates(P)}
per_siv = jax.jit(lambda *given: operators.migrate_per_siv(*given, *LAWS["linear"]))
fig6 = jax.jit(lambda law, *given: operators.migrate_fig6(*given, *LAWS[law]), static_argnums=0)
mutate_uniform, mutate_gaussian = jax.jit(operators.mutate_uniform), jax.jit(operators.mutate_gaussian)


def draw(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).random(shape, np.float32)


def draw_sivs(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, D, (P, P))


@settings(max_examples=10, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=2, max_size=20).filter(lambda w: sum(w) > 0.01))
def test_alias_table_holds_the_exact_distribution(weights: list[float]) -> None:
    size = len(weights)
    threshold, alias = operators.alias_table(np.array(weights))
    mass = threshold.astype(float)
    np.add.at(mass, alias, 1.0 - threshold.astype(float))
    np.testing.assert_allclose(mass / size, np.array(weights) / sum(weights), atol=1e-6)


@pytest.mark.parametrize("size", [2, 5, 30])
def test_donors_follow_the_emigration_rate(size: int) -> None:
    emigration = rates.linear_rates(size)[1]
    grid = ((np.arange(200_000) + 0.5) / 200_000).astype(np.float32)
    donors = jax.jit(lambda uniform: operators.draw_donors(uniform, emigration))(grid)
    share = np.bincount(np.asarray(donors), minlength=size) / 200_000
    np.testing.assert_allclose(share, emigration / emigration.sum(), atol=2e-5 * size)


def test_a_uniform_next_to_one_draws_a_valid_donor() -> None:
    last = jnp.asarray([np.nextafter(np.float32(1.0), np.float32(0.0))])
    assert 0 <= int(operators.draw_donors(last, rates.linear_rates(150)[1])[0]) < 150


@pytest.mark.parametrize("migration", ["siv", "fig6"])
@pytest.mark.parametrize("kind", [np.int32, np.float32])
def test_migration_moves_values_only_within_their_siv(migration: str, kind: type) -> None:
    population = np.random.default_rng(9).permutation(P * D).reshape(P, D).astype(kind)
    if migration == "siv":
        found = per_siv(population, draw(0, P, D), draw(1, P, D))
    else:
        found = fig6("linear", population, draw(0, P), draw(1, P, P), draw_sivs(2))
    found = np.asarray(found)
    assert found.dtype == kind
    for column in range(D):
        assert set(found[:, column]) <= set(population[:, column])
    assert (found[0] == population[0]).all(), "the best habitat has immigration rate zero"
    assert (found != population).any()


def test_per_siv_migration_against_a_loop() -> None:
    population, decide, donor = draw(5, P, D), draw(1, P, D), draw(2, P, D)
    immigration, emigration = LAWS["linear"]
    expected = np.array(population)
    donors = np.asarray(jax.jit(lambda uniform: operators.draw_donors(uniform, emigration))(donor))
    for i in range(P):
        for k in range(D):
            if decide[i, k] < immigration[i]:
                expected[i, k] = population[donors[i, k], k]
    np.testing.assert_array_equal(per_siv(population, decide, donor), expected)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["linear", "constant"]))
def test_fig6_against_its_pseudo_code(seed: int, law: str) -> None:
    population, (immigration, emigration) = draw(seed, P, D), LAWS[law]
    who, sends, siv = draw(seed + 1, P), draw(seed + 2, P, P), draw_sivs(seed + 3)
    expected = population.copy()
    for i in range(P):
        if who[i] < np.float32(immigration[i]):
            for j in range(P):
                if j != i and sends[i, j] < np.float32(emigration[j]):
                    expected[i, siv[i, j]] = population[j, siv[i, j]]
    np.testing.assert_array_equal(fig6(law, population, who, sends, siv), expected)


def test_uniform_mutation_of_integers_reaches_both_bounds_evenly() -> None:
    rows, lower, upper = 4000, np.array([-2, 0], np.int32), np.array([2, 1], np.int32)
    found = mutate_uniform(
        np.zeros((rows, 2), np.int32), draw(0, rows, 2), draw(1, rows, 2), np.ones(rows), lower, upper
    )
    assert found.dtype == jnp.int32
    share = np.bincount(np.asarray(found[:, 0]) + 2, minlength=5) / rows
    np.testing.assert_allclose(share, 0.2, atol=0.03)
    assert set(np.asarray(found[:, 1]).tolist()) == {0, 1}


def test_mutation_respects_each_habitats_rate() -> None:
    rate, zeros, decide = np.array([0.0, 1.0, 0.5]), np.zeros((3, 2000)), draw(0, 3, 2000)
    for found in (
        mutate_uniform(zeros, decide, draw(1, 3, 2000), rate, 1.0, 2.0),
        mutate_gaussian(zeros, decide, np.ones((3, 2000)), rate, 0.1),
    ):
        np.testing.assert_allclose((np.asarray(found) > 0).mean(axis=1), rate, atol=0.04)
