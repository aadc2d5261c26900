"""The upper bounds against brute force, proven optima and whole missions that are re-planned."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.executive.loop import what_is_left
from auvplan.mission import MissionGraph, task_graph, trail_bound
from auvplan.mission.bound import common_step, edges_in_time, least_difference, rounded_down, upper_bound
from auvplan.runtime.formatting import rounded_up
from tests.mission.naive import best_priority, grid_graph, needs_graphs, proven
from tests.mission.naive import time_to_go as dijkstra_time_to_go

SPEED = 2.0


def with_priority(graph: MissionGraph, priority: np.ndarray) -> MissionGraph:
    return MissionGraph(graph.positions, graph.adjacency, priority, graph.duration)


@pytest.mark.parametrize("scale", [0.1, np.pi, None])
@pytest.mark.parametrize("seed", range(4))
def test_never_below_the_optimum(seed: int, scale: float | None) -> None:
    graph = grid_graph(seed, 6 + seed % 3, 0.6, directed=seed % 2 == 0)
    noise = np.random.default_rng(seed).uniform(0.0, 1.0, graph.priority.shape)
    graph = with_priority(graph, graph.priority * (noise if scale is None else scale))
    legs, goal = graph.leg_times(SPEED), graph.size - 1
    budget = 700.0 + 150.0 * seed
    optimum = best_priority(graph, 0, goal, budget, SPEED)
    bound = upper_bound(legs, graph.priority, 0, goal, budget)
    if optimum is None:
        assert bound == 0.0
    else:
        assert optimum <= bound <= 1.5 * optimum + 5.0 * graph.priority.max()
        assert bound <= upper_bound(legs, graph.priority, 0, goal, budget, rounds=1)


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    density=st.sampled_from([0.2, 0.5, 0.9]),
    directed=st.booleans(),
    slack=st.sampled_from([0.5, 1.0, 1.0001, 1.2, 3.0]),
)
def test_valid_also_at_the_edge_of_time(seed: int, density: float, directed: bool, slack: float) -> None:
    graph = grid_graph(seed, 7, density, directed)
    legs = graph.leg_times(SPEED)
    shortest = dijkstra_time_to_go(legs, 6)[0]
    budget = slack * shortest if np.isfinite(shortest) else 500.0
    optimum = best_priority(graph, 0, 6, budget, SPEED)
    bound = upper_bound(legs, graph.priority, 0, 6, budget)
    assert bound >= (optimum or 0.0)
    assert (bound > 0.0) <= (optimum is not None)


def test_a_detour_that_does_not_fit() -> None:
    """0 -> 1 -> 3 takes 20 s for 3, 0 -> 2 -> 3 takes 30 s for 8; then 2 -> 4 -> 3 comes in."""
    times, rho = np.full((5, 5), np.inf), np.zeros((5, 5))
    for i, j, seconds, worth in [(0, 1, 10, 1), (1, 3, 10, 2), (0, 2, 15, 4), (2, 3, 15, 4)]:
        times[i, j], rho[i, j] = seconds, worth
    assert [upper_bound(times, rho, 0, 3, budget) for budget in (20.0, 21.0, 29.9, 31.0)] == [
        0.0,
        3.0,
        3.0,
        8.0,
    ]
    times[2, 4], rho[2, 4] = 11.0, 6.0
    times[4, 3], rho[4, 3] = 11.0, 7.0
    assert upper_bound(times, rho, 0, 3, 38.0) == 17.0
    assert 8.0 <= upper_bound(times, rho, 0, 3, 36.0) < 17.0


def test_cycles_apart_from_the_path_are_cut_off() -> None:
    """A triangle of high priority, linked to the path by one slow edge, must be paid for."""
    times, rho = np.full((5, 5), np.inf), np.zeros((5, 5))
    times[0, 1], rho[0, 1] = 10.0, 1.0
    for i, j in [(2, 3), (3, 4), (4, 2)]:
        times[i, j], rho[i, j] = 1.0, 5.0
    times[0, 2] = times[4, 1] = 100.0
    assert upper_bound(times, rho, 0, 1, 1000.0) == 10.0
    assert upper_bound(times, rho, 0, 1, 100.0) == 1.0


def test_edges_of_no_duration_are_edges() -> None:
    times, rho = np.full((3, 3), np.inf), np.ones((3, 3))
    times[0, 1] = times[1, 2] = 0.0
    tails, heads = edges_in_time(times, 0, 2, 1.0)
    assert list(zip(tails, heads, strict=True)) == [(0, 1), (1, 2)]
    assert upper_bound(times, rho, 0, 2, 1.0) == 2.0
    assert upper_bound(times, rho, 0, 2, np.inf) == 2.0
    assert upper_bound(times, rho, 0, 2, 0.0) == 0.0


def test_nothing_to_gain() -> None:
    graph = grid_graph(0, 7, 0.9)
    legs = graph.leg_times(SPEED)
    assert upper_bound(legs, np.zeros((7, 7)), 0, 6, 1e4) == 0.0
    assert upper_bound(legs, graph.priority, 3, 3, 1e4) == 0.0


@pytest.mark.parametrize(
    ("values", "step"),
    [
        ([0.0, 2.0, 4.0, 6.0], 2.0),
        ([2.5, 10.0], 2.5),
        ([1.0 / 3.0, 1.0], 1.0 / 3.0),
        (np.arange(50) * 0.1, 0.1),
        ([0.7312345678], 0.7312345678),
        ([0.0], 0.0),
        ([1.0, np.sqrt(2.0)], 0.0),
        ([1.0, 1.0 + 1e-7], 0.0),
    ],
)
def test_common_step(values: list[float], step: float) -> None:
    assert common_step(values) == pytest.approx(step, rel=1e-12)


@pytest.mark.parametrize("step", [0.4, 0.1, 1.0 / 3.0])
def test_bounds_of_decimal_priorities_are_multiples_of_their_step(step: float) -> None:
    rng = np.random.default_rng(0)
    priority = step * rng.integers(1, 30, (12, 12))
    for steps in range(1, 60):
        bound = rounded_down((steps + 0.7) * step, priority)
        assert steps * step <= bound <= (steps + 1e-10) * step
        assert rounded_up(bound) == pytest.approx(steps * step, rel=1e-8)
    assert rounded_up(rounded_down(30.5 * 0.4, priority / step * 0.4)) == 12.0


def test_least_difference_is_that_of_edges_within_reach() -> None:
    times, priority = np.full((5, 5), np.inf), np.zeros((5, 5))
    legs = {(0, 1): 2.5, (1, 4): 7.5, (0, 2): 1000.0, (2, 4): 0.5, (1, 3): 0.1, (0, 4): 0.0}
    for leg, rho in legs.items():
        times[leg], priority[leg] = 10.0, rho
    times[0, 2] = 100.0
    asked = times, priority, (0, 4)
    assert least_difference(*asked, 50.0) == pytest.approx(2.5), "3 leads nowhere, 2 is too far away"
    assert least_difference(*asked, 200.0) == pytest.approx(0.5)
    assert least_difference(*asked, 15.0) == np.inf, "no task is within reach"
    falling = np.where(priority[..., None] == 7.5, [1.5, 5.0], 0.0)
    assert least_difference(*asked, 50.0, falling) == pytest.approx(0.5), "it falls from 7.5 to 6 and 1"
    priority[0, 1], priority[1, 4] = 1.0, np.pi
    assert 1e-4 < least_difference(*asked, 50.0) < 0.01, "as finely as single precision allows"
    priority[0, 1] = 1e-6
    assert least_difference(*asked, 50.0) == pytest.approx(1e-6), "not above what a task is worth"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"leg_times": np.zeros((2, 3))}, r"leg_times must be \[N, N\]"),
        ({"leg_times": np.full((7, 7), -1.0)}, "leg_times must not be negative"),
        ({"priority": np.zeros(7)}, "priority must be"),
        ({"priority": np.full((7, 7), np.nan)}, "priority must be finite"),
        ({"start": 7}, "start must be an index"),
        ({"goal": -1}, "goal must be an index"),
        ({"time_available": np.nan}, "time_available"),
        ({"rounds": 0}, "rounds must be at least 1"),
        ({"waypoint_priority": np.ones(3)}, r"waypoint_priority must be \[N\]"),
        ({"waypoint_duration": np.full(7, -1.0)}, "waypoint_duration must be finite and not negative"),
    ],
)
def test_bad_arguments_are_refused(change: dict, message: str) -> None:
    graph = grid_graph(0, 7, 0.9)
    arguments = {
        "leg_times": graph.leg_times(SPEED), "priority": graph.priority, "start": 0, "goal": 6,
        "time_available": 1e4, **change,
    }  # fmt: skip
    for bound in (trail_bound,) if any("waypoint" in name for name in change) else (upper_bound, trail_bound):
        with pytest.raises(ValueError, match=message):
            bound(**arguments)


@needs_graphs
@pytest.mark.parametrize(("name", "gap"), [("full40-s0", 0.03), ("knn40-s0", 0.03), ("rnd40-s0", 0.06)])
def test_close_to_the_proven_optimum(name: str, gap: float) -> None:
    case = proven(name)
    assert case.optimum <= upper_bound(*case.searched) <= (1.0 + gap) * case.optimum


# Waypoints that may be visited again


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


@settings(max_examples=15, deadline=None)
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


@settings(max_examples=20, deadline=None)
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
