"""Mission planning against proven optima and against other solvers: ``python -m benchmarks.missions``.

The gap of a plan is 1 - priority / optimum, or to the least upper bound where no optimum is proved. A plan
that was not found, or breaks a rule of section 3.3, counts as priority zero. PyVRP, which cannot express
tasks on edges, runs on the orienteering sets only. The paper preset minimises Eq. 15, which is not the most
total priority.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product
from typing import Any

import jax
import numpy as np

import auvplan as ap
from auvplan.mission import MissionGraph, check_route, plan_missions, time_to_go
from auvplan.mission.bound import upper_bound
from auvplan.mission.exact import solve_exact
from benchmarks.harness import SHARED, available, clock, clock_all, grouped, installed, launch, screen, show
from benchmarks.missions import peers
from benchmarks.missions.sets import Case, generated, job_lists, orienteering, task_graphs

BATCH, LARGEST_BATCHED, LARGEST_MEALPY, PEER_SEEDS = 32, 100, 64, 2
PHI1, PHI2 = 1.0, 100.0
#: s, to prove an optimum in, and that PyVRP has.
LIMIT, SECONDS = 60.0, 2.0


@dataclass(frozen=True)
class Solver:
    name: str
    plan: Callable[[Case, int], Any]  # (case, seed) into waypoints, none where there is no plan
    # a call that compiles what `plan` needs; None where nothing is compiled
    compiles: Callable[[Case], Any] | None = None
    seeds: int | None = None  # plans of each case at most
    fits: Callable[[Case], bool] = lambda case: True


def preset(case: Case, seed: int, config: ap.MissionConfig) -> Any:
    route = case.plan(seed, config=config)
    return route.nodes if route.feasible else []


def variants() -> dict[str, ap.MissionConfig]:
    """What each part of the default preset is worth, one step at a time from the paper's."""
    paper, default = ap.MissionConfig.paper(), ap.MissionConfig()
    evolution = default.replace(seeds=0, local_rounds=0)
    return {
        "paper, total priority": paper.replace(objective="priority"),
        "and mutation of two SIVs": evolution.replace(decoder="timely"),
        "and the rate decoder": evolution,
        "and local search": default.replace(seeds=0),
        "beam search alone": default.replace(local_rounds=0, bbo=default.bbo.replace(iterations=0)),
        "evolution from the beam's routes": default.replace(local_rounds=0),
    }


def solvers(with_variants: bool, with_peers: bool) -> list[Solver]:
    """The presets, and with them the peers that are installed; a line for each that is not."""
    found = []
    presets = {"default": ap.MissionConfig(), "paper": ap.MissionConfig.paper()}
    for name, config in (presets | (variants() if with_variants else {})).items():
        plan = partial(preset, config=config)
        found.append(Solver(name, plan, compiles=partial(plan, seed=999)))
    cp_sat = Solver("CP-SAT", lambda case, _: solve_exact(*case.searched, time_limit=LIMIT).nodes, seeds=1)
    pyvrp = Solver(
        f"PyVRP, {SECONDS:g} s", lambda case, seed: peers.pyvrp(case, seed, SECONDS), None, PEER_SEEDS,
        lambda case: case.prizes is not None,
    )  # fmt: skip
    mealpy = Solver(
        "mealpy OriginalBBO", peers.mealpy_bbo, partial(peers.mealpy_bbo, seed=0, population=5, iterations=1),
        PEER_SEEDS, lambda case: case.graph.size <= LARGEST_MEALPY,
    )  # fmt: skip
    needs = (cp_sat, ["ortools"]), (pyvrp, ["pyvrp"]), (mealpy, ["mealpy", "numba"])
    if with_peers:
        found += [solver for solver, packages in needs if available(solver.name, packages)]
    return found


