"""Priority vectors into routes, and what the routes cost."""

from dataclasses import replace
from functools import partial
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.mission import MissionGraph, check_route, objective
from auvplan.mission.decoder import Decoded, decode, encode, greedy_habitat, shortest_route, siv_count
from auvplan.mission.problem import Edges
from tests.mission.naive import decode as naive_decode
from tests.mission.naive import grid_graph, prepare_now, problem
from tests.mission.naive import time_to_go as dijkstra_time_to_go
from tests.mission.test_timetable import Edge, clocked

N, SPEED = 9, 2.0
DECODERS = ["paper", "timely", "rate"]
decode_now = jax.jit(partial(decode, rate_weight=100.0), static_argnames="decoder")
encode_now = jax.jit(encode, static_argnums=2)
shortest_now = jax.jit(shortest_route)


def shortest_habitat(given_, decoder: str):
    blank = np.zeros((1, siv_count(given_.size, decoder)), np.int32)
    return encode_now(np.asarray(shortest_now(given_))[None], blank, decoder)


def check_figures(routes: Decoded, p: int, graph: MissionGraph, route: list[int]) -> None:
    legs = list(pairwise(route))
    rho = np.array([graph.priority[leg] for leg in legs])
    assert float(routes.time[p]) == pytest.approx(sum(graph.leg_times(SPEED)[leg] for leg in legs), rel=1e-5)
    assert float(routes.priority[p]) == pytest.approx(rho.sum())
    assert int(routes.tasks[p]) == np.count_nonzero(rho)
    assert float(routes.inverse_priority[p]) == pytest.approx((1.0 / rho[rho > 0]).sum(), rel=1e-5)


@pytest.mark.parametrize("decoder", DECODERS)
@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    density=st.sampled_from([0.25, 0.5, 1.0]),
    directed=st.booleans(),
    slack=st.floats(0.9, 6.0),
)
def test_against_the_naive_decoder(
    decoder: str, seed: int, density: float, directed: bool, slack: float
) -> None:
    graph = grid_graph(seed, N, density, directed)
    shortest = dijkstra_time_to_go(graph.leg_times(SPEED), N - 1)[0]
    budget = slack * shortest if np.isfinite(shortest) else 1000.0
    given_ = problem(graph, 0, N - 1, budget)
    # Few distinct values, so that ties occur.
    rng = np.random.default_rng(seed)
    population = rng.integers(-4, 3, (8, siv_count(N, decoder))) * 50
    routes = jax.device_get(decode_now(population, given_, decoder=decoder))
    for p, habitat in enumerate(population):
        expected = naive_decode(habitat, graph, 0, N - 1, budget, SPEED, decoder, 100.0)
        count = int(routes.count[p])
        assert routes.nodes[p, :count].tolist() == expected
        assert (routes.nodes[p, count:] == -1).all()
        taken = sum(graph.leg_times(SPEED)[leg] for leg in pairwise(expected))
        in_time = decoder != "paper" or taken < budget * (1.0 - 1e-5)
        assert bool(routes.reached[p]) == (expected[-1] == N - 1 and in_time)
        assert float(routes.late[p]) == pytest.approx(0.0 if in_time else taken - budget, abs=0.1)
        check_figures(routes, p, graph, expected)
        if routes.reached[p]:
            check = check_route(graph, expected, 0, N - 1, budget, SPEED)
            assert check.valid, check.reasons
            assert routes.remaining[p] == 0.0


@pytest.mark.parametrize("decoder", DECODERS)
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10_000), density=st.sampled_from([0.2, 0.4, 1.0]), directed=st.booleans())
def test_the_shortest_route_is_the_shortest_way(
    decoder: str, seed: int, density: float, directed: bool
) -> None:
    graph = grid_graph(seed, N, density, directed, untasked=0.5)
    # Durations unrelated to distance make detours shorter than direct edges.
    graph = MissionGraph(graph.positions / 20.0, graph.adjacency, graph.priority, graph.duration)
    shortest = dijkstra_time_to_go(graph.leg_times(SPEED), N - 1)[0]
    if not np.isfinite(shortest):
        return
    given_ = problem(graph, 0, N - 1, shortest * 10.0)
    nodes = np.asarray(shortest_now(given_))
    length = int((nodes == N - 1).argmax()) + 1
    assert nodes[0] == 0
    assert (nodes[:length] >= 0).all()
    assert (nodes[length:] == -1).all()
    legs = [graph.leg_times(SPEED)[leg] for leg in pairwise(nodes[:length].tolist())]
    assert sum(legs) == pytest.approx(shortest, rel=1e-5)
    routes = decode_now(shortest_habitat(given_, decoder), given_, decoder=decoder)
    assert bool(routes.reached[0])
    assert float(routes.time[0]) == pytest.approx(shortest, rel=1e-5)


