"""Plans without a simulation: exact repetition, known obstacles, departures, what reaches a vehicle."""

import math
import re
from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest

import auvplan as ap
from auvplan.check.run import check_dataset
from auvplan.executive import plan_departures, plan_scenario
from auvplan.executive.loop import seed_keys
from auvplan.export import itinerary_of
from auvplan.io.restore import restore_run
from auvplan.io.results import save_run, to_dataset
from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.ocean.known import KnownObstacle
from auvplan.scenario.area import OperatingArea
from auvplan.view.margins import Margins
from auvplan.view.sheet import sheet_of
from tests.executive.small import planning, scenario
from tests.executive.tide import CHANNEL, channel, channel_with, tidal_area

pytestmark = pytest.mark.usefixtures("light_search")

HOUR = 3600.0
#: In the middle of the channel, and one that meets the vehicle there; both 20 m wide.
ROCK = KnownObstacle("rock", (500.0, 0.0), 20.0)
FERRY = KnownObstacle("ferry", (900.0, 0.0), 20.0, 0.0, 12.0, (-1.0, 0.0))


@cache
def past(*obstacles, depart=0.0):
    """A leg through the channel past known obstacles."""
    area = replace(tidal_area(0.4, 0.0), obstacles=obstacles)
    return plan_scenario(channel(), area=area, depart=depart)


def jobs_in_the_channel(available=3000.0):
    """A mission with a point, a line and a job that takes too long for the time."""
    jobs = Jobs(
        (JobPoint("buoy", (300.0, 40.0, 5.0), 3.0, 60.0), JobPoint("far", (1000.0, 55.0, 5.0), 1.0, 9000.0)),
        (JobLine("line", ((500.0, -40.0, 8.0), (700.0, -40.0, 8.0)), 2.0, 0.0),),
    )
    settings = channel(mission=CHANNEL["mission"] | {"time_available": available})
    return plan_scenario(settings, area=replace(tidal_area(0.4, 0.0), jobs=jobs, obstacles=(ROCK,)))


@pytest.fixture(scope="module")
def run(light_search):
    return plan_scenario(scenario(), seed=1)


@pytest.fixture(scope="module")
def jobs(light_search):
    return jobs_in_the_channel()


def test_a_plan_meets_nothing_that_is_simulated_and_takes_the_planned_time(run):
    assert run.success
    assert not run.simulated
    for leg in run.done:
        assert len(leg.obstacle_radii) == 0
        plan = leg.plans[leg.followed]
        np.testing.assert_array_equal(leg.positions, plan.positions)
        np.testing.assert_array_equal(leg.times, plan.times)
        assert leg.path_replans == 0
    assert run.t_mission == pytest.approx(sum(leg.t_path + leg.t_task for leg in run.done), abs=0.1)


def test_the_same_plan_comes_again_to_the_last_bit_by_its_key(run):
    again = plan_scenario(scenario(), key=jax.random.key(1))
    assert again.t_mission == run.t_mission
    assert again.route == run.route
    for one, other in zip(run.legs, again.legs, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)
    assert run.summary() | {"seed": 0} == again.summary() | {"seed": 0}


def test_the_checker_finds_nothing_in_a_plan(run):
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


@pytest.mark.parametrize("obstacle", [ROCK, FERRY])
def test_a_plan_keeps_its_margin_to_known_obstacles_at_the_time_it_passes(obstacle):
    run = past(obstacle)
    assert run.success
    (leg,) = run.done
    fine = np.linspace(leg.times[0], leg.times[-1], 2000)
    places = np.stack([np.interp(fine, leg.times, axis) for axis in leg.positions.T], axis=1)
    centre = np.asarray(obstacle.position) + fine[:, None] * np.asarray(obstacle.velocity)
    level = np.linalg.norm(places[:, :2] - centre, axis=1) - obstacle.radius
    inside = places[:, 2] <= obstacle.depth_max
    assert level[inside].min() >= channel().safety.obstacles - 0.5
    straight = past()
    assert run.t_mission > straight.t_mission


