"""Routes by the clock against proven optima, and what they cost in time: ``python -m benchmarks.windows``.

Thirty graphs of 40 waypoints, every other one complete, the rest of 7-12 nearest neighbours, with a task at
each waypoint in one window or one of two. Travel times and durations are whole seconds, windows close and
the time ends half a second after one, so that the planner, in single precision, and OR-Tools CP-SAT have the
same routes to choose from. CP-SAT and the labels of `benchmarks.labels` begin at the best route planned. The
gap of a plan is 1 - priority / bound; one that was not found counts as priority zero.
"""

import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import jax
import numpy as np
from scipy.spatial.distance import cdist

import auvplan as ap
from auvplan.mission import MissionConfig, MissionGraph, MissionRoute, plan_mission, random_graph
from auvplan.mission.exact import load_cp_model
from auvplan.mission.timetable import Timetable
from auvplan.ocean.gridded import GriddedCurrent
from benchmarks.labels import Windows, most_priority
from benchmarks.machine import arguments, installed, machine, screen, show, track, write

SIZE, SPEED, EXTENT = 40, 2.5, 10_000.0
FIRST_SEED, CASES, PLANS = 7000, 30, 3
#: s; half a second more, as windows.
AVAILABLE = 16_000, 22_001
HALF_SECOND = 0.5
#: s, and threads, of CP-SAT.
TIME_LIMIT, WORKERS = 20.0, 2

#: Share of a mission's tasks whose windows are tight, by graph in turn.
TIGHT_SHARES = (0.25, 0.5, 0.75)
#: Lengths of windows as shares of the time available.
TIGHT, WIDE = (0.02, 0.08), (0.2, 0.5)

FAMILIES = "complete", "7-12 nearest"

#: Of the timings.
DEPARTURES, BENDS, INTERVAL = 24, 5, 900.0
PERIOD, STREAM = 44_714.0, (0.5, 0.3)


@dataclass(frozen=True)
class Case:
    """A mission with windows and steady travel times.

    Attributes:
        graph: N waypoints with a timetable of one departure.
        time_available: T_available, s.
    """

    graph: MissionGraph
    time_available: float
    seed: int
    family: str = ""


@dataclass(frozen=True)
class Proof:
    """What CP-SAT says of a case: most total priority that it found, its bound, and s that it took."""

    priority: float
    bound: float
    proved: bool
    seconds: float


#: Plans of one configuration on one kind of graph, what proved it, and timings.
GAPS = {
    "graphs": "{family} ({graphs})", "planner": "{planner}", "proved": "{proved:.0%}", "tasks": "{tasks:.1f}",
    "mean gap": "{mean_gap:.2%}", "worst gap": "{worst_gap:.2%}", "optimal": "{optimal:.0%}",
    "feasible": "{feasible:.0%}", "wall": "{wall_ms:.0f} ms", "user": "{user_ms:.0f} ms",
}  # fmt: skip
PROOFS = {
    "graphs": "{family} ({graphs})", "search": "{search}", "proved": "{proved}",
    "better than planned": "{better}", "above labels": "{above}", "median time": "{seconds:.1f} s",
}  # fmt: skip
TIMINGS = {
    "what": "{what}", "asked": "{asked:.2f} s", "first call": "{first_seconds:.2f} s",
    "wall": "{wall_seconds:.2f} s", "user": "{user_seconds:.2f} s",
}  # fmt: skip


