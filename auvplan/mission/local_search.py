"""Local search on routes of waypoints: each route takes the best of all small changes, round by round.

A change cuts out up to `CUT` waypoints that follow each other and puts one other waypoint, or none, in their
place. That covers insertion, removal and replacement.

Where travel times depend on the clock a change is judged by the times of its own legs and by how much
later the rest may begin if its legs take as long as before (forward time slack, Savelsbergh 1992); the
changed route is then gone through, and dropped where it does not fit.

Where energy is limited and speeds are free, each round keeps to the level of speeds on which a route leaves
most of the scarcer of time and energy.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from auvplan.mission.problem import Problem, Used, highest

#: Waypoints that one change may cut out.
CUT = 2


def improve(nodes: jax.Array, problem: Problem, gain: jax.Array, rounds: int) -> jax.Array:
    """Apply the best change to every route, `rounds` times.

    Args:
        nodes: [P, N] routes from the start to the goal, padded with -1.
        problem: what they are routes of.
        gain: [N, K] what taking an edge is worth, as in `auvplan.mission.beam`.
        rounds: number of changes to each route at most.

    Returns:
        [P, N] routes that keep all limits and gain at least as much.
    """
    if problem.levels is None:
        edges = _Edges.of(problem, gain)
        return jax.lax.fori_loop(0, rounds, lambda _, routes: _change_all(routes, edges), nodes)

    def change(_: int, routes: jax.Array) -> jax.Array:
        best = _best_levels(problem, routes)
        one = jax.vmap(
            lambda route, level: _change_all(route[None], _Edges.of(problem.on_level(level), gain))
        )
        return one(routes, best)[:, 0]

    return jax.lax.fori_loop(0, rounds, change, nodes)


def _best_levels(problem: Problem, nodes: jax.Array) -> jax.Array:
    """Return the level [P] on which routes leave most of the scarcer of time and energy."""
    number = jnp.broadcast_to(
        jnp.arange(problem.neighbours.shape[1], dtype=jnp.int32), problem.neighbours.shape
    )
    places, rows = _table(problem, number, 0), jnp.arange(len(nodes))

    def go(used: Used, leg: tuple[jax.Array, jax.Array]) -> tuple[Used, None]:
        here, there = leg
        (_, then), edge = (
            problem.onward(jnp.maximum(here, 0), used.times.min(axis=-1), used),
            places[here, there],
        )
        return jax.tree.map(
            lambda new, old: jnp.where((there >= 0)[:, None], new[rows, edge], old), then, used
        ), None

    nothing = Used.nothing(problem, len(nodes))
    assert nothing is not None
    used, _ = jax.lax.scan(go, nothing, (nodes[:, :-1].T, nodes[:, 1:].T))
    return used.shares(problem).argmin(axis=1)


def _table(problem: Problem, values: jax.Array, default: float) -> jax.Array:
    """Return values of the edges [N, K] as a table [N, N]."""
    size = problem.size
    rows = jnp.arange(size)[:, None]
    column = jnp.where(jnp.isfinite(problem.leg_times), problem.neighbours, size)
    return jnp.full((size, size), default, values.dtype).at[rows, column].set(values, mode="drop")


class _Edges(NamedTuple):
    """Edges of a problem by their two waypoints.

    Attributes:
        problem: of N waypoints, neighbour lists of length K.
        gain: [N, K] what taking an edge is worth.
        times, gains: [N, N] s and worth; infinite and zero where there is no edge.
        places: [N, N] in their lists, K where there is no edge; None where nothing depends on the clock.
        energies: [N, N] J in the least times; None where energy is not limited.
    """

    problem: Problem
    gain: jax.Array
    times: jax.Array
    gains: jax.Array
    places: jax.Array | None
    energies: jax.Array | None = None

    @classmethod
    def of(cls, problem: Problem, gain: jax.Array) -> "_Edges":
        """Return the edges of a problem on one level, worth `gain` [N, K]."""
        places, width = None, problem.neighbours.shape[1]
        times, gains = _table(problem, problem.leg_times, jnp.inf), _table(problem, gain, 0.0)
        if problem.schedule is not None:
            number = jnp.broadcast_to(jnp.arange(width, dtype=jnp.int32), problem.neighbours.shape)
            places = _table(problem, number, width)
        if problem.energy is None:
            return cls(problem, gain, times, gains, places)
        return cls(problem, gain, times, gains, places, _table(problem, problem.energy.least, jnp.inf))

    def energy(self, here: jax.Array, there: jax.Array, at: jax.Array, lasts: jax.Array) -> jax.Array:
        """Return J that edges take where they are entered at times and last as many s, all of one shape.

        None where energy is not limited.
        """
        if self.energies is None:
            return jnp.zeros_like(lasts)
        if self.places is None:
            return self.energies[here, there]
        place, width = self.places[here, there], self.problem.neighbours.shape[1]
        spent = self.problem.energy_of(here, jnp.minimum(place, width - 1), at, lasts)
        return jnp.where(place < width, spent, jnp.inf)

    def lasts(self, here: jax.Array, there: jax.Array, at: jax.Array) -> jax.Array:
        """Return the seconds that edges take where they are entered at times, all of one shape."""
        schedule, width = self.problem.schedule, self.problem.neighbours.shape[1]
        if schedule is None or self.places is None:
            return self.times[here, there]
        place = self.places[here, there]
        lasts = schedule.lasts(here, jnp.minimum(place, width - 1), at)
        return jnp.where(place < width, lasts, jnp.inf)

    def less_lost(self, worth: Any, here: Any, there: Any, at: Any, lasts: Any) -> jax.Array:
        """Return what edges are worth less what their tasks have lost; arguments as `lasts` has them."""
        if not self.problem.falling or self.places is None:
            return worth
        place = jnp.minimum(self.places[here, there], self.problem.neighbours.shape[1] - 1)
        return worth - self.problem.lost(here, place, at, lasts)


def _by_the_clock(
    problem: Problem, nodes: jax.Array, places: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """When routes [P, N] are done at each place, and by how much each arrival may be delayed, both [P, N] s.

    The times are infinite from the first leg on that cannot be done. The third answer is the priority that is
    lost up to each place because it falls, [P, N].
    """
    schedule, width = problem.schedule, problem.neighbours.shape[1]
    assert schedule is not None
    here, onward = jnp.maximum(nodes[:, :-1], 0), jnp.maximum(nodes[:, 1:], 0)
    inside, place = nodes[:, 1:] >= 0, places[here, onward]
    edge = jnp.minimum(place, width - 1)

    def go(time: jax.Array, leg: tuple) -> tuple[jax.Array, tuple[jax.Array, ...]]:
        node, edge, taken = leg
        arrives, begins = schedule.begins(node, edge, time)
        done = jnp.where(taken, begins + schedule.duration[node, edge], time)
        closes = schedule.closes[node, edge]
        # The window in which the task begins is the first that serves: it may begin there until it closes.
        open_ = (closes >= begins[:, None]) & (schedule.opens[node, edge] <= begins[:, None])
        last = jnp.where(open_, closes, -jnp.inf).max(axis=1, initial=-jnp.inf)
        last = last if closes.shape[-1] else jnp.full_like(begins, jnp.inf)
        wait, spare = jnp.where(taken, begins - arrives, 0.0), jnp.where(taken, last - begins, jnp.inf)
        if schedule.enters.shape[-1]:
            enters, until = schedule.enters[node, edge], schedule.until[node, edge]
            ends = arrives + schedule.duration[node, edge]
            served = (enters <= arrives[:, None]) & (until >= ends[:, None])
            early = jnp.where(served, enters, -jnp.inf).max(axis=1)
            wait = wait + jnp.where(taken, jnp.maximum(early - time, 0.0), 0.0)
            late = jnp.where(served, until, -jnp.inf).max(axis=1) - ends
            spare = jnp.where(taken, jnp.minimum(spare, late), spare)
        lost = jnp.zeros_like(begins)
        if problem.falling:
            lost = jnp.where(taken, schedule.lost(node, edge, begins), 0.0)
        return done, (done, wait, spare, lost)

    zero = jnp.zeros(len(nodes), schedule.duration.dtype)
    legs = here.T, edge.T, inside.T & (width > place.T)
    _, (done, wait, spare, lost) = jax.lax.scan(go, zero, legs)
    arrival = jnp.concatenate([zero[None], done]).T
    lost = jnp.concatenate([zero[None], jnp.cumsum(lost, axis=0)]).T
    at = jnp.maximum(nodes, 0)
    room = jnp.where(nodes >= 0, problem.deadline - problem.return_time[at] - arrival, jnp.inf)

    def back(later: jax.Array, place: tuple) -> tuple[jax.Array, jax.Array]:
        room, wait, spare = place
        here = jnp.minimum(room, later)
        return wait + jnp.minimum(spare, here), here

    waits, spares = (
        jnp.concatenate([jnp.full((1, len(nodes)), first), part])
        for first, part in ((0.0, wait), (jnp.inf, spare))
    )
    _, slack = jax.lax.scan(back, jnp.full(len(nodes), jnp.inf), (room.T, waits, spares), reverse=True)
    return arrival, slack.T, lost


def _energies(nodes: jax.Array, arrival: jax.Array, edges: _Edges) -> tuple[jax.Array, jax.Array]:
    """J that routes [P, N] have spent at each place, and by how much more each may be, both [P, N]."""
    problem = edges.problem
    assert problem.energy_available is not None
    assert problem.return_energy is not None
    here, onward = jnp.maximum(nodes[:, :-1], 0), jnp.maximum(nodes[:, 1:], 0)
    spent = edges.energy(here, onward, arrival[:, :-1], jnp.diff(arrival, axis=1))
    legs = jnp.where(nodes[:, 1:] >= 0, spent, 0.0)
    spent = jnp.concatenate([jnp.zeros((len(nodes), 1)), jnp.cumsum(legs, axis=1)], axis=1)
    spare = problem.energy_available - problem.return_energy[jnp.maximum(nodes, 0)] - spent
    return spent, jax.lax.cummin(jnp.where(nodes >= 0, spare, jnp.inf), axis=1, reverse=True)


def _change_all(nodes: jax.Array, edges: _Edges) -> jax.Array:
    """One best change to each route."""
    problem, gain, times, gains, places = edges[:5]
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
    due = problem.deadline - problem.return_time[at]
    slack = jnp.where(inside, due - arrival, jnp.inf)
    slack = jax.lax.cummin(slack, axis=1, reverse=True)
    if places is not None:
        arrival, slack, lost = _by_the_clock(problem, nodes, places)
        gained = gained - lost if problem.falling else gained
    limited = problem.energy is not None
    spent, spare = _energies(nodes, arrival, edges) if limited else (arrival, slack)

    via = problem.neighbours[at]
    open_ = (
        inside[:, :, None] & ~visited[rows[:, None, None], via] & (arrival[:, :, None] < problem.latest[at])
    )
    if problem.spare is not None:
        open_ &= spent[:, :, None] <= problem.spare[at]
    onward_times = problem.onward_times(at, arrival)
    then = arrival[:, :, None] + onward_times
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
        second = edges.lasts(via, there[:, :, None], then)
        longer = onward_times + second - old_time[:, :, None]
        richer = gain[at] + gains[via, there[:, :, None]] - old_gain[:, :, None]
        if problem.falling and places is not None:
            edge = jnp.arange(via.shape[2])[None, None]
            richer = richer - problem.lost(at[:, :, None], edge, arrival[:, :, None], onward_times)
            richer = edges.less_lost(richer, via, there[:, :, None], then, second)
        fitting = open_ & fits[:, :, None] & (longer < room[:, :, None])
        if limited:
            more = edges.energy(at[:, :, None], via, arrival[:, :, None], onward_times)
            more += edges.energy(via, there[:, :, None], then, second)
            fitting &= more <= (spare[:, ahead] + spent[:, ahead] - spent)[:, :, None]
        worth = jnp.where(fitting, richer, -jnp.inf)
        value, index = highest(worth.reshape(count, -1))
        place, edge = index // via.shape[2], index % via.shape[2]
        best, choice = consider(best, choice, value, place, cut, via[rows, place, edge])
        if cut:
            direct = edges.lasts(at, there, arrival)
            longer, richer = direct - old_time, gains[at, there] - old_gain
            richer = edges.less_lost(richer, at, there, arrival, direct)
            fitting = inside & fits & (longer < room)
            if limited:
                direct_energy = edges.energy(at, there, arrival, direct)
                fitting &= direct_energy <= spare[:, ahead] + spent[:, ahead] - spent
            worth = jnp.where(fitting, richer, -jnp.inf)
            best, choice = consider(best, choice, *highest(worth), cut, jnp.full(count, -1))

    place, cut, node = (value[:, None] for value in choice)
    column = jnp.arange(size)
    source = column - (node >= 0) + cut
    moved = jnp.where(source < size, jnp.take_along_axis(nodes, jnp.clip(source, 0, size - 1), axis=1), -1)
    changed = jnp.where(column <= place, nodes, jnp.where((column == place + 1) & (node >= 0), node, moved))
    better = best > 1e-6
    if places is not None:
        arrival, slack, lost = _by_the_clock(problem, changed, places)
        better &= slack[:, 0] >= 0.0
        if limited:
            better &= _energies(changed, arrival, edges)[1][:, 0] >= 0.0
        if problem.falling:
            i, j = jnp.maximum(changed[:, :-1], 0), jnp.maximum(changed[:, 1:], 0)
            whole = jnp.where(changed[:, 1:] >= 0, gains[i, j], 0.0).sum(axis=1) - lost[:, -1]
            better &= whole > gained[:, -1] + 1e-6
    return jnp.where(better[:, None], changed, nodes)
