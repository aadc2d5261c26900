"""The quickest paths known of the problems, and their files, so that they are computed once.

They are tightened from the best paths of two grids, whose relative difference is the error. Nothing of the
planner takes part.
"""

import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Array
from benchmarks.paths.grid import Grid, passages, ways
from benchmarks.paths.polish import Polished, polish, resampled, spread
from benchmarks.paths.problems import PathProblem
from benchmarks.paths.ruler import LIMIT_TOLERANCE, Score, World
from benchmarks.paths.tighten import tighten
from benchmarks.paths.vertical import vertical

#: Files of the references of `path_problems`, and of random waters without and with depth.
STORED_PATHS, STORED, STORED_DEEP = (
    Path(__file__).with_name(f"{name}.json") for name in ("known", "waters", "depths")
)

#: Nodes of the two planes along a side, and cells of the two corridors ahead, aside and down.
_PLANES, _CORRIDORS = (240, 400), ((64, 16, 24), (88, 24, 36))

#: Paths of each grid that are tightened at most, and how much slower than the best so far one may be.
_PASSAGES, _WAYS, _PLANE_SLOWER, _DEEP_SLOWER = 6, 4, 0.015, 0.04

#: Boundaries of what moves where a grid path may come too near to it, to be tightened out of it.
_SMALLER = 0.6

#: Segments of the last tightening in a plane; of a path in depth, and of the best one in the end.
_FINEST, _DEEP_SEGMENTS, _DEEP_FINEST = 512, 96, 224

#: Paths that turn too sharply and are polished, at most.
_POLISHED = 3


@dataclass(frozen=True, eq=False)
class Reference:
    travel_time: float | None  # s, by the ruler; None where no path was found
    # relative difference of what the two grids lead to; None where only one of them leads to a path
    error: float | None
    positions: Array  # [n, 2] m, north and east; [n, 3] with depth for problems that have it
    seconds: float
    # s, of the quickest path in the vertical plane, another search; None where there is none
    plane: float | None = None


def found_reference(problem: PathProblem) -> Reference:
    """Find the quickest path on both grids; where there is depth, in the vertical plane as well."""
    begin, world, plane = time.perf_counter(), World.of(problem), None
    deep = bool(world.high[2] > world.low[2])
    lay, sizes, best_on = (
        (Grid.corridor, _CORRIDORS, _best_in_depth) if deep else (Grid.plane, _PLANES, _best_in_plane)
    )
    grids = [lay(problem, world, size) for size in sizes]
    found = [best for grid in grids if (best := best_on(problem, world, grid)) is not None]
    times = sorted(path.score.travel_time for path in found)
    error = times[1] / times[0] - 1.0 if len(times) == 2 else None
    if deep:
        more = [vertical(problem, world)]
        plane = more[0] and more[0].score.travel_time
        if best := _quickest(found):
            narrow = 0.25 * grids[-1].width[0], 0.25 * grids[-1].width[1]
            more.append(tighten(problem, world, grids[-1], best.positions, _DEEP_FINEST, narrow))
        found += [path for path in more if path is not None and path.score.feasible]
    best, seconds = _quickest(found), time.perf_counter() - begin
    if best is None:
        return Reference(None, error, np.zeros((0, 2)), seconds, plane)
    return Reference(best.score.travel_time, error, best.positions, seconds, plane)


def _quickest(paths: Sequence[Polished]) -> Polished | None:
    return min(paths, key=lambda path: path.score.travel_time, default=None)


def _tightened(
    problem: PathProblem, world: World, grid: Grid, candidates: Iterable[tuple[float, Array]], slower: float,
    kept: Callable[[Score], bool], *how: Any,
) -> list[Polished]:  # fmt: skip
    """Tighten paths on a grid, `how` as `tighten` takes it; return those that are kept, quickest first.

    Args:
        candidates: times [s] and positions.
        slower: how much slower than the best path so far one may be on the grid.
    """
    found: list[Polished] = []
    for grid_time, path in candidates:
        known = min((one.score.travel_time for one in found), default=np.inf)
        if grid_time <= known * (1.0 + slower):
            tightened = tighten(problem, world, grid, path, *how)
            if tightened is not None and kept(tightened.score):
                found.append(tightened)
    return sorted(found, key=lambda path: path.score.travel_time)


