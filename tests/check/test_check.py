"""The independent checker finds what is wrong, and only that."""

import json
import os
import re
import shutil
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from auvplan.check.run import ResultError, check_dataset, check_run
from auvplan.check.saved import require
from auvplan.io import save_run
from auvplan.io.results import to_dataset
from auvplan.mission import MissionGraph
from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.seabed import Seabed
from auvplan.path.motion import Motion
from auvplan.records import Promise, TurnBack
from auvplan.site import Site
from benchmarks.alterations import KINDS, POSITIONS, altered, possible
from tests.io.sample_run import WAYPOINTS, make_run, refused_leg

#: 950 of 1,000 seas, with Wilson's interval.
PROMISE = Promise(0.9, 0.95, 0.934686, 0.961870, 1000, 1, (1.0, 2.0, 3.0), 0.0, (100.0,), 3.0)


def check(run, dataset=None):
    """Check a run, or a changed dataset of it, as it is written, without its way over the disk."""
    return check_dataset(
        json.loads(json.dumps(run.summary())), to_dataset(run) if dataset is None else dataset
    )


def over_a_bed():
    run = make_run()
    run.seabed = Seabed.from_depth(np.full((50, 50), 60.0), 40.0, (0.0, 0.0), clearance=5.0)
    return run


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The sample run as it was saved."""
    return save_run(over_a_bed(), tmp_path_factory.mktemp("written"))


def test_good_run(written):
    run = over_a_bed()
    report = check_run(written)
    assert report == check(run)
    assert report.ok, report
    assert report.collisions == 0
    assert report.legs == 3
    length = sum(np.linalg.norm(leg.positions[-1] - leg.positions[0]) for leg in run.legs)
    assert report.length == pytest.approx(length)
    assert 0 < report.obstacle_clearance < 200
    assert report.coast_clearance == pytest.approx(346.5, abs=0.1)
    assert report.seabed_altitude == pytest.approx(20.0, abs=1e-3)  # the deepest waypoint lies at 40 m
    assert "sea bed 20.0 m" in str(report)
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
    run.promise = PROMISE
    summary = json.loads(json.dumps(run.summary()))
    assert check_dataset(summary, to_dataset(run)).ok
    return summary, to_dataset(run)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in POSITIONS])
def test_an_altered_figure_is_found(kind, placed):
    assert possible(kind, placed[1])
    for draw in range(2):
        report = check_dataset(*altered(kind, *placed, np.random.default_rng(draw)))
        assert report.faults, f"draw {draw}"


def test_a_promise_that_is_not_kept_is_no_success():
    run = make_run()
    run.promise = replace(PROMISE, asked=0.96)
    assert not run.summary()["success"]
    assert check(run).ok
    dataset = to_dataset(run)
    (fault,) = check_dataset(run.summary() | {"success": True}, dataset).faults
    assert "the promise" in fault


@pytest.mark.parametrize("nodes", [(0, 1), (0, 1, 3, 2)])
def test_open_water_without_obstacles(nodes):
    report = check(make_run(nodes, chart=False, obstacles=False))
    assert report.ok, report
    assert np.isinf([report.coast_clearance, report.obstacle_clearance, report.seabed_altitude]).all()


def test_an_obstacle_that_found_no_room_is_near_nothing():
    """The simulator puts it a thousand kilometres away, so that all legs have as many."""
    run = make_run((0, 1))
    moving_obstacle(run, run.legs[0].positions + 1e6)
    assert np.isinf(check(run).obstacle_clearance)


def with_a_refused_leg():
    run = make_run()
    run.legs.insert(1, refused_leg(run))
    return run


def unfinished():
    run = make_run()
    leg = run.legs[-1]
    leg.times, leg.positions = leg.times[:30], leg.positions[:30]
    leg.obstacle_positions, leg.arrived = leg.obstacle_positions[:30], False
    leg.motion = Motion(*(getattr(leg.motion, part.name)[:30] for part in fields(Motion)))
    run.t_mission, run.arrived = float(leg.times[-1]), False
    return run


def never_begun():
    run = make_run()
    run.legs, run.arrived, run.t_mission = [], False, 0.0
    return run


def delayed(charged=0.0):
    """All legs 4 s later, for planning."""
    run = make_run()
    for leg in run.legs:
        leg.times = leg.times + 4.0
    run.t_mission, run.charged_compute = run.t_mission + 4.0, charged
    return run


def round_trip(visits="nodes"):
    """A run that comes back to waypoint 1 although 3 leads to the destination."""
    run = make_run((1, 0, 3, 1, 2))
    run.legs[2].revisit = True
    if visits == "edges":
        run.scenario |= {"planning": {"visits": visits}}
    return run


@pytest.mark.parametrize(
    ("make", "legs"),
    [(with_a_refused_leg, 3), (unfinished, 3), (never_begun, 0), (lambda: delayed(4.0), 3),
     (lambda: round_trip("edges"), 4)],
)  # fmt: skip
def test_what_is_no_fault(make, legs):
    report = check(make())
    assert report.ok, report
    assert report.legs == legs


def edited(path, change):
    """What makes the sample run with one attribute changed, such as legs.0.times."""

    def make():
        run = holder = make_run()
        *parents, name = path.split(".")
        for part in parents:
            holder = holder[int(part)] if part.isdigit() else getattr(holder, part)
        setattr(holder, name, change(getattr(holder, name)))
        return run

    return make


def put(index, value):
    def change(values):
        values[index] = value(values) if callable(value) else value
        return values

    return change


FAULTS = {
    "outside the chart": (lambda: make_run((0, 1), waypoints=WAYPOINTS - [0.0, 400.0, 0.0]),
                          "outside the chart"),
    "in the air": (lambda: make_run(waypoints=WAYPOINTS - [0.0, 0.0, 30.0]), "above the surface"),
    "teleport": (edited("legs.0.positions", put(np.s_[40:], lambda at: at[40:] - [-300.0, 0.0, 0.0])),
                 "too fast", "ends off waypoint 1", "from where the last leg ended"),
    "no number": (edited("legs.0.positions", put(40, np.nan)), "a position is not a number"),
    "a time stands still": (edited("legs.0.times", put(40, lambda times: times[42])),
                            "time does not advance"),
    "a gap between legs": (edited("legs.1.times", lambda times: times - 5.0), "begins at"),
    "planning that nobody counts": (delayed, "begins at"),
    "an edge twice": (lambda: make_run((0, 1, 0, 3)), "taken before"),
    "an edge that is none": (lambda: make_run((0, 2)), "no such edge"),
    "a waypoint that is none": (edited("legs.1.goal", lambda goal: 9), "no such edge"),
    "a leg left out": (edited("legs", lambda legs: legs[:1] + legs[2:]),
                       "begins at waypoint 3, the vehicle is at 1"),
    "a waypoint twice": (round_trip, "waypoint 1 is visited twice"),
    "another goal": (edited("goal", lambda goal: 1), "arrived is True"),
    "stolen priority": (edited("legs.0.priority", lambda worth: 5.0), "counts a priority of 5"),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS)
def test_what_cannot_have_been_is_a_fault(case):
    make, *words = FAULTS[case]
    report = check(make())
    assert report.coast_hits == 0
    for part in words:
        assert any(part in fault for fault in report.faults), report


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


def test_ways_home_are_looked_at():
    """A way home along the first leg's track is as good as that; others lead over land or off the chart."""
    run = over_a_bed()
    good = run.legs[0].positions
    land = 10.0 * np.argwhere(np.asarray(run.chart.passability) == 0.0)[0] + 5.0
    ashore = np.asarray([good[0], [*land, 20.0], good[-1]])
    deep, off = np.add(good, [0.0, 0.0, 50.0]), np.asarray([good[0], [-50.0, 500.0, 20.0]])
    for places, words in (
        (good, ""),
        (ashore, "on land"),
        (off, "outside the chart"),
        (deep, "below the sea bed"),
    ):
        turn = TurnBack(0, 100.0, 0.5, 60.0, tuple(map(tuple, places.tolist())))
        run.promise = Promise(
            0.9, 0.95, 0.934686, 0.961870, 1000, 1, (1.0, 2.0, 3.0), 0.0, (100.0,), 3.0, (turn,)
        )
        faults = check(run).faults
        assert bool(faults) == bool(words)
        assert all(fault.startswith("path if late after leg 0") for fault in faults)
        assert not words or any(words in fault for fault in faults)


