"""Initial routes by beam search: many partial routes grow together, the most promising survive.

All routes of a beam have the same number of waypoints. Their worth is what they have gained less a price for
the time they have taken, so that short and long ones compare. Two partial routes that end at one waypoint and
have visited the same others differ in nothing but worth: only the better one goes on. So that a few rich
regions of a large graph do not fill the beam, each waypoint also has a limited number of places in it.

Where times depend on the clock a second is worth more or less by where windows are about to close: most beams
then compare routes by what may still be gained, see `auvplan.mission.outlook`.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.mission.outlook import Outlook, look_ahead, onward_edges, sharpened
from auvplan.mission.problem import Problem, Used

#: A priority-to-time price that pays best lies around the yield of the whole mission; each beam tries one.
PRICES = (1.0, 0.75, 1.25)

#: Where times depend on the clock: beams led by what may be gained later, sharpened by this many steps before
#: each, and a last one by the price alone.
LED, STEPS = 7, 6

#: What is left of the price where a beam is so led, and of a step at the next one.
LEAST_SHARE, DECAY = 0.05, 0.97


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Beam:
    """Partial routes; `visited` is [W, N], `used` [W, L], `mark` a hash of the waypoints visited, all [W]."""

    here: jax.Array
    time: jax.Array
    worth: jax.Array
    visited: jax.Array
    mark: jax.Array
    alive: jax.Array
    used: Used | None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Trace:
    """Of each step, [N, W]: where a route came from, where it went, what ending it there is worth."""

    parent: jax.Array
    node: jax.Array
    ended: jax.Array


def beam_search(
    problem: Problem,
    gain: jax.Array,
    price: jax.Array,
    width: int,
    places: int,
    count: int,
    outlook: Outlook | None = None,
) -> tuple[jax.Array, jax.Array]:
    """Return the best routes that a beam comes upon.

    Args:
        problem: of N waypoints, neighbour lists of length K.
        gain: [N, K] what taking an edge is worth.
        price: what a second is worth while routes are compared; the answer is ranked by gain alone.
        width: W, number of partial routes that survive a step.
        places: number of partial routes, of those W, that may end at one waypoint.
        count: Q, number of routes wanted.
        outlook: what may be gained later, by which routes are compared before the price of their time.

    Returns:
        ``(nodes [Q, N] int32 padded with -1, gain [Q])``, best first; minus infinity for a route that was
        not found, whose row then starts at the start and means nothing.
    """
    size, edges = problem.neighbours.shape
    codes = np.random.default_rng(0).integers(0, 2**32, size, dtype=np.uint32)
    codes = jnp.asarray(codes)
    width_index = jnp.arange(width)
    candidate_index = jnp.arange(width * edges)
    to_goal = problem.neighbours == problem.goal

    def grow(state: tuple[_Beam, _Trace, jax.Array]) -> tuple[_Beam, _Trace, jax.Array]:
        beam, trace, step = state
        onward = problem.neighbours[beam.here]
        times, then = problem.onward(beam.here, beam.time, beam.used)
        open_ = (
            beam.alive[:, None]
            & (beam.time[:, None] < problem.latest[beam.here])
            & ~beam.visited[width_index[:, None], onward]
        )
        if problem.varies:
            open_ = open_ & jnp.isfinite(times)
        gained = beam.worth[:, None] + gain[beam.here]
        if problem.falling:
            edge, since = jnp.arange(edges)[None], beam.time[:, None]
            gained = gained - problem.lost(beam.here[:, None], edge, since, times)
        ends = open_ & to_goal[beam.here]
        ended = jnp.where(ends, gained, -jnp.inf).max(axis=1)

        open_ = open_ & ~to_goal[beam.here]
        time = beam.time[:, None] + times
        passed = time if then is None else problem.time_available * then.share(problem)
        value = gained - price * passed
        if outlook is not None:
            charged = (beam.visited @ outlook.charge)[:, None] + outlook.charge[onward]
            value = value - charged + outlook.at(problem, onward, time)
        value = jnp.where(open_, value, -jnp.inf).reshape(-1)
        mark = (beam.mark[:, None] ^ codes[onward]).reshape(-1)
        node = onward.reshape(-1)
        # Equal visits share a slot; of those that meet in a slot the best goes on, of equal ones the first.
        # Where the vehicle may not wait a later arrival may serve better: only equal times share one too.
        alike = mark
        if problem.schedule is not None and not problem.schedule.waiting:
            alike = mark ^ jax.lax.bitcast_convert_type(time, jnp.uint32).reshape(-1)
        slot = node * places + (alike % places).astype(jnp.int32)
        highest = jnp.full(size * places, -jnp.inf).at[slot].max(value)
        leads = (value == highest[slot]) & (value > -jnp.inf)
        first = (
            jnp.full(size * places, width * edges)
            .at[jnp.where(leads, slot, size * places)]
            .min(candidate_index, mode="drop")
        )
        value = jnp.where(first[slot] == candidate_index, value, -jnp.inf)
        best, chosen = jax.lax.top_k(value, width)
        parent, here = chosen // edges, node[chosen]
        trace = _Trace(
            trace.parent.at[step].set(parent),
            trace.node.at[step].set(here),
            trace.ended.at[step - 1].set(ended),
        )
        beam = _Beam(
            here=here,
            time=time.reshape(-1)[chosen],
            worth=gained.reshape(-1)[chosen],
            visited=beam.visited[parent].at[width_index, here].set(True),
            mark=mark[chosen],
            alive=best > -jnp.inf,
            used=jax.tree.map(lambda part: part.reshape(-1, part.shape[-1])[chosen], then),
        )
        return beam, trace, step + 1

    start = jnp.asarray(problem.start, jnp.int32)
    first = _Beam(
        here=jnp.full(width, start),
        time=jnp.zeros(width, problem.leg_times.dtype),
        worth=jnp.zeros(width, gain.dtype),
        visited=jnp.broadcast_to(jnp.arange(size) == start, (width, size)),
        mark=jnp.broadcast_to(codes[start], (width,)),
        alive=(width_index == 0) & (problem.start != problem.goal),
        used=Used.nothing(problem, width),
    )
    trace = _Trace(
        jnp.zeros((size, width), jnp.int32),
        jnp.full((size, width), start),
        jnp.full((size, width), -jnp.inf, gain.dtype),
    )
    _, trace, _ = jax.lax.while_loop(
        lambda state: state[0].alive.any() & (state[2] <= size), grow, (first, trace, jnp.int32(1))
    )
    gains, best = jax.lax.top_k(trace.ended.reshape(-1), count)
    return _follow_back(trace, best // width, best % width, problem.goal), gains


def _follow_back(trace: _Trace, step: jax.Array, row: jax.Array, goal: jax.Array) -> jax.Array:
    """Routes [Q, N] that end at the goal right after place `row` [Q] of step `step` [Q]."""
    size = trace.node.shape[0]
    routes = jnp.arange(step.shape[0])
    nodes = jnp.full((step.shape[0], size), -1, jnp.int32).at[routes, step + 1].set(goal, mode="drop")

    def back(k: jax.Array, state: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        nodes, row = state
        at = size - 1 - k
        inside = at <= step
        nodes = nodes.at[:, at].set(jnp.where(inside, trace.node[at, row], nodes[:, at]))
        return nodes, jnp.where(inside, trace.parent[at, row], row)

    return jax.lax.fori_loop(0, size, back, (nodes, row))[0]


def seed_routes(
    problem: Problem, gain: jax.Array, known: jax.Array, width: int, places: int, count: int
) -> tuple[jax.Array, jax.Array]:
    """Routes from one beam for each of `PRICES`, without repeats; by the clock from beams that look ahead.

    Args:
        problem: of N waypoints, neighbour lists of length K.
        gain: [N, K] what taking an edge is worth.
        known: total gain of a route known beforehand; it sets the scale of the first price.
        width, places, count: as in `beam_search`.

    Returns:
        ``(nodes [Q, N], gain [Q])``, best first, as in `beam_search`.
    """

    def search(best: jax.Array, factor: jax.Array) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        price = factor * jnp.maximum(best, 0.0) / problem.time_available
        nodes, gains = beam_search(problem, gain, price, width, places, count)
        return jnp.maximum(best, gains[0]), (nodes, gains)

    def search_ahead(state: tuple[jax.Array, jax.Array], stage: tuple[jax.Array, jax.Array]) -> tuple:
        (best, charge), (trust, steps) = state, stage
        charge = sharpened(problem, gain, edges, charge, best, steps)
        outlook, _ = look_ahead(problem, gain, edges, charge)
        price = jnp.maximum(1.0 - trust, LEAST_SHARE) * jnp.maximum(best, 0.0) / problem.time_available
        nodes, gains = beam_search(problem, gain, price, width, places, count, outlook.weighed(trust))
        return (jnp.maximum(best, gains[0]), charge), (nodes, gains)

    if problem.schedule is None:
        _, (nodes, gains) = jax.lax.scan(search, known, jnp.asarray(PRICES))
    else:
        edges = onward_edges(problem)
        stages = (
            (jnp.arange(LED + 1) < LED).astype(gain.dtype),
            DECAY ** jnp.arange((LED + 1) * STEPS).reshape(-1, STEPS),
        )
        begin = known, jnp.zeros(problem.size, gain.dtype)
        _, (nodes, gains) = jax.lax.scan(search_ahead, begin, stages)
    nodes, gains = nodes.reshape(-1, problem.size), gains.reshape(-1)
    earlier = jnp.tril(jnp.ones((len(gains), len(gains)), bool), -1)
    same = (nodes[:, None, :] == nodes[None, :, :]).all(axis=2)
    gains = jnp.where((same & earlier).any(axis=1), -jnp.inf, gains)
    best, chosen = jax.lax.top_k(gains, count)
    return nodes[chosen], best
