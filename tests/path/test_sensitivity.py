"""Sensitivities of a plan against closed forms and finite differences."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.path.sensitivity import Conditions, sensitivity
from tests.path.worlds import GOAL, START, world

CONFIG = ap.PathConfig(samples=48)
SHARE = np.linspace(0.0, 1.0, 48)[:, None]
#: A path with a bend.
PATH = START + (GOAL - START) * SHARE + 150.0 * np.sin(np.pi * SHARE) * np.array([1.0, -1.0, 0.0])


def tide(x, y, z, t):
    """A stream that turns with time and place, m/s."""
    return 0.4 * jnp.sin(t / 500.0 + x / 900.0), 0.3 * jnp.cos(t / 400.0 - y / 700.0), 0.0 * z


def travel_time(depart, speed, factor, current):
    """s along `PATH`, the sum over its segments sailed one after the other."""
    time, pace = depart, speed
    for a, b in pairwise(PATH):
        gap = np.linalg.norm(b - a)
        half = time + 0.5 * gap / pace
        water = factor * np.array([float(c) for c in current(*jnp.asarray(0.5 * (a + b)), jnp.asarray(half))])
        along = water @ (b - a) / gap
        pace = along + np.sqrt(speed**2 - (water @ water - along**2))
        time += gap / pace
    return time - depart


@pytest.mark.parametrize("steady", [True, False])
@pytest.mark.usefixtures("x64")
def test_slopes_match_finite_differences(steady):
    current = world().current if steady else tide
    env = world() if steady else ap.Environment(tide, None, None, (0, 0, 0), (2000, 2000, 100))
    found = sensitivity(PATH, 100.0, Conditions(env, ap.Vehicle(), CONFIG))
    at, steps = np.array([100.0, 2.5, 1.0]), (1e-2, 1e-5, 1e-5)
    for k, (name, step) in enumerate(zip(("departure", "speed", "current"), steps, strict=True)):
        aside = step * np.eye(3)[k]
        difference = travel_time(*(at + aside), current) - travel_time(*(at - aside), current)
        assert getattr(found, name) == pytest.approx(difference / (2 * step), rel=1e-4, abs=1e-6)
    assert (found.departure == 0.0) is steady


def test_plans_of_a_batch_know_their_own_world():
    fields = [ap.UniformCurrent(jnp.asarray(u), jnp.asarray(0.0), jnp.asarray(0.0)) for u in (0.5, -0.5)]
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), *fields)
    none = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), ap.Obstacles.none())
    lower, upper = jnp.array([-500.0, -500.0, 0.0]), jnp.array([3500.0, 500.0, 0.0])
    env = ap.Environment(both, None, none, lower, upper)
    light = CONFIG.replace(bbo=CONFIG.bbo.replace(population=10, iterations=2), refine_steps=0, passages=0)
    starts, goals = np.zeros((2, 3)), np.tile([3000.0, 0.0, 0.0], (2, 1))
    plans = ap.plan_paths(starts, goals, env, key=jax.random.key(0), config=light, world_per_leg=True)
    for plan, stream in zip(plans, (0.5, -0.5), strict=True):
        slopes = plan.sensitivity()
        straight = np.linalg.norm(np.diff(plan.positions, axis=0), axis=1).sum() == pytest.approx(
            3000.0, rel=1e-4
        )
        if straight:
            assert slopes.speed == pytest.approx(-3000.0 / (2.5 + stream) ** 2, rel=1e-3)
            assert slopes.current == pytest.approx(-stream * 3000.0 / (2.5 + stream) ** 2, rel=1e-3)
        assert np.sign(slopes.current) == -np.sign(stream)
