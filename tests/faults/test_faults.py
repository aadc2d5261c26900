"""What each injected fault does, and which collisions count as avoidable."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import auvplan as ap
from auvplan.check.run import check_dataset
from auvplan.executive.belief import ObstacleBelief
from auvplan.executive.legs import ESCAPE_SPEED, escape_track
from auvplan.executive.loop import start_mission, step
from auvplan.executive.path_calls import plan_legs
from auvplan.executive.replans import hazard
from auvplan.io.results import to_dataset
from auvplan.path.motion import Motion
from auvplan.records import LegRecord, MissionRun
from auvplan.scenario.settings import SensorSettings
from auvplan.simulation.faults import (
    CurrentStep,
    Faults,
    HeldUp,
    Obstacle,
    PlannerOut,
    SensorOut,
    Slower,
    WrongForecast,
)
from auvplan.simulation.world import TrueObstacles
from benchmarks.collisions import collisions
from tests.executive.test_truth_and_belief import open_water
from tests.faults.sea import begun, context

PLACES = np.array([300.0, 900.0]), np.array([200.0, 700.0]), np.array([5.0, 5.0]), np.array([0.0, 50.0])


@pytest.fixture(scope="module")
def shared():
    return context()


def under_way(shared, *faults, looks=1):
    """A mission on its first leg after so many looks, struck by faults before the next one."""
    mission = begun(shared, 0)
    for _ in range(looks):
        step([mission])
    mission.faults.given += faults
    return mission


def test_faults_last_as_long_as_they_are_given():
    faults = Faults([HeldUp(100.0, 50.0), SensorOut(0.0, 1e4), Slower(200.0, 0.5), Slower(300.0, 0.5)])
    assert [faults.left(HeldUp, now) for now in (99.0, 100.0, 120.0, 150.0)] == [0.0, 50.0, 30.0, 0.0]
    assert [faults.speed(now) for now in (100.0, 250.0, 350.0)] == [1.0, 0.5, 0.25]


@pytest.mark.slow
def test_a_step_that_is_not_known_is_not_stated(shared):
    mission = under_way(shared, CurrentStep(0.0, (0.4, 0.0), known=False), WrongForecast(0.0, 0.0))
    mission.sea.advance(mission.now)
    np.testing.assert_allclose(mission.sea.field.uniform, [0.4, 0.0, 0.0], atol=1e-6)
    stated = mission.sea.forecast()
    np.testing.assert_allclose(np.stack(stated(*PLACES)), 0.0, atol=1e-6)


@pytest.mark.slow
def test_a_vehicle_that_is_held_up_stays_where_it_is(shared):
    mission = under_way(shared, HeldUp(0.0, 100.0))
    before, now = mission.active_leg.position, mission.now
    step([mission])
    np.testing.assert_array_equal(mission.active_leg.position, before)
    assert mission.now > now


@pytest.mark.slow
def test_a_slower_vehicle_is_noticed_and_reckoned_with(shared):
    mission = under_way(shared, Slower(0.0, 0.7))
    while mission.leg is not None:
        step([mission])
    assert mission.pace == pytest.approx(0.7, rel=1e-3)
    expected = mission.timed.leg_times(shared.speed)
    step([mission])
    slower = mission.timed.leg_times(shared.speed)
    open_edges = np.isfinite(expected) & np.isfinite(slower) & (mission.graph.duration == 0.0)
    if open_edges.any():
        assert (slower[open_edges] > expected[open_edges]).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "pace"), [(1.0, 1.0), (0.984, 1.0), (1.016, 1.0), (0.8, 0.8), (1.2, 1.2), (0.972, 0.972)]
)
def test_a_vehicle_that_is_slower_or_faster_than_thought_is_planned_with_at_its_pace(shared, factor, pace):
    """From a share of a fiftieth on."""
    mission = under_way(shared, Slower(0.0, factor))
    step([mission])
    assert mission.pace == pytest.approx(pace, rel=1e-3)
    assert mission.speed == pytest.approx(pace * shared.speed, rel=1e-3)
    plan_legs([mission], "window")
    plan = mission.active_leg.followed
    gaps, water = np.diff(np.asarray(plan.positions, float), axis=0), np.asarray(plan.water)
    through = gaps / np.diff(plan.times)[:, None] - water
    np.testing.assert_allclose(np.linalg.norm(through, axis=1), mission.speed, rtol=0.02)


@pytest.mark.slow
def test_an_obstacle_is_foreseen_at_the_pace_that_the_vehicle_makes(shared):
    """What drifts across the path is met by a vehicle at half its speed, and was gone by the plan's times."""
    mission = under_way(shared)
    leg = mission.active_leg
    step([mission])
    begins, plan = float(np.interp(leg.arc, leg.marks, leg.followed.times)), leg.followed
    place = np.asarray([np.interp(begins + 60.0, plan.times, axis) for axis in plan.positions.T])
    ahead = np.diff(plan.positions[-2:], axis=0)[0]
    aside = np.cross(ahead / np.linalg.norm(ahead), [0.0, 0.0, 1.0])
    # It is at the place at the time of a vehicle that is half as fast, and far from it at that of the plan.
    leg.belief.velocity[:] = 0.0
    leg.belief.position[:] = [0.0, 0.0, 1e6]
    leg.belief.radius[:], leg.belief.std[:] = 20.0, 0.0
    leg.belief.velocity[0], leg.belief.position[0] = 3.0 * aside, place - 3.0 * 120.0 * aside
    leg.belief.observed_at[:] = mission.now
    assert not hazard(mission)
    mission.pace = 0.5
    assert hazard(mission)


