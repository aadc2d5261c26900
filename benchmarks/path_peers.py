"""Other people's searches on the path problem: mealpy's BBO, evosax's DE and CMA-ES, pycma; each is optional.

All search the same box with the same number of evaluations, in coordinates from 0 to 1 across it. What leaves
the box is clipped to it. The CMA-ES begin at the straight line, the others with uniform draws.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.path import habitats
from benchmarks import path_twins as twins

if TYPE_CHECKING:
    from benchmarks.scoring import Problem

#: ``search(seed) -> [1, 3 n]`` m, the best habitat found.
Search = Callable[[int], Any]

#: First standard deviation of the CMA-ES, as a share of the box: the best of 0.02, 0.05, 0.1 and 0.25 here.
STEP = 0.05


def from_unit(problem: "Problem", shares: Any) -> Any:
    """Habitats [P, 3 n] m from shares of the box [P, 3 n]."""
    low, high = problem.bounds()
    return low + (high - low) * jnp.clip(shares, 0.0, 1.0)


def straight(problem: "Problem") -> jax.Array:
    """The straight line as shares of the box, [3 n]."""
    low, high = problem.bounds()
    line = habitats.straight_line(problem.start, problem.goal, problem.config)
    return (line - low) / jnp.maximum(high - low, 1e-6)


def mealpy_bbo(problem: "Problem", population: int, iterations: int) -> Search:
    """`OriginalBBO` as mealpy runs it: one path at a time, here with the cost compiled by Numba."""
    from mealpy import BBO, FloatVar

    score = twins.in_numba(problem)
    assert score is not None
    paths = problem.paths(100)
    costs = np.asarray(problem.cost(paths)[0])
    if np.median(np.abs(score(np.asarray(paths))[0] / costs - 1.0)) > 1e-4:
        raise RuntimeError("the Numba twin and the package's kernel disagree on the costs")
    low, high = (np.asarray(bound, float) for bound in problem.bounds())
    bounds = FloatVar(lb=low.tolist(), ub=high.tolist())

    def cost(habitat: twins.Array) -> float:
        return float(score(habitat[None].astype(np.float32))[0][0])

    def search(seed: int) -> Any:
        task = {"obj_func": cost, "bounds": bounds, "minmax": "min", "log_to": None}
        best = BBO.OriginalBBO(epoch=iterations, pop_size=population).solve(task, seed=seed)
        return best.solution[None]

    return search


def evosax_de(problem: "Problem", population: int, iterations: int) -> Search:
    """Differential evolution of evosax, as published there, in one compiled scan."""
    from evosax.algorithms import DifferentialEvolution

    box = jnp.zeros(problem.bounds()[0].shape)
    method = DifferentialEvolution(population, box)

    def first(key: jax.Array, params: Any) -> Any:
        first_key, key = jax.random.split(key)
        shares = jax.random.uniform(first_key, (population, box.size))
        return method.init(key, shares, problem.cost(from_unit(problem, shares))[0], params)

    return _scanned(problem, method, method.default_params, first, iterations)


def evosax_cma(problem: "Problem", population: int, iterations: int) -> Search:
    """CMA-ES of evosax in one compiled scan."""
    from evosax.algorithms import CMA_ES

    method = CMA_ES(population, jnp.zeros(problem.bounds()[0].shape))
    params = method.default_params.replace(std_init=jnp.asarray(STEP))

    def first(key: jax.Array, params: Any) -> Any:
        return method.init(key, straight(problem), params)

    return _scanned(problem, method, params, first, iterations + 1)


def _scanned(problem: "Problem", method: Any, params: Any, first: Callable[..., Any], rounds: int) -> Search:
    """Ask, score and tell `rounds` times in one compiled scan."""

    @jax.jit
    def run(key: jax.Array, params: Any) -> jax.Array:
        def generation(state: Any, key: jax.Array) -> tuple[Any, None]:
            ask_key, tell_key = jax.random.split(key)
            shares, state = method.ask(ask_key, state, params)
            cost = problem.cost(from_unit(problem, shares))[0]
            return method.tell(tell_key, shares, cost, state, params)[0], None

        first_key, key = jax.random.split(key)
        state, _ = jax.lax.scan(generation, first(first_key, params), jax.random.split(key, rounds))
        return from_unit(problem, state.best_solution[None])

    return lambda seed: run(jax.random.key(seed), params)


def pycma(problem: "Problem", population: int, iterations: int) -> Search:
    """CMA-ES of the `cma` package, which calls the compiled kernel once a generation."""
    import cma

    low, high = (np.asarray(bound, float) for bound in problem.bounds())
    score = jax.jit(lambda shares: problem.cost(from_unit(problem, shares))[0])
    start = np.asarray(straight(problem), float)

    def search(seed: int) -> Any:
        options = {
            "bounds": [0.0, 1.0],
            "popsize": population,
            "maxiter": iterations + 1,
            "seed": seed + 1,
            "verbose": -9,
        }
        strategy = cma.CMAEvolutionStrategy(start, STEP, options)
        for _ in range(iterations + 1):
            shares = strategy.ask()
            strategy.tell(shares, np.asarray(score(np.asarray(shares, np.float32)), float).tolist())
        return low + (high - low) * np.clip(np.asarray(strategy.result.xbest), 0.0, 1.0)[None]

    return search


#: Name, packages needed and maker of every peer.
PEERS: tuple[tuple[str, tuple[str, ...], Callable[["Problem", int, int], Search]], ...] = (
    ("mealpy OriginalBBO", ("mealpy", "numba"), mealpy_bbo),
    ("evosax DE", ("evosax",), evosax_de),
    ("evosax CMA-ES", ("evosax",), evosax_cma),
    ("cma CMA-ES", ("cma",), pycma),
)
