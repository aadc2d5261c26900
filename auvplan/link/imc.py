"""A vehicle that speaks LSTS's IMC, over UDP or TCP.

Plans go there by PlanDB, are executed by PlanControl; where the vehicle is comes from EstimatedState.

Messages are imcpy's; a plan is the PlanSpecification of the vehicle file, element by element.
"""

import math
import re
import socket
import time
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Any

from auvplan.export.imc import RADIUS, plan_identifier, plan_specification, stay_specification
from auvplan.export.markup import Element
from auvplan.link.limits import Allowance, Limits
from auvplan.link.listening import ListeningLink
from auvplan.link.vehicle import LinkError, Lost, Refused, State, Upload
from auvplan.site import Site

#: Identifiers of control stations among IMC's addresses, beyond those that Neptus takes from its own address;
#: who is meant before the vehicle is known.
_STATIONS, _ANYONE = (0x5000, 0xFFF), 0xFFFF

#: Ports that announcements are listened for on, and s between two of them; ports of our own, the first that
#: is free.
_ANNOUNCED, _ANNOUNCE = range(30100, 30105), 5.0
_LOCAL = range(6011, 6021)

#: Bytes of the largest datagram.
_LARGEST = 65_507

#: Name of the plan to stay, and how a plan ended that failed; who or what ended it is said elsewhere.
_HOLD, _STOPPED = "hold", "it was stopped"


def as_message(element: Element) -> Any:
    """Return an IMC message of imcpy from its XML element, as `auvplan.export.imc` makes it."""
    imcpy: Any = import_module("imcpy")
    message = getattr(imcpy, element.tag)()
    for child in element:
        name, text = child.tag, child.text or ""
        if len(child):
            parts = [as_message(part) for part in child]
            if name == "data":
                message.data = parts[0]
            else:
                getattr(message, name).extend(parts)
        elif text:
            names = {"z_units": "ZUnits", "speed_units": "SpeedUnits"}.get(name)
            own = {"type": "LoiterTypeEnum", "direction": "DirectionEnum"}.get(name)
            if name == "flags":  # names of bits
                value = sum(int(getattr(message.FlagsBits, bit)) for bit in text.split("|"))
            elif names or own:  # which stand for numbers
                value = getattr(getattr(imcpy, names) if names else getattr(message, str(own)), text)
            else:
                default = getattr(message, name)
                value = next(kind for kind in (str, int, float) if isinstance(default, kind))(text)
            setattr(message, name, value)
    return message


