"""Claims are judged by the figures, and say them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.paper.claims import QUESTIONS, as_markdown, judge
from tests.benchmarks.paper_evidence import evidence, missions

ON_TIME = "every mission ends on time with time left"
LATE = "the mission is re-planned when, and only when, a leg was late"


def spoiled(part, **changes):
    """The evidence with some figures of one part changed by functions, or by values."""
    whole = evidence()
    data = getattr(whole, part)
    made = {
        name: by(data[name]) if callable(by) else data[name].copy(data=by) for name, by in changes.items()
    }
    return replace(whole, **{part: data.assign(made)})


def found(changed, claim):
    return next(one for one in judge(changed) if one.claim == claim)


def test_the_papers_own_figures_confirm_every_claim():
    claims = judge(evidence(), evidence())
    assert {claim.claim: claim.verdict for claim in claims} == {
        question.claim: "confirmed" for question in QUESTIONS
    }
    assert all(claim.paper and claim.where and claim.criterion for claim in claims)
    lines = as_markdown(claims).splitlines()
    assert len(lines) == len(claims) + 2
    assert all(line.replace(r"\|", "").count("|") == 7 for line in lines)


@pytest.mark.parametrize(
    ("where", "part", "name", "by"),
    [
        ("4.1, Fig. 11(a)", "legs", "cost_std", lambda values: values[..., ::-1]),
        ("4.1, Fig. 11(b)", "legs", "violation_mean", lambda values: values + 0.1),
        ("4.1", "legs", "feasible", lambda values: 0.0 * values),
        ("4.1, Fig. 8", "legs", "replan_gain", lambda values: -values),
        ("4.1, Fig. 10", "legs", "straight_s", lambda values: 0.9 * values),
        ("4.1, Figs 9, 10", "legs", "collisions", lambda values: values + 1.0),
        ("3.2.2, Fig. 5", "legs", "kept_cost", lambda values: 1.2 * values),
        ("4.1", "legs", "rate_cost", lambda values: values.copy(data=values.values[::-1])),
        ("4.2, Fig. 14", "calls", "window_cpu", lambda values: values + 40.0),
        (
            "4.2, Fig. 12",
            "missions",
            "success",
            lambda values: values.copy(data=[1, 0, 0, 0, 1]),
        ),
    ],
)
def test_figures_each_carry_one_claim(where, part, name, by):
    lost = [claim for claim in judge(spoiled(part, **{name: by})) if claim.verdict != "confirmed"]
    assert [claim.where for claim in lost] == [where]
    assert lost[0].verdict == "not confirmed"


@pytest.mark.parametrize(
    ("left", "reason", "words"),
    [
        (-20.0, "too late", "4 of 5; least time left of those that arrived -20 s"),
        (
            -6.0,
            "leg 3 to 9 was not finished: time ran out",
            "4 of 5, 1 cut off by the clock under way; least time left of those that arrived 400 s",
        ),
    ],
    ids=["late", "cut off"],
)
def test_one_late_mission_makes_a_claim_about_all_partly_true(left, reason, words):
    """A leg that the clock cut off is not so many seconds late."""
    values = {name: missions()[name].values.copy() for name in ("success", "t_residual", "reason")}
    for name, value in zip(values, (0, left, reason), strict=True):
        values[name][0] = value
    claim = found(spoiled("missions", **values), ON_TIME)
    assert (claim.verdict, claim.paper) == ("partly", words)


@pytest.mark.parametrize(("task_time", "late"), [("whole", 15), ("clock", 0)])
def test_legs_are_late_by_the_rule_that_missions_were_planned_by(task_time, late):
    """Of legs that take 1.05 of their travel time, none is late by T_path alone: t_ij holds the task."""
    scenario = json.dumps({"planning": {"preset": "paper", "task_time": task_time}})
    changed = spoiled("missions", leg_t_path=lambda times: times.clip(max=1400.0))
    changed.missions.attrs["scenario"] = scenario
    assert found(changed, LATE).paper.startswith(f"{late} late legs, 15 new routes")


def test_a_new_route_without_a_late_leg_contradicts_the_rule():
    causes = missions()["route_cause"].values.copy()
    causes[:, 0] = 2
    claim = found(spoiled("missions", route_cause=causes), LATE)
    assert claim.verdict == "not confirmed"
    assert claim.paper.startswith("15 late legs, 20 new routes")


def test_use_of_the_time_counts_missions_on_time():
    used = np.array([13_680.0, 14_430.0, 13_680.0, 13_680.0, 13_680.0])
    changed = spoiled("missions", success=np.array([1, 0, 1, 1, 1]), t_mission=used)
    words = "95.0 % on average of the 4 of 5 missions on time, least 95.0 %"
    assert found(changed, "T_mission approaches T_available").paper == words


def test_errors_of_the_expected_times_are_relative():
    path = missions()["leg_t_expected"].values - 100.0
    claim = found(spoiled("missions", leg_t_path=1.2 * path), "T_path and t_ij lie in a similar range")
    assert "correlation 1.000, median relative error 20.0 %" in claim.paper
    assert claim.verdict == "partly"


def test_the_defaults_figures_stand_beside_and_decide_nothing():
    worse = spoiled("legs", feasible=lambda values: 0.0 * values)
    with_default, alone = judge(evidence(), worse), judge(evidence())
    assert [(one.verdict, one.paper) for one in with_default] == [(one.verdict, one.paper) for one in alone]
    assert all(claim.default for claim in with_default)
    assert not any(claim.default for claim in alone)
