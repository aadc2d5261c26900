"""The form that the currents of all models are brought to: one CF data set, read where it is indexed.

Its variables, by name:

- `uo`, `vo` [time, level, points] m/s, NaN where there is none: east and north or, beside an `angle` [points]
  rad, along axes turned by it from east, counter-clockwise. `wo` [time, level or level_w, points] m/s up.
- `longitude`, `latitude` degrees: of columns and rows, of points in rows and columns (y, x), or of a mesh's
  nodes or faces. `face_nodes` [face, corner], `node_lon` and `node_lat` define a mesh's cells.
- `time` s since 1970-01-01 UTC, and the `file` of each.
- `depth` [level] m below the surface, rising; or [time, level, points] where levels follow the sea bed.
  `depth_w` is that of `level_w`; `bed` [time, points] m is the depth of the sea bed then.
- `deptho` [points] m, the sea bed below the datum, and `zos` [time, points] m, the surface above it.
- `mask` [points], `wet` [level, points] and `flats` [time, points], True where there is water.

Components on the edges of cells (ROMS and other C-grids) are brought to the middles as they are read.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pyproj import CRS

from auvplan.io.currents.files import Array, File, Lazy, Series
from auvplan.io.currents.geometry import Curvilinear, Regular
from auvplan.io.currents.levels import Levels, find_levels, once
from auvplan.io.currents.names import (
    MASK_NAMES,
    MASKS,
    Names,
    find_current,
    find_floor,
    find_places,
    find_upward,
    is_level,
    require_field,
)
from auvplan.io.currents.projection import axes_angle, find_crs, grid_angle, in_degrees
from auvplan.io.currents.series import in_order, unified
from auvplan.io.currents.triangles import Geometry, Triangles, cell_means, find_triangles
from auvplan.io.currents.units import speed_factor
from auvplan.ocean.gridded import CurrentError

#: Variables with the angle from east to the grid's rows, counter-clockwise; ROMS and POP.
_ANGLES = ("angle", "ANGLE")
#: Directions of axes, rad, that differ by less are the same.
_SAME_AXES = np.deg2rad(2.0)
#: Faster water, m/s, is a fill value that the file does not declare; without units it is in another unit.
_FASTEST, _FASTEST_UNITLESS = 20.0, 10.0
_SURFACES = ("zeta", "elev", "elevation", "ssh", "zos")
_SURFACE_NAMES = ("sea_surface_height_above_geoid", "sea_surface_height_above_mean_sea_level",
                  "sea_surface_height", "sea_surface_elevation")  # fmt: skip
#: No surface, nor land that models give instead, lies so far from the datum, m.
_HIGHEST = 9_000.0
#: Masks of flats that fall dry, of FVCOM, ROMS and SCHISM, and whether 1 is dry.
_WETTING = (
    ("wet_cells", False), ("wet_nodes", False), ("wetdry_mask_rho", False), ("wetdry_mask", False),
    ("dryFlagElement", True), ("dryFlagNode", True), ("wetdry_elem", True), ("wetdry_node", True),
)  # fmt: skip

#: What is said of the form's variables, also where it is written.
ABOUT = {
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

#: From indices of the times, then of other dimensions, to values [times or 1, ...].
Read = Callable[..., NDArray[Any]]
_FIRST = slice(0, 1)


@dataclass(frozen=True)
class Source:
    """A series of files on its way to the form."""

    series: Series  # the files
    geometry: Geometry  # the places of the points
    dims: tuple[str, ...]  # the files' own dimensions of the points
    notes: list[str]  # get what has to be assumed
    crs: CRS | None = None  # the projection that the coordinates of the places count along; None for degrees
    corners: str | None = None  # the dimension of the cells' corners, where the points are the cells' middles
    form: dict[str, xr.Variable] = field(default_factory=dict)  # the variables of the form

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Lengths of the form's dimensions."""
        return {
            "time": len(self.series.times),
            **dict(zip(self.geometry.dims, self.geometry.shape, strict=True)),
        }

    def add(self, name: str, extra: Sequence[str], read: Read, **about: Any) -> None:
        """Put values at the points into the form, with dimensions before the points', time first of them."""
        dims = (*extra, *self.geometry.dims)
        plain = read if "time" in extra else lambda *keys: read(_FIRST, *keys)[0]
        kind = bool if name in ("mask", "wet", "flats") else float
        self.form[name] = Lazy.variable(dims, [self.sizes[dim] for dim in dims], plain, kind)
        self.form[name].encoding = about

    def turn(self, name: str, level: str, levels: Levels) -> None:
        """Put the levels of a variable of the form in order, from the surface down."""
        if levels.order.step == -1:
            self.form[name] = self.form[name].isel({level: levels.order})

    def has(self, name: str) -> bool:
        """Return whether a variable is given at the points, or at the corners of their cells."""
        dims = self.series.dims(name)
        return set(self.dims) <= set(dims) or self.corners in dims

    def timed(self, name: str | None) -> tuple[str, ...]:
        """Return the form's dimension of time where a variable knows it."""
        timeless = name is None or self.series.time_dim not in self.series.variables[name].dims
        return () if timeless else ("time",)

    def reading(self, name: str, extra: Sequence[str] = ()) -> Read:
        """Return what reads a variable [times or 1, *extra, *points] by indices of each.

        What is given at nodes is the mean of a cell's corners where the points are cells.

        Raises:
            CurrentError: the variable has other dimensions.
        """
        own, series = self.series.dims(name), self.series
        along = self.dims if set(self.dims) <= set(own) else (str(self.corners),)
        dims = (*extra, *along)
        if sorted(own) != sorted(dims):
            raise series.fail(f"{name} has dimensions {', '.join(own)}, not {', '.join(dims)}")
        if along == self.dims:
            return lambda frames, *keys: series.at(frames, name, dict(zip(dims, keys, strict=True)), dims)
        grid = self.geometry
        assert isinstance(grid, Triangles)
        cells = grid.cells
        assert cells is not None

        def means(frames: Any, *keys: Any) -> Array:
            nodes = series.at(frames, name, dict(zip(extra, keys, strict=False)), dims)
            return cell_means(cells, nodes, np.arange(grid.longitude.size)[keys[-1]])

        return means

    @cached_property
    def floor_name(self) -> str | None:
        """The variable with the depth of the sea bed, or None."""
        names = [find_floor(self.series, self.dims)]
        names += [] if self.corners is None else [find_floor(self.series, (self.corners,))]
        return next(filter(None, names), None)

    @cached_property
    def floor(self) -> Read:
        """Depth [1, *points] m of the sea bed below the datum; NaN on land."""
        name = str(self.floor_name)
        read, metres = self.reading(name), self.series.metres(name)

        @once
        def downward(*keys: Any) -> Array:
            depth = read(_FIRST, *keys) * metres * self._downward
            return depth if self.water is None else np.where(self.water(*keys), depth, np.nan)

        return lambda _, *keys: downward(*keys)

    @cached_property
    def _downward(self) -> float:
        """1, or -1 where the sea bed is given as a height: so it says, or it is negative everywhere."""
        name = str(self.floor_name)
        values = self.series.read(name)
        up = self.series.text(name, "positive").lower() == "up" and bool((values < 0.0).any())
        below = np.fmax.reduce(values, axis=None) < 0.0
        return -1.0 if up or below or self.series.standard_name(name) == "altitude" else 1.0

    @cached_property
    def rise_name(self) -> str | None:
        """The variable with the height of the surface, or None."""
        dims = {name: self.series.dims(name) for name in self.series.variables if self.has(name)}
        fitting = [name for name, own in dims.items() if 0 < len(own) <= len(self.dims)]
        named = [name for name in fitting if self.series.standard_name(name) in _SURFACE_NAMES]
        return ([name for name in _SURFACES if name in fitting] + named + [None])[0]

    @cached_property
    def rise(self) -> Read:
        """Height [times or 1, *points] m of the surface above the datum; 0 where it is not given."""
        name = self.rise_name
        if name is None:
            return lambda _, *keys: np.zeros(
                (1, *(len(np.arange(size)[key]) for size, key in zip(self.geometry.shape, keys, strict=True)))
            )
        read, metres = self.reading(name), self.series.metres(name)

        def above(frames: Any, *keys: Any) -> Array:
            rise = np.nan_to_num(read(frames, *keys) * metres)
            if (far := float(np.abs(rise).max(initial=0.0))) > _HIGHEST:
                raise self.series.fail(
                    f"{name} reaches {far:g} m, where there is no sea: check _FillValue and units"
                )
            return rise

        return once(above)

    def masks(self, level: str | None = None) -> list[str]:
        """Return the masks of land at the points, or at the points of all levels."""
        dims = {*self.dims, *([] if level is None else [level])}
        return [
            name
            for name, variable in self.series.variables.items()
            if (name in MASKS or self.series.standard_name(name) in MASK_NAMES) and set(variable.dims) == dims
        ]

    def mask(self, level: str | None = None) -> Callable[..., NDArray[np.bool_]] | None:
        """Return what gives by indices where there is water, as `masks`.

        It is None without a mask, or where it says land everywhere: that was never written.
        """
        for name in self.masks(level):
            # Of many levels the first and the last are enough: one of them is the surface.
            ends = (
                {} if level is None else {level: np.unique([0, self.series.variables[name].sizes[level] - 1])}
            )
            if self._wet(name, self.series.read(name, ends)).any():
                return self._mask(name, () if level is None else (level,))
        return None

    def _mask(self, name: str, extra: Sequence[str]) -> Callable[..., NDArray[np.bool_]]:
        read = self.reading(name, extra)
        return once(lambda *keys: self._wet(name, read(_FIRST, *keys)[0]))

    @cached_property
    def water(self) -> Callable[..., NDArray[np.bool_]] | None:
        """What gives by indices of the points where there is water; None without a mask of land."""
        return self.mask()

    def _wet(self, name: str, values: Array) -> NDArray[np.bool_]:
        """Return where values of a mask say water; shares of cells, as MITgcm gives them, count from 0 on."""
        if self.series.standard_name(name) == "land_binary_mask":
            return np.nan_to_num(values, nan=1.0) < 0.5
        return np.nan_to_num(values) > (0.0 if name == "hFacC" else 0.5)


