"""The cheap generator: numbers without visible pattern."""

import jax
import numpy as np
import pytest
from scipy import stats

from auvplan.bbo import random


def sample(count: int, shape: tuple[int, ...]) -> np.ndarray:
    keys = jax.random.split(jax.random.key(3), count)
    return np.asarray(jax.vmap(lambda key: random.uniform(key, shape))(keys)).reshape(count, -1)


def test_uniform_within_the_open_interval() -> None:
    numbers = sample(200, (40, 50))
    assert 0.0 < numbers.min() < 1e-4
    assert 1.0 - 1e-4 < numbers.max() < 1.0
    assert stats.kstest(numbers.ravel(), "uniform").pvalue > 1e-3


def test_normal_numbers() -> None:
    numbers = np.asarray(random.normal(jax.random.key(1), (300, 400)))
    assert np.isfinite(numbers).all()
    assert stats.kstest(numbers.ravel(), "norm").pvalue > 1e-3


@pytest.mark.parametrize("lag", [1, 2, 41, 150])
def test_pairs_fill_the_square(lag: int) -> None:
    numbers = sample(100, (4, 30, 41))
    counts, _, _ = np.histogram2d(numbers[:, :-lag].ravel(), numbers[:, lag:].ravel(), bins=16)
    # Overlapping pairs make the statistic a little wider than chi-squared.
    assert stats.chisquare(counts.ravel()).pvalue > 1e-6


def test_keys_and_places_do_not_correlate() -> None:
    numbers = sample(400, (5000,))
    between_keys = np.corrcoef(numbers)[np.triu_indices(400, 1)]
    between_places = np.corrcoef(numbers[:, :200].T)[np.triu_indices(200, 1)]
    assert np.abs(between_keys).max() < 6.0 / np.sqrt(5000)
    assert np.abs(between_places).max() < 6.0 / np.sqrt(400)
    assert np.std(between_keys) == pytest.approx(1.0 / np.sqrt(5000), rel=0.05)


def test_same_key_same_numbers() -> None:
    np.testing.assert_array_equal(
        random.uniform(jax.random.key(5), (7, 3)),
        jax.jit(random.uniform, static_argnums=1)(jax.random.key(5), (7, 3)),
    )
    assert (random.uniform(jax.random.key(5), (9,)) != random.uniform(jax.random.key(6), (9,))).all()
