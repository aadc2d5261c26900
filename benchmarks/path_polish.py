"""Continuous descent of a path in float64: a fine polyline shifted along its normals until nothing is gained.

The shifts are a sum of sines, each scaled by its wave length, in which a taut string is equally stiff in all
directions: L-BFGS settles in few steps however fine the polyline is. Limits are penalties that grow from
stage to stage; what they still miss is made good by asking for more clearance, until none is missing.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from auvplan.ocean.currents import is_steady
from benchmarks.path_problems import OBSTACLES, PathProblem
from benchmarks.path_ruler import TOLERANCE, Score, World, evaluate

Array = NDArray[np.floating]

#: Points in the middle of parts of each segment at which the current and the clearance are looked up.
_PARTS = 8

#: Passes that settle the times at which a path meets a changing current.
_SWEEPS = 8

#: Segments and price of missing clearance, s/m^2, of each stage.
_STAGES = ((64, 0.1), (128, 1.0), (128, 10.0))
_FINE_STAGES = ((256, 1.0), (256, 30.0))

#: m of clearance to ask for at first, and how often to ask for more.
_EXTRA, _TRIES = 0.02, 6

_ITERATIONS = 400


@dataclass(frozen=True, eq=False)
class Polished:
    """A path and what the ruler says of it; positions are [n, 2] m."""

    positions: Array
    score: Score


def polish(problem: PathProblem, world: World, positions: Array, fine: bool = False) -> Polished:
    """Descend from a path [n, 2] m.

    Args:
        problem: what to sail.
        world: what to keep off.
        positions: [n, 2] m, from start to goal.
        fine: whether the path is nearly right already and is to be followed more finely.
    """
    points, extra = positions, _EXTRA
    data = _data(problem, world)
    stages = _FINE_STAGES if fine else _STAGES
    for segments, price in stages:
        points = _descended(points, segments, price, extra, data)
    result = Polished(points, evaluate(problem, points, world))
    for _ in range(_TRIES):
        if result.score.feasible:
            break
        extra += max(-result.score.clearance, 0.0) + 0.5 * TOLERANCE
        points = _descended(points, *stages[-1], extra, data)
        result = Polished(points, evaluate(problem, points, world))
    return result


def resampled(positions: Array, segments: int) -> Array:
    """The polyline [n, 2] as so many segments of one length, [segments + 1, 2]."""
    gaps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    marks = np.concatenate([[0.0], np.cumsum(gaps)])
    even = np.linspace(0.0, marks[-1], segments + 1)
    return np.stack([np.interp(even, marks, positions[:, k]) for k in range(2)], axis=1)


def _descended(positions: Array, segments: int, price: float, extra: float, data: tuple) -> Array:
    """One stage of the descent, [segments + 1, 2] m."""
    base = resampled(positions, segments)
    tangent = np.gradient(base, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    shapes = _shapes(segments)

    def cost(amplitudes: Array) -> tuple[float, Array]:
        with jax.enable_x64(True):
            value, slope = _slope(amplitudes, base, normal, shapes, price, extra, data)
            return float(value), np.asarray(slope)

    options = {"maxiter": _ITERATIONS, "maxcor": 30, "ftol": 1e-11, "gtol": 1e-9}
    found = minimize(cost, np.zeros(segments - 1), jac=True, method="L-BFGS-B", options=options)
    return base + normal * (shapes @ found.x)[:, None]


@lru_cache(maxsize=8)
def _shapes(segments: int) -> Array:
    """Sines that vanish at both ends, each scaled by its wave length, [segments + 1, segments - 1]."""
    place, wave = np.arange(segments + 1) / segments, np.arange(1, segments)
    return np.sin(np.pi * place[:, None] * wave) / wave


def _data(problem: PathProblem, world: World) -> tuple:
    """What the descent needs of a problem, of one shape for all problems with a chart and for all without."""
    centres, reach = np.zeros((OBSTACLES, 2)), np.full(OBSTACLES, -np.inf)
    centres[: len(world.reach)], reach[: len(world.reach)] = world.centres, world.reach
    coast = world.distance, world.origin, world.pixel, world.margin
    speed = float(problem.vehicle.speed)  # type: ignore[arg-type]
    box = world.low, world.high
    return problem.environment.current, speed, problem.depart, centres, reach, coast, box


def _cost(
    amplitudes: jax.Array,
    base: jax.Array,
    normal: jax.Array,
    shapes: jax.Array,
    price: float,
    extra: float,
    data: tuple,
) -> jax.Array:
    """Travel time plus the price of missing clearance, s."""
    current, speed, depart, centres, reach, coast, box = data
    points = base + normal * (shapes @ amplitudes)[:, None]
    begin, way = points[:-1, None], jnp.diff(points, axis=0)[:, None]
    share = ((jnp.arange(_PARTS) + 0.5) / _PARTS)[:, None]
    x, y = jnp.moveaxis((begin + share * way).reshape(-1, 2), 1, 0)
    length = jnp.sqrt((way**2).sum(axis=2) + 1e-12)
    north, east = (jnp.repeat((way[..., k] / length)[:, 0], _PARTS) for k in range(2))
    length = jnp.repeat(length[:, 0], _PARTS) / _PARTS

    duration = length / speed
    for _ in range(1 if is_steady(current) else _SWEEPS):
        when = depart + jnp.cumsum(duration) - 0.5 * duration
        u, v, _ = current(x, y, jnp.zeros_like(x), when)
        along, across = u * north + v * east, u * east - v * north
        held = jnp.sqrt(jnp.maximum(speed**2 - across**2, (0.02 * speed) ** 2))
        duration = length / jnp.maximum(along + held, 0.02 * speed)

    x, y = jnp.concatenate([x, points[:, 0]]), jnp.concatenate([y, points[:, 1]])
    away = jnp.sqrt((x - centres[:, :1]) ** 2 + (y - centres[:, 1:]) ** 2 + 1e-12) - reach[:, None]
    missing = (jnp.maximum(extra - away, 0.0) ** 2).sum()
    if coast[0].size > 4:
        missing += (jnp.maximum(extra + coast[3] - _coast_distance(x, y, coast), 0.0) ** 2).sum()
    for line, low, high in ((x, box[0][0], box[1][0]), (y, box[0][1], box[1][1])):
        missing += (jnp.maximum(low - line, 0.0) ** 2 + jnp.maximum(line - high, 0.0) ** 2).sum()
    return duration.sum() + price * missing


def _coast_distance(x: jax.Array, y: jax.Array, coast: tuple[Any, ...]) -> jax.Array:
    """m, bilinear, as `World.coast_distance`."""
    raster, origin, pixel, _ = coast
    north, east = raster.shape
    i = jnp.clip((x - origin[0]) / pixel - 0.5, 0.0, north - 1.0)
    j = jnp.clip((y - origin[1]) / pixel - 0.5, 0.0, east - 1.0)
    i0 = jnp.minimum(i.astype(int), north - 2)
    j0 = jnp.minimum(j.astype(int), east - 2)
    a, b, flat, corner = i - i0, j - j0, jnp.ravel(raster), i0 * east + j0
    south = (1.0 - b) * flat[corner] + b * flat[corner + 1]
    return (1.0 - a) * south + a * ((1.0 - b) * flat[corner + east] + b * flat[corner + east + 1])


_slope = jax.jit(jax.value_and_grad(_cost))