def to_form(files: Sequence[File]) -> tuple[xr.Dataset, Geometry]:
    """Bring the current of open files to the form.

    Returns:
        The form, of which values are read where they are indexed; and the places of its points.

    Raises:
        CurrentError: one line that names the file, the variable and what is wrong.
    """
    files = unified(files)
    names = find_current(files[0])
    places = _places(files[0], names)
    series, notes = in_order(files, names.east, places or ())
    source = _source(series, names, places, [*notes, *filter(None, [names.note])])
    grid, notes, form = source.geometry, source.notes, source.form
    if isinstance(grid, Curvilinear) and grid.folds:
        raise series.fail(
            f"the grid of {' and '.join(places or ())} folds over itself: they contradict each other"
        )
    if isinstance(grid, Triangles) and grid.overlaps:
        raise series.fail("the cells of the mesh lie over each other: places and connectivity contradict")
    if grid.torn:
        notes.append(
            f"{grid.torn} sides or triangles of the grid are far longer than usual: there are no cells there"
        )
    if (masks := source.masks()) and source.water is None:
        notes.append(f"{masks[0]} says land everywhere: left out")
    _add_current(source, names)
    form |= {name: xr.Variable(dims, values) for name, (dims, values) in grid.coordinates.items()}
    for name, place in zip(("longitude", "latitude"), places or (), strict=False):
        form[name].encoding = {"source": place, "dims": source.dims}
    about = {"dims": series.time_dim, "frames": series.frames[:, 1]}
    form["time"] = xr.Variable("time", series.times, None, about)
    form["file"] = xr.Variable("time", np.array([file.path for file in series.parts])[series.frames[:, 0]])
    for name, variable in form.items():
        variable.attrs = ABOUT.get(name, {})
    if "angle" in form:
        form["angle"].attrs = {"units": "rad"}
        for name, axis in (("uo", "x"), ("vo", "y")):
            form[name].attrs = {"standard_name": f"sea_water_{axis}_velocity", "units": "m s-1"}
    attributes = {**series.attributes, "source": series.path, "notes": tuple(dict.fromkeys(notes))}
    found = xr.Dataset(form, attrs=attributes)
    found.set_close(series.close)
    return found, grid


