"""Migration and mutation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.bbo import operators, rates

P, D = 12, 7


def draw(seed: int, *shape: int) -> jax.Array:
    return jax.random.uniform(jax.random.key(seed), shape)


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
    grid = (jnp.arange(200_000) + 0.5) / 200_000
    share = np.bincount(np.asarray(operators.draw_donors(grid, emigration)), minlength=size) / 200_000
    np.testing.assert_allclose(share, emigration / emigration.sum(), atol=2e-5 * size)


def test_a_uniform_next_to_one_draws_a_valid_donor() -> None:
    last = jnp.asarray([np.nextafter(np.float32(1.0), np.float32(0.0))])
    assert 0 <= int(operators.draw_donors(last, rates.linear_rates(150)[1])[0]) < 150


def candidates(migration: str, population: jax.Array, seed: int) -> jax.Array:
    laws = rates.linear_rates(P)
    if migration == "siv":
        return operators.migrate_per_siv(population, draw(seed, P, D), draw(seed + 1, P, D), *laws)
    siv = jax.random.randint(jax.random.key(seed + 2), (P, P), 0, D)
    return operators.migrate_fig6(population, draw(seed, P), draw(seed + 1, P, P), siv, *laws)


@pytest.mark.parametrize("migration", ["siv", "fig6"])
@pytest.mark.parametrize("integer", [True, False])
def test_migration_moves_values_only_within_their_siv(migration: str, integer: bool) -> None:
    population = jax.random.permutation(jax.random.key(9), jnp.arange(P * D)).reshape(P, D)
    population = population if integer else population.astype(jnp.float32)
    found = candidates(migration, population, 0)
    assert found.dtype == population.dtype
    for column in range(D):
        assert set(np.asarray(found[:, column])) <= set(np.asarray(population[:, column]))
    assert (found[0] == population[0]).all(), "the best habitat has immigration rate zero"
    assert (found != population).any()


def test_per_siv_migration_against_a_loop() -> None:
    population = draw(5, P, D)
    immigration, emigration = rates.linear_rates(P)
    decide, donor = draw(1, P, D), draw(2, P, D)
    expected = np.array(population)
    donors = np.asarray(operators.draw_donors(donor, emigration))
    for i in range(P):
        for k in range(D):
            if decide[i, k] < immigration[i]:
                expected[i, k] = population[donors[i, k], k]
    found = operators.migrate_per_siv(population, decide, donor, immigration, emigration)
    np.testing.assert_array_equal(found, expected)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.booleans())
def test_fig6_against_its_pseudo_code(seed: int, constant: bool) -> None:
    population = np.asarray(draw(seed, P, D))
    immigration, emigration = rates.constant_rates(P) if constant else rates.linear_rates(P)
    who, sends = np.asarray(draw(seed + 1, P)), np.asarray(draw(seed + 2, P, P))
    siv = np.asarray(jax.random.randint(jax.random.key(seed + 3), (P, P), 0, D))
    expected = population.copy()
    for i in range(P):
        if who[i] < np.float32(immigration[i]):
            for j in range(P):
                if j != i and sends[i, j] < np.float32(emigration[j]):
                    expected[i, siv[i, j]] = population[j, siv[i, j]]
    found = operators.migrate_fig6(
        *(jnp.asarray(part) for part in (population, who, sends, siv)), immigration, emigration
    )
    np.testing.assert_array_equal(found, expected)


def test_uniform_mutation_of_integers_reaches_both_bounds_evenly() -> None:
    rows, lower, upper = 4000, jnp.array([-2, 0]), jnp.array([2, 1])
    found = operators.mutate_uniform(
        jnp.zeros((rows, 2), jnp.int32), draw(0, rows, 2), draw(1, rows, 2), jnp.ones(rows), lower, upper
    )
    assert found.dtype == jnp.int32
    share = np.bincount(np.asarray(found[:, 0]) + 2, minlength=5) / rows
    np.testing.assert_allclose(share, 0.2, atol=0.03)
    assert set(np.asarray(found[:, 1]).tolist()) == {0, 1}


def test_mutation_respects_each_habitats_rate() -> None:
    rate = jnp.array([0.0, 1.0, 0.5])
    zeros = jnp.zeros((3, 2000))
    fresh = operators.mutate_uniform(
        zeros, draw(0, 3, 2000), draw(1, 3, 2000), rate, jnp.array(1.0), jnp.array(2.0)
    )
    np.testing.assert_allclose((fresh > 0).mean(axis=1), rate, atol=0.04)
    step = operators.mutate_gaussian(zeros, draw(0, 3, 2000), jnp.ones((3, 2000)), rate, jnp.array(0.1))
    np.testing.assert_allclose((step > 0).mean(axis=1), rate, atol=0.04)
