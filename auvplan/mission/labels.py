"""The route of most total priority by the clock, with its proof: labels of dynamic programming.

A label is a waypoint, the set of waypoints visited, a time and what has been gained. What can still be gained
is bounded by routes that may wait and repeat waypoints, though not turn straight back, each visit charged
with a Lagrange multiplier of the rule that none is repeated (Righini and Salani 2009). Where the vehicle may
wait no later label gains more: it is dropped. Where it may not, only labels of the same time are compared:
a later arrival may be in time for what an earlier one comes too early for. A label whose bound does not beat
the best route known is dropped in either case.
"""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from auvplan.mission.bound import Array, IntArray, common_step
from auvplan.mission.timetable import Schedule, Timetable

#: Moments at which the bound is known, at least and at most.
_MOMENTS = 128, 2000
#: Subgradient steps at most, and those in a row without a better bound after which they are halved.
_ROUNDS, _PATIENCE = 60, 4
#: Labels of one number of waypoints at most, in a proof and beside a search.
_MOST, _FEW = 1_000_000, 20_000
_TOLERANCE = 1e-9
#: Halvings that find the last moment at which an edge may be entered.
_HALVINGS = 40


@dataclass(frozen=True)
class Clocked:
    """A mission by the clock in double precision.

    Attributes:
        timetable: of N waypoints.
        duration: [N, N] s, of tasks.
        priority: [N, N], before it falls.
        open: [N, N] bool, edges that may be taken.
        start, goal: indices.
        end: s; a route takes less.
        return_margin: share by which the path to the goal is taken to last longer than expected.
    """

    timetable: Timetable
    duration: Array
    priority: Array
    open: NDArray[np.bool_]
    start: int
    goal: int
    end: float
    return_margin: float = 0.0
    exact: ClassVar[bool] = False

    @property
    def waiting(self) -> "Clocked":
        """The same mission of a vehicle that may wait: what it can do at the best."""
        return replace(self, timetable=replace(self.timetable, waiting=True))

    def done(self, i: IntArray, j: IntArray, since: Array) -> tuple[Array, Array]:
        """When tasks are done, s, of edges entered at finite times, or later by waiting, and their worth."""
        with np.errstate(invalid="ignore"):  # of edges that are shut
            _, begins = self._schedule.begins(i, j, since)
        worth = np.broadcast_to(self.priority[i, j], begins.shape)
        for k in range(self.timetable.drops.shape[-1]):
            fallen = begins > self.timetable.falls[i, j, k]
            worth = worth - np.where(fallen, self.timetable.drops[i, j, k], 0.0)
        return np.where(self.open[i, j], begins + self.duration[i, j], np.inf), worth

    def along(self, route: list[int]) -> tuple[Array, Array]:
        """Return s and priority [N, N] of legs, as they are from where a route leaves their waypoints.

        Those off the route are left when half of it is gone, and no window is waited for. Legs that are
        closed then, and open at other times, last as long as they do at best.
        """
        now, leaves = np.zeros(1), np.full(len(self.open), np.nan)
        for here, there in pairwise(route):
            leaves[here] = now.item()
            now, _ = self.done(np.asarray([here]), np.asarray([there]), now)
        leaves = np.where(np.isfinite(leaves), leaves, 0.5 * now)[:, None]
        node = np.arange(len(self.open))
        done, _ = self._unbound.done(node[:, None], node, np.broadcast_to(leaves, self.open.shape))
        lasts = done - leaves
        return np.where(np.isfinite(lasts), lasts, self._least), self.priority

    def walk(self, routes: IntArray) -> tuple[Array, Array]:
        """Return when routes [C, n] end, s, and their priority [C]; infinite where they do not fit.

        They may be padded with their goal.
        """
        now, worth = np.zeros((2, len(routes)))
        for here, there in pairwise(routes.T):
            fits, ended = np.isfinite(now), here == there
            done, gained = self.done(here, there, np.where(fits, now, 0.0))
            then = np.where(fits & (done <= self._due[there]), done, np.inf)
            now, worth = np.where(ended, now, then), worth + np.where(ended, 0.0, gained)
        return np.where(now < self.end, now, np.inf), worth

    @cached_property
    def _due(self) -> Array:
        """[N] s, when waypoints must be left at the latest, with the margin on the way to the goal."""
        size, ahead = len(self.open), self.waiting
        if not self.return_margin:
            return np.full(size, np.inf)
        node, known = np.arange(size), np.full(size, -np.inf)
        due = np.where(node == self.goal, self.end, known)
        while (due > known).any():
            known, low, high = due, np.zeros((size, size)), np.full((size, size), self.end)
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                good = ahead.done(node[:, None], node, middle)[0] <= due
                low, high = np.where(good, middle, low), np.where(good, high, middle)
            due = np.maximum(due, np.where(low > 0.0, low, -np.inf).max(axis=1))
        return self.end - (1.0 + self.return_margin) * (self.end - due)

    @cached_property
    def _least(self) -> Array:
        """[N, N] s that legs last at least, whenever they are entered."""
        return np.where(self.open, self.timetable.travel_time.min(axis=0) + self.duration, np.inf)

    @cached_property
    def _unbound(self) -> "Clocked":
        """The same mission without windows, and with priorities that stay."""
        table = self.waiting.timetable
        return replace(self, timetable=table.without_windows(np.ones_like(self.open)))

    @cached_property
    def _schedule(self) -> Schedule:
        return Schedule.whole(self.timetable, self.duration)


