"""ArduSub's ways, by a small peer: what it forgets, refuses, and does by itself.

Facts are those of ArduPilot's sources, the file in brackets.
"""

import math
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from auvplan.link import Limits, Lost, Refused, State, Upload, open_link

mavutil = pytest.importorskip("pymavlink.mavutil", reason="needs pymavlink: pip install 'auvplan[link]'")

from auvplan.export.qgroundcontrol import item_speeds  # noqa: E402
from tests.export.sample import make_itinerary  # noqa: E402
from tests.link.proxy import free_port  # noqa: E402

LIMITS = Limits(reply=0.3, attempts=5, connect=5.0, outdated=0.1)
MANUAL, AUTO, POSHOLD, SURFACE = 19, 3, 16, 9
STOPPED, RUNNING, COMPLETE = 2, 3, 5

#: Parameters of an item that are kept, by command (libraries/AP_Mission/AP_Mission.cpp).
KEPT = {16: (0,), 21: (0,), 178: (0, 1, 2)}


def kept(item, number):
    """What is left of an item of a mission once it is stored (AP_Mission.cpp)."""
    given = item.param1, item.param2, item.param3, item.param4
    assert not any(map(math.isnan, given[:3])), "refused as invalid (AP_Mission::sanity_check_params)"
    params = [part if k in KEPT[item.command] else 0.0 for k, part in enumerate(given)]
    if item.command == 21:
        params[3] = 1.0  # a direction of yaw that nobody gave
    if item.command == 178:
        return 0, item.command, *params, 0, 0, 0.0
    place = (item.x + 1000, item.y, 0.0) if number == 0 else (item.x, item.y, int(item.z * 100.0) / 100.0)
    return 0 if number == 0 else 3, item.command, *params, *place  # home is where it was armed


