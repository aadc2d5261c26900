"""Commands for vehicles: which are shipped, what one draws, and laws of power fitted to a table."""

import csv
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from auvplan.cli import shared
from auvplan.errors import AuvplanError
from auvplan.runtime.formatting import figure, hours

_KNOT = 1852.0 / 3600.0
#: Columns by what they are: how their names begin, and factors of the units that they end with.
_COLUMNS: dict[str, tuple[tuple[str, ...], dict[str, float]]] = {
    "speed": (
        ("speed", "v", "velocity"),
        {"m_s": 1.0, "mps": 1.0, "ms": 1.0, "km_h": 1.0 / 3.6, "kmh": 1.0 / 3.6}
        | dict.fromkeys(("kn", "kt", "kts", "knots"), _KNOT),
    ),
    "power": (("power", "p"), {"w": 1.0, "watts": 1.0, "watt": 1.0, "kw": 1000.0}),
}


def list_() -> None:
    """List the shipped vehicles."""
    from auvplan.scenario.vehicles import load_vehicle, shipped_vehicles

    table = Table("name", "what it is", "battery, Wh", "hotel, W")
    for name in shipped_vehicles():
        vehicle = load_vehicle(name)
        power = vehicle.power
        capacity = "" if power.battery is None else figure(power.battery.capacity or 0.0, 5)
        table.add_row(name, vehicle.description, capacity, figure(power.hotel or 0.0, 4))
    shared.console.print(table)


def show(
    name: Annotated[str, typer.Argument(help="A shipped vehicle, or a YAML file.")],
    price: Annotated[float, typer.Option(min=0.0, help="W, what a second is worth beside its energy.")] = 0.0,
    picture: Annotated[Path | None, typer.Option(help="Write the power by speed as a picture.")] = None,
    as_json: shared.JsonOption = False,
) -> None:
    """Show what a vehicle draws, its best speed, and its endurance and range in still water."""
    from auvplan.energy import best_speed, speed_range
    from auvplan.scenario.power import PowerSettings
    from auvplan.scenario.vehicles import load_vehicle, power_model

    vehicle = load_vehicle(name)
    power = power_model(PowerSettings(vehicle=name))
    assert power is not None
    limits = vehicle.speeds or speed_range(power)
    best = float(best_speed(power, price=price, limits=limits))
    battery, rows = power.battery, []
    others = (limits[0] + (limits[1] - limits[0]) * k / 4.0 for k in range(5))
    speeds = sorted([best, *(speed for speed in others if abs(speed / best - 1.0) > 0.01)])
    for speed in speeds:
        watts = float(power.power(speed))
        row = {"speed": speed, "power_w": watts, "wh_per_km": watts / speed / 3.6}
        if battery is not None:
            usable = float(battery.usable_joules) * (1.0 - float(battery.reserve))  # type: ignore[arg-type]
            row |= {"endurance_s": usable / watts, "range_m": usable / watts * speed}
        rows.append(row)
    if picture is not None:
        from auvplan.plot.energy import plot_power
        from auvplan.plot.style import save

        save(plot_power(power), picture)
    if as_json:
        shared.print_json({"name": name, "best_speed": best, "speeds": rows, "source": vehicle.source})
        return
    facts = {"source": vehicle.source, "hotel and payload": f"{float(power.hotel + power.payload):.1f} W"}  # type: ignore[operator]
    if battery is not None:
        facts["battery"] = f"{float(battery.usable_wh):,.0f} Wh usable, reserve {float(battery.reserve):.0%}"  # type: ignore[arg-type]
    facts["speed of least energy"] = f"{best:.2f} m/s in still water" + (f" at {price:g} W" if price else "")
    shared.print_facts(f"{name}: {vehicle.description}", facts.items())
    table = Table("m/s", "W", "Wh/km", *(("endurance", "range, km") if battery is not None else ()))
    for row in rows:
        cells = [f"{row['speed']:.2f}", f"{row['power_w']:.1f}", f"{row['wh_per_km']:.1f}"]
        if battery is not None:
            cells += [hours(row["endurance_s"]), f"{row['range_m'] / 1000.0:.1f}"]
        table.add_row(*cells, style="bold" if row["speed"] == best else "")
    shared.console.print(table)
    if battery is not None:
        shared.say("endurance and range in still water, until the reserve is reached; the best speed in bold")


