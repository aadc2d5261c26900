"""Files that belong together as one: parts of one time, times that follow, C-grids."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from auvplan.io.currents.files import Array, File, Series, close_all, same_values
from auvplan.io.currents.names import Names, PartnerMissing, find_current, find_places
from auvplan.io.currents.times import decode_times, find_time, stamp, to_middles
from auvplan.io.currents.triangles import connectivity
from auvplan.ocean.gridded import CurrentError

#: Coordinates that state where a component lies; they must agree among files that are put together.
_PLACES = ("nav_lon", "nav_lat", "longitude", "latitude", "lon", "lat")
#: What levels and directions depend on beside the axes; files of a series must agree on it.
_FIXED = ("h", "hc", "Vtransform", "angle", "mask_rho")
#: The middles of NEMO's cells.
_NEMO = ("glamt", "gphit")


def _whole(file: File) -> bool:
    """Return whether a file has a current and its places."""
    try:
        names = find_current(file)
        staggered = file.variables[names.east].dims[-2:] != file.variables[names.north].dims[-2:]
        if staggered or connectivity(file) is None:
            find_places(file, names.east, staggered)
    except CurrentError:
        return False
    return True


def put_together(files: Sequence[File]) -> list[File]:
    """Return files each of which has the whole current of its times.

    Components, grid and levels in files of their own are put together: those of one stretch of time by their
    equal times, those without a time with all.

    Raises:
        CurrentError: files that belong together have other times, sizes or places than each other.
    """
    if all(_whole(file) for file in files):
        return list(files)
    kinds: dict[frozenset[str], list[File]] = {}
    for file in files:
        kinds.setdefault(frozenset(file.variables), []).append(file)
    if len(kinds) == 1:
        return list(files)
    times = {file.path: _times(file) for file in files}
    timed = [group for group in kinds.values() if len(times[group[0].path])]
    fixed = [group[0] for group in kinds.values() if not len(times[group[0].path])]
    # A grid file may carry a time of its own that no other shares.
    base = max(timed or [list(files)], key=lambda group: (_components(group[0]), len(group)))
    found = []
    for file in base:
        parts = [file]
        for group in timed:
            if group is base:
                continue
            own = times[file.path]
            same = (other for other in group if times[other.path].shape == own.shape)
            equal = [other for other in same if np.allclose(times[other.path], own)]
            if equal:
                parts.append(equal[0])
            elif len(group) == 1 and not _components(group[0]):
                fixed.append(group[0])
            else:
                raise CurrentError(
                    f"{file.path} and {group[0].path}: hold parts of one current, but at other times"
                )
        found.append(_merged([*parts, *fixed]))
    return found


def _components(file: File) -> int:
    """Return 2 for a file with both components, 1 with one of them, 0 without."""
    try:
        find_current(file)
    except CurrentError as error:
        return int(isinstance(error, PartnerMissing))
    return 2


def _times(file: File) -> Array:
    """Return s since 1970 of a file's times; none where it has none."""
    try:
        name = find_time(file, tuple(file.sizes))
    except CurrentError:
        return np.zeros(0)
    return decode_times(file, name)[0]


def _merged(parts: Sequence[File]) -> File:
    """Return the first file with what it lacks of others, which must have its sizes and places."""
    first, *others = parts
    variables: dict[str, xr.Variable] = dict(first.variables)
    sizes = first.sizes
    nemo = all(any(name in part.variables for part in parts) for name in _NEMO)
    for other in others:
        for dim, size in other.sizes.items():
            if sizes.setdefault(dim, size) != size and size > 1:
                raise CurrentError(f"{first.path} and {other.path}: {dim} has {sizes[dim]} and {size} values")
        for name, variable in other.variables.items():
            if name not in variables:
                # A grid of one time belongs to all times.
                once = {dim: 0 for dim, size in variable.sizes.items() if size < sizes[str(dim)]}
                variables[name] = variable.isel(once)
            elif name in _PLACES and variable.shape == variables[name].shape and not nemo:
                one, two = (file.coordinate(name, missing=True) for file in (first, other))
                if one.any() and two.any() and not same_values(one, two):
                    raise CurrentError(
                        f"{first.path} and {other.path}: {name} differs, as on the edges of cells: name the "
                        "model's mesh file (glamt, gphit) beside them in current.files"
                    )

    label = f"{first.path} with {', '.join(Path(part.path).name for part in others)}"
    attributes = {key: value for part in reversed(parts) for key, value in part.attributes.items()}
    close = partial(close_all, parts)
    return replace(first, path=label, variables=variables, attributes=attributes, close=close)


