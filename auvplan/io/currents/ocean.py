"""Ocean current files as opened, with an exact sampler on the host, and what they hold in a few lines."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Self

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from auvplan.errors import reason_of
from auvplan.io.currents.files import Array, File, Paths, open_files, text
from auvplan.io.currents.form import ABOUT, to_form
from auvplan.io.currents.geometry import DEGREE, ENOUGH, Weights, Window, along, mix_gathered
from auvplan.io.currents.levels import at_depth
from auvplan.io.currents.times import moment_of, seconds_of, stamp
from auvplan.io.currents.triangles import Geometry
from auvplan.ocean.gridded import CurrentError
from auvplan.scenario.provenance import ORIGIN

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
class Block:
    """What is read of some times and points, T times, K levels, P points."""

    east: Array  # [T, K, P] m/s; both NaN where there is no water
    north: Array
    depths: Array  # [1 or T, K, 1 or P] m below the surface, rising
    floor: Array | None  # [1 or T, P] m, the sea bed below the surface; None where it is not known
    up: Array | None  # [T, Ku, P] m/s, or None
    depths_up: Array  # [1 or T, Ku, 1 or P] m, those of `up`


@dataclass(frozen=True)
class OceanData:
    """Currents of the sea as a model has them; nothing but the axes is read until it is asked for.

    Make one with `open_ocean`; it is also a context manager that closes the files.

    Attributes:
        form: the current as one CF data set, see `auvplan.io.currents.form`.
        geometry: the places of its points.
        kind: "regular", "curvilinear", "roms" (velocities on the edges of the cells) or "triangles".
        longitude, latitude: degrees; [nx] and [ny] where regular, [ny, nx] where curvilinear, else [P].
        times: [T] s since 1970-01-01 UTC.
        levels: [K] m below the surface, or None where they follow the sea bed.
        notes: what had to be assumed.
        label: the files' name for messages.
    """

    form: xr.Dataset
    geometry: Geometry
    kind: str
    longitude: Array
    latitude: Array
    times: Array
    levels: Array | None
    notes: tuple[str, ...]
    label: str

    @classmethod
    def of(cls, form: xr.Dataset, geometry: Geometry) -> Self:
        """Return the current of a data set in the form, and of the places of its points."""
        depth, places = form.variables["depth"], (geometry.kind, geometry.longitude, geometry.latitude)
        levels = depth.values if depth.ndim == 1 else None
        times = form.variables["time"].values
        return cls(form, geometry, *places, times, levels, form.attrs["notes"], form.attrs["source"])

    @property
    def moments(self) -> tuple[datetime, ...]:
        """The times in UTC."""
        return tuple(moment_of(second) for second in self.times)

    def source(self, name: str) -> str | None:
        """Return the files' own name of one of the form's variables, None where they lack it."""
        return self.form[name].encoding["source"] if name in self.form else None

    def fail(self, words: str) -> CurrentError:
        """Return an error that names the files."""
        return CurrentError(f"{self.label}: {words}")

    def field(self, name: str, frames: slice, window: Window) -> NDArray[Any]:
        """Return values [T or 1, ..., P or 1] of a variable of the form at some times and a window's points.

        Raises:
            CurrentError: they cannot be read, or make no sense.
        """
        variable = self.form.variables[name]
        picks = {"time": frames, **window.picks}
        values = variable.isel({dim: pick for dim, pick in picks.items() if dim in variable.dims}).values
        if not set(window.picks) & set(variable.dims):
            return values[None, :, None]
        values = values.reshape(*values.shape[: values.ndim - len(window.picks)], window.points)
        return values if "time" in variable.dims else values[None]

    def rise(self, frames: slice, window: Window) -> Array:
        """Height [T or 1, P] m of the surface above the datum; 0 where it is not given."""
        return self.field("zos", frames, window) if "zos" in self.form else np.zeros((1, window.points))

    def read(self, frames: slice, window: Window) -> Block:
        """Return everything about a window's points at some times.

        Raises:
            CurrentError: values cannot be read, or are no velocities of water.
        """
        form = self.form
        east, north = (self.field(name, frames, window) for name in ("uo", "vo"))
        land = ~(np.isfinite(east) & np.isfinite(north))
        for name in ("mask", "wet", "flats"):
            if name in form:
                water = self.field(name, frames, window)
                land |= ~(water if water.ndim == 3 else water[:, None])
        if "angle" in form:
            turn = self.field("angle", frames, window)[0]
            cos, sin = np.cos(turn), np.sin(turn)
            east, north = east * cos - north * sin, east * sin + north * cos
        depths = self.field("depth", frames, window)
        bed = next((name for name in ("bed", "deptho") if name in form), None)
        floor = None if bed is None else self.field(bed, frames, window)
        if floor is not None and self.levels is not None:
            # Models without a fill value leave the levels below the bed at zero.
            land |= (east == 0.0) & (north == 0.0) & (depths > floor[:, None])
        up, depths_up = None, depths
        if "wo" in form:
            up = self.field("wo", frames, window)
            depths_up = self.field("depth_w", frames, window) if "depth_w" in form else depths
        east, north = (np.where(land, np.nan, values) for values in (east, north))
        return Block(east, north, depths, floor, up, depths_up)

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
            return empty, empty, None if "wo" not in self.form else empty
        weights = self.geometry.locate(east, latitude=north)
        if weights.outside.any():
            raise self.fail(f"a place is outside the data, {describe(weights.beyond)}")
        self.check_times(float(seconds.min()), float(seconds.max()))
        to_east, to_north, up = (values.reshape(shape) for values in self._sampled(weights, down, seconds))
        return to_east, to_north, up if "wo" in self.form else None

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
                water = np.ones(window.points, bool)
                for k in range(frames.start, frames.stop):
                    water &= np.isfinite(self.read(slice(k, k + 1), window).east[0, 0])
                wet[new] = water[window.index[:, 0]]
            left = (weights.weight * (wet[weights.index] > 0)).sum(axis=1)
            found[part] = there & (left >= ENOUGH)
        return found

    def sea_floor(self, longitude: Array, latitude: Array) -> Array | None:
        """Return the depth of the sea bed below the datum [M], m; None where the source does not give it.

        It is NaN on land and beyond the data.
        """
        if "deptho" not in self.form:
            return None
        weights = self.geometry.locate(longitude, latitude)
        window = self.geometry.window(weights.index)
        (depth,) = mix_gathered(weights.weight, self.field("deptho", slice(0, 1), window)[0][window.index])
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
            raise self.fail(f"the mission needs {wanted}, the file covers {has}")

    def close(self) -> None:
        """Let go of the files."""
        self.form.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _sampled(self, weights: Weights, depth: Array, seconds: Array) -> Array:
        """[3, M] m/s east, north and up, NaN where there is no water."""
        window = self.geometry.window(weights.index)
        before, share, _ = along(self.times, seconds)
        ends = np.full((2, 3, len(depth)), np.nan)
        for frame in np.unique(np.concatenate([before, before[share > 0] + 1])):
            block = None
            for end in range(2):
                wanted = np.flatnonzero((before + end == frame) & ((share > 0) if end else (share < 1)))
                if len(wanted):
                    block = block or self.read(slice(int(frame), int(frame) + 1), window)
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
        return OceanData.of(*to_form(files))


def ocean_of(files: Sequence[File]) -> OceanData:
    """Return the current of files that are open; raises as `open_ocean`."""
    with understood(files[0].path):
        return OceanData.of(*to_form(files))


def summary_of(ocean: OceanData) -> dict[str, Any]:
    """Return kind, extent, times and levels of a current, ready for JSON."""
    found: dict[str, Any] = {
        "files": ocean.label,
        "kind": _KINDS[ocean.kind],
        "points": " x ".join(map(str, ocean.geometry.shape)),
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
    names = {"vertical": "wo", "sea_floor": "deptho", "surface_height": "zos"}
    return found | {
        "components": f"{ocean.source('uo')}, {ocean.source('vo')}",
        **{what: ocean.source(name) or "not given" for what, name in names.items()},
    }


def _span(values: Any) -> str:
    return f"{np.nanmin(values):.4f} to {np.nanmax(values):.4f}"


def to_cf(ocean: OceanData) -> xr.Dataset:
    """Return all of a current as CF-1.11, with a mesh as UGRID-1.0.

    Returns:
        `uo`, `vo` and, where the source has it, `wo` [time, level, points] m/s, NaN where there is no water;
        `deptho` [points] m where the bed is given; `zos` [time, points] m, the surface above the datum, where
        it is given. Levels are `depth` [level] m, or `zcor` [time, level, points] m above the datum
        where they follow the bed.

    Raises:
        CurrentError: values cannot be read, or are too many.
    """
    form, grid = ocean.form, ocean.geometry
    times, levels, points = form.sizes["time"], form.sizes["level"], int(np.prod(grid.shape))
    if times * levels * points > MAX_VALUES // 4:
        raise ocean.fail(
            f"{times} times, {levels} levels and {points} points are too many to be written at "
            "once: cut what is needed out of them first, such as by ncks"
        )
    frames, window = (
        slice(0, times),
        Window({dim: slice(None) for dim in grid.dims}, np.arange(points), points),
    )
    block, rise = ocean.read(frames, window), ocean.rise(frames, window)
    fields: dict[str, Any] = {"uo": block.east, "vo": block.north}
    if block.up is not None and block.up.shape[1] == levels:
        fields["wo"] = block.up
    if "zos" in form:
        fields["zos"] = rise
    fields = {
        name: np.broadcast_to(values, (times, *values.shape[1:])).astype(np.float32)
        for name, values in fields.items()
    }
    if "deptho" in form:
        fields["deptho"] = ocean.field("deptho", frames, window)[0]
    if ocean.levels is None:
        if "deptho" in form and block.floor is not None:
            rise = block.floor - fields["deptho"]
        fields["zcor"] = rise[:, None] - np.where(np.isfinite(block.depths), block.depths, np.nan)
        fields["zcor"] = np.broadcast_to(fields["zcor"], (times, levels, points))
    located: dict[str, Any] = {}
    found: dict[str, Any] = {"time": ("time", ocean.times, ABOUT["time"])}
    if ocean.levels is not None:
        found["depth"] = "level", ocean.levels, ABOUT["depth"]
    places = grid.coordinates
    if "face_nodes" in places:
        located = {"mesh": "mesh", "location": grid.dims[0]}
        found["mesh"] = (), np.int32(0), ABOUT["mesh"]
    for name, (dims, values) in places.items():
        kind = next(
            kind for kind in ("longitude", "latitude", "face_nodes") if name.endswith((kind, kind[:3]))
        )
        if name == "face_nodes":
            values = values.astype(np.int32)
        elif name == kind and ocean.kind == "triangles":
            if located.get("location") == "node":
                continue
            name = f"{dims[0]}_{kind}"
        found[name] = dims, values, ABOUT[kind]
    leads, current = {"zos": ("time",), "deptho": ()}, {}
    for name, values in fields.items():
        about = ABOUT[name] | (located if name != "zcor" else {})
        shaped = values.reshape(*values.shape[:-1], *grid.shape)
        current[name] = (*leads.get(name, ("time", "level")), *grid.dims), shaped, about
    attributes = {
        "Conventions": "CF-1.11 UGRID-1.0",
        "source": ocean.label,
        "comment": "; ".join(ocean.notes),
    }
    origin = {name: text(form.attrs, name) for name in form.attrs if str(name).startswith(ORIGIN)}
    return xr.Dataset(current, found, attributes | origin)
