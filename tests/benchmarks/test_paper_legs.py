"""Figures of single legs follow from their records."""

from dataclasses import replace

import numpy as np
import pytest

from auvplan.ocean.vortices import LambVortices
from auvplan.records import LegRecord
from benchmarks.paper import legs
from benchmarks.paper.plots import boundaries, until_next
from tests.io.sample_run import make_plan, make_run

START, GOAL = np.array([300.0, 300.0, 20.0]), np.array([1500.0, 700.0, 20.0])


def stream(north: float, east: float) -> LambVortices:
    empty = np.zeros((1, 0))
    return LambVortices(np.zeros((1, 0, 2)), empty, empty, np.zeros(1), 0.0, np.array([north, east, 0.0]))


def line(start=START, goal=GOAL, count: int = 20) -> np.ndarray:
    return start + (goal - start) * np.linspace(0.0, 1.0, count)[:, None]


@pytest.fixture
def run():
    return make_run((0, 1))


@pytest.fixture
def leg(run) -> LegRecord:
    return run.legs[0]


@pytest.mark.parametrize(
    ("water", "seconds"), [((0.0, 0.0), 400.0), ((0.5, 0.0), 1000.0 / 3.0), ((0.0, 1.5), 500.0)]
)
def test_times_along_and_across_a_uniform_current(water, seconds):
    north = line(np.zeros(3), np.array([1000.0, 0.0, 0.0]))
    assert legs.time_along(north, stream(*water), 2.5) == pytest.approx(seconds, rel=1e-6)


def test_the_rest_of_a_plan_begins_at_the_vehicle_and_ends_at_the_goal():
    plan = make_plan(START, GOAL, 0.0, "leg", 0.0)
    here = plan.positions[10] + np.array([3.0, 0.0, 0.0])
    rest = legs.rest_of(plan, here)
    assert rest.shape == plan.positions.shape
    np.testing.assert_allclose(rest[[0, -1]], [here, GOAL])


def test_followed_plans_leave_out_retries_and_what_was_planned_over(leg):
    first, window = leg.plans
    hoped, warm = replace(first), replace(window, cause="hazard")
    # A second try was followed, the hope after it was not; the first plan for a hazard was planned over.
    leg.plans, leg.followed = [replace(first), first, hoped, warm, window], 1
    assert leg.followed_plans == [first, window]
    assert legs.followed(leg).plans == [first, window]
    assert LegRecord(0, 1, 1.0, 0.0, 0.0).followed_plans == []


def test_a_plan_ends_where_the_next_one_replaces_it(leg):
    first, second = leg.plans
    executed, given_up = until_next(leg.plans, 0)
    np.testing.assert_allclose(executed[[0, -1]], [first.positions[0], second.positions[0]])
    np.testing.assert_allclose(given_up[[0, -1]], [second.positions[0], first.positions[-1]])
    whole, nothing = until_next(leg.plans, 1)
    assert (len(whole), len(nothing)) == (len(second.positions), 0)


def test_a_re_plan_gains_what_its_path_is_shorter_by_in_still_water(run, leg):
    old, new = leg.plans = [replace(plan, current=stream(0.0, 0.0)) for plan in leg.plans]
    paths = new.positions, legs.rest_of(old, new.positions[0])
    after, before = (np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in paths)
    assert after < 0.99 * before
    assert legs.replan_gain(run) == pytest.approx(1.0 - after / before, rel=1e-6)
    leg.plans = leg.plans[:1]
    assert np.isnan(legs.replan_gain(run))


def test_displacement_is_the_farthest_step_aside(leg):
    leg.plans = [make_plan(START, GOAL, 0.0, "leg", 0.0), make_plan(START, GOAL, 100.0, "window", 60.0)]
    course = (GOAL - START) / np.linalg.norm(GOAL - START)
    assert legs.displacement(leg) == pytest.approx(60.0 * np.hypot(*course[1:]), rel=0.02)


def test_fitness_is_the_time_to_the_last_re_plan_and_its_cost(leg):
    first, window = leg.plans
    assert legs.fitness(leg) == pytest.approx(window.made_at - first.made_at + window.cost)


def with_history(best: list[float], place: np.ndarray = START) -> LegRecord:
    leg = make_run((0, 1)).legs[0]
    first, window = leg.plans
    history = window.history | {"best": np.array(best)}
    leg.plans = [first, replace(window, history=history, positions=line(place))]
    return leg


def test_kept_and_fresh_populations_are_compared_at_a_window_s_iterations_in_one_place():
    kept, fresh = with_history([900.0, 850.0, 800.0]), with_history([1500.0, 950.0, 870.0, 500.0])
    assert legs.warm_start(kept, fresh) == (800.0, 870.0, 0.5)
    assert legs.warm_start(fresh, kept) == (870.0, 800.0, 1.0)
    assert np.isnan(legs.warm_start(kept, with_history([1.0, 1.0], START + 50.0))).all()


def test_the_leg_shown_is_one_that_arrived_with_every_limit_kept():
    runs = [make_run((0, 1)) for _ in range(4)]
    for run, bend in zip(runs, (10.0, 200.0, 90.0, 50.0), strict=True):
        ahead, aside = make_plan(START, GOAL, 0.0, "leg", 0.0), make_plan(START, GOAL, 9.0, "window", bend)
        run.legs[0].plans = [ahead, replace(aside, feasible=bend < 200.0)]
    assert legs.shown_leg(runs, largest=True) is runs[2]
    assert legs.shown_leg(runs) is runs[3]


def test_boundaries_grow_until_the_vehicle_sees_the_obstacle_again(run, leg):
    run.scenario |= {"sensors": {"range": 150.0, "interval": 30.0, "growth": 0.1, "growth_max": 20.0}}
    begin, middle = float(leg.times[0]), float(leg.times[len(leg.times) // 2])
    assert boundaries(run, leg, begin)[1] == pytest.approx(leg.obstacle_radii)
    places, radii = boundaries(run, leg, begin + 60.0)
    np.testing.assert_allclose(radii, leg.obstacle_radii + 6.0)
    np.testing.assert_allclose(places[0], leg.obstacle_positions[0, 0])
    # The moving one passes within range at half of the way, the still one stays out of it.
    grown = boundaries(run, leg, middle + 1.0)[1] - leg.obstacle_radii
    assert grown[1] < 3.1
    assert grown[0] == pytest.approx(min(0.1 * (middle + 1.0 - begin), 20.0))


def test_a_dataset_of_legs_holds_the_figures_of_their_records():
    runs = {name: [make_run((0, 1)), make_run((0, 1))] for name in legs.SCENARIOS}
    found = legs.legs_dataset(legs.Legs(runs, runs, {0.0: runs["scenario-1"], 1.0: runs["scenario-2"]}))
    leg = runs["scenario-1"][0].legs[0]
    assert found.sizes["iteration"] == len(leg.plans[0].history["mean"])
    np.testing.assert_allclose(found["cost_mean"][0, 0], leg.plans[0].history["mean"])
    assert float(found["planned_s"][0, 0]) == pytest.approx(leg.t_planned)
    assert float(found["rate_time"][1, 0]) == pytest.approx(leg.t_path)
    assert (found["collisions"].values == 0).all()
    assert found["kept_cost"].values == pytest.approx(found["fresh_cost"].values)
