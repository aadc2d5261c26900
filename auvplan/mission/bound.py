"""Upper bound on the total priority of a mission: linear relaxation with connectivity cuts."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, vstack
from scipy.sparse.csgraph import breadth_first_order, dijkstra, maximum_flow

Array = NDArray[np.floating]
IntArray = NDArray[np.integer]
BoolArray = NDArray[np.bool_]

LEAST_VIOLATION = 0.01
FLOW_UNITS = 10**6
EDGES_PER_NODE = 12
MOST_STEPS = 1e6


def upper_bound(
    leg_times: Any,
    priority: Any,
    start: int,
    goal: int,
    time_available: float,
    *,
    rounds: int = 12,
) -> float:
    """No route from the start to the goal in time has more total priority than this.

    It holds for a whole mission in which no waypoint is visited twice, however often it is re-planned;
    where waypoints may be visited again, `trail_bound` does.

    Paths are unit flows x_ij on the edges, relaxed to [0, 1]: conservation at every waypoint, at most one
    visit of each, sum(t_ij x_ij) <= T, and x(edges into S) >= visits of h for sets S of waypoints without the
    start and h in S (generalised subtour elimination). The sets are found by minimum cuts, a few in each
    round. The bound is the value of the dual multipliers, so that it holds whatever the tolerances of the
    solver: any multipliers of the right sign give a valid bound.

    Args:
        leg_times: [N, N] s, t_ij with the task; infinite off the edges.
        priority: [N, N] rho_ij >= 0.
        start: index.
        goal: index.
        time_available: T, s; a mission takes strictly less.
        rounds: linear programs solved at most, at least 1; more rounds, tighter bound.

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
    times, rho = checked(leg_times, priority, start, goal, time_available)
    if rounds < 1:
        raise ValueError(f"rounds must be at least 1, got {rounds}")
    tails, heads = edges_in_time(times, start, goal, time_available)
    if start == goal or not len(tails):
        return 0.0
    size, profit = len(times), rho[tails, heads]
    edges, count = np.arange(len(tails)), len(tails)

    into = csr_matrix((np.ones(count), (heads, edges)), (size, count))
    out_of = csr_matrix((np.ones(count), (tails, edges)), (size, count))
    balance, supply = (out_of - into).tocsr(), np.zeros(size)
    supply[[start, goal]] = 1.0, -1.0
    pairs = _pair_rows(tails, heads, into)
    duration = csr_matrix(times[tails, heads][None] / time_available)
    rows, limits = [duration, into], [np.ones(1 + size)]
    sparse = count <= EDGES_PER_NODE * size
    if sparse:
        rows.append(pairs)
        limits.append(np.zeros(len(pairs.indptr) - 1))

    dearest = np.zeros(size)
    np.maximum.at(dearest, heads, profit)
    best = float(dearest.sum())
    for turn in range(rounds):
        matrix, limit = csr_matrix(vstack(rows)), np.concatenate(limits)
        solved = solve_relaxation(profit, matrix, limit, balance, supply)
        if solved is None:
            break
        flow, value = solved
        best = min(best, value)
        violated = [] if sparse else [pairs[np.flatnonzero(pairs @ flow > LEAST_VIOLATION)]]
        if sparse or turn > 0:
            violated.append(_cut_rows(tails, heads, flow, size, start, goal))
        found = sum(len(row.indptr) - 1 for row in violated)
        if not found and (sparse or turn > 0):
            break
        rows += violated
        limits.append(np.zeros(found))
    return rounded_down(best + 1e-9 * (1.0 + best), profit)


def solve_relaxation(
    profit: Array, matrix: csr_matrix, limit: Array, balance: csr_matrix, supply: Array
) -> tuple[Array, float] | None:
    """Maximise ``profit @ x`` where ``matrix @ x <= limit`` and ``balance @ x = supply``, 0 <= x.

    Args:
        profit: [C]; no solution that counts has a component above one.
        matrix, limit: [R, C], [R].
        balance, supply: [N, C], [N].

    Returns:
        The solution [C] and the value of its dual multipliers, which is a bound whatever the tolerances of
        the solver; None where it finds no solution.
    """
    from scipy.optimize import linprog  # a third of a second, and no plan needs it

    answer = linprog(
        -profit, A_ub=matrix, b_ub=limit, A_eq=balance, b_eq=supply,
        bounds=(0.0, None), method="highs", options={"presolve": False},
    )  # fmt: skip
    if answer.status != 0:
        return None
    weight, potential = np.maximum(-answer.ineqlin.marginals, 0.0), -answer.eqlin.marginals
    reduced = profit - balance.T @ potential - matrix.T @ weight
    return answer.x, float(potential @ supply + weight @ limit + np.maximum(reduced, 0.0).sum())


