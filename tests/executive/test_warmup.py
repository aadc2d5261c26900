"""What is compiled while a first mission is begun changes nothing about it."""

import logging
import os
from functools import partial

import numpy as np
import pytest

from auvplan.executive import legs, loop, run_mission
from auvplan.executive.context import make_context
from auvplan.executive.loop import seed_keys, start_mission
from auvplan.runtime.compiled import drop_programs
from tests.executive.small import scenario

pytestmark = pytest.mark.usefixtures("light_search")


@pytest.fixture
def real(monkeypatch):
    """The loop warms up, as it does outside the tests."""
    monkeypatch.setattr(loop, "warm_up", legs.warm_up)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    monkeypatch.setattr(legs, "_warmed_up", set())


def test_a_leg_is_begun_by_what_begins_missions(caplog):
    context = make_context(scenario(), ".")
    with caplog.at_level(logging.INFO, "auvplan"):
        legs.begin_a_leg(partial(start_mission, context, 0, seed_keys([0])[0], 0))
    assert "side by side" not in caplog.text


@pytest.mark.slow
def test_a_mission_is_the_same_with_and_without_it(tmp_path, monkeypatch, real):
    monkeypatch.setenv("AUVPLAN_CACHE", str(tmp_path))
    drop_programs()
    first = run_mission(scenario(), seed=3)
    again = run_mission(scenario(), seed=3)
    assert list(tmp_path.glob("*.pickle"))
    assert first.summary()["total_priority"] == again.summary()["total_priority"]
    for one, other in zip(first.legs, again.legs, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)


def test_it_is_done_once_for_a_scenario_and_not_on_one_core(tmp_path, monkeypatch, real):
    begun = []
    monkeypatch.setattr(legs, "begin_a_leg", lambda *_: begun.append(True))
    monkeypatch.setenv("AUVPLAN_CACHE", str(tmp_path / "one"))
    context = make_context(scenario(), ".")
    for _ in range(2):
        legs.warm_up(context, lambda _: None)
    assert len(begun) == 1
    monkeypatch.setattr(legs, "_warmed_up", set())
    legs.warm_up(context, lambda _: None)
    assert len(begun) == 1, "an earlier process has done it"
    monkeypatch.setattr(legs, "_warmed_up", set())
    monkeypatch.setenv("AUVPLAN_CACHE", str(tmp_path / "other"))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    legs.warm_up(context, lambda _: None)
    assert len(begun) == 1
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    legs.warm_up(context, lambda _: None)
    assert len(begun) == 2
