"""Mission planning as a whole."""

from dataclasses import replace
from itertools import combinations, pairwise
from typing import Any

import jax
import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from auvplan import Vehicle
from auvplan.bbo import BBOConfig
from auvplan.mission import (
    MissionConfig,
    MissionGraph,
    MissionStatus,
    Timetable,
    check_route,
    plan_mission,
    plan_missions,
    random_graph,
    replan_mission,
    task_graph,
)
from auvplan.runtime.compiled import compilations
from tests.mission.naive import BLIND, PLAIN, QUICK, best_priority, grid_graph, needs_graphs, proven
from tests.mission.naive import time_to_go as dijkstra_time_to_go

SPEED = 2.0
PAPER = MissionConfig.paper().replace(bbo=MissionConfig.paper().bbo.replace(population=20, iterations=10))
CONFIGS = {
    "default": QUICK,
    "paper": PAPER,
    "plain": PLAIN,
}


def medium_graph(seed: int = 0) -> MissionGraph:
    """Fifteen waypoints, as most graphs here, so that one compilation serves many tests."""
    rng = np.random.default_rng(seed)
    return random_graph(rng, rng.uniform(0.0, 2000.0, (15, 3)), neighbours=4)


def plan(graph: MissionGraph, budget: float = 3000.0, seed: int = 0, config: MissionConfig = QUICK, **more):
    return plan_mission(
        graph, 0, graph.size - 1, budget, speed=SPEED, key=jax.random.key(seed), config=config, **more
    )


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_a_route_keeps_all_rules_and_adds_up(config: MissionConfig) -> None:
    graph = medium_graph()
    route = plan(graph, config=config)
    check = check_route(graph, route.nodes, 0, 14, 3000.0, SPEED)
    assert check.valid, check.reasons
    assert route.feasible
    assert route.status is MissionStatus.OK
    assert route.time == pytest.approx(check.time)
    assert route.leg_times.sum() == pytest.approx(route.time)
    assert len(route.leg_times) == len(route.nodes) - 1
    rho = [graph.priority[i, j] for i, j in pairwise(route.nodes)]
    assert route.priority == sum(rho)
    assert route.tasks == len(rho)
    assert route.history.best.shape == (11,)
    assert route.history.best[-1] == np.float32(route.cost)


@pytest.mark.parametrize("config", [QUICK, PLAIN], ids=["default", "plain"])
@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    density=st.sampled_from([0.15, 0.3, 0.6]),
    directed=st.booleans(),
    slack=st.sampled_from([0.8, 0.9999, 1.0, 1.0001, 1.01, 1.3]),
)
def test_feasible_whenever_a_feasible_mission_exists(
    config: MissionConfig, seed: int, density: float, directed: bool, slack: float
) -> None:
    graph = grid_graph(seed, 15, density, directed)
    shortest = dijkstra_time_to_go(graph.leg_times(SPEED), 14)[0]
    route = plan(graph, budget=slack * shortest if np.isfinite(shortest) else 500.0, config=config)
    if not np.isfinite(shortest):
        assert route.status is MissionStatus.UNREACHABLE
    elif slack > 1.0:
        assert route.feasible
    else:
        assert route.status is MissionStatus.OUT_OF_TIME
        assert route.least_time == pytest.approx(shortest, rel=1e-5)
    if not route.feasible:
        assert route.nodes.tolist() == [0]
        assert route.time == route.priority == route.tasks == 0


@pytest.mark.parametrize("seed", range(3))
def test_the_optimum_of_small_graphs_is_found(seed: int) -> None:
    graph = grid_graph(seed, 7, 0.7)
    budget = 1500.0 + 200.0 * seed
    expected = best_priority(graph, 0, 6, budget, SPEED)
    route = plan(graph, budget=budget, config=MissionConfig())
    assert expected is not None
    assert route.priority == expected


