"""Routes by the clock, against an exhaustive search that looks times up by itself."""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.mission import MissionConfig, MissionGraph, check_route, plan_mission, plan_missions
from auvplan.mission.timetable import Schedule, Timetable, stages
from auvplan.runtime.compiled import compilations

#: One size of graphs, so that all cases share their programs.
SIZE, DEPARTURES, HORIZON = 9, 7, 1800.0
QUICK = MissionConfig.quick()

#: A search that leaves everything to find.
POOR = QUICK.replace(seeds=0, plant=False, local_rounds=0, bbo=QUICK.bbo.replace(iterations=1))


def clocked(
    seed: int, closing: float, windows: int, waiting: bool = True, along: int = 0, falls: int = 0
) -> MissionGraph:
    """Waypoints with a task each, in a sea that changes, on edges that close now and then.

    Some edges have so many windows `along` them, and priorities fall so often.
    """
    rng = np.random.default_rng(seed)
    positions = np.c_[rng.uniform(0.0, 800.0, (SIZE, 2)), np.zeros(SIZE)]
    distance = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    phase, strength = rng.uniform(0.0, 6.3, (SIZE, SIZE)), rng.uniform(0.0, 0.6)
    departures = np.linspace(0.0, HORIZON, DEPARTURES)
    swell = 1.0 + strength * np.sin(departures[:, None, None] / 400.0 + phase)
    travel = distance / 1.5 * swell
    travel[rng.random(travel.shape) < closing] = np.inf
    adjacency = (rng.random((SIZE, SIZE)) < 0.7) & ~np.eye(SIZE, dtype=bool)
    rho, task = rng.integers(1, 6, SIZE).astype(float), rng.uniform(10.0, 120.0, SIZE)
    rho[[0, -1]] = task[[0, -1]] = 0.0
    opens = rng.uniform(-600.0, HORIZON, (SIZE, windows))
    closes = opens + rng.uniform(100.0, 900.0, (SIZE, windows))
    free = rng.random(SIZE) < 0.3
    free[[0, -1]] = True
    opens[free], closes[free] = -np.inf, np.inf
    opens, closes = _padded(rng, opens, closes, (np.inf, -np.inf))
    graph = MissionGraph(
        positions,
        adjacency,
        np.broadcast_to(rho, (SIZE, SIZE)).copy(),
        np.broadcast_to(task, (SIZE, SIZE)).copy(),
    )
    square = (SIZE, SIZE, windows)
    return graph.with_timetable(
        Timetable(
            departures,
            travel,
            np.broadcast_to(opens, square).copy(),
            np.broadcast_to(closes, square).copy(),
            *_along_edges(rng, along),
            *_falling(rng, rho, falls),
            waiting,
        )
    )


