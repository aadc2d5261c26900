"""Promises: how sure a plan is to be home in time, and plans that keep back what that takes."""

import json
from dataclasses import replace
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.errors import ScenarioError
from auvplan.executive import plan_departures, plan_scenario
from auvplan.executive.loop import complete, seed_keys, settle, start_mission
from auvplan.executive.outcomes import Outcomes, Rule, latest_stops, outcomes, ruled
from auvplan.executive.planning import leaving, plan_promises, planning_context
from auvplan.executive.promise import Promised, _next
from auvplan.executive.turning import Stakes, just_keeping, keeping, rules, turned, until_when, ways_of
from auvplan.io.currents import open_members
from auvplan.io.restore import restore_run
from auvplan.io.results import save_run
from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.ocean.currents import UniformCurrent
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.path import PathConfig
from auvplan.path.outlook import Chain, Drawn, chain_times, leg_times, ruled_times
from auvplan.records import Promise, TurnBack
from auvplan.scenario.scenario import Scenario
from auvplan.vehicle import Vehicle
from auvplan.view.sheet import sheet_of
from tests.executive.small import scenario
from tests.executive.tide import CHANNEL, STREAMS, channel, channel_with, tidal_area

pytestmark = pytest.mark.usefixtures("light_search")


def mission_of(settings, area):
    """A mission before its first leg."""
    context = planning_context(settings, None, area, 0.0)
    (mission,) = leaving(context, seed_keys([0])[0], [0.0], 0)
    return mission


def planned_from(settings, area):
    """A mission before its first leg, and planned to its end."""
    mission = mission_of(settings, area)
    done = mission.fork()
    complete(done)
    return mission, done


def test_as_much_is_kept_back_as_makes_another_plan():
    """Where a plan leaves six hundredths of the time, less than that kept back gives the same plan again."""
    found = SimpleNamespace(used=np.linspace(0.9, 1.05, 101), members=np.zeros(101, int), share=0.66)
    assert 0.06 < _next([Promised(0.0, 0.06, None, found)], 0.7) < 0.07
    assert 0.004 < _next([Promised(0.0, 0.0, None, found)], 0.7) < 0.01


def with_promise(asked):
    return CHANNEL["planning"] | {"promise": asked}


def straight(*lengths, **more):
    """Legs to the north one after the other."""
    count, ends = len(lengths), np.cumsum([0.0, *lengths])
    places = np.linspace(0.0, 1.0, 9)[:, None] * [1.0, 0.0, 0.0]
    positions = np.stack(
        [first * np.eye(3)[0] + long * places for first, long in zip(ends, lengths, strict=False)]
    )
    usual = {
        "departs": np.zeros(count), "takes": np.asarray(lengths) / 2.0, "speed": np.full(count, 2.0),
        "leaves": np.full(count, -np.inf), "rises": np.zeros(count),
        "opens": np.full((count, 1), -np.inf),
        "closes": np.full((count, 1), np.inf), "task": np.zeros(count),
        "enters": np.full((count, 1), -np.inf), "until": np.full((count, 1), np.inf),
    }  # fmt: skip
    return Chain(
        positions.astype(np.float32), **{k: np.asarray(v, np.float32) for k, v in (usual | more).items()}
    )


def timed(chain, north, factors=None, delays=None):
    """Travel times and ends of legs, s, and which tasks are done, where streams to the north are drawn."""
    drawn = jnp.asarray(north, jnp.float32)
    own = UniformCurrent(drawn, 0.0 * drawn, 0.0 * drawn)
    rows = len(drawn), len(chain.task)
    factors = np.ones(rows) if factors is None else factors
    delays = np.zeros(rows) if delays is None else delays
    given = (np.asarray(part, np.float32) for part in (factors, delays))
    found = chain_times(
        chain,
        *given,
        np.float32(10.0),
        Drawn(UniformCurrent(), None, own, Vehicle(speed=2.0)),
        config=PathConfig().only(),
    )
    return [np.asarray(part, float) for part in found]


def test_a_leg_takes_its_length_over_the_ground_speed():
    streams = np.asarray([0.5, 0.0, -0.5, -1.0])
    travel, ends, _ = timed(straight(600.0, 300.0), streams)
    np.testing.assert_allclose(travel, np.asarray([600.0, 300.0]) / (2.0 + streams)[:, None], rtol=1e-4)
    np.testing.assert_allclose(ends, 10.0 + np.cumsum(travel, axis=1), rtol=1e-5)


