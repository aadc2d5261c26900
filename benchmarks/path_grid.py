"""Quickest paths on a fine grid, label by label in the order of arrival, and the best one of every passage.

Every node has 80 moves in different directions. A move takes the time that the current makes it take when it
is begun, so fields may change with time; whoever departs earlier is taken to arrive earlier.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from math import gcd, hypot

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from auvplan.ocean.currents import is_steady
from auvplan.ocean.vortices import LambVortices
from benchmarks.path_problems import PathProblem
from benchmarks.path_ruler import World, current_at

Array = NDArray[np.floating]
Index = NDArray[np.integer]

#: Nodes along the longer side of the box.
NODES = 560

#: Times at which a changing current is tabulated, and how many straight-line times they span.
_MOMENTS, _SPAN = 41, 4.0

#: Paths around other things than the best one are kept if the grid finds them this much slower at most.
SLOWER = 0.04

#: One node in so many to each side stands for the passages through its neighbours.
_THINNED = 2

_REACH = 5
_MOVES = np.array(
    [(a, b) for a in range(-_REACH, _REACH + 1) for b in range(-_REACH, _REACH + 1) if gcd(a, b) == 1]
)


@dataclass(frozen=True, eq=False)
class Grid:
    """A problem on nodes.

    Attributes:
        low: [2] m, place of node (0, 0).
        spacing: m.
        clear: [nx, ny] m beyond the margins at each node.
        u, v: [T, nx, ny] m/s north and east; T is 1 where the current is steady.
        moment: s from one table of the current to the next.
        start, goal: flat index of the node at the start and of the one nearest to the goal.
    """

    low: Array
    spacing: float
    clear: Array
    u: Array
    v: Array
    moment: float
    start: int
    goal: int

    @classmethod
    def of(cls, problem: PathProblem, world: World, nodes: int = NODES) -> "Grid":
        """Nodes all over the box, one of them at the start."""
        spacing = float((world.high - world.low).max() / nodes)
        start, goal = (np.asarray(end)[:2] for end in (problem.start, problem.goal))
        before = np.floor((start - world.low) / spacing).astype(int)
        low = start - before * spacing
        shape = tuple(int(n) for n in np.floor((world.high - low) / spacing).astype(int) + 1)
        x, y = np.meshgrid(*(low[k] + spacing * np.arange(shape[k]) for k in range(2)), indexing="ij")
        current = problem.environment.current
        count = 1 if is_steady(current) else _MOMENTS
        moment = _SPAN * problem.distance / float(problem.vehicle.speed) / max(count - 1, 1)  # type: ignore[arg-type]
        tables = [
            current_at(current, x.ravel(), y.ravel(), np.full(x.size, problem.depart + k * moment))
            for k in range(count)
        ]
        u, v = (np.stack([table[k].reshape(shape) for table in tables]) for k in range(2))
        i, j = np.minimum(np.rint((goal - low) / spacing).astype(int), np.array(shape) - 1)
        nearest = before[0] * shape[1] + before[1], i * shape[1] + j
        return cls(low, spacing, world.clearance(x, y), u, v, moment, int(nearest[0]), int(nearest[1]))

    def places(self, nodes: Index) -> Array:
        """[n, 2] m."""
        return self.low + self.spacing * np.stack(np.unravel_index(nodes, self.clear.shape), axis=1)


def passages(
    problem: PathProblem, world: World, most: int, grid: Grid | None = None
) -> Iterator[tuple[float, Array]]:
    """The best grid path that passes things as no other does, for each way to pass them, quickest first.

    Args:
        problem: what to sail.
        world: what to keep off.
        most: paths.
        grid: of the problem, where it is at hand.

    Yields:
        ``(time s, positions [n, 2] m)``, from start to goal; none where the grid finds no way.
    """
    grid = grid or Grid.of(problem, world)
    table = (grid.clear, grid.u, grid.v, grid.moment, grid.spacing, float(problem.vehicle.speed))  # type: ignore[arg-type]
    spheres = (world.centres, world.reach, world.distance, world.origin, world.pixel, world.margin, grid.low)
    none = np.zeros(grid.clear.shape)
    ahead, before = _field(grid.start, False, none, *table, *spheres)
    if not np.isfinite(ahead.flat[grid.goal]):
        return
    back, after = _field(grid.goal, True, ahead, *table, *spheres)
    total = ahead + back
    best = ahead.flat[grid.goal]
    landmarks = _landmarks(problem, world, grid)
    thinned = np.zeros(total.shape, bool)
    thinned[::_THINNED, ::_THINNED] = True
    nodes = np.flatnonzero((total <= best * (1.0 + SLOWER)) & thinned)
    nodes = np.r_[grid.goal, nodes[np.argsort(total.flat[nodes], kind="stable")]]
    turns = _turns(nodes, before, after, grid.clear.shape[1], grid.spacing, landmarks - grid.low)
    _, firsts = np.unique(turns, axis=0, return_index=True)
    for first in np.sort(firsts)[:most]:
        route = _route(nodes[first], before, after)
        points = grid.places(route)
        points[-1] = problem.goal[:2]
        yield float(total.flat[nodes[first]]), points


def _landmarks(problem: PathProblem, world: World, grid: Grid) -> Array:
    """[K, 2] m, what a path may pass on either side: obstacles, islands, vortices; a lattice without any."""
    marks = [world.centres]
    if problem.environment.chart is not None:
        labels, count = ndimage.label(grid.clear < 0.0)  # type: ignore[misc]
        marks += [grid.low + grid.spacing * np.argwhere(labels == k)[:1] for k in range(1, count + 1)]
    current = problem.environment.current
    if isinstance(current, LambVortices):
        centers, strength = np.asarray(current.centers, float)[0], np.asarray(current.strength)[0]
        marks.append(centers[strength != 0.0])
    else:
        shares = np.stack(np.meshgrid(*[np.linspace(0.05, 0.95, 8)] * 2), axis=-1).reshape(-1, 2)
        marks.append(world.low + shares * (world.high - world.low))
    return np.concatenate(marks)


def _route(node: int, before: Index, after: Index) -> Index:
    """Nodes of the best path through a node."""
    to_start, to_goal = [node], []
    while before[to_start[-1]] >= 0:
        to_start.append(before[to_start[-1]])
    node = after[node]
    while node >= 0:
        to_goal.append(node)
        node = after[node]
    return np.array(to_start[::-1] + to_goal)


@njit(cache=True)
def _too_near(x, y, centres, reach, distance, origin, pixel, margin):
    """Whether a place lies within the margins of an obstacle or the coast."""
    for k in range(len(reach)):
        if (x - centres[k, 0]) ** 2 + (y - centres[k, 1]) ** 2 < reach[k] ** 2:
            return True
    north, east = distance.shape
    i = min(max((x - origin[0]) / pixel - 0.5, 0.0), north - 1.0)
    j = min(max((y - origin[1]) / pixel - 0.5, 0.0), east - 1.0)
    i0, j0 = min(int(i), north - 2), min(int(j), east - 2)
    a, b = i - i0, j - j0
    south = (1.0 - b) * distance[i0, j0] + b * distance[i0, j0 + 1]
    northern = (1.0 - b) * distance[i0 + 1, j0] + b * distance[i0 + 1, j0 + 1]
    return (1.0 - a) * south + a * northern < margin


@njit(cache=True)
def _move_time(i, j, a, b, depart, u, v, moment, spacing, speed):
    """s of the move from node (i, j) by (a, b), begun `depart` s after the start; infinite if impossible."""
    steps = hypot(a, b)
    parts = max(abs(a), abs(b))
    north, east = a / steps, b / steps
    last = u.shape[0] - 1
    elapsed = 0.0
    for part in range(parts):
        share = (part + 0.5) / parts
        x, y = i + share * a, j + share * b
        i0, j0 = min(int(x), u.shape[1] - 2), min(int(y), u.shape[2] - 2)
        c, d = x - i0, y - j0
        k0, e = 0, 0.0
        if last > 0:
            when = min((depart + elapsed) / moment, float(last))
            k0 = min(int(when), last - 1)
            e = when - k0
        cu, cv = 0.0, 0.0
        for k in range(k0, min(k0 + 2, last + 1)):
            w = (1.0 - e) if k == k0 else e
            w00, w01, w10, w11 = w * (1 - c) * (1 - d), w * (1 - c) * d, w * c * (1 - d), w * c * d
            cu += w00 * u[k, i0, j0] + w01 * u[k, i0, j0 + 1]
            cu += w10 * u[k, i0 + 1, j0] + w11 * u[k, i0 + 1, j0 + 1]
            cv += w00 * v[k, i0, j0] + w01 * v[k, i0, j0 + 1]
            cv += w10 * v[k, i0 + 1, j0] + w11 * v[k, i0 + 1, j0 + 1]
        along, across = cu * north + cv * east, cu * east - cv * north
        if abs(across) >= speed:
            return np.inf
        ground = along + np.sqrt(speed * speed - across * across)
        if ground <= 1e-3 * speed:
            return np.inf
        elapsed += steps * spacing / parts / ground
    return elapsed


@njit(cache=True)
def _blocked(i, j, k, m, clear, spacing, centres, reach, distance, origin, pixel, margin, low):
    """Whether the move from node (i, j) to (k, m) comes too near to anything."""
    length = hypot(k - i, m - j) * spacing
    if clear[i, j] + clear[k, m] > 1.5 * length:
        return False
    parts = int(np.ceil(length / min(5.0, 0.5 * spacing)))
    for part in range(1, parts):
        x, y = i + (k - i) * part / parts, j + (m - j) * part / parts
        if _too_near(
            low[0] + spacing * x, low[1] + spacing * y, centres, reach, distance, origin, pixel, margin
        ):
            return True
    return False


@njit(cache=True)
def _field(
    source, backward, departs, clear, u, v, moment, spacing, speed,
    centres, reach, distance, origin, pixel, margin, low,
):  # fmt: skip
    """Least time [nx, ny] s from the source, or to it, and the next node on the way there, flat; -1 ends it.

    Backwards every move departs from a node at `departs`, the time at which the node can be reached at all.
    """
    nx, ny = clear.shape
    times = np.full((nx, ny), np.inf)
    towards = np.full(nx * ny, -1)
    done = np.zeros((nx, ny), np.bool_)
    times[source // ny, source % ny] = 0.0
    heap = [(0.0, source)]
    while heap:
        now, node = heappop(heap)
        i, j = node // ny, node % ny
        if done[i, j]:
            continue
        done[i, j] = True
        for move in range(len(_MOVES)):
            a, b = _MOVES[move]
            k, m = i + a, j + b
            if k < 0 or m < 0 or k >= nx or m >= ny or done[k, m] or clear[k, m] < 0.0:
                continue
            if backward:
                if departs[k, m] == np.inf:
                    continue
                arrival = now + _move_time(k, m, -a, -b, departs[k, m], u, v, moment, spacing, speed)
            else:
                arrival = now + _move_time(i, j, a, b, now, u, v, moment, spacing, speed)
            if arrival < times[k, m] and not _blocked(
                i, j, k, m, clear, spacing, centres, reach, distance, origin, pixel, margin, low
            ):
                times[k, m] = arrival
                towards[k * ny + m] = node
                heappush(heap, (arrival, k * ny + m))
    return times, towards


@njit(cache=True)
def _turns(nodes, before, after, ny, spacing, landmarks):
    """[n, K] whole turns of the best path through each node about each landmark, next to the first path's."""
    turns = np.zeros((len(nodes), len(landmarks)), np.int64)
    first = np.zeros(len(landmarks))
    for n in range(len(nodes)):
        angle = np.zeros(len(landmarks))
        for way in range(2):
            chain = before if way == 0 else after
            sign = -1.0 if way == 0 else 1.0
            here = nodes[n]
            there = chain[here]
            while there >= 0:
                x0, y0 = (here // ny) * spacing, (here % ny) * spacing
                x1, y1 = (there // ny) * spacing, (there % ny) * spacing
                for k in range(len(landmarks)):
                    ax, ay = x0 - landmarks[k, 0], y0 - landmarks[k, 1]
                    bx, by = x1 - landmarks[k, 0], y1 - landmarks[k, 1]
                    angle[k] += sign * np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
                here, there = there, chain[there]
        if n == 0:
            first = angle
        for k in range(len(landmarks)):
            turns[n, k] = int(np.rint((angle[k] - first[k]) / (2.0 * np.pi)))
    return turns
