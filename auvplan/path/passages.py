"""Distinct passages between two points: coarse time-to-reach fields and the best paths through them.

One field holds, for every cell of a coarse grid, the least travel time from the start, another one that to
the goal; their sum is the time of the best path through each cell. Where the sum has a minimum across the
way, a passage leads through. Paths traced through these minima let the search begin in every passage that
there is, which neither random detours nor gradients find by themselves.
"""

from collections.abc import Iterator
from functools import reduce

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.environment import Environment
from auvplan.path.bspline import fit_matrix
from auvplan.path.clearance import distance_to_land, obstacle_clearance
from auvplan.path.config import PathConfig
from auvplan.path.cost import ALTITUDE_SCALE
from auvplan.path.habitats import deepest, risen, straight_line
from auvplan.vehicle import Vehicle, along_track

#: Moves from a cell to another in 32 directions, in cells along the way and across it.
MOVES = np.array([(a, b) for a in range(-3, 4) for b in range(-3, 4) if np.gcd(a, b) == 1])
_REACH = int(np.abs(MOVES).max())

#: A move that breaks a limit costs this many times its own time for each unit of excess.
_DETERRENT = 30.0

#: Excess of a move at most; one over a bed too shallow to be crossed has half of that at least.
_MOST, _SHALLOW = 3.0, 1.5

#: Paths whose times differ by less than this share count as one.
_SAME = 3e-4

#: Of the cells between start and goal: share behind the start and beyond the goal, and to each side.
_BEYOND, _ASIDE = 0.25, 0.75

#: Passages are looked for on lines across the way that divide it into as many parts.
_COLUMNS = 8


def trace_passages(
    start: jax.Array,
    goal: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    count: int,
    config: PathConfig,
) -> tuple[jax.Array, jax.Array]:
    """The best coarse paths through `count` passages, as habitats.

    Args:
        start, goal: [3] m.
        depart: s since the epoch.
        env: the world, obstacles resolved. A bank of the sea bed is crossed where the top of the box leaves
            room above it.
        vehicle: speed and limits.
        count: of paths.
        config: static settings; `field_cells` sets the grid.

    Returns:
        ``(habitats [count, 3 n] m, times [count] s)``, quickest first; times of broken limits hold a
        deterrent. Where there are fewer passages the last ones repeat, with infinite times.
    """
    cells = config.field_cells
    behind, aside = round(_BEYOND * cells), round(_ASIDE * cells)
    shape = cells + 1 + 2 * behind, 1 + 2 * aside
    along, across = jnp.meshgrid(
        jnp.arange(shape[0]) - behind, jnp.arange(shape[1]) - aside, indexing="ij"
    )  # in cells, from the start
    way = goal[:2] - start[:2]
    spacing = jnp.sqrt((way**2).sum() + 1.0) / cells
    forward = way / (cells * spacing)
    x = start[0] + spacing * (along * forward[0] - across * forward[1])
    y = start[1] + spacing * (along * forward[1] + across * forward[0])
    z = start[2] + (goal[2] - start[2]) * jnp.clip(along / cells, 0.0, 1.0)

    edges = _edge_times(x, y, z, spacing, forward, start, depart, env, vehicle, config)
    turned = _reversed(edges)
    first, last = (behind, aside), (behind + cells, aside)
    ahead, back = _field(edges, first), _field(turned, last)
    chosen, times = _minima(ahead + back, count, behind, cells)
    to_start = _walk(chosen, _previous(ahead, edges, first), 2 * cells)
    to_goal = _walk(chosen, _previous(back, turned, last), 2 * cells)
    route = jnp.concatenate([to_start[::-1], to_goal[1:]]).T
    found = _fitted(x.reshape(-1)[route], y.reshape(-1)[route], start, goal, config)
    return risen(found, start, goal, env), times


