"""Plans of vehicles that dead-reckon: how well they know where they are, where they surface, what is said."""

import json
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

import jax
import numpy as np
import pytest
import shapely

from auvplan.check.run import check_dataset, check_run
from auvplan.errors import ScenarioError
from auvplan.executive import plan_departures, plan_scenario, run_mission
from auvplan.executive.loop import seed_keys
from auvplan.executive.outcomes import outcomes
from auvplan.executive.planning import complete, leaving, planning_context
from auvplan.export import itinerary_of
from auvplan.export.imc import imc_text
from auvplan.export.qgroundcontrol import qgc_notes
from auvplan.io.restore import restore_run
from auvplan.io.results import save_run, to_dataset
from auvplan.link.imc import as_message
from auvplan.link.rolling import RollingPlan
from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.ocean.closures import Zone
from auvplan.ocean.seabed import Seabed
from auvplan.path.risk import exposed
from auvplan.records import MissionRun
from auvplan.scenario.scenario import Scenario
from auvplan.view.sheet import sheet_of
from benchmarks.alterations import POSITIONS, altered, possible
from tests.executive.small import scenario
from tests.executive.tide import CHANNEL, channel, tidal_area

pytestmark = pytest.mark.usefixtures("light_search")

KNOWN = {"drift": 0.02, "current_error": 0.02, "fix": 3.0, "fix_time": 45.0}
#: m/s, of a vehicle of 2.5 m/s in still water along its way.
GROWTH = float(np.hypot(0.02 * 2.5, 0.02))


def sea(navigation: object = KNOWN, **sections) -> Scenario:
    """Open water without a current."""
    return channel(
        vehicle={} if navigation is None else {"navigation": navigation},
        area={"lower": [-500, -1500, 0], "upper": [2500, 1500, 40]},
        mission=CHANNEL["mission"] | {"goal": [2000, 0, 20], "start": [0, 0, 20], "time_available": 4000},
        **sections,
    )


def jobs(limit: float | None = None) -> Jobs:
    """Two tasks on the way, the second with a limit on the error."""
    return Jobs((
        JobPoint("first", (700.0, 0.0, 20.0), 3.0, 60.0),
        JobPoint("second", (1400.0, 0.0, 20.0), 3.0, 60.0, max_error=limit),
    ))  # fmt: skip


@cache
def planned(limit: float | None = None, forbidden: bool = False, known: bool = True) -> MissionRun:
    zones = (Zone("lane", shapely.box(600.0, -100.0, 800.0, 100.0)),) if forbidden else ()
    area = replace(tidal_area(0.0, 0.0), jobs=jobs(limit), no_surfacing=zones)
    return plan_scenario(sea(KNOWN if known else None), area=area, seed=1)


def test_the_error_grows_from_leg_to_leg_by_the_closed_form():
    run = planned()
    assert [run.called(leg.goal) for leg in run.done] == ["first", "second", "goal"]
    assert all(leg.t_fix is None for leg in run.done)
    for leg in run.done:
        passed = float(leg.times[-1])  # tasks count as under way
        assert leg.position_std == pytest.approx(np.hypot(3.0, GROWTH * passed), rel=1e-3)
        assert leg.risk == 0.0
    assert run.summary()["risk"] == 0.0


SPEEDS = {
    "vehicle.power": {"hotel": 30, "propulsion": {"constant": 5, "factor": 20}},
    "vehicle.speed_range": [0.8, 2.5],
    "mission.time_available": 5000.0,
}


def test_stays_count_at_the_speed_of_the_vehicle_and_legs_at_their_own():
    first, second = jobs().points
    late = Jobs((replace(first, windows=((2500.0, 3000.0),)), second))
    run = plan_scenario(sea().with_(SPEEDS), area=replace(tidal_area(0.0, 0.0), jobs=late), seed=1)
    assert run.tasks == 2
    assert max(leg.t_wait for leg in run.done) > 500.0
    way = 0.0
    for leg in run.done:
        way += leg.speed * leg.t_path
        expected = np.hypot(3.0, np.hypot(0.02 * way, 0.02 * leg.times[-1]))
        assert leg.position_std == pytest.approx(expected, rel=1e-3)
        way += 2.5 * (leg.t_wait + leg.t_task)
    assert {leg.speed for leg in run.done} != {2.5}
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


