"""How a vehicle gets on with what was uploaded: steps completed, places seen, and how far it is off."""

import math
from dataclasses import dataclass, field

import numpy as np

from auvplan.executive.context import HORIZON
from auvplan.link.limits import Limits
from auvplan.link.vehicle import Report, State, Step, Upload
from auvplan.runtime.arrays import Array

#: m from the place of a task within which the vehicle is taken to be at it.
_AT_TASK = 15.0

#: s of mission time between two sightings by which the pace is judged, s of what was planned in the past that
#: it begins with, and s after which 1/e of what was seen counts, in the long run and in the short.
_APART, _PRIOR, _MEMORY = 30.0, 30.0, np.asarray([1200.0, 180.0])

#: Pace up to which a vehicle counts as slow, s that it must have cost in the long run and in the short, and
#: the least that is counted on.
_SLOW, _COST, _LEAST = 0.95, np.asarray([45.0, 30.0]), 0.3

#: Share of the planned pace below which a vehicle is not under way.
_STANDS = 0.2

#: Greatest speed over ground: factor on the greatest speed through the water, and m/s more.
_TIMES, _MORE = 2.0, 2.0


@dataclass(frozen=True, eq=False)
class Pace:
    """How fast a vehicle gets on, in shares of what it is asked for, in the long run and in the short.

    Attributes:
        planned: [2] s that it was to take for what it went, at the full pace.
        taken: [2] s that it took.
    """

    planned: Array = field(default_factory=lambda: np.full(2, _PRIOR))
    taken: Array = field(default_factory=lambda: np.full(2, _PRIOR))

    def after(self, planned: float, taken: float) -> "Pace":
        """Return the pace after a way that was to take `planned` s at the full pace, and took `taken` s."""
        kept = np.exp(-taken / _MEMORY)
        return Pace(kept * self.planned + planned, kept * self.taken + taken)

    @property
    def share(self) -> float:
        """The share that is counted on; 1 where it is little less, as currents make it differ as well."""
        shares = self.planned / self.taken
        slow = (shares < _SLOW) & (self.taken - self.planned > _COST)
        return max(float(shares[slow].min()), _LEAST) if slow.any() else 1.0


