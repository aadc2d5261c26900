"""`auvplan.bbo` on the 24 noiseless BBOB functions beside other searches: ``python -m benchmarks.bbob``.

The functions are evosax's, shifted and rotated by seed, but for the peaks of 21 and 22; every search has
1,000 evaluations a dimension in 64-bit numbers. The measure is log10(best cost - optimum), not below -8.
"""

import warnings
from collections.abc import Callable
from functools import lru_cache, partial
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from auvplan import bbo
from benchmarks.harness import clock, launch, markdown

GROUPS = {
    "separable (1-5)": slice(0, 5),
    "moderate (6-9)": slice(5, 9),
    "ill-conditioned (10-14)": slice(9, 14),
    "multi-modal (15-19)": slice(14, 19),
    "weak structure (20-24)": slice(19, 24),
}
DIMENSIONS = (5, 10, 20)
EVALUATIONS = 1_000
SEEDS = (100, 101, 102, 103, 104)
FLOOR = -8.0
LOWER, UPPER = -5.0, 5.0

#: ``(x_opt [D], R [D, D], Q [D, D])`` of an instance.
Instance = tuple[jax.Array, jax.Array, jax.Array]
#: Number of peaks, condition of the highest and half width of the box of the others, of functions 21 and 22.
PEAKS = {"gallagher_101_me": (101, 1000.0, 5.0), "gallagher_21_hi": (21, 1000.0**2, 4.9)}
#: ``search(key, number of the function, instance)`` -> least cost; traceable.
Search = Callable[[jax.Array, jax.Array, Instance], jax.Array]


def score(x: jax.Array, number: jax.Array, instance: Instance) -> jax.Array:
    """Cost above the optimum, [P], of habitats [P, D]; functions are numbered from 0."""
    from evosax.problems.bbob.bbob_fns import bbob_fns

    def member(name: str) -> Callable[[jax.Array], jax.Array]:
        if name in PEAKS:
            return lambda x: gallagher(x, instance, *PEAKS[name])
        return lambda x: sum(jax.vmap(lambda row: bbob_fns[name](row, *instance, x.shape[1]))(x))

    return jax.lax.switch(number, [member(name) for name in bbob_fns], x)


def gallagher(x: jax.Array, instance: Instance, count: int, highest: float, width: float) -> jax.Array:
    """Functions 21 and 22 with peaks drawn once for a dimension: evosax draws its own anew at every call."""
    from evosax.problems.bbob.bbob_fns import f_pen, transform_osz

    centre, rotation, _ = instance
    dim = x.shape[1]
    centres, shapes, heights = _peaks(dim, count, highest, width)
    centres = jnp.asarray(centres).at[0].set(centre * (1.0 if count == 101 else 0.98))
    apart = (x[:, None] - centres) @ rotation.T
    peaks = heights * jnp.exp(-(apart**2 * shapes).sum(axis=2) / (2 * dim))
    return transform_osz(10.0 - peaks.max(axis=1)) ** 2 + jax.vmap(lambda row: f_pen(row, dim))(x)


