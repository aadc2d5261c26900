"""Most total priority under time windows, proved by labels of dynamic programming (Righini and Salani 2009).

A label is a waypoint, the set of waypoints visited and the earliest time at which the task there begins.
What can still be gained is bounded by routes that may repeat waypoints, though not turn straight back, each
visit charged with a Lagrange multiplier. Times are whole seconds, and no leg with its task takes less than
`GRID` of them, but for those from the start.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

#: s, steps of time while multipliers are sought; rounding down keeps the bound a bound.
GRID = 40
ROUNDS, PATIENCE = 50, 4
TOLERANCE = 1e-6
MOST_LABELS = 1_500_000


@dataclass(frozen=True)
class Windows:
    """A mission in whole seconds, from waypoint 0 to the last one.

    Attributes:
        lasts: [N, N] s from the beginning of a task to the arrival at the next waypoint; the end of time and
            more where there is no edge.
        begins: [N, E + 2] s, when a task begins after an arrival at each second; E + 1 where it is too late,
            and in the last column.
        priority: [N] of the task at each waypoint, whole numbers.
    """

    lasts: Array
    begins: Array
    priority: Array

    @property
    def late(self) -> int:
        """The time after the last one, E + 1."""
        return self.begins.shape[1] - 1

    @classmethod
    def of(cls, lasts: Array, opens: Array, closes: Array, priority: Array, end: int) -> "Windows":
        """Look up when tasks begin.

        Args:
            lasts: [N, N] s, infinite where there is no edge.
            opens, closes: [N, W] s, whole or infinite.
            priority: [N] whole numbers.
            end: s, E, of the last arrival at the goal.
        """
        arrival = np.arange(end + 2)[None, :, None]
        first = np.where(arrival <= closes[:, None], np.maximum(arrival, opens[:, None]), np.inf).min(axis=2)
        begins = np.minimum(first, end + 1).astype(np.int32)
        begins[:, -1] = end + 1
        return cls(np.minimum(lasts, end + 1).astype(np.int32), begins, np.asarray(priority, float))


class _Ways(NamedTuple):
    """What routes that may repeat waypoints gain from each waypoint on, by the time.

    Attributes:
        best, other: [N, M + 1] the most, and the most by another next waypoint; minus infinity where none
            reaches the goal, as in the last column.
        following, instead: [N, M + 1] the next waypoints of both.
    """

    best: Array
    other: Array
    following: Array
    instead: Array


def most_priority(windows: Windows, known: float) -> tuple[float, float]:
    """Most total priority and a bound on it; they are equal where the labels did not run out.

    Args:
        known: total priority of a route that keeps all rules.
    """
    multipliers, root = _multipliers(windows, known)
    if root < known + 1.0 - TOLERANCE:
        return known, known
    return _labels(windows, _ways(windows, multipliers, 1), multipliers, known)


def _ways(windows: Windows, multipliers: Array, grid: int) -> _Ways:
    """Work backwards in time, in steps of `grid` seconds."""
    size, late = len(windows.priority), windows.late
    moments, goal = (late - 1) // grid + 1, size - 1
    shape = size, moments + 1
    ways = _Ways(np.full(shape, -np.inf), np.full(shape, -np.inf), *np.full((2, *shape), -1, np.int32))
    ways.best[goal, :moments] = 0.0
    gain = windows.priority - multipliers
    # Several moments at once: nothing that they lead to lies among them.
    together = max(int(windows.lasts[1:goal].min()) // grid, 1)
    for stop in range(moments, 0, -together):
        _look_back(windows, ways, gain, np.arange(1, goal), np.arange(max(stop - together, 0), stop), grid)
    _look_back(windows, ways, gain, np.arange(1), np.arange(1), grid)
    return ways


def _look_back(windows: Windows, ways: _Ways, gain: Array, rows: Array, moments: Array, grid: int) -> None:
    """Fill in the ways from waypoints `rows` at `moments`."""
    there = np.arange(len(gain))
    arrival = np.minimum(moments[None, :, None] * grid + windows.lasts[rows][:, None], windows.late)
    begins = windows.begins[there, arrival]
    at = np.where(begins == windows.late, ways.best.shape[1] - 1, begins // grid)
    back = ways.following[there, at] == rows[:, None, None]
    values = gain + np.where(back, ways.other[there, at], ways.best[there, at])
    place = np.ix_(rows, moments)
    for value, node in ((ways.best, ways.following), (ways.other, ways.instead)):
        chosen = values.argmax(axis=2)[..., None]
        node[place] = chosen[..., 0]
        value[place] = np.take_along_axis(values, chosen, axis=2)[..., 0]
        np.put_along_axis(values, chosen, -np.inf, axis=2)


def _multipliers(windows: Windows, known: float) -> tuple[Array, float]:
    """Multipliers [N] by subgradient steps, and the least bound that they gave."""
    multipliers, kept = np.zeros((2, len(windows.priority)))
    least, share, stale = np.inf, 1.0, 0
    for _ in range(ROUNDS):
        ways = _ways(windows, multipliers, GRID)
        bound = ways.best[0, 0] + multipliers.sum()
        if bound < least - 1e-3:
            least, kept, stale = bound, multipliers, 0
        else:
            stale += 1
        visits = _visits(windows, ways)
        slope = np.where((multipliers == 0.0) & (visits == 0.0), 0.0, visits - 1.0)
        slope[[0, -1]] = 0.0
        if least < known + 1.0 - TOLERANCE or not slope.any():
            break
        if stale == PATIENCE:
            share, stale, multipliers = 0.5 * share, 0, kept
            continue
        multipliers = np.maximum(multipliers + share * (bound - known) / (slope @ slope) * slope, 0.0)
    return kept, least


def _visits(windows: Windows, ways: _Ways) -> Array:
    """How often the best way from the start visits each waypoint, [N]."""
    counts = np.zeros(len(windows.priority))
    here, moment, before = 0, 0, -1
    while here != len(counts) - 1:
        onward = int(ways.following[here, moment])
        if onward == before:
            onward = int(ways.instead[here, moment])
        arrival = min(moment * GRID + int(windows.lasts[here, onward]), windows.late)
        before, here, moment = here, onward, int(windows.begins[onward, arrival]) // GRID
        counts[here] += 1.0
    return counts


def _labels(windows: Windows, ways: _Ways, multipliers: Array, known: float) -> tuple[float, float]:
    """Most total priority and its bound, by labels from the start."""
    size, late = len(windows.priority), windows.late
    most = known
    onward_bound = ways.best[:, : late + 1]
    bits = np.uint64(1) << np.arange(size, dtype=np.uint64)
    here, seen = np.zeros(1, np.int64), np.ones(1, np.uint64)
    time, gained, spare = np.zeros(1, np.int64), np.zeros(1), np.full(1, multipliers.sum())
    while len(here):
        rows, onward = [], np.arange(1, size)
        for part in np.array_split(np.arange(len(here)), len(here) // 20_000 + 1):
            arrival = np.minimum(time[part, None] + windows.lasts[here[part]][:, 1:], late)
            begins = windows.begins[onward, arrival]
            worth = gained[part, None] + windows.priority[1:]
            left = spare[part, None] - multipliers[1:]
            bound = worth + left + np.where(begins < late, onward_bound[onward, begins], -np.inf)
            fits = (seen[part, None] & bits[1:]) == 0
            most = max(most, np.where(fits & (begins < late), worth, -np.inf)[:, -1].max())
            row, column = np.nonzero(fits[:, :-1] & (bound[:, :-1] >= most + 1.0 - TOLERANCE))
            kept = seen[part][row] | bits[1:][column], begins[row, column], worth[row, column]
            rows.append((column + 1, *kept, left[row, column], bound[row, column]))
        here, seen, time, gained, spare, bound = (np.concatenate(parts) for parts in zip(*rows, strict=True))
        # Of those that end at one waypoint and have visited the same the earliest goes on.
        kept = np.lexsort((time, seen, here))
        first = np.ones(len(kept), bool)
        first[1:] = (np.diff(here[kept]) != 0) | (seen[kept][1:] != seen[kept][:-1])
        kept = kept[first]
        kept = kept[bound[kept] >= most + 1.0 - TOLERANCE]
        here, seen, time, gained, spare, bound = (
            values[kept] for values in (here, seen, time, gained, spare, bound)
        )
        if len(here) > MOST_LABELS:
            return most, float(np.floor(bound.max() + TOLERANCE))
    return most, most
