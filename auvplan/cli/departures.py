"""The command that says when to leave."""

import csv
import io
import math
import warnings
from dataclasses import asdict
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.table import Table

from auvplan.cli import shared
from auvplan.errors import ScenarioError
from auvplan.runtime.files import (
    DEPARTED,
    DEPARTURES,
    output_folder,
    require_kind,
    write_atomically,
    write_json,
)
from auvplan.runtime.formatting import counted, figure

#: Departures at most, and s from the scenario's own that missions reach: single precision has no more.
_MOST = 500
_FARTHEST = 2.0**24


def departures(
    scenario: shared.ScenarioArgument = "whitsunday",
    begin: Annotated[
        str,
        typer.Option(
            "--from",
            help="First departure: a date and time (UTC unless it says otherwise), or hours after the "
            "scenario's departure, such as 3 or +3h.",
        ),
    ] = "0",
    end: Annotated[str, typer.Option("--to", help="Last departure, as --from.")] = "12",
    step: Annotated[
        str, typer.Option("--step", help="Between departures, such as 30min, 1h or 900s.")
    ] = "1h",
    least: Annotated[
        Literal["time", "energy"],
        typer.Option("--least", help="What the best departure has least of, among those of most priority."),
    ] = "time",
    out: shared.OutOption = Path("out/departures"),
    seed: shared.SeedOption = 0,
    changes: shared.SetOption = None,
    quiet: shared.QuietOption = False,
    as_json: shared.JsonOption = False,
) -> None:
    """Plan the mission, or the leg of two waypoints, at many departures and say which is the best."""
    settings, folder = shared.load(scenario, settings=changes)
    departs = departure_times(settings, folder, begin, end, step)
    from auvplan.executive.departures import plan_departures
    from auvplan.executive.loop import seed_keys
    from auvplan.executive.planning import load_area_at
    from auvplan.scenario.provenance import source_files

    area = load_area_at(settings, departs, folder)
    if not quiet and not as_json:
        shared.say_notes(area.notes)
    require_kind(out, "departures")
    output_folder(out)
    from auvplan.plot.departures import plot_departures
    from auvplan.plot.style import save
    from auvplan.report import write_departures_report

    key = seed_keys([seed])[0]
    with shared.progress_bar("compiling the planners", quiet, of=None) as move:

        def progress(done: int, total: int, doing: str) -> None:
            known = 0 < done < total  # not where one call plans them all
            text = f"{doing}, {done} of {counted(total, 'departure')}" if known else doing
            move(done / total if known else None, text)

        known = {"folder": folder, "area": area, "progress": progress}
        found = plan_departures(settings, departs, key=key, least=least, **known)
    rows, plain = _rows(found), settings.model_dump(mode="json")
    origin = {
        "scenario": plain,
        "seed": seed,
        "least": least,
        "versions": {"auvplan": version("auvplan")},
        "files": [asdict(file) for file in source_files(plain, folder)],
        "notes": list(area.notes),
    }
    files = [
        _write_csv(rows, out / DEPARTURES),
        write_json(out / DEPARTED, origin),
        save(plot_departures(found), out / "departures.png"),
        write_departures_report(out),
    ]
    if as_json:
        shared.print_json(
            {
                "scenario": settings.name,
                "seed": seed,
                "feasible": int(found.feasible.sum()),
                "best": found.best,
                "departures": rows,
                "notes": list(area.notes),
                "files": [str(file) for file in files],
            }
        )
    elif not quiet:
        shared.wide_console().print(_table(found, f"{settings.name}, seed {seed}"))
        shared.list_files("files", files)
        shared.name_page(files[-1])
    if found.best is None:
        shared.print_error(f"no departure is feasible; {found.moment(0)}: {found.reasons[0]}")
        raise typer.Exit(1)


def departure_times(settings: Any, folder: Path, begin: str, end: str, step: str) -> list[float]:
    """Departures, s since the scenario's epoch, from the texts of the options.

    Raises:
        ScenarioError: an option cannot be understood or is out of range; the line names it.
    """
    first, last = (
        departure_seconds(name, text, settings, folder) for name, text in (("--from", begin), ("--to", end))
    )
    apart = _duration(step)
    if apart is None or not apart > 0.0:
        raise ScenarioError(f"--step {step!r} must be a duration above 0, such as 30min, 1h or 900s")
    if first < 0.0 and settings.current.source == "vortices":
        raise ScenarioError(
            f"--from {begin!r} lies before the scenario's departure, with which its vortices begin: "
            "set site.departure earlier"
        )
    if first > last:
        raise ScenarioError(f"--from {begin!r} must not be later than --to {end!r}")
    count = math.floor((last - first) / apart + 1e-9) + 1
    if count > _MOST:
        raise ScenarioError(f"--step {step!r} makes {count} departures, more than {_MOST}")
    return [first + k * apart for k in range(count)]