def test_no_plan_leads_through_an_obstacle_that_closes_the_channel():
    run = past(KnownObstacle("boom", (500.0, 0.0), 80.0))
    assert not run.success
    assert "obstacle" in run.reason


@pytest.mark.parametrize("lines", ["part", "whole"])
def test_no_leg_goes_for_jobs_within_a_known_obstacle_and_the_sheet_says_so(lines):
    """Nor to the vertex of a line; its other part is done where lines may be done in part."""
    jobs = Jobs(
        (JobPoint("buoy", (300.0, 40.0, 5.0), 3.0, 60.0), JobPoint("wreck", (505.0, 0.0, 5.0), 9.0, 60.0)),
        (JobLine("line", ((400.0, 30.0, 8.0), (440.0, 30.0, 8.0), (490.0, 5.0, 8.0)), 2.0),),
    )
    settings = channel(mission=CHANNEL["mission"] | {"time_available": 3000.0, "lines": lines})
    run = plan_scenario(settings, area=replace(tidal_area(0.4, 0.0), jobs=jobs, obstacles=(ROCK,)))
    assert run.success
    assert [leg.refused for leg in run.legs if leg.refused] == []
    assert set(run.route) >= ({0, 1, 3, 4, 6} if lines == "part" else {0, 1, 6})
    assert not {2, 5} & set(run.route)
    left = {job.name: job for job in sheet_of(run).left_out}
    assert left.keys() == {"wreck", "line"}
    assert left["wreck"].priority == 9.0
    assert left["wreck"].reason.startswith("it lies within the known obstacle 'rock': move it")
    assert left["line"].reason.startswith("its vertex 3 lies within the known obstacle 'rock': move it")
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


def test_no_task_is_done_where_a_known_obstacle_comes_meanwhile():
    """A ferry over the buoy in the middle of the task; an hour later it is in nobody's way."""
    buoy = JobPoint("buoy", (300.0, 40.0, 5.0), 3.0, 300.0)
    settings = channel(mission=CHANNEL["mission"] | {"time_available": 3000.0})
    free = plan_scenario(settings, area=replace(tidal_area(0.4, 0.0), jobs=Jobs((buoy,))))
    (leg,) = (leg for leg in free.done if leg.priority)
    for late, crossed in ((150.0, True), (3600.0, False)):
        when = float(leg.times[-1]) + late
        ferry = KnownObstacle("ferry", (300.0, 40.0 + when), 20.0, 0.0, 12.0, (0.0, -1.0))
        area = replace(tidal_area(0.4, 0.0), jobs=Jobs((buoy,)), obstacles=(ferry,))
        run = plan_scenario(settings, area=area)
        assert run.success
        assert check_dataset(run.summary(), to_dataset(run)).faults == []
        left = [job.reason for job in sheet_of(run).left_out]
        assert len(left) == crossed
        assert all(
            "the leg from start was refused, ferry comes within 5 m of its goal" in why for why in left
        )
        # The plan that knows nothing of it is found out.
        unaware = replace(free, obstacles=(ferry,))
        faults = check_dataset(unaware.summary(), to_dataset(unaware)).faults
        assert any("'ferry' comes over it where it stays" in fault for fault in faults) == crossed
        apart = ferry.closest(leg.positions[-1], float(leg.times[-1]), float(leg.times[-1]) + leg.t_task)[1]
        assert Margins.of(unaware, leg).obstacle[-1] == pytest.approx(apart)


@pytest.mark.slow
def test_departures_promise_what_plans_hold():
    area = tidal_area(1.0, 0.3)
    settings = scenario(**{name: getattr(channel(), name).model_dump() for name in ("site", "chart")})
    settings = settings.model_copy(update={"current": channel().current})
    moments = [0.0, 0.5 * HOUR, 4.0 * HOUR]
    found = plan_departures(settings, moments, key=seed_keys([0])[0], area=area)
    assert found.routes is not None
    for k, depart in enumerate(moments):
        run = plan_scenario(settings, area=area, depart=depart)
        assert bool(found.feasible[k]) == run.success
        assert found.tasks[k] == run.tasks
        assert found.priority[k] == run.total_priority
        assert found.time[k] == pytest.approx(run.t_mission, abs=1e-2)
        assert found.routes[k] == run.route
        assert run.legs[0].times[0] == pytest.approx(0.0, abs=1e-2)
        assert run.site.epoch.hour + run.site.epoch.minute / 60.0 == 6.0 + depart / HOUR


