"""Routes put in order at last: parts reversed (2-opt), chains moved (Or-opt), other waypoints inserted.

The search of the mission planner looks for priority; here what it found is brought into an order that takes
less time, and what fits then is added.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from auvplan.mission.bound import Array, IntArray

#: Waypoints of a chain that is moved, at most.
_CHAIN = 6

#: s that a move saves at least; priority that does not count; s of a closed edge.
SAVES, TIE, CLOSED = 1e-6, 1e-9, 1e12

#: By the clock: changed routes that are gone through together, and legs of those of one round, at most.
_TOGETHER, _MOST = 256, 2_500_000


class Timed(Protocol):
    """What routes are measured by.

    Attributes:
        exact: whether changes take what `along` has for the route before them.
    """

    exact: ClassVar[bool]

    @property
    def end(self) -> float:
        """S; a route takes less."""
        ...

    def along(self, route: list[int]) -> tuple[Array, Array]:
        """Return s and priority [N, N] of legs, as they are from where a route leaves their waypoints."""
        ...

    def walk(self, routes: IntArray) -> tuple[Array, Array]:
        """Return when routes [C, n] end, s, and their priority [C]; infinite where they do not fit.

        They may be padded with their goal.
        """
        ...


@dataclass(frozen=True)
class Still:
    """A mission whose times do not depend on the clock.

    Attributes:
        times: [N, N] s, of legs with their tasks; infinite where closed.
        priority: [N, N], of legs.
        end: s; a route takes less.
    """

    times: Array
    priority: Array
    end: float
    exact: ClassVar[bool] = True

    def along(self, route: list[int]) -> tuple[Array, Array]:
        """See `Timed`."""
        return self.times, self.priority

    def walk(self, routes: IntArray) -> tuple[Array, Array]:
        """See `Timed`."""
        legs = here, there = routes[:, :-1], routes[:, 1:]
        ends, worth = (
            np.where(here == there, 0.0, values[legs]).sum(axis=1) for values in (self.times, self.priority)
        )
        return np.where(ends < self.end, ends, np.inf), worth


def rearranged(route: list[int], mission: Timed, on: Callable[[], bool] = lambda: True) -> list[int]:
    """Return a route of no less total priority, and of less time where that is equal.

    Parts are reversed and chains moved, each time where that saves most, as long as it does; other waypoints
    are then inserted where they fit, those first that gain most for their time, and so on. By the clock,
    changes are gone through in the order of what they would save if legs took as long as `Timed.along` has
    it, and the best of the first that save something is made.

    Args:
        route: from the start to the goal.
        mission: that it is a route of.
        on: asked now and then whether there is time to go on.
    """
    best = _Route.of(route, mission)
    while better := _changed(best, _moved, mission, on) or _changed(best, _longer, mission, on):
        best = better
    return best.nodes


class _Route(NamedTuple):
    nodes: list[int]
    ends: float
    worth: float

    @classmethod
    def of(cls, nodes: list[int], mission: Timed) -> "_Route":
        """Measure a route."""
        (ends,), (worth,) = mission.walk(np.asarray([nodes]))
        return cls(nodes, float(ends), float(worth))


def _changed(
    route: _Route,
    changes: Callable[[_Route, Timed], Iterator[list[int]]],
    mission: Timed,
    on: Callable[[], bool],
) -> _Route | None:
    """Return the best of the first changed routes that are better; None where none is."""
    found, together = changes(route, mission), 1 if mission.exact else _TOGETHER
    while on() and (some := list(islice(found, together))):
        ends, worth = mission.walk(np.asarray(some))
        with np.errstate(invalid="ignore"):  # of routes that do not fit
            saved, more = route.ends - ends, worth - route.worth
        if changes is _moved:
            gain = np.where((more >= -TIE) & (saved > SAVES), saved, 0.0)
        else:
            gain = np.where(np.isfinite(ends) & (more > TIE), more / np.maximum(-saved, SAVES), 0.0)
        if gain.max() > 0.0:
            which = int(gain.argmax())
            return _Route(some[which], float(ends[which]), float(worth[which]))
        together = _TOGETHER
    return None


def _moved(route: _Route, mission: Timed) -> Iterator[list[int]]:
    """Yield a route with one part reversed or moved, first what saves most."""
    nodes, (times, _) = route.nodes, mission.along(route.nodes)
    change = moves(np.minimum(times[np.ix_(nodes, nodes)], CLOSED), _CHAIN)
    for place in _least(change.ravel(), -SAVES if mission.exact else 0.5 * CLOSED, len(nodes)):
        yield moved(nodes, *np.unravel_index(place, change.shape))


def moved(nodes: list[int], move: int, i: int, k: int) -> list[int]:
    """Return a route after one of the moves of `moves`."""
    if move == 0:
        return [*nodes[:i], *nodes[i : k + 1][::-1], *nodes[k + 1 :]]
    size, turned = divmod(move + 1, 2)
    chain, rest = nodes[i : i + size], [*nodes[:i], *nodes[i + size :]]
    to = k + 1 if k < i else k + 1 - size
    return [*rest[:to], *(chain[::-1] if turned else chain), *rest[to:]]


def moves(legs: Array, longest: int) -> Array:
    """Return what moves add to the sum over a route of its values [..., n, n] of legs by places.

    First of reversing places i to k; then of moving the chain of 1, 1, 2, 2, ..., `longest` places from i on
    between places k and k + 1, as it is and reversed: [..., 1 + 2 longest, n, n]. Infinite where there is no
    such move.
    """
    count = legs.shape[-1]
    onward, back = (np.diagonal(legs, offset, -2, -1) for offset in (1, -1))
    turned = np.cumsum(np.pad(back - onward, [(0, 0)] * (legs.ndim - 2) + [(1, 0)]), axis=-1)
    change = np.full((*legs.shape[:-2], 1 + 2 * longest, count, count), np.inf)
    i, k = np.ogrid[1 : count - 1, 1 : count - 1]
    before, after = turned[..., 1:-1] + onward[..., :-1], turned[..., 1:-1] - onward[..., 1:]
    np.add(legs[..., :-2, 1:-1], legs[..., 1:-1, 2:], out=(part := change[..., 0, 1:-1, 1:-1]))
    part += after[..., None, :] - before[..., None] + np.where(k > i, 0.0, np.inf)
    for size in range(1, min(longest, count - 2) + 1):
        first, last = slice(1, count - size), slice(size, count - 1)
        i, k = np.ogrid[first, : count - 1]
        gone = np.diagonal(legs, size + 1, -2, -1) - onward[..., : count - size - 1] - onward[..., size:]
        rest = gone[..., None] - onward[..., None, :]
        rest += np.where((k < i - 1) | (k > i + size - 1), 0.0, np.inf)
        into, out = np.swapaxes(legs[..., :-1, :], -2, -1), legs[..., 1:]
        np.add(into[..., first, :], out[..., last, :], out=(part := change[..., 2 * size - 1, first, :-1]))
        part += rest
        if size > 1:
            np.add(into[..., last, :], out[..., first, :], out=(part := change[..., 2 * size, first, :-1]))
            part += rest + (turned[..., last] - turned[..., first])[..., None]
    return change


def _longer(route: _Route, mission: Timed) -> Iterator[list[int]]:
    """Yield a route with one waypoint more, first what gains most for its time."""
    nodes, (times, priority) = route.nodes, mission.along(route.nodes)
    others = np.setdiff1d(np.arange(len(times)), nodes)
    here, there = np.asarray(nodes[:-1]), np.asarray(nodes[1:])
    longer, more = (
        values[here][:, others] + values[others][:, there].T - values[here, there][:, None]
        for values in (np.minimum(times, CLOSED), priority)
    )
    open_ = (more > TIE) & (longer < 0.5 * CLOSED)
    loss = np.where(open_, -more / np.maximum(longer, SAVES), np.inf).ravel()
    for place in _least(loss, 0.0, len(nodes)):
        k, which = np.unravel_index(place, longer.shape)
        yield [*nodes[: k + 1], int(others[which]), *nodes[k + 1 :]]


def _least(values: Array, limit: float, count: int) -> IntArray:
    """Return the places of values below a limit, the least first: not more than are tried of `count` legs."""
    places, most = np.flatnonzero(values < limit), _MOST // count
    if most < len(places):
        places = places[np.sort(np.argpartition(values[places], most)[:most])]
    return places[np.argsort(values[places], kind="stable")]
