"""Solvers run on families of missions: gaps, rules kept, times with the compilation apart."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import jax
import numpy as np
from rich.progress import Progress

from auvplan.mission import (
    MissionConfig,
    MissionGraph,
    check_route,
    plan_mission,
    plan_missions,
    time_to_go,
)
from auvplan.mission.bound import upper_bound
from benchmarks import mission_peers as peers
from benchmarks.machine import clock
from benchmarks.mission_sets import Case

BATCH = 32
PHI1, PHI2 = 1.0, 100.0


@dataclass(frozen=True)
class Row:
    """One solver on the cases of one family.

    Attributes:
        mean_gap: share of the optimum that is missing.
        worst_gap: the same, of the worst plan.
        feasible: share of plans that keep all rules.
        seconds: median time of a plan, compilation apart.
        compile_seconds: how much longer the first call took, the most of the graphs of this size
            so far; None where nothing is compiled.
        proved: share of cases whose optimum is proved.
    """

    family: str
    solver: str
    mean_gap: float
    worst_gap: float
    feasible: float
    seconds: float
    compile_seconds: float | None
    plans: int
    proved: float


@dataclass(frozen=True)
class Solver:
    """A way to plan.

    Attributes:
        plan: (case, seed) into waypoints, none where there is no plan.
        compiles: a call that compiles what `plan` needs; None where nothing is compiled.
        seeds: plans of each case at most.
    """

    name: str
    plan: Callable[[Case, int], Any]
    compiles: Callable[[Case], Any] | None = None
    seeds: int | None = None
    fits: Callable[[Case], bool] = lambda case: True


class Bench:
    """Runs solvers on families of cases and collects rows.

    Args:
        seeds: plans of each case.
    """

    def __init__(self, seeds: int, progress: Progress) -> None:
        self.rows: list[Row] = []
        self._seeds, self._progress = seeds, progress
        self._optima: dict[str, tuple[float, bool]] = {}
        self._compilation: dict[tuple[str, int], float] = {}

    def compare_with(self, optima: dict[str, tuple[float, bool]]) -> None:
        """Total priority to compare with and whether it is proved, by name of the case."""
        self._optima |= optima

    def run(self, family: str, cases: list[Case], solver: Solver) -> None:
        """Plan each case with each seed, one at a time."""
        seeds = min(self._seeds, solver.seeds or self._seeds)
        bar = self._progress.add_task(f"{family}, {solver.name}", total=len(cases) * seeds)
        compiles = solver.compiles
        if compiles is not None:
            for case in cases:
                self._clock_compilation(solver.name, case.graph.size, partial(compiles, case))
        gaps, kept, times = [], [], []
        for case in cases:
            for seed in range(seeds):
                seconds, nodes = clock(partial(solver.plan, case, seed))
                times.append(seconds)
                gap, valid = self._judge(case, nodes)
                gaps.append(gap)
                kept.append(valid)
                self._progress.advance(bar)
        self._add(family, solver.name, cases, gaps, kept, times)
        self._progress.remove_task(bar)

    def run_batched(self, family: str, cases: list[Case], repeats: int = 3) -> None:
        """Plan the cases of a family, repeated with other seeds, in calls of `BATCH` missions."""
        name = f"default, {BATCH} in one call"
        batch = [cases[k % len(cases)] for k in range(BATCH)]
        graphs = MissionGraph.stack(case.graph for case in batch)
        starts, goals = [case.start for case in batch], [case.goal for case in batch]
        budgets, speeds = [case.time_available for case in batch], [case.speed for case in batch]

        def call(seed: int) -> Any:
            keys = jax.random.split(jax.random.key(seed), BATCH)
            return plan_missions(graphs, starts, goals, budgets, speed=speeds, key=keys)

        bar = self._progress.add_task(f"{family}, {name}", total=repeats)
        self._clock_compilation(name, cases[0].graph.size, partial(call, 999))
        gaps, kept, times = [], [], []
        for seed in range(repeats):
            seconds, routes = clock(partial(call, seed))
            times.append(seconds / BATCH)
            for case, route in zip(batch, routes, strict=True):
                gap, valid = self._judge(case, route.nodes)
                gaps.append(gap)
                kept.append(valid)
            self._progress.advance(bar)
        self._add(family, name, cases, gaps, kept, times)
        self._progress.remove_task(bar)

    def run_bound(self, family: str, cases: list[Case]) -> None:
        """The linear bound: its gap is how far it is above the optimum."""
        gaps, times = [], []
        for case in cases:
            asked = case.leg_times, case.graph.priority, case.start, case.goal, case.time_available
            seconds, bound = clock(partial(upper_bound, *asked))
            times.append(seconds)
            gaps.append(bound / self._optima[case.name][0] - 1.0)
        self._add(family, "upper bound", cases, gaps, [True] * len(gaps), times)

    def run_replanning(self, family: str, cases: list[Case], situations: int = 50) -> None:
        """Plan again on the way; the gap is to the rest of the old route where that still fits the time.

        Late vehicles that no route brings home in time, by the shortest path, count as feasible.
        """
        rng = np.random.default_rng(0)
        gaps, kept, times = [], [], []
        for turn in range(-1, situations):
            case = cases[turn % len(cases)]
            budget, key = case.time_available, jax.random.key(turn + 1)
            old = plan_mission(case.graph, case.start, case.goal, budget, speed=case.speed, key=key)
            passed = int(rng.integers(1, len(old.nodes) - 1))
            left = budget - float(old.leg_times[:passed].sum()) * rng.uniform(0.9, 1.1)
            graph = case.graph.without_edges(pairwise(old.nodes[: passed + 1].tolist()))
            rest = old.nodes[passed:]
            begin = time.perf_counter()
            route = plan_mission(
                graph, int(rest[0]), case.goal, left, speed=case.speed, key=key,
                population=old.population, known_route=rest,
            )  # fmt: skip
            if turn < 0:
                continue
            times.append(time.perf_counter() - begin)
            fits = old.leg_times[passed:].sum() < left * (1.0 - 1e-5)
            remainder = sum(case.graph.priority[leg] for leg in pairwise(rest)) if fits else 0.0
            gaps.append(max(0.0, 1.0 - route.priority / remainder) if remainder else 0.0)
            shortest = float(time_to_go(graph.leg_times(case.speed), case.goal)[rest[0]])
            valid = check_route(graph, route.nodes, rest[0], case.goal, left, case.speed).valid
            kept.append(valid or (shortest >= left and not route.feasible))
        self._add(f"{family}, on the way", "re-plan against the old rest", cases, gaps, kept, times)

    def run_eq15(self, family: str, cases: list[Case], time_limit: float) -> None:
        """Eq. 15 as the aim: costs against the best and the bound that CP-SAT finds."""
        config = MissionConfig(objective="eq15", phi1=PHI1, phi2=PHI2)
        plan = partial(preset, config=config)
        bar = self._progress.add_task(f"{family}, Eq. 15", total=len(cases) * (self._seeds + 1))
        for case in cases:
            self._clock_compilation("eq15", case.graph.size, partial(plan, case, 999))
        gaps, times, proved, peer_times, kept = [], [], [], [], []
        for case in cases:
            seconds, (nodes, bound) = clock(partial(peers.cp_sat_eq15, case, PHI1, PHI2, time_limit))
            peer_times.append(seconds)
            best = peers.eq15_cost(case, nodes, PHI1, PHI2)
            proved.append(best <= bound * (1.0 + 1e-3))
            self._progress.advance(bar)
            for seed in range(self._seeds):
                seconds, nodes = clock(partial(plan, case, seed))
                times.append(seconds)
                kept.append(self._judge(case, nodes)[1])
                gaps.append(peers.eq15_cost(case, nodes, PHI1, PHI2) / best - 1.0)
                self._progress.advance(bar)
        share = float(np.mean(proved))
        self._add(f"{family}, cost of Eq. 15", "eq15", cases, gaps, kept, times, proved=share)
        none = [0.0] * len(cases)
        self._add(
            f"{family}, cost of Eq. 15", "CP-SAT", cases, none, [True] * len(cases), peer_times, proved=share
        )
        self._progress.remove_task(bar)

    def _clock_compilation(self, solver: str, size: int, call: Callable[[], Any]) -> None:
        """How much longer the first call takes than the second, the most of all graphs of one size."""
        times = [clock(call)[0] for _ in range(2)]
        known = self._compilation.get((solver, size), 0.0)
        self._compilation[solver, size] = max(times[0] - times[1], known)

    def _judge(self, case: Case, nodes: Any) -> tuple[float, bool]:
        """Gap of a route and whether it keeps all rules."""
        valid = check_route(case.graph, nodes, case.start, case.goal, case.time_available, case.speed).valid
        found = sum(case.graph.priority[leg] for leg in pairwise(map(int, nodes))) if valid else 0.0
        return 1.0 - found / self._optima[case.name][0], valid

    def _add(
        self, family: str, solver: str, cases: list[Case], gaps: list[float], kept: list[bool],
        times: list[float], proved: float | None = None,
    ) -> None:  # fmt: skip
        known = float(np.mean([self._optima[case.name][1] for case in cases]))
        row = Row(
            family=family,
            solver=solver,
            mean_gap=float(np.mean(gaps)),
            worst_gap=float(np.max(gaps)),
            feasible=float(np.mean(kept)),
            seconds=float(np.median(times)),
            compile_seconds=self._compilation.get((solver, cases[0].graph.size)),
            plans=len(gaps),
            proved=known if proved is None else proved,
        )
        self.rows.append(row)


def preset(case: Case, seed: int, config: MissionConfig) -> Any:
    """Waypoints that `plan_mission` finds."""
    route = plan_mission(
        case.graph, case.start, case.goal, case.time_available, speed=case.speed,
        key=jax.random.key(seed), config=config,
    )  # fmt: skip
    return route.nodes if route.feasible else []