def _add_current(source: Source, names: Names) -> None:
    """Put velocities, depths, directions, sea bed, surface and mask into the form."""
    series, grid = source.series, source.geometry
    staggered = grid.kind == "roms"
    east = _component(source, names.east, names.both, 0, 1 if staggered else None)
    north = _component(source, names.north, names.both, 1, 0 if staggered else None, east.levels)
    deep = None if east.levels.dim is None else source.mask(east.levels.dim)
    for name, part in (("uo", east), ("vo", north)):
        _add_velocity(source, name, part, deep if staggered else None)
    turn = _turn(source, names, staggered)
    if turn is not None:
        source.add("angle", (), lambda _, *keys: turn(*keys)[None])
    _add_depths(source, "depth", "level", east.levels)
    if (up := find_upward(series)) is not None:
        dims = series.dims(up)
        if set(source.dims) <= set(dims) and len(dims) <= len(source.dims) + 1:
            rising = _component(source, up, None, 0, None)
            same = rising.levels.dim == east.levels.dim
            _add_velocity(source, "wo", rising, None, "level" if same else "level_w")
            if not same:
                _add_depths(source, "depth_w", "level_w", rising.levels)
        else:
            source.notes.append(f"{up} is not given where the level components are: left out")
    if source.floor_name is not None:
        source.add("deptho", (), source.floor, source=source.floor_name)
    if source.rise_name is not None:
        source.add("zos", source.timed(source.rise_name), source.rise, source=source.rise_name)
    _add_masks(source, None if staggered else deep, east.levels)


