"""The single-precision exponential against NumPy's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from auvplan.ocean.exponential import exponential


def test_single_precision_is_exact_to_rounding():
    x = -np.concatenate([np.linspace(0.0, 5.0, 10_001), np.geomspace(1e-8, 87.0, 2_001)]).astype(np.float32)
    exact = np.exp(x.astype(np.float64))
    assert (np.abs(exponential(jnp.asarray(x)) - exact) <= (4e-7 - 1e-7 * x) * exact).all()


def test_what_is_too_small_becomes_nothing():
    assert 0.0 <= float(exponential(jnp.float32(-1e6))) < 1.2e-38


@pytest.mark.usefixtures("x64")
def test_double_precision_is_the_usual_one():
    x = jnp.linspace(-50.0, 0.0, 101)
    np.testing.assert_array_equal(exponential(x), jnp.exp(x))


def test_slope_is_the_value():
    x = jnp.float32(-1.3)
    assert float(jax.grad(exponential)(x)) == float(exponential(x))
