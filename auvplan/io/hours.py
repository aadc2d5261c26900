"""Whether tasks were done within the time windows of the scenario's jobs, read here again by other code."""

import csv
import json
import math
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import xarray as xr

from auvplan.io.ledger import TIME_TOLERANCE, Leg

_DAY = 86_400.0
#: Degrees that the sun's middle is above the horizon at its rise and set.
_SUNRISE = -0.833


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
        if isinstance(spans, str):
            heights = [_sun(dataset, moment - departed) for moment in (begins, ends)]
            if any((height > _SUNRISE) != (spans == "daylight") for height in heights if _plain(height)):
                yield f"{leg}: the task at {name!r} from {begins:.0f} to {ends:.0f} s is not in {spans}"
            continue
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


def _plain(height: float) -> bool:
    """Return whether the sun is clearly up or down, by a formula good to a quarter of a degree."""
    return abs(height - _SUNRISE) > 0.5


def _sun(dataset: xr.Dataset, seconds: float) -> float:
    """Height of the sun at the site, degrees: low-precision formulas of the Astronomical Almanac."""
    moment = datetime.fromisoformat(str(dataset.attrs["site_epoch"])) + timedelta(seconds=seconds)
    days = (moment - datetime.fromisoformat("2000-01-01T12:00:00+00:00")).total_seconds() / _DAY
    anomaly = math.radians((357.528 + 0.9856003 * days) % 360.0)
    longitude = math.radians(
        280.460 + 0.9856474 * days + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2.0 * anomaly)
    )
    tilt = math.radians(23.439 - 4e-7 * days)
    declination = math.asin(math.sin(tilt) * math.sin(longitude))
    ascension = math.atan2(math.cos(tilt) * math.sin(longitude), math.cos(longitude))
    sidereal = math.radians(280.46062 + 360.98564737 * days + float(dataset.attrs["site_longitude"]))
    latitude, angle = math.radians(float(dataset.attrs["site_latitude"])), sidereal - ascension
    up = math.sin(latitude) * math.sin(declination)
    return math.degrees(math.asin(up + math.cos(latitude) * math.cos(declination) * math.cos(angle)))


def _windows_of_jobs(dataset: xr.Dataset) -> dict[str, tuple[Any, bool]]:
    """Windows of each job that has some, and whether all of it must fit: s since the epoch, or "daylight"."""
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
        kind = str(told.get("window") or "whole").strip().lower()
        job = str(told.get("name") or number).strip()
        if str(told.get("windows")).strip().lower() in ("daylight", "night"):
            found[job] = str(told["windows"]).strip().lower(), kind == "whole"
            continue
        pairs = told.get("windows") or [(told.get("from"), told.get("to"))]
        if isinstance(pairs, str):
            pairs = [part.split("/") for part in pairs.split(",")]
        spans = [(_moment(first, epoch, False), _moment(last, epoch, True)) for first, last in pairs]
        if any(span != (-float("inf"), float("inf")) for span in spans):
            found[job] = spans, kind == "whole"
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
