"""Commands that look at charts and results."""

import json
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from auvplan.cli import shared
from auvplan.errors import AuvplanError, ScenarioError
from auvplan.runtime.files import is_study
from auvplan.runtime.formatting import counted

if TYPE_CHECKING:
    from auvplan.check.run import CheckReport
    from auvplan.io.geo.raster import PixelSize
    from auvplan.ocean.classify import Classified
    from auvplan.ocean.palette import ChartColours


def _colour_option(what: str) -> Any:
    return typer.Option(
        metavar="COLOUR",
        help=f"Colour of {what}: a CSS name or '#rrggbb'; may be given several times.",
        show_default=False,
    )


def chart(
    image: Annotated[Path, typer.Argument(help="A chart-like picture: PNG, JPEG or GeoTIFF.")],
    out: shared.OutOption = Path("out/chart"),
    pixel_size: Annotated[
        float | None,
        typer.Option(
            min=1e-3,
            help="Metres per pixel; by default that of a GeoTIFF or world file, otherwise 10.",
            show_default=False,
        ),
    ] = None,
    water: Annotated[list[str] | None, _colour_option("water")] = None,
    land: Annotated[list[str] | None, _colour_option("land")] = None,
    uncertain: Annotated[list[str] | None, _colour_option("uncertain area")] = None,
    quiet: shared.QuietOption = False,
) -> None:
    """Cluster a picture into coast, uncertain area and water, and draw the result.

    Where colours of water and land are given, every cluster is taken for what the nearest colour stands for.
    Otherwise rules propose it, which know charts with blue water; what they are not sure of is refused.
    """
    from auvplan.io import geo
    from auvplan.ocean.chart import Chart, classify_file, settled
    from auvplan.plot import draw_chart
    from auvplan.runtime.files import output_folder

    colours = _colours(water=water, land=land, uncertain=uncertain)
    found = classify_file(image, colours=colours)
    notes = [f"{image}: {note}" for note in found.notes]
    try:
        stated = geo.pixel_size(image)
    except geo.GeoError:
        if pixel_size is None:
            raise
        stated = None
    if stated is not None:
        notes += stated.notes
        if pixel_size is not None and abs(pixel_size / stated.metres - 1.0) > 0.01:
            notes.append(f"{image} has pixels of {stated.metres:.4g} m, --pixel-size says {pixel_size:g} m")
    size = pixel_size or (stated.metres if stated else 10.0)
    output_folder(out)
    made = Chart.from_classified(found, size)
    picture = draw_chart(made, image, out, found)
    if not quiet:
        table = Table("", "colour", "share", "taken for", "to change it")
        for cluster in found.clusters:
            other = "--land" if cluster.kind == "water" else "--water"
            row = cluster.colour, f"{cluster.share:.1%}", cluster.kind, f'{other} "{cluster.colour}"'
            table.add_row(Text("    ", style=f"on {cluster.colour}"), *row)
        shared.console.print(table)
        shares = made.shares()
        shared.say(", ".join(f"{kind} {shares[kind]:.1%}" for kind in ("coast", "uncertain", "water")))
        shared.say(f"pixels of {size:.4g} m, {made.shape[1]} east by {made.shape[0]} north")
        shared.say_notes(notes)
        shared.say(f"picture: {picture}")
    settled(found, image)
    if not quiet:
        shared.say("\n".join(_yaml_lines(image, pixel_size or float(f"{size:.4g}"), stated, colours, found)))


def _colours(**given: list[str] | None) -> "ChartColours":
    """Return the colours of the options; raise ScenarioError that names the option of what is no colour."""
    from auvplan.ocean.palette import ChartColours, as_hex

    stated: dict[str, tuple[str, ...]] = {}
    for option, colours in given.items():
        try:
            stated[option] = tuple(as_hex(colour) for colour in colours or ())
        except ValueError as error:
            raise ScenarioError(f"--{option} {error}") from None
    try:
        return ChartColours(**stated)
    except ValueError as error:
        raise ScenarioError(f"--water, --land, --uncertain: {error}") from None


