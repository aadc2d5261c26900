"""The benchmark's waters: drawn by seed, with a way, independently measured, alike at every scale."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

import auvplan as ap
from benchmarks.path_problems import PIXELS, PathProblem, literature, unlimited_vehicle
from benchmarks.path_ruler import LIMIT_TOLERANCE, World, evaluate, velocity_at
from benchmarks.water_problems import FAMILIES, KINDS, TidalCurrent, scaled, water_problem

pytestmark = pytest.mark.slow

SIDE = 4000.0

#: Most tests look at the same problems, which are drawn once.
SEED = 5
drawn = lru_cache(water_problem)


def planar(current=None, obstacles=None, vehicle=None, depart=0.0):
    env = ap.Environment(current, None, obstacles, (0, 0, 0), (SIDE, SIDE, 0))
    vehicle = vehicle or unlimited_vehicle(2.0)
    return PathProblem("own", "own", env, (1000.0, 1000.0, 0.0), (3000.0, 1000.0, 0.0), vehicle, depart)


def straight(problem, count=41):
    return np.linspace(problem.start, problem.goal, count)


@pytest.mark.parametrize("family", KINDS)
def test_a_seed_makes_one_problem(family):
    first, again = drawn(family, SEED), water_problem(family, SEED)
    assert jax.tree.all(jax.tree.map(np.array_equal, first.environment, again.environment))
    assert (first.start, first.goal, first.vehicle) == (again.start, again.goal, again.vehicle)
    assert first.distance != water_problem("no-way", SEED + 1).distance


@pytest.mark.parametrize("family", KINDS)
def test_start_and_goal_are_joined_by_water_unless_the_family_says_otherwise(family):
    problem = drawn(family, SEED)
    env = problem.environment
    world = World.of(problem)
    ends = np.array([problem.start, problem.goal])[:, :2]
    assert (world.clearance(*ends.T, np.zeros(2)) > 0.0).all()
    if env.chart is None:
        return
    pixel = float(env.chart.pixel_size)
    kept = np.asarray(env.chart.signed_distance) > (world.margin if KINDS[family].way else -pixel)
    labels, _ = ndimage.label(kept, np.ones((3, 3)))
    found = labels[tuple((ends / pixel).astype(int).T)]
    assert (found[0] == found[1] != 0) == KINDS[family].way


def test_problems_share_shapes():
    problems = [drawn(family, SEED) for family in ("coast", "sounds", "moving")]
    shapes = {tuple(leaf.shape for leaf in jax.tree.leaves(p.environment.obstacles)) for p in problems}
    assert len(shapes) == 1
    assert {p.environment.chart.shape for p in problems} == {(PIXELS, PIXELS)}


def test_a_tide_multiplies_the_current():
    steady = ap.LambVortices([[[2000.0, 900.0]]], [[900.0]], [[400.0]])
    tide = TidalCurrent(steady, 0.4, 0.6, 3600.0, 0.5)
    x, y, t = np.full(5, 1500.0), np.full(5, 1200.0), np.linspace(0.0, 9000.0, 5)
    factor = 0.4 + 0.6 * np.cos(2.0 * np.pi * t / 3600.0 + 0.5)
    np.testing.assert_allclose(tide.factor(t), factor, rtol=1e-12)
    turning, at_rest = (velocity_at(water, x, y, 0.0 * x, t)[:2] for water in (tide, steady))
    np.testing.assert_allclose(turning, factor * np.asarray(at_rest), rtol=1e-6)


def test_the_ruler_times_a_crab_in_closed_form():
    along, across = 0.4, -0.9
    problem = planar(lambda x, y, z, t: (along, across, 0.0))
    score = evaluate(problem, straight(problem))
    assert score.travel_time == pytest.approx(2000.0 / (along + np.sqrt(4.0 - across**2)), rel=1e-6)
    assert score.feasible
    assert score.length == pytest.approx(2000.0)


@pytest.mark.parametrize("limit", ["surge_max", "sway_max"])
def test_the_ruler_judges_surge_and_sway(limit):
    along, across = 0.4, -0.9
    value = {"surge_max": along + np.sqrt(4.0 - across**2), "sway_max": -across}[limit]
    for share, kept in ((0.95, False), (1.05, True)):
        free = {"surge_max": 1e6, "sway_max": 1e6, "turn_rate_max": 1e6}
        vehicle = ap.Vehicle(2.0, **{**free, limit: share * value})
        problem = planar(lambda x, y, z, t: (along, across, 0.0), vehicle=vehicle)
        score = evaluate(problem, straight(problem))
        assert score.feasible == kept
        assert score.excess == pytest.approx(1.0 / share - 1.0, abs=1e-5)


def test_the_ruler_finds_the_turn_rate_of_a_circle():
    radius = 1000.0
    bearing = np.linspace(np.pi, 0.0, 101)
    arc = np.column_stack([2000.0 + radius * np.cos(bearing), 1000.0 + radius * np.sin(bearing)])
    for share, kept in ((1.0 + 2.0 * LIMIT_TOLERANCE, True), (1.0 - 2.0 * LIMIT_TOLERANCE, False)):
        vehicle = ap.Vehicle(2.0, surge_max=1e6, sway_max=1e6, turn_rate_max=share * 2.0 / radius)
        score = evaluate(planar(vehicle=vehicle), arc)
        assert score.feasible == kept
        assert score.excess == pytest.approx(1.0 / share - 1.0, abs=1e-3)


def test_the_ruler_meets_what_moves_at_the_time_of_arrival():
    rng = np.random.default_rng(2)
    count, depart = 4, 300.0
    drift = np.array([0.0, 1.0, 1.0, 0.0])
    obstacles = ap.Obstacles.create(
        np.c_[rng.uniform(500.0, 3500.0, (count, 2)), np.zeros(count)],
        rng.uniform(20.0, 90.0, count),
        velocity=np.c_[rng.uniform(-1.0, 1.0, (count, 2)), np.zeros(count)],
        drift=drift,
        growth=0.05,
        growth_max=30.0,
        observed_at=100.0,
    )
    problem = planar(lambda x, y, z, t: (0.3, 0.0, 0.0), obstacles.padded(7), depart=depart)
    score = evaluate(problem, straight(problem))
    # Walked in plain NumPy: 2.3 m/s along x from the start on.
    elapsed = np.linspace(0.0, 2000.0 / 2.3, 20_001)
    since = depart + elapsed - 100.0
    place = np.array([1000.0, 1000.0]) + elapsed[:, None] * np.array([2.3, 0.0])
    least = np.inf
    for k in range(count):
        moved = np.asarray(obstacles.velocity)[k, :2] + drift[k] * np.array([0.3, 0.0])
        centre = np.asarray(obstacles.position)[k, :2] + since[:, None] * moved
        reach = float(obstacles.radius[k]) + np.minimum(0.05 * since, 30.0)
        least = min(least, (np.linalg.norm(place - centre, axis=1) - reach).min())
    assert score.clearance == pytest.approx(least - ap.PathConfig().obstacle_margin, abs=0.05)


def test_what_moves_leaves_the_way_free_again():
    def crossing(late):
        start = [
            2000.0,
            1000.0 - 1.0 * (500.0 - late),
            0.0,
        ]  # on the straight line `late` s before the vehicle
        return planar(obstacles=ap.Obstacles.create([start], [50.0], velocity=[[0.0, 1.0, 0.0]]))

    for late, feasible in ((0.0, False), (-200.0, True), (200.0, True)):
        problem = crossing(late)
        assert evaluate(problem, straight(problem)).feasible == feasible


@pytest.mark.parametrize("factor", [1e-3, 20.0])
@pytest.mark.parametrize("family", ["open", "coast", "moving", "techy"])
def test_scaled_problems_are_the_same_ones_in_other_units(family, factor):
    problem = literature()[3] if family == "techy" else drawn(family, SEED)
    posed = scaled(problem, factor)
    rng = np.random.default_rng(0)
    side = float(problem.environment.upper[0] - problem.environment.lower[0])
    path = np.array(straight(problem, 33))
    path[1:-1, :2] += 0.002 * side * rng.normal(size=(31, 2))
    first, other = evaluate(problem, path), evaluate(posed, factor * path)
    assert other.travel_time == pytest.approx(factor * first.travel_time, rel=1e-4)
    assert other.clearance == pytest.approx(factor * first.clearance, rel=1e-3, abs=1e-4 * factor * side)
    assert other.excess == pytest.approx(first.excess, rel=1e-3, abs=1e-3)
    assert posed.environment.current(*(jnp.zeros(1),) * 4)[0].shape == (1,)


def test_references_are_kept_by_problem(tmp_path):
    pytest.importorskip("numba")
    from benchmarks.references import Reference, load, store, stored_reference

    file, problem = tmp_path / "kept.json", drawn("island", SEED)
    positions = np.array([problem.start, problem.goal])[:, :2]
    store(problem, Reference(123.45678, 1e-4, positions, 2.0), file)
    found = stored_reference(problem, load(file))
    assert (found.travel_time, found.error) == (123.4568, 1e-4)
    np.testing.assert_allclose(found.positions[[0, -1]], positions, atol=5e-5 * problem.distance)
    assert stored_reference(drawn("coast", SEED), load(file)) is None
    assert (
        stored_reference(scaled(problem, 1.1), {scaled(problem, 1.1).name: load(file)[problem.name]}) is None
    )


@pytest.mark.parametrize("family", FAMILIES)
def test_a_coarse_grid_leads_to_a_path_that_the_ruler_holds_feasible(family):
    pytest.importorskip("numba")
    from benchmarks.path_grid import Grid, passages
    from benchmarks.path_tighten import tighten

    problem = drawn(family, SEED)
    world = World.of(problem)
    grid = Grid.plane(problem, world, 200)
    grid_time, path = next(passages(problem, world, grid, 1))
    found = tighten(problem, world, grid, path, segments=128)
    assert found.score.clearance > -world.tolerance
    assert found.score.travel_time < 1.01 * grid_time
