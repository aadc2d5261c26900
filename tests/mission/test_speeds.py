"""Orders of tasks with the speeds of their legs, in the time and the energy that there are."""

from dataclasses import replace
from itertools import pairwise, product

import jax
import numpy as np
import pytest

from auvplan.mission import (
    MissionConfig,
    MissionGraph,
    MissionStatus,
    Timetable,
    plan_mission,
    plan_missions,
    replan_mission,
    task_graph,
    time_to_go,
)
from auvplan.mission.exact import solve_exact
from auvplan.mission.speeds import SpeedOptions, fastest
from benchmarks.speeds import SPEEDS as CHOICES
from benchmarks.speeds import exhaustive, posed, tables
from tests.mission import naive
from tests.mission.naive import BARE

SPEEDS, POWER = CHOICES[3], 40.0 + 20.0 * CHOICES[3] ** 3
QUICK = MissionConfig.quick()


def case(seed: int) -> tuple[MissionGraph, float, float]:
    """Return a graph of 8 waypoints with three speeds, s and J."""
    return posed(seed, 8, 3, 3)


@pytest.fixture(scope="module")
def few() -> list[tuple[MissionGraph, float, float]]:
    return [case(seed) for seed in range(12)]


def test_orders_and_speeds_are_those_of_exhaustive_search(few) -> None:
    pytest.importorskip("ortools")
    graphs = MissionGraph.stack(graph for graph, *_ in few)
    limits = [np.array([one[k] for one in few]) for k in (1, 2)]
    keys = jax.random.split(jax.random.key(0), len(few))
    routes = plan_missions(
        graphs, [0] * 12, [7] * 12, limits[0], speed=1.0, key=keys, energy_available=limits[1], config=QUICK
    )
    missed = 0
    for (graph, time, energy), route in zip(few, routes, strict=True):
        wanted = exhaustive(graph, time, energy)
        assert graph.options is not None
        each, spent = tables(graph)
        exact = solve_exact(each, graph.priority, 0, 7, time, energies=spent, energy_available=energy)
        assert exact.infeasible if wanted < 0.0 else exact.priority == pytest.approx(wanted)
        missed += (route.priority if route.feasible else -1.0) < wanted - 1e-9
        if wanted > 0.0:
            assert route.bound >= wanted - 1e-9
        if route.feasible:
            legs = list(pairwise(route.nodes.tolist()))
            places = [int(np.flatnonzero(v == SPEEDS)[0]) for v in route.speeds.legs]
            took = [each[k, i, j] for k, (i, j) in zip(places, legs, strict=True)]
            drew = [spent[k, i, j] for k, (i, j) in zip(places, legs, strict=True)]
            np.testing.assert_allclose(route.leg_times, took, rtol=1e-9)
            np.testing.assert_allclose(route.speeds.energies, drew, rtol=1e-9)
            assert route.time < time
            assert route.speeds.energies.sum() <= energy
    assert missed <= 1


def test_more_time_or_more_energy_never_costs_priority() -> None:
    graph, time, energy = case(5)
    asked = {"speed": 1.0, "config": QUICK, "key": jax.random.key(1)}
    values = [
        plan_mission(graph, 0, 7, more * time, energy_available=richer * energy, **asked).priority
        for more, richer in ((1.0, 1.0), (1.5, 1.0), (1.0, 1.5), (1.5, 1.5))
    ]
    assert values[0] <= min(values[1:3])
    assert max(values[1:3]) <= values[3]


def test_without_a_limit_on_energy_all_legs_are_as_fast_as_can_be() -> None:
    graph, time, _ = case(4)
    given = {"key": jax.random.key(2), "speed": 1.0}
    free = plan_mission(graph, 0, 7, time, config=QUICK, **given)
    assert graph.options is not None
    fast = replace(graph, options=None, travel_time=graph.options.travel_time.min(axis=0))
    assert (free.speeds.legs == SPEEDS[-1]).all()
    assert free.priority == plan_mission(fast, 0, 7, time, config=naive.QUICK, **given).priority


