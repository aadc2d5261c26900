"""Whether tasks were done within the time windows of the scenario's jobs, read here again by other code."""

import json
import math
import re
from collections.abc import Iterator, Mapping
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from auvplan.io.errands import errands
from auvplan.io.ledger import TIME_TOLERANCE, Array, Leg
from auvplan.io.originals import path_of
from auvplan.io.streams import speeds_at

_DAY = 86_400.0
#: Degrees that the sun's middle is above the horizon at its rise and set.
_SUNRISE = -0.833
#: m/s by which two ways to interpolate a current may differ.
_SPEED_TOLERANCE = 0.03
#: The hours of a time of day, before its zone.
_MIDNIGHT = re.compile(r"^[\d:.]+")


def window_faults(dataset: xr.Dataset, legs: list[Leg], notes: list[str]) -> Iterator[str]:
    """Yield tasks that were begun or ended outside their windows, and waiting for none.

    Args:
        dataset: `mission.nc`, whose scenario names the file of jobs.
        legs: of the run.
        notes: what could not be looked at is added.
    """
    windows = _windows_of_jobs(dataset)
    # For an area to open a vehicle waits where no window asks for it.
    closing = bool((json.loads(str(dataset.attrs["scenario"])).get("chart") or {}).get("no_go"))
    names = json.loads(str(dataset.attrs.get("waypoint_names", "[]")))
    # A plan of another departure counts from there; the file's dates and seconds from the scenario's.
    departed = float(dataset.attrs.get("departed", 0.0))
    for leg in legs:
        if not leg.arrived:
            continue
        name, line = (names[leg.goal] if leg.goal < len(names) else ""), _line_of(names, leg)
        if line in windows:
            if leg.priority > 0.0:
                yield from _line_faults(dataset, leg, line, windows[line][0], departed, notes)
            continue
        if name not in windows:
            if leg.t_wait > TIME_TOLERANCE and not closing:
                yield f"{leg}: waits {leg.t_wait:.0f} s for a task without a time window"
            continue
        if leg.missed and not isinstance(windows[name][0], str | _Slack):
            arrival = departed + float(leg.times[-1])
            if (
                any(_within(arrival, arrival, *span, slack=-1.0) for span in windows[name][0])
                and not windows[name][1]
            ):
                yield f"{leg}: misses the task at {name!r}, in whose window it arrives"
        if leg.priority == 0.0:
            continue  # it was done before, or missed
        spans, whole = windows[name]
        if isinstance(spans, _Slack):
            moments = np.array([leg.times[-1] + leg.t_wait, leg.times[-1] + leg.t_wait + whole * leg.t_task])
            yield from _slack_faults(dataset, leg, name, spans, leg.positions[-1:], moments, notes)
            continue
        begins = departed + float(leg.times[-1]) + leg.t_wait
        ends = begins + (leg.t_task if whole else 0.0)
        if isinstance(spans, str):
            if _in_other_light(dataset, spans, begins - departed, ends - departed):
                yield f"{leg}: the task at {name!r} from {begins:.0f} to {ends:.0f} s is not in {spans}"
            continue
        if not any(_within(begins, ends, *span) for span in spans):
            yield f"{leg}: the task at {name!r} from {begins:.0f} to {ends:.0f} s is in none of its windows"


class _Slack(NamedTuple):
    """Slack water: the current is slower than so many m/s."""

    limit: float


def _line_of(names: list[str], leg: Leg) -> str:
    """Return the survey line along which a leg leads from vertex to vertex, or an empty string."""
    if max(leg.start, leg.goal) >= len(names):
        return ""
    ends = [re.fullmatch(r"(.*)\[(\d+)\]", names[node], re.DOTALL) for node in (leg.start, leg.goal)]
    if None in ends or ends[0][1] != ends[1][1] or abs(int(ends[0][2]) - int(ends[1][2])) != 1:  # type: ignore[index]
        return ""
    return str(ends[0][1])  # type: ignore[index]


def _line_faults(
    dataset: xr.Dataset, leg: Leg, line: str, spans: Any, departed: float, notes: list[str]
) -> Iterator[str]:
    """Yield that a part of a survey line does not lie in one of its windows."""
    begins, ends = float(leg.times[0]), float(leg.times[-1]) + leg.t_task
    if isinstance(spans, _Slack):
        moments = np.linspace(begins, float(leg.times[-1]), 5)
        places = np.array([[np.interp(t, leg.times, axis) for axis in leg.positions.T] for t in moments])
        yield from _slack_faults(dataset, leg, line, spans, places, moments, notes)
    elif isinstance(spans, str):
        if _in_other_light(dataset, spans, begins, ends):
            yield f"{leg}: a part of line {line!r} from {begins:.0f} to {ends:.0f} s is not in {spans}"
    elif not any(_within(begins + departed, ends + departed, *span) for span in spans):
        yield f"{leg}: a part of line {line!r} from {begins:.0f} to {ends:.0f} s is in none of its windows"