@dataclass(frozen=True)
class _Component:
    """A velocity component: name and dimensions of its points in the file, levels, and what reads it.

    It is read [times, levels, *points] in the file's order of levels, NaN where it has no valid value; on the
    edges between the points along `edge` of them, where that is not None.
    """

    name: str
    dims: tuple[str, ...]
    levels: Levels
    read: Read
    edge: int | None


def _component(
    source: Source, name: str, both: str | None, which: int, edge: int | None, levels: Levels | None = None
) -> _Component:
    """Return a component, `which` along the dimension `both` of a variable that holds two.

    Its levels must be the other component's, where these are given.
    """
    series, grid = source.series, source.geometry
    dims, sizes = [dim for dim in series.dims(name) if dim != both], series.variables[name].sizes
    own = source.dims if edge is None else tuple(dims[-2:])
    if edge is not None:
        shapes = [sizes[dim] for dim in own], [size - (k == edge) for k, size in enumerate(grid.shape)]
        if shapes[0] != shapes[1]:
            has, fit = (" x ".join(map(str, shape)) for shape in shapes)
            raise series.fail(f"{name} has {has} points, {fit} fit the grid")
    if not set(own) <= set(dims):
        raise series.fail(f"{name} has dimensions {', '.join(dims)}, not those of its longitude and latitude")
    rest = [dim for dim in dims if dim not in own]
    # A dimension of one member, ensemble or the like is no level where another one is left.
    long = [dim for dim in rest if sizes[dim] > 1]
    if len(long) > 1:
        odd = [dim for dim in long if not is_level(series, dim)] or long
        raise series.fail(
            f"{name} has dimensions {' and '.join(long)}, of which one is neither level nor place: take one "
            f"index of it out first, such as by ncks -d {odd[0]},0"
        )
    level = next(iter(long or [dim for dim in rest if is_level(series, dim)]), None)
    fixed = {dim: 0 for dim in rest if dim != level} | ({} if both is None else {both: which})
    decoded = _decoded(source, name)
    found = levels if levels is not None and levels.dim == level else find_levels(source, name, level)
    if levels is not None and levels is not found:
        one, two = levels.fixed, found.fixed
        if one is None or two is None or one.shape != two.shape or not np.allclose(one, two):
            raise series.fail(
                f"{name} has levels along {level}, the other component along {levels.dim}, and they differ"
            )
    axes = own if level is None else (level, *own)

    def read(frames: Any, *keys: Any) -> Array:
        chosen = dict(zip(axes, keys[level is None :], strict=True))
        values = decoded(series.at(frames, name, {**fixed, **chosen}, axes))
        return values[:, None][:, keys[0]] if level is None else values

    return _Component(name, own, found, read, edge)


