"""Beam search for first routes."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.mission import check_route
from auvplan.mission.beam import beam_search, seed_routes
from tests.mission.naive import best_priority, grid_graph, problem

N, SPEED = 7, 2.0
WIDTH = 512
search_now = jax.jit(beam_search, static_argnames=("width", "places", "count"))
seeds_now = jax.jit(seed_routes, static_argnames=("width", "places", "count"))


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    density=st.sampled_from([0.3, 0.6, 1.0]),
    directed=st.booleans(),
    budget=st.floats(300.0, 3000.0),
)
def test_routes_keep_all_rules(seed: int, density: float, directed: bool, budget: float) -> None:
    graph = grid_graph(seed, N, density, directed)
    given_ = problem(graph, 0, N - 1, budget)
    nodes, gains = search_now(given_, given_.priority, 0.001, width=WIDTH, places=WIDTH * 8, count=5)
    for route, gain in zip(np.asarray(nodes), np.asarray(gains), strict=True):
        if np.isfinite(gain):
            check = check_route(graph, route[route >= 0], 0, N - 1, budget, SPEED)
            assert check.valid, check.reasons


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10_000), density=st.sampled_from([0.3, 0.6, 1.0]), directed=st.booleans())
def test_without_a_time_limit_a_wide_beam_is_exact(seed: int, density: float, directed: bool) -> None:
    """With room for every partial route nothing goes but the poorer of two that have visited the same."""
    graph = grid_graph(seed, N, density, directed)
    given_ = problem(graph, 0, N - 1, 1e6)
    _, gains = search_now(given_, given_.priority, 0.0, width=WIDTH, places=WIDTH * 8, count=5)
    best = best_priority(graph, 0, N - 1, 1e6, SPEED)
    assert float(gains[0]) == pytest.approx(-np.inf if best is None else best)


def test_seeds_are_distinct_and_sorted() -> None:
    graph = grid_graph(3, N, 1.0)
    given_ = problem(graph, 0, N - 1, 2500.0)
    nodes, gains = seeds_now(given_, given_.priority, 1.0, width=16, places=4, count=12)
    found = [tuple(row) for row, gain in zip(np.asarray(nodes), gains, strict=True) if np.isfinite(gain)]
    assert len(found) == len(set(found)) > 3
    assert sorted(gains.tolist(), reverse=True) == gains.tolist()


@pytest.mark.parametrize("places", [1, 2])
def test_a_waypoint_has_only_so_many_places(places: int) -> None:
    graph = grid_graph(5, N, 1.0)
    given_ = problem(graph, 0, N - 1, 1e5)
    few, _ = search_now(given_, given_.priority, 0.0, width=WIDTH, places=places, count=400)
    many, _ = search_now(given_, given_.priority, 0.0, width=WIDTH, places=4096, count=400)

    def ended(nodes: jax.Array) -> int:
        return len({tuple(row) for row in np.asarray(nodes) if row[1] >= 0})

    assert ended(few) < ended(many)
