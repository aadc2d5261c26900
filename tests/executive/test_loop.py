"""What the loop decides, in closed form: nothing is searched for and nothing moves."""

from contextlib import nullcontext
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from auvplan.executive import loop, mission_configs, path_config
from auvplan.mission import MissionConfig, Timetable
from auvplan.path import PathConfig
from auvplan.records import LegRecord
from auvplan.runtime.compiled import MISSIONS
from auvplan.scenario.area import OperatingArea
from auvplan.simulation.faults import CurrentStep, FaultySea, HeldUp, PlannerOut, TakenOver
from tests.executive.small import SMALL, planning, scenario
from tests.executive.test_visits import GOAL, at_waypoint

pytestmark = pytest.mark.usefixtures("light_search")

#: m/s; ways between waypoints are 500 m times the difference of their numbers.
SPEED = 2.5

#: Goes by waypoint 1, where a task takes 60 s: 200 s there, 1,200 s on.
EDGES, TASKS = [(0, 1), (1, GOAL)], [(1, 4.0, 60.0)]


@pytest.fixture
def called(monkeypatch):
    """Calls of the planners and the simulator by name, in order; none of them does anything."""
    calls = []
    for name in ("plan_routes", "advance", "go_as_planned", "finish"):
        monkeypatch.setattr(loop, name, lambda *given, name=name: calls.append((name, *given)))

    def begin_legs(missions, records):
        calls.append(("begin_legs", missions, records))
        for mission, record in zip(missions, records, strict=True):
            mission.leg = leg_of(record)

    monkeypatch.setattr(loop, "begin_legs", begin_legs)
    return calls


def on_route(edges=EDGES, tasks=TASKS, nodes=(0, 1, GOAL), now=0.0, slack=0.0, margin=0.0, **settings):
    """A mission at the first waypoint of a route, for which no other is due."""
    mission = at_waypoint(edges, waypoint_tasks=tasks, **settings)
    mission.route = SimpleNamespace(nodes=np.array(nodes), return_margin=margin)
    mission.now, mission.slack, mission.cause = now, slack, ""
    return mission


def leg_of(record, travel_time=200.0, broken=(), stopped="", under_way=True):
    """A stand-in for a leg that is planned."""
    plan = SimpleNamespace(travel_time=travel_time, broken=lambda: broken, explain=lambda *_: "is on land")
    belief = SimpleNamespace(certain=True)
    return SimpleNamespace(
        record=record,
        followed=plan,
        belief=belief,
        stopped=stopped,
        under_way=under_way,
        stays=False,
    )


def steady(graph, **windows):
    """The graph with travel times by the clock that are the same at all times."""
    travel = graph.leg_times(SPEED) - graph.duration
    return graph.with_timetable(Timetable(np.zeros(1), travel[None], **windows))


RULES = {"tolerance": 30.0, "allowance": 0.1, "gain": 100.0, "reserve": 300.0}


@pytest.mark.parametrize("by_clock", [False, True])
@pytest.mark.parametrize(
    ("slack", "before", "cause"),
    [
        (-29.8, 0.0, ""),
        (-30.2, 0.0, "late"),
        (-29.8, 50.0, ""),
        (-30.2, 50.0, "late"),
        (-129.8, -100.0, ""),  # less was left when the route was made
        (-130.2, -100.0, "late"),
        (245.8, 0.0, ""),  # of 1,460 s a tenth is allowed for surprises
        (246.2, 0.0, "early"),
    ],
)
def test_a_route_is_planned_anew_where_its_slack_leaves_the_limits(called, by_clock, slack, before, cause):
    """At 2,000 s the rest of the route takes 1,460 s."""
    mission = on_route(now=2000.0, slack=before, available=2000.0 + 1460.0 + 300.0 + slack, **RULES)
    if by_clock:
        mission.graph = steady(mission.graph)
    loop.step([mission])
    assert mission.cause == cause
    (planned,) = [call[1] for call in called if call[0] == "plan_routes"]
    assert planned == ([mission] if cause else [])


