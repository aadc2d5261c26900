"""What the commands share: the console, options, the loading of scenarios, progress bars."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from auvplan.errors import ScenarioError
from auvplan.plot.painter import Pictures

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
PicturesOption = Annotated[
    Pictures, typer.Option("--pictures", help="All of them, that of the mission alone, or none.")
]
ObjectiveOption = Annotated[
    str | None, typer.Option("--objective", help="What the order of tasks is judged by: priority or eq15.")
]


def load(source: str, preset: str | None, objective: str | None, leg: bool = False) -> tuple[Any, Path]:
    """The scenario with the command line's settings in place of its own, and the folder of its file."""
    from auvplan.io.scenario_file import load_scenario, validate_scenario

    plain = load_scenario(source).model_dump(mode="json")
    if preset is not None:
        plain["planning"]["preset"] = preset
    if objective is not None:
        plain["planning"]["objective"] = objective
    if leg:
        plain["mission"] |= {"waypoints": 2, "jobs": None}
    folder = Path(source).parent if Path(source).is_file() else Path(".")
    return validate_scenario(plain, "command line"), folder


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Put the scenario's name before what is wrong with it where the message does not have it."""
    try:
        yield
    except ScenarioError as error:
        raise error if source in str(error) else ScenarioError(f"{source}: {error}") from None


@contextmanager
def time_bar(title: str, total: float, quiet: bool) -> Iterator[Callable[[float, str], None]]:
    """A progress bar over mission time, or nothing at all; yields `advance(now, doing)`, which moves it."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} % of mission time"),
        TimeElapsedColumn(),
    )
    from auvplan.compiled import listening

    told: list[str] = []

    def compiling(begun: int, done: int) -> None:
        if quiet:
            return
        if not told:
            told.append("once")
            bar.console.print(
                "compiling programs for this kind of scenario: up to a minute, once", highlight=False
            )
        if done < begun:
            bar.update(task, description=f"compiling, {done} programs done")

    with Progress(*columns, console=errors, disable=quiet, transient=True) as bar:
        task = bar.add_task(title, total=total)
        with listening(compiling):
            yield lambda now, doing: bar.update(task, completed=now, description=doing)
