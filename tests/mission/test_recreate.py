"""Routes taken apart and completed otherwise: none is worse than before, and small ones are the best."""

from itertools import permutations

import numpy as np
import pytest

from auvplan.mission.rearrange import Still
from auvplan.mission.recreate import improved


def jobs(seed: int, size: int, share: float) -> Still:
    """Jobs that all lead to each other, in a share of the time that the route through all of them takes."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 1000.0, (size, 2))
    times = np.linalg.norm(places[:, None] - places, axis=-1) + rng.uniform(0.0, 100.0, size)
    np.fill_diagonal(times, np.inf)
    priority = np.tile(rng.integers(1, 6, size).astype(float), (size, 1))
    priority[:, [0, -1]] = 0.0
    return Still(times, priority, share * float(times[np.arange(size - 1), np.arange(1, size)].sum()))


def taken(route: list[int], mission: Still) -> tuple[float, float]:
    """Total priority and minus the time of a route that keeps the limit."""
    assert len(set(route)) == len(route)
    (ends,), (worth,) = mission.walk(np.asarray([route]))
    assert ends < mission.end
    return worth, -ends


@pytest.mark.parametrize("seed", range(8))
def test_small_lists_of_jobs_are_done_in_the_best_way(seed) -> None:
    mission, size = jobs(seed, 8, 0.5), 8
    best = (0.0, 0.0)
    for count in range(1, size - 1):
        inner = np.array(list(permutations(range(1, size - 1), count)), int).reshape(-1, count)
        ends = np.zeros((len(inner), 1), int)
        end, worth = mission.walk(np.hstack([ends, inner, ends + size - 1]))
        best = max(
            [best, *zip(worth[np.isfinite(end)].tolist(), (-end[np.isfinite(end)]).tolist(), strict=True)]
        )
    found = improved([[0, size - 1]], mission, np.random.default_rng(0), 60)
    assert taken(found, mission) == pytest.approx(best)


def test_more_jobs_are_done_than_by_moves_alone_and_the_same_ones_again() -> None:
    more = 0.0
    for seed in range(4):
        mission, start = jobs(100 + seed, 30, 0.3), [[0, 29]]
        plain = improved(start, mission, np.random.default_rng(0), 0)
        found, again = (improved(start, mission, np.random.default_rng(0), 40) for _ in range(2))
        assert found == again
        assert taken(found, mission) >= taken(plain, mission)
        more += taken(found, mission)[0] - taken(plain, mission)[0]
    assert more > 0.0


def test_there_is_time_for_no_round() -> None:
    mission = jobs(7, 20, 0.3)
    plain = improved([[0, 19]], mission, np.random.default_rng(0), 0)
    assert improved([[0, 19]], mission, np.random.default_rng(0), 40, lambda: False)[0] == plain[0] == 0
