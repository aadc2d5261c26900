"""ArduSub's ways, by a small peer: home is item 0, modes start, hold and surface; uploads hold it."""

import threading
import time

import pytest

from auvplan.link import Limits, Refused, State, Upload, open_link

mavutil = pytest.importorskip("pymavlink.mavutil", reason="needs pymavlink: pip install 'auvplan[link]'")

from tests.link.proxy import free_port  # noqa: E402

LIMITS = Limits(reply=0.3, attempts=5, connect=5.0, outdated=0.1)
AUTO, POSHOLD, SURFACE = 3, 16, 9


class Sub:
    """Heartbeats, modes and the mission protocol as ArduSub has them; item 0 is a home of its own."""

    def __init__(self, port):
        self.port = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=1, source_component=1
        )
        self.mode, self.armed, self.modes = 0, False, []
        self.items = {0: [], 1: []}
        self.refusal = 0
        self.sending = None
        self.current = 0
        self.closed = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        beat = 0.0
        while not self.closed.is_set():
            mav = self.port.mav
            if time.monotonic() - beat > 0.1:
                beat = time.monotonic()
                mav.heartbeat_send(12, 3, 128 * self.armed | 1, self.mode, 4)
                mav.global_position_int_send(0, -413000000, 1799950000, 0, -12500, 0, 0, 0, 0)
                mav.mission_current_send(self.current)
            message = self.port.recv_match(blocking=True, timeout=0.02)
            if message is not None and (take := getattr(self, message.get_type().lower(), None)):
                take(mav, message)

    def command_long(self, mav, message):
        if message.command == 400:
            self.armed = bool(message.param1)
        elif message.command == 176:
            self.mode = int(message.param2)
            self.modes.append(self.mode)
        mav.command_ack_send(message.command, 0)

    def mission_count(self, mav, message):
        if self.refusal:
            mav.mission_ack_send(255, 190, self.refusal, message.mission_type)
            return
        self.sending = message.mission_type, message.count, []
        mav.mission_request_int_send(255, 190, 0, message.mission_type)

    def mission_item_int(self, mav, message):
        kind, count, items = self.sending
        if message.seq == len(items):
            items.append(message)
        if len(items) < count:
            mav.mission_request_int_send(255, 190, len(items), kind)
            return
        if kind == 0:
            items[0].x += 1000  # home is where it was armed
        self.items[kind] = items
        mav.mission_ack_send(255, 190, 0, kind)

    def mission_request_list(self, mav, message):
        mav.mission_count_send(255, 190, len(self.items[message.mission_type]), message.mission_type)

    def mission_request_int(self, mav, message):
        held = self.items[message.mission_type][message.seq]
        params = held.param1, held.param2, held.param3, held.param4
        place = held.x, held.y, held.z
        mav.mission_item_int_send(
            255, 190, message.seq, held.frame, held.command, 0, 1, *params, *place, message.mission_type
        )

    def mission_set_current(self, mav, message):
        self.current = message.seq
        mav.mission_current_send(self.current)

    def close(self):
        self.closed.set()
        self.thread.join(timeout=2.0)
        self.port.close()


@pytest.fixture
def joined(upload, opened):
    port = free_port()
    link = open_link(f"mavlink:udpin:127.0.0.1:{port}", upload.itinerary.site, LIMITS)
    sub = Sub(port)
    opened.extend([link, sub])
    link.connect()
    return link, sub, upload


def test_home_comes_first_and_modes_start_hold_and_surface(joined):
    link, sub, upload = joined
    assert link.upload(upload) == []
    assert [item.command for item in sub.items[0]] == [16, 178, *[16] * 5, 21]
    assert len(sub.items[1]) == 8
    sub.mode = AUTO
    time.sleep(0.3)
    assert link.wait(0.1).state is State.IDLE, "it is not armed"
    link.start()
    assert sub.armed
    time.sleep(0.3)
    assert link.wait(0.1).state is State.EXECUTING
    sub.current = 5
    time.sleep(0.3)
    assert link.wait(0.1).done == 3, "home and the speed are no steps"
    link.hold()
    time.sleep(0.3)
    assert link.wait(0.1).state is State.HOLDING
    link.abort()
    assert sub.modes == [AUTO, POSHOLD, SURFACE]


def test_it_is_held_while_another_plan_goes_up(joined):
    link, sub, upload = joined
    link.upload(upload)
    link.start()
    link.upload(Upload(upload.itinerary, 2))
    link.start(2)
    assert sub.modes == [AUTO, POSHOLD, AUTO]
    assert sub.current == 4


def test_a_refusal_has_its_name(joined):
    link, sub, upload = joined
    sub.refusal = 4
    with pytest.raises(Refused, match="refuses the plan: no space"):
        link.upload(upload)
