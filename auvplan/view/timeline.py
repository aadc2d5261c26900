"""The time line of a mission: legs as routes planned them and as executed, closed areas, times in words."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple
from zoneinfo import ZoneInfo

import numpy as np

from auvplan.mission.timetable import Timetable
from auvplan.records import MissionRun, RouteRecord
from auvplan.runtime.formatting import counted, hours
from auvplan.view.scene import short_name

#: What a vehicle does at the last waypoint, in words.
END_BEHAVIOURS = {
    "surface": "surface at the last waypoint",
    "station": "keep station at the last waypoint, at its depth",
    "loiter": "loiter about the last waypoint, at its depth",
}


@dataclass(frozen=True)
class Bar:
    """One leg on the time line, s: `travel`, then `wait`, then `task`."""

    start: int
    goal: int
    begin: float
    travel: float
    task: float
    priority: float
    wait: float = 0.0

    @property
    def ends(self) -> float:
        """When it is over, s."""
        return self.begin + self.travel + self.wait + self.task


def planned_bars(run: MissionRun, route: RouteRecord) -> list[Bar]:
    """Return a route's legs by the times that were expected when it was made."""
    times = np.asarray(run.graph.leg_times(float(run.vehicle.speed)))  # type: ignore[arg-type]
    travel = times - np.asarray(run.graph.duration)
    legs = list(pairwise(route.nodes))
    waits = dict.fromkeys(legs, 0.0) | dict(zip(legs, route.waits, strict=False))
    for (i, j), seconds in zip(legs, route.leg_times, strict=False):
        travel[i, j] = max(seconds - waits[i, j] - float(run.graph.duration[i, j]), 0.0)
    bars, now = [], route.made_at
    for i, j in legs:
        task = float(run.graph.duration[i, j])
        bar = Bar(i, j, now, float(travel[i, j]), task, float(run.graph.priority[i, j]), waits[i, j])
        bars.append(bar)
        now = bar.ends
    return bars


def executed_bars(run: MissionRun) -> list[Bar]:
    """Return the legs as executed, or as a plan has them; refused ones are left out."""
    bars = []
    for leg in run.legs:
        if len(leg.times):
            task = leg.t_task if leg.arrived else 0.0
            wait, begin = leg.t_wait if leg.arrived else 0.0, float(leg.times[0])
            bars.append(Bar(leg.start, leg.goal, begin, leg.t_path, task, leg.priority, wait))
    return bars


def lateness(run: MissionRun, route: RouteRecord) -> str:
    """Return words for the leg that a route was made after; empty where it took no longer than expected."""
    before = [leg for leg in run.done if leg.times[-1] + leg.t_task <= route.made_at + 1.0]
    if not before or not run.planning.late(before[-1].t_path, before[-1].t_task, before[-1].t_expected):
        return ""
    leg = before[-1]
    return f"{leg.start}→{leg.goal} took {leg.t_path + leg.t_task:,.0f} s, not {leg.t_expected:,.0f} s"


def windows_of(table: Timetable, start: int, goal: int) -> list[tuple[float, float]]:
    """Return the windows of the task on an edge, s; none where it may be done at any time.

    A task at the waypoint begins in one of them, one along the edge lies in one whole. These count first.
    """
    for opens, closes in ((table.enters, table.until), (table.opens, table.closes)):
        spans = list(zip(opens[start, goal].tolist(), closes[start, goal].tolist(), strict=True))
        spans = [(begin, end) for begin, end in spans if begin < end]
        if spans and (-np.inf, np.inf) not in spans:
            return spans
    return []