def _edge_times(
    x: jax.Array,
    y: jax.Array,
    z: jax.Array,
    spacing: jax.Array,
    forward: jax.Array,
    start: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> jax.Array:
    """[32, A, B] s: time of each of `MOVES` that ends in a cell, with a deterrent where it breaks a limit."""
    shallow = _too_shallow(x, y, spacing, env)
    if env.seabed is not None:
        z = jnp.minimum(z, deepest(env, x, y, 2.0 * spacing))
    away = jnp.sqrt((x - start[0]) ** 2 + (y - start[1]) ** 2)
    when = depart + away / vehicle.speed  # arrival, roughly
    u, v, _ = env.current(x, y, z, when)
    ahead, aside = u * forward[0] + v * forward[1], v * forward[0] - u * forward[1]
    clear = _clearance(x, y, z, when, env, config)
    risk = jnp.zeros_like(x) if env.chart is None else 1.0 - env.chart.passability_at(x, y)

    times = []
    for a, b in MOVES:
        steps = float(np.hypot(a, b))
        # Mean of both ends of the move; cells whose move comes from off the grid do not count.
        ahead_mean, aside_mean, risk_mean = (0.5 * (p + _shifted(p, a, b, 0.0)) for p in (ahead, aside, risk))
        with_track = (a * ahead_mean + b * aside_mean) / steps
        over_track = jnp.abs(a * aside_mean - b * ahead_mean) / steps
        ground, shortfall = along_track(config.speed_reading, vehicle.speed, with_track, over_track)
        before = _shifted(clear, a, b, -1.0)
        lowest = jnp.minimum(clear, before)
        if steps > 1.5:  # a long move may cut a corner: distances are 1-Lipschitz
            lowest = jnp.minimum(lowest, 0.5 * (clear + before - steps * spacing))
        excess = (
            jnp.clip(-lowest / spacing, 0.0, _MOST)
            + jnp.maximum(ground / vehicle.surge_max - 1.0, 0.0)
            + jnp.maximum(over_track / vehicle.sway_max - 1.0, 0.0)
            + shortfall
        )
        if shallow is not None:
            passed = (shallow, *(_shifted(shallow, *cell, 0.0) for cell in _passed(a, b)))
            excess = excess + reduce(jnp.maximum, passed)
        dear = 1.0 + _DETERRENT * excess + config.uncertain_price * risk_mean
        times.append(jnp.where(before == -1.0, jnp.inf, steps * spacing / ground * dear))
    return jnp.stack(times)


def _clearance(
    x: jax.Array, y: jax.Array, z: jax.Array, when: jax.Array, env: Environment, config: PathConfig
) -> jax.Array:
    """[A, B] m to the nearest thing to keep clear of, beyond the margins; negative where too near."""
    inside = [x - env.lower[0], env.upper[0] - x, y - env.lower[1], env.upper[1] - y]
    clear = jnp.minimum(jnp.minimum(inside[0], inside[1]), jnp.minimum(inside[2], inside[3])) + 1e-3
    if env.chart is not None:
        clear = jnp.minimum(clear, distance_to_land(env.chart, x, y) - config.coast_margin)
    still = jnp.zeros_like(x)  # a point is a segment of no length
    near = obstacle_clearance(((x, y, z), (still, still, still), when, still), env)
    return jnp.minimum(clear, near - config.obstacle_margin)


def _too_shallow(x: jax.Array, y: jax.Array, spacing: jax.Array, env: Environment) -> jax.Array | None:
    """[A, B], excess where even the top of the box is too near the bed within a cell's spacing; else zero.

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
    return [(round(a * k / steps), round(b * k / steps)) for k in range(1, steps + 1)]


def _shifted(plane: jax.Array, a: int, b: int, fill: float) -> jax.Array:
    """The plane's value where the move (a, b) that ends in each cell began; `fill` from off the grid."""
    padded = jnp.pad(plane, _REACH, constant_values=fill)
    return jax.lax.slice(
        padded,
        (_REACH - a, _REACH - b),
        (_REACH - a + plane.shape[0], _REACH - b + plane.shape[1]),
    )


def _reversed(edges: jax.Array) -> jax.Array:
    """Times of the same moves gone backwards: entry k ends where move k, from there, would have begun."""
    turned = [_shifted(plane, -a, -b, jnp.inf) for plane, (a, b) in zip(edges, MOVES, strict=True)]
    # The opposite of move k is the k-th from the end: the moves are sorted and symmetric.
    return jnp.stack(turned[::-1])


def _arrivals(field: jax.Array, edges: jax.Array) -> Iterator[jax.Array]:
    """[A, B] s: times to every cell by each of `MOVES`."""
    return (_shifted(field, a, b, jnp.inf) + edge for (a, b), edge in zip(MOVES, edges, strict=True))


def _field(edges: jax.Array, source: tuple[int, int]) -> jax.Array:
    """Least time from a cell to every cell, [A, B] s, by min-plus sweeps until nothing changes."""

    def step(carry: tuple[jax.Array, jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array, jax.Array]:
        field, _, count = carry
        new = reduce(jnp.minimum, _arrivals(field, edges), field)
        return new, (new < field).any(), count + 1

    shape = edges.shape[1:]
    field = jnp.full(shape, jnp.inf, edges.dtype).at[source].set(0.0)
    carry = field, jnp.array(True), jnp.array(0)
    return jax.lax.while_loop(lambda c: c[1] & (c[2] < sum(shape)), step, carry)[0]


def _minima(total: jax.Array, count: int, first: int, cells: int) -> tuple[jax.Array, jax.Array]:
    """Flat indices [count] of minima across the way, of different passages, and their times, least first."""
    width = total.shape[1]
    columns = first + cells * np.arange(1, _COLUMNS) // _COLUMNS
    crossed = total[columns]
    sides = jnp.pad(crossed, [(0, 0), (2, 2)], constant_values=jnp.inf)
    lowest = crossed <= jnp.min(jnp.stack([sides[:, k : k + width] for k in (0, 1, 3, 4)]), axis=0)
    times = jnp.where(lowest, crossed, jnp.inf).reshape(-1)
    index = jnp.asarray(columns[:, None] * width + np.arange(width)).reshape(-1)
    least, order = jax.lax.top_k(-times, min(_COLUMNS * count, len(times)))
    least = -least
    new = jnp.concatenate([jnp.ones(1, bool), least[1:] > least[:-1] * (1.0 + _SAME)])
    times, kept = jax.lax.top_k(jnp.where(new, -least, -jnp.inf), count)
    return index[order[kept]], -times


def _previous(field: jax.Array, edges: jax.Array, source: tuple[int, int]) -> jax.Array:
    """[A * B] flat index of the cell before each on the best way; the source comes from itself."""
    best, move = jnp.full_like(field, jnp.inf), jnp.zeros(field.shape, jnp.int32)
    for (a, b), time in zip(MOVES, _arrivals(field, edges), strict=True):
        move = jnp.where(time < best, a * field.shape[1] + b, move)
        best = jnp.minimum(best, time)
    move = move.at[source].set(0)
    return jnp.arange(field.size) - move.reshape(-1)


def _walk(cells: jax.Array, previous: jax.Array, steps: int) -> jax.Array:
    """[steps, count] flat indices from each cell back to the source, where they stay."""
    return jax.lax.scan(lambda at, _: (previous[at], at), cells, length=steps)[1]


def _fitted(x: jax.Array, y: jax.Array, start: jax.Array, goal: jax.Array, config: PathConfig) -> jax.Array:
    """Habitats [count, 3 n] m of B-splines along polylines [count, L] m, by least squares."""
    legs = jnp.sqrt(jnp.diff(x, axis=1) ** 2 + jnp.diff(y, axis=1) ** 2)
    marks = jnp.cumsum(jnp.pad(legs, [(0, 0), (1, 0)]), axis=1)
    share = jnp.linspace(0.0, 1.0, config.samples)
    fit = jnp.asarray(fit_matrix(config.samples, config.control_points + 2, config.degree), x.dtype)
    planes = []
    for axis, line in enumerate((x, y)):
        curve = jax.vmap(lambda m, p: jnp.interp(share * m[-1], m, p))(marks, line)
        ends = jnp.broadcast_to(jnp.stack([start[axis], goal[axis]]), (len(x), 2))
        planes.append(jnp.concatenate([curve, ends], axis=1) @ fit.T)
    depth = straight_line(start, goal, config).reshape(3, -1)[2]
    planes.append(jnp.broadcast_to(depth, planes[0].shape))
    return jnp.stack(planes, axis=1).reshape(len(x), -1)
