"""A vehicle that speaks MAVLink: ArduSub, PX4, or whatever follows the common message set.

Plans go there by the mission protocol (MISSION_COUNT, MISSION_REQUEST_INT, MISSION_ITEM_INT, MISSION_ACK), as
the items of its `.plan` file, with the fence; what is there is read back and compared.
"""

import logging
import math
import os
import threading
import time
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from auvplan.export.qgroundcontrol import item_speeds, qgc_plan
from auvplan.link import ardusub
from auvplan.link.limits import Allowance, Limits
from auvplan.link.listening import ListeningLink
from auvplan.link.vehicle import LinkError, Lost, Refused, State, Upload
from auvplan.site import Site

_log = logging.getLogger(__name__)

#: Ground station by system and component.
_OURS = 255, 190

#: s for which words of warning may be the reason of what happens.
_NEWS = 10.0

#: s that other vehicles on the link are looked for, within which a message may come behind others that were
#: sent after it, and without a message in which the vehicle may have been taken from us.
_OTHERS, _BEHIND, _GAP = 1.5, 1.0, 3.0

#: Mission types: waypoints and fences.
MISSION, FENCE = 0, 1

#: MAV_CMD_NAV_WAYPOINT, _NAV_FENCE_POLYGON_VERTEX_EXCLUSION and _NAV_FENCE_CIRCLE_EXCLUSION.
_WAYPOINT, _CORNER, _CIRCLE = 16, 5002, 5004

#: MAV_CMD_COMPONENT_ARM_DISARM, _DO_SET_MODE, _MISSION_START, _DO_PAUSE_CONTINUE, _NAV_LAND and
#: _DO_CHANGE_SPEED.
_ARM, _SET_MODE, _START, _PAUSE, _LAND, _SPEED = 400, 176, 300, 193, 21, 178

#: MAV_FRAME_GLOBAL, of fences, and MAV_FRAME_MISSION, of items without a place.
_GLOBAL, _NO_PLACE = 0, 2

#: MAV_AUTOPILOT_ARDUPILOTMEGA, MAV_AUTOPILOT_PX4, MAV_TYPE_SUBMARINE and MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.
_ARDUPILOT, _PX4, _SUBMARINE, _CUSTOM = 3, 12, 12, 1

#: MAV_STATE_CRITICAL, _EMERGENCY, _POWEROFF and _FLIGHT_TERMINATION; MAV_SEVERITY_WARNING.
_FAULTS, _WARNING = (5, 6, 7, 8), 4

#: States by MISSION_CURRENT.mission_state, and by ArduSub's mode where it says none.
_STATES = {3: State.EXECUTING, 4: State.HOLDING, 5: State.FINISHED}
_MODES = {
    ardusub.AUTO: State.EXECUTING, ardusub.POSHOLD: State.HOLDING, ardusub.SURFACE: State.SURFACING,
}  # fmt: skip

#: Names of MAV_MISSION_RESULT and MAV_RESULT, by number.
_ACKS = (
    "accepted", "error", "unsupported frame", "unsupported", "no space", "invalid", "invalid param 1",
    "invalid param 2", "invalid param 3", "invalid param 4", "invalid x", "invalid y", "invalid z",
    "invalid sequence", "denied", "cancelled",
)  # fmt: skip
_RESULTS = (
    "accepted", "temporarily rejected", "denied", "unsupported", "failed", "in progress", "cancelled",
)  # fmt: skip

#: MAV_MISSION_OPERATION_CANCELLED; another try may mend that, an error or an invalid sequence.
_CANCELLED, _AGAIN = 15, (1, 13, 15)

#: Messages that answer an offer of items, a request for them, a command, and a question for a parameter.
_OFFERED = ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")
_READ, _COMMANDED, _VALUES = ("MISSION_COUNT", "MISSION_ITEM_INT"), ("COMMAND_ACK",), ("PARAM_VALUE",)

#: Replies' times that are waited after the last item.
_LAST = 3

#: m by which heights may be off that are held as they were sent.
_SAME = 1e-3

#: Items of the steps of an upload, and m/s over ground at which they are gone to.
_Lines = tuple[list[int], list[float]]