def _decoded(source: Source, name: str) -> Callable[[Array], Array]:
    """Return what makes values of a component m/s, NaN beyond the stated range."""
    series, variable = source.series, source.series.variables[name]
    units = series.text(name, "units")
    factor, limit = speed_factor(units) if units else 1.0, _FASTEST if units else _FASTEST_UNITLESS
    if not units:
        source.notes.append(f"{name} has no units: taken as m/s")
    if factor is None:
        raise series.fail(
            f"{name} has units {units!r}, which are no speed that is known: if they are m/s, write so, such "
            f"as by ncatted -a units,{name},o,c,'m s-1'"
        )
    low, high = -np.inf, np.inf
    ends = [variable.attrs.get(f"valid_{end}") for end in ("min", "max")]
    try:
        least, most = (float(value) for value in np.ravel(variable.attrs.get("valid_range", ends)))
        # Those of packed values count in the packed unit, or not, as writers please.
        if least < most and not {"scale_factor", "add_offset"} & set(variable.encoding):
            # Fill values lie farther beyond than half the span.
            low, high = least - (most - least) / 2.0, most + (most - least) / 2.0
    except (TypeError, ValueError):
        pass

    def decoded(values: Array) -> Array:
        values = np.where((values < low) | (values > high), np.nan, values) * factor
        fastest = float(np.nanmax(np.abs(values), initial=0.0))
        if fastest >= limit and not units:
            raise series.fail(f"{name} has no units and reaches {fastest:g}: not m/s")
        if fastest >= limit:
            raise series.fail(
                f"{name} reaches {fastest:g} m/s, which is implausible: check units and _FillValue"
            )
        return values

    return decoded


def _add_velocity(
    source: Source, name: str, part: _Component, deep: Callable | None, level: str = "level"
) -> None:
    """Put a component into the form, its levels from the surface down.

    One on edges is brought to the middles; `deep` is where there is water by levels, if that is known.
    """
    source.sizes[level] = part.levels.count
    read = part.read if part.edge is None else _to_middles(source, part, deep)
    known = {"source": part.name, "dims": part.dims, "level": part.levels.dim, "order": part.levels.order}
    source.add(name, ("time", level), read, **known)
    source.turn(name, level, part.levels)


def _to_middles(source: Source, part: _Component, deep: Callable | None) -> Read:
    """Return what reads a component on edges [times, levels, rows, columns] at the middles of the cells.

    They are the means of the edges before and after, or one of them where the other is land.
    """
    axis, shape = part.edge, source.geometry.shape
    assert axis is not None
    count = shape[axis] - 1

    def read(frames: Any, levels: Any, *keys: Any) -> Array:
        index = [np.arange(size)[key] for size, key in zip(shape, keys, strict=True)]
        runs = [slice(int(each.min()), int(each.max()) + 1) for each in index]
        start, stop = runs[axis].start, runs[axis].stop
        edges = [*runs]
        edges[axis] = slice(max(start - 1, 0), min(stop, count))
        values = part.read(frames, levels, *edges)
        wet = source.water if deep is None else partial(deep, levels)
        if wet is not None:
            # Without fill values the walls of land hold zeros, which are no current.
            middles = [*runs]
            middles[axis] = slice(edges[axis].start, edges[axis].stop + 1)
            water = np.moveaxis(wet(*middles), axis - 2, 0)
            values = np.where(np.moveaxis(water[1:] & water[:-1], 0, axis - 2), values, np.nan)
        # The grid's own rim has an edge on one side only.
        pad = [(0, 0)] * 4
        pad[2 + axis] = (int(start == 0), int(stop > count))
        values = _between(np.pad(values, pad, constant_values=np.nan), 2 + axis)
        for k, (each, run) in enumerate(zip(index, runs, strict=True)):
            if len(each) != values.shape[2 + k] or (np.diff(each) < 0).any():
                values = np.take(values, each - run.start, axis=2 + k)
        return values

    return read