class Sub:
    """Heartbeats, modes, failsafes and the mission protocol as ArduSub has them."""

    def __init__(self, port):
        self.port = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=1, source_component=1
        )
        self.mode, self.armed, self.modes = 0, False, []
        self.items, self.fence = [], []
        self.refusal, self.keep, self.starts, self.quiet = 0, kept, True, False
        self.sending = None
        self.current, self.mission = 0, STOPPED
        self.located, self.failsafe, self.loses = True, False, 0
        self.speed = math.nan
        self.parameters = {
            "FS_GCS_ENABLE": 2.0, "FS_GCS_TIMEOUT": 5.0, "FS_PILOT_INPUT": 2.0, "FS_PILOT_TIMEOUT": 3.0,
            "FS_LEAK_ENABLE": 1.0,
        }  # fmt: skip
        self.closed = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        beat = 0.0
        while not self.closed.is_set():
            mav = self.port.mav
            if time.monotonic() - beat > 0.1 and not self.quiet:
                beat = time.monotonic()
                self.beat()
            message = self.port.recv_match(blocking=True, timeout=0.02)
            if message is not None and (take := getattr(self, message.get_type().lower(), None)):
                take(mav, message)

    def beat(self):
        mav = self.port.mav
        status = 5 if self.failsafe else 4 if self.armed else 3  # GCS_MAVLINK_Sub::vehicle_system_status
        mav.heartbeat_send(12, 3, 128 * self.armed | 1, self.mode, status)
        mav.global_position_int_send(0, -413000000, 1799950000, 0, -12500, 0, 0, 0, 0)
        mav.mission_current_send(self.current, len(self.items), self.mission, int(self.mode == AUTO))

    def set_mode(self, mode):
        """Sub::set_mode (ArduSub/mode.cpp)."""
        if mode == self.mode:
            return True  # which begins nothing
        if mode in (AUTO, POSHOLD) and not self.located:
            name = {AUTO: "Auto", POSHOLD: "Poshold"}[mode]
            self.port.mav.statustext_send(4, f"Mode change failed: {name} requires position".encode())
            return False
        if self.mode == AUTO and self.mission == RUNNING:
            self.mission = STOPPED
        if mode == AUTO:
            self.mission = RUNNING if self.starts else STOPPED
            self.speed = 10.0  # ModeAuto::init: that of WP_SPD
        self.mode = mode
        self.modes.append(mode)
        self.beat()
        return True

    def command_long(self, mav, message):
        taken = True
        if message.command == 400:
            self.armed = bool(message.param1)
            if not self.armed:
                self.mission = STOPPED
        elif message.command == 176:
            taken = self.set_mode(int(message.param2))
        elif message.command == 178:
            self.speed = message.param2
        mav.command_ack_send(message.command, 0 if taken else 4)

    def param_request_read(self, mav, message):
        if message.param_id in self.parameters:
            mav.param_value_send(message.param_id.encode(), self.parameters[message.param_id], 2, 1, 0)

    def param_set(self, mav, message):
        self.parameters[message.param_id] = message.param_value
        self.param_request_read(mav, message)
        self.failsafe = self.failsafe and self.parameters["FS_PILOT_INPUT"] != 0

    def mission_count(self, mav, message):
        if self.refusal:
            mav.mission_ack_send(255, 190, self.refusal, message.mission_type)
            return
        self.sending = message.mission_type, message.count, []
        mav.mission_request_int_send(255, 190, 0, message.mission_type)

    def mission_item_int(self, mav, message):
        kind, count, items = self.sending
        if message.seq == len(items):
            params = message.param1, message.param2, message.param3, message.param4
            whole = message.frame, message.command, *params, message.x, message.y, message.z
            items.append(whole if kind else self.keep(message, message.seq))
        if len(items) < count:
            mav.mission_request_int_send(255, 190, len(items), kind)
            return
        if kind:
            self.fence = items
        else:
            self.items = items
        mav.mission_ack_send(255, 190, 0, kind)

    def mission_request_list(self, mav, message):
        held = self.fence if message.mission_type else self.items
        mav.mission_count_send(255, 190, len(held), message.mission_type)

    def mission_request_int(self, mav, message):
        kind = message.mission_type
        frame, command, *rest = (self.fence if kind else self.items)[message.seq]
        mav.mission_item_int_send(255, 190, message.seq, frame, command, 0, 1, *rest, kind)

    def mission_set_current(self, mav, message):
        """AP_Mission::set_current_cmd: a mission that is complete is stopped then, and AUTO resumes it."""
        if self.loses > 0:
            self.loses -= 1
            return
        self.current = max(message.seq, 1)
        self.mission = RUNNING if self.mission == RUNNING else STOPPED
        mav.mission_current_send(message.seq, len(self.items), self.mission, int(self.mode == AUTO))

    def close(self):
        self.closed.set()
        self.thread.join(timeout=2.0)
        self.port.close()


@pytest.fixture(autouse=True)
def _alone(monkeypatch):
    """No others are looked for."""
    monkeypatch.setattr("auvplan.link.mavlink._OTHERS", 0.2)


@pytest.fixture
def join(upload, opened):
    """Makes a link and the vehicle at its other end, which is changed before they meet."""

    def make(change=lambda sub: None, limits=LIMITS, **more):
        port = free_port()
        link = open_link(f"mavlink:udpin:127.0.0.1:{port}", upload.itinerary.site, limits, **more)
        sub = Sub(port)
        opened.extend([link, sub])
        change(sub)
        return link, sub, link.connect()

    return make


@pytest.fixture
def joined(join, upload):
    link, sub, _ = join()
    return link, sub, upload


@pytest.fixture
def under_way(joined):
    link, sub, upload = joined
    link.upload(upload)
    link.start()
    return link, sub, upload


def changed(sub, **values):
    """Change what a vehicle says, and have it heard, once."""
    for name, value in values.items():
        setattr(sub, name, value)
    sub.beat()
    time.sleep(0.15)


def test_home_comes_first_and_modes_start_hold_and_surface(joined):
    link, sub, upload = joined
    assert link.upload(upload) == []
    assert [item[1] for item in sub.items] == [16, 178, *[16] * 5, 21]
    assert len(sub.fence) == 8
    link.start()
    assert sub.armed
    assert sub.mission == RUNNING
    assert link.report(0.1).state is State.EXECUTING
    changed(sub, current=5)
    assert link.report(0.1).done == 3, "home and the speed are no steps"
    link.hold()
    time.sleep(0.3)
    assert link.report(0.1).state is State.HOLDING
    link.surface()
    assert sub.modes == [POSHOLD, AUTO, POSHOLD, SURFACE]


