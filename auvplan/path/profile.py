"""Depth along a way: the quickest profile, by a dynamic programme over distance and depth.

A path is given from above, as stations x, y from start to goal. From each station the vehicle moves to the
next one at any of a few depths, in the current that it meets there and then. The best arrival at every depth
of every station is kept, so that an adverse current between two good depths does not end the search, as it
ends a descent by gradients.
"""

from functools import reduce

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from auvplan.ocean.currents import Current, is_steady, varies_in_space, varies_with_depth
from auvplan.ocean.environment import Environment
from auvplan.path.clearance import obstacle_clearance
from auvplan.path.config import GUIDE_ALTITUDE, PathConfig
from auvplan.path.habitats import deepest
from auvplan.path.kinematics import TINY, vertical_speeds
from auvplan.path.problem import Problem
from auvplan.vehicle import Vehicle, along_track

#: Moves from station to station on each path of a search, and depths to choose from at each.
STATIONS, LEVELS = 64, 24

#: Places on each segment at which paths through depths meet the current while they are compared, and at which
#: any path meets it when it is timed. In its middle alone a steep segment would hide the layers that it
#: crosses, and one in the plan view a front or a jet.
_COMPARED, _TIMED = 2, 8

#: Share of the depths that lie where the current changes with depth; the others lie evenly.
_SHEARED = 0.5

#: Depths at which the current is looked up to find where it changes.
_FINE = 48

#: A move that breaks a limit costs this many times its own time for each unit of excess.
_PENALTY_WEIGHT = 30.0

#: Excess of a move at most.
_MOST = 3.0

#: Sine of the pitch of transits without limits, share of the limits that they take, and by how much steeper
#: than the straight line they are at least.
_COMMON, _GENTLE, _STEEPER = 0.5, 0.6, 1.05

#: Metres beyond what is allowed that count as an excess of one: of clearance, and of depth over a sea bed.
_TOO_NEAR, _TOO_DEEP = 20.0, 5.0


def crosses_depths(env: Environment, current: Current) -> bool:
    """Return whether paths may meet other currents at other depths.

    Args:
        env: the world; only its box counts. One that JAX traces counts as one with depth.
        current: the current; the shapes of its arrays are enough.
    """
    traced = isinstance(env.lower, Tracer) or isinstance(env.upper, Tracer)
    deep = traced or bool(np.asarray(env.upper)[2] > np.asarray(env.lower)[2])
    return deep and varies_with_depth(current)


def is_searched_in_depth(env: Environment, vehicle: Vehicle, current: Current) -> bool:
    """Return whether paths are searched for depths with other currents.

    Args:
        env, current: as for `crosses_depths`.
        vehicle: whose depth is given where it has a transit depth or altitude.
    """
    return not vehicle.has_transit and crosses_depths(env, current)


def compared(config: PathConfig, env: Environment, current: Current) -> PathConfig:
    """Return the settings by which paths are compared in a search, from the user's.

    Args:
        config: the user's.
        env, current: as for `crosses_depths`.
    """
    return _met_at(_COMPARED, config) if crosses_depths(env, current) else config


def timed(config: PathConfig, current: Current) -> PathConfig:
    """Return the settings by which a path that was found is timed, from the user's.

    Args:
        config: the user's.
        current: as for `crosses_depths`.
    """
    changes = varies_in_space(current) or not is_steady(current)
    return _met_at(_TIMED, config) if changes else config


def _met_at(count: int, config: PathConfig) -> PathConfig:
    return config if config.quadrature is not None else config.replace(quadrature=count)


def depths_within_reach(ends: jax.Array, env: Environment) -> tuple[jax.Array, jax.Array]:
    """Return the least and the greatest depth, m, that a search looks at between two ends [2, 3] m.

    That is the box, but no farther above and below the ends than they are apart: boxes may have no bottom.
    """
    reach = jnp.sqrt(((ends[1] - ends[0]) ** 2).sum())
    depth = ends[:, 2]
    top = jnp.minimum(jnp.maximum(env.lower[2], depth.min() - reach), depth.min())
    return top, jnp.maximum(jnp.minimum(env.upper[2], depth.max() + reach), depth.max())


def levels(
    places: tuple[jax.Array, ...],
    top: jax.Array,
    bottom: jax.Array,
    count: int,
    current: Current,
) -> jax.Array:
    """Choose depths [count] m from the top to the bottom, denser where the current changes with depth.

    Args:
        places: x, y [A] m, and times [A] s, where the current is looked up.
        top, bottom: m.
        count: of depths.
        current: the current.
    """
    share = jnp.linspace(0.0, 1.0, _FINE)
    depth = top + (bottom - top) * share
    x, y, when = (axis[:, None] for axis in places)
    u, v, _ = (
        jnp.broadcast_to(part, (len(x), _FINE))
        for part in current(x, y, jnp.broadcast_to(depth, (len(x), _FINE)), when)
    )
    change = jnp.sqrt(jnp.diff(u, axis=1) ** 2 + jnp.diff(v, axis=1) ** 2).max(axis=0)
    even = 1.0 / (_FINE - 1)
    total = change.sum()
    density = jnp.where(
        total > 1e-6, (1.0 - _SHEARED) * even + _SHEARED * change / jnp.maximum(total, 1e-6), even
    )
    marks = jnp.concatenate([jnp.zeros(1, density.dtype), jnp.cumsum(density)])
    return jnp.interp(jnp.linspace(0.0, 1.0, count), marks / marks[-1], depth)


