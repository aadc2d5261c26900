"""Speeds among which that of each leg is chosen: what legs take at them, in time and energy.

A route takes the least energy in a given time where all its legs put one price on a second: each is gone at
the speed of least energy + price x time. Levels are such prices, from zero, the least energy, to one beyond
all bounds, the least time. Where speeds are few most legs change theirs at one price: on each level prices
scatter a little, so that some edges are at the faster of two speeds, and some at the slower.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.mission.timetable import NONE, Stages, Timetable, stages
from auvplan.runtime.arguments import numbers

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]

#: What decides between routes of equal priority.
Saved = Literal["time", "energy"]

#: Prices that are looked at, W, about the powers of the vehicle, and their scatter.
_PRICES, _REACH, _SCATTER = 96, (1e-2, 1e3), 0.15

#: Shares of the energy in mixtures of time and energy.
_MIXES = 0.25, 0.4, 0.5, 0.6, 0.75, 1.0

#: Choices of speeds that the least energy of one route is looked for from, by the clock.
_LEVELS = 4

#: Ways to go a route at speeds that are compared at most, leg by leg.
_WAYS = 4000


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class SpeedOptions:
    """Speeds of a vehicle, K of them, and what the edges of a graph take at each.

    An edge takes the power of its speed while the vehicle is under way, that of waiting while it waits, and
    what is fixed.

    Attributes:
        speeds: [..., K] m/s through the water, rising.
        power: [..., K] W, under way.
        travel_time: [..., K, N, N] s without the task, infinite where the edge cannot be taken so; by the
            clock [..., K, M, N, N], at the departures of the graph's timetable.
        fixed: [..., N, N] J, of the task and of what depends on the edge alone, as its change of depth.
        waypoint_fixed: [..., N] J, the part of `fixed` on every edge into waypoint j that belongs to a task
            at j itself, as `MissionGraph.waypoint_duration` does. None means zero.
        waiting: [..., M, N] W, of waiting at each waypoint, by the clock; None where a vehicle waits under
            way, at the speed of the edge.

    Raises:
        ValueError: shapes that do not go together, or values that are negative or no numbers.
    """

    speeds: Any
    power: Any
    travel_time: Any
    fixed: Any
    waypoint_fixed: Any = None
    waiting: Any = None

    def __post_init__(self) -> None:
        if not isinstance(self.speeds, np.ndarray | list | tuple):
            return  # JAX rebuilds it from traced arrays and placeholders
        if self.waypoint_fixed is None:
            object.__setattr__(self, "waypoint_fixed", np.zeros(np.shape(self.fixed)[:-1]))
        names = ["speeds", "power", "travel_time", "fixed", "waypoint_fixed"]
        names += ["waiting"] * (self.waiting is not None)
        values = [numbers(name, getattr(self, name)) for name in names]
        speeds, power, times, fixed, at_waypoint, *waiting = values
        for name, value in zip(names, values, strict=True):
            if np.isnan(value).any() or (value < 0.0).any():
                raise ValueError(f"{name} of speeds must be numbers that are not negative")
            object.__setattr__(self, name, value)
        if power.shape != speeds.shape:
            raise ValueError(f"power must be {speeds.shape} as speeds, got shape {power.shape}")
        if times.shape[: speeds.ndim] != speeds.shape:
            raise ValueError(f"travel_time must be [{speeds.shape[-1]}, N, N] s, got shape {times.shape}")
        if fixed.shape[-2:] != times.shape[-2:]:
            raise ValueError(f"fixed must be {times.shape[-2:]} J, got shape {fixed.shape}")
        if at_waypoint.shape != fixed.shape[:-1]:
            raise ValueError(f"waypoint_fixed must be {fixed.shape[:-1]} J, got shape {at_waypoint.shape}")
        by_departure = *times.shape[: speeds.ndim - 1], *times.shape[speeds.ndim : -1]
        if waiting and (waiting[0].shape != by_departure or not self.clocked):
            raise ValueError(f"waiting must be [M, N] W by the clock, got shape {waiting[0].shape}")

    @property
    def clocked(self) -> bool:
        """Whether travel times are by departure."""
        return np.ndim(self.travel_time) - np.ndim(self.fixed) == 2

    @property
    def least(self) -> Array:
        """[K, N, N] s, least travel times at any departure, of one graph."""
        return self.travel_time.min(axis=1) if self.clocked else self.travel_time

    @property
    def energies(self) -> Array:
        """[K, N, N] J of edges with their tasks in their least times, of one graph."""
        return taken(self.power[:, None, None], self.least) + self.fixed

    def without_task_at(self, node: int, adjacency: NDArray[np.bool_]) -> "SpeedOptions":
        """Return options in which the task at a waypoint takes nothing more, see `MissionGraph`."""
        fixed, at_waypoint = np.array(self.fixed), np.array(self.waypoint_fixed)
        less = np.where(adjacency[..., node], at_waypoint[..., node, None], 0.0)
        fixed[..., node] = np.maximum(fixed[..., node] - less, 0.0)
        at_waypoint[..., node] = 0.0
        return replace(self, fixed=fixed, waypoint_fixed=at_waypoint)

    def chosen(self, levels: int) -> IntArray:
        """Return places of speeds on each level, [L, N, N], from least energy to least time, of one graph.

        Where waiting takes power, the second is the level of edges that lead to a wait, where a second later
        is one of waiting less.
        """
        times, size = self.least, self.fixed.shape[-1]
        moving = self.power[self.power > 0.0]
        low, high = (moving.min(), moving.max()) if len(moving) else (1.0, 1.0)
        prices = np.geomspace(_REACH[0] * low, _REACH[1] * high, _PRICES)
        scatter = np.exp(_SCATTER * np.random.default_rng(0).uniform(-1.0, 1.0, (size, size)))
        with np.errstate(invalid="ignore"):
            found = [(self.power[:, None, None] * times).argmin(axis=0)]
            for price in prices:
                cost = (self.power[:, None, None] + price * scatter) * times
                found.append(np.where(np.isfinite(cost), cost, np.inf).argmin(axis=0))
        found.append(times.argmin(axis=0))
        rows, used = np.stack(found), np.isfinite(times).any(axis=0)
        pace = rows[:, used].mean(axis=1) if used.any() else np.zeros(len(rows))
        slow = None
        if self.waiting is not None and levels > 2:
            with np.errstate(invalid="ignore"):
                cost = (self.power - self.waiting.mean())[:, None, None] * times
            slow = np.where(np.isfinite(times), cost, np.inf).argmin(axis=0)
            levels -= 1
        wanted = np.linspace(pace[0], pace[-1], levels) if levels > 1 else pace[-1:]
        rows = rows[np.abs(pace[:, None] - wanted).argmin(axis=0)]
        return rows if slow is None else np.insert(rows, 1, slow, axis=0)

    def passable(self, chosen: IntArray) -> IntArray:
        """Return places of speeds [N, N], in place of those that an edge cannot be taken at its fastest."""
        times = self.least
        return np.where(np.isfinite(picked(times, chosen)), chosen, times.argmin(axis=0))

    def at(self, chosen: IntArray) -> Array:
        """Return travel times of edges at places of speeds [N, N], as `travel_time` without its K."""
        return picked(self.travel_time, chosen[None] if self.clocked else chosen)

    def spent(
        self,
        legs: tuple[IntArray, IntArray],
        places: IntArray,
        passed: Stages,
        tasks: Array,
        timetable: Timetable | None,
    ) -> Array:
        """Return J [n] of legs by the clock.

        Args:
            legs: [n] waypoints that they lead from and to.
            places: [n] of their speeds.
            passed: when they are gone.
            tasks: [n] s, of their tasks.
            timetable: by which they are; its travel times do not count.
        """
        power, fixed = self.power[places], self.fixed[legs]
        if self.waiting is None or timetable is None:
            return power * (passed.ends - passed.departs - tasks) + fixed
        spent = power * (passed.arrives - passed.leaves) + fixed
        before = legs[0], passed.departs, passed.leaves - passed.departs
        after = legs[1], passed.arrives, passed.begins - passed.arrives
        for nodes, moments, seconds in (before, after):
            watts = [
                np.interp(moment, timetable.departures, self.waiting[:, node])
                for node, moment in zip(nodes, moments, strict=True)
            ]
            spent += np.asarray(watts) * seconds
        return spent

    def along(self, nodes: IntArray, places: IntArray) -> tuple[Array, Array]:
        """Return s under way and J of the legs [n - 1] of a route that is not by the clock.

        Args:
            nodes: [n] waypoints.
            places: [N, N] of the speeds of edges.
        """
        legs = nodes[:-1], nodes[1:]
        lasts = self.at(places)[legs]
        return lasts, self.power[places[legs]] * lasts + self.fixed[legs]

    def shares(
        self, duration: Array, open_: NDArray[np.bool_], available: tuple[float, float]
    ) -> list[Array]:
        """Return least shares of mixtures of time and energy that edges take at any speed, [N, N] each.

        A route that keeps both limits takes less than 1 of each, or no more.

        Args:
            duration: [N, N] s, of tasks.
            open_: [N, N], edges that may be taken; others take an infinite share.
            available: s and J.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            times = np.where(open_, self.least + duration, np.inf) / available[0]
            energies = np.where(open_, self.energies, np.inf) / available[1]
            return [((1.0 - mix) * times + mix * energies).min(axis=0) for mix in _MIXES]

    def for_route(
        self,
        nodes: IntArray,
        timetable: Timetable | None,
        duration: Array,
        available: tuple[float, float],
        saves: Saved,
        levels: IntArray,
        margin: float = 0.0,
    ) -> IntArray | None:
        """Choose the speeds of a route, and of all other edges that of the level that suits it best.

        Args:
            nodes: [n] waypoints of the route.
            timetable: of the graph, for windows of tasks; its travel times do not count.
            duration: [N, N] s of tasks.
            available, saves: as for `fastest`.
            levels: [L, N, N], as `chosen` returns them.
            margin: share by which the last leg is taken to last longer, and to take more energy.

        Returns:
            [N, N] places of speeds; None where the route keeps both limits at none.
        """
        legs = nodes[:-1], nodes[1:]
        if not len(legs[0]):
            return levels[-1]
        fixed, tasks, count = self.fixed[legs], duration[legs], len(legs[0])
        if timetable is None:
            travel = self.travel_time[:, *legs].T
            times, energies = travel + tasks[:, None], taken(self.power, travel) + fixed[:, None]
            times[-1], energies[-1] = (1.0 + margin) * times[-1], (1.0 + margin) * energies[-1]
            sums = [
                (times[np.arange(count), row[legs]].sum(), energies[np.arange(count), row[legs]].sum())
                for row in levels
            ]
            best = fastest(times, energies, available, saves)
        else:
            # The route by itself, its waypoints numbered in order.
            square = np.ix_(nodes, nodes)
            own = {name: getattr(timetable, name)[square] for name in NONE}
            own |= {"travel_time": np.full((len(timetable.departures), count + 1, count + 1), np.inf)}
            alone, order = replace(timetable, **own), np.arange(count + 1)

            def went(places: IntArray) -> tuple[float, float]:
                travel = np.array(alone.travel_time)
                travel[:, order[:-1], order[1:]] = self.travel_time[places, :, *legs].T
                passed = stages(replace(alone, travel_time=travel), duration[square], order)
                with np.errstate(invalid="ignore"):
                    spent = self.spent(legs, places, passed, tasks, timetable)
                    lasts = passed.ends[-1] + margin * (passed.ends - passed.departs)[-1]
                    whole = lasts, spent.sum() + margin * spent[-1]
                return float(np.nan_to_num(whole[0], nan=np.inf)), float(np.nan_to_num(whole[1], nan=np.inf))

            first = [row[legs] for row in levels]
            sums = [went(row) for row in first]
            best = _settled(went, first, len(self.speeds), available, saves)
        if not len(best):
            return None
        with np.errstate(invalid="ignore"):
            level = int(np.max(np.asarray(sums) / np.asarray(available), axis=1).argmin())
        found = levels[level].copy()
        found[legs] = best
        return found


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class RouteSpeeds:
    """Speeds that were chosen for a route.

    Attributes:
        options: of which they were chosen.
        chosen: [N, N] places of speeds among the options, of all edges.
        legs: [n - 1] m/s through the water, of each leg.
        energies: [n - 1] J of each leg, waiting and task included.
        available: J.
        duration: [N, N] s, of tasks.
        open: [N, N] bool, edges that may be taken.
    """

    options: SpeedOptions
    chosen: Any
    legs: Any
    energies: Any
    available: Any
    duration: Any
    open: Any

    @property
    def times_of_edges(self) -> Array:
        """[K, N, N] s, of open edges with their tasks at each speed, at any departure; else infinite."""
        return np.where(self.open, self.options.least + self.duration, np.inf)

    @property
    def energies_of_edges(self) -> Array:
        """[K, N, N] J, of open edges with their tasks in these times; else infinite."""
        return np.where(self.open, self.options.energies, np.inf)

    def along(self, nodes: IntArray, places: IntArray) -> "RouteSpeeds":
        """Return those of another route, of waypoints [n], its legs at places of speeds [n - 1]."""
        edges, chosen = (nodes[:-1], nodes[1:]), self.chosen.copy()
        chosen[edges] = places
        energies = self.energies_of_edges[places, *edges]
        return replace(self, chosen=chosen, legs=self.options.speeds[places], energies=energies)

    def least_energy(
        self, nodes: IntArray, timetable: Timetable | None, time_available: float, margin: float
    ) -> tuple[float, float]:
        """Return J of another route at the speeds of least energy that keep it in time; infinite without any.

        Args:
            nodes: [n] its waypoints.
            timetable: of the graph, for windows of tasks.
            time_available: s.
            margin: share by which the last leg is taken to last longer, and to take more energy.

        Returns:
            What it takes, and with the margin.
        """
        options, levels = self.options, self.options.chosen(_LEVELS)
        limits = time_available, np.inf
        places = options.for_route(nodes, timetable, self.duration, limits, "energy", levels, margin)
        if places is None:
            return np.inf, np.inf
        legs = nodes[:-1], nodes[1:]
        if timetable is None:
            spent = options.along(nodes, places)[1]
        else:
            at = replace(timetable, travel_time=options.at(places))
            passed = stages(at, self.duration, nodes.tolist())
            spent = options.spent(legs, places[legs], passed, self.duration[legs], timetable)
        return float(spent.sum()), float(spent.sum() + margin * spent[-1])

    def shares(self, time_available: float) -> list[Array]:
        """Return `SpeedOptions.shares` of a time, s, and the energy available."""
        return self.options.shares(self.duration, self.open, (time_available, self.available))


