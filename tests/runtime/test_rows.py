"""Rows of a batch, on threads and padded: the same results in the same order, compiled once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from auvplan.runtime import rows


@pytest.fixture
def program():
    """Cumulative sums from a drawn start, and how often it was traced."""
    traced = []

    @jax.jit
    def call(keys, values):
        traced.append(values.dtype)
        starts = jax.vmap(jax.random.normal)(keys)
        return {"sum": starts[:, None] + jnp.cumsum(values, axis=1), "start": starts}

    call.traced = traced
    return call


def _batch(count: int):
    keys = jax.random.split(jax.random.key(3), count)
    return keys, np.random.default_rng(0).normal(size=(count, 5)).astype(np.float32)


@pytest.mark.parametrize("count", [1, 2, 7, 40])
def test_rows_equal_one_call(program, count):
    keys, values = _batch(count)
    found, whole = rows.batch_map(program, keys, values), program(keys, values)
    for name in whole:
        assert isinstance(found[name], np.ndarray)
        np.testing.assert_array_equal(found[name], whole[name])


def test_every_batch_uses_one_program(program):
    for count in (1, 3, 9):
        rows.batch_map(program, *_batch(count))
    assert len(program.traced) == 1


def test_precision_reaches_the_threads(program):
    keys, values = _batch(6)
    with jax.enable_x64(True):
        found = rows.batch_map(program, keys, values.astype(float))
    assert found["sum"].dtype == np.float64
    assert program.traced == [np.float64]


@pytest.mark.parametrize("count", [1, 4])
def test_a_batch_of_one_is_traced_without_its_axis(count):
    seen = []

    def one(key, values):
        seen.append("Batch" in type(values).__name__)
        start = jax.random.normal(key)
        return {"key": jax.random.fold_in(key, 1), "sum": start + jnp.cumsum(values), "start": start}

    keys, values = _batch(count)
    found, whole = jax.jit(rows.over_rows(one))(keys, values), jax.vmap(one)(keys, values)
    assert jax.tree.map(jnp.shape, found) == jax.tree.map(jnp.shape, whole)
    np.testing.assert_array_equal(*(jax.random.key_data(one["key"]) for one in (found, whole)))
    np.testing.assert_allclose(found["sum"], whole["sum"], rtol=1e-6)
    assert seen == [count > 1, True]


@pytest.mark.parametrize("count", [1, 5, 40, 130])
def test_padding_on_accelerators(program, count, monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    keys, values = _batch(count)
    found = rows.batch_map(program, keys, values)
    np.testing.assert_allclose(found["sum"], program(keys, values)["sum"], rtol=1e-6)


def test_errors_come_through():
    def fails(values):
        if values[0] == 2:
            raise ValueError("row 2")
        return values

    with pytest.raises(ValueError, match="row 2"):
        rows.batch_map(fails, np.arange(4))