def _best_in_depth(problem: PathProblem, world: World, grid: Grid) -> Polished | None:
    """Return the quickest feasible path that a grid leads to; None where it leads to none."""
    tightened = _tightened(
        problem, world, grid, ways(problem, world, grid, _WAYS), _DEEP_SLOWER, lambda score: score.feasible,
        _DEEP_SEGMENTS, grid.width,
    )  # fmt: skip
    return tightened[0] if tightened else None


def _best_in_plane(problem: PathProblem, world: World, grid: Grid) -> Polished | None:
    """Return the same where there is no depth; paths that turn too sharply are polished."""
    grids, polished = [grid], 0
    if len(grid.movers):
        # The label that arrives first need not be the one that passes behind what moves, or through before
        # it: paths that are tightened from where less moves may.
        smaller = grid.movers.copy()
        smaller[:, 6] *= _SMALLER
        grids += [replace(grid, movers=smaller), replace(grid, movers=smaller[:0])]
    candidates = chain.from_iterable(passages(problem, world, each, _PASSAGES) for each in grids)
    for path in _tightened(
        problem, world, grid, candidates, _PLANE_SLOWER, lambda score: bool(np.isfinite(score.travel_time))
    ):
        if path.score.feasible:
            finest = tighten(problem, world, grid, path.positions, _FINEST, 0.5 * grid.ahead)
            return _quickest([path, finest] if finest is not None and finest.score.feasible else [path])
        if path.score.excess > LIMIT_TOLERANCE and polished < _POLISHED:
            polished += 1
            turning = polish(problem, world, path.positions)
            if turning.score.feasible:
                return turning
    return None


def load(path: Path) -> dict[str, dict[str, Any]]:
    return json.loads(path.read_text()) if path.exists() else {}


def reference_of(problem: PathProblem, path: Path) -> Reference:
    """Return a problem's reference, found and stored in a file where it is not there yet."""
    reference = stored_reference(problem, load(path))
    if reference is None:
        reference = found_reference(problem)
        store(problem, reference, path)
    return reference


def stored_reference(problem: PathProblem, entries: dict[str, dict[str, Any]]) -> Reference | None:
    """Return a problem's reference, or None where it is not stored or belongs to another problem.

    Problems on real coast differ where the shared charts are absent.
    """
    entry = entries.get(problem.name)
    if entry is None or abs(entry["distance"] / problem.distance - 1.0) > 1e-5:
        return None
    stated = {name: entry.get(name) for name in ("travel_time", "error", "seconds", "plane")}
    return Reference(**stated, positions=np.asarray(entry["positions"], float))


def store(problem: PathProblem, reference: Reference, path: Path) -> None:
    """Add a reference to a file, a line for each."""
    entries, thinned = load(path), reference.positions
    if len(thinned):
        points = {STORED_PATHS: 64, STORED: 24}.get(path, 48)
        thinned = (spread if thinned.shape[1] == 3 else resampled)(thinned, points - 1)

    def rounded(value: float | None, digits: int) -> float | None:
        return None if value is None else round(value, digits)

    entries[problem.name] = {
        "travel_time": rounded(reference.travel_time, 4),
        "error": rounded(reference.error, 7),
        "distance": round(problem.distance, 3),
        "seconds": round(reference.seconds, 1),
        "positions": np.round(thinned, max(0, 4 - int(np.log10(problem.distance)))).tolist(),
    } | ({} if reference.plane is None else {"plane": round(reference.plane, 4)})
    lines = [f"{json.dumps(name)}: {json.dumps(entry)}" for name, entry in sorted(entries.items())]
    partial = path.with_suffix(".partial")
    partial.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    partial.replace(path)
