"""What the commands share: the console, options, the loading of scenarios, progress bars."""

import json
import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Annotated, Any, Literal

import typer
from rich.console import Console
from rich.table import Table

from auvplan.errors import ScenarioError
from auvplan.plot.painter import Pictures
from auvplan.runtime import MAX_SEED
from auvplan.runtime.formatting import counted

console = Console()
errors = Console(stderr=True)
#: Columns of a table that is not written to a terminal: long names and reasons stay on few lines.
_WIDTH = 160
#: s, between two lines of progress in a log.
APART = 10.0
#: What was warned of, which notes need not repeat.
warned: set[str] = set()

ScenarioArgument = Annotated[
    str,
    typer.Argument(help="A scenario file (YAML), or the name of a shipped scenario.", metavar="[SCENARIO]"),
]
OutOption = Annotated[Path, typer.Option("--out", help="Folder for results; created if needed.")]
SeedOption = Annotated[
    int, typer.Option("--seed", min=0, max=MAX_SEED, help="Seed of world, sensors and planners.")
]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object instead.")]
PresetOption = Annotated[str | None, typer.Option("--preset", help="Planner settings: paper or default.")]
PicturesOption = Annotated[
    Pictures, typer.Option("--pictures", help="All of them, that of the mission alone, or none.")
]
ObjectiveOption = Annotated[
    str | None, typer.Option("--objective", help="Objective of the route: priority or eq15.")
]
#: Called with the share of the work that is done, None where it is not known, and words for it.
Advance = Callable[[float | None, str], None]

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="SECTION.FIELD=VALUE",
        help="Another value of the scenario's setting, such as vehicle.speed=2. May be given several times.",
    ),
]
BoundsOption = Annotated[
    bool,
    typer.Option("--bounds", help="Also say how much longer than the quickest possible the paths can be."),
]
ResumeOption = Annotated[
    bool, typer.Option("--resume", help="Continue the study in the folder, or extend it with more missions.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace the study in the folder.")]
WorkersOption = Annotated[
    int | None, typer.Option("--workers", min=1, help="Processes on this machine; one a core if absent.")
]
#: What a vehicle's speed is measured against.
SpeedHeld = Literal["ground", "water"]


def load(
    source: str,
    preset: str | None = None,
    objective: str | None = None,
    leg: bool = False,
    settings: Iterable[str] | None = None,
) -> tuple[Any, Path]:
    """Return the scenario with the command line's settings in place of its own, and the folder of its file.

    Args:
        source: path or name of the scenario.
        preset, objective: as the options of these names have them.
        leg: whether it is to be one leg, from start to goal.
        settings: texts "section.field=value" of `--set`; they count more than the other options.

    Raises:
        ScenarioError: one line that names the file or the option, the field and what is wrong.
    """
    from auvplan.scenario.file import read_scenario

    options = {"planning.preset": ("--preset", preset), "planning.objective": ("--objective", objective)}
    changes = {field: value for field, (_, value) in options.items() if value is not None}
    named = {field: options[field][0] for field in changes}
    for text in settings or ():
        field, value = _setting(text)
        if named.get(field) == "--set":
            raise ScenarioError(f"--set: {field} is given twice")
        changes[field], named[field] = value, "--set"
    if leg:
        changes |= {"mission.waypoints": 2, "mission.jobs": None}
    folder = Path(source).parent if Path(source).is_file() else Path(".")
    return read_scenario(source, changes, named), folder


def _setting(text: str) -> tuple[str, Any]:
    """Return field and value of "section.field=value", whose value is YAML."""
    from auvplan.scenario.yaml_lines import YamlError, read_yaml

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


def say(text: str) -> None:
    """Print without colours for numbers, folds, and meanings of brackets and colons."""
    console.print(text, highlight=False, soft_wrap=True, markup=False, emoji=False)


def wide_console() -> Console:
    """Return where wide tables are printed."""
    return console if console.is_terminal else Console(width=_WIDTH)


def say_notes(notes: Iterable[str]) -> None:
    """Print what was assumed or left out, a line each."""
    for note in notes:
        if note not in warned:
            say(f"note: {note}")


