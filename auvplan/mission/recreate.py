"""Ruin and recreate: good routes are taken apart in places and completed otherwise (Schrimpf et al. 2000).

The moves of `rearrange` exchange no waypoints. Here whole parts of routes give way to others, in several
routes side by side, which go on by the rule of Metropolis.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from auvplan.mission.bound import Array, IntArray
from auvplan.mission.rearrange import CLOSED, SAVES, TIE, Timed, moved, moves, rearranged

#: Routes side by side. Waypoints that one loses at most, as multiples of the root of its length, and that are
#: tried in its gaps.
_ROUTES, _RUINED, _TRIED = 16, 3.0, 64

#: Price of a second, as a share of what the best route gains in one; by how much waypoints seem better or
#: worse than they are; temperature, as a share of the mean priority of a leg.
_PRICE, _NOISE, _TEMPERATURE = 0.3, 0.25, 0.4

#: Moves that put a changed route in order, and waypoints of a chain that they move, at most.
_MOVES, _CHAIN = 2, 2

#: Places by which routes may become longer than the longest of them was.
_SPARE = 8

#: Rounds beside one for each waypoint, and pairs of a place and a waypoint looked at in all rounds, at most.
_ROUNDS, _PAIRS = 40, 400_000


def improved(
    routes: list[list[int]],
    mission: Timed,
    rng: np.random.Generator,
    rounds: int,
    on: Callable[[], bool] = lambda: True,
) -> list[int]:
    """Return the first of some routes, rearranged, recreated beside the others and rearranged again.

    Arguments are as for `recreated`; without rounds it is rearranged alone.
    """
    best = rearranged(routes[0], mission, on)
    if rounds:
        best = rearranged(recreated([best, *routes[1:]], mission, rng, rounds, on), mission, on)
    return best


def recreated(
    routes: list[list[int]],
    mission: Timed,
    rng: np.random.Generator,
    rounds: int,
    on: Callable[[], bool] = lambda: True,
) -> list[int]:
    """Return a route of no less total priority than the first one, and of less time where that is equal.

    In each round all routes lose waypoints that are near each other, on the map or along the route. Others
    are inserted, those first that promise most for their time, each in its best place; a few moves put the
    route in order, and what fits then is added. By the clock routes are changed as if legs took as long as
    along the best one, and gone through at the end of a round.

    Args:
        routes: from the start to the goal, the best first.
        mission: that they are routes of.
        rng: consumed.
        rounds: at most; fewer on small and on very large graphs, and where few edges are open.
        on: asked before each round whether there is time for it.
    """
    goal = routes[0][-1]
    nodes = np.full((_ROUTES, max(map(len, routes)) + 1), goal)
    for row, route in zip(nodes, routes * _ROUTES, strict=False):
        row[: len(route)] = route
    ends, worth = mission.walk(nodes)
    best, least, most = nodes[0], float(ends[0]), float(worth[0])
    if not most > 0.0:
        return routes[0]
    legs = _Legs.along(best, mission, most / least)
    size = len(legs.times)
    rounds = round(legs.open_share * min(rounds, size + _ROUNDS, _PAIRS // (size * len(best))))
    last = 0
    for turn in range(rounds):
        if not on() or turn > last + rounds // 2:
            break
        room = mission.end - ends + legs.total(nodes)
        new = _inserted(_ruined(nodes, legs, rng), room, legs, rng)
        new = _inserted(_in_order(new, legs), room, legs)
        then, gained = mission.walk(new)
        with np.errstate(invalid="ignore"):  # of routes that do not fit
            change = gained - worth - legs.price * (then - ends)
        warmth = _TEMPERATURE * most / np.count_nonzero(best != goal)
        kept = change > warmth * np.log(1.0 - rng.random(_ROUTES))
        width = max(nodes.shape[1], new.shape[1])
        nodes = np.where(kept[:, None], _widened(new, width), _widened(nodes, width))
        nodes = nodes[:, : np.count_nonzero(nodes != goal, axis=1).max() + 1]
        ends, worth = np.where(kept, then, ends), np.where(kept, gained, worth)
        gained = np.where(np.isfinite(then), gained, -np.inf)
        chosen = np.lexsort((then, -gained))[0]
        more, saved = gained[chosen] - most, least - then[chosen]
        if more > TIE or (more > -TIE and saved > SAVES):
            last, best, least, most = turn, new[chosen], float(then[chosen]), float(gained[chosen])
            legs = _Legs.along(best, mission, most / least)
    return [*best[best != goal].tolist(), goal]


@dataclass(frozen=True)
class _Legs:
    """Legs as changes of routes see them.

    Attributes:
        times: [N, N] s; a large number where closed. Routes padded with the goal stay there for nothing.
        cost: [N, N], times at the price of a second less priority.
        price: of a second.
        goal: index.
    """

    times: Array
    cost: Array
    price: float
    goal: int

    @classmethod
    def along(cls, route: IntArray, mission: Timed, rate: float) -> "_Legs":
        """Return legs as they are along a padded route that gains priority at a rate, per second."""
        goal = int(route[-1])
        times, priority = mission.along([*route[route != goal].tolist(), goal])
        times = np.minimum(times, CLOSED)
        times[goal] = CLOSED
        times[goal, goal] = 0.0
        cost = _PRICE * rate * times - np.where(np.arange(len(times))[:, None] == goal, 0.0, priority)
        return cls(times, cost, _PRICE * rate, goal)

    @property
    def open_share(self) -> float:
        """Share of the pairs of waypoints that have an edge."""
        size = len(self.times)
        return np.count_nonzero(self.times < 0.5 * CLOSED) / (size - 1) ** 2

    def total(self, nodes: IntArray) -> Array:
        """Return s of routes [K, n]."""
        return self.times[nodes[:, :-1], nodes[:, 1:]].sum(axis=1)


def _widened(nodes: IntArray, width: int) -> IntArray:
    """Return routes [K, n] padded to [K, width]."""
    return np.pad(nodes, [(0, 0), (0, width - nodes.shape[1])], mode="edge")


def _ruined(nodes: IntArray, legs: _Legs, rng: np.random.Generator) -> IntArray:
    """Return routes [K, n] without waypoints that are near one of all, or near one place on the route."""
    count, width = nodes.shape
    inner = np.count_nonzero(nodes != legs.goal, axis=1) - 1
    lost = 1 + (rng.random(count) * np.minimum(_RUINED * inner**0.5, inner)).astype(int)
    place = 1 + (rng.random(count) * inner).astype(int)
    apart = np.abs(np.arange(width) - place[:, None]).astype(float)
    near = rng.random(count) < 0.5
    apart[near] = legs.times[rng.integers(len(legs.times), size=count)[:, None], nodes][near]
    apart[nodes == legs.goal] = apart[:, 0] = np.inf
    limit = np.take_along_axis(np.sort(apart, axis=1), lost[:, None] - 1, axis=1)
    gone = (apart <= limit) & np.isfinite(apart)
    order = np.argsort(gone, axis=1, kind="stable")
    return np.take_along_axis(np.where(gone, legs.goal, nodes), order, axis=1)


def _inserted(nodes: IntArray, room: Array, legs: _Legs, rng: np.random.Generator | None = None) -> IntArray:
    """Return routes [K, n] with more waypoints, as long as they take less than `room` [K] s.

    They are tried one after the other, the least cost first, give or take some noise where there is chance.
    """
    nodes = _widened(nodes, nodes.shape[1] + _SPARE)
    width, size, row = nodes.shape[1], len(legs.times), np.arange(len(nodes))
    left = room - legs.total(nodes)
    used = slice(np.count_nonzero(nodes != legs.goal, axis=1).max() + 1)
    here, there = nodes[:, used][:, :-1], nodes[:, used][:, 1:]
    longer, dearer = (
        values[here] + values.T.copy()[there] - values[here, there][..., None]
        for values in (legs.times, legs.cost)
    )
    value = -np.where(longer < left[:, None, None], dearer, np.inf).min(axis=1)
    if rng is not None:
        value *= 1.0 + _NOISE * rng.standard_normal(value.shape)
    value[row[:, None], nodes] = -np.inf
    tried = min(int(np.isfinite(value).sum(axis=1).max()), _TRIED)
    order = np.argsort(-value, axis=1)[:, :tried]
    promising = np.isfinite(np.take_along_axis(value, order, axis=1))
    column, start = np.arange(width), row[:, None] * width
    for node, may in zip(order.T, promising.T, strict=True):
        first = nodes * size
        into, out = first[:, :-1] + node[:, None], node[:, None] * size + nodes[:, 1:]
        onward = first[:, :-1] + nodes[:, 1:]
        dearer = legs.cost.take(into) + legs.cost.take(out) - legs.cost.take(onward)
        at = dearer.argmin(axis=1)
        edges = into[row, at], out[row, at], onward[row, at]
        longer = legs.times.take(edges[0]) + legs.times.take(edges[1]) - legs.times.take(edges[2])
        fits = may & (longer < left) & (nodes[:, -2] == legs.goal)
        fits &= (legs.price * longer - dearer[row, at] > TIE) | (longer < 0.0)
        if fits.any():
            left = np.where(fits, left - longer, left)
            at = np.where(fits, at, width)[:, None]
            nodes = nodes.take(start + column - (column > at))
            nodes[row[fits], at[fits, 0] + 1] = node[fits]
    return nodes


def _in_order(nodes: IntArray, legs: _Legs) -> IntArray:
    """Return routes [K, n] after the moves that save most."""
    nodes = nodes[:, : np.count_nonzero(nodes != legs.goal, axis=1).max() + 1]
    for _ in range(_MOVES):
        change = moves(legs.cost[nodes[:, :, None], nodes[:, None, :]], _CHAIN)
        each = change.reshape(len(nodes), -1)
        best = each.argmin(axis=1)
        for row in np.flatnonzero(each[np.arange(len(nodes)), best] < -TIE):
            nodes[row] = moved(nodes[row].tolist(), *np.unravel_index(best[row], change.shape[1:]))
    return nodes
