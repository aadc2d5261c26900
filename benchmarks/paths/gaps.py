"""How far plans are above the references of their problems: runs, and what they come to."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import jax
import numpy as np

import auvplan as ap
from benchmarks.harness import clock, figures, grouped, show, track
from benchmarks.paths.problems import PRESETS, PathProblem
from benchmarks.paths.references import STORED_PATHS, Reference, reference_of
from benchmarks.paths.ruler import World, evaluate


def _plainer(iterations: int | None = None, **changes: Any) -> ap.PathConfig:
    """The default without the finer polish, which makes up for much, and with other changes."""
    config = ap.PathConfig(finer=1, **changes)
    return config if iterations is None else config.replace(bbo=config.bbo.replace(iterations=iterations))


#: The default without some of its parts; all but the first of them lack the finer polish too.
VARIANTS: dict[str, Callable[[], ap.PathConfig]] = {
    "no finer polish": _plainer,
    "no evolution": partial(_plainer, 0),
    "no gradient before": partial(_plainer, passage_steps=0),
    "no gradient after": partial(_plainer, refine_steps=0),
    "no gradient": partial(_plainer, passage_steps=0, refine_steps=0),
    "no passages": partial(_plainer, passages=0),
    "evolution only": partial(_plainer, passages=0, refine_steps=0),
}

COMPILING = {"compiling": "{compile_seconds:.1f} s"}

#: One plan beside its reference [s], None where that is not known. `travel_time` is the ruler's, s, None
#: where the current beats the vehicle; `claimed` says whether the planner holds it feasible, `feasible`
#: whether the ruler does; `gap` is a share, None for a plan that breaks a limit.
Run = dict[str, Any]


def plan_one(
    problem: PathProblem, presets: Sequence[str], reference: Reference | None, seeds: Iterable[int] = (0,)
) -> list[Run]:
    """Plan a problem with each preset from some seeds, after a plan that compiles what it needs."""
    runs, world = [], World.of(problem)
    for preset in presets:
        config = {**PRESETS, **VARIANTS}[preset]()
        first, _ = clock(partial(problem.plan, jax.random.key(10_000), config))
        for seed in seeds:
            seconds, made = clock(partial(problem.plan, jax.random.key(seed), config))
            score = evaluate(problem, made.positions, world)
            run = {
                "problem": problem.name, "family": problem.family, "preset": preset, "seed": seed,
                "travel_time": score.travel_time if np.isfinite(score.travel_time) else None,
                "claimed": made.feasible, "feasible": score.feasible, "status": made.status.name,
                "seconds": seconds, "compile_seconds": max(first - seconds, 0.0),
                "error": reference and reference.error,
            }  # fmt: skip
            runs.append(beside(run, reference and reference.travel_time))
    return runs


def beside(run: Run, reference: float | None) -> Run:
    """Return the run with this reference and the gap to it."""
    known = reference is not None and run["travel_time"] is not None and run["feasible"]
    return run | {"reference": reference, "gap": run["travel_time"] / reference - 1.0 if known else None}


def summed(name: str, runs: Sequence[Run]) -> dict[str, Any]:
    """Sum up runs of one preset; the feasible share is of the problems that have a reference."""
    known = [run["feasible"] for run in runs if run["reference"] is not None]
    wrong, unknown = sum(run["claimed"] and not run["feasible"] for run in runs), len(runs) - len(known)
    return figures([run["gap"] for run in runs if run["gap"] is not None]) | {
        "name": name, "preset": runs[0]["preset"], "feasible": figures(known)["mean"],
        "false_claims": wrong, "wrong": f" ({wrong} wrong)" if wrong else "",
        "milliseconds": 1e3 * float(np.median([run["seconds"] for run in runs])),
        "compile_seconds": sum({run["problem"]: run["compile_seconds"] for run in runs}.values()),
        "plans": len(runs), "unknown": f" ({unknown} unknown)" if unknown else "",
    }  # fmt: skip


def rows(runs: Iterable[Run], by: str) -> list[dict[str, Any]]:
    groups = grouped(runs, lambda run: [(run[by], run["preset"])])
    return [summed(name, members) for (name, _), members in groups.items()]


def show_gaps(title: str, found: Sequence[dict[str, Any]], **more: str) -> None:
    columns = {
        "set": "{name}", "preset": "{preset}", "mean gap": "{mean:.2%}", "median": "{median:.2%}",
        "95 %": "{p95:.2%}", "99 %": "{p99:.2%}", "worst": "{worst:.2%}",
        "feasible": "{feasible:.1%}{wrong}", "ms a plan": "{milliseconds:.0f}",
    }  # fmt: skip
    show(title, found, columns | more | {"plans": "{plans}{unknown}"}, names=2)


def plan_all(problems: Sequence[PathProblem], presets: Sequence[str], seeds: int) -> list[Run]:
    runs = []
    for problem in track(sorted(problems, key=lambda problem: problem.family), "plans"):
        runs += plan_one(problem, presets, reference_of(problem, STORED_PATHS), range(seeds))
    return runs
