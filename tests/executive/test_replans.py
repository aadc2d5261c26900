"""A plan in hand gives way to a faster one, or where it breaks a limit; to no other."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import auvplan as ap
from auvplan.executive import legs, path_calls, replans, seed_keys
from auvplan.executive.belief import ObstacleBelief
from auvplan.executive.context import make_context
from auvplan.executive.loop import start_mission
from auvplan.path.outlook import outlook
from auvplan.records import LegRecord
from auvplan.scenario.settings import SensorSettings
from auvplan.simulation.world import KINDS, TrueObstacles
from tests.executive.small import SMALL, planning, scenario

pytestmark = pytest.mark.usefixtures("light_search")

#: Obstacles too small to meet, in a world of the usual shapes.
NONE_NEAR = {
    "simulation": {"obstacles": SMALL["simulation"]["obstacles"] | {"radius": [0.01, 0.01], "speed": 0.0}},
    "sensors": {"prior_std": 0.0, "position_std": 0.0, "velocity_std": 0.0, "growth": 0.0},
}


def slowed(monkeypatch) -> list[int]:
    """Let plans from kept populations take half as long again; return how many were offered, by call."""
    calls, original = [], path_calls.replan_paths

    def offer(*args, **kwargs):
        found = original(*args, **kwargs)
        calls.append(len(found))
        begin = found.times[:, :1]
        times = begin + 1.5 * (found.times - begin)
        return replace(found, times=times, travel_time=1.5 * found.travel_time)

    monkeypatch.setattr(path_calls, "replan_paths", offer)
    return calls


@pytest.mark.parametrize(
    ("arc", "horizon", "speed", "meets"),
    [
        pytest.param(0.0, 130.0, 2.0, False, id="beyond the horizon"),
        pytest.param(0.0, 140.0, 2.0, True, id="within it"),
        pytest.param(300.0, 10.0, 2.0, True, id="at its centre"),
        pytest.param(329.0, 10.0, 2.0, True, id="on the way out"),
        pytest.param(331.0, 600.0, 2.0, False, id="passed"),
        pytest.param(0.0, 265.0, 1.0, False, id="beyond the horizon of a slow vehicle"),
        pytest.param(0.0, 275.0, 1.0, True, id="within that"),
    ],
)
def test_an_obstacle_between_the_only_two_samples_of_a_plan_is_a_hazard(arc, horizon, speed, meets):
    """1,000 m at 2 m/s, which the vehicle does late, and an obstacle of 30 m that stands at 300 m."""
    place = np.array([[300.0, 0.0, 0.0]])
    truth = TrueObstacles(place, np.zeros((1, 3)), np.zeros(1), np.array([30.0]), ["static"])
    exact = SensorSettings(prior_std=0.0, velocity_std=0.0, growth=0.0)
    belief = ObstacleBelief(truth, np.zeros((1, 3)), 0.0, exact, np.random.default_rng(0))
    how = SimpleNamespace(vehicle=SimpleNamespace(speed=2.0), config=SimpleNamespace(speed_reading="track"))
    places, times = np.array([[0.0, 0, 0], [1000.0, 0, 0]]), np.array([40.0, 540.0])
    plan = SimpleNamespace(positions=places, times=times, water=np.zeros((1, 3)), conditions=how)
    leg = SimpleNamespace(
        followed=plan, marks=np.array([0.0, 1000.0]), arc=arc, escaping=False, belief=belief, met=None
    )
    sensors = SimpleNamespace(scenario=SimpleNamespace(sensors=SimpleNamespace(interval=30.0)))
    mission = SimpleNamespace(active_leg=leg, now=5000.0, speed=speed, context=sensors)
    assert replans.hazard(mission, horizon) is meets
    # A current that is not the plan's counts once it is far from it, and for two looks.
    for current, sooner in ((0.4 * speed, False), (4.0, 0.0 <= 270.0 - arc < 60.0 * (speed + 4.0))):
        leg.met = np.array([current, 0.0, 0.0])
        assert replans.hazard(mission, horizon) is (meets or (sooner and horizon >= 60.0))


@pytest.fixture
def reviews(monkeypatch):
    """What the test itself finds of every re-plan.

    The review, the old and the new plan, time left on both in the review's forecast from where the vehicle
    is, and whether the old one breaks a limit.
    """
    found, original = [], legs.replan

    def judged(one, plan, sample):
        context = one.mission.context
        common = context.vehicle, context.path_config, context.area.closures
        return outlook(plan, sample, one.mission.now, one.forecast, *common)

    def spy(given):
        before = []
        for one in given:
            context = one.mission.context
            leg, now = one.mission.active_leg, one.mission.now
            old, arc = leg.followed, leg.arc
            if leg.escaping:
                before.append((old, np.inf, True))
                continue
            sample = np.interp(arc, leg.marks, np.arange(len(leg.marks)))
            rest = judged(one, old, sample)
            ahead = (leg.marks >= arc) & (
                old.times - np.interp(arc, leg.marks, old.times) < context.lookahead
            )
            times = now + old.times - np.interp(arc, leg.marks, old.times)
            meets = leg.belief.clearance(old.positions[ahead], times[ahead]).min(initial=np.inf) < 0.0
            before.append((old, rest.time_left, meets or rest.broken))
        original(given)
        for one, (old, left, broken) in zip(given, before, strict=True):
            new = one.mission.active_leg.followed
            kept = new.positions is old.positions
            found.append((one, old, new, left, left if kept else judged(one, new, 0.0).time_left, broken))

    monkeypatch.setattr(legs, "replan", spy)
    return found


def test_a_slower_plan_does_not_replace_one_that_keeps_all_limits(monkeypatch):
    calls = slowed(monkeypatch)
    settings = scenario(planning=SMALL["planning"] | {"window_change": 0.0}, **NONE_NEAR)
    run = ap.run_mission(settings, seed=0)
    assert run.success
    assert sum(calls) > len(run.done)
    assert {plan.cause for leg in run.legs for plan in leg.plans} == {"leg"}
    for leg in run.done:
        assert leg.t_path < 1.1 * leg.t_planned


@pytest.mark.parametrize("least", [0.0, 0.01])
def test_the_time_left_rises_with_no_replacement_of_a_plan_that_keeps_its_limits(reviews, least):
    runs = ap.run_missions(planning(window_change=least), seeds=range(2))
    replaced = [row for row in reviews if row[1].positions is not row[2].positions]
    kept = [row for row in reviews if row[1].positions is row[2].positions]
    for _, _, _, left, new, broken in replaced:
        assert broken or new <= (1.0 - least) * left + 0.1
    assert len(replaced) == sum(leg.path_replans for run in runs for leg in run.legs)
    # What is kept is timed in the forecast that it was judged in.
    for one, _, new, left, _, _ in kept:
        assert new.times[-1] - one.mission.now <= left + 0.1
    moved = [np.abs(np.diff(new.times) - np.diff(old.times)).max() for _, old, new, *_ in kept]
    assert max(moved) > 0.01


def test_what_takes_much_longer_than_what_was_left_is_planned_further_first(reviews, monkeypatch):
    slowed(monkeypatch)
    ap.run_missions(planning(), seeds=range(3, 6))
    assert any(len(one.offers) == 2 for one, *_ in reviews)
    for one, old, new, left, _, _ in reviews:
        replaced = new.positions is not old.positions
        if replaced and np.isfinite(left) and new.travel_time > replans.FURTHER * left:
            assert len(one.offers) == 2


def test_a_vehicle_looks_before_it_sets_out():
    """What is within sensor range of the start is known as well as sensors tell, the rest as before."""
    settings = scenario(sensors={"range": 300.0, "prior_std": 10.0, "position_std": 2.0})
    context = make_context(settings)
    mission = start_mission(context, 0, seed_keys([0])[0], 0)
    goal = int(np.asarray(mission.graph.adjacency)[0].argmax())
    legs.set_out(mission, LegRecord(0, goal, 0.0, 0.0, 0.0))
    leg = mission.active_leg
    away = np.linalg.norm(leg.truth.position - leg.origin, axis=1) - leg.truth.radius
    np.testing.assert_array_equal(leg.belief.std, np.where(away <= 300.0, 2.0, 10.0))


def test_what_may_be_met_soon_is_within_reach_of_both_speeds():
    truth = TrueObstacles(
        np.array([[600.0, 0.0, 0.0], [900.0, 0.0, 0.0]]),
        np.zeros((2, 3)),
        np.zeros(2),
        np.full(2, 50.0),
        list(KINDS[:2]),
    )
    for drift, expected in ((0.0, [True, False]), (1.0, [True, True])):
        moves = np.tile([-drift, 0.0, 0.0], (2, 1))
        sensors = SensorSettings(prior_std=0.0, velocity_std=0.0)
        belief = ObstacleBelief(truth, moves, 0.0, sensors, np.random.default_rng(0))
        belief.velocity = moves
        assert belief.within(np.zeros(3), 300.0, 2.0).tolist() == expected