@dataclass(frozen=True)
class Proof:
    """What labels found and proved.

    Attributes:
        nodes: [n] waypoints of a route better than the known one; empty where there is none.
        bound: no route has more total priority.
        proved: whether the search came to its end: then no route is better than the known one and this.
    """

    nodes: IntArray
    bound: float
    proved: bool


@dataclass(frozen=True)
class _Ahead:
    """What routes that may repeat waypoints gain from each waypoint on, less charges, by the moment.

    Attributes:
        best, other: [M + 1, N] the most, and the most by another next waypoint; minus infinity where the goal
            is out of reach, as at the last moment.
        following, instead: [M + 1, N] the next waypoints of both.
    """

    best: Array
    other: Array
    following: IntArray
    instead: IntArray


@dataclass(frozen=True)
class _Grid:
    """Every edge at every moment, of a vehicle that may wait.

    Attributes:
        step: s between moments; times are rounded down, which keeps bounds bounds.
        at: [M, N, N] moment when the task is done; M where it is too late.
        worth: [M, N, N].
        passes: how many legs may lie within one step.
    """

    step: float
    at: IntArray
    worth: Array
    passes: int

    @classmethod
    def of(cls, mission: Clocked, moments: tuple[int, int] = _MOMENTS) -> "_Grid":
        """Look every edge up at as many moments as `moments` allows, least and most."""
        mission, size = mission.waiting, len(mission.open)
        table = mission.timetable
        lasts = np.where(mission.open, table.least + mission.duration, np.inf)
        shortest = max(float(lasts.min()), 1e-3)
        count = int(np.clip(np.ceil(mission.end / shortest), *moments))
        step = mission.end / count
        i, j = np.arange(size)[:, None], np.arange(size)[None]
        at, worth = np.zeros((count, size, size), np.int32), np.zeros((count, size, size), np.float32)
        for moment in range(count):
            done, worth[moment] = mission.done(i, j, np.full((size, size), moment * step))
            late = ~(done < mission.end)
            at[moment] = np.where(late, count, np.where(late, 0.0, done) / step).astype(int)
        at = np.maximum(at, np.arange(count)[:, None, None])
        return cls(step, at, worth, min(int(np.ceil(step / shortest)), size))

    def ahead(self, mission: Clocked, charge: Array) -> _Ahead:
        """Work backwards in time."""
        count, size = self.at.shape[:2]
        nodes = np.arange(size)
        shape = count + 1, size
        found = _Ahead(*np.full((2, *shape), -np.inf), *np.full((2, *shape), -1, np.int32))
        found.best[:count, mission.goal] = 0.0
        free = nodes != mission.goal
        for moment in range(count - 1, -1, -1):
            at = self.at[moment]
            for _ in range(self.passes):
                back = found.following[at, nodes] == nodes[:, None]
                onward = np.where(back, found.other[at, nodes], found.best[at, nodes])
                values = (self.worth[moment] - charge + onward)[free]
                for value, chosen in ((found.best, found.following), (found.other, found.instead)):
                    place = values.argmax(axis=1)
                    chosen[moment, free] = place
                    value[moment, free] = values[np.arange(len(place)), place]
                    values[np.arange(len(place)), place] = -np.inf
        return found


