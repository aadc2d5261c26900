"""Quickest paths on a fine grid, label by label in the order of arrival, and the best one of every passage.

Every node has 80 moves in different directions. A move takes the time that the current makes it take when it
is begun, so fields may change with time; whoever departs earlier is taken to arrive earlier. Moves keep the
vehicle's limits on surge and sway, and off obstacles that move at the time of arrival; turns are free.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from math import gcd, hypot

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from auvplan.ocean.currents import Current, is_steady
from auvplan.ocean.vortices import LambVortices
from auvplan.vehicle import SPEED_FLOOR
from benchmarks.path_problems import PathProblem
from benchmarks.path_ruler import Spheres, World, current_at
from benchmarks.water_problems import TidalCurrent, without_tide

Array = NDArray[np.floating]
Index = NDArray[np.integer]

#: Nodes along the longer side of the box.
NODES = 560

#: Times at which a changing current is tabulated, and how many straight-line times they span.
_MOMENTS, _SPAN = 41, 4.0

#: The same of the factor of a tide.
_TIDES, _TIDAL_SPAN = 6001, 30.0

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
        clear: [nx, ny] m beyond the margins at each node, without obstacles that move.
        u, v: [T, nx, ny] m/s north and east; T is 1 where the current is steady or turns with a tide.
        moment: s from one table of the current to the next.
        tide: [F] factors of the current; one where it has no tide.
        tidal_moment: s from one factor to the next.
        movers: [K, 9], obstacles that move, see `movers_of`.
        start, goal: flat index of the node at the start and of the one nearest to the goal.
    """

    low: Array
    spacing: float
    clear: Array
    u: Array
    v: Array
    moment: float
    tide: Array
    tidal_moment: float
    movers: Array
    start: int
    goal: int

    @classmethod
    def of(cls, problem: PathProblem, world: World, nodes: int = NODES) -> "Grid":
        """Lay nodes all over the box, one of them at the start."""
        spacing = float((world.high - world.low)[:2].max() / nodes)
        start, goal = (np.asarray(end)[:2] for end in (problem.start, problem.goal))
        before = np.floor((start - world.low[:2]) / spacing).astype(int)
        low = start - before * spacing
        shape = tuple(int(n) for n in np.floor((world.high[:2] - low) / spacing).astype(int) + 1)
        x, y = np.meshgrid(*(low[k] + spacing * np.arange(shape[k]) for k in range(2)), indexing="ij")
        straight = problem.distance / float(problem.vehicle.speed)
        current, tide, tidal_moment = tidal_table(problem, straight)
        count = 1 if is_steady(current) else _MOMENTS
        moment = _SPAN * straight / max(count - 1, 1)
        tables = [
            current_at(current, x.ravel(), y.ravel(), np.full(x.size, problem.depart + k * moment))
            for k in range(count)
        ]
        u, v = (np.stack([table[k].reshape(shape) for table in tables]) for k in range(2))
        moving = world.spheres.chosen(world.spheres.moving)
        i, j = np.minimum(np.rint((goal - low) / spacing).astype(int), np.array(shape) - 1)
        nearest = before[0] * shape[1] + before[1], i * shape[1] + j
        return cls(
            low, spacing, world.clearance(x, y), u, v, moment, tide, tidal_moment,
            movers_of(problem, moving), int(nearest[0]), int(nearest[1]),
        )  # fmt: skip

    def places(self, nodes: Index) -> Array:
        """Return positions, [n, 2] m."""
        return self.low + self.spacing * np.stack(np.unravel_index(nodes, self.clear.shape), axis=1)


def tidal_table(problem: PathProblem, straight: float) -> tuple[Current, Array, float]:
    """Return the current without its tide, factors of the tide, and s from one to the next.

    The factor is 1 where there is no tide; `straight` is the time of the straight line in still water, s.
    """
    current = problem.environment.current
    if not isinstance(current, TidalCurrent) or not is_steady(current.current):
        return current, np.ones(1), 1.0
    moment = _TIDAL_SPAN * straight / (_TIDES - 1)
    return (
        current.current,
        np.asarray(current.factor(problem.depart + moment * np.arange(_TIDES)), float),
        moment,
    )


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