@pytest.mark.slow
def test_a_blind_vehicle_sees_nothing_new(shared):
    mission = under_way(shared, SensorOut(0.0, 1e4), Obstacle(0.0, 200.0))
    step([mission])
    belief = mission.active_leg.belief
    assert (belief.observed_at < mission.now - 1.0).all()
    assert belief.position[:, 2].max() > 1e5


@pytest.mark.slow
def test_without_a_planner_the_last_plan_is_followed(shared):
    mission = under_way(shared, PlannerOut(0.0, 200.0))
    plans = len(mission.active_leg.record.plans)
    step([mission])
    assert len(mission.active_leg.record.plans) == plans
    assert mission.active_leg.arc > 0.0


@pytest.mark.slow
def test_at_a_waypoint_the_vehicle_waits_for_its_planner(shared):
    never = [PlannerOut(0.0, 250.0)]
    mission = start_mission(replace(shared, faults=[never]), 0, jax.random.key(0), 0)
    step([mission])
    assert mission.run.charged_compute == pytest.approx(250.0)
    assert mission.active_leg.stretches[0][0][0] == pytest.approx(250.0)


@pytest.mark.slow
def test_an_obstacle_appears_where_it_is_said_to(shared):
    mission = under_way(shared, Obstacle(0.0, 120.0, 0.0, 25.0))
    leg, now = mission.active_leg, mission.now
    place = leg.position
    step([mission])
    row = int(np.flatnonzero(leg.truth.radius == 25.0)[0])
    records = np.concatenate([part[2] for part in leg.stretches])[:, row]
    times = np.concatenate([part[0] for part in leg.stretches])
    at = records[np.searchsorted(times, now)]
    assert np.linalg.norm(at - place) == pytest.approx(120.0, rel=1e-3)
    assert (records[times < now - 1e-6][:, 2] > 1e5).all()
    assert leg.record.obstacle_radii[row] == 25.0


def test_a_mission_with_faults_is_a_result_like_any_other(shared):
    given = [Obstacle(100.0, 150.0, 5.0, 40.0), Slower(300.0, 0.9), HeldUp(600.0, 60.0)]
    mission = start_mission(replace(shared, faults=[given]), 0, jax.random.key(2), 2)
    while not mission.ended:
        step([mission])
    report = check_dataset(mission.run.summary(), to_dataset(mission.run))
    assert not report.collisions, report
    assert not collisions(mission.run, given)


