"""Commands for scenario files: what is shipped, an example, a schema, what is wrong with one."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from auvplan.cli.shared import JsonOption, console, print_json
from auvplan.errors import ScenarioError
from auvplan.words import counted

if TYPE_CHECKING:
    from auvplan.io.examine import Examination


def scenarios() -> None:
    """List the shipped scenarios."""
    from auvplan.scenario.file import shipped_scenarios

    table = Table(show_header=True)
    table.add_column("name")
    table.add_column("what it is")
    for name, scenario in shipped_scenarios().items():
        table.add_row(name, scenario.description)
    console.print(table)


def init(
    folder: Annotated[Path, typer.Argument(help="Folder for the example; created if needed.")],
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there.")] = False,
) -> None:
    """Write an example that runs as it is: a commented scenario, and the files that it names."""
    from auvplan.io.example import SCENARIO, write_example

    written = write_example(folder, force)
    for path in written:
        typer.echo(f"wrote {path}")
    scenario = folder / SCENARIO
    typer.echo(f"check: auvplan validate {scenario}")
    typer.echo(f"plan:  auvplan plan {scenario} --out {folder / 'out'}")
    typer.echo(f"then change {scenario}: every field is explained there; auvplan schema tells them all")


def schema(
    out: Annotated[Path | None, typer.Option("--out", help="File to write; printed if absent.")] = None,
) -> None:
    """Print the JSON Schema of scenario files: fields, units, defaults and limits, for editors."""
    from auvplan.files import write_atomically
    from auvplan.scenario.file import scenario_schema

    text = json.dumps(scenario_schema(), indent=2) + "\n"
    if out is None:
        typer.echo(text, nl=False)
    else:
        write_atomically(out, lambda part: part.write_text(text, encoding="utf-8"))


def validate(
    scenario: Annotated[
        str, typer.Argument(help="A scenario file (YAML), a folder of them, or the name of a shipped one.")
    ],
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="Draw what the files tell on one map, to this PNG."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List everything that is wrong with a scenario and the files that it names, a line each."""
    from auvplan.io.examine import examine_folder, examine_scenario

    folder = Path(scenario)
    single = not folder.is_dir()
    if plot is not None and not single:
        raise ScenarioError(f"{scenario}: --plot draws one scenario, and this is a folder")
    bad = []
    for found in [examine_scenario(scenario)] if single else examine_folder(folder):
        bad.append(bool(found.faults))
        if as_json:
            print_json(_plain(found))
            continue
        if len(bad) > 1:
            typer.echo()
        if found.faults and not single:
            typer.echo(f"{found.source}: {counted(len(found.faults), 'fault')}")
        _tell(found)
        if plot is not None:
            _draw(found, plot)
    if not single and not as_json:
        typer.echo(f"\n{counted(len(bad), 'scenario')}, {sum(bad)} with faults")
    if any(bad):
        raise typer.Exit(2)


def _plain(found: "Examination") -> dict[str, Any]:
    """Return what was found in a scenario, ready for JSON."""
    faults = [
        {"field": fault.field, "reason": fault.reason}
        | dict(zip(("line", "column"), fault.place or (None, None), strict=True))
        for fault in found.faults
    ]
    return {
        "scenario": str(found.source),
        "valid": not faults,
        "faults": faults,
        "warnings": [str(line) for line in found.warnings],
        "notes": list(found.notes),
    }


def _tell(found: "Examination") -> None:
    """Print the faults of a scenario, or that it is valid, then what may not be meant and was assumed."""
    for line in found.lines:
        typer.echo(line)
    if not found.faults:
        typer.echo(f"{found.source}: valid")
    for line in found.warnings:
        typer.echo(f"warning: {line}")
    for note in found.notes if not found.faults else ():
        typer.echo(f"note: {note}")


def _draw(found: "Examination", path: Path) -> None:
    """Draw a scenario as far as its files could be read."""
    if found.scenario is None or found.waters is None:
        typer.echo("no map: the scenario's fields are at fault")
        return
    from auvplan.plot.waters import draw_waters

    typer.echo(f"map: {draw_waters(found.scenario, found.waters, found.closed, path)}")
