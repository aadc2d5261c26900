"""Whole path plans: the presets against other people's searches on the same problem.

`python -m benchmarks.plans` plans one leg past 12 vortices, 12 obstacles and a charted coast, each seed by
every contender in turn, in 10,100 evaluations each; the default adds its gradient steps. Every plan is
judged by the package's kernel. Peers, each optional, search the same box in coordinates from 0 to 1 across
it, clipped to it. CMA-ES begins at the straight line, the others with uniform draws.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import auvplan as ap
from auvplan.path import habitats
from benchmarks.harness import Array, available, launch, show, take_turns
from benchmarks.scoring import Problem, in_c, problem

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

#: ``search(seed) -> [1, 3 n]`` m, the best habitat found.
Search = Callable[[int], Any]

#: First standard deviation of the CMA-ES, as a share of the box: the best of 0.02, 0.05, 0.1 and 0.25 here.
STEP = 0.05


def from_unit(problem: Problem, shares: Any) -> Any:
    """Habitats [P, 3 n] m from shares of the box [P, 3 n]."""
    low, high = problem.bounds()
    return low + (high - low) * jnp.clip(shares, 0.0, 1.0)


def straight(problem: Problem) -> jax.Array:
    """The straight line as shares of the box, [3 n]."""
    low, high = problem.bounds()
    line = habitats.straight_line(problem.start, problem.goal, problem.config)
    return (line - low) / jnp.maximum(high - low, 1e-6)


def mealpy_bbo(problem: Problem, population: int, iterations: int) -> Search:
    """`OriginalBBO` as mealpy runs it: one path at a time, here with the cost in C."""
    from mealpy import BBO, FloatVar

    score = in_c(problem.numbers())
    if score is None:
        raise RuntimeError("mealpy needs a C compiler, for its cost")
    paths = problem.paths(100)
    costs = np.asarray(problem.cost(paths)[0])
    if np.median(np.abs(score(np.asarray(paths))[0] / costs - 1.0)) > 1e-4:
        raise RuntimeError("the kernel in C and the package's kernel disagree on the costs")
    low, high = (np.asarray(bound, float) for bound in problem.bounds())
    bounds = FloatVar(lb=low.tolist(), ub=high.tolist())

    def cost(habitat: Array) -> float:
        return float(score(np.ascontiguousarray(habitat[None], np.float32))[0][0])

    def search(seed: int) -> Any:
        task = {"obj_func": cost, "bounds": bounds, "minmax": "min", "log_to": None}
        best = BBO.OriginalBBO(epoch=iterations, pop_size=population).solve(task, seed=seed)
        return best.solution[None]

    return search


def evosax(problem: Problem, population: int, iterations: int, name: str) -> Search:
    """A search of evosax in one compiled scan."""
    from evosax import algorithms

    box, is_cma = jnp.zeros(problem.bounds()[0].shape), name == "CMA_ES"
    method = getattr(algorithms, name)(population, box)
    params = method.default_params
    params = params.replace(std_init=jnp.asarray(STEP)) if is_cma else params

    def cost(shares: jax.Array) -> jax.Array:
        return problem.cost(from_unit(problem, shares))[0]

    @jax.jit
    def run(key: jax.Array, params: Any) -> jax.Array:
        def generation(state: Any, key: jax.Array) -> tuple[Any, None]:
            ask_key, tell_key = jax.random.split(key)
            shares, state = method.ask(ask_key, state, params)
            return method.tell(tell_key, shares, cost(shares), state, params)[0], None

        first_key, key = jax.random.split(key)
        if is_cma:
            state = method.init(first_key, straight(problem), params)
        else:
            draw_key, first_key = jax.random.split(first_key)
            shares = jax.random.uniform(draw_key, (population, box.size))
            state = method.init(first_key, shares, cost(shares), params)
        state, _ = jax.lax.scan(generation, state, jax.random.split(key, iterations + is_cma))
        return from_unit(problem, state.best_solution[None])

    return lambda seed: run(jax.random.key(seed), params)


def pycma(problem: Problem, population: int, iterations: int) -> Search:
    """CMA-ES of the `cma` package, which calls the compiled kernel once a generation."""
    import cma

    low, high = (np.asarray(bound, float) for bound in problem.bounds())
    score = jax.jit(lambda shares: problem.cost(from_unit(problem, shares))[0])
    start = np.asarray(straight(problem), float)

    def search(seed: int) -> Any:
        options = {"bounds": [0.0, 1.0], "popsize": population, "maxiter": iterations + 1}
        options |= {"seed": seed + 1, "verbose": -9}
        strategy = cma.CMAEvolutionStrategy(start, STEP, options)
        for _ in range(iterations + 1):
            shares = strategy.ask()
            strategy.tell(shares, np.asarray(score(np.asarray(shares, np.float32)), float).tolist())
        return low + (high - low) * np.clip(np.asarray(strategy.result.xbest), 0.0, 1.0)[None]

    return search


#: Maker of every peer, by its name, which begins with that of the package.
PEERS: dict[str, Callable[[Problem, int, int], Search]] = {
    "mealpy OriginalBBO": mealpy_bbo, "evosax DE": partial(evosax, name="DifferentialEvolution"),
    "evosax CMA-ES": partial(evosax, name="CMA_ES"), "cma CMA-ES": pycma,
}  # fmt: skip


#: The paper's planner, with as many control points as the peers are given.
_PAPER = ap.PathConfig.paper(control_points=10)


def contenders(leg: Problem) -> dict[str, tuple[Search, int]]:
    """The presets and the peers that are installed, with plans a call; a line for each that is not.

    Each is ``search(seed) -> [N, 3 n]`` m, the best habitat of each of N plans.
    """
    found = {}
    for name, config in (("paper", _PAPER), ("default", ap.PathConfig())):
        sized = config.replace(bbo=config.bbo.replace(population=POPULATION, iterations=ITERATIONS))
        found[name] = partial(_plan, leg, sized, 1), 1
        found[f"{name}, {BATCH} in one call"] = partial(_plan, leg, sized, BATCH), BATCH
    for name, make in PEERS.items():
        if available(name, name.split()[:1]):
            found[name] = make(leg, POPULATION, ITERATIONS), 1
    return found


def _plan(leg: Problem, config: ap.PathConfig, count: int, seed: int) -> Any:
    """Best habitats [count, 3 n] m of `count` plans in one call."""
    starts, goals = (np.tile(np.asarray(end), (count, 1)) for end in (leg.start, leg.goal))
    key = jax.random.key(seed)
    plans = ap.plan_paths(starts, goals, leg.env, leg.vehicle, key=key, config=config)
    return plans.population[:, 0]


def rows(seeds: int = SEEDS) -> list[dict[str, Any]]:
    # The peers search the space of the paper's planner; the default's splines have more control points.
    leg = replace(problem(), config=ap.PathConfig(control_points=_PAPER.control_points))
    known, found = contenders(leg), []
    calls = {name: search for name, (search, _) in known.items()}
    rounds = {name: min(seeds, BATCHED_SEEDS) if plans > 1 else seeds for name, (_, plans) in known.items()}
    turns = take_turns(calls, rounds, 999)
    for name, (_, plans) in known.items():
        best = np.concatenate([np.asarray(found, np.float32) for found in turns[name].pop("results")])
        sized = replace(leg, config=leg.config.replace(control_points=best.shape[1] // 3))
        cost, violation = (np.asarray(part) for part in jax.jit(sized.cost)(best))
        row = {"name": name, "plans": len(cost), "feasible": float((violation == 0.0).mean())} | turns[name]
        costs = ("cost", np.mean), ("median_cost", np.median), ("best_cost", np.min)
        row |= {key: float(figure(cost)) for key, figure in costs}
        row |= {name: row[name] / plans for name in ("seconds", "milliseconds")}
        found.append(row)
    return found


@launch(seeds=(SEEDS, "plans of each contender"))
def main(seeds: int) -> dict[str, Any]:
    found = rows(seeds)
    show(TITLE, found, COLUMNS)
    return {"seeds": seeds, "rows": found}
