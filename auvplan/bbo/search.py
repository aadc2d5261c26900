"""Biogeography-based optimisation (section 3.1, Fig. 6): init / ask / tell, and minimize as one scan.

A habitat is a row of a [P, D] array, real or integer; a cost function scores all P at once. It may return
the cost [P], or the pair (cost [P], violation [P]), whose second member is only reported.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import chex
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from auvplan.bbo import operators, random
from auvplan.bbo.config import BBOConfig
from auvplan.runtime.arguments import instance, numbers
from auvplan.runtime.captured import Captured, as_hashable, captured_by
from auvplan.runtime.prng import as_key

CostFunction = Callable[..., jax.Array | tuple[jax.Array, jax.Array]]

#: A habitat [D] with its cost and violation.
Habitat = tuple[jax.Array, jax.Array, jax.Array]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class State:
    """A scored population, best habitat first.

    Attributes:
        population: [P, D] habitats.
        cost: [P]; a habitat whose cost was not a number carries infinity.
        violation: [P], zero where the cost function reports none.
    """

    population: jax.Array
    cost: jax.Array
    violation: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class History:
    """Cost and violation of the population after each iteration; index 0 is the initial population.

    Means and standard deviations leave out habitats of infinite cost.

    Attributes:
        best, mean, std: [I + 1] of the cost.
        violation_best, violation_mean, violation_std: [I + 1] of the violation; `best` is that of the
            habitat of least cost.
    """

    best: jax.Array
    mean: jax.Array
    std: jax.Array
    violation_best: jax.Array
    violation_mean: jax.Array
    violation_std: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Result:
    """What `minimize` found.

    Attributes:
        x: [D], the best habitat of the last population; of `minimize` the best that was met, one without
            violation where there was any.
        cost: its cost.
        violation: its violation.
        state: the last population, to start from again.
        history: by iteration.
    """

    x: jax.Array
    cost: jax.Array
    violation: jax.Array
    state: State
    history: History


def worst_unless_finite(cost: jax.Array) -> jax.Array:
    """Make a cost that is not finite infinite: it ranks last and never wins."""
    return jnp.where(jnp.isfinite(cost), cost, jnp.inf)


def evaluate(fun: CostFunction, population: jax.Array, *args: Any) -> tuple[jax.Array, jax.Array]:
    """Score a population: (cost [P], violation [P]), not below zero; a cost that is no number is infinite."""
    scored = fun(population, *args)
    if scored is None or (isinstance(scored, tuple | list) and len(scored) != 2):
        got = "None" if scored is None else f"{len(scored)} values"
        raise ValueError(f"a function must return cost [P] or (cost [P], violation [P]), got {got}")
    cost, violation = scored if isinstance(scored, tuple | list) else (scored, jnp.zeros_like(scored))
    count = population.shape[0]
    for plane in (cost, violation):
        if jnp.shape(plane) != (count,):
            raise ValueError(
                f"a function of a population [{count}, {population.shape[1]}] must return [{count}], got "
                f"shape {jnp.shape(plane)}: jax.vmap makes one of a function of a single habitat"
            )
    return worst_unless_finite(cost), jnp.maximum(violation, 0)


def uniform_population(key: jax.Array, size: int, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """[size, D] habitats drawn uniformly within inclusive bounds; integers for integer bounds."""
    shape = (size, lower.shape[0])
    if jnp.issubdtype(lower.dtype, jnp.integer):
        return jax.random.randint(key, shape, lower, upper + 1, lower.dtype)
    return jax.random.uniform(key, shape, lower.dtype, lower, upper)


def _bounds(lower: jax.typing.ArrayLike, upper: jax.typing.ArrayLike) -> tuple[jax.Array, jax.Array]:
    """Return bounds [D] in the type that is searched in; inside `jax.jit` their values cannot be checked.

    Raises:
        ValueError: they are not bounds of one search, or integers that JAX's type of them does not hold.
    """
    traced = any(isinstance(part, Tracer) for part in jax.tree.leaves((lower, upper)))
    low, high = ((jnp if traced else np).asarray(end) for end in (lower, upper))
    _require_vectors(low.shape, high.shape)
    for end in (low, high):
        if not (jnp.issubdtype(end.dtype, jnp.integer) or jnp.issubdtype(end.dtype, jnp.floating)):
            raise ValueError(f"bounds must be integers or real numbers, got {end.dtype}")
    whole = all(jnp.issubdtype(end.dtype, jnp.integer) for end in (low, high))
    kind = jax.dtypes.canonicalize_dtype(int) if whole else jnp.result_type(low, high)
    if traced:
        return jnp.asarray(low, kind), jnp.asarray(high, kind)
    if whole:
        least, most = int(jnp.iinfo(kind).min), int(jnp.iinfo(kind).max)
        for first, last in zip(low.tolist(), high.tolist(), strict=True):
            if first < least or last >= most or last - first >= most:
                few = f"integers from {first} to {last} are more than {kind} holds: shift or scale them"
                raise ValueError(few)
    with np.errstate(over="ignore"):  # what is too large for the type is infinite in it
        low, high = low.astype(kind), high.astype(kind)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise ValueError("bounds must be finite")
    if not (low <= high).all():
        raise ValueError("lower bounds must not exceed upper bounds")
    return jnp.asarray(low), jnp.asarray(high)


def _require_vectors(low: tuple[int, ...], high: tuple[int, ...]) -> None:
    """Refuse bounds whose shapes are not those of vectors of one length."""
    if len(low) != 1 or low != high or not low[0]:
        raise ValueError(f"bounds must be vectors of one length, at least 1, got shapes {low} and {high}")


def init(population: jax.Array, cost: jax.Array, violation: jax.Array) -> State:
    """Rank a population [P, D] by its cost [P]; one that is not finite becomes infinite and ranks last."""
    cost = worst_unless_finite(cost)
    order = jnp.argsort(cost)
    return State(population[order], cost[order], violation[order])


def ask(key: jax.Array, state: State, lower: jax.Array, upper: jax.Array, config: BBOConfig) -> jax.Array:
    """Candidates of the next generation by migration and mutation.

    Args:
        key: PRNG key, consumed.
        state: ranked population, [P, D].
        lower: [D] inclusive bounds.
        upper: [D] inclusive bounds.
        config: static settings.

    Returns:
        [P, D] candidates within bounds.
    """
    population = state.population
    size, dim = population.shape
    immigration, emigration = config.migration_rates()
    whole = jnp.issubdtype(population.dtype, jnp.integer)
    if config.mutation == "gaussian" and whole:
        raise ValueError('mutation="gaussian" needs real SIVs: use "uniform" for integers')
    draw_key, normal_key, fig6_key = jax.random.split(key, 3)
    immigrate, donor, decide, value = random.uniform(draw_key, (4, size, dim))
    if config.migration == "fig6":
        who_key, from_key, siv_key = jax.random.split(fig6_key, 3)
        who = jax.random.uniform(who_key, (size,))
        sends = jax.random.uniform(from_key, (size, size))
        siv = jax.random.randint(siv_key, (size, size), 0, dim)
        candidates = operators.migrate_fig6(population, who, sends, siv, immigration, emigration)
    else:
        candidates = operators.migrate_per_siv(population, immigrate, donor, immigration, emigration)

    rate = jnp.asarray(config.mutation_rate(dim), decide.dtype)
    if config.mutation == "gaussian" or (config.mutation is None and not whole):
        normal = random.normal(normal_key, (size, dim))
        step = config.mutation_step * (upper - lower)
        candidates = operators.mutate_gaussian(candidates, decide, normal, rate, step)
    else:
        candidates = operators.mutate_uniform(candidates, decide, value, rate, lower, upper)
    return jnp.clip(candidates, lower, upper)


def tell(
    state: State,
    candidates: jax.Array,
    cost: jax.Array,
    violation: jax.Array,
    config: BBOConfig,
) -> State:
    """Take scored candidates into the population.

    Args:
        state: the ranked population that `candidates` were made from.
        candidates: [P, D].
        cost: [P]; not finite ranks last.
        violation: [P].
        config: static settings.
    """
    cost = worst_unless_finite(cost)
    if config.replacement == "greedy":
        return _take_in(state, candidates, cost, violation)
    survivors = config.population - config.elites
    order = jnp.argsort(cost)[:survivors]
    elite = slice(0, config.elites)
    return init(
        jnp.concatenate([state.population[elite], candidates[order]]),
        jnp.concatenate([state.cost[elite], cost[order]]),
        jnp.concatenate([state.violation[elite], violation[order]]),
    )


def _take_in(state: State, found: jax.Array, cost: jax.Array, violation: jax.Array) -> State:
    """Let Q habitats take the place of the worst Q where they are better."""
    worst = slice(-found.shape[0], None)
    better = worst_unless_finite(cost) < state.cost[worst]
    return init(
        state.population.at[worst].set(jnp.where(better[:, None], found, state.population[worst])),
        state.cost.at[worst].set(jnp.where(better, cost, state.cost[worst])),
        state.violation.at[worst].set(jnp.where(better, violation, state.violation[worst])),
    )


def statistics(state: State) -> History:
    """One row of the history: scalars."""
    usable = jnp.isfinite(state.cost)
    count = jnp.maximum(usable.sum(), 1)

    def moments(values: jax.Array) -> tuple[jax.Array, jax.Array]:
        mean = jnp.where(usable, values, 0.0).sum() / count
        variance = jnp.where(usable, (values - mean) ** 2, 0.0).sum() / count
        return mean, jnp.sqrt(variance)

    return History(
        state.cost[0], *moments(state.cost), state.violation[0], *moments(state.violation)
    )  # fmt: skip


def rows(history: History, kept: slice) -> History:
    """Return some iterations of histories [B, I + 1], in NumPy."""
    return jax.tree.map(lambda plane: np.asarray(plane)[:, kept], history)


def joined(parts: Sequence[History], still: int) -> History:
    """Return the histories of a search in parts as one, its last iteration repeated `still` times."""
    return jax.tree.map(
        lambda *planes: np.pad(np.concatenate(planes, axis=1), ((0, 0), (0, still)), mode="edge"), *parts
    )


def run(
    key: jax.Array,
    fun: CostFunction,
    population: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    config: BBOConfig,
    args: tuple[Any, ...] = (),
    improve: Callable[..., jax.Array] | None = None,
    period: int = 20,
    iterations: jax.Array | None = None,
    feasible: bool = False,
    stop: jax.Array | None = None,
) -> Result:
    """Search from a given population; traceable, for use inside a larger compiled function.

    Args:
        key: PRNG key, consumed.
        fun: ``fun(population, *args)`` -> cost [P], or (cost [P], violation [P]).
        population: [P, D] initial habitats.
        lower: [D] inclusive bounds, of the population's type.
        upper: [D] inclusive bounds.
        config: static settings.
        args: problem data passed on to `fun`.
        improve: ``improve(population, *args)`` -> [Q, D], a local search from the best habitats: a memetic
            step. What it finds takes the place of the worst Q habitats where it is better.
        period: iterations between two memetic steps; the first comes before the first iteration.
        iterations: how many to make, at most those of the settings; None for these. Later rows of the history
            are zero.
        feasible: whether the result is the best habitat that was met, one without a violation where there was
            any, in place of the best of the last population.
        stop: cost at which the search ends, met without a violation; None to make all iterations. Rows of the
            history after the end repeat the last.
    """
    chex.assert_shape(population, (config.population, lower.shape[0]))
    keys = jax.random.split(key, max(config.iterations, 1))
    cost, violation = jax.eval_shape(partial(evaluate, fun), population, *args)
    unknown = State(population, jnp.full_like(cost, jnp.inf), jnp.ones_like(violation))
    rows = jax.tree.map(lambda row: jnp.zeros((config.iterations + 1,), row.dtype), statistics(unknown))

    def generation(k: jax.Array, carry: tuple[State, History, Any]) -> tuple[State, History, Any]:
        """Score the first population at k = 0, by the one copy of the cost that is compiled."""
        state, rows, kept = carry
        if improve is not None:
            state = jax.lax.cond((k - 1) % period == 0, improved, lambda state: state, state)
        candidates = ask(keys[jnp.maximum(k - 1, 0)], state, lower, upper, config)
        candidates = jnp.where(k == 0, population, candidates)
        scored = evaluate(fun, candidates, *args)
        state = jax.tree.map(
            partial(jnp.where, k == 0),
            init(candidates, *scored),
            tell(state, candidates, *scored, config),
        )
        if feasible:
            kept = _better(_best(candidates, *scored), kept)
        return state, jax.tree.map(lambda rows, row: rows.at[k].set(row), rows, statistics(state)), kept

    def improved(state: State) -> State:
        found = improve(state.population, *args)  # type: ignore[misc]
        return _take_in(state, found, *evaluate(fun, found, *args))

    def answer(state: State, kept: Any) -> Habitat:
        best = state.population[0], state.cost[0], state.violation[0]
        return _better(kept, best) if feasible else best

    last = config.iterations if iterations is None else iterations
    none: Any = (population[0], unknown.cost[0], unknown.violation[0]) if feasible else ()
    if stop is None:
        state, history, kept = jax.lax.fori_loop(0, last + 1, generation, (unknown, rows, none))
    else:

        def unmet(at: tuple[jax.Array, Any]) -> jax.Array:
            k, (state, _, kept) = at
            _, cost, violation = answer(state, kept)
            return (k <= last) & ~((cost <= stop) & (violation == 0.0))

        end, (state, history, kept) = jax.lax.while_loop(
            unmet,
            lambda at: (at[0] + 1, generation(*at)),
            (jnp.zeros_like(last + 1), (unknown, rows, none)),
        )
        row = jnp.minimum(jnp.arange(config.iterations + 1), end - 1)
        history = jax.tree.map(lambda values: values[row], history)
    return Result(*answer(state, kept), state, history)


def _free(cost: jax.Array, violation: jax.Array) -> jax.Array:
    """Whether habitats have a finite cost and no violation."""
    return (violation == 0.0) & jnp.isfinite(cost)


def _best(population: jax.Array, cost: jax.Array, violation: jax.Array) -> Habitat:
    """Return the best habitat of a population in any order."""
    free = _free(cost, violation)
    best = jnp.argmin(jnp.where(free | ~free.any(), cost, jnp.inf))
    return population[best], cost[best], violation[best]


def _better(one: Habitat, other: Habitat) -> Habitat:
    """Return the better of two habitats, the other where they are equal."""
    free, other_free = _free(*one[1:]), _free(*other[1:])
    better = jnp.where(free == other_free, one[1] < other[1], free)
    return jax.tree.map(partial(jnp.where, better), one, other)


def minimize(
    fun: CostFunction,
    lower: jax.typing.ArrayLike,
    upper: jax.typing.ArrayLike,
    *,
    key: jax.Array,
    config: BBOConfig | None = None,
    args: tuple[Any, ...] = (),
    population: jax.typing.ArrayLike | None = None,
    stop: jax.typing.ArrayLike | None = None,
) -> Result:
    """Minimise a batched function by biogeography-based optimisation, in one compiled scan.

    It may be called inside `jax.jit` and `jax.vmap`, where values of bounds are not checked.

    The cost alone steers the search: what a violation is worth has to be part of it, as a penalty, or the
    search leads away from what is feasible. The answer is the habitat of least cost that was ever met without
    a violation; where none was met, it is that of least cost of all, with its `violation`.

    Args:
        fun: ``fun(population, *args)`` -> cost [P], or (cost [P], violation [P]), where what is below zero
            counts as zero; any JAX function. It is compiled again once what it reads from around it has
            changed: pass what changes often in `args`.
        lower: [D] inclusive lower bounds.
        upper: [D] inclusive upper bounds; where both are integers, it is an integer search.
        key: PRNG key, consumed; the same key gives the same result.
        config: settings; defaults to `BBOConfig()`, 10,100 evaluations.
        args: pytrees passed on to `fun`.
        population: [Q, D] habitats to start from, Q at most P; the rest is drawn uniformly.
        stop: cost that is good enough; the search ends when it is met without a violation.

    Returns:
        The best habitat, its cost and violation, the last population and the history.

    Raises:
        ValueError: bounds or population do not fit together, or the function returns other than one cost for
            each habitat.
        TypeError: the key is none, such as a seed, `config` no `BBOConfig`, or `args` no tuple.

    Example:
        >>> import jax, auvplan as ap
        >>> sphere = lambda x: (x**2).sum(axis=1)
        >>> result = ap.bbo.minimize(sphere, [-5.0, -5.0], [5.0, 5.0], key=jax.random.key(0))
        >>> bool(result.cost < 1e-4)
        True
    """
    key = as_key(key)
    low, high = _bounds(lower, upper)
    config = config or BBOConfig()
    instance("config", config, BBOConfig, "ap.bbo.BBOConfig(...)")
    if not isinstance(args, tuple | list):
        raise TypeError(f"args must be a tuple, got {type(args).__name__}: give (args,)")
    if not (stop is None or isinstance(stop, Tracer)) and (np.ndim(stop) or np.isnan(numbers("stop", stop))):
        raise ValueError(f"stop must be one number or None, got {stop}")
    start_key, run_key = jax.random.split(key)
    start = uniform_population(start_key, config.population, low, high)
    if population is not None:
        given = jnp.asarray(population, low.dtype)
        if given.ndim != 2 or given.shape[1] != low.shape[0] or given.shape[0] > config.population:
            raise ValueError(
                f"population must be [Q <= {config.population}, {low.shape[0]}], got shape {given.shape}"
            )
        start = start.at[: given.shape[0]].set(jnp.clip(given, low, high))
    target = None if stop is None else jnp.asarray(stop)
    fun = Captured(as_hashable(fun))
    return _run(
        captured_by(fun.function, start, *args), run_key, fun, start, low, high, config, args, stop=target
    )


@partial(jax.jit, static_argnums=(0, 2, 6))
def _run(captured: tuple, *given: Any, stop: jax.Array | None) -> Result:
    """Run a search with what `run` is `given`, compiled for the values that its function has `captured`."""
    return run(*given, feasible=True, stop=stop)
