"""Two budgets, and the speed of each leg chosen: ``python -m benchmarks.speeds [orders missions time]``.

"orders": graphs whose edges have a few speeds, against exhaustive search (at most 9 waypoints, 3 speeds) and
OR-Tools CP-SAT (40 waypoints). "missions": the shipped LAUV scenario, simulated, with a true draw as in the
model and 10 % above it, and its first routes against those at the best constant speed. "time": what plans
with free speeds cost. See `docs/energy.md`.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import numpy as np

import auvplan as ap
from auvplan.executive.context import Mission, make_context
from auvplan.executive.loop import start_mission
from auvplan.executive.planning import load_area_at
from auvplan.executive.route_calls import time_edges
from auvplan.io.area import load_area
from auvplan.mission import MissionGraph, plan_mission, random_graph, time_to_go
from auvplan.mission.exact import solve_exact
from auvplan.mission.speeds import SpeedOptions
from auvplan.runtime import prng
from benchmarks.harness import launch, markdown, screen, track

SCENARIO = "whitsunday-lauv"
SPEEDS = {3: np.array([0.8, 1.2, 1.7]), 9: np.linspace(0.7, 1.7, 9)}


def posed(seed: int, size: int, neighbours: int, count: int) -> tuple[MissionGraph, float, float]:
    """Return a graph with `count` speeds, in still water or in a current, s and J: mostly both are scarce."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 1000.0, (size, 3)) * [1.0, 1.0, 0.05]
    graph = random_graph(rng, places, neighbours=neighbours)
    along = 0.0 if seed % 2 else rng.uniform(-0.4, 0.4, (size, size))
    speeds = SPEEDS[count]
    distance = np.linalg.norm(places[:, None] - places[None], axis=2)
    times = distance / (speeds[:, None, None] + along)
    fixed = 40.0 * graph.duration + rng.uniform(0.0, 5e3, (size, size))
    graph = replace(graph, options=SpeedOptions(speeds, 40.0 + 20.0 * speeds**3, times, fixed))
    middle = np.where(graph.adjacency, times[count // 2] + graph.duration, np.inf)
    available = float(time_to_go(middle, size - 1)[0] * rng.uniform(1.0 if size < 10 else 1.5, 3.0))
    return graph, available, available * float(rng.uniform(45.0, 85.0))


def tables(graph: MissionGraph) -> tuple[np.ndarray, np.ndarray]:
    """Return [K, N, N] s and J of the open edges with their tasks."""
    assert graph.options is not None
    values = graph.options.travel_time + graph.duration, graph.options.energies
    times, energies = (np.where(graph.adjacency, value, np.inf) for value in values)
    return times, energies


def exhaustive(graph: MissionGraph, time_available: float, energy_available: float) -> float:
    """Return the most priority of all orders at all speeds; -1 where none is in time and energy."""
    times, energies = tables(graph)
    best, goal = -1.0, graph.size - 1
    trails = [([0], 0.0, np.zeros((1, 2)))]
    while trails:
        route, priority, ways = trails.pop()
        if route[-1] == goal:
            best = max(best, priority)
            continue
        for there in set(np.flatnonzero(graph.adjacency[route[-1]]).tolist()) - set(route):
            edge = route[-1], there
            legs = np.stack([times[:, *edge], energies[:, *edge]], axis=1)
            onward = (ways[:, None] + legs[None]).reshape(-1, 2)
            onward = onward[(onward[:, 0] < time_available) & (onward[:, 1] < energy_available)]
            if len(onward):
                trails.append(([*route, there], priority + float(graph.priority[edge]), onward))
    return best


def planned(case: tuple[MissionGraph, float, float], seed: int) -> float:
    """Return the priority that the search finds; -1 where it finds no route."""
    graph, time_available, energy = case
    given = {"key": jax.random.key(seed), "speed": 1.0, "energy_available": energy}
    route = plan_mission(graph, 0, graph.size - 1, time_available, **given)
    return route.priority if route.feasible else -1.0


def solved(case: tuple[MissionGraph, float, float]) -> tuple[float, bool]:
    """Return the priority that CP-SAT finds in a minute, -1 for no route, and whether it is proved."""
    graph, time_available, energy = case
    times, energies = tables(graph)
    limits = {"energies": energies, "energy_available": energy, "time_limit": 60.0}
    found = solve_exact(times, graph.priority, 0, graph.size - 1, time_available, **limits)
    return (found.priority if len(found.nodes) else -1.0), found.proved


def orders(small: int, large: int, first: int) -> dict[str, Any]:
    equal = {"exact": 0, "search": 0}
    for seed in track(range(first, first + small), "exhaustive"):
        size = int(np.random.default_rng(seed).integers(5, 10))
        case = posed(seed, size, 3, 3)
        wanted = exhaustive(*case)
        equal["exact"] += abs(solved(case)[0] - wanted) < 1e-6
        equal["search"] += abs(planned(case, seed) - wanted) < 1e-6
    rows = {
        f"{name}, at most 9 waypoints, 3 speeds": f"{count} of {small} equal to exhaustive search"
        for name, count in equal.items()
    }
    gaps: dict[str, list[float]] = {}
    for count in SPEEDS:
        found = []
        for seed in track(range(first, first + large), f"CP-SAT, {count} speeds"):
            case = posed(seed, 40, 5, count)
            best, proved = solved(case)
            if best > 0.0 and proved:
                found.append(1.0 - max(planned(case, seed), 0.0) / best)
        gaps[str(count)] = found
        line = f"mean gap {np.mean(found):.2%}, worst {np.max(found):.1%}, {len(found)} proved cases"
        rows[f"search, 40 waypoints, {count} speeds"] = line
    print(*markdown(["orders under two budgets", "against the optimum"], rows.items()), "", sep="\n")
    return {"equal": equal, "gaps": gaps}


def constant(mission: Mission, available: float) -> tuple[float, float, Any]:
    """Return priority, J and route at the best constant speed: most priority, then least energy."""
    graph, found = mission.timed, []
    options = graph.options
    assert options is not None
    for k in range(len(options.speeds)):
        parts = (part[k : k + 1] for part in (options.speeds, options.power, options.travel_time))
        alone = SpeedOptions(*parts, options.fixed, waiting=options.waiting)
        open_ = graph.adjacency & np.isfinite(alone.least[0])
        if not open_.any():
            continue
        route = first_route(mission, replace(graph, options=alone, adjacency=open_), available)
        if route.feasible:
            found.append((route.priority, -float(route.speeds.energies.sum()), route))
    best = max(found, key=lambda one: one[:2])
    return best[0], -best[1], best[2]


def first_route(mission: Mission, graph: MissionGraph, available: float) -> Any:
    """Return the first route of a mission on a graph, with J that are available."""
    return plan_mission(
        graph, mission.here, mission.run.goal, mission.run.t_available, speed=1.0, key=mission.key,
        config=mission.context.route_configs[0], energy_available=available,
    )  # fmt: skip


def missions(seeds: Sequence[int]) -> dict[str, Any]:
    scenario, rows, found = ap.load_scenario(SCENARIO), dict[str, str](), dict[str, Any]()
    for draw in (1.0, 1.1):
        runs = ap.run_missions(scenario.with_({"simulation.draw": draw}), seeds=list(seeds))
        home = sum(run.success for run in runs)
        found[f"draw {draw}"] = [
            [run.seed, run.success, run.total_priority, run.energy.total, run.energy.margin, run.reason]
            for run in runs
        ]
        priority, spent = (np.mean([row[k] for row in found[f"draw {draw}"]]) for k in (2, 3))
        line = f"{home} of {len(runs)} home in time, reserve kept; priority {priority:.1f}, {spent:.0f} Wh"
        rows[f"simulated, true draw {draw:g} of the model's"] = line
    context, pairs = make_context(scenario, area=load_area(scenario)), []
    for seed in track(seeds, "constant speeds"):
        mission = start_mission(context, 0, prng.of_seeds([seed])[0], seed)
        time_edges([mission])
        available = mission.energy_left
        free = first_route(mission, mission.timed, available)
        priority, energy, route = constant(mission, available)
        options = mission.timed.options
        same = options.for_route(
            np.asarray(route.nodes), None, mission.timed.duration,
            (mission.run.t_available, energy + 1.0), "energy",
            options.chosen(mission.context.route_configs[0].levels),
        )  # fmt: skip
        edges = route.nodes[:-1], route.nodes[1:]
        least = options.energies[same[edges], *edges].sum()
        pairs.append([priority, energy, free.priority, float(free.speeds.energies.sum()), float(least)])
    before, energy, priority, spent, least = np.asarray(pairs).T
    saved, gain, equal = 1.0 - least / energy, priority - before, priority == before
    less = np.mean(1.0 - spent[equal] / energy[equal])
    rows |= {
        "energy of the best constant speed's order, at free speeds":
            f"{saved.mean():.1%} less (most {saved.max():.1%})",
        "priority at free speeds, against the best constant one":
            f"{gain.mean():+.2f} ({(gain > 0).sum()} more, {(gain < 0).sum()} less)",
        f"energy of missions of equal priority ({equal.sum()})": f"{less:.1%} less",
    }  # fmt: skip
    print(*markdown([SCENARIO, "missions"], rows.items()), "", sep="\n")
    return found | {"pairs": pairs}


def timed(seeds: Sequence[int]) -> dict[str, Any]:
    """Time plans at free and at fixed speed in turns."""
    free = ap.load_scenario(SCENARIO)
    fixed = free.with_({"vehicle.speed_range": None})
    area, ratios = load_area_at(free, [0.0]), []
    for seed in [seeds[0], *seeds]:
        spent = []
        for scenario in (fixed, free):
            begin = time.process_time()
            ap.plan_scenario(scenario, seed=seed, area=area)
            spent.append(time.process_time() - begin)
        ratios.append(spent[1] / spent[0])
    line = f"processor time of a plan at free speeds: {np.median(ratios[1:]):.2f} of one at a fixed speed"
    screen.print(f"{line} (median of {len(seeds)})")
    return {"ratios": ratios[1:]}


@launch(
    parts={"nargs": "*", "default": ["orders", "missions", "time"], "help": "orders, missions, time"},
    small=(300, "cases of exhaustive search"),
    large=(100, "cases of CP-SAT, for each number of speeds"),
    first=(5000, "seed of the first case"),
    seeds=(range(100), "of the missions"),
)
def main(parts: list[str], small: int, large: int, first: int, seeds: range) -> dict[str, Any]:
    found = orders(small, large, first) if "orders" in parts else {}
    found |= missions(seeds) if "missions" in parts else {}
    return found | (timed(seeds) if "time" in parts else {})
