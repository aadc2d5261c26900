"""Quickest paths on a grid north, east and depth, label by label in the order of arrival.

The grid is a corridor along the straight line, rotated with it. A move takes the time that the current makes
it take when it is begun. Moves keep the vehicle's limits on surge, sway and pitch, and off obstacles, which
are where they are at the time of arrival; turns are free. The best path through every node follows from a
second search from the goal, and paths through the places where these are locally the best of a cross-section
pass things differently, or at other depths.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from auvplan.ocean.currents import is_steady
from auvplan.vehicle import SPEED_FLOOR
from benchmarks.path_grid import movers_of, packed, route_through, strikes, tabulated, tidal_table
from benchmarks.path_problems import PathProblem
from benchmarks.path_ruler import World, velocity_at
from benchmarks.path_tighten import limits_of

Array = NDArray[np.floating]
Index = NDArray[np.integer]

#: Corridor: cells beyond start and goal, as a share of those between; half its width in lengths of the leg.
_BEYOND, _WIDE = 0.06, 0.35

#: Times at which a changing current is tabulated, and how many straight-line times they span.
_MOMENTS, _SPAN = 9, 2.5

#: Paths are kept if the grid finds them this much slower than the best at most.
SLOWER = 0.06

#: Cross-sections in which paths are told apart, shares of the way; cells by which they differ in the mean.
_SECTIONS, _APART = (0.15, 0.3, 0.5, 0.7, 0.85), 1.5

#: Levels that a move rises or sinks: many where it leads ahead, few where it leads aside.
_MANY, _FEW = (0, 1, 2, 3, 5, 8, 13, 21, 34), (0, 1, 3, 8)


def _moves() -> Index:
    """Cells ahead, aside and down of every move, [M, 3]."""
    found = []
    for ahead, aside, levels in (
        ((1, 2, 3), (0,), _MANY),
        ((1,), (-1, 1), _MANY),
        ((2, 3, 5), (-1, 1), _FEW),
        ((1,), (-2, 2), _FEW),
        ((0,), (-1, 1), (0, 2)),
        ((-1,), (-1, 0, 1), (0,)),
        ((0,), (0,), (1,)),
    ):
        for a in ahead:
            for b in aside:
                for k in levels:
                    if np.gcd.reduce([a, b, k]) == 1:
                        found += [(a, b, k)] if k == 0 else [(a, b, k), (a, b, -k)]
    return np.array(found)


_MOVES = _moves()


@dataclass(frozen=True, eq=False)
class DepthGrid:
    """A problem on nodes: ahead, aside and down, in that order of axes.

    Attributes:
        origin: [2] m, north and east of the node (0, 0, any).
        along: [2], unit vector ahead.
        ahead, aside: m between nodes.
        levels: [nz] m, depths of nodes.
        clear: [na, nb, nz] m beyond the margins at each node, without obstacles that move.
        water: [T, na, nb, nz, 3] m/s north, east, down; T is 1 where it is steady or turns with a tide.
        moments: [T] s since departure, of the tables of the current.
        tide: [F] factors of the current; one where it has no tide.
        tidal_moment: s from one factor to the next.
        movers: [K, 9], all obstacles, see `movers_of`.
        start, goal: node at the start and at the goal, but for their depth.
    """

    origin: Array
    along: Array
    ahead: float
    aside: float
    levels: Array
    clear: Array
    water: Array
    moments: Array
    tide: Array
    tidal_moment: float
    movers: Array
    start: tuple[int, int, int]
    goal: tuple[int, int, int]

    @property
    def spacing(self) -> float:
        """Between nodes ahead, m."""
        return self.ahead

    @property
    def width(self) -> tuple[float, float]:
        """Of a first lattice about a path on the grid, to each side and up and down, m."""
        return 2.0 * self.aside, 3.0 * float(self.levels[-1] - self.levels[0]) / max(len(self.levels) - 1, 1)

    @classmethod
    def of(cls, problem: PathProblem, world: World, cells: tuple[int, int, int]) -> "DepthGrid":
        """Lay nodes along the straight line.

        Args:
            cells: between start and goal, to both sides together, and from the least depth to the greatest.
        """
        start, goal = np.asarray(problem.start), np.asarray(problem.goal)
        length = float(np.linalg.norm((goal - start)[:2]))
        along = (goal - start)[:2] / length
        beyond, half = int(np.ceil(_BEYOND * cells[0])), cells[1] // 2
        ahead, aside = length / cells[0], _WIDE * length / half
        right = np.array([-along[1], along[0]])
        origin = start[:2] - beyond * ahead * along - half * aside * right
        levels = np.linspace(world.low[2], world.high[2], cells[2] + 1)
        ends = [int(np.argmin(np.abs(levels - end[2]))) for end in (goal, start)]
        for level, end in zip(ends, (goal, start), strict=True):
            levels[level] = end[2]
        shape = cells[0] + 2 * beyond + 1, 2 * half + 1, cells[2] + 1
        i, j, k = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
        x, y = (origin[axis] + i * ahead * along[axis] + j * aside * right[axis] for axis in range(2))
        z = levels[k]
        straight = length / float(problem.vehicle.speed)
        current, tide, tidal_moment = tidal_table(problem, straight)
        moments = np.zeros(1) if is_steady(current) else np.linspace(0.0, _SPAN * straight, _MOMENTS)
        places = x.ravel(), y.ravel(), z.ravel()
        tables = [
            np.stack(velocity_at(current, *places, np.full(x.size, problem.depart + t)), axis=1)
            for t in moments
        ]
        return cls(
            origin, along, ahead, aside, levels, world.clearance(x, y, z=z),
            np.stack(tables).reshape(len(moments), *shape, 3), moments, tide, tidal_moment,
            movers_of(problem, world.spheres), (beyond, half, ends[1]), (beyond + cells[0], half, ends[0]),
        )  # fmt: skip

    def places(self, nodes: Index) -> Array:
        """Return positions of flat nodes, [n, 3] m."""
        i, j, k = np.unravel_index(nodes, self.clear.shape)
        right = np.array([-self.along[1], self.along[0]])
        level = self.origin + np.outer(i * self.ahead, self.along) + np.outer(j * self.aside, right)
        return np.column_stack([level, self.levels[k]])


def ways(problem: PathProblem, world: World, grid: DepthGrid, most: int) -> Iterator[tuple[float, Array]]:
    """Find the best grid path, and others that are the best about where they pass, quickest first.

    Yields:
        ``(time s, positions [n, 3] m)``, from start to goal; none where the grid finds no way.
    """
    things = packed(world, grid.movers)
    limits = limits_of(problem, 0.0)
    fastest = limits[0] + np.linalg.norm(grid.water, axis=-1).max() * np.abs(grid.tide).max()
    moment = float(grid.moments[1]) if len(grid.moments) > 1 else 1.0
    sea = grid.water, moment, grid.tide, grid.tidal_moment, *limits, fastest
    frame = grid.origin, grid.along, grid.ahead, grid.aside, grid.levels
    shape = grid.clear.shape
    start, goal = (int(np.ravel_multi_index(end, shape)) for end in (grid.start, grid.goal))
    ahead, before = _labels(start, goal, False, np.zeros(shape), grid.clear, frame, sea, things, _MOVES)
    best = ahead[grid.goal]
    if not np.isfinite(best):
        return
    back, after = _labels(goal, start, True, ahead, grid.clear, frame, sea, things, _MOVES)
    total = ahead + back
    nodes = [goal]
    for share in _SECTIONS:
        at = round(grid.start[0] + share * (grid.goal[0] - grid.start[0]))
        section = np.where(np.isfinite(total[at]), total[at], np.inf)
        lowest = (section <= ndimage.minimum_filter(section, 5)) & (section <= best * (1.0 + SLOWER))
        nodes += [int(np.ravel_multi_index((at, j, k), shape)) for j, k in np.argwhere(lowest)]
    times = [best if node == goal else float(total.flat[node]) for node in nodes]
    kept: list[Array] = []
    for k in np.argsort(times, kind="stable"):
        points = grid.places(route_through(nodes[k], before, after))
        profile = _profile(points, grid)
        if any(np.abs(profile - other).max(axis=1).mean() < _APART for other in kept):
            continue
        kept.append(profile)
        points[0], points[-1] = problem.start, problem.goal
        yield times[k], points
        if len(kept) == most:
            return


def _profile(points: Array, grid: DepthGrid) -> Array:
    """Return where a path passes cross-sections, [n, 2] cells aside and down."""
    away = points[:, :2] - grid.origin
    arc, aside = away @ grid.along, away @ np.array([-grid.along[1], grid.along[0]])
    order = np.maximum.accumulate(arc)
    at = np.linspace(order[0], order[-1], 64)
    down = (points[:, 2] - grid.levels[0]) / (grid.levels[-1] - grid.levels[0]) * (len(grid.levels) - 1)
    return np.column_stack([np.interp(at, order, aside / grid.aside), np.interp(at, order, down)])


@njit(cache=True)
def _labels(source, target, backward, departs, clear, frame, sea, things, moves):
    """Least time [na, nb, nz] s from the source, or to it; the next node on the way there, flat, -1 ends it.

    Backwards every move departs from a node at `departs`, the time at which the node can be reached at all,
    and nodes that no path leads through which is nearly as quick as the best are left out.
    """
    origin, along, step_ahead, step_aside, levels = frame
    na, nb, nz = clear.shape
    fastest = sea[8]
    times = np.full((na, nb, nz), np.inf)
    towards = np.full(na * nb * nz, -1)
    done = np.zeros((na, nb, nz), np.bool_)
    times[source // (nb * nz), source // nz % nb, source % nz] = 0.0
    bound = np.inf
    if backward:
        bound = (1.0 + SLOWER) * departs[source // (nb * nz), source // nz % nb, source % nz]
    heap = [(0.0, source)]
    while heap:
        now, node = heappop(heap)
        i, j, k = node // (nb * nz), node // nz % nb, node % nz
        if done[i, j, k]:
            continue
        if now > bound:
            break
        done[i, j, k] = True
        if node == target and not backward:
            bound = (1.0 + SLOWER) * now
        for move in range(len(moves)):
            a, b, c = moves[move]
            if backward:
                a, b, c = -a, -b, -c
            h, m, n = i + a, j + b, k + c
            if h < 0 or m < 0 or n < 0 or h >= na or m >= nb or n >= nz:
                continue
            if done[h, m, n] or clear[h, m, n] < 0.0:
                continue
            level_x, level_y, down = a * step_ahead, b * step_aside, levels[n] - levels[k]
            length = np.sqrt(level_x * level_x + level_y * level_y + down * down)
            if now + length / fastest >= times[h, m, n]:
                continue
            if backward:
                begin = departs[h, m, n]
                if now + length / fastest + begin > bound:
                    continue
                lasts = _move_time(h, m, n, -a, -b, -c, -level_x, -level_y, -down, along, begin, sea)
            else:
                begin = now
                lasts = _move_time(i, j, k, a, b, c, level_x, level_y, down, along, now, sea)
            arrival = now + lasts
            if arrival >= times[h, m, n]:
                continue
            x0 = origin[0] + i * step_ahead * along[0] - j * step_aside * along[1]
            y0 = origin[1] + i * step_ahead * along[1] + j * step_aside * along[0]
            x1 = x0 + level_x * along[0] - level_y * along[1]
            y1 = y0 + level_x * along[1] + level_y * along[0]
            z0, z1 = levels[k], levels[n]
            if backward:
                x0, y0, z0, x1, y1, z1 = x1, y1, z1, x0, y0, z0
            both = clear[i, j, k] + clear[h, m, n]
            if not strikes(x0, y0, z0, x1, y1, z1, both, begin, lasts, 0.25 * step_ahead, things):
                times[h, m, n] = arrival
                towards[(h * nb + m) * nz + n] = node
                heappush(heap, (arrival, (h * nb + m) * nz + n))
    return times, towards


@njit(cache=True)
def _move_time(i, j, k, a, b, c, level_x, level_y, down, along, depart, sea):
    """s of the move from node (i, j, k) by (a, b, c) cells, begun at `depart`; infinite if impossible."""
    water, moment, tide, tidal_moment, speed, surge_max, sway_max, upright_max, _ = sea
    length = np.sqrt(level_x * level_x + level_y * level_y + down * down)
    north = (level_x * along[0] - level_y * along[1]) / length
    east = (level_x * along[1] + level_y * along[0]) / length
    sink = down / length
    parts = max(abs(a), abs(b), min(abs(c), 6))
    last = len(water) - 1
    elapsed = 0.0
    for part in range(parts):
        share = (part + 0.5) / parts
        x, y, z = i + share * a, j + share * b, k + share * c
        i0 = min(int(x), water.shape[1] - 2)
        j0 = min(int(y), water.shape[2] - 2)
        k0 = min(int(z), water.shape[3] - 2)
        p, q, r = x - i0, y - j0, z - k0
        when = min((depart + elapsed) / moment, float(last))
        table = min(int(when), max(last - 1, 0))
        later = when - table if last > 0 else 0.0
        strength = tabulated(tide, tidal_moment, depart + elapsed)
        cu, cv, cw = 0.0, 0.0, 0.0
        for corner in range(8):
            ci, cj, ck = corner // 4, corner // 2 % 2, corner % 2
            weight = (p if ci else 1.0 - p) * (q if cj else 1.0 - q) * (r if ck else 1.0 - r)
            if weight == 0.0:
                continue
            weight *= strength
            now = weight * (1.0 - later)
            cu += now * water[table, i0 + ci, j0 + cj, k0 + ck, 0]
            cv += now * water[table, i0 + ci, j0 + cj, k0 + ck, 1]
            cw += now * water[table, i0 + ci, j0 + cj, k0 + ck, 2]
            if later > 0.0:
                then = weight * later
                cu += then * water[table + 1, i0 + ci, j0 + cj, k0 + ck, 0]
                cv += then * water[table + 1, i0 + ci, j0 + cj, k0 + ck, 1]
                cw += then * water[table + 1, i0 + ci, j0 + cj, k0 + ck, 2]
        ahead = cu * north + cv * east + cw * sink
        across = np.sqrt(max(cu * cu + cv * cv + cw * cw - ahead * ahead, 0.0))
        if across >= speed or across > sway_max:
            return np.inf
        ground = ahead + np.sqrt(speed * speed - across * across)
        if ground <= SPEED_FLOOR * speed or ground > surge_max:
            return np.inf
        if abs(ground * sink - cw) > upright_max:
            return np.inf
        elapsed += length / parts / ground
    return elapsed
