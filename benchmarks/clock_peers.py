"""Routes by the clock against peers and a referee: ``python -m benchmarks.clock_peers``.

Peers: single-vehicle prize-collecting problems with a time window a customer, drawn in the manner of
Solomon's. PyVRP gets the same whole seconds and prizes that count before the way. Referee: routes in a tide
with windows, of which every leg is walked again in plain Python from the table of arrivals alone.
"""

import argparse
import math
from itertools import pairwise, product

import jax
import numpy as np
from scipy.spatial.distance import cdist

from auvplan.mission import MissionGraph, plan_mission
from benchmarks.machine import machine, markdown
from benchmarks.mission_sets import timed_graph

#: Prizes count so many times as much as a second of the way.
PRIZE = 10_000
HALF = 0.5


def customers(seed: int, count: int, kind: str) -> tuple[np.ndarray, ...]:
    """Places [N, 2], prizes, service times, ready and due times [N], whole, of a depot and customers."""
    rng = np.random.default_rng(seed)
    scattered = rng.integers(0, 1001, (count, 2)).astype(float)
    centres = rng.integers(100, 901, (10, 2))
    clustered = centres[rng.integers(0, 10, count)] + rng.normal(0.0, 40.0, (count, 2)).round()
    clustered = np.clip(clustered, 0, 1000)
    mixed = {"R": np.zeros(count, bool), "C": np.ones(count, bool), "RC": rng.random(count) < 0.5}[kind]
    places = np.vstack([[500.0, 500.0], np.where(mixed[:, None], clustered, scattered)])
    horizon = 4000.0
    prizes, service = rng.integers(1, 10, count), rng.integers(10, 91, count)
    widths = (rng.uniform(0.1, 0.5, count) * horizon).round()
    middles = rng.uniform(0.1, 0.9, count) * horizon
    ready = np.maximum(middles - widths / 2, 0).round()
    due = np.minimum(ready + widths, horizon - 100)
    return places, np.r_[0, prizes], np.r_[0, service], np.r_[0.0, ready], np.r_[horizon, due]


def ours(problem: tuple[np.ndarray, ...], seed: int) -> float:
    """Total prize of the planned route, walked again in whole seconds."""
    places, prizes, service, ready, due = (np.concatenate([part, part[:1]]) for part in problem)
    travel = np.round(cdist(places, places))
    travel[0, -1] = travel[-1, 0] = 1.0
    np.fill_diagonal(travel, np.inf)
    timed = timed_graph(places, travel[None], prizes, service, ready, due + HALF)
    end = float(due[0]) + HALF
    route = plan_mission(timed, 0, timed.size - 1, end, speed=1.0, key=jax.random.key(seed))
    now, total = 0.0, 0.0
    for i, j in pairwise(route.nodes.tolist()):
        begins = max(now + float(travel[i, j]), float(ready[j]))
        assert begins <= due[j]
        now, total = begins + float(service[j]), total + float(prizes[j])
    assert now < end
    return total


def peers(problem: tuple[np.ndarray, ...], seconds: float, seed: int) -> float:
    from pyvrp import Model
    from pyvrp.stop import MaxRuntime

    places, prizes, service, ready, due = problem
    model = Model()
    locations = [model.add_location(*place) for place in places.tolist()]
    depot = model.add_depot(locations[0])
    for k, location in enumerate(locations[1:], 1):
        model.add_client(
            location, service_duration=int(service[k]), tw_early=int(ready[k]), tw_late=int(due[k]),
            prize=PRIZE * int(prizes[k]), required=False,
        )  # fmt: skip
    model.add_vehicle_type(1, start_depot=depot, end_depot=depot, tw_early=0, tw_late=int(due[0]))
    travel = np.round(cdist(places, places)).astype(int)
    for i, one in enumerate(locations):
        for j, other in enumerate(locations):
            if i != j:
                model.add_edge(one, other, distance=int(travel[i, j]), duration=int(travel[i, j]))
    found = model.solve(MaxRuntime(seconds), seed=seed, display=False)
    return found.best.prizes() / PRIZE if found.is_feasible() else 0.0


