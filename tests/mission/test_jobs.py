"""Operation graphs from jobs by place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from auvplan.mission.jobs import (
    JobLine,
    JobPoint,
    Jobs,
    Terrain,
    edges_off_lines,
    jobs_done,
    jobs_graph,
    jobs_of,
    kept_off,
)
from auvplan.ocean.known import KnownObstacle
from tests.mission.naive import best_priority

START, GOAL = (0.0, 0.0, 5.0), (1000.0, 300.0, 5.0)
POINTS = (JobPoint("reef", (200.0, 50.0, 10.0), 3.0, 40.0), JobPoint("gate", (500.0, -100.0, 5.0), 0.0))
LINE = JobLine("survey", ((600.0, 0.0, 8.0), (600.0, 300.0, 8.0), (700.0, 300.0, 8.0)), 8.0, 100.0)


def test_nodes_and_tasks():
    graph, names = jobs_graph(POINTS, [LINE], START, GOAL)
    assert names == ["start", "reef", "gate", "survey[1]", "survey[2]", "survey[3]", "goal"]
    np.testing.assert_array_equal(
        graph.positions[[0, 1, 4, 6]], [START, POINTS[0].position, LINE.positions[1], GOAL]
    )
    assert graph.adjacency[~np.eye(7, dtype=bool)].all()
    expected = np.zeros((7, 7))
    expected[[0, 2, 3, 4, 5, 6], 1] = 3.0
    expected[3, 4] = expected[4, 3] = 6.0
    expected[4, 5] = expected[5, 4] = 2.0
    np.testing.assert_allclose(graph.priority, expected)
    np.testing.assert_allclose(
        graph.duration[[0, 3, 4, 5, 3], [1, 4, 5, 4, 5]], [40.0, 75.0, 25.0, 25.0, 0.0]
    )


def test_without_ways_off_its_line_a_survey_is_whole_or_none():
    """By every route there is: with less time than the whole line needs, none of it is done."""
    graph, _ = jobs_graph(POINTS, [LINE], START, GOAL, whole=True)
    off = edges_off_lines(Jobs(POINTS, (LINE,)), graph.adjacency)
    assert set(off) == {(4, k) for k in (0, 1, 2, 6)} | {(k, 4) for k in (0, 1, 2, 6)}
    kept = graph.without_edges(off)
    assert best_priority(graph, 0, 6, 3000.0, 1.0) == best_priority(kept, 0, 6, 3000.0, 1.0)
    for budget in np.linspace(1000.0, 2000.0, 21):
        part, whole = (best_priority(ways, 0, 6, budget, 1.0) for ways in (graph, kept))
        if whole is not None:
            assert whole in (0.0, 3.0, 8.0, 11.0)
            assert whole <= part


def test_ends_of_whole_lines_are_joined_though_their_nearest_are_on_the_line():
    places = [(float(x), 0.0, 5.0) for x in range(0, 100, 10)]
    line = JobLine("dense", tuple(places), 5.0)
    graph, names = jobs_graph([], [line], (0.0, 900.0, 5.0), (90.0, 900.0, 5.0), neighbours=1, whole=True)
    kept = graph.without_edges(edges_off_lines(Jobs(lines=(line,)), graph.adjacency))
    assert best_priority(kept, 0, len(names) - 1, 1e5, 1.0) == pytest.approx(5.0)


def test_a_point_may_be_called_as_a_vertex_or_a_waypoint_of_a_detour_is():
    names = "survey[1]", "survey[2]", "CTD[1]", "CTD[2]", "(via 1)", "goal"
    points = tuple(JobPoint(name, (100.0 * k, 900.0, 5.0)) for k, name in enumerate(names, 1))
    jobs = Jobs(points, (LINE,))
    graph, _ = jobs_graph(points, [LINE], START, GOAL, whole=True)
    assert jobs_of(jobs) == [*((name, [k]) for k, name in enumerate(names, 1)), ("survey", [7, 8, 9])]
    off = edges_off_lines(jobs, graph.adjacency)
    assert set(off) == {edge for k in (*range(7), 10) for edge in ((8, k), (k, 8))}
    assert jobs_done(jobs, [(0, 1), (1, 2), (2, 4), (4, 5)]) == {
        "survey[1]",
        "survey[2]",
        "CTD[2]",
        "(via 1)",
    }
    assert jobs_done(jobs, [(6, 3), (3, 9), (9, 8)]) == {"CTD[1]"}
    assert jobs_done(jobs, [(3, 9), (9, 8), (8, 7)]) == {"survey"}


@pytest.mark.parametrize(("budget", "worth"), [(3000.0, 11.0), (1100.0, 3.0), (1050.0, 0.0), (1000.0, None)])
def test_what_the_best_mission_is_worth(budget, worth):
    """All jobs, or the reef alone, which lies on the way; by every route there is."""
    graph, _ = jobs_graph(POINTS, [LINE], START, GOAL)
    assert best_priority(graph, 0, 6, budget, 1.0) == (None if worth is None else pytest.approx(worth))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 60), st.integers(0, 4), st.sampled_from([None, 1, 3, 200]))
def test_properties(seed, count, lines, neighbours):
    rng = np.random.default_rng(seed)

    def place():
        return tuple(rng.uniform(0, 1000, 3))

    points = [JobPoint(f"p{k}", place(), rng.integers(0, 4), rng.uniform(0, 50)) for k in range(count)]
    surveys = [
        JobLine(
            f"l{k}", tuple(place() for _ in range(rng.integers(2, 5))), rng.integers(0, 9), rng.uniform(0, 99)
        )
        for k in range(lines)
    ]
    graph, names = jobs_graph(points, surveys, place(), place(), neighbours=neighbours)
    size = len(names)
    assert size == 2 + count + sum(len(line.positions) for line in surveys) == graph.size
    assert len(set(names)) == size
    np.testing.assert_array_equal(graph.adjacency, graph.adjacency.T)
    assert not np.diag(graph.adjacency).any()
    assert connected_components(graph.adjacency, directed=False)[0] == 1
    degree = graph.adjacency.sum(axis=1)
    least = size if neighbours is None and size <= 40 else neighbours or 7
    assert (degree >= min(least, size - 1)).all()
    if least < size / 4:
        assert degree.mean() < 2 * least + 4
    for k, point in enumerate(points, 1):
        np.testing.assert_allclose(graph.priority[:, k], np.where(graph.adjacency[:, k], point.priority, 0.0))
        np.testing.assert_allclose(graph.duration[:, k], np.where(graph.adjacency[:, k], point.duration, 0.0))
    for line in surveys:
        first = names.index(f"{line.name}[1]")
        along = [(first + k, first + k + 1) for k in range(len(line.positions) - 1)]
        for way in (along, [(j, i) for i, j in along]):
            assert sum(graph.priority[edge] for edge in way) == pytest.approx(line.priority)
            assert sum(graph.duration[edge] for edge in way) == pytest.approx(line.duration)
    assert (graph.priority[~graph.adjacency] == 0.0).all()


def test_jobs_that_standing_obstacles_keep_vehicles_off_are_named_with_the_obstacle():
    """Within it or its margin; one that moves, or reaches not so deep, keeps nothing off."""
    jobs = Jobs(POINTS, (LINE,))
    wreck, buoy = KnownObstacle("wreck", (205.0, 50.0), 20.0), KnownObstacle("buoy", (600.0, 323.0), 20.0)
    found = kept_off(jobs, (wreck, buoy), 5.0)
    assert list(found) == [1, 4]
    assert "it lies within the known obstacle 'wreck'" in found[1]
    assert "its vertex 2 lies 3.0 m from the known obstacle 'buoy'" in found[4]
    assert list(kept_off(jobs, (wreck, buoy), 5.0, whole=True)) == [1, 3, 4, 5]
    ferry = KnownObstacle("ferry", (205.0, 50.0), 20.0, velocity=(0.1, 0.0))
    assert not kept_off(jobs, (ferry, KnownObstacle("raft", (205.0, 50.0), 20.0, 0.0, 4.9)), 5.0)
    assert not kept_off(None, (wreck,), 5.0)


def test_no_edge_leads_to_what_is_barred_and_the_others_are_joined():
    """Also where that is all which is near to a point, and within a line."""
    near = [JobPoint(f"n{k}", (5000.0 + k, 0.0, 5.0)) for k in range(10)]
    points = [
        *near,
        JobPoint("beyond", (5100.0, 0.0, 5.0)),
        *(JobPoint(f"p{k}", (k, 9.0, 5.0)) for k in range(40)),
    ]
    barred = [*range(1, 11), 53]
    graph, _ = jobs_graph(points, [LINE], START, GOAL, barred=barred)
    assert not graph.adjacency[barred].any()
    assert not graph.adjacency[:, barred].any()
    others = np.delete(np.arange(graph.size), barred)
    assert connected_components(graph.adjacency[np.ix_(others, others)], directed=False)[0] == 1
    assert (graph.adjacency[others].sum(axis=1) >= 7).all()
    assert graph.priority[52, 53] == pytest.approx(6.0)


DYKE = JobLine("dyke", ((300.0, 50.0, 5.0), (350.0, 60.0, 5.0), (500.0, 70.0, 5.0)))


def wall(open_at):
    """Straight lines across north = 400 are clear only where both ends lie west of `open_at`."""

    def clear(positions):
        south = positions[:, 0] < 400.0
        across = south[:, None] != south[None, :]
        west = positions[:, 1] < open_at
        return ~across | (west[:, None] & west[None, :])

    return clear


def test_only_clear_lines_become_edges():
    graph, names = jobs_graph(POINTS, [LINE], START, GOAL, terrain=Terrain(wall(1.0)))
    edges = {(names[i], names[j]) for i, j in np.argwhere(graph.adjacency)}
    assert ("start", "gate") in edges
    assert ("start", "survey[1]") in edges
    assert ("start", "survey[2]") not in edges
    assert ("reef", "gate") not in edges
    assert graph.priority[2, 1] == 0.0
    few, _ = jobs_graph(POINTS, [LINE], START, GOAL, terrain=Terrain(wall(1.0)), neighbours=1)
    assert connected_components(few.adjacency, directed=False)[0] == 1
    assert not (few.adjacency & ~graph.adjacency).any()


def test_a_part_of_a_line_is_an_edge_whatever_stands_in_it():
    graph, names = jobs_graph(POINTS, [DYKE], START, GOAL, terrain=Terrain(wall(1.0)))
    nodes = [names.index(f"dyke[{k}]") for k in (1, 2, 3)]
    assert graph.adjacency[nodes[:2], nodes[1:]].all()
    assert graph.priority[nodes[1], nodes[2]] > 0.0


@pytest.mark.parametrize(
    ("lines", "more", "words"),
    [
        ([LINE], {"terrain": Terrain(wall(-200.0))}, "and no detour leads from the start to 'gate', "),
        ([JobLine("dot", ((1.0, 2, 3),))], {}, "line 'dot' has 1 vertices"),
        ([JobLine("dot", ((1.0, 2, 3), (1.0, 2, 3)))], {}, "line 'dot': vertices 1 and 2 are in one place"),
        ([JobLine("dot", ((1.0, 2, 3), (1.0, 2, np.nan)))], {}, "'dot': a position is finite"),
        ([JobLine("low", ((1.0, 2, 3), (1.0, 2, 4)), -1.0)], {}, "priority must not be negative"),
        ([], {"neighbours": 0}, "neighbours must be positive"),
        ([], {"terrain": Terrain(lambda positions: True)}, "clear must give"),
        ([], {"start": (1.0, 2.0)}, "'start': a position is finite"),
    ],
)  # fmt: skip
def test_jobs_that_make_no_graph(lines, more, words):
    arguments = {"start": START, "goal": GOAL, **more}
    with pytest.raises(ValueError, match=words):
        jobs_graph(POINTS, lines, **arguments)


def test_without_jobs_there_is_one_edge():
    graph, names = jobs_graph([], [], START, GOAL)
    assert names == ["start", "goal"]
    assert graph.adjacency[0, 1]
    assert graph.priority.sum() == 0.0
