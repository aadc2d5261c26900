"""ArduSub's ways, by a small peer: what it forgets, refuses, and does by itself.

Facts are those of ArduPilot's sources, the file in brackets.
"""

import math
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from auvplan.export.qgroundcontrol import item_speeds
from auvplan.link import Limits, Lost, Refused, State, Upload, open_link
from tests.export.sample import SPEED, at_speeds, make_itinerary
from tests.link.joining import free_port
from tests.link.mavlink_peer import AUTO, COMPLETE, MANUAL, POSHOLD, RUNNING, SURFACE, Sub, place_of

LIMITS = Limits(reply=0.3, attempts=5, connect=5.0, outdated=0.1)


@pytest.fixture
def join(upload, opened):
    """Makes a link and the vehicle at its other end, some of which is other before they meet."""

    def make(limits=LIMITS, given=None, **changes):
        port = free_port()
        link = open_link(f"mavlink:udpin:127.0.0.1:{port}", upload.itinerary.site, limits, **given or {})
        sub = Sub(f"udpout:127.0.0.1:{port}", place_of(upload))
        opened.extend([link, sub])
        for name, value in changes.items():
            setattr(sub, name, value)
        return link, sub, link.connect()

    return make


@pytest.fixture
def joined(join):
    link, sub, _ = join()
    return link, sub


@pytest.fixture
def under_way(joined, upload):
    joined[0].upload(upload)
    joined[0].start()
    return joined


def test_home_comes_first_and_modes_start_hold_and_surface(joined, upload):
    link, sub = joined
    assert link.upload(upload) == []
    assert [item[1] for item in sub.items] == [16, 178, *[16] * 5, 21]
    assert len(sub.held[1]) == 8
    link.start()
    assert (sub.armed, sub.state) == (True, RUNNING)
    assert link.report(0.1).state is State.EXECUTING
    sub.changed(current=5)
    assert link.report(0.1).done == 3, "home and the speed are no steps"
    link.hold()
    time.sleep(0.3)
    assert link.report(0.1).state is State.HOLDING
    link.surface()
    assert sub.modes == [POSHOLD, AUTO, POSHOLD, SURFACE]


def test_what_it_forgets_is_not_asked_back(joined, upload):
    """Parameters but the first, frames without a place, millimetres and NaN are not kept (AP_Mission.cpp)."""
    link, sub = joined
    lower = np.array([0.0, 0.0, 0.0057])
    legs = [replace(leg, positions=leg.positions + lower) for leg in upload.itinerary.legs]
    link.upload(Upload(replace(upload.itinerary, legs=tuple(legs))))
    assert [item[2] for item in sub.items[2:-1]] == [math.ceil(step.hold) for step in upload.steps]
    # The check of altitudes that is meant for places passes by these two numbers (Sub::start_command).
    assert (sub.items[1][2], sub.items[1][4]) == (1.0, -1.0)


@pytest.mark.parametrize(
    "forget", [lambda item: (*item[:8], item[8] + 0.02), lambda item: (*item[:2], item[2] + 1.0, *item[3:])]
)
def test_what_it_should_keep_is_compared(joined, upload, forget):
    link, sub = joined
    sub.forgets = forget
    with pytest.raises(Lost, match=r"another plan than was sent: 8 items, \d of 8 as planned"):
        link.upload(upload)


def test_it_is_held_while_another_plan_goes_up_and_keeps_its_speed(under_way, upload):
    link, sub = under_way
    link.upload(Upload(upload.itinerary, 2))
    sub.changed(current=6, loses=1)
    link.start(2)
    assert sub.modes == [POSHOLD, AUTO, POSHOLD, AUTO]
    assert sub.current == 4, "it says the item that it was set to, not one that it has come to"
    assert sub.speed == pytest.approx(upload.itinerary.speed)


