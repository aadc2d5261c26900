"""A vehicle that speaks LSTS's IMC over UDP.

Plans go there by PlanDB, are executed by PlanControl; where the vehicle is comes from EstimatedState.

Messages are imcpy's; a plan is the PlanSpecification of the vehicle file, element by element.
"""

import math
import queue
import re
import socket
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.export.imc import plan_identifier, plan_specification, stay_specification
from auvplan.export.markup import Element
from auvplan.link.limits import Limits
from auvplan.link.listening import ListeningLink
from auvplan.link.vehicle import LinkError, Lost, Refused, Report, State, Upload
from auvplan.site import Site

Array = NDArray[np.floating]

#: Identifier of a control station among IMC's addresses.
_OURS = 0x4001

#: Name of the plan to stay.
_HOLD = "hold"

#: Who is meant before the vehicle is known.
_ANYONE = 0xFFFF

#: Bytes of the largest datagram.
_LARGEST = 65_507


def as_message(element: Element) -> Any:
    """Return an IMC message of imcpy from its XML element, as `auvplan.export.imc` makes it."""
    imcpy: Any = import_module("imcpy")
    message = getattr(imcpy, element.tag)()
    for child in element:
        if len(child):
            parts = [as_message(part) for part in child]
            if child.tag == "data":
                setattr(message, child.tag, parts[0])
            else:
                getattr(message, child.tag).extend(parts)
        elif child.text:
            setattr(message, child.tag, _value(getattr(message, child.tag), message, child))
    return message


def _value(default: Any, message: Any, child: Element) -> Any:
    """Return a field's text in the type of its field; names stand for numbers of enumerations."""
    imcpy: Any = import_module("imcpy")
    text = child.text or ""
    if isinstance(default, str):
        return text
    names = {"z_units": imcpy.ZUnits, "speed_units": imcpy.SpeedUnits}.get(child.tag)
    if child.tag == "type":
        names = message.LoiterTypeEnum
    if child.tag == "direction":
        names = message.DirectionEnum
    if names is not None:
        return getattr(names, text)
    return int(text) if isinstance(default, int) else float(text)


