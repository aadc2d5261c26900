"""Files that belong together as one: parts of one stretch of time, and stretches that follow each other."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from auvplan.io.currents.files import Array, File, Series
from auvplan.io.currents.models import NEMO, on_middles
from auvplan.io.currents.names import find_current, find_places
from auvplan.io.currents.times import decode_times, find_time, stamp
from auvplan.io.currents.triangles import has_cells
from auvplan.ocean.gridded import CurrentError

#: Coordinates that state where a component lies; they must agree among files that are put together.
_PLACES = ("nav_lon", "nav_lat", "longitude", "latitude", "lon", "lat")
#: What levels and directions depend on beside the axes; files of a series must agree on it.
_FIXED = ("h", "hc", "Vtransform", "angle", "mask_rho")


def unified(files: Sequence[File]) -> tuple[File, ...]:
    """Return files each of which has the whole current of its times.

    Components, grid and levels in files of their own are put together: those of one stretch of time by their
    equal times, those without a time with all. Components on the edges of cells (ROMS, NEMO with its mesh
    file, MOM6, MITgcm) are brought to the form of native ROMS: `lon_rho` and `lat_rho` [ny, nx] of the
    cells' middles, components on the edges between them.

    Args:
        files: as opened.

    Raises:
        CurrentError: files that belong together have other times, sizes or places than each other.
    """
    together = list(files) if all(_whole(file) for file in files) else _put_together(files)
    return tuple(on_middles(file) for file in together)


def _whole(file: File) -> bool:
    """Return whether a file has a current and its places."""
    try:
        names = find_current(file)
        dims = [file.variables[name].dims[-2:] for name in (names.east, names.north)]
        staggered = dims[0] != dims[1]
        if staggered or not has_cells(file):
            find_places(file, names.east, staggered)
    except CurrentError:
        return False
    return True


def _put_together(files: Sequence[File]) -> list[File]:
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
        return 2
    except CurrentError as error:
        return int("has no partner" in str(error))


def _times(file: File) -> Array:
    """Return s since 1970 of a file's times."""
    dims = tuple({str(dim) for variable in file.variables.values() for dim in variable.dims})
    try:
        name = find_time(file, dims)
    except CurrentError:
        return np.zeros(0)
    return decode_times(file, name)[0]


def _merged(parts: Sequence[File]) -> File:
    """Return the first file with the variables of others that it lacks.

    Raises:
        CurrentError: a dimension has another length, or a place another value, in one than in another.
    """
    first, *others = parts
    variables: dict[str, xr.Variable] = dict(first.variables)
    sizes = first.sizes
    nemo = all(any(name in part.variables for part in parts) for name in NEMO)
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
                if one.any() and two.any() and not np.allclose(one, two, rtol=0.0, atol=1e-6, equal_nan=True):
                    raise CurrentError(
                        f"{first.path} and {other.path}: {name} differs, as on the edges of cells: name the "
                        "model's mesh file (glamt, gphit) beside them in current.files"
                    )

    def close() -> None:
        for part in parts:
            part.close()

    label = f"{first.path} with {', '.join(Path(part.path).name for part in others)}"
    attributes = {key: value for part in reversed(parts) for key, value in part.attributes.items()}
    return replace(first, path=label, variables=variables, attributes=attributes, close=close)


def in_order(files: Sequence[File], name: str, coordinates: Sequence[str]) -> tuple[Series, list[str]]:
    """Join files of one model run that follow each other in time.

    Args:
        files: in any order.
        name: of a velocity component, whose dimensions tell which is time.
        coordinates: variables that must be the same in all files.

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
        notes += [remark for remark in remarks if remark not in notes]
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
    return Series.of([file for file, _, _ in known], dims.pop(), np.asarray(times), np.asarray(frames)), notes


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
        pair = [file.coordinate(coordinate, missing=True) for file in (first, other)]
        # Packed anew in each file, depths differ by a rounding.
        slack = 1e-6 if coordinate in coordinates else 1e-3 * float(np.nanmax(np.abs(pair[0]), initial=0.0))
        same = pair[0].shape == pair[1].shape and np.allclose(*pair, rtol=0.0, atol=slack, equal_nan=True)
        if not same:
            raise CurrentError(f"{where}: the grids differ in {coordinate}")
