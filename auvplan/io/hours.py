"""Whether tasks were done within the time windows of the scenario's jobs, read here again by other code."""

import csv
import json
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import xarray as xr

from auvplan.io.ledger import TIME_TOLERANCE, Leg

_DAY = 86_400.0


def window_faults(dataset: xr.Dataset, legs: list[Leg]) -> Iterator[str]:
    """Yield tasks that were begun or ended outside their windows, and waiting for none.

    Args:
        dataset: `mission.nc`, whose scenario names the file of jobs.
        legs: of the run.
    """
    windows = _windows_of_jobs(dataset)
    names = json.loads(str(dataset.attrs.get("waypoint_names", "[]")))
    # A plan of another departure counts from there; the file's dates and seconds from the scenario's.
    departed = float(dataset.attrs.get("departed", 0.0))
    for leg in legs:
        if not leg.arrived:
            continue
        name = names[leg.goal] if leg.goal < len(names) else ""
        if name not in windows:
            if leg.t_wait > TIME_TOLERANCE:
                yield f"{leg}: waits {leg.t_wait:.0f} s for a task without a time window"
            continue
        if leg.priority == 0.0:
            continue  # it was done before, or missed
        spans, whole = windows[name]
        begins = departed + float(leg.times[-1]) + leg.t_wait
        ends = begins + (leg.t_task if whole else 0.0)
        if not any(_within(begins, ends, *span) for span in spans):
            yield f"{leg}: the task at {name!r} from {begins:.0f} to {ends:.0f} s is in none of its windows"


def _within(begins: float, ends: float, opens: Any, closes: Any) -> bool:
    """Return whether a task lies in one window; ends of windows that repeat come as times of day."""
    if isinstance(opens, float) and isinstance(closes, float):
        return opens - TIME_TOLERANCE <= begins and ends <= closes + TIME_TOLERANCE
    if isinstance(opens, float) or isinstance(closes, float):
        return True  # every day from or until midnight of some zone
    start, length = opens[1], (closes[1] - opens[1]) % _DAY or _DAY
    return (begins - start + TIME_TOLERANCE) % _DAY + (ends - begins) <= length + 2 * TIME_TOLERANCE


def _windows_of_jobs(dataset: xr.Dataset) -> dict[str, tuple[list[tuple[Any, Any]], bool]]:
    """Windows of each job that has some, s since the scenario's epoch, and whether all of it must fit."""
    settings = json.loads(str(dataset.attrs["scenario"]))
    name = settings.get("mission", {}).get("jobs")
    if not name:
        return {}
    path = Path(str(dataset.attrs["scenario_folder"])) / Path(name).expanduser()
    epoch = None
    if told := dataset.attrs.get("site_epoch"):
        epoch = datetime.fromisoformat(str(told))
        epoch -= timedelta(seconds=float(dataset.attrs.get("departed", 0.0)))
    found = {}
    for number, row in enumerate(_rows(path), 1):
        told = {str(key).strip().lower(): value for key, value in row.items() if key is not None}
        pairs = told.get("windows") or [(told.get("from"), told.get("to"))]
        if isinstance(pairs, str):
            pairs = [part.split("/") for part in pairs.split(",")]
        spans = [(_moment(first, epoch, False), _moment(last, epoch, True)) for first, last in pairs]
        if any(span != (-float("inf"), float("inf")) for span in spans):
            kind = str(told.get("window") or "whole").strip().lower()
            found[str(told.get("name") or number).strip()] = spans, kind == "whole"
    return found


def _rows(path: Path) -> list[dict[str, Any]]:
    """Properties of the points of a GeoJSON file, or rows of a CSV; nothing of other formats."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        if path.suffix.lower() in (".geojson", ".json"):
            features = json.loads(text).get("features", [])
            return [feature.get("properties") or {} for feature in features]
        if path.suffix.lower() in (".csv", ".txt", ".tsv"):
            heading = text.lstrip().split("\n", 1)[0]
            mark = next((mark for mark in (";", "\t") if mark in heading), ",")
            return list(csv.DictReader(text.lstrip().splitlines(), delimiter=mark, skipinitialspace=True))
    except (OSError, ValueError):
        pass  # the tally tells that the jobs cannot be read
    return []


def _moment(value: Any, epoch: datetime | None, last: bool) -> Any:
    """Return seconds since the epoch, or ("daily", s) of a time of day; infinite where it is open."""
    text = "" if value is None else str(value).strip()
    if text in ("", ".."):
        return float("inf") if last else -float("inf")
    try:
        return float(text)
    except ValueError:
        pass
    if epoch is None:
        return float("nan")
    if "T" in text or "-" in text[:5]:
        return (datetime.fromisoformat(text) - epoch).total_seconds()
    moment = datetime.fromisoformat(f"2000-01-01T{'0' * (text[1] == ':') + text}")
    return "daily", (moment - epoch).total_seconds() % _DAY