def test_tasks_take_their_factor_and_legs_their_delay():
    chain = straight(600.0, 300.0, task=[100.0, 50.0])
    factors, delays = [[1.0, 1.0], [0.5, 2.0]], [[0.0, 0.0], [7.0, 3.0]]
    travel, ends, _ = timed(chain, [0.0, 0.0], factors, delays)
    np.testing.assert_allclose(ends[:, -1], [10.0 + 450.0 + 150.0, 10.0 + 460.0 + 150.0], rtol=1e-5)
    np.testing.assert_allclose(travel[1], [307.0, 153.0], rtol=1e-5)


def test_a_vehicle_waits_for_a_window_and_goes_on_without_a_task_that_it_missed():
    chain = straight(600.0, 300.0, task=[100.0, 0.0], opens=[[400.0], [-np.inf]], closes=[[420.0], [np.inf]])
    _, ends, done = timed(chain, [0.0, -0.8])
    assert done.tolist() == [[True, True], [False, True]]
    assert ends[0, 0] == pytest.approx(500.0, abs=0.1)  # there at 310 s
    assert ends[1, 0] == pytest.approx(10.0 + 600.0 / 1.2, abs=0.1)  # there at 510 s, too late


def test_a_leg_that_waits_for_its_path_is_not_begun_before():
    _, ends, _ = timed(straight(600.0, 300.0, leaves=[-np.inf, 450.0]), [0.0, -1.0])
    assert ends[0, 1] == pytest.approx(450.0 + 150.0, abs=0.1)
    assert ends[1, 1] == pytest.approx(610.0 + 300.0, abs=0.1)


def test_surfacings_take_their_time_whatever_becomes_of_tasks():
    """Before each leg, also where the task at the last one was missed; and beside what tasks scatter."""
    chain = straight(600.0, 300.0, rises=[40.0, 70.0], task=[100.0, 0.0], closes=[[400.0], [np.inf]])
    _, ends, _ = timed(chain, [0.0, -0.8], factors=[[2.0, 1.0]] * 2)
    np.testing.assert_allclose(ends[0], [550.0, 550.0 + 70.0 + 150.0], rtol=1e-5)
    missed = 10.0 + 40.0 + 600.0 / 1.2
    np.testing.assert_allclose(ends[1], [missed, missed + 70.0 + 300.0 / 1.2], rtol=1e-4)


def test_seas_together_are_as_each_by_itself():
    streams = np.asarray([0.4, -0.2, -0.7])
    together = timed(straight(500.0, 100.0), streams)[1]
    apart = np.concatenate([timed(straight(500.0, 100.0), [one])[1] for one in streams])
    np.testing.assert_allclose(together, apart, rtol=1e-6)


def test_without_errors_every_sea_is_the_forecast():
    mission, done = planned_from(*channel_with())
    found = outcomes(mission, done.run.done, jax.random.key(0))
    np.testing.assert_allclose(found.ends, done.run.t_mission, rtol=1e-4)
    assert found.share == 1.0


def test_a_battery_that_just_does_for_the_plan_does_in_no_sea_that_takes_longer():
    """There is time for all; with a large battery the mission is home in every member."""
    power = {"hotel": 100.0, "propulsion": {"constant": 0.0, "factor": 10.0}}
    shares, planned = [], None
    for spare in (2.0, 1.0):
        capacity = 1000.0 if planned is None else spare * planned
        vehicle = {"power": power | {"battery": {"capacity": capacity, "reserve": 0.0}}}
        settings, area = channel_with(STREAMS[1:], available=3000.0, vehicle=vehicle)
        mission, done = planned_from(settings, area)
        planned = done.run.energy.total * 1.001
        shares.append(outcomes(mission, done.run.done, jax.random.key(0)).share)
    assert shares == [1.0, 0.25]  # three of four members take longer than the forecast


