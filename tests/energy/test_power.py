"""Power models: tables, laws, batteries, and what a vehicle with one is to planners."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from auvplan.energy import Battery, PowerLaw, PowerModel, PowerTable
from auvplan.vehicle import Vehicle

TABLE = PowerTable([0.0, 0.5, 1.0, 1.5], [0.0, 14.0, 24.0, 60.0])


@pytest.mark.parametrize("xp", [np, jnp])
def test_a_table_is_linear_between_its_points_and_beyond_the_last(xp):
    found = TABLE(xp.asarray([0.0, 0.25, 0.5, 0.75, 1.5, 2.0]))
    np.testing.assert_allclose(found, [0.0, 7.0, 14.0, 19.0, 60.0, 96.0], rtol=1e-6)
    assert PowerTable([2.0, 3.0], [70.0, 150.0])(xp.asarray(1.0)) == 70.0


def test_a_law_has_finite_slopes_at_standstill():
    law = PowerLaw(10.0, 15.0, 2.5)
    assert float(law(2.0)) == pytest.approx(10.0 + 15.0 * 2.0**2.5)
    slopes = jax.grad(lambda law, v: law(v), argnums=(0, 1))(jax.tree.map(jnp.asarray, law), 0.0)
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(slopes))


def test_the_rate_adds_what_depth_and_turns_take():
    model = PowerModel(TABLE, hotel=20.0, payload=5.0, dive=100.0, climb=50.0, turning=10.0)
    assert float(model.power(1.0)) == 49.0
    assert float(model.rate(1.0, 0.2, -0.1)) == pytest.approx(49.0 + 20.0 + 1.0)
    assert float(model.rate(1.0, -0.2)) == pytest.approx(49.0 + 10.0)
    jitted = jax.jit(lambda model, v: model.rate(v, -0.2))
    assert float(jitted(model, 1.0)) == pytest.approx(59.0, rel=1e-6)


def test_the_usable_energy_is_what_age_and_cold_leave():
    battery = Battery(1000.0, 0.9, 0.8, 0.95)
    assert battery.usable_wh == pytest.approx(684.0)
    assert battery.usable_joules == pytest.approx(684.0 * 3600.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: PowerTable([0.0, 1.0], [0.0]), "speeds and watts must be as many"),
        (lambda: PowerTable([1.0, 1.0], [0.0, 2.0]), "speeds must rise"),
        (lambda: PowerTable([0.0, 1.0], [0.0, np.nan]), "propulsion watts"),
        (lambda: PowerLaw(-1.0, 1.0), "propulsion constant"),
        (lambda: PowerLaw(1.0, 1.0, 0.5), "propulsion exponent must be a number from 1 to 6"),
        (lambda: PowerModel(TABLE, hotel="20 W"), "power hotel must be a number"),
        (lambda: PowerModel(TABLE, turning=-1.0), "power turning"),
        (lambda: Battery(0.0), "battery capacity"),
        (lambda: Battery(100.0, usable=1.2), "battery usable"),
        (lambda: Battery(100.0, reserve=-0.1), "battery reserve"),
    ],
)
def test_what_is_no_power_is_refused_in_a_line(make, words):
    with pytest.raises(ValueError, match=words) as refused:
        make()
    assert "\n" not in str(refused.value)


def test_a_vehicle_without_its_power_is_what_it_was():
    plain, powered = Vehicle(2.0), Vehicle(2.0, power=PowerModel(TABLE))
    assert powered.without_power() == plain
    assert plain.without_power() is plain
    assert jax.tree.structure(powered.without_power()) == jax.tree.structure(plain)
    assert len(jax.tree.leaves(powered)) > len(jax.tree.leaves(plain))
    assert replace(powered, speed=1.0).power is powered.power
    with pytest.raises(TypeError, match="vehicle power must be a PowerModel, got float"):
        Vehicle(power=30.0)
