"""The checker at its limits: just within them it finds nothing, just beyond them it does."""

from dataclasses import replace

import numpy as np
import pytest

from auvplan.check.run import check_dataset
from auvplan.io.results import to_dataset
from auvplan.path.motion import Motion
from auvplan.vehicle import Vehicle
from tests.check.test_check import check, in_a_band_that_closes, three_jobs, with_known_obstacle
from tests.check.test_check_seabed import over
from tests.io.sample_run import SPEED, make_run, refused_leg

#: m/s that a vehicle of the sample run makes good in the fastest current that there is.
FASTEST = SPEED + 5.0


def along(positions, times, obstacles=(), radii=()):
    """The sample run, its one leg along positions [n, 3] at times [n], past obstacles [M, 3] that stand."""
    run = make_run((0, 1), chart=False, obstacles=False)
    (leg,) = run.legs
    count = len(positions)
    leg.positions, leg.times = np.asarray(positions, float), np.asarray(times, float)
    leg.motion = Motion.through_water(np.zeros((count, 3)), np.zeros(3))
    places = np.asarray(obstacles, float).reshape(1, -1, 3)
    leg.obstacle_positions = np.broadcast_to(places, (count, *places.shape[1:])).copy()
    leg.obstacle_radii, leg.obstacle_kinds = np.asarray(radii, float), ["static"] * len(radii)
    return run


def due_north(metres=200.0, depth=30.0, step=10.0, speed=2.0, **obstacles):
    """A leg due north along a line through the origin."""
    north = np.arange(0.0, metres + 1e-6, step)
    positions = np.c_[north, np.zeros_like(north), np.full_like(north, depth)]
    return along(positions, north / speed, **obstacles)


def faults(run, words):
    """Faults of a run in which these words are."""
    return [fault for fault in check(run).faults if words in fault]


@pytest.mark.parametrize(("step", "share", "found"), [
    (10.0, 1.0, 0), (10.0, 0.99, 0), (10.0, 1.01, 1), (0.5, 0.99, 0), (0.5, 1.2, 1),
])  # fmt: skip
def test_no_vehicle_is_faster_than_its_own_speed_and_the_fastest_current(step, share, found):
    """However often it is observed, one line a leg tells it."""
    times = np.arange(12) * step
    run = along(np.c_[FASTEST * share * times, 0.0 * times, 0.0 * times + 30.0], times)
    assert len(faults(run, "too fast")) == found
    assert not faults(run, "time does not advance")


def turning(phase, planned_anew):
    """A leg that turns to the right, then to the left at 0.1 rad/s, seen every 3 s from a phase on.

    At the turn, or shortly after it, a new path may lead straight ahead.
    """
    fine = np.arange(0.0, 60.0, 0.01)
    rate = np.where(fine < 21.0 + phase, 0.1, 0.0 if planned_anew else -0.1)
    course = np.concatenate([[0.0], np.cumsum(rate[:-1]) * 0.01])
    velocity = SPEED * np.stack([np.cos(course), np.sin(course), 0.0 * course], axis=1)
    places = np.concatenate([np.zeros((1, 3)), np.cumsum(velocity[:-1], axis=0) * 0.01])
    seen = slice(0, None, 300)
    run = along(places[seen] + [0.0, 0.0, 30.0], fine[seen])
    (leg,) = run.legs
    leg.motion = Motion.through_water(velocity[seen], np.zeros(3))
    leg.plans = [
        replace(leg.plans[0], made_at=made_at) for made_at in ([0.0, 21.0] if planned_anew else [0.0])
    ]
    return run


@pytest.mark.parametrize("phase", [0.0, 0.7, 1.5, 2.2, 2.9])
def test_a_track_that_turns_follows_its_velocities(phase):
    run = turning(phase, planned_anew=False)
    assert not faults(run, "off the next position")
    run.legs[0].positions[7, :2] += [0.0, 1.2]
    assert faults(run, "off the next position")


def test_what_a_new_path_does_says_nothing_of_the_step_before_it():
    run = turning(0.0, planned_anew=True)
    assert not faults(run, "off the next position")
    run.legs[0].positions[6, :2] += [0.0, 1.5]
    assert faults(run, "off the next position")


