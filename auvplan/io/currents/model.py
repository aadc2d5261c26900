"""A model's current: which variables it is, at which places and levels, and what is read of some of them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from scipy.sparse import csr_array

from auvplan.io.currents.files import Array, File, Pick, Series, same_values
from auvplan.io.currents.geometry import Curvilinear, Index, Regular, Window, mix
from auvplan.io.currents.levels import Levels, at_depth, find_levels
from auvplan.io.currents.names import (
    MASK_NAMES,
    MASKS,
    UPWARD,
    Names,
    find_current,
    find_floor,
    find_places,
    is_level,
    require_field,
)
from auvplan.io.currents.projection import axes_angle, find_crs, grid_angle, in_degrees
from auvplan.io.currents.series import in_order, on_middles, put_together
from auvplan.io.currents.triangles import Geometry, Triangles, cell_means, find_triangles
from auvplan.io.currents.units import speed_factor
from auvplan.ocean.gridded import CurrentError
from auvplan.runtime.arrays import turned

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


@dataclass(frozen=True)
class Source:
    """A series of files, the places of its points, and what is known there beside the current."""

    series: Series
    geometry: Geometry
    dims: tuple[str, ...]  # the files' own dimensions of the points
    places: tuple[str, str] | None  # variables of the points' longitude and latitude, if there are any
    notes: list[str]  # get what has to be assumed
    crs: CRS | None = None  # the projection that the coordinates of the places count along; None for degrees
    corners: str | None = None  # the dimension of the cells' corners, where the points are the cells' middles

    @property
    def staggered(self) -> bool:
        """Whether the components lie on the edges of cells, as on the C-grid of ROMS."""
        return self.geometry.kind == "roms"

    def has(self, name: str) -> bool:
        """Return whether a variable is given at the points, or at the corners of their cells."""
        dims = self.series.dims(name)
        return set(self.dims) <= set(dims) or self.corners in dims

    def along(self, name: str, *extra: str) -> tuple[str, ...]:
        """Return the dimensions of a variable at the points or corners, those of the points last.

        Raises:
            CurrentError: the variable has other dimensions than these and `extra`.
        """
        own = self.series.dims(name)
        dims = (*extra, *(self.dims if set(self.dims) <= set(own) else (str(self.corners),)))
        if sorted(own) != sorted(dims):
            raise self.series.fail(f"{name} has dimensions {', '.join(own)}, not {', '.join(dims)}")
        return dims

    @cached_property
    def floor_name(self) -> str | None:
        """The variable with the depth of the sea bed, or None."""
        names = [find_floor(self.series, self.dims)]
        names += [] if self.corners is None else [find_floor(self.series, (self.corners,))]
        return next(filter(None, names), None)

    @cached_property
    def downward(self) -> float:
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

    def masks(self, *level: str) -> Iterator[str]:
        """Yield the masks of land at the points, or at the points of all levels."""
        for name, variable in self.series.variables.items():
            known = name in MASKS or self.series.standard_name(name) in MASK_NAMES
            if known and set(variable.dims) == {*self.dims, *level}:
                yield name

    def mask(self, *level: str) -> str | None:
        """Return the first such mask that does not say land everywhere: that was never written."""
        # Of many levels the first and the last are enough: one of them is the surface.
        for name in self.masks(*level):
            sizes = self.series.variables[name].sizes
            ends = {dim: np.unique([0, sizes[dim] - 1]) for dim in level}
            if self.wet(name, self.series.read(name, ends)).any():
                return name
        return None

    def wet(self, name: str, values: Array) -> NDArray[np.bool_]:
        """Return where values of a mask say water; shares of cells, as MITgcm gives them, count from 0 on."""
        if self.series.standard_name(name) == "land_binary_mask":
            return np.nan_to_num(values, nan=1.0) < 0.5
        return np.nan_to_num(values) > (0.0 if name == "hFacC" else 0.5)


@dataclass(frozen=True)
class Component:
    """A velocity component."""

    name: str
    dims: tuple[str, ...]  # of its points
    fixed: dict[str, Pick]  # the index of other dimensions
    levels: Levels
    decoded: Callable[[Array], Array]  # values as m/s, NaN beyond the stated range
    #: Along which dimension of the points it lies between them, on edges of cells; None: on them.
    edge: int | None


@dataclass(frozen=True)
class Model:
    """The current of a source."""

    source: Source
    east: Component  # or along axes turned by `angle`
    north: Component
    up: Component | None
    land: str | None  # mask of land
    deep: str | None  # the same by levels
    flats: tuple[str, bool] | None  # mask of flats that fall dry, and whether 1 is dry
    angle: "Callable[[Part], Array] | None"  # [P] rad from east to the first component, counter-clockwise


@dataclass(frozen=True)
class Block:
    """What is read of some times and points, T times, K levels, P points."""

    east: Array  # [T, K, P] m/s; both NaN where there is no water
    north: Array
    depths: Array  # [1 or T, K, 1 or P] m below the surface, rising
    floor: Array | None  # [1 or T, P] m, the sea bed below the surface; None where it is not known
    up: Array | None  # [T, Ku, P] m/s, or None
    depths_up: Array  # [1 or T, Ku, 1 or P] m, those of `up`

    def at(self, depth: Array, weights: csr_array | Array, corners: Index | None = None) -> Array:
        """[3, T, M] m/s east, north and up at depths, NaN where there is no water.

        Args:
            depth: [1] m, of all places; or [M], with corners.
            weights: [M, P] of the points that make up each place; or [M, C], of its corners alone.
            corners: [M, C] points, of a block of one time.
        """

        def column(field: Array) -> Array:
            if corners is None or field.shape[-1] != self.east.shape[-1]:
                return field
            return field[..., corners.ravel()]

        def mixed(fields: tuple[Array, ...], depths: Array) -> tuple[Array, ...]:
            floor = None if self.floor is None else column(self.floor)
            found = at_depth(tuple(map(column, fields)), column(depths), deep, floor)
            return mix(
                weights, *(found if corners is None else (level.reshape(corners.shape) for level in found))
            )

        deep = depth if corners is None else np.repeat(depth, corners.shape[1])
        east, north = mixed((self.east, self.north), self.depths)
        up = np.full_like(east, np.nan)
        if self.up is not None:
            up = np.where(np.isnan(east), np.nan, mixed((self.up,), self.depths_up)[0])
        return np.stack([east, north, up])


@dataclass(frozen=True)
class Part:
    """Some times and points of a model's current, each variable of which is read once."""

    model: Model
    frames: slice
    window: Window

    def values(self, name: str, *extra: str) -> Array:
        """Return a variable [T or 1, *extra, P]; the mean of a cell's nodes where it is given at these."""
        source = self.model.source
        dims = source.along(name, *extra)
        if dims[len(extra) :] == source.dims:
            chosen = dict(zip(source.dims, self.window.picks.values(), strict=True))
            values = source.series.at(self.frames, name, chosen, dims)
            return values.reshape(*values.shape[: len(dims) - len(source.dims) + 1], -1)
        assert isinstance(source.geometry, Triangles)
        assert source.geometry.cells is not None
        corners = source.series.at(self.frames, name, {}, dims)
        return cell_means(source.geometry.cells, corners, self.window.used)

    @cached_property
    def water(self) -> NDArray[np.bool_] | None:
        """[P], where there is water; None without a mask of land."""
        name = self.model.land
        return None if name is None else self.model.source.wet(name, self.values(name)[0])

    @cached_property
    def deep(self) -> NDArray[np.bool_] | None:
        """[K, P], where there is water, by the file's levels; None without a mask of levels."""
        name, level = self.model.deep, str(self.model.east.levels.dim)
        return None if name is None else self.model.source.wet(name, self.values(name, level)[0])

    @cached_property
    def floor(self) -> Array:
        """[1, P] m, the sea bed below the datum; NaN on land."""
        source = self.model.source
        name = str(source.floor_name)
        depth = self.values(name) * source.series.metres(name) * source.downward
        return depth if self.water is None else np.where(self.water, depth, np.nan)

    @cached_property
    def rise(self) -> Array:
        """[T or 1, P] m, the surface above the datum; 0 where it is not given."""
        name, series = self.model.source.rise_name, self.model.source.series
        if name is None:
            return np.zeros((1, len(self.window.used)))
        rise = np.nan_to_num(self.values(name) * series.metres(name))
        if (far := float(np.abs(rise).max(initial=0.0))) > _HIGHEST:
            raise series.fail(f"{name} reaches {far:g} m, where there is no sea: check _FillValue and units")
        return rise

    @cached_property
    def block(self) -> Block:
        """The current, with everything that says where there is water."""
        model, source = self.model, self.model.source
        levels = model.east.levels
        east, north = self._velocity(model.east), self._velocity(model.north)
        land = ~(np.isfinite(east) & np.isfinite(north))
        if self.water is not None:
            land |= ~self.water
        if self.deep is not None and not source.staggered:
            land |= ~self.deep[levels.order]
        if model.flats is not None:
            name, dry = model.flats
            land |= ((np.nan_to_num(self.values(name), nan=float(dry)) > 0.5) == dry)[:, None]
        if model.angle is not None:
            east, north = turned(east, north, model.angle(self))
        depths, floor = levels.at(self)
        if floor is None and source.floor_name is not None:
            floor = self.floor
            # Models without a fill value leave the levels below the bed at zero.
            land |= (east == 0.0) & (north == 0.0) & (depths > floor[:, None])
        up, depths_up = None, depths
        if model.up is not None:
            up = self._velocity(model.up)
            depths_up = depths if model.up.levels.dim == levels.dim else model.up.levels.at(self)[0]
        east, north = (np.where(land, np.nan, values) for values in (east, north))
        return Block(east, north, depths, floor, up, depths_up)

    def _velocity(self, component: Component) -> Array:
        """[T, K, P] m/s of a component at the points, its levels from the surface down."""
        on_edges = component.edge is not None
        values = self._between_edges(component) if on_edges else self._read(component, self.window.picks)
        return values[:, component.levels.order].reshape(*values.shape[:2], -1)

    def _read(self, component: Component, picks: Mapping[str, Pick]) -> Array:
        """[T, K, *points] of a component where it lies, in the file's order of levels."""
        level = () if component.levels.dim is None else (component.levels.dim,)
        chosen = component.fixed | dict(zip(component.dims, picks.values(), strict=True))
        values = self.model.source.series.at(self.frames, component.name, chosen, (*level, *component.dims))
        values = component.decoded(values)
        return values if level else values[:, None]

    def _between_edges(self, component: Component) -> Array:
        """[T, K, rows, columns] of a component on edges: the means of those before and after each point.

        Where one of them is land, it is the other.
        """
        axis, grid = component.edge, self.model.source.geometry
        assert axis is not None
        width, count, dim = grid.shape[1], grid.shape[axis] - 1, grid.dims[axis]
        ends = np.stack(np.divmod(self.window.used[[0, -1]], width))
        first, last = ends[axis].tolist()
        ends[axis] = max(first - 1, 0), min(last + 1, count)
        beside = replace(self, window=grid.window(ends[0] * width + ends[1]))
        values = self._read(component, beside.window.picks | {dim: slice(*ends[axis].tolist())})
        wet = beside.water if beside.deep is None else beside.deep
        if wet is not None:
            # Without fill values the walls of land hold zeros, which are no current.
            water = np.moveaxis(wet.reshape(*wet.shape[:-1], *(ends[:, 1] - ends[:, 0] + 1)), axis - 2, 0)
            values = np.where(np.moveaxis(water[1:] & water[:-1], 0, axis - 2), values, np.nan)
        # The grid's own rim has an edge on one side only.
        pad = [(0, 0)] * 4
        pad[2 + axis] = (int(first == 0), int(last == count))
        edges = np.moveaxis(np.pad(values, pad, constant_values=np.nan), 2 + axis, -1)
        pair = np.stack([edges[..., :-1], edges[..., 1:]])
        there = np.isfinite(pair)
        known = there.sum(axis=0)
        mean = np.where(there, pair, 0.0).sum(axis=0) / np.maximum(known, 1)
        return np.moveaxis(np.where(known > 0, mean, np.nan), -1, 2 + axis)