@dataclass
class Progress:
    """How the vehicle gets on with an upload.

    Attributes:
        upload: that it executes.
        first: step that it was started from.
        done: steps that are completed.
        ahead: the step that the vehicle is on its way to, at least `done`.
        place: [3] m and `since` s, where and since when it has not moved.
        astray: s since when it is off its track, or infinite.
        begun: [3] m, where it was when it began, or None.
        task: the step at whose task it was last seen, and s when it was first seen there.
        pace: that it makes, from upload to upload.
        counted: share of the full pace by which the upload's times were planned.
        sight: the last sighting under way that its pace is judged by, or None: the step ahead, s by the plan
            and s when it was, and [3] m.
        stayed: [n] s that it can have been at the place of each step, by where it was seen; -1 for never.
    """

    upload: Upload
    first: int = 0
    done: int = 0
    ahead: int = 0
    place: Array | None = None
    since: float = 0.0
    astray: float = math.inf
    begun: Array | None = None
    task: tuple[int, float] = (-1, 0.0)
    pace: Pace = field(default_factory=Pace)
    counted: float = 1.0
    sight: tuple[int, float, float, Array] | None = None
    stayed: Array = field(init=False)

    def __post_init__(self) -> None:
        self.stayed = np.full(len(self.upload.steps), -1.0)

    @property
    def over(self) -> bool:
        """Whether all steps are completed."""
        return self.done >= len(self.upload.steps)

    @property
    def step(self) -> Step:
        """The step that it is on its way to."""
        return self.upload.steps[self.ahead]

    @property
    def line(self) -> tuple[Array, Array]:
        """Ends [3] m of the straight line that the vehicle is on."""
        alone = self.to_the_start and self.begun is not None
        return (self.begun if alone else self.step.left), self.step.position  # type: ignore[return-value]

    @property
    def to_the_start(self) -> bool:
        """Whether it is on its way to the first place of its plan, from wherever it was."""
        return self.ahead == 0 and self.upload.origin is None

    def see(self, first: Array, last: Array, seconds: float, reach: float) -> None:
        """Take note of where the vehicle can have been between two places [3] m.

        Args:
            first, last, seconds: two sightings of it, and s between them.
            reach: m from a place within which it is taken to be there.
        """
        places = np.asarray([step.position for step in self.upload.steps])
        way = np.linalg.norm(places - first, axis=1) + np.linalg.norm(places - last, axis=1)
        speed = _TIMES * max(step.speed for step in self.upload.steps) + _MORE
        left = seconds - np.maximum(way - 2.0 * reach, 0.0) / speed
        self.stayed = np.where(left >= 0.0, np.maximum(self.stayed, 0.0) + left, self.stayed)

    def stay_on(self, before: "Progress") -> None:
        """Take over its pace, and how long it was at places that it also goes to by this upload."""
        self.pace = before.pace
        known = {step.key: float(time) for step, time in zip(before.upload.steps, before.stayed, strict=True)}
        self.stayed = np.asarray([known.get(step.key, -1.0) for step in self.upload.steps])

    def time_pace(self, place: Array, now: float) -> None:
        """Take note of how far the vehicle, seen under way at [3] m at s, has come by the plan."""
        late = self.late(place, now)
        if late is None or self.to_the_start or self.leaves_task(place):
            self.sight = None
            return
        if self.sight is not None:
            step, planned, when, before = self.sight
            if (taken := now - when) < _APART:
                return
            gone = float(np.linalg.norm(place - before))
            holds = any(passed.hold for passed in self.upload.steps[step : self.ahead])
            onward = now - late - planned  # less than none where the vehicle was put back, as by a restart
            if not holds and onward >= 0.0 and gone > _STANDS * self.step.pace * taken:
                self.pace = self.pace.after(self.counted * onward, taken)
        self.sight = self.ahead, now - late, now, place

    @property
    def slower(self) -> float:
        """Factor by which what is ahead takes longer than the upload's times say, from what was seen."""
        return max(self.counted / self.pace.share, 1.0)

    def complete(self, count: int, now: float) -> list[Step]:
        """Complete steps up to a count as far as the vehicle can have been at them; return these.

        Args:
            count: of steps that it says are completed.
            now: s.
        """
        fresh = []
        for number, step in list(enumerate(self.upload.steps))[self.done : max(count, 0)]:
            if step.ends_leg and self.stayed[number] < step.hold:
                break  # it is not there yet, whatever it says
            self.done += 1
            self.since = now
            fresh.append(step)
        self.ahead = max(self.ahead, min(self.done, len(self.upload.steps) - 1))
        return fresh

    def pass_corners(self, place: Array) -> None:
        """See which corner of its leg a vehicle at [3] m has passed that does not say so itself."""
        steps = self.upload.steps
        while self.done > self.first and self.ahead + 1 < len(steps) and not self.step.ends_leg:
            step, after = steps[self.ahead], steps[self.ahead + 1]
            if _beside(place, after.left, after.position)[1] >= _beside(place, step.left, step.position)[1]:
                return
            self.ahead += 1

    def passed(self, upload: Upload) -> int:
        """Return the steps at the beginning of another upload that the vehicle has completed already."""
        done = {step.key for step in self.upload.steps[: self.ahead]}
        return next((k for k, step in enumerate(upload.steps) if step.key not in done), len(upload.steps))

    def at_task(self, place: Array | None) -> bool:
        """Return whether the vehicle, at [3] m, is at the place of a task that is not done."""
        return place is not None and not self.over and _is_at(self.step, place)

    def off_task(self, place: Array, now: float) -> float:
        """Return m that the vehicle, at [3] m, circles off its task's place; 0 before it can be there."""
        if not self.at_task(place) or self._time_at_task(now) < 2.0 * _AT_TASK / self.step.pace:
            return 0.0
        return float(np.linalg.norm(self.step.position - place))

    def _time_at_task(self, now: float) -> float:
        """Take note that the vehicle is at its task; return s since it was first seen there."""
        if self.task[0] != self.ahead:
            self.task = self.ahead, now
        return now - self.task[1]

    def leaves_task(self, place: Array) -> bool:
        """Return whether the vehicle, at [3] m, is still at the place of the task that it completed last.

        It counts as completed as soon as it can have been.
        """
        return self.done > 0 and _is_at(self.upload.steps[self.done - 1], place)

    def still(self, report: Report, now: float, limits: Limits) -> float:
        """Take note of whether the vehicle moves; return s for which it has made no way, 0 where that may be.

        A task is done without way, and a vehicle without a plan is not waited for as long.
        """
        place = report.position
        if place is None:
            return 0.0
        if self.place is None or np.linalg.norm(place - self.place) > limits.moved:
            self.place = place
            if report.state not in (State.IDLE, State.HOLDING, State.FINISHED):
                self.since = now
        allowed = limits.idle if report.state is State.IDLE else limits.stall
        if self.at_task(place) and report.state is not State.IDLE:
            allowed += self.step.hold
        return now - self.since if now - self.since > allowed else 0.0

    def drift(self, place: Array, now: float, limits: Limits) -> float:
        """Return m by which the vehicle, at [3] m, has been off its track for too long; else 0."""
        if self.over:
            return 0.0
        _, off = _beside(place, *self.line)
        if off <= limits.corridor:
            self.astray = math.inf
        elif self.astray == math.inf:
            self.astray = now
        return off if now - self.astray > limits.astray else 0.0

    def late(self, place: Array | None, now: float) -> float | None:
        """Return s that the vehicle, at [3] m, is behind its plan; None where that cannot be said."""
        if place is None or self.over or self.at_task(place):
            return None
        step = self.step
        if self.to_the_start:
            ahead = float(np.linalg.norm(step.position - place)) / step.speed
            return now + ahead - step.time
        share, _ = _beside(place, step.left, step.position)
        return now - (step.left_at + share * (step.time - step.left_at))

    def track_ahead(self, place: Array, now: float) -> tuple[Array, Array]:
        """Return the track of the present leg within the next minutes from [3] m: places [n, 3] m, and s.

        At a task it stays at the task's place, wherever about that it circles, until the task is done.
        """
        if self.at_task(place):
            # Some vehicles begin it when they have come to rest at its place, from `_AT_TASK` on.
            left = self.step.hold + 2.0 * _AT_TASK / self.step.pace - self._time_at_task(now)
            return staying(self.step.position, float(np.clip(left, 0.0, HORIZON)))
        places, times = [place], [0.0]
        for step in self.upload.steps[self.ahead :]:
            if step.leg != self.step.leg or times[-1] >= HORIZON:
                break
            gap = float(np.linalg.norm(step.position - places[-1]))
            pace = step.pace / self.slower
            share = min(1.0, (HORIZON - times[-1]) * pace / max(gap, 1e-6))
            places.append(places[-1] + share * (step.position - places[-1]))
            times.append(times[-1] + share * gap / pace)
        return np.asarray(places), np.asarray(times)


def staying(place: Array, seconds: float) -> tuple[Array, Array]:
    """Return the track of a vehicle that stays at [3] m: places [2, 3] m, and s."""
    return np.stack([place, place]), np.asarray([0.0, seconds])


def _is_at(step: Step, place: Array) -> bool:
    """Return whether [3] m is the place of a step's task."""
    return step.hold > 0.0 and bool(np.linalg.norm(step.position - place) < _AT_TASK)


def _beside(place: Array, first: Array, last: Array) -> tuple[float, float]:
    """Return how far along the straight line between two places another is, as a share, and m off it."""
    way = last - first
    length = float(way @ way)
    share = float(np.clip((place - first) @ way / length, 0.0, 1.0)) if length else 1.0
    return share, float(np.linalg.norm(place - first - share * way))
