"""Orienteering with time windows on Solomon's customers: ``python -m benchmarks.solomon``.

One vehicle collects as much profit as it can within windows. Distances are rounded down to one decimal, and
count as times, as in the literature. What is planned is walked again in whole tenths, and held against the
published optimum and against a proof by `plan_mission(..., method="exact")`.
"""

import json
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import jax
import numpy as np
from scipy.spatial.distance import cdist

from auvplan.mission import MissionGraph, MissionRoute, plan_mission
from benchmarks.machine import arguments, show, write
from benchmarks.mission_sets import timed_graph

FILE = Path(__file__).with_name("solomon.json")
#: s: windows close, and the time ends, this much after a tenth.
HALF = 0.05


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
    windows = at_ends(ready, -np.inf), at_ends(due + HALF, np.inf)
    return timed_graph(places, travel[None], at_ends(profit, 0.0), service, *windows), stated["until"] + HALF


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


def main() -> None:
    parser = arguments("Orienteering with time windows on Solomon's customers.")
    parser.add_argument("--seeds", type=int, default=5, help="plans of each set")
    parser.add_argument("--limit", type=float, default=120.0, help="s for each proof; 0 for none")
    options = parser.parse_args()
    rows = []
    for name, stated in json.loads(FILE.read_text(encoding="utf-8"))["sets"].items():
        graph, until = posed(stated)

        def planned(seed: int, graph: Any = graph, until: float = until, **more: Any) -> MissionRoute:
            return plan_mission(graph, 0, graph.size - 1, until, speed=1.0, key=jax.random.key(seed), **more)

        planned(0)  # compiles
        begin = time.perf_counter()
        found = [profit_of(stated, planned(seed).nodes.tolist()) for seed in range(1, 1 + options.seeds)]
        seconds = (time.perf_counter() - begin) / options.seeds
        proof: dict[str, Any] = {}
        if options.limit:
            exact = planned(0, method="exact", time_limit=options.limit)
            proof = {"priority": profit_of(stated, exact.nodes.tolist()), "bound": float(exact.bound)}
        words = "{priority} to {bound:.0f}".format(**proof) if proof else "none"
        row = {"set": name, "published": stated["most"], "found": found, "seconds": seconds, "proof": words}
        row |= {"mean": float(np.mean(found)), "worst": min(found), "best": max(found)}
        rows.append(row | proof)
    columns = {
        "set": "{set}", "published": "{published}", "planned: mean": "{mean:.1f}", "worst": "{worst}",
        "best": "{best}", "plan, s": "{seconds:.2f}", "proof": "{proof}",
    }  # fmt: skip
    show("profit of one vehicle, 100 customers", rows, columns)
    write(options.out, {"solomon": rows})


if __name__ == "__main__":
    main()
