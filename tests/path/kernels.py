"""The path's kernels, compiled as a whole: operation by operation they take many small programs."""

from dataclasses import replace

import jax
import jax.numpy as jnp

from auvplan.path import cost, habitats
from auvplan.path.cost import Track
from auvplan.path.problem import Problem
from auvplan.vehicle import Vehicle

curves = jax.jit(cost.curves, static_argnums=3)
evaluate = jax.jit(cost.evaluate, static_argnums=4)
judged_within = jax.jit(cost.judged_within, static_argnums=3)
through = jax.jit(Track.through)
violations = jax.jit(cost.violations)


def leg(start, goal, env, depart=0.0, vehicle=None):
    """A leg of the usual vehicle."""
    return Problem(start, goal, depart, env, vehicle or Vehicle())


@jax.jit(static_argnums=6)
def score(habitats, start, goal, depart, env, vehicle, config):
    """`cost.score` of a leg."""
    return cost.score(habitats, leg(start, goal, env, depart, vehicle), config)


@jax.jit(static_argnums=6)
def soft_objective(habitats, start, goal, depart, env, vehicle, config):
    """`cost.soft_objective` of a leg."""
    return cost.soft_objective(habitats, leg(start, goal, env, depart, vehicle), config)


def population(count, start, goal, env, config, seed=0, over=None):
    """First habitats between two places, over a sea bed where one is given."""
    return _population(jax.random.key(seed), count, jnp.asarray(start), jnp.asarray(goal), env, config, over)


@jax.jit(static_argnums=(1, 5))
def _population(key, count, start, goal, env, config, over):
    problem = leg(start, goal, env)
    within = habitats.bounds(problem, config)
    bare = replace(problem, env=replace(env, seabed=None))
    return habitats.initial(key, count, bare if over is None else problem, *within, config)