def test_fixes_are_planned_by_the_speeds_of_legs():
    """At 1 m/s the way to the second task takes 1,400 s, within which the error grows to 40 m."""
    settings = sea().with_(SPEEDS | {"vehicle.speed_range": [1.0, 2.5]})
    run = plan_scenario(settings, area=replace(tidal_area(0.0, 0.0), jobs=jobs(60.0)), seed=1)
    (leg,) = (leg for leg in run.done if run.called(leg.goal) == "second")
    assert leg.speed < 1.3
    assert (leg.t_fix, run.tasks) == (None, 2)
    assert leg.position_std < 60.0


def test_it_surfaces_where_a_task_asks_for_it():
    run = planned(25.0)
    first, second, home = run.done
    up = down = 20.0 / (2.5 * 0.5)  # s, at 30 degrees
    assert (first.t_fix, home.t_fix) == (None, None)
    assert second.t_fix == second.t_hold == pytest.approx(up + 45.0 + down, rel=1e-5)
    assert second.times[0] == pytest.approx(first.ends + second.t_fix, abs=0.01)
    assert second.position_std == pytest.approx(np.hypot(3.0, GROWTH * (down + second.t_path)), rel=1e-3)
    assert second.position_std < 25.0 < planned().done[1].position_std
    assert home.position_std > second.position_std
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


def powered(dive: float) -> MissionRun:
    """The second task needs a fix; the vehicle has a battery."""
    power = {"hotel": 30, "propulsion": {"constant": 5, "factor": 4}, "dive": dive, "climb": 0.6 * dive}
    vehicle = {"navigation": KNOWN, "power": power | {"battery": {"capacity": 900}}}
    asked = sea().with_({f"vehicle.{name}": value for name, value in vehicle.items()})
    return plan_scenario(asked, area=replace(tidal_area(0.0, 0.0), jobs=jobs(25.0)), seed=1)


def test_the_way_up_and_down_takes_energy_in_the_plan_and_in_the_choice_of_tasks():
    run, plain = powered(500.0), powered(0.0)
    assert [leg.t_fix is not None for leg in run.done] == [False, True, False]
    assert run.energy is not None
    assert plain.energy is not None
    up = down = 20.0 / (2.5 * 0.5)
    terms = run.energy.totals
    assert terms["dive"] == pytest.approx(500.0 * 20.0 / 3600.0, rel=1e-3)
    assert terms["climb"] == pytest.approx(300.0 * 20.0 / 3600.0, rel=1e-3)
    under_way = sum(leg.t_path for leg in run.done) + up + down
    moving, still = 5.0 + 4.0 * 2.5**3, 5.0
    joules = moving * under_way + still * (run.t_mission - under_way)
    assert terms["propulsion"] == pytest.approx(joules / 3600.0, rel=1e-4)
    # Routes are charged with the share of a surfacing that the leg to the second task uses up.
    share = run.done[1].t_path * GROWTH / np.sqrt(25.0**2 - 3.0**2)
    fixed = (500.0 + 300.0) * 20.0
    charged = np.subtract(run.routes[0].energies, plain.routes[0].energies)
    np.testing.assert_allclose(charged, [0.0, share * fixed, 0.0], rtol=1e-2, atol=1.0)
    whole = fixed + moving * (up + down) + still * 45.0
    bare = moving * run.done[1].t_path + 30.0 * (run.done[1].t_path + share * (up + 45.0 + down))
    task = 60.0 * (30.0 + still)
    assert run.routes[0].energies[1] == pytest.approx(bare + task + share * whole, rel=1e-3)


