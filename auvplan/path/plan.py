"""What the path planner returns."""

from dataclasses import dataclass, field, replace
from enum import Enum

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.bbo import History
from auvplan.path.cost import VIOLATIONS
from auvplan.path.sensitivity import Conditions, Sensitivity, sensitivity

Array = NDArray[np.floating]


class PathStatus(Enum):
    """How a path search ended; the text says what to do."""

    OK = "feasible path found"
    SURGE = "ground speed exceeds the surge limit: raise vehicle.surge_max or slow down"
    SWAY = (
        "the current across the track exceeds the sway limit: raise vehicle.sway_max or wait for slack water"
    )
    TURN_RATE = "the path turns too sharply: raise vehicle.turn_rate_max or move the waypoints apart"
    COAST = "no way clear of the coast was found: widen the search (PathConfig.width) or move the waypoints"
    OBSTACLE = "no way clear of the obstacles was found: widen the search, raise iterations, or wait"
    CURRENT = "the current is stronger than the vehicle: wait for slack water or choose a faster vehicle"


_STATUS: dict[str, PathStatus] = dict(zip(VIOLATIONS, list(PathStatus)[1:], strict=True))


@dataclass(frozen=True)
class PathPlan:
    """A timed, checked trajectory between two points.

    Attributes:
        travel_time: s.
        length: m.
        positions: [S, 3] m, north, east, depth.
        times: [S] s since the epoch.
        control_points: [n, 3] m, ends included.
        violations: [V] mean excess of each limit in `VIOLATIONS`; zero means kept.
        clearance: m, least certified distance to coast and collision boundaries; 1e6 in open water.
        cost: s, with price and penalties (Eq. 12).
        population: [P, 3 n] m, habitats to re-plan from.
        history: cost and violation by iteration.
        excess: [V, S - 1] excess of each limit on each segment.
        conditions: what it was planned for.
    """

    travel_time: float
    length: float
    positions: Array
    times: Array
    control_points: Array
    violations: Array
    clearance: float
    cost: float
    population: jax.Array
    history: History
    excess: Array
    conditions: Conditions = field(repr=False)

    @property
    def feasible(self) -> bool:
        """Whether every limit is kept along the whole path."""
        return bool(self.violations.sum() == 0.0)

    @property
    def violation_history(self) -> jax.Array:
        """Mean violation of the population by iteration, [I + 1]."""
        return self.history.violation_mean

    @property
    def status(self) -> PathStatus:
        """OK, or the limit that is broken most."""
        if self.feasible:
            return PathStatus.OK
        return _STATUS[self.broken()[0]]

    @property
    def reason(self) -> str:
        """One line: the binding limit, where along the leg it is broken most, and what to do."""
        if self.feasible:
            return self.status.value
        return self.explain(self.broken()[0])

    def sensitivity(self) -> Sensitivity:
        """How the travel time along this path answers to departure, vehicle speed and current strength.

        Example:
            >>> import jax, auvplan as ap
            >>> stream = lambda x, y, z, t: (0.5, 0.0, 0.0)
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

    def broken(self) -> tuple[str, ...]:
        """Names of the limits that are not kept, the most broken first."""
        order = np.argsort(-self.violations, kind="stable")
        return tuple(VIOLATIONS[k] for k in order if self.violations[k] != 0.0)

    def explain(self, limit: str) -> str:
        """Where along the leg a limit of `VIOLATIONS` is broken most, and what to do about it."""
        index = VIOLATIONS.index(limit)
        segment = int(np.argmax(self.excess[index]))
        gaps = np.linalg.norm(np.diff(self.positions, axis=0), axis=1)
        place = float(gaps[:segment].sum()) / 1000.0
        return f"{limit} limit broken at km {place:.1f} of {self.length / 1000.0:.1f}: {_STATUS[limit].value}"


@dataclass(frozen=True)
class PathPlans:
    """B plans; `plans[b]` is a `PathPlan`.

    Attributes: as in `PathPlan`, with a leading axis B; `violations` is [B, V], `excess` [B, V, S - 1].
    """

    travel_time: Array
    length: Array
    positions: Array
    times: Array
    control_points: Array
    violations: Array
    clearance: Array
    cost: Array
    population: jax.Array
    history: History
    excess: Array
    conditions: Conditions = field(repr=False)

    def __len__(self) -> int:
        return len(self.travel_time)

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """[B]."""
        return self.violations.sum(axis=1) == 0.0

    def __getitem__(self, b: int) -> PathPlan:
        return PathPlan(
            float(self.travel_time[b]),
            float(self.length[b]),
            self.positions[b],
            self.times[b],
            self.control_points[b],
            self.violations[b],
            float(self.clearance[b]),
            float(self.cost[b]),
            self.population[b],
            jax.tree.map(lambda a: a[b], self.history),
            self.excess[b],
            self.conditions if self.conditions.leg is None else replace(self.conditions, leg=b),
        )

    def __iter__(self):
        return (self[b] for b in range(len(self)))
