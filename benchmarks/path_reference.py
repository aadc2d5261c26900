"""Global references of the path problems: a fine grid for every passage, then a descent in each.

``python -m benchmarks.path_reference --out benchmarks/path_references.json`` computes all of them. Nothing of
the planner takes part; `path_ruler` measures the references and the planner's paths alike.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from benchmarks.machine import empty_table
from benchmarks.path_grid import NODES, Grid, passages
from benchmarks.path_polish import FINE_STAGES, polish, resampled
from benchmarks.path_problems import PathProblem, have_charts, path_problems
from benchmarks.path_ruler import Score, World, evaluate

__all__ = ["Reference", "Score", "evaluate", "reference", "stored_references"]

Array = NDArray[np.floating]

STORED = Path(__file__).parent / "path_references.json"

#: Passages that are tried, and how many of them are followed finely.
PASSAGES, FINE = 12, 3

#: Positions of each path that are stored.
STORED_POINTS = 64


@dataclass(frozen=True, eq=False)
class Reference:
    """The quickest path known.

    Attributes:
        travel_time: s, by the ruler; None where no path was found.
        positions: [n, 2] m, north and east.
        grid_time: s, of the best path on the grid.
    """

    travel_time: float | None
    positions: Array
    grid_time: float | None
    seconds: float
    passages: int


def reference(
    problem: PathProblem, others: Sequence[Array] = (), most: int = PASSAGES, nodes: int = NODES
) -> Reference:
    """Find the quickest path of a problem.

    Args:
        problem: planar.
        others: paths [n, 2] m to descend from as well.
        nodes: of the grid along the longer side of the box.
    """
    begin = time.perf_counter()
    world = World.of(problem)
    found = list(passages(problem, world, most, Grid.of(problem, world, nodes)))
    paths = [polish(problem, world, path) for path in [*(path for _, path in found), *others]]
    paths.sort(key=lambda path: (not path.score.feasible, path.score.travel_time))
    paths += [polish(problem, world, path.positions, FINE_STAGES) for path in paths[:FINE]]
    safe = [path for path in paths if path.score.feasible]
    grid_time = found[0][0] if found else None
    best = min(safe, key=lambda path: path.score.travel_time) if safe else None
    return Reference(
        best.score.travel_time if best else None,
        best.positions if best else np.zeros((0, 2)),
        grid_time,
        time.perf_counter() - begin,
        len(found),
    )


def stored_references(path: Path = STORED) -> dict[str, float | None]:
    """Travel times [s] by the name of the problem, as stored; None where there is no path.

    Raises:
        FileNotFoundError: they have not been computed.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path} is missing: run python -m benchmarks.path_reference --out {path}")
    return {name: entry["travel_time"] for name, entry in json.loads(path.read_text()).items()}


def _entry(found: Reference) -> dict[str, Any]:
    """As stored."""
    thinned = resampled(found.positions, STORED_POINTS - 1) if len(found.positions) else found.positions
    time_found = found.travel_time
    return {
        "travel_time": None if time_found is None else round(time_found, 4),
        "feasible": time_found is not None,
        "positions": np.round(thinned, 1).tolist(),
    }


def main() -> None:
    """Compute all references, print a table and write the file."""
    parser = argparse.ArgumentParser(description="Global references of the path problems.")
    parser.add_argument("--out", type=Path, help="JSON file to write")
    parser.add_argument("--only", nargs="+", help="names of problems")
    options = parser.parse_args()
    console = Console()
    if not have_charts():
        console.print("problems on real coast: left out, the shared maps were not found")
    figures = "reference", "best known", "apart by", "grid", "passages", "time"
    table = empty_table("References", ["problem"], figures)
    stored = {}
    for problem in path_problems():
        if options.only and problem.name not in options.only:
            continue
        found = reference(problem)
        stored[problem.name] = _entry(found)
        seconds, known = found.travel_time, problem.best_known
        apart = "-" if known is None or seconds is None else f"{seconds / known - 1.0:+.4%}"
        table.add_row(
            problem.name, "none" if seconds is None else f"{seconds:.2f} s",
            "-" if known is None else f"{known:.2f} s", apart,
            "-" if found.grid_time is None else f"{found.grid_time:.1f} s", str(found.passages),
            f"{found.seconds:.1f} s",
        )  # fmt: skip
        console.print(f"{problem.name}: {seconds} s, {found.seconds:.1f} s")
    console.print(table)
    if options.out:
        options.out.write_text(json.dumps(stored, indent=None).replace("}, ", "},\n") + "\n")


if __name__ == "__main__":
    main()
