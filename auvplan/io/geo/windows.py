"""Time windows of jobs in files: moments, times of day, daylight, or seconds since the departure."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, time, timedelta
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from auvplan.io.geo.error import GeoError, number_of
from auvplan.site import Site

#: s.
_DAY, _MINUTE = 86_400.0, 60.0
#: Degrees that the sun's middle is above the horizon at its rise and set, refraction and radius included.
_SUNRISE = -0.833
_TIME_OF_DAY = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:\.\d+)?))?\s*(Z|[+-]\d{2}:?\d{2})?")
_SLACK = re.compile(r"slack\s*<\s*(.*?)(?:\s*m/s)?")
_HOW = "write a moment such as 2026-03-01T08:00Z, a time of day such as 08:00+10:00, or seconds"
_HOW_FALLS = "write moment/priority, such as 2026-03-01T08:00Z/2"

Spans = list[tuple[float, float]]


@dataclass(frozen=True)
class Hours:
    """What a row or feature of a file states of times; all are read as s since the departure.

    Attributes:
        where: the file and the row or feature, as messages name it.
        stated: its cells or properties: `from` and `to`, or several `windows`, as pairs or as text,
            "from/to, from/to", or the word daylight or night; `window` and `priority_after`.
        site: has the departure that moments count from.
        until: s, when missions are over; times of day are taken on all days until then.
        since: s, when the first mission departs, 0 or before.
    """

    where: str
    stated: Mapping[str, Any]
    site: Site | None
    until: float
    since: float = 0.0

    def spans(self) -> Spans:
        """Return intervals of time, in order; empty where none is given.

        Raises:
            GeoError: a time cannot be read or has no zone, an interval ends before it begins, or two overlap.
        """
        sun, spans = self._word("windows"), []
        given = self.stated.get("windows")
        if sun in ("daylight", "night"):  # between sunrise and sunset at the site or not, to the minute
            epoch, given = self._epoch(), None
            assert self.site is not None
            at = self.site.latitude, self.site.longitude
            minutes, height = _elevations(*at, epoch, self.since, self.until)
            wanted = (height > _SUNRISE) == (sun == "daylight")
            if not wanted.any():
                raise self._fault(f"there is no {sun} at the site in the time of the mission")
            endless = np.concatenate([[-np.inf], minutes[1:-1], [np.inf]])
            spans = self._reached_or_all(_runs(wanted, endless))
        pairs = self._pairs("windows", given, "must be pairs [from, to]")
        ends = self.stated.get("from"), self.stated.get("to")
        if not all(map(_is_open, ends)):
            if pairs:
                raise self._fault("has from or to, and windows: put all into windows")
            pairs = [ends]
        for first, last in pairs:
            opens, closes = self._time("from", first), self._time("to", last)
            if isinstance(opens, time) or isinstance(closes, time):
                spans += self._days(opens, closes)
                continue
            span = (-np.inf if opens is None else opens, np.inf if closes is None else closes)
            if not span[0] < span[1]:
                raise self._fault(f"the window from {first} to {last} ends before it begins")
            spans.append(span)
        spans.sort()
        if any(opens < closes for (_, closes), (opens, _) in pairwise(spans)):
            raise self._fault("two windows overlap: make them one")
        return spans

    def falls(self, priority: float) -> tuple[tuple[float, float], ...]:
        """Return moments and the priority that a job has after each, before the first its own.

        They are stated by `priority_after`, as pairs [moment, priority] or as text, "moment/priority,
        moment/priority".

        Raises:
            GeoError: a moment or a priority cannot be read, moments do not rise or priorities do not fall.
        """
        given = self.stated.get("priority_after")
        if isinstance(given, list) and given and not any(isinstance(part, list) for part in given):
            given = [given]
        falls: Spans = []
        for moment, worth in self._pairs("priority_after", given, f"cannot be read: {_HOW_FALLS}"):
            begins = self._time("priority_after", moment)
            if not isinstance(begins, float):
                raise self._fault(
                    f"priority_after needs a moment or seconds, got {str(moment)!r}: {_HOW_FALLS}"
                )
            value, (before, higher) = number_of(worth), falls[-1] if falls else (-np.inf, priority)
            if not 0.0 <= value <= higher:
                raise self._fault(
                    f"priority_after falls from {higher:g} to {str(worth)!r}: {_HOW_FALLS}, and not above it"
                )
            if not begins > before:
                raise self._fault(f"priority_after has {str(moment).strip()} after a later moment")
            falls.append((begins, value))
        return tuple(falls)

    def windows(
        self, duration: float | None, speed: Callable[[np.ndarray], np.ndarray] | None = None
    ) -> tuple[tuple[float, float], ...]:
        """Return the intervals in which a task may begin, in order; empty for any time.

        They are stated as for `spans`, or as "slack < speed". By `window: whole`, the default, all of a task
        must lie in one; by `window: begin` its beginning.

        Args:
            duration: s, of the task at a point; None for a survey line, whose windows stay as they are.
            speed: m/s, of the current at the place at times [n] s, for slack water; None where no current is
                forecast.

        Raises:
            GeoError: as `spans`; slack water never is, or no current is forecast; a window is too short for
                the task, or all lie outside the time of the mission.
        """
        kind = self._word("window") or "whole"
        if kind not in ("whole", "begin"):
            raise self._fault(f"window must be 'whole' or 'begin', got {kind!r}")
        if duration is None and kind == "begin":
            raise self._fault(
                "each part of a survey line lies in a window as a whole: leave out window: begin"
            )
        slack = _SLACK.fullmatch(self._word("windows"))
        spans = self._by_current(slack[1], speed) if slack else self.spans()
        if kind == "whole" and spans and duration is not None:
            longest = max(closes - opens for opens, closes in spans)
            if longest < duration:
                raise self._fault(
                    f"the task takes {duration:g} s, its longest window {longest:g} s: "
                    "window: begin asks only that it begins in one"
                )
            spans = [(opens, closes - duration) for opens, closes in spans if closes - opens >= duration]
        if spans and not self._reached(spans):
            if all(closes < self.since for _, closes in spans):
                moment = None if self.site is None else self.site.utc(self.since)
                dated = "" if moment is None else f", {moment:%Y-%m-%d %H:%M} UTC"
                raise self._fault(f"all its windows are over at the departure{dated}")
            lasts = self.until - self.since
            raise self._fault(f"all its windows lie outside the mission, which may last {lasts:g} s")
        return tuple(spans)

    def _fault(self, line: str) -> GeoError:
        return GeoError(f"{self.where}: {line}")

    def _word(self, name: str) -> str:
        return str(self.stated.get(name) or "").strip().lower()

    def _reached(self, spans: Spans) -> Spans:
        return [(opens, closes) for opens, closes in spans if closes >= self.since and opens <= self.until]

    def _reached_or_all(self, spans: Spans) -> Spans:
        """Return the intervals that the mission reaches into, or all: no interval would mean any time."""
        return self._reached(spans) or spans

    def _epoch(self) -> datetime:
        if self.site is None or self.site.epoch is None:
            raise self._fault("a window by the date needs site.departure; seconds count from the start")
        return self.site.epoch

    def _pairs(self, name: str, given: Any, wrong: str) -> list[tuple[Any, Any]]:
        """Return pairs as a list or a text has them."""
        if given in (None, "", []):
            return []
        pairs = given
        if isinstance(given, str):
            pairs = [part.split("/") for part in given.split(",") if part.strip()]
        if not isinstance(pairs, list) or not all(isinstance(one, list) and len(one) == 2 for one in pairs):
            raise self._fault(f"{name} {str(self.stated[name])[:60]!r} {wrong}")
        return [(first, last) for first, last in pairs]

    def _time(self, name: str, value: Any) -> float | time | None:
        """Return seconds since the departure, a time of day, or None of an end that is left open."""
        if _is_open(value):
            return None
        text = str(value).strip()
        try:
            seconds = float("nan") if isinstance(value, bool) else float(text)
        except ValueError:
            pass
        else:
            if not np.isfinite(seconds):
                raise self._fault(f"{name} must be a finite time, got {text!r}: {_HOW}")
            return seconds
        match = _TIME_OF_DAY.fullmatch(text)
        try:
            if match and match[4]:
                return time.fromisoformat(f"{int(match[1]):02}:{match[2]}:{match[3] or '00'}{match[4]}")
            moment = None if match else datetime.fromisoformat(text)
        except ValueError:
            what = "is no time of day" if match else "cannot be read"
            raise self._fault(f"{name} {text[:40]!r} {what}: {_HOW}") from None
        if moment is None or moment.tzinfo is None:
            raise self._fault(f"{name} {text!r} has no time zone: write {text}Z, or {text}+10:00")
        return (moment - self._epoch()).total_seconds()

    def _days(self, opens: Any, closes: Any) -> Spans:
        """Return windows of every day of the mission; one that ends before it begins goes over midnight."""
        if isinstance(opens, float) or isinstance(closes, float):
            raise self._fault("from and to must both be times of day, or both moments")
        epoch, zone = self._epoch(), (opens or closes).tzinfo
        spans, whole = [], timedelta(days=1)
        for number in range(int(self.since // _DAY) - 1, int(self.until // _DAY) + 3):
            day = epoch.astimezone(zone).date() + timedelta(days=number)
            first, last = (datetime.combine(day, end or time(tzinfo=zone)) for end in (opens, closes))
            last = first + ((last - first) % whole or whole)  # its zone may have another date
            spans.append(((first - epoch).total_seconds(), (last - epoch).total_seconds()))
        return self._reached_or_all(spans)

    def _by_current(self, stated: str, speed: Callable[[np.ndarray], np.ndarray] | None) -> Spans:
        """Return times at which the current is slower than a limit, to the minute."""
        limit = number_of(stated)
        if not limit > 0.0:
            raise self._fault(f"slack water is given in m/s, such as slack < 0.2, got {stated!r}")
        if speed is None:
            raise self._fault(
                "slack water needs a current that is forecast: current.source 'file' or 'harmonic'"
            )
        moments = np.arange(_minute(self.since), self.until + _MINUTE, _MINUTE)
        found = np.asarray(speed(moments), float)
        if not (found < limit).any():
            raise self._fault(
                f"the current is never below {limit:g} m/s there in the time of the mission: "
                f"{found.min():.2f} m/s is the least"
            )
        return [(first, last) for first, last in _runs(found < limit, moments) if last > first]


def _minute(seconds: float) -> float:
    """Return the last whole minute until a time: windows are the same whenever missions depart."""
    return seconds // _MINUTE * _MINUTE


def _is_open(value: Any) -> bool:
    return value is None or str(value).strip() in ("", "..")


def _runs(wanted: np.ndarray, moments: np.ndarray) -> Spans:
    """Return the first and the last moment of every unbroken run of True."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], wanted, [False]]).astype(int)))
    return list(zip(moments[change[::2]].tolist(), moments[change[1::2] - 1].tolist(), strict=True))


@lru_cache(maxsize=4)  # jobs of a file ask for the same sun
def _elevations(
    latitude: float, longitude: float, epoch: datetime, since: float, until: float
) -> tuple[np.ndarray, np.ndarray]:
    """Minutes from a day before the departure until one after the mission, s; the sun's height, degrees."""
    from astral import Observer
    from astral.sun import elevation

    place, minutes = Observer(latitude, longitude), np.arange(_minute(since) - _DAY, until + _DAY, _MINUTE)
    moments = (epoch + timedelta(seconds=float(moment)) for moment in minutes)
    return minutes, np.array([elevation(place, moment) for moment in moments])
