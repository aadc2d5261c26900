"""Files that follow each other in time, as one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from auvplan.io.currents.opening import File, Pick, text
from auvplan.io.currents.times import decode_times, find_time, stamp
from auvplan.ocean.gridded import CurrentError

Array = NDArray[np.float64]

#: What levels and directions depend on beside the axes; files of a series must agree on it.
_FIXED = ("h", "hc", "Vtransform", "angle", "mask_rho")


@dataclass(frozen=True)
class Series:
    """Files of one model run with the same variables on the same grid, in order of time.

    Attributes:
        files: in order of time.
        time_dim: the dimension of time; None where the files have one time and no such dimension.
        times: [T] s since 1970, rising strictly.
        frames: [T, 2], the file of each time and the index in it.
        notes: assumptions made.
    """

    files: tuple[File, ...]
    time_dim: str | None
    times: Array
    frames: NDArray[np.int64]
    notes: tuple[str, ...]

    @cached_property
    def label(self) -> str:
        """The files' name for messages."""
        first, *rest = self.files
        return f"{first.path} and {len(rest)} more" if rest else first.path

    @property
    def variables(self) -> Mapping[str, xr.Variable]:
        """Of the first file; all have the same."""
        return self.files[0].variables

    @property
    def attributes(self) -> Mapping[str, Any]:
        """Of the first file as a whole."""
        return self.files[0].attributes

    def attrs(self, name: str) -> Mapping[str, Any]:
        """Attributes of a variable."""
        return self.variables[name].attrs

    def dims(self, name: str) -> tuple[str, ...]:
        """Dimensions of a variable without time."""
        return tuple(str(dim) for dim in self.variables[name].dims if dim != self.time_dim)

    def fail(self, words: str) -> CurrentError:
        """Return an error that names the files."""
        return CurrentError(f"{self.label}: {words}")

    def read(self, name: str, picks: Mapping[str, Pick], frames: slice, dims: Sequence[str]) -> Array:
        """Return values [T, *dims] of some frames, or [1, *dims] of a variable that knows no time."""
        if self.time_dim is None or self.time_dim not in self.variables[name].dims:
            return self.files[0].read(name, picks, tuple(dims))[None]
        wanted, parts = self.frames[frames], []
        for number in dict.fromkeys(wanted[:, 0].tolist()):
            index = wanted[wanted[:, 0] == number, 1]
            parts.append(
                self.files[number].read(name, {**picks, self.time_dim: index}, (self.time_dim, *dims))
            )
        if len({part.shape[1:] for part in parts}) > 1:
            raise self.fail(f"{name} has another shape in one file than in another")
        return np.concatenate(parts)

    def close(self) -> None:
        """Let go of the files."""
        for file in self.files:
            file.close()


def in_order(files: Sequence[File], name: str, coordinates: Sequence[str]) -> Series:
    """Put files in order of time.

    Args:
        files: in any order.
        name: of a velocity component, whose dimensions tell which is time.
        coordinates: variables that must be the same in all files.

    Raises:
        CurrentError: files overlap, or have other variables or another grid than the first.
    """
    known, notes = [], []
    for file in files:
        if name not in file.variables:
            raise CurrentError(f"{file.path}: has no {name}, which {files[0].path} has")
        time = find_time(file, tuple(str(dim) for dim in file.variables[name].dims))
        seconds, remarks = decode_times(file, time)
        notes += [remark for remark in remarks if remark not in notes]
        dims = file.variables[time].dims
        known.append((file, str(dims[0]) if dims else None, seconds))
        _same_grid(files[0], file, name, coordinates, known[-1][1])
    known.sort(key=lambda entry: (entry[2][0], entry[2][-1]))
    dims = {dim for _, dim, _ in known}
    if len(dims) > 1 or (len(known) > 1 and dims == {None}):
        raise CurrentError(f"{files[0].path}: files of a series need the same dimension of time")
    times, frames = _merged(known, notes)
    return Series(tuple(file for file, _, _ in known), dims.pop(), times, frames, tuple(notes))


def _merged(known: list, notes: list[str]) -> tuple[Array, NDArray[np.int64]]:
    """Times of all files in a row, what is given twice taken from the earlier file."""
    times: list[float] = []
    frames: list[tuple[int, int]] = []
    dropped = 0
    for number, (file, _, seconds) in enumerate(known):
        stated = set(times)
        new = [index for index, second in enumerate(seconds) if second not in stated]
        if times and new and seconds[new[0]] < times[-1]:
            raise CurrentError(
                f"{file.path}: its times overlap those of {known[number - 1][0].path}, "
                f"{stamp(seconds[new[0]])} lies before {stamp(times[-1])}"
            )
        for index in new:
            if times and seconds[index] == times[-1]:
                continue
            times.append(float(seconds[index]))
            frames.append((number, index))
        dropped += len(seconds)
    if dropped > len(times):
        notes.append(f"{dropped - len(times)} times are given twice; the first is used")
    return np.asarray(times), np.asarray(frames, np.int64)


def _is_fixed(file: File, name: str, time_dim: str | None) -> bool:
    """Return whether a file tells a variable of numbers that knows no time."""
    variable = file.variables.get(name)
    return variable is not None and variable.dtype.kind in "iuf" and time_dim not in variable.dims


def _same_kind(where: str, name: str, one: xr.Variable, two: xr.Variable, time_dim: str | None) -> None:
    """Require the same sizes and units of a variable in two files."""
    if one.dtype.kind not in "iuf" or time_dim not in one.dims or one.dims == (time_dim,):
        return
    sizes = [{dim: size for dim, size in each.sizes.items() if dim != time_dim} for each in (one, two)]
    if sizes[0] != sizes[1]:
        raise CurrentError(f"{where}: {name} has other dimensions")
    units = [text(each.attrs, "units") for each in (two, one)]
    if units[0] != units[1]:
        raise CurrentError(f"{where}: {name} is in {units[0]!r} and in {units[1]!r}, which must be one unit")


def _same_grid(first: File, other: File, name: str, coordinates: Sequence[str], time_dim: str | None) -> None:
    if first is other:
        return
    where = f"{other.path} and {Path(first.path).name}"
    if first.variables[name].dims != other.variables[name].dims:
        raise CurrentError(f"{where}: {name} has other dimensions")
    for shared in set(first.variables) & set(other.variables):
        _same_kind(where, shared, first.variables[shared], other.variables[shared], time_dim)
    levels = {dim for dim in first.variables[name].dims[:-1] if dim != time_dim}
    axes = [axis for axis, stated in first.variables.items() if stated.ndim == 1 and stated.dims[0] in levels]
    fixed = [
        *coordinates,
        *(axis for axis in (*axes, *_FIXED) if axis not in coordinates and _is_fixed(first, axis, time_dim)),
    ]
    for coordinate in fixed:
        if coordinate not in other.variables:
            raise CurrentError(f"{other.path}: has no {coordinate}, which {first.path} has")
        pair = [file.coordinate(coordinate, missing=True) for file in (first, other)]
        # Packed anew in each file, depths differ by a rounding.
        slack = 1e-6 if coordinate in coordinates else 1e-3 * float(np.nanmax(np.abs(pair[0]), initial=0.0))
        same = pair[0].shape == pair[1].shape and np.allclose(*pair, rtol=0.0, atol=slack, equal_nan=True)
        if not same:
            raise CurrentError(f"{where}: the grids differ in {coordinate}")
