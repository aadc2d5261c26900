"""Whole path plans: the presets against other people's searches on the same problem.

``python -m benchmarks.plans`` plans one leg past 12 vortices, 12 obstacles and a charted coast, each seed by
every contender in turn: 100 habitats for 100 iterations, so 10,100 evaluations each; the default preset adds
its gradient steps. Every plan is judged by the package's kernel. The compilation counts apart.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.progress import Progress

import auvplan as ap
from benchmarks import path_peers
from benchmarks.machine import arguments, available, bars, console, table, take_turns, write
from benchmarks.scoring import Problem, problem

POPULATION, ITERATIONS = 100, 100
BATCH = 32
SEEDS = 10
#: Calls of `BATCH` plans at most.
BATCHED_SEEDS = 3


#: A row for each way to plan; broken limits weigh a multiple of the straight line's time in the costs, s.
TITLE = f"Plans of {POPULATION} habitats x {ITERATIONS} iterations, one leg with coast"
COLUMNS = {
    "planner": "{name}", "time per plan": "{milliseconds:.1f} ms", "compilation": "{compile_seconds:.1f} s",
    "mean cost": "{cost:,.1f} s", "median": "{median_cost:,.1f} s", "best": "{best_cost:,.1f} s",
    "feasible": "{feasible:.0%}", "plans": "{plans}",
}  # fmt: skip

#: The paper's planner, with as many control points as the peers are given.
_PAPER = ap.PathConfig.paper(control_points=10)


def contenders(leg: Problem, screen: Console) -> dict[str, tuple[path_peers.Search, int]]:
    """The presets and the peers that are installed, with plans a call; a line for each that is not.

    Each is ``search(seed) -> [N, 3 n]`` m, the best habitat of each of N plans.
    """
    found = {}
    for name, config in (("paper", _PAPER), ("default", ap.PathConfig())):
        sized = config.replace(bbo=config.bbo.replace(population=POPULATION, iterations=ITERATIONS))
        found[name] = partial(_plan, leg, sized, 1), 1
        found[f"{name}, {BATCH} in one call"] = partial(_plan, leg, sized, BATCH), BATCH
    for name, packages, make in path_peers.PEERS:
        if available(name, packages, screen):
            found[name] = make(leg, POPULATION, ITERATIONS), 1
    return found


def _plan(leg: Problem, config: ap.PathConfig, count: int, seed: int) -> Any:
    """Best habitats [count, 3 n] m of `count` plans in one call."""
    starts, goals = (np.tile(np.asarray(end), (count, 1)) for end in (leg.start, leg.goal))
    key = jax.random.key(seed)
    plans = ap.plan_paths(starts, goals, leg.env, leg.vehicle, key=key, config=config)
    return plans.population[:, 0]


def _judged(leg: Problem, habitats: np.ndarray) -> np.ndarray:
    """[2, N], cost s and violation of habitats [N, 3 n] m of any number of control points."""
    config = leg.config.replace(control_points=habitats.shape[1] // 3)
    return np.stack(jax.jit(replace(leg, config=config).cost)(habitats))


def rows(screen: Console, progress: Progress, seeds: int = SEEDS) -> list[dict[str, Any]]:
    """All contenders with all seeds."""
    # The peers search the space of the paper's planner; the default's splines have more control points.
    leg = replace(problem(), config=ap.PathConfig(control_points=_PAPER.control_points))
    known, found = contenders(leg, screen), []
    bar = progress.add_task("plans", total=len(known) * (seeds + 1))
    calls = {name: search for name, (search, _) in known.items()}
    rounds = {name: min(seeds, BATCHED_SEEDS) if plans > 1 else seeds for name, (_, plans) in known.items()}
    turns = take_turns(calls, rounds, 999, partial(progress.advance, bar))
    progress.remove_task(bar)
    for name, (_, plans) in known.items():
        scores = [_judged(leg, np.asarray(best, np.float32)) for best in turns[name].pop("results")]
        cost, violation = np.concatenate(scores, axis=1)
        row = {"name": name, "plans": len(cost), "feasible": float((violation == 0.0).mean())} | turns[name]
        costs = ("cost", np.mean), ("median_cost", np.median), ("best_cost", np.min)
        row |= {key: float(figure(cost)) for key, figure in costs}
        row["seconds"] /= plans
        found.append(row | {"milliseconds": 1e3 * row["seconds"]})
    return found


def main() -> None:
    """Print the table and write the file."""
    parser = arguments("Whole path plans against other searches.")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="plans of each contender")
    options = parser.parse_args()
    screen = console()
    with bars(screen) as progress:
        found = rows(screen, progress, options.seeds)
    screen.print(table(TITLE, found, COLUMNS))
    write(options.out, {"seeds": options.seeds, "rows": found})


if __name__ == "__main__":
    main()
