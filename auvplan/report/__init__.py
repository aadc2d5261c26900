"""Results as pages: one file each that a browser shows without a network, with map, time and tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auvplan.records import MissionRun
from auvplan.report.page import write_page
from auvplan.runtime import files


def write_report(folder: str | Path) -> Path:
    """Write the page of a saved result beside its files: a run, a study, a rehearsal or departures.

    Raises:
        ResultError: the folder holds no result, or a file is damaged or incomplete; one line that names it.
        OutputError: the page cannot be written; one line that names it.
    """
    target = Path(folder)
    if (target / files.MISSION).is_file():
        from auvplan.io.restore import restore_run

        return write_run_report(restore_run(target), files.read_summary(target), target)
    if files.is_study(target):
        return write_study_report(target)
    if (target / files.DEPARTURES).is_file():
        return write_departures_report(target)
    missing = "no run, study or departures in it" if target.is_dir() else "no such folder"
    raise files.ResultError(f"{folder}: {missing}; give the folder that --out named")


def write_run_report(run: MissionRun, summary: Mapping[str, Any], folder: str | Path) -> Path:
    """Write the page of a run.

    Args:
        run: as executed, or a plan; one that failed on the way is fine.
        summary: of the run, with its mission sheet as "sheet" where it has one.
        folder: that exists.

    Raises:
        OutputError: the page cannot be written; one line that names it.
    """
    from auvplan.report.run import run_data

    data = run_data(run, summary)
    title = f"{data['name']}, {data['kind']}, seed {run.seed}"
    return write_page("run", title, data, Path(folder) / files.REPORT)


def write_study_report(folder: str | Path) -> Path:
    """Write the page of a finished study, or of a rehearsal; raises as `write_report`."""
    from auvplan.report.study import study_data
    from auvplan.study.store import RUNS, load_study

    target = Path(folder)
    rehearsed = (target / files.REHEARSAL).is_file()
    rehearsal = files.read_json(target, files.REHEARSAL) if rehearsed else None
    runs = sorted(path.parent.name for path in (target / RUNS).glob(f"*/{files.MISSION}"))
    data = study_data(load_study(target), rehearsal, runs)
    return write_page("study", f"{data['name']}, {data['kind']}", data, target / files.REPORT)


def write_departures_report(folder: str | Path) -> Path:
    """Write the page of departures; raises as `write_report`."""
    from auvplan.report.departures import departures_data, read_departures

    data = departures_data(*read_departures(folder))
    return write_page("departures", f"{data['name']}, departures", data, Path(folder) / files.REPORT)
