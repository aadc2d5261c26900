"""Time windows of jobs in files: moments, times of day, daylight, or seconds since the departure."""

import re
from collections.abc import Callable, Mapping
from datetime import date, datetime, time, timedelta
from functools import lru_cache
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
_SLACK = re.compile(r"slack\s*<\s*(.*?)(?:\s*m/s)?")
#: s.
_MINUTE = 60.0
_HOW = "write a moment such as 2026-03-01T08:00Z, a time of day such as 08:00+10:00, or seconds"


class _End(NamedTuple):
    """One end of a window: seconds since the departure, or a time of day; neither where it is open."""

    seconds: float | None = None
    daily: time | None = None


def read_spans(
    where: str, stated: Mapping[str, Any], site: Site | None, until: float
) -> list[tuple[float, float]]:
    """Return intervals of time, s since the departure, in order; empty where none is given.

    Args:
        where: the file and the row or feature, as messages name it.
        stated: its cells or properties: `from` and `to`, or several `windows`, as pairs or as text,
            "from/to, from/to", or the word daylight or night.
        site: has the departure that moments count from.
        until: s, when missions are over; times of day are taken on all days until then.

    Raises:
        GeoError: a time cannot be read or has no zone, an interval ends before it begins, or two overlap.
    """
    spans = []
    sun = str(stated.get("windows") or "").strip().lower()
    if sun in ("daylight", "night"):
        spans, stated = _by_sun(where, sun, site, until), {**stated, "windows": None}
    for first, last in _pairs(where, stated):
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
    return spans


def read_falls(
    where: str, stated: Mapping[str, Any], site: Site | None, priority: float
) -> tuple[tuple[float, float], ...]:
    """Return moments, s since the departure, and the priority that a job has after each.

    Args:
        where: the file and the row or feature, as messages name it.
        stated: its cells or properties: `priority_after`, as pairs [moment, priority] or as text,
            "moment/priority, moment/priority".
        site: has the departure that moments count from.
        priority: before the first of them.

    Raises:
        GeoError: a moment or a priority cannot be read, moments do not rise or priorities do not fall.
    """
    how = "write moment/priority, such as 2026-03-01T08:00Z/2"
    given = stated.get("priority_after")
    if given in (None, "", []):
        return ()
    if isinstance(given, str):
        given = [part.split("/") for part in given.split(",") if part.strip()]
    elif isinstance(given, list) and not any(isinstance(part, list) for part in given):
        given = [given]
    if not isinstance(given, list) or not all(isinstance(one, list) and len(one) == 2 for one in given):
        raise GeoError(
            f"{where}: priority_after {str(stated['priority_after'])[:60]!r} cannot be read: {how}"
        )
    falls: list[tuple[float, float]] = []
    for moment, worth in given:
        end = _end(where, "priority_after", moment, site)
        if end.seconds is None:
            raise GeoError(f"{where}: priority_after needs a moment or seconds, got {str(moment)!r}: {how}")
        try:
            value = float("nan") if isinstance(worth, bool) else float(worth)
        except (TypeError, ValueError):
            value = float("nan")
        last = falls[-1] if falls else (-float("inf"), priority)
        if not 0.0 <= value <= last[1]:
            raise GeoError(
                f"{where}: priority_after falls from {last[1]:g} to {str(worth)!r}: {how}, and not above it"
            )
        if not end.seconds > last[0]:
            raise GeoError(f"{where}: priority_after has {str(moment).strip()} after a later moment")
        falls.append((end.seconds, value))
    return tuple(falls)