def test_what_it_forgets_is_not_asked_back(joined):
    """Parameters but the first, frames without a place, millimetres and NaN are not kept (AP_Mission.cpp)."""
    link, sub, upload = joined
    lower = np.array([0.0, 0.0, 0.0057])
    legs = [replace(leg, positions=leg.positions + lower) for leg in upload.itinerary.legs]
    link.upload(Upload(replace(upload.itinerary, legs=tuple(legs))))
    assert [item[2] for item in sub.items[2:-1]] == [math.ceil(step.hold) for step in upload.steps]
    # The check of altitudes that is meant for places passes by these two numbers (Sub::start_command).
    assert (sub.items[1][2], sub.items[1][4]) == (1.0, -1.0)


@pytest.mark.parametrize(
    "forget", [lambda item: (*item[:8], item[8] + 0.02), lambda item: (*item[:2], item[2] + 1.0, *item[3:])]
)
def test_what_it_should_keep_is_compared(joined, forget):
    link, sub, upload = joined
    sub.keep = lambda item, number: forget(kept(item, number))
    with pytest.raises(Lost, match=r"another plan than was sent: 8 items, \d of 8 as planned"):
        link.upload(upload)


def test_it_is_held_while_another_plan_goes_up_and_keeps_its_speed(under_way):
    link, sub, upload = under_way
    link.upload(Upload(upload.itinerary, 2))
    changed(sub, current=6, loses=1)
    link.start(2)
    assert sub.modes == [POSHOLD, AUTO, POSHOLD, AUTO]
    assert sub.current == 4, "it says the item that it was set to, not one that it has come to"
    assert sub.speed == pytest.approx(upload.itinerary.speed)


def test_each_line_has_its_speed_over_ground(joined):
    """A speed is set where the waypoint before it is reached (AP_Mission::advance_current_nav_cmd)."""
    link, sub, _ = joined
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
        changed(sub, current=place)
        assert link.report(0.1).done == number, "items of speeds are no steps"
    link.hold()
    link.start(3)
    assert sub.current == places[3]
    assert sub.speed == pytest.approx(speeds[3]), "what is set before that item is passed over"


def test_a_line_that_is_begun_while_it_is_started_keeps_its_speed(joined):
    link, sub, _ = joined
    plan = Upload(make_itinerary(over_ground=True))
    link.upload(plan)
    told = sub.command_long

    def reached_meanwhile(mav, message):
        if message.command == 178 and sub.current < 4:
            changed(sub, current=4)
        told(mav, message)

    sub.command_long = reached_meanwhile
    link.start()
    assert sub.speed == pytest.approx(item_speeds(plan.itinerary)[1])


def test_one_that_holds_its_speed_through_the_water_is_given_that(join):
    link, sub, _ = join(over_ground=False)
    link.upload(Upload(make_itinerary(over_ground=True)))
    assert [item[3] for item in sub.items if item[1] == 178] == [1.75]


@pytest.mark.parametrize(("armed", "mission"), [(False, RUNNING), (True, COMPLETE)])
def test_a_vehicle_in_auto_is_started(join, upload, armed, mission):
    """Setting the mode that it is in does nothing (Sub::set_mode): it leaves AUTO first."""

    def idle_in_auto(sub):
        sub.mode, sub.armed, sub.mission = AUTO, armed, mission

    link, sub, _ = join(idle_in_auto)
    assert link.report(0.2).state in (State.IDLE, State.FINISHED)
    link.upload(upload)
    link.start()
    assert (sub.mode, sub.armed, sub.mission, sub.current) == (AUTO, True, RUNNING, 1)


def test_a_start_counts_when_the_mission_is_active(join, upload):
    link, sub, _ = join(limits=replace(LIMITS, attempts=2))
    link.upload(upload)
    sub.starts = False
    with pytest.raises(Lost, match="mode AUTO with an active mission"):
        link.start()
    assert not sub.armed
    assert link.now == 0.0


