"""The executor on a vehicle with faults: every mission ends with a verdict, no task is done twice."""

from collections import Counter
from copy import copy
from dataclasses import replace
from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from auvplan.export.speeds import led
from auvplan.io.area import load_closures
from auvplan.link import Limits, Lost, Refused, State, Upload, execute
from auvplan.link.limits import Allowance
from auvplan.link.notices import CurrentNotice, GoneNotice, ObstacleNotice
from auvplan.link.rolling import RollingPlan
from auvplan.mission.jobs import JobPoint, Jobs
from auvplan.ocean.known import KnownObstacle
from auvplan.runtime.compiled import compilations
from tests.executive.test_closures import band, settings_with
from tests.executive.tide import CHANNEL, STREAMS, channel_with, stream, tidal_area
from tests.link.scripted import SETTINGS, Fails, ScriptedVehicle

pytestmark = pytest.mark.usefixtures("light_search")

#: m/s, of the vehicle, which no current here more than doubles.
SPEED = 2.5


@cache
def planned() -> RollingPlan:
    """A mission that is planned, for all tests."""
    plan = RollingPlan(SETTINGS, 1)
    assert plan.plan()
    return plan


def made(**script):
    """A plan that is there when it is asked for, and a vehicle at its start that keeps the planned speed."""
    plan = copy(planned())
    plan.remove_obstacle("")  # and whatever other tests have added
    plans, usual = plan.plan, Allowance()
    plan.plan = lambda given=usual, away=0.0: (given == usual and not away) or plans(given, away)
    start = np.asarray(plan.run.graph.positions[plan.run.start], float)
    return plan, ScriptedVehicle(start, **script)


def executed(plan, vehicle, **options):
    record = execute(plan, vehicle, **options)
    assert record.reason
    assert vehicle.closed
    assert record.events[-1].kind == "end"
    assert not doubled(vehicle)
    return record


def is_there(found):
    """What was planned or corrected, where that could be."""
    assert found is not None
    return found


def doubled(vehicle) -> list:
    places = Counter(tuple(place.round(1)) for place in vehicle.tasks)
    return [place for place, times in places.items() if times > 1]


class Tell:
    """Notices at times of the mission."""

    def __init__(self, vehicle, *timed) -> None:
        self._vehicle, self._timed = vehicle, list(timed)

    def read(self):
        while self._timed and self._timed[0][0] <= self._vehicle.now:
            made = self._timed.pop(0)[1]
            yield made() if callable(made) else made


#: Of a vehicle that is started again it is not counted how late it is.
PATIENT = {"late": 900.0}
DRIFT = {"push": np.array([1.5, -1.5, 0.0]), "pushed": (100.0, 190.0)}
FOREVER = (200.0, np.inf)
ALONE = "it surfaces 5 s after the last heartbeat"
FULL, DENIED, NONE = Refused("it will not: no space"), Refused("denied"), Lost("no answer")
NOT_STARTED = "no space; the vehicle was not started"
LEFT = "the vehicle is no longer on its plan; left to whoever stopped it, last seen at a depth of "

#: Script of the vehicle, limits, how often something happens, or at all (None), and words of the verdict.
QUICK = [
    ({}, {}, {"plan": 1, "failed": 0}, "destination reached in time; at the surface"),
    ({"speed": 2.0}, {}, {"replan": None}, "destination"),
    ({"fails": Fails("connect", FULL)}, {}, {}, NOT_STARTED),
    ({"fails": Fails("upload", FULL)}, {}, {}, NOT_STARTED),
    ({"fails": Fails("start", FULL)}, {}, {}, "no space; at the surface"),
    ({"speed": 2.1, "fails": Fails("upload", NONE, 0.0, 1)}, {}, {"failed": None}, "destination"),
    ({"speed": 0.1}, {"look": 10.0}, {"over": 1}, "the vehicle is overdue; at the surface"),
    ({"stuck": (500.0, np.inf), "restarts": True}, PATIENT, {"stopped": 1}, "in time"),
    # Whom somebody else stopped is not asked for anything.
    ({"stopped": 300.0, "speed": 2.0, "fails": Fails("surface", DENIED)}, {}, {"failed": 0}, LEFT),
    # What it says to have done counts only where it was.
    ({"odd": lambda v, said: replace(said, done=10**6) if v.now > 300.0 else said}, PATIENT, {}, ""),
    # One that does not go on without a link is not said to.
    (
        {"silent": (100.0, 160.0), "left_alone": ALONE, "notes": [ALONE]},
        {},
        {"lost": 1, "heard": 1},
        "in time",
    ),
]
SLOW = [
    ({"speed": 3.2}, {}, {"replan": None}, "destination"),
    ({"silent": (300.0, 900.0)}, {}, {"lost": 1, "heard": 1}, "in time"),
    (
        {"silent": FOREVER},
        {"overdue": 100.0},
        {},
        "the link is lost and the vehicle is overdue; told to",
    ),
    ({"stuck": FOREVER, "restarts": True}, PATIENT, {"stopped": 1}, "destination"),
    ({"stuck": FOREVER}, {}, {}, "no way made"),
    (DRIFT, {}, {"drift": None}, ""),
    ({"gives_up": 500.0}, {}, {}, "surfacing"),
    ({"speed": 2.1, "fails": Fails("upload", DENIED, 0.0, 1)}, {}, {"failed": None}, "destination"),
    ({"rises": 0.2}, {}, {}, "in time; at the surface"),
    ({"rises": 0.0}, {}, {}, "the vehicle was not seen to surface yet"),
    ({"skip": 200.0}, {}, {"drift": None}, "in time"),
]