def _yaml_lines(
    image: Path, size: float, stated: "PixelSize | None", colours: "ChartColours", found: "Classified"
) -> list[str]:
    """Return the lines of a scenario that say the same; paths in it start from the scenario's folder."""
    source, field = ("image", "image") if stated is None else ("raster", "file")
    needed = "" if stated is None else "  # and a site"
    lines = ["for a scenario in this folder:", "chart:", f"  source: {source}{needed}"]
    lines.append(f"  {field}: {json.dumps(str(image), ensure_ascii=False)}")
    if stated is not None and not stated.crs:
        lines.append("  # crs: EPSG:...  what the coordinates of the world file are in")
    lines += [f"  pixel_size: {size:.6g}", "  colours:"]
    for name, kind in (("water", "water"), ("land", "coast"), ("uncertain", "uncertain")):
        if colours.complete:
            named = getattr(colours, name)
        else:
            named = dict.fromkeys(cluster.colour for cluster in found.clusters if cluster.kind == kind)
        if named:
            lines.append(f"    {name}: [{', '.join(json.dumps(colour) for colour in named)}]")
    return lines


def currents(
    files: Annotated[
        list[str] | None,
        typer.Argument(help="Files of one current: NetCDF or Zarr; parts together.", show_default=False),
    ] = None,
    to: Annotated[
        Path | None, typer.Option(help="Write the current as one CF data set, on the model's points.")
    ] = None,
    crs: Annotated[
        str | None, typer.Option(help="Projection of coordinates in metres, such as EPSG:32633.")
    ] = None,
    epoch: Annotated[
        datetime | None, typer.Option(help="UTC, the date that times without one count from.")
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="SERVER:DATASET",
            help="Fetch from a server instead: copernicus:DATASET_ID, erddap:ADDRESS of the griddap page, or "
            "thredds:ADDRESS of OPeNDAP.",
        ),
    ] = None,
    box: Annotated[
        str | None, typer.Option(metavar="W,S,E,N", help="With --from: degrees; a cell around it comes too.")
    ] = None,
    time: Annotated[
        str | None,
        typer.Option(
            metavar="FROM,TO", help="With --from: UTC, such as 2026-03-01T00:00Z,+12h (or a second date)."
        ),
    ] = None,
    depth: Annotated[
        str | None, typer.Option(metavar="MIN,MAX", help="With --from: m; all levels if absent.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="With --from: the file to write, such as forecast.nc.")
    ] = None,
    timeout: Annotated[
        float, typer.Option(min=0.1, max=3600.0, help="With --from: s that the server may be silent.")
    ] = 60.0,
    quiet: shared.QuietOption = False,
    as_json: shared.JsonOption = False,
) -> None:
    """Look at an ocean model's current: what it covers, and what was assumed in reading it.

    With --from it is fetched from a server first, of the box, times and depths
    asked for: velocities, and the height of the surface where it is given.
    Copernicus Marine needs `copernicusmarine login` once.
    """
    from auvplan.io.currents import open_ocean, to_cf
    from auvplan.io.currents.ocean import summary_of
    from auvplan.runtime.files import write_dataset

    notes: tuple[str, ...] = ()
    options = {"--box": box, "--time": time, "--depth": depth, "--out": out}
    if source is not None:
        from auvplan.io.forecasts import Request, fetch_current

        if files:
            raise ScenarioError("--from fetches one file: name no files beside it")
        if box is None or time is None or out is None:
            lacking = next(name for name in ("--box", "--time", "--out") if options[name] is None)
            needed = "--box W,S,E,N --time FROM,TO --out FILE"
            raise ScenarioError(f"--from {source}: needs {lacking} too: {needed}")
        request = Request.of(source, box, time, depth)
        with shared.progress_bar("fetching", quiet or as_json) as progress:
            fetched = fetch_current(request, out, timeout=timeout, progress=progress)
        files, notes = [str(fetched.path)], fetched.notes
    elif given := [name for name, value in options.items() if value is not None]:
        raise ScenarioError(f"{given[0]}: goes with --from alone")
    if not files:
        raise ScenarioError("currents: name the files of a current, or a server by --from")
    with open_ocean(files, crs=crs, epoch=epoch) as ocean:
        found = summary_of(ocean)
        if to is not None:
            write_dataset(to_cf(ocean), to)
    notes = tuple(dict.fromkeys((*notes, *ocean.notes)))
    if as_json:
        shared.print_json(found | {"notes": list(notes)})
        return
    if quiet:
        return
    shared.print_facts(None, ((name.replace("_", " "), str(value)) for name, value in found.items()))
    shared.say_notes(notes)
    for written in (out, to):
        if written is not None:
            shared.say(f"written: {written}")


