"""References of missions: published optima, ways round areas in closed form."""

import json

import jax
import numpy as np
import pytest

from auvplan.mission import plan_mission
from benchmarks import detours
from benchmarks.clock_peers import FILE, posed, profit_of

SETS = json.loads(FILE.read_text(encoding="utf-8"))["sets"]


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
