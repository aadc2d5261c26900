"""Graphs from lists of edges and tasks."""

import jax
import numpy as np
import pytest

from auvplan.mission import plan_mission, task_graph
from tests.mission.naive import QUICK

LINE = np.array([[0.0, 0, 0], [100, 0, 0], [200, 0, 0], [300, 0, 0]])
EDGES = [(0, 1), (1, 2), (2, 3), (0, 2)]


def test_tasks_on_an_edge_add_up_both_ways() -> None:
    graph = task_graph(LINE, EDGES, [(0, 1, 2, 60), (1, 0, 1, 30), (2, 3, 4, 10)])
    np.testing.assert_array_equal(graph.adjacency, graph.adjacency.T)
    assert graph.priority[0, 1] == graph.priority[1, 0] == 3.0
    assert graph.duration[0, 1] == graph.duration[1, 0] == 90.0
    assert graph.priority[1, 2] == 0.0
    assert graph.adjacency[1, 2]


def test_one_way_edges_and_tasks() -> None:
    graph = task_graph(LINE, [(0, 1), (1, 0), (1, 2)], [(0, 1, 2, 60)], directed=True)
    assert graph.priority[0, 1] == 2.0
    assert graph.priority[1, 0] == 0.0
    assert graph.adjacency[1, 2]
    assert not graph.adjacency[2, 1]


def test_a_task_at_a_waypoint_is_done_once_whichever_way_it_is_reached() -> None:
    graph = task_graph(LINE, EDGES, [(1, 2, 5, 20)], [(2, 3, 50), (1, 1, 10)])
    route = plan_mission(graph, 0, 3, 1000.0, speed=1.0, key=jax.random.key(0), config=QUICK)
    assert route.nodes.tolist() == [0, 1, 2, 3]
    assert route.priority == 1 + 5 + 3
    assert route.time == pytest.approx(300.0 + 10 + 20 + 50)
    short = plan_mission(graph, 0, 3, 355.0, speed=1.0, key=jax.random.key(0), config=QUICK)
    assert short.nodes.tolist() == [0, 2, 3]
    assert short.priority == 3.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([(0, 4)],), r"edge \(0, 4\)"),
        (([(1, 1)],), r"edge \(1, 1\)"),
        ((EDGES, [(0, 3, 1, 1)]), r"\(0, 3\), which is not an edge"),
        ((EDGES, [], [(4, 1, 1)]), "waypoint 4"),
        ((EDGES, [(0, 1, -1, 1)]), "priority must not be negative"),
    ],
)
def test_bad_lists_are_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        task_graph(LINE, *arguments)
