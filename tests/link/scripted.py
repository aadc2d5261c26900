"""A vehicle that does as it is given, but for the faults of a script; its time passes in `report` alone."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from auvplan.export.qgroundcontrol import item_speeds
from auvplan.link import Lost, Report, State, Upload
from auvplan.link.limits import Allowance
from tests.executive.small import SMALL, scenario

#: A mission of three legs.
SETTINGS = scenario(
    site={"longitude": 148.96, "latitude": -20.34},
    mission=SMALL["mission"] | {"waypoints": 5, "time_available": 3000},
)

#: A span of mission time, s.
Span = tuple[float, float]
NEVER = (math.inf, math.inf)


def within(now: float, span: Span) -> bool:
    return span[0] <= now < span[1]


class Fails(NamedTuple):
    """What fails of a vehicle, with which error, after a time of the mission, s, and how often."""

    what: str = ""
    error: Exception | None = None
    after: float = -1.0
    times: int = 99


@dataclass
class ScriptedVehicle:
    """Moves along its steps at a speed over ground.

    Attributes:
        start_at: [3] m.
        speed: m/s.
        told: the share that it holds over ground of what its items tell it, in place of that; 0 for none.
        silent: when nothing is heard of it, and asking fails.
        stuck: when it makes no way; a start ends it where `restarts` is set.
        push: m/s, by which it is driven off, while `pushed`.
        fails: what of "connect", "upload", "start", "hold" and "surface" fails.
        gives_up: when it surfaces by itself.
        stopped: when somebody else ends its plan.
        forgets: when it starts anew, without a plan.
        rises: m/s, from its last step on.
        circles: m, about the place of a task.
        skip: when it goes on to its last step but one.
        odd: makes what it reports, from the vehicle and its true report.
    """

    start_at: np.ndarray
    speed: float = 2.5
    told: float = 0.0
    silent: Span = NEVER
    stuck: Span = NEVER
    restarts: bool = False
    push: np.ndarray = field(default_factory=lambda: np.zeros(3))
    pushed: Span = NEVER
    fails: Fails = field(default_factory=Fails)
    gives_up: float = math.inf
    stopped: float = math.inf
    forgets: float = math.inf
    rises: float = math.inf
    circles: float = 0.0
    skip: float = math.inf
    odd: Callable[["ScriptedVehicle", Report], Report] = lambda vehicle, report: report
    name: str = "a scripted vehicle"
    by_legs: bool = False
    rate: float = 0.0
    left_alone: str = ""
    allowance: Allowance = field(default_factory=Allowance)
    notes: list[str] = field(default_factory=list)
    now: float = 0.0

    def __post_init__(self) -> None:
        self.place, self.state = np.array(self.start_at, float), State.IDLE
        self.uploads: list[Upload] = []
        self.plan: Upload | None = None
        self.done, self.left, self.at = 0, 0.0, False
        self.tasks: list[np.ndarray] = []
        self.stated, self.closed, self.failed = Report(), False, 0

    def _ask(self, what: str) -> None:
        if within(self.now, self.silent):
            raise Lost("no answer")
        fails = self.fails
        if what == fails.what and self.now > fails.after and self.failed < fails.times:
            self.failed += 1
            raise fails.error

    def connect(self) -> list[str]:
        self._ask("connect")
        return self.notes

    def upload(self, plan: Upload) -> list[str]:
        self._ask("upload")
        self.uploads.append(plan)
        return []

    def start(self, step: int = 0) -> None:
        self._ask("start")
        self.plan, self.done, self.left, self.at = self.uploads[-1], step, 0.0, False
        self.state = State.EXECUTING
        if self.restarts and within(self.now, self.stuck):
            self.stuck = NEVER

    def hold(self) -> None:
        self._ask("hold")
        self.state = State.HOLDING

    def surface(self) -> None:
        self._ask("surface")
        self.state = State.SURFACING

    def close(self) -> None:
        self.closed = True

    def report(self, seconds: float) -> Report:
        end = self.now + seconds
        if self.now >= self.skip:
            self.skip, self.done, self.at = math.inf, len(self.plan.steps) - 2, False
        if self.now >= self.gives_up:
            self.state = State.SURFACING
        if self.now >= self.stopped:
            self.state = State.STOPPED
        if self.now >= self.forgets:
            self.state, self.forgets = State.IDLE, math.inf
        if self.state is State.SURFACING:
            self.place[2] = max(self.place[2] - 0.5 * seconds, 0.0)
        elif self.state is State.EXECUTING and not within(self.now, self.stuck):
            if within(self.now, self.pushed):
                self.place = self.place + self.push * seconds
            self._go(seconds)
        elif self.state is State.FINISHED:
            self.place[2] = max(self.place[2] - self.rises * seconds, 0.0)
        self.now = end
        if within(self.now, self.silent):
            return replace(self.stated, heard=math.inf)
        self.stated = self.odd(self, Report(0.0, self.place.copy(), self.speed, self.state, self.done))
        return self.stated

    def _go(self, seconds: float) -> None:
        assert self.plan is not None
        while seconds > 0.0 and self.done < len(self.plan.steps):
            step = self.plan.steps[self.done]
            if self.told:
                self.speed = self.told * item_speeds(self.plan.itinerary)[self.done]
            if not self.at:
                way = step.position - self.place
                gap = float(np.linalg.norm(way))
                if gap > self.speed * seconds:
                    self.place = self.place + way / gap * self.speed * seconds
                    return
                self.place, self.at, self.left = step.position.copy(), True, step.hold
                seconds -= gap / self.speed
            if self.left > seconds:
                self.left -= seconds
                angle = self.left * self.speed / max(self.circles, 1.0)
                self.place = step.position + self.circles * np.array([np.cos(angle), np.sin(angle), 0.0])
                return
            seconds -= self.left
            if step.hold > 0.0:
                self.tasks.append(step.position)
            self.done, self.at = self.done + 1, False
        if self.done == len(self.plan.steps):
            self.state = State.FINISHED
