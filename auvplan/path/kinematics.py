"""How a vehicle moves along P paths of S samples: ground speed, times and turn rate on planes [S, P]."""

from dataclasses import dataclass
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.navigation import Navigation
from auvplan.ocean.currents import Current, Velocity, is_steady
from auvplan.ocean.environment import Environment
from auvplan.path.config import PathConfig
from auvplan.vehicle import SpeedReading, Vehicle, along_track

#: Squared metres added under square roots: keeps gradients finite at coinciding samples.
TINY = 1e-8

#: Sweeps that settle the times at which a gradual current is met.
_SWEEPS = 3

#: x, y and z of many places or steps, apart, all of one shape.
Axes = tuple[jax.Array, jax.Array, jax.Array]


def inner(a: Axes, b: Axes) -> jax.Array:
    """Products of vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(*axes: jax.Array) -> jax.Array:
    """Lengths of vectors, smooth at zero."""
    return jnp.sqrt(sum((axis * axis for axis in axes), jnp.asarray(TINY, axes[0].dtype)))


def over_ground(
    water: Velocity, way: Axes, gap: jax.Array, vehicle: Vehicle, config: PathConfig
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Ground speed, current across the track, both m/s, and shortfall of segments.

    Args:
        water: u, v, w, m/s, in segments' middles; any shape, the same for all.
        way: x, y, z, m, from their first to their last ends.
        gap: m, their lengths.
        vehicle: speed and limits.
        config: static settings.
    """
    along = inner(water, way) / gap
    across = jnp.sqrt(jnp.maximum(inner(water, water) - along * along, 0.0) + TINY)
    ground, shortfall = along_track(config.speed_reading, vehicle.speed, along, across)
    return ground, across, shortfall


def parts_of(count: int) -> tuple[float, ...]:
    """Return the middles of equal parts of a segment, as shares of it."""
    return tuple((k + 0.5) / count for k in range(count))


def at_shares(middle: jax.Array, step: jax.Array, shares: tuple[float, ...]) -> jax.Array:
    """Return what has a value in segments' middles at C shares of them, [C, ...]; at one without that axis.

    Args:
        middle: values in the middles; any shape.
        step: by how much values differ from a segment's first to its last end.
        shares: C of them, from 0 to 1; one alone is the middle.
    """
    if len(shares) == 1:
        return middle
    off = jnp.asarray(np.subtract(shares, 0.5), middle.dtype)
    return middle + off.reshape(-1, *(1,) * middle.ndim) * step


def places_met(middle: Axes, way: Axes, shares: tuple[float, ...]) -> Axes:
    """Return x, y, z, m, at C shares of segments, as `at_shares`, from their middles and ways, m."""
    x, y, z = (at_shares(*plane, shares) for plane in zip(middle, way, strict=True))
    return x, y, z


def mean_met(plane: jax.Array, count: int) -> jax.Array:
    """Return the mean over the C places at which segments meet the current."""
    return plane if count == 1 else plane.mean(axis=0)


def most_met(plane: jax.Array, count: int) -> jax.Array:
    """Return the greatest value at the C places at which segments meet the current.

    Two by two: the slope of a maximum along an axis is that of the value equal to it, and where a compiler
    computes the values twice it may round them so that none is equal.
    """
    return plane if count == 1 else reduce(jnp.maximum, [plane[k] for k in range(count)])


def pace_met(ground: jax.Array, count: int) -> jax.Array:
    """Return the speed of segments, m/s, each equal part of which is passed at its own speed over ground."""
    return ground if count == 1 else 1.0 / (1.0 / ground).mean(axis=0)


def vertical_speeds(
    water: Velocity, way: Axes, gap: jax.Array, ground: jax.Array, vehicle: Vehicle, reading: SpeedReading
) -> dict[str, tuple[jax.Array, jax.Array]]:
    """Vertical speeds of segments and the vehicle's limits on them, m/s, by `VERTICAL_LIMITS` that it has.

    The pitch theta is the hull's: |v| sin(theta) is the vertical speed through the water in the reading
    "track"; in the others the hull points along the segment (see `Motion.along`). Climbs and dives are those
    over ground.

    Args:
        water: u, v, w, m/s; any shape, the same for all; arrays of JAX or of NumPy, as the results will be.
        way: x, y, z, m, from segments' first to their last ends.
        gap: m, their lengths.
        ground: m/s, speed over ground.
        vehicle: speed and limits.
        reading: of the speed.
    """
    limits = vehicle.vertical_limits
    if not limits:
        return {}
    xp: Any = np if isinstance(gap, np.ndarray) else jnp
    slope = way[2] / gap
    down = ground * slope
    hull = xp.broadcast_to(xp.asarray(vehicle.speed) * slope, down.shape)
    sinking = down - water[2] if reading == "track" else hull
    speeds = {"pitch": xp.abs(sinking), "climb": -down, "dive": down}
    return {name: (speeds[name], limit) for name, limit in limits.items()}