def test_energy_is_saved_where_that_decides_between_routes_of_equal_priority() -> None:
    graph, time, energy = case(7)
    found = [
        plan_mission(
            graph, 0, 7, 2.0 * time, speed=1.0, key=jax.random.key(0), energy_available=2.0 * energy,
            config=BARE.replace(saves=saves),
        )
        for saves in ("time", "energy")
    ]  # fmt: skip
    assert found[0].priority == found[1].priority
    assert found[1].speeds.energies.sum() <= found[0].speeds.energies.sum()
    assert found[0].time <= found[1].time


def test_speeds_of_a_route_are_the_best_of_all() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        times = np.sort(rng.uniform(50.0, 300.0, (5, 3)), axis=1)[:, ::-1]
        energies = np.sort(rng.uniform(1e3, 9e3, (5, 3)), axis=1)
        limits = float(rng.uniform(600.0, 1100.0)), float(rng.uniform(1.5e4, 3e4))
        all_ways = [
            (times[range(5), way].sum(), energies[range(5), way].sum()) for way in product(range(3), repeat=5)
        ]
        fit = [way for way in all_ways if way[0] < limits[0] and way[1] <= limits[1]]
        for number, saves in enumerate(("time", "energy")):
            places = fastest(times, energies, limits, saves)
            assert len(places) == (5 if fit else 0)
            if fit:
                least = min(way[number] for way in fit)
                assert (times, energies)[number][range(5), places].sum() == pytest.approx(least)


def test_by_the_clock_routes_keep_both_limits_and_windows() -> None:
    graph, time, energy = case(9)
    assert graph.options is not None
    departures, tide = np.linspace(0.0, 2.0 * time, 5), np.array([1.0, 0.9, 1.1, 1.2, 0.95])
    opens, closes = np.zeros((8, 8, 1)), np.full((8, 8, 1), 0.6 * time)
    options = replace(graph.options, travel_time=graph.options.travel_time[:, None] * tide[:, None, None])
    table = Timetable(departures, options.travel_time[1], opens=opens, closes=closes)
    clocked = replace(graph.with_timetable(table), options=options)
    route = plan_mission(
        clocked, 0, 7, 1.5 * time, speed=1.0, key=jax.random.key(0), energy_available=energy, config=BARE
    )
    assert route.feasible
    now, spent = 0.0, 0.0
    for (i, j), speed, lasts, drawn in zip(
        pairwise(route.nodes.tolist()), route.speeds.legs, route.leg_times, route.speeds.energies, strict=True
    ):
        k = int(np.flatnonzero(speed == SPEEDS)[0])
        travel = np.interp(now, departures, options.travel_time[k, :, i, j])
        wait = lasts - travel - graph.duration[i, j]
        assert wait > -1e-6
        assert now + travel + wait <= 0.6 * time + 1e-6
        assert drawn == pytest.approx(POWER[k] * (travel + wait) + options.fixed[i, j], rel=1e-6)
        now, spent = now + lasts, spent + drawn
    assert now == pytest.approx(route.time)
    assert now < 1.5 * time
    assert spent <= energy
    whole, needs = route.speeds.least_energy(route.nodes, table, 1.01 * route.time, 0.0)
    assert whole == needs <= spent * (1.0 + 1e-9)
    assert route.speeds.least_energy(route.nodes, table, 1.0, 0.0) == (np.inf, np.inf)


