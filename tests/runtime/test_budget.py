"""Budgets of wall-clock time: whatever they are, the answer is a whole and valid one."""

import jax
import numpy as np
import pytest

import auvplan as ap
from auvplan.mission import random_graph
from tests.executive.small import light_config, planning, scenario

#: s; far too short, and more than is needed.
BUDGETS = 1e-6, 0.05, 60.0


def world():
    rocks = ap.Obstacles.static([[900.0, 800.0, 0.0], [1500.0, 1300.0, 0.0]], [120.0, 150.0])
    stream = ap.UniformCurrent(0.3, -0.2, 0.0)
    return ap.Environment(stream, obstacles=rocks, lower=(0, 0, 0), upper=(2500, 2500, 0))


def settings():
    """With passages, gradients and a search."""
    light = light_config(scenario())
    return light.replace(refine_steps=10, refine_count=2, passages=4, passage_steps=12, field_cells=24)


ENDS = (200.0, 200.0, 0.0), (2200.0, 1900.0, 0.0)


@pytest.fixture(scope="module")
def unhurried():
    return ap.plan_path(*ENDS, world(), key=jax.random.key(0), config=settings())


@pytest.mark.slow
@pytest.mark.parametrize("budget", BUDGETS)
def test_a_path_in_time_is_whole(budget, unhurried):
    plan = ap.plan_path(*ENDS, world(), key=jax.random.key(0), config=settings(), budget=budget)
    np.testing.assert_allclose(plan.positions[[0, -1]], ENDS, atol=0.1)
    assert (np.diff(plan.times) > 0.0).all()
    assert np.isfinite(plan.cost)
    assert plan.population.shape == unhurried.population.shape
    assert plan.history.best.shape == unhurried.history.best.shape
    if budget == max(BUDGETS):
        assert plan.feasible
        assert plan.travel_time < 1.05 * unhurried.travel_time


@pytest.mark.slow
def test_paths_in_time_share_the_budget(unhurried):
    starts, goals = (np.tile(end, (3, 1)) for end in ENDS)
    plans = ap.plan_paths(starts, goals, world(), key=jax.random.key(0), config=settings(), budget=30.0)
    assert plans.feasible.all()
    anew = ap.replan_paths(
        [plans[k] for k in range(3)], np.stack([plans[k].positions[20] for k in range(3)]), np.full(3, 100.0),
        world(), key=jax.random.key(1), config=settings(), budget=30.0,
    )  # fmt: skip
    assert anew.feasible.all()


@pytest.mark.parametrize("budget", BUDGETS)
def test_a_route_in_time_keeps_all_rules(budget):
    rng = np.random.default_rng(0)
    graph = random_graph(rng, rng.uniform(0.0, 3000.0, (12, 3)) * (1, 1, 0), neighbours=4)
    config = ap.MissionConfig().replace(
        bbo=ap.MissionConfig().bbo.replace(population=24, iterations=24), seeds=10, beam_width=64
    )
    call = {"speed": 2.5, "key": jax.random.key(0), "config": config}
    route = ap.plan_mission(graph, 0, 11, 3000.0, budget=budget, **call)
    assert route.feasible
    assert route.time < 3000.0
    if budget == max(BUDGETS):
        assert route.priority >= ap.plan_mission(graph, 0, 11, 3000.0, **call).priority


@pytest.mark.parametrize("budget", [0.0, -1.0, float("nan")])
def test_budgets_are_positive(budget):
    with pytest.raises(ValueError, match="budget must be positive"):
        ap.plan_path(*ENDS, world(), key=jax.random.key(0), config=settings(), budget=budget)


@pytest.mark.slow
@pytest.mark.usefixtures("light_search")
def test_a_mission_may_be_planned_in_time():
    run = ap.run_mission(planning(budget=0.2), seed=0)
    assert run.success, run.reason
