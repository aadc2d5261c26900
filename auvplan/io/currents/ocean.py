"""Ocean current files as opened, with an exact sampler on the host, and what they hold in a few lines."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvplan.io.currents.geometry import DEGREE, Curvilinear, Geometry, Regular, Window
from auvplan.io.currents.levels import at_depth
from auvplan.io.currents.models import unified
from auvplan.io.currents.names import Names, find_current, find_places, require_field
from auvplan.io.currents.opening import File, Paths, open_files
from auvplan.io.currents.projection import find_crs, in_degrees
from auvplan.io.currents.series import Array, Series, in_order
from auvplan.io.currents.times import moment_of, seconds_of, stamp
from auvplan.io.currents.triangles import Triangles, find_triangles
from auvplan.io.currents.velocity import Velocity, find_velocity
from auvplan.io.currents.weights import ENOUGH, Index, Weights, mix_gathered
from auvplan.ocean.gridded import CurrentError

#: More values at once are refused before they are read.
MAX_VALUES = 300_000_000
#: So many places are looked at at a time.
_PLACES = 300_000
#: Moments beyond the data's by less, in s, are taken to be at its ends.
_SLACK = 0.5
#: What a summary says of each kind.
_KINDS = {
    "regular": "regular grid of longitude and latitude",
    "curvilinear": "curvilinear grid",
    "roms": "curvilinear grid with components on the edges of its cells",
    "triangles": "mesh",
}

Triple = tuple[Array, Array, Array | None]


@dataclass(frozen=True)
class OceanData:
    """Currents of the sea as a model has them; nothing but the axes is read until it is asked for.

    Make one with `open_ocean`; it is also a context manager that closes the files.

    Attributes:
        kind: "regular", "curvilinear", "roms" (velocities on the edges of the cells) or "triangles".
        longitude, latitude: degrees; [nx] and [ny] where regular, [ny, nx] where curvilinear, else [P].
        times: [T] s since 1970-01-01 UTC.
        levels: [K] m below the surface, or None where they follow the sea bed.
        notes: what had to be assumed.
        velocity: how the current is read.
    """

    kind: str
    longitude: Array
    latitude: Array
    times: Array
    levels: Array | None
    notes: tuple[str, ...]
    velocity: Velocity

    @property
    def geometry(self) -> Geometry:
        """The places of the points."""
        return self.velocity.points.geometry

    @property
    def series(self) -> Series:
        """The files."""
        return self.velocity.points.series

    @property
    def level_count(self) -> int:
        """Number of levels, 1 where there is no such dimension."""
        part = self.velocity.east
        return int(self.series.variables[part.name].sizes[part.levels.dim]) if part.levels.dim else 1

    @property
    def moments(self) -> tuple[datetime, ...]:
        """The times in UTC."""
        return tuple(moment_of(second) for second in self.times)

    def at(self, longitude: ArrayLike, latitude: ArrayLike, depth: ArrayLike, moment: Any) -> Triple:
        """Return the current at places and moments: linear in the horizontal, in depth and in time.

        At the source's own points, levels and times it is the source's value. It is NaN where there is no
        water: on land and below the sea bed. Arguments broadcast.

        Args:
            longitude, latitude: degrees.
            depth: m below the surface.
            moment: a datetime (without a time zone: UTC), datetime64, or s since 1970-01-01 UTC.

        Returns:
            Eastward, northward and upward m/s; upward is None where the source has none.

        Raises:
            CurrentError: a place or a moment lies outside the data, or values cannot be read.
        """
        given = [np.asarray(axis, float) for axis in (longitude, latitude, depth)] + [seconds_of(moment)]
        shape = np.broadcast_shapes(*(axis.shape for axis in given))
        places = [np.broadcast_to(axis, shape).reshape(-1) for axis in given]
        east, north, down, seconds = places
        if not all(np.isfinite(axis).all() for axis in places) or (down < 0).any():
            raise self.series.fail("places need finite numbers and depths that are not negative")
        if not len(east):
            empty = np.zeros(shape)
            return empty, empty, None if self.velocity.up is None else empty
        weights = self.geometry.locate(east, latitude=north)
        if weights.outside.any():
            raise self.series.fail(f"a place is outside the data, {describe(weights.beyond)}")
        before, share = self._frames(seconds)
        found = self._sampled(weights, down, before, share)
        answer = [values.reshape(shape) for values in found]
        return answer[0], answer[1], answer[2] if self.velocity.up is not None else None

    def is_water(
        self, longitude: Array, latitude: Array, frames: slice, reach: float = 0.0
    ) -> NDArray[np.bool_]:
        """Return whether there is water at the surface at all of some times.

        Args:
            longitude, latitude: [M] degrees.
            frames: the times.
            reach: m, how far beyond a grid's outer points they still tell of water; a mesh ends at its cells.

        Returns:
            [M]; as the current itself, water is where at least half of the weight lies on points with water.

        Raises:
            CurrentError: values cannot be read.
        """
        wet = np.full(self.geometry.count, -1, np.int8)
        found = np.zeros(len(longitude), bool)
        for first in range(0, len(longitude), _PLACES):
            part = slice(first, first + _PLACES)
            weights = self.geometry.locate(longitude[part], latitude[part])
            there = (weights.weight.sum(axis=1) > 0.0) & (np.hypot(*weights.beyond.T) <= reach)
            if not there.any():
                continue
            used = np.unique(weights.index[there])
            new = used[wet[used] < 0]
            if len(new):
                wet[new] = self._wet(new, frames)
            left = (weights.weight * (wet[weights.index] > 0)).sum(axis=1)
            found[part] = there & (left >= ENOUGH)
        return found

    def _wet(self, index: Index, frames: slice) -> NDArray[np.bool_]:
        """[P] whether source points have water at the surface at all of some times."""
        window = self.geometry.window(index[:, None])
        wet = np.ones(window.points, bool)
        for frame in range(frames.start, frames.stop):
            wet &= np.isfinite(self.velocity.read(slice(frame, frame + 1), window).east[0, 0])
        return wet[window.index[:, 0]]

    def sea_floor(self, longitude: Array, latitude: Array) -> Array | None:
        """Return the depth of the sea bed below the datum [M], m; None where the source does not tell it.

        It is NaN on land and beyond the data.
        """
        weights = self.geometry.locate(longitude, latitude)
        window = self.geometry.window(weights.index)
        floor = self.velocity.points.floor(window)
        if floor is None:
            return None
        (depth,) = mix_gathered(weights.weight, floor[window.index])
        return np.where(weights.outside, np.nan, depth)

    def frames(self, first: float, last: float) -> slice:
        """Return the times that span two moments, s since 1970; the nearest where they lie outside."""
        start = int(np.searchsorted(self.times, first + _SLACK, side="right")) - 1
        stop = int(np.searchsorted(self.times, last - _SLACK, side="left")) + 1
        start = min(max(start, 0), len(self.times) - 1)
        return slice(start, max(min(stop, len(self.times)), start + 1))

    def check_times(self, first: float, last: float) -> None:
        """Refuse moments, s since 1970, that the data does not cover.

        Raises:
            CurrentError: it names both spans.
        """
        if first < self.times[0] - _SLACK or last > self.times[-1] + _SLACK:
            wanted = stamp(first) if first == last else f"{stamp(first)} to {stamp(last)}"
            has = f"{stamp(self.times[0])} to {stamp(self.times[-1])}"
            if len(self.times) == 1:
                has = f"{stamp(self.times[0])} only"
            raise self.series.fail(f"the mission needs {wanted}, the file covers {has}")

    def close(self) -> None:
        """Let go of the files."""
        self.series.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _frames(self, seconds: Array) -> tuple[np.ndarray, Array]:
        """Return the time before each moment, and the share of the way to the next."""
        self.check_times(float(seconds.min()), float(seconds.max()))
        if len(self.times) == 1:
            return np.zeros(len(seconds), np.int64), np.zeros(len(seconds))
        held = np.clip(seconds, self.times[0], self.times[-1])
        before = np.clip(np.searchsorted(self.times, held, side="right") - 1, 0, len(self.times) - 2)
        share = (held - self.times[before]) / (self.times[before + 1] - self.times[before])
        return before, share

    def _sampled(self, weights: Weights, depth: Array, before: np.ndarray, share: Array) -> Array:
        """[3, M] m/s east, north and up, NaN where there is no water."""
        window = self.geometry.window(weights.index)
        ends = np.full((2, 3, len(depth)), np.nan)
        for frame in np.unique(np.concatenate([before, before[share > 0] + 1])):
            block = None
            for end in range(2):
                wanted = np.flatnonzero((before + end == frame) & ((share > 0) if end else (share < 1)))
                if len(wanted):
                    block = block or self.velocity.read(slice(int(frame), int(frame) + 1), window)
                    ends[end][:, wanted] = _gathered(block, window, weights, depth, wanted)
        values = (1.0 - share) * ends[0] + share * ends[1]
        return np.where(share <= 0, ends[0], np.where(share >= 1, ends[1], values))


def _gathered(block: Any, window: Window, weights: Weights, depth: Array, wanted: np.ndarray) -> Array:
    """[3, m] m/s of some places in a block of one time."""
    index, weight = window.index[wanted], weights.weight[wanted]
    corners, deep = index.ravel(), np.repeat(depth[wanted], index.shape[1])

    def of(field: Array) -> Array:
        return field[0][..., corners] if field.shape[-1] > 1 or window.points == 1 else field[0]

    floor = None if block.floor is None else of(block.floor)
    level = at_depth((of(block.east), of(block.north)), of(block.depths), deep, floor)
    east, north = mix_gathered(weight, *(values.reshape(index.shape) for values in level))
    up = np.full(len(wanted), np.nan)
    if block.up is not None:
        rising = at_depth((of(block.up),), of(block.depths_up), deep, floor)
        (up,) = mix_gathered(weight, rising[0].reshape(index.shape))
    return np.stack([east, north, np.where(np.isnan(east), np.nan, up)])


def describe(beyond: Array) -> str:
    """Return how far places [M, 2] lie beyond, m north and east, in words."""
    reach = {
        "north": beyond[:, 0].max(), "south": -beyond[:, 0].min(),
        "east": beyond[:, 1].max(), "west": -beyond[:, 1].min(),
    }  # fmt: skip
    least = 0.02 * max(reach.values())
    words = [f"{far:.0f} m ({far / DEGREE:.2g} degrees) {side}" for side, far in reach.items() if far > least]
    return "by up to " + ", ".join(words)


def misunderstood(label: str, error: Exception) -> CurrentError:
    """Return what no check has foreseen, as one line that names the file."""
    line = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return CurrentError(f"{label}: cannot be understood ({line})")


def open_ocean(paths: Paths, *, crs: Any = None, epoch: Any = None) -> OceanData:
    """Open files of ocean currents: NetCDF-3, NetCDF-4, or Zarr folders.

    They may follow CF, or be native ROMS, FVCOM, SCHISM or SELFE output, or UGRID; see `read_current`.

    Args:
        paths: one path, a glob pattern, a dataset, or a list of such; files may be split over time, and hold
            the components, the grid and the levels apart.
        crs: projection of coordinates in metres, as pyproj takes it, where the files do not name it.
        epoch: the moment that the files' times count from, where they do not tell it; a datetime in UTC.

    Raises:
        CurrentError: one line that names the file, the variable and what is wrong.
    """
    files = open_files(paths, crs, None if epoch is None else float(seconds_of(epoch)))
    try:
        return ocean_of(files)
    except CurrentError:
        for file in files:
            file.close()
        raise


def ocean_of(files: Sequence[File]) -> OceanData:
    """Return the current of files that are open.

    Raises:
        CurrentError: as `open_ocean`.
    """
    try:
        return _standardised(unified(files))
    except CurrentError:
        raise
    except Exception as error:
        raise misunderstood(files[0].path, error) from None


def _standardised(files: Sequence[File]) -> OceanData:
    names = find_current(files[0])
    places = _places(files[0], names)
    series = in_order(files, names.east, places or ())
    notes = [*series.notes, *filter(None, [names.note])]
    geometry = _geometry(series, names, places, notes)
    if isinstance(geometry, Curvilinear) and geometry.folds:
        grid = " and ".join(places or ())
        raise series.fail(f"the grid of {grid} folds over itself: they contradict each other")
    if isinstance(geometry, Triangles) and geometry.overlaps:
        raise series.fail("the cells of the mesh lie over each other: places and connectivity contradict")
    if torn := _torn(geometry):
        notes.append(
            f"{torn} sides or triangles of the grid are far longer than usual: there are no cells there"
        )
    velocity = find_velocity(series, names, geometry, notes)
    return OceanData(
        geometry.kind, geometry.longitude, geometry.latitude, series.times, velocity.east.levels.fixed,
        tuple(dict.fromkeys(notes)), velocity,
    )  # fmt: skip


def _places(file: File, names: Names) -> tuple[str, str] | None:
    """Longitude and latitude of the points; None where cells have none of their own."""
    dims = [file.variables[name].dims[-2:] for name in (names.east, names.north)]
    staggered = dims[0] != dims[1] and "lon_rho" in file.variables
    try:
        found = find_places(file, names.east, staggered)
    except CurrentError:
        if staggered or find_triangles(file, names.east, None, []) is None:
            require_field(file)
            raise
        return None
    if not staggered:
        _require_same_places(file, names, found)
    return found


def _require_same_places(file: File, names: Names, found: tuple[str, str]) -> None:
    """Refuse components on the same dimensions that lie at other places, by their `coordinates`."""
    try:
        others = find_places(file, names.north)
    except CurrentError:
        return
    for name, other in zip(found, others, strict=True):
        if name == other:
            continue
        one, two = (file.coordinate(place, missing=True) for place in (name, other))
        if one.shape != two.shape or not np.allclose(one, two, rtol=0.0, atol=1e-6, equal_nan=True):
            raise CurrentError(
                f"{file.path}: {names.east} lies at {name} and {names.north} at {other}, which differ: "
                "interpolate both to the middles of the cells first"
            )


def _torn(geometry: Geometry) -> int:
    """Return how many sides of cells are too long to be any."""
    if isinstance(geometry, Curvilinear):
        return sum(int((step > geometry.longest).sum()) for step in geometry.steps)
    cells = geometry.cells if isinstance(geometry, Triangles) else None
    return 0 if cells is None else int((~cells.whole).sum())


def _geometry(series: Series, names: Names, places: tuple[str, str] | None, notes: list[str]) -> Geometry:
    file = series.files[0]
    if places is None:
        found = find_triangles(file, names.east, None, notes)
        assert found is not None
        return found
    longitude, latitude, crs = in_degrees(file, places)
    dims = [tuple(str(dim) for dim in file.variables[name].dims) for name in places]
    if crs is not None and dims[0] != dims[1]:
        return Curvilinear((*dims[1], *dims[0]), longitude, latitude, crs=crs)
    if longitude.ndim == 2:
        if dims[0] != dims[1] or min(longitude.shape) < 2:
            raise series.fail(f"{places[0]} and {places[1]} are no grid of rows and columns")
        staggered = places[0] == "lon_rho" and dims[0][-1] not in file.variables[names.north].dims[-1:]
        east_dims, north_dims = (file.variables[name].dims[-2:] for name in (names.east, names.north))
        kind = "roms" if staggered or east_dims != north_dims else "curvilinear"
        own = crs or find_crs(file, (names.east, *places))
        return Curvilinear(dims[0], longitude, latitude, kind, own)
    if dims[0] == dims[1] and longitude.ndim == 1:
        found = find_triangles(file, names.east, places, notes)
        assert found is not None
        return found
    if longitude.ndim > 1 or latitude.ndim > 1:
        raise series.fail(f"{places[0]} and {places[1]} have other dimensions than each other")
    for name, axis in zip(places, (np.unwrap(np.atleast_1d(longitude), period=360.0), latitude), strict=True):
        steps = np.diff(np.atleast_1d(axis))
        if len(steps) and not ((steps > 0).all() or (steps < 0).all()):
            raise series.fail(f"{name} neither rises nor falls throughout")
    return Regular((dims[1][0], dims[0][0]), longitude, latitude)


def summary_of(ocean: OceanData) -> dict[str, Any]:
    """Return kind, extent, times and levels of a current, ready for JSON."""
    points = ocean.velocity.points
    shape = ocean.longitude.shape if ocean.kind != "regular" else (len(ocean.latitude), len(ocean.longitude))
    found: dict[str, Any] = {
        "files": ocean.series.label,
        "kind": _KINDS[ocean.kind],
        "points": " x ".join(map(str, shape)),
        "longitude": _span(ocean.longitude),
        "latitude": _span(ocean.latitude),
        "times": len(ocean.times),
        "from": stamp(ocean.times[0]),
        "to": stamp(ocean.times[-1]),
    }
    if len(ocean.times) > 1:
        found["step_h"] = round(float(np.median(np.diff(ocean.times))) / 3600.0, 4)
    if ocean.levels is None:
        found["levels"] = "follow the sea bed"
    elif len(ocean.levels) == 1:
        found["levels"] = f"one, {ocean.levels[0]:g} m"
    else:
        found["levels"] = f"{len(ocean.levels)}, {ocean.levels[0]:g} to {ocean.levels[-1]:g} m"
    names = {
        "components": f"{ocean.velocity.east.name}, {ocean.velocity.north.name}",
        "vertical": None if ocean.velocity.up is None else ocean.velocity.up.name,
        "sea_floor": points.floor_name(),
        "surface_height": points.rise_name(),
    }
    return found | {name: value or "not given" for name, value in names.items()}


def _span(values: Any) -> str:
    return f"{np.nanmin(values):.4f} to {np.nanmax(values):.4f}"
