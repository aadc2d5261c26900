"""How a plan fares in simulated missions: shares and margins against the missions themselves."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import auvplan as ap
from auvplan.errors import ScenarioError, StudyError
from auvplan.executive import plan_scenario
from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.mission.survey import LinePart
from auvplan.runtime.files import write_dataset
from auvplan.scenario import Scenario
from auvplan.study import Design
from auvplan.study.statistics import rehearsal_of, require_one_sea
from auvplan.study.table import row_of, table
from tests.executive.tide import CHANNEL, channel, tidal_area
from tests.io.sample_run import make_run

pytestmark = pytest.mark.usefixtures("light_search")

#: Time for both jobs with the stream, and too little for the way against it.
SHORT = channel(mission=CHANNEL["mission"] | {"time_available": 620})


def rehearsal(plan, runs):
    """What is given of a plan and its missions, and the dataset of these."""
    executed = table(Design(SHORT, len(runs)), [row_of(run) for run in runs], None)
    return rehearsal_of(plan, executed), executed


@pytest.mark.slow
def test_a_plan_holds_where_the_sea_is_as_forecast_and_not_against_it():
    """One mission is in the stream of the plan, and one against it."""
    jobs = Jobs(
        (JobPoint("near", (300.0, 20.0, 5.0), 1.0, 90.0), JobPoint("far", (700.0, 20.0, 5.0), 2.0, 90.0))
    )
    area = replace(tidal_area(0.6, 0.0), jobs=jobs)
    against = replace(area, truth=tidal_area(-0.6, 0.0).truth)
    plan = plan_scenario(SHORT, area=area)
    runs = [ap.run_mission(SHORT, seed=k, area=sea) for k, sea in enumerate((area, against))]
    found, _ = rehearsal(plan, runs)
    assert plan.tasks == found["plan"]["tasks"] == 2
    assert (runs[0].success, runs[1].success) == (True, False)
    assert runs[1].tasks == 2  # done, and then late
    assert found["all_planned_tasks"] == 1
    assert found["missions"] == 2


def two_tasks():
    """The made run as one of two jobs on the way."""
    run = make_run((0, 1, 2, 3))
    run.jobs = Jobs(tuple(JobPoint(name, (0.0, 0.0, 5.0)) for name in ("gauge", "wreck")))
    for leg, priority in zip(run.legs, (3.0, 3.0, 0.0), strict=True):
        leg.priority = priority
    return run


def test_shares_and_margins_are_those_of_the_missions(tmp_path):
    plan, *runs = (two_tasks() for _ in range(4))
    runs[1].t_available, runs[1].reason = runs[1].t_mission - 1.0, "destination reached too late, by a second"
    runs[2].legs[1].priority = 0.0
    found, executed = rehearsal(plan, runs)
    assert found["plan"] == {"tasks": 2, "total_priority": 6.0, "time_s": plan.t_mission}
    assert (found["missions"], found["on_time"], found["all_planned_tasks"]) == (3, 2, 1)
    share = found["on_time_percent"]
    assert share["share"] == pytest.approx(200.0 / 3.0)
    assert 0.0 <= share["low"] <= share["share"] <= share["high"] <= 100.0
    assert found["figures"]["t_residual_s"]["least"] == min(run.t_residual for run in runs) == -1.0
    done = {job["name"]: job["done"] for job in found["jobs"] if job["planned"]}
    assert done == {"gauge": 3, "wreck": 2}
    assert sum(done.values()) == sum(run.tasks for run in runs)
    # Reasons of several lengths are whole in a file.
    with xr.open_dataset(write_dataset(executed, tmp_path / "missions.nc"), engine="h5netcdf") as again:
        assert again["reason"].values.tolist() == [run.reason for run in runs]


def test_a_survey_line_counts_as_done_where_it_is_covered():
    """Of its two parts: one to four fifths, then both to a hundredth, then whole."""

    def surveyed(*priorities):
        run = make_run((0, 1, 2, 3))
        run.jobs = Jobs(lines=(JobLine("ridge", tuple((float(k), 0.0, 5.0) for k in range(3))),))
        for leg, priority in zip(run.legs, priorities, strict=True):
            leg.priority = priority
        return run

    plan = surveyed(0.0, 2.0, 2.0)
    found, _ = rehearsal(plan, [surveyed(0.0, 1.6, 2.0), surveyed(0.0, 1.98, 1.98), surveyed(0.0, 2.0, 2.0)])
    (ridge,) = found["jobs"]
    assert (ridge["name"], ridge["planned"], ridge["come_to"], ridge["done"]) == ("ridge", True, 3, 2)
    assert ridge["share"] == pytest.approx((3.6 + 3.96 + 4.0) / 12.0)
    assert found["all_planned_tasks"] == 2


def test_what_is_done_after_its_priority_has_fallen_is_done():
    """The second leg is along a line, of which it covers all or four fifths, and the last one to a point."""

    def surveyed(worth, off=0.0):
        run = make_run((0, 2, 3, 1))
        ends = np.array([run.legs[1].positions[k] for k in (0, -1)])
        ends -= off * (ends[1] - ends[0])
        run.legs[1].line = LinePart(*map(tuple, ends.tolist()), 10.0)
        run.jobs = Jobs((JobPoint("gauge", (0.0, 0.0, 5.0)),), (JobLine("ridge", tuple(map(tuple, ends))),))
        for leg, priority in zip(run.legs, (0.0, 6.0 * (1.0 - off), 2.0), strict=True):
            leg.priority = worth * priority
        return run

    found, _ = rehearsal(surveyed(1.0), [surveyed(1.0), surveyed(0.5), surveyed(2.0, 0.2)])
    gauge, ridge = found["jobs"]
    assert (gauge["done"], gauge["share"]) == (3, pytest.approx(1.0))
    assert (ridge["come_to"], ridge["done"], ridge["share"]) == (3, 2, pytest.approx(2.8 / 3.0))
    assert found["all_planned_tasks"] == 2


def test_a_study_that_does_not_say_what_is_covered_is_refused():
    plan = two_tasks()
    with pytest.raises(StudyError, match="no variable leg_line_covered: replace it with --force"):
        rehearsal_of(plan, rehearsal(plan, [plan])[1].drop_vars("leg_line_covered"))


@pytest.mark.parametrize(
    ("sections", "words"),
    [({}, "current.source 'vortices'"), ({"current": {"vortices": 0}}, "mission.waypoints")],
)
def test_what_differs_from_seed_to_seed_cannot_be_rehearsed(sections, words):
    with pytest.raises(ScenarioError, match=words):
        require_one_sea(Scenario.model_validate(sections))


def test_one_leg_in_one_sea_can_be_rehearsed():
    require_one_sea(channel())