def test_legs_that_take_no_time_make_no_cycle() -> None:
    graph = MissionGraph(np.zeros((N, 3)), np.ones((N, N), bool), np.ones((N, N)), np.zeros((N, N)))
    given_ = problem(graph, 0, N - 1, 10.0)
    assert bool(decode_now(shortest_habitat(given_, "rate"), given_, decoder="rate").reached[0])


@pytest.mark.parametrize("decoder", DECODERS)
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10_000), density=st.sampled_from([0.25, 0.5, 1.0]), directed=st.booleans())
def test_a_route_survives_encoding(decoder: str, seed: int, density: float, directed: bool) -> None:
    graph = grid_graph(seed, N, density, directed)
    given_ = problem(graph, 0, N - 1, 3000.0)
    rng = np.random.default_rng(seed)
    population = rng.integers(-200, 101, (8, siv_count(N, decoder)))
    routes = jax.device_get(decode_now(population, given_, decoder=decoder))
    written = np.asarray(encode_now(routes.nodes, population, decoder))
    assert written.shape == population.shape
    assert int(written.min()) >= -200
    assert int(written.max()) <= 100
    again = jax.device_get(decode_now(written, given_, decoder=decoder))
    np.testing.assert_array_equal(again.nodes[routes.reached], routes.nodes[routes.reached])


@pytest.mark.parametrize("decoder", DECODERS)
def test_encoding_against_a_naive_twin(decoder: str) -> None:
    """Waypoints of a route fall from 100 in its order; the others keep theirs, below all of these."""
    rng = np.random.default_rng(5)
    population = rng.integers(-200, 101, (6, siv_count(N, decoder)))
    nodes = np.full((6, N), -1)
    for row, length in enumerate((2, 3, 5, N - 1, N, 4)):
        nodes[row, :length] = rng.permutation(N)[:length]
    found = np.asarray(encode_now(nodes, population, decoder))
    assert (found[:, N:] == -200).all()
    for genes, route, before in zip(found[:, :N], nodes, population[:, :N], strict=True):
        route = route[route >= 0].tolist()
        for node in range(N):
            if node in route:
                assert genes[node] == 100 - route.index(node)
            else:
                assert genes[node] == -200 + (before[node] + 200) * (300 - len(route)) // 301
                assert genes[node] < 100 - len(route) + 1


def test_a_route_of_more_legs_than_there_are_sivs_stays_within_their_bounds() -> None:
    """Of 400 waypoints 350 are on the way: the first 300 keep their order, the others have nothing left."""
    nodes = np.full((1, 400), -1)
    nodes[0, :350] = np.random.default_rng(0).permutation(400)[:350]
    genes = np.asarray(encode_now(nodes, np.full((1, 400), 100), "timely"))[0]
    assert genes[nodes[0, :300]].tolist() == list(range(100, -200, -1))
    assert (np.delete(genes, nodes[0, :300]) == -200).all()


@pytest.mark.parametrize("decoder", DECODERS)
def test_a_mission_that_begins_at_its_goal_is_there(decoder: str) -> None:
    given_ = problem(grid_graph(3, N, 1.0), 4, 4, 500.0)
    blank = np.zeros((2, siv_count(N, decoder)), np.int32)
    routes = jax.device_get(decode_now(blank, given_, decoder=decoder))
    assert routes.reached.all()
    assert np.asarray(routes.nodes)[:, 0].tolist() == [4, 4]
    assert (routes.count == 1).all()
    for part in (routes.time, routes.priority, routes.tasks, routes.inverse_priority, routes.remaining):
        assert not part.any()


