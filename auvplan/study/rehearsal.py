"""Rehearsal: a plan against simulated missions."""

from collections import Counter
from typing import Any

import xarray as xr

from auvplan.errors import ScenarioError
from auvplan.mission.jobs import jobs_done, jobs_of
from auvplan.records import MissionRun
from auvplan.scenario.scenario import Scenario
from auvplan.study.statistics import summarise


def require_one_sea(scenario: Scenario) -> None:
    """Raise ScenarioError where each seed is another mission altogether, in which no plan can hold."""
    if reason := scenario.differs_by_seed:
        raise ScenarioError(
            f"{reason}, in which no plan of one holds: a rehearsal needs currents from files, or none "
            "(vortices: 0), and mission.jobs, or one leg with start and goal"
        )


def rehearsal_of(planned: MissionRun, executed: xr.Dataset) -> dict[str, Any]:
    """Figures of how often a plan holds in missions of its scenario, ready for JSON.

    Returns:
        What `summarise` returns of the missions; the plan's figures; how many missions did each job, and how
        many did all that is planned, on time.
    """
    names = planned.names
    wanted = jobs_done(names, [(leg.start, leg.goal) for leg in planned.earning]) if names else set()
    done: Counter[str] = Counter()
    complete = 0
    for row in range(executed.sizes["mission"]):
        legs = {of: executed[f"leg_{of}"].values[row] for of in ("arrived", "priority", "from", "to")}
        earning = (legs["arrived"] == 1) & (legs["priority"] > 0.0)
        ends = zip(legs["from"][earning].tolist(), legs["to"][earning].tolist(), strict=True)
        found = jobs_done(names, [(int(i), int(j)) for i, j in ends]) if names else set()
        done.update(found)
        complete += bool(executed["success"].values[row] == 1 and wanted <= found)
    plan = {"tasks": planned.tasks, "total_priority": planned.total_priority, "time_s": planned.t_mission}
    jobs = [
        {"name": job.name, "planned": job.name in wanted, "done": done[job.name]} for job in jobs_of(names)
    ]
    more = {"plan": plan, "all_planned_tasks": complete, "jobs": jobs}
    return {"scenario": str(planned.scenario.get("name", ""))} | more | summarise(executed)
