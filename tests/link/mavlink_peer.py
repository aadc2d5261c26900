"""MAVLink vehicles of pymavlink alone: odd ones are a class of their own, and so are ArduSub's ways."""

import math
import threading
import time

import pytest

mavutil = pytest.importorskip("pymavlink.mavutil", reason="needs pymavlink: pip install 'auvplan[link]'")

#: Modes of ArduSub, and states of MISSION_CURRENT.
MANUAL, AUTO, POSHOLD, SURFACE = 19, 3, 16, 9
STOPPED, RUNNING, COMPLETE = 2, 3, 5

#: Parameters of an item that ArduPilot keeps, by command (libraries/AP_Mission/AP_Mission.cpp).
KEPT = {16: (0,), 21: (0,), 178: (0, 1, 2)}


class Stranger:
    """A vehicle of the common message set; what is odd of it is a method of a subclass.

    Attributes:
        held: items of missions and of fences, as they came.
        armed, current, state, located: whether and what it says of itself.
        quiet: whether it says nothing.
    """

    def __init__(self, address, place, system=1):
        self.port = mavutil.mavlink_connection(
            address, source_system=system, source_component=1, dialect="ardupilotmega"
        )
        self.place, self.held, self.coming = place, {0: [], 1: []}, None
        self.armed, self.current, self.state, self.located, self.quiet = False, 0, STOPPED, True, False
        self.closed = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        beat = 0.0
        while not self.closed.is_set():
            mav = self.port.mav
            try:
                if time.monotonic() - beat > 0.1 and not self.quiet:
                    beat = time.monotonic()
                    self.beat()
                    self.often(mav)
                message = self.port.recv_match(blocking=True, timeout=0.02)
            except OSError:
                self.closed.wait(0.02)
                continue
            take = message and getattr(self, message.get_type().lower(), None)
            if take:
                take(mav, message)

    def beat(self):
        self.say_hello(self.port.mav)
        if self.located:
            latitude, longitude = (round(part * 1e7) for part in self.place)
            self.port.mav.global_position_int_send(0, latitude, longitude, 0, -12500, 0, 0, 0, 0)
        self.say_current()

    def say_hello(self, mav):
        mav.heartbeat_send(12, 8, 128 * self.armed, 0, 4)

    def say_current(self):
        self.port.mav.mission_current_send(self.current, len(self.held[0]), self.state, 1)

    def often(self, mav):
        pass

    def changed(self, **values):
        """Change what it says, and have it heard, once."""
        for name, value in values.items():
            setattr(self, name, value)
        self.beat()
        time.sleep(0.15)

    def command_long(self, mav, message):
        if message.command == 400:
            self.armed = bool(message.param1)
        elif message.command == 300:
            self.state = RUNNING
        mav.command_ack_send(message.command, 0)

    def ask(self, mav, number, kind):
        mav.mission_request_int_send(255, 190, number, kind)

    def mission_count(self, mav, message):
        self.coming = message.mission_type, message.count, {}
        if message.count:
            self.ask(mav, 0, message.mission_type)
        else:
            self.held[message.mission_type] = []
            mav.mission_ack_send(255, 190, 0, message.mission_type)

    def kept(self, message, kind):
        """What it keeps of an item: frame, command, four parameters and the place."""
        params = message.param1, message.param2, message.param3, message.param4
        return message.frame, message.command, *params, message.x, message.y, message.z

    def mission_item_int(self, mav, message):
        kind, count, items = self.coming
        items[message.seq] = self.kept(message, kind)
        if len(items) < count:
            self.ask(mav, min(set(range(count)) - set(items)), kind)
        else:
            self.held[kind] = [items[k] for k in range(count)]
            mav.mission_ack_send(255, 190, 0, kind)

    def mission_request_list(self, mav, message):
        kind = message.mission_type
        mav.mission_count_send(255, 190, len(self.held[kind]), kind)

    def mission_request_int(self, mav, message):
        kind = message.mission_type
        if message.seq < len(self.held[kind]):
            frame, command, *rest = self.held[kind][message.seq]
            mav.mission_item_int_send(255, 190, message.seq, frame, command, 0, 1, *rest, kind)

    def mission_set_current(self, mav, message):
        self.current = message.seq
        self.say_current()

    def close(self):
        self.closed.set()
        self.thread.join(timeout=2.0)
        self.port.close()


