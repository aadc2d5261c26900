"""Tightening of a path: the quickest one on a narrow lattice about it, again and again on finer ones.

Stations lie along the path, with nodes to both sides, and above and below where the box has depth. Dynamic
programming finds the quickest way from station to station, and keeps limits and clearances without any
penalty; turns are free. The lattice is then laid about what was found, half as wide where that gains
nothing.
"""

import numpy as np
from numba import njit

from auvplan.vehicle import SPEED_FLOOR
from benchmarks.harness import Array
from benchmarks.paths.grid import Grid, limits_of, motion, packed, strikes, tabulated
from benchmarks.paths.polish import Polished, spread
from benchmarks.paths.problems import PathProblem
from benchmarks.paths.ruler import World, evaluate, velocity_at
from benchmarks.paths.waters import without_tide

#: Segments of a path, and nodes to each side of it.
SEGMENTS, _ASIDE = 256, 8

#: Nodes to each side, and above and below, where the box has depth.
_ROUND = 2, 4

#: Times that the lattice is made half as wide, and lattices of one width at most.
_HALVINGS, _SWEEPS = 9, 6

#: Share of the travel time that a lattice must gain for another one as wide.
_GAIN = 1e-6

#: Share of the vehicle's limits that is not used: currents are looked up at the stations alone.
_SLACK = 0.002

#: How often more clearance is asked for, where the ruler finds too little.
_TRIES = 4


def _offsets(deep: bool) -> Array:
    """Nodes of a station about its middle, [K, 2] steps aside and up or down."""
    aside, upright = _ROUND if deep else (_ASIDE, 0)
    steps = np.meshgrid(np.arange(-aside, aside + 1), np.arange(-upright, upright + 1), indexing="ij")
    return np.stack([line.ravel() for line in steps], axis=1).astype(float)


def tighten(
    problem: PathProblem, world: World, grid: Grid, positions: Array, segments: int = SEGMENTS,
    width: float | tuple[float, float] | None = None,
) -> Polished | None:  # fmt: skip
    """Tighten a path; None where no path nearby is feasible.

    Args:
        grid: of the problem, of any spacing.
        positions: [n, 2] m, or [n, 3] where the box has depth, from start to goal.
        width: m, of the first lattice to each side, and up and down; None for two spacings of the grid.
    """
    width = 2.0 * grid.ahead if width is None else width
    size = np.broadcast_to(np.asarray(width, float), 2)
    deep = bool(world.high[2] > world.low[2])
    lattices = problem, world, grid, _offsets(deep)
    points = positions
    if points.shape[1] == 2:
        points = np.column_stack([points, np.full(len(points), world.low[2])])
    points, extra = spread(points, segments), 0.2 * world.tolerance
    for _ in range(_TRIES):
        found = _settled(lattices, points, size, extra)
        if found is None:
            return None
        result = Polished(found if deep else found[:, :2], evaluate(problem, found, world))
        if result.score.clearance > -world.tolerance:
            return result
        extra += 0.2 * world.tolerance - result.score.clearance
        points, size = found, size / 8.0
    return result


def _settled(lattices: tuple, points: Array, size: Array, extra: float) -> Array | None:
    """Lay lattices until nothing is gained, [n, 3] m; None where the widest holds no path.

    Args:
        lattices: problem, world, grid, at whose moments the current is looked up, and `_offsets`.
        points: [n, 3] m.
        size: [2] m, of the first lattice to each side, and up and down.
        extra: m of clearance beyond the margins.
    """
    last = np.inf
    for halving in range(_HALVINGS):
        for _ in range(_SWEEPS):
            found = _sweep(lattices, points, size, extra)
            if found is None:
                if np.isfinite(last):
                    break
                return None
            time, moved = found
            gained = 1.0 - time / last if np.isfinite(last) else 1.0
            # Stations that drifted apart are spread evenly, while there is room to make good what that costs.
            points, last = spread(moved, len(moved) - 1) if halving < 4 else moved, time
            if gained < _GAIN:
                break
        size = 0.5 * size
    return points


def _sweep(lattices: tuple, points: Array, size: Array, extra: float) -> tuple[float, Array] | None:
    """Find the quickest path on one lattice: its time [s] and positions [n, 3] m; None without any.

    Args:
        points: [n, 3] m, the stations.
        size: [2] m, from a station's middle to its outermost nodes aside, and up or down.
        extra: m of clearance beyond the margins.
    """
    problem, world, grid, offsets = lattices
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    level = np.hypot(tangent[:, 0], tangent[:, 1])
    level_way = np.where(level[:, None] > 1e-6, tangent[:, :2], (points[-1] - points[0])[:2] + 1e-9)
    level_way /= np.linalg.norm(level_way, axis=1, keepdims=True)
    aside = np.stack([-level_way[:, 1], level_way[:, 0], np.zeros(len(points))], axis=1)
    apart = size / np.maximum(offsets.max(axis=0), 1.0) * offsets
    nodes = points[:, None] + apart[:, :1] * aside[:, None] + apart[:, 1:] * np.cross(tangent, aside)[:, None]
    shape, current = nodes.shape[:2], without_tide(problem.environment.current)
    x, y, z = nodes.reshape(-1, 3).T
    when = [np.full(x.size, problem.depart + t) for t in grid.moments]
    water = np.stack([np.stack(velocity_at(current, x, y, z, t)) for t in when])
    u, v, w = (water[:, k].reshape(-1, *shape) for k in range(3))
    clear = world.clearance(nodes[..., 0], nodes[..., 1], z=nodes[..., 2]) - extra
    moment = float(grid.moments[1] - grid.moments[0]) if len(grid.moments) > 1 else 1.0
    step = 0.25 * grid.ahead
    limits = limits_of(problem, _SLACK)
    fastest = limits[0] + np.sqrt((water**2).sum(axis=1).max()) * np.abs(grid.tide).max()
    chosen, time = _lattice(
        nodes, u, v, w, moment, clear, limits, fastest, grid.tide, grid.tidal_moment, step,
        packed(world, _near(grid.movers, nodes, extra), extra),
    )  # fmt: skip
    if not np.isfinite(time):
        return None
    return time, nodes[np.arange(len(nodes)), chosen]


