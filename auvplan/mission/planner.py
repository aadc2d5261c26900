"""The mission planner: a graph and a time budget into a route (section 3.3)."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, pairwise
from typing import Any, Literal, NamedTuple, TypeVar

import jax
import numpy as np

from auvplan.mission import decoder as decoders
from auvplan.mission import labels, rearrange, recreate
from auvplan.mission.bound import least_difference, with_return_margin
from auvplan.mission.config import MissionConfig
from auvplan.mission.evolution import Missions, search_within
from auvplan.mission.exact import certify
from auvplan.mission.graph import MissionGraph, time_to_go
from auvplan.mission.labels import Clocked
from auvplan.mission.problem import Edges, rounding_margin
from auvplan.mission.route import MissionRoute, MissionRoutes, MissionStatus
from auvplan.mission.speeds import RouteSpeeds, Saved, taken
from auvplan.mission.timetable import more_departures
from auvplan.runtime.arguments import check_choice, instance, numbers, per_row
from auvplan.runtime.budget import Budget
from auvplan.runtime.prng import as_key, generator, key_per, single
from auvplan.runtime.rows import batch_map
from auvplan.vehicle import Vehicle

T = TypeVar("T")

#: Shares of time and energy with which speeds to choose from are searched as well: levels hold few of the
#: ways to go a route, and some of those found keep both limits at other speeds. Routes that are tried for it.
_MORE, _TRIED = (1.02, 1.1), 60

#: Share of a budget that is kept for improving routes at last: where all edges are open, and by the clock
#: from this number of waypoints on.
_KEPT, _KEPT_LONG, _LONG = 0.4, 0.2, 24

#: Iterations up to which one program serves searches.
_ITERATIONS = 256

#: Graphs are padded with waypoints that no edge leads to, so that one program serves several numbers of them:
#: to one of these, or to a multiple of the largest.
_SIZES = (16, 40, 64, 80, 100, 125, 160, 200, 250, 320, 400, 500)


def plan_mission(
    graph: MissionGraph,
    start: int,
    goal: int,
    time_available: float,
    vehicle: Vehicle | None = None,
    *,
    key: jax.Array,
    config: MissionConfig | None = None,
    population: Any = None,
    speed: float | None = None,
    visited: Any = None,
    known_route: Sequence[int] | np.ndarray | None = None,
    method: Literal["search", "exact"] = "search",
    time_limit: float = 10.0,
    budget: float | None = None,
    energy_available: float | None = None,
) -> MissionRoute:
    """Find the route of most total priority that reaches the destination in time.

    The search starts from random habitats, good routes of a beam search, the shortest mission and the
    greediest one, so that its answer is feasible whenever a feasible mission exists (up to rounding of
    T_available in the last digits).

    `replan_mission` re-plans the rest of a mission under way (section 3.3.2).

    Args:
        graph: N waypoints.
        start: index of the waypoint where the vehicle is.
        goal: index of the destination; equal to `start` it gives the empty mission.
        time_available: T_available, s; the mission takes strictly less. None is possible in negative time.
        vehicle: its `speed` is |v| of Eq. 13, m/s; defaults to `Vehicle()`.
        key: PRNG key, consumed; the same key gives the same route.
        config: settings; defaults to `MissionConfig()`.
        population: [Q, D] habitats to start from, Q at most P, best first, as `MissionRoute.population`.
        speed: m/s, instead of `vehicle`.
        visited: [N] bool, waypoints not to be visited again; none by default.
        known_route: [n] waypoints from start to goal; the answer costs no more, if it keeps all limits.
        method: "exact" hands the route found to OR-Tools CP-SAT, which improves and proves it: `bound` of the
            answer is what it proved. It needs the extra `auvplan[exact]` and objective "priority". By the
            clock labels of dynamic programming do that, without OR-Tools.
        time_limit: s, of the exact method.
        budget: s of wall-clock time, compilation left out, after which the best route so far is returned, the
            exact method included; the same key then gives other routes on other machines. None for all the
            effort of the settings.
        energy_available: J that the mission may take, for a graph that has speeds to choose from: the
            speed of each leg is chosen with the order. None for no limit.

    Raises:
        ValueError: an argument is out of range or of the wrong shape.
        TypeError: the key is none, such as a seed, or an argument is of another kind, such as a `timedelta`.
        ImportError: method "exact" without OR-Tools.

    Example:
        >>> import jax, numpy as np
        >>> from auvplan.mission import plan_mission, random_graph
        >>> rng = np.random.default_rng(0)
        >>> graph = random_graph(rng, rng.uniform(0.0, 1000.0, (8, 3)), neighbours=3)
        >>> route = plan_mission(graph, 0, 7, 1800.0, speed=2.5, key=jax.random.key(0))
        >>> route.feasible, bool(route.time < 1800.0)
        (True, True)
        >>> route.priority <= route.bound
        True

    Differences from the paper:
        Its search starts from random priority vectors alone and minimises Eq. 15: `MissionConfig.paper()`.
    """
    instance("graph", graph, MissionGraph)
    check_choice("method", method, ("search", "exact"))
    if not numbers("time_limit", time_limit) > 0.0:
        raise ValueError(f"time_limit must be positive, s of wall-clock time, got {time_limit}")
    if method == "exact" and config is not None and config.objective != "priority":
        raise ValueError(f'method "exact" needs objective "priority", got {config.objective!r}')
    if np.ndim(graph.positions) != 2:
        raise ValueError("plan_mission takes one graph: give stacked graphs to plan_missions")
    started = time.perf_counter()
    routes = plan_missions(
        jax.tree.map(lambda field: np.asarray(field)[None], graph),
        [start],
        [goal],
        time_available,
        vehicle,
        key=as_key(key)[None],
        speed=speed,
        population=None if population is None else np.asarray(population)[None],
        config=config,
        visited=None if visited is None else np.asarray(visited)[None],
        known_routes=None if known_route is None else [known_route],
        budget=budget,
        energy_available=energy_available,
    )
    if budget is not None:
        time_limit = min(time_limit, max(budget - (time.perf_counter() - started), 0.01))
    return certify(routes[0], time_limit) if method == "exact" else routes[0]


def replan_mission(
    route: MissionRoute,
    graph: MissionGraph,
    here: int,
    time_available: float,
    vehicle: Vehicle | None = None,
    *,
    key: jax.Array,
    config: MissionConfig | None = None,
    speed: float | None = None,
    budget: float | None = None,
    energy_available: float | None = None,
    now: float | None = None,
) -> MissionRoute:
    """Re-plan the rest of a mission from a waypoint of its route (section 3.3.2).

    Edges that were passed leave the graph, and so do the tasks done, with the energy that
    `SpeedOptions.waypoint_fixed` has for them, those of all re-plans before too (`MissionRoute.passed`). The
    search starts from the population of the last route, and the rest of that route is among its habitats.

    Args:
        route: that was followed so far.
        graph: that it was planned on, or the same waypoints with what is known now: other travel times, edges
            closed.
        here: index of the waypoint reached, on the route.
        time_available: s that are left.
        vehicle: as for `plan_mission`.
        key: PRNG key, consumed; the same key gives the same route.
        config: settings; defaults to `MissionConfig()`, as for `plan_mission`.
        speed: m/s, instead of `vehicle`.
        budget: s of wall-clock time, as for `plan_mission`.
        energy_available: J that are left, as for `plan_mission`.
        now: s since the moment that the graph's timetable counts from; needed where it has one.

    Raises:
        ValueError: `here` is not on the route, `now` is missing, or as `plan_mission`.

    Example:
        >>> import jax, numpy as np
        >>> from auvplan.mission import plan_mission, random_graph, replan_mission
        >>> rng, keys = np.random.default_rng(0), jax.random.split(jax.random.key(0))
        >>> graph = random_graph(rng, rng.uniform(0.0, 1000.0, (8, 3)), neighbours=3)
        >>> route = plan_mission(graph, 0, 7, 1800.0, speed=2.5, key=keys[0])
        >>> here, left = int(route.nodes[1]), 1800.0 - float(route.leg_times[0]) - 60.0  # a minute late
        >>> rest = replan_mission(route, graph, here, left, speed=2.5, key=keys[1])
        >>> rest.feasible, int(rest.nodes[0]) == here
        (True, True)
    """
    instance("route", route, MissionRoute, "what ap.plan_mission returned")
    instance("graph", graph, MissionGraph)
    nodes = [int(node) for node in route.nodes]
    if here not in nodes:
        raise ValueError(f"here must be a waypoint of the route {nodes}, got {here}")
    if graph.timetable is not None:
        if now is None:
            raise ValueError(
                "a graph with a timetable needs `now`, s since the moment that its times count from"
            )
        graph = replace(graph, timetable=graph.timetable.since(per_row("now", now, 1)[0]))
    reached = nodes.index(here)
    passed = (*route.passed, *pairwise(nodes[: reached + 1]))
    graph = graph.without_edges(passed, both_ways=None)
    for node in {here, *chain.from_iterable(passed)}:
        graph = graph.without_task_at(node)
    rest = plan_mission(
        graph,
        here,
        route.goal,
        time_available,
        vehicle,
        key=key,
        config=config,
        population=route.population[: (config or MissionConfig()).bbo.population],
        speed=speed,
        known_route=nodes[reached:],
        budget=budget,
        energy_available=energy_available,
    )
    return replace(rest, passed=passed)


def plan_missions(
    graphs: MissionGraph,
    starts: Sequence[int] | np.ndarray,
    goals: Sequence[int] | np.ndarray,
    time_available: Any,
    vehicle: Vehicle | None = None,
    *,
    key: jax.Array,
    config: MissionConfig | None = None,
    population: Any = None,
    speed: Any = None,
    visited: Any = None,
    return_margin: Any = 0.0,
    known_routes: Sequence[Sequence[int] | np.ndarray | None] | None = None,
    budget: float | None = None,
    energy_available: Any = None,
) -> MissionRoutes:
    """`plan_mission` for B missions with one compiled program, on all cores at once.

    Args:
        graphs: stacked along a leading axis B (`MissionGraph.stack`).
        starts, goals: [B] indices.
        time_available: [B] s, or one for all.
        vehicle: its `speed` is |v| of Eq. 13, m/s, one or [B]; defaults to `Vehicle()`.
        key: one PRNG key, split over the missions, or B keys; a route depends on its own key alone.
        config: settings; defaults to `MissionConfig()`.
        population: [B, Q, D] habitats to start from, as `MissionRoutes.population`.
        speed: m/s, one or [B], instead of `vehicle`.
        visited: [B, N] bool, waypoints not to be visited again.
        return_margin: [B] or one for all; share by which the path from any waypoint to the destination is
            taken to last longer than expected. It keeps slack for bad surprises where they cannot be mended:
            on the last legs. A route may then be reported out of time although it would just do.
        known_routes: for each mission the waypoints of a route from its start to its goal, or None.
        budget: s of wall-clock time for all missions together, as for `plan_mission`.
        energy_available: [B] J or one for all, as for `plan_mission`.

    Raises:
        ValueError: an argument is out of range or of the wrong shape, or keys are not as many as missions.
        TypeError: as `plan_mission`.
    """
    config = config or MissionConfig()
    instance("config", config, MissionConfig)
    if budget is not None:
        per_row("budget", budget, 1)
    instance("graphs", graphs, MissionGraph, "ap.MissionGraph.stack(...)")
    graphs = jax.tree.map(np.asarray, graphs)
    if graphs.positions.ndim != 3:
        raise ValueError(f"graphs must be stacked, positions [B, N, 3], got shape {graphs.positions.shape}")
    batch, size = graphs.positions.shape[:2]
    starts, goals = _indices("start", starts, batch, size), _indices("goal", goals, batch, size)
    available = per_row("time_available", time_available, batch)
    rate = per_row("speed", _speed(vehicle, speed), batch)
    if not (rate > 0.0).all():
        raise ValueError(f"speed must be positive, got {rate.min():g} m/s")
    keys = key_per("mission", key, batch)
    closed = np.zeros((batch, size), bool) if visited is None else numbers("visited", visited, bool)
    if closed.shape != (batch, size):
        raise ValueError(f"visited must be [{size}] for each of {batch} missions, got shape {closed.shape}")
    margins = per_row("return_margin", return_margin, batch)
    if (margins < 0.0).any():
        raise ValueError(f"return_margin must not be negative, got {margins.min():g}")
    given, count = _given(population, batch, size, config)
    known = _known(known_routes, starts, goals, size)

    if size == 2:  # there is one route at most: what looks for better ones is not compiled
        config = config.replace(seeds=0, local_rounds=0)
    iterations, options = config.bbo.iterations, graphs.options
    kept = max(
        _KEPT * float(graphs.adjacency.mean()),
        _KEPT_LONG if graphs.timetable is not None and size >= _LONG else 0.0,
    )
    if options is None and energy_available is not None:
        raise ValueError(
            "energy_available needs a graph with options: what its edges take, and at which speeds"
        )
    if options is not None and (config.decoder == "paper" or config.objective == "eq15"):
        raise ValueError('speeds to choose from need decoder "rate" or "timely" and objective "priority"')
    energy = per_row("energy_available", 1e30 if energy_available is None else energy_available, batch)
    if options is None:
        legs = graphs.leg_times(rate)
    else:
        graphs = _at_fastest(graphs)
        legs = graphs.leg_times(1.0)
    open_legs = np.where(closed[:, None, :], np.inf, legs)
    asked = _Asked(graphs, open_legs, goals, available, margins)
    differs = asked.least_differences(starts)
    more = next((most for most in _SIZES if most >= size), -(-size // _SIZES[-1]) * _SIZES[-1]) - size
    shared = config.replace(bbo=config.bbo.replace(iterations=max(iterations, _ITERATIONS)), ruins=0)
    square, row = [(0, 0), (0, more), (0, more)], [(0, 0), (0, more)]
    edges = Edges.of(
        np.pad(legs, square, constant_values=np.inf),
        np.pad(graphs.priority, square),
        config.degree,
        None if graphs.timetable is None else graphs.timetable.padded(more),
        np.pad(graphs.duration, square),
    )
    levels = list[np.ndarray]()
    if options is not None:
        count_of = config.levels if options.speeds.shape[-1] > 1 else 1
        levels = [option.chosen(count_of) for option in _each(options)]
        edges = _on_levels(edges, graphs, levels, more)
    missions = Missions(
        edges,
        starts,
        goals,
        available.astype(np.float32),
        np.pad(closed, row),
        margins.astype(np.float32),
        np.insert(given, [size] * more, 0, axis=2),
        np.pad(known, row, constant_values=-1),
        differs.astype(np.float32),
        None if options is None else energy.astype(np.float32),
    )
    if options is not None and options.speeds.shape[-1] > 1:
        keys, missions = _with_more(keys, missions)
    watch = None if budget is None else Budget((1.0 - kept) * budget, batch)

    def on(row: int) -> bool:
        return watch is None or budget is None or watch.left > -kept * budget * (row + 1) / batch

    each_key = enumerate(single(keys)[:batch]) if config.local_rounds else ()
    efforts = [_Effort(one, config.ruins, partial(on, row)) for row, one in each_key]
    program = partial(search_within, watch, count=count, iterations=iterations, config=shared)
    result, best, least = batch_map(program, keys, missions)
    found = np.where(np.asarray(best.reached)[..., None], np.asarray(best.nodes[..., :size]), -1)
    found[..., 0] = np.resize(starts, len(found))[:, None]
    result, least = jax.tree.map(lambda leaf: leaf[:batch], (result, least))
    population = np.delete(result.state.population, np.s_[size : size + more], axis=2)
    result = replace(result, state=replace(result.state, population=population))
    if options is not None:
        return _collect(
            result,
            found,
            np.asarray(least),
            asked,
            _Choice(energy, levels, config.saves, efforts),
        )
    rows, chosen = np.arange(batch), _richest(best, differs)
    result, nodes = replace(result, cost=np.asarray(result.state.cost)[rows, chosen]), found[rows, chosen]
    if graphs.timetable is not None and config.objective == "priority":
        nodes = np.stack([_in_time(*each) for each in zip(nodes, known, found, _each(asked), strict=True)])
    if config.objective == "priority" and efforts:
        nodes = np.stack([_improved(*each) for each in zip(nodes, found, _each(asked), efforts, strict=True)])
    return _collect(result, nodes, np.asarray(least), asked)


def _speed(vehicle: Vehicle | None, speed: Any) -> Any:
    """Return |v| [m/s] of a vehicle or as given."""
    if vehicle is not None and speed is not None:
        raise ValueError("give vehicle or speed, not both")
    if speed is not None:
        return speed
    if not isinstance(vehicle, Vehicle | None):
        raise TypeError(f"vehicle must be a Vehicle, got {type(vehicle).__name__}: give a speed as speed=")
    return (vehicle or Vehicle()).speed


class _Asked(NamedTuple):
    """B missions: graphs, times of legs [B, N, N] s, infinite where closed, and what is asked of each."""

    graphs: MissionGraph
    legs: np.ndarray
    goals: np.ndarray
    available: np.ndarray
    margins: np.ndarray

    def along(self, values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Return values [B, N, N] of the legs of routes [B, N] padded with -1, [B, N - 1]; zero beyond."""
        here, there = nodes[:, :-1], nodes[:, 1:]
        return np.where(there >= 0, values[np.arange(len(nodes))[:, None], here, there], 0.0)

    def clocked(self, start: int) -> Clocked:
        """Return what one mission by the clock from a start is."""
        graph, ends = self.graphs, (start, int(self.goals), float(self.available))
        assert graph.timetable is not None
        open_, margin = np.isfinite(self.legs), float(self.margins)
        return Clocked(graph.timetable, graph.duration, graph.priority, open_, *ends, return_margin=margin)

    def least_differences(self, starts: np.ndarray) -> np.ndarray:
        """Return `least_difference` [B] of total priorities of routes from starts [B]."""
        parts = zip(_each(self), starts.tolist(), strict=True)
        return np.asarray([
            least_difference(
                one.legs, one.graphs.priority, (start, int(one.goals)), float(one.available),
                None if one.graphs.timetable is None else one.graphs.timetable.drops,
            )
            for one, start in parts
        ])  # fmt: skip