def prove(mission: Clocked, known: float, time_limit: float) -> Proof:
    """Search for a route of more total priority than a known one, until none is left or time, s, is up."""
    stop = time.monotonic() + time_limit
    grid, least = _Grid.of(mission), _least_gain(mission)
    charge, root = _charges(mission, grid, known, least, stop)
    if root < known + least:
        return Proof(np.zeros(0, int), known, proved=True)
    return _labels(mission, grid, charge, known, least, stop, _MOST)


def better(mission: Clocked, known: float) -> Proof:
    """Search as `prove` does, without charges, as far as few labels reach: the same answer on any machine."""
    grid = _Grid.of(mission, (_MOMENTS[0], _MOMENTS[0]))
    return _labels(mission, grid, np.zeros(len(mission.open)), known, _least_gain(mission), np.inf, _FEW)


def _least_gain(mission: Clocked) -> float:
    """By how much the priorities of two routes differ at least, if they do."""
    values = np.concatenate([mission.priority[mission.open], mission.timetable.drops.ravel()])
    return max(common_step(values) * (1.0 - 1e-6), _TOLERANCE)


def _charges(mission: Clocked, grid: _Grid, known: float, least: float, stop: float) -> tuple[Array, float]:
    """Multipliers [N] by subgradient steps, and the least bound that they gave."""
    charge = kept = np.zeros(len(mission.open))
    target, lowest, share, stale = max(known, 0.0), np.inf, 1.0, 0
    for _ in range(_ROUNDS):
        ahead = grid.ahead(mission, charge)
        bound = float(ahead.best[0, mission.start] + charge.sum())
        if not np.isfinite(bound):
            return charge, -np.inf
        if bound < lowest - 1e-6:
            lowest, kept, stale = bound, charge, 0
        else:
            stale += 1
        visits = _visits(mission, grid, ahead)
        slope = np.where((charge == 0.0) & (visits == 0.0), 0.0, visits - 1.0)
        slope[[mission.start, mission.goal]] = 0.0
        if lowest < known + least or not slope.any() or time.monotonic() > stop:
            break
        if stale == _PATIENCE:
            share, stale, charge = 0.5 * share, 0, kept
            continue
        length = share * max(bound - target, least) / (slope @ slope)
        charge = np.maximum(charge + length * slope, 0.0)
    return kept, lowest


def _visits(mission: Clocked, grid: _Grid, ahead: _Ahead) -> Array:
    """How often the best path from the start visits each waypoint, [N]."""
    counts, here, moment, before = np.zeros(len(mission.open)), mission.start, 0, -1
    for _ in range(len(grid.at) + len(counts)):
        if here == mission.goal or moment >= len(grid.at):
            break
        onward = int(ahead.following[moment, here])
        if onward == before:
            onward = int(ahead.instead[moment, here])
        before, moment, here = here, int(grid.at[moment, here, onward]), onward
        counts[here] += 1.0
    return counts