def passages(
    problem: PathProblem, world: World, most: int, grid: Grid | None = None
) -> Iterator[tuple[float, Array]]:
    """Find the best grid path that passes things as no other does, for each way to pass them, quickest first.

    Args:
        grid: of the problem, where it is at hand.

    Yields:
        ``(time s, positions [n, 2] m)``, from start to goal; none where the grid finds no way.
    """
    grid = grid or Grid.of(problem, world)
    vehicle = problem.vehicle
    limits = [float(limit) for limit in (vehicle.speed, vehicle.surge_max, vehicle.sway_max)]
    strongest = np.hypot(grid.u, grid.v).max() * np.abs(grid.tide).max()
    water = (grid.u, grid.v, grid.moment, grid.tide, grid.tidal_moment, *limits, limits[0] + strongest)
    things = packed(world, grid.movers)
    none = np.zeros(grid.clear.shape)
    table = grid.clear, np.r_[grid.low, world.low[2]], grid.spacing, water, things
    ahead, before, settled = _field(grid.start, grid.goal, False, none, *table)
    best = ahead.flat[grid.goal]
    if not np.isfinite(best):
        return
    back, after, resettled = _field(grid.goal, grid.start, True, ahead, *table)
    total = ahead + back
    landmarks = _landmarks(problem, world, grid)
    near = np.isfinite(total) & (total <= best * (1.0 + SLOWER))
    near.flat[grid.goal] = True
    order, returning = (
        _with_parents(near.ravel(), nodes, towards)
        for nodes, towards in ((settled, before), (resettled, after))
    )
    thinned = np.zeros(total.shape, bool)
    thinned[::_THINNED, ::_THINNED] = True
    nodes = np.flatnonzero(near & thinned)
    nodes = np.r_[grid.goal, nodes[np.argsort(total.flat[nodes], kind="stable")]]
    marks = landmarks - grid.low
    shape = grid.clear.shape
    turns = _turns(order, returning, nodes, before, after, shape[0] * shape[1], shape[1], grid.spacing, marks)
    _, firsts = np.unique(turns, return_index=True)
    for first in np.sort(firsts)[:most]:
        points = grid.places(route_through(nodes[first], before, after))
        points[-1] = problem.goal[:2]
        yield float(total.flat[nodes[first]]), points


def packed(world: World, movers: Array, extra: float = 0.0) -> tuple:
    """Return what `strikes` must know, with so much clearance [m] beyond the margins."""
    fixed, movers = world.spheres.chosen(~world.spheres.moving), movers.copy()
    movers[:, 6] += extra
    coast = world.distance, world.origin, world.pixel, world.margin + extra
    bed = world.bed - extra, world.bed_origin, world.bed_pixel
    return movers, fixed.centres, fixed.reach + extra, *coast, *bed


def _landmarks(problem: PathProblem, world: World, grid: Grid) -> Array:
    """Return [K, 2] m, what a path may pass on either side: obstacles, islands, vortices, else a lattice."""
    marks = [world.spheres.centres[~world.spheres.moving, :2]]
    if problem.environment.chart is not None:
        labels, count = ndimage.label(grid.clear < 0.0)
        marks += [grid.low + grid.spacing * np.argwhere(labels == k)[:1] for k in range(1, count + 1)]
    current = without_tide(problem.environment.current)
    if isinstance(current, LambVortices):
        centers, strength = np.asarray(current.centers, float)[0], np.asarray(current.strength)[0]
        marks.append(centers[strength != 0.0])
    else:
        shares = np.stack(np.meshgrid(*[np.linspace(0.05, 0.95, 8)] * 2), axis=-1).reshape(-1, 2)
        marks.append(world.low[:2] + shares * (world.high - world.low)[:2])
    return np.concatenate(marks)


def route_through(node: int, before: Index, after: Index) -> Index:
    """Return the nodes of the best path through a node."""
    to_start, to_goal = [node], []
    while before[to_start[-1]] >= 0:
        to_start.append(int(before[to_start[-1]]))
    while (node := int(after[node])) >= 0:
        to_goal.append(node)
    return np.array(to_start[::-1] + to_goal)


@njit(cache=True)
def _too_near(x, y, z, centres, reach, distance, origin, pixel, margin, bed, bed_origin, bed_pixel):
    """Whether a place lies within the margins of a fixed obstacle, the coast or the sea bed."""
    for k in range(len(reach)):
        away = (x - centres[k, 0]) ** 2 + (y - centres[k, 1]) ** 2 + (z - centres[k, 2]) ** 2
        if away < reach[k] ** 2:
            return True
    if _bilinear(bed, bed_origin, bed_pixel, x, y) < z:
        return True
    return _bilinear(distance, origin, pixel, x, y) < margin


@njit(cache=True)
def _bilinear(distance, origin, pixel, x, y):
    """Look up a raster between pixel centres; beyond them the nearest holds."""
    north, east = distance.shape
    i = min(max((x - origin[0]) / pixel - 0.5, 0.0), north - 1.0)
    j = min(max((y - origin[1]) / pixel - 0.5, 0.0), east - 1.0)
    i0, j0 = min(int(i), north - 2), min(int(j), east - 2)
    a, b = i - i0, j - j0
    south = (1.0 - b) * distance[i0, j0] + b * distance[i0, j0 + 1]
    northern = (1.0 - b) * distance[i0 + 1, j0] + b * distance[i0 + 1, j0 + 1]
    return (1.0 - a) * south + a * northern


