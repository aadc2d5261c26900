"""Travel time, cost and violations of a population of paths (Eqs 10-12).

The kernel works on planes [P, S]: P paths by S samples, with x, y and z apart, which the compiler turns into
long vector loops. Limits are checked on every segment between samples, not at the samples alone.
"""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.currents import is_steady
from auvplan.ocean.environment import Environment
from auvplan.path.bspline import basis_matrix
from auvplan.path.clearance import TINY, coast_clearance, obstacle_clearance
from auvplan.path.config import PathConfig
from auvplan.vehicle import Vehicle, along_track

#: Limits of Eq. 12, in the order of every violation array. What an excess of 1 means: surge, sway, turn rate,
#: twice the limit; coast, obstacle, `CLEARANCE_SCALE` metres too close; current, slower than the floor by the
#: speed through the water.
VIOLATIONS = ("surge", "sway", "turn_rate", "coast", "obstacle", "current")

#: Place of the coast in `VIOLATIONS`; the obstacles come next.
_COAST = VIOLATIONS.index("coast")

#: Metres of missing clearance that count as an excess of one.
CLEARANCE_SCALE = 50.0

#: A polish charges this share of the penalties' weights, and for margins wider by so many metres.
_GUIDE_SOFTNESS, _GUIDE_MARGIN = 0.003, 1.0


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("x", "y", "z", "times", "length", "excess", "coast", "obstacles", "price"),
    meta_fields=(),
)
@dataclass(frozen=True)
class Flight:
    """P paths followed from end to end.

    Attributes:
        x, y, z: [P, S] m, positions of the samples.
        times: [P, S] s since the epoch, arrival at each sample.
        length: [P] m.
        excess: [V, P, S - 1], how far each segment breaks each limit of `VIOLATIONS`; zero where it is kept.
        coast: [P, S - 1] m, certified distance of each segment to the coast; 1e6 without a chart.
        obstacles: [P, S - 1] m, the same to collision boundaries.
        price: [P] s, charged for uncertain areas.
    """

    x: jax.Array
    y: jax.Array
    z: jax.Array
    times: jax.Array
    length: jax.Array
    excess: jax.Array
    coast: jax.Array
    obstacles: jax.Array
    price: jax.Array

    @property
    def travel_time(self) -> jax.Array:
        """[P] s (Eq. 11)."""
        return self.times[:, -1] - self.times[:, 0]

    @property
    def clearance(self) -> jax.Array:
        """[P, S - 1] m, certified distance of each segment to whatever is nearest."""
        return jnp.minimum(self.coast, self.obstacles)


def curves(
    habitats: jax.Array, start: jax.Array, goal: jax.Array, config: PathConfig
) -> tuple[jax.Array, ...]:
    """Positions on the B-splines of a population (Eq. 9).

    Args:
        habitats: [P, 3 n], the free control points' x, then y, then z, m.
        start: [3] m, fixed first control point.
        goal: [3] m, fixed last control point.
        config: static settings.

    Returns:
        x, y, z, [P, S] m each.
    """
    free = config.control_points
    basis = jnp.asarray(basis_matrix(config.samples, free + 2, config.degree), habitats.dtype)
    planes = habitats.reshape(habitats.shape[0], 3, free)
    x, y, z = (
        planes[:, axis] @ basis[:, 1:-1].T + (start[axis] * basis[:, 0] + goal[axis] * basis[:, -1])
        for axis in range(3)
    )
    return x, y, z


