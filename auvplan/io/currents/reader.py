"""Reading ocean currents onto a grid of local metres, for planning."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from auvplan.errors import warn
from auvplan.io.currents.files import Array, Paths
from auvplan.io.currents.geometry import Weights, mix
from auvplan.io.currents.levels import at_depth
from auvplan.io.currents.ocean import MAX_VALUES, OceanData, describe, open_ocean, understood
from auvplan.io.currents.times import moment_of, seconds_of, stamp
from auvplan.ocean.gridded import CurrentError, GriddedCurrent
from auvplan.site import Site, swapped_hint

#: Where there is land: m north and east [M] to [M] bool, or wherever a mesh has no cells.
Land = Callable[[Array, Array], NDArray[np.bool_]] | Literal["mesh"]

#: Nodes a side of a local grid.
MAX_NODES = 512
#: Depths, m, onto which levels that follow the sea bed are interpolated, and others between them.
STANDARD_DEPTHS = (0, 2, 5, 10, 15, 20, 30, 50, 75, 100, 150, 200, 300, 400, 500, 750, 1000, 1500, 2000, 3000,
                   4000, 5000, 6000, 8000, 11000)  # fmt: skip

#: There are others where the current between two would be off by more, m/s, as long as these are farther
#: apart than that, m; and no more than that in all.
_BETWEEN, _NEAREST, _MOST = 0.02, 1.0, 32
#: Points and times by which that is judged.
_COLUMNS, _MOMENTS = 400, 3

#: By how much a grid's nodes are denser at most than the points of a source that they do not coincide with,
#: and the most values of a component that it has then.
_DENSER, _VALUES = 4.0, 1_000_000
#: Share of a cell by which nodes that coincide with the source's points may lie beside them.
_OFF = 0.05
#: Share of a spacing that is rounding.
_SAME = 1e-6
#: Values that are read at a time.
_CHUNK = 4_000_000
#: A time that lacks this share of the water of other times is missing.
_LOST = 0.5
#: Usual steps between two times that are a gap.
_GAP = 1.5
#: Water that is faster, m/s, is implausible; and none is as still everywhere.
_FAST, _STILL = 6.0, 1e-6


@dataclass(frozen=True, eq=False)
class CurrentFile:
    """Currents of a file on a local grid of X nodes north and Y nodes east.

    Attributes:
        field: the current; its times are s since `epoch`.
        epoch: the moment of time 0, UTC.
        water: [X, Y] bool, whether there is water at the first depth at all times; False beyond the data.
        covered: [X, Y] bool, whether the data reaches there: no farther than half a cell beyond a grid's
            points, nowhere beyond a mesh's cells.
        sea_floor: [X, Y] m below the datum, positive down, NaN on land and beyond the data; None where the
            file does not give it.
        low_water: [X, Y] m above the datum, the surface at its lowest, NaN on land; None where the file does
            not give its height.
        origin: m, north and east of node (0, 0).
        spacing: m between nodes, north and east.
        notes: every assumption that was made.
        site: of the local frame.
        source: the file as opened, with its exact sampler.
    """

    field: GriddedCurrent
    epoch: datetime
    water: NDArray[np.bool_]
    covered: NDArray[np.bool_]
    sea_floor: Array | None
    low_water: Array | None
    origin: tuple[float, float]
    spacing: tuple[float, float]
    notes: tuple[str, ...]
    site: Site
    source: OceanData


@dataclass(frozen=True, eq=False)
class _Box:
    """A box that is read: the source, and m north, east and depth of its corners about a site."""

    source: OceanData
    site: Site
    low: Array
    high: Array
    clamp: bool  # whether the nearest value holds beyond the data
    notes: list[str]  # get what has to be assumed

    def grid(self, step: float) -> "_Grid":
        """Return nodes from edge to edge, `step` m apart at most."""
        # A share of a spacing that rounding adds is no reason for one more node.
        north, east = (
            np.linspace(low, high, max(2, int(np.ceil((high - low) / step - _SAME)) + 1))
            for low, high in zip(self.low[:2], self.high[:2], strict=True)
        )
        return _Grid.of(self, north, east)

    @cached_property
    def spacing(self) -> float:
        """Median distance, m, between neighbours among the source's points around the box."""
        axes = (np.linspace(self.low[k], self.high[k], 24) for k in range(2))
        index = _Grid.of(self, *axes).weights.index
        ring = (0, 1, 2, 0) if index.shape[1] == 3 else (0, 1, 3, 2, 0)
        pairs = np.concatenate([index[:, [a, b]] for a, b in pairwise(ring)])
        pairs = np.unique(np.sort(pairs, axis=1), axis=0)
        places = (self.source.geometry.places(pairs[:, k]) for k in range(2))
        ends = [np.stack(self.site.to_local(*place), axis=1) for place in places]
        length = np.linalg.norm(ends[0] - ends[1], axis=1)
        length = length[length > 1e-3]
        return float(np.median(length)) if len(length) else float((self.high - self.low)[:2].max())


