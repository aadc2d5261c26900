"""A mission on one graph as the compiled planner sees it: neighbour lists and shortest paths to the goal.

Row i of a neighbour list holds the K waypoints to which an edge leads from i, so that a sparse graph of N
waypoints costs N K instead of N N. Rows are padded with waypoint 0 and infinite times.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np

from auvplan.mission.timetable import Schedule, Timetable, latest_entries


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class EdgeEnergy:
    """What edges take from the battery, by neighbour lists.

    Attributes:
        least: [..., N, K] J, of each edge with its task in its least time.
        power: [..., N, K] W, of each second that it takes longer.
        waiting: [..., N, M] W, of waiting at each waypoint, by the departures of a schedule; None where that
            takes `power` as well.
    """

    least: Any
    power: Any
    waiting: Any = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Edges:
    """The edges of a graph as neighbour lists; graphs of one size are stacked along leading axes.

    Attributes:
        neighbours: [..., N, K] int32, waypoints in rising order.
        leg_times: [..., N, K] s, t_ij; infinite where the list is padded.
        priority: [..., N, K] rho_ij.
        schedule: what depends on the time at which edges are entered; None where nothing does. Leg times are
            then the least.
        energy: where it is limited; None elsewhere.
        levels: the same edges at L speeds each, along one more axis before N, from least energy to least
            time; None where their speeds are given. Of the edges themselves the times are the least then.
    """

    neighbours: Any
    leg_times: Any
    priority: Any
    schedule: Schedule | None = None
    energy: EdgeEnergy | None = None
    levels: "Edges | None" = None

    @classmethod
    def of(
        cls,
        leg_times: np.ndarray,
        priority: np.ndarray,
        least: int = 16,
        timetable: Timetable | None = None,
        duration: np.ndarray | None = None,
    ) -> "Edges":
        """Gather the finite entries of [..., N, N] leg times (NumPy) and their priorities.

        The lists get a power of two of places (at most N), no fewer than `least`: a graph that loses edges
        keeps its compiled programs. A timetable needs the `duration` [..., N, N] s of tasks.
        """
        size = leg_times.shape[-1]
        finite = np.isfinite(leg_times)
        longest = max(int(finite.sum(axis=-1).max()), least)
        width = min(size, 1 << (longest - 1).bit_length())
        neighbours = np.argsort(~finite, axis=-1, kind="stable")[..., :width]
        used = np.take_along_axis(finite, neighbours, axis=-1)
        schedule = None
        if timetable is not None:
            if duration is None:
                raise ValueError("a timetable needs the duration of the tasks")
            schedule = Schedule.of(timetable, duration, neighbours, used)
        return cls(
            np.where(used, neighbours, 0).astype(np.int32),
            np.where(used, np.take_along_axis(leg_times, neighbours, axis=-1), np.inf).astype(np.float32),
            np.where(used, np.take_along_axis(priority, neighbours, axis=-1), 0.0).astype(np.float32),
            schedule,
        )

    def on_levels(
        self,
        leg_times: np.ndarray,
        power: np.ndarray,
        energies: np.ndarray,
        duration: np.ndarray,
        timetable: Timetable | None,
        waiting: np.ndarray | None = None,
    ) -> "Edges":
        """Return the edges with L levels of speeds, of the same waypoints.

        Args:
            leg_times: [..., L, N, N] s.
            power: [..., L, N, N] W.
            energies: [..., L, N, N] J.
            duration: [..., N, N] s, of tasks.
            timetable: of levels, with axes [..., L] before its own.
            waiting: [..., M, N] W, of waiting at each waypoint, by its departures; None for `power`.
        """
        lead = leg_times.shape[:-2]

        def spread(values: np.ndarray) -> np.ndarray:
            return np.broadcast_to(values[..., None, :, :], (*lead, *values.shape[-2:]))

        neighbours, used = spread(self.neighbours), spread(np.isfinite(self.leg_times))

        def gathered(values: np.ndarray, padding: float) -> np.ndarray:
            found = np.take_along_axis(values, neighbours, axis=-1)
            return np.where(used, found, padding).astype(np.float32)

        schedule = None
        if timetable is not None:
            schedule = Schedule.of(timetable, spread(duration), neighbours, used, waiting is not None)
        if waiting is not None:
            waiting = spread(np.swapaxes(waiting, -1, -2)).astype(np.float32)
        levels = Edges(
            neighbours,
            gathered(leg_times, np.inf),
            spread(self.priority),
            schedule,
            EdgeEnergy(gathered(energies, np.inf), gathered(power, 0.0), waiting),
        )
        return replace(self, levels=levels)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Problem:
    """A mission on one graph, prepared for decoding.

    Attributes:
        neighbours: [N, K] int32.
        leg_times: [N, K] s, t_ij; infinite off the edges, into the start and into visited waypoints. With a
            schedule the least that each edge takes at any time.
        priority: [N, K] rho_ij; zero where there is no task.
        rate: [N, K] rho_ij / t_ij over its mean on the edges that carry a task.
        latest: [N, K] s, the mission time before which an edge must be entered.
        return_time: [N] s, time to the goal that is kept in reserve, `time_to_go` and the return margin.
        deadline: s, T_available less the rounding error that a sum of N legs can have.
        time_to_go: [N] s, shortest time to the goal.
        following: [N] the next waypoint on the shortest path to the goal.
        start, goal: indices.
        time_available: s, T_available.
        least_difference: by how much the total priorities of two routes differ at least, if they do.
        schedule: what depends on the time at which edges are entered; None where nothing does.
        energy: of the edges where it is limited; None elsewhere, as the next two.
        spare: [N, K] J, the most that may have been spent when an edge is entered.
        return_energy: [N] J that the way to the goal takes, with the return margin.
        energy_available: J.
        levels: the same mission with the speeds of each of L levels, along a leading axis; a route is
            feasible where it is on one of them. None where speeds are given.
    """

    neighbours: jax.Array
    leg_times: jax.Array
    priority: jax.Array
    rate: jax.Array
    latest: jax.Array
    return_time: jax.Array
    deadline: jax.Array
    time_to_go: jax.Array
    following: jax.Array
    start: jax.Array
    goal: jax.Array
    time_available: jax.Array
    least_difference: jax.Array
    schedule: Schedule | None = None
    energy: EdgeEnergy | None = None
    spare: jax.Array | None = None
    return_energy: jax.Array | None = None
    energy_available: jax.Array | None = None
    levels: "Problem | None" = None

    @property
    def size(self) -> int:
        """Number of waypoints N."""
        return self.neighbours.shape[0]

    def onward_times(self, here: jax.Array, time: jax.Array) -> jax.Array:
        """Return the seconds [..., K] that the edges from waypoints `here` [...] take at times [...]."""
        if self.schedule is None:
            return self.leg_times[here]
        edge = jnp.arange(self.neighbours.shape[1], dtype=jnp.int32)
        lasts = self.schedule.lasts(here[..., None], edge, time[..., None])
        return jnp.where(jnp.isfinite(self.leg_times[here]), lasts, jnp.inf)

    def energy_of(self, here: jax.Array, edge: Any, time: jax.Array, lasts: jax.Array) -> jax.Array:
        """Return J that edges take, by place in lists, where they are entered at times and last as many s."""
        assert self.energy is not None
        least, power, waiting = self.energy.least[here, edge], self.energy.power, self.energy.waiting
        if self.schedule is None:
            return least
        if waiting is None:
            more = jnp.where(jnp.isfinite(lasts), lasts - self.leg_times[here, edge], jnp.inf)
            return least + power[here, edge] * jnp.maximum(more, 0.0)
        held, travel, waits = self.schedule.stages(here, edge, time)
        longer = travel - (self.leg_times - self.schedule.duration)[here, edge]
        before = held * self.schedule.at(waiting, here, time)
        after = waits * self.schedule.at(waiting, self.neighbours[here, edge], time + held + travel)
        spent = least + power[here, edge] * jnp.maximum(longer, 0.0) + before + after
        return jnp.where(jnp.isfinite(lasts), spent, jnp.inf)

    @property
    def energies(self) -> tuple[jax.Array, jax.Array]:
        """[N, K] J that edges take on the level of least energy, and J that are available."""
        assert self.levels is not None
        assert self.levels.energy is not None
        assert self.levels.energy_available is not None
        return self.levels.energy.least[0], self.levels.energy_available[0]

    def entered(self, here: jax.Array, used: "Used") -> "Used":
        """Return what is used [..., K] after each edge from waypoints `here` [...], on one level."""
        edge = jnp.arange(self.neighbours.shape[1], dtype=jnp.int32)
        lasts, time = self.onward_times(here, used.times), used.times[..., None]
        spent = used.energies[..., None] + self.energy_of(here[..., None], edge, time, lasts)
        assert self.spare is not None
        fits = (used.times[..., None] < self.latest[here]) & (used.energies[..., None] <= self.spare[here])
        times = used.times[..., None] + lasts
        return Used(jnp.where(fits, times, jnp.inf), jnp.where(fits, spent, jnp.inf))

    def onward(
        self, here: jax.Array, time: jax.Array, used: "Used | None"
    ) -> tuple[jax.Array, "Used | None"]:
        """Return s [..., K] that the edges from waypoints `here` [...] take at times [...], and what is used.

        On levels that is what is used [..., K, L] after each, and s are those of the quickest that fits.
        """
        if self.levels is None or used is None:
            return self.onward_times(here, time), None
        then = jax.vmap(Problem.entered, (0, None, -1), -1)(self.levels, here, used)
        return then.times.min(axis=-1) - time[..., None], then

    @property
    def varies(self) -> bool:
        """Whether the time that an edge takes depends on the route that leads to it."""
        return self.schedule is not None or self.levels is not None

    def on_level(self, level: jax.Array) -> "Problem":
        """Return the mission with the speeds of one level."""
        return jax.tree.map(lambda leaf: leaf[level], self.levels)

    @property
    def falling(self) -> bool:
        """Whether priorities fall at some moments."""
        return self.schedule is not None and self.schedule.drops.shape[-1] > 0

    def lost(self, here: jax.Array, edge: jax.Array, time: jax.Array, lasts: jax.Array) -> jax.Array:
        """Return by how much the priorities of tasks have fallen then; edges by place in lists."""
        assert self.schedule is not None
        begins = time + lasts - self.schedule.duration[here, edge]
        return self.schedule.lost(here, edge, begins)


class Used(NamedTuple):
    """What routes have used so far, on each of L levels; infinite where a limit is broken.

    Attributes:
        times: [..., L] s.
        energies: [..., L] J.
    """

    times: jax.Array
    energies: jax.Array

    @classmethod
    def nothing(cls, problem: Problem, count: int) -> "Used | None":
        """Return what `count` routes have used at the start; None where speeds are given."""
        if problem.levels is None:
            return None
        zero = jnp.zeros((count, len(problem.levels.goal)), problem.leg_times.dtype)
        return cls(zero, zero)

    def share(self, problem: Problem) -> jax.Array:
        """Return the share [...] of the scarcer of time and energy that is used on the best level."""
        return self.shares(problem).min(axis=-1)

    def shares(self, problem: Problem) -> jax.Array:
        """Return the share [..., L] of the scarcer of time and energy that is used on each level."""
        return jnp.maximum(self.times / problem.time_available, self.energies / problem.energies[1])


def highest(values: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Highest value of each row [P, M] and the first place where it stands, both [P].

    Two plain reductions run twice as fast on a CPU as argmax.
    """
    last = values.shape[1] - 1
    best = values.max(axis=1)
    place = jnp.where(values == best[:, None], jnp.arange(last + 1, dtype=jnp.int32), last)
    return best, place.min(axis=1)


