"""Travel time, cost and violations of a population of paths (Eqs 10-12).

The kernel works on planes [S, P]: S samples of P paths, with x, y and z apart. All paths at one sample lie
together, so that steps from sample to sample, sums along paths and their gradients are long vector loops.
Limits are checked on every segment between samples, not at the samples alone.
"""

from dataclasses import dataclass, replace
from functools import partial, reduce

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.navigation import Navigation
from auvplan.ocean.environment import Environment
from auvplan.path.bspline import basis_matrix
from auvplan.path.clearance import bed_altitude, closed_clearance, coast_clearance, obstacle_clearance
from auvplan.path.config import GUIDE_ALTITUDE, GUIDE_MARGIN, PathConfig
from auvplan.path.kinematics import (
    Axes,
    at_shares,
    elapsed,
    mean_met,
    most_met,
    navigated,
    norm,
    over_ground,
    pace_met,
    parts_of,
    places_met,
    times_met,
    turn_rate,
    vertical_speeds,
)
from auvplan.path.problem import Problem
from auvplan.path.profile import in_transit
from auvplan.vehicle import VERTICAL_LIMITS, Vehicle

#: Limits of Eq. 12 and ours, in the order of every violation array. What an excess of 1 means: surge, sway,
#: turn rate, climb and dive, twice the limit; coast, obstacle, `CLEARANCE_SCALE` metres too close; current,
#: slower than the floor by the speed through the water; sea bed, `ALTITUDE_SCALE` metres too low; pitch,
#: twice the sine of the limit.
VIOLATIONS = ("surge", "sway", "turn_rate", "coast", "obstacle", "current", "seabed", *VERTICAL_LIMITS)

#: Those that depend on the current that is met.
IN_CURRENT = ("surge", "sway", "current", *VERTICAL_LIMITS)

#: Metres of missing clearance that count as an excess of one.
CLEARANCE_SCALE = 50.0

#: Metres of missing altitude that count so: a few metres are kept from the bed where tens are from a coast.
ALTITUDE_SCALE = 10.0

#: Share of a limit by which a value may exceed it.
_ROUNDING = 1e-6

#: Shares of a segment at which the path that was found is judged, and excess that is let pass there.
JUDGED_AT, WITHIN = (0.05, 0.25, 0.5, 0.75, 0.95), 0.005

#: m, change in depth on a segment up to which tolls are rounded off.
_LEVEL = 0.002

#: Paths that a CPU scores in one go, so that their planes stay in its caches; whole vector registers.
_TOGETHER = 640

#: Share of the penalties' weights that a polish charges.
SOFTNESS = 0.01

#: Share of the limits in the vertical that it keeps.
_INSIDE = 0.99


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Trajectory:
    """P paths followed from end to end.

    Attributes:
        x, y, z: [S, P] m, positions of the samples.
        times: [S, P] s since the epoch, arrival at each sample; differentiable in track, departure, vehicle
            and current. The first is the departure: it answers to nothing else, and later ones to it by a
            second a second besides the change of the way's duration.
        travel_time: [P] s (Eq. 11), with more digits than `times` have days after the epoch.
        length: [P] m.
        water: u, v, w, [S - 1, P] m/s north, east, down, the current met in the middle of each segment, or
            the mean of that at several places (`PathConfig.quadrature`).
        excess: a plane [S - 1, P] for each limit of `VIOLATIONS`, how far each segment breaks it; zero where
            it is kept.
        coast: [S - 1, P] m, certified distance of each segment to the coast, and to areas that are closed
            when it is passed; infinite where there is neither.
        obstacles: [S - 1, P] m, the same to collision boundaries.
        altitude: [S - 1, P] m, certified altitude of each segment above the sea bed; infinite without one.
        price: [P] s, charged for uncertain areas, by `Environment.price` and `Vehicle.depth_toll`.
        known: how well the vehicle knows where it is at the end of each segment, [S - 1, P]; None without
            `Vehicle.navigation`.
    """

    x: jax.Array
    y: jax.Array
    z: jax.Array
    times: jax.Array
    travel_time: jax.Array
    length: jax.Array
    water: Axes
    excess: tuple[jax.Array, ...]
    coast: jax.Array
    obstacles: jax.Array
    altitude: jax.Array
    price: jax.Array
    known: Navigation | None = None

    @property
    def clearance(self) -> jax.Array:
        """[S - 1, P] m, certified distance of each segment to coast or collision boundary."""
        return jnp.minimum(self.coast, self.obstacles)

    def fields(self) -> dict[str, jax.Array]:
        """Fields of a `PathPlan` by name, as far as a single path that was followed has them."""
        return {
            "travel_time": self.travel_time[0],
            "length": self.length[0],
            "positions": jnp.stack([self.x[:, 0], self.y[:, 0], self.z[:, 0]], axis=1),
            "times": self.times[:, 0],
            "clearance": self.clearance.min(),
            "altitude": self.altitude.min(),
            "excess": jnp.stack(self.excess)[:, :, 0],
            "water": jnp.stack(self.water, axis=-1)[:, 0],
        }


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Track:
    """P sampled paths.

    Attributes:
        places: x, y, z, [S, P] m, positions of the samples.
        way: x, y, z, [S - 1, P] m, from the first to the last end of each segment.
    """

    places: Axes
    way: Axes

    @classmethod
    def through(cls, x: jax.Array, y: jax.Array, z: jax.Array) -> "Track":
        """Return the track through positions [S, P] m."""
        return cls((x, y, z), (jnp.diff(x, axis=0), jnp.diff(y, axis=0), jnp.diff(z, axis=0)))


