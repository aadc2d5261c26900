"""Hand-made evidence: figures that confirm every claim, to be spoiled one by one."""

import json

import numpy as np
import xarray as xr

from benchmarks.paper.claims import Evidence

SCENARIOS, SEEDS, ITERATIONS = ["scenario-1", "scenario-2", "scenario-3"], 4, 11
RATES = [0.0, 1.0, 4.0, 16.0]


def legs() -> xr.Dataset:
    """Searches that converge, re-plans that gain, no collision, costs that rise with the update rate."""
    fall = np.linspace(1.0, 0.0, ITERATIONS)
    shape = (len(SCENARIOS), SEEDS)
    histories = {
        "cost_mean": 2000.0 + 3000.0 * fall, "cost_std": 10.0 + 900.0 * fall,
        "cost_best": 1900.0 + 100.0 * fall, "violation_mean": 0.5 * fall, "violation_std": 0.2 * fall,
    }  # fmt: skip
    each = {
        "planned_s": 1900.0, "straight_s": 2000.0, "replan_gain": 0.02, "kept_cost": 900.0,
        "fresh_cost": 1000.0, "kept_iterations": 0.2, "success": 1.0, "collisions": 0.0, "feasible": 1.0,
    }  # fmt: skip
    excess = np.array([0.0, 1.0, 5.0, 20.0])[:, None]
    rate_cost = (1800.0 + 10.0 * np.arange(SEEDS)) * (1.0 + excess / 100.0)
    return xr.Dataset(
        {name: (("scenario", "seed"), np.full(shape, value)) for name, value in each.items()}
        | {
            name: (("scenario", "seed", "iteration"), np.broadcast_to(row, (*shape, ITERATIONS)).copy())
            for name, row in histories.items()
        }
        | {"rate_cost": (("rate", "rate_seed"), rate_cost)},
        {"scenario": SCENARIOS, "seed": range(SEEDS), "rate": RATES, "rate_seed": range(SEEDS)},
    )


def missions(count: int = 5) -> xr.Dataset:
    """Missions of two legs, the first of them late, that plan their order anew once."""
    legs_each, orders, stops = 11, 4, 18
    available, used = 14_400.0, 14_000.0
    expected = np.tile(np.linspace(300.0, 1500.0, legs_each), (count, 1))
    late = np.zeros((count, legs_each), bool)
    late[:, [1, 4, 8]] = True
    task = np.full((count, legs_each), 100.0)
    nodes = np.full((count, orders, stops), -1)
    nodes[:, 0] = np.arange(stops)
    nodes[:, 1:, :5] = np.arange(5)
    each = {
        "t_available": available, "t_mission": used, "t_residual": available - used, "success": 1,
        "collisions": 0, "path_calls": 11, "mission_replans": 3, "path_cpu": 2.0, "mission_cpu": 1.0,
        "travel_time_cpu": 0.0,
    }  # fmt: skip
    dataset = xr.Dataset(
        {name: ("mission", np.full(count, value)) for name, value in each.items()}
        | {
            "leg_t_expected": (("mission", "leg"), expected + task),
            "leg_t_path": (("mission", "leg"), expected * np.where(late, 1.05, 0.95)),
            "leg_t_task": (("mission", "leg"), task),
            "leg_arrived": (("mission", "leg"), np.ones((count, legs_each), int)),
            "route_nodes": (("mission", "order", "stop"), nodes),
            "route_priority": (("mission", "order"), np.full((count, orders), 47.0)),
            "route_time": (("mission", "order"), np.full((count, orders), 13_976.0)),
            "route_made_at": (("mission", "order"), np.full((count, orders), 0.0)),
            "route_cause": (("mission", "order"), np.tile([1, 2, 2, 2], (count, 1))),
            "reason": ("mission", np.full(count, "destination reached in time", object)),
        },
        {"seed": ("mission", np.arange(count))},
        {"scenario": json.dumps({"planning": {"preset": "paper", "task_time": "whole"}})},
    )
    dataset["route_cause"].attrs |= {
        "flag_values": np.arange(5, dtype=np.int8), "flag_meanings": "none start late early refused"
    }  # fmt: skip
    return dataset


def calls(count: int = 5) -> xr.Dataset:
    """Calls of a tenth of a second."""
    return xr.Dataset(
        {"first_cpu": ("mission", np.full(count, 0.1)), "window_cpu": ("mission", np.full(count, 0.03))},
        {"seed": ("mission", np.arange(count))},
    )


def evidence() -> Evidence:
    """All of it."""
    return Evidence(legs(), missions(), calls(), 30.0)