def across_a_stream(feasible, most):
    """A plan due north in long steps across a stream of up to so many times the vehicle's speed.

    Times are means over each step, and velocities those in the mean of the current.
    """
    gaps, places = np.full(12, 200.0), (np.arange(96.0) + 0.5) / 96.0
    stream = most * SPEED * np.sin(np.pi * places)
    ground = np.sqrt(SPEED**2 - np.minimum(stream, 0.99 * SPEED) ** 2)
    times = np.concatenate([[0.0], np.cumsum(gaps * (1.0 / ground).reshape(12, 8).mean(axis=1))])
    positions = np.c_[200.0 * np.arange(13.0), np.zeros(13), np.full(13, 30.0)]
    run = along(positions, times)
    (leg,) = run.legs
    water = np.c_[np.zeros(12), stream.reshape(12, 8).mean(axis=1), np.zeros(12)]
    motion = Motion.along("track", SPEED, np.diff(positions, axis=0), water)
    plan = leg.plans[0]
    leg.plans = [replace(plan, positions=positions, times=times, motion=motion, feasible=feasible)]
    return run, leg.plans[0]


@pytest.mark.parametrize(
    ("feasible", "most", "metres"), [(True, 0.9, 10.0), (True, 0.93, 10.0), (False, 1.0, 40.0)]
)
def test_planned_steps_may_be_off_by_what_the_current_changes_along_them(feasible, most, metres):
    run, plan = across_a_stream(feasible, most)
    off = np.diff(plan.positions, axis=0) - plan.motion.ground_velocity * np.diff(plan.times)[:, None]
    assert np.linalg.norm(off, axis=1).max() > 0.5
    assert not faults(run, "plan 0: ")
    plan.positions[6, 0] += metres
    assert faults(run, "plan 0: the velocity at ")


def test_planned_steps_in_a_current_that_does_not_change_are_exact():
    run, plan = across_a_stream(True, 0.0)
    assert not faults(run, "plan 0: ")
    plan.positions[6, 0] += 0.31
    assert faults(run, "plan 0: the velocity at ")


def test_a_leg_whose_refused_path_took_longer_expects_that_time():
    run = make_run()
    leg = run.legs[1]
    leg.t_expected += 100.0
    assert faults(run, "its route")
    run.legs.insert(1, replace(refused_leg(run), start=leg.start, goal=leg.goal))
    assert not faults(run, "its route")


@pytest.mark.parametrize(("faster", "found"), [(1.0, 0), (2.2, 1)])
def test_no_route_expects_more_than_the_vehicle_makes_over_ground(faster, found):
    run = make_run()
    run.vehicle = Vehicle(SPEED, surge_max=2.0 * SPEED)
    route, task = run.routes[0], run.legs[0].t_task
    route.leg_times[0] = task + (route.leg_times[0] - task) / faster
    assert len(faults(run, "the vehicle's limit is 5 m/s over ground")) == found


DIVES = [
    # Executed, pitch_max in degrees, rates in m/s, and what is said of a dive at 20 degrees. What was
    # executed may have met another current than it was planned in.
    (True, 13.9, {}, "the pitch at"),
    (True, 14.1, {}, ""),
    (False, 19.4, {}, "the pitch at"),
    (False, 19.6, {}, ""),
    (False, None, {"dive_rate_max": 0.82}, "dives at 0.86 m/s"),
    (False, None, {"dive_rate_max": 0.84}, ""),
    (True, None, {"dive_rate_max": 0.60}, "dives at 0.86 m/s"),
    (True, None, {"dive_rate_max": 0.61}, ""),
    (True, None, {"climb_rate_max": 0.1}, ""),
    (False, None, {}, ""),
]


