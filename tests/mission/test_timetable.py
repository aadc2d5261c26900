"""Orders by the clock, against an exhaustive search that looks times up by itself."""

from dataclasses import replace
from itertools import pairwise

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.compiled import compilations
from auvplan.mission import MissionConfig, MissionGraph, check_order, plan_mission, plan_missions
from auvplan.mission.timetable import Timetable

#: One size of graphs, so that all cases share their programs.
SIZE, DEPARTURES, HORIZON = 9, 7, 1800.0
QUICK = MissionConfig().quick()


def clocked(seed: int, closing: float, windows: int, waiting: bool = True) -> MissionGraph:
    """Waypoints with a task each, in a sea that changes, on edges that close now and then."""
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
            waiting,
        )
    )


def looked_up(graph: MissionGraph, i: int, j: int, time: float) -> float:
    """When a task at j is done on a leg from i begun at a time: all that may be done, the best of it."""
    table = graph.timetable
    travel = [plane[i, j] for plane in table.travel_time]
    before = [k for k in range(DEPARTURES) if table.departures[k] <= time][-1]
    arrivals = []
    if table.departures[before] == time or before == DEPARTURES - 1:
        arrivals.append(time + travel[before])
    else:
        weights = np.interp(time, table.departures, np.arange(DEPARTURES)) - before
        ends = travel[before], travel[before + 1]
        arrivals.append(
            time + (1.0 - weights) * ends[0] + weights * ends[1] if np.isfinite(ends).all() else np.inf
        )
    if table.waiting:
        arrivals += [table.departures[k] + travel[k] for k in range(before + 1, DEPARTURES)]
    arrival, done = min(arrivals), []
    for opens, closes in zip(table.opens[i, j], table.closes[i, j], strict=True):
        if arrival <= closes and (table.waiting or arrival >= opens):
            done.append(max(arrival, opens))
    return (min(done, default=np.inf) if table.opens.shape[-1] else arrival) + graph.duration[i, j]


def best_priority(graph: MissionGraph, budget: float) -> float:
    """Most total priority of all orders in time, over pairs of waypoints visited and place."""
    goal = SIZE - 1
    earliest, best = {(1, 0): 0.0}, -np.inf
    for _ in range(SIZE - 1):
        onward: dict[tuple[int, int], float] = {}
        for (seen, i), time in earliest.items():
            for j in np.flatnonzero(graph.adjacency[i]).tolist():
                if seen >> j & 1:
                    continue
                done = looked_up(graph, i, j, time)
                if done >= budget:
                    continue
                if j == goal:
                    best = max(best, sum(graph.priority[0, k] for k in range(1, goal) if seen >> k & 1))
                    continue
                key = seen | 1 << j, j
                onward[key] = min(onward.get(key, np.inf), done)
        earliest = onward
    return best


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10_000),
    closing=st.sampled_from([0.0, 0.1, 0.3]),
    budget=st.floats(300.0, 1700.0),
)
def test_orders_are_as_good_as_the_exhaustive_search(seed, closing, budget):
    check_against_the_exhaustive_search(seed, closing, budget)


@pytest.mark.slow
def test_five_hundred_more_cases_are_as_good_as_the_exhaustive_search():
    rng = np.random.default_rng(99)
    for _ in range(500):
        seed, closing = int(rng.integers(20_000, 90_000)), float(rng.choice([0.0, 0.1, 0.3]))
        check_against_the_exhaustive_search(seed, closing, float(rng.uniform(300.0, 1700.0)))


def check_against_the_exhaustive_search(seed: int, closing: float, budget: float) -> None:
    graph = clocked(seed, closing, 2)
    found = plan_mission(graph, 0, SIZE - 1, budget, speed=1.5, key=jax.random.key(seed), config=QUICK)
    best = best_priority(graph, budget)
    assert found.feasible == np.isfinite(best)
    if found.feasible:
        assert found.priority == best
        assert found.bound >= found.priority - 1e-6
        time = 0.0
        for (i, j), seconds in zip(pairwise(found.nodes.tolist()), found.leg_times, strict=True):
            assert time + seconds == pytest.approx(looked_up(graph, i, j, time), abs=1e-6)
            time += seconds
        assert time == pytest.approx(found.time)
        assert check_order(graph, found.nodes, 0, SIZE - 1, budget, 1.5)
        # Sums of the same legs in another order differ in the last digits.
        assert not check_order(graph, found.nodes, 0, SIZE - 1, found.time - 1e-6, 1.5).in_time


def test_without_waiting_a_task_is_reached_in_its_window_or_left():
    """No order is late or early anywhere, whatever the search does with a problem that is not monotone."""
    for seed in range(12):
        graph = clocked(seed, 0.1, 2, waiting=False)
        found = plan_mission(graph, 0, SIZE - 1, 1500.0, speed=1.5, key=jax.random.key(0), config=QUICK)
        time = 0.0
        for i, j in pairwise(found.nodes.tolist()):
            time = looked_up(graph, i, j, time)
        assert np.isfinite(time)
        assert not found.feasible or time == pytest.approx(found.time)
        assert found.waits.sum() == 0.0


def test_a_steady_timetable_changes_nothing():
    """One departure, no windows: the same order as without a timetable, and the same times."""
    graph = clocked(3, 0.0, 0)
    steady = graph.with_timetable(Timetable(np.zeros(1), graph.timetable.travel_time[:1]))
    plain = replace(steady, timetable=None)
    ways = [
        plan_mission(one, 0, SIZE - 1, 1200.0, speed=1.5, key=jax.random.key(1), config=QUICK)
        for one in (steady, plain)
    ]
    assert ways[0].nodes.tolist() == ways[1].nodes.tolist()
    np.testing.assert_allclose(ways[0].leg_times, ways[1].leg_times)


def test_windows_count_from_the_time_that_they_are_told_for():
    """Later on the way the same timetable says the same of the rest."""
    graph = clocked(5, 0.1, 2)
    order = plan_mission(graph, 0, SIZE - 1, 1600.0, speed=1.5, key=jax.random.key(2), config=QUICK)
    whole = graph.itinerary(order.nodes, 1.5)
    for k, departs in enumerate(whole.ends[:-1], 1):
        later = replace(graph, timetable=graph.timetable.since(departs))
        rest = later.itinerary(order.nodes[k:], 1.5)
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
    graphs = [clocked(seed, 0.1, 2) for seed in range(20, 23)]
    keys = jax.random.split(jax.random.key(4), 3)
    common = {"speed": 1.5, "config": QUICK}
    together = plan_missions(MissionGraph.stack(graphs), [0] * 3, [SIZE - 1] * 3, 1500.0, keys=keys, **common)
    alone = [plan_mission(graphs[0], 0, SIZE - 1, 1500.0, key=keys[0], **common)]
    before = compilations()
    alone += [plan_mission(graphs[k], 0, SIZE - 1, 1500.0, key=keys[k], **common) for k in (1, 2)]
    assert compilations() == before
    for one, other in zip(together, alone, strict=True):
        assert one.nodes.tolist() == other.nodes.tolist()
        assert one.time == other.time