def test_tasks_that_last_longer_draw_what_they_draw_meanwhile():
    """Nothing else scatters: the plan's energy, and for each second more that of a task and of station."""
    power = {"hotel": 100.0, "propulsion": {"constant": 10.0, "factor": 10.0}, "task": 500.0}
    power["battery"] = {"capacity": 100.0, "reserve": 0.0}
    settings, area = channel_with(available=9000.0, vehicle={"power": power}, mission={"duration_error": 0.4})
    north = np.full((1, 1, 2, 2), 0.1)
    steady = GriddedCurrent.from_arrays(north, 0.0 * north, origin=(-5e4, -5e4), spacing=1e5, times=[0.0])
    mission, done = planned_from(settings, replace(area, forecast=steady, truth=steady))
    legs, use = done.run.done, done.run.energy
    assert use.margin > 0.0
    ways = ways_of(mission, done.run)
    found = outcomes(mission, legs, jax.random.key(0), ways)
    longer = found.ends - done.run.t_mission
    station = 10.0 + 10.0 * 0.1**3 + 100.0
    energy = use.total + longer * (500.0 + station) / 3600.0
    np.testing.assert_allclose(found.used, energy / 100.0, rtol=1e-3)
    assert 0.05 < 1.0 - found.share < 0.95
    rule = Rule(*np.full((2, found.home.shape[1]), -1.0))
    rule.on[2:] = rule.past[3:] = np.inf
    stakes = Stakes.of(mission, done.run, ways)
    np.testing.assert_allclose(
        turned(found, rule, stakes).found.used,
        ruled(mission, legs, jax.random.key(0), ways, rule).found.used,
        rtol=2e-3,
    )


def test_a_stop_may_be_left_as_late_as_windows_and_waits_after_it_allow():
    """The second task begins from 1000 to 1400 s; the path to it takes 150 s, that after it 300 s."""
    windows = {"opens": [[-np.inf], [1000.0], [-np.inf]], "closes": [[np.inf], [1400.0], [np.inf]]}
    chain = straight(600.0, 300.0, 600.0, task=[0.0, 100.0, 0.0], **windows)
    gone, tasks = (np.asarray([row] * 2, float) for row in ([300.0, 150.0, 300.0], [0.0, 100.0, 0.0]))
    done = np.ones((2, 3), bool)
    ample = latest_stops(chain, gone, tasks, done, 9000.0)
    np.testing.assert_allclose(ample[0], [1400.0 - 150.0, 8700.0, 9000.0])
    scarce = latest_stops(chain, gone, tasks, done, 1600.0)
    np.testing.assert_allclose(scarce[0], [1600.0 - 300.0 - 100.0 - 150.0, 1300.0, 1600.0])
    done[1, 1] = False  # where it is missed anyhow it is left out
    np.testing.assert_allclose(latest_stops(chain, gone, tasks, done, 9000.0)[1, 0], 9000.0 - 450.0)


def test_members_are_followed_one_by_one():
    """Four members: one ends as planned, the others the later the more they are against the vehicle."""
    settings, area = channel_with(STREAMS[1:])
    mission, done = planned_from(settings, area)
    found = outcomes(mission, done.run.done, jax.random.key(0))
    means = [found.ends[found.members == k].mean() for k in range(len(STREAMS))]
    assert means == sorted(means)
    assert means[0] == pytest.approx(done.run.t_mission, rel=1e-3)
    speed = float(np.asarray(mission.context.vehicle.speed))
    for leg in done.run.done:  # tracks lead north for the most part
        assert leg.positions[-1][0] >= leg.positions[0][0]
    still = sum(np.linalg.norm(np.diff(leg.positions, axis=0), axis=1).sum() for leg in done.run.done) / speed
    tasks = sum(leg.t_task for leg in done.run.done)
    assert means[1] == pytest.approx(still + tasks, rel=0.02)


def followed(jobs, members, available):
    """Outcomes of the plan for jobs in still water where other members stream to the north, m/s."""
    streams = tuple(tidal_area(north, 0.0).forecast for north in members)
    area = replace(tidal_area(0.0, 0.0), jobs=jobs, members=streams)
    mission, done = planned_from(channel(mission=CHANNEL["mission"] | {"time_available": available}), area)
    ways = ways_of(mission, done.run)
    return mission, done.run, ways, outcomes(mission, done.run.done, jax.random.key(0), ways)


def test_a_line_that_is_over_after_its_window_is_missed():
    """300 m there and 300 m along it, by 400 s: at 1.5 m/s they do, at 1.0 they do not."""
    line = JobLine("line", ((300.0, 0.0, 5.0), (600.0, 0.0, 5.0)), priority=5.0, windows=((0.0, 400.0),))
    _, run, _, found = followed(Jobs((), (line,)), (-1.0, -1.5), 3000.0)
    (number,) = np.flatnonzero([leg.line is not None for leg in run.done])
    np.testing.assert_array_equal(found.done[:, number], found.members < 2)
    for member, speed in enumerate((2.5, 1.5)):
        latest = found.latest[found.members == member, number - 1]
        np.testing.assert_allclose(latest, 400.0 - 300.0 / speed, rtol=2e-3)


