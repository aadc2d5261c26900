"""The task graph."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from auvplan.mission import MissionGraph, random_graph, time_to_go
from tests.mission.naive import grid_graph
from tests.mission.naive import time_to_go as dijkstra_time_to_go


def triangle(**changes) -> MissionGraph:
    fields = {
        "positions": [[0.0, 0.0, 0.0], [300.0, 400.0, 0.0], [0.0, 0.0, 50.0]],
        "adjacency": ~np.eye(3, dtype=bool),
        "priority": np.ones((3, 3)),
        "duration": np.full((3, 3), 30.0),
    }
    return MissionGraph(**{**fields, **changes})


def test_eq13_by_hand() -> None:
    legs = triangle().leg_times(2.5)
    assert legs[0, 1] == pytest.approx(500.0 / 2.5 + 30.0)
    assert legs[0, 2] == pytest.approx(50.0 / 2.5 + 30.0)
    assert np.isinf(np.diag(legs)).all()


def test_known_travel_time_replaces_distance_over_speed() -> None:
    graph = triangle().with_travel_time(0, 1, 1000.0)
    legs = graph.leg_times(2.5)
    assert legs[0, 1] == pytest.approx(1030.0)
    assert legs[1, 0] == pytest.approx(230.0)
    assert np.isnan(triangle().travel_time).all(), "the original is unchanged"


def test_passed_edges_leave_the_graph() -> None:
    graph = triangle().without_edges([(0, 1)])
    assert not graph.adjacency[0, 1]
    assert not graph.adjacency[1, 0]
    assert graph.adjacency[0, 2]
    assert np.isinf(graph.leg_times(2.5)[0, 1])
    one_way = triangle().without_edges([(0, 1)], both_ways=False)
    assert one_way.adjacency[1, 0]
    assert jax.tree.structure(graph) == jax.tree.structure(triangle())


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("positions", np.zeros((3, 2)), r"positions must be \[N, 3\] m, got shape \(3, 2\)"),
        ("positions", [[0.0, 0.0, np.nan]] * 3, "positions must be finite"),
        ("adjacency", np.ones((2, 3), bool), r"adjacency .* got shape \(2, 3\)"),
        ("priority", np.ones((4, 4)), r"priority .* got shape \(4, 4\)"),
        ("priority", -np.ones((3, 3)), "priority must not be negative, got -1"),
        ("priority", np.full((3, 3), np.nan), "priority must be finite"),
        ("duration", np.ones(3), r"duration .* got shape \(3,\)"),
        ("duration", -np.ones((3, 3)), "duration must not be negative"),
        ("duration", np.full((3, 3), np.inf), "duration must be finite"),
        ("travel_time", -np.ones((3, 3)), "travel_time must not be negative"),
        ("travel_time", np.full((3, 3), np.inf), "travel_time must be finite"),
    ],
)
def test_bad_fields_are_refused(field: str, value, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        triangle(**{field: value})


def test_a_graph_passes_through_compiled_functions() -> None:
    graph = triangle()
    compiled = jax.jit(lambda graph, speed: graph.leg_times(speed))
    np.testing.assert_allclose(compiled(graph, 2.5), graph.leg_times(2.5), rtol=1e-6)
    stacked = MissionGraph.stack([graph, graph.with_travel_time(0, 1, 7.0)])
    assert stacked.positions.shape == (2, 3, 3)
    np.testing.assert_allclose(stacked.leg_times(np.array([2.5, 5.0]))[1, 0], [np.inf, 37.0, 40.0])


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.1, 0.3, 0.8]), st.booleans(), st.integers(0, 11))
def test_time_to_go_against_dijkstra(seed: int, density: float, directed: bool, goal: int) -> None:
    legs = grid_graph(seed, 12, density, directed).leg_times(2.0)
    found = time_to_go(legs, goal)
    np.testing.assert_allclose(found, dijkstra_time_to_go(legs, goal), rtol=1e-5)


@pytest.mark.parametrize("neighbours", [1, 3, 7, 50])
def test_random_graphs_are_connected_and_undirected(neighbours: int) -> None:
    rng = np.random.default_rng(neighbours)
    # Two clusters far apart: nearest neighbours alone would leave them unconnected.
    positions = rng.uniform(0.0, 100.0, (24, 3)) + np.repeat([[0.0, 0, 0], [9000.0, 0, 0]], 12, axis=0)
    graph = random_graph(rng, positions, neighbours)
    assert connected_components(graph.adjacency, directed=False)[0] == 1
    assert (graph.adjacency.sum(axis=1) >= min(neighbours, 23)).all()
    for field in (graph.adjacency, graph.priority, graph.duration):
        np.testing.assert_array_equal(field, field.T)
    rho, delta = graph.priority[graph.adjacency], graph.duration[graph.adjacency]
    assert set(rho) <= {1.0, 2.0, 3.0, 4.0, 5.0}
    assert ((delta >= 30.0) & (delta <= 300.0)).all()
    assert not graph.adjacency.diagonal().any()


def test_random_graphs_keep_to_the_passable_edges() -> None:
    rng = np.random.default_rng(0)
    positions = rng.uniform(0.0, 100.0, (10, 3))
    ring = np.roll(np.eye(10, dtype=bool), 1, axis=1)
    graph = random_graph(rng, positions, passable=ring | ring.T)
    assert not (graph.adjacency & ~(ring | ring.T)).any()
    with pytest.raises(ValueError, match="do not connect"):
        random_graph(rng, positions, passable=np.zeros((10, 10), bool))
