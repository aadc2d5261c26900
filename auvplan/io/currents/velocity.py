"""Velocities as a file holds them to m/s east, north and up at its points."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auvplan.io.currents.geometry import Curvilinear, Geometry, Regular, Window
from auvplan.io.currents.levels import Levels, find_levels, is_level
from auvplan.io.currents.names import Names, find_upward, standard_name
from auvplan.io.currents.opening import Pick, text
from auvplan.io.currents.points import Points
from auvplan.io.currents.projection import axes_angle, grid_angle
from auvplan.io.currents.series import Array, Series
from auvplan.io.currents.triangles import Triangles
from auvplan.io.currents.units import speed_factor

#: Variables that tell the angle from east to the grid's rows, counter-clockwise; ROMS and POP.
_ANGLES = ("angle", "ANGLE")
#: Directions of axes, rad, that differ by less are the same.
_SAME_AXES = np.deg2rad(2.0)
#: Faster water, m/s, is a fill value that the file does not declare.
FASTEST = 20.0
#: Velocities without units are taken as m/s if none is as fast.
FASTEST_UNITLESS = 10.0


@dataclass(frozen=True)
class Component:
    """A velocity component.

    Attributes:
        name: of the variable.
        dims: of its points: those of the geometry, or of the edges of its cells.
        extra: its dimensions besides time and points: those with one index, and that of its levels.
        levels: its depths.
        factor: m/s in its unit.
        limit: m/s, at which it is no velocity of water.
        valid: least and greatest value, in its unit, beyond which there is none.
    """

    name: str
    dims: tuple[str, ...]
    extra: tuple[str, ...]
    levels: Levels
    factor: float
    limit: float
    valid: tuple[float, float]


@dataclass(frozen=True)
class Block:
    """What is read of some times and points, T times, K levels, P points.

    Attributes:
        east, north: [T, K, P] m/s; both NaN where there is no water.
        depths: [1 or T, K, 1 or P] m below the surface, rising.
        floor: [1 or T, P] m, the sea bed below the surface; None where it is not known.
        up: [T, Ku, P] m/s, or None.
        depths_up: [1 or T, Ku, 1 or P] m, those of `up`.
    """

    east: Array
    north: Array
    depths: Array
    floor: Array | None
    up: Array | None
    depths_up: Array | None


@dataclass(frozen=True)
class Velocity:
    """The current of a series.

    Attributes:
        points: where it is given.
        east, north: components, along axes of their own where there is a `turn`.
        up: vertical velocity, or None.
        both: the dimension that tells the components of one variable apart, or None.
        turn: the angle [P], rad, from east to the first component's axis, counter-clockwise, at a window's
            points; or None.
        staggered: whether the components are on the edges of the cells, as in ROMS.
        mask: the mask of land at the points of all levels, or None.
    """

    points: Points
    east: Component
    north: Component
    up: Component | None
    both: str | None
    turn: Callable[[Window], Array] | None
    staggered: bool
    mask: str | None = None

    def read(self, frames: slice, window: Window) -> Block:
        """Everything about a window at some times.

        Raises:
            CurrentError: values cannot be read, or are no velocities of water.
        """
        if self.staggered:
            east = _between(self._edges(self.east, frames, window, 1), 1)
            north = _between(self._edges(self.north, frames, window, 0), 0)
            east, north = (values.reshape(*values.shape[:2], window.points) for values in (east, north))
        else:
            east, north = (
                self._values(part, frames, window, k) for k, part in enumerate((self.east, self.north))
            )
        wet = self.points.wet(frames, window)[:, None] & self.points.water(window)
        if self.mask is not None and not self.staggered:
            part = self.east.levels
            dims = (str(part.dim), *self.points.geometry.dims)
            deep = self.points.is_water(self.mask, window.picks, dims)
            wet = wet & deep.reshape(len(deep), -1)[part.order]
        land = ~(np.isfinite(east) & np.isfinite(north) & wet)
        if self.turn is not None:
            turn = self.turn(window)
            east, north = (
                east * np.cos(turn) - north * np.sin(turn),
                east * np.sin(turn) + north * np.cos(turn),
            )
        depths, floor = self.east.levels.read(frames, window)
        if floor is not None and self.east.levels.fixed is not None:
            # Models without a fill value leave the levels below the bed at zero.
            land |= (east == 0.0) & (north == 0.0) & (depths > floor[:, None])
        up, depths_up = None, None
        if self.up is not None:
            up = self._values(self.up, frames, window, 0)
            depths_up = self.up.levels.read(frames, window)[0]
        east, north = (np.where(land, np.nan, values) for values in (east, north))
        return Block(east, north, depths, floor, up, depths_up)

    def _values(self, part: Component, frames: slice, window: Window, which: int) -> Array:
        """[T, K, P] m/s of a component that is given at the points."""
        if self.both is not None and part is not self.up:
            chosen = {**window.picks, self.both: np.asarray([which])}
            values = self._read(part, frames, chosen, (*part.extra, self.both, *part.dims))
        else:
            values = self._read(part, frames, window.picks, (*part.extra, *part.dims))
        return values.reshape(len(values), -1, window.points)[:, part.levels.order]

    def _edges(self, part: Component, frames: slice, window: Window, axis: int) -> Array:
        """[T, K, rows, columns] m/s on the edges before and after a window's points along an axis of them."""
        grid = self.points.geometry
        picks: dict[str, Pick] = {}
        middles = dict(window.picks)
        ends = [False, False]
        for k, dim in enumerate(grid.dims):
            pick = window.picks[dim]
            assert isinstance(pick, slice)
            if k == axis:
                count = grid.longitude.shape[axis] - 1
                ends = [pick.start == 0, pick.stop > count]
                pick = slice(max(pick.start - 1, 0), min(pick.stop, count))
                middles[dim] = slice(pick.start, pick.stop + 1)
            picks[part.dims[k]] = pick
        values = self._read(part, frames, picks, (*part.extra, *part.dims))
        values = values.reshape(len(values), -1, *values.shape[-2:])
        mask = self.mask or self.points.mask
        if mask is not None:
            # Without fill values the walls of land hold zeros, which are no current.
            level = [str(self.east.levels.dim)] if self.mask else []
            water = self.points.is_water(mask, middles, (*level, *grid.dims))
            water = np.moveaxis(water, axis - 2, 0)
            values = np.where(np.moveaxis(water[1:] & water[:-1], 0, axis - 2), values, np.nan)
        # The grid's own rim has an edge on one side only.
        pad = [(0, 0)] * 4
        pad[2 + axis] = (int(ends[0]), int(ends[1]))
        return np.pad(values, pad, constant_values=np.nan)[:, part.levels.order]

    def _read(self, part: Component, frames: slice, picks: dict[str, Pick], dims: Sequence[str]) -> Array:
        values = self.points.series.read(part.name, picks, frames, dims)
        low, high = part.valid
        values = np.where((values < low) | (values > high), np.nan, values) * part.factor
        fastest = float(np.nanmax(np.abs(values), initial=0.0))
        if fastest >= part.limit:
            if part.limit == FASTEST_UNITLESS:
                raise self.points.series.fail(f"{part.name} has no units and reaches {fastest:g}: not m/s")
            raise self.points.series.fail(
                f"{part.name} reaches {fastest:g} m/s, which is implausible: check units and _FillValue"
            )
        return values


