"""What a scenario was planned on: files by name, size and hash, and settings that are not the defaults."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from glob import escape as glob_escape
from glob import glob
from pathlib import Path
from typing import Any

import h5py

from auvplan.runtime.files import digest, folder_size
from auvplan.scenario.power import is_file_name
from auvplan.scenario.scenario import Scenario

#: What attributes begin with that state where a file of currents was fetched from.
ORIGIN = "fetched_"
#: Fields that name files, by section.
FILE_FIELDS: dict[str, tuple[str, ...]] = {
    "chart": ("image", "file", "uncertain", "no_go", "no_surfacing"),
    "bathymetry": ("file",),
    "vehicle": ("power", "navigation"),
    "current": ("files", "constituents", "truth", "members.files"),
    "obstacles": ("file",),
    "mission": ("jobs",),
}


@dataclass(frozen=True)
class SourceFile:
    """A file that a scenario names.

    Attributes:
        field: of the scenario.
        name: of the file, without its folder.
        size: bytes.
        sha256: in hexadecimal; empty for folders and files of more than 500 MB.
        origin: of a current that `auvplan currents` fetched: server, dataset, run, request, request_sha256.
    """

    field: str
    name: str
    size: int
    sha256: str
    origin: dict[str, str] = dataclasses.field(default_factory=dict)

    @property
    def fetched(self) -> str:
        """Where it was fetched from, for people; empty where the file does not state it."""
        if not self.origin:
            return ""
        run = self.origin.get("run")
        dataset, server = (self.origin.get(name, "?") for name in ("dataset", "server"))
        return f"{dataset} from {server}" + (f", run of {run}" if run else "")


def source_files(settings: dict[str, Any], folder: str | Path) -> tuple[SourceFile, ...]:
    """Return the files that plain settings of a scenario name; those that are gone are left out."""
    found = []
    for row in source_digests(settings, folder):
        field, path, origin = row["field"], Path(row["path"]), {}
        sha256 = "" if path.is_dir() else row["sha256"]
        if field.startswith("current.") and path.is_file() and h5py.is_hdf5(path):
            with h5py.File(path, "r") as file:
                stated = {key: value for key, value in file.attrs.items() if isinstance(value, str)}
            origin = {key.removeprefix(ORIGIN): stated[key] for key in stated if key.startswith(ORIGIN)}
        found.append(SourceFile(field, path.name, row["size"], sha256, origin))
    return tuple(found)


def source_digests(settings: dict[str, Any], folder: str | Path) -> list[dict[str, Any]]:
    """Return field, path, size in bytes and SHA-256 of the files that settings name, as a run saves them."""
    return [
        {"field": field, "path": str(path), "size": folder_size(path), "sha256": digest(path)}
        for field, pattern in file_names(settings)
        for path in files_at(Path(folder) / Path(pattern).expanduser())
    ]


def changed_source(known: list[dict[str, Any]], settings: dict[str, Any], folder: str | Path) -> str:
    """Return which of the files that settings name is not as it was, by their digests then, in words.

    Files that are gone are not looked at: whoever reads them says so. Empty where all are as they were.
    """

    def by_name(rows: list[dict[str, Any]]) -> dict[tuple[str, str], str]:
        # Of large files no digest is kept.
        stated = [(row, row["sha256"][:16] or f"{row['size']} bytes") for row in rows]
        return {(row["field"], Path(row["path"]).name): digest for row, digest in stated}

    before, now = by_name(known), by_name(source_digests(settings, folder))
    for (field, name), stated in now.items():
        if (then := before.get((field, name))) != stated:
            return f"{field}: {name} was {then}, and is {stated} now" if then else f"{field}: {name} is new"
    return ""


def file_names(settings: dict[str, Any]) -> list[tuple[str, str]]:
    """Return field and text of all files, patterns and folders that the settings of a scenario name."""
    found: list[tuple[str, str]] = []
    for section, fields in FILE_FIELDS.items():
        for field in fields:
            given: Any = settings
            for name in (section, *field.split(".")):
                given = given.get(name) if isinstance(given, dict) else None
            if section == "vehicle" and isinstance(given, dict):
                given = given.get("vehicle")
            every = given if isinstance(given, list | tuple) else [given]
            for one in every:
                if isinstance(one, str) and (section != "vehicle" or is_file_name(one)):
                    found.append((f"{section}.{field}", one))
    return found


def files_at(path: Path) -> Iterator[Path]:
    """Yield the files and folders that a path, which may be a pattern, stands for."""
    for one in [path] if path.exists() else [Path(name) for name in sorted(glob(str(path)))]:
        yield one
        if one.suffix == ".000":  # updates of an S-57 cell that lie beside it are applied to it
            beside = sorted(one.parent.glob(f"{glob_escape(one.stem)}.[0-9][0-9][0-9]"))
            yield from (update for update in beside if update != one)


def changed_at(path: Path) -> tuple[tuple[str, int, int], ...]:
    """Return name, bytes and time of the last change, ns, of every file that a path stands for."""
    parts = [part for one in files_at(path) for part in ([one] if one.is_file() else sorted(one.rglob("*")))]
    stats = [(str(part), part.stat()) for part in parts]
    return tuple((name, stat.st_size, stat.st_mtime_ns) for name, stat in stats)


def changed_settings(settings: dict[str, Any], base: dict[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return the settings of a scenario that differ from the defaults, or a base: field, value, default."""
    compared = Scenario().model_dump(mode="json") if base is None else base
    found = _differences(settings, compared, "")
    return [row for row in found if row["field"] not in ("name", "description")]


def _differences(given: dict[str, Any], base: dict[str, Any], above: str) -> Iterator[dict[str, Any]]:
    for name, value in given.items():
        usual = base.get(name)
        if isinstance(value, dict) and isinstance(usual, dict):
            yield from _differences(value, usual, f"{above}{name}.")
        elif value != usual:
            yield {"field": above + name, "value": value, "default": usual}
