"""Continuous descent of a path in float64: a fine polyline shifted along its normals until nothing is gained.

The shifts are a sum of sines, each scaled by its wave length, in which a taut string is equally stiff in all
directions. Limits are penalties that grow from stage to stage; what they still miss is made good by asking
for more. Lengths and times count in units of the problem's own.
"""

from dataclasses import dataclass
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from auvplan.ocean.currents import is_steady
from auvplan.vehicle import SPEED_FLOOR
from benchmarks.harness import Array
from benchmarks.paths.problems import PathProblem
from benchmarks.paths.ruler import LIMIT_TOLERANCE, Score, World, evaluate

#: Units to the longer side of the box, and to the straight line at the vehicle's speed.
_LENGTHS, _TIMES = 10_000.0, 4000.0

#: Passes that settle the times at which a path meets a changing current.
_SWEEPS = 8


@dataclass(frozen=True)
class Stage:
    segments: int
    parts: int  # points of each segment at which the current and the clearance are looked up
    price: float  # of missing clearance, units of time per squared unit of length
    iterations: int


STAGES = Stage(128, 4, 1.0, 150), Stage(256, 4, 30.0, 200)

#: Price of a squared relative excess of a limit of the vehicle, to that of a squared unit of length.
_LIMIT_PRICE = 1000.0

#: Share of a path's segments that its dives and climbs have.
_DIVES = 0.4

#: Units of clearance to ask for at first, and how often to ask for more.
_EXTRA, _TRIES = 0.02, 6

#: Units of clearance and share of a limit that are asked for beyond what was missed.
_MORE, _STRICTER = 0.025, 0.002


@dataclass(frozen=True, eq=False)
class Polished:
    """A path and what the ruler says of it; positions are [n, 2] m."""

    positions: Array
    score: Score


def polish(problem: PathProblem, world: World, positions: Array) -> Polished:
    """Descend from a path [n, 2] m, from start to goal."""
    unit = world.side / _LENGTHS
    points, extra, slack = positions, _EXTRA * unit, 0.0
    vehicle = problem.vehicle
    limits = tuple(map(float, (vehicle.speed, vehicle.surge_max, vehicle.sway_max, vehicle.turn_rate_max)))
    units = unit, problem.distance / limits[0] / _TIMES
    data = problem.environment.current, limits, problem.depart, world, units
    for stage in STAGES:
        points = _descended(points, stage, extra, slack, data)
    result = Polished(points, evaluate(problem, points, world))
    for _ in range(_TRIES):
        if result.score.feasible or not np.isfinite(result.score.travel_time):
            break
        if result.score.clearance <= -world.tolerance:
            extra += -result.score.clearance + _MORE * unit
        if result.score.excess > LIMIT_TOLERANCE:
            slack += result.score.excess - LIMIT_TOLERANCE + _STRICTER
        points = _descended(points, STAGES[-1], extra, slack, data)
        result = Polished(points, evaluate(problem, points, world))
    return result


def resampled(positions: Array, segments: int, stretched: tuple[float, ...] | float = 1.0) -> Array:
    """Return the polyline [n, d] as so many segments of one length, [segments + 1, d].

    Args:
        positions: [n, d] m.
        stretched: [d], factors of the axes by which lengths count.
    """
    gaps = np.linalg.norm(np.diff(positions, axis=0) * np.asarray(stretched), axis=1)
    marks = np.concatenate([[0.0], np.cumsum(gaps)])
    even = np.linspace(0.0, marks[-1], segments + 1)
    return np.stack([np.interp(even, marks, axis) for axis in positions.T], axis=1)


def spread(positions: Array, segments: int) -> Array:
    """Return the polyline [n, 3] as so many segments, even but for shorter ones where it dives or climbs."""
    way = np.abs(np.diff(positions, axis=0))
    level, upright = np.hypot(way[:, 0], way[:, 1]).sum(), way[:, 2].sum()
    factor = max(1.0, _DIVES / (1.0 - _DIVES) * level / upright) if upright > 0.0 else 1.0
    return resampled(positions, segments, (1.0, 1.0, factor))


