"""Missions of vehicles with power: planned and simulated as without, and failed below the reserve."""

import numpy as np
import pytest

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.executive import plan_scenario
from auvplan.io import save_run
from auvplan.runtime.compiled import compilations
from tests.executive.small import SMALL, scenario

pytestmark = pytest.mark.usefixtures("light_search")

PLAIN = scenario(mission=SMALL["mission"] | {"waypoints": 5, "neighbours": 3, "time_available": 4000})


def powered(capacity):
    battery = {"capacity": capacity, "usable": 0.9, "reserve": 0.25}
    power = {"hotel": 40, "turning": 20, "dive": 60, "task": 15, "battery": battery}
    return PLAIN.with_({"vehicle.power": power | {"propulsion": {"constant": 8, "factor": 12}}})


@pytest.mark.parametrize("execute", [plan_scenario, ap.run_mission], ids=["plan", "simulation"])
def test_a_mission_is_the_same_with_power_and_fails_below_the_reserve(execute, tmp_path):
    plain = execute(PLAIN, seed=2)
    assert plain.success, plain.reason
    before = compilations()
    enough = execute(powered(2000), seed=2)
    assert compilations() == before, "programs know nothing of power"
    assert enough.success
    assert enough.reason == plain.reason
    assert len(enough.legs) == len(plain.legs)
    for one, other in zip(enough.legs, plain.legs, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)
        np.testing.assert_array_equal(one.times, other.times)
    energy = enough.energy
    assert energy.times[-1] - energy.times[0] == pytest.approx(enough.t_mission, rel=1e-6)
    assert energy.totals["hotel"] == pytest.approx(40.0 * enough.t_mission / 3600.0, rel=1e-6)
    under_way = sum(leg.t_path for leg in enough.done) * (8.0 + 12.0 * 2.5**3) / 3600.0
    assert under_way <= energy.totals["propulsion"] < 1.5 * under_way
    assert energy.totals["tasks"] == pytest.approx(sum(leg.t_task for leg in enough.earning) * 15.0 / 3600.0)
    assert check_run(save_run(enough, tmp_path / "enough")).ok

    short = execute(powered(1.2 * energy.total), seed=2)
    assert compilations() == before
    assert short.arrived
    assert not short.success
    assert "Wh short of the battery's reserve: energy " in short.reason
    assert short.reason.startswith(plain.reason + ", ")
    assert f"the largest term is {energy.largest}, {energy.totals[energy.largest]:,.0f} Wh" in short.reason
    assert check_run(save_run(short, tmp_path / "short")).ok
    again = ap.restore_run(tmp_path / "short")
    assert not again.success
    assert again.energy.total == pytest.approx(short.energy.total, rel=1e-4)
