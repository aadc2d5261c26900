"""One ruler for all paths: travel time and clearance of a polyline in float64, apart from the planner's code.

The vehicle crabs: over ground it makes the current along the track plus what is left of its speed after the
current across the track is held. Coast and obstacles are kept off by the margins of the planner's settings.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvplan import PathConfig
from auvplan.ocean.chart import INTERPOLATION_ERROR
from auvplan.ocean.currents import is_steady
from benchmarks.path_problems import PathProblem

Array = NDArray[np.floating]

#: m, by which a limit may be missed: positions in single precision are no better.
TOLERANCE = 0.05

#: m, and the share of the length, between the points at which a path is measured, whichever is less.
STEP, STEP_SHARE = 1.0, 1.0 / 2000.0

#: Points are padded to a multiple of this, so that few programs are compiled.
_BLOCK = 4096

#: Passes that settle the times at which a path meets a changing current.
_SWEEPS = 40

#: A distance to coast that is nowhere, m.
_FAR = 1e6


@dataclass(frozen=True)
class Score:
    """A path as measured.

    Attributes:
        travel_time: s; infinite where the current cannot be held.
        feasible: whether it keeps clear of everything and can be sailed.
        clearance: m beyond the margins, the least on the way; negative where something is too near.
        length: m.
    """

    travel_time: float
    feasible: bool
    clearance: float
    length: float


@dataclass(frozen=True, eq=False)
class World:
    """What must be kept off, in NumPy float64.

    Attributes:
        low, high: [2] m, the box.
        centres: [M, 2] m, obstacles at departure; they are taken to stand.
        reach: [M] m, their collision boundaries plus the margin.
        distance: [nx, ny] m to the coast at pixel centres; [2, 2] far away where there is no chart.
        origin: [2] m, corner of the chart.
        pixel: m.
        margin: m, to be kept from the coast, the error of interpolation included.
    """

    low: Array
    high: Array
    centres: Array
    reach: Array
    distance: Array
    origin: Array
    pixel: float
    margin: float

    @classmethod
    def of(cls, problem: PathProblem) -> "World":
        """The world of a problem, with the margins of the planner's settings."""
        env, config = problem.environment, PathConfig(**problem.changes)
        active = np.asarray(env.obstacles.active)
        boundary = np.asarray(env.obstacles.boundary(jnp.asarray(problem.depart)), float)
        if env.chart is None:
            distance, origin, pixel = np.full((2, 2), _FAR), np.zeros(2), 1.0
        else:
            distance = np.asarray(env.chart.signed_distance, float)
            origin, pixel = np.asarray(env.chart.origin, float), float(env.chart.pixel_size)
        return cls(
            np.asarray(env.lower, float)[:2],
            np.asarray(env.upper, float)[:2],
            np.asarray(env.obstacles.position, float)[active, :2],
            boundary[active] + config.obstacle_margin,
            distance,
            origin,
            pixel,
            config.coast_margin + INTERPOLATION_ERROR * pixel,
        )

    def clearance(self, x: Array, y: Array) -> Array:
        """m beyond the margins to the nearest obstacle, coast or edge of the box, any shape."""
        clear = np.minimum(self.coast_distance(x, y) - self.margin, _FAR)
        for (a, b), reach in zip(self.centres, self.reach, strict=True):
            clear = np.minimum(clear, np.hypot(x - a, y - b) - reach)
        for line, low, high in ((x, self.low[0], self.high[0]), (y, self.low[1], self.high[1])):
            clear = np.minimum(clear, np.minimum(line - low, high - line) + TOLERANCE / 2)
        return clear

    def coast_distance(self, x: Array, y: Array) -> Array:
        """m to the coast, bilinear between pixel centres."""
        north, east = self.distance.shape
        i = np.clip((x - self.origin[0]) / self.pixel - 0.5, 0.0, north - 1.0)
        j = np.clip((y - self.origin[1]) / self.pixel - 0.5, 0.0, east - 1.0)
        i0, j0 = np.minimum(i.astype(int), north - 2), np.minimum(j.astype(int), east - 2)
        a, b, d = i - i0, j - j0, self.distance
        south = (1.0 - b) * d[i0, j0] + b * d[i0, j0 + 1]
        return (1.0 - a) * south + a * ((1.0 - b) * d[i0 + 1, j0] + b * d[i0 + 1, j0 + 1])


