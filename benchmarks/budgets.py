"""How well planning calls keep a budget of wall-clock time, on a quiet machine and beside busy processes.

`python -m benchmarks.budgets [-n 40]` plans paths, re-plans and routes with budgets, after calls
that compile what is needed: how far they went beyond, and what they cost compared with the same call without
a budget.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache, partial
from itertools import product
from typing import Any

import jax
import numpy as np

import auvplan as ap
from auvplan.mission import random_graph
from auvplan.runtime import cores
from benchmarks.harness import clock, figures, launch, show
from benchmarks.paths.problems import path_problems

#: s.
BUDGETS = (0.1, 0.5)

COLUMNS = {
    "call": "{call}", "machine": "{machine}", "budget, s": "{budget:g}",
    "overrun: median": "{median:+.1%}", "95 %": "{p95:+.1%}", "worst": "{worst:+.1%}",
    "beyond a tenth": "{beyond a tenth} of {calls}", "worse by": "{worse by:+.2%}",
}  # fmt: skip

Call = Callable[[int, float | None], Any]


def calls() -> dict[str, tuple[Call, Callable[[Any], float]]]:
    """Planning calls by name, of a number and a budget, and what tells how bad an answer is."""
    problems = [problem for problem in path_problems() if problem.family == "open water"]
    key = jax.random.key(0)
    rng = np.random.default_rng(0)
    graphs = [random_graph(rng, rng.uniform(0.0, 8000.0, (40, 3)) * (1, 1, 0.01)) for _ in range(4)]
    quick = ap.PathConfig.quick()

    def posed(number: int) -> tuple:
        problem = problems[number % len(problems)]
        return problem.start, problem.goal, problem.environment, problem.vehicle

    def path(number: int, budget: float | None) -> ap.PathPlan:
        return ap.plan_path(*posed(number), key=jax.random.fold_in(key, number), budget=budget)

    def four(number: int, budget: float | None) -> ap.PathPlans:
        *ends, env, vehicle = posed(number)
        starts, goals = (np.tile(end, (4, 1)) for end in ends)
        return ap.plan_paths(starts, goals, env, vehicle, key=key, config=quick, budget=budget)

    @cache
    def before(number: int) -> ap.PathPlan:
        return ap.plan_path(*posed(number), key=key, config=quick)

    def anew(number: int, budget: float | None) -> ap.PathPlan:
        _, _, env, vehicle = posed(number)
        plan = before(number % len(problems))
        middle = len(plan.times) // 3
        at = plan.positions[middle], float(plan.times[middle])
        return ap.replan_path(plan, *at, env, vehicle, key=key, config=quick, budget=budget)

    def route(number: int, budget: float | None) -> ap.MissionRoute:
        graph = graphs[number % len(graphs)]
        return ap.plan_mission(graph, 0, 39, 14400.0, speed=2.5, key=key, budget=budget)

    def cost(plan: Any) -> float:
        return float(np.mean(plan.cost))

    return {
        "plan_path": (path, cost),
        "plan_paths, 4 legs": (four, cost),
        "replan_path": (anew, cost),
        "plan_mission, 40 waypoints": (route, lambda route: -float(route.priority)),
    }


@contextmanager
def busy() -> Iterator[None]:
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(cores.count())]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def timed(call: Call, worth: Callable[[Any], float], budget: float, count: int) -> dict[str, Any]:
    """Overruns of calls with a budget, as shares of it, and how much worse they are than without one."""
    over, worse = [], []
    for number in range(count):
        seconds, found = clock(partial(call, number, budget))
        over.append(seconds / budget - 1.0)
        found, best = worth(found), worth(call(number, None))
        worse.append((found - best) / abs(best))
    return figures(over) | {
        "beyond a tenth": int(np.sum(np.array(over) > 0.1)), "calls": count,
        "worse by": float(np.median(worse)),
    }  # fmt: skip


@launch(n=(40, "calls of each kind"))
def main(n: int) -> dict[str, Any]:
    rows = []
    for name, (call, worth) in calls().items():
        for number in range(n):  # compiles what each problem needs, and learns how long things take
            for budget in (None, 30.0, 0.1) if number < 4 else (None, 0.1):
                call(number, budget)
        for machine, budget in product(("as it is", "busy"), BUDGETS):
            with busy() if machine == "busy" else nullcontext():
                row = timed(call, worth, budget, n)
            rows.append({"call": name, "machine": machine, "budget": budget} | row)
    show("wall-clock time of planning calls against their budgets", rows, COLUMNS, names=2)
    return {"budgets": rows}
