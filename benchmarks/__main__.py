"""All benchmarks of the path layer: ``python -m benchmarks [--out FILE.json] [--quick]``.

Prints a table each of scoring, whole plans and plans against global references, and writes one JSON file with
the machine and the versions. Compile and run times stand apart in every row.
"""

import argparse
import importlib.util
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from benchmarks import plans, scoring
from benchmarks.machine import bars, console, write


def against_references(screen: Console, progress: Progress, quick: bool) -> list[Any]:
    """Rows of `benchmarks.paths` by family; none, and a line, where its parts are missing.

    Quick: the first two problems of each family with one seed.
    """
    if importlib.util.find_spec("benchmarks.paths") is None:
        screen.print("plans against references: left out, benchmarks.paths not found")
        return []
    from benchmarks import paths

    try:
        references = paths.stored_references()
    except FileNotFoundError as error:
        screen.print(f"plans against references: left out, {error}")
        return []
    families: dict[str, list[Any]] = {}
    for problem in paths.path_problems():
        families.setdefault(problem.family, []).append(problem)
    chosen = [problem for members in families.values() for problem in (members[:2] if quick else members)]
    bar = progress.add_task("references", total=len(chosen) * len(paths.PRESETS))
    runs = []
    for problem in chosen:
        world = paths.World.of(problem)
        for preset in paths.PRESETS:
            reference = references.get(problem.name)
            runs += paths.plan_all(problem, preset, 1 if quick else 5, reference, world)
            progress.advance(bar)
    progress.remove_task(bar)
    found = paths.rows(runs, "family")
    screen.print(paths.table(found, "Paths: gap to the reference"))
    return found


def main() -> None:
    """Print the tables and write the file."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="All path benchmarks.")
    parser.add_argument("--quick", action="store_true", help="few rounds and seeds")
    parser.add_argument("--out", type=Path, help="JSON file to write")
    options = parser.parse_args()
    screen = console()
    with bars(screen) as progress:
        scored = scoring.rows(screen, progress, 5 if options.quick else scoring.ROUNDS)
        screen.print(scoring.table(scored))
        planned = plans.rows(screen, progress, 2 if options.quick else plans.SEEDS)
        screen.print(plans.table(planned))
        compared = against_references(screen, progress, options.quick)
    if options.out:
        parts = {"scoring": scored, "plans": planned, "paths": compared}
        content = {name: [asdict(row) for row in rows] for name, rows in parts.items()}
        write(options.out, {"quick": options.quick, **content})


if __name__ == "__main__":
    main()
