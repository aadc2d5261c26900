"""Missions of vehicles with power: as without it, and within the battery's energy where there is one."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.energy.power import Battery
from auvplan.errors import ScenarioError
from auvplan.executive import plan_scenario
from auvplan.io import save_run
from auvplan.mission.jobs import JobPoint, Jobs
from auvplan.runtime.compiled import compilations
from tests.executive.small import SMALL, scenario
from tests.executive.tide import CHANNEL, channel, tidal_area

pytestmark = pytest.mark.usefixtures("light_search")

PLAIN = scenario(
    mission=SMALL["mission"] | {"waypoints": 5, "neighbours": 3, "time_available": 4000},
)


def powered(**battery):
    power = {"hotel": 40, "turning": 20, "dive": 60, "task": 15, "propulsion": {"constant": 8, "factor": 12}}
    return PLAIN.with_({"vehicle.power": power | ({"battery": battery} if battery else {})})


def limited(capacity, **changes):
    battery = {"capacity": capacity, "usable": 0.9, "reserve": 0.25}
    return powered(**battery).with_(changes) if changes else powered(**battery)


def test_a_mission_is_the_same_with_power_and_no_battery():
    plain = ap.run_mission(PLAIN, seed=2)
    assert plain.success, plain.reason
    before = compilations()
    same = ap.run_mission(powered(), seed=2)
    assert compilations() == before, "programs know nothing of power"
    assert same.success
    assert same.reason == plain.reason
    assert len(same.legs) == len(plain.legs)
    for one, other in zip(same.legs, plain.legs, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)
        np.testing.assert_array_equal(one.times, other.times)
        assert one.speed is None


def test_tasks_are_chosen_within_the_energy_and_a_mission_without_enough_fails(tmp_path):
    enough = plan_scenario(limited(2000), seed=2)
    assert enough.success, enough.reason
    energy = enough.energy
    assert energy.times[-1] - energy.times[0] == pytest.approx(enough.t_mission, rel=1e-6)
    assert energy.totals["hotel"] == pytest.approx(40.0 * enough.t_mission / 3600.0, rel=1e-6)
    under_way = sum(leg.t_path for leg in enough.done) * (8.0 + 12.0 * 2.5**3) / 3600.0
    assert under_way <= energy.totals["propulsion"] < 1.5 * under_way
    assert energy.totals["tasks"] == pytest.approx(sum(leg.t_task for leg in enough.earning) * 15.0 / 3600.0)
    assert check_run(save_run(enough, tmp_path / "enough")).ok

    fewer = plan_scenario(limited(1.2 * energy.total), seed=2)
    assert fewer.success, fewer.reason
    assert fewer.energy.margin >= 0.0
    assert fewer.total_priority < enough.total_priority

    none = plan_scenario(limited(0.2 * energy.total), seed=2)
    assert not none.arrived
    assert "cannot be reached in time with the energy available" in none.reason
    assert "the way of least energy takes" in none.reason


def test_more_drawn_than_the_model_says_is_seen_and_planned_for(tmp_path):
    capacity = 1.45 * ap.run_mission(limited(2000), seed=2).energy.total
    said = ap.run_mission(limited(capacity), seed=2)
    drawn = ap.run_mission(limited(capacity, **{"simulation.draw": 1.3}), seed=2)
    assert drawn.arrived
    model = drawn.energy.scaled(1.0 / 1.3)
    assert drawn.energy.total == pytest.approx(1.3 * model.total)
    assert drawn.total_priority <= said.total_priority
    assert check_run(save_run(drawn, tmp_path / "drawn")).ok
    assert drawn.vehicle.power is not None
    small = replace(drawn.vehicle.power, battery=Battery(1.1 * drawn.energy.total, reserve=0.2))
    short = replace(drawn, vehicle=replace(drawn.vehicle, power=small))
    assert not short.success
    assert "Wh short of the battery's reserve: energy " in short.energy_lack
    assert "propulsion grew most, by " in short.energy_lack


@pytest.fixture(scope="module")
def free():
    return limited(320, **{"vehicle.speed_range": [1.5, 3.0]})


def test_speeds_of_legs_are_chosen_and_kept(free, tmp_path):
    run = ap.run_mission(free.with_({"current.vortices": 0}), seed=2)
    assert run.success, run.reason
    speeds = [leg.speed for leg in run.done]
    offered = np.linspace(1.5, 3.0, 9)
    assert all(np.abs(offered - speed).min() < 1e-9 for speed in speeds)
    for leg in run.done:
        through = np.linalg.norm(leg.motion.ground_velocity, axis=1)
        assert np.median(through[through > 0.0]) == pytest.approx(leg.speed, rel=1e-3)
    first = run.routes[0]
    assert len(first.speeds) == len(first.energies) == len(first.nodes) - 1
    assert sum(first.energies) / 3600.0 <= 0.75 * 0.9 * 320
    report = check_run(save_run(run, tmp_path / "run"))
    assert report.ok, str(report)
    again = ap.restore_run(tmp_path / "run")
    assert [leg.speed for leg in again.done] == pytest.approx(speeds)
    assert again.energy.total == pytest.approx(run.energy.total, rel=1e-4)


@pytest.mark.parametrize("own", ["station", "loiter"])
@pytest.mark.parametrize("tide", [0.0, 0.8])
def test_routes_price_waits_as_plans_do(own, tide):
    """The buoy's window opens long after the vehicle is there; a little less energy leaves the buoy out."""
    jobs = Jobs((
        JobPoint("buoy", (300.0, 40.0, 5.0), 3.0, 60.0, ((6000.0, 6300.0),)),
        JobPoint("float", (600.0, -40.0, 8.0), 2.0),
    ))  # fmt: skip
    area = replace(tidal_area(tide, 0.0), jobs=jobs)
    power = {"hotel": 30, "propulsion": {"constant": 5, "factor": 20}, "battery": {"reserve": 0.0}}

    def planned(capacity):
        mission = CHANNEL["mission"] | {"jobs": "jobs.csv", "wait": own, "time_available": 9000}
        given = channel(mission=mission, planning={"effort": "plain", "departures": 12})
        battery = power["battery"] | {"capacity": capacity}
        return plan_scenario(given.with_({"vehicle.power": power | {"battery": battery}}), area=area, seed=1)

    run = planned(2000.0)
    assert run.energy is not None
    assert run.energy.totals["propulsion"] > 0.0
    waited = max(leg.t_wait for leg in run.done)
    assert waited > 5000.0
    assert sum(run.routes[0].energies) / 3600.0 == pytest.approx(run.energy.total, rel=0.01)
    assert planned(1.1 * run.energy.total).total_priority == run.total_priority
    fewer = planned(0.95 * run.energy.total)
    assert fewer.success, fewer.reason
    assert fewer.total_priority < run.total_priority