def test_a_simulated_mission_knows_the_known_obstacles_for_certain():
    area = replace(tidal_area(0.4, 0.0), obstacles=(ROCK,))
    run = ap.run_mission(channel(), seed=0, area=area)
    assert run.success
    assert set(run.legs[0].obstacle_kinds) == {"known"}
    assert run.collisions == 0
    assert run.simulated


@pytest.mark.slow
def test_no_simulated_obstacle_reaches_a_vehicle_and_known_ones_that_stand_do():
    simulation = {"obstacles": {"static": 2, "afloat": 0, "self_motivated": 0, "radius": [5, 6]}}
    area = replace(tidal_area(0.4, 0.0), obstacles=(ROCK, FERRY))
    executed = ap.run_mission(channel(simulation=simulation), seed=0, area=area)
    assert executed.success
    assert executed.collisions == 0
    assert {"static", "known"} <= set(executed.legs[0].obstacle_kinds)
    for run in (executed, plan_scenario(channel(simulation=simulation), area=area)):
        itinerary = itinerary_of(run)
        (circle,) = itinerary.fences
        assert circle.centre == pytest.approx(ROCK.position)
        assert any("ferry" in note for note in itinerary.notes)
    assert any("simulated" in note for note in itinerary_of(executed).notes)


@pytest.mark.slow
def test_a_plan_is_restored_with_its_obstacles(tmp_path):
    run = plan_scenario(scenario(), area=OperatingArea(obstacles=(ROCK, FERRY)))
    again = restore_run(save_run(run, tmp_path))
    assert again.obstacles == run.obstacles
    assert not again.simulated


@pytest.mark.slow
def test_bounds_that_are_asked_for_are_planned_saved_restored_and_on_the_sheet(tmp_path, run):
    assert all(math.isnan(plan.gap) for leg in run.legs for plan in leg.plans)
    assert "paths" not in sheet_of(run).facts
    bounded = plan_scenario(planning(lower_bounds=True), seed=1)
    gaps = [leg.plans[0].gap for leg in bounded.legs]
    assert all(0.0 <= gap < 0.5 for gap in gaps)
    assert bounded.t_mission == run.t_mission
    save_run(bounded, tmp_path)
    assert [leg.plans[0].gap for leg in restore_run(tmp_path).legs] == pytest.approx(gaps)
    assert f"{max(gaps):.1%}" in sheet_of(bounded).facts["paths"]


def test_the_sheet_names_every_job_and_says_why_one_is_left_out(jobs):
    sheet = sheet_of(jobs)
    assert sheet.stops[0].name == "start"
    done = {stop.task for stop in sheet.stops if stop.task}
    assert done == {"buoy", "line"}
    (left,) = sheet.left_out
    assert left.name == "far"
    needed = float(re.search(r"(\d+) s would do", left.reason)[1])
    longer = jobs_in_the_channel(1.01 * needed)
    assert {stop.task for stop in sheet_of(longer).stops if stop.task} == {"buoy", "line", "far"}
    assert sheet.plain()["stops"][0]["utc"] == "2026-03-01T06:00:00Z"
    headings, rows = sheet.table()
    assert {len(row) for row in rows} == {len(headings)}
    brief, cells = sheet.table(brief=True)
    assert {len(row) for row in cells} == {len(brief)}


def test_the_sheet_says_of_a_job_that_fits_what_was_missed(jobs):
    """Had the vehicle as much time as the job asks for, the route with it would be the better one."""
    assert jobs.first_route is not None
    first = replace(jobs.first_route, time_available=19_000.0)
    longer = replace(jobs, t_available=20_000.0, first_route=first)
    (left,) = sheet_of(longer).left_out
    assert left.reason.endswith("which is in time: the search did not find that route, of 1 more priority")
    other = longer.scenario | {"planning": longer.scenario["planning"] | {"objective": "eq15"}}
    (left,) = sheet_of(replace(longer, scenario=other)).left_out
    assert left.reason.endswith("in time: planning.objective eq15 does not ask for most priority")
    worthless = replace(first, edge_priority=0.0 * first.edge_priority)
    (left,) = sheet_of(replace(longer, first_route=worthless)).left_out
    assert "lose 5 of their priority" in left.reason


