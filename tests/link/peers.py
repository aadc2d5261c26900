"""Vehicles at the other end of a link: MAVSDK's autopilot side, and a peer of imcpy's messages.

Both move a body along what was uploaded, in scaled time, and keep books of their own: what was uploaded, and
which tasks were done. Nothing of `auvplan.link` is used.
"""

import json
import math
import os
import re
import socket
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from pyproj import Geod

_GEOD = Geod(ellps="WGS84")

#: s of wall-clock time between two steps of a body.
_TICK = 0.01

#: s in which all but 1/e of a stream is learnt.
_LEARNS = 31.0

#: m/s at which a body comes up.
_RISE = 1.0

#: Identifier of the peer among IMC's addresses.
_IMC_VEHICLE = 0x001C


@dataclass
class Task:
    """A hold that was completed, where the body was; degrees, m and s."""

    latitude: float
    longitude: float
    depth: float
    seconds: float


@dataclass
class Body:
    """A body that moves at a speed over ground, or makes one along its hull.

    Attributes:
        latitude, longitude: degrees.
        depth: m.
        pace: share of the commanded speed that it makes; `stuck` makes none.
        push: m/s, north and east, by which it is driven off its way.
        stream: m/s, north and east, of the water: it keeps its way by crabbing. What it makes over ground is
            the commanded speed along its hull, as a Doppler log sees it, once it has learnt what the stream
            adds (DUNE: Control/AUV/Speed).
        learnt: m/s of that.
    """

    latitude: float
    longitude: float
    depth: float
    pace: float = 1.0
    stuck: bool = False
    push: tuple[float, float] = (0.0, 0.0)
    stream: tuple[float, float] = (0.0, 0.0)
    learnt: float = 0.0
    speed: float = 1.0
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def drift(self, seconds: float) -> None:
        if self.push != (0.0, 0.0):
            way = math.hypot(*self.push) * seconds
            self._go(math.degrees(math.atan2(self.push[1], self.push[0])), way)

    def towards(
        self, latitude: float, longitude: float, depth: float, seconds: float, ahead: float = 0.0
    ) -> float:
        """Move; return s that are left after arrival, so many s ahead of it, or -1 on the way."""
        bearing, _, level = _GEOD.inv(self.longitude, self.latitude, longitude, latitude)
        gap, speed = math.hypot(level, depth - self.depth), self.pace * self._made(bearing, seconds)
        if self.stuck:
            self.velocity = np.zeros(3)
            return -1.0
        way = max(gap - speed * ahead, 0.0)
        if way <= speed * seconds and not ahead:
            self.latitude, self.longitude, self.depth = latitude, longitude, depth
            return seconds - gap / speed
        share = min(speed * seconds, way) / max(gap, 1e-9)
        angle = math.radians(bearing)
        self.velocity = (
            speed / gap * np.array([level * math.cos(angle), level * math.sin(angle), depth - self.depth])
        )
        self._go(bearing, share * level)
        self.depth += share * (depth - self.depth)
        return seconds - way / speed if way <= speed * seconds else -1.0

    def _made(self, bearing: float, seconds: float) -> float:
        """Return m/s over ground along a bearing, degrees, and learn what the stream adds along the hull."""
        north, east = self.stream
        angle, total = math.radians(bearing), north**2 + east**2
        along, water = north * math.cos(angle) + east * math.sin(angle), max(self.speed - self.learnt, 0.1)
        made = along + math.sqrt(max(water**2 - total + along**2, 0.0))
        added = (made * along - total) / water
        self.learnt += (1.0 - math.exp(-seconds / _LEARNS)) * (added - self.learnt)
        return made

    def rise(self, seconds: float) -> bool:
        """Come up; return whether it is at the surface."""
        self.velocity = np.array([0.0, 0.0, -_RISE])
        self.depth = max(self.depth - _RISE * seconds, 0.0)
        return self.depth == 0.0

    def _go(self, bearing: float, way: float) -> None:
        self.longitude, self.latitude, _ = _GEOD.fwd(self.longitude, self.latitude, bearing, way)


