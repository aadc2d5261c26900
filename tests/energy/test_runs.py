"""Scenarios with power, and what planned and saved runs say of it."""

import json
from dataclasses import replace

import numpy as np
import pytest

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.energy import Battery, PowerLaw, PowerModel
from auvplan.errors import ScenarioError
from auvplan.executive.context import make_context
from auvplan.export import itinerary_of
from auvplan.export.geojson import geojson_text
from auvplan.export.markup import kml_text
from auvplan.export.tables import csv_text, trajectories
from auvplan.io import load_run, save_run
from auvplan.io.examine import examine_scenario
from auvplan.plot import plot_energy
from auvplan.scenario.provenance import file_names, source_digests
from auvplan.scenario.vehicles import power_model
from auvplan.simulation.world import make_vehicle
from auvplan.site import Site
from auvplan.view.sheet import sheet_of
from tests.io.sample_run import make_run

INLINE = {
    "hotel": 30,
    "propulsion": {"speeds": [0, 1, 3], "watts": [0, 20, 200]},
    "battery": {"capacity": 500, "reserve": 0.3},
}


def with_power(power, **changes):
    return ap.Scenario().with_({"vehicle.power": power, "vehicle.speed": 1.5} | changes)


def test_power_is_a_mapping_a_name_or_a_file(tmp_path):
    own = make_vehicle(with_power(INLINE)).power
    assert (float(own.hotel), float(own.battery.usable_wh), float(own.battery.reserve)) == (30.0, 500.0, 0.3)
    named = make_vehicle(with_power("lauv-xplore-1")).power
    assert float(named.power(1.0)) == pytest.approx(36.09 + 3.0 + 24.25)
    over = {"vehicle": "lauv-xplore-1", "payload": 20, "battery": {"ageing": 0.8}}
    changed = make_vehicle(with_power(over)).power
    assert float(changed.power(1.0) - named.power(1.0)) == pytest.approx(17.0)
    assert float(changed.battery.usable_wh) == pytest.approx(1120.0)
    (tmp_path / "mine.yaml").write_text("power: {propulsion: {constant: 10, factor: 15}, hotel: 5}\n")
    filed = with_power("mine.yaml")
    assert make_vehicle(filed.in_folder(tmp_path)).power == PowerModel(PowerLaw(10.0, 15.0), 5.0)
    assert make_vehicle(ap.Scenario()).power is None
    plain = filed.model_dump(mode="json")
    assert ("vehicle.power", "mine.yaml") in file_names(plain)
    assert [row["field"] for row in source_digests(plain, tmp_path)] == ["vehicle.power"]
    assert not file_names(with_power(over).model_dump(mode="json"))


@pytest.mark.parametrize(
    ("power", "words"),
    [
        (
            {**INLINE, "hotel": -1},
            "scenario: vehicle.power.hotel: must be greater than or equal to 0, got -1",
        ),
        ({**INLINE, "hotl": 3}, "vehicle.power.hotl: unknown key 'hotl', did you mean 'hotel'?"),
        ({"hotel": 3}, "vehicle.power: needs propulsion, or the vehicle that it is of"),
        ({"propulsion": {"speeds": [0, 1]}}, "must have either speeds and watts or constant and factor"),
        ({"propulsion": {"speeds": [1, 0], "watts": [1, 2]}}, "speeds must rise"),
        ({**INLINE, "battery": {"reserve": 0.1}}, "vehicle.power.battery: needs its capacity, Wh"),
        (
            {**INLINE, "battery": {"capacity": 100, "reserve": 2}},
            "vehicle.power.battery.reserve: must be less",
        ),
        (3, "vehicle.power: must be a section of fields"),
    ],
)
def test_faulty_power_is_named(power, words):
    with pytest.raises(ScenarioError) as refused:
        with_power(power)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("power", "words"),
    [
        ("lauv", "vehicle.power 'lauv' is no shipped vehicle: jaiabot, "),
        ("no.yaml", "vehicle.power "),
        ("slocum-g3", "vehicle.speed 1.5 m/s is beyond the table of vehicle.power, which ends at 0.374 m/s"),
    ],
)
def test_power_that_is_not_there_is_named(power, words, tmp_path):
    scenario = with_power(power).in_folder(tmp_path)
    with pytest.raises(ScenarioError) as refused:
        make_vehicle(scenario)
    assert str(refused.value).startswith(words)
    assert "\n" not in str(refused.value)


def test_validate_looks_at_the_vehicles_file(tmp_path):
    path = tmp_path / "one.yaml"
    common = "site: {longitude: 148.9, latitude: -20.3}\nchart: {source: none}\nmission: {waypoints: 2}\n"
    path.write_text(common + "vehicle: {power: mine.yaml, speed: 1.5}\n")
    assert any("mine.yaml: No such file" in line for line in examine_scenario(path).lines)
    (tmp_path / "mine.yaml").write_text("power: {hotel: -5, propulsion: {constant: 10, factor: 15}}\n")
    (line,) = examine_scenario(path).lines
    assert "one.yaml:4:" in line
    assert "mine.yaml:1: power.hotel: must be greater than or equal to 0" in line
    path.write_text(common + "vehicle: {power: lauv-xplore-1}\n")
    assert any("2.5 m/s is beyond the table" in line for line in examine_scenario(path).lines)


