"""The fewest waypoints that stand for a planned path: vehicles take a dozen, not a hundred samples."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.mission.survey import LinePart
from auvplan.ocean.environment import Environment
from auvplan.path.straight import DISTANCES, Straights
from auvplan.runtime.arrays import Array
from auvplan.vehicle import Vehicle

#: By how much certified distances, m, and speeds, m/s, may seem less for the steps that a line is cut into.
_BLUR = 0.1, 0.01

#: s by which times may change on any path: a leg between two tasks in one place takes no longer.
_SHORT = 0.1

#: m of a survey line that a straight line may cover less than the part of the path that it stands for.
_COVERED = 0.1


@dataclass(frozen=True)
class Thinned:
    """Some samples of a path, to be joined by straight lines.

    Attributes:
        indices: [K] of the samples kept, both ends among them.
        positions: [K, 3] m, north, east, depth.
        times: [K] s since the epoch, arrival along the straight lines.
        time_change: by what share the straight lines take longer than the path; negative where shorter.
        clearance: m, least certified distance of the straight lines to coast and collision boundaries.
    """

    indices: NDArray[np.intp]
    positions: Array
    times: Array
    time_change: float
    clearance: float


def thin(
    positions: ArrayLike,
    times: ArrayLike,
    env: Environment,
    vehicle: Vehicle,
    *,
    depart: float | None = None,
    tolerance: float = 0.02,
    margin: float | tuple[float, float] = 10.0,
    line: LinePart | None = None,
) -> Thinned:
    """Keep the fewest samples of a path whose straight lines take as long and keep as clear as the path does.

    Both the path and what is kept of it are timed again in the current as it is on arrival, in steps of at
    most 20 m, so that their times compare. Certified distances to the coast and to the obstacles' boundaries
    are each not below the smaller of their `margin` and what the path itself has, altitudes above the sea bed
    not below the smaller of its clearance and the path's; where the current lets the vehicle hold the path
    within its limits, it lets it hold the straight lines too. Of each number of lines those are tried whose
    changes of time, summed without regard to sign, are least.

    Args:
        positions: [S, 3] m, samples, at least two.
        times: [S] s since the epoch, rising; only the first counts, where `depart` is not given.
        env: current, coast, obstacles and sea bed; any `Current` will do.
        vehicle: speed and limits.
        depart: s since the epoch.
        tolerance: share by which the total time may change; a tenth of a second it always may.
        margin: m, to the coast and areas that are closed, and to obstacles; one number stands for both.
        line: part of a survey line that the path follows: the straight lines cover as much of it.

    Raises:
        ValueError: there are fewer than two samples, or shapes do not fit.
    """
    places = np.asarray(positions, float)
    if places.ndim != 2 or places.shape[1] != 3 or len(places) < 2 or np.shape(times) != (len(places),):
        raise ValueError(
            f"positions must be [S, 3] with S > 1 and times [S], got {places.shape} and {np.shape(times)}"
        )
    start = float(np.asarray(times)[0]) if depart is None else float(depart)
    sea = Straights.through(env, vehicle)
    path_times, path_room = sea.arrivals(places, start)
    distances, asked = np.arange(len(path_room)) < DISTANCES, np.zeros(len(path_room))
    asked[: DISTANCES - 1] = margin
    if env.seabed is not None:
        asked[DISTANCES - 1] = float(env.seabed.clearance)
    blur = np.where(distances, *_BLUR)
    least = np.minimum(asked, path_room) - blur
    total = path_times[-1] - path_times[0]
    allowed = max(tolerance * total, _SHORT)

    i, j = np.triu_indices(len(places), 1)
    covers = np.ones(len(i), bool) if line is None else _covers(line, places, i, j)
    i, j = i[covers], j[covers]
    passing = path_times[j] - path_times[i]
    lines, room = sea.pass_lines(places[i], places[j], path_times[i], passing)
    # What a line may come to is what the path has where the line stands for it.
    alone, own = j == i + 1, np.full((len(least), len(places), len(places)), np.inf)
    own[:, i[alone], j[alone]] = room[:, alone]
    for width in range(2, len(places)):
        at = np.arange(len(places) - width)
        own[:, at, at + width] = np.minimum(own[:, at, at + width - 1], own[:, at + width - 1, at + width])
    kept = np.minimum(asked[:, None], own[:, i, j])
    admitted = (room >= kept - blur[:, None]).all(axis=0) | alone
    change = np.full((len(places), len(places)), np.inf)
    change[i, j] = np.where(admitted, lines - passing, np.inf)
    for chain in _chains(np.abs(change)):
        whole = len(chain) == len(places)
        estimate = abs(change[chain[:-1], chain[1:]].sum())
        if not whole and estimate > 1.5 * allowed:
            continue
        arrivals, clear = sea.arrivals(places[chain], start)
        late = float(arrivals[-1] - arrivals[0] - total)
        if whole or (abs(late) < allowed and (clear >= least).all()):
            share = late / float(total) if total > _SHORT else 0.0
            return Thinned(chain, places[chain], arrivals, share, float(clear[: DISTANCES - 1].min()))
    raise AssertionError("the path itself is among the chains")


def thin_between(kept: NDArray[np.intp], positions: Array, times: Array, *world: Any, **how: Any) -> Thinned:
    """`thin` what lies between each two of some samples [K], both ends among them, by itself.

    Where the path rests between two, it does so as long.
    """
    places, indices, arrivals, clear = np.asarray(positions, float), [kept[:1]], [times[:1]], np.inf
    for first, last in pairwise(kept.tolist()):
        own, chosen, after = slice(first, last + 1), np.array([last - first]), times[[last]] - times[first]
        if np.diff(places[own], axis=0).any():
            part = thin(places[own], times[own], *world, **how)
            chosen, after, clear = part.indices[1:], part.times[1:] - times[first], min(clear, part.clearance)
        indices.append(first + chosen)
        arrivals.append(arrivals[-1][-1] + after)
    chosen, reached = np.concatenate(indices), np.concatenate(arrivals)
    change = float((reached[-1] - times[-1]) / max(times[-1] - times[0], _SHORT))
    return Thinned(chosen, places[chosen], reached, change, clear)


def _covers(line: LinePart, places: Array, i: NDArray[np.intp], j: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return whether straight lines between samples [L] cover as much of a survey line as the path."""

    def covered(first: Array, last: Array) -> Array:
        (here, _), (there, _) = line.across(first), line.across(last)
        return np.diff(line.counted(first, last), axis=1)[:, 0] * np.abs(there - here)

    steps = np.concatenate([[0.0], np.cumsum(covered(places[:-1], places[1:]))])
    return covered(places[i], places[j]) >= steps[j] - steps[i] - _COVERED


def _chains(cost: Array) -> Iterator[NDArray[np.intp]]:
    """Cheapest chains from the first to the last sample by rising numbers of lines, as indices of samples.

    Args:
        cost: [S, S], of the line from i to j; infinite where there is none.
    """
    best, came = cost[0], []
    for _ in range(1, len(cost)):
        if np.isfinite(best[-1]):
            chain = [len(cost) - 1]
            for parents in reversed(came):
                chain.append(int(parents[chain[-1]]))
            yield np.asarray([0, *reversed(chain)])
        sums = best[:, None] + cost
        parents = sums.argmin(axis=0)
        came.append(parents)
        best = sums[parents, np.arange(len(cost))]
