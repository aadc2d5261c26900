"""Orders by the clock, against an exhaustive search that looks times up by itself."""

from itertools import pairwise

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.mission import MissionConfig, MissionGraph, plan_mission
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


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10_000),
    closing=st.sampled_from([0.0, 0.1, 0.3]),
    budget=st.floats(300.0, 1700.0),
)
def test_orders_are_as_good_as_the_exhaustive_search(seed, closing, budget):
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
        assert time < budget
