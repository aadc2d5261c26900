"""Commands for scenario files: what is shipped, an example, a schema, what is wrong with one."""

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from auvplan.cli.shared import JsonOption, console, print_json


def scenarios() -> None:
    """List the shipped scenarios."""
    from auvplan.io.scenario_file import shipped_scenarios

    table = Table(show_header=True)
    table.add_column("name")
    table.add_column("what it is")
    for name, scenario in shipped_scenarios().items():
        table.add_row(name, scenario.description)
    console.print(table)


def init(
    folder: Annotated[Path, typer.Argument(help="Folder for the example; made where missing.")],
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there.")] = False,
) -> None:
    """Write an example that runs as it is: a commented scenario, and the files that it names."""
    from auvplan.io.example import SCENARIO, write_example

    written = write_example(folder, force)
    for path in written:
        typer.echo(f"wrote {path}")
    scenario = folder / SCENARIO
    typer.echo(f"check: auvplan validate {scenario}")
    typer.echo(f"run:   auvplan mission {scenario} --out {folder / 'out'}")
    typer.echo(f"then change {scenario}: every field is explained there; auvplan schema tells them all")


def schema(
    out: Annotated[Path | None, typer.Option("--out", help="File to write; printed if absent.")] = None,
) -> None:
    """Print the JSON Schema of scenario files: fields, units, defaults and limits, for editors."""
    from auvplan.io import write_atomically
    from auvplan.io.scenario_file import scenario_schema

    text = json.dumps(scenario_schema(), indent=2) + "\n"
    if out is None:
        typer.echo(text, nl=False)
    else:
        write_atomically(out, lambda part: part.write_text(text, encoding="utf-8"))


def validate(
    scenario: Annotated[str, typer.Argument(help="A scenario file (YAML), or the name of a shipped one.")],
    as_json: JsonOption = False,
) -> None:
    """List everything that is wrong with a scenario and the files that it names, a line each."""
    from auvplan.io.examine import examine_scenario

    found = examine_scenario(scenario)
    if as_json:
        faults = [
            {"field": fault.field, "reason": fault.reason}
            | dict(zip(("line", "column"), fault.place or (None, None), strict=True))
            for fault in found.faults
        ]
        print_json({"scenario": scenario, "valid": not faults, "faults": faults, "notes": list(found.notes)})
        if faults:
            raise typer.Exit(2)
        return
    for line in found.lines:
        typer.echo(line)
    if found.faults:
        raise typer.Exit(2)
    typer.echo(f"{scenario}: valid")
    for note in found.notes:
        typer.echo(f"note: {note}")
