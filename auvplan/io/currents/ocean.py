"""Ocean current files as opened, with an exact sampler on the host, and what they hold in a few lines."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from typing import Any, Self

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from auvplan.errors import reason_of
from auvplan.io.currents.files import Array, File, Paths, open_files, text
from auvplan.io.currents.geometry import DEGREE, ENOUGH, Window, along, bounds, mix, offset
from auvplan.io.currents.model import Model, Part, find_model
from auvplan.io.currents.times import moment_of, seconds_of, stamp
from auvplan.io.currents.triangles import Geometry
from auvplan.ocean.gridded import CurrentError
from auvplan.scenario.provenance import ORIGIN

#: More values at once are refused before they are read.
MAX_VALUES = 300_000_000
#: Places that are looked up at a time.
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
#: What is said of the form's variables.
_ABOUT = {
    "longitude": {"standard_name": "longitude", "units": "degrees_east"},
    "latitude": {"standard_name": "latitude", "units": "degrees_north"},
    "time": {"standard_name": "time", "units": "seconds since 1970-01-01 00:00:00"},
    "depth": {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"},
    "zcor": {"units": "m", "positive": "up"},
    "uo": {"standard_name": "eastward_sea_water_velocity", "units": "m s-1"},
    "vo": {"standard_name": "northward_sea_water_velocity", "units": "m s-1"},
    "wo": {"standard_name": "upward_sea_water_velocity", "units": "m s-1"},
    "zos": {"standard_name": "sea_surface_height_above_geoid", "units": "m"},
    "deptho": {"standard_name": "sea_floor_depth_below_geoid", "units": "m"},
    "face_nodes": {
        "cf_role": "face_node_connectivity", "start_index": np.int32(0), "_FillValue": np.int32(-1),
    },
    "mesh": {
        "cf_role": "mesh_topology", "topology_dimension": np.int32(2),
        "node_coordinates": "node_lon node_lat", "face_node_connectivity": "face_nodes",
    },
}  # fmt: skip


@dataclass(frozen=True)
class OceanData(AbstractContextManager):
    """Currents of the sea as a model has them; nothing but the axes is read until it is asked for.

    Make one with `open_ocean`; it is also a context manager that closes the files.

    Attributes:
        model: which variables of the files are the current.
        geometry: the places of its points.
        kind: "regular", "curvilinear", "roms" (velocities on the edges of the cells) or "triangles".
        longitude, latitude: degrees; [nx] and [ny] where regular, [ny, nx] where curvilinear, else [P].
        times: [T] s since 1970-01-01 UTC.
        levels: [K] m below the surface, or None where they follow the sea bed.
        notes: what had to be assumed.
        label: the files' name for messages.
    """

    model: Model
    geometry: Geometry
    kind: str
    longitude: Array
    latitude: Array
    times: Array
    levels: Array | None
    notes: tuple[str, ...]
    label: str

    @classmethod
    def of(cls, files: Sequence[File]) -> Self:
        """Return the current of files that are open; raises as `open_ocean`."""
        with understood(files[0].path):
            model = find_model(files)
        series, grid = model.source.series, model.source.geometry
        notes, places = tuple(dict.fromkeys(model.source.notes)), (grid.kind, grid.longitude, grid.latitude)
        return cls(model, grid, *places, series.times, model.east.levels.fixed, notes, series.path)

    @property
    def moments(self) -> tuple[datetime, ...]:
        """The times in UTC."""
        return tuple(moment_of(second) for second in self.times)

    @property
    def names(self) -> dict[str, str]:
        """The files' own names of what they have of the form's `uo`, `vo`, `wo`, `deptho` and `zos`."""
        model, source = self.model, self.model.source
        own = {"uo": model.east.name, "vo": model.north.name, "wo": model.up and model.up.name}
        own |= {"deptho": source.floor_name, "zos": source.rise_name}
        return {name: stated for name, stated in own.items() if stated is not None}

    def fail(self, reason: str) -> CurrentError:
        """Return an error that names the files."""
        return CurrentError(f"{self.label}: {reason}")

    def part(self, frames: slice, window: Window) -> Part:
        """Return some times and a window's points; what is read of them may raise a `CurrentError`."""
        return Part(self.model, frames, window)

    @cached_property
    def form(self) -> xr.Dataset:
        """The current as CF-1.11, with a mesh as UGRID-1.0, of which nothing is read but what is indexed.

        It has `uo`, `vo` and, on the same levels, `wo` [time, level, points] m/s, NaN where there is no
        water; `deptho` [points] m, the sea bed below the datum, and `zos` [time, points] m, the surface above
        it, where they are given. Levels are `depth` [level] m or, where they follow the bed, `zcor` [time,
        level, points] m above the datum. Points are in rows and columns, or a mesh's nodes or faces.
        """
        grid, model = self.geometry, self.model
        places, sizes = grid.coordinates, dict(zip(grid.dims, grid.shape, strict=True))
        sizes |= {"time": len(self.times), "level": model.east.levels.count}
        located: dict[str, Any] = {}
        found: dict[str, Any] = {"time": ("time", self.times, _ABOUT["time"])}
        if self.levels is not None:
            found["depth"] = "level", self.levels, _ABOUT["depth"]
        if "face_nodes" in places:
            located = {"mesh": "mesh", "location": grid.dims[0]}
            found["mesh"] = (), np.int32(0), _ABOUT["mesh"]
        for name, (dims, values) in places.items():
            kind = name if name in _ABOUT else "latitude" if "lat" in name else "longitude"
            found[name] = dims, values, _ABOUT[kind]
        given = set(self.names) | ({"zcor"} if self.levels is None else set())
        if model.up is not None and model.up.levels.count != model.east.levels.count:
            given.remove("wo")
        current, last = {}, {}
        for name, count in (("uo", 2), ("vo", 2), ("wo", 2), ("zos", 1), ("deptho", 0), ("zcor", 2)):
            if name in given:
                dims = (*("time", "level")[:count], *grid.dims)
                lazy = _Lazy(self, name, dims, tuple(sizes[dim] for dim in dims), last)
                about = _ABOUT[name] | (located if name != "zcor" else {})
                current[name] = xr.Variable(dims, indexing.LazilyIndexedArray(lazy), about)
        attributes = {
            "Conventions": "CF-1.11 UGRID-1.0",
            "source": self.label,
            "comment": "; ".join(self.notes),
        }
        stated = model.source.series.attributes
        origin = {name: text(stated, name) for name in stated if str(name).startswith(ORIGIN)}
        return xr.Dataset(current, found, attributes | origin)

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
            raise self.fail("places need finite numbers and depths that are not negative")
        if not len(east):
            empty = np.zeros(shape)
            return empty, empty, None if self.model.up is None else empty
        weights = self.geometry.locate(east, latitude=north)
        if weights.outside.any():
            raise self.fail(f"a place is outside the data, {describe(weights.beyond)}")
        self.check_times(float(seconds.min()), float(seconds.max()))
        window = self.geometry.window(weights.index)
        before, share, _ = along(self.times, seconds)
        ends = np.full((2, 3, len(down)), np.nan)  # at the times before and after, m/s east, north and up
        for frame in np.unique(np.concatenate([before, before[share > 0] + 1])):
            block = None
            for end in range(2):
                wanted = np.flatnonzero((before + end == frame) & ((share > 0) if end else (share < 1)))
                if len(wanted):
                    block = block or self.part(slice(int(frame), int(frame) + 1), window).block
                    corners, weight = window.index[wanted], weights.weight[wanted]
                    ends[end][:, wanted] = block.at(down[wanted], weight, corners)
        values = (1.0 - share) * ends[0] + share * ends[1]
        values = np.where(share <= 0, ends[0], np.where(share >= 1, ends[1], values))
        to_east, to_north, up = (component.reshape(shape) for component in values)
        return to_east, to_north, None if self.model.up is None else up

    def is_water(
        self, longitude: Array, latitude: Array, frames: slice, reach: float = 0.0
    ) -> NDArray[np.bool_]:
        """Return whether there is water at the surface at all of some times.

        Args:
            longitude, latitude: [M] degrees.
            reach: m, how far beyond a grid's outer points there still is water; a mesh ends at its cells.

        Returns:
            [M]; as the current itself, water is where at least half of the weight lies on points with water.

        Raises:
            CurrentError: values cannot be read.
        """
        wet = np.full(int(np.prod(self.geometry.shape)), -1, np.int8)
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
                window = self.geometry.window(new[:, None])
                water = np.ones(len(window.used), bool)
                for k in range(frames.start, frames.stop):
                    water &= np.isfinite(self.part(slice(k, k + 1), window).block.east[0, 0])
                wet[new] = water[window.index[:, 0]]
            left = (weights.weight * (wet[weights.index] > 0)).sum(axis=1)
            found[part] = there & (left >= ENOUGH)
        return found

    def sea_floor(self, longitude: Array, latitude: Array) -> Array | None:
        """Return the depth of the sea bed below the datum [M], m; None where the source does not give it.

        It is NaN on land and beyond the data.
        """
        if "deptho" not in self.names:
            return None
        weights = self.geometry.locate(longitude, latitude)
        window = self.geometry.window(weights.index)
        (depth,) = mix(weights.weight, self.part(slice(0, 1), window).floor[0][window.index])
        return np.where(weights.outside, np.nan, depth)

    def soundings(self, longitude: Array, latitude: Array) -> tuple[Array, Array, Array]:
        """Return the points among some places, and the depth that the source has there.

        Returns:
            Longitude and latitude [P], degrees; m below the datum, NaN on land.
        """
        points = np.arange(int(np.prod(self.geometry.shape)))
        middle, apart = bounds(longitude, latitude)
        away = np.abs(offset(middle, *self.geometry.places(points)))
        points = points[(away <= apart[:, None]).all(axis=0)]
        if not len(points):
            return np.empty(0), np.empty(0), np.empty(0)
        window = self.geometry.window(points)
        floor = self.part(slice(0, 1), window).floor[0]
        return *self.geometry.places(points), floor[window.index]

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
            raise self.fail(f"the mission needs {wanted}, the file covers {has}")

    def close(self) -> None:
        """Let go of the files."""
        self.model.source.series.close()

    def __exit__(self, *_: object) -> None:
        self.close()


