"""Routes in order: no move is left that shortens them, without a clock and by it."""

from itertools import pairwise

import jax
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from auvplan.mission import MissionGraph, Timetable, plan_mission
from auvplan.mission.labels import Clocked
from auvplan.mission.rearrange import Still, rearranged
from auvplan.mission.speeds import SpeedOptions
from tests.mission.naive import BARE
from tests.mission.test_timetable import HORIZON, SIZE, Edge, clocked

#: A search that is soon compiled, and puts its routes in order.
SMALL = BARE.replace(local_rounds=1)


def rearrangements(route: list[int]) -> list[list[int]]:
    """Every route with one part reversed, or a chain of up to six moved, as it is or reversed."""
    inner, found = range(1, len(route) - 1), []
    for i in inner:
        found += [[*route[:i], *route[i:k][::-1], *route[k:]] for k in range(i + 2, len(route))]
        for size in range(1, 7):
            if i + size < len(route):
                chain, rest = route[i : i + size], [*route[:i], *route[i + size :]]
                for at in range(1, len(rest)):
                    found += [[*rest[:at], *turn, *rest[at:]] for turn in (chain, chain[::-1])]
    return found


@given(st.integers(0, 10_000), st.integers(6, 14), st.floats(0.0, 0.4), st.floats(1.0, 1.5))
@settings(max_examples=30, deadline=None)
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
    found = rearranged(route, Still(times, priority, available))
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


def by_the_clock(graph: MissionGraph, end: float, margin: float = 0.0) -> Clocked:
    parts = graph.timetable, graph.duration, graph.priority, graph.adjacency
    return Clocked(*parts, 0, graph.size - 1, end, return_margin=margin)


def walked(graph: MissionGraph, route: list[int]) -> tuple[list[float], float]:
    """When each waypoint of a route is left, and its priority, by the plain look-up of each edge."""
    left, worth = [0.0], 0.0
    for i, j in pairwise(route):
        edge = Edge.of(graph, i, j)
        left.append(edge.done(left[-1]) if graph.adjacency[i, j] and np.isfinite(left[-1]) else np.inf)
        worth += edge.worth(left[-1])
    return left, worth


@given(st.integers(0, 10_000), st.booleans(), st.integers(0, 2), st.integers(0, 1), st.integers(0, 2))
@settings(max_examples=30, deadline=None)
def test_routes_by_the_clock_are_measured_as_edge_by_edge(seed, waiting, windows, along, falls) -> None:
    graph = clocked(seed, 0.1, windows, waiting=waiting, along=along, falls=falls)
    rng = np.random.default_rng(seed)
    routes = np.asarray([[0, *rng.permutation(np.arange(1, SIZE - 1))[:4], SIZE - 1] for _ in range(8)])
    ends, worth = by_the_clock(graph, HORIZON).walk(routes)
    for route, end, gained in zip(routes.tolist(), ends, worth, strict=True):
        left, worth_of_it = walked(graph, route)
        assert end == pytest.approx(left[-1] if left[-1] < HORIZON else np.inf)
        if np.isfinite(left[-1]):
            assert gained == pytest.approx(worth_of_it)


