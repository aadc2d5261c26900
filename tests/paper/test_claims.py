"""Claims are judged by the figures, and say them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from auvplan.paper import as_json, as_markdown, judge
from auvplan.paper.claims import QUESTIONS
from tests.paper.evidence import evidence, missions


def changed_legs(**changes):
    """The evidence with some figures of its legs changed by functions."""
    whole = evidence()
    return replace(
        whole, legs=whole.legs.assign({name: by(whole.legs[name]) for name, by in changes.items()})
    )


def changed_missions(**values):
    whole = evidence()
    variables = {name: whole.missions[name].copy(data=values[name]) for name in values}
    return replace(whole, missions=whole.missions.assign(variables))


def test_the_papers_own_figures_confirm_every_claim():
    found = judge(evidence())
    assert {claim.claim: claim.verdict for claim in found} == {
        question.claim: "confirmed" for question in QUESTIONS
    }
    assert all(claim.paper and claim.where and claim.criterion for claim in found)


@pytest.mark.parametrize(
    ("where", "name", "by"),
    [
        ("4.1, Fig. 11(a)", "cost_std", lambda values: values[..., ::-1]),
        ("4.1, Fig. 11(b)", "violation_mean", lambda values: values + 0.1),
        ("4.1", "feasible", lambda values: 0.0 * values),
        ("4.1, Fig. 8", "replan_gain", lambda values: -values),
        ("4.1, Fig. 10", "straight_s", lambda values: 0.9 * values),
        ("4.1, Figs 9, 10", "collisions", lambda values: values + 1.0),
        ("3.2.2, Fig. 5", "kept_cost", lambda values: 1.2 * values),
    ],
)
def test_figures_of_legs_each_carry_one_claim(where, name, by):
    found = judge(changed_legs(**{name: by}))
    lost = [claim for claim in found if claim.verdict != "confirmed"]
    assert [claim.where for claim in lost] == [where]
    assert lost[0].verdict == "not confirmed"


def test_one_late_mission_makes_a_claim_about_all_partly_true():
    base = missions()
    success, left = base["success"].values.copy(), base["t_residual"].values.copy()
    success[0], left[0] = 0, -20.0
    found = {claim.claim: claim for claim in judge(changed_missions(success=success, t_residual=left))}
    claim = found["every mission ends on time with time left"]
    assert claim.verdict == "partly"
    assert claim.paper == "4 of 5; least time left of those that arrived -20 s"


def test_a_leg_cut_off_by_the_clock_is_not_so_many_seconds_late():
    base = missions()
    success, left, reason = (base[name].values.copy() for name in ("success", "t_residual", "reason"))
    success[0], left[0], reason[0] = 0, -6.0, "leg 3 to 9 was not finished: time ran out"
    found = judge(changed_missions(success=success, t_residual=left, reason=reason))
    words = {claim.claim: claim.paper for claim in found}["every mission ends on time with time left"]
    assert words == "4 of 5, 1 cut off by the clock under way; least time left of those that arrived 400 s"


def test_legs_are_late_by_the_rule_that_missions_were_planned_by():
    """Of legs that take 1.05 of their travel time, none is late by T_path alone: t_ij holds the task."""
    whole = evidence()
    for task_time, late in (("whole", 15), ("clock", 0)):
        scenario = json.dumps({"planning": {"preset": "paper", "task_time": task_time}})
        times = {"leg_t_path": whole.missions["leg_t_path"].clip(max=1400.0)}
        spoiled = replace(whole, missions=whole.missions.assign(times).assign_attrs(scenario=scenario))
        found = {claim.claim: claim.paper for claim in judge(spoiled)}
        words = found["the mission is re-planned when, and only when, a leg was late"]
        assert words.startswith(f"{late} late legs, 15 new routes")


def test_more_than_half_late_is_not_confirmed():
    success = np.array([1, 0, 0, 0, 1])
    found = {claim.claim: claim.verdict for claim in judge(changed_missions(success=success))}
    assert found["every mission ends on time with time left"] == "not confirmed"


def test_a_new_route_without_a_late_leg_contradicts_the_rule():
    causes = missions()["route_cause"].values.copy()
    causes[:, 0] = 2
    found = {claim.claim: claim for claim in judge(changed_missions(route_cause=causes))}
    claim = found["the mission is re-planned when, and only when, a leg was late"]
    assert claim.verdict == "not confirmed"
    assert claim.paper.startswith("15 late legs, 20 new routes")


def test_use_of_the_time_counts_missions_on_time():
    success = np.array([1, 0, 1, 1, 1])
    used = np.array([13_680.0, 14_430.0, 13_680.0, 13_680.0, 13_680.0])
    found = {claim.claim: claim for claim in judge(changed_missions(success=success, t_mission=used))}
    words = "95.0 % on average of the 4 of 5 missions on time, least 95.0 %"
    assert found["T_mission approaches T_available"].paper == words


def test_errors_of_the_expected_times_are_relative():
    path = missions()["leg_t_expected"].values - 100.0
    found = {claim.claim: claim for claim in judge(changed_missions(leg_t_path=1.2 * path))}
    claim = found["T_path and t_ij lie in a similar range"]
    assert "correlation 1.000, median relative error 20.0 %" in claim.paper
    assert claim.verdict == "partly"


def test_a_call_that_outlasts_the_interval_is_too_slow():
    whole = evidence()
    slow = replace(whole, calls=whole.calls.assign(window_cpu=whole.calls["window_cpu"] + 40.0))
    found = {claim.claim: claim.verdict for claim in judge(slow)}
    assert found["planning is fast enough for real time"] == "not confirmed"


def test_costs_that_do_not_rise_with_the_update_rate():
    whole = evidence()
    falling = whole.legs["rate_cost"].copy(data=whole.legs["rate_cost"].values[::-1])
    found = {
        claim.claim: claim.verdict
        for claim in judge(replace(whole, legs=whole.legs.assign(rate_cost=falling)))
    }
    assert found["fitness falls as the rate of current updates rises"] == "not confirmed"


def test_the_defaults_figures_stand_beside_and_decide_nothing():
    worse = changed_legs(feasible=lambda values: 0.0 * values)
    with_default, alone = judge(evidence(), worse), judge(evidence())
    assert [claim.verdict for claim in with_default] == [claim.verdict for claim in alone]
    assert [claim.paper for claim in with_default] == [claim.paper for claim in alone]
    assert all(claim.default for claim in with_default)
    assert not any(claim.default for claim in alone)


def test_tables_hold_every_claim():
    found = judge(evidence(), evidence())
    assert json.loads(json.dumps(as_json(found)))[0]["verdict"] == "confirmed"
    lines = as_markdown(found).splitlines()
    assert len(lines) == len(found) + 2
    assert all(line.replace(r"\|", "").count("|") == 7 for line in lines)
