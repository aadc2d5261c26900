"""The cheap generator: numbers without visible pattern."""

import jax
import numpy as np
import pytest
from scipy import stats

from auvplan.bbo import random

uniform = jax.jit(random.uniform, static_argnums=1)


@pytest.fixture(scope="module")
def numbers() -> np.ndarray:
    """Of 400 keys, [400, 5000]."""
    keys = jax.random.split(jax.random.key(3), 400)
    return np.asarray(jax.jit(jax.vmap(lambda key: random.uniform(key, (5000,))))(keys))


def test_uniform_within_the_open_interval(numbers: np.ndarray) -> None:
    assert 0.0 < numbers.min() < 1e-4
    assert 1.0 - 1e-4 < numbers.max() < 1.0
    assert stats.kstest(numbers[:80].ravel(), "uniform").pvalue > 1e-3


def test_normal_numbers() -> None:
    numbers = np.asarray(jax.jit(random.normal, static_argnums=1)(jax.random.key(1), (300, 400)))
    assert np.isfinite(numbers).all()
    assert stats.kstest(numbers.ravel(), "norm").pvalue > 1e-3


@pytest.mark.parametrize("lag", [1, 2, 41, 150])
def test_pairs_fill_the_square(numbers: np.ndarray, lag: int) -> None:
    rows = numbers[:100]
    counts, _, _ = np.histogram2d(rows[:, :-lag].ravel(), rows[:, lag:].ravel(), bins=16)
    # Overlapping pairs make the statistic a little wider than chi-squared.
    assert stats.chisquare(counts.ravel()).pvalue > 1e-6


def test_keys_and_places_do_not_correlate(numbers: np.ndarray) -> None:
    between_keys = np.corrcoef(numbers)[np.triu_indices(400, 1)]
    between_places = np.corrcoef(numbers[:, :200].T)[np.triu_indices(200, 1)]
    assert np.abs(between_keys).max() < 6.0 / np.sqrt(5000)
    assert np.abs(between_places).max() < 6.0 / np.sqrt(400)
    assert np.std(between_keys) == pytest.approx(1.0 / np.sqrt(5000), rel=0.05)


def test_same_key_same_numbers() -> None:
    first = uniform(jax.random.key(5), (7, 3))
    np.testing.assert_array_equal(first, random.uniform(jax.random.key(5), (7, 3)))
    assert (first != uniform(jax.random.key(6), (7, 3))).all()
