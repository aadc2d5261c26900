"""Windows looked up again: what is done outside of them is a fault, and so is waiting for nothing."""

import json

import numpy as np
import pytest
import xarray as xr

from auvplan.check.legs import Leg
from auvplan.check.windows import window_faults

NAMES = ["start", "gauge", "wreck", "goal"]


def leg(goal: int, arrival: float, wait: float, task: float, priority: float = 1.0) -> Leg:
    times = np.array([arrival - 10.0, arrival])
    nothing = np.zeros((2, 0, 3))
    return Leg(
        0, 0, goal, 10.0, task, priority, True, times, np.zeros((2, 3)), nothing, np.zeros(0), 0.0, wait
    )


def run_in(tmp_path, table: str, departed: float = 0.0) -> xr.Dataset:
    """What `mission.nc` tells of a run whose jobs are in a file."""
    (tmp_path / "jobs.csv").write_text(table)
    attributes = {
        "scenario": json.dumps({"mission": {"jobs": "jobs.csv"}}),
        "scenario_folder": str(tmp_path),
        "waypoint_names": json.dumps(NAMES),
        "site_epoch": f"2026-03-01T00:{int(departed) // 60:02}:00+00:00",
        "departed": departed,
    }
    return xr.Dataset(attrs=attributes)


@pytest.mark.parametrize(
    ("span", "departed"),
    [
        ("600,1200", 0.0),
        ("2026-03-01T00:10Z,2026-03-01T10:20+10:00", 0.0),
        ("0:10Z,00:20Z", 0.0),
        ("600,1200", 300.0),
    ],
)
def test_tasks_are_in_their_windows_or_stated(tmp_path, span, departed):
    dataset = run_in(tmp_path, f"name,from,to\ngauge,{span}\nwreck,,\n", departed)
    kept = leg(1, 500.0 - departed, 150.0, 300.0), leg(1, 600.0 - departed, 0.0, 600.0)
    missed = leg(1, 1300.0 - departed, 0.0, 0.0, priority=0.0)
    assert not [*window_faults(dataset, [*kept, missed, leg(2, 5000.0, 0.0, 60.0)], [])]
    for wrong in (leg(1, 500.0 - departed, 0.0, 60.0), leg(1, 1100.0 - departed, 0.0, 200.0)):
        (fault,) = window_faults(dataset, [wrong], [])
        assert "is in none of its windows" in fault


@pytest.mark.parametrize(
    ("span", "kept", "broken"),
    [
        ("08:00+10:00,", (22.0, 13.9), (14.1, 21.9)),  # it is ten there at the epoch
        (",18:00Z", (0.0, 17.9), (18.1, 23.9)),
        ("08:00Z,..", (8.0, 23.9), (0.1, 7.9)),
    ],
)
def test_a_time_of_day_beside_an_open_end_holds_to_midnight(tmp_path, span, kept, broken):
    dataset = run_in(tmp_path, f"name,from,to\ngauge,{span}\n")
    for hour in kept:
        assert not [*window_faults(dataset, [leg(1, hour * 3600.0, 0.0, 60.0)], [])]
    for hour in broken:
        assert len([*window_faults(dataset, [leg(1, hour * 3600.0, 0.0, 60.0)], [])]) == 1


def test_a_window_may_ask_for_the_beginning_alone(tmp_path):
    dataset = run_in(tmp_path, "name,windows,window\ngauge,0/100,begin\n")
    assert not [*window_faults(dataset, [leg(1, 90.0, 0.0, 300.0)], [])]


@pytest.mark.parametrize(("hour", "kind"), [(12.0, "daylight"), (3.0, "night")])
def test_the_sun_is_where_the_window_has_it(tmp_path, hour, kind):
    other = {"daylight": "night", "night": "daylight"}
    for windows, faults in ((kind, 0), (other[kind], 1)):
        dataset = run_in(tmp_path, f"name,windows\ngauge,{windows}\n")
        dataset.attrs |= {"site_longitude": 0.0, "site_latitude": 45.0}
        assert len([*window_faults(dataset, [leg(1, hour * 3600.0, 0.0, 60.0)], [])]) == faults


def test_nobody_waits_without_a_window(tmp_path):
    dataset = run_in(tmp_path, "name,from,to\ngauge,,\n")
    (fault,) = window_faults(dataset, [leg(1, 90.0, 60.0, 300.0)], [])
    assert "waits 60 s for a task without a time window" in fault
