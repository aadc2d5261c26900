"""Path planning in waters that no planner was tuned on: problems by seed, references and the planner's gaps.

`python -m benchmarks.waters --seeds 0:4` prints a row for each family and preset; gaps are as in `paths`.
Where a feasible plan is quicker than the reference, it takes its place for all presets. Seeds below 100 are
for development. References that are not stored are computed first.
"""

import gc
from collections.abc import Iterable, Sequence
from typing import Any

import jax
import numpy as np

from auvplan.runtime.compiled import drop_programs
from benchmarks.harness import figures, grouped, launch, screen, track
from benchmarks.paths.depths import DEPTH_FAMILIES, have_levels, posed
from benchmarks.paths.gaps import Run, beside, plan_one, show_gaps, summed
from benchmarks.paths.problems import PRESETS, PathProblem, have_charts
from benchmarks.paths.references import STORED, STORED_DEEP, Reference, reference_of
from benchmarks.paths.waters import FAMILIES, KINDS

#: Problems after which programs are forgotten: they differ by problem, and hundreds fill a run's memory.
_TOGETHER = 8

#: Families whose problems have a way.
WITH_WAY = *FAMILIES, *DEPTH_FAMILIES

Cases = Sequence[tuple[PathProblem, Reference | None]]


def referenced(families: Sequence[str], seeds: Iterable[int]) -> Cases:
    """Return problems, seed by seed, and their references, computed and stored where that was not done.

    Problems without a way have none.
    """
    chosen, found = [(family, seed) for seed in seeds for family in families], []
    for family, seed in track(chosen, "references"):
        problem, path = posed(family, seed), STORED_DEEP if family in DEPTH_FAMILIES else STORED
        found.append((problem, reference_of(problem, path) if family in WITH_WAY else None))
    return found


def plan_all(cases: Cases, presets: Sequence[str]) -> tuple[list[Run], set[str]]:
    """Plan all problems with every preset.

    Returns:
        ``(runs, replaced)``: where a feasible plan was quicker than the reference, it replaces it in all runs
        of the problem; these are named.
    """
    runs, replaced = [], set()
    for number, (problem, reference) in enumerate(track(cases, "plans"), 1):
        own = plan_one(problem, presets, reference)
        known = np.inf if reference is None else reference.travel_time or np.inf
        quickest = min((run["travel_time"] for run in own if run["feasible"]), default=np.inf)
        if problem.family in WITH_WAY and quickest < known:
            replaced.add(problem.name)
            own = [beside(run, quickest) for run in own]
        runs += own
        if number % _TOGETHER == 0:
            drop_programs()
            jax.clear_caches()
            gc.collect()
    return runs, replaced


@launch(
    seeds=(range(4), "FIRST:END, the end left out"),
    families=((*KINDS, *DEPTH_FAMILIES), "of waters", [*KINDS, *DEPTH_FAMILIES]),
    preset=(("default", "quick"), "to plan with", PRESETS),
    references=(False, "compute references and end"),
)
def main(seeds: range, families: list[str], preset: list[str], references: bool) -> dict[str, Any] | None:
    if not have_charts():
        screen.print("real coast: the shipped chart stands in, the shared maps were not found")
    if "file" in families and not have_levels():
        screen.print("file: left out, the shared currents with levels were not found")
        families = [name for name in families if name != "file"]
    open_, shut = ([name for name in families if (name in WITH_WAY) is way] for way in (True, False))
    cases = referenced(open_, seeds)
    known = [reference for _, reference in cases if reference is not None]
    unknown, spent = sum(one.travel_time is None for one in known), sum(one.seconds for one in known)
    screen.print(f"{len(cases)} references, {unknown} without a path, {spent:.0f} s to compute")
    apart = [one.plane / one.travel_time - 1.0 for one in known if one.plane and one.travel_time]
    if apart:
        screen.print(
            f"{len(apart)} of them found in the vertical plane as well: {np.mean(apart):+.3%} in the mean, "
            f"{max(apart):+.3%} at most"
        )
    if references:
        return None
    runs, replaced = plan_all(cases, preset)
    found = []
    groups = grouped(runs, lambda run: [(name, run["preset"]) for name in (run["family"], "all")])
    for (family, _), members in sorted(groups.items(), key=lambda group: (group[0][0] == "all", group[0][0])):
        errors = figures([run["error"] for run in members if run["error"] is not None])
        own = {"error": errors["mean"], "worst_error": errors["worst"]}
        own["replaced"] = len(replaced & {run["problem"] for run in members})
        found.append(summed(family, members) | own)
    if found:
        errors = {"error, mean": "{error:.3%}", "error, worst": "{worst_error:.2%}"}
        show_gaps("Random waters: gap to the reference", found, **errors)
        screen.print(f"references that a feasible plan was quicker than, and replaced: {len(replaced)}")
    closed, _ = plan_all(referenced(shut, seeds), preset)
    for name in preset if closed else ():
        statuses = [run["status"] for run in closed if run["preset"] == name and not run["claimed"]]
        words = f"{len(statuses)} of {len(closed) // len(preset)} plans reported infeasible"
        screen.print(f"{name}: no way: {words} ({', '.join(sorted(set(statuses))) or 'none'})")
    return {"rows": found, "replaced": sorted(replaced), "runs": [*runs, *closed]}