def test_each_line_has_its_speed_over_ground(joined):
    """A speed is set where the waypoint before it is reached (AP_Mission::advance_current_nav_cmd)."""
    link, sub = joined
    plan = Upload(make_itinerary(over_ground=True))
    link.upload(plan)
    speeds, speed, given = item_speeds(plan.itinerary), math.nan, []
    for _, command, _, set_to, *_ in sub.items[1:-1]:
        if command == 178:
            speed = set_to
        else:
            given.append(speed)
    assert given == pytest.approx(speeds)
    assert len(set(speeds)) > 2
    link.start()
    places = [k for k, item in enumerate(sub.items) if item[1] == 16][1:]
    assert sub.speed == pytest.approx(speeds[0])
    for number, place in enumerate(places):
        sub.changed(current=place)
        assert link.report(0.1).done == number, "items of speeds are no steps"
    link.hold()
    link.start(3)
    assert sub.current == places[3]
    assert sub.speed == pytest.approx(speeds[3]), "what is set before that item is passed over"


def test_a_line_that_is_begun_while_it_is_started_keeps_its_speed(joined):
    link, sub = joined
    plan = Upload(make_itinerary(over_ground=True))
    link.upload(plan)
    taken = sub.command_long

    def reached_meanwhile(mav, message):
        if message.command == 178 and sub.current < 4:
            sub.changed(current=4)
        taken(mav, message)

    sub.command_long = reached_meanwhile
    link.start()
    assert sub.speed == pytest.approx(item_speeds(plan.itinerary)[1])


def test_one_that_holds_its_speed_through_the_water_is_given_that(join):
    link, sub, _ = join(given={"over_ground": False})
    link.upload(Upload(make_itinerary(over_ground=True)))
    assert [item[3] for item in sub.items if item[1] == 178] == [1.75]
    plan = Upload(at_speeds((0.2, -0.1, 0.0)))
    link.upload(plan)
    assert [item[3] for item in sub.items if item[1] == 178] == pytest.approx([0.9, SPEED, 1.5])
    for step in (0, 3, 5):
        link.start(step)
        assert sub.speed == pytest.approx(plan.steps[step].speed)
        link.hold()


@pytest.mark.parametrize(("armed", "mission"), [(False, RUNNING), (True, COMPLETE)])
def test_a_vehicle_in_auto_is_started(join, upload, armed, mission):
    """Setting the mode that it is in does nothing (Sub::set_mode): it leaves AUTO first."""
    link, sub, _ = join(mode=AUTO, armed=armed, state=mission)
    assert link.report(0.2).state in (State.IDLE, State.FINISHED)
    link.upload(upload)
    link.start()
    assert (sub.mode, sub.armed, sub.state, sub.current) == (AUTO, True, RUNNING, 1)


def test_a_start_counts_when_the_mission_is_active(join, upload):
    link, sub, _ = join(replace(LIMITS, attempts=2))
    link.upload(upload)
    sub.starts = False
    with pytest.raises(Lost, match="mode AUTO with an active mission"):
        link.start()
    assert (sub.armed, link.now) == (False, 0.0)


def test_just_booted_it_is_armed_only_where_auto_would_be_taken(joined, upload):
    link, sub = joined
    link.upload(upload)
    sub.located = False
    armed = []
    threading.Timer(0.8, lambda: (armed.append(sub.armed), setattr(sub, "located", True))).start()
    link.start()
    assert armed == [False]
    assert sub.state == RUNNING


def test_without_a_position_it_is_not_armed(join, upload):
    link, sub, _ = join(replace(LIMITS, connect=0.5))
    link.upload(upload)
    sub.located = False
    with pytest.raises(Refused, match="Poshold requires position"):
        link.start()
    assert not sub.armed


