"""How well travel times of edges foretell the paths that are planned for them, by effort.

``python -m benchmarks.travel_times [MISSIONS]`` simulates missions of the shipped Whitsunday scenario (16 by
default, some 300 legs) and prints, for d / |v| of Eq. 13 and for each level of effort, the error
|T - t_ij| / t_ij against the path planned at the leg's start (T_path) and against the time executed, both
without the task. Estimates are made as in a mission: from the forecast as the leg is planned.
"""

import sys
import time
from dataclasses import dataclass
from unittest.mock import patch

import jax
import jax.numpy as jnp
import numpy as np

import auvplan as ap
from auvplan.executive import path_calls, seed_keys
from auvplan.io.area import load_area
from auvplan.mission.travel_times import TravelTimeConfig, travel_times
from auvplan.ocean.vortices import LambVortices
from auvplan.path import PathConfig
from auvplan.records import LegRecord, MissionRun

LEVELS = {
    "straight line, 32 samples": TravelTimeConfig(PathConfig(control_points=6, samples=32)),
    "straight line, 64 samples": TravelTimeConfig(),
    "straight line, 128 samples": TravelTimeConfig(PathConfig(control_points=6, samples=128)),
    "4 gradient steps": TravelTimeConfig(steps=4),
    "8 gradient steps": TravelTimeConfig(steps=8),
    "16 gradient steps": TravelTimeConfig(steps=16),
    "10 control points, 128 samples, 60 steps": TravelTimeConfig(PathConfig(), steps=60),
}


@dataclass
class Planned:
    """A leg as it was planned at its start."""

    record: LegRecord
    start: np.ndarray
    goal: np.ndarray
    depart: float
    stated: LambVortices
    t_plan: float


def executed_legs(count: int) -> tuple[list[Planned], list[MissionRun]]:
    """Simulate missions and note the forecast at the start of every leg."""
    planned: dict[int, Planned] = {}
    call = path_calls._call

    def noting(context, missions, env, keys, cold):
        plans = call(context, missions, env, keys, cold)
        for row, mission in enumerate(missions):
            leg = mission.active_leg
            if not leg.stretches and id(leg.record) not in planned and plans.feasible[row]:
                stated = jax.tree.map(lambda a, row=row: np.asarray(a[row]), env.current)
                now, seconds = mission.now, float(plans.travel_time[row])
                planned[id(leg.record)] = Planned(leg.record, leg.origin, leg.target, now, stated, seconds)
        return plans

    with patch.object(path_calls, "_call", noting):
        runs = ap.run_missions(ap.load_scenario("whitsunday"), keys=seed_keys(range(count)))
    return [leg for leg in planned.values() if leg.record.arrived], runs


def describe(name: str, expected: np.ndarray, planned: np.ndarray, executed: np.ndarray, cost: float) -> None:
    """Print one row."""
    cells = []
    for actual in (planned, executed):
        error = np.abs(actual - expected) / expected
        cells += [np.median(error), error.mean(), np.corrcoef(expected, actual)[0, 1]]
    figures = " ".join(f"{cell:8.4f}" for cell in cells)
    print(f"{name:48} {figures} {cost:10.3f}", flush=True)


def main() -> None:
    """Print the table."""
    scenario = ap.load_scenario("whitsunday")
    legs, runs = executed_legs(int(sys.argv[1]) if len(sys.argv) > 1 else 16)
    starts, goals = np.stack([leg.start for leg in legs]), np.stack([leg.goal for leg in legs])
    departs = np.asarray([leg.depart for leg in legs])
    planned = np.asarray([leg.t_plan for leg in legs])
    executed = np.asarray([leg.record.t_path for leg in legs])
    stated = jax.tree.map(lambda *leaves: jnp.stack(leaves), *[leg.stated for leg in legs])
    area = scenario.area
    env = ap.Environment(stated, load_area(scenario).chart, None, area.lower, area.upper)
    print(f"{len(legs)} legs of {len(runs)} missions; columns: median and mean error, correlation")
    print(f"{'':48} {'against T_path planned':^26} {'against the time executed':^26} {'ms an edge':>10}")
    distance = np.linalg.norm(goals - starts, axis=1) / scenario.vehicle.speed
    describe("d / |v| (Eq. 13)", distance, planned, executed, 0.0)
    allowance = scenario.planning.detour * scenario.simulation.obstacles.total
    world = np.arange(len(legs))
    for name, config in LEVELS.items():
        times, seconds = [], np.zeros(len(legs))
        for _ in range(4):
            begin = time.perf_counter()
            seconds, _ = travel_times(starts, goals, env, ap.Vehicle(), departs, config, world)
            times.append(time.perf_counter() - begin)
        cost = 1e3 * min(times) / len(legs)
        describe(name, seconds, planned, executed, cost)
        describe(f"  and {allowance:.0f} s for obstacles", seconds + allowance, planned, executed, cost)
    task = np.asarray([leg.record.t_task for leg in legs])
    whole = np.asarray([leg.record.t_expected for leg in legs])
    describe("as used in the mission, without the task", whole - task, planned, executed, 0.0)
    describe("as used in the mission, with the task", whole, planned + task, executed + task, 0.0)
    describe("d / |v| with the task (Eq. 13)", distance + task, planned + task, executed + task, 0.0)


if __name__ == "__main__":
    main()