@dataclass(frozen=True, eq=False)
class _Grid:
    """Nodes of a local grid, and where they are in the source."""

    axes: tuple[Array, Array]  # [X] north and [Y] east of the nodes, m, even
    north: Array  # [X Y] m
    east: Array
    longitude: Array  # [X Y] degrees
    latitude: Array
    weights: Weights

    @classmethod
    def of(cls, box: _Box, *axes: Array) -> "_Grid":
        """Return nodes by their axes."""
        north, east = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        longitude, latitude = box.site.to_geographic(north, east)
        located = box.source.geometry.locate(longitude, latitude)
        return cls((axes[0], axes[1]), north, east, longitude, latitude, located)


def read_current(
    paths: Paths,
    site: Site,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    times: tuple[float, float] | None = None,
    spacing: float | None = None,
    depths: ArrayLike | None = None,
    outside: str = "refuse",
    land: Land | None = None,
    crs: Any = None,
    data_epoch: datetime | None = None,
) -> CurrentFile:
    """Read the currents of a box onto a local grid.

    NetCDF-3, NetCDF-4 and Zarr; CF on regular and curvilinear grids, native ROMS, UGRID, FVCOM, SCHISM and
    SELFE. Only the needed times and area are read. Each column is interpolated in depth, then the columns in
    the horizontal, linearly; velocities are turned into the local frame at each node. Depths are below the
    instantaneous surface.

    Args:
        paths: one path, a glob pattern, an xarray dataset such as one made by hand in the form of
            `OceanData.form`, or a list of such; files may be split over time, and hold the
            components, the grid and the levels apart.
        site: of the local frame. Where it has no epoch, the first time of the data is the epoch.
        lower, upper: [3] m north, east, depth, the corners of the box that must be covered.
        times: first and last s since the epoch that must be covered; all of the data's by default.
        spacing: m between nodes at most, so that they fit the box. By default nodes are the source's own
            where it has even rows and columns north and east, and elsewhere up to four times as dense.
        depths: m, rising; by default the source's levels down to the box's end and the next one. Where they
            follow the sea bed, standard depths and others between them: up to 32, at least 0.5 m apart, until
            the current between two is within 0.02 m/s of the source's, or a note says how far it is off.
        outside: "refuse" what the data does not cover, or "clamp": the nearest value holds.
        land: where no current is needed: m north and east [M] to [M] bool, as of a chart, or "mesh" for
            wherever the data is a mesh and has no cells; by default nowhere.
        crs: projection of the files' coordinates, as pyproj takes it, where they do not name it.
        data_epoch: the moment, UTC, that the files' times count from, where they do not state it.

    Raises:
        CurrentError: one line that names the file, the variable and what is wrong.

    Warns:
        ScenarioWarning: gaps between times, hours or places without values, odd speeds.

    Example:
        >>> read_current("norkyst.nc", Site(5.95, 55.95), lower=(-2e3, -2e3, 0), upper=(2e3, 2e3, 7)).notes
        ... # doctest: +SKIP
        ()
    """
    low, high = np.asarray(lower, float), np.asarray(upper, float)
    if low.shape != (3,) or high.shape != (3,) or not np.isfinite([low, high]).all():
        raise CurrentError("lower and upper must be three finite numbers each: m north, east, depth")
    if not (low[:2] < high[:2]).all() or low[2] > high[2] or high[2] < 0:
        raise CurrentError(f"upper must exceed lower, got {low.tolist()} and {high.tolist()}")
    if outside not in ("refuse", "clamp"):
        raise CurrentError(f"outside must be 'refuse' or 'clamp', got {outside!r}")
    source = open_ocean(paths, crs=crs, epoch=data_epoch)
    with understood(source.label), source:  # which opens again for whoever looks something up in it
        box = _Box(source, site, low, high, outside == "clamp", list(source.notes))
        epoch = moment_of(source.times[0]) if site.epoch is None else site.epoch
        frames = _frames(box, float(seconds_of(epoch)), times)
        grid = box.grid(_step(box, spacing))
        if grid.weights.outside.any():
            _check_cover(box, grid, land)
        wanted = _depths(box, grid, frames, depths)
        if spacing is None:
            values = grid.weights.outside.size * len(wanted) * (frames.stop - frames.start)
            denser = float(np.clip(np.sqrt(_VALUES / values), 1.0, _DENSER))
            own = _source_grid(box)
            if own is not None:
                grid = own
            elif denser > 1.0:
                grid = box.grid(_step(box, None) / denser)
        return _read(box, grid, frames, wanted, epoch)