def test_saved_time_and_saved_energy_are_what_they_say(free):
    fast, slow = (
        plan_scenario(free.with_({"planning.saves": saves}), seed=2) for saves in ("time", "energy")
    )
    assert fast.total_priority == slow.total_priority
    assert fast.t_mission < slow.t_mission
    assert slow.energy.total < fast.energy.total
    assert all(a.ends <= b.ends for a, b in pairwise(slow.done))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"vehicle.speed_range": [1.0, 3.0]}, "needs the vehicle's power"),
        ({"vehicle.speed_range": [3.0, 1.0], "vehicle.power": "jaiabot"}, "must be the least and then the"),
        (
            {
                "vehicle.speed_range": [2.0, 3.0],
                "vehicle.power": "jaiabot",
                "vehicle.saw_tooth": {"glide_angle": 26, "deep": 30},
            },
            "does not go with a saw-tooth",
        ),
        ({"vehicle.speed_range": [1.0, 2.0], "vehicle.power": "jaiabot"}, "must have vehicle.speed, 2.5 m/s"),
        (
            {"vehicle.speed_range": [2.0, 3.0], "vehicle.power": "jaiabot", "planning.preset": "paper"},
            "speeds are chosen for objective 'priority' alone",
        ),
    ],
)
def test_ranges_of_speeds_that_cannot_be_are_refused(changes, message):
    with pytest.raises(ScenarioError, match=message):
        PLAIN.with_(changes)
