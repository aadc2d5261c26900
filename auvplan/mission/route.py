"""What the mission planner returns."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.bbo import History
from auvplan.energy.power import WATT_HOUR
from auvplan.mission.bound import Array, IntArray, upper_bound, with_return_margin
from auvplan.mission.graph import time_to_go
from auvplan.mission.labels import Clocked, least_within_reach
from auvplan.mission.speeds import RouteSpeeds
from auvplan.mission.timetable import Timetable
from auvplan.runtime.formatting import ReprMixin, between, counted, figure, shortened


class MissionStatus(Enum):
    """How a mission search ended; the text says what to do."""

    OK = "feasible mission found"
    UNREACHABLE = "no way through the graph leads to the destination: add edges or choose another destination"
    OUT_OF_TIME = (
        "the destination cannot be reached in the time available: "
        "allow more time, go faster or choose a nearer destination"
    )
    OUT_OF_ENERGY = (
        "the destination cannot be reached in time with the energy available: "
        "charge more, allow more time or choose a nearer destination"
    )
    NOT_FOUND = "no mission was found: raise bbo.population or bbo.iterations"


#: Attributes of a route that are single numbers.
_NUMBERS = {
    "time": float, "priority": float, "tasks": int, "cost": float, "least_time": float,
    "time_available": float, "return_margin": float,
}  # fmt: skip


@dataclass(frozen=True, repr=False, eq=False)
class MissionRoute(ReprMixin):
    """An ordered list of tasks.

    Attributes:
        nodes: [n] waypoints from the start to the destination; the start alone where there is no mission.
        time: T_Mission, s, travel and tasks (Eq. 14).
        priority: sum of rho over the tasks taken.
        tasks: number of edges taken that carry a task.
        cost: of the objective.
        leg_times: [n - 1] s, expected t_ij of each leg, travel, waiting and task (Eq. 13).
        waits: [n - 1] s of them that pass between the arrival and the opening of the task's window.
        status: OK, or why there is no mission.
        least_time: s, shortest time to the destination; infinite where it cannot be reached.
        time_available: T_available, s.
        population: [P, D] habitats, best first, to plan again from.
        history: cost and violation by iteration.
        edge_times: [N, N] s, t_ij of all edges that were open to the mission; infinite elsewhere.
        edge_priority: [N, N] rho_ij.
        goal: index of the destination.
        return_margin: share by which the return was taken to last longer than expected.
        proven_bound: bound on the total priority that an exact search proved; None without one.
        timetable: by which it was planned, and `duration` [N, N] s of tasks; None where nothing depends on
            the clock. Edge times are the least then.
        speeds: that were chosen, and the energy of the legs; None where energy does not count. Edge times are
            the least at any speed then, and the timetable's those at the speeds chosen.
        passed: legs (i, j) of the mission before this route, which `replan_mission` planned the rest of.
    """

    nodes: IntArray
    time: float
    priority: float
    tasks: int
    cost: float
    leg_times: Array
    waits: Array
    status: MissionStatus
    least_time: float
    time_available: float
    population: IntArray
    history: History
    edge_times: Array
    edge_priority: Array
    goal: int
    return_margin: float = 0.0
    proven_bound: float | None = None
    timetable: Timetable | None = None
    duration: Array | None = None
    speeds: RouteSpeeds | None = None
    passed: tuple[tuple[int, int], ...] = ()

    @property
    def feasible(self) -> bool:
        """Whether the route leads to the destination in time."""
        return self.status is MissionStatus.OK

    def _repr_items(self) -> dict[str, str]:
        if not self.feasible:
            return {"": f"not feasible ({self.status.name.lower().replace('_', ' ')})"}
        return {
            "": "feasible",
            "tasks": f"{self.tasks:,}",
            "priority": figure(self.priority, 6),
            "time": f"{self.time:,.0f} of {self.time_available:,.0f} s",
            "waypoints": shortened([str(int(node)) for node in self.nodes]),
        }

    @cached_property
    def bound(self) -> float:
        """No route from here has more total priority; worked out on first use, see `upper_bound`."""
        if self.proven_bound is not None:
            return self.proven_bound
        given = self.limiting_times, self.edge_priority, int(self.nodes[0]), self.goal, self.time_available
        shares = [] if self.speeds is None else self.speeds.shares(self.time_available)
        return upper_bound(*given, limits=shares)

    @property
    def limiting_times(self) -> Array:
        """[N, N] s, `edge_times` with the return margin on the last leg: no route that keeps it is late.

        By the clock each edge takes its least time within reach.
        """
        start = int(self.nodes[0])
        times = self.edge_times if self.timetable is None else least_within_reach(self.clocked)
        return with_return_margin(times, start, self.goal, self.return_margin)

    @property
    def clocked(self) -> Clocked:
        """The mission by the clock, for one that has a timetable; at the least times of all speeds."""
        assert self.timetable is not None
        assert self.duration is not None
        open_, start = np.isfinite(self.edge_times), int(self.nodes[0])
        ends, timetable = (start, self.goal, self.time_available), self.timetable
        if self.speeds is not None:
            timetable = replace(timetable, travel_time=self.speeds.options.travel_time.min(axis=0))
        return Clocked(timetable, self.duration, self.edge_priority, open_, *ends)

    @property
    def gap(self) -> float:
        """(bound - priority) / bound: at most this share of the attainable priority is missed."""
        return max(0.0, 1.0 - self.priority / self.bound) if self.bound > 0.0 else 0.0

    @property
    def reason(self) -> str:
        """One line: how the search ended, with the figures that matter."""
        if self.status is MissionStatus.OUT_OF_TIME:
            needs = (
                f"the shortest way takes {self.least_time:.1f} s, {self.time_available:.1f} s are available"
            )
            return f"{self.status.value} ({needs})"
        if self.status is MissionStatus.OUT_OF_ENERGY and self.speeds is not None:
            energies = self.speeds.energies_of_edges.min(axis=0)
            least = float(time_to_go(energies, self.goal)[int(self.nodes[0])]) / WATT_HOUR
            needs = f"the way of least energy takes {least:.1f} Wh"
            return f"{self.status.value} ({needs}, {self.speeds.available / WATT_HOUR:.1f} Wh are available)"
        return self.status.value


@dataclass(frozen=True, repr=False, eq=False)
class MissionRoutes(ReprMixin):
    """B routes from one compiled call; `routes[b]` is a `MissionRoute`.

    Attributes are as in `MissionRoute`, with a leading axis B; `nodes` is [B, N], padded with -1, `leg_times`
    and `waits` [B, N - 1], padded with zeros, `count` [B] the number of waypoints of each route, `goals` [B].
    """

    nodes: IntArray
    count: IntArray
    time: Array
    priority: Array
    tasks: IntArray
    cost: Array
    leg_times: Array
    waits: Array
    status: tuple[MissionStatus, ...]
    least_time: Array
    time_available: Array
    population: IntArray
    history: History
    edge_times: Array
    edge_priority: Array
    goals: IntArray
    return_margin: Array
    timetable: Timetable | None = None
    duration: Array | None = None
    speeds: RouteSpeeds | None = None

    def __len__(self) -> int:
        return len(self.status)

    def __iter__(self) -> Iterator[MissionRoute]:
        return (self[b] for b in range(len(self)))

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """[B]."""
        return np.array([status is MissionStatus.OK for status in self.status], bool)

    def _repr_items(self) -> dict[str, str]:
        return {
            "": f"{self.feasible.sum():,} of {counted(len(self), 'route')} feasible",
            "tasks": between(self.tasks),
            "priority": between(self.priority),
            "time": f"{between(self.time)} s",
        }

    def __getitem__(self, b: int) -> MissionRoute:
        count = int(self.count[b])
        rows = {k: v for k, v in vars(self).items() if k not in ("count", "goals", "status")}
        row = jax.tree.map(lambda leaf: leaf[b], rows)
        row |= {name: kind(row[name]) for name, kind in _NUMBERS.items()}
        row |= {"nodes": row["nodes"][:count]} | {k: row[k][: count - 1] for k in ("leg_times", "waits")}
        if (speeds := row["speeds"]) is not None:
            legs, energies = speeds.legs[: count - 1], speeds.energies[: count - 1]
            row["speeds"] = replace(speeds, legs=legs, energies=energies, available=float(speeds.available))
        return MissionRoute(**row, status=self.status[b], goal=int(self.goals[b]))
