"""Missions by the clock: expected times in a tide, waiting for windows, windows that are missed."""

from dataclasses import replace

import pytest

import auvplan as ap
from auvplan.export import itinerary_of
from auvplan.export.sheet import sheet_of
from auvplan.io.check import check_dataset
from auvplan.io.results import to_dataset
from auvplan.mission.jobs import JobPoint, Jobs
from auvplan.voyage import plan_departures, plan_scenario
from auvplan.voyage.executive import seed_keys
from tests.voyage.tide import CHANNEL, channel, tidal_waters

pytestmark = pytest.mark.usefixtures("light_search")

#: Of the task at the buoy: far later than the vehicle is there.
OPENS, CLOSES = 1200.0, 1500.0
PLANNING = {"effort": "plain", "departures": 4}


def windowed(windows=((OPENS, CLOSES),), north=0.4, truth=None, wait="station", **planning):
    """A channel with a buoy whose task has windows, and one whose task has none."""
    jobs = Jobs(
        (
            JobPoint("buoy", (300.0, 40.0, 5.0), 3.0, 60.0, windows),
            JobPoint("float", (600.0, -40.0, 8.0), 2.0),
        )
    )
    waters = replace(tidal_waters(north, 0.0), jobs=jobs)
    if truth is not None:
        waters = replace(waters, truth=tidal_waters(truth, 0.0).truth)
    mission = CHANNEL["mission"] | {"jobs": "jobs.csv", "wait": wait}
    return channel(mission=mission, planning=PLANNING | planning), waters


@pytest.fixture(scope="module")
def plan(light_search, tmp_path_factory):
    """A plan, and the file of its jobs for the checker."""
    folder = tmp_path_factory.mktemp("jobs")
    rows = ["name,north,east,depth,priority,duration,from,to"]
    rows += [f"buoy,300,40,5,3,60,{OPENS},{CLOSES + 60.0}", "float,600,-40,8,2,0,,"]
    (folder / "jobs.csv").write_text("\n".join(rows))
    settings, waters = windowed()
    return plan_scenario(settings, waters=waters, folder=folder)


def leg_to(run, name):
    """The leg that ends at a job, and when its task begins."""
    (leg,) = [leg for leg in run.done if run.names[leg.goal] == name]
    return leg, float(leg.times[-1]) + leg.t_wait


def test_a_plan_waits_for_its_window(plan):
    assert plan.success
    leg, begins = leg_to(plan, "buoy")
    assert begins == pytest.approx(OPENS)
    assert leg.t_wait > 300.0
    assert plan.total_priority == 5.0
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
    settings, waters = windowed(wait="none")
    run = plan_scenario(settings, waters=waters)
    assert run.success
    assert all(leg.t_wait == 0.0 for leg in run.done)
    (left,) = sheet_of(run).left_out
    assert left.name == "buoy"
    assert "06:20-06:25" in left.reason


def test_a_window_that_is_missed_is_told_with_the_time():
    settings, waters = windowed(((0.0, 30.0),))
    run = plan_scenario(settings, waters=waters)
    (left,) = sheet_of(run).left_out
    assert left.name == "buoy"
    assert "too late" in left.reason


def test_a_simulated_mission_keeps_its_windows_and_counts_no_task_out_of_them():
    """The sea is against the vehicle where it was told to be with it."""
    settings, waters = windowed(((0.0, 200.0),), north=0.6, truth=-0.6)
    run = ap.run_mission(settings, seed=0, waters=waters)
    for leg in run.done:
        begins = float(leg.times[-1]) + leg.t_wait
        if run.names[leg.goal] == "buoy" and leg.priority:
            assert begins <= 200.0 + 1e-6
        if leg.missed:
            assert leg.priority == leg.t_task == 0.0
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


def test_departures_agree_with_plans_and_windows_stay_where_they_are_on_the_clock():
    settings, waters = windowed()
    moments = [0.0, 600.0]
    found = plan_departures(settings, moments, key=seed_keys([0])[0], waters=waters)
    for k, depart in enumerate(moments):
        run = plan_scenario(settings, depart=depart, waters=waters)
        assert run.t_mission == pytest.approx(found.time[k])
        _, begins = leg_to(run, "buoy")
        assert begins + depart == pytest.approx(OPENS)


@pytest.mark.parametrize(("departures", "least", "most"), [(1, 0.02, 1.0), (12, 0.0, 0.01)])
def test_expected_times_hold_where_the_sea_is_timed_by_the_clock(departures, least, most):
    """Half a tide passes: priced as if sailed at the departure, the last legs take another time."""
    mission = CHANNEL["mission"] | {"time_available": 24_000, "jobs": "jobs.csv"}
    jobs = Jobs((JobPoint("long", (300.0, 40.0, 5.0), 3.0, 12_000.0),))
    waters = replace(tidal_waters(0.6, 0.0), jobs=jobs)
    settings = channel(mission=mission, planning=PLANNING | {"departures": departures})
    run = plan_scenario(settings, waters=waters)
    expected, sailed = run.orders[0].time - 12_000.0, run.t_mission - 12_000.0
    assert least <= abs(expected / sailed - 1.0) <= most
