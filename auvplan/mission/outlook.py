"""What may still be gained from each waypoint on, by the clock.

Where windows open and close no single price of a second states what a route that ends early is worth. Routes
that may repeat waypoints are worked out backwards in time, on evenly spaced moments. So that they repeat
few, each visit is charged with a Lagrange multiplier of the rule that none is repeated, found by
subgradient steps (Held, Wolfe and Crowder 1974).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from auvplan.mission.problem import Problem, highest

#: Moments at which it is known; legs that end between two of them end at the earlier one.
MOMENTS = 256


class Onward(NamedTuple):
    """Where every edge leads to from every moment.

    Attributes:
        moment: [M, N, K] int32, the moment after its task.
        open: [M, N, K] bool, whether it can be entered and the goal be reached then.
        lost: [M, N, K] by how much its task's priority has fallen then; None where none falls.
    """

    moment: jax.Array
    open: jax.Array
    lost: jax.Array | None


class Outlook(NamedTuple):
    """What may still be gained.

    Attributes:
        charge: [N] of a visit.
        onward: [M + 1, N] less the charges, from a waypoint on, by the moment at which it is left.
    """

    charge: jax.Array
    onward: jax.Array

    def weighed(self, share: jax.Array) -> "Outlook":
        """Return a share of it."""
        return Outlook(
            share * self.charge, jnp.where(jnp.isfinite(self.onward), share * self.onward, -jnp.inf)
        )

    def at(self, problem: Problem, node: jax.Array, time: jax.Array) -> jax.Array:
        """Return what may be gained from waypoints that are left at times, arrays of one shape."""
        found = self.onward[_moment(problem, time), node]
        return jnp.where(jnp.isfinite(found), found, 0.0)


def _moment(problem: Problem, time: jax.Array) -> jax.Array:
    """Return the last moment at or before times; the last of all where they are infinite."""
    place = jnp.minimum(MOMENTS * time / problem.deadline, MOMENTS)
    return jnp.floor(jnp.maximum(place, 0.0)).astype(jnp.int32)


def onward_edges(problem: Problem) -> Onward:
    """Look up where every edge leads to from every moment, by the clock."""
    schedule = problem.schedule
    assert schedule is not None
    size, width = problem.neighbours.shape
    node, edge = jnp.arange(size)[:, None], jnp.arange(width)[None]
    usable = jnp.isfinite(problem.leg_times)

    def from_(number: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array | None]:
        time = jnp.full((size, width), number * problem.deadline / MOMENTS)
        lasts = schedule.lasts(node, edge, time)
        open_ = usable & jnp.isfinite(lasts) & (time < problem.latest)
        lost = problem.lost(node, edge, time, lasts) if problem.falling else None
        return jnp.clip(_moment(problem, time + lasts), number + 1, MOMENTS), open_, lost

    return Onward(*jax.vmap(from_)(jnp.arange(MOMENTS)))


def look_ahead(
    problem: Problem, gain: jax.Array, edges: Onward, charge: jax.Array
) -> tuple[Outlook, jax.Array]:
    """What may be gained under charges [N] of visits, and the place of the best edge [M, N] in its list."""
    reduced = gain - charge[problem.neighbours]
    at_goal = jnp.arange(problem.size) == problem.goal
    nothing = jnp.where(at_goal, 0.0, -jnp.inf)
    onward = jnp.broadcast_to(nothing, (MOMENTS + 1, problem.size)).astype(gain.dtype)

    def back(onward: jax.Array, row: tuple) -> tuple[jax.Array, jax.Array]:
        number, moment, open_, lost = row
        gained = reduced if lost is None else reduced - lost
        value = jnp.where(open_, gained + onward[moment, problem.neighbours], -jnp.inf)
        best, place = highest(value)
        return onward.at[number].set(jnp.where(at_goal, 0.0, best)), place

    rows = jnp.arange(MOMENTS), edges.moment, edges.open, edges.lost
    onward, chosen = jax.lax.scan(back, onward, rows, reverse=True)
    return Outlook(charge, onward), chosen


def sharpened(
    problem: Problem, gain: jax.Array, edges: Onward, charge: jax.Array, known: jax.Array, steps: jax.Array
) -> jax.Array:
    """Return charges [N] by which the best path repeats fewer waypoints, by [R] shares of Polyak's steps."""
    index = jnp.arange(problem.size)
    free = (index == problem.start) | (index == problem.goal)

    def step(charge: jax.Array, share: jax.Array) -> tuple[jax.Array, None]:
        outlook, chosen = look_ahead(problem, gain, edges, charge)
        excess = outlook.onward[0, problem.start] + charge.sum() - known
        visits = _visits(problem, edges, chosen)
        slope = jnp.where(free | ((charge == 0.0) & (visits == 0.0)), 0.0, visits - 1.0)
        length = share * jnp.maximum(excess, 0.0) / jnp.maximum((slope**2).sum(), 1.0)
        onward = jnp.maximum(charge + length * slope, 0.0)
        return jnp.where(jnp.isfinite(excess), onward, charge), None

    return jax.lax.scan(step, charge, steps)[0]


def _visits(problem: Problem, edges: Onward, chosen: jax.Array) -> jax.Array:
    """How often the best path visits each waypoint, [N]."""

    def go(state: tuple) -> tuple:
        counts, here, moment = state
        place = chosen[moment, here]
        there = problem.neighbours[here, place]
        return counts.at[there].add(1.0), there, edges.moment[moment, here, place]

    counts, start = jnp.zeros(problem.size), jnp.asarray(problem.start, jnp.int32)
    state = counts, start, jnp.zeros((), jnp.int32)
    return jax.lax.while_loop(lambda state: (state[1] != problem.goal) & (state[2] < MOMENTS), go, state)[0]
