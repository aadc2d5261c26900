"""How well travel times of edges foretell planned paths, by effort: ``python -m benchmarks.travel_times``.

Missions of the shipped Whitsunday scenario: for d / |v| of Eq. 13 and each level of effort, the error |T -
t_ij| / t_ij against the path planned at the leg's start and against the time executed, both without the
task.
"""

from functools import partial
from typing import Any
from unittest.mock import patch

import jax
import jax.numpy as jnp
import numpy as np

import auvplan as ap
from auvplan.executive import path_calls, seed_keys
from auvplan.io.area import load_area
from auvplan.mission.travel_times import TravelTimeConfig, Trips, travel_times
from auvplan.path import PathConfig
from benchmarks.harness import clock, launch, show

LEVELS = {
    "straight line": TravelTimeConfig(),
    "10 control points, 128 samples, 60 steps": TravelTimeConfig(PathConfig(), steps=60),
}

COLUMNS = {
    "times of edges": "{what}", "against T_path planned: median": "{planned_median:.4f}",
    "mean": "{planned_mean:.4f}", "correlation": "{planned_r:.4f}",
    "against the time executed: median": "{executed_median:.4f}", "mean ": "{executed_mean:.4f}",
    "correlation ": "{executed_r:.4f}", "ms an edge": "{cost:.3f}",
}  # fmt: skip


def executed_legs(count: int) -> list[tuple[Any, ...]]:
    """Simulate missions and note every leg as it was planned at its start.

    Returns:
        ``(record, start [3] m, goal [3] m, departure s, forecast, travel time s)`` of legs that arrived.
    """
    planned: dict[int, tuple[Any, ...]] = {}
    call = path_calls._call

    def noting(missions, env, keys, cold):
        plans = call(missions, env, keys, cold)
        for row, mission in enumerate(missions):
            leg = mission.active_leg
            if not leg.stretches and id(leg.record) not in planned and plans[row].feasible:
                stated = jax.tree.map(lambda a, row=row: np.asarray(a[row]), env.current)
                now, seconds = mission.now, float(plans[row].travel_time)
                planned[id(leg.record)] = leg.record, leg.origin, leg.target, now, stated, seconds
        return plans

    with patch.object(path_calls, "_call", noting):
        ap.run_missions(ap.load_scenario("whitsunday"), keys=seed_keys(range(count)))
    return [leg for leg in planned.values() if leg[0].arrived]


def row(what: str, expected: np.ndarray, planned: np.ndarray, executed: np.ndarray, cost: float) -> dict:
    found: dict[str, Any] = {"what": what, "cost": cost}
    for name, actual in (("planned", planned), ("executed", executed)):
        error = np.abs(actual - expected) / expected
        found |= {f"{name}_median": np.median(error), f"{name}_mean": error.mean()}
        found[f"{name}_r"] = np.corrcoef(expected, actual)[0, 1]
    return found


@launch(missions=(16, "to simulate"))
def main(missions: int) -> None:
    scenario, legs = ap.load_scenario("whitsunday"), executed_legs(missions)
    records, starts, goals, departs, stated, t_plan = zip(*legs, strict=True)
    starts, goals, planned = np.stack(starts), np.stack(goals), np.asarray(t_plan)
    names = "t_path", "t_task", "t_expected"
    executed, task, whole = (np.asarray([getattr(one, name) for one in records]) for name in names)
    area = scenario.area
    current = jax.tree.map(lambda *leaves: jnp.stack(leaves), *stated)
    env = ap.Environment(current, load_area(scenario).chart, None, area.lower, area.upper)
    distance = np.linalg.norm(goals - starts, axis=1) / scenario.vehicle.speed
    allowance = scenario.planning.detour * scenario.simulation.obstacles.total
    asked = Trips(starts, goals, np.asarray(departs)), env, ap.Vehicle()
    rows = [row("d / |v| (Eq. 13)", distance, planned, executed, 0.0)]
    for name, config in LEVELS.items():
        runs = [clock(partial(travel_times, *asked, config, np.arange(len(legs)))) for _ in range(4)]
        cost, seconds = 1e3 * min(took for took, _ in runs) / len(legs), runs[-1][1][0]
        rows.append(row(name, seconds, planned, executed, cost))
        what = f"  and {allowance:.0f} s for obstacles"
        rows.append(row(what, seconds + allowance, planned, executed, cost))
    both = planned + task, executed + task
    rows.append(row("as used in the mission, without the task", whole - task, planned, executed, 0.0))
    rows.append(row("as used in the mission, with the task", whole, *both, 0.0))
    rows.append(row("d / |v| with the task (Eq. 13)", distance + task, *both, 0.0))
    show(f"Errors of travel times: {len(legs)} legs of {missions} missions", rows, COLUMNS)