def moving_obstacle(run, track):
    """Replace the obstacles of the first leg by one of 10 m radius that is at `track` [n, 3]."""
    leg = run.legs[0]
    leg.obstacle_positions, leg.obstacle_radii = track[:, None], np.array([10.0])
    leg.obstacle_kinds = ["self-motivated"]


@pytest.mark.parametrize(("late", "speed", "hits"), [(0.5, 100.0, 1), (-10.0, 10.0, 0)])
def test_an_obstacle_that_crosses_the_track(late, speed, hits):
    """It is hit though only between two samples, and missed where it passed ten samples earlier."""
    run = make_run((0, 1))
    leg = run.legs[0]
    middle = len(leg.times) // 2
    place = leg.positions[middle] + max(late, 0.0) * (leg.positions[middle + 1] - leg.positions[middle])
    steps = np.arange(len(leg.times)) - middle - late
    moving_obstacle(run, place + speed * steps[:, None] * np.array([-0.8, 0.6, 0.0]))
    report = check(run)
    assert report.obstacle_hits == hits == (not report.ok)
    if hits:
        assert run.collisions > 0
        assert report.obstacle_clearance == pytest.approx(-10.0, abs=0.6)
    else:
        gaps = np.linalg.norm(leg.obstacle_positions - leg.positions[middle], axis=2)
        assert gaps.min() < 1e-6, "the obstacle does cross the route"
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
        ({"t_path": 1.0}, "t_path is"),
    ],
)
def test_figures_that_do_not_add_up(changes, words):
    run = make_run()
    summary = run.summary()
    (summary["legs"][1] if "t_path" in changes else summary).update(changes)
    assert any(words in fault for fault in check_dataset(summary, to_dataset(run)).faults)