class _Effort(NamedTuple):
    """What is done at last to the routes of a mission: a key, rounds, and whether there is time for more."""

    key: jax.Array
    rounds: int
    on: Callable[[], bool]

    def improved(
        self, nodes: np.ndarray, found: np.ndarray, mission: rearrange.Timed, one: _Asked
    ) -> np.ndarray:
        """Return a route [N], as it is measured by `mission`, improved: see `recreate.improved`."""
        old = nodes[nodes >= 0].tolist()
        if old[-1] != int(one.goals) or len(old) < 4:
            return nodes
        others = found[(found == old[-1]).any(axis=1)] if self.rounds else found[:0]
        routes = [old, *(other[other >= 0].tolist() for other in _richer(others, -1.0, one.graphs))]
        route = recreate.improved(routes, mission, generator(self.key), self.rounds, self.on)
        return np.pad(np.asarray(route, nodes.dtype), (0, len(nodes) - len(route)), constant_values=-1)


class _Choice(NamedTuple):
    """How the speeds of B missions are chosen: energies [B] J, levels [L, N, N] of each, what is saved.

    And what is done to routes at last; nothing if empty.
    """

    energy: np.ndarray
    levels: list[np.ndarray]
    saves: Saved
    efforts: list[_Effort]


def _richest(routes: decoders.Decoded, differs: np.ndarray) -> np.ndarray:
    """Return the places [B] of the routes [B, P] of most total priority, of equal ones that of least time.

    Single precision leaves the sums of two such a little apart; others differ by `differs` [B] at least.
    """
    priority = np.where(routes.reached, routes.priority, -1.0)
    most = priority.max(axis=1)
    tied = priority >= (most - np.minimum(1e-6 * np.abs(most), 0.5 * differs))[:, None]
    return np.where(tied, routes.time, np.inf).argmin(axis=1)


