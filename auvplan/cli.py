"""Commands: plan a mission, a path, many missions; look at a chart; check a result."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Mission and path planning for autonomous underwater vehicles in a moving sea.",
    pretty_exceptions_enable=False,
)
console = Console()
errors = Console(stderr=True)

ScenarioArgument = Annotated[
    str,
    typer.Argument(help="A scenario file (YAML), or the name of a shipped scenario.", metavar="[SCENARIO]"),
]
OutOption = Annotated[Path, typer.Option("--out", help="Folder for results; made where missing.")]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of world, sensors and planners.")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]
PresetOption = Annotated[str | None, typer.Option("--preset", help="Planner settings: paper or default.")]
ObjectiveOption = Annotated[
    str | None, typer.Option("--objective", help="What the order of tasks is judged by: priority or eq15.")
]


def _load(source: str, preset: str | None, objective: str | None, leg: bool = False) -> tuple[Any, Path]:
    """The scenario with the command line's settings in place of its own, and the folder of its file."""
    from auvplan.io.scenario_file import load_scenario, validate_scenario

    plain = load_scenario(source).model_dump(mode="json")
    if preset is not None:
        plain["planning"]["preset"] = preset
    if objective is not None:
        plain["planning"]["objective"] = objective
    if leg:
        plain["mission"]["waypoints"] = 2
    folder = Path(source).parent if Path(source).is_file() else Path(".")
    return validate_scenario(plain, "command line"), folder


@app.command()
def mission(
    scenario: ScenarioArgument = "whitsunday",
    out: OutOption = Path("out/mission"),
    seed: SeedOption = 0,
    preset: PresetOption = None,
    objective: ObjectiveOption = None,
    quiet: QuietOption = False,
    certify: Annotated[
        bool, typer.Option("--certify", help="Also say how far the first order can be from the best.")
    ] = False,
) -> None:
    """Plan a whole mission, sail it in the simulator and draw it."""
    run = _run(*_load(scenario, preset, objective), out, seed, quiet)
    if certify:
        _print_certificate(run.first_order)
    _exit_where_failed(run)


@app.command()
def path(
    scenario: ScenarioArgument = "whitsunday",
    out: OutOption = Path("out/path"),
    seed: SeedOption = 0,
    preset: PresetOption = None,
    quiet: QuietOption = False,
) -> None:
    """Plan one leg, from the scenario's start to its goal, and sail it with re-planning windows."""
    _exit_where_failed(_run(*_load(scenario, preset, None, leg=True), out, seed, quiet))


def _run(scenario: Any, folder: Path, out: Path, seed: int, quiet: bool) -> Any:
    """Run one mission, write its results and print its summary."""
    from auvplan.io import output_folder, save_run

    output_folder(out)
    import jax

    from auvplan.plot import draw_run
    from auvplan.voyage import run_mission

    available = scenario.mission.time_available
    with _bar("compiling the planners", available, quiet) as advance:
        run = run_mission(
            scenario,
            key=jax.random.key(seed),
            seed=seed,
            folder=folder,
            progress=lambda _, now, doing: advance(now, doing),
        )
    save_run(run, out)
    pictures = draw_run(run, out)
    if not quiet:
        _print_summary(run.summary())
        console.print("pictures:", *(f"  {picture}" for picture in pictures), sep="\n", soft_wrap=True)
    return run


def _exit_where_failed(run: Any) -> None:
    if not run.success:
        errors.print(f"auvplan: mission failed: {run.reason}", soft_wrap=True, highlight=False)
        raise typer.Exit(1)


def _print_certificate(order: Any) -> None:
    """How far an order of tasks can be from the best, by CP-SAT or else by the bound that is always there."""
    from auvplan.mission import certify

    if order is None or not order.feasible:
        console.print("no order of tasks to certify")
        return
    how = "proved by CP-SAT"
    try:
        order = certify(order, time_limit=30.0)
    except ImportError as missing:
        how = f"linear bound; for a proof: {missing}"
    console.print(
        f"first order: total priority {order.priority:g}, none has more than {order.bound:g}: "
        f"gap {order.gap:.1%} ({how})",
        soft_wrap=True,
    )


