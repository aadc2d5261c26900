"""A path that crosses itself is tried without its loop."""

import jax
import numpy as np
import pytest

import auvplan as ap
from auvplan.path import planner
from auvplan.path.habitats import without_loop

CONFIG = ap.PathConfig.plain().replace(control_points=8, samples=64)
START, GOAL = np.array([0.0, 0.0, 10.0]), np.array([0.0, 1000.0, 30.0])


def looping(radius: float) -> np.ndarray:
    """[S, 3] m, a straight line with a full circle in its middle."""
    half = np.linspace([0, 0, 10], [0, 500, 20], 30)
    turn = np.linspace(0.0, 2.0 * np.pi, 41)[1:-1]
    circle = np.stack([radius * (1 - np.cos(turn)), 500 + radius * np.sin(turn), 0 * turn + 20], axis=1)
    return np.concatenate([half, circle, np.linspace([0, 500, 20], [0, 1000, 30], 30)])


def test_the_loop_of_a_straight_line_is_cut():
    row = without_loop(looping(150.0), CONFIG)
    assert row is not None
    north, east, down = row.reshape(3, -1)
    np.testing.assert_allclose(north, 0.0, atol=1.0)
    np.testing.assert_array_less(0.0, np.diff(east))
    np.testing.assert_allclose(down, 10.0 + 0.02 * east, atol=0.5)


def test_a_path_that_does_not_cross_itself_has_none():
    bends = np.linspace(START, GOAL, 80)
    bends[:, 0] = 200.0 * np.sin(bends[:, 1] / 100.0)
    assert without_loop(bends, CONFIG) is None
    assert without_loop(np.linspace(START, GOAL, 80), CONFIG) is None


@pytest.mark.slow
def test_a_plan_that_loops_is_polished_without(monkeypatch):
    """A search that returns a loop, as strong currents and limits of the vehicle have made it do."""
    config = CONFIG.replace(finer=2, fine_steps=20, refine_steps=4, passages=0)
    env = ap.Environment(ap.UniformCurrent(0.0, 0.2), lower=(-500, -500, 0), upper=(1500, 1500, 60))
    found = planner.search_legs

    def looping_search(*args, **kwargs):
        plans = found(*args, **kwargs)
        samples = plans["positions"].shape[1]
        loop = looping(150.0)
        plans["positions"] = loop[np.linspace(0, len(loop) - 1, samples).astype(int)][None]
        return plans | {
            "cost": plans["cost"] * 2.0,
            "wanting": np.zeros(1, bool),
            "unsettled": np.zeros(1, bool),
        }

    monkeypatch.setattr(planner, "search_legs", looping_search)
    plan = ap.plan_path(START, GOAL, env, key=jax.random.key(0), config=config)
    assert plan.feasible
    assert np.abs(plan.positions[:, 0]).max() < 20.0


def test_what_is_left_over_a_limit_is_polished_once_more_alone():
    asked = []

    def polish(which, rows):
        """Move paths to the north; the second leg's breaks a limit until it is there."""
        asked.extend(zip(which.tolist(), rows[:, 0].tolist(), strict=True))
        broken = 0.1 * ((which > 0) & (rows[:, 0] < 50.0))
        return {
            "violations": broken[:, None], "population": (rows + 100.0)[:, None],
            "cost": rows[:, 0], "wanting": broken,
        }  # fmt: skip

    config = CONFIG.replace(finer=1)
    legs = planner.Legs(np.stack([START, START]), np.stack([GOAL, GOAL]), np.array([0.0, 1.0]), None)
    rows = np.tile(np.linspace(START, GOAL, 10)[1:-1].T.ravel(), (2, 1))
    found = {"violations": np.zeros((2, 1)), "cost": np.full(2, -1e9)}
    kept = planner._improved(found, np.arange(2), rows, polish, legs, config, rounds=2)
    assert kept == (found, {})
    assert [leg for leg, _ in sorted(asked)] == [0, 1, 1]
    assert max(north for _, north in asked) > 50.0
