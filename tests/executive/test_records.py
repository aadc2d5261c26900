"""Figures of a mission's record in closed form."""

import json

import pytest

from auvplan.check.run import check_dataset
from auvplan.io.results import to_dataset
from tests.io.sample_run import make_run


def test_cost_of_a_mission_weighs_time_left_and_tasks_done():
    """Eq. 15 of three legs, of which two have a task of priority 3."""
    run = make_run()
    assert [leg.priority for leg in run.legs] == [3.0, 3.0, 3.0]
    run.legs[1].priority = 0.0
    left = 3000.0 - sum(leg.t_path + leg.t_task for leg in run.legs)
    assert run.cost_mission() == pytest.approx(left + 100.0 * 2.0 / 3.0)
    assert run.cost_mission(phi1=0.0, phi2=1.0) == pytest.approx(2.0 / 3.0)
    assert run.cost_mission(phi1=2.0, phi2=0.0) == pytest.approx(2.0 * left)
    run.scenario = {"planning": {"phi": [0.5, 10.0]}}
    assert run.cost_mission() == pytest.approx(0.5 * left + 10.0 * 2.0 / 3.0)


def test_time_used_beyond_the_available_costs_as_time_left_does():
    run = make_run()
    run.t_available = run.t_mission - 250.0
    assert run.cost_mission(phi2=0.0) == pytest.approx(250.0)


def test_a_mission_that_uses_the_time_up_to_rounding_is_in_time():
    run = make_run()
    for seconds, in_time in ((0.0, True), (4e-4, True), (0.1, False), (-0.1, True)):
        run.t_available = run.t_mission - seconds
        assert run.success == in_time
        assert not check_dataset(run.summary(), to_dataset(run)).faults
    assert run.t_mission > 400.0


def test_tasks_not_done_do_not_count():
    run = make_run()
    run.legs[-1].arrived = False
    assert run.cost_mission(phi1=0.0) == pytest.approx(100.0 * 2.0 / 3.0)
    assert run.summary()["tasks"] == 2


def test_total_cost_adds_the_computing_time_of_the_re_plans_once():
    """Eq. 16: the first route is no re-plan; what the clock was charged with is not counted again."""
    run = make_run()
    assert [route.cause for route in run.routes] == ["start", "late"]
    run.routes[0].cpu, run.routes[1].cpu = 5.0, 0.25
    run.routes.append(run.routes[1])
    before = run.cost_total()
    assert before == pytest.approx(run.cost_mission() + 0.5)
    run.t_mission, run.charged_compute = run.t_mission + 5.5, 5.5
    assert run.cost_total() == pytest.approx(before)


def test_summary_tells_costs_re_plans_and_computing_time_by_layer():
    summary = json.loads(json.dumps(make_run().summary()))
    assert summary["mission_replans"] == 1
    assert summary["cost_total"] - summary["cost_mission"] == pytest.approx(0.3)
    assert summary["cpu"]["mission_replans_s"] == pytest.approx(0.3)
    assert summary["cpu"]["mission_s"] == pytest.approx(0.6)
    assert summary["cpu"]["path_s"] == pytest.approx(6 * 0.2)
