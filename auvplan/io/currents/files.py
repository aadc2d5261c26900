"""NetCDF files and Zarr folders: opened by their first bytes, read lazily, one line on what is wrong."""

import contextlib
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from glob import glob
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray import conventions

from auvplan.errors import AuvplanError, reason_of
from auvplan.io.currents.units import length_factor
from auvplan.ocean.gridded import CurrentError
from auvplan.runtime.files import require_whole

#: Coordinates with more values are refused before they are read.
_MAX_COORDINATE = 50_000_000
#: Up to this many values are read in one piece though only some of them are wanted.
_AT_ONCE = 20_000_000

Array = NDArray[np.float64]
Source = str | Path | xr.Dataset
Paths = Source | Sequence[Source]
#: Which indices of a dimension are wanted.
Pick = int | slice | NDArray[np.int64]

#: What the dimension along which an ensemble's members lie is called; CF has the standard name.
_MEMBERS, _REALIZATION = ("member", "members", "ensemble", "ens", "realization", "number"), "realization"

_ZARR_FILES = ("zarr.json", ".zgroup", ".zmetadata")
#: What other files begin with, what they are and what would do.
_OTHERS = {
    b"GRIB": ("a GRIB file, ", ": convert it, such as by cdo -f nc4 copy"),
    b"PK\x03\x04": ("a ZIP archive, ", ": unpack it first"),
    b"\x1f\x8b": ("a gzip archive, ", ": unpack it first"),
    b"\x0e\x03\x13\x01": ("an HDF4 file, ", ": convert it, such as by h4toh5"),
}


