"""Whole path plans: the presets against other people's searches on the same problem.

``python -m benchmarks.plans`` plans one leg past 12 vortices, 12 obstacles and a charted coast, each seed by
every contender in turn: 100 habitats for 100 iterations, so 10,100 evaluations each; the default preset adds
its gradient steps. Every plan is judged by the package's kernel. The compilation counts apart.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

import auvplan as ap
from benchmarks import path_peers
from benchmarks.machine import Turns, arguments, bars, console, empty_table, installed, take_turns, write
from benchmarks.scoring import Problem, problem

POPULATION, ITERATIONS = 100, 100
BATCH = 32
SEEDS = 10
#: Calls of `BATCH` plans at most.
BATCHED_SEEDS = 3


@dataclass(frozen=True)
class Row:
    """One way to plan.

    Attributes:
        seconds: median time of a plan.
        compile_seconds: how much longer the first call took.
        cost: s, mean over all plans; broken limits weigh a multiple of the straight line's time.
        median_cost: s.
        best_cost: s.
        feasible: share of plans that keep all limits.
    """

    name: str
    seconds: float
    compile_seconds: float
    cost: float
    median_cost: float
    best_cost: float
    feasible: float
    plans: int


@dataclass(frozen=True)
class Contender:
    """A way to plan.

    Attributes:
        search: ``search(seed) -> [N, 3 n]`` m, the best habitat of each of N plans.
        plans: N.
    """

    name: str
    search: path_peers.Search
    plans: int = 1


#: The paper's planner, with as many control points as the peers are given.
_PAPER = ap.PathConfig.paper(control_points=10)


def contenders(leg: Problem, screen: Console) -> list[Contender]:
    """The presets and the peers that are installed; a line for each that is not."""
    found = []
    for name, config in (("paper", _PAPER), ("default", ap.PathConfig())):
        bbo = config.bbo.replace(population=POPULATION, iterations=ITERATIONS)
        sized = config.replace(bbo=bbo)
        found.append(Contender(name, partial(_plan, leg, sized, 1)))
        found.append(Contender(f"{name}, {BATCH} in one call", partial(_plan, leg, sized, BATCH), BATCH))
    for name, packages, make in path_peers.PEERS:
        missing = " and ".join(package for package in packages if not installed(package))
        if missing:
            screen.print(f"{name}: left out, {missing} not installed: pip install {missing}")
        else:
            found.append(Contender(name, make(leg, POPULATION, ITERATIONS)))
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


def rows(screen: Console, progress: Progress, seeds: int = SEEDS) -> list[Row]:
    """All contenders with all seeds."""
    # The peers search the space of the paper's planner; the default's splines have more control points.
    leg = replace(problem(), config=ap.PathConfig(control_points=_PAPER.control_points))
    known = contenders(leg, screen)
    bar = progress.add_task("plans", total=len(known) * (seeds + 1))
    calls = {one.name: one.search for one in known}
    rounds = {one.name: min(seeds, BATCHED_SEEDS) if one.plans > 1 else seeds for one in known}
    turns = take_turns(calls, rounds, 999, partial(progress.advance, bar))
    progress.remove_task(bar)
    return [_row(leg, one, turns[one.name]) for one in known]


def _row(leg: Problem, one: Contender, turns: Turns) -> Row:
    scores = [_judged(leg, np.asarray(best, np.float32)) for best in turns.results]
    cost, violation = np.concatenate(scores, axis=1)
    return Row(
        name=one.name,
        seconds=turns.median / one.plans,
        compile_seconds=turns.compiling,
        cost=float(cost.mean()),
        median_cost=float(np.median(cost)),
        best_cost=float(cost.min()),
        feasible=float((violation == 0.0).mean()),
        plans=len(cost),
    )


def table(rows: list[Row]) -> Table:
    """All rows as one table."""
    title = f"Plans of {POPULATION} habitats x {ITERATIONS} iterations, one leg with coast"
    figures = ("time per plan", "compilation", "mean cost", "median", "best", "feasible", "plans")
    shown = empty_table(title, ["planner"], figures)
    for row in rows:
        shown.add_row(
            row.name, f"{1e3 * row.seconds:.1f} ms", f"{row.compile_seconds:.1f} s", f"{row.cost:,.1f} s",
            f"{row.median_cost:,.1f} s", f"{row.best_cost:,.1f} s", f"{row.feasible:.0%}", str(row.plans),
        )  # fmt: skip
    return shown


def main() -> None:
    """Print the table and write the file."""
    parser = arguments("Whole path plans against other searches.")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="plans of each contender")
    options = parser.parse_args()
    screen = console()
    with bars(screen) as progress:
        found = rows(screen, progress, options.seeds)
    screen.print(table(found))
    write(options.out, {"seeds": options.seeds, "rows": found})


if __name__ == "__main__":
    main()
