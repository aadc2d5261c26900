"""Missions as files that vehicles and geographic information systems open."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from auvplan.export.fences import Circle, Fence, Polygon
from auvplan.export.geojson import geojson_text
from auvplan.export.imc import imc_text
from auvplan.export.itinerary import ExportError, Itinerary, PlannedLeg, Track, itinerary_of_parts
from auvplan.export.markup import gpx_text, kml_text
from auvplan.export.qgroundcontrol import qgc_notes, qgc_text, validate_plan
from auvplan.export.ros import geo_path
from auvplan.export.runs import itinerary_of
from auvplan.export.speeds import speed_note
from auvplan.export.tables import csv_text, trajectories
from auvplan.export.thin import Thinned, thin
from auvplan.records import MissionRun
from auvplan.runtime.files import OutputError, output_folder, remove, write_atomically, write_dataset
from auvplan.site import Site

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "FORMATS",
    "Circle",
    "ExportError",
    "Fence",
    "Itinerary",
    "PlannedLeg",
    "Polygon",
    "Thinned",
    "Track",
    "export",
    "export_held",
    "export_notes",
    "export_run",
    "itinerary_of",
    "itinerary_of_parts",
    "thin",
    "validate_plan",
]


@dataclass(frozen=True)
class Format:
    """A file format.

    Attributes:
        file: name of the file in the folder.
        content: of an itinerary: the file's bytes, or the dataset of a NetCDF file; it raises `ExportError`
            where the format cannot hold the itinerary.
        timeless: what becomes of times where the site has no epoch; nothing to say where empty.
        speedless: what becomes of the speeds of legs; nothing to say where the file has them.
    """

    file: str
    content: "Callable[[Itinerary], bytes | xr.Dataset]"
    timeless: str = ""
    speedless: str = ""

    def write(self, itinerary: Itinerary, folder: Path) -> Path:
        """Write the file whole or not at all; raises as `export`."""
        content, path = self.content(itinerary), folder / self.file
        if isinstance(content, bytes):
            return write_atomically(path, lambda part: part.write_bytes(content))
        try:
            return write_dataset(content, path)
        except OutputError:
            raise
        except Exception as error:  # HDF5 and xarray raise errors of many kinds
            raise ExportError(f"{path}: {' '.join(str(error).split()) or type(error).__name__}") from None


#: By name. Their files stand beside a saved run's and take the name of none of them.
FORMATS = {
    "qgc": Format("itinerary.plan", qgc_text),
    "geojson": Format("itinerary.geojson", geojson_text, "no times of day, only seconds"),
    "kml": Format("itinerary.kml", kml_text, "no times", "in words alone"),
    "gpx": Format("itinerary.gpx", gpx_text, "no times", "in words alone"),
    "csv": Format("itinerary.csv", csv_text, "no times"),
    "netcdf": Format("itinerary.nc", trajectories, "the epoch as 2000-01-01"),
    "imc": Format("itinerary.imc.xml", imc_text),
    "ros": Format("itinerary.cdr", geo_path, "times that count from the departure", "in its times alone"),
}


def export(itinerary: Itinerary, folder: str | Path, formats: Iterable[str] = tuple(FORMATS)) -> list[Path]:
    """Write an itinerary in some formats; return the files in their order.

    Args:
        itinerary: what to write.
        folder: created if needed; files of an earlier export are replaced.
        formats: names of `FORMATS`.

    Raises:
        ExportError: a format is not known, or cannot hold the itinerary; one line.
        OutputError: a file cannot be written; one line that names it.
    """
    chosen = _formats(formats)
    target = output_folder(folder)
    return [kind.write(itinerary, target) for kind in chosen]


def export_held(itinerary: Itinerary, folder: str | Path) -> tuple[dict[str, Path], list[str]]:
    """Write an itinerary in all formats that can hold it; an earlier file of another format goes.

    Returns:
        Their files by the formats' names, and a line for each other format, with its file and why.

    Raises:
        OutputError: as `export`, or an earlier file cannot be deleted.
    """
    held, left_out = {}, []
    for name, kind in FORMATS.items():
        try:
            (held[name],) = export(itinerary, folder, [name])
        except ExportError as error:
            older = Path(folder) / kind.file
            gone = "; an older one is deleted" if older.is_file() else ""
            remove(older)
            left_out.append(f"{kind.file} is left out{gone}: {error}")
    return held, left_out


def export_run(
    run: MissionRun, folder: str | Path, formats: Iterable[str] = tuple(FORMATS), site: Site | None = None
) -> list[Path]:
    """`export` of a run's itinerary; `site` is the run's own if absent."""
    return export(itinerary_of(run, site), folder, formats)


def export_notes(itinerary: Itinerary, formats: Iterable[str] = tuple(FORMATS)) -> list[str]:
    """Return lines for whoever exports: what was left out, and what the files do not say.

    Raises:
        ExportError: a format is not known.
    """
    names = list(formats)
    chosen = _formats(names)
    notes = [*itinerary.notes, *itinerary.warnings, itinerary.description]
    if itinerary.site.epoch is None:
        notes += [
            f"{kind.file}: the mission has no date, so it has {kind.timeless}"
            for kind in chosen
            if kind.timeless
        ]
    if itinerary.speeds:
        notes += [
            f"{kind.file}: has the speeds of legs, {itinerary.speeds} through the water, {kind.speedless}"
            for kind in chosen
            if kind.speedless
        ]
    if "imc" in names:
        notes.append(f"{FORMATS['imc'].file}: {speed_note(itinerary)}")
    return notes + (qgc_notes(itinerary) if "qgc" in names else [])


def _formats(names: Iterable[str]) -> list[Format]:
    chosen = list(names)
    for name in chosen:
        if name not in FORMATS:
            raise ExportError(f"format {name!r} is not one of {', '.join(FORMATS)}")
    return [FORMATS[name] for name in chosen]