@pytest.mark.parametrize(
    ("script", "limits", "counts", "words"),
    [*QUICK, *(pytest.param(*row, marks=pytest.mark.slow) for row in SLOW)],
)
def test_what_becomes_of_a_mission(script, limits, counts, words):
    plan, vehicle = made(**script)
    record = executed(plan, vehicle, limits=Limits(**limits))
    for kind, times in counts.items():
        assert record.count(kind) == times if times is not None else record.count(kind) > 0, kind
    assert words in f"{record.reason}; {record.safe}"
    assert record.success == (record.reason == "destination reached in time")
    assert len(record.tasks) == record.summary()["tasks"]
    assert len(record.tasks) == len(vehicle.tasks) or vehicle.silent == FOREVER
    assert len(record.uploads) == record.count("upload")
    assert all(upload["time"] < vehicle.stopped for upload in record.uploads)
    assert record.count("leg") == max(len(record.route) - 1, 0)
    assert not record.success or record.route[-1] == plan.run.called(plan.run.goal)
    if vehicle.notes:
        said = {event.kind: event.text for event in record.events}
        assert said["note"] == ALONE
        assert said["lost"].endswith(f"by its own settings {ALONE}")


def test_what_the_vehicle_takes_longer_is_in_the_plan_and_not_in_what_it_is_asked():
    """Stops are counted on at the end of every leg, dives before the first; holds stay those of the tasks."""
    plan, _ = made()
    allowance = Allowance(start=4.0, dive=0.5, stop=10.0, by_speed=2.0, task=3.0)
    assert plan.plan(allowance, 60.0)
    stop = 10.0 + 2.0 * float(plan.run.vehicle.speed) + 3.0
    depth = float(plan.run.graph.positions[plan.run.start][2])
    assert float(plan.legs[0].times[0]) == pytest.approx(60.0 + 4.0 + depth / 0.5)
    for leg, after in pairwise(plan.legs):
        task = float(plan.run.graph.duration[leg.start, leg.goal])
        assert float(after.times[0] - leg.times[-1]) == pytest.approx(task + stop, abs=1e-2)
    steps = Upload(plan.itinerary(plan.followed, 0)).steps
    holds = [step.hold for step in steps if step.ends_leg]
    tasks = [float(plan.run.graph.duration[leg.start, leg.goal]) for leg in plan.legs]
    assert holds == pytest.approx(tasks, abs=1e-2)


@pytest.mark.slow
def test_a_vehicle_that_holds_its_speed_over_ground_keeps_its_times_in_a_current():
    """What each line is planned to make is held, where the speed through the water is off by a tenth."""
    current = {"vortices": 0, "uniform": [0.5, -0.4, 0.0]}
    off = {}
    for told in (1.0, 0.0):
        plan = RollingPlan(SETTINGS.with_({"current": current}), 1)
        start = np.asarray(plan.run.graph.positions[plan.run.start], float)
        vehicle = ScriptedVehicle(start, told=told)
        record = executed(plan, vehicle, limits=Limits(late=2000.0))
        assert record.success
        times = [event.time for event in record.events if event.kind == "leg"]
        planned = [step.time + step.hold for step in vehicle.uploads[0].steps if step.ends_leg]
        off[told] = np.abs(np.subtract(times, planned)) / planned
    assert off[1.0].max() < 0.01
    assert off[0.0].max() > 0.03


@pytest.mark.parametrize("share", [0.85, 0.7])
def test_a_slower_vehicle_is_planned_with_at_the_pace_that_it_makes(share):
    """It is asked for the speeds that it was asked for, and comes when the last plan says."""
    plan, vehicle = made(told=share)
    record = executed(plan, vehicle)
    replans = [event for event in record.events if event.kind == "replan"]
    assert "% of the speed asked for" in replans[-1].text
    ends = float(replans[-1].text.split("planned end ")[1].split(" s")[0])
    assert record.t_mission == pytest.approx(ends, rel=0.03)
    off = [float(event.text.split(", ")[-1].split(" s")[0]) for event in record.events if event.kind == "leg"]
    assert max(map(abs, off)) < 120.0
    asked = [{leg.number: led(leg)[-1, 0] for leg in one.itinerary.legs} for one in vehicle.uploads]
    paces = [leg.pace for one in vehicle.uploads[1:] for leg in one.itinerary.legs]
    assert max(paces) < 0.9
    for later in asked[1:]:
        for number, over_ground in later.items():
            assert over_ground == pytest.approx(asked[0][number], rel=0.03)


def test_where_no_plan_is_in_time_the_one_that_is_least_late_may_be_asked_for():
    plan, _ = made()
    assert plan.plan()
    begins = plan.run.t_available - 300.0
    assert plan.from_leg(1, begins) is None
    late = is_there(plan.from_leg(1, begins, late=True))
    assert late.ends > plan.run.t_available
    assert late.legs[-1].goal == plan.run.goal
    plan.pace = 0.5
    slow = is_there(plan.from_leg(1, begins, late=True))
    assert slow.ends - begins > 1.7 * (late.ends - begins)


