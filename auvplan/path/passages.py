"""Distinct passages between two points: time-to-reach fields and the best paths through each passage.

One field holds, for every cell of a grid, the least travel time from the start, another one that to the
goal; their sum is the time of the best path through each cell. Between two passages the sum has a hill: an
island, an obstacle, a head current. The best path through a cell passes every hill on one side or the other,
and these sides distinguish passages. Paths traced through the best cell of each passage let the
search begin in every passage that there is, which neither random detours nor gradients find by themselves.

Two grids are used. A coarse one over the surroundings shows which part of them the good paths cross, and when
they come by; a finer one over that part finds the passages.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.navigation import Navigation
from auvplan.ocean.environment import Environment
from auvplan.path.clearance import distance_to_land, obstacle_clearance
from auvplan.path.config import PathConfig
from auvplan.path.cost import ALTITUDE_SCALE
from auvplan.path.habitats import deepest, fitted, raise_above_seabed, spirals, straight_line
from auvplan.path.kinematics import Axes
from auvplan.path.problem import Problem
from auvplan.path.profile import (
    STATIONS,
    depths_within_reach,
    levels,
    profiles,
    transit_depths,
    transit_slope,
)
from auvplan.vehicle import Vehicle, along_track

#: Moves towards a greater first index that are no steeper than a diagonal, in cells; with their opposites and
#: those with both indices exchanged, moves in 32 directions.
MOVES = ((1, 0), (1, 1), (1, -1), (2, 1), (2, -1), (3, 1), (3, -1), (3, 2), (3, -2))
_REACH = 3

#: Places along each side at which a cell is probed; it stands for the clearest of them.
_PROBES = 3

#: Shares of a move at which it is probed.
_ON_THE_WAY = (0.25, 0.5, 0.75)

#: A place with as much clearance, in cells, is clear enough to stand for its cell.
_ROOM = 0.75

#: A move that breaks a limit costs this many times its own time for each unit of excess.
_PENALTY_WEIGHT = 30.0

#: Surcharge of a move that comes too near to something, in times of the straight line: even a thin wall is
#: passed round as long as that is possible.
_TOLL = 10.0

#: Excess of a move at most; one over a bed too shallow to be crossed has half of that at least.
_MOST, _SHALLOW = 3.0, 1.5

#: Excess up to which a move counts as one that breaks no limit: rounding to cells alone may cause as much.
_SLIGHT = 0.1

#: Distances that the surroundings reach beyond start and goal, and that the finer grid reaches at least.
SURROUNDINGS, _BESIDE = 2.0, 0.1

#: Paths that take longer than the best one by this share do not matter to where the finer grid lies.
_SLOWER = 0.25

#: Share of the finer grid's cells to each side that the coarse grid has.
_COARSE = 0.375

#: Aspect ratio of a grid at most.
_ASPECT = 2.0

#: Depths at which the coarse grid is laid out where the current changes with depth.
_LAYERS = 6

#: Paths that wind, in place of the last passages, where start and goal are too steep for the vehicle.
_WINDING = 4

#: Factor for the moves between depths on times of paths at depths of their own.
_TO_DEPTH = 1.03

#: Rounds of sweeps at most; each follows a path around one more bend.
_ROUNDS = 40

#: Times that differ by less than this share do not matter to a field.
_SETTLED = 1e-5

#: Hills that distinguish passages, at most; cells around within which each is the highest; and by what
#: share it must exceed the lowest of these and the best time.
_HILLS, _AROUND, _HEIGHT = 32, 3, 1e-3


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Traced:
    """Paths through passages as polylines on a grid, quickest first.

    Attributes:
        x, y: [count, L] m.
        room: [count, L] m, clearance beyond the margins.
        times: [count] s, with the deterrents of broken limits; infinite where there are fewer passages.
        broken: [count], the most that is on the way of `_Grid.broken`.
    """

    x: jax.Array
    y: jax.Array
    room: jax.Array
    times: jax.Array
    broken: jax.Array


def trace_passages(
    problem: Problem, count: int, config: PathConfig, deep: bool = False
) -> tuple[jax.Array, ...]:
    """Trace the best paths through `count` passages, as habitats.

    Args:
        problem: the leg. A bank of the sea bed is crossed where the top of the box leaves room above it.
        count: of paths.
        config: static settings; `field_cells` sets the grid.
        deep: whether paths take the depths at which they are quickest (`profiles`), not the straight line's.

    Returns:
        ``(habitats [count, 3 n] m, fine [count, 3 m] m, times [count] s, closed [] m, known [] s)``, quickest
        first. `fine` are the same paths with the control points of `config.fine()`. Times of broken limits
        hold a deterrent; where there are fewer passages the last ones repeat, with infinite times. `closed`
        is the size of the cells where no path between them keeps clear of coast and obstacles, zero where one
        does; `known` the time of the quickest path, tolls included, if it breaks no limit, else infinite.
    """
    (start, goal), env, vehicle = problem.ends, problem.env, problem.vehicle
    ends = jnp.stack([start, goal])
    distance = jnp.sqrt(((goal - start) ** 2).sum())
    inner = ends[:, :2].min(axis=0), ends[:, :2].max(axis=0)
    box = env.lower[:2], env.upper[:2]
    around = [
        corner + sign * SURROUNDINGS * distance for corner, sign in zip(inner, (-1.0, 1.0), strict=True)
    ]
    low, high = _proportioned(jnp.maximum(around[0], box[0]), jnp.minimum(around[1], box[1]))
    cells = config.field_cells
    build = partial(_Grid.of, problem=problem, config=config)

    count_coarse = max(round(_COARSE * cells), 8)
    if deep:
        coarse, ahead, total, depth = _layered(low, high, count_coarse, build, problem)
    else:
        coarse, depth = build(low, high, count_coarse, _straight_times), None
        ahead, back = coarse.fields()
        total = ahead + back
    matters = total <= (1.0 + _SLOWER) * total[coarse.source]
    part = coarse.bounds_of(matters)
    least = [corner + sign * _BESIDE * distance for corner, sign in zip(inner, (-1.0, 1.0), strict=True)]
    low = jnp.maximum(jnp.minimum(part[0], least[0]), low)
    high = jnp.minimum(jnp.maximum(part[1], least[1]), high)
    low, high = _proportioned(low, high)

    def finely(depth: jax.Array | None) -> tuple[_Traced, jax.Array]:
        arrivals = partial(_known_times, coarse=coarse, ahead=ahead, total=total, depth=depth)
        fine = build(low, high, cells, arrivals)
        return fine.traced(count - count // 2 if deep else count), fine.spacing.max()

    if depth is None:
        found, spacing = finely(None)
        parts = [(found, None)]
    else:
        # Half of the passages at the best paths' depths, half at the straight line's: few control points
        # do not follow every profile, nor does every profile keep the limits.
        share = jnp.where(jnp.isfinite(total), ahead / jnp.maximum(total, 1e-20), 0.5)
        straight = start[2] + share * (goal[2] - start[2])
        both, spacing = jax.lax.map(finely, jnp.stack([depth, straight]))
        spacing = spacing[0]
        own, level = (jax.tree.map(lambda plane, k=k: plane[k], both) for k in (0, 1))
        depths = profiles(*_evenly(own.x, own.y), problem, config)
        parts = [(own, depths), (jax.tree.map(lambda plane: plane[: count // 2], level), None)]
    closed = jnp.where(reduce(jnp.logical_and, ((p.broken == 2.0).all() for p, _ in parts)), spacing, 0.0)
    # What moves between depths take is not in the times of those at depths of their own.
    quickest = []
    for p, depths in parts:
        time = p.times[0] * (1.0 if depths is None else _TO_DEPTH)
        if vehicle.depth_toll is not None:
            rises = jnp.diff(ends[:, 2] if depths is None else depths[0])
            time = time + vehicle.depth_toll * jnp.abs(rises).sum()
        quickest.append(jnp.where(p.broken[0] == 0.0, time, jnp.inf))
    known = reduce(jnp.minimum, quickest)
    times, habitats = jnp.concatenate([p.times for p, _ in parts]), []
    for settings in (config, config.fine()):
        rows = jnp.concatenate([_fitted(p, depths, start, goal, settings) for p, depths in parts])
        rows = raise_above_seabed(rows, problem, settings)
        if vehicle.vertical_limits and (others := min(_WINDING, count // 2)):
            winding, lasts, needed = spirals(others, problem, settings, _most_open(problem, config))
            rows = rows.at[-others:].set(jnp.where(needed, winding, rows[-others:]))
            times = times.at[-others:].set(jnp.where(needed, lasts, times[-others:]))
            known = jnp.where(needed, jnp.inf, known)  # the fields know of no slope
        habitats.append(rows)
    return *habitats, times, closed, known


def _most_open(problem: Problem, config: PathConfig) -> jax.Array:
    """Return the direction [2], of eight from east on, in which a circle at the start has most room."""
    radius = problem.vehicle.speed / problem.vehicle.turn_rate_max
    angle = 0.25 * np.pi * jnp.arange(8)
    directions = jnp.stack([jnp.sin(angle), jnp.cos(angle)])
    x, y = problem.start[:2, None] + radius * directions
    places, when = (x, y, jnp.full_like(x, problem.start[2])), jnp.full_like(x, problem.depart)
    known = _known(places, when, problem)
    room = _clearance(places, when, jnp.zeros(()), problem.env, config, known)
    return directions[:, jnp.argmax(jnp.minimum(room, 2.0 * radius))]


def _proportioned(low: jax.Array, high: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Corners [2] m of the rectangle, its shorter side lengthened to the aspect that grids may have."""
    sides = high - low
    more = jnp.maximum(sides.max() / _ASPECT - sides, 0.0)
    return low - 0.5 * more, high + 0.5 * more


