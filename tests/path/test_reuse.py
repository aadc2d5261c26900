"""A re-plan lives off the population that it keeps (section 3.2.2, Fig. 5)."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.ocean.gridded import CurrentError
from auvplan.path import habitats, replan_path, replanner
from auvplan.path.bspline import basis_matrix
from auvplan.path.replanner import progress, replan_paths
from auvplan.runtime.budget import Budget

CONFIG = ap.PathConfig.paper().replace(
    bbo=ap.PathConfig.paper().bbo.replace(population=30, iterations=120),
    control_points=5,
    samples=48,
    t_series=60,
)


@pytest.fixture(scope="module")
def world():
    vortices = ap.LambVortices([[[900.0, 700.0], [1700.0, 1500.0]]], [[1500.0, -1800.0]], [[300.0, 350.0]])
    return ap.Environment(vortices, lower=(0, 0, 0), upper=(2500, 2500, 50))


@pytest.fixture(scope="module")
def plan(world):
    return ap.plan_path((200, 200, 20), (2300, 2200, 30), world, key=jax.random.key(0), config=CONFIG)


def test_the_paper_preset_is_the_plain_search(plan):
    paper = ap.PathConfig.paper()
    assert (paper.bbo.population, paper.bbo.iterations, paper.bbo.mutation_max) == (100, 100, 0.1)
    assert paper.refine_steps == 0
    assert plan.history.best.shape == (CONFIG.bbo.iterations + 1,)
    assert (np.diff(plan.history.best) <= 1e-3).all()
    assert plan.violation_history[-1] < plan.violation_history[0]


def time_left(plan, share: float) -> tuple[np.ndarray, float, float]:
    sample = int(share * (len(plan.times) - 1))
    return plan.positions[sample], float(plan.times[sample]), float(plan.times[-1] - plan.times[sample])


def excess(plan, world) -> float:
    """By what share two generations from a third of the way on are slower than the rest of the old path."""
    place, now, left = time_left(plan, 1.0 / 3.0)
    new = replan_path(plan, place, now, world, key=jax.random.key(1), config=CONFIG)
    assert new.feasible
    return new.travel_time / left - 1.0


def test_a_few_generations_keep_what_many_have_found(plan, world):
    assert CONFIG.window().bbo.iterations == 2
    assert excess(plan, world) < 0.02


def test_at_its_beginning_a_followed_plan_is_kept_as_it_is(plan, world):
    """Its very curve is among the habitats: a short search can only improve on it."""
    here, now = plan.positions[0], float(plan.times[0])
    new = replan_path(plan, here, now, world, key=jax.random.key(1), config=CONFIG)
    assert 0.999 * plan.travel_time < new.travel_time <= plan.travel_time * (1.0 + 1e-6)


def test_a_window_searches_its_share_and_keeps_the_size_of_the_population(plan, world, monkeypatch):
    budgets = []

    def budget_of(*given):
        budgets.append(given)
        return Budget(*given)

    monkeypatch.setattr(replanner, "Budget", budget_of)
    place, now, _ = time_left(plan, 1.0 / 3.0)
    for fresh in (0.0, 0.3):
        config = CONFIG.replace(fresh_share=fresh)
        unhurried, new = (
            replan_path(plan, place, now, world, key=jax.random.key(1), config=config, budget=budget)
            for budget in (None, 60.0)
        )
        assert len(new.history.best) == config.window().bbo.iterations + 1
        assert new.population.shape == plan.population.shape
        assert new.travel_time <= 1.001 * unhurried.travel_time
    assert budgets == [(60.0, 1)] * 2


def test_progress_is_that_of_the_nearest_sample():
    line = SimpleNamespace(positions=np.linspace([300.0, 100.0, 10.0], [400.0, 900.0, 50.0], 41))
    for k in (0, 1, 17, 39):
        assert progress(line, line.positions[k] + [0.0, 3.0, 0.0]) == k / 40
    assert 0.99 < progress(line, line.positions[-1]) < 1.0


def test_legs_together_are_planned_as_each_alone(plan, world):
    """By one key or a key for each, in one world or a world for each."""
    stronger = replace(world, current=replace(world.current, strength=1.3 * world.current.strength))
    places, times = zip(*(time_left(plan, share)[:2] for share in (0.25, 0.5)), strict=True)
    keys = jax.random.split(jax.random.key(5), 2)

    def alone(k, sea):
        """One leg by itself."""
        place = [plan], places[k][None], np.array([times[k]])
        return replan_paths(*place, sea, key=keys[k : k + 1], config=CONFIG)[0]

    stacked = replace(
        world,
        current=jax.tree.map(lambda *leaves: jnp.stack(leaves), world.current, stronger.current),
        obstacles=jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), world.obstacles),
    )
    legs = [plan, plan], np.stack(places), np.array(times)
    found = replan_paths(*legs, stacked, key=keys, config=CONFIG, world_per_leg=True)
    for k, sea in enumerate((world, stronger)):
        assert found[k].travel_time == pytest.approx(alone(k, sea).travel_time, rel=1e-5)
        np.testing.assert_array_equal(found[k].conditions.world().current.strength, sea.current.strength)
    together = replan_paths(*legs, world, key=jax.random.key(5), config=CONFIG)
    assert [one.travel_time for one in together] == [alone(k, world).travel_time for k in range(2)]


def test_a_place_that_no_path_leads_from_is_refused(plan, world):
    anywhere = {"key": jax.random.key(0), "config": CONFIG}
    with pytest.raises(ValueError, match=r"start of leg 0 .* lies outside the environment's bounds"):
        replan_path(plan, (-10.0, 200.0, 20.0), 0.0, world, **anywhere)
    with pytest.raises(ValueError, match="start and goal of leg 0 coincide"):
        replan_path(plan, plan.control_points[-1], 0.0, world, **anywhere)
    with pytest.raises(
        TypeError, match=r"vehicle must be a Vehicle, got float: give ap.Vehicle\(speed=2.5\)"
    ):
        replan_path(plan, plan.positions[9], 0.0, world, 2.5, **anywhere)
    with pytest.raises(TypeError, match="env must be an Environment"):
        replan_path(plan, plan.positions[9], 0.0, world.current, **anywhere)


def test_noise_in_place_of_the_kept_population_would_not(plan, world):
    """What the test above would see if the population were not kept."""
    span = np.asarray(plan.population).reshape(len(plan.population), 3, -1)
    rng = np.random.default_rng(0)
    low, high = (np.array([0.0, 0.0, 20.0]), np.array([2500.0, 2500.0, 30.0]))
    noise = rng.uniform(low[None, :, None], high[None, :, None], span.shape).reshape(len(span), -1)
    assert excess(replace(plan, population=jnp.asarray(noise, "float32")), world) > 0.05


def test_a_population_that_is_redrawn_whole_is_forgotten(plan, world):
    place, now, _ = time_left(plan, 1.0 / 3.0)
    config = CONFIG.replace(fresh_share=1.0)
    noise = jax.random.permutation(jax.random.key(2), plan.population, axis=1, independent=True)
    kept, lost = (
        replan_path(old, place, now, world, key=jax.random.key(1), config=config)
        for old in (plan, replace(plan, population=noise))
    )
    np.testing.assert_array_equal(kept.positions, lost.positions)


def test_a_current_that_is_no_number_is_refused(plan, world):
    place, now, _ = time_left(plan, 1.0 / 3.0)
    sea = replace(world, current=replace(world.current, strength=np.nan * world.current.strength))
    with pytest.raises(CurrentError, match=r"not a number \(NaN\).*on the way of leg 0"):
        replan_path(plan, place, now, sea, key=jax.random.key(1), config=CONFIG)


def test_a_transferred_population_follows_the_old_paths(plan):
    """Every habitat's rest is fitted within metres, from the vehicle's place to the goal."""
    start, goal = plan.control_points[0], plan.control_points[-1]
    best = np.concatenate([plan.control_points[1:-1].T.ravel()])[None]
    place = plan.positions[16]
    moved = habitats.transfer(jnp.asarray(best, "float32"), start, goal, 16 / 47, jnp.asarray(place), CONFIG)
    basis = basis_matrix(48, 7, 3)
    polygon = np.concatenate([place[None], np.asarray(moved).reshape(3, -1).T, goal[None]])
    curve = basis @ polygon
    fine = np.linspace(16.0, 47.0, 1000)
    old = np.stack([np.interp(fine, np.arange(48), plan.positions[:, axis]) for axis in range(3)], axis=1)
    gaps = np.linalg.norm(curve[:, None] - old[None], axis=2).min(axis=1)
    assert gaps.max() < 25.0
