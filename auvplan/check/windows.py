"""Whether tasks were done within their time windows."""

import re
from collections.abc import Iterator

import xarray as xr

from auvplan.check.inputs import Job, Spans, read_jobs
from auvplan.check.legs import TIME_TOLERANCE, Leg, scenario_of, waypoint_names

#: s from the edge of a window within which an arrival may have missed it.
_EDGE = 1.0


def window_faults(dataset: xr.Dataset, legs: list[Leg]) -> Iterator[str]:
    """Yield tasks that were begun or ended outside their windows, and waiting for none."""
    settings, jobs = scenario_of(dataset), read_jobs(dataset)
    if jobs is None and settings.get("mission", {}).get("jobs"):
        return  # that they were not saved is noted with the tasks
    timed = {job.name: job for job in jobs or () if job.windows}
    # For an area to open a vehicle waits where no window asks for it.
    closing = bool((settings.get("chart") or {}).get("no_go"))
    names = waypoint_names(dataset)
    for leg in legs:
        if not leg.arrived:
            continue
        if (line := timed.get(_line_of(names, leg))) is not None:
            begins, ends = float(leg.times[0]), float(leg.times[-1]) + leg.t_task
            if leg.priority > 0.0 and not _within(begins, ends, line.windows):
                said = f"a part of line {line.name!r} from {begins:.0f} to {ends:.0f} s"
                yield f"{leg}: {said} is in none of its windows"
            continue
        point = timed.get(names[leg.goal] if leg.goal < len(names) else "")
        if point is None or point.is_line:
            if leg.t_wait > TIME_TOLERANCE and not closing:
                yield f"{leg}: waits {leg.t_wait:.0f} s for a task without a time window"
            continue
        yield from _point_faults(dataset, leg, point)


def _point_faults(dataset: xr.Dataset, leg: Leg, job: Job) -> Iterator[str]:
    """Yield that a task at a point does not begin in a window of it, or is missed although it could."""
    arrival = float(leg.times[-1])
    if leg.missed:
        open_ = _within(arrival, arrival, job.windows, -_EDGE)
        if open_ and "window_opens" in dataset:  # which areas that are closed may have narrowed
            ends = (dataset[f"window_{name}"].values[leg.goal] for name in ("opens", "closes"))
            open_ = _within(arrival, arrival, list(zip(*ends, strict=True)), -_EDGE)
        if open_:
            yield f"{leg}: misses the task at {job.name!r}, in whose window it arrives"
    begins = arrival + leg.t_wait
    # Without a priority it was done before, or missed.
    if leg.priority > 0.0 and not _within(begins, begins, job.windows):
        said = f"the task at {job.name!r} from {begins:.0f} to {begins + leg.t_task:.0f} s"
        yield f"{leg}: {said} is in none of its windows"


def _line_of(names: list[str], leg: Leg) -> str:
    """Return the survey line along which a leg leads from vertex to vertex, or an empty string."""
    if max(leg.start, leg.goal) >= len(names):
        return ""
    first, last = (re.fullmatch(r"(.*)\[(\d+)\]", names[node], re.DOTALL) for node in (leg.start, leg.goal))
    if first is None or last is None or first[1] != last[1] or abs(int(first[2]) - int(last[2])) != 1:
        return ""
    return first[1]


def _within(begins: float, ends: float, spans: Spans, slack: float = TIME_TOLERANCE) -> bool:
    """Return whether a time lies in one of several spans."""
    return any(opens - slack <= begins and ends <= closes + slack for opens, closes in spans)
