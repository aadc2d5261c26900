"""Gradient polish of elite habitats with optax; for costs that are differentiable in real SIVs."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from auvplan.bbo.search import CostFunction, evaluate, worst_unless_finite

#: ``guide(population, *args)`` -> (what to descend on [R], (cost [R], violation [R])).
GuideFunction = Callable[..., tuple[jax.Array, tuple[jax.Array, jax.Array]]]


def refine(
    fun: CostFunction,
    habitats: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    steps: int,
    args: tuple[Any, ...] = (),
    step_size: float = 0.01,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Descend from several habitats at once and keep the best iterate of each; traceable.

    Adam in coordinates scaled to the bounds, with a step that falls to zero on a cosine.

    Args:
        fun: as for `minimize`; differentiable almost everywhere.
        habitats: [R, D] starts.
        lower: [D] inclusive bounds, kept by projection.
        upper: [D] inclusive bounds.
        steps: number of gradient steps.
        args: problem data passed on to `fun`.
        step_size: first step, as a share of each SIV's range.

    Returns:
        ``(habitats [R, D], cost [R], violation [R])``, never worse in cost than the starts.
    """

    def guide(population: jax.Array, *args: Any) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        cost, violation = evaluate(fun, population, *args)
        return cost, (cost, violation)

    return descend(guide, habitats, lower, upper, steps, args, step_size)


def descend(
    guide: GuideFunction,
    habitats: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    steps: jax.typing.ArrayLike,
    args: tuple[Any, ...] = (),
    step_size: jax.typing.ArrayLike = 0.01,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """`refine` along the slope of a guide, such as a cost that is less stiff, judged by the cost itself.

    Args:
        guide: gives what to descend on, and the cost and violation that choose the iterate to keep.
        habitats, lower, upper, steps, args, step_size: as for `refine`; steps and their size may be traced,
            and each SIV may have a size of its own, [D].

    Returns:
        As `refine`.
    """
    import optax  # takes a tenth of a second; compiled programs that are loaded do without it

    span = jnp.maximum(upper - lower, 1e-9)

    def falling(count: jax.typing.ArrayLike) -> jax.Array:
        """`optax.cosine_decay_schedule` for a number of steps that may be traced."""
        share = jnp.minimum(jnp.asarray(count) / jnp.maximum(steps, 1), 1.0)
        return jnp.asarray(0.5 * step_size) * (1.0 + jnp.cos(jnp.pi * share))

    optimizer = optax.adam(falling)

    def total(unit: jax.Array) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        aim, (cost, violation) = guide(lower + unit * span, *args)
        return jnp.where(jnp.isfinite(aim), aim, 0.0).sum(), (worst_unless_finite(cost), violation)

    value_and_slope = jax.value_and_grad(total, has_aux=True)

    def step(_: jax.Array, carry: Any) -> Any:
        unit, memory, best = carry
        (_, scored), gradient = value_and_slope(unit)
        better = scored[0] < best[1]
        best = (
            jnp.where(better[:, None], unit, best[0]),
            *(jnp.where(better, new, old) for new, old in zip(scored, best[1:], strict=True)),
        )
        change, memory = optimizer.update(jnp.nan_to_num(gradient), memory)
        return jnp.clip(unit + change, 0.0, 1.0), memory, best

    unit = jnp.clip((habitats - lower) / span, 0.0, 1.0)
    worst = jnp.full(habitats.shape[0], jnp.inf, habitats.dtype)
    carry = (unit, optimizer.init(unit), (unit, worst, worst))
    # The last step only scores what the one before it reached.
    _, _, (unit, cost, violation) = jax.lax.fori_loop(0, steps + 1, step, carry)
    return jnp.clip(lower + unit * span, lower, upper), cost, violation
