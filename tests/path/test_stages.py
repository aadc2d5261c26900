"""A search is a few compiled programs, which others share."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import auvplan as ap
from auvplan.path import stages
from auvplan.path.cost import Track, evaluate
from auvplan.runtime.compiled import compilations, drop_programs
from tests.path.worlds import CONFIG, GOAL, START, world

PROGRAMS = 5  # passages, first population, gradient steps, evolution, the path that was found


@pytest.fixture(scope="module")
def planned():
    """A plan, and how many programs it took."""
    env, key = world(), jax.random.split(jax.random.key(0), 1)  # the split of one key is compiled here
    for function in (stages._trace, stages._begin):
        _ = function._jitted  # which asks once what options the compiler knows
    drop_programs()  # others may have planned with these settings
    before = compilations()
    plan = ap.plan_paths(START[None], GOAL[None], env, key=key, config=CONFIG)[0]
    return plan, compilations() - before


def test_a_first_plan_takes_as_many_programs_as_there_are_stages(planned):
    # One program more may resolve the obstacles of the world.
    assert PROGRAMS <= planned[1] <= PROGRAMS + 1


def test_a_re_plan_shares_all_but_the_making_of_its_population(planned):
    plan, key = planned[0], jax.random.key(1)
    before = compilations()
    args = plan.positions[20], float(plan.times[20]), plan.conditions.env
    ap.replan_path(plan, *args, key=key, config=plan.conditions.config)
    assert compilations() - before <= 2 + 1  # carried over, put together; and the split of a key


@pytest.mark.parametrize(
    "changes",
    [
        {"coast_margin": 25.0, "obstacle_margin": 1.0, "uncertain_price": 3.0},
        {"refine_steps": 9, "passage_steps": 6, "refine_step_size": 0.001},
        {"t_series": 2, "fresh_share": 0.5},
    ],
)
def test_numbers_among_the_settings_compile_nothing(planned, changes):
    plan = planned[0]
    config = plan.conditions.config.replace(**changes)
    keys = jax.random.split(jax.random.key(0), 1)
    before = compilations()
    other = ap.plan_paths(START[None], GOAL[None], plan.conditions.env, key=keys, config=config)
    assert compilations() == before
    assert np.isfinite(other.travel_time).all()


def test_the_margin_is_the_one_asked_for(planned):
    plan = planned[0]
    keys = jax.random.split(jax.random.key(0), 1)
    config = plan.conditions.config.replace(coast_margin=60.0, obstacle_margin=60.0)
    wider = ap.plan_paths(START[None], GOAL[None], plan.conditions.env, key=keys, config=config)[0]
    assert wider.feasible
    assert wider.clearance >= 60.0 > plan.clearance


def test_other_numbers_of_vortices_and_obstacles_compile_nothing(planned):
    plan = planned[0]
    env, config = plan.conditions.env, plan.conditions.config
    current = replace(
        env.current,
        centers=env.current.centers[:, :3],
        strength=env.current.strength[:, :3],
        radius=env.current.radius[:, :3],
    )
    fewer = replace(env, current=current, obstacles=jax.tree.map(lambda leaf: leaf[:2], env.obstacles))
    keys = jax.random.split(jax.random.key(0), 1)
    before = compilations()
    other = ap.plan_paths(START[None], GOAL[None], fewer, key=keys, config=config)[0]
    assert compilations() == before
    # By the time that the plan's own world gives, without what it was padded by.
    track = Track.through(*(np.asarray(axis)[:, None] for axis in other.positions.T))
    resolved = replace(fewer, obstacles=fewer.obstacles.resolved(fewer.current))
    trajectory = evaluate(track, np.float32(0.0), resolved, plan.conditions.vehicle, config)
    assert float(trajectory.travel_time[0]) == pytest.approx(other.travel_time, rel=1e-4)
    assert float(trajectory.clearance.min()) == pytest.approx(other.clearance, abs=0.1)


@pytest.mark.parametrize("aside", [-30.0, 20.0])
def test_the_old_path_is_bent_round_what_lies_on_it(planned, monkeypatch, aside):
    """Where no passage is found, the rest of the old path is polished out of an obstacle that came."""

    def none(batch, config, count, deep):
        passages, *rest = stages._no_passages(batch, planned[0].conditions.config)
        return passages, None, *rest

    monkeypatch.setattr(stages, "_trace", none)
    plan = planned[0]
    env, config = plan.conditions.env, plan.conditions.config
    here, there = plan.positions[10], plan.positions[40]
    along = (plan.positions[41] - plan.positions[39])[:2]
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    position = np.array(env.obstacles.position)
    position[0] = there + np.append(aside * across, 0.0)
    env = replace(env, obstacles=replace(env.obstacles, position=position))
    left = float(plan.times[-1] - plan.times[10])
    new = ap.replan_path(plan, here, float(plan.times[10]), env, key=jax.random.key(1), config=config)
    assert new.feasible
    assert new.travel_time < 1.1 * left
