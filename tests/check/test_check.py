"""The independent checker finds what is wrong, and only that."""

import json
import os
import re
import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from auvplan.check.run import ResultError, check_dataset, check_run
from auvplan.io import save_run
from auvplan.io.results import to_dataset
from auvplan.mission import MissionGraph
from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.ocean.known import KnownObstacle
from auvplan.path.motion import Motion
from auvplan.records import MissionRun
from auvplan.site import Site
from benchmarks.alterations import KINDS, altered, possible
from tests.io.sample_run import WAYPOINTS, make_leg, make_run, refused_leg


def check(run, dataset=None):
    """Check a run, or a changed dataset of it, as it is written, without its way over the disk."""
    return check_dataset(
        json.loads(json.dumps(run.summary())), to_dataset(run) if dataset is None else dataset
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The sample run as it was saved."""
    return save_run(make_run(), tmp_path_factory.mktemp("written"))


@pytest.fixture
def saved(written, tmp_path):
    """A copy of the saved run, to be spoiled."""
    return Path(shutil.copytree(written, tmp_path / "saved"))


def edit_summary(folder, **changes):
    path = folder / "summary.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def moving_obstacle(run, track):
    """Replace the obstacles of the first leg by one of 10 m radius that is at `track` [n, 3]."""
    leg = run.legs[0]
    leg.obstacle_positions, leg.obstacle_radii = track[:, None], np.array([10.0])
    leg.obstacle_kinds = ["self-motivated"]


def test_good_run(tmp_path):
    run = make_run()
    save_run(run, tmp_path)
    report = check_run(tmp_path)
    assert report == check(run)
    assert report.ok, report
    assert report.collisions == 0
    assert report.legs == 3
    length = sum(np.linalg.norm(leg.positions[-1] - leg.positions[0]) for leg in run.legs)
    assert report.length == pytest.approx(length)
    assert 0 < report.obstacle_clearance < 200
    assert report.coast_clearance == pytest.approx(346.5, abs=0.1)
    assert "no faults" in str(report)


@pytest.fixture(scope="module")
def placed(tmp_path_factory):
    """Summary and dataset of the sample run at a site, with jobs, in a current of a file."""
    run, folder = make_run(), tmp_path_factory.mktemp("placed")
    run.site, run.folder = Site(148.9, -20.2), str(folder)
    (folder / "current.nc").write_bytes(b"CDF")
    run.scenario |= {"current": {"source": "file", "files": "current.nc"}}
    for leg in run.legs:
        leg.current = np.zeros((len(leg.times), 2))
    arrives = float(run.legs[0].times[-1])
    three_jobs(run, windows=((arrives - 5.0, arrives + 5.0),))
    summary = json.loads(json.dumps(run.summary()))
    assert check_dataset(summary, to_dataset(run)).ok
    return summary, to_dataset(run)


@pytest.mark.parametrize("kind", KINDS)
def test_an_altered_figure_is_found(kind, placed):
    assert possible(kind, placed[1])
    for draw in range(2):
        report = check_dataset(*altered(kind, *placed, np.random.default_rng(draw)))
        assert report.faults, f"draw {draw}"


@pytest.mark.parametrize("nodes", [(0, 1), (0, 1, 3, 2)])
def test_open_water_without_obstacles(nodes):
    report = check(make_run(nodes, chart=False, obstacles=False))
    assert report.ok, report
    assert np.isinf([report.coast_clearance, report.obstacle_clearance]).all()


def test_refused_leg_is_no_fault():
    run = make_run()
    run.legs.insert(1, refused_leg(run))
    report = check(run)
    assert report.ok, report
    assert report.legs == 3


def test_last_leg_unfinished():
    run = make_run()
    leg = run.legs[-1]
    leg.times, leg.positions = leg.times[:30], leg.positions[:30]
    leg.obstacle_positions, leg.arrived = leg.obstacle_positions[:30], False
    leg.motion = Motion(*(getattr(leg.motion, part.name)[:30] for part in fields(Motion)))
    run.t_mission, run.arrived = float(leg.times[-1]), False
    report = check(run)
    assert report.ok, report


def test_mission_that_never_began():
    run = make_run()
    run.legs, run.arrived, run.t_mission = [], False, 0.0
    assert check(run).ok


def test_land_between_two_samples_in_water():
    waypoints = WAYPOINTS.copy()
    waypoints[:2] = [[1500.0, 1400.0, 20.0], [1500.0, 1600.0, 20.0]]
    run = make_run((0, 1), waypoints=waypoints, obstacles=False, interval=16.0)
    leg = run.legs[0]
    assert run.chart.is_water(leg.positions[:, 0], leg.positions[:, 1]).all()
    assert run.collisions > 0
    report = check(run)
    assert report.coast_hits == 1
    assert report.coast_metres == pytest.approx(10.0, abs=1.0)
    assert report.coast_clearance == 0.0
    assert not report.ok
    assert "on land" in str(report)


def test_obstacle_hit_only_between_two_samples():
    run = make_run((0, 1))
    leg = run.legs[0]
    middle = len(leg.times) // 2
    across = np.array([-0.8, 0.6, 0.0])
    place = 0.5 * (leg.positions[middle] + leg.positions[middle + 1])
    steps = np.arange(len(leg.times)) - middle - 0.5
    moving_obstacle(run, place + 100.0 * steps[:, None] * across)
    assert run.collisions > 0
    report = check(run)
    assert report.obstacle_hits == 1
    assert report.obstacle_clearance == pytest.approx(-10.0, abs=0.6)
    assert not report.ok


def test_obstacle_that_passed_earlier_is_missed():
    run = make_run((0, 1))
    leg = run.legs[0]
    middle = len(leg.times) // 2
    across = np.array([-0.8, 0.6, 0.0])
    steps = np.arange(len(leg.times)) - middle + 10
    moving_obstacle(run, leg.positions[middle] + 10.0 * steps[:, None] * across)
    gaps = np.linalg.norm(leg.obstacle_positions - leg.positions[middle], axis=2)
    assert gaps.min() < 1e-6, "the obstacle does cross the route"
    report = check(run)
    assert report.ok, report
    assert report.obstacle_hits == 0
    assert report.obstacle_clearance > 10.0


def test_two_hits_are_two_events():
    run = make_run((0, 1))
    leg = run.legs[0]
    n = len(leg.times)
    leg.obstacle_positions = np.broadcast_to(leg.positions[[n // 3, 2 * n // 3]], (n, 2, 3)).copy()
    leg.obstacle_radii = np.array([20.0, 20.0])
    report = check(run)
    assert report.obstacle_hits == 2
    assert report.obstacle_metres == pytest.approx(80.0, abs=4.0)


def test_outside_the_chart():
    waypoints = WAYPOINTS + np.array([0.0, -400.0, 0.0])
    report = check(make_run((0, 1), waypoints=waypoints))
    assert any("outside the chart" in fault for fault in report.faults)
    assert report.coast_hits == 0


def test_above_the_surface():
    report = check(make_run(waypoints=WAYPOINTS - np.array([0.0, 0.0, 30.0])))
    assert any("above the surface" in fault for fault in report.faults)


def test_teleport():
    run = make_run()
    run.legs[0].positions[40:] += [300.0, 0.0, 0.0]
    report = check(run)
    assert any("too fast" in fault for fault in report.faults)
    assert any("ends off waypoint 1" in fault for fault in report.faults)
    assert any("from where the last leg ended" in fault for fault in report.faults)


def test_not_a_number_is_a_fault():
    run = make_run()
    run.legs[0].positions[40] = np.nan
    assert any("not a number" in fault for fault in check(run).faults)


def test_time_that_does_not_advance():
    run = make_run()
    run.legs[0].times[40] = run.legs[0].times[42]
    assert any("time does not advance" in fault for fault in check(run).faults)


def test_gap_between_legs():
    run = make_run()
    run.legs[1].times = run.legs[1].times - 5.0
    assert any("begins at" in fault for fault in check(run).faults)


def test_charged_planning_time():
    run = make_run()
    for leg in run.legs:
        leg.times = leg.times + 4.0
    run.t_mission += 4.0
    assert not check(run).ok
    run.charged_compute = 4.0
    report = check(run)
    assert report.ok, report


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"t_mission": 900.0}, "add up"),
        ({"t_residual": 1.0}, "t_residual"),
        ({"t_available": 9000.0}, "t_available"),
        ({"success": False}, "success"),
        ({"tasks": 5}, "tasks"),
        ({"total_priority": 50.0}, "tasks"),
        ({"total_priority": float("nan")}, "tasks"),
        ({"t_mission": float("nan")}, "add up"),
        ({"legs": []}, "legs in"),
    ],
)
def test_figures_that_do_not_add_up(saved, changes, words):
    edit_summary(saved, **changes)
    assert any(words in fault for fault in check_run(saved).faults)


def test_leg_time_in_the_summary(saved):
    rows = json.loads((saved / "summary.json").read_text())["legs"]
    rows[1]["t_path"] += 1.0
    edit_summary(saved, legs=rows)
    assert any("t_path is" in fault for fault in check_run(saved).faults)


def test_edge_used_twice():
    run = make_run((0, 1, 0, 3))
    assert any("taken before" in fault for fault in check(run).faults)


def test_unknown_edge():
    run = make_run((0, 2))
    assert any("no such edge" in fault for fault in check(run).faults)


def test_waypoint_skipped():
    run = make_run()
    run.legs = [run.legs[0], make_leg(run.graph, 3, 2, run.legs[1].times[0])]
    assert any("the vehicle is at 1" in fault for fault in check(run).faults)


def test_a_dropped_leg_is_found():
    run = make_run()
    del run.legs[1]
    assert any("begins at waypoint 3, the vehicle is at 1" in fault for fault in check(run).faults)


def test_claimed_arrival():
    run = make_run()
    run.goal = 1
    assert any("arrived is True" in fault for fault in check(run).faults)


def test_stolen_priority():
    run = make_run()
    run.legs[0].priority = 5.0
    assert any("counts a priority of 5" in fault for fault in check(run).faults)


@pytest.mark.parametrize("name", ["summary.json", "mission.nc"])
def test_missing_file(saved, name):
    (saved / name).unlink()
    with pytest.raises(ResultError, match=rf"{re.escape(name)}: no such file"):
        check_run(saved)


def test_missing_folder(tmp_path):
    with pytest.raises(ResultError, match="nowhere: no such folder"):
        check_run(tmp_path / "nowhere")


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.95])
def test_truncated_netcdf(saved, share):
    path = saved / "mission.nc"
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResultError, match=r"mission\.nc: not a readable NetCDF file") as raised:
        check_run(saved)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("text", ["", "{", "[1]", "\xff"])
def test_damaged_summary(saved, text):
    (saved / "summary.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ResultError, match=r"summary\.json: "):
        check_run(saved)


@pytest.mark.parametrize(
    "changes", [{"t_mission": "long"}, {"legs": 3}, {"cpu": {}}, {"legs": [{"from": 0}]}]
)
def test_incomplete_summary(saved, changes):
    edit_summary(saved, **changes)
    with pytest.raises(ResultError, match=r"summary\.json: "):
        check_run(saved)


@pytest.mark.parametrize("name", ["obstacle_radius", "time", "passability", "adjacency"])
def test_variable_missing(saved, name):
    path = saved / "mission.nc"
    with xr.open_dataset(path, engine="h5netcdf", decode_cf=False) as data:
        less = data.load().drop_vars(name)
    less.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(ResultError, match=rf"mission\.nc: variable {name} is missing"):
        check_run(saved)


def test_attribute_missing(saved):
    path = saved / "mission.nc"
    with xr.open_dataset(path, engine="h5netcdf", decode_cf=False) as data:
        less = data.load()
    del less.attrs["vehicle_speed"]
    less.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(ResultError, match="attribute vehicle_speed is missing"):
        check_run(saved)


def round_trip() -> MissionRun:
    """A run that comes back to waypoint 1 although 3 leads to the destination."""
    run = make_run((1, 0, 3, 1, 2))
    run.legs[2].revisit = True
    return run


def test_a_waypoint_visited_twice_is_found():
    report = check(round_trip())
    assert any("waypoint 1 is visited twice" in fault for fault in report.faults), report


def test_waypoints_may_be_visited_again_where_the_rule_allows_it():
    run = round_trip()
    run.scenario |= {"planning": {"visits": "edges"}}
    assert check(run).ok


def test_a_visited_waypoint_may_be_passed_on_the_only_way():
    """Without the edge from 3 to 2 nothing else is left; but its task does not count again."""
    run = round_trip()
    run.graph.adjacency[3, 2] = run.graph.adjacency[2, 3] = False
    report = check(run)
    assert [fault.split(": ", 1)[1][:20] for fault in report.faults[:1]] == ["counts a priority of"]
    leg = run.legs[2]
    run.t_mission -= leg.t_task
    run.legs[3].times = run.legs[3].times - leg.t_task
    leg.priority = leg.t_task = 0.0
    for route in run.routes:  # it was known beforehand
        route.priority -= 3.0
    report = check(run)
    assert report.ok, report


def with_jobs(run, *jobs):
    """The run as one of these jobs."""
    points = tuple(job for job in jobs if isinstance(job, JobPoint))
    lines = tuple(job for job in jobs if isinstance(job, JobLine))
    run.jobs, run.names = Jobs(points, lines), ["start", "gauge", "goal", "wreck"]
    return run


def three_jobs(run, priority=3.0, duration=60.0, windows=()):
    """The run as one of three tasks at places, of which that at the gauge is such."""
    worth, lasts = np.array([0.0, 3.0, 3.0, 3.0]), np.array([0.0, 60.0, 60.0, 60.0])
    whole = [np.where(run.graph.adjacency, values, 0.0) for values in (worth, lasts)]
    run.graph = MissionGraph(
        run.graph.positions, run.graph.adjacency, *whole, waypoint_priority=worth, waypoint_duration=lasts
    )
    return with_jobs(
        run,
        JobPoint("gauge", (700.0, 900.0, 40.0), priority, duration, windows),
        JobPoint("wreck", (400.0, 1200.0, 25.0), 3.0, 60.0),
        JobPoint("end", (1000.0, 1800.0, 30.0), 3.0, 60.0),
    )


@pytest.mark.parametrize(
    ("gauge", "found"),
    [
        ((3.0, 60.0), ""),
        ((2.0, 60.0), "its tasks are worth 2"),
        ((2.0, 60.0), "job 'gauge': its priority is 2, 3 in the graph"),
        ((3.0, 50.0), "on tasks that take 50.00 s"),
        ((3.0, 50.0), "job 'gauge': its duration is 50, 60 in the graph"),
    ],
)
def test_jobs_are_counted_as_they_were_planned_for(gauge, found):
    """Whatever legs and graph say: what a place is worth stands in the jobs."""
    report = check(three_jobs(make_run(), *gauge))
    assert report.ok == (not found), report
    assert found in str(report)


def test_two_tasks_that_were_swapped_are_found():
    run = three_jobs(make_run())
    gauge, wreck, end = run.jobs.points
    places = replace(gauge, position=wreck.position), replace(wreck, position=gauge.position)
    run.jobs = Jobs((*places, end))
    assert "job 'gauge' is not where the graph has it" in str(check(run))


def test_a_survey_line_counts_when_all_of_it_is_done():
    survey = JobLine("survey", tuple(map(tuple, WAYPOINTS[[0, 1, 3]].tolist())), 9.0, 180.0)
    run = with_jobs(make_run((0, 1, 3)), survey)
    lengths = np.linalg.norm(np.diff(WAYPOINTS[[0, 1, 3]], axis=0), axis=1)
    for leg, share in zip(run.legs, lengths / lengths.sum(), strict=True):
        leg.priority, late = 9.0 * float(share), 180.0 * float(share) - leg.t_task
        run.graph.priority[leg.start, leg.goal] = leg.priority
        run.graph.duration[leg.start, leg.goal] = 180.0 * float(share)
        leg.t_task += late
        run.t_mission += late
    run.legs[1].times = run.legs[1].times + run.legs[0].t_task - 60.0
    run.names = ["survey[1]", "survey[2]", "goal", "survey[3]"]
    run.routes[0].priority, run.routes[1].priority = 9.0, run.legs[1].priority
    run.saved_bound = 9.0
    report = check(run)
    assert report.ok, report
    assert run.summary()["tasks"] == 1
    run.jobs = Jobs((), (replace(survey, priority=8.0),))
    assert "job 'survey': its priority is 8, 9 in the graph" in str(check(run))


def test_a_run_without_what_it_was_made_from_gets_notes():
    """Older runs did not keep it: they are checked as far as that goes."""
    run = make_run()
    run.scenario |= {
        "mission": {"jobs": "jobs.csv"},
        "chart": {"no_go": "no_go.geojson"},
        "obstacles": {"file": "buoys.geojson"},
        "current": {"source": "file"},
    }
    dataset = to_dataset(run)
    for name in ("jobs", "closures", "known_obstacles", "sources"):
        del dataset.attrs[name]
    report = check(run, dataset)
    assert report.ok, report
    for words in ("jobs", "hours of closed areas", "known obstacles", "current along the track", "digests"):
        assert sum(words in note and "not saved" in note for note in report.notes) == 1


@pytest.mark.parametrize("change", ["", "x", "same size", "gone", "folder"])
def test_a_file_beside_the_run_is_the_one_that_it_was_made_from(tmp_path, change):
    run, file = make_run(), tmp_path / "current.nc"
    if change == "folder":
        file = tmp_path / "cells" / "A.000"
        file.parent.mkdir()
    file.write_bytes(b"CDF 0.5 m/s")
    run.scenario |= {"current": {"files": "cells" if change == "folder" else "current.nc", "source": "file"}}
    run.folder = str(tmp_path)
    dataset = to_dataset(run)
    written = {"": b"CDF 0.5 m/s", "x": b"CDF 0.55 m/s"}.get(change, b"CDF 0.7 m/s")
    file.write_bytes(written)
    os.utime(file, (2e9, 2e9))
    if change == "gone":
        file.unlink()
    report = check(run, dataset)
    name = "cells" if change == "folder" else "current.nc"
    changed = f"current.files: {name} is not the file that the run was made from"
    assert (report.faults == [changed]) == (change not in ("", "gone")), report
    assert any("not there any more" in note for note in report.notes) == (change == "gone")


@pytest.mark.parametrize(("wrong", "found"), [(0.0, 0), (0.02, 0), (0.05, 1)])
def test_the_speed_through_the_water_is_the_vehicles(wrong, found):
    """The sample run is in still water; its file says that there is a current."""
    run = make_run()
    for leg in run.legs:
        leg.current = np.zeros((len(leg.times), 2))
    run.legs[1].current[30] = np.nan, wrong  # what is not known is not looked at
    run.legs[1].current[40] = 0.0, wrong
    faults = check(run).faults
    assert len(faults) == found
    assert all("leg 1" in fault and "in a current of" in fault for fault in faults)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        ({"site_epoch": "2026-03-01T07:00:00+00:00"}, "+3600 s off the scenario's departure"),
        ({"departed": 3600.0}, ""),  # the stated departure is the one planned for
        ({"site_longitude": 150.0}, "site_longitude is 150, the scenario says 149"),
        ({"site_origin": np.array([100.0, 0.0])}, "site_origin"),
    ],
)
def test_a_run_is_where_and_when_its_scenario_says(changes, words):
    run = make_run()
    dataset = to_dataset(run)
    site = {"longitude": 149.0, "latitude": -20.0, "origin": [0.0, 0.0], "departure": "2026-03-01T06:00:00Z"}
    dataset.attrs["scenario"] = json.dumps(json.loads(dataset.attrs["scenario"]) | {"site": site})
    dataset.attrs |= {
        "site_longitude": 149.0, "site_latitude": -20.0, "site_origin": np.zeros(2),
        "site_epoch": "2026-03-01T06:00:00+00:00",
    } | changes  # fmt: skip
    faults = [fault for fault in check(run, dataset).faults if "scenario" in fault]
    assert len(faults) == bool(words)
    assert all(words in fault for fault in faults)


def with_known_obstacle(run, x, y, velocity=(0.0, 0.0), **properties):
    """The dataset of a run with one obstacle that was known, at local places, m."""
    run.obstacles = (KnownObstacle("buoy", (x, y), velocity=velocity, **properties),)
    return to_dataset(run)


@pytest.mark.parametrize(
    ("aside", "depths", "clearance"),
    [
        (0.0, {}, -50.0),
        (30.0, {}, -20.0),
        (90.0, {}, 40.0),
        (0.0, {"depth_max": 10.0}, 20.0),  # the leg passes 20 m under it
        (80.0, {"depth_max": 10.0}, np.hypot(30.0, 20.0)),
        (0.0, {"depth_min": 45.0}, 15.0),  # and here over it
    ],
)
def test_known_obstacles_are_upright_cylinders(aside, depths, clearance):
    run = make_run((0, 1), chart=False, obstacles=False)
    (leg,) = run.legs
    leg.positions = np.linspace([0.0, 0.0, 30.0], [1000.0, 0.0, 30.0], len(leg.times))
    dataset = with_known_obstacle(run, 500.0, aside, radius=50.0, **depths)
    report = check(run, dataset)
    assert report.obstacle_clearance == pytest.approx(clearance, abs=0.6)
    assert report.obstacle_hits == (clearance < 0.0)
    within = 2.0 * np.sqrt(max(50.0**2 - aside**2, 0.0)) if clearance < 0.0 else 0.0
    assert report.obstacle_metres == pytest.approx(within, abs=4.0)
    assert any("inside 'buoy'" in fault for fault in report.faults) == (clearance < 0.0)


def test_known_obstacles_move():
    """One that crosses the way behind the vehicle is missed, one that meets it is not."""
    run = make_run((0, 1), chart=False, obstacles=False)
    (leg,) = run.legs
    leg.positions = np.linspace([0.0, 0.0, 30.0], [1000.0, 0.0, 30.0], len(leg.times))
    half = float(leg.times[0] + leg.times[-1]) / 2.0
    for east, hit in ((-half, True), (-half - 200.0, False)):
        dataset = with_known_obstacle(run, 500.0, east, radius=20.0, velocity=(0.0, 1.0))
        report = check(run, dataset)
        assert (report.obstacle_hits > 0) == hit


BAND = "POLYGON ((400 -900, 400 900, 600 900, 600 -900, 400 -900))"


def in_a_band_that_closes(opens, closes, track=(0.0, 1000.0), departs=0.0, hold=0.0, wait=0.0):
    """The dataset of a leg of 1,000 s due north through a band, 400 to 600 m, that is closed so long."""
    run = make_run((0, 1), chart=False, obstacles=False)
    (leg,) = run.legs
    leg.times = np.linspace(departs, departs + 1000.0, len(leg.times))
    leg.positions = np.linspace([track[0], 0.0, 30.0], [track[1], 0.0, 30.0], len(leg.times))
    leg.t_hold, leg.t_wait, leg.t_task = hold, wait, 300.0
    dataset = to_dataset(run)
    dataset.attrs["closures"] = json.dumps([{"name": "band", "area": BAND, "closed": [[opens, closes]]}])
    return check(run, dataset)


def test_an_area_that_is_always_closed_is_land():
    run = make_run((0, 1), obstacles=False)
    dataset = to_dataset(run)
    dataset.attrs["closed_areas"] = json.dumps([["range", BAND]])
    report = check(run, dataset)
    assert report.coast_hits == 1
    # The leg goes 400 m north and 600 m east, from 300 m north on: it is in the band for half of it.
    assert report.coast_metres == pytest.approx(200.0 * np.linalg.norm([400.0, 600.0, 20.0]) / 400.0, abs=2.0)
    assert "in the closed area 'range'" in str(report)
    dataset["passability"][40:60] = 0  # what both know counts once
    assert check(run, dataset).coast_hits == 1


@pytest.mark.parametrize(
    ("opens", "closes", "met"),
    [(0, 390, False), (610, 2000, False), (0, 410, True), (590, 700, True), (450, 455, True)],
)
def test_a_leg_is_not_in_an_area_while_it_is_closed(opens, closes, met):
    report = in_a_band_that_closes(opens, closes)
    assert any("in the closed area 'band'" in fault for fault in report.faults) == met


@pytest.mark.parametrize(
    ("opens", "wait", "met"),
    [(1301, 0.0, False), (1299, 0.0, True), (1401, 100.0, False), (1399, 100.0, True)],
)
def test_a_task_is_not_done_in_an_area_that_closes_meanwhile(opens, wait, met):
    """The leg ends in the band at 1,000 s; its task takes 300 s, after a wait."""
    report = in_a_band_that_closes(opens, 5000, track=(0.0, 500.0), wait=wait)
    assert any("stays in the closed area 'band'" in fault for fault in report.faults) == met


@pytest.mark.parametrize(("closes", "met"), [(299, False), (301, True)])
def test_a_vehicle_does_not_wait_in_a_closed_area_before_its_leg(closes, met):
    """The leg leaves the band at 500 s, after a wait of 200 s."""
    report = in_a_band_that_closes(0, closes, track=(500.0, 1000.0), departs=500.0, hold=200.0)
    assert any("stays in the closed area 'band'" in fault for fault in report.faults) == met


def test_the_hours_of_a_leg_in_another_place_do_not_matter():
    """The leg begins and ends outside the band, where it may stay."""
    report = in_a_band_that_closes(1100, 1400, hold=0.0, wait=100.0)
    assert not any("closed area" in fault for fault in report.faults)
