"""How a vehicle moves along P paths of S samples: ground speed, times and turn rate on planes [S, P]."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.currents import Current, Velocity, is_steady
from auvplan.ocean.environment import Environment
from auvplan.path.config import PathConfig
from auvplan.vehicle import Vehicle, along_track

#: Squared metres added under square roots: keeps gradients finite at coinciding samples.
TINY = 1e-8

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


def middle_times(
    middle: Axes,
    way: Axes,
    gap: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> jax.Array:
    """[S - 1, P] s since the epoch, when the middle of each segment of P paths is reached.

    Segment by segment: how fast the next one is depends on when. The way to its middle is taken at the
    speed of the one before.

    Args:
        middle: x, y, z, [S - 1, P] m, of segments' middles.
        way: x, y, z, [S - 1, P] m, from their first to their last ends.
        gap: [S - 1, P] m, their lengths.
        depart: s since the epoch.
        env: the world.
        vehicle: speed and limits.
        config: static settings.
    """
    if is_steady(env.current) or config.speed_reading == "eq11":
        return depart + jnp.zeros_like(gap)
    if isinstance(env.current, PacedCurrent):
        duration = jax.lax.stop_gradient(gap) / env.current.pace[:, None]
        return depart + elapsed(duration)[:-1] + 0.5 * duration

    def step(carry: tuple[jax.Array, jax.Array], segment: tuple) -> tuple[tuple, jax.Array]:
        time, speed = carry
        (x, y, z), way, gap = segment
        half_way = time + 0.5 * gap / speed
        ground = over_ground(env.current(x, y, z, half_way), way, gap, vehicle, config)[0]
        return (time + gap / ground, ground), half_way

    first = jnp.zeros_like(gap[0])
    return jax.lax.scan(step, (first + depart, first + vehicle.speed), (middle, way, gap))[1]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PacedCurrent:
    """A gradual current, and the pace at which paths are taken to be followed when it is looked up.

    Times of look-ups follow the length of a path at that pace, and derivatives stop there: slopes in control
    points count where the path leads, not that a longer one meets a later current. A search alone uses it;
    the path that it finds, and `sensitivity`, are timed segment by segment.

    Attributes:
        current: that it is.
        pace: [S - 1] m/s over ground on the segments of a path.
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


def turn_rate(dx: jax.Array, dy: jax.Array, duration: jax.Array) -> jax.Array:
    """Change of yaw per second at the start of each segment, [S - 1, P] rad/s; zero for the first.

    The turn by an angle a counts as 2 tan(a/2), the curvature of the circle that touches both segments in
    their middles. It is no less than a, equal for small turns, and needs no inverse trigonometry.
    """
    (ax, bx), (ay, by), (last, next_) = ((plane[:-1], plane[1:]) for plane in (dx, dy, duration))
    cross, dot = ax * by - ay * bx, ax * bx + ay * by
    sides = jnp.sqrt((ax * ax + ay * ay) * (bx * bx + by * by) + TINY)
    # tan(a/2) = |cross| / (sides + dot) = (sides - dot) / |cross|: each where it is well conditioned. Samples
    # that coincide, or a vertical dive, have no yaw and count as straight; a turn about as a very sharp one.
    mild = jnp.abs(cross) / (sides + jnp.maximum(dot, 0.0))
    sharp = (sides - dot) / jnp.maximum(jnp.abs(cross), 1e-3 * sides)
    rate = 2.0 * jnp.where(dot < 0.0, sharp, mild) / (0.5 * (last + next_))
    return jnp.concatenate([jnp.zeros_like(rate[:1]), rate])
