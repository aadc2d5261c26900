"""Covariance migration: habitats move together along the axes of what the better ones have in common.

Candidates are normal draws around the weighted mean of the better habitats; their covariance and step follow
Hansen (2016), The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772, with negative weights. When a search
stalls, the next one starts from fresh habitats and pools twice as many before each update, as Auger and
Hansen (2005) have it; P is fixed, so it pools several generations.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp

from auvplan.bbo import operators, random

if TYPE_CHECKING:
    from auvplan.bbo.config import BBOConfig

#: Doublings of the pool, at most: 2^5 generations before an update.
DOUBLINGS = 5


class Weights(NamedTuple):
    """Weights by rank and learning rates for a pool, of Hansen's table 1.

    Attributes:
        rank: [N], best first; of the covariance, negative for the worse half, zero beyond the pool.
        mean: [N], of the mean; positive and of sum one.
        mass: variance effective number of habitats.
        step_rate, step_damping: of the step.
        path_rate: of the evolution path.
        rank_one, rank_mu: of the covariance.
    """

    rank: jax.Array
    mean: jax.Array
    mass: jax.Array
    step_rate: jax.Array
    step_damping: jax.Array
    path_rate: jax.Array
    rank_one: jax.Array
    rank_mu: jax.Array


def weights(size: int, pooled: jax.Array, dim: int) -> Weights:
    """Weights and rates for `pooled` habitats, which may be traced, in `size` slots.

    Args:
        size: slots N.
        pooled: scalar, habitats that count, at most N.
        dim: SIVs D.
    """
    rank = jnp.arange(size)
    raw = jnp.where(rank < pooled, jnp.log((pooled + 1.0) / 2.0) - jnp.log1p(rank), 0.0)
    good, bad = jnp.maximum(raw, 0.0), jnp.maximum(-raw, 0.0)
    mean = good / good.sum()
    mass = 1.0 / (mean**2).sum()
    mass_bad = bad.sum() ** 2 / jnp.maximum((bad**2).sum(), 1e-12)
    step_rate = (mass + 2.0) / (dim + mass + 5.0)
    spread = jnp.sqrt((mass - 1.0) / (dim + 1.0))
    damping = 1.0 + 2.0 * jnp.maximum(0.0, spread - 1.0) + step_rate
    path_rate = (4.0 + mass / dim) / (dim + 4.0 + 2.0 * mass / dim)
    rank_one = 2.0 / ((dim + 1.3) ** 2 + mass)
    rank_mu = jnp.minimum(1.0 - rank_one, 2.0 * (0.25 + mass - 2.0 + 1.0 / mass) / ((dim + 2.0) ** 2 + mass))
    share = jnp.minimum(1.0 + rank_one / rank_mu, 1.0 + 2.0 * mass_bad / (mass + 2.0))
    share = jnp.minimum(share, (1.0 - rank_one - rank_mu) / (dim * rank_mu))
    by_rank = mean - share * bad / jnp.maximum(bad.sum(), 1e-12)
    return Weights(by_rank, mean, mass, step_rate, damping, path_rate, rank_one, rank_mu)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Memory:
    """What covariance migration carries from one generation to the next.

    Attributes:
        mean: [D], where candidates are drawn around.
        step: scalar step size.
        covariance: [D, D] of the draws, without the step.
        basis: [D, D] its eigenvectors, in columns.
        deviation: [D] roots of its eigenvalues.
        step_path, path: [D] evolution paths of the step and of the covariance.
        pool: [N, D] candidates since the last update.
        pool_cost: [N] their cost, infinite where there is none.
        pooled: generations in the pool.
        batches: generations that fill it.
        updates: since the start or the last restart.
        reference: cost that has to fall.
        idle: updates since it last did.
        fresh: whether the next candidates are drawn anew within bounds.
        restarts: made so far.
    """

    mean: jax.Array
    step: jax.Array
    covariance: jax.Array
    basis: jax.Array
    deviation: jax.Array
    step_path: jax.Array
    path: jax.Array
    pool: jax.Array
    pool_cost: jax.Array
    pooled: jax.Array
    batches: jax.Array
    updates: jax.Array
    reference: jax.Array
    idle: jax.Array
    fresh: jax.Array
    restarts: jax.Array


def blank(population: jax.Array, cost: jax.Array, config: "BBOConfig") -> Memory:
    """Return a memory that starts from the first candidates that `tell` gets."""
    size, dim = population.shape
    slots = size * 2 ** min(config.restarts, DOUBLINGS)
    real, none, zero = population.dtype, jnp.zeros(dim, population.dtype), jnp.int32(0)
    return Memory(
        mean=none,
        step=jnp.ones((), real),
        covariance=jnp.eye(dim, dtype=real),
        basis=jnp.eye(dim, dtype=real),
        deviation=jnp.ones(dim, real),
        step_path=none,
        path=none,
        pool=jnp.zeros((slots, dim), real),
        pool_cost=jnp.full(slots, jnp.inf, cost.dtype),
        pooled=zero,
        batches=jnp.int32(1),
        updates=zero,
        reference=jnp.asarray(jnp.inf, cost.dtype),
        idle=zero,
        fresh=jnp.bool_(True),
        restarts=jnp.int32(-1),
    )


def draws(key: jax.Array, memory: Memory, size: int) -> jax.Array:
    """[size, D] normal draws, which may lie outside the bounds."""
    dim = memory.mean.shape[0]
    normal = random.normal(key, (size, dim)).astype(memory.mean.dtype)
    return memory.mean + memory.step * (normal * memory.deviation) @ memory.basis.T


def ask(key: jax.Array, memory: Memory, lower: jax.Array, upper: jax.Array, config: "BBOConfig") -> jax.Array:
    """[P, D] candidates: normal draws, reflected at the bounds, or uniform ones after a stall."""
    drawn = operators.reflect(draws(key, memory, config.population), lower, upper)
    uniform = random.uniform(key, drawn.shape).astype(drawn.dtype)
    return jnp.where(memory.fresh, lower + uniform * (upper - lower), drawn)


def tell(
    memory: Memory, candidates: jax.Array, cost: jax.Array, config: "BBOConfig", key: jax.Array | None
) -> Memory:
    """Pool scored candidates; learn from the pool when it is full; note a stall.

    Given the key of `ask`, learn from the draws before they were reflected: a step that grows against the
    bounds is no progress.
    """
    if key is not None:
        candidates = jnp.where(memory.fresh, candidates, draws(key, memory, config.population))
    size = candidates.shape[0]
    start = memory.pooled * size
    pool = jax.lax.dynamic_update_slice(memory.pool, candidates, (start, jnp.zeros_like(start)))
    pool_cost = jax.lax.dynamic_update_slice(memory.pool_cost, cost, (start,))
    waiting = replace(memory, pool=pool, pool_cost=pool_cost, pooled=memory.pooled + 1)

    def begin() -> Memory:
        return _begin(memory, candidates, cost, config)

    def learn() -> Memory:
        return jax.lax.cond(waiting.pooled >= memory.batches, partial(_learn, config=config), _same, waiting)

    return jax.lax.cond(memory.fresh, begin, learn)


def _same(memory: Memory) -> Memory:
    return memory


def _begin(memory: Memory, candidates: jax.Array, cost: jax.Array, config: "BBOConfig") -> Memory:
    """Start from scored habitats: around the mean of the better half, as wide as they lie."""
    size, dim = candidates.shape
    order = jnp.argsort(cost)
    share = weights(size, jnp.asarray(size), dim).mean.astype(candidates.dtype)
    spread = candidates.std(axis=0)
    # A SIV that all share, such as one of equal bounds, counts as the widest.
    spread = jnp.where(spread > 0.0, spread, spread.max())
    spread = jnp.maximum(spread, jnp.finfo(spread.dtype).tiny ** 0.25)
    step = jnp.exp(jnp.log(spread).mean())
    restarts = memory.restarts + 1
    return replace(
        blank(candidates, cost, config),
        mean=share @ candidates[order],
        step=step,
        covariance=jnp.diag((spread / step) ** 2),
        deviation=spread / step,
        batches=jnp.int32(2) ** jnp.minimum(restarts, DOUBLINGS),
        fresh=jnp.bool_(False),
        restarts=restarts,
    )


def _learn(memory: Memory, config: "BBOConfig") -> Memory:
    """Move the mean and adapt the step and the covariance to a full pool."""
    slots, dim = memory.pool.shape
    real = memory.pool.dtype
    rates = weights(slots, memory.batches * config.population, dim)
    rates = Weights(*(value.astype(real) for value in rates))
    order = jnp.argsort(memory.pool_cost)
    moves = (memory.pool[order] - memory.mean) / memory.step
    mean_move = rates.mean @ moves
    unit = (memory.basis.T @ mean_move) / memory.deviation

    keep = 1.0 - rates.step_rate
    gain = jnp.sqrt(rates.step_rate * (2.0 - rates.step_rate) * rates.mass)
    step_path = keep * memory.step_path + gain * (memory.basis @ unit)
    updates = memory.updates + 1
    usual = jnp.sqrt(dim) * (1.0 - 1.0 / (4.0 * dim) + 1.0 / (21.0 * dim**2))
    length = jnp.linalg.norm(step_path)
    grown = jnp.sqrt(1.0 - keep ** (2.0 * updates.astype(real)))
    calm = length / grown < (1.4 + 2.0 / (dim + 1.0)) * usual
    gain = jnp.sqrt(rates.path_rate * (2.0 - rates.path_rate) * rates.mass)
    path = (1.0 - rates.path_rate) * memory.path + jnp.where(calm, gain, 0.0) * mean_move

    white = (moves @ memory.basis) / memory.deviation
    shrink = dim / jnp.maximum((white**2).sum(axis=1), 1e-8)
    share = jnp.where(rates.rank < 0.0, rates.rank * shrink, rates.rank)
    late = jnp.where(calm, 0.0, rates.path_rate * (2.0 - rates.path_rate))
    kept = 1.0 + rates.rank_one * (late - 1.0) - rates.rank_mu * rates.rank.sum()
    covariance = (
        kept * memory.covariance
        + rates.rank_one * jnp.outer(path, path)
        + rates.rank_mu * (moves * share[:, None]).T @ moves
    )
    covariance = 0.5 * (covariance + covariance.T)
    growth = (rates.step_rate / rates.step_damping) * (length / usual - 1.0)
    step = memory.step * jnp.exp(jnp.minimum(growth, 1.0))
    values, basis = jnp.linalg.eigh(covariance)
    largest = values[-1]
    deviation = jnp.sqrt(jnp.maximum(values, largest * jnp.finfo(real).eps))

    best = memory.pool_cost[order[0]]
    median = memory.pool_cost[order[jnp.maximum(memory.batches * config.population // 2, 1)]]
    eps = jnp.finfo(real).eps
    fine = jnp.maximum(1e-11, 8.0 * eps * jnp.abs(best)).astype(best.dtype)
    moved = ~(jnp.abs(best - memory.reference) <= fine)
    idle = jnp.where(moved, 0, memory.idle + 1)
    patience = 10 + (30 * dim) // (memory.batches * config.population)
    reach = step * deviation[-1]
    stalled = (
        (idle > patience)
        | (median - best <= 0.0)
        | (reach <= 4.0 * eps * jnp.maximum(jnp.abs(memory.mean).max(), jnp.finfo(real).tiny))
        | (values[0] <= largest * jnp.maximum(1e-14, 4.0 * eps))
    )
    return replace(
        memory,
        mean=memory.mean + memory.step * mean_move,
        step=step,
        covariance=covariance,
        basis=basis,
        deviation=deviation,
        step_path=step_path,
        path=path,
        pool_cost=jnp.full_like(memory.pool_cost, jnp.inf),
        pooled=jnp.int32(0),
        updates=updates,
        reference=jnp.where(moved, best, memory.reference),
        idle=idle,
        fresh=stalled & (memory.restarts < config.restarts),
    )
