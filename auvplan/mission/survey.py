"""Survey lines as they are followed: what of a line counts as covered, and how far off it the vehicle was."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvplan.runtime.formatting import apart
from auvplan.vehicle import Vehicle

Array = NDArray[np.floating]

#: Places between the ends of a stretch at which the distance from the line is looked up for its mean.
_LOOKS = 9


class Coverage(NamedTuple):
    """What a track covers of a line.

    Attributes:
        length: m of the line.
        mean, worst: m, distance of the track from the line along what counts; 0 where nothing does.
    """

    length: float
    mean: float
    worst: float


#: rad by which rounding may make a slope seem steeper.
_LEVEL = 1e-5


def slope_limit(vehicle: Vehicle, down: bool) -> tuple[float, str]:
    """Return the steepest slope of dives, or of climbs, in still water, rad, and the field that limits it."""
    rate, found = "dive_rate_max" if down else "climb_rate_max", [(0.5 * math.pi, "")]
    if vehicle.pitch_max is not None:
        found.append((float(np.asarray(vehicle.pitch_max)), "pitch_max"))
    if (most := getattr(vehicle, rate)) is not None:
        found.append((math.asin(min(float(np.asarray(most / vehicle.speed)), 1.0)), rate))
    return min(found)


#: m of a part by which rounding of places may make it seem shorter.
_ROUNDING = 0.1


@dataclass(frozen=True)
class LinePart:
    """A straight part of a survey line, from vertex to vertex, in either direction.

    It is covered where the track passes within the tolerance of it, horizontally and in depth together.

    Attributes:
        start, end: north, east, down, m.
        tolerance: m.
    """

    start: tuple[float, ...]
    end: tuple[float, ...]
    tolerance: float

    @property
    def length(self) -> float:
        """M from vertex to vertex."""
        return float(np.linalg.norm(np.subtract(self.end, self.start)))

    def too_steep(self, vehicle: Vehicle) -> str:
        """Return how steep it is, and the limit, where that is too much both ways in still water; or ""."""
        slope = math.asin(min(abs(self.end[2] - self.start[2]) / self.length, 1.0))
        angle, field = max(slope_limit(vehicle, down) for down in (False, True))
        if slope <= angle + _LEVEL:
            return ""
        own, most = apart(math.degrees(slope), math.degrees(angle), digits=0)
        return f"{own} degrees where vehicle.{field} allows {most}"

    def share(self, coverage: Coverage) -> float:
        """Return the share of the part that is covered."""
        left = self.length - coverage.length
        return 1.0 if left <= _ROUNDING else coverage.length / self.length

    def figures(self, coverage: Coverage | None) -> dict[str, float]:
        """Return the part and what is covered of it, m, by the names that files have."""
        covered, mean, worst = coverage or Coverage(0.0, 0.0, 0.0)
        own = {"length": self.length, "tolerance": self.tolerance}
        return own | {"covered": covered, "across_mean": mean, "across_worst": worst}

    def across(self, places: ArrayLike) -> tuple[Array, Array]:
        """Distances along the part [N] m and vectors from it [N, 3] m, of places [N, 3] m."""
        away = np.asarray(places, float) - np.asarray(self.start, float)
        unit = np.subtract(self.end, self.start) / self.length
        along = away @ unit
        return along, away - along[..., None] * unit

    def counted(self, first: ArrayLike, last: ArrayLike) -> Array:
        """Return where straight steps are within the tolerance, as shares of each, [N, 2]; empty ones equal.

        Args:
            first, last: [N, 3] m, ends of the steps.
        """
        (here, off), (there, end) = self.across(first), self.across(last)
        turn = end - off
        a, b = (turn**2).sum(axis=1), (off * turn).sum(axis=1)
        # What is off by just the tolerance counts, whichever way the squares are rounded.
        c = (off**2).sum(axis=1) - self.tolerance**2 * (1.0 + np.finfo(float).eps)
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        even = a < 1e-12  # as far off at both ends
        shares = np.stack([-b - root, -b + root], axis=1) / np.where(even, 1.0, a)[:, None]
        shares = np.where(even[:, None], np.where(c <= 0.0, 1.0, 0.0)[:, None] * [0.0, 1.0], shares)
        shares[b * b < a * c] = 0.0
        # Beyond the ends of the part nothing counts.
        gain = there - here
        level = np.abs(gain) < 1e-9
        ends = (np.array([0.0, self.length]) - here[:, None]) / np.where(level, 1.0, gain)[:, None]
        low = np.maximum(shares[:, 0], np.where(level, 0.0, ends.min(axis=1)))
        high = np.minimum(shares[:, 1], np.where(level, 0.0, ends.max(axis=1)))
        low = np.clip(low, 0.0, 1.0)
        return np.stack([low, np.maximum(np.clip(high, 0.0, 1.0), low)], axis=1)

    def covered(self, positions: ArrayLike) -> Coverage:
        """Return what a track through positions [n, 3] m covers; what is passed twice counts once."""
        places = np.asarray(positions, float).reshape(-1, 3)
        if len(places) < 2:
            return Coverage(0.0, 0.0, 0.0)
        first, step = places[:-1], np.diff(places, axis=0)
        shares = self.counted(first, places[1:])
        passed = shares[:, 1] > shares[:, 0]
        if not passed.any():
            return Coverage(0.0, 0.0, 0.0)
        looks = np.linspace(shares[passed, 0], shares[passed, 1], _LOOKS, axis=1)
        along, off = self.across(first[passed, None] + looks[..., None] * step[passed, None])
        begins, ends = np.sort(along[:, [0, -1]], axis=1).T
        order = np.argsort(begins, kind="stable")
        begins, ends = begins[order], np.maximum.accumulate(ends[order])
        fresh = ends - np.maximum(begins, np.concatenate([[-np.inf], ends[:-1]]))
        away, lengths = np.linalg.norm(off, axis=-1), np.abs(along[:, -1] - along[:, 0])
        weights = lengths / max(lengths.sum(), 1e-9)
        mean = np.trapezoid(away, dx=1.0 / (_LOOKS - 1), axis=1) @ weights
        return Coverage(float(np.maximum(fresh, 0.0).sum()), float(mean), float(away.max()))