@pytest.mark.parametrize(("slack", "cause"), [(-29.8, ""), (-30.2, "late")])
def test_a_route_waits_for_its_ways_to_open(called, slack, cause):
    """At 2,000 s the vehicle sets out, at 2,260 s its task is done; the way on opens at 3,000 s."""
    mission = on_route(now=2000.0, available=3000.0 + 1200.0 + 300.0 + slack, **RULES)
    travel = np.full((5, 8, 8), np.inf)
    travel[:, 0, 1], travel[3:, 1, GOAL] = 200.0, 1200.0
    mission.graph = mission.graph.with_timetable(Timetable(np.linspace(0.0, 4000.0, 5), travel))
    loop.step([mission])
    assert mission.cause == cause


def test_by_other_rules_no_route_is_planned_anew_for_its_slack(called):
    mission = on_route(available=500.0, replan="late", guard_return=False, **RULES)
    loop.step([mission])
    assert mission.cause == ""
    mission = on_route(available=500.0, guard_return=False, **RULES)
    mission.cause = "refused"
    loop.step([mission])
    assert mission.cause == "refused"


def test_the_clock_goes_on_while_the_planner_is_out(called):
    mission = on_route(available=5000.0)
    mission.faults.given.extend([PlannerOut(0.0, 70.0), HeldUp(0.0, 400.0)])
    loop.step([mission])
    assert mission.now == mission.run.charged_compute == 70.0


def test_legs_are_begun_with_what_is_expected_of_them(called):
    for visited in (set(), {0, 1}):
        mission = on_route(available=5000.0, now=400.0)
        mission.visited = visited
        loop.step([mission])
        ((_, missions, (record,)),) = [call for call in called if call[0] == "begin_legs"]
        assert missions == [mission]
        assert (record.start, record.goal) == (0, 1)
        assert (record.t_expected, record.t_task, record.priority) == pytest.approx((260.0, 60.0, 4.0))
        assert record.revisit == bool(visited)
        assert (record.t_hold, mission.now) == (0.0, 400.0)
        called.clear()


@pytest.fixture
def begins(monkeypatch, called):
    """Legs that are planned get a path that breaks limits, or one that takes so many s."""

    def set_to(**leg):
        def begin(missions, records):
            for mission, record in zip(missions, records, strict=True):
                mission.leg = leg_of(record, **leg)

        monkeypatch.setattr(loop, "begin_legs", begin)

    return set_to


@pytest.mark.parametrize("broken", [(), ("land",)])
def test_a_vehicle_waits_for_its_way_only_where_the_leg_is_begun(begins, broken):
    """The way opens at 3,000 s; from then it takes 600 s, and a task 50 s."""
    travel = np.full((5, 8, 8), np.inf)
    travel[3:, 0, GOAL] = 600.0
    mission = on_route(
        [(0, GOAL), (0, 1)], [(GOAL, 1.0, 50.0)], (0, GOAL), 2000.0, available=9000.0, gain=1e6
    )
    mission.graph = mission.graph.with_timetable(Timetable(np.linspace(0.0, 4000.0, 5), travel))
    begins(broken=broken)
    loop.step([mission])
    (record,) = mission.run.legs
    assert record.t_expected == pytest.approx(650.0)
    if broken:
        assert (mission.now, record.t_hold, mission.leg) == (2000.0, 0.0, None)
        assert mission.cause == "refused"
    else:
        assert (mission.now, record.t_hold) == pytest.approx((3000.0, 1000.0))
        assert mission.leg.record is record


def test_where_nothing_says_that_a_leg_can_be_done_the_least_is_expected(begins):
    """The way is shut at all times to come."""
    travel = np.full((5, 8, 8), np.inf)
    travel[0, 0, GOAL] = 600.0
    mission = on_route([(0, GOAL)], [], (0, GOAL), 2000.0, available=9000.0, gain=1e6)
    mission.graph = mission.graph.with_timetable(Timetable(np.linspace(0.0, 4000.0, 5), travel))
    begins()
    loop.step([mission])
    (record,) = mission.run.legs
    assert record.t_expected == pytest.approx(600.0)
    assert (record.t_hold, mission.now) == (0.0, 2000.0)