def test_priorities_that_fall_fall_in_drawn_seas():
    """The second task loses 7 of 8 when it begins after 300 s: it does where the first is left late."""
    point = JobPoint("b", (600.0, 0.0, 5.0), 8.0, 120.0, falls=((300.0, 1.0),))
    others = JobPoint("a", (200.0, 0.0, 5.0), 1.0, 30.0), JobPoint("c", (800.0, 0.0, 5.0), 1.0, 60.0)
    mission, run, ways, found = followed(Jobs((*others, point), ()), (-0.8,), 1000.0)
    assert run.total_priority == 10.0
    late = found.members == 1
    assert 0.2 < late.mean() < 0.8
    stakes, count = Stakes.of(mission, run, ways), len(run.done) - 2
    never = Rule(*np.full((2, count), np.inf))
    expected = 10.0 - 7.0 * late.mean()
    assert turned(found, never, stakes).priority == pytest.approx(expected)
    assert ruled(mission, run.done, jax.random.key(0), ways, never).priority == pytest.approx(expected)


def test_half_a_promise_in_a_sea_that_is_known_is_the_usual_plan_to_the_bit():
    settings, area = channel_with()
    usual = plan_scenario(settings, area=area)
    half = plan_scenario(
        channel(mission=settings.mission.model_dump(), planning=with_promise(0.5)), area=area
    )
    assert half.promise.share == 1.0
    assert half.promise.left == 0.0
    assert half.route == usual.route
    assert half.t_mission == usual.t_mission
    for one, other in zip(half.legs, usual.legs, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)
        np.testing.assert_array_equal(one.times, other.times)


@pytest.fixture(scope="module")
def plans(light_search):
    """Plans by what they were asked to promise; among tasks that scatter and four members."""
    found = {}
    for asked in (0.2, 0.7, 0.95):
        settings, area = channel_with(
            STREAMS[1:], mission={"duration_error": 0.2}, planning=with_promise(asked)
        )
        found[asked] = plan_scenario(settings, area=area)
    return found


def test_plans_keep_what_they_promise_and_pay_for_it(plans):
    worth = [run.total_priority for run in plans.values()]
    for asked, run in plans.items():
        assert run.success
        assert run.promise.kept
        assert run.promise.share >= asked
        assert run.promise.low <= run.promise.share <= run.promise.high
        assert run.promise.members == len(STREAMS)
    assert worth == sorted(worth, reverse=True)
    assert worth[0] > worth[-1]


def test_the_promise_is_saved_with_the_plan(tmp_path):
    run = plan_scenario(scenario(), seed=1)
    turns = (TurnBack(0, 310.5, 0.25, 80.0, ((0.0, 1.0, 5.0), (40.0, 2.5, 5.0)), 1),)
    run.promise = Promise(0.7, 0.82, 0.71, 0.9, 1000, 4, (700.0, 750.0, 790.5), 0.05, (310.5,), 12.5, turns)
    save_run(run, tmp_path)
    assert restore_run(tmp_path).promise == run.promise
    assert run.summary()["promise"]["share"] == 0.82


def test_the_promise_stands_on_the_sheet(plans):
    said = sheet_of(plans[0.7]).facts["promise"]
    assert said.startswith(plans[0.7].promise.line)
    assert "70 % was asked for" in said


def test_a_stop_has_to_be_left_while_the_rest_still_fits(plans):
    """As late as that at a stop, it is home in time in the share of the seas that was asked for."""
    run = plans[0.7]
    assert len(run.promise.latest) == len(run.done)
    assert list(run.promise.latest) == sorted(run.promise.latest)
    assert run.promise.latest[-1] == pytest.approx(run.t_available)
    ends = [leg.ends for leg in run.done]
    assert all(latest >= end - 1.0 for latest, end in zip(run.promise.latest, ends, strict=True))
    stops = sheet_of(run).stops
    assert [stop.latest for stop in stops[1:-1]] == list(run.promise.latest[:-1])
    assert stops[0].latest is stops[-1].latest is None


def test_what_no_plan_keeps_is_refused_with_the_surest(light_search):
    """Two thirds of the members beat the vehicle: no plan is home in them."""
    settings, area = channel_with((-2.6, -2.7), planning=with_promise(0.9))
    run = plan_scenario(settings, area=area)
    assert not run.success
    assert run.promise.share == pytest.approx(1.0 / 3.0, abs=0.01)
    assert "planning.promise 0.9 is not kept: home in time in 33." in run.reason