def check(
    folder: Annotated[
        Path, typer.Argument(help="Folder of a result, or of a study whose runs were saved (--save-runs).")
    ],
    sources: Annotated[
        bool,
        typer.Option(
            "--sources",
            help="Look also at the files of land, closed areas and sea bed that the scenario names, with "
            "pyogrio, rasterio and xarray; pictures, S-57 cells and files of currents are not read.",
        ),
    ] = False,
    quiet: shared.QuietOption = False,
    as_json: shared.JsonOption = False,
) -> None:
    """Check a result independently: re-check the whole track and every time."""
    from auvplan.check.run import check_run

    study, verbose = is_study(folder), not (quiet or as_json)
    reports: dict[str, CheckReport] = {}
    runs = [folder]
    if study:
        from auvplan.study.store import saved_runs

        runs = saved_runs(folder)
    for run in runs:
        report = reports[run.name] = check_run(run, sources)
        counts = (report.legs, "leg"), (report.collisions, "collision"), (len(report.faults), "fault")
        legs, met, faults = (counted(*count) for count in counts)
        faults = f"{faults}, first: {report.faults[0]}" if report.faults else "no faults"
        line = f"{run.name}: {legs}, {report.length:,.0f} m, {met}, {faults}"
        if verbose:
            shared.say(line if study else str(report))
    faulty = sum(not report.ok for report in reports.values())
    length, collisions = (sum(getattr(r, of) for r in reports.values()) for of in ("length", "collisions"))
    if as_json:
        found = {name: {"ok": r.ok, "collisions": r.collisions} | asdict(r) for name, r in reports.items()}
        whole = {"ok": not faulty, "collisions": collisions, "length": length, "runs": found}
        shared.print_json(whole if study else found[folder.name])
    elif verbose and study:
        met = f"{length / 1000.0:,.1f} km, {counted(collisions, 'collision')}"
        shared.say(f"{counted(len(reports), 'run')}, {met}, {counted(faulty, 'run')} with faults")
    if faulty:
        raise typer.Exit(1)


def kept(clear: Annotated[bool, typer.Option("--clear", help="Remove all of it.")] = False) -> None:
    """Show what is kept on disk for later runs: compiled programs and clustered charts."""
    from auvplan.runtime import cache

    place = cache.folder()
    if place is None:
        shared.say("nothing is kept: AUVPLAN_CACHE is off")
        return
    if clear:
        removed = cache.trim(limit=0)
        shared.say(f"{place}: {counted(len(removed), 'entry')} removed, {_megabytes(removed)}")
        return
    entries = list(cache.entries())
    table = Table("what", "entries", "size", "last used")
    for name in sorted({entry.name for entry in entries}):
        own = [entry for entry in entries if entry.name == name]
        used = datetime.fromtimestamp(max(entry.used for entry in own))
        table.add_row(name, str(len(own)), _megabytes(own), f"{used:%Y-%m-%d %H:%M}")
    if entries:
        shared.console.print(table)
    shared.say(f"{place}: {_megabytes(entries)} of at most {cache.LIMIT / 1e6:.0f} MB")


def _megabytes(entries: list) -> str:
    return f"{sum(entry.size for entry in entries) / 1e6:.1f} MB"


def paper() -> None:
    """Say where the paper's figures and claims are reproduced: not by what is installed."""
    raise AuvplanError(
        "the paper's figures and claims are reproduced in a copy of the repository, by `make paper` or "
        "`python -m benchmarks.paper`: see docs/paper.md"
    )
