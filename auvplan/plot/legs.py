"""Which leg and which plans the figures of single legs show."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auvplan.ocean.currents import evaluated
from auvplan.records import LegRecord, MissionRun, PlanRecord

Array = NDArray[np.floating]


def busiest_leg(run: MissionRun) -> LegRecord | None:
    """Return the leg with most plans, then most obstacles.

    A sailed one where there is any. None without plans.
    """
    planned = [leg for leg in run.legs if leg.plans]
    if not planned:
        return None
    return max(planned, key=lambda leg: (len(leg.times) > 0, len(leg.plans), len(leg.obstacle_radii)))


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
    causes = {"leg": first, "window": f"re-plan {index}, window", "hazard": f"re-plan {index}, hazard"}
    return f"{causes.get(plan.cause, plan.cause)}, t = {plan.made_at:,.0f} s"


def sailed_until(leg: LegRecord, time: float) -> Array:
    """[n, 3] m, the sailed positions up to a time."""
    return leg.positions[leg.times <= time] if len(leg.times) else np.zeros((0, 3))


def extent_points(leg: LegRecord) -> Array:
    """[n, 3] m, all positions planned or sailed on a leg."""
    return np.concatenate([leg.positions, *(plan.positions for plan in leg.plans)])


def current_at(plan: PlanRecord, x: Array, y: Array, z: float) -> tuple[Array, Array, Array]:
    """Return the true current when a plan was made, m/s north, east, down, on arrays x, y at depth z m."""
    u, v, w = evaluated(plan.current, x, y, np.full_like(x, z), np.full_like(x, plan.made_at))
    return np.asarray(u), np.asarray(v), np.asarray(w)


def followed_plans(leg: LegRecord) -> list[PlanRecord]:
    """Plans that were followed: the one that the leg was begun with, and the last one of each re-plan."""
    if not leg.plans:
        return []
    later = {plan.made_at: plan for plan in leg.plans[leg.followed + 1 :] if plan.cause != "leg"}
    return [leg.plans[leg.followed], *later.values()]


def until_next(plans: Sequence[PlanRecord], index: int) -> tuple[Array, Array]:
    """Split a followed plan at the next re-plan: the part sailed and the part given up, [n, 3] m each."""
    positions = plans[index].positions
    if index + 1 == len(plans):
        return positions, positions[:0]
    end = plans[index + 1].positions[0]
    nearest = int(np.argmin(np.linalg.norm(positions - end, axis=1)))
    return np.concatenate([positions[:nearest], end[None]]), np.concatenate(
        [end[None], positions[nearest + 1 :]]
    )
