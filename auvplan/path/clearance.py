"""Certified clearance: how far every segment between two samples stays from coast, obstacles and sea bed.

An obstacle is passed at its nearest by the straight line between two samples, seen from the obstacle. For the
coast, the circles around both samples that hold no land cover what lies between; for the sea bed, the circles
around both in which it is nowhere shallower.
"""

from dataclasses import dataclass
from functools import partial, reduce

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.chart import INTERPOLATION_ERROR, Chart
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path.config import PathConfig
from auvplan.path.kinematics import TINY, Axes, inner, norm
from auvplan.runtime.compiled import compiled
from auvplan.runtime.pytree import instantiated, is_symbolic_zero

#: Obstacles passed in one go of the loop: fewer, longer steps; more only makes compilation longer.
_UNROLL = 2

#: Of N segments: first ends (x, y, z) and the ways (x, y, z) from there, m; arrival at the first ends and
#: durations, s.
Segments = tuple[Axes, Axes, jax.Array, jax.Array]


def distance_to_land(chart: Chart, x: jax.Array, y: jax.Array) -> jax.Array:
    """Certified distance to the nearest land, m: never more than the true one."""
    return chart.distance(x, y) - INTERPOLATION_ERROR * chart.pixel_size


def coast_clearance(
    x: jax.Array, y: jax.Array, gap: jax.Array, duration: jax.Array, env: Environment, config: PathConfig
) -> tuple[jax.Array, jax.Array]:
    """Certified clearance of segments to the coast [S - 1, P] m, and the price of uncertain areas [P] s.

    Args:
        x, y: [S, P] m, samples.
        gap: [S - 1, P] m, level lengths of the segments between them.
        duration: [S - 1, P] s.
        env: the world.
        config: static settings.
    """
    if env.chart is None:
        return jnp.full_like(gap, jnp.inf), jnp.zeros(gap.shape[1:], gap.dtype)
    distance = distance_to_land(env.chart, x, y)
    risk = 1.0 - env.chart.passability_at(x, y)
    price = config.uncertain_price * (0.5 * (risk[1:] + risk[:-1]) * duration).sum(axis=0)
    return between_circles(distance[:-1], distance[1:], gap), price


def closed_clearance(
    x: jax.Array, y: jax.Array, gap: jax.Array, times: jax.Array, env: Environment
) -> jax.Array:
    """Certified clearance of segments to the areas that are closed while they are passed, [S - 1, P] m.

    Args:
        x, y: [S, P] m, samples.
        gap: [S - 1, P] m, level lengths of the segments between them.
        times: [S, P] s since the epoch, arrival at the samples.
        env: the world.
    """
    clear = jnp.full_like(gap, jnp.inf)
    for closure in env.closures:
        distance = distance_to_land(closure.chart, x, y)
        near = between_circles(distance[:-1], distance[1:], gap)
        clear = jnp.minimum(clear, jnp.where(closure.closed(times[:-1], times[1:]), near, jnp.inf))
    return clear


@jax.custom_jvp
def between_circles(first: jax.Array, last: jax.Array, gap: jax.Array) -> jax.Array:
    """Least distance to land on segments of length `gap`, from the distances at both ends; any shape, m.

    There is no land within either distance of its end. Where the two circles meet, at most that half of their
    common chord is certain on the segment; where they do not, half of what is missing between them.
    """
    return _between_with_slopes(first, last, gap)[0]


@between_circles.defjvp
def _between_jvp(primals: Axes, tangents: Axes) -> tuple[jax.Array, jax.Array]:
    """Keep the slopes as planes of their own: the compiler would recompute them for every shifted use."""
    value, *slopes = _between_with_slopes(*primals)
    terms = [slope * tangent for slope, tangent in zip(slopes, tangents, strict=True)]
    return value, terms[0] + terms[1] + terms[2]


