"""One ruler for all paths, apart from the planner: travel time, clearance and limits in float64.

The vehicle crabs: over ground it makes the current along the track plus what is left of its speed after the
current across the track is held. Coast, obstacles and sea bed are kept off by the margins of the planner's
settings; obstacles that move are where they are when the vehicle arrives.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvplan import PathConfig
from auvplan.ocean.chart import INTERPOLATION_ERROR
from auvplan.ocean.currents import is_steady
from auvplan.ocean.obstacles import CONFIDENCE
from benchmarks.harness import Array
from benchmarks.paths.problems import PathProblem

#: Share of the box's longer side by which a clearance may be missed: single precision is no better.
TOLERANCE = 5e-6

#: Share by which limits of the vehicle may be broken: planners judge them in the middle of each segment.
LIMIT_TOLERANCE = 0.01

#: Shares of the box's longer side and of the path between the points at which it is measured, the lesser.
STEP, STEP_SHARE = 1e-4, 1.0 / 2000.0

#: Points are padded to a multiple of this, so that few programs are compiled.
_BLOCK = 4096

#: Passes that settle the times at which a path meets a changing current.
_SWEEPS = 40

#: A distance to coast that is nowhere, m.
_FAR = 1e6

#: m, level length below which a segment has no yaw.
_UPRIGHT = 0.01


@dataclass(frozen=True)
class Score:
    travel_time: float  # s; infinite where the current cannot be held
    # whether it keeps clear of everything, keeps the vehicle's limits and makes way everywhere
    feasible: bool
    clearance: float  # m beyond the margins, the least on the way; negative where something is too near
    length: float  # m
    # greatest share by which ground speed, current across the track, turn rate or pitch exceed their limits,
    # the last as speed up or down through the water; negative where all are kept
    excess: float


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Spheres:
    """M obstacles in linear motion."""

    centres: Array  # [M, 3] m, when last observed
    velocity: Array  # [M, 3] m/s, drift included
    reach: Array  # [M] m, collision boundaries when last observed plus the margin
    growth: Array  # [M] m/s
    growth_max: Array  # [M] m
    observed_at: Array  # [M] s

    @classmethod
    def of(cls, problem: PathProblem) -> "Spheres":
        """Return the active obstacles; the current where and when they were last observed carries them on."""
        found, config = problem.environment.obstacles, PathConfig(**problem.changes)
        active = np.asarray(found.active)
        names = "position velocity drift radius position_std radius_std growth growth_max observed_at"
        position, own, drift, radius, position_std, radius_std, growth, growth_max, observed_at = (
            np.asarray(getattr(found, name), float)[active] for name in names.split()
        )
        carried = np.zeros((len(radius), 3))
        if drift.any():
            water = velocity_at(problem.environment.current, *position.T, observed_at)
            carried = drift[:, None] * np.stack(water, axis=1)
        reach = radius + CONFIDENCE * np.hypot(position_std, radius_std) + config.obstacle_margin
        return cls(position, own + carried, reach, growth, growth_max, observed_at)

    def __len__(self) -> int:
        return len(self.reach)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """[M], whether each moves or grows."""
        return (np.abs(self.velocity).sum(axis=1) > 0.0) | ((self.growth > 0.0) & (self.growth_max > 0.0))

    def chosen(self, which: NDArray[np.bool_]) -> "Spheres":
        return Spheres(*(field[which] for field in vars(self).values()))

    def clearance(self, x: Array, y: Array, z: ArrayLike, t: ArrayLike) -> Array:
        """Return m to the nearest, at the times t [s]; `_FAR` without any. In JAX where x is of JAX."""
        xp: Any = jnp if isinstance(x, jax.Array) else np
        clear = xp.full(np.shape(x), _FAR)
        for (a, b, c), (u, v, w), reach, growth, most, seen in zip(*vars(self).values(), strict=True):
            since = xp.asarray(t) - seen
            grown = xp.minimum(growth * xp.maximum(since, 0.0), most)
            level = xp.hypot(x - a - u * since, y - b - v * since)
            clear = xp.minimum(clear, xp.hypot(level, z - c - w * since) - reach - grown)
        return clear


class Raster(NamedTuple):
    """Values between which a look-up is bilinear."""

    values: Array  # [nx, ny] at pixel centres
    origin: Array  # [2] m, its corner
    pixel: float  # m

    @classmethod
    def of(cls, placed: Any, values: ArrayLike) -> "Raster":
        return cls(np.asarray(values, float), np.asarray(placed.origin, float), float(placed.pixel_size))

    def at(self, x: Array, y: Array) -> Array:
        """Look up places [m]; beyond the outer centres the nearest holds. In JAX where x is of JAX."""
        xp: Any = jnp if isinstance(x, jax.Array) else np
        north, east = self.values.shape
        i = xp.clip((x - self.origin[0]) / self.pixel - 0.5, 0.0, north - 1.0)
        j = xp.clip((y - self.origin[1]) / self.pixel - 0.5, 0.0, east - 1.0)
        i0, j0 = xp.minimum(i.astype(int), north - 2), xp.minimum(j.astype(int), east - 2)
        a, b, v = i - i0, j - j0, xp.asarray(self.values)
        south = (1.0 - b) * v[i0, j0] + b * v[i0, j0 + 1]
        return (1.0 - a) * south + a * ((1.0 - b) * v[i0 + 1, j0] + b * v[i0 + 1, j0 + 1])


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class World:
    """What must be kept off, in NumPy float64."""

    low: Array  # [3] m, the box
    high: Array  # [3] m, the box
    spheres: Spheres  # the obstacles, the margin included
    coast: Raster  # m to the coast; far away where there is no chart
    margin: float  # m, to be kept from the coast, the error of interpolation included
    bed: Raster  # m, greatest depth that the sea bed allows; far down without

    @classmethod
    def of(cls, problem: PathProblem) -> "World":
        env, config = problem.environment, PathConfig(**problem.changes)
        coast = bed = Raster(np.full((2, 2), _FAR), np.zeros(2), 1.0)
        if env.chart is not None:
            coast = Raster.of(env.chart, env.chart.signed_distance)
        if env.seabed is not None:
            bed = Raster.of(env.seabed, np.asarray(env.seabed.depth, float) - float(env.seabed.clearance))
        margin = config.coast_margin + INTERPOLATION_ERROR * coast.pixel
        low, high = np.asarray(env.lower, float), np.asarray(env.upper, float)
        return cls(low, high, Spheres.of(problem), coast, margin, bed)

    @property
    def side(self) -> float:
        """Longest side of the box, m."""
        return float((self.high - self.low).max())

    @property
    def tolerance(self) -> float:
        """Clearance that may be missed, m."""
        return TOLERANCE * self.side

    def clearance(self, x: Array, y: Array, t: ArrayLike | None = None, z: Array | None = None) -> Array:
        """Return m beyond the margins to the nearest obstacle, coast, sea bed or edge of the box, any shape.

        Args:
            x, y: m.
            t: s; None leaves out obstacles that move.
            z: m; None for the box's least depth.
        """
        z = np.full(np.shape(x), self.low[2]) if z is None else z
        clear = np.minimum(self.coast.at(x, y) - self.margin, _FAR)
        clear = np.minimum(clear, self.bed.at(x, y) - z)
        spheres = self.spheres.chosen(~self.spheres.moving) if t is None else self.spheres
        clear = np.minimum(clear, spheres.clearance(x, y, z, 0.0 if t is None else t))
        for line, low, high in zip((x, y, z), self.low, self.high, strict=True):
            inside = np.minimum(line - low, high - line)
            # A box of one depth leaves no room: there is nothing to be near to.
            least = _FAR if low == high else 0.0
            clear = np.minimum(
                clear, np.where(inside >= 0.0, np.maximum(inside, least), inside) + self.tolerance / 2
            )
        return clear


def evaluate(problem: PathProblem, positions: ArrayLike, world: World | None = None) -> Score:
    """Measure a path, a straight line between each two positions.

    A turn between two lines is spread over the second half of the one and the first half of the other.

    Args:
        positions: [n, 3] m, from start to goal; [n, 2] where the box has one depth only.
        world: `World.of(problem)`, where it is at hand.
    """
    world = world or World.of(problem)
    points = np.asarray(positions, float)
    if points.shape[1] == 2:
        points = np.column_stack([points, np.full(len(points), world.low[2])])
    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points, gaps = points[np.r_[True, gaps > 0.0]], gaps[gaps > 0.0]
    step = min(STEP * world.side, STEP_SHARE * gaps.sum())
    parts = np.ceil(gaps / step).astype(int)
    segment = np.repeat(np.arange(len(gaps)), parts)
    before = np.arange(len(segment)) - np.repeat(np.cumsum(parts) - parts, parts)
    way = np.diff(points, axis=0)[segment]
    begin = points[segment] + (before / parts[segment])[:, None] * way
    middle = points[segment] + ((before + 0.5) / parts[segment])[:, None] * way
    heading, length = way / gaps[segment][:, None], (gaps / parts)[segment]

    duration, ground, across, upright = _traversed(problem, middle, heading, length)
    ends = np.asarray([problem.start, problem.goal])
    joined = np.abs(points[[0, -1]] - ends).max() < world.tolerance
    times = problem.depart + np.concatenate([[0.0], np.cumsum(duration)])
    marks = np.concatenate([begin, middle, points[-1:]])
    when = np.concatenate([times[:-1], 0.5 * (times[:-1] + times[1:]), times[-1:]])
    x, y, z = marks.T
    clearance = float(world.clearance(x, y, when, z).min())

    vehicle = problem.vehicle
    spent = np.bincount(segment, duration)
    turn = _turns(np.diff(points, axis=0)) / (0.5 * (spent[1:] + spent[:-1]))
    limits = (
        (ground, vehicle.surge_max), (across, vehicle.sway_max), (turn, vehicle.turn_rate_max),
        (upright, upright_max(problem)),
    )  # fmt: skip
    excess = max(float(np.max(value, initial=0.0)) / float(limit) - 1.0 for value, limit in limits)
    held = bool((across <= float(vehicle.speed)).all() and (ground > 0.0).all())
    feasible = held and joined and clearance > -world.tolerance and excess <= LIMIT_TOLERANCE
    travel_time = float(duration.sum()) if held else np.inf
    return Score(travel_time, bool(feasible), clearance, float(gaps.sum()), excess)


def upright_max(problem: PathProblem) -> float:
    """Return the greatest speed up or down through the water that the limit on pitch leaves, m/s."""
    vehicle = problem.vehicle
    return np.inf if vehicle.pitch_max is None else float(vehicle.speed * np.sin(vehicle.pitch_max))


def _turns(way: Array) -> Array:
    """Angle of yaw [n - 1] rad between segments [n, 3] m; none where one of them is upright."""
    turn = np.diff(np.arctan2(way[:, 1], way[:, 0]))
    upright = np.hypot(way[:, 0], way[:, 1]) < _UPRIGHT
    turn = np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi)
    return np.where(upright[1:] | upright[:-1], 0.0, turn)


def _traversed(
    problem: PathProblem, middle: Array, heading: Array, length: Array
) -> tuple[Array, Array, Array, Array]:
    """Time each of K pieces, one after the other, each at the time at which it is reached.

    Args:
        middle: [K, 3] m, of each piece.
        heading: [K, 3], unit vectors.
        length: [K] m.

    Returns:
        [K] each: s on the piece; speed over ground, current across the track, and speed up or down through
        the water, m/s.
    """
    speed, current = float(problem.vehicle.speed), problem.environment.current
    duration = length / speed
    for _ in range(1 if is_steady(current) else _SWEEPS):
        last = duration
        when = problem.depart + np.cumsum(last) - 0.5 * last
        water = np.stack(velocity_at(current, *middle.T, when), axis=1)
        along = (water * heading).sum(axis=1)
        across = np.linalg.norm(water - along[:, None] * heading, axis=1)
        ground = along + np.sqrt(np.maximum(speed**2 - across**2, 0.0))
        upright = np.abs(ground * heading[:, 2] - water[:, 2])
        duration = length / np.maximum(ground, 1e-3 * speed)
        if np.abs(duration - last).sum() < 1e-9 * last.sum():
            break
    return duration, ground, across, upright


def velocity_at(current: Any, x: Array, y: Array, z: Array, t: Array) -> tuple[Array, Array, Array]:
    """Current in float64, m/s north, east and down; x, y, z, t [K] m and s."""
    count = len(x)
    missing = -count % _BLOCK
    padded = (np.pad(np.asarray(a, float), (0, missing)) for a in (x, y, z, t))
    with jax.enable_x64(True):
        u, v, w = (np.asarray(part)[:count] for part in _velocity(current, *padded))
    return u, v, w


@jax.jit
def _velocity(current: Any, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> tuple[jax.Array, ...]:
    return tuple(jnp.broadcast_to(part, x.shape) for part in current(x, y, z, t))