@pytest.mark.parametrize("config", [QUICK, MissionConfig()], ids=["quick", "default"])
@pytest.mark.parametrize("largest", [1.0, 25.0, 1000.0])
@pytest.mark.parametrize("budget", [3300.0, 4600.0])
def test_nothing_is_given_up_for_what_is_worth_more(config, largest: float, budget: float) -> None:
    """Four small tasks fit the time; the large one is out of reach, or leaves no room for all of them."""
    places = [(0, 0), (2900, 2900), (600, 0), (0, 900), (-900, -300), (-500, 900), (0, 0)]
    edges, stay = list(combinations(range(7), 2)), {1: 150.0}
    tasks = [(node, largest if node == 1 else 1.0, stay.get(node, 60.0)) for node in range(1, 6)]
    graph = task_graph(np.column_stack([places, np.full(7, 10.0)]), edges, waypoint_tasks=tasks)
    expected = best_priority(graph, 0, 6, budget, SPEED)
    route = plan(graph, budget=budget, config=config)
    assert route.priority == expected
    assert expected == 4.0 if budget == 3300.0 or largest == 1.0 else largest < expected < largest + 4.0


@pytest.mark.parametrize("seed", range(8, 16))
def test_priorities_of_three_decades_are_all_sought(seed: int) -> None:
    graph, rng = grid_graph(seed, 7, 0.7), np.random.default_rng(seed)
    weights = 10.0 ** rng.uniform(-1.5, 1.5, (7, 7))
    graph = replace(graph, priority=np.where(graph.priority > 0.0, np.maximum(weights, weights.T), 0.0))
    budget = 1500.0 + 100.0 * (seed % 8)
    expected = best_priority(graph, 0, 6, budget, SPEED)
    assert expected is not None
    assert plan(graph, budget=budget, config=MissionConfig()).priority == pytest.approx(expected, rel=1e-9)


def test_failures_say_what_to_do() -> None:
    graph = medium_graph()
    cut = graph.without_edges([(j, 14) for j in range(14)])
    route = plan(cut)
    assert not route.feasible
    assert "add edges" in route.reason
    late = plan(graph, budget=10.0)
    assert late.status is MissionStatus.OUT_OF_TIME
    assert f"{late.least_time:.1f} s" in late.reason
    assert "10.0 s are available" in late.reason
    assert plan(graph, budget=-5.0).status is MissionStatus.OUT_OF_TIME


def test_at_the_destination_the_mission_is_empty() -> None:
    route = plan_mission(medium_graph(), 3, 3, 100.0, speed=SPEED, key=jax.random.key(0), config=QUICK)
    assert route.feasible
    assert route.nodes.tolist() == [3]
    assert (route.time, route.priority, route.tasks, len(route.leg_times)) == (0.0, 0.0, 0, 0)