def on_middles(file: File, names: Names) -> File:
    """Return a file with components on the edges of cells in the form of native ROMS; others as they are.

    Those of NEMO with its mesh file, of MOM6 and of MITgcm are brought to it: `lon_rho` and `lat_rho` [ny,
    nx] of the cells' middles, components on the edges between them.

    Raises:
        CurrentError: edges and middles do not fit each other.
    """
    if names.both is not None or not {names.east, names.north} <= file.variables.keys():
        return file
    east, north = (tuple(map(str, file.variables[name].dims)) for name in (names.east, names.north))
    same = east[-2:] == north[-2:]
    if "lon_rho" in file.variables and not same:
        # Edges beyond the last points may be given too.
        shape = file.variables["lon_rho"].shape
        for name, dim in ((names.east, east[-1]), (names.north, north[-2])):
            if len(shape) == 2 and file.variables[name].shape[-2:] == shape:
                file = _cut(file, {dim: slice(0, -1)})
        return file
    if same and all(name in file.variables for name in _NEMO):
        return _nemo(file, names.east, names.north)
    if len(east) > 2 and len(north) > 2 and not set(east[-2:]) & set(north[-2:]):
        return _between_middles(file, names.east, names.north)
    return file


def _cut(file: File, picks: dict[str, slice], *names: str) -> File:
    """Return a file with parts of some dimensions, of the variables that are named or all."""
    cut = {
        name: variable.isel({dim: pick for dim, pick in picks.items() if dim in variable.dims})
        for name, variable in file.variables.items()
        if name in names or not names
    }
    return replace(file, variables={**file.variables, **cut})


def _nemo(file: File, east: str, north: str) -> File:
    """Return NEMO's C-grid, whose components lie east and north of the middle with the same index."""
    variables = dict(file.variables)
    dims = variables[east].dims[-2:]
    places = {"lon_rho": "glamt", "lat_rho": "gphit", "mask_rho": "tmask"}
    for own, name in places.items():
        if name in variables:
            flat = variables[name].isel({dim: 0 for dim in variables[name].dims if dim not in dims})
            if flat.dims == dims:
                variables[own] = flat
    mask, level = variables.get("tmask"), variables[east].dims[-3]
    if mask is not None and mask.ndim > 2 and mask.shape[-3] == variables[east].shape[-3]:
        variables["tmask"] = deep = mask.isel(dict.fromkeys(mask.dims[:-3], 0))
        deep.dims = (level, *deep.dims[1:])
    for name, edge, axis in ((east, "u", 1), (north, "v", 0)):
        variables[name] = edges = variables[name].isel({dims[axis]: slice(0, -1)})
        edges.dims = (*edges.dims[:-2], *(f"{dim}_{edge}" for dim in dims))
    for name in ("nav_lon", "nav_lat"):
        variables.pop(name, None)
    return replace(file, variables=variables)


def _between_middles(file: File, east: str, north: str) -> File:
    """Return a C-grid whose edges and middles have dimensions of their own, as MOM6 and MITgcm write them."""
    (*_, rows, u_edges), (*_, v_edges, columns) = (
        map(str, file.variables[name].dims) for name in (east, north)
    )
    names = ("geolon", "geolat"), ("XC", "YC"), ("lon", "lat"), ("longitude", "latitude"), (columns, rows)
    for pair in names:
        if not all(name in file.variables for name in pair):
            continue
        dims = [file.variables[name].dims for name in pair]
        longitude, latitude = (file.coordinate(name, missing=True) for name in pair)
        if dims == [(columns,), (rows,)]:
            longitude, latitude = np.meshgrid(longitude, latitude)
        elif dims != [(rows, columns), (rows, columns)]:
            continue
        for name, dim, middle, count in (
            (east, u_edges, columns, longitude.shape[1]),
            (north, v_edges, rows, len(longitude)),
        ):
            first = _first_edge(file, dim, middle, file.variables[name].sizes[dim], count)
            file = _cut(file, {dim: slice(first, first + count - 1)}, name)
        places = {"lon_rho": longitude, "lat_rho": latitude}
        made = {name: xr.Variable((rows, columns), values) for name, values in places.items()}
        return replace(file, variables={**file.variables, **made})
    return file