def case(seed: int) -> Case:
    """A graph with a task at every waypoint but the first and the last, which are start and goal."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform(0.0, EXTENT, (SIZE, 3)) * [1.0, 1.0, 0.01]
    adjacency = ~np.eye(SIZE, dtype=bool)
    if seed % 2:
        adjacency = random_graph(rng, positions, neighbours=int(rng.integers(7, 13))).adjacency
    available = float(rng.integers(*AVAILABLE)) + HALF_SECOND
    tight = TIGHT_SHARES[seed % len(TIGHT_SHARES)]
    graph, opens, closes = _tasks(rng, positions, adjacency, available, tight)
    travel = np.where(adjacency, np.maximum(np.round(cdist(positions, positions) / SPEED), 1.0), np.inf)
    graph = graph.with_timetable(Timetable(np.zeros(1), travel[None], opens, closes))
    return Case(graph, available, seed, FAMILIES[seed % 2])


def _tasks(
    rng: np.random.Generator, positions: np.ndarray, adjacency: np.ndarray, available: float, tight: float
) -> tuple[MissionGraph, np.ndarray, np.ndarray]:
    """A task at each waypoint but the ends, and when it may begin: opens and closes [N, N, 2] s."""
    size = len(positions)
    priority, duration = rng.integers(1, 10, size).astype(float), rng.integers(60, 601, size).astype(float)
    priority[[0, -1]] = duration[[0, -1]] = 0.0
    is_tight = rng.random((size, 1)) < tight
    lengths = np.where(is_tight, rng.uniform(*TIGHT, (size, 2)), rng.uniform(*WIDE, (size, 2)))
    middles = rng.uniform(0.05, 0.95, (size, 2))
    opens = np.floor(available * (middles - 0.5 * lengths))
    closes = np.floor(available * (middles + 0.5 * lengths)) + HALF_SECOND
    single = rng.random(size) < 0.5
    opens[single, 1], closes[single, 1] = np.inf, -np.inf
    opens[[0, -1]], closes[[0, -1]] = -np.inf, np.inf
    square = size, size
    priority, duration = (np.broadcast_to(values, square).copy() for values in (priority, duration))
    opens, closes = (np.broadcast_to(times, (*square, 2)).copy() for times in (opens, closes))
    return MissionGraph(positions, adjacency, priority, duration), opens, closes


def prove(case: Case, route: Any, time_limit: float, workers: int) -> Proof:
    """Search for the route of most total priority in whole seconds, from a known one on.

    Args:
        case: of whole seconds.
        route: waypoints to begin the search at; [start] for none.
        time_limit: s.
    """
    cp = load_cp_model()
    table, duration, goal = case.graph.timetable, case.graph.duration[0].astype(int), SIZE - 1
    assert table is not None
    model, end = cp.CpModel(), int(case.time_available)
    begins = []
    for node in range(SIZE):
        pairs = zip(table.opens[0, node], table.closes[0, node], strict=True)
        open_ = [
            [int(max(opens, 0.0)), int(min(closes, end))]
            for opens, closes in pairs
            if closes >= max(opens, 0.0) and opens <= end
        ]
        domain = cp.Domain.from_intervals([[0, 0]] if node == 0 else open_ or [[0, end]])
        begins.append(model.new_int_var_from_domain(domain, f"begins {node}"))
    legs, visited = set(pairwise(route)), set(route)
    arcs, skipped = [(goal, 0, True)], {}
    for i, j in np.argwhere(np.isfinite(table.travel_time[0])).tolist():
        if i == goal or j == 0:
            continue
        lasts = int(duration[i] + table.travel_time[0, i, j])
        if min(begins[i].proto.domain) + lasts > max(begins[j].proto.domain):
            continue
        taken = model.new_bool_var("")
        model.add(begins[j] >= begins[i] + lasts).only_enforce_if(taken)
        model.add_hint(taken, (i, j) in legs)
        arcs.append((i, j, taken))
    for node in range(1, goal):
        skipped[node] = model.new_bool_var("")
        model.add_hint(skipped[node], node not in visited)
        arcs.append((node, node, skipped[node]))
    model.add_circuit(arcs)
    times = case.graph.itinerary(route, SPEED).begins
    for node, begin in zip(route[1:], times, strict=True):
        model.add_hint(begins[node], int(begin))
    model.maximize(sum(int(case.graph.priority[0, node]) * (1 - skip) for node, skip in skipped.items()))
    solver = cp.CpSolver()
    solver.parameters.max_time_in_seconds = time_limit
    solver.parameters.num_workers = workers
    solver.parameters.random_seed = 0
    solver.parameters.linearization_level = 2
    status = solver.status_name(solver.solve(model))
    found = status in ("OPTIMAL", "FEASIBLE")
    best, bound = solver.objective_value if found else 0.0, np.floor(solver.best_objective_bound + 1e-6)
    return Proof(best, float(bound), status in ("OPTIMAL", "INFEASIBLE"), solver.wall_time)


def exact(case: Case, route: Any) -> Proof:
    """Most total priority by labels; `route` is a known one."""
    table, known = case.graph.timetable, float(case.graph.priority[0, route[1:]].sum())
    assert table is not None
    lasts, end = case.graph.duration[0][:, None] + table.travel_time[0], int(case.time_available)
    windows = Windows.of(lasts, table.opens[0], table.closes[0], case.graph.priority[0], end)
    seconds, _, (priority, bound) = clock(lambda: most_priority(windows, known))
    return Proof(float(priority), float(bound), bool(priority == bound), seconds)


#: The configurations that are compared.
PLANNERS = {"default": MissionConfig(), "quick": MissionConfig.quick()}


def plan(case: Case, config: MissionConfig, key: int) -> MissionRoute:
    asked = case.graph, 0, case.graph.size - 1, case.time_available
    return plan_mission(*asked, speed=SPEED, key=jax.random.key(key), config=config)


def clock(call: Callable[[], Any]) -> tuple[float, float, Any]:
    """Wall time and user time of all threads, s, and what the call returned."""
    wall, user = time.perf_counter(), os.times().user
    result = jax.block_until_ready(call())
    return time.perf_counter() - wall, os.times().user - user, result


def compare(count: int, first: int, limit: float) -> tuple[list[dict], list[dict[str, Any]]]:
    """Rows of all planners, and what the exact searches found of each graph from a seed on."""
    cases = [case(first + k) for k in range(count)]
    for one in cases[:2]:
        for config in PLANNERS.values():
            plan(one, config, PLANS)
    plans, found, rows = {}, [], []
    for one in track(cases, "graphs"):
        for name, config in PLANNERS.items():
            plans[one.seed, name] = [clock(partial(plan, one, config, key)) for key in range(PLANS)]
        routes = [route for name in PLANNERS for *_, route in plans[one.seed, name]]
        best = max(routes, key=lambda route: route.priority if route.feasible else -1.0)
        nodes = best.nodes.tolist() if best.feasible else [0]
        peer = prove(one, nodes, limit, WORKERS) if limit and installed("ortools") else None
        proofs = {"seed": one.seed, "family": one.family, "labels": exact(one, nodes), "cp_sat": peer}
        priorities = {n: [route.priority for *_, route in plans[one.seed, n]] for n in PLANNERS}
        found.append(proofs | priorities)
    for family in (*FAMILIES, "all"):
        members = [each for each in found if family in (each["family"], "all")]
        for name in PLANNERS if members else ():
            made = [(each, *run) for each in members for run in plans[each["seed"], name]]
            priority = [route.priority if route.feasible else 0.0 for *_, route in made]
            gaps = 1.0 - np.array(priority) / [each["labels"].bound for each, *_ in made]
            wall, user = (1e3 * statistics.median(run[k] for run in made) for k in (1, 2))
            rows.append({
                "family": family, "planner": name, "graphs": len(members),
                "proved": float(np.mean([each["labels"].proved for each in members])),
                "tasks": float(np.mean([route.tasks for *_, route in made])),
                "feasible": float(np.mean([route.feasible for *_, route in made])),
                "mean_gap": float(gaps.mean()), "worst_gap": float(gaps.max()),
                "optimal": float((gaps < 1e-9).mean()), "wall_ms": wall, "user_ms": user,
            })  # fmt: skip
    return rows, found


def proof_rows(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    rows = []
    for family in FAMILIES:
        members = [each for each in found if each["family"] == family]
        for name, search in (("labels", "labels"), ("CP-SAT", "cp_sat")):
            proofs = [(each[search], each) for each in members if each[search]]
            if proofs:
                rows.append({
                    "family": family, "graphs": len(members), "search": name,
                    "proved": sum(proof.proved for proof, _ in proofs),
                    "better": sum(p.priority > max(max(each[n]) for n in PLANNERS) for p, each in proofs),
                    "above": sum(proof.priority > each["labels"].bound for proof, each in proofs),
                    "seconds": statistics.median(proof.seconds for proof, _ in proofs),
                })  # fmt: skip
    return rows


def timings(repeats: int) -> list[dict[str, Any]]:
    """Travel times by departure in a tidal stream, and plans by them; medians but for the first calls."""
    departures, rows = INTERVAL * np.arange(DEPARTURES), []
    times = np.arange(-3600.0, DEPARTURES * INTERVAL + 7200.0, 300.0)
    swing = np.cos(2.0 * np.pi * times / PERIOD)[:, None, None, None]
    u, v = (np.broadcast_to(strength * swing, (len(times), 1, 2, 2)) for strength in STREAM)
    tide = GriddedCurrent.from_arrays(u, v, origin=(-5e4, -5e4), spacing=1e5, times=times)
    sea = ap.Environment(tide, lower=np.zeros(3), upper=np.array([EXTENT, EXTENT, 100.0]))

    def travel(graph: MissionGraph) -> Any:
        return graph.times_at(sea, ap.Vehicle(speed=SPEED), departures, bends=BENDS)

    def measure(what: str, asked: float, call: Callable[[int], Any]) -> Any:
        first, _, result = clock(partial(call, 0))
        runs = [clock(partial(call, k)) for k in range(1, repeats + 1)]
        wall, user = (statistics.median(run[k] for run in runs) for k in range(2))
        row = {"what": what, "asked": asked, "first_seconds": first}
        rows.append(row | {"wall_seconds": wall, "user_seconds": user})
        return result

    for size, seconds in ((SIZE, 0.2), (5 * SIZE, 2.0)):
        rng = np.random.default_rng(size)
        positions = rng.uniform(0.0, EXTENT, (size, 3)) * [1.0, 1.0, 0.01]
        adjacency = random_graph(rng, positions).adjacency
        graph, opens, closes = _tasks(rng, positions, adjacency, AVAILABLE[0], TIGHT_SHARES[1])
        if size == SIZE:
            what = f"travel times, {size} waypoints, {adjacency.sum():,} edges, {DEPARTURES} departures"
            found = measure(what, 1.0, lambda _, graph=graph: travel(graph))
            every = replace(graph, adjacency=~np.eye(size, dtype=bool))
            what = f"the same, complete: {size * (size - 1):,} edges"
            measure(what, 1.0, lambda _, every=every: travel(every))
        else:
            found = graph.times_at(sea, ap.Vehicle(speed=SPEED), departures)
        timed = Case(graph.with_timetable(Timetable(departures, found, opens, closes)), AVAILABLE[0], size)
        what = f"plan, {size} waypoints, {DEPARTURES} departures, windows"
        measure(what, seconds, lambda key, timed=timed: plan(timed, MissionConfig(), key))
    return rows


def main() -> None:
    parser = arguments("Routes by the clock against proven optima.")
    parser.add_argument("--graphs", type=int, default=CASES, help="how many; 0 for the timings alone")
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="seed of the first graph")
    parser.add_argument("--limit", type=float, default=TIME_LIMIT, help="s of CP-SAT for each; 0 for none")
    parser.add_argument("--repeats", type=int, default=5, help="timed calls; 0 for no timings")
    options = parser.parse_args()
    asked = options.graphs, options.first, options.limit
    rows, found = compare(*asked) if options.graphs else ([], [])
    timed = timings(options.repeats) if options.repeats else []
    facts, load = machine(), os.getloadavg()[0]
    screen.print(f"{facts['processor']}, {facts['cores']} cores, load {load:.1f}, jax {jax.__version__}")
    titled = (
        ("Routes by the clock: gap to the best", rows, GAPS, 2),
        ("What proved it", proof_rows(found), PROOFS, 2),
        ("Timings", timed, TIMINGS, 1),
    )
    for title, shown, columns, names in titled:
        if shown:
            show(title, shown, columns, names)
    content = {"limit": options.limit, "load": load, "graphs": found}
    write(options.out, content | {"rows": rows, "timings": timed})


if __name__ == "__main__":
    main()
