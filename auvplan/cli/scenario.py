"""Commands for scenario files: what is shipped, an example, a schema, what is wrong with one."""

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from auvplan.cli.shared import JsonOption, console, print_json
from auvplan.errors import ScenarioError
from auvplan.runtime.files import write_json
from auvplan.runtime.formatting import counted


def scenarios() -> None:
    """List the shipped scenarios."""
    from auvplan.scenario.file import shipped_scenarios

    table = Table("name", "what it is")
    for name, scenario in shipped_scenarios().items():
        table.add_row(name, scenario.description)
    console.print(table)


def init(
    folder: Annotated[Path, typer.Argument(help="Folder for the example; created if needed.")],
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there.")] = False,
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="LAT,LON",
            help="Around this place instead, with the packaged coast of the world (1:10 million, coarse).",
        ),
    ] = None,
    size: Annotated[
        float | None, typer.Option(metavar="KM", help="With --at: the area's sides; 10 if absent.")
    ] = None,
    times: Annotated[
        bool, typer.Option("--times", help="One with tides, time windows and a channel that closes instead.")
    ] = False,
) -> None:
    """Write an example that runs as it is: a commented scenario, and the files that it names."""
    from auvplan.io.example import SCENARIO, write_example, write_example_at, write_example_of_times

    if times and (at is not None or size is not None):
        raise ScenarioError("--times goes without --at and --size")
    if size is not None and at is None:
        raise ScenarioError("--size goes with --at alone")
    if at is not None:
        try:
            latitude, longitude = (float(part) for part in at.split(","))
        except ValueError:
            line = f"--at {at!r}: give it as LAT,LON in degrees, such as 56.4,-5.5"
            raise ScenarioError(line) from None
        begun = write_example_at(folder, latitude, longitude, 10.0 if size is None else size, force)
        for note in begun.notes:
            typer.echo(f"warning: {note}", err=True)
        written = begun.paths
    else:
        written = (write_example_of_times if times else write_example)(folder, force)
    for path in written:
        typer.echo(f"wrote {path}")
    scenario = folder / SCENARIO
    typer.echo(f"check: auvplan validate {scenario}")
    typer.echo(f"plan:  auvplan plan {scenario} --out {folder / 'out'}")
    explained = "" if at else " every field is explained there;"
    typer.echo(f"then change {scenario}:{explained} all settings: auvplan schema")


def schema(
    out: Annotated[Path | None, typer.Option("--out", help="File to write; printed if absent.")] = None,
) -> None:
    """Print the JSON Schema of scenario files: fields, units, defaults and limits, for editors."""
    from auvplan.scenario.file import scenario_schema

    if out is None:
        typer.echo(json.dumps(scenario_schema(), indent=2))
    else:
        write_json(out, scenario_schema())


def validate(
    scenario: Annotated[
        str, typer.Argument(help="A scenario file (YAML), a folder of them, or the name of a shipped one.")
    ],
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Draw what the files contain on one map, to this PNG.")
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
            faults = []
            for fault in found.faults:
                line, column = fault.place or (None, None)
                where = {"line": line, "column": column}
                faults.append({"field": fault.field, "reason": fault.reason} | where)
            stated = {"scenario": str(found.source), "valid": not faults, "faults": faults}
            print_json(stated | {"warnings": found.warnings, "notes": found.notes})
            continue
        if len(bad) > 1:
            typer.echo()
        faulty, count = bad[-1], counted(len(found.faults), "fault")
        lines = [f"{found.source}: {count}"] if faulty and not single else []
        lines += found.lines if faulty else [f"{found.source}: valid"]
        lines += [f"warning: {line}" for line in found.warnings]
        lines += [f"note: {note}" for note in found.notes if not faulty]
        typer.echo("\n".join(lines))
        if plot is None:
            continue
        if found.scenario is None or found.area is None:
            typer.echo("no map: the scenario's fields are at fault")
            continue
        from auvplan.plot.area import plot_area
        from auvplan.plot.style import save

        typer.echo(f"map: {save(plot_area(found.scenario, found.area, found.closed), plot)}")
    if not single and not as_json:
        typer.echo(f"\n{counted(len(bad), 'scenario')}, {sum(bad)} with faults")
    if any(bad):
        raise typer.Exit(2)
