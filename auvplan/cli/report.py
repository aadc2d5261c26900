"""The command that shows a result as a page."""

from pathlib import Path
from typing import Annotated

import typer

from auvplan.cli.shared import QuietOption, name_page


def report(
    folder: Annotated[Path, typer.Argument(help="Folder of a run, a study or departures.")],
    quiet: QuietOption = False,
) -> None:
    """Write a result as one page, report.html, that any browser shows without a network."""
    from auvplan.report import write_report

    page = write_report(folder)
    if not quiet:
        name_page(page)