def test_an_escape_from_inside_a_boundary_leads_away():
    """Where all tracks begin inside a boundary, the one that leaves it is better than staying there."""
    truth = TrueObstacles(
        np.array([[42.0, 0.0, 0.0]]), np.array([[-0.7, 0.0, 0.0]]), np.ones(1), np.array([40.0]), ["afloat"]
    )
    sensors = SensorSettings(position_std=2.0, velocity_std=0.0)
    belief = ObstacleBelief(truth, truth.velocity, 0.0, sensors, np.random.default_rng(0))
    belief.look(np.zeros(3), truth, truth.velocity, 0.0)
    assert belief.clearance(np.zeros((1, 3)), np.zeros(1))[0] < 0.0
    track = escape_track(open_water(), np.zeros(3), 0.0, 30.0, belief.clearance, ESCAPE_SPEED * 2.5)
    assert track is not None
    assert track[-1, 0] < -20.0


def straight_run(obstacle: np.ndarray, radius: float, chart=None) -> MissionRun:
    """A record of 300 s to the north at 2.5 m/s past an obstacle at places [101, 3] m."""
    times = np.arange(101) * 3.0
    positions = np.stack([2.5 * times, 0.0 * times, 10.0 + 0.0 * times], axis=1)
    still = np.zeros((101, 3))
    ground = still + np.array([2.5, 0.0, 0.0])
    leg = LegRecord(
        0, 1, 300.0, 0.0, 1.0, times=times, positions=positions, motion=Motion.through_water(ground, still),
        obstacle_positions=obstacle[:, None], obstacle_radii=np.array([radius]), obstacle_kinds=["static"],
    )  # fmt: skip
    graph = ap.mission.random_graph(np.random.default_rng(0), positions[:4])
    return MissionRun({"name": "straight"}, 0, ap.Vehicle(), graph, chart, 0, 1, 1000.0, legs=[leg])


def test_what_was_seen_in_time_was_avoidable():
    ahead = np.tile([400.0, 0.0, 10.0], (101, 1))
    (hit,) = collisions(straight_run(ahead, 40.0))
    assert (hit.what, hit.avoidable) == ("obstacle", True)
    assert hit.time == pytest.approx(144.0, abs=3.0)
    assert "avoidable collision with obstacle 0" in str(hit)


def test_what_was_not_seen_or_came_too_suddenly_was_not():
    ahead = np.tile([400.0, 0.0, 10.0], (101, 1))
    (blind,) = collisions(straight_run(ahead, 40.0), [SensorOut(0.0, 1e4)])
    assert not blind.avoidable
    sudden = ahead.copy()
    sudden[:45, 2] = 1e6
    sudden[45:, 0] = 380.0  # appears at 135 s, 2.5 m ahead of the vehicle at 337.5 m
    (hit,) = collisions(straight_run(sudden, 40.0), [Obstacle(135.0, 42.5)])
    assert hit.sensed == pytest.approx(135.0) or np.isnan(hit.sensed)
    wall = replace_radius(sudden, 337.5)
    (inside,) = collisions(wall, [Obstacle(135.0, 42.5)])
    assert not inside.avoidable


def replace_radius(obstacle: np.ndarray, x: float) -> MissionRun:
    """An obstacle that appears around the vehicle itself."""
    around = obstacle.copy()
    around[45:, 0] = x
    return straight_run(around, 60.0)


def test_land_is_always_avoidable():
    water = np.ones((60, 60), bool)
    water[30:35, 28:32] = False
    chart = ap.Chart.from_mask(water, 10.0, (0.0, -300.0))
    nowhere = np.tile([0.0, 0.0, 1e6], (101, 1))
    (hit, *_) = collisions(straight_run(nowhere, 1.0, chart))
    assert (hit.what, hit.avoidable) == ("land", True)