def test_same_key_same_route() -> None:
    graph = medium_graph(1)
    first, again, other = (plan(graph, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.nodes, again.nodes)
    np.testing.assert_array_equal(first.population, again.population)
    assert (first.population != other.population).any()


def test_a_batch_equals_its_missions_one_by_one() -> None:
    graphs = [medium_graph(seed) for seed in range(3)]
    starts, goals, budgets, speeds = [0, 3, 5], [14, 1, 5], [3000.0, 2000.0, 9.0], [2.0, 2.5, 1.5]
    keys = jax.random.split(jax.random.key(0), 3)
    routes = plan_missions(
        MissionGraph.stack(graphs), starts, goals, budgets, speed=speeds, key=keys, config=QUICK
    )
    assert len(routes) == 3
    for b, route in enumerate(routes):
        alone = plan_mission(
            graphs[b], starts[b], goals[b], budgets[b], speed=speeds[b], key=keys[b], config=QUICK
        )
        np.testing.assert_array_equal(route.nodes, alone.nodes)
        np.testing.assert_array_equal(route.population, alone.population)
        np.testing.assert_allclose(route.leg_times, alone.leg_times)
        assert route.status is alone.status
        assert route.time == pytest.approx(alone.time)
    assert routes.feasible.tolist() == [route.feasible for route in routes]


def test_planning_again_compiles_nothing() -> None:
    graph = medium_graph()
    first = plan(graph)
    compiled = compilations()
    again = graph.without_edges([tuple(first.nodes[:2])]).with_travel_time(2, 3, 99.0)
    visited = np.zeros(15, bool)
    visited[0] = True
    route = plan_mission(
        again,
        int(first.nodes[1]),
        14,
        2000.0,
        Vehicle(speed=3.0),
        key=jax.random.key(9),
        config=QUICK.replace(bbo=BBOConfig(**vars(QUICK.bbo))),
        population=first.population,
        visited=visited,
    )
    assert route.feasible
    assert 0 not in route.nodes
    plan(graph, population=first.population[:5])
    assert compilations() == compiled


def test_edges_without_tasks_are_passed_but_not_counted() -> None:
    graph = medium_graph()
    bare = MissionGraph(graph.positions, graph.adjacency, np.zeros((15, 15)), graph.duration)
    route = plan(bare)
    assert route.feasible
    assert (route.tasks, route.priority) == (0, 0.0)
    assert route.time == pytest.approx(route.least_time, rel=1e-5), "nothing to gain: the shortest way"


def test_one_way_edges_are_respected() -> None:
    size = 15
    ring = np.roll(np.eye(size, dtype=bool), 1, axis=1)
    graph = MissionGraph(np.random.default_rng(0).uniform(0, 500, (size, 3)), ring, ring * 1.0, ring * 10.0)
    route = plan_mission(graph, 12, 3, 1e5, speed=SPEED, key=jax.random.key(0), config=QUICK)
    assert route.nodes.tolist() == [12, 13, 14, 0, 1, 2, 3]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": 15}, "start must be an index"),
        ({"goal": -1}, "goal must be an index"),
        ({"goal": 1.5}, "goal must be an index"),
        ({"time_available": np.nan}, "time_available must be finite"),
        ({"speed": 0.0}, "speed must be positive"),
        ({"vehicle": Vehicle()}, "vehicle or speed, not both"),
        ({"population": np.zeros((3, 4), int)}, r"population must be \[Q <= 20, 16\]"),
        ({"visited": np.zeros(3, bool)}, "visited must be"),
    ],
)
def test_bad_arguments_are_refused(change: dict, message: str) -> None:
    arguments = {"start": 0, "goal": 14, "time_available": 100.0, "speed": 2.0, **change}
    with pytest.raises(ValueError, match=message):
        plan_mission(medium_graph(), key=jax.random.key(0), config=QUICK, **arguments)


@pytest.mark.parametrize(
    "setting",
    [
        {"decoder": "greedy"},
        {"objective": "time"},
        {"rate_weight": -1.0},
        {"phi1": -1.0},
        {"phi2": float("nan")},
        {"time_weight": 1.0},
        {"seeds": -1},
        {"seeds": 147},
        {"beam_width": 0},
        {"local_rounds": -1},
        {"local_width": 151},
        {"local_period": 0},
        {"degree": 0},
        {"bbo": BBOConfig(elites=0, replacement="generational")},
        {"bbo": BBOConfig(mutation="gaussian")},
    ],
)
def test_bad_settings_are_refused(setting: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(setting))):
        MissionConfig(**setting)


@needs_graphs
@pytest.mark.parametrize(
    "name", ["full40-s0", *(pytest.param(name, marks=pytest.mark.slow) for name in ("knn40-s0", "rnd40-s0"))]
)
def test_close_to_the_proven_optimum(name: str) -> None:
    case = proven(name)
    route = case.plan(0)
    assert check_route(case.graph, route.nodes, case.start, case.goal, case.time_available, case.speed)
    assert 0.93 * case.optimum <= route.priority <= case.optimum


@pytest.mark.parametrize("seed", range(3))
def test_the_bound_is_above_the_route(seed: int) -> None:
    graph = medium_graph(seed)
    route = plan(graph, budget=2200.0)
    best = best_priority(graph, 0, 14, 2200.0, SPEED)
    assert best is not None
    assert route.priority <= best <= route.bound
    assert route.gap == pytest.approx(1.0 - route.priority / route.bound)


