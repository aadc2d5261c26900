"""The path's kernels, compiled as a whole: operation by operation they take many small programs."""

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp

from auvplan.path import cost, habitats
from auvplan.path.cost import Track
from auvplan.path.problem import Problem
from auvplan.vehicle import Vehicle

curves = jax.jit(cost.curves, static_argnums=3)
evaluate = jax.jit(cost.evaluate, static_argnums=4)
fields_of = jax.jit(lambda *given: cost.evaluate(*given).fields(), static_argnums=4)
judged_within = jax.jit(cost.judged_within, static_argnums=3)
through = jax.jit(Track.through)
violations = jax.jit(cost.violations)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Jet:
    """A current (u, v, w) m/s within so many metres of a place on the way north, and none elsewhere."""

    speeds: Any
    north: Any
    within: Any

    steady = True

    def __call__(self, x, y, z, t):
        inside = jnp.abs(x - self.north) < self.within
        return tuple(jnp.where(inside, speed, 0.0) for speed in self.speeds)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Layers:
    """A current along the way, m/s, and by how much stronger it is below some depth, over a width, m."""

    above: Any
    more: Any
    depth: Any
    width: Any

    steady = True

    @classmethod
    def of(cls, above, more, depth=30.0, width=5.0):
        return cls(*map(jnp.float32, (above, more, depth, width)))

    def __call__(self, x, y, z, t):
        share = 0.5 * (1.0 + jnp.tanh((z - self.depth) / self.width))
        return self.above + self.more * share + 0.0 * x, 0.0 * y, 0.0 * z


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