@njit(cache=True)
def tabulated(table, moment, t):
    """Linear look-up at t [s] in a table, held at its end."""
    at = min(t / moment, len(table) - 1.0)
    k = min(int(at), max(len(table) - 2, 0))
    return table[k] if len(table) == 1 else table[k] + (at - k) * (table[k + 1] - table[k])


@njit(cache=True)
def _move_time(i, j, a, b, depart, spacing, water):
    """s of the move from node (i, j) by (a, b), begun `depart` s after the start; infinite if impossible."""
    u, v, moment, tide, tidal_moment, speed, surge_max, sway_max, _ = water
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
        strength = tabulated(tide, tidal_moment, depart + elapsed)
        cu, cv = 0.0, 0.0
        for k in range(k0, min(k0 + 2, last + 1)):
            w = strength * ((1.0 - e) if k == k0 else e)
            w00, w01, w10, w11 = w * (1 - c) * (1 - d), w * (1 - c) * d, w * c * (1 - d), w * c * d
            cu += w00 * u[k, i0, j0] + w01 * u[k, i0, j0 + 1]
            cu += w10 * u[k, i0 + 1, j0] + w11 * u[k, i0 + 1, j0 + 1]
            cv += w00 * v[k, i0, j0] + w01 * v[k, i0, j0 + 1]
            cv += w10 * v[k, i0 + 1, j0] + w11 * v[k, i0 + 1, j0 + 1]
        along, across = cu * north + cv * east, abs(cu * east - cv * north)
        if across >= speed or across > sway_max:
            return np.inf
        ground = along + np.sqrt(speed * speed - across * across)
        if ground <= SPEED_FLOOR * speed or ground > surge_max:
            return np.inf
        elapsed += steps * spacing / parts / ground
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
        things: obstacles that move, fixed ones and the coast, as `passages` packs them.
    """
    movers, centres, reach, distance, origin, pixel, margin, bed, bed_origin, bed_pixel = things
    way_x, way_y, way_z = x1 - x0, y1 - y0, z1 - z0
    length = np.sqrt(way_x * way_x + way_y * way_y + way_z * way_z)
    anything = len(reach) > 0 or distance.shape[0] > 2 or bed.shape[0] > 2
    if anything and clear <= 1.5 * length:
        parts = int(np.ceil(length / step))
        for part in range(1, parts):
            share = part / parts
            x, y, z = x0 + share * way_x, y0 + share * way_y, z0 + share * way_z
            if _too_near(
                x, y, z, centres, reach, distance, origin, pixel, margin, bed, bed_origin, bed_pixel
            ):
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
def _field(source, target, backward, departs, clear, low, spacing, water, things):
    """Least time [nx, ny] s from the source, or to it; the next node on the way there, flat, -1 ends it.

    Backwards every move departs from a node at `departs`, the time at which the node can be reached at all,
    and nodes that no path leads through which is nearly as quick as the best are left out. The third is the
    nodes in the order in which they are settled.
    """
    nx, ny = clear.shape
    fastest = water[8]
    times = np.full((nx, ny), np.inf)
    towards = np.full(nx * ny, -1)
    done = np.zeros((nx, ny), np.bool_)
    times[source // ny, source % ny] = 0.0
    bound = np.inf
    if backward:
        bound = (1.0 + SLOWER) * departs[source // ny, source % ny]
    settled = np.empty(nx * ny, np.int64)
    count = 0
    heap = [(0.0, source)]
    while heap:
        now, node = heappop(heap)
        i, j = node // ny, node % ny
        if done[i, j]:
            continue
        if now > bound:
            break
        done[i, j] = True
        settled[count] = node
        count += 1
        if node == target and not backward:
            bound = (1.0 + SLOWER) * now
        for move in range(len(_MOVES)):
            a, b = _MOVES[move]
            k, m = i + a, j + b
            if k < 0 or m < 0 or k >= nx or m >= ny or done[k, m] or clear[k, m] < 0.0:
                continue
            least = now + hypot(a, b) * spacing / fastest
            if least >= times[k, m]:
                continue
            if backward:
                begin = departs[k, m]
                if least + begin > bound:
                    continue
                lasts = _move_time(k, m, -a, -b, begin, spacing, water)
            else:
                begin = now
                lasts = _move_time(i, j, a, b, now, spacing, water)
            arrival = now + lasts
            if arrival >= times[k, m]:
                continue
            x0, y0 = low[0] + spacing * i, low[1] + spacing * j
            x1, y1 = low[0] + spacing * k, low[1] + spacing * m
            if backward:
                x0, y0, x1, y1 = x1, y1, x0, y0
            both = clear[i, j] + clear[k, m]
            z = low[2]
            if not strikes(x0, y0, z, x1, y1, z, both, begin, lasts, 0.25 * spacing, things):
                times[k, m] = arrival
                towards[k * ny + m] = node
                heappush(heap, (arrival, k * ny + m))
    return times, towards, settled[:count]


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