@dataclass(frozen=True)
class File:
    """An opened file, nothing of which is read but its head."""

    path: str  # as given, for messages
    variables: Mapping[str, xr.Variable]  # by name; packing and fill values are decoded, times are not
    attributes: Mapping[str, Any]  # of the whole file
    close: Callable[[], None]  # closes the file
    #: The projection of its coordinates as pyproj takes it, where the file may not name it; or None.
    crs: Any = None
    #: The moment, s since 1970, that its times count from where it does not state it; or None.
    epoch: float | None = None

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of the dimensions."""
        return {
            str(dim): size for variable in self.variables.values() for dim, size in variable.sizes.items()
        }

    def fail(self, reason: str) -> CurrentError:
        """Return an error that names the file."""
        return CurrentError(f"{self.path}: {reason}")

    def text(self, name: str, key: str) -> str:
        """Return an attribute of a variable as text without blanks around it; empty where there is none."""
        return text(self.variables[name].attrs, key)

    def metres(self, name: str) -> float:
        """Return metres in a variable's unit of length; variables without units are in metres.

        Raises:
            CurrentError: the unit is no length.
        """
        units = self.text(name, "units")
        factor = length_factor(units) if units else 1.0
        if factor is None:
            raise self.fail(f"{name} has units {units!r}, which are no length: metres are needed")
        return factor

    def standard_name(self, name: str) -> str:
        """Return a variable's CF standard name in lower case, without a modifier; empty without one."""
        return next(iter(self.text(name, "standard_name").lower().split()), "")

    def read(
        self, name: str, picks: Mapping[str, Pick] | None = None, dims: Sequence[str] | None = None
    ) -> Array:
        """Return a variable's values, or those of some indices of its dimensions.

        Args:
            picks: indices by dimension; dimensions that are not named are read whole.
            dims: order of the result's dimensions; the variable's own by default.

        Raises:
            CurrentError: the values cannot be read or are no numbers.
        """
        variable = self.variables[name]
        chosen = {dim: pick for dim, pick in (picks or {}).items() if dim in variable.dims}
        after: dict[str, NDArray[np.int64]] = {}
        for dim, pick in chosen.items():
            if isinstance(pick, np.ndarray) and len(pick):
                # A run is read in one piece and thinned in memory: files read scattered indices one by one.
                first, last = int(pick.min()), int(pick.max()) + 1
                run = chosen | {dim: slice(first, last)}
                if last - first <= 4 * len(pick) or variable.isel(run).size <= _AT_ONCE:
                    chosen = run
                    if last - first != len(pick) or (np.diff(pick) < 0).any():
                        after[dim] = pick - first
        with self.guarded(name):
            part = variable.isel(chosen)
            if dims is not None:
                part = part.transpose(*dims)
            values = np.asarray(part.values)
        if values.dtype.kind not in "fiub":
            raise self.fail(f"variable {name} holds no numbers")
        values = values.astype(float, copy=False)
        for dim, pick in after.items():
            values = np.take(values, pick, axis=part.dims.index(dim))
        return values

    def coordinate(self, name: str, missing: bool = False) -> Array:
        """Return all values of a coordinate, where some may be `missing`, as models leave them on land.

        Raises:
            CurrentError: they are too many, cannot be read, or are not finite.
        """
        if (size := self.variables[name].size) > _MAX_COORDINATE:
            raise self.fail(f"coordinate {name} has {size} values, more than {_MAX_COORDINATE} are not read")
        values = self.read(name)
        if not (np.isfinite(values).any() if missing else np.isfinite(values).all()):
            raise self.fail(f"coordinate {name} has values that are not finite")
        return values

    @contextlib.contextmanager
    def guarded(self, name: str) -> Iterator[None]:
        """Turn whatever a library stumbles over into one line that names the file and the variable."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                yield
        except CurrentError:
            raise
        except Exception as error:
            raise self.fail(f"variable {name} cannot be read ({reason_of(error)})") from None


@dataclass(frozen=True)
class Series(File):
    """Files of one model run with the same variables on the same grid, as one."""

    #: The dimension of time; None where the files have one time and no such dimension.
    time_dim: str | None = None
    times: Array = field(default_factory=lambda: np.zeros(0))  # [T] s since 1970, rising strictly
    #: [T, 2], the file of each time, and the index in it.
    frames: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    parts: tuple[File, ...] = ()  # the files, in order of time

    def dims(self, name: str) -> tuple[str, ...]:
        """Dimensions of a variable without time."""
        return tuple(str(dim) for dim in self.variables[name].dims if dim != self.time_dim)

    def at(self, frames: slice, name: str, picks: Mapping[str, Pick], dims: Sequence[str]) -> Array:
        """Return values [T, *dims] at some times, or [1, *dims] of a variable that knows no time."""
        if self.time_dim is None or self.time_dim not in self.variables[name].dims:
            return self.read(name, picks, dims)[None]
        wanted, found = self.frames[frames], []
        for number in dict.fromkeys(wanted[:, 0].tolist()):
            chosen = {**picks, self.time_dim: wanted[wanted[:, 0] == number, 1]}
            found.append(self.parts[number].read(name, chosen, (self.time_dim, *dims)))
        return found[0] if len(found) == 1 else np.concatenate(found)


def text(attributes: Mapping[str, Any], name: str) -> str:
    """Return an attribute as text without blanks around it; empty where there is none."""
    value = attributes.get(name, "")
    value = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return str(value).strip()


def same_values(one: Array, two: Array, slack: float = 1e-6) -> bool:
    """Return whether two arrays have one shape and the same values, NaN included."""
    return one.shape == two.shape and np.allclose(one, two, rtol=0.0, atol=slack, equal_nan=True)


def close_all(files: Sequence[File]) -> None:
    """Close files."""
    for file in files:
        file.close()


def open_files(paths: Paths, crs: Any = None, epoch: float | None = None) -> tuple[File, ...]:
    """Open one file, all of a glob pattern, a dataset, or a list of these; `crs` and `epoch` as in `File`.

    Raises:
        CurrentError: there is no such file, or one is no readable NetCDF file or Zarr folder.
    """
    given = [paths] if isinstance(paths, str | Path | xr.Dataset) else list(paths)
    sources: dict[Any, str | xr.Dataset] = {}  # each once
    for source in given:
        if isinstance(source, xr.Dataset):
            sources[id(source)] = source
        elif found := [str(source)] if os.path.exists(source) else sorted(glob(str(source))):
            sources |= {name: name for name in found}
        else:
            raise CurrentError(f"{source}: no such file")
    if not sources:
        raise CurrentError("no file of currents is named")
    files: list[File] = []
    try:
        for source in sources.values():
            opened = _open(source) if isinstance(source, str) else _held(source)
            files.append(replace(opened, crs=crs, epoch=epoch))
    except CurrentError:
        close_all(files)
        raise
    return tuple(files)


def open_members(source: Source) -> Sequence[Source]:
    """Return the forecasts that a source of currents holds: each member of an ensemble, or itself.

    Raises:
        CurrentError: there is no such file, or it is no readable NetCDF file or Zarr folder.
    """
    dataset = source
    if not isinstance(source, xr.Dataset):
        if not os.path.exists(source):
            return [source]  # a pattern, or what the reader refuses
        dataset = open_lazily(str(source), CurrentError)
    assert isinstance(dataset, xr.Dataset)
    for name, size in dataset.sizes.items():
        stated = dataset.variables[name].attrs.get("standard_name") if name in dataset.variables else ""
        if size > 1 and (str(name).lower() in _MEMBERS or stated == _REALIZATION):
            return [dataset.isel({name: k}).drop_vars([name], errors="ignore") for k in range(size)]
    if dataset is not source:
        dataset.close()
    return [source]


def _held(dataset: xr.Dataset) -> File:
    """Return a dataset as if it were opened from a file, with its times as numbers and all its attributes."""
    variables = {}
    for name, given in dataset.variables.items():
        dates = given.dtype.kind in "mMO"
        variable = conventions.encode_cf_variable(given) if dates else given.copy(deep=False)
        hints = "coordinates", "grid_mapping", "bounds"
        kept = {key: given.encoding[key] for key in hints if key in given.encoding}
        variable.attrs = kept | variable.attrs
        variables[str(name)] = variable.to_base_variable()
    return File("dataset", variables, dataset.attrs, lambda: None)


def _open(path: str) -> File:
    dataset = open_lazily(path, CurrentError)
    variables = {str(name): variable for name, variable in dataset.variables.items()}
    if not any(variable.ndim > 1 for variable in variables.values()) and h5py.is_hdf5(path):
        with h5py.File(path, "r") as file:
            groups = [str(name) for name in file if isinstance(file.get(name), h5py.Group)]
        if groups:
            dataset.close()
            raise CurrentError(
                f"{path}: its variables are in the groups {', '.join(groups)}: take one out, such as by "
                f"ncks -G : -g {groups[0]}"
            )
    return File(path, variables, dataset.attrs, dataset.close)


def open_lazily(path: str, fault: type[AuvplanError]) -> xr.Dataset:
    """Open a NetCDF file or a Zarr folder; its times stay numbers.

    Args:
        fault: raised with one line where it is none that can be read.
    """
    try:
        engine = _engine(path, fault)
        options: dict[str, Any] = {"consolidated": False} if engine == "zarr" else {}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if engine == "h5netcdf":
                require_whole(path, fault)
            # Without indexes only the head is read, however large a damaged one says that an axis is.
            return xr.open_dataset(
                path, engine=engine, decode_times=False, decode_timedelta=False, decode_coords=False,
                create_default_indexes=False, cache=False, **options,
            )  # fmt: skip
    except fault:
        raise
    except Exception as error:  # damaged files are answered with whatever a library's layers stumble over
        why = reason_of(error)
    # Raised here, without the library's error, whose traceback would keep the file open.
    raise fault(f"{path}: not a readable NetCDF file ({why})")


def _engine(path: str, fault: type[AuvplanError]) -> str:
    """Return xarray's engine for a file, by its first bytes."""
    place = Path(path)
    if place.is_dir():
        if not any((place / name).is_file() for name in _ZARR_FILES):
            raise fault(f"{path}: a folder that is no Zarr store")
        if find_spec("zarr") is None:
            raise fault(f"{path}: Zarr needs a further package: pip install 'auvplan[readers]'")
        return "zarr"
    with place.open("rb") as file:
        head = file.read(8)
    if head.startswith(b"\x89HDF\r\n\x1a\n"):
        return "h5netcdf"
    if head[:4] in (b"CDF\x01", b"CDF\x02"):
        return "scipy"
    if head[:4] == b"CDF\x05":
        if find_spec("netCDF4") is None:
            raise fault(f"{path}: NetCDF of type CDF-5 needs: pip install 'auvplan[readers]'")
        return "netcdf4"
    kind, remedy = next((words for start, words in _OTHERS.items() if head.startswith(start)), ("", ""))
    raise fault(f"{path}: {kind}not a NetCDF file{remedy}")
