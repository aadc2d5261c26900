"""Brings what models write in files of their own, or cut otherwise, to one file for each stretch of time."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from auvplan.io.currents.names import find_current, find_places
from auvplan.io.currents.opening import File
from auvplan.io.currents.series import Array
from auvplan.io.currents.times import decode_times, find_time
from auvplan.io.currents.triangles import find_cells
from auvplan.ocean.gridded import CurrentError

#: Coordinates that tell where a component lies; they must agree among files that are put together.
_PLACES = ("nav_lon", "nav_lat", "longitude", "latitude", "lon", "lat")


def unified(files: Sequence[File]) -> tuple[File, ...]:
    """Return files each of which tells the whole current of its times.

    Components, grid and levels in files of their own are put together: those of one stretch of time by their
    equal times, those without a time with all. Native ROMS output that was cut by one index range on all
    axes loses the column and row that lie beyond the cells.

    Args:
        files: as opened.

    Raises:
        CurrentError: files that belong together have other times, sizes or places than each other.
    """
    together = list(files) if all(_whole(file) for file in files) else _put_together(files)
    return tuple(_without_spare(file) for file in together)


def _whole(file: File) -> bool:
    """Return whether a file tells a current and its places."""
    try:
        names = find_current(file)
        staggered = _staggered(file, names.east, names.north)
        if staggered or find_cells(file) is None:
            find_places(file, names.east, staggered)
    except CurrentError:
        return False
    return True


def _staggered(file: File, east: str, north: str) -> bool:
    return file.variables[east].dims[-2:] != file.variables[north].dims[-2:]


def _put_together(files: Sequence[File]) -> list[File]:
    kinds: dict[frozenset[str], list[File]] = {}
    for file in files:
        kinds.setdefault(frozenset(file.variables), []).append(file)
    if len(kinds) == 1:
        return list(files)
    times = {file.path: _times(file) for file in files}
    timed = [group for group in kinds.values() if times[group[0].path] is not None]
    fixed = [group[0] for group in kinds.values() if times[group[0].path] is None]
    # A grid file may carry a time of its own that no other shares.
    base = max(timed or [list(files)], key=lambda group: (_components(group[0]), len(group)))
    found = []
    for file in base:
        parts = [file]
        for group in timed:
            if group is base:
                continue
            same = [other for other in group if _equal(times[other.path], times[file.path])]
            if same:
                parts.append(same[0])
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


def _times(file: File) -> Array | None:
    """Return s since 1970 of a file's times, None where it has none."""
    dims = tuple({str(dim) for variable in file.variables.values() for dim in variable.dims})
    try:
        name = find_time(file, dims)
    except CurrentError:
        return None
    return decode_times(file, name)[0]


def _equal(first: Array | None, second: Array | None) -> bool:
    return (
        first is not None
        and second is not None
        and first.shape == second.shape
        and np.allclose(first, second)
    )


def _merged(parts: Sequence[File]) -> File:
    """Return the first file with the variables of others that it lacks.

    Raises:
        CurrentError: a dimension has another length, or a place another value, in one than in another.
    """
    first, *others = parts
    variables: dict[str, xr.Variable] = dict(first.variables)
    sizes = _sizes(first.variables)
    for other in others:
        for dim, size in _sizes(other.variables).items():
            if sizes.setdefault(dim, size) != size:
                raise CurrentError(f"{first.path} and {other.path}: {dim} has {sizes[dim]} and {size} values")
        for name, variable in other.variables.items():
            if name not in variables:
                variables[name] = variable
            elif name in _PLACES and variable.shape == variables[name].shape:
                _require_same_places(first, other, name)

    def close() -> None:
        for part in parts:
            part.close()

    attributes = {key: value for part in reversed(parts) for key, value in part.attributes.items()}
    return replace(first, variables=variables, attributes=attributes, close=close)


def _require_same_places(first: File, other: File, name: str) -> None:
    one, two = (file.coordinate(name, missing=True) for file in (first, other))
    if one.any() and two.any() and not np.allclose(one, two, rtol=0.0, atol=1e-6, equal_nan=True):
        raise CurrentError(
            f"{first.path} and {other.path}: {name} differs: components on the edges of the cells need to be "
            "brought to one place first, such as by cdo or xgcm"
        )


def _sizes(variables: Mapping[str, xr.Variable]) -> dict[str, int]:
    return {str(dim): size for variable in variables.values() for dim, size in variable.sizes.items()}


def _without_spare(file: File) -> File:
    """Return a native ROMS file without the last edges east and north, where it has as many as points."""
    rho = file.variables.get("lon_rho")
    try:
        names = find_current(file)
    except CurrentError:
        return file
    if rho is None or rho.ndim != 2 or not _staggered(file, names.east, names.north):
        return file
    variables = dict(file.variables)
    for name, axis in ((names.east, -1), (names.north, -2)):
        edges = variables[name]
        if edges.shape[-2:] == rho.shape:
            spare = {edges.dims[axis]: slice(0, -1)}
            for other, variable in variables.items():
                if edges.dims[axis] in variable.dims:
                    variables[other] = variable.isel(spare)
    return replace(file, variables=variables)