def describe(beyond: Array) -> str:
    """Return how far places [M, 2] lie beyond, m north and east, in words."""
    reach = {
        "north": beyond[:, 0].max(), "south": -beyond[:, 0].min(),
        "east": beyond[:, 1].max(), "west": -beyond[:, 1].min(),
    }  # fmt: skip
    least = 0.02 * max(reach.values())
    words = [f"{far:.0f} m ({far / DEGREE:.2g} degrees) {side}" for side, far in reach.items() if far > least]
    return "by up to " + ", ".join(words)


@contextmanager
def understood(label: str, *opened: Any) -> Iterator[None]:
    """What no check has foreseen becomes one line that names the file; errors close what is open."""
    try:
        yield
    except Exception as error:
        for part in opened:
            part.close()
        if isinstance(error, CurrentError):
            raise
        why = f"{type(error).__name__}: {reason_of(error)}"
        raise CurrentError(f"{label}: cannot be understood ({why})") from None


def open_ocean(paths: Paths, *, crs: Any = None, epoch: Any = None) -> OceanData:
    """Open files of ocean currents: NetCDF-3, NetCDF-4, or Zarr folders.

    They may follow CF, or be native ROMS, FVCOM, SCHISM or SELFE output, or UGRID; see `read_current`.

    Args:
        paths: one path, a glob pattern, a dataset, or a list of such; files may be split over time, and hold
            the components, the grid and the levels apart.
        crs: projection of coordinates in metres, as pyproj takes it, where the files do not name it.
        epoch: the moment that the files' times count from, where they do not state it; a datetime in UTC.

    Raises:
        CurrentError: one line that names the file, the variable and what is wrong.
    """
    files = open_files(paths, crs, None if epoch is None else float(seconds_of(epoch)))
    with understood(files[0].path, *files):
        return OceanData.of(files)


