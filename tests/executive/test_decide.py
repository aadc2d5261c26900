"""What is decided, as a table: each rule by itself, which goes first, and what never happens."""

from dataclasses import fields, replace
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from auvplan.executive.decide import NEXT, RULES, Act, Decision, Facts, Phase, Waiting, after, decide
from tests.tool import load_tool

HELD = Phase.HELD
MADE, UPLOADED = Waiting.MADE, Waiting.UPLOADED

#: Facts other than those of a mission without trouble, and what is decided by which rule.
TABLE = [
    ({}, Act.GO_ON, "nothing"),
    ({"phase": HELD}, Act.GO_ON, "nothing"),
    # Ends, each before everything that follows it.
    ({"arrived": True, "taken": "aborted", "given_up": "fault", "overdue": "late"}, Act.ARRIVE, "arrived"),
    ({"taken": "aborted", "given_up": "fault", "overdue": "late", "heard": False}, Act.LEAVE, "taken"),
    ({"given_up": "fault", "overdue": "late", "waiting": UPLOADED, "missed": "m"}, Act.SURFACE, "given up"),
    ({"overdue": "late", "waiting": UPLOADED, "missed": "m", "heard": False}, Act.SURFACE, "overdue"),
    # What is uploaded is started, whatever else is known, or the vehicle held.
    ({"waiting": UPLOADED, "missed": "m", "heard": False, "resting": True}, Act.HOLD, "past"),
    ({"waiting": UPLOADED, "heard": False, "resting": True, "stuck": "s"}, Act.START, "uploaded"),
    ({"waiting": UPLOADED, "phase": HELD, "busy": True, "due": "drift"}, Act.START, "uploaded"),
    ({"waiting": UPLOADED, "uploads": False, "hazard": "rock"}, Act.START, "uploaded"),
    # Simulated vehicles.
    ({"uploads": False}, Act.GO_ON, "nothing"),
    ({"uploads": False, "hazard": "rock"}, Act.REPLAN_LEG, "look"),
    ({"uploads": False, "window": True}, Act.REPLAN_LEG, "look"),
    ({"uploads": False, "phase": HELD, "heard": False}, Act.REPLAN_LEG, "look"),
    ({"uploads": False, "hazard": "rock", "planner": False}, Act.GIVE_WAY, "no way"),
    ({"uploads": False, "phase": HELD, "planner": False, "resting": True}, Act.GIVE_WAY, "no way"),
    ({"uploads": False, "window": True, "planner": False}, Act.GO_ON, "nothing"),
    ({"window": True}, Act.GO_ON, "nothing"),
    # A vehicle that is not heard goes on, held or not.
    ({"heard": False, "phase": HELD, "due": "drift"}, Act.GO_ON, "not heard"),
    ({"heard": False, "stuck": "s", "hazard": "rock", "due": "late"}, Act.GO_ON, "not heard"),
    ({"heard": False, "waiting": MADE}, Act.GO_ON, "not heard"),
    # One that stands is started again, also soon after a failure; without a plan nothing is planned for it.
    ({"stuck": "s", "idle": True, "resting": True, "astray": "a"}, Act.RESTART, "stopped"),
    ({"stuck": "s", "phase": HELD, "due": "drift"}, Act.REPLAN_LEG, "held"),
    ({"idle": True, "astray": "a", "hazard": "rock", "due": "late"}, Act.GO_ON, "no plan"),
    ({"idle": True, "phase": HELD, "due": "drift"}, Act.REPLAN_LEG, "held"),
    # It does not stay where an obstacle comes to, whatever else is due, and goes on where there is a plan.
    ({"approached": "rock", "busy": True, "stuck": "s", "due": "late"}, Act.GIVE_WAY, "approached"),
    ({"approached": "rock", "busy": True, "waiting": MADE}, Act.GIVE_WAY, "approached"),
    ({"approached": "rock", "phase": HELD, "resting": True, "due": "hazard"}, Act.GIVE_WAY, "approached"),
    ({"approached": "rock", "phase": HELD, "waiting": MADE}, Act.UPLOAD, "plan"),
    ({"approached": "rock", "heard": False}, Act.GO_ON, "not heard"),
    # Nothing is tried again just after it failed.
    ({"resting": True, "astray": "a", "hazard": "rock"}, Act.GO_ON, "resting"),
    ({"resting": True, "waiting": MADE, "missed": "m"}, Act.GO_ON, "resting"),
    ({"resting": True, "phase": HELD, "due": "drift"}, Act.GO_ON, "resting"),
    ({"resting": True, "due": "late"}, Act.GO_ON, "resting"),
    # Plans that wait.
    ({"waiting": MADE, "missed": "m", "astray": "a"}, Act.DROP, "late plan"),
    ({"waiting": MADE, "missed": "m", "phase": HELD}, Act.DROP, "late plan"),
    ({"waiting": MADE, "due": "late"}, Act.UPLOAD, "plan"),
    ({"waiting": MADE, "busy": True, "due": "late"}, Act.GO_ON, "nothing"),
    ({"waiting": MADE, "phase": HELD, "busy": True, "due": "drift"}, Act.UPLOAD, "plan"),
    ({"waiting": MADE, "phase": HELD, "hazard": "rock", "due": "drift"}, Act.UPLOAD, "plan"),
    # Trouble on the present leg goes before plans for the rest.
    ({"waiting": MADE, "astray": "a", "hazard": "rock"}, Act.HOLD, "drift"),
    ({"waiting": MADE, "hazard": "rock"}, Act.HOLD, "hazard"),
    ({"astray": "a", "due": "late", "busy": True}, Act.HOLD, "drift"),
    ({"hazard": "rock", "due": "late", "busy": True}, Act.HOLD, "hazard"),
    # A leg that takes too long is left, but no task, and not where a plan is at hand.
    ({"turns": "late", "due": "late", "astray": ""}, Act.HOLD, "leave leg"),
    ({"turns": "late", "busy": True}, Act.GO_ON, "nothing"),
    ({"turns": "late", "waiting": MADE}, Act.UPLOAD, "plan"),
    ({"turns": "late", "phase": HELD, "due": "leave leg"}, Act.REPLAN_LEG, "held"),
    ({"turns": "late", "phase": HELD}, Act.GO_ON, "nothing"),
    ({"due": "late", "busy": True}, Act.REPLAN_REST, "due"),
    ({"missed": "m", "busy": True}, Act.GO_ON, "nothing"),
]

