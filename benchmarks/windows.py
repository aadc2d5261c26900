"""Routes by the clock against proven optima, and what they cost in time: ``python -m benchmarks.windows``.

Thirty graphs of 40 waypoints, every other one complete, the rest of 7-12 nearest neighbours, with a task at
each waypoint in one window or one of two. Travel times and durations are whole seconds, windows close and
the time ends half a second after one, so that the planner, in single precision, and the labels of
`benchmarks.missions.labels`, which begin at the best route planned, have the same routes to choose from. The
gap of a plan is 1 - priority / bound; one that was not found counts as priority zero.
"""

import os
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import numpy as np
from scipy.spatial.distance import cdist

import auvplan as ap
from auvplan.mission import MissionConfig, MissionGraph, random_graph
from auvplan.ocean.gridded import GriddedCurrent
from benchmarks.harness import grouped, launch, screen, show, track
from benchmarks.missions.labels import Windows, most_priority
from benchmarks.missions.sets import Case, timed_graph

SIZE, SPEED, EXTENT = 40, 2.5, 10_000.0
FIRST_SEED, CASES, PLANS = 7000, 30, 3
#: s; half a second more, as windows.
AVAILABLE = 16_000, 22_001
HALF_SECOND = 0.5

#: Share of a mission's tasks whose windows are tight, by graph in turn.
TIGHT_SHARES = (0.25, 0.5, 0.75)
#: Lengths of windows as shares of the time available.
TIGHT, WIDE = (0.02, 0.08), (0.2, 0.5)

FAMILIES = "complete", "7-12 nearest"

#: Of the timings.
DEPARTURES, BENDS, INTERVAL = 24, 5, 900.0
PERIOD, STREAM = 44_714.0, (0.5, 0.3)


#: Plans of one configuration on one kind of graph, what proved it, and timings.
GAPS = {
    "graphs": "{family} ({graphs})", "planner": "{planner}", "proved": "{proved:.0%}", "tasks": "{tasks:.1f}",
    "mean gap": "{mean_gap:.2%}", "worst gap": "{worst_gap:.2%}", "optimal": "{optimal:.0%}",
    "feasible": "{feasible:.0%}", "wall": "{wall_ms:.0f} ms", "user": "{user_ms:.0f} ms",
}  # fmt: skip
TIMINGS = {
    "what": "{what}", "asked": "{asked:.2f} s", "first call": "{first_seconds:.2f} s",
    "wall": "{wall_seconds:.2f} s", "user": "{user_seconds:.2f} s",
}  # fmt: skip


def case(seed: int) -> Case:
    """A graph with a task at every waypoint but the first and the last, which are start and goal."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform(0.0, EXTENT, (SIZE, 3)) * [1.0, 1.0, 0.01]
    adjacency = ~np.eye(SIZE, dtype=bool)
    if seed % 2:
        adjacency = random_graph(rng, positions, neighbours=int(rng.integers(7, 13))).adjacency
    available = float(rng.integers(*AVAILABLE)) + HALF_SECOND
    tight = TIGHT_SHARES[seed % len(TIGHT_SHARES)]
    tasks = _tasks(rng, SIZE, available, tight)
    travel = np.where(adjacency, np.maximum(np.round(cdist(positions, positions) / SPEED), 1.0), np.inf)
    graph = timed_graph(positions, travel[None], *tasks)
    return Case(f"{seed}", FAMILIES[seed % 2], graph, 0, SIZE - 1, available, SPEED)


def _tasks(rng: np.random.Generator, size: int, available: float, tight: float) -> tuple[np.ndarray, ...]:
    """Priority and duration [N] of a task at each waypoint but the ends; opens and closes [N, 2] s."""
    priority, duration = rng.integers(1, 10, size).astype(float), rng.integers(60, 601, size).astype(float)
    priority[[0, -1]] = duration[[0, -1]] = 0.0
    is_tight = rng.random((size, 1)) < tight
    lengths = np.where(is_tight, rng.uniform(*TIGHT, (size, 2)), rng.uniform(*WIDE, (size, 2)))
    middles = rng.uniform(0.05, 0.95, (size, 2))
    opens = np.floor(available * (middles - 0.5 * lengths))
    closes = np.floor(available * (middles + 0.5 * lengths)) + HALF_SECOND
    single = rng.random(size) < 0.5
    opens[single, 1], closes[single, 1] = np.inf, -np.inf
    opens[[0, -1]], closes[[0, -1]] = -np.inf, np.inf
    return priority, duration, opens, closes


def most(case: Case, route: list[int]) -> tuple[float, float]:
    """Most total priority by labels, and a bound on it; `route` is a known one."""
    table, known = case.graph.timetable, float(case.graph.priority[0, route[1:]].sum())
    assert table is not None
    lasts, end = case.graph.duration[0][:, None] + table.travel_time[0], int(case.time_available)
    windows = Windows.of(lasts, table.opens[0], table.closes[0], case.graph.priority[0], end)
    return most_priority(windows, known)


PLANNERS = {"default": MissionConfig(), "quick": MissionConfig.quick()}


def clock(call: Callable[[], Any]) -> tuple[float, float, Any]:
    """Wall time and user time of all threads, s, and what the call returned."""
    wall, user = time.perf_counter(), os.times().user
    result = jax.block_until_ready(call())
    return time.perf_counter() - wall, os.times().user - user, result


def compared(count: int, first: int) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    cases = [case(first + k) for k in range(count)]
    for one in cases[:2]:
        for config in PLANNERS.values():
            one.plan(PLANS, config=config)
    made, found = [], []
    for one in track(cases, "graphs"):
        plans = [
            {"planner": name, "wall": wall, "user": user, "route": route}
            for name, config in PLANNERS.items()
            for wall, user, route in (clock(partial(one.plan, key, config=config)) for key in range(PLANS))
        ]
        routes = [each["route"] for each in plans]
        best = max(routes, key=lambda route: route.priority if route.feasible else -1.0)
        began = time.perf_counter()
        priority, bound = most(one, best.nodes.tolist() if best.feasible else [0])
        proof = {"seed": int(one.name), "family": one.family, "priority": priority, "bound": bound}
        found.append(proof | {"seconds": time.perf_counter() - began})
        made += [each | proof for each in plans]
    groups = grouped(made, lambda run: [(family, run["planner"]) for family in (run["family"], "all")])
    order = [(family, name) for family in (*FAMILIES, "all") for name in PLANNERS]
    return [summed(*key, groups[key]) for key in order if key in groups], found


def summed(family: str, planner: str, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """A row of one planner's plans; one that was not found counts as priority zero."""
    routes = [run["route"] for run in runs]
    priority = np.array([route.priority if route.feasible else 0.0 for route in routes])
    gaps = 1.0 - priority / [run["bound"] for run in runs]
    return {
        "family": family, "planner": planner, "graphs": len({run["seed"] for run in runs}),
        "proved": float(np.mean([run["priority"] == run["bound"] for run in runs])),
        "tasks": float(np.mean([route.tasks for route in routes])),
        "feasible": float(np.mean([route.feasible for route in routes])),
        "mean_gap": float(gaps.mean()), "worst_gap": float(gaps.max()),
        "optimal": float((gaps < 1e-9).mean()),
        "wall_ms": 1e3 * statistics.median(run["wall"] for run in runs),
        "user_ms": 1e3 * statistics.median(run["user"] for run in runs),
    }  # fmt: skip