def curves(habitats: jax.Array, start: jax.Array, goal: jax.Array, config: PathConfig) -> Track:
    """Follow the B-splines of a population (Eq. 9).

    Args:
        habitats: [P, 3 n], the free control points' x, then y, then z, m.
        start: [3] m, fixed first control point.
        goal: [3] m, fixed last control point.
        config: static settings.
    """
    free = config.control_points
    basis = basis_matrix(config.samples, free + 2, config.degree)
    # Ways are products as well: so their gradients are products, and not sums of shifted planes. They weigh
    # the polygon's sides, whose digits do not depend on where the origin lies: cusps need them.
    ways = -np.cumsum(np.diff(basis, axis=0), axis=1)[:, :-1]
    along, between = (jnp.asarray(rows, habitats.dtype) for rows in (basis, ways))
    product = partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)
    polygons = []
    for axis, inner in enumerate(jnp.split(habitats.T, 3)):
        polygon = jnp.full((free + 2, habitats.shape[0]), goal[axis], habitats.dtype)
        polygons.append(polygon.at[0].set(start[axis]).at[1:-1].set(inner))
    x, y, z = polygons
    places = product(along, x), product(along, y), product(along, z)
    sides_x, sides_y, sides_z = (jnp.diff(axis, axis=0) for axis in polygons)
    return Track(places, (product(between, sides_x), product(between, sides_y), product(between, sides_z)))


def tracks(habitats: jax.Array, problem: Problem, config: PathConfig) -> Track:
    """Return `curves` as a vehicle follows them: at its transit depth or altitude where it has one."""
    return followed(curves(habitats, *problem.ends, config), problem.env, problem.vehicle)


def followed(track: Track, env: Environment, vehicle: Vehicle) -> Track:
    """Return P paths as a vehicle follows them, at its transit depth or altitude where it has one."""
    if not vehicle.has_transit:
        return track
    (x, y, _), (dx, dy, _) = track.places, track.way
    z = in_transit(track.places, track.way, env, vehicle)
    return Track((x, y, z), (dx, dy, jnp.diff(z, axis=0)))