def find_model(files: Sequence[File]) -> Model:
    """Return the current of open files.

    Raises:
        CurrentError: one line that names the file, the variable and what is wrong.
    """
    files = put_together(files)
    names = find_current(files[0])
    files = [on_middles(file, names) for file in files]
    places = _places(files[0], names)
    series, notes = in_order(files, names.east, places or ())
    source = _source(series, names, places, [*notes, *filter(None, [names.note])])
    grid, notes = source.geometry, source.notes
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
    if (land := source.mask()) is None:
        notes += [f"{name} says land everywhere: left out" for name in [*source.masks()][:1]]
    both: list[dict[str, Pick]] = [{} if names.both is None else {names.both: k} for k in range(2)]
    edges = (1, 0) if source.staggered else (None, None)
    east = _component(source, names.east, both[0], edges[0])
    north = _component(source, names.north, both[1], edges[1], east.levels)
    deep = None if east.levels.dim is None else source.mask(east.levels.dim)
    angle = _angle(source, names)
    named = [name for name in series.variables if series.standard_name(name) == "upward_sea_water_velocity"]
    plain = [name for name in UPWARD if name in series.variables and not series.standard_name(name)]
    rising = None
    for up in [*named, *plain][:1]:
        dims = series.dims(up)
        if set(source.dims) <= set(dims) and len(dims) <= len(source.dims) + 1:
            rising = _component(source, up, {}, None)
        else:
            notes.append(f"{up} is not given where the level components are: left out")
    flats = next((pair for pair in _WETTING if pair[0] in series.variables and source.has(pair[0])), None)
    for name in filter(None, (source.floor_name, source.rise_name)):
        source.along(name)
        series.metres(name)
    if flats is not None:
        source.along(flats[0])
    return Model(source, east, north, rising, land, deep, flats, angle)