def _labels(
    mission: Clocked, grid: _Grid, charge: Array, known: float, least: float, stop: float, most: int
) -> Proof:
    """Grow routes by one waypoint at a time, until the clock stops or labels are more than `most`."""
    size, goal = len(mission.open), mission.goal
    ahead = grid.ahead(mission, charge)
    due = grid.step * (np.isfinite(ahead.best) * np.arange(1, len(ahead.best) + 1)[:, None]).max(axis=0)
    due = mission.end - (1.0 + mission.return_margin) * np.maximum(mission.end - due, 0.0)
    words = -(-size // 64)
    bits = np.zeros((size, words), np.uint64)
    bits[np.arange(size), np.arange(size) // 64] = np.uint64(1) << (np.arange(size) % 64).astype(np.uint64)
    here, seen = np.array([mission.start]), bits[[mission.start]]
    now, gained, spare = np.zeros(1), np.zeros(1), np.full(1, charge.sum())
    trail: list[tuple[IntArray, IntArray]] = []
    best, route = known, np.zeros(0, int)
    bound = np.array([np.inf])
    nodes = np.arange(size)
    while len(here):
        if time.monotonic() > stop or len(here) > most:
            return Proof(route, max(best, float(bound.max())), proved=False)
        parts = []
        for rows in np.array_split(np.arange(len(here)), len(here) // 10_000 + 1):
            done, worth = mission.done(here[rows, None], nodes[None], np.asarray(now, float)[rows, None])
            fits = (done < due) & ((seen[rows, None] & bits).sum(axis=2) == 0)
            total = gained[rows, None] + worth
            ended = np.where(fits[:, goal], total[:, goal], -np.inf)
            if ended.max() >= best + least and ended.max() > -np.inf:
                best, last, route = float(ended.max()), int(rows[ended.argmax()]), np.array([goal])
                for parents, reached in reversed(trail):
                    route, last = np.append(reached[last], route), parents[last]
                route = np.append(mission.start, route)
            moment = np.where(fits, np.where(fits, done, 0.0) / grid.step, len(grid.at)).astype(int)
            left = spare[rows, None] - charge
            limit = total + left + ahead.best[moment, nodes]
            fits[:, goal] = False
            row, column = np.nonzero(fits & (limit >= best + least) & (limit > -np.inf))
            found = (values[row, column] for values in (done, total, left, limit))
            parts.append((rows[row], column, *found))
        parent, onward, now, gained, spare, bound = map(np.concatenate, zip(*parts, strict=True))
        marks = seen[parent] | bits[onward]
        # Of those that end at one waypoint and have visited the same, those go on that are earlier or richer.
        kept = np.lexsort((-gained, now, *marks.T, onward))
        ends, sets, value = onward[kept], marks[kept], gained[kept]
        fresh = np.ones(len(kept), bool)
        fresh[1:] = (np.diff(ends) != 0) | (sets[1:] != sets[:-1]).any(axis=1)
        if not mission.timetable.waiting:
            fresh[1:] |= np.diff(now[kept]) != 0.0
        group = np.cumsum(fresh)
        scale = 1.0 + (value.max() - value.min() if len(value) else 0.0)
        level = value + 2.0 * scale * group
        richest = np.maximum.accumulate(level) if len(level) else level
        ahead_of = np.ones(len(kept), bool)
        ahead_of[1:] = fresh[1:] | (level[1:] > richest[:-1] + _TOLERANCE)
        kept = kept[ahead_of & (bound[kept] >= best + least)]
        trail.append((parent[kept], onward[kept]))
        here, seen, now, gained, spare, bound = (
            part[kept] for part in (onward, marks, now, gained, spare, bound)
        )
    return Proof(route, best, proved=True)


def least_within_reach(mission: Clocked) -> Array:
    """Return the least time that each edge takes, its task included, when it can serve at all, [N, N] s.

    It is entered no earlier than its waypoint can be reached, and so that the goal can still be.
    """
    mission, size, table = mission.waiting, len(mission.open), mission.timetable
    i, j = np.arange(size)[:, None], np.arange(size)[None]
    earliest = np.where(np.arange(size) == mission.start, 0.0, np.inf)
    for _ in range(size):
        since = np.where(np.isfinite(earliest), earliest, mission.end)[:, None]
        done = np.where(np.isfinite(earliest)[:, None], mission.done(i, j, since)[0], np.inf).min(axis=0)
        if not (done < earliest).any():
            break
        earliest = np.minimum(earliest, done)
    grid = _Grid.of(mission)
    count = len(grid.at)
    home = np.zeros((count + 1, size), bool)
    home[:count, mission.goal] = True
    serves = np.zeros((count, size, size), bool)
    for moment in range(count - 1, -1, -1):
        for _ in range(grid.passes):
            serves[moment] = home[grid.at[moment], j] & mission.open
            home[moment] |= serves[moment].any(axis=1)
    reached = (np.arange(count)[:, None] + 1.0) * grid.step > earliest
    serves &= reached[:, :, None]
    usable = serves.any(axis=0)
    final = count - 1 - serves[::-1].argmax(axis=0)
    first = np.maximum(serves.argmax(axis=0) * grid.step, np.where(usable, earliest[:, None], 0.0))
    last = (np.take_along_axis(grid.at, final[None], axis=0)[0] + 2) * grid.step
    departures = table.departures
    step = departures[1] - departures[0] if len(departures) > 1 else np.inf
    least = np.full((size, size), np.inf)
    for number, departure in enumerate(departures):
        near = (departure > first - step) & (departure < last + step)
        if number == 0:
            near |= departure >= first
        if number == len(departures) - 1:
            near |= departure <= last
        least = np.where(near, np.minimum(least, table.travel_time[number]), least)
    return np.where(usable, least + mission.duration, np.inf)
