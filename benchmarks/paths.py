"""Path planning against global references: ``python -m benchmarks.paths [--each]``.

The gap of a plan is travel time / reference - 1, both measured by `path_ruler`. A plan that breaks a limit
has no gap and lowers the feasible share. Times are of one plan, the compilation apart.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import jax
import numpy as np

import auvplan as ap
from benchmarks.machine import arguments, clock, screen, show, track, write
from benchmarks.path_problems import PRESETS, PathProblem, have_charts, path_problems
from benchmarks.path_ruler import World, evaluate
from benchmarks.references import stored_times


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
    "no passages, 64 polished": partial(_plainer, 0, passages=0, refine_count=64),
    "evolution only": partial(_plainer, passages=0, refine_steps=0),
}

COMPILING = {"compiling": "{compile_seconds:.1f} s"}

#: One plan beside its reference [s], None where that is not known. `travel_time` is the ruler's, s, None
#: where the current beats the vehicle; `claimed` says whether the planner holds it feasible, `feasible`
#: whether the ruler does; `gap` is a share, None for a plan that breaks a limit.
Run = dict[str, Any]


def plan_one(
    problem: PathProblem, preset: str, reference: float | None, world: World, seeds: Iterable[int] = (0,)
) -> list[Run]:
    """Plan a problem from some seeds, after a plan that compiles what is not compiled yet."""
    config = {**PRESETS, **VARIANTS}[preset]()
    first, _ = clock(lambda: problem.plan(jax.random.key(10_000), config))
    runs = []
    for seed in seeds:
        seconds, made = clock(partial(problem.plan, jax.random.key(seed), config))
        score = evaluate(problem, made.positions, world)
        run = {
            "problem": problem.name, "family": problem.family, "preset": preset, "seed": seed,
            "travel_time": score.travel_time if np.isfinite(score.travel_time) else None,
            "claimed": made.feasible, "feasible": score.feasible, "status": made.status.name,
            "seconds": seconds, "compile_seconds": max(first - seconds, 0.0),
        }  # fmt: skip
        runs.append(beside(run, reference))
    return runs


def beside(run: Run, reference: float | None) -> Run:
    """Return the run with this reference and the gap to it."""
    known = reference is not None and run["travel_time"] is not None and run["feasible"]
    return run | {"reference": reference, "gap": run["travel_time"] / reference - 1.0 if known else None}


def summed(name: str, runs: Sequence[Run]) -> dict[str, Any]:
    """Sum up runs of one preset; the feasible share is of the problems that have a reference."""
    gaps = [run["gap"] for run in runs if run["gap"] is not None]
    known = [run["feasible"] for run in runs if run["reference"] is not None]
    mean, median, worst = (figure(of, gaps) for of in (np.mean, np.median, np.max))
    high, highest = (figure(partial(np.percentile, q=q), gaps) for q in (95, 99))
    wrong, unknown = sum(run["claimed"] and not run["feasible"] for run in runs), len(runs) - len(known)
    return {
        "name": name, "preset": runs[0]["preset"], "mean": mean, "median": median, "high": high,
        "highest": highest, "worst": worst, "feasible": figure(np.mean, known),
        "false_claims": wrong, "wrong": f" ({wrong} wrong)" if wrong else "",
        "milliseconds": 1e3 * float(np.median([run["seconds"] for run in runs])),
        "compile_seconds": sum({run["problem"]: run["compile_seconds"] for run in runs}.values()),
        "plans": len(runs), "unknown": f" ({unknown} unknown)" if unknown else "",
    }  # fmt: skip


def figure(of: Callable[..., Any], values: Sequence[float]) -> float | None:
    return float(of(values)) if values else None


def rows(runs: Iterable[Run], by: str) -> list[dict[str, Any]]:
    """A row for each family or problem, as `by` says, and preset."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run[by], run["preset"]), []).append(run)
    return [summed(name, members) for (name, _), members in groups.items()]


def show_gaps(title: str, found: Sequence[dict[str, Any]], **more: str) -> None:
    """Print sums, with more columns."""
    columns = {
        "set": "{name}", "preset": "{preset}", "mean gap": "{mean:.2%}", "median": "{median:.2%}",
        "95 %": "{high:.2%}", "99 %": "{highest:.2%}", "worst": "{worst:.2%}",
        "feasible": "{feasible:.1%}{wrong}", "ms a plan": "{milliseconds:.0f}",
    }  # fmt: skip
    show(title, found, columns | more | {"plans": "{plans}{unknown}"}, names=2)


def plan_all(problems: Sequence[PathProblem], presets: Sequence[str], seeds: int) -> list[Run]:
    references, runs = stored_times(), []
    sorted_ = sorted(problems, key=lambda problem: problem.family)
    for problem in track(sorted_, "plans"):
        world = World.of(problem)
        for preset in presets:
            runs += plan_one(problem, preset, references.get(problem.name), world, range(seeds))
    return runs


def main() -> None:
    parser = arguments("Paths against global references.")
    parser.add_argument("--seeds", type=int, default=5, help="plans of each problem")
    parser.add_argument("--only", nargs="+", help="families or problems, such as coast or open-03")
    presets = [*PRESETS, *VARIANTS]
    parser.add_argument("--preset", nargs="+", choices=presets, default=["default", "paper"])
    parser.add_argument("--each", action="store_true", help="a row for each problem too")
    options = parser.parse_args()
    if not have_charts():
        screen.print("problems on real coast: left out, the shared maps were not found")
    only = set(options.only or ())
    chosen = [one for one in path_problems() if not only or {one.family, one.name} & only]
    runs = plan_all(chosen, options.preset, options.seeds)
    families, problems = rows(runs, "family"), rows(runs, "problem")
    if options.each:
        show_gaps("Each problem: gap to the reference", problems, **COMPILING)
    show_gaps("Paths: gap to the reference", families, **COMPILING)
    content = {"seeds": options.seeds, "families": families, "problems": problems, "runs": runs}
    write(options.out, content)


if __name__ == "__main__":
    main()
