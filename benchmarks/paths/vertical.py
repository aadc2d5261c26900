"""The quickest path in the vertical plane through start and goal: a search apart from those on grids.

It counts where nothing leads a path out of that plane. Dynamic programming over distance and depth alone
shares no code with the other searches.
"""

import numpy as np
from numba import njit

from auvplan.ocean.currents import is_steady
from benchmarks.paths.grid import levels_through, limits_of
from benchmarks.paths.polish import Polished
from benchmarks.paths.problems import PathProblem
from benchmarks.paths.ruler import World, evaluate, velocity_at
from benchmarks.paths.waters import TidalCurrent, without_tide

#: Stations of the vertical plane between start and goal, those beyond either, and levels.
_STATIONS, _BEYOND, _LEVELS = 240, 6, 161

#: Stations that a move passes, and its slope at most, but for upright ones.
_PASSED, _STEEPEST = np.array([1, 2, 3, 5, 8]), 6.0

#: Share of the vehicle's speed, and of the leg, by which a plane may differ beside it and still be one.
_ALIKE = 1e-3


def vertical(problem: PathProblem, world: World) -> Polished | None:
    """Find the quickest path in the vertical plane through start and goal; None where paths may leave it."""
    start, goal = np.asarray(problem.start), np.asarray(problem.goal)
    length = float(np.linalg.norm((goal - start)[:2]))
    along = (goal - start)[:2] / length
    right = np.array([-along[1], along[0]])
    tidal = problem.environment.current
    factor = tidal.factor if isinstance(tidal, TidalCurrent) else np.ones_like
    current = without_tide(tidal)
    if not is_steady(current) or len(world.spheres):
        return None
    arc = length / _STATIONS * np.arange(-_BEYOND, _STATIONS + _BEYOND + 1)
    speed, _, _, upright_max = limits_of(problem)
    a, z = np.meshgrid(arc, np.linspace(world.low[2], world.high[2], _LEVELS), indexing="ij")
    tables, beds = [], []
    for beside in (0.0, -0.05 * length, 0.05 * length):
        x, y = (start[k] + arc * along[k] + beside * right[k] for k in range(2))
        beds.append(world.bed.at(x, y))
        x, y = (start[k] + a.ravel() * along[k] + beside * right[k] for k in range(2))
        u, v, w = velocity_at(current, x, y, z.ravel(), np.full(x.size, problem.depart))
        if max(np.abs(u * right[0] + v * right[1]).max(), np.abs(w).max()) > _ALIKE * speed:
            return None
        tables.append((u * along[0] + v * along[1]).reshape(a.shape))
    apart = max(np.abs(table - tables[0]).max() for table in tables)
    uneven = max(np.abs(bed - beds[0]).max() for bed in beds)
    if apart > _ALIKE * speed or uneven > 0.1:
        return None
    moments = np.linspace(0.0, 30.0 * length / speed, 6001)
    levels, (last, first) = levels_through(world, _LEVELS, (goal[2], start[2]))
    both = (_BEYOND, first), (_BEYOND + _STATIONS, last)
    rounds = 2 if np.isinf(upright_max) else 1
    time_found, before = _plane(
        arc, levels, tables[0], beds[0], factor(problem.depart + moments), moments[1], speed, upright_max,
        both, _PASSED, _STEEPEST, rounds,
    )  # fmt: skip
    if not np.isfinite(time_found):
        return None
    chain = [both[1][0] * _LEVELS + both[1][1]]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    nodes = np.array(chain[::-1])
    i, k = nodes // _LEVELS, nodes % _LEVELS
    points = np.column_stack([start[:2] + np.outer(arc[i], along), levels[k]])
    points[0], points[-1] = start, goal
    return Polished(points, evaluate(problem, points, world))


@njit(cache=True)
def _plane(arc, levels, ahead, bed, tide, moment, speed, upright_max, ends, passed, steepest, rounds):
    """Time of the quickest way from station to station [s], infinite without any, and the node before each.

    Stations are taken in their order, and where a dive may be steeper than upright in the opposite one too.
    """
    stations, count = len(arc), len(levels)
    times = np.full((stations, count), np.inf)
    before = np.full(stations * count, -1)
    (first, shallow), (last, deep) = ends
    times[first, shallow] = 0.0
    sea = ahead, bed, tide, moment, speed, upright_max
    fastest = speed + np.abs(ahead).max() * np.abs(tide).max()
    for turn in range(2 * rounds - 1):
        for order in range(stations):
            i = order if turn % 2 == 0 else stations - 1 - order
            for passing in range(len(passed) if turn % 2 == 0 else 2):
                h = i - passed[passing] if turn % 2 == 0 else i + passed[passing]
                if h < 0 or h >= stations:
                    continue
                level = abs(arc[i] - arc[h])
                for k in range(count):
                    if levels[k] > bed[i]:
                        continue
                    for j in range(count):
                        down = levels[k] - levels[j]
                        if abs(down) > steepest * level or (turn % 2 == 1 and abs(down) < level):
                            continue
                        least = times[h, j] + np.sqrt(level * level + down * down) / fastest
                        if least >= times[i, k]:
                            continue
                        now = _passed(h, j, i, k, times[h, j], arc, levels, sea)
                        if now < times[i, k]:
                            times[i, k] = now
                            before[i * count + k] = h * count + j
            # Upright, level by level: down, then up.
            for step in range(2 * count - 2):
                j = step if step < count - 1 else 2 * count - 2 - step
                k = j + 1 if step < count - 1 else j - 1
                if times[i, j] < times[i, k] and levels[k] <= bed[i]:
                    now = _passed(i, j, i, k, times[i, j], arc, levels, sea)
                    if now < times[i, k]:
                        times[i, k] = now
                        before[i * count + k] = i * count + j
    return times[last, deep], before


@njit(cache=True)
def _passed(h, j, i, k, begin, arc, levels, sea):
    """s of arrival at station i and level k of a straight move from h and j; infinite if impossible."""
    ahead, bed, tide, moment, speed, upright_max = sea
    level, down = arc[i] - arc[h], levels[k] - levels[j]
    length = np.sqrt(level * level + down * down)
    cos, sin = level / length, down / length
    parts = max(2, abs(i - h))
    if abs(k - j) > 4:
        parts = max(parts, 6)
    now = begin
    for part in range(parts):
        share = (part + 0.5) / parts
        x, z = h + share * (i - h), j + share * (k - j)
        x0, z0 = min(int(x), len(arc) - 2), min(int(z), len(levels) - 2)
        p, q = x - x0, z - z0
        if levels[j] + share * down > (1.0 - p) * bed[x0] + p * bed[x0 + 1]:
            return np.inf
        c = (1.0 - p) * ((1.0 - q) * ahead[x0, z0] + q * ahead[x0, z0 + 1])
        c += p * ((1.0 - q) * ahead[x0 + 1, z0] + q * ahead[x0 + 1, z0 + 1])
        c *= tide[min(int(now / moment), len(tide) - 1)]
        ground = c * cos + np.sqrt(speed * speed - c * c * sin * sin)
        if ground <= 0.0 or abs(ground * sin) > upright_max:
            return np.inf
        now += length / parts / ground
    return now