def _component(
    source: Source, name: str, fixed: dict[str, Pick], edge: int | None, levels: Levels | None = None
) -> Component:
    """Return a component at an index of other dimensions; its levels must be those that are given."""
    series = source.series
    dims, sizes = [dim for dim in series.dims(name) if dim not in fixed], series.variables[name].sizes
    own = source.dims if edge is None else tuple(dims[-2:])
    if edge is not None:
        shapes = (
            [sizes[dim] for dim in own],
            [size - (k == edge) for k, size in enumerate(source.geometry.shape)],
        )
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
    fixed = {dim: 0 for dim in rest if dim != level} | fixed
    decoded = _decoded(source, name)
    found = levels if levels is not None and levels.dim == level else find_levels(source, name, level)
    if levels is not None and levels is not found:
        one, two = levels.fixed, found.fixed
        if one is None or two is None or one.shape != two.shape or not np.allclose(one, two):
            raise series.fail(
                f"{name} has levels along {level}, the other component along {levels.dim}, and they differ"
            )
    return Component(name, own, fixed, found, decoded, edge)


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


def _angle(source: Source, names: Names) -> Callable[[Part], Array] | None:
    """Return what gives the angle [P], rad, from east to the first component's axis, or None without one."""
    grid, series, notes, crs = source.geometry, source.series, source.notes, source.crs
    standard = series.standard_name(names.east)
    if not (names.along_grid or source.staggered):
        return None
    words = [series.text(name, "long_name").lower() for name in (names.east, names.north)]
    if not (standard or source.staggered) and "eastward" in words[0] and "northward" in words[1]:
        if not isinstance(grid, Regular):
            notes.append(f"{names.east} and {names.north} are eastward and northward by their long_name")
        return None
    named = next((name for name in _ANGLES if name in series.variables and source.has(name)), None)
    if isinstance(grid, Curvilinear) and named is not None:
        far = float(np.nanmax(np.abs(series.coordinate(named, missing=True))))
        units, degrees = series.text(named, "units").lower(), far > 2.0 * np.pi + 1e-6
        if degrees and units.startswith("rad"):
            raise series.fail(f"{named} is in radians and reaches {far:g}")
        degrees |= units.startswith("deg")
        if not units.startswith(("deg", "rad")):
            what = "degrees" if degrees else "radians"
            notes.append(f"{named} has no units: taken as {what}, by its values")
        radians, _ = float(np.pi / 180.0) if degrees else 1.0, source.along(named)
        return lambda part: replace(part, frames=slice(0, 1)).values(named)[0] * radians
    if isinstance(grid, Triangles) and crs is not None:
        return lambda part: axes_angle(crs, *grid.places(part.window.used))
    if not isinstance(grid, Curvilinear) or (not source.staggered and crs is None and grid.straight):
        if standard:
            notes.append(f"{names.east} and {names.north} are along x and y: taken as east and north")
        return None
    angle = None
    if crs is not None and not source.staggered:
        angle = axes_angle(crs, grid.longitude, grid.latitude)
        off = np.abs(np.angle(np.exp(1j * (angle - _along_rows(source)))))
        if not float(np.nanmedian(off)) < _SAME_AXES:
            notes.append(f"the axes of {crs.name} do not follow the places of the grid's points: left out")
            angle = None
    if angle is None and (source.staggered or "_x_" in standard or standard.startswith("x_")):
        notes.append("angle is not given: the rows of the grid are followed by the places of its points")
        angle = _along_rows(source)
    if angle is not None:
        return lambda part: angle.ravel()[part.window.used]
    raise series.fail(
        f"{names.east} and {names.north} may follow the grid's axes: angle, which gives how, is missing, and "
        "so are a grid_mapping and a standard_name of the components: name the model's grid file beside it "
        "in current.files, or write what they are, such as by ncatted -a "
        f"standard_name,{names.east},o,c,eastward_sea_water_velocity"
    )