def late_task(waits: float) -> MissionGraph:
    """A task at the middle of a line that may begin 2,000 s after the start; its way opens after 500 s.

    Waiting takes as many W at the start, and a tenth more in the middle, from 500 s on twice as much.
    """
    places = np.stack([np.asarray([0.0, 300.0, 600.0]), *np.zeros((2, 3))], axis=1)
    graph = task_graph(places, [(0, 1), (1, 2), (0, 2)], [], [(1, 3.0, 100.0)])
    times = np.linalg.norm(places[:, None] - places[None], axis=2) / SPEEDS[:, None, None]
    departures = np.linspace(0.0, 4000.0, 9)
    travel = np.repeat(times[:, None], 9, axis=1)
    travel[:, 0, 0, 1] = np.inf
    waiting = waits * np.where(departures < 500.0, 1.0, 2.0)[:, None] * [1.0, 1.1, 1.0]
    opens, closes = np.full((3, 3, 1), -np.inf), np.full((3, 3, 1), np.inf)
    opens[:, 1] = 2000.0
    table = Timetable(departures, travel[0], opens=opens, closes=closes)
    options = SpeedOptions(SPEEDS, POWER, travel, 30.0 * graph.duration, waiting=waiting)
    return replace(graph.with_timetable(table), options=options)


@pytest.mark.parametrize("waits", [10.0, 200.0])
def test_waiting_takes_its_own_power_in_the_search_and_in_what_is_said(waits: float) -> None:
    """The least energy of all speeds does, and a little less does not."""
    graph, ways = late_task(waits), {}
    for first, second in product(range(3), repeat=2):
        arrives = 500.0 + 300.0 / SPEEDS[first]
        watts = np.interp(arrives, graph.timetable.departures, graph.options.waiting[:, 1])
        held = 500.0 * waits + watts * (2000.0 - arrives)
        moving = sum(POWER[k] * 300.0 / SPEEDS[k] for k in (first, second))
        ways[first, second] = held + moving + 30.0 * 100.0
    least, best = min(ways.values()), min(ways, key=lambda way: ways[way])
    given = {"speed": 1.0, "key": jax.random.key(0), "config": BARE.replace(saves="energy")}
    route = plan_mission(graph, 0, 2, 4000.0, energy_available=1.01 * least, **given)
    assert route.nodes.tolist() == [0, 1, 2]
    assert route.speeds is not None
    assert route.speeds.legs == pytest.approx(SPEEDS[list(best)])
    assert route.speeds.energies.sum() == pytest.approx(least, rel=1e-6)
    takes, needs = route.speeds.least_energy(route.nodes, route.timetable, 4000.0, 0.0)
    assert takes == needs == pytest.approx(least, rel=1e-6)
    fewer = plan_mission(graph, 0, 2, 4000.0, energy_available=0.999 * least, **given)
    assert fewer.nodes.tolist() == [0, 2]


def test_the_least_energy_of_a_route_in_time_is_that_of_all_speeds(few) -> None:
    compared = 0
    for graph, time, energy in few[:6]:
        route = plan_mission(
            graph, 0, 7, time, speed=1.0, key=jax.random.key(0), energy_available=energy, config=BARE
        )
        if not route.feasible:
            continue
        compared += 1
        options, (i, j) = route.speeds.options, (route.nodes[:-1], route.nodes[1:])
        times = options.travel_time[:, i, j] + graph.duration[i, j]
        energies = POWER[:, None] * options.travel_time[:, i, j] + options.fixed[i, j]
        energies[:, -1], times[:, -1] = 1.1 * energies[:, -1], 1.1 * times[:, -1]
        ways, legs = product(range(3), repeat=len(i)), range(len(i))
        every = [(times[way, legs].sum(), energies[way, legs].sum()) for way in map(list, ways)]
        least = min(spent for lasts, spent in every if lasts < time)
        takes, needs = route.speeds.least_energy(route.nodes, None, time, 0.1)
        assert needs == pytest.approx(least)
        assert takes < needs
    assert compared >= 3


