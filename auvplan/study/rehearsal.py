"""How a plan fares in simulated missions."""

from collections import Counter
from typing import Any

import numpy as np
import xarray as xr

from auvplan.errors import ScenarioError
from auvplan.mission.jobs import jobs_done, jobs_of
from auvplan.study.statistics import wilson_interval
from auvplan.voyage.records import MissionRun
from auvplan.voyage.scenario import Scenario


def require_one_sea(scenario: Scenario) -> None:
    """Raise ScenarioError where each seed is another mission altogether, in which no plan can hold."""
    current, mission = scenario.current, scenario.mission
    if current.source == "vortices" and current.vortices > 0:
        raise ScenarioError(
            "current.source 'vortices' draws another sea for each mission, in which no plan of one holds: a "
            "rehearsal needs currents from files, or none (vortices: 0)"
        )
    if mission.jobs is None and (mission.waypoints > 2 or mission.start is None or mission.goal is None):
        raise ScenarioError(
            "mission.waypoints are drawn anew for each mission: a rehearsal needs mission.jobs, or one leg "
            "with start and goal"
        )


def rehearsal_of(planned: MissionRun, sailed: xr.Dataset) -> dict[str, Any]:
    """Figures of how often a plan holds, ready for JSON.

    Args:
        planned: the plan.
        sailed: missions of the same scenario, as `run_study` returns them.

    Returns:
        Shares of missions on time and of those that did all planned tasks, each job's share, least margins.
    """
    success = sailed["success"].values.astype(bool)
    names, count = planned.names, len(success)
    wanted = jobs_done(names, [(leg.start, leg.goal) for leg in planned.earning]) if names else set()
    done: Counter[str] = Counter()
    complete = 0
    for row in range(count):
        legs = sailed.isel(mission=row)
        earning = (legs["leg_arrived"].values == 1) & (legs["leg_priority"].values > 0.0)
        ends = np.stack([legs["leg_from"].values, legs["leg_to"].values], axis=1)[earning]
        found = jobs_done(names, [(int(i), int(j)) for i, j in ends]) if names else set()
        done.update(found)
        complete += bool(success[row]) and wanted <= found
    _, low, high = (float(value) for value in wilson_interval(success))
    least = {
        "coast": _least(sailed["coast_clearance"].values),
        "obstacles": _least(sailed["obstacle_clearance"].values),
        "seabed": _least(sailed["seabed_altitude"].values),
        "time_left": float(sailed["t_residual"].values.min()),
    }
    return {
        "scenario": str(planned.scenario.get("name", "")),
        "missions": count,
        "on_time": int(success.sum()),
        "on_time_interval": [low, high],
        "all_planned_tasks": int(complete),
        "planned_tasks": planned.tasks,
        "planned_priority": planned.total_priority,
        "tasks": float(sailed["tasks"].values.mean()),
        "priority": float(sailed["total_priority"].values.mean()),
        "arrival_change_s": float((sailed["t_mission"].values - planned.t_mission)[success].mean())
        if success.any()
        else None,
        "collisions": int(sailed["collisions"].values.sum()),
        "faults": int(sailed["faults"].values.sum()),
        "least": least,
        "jobs": [
            {"name": job.name, "planned": job.name in wanted, "done": done[job.name]}
            for job in (jobs_of(names) if names else ())
        ],
        "failures": dict(Counter(str(reason) for reason in sailed["reason"].values[~success])),
    }


def _least(values: np.ndarray) -> float | None:
    """The least of some distances, m; None where there is nothing to be distant from."""
    least = float(values.min())
    return least if np.isfinite(least) and least < 1e5 else None