class ImcVehicle(ListeningLink):
    """A vehicle behind a UDP port that speaks IMC."""

    by_legs = True

    def __init__(self, address: str, site: Site, limits: Limits | None = None, scale: float = 1.0) -> None:
        """Open a socket; the vehicle is looked for by `connect`.

        Args:
            address: HOST:PORT of the vehicle.
            site: that local coordinates count from.
            limits: of replies and tries.
            scale: s of the vehicle's time in one of wall-clock time, for vehicles that are simulated.

        Raises:
            LinkError: the address cannot be used.
            ImportError: imcpy is not installed.
        """
        imcpy: Any = import_module("imcpy")
        super().__init__(site, limits, scale)
        self._imc, self.name = imcpy, f"the IMC vehicle at {address}"
        host, _, port = address.rpartition(":")
        try:
            self._peer = socket.gethostbyname(host), int(port)
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.bind(("", 0))
        except (OSError, ValueError) as error:
            raise LinkError(f"{address}: {error}") from None
        self._socket.settimeout(0.1)
        self._answers: queue.Queue[Any] = queue.Queue()
        self._vehicle, self._at = _ANYONE, -math.inf
        self._speed, self._control, self._words, self._fault = math.nan, None, "", False
        self._request = 0
        self._upload: Upload | None = None  # newest that was handed over
        self._plan: Upload | None = None  # that is executed, from `_offset` steps on
        self._offset, self._done, self._holds = 0, 0, False
        self._aborted = False
        self._start_listening()

    def _say_hello(self) -> None:
        self._send(self._imc.Heartbeat())

    def _receive(self) -> None:
        try:
            data, _ = self._socket.recvfrom(_LARGEST)
        except OSError:
            return
        try:
            message = self._imc.Packet.deserialize(data)
        except RuntimeError:
            return  # it is no IMC, or was damaged on its way
        self._take(message)

    def _send(self, message: Any) -> None:
        """Send a message; what cannot be sent is as lost as what does not arrive."""
        message.src, message.dst = _OURS, self._vehicle
        message.set_timestamp_now()
        try:
            self._socket.sendto(self._imc.Packet.serialize(message), self._peer)
        except OSError:
            return

    def _take(self, message: Any) -> None:
        """Take in a message of the vehicle, which is the first that says where it is."""
        imc = self._imc
        if self._vehicle == _ANYONE and isinstance(message, imc.EstimatedState):
            self._vehicle = message.src
        if message.src != self._vehicle or message.dst not in (_OURS, _ANYONE):
            return
        self._at = time.monotonic()
        if isinstance(message, imc.EstimatedState):
            longitude, latitude = math.degrees(message.lon), math.degrees(message.lat)
            north, east = self._site.to_local(longitude, latitude)
            offset = np.asarray([message.x, message.y])
            bearing = float(self._site.true_north(longitude, latitude))
            turned = np.asarray(
                [
                    offset[0] * math.cos(bearing) - offset[1] * math.sin(bearing),
                    offset[0] * math.sin(bearing) + offset[1] * math.cos(bearing),
                ]
            )
            self._put(float(north) + turned[0], float(east) + turned[1], message.depth)
            self._speed = math.hypot(message.vx, message.vy, message.vz)
        elif isinstance(message, imc.PlanControlState):
            self._control = message
            self._advance(message)
        elif isinstance(message, imc.VehicleState):
            self._fault = message.op_mode == imc.VehicleState.OperationModeEnum.ERROR
            self._words = message.last_error
        elif isinstance(message, imc.PlanControl | imc.PlanDB):
            self._answers.put(message)

    def _advance(self, state: Any) -> None:
        """Count the steps that are completed by the manoeuvre that is executed."""
        plan = self._plan
        if plan is None or state.plan_id != self._identifier(plan, self._offset):
            return
        outcomes, states = (
            self._imc.PlanControlState.LastPlanOutcomeEnum,
            self._imc.PlanControlState.StateEnum,
        )
        steps, manoeuvre = plan.steps, state.man_id
        if manoeuvre == "end" or (state.state == states.READY and state.last_outcome == outcomes.SUCCESS):
            done = len(steps)
        elif found := re.fullmatch(r"(leg|task)(\d+)", manoeuvre):
            number = int(found[2])
            done = sum(step.leg < number for step in steps)
            if found[1] == "task":
                done += sum(step.leg == number and not step.ends_leg for step in steps)
        else:
            return
        self._done = max(self._done, done)

    def connect(self) -> list[str]:
        """Wait for the vehicle's position and for the state of its plans.

        Returns:
            Nothing: what it does by itself is not asked.

        Raises:
            Lost: there is none.
        """
        end = time.monotonic() + self._limits.connect
        while time.monotonic() < end:
            if self._here is not None and self._control is not None:
                return []
            time.sleep(0.02)
        what = "EstimatedState" if self._here is None else "PlanControlState"
        raise Lost(f"{self.name}: no {what} within {self._limits.connect:.0f} s")

    def upload(self, plan: Upload) -> list[str]:
        """Store the plan in the vehicle's data base, and read it back.

        Raises:
            Lost, Refused: the vehicle does not hold the plan.
        """
        self._store(plan, 0)
        self._upload = plan
        return []

    def _identifier(self, plan: Upload, offset: int) -> str:
        return plan_identifier(f"{plan.name} from {offset}" if offset else plan.name)

    def _store(self, plan: Upload, offset: int) -> None:
        rest = plan.without(offset)
        named = replace(rest.itinerary, name=self._identifier(plan, offset))
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
        """Make a request until it is answered, or until the vehicle is seen to have done it.

        Raises:
            Lost, Refused: neither is so.
        """
        self._request = self._request % 0xFFFF + 1
        request = kind()
        request.type, request.op, request.plan_id = kind.TypeEnum.REQUEST, operation, plan
        request.request_id = self._request
        if argument is not None:
            request.arg = argument
        for _ in range(self._limits.attempts):
            self._send(request)
            end = time.monotonic() + self._limits.reply
            while (left := end - time.monotonic()) > 0.0:
                try:
                    answer = self._answers.get(timeout=min(left, 0.05))
                except queue.Empty:
                    if done():
                        return None
                    continue
                if not isinstance(answer, kind) or (answer.request_id, answer.op) != (
                    self._request,
                    operation,
                ):
                    continue
                if answer.type == kind.TypeEnum.SUCCESS:
                    return answer
                if answer.type == kind.TypeEnum.FAILURE:
                    raise Refused(f"{self.name} refuses {what}: {answer.info}")
        raise Lost(f"{self.name}: no answer to {what}")

    def _executes(self, identifier: str) -> bool:
        control = self._control
        executing = self._imc.PlanControlState.StateEnum.EXECUTING
        return control is not None and control.state == executing and control.plan_id == identifier

    def start(self, step: int = 0) -> None:
        """Execute the last upload from a step on.

        Raises:
            Lost, Refused: the vehicle does not say that it does.
        """
        plan = self._upload
        assert plan is not None
        if step:
            self._store(plan, step)
        identifier = self._identifier(plan, step)
        operation = self._imc.PlanControl.OperationEnum.START
        self._ask(
            self._imc.PlanControl,
            operation,
            identifier,
            None,
            "the start",
            lambda: self._executes(identifier),
        )
        self._plan, self._offset, self._done, self._holds = plan, step, step, False
        if math.isnan(self._begin):
            self._begin = time.monotonic()

    def hold(self) -> None:
        """Stay where it is, by a plan of that alone.

        Raises:
            Lost, Refused: the vehicle does not say that it does.
        """
        if self._here is None or self._plan is None:
            raise Lost(f"{self.name}: its place is not known")
        plan = as_message(stay_specification(self._plan.itinerary, self._here, _HOLD))
        self._ask(
            self._imc.PlanControl, self._imc.PlanControl.OperationEnum.START, plan.plan_id, plan, "to hold",
            lambda: self._executes(plan.plan_id),
        )  # fmt: skip
        self._holds = True

    def abort(self) -> None:
        """Give the plan up: the vehicle stops and floats up.

        Raises:
            Lost: it goes on executing a plan.
        """
        executing = self._imc.PlanControlState.StateEnum.EXECUTING
        for _ in range(self._limits.attempts):
            self._send(self._imc.Abort())
            begin = time.monotonic()
            while time.monotonic() - begin < self._limits.reply:
                if self._at > begin and self._control is not None and self._control.state != executing:
                    self._aborted = True
                    return
                time.sleep(0.02)
        raise Lost(f"{self.name}: goes on after an abort")

    def _report(self) -> Report:
        return Report(
            time.monotonic() - self._at, self._here, self._speed, self._state(), self._done, self._words
        )

    def _state(self) -> State:
        control, states = self._control, self._imc.PlanControlState.StateEnum
        if self._fault:
            return State.FAULT
        if control is None:
            return State.UNKNOWN
        if control.state == states.EXECUTING:
            if self._plan is not None and control.plan_id not in (
                self._identifier(self._plan, self._offset),
                _HOLD,
            ):
                return State.IDLE  # somebody else's
            if control.man_id == "end":
                return State.FINISHED
            return State.HOLDING if self._holds else State.EXECUTING
        return State.SURFACING if self._aborted else State.IDLE

    def _disconnect(self) -> None:
        self._socket.close()