def summary_of(ocean: OceanData) -> dict[str, Any]:
    """Return kind, extent, times and levels of a current, ready for JSON."""
    places = {"longitude": ocean.longitude, "latitude": ocean.latitude}
    found: dict[str, Any] = {
        "files": ocean.label,
        "kind": _KINDS[ocean.kind],
        "points": " x ".join(map(str, ocean.geometry.shape)),
        **{name: f"{np.nanmin(axis):.4f} to {np.nanmax(axis):.4f}" for name, axis in places.items()},
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
    found["components"] = f"{ocean.names['uo']}, {ocean.names['vo']}"
    for what, name in (("vertical", "wo"), ("sea_floor", "deptho"), ("surface_height", "zos")):
        found[what] = ocean.names.get(name, "not given")
    return found


def to_cf(ocean: OceanData) -> xr.Dataset:
    """Return all of a current in memory, as `OceanData.form` has it but in single precision.

    Raises:
        CurrentError: values cannot be read, or are too many.
    """
    times, levels = len(ocean.times), ocean.model.east.levels.count
    points = int(np.prod(ocean.geometry.shape))
    if times * levels * points > MAX_VALUES // 4:
        raise ocean.fail(
            f"{times} times, {levels} levels and {points} points are too many to be written at "
            "once: cut what is needed out of them first, such as by ncks"
        )
    form = ocean.form.copy()
    for name in ("uo", "vo", "wo", "zos"):
        if name in form:
            form[name] = form[name].astype(np.float32)
    return form.load()


class _Lazy(BackendArray):
    """A variable of the form, whose values are read where they are indexed."""

    dtype = np.dtype(float)

    def __init__(self, ocean: OceanData, name: str, dims: tuple, shape: tuple, last: dict) -> None:
        """Take the variable's name and axes, and what keeps the part that was read last."""
        self.ocean, self.name, self.dims, self.shape, self.last = ocean, name, dims, shape, last

    def __getitem__(self, key: Any) -> Any:
        outer = indexing.IndexingSupport.OUTER
        return indexing.explicit_indexing_adapter(key, self.shape, outer, self._read)

    def _read(self, key: tuple) -> Array:
        grid, axes = self.ocean.geometry, zip(self.dims, self.shape, key, strict=True)
        picks = {dim: np.atleast_1d(np.arange(size)[one]) for dim, size, one in axes}
        points = np.ravel_multi_index(np.ix_(*(picks.pop(dim) for dim in grid.dims)), grid.shape)
        frames = picks.pop("time", np.zeros(1, int))
        first, last = int(frames.min()), int(frames.max())
        wanted = first, last, points.tobytes()
        part = self.last.get(wanted) or self.ocean.part(slice(first, last + 1), grid.window(points))
        if self.name == "zos":
            values = part.rise  # [T or 1, P]
        elif self.name == "deptho":
            values = part.floor[0]  # [P]
        elif self.name == "zcor":
            block, rise = part.block, part.rise
            if block.floor is not None and "deptho" in self.ocean.names:
                rise = block.floor - part.floor
            values = rise[:, None] - np.where(np.isfinite(block.depths), block.depths, np.nan)
        else:  # [T, K, P], as that of levels
            values = {"uo": part.block.east, "vo": part.block.north, "wo": part.block.up}[self.name]
            assert values is not None
        values = values[..., part.window.index]
        if "time" in self.dims:
            self.last.clear()
            self.last[wanted] = part
            values = values[frames - first if len(values) > 1 else np.zeros_like(frames)]
        for levels in picks.values():
            values = values[:, levels]
        return values[tuple(0 if isinstance(one, int | np.integer) else slice(None) for one in key)]