def _between(edges: Array, axis: int) -> Array:
    """Means of neighbours along an axis of the last two; of one of them where the other is land."""
    edges = np.moveaxis(edges, 2 + axis, -1)
    pair = np.stack([edges[..., :-1], edges[..., 1:]])
    there = np.isfinite(pair)
    count = there.sum(axis=0)
    mean = np.where(there, pair, 0.0).sum(axis=0) / np.maximum(count, 1)
    return np.moveaxis(np.where(count > 0, mean, np.nan), -1, 2 + axis)


def find_velocity(series: Series, names: Names, geometry: Geometry, notes: list[str]) -> Velocity:
    """Return how the current of a series is read.

    Args:
        series: the files.
        names: of its components.
        geometry: the places of its points.
        notes: get what has to be assumed.

    Raises:
        CurrentError: units, dimensions, levels or angles are missing or contradict themselves.
    """
    points = Points(series, geometry)
    if (masks := points.masks()) and points.mask is None:
        notes.append(f"{masks[0]} says land everywhere: left out")
    staggered = isinstance(geometry, Curvilinear) and geometry.kind == "roms"
    east = _component(points, names.east, names.both, notes, 1 if staggered else None)
    north = _component(points, names.north, names.both, notes, 0 if staggered else None, east.levels)
    turn = _turn(points, names, staggered, notes)
    mask = None if east.levels.dim is None else points.mask_along(east.levels.dim)
    return Velocity(points, east, north, _upward(points, notes), names.both, turn, staggered, mask)


