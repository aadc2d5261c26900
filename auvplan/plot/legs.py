"""Which leg and which plans the figures of single legs show."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auvplan.errors import AuvplanError
from auvplan.ocean.currents import evaluated
from auvplan.records import LegRecord, MissionRun, PlanRecord
from auvplan.words import counted

Array = NDArray[np.floating]


def busiest_leg(run: MissionRun) -> LegRecord | None:
    """Return the leg that tells most: of most re-plans, then the one that passed an obstacle most closely.

    An executed one where there is any. None without plans.
    """
    planned = [leg for leg in run.legs if leg.plans]
    if not planned:
        return None
    return max(planned, key=lambda leg: (len(leg.times) > 0, leg.path_replans, -clearance(leg)))


def done_leg(run: MissionRun, number: int) -> LegRecord:
    """Return one of the legs whose goal was reached, by its number from 1.

    Raises:
        AuvplanError: there is none of that number; one line that says which there are.
    """
    count = len(run.done)
    if not 1 <= number <= count:
        which = f"choose 1 to {count}, or all" if count else "leave it out"
        raise AuvplanError(f"leg {number}: the run has {counted(count, 'done leg')}: {which}")
    return run.done[number - 1]


def clearance(leg: LegRecord) -> float:
    """Least distance of the executed track to a true obstacle's surface, m; infinite without obstacles."""
    tracks = np.asarray(leg.obstacle_positions, float)
    if not tracks.size:
        return float("inf")
    apart = tracks - leg.positions[:, None]
    steps = np.diff(apart, axis=0)
    # Between records both move straight: the nearest point of each step.
    square = np.maximum((steps**2).sum(axis=-1), 1e-12)
    share = np.clip(-(apart[:-1] * steps).sum(axis=-1) / square, 0.0, 1.0)
    closest = np.concatenate([apart, apart[:-1] + share[..., None] * steps])
    return float((np.linalg.norm(closest, axis=-1) - leg.obstacle_radii).min())


def leg_title(run: MissionRun, leg: LegRecord) -> str:
    """Return which leg a figure shows, and on a second line why; the first line alone where there is one."""
    name = f"leg {run.called(leg.start)} → {run.called(leg.goal)}"
    if len(run.legs) == 1:
        return name
    if not len(leg.times):
        return f"{name}\nplanned and refused"
    number = next((k for k, one in enumerate(run.done, start=1) if one is leg), None)
    name = f"{name}, not finished" if number is None else f"leg {number} of {len(run.done)}: {name[4:]}"
    replans, distance = counted(leg.path_replans, "re-plan"), clearance(leg)
    passed = "" if np.isinf(distance) else f", {distance:,.0f} m clear of obstacles"
    if leg is not busiest_leg(run):
        return f"{name}\n{replans}{passed}"
    executed = [one for one in run.legs if len(one.times) and one.plans]
    if sum(one.path_replans == leg.path_replans for one in executed) == 1:
        return f"{name}\nmost re-plans ({leg.path_replans}){passed}"
    closest = passed and f"; of such legs nearest to an obstacle, {distance:,.0f} m"
    return f"{name}\n{replans}, as many as any{closest}"


def chosen_plans(leg: LegRecord, most: int) -> list[int]:
    """Return indices of at most `most` plans.

    The first, those of the windows, then others, in the order of time.
    """
    rank = {"leg": 0, "window": 1}
    first = sorted(range(len(leg.plans)), key=lambda k: (rank.get(leg.plans[k].cause, 2), k))
    return sorted(first[:most])


def plan_name(leg: LegRecord, index: int) -> str:
    """Return words for a plan: what made it necessary, and when."""
    plan = leg.plans[index]
    first = "first plan" if index == 0 else "first plan, retried"
    number = sum(one.cause != "leg" for one in leg.plans[: index + 1])
    causes = {"leg": first, "window": f"re-plan {number}, window", "hazard": f"re-plan {number}, hazard"}
    return f"{causes.get(plan.cause, plan.cause)}, t = {plan.made_at:,.0f} s"


def executed_until(leg: LegRecord, time: float) -> Array:
    """[n, 3] m, the executed positions up to a time."""
    return leg.positions[leg.times <= time] if len(leg.times) else np.zeros((0, 3))


def extent_points(leg: LegRecord) -> Array:
    """[n, 3] m, all positions planned or executed on a leg."""
    return np.concatenate([leg.positions, *(plan.positions for plan in leg.plans)])


def current_at(plan: PlanRecord, x: Array, y: Array, z: float) -> tuple[Array, Array, Array]:
    """Return the true current when a plan was made, m/s north, east, down, on arrays x, y at depth z m."""
    u, v, w = evaluated(plan.current, x, y, np.full_like(x, z), np.full_like(x, plan.made_at))
    return np.asarray(u), np.asarray(v), np.asarray(w)


def refused_legs(run: MissionRun) -> list[LegRecord]:
    """Legs that were planned and never executed."""
    return [leg for leg in run.legs if leg.plans and not len(leg.times)]


def until_next(plans: Sequence[PlanRecord], index: int) -> tuple[Array, Array]:
    """Split a followed plan at the next re-plan: the part executed and the part given up, [n, 3] m each."""
    positions = plans[index].positions
    if index + 1 == len(plans):
        return positions, positions[:0]
    end = plans[index + 1].positions[0]
    nearest = int(np.argmin(np.linalg.norm(positions - end, axis=1)))
    return np.concatenate([positions[:nearest], end[None]]), np.concatenate(
        [end[None], positions[nearest + 1 :]]
    )