def _along_rows(source: Source) -> Array:
    """Return the angle [ny, nx], rad, from east to x, by the places of a grid's points."""
    across, falling = (False, False) if source.staggered else _x_axis(source)
    longitude, latitude = (
        axis.T if across else axis for axis in (source.geometry.longitude, source.geometry.latitude)
    )
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
        if not same_values(one, two):
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
        return Source(series, mesh, (dim,), places, notes, crs, corners)
    longitude, latitude, crs = in_degrees(series, places)
    if crs is not None and dims[0] != dims[1]:
        return Source(series, Curvilinear(longitude, latitude), (*dims[1], *dims[0]), places, notes, crs)
    if longitude.ndim == 2:
        if dims[0] != dims[1] or min(longitude.shape) < 2:
            raise series.fail(f"{places[0]} and {places[1]} are no grid of rows and columns")
        east, north = (series.variables[name].dims for name in (names.east, names.north))
        edges = east[-2:] != north[-2:] or (places[0] == "lon_rho" and dims[0][-1] not in north[-1:])
        grid = Curvilinear(longitude, latitude, "roms" if edges else "curvilinear")
        crs = crs or find_crs(series, (names.east, *places))
        return Source(series, grid, dims[0], places, notes, crs)
    if longitude.ndim > 1 or latitude.ndim > 1:
        raise series.fail(f"{places[0]} and {places[1]} have other dimensions than each other")
    for name, axis in zip(places, (np.unwrap(np.atleast_1d(longitude), period=360.0), latitude), strict=True):
        steps = np.diff(np.atleast_1d(axis))
        if len(steps) and not ((steps > 0).all() or (steps < 0).all()):
            raise series.fail(f"{name} neither rises nor falls throughout")
    return Source(series, Regular(longitude, latitude), (dims[1][0], dims[0][0]), places, notes)
