"""All benchmarks of the path layer: ``python -m benchmarks [--out FILE.json] [--quick]``.

Prints a table each of scoring, whole plans, plans against global references and plans anew on the way, walks
paths that are called clear, and writes one JSON file with the machine and the versions. Compile and run times
stand apart in every row.
"""

from rich.console import Console
from rich.progress import Progress

from benchmarks import path_arrivals, path_replans, path_walks, paths, plans, scoring
from benchmarks.machine import arguments, bars, console, write
from benchmarks.path_problems import PathProblem, path_problems


def against_references(screen: Console, progress: Progress, quick: bool) -> list[paths.Row]:
    """Rows of `benchmarks.paths` by family, and of the default's parts on the random problems.

    Quick: two problems of each family with one seed, and the default alone.
    """
    families: dict[str, list[PathProblem]] = {}
    for problem in path_problems():
        families.setdefault(problem.family, []).append(problem)
    chosen = [problem for members in families.values() for problem in (members[:2] if quick else members)]
    found = paths.rows(paths.plan_all(chosen, list(paths.PRESETS), 1 if quick else 5, progress), "family")
    screen.print(paths.table(found, "Paths: gap to the reference"))
    if quick:
        return found
    random = [problem for problem in chosen if problem.family != "literature"]
    parts = paths.rows(paths.plan_all(random, list(paths.VARIANTS), 1, progress), "family")
    screen.print(paths.table(parts, "Paths: the default without some of its parts"))
    return found + parts


def main() -> None:
    """Print the tables and write the file."""
    parser = arguments("All path benchmarks.", prog="python -m benchmarks")
    parser.add_argument("--quick", action="store_true", help="few rounds and seeds")
    options = parser.parse_args()
    screen = console()
    with bars(screen) as progress:
        scored = scoring.rows(screen, progress, 5 if options.quick else scoring.ROUNDS)
        screen.print(scoring.table(scored))
        planned = plans.rows(screen, progress, 2 if options.quick else plans.SEEDS)
        screen.print(plans.table(planned))
        compared = against_references(screen, progress, options.quick)
        anew = path_replans.rows(4 if options.quick else path_replans.SITUATIONS, progress)
        screen.print(path_replans.table(anew))
        arrivals = path_arrivals.rows()
        screen.print(path_arrivals.table(arrivals))
        walked = path_walks.watched(200 if options.quick else path_walks.COUNT, progress)
        screen.print(path_walks.said(walked))
    parts = {"scoring": scored, "plans": planned, "paths": compared, "replans": anew, "arrivals": arrivals}
    write(options.out, {"quick": options.quick, **parts, "walks": walked})


if __name__ == "__main__":
    main()
