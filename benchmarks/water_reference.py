"""References of the random waters: two grids of their own spacing, the best passages of each tightened.

The quicker of the two is the reference, their relative difference its error. Nothing of the planner takes
part. References are kept in `water_references.json` by family and seed, so that they are computed once.
"""

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.path_grid import Grid, passages
from benchmarks.path_polish import Polished, Stage, polish, resampled, spread
from benchmarks.path_problems import PathProblem
from benchmarks.path_ruler import LIMIT_TOLERANCE, World
from benchmarks.path_tighten import tighten

Array = NDArray[np.floating]

#: References of problems without and with depth.
STORED = Path(__file__).parent / "water_references.json"
STORED_DEEP = STORED.with_name("depth_references.json")

#: Nodes of the two grids along a side.
RESOLUTIONS = 240, 400

#: Passages of each grid that are tightened at most, and how much slower than the best path so far one may be.
PASSAGES, _SLOWER = 6, 0.015

#: Boundaries of what moves where a grid path may come too near to it, to be tightened out of it.
_SMALLER = 0.6

#: Segments of the last tightening.
_FINEST = 512

#: How paths that turn too sharply are polished, and how many of them.
_STAGES, _POLISHED = (Stage(128, 4, 1.0, 150), Stage(256, 4, 30.0, 200)), 3

#: Positions of each path that are stored, and of those with depth.
_STORED_POINTS, _DEEP_POINTS = 24, 48


@dataclass(frozen=True, eq=False)
class WaterReference:
    """The quickest path known.

    Attributes:
        travel_time: s, by the ruler; None where no path was found.
        error: relative difference of what the two grids lead to; None where only one of them leads to a path.
        positions: [n, 2] m, north and east; [n, 3] with depth for problems that have it.
        plane: s, of the quickest path in the vertical plane, another search; None where there is none.
    """

    travel_time: float | None
    error: float | None
    positions: Array
    seconds: float
    plane: float | None = None

    @classmethod
    def of(
        cls, best: Polished | None, error: float | None, seconds: float, plane: float | None = None
    ) -> "WaterReference":
        """Return what the quickest path found is a reference of."""
        if best is None:
            return cls(None, error, np.zeros((0, 2)), seconds, plane)
        return cls(best.score.travel_time, error, best.positions, seconds, plane)


def water_reference(problem: PathProblem) -> WaterReference:
    """Find the quickest path of a problem on both grids."""
    begin = time.perf_counter()
    world = World.of(problem)
    found = [best for nodes in RESOLUTIONS if (best := _best(problem, world, nodes)) is not None]
    return WaterReference.of(quickest(found), difference(found), time.perf_counter() - begin)


def quickest(paths: Sequence[Polished]) -> Polished | None:
    """Return the quickest of some paths; None of none."""
    return min(paths, key=lambda path: path.score.travel_time, default=None)


def difference(paths: Sequence[Polished]) -> float | None:
    """Return the relative difference of two paths' travel times; None where there are not two."""
    times = sorted(path.score.travel_time for path in paths)
    return times[1] / times[0] - 1.0 if len(times) == 2 else None


def _best(problem: PathProblem, world: World, nodes: int) -> Polished | None:
    """Return the quickest feasible path that a grid leads to; None where it leads to none."""
    grid = Grid.of(problem, world, nodes)
    found: list[Polished] = []
    for grid_time, path in _candidates(problem, world, grid):
        known = min((one.score.travel_time for one in found), default=np.inf)
        if grid_time <= known * (1.0 + _SLOWER):
            tightened = tighten(problem, world, grid, path)
            if tightened is not None and np.isfinite(tightened.score.travel_time):
                found.append(tightened)
    found.sort(key=lambda path: path.score.travel_time)
    polished = 0
    for path in found:
        if path.score.feasible:
            finest = tighten(problem, world, grid, path.positions, _FINEST, 0.5 * grid.spacing)
            better = finest is not None and finest.score.feasible
            return min(path, finest, key=lambda one: one.score.travel_time) if better else path
        if path.score.excess > LIMIT_TOLERANCE and polished < _POLISHED:
            polished += 1
            turning = polish(problem, world, path.positions, _STAGES)
            if turning.score.feasible:
                return turning
    return None


def _candidates(problem: PathProblem, world: World, grid: Grid) -> Iterator[tuple[float, Array]]:
    """Yield paths on the grid and their times [s]; where things move, those of smaller and of none as well.

    The label that arrives first need not be the one that passes behind what moves, or through before it:
    paths that are tightened from where less moves may.
    """
    found = passages(problem, world, PASSAGES, grid)
    if not len(grid.movers):
        return found
    smaller = grid.movers.copy()
    smaller[:, 6] *= _SMALLER
    others = (replace(grid, movers=smaller), replace(grid, movers=smaller[:0]))
    return chain(found, *(passages(problem, world, PASSAGES, other) for other in others))


def load(path: Path = STORED) -> dict[str, dict[str, Any]]:
    """Return all stored entries by name; none where there is no file."""
    return json.loads(path.read_text()) if path.exists() else {}


def stored_reference(problem: PathProblem, entries: dict[str, dict[str, Any]]) -> WaterReference | None:
    """Return a problem's reference, or None where it is not stored or belongs to another problem.

    Problems on real coast differ where the shared charts are absent.
    """
    entry = entries.get(problem.name)
    if entry is None or abs(entry["distance"] / problem.distance - 1.0) > 1e-5:
        return None
    return WaterReference(
        entry["travel_time"],
        entry["error"],
        np.asarray(entry["positions"], float),
        entry["seconds"],
        entry.get("plane"),
    )


def store(problem: PathProblem, reference: WaterReference, path: Path = STORED) -> None:
    """Add a reference to the file, a line for each."""
    entries = load(path)
    thinned = reference.positions
    if len(thinned):
        deep = thinned.shape[1] == 3
        thinned = spread(thinned, _DEEP_POINTS - 1) if deep else resampled(thinned, _STORED_POINTS - 1)
    digits = max(0, 4 - int(np.log10(problem.distance)))
    entries[problem.name] = {
        "travel_time": None if reference.travel_time is None else round(reference.travel_time, 4),
        "error": None if reference.error is None else round(reference.error, 7),
        "distance": round(problem.distance, 3),
        "seconds": round(reference.seconds, 1),
        "positions": np.round(thinned, digits).tolist(),
    }
    if reference.plane is not None:
        entries[problem.name]["plane"] = round(reference.plane, 4)
    lines = [f"{json.dumps(name)}: {json.dumps(entry)}" for name, entry in sorted(entries.items())]
    partial = path.with_suffix(".partial")
    partial.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    partial.replace(path)
