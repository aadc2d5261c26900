"""Travel time, cost and violations of a population of paths (Eqs 10-12).

The kernel works on planes [P, S]: P paths by S samples, with x, y and z apart, which the compiler turns into
long vector loops. Limits are checked on every segment between samples: distances to the coast and to
obstacles are 1-Lipschitz, so a clearance of half the gap at both ends proves the segment between them clear.
"""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.chart import INTERPOLATION_ERROR
from auvplan.ocean.currents import is_steady
from auvplan.ocean.environment import Environment
from auvplan.path.bspline import basis_matrix
from auvplan.path.config import PathConfig
from auvplan.vehicle import Vehicle, along_track

#: Limits of Eq. 12, in the order of every violation array. What an excess of 1 means: surge, sway, turn rate,
#: twice the limit; coast, obstacle, `CLEARANCE_SCALE` metres too close; current, slower than the floor by the
#: speed through the water.
VIOLATIONS = ("surge", "sway", "turn_rate", "coast", "obstacle", "current")

#: Metres of missing clearance that count as an excess of one.
CLEARANCE_SCALE = 50.0

#: Squared metres added under square roots: keeps gradients finite at coinciding samples.
_TINY = 1e-8


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("x", "y", "z", "times", "length", "excess", "clearance", "price"),
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
        clearance: [P, S - 1] m, least certified distance of each segment to coast and collision boundaries.
        price: [P] s, charged for uncertain areas.
    """

    x: jax.Array
    y: jax.Array
    z: jax.Array
    times: jax.Array
    length: jax.Array
    excess: jax.Array
    clearance: jax.Array
    price: jax.Array

    @property
    def travel_time(self) -> jax.Array:
        """[P] s (Eq. 11)."""
        return self.times[:, -1] - self.times[:, 0]


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
    gap = jnp.sqrt(dx * dx + dy * dy + dz * dz + _TINY)
    x_mid, y_mid, z_mid = (0.5 * (axis[:, 1:] + axis[:, :-1]) for axis in (x, y, z))

    steady = is_steady(env.current) or config.speed_reading == "eq11"
    duration = gap / vehicle.speed
    for _ in range(1 if steady else config.sweeps):
        middle_time = depart + _cumulative(duration) - 0.5 * duration
        u, v, w = env.current(x_mid, y_mid, z_mid, middle_time)
        along = (u * dx + v * dy + w * dz) / gap
        across = jnp.sqrt(jnp.maximum(u * u + v * v + w * w - along * along, 0.0) + _TINY)
        ground, shortfall = along_track(config.speed_reading, vehicle.speed, along, across)
        duration = gap / ground
    elapsed = _cumulative(duration)
    times = depart + jnp.concatenate([jnp.zeros_like(elapsed[:, :1]), elapsed], axis=1)

    needed = (
        jnp.maximum(ground / vehicle.surge_max - 1.0, 0.0),
        jnp.maximum(across / vehicle.sway_max - 1.0, 0.0),
        jnp.maximum(_turn_rate(dx, dy, duration) / vehicle.turn_rate_max - 1.0, 0.0),
    )
    coast_clear, price = _coast(x, y, jnp.sqrt(dx * dx + dy * dy + _TINY), duration, env, config)
    obstacle_clear = _obstacles(x, y, z, times, gap, duration, env)
    excess = (
        *needed,
        jnp.maximum(config.coast_margin - coast_clear, 0.0) / CLEARANCE_SCALE,
        jnp.maximum(config.obstacle_margin - obstacle_clear, 0.0) / CLEARANCE_SCALE,
        shortfall,
    )
    clearance = jnp.minimum(coast_clear, obstacle_clear)
    return Flight(x, y, z, times, gap.sum(axis=1), jnp.stack(excess), clearance, price)


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
    sides = jnp.sqrt(square[:, :-1] * square[:, 1:] + _TINY)
    # tan(a/2) = |cross| / (sides + dot) = (sides - dot) / |cross|: each where it is well conditioned. Samples
    # that coincide, or a vertical dive, have no yaw and count as straight; a turn about as a very sharp one.
    mild = jnp.abs(cross) / (sides + jnp.maximum(dot, 0.0))
    sharp = (sides - dot) / jnp.maximum(jnp.abs(cross), 1e-3 * sides)
    turn = 2.0 * jnp.where(dot < 0.0, sharp, mild)
    rate = turn / (0.5 * (duration[:, :-1] + duration[:, 1:]))
    return jnp.concatenate([jnp.zeros_like(rate[:, :1]), rate], axis=1)


def _coast(
    x: jax.Array, y: jax.Array, gap: jax.Array, duration: jax.Array, env: Environment, config: PathConfig
) -> tuple[jax.Array, jax.Array]:
    """Certified clearance to the coast [P, S - 1] m, and the price of uncertain areas [P] s."""
    if env.chart is None:
        return jnp.full_like(gap, 1e6), jnp.zeros_like(gap[:, 0])
    distance = env.chart.distance(x, y) - INTERPOLATION_ERROR * env.chart.pixel_size
    risk = 1.0 - env.chart.passability_at(x, y)
    price = config.uncertain_price * (0.5 * (risk[:, 1:] + risk[:, :-1]) * duration).sum(axis=1)
    return jnp.minimum(distance[:, 1:], distance[:, :-1]) - 0.5 * gap, price


def _obstacles(
    x: jax.Array,
    y: jax.Array,
    z: jax.Array,
    times: jax.Array,
    gap: jax.Array,
    duration: jax.Array,
    env: Environment,
) -> jax.Array:
    """Certified clearance to the collision boundaries at the time of arrival, [P, S - 1] m."""
    obstacles = env.obstacles
    if len(obstacles) == 0:
        return jnp.full_like(gap, 1e6)

    def plane(per_obstacle: jax.Array) -> jax.Array:
        return per_obstacle[:, None, None]  # [M, 1, 1], against [P, S]

    since = times - plane(obstacles.observed_at)
    square = _TINY
    for k, axis in enumerate((x, y, z)):
        square = (
            square + (axis - plane(obstacles.position[:, k]) - plane(obstacles.velocity[:, k]) * since) ** 2
        )
    grown = jnp.minimum(plane(obstacles.growth) * jnp.maximum(since, 0.0), plane(obstacles.growth_max))
    distance = jnp.sqrt(square) - grown - plane(obstacles.boundary(obstacles.observed_at))
    # In the obstacle's frame a segment is no longer than the sum of both ways and the growth meanwhile.
    speed = jnp.sqrt((obstacles.velocity**2).sum(axis=1) + _TINY) + obstacles.growth
    way = gap + plane(speed) * duration
    clear = jnp.minimum(distance[..., 1:], distance[..., :-1]) - 0.5 * way
    return jnp.where(plane(obstacles.active), clear, 1e6).min(axis=0)


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
    flight = fly(x, y, z, depart, env, vehicle, config)
    broken = violations(flight)
    straight = jnp.sqrt(((goal - start) ** 2).sum() + _TINY) / vehicle.speed
    weights = jnp.asarray([getattr(config.penalties, name) for name in VIOLATIONS], broken.dtype)
    cost = flight.travel_time + flight.price + straight * (weights @ broken)
    return cost, broken.sum(axis=0)