@pytest.mark.parametrize(
    ("available", "changes", "why"),
    [
        (2762.0, {}, "too little for the way back"),
        (2763.0, {}, ""),
        (2000.0, {"goal": 1}, ""),  # it leads to the destination
        (2000.0, {"refusals": loop._REFUSALS}, ""),
        (2000.0, {"refusals": loop._REFUSALS - 1}, "762 s too little for the way back"),
        (2000.0, {"guard": False}, ""),
        (2000.0, {"edges": [(0, 1), (0, GOAL)]}, ""),  # none leads on: there may be a path yet
        # It is 4,200 s by a slow edge, and 1,600 s back over the start, where that may be visited again.
        (3300.0, {"slow": 3000.0}, "too little for the way back"),
        (3300.0, {"slow": 3000.0, "visits": "edges"}, ""),
    ],
)
def test_a_leg_leaves_time_for_the_way_back(available, changes, why):
    """At 300 s a path takes 862.5 s, its task 100 s, the way back 1,200 s and a quarter more."""
    edges = changes.get("edges", [(0, 1), (1, GOAL), (0, GOAL)])
    rules = {"guard_return": changes.get("guard", True), "visits": changes.get("visits", "once")}
    slow = [(1, GOAL, 1.0, changes["slow"])] if "slow" in changes else []
    mission = on_route(edges, [], now=300.0, margin=0.25, available=available, edge_tasks=slow, **rules)
    mission.refusals = changes.get("refusals", 0)
    mission.run.goal = changes.get("goal", GOAL)
    mission.leg = leg_of(LegRecord(0, 1, 200.0, 100.0, 1.0), travel_time=862.5)
    found = loop.why_refused(mission, mission.timed.leg_times(SPEED))
    assert why in found
    assert bool(why) == bool(found)


def test_an_edge_whose_path_breaks_a_limit_is_barred(begins):
    mission = on_route([*EDGES, (0, 2), (2, GOAL)], available=5000.0, gain=1e6)
    begins(broken=("land",))
    loop.step([mission])
    assert mission.barred == {(0, 1), (1, 0)}
    assert not mission.graph.adjacency[0, 1]
    assert mission.graph.adjacency[0, 2]
    assert (mission.learnt, mission.refusals, mission.cause) == ({}, 1, "refused")
    assert mission.obstruction == "leg 0 to 1, is on land"
    assert not mission.ended


def test_an_edge_whose_path_takes_too_long_is_remembered_with_its_time(begins):
    mission = on_route(available=3000.0, gain=1e6, tolerance=1e6)
    begins(travel_time=2000.0)
    loop.step([mission])
    assert mission.learnt == {(0, 1): 2000.0}
    assert mission.graph.adjacency[0, 1]
    assert (mission.barred, mission.cause) == (set(), "refused")
    assert "too little for the way back" in mission.obstruction


@pytest.mark.parametrize(
    ("refusals", "edges", "visited", "ends"),
    [
        (0, [(0, 1), (1, GOAL)], set(), True),  # no other way leads on
        (0, [(0, 1), (1, GOAL)], {0}, True),
        (0, [(0, 1), (1, GOAL)], {0, 3}, False),  # one that was visited may be passed
        (0, [(0, 1), (0, 2), (1, GOAL)], set(), False),
        (loop._REFUSALS - 1, [(0, 1), (0, 2), (1, GOAL)], set(), False),
        (loop._REFUSALS, [(0, 1), (0, 2), (1, GOAL)], set(), True),
    ],
)
def test_a_mission_ends_where_refusals_leave_no_way(begins, refusals, edges, visited, ends):
    mission = on_route(edges, available=5000.0, gain=1e6)
    mission.refusals, mission.visited = refusals, visited
    begins(broken=("land",))
    loop.step([mission])
    assert mission.ended is ends
    assert not ends or mission.run.reason == "leg 0 to 1 cannot be executed: is on land"


def after_leg(
    called, goal=1, nodes=(0, 1, GOAL), cpu=0.0, arrives=1000.0, windows=None, leg=None, **settings
):
    """A mission after a leg from 0 that ended at a time, with a task of 60 s that is worth 4."""
    record = {"t_task": 60.0, "priority": 4.0} | (leg or {})
    mission = on_route(nodes=nodes, now=arrives, available=5000.0, **settings)
    if windows is not None:
        mission.graph = steady(mission.graph, **windows)
    given = LegRecord(
        0, goal, 300.0, record["t_task"], record["priority"], arrived=record.get("arrived", True)
    )
    given.times, given.positions = np.array([700.0, 800.0, arrives]), np.zeros((3, 3))
    given.plans = [SimpleNamespace(cpu=cpu)]
    mission.leg = leg_of(given, stopped="the current beat the vehicle", under_way=False)
    mission.refusals = 3
    mission.sea = SimpleNamespace() if "sea" not in record else record["sea"]
    loop.step([mission])
    return mission, given