def _slack_faults(
    dataset: xr.Dataset, leg: Leg, name: str, slack: _Slack, places: Array, moments: Array, notes: list[str]
) -> Iterator[str]:
    """Yield that the current was faster than slack water, by this checker's own view of it."""
    try:
        speeds = speeds_at(dataset, places, moments)
    except Exception as error:  # whatever this view lacks is no fault of the run
        notes.append(f"slack water at {name!r} was not looked at again: {' '.join(str(error).split())}")
        return
    if speeds.max() > slack.limit + _SPEED_TOLERANCE:
        yield (
            f"{leg}: the task at {name!r} is done in a current of {speeds.max():.2f} m/s, "
            f"slack water is below {slack.limit:g} m/s"
        )


def priority_at(dataset: xr.Dataset, job: str, begins: float) -> float | None:
    """Return what a job whose priority falls is worth at a time, s since the departure; None of others."""
    departed, epoch = float(dataset.attrs.get("departed", 0.0)), _epoch(dataset)
    for name, stated in _jobs(dataset):
        falls = stated.get("priority_after")
        if name != job or falls in (None, "", []):
            continue
        if isinstance(falls, str):
            falls = [part.split("/") for part in falls.split(",")]
        elif not isinstance(falls[0], list):
            falls = [falls]
        given = stated.get("priority")
        worth = 1.0 if given in (None, "") else float(given)  # type: ignore[arg-type]
        for moment, after in falls:
            if begins + departed > _moment(moment, epoch, True):
                worth = float(after)
        return worth
    return None


def closed_at(stated: Mapping[str, Any], dataset: xr.Dataset, times: Array) -> NDArray[np.bool_]:
    """Return at which times, s since the run's departure, an area with such hours is closed.

    Args:
        stated: `from`, `to` and `windows`, as its file has them.
        dataset: `mission.nc`.
        times: [n] s.
    """
    departed, spans = float(dataset.attrs.get("departed", 0.0)), _spans(stated, _epoch(dataset))
    if isinstance(spans, str):
        heights = [_sun(dataset, float(moment)) for moment in times]
        return np.array(
            [_plain(height) and (height > _SUNRISE) == (spans == "daylight") for height in heights]
        )
    found = np.zeros(len(times), bool)
    for span in spans:
        inside = [_within(float(moment), float(moment), *span, slack=0.0) for moment in times + departed]
        found |= np.array(inside, bool)
    return found


def _within(begins: float, ends: float, opens: Any, closes: Any, slack: float = TIME_TOLERANCE) -> bool:
    """Return whether a task lies in one window; ends of windows that repeat come as times of day."""
    if isinstance(opens, float):
        return opens - slack <= begins and ends <= closes + slack
    start, length = opens[1], (closes[1] - opens[1]) % _DAY or _DAY
    return (begins - start + slack) % _DAY + (ends - begins) <= length + 2 * slack


def _in_other_light(dataset: xr.Dataset, wanted: str, *moments: float) -> bool:
    """Return whether it is surely not daylight, or not night, as wanted, at any of some times, s."""
    heights = [_sun(dataset, moment) for moment in moments]
    return any((height > _SUNRISE) != (wanted == "daylight") for height in heights if _plain(height))


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
    """Windows of each job that has some, and whether all of it must fit: as `_spans` has them."""
    epoch, found = _epoch(dataset), {}
    for job, stated in _jobs(dataset):
        kind = str(stated.get("window") or "whole").strip().lower()
        spans = _spans(stated, epoch)
        if not isinstance(spans, list) or any(span != (-float("inf"), float("inf")) for span in spans):
            found[job] = spans, kind == "whole"
    return found


def _jobs(dataset: xr.Dataset) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name of each row or feature of the scenario's jobs, and what it tells in lower case."""
    settings = json.loads(str(dataset.attrs["scenario"]))
    name = settings.get("mission", {}).get("jobs")
    if not name:
        return
    try:
        found = errands(path_of(dataset, name))
    except Exception:  # the tally tells that the jobs cannot be read
        return
    yield from ((one.name, one.stated) for one in found)


def _epoch(dataset: xr.Dataset) -> datetime | None:
    """Return the moment that the scenario's files count from, or None without a date."""
    stated = dataset.attrs.get("site_epoch")
    if not stated:
        return None
    return datetime.fromisoformat(str(stated)) - timedelta(seconds=float(dataset.attrs.get("departed", 0.0)))


def _spans(stated: Mapping[str, Any], epoch: datetime | None) -> Any:
    """Return windows: s since the epoch or times of day, the word daylight or night, or slack water."""
    if (word := str(stated.get("windows")).strip().lower()) in ("daylight", "night"):
        return word
    if word.startswith("slack"):
        return _Slack(float(word.removesuffix("m/s").split("<")[1]))
    pairs = stated.get("windows") or [(stated.get("from"), stated.get("to"))]
    if isinstance(pairs, str):
        pairs = [part.split("/") for part in pairs.split(",")]
    return [_span(first, last, epoch) for first, last in pairs]


def _span(first: Any, last: Any, epoch: datetime | None) -> tuple[Any, Any]:
    """Return both ends of a window; beside a time of day an open end is midnight of its zone."""
    ends = [_moment(first, epoch, False), _moment(last, epoch, True)]
    for k, stated in enumerate((last, first)):
        if isinstance(ends[k], float) and isinstance(ends[1 - k], tuple):
            ends[k] = _moment(_MIDNIGHT.sub("00:00", str(stated).strip()), epoch, bool(k))
    return ends[0], ends[1]


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
