"""Routes by the clock against a peer and published optima: ``python -m benchmarks.clock_peers``.

Peers: single-vehicle prize-collecting problems with a time window a customer, drawn in the manner of
Solomon's. PyVRP gets the same whole seconds and prizes that count before the way. Published: orienteering
with windows on Solomon's customers, distances rounded down to one decimal, as in the literature; what is
planned is walked again in whole tenths, and proved by `plan_mission(..., method="exact")`.
"""

import json
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import jax
import numpy as np
from scipy.spatial.distance import cdist

from auvplan.mission import MissionGraph, MissionRoute, plan_mission
from benchmarks.harness import clock, figures, launch, screen, show
from benchmarks.missions.peers import prize_collecting
from benchmarks.missions.sets import timed_graph

#: Prizes count so many times as much as a second of the way.
PRIZE = 10_000
#: s: windows close, and the time ends, this much after a whole second, and after a tenth.
HALF, HALF_TENTH = 0.5, 0.05
#: Orienteering with windows on Solomon's customers.
FILE = Path(__file__).with_name("solomon.json")


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
    """Total prize of PyVRP's route, whose prizes count before the way."""
    places, prizes, *windows = problem
    travel, last = np.round(cdist(places, places)), {"tw_early": 0, "tw_late": int(windows[-1][0])}
    route = prize_collecting(places, travel, PRIZE * prizes, (0, 0), seed, seconds, tuple(windows), **last)
    return float(prizes[route[1:-1]].sum())


def compared(sizes: list[int], cases: int, seconds: float, first: int) -> list[dict[str, Any]]:
    rows, seeds = [], range(first, first + cases)
    for count, kind in product(sizes, ("R", "C", "RC")):
        problems = {seed: customers(seed, count, kind) for seed in seeds}
        found, best = np.array(
            [(ours(one, seed), peers(one, seconds, seed)) for seed, one in problems.items()]
        ).T
        gaps = (1.0 - found / best).tolist()
        row = {"customers": count, "kind": kind, "cases": cases, "gaps": gaps} | figures(gaps)
        rows.append(row | {"ours": float(found.mean()), "theirs": float(best.mean())})
    gaps = figures([gap for row in rows for gap in row["gaps"]])
    columns = {
        "customers": "{customers}", "kind": "{kind}", "cases": "{cases}", "ours": "{ours:.1f}",
        "PyVRP": "{theirs:.1f}", "mean gap": "{mean:.2%}", "worst gap": "{worst:.2%}",
    }  # fmt: skip
    show("prizes against PyVRP", rows, columns, names=2)
    screen.print("all: mean gap {mean:.2%}, worst {worst:.2%}".format(**gaps))
    return rows


def posed(stated: dict[str, Any]) -> tuple[MissionGraph, float]:
    """Graph of a set, the depot twice, and the time available."""
    x, y, profit, ready, due = np.array(stated["customers"], float).T
    depot = np.array(stated["depot"], float)
    places = np.vstack([depot, np.c_[x, y], depot])
    travel = np.floor(10.0 * cdist(places, places) + 1e-9) / 10.0
    np.fill_diagonal(travel, np.inf)
    travel[0, -1] = travel[-1, 0] = np.inf

    def at_ends(inner: np.ndarray, ends: float) -> np.ndarray:
        return np.concatenate([[ends], inner, [ends]])

    service = at_ends(np.full(len(x), float(stated["service"])), 0.0)
    windows = at_ends(ready, -np.inf), at_ends(due + HALF_TENTH, np.inf)
    graph = timed_graph(places, travel[None], at_ends(profit, 0.0), service, *windows)
    return graph, stated["until"] + HALF_TENTH


def profit_of(stated: dict[str, Any], nodes: list[int]) -> int:
    """Profit of a route, walked in whole tenths from the set's own table.

    Raises:
        ValueError: a window is missed, or the depot is closed at the end.
    """
    rows, depot = [None, *stated["customers"], None], stated["depot"]
    places = [row[:2] if row else depot for row in rows]
    now, total = 0, 0
    for i, j in pairwise(nodes):
        squared = sum((a - b) ** 2 for a, b in zip(places[i], places[j], strict=True))
        now += int(np.floor(10.0 * squared**0.5 + 1e-9))
        if rows[j]:
            _, _, profit, ready, due = rows[j]
            if now > 10 * due:
                raise ValueError(f"customer {j} is reached at {now / 10}, after {due}")
            now, total = max(now, 10 * ready) + 10 * stated["service"], total + profit
    if now > 10 * stated["until"]:
        raise ValueError(f"back at {now / 10}, after {stated['until']}")
    return total


def published(seeds: int, limit: float) -> list[dict[str, Any]]:
    """Rows of Solomon's sets: profits of plans beside the published optimum, and a proof."""
    rows = []
    for name, stated in json.loads(FILE.read_text(encoding="utf-8"))["sets"].items():
        graph, until = posed(stated)

        def planned(seed: int, graph: Any = graph, until: float = until, **more: Any) -> MissionRoute:
            return plan_mission(graph, 0, graph.size - 1, until, speed=1.0, key=jax.random.key(seed), **more)

        planned(0)  # compiles
        seconds, routes = clock(lambda planned=planned: [planned(seed) for seed in range(1, 1 + seeds)])
        found = [profit_of(stated, route.nodes.tolist()) for route in routes]
        proof: dict[str, Any] = {}
        if limit:
            exact = planned(0, method="exact", time_limit=limit)
            proof = {"priority": profit_of(stated, exact.nodes.tolist()), "bound": float(exact.bound)}
        words = "{priority} to {bound:.0f}".format(**proof) if proof else "none"
        row = {"set": name, "published": stated["most"], "found": found, "proof": words} | proof
        row |= {"mean": float(np.mean(found)), "worst": min(found), "best": max(found)}
        rows.append(row | {"seconds": seconds / seeds})
    columns = {
        "set": "{set}", "published": "{published}", "planned: mean": "{mean:.1f}", "worst": "{worst}",
        "best": "{best}", "plan, s": "{seconds:.2f}", "proof": "{proof}",
    }  # fmt: skip
    show("profit of one vehicle, 100 customers", rows, columns)
    return rows


@launch(
    sizes=((100, 200), "customers of the problems against PyVRP"),
    cases=(3, "of each size and kind"),
    seconds=(10.0, "of PyVRP for each"),
    first=(95_000, "first seed"),
    seeds=(5, "plans of each of Solomon's sets; 0 for none"),
    limit=(120.0, "s for each proof; 0 for none"),
)
def main(
    sizes: list[int], cases: int, seconds: float, first: int, seeds: int, limit: float
) -> dict[str, Any]:
    return {
        "solomon": published(seeds, limit) if seeds else [],
        "pyvrp": compared(sizes, cases, seconds, first) if sizes and cases else [],
    }
