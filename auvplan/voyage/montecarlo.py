"""Many missions of one scenario, and what they tell together (section 4.2)."""

from typing import Any

import jax
import numpy as np

from auvplan.voyage.executive import Progress, run_missions
from auvplan.voyage.records import MissionRun
from auvplan.voyage.scenario import Scenario


def monte_carlo(
    scenario: Scenario, count: int, *, seed: int = 0, folder: str = ".", progress: Progress | None = None
) -> list[MissionRun]:
    """Run missions of seeds seed, seed + 1, ... in lockstep; each is the same as a single run of its seed."""
    seeds = range(seed, seed + count)
    keys = jax.vmap(jax.random.key)(np.asarray(seeds))
    return run_missions(scenario, keys=keys, seeds=seeds, folder=folder, progress=progress)


def statistics(runs: list[MissionRun]) -> dict[str, Any]:
    """Mean, standard deviation and quantiles of the missions' figures, and each summary, ready for JSON."""
    summaries = [run.summary() for run in runs]
    figures = {
        "use_of_time": [s["t_mission"] / s["t_available"] for s in summaries],
        "t_residual": [s["t_residual"] for s in summaries],
        "tasks": [s["tasks"] for s in summaries],
        "total_priority": [s["total_priority"] for s in summaries],
        "path_calls": [s["path_calls"] for s in summaries],
        "path_replans": [s["path_replans"] for s in summaries],
        "mission_replans": [s["mission_replans"] for s in summaries],
        "path_cpu_s": [leg["cpu_s"] for s in summaries for leg in s["legs"]],
        "mission_cpu_s": [order.cpu for run in runs for order in run.orders],
        "t_path_over_t_expected": [
            (leg.t_path + leg.t_task) / leg.t_expected for run in runs for leg in run.done
        ],
    }
    return {
        "missions": len(runs),
        "success": sum(s["success"] for s in summaries),
        "collisions": sum(s["collisions"] for s in summaries),
        "failed_seeds": [s["seed"] for s in summaries if not s["success"]],
        "figures": {name: _describe(values) for name, values in figures.items()},
        "runs": summaries,
    }


def _describe(values: list[float]) -> dict[str, float]:
    if not values:
        return {}
    array = np.asarray(values, float)
    low, median, high = np.quantile(array, [0.05, 0.5, 0.95])
    return {
        "mean": float(array.mean()),
        "std": float(array.std()),
        "q05": float(low),
        "median": float(median),
        "q95": float(high),
    }