def _between(edges: Array, axis: int) -> Array:
    """Means of neighbours along an axis; of one of them where the other is missing."""
    edges = np.moveaxis(edges, axis, -1)
    pair = np.stack([edges[..., :-1], edges[..., 1:]])
    there = np.isfinite(pair)
    count = there.sum(axis=0)
    mean = np.where(there, pair, 0.0).sum(axis=0) / np.maximum(count, 1)
    return np.moveaxis(np.where(count > 0, mean, np.nan), -1, axis)


def _add_depths(source: Source, name: str, level: str, levels: Levels) -> None:
    """Put the depths of levels into the form."""
    if levels.fixed is not None:
        source.form[name] = xr.Variable(level, levels.fixed)
        return
    assert levels.read is not None
    assert levels.bed is not None
    if name == "depth":
        source.add("bed", levels.extra, levels.bed)
    source.add(name, (*levels.extra, level), levels.read)
    source.turn(name, level, levels)


def _add_masks(source: Source, deep: Callable | None, levels: Levels) -> None:
    """Put into the form where there is water by the masks of land, and by those of flats and of levels."""
    water = source.water
    if water is not None:
        source.add("mask", (), lambda _, *keys: water(*keys)[None])
    if deep is not None:
        source.add("wet", ("level",), lambda _, *keys: deep(*keys)[None])
        source.turn("wet", "level", levels)
    named = ((name, dry) for name, dry in _WETTING if name in source.series.variables and source.has(name))
    name, dry = next(named, ("", False))
    if name:
        read = source.reading(name)
        source.add(
            "flats",
            source.timed(name),
            lambda *keys: (np.nan_to_num(read(*keys), nan=float(dry)) > 0.5) != dry,
        )


def _turn(source: Source, names: Names, staggered: bool) -> Callable[..., Array] | None:
    """Return what gives the angle, rad, from east to the first component's axis, or None without one."""
    grid, series, notes, crs = source.geometry, source.series, source.notes, source.crs
    standard = series.standard_name(names.east)
    if not (names.along_grid or staggered):
        return None
    words = [series.text(name, "long_name").lower() for name in (names.east, names.north)]
    if not (standard or staggered) and "eastward" in words[0] and "northward" in words[1]:
        if not isinstance(grid, Regular):
            notes.append(f"{names.east} and {names.north} are eastward and northward by their long_name")
        return None
    named = [name for name in _ANGLES if name in series.variables and source.has(name)]
    if isinstance(grid, Curvilinear) and named:
        radians, read = _radians(source, named[0]), source.reading(named[0])
        return once(lambda *keys: read(_FIRST, *keys)[0] * radians)
    if isinstance(grid, Triangles) and crs is not None:
        return once(lambda key: axes_angle(crs, grid.longitude[key], grid.latitude[key]))
    if not isinstance(grid, Curvilinear) or (not staggered and crs is None and grid.straight):
        if standard:
            notes.append(f"{names.east} and {names.north} are along x and y: taken as east and north")
        return None
    angle = None
    if crs is not None and not staggered:
        angle = axes_angle(crs, grid.longitude, grid.latitude)
        off = np.abs(np.angle(np.exp(1j * (angle - _along_rows(source, staggered)))))
        if not float(np.nanmedian(off)) < _SAME_AXES:
            notes.append(f"the axes of {crs.name} do not follow the places of the grid's points: left out")
            angle = None
    if angle is None and (staggered or "_x_" in standard or standard.startswith("x_")):
        notes.append("angle is not given: the rows of the grid are followed by the places of its points")
        angle = _along_rows(source, staggered)
    if angle is not None:
        return lambda rows, columns: angle[rows][:, columns]
    raise series.fail(
        f"{names.east} and {names.north} may follow the grid's axes: angle, which tells how, is missing, and "
        "so are a grid_mapping and a standard_name of the components: name the model's grid file beside it "
        "in current.files, or write what they are, such as by ncatted -a "
        f"standard_name,{names.east},o,c,eastward_sea_water_velocity"
    )


