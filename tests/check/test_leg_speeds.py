"""Legs that are gone at speeds through the water of their own are checked against these, and these too."""

import json
from dataclasses import replace

import numpy as np
import pytest

from auvplan.check.run import check_dataset
from auvplan.energy import Battery, PowerModel, PowerTable
from auvplan.io.results import to_dataset
from tests.check.test_check import round_trip
from tests.io.sample_run import at_speeds, make_run

SPEEDS = (2.0, None, 3.0)
POWER = PowerModel(PowerTable([0.0, 2.0, 3.0], [0.0, 50.0, 200.0]), 30.0, 5.0, battery=Battery(900.0))


def paced(speeds=SPEEDS, span=(1.5, 3.2), simulated=True):
    """The sample run at speeds of its own, which the scenario allows, with its energy and in known water."""
    run = at_speeds(make_run(), speeds)
    run.scenario = run.scenario | {"vehicle": {} if span is None else {"speed_range": list(span)}}
    run.vehicle, run.simulated = replace(run.vehicle, power=POWER), simulated
    for leg in run.legs:
        leg.current = np.zeros((len(leg.times), 2))
    return run


def faults(run, change=None):
    summary, dataset = json.loads(json.dumps(run.summary())), to_dataset(run)
    if change is not None:
        change(summary, dataset)
    return check_dataset(summary, dataset).faults


@pytest.mark.parametrize("simulated", [True, False])
def test_legs_at_speeds_of_their_own_have_no_fault(simulated):
    assert faults(paced(simulated=simulated)) == []
    assert faults(paced((2.5, 2.5, 2.5), None, simulated)) == []
    assert faults(paced((None, None, None), None, simulated)) == []


@pytest.mark.parametrize(
    ("span", "allowed"), [((2.2, 3.2), "2.2 to 3.2"), ((1.5, 2.8), "1.5 to 2.8"), (None, "2.5")]
)
def test_a_speed_that_the_scenario_does_not_allow_is_found(span, allowed):
    found = [fault for fault in faults(paced(span=span)) if "the scenario allows" in fault]
    assert all(f"the scenario allows {allowed} m/s" in fault for fault in found)
    assert all(fault.endswith(" alone") == (span is None) for fault in found)
    wrong = {2.0: span != (1.5, 2.8), 3.0: span != (2.2, 3.2)}
    for leg, speed in ((0, 2.0), (2, 3.0)):
        assert any(f.startswith(f"leg {leg} ") and f"{speed:g} m/s" in f for f in found) == wrong[speed]
    assert any(fault.startswith("route 0: ") for fault in found)


@pytest.mark.parametrize("leg", [0, 1, 2])
@pytest.mark.parametrize("claim", [1.6, 3.1])
def test_a_speed_that_the_track_does_not_make_is_found(leg, claim):
    """By the current, which is known."""

    def change(summary, dataset):
        dataset["leg_speed"].values[leg] = claim
        summary["legs"][leg]["speed"] = claim

    found = faults(paced(simulated=False), change)
    assert any(fault.startswith(f"leg {leg} ") and f"makes its {claim:g} m/s" in fault for fault in found)


def test_what_the_summary_and_the_energy_say_of_another_speed_is_found():
    def faster(summary, dataset):
        summary["legs"][0]["speed"] = 2.1

    assert [fault[:28] for fault in faults(paced(), faster)] == ["leg 0 (0 to 1): speed is 2.1"]

    def cheaper(summary, dataset):
        energy = summary["energy"]
        spare = 0.2 * energy["terms_wh"]["propulsion"]
        energy["terms_wh"]["propulsion"] -= spare
        energy["total_wh"] -= spare
        energy["margin_wh"] += spare
        energy["charge_end"] += spare / energy["usable_wh"]

    found = faults(paced(simulated=False), cheaper)
    assert "propulsion takes" in found[0]


def test_a_track_is_too_fast_by_the_speed_of_its_leg():
    """What is within reach at 3 m/s is not at 1.6."""
    run = paced((1.6, None, 3.0))
    for number in (0, 2):
        leg = run.legs[number]
        leg.times = leg.times.copy()
        gap = float(np.linalg.norm(leg.positions[11] - leg.positions[10]))
        leg.times[11] = leg.times[10] + gap / 7.3
    assert [fault.startswith("leg 0 ") for fault in faults(run) if "is too fast" in fault] == [True]


@pytest.mark.parametrize(("span", "found"), [(None, True), ((2.0, 3.0), True), ((1.5, 3.0), False)])
def test_a_path_over_others_is_open_where_the_least_speed_does(span, found):
    """It is 848 m long, and 900 s are left: half of them do at 2 m/s, and not at 1.5."""
    run = paced((None,) * 3, span)
    back = round_trip()
    run.legs, run.t_available = back.legs, float(back.legs[2].times[0]) + 900.0
    assert any("waypoint 1 is visited twice" in fault for fault in faults(run)) is found