def test_after_a_leg_the_vehicle_is_where_it_ended_and_its_task_is_done(called):
    mission, record = after_leg(called, visits="once", edges=[*EDGES, (1, 2)])
    assert [name for name, *_ in called if name in ("advance", "finish")] == ["advance", "finish"]
    assert (mission.now, mission.here, mission.step) == (1060.0, 1, 1)
    assert (mission.leg, mission.refusals, mission.visited) == (None, 0, {0, 1})
    assert not mission.graph.adjacency[0].any()
    assert mission.graph.adjacency[2, 1]
    assert mission.graph.priority[2, 1] == 0.0
    assert (mission.cause, mission.ended) == ("", False)
    assert (record.t_wait, record.missed, record.priority) == (0.0, False, 4.0)


def test_where_waypoints_may_be_visited_again_only_the_edge_is_gone(called):
    mission, _ = after_leg(called, visits="edges", edges=[*EDGES, (0, 2), (1, 2)])
    assert not mission.graph.adjacency[0, 1]
    assert mission.graph.adjacency[0, 2]
    assert mission.graph.adjacency[2, 1]
    assert mission.graph.priority[2, 1] == 0.0


def test_at_the_destination_a_mission_ends_and_where_a_leg_is_given_up_it_fails(called):
    mission, _ = after_leg(called, GOAL, (0, GOAL), edges=[(0, GOAL)], tasks=[])
    assert mission.ended
    assert mission.run.reason == "destination reached in time"
    mission, _ = after_leg(called, leg={"arrived": False})
    assert mission.ended
    assert mission.run.reason == "leg 0 to 1 was not finished: the current beat the vehicle"
    assert mission.now == 1000.0


@pytest.mark.parametrize(
    ("replan", "taken", "cause"),
    [("late", 239.5, ""), ("late", 240.5, "late"), ("deviation", 240.5, "")],
)
def test_by_the_papers_rule_a_leg_that_took_longer_than_expected_causes_a_route(called, replan, taken, cause):
    """Of 300 s expected the task takes 60 s."""
    mission, _ = after_leg(called, arrives=700.0 + taken, replan=replan)
    assert mission.cause == cause


@pytest.mark.parametrize("charge", [False, True])
def test_planning_takes_time_where_it_is_charged(called, charge):
    mission, _ = after_leg(called, cpu=7.0, charge_compute=charge)
    assert mission.now == 1060.0 + (7.0 if charge else 0.0)
    assert mission.run.charged_compute == (7.0 if charge else 0.0)


def windows(opens, closes, enters=-np.inf, until=np.inf, falls=np.inf, drops=0.0):
    """The same windows on all edges."""
    names = ("opens", "closes", "enters", "until", "falls", "drops")
    values = (opens, closes, enters, until, falls, drops)
    return {name: np.full((8, 8, 1), value) for name, value in zip(names, values, strict=True)}


@pytest.mark.parametrize(
    ("hours", "leg", "wait", "missed", "worth"),
    [
        (windows(1100.0, 2000.0), {}, 100.0, False, 4.0),
        (windows(0.0, 999.0), {}, 0.0, True, 0.0),
        (windows(1100.0, 2000.0, falls=1050.0, drops=1.5), {}, 100.0, False, 2.5),
        (windows(0.0, 2000.0, falls=1050.0, drops=1.5), {}, 0.0, False, 4.0),
        # The edge is entered at 700 s, its task done at 1,060 s.
        (windows(0.0, 2000.0, enters=699.0, until=1061.0), {}, 0.0, False, 4.0),
        (windows(0.0, 2000.0, enters=750.0, until=1061.0), {}, 0.0, True, 0.0),
        (windows(0.0, 2000.0, enters=699.0, until=1059.0), {}, 0.0, True, 0.0),
        # Nothing is waited for where there is nothing to do.
        (windows(1100.0, 2000.0), {"priority": 0.0, "t_task": 0.0}, 0.0, False, 0.0),
        (windows(1100.0, 2000.0), {"priority": 0.0}, 100.0, False, 0.0),
        (windows(1100.0, 2000.0), {"t_task": 0.0}, 100.0, False, 4.0),
    ],
)
def test_a_task_is_done_in_its_window_or_not_at_all(called, hours, leg, wait, missed, worth):
    mission, record = after_leg(called, windows=hours, leg=leg)
    assert (record.t_wait, record.missed, record.priority) == (wait, missed, worth)
    task = 0.0 if missed else leg.get("t_task", 60.0)
    assert record.t_task == task
    assert mission.now == 1000.0 + wait + task