@pytest.mark.parametrize("decoder", DECODERS)
def test_habitats_of_another_size_are_refused(decoder: str) -> None:
    given_ = problem(grid_graph(3, N, 1.0), 0, N - 1, 500.0)
    with pytest.raises(AssertionError, match="shape"):
        decode(jnp.zeros((2, siv_count(N, decoder) + 1)), given_, decoder, 100.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("decoder", DECODERS)
def test_times_and_priorities_by_the_clock_are_those_of_a_walk(decoder: str) -> None:
    """Tasks wait for windows, and are worth less the later they are begun."""
    graph, gone = clocked(7, 0.05, 2, falls=2), 0
    edges = Edges.of(graph.leg_times(1.5), graph.priority, timetable=graph.timetable, duration=graph.duration)
    given_ = prepare_now(edges, 0, N - 1, 2500.0, np.zeros(N, bool))
    rng = np.random.default_rng(1)
    population = rng.integers(-200, 101, (40, siv_count(N, decoder)))
    routes = jax.device_get(decode_now(population, given_, decoder=decoder))
    for p in range(len(population)):
        now, earned = 0.0, []
        for i, j in pairwise(routes.nodes[p, : routes.count[p]].tolist()):
            now = Edge.of(graph, i, j).done(now)
            earned.append(Edge.of(graph, i, j).worth(now))
            gone += earned[-1] < graph.priority[i, j]
        assert routes.time[p] == pytest.approx(now, rel=1e-4)
        assert routes.priority[p] == pytest.approx(sum(earned), abs=1e-4)
        assert routes.tasks[p] == sum(rho > 0.0 for rho in earned)
        assert routes.inverse_priority[p] == pytest.approx(sum(1.0 / rho for rho in earned if rho > 0.0))
    assert gone > 5


def test_the_greedy_habitat_follows_the_rate() -> None:
    graph = grid_graph(1, N, 1.0, untasked=0.0)
    given_ = problem(graph, 0, N - 1, 1e5)
    route = decode_now(greedy_habitat(given_, "rate")[None], given_, decoder="rate").nodes[0]
    rate = graph.priority[0] / graph.leg_times(SPEED)[0]
    rate[N - 1] = 0.0
    assert int(route[1]) == int(np.argmax(rate))


def test_visited_waypoints_are_not_entered() -> None:
    graph = grid_graph(2, N, 1.0)
    visited = np.zeros(N, bool)
    visited[[2, 5]] = True
    given_ = problem(graph, 0, N - 1, 1e5, visited)
    population = jax.random.randint(jax.random.key(0), (50, N), -200, 101)
    nodes = np.asarray(decode_now(population, given_, decoder="timely").nodes)
    assert not np.isin(nodes, [2, 5]).any()


def test_a_dead_end_is_not_reached() -> None:
    # 0 - 1 - 2 and 1 - 3: from 2 the only way back leads through 1, which has been visited.
    edges = np.zeros((4, 4), bool)
    for i, j in [(0, 1), (1, 2), (1, 3)]:
        edges[i, j] = edges[j, i] = True
    graph = MissionGraph(np.arange(12.0).reshape(4, 3), edges, edges * 1.0, edges * 10.0)
    given_ = problem(graph, 0, 3, 1000.0)
    population = jnp.array([[0, 0, 50, -50], [0, 0, -50, 50]])
    routes = decode_now(population, given_, decoder="timely")
    assert routes.reached.tolist() == [False, True]
    assert routes.nodes[0].tolist() == [0, 1, 2, -1]
    assert routes.remaining[0] > 0.0
    for cost in (objective.total_priority(routes, given_), objective.eq15(routes, given_)):
        assert cost[0] > cost[1]
    assert (objective.violation(routes, given_) > 0.0).tolist() == [True, False]


def test_objectives_by_hand() -> None:
    # One line 0 - 1 - 2 of 100 m legs: 50 + 10 s and 50 + 20 s, priorities 4 and 2.
    positions = [[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [200.0, 0.0, 0.0]]
    priority = np.array([[0, 4, 0], [0, 0, 2], [0, 0, 0]])
    duration = np.array([[0, 10, 0], [0, 0, 20], [0, 0, 0]])
    graph = MissionGraph(positions, priority > 0, priority, duration)
    given_ = problem(graph, 0, 2, 200.0)
    routes = decode_now(jnp.zeros((1, 3), jnp.int32), given_, decoder="timely")
    assert float(routes.time[0]) == pytest.approx(130.0)
    priority = objective.total_priority(routes, given_, time_weight=0.1)
    assert float(priority[0]) == pytest.approx(-6.0 + 0.1 * 4.0 * 130.0 / 200.0)
    finer = replace(given_, least_difference=jnp.float32(0.2))
    priority = objective.total_priority(routes, finer, time_weight=0.1)
    assert float(priority[0]) == pytest.approx(-6.0 + 0.5 * 0.2 * 130.0 / 200.0)
    eq15 = objective.eq15(routes, given_, phi1=2.0, phi2=8.0)
    assert float(eq15[0]) == pytest.approx(2.0 * 70.0 + 8.0 * (1 / 4 + 1 / 2))
    assert float(objective.violation(routes, given_)[0]) == 0.0


def test_any_route_that_arrives_costs_less_than_any_that_does_not() -> None:
    graph = grid_graph(4, N, 0.25)
    given_ = problem(graph, 0, N - 1, 2000.0)
    routes = decode_now(jax.random.randint(jax.random.key(1), (300, N), -200, 101), given_, decoder="timely")
    reached = np.asarray(routes.reached)
    assert reached.any()
    assert not reached.all()
    for cost in (objective.total_priority(routes, given_), objective.eq15(routes, given_)):
        assert cost[reached].max() < cost[~reached].min()
