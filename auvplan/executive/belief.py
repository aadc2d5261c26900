"""A vehicle's belief about the obstacles on its leg: rough beforehand, accurate within sensor range."""

import numpy as np
from numpy.typing import NDArray

from auvplan.ocean.obstacles import CONFIDENCE, Obstacles, closest_approach
from auvplan.runtime.arrays import Array
from auvplan.scenario.settings import SensorSettings
from auvplan.simulation.world import KNOWN, TrueObstacles


class ObstacleBelief:
    """One vehicle's belief about the M obstacles of its leg.

    Positions, velocities over ground and radii are measured with Gaussian error (section 2); between two
    looks an obstacle is taken to go on as it was, inside a boundary that grows. Of those that are known
    beforehand all is certain.
    """

    def __init__(
        self,
        truth: TrueObstacles,
        moves: Array,
        now: float,
        sensors: SensorSettings,
        rng: np.random.Generator,
    ):
        """Prior knowledge at the start of a leg; `moves` [M, 3] m/s are the true velocities over ground."""
        self._sensors = sensors
        self._rng = rng
        count = len(truth.radius)
        self.position = np.zeros((count, 3))
        self.velocity = np.zeros((count, 3))
        self.radius = np.zeros(count)
        self.std = np.zeros(count)
        self.observed_at = np.zeros(count)
        self._known = np.asarray([kind == KNOWN for kind in truth.kinds], bool)
        self.unknown = ~self._known
        self._moving = (truth.drift > 0) | self._known
        self._measure(np.ones(count, bool), truth, moves, now, sensors.prior_std)

    @property
    def certain(self) -> bool:
        """Whether all obstacles were known before the mission."""
        return bool(self._known.all())

    @property
    def growth(self) -> Array:
        """[M] m/s, growth of the boundaries between two looks."""
        return self._sensors.growth * self.unknown

    def within(self, vehicle: Array, seconds: float, speed: float) -> NDArray[np.bool_]:
        """[M], whether a vehicle at [3] m may meet them within `seconds` at a speed, m/s."""
        away = np.linalg.norm(self.position - vehicle, axis=1) - self.radius
        return away <= seconds * (speed + np.linalg.norm(self.velocity, axis=1))

    def look(
        self, vehicle: Array, truth: TrueObstacles, moves: Array, now: float, blind: bool = False
    ) -> NDArray[np.bool_]:
        """Measure the obstacles within sensor range of the vehicle at [3] m; none where it is blind.

        Returns:
            Which they are, [M].
        """
        away = np.linalg.norm(truth.position - vehicle, axis=1) - truth.radius
        seen = (away <= self._sensors.range) & (not blind)
        self._measure(seen, truth, moves, now, self._sensors.position_std)
        return seen

    def _measure(
        self, seen: NDArray[np.bool_], truth: TrueObstacles, moves: Array, now: float, std: float
    ) -> None:
        # All draws are made whether seen or not: the stream of random numbers does not depend on the path.
        stds = std * self.unknown
        position = truth.position + stds[:, None] * self._rng.normal(size=truth.position.shape)
        radius = np.maximum(truth.radius + stds * self._rng.normal(size=truth.radius.shape), 1.0)
        errors = self._sensors.velocity_std * self._rng.normal(size=moves.shape)
        velocity = moves + errors * self.unknown[:, None]
        self.position[seen] = position[seen]
        self.velocity[seen] = np.where(self._moving[:, None], velocity, 0.0)[seen]
        self.radius[seen] = radius[seen]
        self.std[seen] = stds[seen]
        self.observed_at[seen] = now

    def clearance(self, positions: Array, times: Array) -> Array:
        """Return the distance along a path to the nearest collision boundary, [n] m.

        Between each of n places [n, 3] m, [n] s and the next it is taken where the vehicle comes nearest to
        the centre of each obstacle; at the last place, there.
        """
        if not len(self.radius):
            return np.full(len(times), np.inf)
        since = np.maximum(times[:, None] - self.observed_at, 0.0)
        centre = self.position + self.velocity * since[..., None]
        distance, share = closest_approach(positions[:, None] - centre)
        since = since + share * np.diff(since, axis=0, append=since[-1:])
        grown = np.minimum(self._sensors.growth * since, self._sensors.growth_max) * self.unknown
        return (distance - self.radius - CONFIDENCE * np.sqrt(2.0) * self.std - grown).min(axis=1)


def as_obstacles(beliefs: list[ObstacleBelief], sensors: SensorSettings) -> Obstacles:
    """Beliefs of B vehicles for the planner; leaves with a leading axis B."""

    def stacked(name: str) -> Array:
        return np.stack([getattr(belief, name) for belief in beliefs])

    radius, std = stacked("radius"), stacked("std")
    constant = np.ones_like(radius)
    fields = {
        "position": stacked("position"),
        "velocity": stacked("velocity"),
        "drift": 0.0 * constant,
        "radius": radius,
        "position_std": std,
        "radius_std": std,
        "growth": stacked("growth"),
        "growth_max": sensors.growth_max * constant,
        "observed_at": stacked("observed_at"),
        "active": np.ones(radius.shape, bool),
    }
    return Obstacles(**fields)  # type: ignore[arg-type]