def _between_with_slopes(first: jax.Array, last: jax.Array, gap: jax.Array) -> tuple[jax.Array, ...]:
    """`between_circles`, and its slopes along its three arguments."""
    apart = 0.5 * (first + last - gap)
    share = 0.5 * ((first * first - last * last) / (gap * gap) + 1.0)  # of the segment, up to the chord
    aside = share * gap
    half_chord = jnp.sqrt(jnp.maximum(first * first - aside * aside, 0.0) + TINY)
    ends = jnp.minimum(first, last)
    missing = apart <= 0.0
    crossed = (share > 0.0) & (share < 1.0) & (half_chord < ends) & ~missing
    value = jnp.where(missing, apart, jnp.where(crossed, half_chord, ends))
    nearer = jnp.asarray(first <= last, first.dtype)
    chord = first * (1.0 - share), last * share, -aside * (1.0 - share)
    end = nearer, 1.0 - nearer, jnp.zeros_like(gap)
    over = jnp.where(crossed, half_chord, 1.0)
    slopes = [
        jnp.where(missing, half, jnp.where(crossed, c, e)) / over
        for half, c, e in zip((0.5, 0.5, -0.5), chord, end, strict=True)
    ]
    return value, *slopes


#: Look-ups vouch for segments this many times as long as those of the straight line: most paths' longest are
#: shorter, and so all paths of a leg are judged by one layer of the sea bed.
_USUAL = 1.5


def bed_altitude(
    x: jax.Array, y: jax.Array, z: jax.Array, gap: jax.Array, env: Environment, parts: int = 1
) -> jax.Array:
    """Certified altitude of segments above the sea bed, [S - 1, P] m.

    Each half of a segment is no deeper than its deeper end, and over a bed that the sample at its outer end
    covers.

    Args:
        x, y, z: [S, P] m, samples.
        gap: [S - 1, P] m, level lengths of the segments between them.
        env: the world.
        parts: into which each segment is divided: the bed is looked up at the ends of all of them.
    """
    bed = env.seabed
    if bed is None:
        return jnp.full_like(gap, jnp.inf)
    if parts > 1:
        x, y, z = (_divided(axis, parts) for axis in (x, y, z))
        altitude = bed_altitude(x, y, z, jnp.repeat(gap / parts, parts, axis=0), env)
        return reduce(jnp.minimum, [altitude[k::parts] for k in range(parts)])  # see `most_met`
    usual = _USUAL / gap.shape[0] * norm(x[-1] - x[0], y[-1] - y[0])
    longer = jnp.maximum(jnp.concatenate([gap[:1], gap]), jnp.concatenate([gap, gap[-1:]]))
    longer = jnp.maximum(longer, jnp.minimum(usual, 2.0 * bed.reach[-1]))
    above = bed.shallowest_at(x, y, longer) - z
    dive = 0.5 * (z[1:] - z[:-1])
    return jnp.minimum(above[:-1] - jnp.maximum(dive, 0.0), above[1:] - jnp.maximum(-dive, 0.0))


def _divided(axis: jax.Array, parts: int) -> jax.Array:
    """[(S - 1) * parts + 1, P], samples [S, P] and the ends of equal parts of the segments between them."""
    share = jnp.asarray(np.arange(parts) / parts, axis.dtype)[:, None]
    inner = axis[:-1, None] + share * (axis[1:] - axis[:-1])[:, None]
    return jnp.concatenate([inner.reshape(-1, axis.shape[1]), axis[-1:]])


def obstacle_clearance(segments: Segments, env: Environment) -> jax.Array:
    """Certified clearance of segments to the collision boundaries at the time of arrival, m, any shape."""
    *_, duration = segments
    if len(env.obstacles) == 0:
        return jnp.full_like(duration, jnp.inf)
    # One long row of segments makes longer vector loops than a plane of short ones.
    row = jax.tree.map(jnp.ravel, segments)
    boundary = env.obstacles.boundary(env.obstacles.observed_at)
    return _compiled_nearest(env.obstacles, boundary, row).reshape(duration.shape)


@jax.custom_jvp
def _nearest(obstacles: Obstacles, boundary: jax.Array, segments: Segments) -> jax.Array:
    """Least clearance of N segments to any obstacle, [N] m, infinite where there is none."""

    def nearer(least: jax.Array, sphere: tuple) -> tuple[jax.Array, None]:
        one, reach = sphere
        return jnp.minimum(least, _Encounter.of(one, reach, segments).clearance), None

    *_, duration = segments
    far = jnp.full_like(duration, jnp.inf)
    return jax.lax.scan(nearer, far, (obstacles, boundary), unroll=_UNROLL)[0]