def _component(
    points: Points,
    name: str,
    both: str | None,
    notes: list[str],
    edge: int | None,
    levels: Levels | None = None,
) -> Component:
    """Return a component, given at the points or, along axis `edge` of them, on the edges between them.

    Its levels must be the other component's, where that is given.
    """
    series, grid = points.series, points.geometry
    dims = [dim for dim in series.dims(name) if dim != both]
    if edge is None:
        own = grid.dims
    else:
        own = tuple(dims[-2:])
        wanted = [size - (k == edge) for k, size in enumerate(grid.longitude.shape)]
        sizes = [series.variables[name].sizes[dim] for dim in own]
        if sizes != wanted:
            shapes = [" x ".join(map(str, shape)) for shape in (sizes, wanted)]
            raise series.fail(f"{name} has {shapes[0]} points, {shapes[1]} fit the grid")
    rest = [dim for dim in dims if dim not in own]
    if not set(own) <= set(dims):
        raise series.fail(f"{name} has dimensions {', '.join(dims)}, not those of its longitude and latitude")
    # A dimension of one member, ensemble or the like is no level where another one is left.
    sizes = series.variables[name].sizes
    long = [dim for dim in rest if sizes[dim] > 1]
    if len(long) > 1:
        odd = [dim for dim in long if not is_level(points, dim)] or long
        raise series.fail(
            f"{name} has dimensions {' and '.join(long)}, of which one is neither level nor place: take one "
            f"index of it out first, such as by ncks -d {odd[0]},0"
        )
    level = next(iter(long or [dim for dim in rest if is_level(points, dim)]), None)
    extra = (*(dim for dim in rest if dim != level), *([] if level is None else [level]))
    factor, limit = _speed(points, name, notes)
    found = levels if levels is not None and levels.dim == level else find_levels(points, name, level, notes)
    if levels is not None and levels is not found:
        one, two = levels.fixed, found.fixed
        if one is None or two is None or one.shape != two.shape or not np.allclose(one, two):
            raise series.fail(
                f"{name} has levels along {level}, the other component along {levels.dim}, and they differ"
            )
    return Component(name, own, extra, found, factor, limit, _valid(series, name))


def _valid(series: Series, name: str) -> tuple[float, float]:
    """Return the stated least and greatest value, and half their span more: fill values lie beyond."""
    variable = series.variables[name]
    ends = [variable.attrs.get(f"valid_{end}") for end in ("min", "max")]
    stated = variable.attrs.get("valid_range", ends)
    try:
        low, high = (float(value) for value in np.asarray(stated).ravel())
    except (TypeError, ValueError):
        return -np.inf, np.inf
    # Those of packed values count in the packed unit, or not, as writers please.
    if not low < high or "scale_factor" in variable.encoding or "add_offset" in variable.encoding:
        return -np.inf, np.inf
    return low - (high - low) / 2.0, high + (high - low) / 2.0


def _speed(points: Points, name: str, notes: list[str]) -> tuple[float, float]:
    units = text(points.series.attrs(name), "units")
    if not units:
        notes.append(f"{name} has no units: taken as m/s")
        return 1.0, FASTEST_UNITLESS
    factor = speed_factor(units)
    if factor is None:
        raise points.series.fail(
            f"{name} has units {units!r}, which are no speed that is known: if they are m/s, write so, such "
            f"as by ncatted -a units,{name},o,c,'m s-1'"
        )
    return factor, FASTEST


def _turn(
    points: Points, names: Names, staggered: bool, notes: list[str]
) -> Callable[[Window], Array] | None:
    """Return the angle [P], rad, from east to the first component's axis, counter-clockwise, or None."""
    grid, series = points.geometry, points.series
    standard = standard_name(series.files[0], names.east)
    if not (names.along_grid or staggered):
        return None
    words = [text(series.attrs(name), "long_name").lower() for name in (names.east, names.north)]
    if not (standard or staggered) and "eastward" in words[0] and "northward" in words[1]:
        if not isinstance(grid, Regular):
            notes.append(f"{names.east} and {names.north} are eastward and northward by their long_name")
        return None
    named = [name for name in _ANGLES if name in series.variables and points.has(name)]
    if isinstance(grid, Curvilinear) and named:
        radians = _radians(points, named[0], notes)
        return lambda window: points.read(named[0], slice(0, 1), window)[0] * radians
    if isinstance(grid, Triangles) and grid.crs is not None:
        crs = grid.crs
        return lambda window: axes_angle(crs, *_places(grid, window))
    if not isinstance(grid, Curvilinear) or (not staggered and _is_straight(grid)):
        if standard:
            notes.append(f"{names.east} and {names.north} are along x and y: taken as east and north")
        return None
    angle = None if staggered else _along_projection(points, notes)
    if angle is None and (staggered or "_x_" in standard or standard.startswith("x_")):
        notes.append("angle is not given: the rows of the grid are followed by the places of its points")
        angle = _along_rows(points, staggered)
    if angle is not None:
        return lambda window: angle[np.ix_(*(_indices(window, dim) for dim in grid.dims))].ravel()
    raise series.fail(
        f"{names.east} and {names.north} may follow the grid's axes: angle, which tells how, is missing, and "
        "so are a grid_mapping and a standard_name of the components: name the model's grid file beside it "
        "in current.files, or write what they are, such as by ncatted -a "
        f"standard_name,{names.east},o,c,eastward_sea_water_velocity"
    )