def test_surer_plans_are_worth_less():
    settings, area = channel_with(STREAMS[1:], mission={"duration_error": 0.2})
    runs = plan_promises(settings, area=area)
    shares, worth = [run.promise.share for run in runs], [run.total_priority for run in runs]
    assert shares == sorted(shares)
    assert worth == sorted(set(worth), reverse=True)
    assert len(runs) >= 2
    # Of plans that are alike it is the one that keeps least back.
    assert runs[0].promise.left == 0.0


def test_seas_of_few_members_say_less():
    """What is alike within members counts once; what scatters there counts for itself."""
    rng, members = np.random.default_rng(0), np.repeat(np.arange(5), 200)
    scattered, none = rng.normal(0.9, 0.1, 1000), np.zeros((3, 1000, 0))
    alike = np.linspace(0.7, 1.1, 5)[members] + 1e-6 * scattered
    wide, narrow = (
        Outcomes(used, used[:, None], used[:, None] > 0.0, used, members, *none).interval
        for used in (alike, scattered)
    )
    assert wide[1] - wide[0] > 0.5
    assert narrow[1] - narrow[0] < 0.06


def test_a_simulated_mission_keeps_back_what_the_plan_of_its_promise_does(plans):
    settings, area = channel_with(STREAMS[1:], mission={"duration_error": 0.2}, planning=with_promise(0.7))
    context = planning_context(settings, None, area, 0.0)
    mission = start_mission(context, 0, seed_keys([0])[0], 0)
    settle(mission)
    left = plans[0.7].promise.left
    assert mission.allowance == pytest.approx(left / (1.0 - left))
    again = start_mission(context, 1, seed_keys([1])[0], 1)
    settle(again)  # all missions of the channel are planned alike
    assert again.allowance == mission.allowance


def test_tasks_scatter_in_simulated_missions_and_not_in_plans(tmp_path):
    settings, area = channel_with(available=3000.0, mission={"duration_error": 0.3})
    run, plan = ap.run_mission(settings, seed=1, area=area), plan_scenario(settings, seed=1, area=area)
    stays = np.asarray([leg.t_task for leg in run.earning])
    assert [leg.t_task for leg in plan.earning] == [60.0] * len(plan.earning)
    assert (stays >= 0.0).all()
    assert stays.std() > 1.0
    save_run(run, tmp_path / "run")
    assert [line for line in check_run(tmp_path / "run").faults if "on tasks" in line] == []


def test_members_of_an_ensemble_are_taken_apart(tmp_path):
    hours = np.datetime64("2026-03-01T06", "ns") + np.arange(3) * np.timedelta64(1, "h")
    axes = {"time": hours, "latitude": 60.0 + 0.01 * np.arange(4), "longitude": 5.0 + 0.01 * np.arange(4)}
    speed, about = np.full((3, 4, 4), 0.1), {"units": "m s-1"}
    parts = [
        xr.Dataset({name: (tuple(axes), k * speed, about) for name in ("uo", "vo")}, axes) for k in range(4)
    ]
    xr.concat(parts, dim="member").to_netcdf(tmp_path / "ensemble.nc")
    found = open_members(tmp_path / "ensemble.nc")
    assert len(found) == 4
    for one, part in zip(found, parts, strict=True):
        np.testing.assert_array_equal(one["uo"], part["uo"])
    parts[0].to_netcdf(tmp_path / "one.nc")
    assert open_members(tmp_path / "one.nc") == [tmp_path / "one.nc"]
    numbered = xr.concat(parts, dim=xr.Variable("run", range(4), {"standard_name": "realization"}))
    assert len(open_members(numbered)) == 4


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"current": {"vortices": 0, "members": {"error": 0.1}}}, "source 'file' or 'harmonic' alone"),
        ({"planning": {"promise": 1.0}}, "promise"),
        ({"mission": CHANNEL["mission"] | {"duration_error": 2.0}}, "duration_error"),
    ],
)
def test_what_does_not_go_together_is_refused(sections, words):
    with pytest.raises(ValueError, match=words):
        Scenario.model_validate(CHANNEL | sections)


def test_vortices_that_change_by_windows_have_no_time_to_be_drawn_in():
    planning = with_promise(0.5) | {"preset": "paper"}
    del planning["effort"]
    with pytest.raises(ScenarioError, match="current_updates 'interval'"):
        plan_scenario(channel(planning=planning))


