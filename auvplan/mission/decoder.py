"""Priority vectors into orders of waypoints (section 3.3): a whole population at once.

A habitat holds one integer SIV in [-200, 100] for each waypoint. From the start the vehicle moves on to the
qualifying neighbour of highest value until it is at the destination. The destination competes through its own
SIV, like any other waypoint.

Two decoders:

- "paper": the value of a waypoint is its SIV.
- "rate": the value is its SIV plus a share of the rate, priority per second, of the task on the way there.
  One more SIV, the last of the habitat, sets that share from nothing (-200) to all of it (100), so that the
  search settles by itself how greedy to be.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import chex
import jax
import jax.numpy as jnp

from auvplan.mission.graph import shortest_routes

#: Inclusive bounds of a SIV (section 3.3).
LOWEST, HIGHEST = -200, 100

DecoderName = Literal["paper", "rate"]


@partial(
    jax.tree_util.register_dataclass,
    data_fields=(
        "leg_times",
        "priority",
        "rate",
        "time_to_go",
        "following",
        "start",
        "goal",
        "time_available",
        "deadline",
        "return_margin",
    ),
    meta_fields=(),
)
@dataclass(frozen=True)
class Problem:
    """A mission on one graph, prepared for decoding.

    Attributes:
        leg_times: [N, N] s, t_ij; infinite off the edges, into the start and into visited waypoints.
        priority: [N, N] rho_ij; zero where there is no task.
        rate: [N, N] rho_ij / t_ij over its mean on the edges that carry a task.
        time_to_go: [N] s, shortest time to the goal.
        following: [N] the next waypoint on the shortest way to the goal.
        start, goal: indices.
        time_available: s, T_available.
        deadline: s, T_available less the rounding error that a sum of N legs can have.
        return_margin: share by which the way to the goal is taken to last longer than expected.
    """

    leg_times: jax.Array
    priority: jax.Array
    rate: jax.Array
    time_to_go: jax.Array
    following: jax.Array
    start: jax.Array
    goal: jax.Array
    time_available: jax.Array
    deadline: jax.Array
    return_margin: jax.Array


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("position", "current", "time", "priority", "tasks", "inverse", "step", "active"),
    meta_fields=(),
)
@dataclass(frozen=True)
class _Walk:
    """Loop state: `position` [P, N] is the step at which a waypoint was visited, -1 if not; the rest [P]."""

    position: jax.Array
    current: jax.Array
    time: jax.Array
    priority: jax.Array
    tasks: jax.Array
    inverse: jax.Array
    step: jax.Array
    active: jax.Array


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("nodes", "count", "time", "priority", "tasks", "inverse_priority", "remaining", "reached"),
    meta_fields=(),
)
@dataclass(frozen=True)
class Decoded:
    """Orders of waypoints.

    Attributes:
        nodes: [P, N] int32, padded with -1.
        count: [P] number of waypoints, the start included.
        time: [P] s, T_Mission (Eq. 14).
        priority: [P] sum of rho.
        tasks: [P] number of edges that carry a task.
        inverse_priority: [P] sum of 1 / rho over those edges.
        remaining: [P] s, shortest time to the goal from the last waypoint; zero at the goal.
        reached: [P] bool, False for an order that ends in a dead end.
    """

    nodes: jax.Array
    count: jax.Array
    time: jax.Array
    priority: jax.Array
    tasks: jax.Array
    inverse_priority: jax.Array
    remaining: jax.Array
    reached: jax.Array


def siv_count(size: int, decoder: DecoderName) -> int:
    """Number of SIVs D of a habitat for a graph of `size` waypoints: N ("paper") or N + 1 ("rate")."""
    return size + (decoder == "rate")


def rounding_margin(size: int, dtype: Any = jnp.float32) -> float:
    """Relative error that bounds the sum of `size` leg times, forwards and as time to go."""
    return size * float(jnp.finfo(dtype).eps)


def prepare(
    leg_times: jax.Array,
    priority: jax.Array,
    start: jax.Array,
    goal: jax.Array,
    time_available: jax.Array,
    visited: jax.Array,
    return_margin: jax.typing.ArrayLike = 0.0,
) -> Problem:
    """Work out what all orders on a graph have in common.

    Args:
        leg_times: [N, N] s, infinite off the edges (`MissionGraph.leg_times`).
        priority: [N, N] rho_ij, zero where an edge carries no task.
        start, goal: indices, may be traced.
        time_available: T_available, s.
        visited: [N] bool, waypoints not to be visited again.
        return_margin: share by which the way to the goal is taken to last longer than expected.
    """
    size = leg_times.shape[0]
    chex.assert_shape([leg_times, priority], (size, size))
    closed = visited | (jnp.arange(size) == start)
    leg_times = jnp.where(closed[None, :], jnp.inf, leg_times)
    priority = jnp.where(jnp.isfinite(leg_times), priority, 0.0)
    # A floor of one second keeps the rate of a leg that takes no time from drowning all others.
    rate = priority / jnp.maximum(leg_times, 1.0)
    mean = rate.sum() / jnp.maximum((rate > 0.0).sum(), 1)
    time, following = shortest_routes(leg_times, goal)
    return Problem(
        leg_times=leg_times,
        priority=priority,
        rate=rate / jnp.where(mean > 0.0, mean, 1.0),
        time_to_go=time,
        following=following,
        start=start,
        goal=goal,
        time_available=time_available,
        deadline=time_available * (1.0 - rounding_margin(size, leg_times.dtype)),
        return_margin=jnp.asarray(return_margin, leg_times.dtype),
    )


def decode(
    population: jax.Array, problem: Problem, decoder: DecoderName, rate_weight: float = 100.0
) -> Decoded:
    """Turn every habitat into an order of waypoints.

    A waypoint j qualifies at i if an edge leads there, it has not been visited, and the time so far plus t_ij
    plus the shortest time from j to the goal, lengthened by the return margin, is below the time available.
    The shortest time ignores which waypoints have been visited, so an order can still end in a dead end.
    Of equal values the lowest index goes first. A traversed edge needs no removal: it leads into a waypoint
    that has been visited.

    Args:
        population: [P, D] integers in [-200, 100], D as `siv_count` has it.
        problem: from `prepare`.
        decoder: "paper" or "rate".
        rate_weight: what an edge of average rate adds to a SIV at most ("rate" only).

    Differences from the paper:
        It adds waypoints without looking at the time and discards orders that are late; "rate" is not in
        it at all.
    """
    size = problem.time_to_go.shape[0]
    chex.assert_shape(population, (None, siv_count(size, decoder)))
    index = jnp.arange(size, dtype=jnp.int32)
    genes = population[:, :size].astype(problem.leg_times.dtype)
    way_back = (1.0 + problem.return_margin) * problem.time_to_go
    latest = problem.deadline - (problem.leg_times + way_back[None, :])
    habitats = population.shape[0]
    share = jnp.zeros(habitats)
    if decoder == "rate":
        share = rate_weight * (population[:, size] - LOWEST) / (HIGHEST - LOWEST)

    def advance(walk: _Walk) -> _Walk:
        here = walk.current
        value = genes
        if decoder == "rate":
            value = value + share[:, None] * problem.rate[here]
        qualifies = (walk.time[:, None] < latest[here]) & (walk.position < 0)
        value = jnp.where(qualifies, value, -jnp.inf)
        best = value.max(axis=1)
        # The first index of the highest value: two plain reductions run twice as fast as argmax on a CPU.
        chosen = jnp.where(value == best[:, None], index, size - 1).min(axis=1)
        moves = walk.active & (best > -jnp.inf)
        rho = jnp.where(moves, problem.priority[here, chosen], 0.0)
        task = rho > 0.0
        arrives = moves[:, None] & (index == chosen[:, None])
        return _Walk(
            position=jnp.where(arrives, walk.step + 1, walk.position),
            current=jnp.where(moves, chosen, here),
            time=walk.time + jnp.where(moves, problem.leg_times[here, chosen], 0.0),
            priority=walk.priority + rho,
            tasks=walk.tasks + task,
            inverse=walk.inverse + jnp.where(task, 1.0 / jnp.where(task, rho, 1.0), 0.0),
            step=walk.step + 1,
            active=moves & (chosen != problem.goal),
        )

    zero = jnp.zeros(habitats, problem.leg_times.dtype)
    walk = jax.lax.while_loop(
        lambda walk: walk.active.any(),
        advance,
        _Walk(
            position=jnp.broadcast_to(jnp.where(index == problem.start, 0, -1), (habitats, size)),
            current=jnp.full(habitats, problem.start, jnp.int32),
            time=zero,
            priority=zero,
            tasks=jnp.zeros(habitats, jnp.int32),
            inverse=zero,
            step=jnp.int32(0),
            active=jnp.broadcast_to(problem.start != problem.goal, (habitats,)),
        ),
    )
    column = jnp.where(walk.position < 0, size, walk.position)
    rows = jnp.arange(habitats)[:, None]
    return Decoded(
        nodes=jnp.full((habitats, size), -1, jnp.int32).at[rows, column].set(index, mode="drop"),
        count=(walk.position >= 0).sum(axis=1),
        time=walk.time,
        priority=walk.priority,
        tasks=walk.tasks,
        inverse_priority=walk.inverse,
        remaining=problem.time_to_go[walk.current],
        reached=walk.current == problem.goal,
    )


def shortest_habitat(problem: Problem, decoder: DecoderName) -> jax.Array:
    """A habitat [D] that either decoder turns into the shortest way to the goal.

    SIVs fall by one along the way and are lowest elsewhere, so that the next waypoint of the way beats the
    later ones, whose SIVs are lower, and all others; the share of the rate is nothing. A way of more than 300
    legs exhausts the range of a SIV and may decode differently.
    """
    size = problem.time_to_go.shape[0]
    index = jnp.arange(size)

    def step(k: jax.Array, state: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        genes, here = state
        onward = problem.following[here]
        fresh = (index == onward) & (here != problem.goal)
        return jnp.where(fresh, jnp.maximum(HIGHEST - k, LOWEST), genes), onward

    lowest = jnp.full(size, LOWEST, jnp.int32)
    genes, _ = jax.lax.fori_loop(0, size, step, (lowest, jnp.asarray(problem.start, jnp.int32)))
    return jnp.concatenate([genes, jnp.full(siv_count(size, decoder) - size, LOWEST, jnp.int32)])


def greedy_habitat(problem: Problem, decoder: DecoderName) -> jax.Array:
    """A habitat [D] of equal SIVs, the goal's lowest: "rate" goes where the rate is highest."""
    size = problem.time_to_go.shape[0]
    genes = jnp.where(jnp.arange(size) == problem.goal, LOWEST, 0).astype(jnp.int32)
    return jnp.concatenate([genes, jnp.full(siv_count(size, decoder) - size, HIGHEST, jnp.int32)])
