"""Attitude and velocities of a vehicle, planned or simulated, on the host (Eqs 6-8, 10)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvplan.runtime.arrays import turned
from auvplan.vehicle import SpeedReading, along_track

Array = NDArray[np.floating]

_FIELDS = ("yaw", "pitch", "ground_velocity")


@dataclass(frozen=True, eq=False)
class Motion:
    """How a vehicle moves at n moments; arrays may have more axes before.

    Attributes:
        yaw: [n] rad, psi of the hull, from north towards east.
        pitch: [n] rad, theta of the hull, nose up positive.
        ground_velocity: [n, 3] m/s over ground, north, east, down.
    """

    yaw: Array
    pitch: Array
    ground_velocity: Array

    def __len__(self) -> int:
        return len(self.yaw)

    @classmethod
    def none(cls, count: int = 0) -> "Motion":
        """Return `count` moments of which nothing is known, NaN throughout."""
        return cls(np.full(count, np.nan), np.full(count, np.nan), np.full((count, 3), np.nan))

    @classmethod
    def along(cls, reading: SpeedReading, speed: float, way: ArrayLike, water: ArrayLike) -> "Motion":
        """Move along the segments of a track, as travel times reckon with it.

        "track": the vehicle makes its way along the segment at `along_track`'s speed and crabs: its hull
        points where it moves through the water, and Eq. 10 of the segment is its course. "eq8" and "eq11":
        the hull points along the segment (Eq. 10), and the ground velocity is the sum of Eq. 8, in "eq11"
        without a current. In "eq8" it therefore drifts off the segment by the current across it, which travel
        times of that reading leave out.

        Args:
            reading: which of the three.
            speed: |v|, m/s through the water.
            way: [n, 3] m, from the first to the last ends of the segments.
            water: [n, 3] m/s, the current on them.
        """
        way, water = np.asarray(way, float), np.asarray(water, float)
        if reading != "track":
            yaw, pitch = orientation(way)
            met = water if reading == "eq8" else np.zeros_like(water)
            return cls(yaw, pitch, ground_velocity(speed, yaw, pitch, met))
        tangent, progress = progress_along(reading, speed, way, water)
        return cls.through_water(progress[:, None] * tangent, water)

    @classmethod
    def through_water(cls, over_ground: ArrayLike, water: ArrayLike) -> "Motion":
        """Point the hull where the vehicle moves through the water.

        Args:
            over_ground: [n, 3] m/s, velocity over ground.
            water: [n, 3] m/s, the current.
        """
        over_ground = np.asarray(over_ground, float)
        return cls(*orientation(over_ground - np.asarray(water, float)), over_ground)

    @classmethod
    def of_body(cls, yaw: ArrayLike, pitch: ArrayLike, body_velocity: ArrayLike) -> "Motion":
        """Restore a motion from attitude [n] rad and body velocity [n, 3] m/s (Eq. 7)."""
        yaw, pitch, body = (np.asarray(part, float) for part in (yaw, pitch, body_velocity))
        return cls(yaw, pitch, np.einsum("...ij,...j->...i", rotation(yaw, pitch), body))

    @classmethod
    def joined(cls, parts: Iterable["Motion"]) -> "Motion":
        """Join motions one after the other."""
        parts = [cls.none(), *parts]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in _FIELDS))

    @classmethod
    def padded(cls, parts: Sequence["Motion"], count: int) -> "Motion":
        """Stack motions, [parts, count], filled up with NaN to a number of moments each."""
        filled = [cls.joined([part, cls.none(count - len(part))]) for part in parts]
        return cls(*(np.stack([getattr(part, name) for part in filled]) for name in _FIELDS))

    def __getitem__(self, chosen: Any) -> "Motion":
        """Return some of the moments."""
        return Motion(self.yaw[chosen], self.pitch[chosen], self.ground_velocity[chosen])

    def turned(self, angle: ArrayLike) -> "Motion":
        """Return it in a frame whose north lies `angle`, [n] rad, counter-clockwise from this one's north."""
        yaw, (north, east, down) = self.yaw + np.asarray(angle), np.moveaxis(self.ground_velocity, -1, 0)
        yaw = np.where(np.abs(yaw) > np.pi, yaw - np.copysign(2.0 * np.pi, yaw), yaw)
        velocity = np.stack([*turned(north, east, angle), down], axis=-1)
        return Motion(yaw, self.pitch, velocity)

    @property
    def course(self) -> Array:
        """Direction of the velocity over ground from north towards east, [n] rad."""
        return orientation(self.ground_velocity)[0]

    @property
    def body_velocity(self) -> Array:
        """Surge u, sway v and heave w, [n, 3] m/s: the velocity over ground in axes of the hull (Eq. 7)."""
        return np.einsum("...ji,...j->...i", rotation(self.yaw, self.pitch), self.ground_velocity)


def progress_along(
    reading: SpeedReading, speed: float, way: ArrayLike, water: ArrayLike
) -> tuple[Array, Array]:
    """Return the directions of segments and the speeds over ground along them that travel times use.

    Args:
        reading, speed: as for `Motion.along`.
        way: [..., n, 3] m, from the first to the last ends of the segments.
        water: [..., n, 3] m/s, the current on them.

    Returns:
        ``(tangent, progress)``: [..., n, 3], zero where a segment has no length, and [..., n] m/s.
    """
    way, water = np.asarray(way, float), np.asarray(water, float)
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    tangent = way / np.where(length > 0.0, length, 1.0)
    along = (water * tangent).sum(axis=-1)
    across = np.linalg.norm(water - along[..., None] * tangent, axis=-1)
    return tangent, np.asarray(along_track(reading, speed, along, across)[0])


def orientation(displacement: ArrayLike) -> tuple[Array, Array]:
    """Compute yaw psi and pitch theta, [...] rad, of displacements north, east, down [..., 3] (Eq. 10).

    Nose up is positive.

    Differences from the paper:
        Yaw is the angle of the full circle, where Eq. 10's arctangent of a ratio knows half of it.
    """
    north, east, down = np.moveaxis(np.asarray(displacement, float), -1, 0)
    return np.arctan2(east, north), np.arctan2(-down, np.hypot(north, east))


def rotation(yaw: ArrayLike, pitch: ArrayLike) -> Array:
    """Compute the body-to-NED matrices of Eq. 7 at zero roll, [..., 3, 3], from angles [...] rad."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    rows = ((cy * cp, -sy, cy * sp), (sy * cp, cy, sy * sp), (-sp, np.zeros_like(sp), cp))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def ground_velocity(speed: ArrayLike, yaw: ArrayLike, pitch: ArrayLike, current: ArrayLike) -> Array:
    """Compute the velocity over ground of a vehicle that points along (yaw, pitch) (Eq. 8).

    Args:
        speed: |v|, m/s through the water.
        yaw, pitch: [...] rad.
        current: [..., 3] m/s, north, east, down.

    Returns:
        [..., 3] m/s, north, east, down.

    Differences from the paper:
        Eq. 8's third line adds |v| sin(theta) with theta positive nose up; depth is positive down, so the
        sign turns.
    """
    level = np.cos(pitch)
    heading = np.stack([level * np.cos(yaw), level * np.sin(yaw), -np.sin(pitch)], axis=-1)
    return np.asarray(speed)[..., None] * heading + np.asarray(current, float)