def _first_edge(file: File, edges: str, middles: str, size: int, count: int) -> int:
    """Return the index of the edge between the first two of `count` middles among `size` edges."""
    if size == count - 1:
        return 0
    if size == count + 1:
        return 1
    if all(name in file.variables and file.variables[name].ndim == 1 for name in (edges, middles)):
        edge, middle = file.coordinate(edges), file.coordinate(middles)
        share = (edge[0] - middle[0]) / (middle[1] - middle[0])
        if size == count and abs(abs(share) - 0.5) < 0.25:
            return int(share < 0.0)
    raise file.fail(f"{size} edges along {edges} do not fit {count} middles along {middles}")


def in_order(files: Sequence[File], name: str, coordinates: Sequence[str]) -> tuple[Series, list[str]]:
    """Join files of one run, with velocity component `name`, the same coordinates, and times in order.

    Returns:
        The files as one, with `times`; what is given twice is taken from the earlier file. And notes.

    Raises:
        CurrentError: files overlap, or have other variables or another grid than the first.
    """
    known, notes = [], []
    for file in files:
        if name not in file.variables:
            raise file.fail(f"has no {name}, which {files[0].path} has")
        time = find_time(file, tuple(map(str, file.variables[name].dims)))
        seconds, remarks = decode_times(file, time)
        seconds, more = to_middles(file, time, name, seconds)
        notes += [remark for remark in (*remarks, *more) if remark not in notes]
        dims = file.variables[time].dims
        known.append((file, str(dims[0]) if dims else None, seconds))
        _require_same_grid(files[0], file, name, coordinates, known[-1][1])
    known.sort(key=lambda entry: (entry[2][0], entry[2][-1]))
    dims = {dim for _, dim, _ in known}
    if len(dims) > 1 or (len(known) > 1 and dims == {None}):
        raise files[0].fail("files of a series need the same dimension of time")
    times: list[float] = []
    frames: list[tuple[int, int]] = []
    for number, (file, _, seconds) in enumerate(known):
        stated = set(times)
        new = [index for index, second in enumerate(seconds) if second not in stated]
        if times and new and seconds[new[0]] < times[-1]:
            raise file.fail(
                f"its times overlap those of {known[number - 1][0].path}, "
                f"{stamp(seconds[new[0]])} lies before {stamp(times[-1])}"
            )
        for index in new:
            if not times or seconds[index] != times[-1]:
                times.append(float(seconds[index]))
                frames.append((number, index))
    if dropped := sum(len(seconds) for _, _, seconds in known) - len(times):
        notes.append(f"{dropped} times are given twice; the first is used")
    first, *others = parts = tuple(file for file, _, _ in known)
    label = f"{first.path} and {len(others)} more" if others else first.path
    about = label, first.variables, first.attributes, partial(close_all, parts), first.crs, first.epoch
    return Series(*about, dims.pop(), np.asarray(times), np.asarray(frames), parts), notes


def _require_same_grid(
    first: File, other: File, name: str, coordinates: Sequence[str], time_dim: str | None
) -> None:
    if first is other:
        return
    where = f"{other.path} and {Path(first.path).name}"
    if first.variables[name].dims != other.variables[name].dims:
        raise CurrentError(f"{where}: {name} has other dimensions")
    for shared in set(first.variables) & set(other.variables):
        one, two = first.variables[shared], other.variables[shared]
        if one.dtype.kind not in "iuf" or time_dim not in one.dims or one.dims == (time_dim,):
            continue
        if {**one.sizes, time_dim: 0} != {**two.sizes, time_dim: 0}:
            raise CurrentError(f"{where}: {shared} has other dimensions")
        units = [file.text(shared, "units") for file in (other, first)]
        if units[0] != units[1]:
            raise CurrentError(
                f"{where}: {shared} is in {units[0]!r} and in {units[1]!r}, which must be one unit"
            )
    levels = {dim for dim in first.variables[name].dims[:-1] if dim != time_dim}
    fixed = dict.fromkeys(coordinates)
    for axis, stated in first.variables.items():
        wanted = axis in _FIXED or (stated.ndim == 1 and stated.dims[0] in levels)
        if wanted and stated.dtype.kind in "iuf" and time_dim not in stated.dims:
            fixed[axis] = None
    for coordinate in fixed:
        if coordinate not in other.variables:
            raise CurrentError(f"{other.path}: has no {coordinate}, which {first.path} has")
        one, two = (file.coordinate(coordinate, missing=True) for file in (first, other))
        # Packed in each file by itself, depths differ by a rounding.
        slack = 1e-6 if coordinate in coordinates else 1e-3 * float(np.nanmax(np.abs(one), initial=0.0))
        if not same_values(one, two, slack):
            raise CurrentError(f"{where}: the grids differ in {coordinate}")