def picked(values: Array, places: IntArray) -> Array:
    """Return of values [K, ...] those at places [...] along their first axis."""
    return np.take_along_axis(values, places[None], axis=0)[0]


def taken(power: Array, travel: Array) -> Array:
    """Return J of edges under way at powers, W, for times, s; infinite where these are."""
    return np.where(np.isfinite(travel), power * np.where(np.isfinite(travel), travel, 0.0), np.inf)


def fastest(times: Array, energies: Array, available: tuple[float, float], saves: Saved) -> IntArray:
    """Choose the speeds of a route's legs: in the least time or with the least energy, within both limits.

    Ways to go the legs so far are kept that no other beats in both; where they are very many, those of least
    energy in as many steps of time.

    Args:
        times: [n, K] s that each leg takes at each speed.
        energies: [n, K] J.
        available: s and J; a route takes less time, and no more energy.
        saves: "time" or "energy".

    Returns:
        [n] places of speeds; empty where none keep both limits.
    """
    least = np.cumsum(times.min(axis=1)[::-1])[::-1], np.cumsum(energies.min(axis=1)[::-1])[::-1]
    rest = [np.append(part[1:], 0.0) for part in least]
    used, trail = (np.zeros(1), np.zeros(1)), []
    for leg in range(len(times)):
        time, energy = (
            np.add.outer(part, row[leg]).ravel() for part, row in zip(used, (times, energies), strict=True)
        )
        fits = np.flatnonzero((time + rest[0][leg] < available[0]) & (energy + rest[1][leg] <= available[1]))
        order = fits[np.lexsort((energy[fits], time[fits]))]
        if not len(order):
            return np.zeros(0, int)
        lowest = np.minimum.accumulate(energy[order])
        order = order[np.append(True, lowest[1:] < lowest[:-1])]
        if len(order) > _WAYS:
            order = order[np.unique(np.linspace(0, len(order) - 1, _WAYS).round().astype(int))]
        trail.append((order // times.shape[1], order % times.shape[1]))
        used = time[order], energy[order]
    # Ways are in the order of time: the first is the fastest, the last takes least energy.
    row, chosen = 0 if saves == "time" else len(used[0]) - 1, np.zeros(len(times), int)
    for leg in range(len(times) - 1, -1, -1):
        parent, place = trail[leg]
        chosen[leg], row = place[row], parent[row]
    return chosen


def _settled(
    went: Callable[[IntArray], tuple[float, float]],
    first: list[IntArray],
    count: int,
    available: tuple[float, float],
    saves: Saved,
) -> IntArray:
    """`fastest` where legs last by when they begin: from the best of some choices on, one leg at a time.

    Args:
        went: takes places of speeds [n], of which there are `count`; returns s and J of the route.
        first: choices to begin with.
        count: of speeds.
        available, saves: as for `fastest`.
    """

    def worth(places: IntArray) -> float:
        time, energy = went(places)
        if not (time < available[0] and energy <= available[1]):
            return np.inf
        return time if saves == "time" else energy

    values = [worth(places) for places in first]
    best, least = first[int(np.argmin(values))], min(values)
    if not np.isfinite(least):
        return np.zeros(0, int)
    improved = True
    while improved:
        improved = False
        for leg in range(len(best)):
            for place in (best[leg] - 1, best[leg] + 1):
                if not 0 <= place < count:
                    continue
                other = best.copy()
                other[leg] = place
                if (value := worth(other)) < least - 1e-9 * (1.0 + least):
                    best, least, improved = other, value, True
    return best
