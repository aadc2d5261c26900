"""Time windows of jobs in files: moments, times of day, daylight, or seconds since the departure."""

import re
from collections.abc import Mapping
from datetime import date, datetime, time, timedelta
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from auvplan.io.geo.error import GeoError
from auvplan.site import Site

#: s.
_DAY = 86_400.0
#: Degrees that the sun's middle is above the horizon at its rise and set, refraction and radius included.
_SUNRISE = -0.833
_TIME_OF_DAY = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:\.\d+)?))?\s*(Z|[+-]\d{2}:?\d{2})?")
_EXTRA = "pip install 'auvplan[readers]'"
_HOW = "write a moment such as 2026-03-01T08:00Z, a time of day such as 08:00+10:00, or seconds"


class _End(NamedTuple):
    """One end of a window: seconds since the departure, or a time of day; neither where it is open."""

    seconds: float | None = None
    daily: time | None = None


def read_windows(
    where: str, told: Mapping[str, Any], site: Site | None, duration: float, until: float
) -> tuple[tuple[float, float], ...]:
    """Return the intervals in which a task may begin, s since the departure, in order; empty for any time.

    Args:
        where: the file and the row or feature, as messages name it.
        told: its cells or properties: `from` and `to`, or several `windows`, as pairs or as text,
            "from/to, from/to", or the word daylight or night; and `window`: "whole" where all of the task
            must lie in a window, which is the default, or "begin".
        site: tells the departure that moments count from.
        duration: s, of the task.
        until: s, when missions are over; times of day are taken on all days until then.

    Raises:
        GeoError: a time cannot be read or has no zone, a window ends before it begins or is too short for the
            task, two overlap, or all lie outside the time of the mission.
    """
    kind = str(told.get("window") or "whole").strip().lower()
    if kind not in ("whole", "begin"):
        raise GeoError(f"{where}: window must be 'whole' or 'begin', got {kind!r}")
    spans = []
    sun = str(told.get("windows") or "").strip().lower()
    if sun in ("daylight", "night"):
        spans, told = _by_sun(where, sun, site, until), {**told, "windows": None}
    for first, last in _pairs(where, told):
        begins, ends = (_end(where, name, value, site) for name, value in (("from", first), ("to", last)))
        if begins.daily or ends.daily:
            spans += _days(where, begins, ends, site, until)
        else:
            opens = -float("inf") if begins.seconds is None else begins.seconds
            closes = float("inf") if ends.seconds is None else ends.seconds
            if not opens < closes:
                raise GeoError(f"{where}: the window from {first} to {last} ends before it begins")
            spans.append((opens, closes))
    spans.sort()
    for (_, closes), (opens, _) in pairwise(spans):
        if opens < closes:
            raise GeoError(f"{where}: two windows overlap: make them one")
    if kind == "whole" and spans:
        longest = max(closes - opens for opens, closes in spans)
        if longest < duration:
            raise GeoError(
                f"{where}: the task takes {duration:g} s, its longest window {longest:g} s: "
                "window: begin asks only that it begins in one"
            )
        spans = [(opens, closes - duration) for opens, closes in spans if closes - opens >= duration]
    if spans and not any(closes >= 0.0 and opens <= until for opens, closes in spans):
        raise GeoError(f"{where}: all its windows lie outside the mission, which may last {until:g} s")
    return tuple(spans)


def _pairs(where: str, told: Mapping[str, Any]) -> list[tuple[Any, Any]]:
    """Beginnings and ends as the file has them."""
    several, ends = told.get("windows"), (told.get("from"), told.get("to"))
    if several in (None, "", []):
        return [] if all(_is_open(end) for end in ends) else [ends]
    if not all(_is_open(end) for end in ends):
        raise GeoError(f"{where}: has from or to, and windows: put all into windows")
    if isinstance(several, str):
        several = [part.split("/") for part in several.split(",") if part.strip()]
    if not isinstance(several, list) or not all(
        isinstance(pair, list) and len(pair) == 2 for pair in several
    ):
        raise GeoError(f"{where}: windows must be pairs [from, to], got {str(told['windows'])[:60]!r}")
    return [(first, last) for first, last in several]


