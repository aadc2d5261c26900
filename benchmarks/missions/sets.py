"""Missions of the benchmark: shared task graphs, orienteering sets and generated graphs."""

import gzip
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.mission import MissionGraph, MissionRoute, plan_mission, random_graph
from auvplan.mission.timetable import Timetable
from benchmarks.harness import SHARED

#: Task graphs of 40 waypoints and their proven optima.
GRAPHS = SHARED / "missions" / "graphs.json.gz"


@dataclass(frozen=True)
class Case:
    name: str
    family: str  # cases of one family have one size N and share a row of the table
    graph: MissionGraph
    start: int
    goal: int
    time_available: float  # T_available, s; in the orienteering sets a length, executed at speed 1
    speed: float  # |v|, m/s
    optimum: float | None = None  # most total priority, where it is known
    # [N] prize of each waypoint, where the priorities rho_ij = (prize_i + prize_j) / 2 stand for prizes of
    # waypoints
    prizes: NDArray[np.floating] | None = None

    @property
    def leg_times(self) -> NDArray[np.floating]:
        """[N, N] s."""
        return self.graph.leg_times(self.speed)

    @property
    def searched(self) -> tuple[Any, ...]:
        """What searches over edges are asked: leg times, priorities, start, goal and the time available."""
        return self.leg_times, self.graph.priority, self.start, self.goal, self.time_available

    def plan(self, seed: int, **how: Any) -> MissionRoute:
        """Plan by the package, `how` as `plan_mission` takes it."""
        asked = self.graph, self.start, self.goal, self.time_available
        return plan_mission(*asked, speed=self.speed, key=jax.random.key(seed), **how)


def timed_graph(
    places: NDArray[np.floating], travel: NDArray[np.floating], *tasks: NDArray[np.floating],
    departures: NDArray[np.floating] | None = None,
) -> MissionGraph:  # fmt: skip
    """Return a graph by the clock, whose tasks are at waypoints.

    Args:
        places: [N, 2] m, or [N, 3].
        travel: [T, N, N] s, infinite where there is no edge.
        tasks: [N] priority and duration [s], and when the task opens and closes, [N] or [N, W] s.
        departures: [T] s; None for steady travel times.
    """
    size = len(places)
    priority, duration, *windows = (
        np.broadcast_to(task.astype(float), (size, *task.shape)).copy() for task in tasks
    )
    positions = places if places.shape[1] == 3 else np.c_[places, np.zeros(size)]
    graph = MissionGraph(positions, np.isfinite(travel[0]), priority, duration)
    opens, closes = (np.atleast_3d(times) for times in windows)
    departures = np.zeros(1) if departures is None else departures
    return graph.with_timetable(Timetable(departures, travel, opens, closes))


def generated() -> Iterator[Case]:
    """Graphs of `random_graph` in a box of 10 km by 10 km by 100 m, four hours at 2.5 m/s."""
    for size, seed in product((40, 100), range(3)):
        rng = np.random.default_rng(seed)
        graph = random_graph(rng, rng.uniform(0.0, 10_000.0, (size, 3)) * [1.0, 1.0, 0.01])
        yield Case(f"random{size}-s{seed}", f"random{size}", graph, 0, size - 1, 14_400.0, 2.5)


def job_lists() -> Iterator[Case]:
    """Jobs in a square of 10 km that all lead to each other, at 1.5 m/s: most, not all, fit the time."""
    speed, side = 1.5, 10_000.0
    for size, seed in product((20, 40, 80), range(5)):
        rng = np.random.default_rng([size, seed])
        places = np.c_[rng.uniform(0.0, side, (size, 2)), np.full(size, 5.0)]
        prizes = rng.integers(1, 6, size).astype(float)
        prizes[[0, -1]] = 0.0
        # Of the length of a tour of all of them (Beardwood, Halton and Hammersley).
        time_available = round(0.6 * 0.7124 * side * size**0.5 / speed, -1)
        graph = _of_prizes(places, prizes)
        name = f"jobs{size}"
        yield Case(f"{name}-s{seed}", name, graph, 0, size - 1, time_available, speed, prizes=prizes)


def _of_prizes(places: NDArray[np.floating], prizes: NDArray[np.floating]) -> MissionGraph:
    """Return the complete graph whose priorities are the means of the prizes [N] at both ends."""
    size = len(prizes)
    priority = 0.5 * (prizes[:, None] + prizes[None, :])
    np.fill_diagonal(priority, 0.0)
    return MissionGraph(places, ~np.eye(size, dtype=bool), priority, np.zeros((size, size)))


def task_graphs() -> list[Case]:
    """Graphs of the shared data with proven optima; none where they are absent."""
    if not GRAPHS.exists():
        return []
    with gzip.open(GRAPHS) as file:
        stored = json.load(file)
    cases = []
    for case in stored:
        size = case["n"]
        adjacency, travel = np.zeros((size, size), bool), np.full((size, size), np.nan)
        priority, duration = np.zeros((size, size)), np.zeros((size, size))
        for i, j, length, rho, delta in case["edges"]:
            both = [i, j], [j, i]
            adjacency[both], priority[both], duration[both] = True, rho, delta
            travel[both] = length / case["v"]
        graph = MissionGraph(np.array(case["nodes"], float), adjacency, priority, duration, travel)
        family, optimum = f"{case['family']}{size}", float(case["optimum"])
        ends = case["start"], case["dest"]
        cases.append(Case(case["name"], family, graph, *ends, case["T"], case["v"], optimum))
    return sorted(cases, key=lambda case: (case.graph.size, case.name))


def orienteering() -> Iterator[Case]:
    """Orienteering sets of the shared data; none where they are absent."""
    folder = SHARED / "orienteering"
    if not folder.exists():
        return
    optima = json.loads((folder / "optimal.json").read_text())
    for family, pattern, key in (
        ("Tsiligirides 1", "Tsiligirides_1/*.txt", "tsiligirides_problem_1"),
        ("Chao 64", "ChaoSet_64/*.txt", "set_64_1"),
    ):
        for path in sorted(folder.glob(pattern)):
            rows = [line.split() for line in path.read_text().splitlines() if line.strip()]
            points, budget = np.array(rows[1:], float), float(rows[0][0])
            number = int(re.findall(r"\d+", path.stem)[-1])
            prizes = points[:, 2]
            graph = _of_prizes(np.c_[points[:, :2], np.zeros(len(points))], prizes)
            optimum = float(optima[key][str(number)])
            name = f"{family} T={budget:g}"
            yield Case(name, family, graph, 0, 1, budget, 1.0, optimum, prizes)
