"""Folders and files of results: written whole or not at all, read with one clear line on what is wrong."""

import hashlib
import json
import math
import os
import secrets
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvplan.errors import AuvplanError, reason_of

if TYPE_CHECKING:
    import xarray as xr

#: Names of the two files that hold a run, and of the page that shows a result.
SUMMARY, MISSION, REPORT = "summary.json", "mission.nc", "report.html"

#: What a study runs and figures of a rehearsal, in its folder; and the record of an execution on a vehicle.
DESIGN, REHEARSAL, EXECUTION = "study.json", "rehearsal.json", "execution.json"

#: Departures as a table, and what they were planned from.
DEPARTURES, DEPARTED = "departures.csv", "departures.json"

#: Names of the other files of a run, as patterns.
RESULTS = (
    REPORT, "itinerary.*", "sheet.html", "sheet.pdf",
    "mission.png", "mission.gif", "mission.mp4", "timeline.png", "energy.png",
    *(f"{name}{leg}.png" for name in ("currents", "obstacles", "convergence") for leg in ("", "-[0-9]*")),
)  # fmt: skip

#: Larger summaries are no summaries.
_MAX_SUMMARY_BYTES = 50_000_000

#: Attributes by which NetCDF 4 lies in HDF5, and the name there of a dimension without a variable.
_OF_NETCDF = {
    "NAME", "CLASS", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS",
    "_Netcdf4Coordinates", "_Netcdf4Dimid", "_NCProperties", "_nc3_strict",
}  # fmt: skip
_NO_VARIABLE = b"This is a netCDF dimension but not a netCDF variable"

#: Bytes of a file that are looked through for heaps.
_HEAPS = 64 << 20

#: A file of results that claims more bytes of values than either of these, the latter times its own size, is
#: none: it would fill the memory.
_MAX_DATASET_BYTES, _MOST_COMPRESSED = 1 << 27, 100

#: Larger files are known by name and size alone, bytes.
_HASHED = 500_000_000


class OutputError(AuvplanError):
    """A result that cannot be written; the message is one line."""


class ResultError(AuvplanError):
    """A result that cannot be read; the message is one line."""


