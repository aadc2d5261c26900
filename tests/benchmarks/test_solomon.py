"""Orienteering with windows against the published optima."""

import json

import jax
import pytest

from auvplan.mission import plan_mission
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
