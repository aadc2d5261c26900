"""Differential migration: a habitat moves along differences of ranked habitats.

Habitat i takes a step towards one of the best and along the difference of two others, the first a donor drawn
in proportion to its emigration rate, the second any habitat or one that was replaced: x + F (x_best - x) +
F (x_donor - x_other). Scale F and crossover rate follow their past successes: Tanabe and Fukunaga (2013),
Success-history based parameter adaptation for differential evolution. Crossover copies coordinates in the
eigenbasis of the better half, so that no axis is preferred.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp

from auvplan.bbo import operators, random

if TYPE_CHECKING:
    from auvplan.bbo.config import BBOConfig

#: Slots of the success history.
HISTORY = 6
#: Share of habitats that count as the best.
BEST = 0.11


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Memory:
    """What differential migration carries from one generation to the next.

    Attributes:
        habitats: [P, D] of this search, best first.
        cost: [P].
        archive: [P, D] habitats that were replaced.
        archived: how many of them there are.
        basis: [D, D] eigenvectors of the covariance of the better half, in columns.
        scales, crossovers: [H] success histories of F and of the crossover rate.
        generation: counts up.
        idle: generations without a better best habitat.
        fresh: whether the next candidates are drawn anew within bounds.
        restarts: made so far.
    """

    habitats: jax.Array
    cost: jax.Array
    archive: jax.Array
    archived: jax.Array
    basis: jax.Array
    scales: jax.Array
    crossovers: jax.Array
    generation: jax.Array
    idle: jax.Array
    fresh: jax.Array
    restarts: jax.Array


def blank(population: jax.Array, cost: jax.Array, config: "BBOConfig") -> Memory:
    """Return a memory that starts from the first candidates that `tell` gets."""
    dim, real, zero = population.shape[1], population.dtype, jnp.int32(0)
    return Memory(
        habitats=population,
        cost=jnp.full_like(cost, jnp.inf),
        archive=jnp.zeros_like(population),
        archived=zero,
        basis=jnp.eye(dim, dtype=real),
        scales=jnp.full(HISTORY, 0.5, real),
        crossovers=jnp.full(HISTORY, 0.5, real),
        generation=zero,
        idle=zero,
        fresh=jnp.bool_(True),
        restarts=jnp.int32(-1),
    )


def settings(memory: Memory) -> tuple[jax.Array, jax.Array]:
    """Scale F and crossover rate of each habitat in this generation, [P] each.

    Cauchy and normal about a slot of the histories, at evenly spread quantiles, alike in `ask` and `tell`.
    """
    count = memory.habitats.shape[0]
    number = memory.generation * count + jnp.arange(count)
    real = memory.habitats.dtype

    def spread(step: int) -> jax.Array:
        """Return a Kronecker sequence in (0, 1): multiples of an irrational number, in 32 bits."""
        bits = number.astype(jnp.uint32) * jnp.uint32(step)
        return ((bits >> 8).astype(real) + 0.5) * 2.0**-24

    slot = jnp.minimum((spread(2654435769) * HISTORY).astype(jnp.int32), HISTORY - 1)
    cauchy = jnp.tan(jnp.pi * (spread(3242174889) - 0.5))
    scale = memory.scales[slot] + 0.1 * cauchy
    scale = jnp.clip(jnp.where(scale <= 0.0, 0.1, scale), 0.05, 1.0)
    normal = jax.scipy.special.ndtri(spread(2447445414))
    return scale, jnp.clip(memory.crossovers[slot] + 0.1 * normal, 0.0, 1.0)


def ask(key: jax.Array, memory: Memory, lower: jax.Array, upper: jax.Array, config: "BBOConfig") -> jax.Array:
    """[P, D] candidates; one beyond a bound goes halfway from its habitat to the bound."""
    habitats = memory.habitats
    size, dim = habitats.shape
    real = habitats.dtype
    one_key, gene_key = jax.random.split(key)
    which, donor, other, forced = random.uniform(one_key, (4, size))
    cross, fresh = random.uniform(gene_key, (2, size, dim))
    scale, rate = settings(memory)
    best = (which * max(2, round(BEST * size))).astype(jnp.int32)
    _, emigration = config.migration_rates()
    donor = operators.draw_donors(donor, emigration)
    donor = jnp.where(donor == jnp.arange(size), (donor + 1) % size, donor)
    pool = jnp.concatenate([habitats, memory.archive])
    count = size + memory.archived
    other = jnp.minimum((other * count).astype(jnp.int32), count - 1)
    other = jnp.where((other == jnp.arange(size)) | (other == donor), (other + 1) % count, other)
    step = scale[:, None] * (habitats[best] - habitats + habitats[donor] - pool[other])
    chosen = (cross < rate[:, None]) | (jnp.arange(dim) == (forced * dim).astype(jnp.int32)[:, None])
    moved = habitats + jnp.where(chosen, step @ memory.basis, 0.0) @ memory.basis.T
    moved = jnp.where(moved < lower, 0.5 * (habitats + lower), moved)
    moved = jnp.where(moved > upper, 0.5 * (habitats + upper), moved)
    return jnp.where(memory.fresh, lower + fresh.astype(real) * (upper - lower), moved)


def tell(
    memory: Memory, candidates: jax.Array, cost: jax.Array, config: "BBOConfig", key: jax.Array | None
) -> Memory:
    """Keep the better of each habitat and its candidate, learn from successes, note a stall."""
    size, dim = candidates.shape
    real = candidates.dtype
    memory = jax.tree.map(
        partial(jnp.where, memory.fresh),
        replace(blank(memory.habitats, memory.cost, config), restarts=memory.restarts + 1),
        memory,
    )
    started = memory.fresh
    scale, rate = settings(memory)
    better = (cost < memory.cost) | started
    # What `ask` did is known without its key.
    del key
    learns = better & jnp.isfinite(memory.cost)
    gain = jnp.where(learns, memory.cost - cost, 0.0)
    share = (gain / jnp.maximum(gain.sum(), jnp.finfo(real).tiny)).astype(real)
    any_success = gain.sum() > 0.0
    slot = memory.generation % HISTORY

    def lehmer(values: jax.Array) -> jax.Array:
        return (share * values**2).sum() / jnp.maximum((share * values).sum(), 1e-12)

    def learned(history: jax.Array, values: jax.Array) -> jax.Array:
        return jnp.where(any_success, history.at[slot].set(lehmer(values)), history)

    lost = jnp.where(learns, memory.archived + jnp.cumsum(learns) - 1, 2 * size)
    # Beyond the end of the archive, the newest replace entries spread over it.
    entry = jnp.where(lost < size, lost, (lost * 7919 + memory.generation) % size)
    archive = memory.archive.at[jnp.where(learns, entry, size)].set(memory.habitats, mode="drop")

    habitats = jnp.where(better[:, None], candidates, memory.habitats)
    scored = jnp.where(better, cost, memory.cost)
    order = jnp.argsort(scored)
    habitats, scored = habitats[order], scored[order]
    half = habitats[: max(2, size // 2)]
    apart = half - half.mean(axis=0)
    basis = jnp.linalg.eigh(apart.T @ apart)[1]
    idle = jnp.where(scored[0] < memory.cost[0], 0, memory.idle + 1)
    eps = jnp.finfo(real).eps
    spread = scored[size // 2] - scored[0]
    flat = spread <= jnp.maximum(1e-11, 8.0 * eps * jnp.abs(scored[0]))
    narrow = (apart.std(axis=0) <= 8.0 * eps * jnp.maximum(jnp.abs(half[0]), jnp.finfo(real).tiny)).all()
    stalled = flat | narrow | (idle > 10 * dim + 100)
    return Memory(
        habitats=habitats,
        cost=scored,
        archive=archive,
        archived=jnp.minimum(memory.archived + learns.sum(dtype=jnp.int32), size),
        basis=basis,
        scales=learned(memory.scales, scale),
        crossovers=learned(memory.crossovers, rate),
        generation=memory.generation + 1,
        idle=idle,
        fresh=stalled & ~started & (memory.restarts < config.restarts),
        restarts=memory.restarts,
    )
