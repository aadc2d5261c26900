"""Rules of the loop by themselves: when routes are re-planned, legs refused, and which searches serve."""

from types import SimpleNamespace

import numpy as np
import pytest

import auvplan as ap
from auvplan.executive import loop, mission_configs, path_config
from auvplan.executive.route_calls import plan_routes, time_edges
from auvplan.mission import MissionConfig, Timetable
from tests.executive.small import SMALL, planning, scenario
from tests.executive.test_visits import GOAL, at_waypoint, refused


def test_between_two_waypoints_the_plain_search_serves():
    two, many = (scenario(mission=SMALL["mission"] | {"waypoints": count}) for count in (2, 8))
    plain, full = (
        config.replace(objective="priority") for config in (MissionConfig.plain(), MissionConfig())
    )
    quicker = full.quicker().beam_width
    assert mission_configs(two)[0] == plain.replace(beam_width=plain.quicker().beam_width)
    assert mission_configs(many)[0] == full.replace(beam_width=quicker)
    assert mission_configs(planning(effort="plain"))[0] == plain
    assert mission_configs(planning(effort="full")) == (full, full)


@pytest.mark.parametrize("effort", ["quick", "full", "plain"])
def test_legs_under_way_are_planned_without_a_finer_search(effort):
    assert path_config(planning(effort=effort)).finer == 1
    before_departure = path_config(planning(effort=effort), ahead=True)
    assert before_departure.finer == (1 if effort == "plain" else ap.PathConfig().finer)


def test_faults_are_a_list_for_each_mission():
    with pytest.raises(ValueError, match="faults must be a list for each of 2 missions, got 1"):
        ap.run_missions(scenario(), seeds=[0, 1], faults=[[]])


def on_the_way(monkeypatch, edges, available, now=0.0, fault=(), timetable=None, **settings):
    """A mission after a step whose leg, a stand-in, breaks limits; nothing moves."""

    def begin_legs(context, missions, records):
        plan = SimpleNamespace(travel_time=200.0, broken=lambda: fault, explain=lambda *_: "is on land")
        for mission, record in zip(missions, records, strict=True):
            belief = SimpleNamespace(certain=True)
            mission.leg = SimpleNamespace(
                record=record, followed=plan, belief=belief, under_way=True, stays=False
            )

    monkeypatch.setattr(loop, "begin_legs", begin_legs)
    monkeypatch.setattr(loop, "advance", lambda context, missions: None)
    context, mission = at_waypoint(edges, available=available, **settings)
    mission.now = now
    if timetable is not None:
        mission.graph = mission.graph.with_timetable(timetable)
        time_edges(context, [mission])
    plan_routes(context, [mission])
    loop.step(context, [mission])
    return mission


@pytest.mark.parametrize(("available", "cause"), [(5000.0, ["start", "early"]), (4080.0, ["start"])])
@pytest.mark.usefixtures("light_search")
def test_a_route_is_planned_anew_where_time_is_left_over(monkeypatch, available, cause):
    """At 2,000 s the rest takes 1,400 s, half of which is allowed for surprises."""
    rules = {"allowance": 0.5, "gain": 100.0, "tolerance": 1e4, "reserve": 0.0}
    mission = on_the_way(monkeypatch, [(0, GOAL)], available, 2000.0, **rules)
    assert mission.rest == [0, GOAL]
    assert [route.cause for route in mission.run.routes] == cause


@pytest.mark.usefixtures("light_search")
def test_a_refused_leg_ends_a_mission_only_where_no_other_way_leads_on(monkeypatch):
    one = on_the_way(monkeypatch, [(0, GOAL)], 5000.0, fault=("land",))
    assert one.ended
    assert "cannot be executed: is on land" in one.run.reason
    other = on_the_way(monkeypatch, [(0, GOAL), (0, 1), (1, GOAL)], 5000.0, fault=("land",))
    assert not other.ended
    assert other.cause == "refused"


@pytest.mark.parametrize(("visits", "why"), [("once", "too little for the way back"), ("edges", "")])
@pytest.mark.usefixtures("light_search")
def test_the_way_back_leads_over_the_start_only_where_it_may_be_visited_again(visits, why):
    """From 1 it is 4,200 s by the slow edge, 1,600 s back over 0."""
    found = refused(690.0, slow=3000.0, available=2500.0, visits=visits)
    assert why in found
    assert bool(why) == bool(found)


@pytest.mark.usefixtures("light_search")
def test_a_vehicle_waits_for_its_way_to_open(monkeypatch):
    """At 2,000 s the way is closed until 3,000 s; it takes 600 s then."""
    travel = np.full((5, 8, 8), np.inf)
    travel[3:, 0, GOAL] = 600.0
    timetable = Timetable(np.linspace(0.0, 4000.0, 5), travel)
    mission = on_the_way(monkeypatch, [(0, GOAL)], 5000.0, 2000.0, timetable=timetable)
    assert mission.active_leg.record.t_hold == pytest.approx(1000.0)
    assert mission.active_leg.record.t_expected == pytest.approx(600.0)
    assert mission.now == pytest.approx(3000.0)