def test_the_forecast_is_compared_with_a_sea_of_a_model(called, monkeypatch):
    class Model(SimpleNamespace):
        def difference(self, positions, times):
            return positions.shape, times.shape

        def along(self, positions, times, mean):
            return positions.shape, times.shape, mean

    monkeypatch.setattr(loop, "ModelSea", Model)
    record = after_leg(called, leg={"sea": Model()})[1]
    assert record.current_difference == ((3, 3), (3,))
    assert record.current == ((3, 3), (3,), False)
    record = after_leg(called)[1]
    assert np.isnan(record.current_difference)
    assert record.current is None


@pytest.mark.parametrize("simulated", [True, False])
def test_under_way_a_leg_goes_on_and_nothing_is_judged(called, simulated):
    mission = on_route(available=5000.0)
    mission.context.simulated = simulated
    mission.leg = leg_of(LegRecord(0, 1, 300.0, 60.0, 4.0))
    loop.step([mission])
    gone = {call[0]: call[1] for call in called}
    assert gone.get("advance", []) == ([mission] if simulated else [])
    assert gone["go_as_planned"] == ([] if simulated else [mission])
    assert mission.leg is not None


@pytest.fixture
def crew(monkeypatch):
    """Missions that end after three steps each; who was under way at every step, and what was made ready."""
    seen = SimpleNamespace(steps=[], warmed=[], occasions=[])

    def start_mission(context, number, key, seed):
        run, own = SimpleNamespace(number=number), {"ended": False, "now": 0.0, "doing": "transit"}
        return SimpleNamespace(context=context, number=number, key=key, seed=seed, run=run, **own)

    def step(active):
        seen.steps.append([mission.number for mission in active])
        for mission in active:
            mission.now += 10.0
            mission.ended = mission.now >= 30.0

    def expecting(*given):
        seen.occasions.append(given)
        return nullcontext()

    made = {"start_mission": start_mission, "step": step, "expecting": expecting}
    made["warm_up"] = lambda context, start: seen.warmed.append(start(context))
    for name, function in made.items():
        monkeypatch.setattr(loop, name, function)
    return seen


def test_missions_advance_together_and_the_next_one_takes_the_place_of_one_that_ends(crew):
    told, settings, area = [], scenario(), OperatingArea()
    common = {"folder": "here", "area": area, "progress": lambda *said: told.append(said)}
    found = list(loop.execute_missions(settings, seeds=[7, 8, 9], together=2, **common))
    assert [number for number, _ in found] == [run.number for _, run in found] == [0, 1, 2]
    assert all(run.compile_seconds == 0.0 for _, run in found)
    assert crew.steps == [[0, 1]] * 3 + [[2]] * 3
    assert told[:3] == [(0, 10.0, "transit"), (1, 10.0, "transit"), (0, 20.0, "transit")]
    assert len(told) == 6
    assert crew.occasions == [(MISSIONS, settings.fingerprint)]
    assert [(mission.number, mission.seed) for mission in crew.warmed] == [(0, 7), (1, 8), (2, 9)]
    (context,) = {id(mission.context): mission.context for mission in crew.warmed}.values()
    assert (context.scenario, context.folder, context.area) == (settings, "here", area)