def _along_rows(source: Source, staggered: bool) -> Array:
    """Return the angle [ny, nx], rad, from east to x, by the places of a grid's points."""
    grid = source.geometry
    across, falling = (False, False) if staggered else _x_axis(source)
    longitude, latitude = (axis.T if across else axis for axis in (grid.longitude, grid.latitude))
    angle = grid_angle(longitude, latitude) + np.pi * falling
    return angle.T if across else angle


def _x_axis(source: Source) -> tuple[bool, bool]:
    """Return whether x runs along a grid's first dimension, not its second, and whether it falls there."""
    for name, variable in source.series.variables.items():
        stated = source.series.standard_name(name) in ("projection_x_coordinate", "grid_longitude")
        fits = variable.ndim == 1 and str(variable.dims[0]) in source.dims and variable.size > 1
        if fits and (stated or source.series.text(name, "axis") == "X"):
            x = source.series.coordinate(name)
            return str(variable.dims[0]) == source.dims[0], bool(x[-1] < x[0])
    first, second = (dim.lower().lstrip("n") for dim in source.dims)
    return first.startswith(("x", "i", "lon")) and second.startswith(("y", "j", "lat")), False


def _radians(source: Source, name: str) -> float:
    """Return the radians in the unit of a variable of angles."""
    far = float(np.nanmax(np.abs(source.series.coordinate(name, missing=True))))
    units = source.series.text(name, "units").lower()
    degrees = units.startswith("deg") or far > 2.0 * np.pi + 1e-6
    if degrees and units.startswith("rad"):
        raise source.series.fail(f"{name} is in radians and reaches {far:g}")
    if not units.startswith(("deg", "rad")):
        what = "degrees" if degrees else "radians"
        source.notes.append(f"{name} has no units: taken as {what}, by its values")
    return float(np.pi / 180.0) if degrees else 1.0


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
    if staggered:
        return found
    try:
        others = find_places(file, names.north)
    except CurrentError:
        return found
    for name, other in zip(found, others, strict=True):
        if name == other:
            continue
        one, two = (file.coordinate(place, missing=True) for place in (name, other))
        if one.shape != two.shape or not np.allclose(one, two, rtol=0.0, atol=1e-6, equal_nan=True):
            raise file.fail(
                f"{names.east} lies at {name} and {names.north} at {other}, which differ: "
                "interpolate both to the middles of the cells first"
            )
    return found


def _source(series: Series, names: Names, places: tuple[str, str] | None, notes: list[str]) -> Source:
    """Return a series with the places of its points."""
    dims = [] if places is None else [tuple(map(str, series.variables[name].dims)) for name in places]
    if places is None or (dims[0] == dims[1] and len(dims[0]) == 1):
        found = find_triangles(series, names.east, places, notes)
        assert found is not None
        mesh, dim, crs = found
        corners = mesh.cells.dim if mesh.cells is not None and mesh.in_cells else None
        return Source(series, mesh, (dim,), notes, crs, corners)
    longitude, latitude, crs = in_degrees(series, places)
    if crs is not None and dims[0] != dims[1]:
        return Source(series, Curvilinear(("y", "x"), longitude, latitude), (*dims[1], *dims[0]), notes, crs)
    if longitude.ndim == 2:
        if dims[0] != dims[1] or min(longitude.shape) < 2:
            raise series.fail(f"{places[0]} and {places[1]} are no grid of rows and columns")
        east, north = (series.variables[name].dims for name in (names.east, names.north))
        edges = east[-2:] != north[-2:] or (places[0] == "lon_rho" and dims[0][-1] not in north[-1:])
        grid = Curvilinear(("y", "x"), longitude, latitude, "roms" if edges else "curvilinear")
        return Source(series, grid, dims[0], notes, crs or find_crs(series, (names.east, *places)))
    if longitude.ndim > 1 or latitude.ndim > 1:
        raise series.fail(f"{places[0]} and {places[1]} have other dimensions than each other")
    for name, axis in zip(places, (np.unwrap(np.atleast_1d(longitude), period=360.0), latitude), strict=True):
        steps = np.diff(np.atleast_1d(axis))
        if len(steps) and not ((steps > 0).all() or (steps < 0).all()):
            raise series.fail(f"{name} neither rises nor falls throughout")
    return Source(series, Regular(longitude, latitude), (dims[1][0], dims[0][0]), notes)
