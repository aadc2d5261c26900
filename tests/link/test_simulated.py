"""The simulator as a vehicle: what it meets, what it reports, and what can go wrong with it."""

from dataclasses import replace

import numpy as np
import pytest

from auvplan.link import Lost, State, Upload, execute
from auvplan.link.notices import CurrentNotice, GoneNotice, ObstacleNotice
from auvplan.link.rolling import RollingPlan
from auvplan.link.simulated import SimulatedVehicle
from auvplan.simulation.faults import (
    CurrentStep,
    GivesUp,
    HeldUp,
    LinkOut,
    Obstacle,
    Restarts,
    SensorOut,
    Slower,
    TakenOver,
    WrongForecast,
)
from benchmarks.collisions import collisions
from benchmarks.faults import KINDS, MIXED, OF_A_LINK, draw
from tests.executive.small import scenario
from tests.export.sample import make_itinerary
from tests.link.scripted import SETTINGS

STILL = {
    "current": {"vortices": 0, "uniform": [0.0, 0.0, 0.0]},
    "simulation": {"obstacles": {"static": 0, "afloat": 0, "self_motivated": 0}},
}


def started(*faults, **sections):
    """A vehicle that is just begun with a plan of two legs, and the plan."""
    vehicle, plan = SimulatedVehicle(scenario(**STILL | sections), 1, faults=faults), Upload(make_itinerary())
    vehicle._place = plan.steps[0].position
    vehicle.upload(plan)
    vehicle.start(1)
    return vehicle, plan


def way(vehicle, seconds):
    before = vehicle.report(0.0).position
    return float(np.linalg.norm(vehicle.report(seconds).position - before))


def test_without_a_link_the_last_report_grows_old_and_nothing_is_heard():
    vehicle, plan = started(LinkOut(60.0, 100.0))
    known = vehicle.report(59.0)
    silent = vehicle.report(41.0)
    assert silent.heard == pytest.approx(41.0)
    assert (silent.position == known.position).all()
    for asked in (lambda: vehicle.upload(plan), vehicle.start, vehicle.hold, vehicle.surface):
        with pytest.raises(Lost):
            asked()
    assert list(vehicle.read()) == []
    heard = vehicle.report(60.0)
    assert heard.heard == 0.0
    assert np.linalg.norm(heard.position - known.position) > 90.0


@pytest.mark.parametrize(
    ("fault", "state"), [(GivesUp, State.FAULT), (TakenOver, State.STOPPED), (Restarts, State.IDLE)]
)
def test_what_ends_its_plan_is_said_and_it_makes_no_more_way(fault, state):
    vehicle, _ = started(fault(30.0))
    assert vehicle.report(29.0).state is State.EXECUTING
    depth = vehicle.report(2.0).position[2]
    report = vehicle.report(10.0)
    assert report.state is state
    assert report.position[2] == pytest.approx(depth - 5.0 if fault is GivesUp else depth)
    assert way(vehicle, 20.0) <= 10.0


def test_a_vehicle_is_as_fast_as_its_faults_leave_it():
    vehicle, _ = started(Slower(20.0, 0.5), HeldUp(40.0, 25.0))
    speed = way(vehicle, 20.0) / 20.0
    assert way(vehicle, 20.0) == pytest.approx(10.0 * speed, rel=0.01)
    assert way(vehicle, 25.0) == 0.0
    assert way(vehicle, 20.0) == pytest.approx(10.0 * speed, rel=0.01)


def test_a_vehicle_goes_each_leg_at_the_speed_of_that():
    vehicle, plan = started()
    speed = way(vehicle, 20.0) / 20.0
    legs = [
        replace(leg, speed=share * 1.75) for leg, share in zip(plan.itinerary.legs, (0.6, 1.2), strict=True)
    ]
    vehicle.upload(Upload(replace(plan.itinerary, legs=tuple(legs))))
    vehicle.start(1)
    assert way(vehicle, 20.0) == pytest.approx(12.0 * speed, rel=0.01)
    vehicle.start(4)
    assert way(vehicle, 20.0) == pytest.approx(24.0 * speed, rel=0.01)


def sightings(vehicle, seconds, step=2.0):
    found = []
    for _ in range(round(seconds / step)):
        vehicle.report(step)
        found += [notice for notice in vehicle.read() if isinstance(notice, ObstacleNotice)]
    return found


