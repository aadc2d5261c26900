"""Quickest paths on a grid, label by label in the order of arrival, and the best one of every passage.

A plane has nodes all over the box, with 80 moves; a problem in depth has them in a corridor along its
straight line, with 135. A move takes the time that the current makes it take when it is begun, so fields may
change with time. Moves keep the vehicle's limits on surge, sway and pitch, and off obstacles that move at
the time of arrival; turns are free. The best path through every node follows from a second search from the
goal.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from math import gcd

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from auvplan.ocean.currents import is_steady
from auvplan.ocean.vortices import LambVortices
from auvplan.vehicle import SPEED_FLOOR
from benchmarks.harness import Array
from benchmarks.paths.problems import PathProblem
from benchmarks.paths.ruler import Spheres, World, upright_max, velocity_at
from benchmarks.paths.waters import TidalCurrent, without_tide

Index = NDArray[np.integer]

#: Corridor: cells beyond start and goal, as a share of those between; half its width in lengths of the leg.
_BEYOND, _WIDE = 0.06, 0.35

#: Times at which a changing current is tabulated, and how many straight-line times they span: in a plane, in
#: a corridor, and the same of the factor of a tide.
_PLANE_TIMES, _DEEP_TIMES, _TIDES = (41, 4.0), (9, 2.5), (6001, 30.0)

#: Other paths than the best one are kept if the grid finds them this much slower at most.
_PLANE_SLOWER, _DEEP_SLOWER = 0.04, 0.06

#: One node in so many to each side stands for the passages through its neighbours.
_THINNED = 2

#: Cross-sections in which ways are distinguished, shares of the leg; cells by which they differ in the mean.
_SECTIONS, _APART = (0.15, 0.3, 0.5, 0.7, 0.85), 1.5

_REACH = range(-5, 6)
#: Levels that a move rises or sinks: many where it leads ahead, few where it leads aside.
_MANY, _FEW = (0, 1, 2, 3, 5, 8, 13, 21, 34), (0, 1, 3, 8)

#: Cells ahead, aside and down of every move, [M, 3].
_PLANE_MOVES = np.array([(a, b, 0) for a in _REACH for b in _REACH if gcd(a, b) == 1])
_DEEP_MOVES = np.array(
    [
        (a, b, down)
        for ahead, aside, levels in (
            ((1, 2, 3), (0,), _MANY),
            ((1,), (-1, 1), _MANY),
            ((2, 3, 5), (-1, 1), _FEW),
            ((1,), (-2, 2), _FEW),
            ((0,), (-1, 1), (0, 2)),
            ((-1,), (-1, 0, 1), (0,)),
            ((0,), (0,), (1,)),
        )
        for a in ahead
        for b in aside
        for level in levels
        if gcd(a, b, level) == 1
        for down in ((level, -level) if level else (0,))
    ]
)


@dataclass(frozen=True, eq=False)
class Grid:
    """A problem on nodes: ahead, aside and down, in that order of axes."""

    origin: Array  # [2] m, north and east of the node (0, 0, any)
    along: Array  # [2], unit vector ahead
    ahead: float  # m between nodes
    aside: float  # m between nodes
    levels: Array  # [nz] m, depths of nodes
    clear: Array  # [na, nb, nz] m beyond the margins at each node, without obstacles that move
    water: Array  # [T, na, nb, nz, 3] m/s north, east, down; T is 1 where it is steady or turns with a tide
    moments: Array  # [T] s since departure, of the tables of the current
    tide: Array  # [F] factors of the current; one where it has no tide
    tidal_moment: float  # s from one factor to the next
    movers: Array  # [K, 9], obstacles that move, see `movers_of`; in depth all of them
    start: int  # flat index of the node at the start and of the one at or nearest to the goal
    goal: int

    @classmethod
    def plane(cls, problem: PathProblem, world: World, nodes: int) -> "Grid":
        """Lay so many nodes along the longer side of the box, one of them at the start."""
        spacing = float((world.high - world.low)[:2].max() / nodes)
        start, goal = (np.asarray(end)[:2] for end in (problem.start, problem.goal))
        before = np.floor((start - world.low[:2]) / spacing).astype(int)
        origin = start - before * spacing
        shape = *(np.floor((world.high[:2] - origin) / spacing).astype(int) + 1), 1
        nearest = np.minimum(np.rint((goal - origin) / spacing).astype(int), np.array(shape[:2]) - 1)
        frame = origin, np.array([1.0, 0.0]), spacing, spacing, world.low[2:]
        moving = world.spheres.chosen(world.spheres.moving)
        return cls._laid(
            problem, world, frame, shape, problem.distance, _PLANE_TIMES, moving, (*before, 0), (*nearest, 0)
        )

    @classmethod
    def corridor(cls, problem: PathProblem, world: World, cells: tuple[int, int, int]) -> "Grid":
        """Lay nodes along the straight line, between the least depth of the box and the greatest.

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
        levels, (last, first) = levels_through(world, cells[2] + 1, (goal[2], start[2]))
        shape = cells[0] + 2 * beyond + 1, 2 * half + 1, cells[2] + 1
        ends = (beyond, half, first), (beyond + cells[0], half, last)
        frame = origin, along, ahead, aside, levels
        return cls._laid(problem, world, frame, shape, length, _DEEP_TIMES, world.spheres, *ends)

    @classmethod
    def _laid(
        cls, problem: PathProblem, world: World, frame: tuple, shape: tuple[int, ...], length: float,
        times: tuple[int, float], movers: Spheres, start: tuple[int, ...], goal: tuple[int, ...],
    ) -> "Grid":  # fmt: skip
        """Look up clearance and current at the nodes."""
        origin, along, ahead, aside, levels = frame
        right = np.array([-along[1], along[0]])
        i, j, k = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
        x, y = (origin[axis] + i * ahead * along[axis] + j * aside * right[axis] for axis in range(2))
        z = levels[k]
        straight = length / float(problem.vehicle.speed)
        current, tide, tidal_moment = problem.environment.current, np.ones(1), 1.0
        if isinstance(current, TidalCurrent) and is_steady(current.current):
            tidal_moment = _TIDES[1] * straight / (_TIDES[0] - 1)
            tide = np.asarray(current.factor(problem.depart + tidal_moment * np.arange(_TIDES[0])), float)
            current = current.current
        count, span = (1, 0.0) if is_steady(current) else times
        moments = np.linspace(0.0, span * straight, count)
        places = x.ravel(), y.ravel(), z.ravel()
        water = [velocity_at(current, *places, np.full(x.size, problem.depart + t)) for t in moments]
        return cls(
            *frame, world.clearance(x, y, z=z),
            np.stack([np.stack(each, axis=1) for each in water]).reshape(count, *shape, 3),
            moments, tide, tidal_moment, movers_of(problem, movers),
            *(int(np.ravel_multi_index(end, shape)) for end in (start, goal)),
        )  # fmt: skip

    @property
    def width(self) -> tuple[float, float]:
        """Of a first lattice about a path on the grid, to each side and up and down, m."""
        return 2.0 * self.aside, 3.0 * float(self.levels[-1] - self.levels[0]) / max(len(self.levels) - 1, 1)

    def places(self, nodes: Index) -> Array:
        """Return positions of flat nodes, [n, 3] m."""
        i, j, k = np.unravel_index(nodes, self.clear.shape)
        right = np.array([-self.along[1], self.along[0]])
        level = self.origin + np.outer(i * self.ahead, self.along) + np.outer(j * self.aside, right)
        return np.column_stack([level, self.levels[k]])