def evaluate(
    track: Track, depart: jax.Array, env: Environment, vehicle: Vehicle, config: PathConfig
) -> Trajectory:
    """Follow sampled paths through current, obstacles and chart, over the sea bed.

    Args:
        track: P paths of S samples.
        depart: s since the epoch.
        env: the world; its obstacles must be resolved (`Obstacles.resolved`).
        vehicle: speed and limits.
        config: static settings.

    Differences from the paper:
        Eq. 11 divides the length by |v|; here each segment has its ground speed in the current that is met
        there, but for the speed reading "eq11". Eq. 12 tests points of the path against obstacles; here the
        clearance of every segment is certified, against obstacles at the time of arrival, and wider by the
        vehicle's own uncertain position. It has no limit in the vertical.
    """
    (x, y, z), (dx, dy, dz) = track.places, track.way
    starts = x[:-1], y[:-1], z[:-1]
    middle = starts[0] + 0.5 * dx, starts[1] + 0.5 * dy, starts[2] + 0.5 * dz
    gap = norm(dx, dy, dz)
    count = config.quadrature or 1
    places = places_met(middle, track.way, parts_of(count))
    met = times_met(places, track.way, gap, depart, env, vehicle, config)
    u, v, w = (jnp.broadcast_to(component, met.shape) for component in env.current(*places, met))
    ground, across, shortfall = over_ground((u, v, w), track.way, gap, vehicle, config)
    vertical = vertical_speeds((u, v, w), track.way, gap, ground, vehicle, config.speed_reading)
    duration = gap / pace_met(ground, count)
    water = mean_met(u, count), mean_met(v, count), mean_met(w, count)
    passed = elapsed(duration)
    times = depart + passed

    level = norm(dx, dy)
    coast_clear, price = coast_clearance(x, y, level, duration, env, config)
    if env.price is not None:
        price = price + (jnp.maximum(env.price(*middle, mean_met(met, count)), 0.0) * duration).sum(axis=0)
    if vehicle.depth_toll is not None:
        price = price + toll(dz, vehicle.depth_toll)
    if env.closures:
        coast_clear = jnp.minimum(coast_clear, closed_clearance(x, y, level, times, env))
    obstacle_clear = obstacle_clearance((starts, track.way, times[:-1], duration), env)
    altitude = bed_altitude(x, y, z, level, env, count)
    known = navigated(track.places, duration, env, vehicle)
    turning = turn_rate(dx, dy, duration)
    found = {
        "surge": _beyond(most_met(ground, count), vehicle.surge_max),
        "sway": _beyond(most_met(across, count), vehicle.sway_max),
        "turn_rate": _beyond(turning, vehicle.turn_rate_max),
        "coast": _too_near(coast_clear, config.coast_margin, known),
        "obstacle": _too_near(obstacle_clear, config.obstacle_margin, known),
        "current": most_met(shortfall, count),
        "seabed": _too_low(altitude, env, 0.0),
        **{name: _beyond(most_met(speed, count), limit) for name, (speed, limit) in vertical.items()},
    }
    # Zeros cost a compiled program nothing.
    excess = tuple(found.get(name, jnp.zeros_like(gap)) for name in VIOLATIONS)
    length = gap.sum(axis=0)
    clear = coast_clear, obstacle_clear, altitude
    return Trajectory(x, y, z, times, passed[-1], length, water, excess, *clear, price, known)


def toll(rises: jax.Array, depth_toll: jax.typing.ArrayLike) -> jax.Array:
    """Return what changes in depth along paths cost, [P] s, from the rise [S - 1, P] m of each segment.

    Less than a few millimetres on a segment count less, so that the cost has a slope where paths are level.
    """
    return jnp.asarray(depth_toll) * (jnp.sqrt(rises * rises + _LEVEL**2) - _LEVEL).sum(axis=0)


def _beyond(value: jax.Array, limit: jax.typing.ArrayLike) -> jax.Array:
    """Excess over a limit; what single precision may round a value at the limit to has none."""
    return jnp.maximum(value / limit - (1.0 + _ROUNDING), 0.0)


def _too_near(clearance: jax.Array, margin: float, known: Navigation | None = None) -> jax.Array:
    """Excess of missing clearance, of which more is asked where the vehicle knows less where it is."""
    if known is not None:
        clearance = clearance - known.allowance
    return jnp.maximum(margin - clearance, 0.0) / CLEARANCE_SCALE


def _too_low(altitude: jax.Array, env: Environment, margin: float) -> jax.Array:
    """Excess of missing altitude; zeros, which cost a compiled program nothing, where there is no sea bed."""
    if env.seabed is None:
        return jnp.zeros_like(altitude)
    return jnp.maximum(env.seabed.clearance + margin - altitude, 0.0) / ALTITUDE_SCALE


