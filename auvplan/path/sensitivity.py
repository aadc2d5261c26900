"""Travel times along tracks, and how planned ones answer to what they were planned for."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax.typing import ArrayLike

from auvplan.ocean.currents import Current, Velocity, combine, is_steady, partition
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.ocean.raster import is_traced
from auvplan.path.config import GUIDE_ALTITUDE, GUIDE_MARGIN, PathConfig
from auvplan.path.cost import VIOLATIONS, Track, Trajectory, evaluate, tracks
from auvplan.path.ends import check_concrete, check_given, check_moment
from auvplan.path.problem import WAY, Problem, factor_of
from auvplan.path.profile import timed
from auvplan.runtime.arguments import numbers
from auvplan.runtime.compiled import compiled
from auvplan.runtime.packed import in_form_of
from auvplan.vehicle import VERTICAL_LIMITS, SpeedReading, Vehicle

#: Start and goal [3] m, environment, vehicle, and departure, s since the epoch.
Given = tuple[Any, Any, Environment, Any, Any]

#: Gradient steps of the last polish of more paths, along the quickest of which a derivative is taken. One
#: within tenths of a percent of the least time may be so far from settled that limits seem to cost nothing.
SETTLING_STEPS = 300, 1000

#: Limits bind from these multiples of a polish's margins to coast, obstacles and the bed on, and from this
#: share of other limits on: paths settle one or two hundredths inside these.
_REACH, _REACH_ABOVE, _NEARLY = 2.0, 5.0, 0.98


@dataclass(frozen=True, eq=False)
class Conditions:
    """What a path was planned for: the world, one leg's of a batch or that of all, vehicle and settings."""

    env: Environment
    vehicle: Vehicle
    config: PathConfig
    leg: int | None = None

    @classmethod
    def of(
        cls, env: Environment, vehicle: Vehicle | None, config: PathConfig | None, world_per_leg: bool
    ) -> "Conditions":
        """Return those of a batch, with defaults where there is no vehicle or setting."""
        vehicle = (vehicle or Vehicle()).without_power()
        return cls(env, vehicle, config or PathConfig(), 0 if world_per_leg else None)

    def of_leg(self, leg: int) -> "Conditions":
        """Return those of one leg of a batch."""
        vehicle, known = self.vehicle, self.vehicle.navigation
        if known is not None and np.ndim(known.way):
            own = known.since(*(np.asarray(part)[leg] for part in (known.way, known.unlocked)))
            vehicle = replace(vehicle, navigation=own)
        return replace(self, vehicle=vehicle, leg=None if self.leg is None else leg)

    def world(self) -> Environment:
        """Return the leg's own world."""
        if self.leg is None:
            return self.env
        shared, current = partition(self.env.current)
        own = jax.tree.map(lambda leaf: leaf[self.leg], (current, self.env.obstacles))
        return replace(self.env, current=combine(shared, own[0]), obstacles=own[1])


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of the travel time, times[-1] - times[0], along a path that stays as it is.

    Around the fastest path they are those of the fastest travel time as well, as long as no limit of the path
    binds: a small change of the path changes its time by nothing then. The time of arrival, times[-1], moves
    by one second more for each second of later departure, as do all of times[1:]: times[0] is the departure.

    Arrival times are followed segment by segment in every current, gradual ones included, and nothing on that
    way stops a derivative. Two kinds of kinks remain. Where the current beats the vehicle, progress stays at
    `SPEED_FLOOR` of its speed and no longer answers to the current. Between the nodes of a gridded current
    slopes in time and place are those of its interpolation, constant within a cell along each axis.

    Attributes:
        departure: s per s of later departure; 0 in a steady current.
        speed: s per m/s of speed through the water; negative.
        current: s per unit of relative strength of the current: a hundredth of it for one per cent more.
    """

    departure: float
    speed: float
    current: float


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Scaled:
    """A current made `factor` times as strong."""

    current: Current
    factor: jax.Array

    @property
    def steady(self) -> bool:
        return is_steady(self.current)

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        u, v, w = self.current(x, y, z, t)
        return u * self.factor, v * self.factor, w * self.factor


def sensitivity(positions: np.ndarray, depart: float, conditions: Conditions) -> Sensitivity:
    """Derivatives along a path through positions [S, 3] m that departs at a time, s since the epoch."""
    env = conditions.world()
    slopes = _slopes(
        jnp.asarray(positions, float),
        jnp.asarray(depart, float),
        env,
        conditions.vehicle,
        config=timed(conditions.config, env.current),
    )
    return Sensitivity(*(float(slope) for slope in slopes))


@partial(compiled, static_argnames=("config",))
def _slopes(
    positions: jax.Array, depart: jax.Array, env: Environment, vehicle: Vehicle, config: PathConfig
) -> tuple[jax.Array, ...]:
    def of(depart: jax.Array, speed: jax.Array, factor: jax.Array) -> jax.Array:
        world = replace(env, current=_Scaled(env.current, factor))
        return _along(positions, world, replace(vehicle, speed=speed), depart, config).travel_time[0]

    slopes: Callable[..., tuple[jax.Array, ...]] = jax.grad(of, argnums=(0, 1, 2))
    return slopes(depart, jnp.asarray(vehicle.speed, positions.dtype), jnp.ones((), positions.dtype))


def travel_time(
    points: ArrayLike,
    env: Environment,
    vehicle: Vehicle | None = None,
    depart: ArrayLike = 0.0,
    speed_reading: SpeedReading = "track",
) -> jax.Array:
    """Compute the time along a track in the current, s: a pure function for `jax.jit`, `vmap` and `grad`.

    Each segment is followed at the ground speed in the current that is met at several places on it (Eq. 11),
    so that points must lie close together where the current changes, as those of `PathPlan.positions` do.
    Limits, coast, obstacles and sea bed play no part.

    Args:
        points: [S, 3] m, north, east, depth, in the order in which they are passed.
        env: the world; of it, the current counts.
        vehicle: of it, the speed counts; defaults to `Vehicle()`.
        depart: s since the epoch.
        speed_reading: as in `PathConfig`.

    Raises:
        ValueError: points are not finite [S, 3] with at least two rows, or the departure is not one finite
            number, or too far from the epoch for single precision.
        TypeError: the environment or the vehicle is none, or points or departure are no numbers.

    Example:
        >>> import jax, auvplan as ap
        >>> env = ap.Environment(ap.UniformCurrent(0.5, 0.0))
        >>> points = jax.numpy.array([[0.0, 0.0, 0.0], [1500.0, 0.0, 0.0], [3000.0, 0.0, 0.0]])
        >>> round(float(ap.travel_time(points, env)))  # 3000 m at 2.5 + 0.5 m/s
        1000
        >>> slope = jax.grad(lambda speed: ap.travel_time(points, env, ap.Vehicle(speed)))
        >>> round(float(slope(2.5)))  # -3000 / 3.0**2 s per m/s
        -333
    """
    check_given(env, vehicle)
    check_moment("depart", depart)
    if not is_traced(points) and not np.isfinite(points := numbers("points", points)).all():
        raise ValueError("points must be finite, m, got NaN or infinity")
    points = jnp.asarray(points, float)
    if points.ndim != 2 or points.shape[0] < 2 or points.shape[1] != 3:
        wanted = "[S, 3] m, north, east and depth, at least two"
        raise ValueError(f"points must be {wanted}, got shape {points.shape}")
    if not is_traced(depart) and np.ndim(depart):
        raise ValueError(f"depart must be one number, s since the epoch, got shape {np.shape(depart)}")
    config = timed(PathConfig(speed_reading=speed_reading), env.current)
    vehicle = (vehicle or Vehicle()).without_power()
    followed = _along(points, env, vehicle, jnp.asarray(depart, float), config)
    beaten = (followed.excess[VIOLATIONS.index("current")] > 0.0).any()
    return jnp.where(beaten, jnp.inf, followed.travel_time[0])


def _along(
    points: jax.Array, env: Environment, vehicle: Vehicle, depart: jax.Array, config: PathConfig
) -> Trajectory:
    """Follow a track through points [S, 3] m, by settings, in the current alone."""
    track = Track.through(*(points[:, axis, None] for axis in range(3)))
    bare = replace(env, chart=None, obstacles=Obstacles.none(), seabed=None, closures=(), price=None)
    return evaluate(track, depart, bare, vehicle, config)


def differentiable_time(
    plan: Callable[[Given, PathConfig], Any], given: Given, config: PathConfig, name: str
) -> tuple[jax.Array, Any]:
    """Plan while `jax.grad`, `jax.jvp` or the like differentiates, and return the least time and the plan.

    The derivative is that of the envelope theorem: along the least path, by everything given, the travel time
    changes as fast as the least one, plus what the limits that bind cost, each by its multiplier. It is taken
    along the quickest of the paths that are found with more and more steps in the last polish.

    Args:
        plan: takes what is given and settings, and returns a `PathPlan`.
        given: start, goal, environment, vehicle and departure, some leaves of which are differentiated.
        config: settings of the plan that is returned.
        name: of the public function, for messages.

    Raises:
        TypeError: what is given is traced by `jax.jit` or `jax.vmap`, or differentiated twice.
        ValueError: the plan breaks a limit, or its path pays a price: its time is not the least of anything.
    """
    plans: list[Any] = []

    @jax.custom_jvp
    def least_time(given: Given) -> jax.Array:
        check_concrete(name, given)
        plans.append(plan(given, config))
        return jnp.asarray(plans[-1].travel_time, float)

    @least_time.defjvp
    def _(primals: tuple[Given], tangents: tuple[Given]) -> tuple[jax.Array, jax.Array]:
        check_concrete(name, primals)  # traced once more, a second derivative is asked for
        time = least_time(*primals)
        along = plans[-1]
        # More steps may end on a slower path: where they lead one beyond a limit, another one is taken.
        for steps in SETTLING_STEPS if along.feasible else ():
            if steps > config.refine_steps:
                settled = plan(*primals, config.replace(refine_steps=steps))
                along = settled if settled.feasible and settled.travel_time < along.travel_time else along
        pairs = zip(_slopes_of_least(along, *primals), jax.tree.leaves(tangents), strict=True)
        terms = [jnp.vdot(slope, of) for slope, of in pairs if of.dtype != jax.dtypes.float0]
        return time, jnp.asarray(sum(terms), time.dtype)

    return least_time(given), plans[-1]


def _slopes_of_least(plan: Any, given: Given) -> list[jax.Array]:
    """Derivatives of a plan's time by the leaves of what it was planned for."""
    if not plan.feasible:
        raise ValueError(f"the time of a plan that breaks a limit has no derivative: {plan.reason}")
    env, points = plan.conditions.world(), np.asarray(plan.control_points)
    settings = timed(plan.conditions.config, env.current)
    config = settings.only().replace(
        coast_margin=settings.coast_margin,
        obstacle_margin=settings.obstacle_margin,
        uncertain_price=settings.uncertain_price,
        control_points=len(points) - 2,
        samples=len(plan.positions),
    )
    habitat = jnp.asarray(points[1:-1].T.reshape(-1), float)
    slope, near, sides, price = _at_optimum(habitat, given, config=config)
    if float(price) > 0.0:
        raise ValueError(
            "the time of a path that pays a price has no derivative: set PathConfig.uncertain_price=0 and "
            "leave out Environment.price and depth_toll, or differentiate ap.travel_time along plan.positions"
        )
    rows = np.concatenate([np.asarray(near, float).reshape(-1, habitat.size), np.asarray(sides, float)])
    bind = np.flatnonzero(rows.any(axis=1))
    multipliers = np.zeros(len(rows))
    multipliers[bind] = scipy.optimize.nnls(rows[bind].T, -np.asarray(slope, float))[0] if len(bind) else 0.0
    return in_form_of(given, _by_given(habitat, jnp.asarray(multipliers, float), given, config=config))


