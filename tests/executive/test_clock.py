"""Missions by the clock: expected times in a tide, waiting for windows, windows that are missed."""

from dataclasses import replace
from datetime import timedelta

import pytest

import auvplan as ap
from auvplan.check.run import check_dataset
from auvplan.executive import plan_departures, plan_scenario
from auvplan.executive.loop import seed_keys
from auvplan.export import itinerary_of
from auvplan.io.geo import read_jobs
from auvplan.io.results import to_dataset
from auvplan.mission.jobs import JobPoint, Jobs
from auvplan.view.sheet import sheet_of
from tests.executive.tide import CHANNEL, EPOCH, channel, tidal_area

pytestmark = pytest.mark.usefixtures("light_search")

#: Of the task at the buoy: far later than the vehicle is there.
OPENS, CLOSES = 1200.0, 1500.0
#: Of its priority, from 3 to 2: before its window.
FALLS = 900.0
PLANNING = {"effort": "plain", "departures": 12}


def windowed(windows=((OPENS, CLOSES),), north=0.4, truth=None, wait="station", **planning):
    """A channel with a buoy whose task has windows, and one whose task has none."""
    jobs = Jobs(
        (
            JobPoint("buoy", (300.0, 40.0, 5.0), 3.0, 60.0, windows, ((FALLS, 2.0),)),
            JobPoint("float", (600.0, -40.0, 8.0), 2.0),
        )
    )
    area = replace(tidal_area(north, 0.0), jobs=jobs)
    if truth is not None:
        area = replace(area, truth=tidal_area(truth, 0.0).truth)
    mission = CHANNEL["mission"] | {"jobs": "jobs.csv", "wait": wait}
    return channel(mission=mission, planning=PLANNING | planning), area


@pytest.fixture(scope="module")
def plan(light_search, tmp_path_factory):
    """A plan, and the file of its jobs for the checker."""
    folder = tmp_path_factory.mktemp("jobs")
    rows = ["name,north,east,depth,priority,duration,from,to,priority_after"]
    rows += [f"buoy,300,40,5,3,60,{OPENS},{CLOSES + 60.0},{FALLS}/2", "float,600,-40,8,2,0,,,"]
    (folder / "jobs.csv").write_text("\n".join(rows))
    settings, area = windowed()
    return plan_scenario(settings, area=area, folder=folder)


def leg_to(run, name):
    """The leg that ends at a job, and when its task begins."""
    (leg,) = [leg for leg in run.done if run.names[leg.goal] == name]
    return leg, float(leg.times[-1]) + leg.t_wait


def test_a_plan_waits_for_its_window_though_the_priority_falls_before(plan):
    assert plan.success
    leg, begins = leg_to(plan, "buoy")
    assert begins == pytest.approx(OPENS)
    assert leg.t_wait > 300.0
    assert plan.total_priority == plan.routes[0].priority == 4.0, "its priority has fallen by then"
    assert check_dataset(plan.summary(), to_dataset(plan)).faults == []


def test_sheet_files_and_results_tell_the_wait(plan):
    leg, _ = leg_to(plan, "buoy")
    (stop,) = [stop for stop in sheet_of(plan).stops if stop.name == "buoy"]
    assert (stop.wait, stop.hold) == pytest.approx((leg.t_wait, 60.0))
    assert stop.window == "06:20-06:25"
    (row,) = [part for part in itinerary_of(plan).legs if part.goal_name == "buoy"]
    assert row.hold == pytest.approx(leg.t_wait + 60.0)
    saved = to_dataset(plan)
    assert saved["leg_t_wait"].values.sum() == pytest.approx(leg.t_wait)
    assert saved["window_closes"].values[plan.names.index("buoy")].tolist() == [CLOSES]


def test_a_vehicle_that_may_not_wait_comes_in_time_or_not_at_all():
    settings, area = windowed(wait="none")
    run = plan_scenario(settings, area=area)
    assert run.success
    assert all(leg.t_wait == 0.0 for leg in run.done)
    (left,) = sheet_of(run).left_out
    assert left.name == "buoy"
    assert "06:20-06:25" in left.reason


def test_a_window_that_is_missed_is_told_with_the_time():
    settings, area = windowed(((0.0, 30.0),))
    run = plan_scenario(settings, area=area)
    (left,) = sheet_of(run).left_out
    assert left.name == "buoy"
    assert "too late" in left.reason


@pytest.mark.slow
def test_a_simulated_mission_keeps_its_windows_and_counts_no_task_out_of_them():
    """The sea is against the vehicle where it was given to be with it."""
    settings, area = windowed(((0.0, 200.0),), north=0.6, truth=-0.6)
    run = ap.run_mission(settings, seed=0, area=area)
    for leg in run.done:
        begins = float(leg.times[-1]) + leg.t_wait
        if run.names[leg.goal] == "buoy" and leg.priority:
            assert begins <= 200.0 + 1e-6
        if leg.missed:
            assert leg.priority == leg.t_task == 0.0
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


