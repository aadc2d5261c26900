"""References of missions: labels against all orders, published optima, ways round areas in closed form."""

import json
from itertools import permutations

import jax
import numpy as np
import pytest

from auvplan.mission import plan_mission
from benchmarks import detours
from benchmarks.clock_peers import FILE, posed, profit_of
from benchmarks.missions.labels import Windows, most_priority

SIZE, END = 7, 1200
SETS = json.loads(FILE.read_text(encoding="utf-8"))["sets"]


def mission(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Legs, windows and priorities of a few waypoints, in whole seconds."""
    rng = np.random.default_rng(seed)
    lasts = rng.integers(60, 400, (SIZE, SIZE)).astype(float)
    lasts[rng.random(lasts.shape) < 0.2] = np.inf
    opens = rng.integers(0, END, (SIZE, 2)).astype(float)
    closes = opens + rng.integers(20, 400, (SIZE, 2))
    opens[[0, -1]], closes[[0, -1]] = -np.inf, np.inf
    priority = rng.integers(1, 10, SIZE).astype(float)
    priority[[0, -1]] = 0.0
    return lasts, opens, closes, priority


def by_all_orders(lasts, opens, closes, priority) -> float:
    """Most total priority; zero where no order reaches the last waypoint with a task."""
    best = 0.0
    orders = (order for count in range(1, SIZE - 1) for order in permutations(range(1, SIZE - 1), count))
    for between in orders:
        time, here = 0.0, 0
        for node in (*between, SIZE - 1):
            arrives = time + lasts[here, node]
            here, late = node, arrives > closes[node]
            time = np.where(late, np.inf, np.maximum(arrives, opens[node])).min()
        if time <= END:
            best = max(best, priority[list(between)].sum())
    return best


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_labels_find_and_prove_the_best_order(seed):
    windows, best = Windows.of(*mission(seed), END), by_all_orders(*mission(seed))
    assert most_priority(windows, 0.0) == (best, best)
    assert most_priority(windows, best) == (best, best)


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_plans_have_the_profit_of_the_published_optimum(name):
    graph, until = posed(SETS[name])
    route = plan_mission(graph, 0, graph.size - 1, until, speed=1.0, key=jax.random.key(0))
    assert profit_of(SETS[name], route.nodes.tolist()) == SETS[name]["most"]


def test_a_route_that_misses_a_window_is_told():
    """Customer 58 of R101 opens long after customer 59 closes."""
    with pytest.raises(ValueError, match="customer 59 is reached"):
        profit_of(SETS["r101"], [0, 58, 59, 101])


@pytest.mark.slow
@pytest.mark.usefixtures("light_search")
@pytest.mark.filterwarnings("ignore:.*lie in the same place:auvplan.errors.ScenarioWarning")
@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_plans_among_areas_and_islands_are_as_good_as_exhaustive_search(seed, tmp_path):
    """Without a seed: a closed area whose corners the best tour clips, and two known obstacles."""
    case = detours.hobart() if seed is None else detours.drawn(seed)
    row = detours.planned(case, seed, tmp_path)
    assert row.priority == row.best
    assert row.faults == ()
    if seed is None:
        assert row.best == 26.0
        assert row.time < 1.02 * row.least


def test_the_reference_goes_round_what_is_in_the_way():
    """Of two places on both sides of a square, and two that see each other."""
    places = np.array([(0.0, -1500.0), (0.0, 1500.0), (2000.0, 1500.0)])
    paths = detours.shortest_paths(detours.hobart(), places)
    around, along = (np.linalg.norm(np.diff(paths[pair], axis=0), axis=1).sum() for pair in ((0, 1), (1, 2)))
    margin = detours.COAST
    assert along == pytest.approx(2000.0)
    assert 2.0 * np.hypot(1100.0, 700.0) + 1600.0 < around < 2.0 * np.hypot(1100 + margin, 700.0) + 1640.0
    still = detours.seconds_along(paths[0, 1], 0.0, lambda now: np.zeros(2))
    assert still == pytest.approx(around / detours.SPEED)
