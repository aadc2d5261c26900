"""Missions as files that vehicles and geographic information systems open."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from auvplan.export.fences import Circle, Fence, Polygon
from auvplan.export.geojson import write_geojson
from auvplan.export.imc import write_imc
from auvplan.export.itinerary import ExportError, Itinerary, PlannedLeg, Track, itinerary_of_parts
from auvplan.export.markup import write_gpx, write_kml
from auvplan.export.qgroundcontrol import qgc_notes, validate_plan, write_qgc
from auvplan.export.ros import write_ros
from auvplan.export.runs import itinerary_of
from auvplan.export.speeds import speed_note
from auvplan.export.tables import write_csv, write_netcdf
from auvplan.export.thin import Thinned, thin
from auvplan.records import MissionRun
from auvplan.runtime.files import output_folder
from auvplan.site import Site

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
    "export_notes",
    "export_run",
    "itinerary_of",
    "itinerary_of_parts",
    "thin",
    "validate_plan",
    "write_csv",
    "write_geojson",
    "write_gpx",
    "write_imc",
    "write_kml",
    "write_netcdf",
    "write_qgc",
    "write_ros",
]


@dataclass(frozen=True)
class Format:
    """A file format.

    Attributes:
        file: name of the file in the folder.
        write: called with an itinerary and the path.
        timeless: what becomes of times where the site has no epoch; nothing to say where empty.
    """

    file: str
    write: Callable[[Itinerary, Path], Path]
    timeless: str = ""


#: By name. Their files stand beside a saved run's and take the name of none of them.
FORMATS = {
    "qgc": Format("itinerary.plan", write_qgc),
    "geojson": Format("itinerary.geojson", write_geojson, "no times of day, only seconds"),
    "kml": Format("itinerary.kml", write_kml, "no times"),
    "gpx": Format("itinerary.gpx", write_gpx, "no times"),
    "csv": Format("itinerary.csv", write_csv, "no times"),
    "netcdf": Format("itinerary.nc", write_netcdf, "the epoch as 2000-01-01"),
    "imc": Format("itinerary.imc.xml", write_imc),
    "ros": Format("itinerary.cdr", write_ros, "times that count from the departure"),
}


def export(itinerary: Itinerary, folder: str | Path, formats: Iterable[str] = tuple(FORMATS)) -> list[Path]:
    """Write an itinerary in some formats.

    Args:
        itinerary: what to write.
        folder: created if needed; files of an earlier export are replaced.
        formats: names of `FORMATS`.

    Returns:
        The files, in the order of the formats.

    Raises:
        ExportError: a format is not known, or cannot hold the itinerary; one line.
        OutputError: a file cannot be written; one line that names it.
    """
    chosen = [_format(name) for name in formats]
    target = output_folder(folder)
    return [kind.write(itinerary, target / kind.file) for kind in chosen]


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
    chosen = [_format(name) for name in names]
    notes = [*itinerary.notes, *itinerary.warnings, itinerary.description]
    if itinerary.site.epoch is None:
        notes += [
            f"{kind.file}: the mission has no date, so it has {kind.timeless}"
            for kind in chosen
            if kind.timeless
        ]
    if "imc" in names:
        notes.append(f"{FORMATS['imc'].file}: {speed_note(itinerary)}")
    return notes + (qgc_notes(itinerary) if "qgc" in names else [])


def _format(name: str) -> Format:
    if name not in FORMATS:
        raise ExportError(f"format {name!r} is not one of {', '.join(FORMATS)}")
    return FORMATS[name]