def _in_time(chosen: np.ndarray, known: np.ndarray, found: np.ndarray, one: _Asked) -> np.ndarray:
    """Return the best by the clock of a route [N], the known one and those found [P, N], padded with -1.

    In double precision: in single precision tasks that begin just as their windows close seem a little early
    or late. And without waiting, when the search may take an earlier arrival wrongly for the better one, of
    those that few labels reach.
    """
    start, goal = int(chosen[0]), int(one.goals)
    if start == goal:
        return chosen
    mission, routes = one.clocked(start), np.concatenate([chosen[None], known[None], found])
    routes = routes[(routes == goal).any(axis=1)]
    ends, worth = mission.walk(np.where(routes >= 0, routes, goal))
    worth = np.where(np.isfinite(ends), worth, -np.inf)
    best, most = chosen, worth.max(initial=-np.inf)
    if np.isfinite(most):
        best = routes[np.lexsort((ends, -worth))[0]]
    if not mission.timetable.waiting and len(better := labels.better(mission, float(most)).nodes):
        best = np.pad(better, (0, len(chosen) - len(better)), constant_values=-1)
    return best.astype(chosen.dtype)


def _ways(
    nodes: np.ndarray, found: np.ndarray, one: _Asked, energy: float, how: _Effort
) -> Iterator[np.ndarray]:
    """Yield a route [N] with speeds to choose from, improved by time, then by time and energy, J."""
    yield _improved(nodes, found, one, how._replace(rounds=0))
    old, option, graph = nodes[nodes >= 0], one.graphs.options, one.graphs
    if graph.timetable is not None or old[-1] != int(one.goals):
        return
    assert option is not None
    legs, limits = (old[:-1], old[1:]), (float(one.available), energy)
    mixtures = option.shares(graph.duration, np.isfinite(one.legs), limits)
    share = max(mixtures, key=lambda mixture: mixture[legs].sum())  # of the scarcest
    share = with_return_margin(share, int(old[0]), int(old[-1]), float(one.margins))
    for most, rounds in ((1.0, how.rounds), (share[legs].sum() + 1e-9, 0)):
        mission = rearrange.Still(share, np.asarray(graph.priority, float), most)
        yield how._replace(rounds=rounds).improved(nodes, found, mission, one)


