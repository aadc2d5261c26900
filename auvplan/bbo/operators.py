"""Migration and mutation of a ranked population; real and integer SIVs alike.

A population is [P, D]: P habitats ranked best first, D suitability index variables (SIVs). Rates are NumPy
constants [P]; random numbers come in as arrays, so that an iteration can draw all of them in few calls.
"""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray


def alias_table(weights: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Walker's alias table: one uniform number draws index j with probability weights[j] / sum, exactly.

    Args:
        weights: [P], non-negative, not all zero.

    Returns:
        ``(threshold, alias)``, [P] each: with u = k + f, k an integer below P and f in [0, 1), the index is
        k where f < threshold[k], else alias[k].
    """
    size = len(weights)
    scaled = np.asarray(weights, float) * size / np.sum(weights)
    alias = np.arange(size, dtype=np.int32)
    threshold = np.ones(size)
    small = [k for k in range(size) if scaled[k] < 1.0]
    large = [k for k in range(size) if scaled[k] >= 1.0]
    while small and large:
        low, high = small.pop(), large.pop()
        threshold[low], alias[low] = scaled[low], high
        scaled[high] -= 1.0 - scaled[low]
        (small if scaled[high] < 1.0 else large).append(high)
    return threshold.astype(np.float32), alias


def draw_donors(uniform: jax.Array, emigration: NDArray[np.float64]) -> jax.Array:
    """Ranks of the emigrating habitats, drawn in proportion to their emigration rate mu.

    Args:
        uniform: [...] in [0, 1).
        emigration: mu, [P].

    Returns:
        [...] int32 ranks.
    """
    size = len(emigration)
    threshold, alias = alias_table(emigration)
    position = uniform * size
    index = jnp.minimum(position.astype(jnp.int32), size - 1)
    keep = position - index < jnp.asarray(threshold)[index]
    return jnp.where(keep, index, jnp.asarray(alias)[index])


def migrate_per_siv(
    population: jax.Array,
    immigrate: jax.Array,
    donor: jax.Array,
    immigration: NDArray[np.float64],
    emigration: NDArray[np.float64],
) -> jax.Array:
    """Standard migration: each SIV of habitat i immigrates with probability lambda_i, from a donor ~ mu.

    Args:
        population: [P, D], ranked best first.
        immigrate: [P, D] uniforms that decide whether a SIV immigrates.
        donor: [P, D] uniforms that draw the donor.
        immigration: lambda, [P].
        emigration: mu, [P].

    Returns:
        [P, D] candidates.
    """
    donors = draw_donors(donor, emigration)
    incoming = jnp.take_along_axis(population, donors, axis=0)
    moves = immigrate < jnp.asarray(immigration, immigrate.dtype)[:, None]
    return jnp.where(moves, incoming, population)


def migrate_fig6(
    population: jax.Array,
    immigrate: jax.Array,
    emigrate: jax.Array,
    siv: jax.Array,
    immigration: NDArray[np.float64],
    emigration: NDArray[np.float64],
) -> jax.Array:
    """Migration as Fig. 6 of the paper prints it.

    Habitat i immigrates with probability lambda_i; then every habitat j in turn, with probability mu_j,
    overwrites one randomly chosen SIV of habitat i by its own. Where several j hit one SIV the last, that is
    the worst ranked, wins; j = i changes nothing.

    Args:
        population: [P, D], ranked best first.
        immigrate: [P] uniforms that decide whether habitat i immigrates.
        emigrate: [P, P] uniforms that decide whether habitat j (column) emigrates to i (row).
        siv: [P, P] integers below D, the SIV that j overwrites in i.
        immigration: lambda, [P].
        emigration: mu, [P].

    Returns:
        [P, D] candidates.

    Differences from the paper:
        Donors are the ranked population before migration, so that all habitats migrate at once. The text
        selects h_j with probability proportional to mu_j, the pseudo code tries every j: the latter is done.
    """
    size, dim = population.shape
    immigrates = immigrate < jnp.asarray(immigration, immigrate.dtype)
    emigrates = emigrate < jnp.asarray(emigration, emigrate.dtype)
    rank = jnp.arange(size)
    sends = emigrates & immigrates[:, None] & (rank != rank[:, None])
    sender = jnp.where(sends, rank, -1)
    last = jnp.full((size, dim), -1).at[rank[:, None], siv].max(sender)
    incoming = jnp.take_along_axis(population, jnp.maximum(last, 0), axis=0)
    return jnp.where(last >= 0, incoming, population)


def mutate_uniform(
    candidates: jax.Array,
    decide: jax.Array,
    value: jax.Array,
    rate: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
) -> jax.Array:
    """Replace SIVs by fresh uniform draws within bounds, each with its habitat's probability.

    Args:
        candidates: [P, D] real or integer.
        decide: [P, D] uniforms that decide whether a SIV mutates.
        value: [P, D] uniforms that give the new value.
        rate: [P] probabilities m(S).
        lower: [D] bounds, inclusive.
        upper: [D] bounds, inclusive.
    """
    if jnp.issubdtype(candidates.dtype, jnp.integer):
        fresh = lower + jnp.floor(value * (upper - lower + 1)).astype(candidates.dtype)
        fresh = jnp.minimum(fresh, upper)
    else:
        fresh = lower + value * (upper - lower)
    return jnp.where(decide < rate[:, None], fresh, candidates)


def mutate_gaussian(
    candidates: jax.Array, decide: jax.Array, normal: jax.Array, rate: jax.Array, step: jax.Array
) -> jax.Array:
    """Add a Gaussian step to SIVs, each with its habitat's probability.

    Args:
        candidates: [P, D] real.
        decide: [P, D] uniforms that decide whether a SIV mutates.
        normal: [P, D] standard normal draws.
        rate: [P] probabilities m(S).
        step: [D] standard deviations.
    """
    return jnp.where(decide < rate[:, None], candidates + normal * step, candidates)
