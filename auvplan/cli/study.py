"""Commands for many missions."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from auvplan.cli import shared
from auvplan.runtime.formatting import counted, figure

if TYPE_CHECKING:
    import xarray as xr

    from auvplan.study import Design


#: s that missions are under way before it is said how long the rest will take.
_JUDGED = 5.0


def montecarlo(
    scenario: shared.ScenarioArgument = "whitsunday",
    count: Annotated[
        int, typer.Option("--missions", "-n", min=1, help="Missions; of each swept value.")
    ] = 100,
    out: shared.OutOption = Path("out/montecarlo"),
    seed: shared.SeedOption = 0,
    preset: shared.PresetOption = None,
    objective: shared.ObjectiveOption = None,
    changes: shared.SetOption = None,
    sweep: Annotated[
        list[str] | None,
        typer.Option(help="Vary a setting: section.name=value,value,... May be given twice."),
    ] = None,
    resume: shared.ResumeOption = False,
    force: shared.ForceOption = False,
    workers: shared.WorkersOption = None,
    dask: Annotated[
        str | None, typer.Option(help="Dask scheduler, tcp://host:port or a scheduler file.")
    ] = None,
    save_runs: Annotated[
        bool, typer.Option("--save-runs", help="Also save each mission whole, as the mission command does.")
    ] = False,
    quiet: shared.QuietOption = False,
    as_json: shared.JsonOption = False,
) -> None:
    """Run many missions with consecutive seeds, and summarise them."""
    from auvplan.study import Design, Sweep, summarise

    settings, folder = shared.load(scenario, preset, objective, settings=changes)
    design = Design(settings, count, seed, tuple(Sweep.parse(text) for text in sweep or ()))
    how = {"resume": resume, "force": force, "workers": workers, "dask": dask, "save_runs": save_runs}
    dataset = run_with_bar(design, out, quiet, folder=folder, **how)
    from auvplan.report import write_study_report

    page = write_study_report(out)
    summary = summarise(dataset)
    cases = summary.get("cases", [summary])
    if as_json:
        shared.print_json(summary | {"folder": str(out)})
    elif not quiet:
        for case in cases:
            shared.console.print(_table(case))
        shared.console.print(f"results: {out / 'missions.nc'}, {out / 'summary.json'}", soft_wrap=True)
        shared.console.print(f"pictures: auvplan plot {out}", soft_wrap=True)
        shared.name_page(page)
    failed = sum(case["missions"] - case["on_time"] for case in cases)
    if failed:
        named = "; ".join(_failed(case) for case in cases if case["failed_seeds"])
        shared.print_error(f"{counted(failed, 'mission')} failed: {named}")
        raise typer.Exit(1)


def _setting(case: dict[str, Any]) -> str:
    """Return what a case of a sweep has of its own, in words; none of other studies."""
    return ", ".join(f"{field} = {value}" for field, value in case.get("setting", {}).items())


def _failed(case: dict[str, Any]) -> str:
    """Return which missions of a case failed, in words."""
    seeds, setting = case["failed_seeds"], _setting(case)
    named = f"{'seed' if len(seeds) == 1 else 'seeds'} {', '.join(map(str, seeds))}"
    return f"{named} at {setting}" if setting else named


def _table(case: dict[str, Any]) -> Table:
    """Return the figures of one case."""
    from auvplan.study.statistics import DESCRIBED

    setting = _setting(case)
    share, title = case["on_time_percent"], f"{setting}\n" if setting else ""
    title += f"{case['on_time']:,} of {counted(case['missions'], 'mission')} on time "
    title += f"({share['low']:.1f} to {share['high']:.1f} %), {counted(case['collisions'], 'collision')}"
    table = Table(title=title)
    for column in ("figure", "mean", "95 % interval", "5 %", "median", "95 %"):
        table.add_column(column, justify="left" if column == "figure" else "right")
    for name, text in DESCRIBED.items():
        row = case["figures"][name]
        if row:
            known = row["low"] is not None
            interval = f"{figure(row['low'])} to {figure(row['high'])}" if known else ""
            quantiles = (figure(row[key]) for key in ("q05", "median", "q95"))
            table.add_row(text, figure(row["mean"]), interval, *quantiles)
    legs = case["expected_against_executed"]
    if legs["correlation"] is not None:
        interval = f"{legs['low']:.2f} to {legs['high']:.2f}"
        median = f"{legs['median_relative_error_percent']:.2f}"
        table.add_row("|T_path / t_ij - 1|, %", "", interval, "", median, "")
        found = f"correlation of T_path with t_ij {legs['correlation']:.4f}"
        table.caption = f"{found}, {counted(legs['legs'], 'leg')}"
    return table


def run_with_bar(design: "Design", out: Path, quiet: bool, **options: Any) -> "xr.Dataset":
    """Run a study with a bar; where it is interrupted, say how to continue. Options as `run_study`."""
    from auvplan.study import run_study
    from auvplan.study.store import is_unfinished

    begun: list[tuple[float, float]] = []

    def advance(done: int, total: int, share: float) -> None:
        if not begun and share > 0.0:  # programs are compiled, and missions under way
            begun.append((share, time.monotonic()))
        gone, elapsed = (share - begun[0][0], time.monotonic() - begun[0][1]) if begun else (0.0, 0.0)
        text = f"{done:,} of {counted(total, 'mission')}"
        if gone > 0.0 and elapsed > _JUDGED and share < 1.0:
            left = (1.0 - share) * elapsed / gone
            minutes = round(left / 60.0)
            wait = f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
            wait = f"{left:.0f} s" if left < 60.0 else wait
            text += f", {figure((total - done) / left, 2)} a second, {wait} left"
        move(share, text)

    try:
        with shared.progress_bar("compiling", quiet, of=None) as move:
            return run_study(design, out, progress=advance, **options)
    except KeyboardInterrupt:
        text = "interrupted: the same command with --resume goes on from there"
        raise KeyboardInterrupt(text if is_unfinished(out) else "interrupted") from None
