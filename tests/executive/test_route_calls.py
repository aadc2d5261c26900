"""What the mission planner is given: travel times of the sea or of the distance, refused edges, late legs."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import auvplan as ap
from auvplan.check.run import check_dataset
from auvplan.executive import context as contexts
from auvplan.executive import legs, loop
from auvplan.executive.route_calls import effort, time_edges
from auvplan.io.results import to_dataset
from auvplan.mission import time_to_go
from tests.executive.small import POWER, SMALL, light_config, light_routes, planning, scenario
from tests.executive.tide import channel_with

pytestmark = pytest.mark.usefixtures("light_search")


def start_mission(settings: ap.Scenario):
    context = loop.make_context(settings, ".")
    return loop.start_mission(context, 0, jax.random.key(3), 3)


def whole_time(leg) -> float:
    return leg.t_path + leg.t_task


@pytest.fixture(scope="module")
def paper(light_search):
    """A mission timed and re-planned as the paper has it."""
    return ap.run_mission(planning(travel_times="distance", replan="late"), key=jax.random.key(1))


def test_times_by_distance_are_those_of_equation_13(paper):
    expected = paper.graph.leg_times(paper.vehicle.speed)
    for leg in paper.legs:
        learnt = [other for other in paper.legs if not other.arrived]
        if (leg.start, leg.goal) not in [(other.start, other.goal) for other in learnt]:
            assert leg.t_expected == pytest.approx(expected[leg.start, leg.goal])
    assert paper.estimate_seconds == 0.0


def test_by_the_papers_rule_every_late_leg_causes_a_new_route(paper):
    """A leg that took longer than expected is followed by a new route from where it ended (3.3.2)."""
    seen = 0
    for leg in paper.done[:-1]:
        at_end = pytest.approx(leg.times[-1] + leg.t_task, abs=0.1)
        new = [o for o in paper.routes if o.nodes[0] == leg.goal and o.made_at == at_end]
        if whole_time(leg) > leg.t_expected:
            assert new[0].cause == "late"
            seen += 1
        else:
            assert not new
    assert seen > 0


@pytest.mark.slow
@pytest.mark.parametrize("task_time", ["whole", "clock", "expected"])
def test_what_the_time_of_a_task_counts_in(task_time, monkeypatch):
    """Beside t_ij: in the leg's time and what is compared, in its time alone, or in neither (Fig. 15)."""
    light = {"path_config": light_config(planning()), "mission_configs": light_routes(planning())}
    for name, config in light.items():
        monkeypatch.setattr(contexts, name, lambda *_, config=config: config)
    rules = {"preset": "paper", "task_time": task_time, "routes_from": "fresh", "window_change": 0.01}
    run = ap.run_mission(planning(**rules), key=jax.random.key(1))
    assert len(run.done) > 2
    expected = run.graph.leg_times(run.vehicle.speed)
    for leg in run.done:
        assert leg.t_expected == pytest.approx(expected[leg.start, leg.goal])
        takes = 0.0 if task_time == "expected" else float(run.graph.duration[leg.start, leg.goal])
        assert leg.t_task in (0.0, pytest.approx(takes))  # none is done twice
    assert run.t_mission == pytest.approx(sum(whole_time(leg) for leg in run.done), abs=0.1)
    late = [leg for leg in run.done[:-1] if leg.t_path + (task_time == "whole") * leg.t_task > leg.t_expected]
    to_go = time_to_go(expected, run.goal)  # where no route is in time, the one in hand is gone on with
    late = [leg for leg in late if leg.ends + to_go[leg.goal] < run.t_available]
    assert [route.nodes[0] for route in run.routes if route.cause == "late"] == [leg.goal for leg in late]
    report = check_dataset(run.summary(), to_dataset(run))
    assert report.ok, report


def test_times_learnt_under_way_are_as_much_longer_as_the_legs_were(paper):
    mission = start_mission(planning(travel_times="learnt"))
    time_edges([mission])
    still = mission.graph.leg_times(mission.context.speed)
    np.testing.assert_allclose(mission.timed.leg_times(mission.context.speed), still)
    ends = [tuple(map(int, edge)) for edge in np.argwhere(mission.graph.adjacency)[:2]]
    straight = [still[edge] - mission.graph.duration[edge] for edge in ends]
    mission.run.legs = [
        replace(leg, start=i, goal=j, times=np.array([0.0, longer * seconds]))
        for leg, (i, j), longer, seconds in zip(paper.done, ends, (1.2, 1.4), straight, strict=False)
    ]
    time_edges([mission])
    share = (1.2 * straight[0] + 1.4 * straight[1]) / sum(straight)
    travel = mission.timed.leg_times(mission.context.speed) - mission.graph.duration
    np.testing.assert_allclose(travel[ends[0]], share * straight[0])