def _improved(nodes: np.ndarray, found: np.ndarray, one: _Asked, how: _Effort) -> np.ndarray:
    """Return a route [N] of one mission, improved, of several [P, N] that were found."""
    start, goal, graph = int(nodes[0]), int(one.goals), one.graphs
    mission: rearrange.Timed
    if graph.timetable is None:
        times = with_return_margin(np.asarray(one.legs, float), start, goal, float(one.margins))
        most = float(one.available) * (1.0 - 4.0 * rounding_margin(len(times)))
        mission = rearrange.Still(times, np.asarray(graph.priority, float), most)
    else:
        mission = one.clocked(start)
    return how.improved(nodes, found, mission, one)


def _at_fastest(graphs: MissionGraph) -> MissionGraph:
    """Return stacked graphs with speeds to choose from, on which each edge takes its least time."""
    options, clocked = graphs.options, graphs.timetable is not None
    assert options is not None
    if clocked != options.clocked:
        raise ValueError(
            "travel times of options must be by departure where there is a timetable, and only there"
        )
    times = options.travel_time.min(axis=1)
    timetable = None if graphs.timetable is None else replace(graphs.timetable, travel_time=times)
    least = times.min(axis=1) if clocked else times
    known = np.isfinite(least)
    adjacency, travel_time = graphs.adjacency & known, np.where(known, least, np.nan)
    return replace(graphs, adjacency=adjacency, travel_time=travel_time, timetable=timetable)