@pytest.mark.parametrize(("executed", "degrees", "rates", "words"), DIVES)
@pytest.mark.parametrize("upwards", [False, True])
def test_no_vehicle_dives_more_steeply_than_it_can(executed, degrees, rates, words, upwards):
    """On the leg and in its plan each limit is told once."""
    angle = np.radians(20.0)
    way = np.array([np.cos(angle), 0.0, -np.sin(angle) if upwards else np.sin(angle)])
    times = 3.0 * np.arange(12)
    positions = np.array([0.0, 0.0, 50.0]) + SPEED * times[:, None] * way
    run = along(positions, times)
    (leg,) = run.legs
    leg.motion = Motion.through_water(np.tile(SPEED * way, (12, 1)), np.zeros(3))
    plan = replace(leg.plans[0], positions=positions, times=times, motion=leg.motion[:-1])
    leg.plans, run.simulated = [plan], executed
    if upwards:
        swap = {"dive_rate_max": "climb_rate_max", "climb_rate_max": "dive_rate_max"}
        rates, words = {swap[name]: rate for name, rate in rates.items()}, words.replace("dives", "climbs")
    run.vehicle = Vehicle(SPEED, pitch_max=None if degrees is None else np.radians(degrees), **rates)
    found = [fault for fault in check(run).faults if "vehicle's limit" in fault]
    planned = [fault for fault in found if fault.startswith("plan 0: ")]
    walked = [fault for fault in found if fault not in planned]
    assert len(walked) == bool(words)
    assert all(words in fault for fault in walked)
    if not executed:
        assert len(planned) == bool(words)
    broken = replace(plan, feasible=False)
    leg.plans = [broken]
    assert not [fault for fault in check(run).faults if "vehicle's limit" in fault and "plan" in fault]


def test_a_jump_while_time_stands_still_is_too_fast():
    run = due_north()
    (leg,) = run.legs
    leg.times[7] = leg.times[6]
    assert len(faults(run, "time does not advance after 30.00 s")) == 1
    assert len(faults(run, "10.0 m in 0.00 s after 30.00 s is too fast")) == 1


@pytest.mark.parametrize(("height", "found"), [(0.005, False), (0.03, True)])
def test_the_surface_is_kept_to_a_centimetre(height, found):
    """Positions are stored in single precision."""
    report = check(due_north(depth=-height))
    assert any("above the surface by 0.03 m" in fault for fault in report.faults) is found


@pytest.mark.parametrize(("gap", "inside"), [(0.5, False), (-0.5, True)])
def test_an_obstacle_is_hit_from_its_surface_on(gap, inside):
    """Half a metre beside a sphere is no hit, half a metre within it is one."""
    report = check(due_north(obstacles=[[100.0, 20.0, 30.0]], radii=[20.0 - gap]))
    assert report.obstacle_clearance == pytest.approx(gap, abs=0.01)
    assert report.obstacle_hits == report.collisions == inside
    chord = 2.0 * np.sqrt(max((20.0 - gap) ** 2 - 20.0**2, 0.0))
    assert report.obstacle_metres == pytest.approx(chord, abs=1.0)
    assert (report.coast_metres, report.seabed_metres) == (0.0, 0.0)
    assert any("inside obstacle 0" in fault for fault in report.faults) == inside


@pytest.mark.parametrize(
    ("beside", "depths", "clearance"),
    [
        (0.0, {}, -50.0),
        (30.0, {}, -20.0),
        (49.5, {}, -0.5),
        (50.5, {}, 0.5),
        (90.0, {}, 40.0),
        (0.0, {"depth_max": 10.0}, 20.0),  # the leg passes 20 m under it
        (0.0, {"depth_max": 29.5}, 0.5),
        (0.0, {"depth_min": 30.5}, 0.5),  # and here over it
        (0.0, {"depth_min": 45.0}, 15.0),
        (80.0, {"depth_max": 10.0}, np.hypot(30.0, 20.0)),  # past its lower edge
        (50.0 + 0.3, {"depth_max": 29.6}, 0.5),
    ],
)
def test_known_obstacles_are_upright_cylinders(beside, depths, clearance):
    run = due_north(step=2.0, speed=1.0)
    report = check(run, with_known_obstacle(run, 100.0, beside, radius=50.0, **depths))
    inside = clearance < 0.0
    assert report.obstacle_clearance == pytest.approx(clearance, abs=0.02)
    assert report.obstacle_hits == inside
    chord = 2.0 * np.sqrt(max(50.0**2 - beside**2, 0.0)) if inside else 0.0
    assert report.obstacle_metres == pytest.approx(chord, abs=4.0)
    assert (report.obstacle_metres > 0.0) == inside
    assert any("inside 'buoy'" in fault for fault in report.faults) == inside


