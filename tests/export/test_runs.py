"""From a run to an itinerary: which plan, which legs, names, thinning and fences."""

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely

from auvplan.export import (
    Circle,
    ExportError,
    Itinerary,
    PlannedLeg,
    Polygon,
    Track,
    itinerary_of,
    itinerary_of_parts,
)
from auvplan.export.itinerary import waypoints
from auvplan.ocean.known import KnownObstacle
from auvplan.site import Site
from tests.io.sample_run import make_run, refused_leg

SITE = Site(148.96, -20.34)


@pytest.fixture(scope="module")
def itinerary() -> Itinerary:
    run = make_run()
    run.legs.insert(1, refused_leg(run))
    run.names = ["alpha", "bravo"]
    north, east, _ = run.legs[0].obstacle_positions[0, 0]
    run.obstacles = (
        KnownObstacle("rock", (float(north), float(east)), 35.0),
        KnownObstacle("ferry", (300.0, 300.0), 30.0, velocity=(1.0, 0.0)),
    )
    return itinerary_of(run, SITE)


def test_legs_that_arrived_are_numbered_in_order(itinerary: Itinerary):
    assert [(leg.number, leg.start, leg.goal) for leg in itinerary.legs] == [(1, 0, 1), (2, 1, 3), (3, 3, 2)]
    assert [leg.start_name for leg in itinerary.legs] == ["alpha", "bravo", "waypoint 3"]
    assert [leg.hold for leg in itinerary.legs] == [60.0, 60.0, 60.0]
    assert [leg.priority for leg in itinerary.legs] == [3.0, 3.0, 3.0]
    assert len(itinerary.executed) == 3
    assert (itinerary.name, itinerary.seed, itinerary.speed) == ("sample", 7, 2.5)
    assert json.loads(itinerary.configuration)["name"] == "sample"


def test_tasks_and_waiting_before_and_after_them_have_their_own_durations():
    run = make_run()
    run.legs[0] = replace(run.legs[0], t_wait=1025.0)
    run.legs[1] = replace(run.legs[1], t_task=0.0, priority=0.0)
    run.legs[2] = replace(run.legs[2], t_hold=154.0)
    itinerary = itinerary_of(run, SITE)
    assert [leg.hold for leg in itinerary.legs] == [1085.0, 154.0, 60.0]
    first, second, third = (row.task for row in waypoints(itinerary) if row.ends_leg)
    assert first == "wait of 1025 s, then task of priority 3, 60 s"
    assert second == "wait of 154 s"
    assert third == "task of priority 3, 60 s"
    run.legs[1] = replace(run.legs[1], t_task=60.0, priority=3.0)
    run.legs[2] = replace(run.legs[2], t_hold=154.0, t_fix=100.0)
    tasks = [row.task for row in waypoints(itinerary_of(run, SITE)) if row.ends_leg]
    assert tasks[1] == "task of priority 3, 60 s, then wait of 54 s, then surfacing for a fix, 100 s"


def test_waypoints_are_few_samples_of_the_plan(itinerary: Itinerary):
    run = make_run()
    for leg, record in zip(itinerary.legs, run.done, strict=True):
        plan = record.plans[0]
        assert leg.positions == pytest.approx(plan.positions)
        assert 2 <= len(leg.kept) < 10
        assert leg.waypoints == pytest.approx(plan.positions[leg.kept])
        assert abs(leg.time_change) < 0.02
        assert leg.note.startswith(f"leg {leg.number}: {len(leg.kept)} of 32 samples")
    kept = sum(len(leg.kept) for leg in itinerary.legs)
    assert f"{kept} of 96 samples" in itinerary.description


@pytest.mark.parametrize("asked", [150.0, 190.0, 400.0])
def test_straight_lines_keep_the_distances_of_the_run_or_of_the_path(asked: float):
    """Chords of the arcs that it goes in come 13 to 55 m nearer to what stands beside them."""
    run = make_run()
    run.scenario = run.scenario | {"safety": {"obstacles": asked}}
    for leg in run.legs:
        leg.obstacle_positions, leg.obstacle_radii = leg.obstacle_positions[:, :1], leg.obstacle_radii[:1]
    for leg, record in zip(itinerary_of(run, SITE).legs, run.done, strict=True):
        rock = shapely.Point(record.obstacle_positions[0, 0, :2])
        whole, lines = (shapely.LineString(part[:, :2]) for part in (leg.positions, leg.waypoints))
        assert lines.distance(rock) - 40.0 > min(asked, whole.distance(rock) - 40.0) - 0.2
        assert asked > 150.0 or len(leg.kept) < 4


def test_fences_are_the_spit_and_known_obstacles_that_stand_still(itinerary: Itinerary):
    circles = [fence for fence in itinerary.fences if isinstance(fence, Circle)]
    polygons = [fence for fence in itinerary.fences if isinstance(fence, Polygon)]
    assert len(polygons) == 1  # the spit: longer than an islet
    assert [circle.radius for circle in circles] == [35.0]  # none of those that the simulator drew
    assert any("ferry" in note for note in itinerary.notes)
    assert any("simulated" in note for note in itinerary.notes)


def test_a_run_that_executed_nothing_cannot_be_exported():
    run = make_run()
    run.legs = [refused_leg(run)]
    with pytest.raises(ExportError, match="sample: no leg was planned and executed"):
        itinerary_of(run, SITE)


def test_a_mission_that_was_not_begun_is_made_of_plain_arrays():
    places = np.array([[0.0, 0.0, 5.0], [500.0, 20.0, 8.0], [900.0, 300.0, 5.0]])
    leg = PlannedLeg.of(1, 4, 2, places, [0.0, 250.0, 490.0], names=["a", "b", "c"])
    assert (leg.start_name, leg.goal_name) == ("waypoint 4", "c")
    rock = ((400.0, 900.0, 10.0), 50.0, "rock")
    made = itinerary_of_parts("m", SITE, 2.0, [leg], obstacles=[rock], version="1.2", notes=["kept"])
    assert made.fences == (Circle((400.0, 900.0), 50.0, "rock"),)
    assert (made.version, made.notes, made.executed) == ("1.2", ("kept",), ())
    assert leg.waypoints is not places
    assert len(leg.kept) == 3


@pytest.mark.parametrize(
    ("positions", "times", "message"),
    [
        (np.zeros((3, 2)), np.zeros(3), r"leg 5: positions must be \[n, 3\]"),
        (np.zeros((3, 3)), np.zeros(2), r"leg 5: positions must be \[n, 3\]"),
        (np.full((2, 3), np.nan), np.zeros(2), "leg 5: positions and times must be finite"),
        (np.zeros((2, 3)), [1.0, 0.0], "leg 5: times must not go back"),
        (np.zeros((1, 3)), [1.0], "leg 5: a path has at least two samples"),
    ],
)
def test_faulty_legs_are_refused_in_one_line(positions, times, message):
    with pytest.raises(ExportError, match=message):
        PlannedLeg.of(5, 0, 1, positions, times)


def test_faulty_executed_tracks_are_refused(itinerary: Itinerary):
    track = Track(np.array([0.0, np.inf]), np.zeros((2, 3)))
    with pytest.raises(ExportError, match="executed track 0"):
        replace(itinerary, executed=(track,))
