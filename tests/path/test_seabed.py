"""Paths over the sea bed: certified altitudes, banks that are climbed, seamounts that are rounded."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.ocean.seabed import Seabed
from auvplan.path import VIOLATIONS, habitats
from auvplan.path.clearance import bed_altitude
from auvplan.path.cost import ALTITUDE_SCALE
from tests.path.kernels import curves, evaluate, leg, population, score, through

CONFIG = ap.PathConfig(
    bbo=ap.bbo.BBOConfig(
        population=60, iterations=60, replacement="greedy", mutation="gaussian", mutation_step=0.05
    ),
    control_points=10,
    samples=64,
    passages=0,
    refine_steps=20,
    passage_steps=30,
    finer=1,
)
LOWER, UPPER = (0.0, 0.0, 0.0), (3000.0, 2000.0, 200.0)
START, GOAL = (200.0, 900.0, 70.0), (2800.0, 1100.0, 90.0)
NORTH, EAST = np.meshgrid((np.arange(150) + 0.5) * 20.0, (np.arange(100) + 0.5) * 20.0, indexing="ij")
CLEARANCE = 6.0


def over(depth, **changes) -> ap.Environment:
    """Still water over depths at the pixels' centres."""
    bed = Seabed.from_depth(np.broadcast_to(depth, NORTH.shape), 20.0, clearance=CLEARANCE)
    return ap.Environment(None, None, None, LOWER, UPPER, bed, **changes)


#: A ridge across the way from edge to edge, 40 m deep; and a seamount that ends above the sea.
RIDGE = 120.0 - 80.0 * np.exp(-(((NORTH - 1400.0 - 0.2 * EAST) / 150.0) ** 2))
SEAMOUNT = 120.0 - 150.0 * np.exp(-((NORTH - 1500.0) ** 2 + (EAST - 1020.0) ** 2) / 250.0**2)


def plan(env, start=START, goal=GOAL, config=CONFIG):
    return ap.plan_path(start, goal, env, key=jax.random.key(0), config=config)


@pytest.fixture(scope="module")
def climbed():
    """A plan over the ridge."""
    return plan(over(RIDGE))


def walked(path, env):
    """Altitudes every metre or less along a plan."""
    share, index = np.linspace(0.0, len(path.times) - 1, 4000), np.arange(len(path.times))
    points = np.stack([np.interp(share, index, path.positions[:, k]) for k in range(3)], axis=1)
    return env.seabed.altitude(points), points


@pytest.mark.parametrize("gap", [6.0, 30.0, 120.0])
def test_altitude_is_certified_on_every_segment(gap):
    rng = np.random.default_rng(int(gap))
    env = over(RIDGE + rng.normal(0.0, 3.0, RIDGE.shape))
    steps = rng.normal([1.0, 0.5, 0.0], 1.0, (40, 30, 3))
    steps *= gap * rng.uniform(0.2, 1.0, (40, 30, 1)) / np.linalg.norm(steps, axis=2, keepdims=True)
    places = np.cumsum(steps, axis=0) + rng.uniform([0, 0, 0], [2000, 1500, 90], (30, 3))
    x, y, z = (jnp.asarray(places[..., k]) for k in range(3))
    level = jnp.hypot(jnp.diff(x, axis=0), jnp.diff(y, axis=0))
    certified = np.asarray(bed_altitude(x, y, z, level, env))
    share = np.linspace(0.0, 1.0, 61)[:, None, None, None]
    true = env.seabed.altitude(places[:-1] * (1.0 - share) + places[1:] * share).min(axis=0)
    assert (certified <= true + 1e-2).all()
    assert np.median(true - certified) < 0.15 * gap + 12.0
    in_parts = np.asarray(bed_altitude(x, y, z, level, env, parts=4))
    assert (in_parts <= true + 1e-2).all()
    assert np.median(true - in_parts) < np.median(true - certified)


@pytest.mark.slow
def test_over_a_flat_bottom_the_way_is_the_straight_one():
    env = over(150.0)
    found = plan(env)
    assert found.feasible
    assert found.travel_time == pytest.approx(np.linalg.norm(np.subtract(GOAL, START)) / 2.5, rel=1e-3)
    assert found.altitude == pytest.approx(150.0 - found.positions[:, 2].max(), abs=0.5)


def test_a_ridge_is_climbed(climbed):
    found = climbed
    assert found.feasible, found.reason
    altitude, points = walked(found, over(RIDGE))
    assert CLEARANCE <= found.altitude <= altitude.min() + 1e-2
    assert points[:, 2].min() < 40.0 - CLEARANCE
    # Climbing is a hundredth of the way; the ridge cannot be rounded.
    straight = np.linalg.norm(np.subtract(GOAL, START)) / 2.5
    assert straight < found.travel_time < 1.03 * straight
    np.testing.assert_allclose(found.positions[[0, -1]], [START, GOAL], atol=1e-2)


def test_a_seamount_is_rounded():
    env = over(SEAMOUNT)
    found = plan(env)
    assert found.feasible, found.reason
    altitude, points = walked(found, env)
    assert CLEARANCE <= found.altitude <= altitude.min() + 1e-2
    away = np.hypot(points[:, 0] - 1500.0, points[:, 1] - 1020.0).min()
    # Where the top of the box keeps the clearance, and not much farther.
    assert 250.0 * np.sqrt(np.log(150.0 / 114.0)) < away < 450.0
    straight = np.linalg.norm(np.subtract(GOAL, START)) / 2.5
    assert found.travel_time < 1.1 * straight