class Bench:
    """Runs solvers on families of cases and collects rows.

    A row has mean and worst gap, the share of plans that keep all rules, the median time of a plan and how
    much longer the first call took, the most of the graphs of this size so far.

    Args:
        seeds: plans of each case.
    """

    def __init__(self, seeds: int) -> None:
        self.rows: list[dict[str, Any]] = []
        self._seeds = seeds
        self._optima: dict[str, tuple[float, bool]] = {}
        self._compilation: dict[tuple[str, int], float] = {}

    def run(self, family: str, cases: list[Case], solver: Solver) -> None:
        """Plan each case with each seed, one at a time."""
        seeds = min(self._seeds, solver.seeds or self._seeds)
        for case in cases if solver.compiles is not None else ():
            self._clock_compilation(solver.name, case.graph.size, partial(solver.compiles, case))
        planned = [*product(cases, range(seeds))]
        times, routes = clock_all(solver.plan, planned, f"{family}, {solver.name}")
        judged = [self._judge(case, nodes) for (case, _), nodes in zip(planned, routes, strict=True)]
        self._add(family, solver.name, cases, *zip(*judged, strict=True), times)

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

        self._clock_compilation(name, cases[0].graph.size, partial(call, 999))
        times, found = clock_all(call, [(seed,) for seed in range(repeats)], f"{family}, {name}")
        pairs = [pair for routes in found for pair in zip(batch, routes, strict=True)]
        judged = [self._judge(case, route.nodes) for case, route in pairs]
        self._add(family, name, cases, *zip(*judged, strict=True), [seconds / BATCH for seconds in times])

    def run_bound(self, family: str, cases: list[Case]) -> None:
        """Find the total priority to compare with, and how far the linear bound is above it."""
        for case in cases:
            known = case.optimum is not None
            self._optima[case.name] = (case.optimum, True) if known else peers.reference(case, LIMIT)
        times, bounds = clock_all(upper_bound, [case.searched for case in cases], f"{family}, upper bound")
        gaps = [bound / self._optima[case.name][0] - 1.0 for case, bound in zip(cases, bounds, strict=True)]
        self._add(family, "upper bound", cases, gaps, [True], times, sign="+")

    def run_replanning(self, family: str, cases: list[Case], situations: int = 50) -> None:
        """Plan again on the way; the gap is to the rest of the old route where that still fits the time.

        Late vehicles that no route brings home in time, by the shortest path, count as feasible.
        """
        rng = np.random.default_rng(0)
        gaps, kept, times = [], [], []
        for turn in range(-1, situations):
            case = cases[turn % len(cases)]
            budget, old = case.time_available, case.plan(turn + 1)
            passed = int(rng.integers(1, len(old.nodes) - 1))
            left = budget - float(old.leg_times[:passed].sum()) * rng.uniform(0.9, 1.1)
            graph = case.graph.without_edges(pairwise(old.nodes[: passed + 1].tolist()))
            rest = old.nodes[passed:]
            onward = replace(case, graph=graph, start=int(rest[0]), time_available=left)
            known = {"population": old.population, "known_route": rest}
            seconds, route = clock(partial(onward.plan, turn + 1, **known))
            if turn < 0:
                continue
            times.append(seconds)
            fits = old.leg_times[passed:].sum() < left * (1.0 - 1e-5)
            remainder = sum(case.graph.priority[leg] for leg in pairwise(rest)) if fits else 0.0
            gaps.append(max(0.0, 1.0 - route.priority / remainder) if remainder else 0.0)
            shortest = float(time_to_go(graph.leg_times(case.speed), case.goal)[rest[0]])
            valid = check_route(graph, route.nodes, rest[0], case.goal, left, case.speed).valid
            kept.append(valid or (shortest >= left and not route.feasible))
        self._add(f"{family}, on the way", "re-plan against the old rest", cases, gaps, kept, times)

    def run_eq15(self, family: str, cases: list[Case]) -> None:
        """Eq. 15 as the aim: costs against the best and the bound that CP-SAT finds."""
        plan = partial(preset, config=ap.MissionConfig(objective="eq15", phi1=PHI1, phi2=PHI2))
        for case in cases:
            self._clock_compilation("eq15", case.graph.size, partial(plan, case, 999))
        asked = [(case, PHI1, PHI2, LIMIT) for case in cases]
        peer_times, solved = clock_all(peers.cp_sat_eq15, asked, f"{family}, Eq. 15 by CP-SAT")
        best, proved = {}, []
        for case, (nodes, bound) in zip(cases, solved, strict=True):
            best[case.name] = peers.eq15_cost(case, nodes, PHI1, PHI2)
            proved.append(best[case.name] <= bound * (1.0 + 1e-3))
        planned = [*product(cases, range(self._seeds))]
        times, routes = clock_all(plan, planned, f"{family}, Eq. 15")
        pairs = [(case, nodes) for (case, _), nodes in zip(planned, routes, strict=True)]
        kept = [self._judge(case, nodes)[1] for case, nodes in pairs]
        gaps = [peers.eq15_cost(case, nodes, PHI1, PHI2) / best[case.name] - 1.0 for case, nodes in pairs]
        name, share = f"{family}, cost of Eq. 15", float(np.mean(proved))
        self._add(name, "eq15", cases, gaps, kept, times, proved=share)
        self._add(name, "CP-SAT", cases, [0.0] * len(cases), [True], peer_times, proved=share)

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
        self, family: str, solver: str, cases: list[Case], gaps: Any, kept: Any, times: list[float],
        proved: float | None = None, sign: str = "",
    ) -> None:  # fmt: skip
        """Add a row; `proved` is the share of the cases whose optimum is."""
        if proved is None:
            proved = float(np.mean([self._optima[case.name][1] for case in cases]))
        self.rows.append({
            "family": family, "solver": solver, "mean_gap": float(np.mean(gaps)), "plans": len(gaps),
            "worst_gap": float(np.max(gaps)), "feasible": float(np.mean(kept)), "proved": proved,
            "milliseconds": 1e3 * float(np.median(times)), "sign": sign,
            "star": "" if proved == 1.0 else " *",
            "compile_seconds": self._compilation.get((solver, cases[0].graph.size)),
        })  # fmt: skip


