"""The legs of a mission on the time line: as each route planned them, and as they were executed."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from auvplan.records import MissionRun, RouteRecord


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
    # A refused leg was planned after all, and later routes reckon with what its path takes.
    for leg in run.legs:
        if not len(leg.times) and leg.plans and leg.plans[-1].made_at <= route.made_at:
            travel[leg.start, leg.goal] = leg.plans[-1].times[-1] - leg.plans[-1].times[0]
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
    if not before or before[-1].t_path + before[-1].t_task <= before[-1].t_expected:
        return ""
    leg = before[-1]
    return f"{leg.start}→{leg.goal} took {leg.t_path + leg.t_task:,.0f} s, not {leg.t_expected:,.0f} s"
