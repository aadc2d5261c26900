"""What the executor asks of a vehicle, whoever made it and however it is reached."""

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Protocol

import numpy as np

from auvplan.export.itinerary import Itinerary, Waypoint, waypoints
from auvplan.export.speeds import led
from auvplan.link.limits import Allowance
from auvplan.runtime.arrays import Array


def one_line(text: str) -> str:
    """Return text of a vehicle's as one line that a terminal can show."""
    return " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())


class LinkError(Exception):
    """A vehicle that cannot be reached or does not do what it is asked; the message is one line."""

    def __init__(self, message: str) -> None:
        """Say what is wrong; the message may hold words of the vehicle's."""
        super().__init__(one_line(message))


class Lost(LinkError):
    """The vehicle does not answer within the limits."""


class Refused(LinkError):
    """The vehicle answers that it will not."""


class State(Enum):
    """What a vehicle says that it does.

    `STOPPED` is a vehicle whose plan was aborted, stopped or replaced by somebody else, `FAULT` one that has
    given it up: a link says so from then on, for however short a moment the vehicle does. `IDLE` is one that
    has no plan, as after a restart.
    """

    UNKNOWN = "unknown"
    IDLE = "idle"
    EXECUTING = "executing its plan"
    HOLDING = "holding its place"
    FINISHED = "at the end of its plan"
    SURFACING = "surfacing"
    STOPPED = "no longer on its plan"
    FAULT = "in a state of fault"


@dataclass(frozen=True)
class Report:
    """The newest that is known of a vehicle.

    Attributes:
        heard: s of wall-clock time since anything was last heard of it; infinite before.
        position: [3] m north, east, depth, or None where it is not known; never NaN or infinite.
        speed: m/s over ground; NaN where not known.
        state: what it says that it does.
        done: steps of the last upload that are completed, their holds included.
        message: its own last words, one line, or empty.
    """

    heard: float = math.inf
    position: Array | None = None
    speed: float = math.nan
    state: State = State.UNKNOWN
    done: int = 0
    message: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "message", one_line(self.message))
        if self.position is not None and not np.isfinite(self.position).all():
            object.__setattr__(self, "position", None)


#: A place that the vehicle goes to, and what it does there.
Step = Waypoint


@dataclass(frozen=True)
class Upload:
    """What is handed to a vehicle at once: a whole itinerary, of which it may begin at a later step.

    Attributes:
        itinerary: as it goes into vehicle files.
        number: of the upload in its mission, from 1.
        origin: [3] m, where the straight line to the first step begins, and s since the epoch when that is
            left; None for the first step itself.
        steps: its waypoints in order; the end behaviour is carried out at the last.
    """

    itinerary: Itinerary
    number: int = 1
    origin: tuple[Array, float] | None = None
    steps: tuple[Step, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        first, *rest = waypoints(self.itinerary)
        if self.origin is not None:
            first = replace(first, left=self.origin[0], left_at=self.origin[1])
        object.__setattr__(self, "steps", (first, *rest))

    @property
    def name(self) -> str:
        """Return what the vehicle knows the plan by."""
        return f"{self.itinerary.name} {self.number}"

    def without(self, done: int) -> "Upload":
        """Return what is left once `done` steps are completed; at least one step is left.

        A leg that is under way keeps the waypoints ahead.
        """
        done = min(done, len(self.steps) - 1)
        if done <= 0:
            return self
        first = self.steps[done]
        legs = [leg for leg in self.itinerary.legs if leg.number > first.leg]
        (current,) = (leg for leg in self.itinerary.legs if leg.number == first.leg)
        ahead = sum(step.leg == first.leg for step in self.steps[done:])
        kept = current.kept[-ahead:]
        begin = int(kept[0])
        over_ground, along_hull = led(current)[-ahead]
        current = replace(
            current,
            led=(float(over_ground), float(along_hull)),
            start_name=first.name,
            positions=current.positions[begin:],
            times=current.times[begin:],
            kept=kept - begin,
            kept_times=current.kept_times[-ahead:],
            motion=current.motion[begin:],
        )
        origin = first.left, first.left_at
        return Upload(replace(self.itinerary, legs=(current, *legs)), self.number, origin)


class VehicleLink(Protocol):
    """A vehicle under way: uploads go there, reports come back.

    Calls return within limits or raise, `Lost` where the vehicle does not say that it does what it is asked,
    `Refused` where it says that it will not; none waits for ever. Positions are local metres of the
    itinerary's site.

    Attributes:
        name: what the vehicle is called in messages to people.
        by_legs: whether it reports completed legs and tasks, not each step.
        rate: s of mission time in one of wall-clock time; 0 where time stands still between reports.
        allowance: what its own control takes longer than planned paths.
    """

    name: str
    by_legs: bool = False
    rate: float = 0.0
    allowance: Allowance = Allowance()

    @property
    def now(self) -> float:
        """Return s of mission time, which begins with the first start."""
        ...

    @property
    def left_alone(self) -> str:
        """Return what the vehicle does when the link is lost; empty where it goes on with its plan."""
        return ""

    def connect(self) -> list[str]:
        """Find the vehicle; return lines for people: what it does by itself."""
        return []

    def upload(self, plan: Upload) -> list[str]:
        """Hand over a plan, whole, and read it back where the vehicle lets that be done.

        Until the next `start`, reports count the steps of the plan before. Where this fails the vehicle has
        that one, this one or none.

        Returns:
            Lines for people: what the vehicle did not take and can do without.
        """
        ...

    def start(self, step: int = 0) -> None:
        """Execute the last upload from a step on."""

    def hold(self) -> None:
        """Stay where it is, until the next start."""

    def surface(self) -> None:
        """Give the plan up and surface."""

    def report(self, seconds: float) -> Report:
        """Let `seconds` of mission time pass, and return the newest report."""
        ...

    def close(self) -> None:
        """Let go of the vehicle; it goes on with what it does."""
