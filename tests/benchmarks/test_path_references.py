"""References of the benchmark: kept by problem, exact where a closed form is known, and below no bound."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

pytest.importorskip("numba", reason="needs numba: pip install 'auvplan[bench]'")

import auvplan as ap
from benchmarks.bounds import bounds
from benchmarks.path_walks import walks
from benchmarks.paths.depths import LayeredCurrent, depth_problem, way
from benchmarks.paths.grid import Grid, passages, ways
from benchmarks.paths.problems import PathProblem, unlimited_vehicle
from benchmarks.paths.references import STORED_DEEP, Reference, found_reference, load, store, stored_reference
from benchmarks.paths.ruler import World, evaluate
from benchmarks.paths.tighten import tighten
from benchmarks.paths.waters import FAMILIES, water_problem

pytestmark = pytest.mark.slow

#: As if no path were known that is quicker than so many times the reference.
KNOWN = 1.25


def test_references_are_kept_by_problem(tmp_path):
    file, problem = tmp_path / "kept.json", water_problem("island", 5)
    positions = np.array([problem.start, problem.goal])[:, :2]
    store(problem, Reference(123.45678, 1e-4, positions, 2.0), file)
    found, kept = stored_reference(problem, load(file)), load(file)
    assert (found.travel_time, found.error) == (123.4568, 1e-4)
    np.testing.assert_allclose(found.positions[[0, -1]], positions, atol=5e-5 * problem.distance)
    assert stored_reference(water_problem("coast", 5), kept) is None
    assert stored_reference(replace(problem, start=problem.goal, goal=(0.0, 0.0, 0.0)), kept) is None


@pytest.mark.parametrize("family", FAMILIES)
def test_a_coarse_grid_leads_to_a_path_that_the_ruler_holds_feasible(family):
    problem = water_problem(family, 5)
    world = World.of(problem)
    grid = Grid.plane(problem, world, 200)
    grid_time, path = next(passages(problem, world, grid, 1))
    score = tighten(problem, world, grid, path, segments=128).score
    assert score.clearance > -world.tolerance
    assert score.travel_time < 1.01 * grid_time


@pytest.mark.parametrize("seed", [4, 5])
def test_references_keep_off_spheres_and_are_no_slower_than_a_simple_way(seed):
    problem = depth_problem("spheres", seed)
    world = World.of(problem)
    grid = Grid.corridor(problem, world, (48, 12, 16))
    grid_time, path = next(ways(problem, world, grid, 1))
    score = tighten(problem, world, grid, path, 64, grid.width).score
    assert score.feasible
    assert score.clearance > -world.tolerance
    assert score.travel_time < min(1.01 * grid_time, evaluate(problem, way(problem), world).travel_time)


def test_a_reference_is_the_closed_form_of_a_dive_through_one_thin_interface():
    """The water stands above an interface and runs with the way at c below it.

    The vehicle dives at the angle whose cosine is V / (V + c), as a head wave does, runs along beneath the
    interface, and comes up at the same angle.
    """
    speed, c, length, interface = 2.0, 1.0, 2000.0, 60.0
    layers = LayeredCurrent(*(jnp.asarray(v) for v in ([0.0, 0.0], [c, 0.0], interface, 0.5)))
    env = ap.Environment(layers, None, None, (-600, -1600, 0), (2600, 1600, 100))
    problem = PathProblem("own", "own", env, (0.0, 0.0, 10.0), (length, 0.0, 10.0), unlimited_vehicle(speed))
    found = found_reference(problem)
    deep, angle = interface - 10.0, np.arccos(speed / (speed + c))
    expected = (length - 2.0 * deep / np.tan(angle)) / (speed + c) + 2.0 * deep / (speed * np.sin(angle))
    assert expected < 0.8 * length / speed
    # The interface is soft: it takes a little more.
    assert found.travel_time == pytest.approx(expected, rel=2e-3)
    assert found.travel_time > expected
    assert found.plane == pytest.approx(found.travel_time, rel=2e-3)
    assert found.error < 1e-3


def test_a_slope_at_the_limit_on_pitch_does_not_end_the_polish():
    """Larger steps break the limit on the way down, and what lies deeper than the slopes ends is slow."""
    problem = depth_problem("shear", 7012)
    best = stored_reference(problem, load(STORED_DEEP))
    plan = problem.plan(jax.random.key(0), ap.PathConfig())
    score = evaluate(problem, plan.positions, World.of(problem))
    assert score.feasible
    assert best.travel_time < score.travel_time < 1.025 * best.travel_time


@pytest.mark.parametrize("family", ["open", "sounds", "moving"])
def test_no_reference_beats_its_bound(family):
    (run,) = bounds([family], [1000], None, KNOWN, 0.25)
    assert run["kind"] == "certified"
    assert not run["violated"]
    assert run["bound"] > 0.5 * run["quickest"]


def test_none_of_many_references_beats_its_bound():
    runs = list(bounds(FAMILIES, range(1000, 1034), None, KNOWN, 0.25))
    assert len(runs) > 150
    assert not [run["problem"] for run in runs if run["violated"]]


def test_paths_called_clear_are_clear_when_walked():
    found = walks(60)
    assert found.paths == 60
    assert found.collisions == 0