def test_that_no_speeds_keep_both_limits_is_said_where_it_is_certain() -> None:
    graph, time, energy = case(5)
    given = {"speed": 1.0, "key": jax.random.key(0), "config": QUICK}
    assert exhaustive(graph, time, energy) > 0.0
    times, energies = tables(graph)
    least = [float(time_to_go(values.min(axis=0), 7)[0]) for values in (times, energies)]
    for share, status in (
        ((0.9, 9.0), MissionStatus.OUT_OF_TIME),
        ((9.0, 0.9), MissionStatus.OUT_OF_ENERGY),
        ((1.02, 1.02), MissionStatus.OUT_OF_ENERGY),
    ):
        limits = [part * value for part, value in zip(share, least, strict=True)]
        assert exhaustive(graph, *limits) < 0.0
        route = plan_mission(graph, 0, 7, limits[0], energy_available=limits[1], **given)
        assert route.status is status
        assert "available" in route.reason


def test_a_task_that_was_done_takes_no_energy_in_what_is_planned_then() -> None:
    places = np.stack([np.asarray([0.0, 300.0, 600.0, 900.0]), *np.zeros((2, 4))], axis=1)
    edges, tasks = [(i, j) for i in range(4) for j in range(i)], [(1, 3.0, 60.0), (2, 2.0, 90.0)]
    graph = task_graph(places, edges, [(0, 2, 1.0, 30.0)], tasks)
    times = np.linalg.norm(places[:, None] - places[None], axis=2) / SPEEDS[:, None, None]
    joules = {"fixed": 50.0 * graph.duration, "waypoint_fixed": 50.0 * graph.waypoint_duration}
    graph = replace(graph, options=SpeedOptions(SPEEDS, POWER, times, **joules))
    given = {"speed": 1.0, "key": jax.random.key(0), "config": BARE, "energy_available": 1e9}
    route = plan_mission(graph, 0, 3, 3000.0, **given)
    assert sorted(route.nodes.tolist()) == [0, 1, 2, 3]
    assert route.speeds is not None
    for reached in (1, 2):
        here, done = int(route.nodes[reached]), route.nodes[1 : reached + 1].tolist()
        rest = replan_mission(route, graph, here, 2000.0, **given)
        assert rest.speeds is not None
        wanted = 50.0 * np.array(graph.duration)
        for node in done:
            wanted[:, node] -= np.where(graph.adjacency[:, node], 50.0 * graph.waypoint_duration[node], 0.0)
        open_ = rest.speeds.open
        np.testing.assert_allclose(rest.speeds.options.fixed[open_], wanted[open_])
        assert open_[:, done].any()
        assert rest.speeds.energies.sum() == pytest.approx(route.speeds.energies[reached:].sum())


def test_a_graph_without_speeds_refuses_a_limit_on_energy() -> None:
    graph = replace(case(0)[0], options=None)
    with pytest.raises(ValueError, match="energy_available needs a graph with options"):
        plan_mission(graph, 0, 7, 1e4, key=jax.random.key(0), energy_available=1e6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"power": [40.0]}, "power must be"),
        ({"travel_time": np.ones((2, 3, 3))}, "travel_time must be"),
        ({"fixed": np.ones((2, 2))}, "fixed must be"),
        ({"fixed": -np.ones((3, 3))}, "fixed of speeds must be"),
        ({"waypoint_fixed": np.ones(2)}, "waypoint_fixed must be"),
        ({"waiting": np.ones((1, 3))}, "waiting must be"),
        ({"travel_time": np.ones((3, 2, 3, 3)), "waiting": np.ones((3, 3))}, "waiting must be"),
        ({"travel_time": np.ones((3, 2, 3, 3)), "waiting": -np.ones((2, 3))}, "waiting of speeds must be"),
    ],
)
def test_options_that_do_not_go_together_are_refused(changes: dict, message: str) -> None:
    given = {"speeds": SPEEDS, "power": POWER, "travel_time": np.ones((3, 3, 3)), "fixed": np.zeros((3, 3))}
    with pytest.raises(ValueError, match=message):
        SpeedOptions(**given | changes)