def test_what_a_leg_drew_by_lasting_longer_is_planned_with():
    """400 s more under way, at 8 W + 12 W s3/m3 x 2.5^3, in place of 400 s on station in the current."""
    power = {"hotel": 40, "propulsion": {"constant": 8, "factor": 12}}
    plan = RollingPlan(SETTINGS.with_({"vehicle.power": power}), 1)
    assert plan.plan()
    done = plan.legs[0].ends
    late = is_there(plan.from_leg(1, done + 400.0, late=True))
    plan.ended(0, done + 400.0)
    assert plan.legs[0].ends == pytest.approx(done + 400.0)
    drew = is_there(plan.from_leg(1, done + 400.0, late=True))
    rest = [found.states[-1].run.legs[1:] for found in (late, drew)]
    assert [leg.t_path for leg in rest[0]] == [leg.t_path for leg in rest[1]]
    stayed, gone = (found.states[-1].run.energy.total for found in (late, drew))
    sea, place = late.states[0].sea.forecast(), late.legs[0].positions[-1]
    drift = np.linalg.norm([float(part) for part in sea(*np.float32([*place, done]))])
    assert drift > 0.3
    assert gone - stayed == pytest.approx(12.0 * (2.5**3 - drift**3) * 400.0 / 3600.0, rel=0.01)


