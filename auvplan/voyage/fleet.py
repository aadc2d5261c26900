"""Missions under way together: what they share, how far each one is, and the leg that it is on."""

from dataclasses import dataclass, field

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.mission import MissionGraph, MissionOrder
from auvplan.ocean.chart import Chart
from auvplan.path import PathConfig, PathPlan
from auvplan.vehicle import Vehicle
from auvplan.voyage.batching import Clock
from auvplan.voyage.belief import ObstacleBelief
from auvplan.voyage.records import LegRecord, MissionRun
from auvplan.voyage.scenario import Scenario
from auvplan.voyage.simulator import TrueCurrent
from auvplan.voyage.world import TrueObstacles

Array = NDArray[np.floating]


@dataclass
class Fleet:
    """B missions in one sea area: what they share, and each one's clock and sources of chance.

    Attributes:
        scenario: settings.
        config: of the path planner.
        vehicle: speed and limits.
        chart: coast, or None.
        current: the truth.
        keys: [B] planner keys.
        rngs: B generators for obstacles and sensors.
        now: [B] s.
        path_calls: [B] planning calls so far, which number the keys.
    """

    scenario: Scenario
    config: PathConfig
    vehicle: Vehicle
    chart: Chart | None
    current: TrueCurrent
    keys: jax.Array
    rngs: list[np.random.Generator]
    now: Array
    path_calls: NDArray[np.int_]
    clock: Clock = field(default_factory=Clock)

    def key(self, mission: int) -> jax.Array:
        """A fresh key for the mission's next path planning call."""
        self.path_calls[mission] += 1
        return jax.random.fold_in(self.keys[mission], int(self.path_calls[mission]))


@dataclass
class Mission:
    """One mission under way: its graph as it shrinks, where it stands, what it follows.

    Attributes:
        run: the record.
        graph: waypoints and the tasks that are left.
        timed: the same with the travel times expected now, and without edges that the sea closes.
        here: waypoint reached.
        order: of tasks that is followed, and `step` the place in it.
        slack: s that the order left of the available time, less the reserve, when it was made.
        cause: why a new order is due, or empty.
        learnt: s, travel times of edges (i, j) whose planned path was refused for its time.
        refusals: of legs in a row.
    """

    run: MissionRun
    graph: MissionGraph
    timed: MissionGraph
    here: int
    order: MissionOrder | None = None
    step: int = 0
    slack: float = 0.0
    cause: str = "start"
    learnt: dict[tuple[int, int], float] = field(default_factory=dict)
    refusals: int = 0
    ended: bool = False

    @property
    def rest(self) -> list[int]:
        """Waypoints of the order from the one reached to the destination; empty without an order."""
        return [] if self.order is None else [int(node) for node in self.order.nodes[self.step :]]

    def end(self, now: float, reason: str) -> None:
        """Book the end; an empty reason means that the destination was reached."""
        run = self.run
        self.ended = True
        run.t_mission = now
        run.arrived = self.here == run.goal and not reason
        late = run.t_mission >= run.t_available
        run.reason = reason or "destination reached" + (" too late" if late else " in time")


@dataclass
class Leg:
    """One vehicle on its way between two waypoints."""

    mission: int
    record: LegRecord
    origin: Array
    target: Array
    truth: TrueObstacles
    moves: Array
    belief: ObstacleBelief
    plan: PathPlan | None = None
    track: Array = field(default_factory=lambda: np.zeros((0, 3)))
    arc: float = 0.0
    moving: bool = True
    escaping: bool = False
    windows: list[float] = field(default_factory=list)
    stopped: str = ""
    stretches: list[tuple[Array, Array, Array]] = field(default_factory=list)

    @property
    def position(self) -> Array:
        """[3] m, where the vehicle is."""
        return self.stretches[-1][1][-1] if self.stretches else self.origin

    @property
    def followed(self) -> PathPlan:
        """The plan being followed; there is one from the leg's beginning on."""
        assert self.plan is not None
        return self.plan

    @property
    def under_way(self) -> bool:
        return not self.record.arrived and not self.stopped