def test_a_fix_may_take_no_time():
    run = plan_scenario(
        sea(KNOWN | {"fix_time": 0.0}), area=replace(tidal_area(0.0, 0.0), jobs=jobs(25.0)), seed=1
    )
    (fix,) = (leg.t_fix for leg in run.done if leg.t_fix is not None)
    assert fix == pytest.approx(2.0 * 20.0 / (2.5 * 0.5), rel=1e-5)
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


def test_the_checker_finds_energy_of_surfacing_that_is_left_out():
    run = powered(500.0)
    assert check_dataset(run.summary(), to_dataset(run)).faults == []
    held = replace(run, legs=[replace(leg, t_fix=None) for leg in run.legs])
    summary = run.summary() | {"energy": held.summary()["energy"]}
    faults = check_dataset(summary, to_dataset(run)).faults
    assert [fault.split()[0] for fault in faults if "time and track make it" in fault] == [
        "propulsion", "dive", "climb",
    ]  # fmt: skip


def test_a_limit_on_one_task_goes_with_a_window_of_another():
    first, second = jobs(25.0).points
    timed = Jobs((replace(first, windows=((600.0, 1200.0),)), second))
    run = plan_scenario(sea(), area=replace(tidal_area(0.0, 0.0), jobs=timed), seed=1)
    assert (run.success, run.tasks) == (True, 2)
    (met,) = (leg for leg in run.done if run.called(leg.goal) == "second")
    assert met.position_std < 25.0


def test_a_task_that_cannot_be_met_is_left_out_and_why_is_said():
    run = planned(25.0, forbidden=True)
    assert "second" not in [run.called(leg.goal) for leg in run.done]
    assert all(leg.t_fix is None for leg in run.done if run.called(leg.start) == "first")
    refused = [leg.refused for leg in run.legs if leg.refused]
    assert any("25 m are asked for" in why for why in refused)
    strict = planned(1.0)  # less than a fix has
    assert any("1 m are asked for" in leg.refused for leg in strict.legs)


@pytest.mark.parametrize("kind", POSITIONS)
def test_the_checker_works_out_what_is_said_of_positions(kind):
    summary, dataset = planned(25.0).summary(), to_dataset(planned(25.0))
    assert possible(kind, dataset)
    for draw in range(3):
        assert check_dataset(*altered(kind, summary, dataset, np.random.default_rng(draw))).faults


def test_the_checker_looks_at_what_is_asked_for_and_what_the_vehicle_is():
    run = planned(25.0)
    summary, dataset = run.summary(), to_dataset(run)

    def faults(change):
        altered = dataset.copy()
        settings = json.loads(dataset.attrs["scenario"])
        change(settings["vehicle"]["navigation"])
        altered.attrs = dataset.attrs | {"scenario": json.dumps(settings)}
        return check_dataset(summary, altered).faults

    assert faults(dict) == []
    found = faults(lambda known: known.update(most=15.0))
    assert len(found) == sum(leg.position_std > 15.0 for leg in run.done) > 0
    assert all("15 m are asked for" in fault for fault in found)
    assert any("drift is 0.02" in fault for fault in faults(lambda known: known.update(drift=0.01)))
    assert any("surfaces for" in fault for fault in faults(lambda known: known.update(fix_time=60.0)))


def test_the_checker_knows_of_bottom_lock():
    """The bed slopes: from about 800 m north on it is out of reach."""
    depth = np.broadcast_to(np.linspace(20.0, 120.0, 101)[:, None], (101, 101)) + 20.0
    bed = Seabed.from_depth(depth, 40.0, (-1000.0, -2000.0))
    area = replace(tidal_area(0.0, 0.0), jobs=jobs(), seabed=bed)
    run = plan_scenario(sea(KNOWN | {"drift": 0.0, "bottom_lock": 65.0}), area=area, seed=1)
    stds = [leg.position_std for leg in run.done]
    assert stds[0] == pytest.approx(3.0)
    assert 3.1 < stds[1] < stds[2] < np.hypot(3.0, 0.02 * run.t_mission)
    summary, dataset = run.summary(), to_dataset(run)
    assert check_dataset(summary, dataset).faults == []
    assert check_dataset(summary, dataset.assign(seabed_depth=dataset["seabed_depth"] + 100.0)).faults