def evaluate(problem: PathProblem, positions: ArrayLike, world: World | None = None) -> Score:
    """Measure a path, a straight line between each two positions.

    Args:
        problem: what to sail; its obstacles must stand.
        positions: [n, 2] or [n, 3] m, from start to goal; depth does not matter.
        world: `World.of(problem)`, where it is at hand.
    """
    world = world or World.of(problem)
    points = np.asarray(positions, float)[:, :2]
    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points, gaps = points[np.r_[True, gaps > 0.0]], gaps[gaps > 0.0]
    step = min(STEP, STEP_SHARE * gaps.sum())
    parts = np.ceil(gaps / step).astype(int)
    segment = np.repeat(np.arange(len(gaps)), parts)
    before = np.arange(len(segment)) - np.repeat(np.cumsum(parts) - parts, parts)
    way = np.diff(points, axis=0)[segment]
    begin = points[segment] + (before / parts[segment])[:, None] * way
    middle = points[segment] + ((before + 0.5) / parts[segment])[:, None] * way
    heading, length = way / gaps[segment][:, None], (gaps / parts)[segment]

    duration, held = sail(problem, middle, heading, length)
    ends = np.asarray([problem.start, problem.goal])[:, :2]
    joined = np.abs(points[[0, -1]] - ends).max() < TOLERANCE
    marks = np.concatenate([begin, middle, points[-1:]])
    clearance = float(world.clearance(*marks.T).min())
    feasible = bool(held and joined and clearance > -TOLERANCE)
    return Score(float(duration.sum()) if held else np.inf, feasible, clearance, float(gaps.sum()))


def sail(problem: PathProblem, middle: Array, heading: Array, length: Array) -> tuple[Array, bool]:
    """Time of each of K short pieces, each at the time it is met, and whether every one can be held.

    Args:
        problem: current, speed and departure.
        middle: [K, 2] m, of each piece.
        heading: [K, 2], unit vectors.
        length: [K] m.
    """
    speed, current = float(problem.vehicle.speed), problem.environment.current  # type: ignore[arg-type]
    duration, held = length / speed, True
    for _ in range(1 if is_steady(current) else _SWEEPS):
        when = problem.depart + np.cumsum(duration) - 0.5 * duration
        u, v = current_at(current, middle[:, 0], middle[:, 1], when)
        along = u * heading[:, 0] + v * heading[:, 1]
        across = u * heading[:, 1] - v * heading[:, 0]
        ground = along + np.sqrt(np.maximum(speed**2 - across**2, 0.0))
        held = bool((np.abs(across) <= speed).all() and (ground > 0.0).all())
        last, duration = duration, length / np.maximum(ground, 1e-3 * speed)
        if np.abs(duration - last).sum() < 1e-9 * duration.sum():
            break
    return duration, held


def current_at(current: Any, x: Array, y: Array, t: Array) -> tuple[Array, Array]:
    """Current in float64 at the surface, m/s north and east; x, y, t [K] m, m, s."""
    count = len(x)
    missing = -count % _BLOCK
    padded = (np.pad(np.asarray(a, float), (0, missing)) for a in (x, y, t))
    with jax.enable_x64(True):
        u, v = _velocity(current, *padded)
        return np.asarray(u)[:count], np.asarray(v)[:count]


@jax.jit
def _velocity(current: Any, x: jax.Array, y: jax.Array, t: jax.Array) -> tuple[jax.Array, jax.Array]:
    u, v, _ = current(x, y, jnp.zeros_like(x), t)
    return u, v