def levels_through(world: World, count: int, depths: tuple[float, ...]) -> tuple[Array, list[int]]:
    """Return even levels over the depth of the box, those nearest to some depths moved there, and which."""
    levels = np.linspace(world.low[2], world.high[2], count)
    nearest = [int(np.argmin(np.abs(levels - depth))) for depth in depths]
    for level, depth in zip(nearest, depths, strict=True):
        levels[level] = depth
    return levels, nearest


def limits_of(problem: PathProblem, slack: float = 0.0) -> tuple[float, float, float, float]:
    """Return speed, and limits on ground speed, current across and speed up or down through water, m/s.

    Args:
        slack: share of the limits that is not used.
    """
    vehicle = problem.vehicle
    speed, surge_max, sway_max = map(float, (vehicle.speed, vehicle.surge_max, vehicle.sway_max))
    share = 1.0 - slack
    return speed, share * surge_max, min(share * sway_max, 0.999 * speed), share * upright_max(problem)


def movers_of(problem: PathProblem, spheres: Spheres) -> Array:
    """Return what is known of each of K obstacles, [K, 9].

    Place at departure [m], velocity [m/s], boundary at departure with the margin [m], growth [m/s] and where
    that ends [m].
    """
    since = problem.depart - spheres.observed_at
    grown = np.minimum(spheres.growth * np.maximum(since, 0.0), spheres.growth_max)
    centres = spheres.centres + since[:, None] * spheres.velocity
    return np.column_stack(
        [centres, spheres.velocity, spheres.reach + grown, spheres.growth, spheres.growth_max - grown]
    )


