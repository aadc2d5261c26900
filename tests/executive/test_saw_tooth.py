"""Missions of gliders: planned as saw-teeth, with the pump's energy, checked, saved and exported."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.errors import ScenarioError
from auvplan.executive import plan_scenario
from auvplan.executive.context import make_context
from auvplan.export import itinerary_of
from auvplan.export.imc import imc_text
from auvplan.export.itinerary import waypoints
from auvplan.io import save_run
from auvplan.link.rolling import RollingPlan
from auvplan.path.saw_tooth import turns
from auvplan.scenario.vehicles import power_model
from auvplan.simulation.world import make_vehicle
from auvplan.site import Site
from tests.executive.small import SMALL, scenario

pytestmark = pytest.mark.usefixtures("light_search")

SAW = {"glide_angle": 26, "shallow": 2, "deep": 45, "dives": 3, "surface_time": 300}
PUMP = {"hotel": 2, "pump": 900, "task": 1, "battery": {"capacity": 200}}
GLIDER = scenario(
    current=SMALL["current"] | {"peak_speed": 0.15},
    vehicle={"speed": 0.4, "saw_tooth": SAW, "power": PUMP},
    mission=SMALL["mission"] | {"waypoints": 4, "neighbours": 2, "time_available": 60000},
)


@pytest.fixture(scope="module")
def run(light_search):
    return plan_scenario(GLIDER, seed=3)


def descents(run):
    """Unbroken runs of samples that go down, on all legs."""
    falls = [np.diff(leg.positions[:, 2]) > 0.0 for leg in run.legs]
    return sum(int(fall[0]) + np.count_nonzero(fall[1:] & ~fall[:-1]) for fall in falls)


def test_a_plan_is_of_dives_that_take_the_pump_and_the_hotel_load(run, tmp_path):
    assert run.success, run.reason
    assert float(run.vehicle.speed) == 0.4
    for leg in run.done:
        at = leg.positions[turns(leg.positions), 2]
        assert np.isclose(at, 45.0, atol=1e-3).sum() > 3
        plan = leg.plans[leg.followed]
        assert np.degrees(np.nanmax(np.abs(plan.motion.pitch[np.diff(plan.positions[:, 2]) != 0.0]))) < 26.2
        times = np.diff(leg.times)[~np.diff(leg.positions, axis=0).any(axis=1)]
        np.testing.assert_allclose(times, 300.0, rtol=1e-4)
    totals = run.energy.totals
    assert totals["dive"] == pytest.approx(900.0 * descents(run) / 3600.0)
    assert totals["hotel"] == pytest.approx(2.0 * run.t_mission / 3600.0, rel=1e-6)
    assert totals["propulsion"] == totals["climb"] == 0.0
    report = check_run(save_run(run, tmp_path / "run"))
    assert report.ok, report


def test_the_checker_counts_the_dives_by_itself(run, tmp_path):
    folder = save_run(run, tmp_path / "run")
    file = folder / "summary.json"
    summary = json.loads(file.read_text())
    summary["energy"]["terms_wh"]["dive"] -= 0.25  # one stroke of the pump
    summary["energy"]["total_wh"] -= 0.25
    file.write_text(json.dumps(summary))
    assert any(fault.startswith("dive takes") for fault in check_run(folder).faults)


def test_a_table_of_averages_takes_the_place_of_the_pump(run):
    power = power_model(GLIDER.with_({"vehicle.power": "slocum-g3", "vehicle.speed": 0.3}).vehicle.power)
    averaged = replace(run, vehicle=replace(run.vehicle, speed=0.3, power=power)).energy
    resting = sum(
        float(np.diff(leg.times)[~np.diff(leg.positions, axis=0).any(axis=1)].sum()) for leg in run.done
    )
    resting += sum(leg.t_task + leg.t_wait + leg.t_hold for leg in run.done)
    moving = run.t_mission - resting
    expected = (float(power.power(0.3)) * moving + 3.0 * resting) / 3600.0
    assert averaged.total == averaged.totals["propulsion"] == pytest.approx(expected, rel=1e-5)


def test_turns_and_surfacings_are_waypoints(run):
    itinerary = itinerary_of(run, Site(5.0, 60.0))
    assert all("turns too sharply" not in line for line in itinerary.warnings)
    for leg, planned in zip(run.done, itinerary.legs, strict=True):
        assert set(turns(leg.positions)) <= set(planned.kept)
        assert abs(planned.time_change) < 0.02
        assert planned.kept_times[-1] == pytest.approx(leg.times[-1], abs=0.02 * leg.t_path)
    rests = [row for row in waypoints(itinerary) if row.task == "rest of 300 s"]
    assert rests
    assert {row.depth for row in rests} == {0.0}
    names = [element.tag for element in ElementTree.fromstring(imc_text(itinerary)).iter()]
    assert names.count("StationKeeping") > len(rests)
    assert "nan" not in imc_text(itinerary).decode()


def test_what_is_neither_simulated_nor_executed_is_refused():
    for run, how in (ap.run_mission, "simulated"), (RollingPlan, "executed"):
        with pytest.raises(ScenarioError, match=f"is planned for and not {how}: use `auvplan plan`"):
            run(GLIDER, seed=0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"glide_angle": 0.45}, "vehicle.saw_tooth.glide_angle: must be greater than or equal to 5"),
        ({"deep": 60}, "vehicle.saw_tooth: has a turn that lies outside the area"),
        ({"deep": 4}, "vehicle.saw_tooth: deep must be at least 5 m below shallow"),
        ({"glide_angle": 40}, "vehicle.saw_tooth: glide_angle is more than pitch_max"),
        ({"dives": 0}, "vehicle.saw_tooth.surface_time: goes with dives alone"),
        ({"depth": 3}, "unknown key 'depth'"),
    ],
)
def test_faulty_shapes_are_named(changes, words):
    with pytest.raises(ScenarioError) as refused:
        GLIDER.with_({"vehicle.saw_tooth": SAW | changes})
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vehicle.transit_depth": 20}, "excludes transit_depth"),
        ({"planning.preset": "paper", "vehicle.power": None}, "goes with preset 'default' alone"),
        ({"vehicle.depth_min": 1}, "surfaces, and depth 0 is outside the area"),
    ],
)
def test_settings_that_exclude_a_saw_tooth_are_named(changes, words):
    with pytest.raises(ScenarioError, match=words):
        GLIDER.with_(changes)


def test_a_pump_stands_in_place_of_propulsion():
    over = power_model(GLIDER.with_({"vehicle.power": {"vehicle": "slocum-g3", "pump": 4800}}).vehicle.power)
    assert (float(over.pump), float(over.power(0.3))) == (4800.0, 0.0)
    both = {"vehicle": "slocum-g3", "pump": 4800, "propulsion": {"constant": 1, "factor": 0}}
    assert float(power_model(GLIDER.with_({"vehicle.power": both}).vehicle.power).power(0.3)) == 1.0
    with pytest.raises(
        ScenarioError, match=r"vehicle.power has a pump, which goes with vehicle.saw_tooth alone"
    ):
        make_vehicle(GLIDER.with_({"vehicle.saw_tooth": None}))


def test_without_one_the_planners_vehicle_is_the_scenarios():
    plain = GLIDER.with_({"vehicle.saw_tooth": None, "vehicle.power": None})
    context = make_context(plain)
    assert context.saw_tooth is None
    assert context.vehicle == context.as_built == make_vehicle(plain)
    assert plain.vehicle.way_speed == plain.vehicle.speed