def test_sheet_and_summary_say_it():
    run = planned(25.0)
    sheet = sheet_of(run)
    stops = {stop.name: stop for stop in sheet.stops}
    assert stops["first"].done == "done, surfaces for a fix"
    assert stops["first"].wait == 0.0
    assert stops["first"].fix == run.done[1].t_fix
    assert "surfaces once for a fix" in sheet.facts["position"]
    headings, rows = sheet.table()
    column = [row[headings.index("position, m")] for row in rows]
    assert column == ["", *(f"{leg.position_std:.0f}" for leg in run.done)]
    assert "risk" in headings
    figures = run.summary()["legs"][1]
    assert {figures["t_fix"], figures["position_std"]} == {run.done[1].t_fix, run.done[1].position_std}


def test_an_imc_vehicle_pops_up_and_a_plan_says_that_it_does_not():
    run = planned(25.0)
    itinerary = itinerary_of(run)
    root = ElementTree.fromstring(imc_text(itinerary))
    steps = {step.findtext("maneuver_id"): step.find("data")[0] for step in root.iter("PlanManeuver")}
    assert [name for name in steps if name.startswith(("task", "fix"))] == ["task1", "fix1", "task2"]
    assert steps["task1"].findtext("duration") == "60"
    rise = steps["fix1"]
    assert (rise.tag, rise.findtext("duration"), rise.findtext("z")) == ("PopUp", "45", "20.0000")
    assert rise.findtext("flags") == "WAIT_AT_SURFACE|STATION_KEEP"
    assert rise.findtext("lat") == steps["task1"].findtext("lat")
    assert any("planned to surface for a fix, at first" in note for note in qgc_notes(itinerary))
    imcpy = pytest.importorskip("imcpy")
    message = as_message(rise)
    assert message.flags == int(imcpy.PopUp.FlagsBits.WAIT_AT_SURFACE) | 4
    assert (message.duration, message.z, message.radius) == (45, 20.0, 10.0)


def test_nothing_of_it_is_said_of_a_vehicle_that_knows_where_it_is():
    run = planned(25.0, known=False)
    assert run.summary().keys() & {"risk"} == set()
    assert not any(leg.keys() & {"risk", "position_std", "t_fix"} for leg in run.summary()["legs"])
    names = {"leg_position_std", "leg_risk", "leg_t_fix"}
    assert not names & set(to_dataset(run).variables)
    assert "position" not in sheet_of(run).facts
    assert not {"risk", "position_std", "fix"} & set(sheet_of(run).plain()["stops"][1])


def test_waypoints_at_the_surface_are_fixes():
    area = replace(tidal_area(0.0, 0.0), jobs=Jobs((JobPoint("buoy", (1000.0, 0.0, 0.0), 3.0, 60.0),)))
    run = plan_scenario(sea(), area=area, seed=1)
    buoy, home = run.done
    assert buoy.position_std == pytest.approx(np.hypot(3.0, GROWTH * buoy.t_path), rel=1e-3)
    assert home.position_std == pytest.approx(np.hypot(3.0, GROWTH * home.t_path), rel=1e-3)
    assert home.t_fix is None
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


def test_survey_lines_and_departures_have_it():
    line = JobLine("line", ((500.0, -200.0, 20.0), (900.0, -200.0, 20.0)), 5.0)
    area = replace(tidal_area(0.0, 0.0), jobs=Jobs((), (line,)))
    run = plan_scenario(sea(), area=area, seed=1)
    (surveyed,) = (leg for leg in run.done if leg.line is not None)
    assert surveyed.position_std == pytest.approx(np.hypot(3.0, GROWTH * surveyed.times[-1]), rel=1e-3)
    common = {"area": tidal_area(0.0, 0.0), "key": seed_keys([1])[0]}
    departures = plan_departures(sea(), [0.0, 1800.0, 3600.0], **common)
    known = [exposed(plan).std[-1] for plan in departures.plans]
    assert known == pytest.approx([np.hypot(3.0, GROWTH * 800.0)] * 3, rel=0.01)