@given(st.integers(0, 10_000), st.booleans(), st.integers(0, 2), st.integers(0, 1), st.integers(0, 2))
@example(800, False, 0, 0, 0)  # a leg that has closed by the time of the route is open earlier
@settings(max_examples=30, deadline=None)
def test_no_move_shortens_a_rearranged_route_by_the_clock(seed, waiting, windows, along, falls) -> None:
    graph, rng = (
        clocked(seed, 0.05, windows, waiting=waiting, along=along, falls=falls),
        np.random.default_rng(seed),
    )
    routes = ([0, *rng.permutation(np.arange(1, SIZE - 1))[:4].tolist(), SIZE - 1] for _ in range(200))
    route = next((one for one in routes if walked(graph, one)[0][-1] < HORIZON), None)
    if route is None:
        return
    before, found = walked(graph, route), rearranged(route, by_the_clock(graph, HORIZON))
    left, worth = walked(graph, found)
    assert (found[0], found[-1], len(set(found))) == (0, SIZE - 1, len(found))
    assert left[-1] < HORIZON
    assert (worth > before[1] + 1e-9) or (worth >= before[1] - 1e-9 and left[-1] <= before[0][-1])
    rest = [node for node in range(SIZE) if node not in found]
    longer = [[*found[:at], node, *found[at:]] for node in rest for at in range(1, len(found))]
    for other in (*rearrangements(found), *longer):
        ends, gained = walked(graph, other)
        fits = ends[-1] < HORIZON
        if other in longer:
            assert not (fits and gained > worth + 1e-6)
        else:
            same = graph.priority[other[:-1], other[1:]].sum() >= graph.priority[found[:-1], found[1:]].sum()
            assert not (fits and same and gained >= worth and ends[-1] < left[-1] - 1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_a_rearranged_route_keeps_the_margin_on_the_way_back(seed) -> None:
    graph, margin, end = clocked(seed, 0.0, 0), 0.5, 1500.0
    latest = np.full(SIZE, -np.inf)  # to leave each waypoint and reach the goal, by trial every second
    latest[-1] = end
    moments = np.arange(0.0, end, 2.0)
    edges = {edge: Edge.of(graph, *edge) for edge in map(tuple, np.argwhere(graph.adjacency).tolist())}
    done = {edge: np.asarray([one.done(moment) for moment in moments]) for edge, one in edges.items()}
    for _ in range(SIZE):
        for (i, j), ends in done.items():
            good = moments[ends <= latest[j]]
            latest[i] = max(latest[i], good[-1] if len(good) else -np.inf)
    mission = by_the_clock(graph, end, margin)
    rng, tried = np.random.default_rng(seed), 0
    for _ in range(60):
        route = [0, *rng.permutation(np.arange(1, SIZE - 1))[:3].tolist(), SIZE - 1]
        ends = mission.walk(np.asarray([route]))[0].item()
        left = walked(graph, route)[0]
        spare = min(
            end - (1.0 + margin) * (end - latest[node]) - at
            for node, at in zip(route[1:], left[1:], strict=True)
        )
        if abs(spare) > 5.0:
            tried += 1
            assert np.isfinite(ends) == (spare > 0.0)
    assert tried > 30


def test_many_tasks_in_a_tide_are_planned_in_a_good_order() -> None:
    """Forty tasks that all fit: no part of the route is better reversed or moved."""
    size, end = 40, 30_000.0
    rng = np.random.default_rng(3)
    places = np.c_[rng.uniform(0.0, 3000.0, (size, 2)), np.zeros(size)]
    apart = places - places[:, None]
    length = np.linalg.norm(apart, axis=-1)
    departures = np.linspace(0.0, end, 25)
    along = 0.6 * np.sin(departures / 2000.0)[:, None, None] * apart[..., 0] / np.maximum(length, 1.0)
    adjacency = ~np.eye(size, dtype=bool)
    travel = np.where(adjacency, length / (1.5 + along), np.inf)
    rho, task = np.full((size, size), 2.0), np.full((size, size), 60.0)
    rho[:, [0, -1]] = task[:, [0, -1]] = 0.0
    graph = MissionGraph(places, adjacency, rho, task).with_timetable(Timetable(departures, travel))
    route = plan_mission(graph, 0, size - 1, end, speed=1.5, key=jax.random.key(0), config=SMALL)
    nodes, mission = route.nodes.tolist(), by_the_clock(graph, end)
    assert len(nodes) == size
    ends, _ = mission.walk(np.asarray(rearrangements(nodes)))
    assert route.time == pytest.approx(mission.walk(np.asarray([nodes]))[0].item())
    assert ends.min() > route.time - 1e-3


def jobs_with_speeds(seed: int, size: int) -> MissionGraph:
    """Tasks at waypoints that all lead to each other, at three speeds: the slowest takes least energy."""
    rng = np.random.default_rng(seed)
    places = np.c_[rng.uniform(0.0, 3000.0, (size, 2)), np.zeros(size)]
    rho, task = rng.integers(1, 6, size).astype(float), rng.uniform(30.0, 300.0, size)
    rho[[0, -1]] = task[[0, -1]] = 0.0
    adjacency, speeds = ~np.eye(size, dtype=bool), np.array([0.8, 1.2, 1.7])
    times = np.linalg.norm(places - places[:, None], axis=-1) / speeds[:, None, None]
    travel = np.where(adjacency, times, np.inf)
    square = np.broadcast_to(task, (size, size))
    options = SpeedOptions(speeds, 40.0 + 20.0 * speeds**3, travel, 40.0 * square)
    return MissionGraph(places, adjacency, np.where(adjacency, rho, 0.0), square.copy(), options=options)


def test_routes_short_of_energy_are_put_in_order_for_energy_too() -> None:
    """Ordered by the scarcer of time and energy, the route has no room for another task at any speeds."""
    size, limits = 24, (12_000.0, 720_000.0)
    for seed in range(3):
        graph = jobs_with_speeds(seed, size)
        given = {"speed": 1.0, "key": jax.random.key(0), "config": SMALL}
        route = plan_mission(graph, 0, size - 1, limits[0], energy_available=limits[1], **given)
        assert route.feasible
        assert route.speeds.energies.sum() <= limits[1]
        open_, options = np.asarray(graph.adjacency), graph.options
        mixtures = options.shares(graph.duration, open_, limits)
        nodes = route.nodes.tolist()
        share = max(mixtures, key=lambda mixture: mixture[nodes[:-1], nodes[1:]].sum())
        better = rearranged(nodes, Still(share, graph.priority, 1.0))
        more = graph.priority[better[:-1], better[1:]].sum() > route.priority + 1e-6
        levels = options.chosen(8)
        went = options.for_route(np.asarray(better), None, graph.duration, limits, "time", levels)
        assert not (more and went is not None)
