"""Lower bounds of path times: how near they come, and whether any path of the ruler beats one.

`python -m benchmarks.bounds --seeds 6000:6034` bounds the plans of a preset; with `--references` the stored
references, which takes no planning. `--known 1.25` has the bounds worked out as if no path were known that is
quicker than 1.25 times that: then a bound may come to lie above the quickest path that the ruler holds
feasible, and every one that does counts as a violation.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import jax
import numpy as np
from rich.table import Table

import auvplan as ap
from auvplan.path.bound import lower_bound
from benchmarks.depth_problems import DEPTH_FAMILIES, have_levels
from benchmarks.machine import arguments, clock, console, empty_table, machine, seed_range, write
from benchmarks.path_problems import PathProblem
from benchmarks.path_ruler import evaluate
from benchmarks.water_problems import FAMILIES
from benchmarks.water_reference import STORED, STORED_DEEP, load
from benchmarks.waters import PRESETS, posed

#: Share of its time by which a path may beat a bound unnoticed: rounding of the ruler.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class BoundRun:
    """A bound.

    Attributes:
        travel_time: s, of the plan or reference, by the ruler.
        quickest: s, of all paths known that the ruler holds feasible.
        bound: s.
    """

    problem: str
    family: str
    travel_time: float
    quickest: float
    bound: float
    kind: str
    seconds: float

    @property
    def gap(self) -> float:
        """Share by which the path is above the bound."""
        return self.travel_time / self.bound - 1.0 if self.bound > 0.0 else np.inf

    @property
    def violated(self) -> bool:
        """Whether a path beats the bound."""
        return self.bound > self.quickest * (1.0 + _ROUNDING)


def bounds(
    families: Sequence[str], seeds: Sequence[int], preset: str | None, known: float, fineness: float
) -> Iterator[BoundRun]:
    """Bound the problems that have a stored reference; those whose plan breaks a limit are left out.

    Args:
        preset: whose plans are bounded; None for the references.
        known: times the travel time that is taken to be known.
    """
    stored = load(STORED) | load(STORED_DEEP)
    for seed in seeds:
        for family in families:
            entry = stored.get(f"{family}-{seed}")
            if entry is None or entry["travel_time"] is None:
                continue
            problem, reference = posed(family, seed), float(entry["travel_time"])
            if abs(entry["distance"] / problem.distance - 1.0) > 1e-5:
                continue
            time = reference if preset is None else _planned(problem, preset)
            if time is not None:
                yield _bounded(problem, time, min(time, reference), known, fineness)


def _planned(problem: PathProblem, preset: str) -> float | None:
    """Return the time of a plan by the ruler, s; None where that does not hold it feasible."""
    score = evaluate(problem, problem.plan(jax.random.key(0), PRESETS[preset]()).positions)
    return score.travel_time if score.feasible else None


def _bounded(problem: PathProblem, time: float, quickest: float, known: float, fineness: float) -> BoundRun:
    ends, env = (np.asarray(problem.start, float), np.asarray(problem.goal, float)), problem.environment
    config = ap.PathConfig(**problem.changes)
    seconds, found = clock(
        lambda: lower_bound(
            *ends, env, problem.vehicle, config, known=known * time, depart=problem.depart, fineness=fineness
        )
    )
    return BoundRun(problem.name, problem.family, time, quickest, found.travel_time, found.kind, seconds)


def table(runs: Sequence[BoundRun]) -> Table:
    """Return the gaps by family as a table."""
    figures = ("median", "mean", "90 %", "worst", "violations", "certified", "s a bound", "problems")
    made = empty_table("Travel time above its lower bound", ["family"], figures)
    families = sorted({run.family for run in runs})
    groups = [(family, [run for run in runs if run.family == family]) for family in families]
    for family, group in [*groups, ("all", list(runs))]:
        gaps = np.array([run.gap for run in group])
        made.add_row(
            family,
            *(
                f"{value:.2%}"
                for value in (np.median(gaps), gaps.mean(), np.percentile(gaps, 90), gaps.max())
            ),
            str(sum(run.violated for run in group)),
            f"{np.mean([run.kind == 'certified' for run in group]):.0%}",
            f"{np.median([run.seconds for run in group]):.2f}",
            str(len(group)),
        )
    return made


def main() -> None:
    """Bound, print the table and write the file."""
    parser = arguments(__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seeds", type=seed_range, default=range(0, 4), help="FIRST:END, the end left out")
    parser.add_argument("--families", nargs="+", choices=[*FAMILIES, *DEPTH_FAMILIES], default=list(FAMILIES))
    parser.add_argument("--preset", choices=list(PRESETS), default="default")
    parser.add_argument("--references", action="store_true", help="bound the references instead of plans")
    parser.add_argument("--known", type=float, default=1.0, help="times the path's time, taken to be known")
    parser.add_argument("--fineness", type=float, default=1.0, help="factor on the cells along each axis")
    options = parser.parse_args()
    screen = console()
    screen.print(f"processor: {machine()['processor']}")
    families = [name for name in options.families if name != "file" or have_levels()]
    preset = None if options.references else options.preset
    runs: list[BoundRun] = []
    for run in bounds(families, options.seeds, preset, options.known, options.fineness):
        runs.append(run)
        mark = " VIOLATED" if run.violated else ""
        screen.print(f"{run.problem}: {run.travel_time:.1f} s, bound {run.bound:.1f} s, {run.gap:.2%}{mark}")
    if runs:
        screen.print(table(runs))
        write(options.out, {"runs": runs})


if __name__ == "__main__":
    main()
