"""The command that hands a plan to vehicles and geographic information systems."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from auvplan.cli.shared import QuietOption, SpeedHeld, list_files, say_notes


def export(
    folder: Annotated[Path, typer.Argument(help="Folder of a mission's result.")],
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            help="qgc, geojson, kml, gpx, csv, netcdf, imc or ros; may be given again. All if absent.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the files; the result's own if absent.")
    ] = None,
    as_simulated: Annotated[
        bool, typer.Option("--as-simulated", help="Export the paths of a simulated mission all the same.")
    ] = False,
    fence_points: Annotated[
        int, typer.Option(min=0, help="Points of fences that the autopilot holds (.plan).")
    ] = 70,
    slow: Annotated[
        float, typer.Option(min=0.0, help="Share of its speed over ground below which a leg is noted.")
    ] = 0.5,
    speed: Annotated[
        SpeedHeld,
        typer.Option(
            help="Speeds in .plan and IMC files: ground, what each line is planned to make over it, "
            "or water, that of the plan through the water, for a vehicle without a bottom lock."
        ),
    ] = SpeedHeld.GROUND,
    quiet: QuietOption = False,
) -> None:
    """Write a plan in the files that ground stations and maps open."""
    from auvplan.export import FORMATS, export, export_notes, itinerary_of
    from auvplan.io.restore import restore_run
    from auvplan.runtime.files import ResultError

    chosen = [name.strip() for text in formats or FORMATS for name in text.split(",")]
    run = restore_run(folder)
    if run.simulated and not as_simulated:
        raise ResultError(
            f"{folder}: is a simulated mission, whose paths avoid obstacles that the simulator drew: "
            "`auvplan plan` makes the plan for a vehicle, --as-simulated exports this one all the same"
        )
    over_ground = speed is SpeedHeld.GROUND
    itinerary = replace(itinerary_of(run, slow=slow), fence_points=fence_points, over_ground=over_ground)
    notes = export_notes(itinerary, chosen)
    files = export(itinerary, out or folder, chosen)
    if not quiet:
        say_notes(notes)
        list_files("files", files)