def cut(share):
    """What leaves a share of a file."""
    return lambda path: path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


def without(name, attribute=False):
    """What takes a variable or an attribute out of a file."""

    def change(path):
        with h5py.File(path, "r+") as file:
            del (file.attrs if attribute else file)[name]

    return change


BED = "seabed_depth", "seabed_origin", "seabed_pixel_size"
SPOILED = [
    *(("summary.json", lambda path, text=text: path.write_bytes(text), "")
      for text in (b"", b"{", b"[1]", b"\xff")),
    *((name, Path.unlink, "no such file") for name in ("summary.json", "mission.nc")),
    *(("mission.nc", cut(share), "not a readable NetCDF file") for share in (0.0, 0.01, 0.5, 0.95)),
    *(("mission.nc", without(name), f"variable {name} is missing") for name in ("adjacency", *BED)),
    *(("mission.nc", without(name, attribute=True), f"attribute {name} is missing")
      for name in ("vehicle_speed", "seabed_clearance")),
]  # fmt: skip


@pytest.mark.parametrize(("name", "spoil", "words"), SPOILED)
def test_what_is_damaged_or_missing_is_named_in_one_line(written, tmp_path, name, spoil, words):
    saved = Path(shutil.copytree(written, tmp_path / "saved"))
    spoil(saved / name)
    with pytest.raises(ResultError, match=rf"{re.escape(name)}: {words}") as raised:
        check_run(saved)
    assert "\n" not in str(raised.value)
    with pytest.raises(ResultError, match="nowhere: no such folder"):
        check_run(saved / "nowhere")


def test_incomplete_runs():
    run = make_run()
    summary, dataset = run.summary(), to_dataset(run)
    for changes in ({"t_mission": "long"}, {"legs": 3}, {"cpu": {}}, {"legs": [{"from": 0}]}):
        with pytest.raises(ResultError, match=r"run/summary\.json: "):
            require(summary | changes, dataset, Path("run"))
    for name in ("obstacle_radius", "time", "passability", "adjacency"):
        with pytest.raises(ResultError, match=rf"run/mission\.nc: variable {name} is missing"):
            require(summary, dataset.drop_vars(name), Path("run"))


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
    run.jobs, run.names = Jobs(points, lines), ["start", *(point.name for point in points)]
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
        JobPoint("end", (1000.0, 1800.0, 30.0), 3.0, 60.0),
        JobPoint("wreck", (400.0, 1200.0, 25.0), 3.0, 60.0),
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
    gauge, end, wreck = run.jobs.points
    run.jobs = Jobs((replace(gauge, position=wreck.position), end, replace(wreck, position=gauge.position)))
    assert "job 'gauge' is not where the graph has it" in str(check(run))


def along_a_line(vertices):
    """A run along a survey line of two parts."""
    survey = JobLine("survey", tuple(map(tuple, WAYPOINTS[vertices].tolist())), 9.0, 180.0)
    places = np.array([[300.0, 250.0, 20.0], *survey.positions, [400.0, 1250.0, 25.0]])
    run = with_jobs(make_run((0, 1, 2, 3, 4), waypoints=places), survey)
    lengths, late = np.linalg.norm(np.diff(survey.positions, axis=0), axis=1), 0.0
    for leg, share in zip(run.legs, [0.0, *(lengths / lengths.sum()).tolist(), 0.0], strict=True):
        leg.times, late = leg.times + late, late + 180.0 * share - leg.t_task
        leg.priority, leg.t_task = 9.0 * share, 180.0 * share
        run.graph.priority[leg.start, leg.goal] = leg.priority
        run.graph.duration[leg.start, leg.goal] = leg.t_task
    run.t_mission += late
    run.names = ["start", "survey[1]", "survey[2]", "survey[3]", "goal"]
    run.routes[0].priority = run.routes[1].priority = 9.0
    run.routes[1].made_at = float(run.legs[1].times[0])
    run.saved_bound = 9.0
    return run


@pytest.mark.parametrize("vertices", [[0, 1, 3], [0, 1, 0]])
def test_a_survey_line_counts_when_all_of_it_is_done(vertices):
    run = along_a_line(vertices)
    report = check(run)
    assert report.ok, report
    assert run.summary()["tasks"] == 1
    run.jobs = Jobs((), (replace(run.jobs.lines[0], priority=8.0),))
    assert "job 'survey': its priority is 8, 9 in the graph" in str(check(run))


def test_of_two_parts_of_a_line_in_one_place_a_leg_does_its_own():
    run = along_a_line([0, 1, 0])
    run.legs[1].priority, run.legs[2].priority = 9.0, 0.0
    found = [fault for fault in check(run).faults if "counts a priority of" in fault]
    assert found == [
        "leg 1 (1 to 2): counts a priority of 9, its tasks are worth 4.5",
        "leg 2 (2 to 3): counts a priority of 0, its tasks are worth 4.5",
    ]


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