def read_windows(
    where: str,
    stated: Mapping[str, Any],
    site: Site | None,
    duration: float | None,
    until: float,
    speed: Callable[[np.ndarray], np.ndarray] | None = None,
) -> tuple[tuple[float, float], ...]:
    """Return the intervals in which a task may begin, s since the departure, in order; empty for any time.

    Args:
        where: the file and the row or feature, as messages name it.
        stated: as for `read_spans`; `windows` may be "slack < speed" too. And `window`: "whole" where all
            of the task must lie in a window, which is the default, or "begin".
        site: has the departure that moments count from.
        duration: s, of the task at a point; None for a survey line, whose windows stay as they are.
        until: s, when missions are over; times of day are taken on all days until then.
        speed: m/s, of the current at the place at times [n] s, for slack water; None where no current is
            forecast.

    Raises:
        GeoError: as `read_spans`; slack water never is, or no current is forecast; a window is too short for
            the task, or all lie outside the time of the mission.
    """
    kind = str(stated.get("window") or "whole").strip().lower()
    if kind not in ("whole", "begin"):
        raise GeoError(f"{where}: window must be 'whole' or 'begin', got {kind!r}")
    if duration is None and kind == "begin":
        raise GeoError(
            f"{where}: each part of a survey line lies in a window as a whole: leave out window: begin"
        )
    if match := _SLACK.fullmatch(str(stated.get("windows") or "").strip().lower()):
        spans = _by_current(where, match[1], speed, until)
    else:
        spans = read_spans(where, stated, site, until)
    if kind == "whole" and spans and duration is not None:
        longest = max(closes - opens for opens, closes in spans)
        if longest < duration:
            raise GeoError(
                f"{where}: the task takes {duration:g} s, its longest window {longest:g} s: "
                "window: begin asks only that it begins in one"
            )
        spans = [(opens, closes - duration) for opens, closes in spans if closes - opens >= duration]
    if spans and not any(closes >= 0.0 and opens <= until for opens, closes in spans):
        if all(closes < 0.0 for _, closes in spans):
            dated = f", {site.epoch:%Y-%m-%d %H:%M} UTC" if site is not None and site.epoch else ""
            raise GeoError(f"{where}: all its windows are over at the departure{dated}")
        raise GeoError(f"{where}: all its windows lie outside the mission, which may last {until:g} s")
    return tuple(spans)


def _by_current(
    where: str, stated: str, speed: Callable[[np.ndarray], np.ndarray] | None, until: float
) -> list[tuple[float, float]]:
    """Times at which the current is slower than a limit, to the minute."""
    try:
        limit = float(stated)
    except ValueError:
        limit = float("nan")
    if not limit > 0.0:
        raise GeoError(f"{where}: slack water is given in m/s, such as slack < 0.2, got {stated!r}")
    if speed is None:
        raise GeoError(
            f"{where}: slack water needs a current that is forecast: current.source 'file' or 'harmonic'"
        )
    moments = np.arange(0.0, until + _MINUTE, _MINUTE)
    found = np.asarray(speed(moments), float)
    slack = found < limit
    if not slack.any():
        raise GeoError(
            f"{where}: the current is never below {limit:g} m/s there in the time of the mission: "
            f"{found.min():.2f} m/s is the least"
        )
    return [(float(moments[i]), float(moments[j])) for i, j in _runs(slack) if j > i]


def _runs(wanted: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every unbroken run of True."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], wanted, [False]]).astype(int)))
    return list(zip(change[::2].tolist(), (change[1::2] - 1).tolist(), strict=True))


def _pairs(where: str, stated: Mapping[str, Any]) -> list[tuple[Any, Any]]:
    """Beginnings and ends as the file has them."""
    several, ends = stated.get("windows"), (stated.get("from"), stated.get("to"))
    if several in (None, "", []):
        return [] if all(_is_open(end) for end in ends) else [ends]
    if not all(_is_open(end) for end in ends):
        raise GeoError(f"{where}: has from or to, and windows: put all into windows")
    if isinstance(several, str):
        several = [part.split("/") for part in several.split(",") if part.strip()]
    if not isinstance(several, list) or not all(
        isinstance(pair, list) and len(pair) == 2 for pair in several
    ):
        raise GeoError(f"{where}: windows must be pairs [from, to], got {str(stated['windows'])[:60]!r}")
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
    minutes, height = _elevations(site.latitude, site.longitude, epoch, until)
    wanted = (height > _SUNRISE) == (kind == "daylight")
    if not wanted.any():
        raise GeoError(f"{where}: there is no {kind} at the site in the time of the mission")
    minutes = np.concatenate([[-np.inf], minutes[1:-1], [np.inf]])
    spans = [(float(minutes[i]), float(minutes[j])) for i, j in _runs(wanted)]
    return [(opens, closes) for opens, closes in spans if closes >= 0.0 and opens <= until]


@lru_cache(maxsize=4)  # jobs of a file ask for the same sun
def _elevations(
    latitude: float, longitude: float, epoch: datetime, until: float
) -> tuple[np.ndarray, np.ndarray]:
    """Minutes from a day before the departure until one after the mission, s; the sun's height, degrees."""
    from astral import Observer
    from astral.sun import elevation

    place, minutes = Observer(latitude, longitude), np.arange(-_DAY, until + _DAY, 60.0)
    moments = (epoch + timedelta(seconds=float(moment)) for moment in minutes)
    return minutes, np.array([elevation(place, moment) for moment in moments])


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