def test_an_obstacle_is_reported_once_it_is_seen_and_again_where_it_moves_otherwise():
    ahead = Obstacle(at=40.0, ahead=400.0, radius=30.0)
    vehicle, _ = started(ahead)
    (found,) = sightings(vehicle, 120.0)
    track = vehicle.record().legs[0]
    (row,) = np.flatnonzero(track.obstacle_positions[-1][:, 2] < 1e5)
    truth = track.obstacle_positions[-1][row]
    apart = np.linalg.norm(np.subtract(found.obstacle.position, truth[:2]))
    assert apart < found.obstacle.radius - 30.0 < 20.0
    assert sightings(started(ahead, SensorOut(0.0, 600.0))[0], 120.0) == []


def test_an_obstacle_that_turns_is_reported_again_by_the_same_name():
    current = {"vortices": 0, "uniform": [0.3, 0.0, 0.0]}
    vehicle, _ = started(
        Obstacle(at=2.0, ahead=400.0, aside=80.0),
        CurrentStep(60.0, (0.0, -0.6), known=False),
        current=current,
    )
    found = sightings(vehicle, 180.0)
    assert len({notice.obstacle.name for notice in found}) == 1
    assert len(found) > 1


def test_forecasts_that_change_are_reported():
    vehicle, _ = started(
        CurrentStep(10.0, (0.2, -0.1)), WrongForecast(20.0, 2.0), CurrentStep(21.0, (0, 1), False)
    )
    vehicle.report(12.0)
    (first,) = vehicle.read()
    vehicle.report(12.0)
    (second,) = vehicle.read()
    assert isinstance(first, CurrentNotice)
    assert first.velocity == pytest.approx([0.2, -0.1, 0.0], abs=1e-6)
    assert second.velocity == pytest.approx([0.4, 1.8, 0.0], abs=1e-6)


def test_what_it_meets_is_in_its_record():
    """A vehicle that takes no notice of what it sees runs into it; time of the record never goes back."""
    faults = [Obstacle(at=4.0, ahead=200.0, radius=40.0)]
    vehicle, plan = started(*faults)
    while vehicle.report(2.0).state is State.EXECUTING:
        pass
    run = vehicle.record()
    (hit,) = collisions(run, faults)
    assert hit.what == "obstacle"
    assert hit.avoidable
    times = np.concatenate([run.legs[0].times, run.legs[1].times[1:]])
    assert (np.diff(times) > 0.0).all()
    assert run.legs[1].positions[-1][:2] == pytest.approx(plan.steps[-1].position[:2], abs=1.0)


def test_legs_have_the_obstacles_that_missions_have():
    vehicle, _ = started(simulation={"obstacles": {"static": 1, "afloat": 1, "self_motivated": 1}})
    while vehicle.report(5.0).state is State.EXECUTING:
        pass
    kinds = [leg.obstacle_kinds for leg in vehicle.record().legs]
    assert kinds == [["static", "afloat", "self-motivated"]] * 2


def test_what_was_seen_is_gone_with_its_leg_however_long_nobody_heard():
    obstacles = {"static": 3, "afloat": 0, "self_motivated": 0}
    vehicle, _ = started(LinkOut(600.0, 1e4), simulation={"obstacles": obstacles})
    names = {notice.obstacle.name for notice in sightings(vehicle, 500.0)}
    assert names
    while vehicle.report(5.0).heard < 9e3:
        pass
    vehicle._faults.given.clear()
    assert {notice.name for notice in vehicle.read() if isinstance(notice, GoneNotice)} == names
    assert [leg.obstacle_positions.shape[1] for leg in vehicle.record().legs] == [3, 3]


@pytest.mark.usefixtures("light_search")
@pytest.mark.parametrize("seed", [3, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(20, 50))])
def test_whatever_goes_wrong_a_mission_ends_with_a_verdict(seed):
    """Two to six faults of any kind: it is said how the mission ended, and the vehicle comes up."""
    faults = draw(MIXED, KINDS | OF_A_LINK, np.random.default_rng(seed), 2000.0)
    plan, vehicle = RollingPlan(SETTINGS, 1), SimulatedVehicle(SETTINGS, 1, faults=faults)
    record = execute(plan, vehicle, notices=vehicle)
    assert record.reason
    assert record.success == (record.reason == "destination reached in time")
    assert len(set(record.tasks)) == len(record.tasks)
    assert record.route == list(dict.fromkeys(record.route)) or record.count("hazard") + record.count("drift")
    assert vehicle.now < record.t_available + 1000.0
    legs = vehicle.record().legs
    assert all((np.diff(leg.times) > 0.0).all() for leg in legs)
    if any(isinstance(fault, TakenOver) and fault.at < record.t_mission for fault in faults):
        assert not record.success
    elif record.success or "told to surface" not in record.safe:
        assert legs[-1].positions[-1][2] < 1.0