@partial(_nearest.defjvp, symbolic_zeros=True)
def _nearest_jvp(primals: tuple, tangents: tuple) -> tuple[jax.Array, jax.Array]:
    """Only the nearest obstacle of each segment counts, and at its nearest only where and when that is."""
    *of_spheres, moved = tangents
    if not is_symbolic_zero(of_spheres):
        return jax.jvp(_nearest.__wrapped__, primals, instantiated(tangents, primals))
    obstacles, boundary, segments = primals

    def nearer(least: tuple, sphere: tuple) -> tuple[tuple, None]:
        number, one, reach = sphere
        clear = _Encounter.of(one, reach, segments).clearance
        return (jnp.minimum(least[0], clear), jnp.where(clear < least[0], number, least[1])), None

    *_, lasts = segments
    none = jnp.full_like(lasts, jnp.inf), jnp.full_like(lasts, -1, jnp.int32)
    numbers = jnp.arange(len(obstacles), dtype=jnp.int32)
    (clear, number), _ = jax.lax.scan(nearer, none, (numbers, obstacles, boundary), unroll=_UNROLL)
    # A product with zeros and ones selects each segment's sphere: far cheaper than looking it up.
    chosen = (numbers[:, None] == number).astype(clear.dtype)
    one, reach = _mixed((obstacles, boundary), chosen)
    met = _Encounter.of(one, reach, segments)
    starts, steps, begin, duration = instantiated(moved, segments)
    change = -met.approach * (begin + met.share * duration)
    for axis, start, step in zip(met.away, starts, steps, strict=True):
        change = change + axis * (start + met.share * step)
    return clear, change / met.distance - met.growing * (begin + duration)


#: Compiled, or every call outside a compiled program would compile its loop again.
_compiled_nearest = compiled(_nearest)


def _mixed(spheres: tuple[Obstacles, jax.Array], shares: jax.Array) -> tuple[Obstacles, jax.Array]:
    """Fields [M, ...] of M spheres mixed for each of N segments, [N, ...], by their shares [M, N]."""
    leaves, tree = jax.tree.flatten(spheres)
    columns = [jnp.nan_to_num(leaf.astype(shares.dtype)).reshape(len(leaf), -1) for leaf in leaves]
    rows = jnp.matmul(jnp.concatenate(columns, axis=1).T, shares, precision=jax.lax.Precision.HIGHEST)
    parts = jnp.split(rows, np.cumsum([column.shape[1] for column in columns])[:-1])
    mixed = [part.T.reshape(-1, *leaf.shape[1:]) for part, leaf in zip(parts, leaves, strict=True)]
    return tree.unflatten(mixed)


@dataclass(frozen=True)
class _Encounter:
    """How N segments pass a sphere that moves, or each its own.

    Seen from the sphere a segment is a straight line: its nearest point to the centre is exact.

    Attributes:
        clearance: [N] m to the collision boundary.
        distance: [N] m to the centre, at the nearest.
        share: [N], of the segment that is behind at the nearest point.
        away: x, y, z [N] m, from the centre to the nearest point.
        approach: [N] m^2/s, of `away` and the sphere's velocity.
        growing: [N] m/s, growth of the boundary at the end of the segment.
    """

    clearance: jax.Array
    distance: jax.Array
    share: jax.Array
    away: Axes
    approach: jax.Array
    growing: jax.Array

    @classmethod
    def of(cls, sphere: Obstacles, boundary: jax.Array, segments: Segments) -> "_Encounter":
        (x, y, z), (dx, dy, dz), begin, duration = segments
        since = begin - sphere.observed_at
        u, v, w = (sphere.velocity[..., k] for k in range(3))
        north, east, down = (sphere.position[..., k] for k in range(3))
        first = x - north - u * since, y - east - v * since, z - down - w * since
        way = dx - u * duration, dy - v * duration, dz - w * duration
        share = jnp.clip(-inner(first, way) / (inner(way, way) + TINY), 0.0, 1.0)
        away = first[0] + share * way[0], first[1] + share * way[1], first[2] + share * way[2]
        distance, grown = norm(*away), sphere.growth * jnp.maximum(since + duration, 0.0)
        clear = distance - jnp.minimum(grown, sphere.growth_max) - boundary
        growing = jnp.where((grown > 0.0) & (grown < sphere.growth_max), sphere.growth, 0.0)
        clear = jnp.where(sphere.active, clear, jnp.inf)
        return cls(clear, distance, share, away, inner(away, (u, v, w)), growing)
