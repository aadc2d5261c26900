"""Commands for one mission or one leg."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from threading import Thread
from typing import Annotated, Any

import typer

from auvplan.cli import shared
from auvplan.errors import ScenarioError
from auvplan.plot.painter import Painter, Pictures
from auvplan.runtime.formatting import figure


def mission(
    scenario: shared.ScenarioArgument = "whitsunday",
    out: shared.OutOption = Path("out/mission"),
    seed: shared.SeedOption = 0,
    preset: shared.PresetOption = None,
    objective: shared.ObjectiveOption = None,
    changes: shared.SetOption = None,
    quiet: shared.QuietOption = False,
    as_json: shared.JsonOption = False,
    pictures: shared.PicturesOption = Pictures.ALL,
    certify: Annotated[
        bool, typer.Option("--certify", help="Also say how far the first route can be from the best.")
    ] = False,
) -> None:
    """Rehearse a mission once in the simulator, past obstacles that no plan knows of, and draw it.

    `auvplan plan` makes the plan for a vehicle.
    """
    if certify and as_json:
        raise ScenarioError("--certify prints lines: leave out --json")
    settings = {"preset": preset, "objective": objective, "settings": changes}
    _run(scenario, out, seed, quiet, as_json, pictures, certify, **settings)


def path(
    scenario: shared.ScenarioArgument = "whitsunday",
    out: shared.OutOption = Path("out/path"),
    seed: shared.SeedOption = 0,
    preset: shared.PresetOption = None,
    changes: shared.SetOption = None,
    quiet: shared.QuietOption = False,
    as_json: shared.JsonOption = False,
    pictures: shared.PicturesOption = Pictures.ALL,
    bounds: shared.BoundsOption = False,
) -> None:
    """Plan one leg, from the scenario's start to its goal, and simulate it with re-planning windows."""
    settings = {"preset": preset, "settings": shared.bounded(changes, bounds)}
    _run(scenario, out, seed, quiet, as_json, pictures, leg=True, **settings)


def _run(
    source: str,
    out: Path,
    seed: int,
    quiet: bool,
    as_json: bool,
    pictures: Pictures,
    certify: bool = False,
    *,
    leg: bool = False,
    **settings: Any,
) -> None:
    """Run one mission, or one leg, write its results and print its summary; settings as `shared.load`."""
    quiet = quiet or as_json
    with shared.naming(source), Painter(pictures) as painter, ExitStack() as stack:
        scenario, folder = shared.load(source, leg=leg, **settings)
        from auvplan.runtime.compiled import MISSIONS, preload

        preload(MISSIONS, scenario.fingerprint)
        from auvplan.io.area import load_area
        from auvplan.runtime.files import REPORT, whole_result

        area = load_area(scenario, folder)
        if not quiet:
            shared.say_notes(area.notes)
        from auvplan.executive import plan_scenario, run_mission

        partial = stack.enter_context(whole_result(out))
        Thread(target=_load_writers, daemon=True).start()
        available = scenario.mission.time_available
        with shared.time_bar("loading the planners", available, quiet) as advance:
            # The leg of a saw-tooth is planned and not simulated.
            execute: Any = plan_scenario if leg and scenario.vehicle.saw_tooth else run_mission
            run = execute(
                scenario, seed=seed, folder=folder, area=area, progress=lambda *at: advance(*at[-2:])
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
        shared.print_json(run.summary() | {"sheet": sheet})
    elif not quiet:
        title = f"{scenario.name}, seed {seed}: {run.reason}"
        shared.print_facts(title, _facts(run.summary(), sheet["facts"]))
        if drawn:
            shared.list_files("pictures", drawn)
        if pictures != Pictures.NONE:
            shared.name_page(out / REPORT)
    if certify:
        _print_certificate(run.first_route)
    if not run.success:
        shared.print_error(f"mission failed: {run.reason}")
        raise typer.Exit(1)


def _load_writers() -> None:
    """Load what saving needs; beside compiled code that plans, it takes no time."""
    import xarray

    xarray.Dataset({"a": ("n", [0.0])}).to_netcdf(engine="h5netcdf")


def _print_certificate(route: Any) -> None:
    """How far a route can be from the best, by CP-SAT or else by the bound that is always there."""
    from auvplan.mission import certify

    if route is None or not route.feasible:
        shared.console.print("no route to certify")
        return
    how = "proved by CP-SAT"
    try:
        route = certify(route, time_limit=30.0)
    except ImportError as missing:
        how = f"linear bound; for a proof: {missing}"
    shared.console.print(
        f"first route: total priority {figure(route.priority)}, none has more than {figure(route.bound)}: "
        f"gap {route.gap:.1%} ({how})",
        soft_wrap=True,
    )


def _facts(summary: dict[str, Any], facts: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the main figures of a run, from its summary and its sheet."""
    yield "mission time", f"{summary['t_mission']:.0f} s of {summary['t_available']:.0f} s"
    used = f", {summary['reserve_used']:.0f} s of the reserve used" if summary["reserve_used"] else ""
    yield "time left", f"{summary['t_residual']:.0f} s{used}"
    if summary["priority_bound"]:  # one leg has no task
        yield "tasks, total priority", f"{summary['tasks']}, {figure(summary['total_priority'])}"
        yield "bound on total priority", figure(summary["priority_bound"])
    yield "path calls, path re-plans", f"{summary['path_calls']}, {summary['path_replans']}"
    yield "mission re-plans", str(summary["mission_replans"])
    costs = f"{summary['cost_mission']:.1f}, {summary['cost_total']:.1f}"
    yield "mission cost (Eq. 15), total (Eq. 16)", costs
    yield "collisions", str(summary["collisions"])
    if forecast := summary["forecast"]:
        planned, executed = forecast["planned_s"], forecast["executed_s"]
        yield "travel time, planned and simulated", f"{planned:.0f} s, {executed:.0f} s"
        yield "forecast error of the current", f"{forecast['current_difference']:.2f} m/s (rms)"
    yield from ((name, facts[name]) for name in ("in depth", "paths", "energy") if name in facts)
    cpu = summary["cpu"]
    routes = f"routes {cpu['mission_s']:.2f} s, of which re-plans {cpu['mission_replans_s']:.2f} s"
    yield "planning time", f"paths {cpu['path_s']:.2f} s, {routes}"
    yield "compilation", f"{cpu['compile_s']:.1f} s"
