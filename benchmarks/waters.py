"""Path planning in waters that no planner was tuned on: problems by seed, references and the planner's gaps.

``python -m benchmarks.waters --seeds 0:4`` plans the problems of these seeds in every family and prints a row
for each family and preset. The gap of a plan is travel time / reference - 1, both measured by `path_ruler`; a
plan that breaks a limit has no gap and lowers the feasible share. Where a feasible plan is quicker than the
reference, it takes its place for all presets. Times are of one plan, the compilation apart.

The families shear, ekman, ridge, spheres and file have depth, see `depth_problems`; the last one needs the
shared files of currents. Where they are among the families, there is a row of the vehicles that may pitch as
they like, and one of those that may not.

Seeds below 100 are for development. What is reported comes from seeds of 1000 and more. References that are
not stored are computed first; ``--references`` does nothing else. ``--scales`` poses problems with sides from
2 m to 200 km instead, and compares their plans.
"""

import argparse
import gc
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

import auvplan as ap
from auvplan.compiled import drop_programs
from benchmarks.depth_problems import DEPTH_FAMILIES, depth_problem, have_levels
from benchmarks.machine import (
    arguments,
    bars,
    clock,
    console,
    empty_table,
    machine,
    named_once,
    seed_range,
    write,
)
from benchmarks.path_problems import PathProblem, have_charts, literature
from benchmarks.path_ruler import PlannedPath, World, evaluate
from benchmarks.water_problems import KINDS, scaled, water_problem
from benchmarks.water_reference import (
    STORED,
    STORED_DEEP,
    WaterReference,
    load,
    store,
    stored_reference,
    water_reference,
)

PRESETS = {"default": ap.PathConfig, "quick": ap.PathConfig.quick, "paper": ap.PathConfig.paper}

#: m, longest side of the box at which problems are posed for `--scales`; the first is compared with.
SIDES = 10_000.0, 2.0, 20.0, 200.0, 2000.0, 50_000.0, 200_000.0

#: Problems after which programs are forgotten.
_TOGETHER = 8

#: Families whose first problem is posed at all sides, beside the problems of the literature.
SCALED_FAMILIES = "open", "coast", "sounds"


@dataclass(frozen=True, kw_only=True)
class Run(PlannedPath):
    """One plan.

    Attributes:
        error: of the reference, relative; None where it is not known.
        pitched: whether the vehicle's pitch is limited; None where the problem has no depth.
    """

    error: float | None
    status: str
    pitched: bool | None = None


@dataclass(frozen=True)
class Row:
    """Runs of a family with one preset.

    Attributes:
        mean, median, high, highest, worst: gaps of the feasible plans, the third and fourth their 95th and
            99th percentiles; None without any.
        feasible: share of the problems with a reference whose plan the ruler holds feasible.
        false_claims: plans that the planner holds feasible and the ruler does not.
        milliseconds: median of a plan.
        error: mean error of the references; None without any.
        replaced: references that a plan was quicker than.
        unknown: of these without a reference.
    """

    family: str
    preset: str
    mean: float | None
    median: float | None
    high: float | None
    highest: float | None
    worst: float | None
    feasible: float | None
    false_claims: int
    milliseconds: float
    error: float | None
    worst_error: float | None
    replaced: int
    problems: int
    unknown: int

    @classmethod
    def of(cls, family: str, runs: Sequence[Run], replaced: set[str]) -> "Row":
        """Sum up runs of one preset; `replaced` are the problems whose reference a plan was quicker than."""
        gaps = [run.gap for run in runs if run.gap is not None]
        known = [run for run in runs if run.reference is not None]
        errors = [run.error for run in runs if run.error is not None]

        def figure(function: Any, values: Sequence[float]) -> float | None:
            return float(function(values)) if values else None

        return cls(
            family=family,
            preset=runs[0].preset,
            mean=figure(np.mean, gaps),
            median=figure(np.median, gaps),
            high=figure(partial(np.percentile, q=95), gaps),
            highest=figure(partial(np.percentile, q=99), gaps),
            worst=figure(np.max, gaps),
            feasible=figure(np.mean, [run.feasible for run in known]),
            false_claims=sum(run.claimed and not run.feasible for run in runs),
            milliseconds=1e3 * float(np.median([run.seconds for run in runs])),
            error=figure(np.mean, errors),
            worst_error=figure(np.max, errors),
            replaced=len(replaced & {run.problem for run in runs}),
            problems=len(runs),
            unknown=len(runs) - len(known),
        )


def posed(family: str, seed: int) -> PathProblem:
    """Make a problem of any family."""
    return depth_problem(family, seed) if family in DEPTH_FAMILIES else water_problem(family, seed)


def has_way(family: str) -> bool:
    """Whether problems of a family have a way."""
    return family in DEPTH_FAMILIES or KINDS[family].way


def _computed(problem: PathProblem) -> WaterReference:
    if problem.family not in DEPTH_FAMILIES:
        return water_reference(problem)
    # Numba is needed where references are computed alone.
    from benchmarks.depth_reference import depth_reference

    return depth_reference(problem)