class Sub(Stranger):
    """Heartbeats, modes, failsafes and the mission protocol as ArduSub has them.

    Attributes:
        modes: that it was set to.
        refusal: MAV_MISSION_RESULT of all uploads, or 0.
        forgets: makes of what it should keep of an item what it does.
        starts: whether its mission becomes active.
        loses: requests for another item that do not arrive.
    """

    def __init__(self, address, place):
        self.mode, self.modes, self.refusal, self.starts, self.loses = 0, [], 0, True, 0
        self.failsafe, self.speed, self.forgets = False, math.nan, lambda item: item
        self.parameters = {
            "FS_GCS_ENABLE": 2.0, "FS_GCS_TIMEOUT": 5.0, "FS_PILOT_INPUT": 2.0, "FS_PILOT_TIMEOUT": 3.0,
            "FS_LEAK_ENABLE": 1.0,
        }  # fmt: skip
        super().__init__(address, place)

    @property
    def items(self):
        return self.held[0]

    def beat(self):
        located, self.located = self.located, True  # it says where it is before AUTO would be taken
        super().beat()
        self.located = located

    def say_hello(self, mav):
        status = 5 if self.failsafe else 4 if self.armed else 3  # GCS_MAVLINK_Sub::vehicle_system_status
        mav.heartbeat_send(12, 3, 128 * self.armed | 1, self.mode, status)

    def set_mode(self, mode):
        """Sub::set_mode (ArduSub/mode.cpp)."""
        if mode == self.mode:
            return True  # which begins nothing
        if mode in (AUTO, POSHOLD) and not self.located:
            name = {AUTO: "Auto", POSHOLD: "Poshold"}[mode]
            self.port.mav.statustext_send(4, f"Mode change failed: {name} requires position".encode())
            return False
        if self.mode == AUTO and self.state == RUNNING:
            self.state = STOPPED
        if mode == AUTO:
            self.state = RUNNING if self.starts else STOPPED
            self.speed = 10.0  # ModeAuto::init: that of WP_SPD
        self.mode = mode
        self.modes.append(mode)
        self.beat()
        return True

    def command_long(self, mav, message):
        taken = True
        if message.command == 400:
            self.armed = bool(message.param1)
            self.state = self.state if self.armed else STOPPED
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
        else:
            super().mission_count(mav, message)

    def kept(self, message, kind):
        """What is left of an item of a mission once it is stored (AP_Mission.cpp)."""
        frame, command, *given, x, y, z = super().kept(message, kind)
        if kind:
            return frame, command, *given, x, y, z
        assert not any(map(math.isnan, given[:3])), "refused as invalid (AP_Mission::sanity_check_params)"
        params = [part if k in KEPT[command] else 0.0 for k, part in enumerate(given)]
        if command == 21:
            params[3] = 1.0  # a direction of yaw that nobody gave
        place = (x, y, int(z * 100.0) / 100.0)
        if command == 178:
            place = (0, 0, 0.0)
        elif message.seq == 0:
            place = (x + 1000, y, 0.0)  # home is where it was armed
        return self.forgets((0 if command == 178 or message.seq == 0 else 3, command, *params, *place))

    def mission_set_current(self, mav, message):
        """AP_Mission::set_current_cmd: a mission that is complete is stopped then, and AUTO resumes it."""
        if self.loses > 0:
            self.loses -= 1
            return
        self.current = max(message.seq, 1)
        self.state = RUNNING if self.state == RUNNING else STOPPED
        mav.mission_current_send(message.seq, len(self.items), self.state, int(self.mode == AUTO))


def place_of(upload):
    longitude, latitude = upload.itinerary.site.to_geographic(*upload.steps[0].position[:2])
    return float(latitude), float(longitude)


__all__ = ["AUTO", "COMPLETE", "MANUAL", "POSHOLD", "RUNNING", "SURFACE", "Stranger", "Sub", "place_of"]