@dataclass(frozen=True, eq=False)
class _Searched:
    """Both searches of a grid: from the start and from the goal."""

    total: Array  # [na, nb, nz] s, of the best path through each node
    before: Index  # flat, the next node on the way to the start and to the goal, -1 at these
    after: Index
    settled: Index  # nodes in the order in which each search settled them
    resettled: Index
    best: float  # s, of the best path

    @classmethod
    def of(
        cls, world: World, grid: Grid, limits: tuple[float, ...], moves: tuple[Index, Index], slower: float
    ) -> "_Searched | None":
        """Search both ways with moves of their own; None where there is no way."""
        fastest = limits[0] + np.linalg.norm(grid.water, axis=-1).max() * np.abs(grid.tide).max()
        moment = float(grid.moments[1]) if len(grid.moments) > 1 else 1.0
        sea = grid.water, moment, grid.tide, grid.tidal_moment, *limits, fastest
        frame = grid.origin, grid.along, grid.ahead, grid.aside, grid.levels
        table = grid.clear, frame, sea, packed(world, grid.movers), slower
        still = np.zeros(grid.clear.shape)
        ahead, before, settled = _labels(grid.start, grid.goal, False, still, *table, moves[0])
        if not np.isfinite(ahead.flat[grid.goal]):
            return None
        back, after, resettled = _labels(grid.goal, grid.start, True, ahead, *table, moves[1])
        return cls(ahead + back, before, after, settled, resettled, float(ahead.flat[grid.goal]))

    def route(self, node: int) -> Index:
        """Return the nodes of the best path through a node."""
        to_start, to_goal = [node], []
        while self.before[to_start[-1]] >= 0:
            to_start.append(int(self.before[to_start[-1]]))
        while (node := int(self.after[node])) >= 0:
            to_goal.append(node)
        return np.array(to_start[::-1] + to_goal)


def passages(problem: PathProblem, world: World, grid: Grid, most: int) -> Iterator[tuple[float, Array]]:
    """Find the best path in a plane for each way to pass things, quickest first.

    Yields:
        ``(time s, positions [n, 2] m)``, from start to goal; none where the grid finds no way.
    """
    vehicle = problem.vehicle
    limits = *(float(limit) for limit in (vehicle.speed, vehicle.surge_max, vehicle.sway_max)), np.inf
    found = _Searched.of(world, grid, limits, (_PLANE_MOVES, _PLANE_MOVES), _PLANE_SLOWER)
    if found is None:
        return
    total, shape = found.total[..., 0], found.total.shape[:2]
    near = np.isfinite(total) & (total <= found.best * (1.0 + _PLANE_SLOWER))
    near.flat[grid.goal] = True
    order = _with_parents(near.ravel(), found.settled, found.before)
    returning = _with_parents(near.ravel(), found.resettled, found.after)
    thinned = np.zeros(shape, bool)
    thinned[::_THINNED, ::_THINNED] = True
    nodes = np.flatnonzero(near & thinned)
    nodes = np.r_[grid.goal, nodes[np.argsort(total.flat[nodes], kind="stable")]]
    marks = _landmarks(problem, world, grid) - grid.origin
    turns = _turns(
        order, returning, nodes, found.before, found.after, total.size, shape[1], grid.ahead, marks
    )
    _, firsts = np.unique(turns, return_index=True)
    for first in np.sort(firsts)[:most]:
        points = grid.places(found.route(nodes[first]))[:, :2]
        points[-1] = problem.goal[:2]
        yield float(total.flat[nodes[first]]), points


