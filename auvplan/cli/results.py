"""Commands that show and hand on results: figures, a film, a page, files for vehicles and maps."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from auvplan.cli import shared
from auvplan.errors import ScenarioError, StudyError
from auvplan.runtime.files import MISSION, ResultError, is_study


def plot(
    folder: Annotated[Path, typer.Argument(help="Folder of a run or a study.")],
    leg: Annotated[
        str | None,
        typer.Option(
            "--leg",
            metavar="N|all",
            help="Of a run: done leg to draw in pictures of one, from 1, or all; else that of most re-plans.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(help="Of a study: mission whose re-plans are drawn; by default a representative one."),
    ] = None,
    quiet: shared.QuietOption = False,
) -> None:
    """Draw the figures of a run, or of a study (Figs 12 to 15, and of a sweep), into its folder."""
    from auvplan import plot
    from auvplan.io.restore import restore_run

    study = is_study(folder) or not (folder / MISSION).is_file()
    if study and leg is not None:
        raise ScenarioError(f"--leg {leg}: {folder} holds no single run; name the folder of a run")
    if not study and seed is not None:
        raise ScenarioError(f"--seed {seed}: {folder} holds a single run; leave --seed out")
    if study:
        from auvplan.study import load_study

        dataset = load_study(folder)
        if seed is not None and seed not in dataset["seed"].values:
            raise StudyError(f"{folder}: no mission of seed {seed} in the study")
        pictures = plot.draw_study(dataset, folder, seed)
    else:
        try:
            number = leg if leg is None or leg == "all" else int(leg)
        except ValueError:
            raise ScenarioError(f"--leg {leg!r}: give the number of a done leg, from 1, or all") from None
        run = restore_run(folder)
        with shared.progress_bar("drawing", quiet) as progress:
            pictures = plot.draw_run(run, folder, leg=number, progress=progress)
    if not quiet:
        shared.list_files("pictures", pictures)


def animate(
    folder: Annotated[Path, typer.Argument(help="Folder of a run.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="File: .gif, or .mp4 where ffmpeg is installed; by default mission.gif in the folder.",
            show_default=False,
        ),
    ] = None,
    seconds: Annotated[float, typer.Option("--seconds", help="How long the film is, at most 120.")] = 12.0,
    fps: Annotated[int, typer.Option("--fps", help="Pictures a second, at most 30.")] = 12,
    quiet: shared.QuietOption = False,
) -> None:
    """Write a run as a film: vehicle, plans, obstacles and tasks over time."""
    from auvplan.io.restore import restore_run
    from auvplan.plot import animate_run

    run = restore_run(folder)
    with shared.progress_bar("drawing the film", quiet) as progress:
        film = animate_run(run, out or folder / "mission.gif", seconds=seconds, fps=fps, progress=progress)
    if not quiet:
        shared.say(f"film: {film}")


def report(
    folder: Annotated[Path, typer.Argument(help="Folder of a run, a study or departures.")],
    quiet: shared.QuietOption = False,
) -> None:
    """Write a result as one page, report.html, that any browser shows without a network."""
    from auvplan.report import write_report

    page = write_report(folder)
    if not quiet:
        shared.name_page(page)


def export(
    folder: Annotated[Path, typer.Argument(help="Folder of a mission's result.")],
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            help="qgc, geojson, kml, gpx, csv, netcdf, imc or ros; may be given again. All that can hold the "
            "plan if absent.",
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
        shared.SpeedHeld,
        typer.Option(
            help="Speeds in .plan and IMC files: ground, what each line is planned to make over it, "
            "or water, that of the plan through the water, for a vehicle without a bottom lock."
        ),
    ] = "ground",
    quiet: shared.QuietOption = False,
) -> None:
    """Write a plan in the files that ground stations and maps open."""
    from auvplan.export import export, export_held, export_notes, itinerary_of
    from auvplan.io.restore import restore_run

    chosen = [name.strip() for text in formats or () for name in text.split(",")]
    run = restore_run(folder)
    if run.simulated and not as_simulated:
        raise ResultError(
            f"{folder}: is a simulated mission, whose paths avoid obstacles that the simulator drew: "
            "`auvplan plan` makes the plan for a vehicle, --as-simulated exports this one all the same"
        )
    itinerary = itinerary_of(run, slow=slow)
    itinerary = replace(itinerary, fence_points=fence_points, over_ground=speed == "ground")
    if chosen:
        notes = export_notes(itinerary, chosen)
        files = export(itinerary, out or folder, chosen)
    else:
        held, left_out = export_held(itinerary, out or folder)
        notes, files = export_notes(itinerary, held), list(held.values())
        for line in left_out:
            shared.print_error(f"warning: {line}")
    if not quiet:
        shared.say_notes(notes)
        shared.list_files("files", files)
