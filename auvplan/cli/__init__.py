"""The command line: plan a mission, a path, many missions; draw a study; look at a chart; check a result."""

import atexit
import gc
import logging
import sys
import warnings
from collections.abc import Callable
from functools import wraps
from importlib.metadata import version
from typing import Annotated, Any

import typer

from auvplan.cli import departures, execute, mission, plan, results, scenario, study, tools, vehicle
from auvplan.cli.shared import print_error, warned
from auvplan.errors import AuvplanError, ScenarioWarning

#: New objects after which garbage is looked for.
_GARBAGE = 20_000


def stoppable(command: Callable[..., None]) -> Callable[..., None]:
    """Let a command end on Ctrl-C with one line, the interruption's own where it has one, and status 130."""

    @wraps(command)
    def run(*arguments: Any, **options: Any) -> None:
        try:
            command(*arguments, **options)
        except KeyboardInterrupt as stop:
            text = str(stop) or "interrupted"
            print_error(text)
            raise typer.Exit(130) from None

    return run


app = typer.Typer(
    add_completion=True,
    no_args_is_help=True,
    help="Mission and path planning for autonomous underwater vehicles in time-varying currents.",
    pretty_exceptions_enable=False,
)
for command in (
    plan.plan,
    plan.promise,
    plan.rehearse,
    mission.mission,
    mission.path,
    departures.departures,
    execute.execute,
    results.export,
    study.montecarlo,
    results.plot,
    results.animate,
    results.report,
    tools.chart,
    tools.currents,
    tools.check,
    scenario.scenarios,
    scenario.init,
    scenario.validate,
    scenario.schema,
):
    app.command()(stoppable(command))
vehicles = typer.Typer(
    no_args_is_help=True, help="Vehicles: what they draw, and laws fitted to measured power."
)
for name, command in (("list", vehicle.list_), ("show", vehicle.show), ("fit", vehicle.fit)):
    vehicles.command(name)(stoppable(command))
app.add_typer(vehicles, name="vehicle")
app.command("cache")(stoppable(tools.kept))
_ANYTHING = {"allow_extra_args": True, "ignore_unknown_options": True}
app.command(hidden=True, context_settings=_ANYTHING)(tools.paper)


def _say_version(asked: bool) -> None:
    if asked:
        typer.echo(f"auvplan {version('auvplan')}")
        raise typer.Exit


@app.callback()
def options(
    _: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="Say what is loaded, stored and left out on the way.")
    ] = False,
) -> None:
    """Options of all commands."""
    if verbose:
        logging.basicConfig(format="auvplan: %(message)s")
        logging.getLogger("auvplan").setLevel(logging.INFO)


def main() -> None:
    """Entry point: bad input is one line and exit status 2, as is what a scenario warns of."""
    usual = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if issubclass(category, ScenarioWarning):
            warned.add(str(message))
            print_error(f"warning: {message}")
        else:
            usual(message, category, *place, **more)

    warnings.showwarning = show
    # Most objects of a command live as long as it: to look through them for garbage so often takes long.
    gc.freeze()
    gc.set_threshold(_GARBAGE)
    atexit.register(gc.freeze)  # nor when the process ends, which frees them all
    try:
        app()
    except AuvplanError as error:
        print_error(" ".join(str(error).split()))  # names of files may hold line breaks
        sys.exit(2)