@lru_cache
def _peaks(dim: int, count: int, highest: float, width: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres [count, D], squared inverse axes [count, D] and heights [count] of the peaks."""
    rng = np.random.default_rng(dim)
    rank = np.arange(count - 1) / (count - 2)
    condition = np.append(highest, rng.permutation(1000.0 ** (2.0 * rank)))[:, None]
    shapes = condition ** (0.5 * np.arange(dim) / (dim - 1)) / condition**0.25
    heights = np.append(10.0, 1.1 + 8.0 * rank)
    return rng.uniform(-width, width, (count, dim)), rng.permuted(shapes, axis=1), heights


def instance(seed: int, dim: int) -> Instance:
    from evosax.problems import BBOBProblem

    params = BBOBProblem("sphere", dim, seed=seed)._params
    return params.x_opt, params.R, params.Q


def ours(config: bbo.BBOConfig, dim: int) -> Search:
    lower, upper = jnp.full(dim, LOWER), jnp.full(dim, UPPER)

    def search(key: jax.Array, number: jax.Array, instance: Instance) -> jax.Array:
        start_key, key = jax.random.split(key)
        start = bbo.search.uniform_population(start_key, config.population, lower, upper)
        return bbo.run(key, score, start, lower, upper, config, (number, instance)).cost

    return search


def evosax(name: str, size: int, dim: int) -> Search:
    """A search of evosax with its own settings; what leaves the bounds is clipped."""
    from evosax import algorithms

    method = getattr(algorithms, name)(size, jnp.zeros(dim))
    params = method.default_params
    if name == "CMA_ES":
        params = params.replace(std_init=0.3 * (UPPER - LOWER))
    rounds = EVALUATIONS * dim // size

    def search(key: jax.Array, number: jax.Array, instance: Instance) -> jax.Array:
        start_key, init_key, key = jax.random.split(key, 3)

        def generation(carry: Any, key: jax.Array) -> Any:
            state, best = carry
            ask_key, tell_key = jax.random.split(key)
            found, state = method.ask(ask_key, state, params)
            found = jnp.clip(found, LOWER, UPPER)
            cost = score(found, number, instance)
            return (method.tell(tell_key, found, cost, state, params)[0], jnp.minimum(best, cost.min())), None

        if name == "CMA_ES":
            start = jax.random.uniform(start_key, (dim,), minval=LOWER, maxval=UPPER)
            first = (method.init(init_key, start, params), jnp.inf)
        else:
            start = jax.random.uniform(start_key, (size, dim), minval=LOWER, maxval=UPPER)
            cost = score(start, number, instance)
            first = (method.init(init_key, start, cost, params), cost.min())
        return jax.lax.scan(generation, first, jax.random.split(key, rounds - 1))[0][1]

    return search


_score = jax.jit(score)


def pycma(seed: int, number: int, given: Instance, dim: int) -> float:
    """CMA-ES of pycma with doubled populations at restarts (IPOP)."""
    import cma

    best, left = np.inf, EVALUATIONS * dim
    start = np.random.default_rng(seed)
    size, options = 4 + int(3 * np.log(dim)), {"bounds": [LOWER, UPPER], "verbose": -9}
    while left >= size:
        options |= {"popsize": size, "maxfevals": left, "seed": seed + size}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            method = cma.CMAEvolutionStrategy(start.uniform(-4.0, 4.0, dim), 2.0, options)
            while not method.stop() and left >= size:
                asked = np.stack(method.ask())
                cost = np.asarray(_score(asked, number, given))
                method.tell(list(asked), cost.tolist())
                best, left = min(best, cost.min()), left - size
        size *= 2
    return best


#: The compared searches by name, for a dimension each; pycma's aside.
SEARCHES: dict[str, Callable[[int], Search]] = {
    "BBO": lambda dim: ours(bbo.BBOConfig(iterations=EVALUATIONS * dim // 100 - 1), dim),
    "evosax DE": lambda dim: evosax("DifferentialEvolution", 50, dim),
    "evosax PSO": lambda dim: evosax("PSO", 50, dim),
    "evosax CMA-ES": lambda dim: evosax("CMA_ES", 4 + int(3 * np.log(dim)), dim),
}


def measured(name: str, dim: int, seeds: tuple[int, ...]) -> np.ndarray:
    """log10 of the least cost above the optimum, [24, seeds]."""
    given = [instance(seed, dim) for seed in seeds]
    if name == "pycma":
        cost = [[pycma(seed, f, at, dim) for seed, at in zip(seeds, given, strict=True)] for f in range(24)]
    else:
        stacked = jax.tree.map(lambda *rows: jnp.stack(rows), *given)
        keys = jax.vmap(jax.random.key)(jnp.asarray(seeds))
        batched = jax.jit(jax.vmap(SEARCHES[name](dim), in_axes=(0, None, 0)))
        cost = [batched(keys, jnp.int32(f), stacked) for f in range(24)]
    return np.maximum(np.log10(np.maximum(np.asarray(cost), 1e-300)), FLOOR)


@launch(
    seeds=(SEEDS, "of the instances"),
    dims=(DIMENSIONS, "numbers of dimensions"),
    only=((*SEARCHES, "pycma"), "names of searches"),
)
def main(seeds: list[int], dims: list[int], only: list[str]) -> dict[str, Any]:
    jax.config.update("jax_enable_x64", True)
    results: dict[str, dict[int, np.ndarray]] = {name: {} for name in only}
    for name, dim in product(only, dims):
        seconds, results[name][dim] = clock(partial(measured, name, dim, tuple(seeds)))
        print(f"<!-- {name}, {dim}-D: {seconds:.0f} s -->", flush=True)
    rows = []
    for group, members in GROUPS.items():
        for dim in dims:
            # The median over the functions of a group of the median over the seeds; the least is bold.
            values = [float(np.median(np.median(by[dim], axis=1)[members])) for by in results.values()]
            shown = [f"**{v:.1f}**" if round(v, 1) <= round(min(values), 1) else f"{v:.1f}" for v in values]
            rows.append([group, str(dim), *shown])
    print("\n".join(markdown(["group", "D", *results], rows)))
    return {name: {dim: found.tolist() for dim, found in by.items()} for name, by in results.items()}