def fit(
    table: Annotated[Path, typer.Argument(help="CSV with columns of speed and power, units in their names.")],
    out: shared.OutOption = Path("out/vehicle"),
    exponent: Annotated[
        float | None, typer.Option(min=1.0, max=6.0, help="Keep n at this, such as 3; fitted if absent.")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN=VALUE",
            help="Use these rows alone, such as vehicle=lauv-1. May be given several times.",
        ),
    ] = None,
    hotel: Annotated[float, typer.Option(min=0.0, help="W, always on, that the table leaves out.")] = 0.0,
    as_json: shared.JsonOption = False,
) -> None:
    """Fit propulsion power h + k v^n to a table, and write it as a vehicle's file with a picture."""
    from auvplan.energy import PowerModel, fit_power
    from auvplan.plot.energy import plot_power
    from auvplan.plot.style import save
    from auvplan.runtime.files import output_folder, write_atomically

    speeds, watts = read_power_table(table, only or ())
    try:
        found = fit_power(speeds, watts, exponent)
    except AuvplanError as error:
        raise AuvplanError(f"{table}: {error}") from None
    law = {name: float(getattr(found.law, name)) for name in ("constant", "factor", "exponent")}
    stated = ", ".join([f"fitted to {table.name}", *(only or [])])
    lines = [
        f"description: {_quoted(stated)}",
        f"source: {_quoted(f'{stated}: {found.line}')}",
        f"speeds: [{found.speeds.min():.6g}, {found.speeds.max():.6g}]",
        "power:",
        f"  hotel: {hotel:g} # W",
        "  propulsion: # W: constant + factor v^exponent",
        *(f"    {name}: {value:.6g}" for name, value in law.items()),
        "  # battery: {capacity: 500, reserve: 0.2} # Wh",
    ]
    folder = output_folder(out)
    file = write_atomically(
        folder / "vehicle.yaml", lambda part: part.write_text("\n".join(lines) + "\n", "utf-8")
    )
    drawn = save(plot_power(PowerModel(found.law, hotel=hotel), found), folder / "power.png")
    if as_json:
        residuals = {"rms_w": found.rms, "worst_w": found.worst, "points": len(found.speeds)}
        shared.print_json(law | residuals | {"files": [str(file), str(drawn)]})
        return
    shared.say(found.line)
    shared.say(f"written: {file}, {drawn}")


def _quoted(text: str) -> str:
    return "'" + " ".join(text.split()).replace("'", "''") + "'"


def read_power_table(path: Path, only: Iterable[str] = ()) -> tuple[list[float], list[float]]:
    """Read speeds, m/s, and powers, W, from the columns of a CSV whose names have their units.

    Args:
        path: of the file.
        only: texts "column=value" that rows have which count; all if there are none.

    Raises:
        AuvplanError: one line that names the file, and column or row.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise AuvplanError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    if not rows:
        raise AuvplanError(f"{path}: has no rows below a line of names")
    names = [name for name in rows[0] if name is not None]
    columns = {what: _column(path, what, names) for what in _COLUMNS}
    numbered = list(enumerate(rows, 2))
    for text in only:
        column, mark, wanted = text.partition("=")
        if not mark or column not in names:
            raise AuvplanError(f"--only {text!r}: give it as COLUMN=VALUE, of the columns {', '.join(names)}")
        values = sorted({row[column] or "" for _, row in numbered})
        numbered = [(line, row) for line, row in numbered if row[column] == wanted]
        if not numbered:
            raise AuvplanError(f"{path}: {column} is nowhere {wanted!r}: it is {', '.join(values)[:300]}")
    if len({row.get("vehicle") for _, row in numbered}) > 1:
        raise AuvplanError(f"{path}: has several vehicles: name one by --only vehicle=NAME")
    found: dict[str, list[float]] = {what: [] for what in columns}
    for line, row in numbered:
        cells = {what: (row[name] or "").strip() for what, (name, _) in columns.items()}
        if not all(cells.values()):
            continue
        for what, (name, factor) in columns.items():
            try:
                value = factor * float(cells[what])
            except ValueError:
                value = math.nan
            if not math.isfinite(value) or value < 0.0:
                raise AuvplanError(
                    f"{path}: line {line}: {name} must be a number of at least 0, got {cells[what]!r}"
                )
            found[what].append(value)
    return found["speed"], found["power"]


def _column(path: Path, what: str, names: list[str]) -> tuple[str, float]:
    """Return the column that is a speed or a power, and what its unit is in SI units."""
    starts, units = _COLUMNS[what]
    for name in names:
        words = re.sub(r"[^a-z]+", "_", name.lower().replace("^-1", "")).strip("_")
        start, _, unit = words.partition("_")
        if start not in starts:
            continue
        if not unit:
            line = f"{path}: column {name!r} has no unit in its name: {what}_{next(iter(units))}, say"
            raise AuvplanError(line)
        for known in sorted(units, key=len, reverse=True):
            if unit == known or unit.endswith(f"_{known}"):
                return name, units[known]
    example = f"{starts[0]}_{next(iter(units))}"
    raise AuvplanError(f"{path}: has no column of {what} such as {example}, but {', '.join(names)}"[:400])