def references(
    families: Sequence[str], seeds: Iterable[int], progress: Progress, most: int | None = None
) -> list[tuple[PathProblem, WaterReference | None]]:
    """Return problems, seed by seed, and their references, computed and stored where that was not done.

    Problems without a way have none. The first `most` are returned.
    """
    chosen = [(family, seed) for seed in seeds for family in families][:most]
    bar = progress.add_task("references", total=len(chosen))
    found: list[tuple[PathProblem, WaterReference | None]] = []
    for family, seed in chosen:
        problem = posed(family, seed)
        reference = None
        if has_way(family):
            path = STORED_DEEP if family in DEPTH_FAMILIES else STORED
            reference = stored_reference(problem, load(path))
            if reference is None:
                reference = _computed(problem)
                store(problem, reference, path)
        found.append((problem, reference))
        progress.advance(bar)
    progress.remove_task(bar)
    return found


def plan_all(
    cases: Sequence[tuple[PathProblem, WaterReference | None]], presets: Sequence[str], progress: Progress
) -> tuple[list[Run], set[str]]:
    """Plan all problems with every preset.

    Returns:
        ``(runs, replaced)``: where a feasible plan was quicker than the reference, it replaces it in all runs
        of the problem; these are named.
    """
    bar = progress.add_task("plans", total=len(cases) * len(presets))
    runs, replaced = [], set()
    for number, (problem, reference) in enumerate(cases, 1):
        world, own = World.of(problem), []
        for preset in presets:
            own.append(_planned(problem, preset, reference, world))
            progress.advance(bar)
        quickest = min((run.travel_time for run in own if run.feasible and run.travel_time), default=np.inf)
        known = own[0].reference
        if has_way(problem.family) and quickest < (np.inf if known is None else known):
            replaced.add(problem.name)
            own = [replace(run, reference=quickest) for run in own]
        runs += own
        if number % _TOGETHER == 0:
            _forget_programs()
    progress.remove_task(bar)
    return runs, replaced


def _forget_programs() -> None:
    """Free what was compiled: programs differ by problem, and hundreds of them fill a long run's memory."""
    drop_programs()
    jax.clear_caches()
    gc.collect()


def _planned(problem: PathProblem, preset: str, reference: WaterReference | None, world: World) -> Run:
    """Plan a problem, after a plan that compiles what is not compiled yet."""
    config = PRESETS[preset]()
    problem.plan(jax.random.key(10_000), config)
    seconds, made = clock(lambda: problem.plan(jax.random.key(0), config))
    score = evaluate(problem, made.positions, world)
    return Run(
        problem=problem.name,
        family=problem.family,
        preset=preset,
        reference=None if reference is None else reference.travel_time,
        error=None if reference is None else reference.error,
        travel_time=score.travel_time if np.isfinite(score.travel_time) else None,
        claimed=made.feasible,
        feasible=score.feasible,
        status=made.status.name,
        seconds=seconds,
        pitched=problem.vehicle.pitch_max is not None if problem.family in DEPTH_FAMILIES else None,
    )


def rows(runs: Sequence[Run], replaced: set[str]) -> list[Row]:
    """Return a row for each family and preset, for limited pitch and any pitch, and for all together."""
    together = {None: (), True: ("pitch limited",), False: ("any pitch",)}
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        for name in (run.family, *together[run.pitched], "all"):
            groups.setdefault((name, run.preset), []).append(run)
    last = ["", *(name for names in together.values() for name in names), "all"]
    found = [Row.of(family, members, replaced) for (family, _), members in groups.items()]
    return sorted(found, key=lambda row: (last.index(row.family) if row.family in last else 0, row.family))


def table(shown: Sequence[Row]) -> Table:
    """Return the gaps as a table; the name of a family is written once."""
    gaps = "mean", "median", "95 %", "99 %", "worst"
    figures = *gaps, "feasible", "ms a plan", "error, mean", "worst", "problems"
    made = empty_table("Random waters: gap to the reference", ["family", "preset"], figures)
    for name, row in named_once(shown, "family"):
        wrong = f" ({row.false_claims} wrong)" if row.false_claims else ""
        beside = f" ({row.unknown} unknown)" if row.unknown else ""
        made.add_row(
            name, row.preset,
            *(_share(gap, 2) for gap in (row.mean, row.median, row.high, row.highest, row.worst)),
            f"{_share(row.feasible, 1)}{wrong}", f"{row.milliseconds:.0f}", _share(row.error, 3),
            _share(row.worst_error, 2), f"{row.problems}{beside}",
        )  # fmt: skip
    return made


def _share(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}%}"


def closed_line(runs: Sequence[Run]) -> str:
    """Say how many plans of problems without a way are reported infeasible, and by which status."""
    statuses = sorted({run.status for run in runs if not run.claimed})
    refused = sum(not run.claimed for run in runs)
    return f"no way: {refused} of {len(runs)} plans reported infeasible ({', '.join(statuses) or 'none'})"