def _along_edges(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Windows of edges, of a third of them."""
    enters = rng.uniform(-300.0, 0.8 * HORIZON, (SIZE, SIZE, count))
    until = enters + rng.uniform(500.0, 1500.0, enters.shape)
    free = rng.random((SIZE, SIZE, 1)) < 0.7
    enters, until = np.where(free, -np.inf, enters), np.where(free, np.inf, until)
    return _padded(rng, enters, until, (np.inf, -np.inf))


def _padded(
    rng: np.random.Generator, first: np.ndarray, last: np.ndarray, none: tuple[float, float]
) -> tuple:
    """Some rows [..., K] with entries for none in their last places, as those of fewer windows have."""
    count = first.shape[-1]
    unused = np.arange(count) >= rng.integers(1, max(count, 1), first.shape[:-1], endpoint=True)[..., None]
    return np.where(unused, none[0], first), np.where(unused, none[1], last)


def _falling(rng: np.random.Generator, rho: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """When priorities fall, and to some whole number less."""
    falls = rng.uniform(0.0, HORIZON, (SIZE, count))
    drops = np.floor(rng.random((SIZE, count)) * rho[:, None] / max(count, 1))
    falls, drops = _padded(rng, falls, drops, (np.inf, 0.0))
    return tuple(np.broadcast_to(part, (SIZE, SIZE, count)).copy() for part in (falls, drops))


class Edge(NamedTuple):
    """What a timetable says of one edge, in plain numbers."""

    departures: list[float]
    travel: list[float]
    starts: list[tuple[float, float]]
    entries: list[tuple[float, float]]
    falls: list[tuple[float, float]]
    task: float
    priority: float
    waiting: bool

    @classmethod
    def of(cls, graph: MissionGraph, i: int, j: int) -> "Edge":
        table = graph.timetable
        names = ("opens", "closes"), ("enters", "until"), ("falls", "drops")
        pairs = [
            list(zip(*(getattr(table, name)[i, j].tolist() for name in pair), strict=True)) for pair in names
        ]
        worth = float(graph.duration[i, j]), float(graph.priority[i, j])
        return cls(
            table.departures.tolist(), table.travel_time[:, i, j].tolist(), *pairs, *worth, table.waiting
        )

    def done(self, time: float) -> float:
        """When the task is done on a leg begun at a time: all that may be done, the best of it."""
        if not self.entries:
            return self._begun(self._crossed(time))
        ends = []
        for enters, until in self.entries:
            if not self.waiting and time < enters:
                continue
            arrival = self._crossed(max(time, enters))
            if arrival + self.task <= until:
                ends.append(self._begun(arrival))
        return min(ends, default=np.inf)

    def _crossed(self, time: float) -> float:
        """When the edge is passed that is entered at a time or later."""
        departures, travel = self.departures, self.travel
        before = max(k for k, departs in enumerate(departures) if departs <= time)
        arrivals = [time + travel[before]]
        if departures[before] < time and before < DEPARTURES - 1:
            weight = (time - departures[before]) / (departures[before + 1] - departures[before])
            ends = travel[before], travel[before + 1]
            arrivals = [np.inf if np.inf in ends else time + (1.0 - weight) * ends[0] + weight * ends[1]]
        if self.waiting:
            arrivals += [departures[k] + travel[k] for k in range(before + 1, DEPARTURES)]
        return min(arrivals)

    def _begun(self, arrival: float) -> float:
        """When the task is done after an arrival."""
        if not self.starts:
            return arrival + self.task
        served = (pair for pair in self.starts if arrival <= pair[1] and (self.waiting or arrival >= pair[0]))
        return min((max(arrival, opens) for opens, _ in served), default=np.inf) + self.task

    def worth(self, done: float) -> float:
        """Priority of a task that is done at a time: what has not fallen when it begins."""
        return self.priority - sum(drop for falls, drop in self.falls if done - self.task > falls)


def looked_up(graph: MissionGraph, i: int, j: int, time: float) -> float:
    """When the task at j is done on a leg from i begun at a time."""
    return Edge.of(graph, i, j).done(time)


def best_priority(graph: MissionGraph, budget: float) -> float:
    """Most total priority of all routes in time, over pairs of waypoints visited and place."""
    goal, edges = (
        SIZE - 1,
        {edge: Edge.of(graph, *edge) for edge in map(tuple, np.argwhere(graph.adjacency).tolist())},
    )
    onwards = {i: [j for k, j in edges if k == i] for i in range(SIZE)}
    fronts, best = {(1, 0): [(0.0, 0.0)]}, -np.inf
    for _ in range(SIZE - 1):
        onward: dict[tuple[int, int], list[tuple[float, float]]] = {}
        for (seen, i), front in fronts.items():
            for j in onwards[i]:
                if seen >> j & 1:
                    continue
                for time, gained in front:
                    done = edges[i, j].done(time)
                    if done >= budget:
                        continue
                    more = gained + edges[i, j].worth(done)
                    if j == goal:
                        best = max(best, more)
                        continue
                    others = onward.setdefault((seen | 1 << j, j), [])
                    if not graph.timetable.waiting:
                        others.append((done, more))  # one that comes later may be in time for a window
                    elif not any(t <= done and g >= more for t, g in others):
                        others[:] = [(t, g) for t, g in others if t < done or g > more] + [(done, more)]
        fronts = onward
    return best


@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10_000),
    closing=st.sampled_from([0.0, 0.1, 0.3]),
    budget=st.floats(300.0, 1700.0),
)
def test_routes_are_as_good_as_the_exhaustive_search(seed, closing, budget):
    """With windows at tasks and along edges, and falling priorities."""
    check_against_the_exhaustive_search(seed, closing, budget, along=2, falls=2)


#: Cases of routes that may not wait, from so many seeds on.
UNWAITING = 500_000


def check_without_waiting(seed: int) -> None:
    """A case of seven to nine waypoints whose vehicle may not wait, whatever else it knows beforehand."""
    rng = np.random.default_rng(seed)
    closing, budget = float(rng.choice([0.0, 0.1, 0.3])), float(rng.uniform(300.0, 1700.0))
    graph, best = check_against_the_exhaustive_search(
        seed, closing, budget, along=2, falls=2, waiting=False, absent=int(rng.integers(0, 3))
    )
    if not np.isfinite(best) or seed % 8:
        return
    # A search that finds nothing by itself keeps the known route, and the exact one proves the best.
    common = {"speed": 1.5, "key": jax.random.key(seed)}
    known = plan_mission(graph, 0, SIZE - 1, budget, **common, config=QUICK)
    kept = plan_mission(graph, 0, SIZE - 1, budget, **common, config=POOR, known_route=known.nodes)
    assert kept.priority == best
    proved = plan_mission(graph, 0, SIZE - 1, budget, **common, config=POOR, method="exact")
    assert proved.priority == best == proved.bound


@pytest.mark.parametrize("first", [8, *(pytest.param(k, marks=pytest.mark.slow) for k in (0, 16, 24))])
def test_routes_without_waiting_are_as_good_as_the_exhaustive_search(first):
    """An edge that is closed when the mission begins opens later; an earlier arrival need not be better."""
    for seed in range(first, first + 8):
        check_without_waiting(UNWAITING + seed)


@pytest.mark.slow
def test_2000_more_cases_equal_the_exhaustive_search():
    for seed in range(1000, 2000):
        check_without_waiting(UNWAITING + seed)
        rng = np.random.default_rng(seed)
        closing, budget = float(rng.choice([0.0, 0.1, 0.3])), float(rng.uniform(300.0, 1700.0))
        more = {"along": 2, "falls": 2} if seed % 2 else {}
        check_against_the_exhaustive_search(20_000 + seed, closing, budget, **more)


def test_a_route_that_may_not_wait_takes_an_edge_that_opens_under_way():
    """Of two jobs the richer one lies behind an edge that is closed at the departure."""
    adjacency, goal, square = np.zeros((SIZE, SIZE), bool), SIZE - 1, (SIZE, SIZE, 2)
    adjacency[[0, 0, 1, 1, 2], [1, 2, 2, goal, goal]] = True
    travel = np.where(adjacency, 100.0, np.inf) * np.ones((DEPARTURES, 1, 1))
    travel[0, 1, 2] = travel[0, 2, goal] = np.inf
    priority = np.zeros((SIZE, SIZE))
    priority[:, 1:3] = 1.0, 5.0
    always = np.full(square, -np.inf), np.full(square, np.inf)
    never = np.full(square, np.inf), np.zeros(square)
    departures = np.linspace(0.0, 300.0, DEPARTURES)
    graph = MissionGraph(np.eye(SIZE, 3), adjacency, priority, np.zeros((SIZE, SIZE)))
    graph = graph.with_timetable(Timetable(departures, travel, *always, *always, *never, waiting=False))
    common = {"speed": 1.0, "key": jax.random.key(0), "config": QUICK}
    for options in ({}, {"known_route": [0, 1, 2, goal]}, {"method": "exact"}):
        found = plan_mission(graph, 0, goal, 400.0, **common, **options)
        assert found.nodes.tolist() == [0, 1, 2, goal]
        assert found.priority == 6.0


def test_a_line_with_two_windows_is_gone_through_beside_edges_with_one():
    """Rows of fewer windows are padded with plus and minus infinity, which no vehicle enters at."""
    table = Timetable(
        np.array([0.0, 600.0]),
        np.full((2, 2, 2), 100.0),
        enters=np.broadcast_to([-np.inf, np.inf], (2, 2, 2)),
        until=np.broadcast_to([np.inf, -np.inf], (2, 2, 2)),
    )
    assert stages(table, np.zeros((2, 2)), [0, 1]).ends.tolist() == [100.0]


def check_against_the_exhaustive_search(
    seed: int, closing: float, budget: float, absent: int = 0, **more: int
) -> tuple[MissionGraph, float]:
    """Plan a case, of which so many waypoints are absent; return it and its optimum."""
    graph = clocked(seed, closing, 2, **more).without_waypoints(range(1, 1 + absent))
    found = plan_mission(graph, 0, SIZE - 1, budget, speed=1.5, key=jax.random.key(seed), config=QUICK)
    best = best_priority(graph, budget)
    assert found.feasible == np.isfinite(best)
    if found.feasible:
        assert found.priority == best
        assert found.bound >= found.priority - 1e-6
        assert graph.timetable.waiting or not found.waits.any()
        time = 0.0
        for (i, j), seconds in zip(pairwise(found.nodes.tolist()), found.leg_times, strict=True):
            assert time + seconds == pytest.approx(looked_up(graph, i, j, time), abs=1e-6)
            time += seconds
        assert time == pytest.approx(found.time)
        assert check_route(graph, found.nodes, 0, SIZE - 1, budget, 1.5)
        # Sums of the same legs in another order differ in the last digits.
        assert not check_route(graph, found.nodes, 0, SIZE - 1, found.time - 1e-6, 1.5).in_time
    return graph, best


def in_twenties(seed: int, steady: bool) -> tuple[MissionGraph, float]:
    """A case whose times are all multiples of 20 s: tasks begin just as windows close. And its time."""
    rng = np.random.default_rng(seed)
    graph = clocked(seed, float(rng.choice([0.0, 0.1, 0.3])), 2, along=2, falls=2)
    table = graph.timetable

    def rounded(values: np.ndarray) -> np.ndarray:
        return 20.0 * np.round(values / 20.0)

    travel = np.where(np.isinf(table.travel_time), np.inf, table.least) if steady else table.travel_time
    moments = {
        name: rounded(getattr(table, name)) for name in ("opens", "closes", "enters", "until", "falls")
    }
    table = replace(table, travel_time=rounded(travel), **moments)
    graph = replace(graph, duration=rounded(graph.duration), timetable=None).with_timetable(table)
    return graph, 20.0 * rng.integers(15, 85)


@pytest.mark.parametrize(
    ("seeds", "steady"),
    [((5031, 5065, 5195, 5204, 5324, 5394), True), ((5014, 5116, 5195, 5204, 5244, 5272), False)],
)
def test_what_is_done_at_the_last_moment_is_done(seeds, steady):
    """All of these lost a task to rounding in single precision."""
    cases = [in_twenties(seed, steady) for seed in seeds]
    graphs, available = MissionGraph.stack([graph for graph, _ in cases]), [time for _, time in cases]
    ends = [0] * len(seeds), [SIZE - 1] * len(seeds)
    found = plan_missions(graphs, *ends, available, speed=1.5, key=jax.random.key(1), config=QUICK)
    np.testing.assert_array_equal(found.priority, list(map(best_priority, *zip(*cases, strict=True))))
    assert found.feasible.all()


def test_a_known_route_of_the_last_moment_is_kept():
    graph, available = in_twenties(5204, steady=True)
    common = {"speed": 1.5, "key": jax.random.key(0)}
    best = plan_mission(graph, 0, SIZE - 1, available, **common, config=QUICK)
    kept = plan_mission(graph, 0, SIZE - 1, available, **common, config=POOR, known_route=best.nodes)
    assert kept.priority == best.priority == best_priority(graph, available)


@pytest.mark.parametrize("seed", [5, *(pytest.param(k, marks=pytest.mark.slow) for k in range(5))])
def test_labels_prove_the_best_route_from_nothing_and_the_bound_holds(seed):
    """A search that is cut short leaves something to find; labels prove what the exhaustive search finds."""
    graph = clocked(40_000 + seed, 0.1, 2, along=seed % 3, falls=2 * (seed % 2))
    common = {"speed": 1.5, "key": jax.random.key(seed), "config": POOR}
    plain = plan_mission(graph, 0, SIZE - 1, 1500.0, **common)
    proved = plan_mission(graph, 0, SIZE - 1, 1500.0, **common, method="exact")
    best = best_priority(graph, 1500.0)
    assert proved.feasible == np.isfinite(best)
    if proved.feasible:
        assert proved.priority == best == proved.bound
        assert plain.priority <= best <= plain.bound + 1e-9
        now = 0.0
        for i, j in pairwise(proved.nodes.tolist()):
            now = looked_up(graph, i, j, now)
        assert now == pytest.approx(proved.time)


@pytest.mark.slow
def test_a_steady_timetable_changes_nothing():
    """One departure, no windows: the same route as without a timetable, and the same times."""
    graph = clocked(3, 0.0, 0)
    steady = graph.with_timetable(Timetable(np.zeros(1), graph.timetable.travel_time[:1]))
    plain = replace(steady, timetable=None)
    ways = [
        plan_mission(one, 0, SIZE - 1, 1200.0, speed=1.5, key=jax.random.key(1), config=QUICK)
        for one in (steady, plain)
    ]
    assert ways[0].nodes.tolist() == ways[1].nodes.tolist()
    np.testing.assert_allclose(ways[0].leg_times, ways[1].leg_times)


@pytest.mark.parametrize("along", [0, 2])
@pytest.mark.parametrize("waiting", [True, False])
def test_waits_and_the_time_under_way_are_those_of_each_edge_by_itself(waiting, along):
    graph = clocked(7, 0.3, 2, waiting, along)
    table = graph.timetable
    assert table is not None
    schedule = replace(
        Schedule.whole(table, graph.duration), later_travel=np.moveaxis(table.later_travel, -3, -1)
    )
    waited = 0
    for now in np.linspace(0.0, 1.1 * HORIZON, 12):
        for i, j in zip(*np.nonzero(graph.adjacency), strict=True):
            passed = stages(table, graph.duration, [i, j], now)
            if not np.isfinite(passed.ends[0]):
                continue
            with np.errstate(invalid="ignore"):  # of departures at which the edge is shut
                found = schedule.stages(np.asarray(i), np.asarray(j), np.asarray(now))
            times = now, passed.leaves[0], passed.arrives[0], passed.begins[0]
            np.testing.assert_allclose(found, np.diff(times), atol=1e-9)
            waited += found[0] > 1.0
    assert (waited > 20) == waiting


def test_windows_count_from_the_time_that_they_are_told_for():
    """Later on the way the same timetable says the same of the rest."""
    graph = clocked(5, 0.1, 2, along=2, falls=2)
    route = plan_mission(graph, 0, SIZE - 1, 1600.0, speed=1.5, key=jax.random.key(2), config=QUICK)
    whole = graph.itinerary(route.nodes, 1.5)
    for k, departs in enumerate(whole.ends[:-1], 1):
        later = replace(graph, timetable=graph.timetable.since(departs))
        rest = later.itinerary(route.nodes[k:], 1.5)
        np.testing.assert_allclose(rest.ends + departs, whole.ends[k:])
        assert (rest.leaves >= rest.departs).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"departures": [0.0, 1.0]}, "departures must be"),
        ({"departures": [0.0, 1.0, 3.0]}, "evenly spaced"),
        ({"travel_time": -np.ones((3, 2, 2))}, "must not be negative"),
        ({"opens": np.zeros((3, 3, 1))}, "opens must be"),
        ({"opens": np.zeros((2, 2, 1))}, "as many"),
    ],
)
def test_bad_timetables_are_refused(change, message):
    sound = {"departures": [0.0, 1.0, 2.0], "travel_time": np.ones((3, 2, 2))}
    with pytest.raises(ValueError, match=message):
        Timetable(**sound | change)


def test_batches_equal_single_missions_and_compile_once():
    graphs = [clocked(seed, 0.1, 2, along=2, falls=2) for seed in range(20, 23)]
    keys = jax.random.split(jax.random.key(4), 3)
    common = {"speed": 1.5, "config": POOR}
    together = plan_missions(MissionGraph.stack(graphs), [0] * 3, [SIZE - 1] * 3, 1500.0, key=keys, **common)
    alone = [plan_mission(graphs[0], 0, SIZE - 1, 1500.0, key=keys[0], **common)]
    before = compilations()
    alone += [plan_mission(graphs[k], 0, SIZE - 1, 1500.0, key=keys[k], **common) for k in (1, 2)]
    assert compilations() == before
    for one, other in zip(together, alone, strict=True):
        assert one.nodes.tolist() == other.nodes.tolist()
        assert one.time == other.time
