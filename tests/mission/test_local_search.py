"""Local search on routes against a plain one."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.mission import MissionGraph, check_route
from auvplan.mission.decoder import decode
from auvplan.mission.local_search import CUT, improve, rearranged
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


def rearrangements(route: list[int]) -> list[list[int]]:
    """Every route with one part reversed, or a chain of up to three moved, as it is or reversed."""
    inner, found = range(1, len(route) - 1), []
    for i in inner:
        found += [[*route[:i], *route[i:k][::-1], *route[k:]] for k in range(i + 2, len(route))]
        for size in (1, 2, 3):
            if i + size < len(route):
                chain, rest = route[i : i + size], [*route[:i], *route[i + size :]]
                for at in range(1, len(rest)):
                    found += [[*rest[:at], *turn, *rest[at:]] for turn in (chain, chain[::-1])]
    return found


@given(st.integers(0, 10_000), st.integers(6, 14), st.floats(0.0, 0.4), st.floats(1.0, 1.5))
@settings(max_examples=40, deadline=None)
def test_no_part_of_a_rearranged_route_is_better_reversed_or_moved(seed, size, closed, spare) -> None:
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 1000.0, (size, 2))
    times = np.linalg.norm(places[:, None] - places, axis=-1) + rng.uniform(0.0, 300.0, (size, size))
    times[rng.random((size, size)) < closed] = np.inf
    priority = rng.integers(0, 3, size)[None, :] + rng.integers(0, 2, (size, size)).astype(float)
    route = [0, *rng.permutation(np.arange(1, size - 1))[: size - 3].tolist(), size - 1]
    times[route[:-1], route[1:]] = 400.0  # a way that is open

    def took(nodes: list[int]) -> tuple[float, float]:
        legs = nodes[:-1], nodes[1:]
        return float(priority[legs].sum()), float(times[legs].sum())

    available = spare * took(route)[1] + 1.0
    found = rearranged(route, times, priority, available)
    worth, lasts = took(found)
    assert (found[0], found[-1], len(set(found))) == (0, size - 1, len(found))
    assert lasts < available
    assert worth >= took(route)[0] - 1e-9
    assert worth > took(route)[0] + 1e-9 or lasts <= took(route)[1] + 1e-6
    for other in rearrangements(found):
        there = took(other)
        assert there[0] < worth - 1e-9 or there[1] >= lasts - 1e-4
    for node in set(range(size)) - set(found):
        for at in range(1, len(found)):
            more = took([*found[:at], node, *found[at:]])
            assert more[0] <= worth + 1e-9 or not more[1] < available
