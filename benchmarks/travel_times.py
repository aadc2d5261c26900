"""How well travel times of edges foretell planned paths, by effort: ``python -m benchmarks.travel_times``.

Missions of the shipped Whitsunday scenario: for d / |v| of Eq. 13 and each level of effort, the error |T -
t_ij| / t_ij against the path planned at the leg's start and against the time executed, both without the
task.
"""

import argparse
from typing import NamedTuple
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
from auvplan.records import LegRecord
from benchmarks.machine import clock

LEVELS = {
    "straight line, 32 samples": TravelTimeConfig(PathConfig(control_points=6, samples=32)),
    "straight line, 64 samples": TravelTimeConfig(),
    "straight line, 128 samples": TravelTimeConfig(PathConfig(control_points=6, samples=128)),
    "4 gradient steps": TravelTimeConfig(steps=4),
    "8 gradient steps": TravelTimeConfig(steps=8),
    "16 gradient steps": TravelTimeConfig(steps=16),
    "10 control points, 128 samples, 60 steps": TravelTimeConfig(PathConfig(), steps=60),
}


class Planned(NamedTuple):
    """A leg as it was planned at its start."""

    record: LegRecord
    start: np.ndarray
    goal: np.ndarray
    depart: float
    stated: LambVortices
    t_plan: float


def executed_legs(count: int) -> list[Planned]:
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
        ap.run_missions(ap.load_scenario("whitsunday"), keys=seed_keys(range(count)))
    return [leg for leg in planned.values() if leg.record.arrived]


def describe(name: str, expected: np.ndarray, planned: np.ndarray, executed: np.ndarray, cost: float) -> None:
    cells = []
    for actual in (planned, executed):
        error = np.abs(actual - expected) / expected
        cells += [np.median(error), error.mean(), np.corrcoef(expected, actual)[0, 1]]
    figures = " ".join(f"{cell:8.4f}" for cell in cells)
    print(f"{name:48} {figures} {cost:10.3f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Travel times of edges against paths.")
    parser.add_argument("missions", nargs="?", type=int, default=16)
    scenario, count = ap.load_scenario("whitsunday"), parser.parse_args().missions
    legs = executed_legs(count)
    records, starts, goals, departs, stated, t_plan = zip(*legs, strict=True)
    starts, goals, planned = np.stack(starts), np.stack(goals), np.asarray(t_plan)
    executed, task, whole = (
        np.asarray([getattr(record, name) for record in records])
        for name in ("t_path", "t_task", "t_expected")
    )
    area = scenario.area
    current = jax.tree.map(lambda *leaves: jnp.stack(leaves), *stated)
    env = ap.Environment(current, load_area(scenario).chart, None, area.lower, area.upper)
    print(f"{len(legs)} legs of {count} missions; columns: median and mean error, correlation")
    print(f"{'':48} {'against T_path planned':^26} {'against the time executed':^26} {'ms an edge':>10}")
    distance = np.linalg.norm(goals - starts, axis=1) / scenario.vehicle.speed
    describe("d / |v| (Eq. 13)", distance, planned, executed, 0.0)
    allowance = scenario.planning.detour * scenario.simulation.obstacles.total
    asked = starts, goals, env, ap.Vehicle(), np.asarray(departs)
    for name, config in LEVELS.items():
        runs = [
            clock(lambda config=config: travel_times(*asked, config, np.arange(len(legs)))) for _ in range(4)
        ]
        cost, seconds = 1e3 * min(took for took, _ in runs) / len(legs), runs[-1][1][0]
        describe(name, seconds, planned, executed, cost)
        describe(f"  and {allowance:.0f} s for obstacles", seconds + allowance, planned, executed, cost)
    describe("as used in the mission, without the task", whole - task, planned, executed, 0.0)
    describe("as used in the mission, with the task", whole, planned + task, executed + task, 0.0)
    describe("d / |v| with the task (Eq. 13)", distance + task, planned + task, executed + task, 0.0)


if __name__ == "__main__":
    main()