words = st.sampled_from(["", "words"])
kinds = {bool: st.booleans(), str: words, Phase: st.sampled_from([Phase.UNDER_WAY, HELD])}
kinds[Waiting] = st.sampled_from(Waiting)
some_facts = st.builds(Facts, **{field.name: kinds[type(field.default)] for field in fields(Facts)})


@pytest.mark.parametrize(("known", "act", "rule"), TABLE, ids=str)
def test_the_first_rule_that_applies_decides(known, act, rule):
    decision = decide(Facts(**known))
    assert (decision.act, decision.rule) == (act, rule)


def test_every_rule_decides_somewhere_in_the_table():
    assert {rule for _, _, rule in TABLE} == {rule.name for rule in RULES} | {"nothing"}
    assert len({rule.name for rule in RULES}) == len(RULES)


@pytest.mark.parametrize(
    ("fact", "held"),
    [
        (name, False)
        for name in (
            "taken",
            "given_up",
            "overdue",
            "approached",
            "stuck",
            "astray",
            "hazard",
            "turns",
            "due",
        )
    ]
    + [("due", True)],
)
def test_why_is_the_fact_that_decided(fact, held):
    facts = Facts(HELD if held else Phase.UNDER_WAY, **{fact: "for this"})
    assert decide(facts).why == "for this"
    assert decide(Facts(arrived=True)) == Decision(Act.ARRIVE, "arrived", "")


@given(some_facts)
def test_what_never_happens(facts):
    act = decide(facts).act
    assert decide(facts) == decide(replace(facts))
    if facts.arrived or facts.taken or facts.given_up or facts.overdue:
        assert act in (Act.ARRIVE, Act.LEAVE, Act.SURFACE)
    else:
        assert act not in (Act.ARRIVE, Act.LEAVE, Act.SURFACE)
    if facts.taken and not facts.arrived:
        assert act is Act.LEAVE, "what somebody else has taken is asked for nothing"
    if facts.uploads:
        assert act is not Act.GIVE_WAY or facts.approached
        if not facts.heard and facts.waiting is not UPLOADED:
            assert act in (Act.GO_ON, Act.ARRIVE, Act.LEAVE, Act.SURFACE)
    if act is Act.UPLOAD:
        assert facts.waiting is MADE
        assert facts.held or not facts.busy, "a task is not cut short"
        assert not facts.missed
    if act is Act.START:
        assert facts.waiting is UPLOADED
        assert not facts.missed
    if act is Act.REPLAN_REST:
        assert facts.waiting is Waiting.NONE, "two plans are never made at once"
    if act in (Act.HOLD, Act.REPLAN_REST, Act.RESTART, Act.SURFACE, Act.LEAVE):
        assert decide(facts).why


def test_phases_follow_acts():
    begun = {phase for phase, _ in NEXT}
    assert begun == {Phase.READY, Phase.UNDER_WAY, HELD}
    for phase, act in product(Phase, Act):
        end = after(phase, act)
        assert end is NEXT.get((phase, act), phase)
        if phase not in begun:
            assert end is phase, "an end is an end"
    assert after(Phase.READY, Act.START) is after(HELD, Act.START) is Phase.UNDER_WAY
    assert after(Phase.UNDER_WAY, Act.HOLD) is after(Phase.UNDER_WAY, Act.GIVE_WAY) is HELD
    assert after(Phase.UNDER_WAY, Act.GO_ON) is Phase.UNDER_WAY
    for phase in (Phase.UNDER_WAY, HELD):
        ends = [after(phase, act) for act in (Act.ARRIVE, Act.SURFACE, Act.LEAVE)]
        assert ends == [Phase.ARRIVED, Phase.SURFACING, Phase.LEFT]


def test_the_page_shows_the_rules_of_the_code():
    tool = load_tool("decisions")
    assert tool.as_markdown() in tool.PAGE.read_text(encoding="utf-8"), "run python tools/decisions.py"
