"""The standard deviation of a dead-reckoned position against closed forms and drawn biases."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from auvplan.navigation import Navigation


def test_closed_forms():
    known = Navigation(drift=0.01, current_error=0.1, fix=5.0)
    assert known.std == pytest.approx(5.0, abs=1e-6)
    assert known.after(3000.0, 0.0).std == pytest.approx(np.hypot(5.0, 30.0))
    assert known.after(0.0, 600.0).std == pytest.approx(np.hypot(5.0, 60.0))
    assert known.after(3000.0, 600.0).std == pytest.approx(np.sqrt(5.0**2 + 30.0**2 + 60.0**2))
    assert known.after(3000.0, 600.0).fixed().std == known.std
    assert known.after(3000.0, 600.0).allowance == pytest.approx(2.0 * known.after(3000.0, 600.0).std)


def test_standard_deviation_of_drawn_biases():
    rng, known = np.random.default_rng(0), Navigation(drift=0.02, current_error=0.05, fix=4.0)
    legs = [(800.0, 400.0), (1200.0, 0.0), (500.0, 300.0)]  # m through the water, s out of bottom lock
    fix, bias, current = rng.normal(size=(3, 100_000, 2)) * np.array([4.0, 0.02, 0.05])[:, None, None]
    way = time = 0.0
    for more, unlocked in legs:
        known, way, time = known.after(more, unlocked), way + more, time + unlocked
        error = fix + bias * way + current * time
        assert error.std(axis=0) == pytest.approx(float(known.std), rel=0.02)


def test_it_grows_and_scales():
    known = Navigation(drift=0.02, current_error=0.05, fix=4.0, bottom_lock=30.0)
    grown = [float(known.after(10.0 * k, 5.0 * k).std) for k in range(50)]
    assert (np.diff(grown) > 0.0).all()
    far = known.after(1000.0, 200.0)
    assert float(far.scaled(jnp.asarray(3.0)).std) == pytest.approx(3.0 * float(far.std), rel=1e-6)
    assert float(far.scaled(jnp.asarray(3.0)).bottom_lock) == 90.0


def test_slopes_are_finite_where_nothing_is_uncertain():
    slopes = jax.grad(lambda known: known.std)(Navigation(*jnp.zeros(3)))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes))


@pytest.mark.parametrize("field", ["drift", "current_error", "fix", "bottom_lock", "confidence", "way"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), "3 m", [1.0]])
def test_bad_navigation_is_refused(field, value):
    with pytest.raises(ValueError, match=f"^navigation {field} must be a number, not negative"):
        Navigation(**{field: value})
