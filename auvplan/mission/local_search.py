"""Local search on orders of waypoints: each order takes the best of all small changes, round by round.

A change cuts out up to `CUT` waypoints that follow each other and puts one other waypoint, or none, in their
place. That covers insertion, removal and replacement.
"""

from functools import partial

import jax
import jax.numpy as jnp

from auvplan.mission.problem import Problem, highest

#: Waypoints that one change may cut out.
CUT = 2


def improve(nodes: jax.Array, problem: Problem, gain: jax.Array, rounds: int) -> jax.Array:
    """Apply the best change to every order, `rounds` times.

    Args:
        nodes: [P, N] orders from the start to the goal, padded with -1.
        problem: what they are orders of.
        gain: [N, K] what taking an edge is worth, as in `auvplan.mission.beam`.
        rounds: number of changes to each order at most.

    Returns:
        [P, N] orders that keep all limits and gain at least as much.
    """
    times = _table(problem, problem.leg_times, jnp.inf)
    gains = _table(problem, gain, 0.0)
    step = partial(_change_all, problem=problem, times=times, gains=gains, gain=gain)
    return jax.lax.fori_loop(0, rounds, lambda _, orders: step(orders), nodes)


def _table(problem: Problem, values: jax.Array, default: float) -> jax.Array:
    """Return values of the edges [N, K] as a table [N, N]."""
    size = problem.size
    rows = jnp.arange(size)[:, None]
    column = jnp.where(jnp.isfinite(problem.leg_times), problem.neighbours, size)
    return jnp.full((size, size), default, values.dtype).at[rows, column].set(values, mode="drop")


def _change_all(
    nodes: jax.Array, problem: Problem, times: jax.Array, gains: jax.Array, gain: jax.Array
) -> jax.Array:
    """One best change to each order."""
    count, size = nodes.shape
    rows = jnp.arange(count)
    here, onward = jnp.maximum(nodes[:, :-1], 0), nodes[:, 1:]
    legs = onward >= 0
    onward = jnp.maximum(onward, 0)
    zero = jnp.zeros((count, 1))
    arrival = jnp.concatenate([zero, jnp.cumsum(jnp.where(legs, times[here, onward], 0.0), axis=1)], axis=1)
    gained = jnp.concatenate([zero, jnp.cumsum(jnp.where(legs, gains[here, onward], 0.0), axis=1)], axis=1)
    at = jnp.maximum(nodes, 0)
    inside = nodes >= 0
    visited = (
        jnp.zeros((count, size), bool)
        .at[rows[:, None], jnp.where(inside, nodes, size)]
        .set(True, mode="drop")
    )
    # By how much everything from a place on may be delayed.
    due = problem.deadline - problem.way_back[at]
    slack = jnp.where(inside, due - arrival, jnp.inf)
    slack = jax.lax.cummin(slack, axis=1, reverse=True)

    via = problem.neighbours[at]
    open_ = (
        inside[:, :, None] & ~visited[rows[:, None, None], via] & (arrival[:, :, None] < problem.latest[at])
    )
    best = jnp.zeros(count)
    choice = (jnp.full(count, size), jnp.zeros(count, jnp.int32), jnp.zeros(count, jnp.int32))

    def consider(best, choice, worth, place, cut, node):
        better = worth > best
        values = (place, jnp.full(count, cut), node)
        return jnp.where(better, worth, best), tuple(
            jnp.where(better, new, old) for new, old in zip(values, choice, strict=True)
        )

    for cut in range(CUT + 1):
        ahead = jnp.minimum(jnp.arange(size) + 1 + cut, size - 1)
        there = at[:, ahead]
        room = slack[:, ahead]
        fits = inside[:, ahead] & (jnp.arange(size) + 1 + cut < size)
        old_time, old_gain = arrival[:, ahead] - arrival, gained[:, ahead] - gained
        longer = problem.leg_times[at] + times[via, there[:, :, None]] - old_time[:, :, None]
        richer = gain[at] + gains[via, there[:, :, None]] - old_gain[:, :, None]
        worth = jnp.where(open_ & fits[:, :, None] & (longer < room[:, :, None]), richer, -jnp.inf)
        value, index = highest(worth.reshape(count, -1))
        place, edge = index // via.shape[2], index % via.shape[2]
        best, choice = consider(best, choice, value, place, cut, via[rows, place, edge])
        if cut:
            longer, richer = times[at, there] - old_time, gains[at, there] - old_gain
            worth = jnp.where(inside & fits & (longer < room), richer, -jnp.inf)
            best, choice = consider(best, choice, *highest(worth), cut, jnp.full(count, -1))

    place, cut, node = (value[:, None] for value in choice)
    column = jnp.arange(size)
    source = column - (node >= 0) + cut
    moved = jnp.where(source < size, jnp.take_along_axis(nodes, jnp.clip(source, 0, size - 1), axis=1), -1)
    changed = jnp.where(column <= place, nodes, jnp.where((column == place + 1) & (node >= 0), node, moved))
    return jnp.where(best[:, None] > 1e-6, changed, nodes)