class _Datagrams:
    """UDP to a vehicle: announced to it, as DUNE hears and answers none but announced systems.

    The identifier is that of the address and port that answers go to: DUNE keeps those of an identifier for
    as long as it runs.
    """

    def __init__(self, host: str, port: int, local: int | None) -> None:
        self._peer = host, port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for own in [local] if local else [*_LOCAL, 0]:
            try:
                self._socket.bind(("", own))
                break
            except OSError:
                if local:
                    self._socket.close()
                    raise
        self._socket.settimeout(0.1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(self._peer)
            self.address = f"{probe.getsockname()[0]}:{self._socket.getsockname()[1]}"
        first, most = _STATIONS
        self.identifier = first + (zlib.crc32(self.address.encode()) & most)

    def send(self, data: bytes) -> None:
        self._socket.sendto(data, self._peer)

    def announce(self, data: bytes) -> None:
        for port in _ANNOUNCED:
            self._socket.sendto(data, (self._peer[0], port))

    def receive(self) -> list[Any]:
        data, _ = self._socket.recvfrom(_LARGEST)
        try:
            return [import_module("imcpy").Packet.deserialize(data)]
        except RuntimeError:
            return []  # it is no IMC, or was damaged on its way

    def close(self) -> None:
        self._socket.close()


class _Stream:
    """TCP to a vehicle, which takes whoever connects; made again where it breaks."""

    def __init__(self, host: str, port: int) -> None:
        self._peer, self._socket = (host, port), None
        self.address, self.identifier = f"tcp:{host}:{port}", _STATIONS[0]
        self._parser: Any = import_module("imcpy").Parser()

    def send(self, data: bytes) -> None:
        if self._socket is not None:
            self._socket.sendall(data)

    def announce(self, data: bytes) -> None:
        """Do nothing: answers come by the connection."""

    def receive(self) -> list[Any]:
        try:
            if self._socket is None:
                self._socket = socket.create_connection(self._peer, timeout=1.0)
                self._socket.settimeout(0.1)
                self._parser.reset()
            data = self._socket.recv(_LARGEST)
            if not data:
                raise ConnectionError("closed")
        except TimeoutError:
            return []
        except OSError:
            self.close()
            time.sleep(0.1)
            return []
        messages = []
        while data:
            message, used = self._parser.parse(data)
            messages += [] if message is None else [message]
            data = data[used:] if used else b""
        return messages

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None


class ImcVehicle(ListeningLink):
    """A vehicle behind a port that speaks IMC."""

    by_legs = True
    #: DUNE is 10.3 s longer at a task than commanded, 0.5 s of them as IMC has whole seconds, and ends the
    #: way there 5 s ahead of it (docs/execution.md); `auvplan.export.imc` has the rest.
    allowance = Allowance(task=6.8, circle=RADIUS)

    def __init__(
        self,
        address: str,
        site: Site,
        limits: Limits | None = None,
        scale: float = 1.0,
        over_ground: bool = True,
    ) -> None:
        """Open a socket; the vehicle is looked for by `connect`.

        Args:
            address: HOST:PORT of the vehicle, for UDP, with `?local=PORT` for a port of ours; or
                tcp:HOST:PORT.
            site, limits, scale, over_ground: as for `ListeningLink`.

        Raises:
            LinkError: the address cannot be used.
            ImportError: imcpy is not installed.
        """
        imcpy: Any = import_module("imcpy")
        super().__init__(site, limits, scale, over_ground)
        self._imc, self.name = imcpy, f"the IMC vehicle at {address}"
        place, _, local = address.partition("?local=")
        host, _, port = place.rpartition(":")
        try:
            peer = socket.gethostbyname(host.removeprefix("tcp:")), int(port)
            stream = host.startswith("tcp:")
            self._wire = _Stream(*peer) if stream else _Datagrams(*peer, int(local) if local else None)
        except (OSError, ValueError) as error:
            raise LinkError(f"{address}: {error}") from None
        self._announced = -math.inf  # s, when that was last done
        self._vehicle, self._mode = _ANYONE, None
        self._control: Any = None  # PlanControlState that came last
        self._request = 0
        self._upload: Upload | None = None  # newest that was handed over
        self._plan: Upload | None = None  # that is executed, from `_offset` steps on
        self._offset, self._holds, self._aborted = 0, False, False
        self._started_plans: set[str] = set()  # plans of ours that the vehicle was given to execute
        self._since = math.inf  # s of the vehicle's clock, when it began to execute the last of them
        self._thread.start()

    def _say_hello(self) -> None:
        if time.monotonic() - self._announced >= _ANNOUNCE:
            self._announced = time.monotonic()
            announce = self._imc.Announce()
            announce.sys_name, announce.sys_type = "auvplan", self._imc.SystemType.CCU
            announce.owner, announce.services = _ANYONE, f"imc+udp://{self._wire.address}/"
            self._send(announce, self._wire.announce)
        self._send(self._imc.Heartbeat())

    def _receive(self) -> None:
        with suppress(OSError):
            for message in self._wire.receive():
                self._take(message)

    def _send(self, message: Any, by: Callable[[bytes], None] | None = None) -> None:
        """Send a message; what cannot be sent is as lost as what does not arrive."""
        message.src, message.dst = self._wire.identifier, self._vehicle
        message.set_timestamp_now()
        with suppress(OSError):
            (by or self._wire.send)(self._imc.Packet.serialize(message))

    def _take(self, message: Any) -> None:
        """Take in a message of the vehicle, which is the first that says where it is."""
        imc = self._imc
        if self._vehicle == _ANYONE and isinstance(message, imc.EstimatedState):
            self._vehicle = message.src
        if message.src != self._vehicle or message.dst not in (self._wire.identifier, _ANYONE):
            return
        self._heard_at = time.monotonic()
        if isinstance(message, imc.EstimatedState):
            longitude, latitude = math.degrees(message.lon), math.degrees(message.lat)
            north, east = self._site.to_local(longitude, latitude)
            more = self._site.local_vector(message.x, message.y, longitude, latitude)
            self._put(float(north + more[0]), float(east + more[1]), message.depth)
            self._speed = math.hypot(message.vx, message.vy, message.vz)
        elif isinstance(message, imc.PlanControlState):
            self._control = message
            self._advance(message)
            self._latch(message)
        elif isinstance(message, imc.VehicleState):
            self._mode, self._words = message.op_mode, message.last_error
            self._latch_mode(message)
        elif isinstance(message, imc.PlanControl | imc.PlanDB):
            self._answers.put(message)

    def _advance(self, state: Any) -> None:
        """Count the steps that are completed by the manoeuvre that is executed."""
        plan = self._plan
        if plan is None or state.plan_id != self._identifier(plan, self._offset):
            return
        outcomes, states = state.LastPlanOutcomeEnum, state.StateEnum
        steps, manoeuvre = plan.steps, state.man_id
        if manoeuvre == "end" or (state.state == states.READY and state.last_outcome == outcomes.SUCCESS):
            done = len(steps)
        elif found := re.fullmatch(r"(leg|task|wait|fix)(\d+)(?:_last(\d+))?", manoeuvre):
            number = int(found[2])
            done = sum(step.leg < number for step in steps)
            own = sum(step.leg == number for step in steps)
            left = 1 if found[1] != "leg" else int(found[3] or own)
            done += max(own - left, 0)
            if done <= self._offset and not steps[self._offset].ends_leg:
                done = self._offset + 1  # it has been at the plan's first place
        else:
            return
        self._done = max(self._done, done)

    def _latch(self, state: Any) -> None:
        """Keep that the vehicle has left our plan, for however short a moment it says so.

        After an abort DUNE is blocked for 0.2 s, then ready as if nothing were (Supervisors/Vehicle,
        Plan/Engine); a plan that was replaced by ours leaves the same outcome, but goes on. A vehicle that
        restarted has no plan, and one that was halted has it without a failure.
        """
        if self._plan is None or self._aborted or state.timestamp < self._since or not state.plan_id:
            return
        states, outcomes = state.StateEnum, state.LastPlanOutcomeEnum
        ours = state.plan_id in self._started_plans
        ready = state.state in (states.READY, states.BLOCKED)
        if state.state == states.EXECUTING and not ours:
            self._ended = f"another plan was started, {state.plan_id}"
        elif ready and (not ours or state.last_outcome == outcomes.FAILURE):
            self._ended = self._ended or _STOPPED

    def _latch_mode(self, state: Any) -> None:
        """Keep that the vehicle was aborted, had a fault or is driven by hand, however short it says so."""
        modes = state.OperationModeEnum
        aborted = "abort" in state.last_error and state.last_error_time >= self._since
        if self._plan is None or self._aborted or state.timestamp < self._since:
            return
        if aborted or state.op_mode in (modes.EXTERNAL, modes.CALIBRATION):
            self._ended = self._ended or "it is driven from outside"
        elif state.op_mode == modes.ERROR and self._ended in ("", _STOPPED):  # it stopped its plan itself
            self._ended, self._faulty = "it has a fault", True

    @property
    def _message(self) -> str:
        return self._words or self._ended

    def connect(self) -> list[str]:
        """Wait for the vehicle's position, and for its plan control to be ready or busy."""

        def ready() -> bool:
            control = self._control
            if self._here is None or control is None:
                return False
            return control.state != control.StateEnum.BLOCKED

        within = f"within {self._limits.connect:.0f} s"
        if self._until(ready, self._limits.connect):
            return []
        if self._here is not None and self._control is not None:
            raise Refused(f"{self.name}: was not ready for a plan {within}: {self._words or 'blocked'}")
        what = "EstimatedState" if self._here is None else "PlanControlState"
        raise Lost(f"{self.name}: no {what} {within}")

    def upload(self, plan: Upload) -> list[str]:
        """Store the plan in the vehicle's data base, and read it back."""
        self._check_goes_on()
        self._store(plan, 0)
        self._upload = plan
        return []

    def _identifier(self, plan: Upload, offset: int) -> str:
        return plan_identifier(f"{plan.name} from {offset}" if offset else plan.name)

    def _store(self, plan: Upload, offset: int) -> None:
        rest = plan.without(offset)
        held = rest.itinerary.over_ground and self._over_ground
        named = replace(rest.itinerary, name=self._identifier(plan, offset), over_ground=held)
        wanted = as_message(plan_specification(named))
        operation = self._imc.PlanDB.OperationEnum
        for _ in range(self._limits.uploads):
            self._ask(self._imc.PlanDB, operation.SET, wanted.plan_id, wanted, "the plan")
            held = self._ask(self._imc.PlanDB, operation.GET, wanted.plan_id, None, "the plan, read back").arg
            if held is not None and wanted.serialize_fields() == held.serialize_fields():
                return
        raise Lost(f"{self.name}: holds another plan than was sent")

    def _ask(
        self,
        kind: Any,
        operation: Any,
        plan: str,
        argument: Any,
        what: str,
        done: Callable[[], bool] = lambda: False,
    ) -> Any:
        """Make a request until it is answered, or until the vehicle is seen to have done it."""
        self._request = self._request % 0xFFFF + 1
        request, kinds = kind(), kind.TypeEnum
        request.type, request.op, request.plan_id = kinds.REQUEST, operation, plan
        request.request_id = self._request
        if argument is not None:
            request.arg = argument

        def fits(answer: Any) -> bool:
            ours = isinstance(answer, kind) and (answer.request_id, answer.op) == (self._request, operation)
            return ours and answer.type in (kinds.SUCCESS, kinds.FAILURE)

        sends = partial(self._send, request)
        answer = self._asked(sends, fits, f"no answer to {what}", self._check_goes_on, done)
        if answer is not None and answer.type == kinds.FAILURE:
            raise Refused(f"{self.name} refuses {what}: {answer.info}")
        return answer

    def start(self, step: int = 0) -> None:
        """Execute the last upload from a step on."""
        plan = self._upload
        assert plan is not None
        if step:
            self._store(plan, step)
        self._execute(self._identifier(plan, step), None, "the start")
        self._plan, self._offset, self._done, self._holds = plan, step, step, False
        self._begin_time()

    def _execute(self, identifier: str, plan: Any, what: str) -> None:
        """Have a plan executed, unless the vehicle was stopped meanwhile."""
        self._check_goes_on()
        self._started_plans.add(identifier)
        operation = self._imc.PlanControl.OperationEnum.START
        executing = self._imc.PlanControlState.StateEnum.EXECUTING

        def executes() -> bool:
            control = self._control
            return control is not None and (control.state, control.plan_id) == (executing, identifier)

        answer = self._ask(self._imc.PlanControl, operation, identifier, plan, what, executes)
        if self._ended:  # the start may have come after the abort
            self.surface()
        self._check_goes_on()
        self._since = (answer or self._control).timestamp

    def hold(self) -> None:
        """Stay where it is, by a plan of that alone."""
        if self._here is None or self._plan is None:
            raise Lost(f"{self.name}: its place is not known")
        plan = as_message(stay_specification(self._plan.itinerary, self._here, _HOLD))
        self._execute(plan.plan_id, plan, "to hold")
        self._holds = True

    def surface(self) -> None:
        """Give the plan up: the vehicle stops and floats up."""
        executing = self._imc.PlanControlState.StateEnum.EXECUTING

        def abort() -> None:
            self._control = None  # what it says from then on counts
            self._send(self._imc.Abort())

        self._asked(
            abort,
            lambda _: False,
            "goes on after an abort",
            done=lambda: self._control is not None and self._control.state != executing,
        )
        self._aborted = True

    def _state(self) -> State:
        control, states = self._control, self._imc.PlanControlState.StateEnum
        if self._aborted:
            return State.SURFACING
        if self._ended:
            return State.FAULT if self._faulty else State.STOPPED
        if self._mode == self._imc.VehicleState.OperationModeEnum.ERROR:
            return State.FAULT
        if control is None:
            return State.UNKNOWN
        if control.timestamp < self._since < math.inf:
            return State.EXECUTING  # what it said before it was started
        if control.state == states.EXECUTING:
            if control.man_id == "end" and control.plan_id in self._started_plans:
                return State.FINISHED
            return State.HOLDING if self._holds else State.EXECUTING
        return State.IDLE

    def _disconnect(self) -> None:
        self._wire.close()
