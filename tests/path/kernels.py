"""The path's kernels, compiled as a whole: operation by operation they take many small programs."""

import jax
import jax.numpy as jnp

from auvplan.path import cost, habitats
from auvplan.path.cost import Track

curves = jax.jit(cost.curves, static_argnums=3)
evaluate = jax.jit(cost.evaluate, static_argnums=4)
judged_within = jax.jit(cost.judged_within, static_argnums=3)
score = jax.jit(cost.score, static_argnums=6)
soft_objective = jax.jit(cost.soft_objective, static_argnums=6)
through = jax.jit(Track.through)
violations = jax.jit(cost.violations)


def population(count, start, goal, env, config, seed=0, over=None):
    """First habitats between two places, over a sea bed where one is given."""
    return _population(jax.random.key(seed), count, jnp.asarray(start), jnp.asarray(goal), env, config, over)


@jax.jit(static_argnums=(1, 5))
def _population(key, count, start, goal, env, config, over):
    lower, upper = habitats.bounds(start, goal, env, config)
    return habitats.initial(key, count, start, goal, lower, upper, config, over)