def test_departures_are_compared_by_plans_that_keep_the_promise():
    settings, area = channel_with(STREAMS[1:], planning=with_promise(0.7))
    key, departs = jax.random.key(3), (0.0, 600.0)
    found = plan_departures(settings, departs, key=key, area=area)
    for number, depart in enumerate(departs):
        run = plan_scenario(settings, key=key, depart=depart, area=area)
        assert run.promise.kept
        assert found.priority[number] == run.total_priority
        assert found.time[number] == pytest.approx(run.t_mission)
        assert found.routes[number] == run.route


def drawn(stops, home, past=None, available=100.0):
    """Outcomes of a plan whose stops [D, L] s are left at those times, and its ways [D, K] s."""
    stops, home = np.asarray(stops, float), np.asarray(home, float)
    past = np.full(home.shape, np.inf) if past is None else np.asarray(past, float)
    members = np.zeros(len(stops), int)
    common = stops[:, -1], stops, stops > 0.0, stops[:, -1] / available, members
    return Outcomes(*common, np.zeros((len(stops), 0)), past, home)


def stakes(*priorities, past=(0.0, 0.0), available=100.0):
    return Stakes(np.asarray(priorities, float), np.asarray(past, float), 0.0, available)


def test_late_vehicles_leave_out_what_the_rule_says():
    """Of four one goes on, one goes home at once, one past a task, and one goes home from the second stop."""
    stops = [[20, 50, 80, 95], [40, 70, 105, 130], [28, 65, 100, 120], [20, 65, 100, 120]]
    found = drawn(stops, [[30, 25]] * 4, [[50, np.inf]] * 4)
    rule = Rule(np.asarray([25.0, 60.0]), np.asarray([30.0, 60.0]))
    won = stakes(1.0, 2.0, 4.0, 0.0, past=(4.0, 0.0))
    goes = turned(found, rule, won)
    assert goes.kind.tolist() == [[0, 0], [2, -1], [1, -1], [0, 2]]
    assert goes.found.ends.tolist() == [95.0, 70.0, 28.0 + 50.0 + 20.0, 90.0]
    assert goes.found.in_time.tolist() == [True] * 4
    assert goes.priority == pytest.approx((7.0 + 1.0 + 5.0 + 3.0) / 4.0)
    found.done[0, 1] = False  # its window was missed
    assert turned(found, rule, won).priority == pytest.approx((5.0 + 1.0 + 5.0 + 3.0) / 4.0)
    assert found.in_time.tolist() == [True, False, False, False]


def by_chance(seed, seas=300):
    """A plan of five legs, and its ways from three stops, all of which scatter."""
    rng = np.random.default_rng(seed)
    legs = rng.uniform(5.0, 30.0, 5) * rng.uniform(0.5, 2.0, (seas, 5))
    home, past = (rng.uniform(5.0, 30.0, 3) * rng.uniform(0.5, 2.0, (seas, 3)) for _ in range(2))
    past[:, 2] = np.inf
    priorities = rng.uniform(1.0, 5.0, 5)
    priorities[-1] = 0.0
    won = Stakes(priorities, np.asarray([*priorities[2:4], 0.0]), 0.0, 100.0)
    return drawn(np.cumsum(legs, axis=1), home, past), won