COLUMNS = {
    "set": "{family}", "solver": "{solver}", "mean gap": "{sign}{mean_gap:.2%}{star}",
    "worst gap": "{sign}{worst_gap:.2%}", "feasible": "{feasible:.0%}",
    "time per plan": "{milliseconds:.1f} ms", "compilation": "{compile_seconds:.1f} s", "plans": "{plans}",
}  # fmt: skip


@launch(
    seeds=(10, "plans of each case"),
    peers=(False, "other solvers too"),
    variants=(False, "what each part of the default is worth"),
    only=((), "families to run, such as knn40"),
)
def main(seeds: int, peers: bool, variants: bool, only: list[str]) -> dict[str, Any]:
    shared = [*task_graphs(), *orienteering()]
    if not shared:
        screen.print(f"shared graphs and orienteering sets: left out, not found at {SHARED}")
    families = grouped([*shared, *generated(), *job_lists()], lambda case: [case.family])
    sets = {name: cases for name, cases in families.items() if not only or name in only}
    bench, chosen = Bench(seeds), solvers(variants, peers)
    for family, cases in sets.items():
        bench.run_bound(family, cases)
        for solver in chosen:
            if all(solver.fits(case) for case in cases):
                bench.run(family, cases, solver)
        if cases[0].graph.size <= LARGEST_BATCHED:
            bench.run_batched(family, cases)
        if family == "knn40":
            bench.run_replanning(family, cases)
    if "knn40" in sets and installed("ortools"):
        bench.run_eq15("knn40", sets["knn40"])
    else:
        screen.print("Eq. 15: left out, it needs the shared graphs and OR-Tools")
    show("Missions: gap to the proven optimum (* to a bound)", bench.rows, COLUMNS, names=2)
    return {"seeds": seeds, "rows": bench.rows}
