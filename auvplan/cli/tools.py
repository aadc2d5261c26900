"""Commands that look at charts and results."""

from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from auvplan.cli.shared import JsonOption, OutOption, QuietOption, console, print_json
from auvplan.words import counted

if TYPE_CHECKING:
    from auvplan.io.check import CheckReport


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
    as_json: JsonOption = False,
) -> None:
    """Check a result independently: walk every sailed metre, re-add every second."""
    from auvplan.io.check import check_run
    from auvplan.study.store import is_study

    if is_study(folder):
        sound = _check_study(folder, quiet, as_json)
    else:
        report = check_run(folder)
        sound = report.ok
        if as_json:
            print_json(_plain(report))
        elif not quiet:
            _say(str(report))
    if not sound:
        raise typer.Exit(1)


def _plain(report: "CheckReport") -> dict[str, Any]:
    return {"ok": report.ok, "collisions": report.collisions} | asdict(report)


def _check_study(folder: Path, quiet: bool, as_json: bool) -> bool:
    """Check all saved runs of a study, a line each, and tell whether none has a fault."""
    from auvplan.io.check import CheckReport, check_run
    from auvplan.study.store import saved_runs

    reports: dict[str, CheckReport] = {}
    for run in saved_runs(folder):
        report = reports[run.name] = check_run(run)
        if not quiet and not as_json:
            met = f"{counted(report.legs, 'leg')}, {report.length:,.0f} m, {_collisions(report.collisions)}"
            faults = "no faults" if report.ok else counted(len(report.faults), "fault")
            first = "" if report.ok else f", first: {report.faults[0]}"
            _say(f"{run.name}: {met}, {faults}{first}")
    faulty = sum(not report.ok for report in reports.values())
    length = sum(report.length for report in reports.values())
    collisions = sum(report.collisions for report in reports.values())
    if as_json:
        print_json(
            {
                "ok": not faulty,
                "collisions": collisions,
                "length": length,
                "runs": {name: _plain(report) for name, report in reports.items()},
            }
        )
    elif not quiet:
        met = f"{length / 1000.0:,.1f} km, {_collisions(collisions)}"
        _say(f"{counted(len(reports), 'run')}, {met}, {counted(faulty, 'run')} with faults")
    return not faulty


def _collisions(count: int) -> str:
    return counted(count, "collision")


def _say(text: str) -> None:
    """Print without colours for numbers, folds and signs in brackets."""
    console.print(text, highlight=False, soft_wrap=True, markup=False)


def kept(
    clear: Annotated[bool, typer.Option("--clear", help="Remove all of it.")] = False,
) -> None:
    """Show what is kept on disk for later runs: compiled programs and clustered charts."""
    from auvplan import cache

    place = cache.folder()
    if place is None:
        _say("nothing is kept: AUVPLAN_CACHE is off")
        return
    if clear:
        removed = cache.trim(limit=0)
        _say(f"{place}: {counted(len(removed), 'entry')} removed, {_megabytes(removed)}")
        return
    entries = list(cache.entries())
    table = Table("what", "entries", "size", "last used")
    for name in sorted({entry.name for entry in entries}):
        own = [entry for entry in entries if entry.name == name]
        used = datetime.fromtimestamp(max(entry.used for entry in own))
        table.add_row(name, str(len(own)), _megabytes(own), f"{used:%Y-%m-%d %H:%M}")
    if entries:
        console.print(table)
    _say(f"{place}: {_megabytes(entries)} of at most {cache.LIMIT / 1e6:.0f} MB")


def _megabytes(entries: list) -> str:
    return f"{sum(entry.size for entry in entries) / 1e6:.1f} MB"