@pytest.mark.parametrize("seed", range(6))
def test_the_more_it_costs_to_be_late_the_surer_the_vehicle_is_home(seed):
    found, won = by_chance(seed)
    never, *made = rules(found, won)
    assert np.isinf(never).all()
    alone = turned(found, never, won)
    assert (alone.found.ends == found.ends).all()
    assert alone.priority == pytest.approx(won.priorities.sum())
    shares = [turned(found, rule, won).found.share for rule in made]
    assert all(later >= sooner - 0.05 for sooner, later in pairwise(shares))
    assert shares[-1] >= max(alone.found.share, np.mean(found.stops[:, 0] + found.home[:, 0] <= 100.0) - 0.05)
    for rule in made:
        assert (rule.on <= rule.past).all()


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.5, 0.8, 0.95]))
def test_a_rule_is_made_as_early_as_its_promise_needs(seed, asked):
    found, won = by_chance(seed)
    rule = rules(found, won)[4]
    kept = just_keeping(rule, asked, won, lambda rule: turned(found, rule, won))
    moved = np.isfinite(rule.past)
    earlier = rule.past[moved] - kept.rule.past[moved]
    if kept.found.share < asked:
        assert not len(earlier) or earlier == pytest.approx(50.0)  # all that is tried
    elif len(earlier):
        assert np.ptp(earlier) < 1e-9
        later = turned(found, kept.rule.earlier(-60.0 / 2.0**12), won)  # as near as it is looked for
        assert later.found.share < asked or earlier[0] < -10.0 + 0.1


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000))
def test_a_rule_that_only_goes_past_tasks_is_made_earlier_too(seed):
    found, won = by_chance(seed)
    follow = partial(turned, found, stakes=won)
    for rule in rules(replace(found, home=np.full(found.home.shape, np.inf)), won)[1:]:
        assert not np.isfinite(rule.past).any()
        for made, most in ((just_keeping, 50.0), (keeping, 20.0)):
            sure = follow(rule.earlier(most)).found.share
            if follow(rule).found.share < sure:
                assert made(rule, sure, won, follow).found.share >= sure


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_until_when_is_as_by_trying_all(seed):
    rng = np.random.default_rng(seed)
    times, worths = rng.uniform(0.0, 50.0, 6), rng.normal(size=(3, 6))
    order = np.argsort(times)
    most = max(
        worths[0, order[:n]].sum() + worths[1, order[n:m]].sum() + worths[2, order[m:]].sum()
        for m in range(7)
        for n in range(m + 1)
    )
    on, past = until_when(times, *worths)
    assert on <= past
    kind = (times > on).astype(int) + (times > past)
    assert worths[kind, np.arange(6)].sum() == pytest.approx(most)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000))
def test_what_cannot_be_done_is_in_no_rule(seed):
    """Also in seas in which a stop is left only after the time is over."""
    found, won = by_chance(seed)
    late = replace(found, stops=found.stops + 40.0 * (np.arange(300) % 7 == 0)[:, None])
    for rule in rules(late, won):
        assert rule.on[2] == rule.past[2]  # there is no way past the last task
    ended = replace(late, home=np.full(late.home.shape, np.inf))
    for rule in rules(ended, won):
        assert np.isinf(rule.past).all()


def test_nothing_is_left_out_where_there_is_no_other_way():
    stops = [[10, 20, 40, 60, 120], [12, 24, 48, 70, 130]]
    found = drawn(stops, [[np.inf] * 3] * 2)
    for rule in rules(found, stakes(1.0, 1.0, 1.0, 1.0, 0.0, past=(0.0, 0.0, 0.0))):
        assert np.isinf(rule.on).all()


def test_a_rule_is_followed_leg_by_leg():
    """Streams to the north; what is compared with goes on, past a task or home by hand."""
    chains = [
        straight(600.0, 300.0, 400.0, 200.0, task=[20.0, 30.0, 40.0, 0.0]),
        straight(600.0, 650.0, 500.0, 200.0, task=[20.0, 40.0, 0.0, 0.0]),
        straight(600.0, 250.0, 350.0, 200.0),
    ]
    latest = np.asarray([[np.inf] * 2, [360.0, 520.0], [470.0, 470.0], [np.inf] * 2], np.float32)
    streams = np.asarray([0.3, 0.0, -0.4, -1.0, -1.2])
    rng = np.random.default_rng(0)
    factors, late = rng.uniform(0.5, 1.5, (2, 3, 5, 4))
    late *= 10.0
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *chains)
    own = UniformCurrent(*(jnp.asarray(part, jnp.float32) for part in (streams, 0 * streams, 0 * streams)))
    given = (np.asarray(part, np.float32) for part in (factors, late))
    seas = Drawn(UniformCurrent(), None, own, Vehicle(speed=2.0))
    found = ruled_times(stacked, latest, *given, np.float32(10.0), seas, config=PathConfig().only())
    kinds, _, ends, _ = (np.asarray(part, float) for part in found)
    for sea, stream in enumerate(streams):
        time, leg, expected = 10.0, 0, np.full(4, -1)
        while leg < 4:
            kind = int(time > latest[leg, 0]) + int(time > latest[leg, 1])
            chain, expected[leg] = chains[kind], kind
            length = 2.0 * float(chain.takes[leg])
            time += length / (2.0 + stream) + late[kind, sea, leg]
            time += factors[kind, sea, leg] * float(chain.task[leg])
            leg += (1, 2, 4)[kind]
        assert kinds[sea].tolist() == expected.tolist()
        assert ends[sea, -1] == pytest.approx(time, rel=1e-4)
    assert {0, 1, 2} <= set(kinds.ravel().tolist())