def departure_seconds(option: str, text: str, settings: Any, folder: Path) -> float:
    """Return a departure, s since the scenario's epoch, from the text of an option.

    Raises:
        ScenarioError: it cannot be understood; the line names the option.
    """
    from auvplan.io.area import load_area
    from auvplan.site import as_utc

    seconds = _duration(text)
    if seconds is None:
        try:
            moment = as_utc(datetime.fromisoformat(text.strip()))
        except (ValueError, OverflowError):
            raise ScenarioError(
                f"{option} {text!r} is neither a date and time such as 2026-03-01T06:00 "
                "nor hours after the scenario's departure such as 3 or +3h"
            ) from None
        epoch = None if settings.site is None else settings.site.departure
        if epoch is None and settings.current.source == "file":
            site = load_area(settings, folder).site
            epoch = None if site is None else site.epoch
        if epoch is None:
            raise ScenarioError(
                f"{option} {text!r}: the scenario has no date, set site.departure or give hours such as +3h"
            )
        seconds = (moment - epoch).total_seconds()
    if not abs(seconds) + settings.mission.time_available < _FARTHEST:
        raise ScenarioError(
            f"{option} {text!r} lies too far from the scenario's departure, over 194 days with the time "
            "available: set site.departure nearer"
        )
    return seconds


def _duration(text: str) -> float | None:
    """Return seconds of a number of hours or of a duration with its unit; None where it is neither."""
    import pandas as pd

    try:
        hours = float(text)
    except ValueError:
        pass
    else:
        return None if math.isnan(hours) else hours * 3600.0
    if ":" in text:  # a time of day, and of which day?
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            seconds = pd.to_timedelta(text.strip().lower()).total_seconds()
    except (ValueError, OverflowError):
        return None
    return None if math.isnan(seconds) else seconds


def _rows(found: Any) -> list[dict[str, Any]]:
    """Return what is known of each departure by column; what does not hold of it is None."""
    rows = []
    for k, depart in enumerate(found.departs):
        moment = None if found.site is None else found.site.utc(depart)
        feasible = bool(found.feasible[k])
        row = {
            "departure_utc": None if moment is None else f"{moment:%Y-%m-%dT%H:%M:%SZ}",
            "departure_s": round(float(depart), 3),
            "feasible": feasible,
            "best": k == found.best,
            "time_s": round(float(found.time[k]), 1) if feasible else None,
        }
        if found.plans is None:
            priority = float(found.priority[k])
            whole = int(priority) if priority.is_integer() else priority
            row["tasks"] = int(found.tasks[k]) if feasible else None
            row["total_priority"] = whole if feasible else None
            nodes = found.routes[k] or []
            row["waypoints"] = " > ".join(found.names[node] if found.names else str(node) for node in nodes)
        else:
            clear = float(found.plans.clearance[k])
            row["length_m"] = round(float(found.plans.length[k]), 1) if feasible else None
            row["clearance_m"] = round(clear, 1) if feasible and math.isfinite(clear) else None
        if found.energy is not None:
            row["energy_wh"] = round(float(found.energy[k]), 1) if feasible else None
        rows.append(row | {"current_m_s": round(float(found.current[k]), 3), "reason": found.reasons[k]})
    return rows


def _write_csv(rows: list[dict[str, Any]], path: Path) -> Path:
    """Write a table of departures."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]))
    writer.writeheader()
    for row in rows:
        writer.writerow({name: str(v).lower() if isinstance(v, bool) else v for name, v in row.items()})
    return write_atomically(path, lambda part: part.write_text(text.getvalue(), "utf-8", newline=""))


def _table(found: Any, name: str) -> Table:
    """Return a row for each departure; the best one is marked."""
    leg, all_feasible = found.plans is not None, found.feasible.all()
    table = Table(title=f"{name}: {found.feasible.sum()} of {counted(len(found), 'departure')} feasible")
    figures = ("travel time, s", "length, m", "clearance, m") if leg else ("time, s", "tasks", "priority")
    figures = figures if found.energy is None else (*figures, "energy, Wh")
    table.add_column("departure", no_wrap=True)
    table.add_column("feasible", no_wrap=True)
    for column in figures:
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("current, m/s", justify="right")
    if not all_feasible:
        table.add_column("why not", overflow="fold", min_width=24)
    for k in range(len(found)):
        best, cells = k == found.best, ["no", *[""] * len(figures)]
        if found.feasible[k]:
            rest = str(found.tasks[k]), figure(found.priority[k])
            if leg:
                clear = f"{found.plans.clearance[k]:.0f}".replace("inf", "open")
                rest = f"{found.plans.length[k]:.0f}", clear
            energy = [] if found.energy is None else [f"{found.energy[k]:,.0f}"]
            cells = ["best" if best else "yes", f"{found.time[k]:.0f}", *rest, *energy]
        reason = [] if all_feasible else [found.reasons[k]]
        style = "bold green" if best else None
        table.add_row(found.moment(k), *cells, f"{found.current[k]:.2f}", *reason, style=style)
    return table