@partial(compiled, static_argnames=("config",))
def _at_optimum(
    habitat: jax.Array, given: Given, config: PathConfig
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Slopes of time, limits and box by the control points, zero where none binds; and the price."""
    slope = jax.grad(lambda habitat: _followed(habitat, given, config)[0])(habitat)
    limits, sides = jax.jacfwd(lambda habitat: _followed(habitat, given, config)[1:3])(habitat)
    return slope, limits, sides, _followed(habitat, given, config)[3]


@partial(compiled, static_argnames=("config",))
def _by_given(
    habitat: jax.Array, multipliers: jax.Array, given: Given, config: PathConfig
) -> list[jax.Array]:
    """Slopes of the Lagrangian by the leaves of what is given."""

    def lagrangian(given: Given) -> jax.Array:
        time, limits, sides, _ = _followed(habitat, given, config)
        return time + multipliers @ jnp.concatenate([limits.ravel(), sides])

    slopes = jax.tree.leaves(jax.grad(lagrangian, allow_int=True)(given))
    return [jnp.zeros(()) if slope.dtype == jax.dtypes.float0 else slope for slope in slopes]


def _followed(
    habitat: jax.Array, given: Given, config: PathConfig
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Time, s, of one path, its limits, what of the box its control points [3 n] touch, and its price, s.

    Limits count from a little before they bind on: a polish settles just inside.
    """
    start, goal, env, vehicle, depart = given
    factor = factor_of(start, goal)
    room, above_bed = (_REACH * GUIDE_MARGIN / factor, _REACH_ABOVE * GUIDE_ALTITUDE / factor)
    env = replace(env, obstacles=env.obstacles.resolved(env.current))
    if env.seabed is not None:
        env = replace(env, seabed=replace(env.seabed, clearance=env.seabed.clearance + above_bed))
    strict = vehicle.stricter(_NEARLY, "surge_max", "sway_max", "turn_rate_max", *VERTICAL_LIMITS.values())
    margins = {name: getattr(config, name) + room for name in ("coast_margin", "obstacle_margin")}
    track = tracks(habitat[None], Problem(start, goal, depart, env, vehicle), config)
    trajectory = evaluate(track, depart, env, strict, config.replace(**margins))
    points, touch = habitat.reshape(3, -1), 1e-4 * WAY / factor
    beyond = jnp.stack([env.lower[:, None] - points, points - env.upper[:, None]])
    sides = jnp.maximum(beyond + touch, 0.0).ravel()
    return trajectory.travel_time[0], jnp.stack(trajectory.excess)[:, :, 0], sides, trajectory.price[0]