def _is_straight(grid: Curvilinear) -> bool:
    """Return whether the rows of a grid are parallels and its columns meridians."""
    axes = (grid.longitude, grid.latitude)
    return grid.crs is None and any(
        all(
            np.allclose(axis, axis.take([0], k), rtol=0.0, atol=1e-6)
            for k, axis in zip(order, axes, strict=True)
        )
        for order in ((0, 1), (1, 0))
    )


def _along_projection(points: Points, notes: list[str]) -> Array | None:
    """Return the angle [ny, nx], rad, from east to x of a projection that fits the places, or None."""
    grid = points.geometry
    crs = grid.crs if isinstance(grid, Curvilinear) else None
    if crs is None:
        return None
    angle = axes_angle(crs, grid.longitude, grid.latitude)
    off = np.abs(np.angle(np.exp(1j * (angle - _along_rows(points, staggered=False)))))
    if float(np.nanmedian(off)) < _SAME_AXES:
        return angle
    notes.append(f"the axes of {crs.name} do not follow the places of the grid's points: left out")
    return None


def _along_rows(points: Points, staggered: bool) -> Array:
    """Return the angle [ny, nx], rad, from east to x, by the places of a grid's points."""
    grid = points.geometry
    across, falling = (False, False) if staggered else _x_axis(points)
    longitude, latitude = (axis.T if across else axis for axis in (grid.longitude, grid.latitude))
    angle = grid_angle(longitude, latitude) + np.pi * falling
    return angle.T if across else angle


def _x_axis(points: Points) -> tuple[bool, bool]:
    """Return whether x runs along a grid's first dimension, not its second, and whether it falls there."""
    file = points.series.files[0]
    for name, variable in file.variables.items():
        stated = standard_name(file, name) in ("projection_x_coordinate", "grid_longitude")
        fits = variable.ndim == 1 and str(variable.dims[0]) in points.geometry.dims and variable.size > 1
        if fits and (stated or text(variable.attrs, "axis") == "X"):
            x = file.coordinate(name)
            return str(variable.dims[0]) == points.geometry.dims[0], bool(x[-1] < x[0])
    first, second = (dim.lower().lstrip("n") for dim in points.geometry.dims)
    return first.startswith(("x", "i", "lon")) and second.startswith(("y", "j", "lat")), False


def _indices(window: Window, dim: str) -> NDArray[np.int64]:
    pick = window.picks[dim]
    return np.arange(pick.start, pick.stop) if isinstance(pick, slice) else pick


def _places(grid: Curvilinear | Triangles, window: Window) -> tuple[Array, Array]:
    """Longitude and latitude [P] of a window's points, degrees."""
    part = np.ix_(*(_indices(window, dim) for dim in grid.dims))
    return grid.longitude[part].ravel(), grid.latitude[part].ravel()


def _radians(points: Points, name: str, notes: list[str]) -> float:
    """Return the radians in the unit of the variable of angles."""
    series = points.series
    values = series.files[0].coordinate(name, missing=True)
    units = text(series.attrs(name), "units").lower()
    if units.startswith("deg"):
        return float(np.pi / 180.0)
    far = float(np.nanmax(np.abs(values)))
    if far > 2.0 * np.pi + 1e-6:
        if units.startswith("rad"):
            raise series.fail(f"{name} is in radians and reaches {far:g}")
        notes.append(f"{name} has no units: taken as degrees, by its values")
        return float(np.pi / 180.0)
    if not units.startswith("rad"):
        notes.append(f"{name} has no units: taken as radians, by its values")
    return 1.0


def _upward(points: Points, notes: list[str]) -> Component | None:
    """Return the vertical velocity, where it is given at the same points."""
    series = points.series
    name = find_upward(series.files[0])
    if name is None:
        return None
    dims = series.dims(name)
    if not set(points.geometry.dims) <= set(dims) or len(dims) > len(points.geometry.dims) + 1:
        notes.append(f"{name} is not given where the level components are: left out")
        return None
    return _component(points, name, None, notes, None)