def rounding_margin(size: int, dtype: Any = jnp.float32) -> float:
    """Relative error that bounds the sum of `size` leg times, forwards and as time to go."""
    return size * float(jnp.finfo(dtype).eps)


def prepare(
    edges: Edges,
    start: jax.Array,
    goal: jax.Array,
    time_available: jax.Array,
    visited: jax.Array,
    return_margin: jax.typing.ArrayLike = 0.0,
    energy_available: jax.typing.ArrayLike | None = None,
    least_difference: jax.typing.ArrayLike = np.inf,
) -> Problem:
    """Work out what all routes on a graph have in common.

    An edge from i to j must be entered so early that t_ij and the shortest time from j to the goal,
    lengthened by the return margin, still fit. The shortest time ignores which waypoints a route has
    visited.

    Args:
        edges: of one graph.
        start, goal: indices, may be traced.
        time_available: T_available, s; less the rounding error that a sum of N legs can have it is the
            deadline of all routes.
        visited: [N] bool, waypoints not to be visited again.
        return_margin: share by which the path to the goal is taken to last longer than expected, and to take
            more energy.
        energy_available: J; for edges that have their energy.
        least_difference: in total priority, as `auvplan.mission.bound.least_difference` has it; infinite
            where it is not known.
    """
    neighbours = edges.neighbours
    size = neighbours.shape[0]
    chex.assert_equal_shape([neighbours, edges.leg_times, edges.priority])
    closed = visited | (jnp.arange(size) == start)
    leg_times = jnp.where(closed[neighbours], jnp.inf, edges.leg_times)
    priority = jnp.where(jnp.isfinite(leg_times), edges.priority, 0.0)
    # A floor of one second keeps the rate of a leg that takes no time from drowning all others.
    rate = priority / jnp.maximum(leg_times, 1.0)
    mean = rate.sum() / jnp.maximum((rate > 0.0).sum(), 1)
    time, following = shortest_routes(neighbours, leg_times, goal)
    deadline = time_available * (1.0 - rounding_margin(size, leg_times.dtype))
    return_time = (1.0 + jnp.asarray(return_margin, leg_times.dtype)) * time
    latest = deadline - (leg_times + return_time[neighbours])
    if edges.schedule is not None:
        margin = jnp.asarray(return_margin, leg_times.dtype)
        shut = ~jnp.isfinite(leg_times)
        latest, due, following = latest_entries(edges.schedule, neighbours, shut, goal, deadline, margin)
        return_time = (1.0 + margin) * (deadline - due)
    limits: dict[str, Any] = {}
    if edges.energy is not None and energy_available is not None:
        least = jnp.where(jnp.isfinite(leg_times), edges.energy.least, jnp.inf)
        to_go, _ = shortest_routes(neighbours, least, goal)
        back = (1.0 + jnp.asarray(return_margin, leg_times.dtype)) * to_go
        most = jnp.asarray(energy_available, leg_times.dtype) * (1.0 - rounding_margin(size, leg_times.dtype))
        limits = {
            "energy": replace(edges.energy, least=least),
            "spare": most - (least + back[neighbours]),
            "return_energy": back,
            "energy_available": most,
        }
    if edges.levels is not None:
        given = start, goal, time_available, visited, return_margin, energy_available
        limits["levels"] = jax.vmap(lambda level: prepare(level, *given))(edges.levels)
    return Problem(
        neighbours=neighbours,
        leg_times=leg_times,
        priority=priority,
        rate=rate / jnp.where(mean > 0.0, mean, 1.0),
        latest=latest,
        return_time=return_time,
        deadline=deadline,
        time_to_go=time,
        following=following,
        start=start,
        goal=goal,
        time_available=time_available,
        least_difference=jnp.asarray(least_difference, leg_times.dtype),
        schedule=edges.schedule,
        **limits,
    )