def _read(box: _Box, grid: _Grid, frames: slice, depths: Array, epoch: datetime) -> CurrentFile:
    source, site, weights = box.source, box.site, grid.weights
    shape = (frames.stop - frames.start, len(depths), *map(len, grid.axes))
    apart = (float(grid.axes[0][1] - grid.axes[0][0]), float(grid.axes[1][1] - grid.axes[1][0]))
    (to_north, to_east, down), floor, lowest = _gridded(box, weights, frames, depths)
    u, v = (
        part.reshape(shape) for part in site.local_vector(to_north, to_east, grid.longitude, grid.latitude)
    )
    if not np.isfinite(u).any():
        raise source.fail("the current is missing everywhere in the box: there is land only")
    steps = np.diff(source.times)
    usual = float(np.median(steps)) if len(steps) > 1 else np.inf
    if wide := [k for k in range(frames.start, frames.stop - 1) if steps[k] > _GAP * usual]:
        k = max(wide, key=lambda k: steps[k])
        more = f", and in {len(wide) - 1} more gaps" if len(wide) > 1 else ""
        warn(
            f"{source.label}: has no current between {stamp(source.times[k])} and "
            f"{stamp(source.times[k + 1])}{more}, {steps[k] / 3600.0:.3g} h where its usual step is "
            f"{usual / 3600.0:.3g} h: it is interpolated"
        )
    _check_values(source, grid, frames, depths, u, v)
    origin = (float(grid.axes[0][0]), float(grid.axes[1][0]))
    field = GriddedCurrent.from_arrays(
        u, v, None if down is None else down.reshape(shape),
        origin=origin, spacing=apart, depths=depths, times=source.times[frames] - float(seconds_of(epoch)),
    )  # fmt: skip
    covered = ~weights.outside
    if source.kind != "triangles" and not covered.all():
        covered = np.hypot(*weights.beyond.T) <= box.spacing / 2.0
    covered = np.asarray(covered.reshape(shape[2:]))
    sea_floor, low_water = (
        None if values is None else np.where(covered, values.reshape(shape[2:]), np.nan)
        for values in (floor, lowest)
    )
    water = np.asarray(np.isfinite(u[:, 0]).all(axis=0)) & covered
    notes = tuple(dict.fromkeys(box.notes))
    return CurrentFile(field, epoch, water, covered, sea_floor, low_water, origin, apart, notes, site, source)


