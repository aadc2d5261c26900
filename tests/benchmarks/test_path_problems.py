"""The benchmark's waters and seas with depth: drawn by seed, with a way, alike at every scale."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

import auvplan as ap
from benchmarks.paths.depths import (
    DEPTH_FAMILIES,
    PITCH,
    EkmanCurrent,
    LayeredCurrent,
    have_levels,
    posed,
    way,
)
from benchmarks.paths.problems import PIXELS
from benchmarks.paths.ruler import World, evaluate, velocity_at
from benchmarks.paths.waters import KINDS, TidalCurrent

pytestmark = pytest.mark.slow

#: Most tests look at the same problems, which are drawn once.
SEED = 5
drawn = lru_cache(posed)

absent = pytest.mark.skipif(not have_levels(), reason="the shared currents with levels are absent")
DEEP = [pytest.param(name, marks=absent if name == "file" else ()) for name in DEPTH_FAMILIES]


@pytest.mark.parametrize("family", [*KINDS, *DEEP])
def test_a_seed_makes_one_problem(family):
    first, again = drawn(family, SEED), posed(family, SEED)
    assert jax.tree.all(jax.tree.map(np.array_equal, first.environment, again.environment))
    assert (first.start, first.goal, first.vehicle) == (again.start, again.goal, again.vehicle)
    assert first.distance != drawn(family if family in DEPTH_FAMILIES else "no-way", SEED + 1).distance


@pytest.mark.parametrize("family", KINDS)
def test_start_and_goal_are_joined_by_water_unless_the_family_says_otherwise(family):
    problem = drawn(family, SEED)
    env, world = problem.environment, World.of(problem)
    ends = np.array([problem.start, problem.goal])[:, :2]
    assert (world.clearance(*ends.T, np.zeros(2)) > 0.0).all()
    if env.chart is None:
        return
    pixel = float(env.chart.pixel_size)
    kept = np.asarray(env.chart.signed_distance) > (world.margin if KINDS[family].way else -pixel)
    labels, _ = ndimage.label(kept, np.ones((3, 3)))
    found = labels[tuple((ends / pixel).astype(int).T)]
    assert (found[0] == found[1] != 0) == KINDS[family].way


@pytest.mark.parametrize("family", DEEP)
@pytest.mark.parametrize("seed", [SEED - 1, SEED])
def test_every_sea_has_a_way_and_water_that_can_be_held(family, seed):
    problem = drawn(family, seed)
    path, speed = way(problem), float(problem.vehicle.speed)
    assert path is not None
    assert evaluate(problem, path).feasible
    env = problem.environment
    low, high = (np.asarray(corner, float) for corner in (env.lower, env.upper))
    assert high[2] > low[2]
    rng = np.random.default_rng(0)
    x, y, z = rng.uniform(low, high, (4000, 3)).T
    t = problem.depart + rng.uniform(0.0, 2.0 * problem.distance / speed, 4000)
    fastest = np.linalg.norm(velocity_at(env.current, x, y, z, t), axis=0).max()
    assert fastest <= 0.9 * speed * (1.0 + 1e-5)
    assert problem.vehicle.pitch_max == (PITCH if seed % 2 == 0 else None)


@pytest.mark.parametrize(
    "problems",
    [[("coast", SEED), ("sounds", SEED), ("moving", SEED)]]
    + [[(family, SEED - 1), (family, SEED)] for family in ("shear", "ekman", "ridge", "spheres")],
    ids=lambda problems: problems[0][0],
)
def test_problems_share_shapes(problems):
    envs = [drawn(*problem).environment for problem in problems]
    shapes = {tuple(leaf.shape for leaf in jax.tree.leaves((env.obstacles, env.seabed))) for env in envs}
    assert len(shapes) == 1
    assert {env.chart.shape for env in envs if env.chart is not None} <= {(PIXELS, PIXELS)}


def test_tides_layers_and_spirals_are_what_they_are_called():
    steady = ap.LambVortices([[[2000.0, 900.0]]], [[900.0]], [[400.0]])
    tide = TidalCurrent(steady, 0.4, 0.6, 3600.0, 0.5)
    x, y, t = np.full(5, 1500.0), np.full(5, 1200.0), np.linspace(0.0, 9000.0, 5)
    factor = 0.4 + 0.6 * np.cos(2.0 * np.pi * t / 3600.0 + 0.5)
    np.testing.assert_allclose(tide.factor(t), factor, rtol=1e-12)
    turning, at_rest = (velocity_at(water, x, y, 0.0 * x, t)[:2] for water in (tide, steady))
    np.testing.assert_allclose(turning, factor * np.asarray(at_rest), rtol=1e-6)
    x, y, t = np.zeros((3, 3))
    layers = LayeredCurrent(*(jnp.asarray(v) for v in ([1.0, 0.0], [0.0, -2.0], 30.0, 2.0)))
    water = velocity_at(layers, x, y, np.array([0.0, 30.0, 90.0]), t)
    np.testing.assert_allclose(water, [[1.0, 0.5, 0.0], [0.0, -1.0, -2.0], np.zeros(3)], atol=1e-6)
    spiral = EkmanCurrent(*(jnp.asarray(v) for v in ([1.0, 0.0], [0.0, 0.0], 20.0, 1.0)))
    water = velocity_at(spiral, x, y, 20.0 * np.pi * np.array([0.0, 0.5, 1.0]), t)[:2]
    np.testing.assert_allclose(water, [[1.0, 0, -np.exp(-np.pi)], [0, np.exp(-np.pi / 2.0), 0]], atol=1e-6)