def test_a_rule_that_leaves_nothing_out_is_the_plan():
    """In time and energy; one that leaves all out after the first stop is its leg and the way from there."""
    power = {"hotel": 100.0, "propulsion": {"constant": 0.0, "factor": 10.0}}
    vehicle = {"power": power | {"battery": {"capacity": 60.0, "reserve": 0.0}}}
    settings, area = channel_with(STREAMS[1:], available=3000.0, vehicle=vehicle)
    mission, done = planned_from(settings, area)
    legs, key = done.run.done, jax.random.key(0)
    ways = ways_of(mission, done.run)
    plain, count = outcomes(mission, legs, key, ways), len(legs) - 2
    never = Rule(*np.full((2, count), np.inf))
    alone = ruled(mission, legs, key, ways, never)
    np.testing.assert_allclose(alone.found.ends, plain.ends, rtol=1e-6)
    np.testing.assert_allclose(alone.found.used, plain.used, rtol=1e-5)
    assert (plain.used > plain.ends / 3000.0).any(), "energy is the scarcer"
    assert alone.priority == pytest.approx(sum(leg.priority for leg in legs))
    home = ruled(mission, legs, key, ways, Rule(*np.full((2, count), -1.0)))
    np.testing.assert_allclose(home.found.ends, plain.stops[:, 0] + plain.home[:, 0], rtol=1e-6)
    assert (home.kind[:, 0] == 2).all()
    assert (home.found.used < plain.used).all()


@pytest.fixture(scope="module")
def turning(light_search):
    """The plan of the highest promise in the channel, with a rule."""
    settings, area = channel_with(
        STREAMS[1:], mission={"duration_error": 0.2}, planning=with_promise(0.95) | {"turn_back": True}
    )
    return plan_scenario(settings, area=area), area


def test_a_plan_that_turns_back_does_more_and_keeps_its_promise(plans, turning):
    run, _ = turning
    assert run.success
    assert run.promise.share >= 0.95
    assert run.promise.turns
    assert plans[0.95].total_priority - 0.1 <= run.promise.priority < run.total_priority
    for turn in run.promise.turns:
        stop = run.done[turn.leg]
        goal = run.goal if turn.past is None else run.done[turn.past].goal
        np.testing.assert_allclose(turn.positions[0], run.graph.positions[stop.goal], atol=0.1)
        np.testing.assert_allclose(turn.positions[-1], run.graph.positions[goal], atol=0.1)
        assert run.promise.latest[turn.leg] <= turn.latest < run.t_available
        assert 0.0 <= turn.share <= 1.0


def test_rules_stand_on_the_sheet_and_in_files(turning):
    run, _ = turning
    sheet = sheet_of(run)
    assert "what is late is left out" in sheet.facts["promise"]
    for turn in run.promise.turns:
        places = [name for name, _, _ in sheet.stops[turn.leg + 1].otherwise]
        assert ("goal" if turn.past is None else run.place(run.done[turn.past].goal)) in places
    assert "otherwise" in sheet.table()[0]
    json.dumps(sheet.plain(), allow_nan=False)


def test_a_way_home_is_followed_as_a_leg_is():
    """From the moment at which it is begun, in every drawn sea."""
    streams = jnp.asarray([0.5, 0.0, -1.0], jnp.float32)
    own, chain = UniformCurrent(streams, 0.0 * streams, 0.0 * streams), straight(600.0, 300.0)
    seas = Drawn(UniformCurrent(), None, own, Vehicle(speed=2.0))
    leaves = np.full((3, 2), 10.0, np.float32)
    travel = leg_times(chain, leaves, seas, config=PathConfig().only())
    np.testing.assert_allclose(travel, timed(chain, streams)[0], rtol=1e-5)


def test_no_promise_is_made_for_a_saw_tooth():
    glider = {"saw_tooth": {"glide_angle": 26, "deep": 30}}
    with pytest.raises(ValueError, match=r"planning\.promise does not follow a saw-tooth's dives: keep time"):
        channel(mission=CHANNEL["mission"], planning=with_promise(0.9), vehicle=glider)


def test_no_rule_is_made_where_the_position_grows_uncertain():
    vehicle = {"navigation": {"drift": 0.01}}
    settings, area = channel_with(planning=with_promise(0.9) | {"turn_back": True}, vehicle=vehicle)
    with pytest.raises(ScenarioError, match=r"planning.turn_back.*vehicle.navigation"):
        plan_scenario(settings, area=area)
