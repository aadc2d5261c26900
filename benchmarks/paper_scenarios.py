"""The paper's three path scenarios with its own preset: does the violation of the best path reach zero?

``python -m benchmarks.paper_scenarios [--seeds 10] [--preset paper]`` prints one row a scenario: runs whose
first plan and whose every plan kept all limits, runs that arrived without collision, and the iteration at
which the best path of the first plan became free of violations.
"""

import argparse

import jax
import numpy as np

import auvplan as ap
from auvplan.io.scenario_file import validate_scenario

SCENARIOS = ("scenario-1", "scenario-2", "scenario-3")


def study(name: str, preset: str, seeds: int) -> str:
    """One row of the table."""
    plain = ap.load_scenario(name).model_dump(mode="json")
    plain["planning"]["preset"] = preset
    scenario = validate_scenario(plain, name)
    first, every, arrived, iterations, times = 0, 0, 0, [], []
    for seed in range(seeds):
        run = ap.run_mission(scenario, key=jax.random.key(seed), seed=seed)
        plans = [plan for leg in run.legs for plan in leg.plans]
        best = plans[0].history["violation_best"]
        first += bool(best[-1] == 0.0)
        every += all(plan.feasible for plan in plans)
        arrived += run.success and run.collisions == 0
        iterations.append(int(np.argmax(best == 0.0)))
        times.append(plans[0].times[-1] - plans[0].times[0])
    return (
        f"{name:12} {preset:8} {first:5}/{seeds} {every:9}/{seeds} {arrived:10}/{seeds} "
        f"{np.median(iterations):12.0f} {np.mean(times):14.1f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--preset", choices=("paper", "default"), default="paper")
    options = parser.parse_args()
    print(f"{'scenario':12} {'preset':8} {'first ok':>8} {'all plans ok':>12} {'arrived safe':>13} ", end="")
    print(f"{'iterations':>12} {'plan time [s]':>14}")
    for name in SCENARIOS:
        print(study(name, options.preset, options.seeds), flush=True)


if __name__ == "__main__":
    main()