def output_folder(path: str | Path) -> Path:
    """Create a folder for results where it is missing, and make sure that files can be written there.

    Raises:
        OutputError: one line that names the folder and the reason.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Permission bits are not reliable on every file system: only a written file does.
        probe = _beside(folder / "probe")
        probe.touch(exist_ok=False)
        probe.unlink()
    except OSError as error:
        raise OutputError(f"cannot write to folder {folder}: {_reason(error)}") from None
    return folder


def require_kind(folder: str | Path, kind: str) -> None:
    """Refuse a folder that holds results of another kind than "mission", "study" or "departures".

    Raises:
        OutputError: one line that says what it holds, and what would do.
    """
    for other, name in (("study", DESIGN), ("departures", DEPARTED), ("mission", MISSION)):
        if other != kind and (Path(folder) / name).is_file():
            what = {"study": "a study", "departures": "a table of departures", "mission": "a mission"}[other]
            raise OutputError(f"{folder} holds {what}: choose another folder with --out")


@contextmanager
def whole_result(path: str | Path) -> Iterator[Path]:
    """A folder to write the results of one run to, which replace all of an earlier run's at the end.

    Until then the earlier results are as they were, and so they stay where an error or a signal ends the run.
    Files of other names in the folder are left alone.

    Raises:
        OutputError: one line that names the folder and the reason.
    """
    require_kind(path, "mission")
    target = output_folder(path).resolve()
    for left in target.parent.glob(f".{target.name}.*.part"):
        if not _alive(left):
            shutil.rmtree(left, ignore_errors=True)
    partial = target.parent / f".{target.name}.{os.getpid()}.part"
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        yield partial
        # What makes earlier results a run goes first, and comes last.
        for stale in chain.from_iterable(target.glob(name) for name in (SUMMARY, MISSION, *RESULTS)):
            stale.unlink()
        for file in sorted(partial.iterdir(), key=lambda file: (file.name == SUMMARY, file.name == MISSION)):
            os.replace(file, target / file.name)
    except OSError as error:
        raise OutputError(f"cannot write to folder {path}: {_reason(error)}") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _alive(partial: Path) -> bool:
    """Return whether the process that a folder in the making belongs to is still there."""
    try:
        os.kill(int(partial.name.split(".")[-2]), 0)
    except (ValueError, ProcessLookupError):
        return False
    except OSError:
        pass
    return True


def write_atomically(path: str | Path, write: Callable[[Path], object]) -> Path:
    """Write a file under a temporary name in the same folder and move it into place.

    Whoever reads `path` sees the old file or the new one whole, and a failing writer leaves nothing behind.
    `write` is called with the temporary path, whose suffix is that of `path`.

    Returns:
        The path of the file.

    Raises:
        OutputError: the operating system refused; one line that names the file. What else `write` raises
            is passed on.
    """
    target = Path(path)
    temporary = _beside(target)
    try:
        write(temporary)
        os.replace(temporary, target)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {_reason(error)}") from None
    finally:
        with suppress(OSError):  # where there is no folder there is no such file either
            temporary.unlink()
    return target


def remove(path: str | Path) -> None:
    """Delete a file of results where there is one.

    Raises:
        OutputError: one line that names the file and the reason.
    """
    try:
        Path(path).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot delete {path}: {_reason(error)}") from None


def write_json(path: str | Path, data: Any) -> Path:
    """Write plain data as JSON, indented by two; see `write_atomically`."""
    text = json.dumps(data, indent=2) + "\n"
    return write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))


def folder_size(path: Path) -> int:
    """Return the bytes of a file, or of all files of a folder."""
    if path.is_dir():
        return sum(part.stat().st_size for part in path.rglob("*") if part.is_file())
    return path.stat().st_size


def is_study(folder: str | Path) -> bool:
    """Return whether a folder holds a study, finished or not."""
    return (Path(folder) / DESIGN).is_file()


def digest(path: Path) -> str:
    """Return the SHA-256 of a file, or of the names and digests of a folder's files, in hexadecimal.

    Empty where it is larger than 500 MB: it is known by name and size alone.
    """
    if folder_size(path) > _HASHED:
        return ""
    if path.is_dir():
        parts = sorted(part for part in path.rglob("*") if part.is_file())
        text = "".join(f"{part.relative_to(path).as_posix()} {digest(part)}\n" for part in parts)
        return hashlib.sha256(text.encode()).hexdigest()
    state = path.stat()
    return _digest(path, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=4096)
def _digest(path: Path, size: int, changed: int) -> str:
    """Hash a file; it is asked for in every run of a study, by its size and when it was changed."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_text(path: str | Path, fault: type[AuvplanError], limit: int = 200_000_000) -> str:
    """Return the text of a UTF-8 file, with or without a byte order mark, of `limit` bytes at most.

    Args:
        fault: raised with one line where the file is missing, larger, or not UTF-8.
    """
    try:
        with open(path, "rb") as file:
            content = file.read(limit + 1)
        if len(content) > limit:
            raise fault(f"{path}: larger than {limit} bytes")
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise fault(f"{path}: not a text file, or not UTF-8 text") from None
    except (OSError, ValueError) as error:
        raise error if isinstance(error, fault) else fault(f"{path}: {reason_of(error)}") from None


def read_summary(folder: str | Path) -> dict[str, Any]:
    """Return the figures of a saved run.

    Raises:
        ResultError: one line that names the file and the reason.
    """
    return read_json(folder, SUMMARY)


