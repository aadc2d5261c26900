"""The commands that plan a mission for a vehicle, and say how often the plan holds and how sure it is."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.measure import Measurement
from rich.table import Table

from auvplan.cli import shared
from auvplan.plot.painter import Pictures
from auvplan.runtime.formatting import counted, figure, hours

if TYPE_CHECKING:
    from auvplan.records import MissionRun
    from auvplan.view.sheet import MissionSheet


#: Characters of a name in a table that stay on one line.
_NAME = 12


def plan(
    scenario: shared.ScenarioArgument = "whitsunday",
    out: shared.OutOption = Path("out/plan"),
    depart: Annotated[
        str,
        typer.Option(
            help="Departure: a date and time (UTC unless it says otherwise), or hours after the scenario's "
            "departure, such as 3 or +3h."
        ),
    ] = "0",
    seed: shared.SeedOption = 0,
    preset: shared.PresetOption = None,
    quiet: shared.QuietOption = False,
    pictures: shared.PicturesOption = Pictures.ALL,
    changes: shared.SetOption = None,
    bounds: shared.BoundsOption = False,
    as_json: shared.JsonOption = False,
) -> None:
    """Plan a mission in the forecast and past known obstacles, and write the vehicle's files.

    Nothing is simulated: `auvplan rehearse` says how often the plan holds.
    """
    quiet = quiet or as_json
    from auvplan.cli.departures import departure_seconds
    from auvplan.runtime.files import REPORT, whole_result

    with shared.naming(scenario):
        settings, folder = shared.load(scenario, preset, settings=shared.bounded(changes, bounds))
        now = departure_seconds("--depart", depart, settings, folder)
    from auvplan.runtime.compiled import PLANS, preload

    preload(PLANS, settings.fingerprint)
    from auvplan.executive.planning import load_area_at, plan_scenario

    with shared.naming(scenario), whole_result(out) as partial:
        area = load_area_at(settings, [now], folder)
        if not quiet:
            shared.say_notes(area.notes)
        available = settings.mission.time_available
        with shared.time_bar("loading the planners", available, quiet) as advance:
            run = plan_scenario(
                settings,
                seed=seed,
                depart=now,
                folder=folder,
                area=area,
                progress=lambda when, doing: advance(when - now, doing),
            )
        from auvplan.io import save_run
        from auvplan.view.sheet import sheet_of, write_html

        sheet = sheet_of(run)
        save_run(run, partial, sheet=sheet.plain())
        names = ["mission.png"] if run.legs and pictures != Pictures.NONE else []
        if names:
            if len(run.legs) > 1 and pictures == Pictures.ALL:
                names.append("timeline.png")
            if run.energy is not None and pictures == Pictures.ALL:
                names.append("energy.png")
            from auvplan.plot.run import draw_run
            from auvplan.plot.sheet import write_pdf

            draw_run(run, partial, names)
            write_pdf(sheet, partial / "sheet.pdf")
        write_html(sheet, partial / "sheet.html", "mission.png" if names else None)
        notes: list[str] = []
        left_out: list[str] = []
        if run.success and run.site is None:
            notes.append(
                "no vehicle's file: the scenario has no section site, add one to export geographic formats"
            )
        elif run.success:
            from auvplan.export import export_held, export_notes, itinerary_of

            itinerary = itinerary_of(run)
            held, left_out = export_held(itinerary, partial)
            notes += export_notes(itinerary, held)
        if pictures != Pictures.NONE:
            from auvplan.report import write_run_report

            write_run_report(run, run.summary() | {"sheet": sheet.plain()}, partial)
        written = sorted(file.name for file in partial.iterdir())
    for line in left_out:
        shared.print_error(f"warning: {line}")
    if as_json:
        shared.print_json(run.summary() | {"sheet": sheet.plain()})
    elif not quiet:
        print_sheet(sheet)
        shared.say_notes(notes)
        shared.say(f"files in {out}: {', '.join(written)}")
        if pictures != Pictures.NONE:
            shared.name_page(out / REPORT)
    if not run.success:
        shared.print_error(f"no plan: {run.reason}")
        raise typer.Exit(1)


def print_sheet(sheet: "MissionSheet") -> None:
    """The mission sheet in the terminal."""
    for line in sheet.warnings:
        shared.print_error(f"warning: {line}")
    shared.print_facts(sheet.title, sheet.facts.items())
    headings, rows = sheet.table(brief=True)
    wide, hidden = shared.wide_console(), list[str]()
    unlimited = wide.options.update(max_width=1000)
    while Measurement.get(wide, unlimited, stops := _stops(headings, rows)).minimum > wide.width:
        # A terminal that is too narrow does without what the page has as well, but names every stop.
        hidden.append(headings.pop())
        rows = [row[:-1] for row in rows]
    wide.print(stops)
    if hidden:
        shared.say(f"{', '.join(reversed(hidden))}: in a wider window, and in sheet.html")
    if sheet.left_out:
        left = Table("left out", "priority", "why")
        for job in sheet.left_out:
            left.add_row(job.name, figure(job.priority), job.reason)
        shared.console.print(left)


def _stops(headings: list[str], rows: list[list[str]]) -> Table:
    """Table of stops whose columns are as wide as what they hold, names as far as `_NAME`."""
    table = Table()
    for place, name in enumerate(headings):
        textual = name in ("waypoint", "task")
        longest = max(len(cell) for cell in [name, *(row[place] for row in rows)])
        table.add_column(
            name,
            justify="left" if textual else "right",
            overflow="fold",
            no_wrap=not textual,
            min_width=min(longest, _NAME) if textual else longest,
        )
    for row in rows:
        table.add_row(*row)
    return table


def promise(
    scenario: shared.ScenarioArgument = "whitsunday",
    out: shared.OutOption = Path("out/promise"),
    seed: shared.SeedOption = 0,
    quiet: shared.QuietOption = False,
    changes: shared.SetOption = None,
    as_json: shared.JsonOption = False,
) -> None:
    """Plan a mission more and more surely, and say what it costs to be home in time."""
    quiet = quiet or as_json
    from auvplan.executive.planning import load_area_at, plan_promises
    from auvplan.plot.promise import plot_promises
    from auvplan.plot.style import save
    from auvplan.runtime.files import output_folder, write_json

    with shared.naming(scenario):
        settings, folder = shared.load(scenario, settings=changes)
        area = load_area_at(settings, [0.0], folder)
        if not quiet:
            shared.say_notes(area.notes)
        output_folder(out)
        with shared.progress_bar("planning", quiet, of=None) as move:
            runs = plan_promises(
                settings,
                seed=seed,
                folder=folder,
                area=area,
                progress=lambda done, total: move(done / total, f"planning, {done} of {total} plans"),
            )
    if runs[0].promise is None:
        shared.print_error(f"no plan: {runs[0].reason}")
        raise typer.Exit(1)
    rows = [_promise_row(run, runs[0]) for run in runs]
    write_json(out / "promise.json", {"scenario": settings.name, "seed": seed, "plans": rows})
    picture = save(plot_promises(runs), out / "promise.png")
    if as_json:
        shared.print_json({"scenario": settings.name, "seed": seed, "plans": rows})
    elif not quiet:
        table = Table(title=f"{settings.name}, seed {seed}: home in time, and what it costs")
        for heading in ("home in time, %", "kept back", "priority", "tasks", "takes"):
            table.add_column(heading, justify="right", no_wrap=True)
        for heading in ("gives up", "does instead"):
            table.add_column(heading, overflow="fold")
        for row in rows:
            table.add_row(
                f"{100.0 * row['share']:.1f} [{100.0 * row['low']:.1f} to {100.0 * row['high']:.1f}]",
                f"{100.0 * row['left']:.1f} %",
                figure(row["priority"]),
                str(row["tasks"]),
                hours(row["time_s"]),
                ", ".join(row["gives_up"]) or "nothing",
                ", ".join(row["does_instead"]),
            )
        shared.console.print(table)
        shared.say(f"planning.promise makes `auvplan plan` keep one of these; picture: {picture}")


def _promise_row(run: "MissionRun", first: "MissionRun") -> dict[str, Any]:
    """Return the figures of a plan, and the tasks it gives up and does instead, beside the least sure one."""
    assert run.promise is not None
    own, least = run.completed(run.earning), first.completed(first.earning)
    figures = {"priority": run.total_priority, "tasks": run.tasks, "time_s": run.t_mission}
    gone, come = ([name for name in one if name not in other] for one, other in ((least, own), (own, least)))
    return asdict(run.promise) | figures | {"gives_up": gone, "does_instead": come}


def rehearse(
    scenario: shared.ScenarioArgument = "whitsunday",
    count: Annotated[int, typer.Option("-n", "--missions", min=1, help="Simulated missions.")] = 100,
    out: shared.OutOption = Path("out/rehearse"),
    seed: shared.SeedOption = 0,
    resume: shared.ResumeOption = False,
    force: shared.ForceOption = False,
    workers: shared.WorkersOption = None,
    quiet: shared.QuietOption = False,
    changes: shared.SetOption = None,
    as_json: shared.JsonOption = False,
) -> None:
    """Plan a mission, simulate it many times, and say how often the plan holds."""
    quiet = quiet or as_json
    from auvplan.cli.study import run_with_bar
    from auvplan.executive.planning import plan_scenario
    from auvplan.report import write_study_report
    from auvplan.runtime.files import REHEARSAL, write_json
    from auvplan.study import Design
    from auvplan.study.statistics import rehearsal_of, require_one_sea
    from auvplan.study.store import require_room

    if not (resume or force):
        require_room(out)
    with shared.naming(scenario):
        settings, folder = shared.load(scenario, settings=changes)
        require_one_sea(settings)
        if settings.current.members is not None and not quiet:
            shared.say_notes(
                ["current.members are for promises: rehearsals take the truth from the forecast"]
            )
        with shared.time_bar("planning", settings.mission.time_available, quiet) as advance:
            planned = plan_scenario(settings, seed=seed, folder=folder, progress=advance)
        how = {"resume": resume, "force": force, "workers": workers}
        executed = run_with_bar(Design(settings, count, seed), out, quiet, folder=folder, **how)
    found = rehearsal_of(planned, executed)
    write_json(out / REHEARSAL, found)
    page = write_study_report(out)
    if as_json:
        shared.print_json(found)
    elif not quiet:
        simulated = counted(found["missions"], "simulated mission")
        shared.print_facts(f"{settings.name}: the plan in {simulated}", _facts(found))
        allowance = settings.planning.allowance
        held = [found["on_time"], *(job["come_to"] for job in found["jobs"] if job["planned"])]
        if min(held) < 0.8 * found["missions"]:
            shared.say(
                f"hint: planning.allowance is {allowance:g}; with planning.allowance={allowance + 0.1:g} "
                "less is planned, and more of it holds"
            )
        shared.say(f"figures: {out / REHEARSAL}; missions: {out}")
        shared.name_page(page)


def _facts(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the main figures of a rehearsal."""
    count, share = found["missions"], found["on_time_percent"]
    plan, figures = found["plan"], found["figures"]
    yield "on time", f"{found['on_time']} (95 %: {share['low']:.0f} to {share['high']:.0f} %)"
    yield "on time with all planned tasks done", str(found["all_planned_tasks"])
    tasks, priority = (figures[of]["mean"] for of in ("tasks", "total_priority"))
    yield "tasks, planned and simulated", f"{plan['tasks']}, {tasks:.1f} on average"
    priorities = f"{figure(plan['total_priority'])}, {figure(priority)} on average"
    yield "total priority, planned and simulated", priorities
    for job in found["jobs"]:
        if job["planned"] and job["done"] < count:
            part = "" if job["share"] > 0.995 else f", {100.0 * job['share']:.0f} % of it on average"
            yield f"planned task {job['name']}", f"done in {job['done']}{part}"
    yield "collisions", str(found["collisions"])
    for of, words, unit in (
        ("coast_clearance_m", "least distance to the coast", "m"),
        ("obstacle_clearance_m", "least distance to an obstacle", "m"),
        ("seabed_altitude_m", "least height above the sea bed", "m"),
        ("t_residual_s", "least time left", "s"),
    ):
        if figures[of]:
            yield words, f"{figures[of]['least']:.0f} {unit}"
    for reason, times in Counter(found["failures"]).items():
        yield "failed", f"{times}: {reason}"