def transit_depths(
    x: jax.Array, y: jax.Array, gap: jax.Array, env: Environment, vehicle: Vehicle
) -> jax.Array:
    """Return the depths, m, that a vehicle with a transit depth or altitude takes far from its ends.

    Args:
        x, y: m, places.
        gap: m, length around each place within which the sea bed is looked up.
        env: the world.
        vehicle: with a transit depth or altitude.
    """
    if vehicle.transit_altitude is not None:
        assert env.seabed is not None
        least = jnp.maximum(vehicle.transit_altitude, env.seabed.clearance + 2.0 * GUIDE_ALTITUDE)
        depth = env.seabed.shallowest_at(x, y, gap) - least
    else:
        assert vehicle.transit_depth is not None
        depth = jnp.full(jnp.shape(x), vehicle.transit_depth, jnp.result_type(float))
        if env.seabed is not None:
            depth = jnp.minimum(depth, deepest(env, x, y, gap))
    return jnp.clip(depth, env.lower[2], env.upper[2])


def transit_slope(vehicle: Vehicle) -> jax.Array:
    """Return metres in depth per metre ahead at which transits begin and end, and climb over the bed.

    Currents make paths steeper or flatter than the hull: a share of the limits is left to them.
    """
    rates = [limit / vehicle.speed for limit in vehicle.vertical_limits.values()]
    sine = _GENTLE * reduce(jnp.minimum, rates, jnp.asarray(_COMMON))
    return sine / jnp.sqrt(1.0 - sine * sine)


def in_transit(
    places: tuple[jax.Array, ...], way: tuple[jax.Array, ...], env: Environment, vehicle: Vehicle
) -> jax.Array:
    """Return depths z [S, P] m of paths that keep a vehicle's transit depth or altitude between their ends.

    Ends stay what they are. Slopes are those of `transit_slope`, steeper only where the ends ask for it: the
    path climbs before a bank, and dives after it.

    Args:
        places: x, y, z, [S, P] m, samples of paths.
        way: x, y, z, [S - 1, P] m from each sample to the next.
        env: the world.
        vehicle: with a transit depth or altitude.
    """
    x, y, z = places
    step = jnp.sqrt(way[0] ** 2 + way[1] ** 2 + TINY)
    run = jnp.pad(jnp.cumsum(step, axis=0), [(1, 0), (0, 0)])
    longer = jnp.maximum(jnp.pad(step, [(1, 0), (0, 0)]), jnp.pad(step, [(0, 1), (0, 0)]))
    wanted = transit_depths(x, y, 2.0 * longer, env, vehicle).at[0].set(z[0]).at[-1].set(z[-1])
    slope = jnp.maximum(transit_slope(vehicle), _STEEPER * jnp.abs(z[-1] - z[0]) / run[-1])
    rise = slope * run
    ahead = jax.lax.cummin(wanted - rise, axis=0) + rise
    back = jax.lax.cummin(wanted + rise, axis=0, reverse=True) - rise
    ends = jnp.maximum(z[0] - rise, z[-1] - (rise[-1] - rise))
    return jnp.maximum(jnp.minimum(ahead, back), ends)