def ways(problem: PathProblem, world: World, grid: Grid, most: int) -> Iterator[tuple[float, Array]]:
    """Find the best path in depth, and others that are the best about where they pass, quickest first.

    Paths pass different things, or at other depths, where they are locally the best of a cross-section.

    Yields:
        ``(time s, positions [n, 3] m)``, from start to goal; none where the grid finds no way.
    """
    moves = _DEEP_MOVES, -_DEEP_MOVES
    found = _Searched.of(world, grid, limits_of(problem), moves, _DEEP_SLOWER)
    if found is None:
        return
    nodes, shape = [grid.goal], found.total.shape
    first, last = (np.unravel_index(end, shape)[0] for end in (grid.start, grid.goal))
    for share in _SECTIONS:
        at = round(first + share * (last - first))
        section = np.where(np.isfinite(found.total[at]), found.total[at], np.inf)
        lowest = section <= ndimage.minimum_filter(section, 5)
        lowest &= section <= found.best * (1.0 + _DEEP_SLOWER)
        nodes += [int(np.ravel_multi_index((at, j, k), shape)) for j, k in np.argwhere(lowest)]
    times = [found.best if node == grid.goal else float(found.total.flat[node]) for node in nodes]
    kept: list[Array] = []
    for k in np.argsort(times, kind="stable"):
        points = grid.places(found.route(nodes[k]))
        profile = _profile(points, grid)
        if any(np.abs(profile - other).max(axis=1).mean() < _APART for other in kept):
            continue
        kept.append(profile)
        points[0], points[-1] = problem.start, problem.goal
        yield times[k], points
        if len(kept) == most:
            return


def _profile(points: Array, grid: Grid) -> Array:
    """Return where a path passes cross-sections, [n, 2] cells aside and down."""
    away = points[:, :2] - grid.origin
    arc, aside = away @ grid.along, away @ np.array([-grid.along[1], grid.along[0]])
    order = np.maximum.accumulate(arc)
    at = np.linspace(order[0], order[-1], 64)
    down = (points[:, 2] - grid.levels[0]) / (grid.levels[-1] - grid.levels[0]) * (len(grid.levels) - 1)
    return np.column_stack([np.interp(at, order, aside / grid.aside), np.interp(at, order, down)])


def packed(world: World, movers: Array, extra: float = 0.0) -> tuple:
    """Return what `strikes` must know, with so much clearance [m] beyond the margins."""
    fixed, movers = world.spheres.chosen(~world.spheres.moving), movers.copy()
    movers[:, 6] += extra
    bed = world.bed._replace(values=world.bed.values - extra)
    return movers, fixed.centres, fixed.reach + extra, world.coast, world.margin + extra, bed


def _landmarks(problem: PathProblem, world: World, grid: Grid) -> Array:
    """Return [K, 2] m, what a path may pass on either side: obstacles, islands, vortices, else a lattice."""
    marks = [world.spheres.centres[~world.spheres.moving, :2]]
    if problem.environment.chart is not None:
        labels, count = ndimage.label(grid.clear[..., 0] < 0.0)
        marks += [grid.origin + grid.ahead * np.argwhere(labels == k)[:1] for k in range(1, count + 1)]
    current = without_tide(problem.environment.current)
    if isinstance(current, LambVortices):
        centers, strength = np.asarray(current.centers, float)[0], np.asarray(current.strength)[0]
        marks.append(centers[strength != 0.0])
    else:
        shares = np.stack(np.meshgrid(*[np.linspace(0.05, 0.95, 8)] * 2), axis=-1).reshape(-1, 2)
        marks.append(world.low[:2] + shares * (world.high - world.low)[:2])
    return np.concatenate(marks)