def followed_by(habitats: jax.Array, problem: Problem, config: PathConfig) -> tuple[Track, Trajectory]:
    """Return the tracks of a population and how they are followed."""
    track = tracks(habitats, problem, config)
    return track, evaluate(track, problem.depart, problem.env, problem.vehicle, config)


def timed_at_places(
    track: Track,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
    places: int | None,
) -> tuple[Trajectory, jax.Array]:
    """Time paths at more places on each segment than they were compared at.

    Limits that depend on the current are held against the places where they were compared; `judged_within`
    looks at others.

    Args:
        track: P paths of S samples.
        depart, env, vehicle: as for `evaluate`.
        config: that paths are compared by.
        places: `PathConfig.quadrature` that they are timed by, see `profile.timed`.

    Returns:
        The trajectories, and [P] s by which they take longer than they seemed to.
    """
    compared = evaluate(track, depart, env, vehicle, config)
    if places == config.quadrature:
        return compared, jnp.zeros_like(compared.travel_time)
    trajectory = evaluate(track, depart, env, vehicle, config.replace(quadrature=places))
    both = zip(VIOLATIONS, compared.excess, trajectory.excess, strict=True)
    excess = tuple(first if name in IN_CURRENT else last for name, first, last in both)
    return replace(trajectory, excess=excess), trajectory.travel_time - compared.travel_time


def judged_within(
    trajectory: Trajectory, env: Environment, vehicle: Vehicle, config: PathConfig
) -> Trajectory:
    """Return a trajectory whose limits hold within segments too, but for those on turns and distances.

    The current is looked up at the shares `JUDGED_AT` of each segment, and an excess there counts where it is
    greater than `WITHIN`.
    """
    way = jnp.diff(trajectory.x, axis=0), jnp.diff(trajectory.y, axis=0), jnp.diff(trajectory.z, axis=0)
    begin, lasts, gap = trajectory.times[:-1], jnp.diff(trajectory.times, axis=0), norm(*way)
    starts = trajectory.x[:-1], trajectory.y[:-1], trajectory.z[:-1]
    middle = starts[0] + 0.5 * way[0], starts[1] + 0.5 * way[1], starts[2] + 0.5 * way[2]
    places, when = places_met(middle, way, JUDGED_AT), at_shares(begin + 0.5 * lasts, lasts, JUDGED_AT)
    u, v, w = (jnp.broadcast_to(component, when.shape) for component in env.current(*places, when))
    ground, across, shortfall = over_ground((u, v, w), way, gap, vehicle, config)
    vertical = vertical_speeds((u, v, w), way, gap, ground, vehicle, config.speed_reading)
    within = {
        "surge": _beyond(ground, vehicle.surge_max),
        "sway": _beyond(across, vehicle.sway_max),
        "current": shortfall,
        **{name: _beyond(*pair) for name, pair in vertical.items()},
    }
    most = {name: jnp.where(plane > WITHIN, plane, 0.0).max(axis=0) for name, plane in within.items()}
    both = zip(VIOLATIONS, trajectory.excess, strict=True)
    return replace(trajectory, excess=tuple(jnp.maximum(plane, most.get(name, 0.0)) for name, plane in both))


def violations(trajectory: Trajectory) -> jax.Array:
    """Mean excess over the path of each limit in `VIOLATIONS`, [V, P]; zero means kept everywhere."""
    return jnp.stack([plane.mean(axis=0) for plane in trajectory.excess])


def score(habitats: jax.Array, problem: Problem, config: PathConfig) -> tuple[jax.Array, jax.Array]:
    """Cost of a population of paths: travel time plus price plus weighted violations (Eq. 12).

    Args:
        habitats: [P, 3 n] m, see `curves`.
        problem: the leg.
        config: static settings.

    Returns:
        ``(cost [P] s, violation [P])``: the violation is the sum over all limits, zero for a feasible path.

    Differences from the paper:
        Eq. 12 prints Map = 1 for coast, against section 2: coast is 0. Its limit on |psi| is read as one on
        the turn rate. Its weights gamma have no values there; here they count in straight-line times, on the
        mean excess over the path. Uncertain area has a price per second, which the paper does not name.
    """
    straight = problem.straight_time

    def few(habitats: jax.Array) -> tuple[jax.Array, jax.Array]:
        return cost_of(followed_by(habitats, problem, config)[1], straight, config)

    paths = habitats.shape[0]
    if paths <= _TOGETHER or jax.default_backend() != "cpu":
        return few(habitats)
    # Gradients recompute each part: storing what all parts would need takes longer.
    parts = jnp.pad(habitats, ((0, -paths % _TOGETHER), (0, 0))).reshape(-1, _TOGETHER, habitats.shape[1])
    scored = jax.lax.map(jax.checkpoint(few), parts)
    return jax.tree.map(lambda part: part.reshape(-1)[:paths], scored)