def common_step(values: Any) -> float:
    """Return the largest step of which all values are whole multiples, up to rounding.

    Args:
        values: any shape, finite, not negative.

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
    leg_times: Any, priority: Any, start: int, goal: int, time_available: float
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
    return times, rho


def with_return_margin(leg_times: Array, start: int, goal: int, margin: float) -> Array:
    """Leg times under which no route is late that keeps a return margin.

    A waypoint is entered only if the shortest way from it to the goal, lengthened by the margin, still fits:
    so the leg to the goal may be counted as that long.

    Args:
        leg_times: [N, N] s, infinite off the edges.
        start: index; from there the margin is not asked for.
        goal: index.
        margin: share by which the way to the goal is taken to last longer.

    Returns:
        [N, N] s, longer on edges into the goal only.
    """
    tails, heads = np.nonzero(np.isfinite(leg_times))
    graph = csr_matrix((leg_times[tails, heads], (heads, tails)), leg_times.shape)
    lasts = (1.0 + margin) * dijkstra(graph, indices=goal)
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
    usable = np.isfinite(leg_times) & ~np.eye(len(leg_times), dtype=bool)
    usable[goal] = False
    usable[:, start] &= revisits
    tails, heads = np.nonzero(usable)
    times = leg_times[tails, heads]
    graph = csr_matrix((times, (tails, heads)), leg_times.shape)  # stored zeros stay edges of no length
    since = dijkstra(graph, indices=start)
    togo = dijkstra(graph.T.tocsr(), indices=goal)
    if since[goal] >= time_available:
        return tails[:0], heads[:0]
    kept = since[tails] + times + togo[heads] <= time_available * (1.0 + 1e-12)
    kept &= np.isfinite(togo[heads]) & np.isfinite(since[tails])
    return tails[kept], heads[kept]


def _pair_rows(tails: IntArray, heads: IntArray, into: csr_matrix) -> csr_matrix:
    """Rows of x_ij + x_ji <= visits of j, [K, M], for each edge whose reverse is there too."""
    size, count = len(into.indptr) - 1, len(tails)
    number = np.full((size, size), -1)
    number[tails, heads] = np.arange(count)
    forth = np.flatnonzero(number[heads, tails] >= 0)
    back = number[heads[forth], tails[forth]]
    row = np.arange(len(forth))
    both = csr_matrix((np.ones(2 * len(row)), (np.r_[row, row], np.r_[forth, back])), (len(row), count))
    return (both - into[heads[forth]]).tocsr()


def _cut_rows(tails: IntArray, heads: IntArray, flow: Array, size: int, start: int, goal: int) -> csr_matrix:
    """Rows of visits of h <= x(edges into S), [K, M], for the sets found violated."""
    rows = [
        (heads == waypoint) * 1.0 - (inside[heads] & ~inside[tails])
        for inside, waypoint in _violated_sets(tails, heads, flow, size, start, goal)
    ]
    return csr_matrix(np.array(rows).reshape(len(rows), len(tails)))


def _violated_sets(
    tails: IntArray, heads: IntArray, flow: Array, size: int, start: int, goal: int
) -> list[tuple[BoolArray, int]]:
    """Sets S, a mask [N], and a waypoint h of each, that less flow enters than visits h.

    For each waypoint visited the minimum cut from the start to it: the set nearest to the waypoint, which is
    the smallest, and the one nearest to the start, the largest. Waypoints of a set found are passed over.
    """
    visits = np.bincount(heads, flow, size)
    found: dict[bytes, tuple[BoolArray, int]] = {}
    covered = np.zeros(size, bool)
    covered[[start, goal]] = True
    capacity = flow_capacity(tails, heads, flow, size)
    for waypoint in np.argsort(-visits, kind="stable").tolist():
        if covered[waypoint] or visits[waypoint] < LEAST_VIOLATION:
            continue
        value, nearest, largest = minimum_cut(capacity, start, waypoint, size)
        if value > visits[waypoint] - LEAST_VIOLATION:
            continue
        covered |= nearest
        most_visited = int(np.argmax(np.where(largest, visits, -1.0)))
        found.setdefault(nearest.tobytes(), (nearest, waypoint))
        found.setdefault(largest.tobytes(), (largest, most_visited))
    return list(found.values())


def flow_capacity(tails: IntArray, heads: IntArray, flow: Array, size: int) -> csr_matrix:
    """Return a flow [M] on edges as whole capacities [N, N], in parts of `FLOW_UNITS`."""
    units = np.round(flow * FLOW_UNITS).astype(np.int32)
    used = units > 0
    return csr_matrix((units[used], (tails[used], heads[used])), (size, size))


def minimum_cut(
    capacity: csr_matrix, start: int, waypoint: int, size: int
) -> tuple[float, BoolArray, BoolArray]:
    """Least flow that enters any set with a waypoint and without the start, and two sets that it enters.

    Returns:
        The flow; the smallest such set and the largest one, masks [N].
    """
    cut = maximum_flow(capacity, start, waypoint)
    residual = (capacity - cut.flow).tocsr()
    residual.eliminate_zeros()
    nearest, largest = np.zeros(size, bool), np.ones(size, bool)
    nearest[breadth_first_order(residual.T.tocsr(), waypoint, return_predecessors=False)] = True
    largest[breadth_first_order(residual, start, return_predecessors=False)] = False
    return cut.flow_value / FLOW_UNITS, nearest, largest


def rounded_down(bound: float, priority: Array) -> float:
    """Return the bound, at the largest sum that whole multiples of the common step allow.

    Steps that binary fractions do not hold exactly leave a margin for the rounding of sums.
    """
    step = common_step(priority)
    if step == 0.0:
        return bound if priority.max() > 0.0 else 0.0
    steps = math.floor(bound / step + 1e-5)
    exact = (step * 2**20).is_integer() and (np.round(priority / step) * step == priority).all()
    return steps * step if exact else min(bound, steps * step + 1e-5 * step)
