"""What is done outside of its windows is a fault, and so is waiting for nothing."""

import json

import numpy as np
import pytest
import xarray as xr

from auvplan.check.saved import Leg, Saved
from auvplan.check.tasks import window_faults

NAMES = ["start", "gauge", "wreck", "buoy", "survey[1]", "survey[2]", "goal"]


def leg(goal, arrival, wait=0.0, task=60.0, priority=1.0, start=0, missed=False):
    times = np.array([arrival - 10.0, arrival])
    none = np.zeros((2, 0, 3)), np.zeros(0)
    return Leg(
        0, start, goal, 10.0, task, priority, True, times, np.zeros((2, 3)), *none, 0.0, wait, missed
    )  # fmt: skip


def run_with(legs, windows, line=None, **variables):
    """A run of these legs with a job at the gauge and a survey line."""
    job = {"priority": 1.0, "duration": 60.0, "falls": []}
    gauge = job | {"name": "gauge", "position": [0.0, 0.0, 0.0], "windows": windows}
    others = [gauge | {"name": name, "windows": []} for name in ("wreck", "buoy")]
    survey = job | {"name": "survey", "positions": [[0.0] * 3, [9.0] * 3], "windows": line or []}
    attributes = {
        "scenario": json.dumps({"mission": {"jobs": "jobs.csv"}}),
        "waypoint_names": json.dumps(NAMES),
        "jobs": json.dumps({"points": [gauge, *others], "lines": [survey]}),
    }
    data = {name: (("waypoint", "window"), values) for name, values in variables.items()}
    return Saved({}, xr.Dataset(data, attrs=attributes), legs)


SPANS = [[600.0, 900.0], [2000.0, None]]
CASES = [
    (leg(1, 500.0, wait=150.0), ""),
    (leg(1, 600.0), ""),
    (leg(1, 899.0, task=900.0), ""),  # it is the beginning that windows are of
    (leg(1, 9e6), ""),
    (leg(1, 1300.0, priority=0.0), ""),
    (leg(2, 5000.0), ""),
    (leg(1, 500.0), "the task at 'gauge' from 500 to 560 s is in none of its windows"),
    (leg(1, 901.0), "the task at 'gauge' from 901 to 961 s is in none of its windows"),
    (leg(1, 1300.0, priority=0.0, missed=True), ""),
    (leg(1, 899.5, priority=0.0, missed=True), ""),  # too near the end to tell
    (leg(1, 700.0, priority=0.0, missed=True), "misses the task at 'gauge', in whose window it arrives"),
    (leg(2, 90.0, wait=60.0), "waits 60 s for a task without a time window"),
    (leg(5, 110.0, task=30.0, start=4), ""),
    (leg(4, 110.0, task=30.0, start=5), ""),
    (leg(5, 109.0, start=4), "a part of line 'survey' from 99 to 169 s is in none of its windows"),
    (leg(5, 150.0, start=4), "a part of line 'survey' from 140 to 210 s is in none of its windows"),
]


@pytest.mark.parametrize(("leg", "words"), CASES)
def test_tasks_are_in_their_windows_or_stated(leg, words):
    faults = [*window_faults(run_with([leg], SPANS, [[100.0, 200.0]]))]
    assert len(faults) == bool(words)
    assert all(words in fault for fault in faults)


@pytest.mark.parametrize(("opens", "found"), [(650.0, 1), (750.0, 0)])
def test_a_closed_area_may_narrow_the_window_that_is_missed(opens, found):
    ends = {"window_opens": np.full((6, 1), opens), "window_closes": np.full((6, 1), 900.0)}
    late = leg(1, 700.0, priority=0.0, missed=True)
    assert len([*window_faults(run_with([late], SPANS, **ends))]) == found


def test_without_the_jobs_nothing_is_told():
    run = run_with([leg(1, 500.0), leg(2, 90.0, wait=60.0)], SPANS)
    del run.data.attrs["jobs"]
    assert not [*window_faults(run)]