@pytest.mark.slow
def test_simulated_missions_have_it_too_and_files_keep_it(tmp_path):
    run = run_mission(scenario(vehicle={"navigation": KNOWN}), seed=2)
    assert run.done
    assert all(leg.position_std is not None and leg.position_std > 3.0 for leg in run.done)
    assert all(0.0 <= leg.risk <= 1.0 for leg in run.done if leg.risk is not None)
    again = restore_run(save_run(run, tmp_path))
    assert check_run(tmp_path).faults == []
    assert again.vehicle.navigation == run.vehicle.navigation
    for name in ("position_std", "risk", "t_fix"):
        assert [getattr(leg, name) for leg in again.legs] == [
            None if (value := getattr(leg, name)) is None else pytest.approx(value) for leg in run.legs
        ]


def test_navigation_of_a_vehicle_by_name_and_what_is_refused(tmp_path):
    known = plan_scenario(sea({"vehicle": "slocum-g3", "fix": 7.0}), area=tidal_area(0.0, 0.0), seed=1)
    assert known.vehicle.navigation.fix == 7.0
    assert known.vehicle.navigation.current_error == 0.018
    with pytest.raises(ScenarioError, match=r"^vehicle\.navigation names jaiabot, which states none"):
        plan_scenario(sea("jaiabot"), area=tidal_area(0.0, 0.0))
    with pytest.raises(ScenarioError, match=r"^vehicle\.navigation .*no shipped vehicle"):
        plan_scenario(sea("nautilus"), area=tidal_area(0.0, 0.0))
    file = tmp_path / "mine.yaml"
    file.write_text("power: {propulsion: {constant: 10, factor: 5}}\nnavigation: {drift: 0.004}\n")
    own = plan_scenario(sea(str(file)), area=tidal_area(0.0, 0.0), seed=1)
    assert own.vehicle.navigation.drift == 0.004


def test_the_rest_of_a_leg_is_planned_from_the_fix_at_its_beginning():
    area = replace(tidal_area(0.0, 0.0), jobs=jobs(25.0))
    rolling = RollingPlan(sea(), seed=1, area=area)
    assert rolling.plan()
    leg = rolling.legs[1]
    assert leg.t_fix is not None
    half = len(leg.times) // 2
    here, now = np.asarray(leg.positions[half], float), float(leg.times[half])
    found = rolling.from_position(1, here, now)
    assert found is not None
    rest = found.legs[1]
    assert (rest.t_fix, rest.t_hold) == (None, 0.0)
    assert rest.position_std == pytest.approx(leg.position_std, rel=0.05)


def test_the_rest_of_a_leg_is_planned_from_what_was_known_at_its_beginning():
    first, second = jobs().points
    late = Jobs((replace(first, windows=((2500.0, 3000.0),)), second))
    rolling = RollingPlan(sea().with_(SPEEDS), seed=1, area=replace(tidal_area(0.0, 0.0), jobs=late))
    assert rolling.plan()
    leg = rolling.legs[1]
    half = len(leg.times) // 2
    found = rolling.from_position(1, np.asarray(leg.positions[half], float), float(leg.times[half]))
    assert found is not None
    assert found.legs[1].position_std == pytest.approx(leg.position_std, rel=0.01)


def test_drawn_seas_take_the_time_of_a_surfacing():
    area = replace(tidal_area(0.0, 0.0), jobs=jobs(25.0))
    (mission,) = leaving(planning_context(sea(), None, area, 0.0), seed_keys([1])[0], [0.0])
    before = mission.fork()
    complete(mission)
    assert [leg.t_fix is not None for leg in mission.run.legs] == [False, True, False]
    found = outcomes(before, mission.run.legs, jax.random.key(0))
    np.testing.assert_allclose(found.ends, mission.run.t_mission, atol=0.5)