def timings(repeats: int) -> list[dict[str, Any]]:
    """Travel times by departure in a tidal stream, and plans by them; medians but for the first calls."""
    departures, rows = INTERVAL * np.arange(DEPARTURES), []
    times = np.arange(-3600.0, DEPARTURES * INTERVAL + 7200.0, 300.0)
    swing = np.cos(2.0 * np.pi * times / PERIOD)[:, None, None, None]
    u, v = (np.broadcast_to(strength * swing, (len(times), 1, 2, 2)) for strength in STREAM)
    tide = GriddedCurrent.from_arrays(u, v, origin=(-5e4, -5e4), spacing=1e5, times=times)
    sea = ap.Environment(tide, lower=np.zeros(3), upper=np.array([EXTENT, EXTENT, 100.0]))

    def travel(graph: MissionGraph) -> Any:
        return graph.times_at(sea, ap.Vehicle(speed=SPEED), departures, bends=BENDS)

    def measure(what: str, asked: float, call: Callable[[int], Any]) -> Any:
        first, _, result = clock(partial(call, 0))
        runs = [clock(partial(call, k)) for k in range(1, repeats + 1)]
        wall, user = (statistics.median(run[k] for run in runs) for k in range(2))
        row = {"what": what, "asked": asked, "first_seconds": first}
        rows.append(row | {"wall_seconds": wall, "user_seconds": user})
        return result

    for size, seconds in ((SIZE, 0.2), (5 * SIZE, 2.0)):
        rng = np.random.default_rng(size)
        positions = rng.uniform(0.0, EXTENT, (size, 3)) * [1.0, 1.0, 0.01]
        graph = random_graph(rng, positions)
        if size == SIZE:
            edges = graph.adjacency.sum()
            what = f"travel times, {size} waypoints, {edges:,} edges, {DEPARTURES} departures"
            found = measure(what, 1.0, lambda _, graph=graph: travel(graph))
            every = replace(graph, adjacency=~np.eye(size, dtype=bool))
            what = f"the same, complete: {size * (size - 1):,} edges"
            measure(what, 1.0, lambda _, every=every: travel(every))
        else:
            found = graph.times_at(sea, ap.Vehicle(speed=SPEED), departures)
        tasks = _tasks(rng, size, AVAILABLE[0], TIGHT_SHARES[1])
        by_clock = timed_graph(positions, found, *tasks, departures=departures)
        timed = Case("", "", by_clock, 0, size - 1, AVAILABLE[0], SPEED)
        what = f"plan, {size} waypoints, {DEPARTURES} departures, windows"
        measure(what, seconds, timed.plan)
    return rows


@launch(
    graphs=(CASES, "how many; 0 for the timings alone"),
    first=(FIRST_SEED, "seed of the first graph"),
    repeats=(5, "timed calls; 0 for no timings"),
)
def main(graphs: int, first: int, repeats: int) -> dict[str, Any]:
    rows, found = compared(graphs, first) if graphs else ([], [])
    timed, load = timings(repeats) if repeats else [], os.getloadavg()[0]
    if rows:
        show("Routes by the clock: gap to the best", rows, GAPS, names=2)
        seconds = statistics.median(each["seconds"] for each in found)
        screen.print(f"proofs by labels: {seconds:.1f} s, median of {len(found)} graphs")
    if timed:
        show("Timings", timed, TIMINGS)
    screen.print(f"load {load:.1f}")
    return {"load": load, "graphs": found, "rows": rows, "timings": timed}