def _each(stacked: T) -> list[T]:
    """Return B graphs, or parts of them, that are stacked along an axis, one by one."""
    count = len(jax.tree.leaves(stacked)[0])
    return [jax.tree.map(lambda leaf, b=b: leaf[b], stacked) for b in range(count)]


def _on_levels(edges: Edges, graphs: MissionGraph, levels: list[np.ndarray], more: int) -> Edges:
    """Return edges with the speeds of levels [L, N, N] of each graph, `more` waypoints added."""
    rows, square = [], [(0, more), (0, more)]
    for graph, chosen in zip(_each(graphs), levels, strict=True):
        options = graph.options
        assert options is not None
        times = np.stack([options.at(row) for row in chosen])
        travel = np.where(graph.adjacency, times.min(axis=1) if options.clocked else times, np.inf)
        power = options.power[chosen]
        parts = travel + graph.duration, power, taken(power, travel) + options.fixed
        padded = [np.pad(part, [(0, 0), *square], constant_values=np.inf) for part in parts]
        timetable = None
        if graph.timetable is not None:
            each = [replace(graph.timetable, travel_time=row).padded(more) for row in times]
            timetable = jax.tree.map(lambda *leaves: np.stack(leaves), *each)
        waiting = options.waiting
        if waiting is not None:
            waiting = np.pad(waiting, [(0, more_departures(len(waiting))), (0, more)], mode="edge")
        rows.append((*padded, np.pad(graph.duration, square), timetable, waiting))
    return edges.on_levels(*jax.tree.map(lambda *leaves: np.stack(leaves), *rows))


