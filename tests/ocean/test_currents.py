"""Lamb vortices against a NumPy twin, their limits and symmetries, and their evolution (Eqs 1-2)."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import auvplan as ap
from auvplan.ocean import CurrentUpdate, FunctionCurrent, evolve
from auvplan.ocean.currents import as_current, is_steady
from auvplan.ocean.vortices import exponential, strength_for_peak_speed
from tests.ocean.grids import look_up


def naive(field, x, y, z):
    """Eq. 1 vortex by vortex, point by point."""
    out = np.zeros(3)
    depths = np.asarray(field.depths)
    for layer in range(len(depths)):
        weight = np.interp(z, depths, np.eye(len(depths))[layer]) if len(depths) > 1 else 1.0
        for k in range(field.strength.shape[1]):
            dx = x - float(field.centers[layer, k, 0])
            dy = y - float(field.centers[layer, k, 1])
            g, size = float(field.strength[layer, k]), float(field.radius[layer, k])
            r2 = dx * dx + dy * dy
            turn = g / (2 * np.pi * r2) * -np.expm1(-r2 / size**2) if r2 > 0 else g / (2 * np.pi * size**2)
            down = float(field.vertical_scale) * g / (2 * np.pi * size**2) * np.exp(-r2 / (2 * size**2))
            out += weight * np.array([-turn * dy, turn * dx, down])
    return out


def field_of(layers=3):
    return ap.random_vortices(
        jax.random.key(3), (0, 0, 0), (3000, 3000, 300), count=5, layers=layers, vertical_scale=20.0
    )


@pytest.mark.parametrize("layers", [1, 3])
@pytest.mark.usefixtures("x64")
def test_field_matches_numpy_twin(layers):
    field = field_of(layers)
    rng = np.random.default_rng(0)
    points = rng.uniform(-100, 3100, (40, 3)) * [1, 1, 0.12]
    got = look_up(field, *points.T, np.zeros(40)).T
    np.testing.assert_allclose(got, [naive(field, *p) for p in points], rtol=1e-9, atol=1e-12)


@pytest.mark.usefixtures("x64")
def test_centre_has_finite_value_and_solid_body_gradient():
    strength, radius = 900.0, 200.0
    field = ap.LambVortices([[[50.0, 70.0]]], [[strength]], [[radius]], vertical_scale=10.0)

    def velocity(p):
        return jnp.stack(field(p[0], p[1], jnp.array(0.0), jnp.array(0.0)))

    centre = jnp.array([50.0, 70.0])
    np.testing.assert_allclose(velocity(centre)[:2], 0.0, atol=1e-15)
    np.testing.assert_allclose(velocity(centre)[2], 10.0 * strength / (2 * np.pi * radius**2))
    rate = strength / (2 * np.pi * radius**2)
    np.testing.assert_allclose(jax.jacobian(velocity)(centre)[:2], [[0, -rate], [rate, 0]], atol=1e-15)


@pytest.mark.usefixtures("x64")
def test_profile_is_exact_near_the_centre():
    field = ap.LambVortices([[[0.0, 0.0]]], [[1000.0]], [[100.0]])
    radii = jnp.linspace(1.0, 40.0, 400)
    _, v, _ = look_up(field, radii, *np.zeros((3, 400)))
    exact = -1000.0 * np.expm1(-((np.asarray(radii) / 100.0) ** 2)) / (2 * np.pi * np.asarray(radii))
    np.testing.assert_allclose(v, exact, rtol=1e-11)


def test_padding_with_vortices_of_no_strength_changes_nothing():
    field = field_of(2)
    count = field.strength.shape[1]
    padded = field.padded(count + 3)
    assert padded.strength.shape == (len(field.strength), count + 3)
    x, y, z = np.random.default_rng(0).uniform(0.0, 3000.0, (3, 50))
    found, expected = (look_up(one, x, y, z, 0.0) for one in (padded, field))
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)
    stacked = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), field).padded(count + 3)
    np.testing.assert_array_equal(stacked.radius[1], padded.radius)
    with pytest.raises(ValueError, match="capacity"):
        field.padded(count - 1)


@given(speed=st.floats(0.1, 3.0), radius=st.floats(50.0, 2000.0))
@settings(max_examples=12, deadline=None)
def test_peak_speed_of_a_vortex(speed, radius):
    field = ap.LambVortices([[[0.0, 0.0]]], [[float(strength_for_peak_speed(speed, radius))]], [[radius]])
    r = np.linspace(0.02, 4.0, 800) * radius
    _, v, _ = look_up(field, r, *np.zeros((3, 800)))
    assert float(v.max()) == pytest.approx(speed, rel=1e-3)


def test_random_field_reaches_the_asked_speed():
    field = ap.random_vortices(jax.random.key(0), (0, 0, 0), (5000, 5000, 0), peak_speed=0.8)
    x, y = np.meshgrid(np.linspace(0, 5000, 64), np.linspace(0, 5000, 64))
    u, v, _ = np.asarray(look_up(field, x, y, 0.0 * x, 0.0 * x))
    assert float(np.sqrt(u**2 + v**2).max()) == pytest.approx(0.8, rel=1e-4)


def test_depth_interpolates_between_layers_and_holds_outside():
    field = field_of(3)
    place = 1200.0, 900.0

    def at(z):
        return np.asarray(look_up(field, *place, z, 0.0))

    np.testing.assert_allclose(at(75.0), 0.5 * (at(0.0) + at(150.0)), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(at(-50.0), at(0.0))
    np.testing.assert_allclose(at(900.0), at(300.0), rtol=1e-5)
    assert not np.allclose(at(0.0), at(300.0))


@pytest.mark.parametrize("layers", [1, 3])
@pytest.mark.usefixtures("x64")
def test_gradients_through_all_layers_match_finite_differences(layers):
    field, t = field_of(layers), jnp.zeros(2)
    points = jnp.array([[1200.0, 900.0, 40.0], [400.0, 2100.0, 260.0]])

    def total(points, field):
        return sum(jnp.sum(part * (k + 1.0)) for k, part in enumerate(field(*points.T, t)))

    jax.test_util.check_grads(jax.jit(lambda p: total(p, field)), (points,), 1, eps=1e-2, rtol=1e-6)
    strengths = field.strength
    jax.test_util.check_grads(
        jax.jit(lambda g: total(points, replace(field, strength=g))), (strengths,), 1, eps=1e-2, rtol=1e-6
    )


def test_more_layers_make_no_longer_program():
    def lines(layers):
        field, place = field_of(layers), jnp.zeros(7)
        return jax.jit(lambda *at: field(*at)).lower(place, place, place, place).as_text().count("\n")

    assert lines(3) == lines(6)


evolved = jax.jit(evolve, static_argnums=2)


def test_evolution_steps_have_the_asked_size_and_seed():
    many = ap.LambVortices(jnp.zeros((2, 4000, 2)), jnp.full((2, 4000), 100.0), jnp.full((2, 4000), 500.0))
    update = CurrentUpdate(rate=0.5, center_std=40.0, radius_std=10.0, strength_std=0.1, radius_floor=50.0)
    after = evolved(jax.random.key(1), many, update)
    np.testing.assert_allclose(np.std(after.centers, axis=1), 20.0, rtol=0.05)
    np.testing.assert_allclose(np.std(after.radius, axis=1), 5.0, rtol=0.05)
    np.testing.assert_allclose(np.std(after.strength, axis=1), 5.0, rtol=0.05)
    np.testing.assert_array_equal(after.centers[0], after.centers[1])  # layers move together
    again = evolved(jax.random.key(1), many, update)
    np.testing.assert_array_equal(after.centers, again.centers)
    other = evolved(jax.random.key(2), many, update)
    assert not np.array_equal(after.centers, other.centers)


def test_radius_keeps_above_its_floor_and_zero_rate_freezes():
    field = field_of(1)
    wild = evolve(jax.random.key(0), field, CurrentUpdate(radius_std=1e4, radius_floor=60.0))
    assert float(wild.radius.min()) >= 60.0
    frozen = evolve(jax.random.key(0), field, CurrentUpdate(rate=0.0, radius_floor=0.0))
    for before, after in zip(jax.tree.leaves(field), jax.tree.leaves(frozen), strict=True):
        np.testing.assert_array_equal(before, after)


def test_a_uniform_current_is_given_by_components():
    with pytest.raises(TypeError, match="one by one, as in UniformCurrent"):
        ap.UniformCurrent((0.3, 0.1))


def test_plain_functions_and_none_are_currents():
    tide = as_current(lambda x, y, z, t: (0.1 * t, 0.0, x))
    assert isinstance(tide, FunctionCurrent)
    assert not is_steady(tide)
    assert is_steady(as_current(lambda x, y, z, t: (0.1 * z, 0.0, x)))
    assert not is_steady(as_current(lambda x, y, z, t: (0.1 * z, 0.0, x + t)))
    u, v, w = tide(jnp.arange(3.0), jnp.zeros(3), jnp.zeros(3), jnp.full(3, 2.0))
    np.testing.assert_allclose([u, v, w], [[0.2] * 3, [0.0] * 3, [0, 1, 2]], rtol=1e-6)
    still = as_current(None)
    assert is_steady(still)
    np.testing.assert_array_equal(jnp.stack(still(jnp.ones(2), jnp.ones(2), jnp.ones(2), jnp.ones(2))), 0.0)
    with pytest.raises(TypeError, match="callable"):
        as_current(object())


def test_the_exponential_in_single_precision_is_exact_to_rounding():
    x = -np.concatenate([np.linspace(0.0, 5.0, 10_001), np.geomspace(1e-8, 87.0, 2_001)]).astype(np.float32)
    exact = np.exp(x.astype(np.float64))
    assert (np.abs(exponential(jnp.asarray(x)) - exact) <= (4e-7 - 1e-7 * x) * exact).all()


def test_an_exponential_that_is_too_small_is_nothing():
    assert 0.0 <= float(exponential(jnp.float32(-1e6))) < 1.2e-38


@pytest.mark.usefixtures("x64")
def test_the_exponential_in_double_precision_is_the_usual_one():
    x = jnp.linspace(-50.0, 0.0, 101)
    np.testing.assert_array_equal(exponential(x), jnp.exp(x))


def test_the_slope_of_the_exponential_is_its_value():
    x = jnp.float32(-1.3)
    assert float(jax.grad(exponential)(x)) == float(exponential(x))