def test_reported_obstacles_compile_nothing_under_way():
    plan, _ = made()
    plan.itinerary(plan.followed, 0)
    before, leg = compilations(), plan.legs[1]
    for number, radius in enumerate([17.0, 40.0, 140.0]):
        north, east = leg.positions[len(leg.positions) // 2][:2].tolist()
        plan.add_obstacle(KnownObstacle(f"reported {number}", (north, east + 2.0 * radius), radius))
        found = plan.from_position(1, np.asarray(leg.positions[3], float), float(leg.times[3]))
        plan.itinerary(found, 1)
    assert compilations() == before


@pytest.mark.slow
def test_an_obstacle_between_two_samples_of_a_leg_is_in_its_way():
    plan, _ = made()
    assert plan.plan()
    leg = plan.legs[1]
    north, east, depth = np.asarray(leg.positions[10:12], float).mean(axis=0).tolist()
    plan.add_obstacle(KnownObstacle("buoy", (north, east), 2.0, depth - 1.0, depth + 1.0))
    assert plan.clearance(leg.positions, leg.times) < -2.0


def test_a_told_obstacle_on_the_way_is_gone_around():
    plan, vehicle = made()
    radius, found = 60.0, []

    def ahead():
        leg = next(leg for leg in plan.legs if leg.times[-1] > vehicle.now + 150.0)
        near = np.interp(vehicle.now + 120.0, leg.times, np.arange(len(leg.times)))
        found.append(np.asarray(leg.positions[int(near)], float))
        return ObstacleNotice(KnownObstacle("drifter", tuple(found[0][:2]), radius))

    record = executed(plan, vehicle, notices=Tell(vehicle, (60.0, ahead)))
    assert record.count("hazard") >= 1
    assert record.success
    track = np.asarray([row[1:3] for row in record.track])
    assert np.linalg.norm(track - found[0][:2], axis=1).min() > radius


def test_one_obstacle_after_another_is_gone_around():
    """More of them on one leg than what does not go away is answered."""
    plan, vehicle = made()
    tries = Limits().tries

    def ahead():
        places = np.stack([vehicle.place, *(step.position for step in vehicle.plan.steps[vehicle.done :])])
        marks = np.cumsum([0.0, *np.linalg.norm(np.diff(places, axis=0), axis=1)])
        north, east, depth = (float(np.interp(150.0, marks, axis)) for axis in places.T)
        levels = depth - 15.0, depth + 15.0
        return ObstacleNotice(KnownObstacle(f"at {vehicle.now:.0f} s", (north, east), 15.0, *levels))

    times = 520.0 + 20.0 * np.arange(tries + 2)
    record = executed(plan, vehicle, notices=Tell(vehicle, *((time, ahead) for time in times)))
    kinds = [event.kind for event in record.events]
    first = kinds.index("leg") + 1
    assert kinds[first : kinds.index("leg", first)].count("hazard") > tries
    assert record.success


@pytest.mark.parametrize(("circles", "beside"), [(0.0, 0.0), (10.0, 8.0)])
def test_a_task_is_left_for_an_obstacle_that_comes_there_and_begun_again(circles, beside):
    """Also where it comes beside the place, and the vehicle circles about that."""
    plan, vehicle = made()
    vehicle.circles = circles
    place = np.asarray(plan.legs[0].positions[-1], float)
    reported, radius, moves = 195.0, 30.0, np.array([1.0, 0.0])  # it begins 12 s before, and takes 91 s
    nearest = place[:2] + np.array([0.0, radius + beside if beside else 0.0])

    def near():
        """An obstacle that is over the task's place, or beside it, 70 s later."""
        assert np.linalg.norm(vehicle.place - place) < 1.0 + circles
        north, east = (nearest - 70.0 * moves).tolist()
        return ObstacleNotice(KnownObstacle("drifter", (north, east), radius, velocity=tuple(moves)))

    record = executed(plan, vehicle, notices=Tell(vehicle, (reported, near)))
    assert record.success
    assert record.count("give way") >= 1
    track = np.asarray([row for row in record.track if row[0] >= reported])
    drifter = nearest + (track[:, :1] - reported - 70.0) * moves
    assert np.linalg.norm(track[:, 1:3] - drifter, axis=1).min() > radius
    assert place.round(1).tolist() in np.round(vehicle.tasks, 1).tolist()


def test_a_task_beside_an_obstacle_is_done_where_the_vehicle_does_not_circle():
    """On its way in it is not taken for one that circles as far off as it still is."""
    plan, vehicle = made()
    place, before = (np.asarray(plan.legs[0].positions[k], float) for k in (-1, -5))
    track = executed(plan, vehicle).track
    when = next(time for time, *row in track if np.linalg.norm(row - place) < 12.0)
    plan, vehicle = made()
    ahead = (place - before)[:2] / np.linalg.norm((place - before)[:2])
    buoy = KnownObstacle("buoy", tuple((place[:2] + 38.0 * ahead).tolist()), 30.0)  # 8 m behind the place
    record = executed(plan, vehicle, notices=Tell(vehicle, (when, ObstacleNotice(buoy))))
    assert record.count("reported") == 1
    assert record.count("give way") == record.count("hazard") == 0
    assert place.round(1).tolist() in np.round(vehicle.tasks, 1).tolist()
    assert record.success


def test_a_leg_is_looked_at_from_its_beginning():
    """An obstacle close after a task, of which nothing was planned, is not run into before the next look."""
    reached = next(event.time for event in executed(*made()).events if event.kind == "leg")
    plan, vehicle = made()
    plan.from_leg = lambda *_, **__: None  # no plan of the rest is found while it is at the task
    radius, first, then = 20.0, *(np.asarray(plan.legs[1].positions[k], float) for k in (0, 20))
    north, east = (first + 35.0 * (then - first) / np.linalg.norm(then - first))[:2].tolist()
    buoy = KnownObstacle("buoy", (north, east), radius)
    record = executed(plan, vehicle, notices=Tell(vehicle, (reached - 3.0, ObstacleNotice(buoy))))
    assert next(event.time for event in record.events if event.kind == "leg") == reached
    track = np.asarray([row[1:3] for row in record.track])
    assert np.linalg.norm(track - [north, east], axis=1).min() > radius


@pytest.mark.parametrize("failures", [0, 1])
def test_a_vehicle_that_is_held_gives_way(failures):
    """Also where it does not take the way aside at once, which is then no plan of the mission's."""
    plan, vehicle = made()
    vehicle.fails = Fails("upload", NONE, 0.0, failures)
    plan.from_position = lambda *_: None  # it has no plan from there
    radius = 40.0

    def passing():
        """An obstacle ahead of it, which comes its way."""
        step = vehicle.plan.steps[vehicle.done].position
        ahead = (step - vehicle.place)[:2] / np.linalg.norm((step - vehicle.place)[:2])
        north, east = (vehicle.place[:2] + 250.0 * ahead).tolist()
        return ObstacleNotice(KnownObstacle("drifter", (north, east), radius, velocity=tuple(-ahead)))

    record = executed(plan, vehicle, notices=Tell(vehicle, (60.0, passing)))
    times = [event.time for event in record.events if event.kind == "give way"]
    assert len(times) > failures
    assert not failures or times[1] - times[0] < 45.0, "it is asked for again at the next look"
    assert record.safe == "at the surface"
    assert record.count("failed") == failures
    assert not record.tasks
    known = plan._context.area.obstacles[-1]
    rows = np.asarray([row for row in record.track if row[0] >= 60.0])
    assert known.distance(rows[:, 1:], rows[:, 0]).min() > 0.0


def test_a_report_stands_for_an_earlier_one_of_its_name_until_it_is_gone():
    plan, _ = made()
    known = plan.clearance(np.zeros((1, 3)), np.zeros(1))
    for north in (300.0, 100.0):
        plan.add_obstacle(KnownObstacle("ferry", (north, 0.0), 20.0))
    assert plan.clearance(np.array([[300.0, 0.0, 5.0]]), np.zeros(1)) > 170.0
    assert plan.clearance(np.array([[100.0, 0.0, 5.0]]), np.zeros(1)) < 0.0
    assert plan.remove_obstacle("ferry")
    assert not plan.remove_obstacle("ferry")
    assert plan.clearance(np.zeros((1, 3)), np.zeros(1)) == known


def test_an_obstacle_that_is_gone_is_in_the_record():
    plan, vehicle = made()
    buoy = KnownObstacle("buoy", (9000.0, 9000.0), 20.0)
    notices = (10.0, ObstacleNotice(buoy)), (20.0, GoneNotice("buoy")), (30.0, GoneNotice("buoy"))
    record = executed(plan, vehicle, notices=Tell(vehicle, *notices))
    words = [event.text for event in record.events if "buoy" in event.text]
    assert words == [
        "obstacle buoy, radius 20 m",
        "obstacle buoy is gone",
        "obstacle buoy is reported gone, but was never reported",
    ]


class Slow(ScriptedVehicle):
    """Finishes the leg that it is on, and its task, before it holds; says so, or only after the next upload.

    It comes some seconds further, and is driven aside on the way.
    """

    mute, further = False, 0

    def pass_second(self):
        self._go(1.0)
        self.now += 1.0

    def hold(self):
        if self.state is State.HOLDING:
            return
        while self.plan is not None and not self.plan.steps[self.done].ends_leg:
            self.pass_second()
        known = self.done
        while self.done == known:
            self.pass_second()
        for _ in range(self.further):
            self.place = self.place + self.push
            self.pass_second()
        super().hold()
        self.hidden = known if self.mute else None

    def upload(self, plan):
        self.hidden = None
        return super().upload(plan)

    def report(self, seconds):
        report = super().report(seconds)
        hidden = getattr(self, "hidden", None)
        return report if hidden is None else replace(report, done=hidden)


@pytest.mark.parametrize(("mute", "further"), [pytest.param(False, 90, marks=pytest.mark.slow), (True, 0)])
def test_a_leg_that_ends_before_the_vehicle_holds_is_not_done_again(mute, further):
    plan, vehicle = made()
    vehicle = Slow(vehicle.start_at, push=np.array([1.5, -1.5, 0.0]), pushed=(100.0, 190.0))
    vehicle.mute, vehicle.further = mute, further
    record = executed(plan, vehicle)
    assert record.count("drift") >= 1
    assert len(record.tasks) == len(vehicle.tasks)
    assert record.route == list(dict.fromkeys(record.route))
    assert record.success


def test_a_mission_without_a_plan_is_not_begun():
    plan = RollingPlan(SETTINGS.with_({"mission.time_available": 60}), 1)
    vehicle = ScriptedVehicle(np.zeros(3))
    record = executed(plan, vehicle)
    assert record.reason.startswith("no plan")
    assert record.safe == "the vehicle was not started"
    assert not vehicle.uploads


def test_a_place_that_is_none_is_not_taken_in():
    def blind(vehicle, report):
        for begins, place in (
            (200.0, np.full(3, np.nan)),
            (300.0, np.array([np.inf, 0.0, 5.0])),
            (400.0, None),
        ):
            if begins < vehicle.now < begins + 60.0:
                return replace(report, position=place)
        return report

    plan, vehicle = made(odd=blind)
    record = executed(plan, vehicle)
    assert (record.count("lost"), record.count("heard")) == (3, 3)
    assert record.success
    assert len(record.tasks) == len(vehicle.tasks)
    assert np.isfinite(record.track).all()


def test_a_vehicle_that_is_elsewhere_or_busy_is_not_started():
    plan, vehicle = made(odd=lambda _, report: replace(report, position=np.array([5e5, 0.0, 0.0])))
    record = executed(plan, vehicle)
    assert "from the mission's start" in record.reason
    plan, vehicle = made(odd=lambda _, report: replace(report, state=State.EXECUTING))
    record = executed(plan, vehicle)
    assert record.reason == "the vehicle executes a plan already: end that first"
    assert record.safe == "the vehicle was not started"
    assert not vehicle.uploads


@pytest.mark.parametrize("error", [RuntimeError("it\nbroke"), Lost("gone")])
def test_what_breaks_on_the_way_ends_at_the_surface(error):
    plan, vehicle = made()
    reports = vehicle.report
    broken = iter([error])

    def report(seconds):
        if vehicle.now > 400.0 and (fault := next(broken, None)):
            raise fault
        return reports(seconds)

    vehicle.report = report
    record = executed(plan, vehicle)
    assert not record.success
    assert str(error).replace("\n", " ") in record.reason
    assert record.safe == "at the surface"


def test_an_interruption_says_how_the_vehicle_is_and_keeps_the_record():
    kept = []
    plan, vehicle = made()
    reports = vehicle.report
    vehicle.report = lambda seconds: reports(seconds) if vehicle.now < 300.0 else _interrupt()
    with pytest.raises(KeyboardInterrupt, match="interrupted; the vehicle goes on with upload 1, whose last"):
        execute(plan, vehicle, keep=lambda record: kept.append((record.reason, record.safe)))
    assert kept[0][0] == "under way"
    assert kept[-1][0] == "interrupted"
    assert "goes on" in kept[-1][1]
    assert vehicle.closed


def _interrupt():
    raise KeyboardInterrupt


def test_currents_that_are_told_all_the_time_do_not_flood_the_vehicle():
    plan, vehicle = made()
    told = [(float(t), CurrentNotice(np.array([0.1 * np.sin(t), 0.0, 0.0]))) for t in range(10, 250, 2)]
    told.insert(0, (5.0, CurrentNotice(np.full(3, np.nan))))
    told.insert(0, (4.0, CurrentNotice(np.ones(3), np.array([9e6, 0.0, 10.0]))))
    record = executed(plan, vehicle, notices=Tell(vehicle, *told))
    notes = [event.text for event in record.events if event.kind == "note"]
    assert len(notes) == 2
    assert "km from the mission: left out" in notes[0]
    assert "current" in [upload["cause"] for upload in record.uploads]
    assert len(record.uploads) < 8
    assert record.success


def test_what_is_told_while_a_plan_is_sent_waits_until_it_is_started():
    plan, vehicle = made(speed=2.0)
    sends, starts, begun, told = vehicle.upload, vehicle.start, [], []

    def upload(wanted):
        if vehicle.now > 0.0 and len(vehicle.uploads) == 1:
            told.append(CurrentNotice(np.array([0.1, 0.0, 0.0])))
        return sends(wanted)

    def start(step=0):
        begun.append(vehicle.uploads[-1].number)
        starts(step)

    vehicle.upload, vehicle.start = upload, start
    notices = SimpleNamespace(read=lambda: [told.pop() for _ in tuple(told)])
    record = executed(plan, vehicle, notices=notices)
    assert record.count("reported") == 1
    assert begun == [wanted.number for wanted in vehicle.uploads], "what is uploaded is started"
    assert len(record.tasks) == len(vehicle.tasks)


@pytest.mark.slow
def test_a_way_back_may_be_planned_anew_on_its_way():
    plan, _ = made()
    assert plan.plan()
    leg = plan.legs[1]
    north, east = np.asarray(leg.positions[-1], float)[:2]
    plan.add_obstacle(KnownObstacle("wreck", (float(north), float(east)), 40.0))
    middle = len(leg.times) // 2
    here, now = np.asarray(leg.positions[middle], float), float(leg.times[middle])
    for _ in range(2):
        found = is_there(plan.from_position(1, here, now))
        assert found.legs[1].start == found.legs[1].goal == leg.start
        assert (leg.start, leg.goal) not in [(part.start, part.goal) for part in found.legs]
        back = found.legs[1]
        assert back.positions[[0, -1]] == pytest.approx(np.stack([here, leg.positions[0]]), abs=0.1)
        assert back.times[-1] - back.times[0] > 0.5 * np.linalg.norm(here - leg.positions[0]) / SPEED
        plan.followed = found
        here, now = here + np.array([5.0, 5.0, 0.0]), now + 60.0


def test_a_task_under_way_when_a_plan_is_handed_over_is_not_done_again():
    plan, vehicle = made(speed=2.0)
    takes = vehicle.upload

    def upload(wanted):
        notes = takes(wanted)
        if vehicle.now > 0.0:  # it comes to its next task meanwhile, and does most of it
            while not (vehicle.at and vehicle.plan.steps[vehicle.done].hold):
                vehicle.now += 1.0
                vehicle._go(1.0)
            for _ in range(int(0.8 * vehicle.left)):
                vehicle.now += 1.0
                vehicle._go(1.0)
        return notes

    def start(step=0):
        known = vehicle.at, vehicle.left
        begins(step)
        if vehicle.now > 0.0 and np.linalg.norm(vehicle.place - vehicle.plan.steps[step].position) < 1.0:
            vehicle.at, vehicle.left = known

    begins, vehicle.upload, vehicle.start = vehicle.start, upload, start
    record = executed(plan, vehicle)
    assert len(record.uploads) > 1
    assert len(record.tasks) == len(vehicle.tasks)


def test_a_vehicle_that_is_stopped_while_a_plan_is_made_or_sent_is_not_started():
    plan, vehicle = made(speed=2.0)
    sends, starts, started = vehicle.upload, vehicle.start, []

    def upload(wanted):
        if vehicle.now > 0.0:
            vehicle.stopped = 0.0
        return sends(wanted)

    def start(step=0):
        started.append(vehicle.now)
        starts(step)

    vehicle.upload, vehicle.start = upload, start
    record = executed(plan, vehicle)
    assert record.reason == "the vehicle is no longer on its plan"
    assert started == [0.0]


@pytest.mark.parametrize(
    "away", [[60.0, 0.0, 0.0], pytest.param([-150.0, 130.0, 0.0], marks=pytest.mark.slow)]
)
def test_a_vehicle_that_begins_off_the_start_is_not_adrift(away):
    plan, vehicle = made()
    start = vehicle.start_at.copy()
    vehicle = ScriptedVehicle(start + away, by_legs=True, stuck=(0.0, 60.0))
    record = executed(plan, vehicle)
    assert record.count("drift") == 0
    places = np.asarray([row[1:] for row in record.track])
    assert np.linalg.norm(places - start, axis=1).min() < 5.0, "it goes to the start first"
    assert record.count("plan") == 2, "its way there is in the plan before it is started"
    assert len(record.tasks) == len(vehicle.tasks)


def test_a_vehicle_without_a_plan_gets_it_once_and_soon():
    plan, vehicle = made(forgets=301.0)
    record = executed(plan, vehicle, limits=Limits(late=900.0))
    (again,) = [event for event in record.events if event.kind == "stopped"]
    assert 301.0 < again.time < 330.0
    assert "idle" in again.text
    assert len(vehicle.uploads) == 2, "neither twice at once, nor re-planned for seconds"
    assert record.success


def test_a_plan_from_a_hold_begins_when_the_vehicle_can_be_started():
    plan, vehicle = made(push=np.array([1.5, -1.5, 0.0]), pushed=(100.0, 190.0))
    plans, starts, begun = plan.from_position, vehicle.start, []

    def from_position(count, position, now):
        found = plans(count, position, now)
        vehicle.now += 150.0  # as long as planning may take
        return found

    def start(step=0):
        starts(step)
        begun.append((vehicle.now, float(vehicle.uploads[-1].steps[0].left_at)))

    plan.from_position, vehicle.start = from_position, start
    record = executed(plan, vehicle)
    assert record.count("drift") >= 1
    (now, planned) = begun[1]
    assert now == pytest.approx(planned, abs=21.0)


def test_a_plan_from_a_hold_leads_to_the_destination_even_too_late():
    plan, _ = made()
    last, available = len(plan.legs) - 1, plan.run.t_available
    leg = plan.legs[last]
    found = is_there(plan.from_position(last, np.asarray(leg.positions[3], float), available - 60.0))
    lasts = float(leg.times[-1] - leg.times[0]) + leg.t_task
    assert available < found.ends < available + lasts + 60.0
    assert found.legs[-1].goal == plan.run.goal
    assert plan.from_leg(last, available - 60.0) is None, "the vehicle is under way there already"


def test_a_leg_that_makes_all_too_late_is_left():
    """Back to its start where more can be done from there in time, straight to the destination where not."""
    plan, _ = made()
    leg, available = plan.legs[1], plan.run.t_available
    here = np.asarray(leg.positions[3], float)
    assert plan.leave_leg(1, here, available - 600.0) is None
    ways = []
    for left in (1350.0, 1650.0, 1900.0):
        found = is_there(plan.from_position(1, here, available - left))
        assert plan.in_time(found)
        ways.append([part.goal for part in found.legs[1:]])
    goal = plan.run.goal
    assert ways == [[goal], [leg.start, goal], [leg.goal, goal]]
    late = is_there(plan.from_position(1, here, available - 600.0))
    assert [part.goal for part in late.legs[1:]] == [goal], "the least late"


@pytest.mark.slow
def test_a_vehicle_that_grows_slow_far_out_leaves_its_leg():
    """At six tenths of its speed from the first waypoint on, which are known on the way to the second."""
    plan, vehicle = made(told=1.0)
    report = vehicle.report

    def slower(seconds):
        vehicle.told = 1.0 if vehicle.now < 520.0 else 0.6
        return report(seconds)

    vehicle.report = slower
    record = executed(plan, vehicle)
    assert "leave leg" in [upload["cause"] for upload in record.uploads]
    assert record.success, record.reason


def test_a_hold_on_the_first_leg_keeps_the_route():
    plan, _ = made()
    assert plan.plan()
    before, leg = plan.followed, plan.legs[0]
    here, now = np.asarray(leg.positions[3], float), float(leg.times[3])
    found = is_there(plan.from_position(0, here, now))
    assert found.states[-1].run.routes[0] is before.states[-1].run.routes[0]
    assert (found.legs[0].start, found.legs[0].goal) == (leg.start, leg.goal)
    assert len(found.states[-1].run.routes) <= len(before.states[-1].run.routes) + 1


def test_a_task_with_an_obstacle_on_the_circle_of_the_vehicle_is_left_out():
    plan, _ = made()
    assert plan.plan()
    leg = next(leg for leg in plan.legs if leg.t_task > 0.0 and leg.goal != plan.run.goal)
    north, east, _ = map(float, plan.run.graph.positions[leg.goal])
    reach = plan.margin + 3.0
    plan.add_obstacle(KnownObstacle("rig", (north, east - reach - 20.0), 20.0))
    for circle, done in ((0.0, True), (10.0, False)):
        assert plan.plan(Allowance(circle=circle))
        assert (leg.goal in [other.goal for other in plan.legs if other.priority > 0.0]) == done


def test_tasks_on_whose_circles_obstacles_stand_cost_no_leg():
    """Legs refused at one waypoint are counted, and end the mission: these tasks are left out before."""
    plan, _ = made()
    places, goal = np.asarray(plan.run.graph.positions, float), plan.run.goal
    tasks = [k for k in range(len(places)) if k not in (plan.run.start, goal)]
    for k in tasks:
        north, east, depth = places[k].tolist()
        side = plan.margin + 25.0
        plan.add_obstacle(KnownObstacle(f"rig {k}", (north, east - side), 20.0, depth - 5.0, depth + 5.0))
    assert plan.plan(Allowance(circle=10.0))
    assert not {leg.goal for leg in plan.legs if leg.priority > 0.0} & set(tasks)
    assert plan.left_out.keys() == set(tasks)
    assert all(f"rig {k} is within {plan.margin + 10.0:g} m" in why for k, why in plan.left_out.items())
    assert not [leg for leg in plan.followed.states[-1].run.legs if leg.refused]


def test_a_vehicle_that_is_shut_in_waits_before_it_goes_home():
    """Obstacles lie over both ends of its leg; as long as there are time and patience, they may go away."""
    plan, _ = made()
    assert plan.plan()
    leg = plan.legs[1]
    here, now = np.asarray(leg.positions[len(leg.positions) // 2], float), float(leg.times[3])
    places = plan.run.graph.positions
    for name, end in (("on", leg.goal), ("back", leg.start)):
        north, east, _ = map(float, places[end])
        plan.add_obstacle(KnownObstacle(name, (north, east), 40.0))
    home = is_there(plan.from_position(1, here, now))
    assert home.legs[1].goal == plan.run.goal
    plan.patience = 60.0
    assert plan.from_position(1, here, now) is None
    assert "no path leads on" in plan.reason
    plan.patience = plan.run.t_available - home.ends + 1.0
    again = is_there(plan.from_position(1, here, now))
    assert again.ends == home.ends
    plan.remove_obstacle("on")
    plan.patience = 60.0
    on = is_there(plan.from_position(1, here, now))
    assert on.legs[1].goal == leg.goal


def test_a_vehicle_that_gives_up_a_task_goes_on_to_the_next_one():
    """Back to where it came from first takes longer, and straight to the destination leaves tasks undone."""
    plan = in_the_channel(())
    leg, after = plan.legs[1:3]
    middle = len(leg.times) // 2
    here, now = np.asarray(leg.positions[middle], float), float(leg.times[middle])
    north, east, _ = map(float, plan.run.graph.positions[leg.goal])
    plan.add_obstacle(KnownObstacle("rig", (north, east), 15.0))
    found = is_there(plan.from_position(1, here, now))
    assert (found.legs[1].goal, found.legs[1].priority) == (after.goal, after.priority)
    back = is_there(plan.leave_leg(1, here, now))
    assert back.legs[1].goal == leg.start
    assert found.ends < back.ends
    assert sum(part.priority for part in found.legs) >= sum(part.priority for part in back.legs)


def in_the_channel(members):
    """A plan among six tasks in a stream, with other forecasts of it."""
    settings, area = channel_with(members, available=3000.0)
    plan = RollingPlan(settings, 0, area=area)
    assert plan.plan()
    return plan


def test_a_measured_current_says_which_member_is_planned_in():
    """The stream runs against the vehicle, as the third of four members has it: the rest takes as long."""
    plan, late = in_the_channel(STREAMS), in_the_channel(())
    here, now = np.asarray(plan.legs[1].positions[0], float), float(plan.legs[1].times[0])
    swing = float(stream(now, 1.0, 0.0)[0])
    for north in (-0.52, -0.5):
        found = is_there(plan.correct_current(np.asarray([swing * north, 0.0, 0.0]), here, now))
        assert found.member == 3
        assert found.weight > 0.99
        assert found.offset[0] == pytest.approx(swing * (north + 0.5), abs=1e-3)
    there = is_there(plan.from_leg(1, now))
    alone = is_there(late.correct_current(np.asarray([swing * -0.5, 0.0, 0.0]), here, now))
    assert (alone.member, alone.weight) == (0, 1.0)
    moved = is_there(late.from_leg(1, now))
    assert there.ends == pytest.approx(moved.ends, rel=0.03)
    assert there.ends > plan.followed.ends + 100.0


def test_what_is_late_beyond_the_time_available_is_planned_or_refused_by_the_clock(monkeypatch):
    """Travel times follow the tide; the rest is planned for a moment at which the time is over, and once."""
    planning = CHANNEL["planning"] | {"departures": 3}
    settings, area = channel_with(available=3000.0, planning=planning)
    plan = RollingPlan(settings, 0, area=area)
    assert plan.plan()
    here, now = np.asarray(plan.legs[2].positions[4], float), plan.run.t_available + 100.0
    assert plan.correct_current(np.asarray([0.1, 0.0, 0.0]), here, now) is not None
    planned, complete = [], RollingPlan._complete
    counted = lambda *given, **how: planned.append(complete(*given, **how)) or planned[-1]  # noqa: E731
    monkeypatch.setattr(RollingPlan, "_complete", counted)
    assert plan.from_leg(2, now) is None
    assert len(planned) == 1
    assert plan.reason
    late = is_there(plan.from_position(2, here, now))
    assert late.ends > now


def test_currents_that_are_measured_all_the_time_count_once_a_minute():
    """What is far back still says which member it is; work does not grow with what was measured."""
    plan = in_the_channel(STREAMS)
    here, found = np.asarray([500.0, 0.0, 5.0]), None
    for second in range(0, 900, 15):
        north = -0.5 if second < 600 else -1.0  # the stream turns out weaker at last
        velocity = np.asarray([float(stream(float(second), north, 0.0)[0]), 0.0, 0.0])
        found = plan.correct_current(velocity, here, float(second))
    assert found is not None
    assert found.member in (3, 4)
    assert len(plan.measured.times) in (15, 16, 17)


def test_what_a_vehicle_waits_for_its_next_leg_is_not_late(tmp_path):
    """At the buoy it waits a quarter of an hour and more for the narrows to open."""
    mission = CHANNEL["mission"] | {"jobs": "jobs.csv"}
    settings = settings_with(band(tmp_path, {"to": "2026-03-01T06:20Z"}), mission=mission)
    area = tidal_area(0.0, 0.0)
    jobs, closures = (
        Jobs((JobPoint("buoy", (200.0, 0.0, 5.0), 3.0, 60.0),)),
        load_closures(settings, area.site, tmp_path),
    )
    plan = RollingPlan(settings, 0, area=replace(area, jobs=jobs, closures=closures))
    vehicle = ScriptedVehicle(np.asarray([0.0, 0.0, 5.0]), told=1.0)
    record = executed(plan, vehicle)
    assert record.success
    assert plan.legs[1].t_hold > 900.0
    (buoy, goal) = [event for event in record.events if event.kind == "leg"]
    for event in (buoy, goal):
        assert abs(float(event.text.split(", ")[-1].split(" s")[0])) < 15.0, event.text
    assert plan.legs[0].ends == pytest.approx(buoy.time - plan.legs[1].t_hold, abs=1.0)
    assert record.count("replan") == 0


def test_jobs_within_known_obstacles_are_left_out_and_said():
    """Those of the scenario's file, and those that have become known before the departure."""
    settings, area = channel_with()
    (north, east, _), (other, side, _) = (place for _, place in area.jobs.places[1:3])
    plan = RollingPlan(
        settings, 0, area=replace(area, obstacles=(KnownObstacle("rock", (north, east), 9.0),))
    )
    plan.add_obstacle(KnownObstacle("rig", (other, side + 12.0), 9.0))
    vehicle = ScriptedVehicle(np.asarray([0.0, 0.0, 5.0]))
    record = executed(plan, vehicle)
    assert list(plan.left_out) == [2, 3]
    assert not {2, 3} & {leg.goal for leg in plan.legs}
    said = [event.text for event in record.events if "is left out" in event.text]
    assert "task 2 is left out: it lies within the known obstacle 'rock'" in said[0]
    assert "task 3 is left out: it lies 3.0 m from the known obstacle 'rig'" in said[1]