def _near(movers: Array, nodes: Array, extra: float) -> Array:
    """Return those of K obstacles [K, 9] that may ever come near to a lattice [N, M, 3] m.

    Args:
        extra: m of clearance beyond the margins.
    """
    middle = nodes[:, nodes.shape[1] // 2]
    across = np.linalg.norm(nodes - middle[:, None], axis=2).max(axis=1)
    longest = np.linalg.norm(np.diff(middle, axis=0), axis=1).max() + 2.0 * across.max()
    away = middle[:, None] - movers[:, :3]
    velocity = movers[:, 3:6]
    since = np.maximum((away * velocity).sum(axis=2) / ((velocity**2).sum(axis=1) + 1e-12), 0.0)
    nearest = np.linalg.norm(away - since[..., None] * velocity, axis=2).min(axis=0, initial=np.inf)
    return movers[nearest <= movers[:, 6] + movers[:, 8] + extra + longest]


@njit(cache=True)
def _mixed(u, v, w, table, share, n, k):
    """Current at node k of station n between two of its tables, m/s."""
    if share == 0.0:
        return u[table, n, k], v[table, n, k], w[table, n, k]
    first, last = 1.0 - share, share
    return (
        first * u[table, n, k] + last * u[table + 1, n, k],
        first * v[table, n, k] + last * v[table + 1, n, k],
        first * w[table, n, k] + last * w[table + 1, n, k],
    )


@njit(cache=True)
def _lattice(nodes, u, v, w, moment, clear, limits, fastest, tide, tidal_moment, step, things):
    """Chosen node of each of N stations, [N], and the travel time, s; infinite where no way is found."""
    speed, surge_max, sway_max, upright_max = limits
    stations, count = clear.shape
    last_table = len(u) - 1
    times = np.full((stations, count), np.inf)
    before = np.zeros((stations, count), np.int64)
    middle = count // 2
    times[0, middle] = 0.0
    for n in range(1, stations):
        for k in range(count):
            if clear[n, k] < 0.0 or (n == stations - 1 and k != middle):
                continue
            for turn in range(count):
                # The nearest first: the others are mostly too late.
                j = (k + turn) % count
                begin = times[n - 1, j]
                if begin >= times[n, k]:
                    continue
                way_x = nodes[n, k, 0] - nodes[n - 1, j, 0]
                way_y = nodes[n, k, 1] - nodes[n - 1, j, 1]
                way_z = nodes[n, k, 2] - nodes[n - 1, j, 2]
                length = np.sqrt(way_x * way_x + way_y * way_y + way_z * way_z)
                if length == 0.0 or begin + length / fastest >= times[n, k]:
                    continue
                half_way = begin + 0.5 * length / speed
                strength = 0.5 * tabulated(tide, tidal_moment, half_way)
                when = min(half_way / moment, float(last_table))
                a = min(int(when), max(last_table - 1, 0))
                share = when - a if last_table > 0 else 0.0
                u0, v0, w0 = _mixed(u, v, w, a, share, n - 1, j)
                u1, v1, w1 = _mixed(u, v, w, a, share, n, k)
                way = way_x / length, way_y / length, way_z / length
                water = strength * (u0 + u1), strength * (v0 + v1), strength * (w0 + w1)
                ground, across, upright = motion(water, way, speed)
                if across > sway_max or ground <= SPEED_FLOOR * speed or ground > surge_max:
                    continue
                if upright_max < np.inf:
                    # Where the current changes along the move, one of its ends is the worse.
                    for end in ((u0, v0, w0), (u1, v1, w1)):
                        there = 2.0 * strength * end[0], 2.0 * strength * end[1], 2.0 * strength * end[2]
                        upright = max(upright, motion(there, way, speed)[2])
                    if upright > upright_max:
                        continue
                lasts = length / ground
                if begin + lasts >= times[n, k]:
                    continue
                both = clear[n - 1, j] + clear[n, k]
                x0, y0, z0 = nodes[n - 1, j]
                x1, y1, z1 = nodes[n, k]
                if not strikes(x0, y0, z0, x1, y1, z1, both, begin, lasts, step, things):
                    times[n, k] = begin + lasts
                    before[n, k] = j
    chosen = np.zeros(stations, np.int64)
    chosen[-1] = middle
    for n in range(stations - 1, 0, -1):
        chosen[n - 1] = before[n, chosen[n]]
    return chosen, times[-1, middle]
