"""The bound of missions that may visit waypoints again, and whole missions against their first bound."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.executive.loop import what_is_left
from auvplan.mission import MissionGraph, task_graph, trail_bound, upper_bound
from tests.mission.naive import grid_graph

SPEED = 2.0


def best_trail(graph: MissionGraph, budget: float) -> float | None:
    """Most total priority of any trail from 0 to the last waypoint, by depth-first search."""
    goal, best = graph.size - 1, []
    travel = graph.leg_times(SPEED) - np.where(graph.adjacency, graph.waypoint_duration, 0.0)
    own = graph.priority - np.where(graph.adjacency, graph.waypoint_priority, 0.0)

    def visit(here: int, used: frozenset, done: frozenset, time: float, worth: float) -> None:
        if here == goal:
            best.append(worth)
            return
        for j in np.flatnonzero(graph.adjacency[here]).tolist():
            pair = frozenset((here, j))
            first = j not in done
            later = time + travel[here, j] + first * graph.waypoint_duration[j]
            if j != here and pair not in used and later < budget:
                earned = own[here, j] + first * graph.waypoint_priority[j]
                visit(j, used | {pair}, done | {j}, later, worth + earned)

    visit(0, frozenset(), frozenset(), 0.0, 0.0)
    return max(best, default=None)


def with_waypoint_tasks(seed: int, size: int = 6, density: float = 0.5) -> MissionGraph:
    bare, rng = grid_graph(seed, size, density), np.random.default_rng(seed)
    edges = [(int(i), int(j)) for i, j in np.argwhere(np.triu(bare.adjacency, 1))]
    edge_tasks = [(i, j, float(bare.priority[i, j]), float(bare.duration[i, j])) for i, j in edges]
    waypoint_tasks = [(j, float(rng.integers(0, 6)), float(rng.uniform(0, 90))) for j in range(size)]
    return task_graph(bare.positions, edges, edge_tasks, waypoint_tasks)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), budget=st.sampled_from([300.0, 600.0, 900.0, 1500.0]))
def test_never_below_the_best_trail(seed: int, budget: float) -> None:
    graph = with_waypoint_tasks(seed)
    bound = trail_bound(
        graph.leg_times(SPEED), graph.priority, 0, graph.size - 1, budget,
        waypoint_priority=graph.waypoint_priority, waypoint_duration=graph.waypoint_duration,
    )  # fmt: skip
    assert bound >= (best_trail(graph, budget) or 0.0) - 1e-9


def test_a_trail_may_beat_every_route_that_visits_once() -> None:
    """0-1-2-0 and then 3: a loop back to the start pays, and no route without a repeat has as much."""
    edges = [(0, 1), (1, 2), (2, 0), (0, 3)]
    graph = task_graph(np.zeros((4, 3)), edges, [(i, j, 2.0, 10.0) for i, j in edges])
    times = graph.leg_times(SPEED)
    assert upper_bound(times, graph.priority, 0, 3, 100.0) == 2.0
    assert trail_bound(times, graph.priority, 0, 3, 100.0) == 8.0
    assert trail_bound(times, graph.priority, 0, 3, 39.0) < 8.0


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    visits=st.sampled_from(["once", "edges"]),
    budget=st.sampled_from([600.0, 1200.0, 3000.0]),
)
def test_a_mission_of_many_re_plans_counts_no_more_than_its_first_graph_allows(
    seed: int, visits: str, budget: float
) -> None:
    """Any legs over what is left, as slow as expected or slower: the sum of counted tasks is bounded."""
    first, rng = with_waypoint_tasks(seed, 8, 0.6), np.random.default_rng(seed)
    graph, here, goal, now, total = first, 0, first.size - 1, 0.0, 0.0
    worth, counted = [], set()
    while here != goal:
        onward = [int(j) for j in np.flatnonzero(graph.adjacency[here]) if j != here]
        if not onward:
            return
        j = int(rng.choice(onward))
        now += graph.leg_times(SPEED)[here, j] * rng.uniform(1.0, 1.3)
        total += float(graph.priority[here, j])
        worth.append(j)
        assert visits == "edges" or worth.count(j) == 1
        assert frozenset((here, j)) not in counted
        counted.add(frozenset((here, j)))
        graph, here = what_is_left(graph, here, j, visits), j
    if now >= budget:
        return
    common = (first.leg_times(SPEED), first.priority, 0, goal, budget)
    once = {"waypoint_priority": first.waypoint_priority, "waypoint_duration": first.waypoint_duration}
    bound = upper_bound(*common) if visits == "once" else trail_bound(*common, **once)
    assert total <= bound + 1e-6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"waypoint_priority": np.ones(3)}, r"waypoint_priority must be \[N\]"),
        ({"waypoint_duration": np.full(6, -1.0)}, "waypoint_duration must be finite and not negative"),
        ({"rounds": 0}, "rounds must be at least 1"),
    ],
)
def test_bad_arguments_are_refused(change: dict, message: str) -> None:
    graph = with_waypoint_tasks(0)
    with pytest.raises(ValueError, match=message):
        trail_bound(graph.leg_times(SPEED), graph.priority, 0, 5, 1000.0, **change)