def _with_more(keys: jax.Array, missions: Missions) -> tuple[jax.Array, Missions]:
    """Return B missions once more with each of `_MORE` of time and energy, behind them."""
    count, batch = 1 + len(_MORE), len(missions.start)
    whole = jax.tree.map(lambda leaf: np.concatenate([leaf] * count), missions)
    more = np.repeat(np.asarray([1.0, *_MORE], np.float32), batch)
    time, energy = more * whole.time_available, more * whole.energy_available
    return keys[np.resize(np.arange(batch), count * batch)], replace(
        whole, time_available=time, energy_available=energy
    )


def _richer(routes: np.ndarray, least: float, graph: MissionGraph) -> Iterator[np.ndarray]:
    """Yield routes [C, N] of more priority than `least`, the richest first."""
    routes = np.unique(routes, axis=0)
    here, there = routes[:, :-1], routes[:, 1:]
    worth = np.where(there >= 0, graph.priority[here, there], 0.0).sum(axis=1)
    order = np.argsort(-worth, kind="stable")
    yield from routes[order[worth[order] > least + 1e-9]][
        : _TRIED if graph.timetable is None else _TRIED // 5
    ]


def _with_speeds(found: np.ndarray, asked: _Asked, how: _Choice) -> tuple[np.ndarray, _Asked, RouteSpeeds]:
    """Choose routes [B, N] and their speeds, within time and energy, among those found.

    Those of the first B rows of `found` [R B, P, N] keep their limits on some level, the first of each row is
    the best; the others may keep them at other speeds.

    Returns:
        Routes, what is asked at their speeds, and these.
    """
    nodes, rows, chosen = found[: len(asked.legs), 0].copy(), [], np.zeros(asked.legs.shape, int)
    graphs = _each(asked.graphs)
    options = [graph.options for graph in graphs if graph.options is not None]
    for b, (route, one, option) in enumerate(zip(nodes, _each(asked), options, strict=True)):
        graph, limits = one.graphs, (asked.available[b], how.energy[b])
        given = graph.timetable, graph.duration, limits, how.saves, how.levels[b]
        known = asked.along(graph.priority[None], route[None]).sum() if route[1] >= 0 else -1.0
        others = found[b :: len(nodes)].reshape(-1, len(route))
        others = others[(others == asked.goals[b]).any(axis=1)]
        # Rounding of the search may leave the route itself no room for the margin.
        margin = float(asked.margins[b])
        tried = [*((other, margin) for other in _richer(others, known, graph)), (route, margin), (route, 0.0)]
        best = None
        for other, longer in tried:
            if (best := option.for_route(other[other >= 0], *given, longer)) is not None:
                route[:] = other
                break
        if best is None:
            route[1:] = -1
            best = how.levels[b][-1]

        for effort in how.efforts[b : b + 1]:
            for new in _ways(route.copy(), others, one, how.energy[b], effort):
                other = option.for_route(new[new >= 0], *given, margin)
                if other is not None and _rank(graph, new, other, how) < _rank(graph, route, best, how):
                    route[:], best = new, other
        chosen[b] = best
        rows.append(graph.at_speeds(best))
    at, open_ = MissionGraph.stack(rows), np.isfinite(asked.legs)
    asked = asked._replace(graphs=at, legs=np.where(open_, at.leg_times(1.0), np.inf))
    speeds, power = (
        np.stack([getattr(option, name)[found] for option, found in zip(options, chosen, strict=True)])
        for name in ("speeds", "power")
    )
    fixed = np.stack([option.fixed for option in options])
    leg_times = asked.along(asked.legs, nodes) if at.timetable is None else _by_the_clock(at, nodes)[0]
    with np.errstate(invalid="ignore"):
        under_way = asked.along(power, nodes) * (leg_times - asked.along(at.duration, nodes))
    energies = under_way + asked.along(fixed, nodes)
    for b, (route, graph, option) in enumerate(zip(nodes, rows, options, strict=True)):
        if option.waiting is not None and (count := int((route >= 0).sum()) - 1):
            legs = route[:count], route[1 : count + 1]
            passed, tasks = graph.itinerary(route[: count + 1], 1.0), graph.duration[legs]
            energies[b, :count] = option.spent(legs, chosen[b][legs], passed, tasks, graph.timetable)
    legs = asked.along(speeds, nodes)
    assert at.options is not None
    return nodes, asked, RouteSpeeds(at.options, chosen, legs, energies, how.energy, at.duration, open_)


