"""Local search on routes against a plain one."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.mission import MissionGraph, check_route
from auvplan.mission.decoder import decode
from auvplan.mission.local_search import CUT, improve
from tests.mission.naive import grid_graph, problem
from tests.mission.naive import time_to_go as dijkstra_time_to_go

N, SPEED = 9, 2.0
improve_now = jax.jit(improve, static_argnames="rounds")
decode_now = jax.jit(decode, static_argnames="decoder")


def random_routes(graph: MissionGraph, budget: float, margin: float, seed: int):
    given_ = problem(graph, 0, N - 1, budget, margin=margin)
    population = np.random.default_rng(seed).integers(-200, 101, (12, N))
    routes = decode_now(jnp.asarray(population), given_, decoder="timely")
    return given_, np.asarray(routes.nodes)[np.asarray(routes.reached)]


def naive_best_gain(graph: MissionGraph, route: list[int], budget: float, margin: float) -> float:
    """What the best change gains: cut out up to `CUT` waypoints and put another, or none, in their place."""
    legs = graph.leg_times(SPEED)
    back = (1.0 + margin) * dijkstra_time_to_go(np.where(np.arange(N) == 0, np.inf, legs), N - 1)

    def worth(nodes: list[int]) -> float:
        time, total = 0.0, 0.0
        for i, j in pairwise(nodes):
            time, total = time + legs[i, j], total + graph.priority[i, j]
            if not time + back[j] < budget:
                return -np.inf
        return total

    others = [None, *(k for k in range(N) if k not in route)]
    changed = [
        [*route[: i + 1], *([] if k is None else [k]), *route[i + 1 + cut :]]
        for i in range(len(route) - 1)
        for cut in range(min(CUT, len(route) - 2 - i) + 1)
        for k in others
    ]
    return max(worth(nodes) for nodes in changed) - worth(route)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    density=st.sampled_from([0.4, 0.7, 1.0]),
    directed=st.booleans(),
    budget=st.floats(1000.0, 4000.0),
    margin=st.sampled_from([0.0, 0.3]),
)
def test_the_best_change_is_made(
    seed: int, density: float, directed: bool, budget: float, margin: float
) -> None:
    graph = grid_graph(seed, N, density, directed)
    given_, routes = random_routes(graph, budget, margin, seed)
    if len(routes) == 0:
        return
    padded = np.resize(routes, (12, N))
    after = np.asarray(improve_now(jnp.asarray(padded), given_, given_.priority, rounds=1))
    for old, new in zip(padded, after, strict=True):
        before, now = old[old >= 0].tolist(), new[new >= 0].tolist()
        check = check_route(graph, now, 0, N - 1, budget, SPEED)
        assert check.valid, check.reasons
        gained = sum(graph.priority[leg] for leg in pairwise(now)) - sum(
            graph.priority[leg] for leg in pairwise(before)
        )
        assert gained == max(0.0, naive_best_gain(graph, before, budget, margin))


def test_many_rounds_end_where_no_change_gains() -> None:
    graph = grid_graph(4, N, 1.0)
    given_, routes = random_routes(graph, 2500.0, 0.0, 4)
    after = np.asarray(improve_now(jnp.asarray(routes), given_, given_.priority, rounds=30))
    for nodes in after:
        assert naive_best_gain(graph, nodes[nodes >= 0].tolist(), 2500.0, 0.0) <= 0.0