def test_the_exact_method_proves_the_optimum() -> None:
    pytest.importorskip("ortools")
    graph = medium_graph(1)
    route = plan(graph, budget=2200.0, config=BLIND, method="exact")
    assert route.priority == route.bound == best_priority(graph, 0, 14, 2200.0, SPEED)
    assert route.gap == 0.0
    assert check_route(graph, route.nodes, 0, 14, 2200.0, SPEED)
    assert route.time == pytest.approx(route.leg_times.sum())


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 1000), passed=st.integers(1, 4), delay=st.floats(0.0, 200.0))
def test_a_new_plan_is_no_worse_than_the_rest_of_the_old(seed: int, passed: int, delay: float) -> None:
    graph = medium_graph(seed)
    old = plan(graph)
    assume(old.feasible)
    passed = min(passed, len(old.nodes) - 1)
    rest = old.nodes[passed:]
    left = 3000.0 - float(old.leg_times[:passed].sum()) - delay
    needs = float(old.leg_times[passed:].sum())
    worth = sum(graph.priority[leg] for leg in pairwise(rest))
    again = graph.without_edges(pairwise(old.nodes[: passed + 1].tolist()))
    route = plan_mission(
        again, int(rest[0]), 14, max(left, 1.0), speed=SPEED, key=jax.random.key(seed), config=BLIND,
        known_route=rest,
    )  # fmt: skip
    if needs < left * (1.0 - 1e-5):
        assert route.priority >= worth


@pytest.mark.parametrize("known", [[0, 3], [3, 14], [0, 3, 3, 14], [0, 15, 14], [[0, 14]]])
def test_a_known_route_must_fit(known: list) -> None:
    with pytest.raises(ValueError, match="known_route must lead from 0 to 14"):
        plan(medium_graph(), known_route=known)


@pytest.mark.parametrize("seed", range(3))
def test_the_bound_holds_with_a_return_margin(seed: int) -> None:
    graphs = MissionGraph.stack([medium_graph(seed)] * 2)
    keys = jax.random.split(jax.random.key(seed), 2)
    free, careful = plan_missions(
        graphs, [0, 0], [14, 14], 2200.0, speed=SPEED, key=keys, config=QUICK, return_margin=[0.0, 0.5]
    )
    assert careful.priority <= careful.bound <= free.bound + 1e-9
    assert (careful.limiting_times >= free.edge_times).all()


def test_given_populations_are_what_the_search_starts_from():
    """With nothing planted and no generation the answer is the best of the habitats given."""
    config = PAPER.replace(bbo=PAPER.bbo.replace(iterations=0))
    graph = medium_graph()
    good = plan(graph, seed=3)
    habitats = np.random.default_rng(0).integers(-200, 0, (20, 15))
    habitats[7, good.nodes] = 100 - np.arange(len(good.nodes))
    kept = plan(graph, config=config, population=habitats)
    np.testing.assert_array_equal(kept.nodes, good.nodes)
    rows = {tuple(row) for row in np.asarray(kept.population).tolist()}
    assert rows == {tuple(row) for row in habitats.tolist()}


def test_long_routes_do_not_cross_themselves() -> None:
    """With time for all tasks the route is a shortest tour; one that crosses itself is not."""
    places = np.pad(np.random.default_rng(3).uniform(0.0, 3000.0, (40, 2)), ((0, 0), (0, 1)))
    edges = [(i, j) for i in range(40) for j in range(i)]
    graph = task_graph(places, edges, waypoint_tasks=[(k, 1.0, 10.0) for k in range(1, 39)])
    route = plan_mission(graph, 0, 39, 1e5, speed=SPEED, key=jax.random.key(0), config=QUICK)
    assert len(route.nodes) == 40
    line = shapely.LineString(places[route.nodes, :2])
    assert line.is_simple
    assert route.time == pytest.approx(line.length / SPEED + 380.0)


def test_a_mission_is_replanned_from_a_waypoint_of_its_route() -> None:
    graph = medium_graph()
    first = plan(graph, budget=2200.0)
    here = int(first.nodes[2])
    left = 2200.0 - float(first.leg_times[:2].sum())
    rest = replan_mission(first, graph, here, left, speed=SPEED, key=jax.random.key(7), config=QUICK)
    gained = float(graph.priority[first.nodes[:2], first.nodes[1:3]].sum())
    assert rest.feasible
    assert rest.priority >= first.priority - gained - 1e-6, "the rest of the route is among the habitats"
    assert not {tuple(leg) for leg in pairwise(first.nodes[:3])} & {
        tuple(leg) for leg in pairwise(rest.nodes)
    }
    unvisited = next(node for node in range(graph.size) if node not in first.nodes)
    with pytest.raises(ValueError, match="here must be a waypoint of the route"):
        replan_mission(first, graph, unvisited, left, speed=SPEED, key=jax.random.key(7))


