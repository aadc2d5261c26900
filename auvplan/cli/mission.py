"""Commands for one mission or one leg."""

from contextlib import ExitStack
from pathlib import Path
from threading import Thread
from typing import Annotated, Any

import typer
from rich.table import Table

from auvplan.cli.shared import (
    BoundsOption,
    JsonOption,
    ObjectiveOption,
    OutOption,
    PicturesOption,
    PresetOption,
    QuietOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
    bounded,
    complain,
    console,
    load,
    name_page,
    naming,
    print_json,
    say_notes,
    time_bar,
)
from auvplan.errors import ScenarioError
from auvplan.plot.painter import Painter, Pictures
from auvplan.runtime.formatting import figure


def mission(
    scenario: ScenarioArgument = "whitsunday",
    out: OutOption = Path("out/mission"),
    seed: SeedOption = 0,
    preset: PresetOption = None,
    objective: ObjectiveOption = None,
    changes: SetOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
    pictures: PicturesOption = Pictures.ALL,
    certify: Annotated[
        bool, typer.Option("--certify", help="Also say how far the first route can be from the best.")
    ] = False,
) -> None:
    """Rehearse a mission once in the simulator, past obstacles that no plan knows of, and draw it.

    `auvplan plan` makes the plan for a vehicle.
    """
    if certify and as_json:
        raise ScenarioError("--certify prints lines: leave out --json")
    run = _run(scenario, preset, objective, out, seed, quiet, as_json, pictures, changes)
    if certify:
        _print_certificate(run.first_route)
    _exit_where_failed(run)


def path(
    scenario: ScenarioArgument = "whitsunday",
    out: OutOption = Path("out/path"),
    seed: SeedOption = 0,
    preset: PresetOption = None,
    changes: SetOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
    pictures: PicturesOption = Pictures.ALL,
    bounds: BoundsOption = False,
) -> None:
    """Plan one leg, from the scenario's start to its goal, and simulate it with re-planning windows."""
    changes = bounded(changes, bounds)
    run = _run(scenario, preset, None, out, seed, quiet, as_json, pictures, changes, leg=True)
    _exit_where_failed(run)


def _run(
    source: str,
    preset: str | None,
    objective: str | None,
    out: Path,
    seed: int,
    quiet: bool,
    as_json: bool,
    pictures: Pictures,
    changes: list[str] | None,
    leg: bool = False,
) -> Any:
    """Run one mission, or one leg, write its results and print its summary."""
    quiet = quiet or as_json
    with naming(source), Painter(pictures) as painter, ExitStack() as stack:
        scenario, folder = load(source, preset, objective, leg, changes)
        from auvplan.runtime.compiled import MISSIONS, preload

        preload(MISSIONS, scenario.fingerprint)
        from auvplan.io.area import load_area
        from auvplan.runtime.files import REPORT, whole_result

        area = load_area(scenario, folder)
        if not quiet:
            say_notes(area.notes)
        from auvplan.executive import run_mission

        partial = stack.enter_context(whole_result(out))
        Thread(target=_load_writers, daemon=True).start()
        available = scenario.mission.time_available
        with time_bar("loading the planners", available, quiet) as advance:
            run = run_mission(
                scenario,
                seed=seed,
                folder=folder,
                area=area,
                progress=lambda _, now, doing: advance(now, doing),
            )
        painter.begin(run, partial)
        from auvplan.io import save_run
        from auvplan.view.sheet import sheet_of

        sheet = sheet_of(run).plain()
        save_run(run, partial, sheet=sheet)
        if pictures != Pictures.NONE:
            from auvplan.report import write_run_report

            write_run_report(run, run.summary() | {"sheet": sheet}, partial)
        drawn = [out / picture.name for picture in painter.finish()]
    if as_json:
        print_json(run.summary() | {"sheet": sheet})
    elif not quiet:
        _print_summary(run.summary(), sheet["facts"])
        if drawn:
            console.print("pictures:", *(f"  {picture}" for picture in drawn), sep="\n", soft_wrap=True)
        if pictures != Pictures.NONE:
            name_page(out / REPORT)
    return run


def _load_writers() -> None:
    """Load what saving needs; beside compiled code that plans, it takes no time."""
    import xarray

    xarray.Dataset({"a": ("n", [0.0])}).to_netcdf(engine="h5netcdf")


def _exit_where_failed(run: Any) -> None:
    if not run.success:
        complain(f"mission failed: {run.reason}")
        raise typer.Exit(1)


def _print_certificate(route: Any) -> None:
    """How far a route can be from the best, by CP-SAT or else by the bound that is always there."""
    from auvplan.mission import certify

    if route is None or not route.feasible:
        console.print("no route to certify")
        return
    how = "proved by CP-SAT"
    try:
        route = certify(route, time_limit=30.0)
    except ImportError as missing:
        how = f"linear bound; for a proof: {missing}"
    console.print(
        f"first route: total priority {figure(route.priority)}, none has more than {figure(route.bound)}: "
        f"gap {route.gap:.1%} ({how})",
        soft_wrap=True,
    )


def _print_summary(summary: dict[str, Any], facts: dict[str, str]) -> None:
    table = Table(
        title=f"{summary['scenario']}, seed {summary['seed']}: {summary['reason']}", show_header=False
    )
    table.add_row("mission time", f"{summary['t_mission']:.0f} s of {summary['t_available']:.0f} s")
    used = f", {summary['reserve_used']:.0f} s of the reserve used" if summary["reserve_used"] else ""
    table.add_row("time left", f"{summary['t_residual']:.0f} s{used}")
    if summary["priority_bound"]:  # one leg has no task
        table.add_row("tasks, total priority", f"{summary['tasks']}, {figure(summary['total_priority'])}")
        table.add_row("bound on total priority", figure(summary["priority_bound"]))
    table.add_row("path calls, path re-plans", f"{summary['path_calls']}, {summary['path_replans']}")
    table.add_row("mission re-plans", str(summary["mission_replans"]))
    costs = f"{summary['cost_mission']:.1f}, {summary['cost_total']:.1f}"
    table.add_row("mission cost (Eq. 15), total (Eq. 16)", costs)
    table.add_row("collisions", str(summary["collisions"]))
    if forecast := summary["forecast"]:
        planned, executed = forecast["planned_s"], forecast["executed_s"]
        table.add_row("travel time, planned and simulated", f"{planned:.0f} s, {executed:.0f} s")
        table.add_row("forecast error of the current", f"{forecast['current_difference']:.2f} m/s (rms)")
    for name in ("in depth", "paths"):
        if name in facts:
            table.add_row(name, facts[name])
    cpu = summary["cpu"]
    routes = f"routes {cpu['mission_s']:.2f} s, of which re-plans {cpu['mission_replans_s']:.2f} s"
    table.add_row("planning time", f"paths {cpu['path_s']:.2f} s, {routes}")
    table.add_row("compilation", f"{cpu['compile_s']:.1f} s")
    console.print(table)