def _rank(graph: MissionGraph, nodes: np.ndarray, places: np.ndarray, how: _Choice) -> tuple[float, float]:
    """Return a key of a route [N] at places [N, N] of speeds, less for a better one."""
    route, option, table = nodes[nodes >= 0], graph.options, graph.timetable
    legs, lost = (route[:-1], route[1:]), 0.0
    assert option is not None
    if table is None:
        lasts, joules = option.along(route, places)
    else:
        passed = graph.at_speeds(places).itinerary(route, 1.0)
        lasts = passed.ends - passed.departs
        joules = option.spent(legs, places[legs], passed, graph.duration[legs], table)
        lost = sum(map(table.lost, *np.asarray(legs), passed.begins))
    saved = joules if how.saves == "energy" else lasts
    return lost - float(graph.priority[legs].sum()), float(saved.sum())


def _collect(
    result: Any,
    nodes: np.ndarray,
    least: np.ndarray,
    asked: _Asked,
    how: _Choice | None = None,
) -> MissionRoutes:
    """Return routes [B, N], padded with -1, that a search found, added up in double precision.

    Where speeds are to be chosen, `nodes` are those among which `_with_speeds` chooses.
    """
    speeds, edge_times = None, asked.legs
    if how is not None:
        nodes, asked, speeds = _with_speeds(nodes, asked, how)
    graphs, legs, goals, available, margins = asked
    reached = (nodes == goals[:, None]).any(axis=1) & (available >= 0.0)
    late = (1.0 + margins) * least >= available * (1.0 - 4.0 * rounding_margin(legs.shape[1]))
    lacking = np.zeros(len(nodes), bool)
    if speeds is not None:
        for b in np.flatnonzero(~reached & ~late):
            lacking[b] = _lacks_energy(_each(speeds)[b], int(nodes[b, 0]), int(goals[b]), available[b])
    leg_times = asked.along(legs, nodes)
    waits = lost = np.zeros_like(leg_times)
    if graphs.timetable is not None:
        leg_times, waits, lost = _by_the_clock(graphs, nodes)
        kept = leg_times.sum(axis=1) < available
        reached &= kept
        nodes[~kept, 1:], leg_times[~kept], waits[~kept], lost[~kept] = -1, 0.0, 0.0, 0.0
    taken = nodes[:, 1:] >= 0
    rho = asked.along(graphs.priority, nodes) - np.where(taken, lost, 0.0)
    return MissionRoutes(
        nodes=nodes,
        count=1 + taken.sum(axis=1),
        time=leg_times.sum(axis=1),
        priority=rho.sum(axis=1),
        tasks=(rho > 0.0).sum(axis=1),
        cost=result.cost,
        leg_times=leg_times,
        waits=waits,
        status=tuple(_status(*row) for row in zip(reached, least, late, lacking, strict=True)),
        least_time=least,
        time_available=available,
        population=result.state.population,
        history=result.history,
        edge_times=edge_times,
        edge_priority=graphs.priority,
        goals=goals,
        return_margin=margins,
        timetable=graphs.timetable,
        duration=None if graphs.timetable is None else graphs.duration,
        speeds=speeds,
    )