def test_the_schema_takes_a_name_or_a_mapping():
    from auvplan.scenario.file import scenario_schema

    kinds = scenario_schema()["$defs"]["VehicleSettings"]["properties"]["power"]["anyOf"]
    assert {"type": "string"} in kinds
    assert {"$ref": "#/$defs/PowerSettings"} in kinds


def test_programs_do_not_know_of_power():
    plain, powered = ap.Scenario().with_({"vehicle.speed": 1.5}), with_power(INLINE)
    assert plain.fingerprint == powered.fingerprint
    assert make_context(powered).vehicle == make_context(plain).vehicle


def sample():
    run = make_run()
    run.scenario = ap.Scenario().model_dump(mode="json") | run.scenario
    return run


def powered_run(capacity=500.0):
    run = sample()
    power = replace(power_model(with_power(INLINE).vehicle.power), battery=Battery(capacity, reserve=0.3))
    return replace(run, vehicle=replace(run.vehicle, power=power))


@pytest.mark.parametrize("capacity", [500.0, 60.0])
def test_a_saved_run_keeps_its_energy_and_is_checked(tmp_path, capacity):
    run = powered_run(capacity)
    assert run.success == (capacity == 500.0)
    save_run(run, tmp_path)
    again = ap.restore_run(tmp_path)
    assert again.energy.total == pytest.approx(run.energy.total, rel=1e-4)
    assert again.success == run.success
    summary = json.loads((tmp_path / "summary.json").read_text())
    dataset = load_run(tmp_path)
    assert dataset["charge"].values[0] == 1.0
    assert dataset["charge"].attrs["units"] == "1"
    assert check_run(tmp_path).ok
    for change, words in (
        ({"total_wh": 1.0}, "energy by term adds up to"),
        ({"charge_end": 0.99}, "the charge at the end, 0.9900, is more than on the way"),
        ({"charge_end": -1.0}, "charge_end is -1.0000, battery and terms make it"),
        ({"reserve": 0.1}, "reserve is 0.1000, battery and terms make it 0.3000"),
        ({"usable_wh": 9e3}, "usable_wh is 9000.0000"),
        ({"terms_wh": summary["energy"]["terms_wh"] | {"hotel": 1.0}}, "hotel takes 1.00 Wh"),
        ({"terms_wh": summary["energy"]["terms_wh"] | {"propulsion": 0.1}}, "propulsion takes 0.10 Wh"),
        ({"terms_wh": summary["energy"]["terms_wh"] | {"dive": 9.0}}, "dive takes 9.00 Wh"),
    ):
        (tmp_path / "summary.json").write_text(json.dumps(summary | {"energy": summary["energy"] | change}))
        assert any(words in fault for fault in check_run(tmp_path).faults)
    (tmp_path / "summary.json").write_text(json.dumps(summary | {"success": not run.success}))
    assert any("the charge and the last waypoint" in fault for fault in check_run(tmp_path).faults)


def test_a_power_model_that_is_not_the_scenarios_is_a_fault(tmp_path):
    run = powered_run()
    power = {
        "hotel": 1.0,
        "battery": {"capacity": 9e3},
        "propulsion": {"speeds": [0.0, 1.0], "watts": [1, 2]},
    }
    run.scenario["vehicle"]["power"] = power
    save_run(run, tmp_path)
    faults = [fault for fault in check_run(tmp_path).faults if "power_model" in fault]
    parts = "hotel", "battery.capacity", "propulsion.speeds", "propulsion.watts"
    assert [fault.split(" is ")[0] for fault in faults] == [f"vehicle.power.{part}" for part in parts]
    assert faults[0].endswith("the scenario says 1.0")


def test_files_without_power_are_as_they_were(tmp_path):
    save_run(sample(), tmp_path)
    dataset = load_run(tmp_path)
    assert "charge" not in dataset
    assert "power_model" not in dataset.attrs
    assert not any("power" in name for name in dataset.attrs)
    assert ap.restore_run(tmp_path).vehicle.power is None


def test_the_sheet_has_a_line_and_the_picture_its_panels():
    run = powered_run()
    assert sheet_of(run).facts["energy"] == run.energy.line.removeprefix("energy ")
    assert "energy" not in sheet_of(make_run()).facts
    upper, lower = plot_energy(run)
    assert upper.get_ylabel() == "power [W]"
    assert lower.get_ylabel() == "charge [%]"
    labels = [text.get_text() for text in upper.get_legend().get_texts()]
    assert labels[0].startswith("hotel ")
    assert "no energy is known" in plot_energy(make_run()).texts[0].get_text()


def test_exports_carry_the_charge_where_it_is_known():
    site = Site(148.96, -20.34)
    plain, powered = (itinerary_of(run, site) for run in (make_run(), powered_run()))
    heads = [csv_text(one).decode().splitlines() for one in (plain, powered)]
    assert not heads[0][0].endswith("charge")
    assert heads[1][0] == heads[0][0] + ",charge"
    left = [float(line.rpartition(",")[2]) for line in heads[1][1:]]
    assert left[0] == 1.0
    assert (np.diff(left) < 0.0).all()
    assert [line.rpartition(",")[0] for line in heads[1][1:]] == heads[0][1:]
    features = json.loads(geojson_text(powered))["features"]
    assert [f["properties"]["charge"] for f in features if f["properties"]["kind"] == "waypoint"] == left
    assert b"charge" not in geojson_text(plain)
    assert f"charge {100.0 * left[-1]:.0f} %" in kml_text(powered).decode()
    assert "charge" not in trajectories(plain)
    assert trajectories(powered)["charge"].values[0] == 1.0
