"""Whether tasks were done within their time windows."""

import re
from collections.abc import Iterator

from auvplan.check.inputs import Job, read_jobs, within
from auvplan.check.saved import TIME_TOLERANCE, Leg, Saved

#: s from the edge of a window within which an arrival may have missed it.
_EDGE = 1.0


def window_faults(run: Saved) -> Iterator[str]:
    """Yield tasks that were begun or ended outside their windows, and waiting for none."""
    jobs, names = read_jobs(run), run.names
    if jobs is None and run.section("mission").get("jobs"):
        return  # that they were not saved is noted with the tasks
    timed = {job.name: job for job in jobs or () if job.windows}
    # For an area to open a vehicle waits where no window asks for it.
    closing = bool(run.section("chart").get("no_go"))
    for leg in run.legs:
        if not leg.arrived:
            continue
        if (line := timed.get(_line_of(names, leg))) is not None:
            begins, ends = float(leg.times[0]), float(leg.times[-1]) + leg.t_task
            if leg.priority > 0.0 and not within(begins, ends, line.windows):
                what = f"a part of line {line.name!r} from {begins:.0f} to {ends:.0f} s"
                yield f"{leg}: {what} is in none of its windows"
            continue
        point = timed.get(names[leg.goal] if leg.goal < len(names) else "")
        if point is None or point.is_line:
            if leg.t_wait > TIME_TOLERANCE and not closing:
                yield f"{leg}: waits {leg.t_wait:.0f} s for a task without a time window"
            continue
        yield from _point_faults(run, leg, point)


def _point_faults(run: Saved, leg: Leg, job: Job) -> Iterator[str]:
    """Yield that a task at a point does not begin in a window of it, or is missed although it could."""
    arrival = float(leg.times[-1])
    if leg.missed:
        open_ = within(arrival, arrival, job.windows, -_EDGE)
        if open_ and "window_opens" in run:  # which areas that are closed may have narrowed
            ends = (run[f"window_{name}"][leg.goal] for name in ("opens", "closes"))
            open_ = within(arrival, arrival, list(zip(*ends, strict=True)), -_EDGE)
        if open_:
            yield f"{leg}: misses the task at {job.name!r}, in whose window it arrives"
    begins = arrival + leg.t_wait
    # Without a priority it was done before, or missed.
    if leg.priority > 0.0 and not within(begins, begins, job.windows):
        what = f"the task at {job.name!r} from {begins:.0f} to {begins + leg.t_task:.0f} s"
        yield f"{leg}: {what} is in none of its windows"


def _line_of(names: list[str], leg: Leg) -> str:
    """Return the survey line along which a leg leads from vertex to vertex, or an empty string."""
    if max(leg.start, leg.goal) >= len(names):
        return ""
    first, last = (re.fullmatch(r"(.*)\[(\d+)\]", names[node], re.DOTALL) for node in (leg.start, leg.goal))
    if first is None or last is None or first[1] != last[1] or abs(int(first[2]) - int(last[2])) != 1:
        return ""
    return first[1]
