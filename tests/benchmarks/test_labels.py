"""Labels of the benchmark against all orders, gone through one by one."""

from itertools import permutations

import numpy as np
import pytest

from benchmarks.labels import Windows, most_priority

pytestmark = pytest.mark.slow

SIZE, END = 7, 1200


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
    for count in range(1, SIZE - 1):
        for between in permutations(range(1, SIZE - 1), count):
            time, here = 0.0, 0
            for node in (*between, SIZE - 1):
                arrives = time + lasts[here, node]
                here = node
                late = arrives > closes[node]
                time = np.where(late, np.inf, np.maximum(arrives, opens[node])).min()
            if time <= END:
                best = max(best, priority[list(between)].sum())
    return best


@pytest.mark.parametrize("seed", range(8))
def test_labels_find_and_prove_the_best_order(seed):
    lasts, opens, closes, priority = mission(seed)
    windows = Windows.of(lasts, opens, closes, priority, END)
    best = by_all_orders(lasts, opens, closes, priority)
    assert most_priority(windows, 0.0) == (best, best)
    assert most_priority(windows, best) == (best, best)