@pytest.mark.parametrize(
    ("change", "before", "why"),
    [
        ({"armed": False}, {"armed": True}, "it was disarmed"),
        ({"mode": MANUAL}, {"mode": AUTO}, "it was set to mode MANUAL"),
        ({"mode": SURFACE}, {"mode": AUTO}, "it was set to mode SURFACE"),
        ({"failsafe": True}, {"failsafe": False}, "it reports a failsafe"),
    ],
)
def test_what_somebody_else_ends_stays_ended(under_way, upload, change, before, why):
    """What lasts shorter than the time between two looks is kept in mind."""
    link, sub = under_way
    sub.changed(**change)
    sub.changed(**before)
    report = link.report(0.1)
    assert report.state is (State.FAULT if "failsafe" in change else State.STOPPED)
    assert why in report.message
    modes = list(sub.modes)
    for call in (lambda: link.upload(Upload(upload.itinerary, 2)), link.start, link.hold):
        with pytest.raises(Refused, match=f"{why}.*nothing is started again"):
            call()
    assert sub.modes == modes
    link.surface()
    assert sub.mode == SURFACE


def test_what_a_disarmed_vehicle_goes_through_is_not_done(under_way, monkeypatch):
    """Its mission begins anew and its waypoints count as reached where it is (Sub::disarm, auto_wp_run)."""
    link, sub = under_way
    monkeypatch.setattr("auvplan.link.mavlink._GAP", 0.3)
    sub.quiet = True
    time.sleep(0.6)
    sub.armed, sub.current = False, 6
    sub.port.mav.mission_item_reached_send(5)
    sub.changed(quiet=False)
    report = link.report(0.1)
    assert (report.state, report.done) == (State.STOPPED, 0)


def test_an_old_heartbeat_is_no_new_mode(under_way):
    link, sub = under_way
    sub.port.mav.seq = (sub.port.mav.seq - 5) % 256
    sub.port.mav.heartbeat_send(12, 3, 129, POSHOLD, 4)
    sub.port.mav.seq = (sub.port.mav.seq + 4) % 256
    time.sleep(0.3)
    assert link.report(0.1).state is State.EXECUTING


def test_what_it_does_alone_is_read_and_said(join):
    """FS_GCS_ENABLE disarms by default (ArduSub/Parameters.cpp), 5 s after the last heartbeat."""
    link, sub, notes = join()
    alone = "it stops its motors, under water too, 5 s after the last heartbeat (FS_GCS_ENABLE is 2)"
    assert link.left_alone == alone
    for note, words in zip(notes, (alone, "FS_PILOT_INPUT is 2", "FS_LEAK_ENABLE is 1"), strict=True):
        assert words in note
    assert sub.parameters["FS_GCS_ENABLE"] == 2.0


@pytest.mark.parametrize(
    ("wanted", "action", "said"), [("continue", 0.0, "goes on"), ("surface", 4.0, "surfaces")]
)
def test_what_it_does_alone_is_set(join, wanted, action, said):
    _, sub, notes = join(given={"link_loss": wanted})
    assert (sub.parameters["FS_GCS_ENABLE"], sub.parameters["FS_PILOT_INPUT"]) == (action, 0.0)
    assert any(note.startswith("if the link is lost") and said in note for note in notes)


def test_nothing_is_set_on_a_vehicle_that_executes_a_plan(join):
    link, sub, _ = join(given={"link_loss": "surface"}, mode=AUTO, armed=True, state=RUNNING)
    assert link.report(0.1).state is State.EXECUTING
    assert sub.parameters["FS_GCS_ENABLE"] == 2.0


def test_a_failsafe_before_the_start_prevents_it(join, upload):
    """Without a pilot's console there is one from boot on (Sub::failsafe_pilot_input_check)."""
    limits = replace(LIMITS, connect=0.7)
    link, sub, _ = join(limits, failsafe=True)
    link.upload(upload)
    with pytest.raises(Refused, match="reports a failsafe"):
        link.start()
    assert not sub.armed
    link, sub, _ = join(limits, {"link_loss": "continue"}, failsafe=True)
    link.upload(upload)
    link.start()
    assert sub.armed


def test_a_refusal_has_its_name(joined, upload):
    link, sub = joined
    sub.refusal = 4
    with pytest.raises(Refused, match="refuses the plan: no space"):
        link.upload(upload)
