"""Priority vectors into routes of waypoints (section 3.3), a whole population at once, and back.

A habitat holds one integer SIV in [-200, 100] for each waypoint. From the start the vehicle moves on to the
qualifying neighbour of highest value until it is at the destination. The destination competes through its own
SIV, like any other waypoint.

Three decoders:

- "paper": the value of a waypoint is its SIV; the time is not looked at, and a route may come late.
- "timely": the same, and a waypoint qualifies only if the destination can still be reached in time.
- "rate": "timely", and the value is the SIV plus a share of the rate, priority per second, of the task on
  the path there. One more SIV, the last of the habitat, sets that share from nothing (-200) to all of it
  (100), so that the search settles by itself how greedy to be.
"""

from dataclasses import dataclass
from typing import Literal

import chex
import jax
import jax.numpy as jnp

from auvplan.mission.problem import Problem, Used, highest

#: Inclusive bounds of a SIV (section 3.3).
LOWEST, HIGHEST = -200, 100

DecoderName = Literal["paper", "timely", "rate"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Walk:
    """Loop state, [P, N] and [P].

    `value` holds the SIVs, minus infinity for a waypoint that has been visited; `position` the step at which
    a waypoint was visited, -1 if not.
    """

    value: jax.Array
    position: jax.Array
    current: jax.Array
    time: jax.Array
    priority: jax.Array
    tasks: jax.Array
    inverse: jax.Array
    step: jax.Array
    active: jax.Array
    used: Used | None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Decoded:
    """Routes of waypoints.

    Attributes:
        nodes: [P, N] int32, padded with -1.
        count: [P] number of waypoints, the start included.
        time: [P] s, T_Mission (Eq. 14).
        priority: [P] sum of rho.
        tasks: [P] number of edges that carry a task.
        inverse_priority: [P] sum of 1 / rho over those edges.
        remaining: [P] s, shortest time to the goal from the last waypoint; zero at the goal.
        late: [P] s, by how much the route overruns the deadline; "paper" only, zero elsewhere.
        reached: [P] bool, False for a route that ends in a dead end or is late.
        energy: [P] J, the least with which it is feasible; None where it is not limited.
    """

    nodes: jax.Array
    count: jax.Array
    time: jax.Array
    priority: jax.Array
    tasks: jax.Array
    inverse_priority: jax.Array
    remaining: jax.Array
    late: jax.Array
    reached: jax.Array
    energy: jax.Array | None = None


def siv_count(size: int, decoder: DecoderName) -> int:
    """Number of SIVs D of a habitat for a graph of `size` waypoints: N, or N + 1 ("rate")."""
    return size + (decoder == "rate")


def decode(
    population: jax.Array, problem: Problem, decoder: DecoderName, rate_weight: float = 100.0
) -> Decoded:
    """Turn every habitat into a sequence of waypoints.

    A waypoint j qualifies at i if an edge leads there, it has not been visited, and, but for "paper", the
    edge is entered before the latest time that leaves enough for the path to the goal. That path ignores
    which waypoints have been visited, so a route can still end in a dead end. Of equal values the lowest
    index goes first. A traversed edge needs no removal: it leads into a waypoint that has been visited.

    Args:
        population: [P, D] integers in [-200, 100], D as `siv_count` has it.
        problem: from `prepare`.
        decoder: which of the three.
        rate_weight: what an edge of average rate adds to a SIV at most ("rate" only).

    Differences from the paper:
        "timely" and "rate" are not in it: it adds waypoints without looking at the time, and holds a late
        route for infeasible.
    """
    size = problem.size
    chex.assert_shape(population, (None, siv_count(size, decoder)))
    habitats = population.shape[0]
    rows = jnp.arange(habitats)
    genes = population[:, :size].astype(problem.leg_times.dtype)
    share = jnp.zeros(habitats)
    if decoder == "rate":
        share = rate_weight * (population[:, size] - LOWEST) / (HIGHEST - LOWEST)

    def advance(walk: _Walk) -> _Walk:
        here = walk.current
        onward = problem.neighbours[here]
        value = walk.value[rows[:, None], onward]
        times, then = problem.onward(here, walk.time, walk.used)
        if decoder == "rate":
            value = value + share[:, None] * problem.rate[here]
        if decoder == "paper":
            qualifies = jnp.isfinite(times)
        else:
            qualifies = walk.time[:, None] < problem.latest[here]
            if problem.varies:
                qualifies = qualifies & jnp.isfinite(times)
        value = jnp.where(qualifies, value, -jnp.inf)
        best, edge = highest(value)
        moves = walk.active & (best > -jnp.inf)
        there = jnp.where(moves, onward[rows, edge], here)
        rho = jnp.where(moves, problem.priority[here, edge], 0.0)
        if problem.falling:
            rho = rho - jnp.where(moves, problem.lost(here, edge, walk.time, times[rows, edge]), 0.0)
        used = jax.tree.map(lambda new, old: jnp.where(moves[:, None], new[rows, edge], old), then, walk.used)
        task = rho > 0.0
        entered = jnp.where(moves, there, size)
        return _Walk(
            value=walk.value.at[rows, entered].set(-jnp.inf, mode="drop"),
            position=walk.position.at[rows, entered].set(walk.step + 1, mode="drop"),
            current=there,
            time=walk.time
            + jnp.where(moves, times[rows, edge] if problem.varies else problem.leg_times[here, edge], 0.0),
            priority=walk.priority + rho,
            tasks=walk.tasks + task,
            inverse=walk.inverse + jnp.where(task, 1.0 / rho, 0.0),
            step=walk.step + 1,
            active=moves & (there != problem.goal),
            used=used,
        )

    zero = jnp.zeros(habitats, problem.leg_times.dtype)
    index = jnp.arange(size, dtype=jnp.int32)
    walk = jax.lax.while_loop(
        lambda walk: walk.active.any(),
        advance,
        _Walk(
            value=genes.at[:, problem.start].set(-jnp.inf),
            position=jnp.broadcast_to(jnp.where(index == problem.start, 0, -1), (habitats, size)),
            current=jnp.full(habitats, problem.start, jnp.int32),
            time=zero,
            priority=zero,
            tasks=jnp.zeros(habitats, jnp.int32),
            inverse=zero,
            step=jnp.int32(0),
            active=jnp.broadcast_to(problem.start != problem.goal, (habitats,)),
            used=Used.nothing(problem, habitats),
        ),
    )
    place = jnp.where(walk.position < 0, size, walk.position)
    late = jnp.maximum(walk.time - problem.deadline, 0.0) if decoder == "paper" else jnp.zeros(habitats)
    return Decoded(
        nodes=jnp.full((habitats, size), -1, jnp.int32).at[rows[:, None], place].set(index, mode="drop"),
        count=(walk.position >= 0).sum(axis=1),
        time=walk.time,
        priority=walk.priority,
        tasks=walk.tasks,
        inverse_priority=walk.inverse,
        remaining=problem.time_to_go[walk.current],
        late=late,
        reached=(walk.current == problem.goal) & (late == 0.0),
        energy=None if walk.used is None else walk.used.energies.min(axis=-1),
    )


def encode(nodes: jax.Array, population: jax.Array, decoder: DecoderName) -> jax.Array:
    """Write routes into habitats that decode to them.

    SIVs fall by one from waypoint to waypoint along the route, those of the other waypoints keep their rank
    below, and the share of the rate is nothing: the next waypoint beats the later ones and all others. An
    route of 300 legs or more exhausts the range of a SIV and may decode differently.

    Args:
        nodes: [Q, N] routes, padded with -1.
        population: [Q, D] habitats, for the SIVs of the waypoints that a route leaves out.
        decoder: which of the three.

    Returns:
        [Q, D] habitats.
    """
    count, size = nodes.shape
    rows = jnp.arange(count)[:, None]
    unvisited = jnp.full((count, size), -1, jnp.int32)
    place = unvisited.at[rows, jnp.where(nodes < 0, size, nodes)].set(
        jnp.arange(size, dtype=jnp.int32), mode="drop"
    )
    length = (nodes >= 0).sum(axis=1, keepdims=True)
    room = jnp.maximum(HIGHEST - length - LOWEST, 0)
    below = LOWEST + (population[:, :size] - LOWEST) * room // (HIGHEST - LOWEST + 1)
    genes = jnp.where(place >= 0, jnp.maximum(HIGHEST - place, LOWEST), below)
    shares = jnp.full((count, siv_count(size, decoder) - size), LOWEST, genes.dtype)
    return jnp.concatenate([genes, shares], axis=1)


def shortest_route(problem: Problem) -> jax.Array:
    """Return the shortest path from the start to the goal as a route [N], padded with -1."""
    size = problem.size

    def step(k: jax.Array, state: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        nodes, here = state
        onward = problem.following[here]
        return nodes.at[k].set(jnp.where(onward != here, onward, -1)), onward

    start = jnp.asarray(problem.start, jnp.int32)
    nodes, _ = jax.lax.fori_loop(1, size, step, (jnp.full(size, start), start))
    return nodes


def greedy_habitat(problem: Problem, decoder: DecoderName) -> jax.Array:
    """Return a habitat [D] of equal SIVs, the goal's lowest: "rate" goes where the rate is highest."""
    size = problem.size
    genes = jnp.where(jnp.arange(size) == problem.goal, LOWEST, 0).astype(jnp.int32)
    return jnp.concatenate([genes, jnp.full(siv_count(size, decoder) - size, HIGHEST, jnp.int32)])
