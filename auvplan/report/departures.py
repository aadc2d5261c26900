"""The page of departures: what a mission or a leg comes to by when it leaves."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auvplan.runtime.files import DEPARTED, DEPARTURES, ResultError, read_json
from auvplan.scenario.provenance import changed_settings

#: Columns of a table of departures that hold no numbers.
_WORDS = "departure_utc", "reason", "feasible", "best", "waypoints"

#: What a page takes from beside the table.
_KINDS: dict[str, type] = {"scenario": dict, "files": list, "notes": list, "versions": dict}


def departures_data(rows: list[dict[str, Any]], stated: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page of departures shows: rows of its table, and what they were planned from."""
    settings = dict(stated.get("scenario", {}))
    return {
        "kind": "departures",
        "name": str(settings.get("name") or "departures"),
        "description": str(settings.get("description") or ""),
        "leg": "total_priority" not in rows[0],
        "least": "energy" if stated.get("least") == "energy" else "time",
        "departures": rows,
        "available": (settings.get("mission") or {}).get("time_available"),
        "provenance": {
            "files": list(stated.get("files", [])),
            "notes": list(stated.get("notes", [])),
            "seed": stated.get("seed"),
            "versions": dict(stated.get("versions", {})),
            "settings": changed_settings(settings) if settings else None,
        },
    }


def read_departures(folder: str | Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the departures of a folder and what they were planned from, as far as the folder has it.

    Raises:
        ResultError: a file is missing or damaged; one line that names it.
    """
    path, beside = Path(folder) / DEPARTURES, Path(folder) / DEPARTED
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [_row(row) for row in csv.DictReader(file)]
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or "not a table of departures"
        raise ResultError(f"{path}: {reason}; `auvplan departures` writes one") from None
    if not rows:
        raise ResultError(f"{path}: no departures in it")
    stated = read_json(folder, DEPARTED) if beside.is_file() else {}
    for name, kind in _KINDS.items():
        if not isinstance(stated.get(name, kind()), kind):
            raise ResultError(f"{beside}: {name} is not a {'table' if kind is dict else 'list'}")
    if not isinstance(stated.get("scenario", {}).get("mission") or {}, dict):
        raise ResultError(f"{beside}: scenario.mission is not a table")
    return rows, stated


def _row(cells: dict[str, str]) -> dict[str, Any]:
    """Return a departure from its cells: numbers, truth values and texts."""
    row: dict[str, Any] = {name: cells[name] for name in ("departure_utc", "reason")}
    row |= {name: cells[name] == "true" for name in ("feasible", "best")}
    row |= {name: float(cell) if cell else None for name, cell in cells.items() if name not in _WORDS}
    return row | {"waypoints": cells.get("waypoints", "")}
