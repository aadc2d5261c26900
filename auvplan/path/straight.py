"""Straight lines, timed and certified in short steps, whatever their length."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.ocean.environment import Environment
from auvplan.ocean.vortices import padded, rounded_up
from auvplan.path.clearance import bed_altitude, closed_clearance, coast_clearance, obstacle_clearance
from auvplan.path.config import PathConfig
from auvplan.path.kinematics import Axes, inner, norm, vertical_speeds
from auvplan.runtime.compiled import compiled
from auvplan.vehicle import VERTICAL_LIMITS, SpeedReading, Vehicle, along_track

Array = NDArray[np.floating]

#: m, longest step on a straight segment at which current and clearance are looked at.
STEP = 20.0

#: Steps that one compiled call evaluates: two shapes serve lines of every length.
_TOGETHER = 512, 8192

#: Steps that are held in memory at once, besides those of one more line: half a kilobyte each.
_AT_ONCE = 2**19

#: s, by which arrival times may still change when a path is said to be timed; and passes at most.
_SETTLED, _PASSES = 0.01, 12

#: Parts of a step at whose ends the distance to the coast is looked up: it is certain to a hair then.
_LOOKS = 4

#: How many rows of `Steps.room` are distances; the last of these is the altitude above the sea bed.
DISTANCES = 3

_CONFIG = PathConfig()


@dataclass(frozen=True)
class Steps:
    """Straight lines in a row, followed in N steps.

    Attributes:
        times: [N + 1] s since the epoch, at the ends of the steps.
        room: [limits, N], how far each step keeps from every limit: certified distances to the coast and to
            areas that are closed then, to collision boundaries, and above the sea bed, m; then what is left
            to the vehicle's limits on current across, speed over ground and way made, and on the vertical
            speeds of pitch, climb and dive, m/s; infinite where it has no such limit.
        water: [N, 3] m/s north, east, down, the current in the middle of each step.
    """

    times: Array
    room: Array
    water: Array


@dataclass(frozen=True)
class Straights:
    """What straight lines lead through.

    Attributes:
        env: the world.
        vehicle: speed and limits.
        reading: of the speed.
    """

    env: Environment
    vehicle: Vehicle
    reading: SpeedReading = "track"

    @classmethod
    def through(cls, env: Environment, vehicle: Vehicle, reading: SpeedReading = "track") -> "Straights":
        """Return the same for an environment as it is given; any `Current` will do."""
        obstacles = env.obstacles.padded(rounded_up(len(env.obstacles)))
        env = replace(env, current=padded(env.current), obstacles=obstacles)
        return cls(env, vehicle.without_power(), reading)

    def follow(self, places: Array, depart: float, step: float = STEP) -> tuple[Steps, "Cut"]:
        """Follow lines that join places [K, 3] m, departing at a time, s since the epoch."""
        first, last = places[:-1], places[1:]
        gaps = np.linalg.norm(last - first, axis=1)
        arrivals = depart + np.concatenate([[0.0], np.cumsum(gaps / float(np.asarray(self.vehicle.speed)))])
        # Steps depend on when they are taken, and that on those before: each pass gets more of them right.
        cut = Cut.of(first, last, step)
        ends = np.interp(np.arange(len(cut.line) + 1), [*cut.offsets, len(cut.line)], arrivals)
        for _ in range(_PASSES):
            duration, room, water = self._evaluate(cut, 0.5 * (ends[:-1] + ends[1:]))
            before, ends = ends, depart + np.concatenate([[0.0], np.cumsum(duration)])
            if np.abs(ends - before).max() < _SETTLED:
                break
        return Steps(ends, room, water), cut

    def arrivals(self, places: Array, depart: float) -> tuple[Array, Array]:
        """Arrival [K] s at K places in a row, joined by straight lines, and the least room [limits]."""
        steps, cut = self.follow(places, depart)
        return steps.times[[*cut.offsets, len(cut.line)]], steps.room.min(axis=1)

    def pass_lines(self, first: Array, last: Array, begin: Array, passing: Array) -> tuple[Array, Array]:
        """Durations [L] s of L lines, and their least room [limits, L].

        Args:
            first, last: [L, 3] m, their ends.
            begin: [L] s since the epoch, when each is begun.
            passing: [L] s that each is taken to last, which says when its steps are taken.
        """
        blocks = np.cumsum(_steps_of(first, last, STEP)) // _AT_ONCE
        durations, rooms = [], []
        for own in np.split(np.arange(len(first)), np.flatnonzero(np.diff(blocks)) + 1):
            cut = Cut.of(first[own], last[own])
            when = begin[own][cut.line] + cut.middle * passing[own][cut.line]
            duration, room, _ = self._evaluate(cut, when)
            durations.append(np.add.reduceat(duration, cut.offsets))
            rooms.append(np.minimum.reduceat(room, cut.offsets, axis=1))
        return np.concatenate(durations), np.concatenate(rooms, axis=1)

    def _evaluate(self, cut: "Cut", time: Array) -> tuple[Array, Array, Array]:
        """Durations [N] s of all steps, `Steps.room` and `Steps.water`, in calls of few shapes."""
        rows = np.concatenate([cut.start, cut.way, time[:, None]], axis=1)
        together = next((most for most in _TOGETHER if most >= len(rows)), _TOGETHER[-1])
        missing = -len(rows) % together
        # The last step, again and again, fills the last call up.
        rows = np.concatenate([rows, np.broadcast_to(rows[-1:], (missing, 7))]).astype(np.float32)
        found = []
        for part in np.split(rows, len(rows) // together):
            x, y, z, dx, dy, dz, when = (np.ascontiguousarray(column) for column in part.T)
            step = (x, y, z), (dx, dy, dz), when
            found.append(_steps(*step, self.env, self.vehicle, reading=self.reading))  # type: ignore[arg-type]
        duration, room, water = (
            np.concatenate(parts, axis=-1)[..., : len(time)].astype(float)
            for parts in zip(*jax.device_get(found), strict=True)
        )
        return duration, room, water.T


@dataclass(frozen=True)
class Cut:
    """Straight lines cut into steps, one line after the other.

    Attributes:
        line: [N], which line a step belongs to.
        offsets: [L], the first step of each line.
        start: [N, 3] m, first ends.
        way: [N, 3] m, to the last ends.
        middle: [N], share of the line that is behind in the middle of a step.
    """

    line: NDArray[np.intp]
    offsets: NDArray[np.intp]
    start: Array
    way: Array
    middle: Array

    @classmethod
    def of(cls, first: Array, last: Array, step: float = STEP) -> "Cut":
        """Cut L lines between ends [L, 3] m."""
        count = _steps_of(first, last, step)
        offsets = np.concatenate([[0], np.cumsum(count)[:-1]])
        line = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(line)) - offsets[line]) / count[line]
        way = ((last - first) / count[:, None])[line]
        start = first[line] + share[:, None] * (last - first)[line]
        return cls(line, offsets, start, way, share + 0.5 / count[line])


def _steps_of(first: Array, last: Array, step: float) -> NDArray[np.intp]:
    """Return into how many steps, of at most `step` m, lines between ends [L, 3] m are cut."""
    return np.maximum(np.ceil(np.linalg.norm(last - first, axis=1) / step), 1.0).astype(int)


def _room(
    segments: tuple[Axes, Axes, jax.Array, jax.Array], speeds: Sequence[ArrayLike], env: Environment
) -> jax.Array:
    """Return `Steps.room` [limits, N].

    Args:
        segments: first ends x, y, z and ways x, y, z, [N] m; times at the first ends and durations, [N] s.
        speeds: what is left to the vehicle's limits, [N] m/s each.
        env: the world, obstacles resolved.
    """
    starts, way, begin, duration = segments
    share = jnp.linspace(0.0, 1.0, _LOOKS + 1)[:, None]
    x, y, z = (first + share * step for first, step in zip(starts, way, strict=True))
    parts = jnp.broadcast_to(norm(way[0], way[1]) / _LOOKS, x[1:].shape)
    coast, _ = coast_clearance(x, y, parts, jnp.broadcast_to(duration / _LOOKS, parts.shape), env, _CONFIG)
    if env.closures:
        coast = jnp.minimum(coast, closed_clearance(x, y, parts, begin + share * duration, env))
    altitude = bed_altitude(x, y, z, parts, env).min(axis=0)
    return jnp.stack([coast.min(axis=0), obstacle_clearance(segments, env), altitude, *speeds])


@partial(compiled, static_argnames=("reading",))
def _steps(
    starts: Axes, way: Axes, time: jax.Array, env: Environment, vehicle: Vehicle, reading: SpeedReading
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Durations of steps [N] s whose middles are passed at a time [N] s, `Steps.room`, and the current."""
    env = replace(env, obstacles=env.obstacles.resolved(env.current))
    x, y, z = (first + 0.5 * step for first, step in zip(starts, way, strict=True))
    water, gap = env.current(x, y, z, time), norm(*way)
    along = inner(water, way) / gap
    across = jnp.sqrt(jnp.maximum(inner(water, water) - along * along, 0.0))
    ground, shortfall = along_track(reading, vehicle.speed, along, across)
    duration = gap / ground
    vertical = vertical_speeds(water, way, gap, ground, vehicle, reading)
    without = jnp.zeros_like(gap), jnp.asarray(jnp.inf)
    pairs = (vertical.get(name, without) for name in VERTICAL_LIMITS)
    steep = (limit - speed for speed, limit in pairs)
    speeds = vehicle.sway_max - across, vehicle.surge_max - ground, -shortfall, *steep
    room = _room((starts, way, time - 0.5 * duration, duration), speeds, env)
    return duration, room, jnp.stack([jnp.broadcast_to(axis, gap.shape) for axis in water])
