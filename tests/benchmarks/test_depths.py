"""The benchmark's seas with depth: drawn by seed, with a way, their references found apart and exact."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from benchmarks.depth_problems import (
    DEPTH_FAMILIES,
    PITCH,
    EkmanCurrent,
    LayeredCurrent,
    depth_problem,
    have_levels,
    way,
)
from benchmarks.path_problems import PathProblem, unlimited_vehicle
from benchmarks.path_ruler import World, evaluate, velocity_at

pytestmark = pytest.mark.slow

#: Most tests look at the same problems, which are drawn once.
SEEDS = 4, 5
drawn = lru_cache(depth_problem)

families = pytest.mark.parametrize(
    "family",
    [
        pytest.param(
            name,
            marks=pytest.mark.skipif(
                name == "file" and not have_levels(), reason="the shared currents with levels are absent"
            ),
        )
        for name in DEPTH_FAMILIES
    ],
)


@families
def test_a_seed_makes_one_problem(family):
    first, again = drawn(family, SEEDS[0]), depth_problem(family, SEEDS[0])
    assert jax.tree.all(jax.tree.map(np.array_equal, first.environment, again.environment))
    assert (first.start, first.goal, first.vehicle) == (again.start, again.goal, again.vehicle)
    assert first.distance != drawn(family, SEEDS[1]).distance


@families
@pytest.mark.parametrize("seed", SEEDS)
def test_every_problem_has_a_way_and_water_that_can_be_held(family, seed):
    problem = drawn(family, seed)
    path = way(problem)
    assert path is not None
    assert evaluate(problem, path).feasible
    low, high = (
        np.asarray(corner, float) for corner in (problem.environment.lower, problem.environment.upper)
    )
    assert high[2] > low[2]
    rng = np.random.default_rng(0)
    x, y, z = rng.uniform(low, high, (4000, 3)).T
    t = problem.depart + rng.uniform(0.0, 2.0 * problem.distance / float(problem.vehicle.speed), 4000)
    fastest = np.linalg.norm(velocity_at(problem.environment.current, x, y, z, t), axis=0).max()
    assert fastest <= 0.9 * float(problem.vehicle.speed) * (1.0 + 1e-5)


def test_every_other_vehicle_has_a_limit_on_pitch():
    limits = [problem.vehicle.pitch_max for problem in (drawn("shear", seed) for seed in SEEDS)]
    assert limits == [PITCH, None]


@pytest.mark.parametrize("family", ["shear", "ekman", "ridge", "spheres"])
def test_problems_of_a_family_share_shapes(family):
    def shapes(seed):
        env = drawn(family, seed).environment
        return [leaf.shape for leaf in jax.tree.leaves((env.obstacles, env.seabed, env.lower))]

    assert shapes(SEEDS[0]) == shapes(SEEDS[1])


def test_layers_and_spirals_are_what_they_are_called():
    layers = LayeredCurrent(*(jnp.asarray(v) for v in ([1.0, 0.0], [0.0, -2.0], 30.0, 2.0)))
    x, y, t = np.zeros((3, 3))
    u, v, w = velocity_at(layers, x, y, np.array([0.0, 30.0, 90.0]), t)
    np.testing.assert_allclose(u, [1.0, 0.5, 0.0], atol=1e-6)
    np.testing.assert_allclose(v, [0.0, -1.0, -2.0], atol=1e-6)
    np.testing.assert_allclose(w, 0.0)
    spiral = EkmanCurrent(*(jnp.asarray(v) for v in ([1.0, 0.0], [0.0, 0.0], 20.0, 1.0)))
    u, v, _ = velocity_at(spiral, x, y, 20.0 * np.pi * np.array([0.0, 0.5, 1.0]), t)
    np.testing.assert_allclose(u, [1.0, 0.0, -np.exp(-np.pi)], atol=1e-6)
    np.testing.assert_allclose(v, [0.0, np.exp(-np.pi / 2.0), 0.0], atol=1e-6)


def test_a_reference_is_the_closed_form_of_a_dive_through_one_thin_interface():
    """The water stands above an interface and runs with the way at c below it.

    The vehicle dives at the angle whose cosine is V / (V + c), as a head wave does, runs along beneath the
    interface, and comes up at the same angle.
    """
    pytest.importorskip("numba")
    from benchmarks.references import depth_reference

    speed, c, length, interface = 2.0, 1.0, 2000.0, 60.0
    layers = LayeredCurrent(*(jnp.asarray(v) for v in ([0.0, 0.0], [c, 0.0], interface, 0.5)))
    env = ap.Environment(layers, None, None, (-600, -1600, 0), (2600, 1600, 100))
    problem = PathProblem("own", "own", env, (0.0, 0.0, 10.0), (length, 0.0, 10.0), unlimited_vehicle(speed))
    found = depth_reference(problem)
    deep = interface - 10.0
    angle = np.arccos(speed / (speed + c))
    expected = (length - 2.0 * deep / np.tan(angle)) / (speed + c) + 2.0 * deep / (speed * np.sin(angle))
    assert expected < 0.8 * length / speed
    # The interface is soft: it takes a little more.
    assert found.travel_time == pytest.approx(expected, rel=2e-3)
    assert found.travel_time > expected
    assert found.plane == pytest.approx(found.travel_time, rel=2e-3)
    assert found.error < 1e-3


@pytest.mark.parametrize("seed", SEEDS)
def test_references_keep_off_spheres_and_are_no_slower_than_a_simple_way(seed):
    pytest.importorskip("numba")
    from benchmarks.path_grid import Grid, ways
    from benchmarks.path_tighten import tighten

    problem = drawn("spheres", seed)
    world = World.of(problem)
    grid = Grid.corridor(problem, world, (48, 12, 16))
    grid_time, path = next(ways(problem, world, grid, 1))
    found = tighten(problem, world, grid, path, 64, grid.width)
    assert found.score.feasible
    assert found.score.clearance > -world.tolerance
    assert found.score.travel_time < 1.01 * grid_time
    assert found.score.travel_time < evaluate(problem, way(problem), world).travel_time


def test_a_slope_at_the_limit_on_pitch_does_not_end_the_polish():
    """Larger steps break the limit on the way down, and what lies deeper than the slopes ends is slow."""
    pytest.importorskip("numba")
    from benchmarks.references import STORED_DEEP, load, stored_reference

    problem = drawn("shear", 7012)
    best = stored_reference(problem, load(STORED_DEEP))
    plan = problem.plan(jax.random.key(0), ap.PathConfig())
    score = evaluate(problem, plan.positions, World.of(problem))
    assert score.feasible
    assert best.travel_time < score.travel_time < 1.025 * best.travel_time