def test_departures_agree_with_plans_and_windows_stay_where_they_are_on_the_clock(plan):
    settings, area = windowed()
    found = plan_departures(settings, [0.0, 600.0], key=seed_keys([0])[0], area=area)
    later = plan_scenario(settings, depart=600.0, area=area)
    for k, (run, depart) in enumerate(((plan, 0.0), (later, 600.0))):
        assert run.t_mission == pytest.approx(found.time[k])
        assert (run.tasks, run.total_priority, run.route) == (
            found.tasks[k],
            found.priority[k],
            found.routes[k],
        )
        assert run.site.epoch == EPOCH + timedelta(seconds=depart)
        assert run.legs[0].times[0] - run.legs[0].t_hold == pytest.approx(0.0, abs=1e-2)
        _, begins = leg_to(run, "buoy")
        assert begins + depart == pytest.approx(OPENS)


LINE = ((250.0, -30.0, 6.0), (450.0, -30.0, 6.0))


@pytest.fixture(scope="module")
def survey(light_search, tmp_path_factory):
    """A plan with a survey line that opens late, and a point whose priority falls before that."""
    folder = tmp_path_factory.mktemp("survey")
    rows = ["name,line,north,east,depth,priority,duration,from,to,priority_after"]
    rows += ["gauge,,300,40,5,3,60,,,500/1"]
    rows += [f",swath,{north},{east},{depth},4,30,{OPENS},2500," for north, east, depth in LINE]
    (folder / "jobs.csv").write_text("\n".join(rows))
    jobs = read_jobs(folder / "jobs.csv", None, until=3000.0)
    mission = CHANNEL["mission"] | {"jobs": "jobs.csv"}
    area = replace(tidal_area(0.4, 0.0), jobs=jobs)
    return plan_scenario(channel(mission=mission, planning=PLANNING), area=area, folder=folder)


def test_a_line_is_surveyed_in_its_window_and_a_priority_is_earned_before_it_falls(survey):
    assert survey.success
    (swath,) = [leg for leg in survey.done if leg.priority == 4.0]
    assert {survey.names[swath.start], survey.names[swath.goal]} == {"swath[1]", "swath[2]"}
    assert swath.times[0] >= OPENS - 1e-3
    assert swath.times[-1] + swath.t_task <= 2500.0
    gauge, begins = leg_to(survey, "gauge")
    assert (gauge.priority, survey.total_priority) == (3.0, 7.0)
    assert begins <= 500.0
    assert check_dataset(survey.summary(), to_dataset(survey)).faults == []
    stop = sheet_of(survey).stops[survey.done.index(swath) + 1]
    assert stop.window == "06:20-06:42"


def test_the_checker_sees_a_line_out_of_its_window_and_a_priority_that_has_fallen(survey):
    dataset = to_dataset(survey)
    moved = dataset.assign_coords(time=dataset["time"].copy(data=dataset["time"].values + 600.0))
    faults = check_dataset(survey.summary(), moved).faults
    assert any("counts a priority of 3, its tasks are worth 1" in fault for fault in faults)
    earlier = dataset.assign_coords(time=dataset["time"].copy(data=dataset["time"].values - 600.0))
    faults = check_dataset(survey.summary(), earlier).faults
    assert any("a part of line 'swath' from" in fault for fault in faults)


@pytest.mark.parametrize("change", [-1.0, 1.0])
def test_the_checker_sees_a_route_that_is_worth_something_else_at_the_times_it_expects(survey, change):
    dataset = to_dataset(survey)
    priority = dataset["route_priority"]
    faults = check_dataset(survey.summary(), dataset.assign(route_priority=priority + change)).faults
    assert f"route 0: its tasks are worth 7, its priority is given as {7 + change:g}" in faults


@pytest.mark.slow
@pytest.mark.parametrize(("departures", "least", "most"), [(1, 0.02, 1.0), (12, 0.0, 0.01)])
def test_expected_times_hold_where_the_sea_is_timed_by_the_clock(departures, least, most):
    """Half a tide passes: priced as if executed at the departure, the last legs take another time."""
    mission = CHANNEL["mission"] | {"time_available": 24_000, "jobs": "jobs.csv"}
    jobs = Jobs((JobPoint("long", (300.0, 40.0, 5.0), 3.0, 12_000.0),))
    area = replace(tidal_area(0.6, 0.0), jobs=jobs)
    settings = channel(mission=mission, planning=PLANNING | {"departures": departures})
    run = plan_scenario(settings, area=area)
    expected, executed = run.routes[0].time - 12_000.0, run.t_mission - 12_000.0
    assert least <= abs(expected / executed - 1.0) <= most


POWER = {"hotel": 20, "propulsion": {"constant": 5, "factor": 10}, "battery": {"capacity": 900}}


@pytest.mark.parametrize(
    "vehicle", [{}, pytest.param({"speed_range": [1.5, 2.5], "power": POWER}, marks=pytest.mark.slow)]
)
def test_where_the_stream_is_too_strong_for_every_leg_the_plan_fails_with_the_reason(vehicle):
    """Jobs that last: edges that the estimate closed are timed as in still water, without their tasks."""
    jobs = Jobs(
        (JobPoint("buoy", (300.0, 40.0, 5.0), 3.0, 60.0), JobPoint("float", (600.0, -40.0, 8.0), 2.0, 30.0))
    )
    area = replace(tidal_area(-4.0, 0.0), jobs=jobs)
    mission = CHANNEL["mission"] | {"jobs": "jobs.csv"}
    run = plan_scenario(channel(mission=mission, planning=PLANNING, vehicle=vehicle), area=area)
    assert not run.arrived
    assert "current 4.0 m/s against" in run.reason
    assert "the current is too strong for the vehicle" in run.reason