def _is_open(value: Any) -> bool:
    return value is None or str(value).strip() in ("", "..")


def _end(where: str, name: str, value: Any, site: Site | None) -> _End:
    """Read one end of a window."""
    if _is_open(value):
        return _End()
    text = str(value).strip()
    try:
        seconds = float("nan") if isinstance(value, bool) else float(text)
    except ValueError:
        seconds = None
    if seconds is not None:
        if seconds - seconds != 0.0:
            raise GeoError(f"{where}: {name} must be a finite time, got {text!r}: {_HOW}")
        return _End(seconds=seconds)
    if match := _TIME_OF_DAY.fullmatch(text):
        if not match[4]:
            raise GeoError(f"{where}: {name} {text!r} has no time zone: write {text}Z, or {text}+10:00")
        try:
            return _End(
                daily=time.fromisoformat(f"{int(match[1]):02}:{match[2]}:{match[3] or '00'}{match[4]}")
            )
        except ValueError:
            raise GeoError(f"{where}: {name} {text!r} is no time of day: {_HOW}") from None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise GeoError(f"{where}: {name} {text[:40]!r} cannot be read: {_HOW}") from None
    if moment.tzinfo is None:
        raise GeoError(f"{where}: {name} {text!r} has no time zone: write {text}Z, or {text}+10:00")
    return _End(seconds=(moment - _epoch(where, site)).total_seconds())


def _epoch(where: str, site: Site | None) -> datetime:
    if site is None or site.epoch is None:
        raise GeoError(f"{where}: a window by the date needs site.departure; seconds count from the start")
    return site.epoch


def _by_sun(where: str, kind: str, site: Site | None, until: float) -> list[tuple[float, float]]:
    """Times between sunrise and sunset at the site, or the other ones, to the minute."""
    epoch = _epoch(where, site)
    assert site is not None
    try:
        from astral import Observer
        from astral.sun import elevation
    except ModuleNotFoundError:
        raise GeoError(f"{where}: windows by the sun need a further package: {_EXTRA}") from None
    place = Observer(site.latitude, site.longitude)
    minutes = np.arange(-_DAY, until + _DAY, 60.0)
    height = np.array([elevation(place, epoch + timedelta(seconds=float(moment))) for moment in minutes])
    wanted = (height > _SUNRISE) == (kind == "daylight")
    if not wanted.any():
        raise GeoError(f"{where}: there is no {kind} at the site in the time of the mission")
    change = np.flatnonzero(np.diff(np.concatenate([[False], wanted, [False]]).astype(int)))
    last = len(minutes)
    spans = [
        (-float("inf") if i == 0 else float(minutes[i]), float("inf") if j == last else float(minutes[j - 1]))
        for i, j in zip(change[::2].tolist(), change[1::2].tolist(), strict=True)
    ]
    return [(opens, closes) for opens, closes in spans if closes >= 0.0 and opens <= until]


def _days(where: str, begins: _End, ends: _End, site: Site | None, until: float) -> list[tuple[float, float]]:
    """Windows of every day of the mission; one that ends before it begins goes over midnight."""
    if begins.seconds is not None or ends.seconds is not None:
        raise GeoError(f"{where}: from and to must both be times of day, or both moments")
    epoch = _epoch(where, site)
    zone = (begins.daily or ends.daily or time()).tzinfo
    first, last = begins.daily or time(tzinfo=zone), ends.daily or time(tzinfo=zone)
    days = range(-1, int(until / _DAY) + 3)

    def seconds(day: date, moment: time) -> float:
        return (datetime.combine(day, moment) - epoch).total_seconds()

    spans = []
    for number in days:
        day = epoch.astimezone(zone).date() + timedelta(days=number)
        opens, closes = seconds(day, first), seconds(day, last)
        spans.append((opens, closes if closes > opens else closes + _DAY))
    return [(opens, closes) for opens, closes in spans if closes >= 0.0 and opens <= until]
