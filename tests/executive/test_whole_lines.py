"""Survey lines that are executed whole or not at all."""

from dataclasses import replace

import numpy as np
import pytest

from auvplan.check.run import check_run
from auvplan.executive import plan_scenario
from auvplan.executive.context import make_context
from auvplan.executive.loop import seed_keys, start_mission
from auvplan.executive.route_calls import plan_routes, time_edges
from auvplan.io.restore import restore_run
from auvplan.io.results import save_run
from auvplan.mission.jobs import JobLine, JobPoint, Jobs, edges_off_lines
from auvplan.runtime import prng
from auvplan.scenario.area import OperatingArea
from auvplan.view.sheet import sheet_of
from tests.executive.small import POWER, SMALL, scenario
from tests.executive.tide import tidal_area

pytestmark = pytest.mark.usefixtures("light_search")

#: Its first part is near the way from start to goal, its second one leads far away.
LINE = JobLine("line", ((1000.0, 1000.0, 5.0), (2000.0, 1000.0, 5.0), (2000.0, 3500.0, 5.0)), 4.0)
JOBS = Jobs((JobPoint("buoy", (2500.0, 200.0, 5.0), 1.0, 10.0),), (LINE,))


def settings(lines, seconds):
    mission = {
        "start": [200, 200, 5],
        "goal": [3800, 200, 5],
        "time_available": seconds,
        "lines": lines,
    }
    return scenario(mission=mission, current=SMALL["current"] | {"vortices": 0})


@pytest.mark.parametrize(
    ("lines", "seconds", "priority"),
    [
        ("whole", 2500.0, 1.0),
        pytest.param("part", 2500.0, 1.0 + 4.0 / 3.5, marks=pytest.mark.slow),
        pytest.param("whole", 4000.0, 5.0, marks=pytest.mark.slow),
    ],
)
def test_a_line_is_begun_only_where_all_of_it_fits(lines, seconds, priority):
    run = plan_scenario(settings(lines, seconds), area=OperatingArea(jobs=JOBS))
    assert run.success
    assert run.total_priority == pytest.approx(priority)


@pytest.mark.slow
def test_points_called_as_vertices_of_lines_are_tasks_of_their_own(tmp_path):
    points = [JobPoint(f"line[{k}]", (900.0 * k, 300.0, 5.0), 1.0, 10.0) for k in (1, 2, 3)]
    points.append(JobPoint("(via 1)", (3600.0, 300.0, 5.0), 1.0, 10.0))
    run = plan_scenario(settings("whole", 5000.0), area=OperatingArea(jobs=Jobs(tuple(points), (LINE,))))
    assert run.tasks == 5
    save_run(run, tmp_path)
    assert check_run(tmp_path).ok, check_run(tmp_path)
    again = restore_run(tmp_path)
    assert (again.tasks, sheet_of(again).left_out) == (5, ())


def test_a_line_that_cannot_be_finished_is_left():
    context = make_context(settings("whole", 2500.0), None, OperatingArea(jobs=JOBS))
    mission = start_mission(context, 0, prng.single(seed_keys([0]))[0], 0)
    names = mission.run.names
    start, first, middle, last = (names.index(name) for name in ("start", "line[1]", "line[2]", "line[3]"))
    off = edges_off_lines(JOBS, np.asarray(mission.run.graph.adjacency))
    assert off
    assert not any(mission.graph.adjacency[edge] for edge in off)
    mission.here, mission.visited = middle, {start, first, middle}
    mission.graph = mission.graph.without_waypoints([start, first])
    mission.now, mission.cause = 1000.0, "late"
    plan_routes([mission])
    assert not mission.ended
    assert last not in mission.rest
    assert mission.rest[-1] == mission.run.goal


@pytest.fixture(params=["still", "by the clock, with power"])
def start(request):
    """What a mission begins with: in still water, or in a stream from files with a model of its power."""
    if request.param == "still":
        return settings("whole", 5000.0), OperatingArea(jobs=JOBS)
    return settings("whole", 5000.0).with_({"vehicle.power": POWER}), replace(tidal_area(0.0, 0.0), jobs=JOBS)


def test_ways_off_a_line_stay_shut_and_a_line_is_offered_once(start):
    mission = start_mission(make_context(start[0], None, start[1]), 0, prng.single(seed_keys([0]))[0], 0)
    names, mission.cause = mission.run.names, "start"
    time_edges([mission])
    off = edges_off_lines(JOBS, np.asarray(mission.run.graph.adjacency))
    assert off
    assert not any(mission.timed.adjacency[edge] for edge in off)
    plan_routes([mission])
    assert mission.run.routes[0].priority == pytest.approx(5.0)
    begin, first, middle, last = (names.index(name) for name in ("start", "line[1]", "line[2]", "line[3]"))
    end = max((first, last), key=mission.rest.index)
    mission.here, mission.step, mission.visited = end, mission.rest.index(end), {begin, first, middle, last}
    mission.graph = mission.graph.without_waypoints({begin, first, middle, last} - {end})
    mission.now, mission.cause = 2000.0, "late"
    time_edges([mission])
    plan_routes([mission])
    assert mission.run.routes[-1].cause == "late"
    assert mission.run.routes[-1].priority <= 1.0, "the buoy alone is left"


def test_a_line_of_two_parts_is_planned_with_one_start():
    def begun(joules):
        power = POWER | {"task_start": joules}
        context = make_context(
            settings("part", 5000.0).with_({"vehicle.power": power}), None, OperatingArea(jobs=JOBS)
        )
        mission = start_mission(context, 0, prng.single(seed_keys([0]))[0], 0)
        time_edges([mission])
        return mission

    def starts(mission, names):
        nodes = [mission.run.names.index(name) for name in names]
        assert mission.timed.options is not None
        return mission.timed.options.fixed[nodes[:-1], nodes[1:]].sum()

    none, some = begun(0.0), begun(1000.0)
    forth = "line[1]", "line[2]", "line[3]"
    for route, count in (
        (("start", *forth, "buoy", "goal"), 2),
        (("start", "buoy", *forth[::-1], "goal"), 2),
        (("start", *forth[1:], "goal"), 1),
        (("start", "line[2]", "line[1]", "buoy", "line[3]", "line[2]"), 3),
    ):
        assert starts(some, route) - starts(none, route) == pytest.approx(1000.0 * count)
    for mission in (none, some):
        mission.here = mission.run.names.index("line[1]")
        time_edges([mission])
    assert starts(some, forth) - starts(none, forth) == pytest.approx(1000.0), "it has not begun"