@dataclass(frozen=True)
class Item:
    """An item of a mission or a fence, as it is on the wire.

    Attributes:
        frame, command: by MAVLink's numbers.
        params: four numbers, single precision; NaN for what is left to the vehicle.
        x, y: 1e-7 degrees, latitude and longitude.
        z: m.
    """

    frame: int
    command: int
    params: tuple[float, ...]
    x: int
    y: int
    z: float

    @classmethod
    def at(
        cls, frame: int, command: int, params: Sequence[float], place: Sequence[float], z: float = 0.0
    ) -> "Item":
        """Return an item at a place of latitude and longitude, degrees."""
        return cls(frame, command, tuple(params), round(place[0] * 1e7), round(place[1] * 1e7), float(z))

    def same(self, other: "Item", height: float = _SAME) -> bool:
        """Return whether another item says the same, heights within some m of each other.

        What is left to the vehicle may have any value.
        """
        return (
            (self.frame, self.command, self.x, self.y) == (other.frame, other.command, other.x, other.y)
            and abs(self.z - other.z) <= height
            and all(
                math.isnan(a) or abs(a - b) <= 1e-3 + 1e-6 * abs(a)
                for a, b in zip(self.params, other.params, strict=True)
            )
        )

    @property
    def kept(self) -> "Item":
        """Return what ArduPilot keeps of it: the rest is NaN."""
        kept = ardusub.KEPT.get(self.command, range(4))
        params = tuple(part if k in kept else math.nan for k, part in enumerate(self.params))
        return replace(self, frame=_GLOBAL if self.frame == _NO_PLACE else self.frame, params=params)


def mission_items(upload: Upload, ardupilot: bool = False) -> list[Item]:
    """Return the items of an upload's `.plan` file.

    For ArduPilot the planned home comes first, and of each item there is what it keeps.
    """
    mission, items = qgc_plan(upload.itinerary)["mission"], []
    for item in mission["items"]:
        *params, latitude, longitude, height = item["params"]
        values = [math.nan if part is None else float(part) for part in params]
        items.append(Item.at(item["frame"], item["command"], values, (latitude, longitude), height))
    if not ardupilot:
        return items
    *place, height = mission["plannedHomePosition"]
    return [item.kept for item in (Item.at(_GLOBAL, _WAYPOINT, [0.0] * 4, place, height), *items)]


def fence_items(upload: Upload) -> list[Item]:
    """Return the fence of an upload's `.plan` file, corners and circles."""
    fence = qgc_plan(upload.itinerary)["geoFence"]
    corners = [
        Item.at(_GLOBAL, _CORNER, (float(len(area["polygon"])), 0.0, 0.0, 0.0), corner)
        for area in fence["polygons"]
        for corner in area["polygon"]
    ]
    return corners + [
        Item.at(_GLOBAL, _CIRCLE, (float(np.float32(one["radius"])), 0.0, 0.0, 0.0), one["center"])
        for one in (area["circle"] for area in fence["circles"])
    ]


@dataclass
class _Heard:
    """What the vehicle has said."""

    order: int = 0  # number of the newest message
    beat: float = -math.inf  # when the newest heartbeat came
    again: float = -math.inf  # when it was heard again after it was not for some time
    autopilot: int = 0
    kind: int = 0
    mode: int = 0
    armed: bool = False
    fault: bool = False
    current: int = -1
    progress: State = State.UNKNOWN
    text: int = 0  # number of the text that it said last; 0 for one of a single message
    alarm: str = ""  # its last words of warning
    alarmed: float = -math.inf  # when it said them

    @property
    def warned(self) -> str:
        """Its last words of warning, in brackets; empty where they are of long ago."""
        return f" ({self.alarm})" if time.monotonic() - self.alarmed < _NEWS else ""