def fly(
    x: jax.Array,
    y: jax.Array,
    z: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> Flight:
    """Follow sampled paths through current, obstacles and chart.

    Args:
        x, y, z: [P, S] m.
        depart: s since the epoch.
        env: the world; its obstacles must be resolved (`Obstacles.resolved`).
        vehicle: speed and limits.
        config: static settings.
    """
    dx, dy, dz = (jnp.diff(axis, axis=1) for axis in (x, y, z))
    gap = jnp.sqrt(dx * dx + dy * dy + dz * dz + TINY)
    middle, way = tuple(0.5 * (axis[:, 1:] + axis[:, :-1]) for axis in (x, y, z)), (dx, dy, dz)
    if is_steady(env.current) or config.speed_reading == "eq11":
        middle_time = depart + jnp.zeros_like(gap)
    else:
        middle_time = _middle_times(middle, way, gap, depart, env, vehicle, config)
    ground, across, shortfall = _over_ground(middle, way, gap, middle_time, env, vehicle, config)
    duration = gap / ground
    elapsed = _cumulative(duration)
    times = depart + jnp.concatenate([jnp.zeros_like(elapsed[:, :1]), elapsed], axis=1)

    needed = (
        jnp.maximum(ground / vehicle.surge_max - 1.0, 0.0),
        jnp.maximum(across / vehicle.sway_max - 1.0, 0.0),
        jnp.maximum(_turn_rate(dx, dy, duration) / vehicle.turn_rate_max - 1.0, 0.0),
    )
    coast_clear, price = coast_clearance(x, y, jnp.sqrt(dx * dx + dy * dy + TINY), duration, env, config)
    starts = x[:, :-1], y[:, :-1], z[:, :-1]
    obstacle_clear = obstacle_clearance(starts, way, times[:, :-1], duration, env)
    excess = (
        *needed,
        _too_near(coast_clear, config.coast_margin),
        _too_near(obstacle_clear, config.obstacle_margin),
        shortfall,
    )
    return Flight(x, y, z, times, gap.sum(axis=1), jnp.stack(excess), coast_clear, obstacle_clear, price)


def _too_near(clearance: jax.Array, margin: float) -> jax.Array:
    """Excess of missing clearance."""
    return jnp.maximum(margin - clearance, 0.0) / CLEARANCE_SCALE


def _over_ground(
    middle: tuple[jax.Array, ...],
    way: tuple[jax.Array, ...],
    gap: jax.Array,
    time: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Ground speed, current across the track, both m/s, and shortfall of segments, in the current at a time.

    Args:
        middle: x, y, z, m, of segments' middles; any shape, the same for all.
        way: x, y, z, m, from their first to their last ends.
        gap: m, their lengths.
        time: s since the epoch.
        env: the world.
        vehicle: speed and limits.
        config: static settings.
    """
    x, y, z = middle
    u, v, w = env.current(x, y, z, time)
    along = (u * way[0] + v * way[1] + w * way[2]) / gap
    across = jnp.sqrt(jnp.maximum(u * u + v * v + w * w - along * along, 0.0) + TINY)
    ground, shortfall = along_track(config.speed_reading, vehicle.speed, along, across)
    return ground, across, shortfall


def _middle_times(
    middle: tuple[jax.Array, ...],
    way: tuple[jax.Array, ...],
    gap: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> jax.Array:
    """[P, S - 1] s since the epoch, when each segment's middle is reached; planes [P, S - 1] m.

    Segment by segment: how fast the next one is sailed depends on when. The way to its middle is taken at the
    speed of the one before.
    """

    def sail(carry: tuple[jax.Array, jax.Array], segment: tuple) -> tuple[tuple, jax.Array]:
        time, speed = carry
        middle, way, gap = segment
        half_way = time + 0.5 * gap / speed
        ground = _over_ground(middle, way, gap, half_way, env, vehicle, config)[0]
        return (time + gap / ground, ground), half_way

    first = jnp.zeros_like(gap[:, 0])
    segments = jax.tree.map(jnp.transpose, (middle, way, gap))
    return jax.lax.scan(sail, (first + depart, first + vehicle.speed), segments)[1].T


def _cumulative(durations: jax.Array) -> jax.Array:
    """Running sum along each path, [P, S - 1]; a triangular product is quicker than a scan at this length."""
    ones = np.triu(np.ones((durations.shape[1],) * 2))
    return jnp.dot(durations, jnp.asarray(ones, durations.dtype), precision=jax.lax.Precision.HIGHEST)


def _turn_rate(dx: jax.Array, dy: jax.Array, duration: jax.Array) -> jax.Array:
    """Change of yaw per second at the start of each segment, [P, S - 1] rad/s; zero for the first.

    The turn by an angle a counts as 2 tan(a/2), the curvature of the circle that touches both segments in
    their middles. It is no less than a, equal for small turns, and needs no inverse trigonometry.
    """
    cross = dx[:, :-1] * dy[:, 1:] - dy[:, :-1] * dx[:, 1:]
    dot = dx[:, :-1] * dx[:, 1:] + dy[:, :-1] * dy[:, 1:]
    square = dx * dx + dy * dy
    sides = jnp.sqrt(square[:, :-1] * square[:, 1:] + TINY)
    # tan(a/2) = |cross| / (sides + dot) = (sides - dot) / |cross|: each where it is well conditioned. Samples
    # that coincide, or a vertical dive, have no yaw and count as straight; a turn about as a very sharp one.
    mild = jnp.abs(cross) / (sides + jnp.maximum(dot, 0.0))
    sharp = (sides - dot) / jnp.maximum(jnp.abs(cross), 1e-3 * sides)
    turn = 2.0 * jnp.where(dot < 0.0, sharp, mild)
    rate = turn / (0.5 * (duration[:, :-1] + duration[:, 1:]))
    return jnp.concatenate([jnp.zeros_like(rate[:, :1]), rate], axis=1)


def violations(flight: Flight) -> jax.Array:
    """Mean excess over the path of each limit in `VIOLATIONS`, [V, P]; zero means kept everywhere."""
    return flight.excess.mean(axis=2)


def score(
    habitats: jax.Array,
    start: jax.Array,
    goal: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> tuple[jax.Array, jax.Array]:
    """Cost of a population of paths: travel time plus price plus weighted violations (Eq. 12).

    Args:
        habitats: [P, 3 n] m, see `curves`.
        start, goal: [3] m.
        depart: s since the epoch.
        env: the world, obstacles resolved.
        vehicle: speed and limits.
        config: static settings.

    Returns:
        ``(cost [P] s, violation [P])``: the violation is the sum over all limits, zero for a feasible path.
    """
    x, y, z = curves(habitats, start, goal, config)
    return _cost(fly(x, y, z, depart, env, vehicle, config), _straight_time(start, goal, vehicle), config)


def guide(
    habitats: jax.Array,
    start: jax.Array,
    goal: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
    """What a polish descends on, and the cost that judges its steps; arguments as `score`.

    The weights of the cost are so stiff that a descent jumps to and fro at every limit that it meets. The
    guide has soft weights, and margins a little wider, so that it settles just inside what the cost allows.

    Returns:
        ``(guide [P] s, (cost [P] s, violation [P]))``.
    """
    x, y, z = curves(habitats, start, goal, config)
    flight = fly(x, y, z, depart, env, vehicle, config)
    straight = _straight_time(start, goal, vehicle)
    near = (
        _too_near(flight.coast, config.coast_margin + _GUIDE_MARGIN),
        _too_near(flight.obstacles, config.obstacle_margin + _GUIDE_MARGIN),
    )
    wider = flight.excess.at[_COAST : _COAST + 2].set(jnp.stack(near))
    soft = _GUIDE_SOFTNESS * (_weights(config) @ wider.mean(axis=2))
    return flight.travel_time + flight.price + straight * soft, _cost(flight, straight, config)


def _cost(flight: Flight, straight: jax.Array, config: PathConfig) -> tuple[jax.Array, jax.Array]:
    broken = violations(flight)
    cost = flight.travel_time + flight.price + straight * (_weights(config) @ broken)
    return cost, broken.sum(axis=0)


def _weights(config: PathConfig) -> jax.Array:
    """Weights gamma in the order of `VIOLATIONS`."""
    return jnp.asarray([getattr(config.penalties, name) for name in VIOLATIONS], float)


def _straight_time(start: jax.Array, goal: jax.Array, vehicle: Vehicle) -> jax.Array:
    """s, straight from start to goal in still water."""
    return jnp.sqrt(((goal - start) ** 2).sum() + TINY) / vehicle.speed