def _descended(positions: Array, stage: Stage, extra: float, slack: float, data: tuple) -> Array:
    """Descend once, [segments + 1, 2] m.

    Args:
        positions: [n, 2] m.
        stage: how finely.
        extra: m of clearance beyond the margins.
        slack: share of the vehicle's limits that is not used.
    """
    base = resampled(positions, stage.segments)
    tangent = np.gradient(base, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    shapes = _shapes(stage.segments)

    def cost(amplitudes: Array) -> tuple[float, Array]:
        given = base, normal, shapes, stage.price, extra, slack, data, stage.parts
        with jax.enable_x64(True):
            value, slope = _slope(amplitudes, *given)
            return float(value), np.asarray(slope)

    options = {"maxiter": stage.iterations, "maxcor": 30, "ftol": 1e-11, "gtol": 1e-9}
    found = minimize(cost, np.zeros(stage.segments - 1), jac=True, method="L-BFGS-B", options=options)
    return base + normal * (data[-1][0] * shapes @ found.x)[:, None]


@lru_cache(maxsize=8)
def _shapes(segments: int) -> Array:
    """Sines that vanish at both ends, each scaled by its wave length, [segments + 1, segments - 1]."""
    place, wave = np.arange(segments + 1) / segments, np.arange(1, segments)
    return np.sin(np.pi * place[:, None] * wave) / wave


def _cost(
    amplitudes: jax.Array, base: jax.Array, normal: jax.Array, shapes: jax.Array, price: float, extra: float,
    slack: float, data: tuple, parts: int,
) -> jax.Array:  # fmt: skip
    """Travel time plus the price of missing clearance and broken limits, in units of time."""
    current, (speed, surge_max, sway_max, turn_rate_max), depart, world, units = data
    points = base + normal * (units[0] * shapes @ amplitudes)[:, None]
    begin, way = points[:-1, None], jnp.diff(points, axis=0)[:, None]
    share = ((jnp.arange(parts) + 0.5) / parts)[:, None]
    x, y = jnp.moveaxis((begin + share * way).reshape(-1, 2), 1, 0)
    whole = jnp.sqrt((way**2).sum(axis=2) + 1e-12)
    north, east = (jnp.repeat((way[..., k] / whole)[:, 0], parts) for k in range(2))
    length = jnp.repeat(whole[:, 0], parts) / parts

    duration = length / speed
    for _ in range(1 if is_steady(current) else _SWEEPS):
        when = depart + jnp.cumsum(duration) - 0.5 * duration
        u, v, _ = current(x, y, jnp.zeros_like(x), when)
        along, across = u * north + v * east, u * east - v * north
        held = jnp.sqrt(jnp.maximum(speed**2 - across**2, (0.02 * speed) ** 2))
        ground = along + held
        duration = length / jnp.maximum(ground, 0.02 * speed)

    def over(value: jax.Array, limit: jax.Array | float) -> jax.Array:
        return (jnp.maximum(value / ((1.0 - slack) * limit) - 1.0, 0.0) ** 2).sum()

    spent = duration.reshape(-1, parts).sum(axis=1)
    (ax, ay), (bx, by) = way[:-1, 0].T, way[1:, 0].T
    cross, dot = ax * by - ay * bx, ax * bx + ay * by
    turn = jnp.abs(jnp.arctan2(cross, dot)) / (0.5 * (spent[1:] + spent[:-1]))
    broken = over(ground, surge_max) + over(jnp.abs(across), jnp.minimum(sway_max, speed))
    broken += parts * over(turn, turn_rate_max)
    broken += (jnp.maximum(SPEED_FLOOR - ground / speed, 0.0) ** 2).sum()

    times = depart + jnp.concatenate([jnp.zeros(1), jnp.cumsum(spent)])
    when = jnp.concatenate([depart + jnp.cumsum(duration) - 0.5 * duration, times])
    x, y = jnp.concatenate([x, points[:, 0]]), jnp.concatenate([y, points[:, 1]])
    clear = world.spheres.clearance(x, y, world.low[2], when)
    missing = (jnp.maximum(extra - clear, 0.0) ** 2).sum()
    missing += (jnp.maximum(extra + world.margin - world.coast.at(x, y), 0.0) ** 2).sum()
    for line, low, high in zip((x, y), world.low[:2], world.high[:2], strict=True):
        missing += (jnp.maximum(low - line, 0.0) ** 2 + jnp.maximum(line - high, 0.0) ** 2).sum()
    return duration.sum() / units[1] + price * (missing / units[0] ** 2 + _LIMIT_PRICE * broken)


_slope = jax.jit(jax.value_and_grad(_cost), static_argnames=("parts",))