def _check_cover(box: _Box, grid: _Grid, land: Land | None) -> None:
    """Refuse a box that the data does not cover where there is water, or note what holds beyond it."""
    weights, outside, notes = grid.weights, grid.weights.outside, box.notes
    mesh = box.source.kind == "triangles"
    if callable(land):
        dry = np.asarray(land(grid.north, grid.east), bool)
    else:
        dry = np.full(len(outside), mesh and land == "mesh")
    lacking = outside & ~dry
    if outside.all() or (lacking.any() and not box.clamp):
        lacking = outside if outside.all() else lacking

        def fits(other: Site) -> bool:
            places = other.to_geographic(grid.north, grid.east)
            return not box.source.geometry.locate(*places).outside.any()

        far, hint = describe(weights.beyond[lacking]), swapped_hint(box.site, fits)
        raise box.source.fail(
            f"{_percent(lacking)} of the box is not covered: it reaches beyond the data {far}{hint}"
        )
    if lacking.any():
        what = "there is land unless a chart shows water, where the nearest" if mesh else "its nearest"
        notes.append(f"beyond the data's area, in {_percent(lacking)} of the box, {what} value holds")
    else:
        notes.append(f"{_percent(outside)} of the box lies beyond the data's area, where there is land")


def _frames(box: _Box, start: float, times: tuple[float, float] | None) -> slice:
    """Return the data's times that are needed."""
    source = box.source
    if times is None:
        return slice(0, len(source.times))
    if len(times) != 2 or not np.isfinite(times).all() or times[0] > times[1]:
        raise CurrentError(f"times must be the first and the last, s, got {times}")
    first, last = start + times[0], start + times[1]
    try:
        source.check_times(first, last)
    except CurrentError as error:
        if not box.clamp:
            raise
        if first > source.times[-1] or last < source.times[0]:
            warn(f"{error}: none of it is covered, the nearest time holds throughout (current.outside)")
        box.notes.append("beyond the data's times its nearest value holds")
    return source.frames(first, last)


def _step(box: _Box, spacing: float | None) -> float:
    """M between nodes, at most."""
    if spacing is None:
        return max(box.spacing, float((box.high - box.low)[:2].max()) / (MAX_NODES - 1))
    if not (np.isfinite(spacing) and spacing > 0):
        raise CurrentError(f"spacing must be positive, got {spacing}")
    count = max(2, int(np.ceil(float((box.high - box.low)[:2].max()) / spacing - _SAME)) + 1)
    if count > MAX_NODES:
        makes = f"{spacing:g} m makes {count} nodes a side, more than {MAX_NODES}"
        raise CurrentError(makes, field="spacing")
    return float(spacing)


def _source_grid(box: _Box) -> _Grid | None:
    """Return the source's own rows and columns in and around the box; None where they are not even ones.

    Interpolation between them is that of the source, and not one between values that were interpolated.
    """
    source, site, low, high = box.source, box.site, box.low, box.high
    middle = (np.atleast_1d(axis) for axis in site.to_geographic(*(0.5 * (low + high)[:2])))
    index = source.geometry.locate(*middle).index
    if index.shape[1] != 4:
        return None
    corner, east, north, opposite = np.stack(site.to_local(*source.geometry.places(index[0])), axis=1)
    step = opposite - corner
    if not (step > 0.0).all():
        return None
    skew = np.abs([north - corner - (step[0], 0.0), east - corner - (0.0, step[1])]).max()
    first = corner - step * np.maximum(np.ceil((corner - low[:2]) / step - _SAME), 0.0)
    counts = np.maximum(np.ceil((high[:2] - first) / step - _SAME).astype(int) + 1, 2)
    if skew > _OFF * step.min() or counts.max() > MAX_NODES:
        return None
    axes = first[0] + step[0] * np.arange(counts[0]), first[1] + step[1] * np.arange(counts[1])
    grid = _Grid.of(box, *axes)
    nearest = grid.weights.weight.max(axis=1)[~grid.weights.outside]
    return grid if len(nearest) and (nearest >= 1.0 - 2.0 * _OFF).all() else None


def _depths(box: _Box, grid: _Grid, frames: slice, depths: ArrayLike | None) -> Array:
    """Depths of the local grid, m."""
    if depths is not None:
        wanted = np.atleast_1d(np.asarray(depths, float))
        if wanted.ndim != 1 or not np.isfinite(wanted).all() or (np.diff(wanted, prepend=-1e-9) <= 0).any():
            raise CurrentError("depths must be rising numbers that are not negative")
        return wanted
    known, deepest = box.source.levels, box.high[2]
    levels = np.asarray(STANDARD_DEPTHS, float) if known is None else known
    if known is not None and deepest > levels[-1]:
        box.notes.append(f"below {levels[-1]:g} m the deepest level is extrapolated")
    levels = levels[: int(np.searchsorted(levels, deepest)) + 1]
    return levels if known is not None else _between(box, grid, frames, levels)


