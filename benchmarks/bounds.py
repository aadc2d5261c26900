"""Lower bounds of path times: how near they come, and whether any path of the ruler beats one.

`python -m benchmarks.bounds --seeds 6000:6034` bounds the plans of a preset, with `--references` the stored
references. `--known 1.25` has the bounds worked out as if no path were known that is quicker than 1.25 times
that: a bound that then lies above the quickest path which the ruler holds feasible is a violation.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import jax
import numpy as np

import auvplan as ap
from auvplan.path.bound import lower_bound
from benchmarks.harness import clock, figures, grouped, launch, screen, show
from benchmarks.paths.depths import DEPTH_FAMILIES, have_levels, posed
from benchmarks.paths.problems import PRESETS
from benchmarks.paths.references import STORED, STORED_DEEP, load, stored_reference
from benchmarks.paths.ruler import evaluate
from benchmarks.paths.waters import FAMILIES

#: Share of its time by which a path may beat a bound unnoticed: rounding of the ruler.
_ROUNDING = 1e-6

COLUMNS = {
    "family": "{family}", "median": "{median:.2%}", "mean": "{mean:.2%}", "90 %": "{p90:.2%}",
    "worst": "{worst:.2%}", "violations": "{violations}", "certified": "{certified:.0%}",
    "s a bound": "{seconds:.2f}", "problems": "{count}",
}  # fmt: skip


def bounds(
    families: Sequence[str], seeds: Sequence[int], preset: str | None, known: float, fineness: float
) -> Iterator[dict[str, Any]]:
    """Bound the problems that have a stored reference; those whose plan breaks a limit are left out.

    Args:
        preset: whose plans are bounded; None for the references.
        known: times the travel time that is taken to be known.

    Yields:
        `travel_time` of the plan or reference by the ruler, `quickest` of all paths known that it holds
        feasible, `bound`, s; `gap`, the share by which the path is above it; whether it is `violated`.
    """
    stored = load(STORED) | load(STORED_DEEP)
    for seed in seeds:
        for family in families:
            if (stored.get(f"{family}-{seed}") or {}).get("travel_time") is None:
                continue
            problem = posed(family, seed)
            reference = stored_reference(problem, stored)
            if reference is None:
                continue
            time = reference.travel_time
            if preset is not None:
                plan = problem.plan(jax.random.key(0), PRESETS[preset]())
                score = evaluate(problem, plan.positions)
                if not score.feasible:
                    continue
                time = score.travel_time
            ends = np.asarray(problem.start, float), np.asarray(problem.goal, float)
            asked = *ends, problem.environment, problem.vehicle, ap.PathConfig(**problem.changes)
            more = {"known": known * time, "depart": problem.depart, "fineness": fineness}
            seconds, found = clock(lambda asked=asked, more=more: lower_bound(*asked, **more))
            quickest, bound = min(time, reference.travel_time), found.travel_time
            yield {
                "problem": problem.name, "family": family, "travel_time": time, "quickest": quickest,
                "bound": bound, "kind": found.kind, "seconds": seconds,
                "gap": time / bound - 1.0 if bound > 0.0 else np.inf,
                "violated": bool(bound > quickest * (1.0 + _ROUNDING)),
            }  # fmt: skip


def summed(family: str, runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return figures([run["gap"] for run in runs]) | {
        "family": family, "count": len(runs), "violations": sum(run["violated"] for run in runs),
        "certified": np.mean([run["kind"] == "certified" for run in runs]),
        "seconds": np.median([run["seconds"] for run in runs]),
    }  # fmt: skip


@launch(
    seeds=(range(4), "FIRST:END, the end left out"),
    families=(FAMILIES, "of waters", [*FAMILIES, *DEPTH_FAMILIES]),
    preset=("default", "whose plans are bounded", PRESETS),
    references=(False, "bound the references instead of plans"),
    known=(1.0, "times the path's time, taken to be known"),
    fineness=(1.0, "factor on the cells along each axis"),
)
def main(
    seeds: range, families: list[str], preset: str, references: bool, known: float, fineness: float
) -> dict[str, Any]:
    chosen = [name for name in families if name != "file" or have_levels()]
    runs = []
    for run in bounds(chosen, seeds, None if references else preset, known, fineness):
        runs.append(run)
        mark = " VIOLATED" if run["violated"] else ""
        screen.print("{problem}: {travel_time:.1f} s, bound {bound:.1f} s, {gap:.2%}".format(**run) + mark)
    groups = sorted(grouped(runs, lambda run: [run["family"]]).items())
    found = [summed(*group) for group in (*groups, ("all", runs))] if runs else []
    show("Travel time above its lower bound", found, COLUMNS)
    return {"runs": runs}
