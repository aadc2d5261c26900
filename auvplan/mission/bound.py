"""Upper bounds on the total priority of a mission: linear relaxations with connectivity cuts.

Paths are unit flows x_ij on the edges, and no set of waypoints without the start gains more than flows into
it. Sets for which a solution breaks that are found by minimum cuts, a few in each round. A bound is the value
of the dual multipliers, so that it holds whatever the tolerances of the solver: any multipliers of the right
sign give a valid one.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, hstack, vstack
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from auvplan.mission.graph import time_to_go

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]
BoolArray = NDArray[np.bool_]

LEAST_VIOLATION = 0.01
FLOW_UNITS = 10**6
EDGES_PER_NODE = 12
MOST_STEPS = 1e6

#: Share of all priority that single precision resolves beside the time of a route.
_RESOLVED = 2.0**-12


def upper_bound(
    leg_times: Any,
    priority: Any,
    start: int,
    goal: int,
    time_available: float,
    *,
    rounds: int = 12,
    limits: Sequence[Any] = (),
) -> float:
    """No route from the start to the goal in time has more total priority than this.

    It holds for a whole mission in which no waypoint is visited twice, however often it is re-planned;
    where waypoints may be visited again, `trail_bound` does.

    Flows are relaxed to [0, 1]: conservation at every waypoint, at most one visit of each,
    sum(t_ij x_ij) <= T, and x(edges into S) >= visits of h for sets S of waypoints without the start and h in
    S (generalised subtour elimination).

    Args:
        leg_times: [N, N] s, t_ij with the task; infinite off the edges.
        priority: [N, N] rho_ij >= 0.
        start: index.
        goal: index.
        time_available: T, s; a mission takes strictly less.
        rounds: linear programs solved at most, at least 1; more rounds, tighter bound.
        limits: [N, N] each, finite on the edges: what they take of something of which there is 1.

    Returns:
        Bound on sum(rho_ij), rounded down to a multiple of `common_step` of the priorities where there is
        one. 0.0 where the goal is the start or cannot be reached in time.

    Raises:
        ValueError: an argument is out of range or of the wrong shape.

    Example:
        >>> import numpy as np
        >>> times = np.full((3, 3), np.inf)
        >>> times[0, 1] = times[1, 2] = times[0, 2] = 10.0
        >>> upper_bound(times, np.isfinite(times) * 2.0, 0, 2, 15.0)
        2.0

    References:
        Fischetti, Salazar Gonzalez, Toth (1998), Solving the orienteering problem through branch-and-cut.
    """
    times, rho = checked(leg_times, priority, start, goal, time_available, rounds)
    tails, heads = edges = edges_in_time(times, start, goal, time_available)
    if start == goal or not len(tails):
        return 0.0
    size, count, profit = len(times), len(tails), rho[edges]
    into = _incidence(heads, size)
    pairs = _pair_rows(edges, into)
    taken = [times[edges] / time_available, *(np.asarray(limit, float)[edges] for limit in limits)]
    rows, most = [csr_matrix(np.stack(taken)), into], [np.ones(len(taken) + size)]
    sparse = count <= EDGES_PER_NODE * size
    if sparse:
        rows.append(pairs)
        most.append(np.zeros(len(pairs.indptr) - 1))

    def violated(flow: Array, turn: int) -> list[csr_matrix] | None:
        found = [] if sparse else [pairs[np.flatnonzero(pairs @ flow > LEAST_VIOLATION)]]
        if not sparse and turn == 0:
            return found
        visits, covered = np.bincount(heads, flow, size), np.zeros(size, bool)
        covered[[start, goal]] = True
        sets: dict[bytes, Array] = {}
        for waypoint, entering, nearest, largest in _cuts(edges, flow, covered, start):
            if entering > visits[waypoint] - LEAST_VIOLATION:
                continue
            covered |= nearest
            most_visited = int(np.argmax(np.where(largest, visits, -1.0)))
            for inside, served in ((nearest, waypoint), (largest, most_visited)):
                row = (heads == served) * 1.0 - (inside[heads] & ~inside[tails])
                sets.setdefault(inside.tobytes(), row)
        found.append(csr_matrix(np.array([*sets.values()]).reshape(len(sets), count)))
        return found if any(part.shape[0] for part in found) else None

    dearest = np.zeros(size)
    np.maximum.at(dearest, heads, profit)
    program = _Program(profit, rows, most, edges, (start, goal), size)
    return program.bound(float(dearest.sum()), rounds, violated)


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

    Where re-planning bars the passed edges alone (section 3.3.2), a whole mission is a trail: no edge is
    taken twice, in either direction, but waypoints may be visited again. It is a unit flow x_ij <= 1 on the
    edges with x_ij + x_ji <= 1; the task at waypoint j is y_j <= 1 with y_j <= x(edges into j), done on the
    first arrival. sum(t_ij x_ij) + sum(delta_j y_j) <= T, and x(edges into S) >= x_ij + x_ji for edges inside
    sets S without the start.

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
    times, rho = checked(leg_times, priority, start, goal, time_available, rounds)
    size = len(times)
    once, stay = np.zeros((2, size))
    for name, given, value in (
        ("waypoint_priority", waypoint_priority, once),
        ("waypoint_duration", waypoint_duration, stay),
    ):
        if given is not None and np.shape(given) != (size,):
            raise ValueError(f"{name} must be [N] = ({size},), got shape {np.shape(given)}")
        value[:] = 0.0 if given is None else given
        if not (np.isfinite(value) & (value >= 0.0)).all():
            raise ValueError(f"{name} must be finite and not negative")
    # What is done on the first arrival alone is no part of the later ones.
    travel = np.where(np.isfinite(times), np.maximum(times - stay, 0.0), np.inf)
    tails, heads = edges = edges_in_time(travel, start, goal, time_available, revisits=True)
    if start == goal or not len(tails):
        return 0.0
    count = len(tails)
    own = np.maximum(rho[edges] - once[heads], 0.0)
    into = _incidence(heads, size)
    pair = np.unique(np.sort(edges, axis=0), axis=1, return_inverse=True)[1].ravel()
    many, identity = int(pair.max()) + 1, csr_matrix(np.eye(size))
    rows = [
        csr_matrix(np.r_[travel[edges], stay][None] / time_available),
        hstack(
            [csr_matrix((np.ones(count), (pair, np.arange(count))), (many, count)), csr_matrix((many, size))]
        ),
        hstack([csr_matrix((size, count)), identity]),
        hstack([-into, identity]),
    ]

    def violated(values: Array, _: int) -> list[csr_matrix] | None:
        flow, covered, found = values[:count], np.zeros(size, bool), []
        covered[start] = True
        for _, entering, nearest, largest in _cuts(edges, flow, covered, start):
            for inside in (nearest, largest):
                within = inside[tails] & inside[heads]
                if not within.any():
                    continue
                both = pair == pair[int(np.argmax(np.where(within, flow, -1.0)))]
                if flow[both].sum() > entering + LEAST_VIOLATION:
                    found.append(np.r_[both * 1.0 - (inside[heads] & ~inside[tails]), np.zeros(size)])
                    covered |= nearest
        return [csr_matrix(np.array(found))] if found else None

    dearest = np.zeros(many)
    np.maximum.at(dearest, pair, own)
    best, limits = float(dearest.sum() + once.sum()), [np.ones(1 + many + size), np.zeros(size)]
    program = _Program(np.r_[own, once], rows, limits, edges, (start, goal), size)
    return program.bound(best, rounds, violated)


def _incidence(ends: IntArray, size: int) -> csr_matrix:
    """[N, M] which of the edges have their end at each waypoint, by their heads or tails [M]."""
    return csr_matrix((np.ones(len(ends)), (ends, np.arange(len(ends)))), (size, len(ends)))


def _pair_rows(edges: tuple[IntArray, IntArray], into: csr_matrix) -> csr_matrix:
    """Rows of x_ij + x_ji <= visits of j, [K, M], for each edge whose reverse is there too."""
    (tails, heads), size, count = edges, len(into.indptr) - 1, len(edges[0])
    number = np.full((size, size), -1)
    number[edges] = np.arange(count)
    forth = np.flatnonzero(number[heads, tails] >= 0)
    back = number[heads[forth], tails[forth]]
    row = np.arange(len(forth))
    both = csr_matrix((np.ones(2 * len(row)), (np.r_[row, row], np.r_[forth, back])), (len(row), count))
    return (both - into[heads[forth]]).tocsr()


def _cuts(
    edges: tuple[IntArray, IntArray], flow: Array, covered: BoolArray, start: int
) -> Iterator[tuple[int, float, BoolArray, BoolArray]]:
    """Yield for waypoints visited, the most visited first, the least flow that enters any set with it.

    And two such sets without the start, masks [N]: the smallest, nearest to the waypoint, and the largest.
    Waypoints that are `covered` [N] by then are passed over.
    """
    (tails, heads), size = edges, len(covered)
    visits = np.bincount(heads, flow, size)
    units = np.round(flow * FLOW_UNITS).astype(np.int32)
    used = units > 0
    capacity = csr_matrix((units[used], (tails[used], heads[used])), (size, size))
    for waypoint in np.argsort(-visits, kind="stable").tolist():
        if covered[waypoint] or visits[waypoint] < LEAST_VIOLATION:
            continue
        cut = maximum_flow(capacity, start, waypoint)
        residual = (capacity - cut.flow).tocsr()
        residual.eliminate_zeros()
        nearest, largest = np.zeros(size, bool), np.ones(size, bool)
        nearest[breadth_first_order(residual.T.tocsr(), waypoint, return_predecessors=False)] = True
        largest[breadth_first_order(residual, start, return_predecessors=False)] = False
        yield waypoint, cut.flow_value / FLOW_UNITS, nearest, largest


@dataclass(frozen=True)
class _Program:
    """The linear program: most ``profit @ x`` where ``rows @ x <= limits`` and x [C] >= 0 is a unit flow.

    The flow from the start to the goal, `ends` among `size` waypoints, is x from its first component on, one
    for each of the edges [M]. No x that counts has a component above one.
    """

    profit: Array
    rows: Sequence[Any]
    limits: Sequence[Array]
    edges: tuple[IntArray, IntArray]
    ends: tuple[int, int]
    size: int

    def bound(
        self, best: float, rounds: int, violated: Callable[[Array, int], list[csr_matrix] | None]
    ) -> float:
        """Return the least of `best` and the bounds of some rounds.

        After each round `violated` gives the rows with limits of zero that its solution breaks; None where it
        is the last.
        """
        from scipy.optimize import linprog  # a third of a second, and no plan needs it

        (tails, heads), rows, limits = self.edges, [*self.rows], [*self.limits]
        out_of, into = (_incidence(ends, self.size) for ends in (tails, heads))
        others = csr_matrix((self.size, len(self.profit) - len(tails)))
        balance, supply = csr_matrix(hstack([out_of - into, others])), np.zeros(self.size)
        supply[list(self.ends)] = 1.0, -1.0
        for turn in range(rounds):
            matrix, limit = csr_matrix(vstack(rows)), np.concatenate(limits)
            answer = linprog(
                -self.profit, A_ub=matrix, b_ub=limit, A_eq=balance, b_eq=supply,
                bounds=(0.0, None), method="highs", options={"presolve": False},
            )  # fmt: skip
            if answer.status != 0:
                break
            weight, potential = np.maximum(-answer.ineqlin.marginals, 0.0), -answer.eqlin.marginals
            reduced = self.profit - balance.T @ potential - matrix.T @ weight
            value = potential @ supply + weight @ limit + np.maximum(reduced, 0.0).sum()
            best = min(best, float(value))
            found = violated(answer.x, turn)
            if found is None:
                break
            rows, limits = [*rows, *found], [*limits, np.zeros(csr_matrix(vstack(found)).shape[0])]
        return rounded_down(best + 1e-9 * (1.0 + best), self.profit)


def least_difference(
    leg_times: Array,
    priority: Array,
    ends: tuple[int, int],
    time_available: float,
    drops: Array | None = None,
) -> float:
    """Return by how much the total priorities of two routes in time differ at least, if they do.

    Where priorities have no `common_step`, or a very small one, that is what single precision resolves beside
    the time, and no more than the least priority of an edge.

    Args:
        leg_times: [N, N] s, infinite off the edges.
        priority: [N, N] rho_ij >= 0.
        ends: start and goal, indices.
        time_available: T, s.
        drops: [N, N, F] by which priorities fall, one after the other; None where none does.

    Returns:
        The difference; infinite where no edge that a route in time can take has a task.
    """
    edges = edges_in_time(leg_times, *ends, time_available)
    worth = priority[edges][:, None]
    if drops is not None:
        fallen = np.maximum(worth - np.cumsum(drops[edges], axis=1), 0.0)
        worth = np.hstack([worth, np.where(fallen > 1e-9 * worth, fallen, 0.0)])
    values = worth[worth > 0.0]
    if not len(values):
        return np.inf
    most = np.zeros(len(priority))
    np.maximum.at(most, edges[1], worth[:, 0])
    return float(min(values.min(), max(common_step(values), _RESOLVED * most.sum())))


def common_step(values: Any) -> float:
    """Return the largest step of which all values, not negative, are whole multiples, up to rounding.

    Returns:
        The step; 0.0 where there is none, or all values are zero. All values are within 1e-9 steps of a
        multiple, and none is above a million steps.

    Example:
        >>> common_step([2.5, 5.0, 17.5]), common_step([0.0, 6.0, 9.0]), common_step([1.0, np.pi])
        (2.5, 3.0, 0.0)
    """
    distinct = np.unique(np.asarray(values, float))
    distinct = distinct[distinct > 0.0]
    if not len(distinct):
        return 0.0
    largest = float(distinct[-1])
    step = largest
    for value in distinct.tolist():
        while value > 1e-9 * largest:
            step, value = value, abs(math.remainder(step, value))
        if step * MOST_STEPS < largest:
            return 0.0
    step = largest / round(largest / step)
    multiples = distinct / step
    return step if np.abs(multiples - np.round(multiples)).max() <= 1e-9 else 0.0


def checked(
    leg_times: Any, priority: Any, start: int, goal: int, time_available: float, rounds: int = 1
) -> tuple[Array, Array]:
    """Leg times and priorities as float arrays [N, N].

    Raises:
        ValueError: an argument is out of range or of the wrong shape.
    """
    times, rho = np.asarray(leg_times, float), np.asarray(priority, float)
    if times.ndim != 2 or times.shape[0] != times.shape[1]:
        raise ValueError(f"leg_times must be [N, N] s, got shape {times.shape}")
    if rho.shape != times.shape:
        raise ValueError(f"priority must be {times.shape} as leg_times, got shape {rho.shape}")
    if not (times >= 0.0).all():
        raise ValueError("leg_times must not be negative or NaN")
    if not np.isfinite(rho).all() or rho.min() < 0.0:
        raise ValueError("priority must be finite and not negative")
    for name, index in (("start", start), ("goal", goal)):
        if not 0 <= index < len(times):
            raise ValueError(f"{name} must be an index in [0, {len(times)}), got {index}")
    if np.isnan(time_available):
        raise ValueError("time_available must be a number, got nan")
    if rounds < 1:
        raise ValueError(f"rounds must be at least 1, got {rounds}")
    return times, rho


def with_return_margin(leg_times: Array, start: int, goal: int, margin: float) -> Array:
    """Return leg times [N, N] s, infinite off the edges, under which no route that keeps a margin is late.

    A waypoint, but for the start, is entered only if the shortest path from it to the goal, lengthened by the
    margin, still fits: so the leg to the goal may be counted as that long.

    Returns:
        [N, N] s, longer on edges into the goal only.
    """
    lasts = (1.0 + margin) * time_to_go(leg_times, goal)
    lasts[start] = 0.0
    times = leg_times.copy()
    times[:, goal] = np.maximum(times[:, goal], np.where(np.isfinite(lasts), lasts, 0.0))
    return times


def edges_in_time(
    leg_times: Array, start: int, goal: int, time_available: float, revisits: bool = False
) -> tuple[IntArray, IntArray]:
    """Return edges that a path from the start to the goal in time can take.

    Args:
        leg_times: [N, N] s, infinite off the edges.
        start: index; no edge leads into it, unless `revisits`.
        goal: index; no edge leads out of it.
        time_available: T, s; a mission takes strictly less.
        revisits: whether a mission may come back to its start.

    Returns:
        ``(tails [M], heads [M])``; empty where the goal cannot be reached in time.
    """
    times = np.where(np.eye(len(leg_times), dtype=bool), np.inf, leg_times)
    times[goal] = np.inf
    if not revisits:
        times[:, start] = np.inf
    tails, heads = np.nonzero(np.isfinite(times))
    since, togo = time_to_go(times.T, start), time_to_go(times, goal)
    if since[goal] >= time_available:
        return tails[:0], heads[:0]
    kept = since[tails] + times[tails, heads] + togo[heads] <= time_available * (1.0 + 1e-12)
    kept &= np.isfinite(togo[heads]) & np.isfinite(since[tails])
    return tails[kept], heads[kept]


def rounded_down(bound: float, priority: Array) -> float:
    """Return the bound, at the largest sum that whole multiples of the common step allow.

    Steps that binary fractions do not hold exactly leave a margin for the rounding of sums.
    """
    step = common_step(priority)
    if step == 0.0:
        return bound if priority.max() > 0.0 else 0.0
    steps = math.floor(bound / step + 1e-5)
    off = np.abs(np.round(priority / step) * step - priority).max()
    if (step * 2**20).is_integer() and off == 0.0:
        return steps * step
    return min(bound, steps * step + np.count_nonzero(priority) * (off + np.finfo(float).eps * bound))
