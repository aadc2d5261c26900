"""Certified clearance: how far every segment between two samples stays from coast and obstacles at the least.

An obstacle is passed at its nearest by the straight line between two samples, seen from the obstacle. For the
coast, the circles around both samples that hold no land cover what lies between.
"""

import jax
import jax.numpy as jnp

from auvplan.ocean.chart import INTERPOLATION_ERROR, Chart
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path.config import PathConfig

#: Squared metres added under square roots: keeps gradients finite at coinciding samples.
TINY = 1e-8

#: First ends (x, y, z) and the ways (x, y, z) from there, m; arrival at the first ends and durations, s.
Segments = tuple[tuple[jax.Array, ...], tuple[jax.Array, ...], jax.Array, jax.Array]


def distance_to_land(chart: Chart, x: jax.Array, y: jax.Array) -> jax.Array:
    """Certified distance to the nearest land, m: never more than the true one."""
    return chart.distance(x, y) - INTERPOLATION_ERROR * chart.pixel_size


def coast_clearance(
    x: jax.Array, y: jax.Array, gap: jax.Array, duration: jax.Array, env: Environment, config: PathConfig
) -> tuple[jax.Array, jax.Array]:
    """Certified clearance to the coast [P, S - 1] m, and the price of uncertain areas [P] s."""
    if env.chart is None:
        return jnp.full_like(gap, 1e6), jnp.zeros_like(gap[:, 0])
    distance = distance_to_land(env.chart, x, y)
    risk = 1.0 - env.chart.passability_at(x, y)
    price = config.uncertain_price * (0.5 * (risk[:, 1:] + risk[:, :-1]) * duration).sum(axis=1)
    return _between(distance[:, :-1], distance[:, 1:], gap), price


def _between(first: jax.Array, last: jax.Array, gap: jax.Array) -> jax.Array:
    """Least distance to land on segments of length `gap`, from the distances at both ends; all [P, S - 1] m.

    There is no land within either distance of its end. Where the two circles meet, at most that half of their
    common chord is certain on the segment; where they do not, half of what is missing between them.
    """
    apart = 0.5 * (first + last - gap)
    aside = (first * first - last * last + gap * gap) / (2.0 * gap)  # of the chord, from the first end
    half_chord = jnp.sqrt(jnp.maximum(first * first - aside * aside, 0.0) + TINY)
    ends = jnp.minimum(first, last)
    crossed = jnp.where((aside > 0.0) & (aside < gap), half_chord, ends)
    return jnp.where(apart > 0.0, jnp.minimum(crossed, ends), apart)


def obstacle_clearance(
    starts: tuple[jax.Array, ...],
    steps: tuple[jax.Array, ...],
    begin: jax.Array,
    duration: jax.Array,
    env: Environment,
) -> jax.Array:
    """Certified clearance of segments to the collision boundaries at the time of arrival, [P, S - 1] m.

    Args:
        starts: x, y, z of the segments' first ends, [P, S - 1] m each.
        steps: from there to the last ends, [P, S - 1] m each.
        begin: [P, S - 1] s since the epoch, arrival at the first ends.
        duration: [P, S - 1] s.
        env: the world.
    """
    shape = begin.shape
    if len(env.obstacles) == 0:
        return jnp.full(shape, 1e6, begin.dtype)
    # One long row of segments makes longer vector loops than a plane of short ones.
    segments = jax.tree.map(jnp.ravel, (starts, steps, begin, duration))
    boundary = env.obstacles.boundary(env.obstacles.observed_at)
    return _nearest(env.obstacles, boundary, segments).reshape(shape)


@jax.custom_jvp
def _nearest(obstacles: Obstacles, boundary: jax.Array, segments: Segments) -> jax.Array:
    """Least clearance of N segments to any obstacle, [N] m."""

    return _least(obstacles, boundary, segments)[0]


@_nearest.defjvp
def _nearest_jvp(primals: tuple, tangents: tuple) -> tuple[jax.Array, jax.Array]:
    """Only the nearest obstacle of each segment counts: gradients look at no other."""
    nearest = _least(*primals)[1]

    def clear(obstacles: Obstacles, boundary: jax.Array, segments: Segments) -> jax.Array:
        chosen, reach = jax.tree.map(lambda field: field[nearest], (obstacles, boundary))
        return jnp.minimum(_clear_of(chosen, reach, segments), 1e6)

    return jax.jvp(clear, primals, tangents)


def _least(obstacles: Obstacles, boundary: jax.Array, segments: Segments) -> tuple[jax.Array, jax.Array]:
    """Least clearance [N] m of segments, 1e6 at most, and the number of the obstacle that it is to, [N]."""

    def nearer(best: tuple, sphere: tuple) -> tuple[tuple, None]:
        number, which, reach = sphere
        clear = _clear_of(which, reach, segments)
        return (jnp.minimum(best[0], clear), jnp.where(clear < best[0], number, best[1])), None

    none = jnp.full_like(segments[2], 1e6), jnp.zeros(segments[2].shape, jnp.int32)
    numbered = jnp.arange(len(obstacles), dtype=jnp.int32), obstacles, boundary
    return jax.lax.scan(nearer, none, numbered)[0]


def _clear_of(sphere: Obstacles, boundary: jax.Array, segments: Segments) -> jax.Array:
    """Clearance of N segments to one sphere, or each to its own, [N] m.

    Seen from the sphere a segment is a straight line: its nearest point to the centre is exact.
    """
    starts, steps, begin, duration = segments
    since = begin - sphere.observed_at
    inner, square, length = 0.0, 0.0, TINY
    for k, (start, step) in enumerate(zip(starts, steps, strict=True)):
        away = start - sphere.position[..., k] - sphere.velocity[..., k] * since
        way = step - sphere.velocity[..., k] * duration
        inner, square, length = inner + away * way, square + away * away, length + way * way
    share = jnp.clip(-inner / length, 0.0, 1.0)
    nearest = jnp.maximum(square + share * (2.0 * inner + share * length), 0.0)
    grown = jnp.minimum(sphere.growth * jnp.maximum(since + duration, 0.0), sphere.growth_max)
    return jnp.where(sphere.active, jnp.sqrt(nearest + TINY) - grown - boundary, 1e6)
