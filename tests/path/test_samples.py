"""Paths searched for in samples of a current, timed and judged in the current."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.path import stages

CONFIG = ap.PathConfig.quick().replace(finer=1, passages=0)
START, GOAL = (0.0, 0.0, 10.0), (4000.0, 0.0, 10.0)
KEY = jax.random.key(0)


@cache
def sea(scale):
    """Eddies of some size, a function of its own in each."""

    def current(x, y, z, t):
        return 0.4 * jnp.sin(y / scale), 0.4 * jnp.sin(x / scale), 0.0 * z

    return ap.Environment(current, lower=(-500, -2000, 10.0), upper=(4500, 2000, 10.0))


@cache
def planned(scale=600.0):
    return ap.plan_path(START, GOAL, sea(scale), key=KEY, config=CONFIG)


def test_a_path_found_in_samples_is_as_quick_and_timed_in_the_current():
    env, found = sea(600.0), planned()
    exact = ap.plan_path(START, GOAL, env, key=KEY, config=CONFIG.replace(sampled=False))
    assert 0.0 < found.sampling_error < 0.025
    assert 0.0 < found.sampling_time_error < found.travel_time * found.sampling_error
    assert exact.sampling_error == exact.sampling_time_error == 0.0
    assert "searched in samples" in repr(found)
    assert found.feasible
    assert found.travel_time == pytest.approx(exact.travel_time, rel=1e-3)
    for plan in (found, exact):
        assert float(ap.travel_time(plan.positions, env)) == pytest.approx(plan.travel_time, rel=1e-5)
        assert plan.conditions.env.current is env.current


def test_another_function_compiles_none_of_the_costly_programs():
    planned()
    costly = [program._ready for program in (stages._trace, stages._begin, stages._descend, stages._evolve)]
    before = [len(ready) for ready in costly]
    plan = ap.plan_path(START, GOAL, sea(800.0), key=KEY, config=CONFIG)
    assert plan.sampling_error > 0.0
    assert [len(ready) for ready in costly] == before


def test_plans_in_a_batch_and_alone_agree_in_samples():
    env, keys = sea(600.0), jax.random.split(KEY, 2)
    ends = np.array([START, (0.0, 500.0, 10.0)]), np.array([GOAL, (3500.0, -500.0, 10.0)])
    together = ap.plan_paths(*ends, env, key=keys, config=CONFIG)
    for b in range(2):
        alone = ap.plan_paths(*(end[b : b + 1] for end in ends), env, key=keys[b : b + 1], config=CONFIG)
        np.testing.assert_array_equal(together.positions[b], alone.positions[0])
        assert together.sampling_error[b] == alone.sampling_error[0] > 0.0


def test_a_replan_keeps_to_samples_of_its_own():
    env, plan = sea(600.0), planned()
    half = len(plan.times) // 2
    rest = ap.replan_path(plan, plan.positions[half], float(plan.times[half]), env, key=KEY, config=CONFIG)
    assert rest.feasible
    assert rest.sampling_error > 0.0
    assert rest.travel_time == pytest.approx(plan.times[-1] - plan.times[half], rel=5e-3)


@pytest.mark.slow
def test_a_front_is_searched_in_itself():
    def front(x, y, z, t):
        return jnp.where(y > 300.0, 0.8, -0.8), 0.0, 0.0

    env = ap.Environment(front, lower=(-500, -2000, 10.0), upper=(4500, 2000, 10.0))
    plan = ap.plan_path(START, GOAL, env, key=KEY, config=CONFIG)
    assert plan.feasible
    assert plan.sampling_error == 0.0


@pytest.mark.slow
def test_only_functions_are_sampled():
    env = replace(sea(600.0), current=ap.UniformCurrent(0.2))
    assert ap.plan_path(START, GOAL, env, key=KEY, config=CONFIG).sampling_error == 0.0


@pytest.mark.slow
def test_a_tide_past_a_drifting_obstacle_at_a_late_hour():
    """The obstacle drifts in the function, not in its samples; times are far from zero; depth is free."""

    def tide(x, y, z, t):
        return 0.3 * jnp.cos(t / 7000.0) - 0.002 * z, 0.2 * jnp.sin(x / 900.0 - t / 7000.0), 0.0

    obstacle = ap.Obstacles.afloat([[2000.0, 0.0, 20.0]], [150.0], observed_at=90_000.0)
    env = ap.Environment(tide, None, obstacle, lower=(-500, -2000, 0), upper=(4500, 2000, 40))
    plan = ap.plan_path(START, GOAL, env, key=KEY, config=CONFIG, depart=90_000.0)
    assert plan.feasible, plan.reason
    assert plan.sampling_error > 0.0
    assert plan.clearance >= CONFIG.obstacle_margin
    assert float(ap.travel_time(plan.positions, env, depart=90_000.0)) == pytest.approx(
        plan.travel_time, rel=1e-4
    )