def read_json(folder: str | Path, name: str) -> dict[str, Any]:
    """Return a mapping of fields from a JSON file of results.

    Raises:
        ResultError: one line that names the file and the reason.
    """
    path = _existing(folder, name)
    try:
        if path.stat().st_size > _MAX_SUMMARY_BYTES:
            raise ResultError(f"{path}: larger than {_MAX_SUMMARY_BYTES} bytes, not a summary")
        summary = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ResultError(f"{path}: {_reason(error)}") from None
    except (ValueError, RecursionError):  # among them that of a number with thousands of digits
        raise ResultError(f"{path}: not valid JSON") from None
    if not isinstance(summary, dict):
        raise ResultError(f"{path}: a summary is a mapping of fields, got {type(summary).__name__}")
    return summary


def read_mission(folder: str | Path) -> "xr.Dataset":
    """Return the NetCDF file of a saved run, see `read_dataset`."""
    return read_dataset(folder, MISSION)


def read_dataset(folder: str | Path, name: str) -> "xr.Dataset":
    """Return a NetCDF file of results, loaded whole; times stay seconds since the scenario's epoch.

    Raises:
        ResultError: one line that names the file and the reason.
    """
    # Imported here because it takes half a second, which those who write no such file need not wait.
    import xarray as xr

    path = _existing(folder, name)
    try:
        require_whole(path, ResultError)
        return xr.decode_cf(xr.Dataset(*_read_hdf5(path)), decode_times=False)
    except ResultError:
        raise
    # HDF5 answers a damaged file with whatever its layers stumble over.
    except Exception as error:
        line = " ".join(str(error).split()) or type(error).__name__
        raise ResultError(f"{path}: not a readable NetCDF file ({line})") from None


def _read_hdf5(path: Path) -> tuple[dict[str, "xr.Variable"], dict[str, Any], dict[str, Any]]:
    """Return variables, no coordinates and attributes of a NetCDF 4 file without groups.

    h5netcdf takes several times as long: it looks for every dimension again and again.
    """
    import h5py
    import xarray as xr

    def attributes(part: Any) -> dict[str, Any]:
        found = {name: part.attrs[name] for name in part.attrs if name not in _OF_NETCDF}
        return {
            name: value[0] if getattr(value, "shape", ()) == (1,) else value for name, value in found.items()
        }

    variables = {}
    with h5py.File(path, track_order=True) as file:
        parts = {name: part for name, part in file.items() if isinstance(part, h5py.Dataset)}
        size, own = sum(part.nbytes for part in parts.values()), path.stat().st_size
        if size > max(_MAX_DATASET_BYTES, _MOST_COMPRESSED * own):
            raise ResultError(f"{path}: {size:.2g} bytes of values in a file of {own} are no result")
        for name, part in parts.items():
            own_axis = part.attrs.get("CLASS") == b"DIMENSION_SCALE"
            if own_axis and bytes(part.attrs["NAME"]).startswith(_NO_VARIABLE):  # type: ignore[arg-type]
                continue
            axes = part.attrs.get("DIMENSION_LIST", ())
            dims = [name] if own_axis else [str(file[axis[0]].name).removeprefix("/") for axis in axes]
            values = part.asstr()[()] if h5py.check_string_dtype(part.dtype) else part[()]
            variables[name] = xr.Variable(dims, values, attributes(part))
        return variables, {}, attributes(file)