def _by_the_clock(graphs: MissionGraph, nodes: np.ndarray) -> np.ndarray:
    """Return, of routes padded with -1, [3, B, N - 1]: s of each leg, s of waiting in it, priority lost."""
    times, waits, lost = found = np.zeros((3, len(nodes), nodes.shape[1] - 1))
    for row, (route, graph) in enumerate(zip(nodes, _each(graphs), strict=True)):
        assert graph.timetable is not None
        passed = graph.itinerary(route[route >= 0], 1.0)
        count = len(passed.ends)
        times[row, :count] = passed.ends - passed.departs
        with np.errstate(invalid="ignore"):  # from a leg that cannot be done on all is infinite
            waits[row, :count] = passed.begins - passed.arrives
        for leg, (i, j) in enumerate(pairwise(route[route >= 0].tolist())):
            lost[row, leg] = graph.timetable.lost(i, j, passed.begins[leg])
    return found


def _status(reached: bool, least: float, late: bool, lacking: bool) -> MissionStatus:
    if reached:
        return MissionStatus.OK
    if not np.isfinite(least):
        return MissionStatus.UNREACHABLE
    if late:
        return MissionStatus.OUT_OF_TIME
    return MissionStatus.OUT_OF_ENERGY if lacking else MissionStatus.NOT_FOUND


def _lacks_energy(speeds: RouteSpeeds, start: int, goal: int, available: float) -> bool:
    """Return whether it is certain that no route keeps time and energy both, at any speeds."""
    return any(time_to_go(share, goal)[start] > 1.0 + 1e-9 for share in speeds.shares(available))


def _indices(name: str, values: Any, batch: int, size: int) -> np.ndarray:
    found = np.asarray(values)
    if found.shape not in ((), (batch,)):
        raise ValueError(f"{name} must be one index or [{batch}], got shape {found.shape}")
    if not np.issubdtype(found.dtype, np.integer) or found.min() < 0 or found.max() >= size:
        raise ValueError(f"{name} must be an index in [0, {size}), got {np.unique(found)}")
    return np.broadcast_to(found, (batch,)).astype(np.int32)


def _given(populations: Any, batch: int, size: int, config: MissionConfig) -> tuple[np.ndarray, int]:
    """Populations padded to [B, P, D], and how many habitats were given."""
    shape = (batch, config.bbo.population, decoders.siv_count(size, config.decoder))
    padded = np.zeros(shape, np.int32)
    if populations is None:
        return padded, 0
    populations = np.asarray(populations)
    fits = populations.ndim == 3 and populations.shape[0] == batch and populations.shape[2] == shape[2]
    if not fits or populations.shape[1] > shape[1]:
        raise ValueError(
            f"population must be [Q <= {shape[1]}, {shape[2]}] for each of {batch} missions, "
            f"got shape {populations.shape}"
        )
    count = populations.shape[1]
    padded[:, :count] = np.clip(populations, decoders.LOWEST, decoders.HIGHEST)
    return padded, count


def _known(routes: Any, starts: np.ndarray, goals: np.ndarray, size: int) -> np.ndarray:
    """Known routes padded to [B, N] with -1."""
    padded = np.full((len(starts), size), -1, np.int32)
    if routes is None:
        return padded
    if len(routes) != len(starts):
        raise ValueError(f"known_routes must hold one route or None for each of {len(starts)} missions")
    for row, route, start, goal in zip(padded, routes, starts, goals, strict=True):
        if route is None:
            continue
        nodes = np.asarray(route)
        fits = nodes.ndim == 1 and nodes.size and len(np.unique(nodes)) == len(nodes) <= size
        if not fits or not np.isin(nodes, np.arange(size)).all() or tuple(nodes[[0, -1]]) != (start, goal):
            raise ValueError(
                f"known_route must lead from {start} to {goal} and visit no waypoint twice, got {route}"
            )
        row[: len(nodes)] = nodes
    return padded