class _Peer:
    """A thread that moves a body and reports."""

    def __init__(self, body: Body, scale: float) -> None:
        self.body, self.scale = body, scale
        self.tasks: list[Task] = []
        self.left = 0.0  # s of a hold
        self.lock = threading.RLock()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        last, stated = time.monotonic(), 0.0
        while not self._closed.wait(_TICK):
            now = time.monotonic()
            with self.lock:
                self._step((now - last) * self.scale)
            last = now
            if now - stated >= 5.0 * _TICK:
                stated = now
                self._tell()

    def _step(self, seconds: float) -> None:
        raise NotImplementedError

    def _tell(self) -> None:
        raise NotImplementedError

    def close(self) -> None:
        self._closed.set()
        self._thread.join(timeout=2.0)


class MavsdkPeer(_Peer):
    """The autopilot side of MAVSDK: its mission server takes uploads, its telemetry server reports.

    Attributes:
        missions, fences: every upload that was accepted.
        refuse: commands, by number, that are answered with "denied".
    """

    def __init__(self, port: int, body: Body, scale: float) -> None:
        from mavsdk import ComponentType, Configuration, Mavsdk
        from mavsdk.plugins import action_server, mavlink_direct_server, mission_raw_server, telemetry_server

        super().__init__(body, scale)
        self._telemetry, self._direct = telemetry_server, mavlink_direct_server
        self._configuration = Configuration.create_with_component_type(ComponentType.AUTOPILOT)
        self._mavsdk = Mavsdk(self._configuration)
        self._mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}")
        component = self._mavsdk.server_component()
        self._reports = telemetry_server.TelemetryServer(component)
        self._actions = action_server.ActionServer(component)
        self._missions = mission_raw_server.MissionRawServer(component)
        self._raw = mavlink_direct_server.MavlinkDirectServer(component)
        self._actions.set_armable(True, True)
        self._actions.set_disarmable(True, True)
        self.missions: list = []
        self.fences: list = []
        self.refuse: set[int] = set()
        self.items: list = []
        self.index, self.state = 0, 2  # of MISSION_CURRENT: not started
        self.arrived = False
        self._missions.subscribe_incoming_mission(self._incoming)
        self._raw.subscribe_message("MISSION_SET_CURRENT", self._set_current)
        for command, state in ((300, 3), (193, 4), (21, 9)):
            self._raw.subscribe_command(command, self._command, state)
        self._thread.start()

    def _incoming(self, result, plan, _) -> None:
        if int(result) != 1:
            return
        with self.lock:
            items = list(plan.mission_items)
            if items and items[0].mission_type == 1:
                self.fences.append(items)
                return
            self.missions.append(items)
            self.items, self.index, self.left, self.arrived = items, 0, 0.0, False

    def _set_current(self, message, _) -> None:
        seq = json.loads(message.fields_json)["seq"]
        with self.lock:
            if seq != self.index:
                self.index, self.left, self.arrived = seq, 0.0, False

    def _command(self, message, state) -> None:
        fields = json.loads(message.fields_json)
        command = int(fields["command"])
        with self.lock:
            result = 2 if command in self.refuse else 0
            if result == 0:
                self.state = state
        answer = {"command": command, "result": result, "progress": 255, "result_param2": 0}
        answer |= {"target_system": message.system_id, "target_component": message.component_id}
        self._raw.send_message(self._direct.MavlinkMessage("COMMAND_ACK", 1, 1, 0, 0, json.dumps(answer)))

    def _step(self, seconds: float) -> None:
        body = self.body
        body.velocity = np.zeros(3)
        if self.state == 9:
            body.rise(seconds)
            return
        if self.state != 3:
            return
        body.drift(seconds)
        while seconds > 0.0 and self.index < len(self.items):
            item = self.items[self.index]
            if item.command == 178:
                body.speed = item.param2
            elif item.command == 21:
                if not body.rise(seconds):
                    return
            elif item.command == 16 and not self.arrived:
                seconds = body.towards(item.x * 1e-7, item.y * 1e-7, -item.z, seconds)
                if seconds < 0.0:
                    return
                self.arrived, self.left = True, item.param1
            if self.left > seconds:
                self.left -= seconds
                return
            seconds -= self.left
            if item.command == 16 and item.param1 > 0.0:
                self.tasks.append(Task(item.x * 1e-7, item.y * 1e-7, -item.z, item.param1))
            self.left, self.arrived = 0.0, False
            self.index += 1
            self._missions.set_current_item_complete()
        if self.items and self.index >= len(self.items):
            self.state = 5

    def _tell(self) -> None:
        body, stated = self.body, self._telemetry
        with self.lock:
            place = stated.Position(body.latitude, body.longitude, -body.depth, -body.depth)
            velocity = stated.VelocityNed(*(float(part) for part in body.velocity))
            current = {"seq": self.index, "total": len(self.items), "mission_state": min(self.state, 5)}
        self._reports.publish_position(place, velocity, stated.Heading(0.0))
        if self.state in (3, 4, 5):
            text = json.dumps(current | {"mission_mode": 1})
            self._raw.send_message(self._direct.MavlinkMessage("MISSION_CURRENT", 1, 1, 0, 0, text))

    def close(self) -> None:
        super().close()
        self._mavsdk.destroy()
        self._configuration.destroy()