def test_missions_have_keys_or_seeds_or_both(crew):
    keys, faults = jax.random.split(jax.random.key(2), 2), [[HeldUp(0.0, 5.0)], []]
    list(loop.execute_missions(scenario(), keys=keys, faults=faults))
    assert [mission.seed for mission in crew.warmed] == [0, 1]
    assert all((mission.key == key).all() for mission, key in zip(crew.warmed, keys, strict=True))
    assert crew.warmed[0].context.faults is faults
    list(loop.execute_missions(scenario(), keys=keys, seeds=[4, 5]))
    assert [mission.seed for mission in crew.warmed[2:]] == [4, 5]
    for seed, key in ((3, None), (None, keys[0]), (4, keys[0])):
        loop.run_mission(scenario(), key=key, seed=seed)
        assert crew.warmed[-1].seed == (seed or 0)
        assert (crew.warmed[-1].key == (loop.seed_keys([3])[0] if key is None else key)).all()


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({}, ValueError, "missions need keys or seeds"),
        ({"keys": 2, "seeds": [4, 5, 6]}, ValueError, "keys and seeds must be as many, got 2 and 3"),
        ({"keys": [1.5, 2.5]}, TypeError, "keys"),
        ({"seeds": [2**32]}, ValueError, "a seed is a whole number from 0 to 4294967295, got 4294967296$"),
        ({"seeds": [0, 10**20]}, ValueError, "from 0 to 4294967295, got 100000000000000000000$"),
        ({"seeds": [-1]}, ValueError, "from 0 to 4294967295, got -1$"),
        ({"seeds": [0, 1], "faults": [[]]}, ValueError, "a list for each of 2 missions, got 1"),
        (
            {"seeds": [0], "faults": [[TakenOver(10.0)]]},
            ValueError,
            r"SimulatedVehicle\(scenario, seed, faults",
        ),
    ],
)
def test_what_missions_are_not_made_from(given, error, words):
    if given.get("keys") == 2:
        given = given | {"keys": jax.random.split(jax.random.key(2), 2)}
    with pytest.raises(error, match=words):
        list(loop.execute_missions(scenario(), **given))
    with pytest.raises(ValueError, match="a mission needs a key or a seed"):
        loop.run_mission(scenario())


def test_settings_of_the_searches_are_those_of_preset_and_effort():
    for preset in ("paper", "default"):
        readings = planning(preset=preset, control_points=6, path_width=0.2, phi=(2.0, 30.0))
        config = path_config(readings)
        assert (config.control_points, config.width) == (6, 0.2)
        assert [(one.phi1, one.phi2) for one in mission_configs(readings)] == [(2.0, 30.0)] * 2
    assert path_config(planning(preset="paper")).bbo == PathConfig.paper().bbo
    for effort, finer in (("quick", PathConfig().finer), ("full", PathConfig().finer), ("plain", 1)):
        assert path_config(planning(effort=effort)).finer == 1, "under way there is no finer search"
        assert path_config(planning(effort=effort), ahead=True).finer == finer
    assert path_config(planning(effort="plain")).bbo == PathConfig.plain().bbo
    first, later = mission_configs(planning(preset="paper"))
    assert first == later == MissionConfig.paper().replace(objective=first.objective)
    plain, full = (one.replace(objective="priority") for one in (MissionConfig.plain(), MissionConfig()))
    quick = full.replace(beam_width=full.quicker().beam_width)
    alone = SMALL["mission"] | {"waypoints": 2}
    jobs = {"jobs": "a.csv", "start": [9, 9, 5], "goal": [99, 99, 5]}
    for settings, first in (
        (scenario(mission=alone, planning={}), plain.replace(beam_width=plain.quicker().beam_width)),
        (scenario(mission=alone | jobs, planning={}), quick),
        (scenario(planning={}), quick),
        (planning(effort="plain"), plain),
        (planning(effort="full"), full),
    ):
        assert mission_configs(settings)[0] == first
    assert mission_configs(planning(effort="full")) == (full, full)


def test_a_mission_begins_at_the_first_waypoint_and_ends_at_the_last():
    context = loop.make_context(scenario(), "somewhere", OperatingArea())
    mission = loop.start_mission(context, 0, jax.random.key(0), 5)
    assert (mission.run.start, mission.run.goal, mission.run.seed) == (0, mission.graph.size - 1, 5)
    assert context.folder == "somewhere"
    assert loop.make_context(scenario()).folder == scenario().folder
    context.faults = [[], [HeldUp(3.0, 5.0), CurrentStep(0.0, (0.25, 0.0))]]
    assert not isinstance(loop.start_mission(context, 0, jax.random.key(0), 5).sea, FaultySea)
    faulty = loop.start_mission(context, 1, jax.random.key(0), 5)
    assert isinstance(faulty.sea, FaultySea)
    assert faulty.faults.given == context.faults[1]
    velocities = [np.stack(start.sea.field(500.0, 500.0, 5.0, 0.0)) for start in (mission, faulty)]
    assert velocities[1] - velocities[0] == pytest.approx([0.25, 0.0, 0.0], abs=1e-6)