def profiles(
    x: jax.Array, y: jax.Array, problem: Problem, config: PathConfig, count: int = LEVELS
) -> jax.Array:
    """Find the depths at which P paths given from above are quickest, [P, K + 1] m.

    Args:
        x, y: [P, K + 1] m, their stations.
        problem: the leg.
        config: static settings.
        count: of depths to choose from; start's and goal's are two of them.
    """
    (start, goal), depart, env, vehicle = problem.ends, problem.depart, problem.env, problem.vehicle
    dx, dy = jnp.diff(x, axis=1), jnp.diff(y, axis=1)
    step = jnp.sqrt(dx * dx + dy * dy + TINY)
    limit = jnp.full_like(x, env.upper[2])
    if env.seabed is not None:
        longer = jnp.maximum(jnp.pad(step, [(0, 0), (1, 0)]), jnp.pad(step, [(0, 0), (0, 1)]))
        limit = jnp.minimum(limit, deepest(env, x, y, longer))
    at = slice(None, None, max(1, x.shape[1] // 8))
    run = jnp.cumsum(step, axis=1)[:, at] / vehicle.speed
    seen = tuple(plane.ravel() for plane in (x[:, :-1][:, at], y[:, :-1][:, at], depart + run))
    ends = jnp.stack([start[2], goal[2]])
    top, bottom = depths_within_reach(jnp.stack([start, goal]), env)
    bottom = jnp.maximum(jnp.minimum(limit.max(), bottom), ends.max())
    depth = levels(seen, top, bottom, count - 2, env.current)
    depth = jnp.sort(jnp.concatenate([depth, ends]))
    first, last = (jnp.argmin(jnp.abs(depth - end)) for end in ends)

    def move(carry: tuple[jax.Array, jax.Array], station: tuple) -> tuple[tuple, jax.Array]:
        cost, time = carry
        moves, excess, arrived = _moves(depth, time, station, env, vehicle, config)
        total = cost[:, :, None] + moves * (1.0 + _PENALTY_WEIGHT * excess)
        if vehicle.depth_toll is not None:
            total = total + vehicle.depth_toll * jnp.abs(depth[None, :] - depth[:, None])
        best = jnp.argmin(total, axis=1)
        kept = jnp.take_along_axis(total, best[:, None], axis=1)[:, 0]
        when = jnp.take_along_axis(arrived, best[:, None], axis=1)[:, 0]
        return (kept, when), best

    begin = jnp.where(jnp.arange(count) == first, 0.0, jnp.inf)
    cost = jnp.broadcast_to(begin, (x.shape[0], count)).astype(x.dtype)
    stations = (x[:, :-1].T, y[:, :-1].T, dx.T, dy.T, step.T, limit[:, :-1].T, limit[:, 1:].T)
    carry = cost, jnp.full_like(cost, depart)
    _, back = jax.lax.scan(move, carry, stations)

    def before(level: jax.Array, best: jax.Array) -> tuple[jax.Array, jax.Array]:
        level = jnp.take_along_axis(best, level[:, None], axis=1)[:, 0]
        return level, level

    last = jnp.full(x.shape[0], last)
    _, chosen = jax.lax.scan(before, last, back, reverse=True)
    return depth[jnp.concatenate([chosen, last[None]]).T]


def _moves(
    depth: jax.Array,
    time: jax.Array,
    station: tuple[jax.Array, ...],
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Durations [P, L, L] s of moves from each depth of a station to each of the next, excess, and arrivals.

    Args:
        depth: [L] m, rising.
        time: [P, L] s, of arrival at the station.
        station: x, y, dx, dy, level length [P] m of the moves from it, and greatest depth [P] m around it
            and around the next, as far as halfway between them.
        env, vehicle: of the leg.
        config: static settings.
    """
    x, y, dx, dy, step, limit, next_limit = (part[:, None] for part in station)
    half = time + 0.5 * step / vehicle.speed
    there = jnp.broadcast_to(depth, half.shape)
    u, v, w = (
        jnp.broadcast_to(part, half.shape)
        for part in env.current(x + 0.5 * dx + 0.0 * there, y + 0.5 * dy + 0.0 * there, there, half)
    )
    rise = depth[None, :] - depth[:, None]
    u, v, w = (_mean_between(part, depth, rise) for part in (u, v, w))
    dx, dy, step = dx[:, :, None], dy[:, :, None], step[:, :, None]
    gap = jnp.sqrt(step * step + rise * rise)
    along = (u * dx + v * dy + w * rise) / gap
    across = jnp.sqrt(jnp.maximum(u * u + v * v + w * w - along * along, 0.0) + TINY)
    ground, shortfall = along_track(config.speed_reading, vehicle.speed, along, across)
    duration = gap / ground
    excess = shortfall
    excess = excess + jnp.maximum(ground / vehicle.surge_max - 1.0, 0.0)
    excess = excess + jnp.maximum(across / vehicle.sway_max - 1.0, 0.0)
    for vertical, most in vertical_speeds(
        (u, v, w), (dx, dy, rise), gap, ground, vehicle, config.speed_reading
    ).values():
        excess = excess + jnp.maximum(vertical / most - 1.0, 0.0)
    arrived = time[:, :, None] + duration
    near = jnp.maximum(depth - next_limit, 0.0) / _TOO_DEEP
    if len(env.obstacles):
        still = jnp.zeros_like(half)
        met = (x + station[2][:, None] + still, y + station[3][:, None] + still, there)
        then = time + station[4][:, None] / vehicle.speed
        clear = obstacle_clearance((met, (still, still, still), then, still), env)
        near = near + jnp.maximum(config.obstacle_margin - clear, 0.0) / _TOO_NEAR
    excess = excess + near[:, None, :]
    if env.seabed is not None:
        # As `bed_altitude` has it: each half of a move is over the bed that its outer end covers.
        halfway = 0.5 * (depth[None, :] + depth[:, None]) - jnp.minimum(limit, next_limit)[:, :, None]
        excess = excess + jnp.maximum(halfway, 0.0) / _TOO_DEEP
    return duration, jnp.minimum(excess, _MOST), arrived


def _mean_between(plane: jax.Array, depth: jax.Array, rise: jax.Array) -> jax.Array:
    """[P, L, L], means of a plane [P, L] over the depths [L] m between each two, linear between them."""
    parts = 0.5 * (plane[:, 1:] + plane[:, :-1]) * jnp.diff(depth)
    sums = jnp.pad(jnp.cumsum(parts, axis=1), [(0, 0), (1, 0)])
    between = sums[:, None, :] - sums[:, :, None]
    same = jnp.abs(rise) < 1e-3
    return jnp.where(same, plane[:, :, None], between / jnp.where(same, 1.0, rise))