def test_what_was_done_before_a_replan_is_done_in_the_next_one() -> None:
    places = [(0.0, 0.0, 5.0), (100.0, 0.0, 5.0), (200.0, 100.0, 5.0), (300.0, 0.0, 5.0), (900.0, 0.0, 5.0)]
    tasks = [(1, 5.0, 10.0), (2, 1.0, 10.0), (3, 1.0, 10.0)]
    graph = task_graph(places, [(i, j) for i in range(5) for j in range(i)], waypoint_tasks=tasks)
    settings: dict[str, Any] = {"speed": 1.0, "key": jax.random.key(0), "config": QUICK}
    route, left, gained = plan_mission(graph, 0, 4, 4000.0, **settings), 4000.0, 0.0
    for _ in range(3):
        left -= float(route.leg_times[0])
        gained += float(graph.priority[tuple(route.nodes[:2])])
        route = replan_mission(route, graph, int(route.nodes[1]), left, **settings)
        assert gained + route.priority == 7.0
    assert [len(route.passed), *route.nodes[1:]] == [3, 4]


def test_a_replanned_mission_goes_by_the_clock() -> None:
    """A window that has closed since the first plan is closed for the second."""
    places = np.array([[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0], [1000.0, 1000.0, 0.0], [0.0, 1000.0, 0.0]])
    tasks = [(1, 1.0, 60.0), (2, 5.0, 60.0)]
    graph = task_graph(places, list(combinations(range(4), 2)), waypoint_tasks=tasks)
    closes = np.full((4, 4, 1), np.inf)
    closes[:, 2] = 2200.0
    travel = np.repeat((graph.leg_times(1.0) - graph.duration)[None], 2, axis=0)
    graph = graph.with_timetable(
        Timetable(np.array([0.0, 7200.0]), travel, np.full((4, 4, 1), -np.inf), closes)
    )
    first = plan_mission(graph, 0, 3, 7200.0, speed=1.0, key=jax.random.key(0))
    assert first.priority == 6.0
    for now, priority in ((1060.0, 5.0), (3000.0, 0.0)):
        settings = {"speed": 1.0, "key": jax.random.key(1)}
        rest = replan_mission(first, graph, 1, 7200.0 - now, now=now, **settings)
        assert (rest.feasible, rest.priority, rest.bound) == (True, priority, priority)
    with pytest.raises(ValueError, match="needs `now`"):
        replan_mission(first, graph, 1, 4200.0, speed=1.0, key=jax.random.key(1))


def test_the_way_back_along_a_directed_edge_is_a_task_of_its_own() -> None:
    places = np.array([[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0], [1000.0, 1000.0, 0.0], [0.0, 1000.0, 0.0]])
    adjacency, priority = np.zeros((4, 4), bool), np.zeros((4, 4))
    adjacency[[0, 1, 0, 1], [1, 0, 3, 3]] = True
    priority[0, 1], priority[1, 0] = 2.0, 3.0
    settings = {"speed": 1.0, "key": jax.random.key(0)}
    for back, nodes in ((3.0, [1, 0, 3]), (2.0, [1, 3])):  # the same both ways, it is one task
        priority[1, 0] = back
        graph = MissionGraph(places, adjacency, priority, np.zeros((4, 4)))
        first = plan_mission(graph, 0, 3, 4000.0, known_route=[0, 1, 3], **settings)
        first = replace(first, nodes=np.array([0, 1, 3]))
        np.testing.assert_array_equal(replan_mission(first, graph, 1, 3000.0, **settings).nodes, nodes)


def test_a_speed_is_no_vehicle() -> None:
    keys = jax.random.split(jax.random.key(0), 1)
    with pytest.raises(TypeError, match="give a speed as speed="):
        plan_missions(MissionGraph.stack([medium_graph()]), [0], [14], 2200.0, 2.0, key=keys)