def test_a_known_obstacle_that_goes_ahead_is_as_near_as_at_first():
    run = due_north(speed=1.0)
    dataset = with_known_obstacle(run, 60.0, 0.0, velocity=(1.0, 0.0), radius=20.0)
    assert check(run, dataset).obstacle_clearance == pytest.approx(40.0, abs=0.02)


#: A leg of 1,000 s and a band that closes: through it, into it with a task of 300 s there, and
#: out of it, whose first metre alone lies in it.
THROUGH, INTO = {}, {"track": (0.0, 500.0)}
LAST_METRE = {"track": (-599.5, 400.5)}
OUT_OF = {"track": (599.5, 1599.5), "departs": 500.0, "hold": 200.0}
HOURS = [
    (0, 390, THROUGH, None), (610, 2000, THROUGH, None),
    (0, 410, THROUGH, "meets"), (590, 700, THROUGH, "meets"), (450, 455, THROUGH, "meets"),
    (1100, 1400, {"wait": 100.0}, None),  # it ends outside the band, where it may stay
    (1401, 5000, INTO | {"wait": 100.0}, None), (1399, 5000, INTO | {"wait": 100.0}, "stays"),
    *((closes - 10.0, closes, INTO, "stays") for closes in np.linspace(1012.0, 1280.0, 12)),
    (0.0, 999.5, LAST_METRE, None), (0.0, 1000.5, LAST_METRE, "stays"),
    (1299.5, 5000.0, LAST_METRE, "stays"), (1300.0, 5000.0, LAST_METRE, None),
    (0.0, 299.5, OUT_OF, None), (0.0, 300.5, OUT_OF, "stays"), (499.5, 499.8, OUT_OF, "stays"),
    (490.0, 499.9, OUT_OF, "stays"), (500.5, 5000.0, OUT_OF, None),
    (0.0, 499.999, OUT_OF | {"hold": 0.0}, None),  # nothing is waited for
]  # fmt: skip


@pytest.mark.parametrize(("opens", "closes", "leg", "found"), HOURS)
def test_no_leg_and_no_stay_is_in_an_area_while_it_is_closed(opens, closes, leg, found):
    faults = in_a_band_that_closes(opens, closes, **leg).faults
    assert any("stays in the closed area 'band'" in fault for fault in faults) == (found == "stays")
    met = any(": in the closed area 'band'" in fault for fault in faults)
    assert met == (found == "meets") or found == "stays"


@pytest.mark.parametrize(
    ("begins", "ends", "found"), [(-0.05, 0.05, False), (0.05, 100.0, True), (-100.0, -0.05, True)]
)
def test_a_task_begins_in_its_window(begins, ends, found):
    """`begins` and `ends` are s from the arrival to where its window opens and closes."""
    run = make_run()
    arrives = float(run.legs[0].times[-1])
    report = check(three_jobs(run, windows=((arrives + begins, arrives + ends),)))
    assert report.ok is not found, report
    assert any("the task at 'gauge'" in fault for fault in report.faults) is found


@pytest.mark.parametrize(("altitude", "hits"), [(0.5, 0), (-0.5, 1)])
def test_the_sea_bed_is_hit_from_its_surface_on(altitude, hits):
    """The deepest waypoint lies at 40 m: the first leg ends there."""
    run = make_run((0, 1))
    data = to_dataset(run).merge(
        over(np.full((50, 50), 40.0 + altitude))[["seabed_depth", "seabed_origin", "seabed_pixel_size"]]
    )
    data.attrs["seabed_clearance"] = 2.0
    report = check_dataset(run.summary(), data)
    assert report.seabed_altitude == pytest.approx(altitude, abs=1e-3)
    assert report.seabed_hits == report.collisions == hits
    assert (report.seabed_metres > 0.0) == (hits > 0)
    assert sum("m above the sea bed, under 2 m," in fault for fault in report.faults) == 1
