"""How a followed plan fares in another current, against closed forms and the planner's own times."""

import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.path.config import PathConfig
from auvplan.path.follow import straight_plan
from auvplan.path.outlook import outlook
from auvplan.path.sensitivity import Conditions

START, GOAL = np.array([0.0, 0.0, 10.0]), np.array([2000.0, 0.0, 10.0])
LIGHT = PathConfig.quick().replace(passages=0, refine_steps=0)
VEHICLE = ap.Vehicle(speed=2.5)


@pytest.fixture(scope="module")
def plan():
    """A straight plan in still water."""
    env = ap.Environment(None, lower=(-500, -500, 0), upper=(2500, 500, 50))
    return straight_plan(START, GOAL, 100.0, Conditions(env, VEHICLE, LIGHT))


def rest_of(plan, sample, current, late=0.0):
    """The outlook of a vehicle that is at a sample so many seconds later than planned."""
    due = np.interp(sample, np.arange(len(plan.times)), plan.times)
    return outlook(plan, sample, due + late, current, VEHICLE, LIGHT)


def test_in_the_sea_it_was_planned_for_nothing_changes(plan):
    for sample in (0.0, 10.5, 62.9):
        rest = rest_of(plan, sample, ap.UniformCurrent())
        assert rest.time_left == pytest.approx(rest.planned, rel=1e-4, abs=0.01)
        assert rest.change < 1e-3
        assert not rest.broken


def test_a_stream_along_the_way_changes_the_time_left_as_the_closed_form_has_it(plan):
    for stream in (-0.5, 0.5):
        rest = rest_of(plan, 0.0, ap.UniformCurrent(stream))
        straight = 2000.0 / (2.5 + stream)
        assert rest.time_left == pytest.approx(straight * plan.length / 2000.0, rel=0.01)
        assert rest.change == pytest.approx(abs(rest.time_left / plan.travel_time - 1.0), rel=1e-3)


def test_a_current_that_wins_breaks_a_limit_only_where_it_is_still_ahead(plan):
    def at_first(x, y, z, t):
        return jnp.where(x < 500.0, -3.0, 0.0), 0.0 * y, 0.0 * z

    current = ap.Environment(at_first, lower=(0, 0, 0), upper=(1, 1, 1)).current
    assert rest_of(plan, 0.0, current).broken
    past = float(np.argmax(plan.positions[:, 0] > 600.0))
    rest = rest_of(plan, past, current)
    assert not rest.broken
    assert rest.change < 1e-3


def test_at_the_goal_nothing_is_left(plan):
    rest = rest_of(plan, len(plan.times) - 1.0, ap.UniformCurrent(1.0))
    assert rest.time_left == pytest.approx(0.0, abs=1e-3)
    assert not rest.broken


def test_a_late_vehicle_meets_the_current_of_the_time_when_it_is_there(plan):
    turns = float(plan.times[-1]) + 1.0

    def later(x, y, z, t):
        return jnp.where(t > turns, 1.0, 0.0) + 0.0 * x, 0.0 * y, 0.0 * z

    current = ap.Environment(later, lower=(0, 0, 0), upper=(1, 1, 1)).current
    assert rest_of(plan, 20.0, current).change < 1e-3
    late = rest_of(plan, 20.0, current, late=plan.travel_time)
    assert late.time_left == pytest.approx(late.planned * 2.5 / 3.5, rel=0.01)
    samples = np.arange(len(plan.times))
    assert np.interp(20.0, samples, late.times) == pytest.approx(plan.times[20] + plan.travel_time, abs=0.01)
    assert late.times[-1] - late.time_left == pytest.approx(plan.times[20] + plan.travel_time, abs=0.01)


def test_a_dive_at_the_limit_is_not_broken_by_rounding_but_by_an_updraught():
    start = np.array([9000.0, 9500.0, 10.0])
    goal = start + 400.0 * np.array([np.cos(np.pi / 6.0), 0.0, 0.5])
    env = ap.Environment(None, lower=(0, 0, 0), upper=(10_000, 10_000, 500))
    vehicle = ap.Vehicle(pitch_max=np.pi / 6.0 + 1e-4)
    dive = straight_plan(start, goal, 100.0, Conditions(env, vehicle, LIGHT))
    assert dive.feasible
    vehicle = ap.Vehicle(pitch_max=np.pi / 6.0)
    for updraught, broken in ((0.0, False), (0.1, True)):
        current = ap.UniformCurrent(0.0, 0.0, -updraught)
        assert outlook(dive, 0.0, 100.0, current, vehicle, LIGHT).broken is broken
