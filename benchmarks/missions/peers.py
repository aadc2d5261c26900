"""Other people's solvers on the mission problem: CP-SAT, PyVRP and mealpy's BBO; each is optional."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise, permutations
from typing import Any

import jax.numpy as jnp
import numpy as np

from auvplan.mission import time_to_go
from auvplan.mission.bound import common_step, edges_in_time, upper_bound
from auvplan.mission.exact import PathModel, in_ticks, solve_exact
from benchmarks.missions.sets import Case


def reference(case: Case, time_limit: float) -> tuple[float, bool]:
    """Most total priority and whether it is proved; else, and without OR-Tools, the least upper bound."""
    bound = upper_bound(*case.searched)
    try:
        route = solve_exact(*case.searched, time_limit=time_limit)
    except ImportError:
        return bound, False
    return (route.priority, True) if route.proved else (min(bound, route.bound), False)


def eq15_cost(case: Case, nodes: Any, phi1: float, phi2: float) -> float:
    """Phi_1 |T_Mission - T_available| + Phi_2 sum(1 / rho) of a route (Eq. 15)."""
    times, rho = case.leg_times, case.graph.priority
    legs = [(int(i), int(j)) for i, j in pairwise(nodes)]
    unused = case.time_available - sum(times[leg] for leg in legs)
    return phi1 * abs(unused) + phi2 * sum(1.0 / rho[leg] for leg in legs if rho[leg] > 0.0)


def cp_sat_eq15(case: Case, phi1: float, phi2: float, time_limit: float) -> tuple[list[int], float]:
    """A route of low cost by Eq. 15, and a cost that none is below.

    The unused time and the sum over tasks are both sums over edges, so that the aim is a longest path. The
    bound is right to a tick for each leg.

    Args:
        time_limit: s.

    Returns:
        ``(nodes, bound)``; no nodes where none were found.
    """
    tails, heads = edges_in_time(case.leg_times, case.start, case.goal, case.time_available)
    if not len(tails):
        return [], np.inf
    legs, rho = case.leg_times[tails, heads], case.graph.priority[tails, heads]
    ticks, budget = in_ticks(legs, case.time_available, np.ceil)
    tick = case.time_available / (budget + 1)
    inverse = np.divide(1.0, rho, out=np.zeros_like(rho), where=rho > 0.0)
    gain = phi1 * legs - phi2 * inverse
    paths = PathModel(tails, heads, case.start, case.goal)
    paths.model.add(paths.total(ticks) <= budget)
    paths.model.maximize(paths.total(np.round(gain / tick)))
    status = paths.solve(time_limit)
    bound = phi1 * case.time_available - paths.solver.best_objective_bound * tick
    return (paths.path()[0].tolist() if status in ("OPTIMAL", "FEASIBLE") else []), bound


def pyvrp(case: Case, seed: int, time_limit: float) -> list[int]:
    """PyVRP's prize collecting; it knows prizes of waypoints only."""
    assert case.prizes is not None
    scale, unit = 1e5 / case.time_available, common_step(case.prizes) or 1.0
    budget = int(np.ceil(case.time_available * scale)) - 1
    prizes = np.round(case.prizes / unit) * (budget + 1)
    travel, places = np.ceil(case.leg_times * scale), 1000.0 * case.graph.positions[:, :2]
    ends = case.start, case.goal
    return prize_collecting(places, travel, prizes, ends, seed, time_limit, max_distance=budget)


def prize_collecting(
    places: np.ndarray, travel: np.ndarray, prizes: np.ndarray, ends: tuple[int, int], seed: int,
    seconds: float, windows: tuple[np.ndarray, ...] = (), **vehicle: int,
) -> list[int]:  # fmt: skip
    """Return PyVRP's route of one vehicle past optional clients, all in whole units; empty without one.

    Args:
        places: [N, 2].
        travel: [N, N], between different places.
        windows: [N] of service, ready and due times; none if empty.
        vehicle: limits of it.
    """
    import pyvrp
    from pyvrp.stop import MaxRuntime

    model = pyvrp.Model()
    locations = [model.add_location(x=int(x), y=int(y)) for x, y in places]
    depots = [model.add_depot(locations[k]) for k in dict.fromkeys(ends)]
    clients = [k for k in range(len(places)) if k not in ends]
    names = "service_duration", "tw_early", "tw_late"
    for k in clients:
        times = {name: int(each[k]) for name, each in zip(names, windows, strict=bool(windows))}
        model.add_client(locations[k], prize=int(prizes[k]), required=False, **times)
    model.add_vehicle_type(1, start_depot=depots[0], end_depot=depots[-1], **vehicle)
    for i, j in permutations(range(len(places)), 2):
        model.add_edge(locations[i], locations[j], distance=int(travel[i, j]), duration=int(travel[i, j]))
    best = model.solve(MaxRuntime(seconds), seed=seed, display=False, collect_stats=False).best
    if not best.is_feasible():
        return []
    visits = [clients[stop.idx] for route in best.routes() for stop in route if stop.is_client()]
    return [ends[0], *visits, ends[1]]


def mealpy_bbo(case: Case, seed: int, population: int = 150, iterations: int = 200) -> list[int]:
    """mealpy's OriginalBBO on random keys: the open waypoint of the largest key comes next.

    A waypoint is open that is not yet visited and leaves time to reach the goal; most total priority is the
    aim, the unused time the second. The decoder is compiled by Numba.
    """
    from mealpy import BBO, FloatVar

    decode, size, budget = _random_key_decoder(), case.graph.size, case.time_available
    times, rho = case.leg_times, case.graph.priority
    togo = np.asarray(time_to_go(jnp.asarray(times), case.goal), float)
    second = 0.05 * rho.max() / budget

    def cost(keys: np.ndarray) -> float:
        nodes, time, priority = decode(keys, times, rho, togo, case.start, case.goal, budget)
        return second * time - priority if nodes[-1] == case.goal else size * rho.max()

    bounds = [FloatVar(lb=0.0, ub=1.0) for _ in range(size)]
    problem = {"obj_func": cost, "bounds": bounds, "minmax": "min", "log_to": None}
    best = BBO.OriginalBBO(epoch=iterations, pop_size=population).solve(problem, seed=seed)
    nodes, _, _ = decode(best.solution, times, rho, togo, case.start, case.goal, budget)
    return nodes.tolist() if nodes[-1] == case.goal else []


@cache
def _random_key_decoder() -> Callable[..., tuple[np.ndarray, float, float]]:
    """Keys [N] into ``(nodes [n], time, priority)``; the route ends early where nothing is open."""
    import numba

    @numba.njit
    def decode(keys, times, rho, togo, start, goal, budget):
        nodes, count = np.empty(len(keys), np.int64), 1
        nodes[0] = here = start
        visited = np.zeros(len(keys), np.bool_)
        visited[start] = True
        time = priority = 0.0
        while here != goal:
            chosen, largest = -1, -1.0
            for j in range(len(keys)):
                if not visited[j] and keys[j] > largest and time + times[here, j] + togo[j] < budget:
                    chosen, largest = j, keys[j]
            if chosen < 0:
                break
            time += times[here, chosen]
            priority += rho[here, chosen]
            visited[chosen] = True
            nodes[count] = here = chosen
            count += 1
        return nodes[:count], time, priority

    return decode