def require_whole(path: str | Path, fault: type[AuvplanError]) -> None:
    """Refuse a NetCDF file that leads its library elsewhere, or nowhere.

    HDF5 reads values that lie in other files, whatever these are, and does not come to the end of some heaps.

    Args:
        path: of the file. What h5py raises on a damaged one is passed on.
        fault: raised with one line that names the file and, of HDF5, the variable.
    """
    import h5py

    with open(path, "rb") as content:
        if content.read(3) == b"CDF":
            return
    if _has_endless_heap(Path(path)):
        raise fault(f"{path}: damaged: a collection of its values has no end")
    with h5py.File(path, "r") as file:
        # What h5netcdf asks first; its answer to an error there is one more, on the way out.
        file.attrs.get("_nc3_strict")
        left: list[tuple[str, Any]] = [("", file)]
        seen: set[int] = set()
        while left:
            above, group = left.pop()
            for name in group:
                where = f"{above}{name}"
                link = group.get(name, getlink=True)
                if isinstance(link, h5py.ExternalLink):
                    raise fault(f"{path}: {where[:100]} is a link to another file, which is not followed")
                if not isinstance(link, h5py.HardLink):
                    continue
                part = group[name]
                if isinstance(part, h5py.Group) and hash(part.id) not in seen:
                    seen.add(hash(part.id))
                    left.append((f"{where}/", part))
                elif isinstance(part, h5py.Dataset):
                    sources = part.virtual_sources() if part.is_virtual else ()
                    if part.external or any(source.file_name != "." for source in sources):
                        line = f"the values of {where[:100]} lie in another file, which is not read"
                        raise fault(f"{path}: {line}")


def _has_endless_heap(path: Path) -> bool:
    """Return whether a heap of a file has free space of no size, over which HDF5 never comes to an end.

    Of large files nothing is looked at but their beginning.
    """
    with path.open("rb") as file:
        content = file.read(_HEAPS)
    place = -1
    while (place := content.find(b"GCOL\1\0\0\0", place + 1)) >= 0:
        end = place + int.from_bytes(content[place + 8 : place + 16], "little")
        at = place + 16
        while at + 16 <= min(end, len(content)):
            size = int.from_bytes(content[at + 8 : at + 16], "little")
            if any(content[at : at + 2]):
                at += 16 + (size + 7) // 8 * 8
            elif size == 0:
                return True
            else:
                at += size
    return False


def write_dataset(dataset: "xr.Dataset", path: str | Path) -> Path:
    """Write a NetCDF file, compressed, under a temporary name that is moved into place.

    Raises:
        OutputError: the operating system refused; one line that names the file.
    """
    encoding: Any = {name: _encoding(variable) for name, variable in dataset.variables.items()}
    # HDF5 crashes the process where the disk is full: it writes to memory. On a Dask worker xarray would ask
    # the cluster for a lock on the file by its name, and one in memory has none.
    dask = sys.modules.get("dask")
    with nullcontext() if dask is None else dask.config.set(scheduler="threads"):
        content = dataset.to_netcdf(engine="h5netcdf", encoding=encoding)
    return write_atomically(path, lambda part: part.write_bytes(content))


def _encoding(variable: "xr.Variable") -> dict[str, Any]:
    """Compression, and a fill value only where something is missing."""
    if variable.dtype.kind == "O":
        return {}
    missing = variable.dtype.kind == "f" and bool(variable.isnull().any())
    encoding: dict[str, Any] = {}
    if "_FillValue" not in variable.attrs:  # values as another program packed them
        encoding["_FillValue"] = math.nan if missing else None
    if variable.ndim and variable.size:
        encoding |= {"zlib": True, "complevel": 4, "shuffle": True}
    return encoding


def _existing(folder: str | Path, name: str) -> Path:
    if not Path(folder).is_dir():
        raise ResultError(f"{folder}: no such folder")
    path = Path(folder) / name
    if not path.is_file():
        if (Path(folder) / EXECUTION).is_file():
            raise ResultError(
                f"{folder}: holds the record of an execution alone, {EXECUTION}: give the folder of a plan, "
                "which `auvplan plan` writes of the same scenario, or of a simulated mission"
            )
        raise ResultError(f"{path}: no such file")
    return path


def _beside(path: Path) -> Path:
    """A hidden name in the same folder, with the same suffix, by which many writers know the format."""
    return path.with_name(f".{path.stem}-{secrets.token_hex(6)}{path.suffix}")


def _reason(error: OSError) -> str:
    return error.strerror or type(error).__name__
