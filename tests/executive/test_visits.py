"""What may be visited again, and the rules that bring the vehicle home: each fails without its rule."""

import jax
import numpy as np
import pytest

import auvplan as ap
from auvplan.check.run import check_dataset
from auvplan.executive import loop, route_calls
from auvplan.executive.route_calls import plan_routes, time_edges
from auvplan.io.results import to_dataset
from auvplan.mission import task_graph
from tests.executive.small import SMALL, planning

pytestmark = pytest.mark.usefixtures("light_search")

#: Waypoints on a line, a kilometre apart but for the last two.
PLACES = np.array([[500.0 * k, 500.0, 10.0] for k in range(8)])
GOAL = 7


def at_waypoint(edges, edge_tasks=(), waypoint_tasks=(), available=5000.0, here=0, behind=(), **settings):
    """A mission at a waypoint of a hand-made graph with some waypoints behind it."""
    context = loop.make_context(planning(travel_times="distance", return_margin=0.0, **settings), ".")
    mission = loop.start_mission(context, 0, jax.random.key(0), 0)
    graph = task_graph(PLACES, edges, edge_tasks, waypoint_tasks)
    mission.run.graph, mission.run.t_available, mission.here = graph, available, here
    mission.visited = {*behind, here} if behind else set()
    mission.graph = graph.without_waypoints(behind) if context.rules.visits == "once" else graph
    time_edges([mission])
    return mission


def test_a_visited_waypoint_is_passed_where_no_other_way_leads_on():
    edges = [(0, 1), (1, 2), (1, GOAL)]
    tasks = [(1, 2, 5.0, 60.0), (1, GOAL, 2.0, 30.0)]
    mission = at_waypoint(edges, tasks, [(1, 4.0, 90.0)], here=2, behind=(0, 1))
    plan_routes([mission])
    assert mission.rest == [2, 1, GOAL]
    assert mission.graph.priority[2, 1] == mission.graph.duration[2, 1] == 0.0
    assert mission.graph.priority[1, GOAL] == 2.0


def test_a_visited_waypoint_is_not_passed_where_another_way_leads_on():
    edges = [(0, 1), (1, 2), (1, GOAL), (2, 3), (3, GOAL)]
    tasks = [(1, GOAL, 50.0, 0.0)]
    mission = at_waypoint(edges, tasks, here=2, behind=(0, 1))
    plan_routes([mission])
    assert mission.rest == [2, 3, GOAL]


def test_it_is_passed_where_the_other_way_takes_too_long():
    edges = [(0, 1), (1, 2), (1, GOAL), (2, 3), (3, GOAL)]
    slow = [(2, 3, 1.0, 4000.0)]
    mission = at_waypoint(edges, slow, here=2, behind=(0, 1), available=2500.0)
    plan_routes([mission])
    assert mission.rest == [2, 1, GOAL]


def test_no_way_at_all_is_one_line():
    mission = at_waypoint([(0, 1), (1, 2), (3, GOAL)], here=2, behind=(0, 1))
    plan_routes([mission])
    assert mission.ended
    assert mission.run.reason.startswith("no route from waypoint 2: no way through the graph")
    assert "\n" not in mission.run.reason


def test_passed_edges_alone_are_barred_where_waypoints_may_be_visited_again():
    edges = [(0, 1), (1, 2), (2, 3), (3, 1), (1, GOAL)]
    mission = at_waypoint(edges, [(3, 1, 9.0, 10.0)], here=2, behind=(0, 1), visits="edges")
    mission.graph = mission.graph.without_edges([(0, 1), (1, 2)])
    time_edges([mission])
    plan_routes([mission])
    assert mission.rest == [2, 3, 1, GOAL]


@pytest.mark.parametrize(("reserve", "expected"), [(60.0, [0, GOAL]), (0.0, [0, 1, GOAL])])
def test_no_route_uses_the_reserve(reserve, expected):
    """By way of 1 the mission ends 30 s before its time is up."""
    mission = at_waypoint(
        [(0, GOAL), (0, 1), (1, GOAL)], [(0, 1, 5.0, 70.0)], available=1500.0, reserve=reserve
    )
    assert mission.graph.leg_times(2.5)[[0, 1], [1, GOAL]].sum() == pytest.approx(1470.0)
    plan_routes([mission])
    assert mission.rest == expected


def test_the_kept_population_is_what_routes_are_planned_from(monkeypatch):
    given = []
    original = route_calls.plan_missions

    def spy(*arguments, population=None, **more):
        given.append(population)
        return original(*arguments, population=population, **more)

    monkeypatch.setattr(route_calls, "plan_missions", spy)
    mission = at_waypoint([(0, 1), (1, 2), (0, 2), (2, GOAL)], routes_from="kept")
    plan_routes([mission])
    first = np.asarray(mission.last_route.population)
    mission.cause = "late"
    plan_routes([mission])
    assert given[0] is None
    np.testing.assert_array_equal(given[1][0], first)


def test_whole_missions_under_either_rule_pass_the_independent_count():
    for settings in ({}, {"visits": "edges", "replan": "late"}):
        run = ap.run_mission(planning(**settings), key=jax.random.key(3))
        report = check_dataset(run.summary(), to_dataset(run))
        assert report.ok, report
        reached = [run.start, *(leg.goal for leg in run.done)]
        if not settings:
            assert len(reached) == len(set(reached))
        assert run.summary()["revisits"] == len(reached) - len(set(reached))
        assert run.total_priority <= run.bound + 1e-6


def test_the_papers_preset_changes_the_sea_at_windows_and_keeps_its_population():
    rules = planning(preset="paper").planning.resolved
    assert (rules.visits, rules.replan, rules.objective, rules.travel_times) == (
        "edges",
        "late",
        "eq15",
        "distance",
    )
    assert (rules.reserve, rules.return_margin, rules.window_change, rules.guard_return) == (0, 0, 0, False)
    context = loop.make_context(planning(preset="paper"), ".")
    sea = loop.start_mission(context, 0, jax.random.key(0), 0).sea
    before = np.array(sea.field.centers)
    sea.advance(10 * SMALL["current"]["update_interval"])
    np.testing.assert_array_equal(sea.field.centers, before)
    sea.begin_window()
    assert not np.array_equal(sea.field.centers, before)