@njit(cache=True)
def _too_near(x, y, z, centres, reach, coast, margin, bed):
    """Whether a place lies within the margins of a fixed obstacle, the coast or the sea bed."""
    for k in range(len(reach)):
        away = (x - centres[k, 0]) ** 2 + (y - centres[k, 1]) ** 2 + (z - centres[k, 2]) ** 2
        if away < reach[k] ** 2:
            return True
    return _bilinear(bed, x, y) < z or _bilinear(coast, x, y) < margin


@njit(cache=True)
def _bilinear(raster, x, y):
    v = raster.values
    north, east = v.shape
    i = min(max((x - raster.origin[0]) / raster.pixel - 0.5, 0.0), north - 1.0)
    j = min(max((y - raster.origin[1]) / raster.pixel - 0.5, 0.0), east - 1.0)
    i0, j0 = min(int(i), north - 2), min(int(j), east - 2)
    a, b = i - i0, j - j0
    south = (1.0 - b) * v[i0, j0] + b * v[i0, j0 + 1]
    return (1.0 - a) * south + a * ((1.0 - b) * v[i0 + 1, j0] + b * v[i0 + 1, j0 + 1])


@njit(cache=True)
def motion(water, way, speed):
    """Ground speed, current across, and speed up or down through the water, m/s; the first is 0 if beaten."""
    along = water[0] * way[0] + water[1] * way[1] + water[2] * way[2]
    square = water[0] * water[0] + water[1] * water[1] + water[2] * water[2] - along * along
    across = np.sqrt(max(square, 0.0))
    if across >= speed:
        return 0.0, across, np.inf
    ground = along + np.sqrt(speed * speed - across * across)
    return ground, across, abs(ground * way[2] - water[2])


@njit(cache=True)
def tabulated(table, moment, t):
    """Linear look-up at t [s] in a table, held at its end."""
    at = min(t / moment, len(table) - 1.0)
    k = min(int(at), max(len(table) - 2, 0))
    return table[k] if len(table) == 1 else table[k] + (at - k) * (table[k + 1] - table[k])