def compare(sizes: list[int], cases: int, seconds: float, first: int) -> None:
    head = markdown(("customers", "kind", "cases", "ours", "PyVRP", "mean gap", "worst gap"), [])
    print(*head, sep="\n")
    gaps = []
    for count, kind in product(sizes, ("R", "C", "RC")):
        rows = []
        for seed in range(first, first + cases):
            problem = customers(seed, count, kind)
            rows.append((ours(problem, seed), peers(problem, seconds, seed)))
        found, best = np.array(rows).T
        gap = 1.0 - found / best
        gaps += gap.tolist()
        means = f"{found.mean():.1f} | {best.mean():.1f}"
        print(f"| {count} | {kind} | {cases} | {means} | {gap.mean():.2%} | {gap.max():.2%} |", flush=True)
    print(f"all: mean gap {np.mean(gaps):.2%}, worst {np.max(gaps):.2%}, {len(gaps)} cases")


def tidal(seed: int) -> tuple[MissionGraph, float]:
    """A graph whose legs take another time at every departure, with windows."""
    rng, size, horizon = np.random.default_rng(seed), 24, 14_400.0
    places = rng.uniform(0.0, 6000.0, (size, 2))
    departures, way = np.linspace(0.0, horizon, 24), places[None] - places[:, None]
    stream = 0.6 * np.cos(2.0 * math.pi * departures / 44_714.0 + rng.uniform(0.0, 6.3))[:, None, None]
    length = np.maximum(np.hypot(*np.moveaxis(way, -1, 0)), 1.0)
    along, across = stream * way[..., 0] / length, stream * way[..., 1] / length
    adjacency = (rng.random((size, size)) < 0.7) & ~np.eye(size, dtype=bool)
    travel = np.where(adjacency, length / (along + np.sqrt(1.5**2 - across**2)), np.inf)
    rho, stay = rng.integers(1, 10, size).astype(float), rng.uniform(60.0, 400.0, size)
    rho[[0, -1]] = stay[[0, -1]] = 0.0
    opens = rng.uniform(0.0, 0.8 * horizon, size)
    closes = opens + rng.uniform(600.0, 6000.0, size)
    free = rng.random(size) < 0.4
    free[[0, -1]] = True
    opens[free], closes[free] = -np.inf, np.inf
    return timed_graph(places, travel, rho, stay, opens, closes, departures=departures), horizon


def walked(graph: MissionGraph, nodes: list[int]) -> list[float]:
    """Durations of the legs of a route: the table between two departures, windows, waiting; plain Python."""
    table = graph.timetable
    assert table is not None
    departures, now, found = [float(moment) for moment in table.departures], 0.0, []
    for i, j in pairwise(nodes):
        ends = []
        for k, moment in enumerate(departures):
            if moment >= now:
                ends.append(moment + float(table.travel_time[k, i, j]))
        for k in range(len(departures) - 1):
            if departures[k] <= now <= departures[k + 1]:
                share = (now - departures[k]) / (departures[k + 1] - departures[k])
                before, after = float(table.travel_time[k, i, j]), float(table.travel_time[k + 1, i, j])
                ends.append(now + before + share * (after - before))
        if now > departures[-1]:
            ends.append(now + float(table.travel_time[-1, i, j]))
        arrival = min(ends)
        opens, closes = float(table.opens[i, j, 0]), float(table.closes[i, j, 0])
        done = (max(arrival, opens) if arrival <= closes else math.inf) + float(graph.duration[i, j])
        found.append(done - now)
        now = done
    return found


def referee(cases: int, first: int) -> None:
    right = 0
    for seed in range(first, first + cases):
        graph, available = tidal(seed)
        route = plan_mission(graph, 0, graph.size - 1, available, speed=1.5, key=jax.random.key(seed))
        again = walked(graph, route.nodes.tolist())
        same = route.feasible and np.abs(np.subtract(route.leg_times, again)).max() < 1e-6
        right += bool(same and sum(again) < available)
    print(f"referee: durations confirmed of {right} of {cases} routes", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="*", default=[100, 200])
    parser.add_argument("--cases", type=int, default=3, help="of each size and kind")
    parser.add_argument("--seconds", type=float, default=10.0, help="of PyVRP for each")
    parser.add_argument("--routes", type=int, default=100, help="of the referee")
    parser.add_argument("--first", type=int, default=95_000, help="first seed")
    chosen = parser.parse_args()
    print(f"{machine()['processor']}, seeds from {chosen.first}")
    if chosen.routes:
        referee(chosen.routes, chosen.first)
    if chosen.sizes and chosen.cases:
        compare(chosen.sizes, chosen.cases, chosen.seconds, chosen.first)


if __name__ == "__main__":
    main()
