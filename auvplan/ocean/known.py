"""Obstacles that are known before a mission: upright cylinders that stand, or go on as they do."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: By how much the spheres that cover a cylinder are larger: share of its radius, or m.
EXCESS = 0.12, 1.0
#: What lies farther above or below the vehicle's depths is left out, m.
_BEYOND = 50.0
#: m north, east and down, where nothing goes.
_FAR_AWAY = 1e6


@dataclass(frozen=True)
class KnownObstacle:
    """An upright cylinder.

    Attributes:
        name: as messages and figures have it.
        position: north, east, m, at the scenario's epoch.
        radius: m.
        depth_min, depth_max: m, from where to where it reaches.
        velocity: north, east, m/s over ground.
    """

    name: str
    position: tuple[float, float]
    radius: float
    depth_min: float = 0.0
    depth_max: float = np.inf
    velocity: tuple[float, float] = (0.0, 0.0)

    @property
    def moves(self) -> bool:
        """Whether it moves over ground."""
        return self.velocity != (0.0, 0.0)

    def after(self, seconds: float) -> "KnownObstacle":
        """Return the same obstacle for an epoch that is later by `seconds`."""
        north, east = (p + v * seconds for p, v in zip(self.position, self.velocity, strict=True))
        return replace(self, position=(north, east))

    def closest(self, place: NDArray[np.floating], begin: float, end: float) -> tuple[float, float]:
        """Return s within two times at which the surface comes closest to a place [3] m, and m how close."""
        moves = np.asarray(self.velocity)
        ahead = float((place[:2] - np.asarray(self.position)) @ moves)
        swift = float(moves @ moves)
        when = float(np.clip(ahead / swift, begin, end)) if swift > 1e-20 else begin
        return when, float(self.distance(place[None], np.asarray([when]))[0])

    def distance(self, places: NDArray[np.floating], times: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the distance [n] m of places [n, 3] m at times [n] s to the surface, negative inside."""
        centre = np.asarray(self.position) + times[:, None] * np.asarray(self.velocity)
        level = np.linalg.norm(places[:, :2] - centre, axis=1) - self.radius
        above = np.maximum(self.depth_min - places[:, 2], places[:, 2] - self.depth_max)
        beside = np.hypot(np.maximum(level, 0.0), np.maximum(above, 0.0))
        return np.where((level < 0.0) & (above < 0.0), np.maximum(level, above), beside)


def keeps_off(place: NDArray[np.floating], obstacles: Sequence[KnownObstacle], margin: float) -> str:
    """Return which obstacle that stands is nearer to a place [3] m than a margin, m; or an empty string."""
    for one in obstacles:
        apart = float(one.distance(place[None], np.zeros(1))[0])
        if not one.moves and apart < margin:
            known = f"the known obstacle {one.name!r}"
            if apart < 0.0:
                return f"lies within {known}"
            return f"lies {apart:.1f} m from {known}, and safety.obstacles asks for {margin:g} m"
    return ""


class Spheres(NamedTuple):
    """M spheres that cover cylinders: centres [M, 3] m, radii [M] m, velocities [M, 3] m/s over ground."""

    position: NDArray[np.float64]
    radius: NDArray[np.float64]
    velocity: NDArray[np.float64]

    def padded(self, count: int) -> "Spheres":
        """Return at least `count` spheres: those, and others far away."""
        more = max(count - len(self.radius), 0)
        away, still = np.full((more, 3), _FAR_AWAY), np.zeros((more, 3))
        parts = zip(self, (away, np.ones(more), still), strict=True)
        return Spheres(*(np.concatenate(part) for part in parts))


def spheres(obstacles: Sequence[KnownObstacle], depths: tuple[float, float], now: float) -> Spheres:
    """Spheres that cover all of the cylinders that a vehicle can come near.

    They reach farther than the cylinders by at most 12 % of the radius, or 1 m where that is more.

    Args:
        obstacles: to be covered.
        depths: m, least and greatest depth that the vehicle goes to.
        now: s since the epoch.
    """
    position, radius, velocity = [], [], []
    for obstacle in obstacles:
        top = max(obstacle.depth_min, depths[0] - _BEYOND)
        bottom = min(obstacle.depth_max, depths[1] + _BEYOND)
        if bottom < top:
            continue
        widest = obstacle.radius + max(EXCESS[0] * obstacle.radius, EXCESS[1])
        apart = 2.0 * np.sqrt(widest**2 - obstacle.radius**2)
        count = max(1, int(np.ceil((bottom - top) / apart)))
        part = (bottom - top) / count
        position += [(*obstacle.after(now).position, top + (k + 0.5) * part) for k in range(count)]
        radius += [np.hypot(obstacle.radius, 0.5 * part)] * count
        velocity += [(*obstacle.velocity, 0.0)] * count
    return Spheres(np.reshape(position, (-1, 3)), np.array(radius, float), np.reshape(velocity, (-1, 3)))