class MavlinkVehicle(ListeningLink):
    """A vehicle behind a MAVLink connection of pymavlink."""

    #: ArduSub stops at every waypoint (jerk of 1 m/s3, arrival within 2 m) and dives at 1.5 m/s
    #: (docs/execution.md).
    allowance = Allowance(start=3.3, dive=1.5, stop=3.0, by_speed=2.4)

    def __init__(
        self,
        address: str,
        site: Site,
        limits: Limits | None = None,
        scale: float = 1.0,
        link_loss: str = "",
        over_ground: bool = True,
    ) -> None:
        """Open the connection; the vehicle is looked for by `connect`.

        Args:
            address: as pymavlink takes it, such as udpin:0.0.0.0:14550, tcp:HOST:PORT or /dev/ttyUSB0.
            site, limits, scale, over_ground: as for `ListeningLink`.
            link_loss: what ArduSub is set to do without a link, "continue" or "surface"; empty: as it is set.

        Raises:
            LinkError: the connection cannot be opened.
            ImportError: pymavlink is not installed.
        """
        # Types of missions are an extension of MAVLink 2, which pymavlink speaks if this is set.
        os.environ.setdefault("MAVLINK20", "1")
        mavutil: Any = import_module("pymavlink.mavutil")
        mavutil.print = lambda *words: _log.info("%s", " ".join(map(str, words)))  # not on standard output

        super().__init__(site, limits, scale, over_ground)
        self.name = f"the MAVLink vehicle at {address}"
        try:
            self._port = mavutil.mavlink_connection(
                address, source_system=_OURS[0], source_component=_OURS[1], dialect="ardupilotmega",
                autoreconnect=True,
            )  # fmt: skip
        except (OSError, ValueError) as error:
            raise LinkError(f"{address}: {error}") from None
        self._sending = threading.Lock()
        self._heard = _Heard()
        self._target = 0, 0
        self._systems: set[int] = set()
        self._items: list[Item] = []
        self._fence: list[Item] = []
        self._lines: _Lines = [], []
        self._fresh: _Lines | None = None  # those of an upload that is not started
        self._settled = -math.inf
        self._ours = frozenset[int]()  # modes that the vehicle may be in because it was asked to be
        self._link_loss, self._failsafes = link_loss, dict[str, float]()
        self._expected: tuple[str, ...] = ()
        self._thread.start()

    def _say_hello(self) -> None:
        # A ground station: MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID, MAV_STATE_ACTIVE.
        self._send(lambda mav: mav.heartbeat_send(6, 8, 0, 0, 4))

    def _receive(self) -> None:
        try:
            message = self._port.recv_match(blocking=True, timeout=0.1)
        except OSError:
            self._closed.wait(0.1)
            return
        if message is not None:
            self._take(message)

    def _send(self, call: Callable[[Any], None]) -> None:
        """Send a message; what cannot be sent is as lost as what does not arrive."""
        with self._sending:
            try:
                call(self._port.mav)  # which pymavlink replaces when it hears another version
            except OSError:
                return

    def _take(self, message: Any) -> None:
        kind, heard, now = message.get_type(), self._heard, time.monotonic()
        source = message.get_srcSystem(), message.get_srcComponent()
        if getattr(message, "target_system", 0) not in (0, _OURS[0]):
            return  # to another ground station
        vehicle = kind == "HEARTBEAT" and message.type != 6 and source[1] == 1
        if vehicle:
            self._systems.add(source[0])
            self._target = source if self._target == (0, 0) else self._target
        if source != self._target:
            return
        # Messages overtake each other: an old heartbeat must not say that the vehicle left its mode.
        late = now - self._heard_at < _BEHIND and (message.get_seq() - heard.order) % 256 > 128
        if now - self._heard_at > _GAP:
            heard.again = now
        self._heard_at = now
        if not late:
            heard.order = message.get_seq()
            if vehicle:
                self._take_heartbeat(message)
        if kind == "GLOBAL_POSITION_INT":
            if message.lat == message.lon == 0:
                return  # which is said before the place is known
            north, east = self._site.to_local(message.lon * 1e-7, message.lat * 1e-7)
            self._put(float(north), float(east), -message.relative_alt * 1e-3)
            self._speed = 0.01 * math.hypot(message.vx, message.vy, message.vz)
        elif kind == "MISSION_CURRENT":
            heard.current = message.seq
            heard.progress = _STATES.get(getattr(message, "mission_state", 0), State.UNKNOWN)
            self._advance(message.seq - 1)
            if heard.progress is State.FINISHED:
                self._advance(len(self._items) - 1)
        elif kind == "MISSION_ITEM_REACHED":
            self._advance(message.seq)
        elif kind == "STATUSTEXT":
            number, chunk = getattr(message, "id", 0), getattr(message, "chunk_seq", 0)
            begun = self._words if number and chunk and number == heard.text else ""
            heard.text, self._words = number, begun + message.text
            if message.severity <= _WARNING:
                heard.alarm, heard.alarmed = self._words, now
        elif kind in self._expected:
            self._answers.put(message)
        elif kind in ("MISSION_COUNT", "MISSION_REQUEST", "MISSION_REQUEST_INT"):
            # A doubled message made the vehicle begin a transfer that nobody waits for.
            mission = getattr(message, "mission_type", 0)
            self._send(lambda mav: mav.mission_ack_send(*self._target, _CANCELLED, mission))

    def _take_heartbeat(self, message: Any) -> None:
        """Take in mode and state, and keep in mind what has ended the mission, however short it is seen."""
        heard = self._heard
        heard.beat = time.monotonic()
        was_armed, heard.armed = heard.armed, bool(message.base_mode & 128)
        heard.autopilot, heard.kind, heard.mode = message.autopilot, message.type, message.custom_mode
        heard.fault = message.system_status in _FAULTS
        if not self._ours or self._ended or self._done >= len(self._lines[0]):
            return
        if heard.fault:
            self._ended, self._faulty = f"it reports a failsafe{heard.warned}", True
        elif was_armed and not heard.armed:
            self._ended = f"it was disarmed{heard.warned}"
        elif self._ardupilot and heard.mode not in self._ours:
            self._ended = f"it was set to mode {ardusub.mode_name(heard.mode)}{heard.warned}"

    def _advance(self, item: int) -> None:
        """Take note that an item is completed; what is said just after an upload may be of the one before.

        A disarmed ArduSub goes through the items of its mission where it is. What is said after a silence
        counts once a heartbeat has said that the vehicle is still ours.
        """
        heard = self._heard
        ours = not self._ended and heard.beat >= heard.again
        if ours and self._fresh is None and time.monotonic() >= self._settled:
            self._done = max(self._done, bisect_right(self._lines[0], item))

    def connect(self) -> list[str]:
        """Wait for the vehicle's heartbeat and position, and see that no other one is there.

        What ArduSub does without a link is read, and set where that is asked for.
        """
        wait = self._limits.connect
        if not self._until(lambda: self._target != (0, 0) and self._here is not None, wait):
            what = "no heartbeat" if self._target == (0, 0) else "no GLOBAL_POSITION_INT"
            raise Lost(f"{self.name}: {what} within {wait:.0f} s")
        time.sleep(_OTHERS)
        if len(self._systems) > 1:
            numbers = ", ".join(map(str, sorted(self._systems)))
            raise Refused(f"{self.name}: systems {numbers} are on this link: give each its own")
        if not self._ardusub:
            if self._link_loss:
                raise Refused(f"{self.name} is not ArduSub: what it does without a link is set on itself")
            return []
        for name in ardusub.FAILSAFES:
            self._parameter(name)
        notes = []
        if self._link_loss and self._state() is not State.EXECUTING:
            for name, wanted in ardusub.LINK_LOSS[self._link_loss].items():
                if self._failsafes.get(name) != wanted:
                    if not self._parameter(name, wanted):
                        raise Refused(f"{self.name} does not take {name} {wanted:g}")
                    notes.append(f"{name} is set to {wanted:g}, and stays so")
        notes.append(f"if the link is lost, {self.left_alone or 'it goes on'}")
        return notes + ardusub.warnings(self._failsafes)

    @property
    def left_alone(self) -> str:
        """Return what the vehicle does when the link is lost; empty where it goes on with its plan."""
        return ardusub.left_alone(self._failsafes) if self._ardusub else ""

    def _parameter(self, name: str, value: float | None = None) -> bool:
        """Read one of the failsafes, or set it; return whether the vehicle says what it is then.

        ArduPilot takes any as a number of single precision (MAV_PARAM_TYPE_REAL32).
        """
        self._expect(_VALUES)

        def ask(mav: Any) -> None:
            if value is None:
                mav.param_request_read_send(*self._target, name.encode(), -1)
            else:
                mav.param_set_send(*self._target, name.encode(), value, 9)

        try:
            found = self._tell(ask, lambda m: m.param_id == name and value in (None, m.param_value))
        except Lost:
            return False
        self._failsafes[name] = float(found.param_value)
        return True

    @property
    def _ardupilot(self) -> bool:
        return self._heard.autopilot == _ARDUPILOT

    @property
    def _ardusub(self) -> bool:
        return self._ardupilot and self._heard.kind == _SUBMARINE

    def upload(self, plan: Upload) -> list[str]:
        """Hand over items and fence, and read both back."""
        notes = []
        self._check_goes_on()
        if not self._over_ground:
            plan = replace(plan, itinerary=replace(plan.itinerary, over_ground=False))
        items, fence = mission_items(plan, self._ardupilot), fence_items(plan)
        home = 1 if self._ardupilot else 0
        numbers = [k for k, item in enumerate(items) if item.command == _WAYPOINT][home:]
        if self._ardupilot and (self._heard.mode == ardusub.AUTO or self._started):
            # It goes on by the number of its item, which is another one in the new plan.
            self._insist(self.hold)
        if fence != self._fence or items == self._items:  # which are sent again where it may have lost them
            try:
                self._place(fence, FENCE, "fence")
                self._fence = fence
            except Refused as error:
                notes.append(f"{error}: the vehicle goes without a fence")
        self._place(items, MISSION, "plan", (numbers, item_speeds(plan.itinerary)))
        self._items, self._settled = items, time.monotonic() + self._limits.outdated
        return notes

    def _place(self, items: list[Item], kind: int, what: str, fresh: _Lines | None = None) -> None:
        """Upload items until they are read back as they are; once all are sent, `fresh` is not started."""
        problem = Lost(f"{self.name}: does not say what it holds of the {what}")
        try:
            for _ in range(self._limits.uploads):
                broken = None
                try:
                    self._offer(items, kind, what, fresh)
                except Lost as error:
                    broken = error  # the answer may have been lost alone
                try:
                    held = self._download(kind)
                except Lost:
                    problem = broken or problem
                    continue
                skip = 1 if kind == MISSION and self._ardupilot else 0  # the vehicle's home is its own
                height = ardusub.CENTIMETRE if self._ardupilot else _SAME
                pairs = list(zip(items, held, strict=False))[skip:]
                same = sum(a.same(b, height) for a, b in pairs) + skip
                if len(held) == len(items) == same:
                    return
                problem = broken or Lost(
                    f"{self.name} holds another {what} than was sent: {len(held)} items, "
                    f"{same} of {len(items)} as planned"
                )
        finally:
            self._expect(())
        raise problem

    def _offer(self, items: list[Item], kind: int, what: str, fresh: _Lines | None) -> None:
        """Answer the vehicle's requests for items until it acknowledges."""
        self._expect(_OFFERED)
        sent: set[int] = set()
        unanswered, begin = 0, time.monotonic()
        while time.monotonic() - begin < self._limits.attempts * self._limits.reply:
            if not sent:
                self._send(lambda mav: mav.mission_count_send(*self._target, len(items), kind))
            message = self._answer(
                lambda m: m.get_type() in _OFFERED and getattr(m, "mission_type", 0) == kind
            )
            if message is None:
                unanswered += 1
                if len(sent) == len(items) and unanswered >= _LAST:
                    return  # the acknowledgement may be lost: reading back will show
            elif message.get_type() == "MISSION_ACK":
                if message.type == 0 and len(sent) == len(items):
                    return
                if message.type in _AGAIN:
                    raise Lost(f"{self.name}: the {what} broke off: {_name(_ACKS, message.type)}")
                if message.type != 0:
                    raise Refused(f"{self.name} refuses the {what}: {_name(_ACKS, message.type)}")
            elif 0 <= message.seq < len(items):
                if message.seq not in sent:
                    unanswered, begin = 0, time.monotonic()
                    sent.add(message.seq)
                if len(sent) == len(items) and fresh:
                    self._fresh = fresh  # items that are done may be this plan's from now on: none is counted
                # Sent once a request: an item that comes unasked restarts the vehicle's own timeout.
                item, head = items[message.seq], (message.seq, items[message.seq].frame)
                # ArduPilot refuses NaN in most places, and has 0 for it in the others.
                params = [0.0 if self._ardupilot and math.isnan(part) else part for part in item.params]
                rest = item.command, 0, 1, *params, item.x, item.y, item.z, kind
                self._send(lambda mav, whole=(*head, *rest): mav.mission_item_int_send(*self._target, *whole))
        asked = f"{len(sent)} of {len(items)} items were asked for" if sent else "nothing was asked for"
        raise Lost(f"{self.name}: the {what} broke off: {asked}")

    def _download(self, kind: int) -> list[Item]:
        """Return the items that the vehicle holds."""
        self._expect(_READ)

        def says(message: Any, item: int = -1) -> bool:
            """Return whether a message is the number of items, or the one of them that is asked for."""
            asked = message.get_type() == "MISSION_COUNT" or message.seq == item
            return asked and getattr(message, "mission_type", 0) == kind

        found = self._tell(lambda mav: mav.mission_request_list_send(*self._target, kind), says)
        items: list[Item] = []
        begun = 1
        while len(items) < found.count:
            number = len(items)
            item = self._tell(
                lambda mav, number=number: mav.mission_request_int_send(*self._target, number, kind),
                partial(says, item=number),
            )
            if begun > self._limits.attempts:
                raise Lost(f"{self.name}: begins again and again to say what it holds")
            if says(item):  # a doubled request made the vehicle begin again
                items, begun = [], begun + 1
                continue
            params = float(item.param1), float(item.param2), float(item.param3), float(item.param4)
            items.append(Item(item.frame, item.command, params, item.x, item.y, float(item.z)))
        self._send(lambda mav: mav.mission_ack_send(*self._target, 0, kind))
        return items

    def _tell(self, ask: Callable[[Any], None], fits: Callable[[Any], bool]) -> Any:
        """Send a request until it is answered."""
        return self._asked(lambda: self._send(ask), fits, "does not answer")

    def _expect(self, kinds: tuple[str, ...]) -> None:
        """Keep messages of these kinds from now on, and forget what was kept before."""
        self._expected = kinds
        while not self._answers.empty():
            self._answers.get_nowait()

    def _command(self, command: int, *params: float, done: Callable[[], bool] = lambda: False) -> None:
        """Give a command until it is acknowledged, or until the vehicle is seen to have done it."""
        values = [*params, *[0.0] * (7 - len(params))]
        self._expect(_COMMANDED)
        self._words, said = "", "no answer to"
        for attempt in range(self._limits.attempts):
            self._send(lambda mav, n=attempt: mav.command_long_send(*self._target, command, n, *values))
            answer = self._answer(lambda m: m.get_type() == "COMMAND_ACK" and m.command == command)
            if (answer is not None and answer.result in (0, 5)) or done():
                return
            if answer is not None:
                words = f" ({self._words})" if self._words else ""
                if answer.result != 1:
                    result = _name(_RESULTS, answer.result)
                    raise Refused(f"{self.name} refuses command {command}: {result}{words}")
                said = f"for the time being it rejects{words}"
                time.sleep(self._limits.reply)
        raise Lost(f"{self.name}: {said} command {command}")

    def _set_px4(self, main: int, sub: int) -> None:
        """Set a mode of PX4."""
        wanted = main << 16 | sub << 24
        self._command(_SET_MODE, _CUSTOM, main, sub, done=lambda: self._heard.mode == wanted)

    def _set_ardusub(self, mode: int, also: int | None = None) -> None:
        """Set a mode of ArduSub, and see that it is in it, or in one that follows by itself."""
        heard, wanted = self._heard, frozenset({mode} if also is None else {mode, also})
        if self._ours:
            self._ours |= wanted
        self._command(_SET_MODE, _CUSTOM, mode, done=lambda: heard.mode in wanted)
        self._see(lambda: heard.mode in wanted, f"mode {ardusub.mode_name(mode)}")
        if self._ours:
            self._ours = wanted

    def _see(self, done: Callable[[], bool], what: str) -> None:
        """Wait until the vehicle says that something is so."""
        if not self._until(done, self._limits.attempts * self._limits.reply):
            raise Lost(f"{self.name}: is not seen in {what}")

    def _insist(self, call: Callable[[], None]) -> None:
        """Ask again where a vehicle refuses that was not started yet: just after boot it has no position."""
        end = time.monotonic() + (0.0 if self._started else self._limits.connect)
        while True:
            try:
                return call()
            except Refused:
                if time.monotonic() > end:
                    raise
            time.sleep(self._limits.reply)

    def _start_ardusub(self, numbers: list[int], speeds: list[float], step: int) -> None:
        """Leave mode AUTO, arm, and enter it again: setting the mode that it is in does nothing.

        The mode of holding needs the position that AUTO needs, so that it is armed only where that is known.
        AUTO starts with its own speed (ArduSub/mode_auto.cpp), and at a later item without that before it:
        that of the plan is given once more.
        """
        heard = self._heard
        self._insist(self._check_sound)
        self._insist(lambda: self._set_ardusub(ardusub.POSHOLD))
        own = not heard.armed
        try:
            if own:
                self._insist(lambda: self._command(_ARM, 1, done=lambda: heard.armed))
            self._set_current(numbers[step] if step else 0)
            heard.progress = State.UNKNOWN
            self._insist(lambda: self._set_ardusub(ardusub.AUTO))
            self._see(
                lambda: heard.armed and heard.mode == ardusub.AUTO and heard.progress is State.EXECUTING,
                "mode AUTO with an active mission",
            )
        except LinkError:
            if own and not self._started:
                try:
                    self._command(_ARM, 0, done=lambda: not heard.armed)
                except LinkError as error:
                    _log.info("not disarmed: %s", error)
            raise
        while True:  # it may begin the next line, with a speed of its own, meanwhile
            self._command(_SPEED, 1, speeds[step], -1)
            ahead = min(bisect_left(numbers, heard.current), len(numbers) - 1)
            if ahead <= step:
                break
            step = ahead
        self._ours = frozenset({ardusub.AUTO})

    def _check_sound(self) -> None:
        """See that no failsafe is on."""
        if self._heard.fault:
            raise Refused(f"{self.name} reports a failsafe{self._heard.warned}: it is not started")

    def start(self, step: int = 0) -> None:
        """Arm, and execute from a step on, unless somebody has ended the mission."""
        self._check_goes_on()
        lines = self._fresh or self._lines
        if self._ardupilot:
            self._start_ardusub(*lines, step)
        else:
            step = self._start_other(lines[0], step)
        self._lines, self._done, self._fresh = lines, step, None
        self._begin_time()

    def _start_other(self, numbers: list[int], step: int) -> int:
        """Start PX4, or another vehicle, and return the step that it begins with."""
        heard = self._heard
        if not heard.armed:
            self._command(_ARM, 1, done=lambda: heard.armed)
        if heard.progress is State.EXECUTING and time.monotonic() >= self._settled:
            # It began the new plan by itself, and may have come some way.
            step = max(step, bisect_left(numbers, heard.current))
        heard.progress = State.UNKNOWN
        last = numbers[-1] + 1
        item = 0 if not step else numbers[step] if step < len(numbers) else last
        # Another speed is an item of its own, before the waypoint.
        has_speed = 0 < step < len(numbers) and numbers[step] - numbers[step - 1] > 1
        self._set_current(item - 1 if has_speed else item)
        if heard.autopilot == _PX4:
            self._set_px4(4, 4)
        else:
            self._command(_START, 0, 0, done=lambda: heard.progress is State.EXECUTING)
        self._ours = frozenset({heard.mode})
        return step

    def _set_current(self, item: int) -> None:
        """Set the item that is executed next."""
        heard, passes = self._heard, not (self._ardupilot and item)

        def ask() -> None:
            heard.current = -1
            self._send(lambda mav: mav.mission_set_current_send(*self._target, item))

        # A vehicle that is held cannot have come further, and says what it was set to.
        self._asked(
            ask,
            lambda _: False,
            f"no answer to item {item} as the next",
            done=lambda: heard.current == item or (heard.current > item and passes),
        )

    def hold(self) -> None:
        """Stay where it is, unless somebody has ended the mission."""
        self._check_goes_on()
        if self._ardupilot:
            self._set_ardusub(ardusub.POSHOLD)
        elif self._heard.autopilot == _PX4:
            self._set_px4(4, 3)
        else:
            self._command(_PAUSE, 0, done=lambda: self._heard.progress is State.HOLDING)

    def surface(self) -> None:
        """Surface."""
        self._ours = frozenset()
        if self._ardupilot:
            self._set_ardusub(ardusub.SURFACE, ardusub.ALT_HOLD)
        else:
            self._command(_LAND)

    def _state(self) -> State:
        heard = self._heard
        if heard.fault or self._ended:
            return State.FAULT if heard.fault or self._faulty else State.STOPPED
        if self._ardupilot and not heard.armed and heard.progress is not State.FINISHED:
            return State.IDLE
        # ArduSub's mission stays under way in other modes than AUTO (ArduSub/mode.cpp, exit_mode).
        led = heard.progress is not State.UNKNOWN and heard.mode == ardusub.AUTO
        if self._ardupilot and not led and heard.progress is not State.FINISHED:
            return _MODES.get(heard.mode, State.UNKNOWN)
        return heard.progress

    def _disconnect(self) -> None:
        self._port.close()


def _name(names: Sequence[str], number: int) -> str:
    return names[number] if 0 <= number < len(names) else f"number {number}"