def _between(box: _Box, grid: _Grid, frames: slice, depths: Array) -> Array:
    """Return depths [D] m, and others between them where the current of some columns needs them.

    A column's current is taken to be that of its last depth with water from there down to its sea bed.
    """
    points = np.unique(grid.weights.index)
    window, columns = box.source.geometry.window(points[:: -(-len(points) // _COLUMNS)]), []
    for frame in np.unique(np.linspace(frames.start, frames.stop - 1, _MOMENTS).astype(int)):
        block, chosen = box.source.part(slice(frame, frame + 1), window).block, window.index
        assert block.floor is not None
        velocity = np.stack([block.east[0][:, chosen], block.north[0][:, chosen]])
        columns.append((velocity, block.depths[0][:, chosen], block.floor[0][chosen]))
    # East and north [2, K, C] m/s, levels [K, C] m, the sea bed [C] m, to which the last level's value holds.
    current, levels, floor = (np.concatenate(part, axis=-1) for part in zip(*columns, strict=True))
    there = np.isfinite(current).all(axis=0) & np.isfinite(levels)
    last = np.where(there, np.arange(len(levels))[:, None], 0).max(axis=0)
    places = np.concatenate([np.where(there, levels, np.nan), floor[None]])
    values = np.concatenate([current, np.take_along_axis(current, last[None, None], axis=1)], axis=1)
    while len(depths) > 1:
        found = np.stack([at_depth(tuple(current), levels, np.full(1, d), floor) for d in depths], axis=1)
        dry = np.isnan(found)
        found[:, 1:] = np.where(dry[:, 1:] & ~dry[:, :-1], found[:, :-1], found[:, 1:])
        k = np.clip(np.searchsorted(depths, np.nan_to_num(places)) - 1, 0, len(depths) - 2)
        share = (places - depths[k]) / (depths[k + 1] - depths[k])
        upper, lower = (np.take_along_axis(found, index[None], axis=1) for index in (k, k + 1))
        off = np.linalg.norm((1.0 - share) * upper + share * lower - values, axis=0)
        worst = np.zeros(len(depths) - 1)
        np.maximum.at(worst, k, np.where((share <= 1.0) & np.isfinite(off), off, 0.0))
        worst[depths[1:] <= box.low[2]] = 0.0
        wanting = np.flatnonzero((worst > _BETWEEN) & (np.diff(depths) > _NEAREST))
        wanting = wanting[np.argsort(-worst[wanting], kind="stable")][: _MOST - len(depths)]
        if not len(wanting):
            if (most := float(worst.max())) > 2.0 * _BETWEEN:
                off_by = f"the current is off by up to {most:.2f} m/s"
                box.notes.append(f"between the {len(depths)} depths read {off_by}")
            break
        depths = np.sort(np.concatenate([depths, 0.5 * (depths[wanting] + depths[wanting + 1])]))
    return depths


def _gridded(
    box: _Box, weights: Weights, frames: slice, wanted: Array
) -> tuple[tuple[Array, Array, Array | None], Array | None, Array | None]:
    """North, east and down [T, D, M] m/s at M places and D depths, the sea bed and the lowest water [M] m."""
    source = box.source
    window = source.geometry.window(weights.index)
    count = frames.stop - frames.start
    each = len(window.used) * source.model.east.levels.count
    values = count * each * (2 if source.model.up is None else 3)
    grid = count * len(wanted) * len(weights.index) * 3
    if (most := max(values, grid)) > MAX_VALUES:
        points = len(window.used)
        raise source.fail(f"{count} times and {points} points are {most} values, more than {MAX_VALUES}")
    places, corners = weights.index.shape
    rows = np.repeat(np.arange(places), corners)
    matrix = csr_array((weights.weight.ravel(), (rows, window.index.ravel())), (places, len(window.used)))
    step = max(1, _CHUNK // each)
    east, north, up = (np.empty((count, len(wanted), places)) for _ in range(3))
    for first in range(0, count, step):
        part = slice(frames.start + first, min(frames.start + first + step, frames.stop))
        block = source.part(part, window).block
        for k, depth in enumerate(wanted):
            for field, values in zip((east, north, up), block.at(np.full(1, depth), matrix), strict=True):
                field[first : first + step, k] = values
    floor, lowest, part = None, None, source.part(frames, window)
    if "deptho" in source.names:
        floor = mix(matrix, part.floor)[0][0]
    if "zos" in source.names:
        lowest = part.rise.min(axis=0, keepdims=True)
        lowest = mix(matrix, lowest if part.water is None else np.where(part.water, lowest, np.nan))[0][0]
    if source.model.up is None:
        return (north, east, None), floor, lowest
    # The field's mask is one for all components.
    lacking = np.isnan(up) & np.isfinite(east)
    if lacking.any():
        box.notes.append("where the level current is given and the vertical one is not, that is taken as 0")
    return (north, east, np.where(lacking, 0.0, -up)), floor, lowest


def _check_values(ocean: OceanData, grid: _Grid, frames: slice, depths: Array, u: Array, v: Array) -> None:
    """Refuse times that lack half of the water that others have; warn of other gaps and of odd speeds.

    Args:
        depths: [D] m.
        u, v: [T, D, X, Y] m/s, NaN where there is no value.
    """
    known = np.isfinite(u) & np.isfinite(v)
    ever = known.any(axis=0)
    water: NDArray[np.bool_] = np.asarray(ever.any(axis=0))
    gone = ever & ~known
    lost = gone.sum(axis=(1, 2, 3)) / max(int(ever.sum()), 1)
    moments = ocean.times[frames]
    missing = np.flatnonzero(lost >= _LOST)
    if len(missing):
        first, series = int(missing[0]), ocean.model.source.series
        file = series.parts[series.frames[frames.start + first, 0]].path
        more = f" and at {len(missing) - 1} other of {len(moments)} times" if len(missing) > 1 else ""
        raise CurrentError(
            f"{file}: at {stamp(float(moments[first]))}{more} the current is missing in {lost[first]:.0%} of "
            "the water that other times have: take such times out of the file, or fetch it again"
        )

    def warn_of(nodes: NDArray[np.bool_], what: str, more: str = "") -> None:
        """Warn of nodes [..., X, Y], naming the one nearest to their middle."""
        nodes = np.asarray(nodes.any(axis=tuple(range(nodes.ndim - 2))))
        at = np.argwhere(nodes)
        i, j = at[np.argmin(np.linalg.norm(at - at.mean(axis=0), axis=1))]
        k = i * nodes.shape[1] + j
        share = _percent(nodes, water)
        place = f"longitude {grid.longitude[k]:.4f}, latitude {grid.latitude[k]:.4f}"
        warn(
            f"{ocean.label}: {share} of the area's water {what}, such as {place}{more}: the nearest water's "
            "is taken there"
        )

    if ocean.levels is None:  # the tide lifts and lowers the bed among the depths
        gone[:, 1:] &= ~known[:, :-1]
    if gone.any():
        first = int(np.flatnonzero(gone.any(axis=(1, 2, 3)))[0])
        when = f", first missing at {stamp(float(moments[first]))}"
        warn_of(gone, "has a current at some times only", when)
    under = ~known[:, :-1] & known[:, 1:] & ~gone[:, :-1]
    if under.any():
        level = int(np.flatnonzero(under.any(axis=(0, 2, 3)))[0])
        warn_of(under, f"has no current at {depths[level]:g} m depth though there is one below it")
    fastest = float(np.sqrt(np.nanmax(np.square(u) + np.square(v))))
    if fastest > _FAST:
        warn(f"{ocean.label}: the current reaches {fastest:.1f} m/s, more than the sea's: are its units m/s?")
    elif fastest < _STILL:
        warn(f"{ocean.label}: the current is 0 everywhere in the area at all times")


def _percent(nodes: NDArray[np.bool_], of: NDArray[np.bool_] | None = None) -> str:
    """Return the share of nodes that are true, of all or of those that others are true for, in per cent."""
    share = nodes.sum() / max(nodes.size if of is None else int(of.sum()), 1)
    return f"{share:.0%}" if share >= 0.005 else "less than 1%"
