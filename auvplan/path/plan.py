"""What the path planner returns."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from datetime import datetime
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.bbo import History
from auvplan.path.bound import Bound, lower_bound
from auvplan.path.cost import VIOLATIONS
from auvplan.path.motion import Motion
from auvplan.path.reasons import STATUS, PathStatus, explanation, lengthening
from auvplan.path.sensitivity import Conditions, Sensitivity, sensitivity
from auvplan.runtime.formatting import ReprMixin, between, counted

Array = NDArray[np.floating]


@dataclass(frozen=True, repr=False, eq=False)
class PathPlan(ReprMixin):
    """A timed, checked trajectory between two points.

    Attributes:
        travel_time: s.
        length: m.
        positions: [S, 3] m, north, east, depth.
        times: [S] s since the epoch.
        control_points: [n, 3] m, ends included.
        violations: [V] mean excess of each limit in `VIOLATIONS`; zero means kept.
        clearance: m, least certified distance to coast and collision boundaries; infinite in open water.
        altitude: m, least certified altitude above the sea bed; infinite where none is given.
        cost: s, with price and penalties (Eq. 12).
        population: [P, 3 n] m, habitats to re-plan from.
        history: cost and violation by iteration.
        excess: [V, S - 1] excess of each limit on each segment.
        water: [S - 1, 3] m/s north, east, down, the current met in the middle of each segment.
        conditions: what it was planned for.
        closed: m, size of the cells at which time-to-reach fields find no passage clear of coast and
            obstacles; zero where they find one, or do not look for any.
        sampling_error: m/s, by which samples that the path was searched for in differ from the current at
            most, as far as random places show; zero where it was searched for in the current itself
            (`PathConfig.sampled`). Times and limits are those in the current.
        sampling_time_error: s, by which the travel time in these samples differs from that in the current.
    """

    travel_time: float
    length: float
    positions: Array
    times: Array
    control_points: Array
    violations: Array
    clearance: float
    altitude: float
    cost: float
    population: jax.Array
    history: History
    excess: Array
    water: Array
    conditions: Conditions = field(repr=False)
    closed: float = 0.0
    sampling_error: float = 0.0
    sampling_time_error: float = 0.0

    @classmethod
    def unsearched(cls, conditions: Conditions, excess: Array, **fields: Any) -> "PathPlan":
        """Return a plan that no search has found: no population, and no history unless one is given."""
        nothing = jnp.zeros(0)
        own = {
            "violations": excess.mean(axis=1),
            "population": jnp.zeros((0, 3 * conditions.config.control_points)),
            "history": History(*[nothing] * len(History.__dataclass_fields__)),
        }
        return cls(**own | fields, excess=excess, conditions=conditions)

    @property
    def feasible(self) -> bool:
        """Whether every limit is kept along the whole path."""
        return bool(self.violations.sum() == 0.0)

    def _repr_items(self) -> dict[str, str]:
        return {
            "": "feasible" if self.feasible else f"not feasible ({', '.join(self.broken())})",
            "travel time": f"{self.travel_time:,.0f} s",
            **({"above its lower bound": f"{self.gap:.1%} at most"} if self._bounded else {}),
            "length": f"{self.length:,.0f} m",
            "clearance": f"{self.clearance:,.1f} m" if np.isfinite(self.clearance) else "open water",
            **({"altitude": f"{self.altitude:,.1f} m"} if np.isfinite(self.altitude) else {}),
            "departure": f"{float(self.times[0]):,.0f} s",
            **({"searched in samples": self._sampling} if self.sampling_error else {}),
            **({"it": self.lengthened} if self.lengthened else {}),
        }

    @property
    def lengthened(self) -> str:
        """One line where the path is longer since the straight line is too steep; else empty."""
        return lengthening(self.positions, self.travel_time, self.conditions.vehicle)

    @property
    def violation_history(self) -> jax.Array:
        """Mean violation of the population by iteration, [I + 1]."""
        return self.history.violation_mean

    @property
    def status(self) -> PathStatus:
        """OK, or the limit that is broken most."""
        if self.feasible:
            return PathStatus.OK
        if self.closed and {"coast", "obstacle"} & set(self.broken()):
            return PathStatus.NO_WAY
        return STATUS[self.broken()[0]]

    @property
    def reason(self) -> str:
        """One line: the binding limit and the value that breaks it, where and when, and what to do."""
        if self.feasible:
            return self.status.value
        if self.status is PathStatus.NO_WAY:
            return f"no passage as wide as {self.closed:.3g} m: {self.status.value}"
        return self.explain(self.broken()[0])

    @cached_property
    def motion(self) -> Motion:
        """Attitude and velocities of the vehicle on each of the S - 1 segments, see `Motion.along`.

        They follow the plan's reading of speed (`PathConfig.speed_reading`): "track" crabs, so that `course`
        is Eq. 10's psi of the segment and `yaw` and `pitch` say where the hull points to hold it; in "eq8"
        and "eq11" `yaw` and `pitch` are Eq. 10's, and in "eq8" the course differs by the drift. In "track"
        the speed through the water is |v| wherever the limit "current" is kept: elsewhere the vehicle would
        have to be faster.
        """
        conditions = self.conditions
        speed, reading = float(np.asarray(conditions.vehicle.speed)), conditions.config.speed_reading
        return Motion.along(reading, speed, np.diff(np.asarray(self.positions, float), axis=0), self.water)

    @property
    def course(self) -> Array:
        """Course over ground on each segment, from north towards east, [S - 1] rad."""
        return self.motion.course

    @property
    def yaw(self) -> Array:
        """Heading psi of the hull on each segment, from north towards east, [S - 1] rad."""
        return self.motion.yaw

    @property
    def pitch(self) -> Array:
        """Pitch theta of the hull on each segment, nose up positive, [S - 1] rad."""
        return self.motion.pitch

    @property
    def ground_velocity(self) -> Array:
        """Velocity over ground on each segment, north, east, down, [S - 1, 3] m/s."""
        return self.motion.ground_velocity

    @property
    def body_velocity(self) -> Array:
        """Surge u, sway v and heave w on each segment, [S - 1, 3] m/s.

        They are the velocity over ground in axes of the hull: R(psi, theta) of Eq. 7 turns them back.

        Example:
            >>> import jax, auvplan as ap
            >>> stream = ap.UniformCurrent(0.0, 1.5)
            >>> env = ap.Environment(stream, lower=(-500, -500, 0), upper=(2500, 500, 0))
            >>> plan = ap.plan_path((0, 0, 0), (2000, 0, 0), env, key=jax.random.key(0))
            >>> [round(float(c), 1) + 0.0 for c in plan.body_velocity[0]]  # at 2 m/s to the north
            [1.6, 1.2, 0.0]
        """
        return self.motion.body_velocity

    def sensitivity(self) -> Sensitivity:
        """How the travel time along this path answers to departure, vehicle speed and current strength.

        Example:
            >>> import jax, auvplan as ap
            >>> stream = ap.UniformCurrent(0.5, 0.0)
            >>> env = ap.Environment(stream, lower=(-500, -500, 0), upper=(3500, 500, 0))
            >>> plan = ap.plan_path((0, 0, 0), (3000, 0, 0), env, key=jax.random.key(0))
            >>> slopes = plan.sensitivity()
            >>> round(plan.travel_time)  # 3000 m at 2.5 + 0.5 m/s
            1000
            >>> round(slopes.speed)  # -3000 / 3.0**2 s per m/s
            -333
            >>> round(slopes.current)  # -0.5 * 3000 / 3.0**2 s for a current twice as strong, at this rate
            -167
        """
        return sensitivity(self.positions, float(self.times[0]), self.conditions)

    def bounded(self, fineness: float = 1.0) -> Bound:
        """Bound the travel time of all paths for what this one was planned for, see `auvplan.path.bound`.

        Args:
            fineness: factor on the cells of the grid along each axis: twice as many halve the gap, more or
                less, in four times the time, in depth eight times.
        """
        env, conditions = self.conditions.world(), self.conditions
        ends = np.asarray(self.positions[0], float), np.asarray(self.positions[-1], float)
        return lower_bound(
            *ends,
            env,
            conditions.vehicle,
            conditions.config,
            known=float(self.travel_time),
            depart=float(self.times[0]),
            fineness=fineness,
        )

    @cached_property
    def bound(self) -> Bound:
        """What no path can beat, worked out when it is first asked for: it takes as long as some plans."""
        return self.bounded()

    @property
    def _sampling(self) -> str:
        return f"of the current: off by {self.sampling_error:.2g} m/s, {self.sampling_time_error:.2g} s"

    @property
    def _bounded(self) -> bool:
        """Whether a finite gap has been worked out."""
        return "bound" in vars(self) and bool(np.isfinite(self.gap))

    @property
    def lower_bound(self) -> float:
        """Travel time that no path beats, s, see `bound`; that of a path that breaks limits may be less.

        Example:
            >>> import jax, auvplan as ap
            >>> stream = ap.UniformCurrent(0.5, 0.0)
            >>> env = ap.Environment(stream, lower=(-500, -500, 0), upper=(3500, 500, 0))
            >>> plan = ap.plan_path((0, 0, 0), (3000, 0, 0), env, key=jax.random.key(0))
            >>> round(plan.travel_time), 980 < plan.lower_bound <= 1000, plan.bound.kind
            (1000, True, 'certified')
        """
        return float(self.bound.travel_time)

    @property
    def gap(self) -> float:
        """Share by which the travel time is above the lower bound, at most; NaN where a limit is broken."""
        return (
            float(self.travel_time) / self.lower_bound - 1.0 if self.feasible and self.lower_bound else np.nan
        )

    def broken(self) -> tuple[str, ...]:
        """Return names of the limits that are not kept, the most broken first."""
        order = np.argsort(-self.violations, kind="stable")
        return tuple(VIOLATIONS[k] for k in order if self.violations[k] != 0.0)

    def explain(self, limit: str, epoch: datetime | None = None) -> str:
        """Where and when a limit of `VIOLATIONS` is broken most, by which value, and what to do about it.

        Args:
            limit: as `broken` names it.
            epoch: UTC, that times count from, to give the time of day; None for seconds since the epoch.

        Raises:
            ValueError: there is no such limit.

        Example:
            >>> import jax, auvplan as ap
            >>> from datetime import datetime
            >>> stream = ap.UniformCurrent(0.0, 1.9)
            >>> env = ap.Environment(stream, lower=(0, -50, 0), upper=(2000, 50, 0))
            >>> start, goal, config = (0, 0, 0), (2000, 0, 0), ap.PathConfig(finer=1)
            >>> plan = ap.plan_path(start, goal, env, key=jax.random.key(0), config=config, depart=14400.0)
            >>> plan.explain("sway", datetime(2024, 5, 1)).split(" at ")[0]
            'cross-current 1.9 m/s over 1.5'
        """
        return explanation(self, limit, epoch)


@dataclass(frozen=True, repr=False, eq=False)
class PathPlans(ReprMixin):
    """B plans; `plans[b]` is a `PathPlan`.

    Attributes are as in `PathPlan`, with a leading axis B; `violations` is [B, V], `excess` [B, V, S - 1],
    `water` [B, S - 1, 3]. A leg that was planned with more samples than the others (`PathConfig.finer`) has
    all of them in `plans[b]` alone; arrays hold what they are like at the samples of the others.

    Attributes:
        finer: fields of legs with more samples, by leg.
    """

    travel_time: Array
    length: Array
    positions: Array
    times: Array
    control_points: Array
    violations: Array
    clearance: Array
    altitude: Array
    cost: Array
    population: jax.Array
    history: History
    excess: Array
    water: Array
    closed: Array
    sampling_error: Array
    sampling_time_error: Array
    conditions: Conditions = field(repr=False)
    finer: Mapping[int, dict[str, Any]] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.travel_time)

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """[B]."""
        return self.violations.sum(axis=1) == 0.0

    def _repr_items(self) -> dict[str, str]:
        return {
            "": f"{self.feasible.sum():,} of {counted(len(self), 'plan')} feasible",
            "travel time": f"{between(self.travel_time)} s",
            "length": f"{between(self.length)} m",
        }

    def __getitem__(self, b: int) -> PathPlan:
        b = range(len(self))[b]
        own: dict[str, Any] | None = self.finer.get(b)
        if own is None:
            own = {name: jax.tree.map(lambda a: a[b], getattr(self, name)) for name in _FIELDS}
        own = own | {name: float(own[name]) for name in _NUMBERS}
        return PathPlan(**own, conditions=self.conditions.of_leg(b))

    def __iter__(self) -> Iterator[PathPlan]:
        return (self[b] for b in range(len(self)))


#: Fields of a plan that a batch has an array of, and those of them that are numbers.
_FIELDS = tuple(part.name for part in fields(PathPlan) if part.name != "conditions")
_NUMBERS = tuple(part.name for part in fields(PathPlan) if part.type is float)
