"""Paths of least energy and their speeds against closed forms, a plain twin and the quickest paths."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.energy import PowerLaw, PowerModel, best_speed, cubic_best_speed, energy_of_plan
from auvplan.path import plan_least_energy, speeds_along
from tests.path import kernels
from tests.path.kernels import Layers, curves, evaluate, score

WAY, LIMITS = 2000.0, (0.3, 2.5)
ENDS = (0.0, 0.0, 5.0), (WAY, 0.0, 5.0)
LIGHT = ap.PathConfig.quick().replace(finer=1, refine_steps=0)
DEAR, CHEAP = (PowerModel(PowerLaw(0.0, 20.0), hotel=40.0, dive=dive, climb=200.0) for dive in (600.0, 20.0))


def sea(above=0.0, more=0.0):
    return ap.Environment(Layers.of(above, more), lower=(-500, -800, 0), upper=(WAY + 500, 800, 60))


@cache
def least(power, above=0.0, more=0.0, price=0.0):
    """A plan of least energy."""
    vehicle, settings = ap.Vehicle(power=power), {"key": jax.random.key(0), "config": LIGHT}
    return plan_least_energy(*ENDS, sea(above, more), vehicle, price=price, speeds=LIMITS, **settings)


@cache
def quickest(speed, above, more):
    """A plan by the same programs: a toll of nothing leaves the cost as it is."""
    vehicle = ap.Vehicle(speed, depth_toll=np.float64(0.0))
    return ap.plan_path(*ENDS, sea(above, more), vehicle, key=jax.random.key(0), config=LIGHT)


def speed_of(plan):
    return float(plan.conditions.vehicle.speed)


def test_a_toll_is_added_to_the_cost_for_each_metre_of_depth_and_none_leaves_the_cost_to_the_bit():
    env, vehicle, start, goal = sea(0.1, 0.4), ap.Vehicle(1.0), jnp.array(ENDS[0]), jnp.array(ENDS[1])
    rows = kernels.population(7, start, goal, env, LIGHT)
    plain, nothing, tolled = (
        score(rows, start, goal, 0.0, env, one, LIGHT)
        for one in (vehicle, replace(vehicle, depth_toll=0.0), replace(vehicle, depth_toll=3.0))
    )
    for before, after in zip(plain, nothing, strict=True):
        np.testing.assert_array_equal(before, after)
    track = curves(rows, start, goal, LIGHT)
    changes = np.abs(np.diff(np.asarray(track.places[2], float), axis=0)).sum(axis=0)
    assert changes.max() > 20.0
    np.testing.assert_allclose(tolled[0] - plain[0], 3.0 * changes, atol=1.0)
    np.testing.assert_array_equal(plain[1], tolled[1])
    price = evaluate(track, 0.0, env, replace(vehicle, depth_toll=3.0), LIGHT).price
    np.testing.assert_allclose(price, 3.0 * changes, atol=1.0)
    slope = jax.grad(
        lambda rows: score(rows, start, goal, 0.0, env, replace(vehicle, depth_toll=3.0), LIGHT)[0].sum()
    )
    assert np.isfinite(slope(rows)).all()  # the first of them is level


def test_tolls_are_seconds_that_a_metre_takes_at_the_power_of_the_speed():
    vehicle = ap.Vehicle(1.0).with_tolls(DEAR, price=20.0)
    assert vehicle.depth_toll == pytest.approx(0.5 * (600.0 + 200.0) / (60.0 + 20.0))
    assert ap.Vehicle(1.0).with_tolls(PowerModel(PowerLaw(0.0, 20.0))).depth_toll is None
    with pytest.raises(ValueError, match="depth_toll must be positive"):
        ap.Vehicle(depth_toll=-1.0)


@pytest.mark.parametrize(("current", "price"), [(0.0, 0.0), (-0.4, 30.0)])
def test_the_speed_in_a_uniform_current_is_that_of_the_closed_form(current, price):
    plan = least(DEAR, current, price=price)
    assert plan.feasible
    assert speed_of(plan) == pytest.approx(float(cubic_best_speed(40.0 + price, 20.0, current)), rel=5e-3)
    assert plan.travel_time == pytest.approx(WAY / (speed_of(plan) + current), rel=1e-3)
    alone, _ = speeds_along(plan, DEAR, price, LIMITS)
    np.testing.assert_allclose(alone, float(best_speed(DEAR, current, price=price, limits=LIMITS)), rtol=0.02)


def test_a_dive_that_is_dear_is_left_out_and_no_energy_is_above_that_of_the_quickest_path():
    level, deep = least(DEAR, 0.0, 0.3), least(CHEAP, 0.0, 0.3)
    assert level.positions[:, 2].max() < 6.0
    assert deep.positions[:, 2].max() > 30.0
    for plan, power in ((level, DEAR), (deep, CHEAP)):
        fast = quickest(speed_of(plan), 0.0, 0.3)
        assert fast.positions[:, 2].max() > 30.0
        assert plan.feasible
        assert energy_of_plan(plan, power) < 1.002 * energy_of_plan(fast, power)
    assert energy_of_plan(level, DEAR) < 0.95 * energy_of_plan(quickest(speed_of(level), 0.0, 0.3), DEAR)


def test_speeds_by_segment_take_no_more_than_one_speed_and_keep_its_limits():
    plan = least(CHEAP, -0.3, 0.6)
    speeds, times = speeds_along(plan, CHEAP, limits=LIMITS)
    seconds = np.diff(times)
    one = float(CHEAP.power(speed_of(plan))) * float(plan.travel_time)
    assert float((np.asarray(CHEAP.power(speeds)) * seconds).sum()) < one
    assert speeds.max() - speeds.min() > 0.1
    way = np.diff(np.asarray(plan.positions, float), axis=0)
    np.testing.assert_allclose(np.linalg.norm(way / seconds[:, None] - plan.water, axis=1), speeds, rtol=0.01)
    sinking = np.abs(way[:, 2] / seconds) / speeds
    moved = speeds != speed_of(plan)
    assert sinking[moved].max() <= np.sin(ap.Vehicle().pitch_max) * (1.0 + 1e-6)
    assert times[0] == plan.times[0]


def test_a_power_model_and_rising_speeds_are_asked_for():
    with pytest.raises(ValueError, match="need a power model"):
        plan_least_energy(*ENDS, sea(), ap.Vehicle(), key=jax.random.key(0))
    with pytest.raises(ValueError, match="positive and rising, got 2"):
        plan_least_energy(*ENDS, sea(), ap.Vehicle(power=DEAR), key=jax.random.key(0), speeds=(2.0, 1.0))