@njit(cache=True)
def _labels(source, target, backward, departs, clear, frame, sea, things, slower, moves):
    """Least time [na, nb, nz] s from the source, or to it; the next node on the way there, flat, -1 ends it.

    Backwards every move departs from a node at `departs`, the time at which the node can be reached at all,
    and nodes that no path leads through which is nearly as quick as the best are left out. The third is the
    nodes in the order in which they are settled.
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
        bound = (1.0 + slower) * departs[source // (nb * nz), source // nz % nb, source % nz]
    settled = np.empty(na * nb * nz, np.int64)
    count = 0
    heap = [(0.0, source)]
    while heap:
        now, node = heappop(heap)
        i, j, k = node // (nb * nz), node // nz % nb, node % nz
        if done[i, j, k]:
            continue
        if now > bound:
            break
        done[i, j, k] = True
        settled[count] = node
        count += 1
        if node == target and not backward:
            bound = (1.0 + slower) * now
        for move in range(len(moves)):
            a, b, c = moves[move]
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
    return times, towards, settled[:count]


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
        k0 = max(min(int(z), water.shape[3] - 2), 0)
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
            for after in range(2 if later > 0.0 else 1):
                part = weight * strength * (later if after else 1.0 - later)
                cu += part * water[table + after, i0 + ci, j0 + cj, k0 + ck, 0]
                cv += part * water[table + after, i0 + ci, j0 + cj, k0 + ck, 1]
                cw += part * water[table + after, i0 + ci, j0 + cj, k0 + ck, 2]
        ground, across, upright = motion((cu, cv, cw), (north, east, sink), speed)
        if across > sway_max or ground <= SPEED_FLOOR * speed or ground > surge_max or upright > upright_max:
            return np.inf
        elapsed += length / parts / ground
    return elapsed


@njit(cache=True)
def strikes(x0, y0, z0, x1, y1, z1, clear, begin, lasts, step, things):
    """Whether a straight move comes too near to anything.

    Args:
        x0, y0, z0, x1, y1, z1: m, its ends.
        clear: m, clearance at both ends together, without obstacles that move.
        begin: s since departure.
        lasts: s.
        step: m, between the places at which it is judged.
        things: obstacles that move, fixed ones and the coast, as `packed` has them.
    """
    movers, centres, reach, coast, margin, bed = things
    way_x, way_y, way_z = x1 - x0, y1 - y0, z1 - z0
    length = np.sqrt(way_x * way_x + way_y * way_y + way_z * way_z)
    anything = len(reach) > 0 or coast.values.shape[0] > 2 or bed.values.shape[0] > 2
    if anything and clear <= 1.5 * length:
        parts = int(np.ceil(length / step))
        for part in range(1, parts):
            share = part / parts
            x, y, z = x0 + share * way_x, y0 + share * way_y, z0 + share * way_z
            if _too_near(x, y, z, centres, reach, coast, margin, bed):
                return True
    for n in range(len(movers)):
        x, y, z, u, v, w, boundary, growth, growth_max = movers[n]
        away_x, away_y, away_z = x0 - x - u * begin, y0 - y - v * begin, z0 - z - w * begin
        to_x, to_y, to_z = way_x - u * lasts, way_y - v * lasts, way_z - w * lasts
        square = to_x * to_x + to_y * to_y + to_z * to_z
        share = -(away_x * to_x + away_y * to_y + away_z * to_z) / (square + 1e-12)
        share = min(max(share, 0.0), 1.0)
        kept = boundary + min(growth * (begin + lasts), growth_max)
        away_x, away_y, away_z = away_x + share * to_x, away_y + share * to_y, away_z + share * to_z
        if away_x * away_x + away_y * away_y + away_z * away_z < kept * kept:
            return True
    return False


@njit(cache=True)
def _with_parents(chosen, settled, towards):
    """Chosen nodes and all that their paths lead through, in the order of `settled`: parents first."""
    kept = chosen.copy()
    for k in range(len(settled) - 1, -1, -1):
        node = settled[k]
        if kept[node] and towards[node] >= 0:
            kept[towards[node]] = True
    return settled[kept[settled]]


@njit(cache=True)
def _turns(order, returning, nodes, before, after, size, ny, spacing, landmarks):
    """[n] signature of the whole turns of the best path through each node about each landmark.

    Turns add up along the trees: `order` and `returning` list the nodes that count, parents first. The
    signature is a sum of the turns, next to the first path's, times odd numbers without a pattern.
    """
    signature = np.zeros(len(nodes), np.int64)
    ahead, back = np.zeros(size), np.zeros(size)
    weight = np.int64(88172645463325252)
    for mark in range(len(landmarks)):
        x, y = landmarks[mark]
        for tree in range(2):
            nodes_of, towards, angle = (order, before, ahead) if tree == 0 else (returning, after, back)
            for here in nodes_of:
                there = towards[here]
                if there < 0:
                    angle[here] = 0.0
                    continue
                ax, ay = (here // ny) * spacing - x, (here % ny) * spacing - y
                bx, by = (there // ny) * spacing - x, (there % ny) * spacing - y
                turn = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
                angle[here] = angle[there] + (turn if tree == 1 else -turn)
        weight ^= weight << np.int64(13)
        weight ^= weight >> np.int64(7)
        weight ^= weight << np.int64(17)
        first = ahead[nodes[0]] + back[nodes[0]]
        for n in range(len(nodes)):
            whole = np.int64(np.rint((ahead[nodes[n]] + back[nodes[n]] - first) / (2.0 * np.pi)))
            signature[n] += whole * (weight | np.int64(1))
    return signature
