"""Commands that look at charts and results."""

from pathlib import Path
from typing import Annotated

import typer

from auvplan.cli.shared import OutOption, QuietOption, console


def chart(
    image: Annotated[Path, typer.Argument(help="A chart-like picture: PNG, JPEG or GeoTIFF.")],
    out: OutOption = Path("out/chart"),
    pixel_size: Annotated[float, typer.Option(min=1e-3, help="Metres per pixel.")] = 10.0,
    quiet: QuietOption = False,
) -> None:
    """Cluster a picture into coast, uncertain area and water, and draw the result."""
    from auvplan.io import output_folder
    from auvplan.ocean.chart import Chart
    from auvplan.plot import draw_chart

    made = Chart.from_image(image, pixel_size=pixel_size)
    output_folder(out)
    picture = draw_chart(made, image, out)
    if not quiet:
        shares = made.shares()
        console.print(
            f"coast {shares['coast']:.1%}, uncertain {shares['uncertain']:.1%}, water {shares['water']:.1%}",
            highlight=False,
        )
        console.print(f"picture: {picture}", soft_wrap=True)


def check(
    folder: Annotated[
        Path, typer.Argument(help="Folder of a result, or of a study whose runs were saved (--save-runs).")
    ],
    quiet: QuietOption = False,
) -> None:
    """Check a result independently: walk every sailed metre, re-add every second."""
    from auvplan.io.check import check_run
    from auvplan.study.store import is_study

    if is_study(folder):
        sound = _check_study(folder, quiet)
    else:
        report = check_run(folder)
        sound = report.ok
        if not quiet:
            _say(str(report))
    if not sound:
        raise typer.Exit(1)


def _check_study(folder: Path, quiet: bool) -> bool:
    """Check all saved runs of a study, a line each, and tell whether none has a fault."""
    from auvplan.io.check import check_run
    from auvplan.study.store import saved_runs

    reports = []
    for run in saved_runs(folder):
        reports.append(report := check_run(run))
        if not quiet:
            met = f"{report.legs} legs, {report.length:.0f} m, {report.collisions} collisions"
            faults = "no faults" if report.ok else f"{len(report.faults)} faults, first: {report.faults[0]}"
            _say(f"{run.name}: {met}, {faults}")
    faulty = sum(not report.ok for report in reports)
    if not quiet:
        kilometres = sum(report.length for report in reports) / 1000.0
        collisions = sum(report.collisions for report in reports)
        met = f"{kilometres:.1f} km, {collisions} collisions"
        _say(f"{len(reports)} runs, {met}, {faulty} runs with faults")
    return not faulty


def _say(text: str) -> None:
    """Print without colours for numbers, folds and signs in brackets."""
    console.print(text, highlight=False, soft_wrap=True, markup=False)