def planned_on_charge(capacity, speeds, area, **mission):
    """A plan in the channel with a battery of a capacity, Wh, of which 0.7 may be used, or without one."""
    battery = None if capacity is None else {"capacity": capacity, "reserve": 0.2, "charge": 0.9}
    power = {"hotel": 40, "task": 60, "propulsion": {"constant": 8, "factor": 12}, "battery": battery}
    vehicle = {"power": power, "speed_range": speeds}
    return plan_scenario(channel(vehicle=vehicle, mission=CHANNEL["mission"] | mission), area=area)


@pytest.mark.parametrize("speeds", [None, [1.0, 3.0]])
def test_the_sheet_says_what_a_job_takes_for_which_the_battery_does_not_do(speeds):
    near, far = (
        JobPoint("near", (300.0, 40.0, 5.0), 3.0, 60.0),
        JobPoint("far", (700.0, 40.0, 5.0), 1.0, 900.0),
    )
    area = replace(tidal_area(0.4, 0.0), jobs=Jobs((near, far)))

    def planned(capacity):
        return planned_on_charge(capacity, speeds, area, time_available=3000.0)

    run = planned(50.0)
    (left,) = sheet_of(run).left_out
    assert left.name == "far"
    takes, have, needed = map(float, re.findall(r"([\d.]+) (?:of|Wh)", left.reason))
    assert have == pytest.approx(0.7 * 50.0)
    assert needed > max(have, takes) > run.energy.total
    whole = planned(1.01 * needed / 0.7)
    assert not sheet_of(whole).left_out
    assert whole.energy.total == pytest.approx(takes, rel=0.15 if speeds else 0.02)


def test_speeds_without_a_battery_are_those_of_an_ample_one():
    job = Jobs((JobPoint("job", (700.0, 40.0, 5.0), 1.0, 900.0),))
    area = replace(tidal_area(0.4, 0.0), jobs=job)
    free, ample = (planned_on_charge(capacity, [1.0, 3.0], area) for capacity in (None, 1e4))
    assert (free.success, free.tasks) == (True, 1)
    assert [leg.speed for leg in free.done] == [leg.speed for leg in ample.done]
    assert free.energy.total == pytest.approx(ample.energy.total)


@pytest.mark.parametrize("speeds", [None, [1.0, 3.0]])
def test_time_and_energy_that_the_sheet_says_would_do_are_enough_together(speeds):
    near = JobPoint("near", (300.0, 40.0, 5.0), 3.0, 60.0)
    far = JobPoint("far", (900.0, 40.0, 5.0), 1.0, 300.0)
    area = replace(tidal_area(0.4, 0.0), jobs=Jobs((near, far)))

    def planned(available, capacity):
        ends = {"start": (100.0, 0.0, 5.0), "goal": (400.0, 0.0, 5.0)}
        return planned_on_charge(capacity, speeds, area, time_available=available, **ends)

    short = planned(500.0, 20.0)
    (left,) = sheet_of(short).left_out
    assert left.name == "far"
    seconds, joules = map(float, re.search(r"([\d.]+) s and ([\d.]+) Wh would do$", left.reason).groups())
    assert seconds > 500.0
    assert joules > 0.7 * 20.0
    assert not sheet_of(planned(seconds, joules / 0.7)).left_out
    # Either of them alone is too little, and what is said then is what lacks.
    (left,) = sheet_of(planned(seconds, 20.0)).left_out
    assert re.search(r": [\d.]+ Wh would do$", left.reason)
    (left,) = sheet_of(planned(500.0, 100.0)).left_out
    assert re.search(r": [\d.]+ s would do$", left.reason)