def shortest_routes(
    neighbours: jax.Array, leg_times: jax.Array, goal: jax.typing.ArrayLike
) -> tuple[jax.Array, jax.Array]:
    """Shortest time to the goal from each waypoint, and the waypoint to take next.

    Min-plus relaxation until nothing improves. The next waypoint changes only on strict improvement, which
    keeps the routes free of cycles even where legs take no time.

    Args:
        neighbours: [N, K] int32.
        leg_times: [N, K] s, infinite off the edges.
        goal: index, may be traced.

    Returns:
        ``(time [N] s, next [N] int32)``; infinite, and the waypoint itself, where the goal is out of reach.
    """
    index = jnp.arange(neighbours.shape[0], dtype=jnp.int32)
    at_goal = jnp.where(index == goal, 0.0, jnp.inf).astype(leg_times.dtype)

    def relax(state: tuple[jax.Array, jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array, jax.Array]:
        time, following, _ = state
        through = leg_times + time[neighbours]
        shortest = through.min(axis=1)
        better = shortest < time
        step = neighbours[index, jnp.argmin(through, axis=1)]
        return jnp.where(better, shortest, time), jnp.where(better, step, following), better.any()

    time, following, _ = jax.lax.while_loop(lambda state: state[2], relax, (at_goal, index, jnp.array(True)))
    return time, following