def bounded(changes: list[str] | None, wanted: bool) -> list[str] | None:
    """Return what `--set` changes, with what `--bounds` asks for."""
    return [*(changes or []), "planning.lower_bounds=true"] if wanted else changes


def print_error(text: str) -> None:
    """Print a line on standard error; names in it may look like markup or, as :100: in a place, emoji."""
    errors.print(f"auvplan: {text}", soft_wrap=True, highlight=False, markup=False, emoji=False)


def print_facts(title: str | None, facts: Iterable[tuple[str, str]]) -> None:
    """Print names and values as a table."""
    table = Table(title=title, show_header=False)
    for fact in facts:
        table.add_row(*fact)
    console.print(table)


def list_files(what: str, files: Iterable[Path]) -> None:
    """Print where files were written, a line each."""
    console.print(f"{what}:", *(f"  {file}" for file in files), sep="\n", soft_wrap=True)


def name_page(page: Path) -> None:
    """Say which page shows the result."""
    say(f"open {page}")


def print_json(data: Any) -> None:
    """Print one JSON object and nothing else; what is no number, such as no clearance at all, is null."""
    finite = json.loads(json.dumps(data), parse_constant=lambda _: None)
    typer.echo(json.dumps(finite, indent=2, allow_nan=False))


@contextmanager
def progress_bar(title: str, quiet: bool, of: str | None = "") -> Iterator[Advance]:
    """Show how far a command has come on standard error: a bar on a terminal, else plain lines.

    That programs are compiled is said once. `of` is what the percentage is of; None for no percentage.

    Yields:
        `advance(share, text)`, which moves it.
    """
    if quiet:
        yield lambda share, text: None
        return
    from auvplan.runtime.compiled import listening

    share_done, announced = None, False
    shown = _bar if errors.is_terminal and not errors.is_dumb_terminal else _lines
    with shown(title, of) as move:

        def advance(share: float | None, text: str) -> None:
            nonlocal share_done
            share_done = share
            move(share, text)

        def compiling(begun: int, done: int) -> None:
            nonlocal announced
            if not announced:
                announced = True
                line = "compiling programs for this kind of scenario: up to a minute, once"
                errors.print(line, highlight=False)
            if done < begun:
                move(share_done, f"compiling, {counted(done, 'program')} done")

        with listening(compiling):
            yield advance


@contextmanager
def _bar(title: str, of: str | None) -> Iterator[Advance]:
    """Progress as a bar, on a terminal."""
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = [SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()]
    if of is not None:
        columns.insert(3, TextColumn(f"{{task.percentage:>3.0f}} % {of}".rstrip()))
    with Progress(*columns, console=errors, transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda share, text: bar.update(
            task, completed=share, total=None if share is None else 1.0, description=text
        )


@contextmanager
def _lines(title: str, of: str | None) -> Iterator[Advance]:
    """Progress as plain lines, for logs: one a tenth of the work or a minute, at least `APART` s apart."""
    now_at, ended = (0.0, title), Event()

    def move(share: float | None, text: str) -> None:
        nonlocal now_at
        percent = "" if share is None or of is None else f", {100.0 * share:.0f} % {of}".rstrip()
        now_at = share or 0.0, text + percent

    def report() -> None:
        stated, when, before = "", -math.inf, 0.0
        while not ended.wait(APART):
            (share, text), now = now_at, time.monotonic()
            if text != stated and (share - before >= 0.1 or now - when >= 60.0):
                print_error(text)
                stated, when, before = text, now, share

    thread = Thread(target=report, daemon=True)
    thread.start()
    try:
        yield move
    finally:
        ended.set()
        thread.join()


@contextmanager
def time_bar(title: str, total: float, quiet: bool) -> Iterator[Callable[[float, str], None]]:
    """Progress over mission time, or nothing at all; yields `advance(now, doing)`, which moves it."""
    with progress_bar(title, quiet, "of mission time") as move:
        yield lambda now, doing: move(now / total, doing)
