"""What the commands share: the console, options, the loading of scenarios, progress bars."""

from collections.abc import Callable, Iterable, Iterator
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
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="SECTION.FIELD=VALUE",
        help="Another value of the scenario's setting, such as vehicle.speed=2. May be given several times.",
    ),
]


def load(
    source: str,
    preset: str | None = None,
    objective: str | None = None,
    leg: bool = False,
    settings: Iterable[str] | None = None,
) -> tuple[Any, Path]:
    """The scenario with the command line's settings in place of its own, and the folder of its file.

    Args:
        source: path or name of the scenario.
        preset, objective: as the options of these names have them.
        leg: whether it is to be one leg, from start to goal.
        settings: texts "section.field=value" of `--set`; they count more than the other options.

    Raises:
        ScenarioError: one line that names the file or the option, the field and what is wrong.
    """
    from auvplan.io.scenario_file import change_scenario, read_scenario

    changes: dict[str, Any] = {}
    options: dict[str, str] = {}
    for option, field, value in (
        ("--preset", "planning.preset", preset),
        ("--objective", "planning.objective", objective),
    ):
        if value is not None:
            changes[field], options[field] = value, option
    for text in settings or ():
        field, value = _setting(text)
        if options.get(field) == "--set":
            raise ScenarioError(f"--set: {field} is given twice")
        changes[field], options[field] = value, "--set"
    if leg:
        changes |= {"mission.waypoints": 2, "mission.jobs": None}
    folder = Path(source).parent if Path(source).is_file() else Path(".")
    return change_scenario(read_scenario(source), changes, "command line", options), folder


def _setting(text: str) -> tuple[str, Any]:
    """Field and value of "section.field=value", whose value is YAML.

    Raises:
        ScenarioError: the text has not this form.
    """
    from auvplan.io.yaml_lines import YamlError, read_yaml

    field, mark, given = text.partition("=")
    if not mark or not field.strip():
        raise ScenarioError(f"--set {text!r}: give it as section.field=value, such as vehicle.speed=2")
    try:
        document = read_yaml(given)
    except YamlError as error:
        raise ScenarioError(f"--set {text!r}: the value is not YAML: {error}") from None
    if document.faults:
        raise ScenarioError(f"--set {text!r}: {document.faults[0][1]}")
    return field.strip(), document.data


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Put the scenario's name before what is wrong with it where the message does not have it."""
    try:
        yield
    except ScenarioError as error:
        named = source in str(error) or str(error).startswith("--")
        raise error if named else ScenarioError(f"{source}: {error}") from None


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
