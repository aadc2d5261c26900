"""Along a given order of waypoints, at which of them a vehicle surfaces for a fix."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.navigation import Navigation

Array = NDArray[np.floating]


@dataclass(frozen=True)
class Order:
    """An order of n + 1 waypoints, and what surfacing at each of them costs.

    Attributes:
        legs: [n, 2] m through the water and s out of bottom lock, of the leg to each waypoint but the first.
        stays: [n, 2] the same, at each waypoint but the last, before the vehicle would surface there.
        dives: [n, 2] the same, from a fix there back down.
        price: [n] s that surfacing at each waypoint but the last is worth: its time, and its risk as time;
            infinite where the vehicle must not.
        most: [n] m, standard deviation on arrival at each waypoint but the first, at most.
    """

    legs: Any
    stays: Any
    dives: Any
    price: Any
    most: Any


@dataclass(frozen=True)
class Surfacings:
    """Where a vehicle surfaces.

    Attributes:
        at: places in the order, from 0.
        price: s, of all of them.
        std: [n] m, on arrival at each waypoint but the first, as far as the vehicle gets.
        lacking: place in the order of the waypoint whose limit cannot be met, and the least standard
            deviation, m, with which it can be reached where those before it keep theirs; None where all do.
    """

    at: tuple[int, ...]
    price: float
    std: Array
    lacking: tuple[int, float] | None = None


def surfacings(known: Navigation, order: Order) -> Surfacings:
    """Return the cheapest surfacings that keep all limits.

    A fix makes what was before it count no more: the cheapest way to have one at a waypoint goes on from the
    cheapest way to have the last one before it. So n (n + 1) / 2 pairs of fixes are looked at, and the result
    is exact (dynamic programming). Of equally cheap ways that with the earliest last fix is taken. Where a
    limit cannot be met the vehicle surfaces as is cheapest up to the waypoint before, and there as well if
    that is how it comes nearest to the limit.

    Args:
        known: navigation at the first waypoint.
        order: of the waypoints.
    """
    legs, stays, dives = (
        np.asarray(part, float).reshape(-1, 2) for part in (order.legs, order.stays, order.dives)
    )
    price, most, count = np.asarray(order.price, float), np.asarray(order.most, float), len(legs)
    # By waypoint, the last fix on the cheapest way to it and what that costs; -1 stands for that before all.
    reached = [(0.0, -1), *[(np.inf, -1)] * count]
    nearest = [(np.inf, -1)] * (count + 1)  # least standard deviation on arrival there, and the last fix
    for fix in range(-1, count):
        place = max(fix, 0)
        cost = 0.0 if fix < 0 else reached[fix][0] + price[fix]
        if not np.isfinite(cost):
            continue
        state = known.after(*stays[0]) if fix < 0 else known.since(*dives[fix])
        for last in range(place, count):
            state = (state if last == place else state.after(*stays[last])).after(*legs[last])
            std = float(np.asarray(state.std))
            nearest[last + 1] = min(nearest[last + 1], (std, fix))
            if std > most[last]:
                break
            reached[last + 1] = min(reached[last + 1], (cost, fix))
    lacking = next((k for k, (cost, _) in enumerate(reached) if not np.isfinite(cost)), None)
    fix = reached[-1][1] if lacking is None else nearest[lacking][1]
    at: list[int] = []
    while fix >= 0:
        at, fix = [fix, *at], reached[fix][1]
    std = _along(known, legs[:lacking], stays, dives, at)
    failed = None if lacking is None else (lacking, nearest[lacking][0])
    return Surfacings(tuple(at), float(sum(price[at])), std, failed)


def _along(known: Navigation, legs: Array, stays: Array, dives: Array, at: list[int]) -> Array:
    """Standard deviations on arrival at the end of each leg, m, with fixes at some waypoints."""
    found, state = [], known
    for k, leg in enumerate(legs):
        state = (state.since(*dives[k]) if k in at else state.after(*stays[k])).after(*leg)
        found.append(float(np.asarray(state.std)))
    return np.asarray(found)