def test_a_vehicle_under_way_is_planned_anew_over_the_bank(climbed):
    env, first = over(RIDGE), climbed
    rest = ap.replan_path(
        first, first.positions[20], float(first.times[20]), env, key=jax.random.key(1), config=CONFIG
    )
    assert rest.feasible, rest.reason
    assert walked(rest, env)[0].min() >= CLEARANCE
    assert rest.travel_time <= (first.times[-1] - first.times[20]) * 1.01


@pytest.mark.usefixtures("x64")
def test_gradients_match_finite_differences():
    env = over(RIDGE)
    start, goal = jnp.asarray(START), jnp.asarray(GOAL)
    habitat = habitats.straight_line(start, goal, CONFIG) + jnp.sin(jnp.arange(30.0)) * 9.0

    @jax.jit
    def cost(habitat):
        return score(habitat[None], start, goal, 0.0, env, ap.Vehicle(), CONFIG)[0][0]

    slopes = jax.jit(jax.grad(cost))(habitat)
    assert np.abs(slopes[20:]).max() > 1.0  # the ridge bears on the depths
    for d in range(0, 30, 3):
        unit = 1e-5 * np.eye(30)[d]
        difference = float(cost(habitat + unit) - cost(habitat - unit)) / 2e-5
        assert float(slopes[d]) == pytest.approx(difference, rel=2e-3, abs=1e-3)


def test_excess_is_metres_of_missing_altitude():
    env = over(50.0)
    x, y = np.linspace(100.0, 900.0, 9)[:, None], np.full((9, 1), 700.0)
    for depth, missing in ((40.0, 0.0), (44.0, 0.0), (46.0, 2.0), (53.0, 9.0)):
        trajectory = evaluate(through(x, y, np.full_like(x, depth)), 0.0, env, ap.Vehicle(), CONFIG)
        excess = trajectory.excess[VIOLATIONS.index("seabed")]
        np.testing.assert_allclose(excess, missing / ALTITUDE_SCALE, atol=1e-4)
        np.testing.assert_allclose(trajectory.altitude, 50.0 - depth, atol=1e-4)
    without = evaluate(through(x, y, 99.0 + 0.0 * x), 0.0, replace(env, seabed=None), ap.Vehicle(), CONFIG)
    assert (np.asarray(without.altitude) == np.inf).all()
    assert not np.asarray(without.excess[VIOLATIONS.index("seabed")]).any()


def test_first_habitats_rise_over_the_ridge():
    env = over(RIDGE)

    @jax.jit
    def first(start, goal):
        straight, problem = habitats.straight_line(start, goal, CONFIG), leg(start, goal, env)
        line = habitats.raise_above_seabed(straight[None], problem, CONFIG)
        return straight, line, *habitats.bounds(problem, CONFIG)

    straight, line, lower, upper = map(np.asarray, first(jnp.asarray(START), jnp.asarray(GOAL)))
    np.testing.assert_array_equal(lower[20:], 0.0)
    trajectory = evaluate(curves(line, START, GOAL, CONFIG), 0.0, env, ap.Vehicle(), CONFIG)
    assert float(trajectory.altitude.min()) > 0.0
    assert (line[0, :20] == straight[:20]).all()
    many = np.asarray(population(9, START, GOAL, env, CONFIG, over=env))
    assert ((many >= lower) & (many <= upper)).all()


def test_a_path_that_follows_the_bed_is_not_raised():
    env, config = over(RIDGE), CONFIG.replace(control_points=40, samples=160)
    start, goal = jnp.asarray(START), jnp.asarray(GOAL)
    x, y, _ = habitats.straight_line(start, goal, config).reshape(3, -1)
    above, below = ([*x, *y, *(env.seabed.depth_at(x, y) - altitude)] for altitude in (30.0, 0.0))
    rows = jnp.asarray([above, below])
    follows, rises = habitats.raise_above_seabed(rows, leg(start, goal, env), config)
    np.testing.assert_array_equal(follows, rows[0])
    places = np.stack(curves(rises[None], start, goal, config).places, axis=-1)
    assert env.seabed.altitude(places).min() >= CLEARANCE


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        ((200, 900, 125), GOAL, r"start of leg 0 at \(200, 900, 125\) m lies 5.0 m below the sea bed"),
        (START, (2800, 1100, 121), r"goal of leg 0 .* lies 1.0 m below the sea bed"),
        (START, (2800, 1100, 116), r"lies 4.0 m above the sea bed, 2.0 m less than its clearance of 6 m"),
    ],
)
def test_ends_at_the_bottom_are_refused(start, goal, message):
    with pytest.raises(ValueError, match=message):
        plan(over(120.0), start, goal)


def test_a_start_nearer_than_the_clearance_is_stated():
    found = plan(over(120.0), (200.0, 900.0, 116.0))
    assert found.status is ap.PathStatus.SEABED
    assert found.reason.startswith("altitude above the sea bed 4.0 m under 6.0 at km 0.0 of 2.6, at ")
    assert found.positions[5, 2] < 116.0


def test_usual_lengths_are_no_longer_than_the_last_layer_covers():
    """Samples 60 m apart: half as much again would reach 45 m over a bed known to 40 m, at its slope."""
    bed = Seabed.from_depth(100.0 + 0.1 * NORTH, 20.0, reach=40.0)
    x, y, z = jnp.arange(11.0)[:, None] * 60.0 + 900.0, jnp.full((11, 1), 1000.0), jnp.full((11, 1), 50.0)
    env = ap.Environment(None, None, None, LOWER, UPPER, bed)
    found = bed_altitude(x, y, z, jnp.full((10, 1), 60.0), env)
    ends = bed.shallowest_at(x, y, 80.0) - z
    np.testing.assert_allclose(found, jnp.minimum(ends[:-1], ends[1:]), atol=1e-3)