def _apart(x: jax.Array, y: jax.Array, problem: Problem) -> list[jax.Array]:
    """Return level distances, m, from the start and to the goal."""
    return [jnp.sqrt((x - end[0]) ** 2 + (y - end[1]) ** 2) for end in problem.ends]


def _straight_times(x: jax.Array, y: jax.Array, problem: Problem) -> tuple[jax.Array, jax.Array]:
    """Time of arrival at each place, s, and depth there, m, as on straight lines."""
    (start, goal), (from_start, to_goal) = problem.ends, _apart(x, y, problem)
    share = from_start / jnp.maximum(from_start + to_goal, 1e-20)
    return problem.depart + from_start / problem.vehicle.speed, start[2] + share * (goal[2] - start[2])


def _known_times(
    x: jax.Array,
    y: jax.Array,
    problem: Problem,
    coarse: "_Grid",
    ahead: jax.Array,
    total: jax.Array,
    depth: jax.Array | None,
) -> tuple[jax.Array, jax.Array]:
    """As `_straight_times`, by the fields of a coarse grid; `depth` [N, N] m is that of the best paths."""
    taken = coarse.looked_up(ahead, x, y)
    if depth is None:
        share = taken / jnp.maximum(coarse.looked_up(total, x, y), 1e-20)
        z = problem.start[2] + share * (problem.goal[2] - problem.start[2])
    else:
        z = coarse.looked_up(depth, x, y)
    usual = _straight_times(x, y, problem)
    known = jnp.isfinite(taken)
    return jnp.where(known, problem.depart + taken, usual[0]), jnp.where(known, z, usual[1])


