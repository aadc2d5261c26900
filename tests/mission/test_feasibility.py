"""The five rules of a valid mission."""

import numpy as np
import pytest

from auvplan.mission import MissionGraph, check_route

LINE = np.array([[0.0, 0, 0], [100.0, 0, 0], [200.0, 0, 0], [300.0, 0, 0]])
EDGES = np.array([[0, 1, 1, 0], [1, 0, 1, 1], [1, 1, 0, 1], [0, 1, 1, 0]], bool)
GRAPH = MissionGraph(LINE, EDGES, EDGES * 2.0, EDGES * 10.0)


@pytest.mark.parametrize(
    ("nodes", "budget", "broken"),
    [
        ([0, 1, 2, 3], 200.0, set()),
        ([1, 2, 3], 200.0, {"ends"}),
        ([0, 1, 2], 200.0, {"ends"}),
        ([], 200.0, {"ends"}),
        ([0, 3], 1000.0, {"edges_exist"}),
        ([0, 1, 9, 3], 1000.0, {"edges_exist"}),
        ([0, 1, -1, 3], 1000.0, {"edges_exist"}),
        ([0, 1, 1, 3], 1000.0, {"edges_exist", "nodes_once"}),
        ([0, 1, 2, 0, 2, 3], 1000.0, {"nodes_once", "edges_once"}),
        ([0, 1, 2, 1, 3], 1000.0, {"nodes_once", "edges_once"}),
        ([0, 2, 1, 0, 1, 3], 1000.0, {"nodes_once", "edges_once"}),
        ([0, 1, 2, 3], 180.0, {"in_time"}),
        ([0, 1, 2, 3], 180.0001, set()),
    ],
)
def test_each_broken_rule_is_caught(nodes: list[int], budget: float, broken: set[str]) -> None:
    check = check_route(GRAPH, nodes, 0, 3, budget, speed=2.0)
    rules = ("ends", "edges_exist", "nodes_once", "edges_once", "in_time")
    assert {rule for rule in rules if not getattr(check, rule)} == broken
    assert len(check.reasons) == len(broken)
    assert bool(check) == check.valid == (not broken)


def test_time_and_reasons_tell_what_is_wrong() -> None:
    check = check_route(GRAPH, [0, 1, 2, 3], 0, 3, 100.0, speed=2.0)
    assert check.time == pytest.approx(3 * 50.0 + 30.0)
    assert check.reasons == ("takes 180.0 s, 100.0 s are available",)
    assert (
        check_route(GRAPH.with_travel_time(0, 1, 500.0), [0, 1, 3], 0, 3, 1e4, 2.0).time
        == 500 + 10 + 100 + 10
    )


def test_the_two_directions_of_a_directed_graph_are_two_edges() -> None:
    directed = MissionGraph(LINE, EDGES, np.triu(EDGES) * 2.0, EDGES * 10.0)
    assert check_route(directed, [0, 1, 2, 1, 3], 0, 3, 1e4, 2.0).edges_once
    assert not check_route(GRAPH, [0, 1, 2, 1, 3], 0, 3, 1e4, 2.0).edges_once