def doings(run: MissionRun) -> list[tuple[float, str]]:
    """Return what the vehicle does, in words, and the moments, s, from which on it does; in order.

    Before the first of them it has not begun.
    """
    found: list[tuple[float, str]] = []
    last = max((number for number, leg in enumerate(run.legs) if len(leg.times)), default=0)
    for number, leg in enumerate(run.legs):
        if not len(leg.times):
            continue
        goal, ends = short_name(run, leg.goal), float(leg.times[-1])
        title = f"leg {number + 1}: {short_name(run, leg.start)} → {goal}"
        found.append((float(leg.times[0]), title))
        later = enumerate(leg.followed_plans[1:], start=1)
        found += [(plan.made_at, f"{title}, {counted(count, 're-plan')}") for count, plan in later]
        if not leg.arrived:
            found.append((ends, f"ended on leg {number + 1}"))
            continue
        for seconds, what in ((leg.t_wait, "waiting at"), (leg.t_task, "on station at")):
            if seconds:
                found.append((ends, f"{what} {goal}"))
                ends += seconds
        found.append((ends, f"{'arrived at' if number == last else 'at'} {goal}"))
    return found


def spans_in_words(run: MissionRun, spans: Iterable[tuple[float, float]]) -> str:
    """Return the intervals of time, s, that touch the mission, in words; empty where one of them is all time.

    Where none does, those next to it.
    """
    stated = sorted((opens, closes) for opens, closes in spans if opens < closes)
    if (-np.inf, np.inf) in stated:
        return ""
    end = max(run.t_available, run.t_mission)
    before, after = [span for span in stated if span[1] < 0.0], [span for span in stated if span[0] > end]
    touching = [span for span in stated if span[1] >= 0.0 and span[0] <= end]
    words = []
    for opens, closes in touching or [*before[-1:], *after[:1]]:
        first = "" if np.isinf(opens) else time_in_words(run, opens)
        last = "" if np.isinf(closes) else time_in_words(run, closes, opens if first else 0.0)
        words.append(f"{first}-{last}")
    return ", ".join(words)


def time_in_words(run: MissionRun, seconds: float, since: float = 0.0) -> str:
    """Return a moment to the minute: UTC, dated on another day than `since`, or since the departure."""
    site, whole = run.site, 60.0 * round(seconds / 60.0)
    moment, known = (None, None) if site is None else (site.utc(whole), site.utc(since))
    if moment is None or known is None:
        return hours(seconds)
    return f"{moment:%H:%M}" if moment.date() == known.date() else f"{moment:%Y-%m-%d %H:%M}"


def time_zone(run: MissionRun) -> str:
    """Return the name of the local time zone, or nothing."""
    return str((run.scenario.get("site") or {}).get("timezone") or "")


def moment_in_words(run: MissionRun, seconds: float) -> str:
    """Return a moment to the minute with its date, in UTC and local time; since the departure without one."""
    moment = None if run.site is None else run.site.utc(60.0 * round(seconds / 60.0))
    if moment is None:
        return f"after {hours(seconds)}"
    zone = time_zone(run)
    local = f", {moment.astimezone(ZoneInfo(zone)):%Y-%m-%d %H:%M} {zone.split('/')[-1]}" if zone else ""
    return f"{moment:%Y-%m-%d %H:%M} UTC{local}"


def closures_in_words(run: MissionRun) -> list[str]:
    """Return the name of each area that is closed at some hours, and when it is closed."""
    zone = "" if run.site is None or run.site.epoch is None else " UTC"
    return [f"{closure.name} {spans_in_words(run, closure.spans)}{zone}" for closure in run.stated_closures]


class ClosedArea(NamedTuple):
    """An area on maps: its name with its hours, rings [n, 2] m, spans [m, 2] s in which it is closed."""

    name: str
    rings: Sequence[Any]
    spans: Any


def closed_areas(run: MissionRun) -> list[ClosedArea]:
    """Return the areas that are closed at some hours, and then those that always are."""
    timed = zip(closures_in_words(run), run.stated_closures, strict=True)
    always = [[-np.inf, np.inf]]
    return [
        *(ClosedArea(name, closure.rings, closure.spans) for name, closure in timed),
        *(ClosedArea(zone.name, zone.rings, always) for zone in run.zones),
    ]
