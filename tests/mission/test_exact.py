"""The exact search against brute force and proven optima."""

import sys
from itertools import pairwise

import numpy as np
import pytest

from auvplan.mission import check_route
from auvplan.mission.exact import in_ticks, solve_exact
from tests.mission.naive import best_priority, grid_graph, needs_graphs, proven

pytest.importorskip("ortools", reason="the exact search needs OR-Tools")

SPEED = 2.0


def diamond() -> tuple[np.ndarray, np.ndarray]:
    """0 -> 1 -> 3 takes 20 s for 3; 0 -> 2 -> 3 takes 30 s for 8."""
    times, rho = np.full((4, 4), np.inf), np.zeros((4, 4))
    for i, j, seconds, worth in [(0, 1, 10, 1), (1, 3, 10, 2), (0, 2, 15, 4), (2, 3, 15, 4)]:
        times[i, j], rho[i, j] = seconds, worth
    return times, rho


@pytest.mark.parametrize("scale", [0.1, None])
@pytest.mark.parametrize("seed", range(4))
def test_equals_brute_force(seed: int, scale: float | None) -> None:
    graph = grid_graph(seed, 6 + seed % 3, 0.6, directed=seed % 2 == 0)
    noise = np.random.default_rng(seed).uniform(0.0, 1.0, graph.priority.shape)
    rho = graph.priority * (noise if scale is None else scale)
    graph = type(graph)(graph.positions, graph.adjacency, rho, graph.duration)
    goal, budget = graph.size - 1, 700.0 + 150.0 * seed
    optimum = best_priority(graph, 0, goal, budget, SPEED)
    route = solve_exact(graph.leg_times(SPEED), rho, 0, goal, budget)
    assert route.proved
    assert route.infeasible == (optimum is None)
    if optimum is not None:
        assert check_route(graph, route.nodes, 0, goal, budget, SPEED)
        assert route.priority == pytest.approx(optimum, rel=1e-5)
        assert route.priority == pytest.approx(sum(rho[leg] for leg in pairwise(route.nodes)))
        assert optimum * (1.0 - 1e-12) <= route.bound <= optimum * (1.0 + 1e-5)


@pytest.mark.parametrize(
    ("budget", "nodes", "priority"),
    [(30.0, [0, 1, 3], 3.0), (30.0000001, [0, 2, 3], 8.0), (20.0, [], 0.0), (20.0005, [0, 1, 3], 3.0)],
)
def test_a_route_takes_strictly_less_than_the_time_available(
    budget: float, nodes: list[int], priority: float
) -> None:
    route = solve_exact(*diamond(), 0, 3, budget)
    assert route.nodes.tolist() == nodes
    assert (route.priority, route.bound) == (priority, priority)
    assert route.proved
    assert route.infeasible == (not nodes)


def test_no_way_and_the_empty_mission() -> None:
    times, rho = diamond()
    assert solve_exact(times, rho, 3, 0, 1e4).infeasible
    at_goal = solve_exact(times, rho, 3, 3, 10.0)
    assert (at_goal.nodes.tolist(), at_goal.proved, at_goal.infeasible) == ([3], True, False)
    assert solve_exact(times, rho, 3, 3, 0.0).infeasible
    bare = solve_exact(times, 0.0 * rho, 0, 3, np.inf)
    assert (bare.nodes[0], bare.nodes[-1], bare.priority, bare.proved) == (0, 3, 0.0, True)


def test_within_a_tick_the_second_search_answers() -> None:
    times, rho = diamond()
    times[0, 2] += 5e-8
    route = solve_exact(times, rho, 0, 3, 30.0 + 2e-8)
    assert route.nodes.tolist() == [0, 1, 3]
    assert route.priority <= 3.0 <= route.bound <= 8.0


@pytest.mark.parametrize("hint", [[0, 1, 3], [0, 2, 3], [0, 3, 9], []])
def test_any_hint_is_accepted(hint: list[int]) -> None:
    route = solve_exact(*diamond(), 0, 3, 40.0, hint=hint)
    assert (route.nodes.tolist(), route.proved) == ([0, 2, 3], True)


@pytest.mark.parametrize("seed", range(5))
def test_ticks_err_on_the_known_side(seed: int) -> None:
    rng = np.random.default_rng(seed)
    legs = rng.uniform(0.0, 10.0 ** rng.integers(-3, 6), 8)
    budget = float(rng.choice([legs[:4].sum(), legs.sum(), 0.5 * legs.sum()]))
    low, most = in_ticks(legs, budget, np.floor)
    high, least = in_ticks(legs, budget, np.ceil)
    assert most == least
    for subset in rng.random((200, 8)) < 0.5:
        time = legs[subset].sum()
        assert low[subset].sum() <= most or time >= budget * (1.0 - 1e-12)
        assert high[subset].sum() > most or time < budget * (1.0 + 1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_limit": 0.0}, "time_limit must be positive"),
        ({"goal": 4}, "goal must be an index"),
    ],
)
def test_bad_arguments_are_refused(change: dict, message: str) -> None:
    times, rho = diamond()
    arguments = {"start": 0, "goal": 3, "time_available": 40.0, **change}
    with pytest.raises(ValueError, match=message):
        solve_exact(times, rho, **arguments)


def test_without_or_tools_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ortools.sat.python", None)
    with pytest.raises(ImportError, match=r"pip install 'auvplan\[exact\]'"):
        solve_exact(*diamond(), 0, 3, 40.0)


@needs_graphs
def test_the_proven_optimum_of_a_task_graph() -> None:
    case = proven("knn40-s0")
    route = solve_exact(*case.searched, time_limit=30.0)
    assert (route.priority, route.bound, route.proved) == (case.optimum, case.optimum, True)
