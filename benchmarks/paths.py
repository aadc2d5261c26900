"""Path planning against global references.

``python -m benchmarks.paths`` plans every problem of `path_problems` with `ap.plan_path` and prints a row for
each family and preset; ``--each`` prints one for each problem, ``--out FILE.json`` writes both. The gap of a
plan is travel time / reference - 1, both measured by `path_ruler`. A plan that breaks a limit has no gap and
lowers the feasible share. Times are of one plan, the compilation apart.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import numpy as np
from rich.progress import Progress
from rich.table import Table

import auvplan as ap
from benchmarks.machine import arguments, bars, clock, console, empty_table, named_once, write
from benchmarks.path_problems import PathProblem, have_charts, path_problems
from benchmarks.path_reference import stored_references
from benchmarks.path_ruler import PlannedPath, World, evaluate

PRESETS = {"default": ap.PathConfig, "paper": ap.PathConfig.paper}


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


@dataclass(frozen=True, kw_only=True)
class Run(PlannedPath):
    """One plan.

    Attributes:
        compile_seconds: the first plan of the problem took longer than this one by so much.
    """

    seed: int
    compile_seconds: float


@dataclass(frozen=True)
class Row:
    """Runs of a family or of a problem with one preset.

    Attributes:
        mean_gap, median_gap, worst_gap, best_gap: over feasible plans; None without any.
        feasible: share of plans that keep all limits by the ruler.
        claimed: share that the planner holds feasible.
        false_claims: plans that it holds feasible and the ruler does not.
        milliseconds: median of a plan.
        compile_seconds: summed over the problems.
    """

    name: str
    preset: str
    mean_gap: float | None
    median_gap: float | None
    worst_gap: float | None
    best_gap: float | None
    feasible: float
    claimed: float
    false_claims: int
    milliseconds: float
    compile_seconds: float
    plans: int

    @classmethod
    def of(cls, name: str, runs: list[Run]) -> "Row":
        """Sum up runs of one preset."""
        gaps = [run.gap for run in runs if run.gap is not None]
        mean, median, worst, best = (
            float(figure(gaps)) if gaps else None for figure in (np.mean, np.median, np.max, np.min)
        )
        return cls(
            name=name,
            preset=runs[0].preset,
            mean_gap=mean,
            median_gap=median,
            worst_gap=worst,
            best_gap=best,
            feasible=float(np.mean([run.feasible for run in runs])),
            claimed=float(np.mean([run.claimed for run in runs])),
            false_claims=sum(run.claimed and not run.feasible for run in runs),
            milliseconds=1e3 * float(np.median([run.seconds for run in runs])),
            compile_seconds=sum({run.problem: run.compile_seconds for run in runs}.values()),
            plans=len(runs),
        )


def plan_all(
    problems: Sequence[PathProblem], presets: Sequence[str], seeds: int, progress: Progress
) -> list[Run]:
    """Plan problems with every preset, family by family."""
    references, runs = stored_references(), []
    bar = progress.add_task("references", total=len(problems) * len(presets))
    for problem in sorted(problems, key=lambda problem: problem.family):
        world = World.of(problem)
        for preset in presets:
            runs += plan_one(problem, preset, seeds, references.get(problem.name), world)
            progress.advance(bar)
    progress.remove_task(bar)
    return runs


def plan_one(
    problem: PathProblem, preset: str, seeds: int, reference: float | None, world: World
) -> list[Run]:
    """Plan a problem from `seeds` keys, after a plan that compiles."""
    config = {**PRESETS, **VARIANTS}[preset]()
    first, _ = clock(lambda: problem.plan(jax.random.key(10_000), config))
    runs = []
    for seed in range(seeds):
        seconds, made = clock(partial(problem.plan, jax.random.key(seed), config))
        score = evaluate(problem, made.positions, world)
        travel_time = score.travel_time if np.isfinite(score.travel_time) else None
        run = Run(
            problem=problem.name, family=problem.family, preset=preset, seed=seed, reference=reference,
            travel_time=travel_time, claimed=made.feasible, feasible=score.feasible, seconds=seconds,
            compile_seconds=max(first - seconds, 0.0),
        )  # fmt: skip
        runs.append(run)
    return runs


def rows(runs: Iterable[Run], by: str) -> list[Row]:
    """A row for each family or problem, as `by` says, and preset."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((getattr(run, by), run.preset), []).append(run)
    return [Row.of(name, members) for (name, _), members in groups.items()]


def table(shown: list[Row], title: str) -> Table:
    """Rows as a table; a name is written once."""
    figures = "mean gap", "median", "worst", "best", "feasible", "claimed", "ms a plan", "compiling", "plans"
    made = empty_table(title, ["set", "preset"], figures)
    for name, row in named_once(shown, "name"):
        gaps = (row.mean_gap, row.median_gap, row.worst_gap, row.best_gap)
        wrong = f" ({row.false_claims} wrong)" if row.false_claims else ""
        made.add_row(
            name, row.preset,
            *("-" if gap is None else f"{gap:.2%}" for gap in gaps),
            f"{row.feasible:.0%}", f"{row.claimed:.0%}{wrong}", f"{row.milliseconds:.0f}",
            f"{row.compile_seconds:.1f} s", str(row.plans),
        )  # fmt: skip
    return made


def main() -> None:
    """Print the tables and write the file."""
    parser = arguments("Paths against global references.")
    parser.add_argument("--seeds", type=int, default=5, help="plans of each problem")
    parser.add_argument("--only", nargs="+", help="families or problems, such as coast or open-03")
    parser.add_argument("--preset", nargs="+", choices=[*PRESETS, *VARIANTS], default=list(PRESETS))
    parser.add_argument("--each", action="store_true", help="a row for each problem too")
    options = parser.parse_args()
    screen = console()
    if not have_charts():
        screen.print("problems on real coast: left out, the shared maps were not found")
    chosen = [
        problem
        for problem in path_problems()
        if not options.only or {problem.family, problem.name} & set(options.only)
    ]
    with bars(screen) as progress:
        runs = plan_all(chosen, options.preset, options.seeds, progress)
    families, problems = rows(runs, "family"), rows(runs, "problem")
    if options.each:
        screen.print(table(problems, "Each problem: gap to the reference"))
    screen.print(table(families, "Paths: gap to the reference"))
    content = {
        "seeds": options.seeds,
        "families": families,
        "problems": problems,
        "runs": runs,
    }
    write(options.out, content)


if __name__ == "__main__":
    main()
