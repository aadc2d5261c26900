"""Upper bound on the total priority of a mission that may visit waypoints again (section 3.3.2).

Where re-planning bars the passed edges alone, a whole mission is a trail: no edge is taken twice, in either
direction, but waypoints may be. `upper_bound` does not cover that, since it counts each waypoint once.
"""

from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, hstack, vstack

from auvplan.mission.bound import (
    LEAST_VIOLATION,
    Array,
    IntArray,
    checked,
    edges_in_time,
    flow_capacity,
    minimum_cut,
    rounded_down,
    solve_relaxation,
)


def trail_bound(
    leg_times: Any,
    priority: Any,
    start: int,
    goal: int,
    time_available: float,
    *,
    waypoint_priority: Any = None,
    waypoint_duration: Any = None,
    rounds: int = 12,
) -> float:
    """Bound the total priority of any trail from the start to the goal in time, each task counted once.

    A trail is a unit flow x_ij <= 1 on the edges with x_ij + x_ji <= 1; the task at waypoint j is y_j <= 1
    with y_j <= x(edges into j), done on the first arrival. sum(t_ij x_ij) + sum(delta_j y_j) <= T, and
    x(edges into S) >= x_ij + x_ji for edges inside sets S without the start, found by minimum cuts. As for
    `upper_bound`, the value of the dual multipliers is the bound.

    Args:
        leg_times: [N, N] s, t_ij with the tasks of edge and waypoint; infinite off the edges.
        priority: [N, N] rho_ij >= 0 of edge and waypoint together.
        start, goal: indices.
        time_available: T, s; a mission takes strictly less.
        waypoint_priority: [N], the part of `priority` of every edge into a waypoint that counts once, as in
            `MissionGraph`; zeros if absent.
        waypoint_duration: [N] s, the same part of `leg_times`.
        rounds: linear programs solved at most, at least 1.

    Returns:
        Bound on the sum of priorities, rounded down to a multiple of `common_step` where there is one; 0.0
        where the goal is the start or cannot be reached in time, tasks at waypoints left out.

    Raises:
        ValueError: an argument is out of range or of the wrong shape.

    Example:
        >>> import numpy as np
        >>> times = np.full((3, 3), np.inf)
        >>> times[0, 1] = times[1, 0] = times[1, 2] = times[0, 2] = times[2, 0] = 10.0
        >>> trail_bound(times, np.isfinite(times) * 2.0, 0, 2, 45.0)
        4.0
    """
    times, rho = checked(leg_times, priority, start, goal, time_available)
    if rounds < 1:
        raise ValueError(f"rounds must be at least 1, got {rounds}")
    size = len(times)
    once = _per_waypoint("waypoint_priority", waypoint_priority, size)
    stay = _per_waypoint("waypoint_duration", waypoint_duration, size)
    # What is done on the first arrival alone is no part of the later ones.
    travel = np.where(np.isfinite(times), np.maximum(times - stay, 0.0), np.inf)
    tails, heads = edges_in_time(travel, start, goal, time_available, revisits=True)
    if start == goal or not len(tails):
        return 0.0
    edges, count = np.arange(len(tails)), len(tails)
    own = np.maximum(rho[tails, heads] - once[heads], 0.0)
    profit = np.r_[own, once]

    into = csr_matrix((np.ones(count), (heads, edges)), (size, count))
    out_of = csr_matrix((np.ones(count), (tails, edges)), (size, count))
    balance = csr_matrix(hstack([out_of - into, csr_matrix((size, size))]))
    supply = np.zeros(size)
    supply[[start, goal]] = 1.0, -1.0
    pair = _pairs(tails, heads)
    many = int(pair.max()) + 1
    pairs = csr_matrix((np.ones(count), (pair, edges)), (many, count))
    identity = csr_matrix(np.eye(size))
    rows = [
        csr_matrix(np.r_[travel[tails, heads], stay][None] / time_available),
        hstack([pairs, csr_matrix((many, size))]),
        hstack([csr_matrix((size, count)), identity]),
        hstack([-into, identity]),
    ]
    limits = [np.ones(1 + many + size), np.zeros(size)]

    dearest = np.zeros(many)
    np.maximum.at(dearest, pair, own)
    best = float(dearest.sum() + once.sum())
    for _ in range(rounds):
        matrix, limit = csr_matrix(vstack(rows)), np.concatenate(limits)
        solved = solve_relaxation(profit, matrix, limit, balance, supply)
        if solved is None:
            break
        values, value = solved
        best = min(best, value)
        cuts = _cuts(tails, heads, pair, values[:count], size, start)
        if not len(cuts):
            break
        rows.append(csr_matrix(np.pad(cuts, [(0, 0), (0, size)])))
        limits.append(np.zeros(len(cuts)))
    return rounded_down(best + 1e-9 * (1.0 + best), profit)


def _per_waypoint(name: str, value: Any, size: int) -> Array:
    found = np.zeros(size) if value is None else np.asarray(value, float)
    if found.shape != (size,):
        raise ValueError(f"{name} must be [N] = ({size},), got shape {found.shape}")
    if not (np.isfinite(found) & (found >= 0.0)).all():
        raise ValueError(f"{name} must be finite and not negative")
    return found


def _pairs(tails: IntArray, heads: IntArray) -> IntArray:
    """Number of the two waypoints that each edge joins, [M]; the same for both directions."""
    names = np.stack([np.minimum(tails, heads), np.maximum(tails, heads)])
    return np.unique(names, axis=1, return_inverse=True)[1].ravel()


def _cuts(tails: IntArray, heads: IntArray, pair: IntArray, flow: Array, size: int, start: int) -> Array:
    """Rows of x_ij + x_ji <= x(edges into S), [K, M], for the sets found violated."""
    capacity = flow_capacity(tails, heads, flow, size)
    visits = np.bincount(heads, flow, size)
    covered, rows = np.zeros(size, bool), []
    covered[start] = True
    for waypoint in np.argsort(-visits, kind="stable").tolist():
        if covered[waypoint] or visits[waypoint] < LEAST_VIOLATION:
            continue
        entering, nearest, largest = minimum_cut(capacity, start, waypoint, size)
        for inside in (nearest, largest):
            within = inside[tails] & inside[heads]
            if not within.any():
                continue
            both = pair == pair[int(np.argmax(np.where(within, flow, -1.0)))]
            if flow[both].sum() > entering + LEAST_VIOLATION:
                rows.append(both * 1.0 - (inside[heads] & ~inside[tails]))
                covered |= nearest
    return np.array(rows).reshape(len(rows), len(tails))