def soft_objective(
    habitats: jax.Array, problem: Problem, config: PathConfig, softness: jax.typing.ArrayLike = SOFTNESS
) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
    """Return what a polish descends on, and the cost that judges its steps.

    Arguments as `score`, and the share of the penalties' weights to charge.

    The weights of the cost are so stiff that a descent jumps to and fro at every limit that it meets. This
    one has soft weights, and margins a little wider, so that it settles just inside what the cost allows. In
    the vertical it asks for a little less than the limits, in the currents of neighbouring segments too.

    Returns:
        ``(objective [P] s, (cost [P] s, violation [P]))``.
    """
    (track, trajectory), straight = followed_by(habitats, problem, config), problem.straight_time
    wider = dict(zip(VIOLATIONS, trajectory.excess, strict=True)) | {
        "coast": _too_near(trajectory.coast, config.coast_margin + GUIDE_MARGIN, trajectory.known),
        "obstacle": _too_near(trajectory.obstacles, config.obstacle_margin + GUIDE_MARGIN, trajectory.known),
        "seabed": _too_low(trajectory.altitude, problem.env, GUIDE_ALTITUDE),
        **_steep_nearby(trajectory, track, problem.vehicle, config),
    }
    soft = softness * straight * _penalty(tuple(wider.values()), config)
    return trajectory.travel_time + trajectory.price + soft, cost_of(trajectory, straight, config)


def _steep_nearby(
    trajectory: Trajectory, track: Track, vehicle: Vehicle, config: PathConfig
) -> dict[str, jax.Array]:
    """Excess over limits in the vertical in the current of each segment and of those beside it.

    Where a current is sheared it turns within a segment, which its middle does not show. Slopes are
    those by the steepness of segments: currents and speeds count as numbers, which keeps gradients cheap.
    """
    gap, found = norm(*track.way), []
    straight, still = jax.lax.stop_gradient((track.way, trajectory.water))
    for begin, end in ((0, 0), (1, 0), (0, 1)) if vehicle.vertical_limits else ():
        rows = slice(end, gap.shape[0] - begin)
        water = tuple(jnp.pad(plane[rows], ((begin, end), (0, 0)), mode="edge") for plane in still)
        ground = over_ground(water, straight, norm(*straight), vehicle, config)[0]  # type: ignore[arg-type]
        found.append(vertical_speeds(water, track.way, gap, ground, vehicle, config.speed_reading))  # type: ignore[arg-type]
    limits = ((name, _INSIDE * limit) for name, limit in vehicle.vertical_limits.items())
    return {
        name: reduce(jnp.maximum, [_beyond(speeds[name][0], limit) for speeds in found])
        for name, limit in limits
    }


def cost_of(trajectory: Trajectory, straight: jax.Array, config: PathConfig) -> tuple[jax.Array, jax.Array]:
    """Costs [P] s of paths (Eq. 12) and violations [P]; `straight` is the straight line's time, s."""
    cost = trajectory.travel_time + trajectory.price + straight * _penalty(trajectory.excess, config)
    return cost, reduce(jnp.add, trajectory.excess).mean(axis=0)


def _penalty(excess: tuple[jax.Array, ...], config: PathConfig) -> jax.Array:
    """[P], weighted mean excess of paths (Eq. 12)."""
    weights = [getattr(config.penalties, name) for name in VIOLATIONS]
    weighted = [weight * plane for weight, plane in zip(weights, excess, strict=True)]
    return reduce(jnp.add, weighted).mean(axis=0)
