"""The checker's own view of coast, sea bed and moving obstacles, by NumPy and shapely."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import scipy
import shapely
import xarray as xr
from numpy.typing import NDArray

Array = NDArray[np.floating]
Mask = NDArray[np.bool_]

#: Longest step between places of a track, m; that of the obstacles as well.
STEP = 1.0
#: Steps between two observations are capped: a longer gap is a fault of its own, found by its speed.
_STEPS_MAX = 10_000
#: Positions are stored in single precision, which may put them beyond the chart's edge by so much, m.
_EDGE = 0.01


@dataclass(frozen=True)
class SampledTrack:
    """A leg in steps of at most a metre, straight and at even speed between observations."""

    times: Array  # [n] s
    positions: Array  # [n, 3] m
    obstacles: Array  # [n, M, 3] m
    metres: Array  # [n] m, the step that leads to each point; zero for the first

    @classmethod
    def of(cls, times: Array, positions: Array, obstacles: Array) -> Self:
        """Refine observations at times [n] s: positions [n, 3] m and obstacles [n, M, 3] m."""
        everything = np.concatenate([positions[:, None], obstacles], axis=1)
        moves = np.linalg.norm(np.diff(everything, axis=0), axis=-1).max(axis=1)
        steps = np.clip(np.ceil(moves / STEP), 1, _STEPS_MAX).astype(int)
        first = np.concatenate([[0], np.cumsum(steps)])
        # Where on the scale of observations each step ends: whole numbers are observations.
        scale = np.interp(np.arange(first[-1] + 1), first, np.arange(len(times)))
        below = np.minimum(scale.astype(int), max(len(times) - 2, 0))
        above, share = np.minimum(below + 1, len(times) - 1), scale - below
        places = _between(positions, below, above, share[:, None])
        metres = np.concatenate([[0.0], np.linalg.norm(np.diff(places, axis=0), axis=-1)])
        met = _between(obstacles, below, above, share[:, None, None])
        return cls(_between(times, below, above, share), places, met, metres)

    def between(self, first: int, last: int) -> str:
        """Return words for the stretch from point `first` to point `last`."""
        x, y, z = self.positions[first]
        metres = self.metres[first : last + 1].sum()
        place = f"north {x:.1f}, east {y:.1f}, depth {z:.1f} m"
        return f"for {metres:.1f} m from {place} at {self.times[first]:.1f} s"


@dataclass(frozen=True)
class _Raster:
    """Values at pixels, indexed [north, east]; pixel (i, j) begins at corner + (i, j) * size."""

    values: NDArray  # [nx, ny]
    corner: Array  # [2] m
    size: float  # m

    def outside(self, positions: Array) -> Mask:
        """Return whether positions [n, 3] lie beyond the raster, [n]."""
        place = positions[:, :2] - self.corner
        far = self.size * np.asarray(self.values.shape)
        return np.any((place < -_EDGE) | (place > far + _EDGE), axis=1)


@dataclass(frozen=True)
class Coast(_Raster):
    """Land pixels of a chart, which are True."""

    reach: float = np.inf  # m, greatest distance: farther away land is not looked for

    @classmethod
    def of(cls, dataset: xr.Dataset) -> Self:
        """Return where a saved run must not be: pixels whose passability is exactly zero."""
        land = dataset["passability"].values == 0.0
        return cls(land, dataset["chart_origin"].values.astype(float), float(dataset["chart_pixel_size"]))

    @classmethod
    def beyond(cls, dataset: xr.Dataset) -> Self:
        """Return the coast of a saved run alone, without closed areas, also beyond its area."""
        if "coast" not in dataset:
            return cls.of(dataset)
        corner, size = dataset["coast_origin"].values.astype(float), float(dataset["coast_pixel_size"])
        reach = float(dataset.attrs["coast_reach"])
        return cls(dataset["coast"].values == 0.0, corner, size, reach if reach > 0.0 else np.inf)

    @cached_property
    def _edge(self) -> shapely.STRtree:
        """Land pixels that touch other pixels, as squares (north, east) m."""
        framed = np.pad(self.values, 1)
        inland = framed[:-2, 1:-1] & framed[2:, 1:-1] & framed[1:-1, :-2] & framed[1:-1, 2:]
        low = self.corner + self.size * np.argwhere(self.values & ~inland)
        return shapely.STRtree(shapely.box(*low.T, *(low + self.size).T))

    def on_land(self, positions: Array) -> Mask:
        """Return whether the pixels under positions [n, 3] are land, [n]."""
        pixel = np.floor((positions[:, :2] - self.corner) / self.size).astype(int)
        i, j = np.clip(pixel, 0, np.asarray(self.values.shape) - 1).T
        return self.values[i, j] & ~self.outside(positions)

    def distances(self, positions: Array) -> Array:
        """Return the least distance [n] m to land on the straight line from each of n positions to the next.

        The last is at its place. 0 on land, `reach` at most.
        """
        if not self.values.any():
            return np.full(len(positions), self.reach)
        ends = np.concatenate([positions[1:, :2], positions[-1:, :2]])
        lines = shapely.linestrings(np.stack([positions[:, :2], ends], axis=1))
        found = self._edge.query_nearest(lines, return_distance=True, all_matches=False)[1]
        found = np.where(self.on_land(positions), 0.0, found)
        return np.minimum(found, self.reach)


@dataclass(frozen=True)
class Bed(_Raster):
    """Depth of the sea bed at pixels' centres, m."""

    clearance: float  # m, least altitude that was asked for

    @classmethod
    def of(cls, dataset: xr.Dataset) -> Self:
        """Return the sea bed of a saved run."""
        depth = dataset["seabed_depth"].values.astype(float)
        corner, size = dataset["seabed_origin"].values.astype(float), float(dataset["seabed_pixel_size"])
        clearance = float(dataset.attrs["seabed_clearance"])
        dry = np.where(np.isfinite(depth), depth, 0.0)  # as shallow as can be where it is not known
        return cls(dry, corner, size, clearance)

    def altitude(self, positions: Array) -> Array:
        """Altitude of positions [n, 3] above the bed, [n] m, negative below it; bilinear between centres."""
        place = (positions[:, :2] - self.corner) / self.size - 0.5
        return scipy.ndimage.map_coordinates(self.values, place.T, order=1, mode="nearest") - positions[:, 2]


def events(inside: Mask) -> Iterator[tuple[int, int]]:
    """First and last index of every unbroken run of True in [n]."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return zip(change[::2].tolist(), (change[1::2] - 1).tolist(), strict=True)


def _between(values: Array, below: NDArray[np.int_], above: NDArray[np.int_], share: Array) -> Array:
    return values[below] * (1.0 - share) + values[above] * share
