"""Tightening of a path: the quickest one on a narrow lattice about it, again and again on finer ones.

Stations lie along the path, and at each of them nodes to both sides. Dynamic programming finds the quickest
way from station to station with the times of arrival as they come, and keeps limits and clearances without
any penalty; turns are free. The lattice is then laid about what was found, half as wide where that gains
nothing.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvplan.vehicle import SPEED_FLOOR
from benchmarks.path_grid import Grid, packed, strikes, tabulated
from benchmarks.path_polish import Polished, resampled
from benchmarks.path_problems import PathProblem
from benchmarks.path_ruler import World, current_at, evaluate
from benchmarks.water_problems import TidalCurrent

Array = NDArray[np.floating]

#: Segments of a path, and nodes to each side of it.
SEGMENTS, _ASIDE = 256, 8

#: Times that the lattice is made half as wide, and lattices of one width at most.
_HALVINGS, _SWEEPS = 9, 6

#: Share of the travel time that a lattice must gain for another one as wide.
_GAIN = 1e-6

#: Share of the vehicle's limits that is not used: currents are looked up at the stations alone.
_SLACK = 0.002

#: How often more clearance is asked for, where the ruler finds too little.
_TRIES = 4


def tighten(
    problem: PathProblem,
    world: World,
    grid: Grid,
    positions: Array,
    segments: int = SEGMENTS,
    width: float | None = None,
) -> Polished | None:
    """Tighten a path [n, 2] m; None where no path nearby is feasible.

    Args:
        problem: with a steady current or one with a tide.
        world: what to keep off.
        grid: of the problem, of any spacing.
        positions: [n, 2] m, from start to goal.
        segments: of the path.
        width: m, of the first lattice to each side; None for two spacings of the grid.
    """
    width, extra = 2.0 * grid.spacing if width is None else width, 0.2 * world.tolerance
    points = resampled(positions, segments)
    for _ in range(_TRIES):
        found = _settled(problem, world, grid, points, width, extra)
        if found is None:
            return None
        result = Polished(found, evaluate(problem, found, world))
        if result.score.clearance > -world.tolerance:
            return result
        extra += 0.2 * world.tolerance - result.score.clearance
        points, width = found, 0.25 * grid.spacing
    return result


def _settled(
    problem: PathProblem, world: World, grid: Grid, points: Array, width: float, extra: float
) -> Array | None:
    """Lay lattices until nothing is gained, [n, 2] m; None where the widest holds no path.

    Args:
        problem: what to travel.
        world: what to keep off.
        grid: of the problem.
        points: [n, 2] m.
        width: m, of the first lattice to each side.
        extra: m of clearance beyond the margins.
    """
    last = np.inf
    for halving in range(_HALVINGS):
        for _ in range(_SWEEPS):
            found = _sweep(problem, world, grid, points, width / _ASIDE, extra)
            if found is None:
                if np.isfinite(last):
                    break
                return None
            time, moved = found
            gained = 1.0 - time / last if np.isfinite(last) else 1.0
            # Stations that drifted apart are spread evenly, while there is room to make good what that costs.
            points, last = resampled(moved, len(moved) - 1) if halving < 4 else moved, time
            if gained < _GAIN:
                break
        width *= 0.5
    return points


def _sweep(
    problem: PathProblem, world: World, grid: Grid, points: Array, apart: float, extra: float
) -> tuple[float, Array] | None:
    """Find the quickest path on one lattice: its time [s] and positions [n, 2] m; None without any.

    Args:
        problem: what to travel.
        world: what to keep off.
        grid: of the problem.
        points: [n, 2] m, the stations.
        apart: m from a node to the next one of its station.
        extra: m of clearance beyond the margins.
    """
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    offsets = apart * np.arange(-_ASIDE, _ASIDE + 1)
    nodes = points[:, None] + offsets[:, None] * normal[:, None]
    current = problem.environment.current
    current = current.current if isinstance(current, TidalCurrent) else current
    x, y = (nodes[..., k].ravel() for k in range(2))
    u, v = (
        part.reshape(nodes.shape[:2]) for part in current_at(current, x, y, np.full(x.size, problem.depart))
    )
    clear = world.clearance(nodes[..., 0], nodes[..., 1]) - extra
    vehicle = problem.vehicle
    speed, surge_max, sway_max = (
        float(limit)  # type: ignore[arg-type]
        for limit in (vehicle.speed, vehicle.surge_max, vehicle.sway_max)
    )
    limits = speed, (1.0 - _SLACK) * surge_max, min((1.0 - _SLACK) * sway_max, 0.999 * speed)
    tables = grid.tide, grid.tidal_moment, 0.25 * grid.spacing, packed(world, grid, extra)
    chosen, time = _lattice(nodes, u, v, clear, limits, *tables)
    if not np.isfinite(time):
        return None
    return time, nodes[np.arange(len(nodes)), chosen]


@njit(cache=True)
def _lattice(nodes, u, v, clear, limits, tide, tidal_moment, step, things):
    """Chosen node of each of N stations, [N], and the travel time, s; infinite where no way is found."""
    speed, surge_max, sway_max = limits
    stations, count = clear.shape
    times = np.full((stations, count), np.inf)
    before = np.zeros((stations, count), np.int64)
    middle = count // 2
    times[0, middle] = 0.0
    for n in range(1, stations):
        for k in range(count):
            if clear[n, k] < 0.0 or (n == stations - 1 and k != middle):
                continue
            for j in range(count):
                begin = times[n - 1, j]
                if begin >= times[n, k]:
                    continue
                way_x = nodes[n, k, 0] - nodes[n - 1, j, 0]
                way_y = nodes[n, k, 1] - nodes[n - 1, j, 1]
                length = np.sqrt(way_x * way_x + way_y * way_y)
                if length == 0.0:
                    continue
                strength = 0.5 * tabulated(tide, tidal_moment, begin + 0.5 * length / speed)
                cu = strength * (u[n - 1, j] + u[n, k])
                cv = strength * (v[n - 1, j] + v[n, k])
                along = (cu * way_x + cv * way_y) / length
                across = abs(cu * way_y - cv * way_x) / length
                if across > sway_max:
                    continue
                ground = along + np.sqrt(speed * speed - across * across)
                if ground <= SPEED_FLOOR * speed or ground > surge_max:
                    continue
                lasts = length / ground
                if begin + lasts >= times[n, k]:
                    continue
                both = clear[n - 1, j] + clear[n, k]
                x0, y0, x1, y1 = nodes[n - 1, j, 0], nodes[n - 1, j, 1], nodes[n, k, 0], nodes[n, k, 1]
                if not strikes(x0, y0, x1, y1, both, begin, lasts, step, things):
                    times[n, k] = begin + lasts
                    before[n, k] = j
    chosen = np.zeros(stations, np.int64)
    chosen[-1] = middle
    for n in range(stations - 1, 0, -1):
        chosen[n - 1] = before[n, chosen[n]]
    return chosen, times[-1, middle]
