"""Results as a page: one file that a browser shows without a network, with map, time and tables to explore."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auvplan.files import REPORT, read_summary
from auvplan.records import MissionRun
from auvplan.report.page import write_page
from auvplan.report.run import run_data


def write_run_report(run: MissionRun, summary: Mapping[str, Any], folder: str | Path) -> Path:
    """Write the page of a run.

    Args:
        run: as sailed, or a plan.
        summary: of the run, with its mission sheet as "sheet" where it has one.
        folder: that exists.

    Returns:
        The path of the page.

    Raises:
        OutputError: the file cannot be written; one line that names it.
    """
    data = run_data(run, summary)
    return write_page("run", f"{data['name']}, {data['kind']}, seed {run.seed}", data, Path(folder) / REPORT)


def report_run(folder: str | Path) -> Path:
    """Write the page of a saved run beside its files; see `write_run_report`.

    Raises:
        ResultError: a file is missing, damaged or incomplete; one line that names it.
    """
    from auvplan.io.restore import restore_run

    return write_run_report(restore_run(folder), read_summary(folder), folder)