def times_met(
    places: Axes,
    way: Axes,
    gap: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> jax.Array:
    """Return s since the epoch when the C places of the segments of P paths are reached, as `places`.

    Each is in the middle of an equal part of its segment; parts are gone along `in_turn`.

    Args:
        places: x, y, z, [C, S - 1, P] m, where the current is met; [S - 1, P] where C is 1.
        way: x, y, z, [S - 1, P] m, from segments' first to their last ends.
        gap: [S - 1, P] m, their lengths.
        depart: s since the epoch.
        env: the world.
        vehicle: speed and limits.
        config: static settings.
    """
    if is_steady(env.current) or config.speed_reading == "eq11":
        return depart + jnp.zeros_like(places[0])
    count = config.quadrature or 1

    def middles_at(duration: jax.Array) -> jax.Array:
        """[C, S - 1, P] s since the epoch, as places, where segments last [S - 1, P] s."""
        middle = depart + elapsed(duration)[:-1] + 0.5 * duration
        return at_shares(middle, duration, parts_of(count))

    if isinstance(env.current, PacedCurrent):
        duration = gap / env.current.pace[:, None]
        for _ in range(_SWEEPS):
            when = middles_at(duration)
            ground = over_ground(env.current(*places, when), way, gap, vehicle, config)[0]
            duration = gap / pace_met(ground, count)
        return middles_at(duration)

    def in_order(plane: jax.Array) -> jax.Array:
        """[(S - 1) C, P], part after part."""
        planes = plane if plane.ndim == 3 else jnp.broadcast_to(plane, (count, *plane.shape))
        return planes.swapaxes(0, 1).reshape(-1, plane.shape[-1])

    way = way[0] / count, way[1] / count, way[2] / count
    middle, way, parts = jax.tree.map(in_order, (places, way, gap / count))
    when = in_turn(middle, way, parts, depart, env.current, vehicle, config)[1]
    return when if count == 1 else when.reshape(len(gap), count, -1).swapaxes(0, 1)


def in_turn(
    middle: Axes,
    way: Axes,
    gap: jax.Array,
    depart: jax.Array,
    current: Current,
    vehicle: Vehicle,
    config: PathConfig,
) -> tuple[jax.Array, jax.Array]:
    """Go along N straight parts one after the other; how fast the next one is depends on when.

    The way to the middle of each is taken at a speed extrapolated from those of the two before.

    Args:
        middle: x, y, z, [N, ...] m, where the current of each is met.
        way: x, y, z, [N, ...] m, from their first to their last ends.
        gap: [N, ...] m, their lengths.
        depart: s since the epoch.
        current: that it is.
        vehicle: speed and limits.
        config: static settings.

    Returns:
        ``(lasts [...], when [N, ...])``: s that all parts take, and s since the epoch at their middles.
    """

    def step(carry: tuple[jax.Array, ...], part: tuple) -> tuple[tuple, jax.Array]:
        time, speed, before = carry
        (x, y, z), way, gap = part
        # From the middle of the last part to that of this one's first half it is 3/4 of a part.
        onward = jnp.clip(speed + 0.75 * (speed - before), 0.5 * speed, 2.0 * speed)
        when = depart + (time + 0.5 * gap / onward)
        ground = over_ground(current(x, y, z, when), way, gap, vehicle, config)[0]
        return (time + gap / ground, ground, speed), when

    # Counted from the departure: days after the epoch single precision has no small parts of a second.
    first = jnp.zeros_like(gap[0])
    begin = first, first + vehicle.speed, first + vehicle.speed
    (lasts, _, _), when = jax.lax.scan(step, begin, (middle, way, gap))
    return lasts, when


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PacedCurrent:
    """A gradual current, and the pace from which the times are settled at which paths meet it.

    All segments are looked up at the times of that pace, those times are found again from the speeds there,
    and so on: each sweep makes exact what the one before left to the current's change in the error of its
    times (Picard's iteration). That spares a search the timing of segments one after the other.

    Attributes:
        current: that it is.
        pace: [S - 1] m/s over ground on the segments of a path, to begin with.
    """

    current: Current
    pace: jax.Array

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        return self.current(x, y, z, t)


def elapsed(durations: jax.Array) -> jax.Array:
    """[S, P] s since departure at each sample, from durations [S - 1, P].

    A triangular product is quicker than a scan at this length.
    """
    ones = np.tril(np.ones((durations.shape[0] + 1, durations.shape[0])), -1)
    return jnp.matmul(jnp.asarray(ones, durations.dtype), durations, precision=jax.lax.Precision.HIGHEST)


def navigated(places: Axes, durations: jax.Array, env: Environment, vehicle: Vehicle) -> Navigation | None:
    """How well a vehicle knows where it is at the ends of segments, [S - 1, P]; None where it does exactly.

    It is in bottom lock where both ends of a segment are no higher above the sea bed than that reaches.

    Args:
        places: x, y, z, [S, P] m, samples.
        durations: [S - 1, P] s, of the segments between them.
        env: the world.
        vehicle: its speed and its navigation, at the first samples.
    """
    known = vehicle.navigation
    if known is None:
        return None
    passed = unlocked = elapsed(durations)[1:]
    if known.bottom_lock is not None and env.seabed is not None:
        above = env.seabed.depth_at(places[0], places[1]) - places[2]
        locked = jnp.maximum(above[1:], above[:-1]) <= known.bottom_lock
        unlocked = elapsed(jnp.where(locked, 0.0, durations))[1:]
    return known.after(vehicle.speed * passed, unlocked)


#: Odd polynomial for the arctangent on [0, 1], lowest power first; relative error 1e-7 (least maximum).
_ARCTANGENT = (
    0.9999999011, -0.3333199117, 0.1996972852, -0.1401950283, 0.0991434463, -0.0594870867, 0.0242528623,
    -0.0046933976,
)  # fmt: skip


def turn_rate(dx: jax.Array, dy: jax.Array, duration: jax.Array) -> jax.Array:
    """Compute the turn rate of the course at the start of each segment, [S - 1, P] rad/s; the first is zero.

    It is the angle between two segments, at most pi, over the time between their middles.

    Args:
        dx, dy: [S - 1, P] m, north and east from the first to the last end of each segment.
        duration: [S - 1, P] s.
    """
    (ax, bx), (ay, by), (last, next_) = ((plane[:-1], plane[1:]) for plane in (dx, dy, duration))
    rate = angle_between(ax * by - ay * bx, ax * bx + ay * by) / (0.5 * (last + next_))
    return jnp.concatenate([jnp.zeros_like(rate[:1]), rate])


def winding_length(level: Any, wanted: Any, tightest: Any) -> Any:
    """Level length, m, of the shortest arc between two points that is at least as long as wanted.

    What is too long for the minor arc of the tightest circle through both and too short for the major one no
    arc can be: back to the same point that is all of a circle. Arrays of JAX or of NumPy.

    Args:
        level: m, apart on the map.
        wanted: m, at least; at most `level` where the straight line serves.
        tightest: m, radius of the circle.
    """
    xp: Any = jnp if isinstance(level, jax.Array) else np
    minor = xp.arcsin(xp.minimum(0.5 * level / tightest, 1.0))
    short, long = 2.0 * tightest * minor, 2.0 * tightest * (np.pi - minor)
    return xp.where(wanted > xp.maximum(short, level), xp.maximum(wanted, long), wanted)


@jax.custom_jvp
def angle_between(cross: jax.Array, dot: jax.Array) -> jax.Array:
    """Compute the angle between two level vectors from their products, m2; any shape, rad in [0, pi].

    It fades to zero where both are shorter than a centimetre: samples that coincide, or a vertical dive, have
    no yaw and count as straight. By a polynomial, since XLA calls its arctangent of two arguments for one
    number at a time on a CPU.
    """
    return _angle_with_slopes(cross, dot)[0]


@angle_between.defjvp
def _angle_jvp(primals: tuple, tangents: tuple) -> tuple[jax.Array, jax.Array]:
    """Keep gradients finite: zero where the vectors are parallel, or of no length."""
    angle, of_cross, of_dot = _angle_with_slopes(*primals)
    return angle, of_cross * tangents[0] + of_dot * tangents[1]


def _angle_with_slopes(cross: jax.Array, dot: jax.Array) -> tuple[jax.Array, ...]:
    """`angle_between`, and its slopes along both arguments."""
    aside, ahead = jnp.abs(cross), jnp.abs(dot)
    share = jnp.minimum(aside, ahead) / jnp.maximum(jnp.maximum(aside, ahead), TINY)
    square = share * share
    angle = jnp.full_like(share, _ARCTANGENT[-1])
    for factor in _ARCTANGENT[-2::-1]:
        angle = angle * square + factor
    angle = angle * share
    angle = jnp.where(aside > ahead, 0.5 * jnp.pi - angle, angle)
    angle = jnp.where(dot < 0.0, jnp.pi - angle, angle)
    over = 1.0 / (aside * aside + ahead * ahead + TINY)
    fading = 2.0 * TINY * over * angle
    of_cross = over * (jnp.sign(cross) * dot + fading * cross)
    return angle * (1.0 - TINY * over), of_cross, over * (fading * dot - aside)