def test_just_booted_it_is_armed_only_where_auto_would_be_taken(joined):
    link, sub, upload = joined
    link.upload(upload)
    sub.located = False
    armed = []
    threading.Timer(0.8, lambda: (armed.append(sub.armed), setattr(sub, "located", True))).start()
    link.start()
    assert armed == [False]
    assert sub.mission == RUNNING


def test_without_a_position_it_is_not_armed(join, upload):
    link, sub, _ = join(limits=replace(LIMITS, connect=0.5))
    link.upload(upload)
    sub.located = False
    with pytest.raises(Refused, match="Poshold requires position"):
        link.start()
    assert not sub.armed


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"armed": False}, "it was disarmed"),
        ({"mode": MANUAL}, "it was set to mode MANUAL"),
        ({"mode": SURFACE}, "it was set to mode SURFACE"),
        ({"failsafe": True}, "it reports a failsafe"),
    ],
)
def test_what_somebody_else_ends_stays_ended(under_way, change, why):
    """What lasts shorter than the time between two looks is kept in mind."""
    link, sub, upload = under_way
    before = {name: getattr(sub, name) for name in change}
    changed(sub, **change)
    changed(sub, **before)
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
    link, sub, _ = under_way
    monkeypatch.setattr("auvplan.link.mavlink._GAP", 0.3)
    sub.quiet = True
    time.sleep(0.6)
    sub.armed, sub.current = False, 6
    sub.port.mav.mission_item_reached_send(5)
    changed(sub, quiet=False)
    report = link.report(0.1)
    assert (report.state, report.done) == (State.STOPPED, 0)


def test_an_old_heartbeat_is_no_new_mode(under_way):
    link, sub, _ = under_way
    sub.port.mav.seq = (sub.port.mav.seq - 5) % 256
    sub.port.mav.heartbeat_send(12, 3, 129, POSHOLD, 4)
    sub.port.mav.seq = (sub.port.mav.seq + 4) % 256
    time.sleep(0.3)
    assert link.report(0.1).state is State.EXECUTING


def test_what_it_does_alone_is_read_and_said(join):
    """FS_GCS_ENABLE disarms by default (ArduSub/Parameters.cpp), 5 s after the last heartbeat."""
    link, sub, notes = join()
    assert link.left_alone == (
        "it stops its motors, under water too, 5 s after the last heartbeat (FS_GCS_ENABLE is 2)"
    )
    assert link.left_alone in notes[0]
    assert any("FS_PILOT_INPUT is 2" in note for note in notes)
    assert any("FS_LEAK_ENABLE is 1" in note for note in notes)
    assert sub.parameters["FS_GCS_ENABLE"] == 2.0


@pytest.mark.parametrize(
    ("wanted", "action", "said"), [("continue", 0.0, "goes on"), ("surface", 4.0, "surfaces")]
)
def test_what_it_does_alone_is_set(join, wanted, action, said):
    _, sub, notes = join(link_loss=wanted)
    assert sub.parameters["FS_GCS_ENABLE"] == action
    assert sub.parameters["FS_PILOT_INPUT"] == 0.0
    assert any(note.startswith("if the link is lost") and said in note for note in notes)


def test_nothing_is_set_on_a_vehicle_that_executes_a_plan(join):
    def busy(sub):
        sub.mode, sub.armed, sub.mission = AUTO, True, RUNNING

    link, sub, _ = join(busy, link_loss="surface")
    assert link.report(0.1).state is State.EXECUTING
    assert sub.parameters["FS_GCS_ENABLE"] == 2.0


def test_a_failsafe_before_the_start_prevents_it(join, upload):
    """Without a pilot's console there is one from boot on (Sub::failsafe_pilot_input_check)."""
    limits = replace(LIMITS, connect=0.7)
    link, sub, _ = join(lambda sub: setattr(sub, "failsafe", True), limits)
    link.upload(upload)
    with pytest.raises(Refused, match="reports a failsafe"):
        link.start()
    assert not sub.armed
    link, sub, _ = join(lambda sub: setattr(sub, "failsafe", True), limits, link_loss="continue")
    link.upload(upload)
    link.start()
    assert sub.armed


def test_a_refusal_has_its_name(joined):
    link, sub, upload = joined
    sub.refusal = 4
    with pytest.raises(Refused, match="refuses the plan: no space"):
        link.upload(upload)
