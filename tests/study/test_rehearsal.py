"""How a plan fares in simulated missions: shares and margins against the missions themselves."""

from dataclasses import replace

import pytest
import xarray as xr

import auvplan as ap
from auvplan.errors import ScenarioError
from auvplan.executive import plan_scenario
from auvplan.mission.jobs import JobPoint, Jobs
from auvplan.runtime.files import write_dataset
from auvplan.scenario import Scenario
from auvplan.study import Design
from auvplan.study.rehearsal import rehearsal_of, require_one_sea
from auvplan.study.table import row_of, table
from tests.executive.tide import CHANNEL, channel, tidal_area

pytestmark = pytest.mark.usefixtures("light_search")

#: Time for both jobs with the stream, and too little for the way against it.
SHORT = channel(mission=CHANNEL["mission"] | {"time_available": 620})


@pytest.fixture(scope="module")
def rehearsed(light_search):
    """A plan with a stream, one mission in that stream and one against it, and what is given of them."""
    jobs = Jobs(
        (JobPoint("near", (300.0, 20.0, 5.0), 1.0, 90.0), JobPoint("far", (700.0, 20.0, 5.0), 2.0, 90.0))
    )
    area = replace(tidal_area(0.6, 0.0), jobs=jobs)
    against = replace(area, truth=tidal_area(-0.6, 0.0).truth)
    plan = plan_scenario(SHORT, area=area)
    runs = [ap.run_mission(SHORT, seed=k, area=sea) for k, sea in enumerate((area, against))]
    executed = table(Design(SHORT, 2), [row_of(run) for run in runs], None)
    return plan, runs, rehearsal_of(plan, executed)


@pytest.mark.slow
def test_a_plan_holds_where_the_sea_is_as_forecast_and_not_against_it(rehearsed):
    plan, runs, found = rehearsed
    assert plan.tasks == found["plan"]["tasks"] == 2
    assert (runs[0].success, runs[1].success) == (True, False)
    assert runs[1].tasks == 2  # done, and then late
    assert found["all_planned_tasks"] == 1
    assert found["missions"] == 2


def test_shares_and_margins_are_those_of_the_missions(rehearsed):
    _, runs, found = rehearsed
    assert found["on_time"] == sum(run.success for run in runs)
    share = found["on_time_percent"]
    assert 0.0 <= share["low"] <= share["share"] == 50.0 * found["on_time"] <= share["high"] <= 100.0
    assert found["figures"]["t_residual_s"]["least"] == min(run.t_residual for run in runs)
    done = {job["name"]: job["done"] for job in found["jobs"]}
    assert sum(done.values()) == sum(run.tasks for run in runs)
    assert all(job["planned"] for job in found["jobs"])


def test_reasons_are_whole_in_a_file(rehearsed, tmp_path):
    runs = sorted(rehearsed[1], key=lambda run: len(run.reason))
    assert len(runs[0].reason) < len(runs[1].reason)
    executed = table(Design(SHORT, 2), [row_of(run) for run in runs], None)
    with xr.open_dataset(write_dataset(executed, tmp_path / "missions.nc"), engine="h5netcdf") as again:
        assert again["reason"].values.tolist() == [run.reason for run in runs]


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({}, "current.source 'vortices'"),
        ({"current": {"vortices": 0}}, "mission.waypoints"),
    ],
)
def test_what_differs_from_seed_to_seed_cannot_be_rehearsed(sections, words):
    with pytest.raises(ScenarioError, match=words):
        require_one_sea(Scenario.model_validate(sections))


def test_one_leg_in_one_sea_can_be_rehearsed():
    require_one_sea(channel())