def _print_summary(summary: dict[str, Any]) -> None:
    table = Table(
        title=f"{summary['scenario']}, seed {summary['seed']}: {summary['reason']}", show_header=False
    )
    table.add_row("mission time", f"{summary['t_mission']:.0f} s of {summary['t_available']:.0f} s")
    table.add_row("time left", f"{summary['t_residual']:.0f} s")
    table.add_row("tasks, total priority", f"{summary['tasks']}, {summary['total_priority']:g}")
    table.add_row("path calls, path re-plans", f"{summary['path_calls']}, {summary['path_replans']}")
    table.add_row("mission re-plans", str(summary["mission_replans"]))
    table.add_row("collisions", str(summary["collisions"]))
    cpu = summary["cpu"]
    table.add_row("planning time", f"paths {cpu['path_s']:.2f} s, orders {cpu['mission_s']:.2f} s")
    table.add_row("first calls, compilation", f"{cpu['compile_s']:.1f} s")
    console.print(table)


@app.command()
def montecarlo(
    scenario: ScenarioArgument = "whitsunday",
    count: Annotated[int, typer.Option("-n", min=1, help="Number of missions.")] = 100,
    out: OutOption = Path("out/montecarlo"),
    seed: SeedOption = 0,
    preset: PresetOption = None,
    objective: ObjectiveOption = None,
    quiet: QuietOption = False,
) -> None:
    """Run many missions in lockstep, of seeds that count up, and report their statistics."""
    import json

    from auvplan.io import output_folder, write_atomically

    settings, folder = _load(scenario, preset, objective)
    output_folder(out)
    from auvplan.voyage.montecarlo import monte_carlo, statistics

    clocks = [0.0] * count
    with _bar("compiling the planners", settings.mission.time_available, quiet) as advance:

        def progress(mission: int, now: float, _: str) -> None:
            clocks[mission] = now
            advance(sum(clocks) / count, f"{count} missions")

        runs = monte_carlo(settings, count, seed=seed, folder=str(folder), progress=progress)
    report = statistics(runs)
    target = out / "summary.json"
    text = json.dumps(report, indent=2) + "\n"
    write_atomically(target, lambda part: part.write_text(text, encoding="utf-8"))
    if not quiet:
        table = Table(
            title=f"{report['success']} of {count} missions on time, {report['collisions']} collisions"
        )
        for column in ("figure", "mean", "std", "5 %", "median", "95 %"):
            table.add_column(column, justify="left" if column == "figure" else "right")
        for name, row in report["figures"].items():
            table.add_row(name, *(f"{value:.4g}" for value in row.values()))
        console.print(table)
        console.print(f"results: {target}", soft_wrap=True)
    if report["success"] < count:
        errors.print(f"auvplan: {count - report['success']} missions failed, seeds {report['failed_seeds']}")
        raise typer.Exit(1)


@app.command()
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


@app.command()
def check(
    folder: Annotated[Path, typer.Argument(help="Folder of a result.")], quiet: QuietOption = False
) -> None:
    """Check a result independently: walk every sailed metre, re-add every second."""
    from auvplan.io.check import check_run

    report = check_run(folder)
    if not quiet:
        console.print(str(report), highlight=False, soft_wrap=True)
    if not report.ok:
        raise typer.Exit(1)


@app.command()
def scenarios() -> None:
    """List the shipped scenarios."""
    from auvplan.io.scenario_file import shipped_scenarios

    table = Table(show_header=True)
    table.add_column("name")
    table.add_column("what it is")
    for name, scenario in shipped_scenarios().items():
        table.add_row(name, scenario.description)
    console.print(table)


@contextmanager
def _bar(title: str, total: float, quiet: bool) -> Iterator[Callable[[float, str], None]]:
    """A progress bar over mission time, or nothing at all; yields `advance(now, doing)`, which moves it."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} % of mission time"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=errors, disable=quiet, transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda now, doing: bar.update(task, completed=now, description=doing)


def _enable_compilation_cache() -> None:
    """Keep compiled programs in the user's cache directory, unless AUVPLAN_CACHE says off."""
    choice = os.environ.get("AUVPLAN_CACHE", "")
    if choice.lower() in ("off", "0", "no"):
        return
    import jax

    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    jax.config.update("jax_compilation_cache_dir", choice or str(base / "auvplan" / "jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)


def main() -> None:
    """Entry point: bad input is one line and exit status 2."""
    _enable_compilation_cache()
    from auvplan.io import OutputError
    from auvplan.io.check import ResultError
    from auvplan.ocean.chart import ChartError
    from auvplan.voyage import ScenarioError

    try:
        app()
    except (ScenarioError, ChartError, OutputError, ResultError) as error:
        errors.print(f"auvplan: {error}", soft_wrap=True, highlight=False, markup=False)
        sys.exit(2)


if __name__ == "__main__":
    main()