def test_the_preset_of_the_paper_times_by_distance():
    mission = start_mission(planning(preset="paper"))
    time_edges([mission])
    assert np.isnan(mission.timed.travel_time).all()


def test_times_of_the_sea_follow_from_what_is_told_of_the_current():
    exact = SMALL["current"] | {"forecast_error": 0.0}
    mission = start_mission(scenario(current=exact))
    time_edges([mission])
    context = mission.context
    area = context.scenario.area
    env = ap.Environment(mission.sea.field, None, None, area.lower, area.upper)
    known = mission.graph.with_travel_times(env, context.vehicle, 0.0, effort(context.path_config))
    allowance = context.scenario.planning.detour * context.scenario.simulation.obstacles.total
    np.testing.assert_allclose(mission.timed.travel_time, known.travel_time + allowance, rtol=1e-4)
    assert mission.run.estimate_seconds > 0.0


def test_without_obstacles_no_detour_is_allowed_for():
    calm = scenario(
        simulation={"obstacles": {"static": 0, "afloat": 0, "self_motivated": 0}},
        current={"vortices": 0, "layers": 1},
    )
    mission = start_mission(calm)
    time_edges([mission])
    graph = mission.graph
    np.testing.assert_allclose(mission.timed.leg_times(2.5), graph.leg_times(2.5), rtol=1e-4)


@pytest.mark.parametrize("kind", ["sea", "distance"])
def test_a_refused_edge_keeps_the_time_of_its_path(kind):
    mission = start_mission(planning(travel_times=kind))
    i, j = (int(node) for node in np.argwhere(mission.graph.adjacency)[0])
    mission.learnt[i, j] = 9000.0
    for now in (0.0, 700.0):
        mission.now = now
        time_edges([mission])
        assert mission.timed.travel_time[i, j] == 9000.0


@pytest.mark.parametrize("clock", [False, True])
@pytest.mark.parametrize("power", [None, POWER])
def test_an_edge_barred_for_good_does_not_come_back(clock, power):
    settings, area = channel_with(planning={"departures": 3}) if clock else (scenario(), None)
    context = loop.make_context(settings.with_({"vehicle.power": power}), ".", area)
    assert context.by_clock == clock
    mission = loop.start_mission(context, 0, jax.random.key(3), 3)
    barred = 0, int(np.argmax(mission.graph.adjacency[0]))
    for cause in ("start", "refused", ""):
        mission.cause = cause
        time_edges([mission])
        assert mission.timed.adjacency[barred] == (cause == "start")
        assert not (mission.timed.adjacency & ~mission.graph.adjacency).any()
        mission.graph = mission.graph.without_edges([barred])


def test_the_rest_of_a_route_is_kept_while_it_fits():
    """Without a reason no leg is followed by a new route, and reasons are as booked."""
    run = ap.run_mission(planning(return_margin=0.0, gain=5000.0, tolerance=5000.0), key=jax.random.key(2))
    assert run.routes[0].cause == "start"
    assert {route.cause for route in run.routes[1:]} <= {"refused"}


def test_planners_are_told_the_current_of_the_moment(monkeypatch):
    """At the start of a leg, after the task, all updates of the current that are due have been made."""
    seen = []
    original = legs.plan_legs

    def spy(missions, cause, cold=False, growing=True):
        seen.extend((mission.now, mission.sea.updates) for mission in missions if cause == "leg")
        return original(missions, cause, cold, growing)

    monkeypatch.setattr(legs, "plan_legs", spy)
    settings = scenario(mission=SMALL["mission"] | {"duration": [600, 900]})
    ap.run_mission(settings, key=jax.random.key(4))
    assert len(seen) > 2
    for now, updates in seen:
        assert updates == now // settings.current.update_interval


def test_no_leg_is_refused_for_a_margin_that_its_route_did_without():
    """Nothing fits with a way back twenty times as long: the route is made without, and executed."""
    run = ap.run_mission(planning(return_margin=20.0), key=jax.random.key(1))
    assert run.success
    assert "refused" not in [route.cause for route in run.routes]