@dataclass(frozen=True)
class _Grid:
    """A grid of cells, each of which stands for its clearest place, and the times of moves between them.

    Attributes:
        low: [2] m, corner of the first cell.
        spacing: [2] m, sides of a cell.
        x, y: [N, N] m, places.
        clear: [N, N] m, their clearance beyond the margins; negative where too near to something.
        times: for moves along the first and along the second index, [2, N, 9, 2, N] s: time of each of
            `MOVES` that ends in a cell, and of its opposite; by the index that moves advance along first.
        broken: the same, [2, N, 9, N], 2 where a move comes too near to something, 1 where the current across
            it breaks a limit, else 0.
        source, sink: cells of start and goal.
    """

    low: jax.Array
    spacing: jax.Array
    x: jax.Array
    y: jax.Array
    clear: jax.Array
    times: jax.Array
    broken: jax.Array
    source: tuple[jax.Array, jax.Array]
    sink: tuple[jax.Array, jax.Array]

    @classmethod
    def of(
        cls,
        low: jax.Array,
        high: jax.Array,
        cells: int,
        arrivals: Callable[..., tuple[jax.Array, jax.Array]],
        problem: Problem,
        config: PathConfig,
    ) -> "_Grid":
        """Return the grid of [cells, cells] between two corners; `arrivals` as `_straight_times`."""
        ends, env, vehicle = problem.ends, problem.env, problem.vehicle
        spacing = (high - low) / cells
        probes = (jnp.arange(_PROBES * cells) + 0.5) / _PROBES
        lattice = jnp.meshgrid(low[0] + spacing[0] * probes, low[1] + spacing[1] * probes, indexing="ij")
        when, z = arrivals(*lattice, problem)
        if vehicle.has_transit:  # it dives and climbs along straight lines
            gap = jnp.full_like(lattice[0], 2.0 * spacing.max())
            slope = transit_slope(vehicle)
            z = transit_depths(lattice[0], lattice[1], gap, env, vehicle)
            for away, end in zip(_apart(lattice[0], lattice[1], problem), ends, strict=True):
                z = jnp.clip(z, end[2] - slope * away, end[2] + slope * away)
        places = lattice[0], lattice[1], z
        room = _clearance(places, when, 1e-3 * spacing.min(), env, config, _known(places, when, problem))
        chosen = _clearest(room, _ROOM * spacing.min())
        x, y, z, when, clear = (chosen(plane) for plane in (*lattice, z, when, room))
        source, sink = (
            tuple(jnp.clip(((end[:2] - low) / spacing).astype(jnp.int32), 0, cells - 1)) for end in ends
        )
        for end, cell in zip(ends, (source, sink), strict=True):
            x, y, z = (plane.at[cell].set(place) for plane, place in zip((x, y, z), end, strict=True))
        shallow = _too_shallow(x, y, spacing.max(), env)
        if env.seabed is not None:
            z = jnp.minimum(z, deepest(env, x, y, 2.0 * spacing.max()))
        u, v, _ = env.current(x, y, z, when)
        risk = jnp.zeros_like(x) if env.chart is None else 1.0 - env.chart.passability_at(x, y)
        price = config.uncertain_price * risk
        if env.price is not None:
            price = price + jnp.maximum(env.price(x, y, z, when), 0.0)
        open_water = env.chart is None and len(env.obstacles) == 0 and not env.closures
        toll = _TOLL * jnp.sqrt(((ends[1] - ends[0]) ** 2).sum()) / vehicle.speed
        rest = clear, price, *(() if shallow is None else (shallow,))
        timed = partial(_move_times, toll=toll, vehicle=vehicle, config=config)
        # Moves along the second index are those along the first one of a grid that is turned over.
        upright = ((x, y, u, v, *rest), None if open_water else room, low, spacing)
        over = ((y, x, v, u, *rest), upright[1], low[::-1], spacing[::-1])
        over = jax.tree.map(lambda leaf: leaf.T, over)
        both = jax.tree.map(lambda *two: jnp.stack(two), upright, over)
        times, broken = jax.lax.map(lambda one: timed(*one), both)
        return cls(low, spacing, x, y, clear, times, broken, source, sink)

    def looked_up(self, plane: jax.Array, x: jax.Array, y: jax.Array) -> jax.Array:
        """Look up a plane [N, N] at a lattice [A, B] m, with x by the first index and y by the second."""
        cells = plane.shape[0]
        weights = []
        for axis, line in enumerate((x[:, 0], y[0])):
            place = jnp.clip((line - self.low[axis]) / self.spacing[axis] - 0.5, 0.0, cells - 1.0)
            weights.append(jnp.maximum(1.0 - jnp.abs(place[:, None] - jnp.arange(cells)), 0.0))
        return weights[0] @ plane @ weights[1].T

    def bounds_of(self, chosen: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Corners [2] m of the smallest rectangle that holds the chosen cells [N, N] and their neighbours."""
        lows, highs = [], []
        for axis in range(2):
            any_in = chosen.any(axis=1 - axis)
            first = jnp.argmax(any_in)
            last = len(any_in) - jnp.argmax(any_in[::-1])
            lows.append(self.low[axis] + self.spacing[axis] * (first - 1.0))
            highs.append(self.low[axis] + self.spacing[axis] * (last + 1.0))
        return jnp.stack(lows), jnp.stack(highs)

    def fields(self) -> tuple[jax.Array, jax.Array]:
        """Least times [N, N] s from the start to every cell, and from every cell to the goal."""
        return _fields(self.times, self.source, self.sink)

    def traced(self, count: int) -> _Traced:
        """Return the best paths through `count` passages."""
        fields = self.fields()
        total = fields[0] + fields[1]
        nearer, broken = self.previous(jnp.stack(fields))
        sides = _sides(total, total[self.source], nearer)
        chosen, times = _firsts(total, sides, count)
        walks = jax.lax.map(lambda towards: _walk(chosen, towards, 3 * total.shape[0]), nearer)
        route = jnp.concatenate([walks[0, ::-1], walks[1, 1:]]).T
        most = jnp.maximum(broken[0][walks[0]].max(axis=0), broken[1][walks[1]].max(axis=0))
        x, y, clear = (plane.reshape(-1)[route] for plane in (self.x, self.y, self.clear))
        return _Traced(x, y, clear, times, most)

    def previous(self, fields: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Return the cell next to each on the best way to the start and to the goal.

        These are flat indices, [2, N * N]; start and goal are next to themselves. With them comes what of
        `broken` the moves have.

        Args:
            fields: [2, N, N] s, from the start and to the goal.
        """
        cells = fields.shape[1]
        # Moves along both indices in one row: steps [18, 2], times [18, 2, N, N] and what they break.
        upright = np.array(MOVES)
        moves = np.concatenate([upright, upright[:, ::-1]])
        times = jnp.concatenate([self.times[0].transpose(1, 2, 0, 3), self.times[1].transpose(1, 2, 3, 0)])
        stops = jnp.concatenate([self.broken[0].swapaxes(0, 1), self.broken[1].transpose(1, 2, 0)])
        steps = jnp.asarray(moves @ (cells, 1), jnp.int32)

        def towards(lane: tuple[jax.Array, ...]) -> tuple[jax.Array, jax.Array]:
            field, own, end = lane

            def closer(carry: tuple, move: tuple) -> tuple[tuple, None]:
                (a, b), pair, stop, step = move
                forth, opposite = pair[own], pair[1 - own]
                ways = jax.lax.optimization_barrier(
                    (
                        (_shifted(field, a, b, jnp.inf) + forth, stop, step),
                        (_shifted(field + opposite, -a, -b, jnp.inf), _shifted(stop, -a, -b, 0.0), -step),
                    )
                )
                best, back, broken = carry
                for time, stopped, way in ways:
                    better = time < best
                    best = jnp.where(better, time, best)
                    back, broken = jnp.where(better, way, back), jnp.where(better, stopped, broken)
                return (best, back, broken), None

            carry = jnp.full_like(field, jnp.inf), jnp.zeros(field.shape, jnp.int32), jnp.zeros_like(field)
            _, back, broken = jax.lax.scan(closer, carry, (jnp.asarray(moves), times, stops, steps))[0]
            back, broken = back.reshape(-1).at[end].set(0), broken.reshape(-1).at[end].set(0.0)
            return jnp.arange(field.size) - back, broken

        ends = jnp.stack([row * cells + column for row, column in (self.source, self.sink)])
        return jax.lax.map(towards, (fields, jnp.arange(2), ends))


def _fields(
    times: jax.Array,
    source: tuple[jax.Array, ...],
    sink: tuple[jax.Array, ...],
    shift: jax.Array | None = None,
    entry: jax.Array | None = None,
) -> tuple[jax.Array, jax.Array]:
    """Least times [N, N] s from the start to every cell, and from every cell to the goal.

    Sweeps to and fro along both indices: one sweep follows every path as far as it advances along its index
    (fast sweeping, Zhao 2005, with moves in place of an upwind scheme).

    Args:
        times: of moves, as `_Grid.times` has them; with a leading axis L for grids one below the other.
        source, sink: cells of start and goal.
        shift: [L, L] s, from grid to grid within a cell; None for a single grid.
        entry: [2, L] s, from the start to each grid and from each to the goal; None for nothing.

    Returns:
        Fields [N, N] s, or [L, N, N] s.
    """
    layers, cells = (() if shift is None else shift.shape[:1]), times.shape[-1]
    fields = jnp.full((*layers, 2, cells, cells), jnp.inf, times.dtype)
    first, last = (0.0, 0.0) if entry is None else entry
    fields = fields.at[..., 0, *source].set(first).at[..., 1, *sink].set(last)

    def along(fields: jax.Array, times: jax.Array) -> tuple[jax.Array, None]:
        """Sweep along the first index, and turn the grid over."""
        return _swept(fields, times).transpose(2, 1, 0), None

    def swept(fields: jax.Array, times: jax.Array) -> jax.Array:
        return jax.lax.scan(along, fields.swapaxes(0, 1), times)[0].swapaxes(0, 1)

    def round_(carry: tuple[jax.Array, jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array, jax.Array]:
        fields, _, count = carry
        if shift is None:
            new = swept(fields, times)
        else:
            new = jax.vmap(swept)(fields, times)
            new = reduce(jnp.minimum, (new[k] + shift[k][:, None, None, None] for k in range(len(shift))))
        changed = new < fields * (1.0 - _SETTLED)
        # Cells that are farther from an end than the other end is lie on no path that matters.
        best = jnp.minimum(new[..., 0, *sink], new[..., 1, *source]).min() * (1.0 + _SLOWER)
        return new, (changed & (new <= best)).any() | ~jnp.isfinite(best), count + 1

    carry = fields, jnp.array(True), jnp.array(0)
    fields = jax.lax.while_loop(lambda c: c[1] & (c[2] < _ROUNDS), round_, carry)[0]
    return fields[..., 0, :, :], fields[..., 1, :, :]


def _layered(
    low: jax.Array,
    high: jax.Array,
    cells: int,
    build: Callable[..., "_Grid"],
    problem: Problem,
) -> tuple["_Grid", jax.Array, jax.Array, jax.Array]:
    """Return a grid, and of the best ways over it at `_LAYERS` depths what they take, [N, N].

    That is the time from the start, s, the time of the best way through each cell, s, and its depth there, m.
    """
    ends, env, vehicle = jnp.stack(problem.ends), problem.env, problem.vehicle
    share = jnp.linspace(0.0, 1.0, 5)
    x, y = jnp.meshgrid(*(low[axis] + (high[axis] - low[axis]) * share for axis in (0, 1)))
    line = ends[0] + share[:, None] * (ends[1] - ends[0])
    x, y = jnp.concatenate([x.ravel(), line[:, 0]]), jnp.concatenate([y.ravel(), line[:, 1]])
    top, bottom = depths_within_reach(ends, env)
    if env.seabed is not None:
        bottom = jnp.minimum(bottom, deepest(env, x, y, jnp.zeros_like(x)).max())
    when = _straight_times(x, y, problem)[0]
    bottom = jnp.maximum(bottom, ends[:, 2].max())
    depth = levels((x, y, when), top, bottom, _LAYERS, env.current)

    def at(depth: jax.Array) -> tuple[jax.Array, tuple]:
        grid = build(low, high, cells, lambda *at: (_straight_times(*at)[0], jnp.full_like(at[0], depth)))
        return grid.times, (grid.spacing, grid.source, grid.sink)

    times, (spacing, source, sink) = jax.lax.map(at, depth)
    spacing, source, sink = jax.tree.map(lambda leaf: leaf[0], (spacing, source, sink))
    steep = jnp.pi / 4.0 if vehicle.pitch_max is None else vehicle.pitch_max
    shift = jnp.abs(depth[:, None] - depth) * jnp.tan(0.5 * steep) / vehicle.speed
    entry = None
    if vehicle.depth_toll is not None:
        shift = shift + vehicle.depth_toll * jnp.abs(depth[:, None] - depth)
        entry = jnp.asarray(vehicle.depth_toll) * jnp.abs(depth - ends[:, 2:])
    ahead, back = _fields(times, source, sink, shift, entry)
    best = jnp.argmin(ahead + back, axis=0)
    ahead, total = (jnp.take_along_axis(field, best[None], axis=0)[0] for field in (ahead, ahead + back))
    # The fine grid asks it for nothing but where its cells lie.
    nothing = jnp.zeros_like(ahead)
    grid = _Grid(low, spacing, nothing, nothing, nothing, times, times, source, sink)
    return grid, ahead, total, depth[best]


def _clearance(
    places: Axes,
    when: jax.Array,
    slack: jax.Array,
    env: Environment,
    config: PathConfig,
    known: Navigation | None,
) -> jax.Array:
    """Find the clearance beyond the margins, [A, B] m; negative where something to keep clear of is too near.

    Args:
        places: x, y, z, [A, B] m.
        when: [A, B] s since the epoch.
        slack: m, by which places may lie outside the box.
        env: the world, obstacles resolved.
        config: static settings.
        known: how well the vehicle knows where it is there, or None.
    """
    x, y, z = places
    coast_margin, obstacle_margin = (
        margin if known is None else margin + known.allowance
        for margin in (config.coast_margin, config.obstacle_margin)
    )
    inside = [x - env.lower[0], env.upper[0] - x, y - env.lower[1], env.upper[1] - y]
    clear = reduce(jnp.minimum, inside) + slack
    if env.chart is not None:
        clear = jnp.minimum(clear, distance_to_land(env.chart, x, y) - coast_margin)
    for closure in env.closures:
        away = distance_to_land(closure.chart, x, y) - coast_margin
        clear = jnp.minimum(clear, jnp.where(closure.closed(when, when), away, clear))
    if len(env.obstacles):
        still = jnp.zeros_like(x)  # a point is a segment of no length
        near = obstacle_clearance(((x, y, z), (still, still, still), when, still), env)
        clear = jnp.minimum(clear, near - obstacle_margin)
    return clear


def _known(places: Axes, when: jax.Array, problem: Problem) -> Navigation | None:
    """Return about how well the vehicle knows where it is at places [A, B] m, when it comes by; or None.

    It is taken to have been in bottom lock on all of its way, or none, as it is there.
    """
    env, vehicle = problem.env, problem.vehicle
    if vehicle.navigation is None:
        return None
    passed = unlocked = jnp.maximum(when - problem.depart, 0.0)
    if vehicle.navigation.bottom_lock is not None and env.seabed is not None:
        above = env.seabed.depth_at(places[0], places[1]) - places[2]
        unlocked = jnp.where(above <= vehicle.navigation.bottom_lock, 0.0, passed)
    return vehicle.navigation.after(vehicle.speed * passed, unlocked)


def _clearest(room: jax.Array, enough: jax.Array) -> Callable[[jax.Array], jax.Array]:
    """Return what picks, from planes of probes [3 N, 3 N], the clearest place of every cell, [N, N].

    The middle of a cell is taken where it is clear enough.
    """

    def probes(plane: jax.Array) -> jax.Array:
        cells = plane.shape[0] // _PROBES
        return plane.reshape(cells, _PROBES, cells, _PROBES).transpose(1, 3, 0, 2).reshape(-1, cells, cells)

    middle = _PROBES * _PROBES // 2
    found = jnp.minimum(probes(room), enough)
    best = found.max(axis=0)
    chosen = jnp.where(found[middle] >= best, middle, jnp.argmax(found, axis=0))

    def pick(plane: jax.Array) -> jax.Array:
        parts = probes(plane)
        return reduce(lambda a, k: jnp.where(chosen == k, parts[k], a), range(1, len(parts)), parts[0])

    return pick


def _move_times(
    planes: Sequence[jax.Array],
    room: jax.Array | None,
    low: jax.Array,
    spacing: jax.Array,
    toll: jax.Array,
    vehicle: Vehicle,
    config: PathConfig,
) -> tuple[jax.Array, jax.Array]:
    """Times [N, 9, 2, N] s of `MOVES` that end in each cell and of their opposites, and `_Grid.broken`.

    Args:
        planes: [N, N]: places along both indices, m, currents along both, m/s, clearance, m, price, and, over
            a sea bed, excess where it is too shallow.
        room: [3 N, 3 N] m, clearance at the probes; None where there is nothing to keep clear of but the box.
        low, spacing: [2] m, of the grid.
        toll: s, for a move that comes too near to something.
        vehicle: speed and limits.
        config: static settings.
    """
    x, y, u, v, clear, price, *shallow = planes
    cell = spacing.min()

    padded = [jnp.pad(plane, _REACH) for plane in (jnp.ones_like(x), *planes)]

    def began(a: jax.Array, b: jax.Array) -> list[jax.Array]:
        """Return the planes where the move (a, b) that ends in each cell began; zeros off the grid."""
        parts = [jax.lax.dynamic_slice(plane, (_REACH - a, _REACH - b), x.shape) for plane in padded]
        # What the compiler does not store it recomputes for every expression that uses it.
        return jax.lax.optimization_barrier(parts)

    def timed(_: Any, move: tuple[jax.Array, jax.Array, jax.Array]) -> tuple[Any, tuple]:
        a, b, passed_by = move
        inside, x0, y0, u0, v0, clear0, price0, *_ = began(a, b)
        dx, dy = x - x0, y - y0
        length = jnp.sqrt(dx * dx + dy * dy + (1e-3 * cell) ** 2)
        # Mean of both ends of the move.
        u_mean, v_mean = 0.5 * (u + u0), 0.5 * (v + v0)
        with_track = (u_mean * dx + v_mean * dy) / length
        over_track = jnp.abs(u_mean * dy - v_mean * dx) / length
        passed = [clear0, clear]
        if room is not None:
            probed = [_probed(room, x0 + s * dx, y0 + s * dy, low, spacing) for s in _ON_THE_WAY]
            passed = [clear0, *jax.lax.optimization_barrier(probed), clear]
        lowest = reduce(jnp.minimum, passed)
        # A long move may cut a corner: distances are 1-Lipschitz.
        part = length / (len(passed) - 1)
        between = [0.5 * (p + q - part) for p, q in pairwise(passed)]
        is_long = jnp.abs(a) + jnp.abs(b) > 2
        lowest = jnp.where(is_long, reduce(jnp.minimum, between, lowest), lowest)
        excess = jnp.clip(-lowest / cell, 0.0, _MOST) + jnp.maximum(over_track / vehicle.sway_max - 1.0, 0.0)
        for plane in shallow:
            crossed = [began(*back)[-1] for back in passed_by]
            excess = excess + reduce(jnp.maximum, crossed, plane)
        pair, over = [], over_track / vehicle.sway_max - 1.0
        blocked = lowest < -_SLIGHT * cell
        fee = jnp.where(blocked, toll, 0.0)
        for sign in (1.0, -1.0):
            ground, shortfall = along_track(
                config.speed_reading, vehicle.speed, sign * with_track, over_track
            )
            excess_so = excess + jnp.maximum(ground / vehicle.surge_max - 1.0, 0.0) + shortfall
            dear = 1.0 + _PENALTY_WEIGHT * excess_so + 0.5 * (price + price0)
            pair.append(jnp.where(inside > 0.0, length / ground * dear + fee, jnp.inf))
        broken = jnp.where(blocked, 2.0, jnp.where(over > _SLIGHT, 1.0, 0.0))
        return None, (*pair, broken)

    moves = np.array(MOVES)
    passed_by = jnp.asarray([_passed(a, b) for a, b in MOVES])
    rows = jnp.asarray(moves[:, 0]), jnp.asarray(moves[:, 1]), passed_by
    forth, back, broken = (plane.swapaxes(0, 1) for plane in jax.lax.scan(timed, None, rows)[1])
    return jnp.stack([forth, back], axis=2), broken


def _probed(room: jax.Array, x: jax.Array, y: jax.Array, low: jax.Array, spacing: jax.Array) -> jax.Array:
    """Clearance at the probes [3 N, 3 N] nearest to places, m."""
    most = room.shape[0] - 1
    i, j = (
        jnp.clip(((place - low[axis]) * (_PROBES / spacing[axis])).astype(jnp.int32), 0, most)
        for axis, place in enumerate((x, y))
    )
    return room.reshape(-1).at[i * (most + 1) + j].get(mode="promise_in_bounds", wrap_negative_indices=False)


def _too_shallow(x: jax.Array, y: jax.Array, spacing: jax.Array, env: Environment) -> jax.Array | None:
    """[N, N], excess where even the top of the box is too near the bed within a cell's spacing; else zero.

    None without a sea bed.
    """
    bed = env.seabed
    if bed is None:
        return None
    missing = env.lower[2] + bed.clearance - bed.shallowest_at(x, y, 2.0 * spacing)
    return jnp.where(missing > 0.0, jnp.clip(_SHALLOW + missing / ALTITUDE_SCALE, 0.0, _MOST), 0.0)


def _passed(a: int, b: int) -> list[tuple[int, int]]:
    """Cells that the move (a, b) begins in or passes, counted back from the one that it ends in.

    No point of the move is farther than a cell's spacing from one of them.
    """
    steps = max(abs(a), abs(b))
    passed = [(round(a * k / steps), round(b * k / steps)) for k in range(1, steps + 1)]
    return passed + passed[-1:] * (_REACH - steps)


def _shifted(plane: jax.Array, a: jax.Array, b: jax.Array, fill: float) -> jax.Array:
    """Return the plane's value where the move (a, b) that ends in each cell began.

    `fill` from off the grid.
    """
    padded = jnp.pad(plane, _REACH, constant_values=fill)
    return jax.lax.dynamic_slice(padded, (_REACH - a, _REACH - b), plane.shape)


def _swept(fields: jax.Array, times: jax.Array) -> jax.Array:
    """Fields [N, 2, N] s after a sweep that follows moves along the first index, and one back."""
    width = fields.shape[2]

    def across(row: jax.Array, b: int) -> jax.Array:
        """[2, N], the entry b places before each."""
        padded = jnp.pad(row, ((0, 0), (_REACH, _REACH)), constant_values=jnp.inf)
        return jax.lax.slice_in_dim(padded, _REACH - b, _REACH - b + width, axis=1)

    def forth(last: tuple[jax.Array, ...], here: tuple[jax.Array, jax.Array]) -> tuple[tuple, jax.Array]:
        row, moves = here
        arrivals = (across(last[a - 1], b) + moves[k] for k, (a, b) in enumerate(MOVES))
        row = reduce(jnp.minimum, arrivals, row)
        return (row, *last[:-1]), row

    def back(ahead: tuple[jax.Array, ...], here: tuple[jax.Array, jax.Array]) -> tuple[tuple, jax.Array]:
        row, moves = here
        row = jnp.minimum(row, ahead[0])
        waiting = [*ahead[1:], jnp.full_like(row, jnp.inf)]
        for k, (a, b) in enumerate(MOVES):
            waiting[a - 1] = jnp.minimum(waiting[a - 1], across(row + moves[k, ::-1], -b))
        return tuple(waiting), row

    nothing = (jnp.full_like(fields[0], jnp.inf),) * _REACH
    fields = jax.lax.scan(forth, nothing, (fields, times))[1]
    return jax.lax.scan(back, nothing, (fields, times), reverse=True)[1]


def _sides(total: jax.Array, best: jax.Array, nearer: jax.Array) -> jax.Array:
    """[N * N], a number for the sides on which the best path through each cell passes the hills.

    A path that crosses the line from a hill towards greater first indices counts the hill's number, and
    the opposite where it crosses the other way; the number is the sum. Two paths that can be turned into each
    other without being drawn over a hill have the same number.

    Args:
        total: [N, N] s, of the best path through each cell.
        best: s, of the best of all.
        nearer: [2, N * N] as `_Grid.previous` finds it.
    """
    hills = _hills(total, best)
    width = total.shape[1]
    weights = np.random.default_rng(0).integers(1, 2**30, _HILLS).astype(np.int32)
    here = jnp.arange(total.size)
    lines = hills // width, hills % width, jnp.asarray(weights)
    doublings = int(np.ceil(np.log2(4 * width)))

    def half(nearer: jax.Array) -> jax.Array:
        """Of the half of the path on one side of the cell, as it leads away from it."""
        (i, j), (i1, j1) = divmod(here, width), divmod(nearer, width)
        number, _ = jax.lax.scan(partial(_crossed, moves=(i, j, i1, j1)), jnp.zeros_like(here), lines)
        return jax.lax.fori_loop(0, doublings, _followed, (number, nearer))[0]

    to_start, to_goal = jax.lax.map(half, nearer)
    return to_goal - to_start


def _crossed(
    number: jax.Array, hill: tuple[jax.Array, ...], moves: tuple[jax.Array, ...]
) -> tuple[jax.Array, None]:
    """Add a hill's weight to the numbers of moves (i, j) to (i1, j1) that cross the line from it."""
    (row, column, weight), (i, j, i1, j1) = hill, moves
    sense = (j > column).astype(jnp.int32) - (j1 > column).astype(jnp.int32)
    # Where the move crosses the line half a cell beside the hill's middle, times twice the move's width.
    beyond = 2 * (i - row) * (j1 - j) + (i1 - i) * (2 * (column - j) + 1)
    return number + jnp.where(beyond * (j1 - j) > 0, sense * weight, 0), None


def _followed(_: int, carry: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
    """Add up numbers along chains of cells, by chains twice as long as before."""
    number, nearer = carry
    return number + number[nearer], nearer[nearer]


def _hills(total: jax.Array, best: jax.Array) -> jax.Array:
    """[_HILLS] flat indices of the lowest hills of a plane; those that there are not lie off the grid."""
    highest, lowest = total, total
    for axis in (0, 1):
        parts = range(-_AROUND, _AROUND + 1)
        highest = reduce(jnp.maximum, [_moved(highest, axis, k, -jnp.inf) for k in parts])
        lowest = reduce(jnp.minimum, [_moved(lowest, axis, k, jnp.inf) for k in parts])
    height = 1.0 + _HEIGHT
    hill = (total >= highest) & (total > height * lowest) & (total > height * best)
    least, cells = jax.lax.top_k(jnp.where(hill, -total, -jnp.inf).reshape(-1), _HILLS)
    return jnp.where(jnp.isfinite(least), cells, total.size * total.shape[1])


def _moved(plane: jax.Array, axis: int, by: int, fill: float) -> jax.Array:
    """Return the plane moved along an axis; `fill` from beyond."""
    shape = [(0, 0), (0, 0)]
    shape[axis] = (_AROUND, _AROUND)
    padded = jnp.pad(plane, shape, constant_values=fill)
    return jax.lax.slice_in_dim(padded, _AROUND + by, _AROUND + by + plane.shape[axis], axis=axis)


def _firsts(total: jax.Array, sides: jax.Array, count: int) -> tuple[jax.Array, jax.Array]:
    """Flat indices [count] of the best cell of each passage, the quickest first, and their times, s."""

    def next_(left: jax.Array, _: None) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        cell = jnp.argmin(left)
        return jnp.where(sides == sides[cell], jnp.inf, left), (cell, left[cell])

    _, (cells, times) = jax.lax.scan(next_, total.reshape(-1), length=count)
    return cells, times


def _walk(cells: jax.Array, previous: jax.Array, steps: int) -> jax.Array:
    """[steps, count] flat indices from each cell back to the source, where they stay."""
    return jax.lax.scan(lambda at, _: (previous[at], at), cells, length=steps)[1]


#: Samples lie as dense as the clearance is small, but at most this many times denser than evenly.
_DENSEST = 8.0

#: Points of a polyline in depth between two stations of its profile.
_DENSE = 4


def _run(x: jax.Array, y: jax.Array) -> jax.Array:
    """Length of polylines [count, L] m up to each of their points, as a share of all of it."""
    run = jnp.cumsum(jnp.sqrt(jnp.diff(x, axis=1) ** 2 + jnp.diff(y, axis=1) ** 2), axis=1)
    return jnp.pad(run, [(0, 0), (1, 0)]) / jnp.maximum(run[:, -1:], 1e-20)


def _evenly(x: jax.Array, y: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Places x, y [count, `STATIONS` + 1] m that lie evenly on polylines [count, L] m."""
    share = jnp.linspace(0.0, 1.0, STATIONS + 1)
    x, y = (_interpolated(share, _run(x, y), axis) for axis in (x, y))
    return x, y


def _interpolated(at: jax.Array, marks: jax.Array, values: jax.Array) -> jax.Array:
    """Interpolate values [count, L] at marks [count, L] linearly, [count, A]."""
    return jax.vmap(partial(jnp.interp, at))(marks, values)


def _fitted(
    traced: _Traced, depths: jax.Array | None, start: jax.Array, goal: jax.Array, config: PathConfig
) -> jax.Array:
    """Habitats [count, 3 n] m of B-splines along traced polylines, by least squares.

    Depths are those given, [count, K] m evenly along each, or the straight line's.

    Where there is little room, samples and control points are denser: clearance is certified between samples,
    and a bend is followed by control points.
    """
    lines, room = [traced.x, traced.y], traced.room
    if depths is not None:
        # Steep parts are long: they get as many control points as level ones of their length.
        share, run = jnp.linspace(0.0, 1.0, _DENSE * (depths.shape[1] - 1) + 1), _run(*lines)
        even = jnp.broadcast_to(jnp.linspace(0.0, 1.0, depths.shape[1]), depths.shape)
        lines = [*(_interpolated(share, run, axis) for axis in lines), _interpolated(share, even, depths)]
        most = jnp.sqrt(((goal - start) ** 2).sum())  # in open water it has no end
        room = _interpolated(share, run, jnp.minimum(room, most))
    legs = jnp.sqrt(reduce(jnp.add, (jnp.diff(axis, axis=1) ** 2 for axis in lines)))
    even = legs.sum(axis=1, keepdims=True) / config.samples
    narrow = jnp.minimum(room[:, 1:], room[:, :-1])
    density = jnp.clip(even / jnp.maximum(narrow, 1e-20 + even / _DENSEST), 1.0, _DENSEST)
    marks = jnp.cumsum(jnp.pad(legs * density, [(0, 0), (1, 0)]), axis=1)
    share = jnp.linspace(0.0, 1.0, config.samples)
    curves = [jax.vmap(lambda m, p: jnp.interp(share * m[-1], m, p))(marks, line) for line in lines]
    planes = fitted(curves, start, goal, config)
    if depths is None:
        depth = straight_line(start, goal, config).reshape(3, -1)[2]
        planes.append(jnp.broadcast_to(depth, planes[0].shape))
    return jnp.stack(planes, axis=1).reshape(len(legs), -1)