def scales(presets: Sequence[str], progress: Progress) -> list[dict[str, Any]]:
    """Plan problems posed at all `SIDES`, and compare travel times per unit of length with the first's."""
    problems = [*literature(), *(water_problem(family, 0) for family in SCALED_FAMILIES)]
    bar = progress.add_task("scales", total=len(problems) * len(presets) * len(SIDES))
    found = []
    for problem in problems:
        side = float(np.max(np.asarray(problem.environment.upper) - np.asarray(problem.environment.lower)))
        for preset in presets:
            first = None
            for wanted in SIDES:
                factor = wanted / side
                posed = scaled(problem, factor)
                plan = posed.plan(jax.random.key(0), PRESETS[preset]())
                score = evaluate(posed, plan.positions)
                per_unit = score.travel_time / factor
                first = per_unit if first is None else first
                found.append(
                    {
                        "problem": problem.name,
                        "preset": preset,
                        "side": wanted,
                        "difference": per_unit / first - 1.0 if np.isfinite(per_unit) else None,
                        "claimed": plan.feasible,
                        "feasible": score.feasible,
                    }
                )
                progress.advance(bar)
    progress.remove_task(bar)
    return found


def scales_table(found: Sequence[dict[str, Any]]) -> Table:
    """Return the differences as a table, a row for each problem and preset; breaking limits is marked."""
    title = f"Travel time per unit of length, next to sides of {SIDES[0]:g} m (! breaks a limit)"
    made = empty_table(title, ["problem", "preset"], [f"{side:g} m" for side in SIDES])
    groups: dict[tuple[str, str], list[str]] = {}
    for one in found:
        text = "-" if one["difference"] is None else f"{one['difference']:+.3%}"
        mark = "" if one["feasible"] else "!"
        groups.setdefault((one["problem"], one["preset"]), []).append(text + mark)
    for names, cells in groups.items():
        made.add_row(*names, *cells)
    return made


def main() -> None:
    """Compute what references are missing, plan, print the tables and write the file."""
    parser = arguments("Paths in random waters against references.")
    parser.add_argument("--seeds", type=seed_range, default=range(0, 4), help="FIRST:END, the end left out")
    parser.add_argument("--families", nargs="+", choices=[*KINDS, *DEPTH_FAMILIES], default=list(KINDS))
    parser.add_argument("--preset", nargs="+", choices=list(PRESETS), default=["default", "quick"])
    parser.add_argument("--most", type=int, help="problems that have a way, the first of the seeds in order")
    parser.add_argument("--references", action="store_true", help="compute references and end")
    parser.add_argument("--scales", action="store_true", help="pose problems in units of all sizes instead")
    options = parser.parse_args()
    screen = console()
    screen.print(f"processor: {machine()['processor']}")
    if not have_charts():
        screen.print("real coast: the shipped chart stands in, the shared maps were not found")
    with bars(screen) as progress:
        content = (
            _scaled_content(options, screen, progress)
            if options.scales
            else _content(options, screen, progress)
        )
    if content:
        write(options.out, content)


def _scaled_content(options: argparse.Namespace, screen: Console, progress: Progress) -> dict[str, Any]:
    found = scales(options.preset, progress)
    screen.print(scales_table(found))
    return {"scales": found}


def _content(options: argparse.Namespace, screen: Console, progress: Progress) -> dict[str, Any]:
    """Compute references, and plan unless they alone are wanted."""
    families = options.families
    if "file" in families and not have_levels():
        screen.print("file: left out, the shared currents with levels were not found")
        families = [name for name in families if name != "file"]
    open_, shut = ([name for name in families if has_way(name) is way] for way in (True, False))
    cases = references(open_, options.seeds, progress, options.most)
    spent = [reference.seconds for _, reference in cases if reference is not None]
    unknown = sum(reference is None or reference.travel_time is None for _, reference in cases)
    screen.print(f"{len(cases)} references, {unknown} without a path, {sum(spent):.0f} s to compute")
    planes = [(one.plane, one.travel_time) for _, one in cases if one is not None and one.plane is not None]
    if planes:
        apart = [plane / best - 1.0 for plane, best in planes if best is not None]
        screen.print(
            f"{len(apart)} of them found in the vertical plane as well: {np.mean(apart):+.3%} in the mean, "
            f"{max(apart):+.3%} at most"
        )
    if options.references:
        return {}
    runs, replaced = plan_all(cases, options.preset, progress)
    found = rows(runs, replaced)
    if found:
        screen.print(table(found))
        screen.print(f"references that a feasible plan was quicker than, and replaced: {len(replaced)}")
    closed, _ = plan_all(references(shut, options.seeds, progress), options.preset, progress)
    for preset in options.preset if closed else ():
        screen.print(f"{preset}: {closed_line([run for run in closed if run.preset == preset])}")
    return {
        "rows": found,
        "replaced": sorted(replaced),
        "runs": [*runs, *closed],
    }


if __name__ == "__main__":
    main()
