"""The route of most total priority, with its proof: constraint programming by OR-Tools CP-SAT."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.mission import labels
from auvplan.mission.bound import Array, IntArray, checked, common_step, edges_in_time
from auvplan.mission.route import MissionRoute, MissionStatus
from auvplan.mission.timetable import stages

LEAST_TICKS = 1e7
MOST_TICKS = 1e15
PRIORITY_UNITS = 1e6


@dataclass(frozen=True)
class ExactRoute:
    """What the exact search found and proved.

    Attributes:
        nodes: [n] waypoints from the start to the goal; empty where none was found.
        priority: sum of rho over the tasks taken; 0.0 where none was found.
        bound: no route in time has more, up to rounding of the sum; 0.0 where there is none at all.
        proved: whether the search ended with a proof that the route is of most total priority, or that there
            is none.
        infeasible: whether it is proved that no route reaches the goal in time.
        chosen: [n - 1] places of the legs' speeds, where they were free; empty elsewhere.
    """

    nodes: IntArray
    priority: float
    bound: float
    proved: bool
    infeasible: bool
    chosen: IntArray = field(default_factory=lambda: np.zeros(0, int))


def solve_exact(
    leg_times: Any,
    priority: Any,
    start: int,
    goal: int,
    time_available: float,
    *,
    time_limit: float = 10.0,
    hint: Sequence[int] | NDArray[np.integer] | None = None,
    energies: Any = None,
    energy_available: float = np.inf,
) -> ExactRoute:
    """Search for the route of most total priority until it is proved or the time limit is reached.

    Leg times are counted in whole ticks of a millisecond, or finer for short missions, and rounded down, so
    that what is proved of the ticks holds of the seconds. Should the route found take T or more in seconds,
    a second search rounds up. Priorities are counted exactly where they have a `common_step`; else they are
    rounded up to millionths of the largest: `bound` holds, and `proved` means within N such millionths.
    Routes of equal priority are not distinguished by their times, as a second aim would slow the proof down.

    Args:
        leg_times: [N, N] s, t_ij with the task; infinite off the edges. [K, N, N] with energies: at K speeds,
            one of which is chosen for each leg.
        priority: [N, N] rho_ij >= 0.
        start: index.
        goal: index; equal to `start` it gives the empty mission.
        time_available: T, s; the route takes strictly less.
        time_limit: s of search; a second search gets what is left, and a tenth of it at least.
        hint: waypoints of a known route, where the search begins; what does not fit is passed over.
        energies: [K, N, N] J of each leg with its task.
        energy_available: J; the route takes less.

    Raises:
        ImportError: OR-Tools is not installed.
        ValueError: an argument is out of range or of the wrong shape.
    """
    load_cp_model()
    if energies is None:
        each, joules = np.asarray(leg_times, float)[None], None
    else:
        each, joules = np.asarray(leg_times, float), np.asarray(energies, float)
        if each.ndim != 3 or each.shape != joules.shape:
            raise ValueError(
                f"leg_times and energies must be [K, N, N], got shapes {each.shape} and {joules.shape}"
            )
    times, rho = checked(each.min(axis=0), priority, start, goal, time_available)
    if not time_limit > 0.0:
        raise ValueError(f"time_limit must be positive, got {time_limit} s")
    if start == goal and time_available > 0.0:
        return ExactRoute(np.array([start]), 0.0, 0.0, proved=True, infeasible=False)
    nothing = np.zeros(0, int)
    tails, heads = edges_in_time(times, start, goal, time_available)
    if not len(tails):
        return ExactRoute(nothing, 0.0, 0.0, proved=True, infeasible=True)

    place, edge = np.nonzero(np.isfinite(each[:, tails, heads]))
    tails, heads = tails[edge], heads[edge]
    legs, profit = each[place, tails, heads], rho[tails, heads]
    limited = joules is not None and np.isfinite(energy_available)
    unit = common_step(profit)
    if unit > 0.0:
        units = np.round(profit / unit)
    else:
        unit = float(profit.max()) / PRIORITY_UNITS or 1.0
        units = np.ceil(profit / unit)
    begin, bound, route, proved = time.monotonic(), float(profit.sum()), None, False
    for rounding in (np.floor, np.ceil):
        paths = PathModel(tails, heads, start, goal)
        ticks, budget = in_ticks(legs, time_available, rounding)
        paths.model.add(paths.total(ticks) <= budget)
        if limited and joules is not None:
            quanta, most = in_ticks(joules[place, tails, heads], energy_available, rounding)
            paths.model.add(paths.total(quanta) <= most)
        paths.model.maximize(paths.total(units))
        if hint is not None:
            paths.add_hint(hint)
        left = max(time_limit - (time.monotonic() - begin), 0.1 * time_limit)
        status = paths.solve(left)
        if rounding is np.floor:
            if status == "INFEASIBLE":
                return ExactRoute(nothing, 0.0, 0.0, proved=True, infeasible=True)
            bound = min(bound, math.floor(paths.solver.best_objective_bound + 1e-6) * unit)
        if status not in ("OPTIMAL", "FEASIBLE"):
            break
        route, taken = paths.path()
        spent = 0.0 if joules is None else sum(joules[place[k], tails[k], heads[k]] for k in taken)
        if sum(legs[taken]) < time_available and spent < energy_available:
            value = round(paths.solver.objective_value) * unit
            proved = status == "OPTIMAL" and value >= bound * (1.0 - 1e-9)
            break
        route = None
    if route is None:
        return ExactRoute(nothing, 0.0, bound, proved=False, infeasible=False)
    found, chosen = float(rho[route[:-1], route[1:]].sum()), place[taken] if joules is not None else place[:0]
    return ExactRoute(route, found, max(bound, found), proved, infeasible=False, chosen=chosen)


def certify(route: MissionRoute, time_limit: float = 10.0) -> MissionRoute:
    """Improve a route and prove it by `solve_exact`, as far as that comes within the time limit.

    Its cost, population and history remain those of the search. A route with a return margin keeps its
    waypoints, since the exact search knows the margin on the last leg only: its bound is proved. So does one
    by the clock whose speeds are chosen: labels know time alone.

    Args:
        route: from `plan_mission`.
        time_limit: s.

    Raises:
        ImportError: OR-Tools is not installed: `pip install 'auvplan[exact]'`; by the clock it is not needed.
    """
    rho, start, clock = route.edge_priority, int(route.nodes[0]), route.timetable
    if start == route.goal:
        return route
    known = route.priority if route.feasible else -np.inf
    if clock is None:
        hint = route.nodes if route.feasible else None
        each, limits = route.limiting_times, dict[str, Any]()
        if route.speeds is not None:
            each = route.speeds.times_of_edges
            limits = {"energies": route.speeds.energies_of_edges, "energy_available": route.speeds.available}
        asked = each, rho, start, route.goal, route.time_available
        found = solve_exact(*asked, time_limit=time_limit, hint=hint, **limits)
        if found.infeasible:
            return route
        bound: float | None = min(found.bound, route.bound)
    else:
        found = labels.prove(route.clocked, known, time_limit)
        bound = min(found.bound, route.bound) if not found.proved else route.proven_bound
        if found.proved and np.isfinite(found.bound):
            bound = found.bound
    kept = route = replace(route, proven_bound=bound)
    if not len(found.nodes) or route.return_margin > 0.0 or (clock is not None and route.speeds is not None):
        return route
    edges = found.nodes[:-1], found.nodes[1:]
    if clock is None:
        lasts, waits, worth = route.edge_times[edges], np.zeros(len(edges[0])), rho[edges]
        if route.speeds is not None and isinstance(found, ExactRoute):
            route = replace(route, speeds=route.speeds.along(found.nodes, found.chosen))
            lasts = each[found.chosen, *edges]
        time_taken, priority = float(lasts.sum()), float(worth.sum())
    else:
        assert route.duration is not None
        legs = stages(clock, route.duration, found.nodes.tolist())
        begun = zip(*(ends.tolist() for ends in edges), legs.begins.tolist(), strict=True)
        worth = rho[edges] - [clock.lost(*leg) for leg in begun]
        lasts, waits, time_taken = legs.ends - legs.departs, legs.begins - legs.arrives, float(legs.ends[-1])
        priority = sum(worth.tolist())
    if priority <= known or not time_taken < route.time_available:
        return kept
    return replace(
        route,
        nodes=found.nodes,
        time=time_taken,
        priority=priority,
        tasks=int(np.count_nonzero(worth)),
        leg_times=lasts,
        waits=waits,
        status=MissionStatus.OK,
    )


class PathModel:
    """Elementary paths from the start to the goal as a CP-SAT model, a Boolean for each edge.

    The edges taken, one from the goal back to the start, and a loop on each waypoint left out are a circuit.

    Args:
        tails, heads: [M] waypoints that each edge leads from and to; none into the start or out of the goal.
            Several may lead from one waypoint to another.
        start, goal: indices, not equal.

    Attributes:
        model: constraints and the aim are added here.
        solver: holds the answer after `solve`.
    """

    def __init__(self, tails: IntArray, heads: IntArray, start: int, goal: int) -> None:
        self._cp_model = load_cp_model()
        self.model, self.solver = self._cp_model.CpModel(), self._cp_model.CpSolver()
        self._edges = list(zip(tails.tolist(), heads.tolist(), strict=True))
        self._start, self._goal = int(start), int(goal)
        self._taken = [self.model.new_bool_var("") for _ in self._edges]
        waypoints = np.unique(np.r_[tails, heads]).tolist()
        number = {waypoint: k for k, waypoint in enumerate(waypoints)}
        self._left_out = {
            waypoint: self.model.new_bool_var("") for waypoint in waypoints if waypoint not in (start, goal)
        }
        arcs = [(number[i], number[j], take) for (i, j), take in zip(self._edges, self._taken, strict=True)]
        arcs += [(number[waypoint], number[waypoint], skip) for waypoint, skip in self._left_out.items()]
        self.model.add_circuit([*arcs, (number[self._goal], number[self._start], True)])

    def total(self, weights: Array | IntArray) -> Any:
        """Sum of whole weights [M] over the edges taken, as an expression of the model."""
        return self._cp_model.LinearExpr.weighted_sum(self._taken, np.asarray(weights, np.int64).tolist())

    def add_hint(self, nodes: Sequence[int] | NDArray[np.integer]) -> None:
        """Begin the search at the route of waypoints `nodes`."""
        route = [int(node) for node in nodes]
        legs, visited = set(pairwise(route)), set(route)
        for edge, take in zip(self._edges, self._taken, strict=True):
            self.model.add_hint(take, edge in legs)
        for waypoint, skip in self._left_out.items():
            self.model.add_hint(skip, waypoint not in visited)

    def solve(self, time_limit: float) -> str:
        """Name of the solver's status after `time_limit` s: OPTIMAL, FEASIBLE, INFEASIBLE or another."""
        parameters = self.solver.parameters
        parameters.max_time_in_seconds = time_limit
        parameters.num_workers = 1  # with one the answer is the same each time unless the time limit ends it
        parameters.random_seed = 0
        parameters.linearization_level = 2
        return self.solver.status_name(self.solver.solve(self.model))

    def path(self) -> tuple[IntArray, list[int]]:
        """Waypoints of the path found, from the start to the goal, and its edges by number."""
        following = {
            i: (j, number)
            for number, ((i, j), take) in enumerate(zip(self._edges, self._taken, strict=True))
            if self.solver.boolean_value(take)
        }
        route, edges = [self._start], list[int]()
        while route[-1] != self._goal:
            onward, number = following[route[-1]]
            route.append(onward)
            edges.append(number)
        return np.array(route), edges


def in_ticks(leg_times: Array, time_available: float, rounding: np.ufunc) -> tuple[IntArray, int]:
    """Leg times and the time available in whole ticks.

    With `numpy.floor` each sum of legs strictly below T is within the budget; with `numpy.ceil` each sum
    within the budget is strictly below T.

    Args:
        leg_times: [M] s, finite.
        time_available: T, s, positive.
        rounding: `numpy.floor` or `numpy.ceil`.

    Returns:
        ``(ticks [M], budget)``.
    """
    longest = min(time_available, float(leg_times.sum()) + 1.0)
    exponent = max(3, math.ceil(math.log10(LEAST_TICKS / longest)))
    exponent = min(exponent, math.floor(math.log10(MOST_TICKS / longest)))
    per_second = 10.0**exponent
    return rounding(leg_times * per_second).astype(np.int64), math.ceil(longest * per_second) - 1


def load_cp_model() -> Any:
    """Return the module `ortools.sat.python.cp_model`.

    Raises:
        ImportError: OR-Tools is not installed.
    """
    try:
        from ortools.sat.python import cp_model
    except ImportError as error:
        raise ImportError("the exact search needs OR-Tools: pip install 'auvplan[exact]'") from error
    return cp_model
