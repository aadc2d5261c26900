"""What currents that are measured on the way are worth: ``python -m benchmarks.observed``.

Missions off Washington, as in `benchmarks.promises`: the truth is RTOFS, the forecast the same a lunar day
earlier, its members are up to four days old. How far off the true current is what is counted on for the rest
of a plan, after the current was measured at the beginning of each leg; and how missions end that are executed
in the simulator, where the vehicle measures it there.
"""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import auvplan as ap
from auvplan.executive.planning import load_area_at
from auvplan.link import execute
from auvplan.link.limits import Limits
from auvplan.link.rolling import RollingPlan
from auvplan.link.simulated import SimulatedVehicle
from auvplan.ocean.currents import Current, evaluated
from auvplan.scenario.area import OperatingArea
from benchmarks.harness import grouped, launch, means, show, track
from benchmarks.promises import ocean

#: What is made of a measured current.
COUNTED_ON = "the forecast", "the forecast, corrected", "the likeliest member, corrected"

COLUMNS = {
    "counted on": "{counted_on}", "rms, m/s": "{rms:.2f}", "in time": "{in_time} of {missions}",
    "priority": "{priority:.1f}", "tasks": "{tasks:.1f}", "uploads": "{uploads:.1f}",
}  # fmt: skip


def case(scenario: ap.Scenario, seed: int, how: str) -> dict[str, Any]:
    measures, one = how != COUNTED_ON[0], how != COUNTED_ON[2]
    planned_in = scenario.with_({"current.members": None}) if one else scenario
    plan, area = RollingPlan(planned_in, seed), load_area_at(scenario, [0.0])
    assert plan.plan()
    off = errors(plan, area, measures)
    plan, vehicle = RollingPlan(planned_in, seed), SimulatedVehicle(scenario, seed)
    record = execute(plan, vehicle, notices=vehicle if measures else None, limits=Limits(look=20.0))
    return {
        "seed": seed, "counted_on": how, "rms": off, "in_time": record.success, "reason": record.reason,
        "priority": record.total_priority, "tasks": len(record.tasks), "uploads": len(record.uploads),
    }  # fmt: skip


def errors(plan: RollingPlan, area: OperatingArea, measures: bool) -> float:
    """Return m/s, how far off the truth is what is counted on for the rest of a plan; mean of its legs."""
    assert area.truth is not None
    found = []
    for number, leg in enumerate(plan.legs):
        here, now = np.asarray(leg.positions[:1], float), np.asarray(leg.times[:1], float)
        if measures:
            plan.correct_current(velocities(area.truth, here, now)[0], here[0], float(now[0]))
        places, times = (
            np.concatenate([getattr(one, name)[::8] for one in plan.legs[number:]])
            for name in ("positions", "times")
        )
        counted_on = plan.followed.states[-1].sea.forecast()
        off = velocities(counted_on, places, times) - velocities(area.truth, places, times)
        found.append(np.sqrt((off**2).sum(axis=1).mean()))
    return float(np.mean(found))


def velocities(current: Current, places: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return a current [n, 3] m/s at [n, 3] m and [n] s."""
    x, y, z = np.asarray(places, float).T
    return np.stack(evaluated(current, x, y, z, times), axis=1)


@launch(seeds=(range(1000, 1008), "departures"))
def main(seeds: range) -> dict[str, Any]:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in track(seeds, "departures"):
            context = ocean(seed, Path(folder))[0].context
            rows += [case(context.scenario, seed, how) for how in COUNTED_ON]
    found = []
    for how, those in grouped(rows, lambda row: [row["counted_on"]]).items():
        counts = {"missions": len(those), "in_time": sum(row["in_time"] for row in those)}
        found.append({"counted_on": how} | counts | means(those, ("rms", "priority", "tasks", "uploads")))
    show("missions whose vehicle measures the current at every leg", found, COLUMNS)
    return {"means": found, "missions": rows}
