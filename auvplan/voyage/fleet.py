"""Missions under way together: what they share, and the leg that each is on."""

from dataclasses import dataclass, field

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.ocean.chart import Chart
from auvplan.path import PathConfig, PathPlan
from auvplan.vehicle import Vehicle
from auvplan.voyage.batching import Clock
from auvplan.voyage.belief import ObstacleBelief
from auvplan.voyage.records import LegRecord
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