def test_margins_of_the_sheet_are_those_of_the_path(jobs):
    sheet = sheet_of(jobs)
    for stop, leg in zip(sheet.stops[1:], jobs.done, strict=True):
        level = np.linalg.norm(leg.positions[:, :2] - np.asarray(ROCK.position), axis=1) - ROCK.radius
        assert stop.obstacle == pytest.approx(level.min(), abs=2.5)
        assert stop.coast is None
        assert stop.length / stop.ground_speed == pytest.approx(leg.t_path, rel=1e-3)


def test_a_route_that_no_longer_fits_is_planned_anew():
    stated, true = tidal_area(0.6, 0.0), tidal_area(-0.6, 0.0)
    jobs = Jobs(tuple(JobPoint(f"job {k}", (150.0 * k, 20.0, 5.0), 1.0, 30.0) for k in range(1, 6)))
    area = replace(stated, truth=true.truth, jobs=jobs)
    short = channel(mission=CHANNEL["mission"] | {"time_available": 620})
    run = ap.run_mission(short, seed=0, area=area)
    assert "late" in [route.cause for route in run.routes]
    later = [route for route in run.routes if route.cause == "late"]
    assert len(later[0].nodes) < len(run.routes[0].nodes) - 1


@pytest.mark.parametrize(("obstacle", "depart"), [(ROCK, 0.0), (FERRY, 0.0), (FERRY, 300.0)])
def test_the_checker_holds_the_track_to_known_obstacles(obstacle, depart):
    for known, hit in (((), True), ((obstacle,), False)):
        run = replace(past(*known, depart=depart), obstacles=(obstacle.after(depart),))
        faults = check_dataset(run.summary(), to_dataset(run)).faults
        assert any(f"inside {obstacle.name!r}" in fault for fault in faults) == hit
        assert hit or not faults


def test_the_shortest_way_that_is_too_long_is_by_the_currents_of_the_time_available():
    settings, area = channel_with(available=100.0, current={"source": "harmonic", "constituents": "t.yaml"})
    run = plan_scenario(settings, area=area)
    assert re.search(r"takes [\d.]+ s, [\d.]+ s are available\), by the currents of that time$", run.reason)
    run = plan_scenario(channel(mission=CHANNEL["mission"] | {"time_available": 100.0}))
    assert re.search(r"takes [\d.]+ s, [\d.]+ s are available\)$", run.reason)


def test_two_jobs_in_one_place_are_one_visit(tmp_path):
    """Both tasks are done one after the other, with nothing between them but the clock."""
    jobs = Jobs(
        (
            JobPoint("sample", (300.0, 40.0, 5.0), 3.0, 60.0),
            JobPoint("float", (700.0, -40.0, 8.0), 1.0, 30.0),
            JobPoint("photo", (300.0, 40.0, 5.0), 2.0, 90.0),
        )
    )
    rows = ["name,north,east,depth,priority,duration"]
    rows += ["sample,300,40,5,3,60", "float,700,-40,8,1,30", "photo,300,40,5,2,90"]
    (tmp_path / "jobs.csv").write_text("\n".join(rows))
    mission = CHANNEL["mission"] | {"jobs": "jobs.csv"}
    area = replace(tidal_area(0.4, 0.0), jobs=jobs, obstacles=(ROCK,))
    run = plan_scenario(channel(mission=mission), area=area, folder=tmp_path)
    assert run.success
    assert run.total_priority == 6.0
    places = [run.names[leg.goal] for leg in run.done]
    assert {places[0], places[1]} == {"sample", "photo"}
    stay = run.done[1]
    assert stay.t_path == pytest.approx(1.0, abs=1e-6)
    assert np.linalg.norm(np.diff(stay.positions, axis=0), axis=1).sum() == 0.0
    assert check_dataset(run.summary(), to_dataset(run)).faults == []
    sheet = sheet_of(run)
    assert {stop.task for stop in sheet.stops if stop.task} == {"sample", "float", "photo"}
    assert not [line for line in sheet.warnings if "speed over ground" in line]
    holds = {leg.goal_name: leg.hold for leg in itinerary_of(run).legs}
    assert (holds["sample"], holds["photo"]) == pytest.approx((60.0, 90.0))
