"""Graphs for the tests of the mission layer, and plain twins of it, one route at a time."""

import jax
import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from auvplan.mission import MissionConfig, MissionGraph
from auvplan.mission.problem import Edges, Problem, prepare
from benchmarks.missions.sets import GRAPHS, Case, task_graphs

needs_graphs = pytest.mark.skipif(
    not GRAPHS.exists(), reason=f"no task graphs with proven optima at {GRAPHS}"
)
prepare_now = jax.jit(prepare)

#: Settings of a small search: tests that plan with the same ones, on graphs of up to 16 waypoints, share
#: compiled programs. And those of a search that leaves what is known as it is.
QUICK = MissionConfig(
    bbo=MissionConfig().bbo.replace(population=20, iterations=10),
    seeds=4,
    beam_width=16,
    local_width=5,
    local_period=5,
)
#: A search without what takes longest to compile.
BARE = MissionConfig.quick().replace(seeds=0, plant=False, local_rounds=0)
PLAIN = MissionConfig.plain().replace(bbo=QUICK.bbo)
BLIND = PLAIN.replace(bbo=QUICK.bbo.replace(iterations=0))


def proven(name: str) -> Case:
    """A case whose optimum is proven."""
    return next(case for case in task_graphs() if case.name == name)


def problem(
    graph: MissionGraph, start: int, goal: int, budget: float, visited=None, margin: float = 0.0, speed=2.0
) -> Problem:
    """What routes through a graph are searched in."""
    closed = np.zeros(graph.size, bool) if visited is None else np.asarray(visited)
    edges = Edges.of(graph.leg_times(speed), graph.priority)
    return prepare_now(edges, start, goal, budget, closed, margin)


def grid_graph(
    seed: int, size: int, density: float, directed: bool = False, untasked: float = 0.2
) -> MissionGraph:
    """A random graph, possibly disconnected, some of whose edges carry no task."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform(0.0, 1000.0, (size, 3))
    adjacency = rng.random((size, size)) < density
    priority = np.where(rng.random((size, size)) < untasked, 0.0, rng.integers(1, 6, (size, size)))
    duration = rng.uniform(10.0, 100.0, (size, size))
    if not directed:
        upper = np.triu(np.ones((size, size), bool), 1)
        adjacency = np.where(upper, adjacency, adjacency.T)
        priority = np.where(upper, priority, priority.T)
        duration = np.where(upper, duration, duration.T)
    np.fill_diagonal(adjacency, False)
    return MissionGraph(positions, adjacency, priority, duration)


def time_to_go(legs: np.ndarray, goal: int) -> np.ndarray:
    """[N] s by Dijkstra on the reversed graph."""
    return dijkstra(csr_matrix(np.where(np.isfinite(legs), legs, 0.0).T), indices=goal)


def decode(
    habitat: np.ndarray,
    graph: MissionGraph,
    start: int,
    goal: int,
    budget: float,
    speed: float,
    decoder: str,
    rate_weight: float,
) -> list[int]:
    """The route that one habitat stands for, following the text of section 3.3 step by step."""
    legs = graph.leg_times(speed).copy()
    legs[:, start] = np.inf
    open_edges = np.isfinite(legs)
    togo = time_to_go(legs, goal)
    rate = np.where(open_edges, graph.priority / np.maximum(legs, 1.0), 0.0)
    mean = rate[rate > 0].mean() if (rate > 0).any() else 1.0
    share = rate_weight * (habitat[-1] + 200) / 300 if decoder == "rate" else 0.0
    route, time = [start], 0.0
    while route[-1] != goal:
        here, best, value = route[-1], None, -np.inf
        for j in range(graph.size):
            if j in route or not graph.adjacency[here, j]:
                continue
            if decoder != "paper" and time + legs[here, j] + togo[j] >= budget:
                continue
            worth = habitat[j] + share * rate[here, j] / mean
            if worth > value + 1e-4:
                best, value = j, worth
        if best is None:
            break
        time += legs[here, best]
        route.append(best)
    return route


def best_priority(graph: MissionGraph, start: int, goal: int, budget: float, speed: float) -> float | None:
    """Most total priority of any route within the budget, by depth-first search; None if there is none."""
    legs = graph.leg_times(speed)
    best: list[float] = []

    def visit(here: int, seen: frozenset[int], time: float, worth: float) -> None:
        if here == goal:
            best.append(worth)
            return
        for j in np.flatnonzero(graph.adjacency[here]):
            if j not in seen and time + legs[here, j] < budget:
                visit(int(j), seen | {int(j)}, time + legs[here, j], worth + graph.priority[here, j])

    visit(start, frozenset({start}), 0.0, 0.0)
    return max(best, default=None)