class ImcPeer(_Peer):
    """A vehicle of imcpy's messages that behaves as LSTS's DUNE does.

    - What comes from a system that has not announced itself is dropped, and nothing is sent to it. Answers
      go to the first `imc+udp` service that it announced, for good (Transports/UDP, Transports/Discovery).
    - After an Abort it is in ERROR for 0.2 s and its plans are blocked, then ready, with the outcome FAILURE
      and the cause as its last error; a stop leaves the outcome alone (Supervisors/Vehicle, Plan/Engine).
    - A plan that is replaced leaves FAILURE as well, while the next is executed (Plan/Engine, startPlan).
    - A start is carried out again whenever it comes (Plan/Engine has no memory of requests).
    - Its back seat takes whoever connects, by TCP (Transports/TCP/Server, etc/auv/transports.ini).
    - A waypoint counts as reached 5 s ahead ("Time Of Arrival Factor", etc/auv/general.ini); loitering is
      counted once it is on its circle (Maneuver/Multiplexer/Loiter).

    Attributes:
        host, port, back_seat: address that it listens on, one of loopback's, and ports of UDP and TCP.
        through: that all is sent to instead of the announced address, such as a proxy's.
        stored: plans by identifier, as they came.
        started: identifiers of the plans that were executed, in order.
        ahead, settles: s that it counts a waypoint as reached ahead, and that it takes to begin to loiter.
    """

    def __init__(self, body: Body, scale: float) -> None:
        import imcpy

        super().__init__(body, scale)
        self._imc = imcpy
        self.host = ".".join(["127", *(str(1 + part % 254) for part in os.urandom(3))])
        self._socket, self._discovery = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._socket.bind((self.host, 0))
        self._discovery.bind((self.host, 30100))
        self._socket.settimeout(0.1)
        self._discovery.settimeout(0.1)
        self.port = int(self._socket.getsockname()[1])
        self._server, self._riders = socket.create_server((self.host, 0)), []
        self.back_seat = int(self._server.getsockname()[1])
        self._nodes: dict[int, tuple[str, int]] = {}
        self._heard: set[int] = set()
        self.through = None
        self.stored: dict = {}
        self.started: list[str] = []
        self.refuse = False
        self.ahead = self.settles = 0.0
        self._plan, self._name, self._man, self._points = None, "", "", []
        self._outcome = imcpy.PlanControlState.LastPlanOutcomeEnum.NONE
        self._rising, self._error, self._words, self._worded = False, -math.inf, "", -1.0
        self._thread.start()
        self._listeners = [
            threading.Thread(target=self._listen, args=(end,), daemon=True)
            for end in (self._socket, self._discovery)
        ]
        self._listeners.append(threading.Thread(target=self._carry, daemon=True))
        for listener in self._listeners:
            listener.start()

    @property
    def clients(self) -> list[tuple[str, int]]:
        """Where what it says goes to."""
        return [self.through or self._nodes[source] for source in self._heard]

    def _listen(self, end) -> None:
        while not self._closed.is_set():
            try:
                data, (address, _) = end.recvfrom(65_535)
            except OSError:
                continue
            message = self._imc.Packet.deserialize(data)
            with self.lock:
                if end is self._discovery:
                    self._announced(message)
                    continue
                node = self._nodes.get(message.src)
                if node is None:
                    continue
                if node[0] == address:
                    self._heard.add(message.src)
                self._take(message)

    def _take(self, message) -> None:
        if isinstance(message, self._imc.PlanDB | self._imc.PlanControl):
            self._request(message)
        elif isinstance(message, self._imc.Abort) and message.dst == _IMC_VEHICLE:
            self.abort(message.src)

    def _carry(self) -> None:
        """Take in what comes by TCP."""
        self._server.settimeout(0.1)
        while not self._closed.is_set():
            try:
                rider, _ = self._server.accept()
            except OSError:
                continue
            rider.settimeout(0.1)
            self._riders.append(rider)
            threading.Thread(target=self._ride, args=(rider, self._imc.Parser()), daemon=True).start()

    def _ride(self, rider, parser) -> None:
        while not self._closed.is_set():
            try:
                data = rider.recv(65_535)
            except TimeoutError:
                continue
            except OSError:
                return
            while data:
                message, used = parser.parse(data)
                data = data[used:]
                if message is not None:
                    with self.lock:
                        self._take(message)

    def _announced(self, message) -> None:
        for service in message.services.split(";"):
            if found := re.match(r"imc\+udp://([^:]+):(\d+)/", service):
                self._nodes.setdefault(message.src, (found[1], int(found[2])))

    def abort(self, source: int = 0x4101) -> None:
        """Give the plan up, as any console may ask for."""
        with self.lock:
            self._words = f"got abort request from system ccu - 0x{source:04X} @ 0x00"
            self._error, self._worded, self._rising = time.monotonic(), time.time(), True
            self._end_plan()

    def fail(self, words: str) -> None:
        """Give the plan up, in a state of fault for 0.2 s."""
        with self.lock:
            self._words, self._error, self._rising = words, time.monotonic(), True
            self._end_plan()

    def stop(self) -> None:
        """Stop the plan, as any console may ask for."""
        with self.lock:
            self._end_plan()

    def halt(self) -> None:
        """Forget what it does, as after its processes were halted: the plan is blocked, and did not fail."""
        with self.lock:
            self._plan = None

    def restart(self) -> None:
        """Start anew, without a plan."""
        with self.lock:
            self._plan, self._name, self._words = None, "", ""
            self._outcome = self._imc.PlanControlState.LastPlanOutcomeEnum.NONE

    def _end_plan(self) -> None:
        self._plan, self._outcome = None, self._imc.PlanControlState.LastPlanOutcomeEnum.FAILURE
        self._tell()

    def _request(self, message) -> None:
        answer = type(message)()
        answer.op, answer.request_id, answer.plan_id = message.op, message.request_id, message.plan_id
        good = (
            self._database(message, answer)
            if isinstance(message, self._imc.PlanDB)
            else self._control(message)
        )
        kinds = type(message).TypeEnum
        answer.type = kinds.SUCCESS if good and not self.refuse else kinds.FAILURE
        answer.info = "" if good else "unknown plan"
        self._send(answer)

    def _database(self, message, answer) -> bool:
        operations = self._imc.PlanDB.OperationEnum
        if message.op == operations.SET:
            self.stored[message.plan_id] = message.arg
        elif message.op == operations.GET and message.plan_id in self.stored:
            answer.arg = self.stored[message.plan_id]
        else:
            return False
        return True

    def _control(self, message) -> bool:
        if message.op != self._imc.PlanControl.OperationEnum.START or self.refuse:
            return False
        plan = message.arg if message.arg is not None else self.stored.get(message.plan_id)
        if plan is None:
            return False
        if self._plan is not None:
            self._outcome = self._imc.PlanControlState.LastPlanOutcomeEnum.FAILURE
        self.started.append(message.plan_id)
        self._plan, self._name, self._rising, self._words = plan, message.plan_id, False, ""
        self._enter(plan.start_man_id)
        self._tell()
        return True

    def _enter(self, name: str) -> None:
        imc = self._imc
        self._man = name
        (step,) = (step for step in self._plan.maneuvers if step.maneuver_id == name)
        self._step_data = data = step.data
        place = math.degrees(data.lat), math.degrees(data.lon), data.z
        self._points, self.left = [place], 0.0
        self.body.speed = data.speed
        if isinstance(data, imc.FollowPath):
            self._points = []
            for point in data.points:
                bearing = math.degrees(math.atan2(point.y, point.x))
                east, north, _ = _GEOD.fwd(place[1], place[0], bearing, math.hypot(point.x, point.y))
                self._points.append((north, east, place[2] + point.z))
        elif isinstance(data, imc.Loiter | imc.StationKeeping):
            self.left = float(data.duration) + self.settles if data.duration else math.inf

    def _step(self, seconds: float) -> None:
        body = self.body
        body.velocity = np.zeros(3)
        if self._rising:
            body.rise(seconds)
        if self._plan is None:
            return
        body.drift(seconds)
        while seconds > 0.0:
            while self._points:
                ahead = 0.0 if self._step_data.msg_name in ("Loiter", "StationKeeping") else self.ahead
                left = body.towards(*self._points[0], seconds, ahead)
                if left < 0.0:
                    return
                seconds = left
                self._points.pop(0)
            if self.left > seconds:
                self.left -= seconds
                return
            seconds -= self.left
            if self._man.startswith("task"):
                duration = float(self._step_data.duration)
                self.tasks.append(Task(body.latitude, body.longitude, body.depth, duration))
            following = [move for move in self._plan.transitions if move.source_man == self._man]
            if not following:
                self._plan = None
                self._outcome = self._imc.PlanControlState.LastPlanOutcomeEnum.SUCCESS
                return
            self._enter(following[0].dest_man)

    def _tell(self) -> None:
        imc, body = self._imc, self.body
        place, control, vehicle = imc.EstimatedState(), imc.PlanControlState(), imc.VehicleState()
        with self.lock:
            place.lat, place.lon = math.radians(body.latitude), math.radians(body.longitude)
            place.depth = body.depth
            place.vx, place.vy, place.vz = (float(part) for part in body.velocity)
            states, modes = control.StateEnum, vehicle.OperationModeEnum
            error = time.monotonic() - self._error < 0.2
            control.state = states.READY if self._plan is None else states.EXECUTING
            vehicle.op_mode = modes.SERVICE if self._plan is None else modes.MANEUVER
            if error:
                control.state, vehicle.op_mode = states.BLOCKED, modes.ERROR
            control.plan_id = self._name
            control.man_id = "" if self._plan is None else self._man
            control.last_outcome, vehicle.last_error = self._outcome, self._words
            vehicle.last_error_time = self._worded
            for message in (place, vehicle, control):
                self._send(message)

    def _send(self, message) -> None:
        message.src = _IMC_VEHICLE
        message.set_timestamp_now()
        data = self._imc.Packet.serialize(message)
        with suppress(OSError):
            for client in self.clients:
                self._socket.sendto(data, client)
            for rider in self._riders:
                rider.sendall(data)

    def close(self) -> None:
        super().close()
        for listener in self._listeners:
            listener.join(timeout=2.0)
        for end in (self._socket, self._discovery, self._server, *self._riders):
            end.close()
