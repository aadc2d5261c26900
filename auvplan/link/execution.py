"""Executes a mission on one vehicle: upload, follow, re-plan the rest, end safely.

The loop sees the vehicle through a `VehicleLink` alone. Whatever happens it comes to a verdict: every wait
has a limit, and every limit ends in another try or in a safe end.
"""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from auvplan.export.itinerary import ExportError, PlannedLeg
from auvplan.link.limits import Limits
from auvplan.link.notices import CurrentNotice, NoNotices, Notices, ObstacleNotice
from auvplan.link.record import UNDER_WAY, Event, ExecutionRecord
from auvplan.link.rolling import Prospect, RollingPlan
from auvplan.link.vehicle import LinkError, Report, State, Step, Upload, VehicleLink, one_line
from auvplan.ocean.known import KnownObstacle
from auvplan.records import LegRecord
from auvplan.runtime.formatting import counted

Array = NDArray[np.floating]

_log = logging.getLogger(__name__)

#: Called with every event.
Tell = Callable[[Event], None]

#: Called with the record as far as it goes, when something has happened to a vehicle that is under way.
Keep = Callable[[ExecutionRecord], None]

#: m from the place of a task within which the vehicle is taken to be at it.
_AT_TASK = 15.0

#: s ahead within which the track is looked at for known obstacles.
_AHEAD = 180.0

#: m; a vehicle that is no deeper is at the surface.
_SURFACE = 1.0

#: s of mission time between two tries of something that failed.
_PAUSE = 60.0

#: s of mission time that a plan from a hold may begin later than it was made for.
_LATE = 20.0

#: Greatest speed over ground: factor on the vehicle's speed, and m/s more.
_TIMES, _MORE = 2.0, 2.0

#: State of a vehicle that was sent nothing.
_NOT_STARTED = "the vehicle was not started"


class _SafeEnd(Exception):
    """The mission cannot go on; the message says why."""


class _Left(_SafeEnd):
    """Somebody else has ended it; the vehicle is theirs."""


@dataclass
class _Progress:
    """How the vehicle gets on with an upload.

    Attributes:
        upload: that it executes.
        first: step that it was started from.
        done: steps that are completed.
        ahead: the step that the vehicle is on its way to, at least `done`.
        place: [3] m and `since` s, where and since when it has not moved.
        astray: s since when it is off its track, or infinite.
        begun: [3] m, where it was when it began, or None.
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
    stayed: Array = field(init=False)

    def __post_init__(self) -> None:
        self.stayed = np.full(len(self.upload.steps), -1.0)

    @property
    def line(self) -> tuple[Array, Array]:
        """Ends [3] m of the straight line that the vehicle is on."""
        step = self.upload.steps[self.ahead]
        alone = self.ahead == 0 and self.upload.origin is None and self.begun is not None
        return (self.begun if alone else step.left), step.position  # type: ignore[return-value]

    def see(self, first: Array, last: Array, seconds: float, reach: float) -> None:
        """Take note of where the vehicle can have been between two places [3] m.

        Args:
            first, last, seconds: two sightings of it, and s between them.
            reach: m from a place within which it is taken to be there.
        """
        places = np.asarray([step.position for step in self.upload.steps])
        way = np.linalg.norm(places - first, axis=1) + np.linalg.norm(places - last, axis=1)
        speed = _TIMES * self.upload.itinerary.speed + _MORE
        left = seconds - np.maximum(way - 2.0 * reach, 0.0) / speed
        self.stayed = np.where(left >= 0.0, np.maximum(self.stayed, 0.0) + left, self.stayed)

    def stay_on(self, before: "_Progress") -> None:
        """Take over how long the vehicle was at places that it also goes to by this upload."""
        known = {
            _place(step): float(time) for step, time in zip(before.upload.steps, before.stayed, strict=True)
        }
        self.stayed = np.asarray([known.get(_place(step), -1.0) for step in self.upload.steps])

    def believed(self, number: int) -> bool:
        """Return whether the vehicle can have completed a step, as it says."""
        step = self.upload.steps[number]
        return not step.ends_leg or bool(self.stayed[number] >= step.hold)


@dataclass(frozen=True)
class _Next:
    """A plan that waits to be handed over.

    Attributes:
        upload: of it.
        prospect: that it is from.
        kept: legs that it has in common with the plan before; they must not be over when it is handed over.
        cause: why it was made.
        begins: s of mission time that it is to be started at; infinite where it joins what is under way.
    """

    upload: Upload
    prospect: Prospect
    kept: int
    cause: str
    begins: float = math.inf


def execute(
    plan: RollingPlan,
    link: VehicleLink,
    *,
    limits: Limits | None = None,
    notices: Notices | None = None,
    tell: Tell | None = None,
    keep: Keep | None = None,
) -> ExecutionRecord:
    """Plan a mission, execute it on a vehicle, and say how it ended.

    Args:
        plan: of the mission, which is planned here.
        link: to the vehicle; it is closed at the end.
        limits: of times and tries.
        notices: of obstacles and currents, reported from outside.
        tell: called with what happens.
        keep: called with the record as it is, from the vehicle's start on, whenever something happens.

    Returns:
        The record, whatever happened.

    Raises:
        KeyboardInterrupt: with one line on how the vehicle is; the record was kept.
    """
    tell, keep = tell or (lambda _: None), keep or (lambda _: None)
    return _Executor(plan, link, limits or Limits(), notices or NoNotices(), tell, keep).run()


class _Executor:
    def __init__(
        self, plan: RollingPlan, link: VehicleLink, limits: Limits, notices: Notices, tell: Tell, keep: Keep
    ) -> None:
        self._plan, self._link, self._limits, self._notices = plan, link, limits, notices
        self._tell, self._keep = tell, keep
        run = plan.run
        self._record = ExecutionRecord(
            run.scenario, run.folder, run.seed, link.name, run.t_available, reason=UNDER_WAY
        )
        self._route = [run.start]
        self._count = 0  # legs that are done
        self._new: _Next | None = None
        self._due = ""  # why the rest is to be re-planned
        self._settled = -1  # legs that were done when the rest was last re-planned for its times
        self._started = False
        self._holding = False  # because of a hazard; a new plan is needed to go on
        self._tries = 0  # answers in a row to what did not go away
        self._failed = -math.inf  # s, when something failed that is tried again later
        self._ahead = -math.inf  # s, when the track ahead was last looked at
        self._cost = 0.0  # s of mission time that re-planning takes
        self._silent = self._over = False
        self._measured = -math.inf  # s, when the rest was last re-planned for a current
        # s and [3] m, when and where the vehicle was last seen.
        self._sight: tuple[float, Array] | None = None

    def run(self) -> ExecutionRecord:
        """Execute the mission."""
        record = self._record
        try:
            self._go()
        except KeyboardInterrupt:
            record.reason = "interrupted"
            if not record.safe:
                record.safe = self._left_alone if self._started else _NOT_STARTED
            raise KeyboardInterrupt(f"{record.reason}; {record.safe}") from None
        finally:
            record.t_mission = record.t_mission or self._now
            self._link.close()
            self._say("end", f"{record.reason}; {record.safe}")
        return record

    def _go(self) -> None:
        """Execute the mission, and bring the vehicle to a safe end where it cannot go on."""
        try:
            self._depart()
            self._follow()
        except _Left as error:
            self._record.reason, self._record.safe = str(error), "left to whoever stopped it"
            self._watch_rise()
        except (_SafeEnd, LinkError, ExportError) as error:
            self._end_safely(str(error))
        except Exception as error:  # a vehicle is under way: whatever is wrong here, it is brought up
            _log.exception("the executor failed")
            self._end_safely(one_line(f"the executor failed: {type(error).__name__}: {error}"))

    @property
    def _now(self) -> float:
        return self._link.now

    def _say(self, kind: str, text: str) -> None:
        event, record = Event(round(self._now, 1), kind, text), self._record
        record.events.append(event)
        self._tell(event)
        if self._started:
            record.planned = [self._leg_name(leg) for leg in self._plan.legs]
            record.route = [self._plan.run.called(node) for node in self._route]
            self._keep(record)

    def _leg_name(self, leg: LegRecord) -> str:
        run = self._plan.run
        return f"{run.called(leg.start)} - {run.called(leg.goal)}"

    def _depart(self) -> None:
        """Plan, find the vehicle, upload, start.

        Raises:
            _SafeEnd: there is no plan, or the vehicle is elsewhere or busy.
            Lost, Refused: the vehicle is not there, or does not take the plan.
            ExportError: the plan cannot be handed to a vehicle.
        """
        if not self._plan.plan(self._link.allowance):
            raise _SafeEnd(f"no plan: {self._plan.reason}")
        self._plan.make_ready()
        plan = self._plan.followed
        whole = Upload(self._plan.itinerary(plan, 0))
        legs, available = counted(len(plan.legs), "leg"), self._record.t_available
        self._say("plan", f"planned: {legs}, {plan.ends:.0f} s of {available:.0f} s")
        notes = self._link.connect()
        self._say("connected", f"connected to {self._link.name}")
        for note in notes:
            self._say("note", note)
        level = self._check_ready(self._link.wait(0.0), whole.steps[0].position)
        away = level / whole.itinerary.speed
        if away > _LATE and self._plan.plan(self._link.allowance, away):
            plan = self._plan.followed
            whole = Upload(self._plan.itinerary(plan, 0))
            self._say("plan", f"the vehicle is {away:.0f} s from the start: planned end {plan.ends:.0f} s")
        self._progress = _Progress(whole)
        self._see(self._link.wait(0.0))
        self._hand_over(_Next(whole, plan, 0, "start"))

    def _check_ready(self, report: Report, start: Array) -> float:
        """See that the vehicle is where the mission starts, [3] m, and does nothing else.

        Returns:
            m that it is from there, depth apart; 0 where its place is not known.

        Raises:
            _SafeEnd: it is not so.
        """
        if report.state is State.EXECUTING:
            raise _SafeEnd("the vehicle executes a plan already: end that first")
        if report.state is State.FAULT:
            self._check_state(report)
        gap = np.zeros(3) if report.position is None else report.position - start
        away = float(np.linalg.norm(gap))
        if away > self._limits.away:
            raise _SafeEnd(f"the vehicle is {away:,.0f} m from the mission's start")
        return float(np.linalg.norm(gap[:2]))

    def _hand_over(self, new: _Next) -> None:
        """Upload and start; what the vehicle has completed of it is not done again.

        Raises:
            Lost, Refused: the vehicle may have this plan or the one before.
        """
        if self._started:
            self._check_state(self._link.wait(0.0))
        before = self._progress
        fresh = new.upload if before.upload is new.upload else new.upload.without(self._passed(new.upload))
        known = before.ahead
        for note in self._link.upload(fresh):
            self._say("note", note)
        if self._started:
            report = self._link.wait(0.0)
            self._book(report)
            self._check_state(report)
            if self._count > new.kept:
                self._say("replan", "the vehicle is past the leg that the new plan begins with: it is held")
                self._link.hold()
                self._new, self._due, self._holding = None, new.cause, True
                return
        more = min(before.ahead - known, len(fresh.steps) - 1)
        self._started = True
        self._link.start(more)
        begun = None if self._sight is None else self._sight[1]
        self._progress = _Progress(fresh, more, more, more, since=self._now, begun=begun)
        self._progress.stay_on(before)
        self._plan.followed = new.prospect
        self._new, self._due, self._holding, self._ahead = None, "", False, -math.inf
        steps = [[*map(float, step.position.round(3)), step.hold] for step in fresh.steps]
        number, when = new.upload.number, round(self._now, 1)
        self._record.uploads.append({"number": number, "cause": new.cause, "time": when, "steps": steps})
        self._say("upload", f"upload {number} ({new.cause}): {counted(len(fresh.steps), 'waypoint')}")

    def _passed(self, upload: Upload) -> int:
        """Return the steps at the beginning of an upload that the vehicle has completed already."""
        progress = self._progress
        done = {_place(step) for step in progress.upload.steps[: progress.ahead]}
        count = 0
        while count < len(upload.steps) and _place(upload.steps[count]) in done:
            count += 1
        return count

    def _follow(self) -> None:
        """Look at the vehicle until it is at the destination."""
        while self._count < len(self._plan.legs):
            report = self._link.wait(self._limits.look)
            self._book(report)
            if self._count >= len(self._plan.legs):
                break
            self._hear()
            self._check_end()
            self._check_state(report)
            if not self._reached(report):
                continue
            if self._holding:
                self._go_on_past()
                continue
            self._check_moves(report)
            if report.state is State.IDLE:
                continue
            self._check_track(report)
            self._check_ahead(report)
            self._check_time(report)
            self._plan_rest()
            self._send()
        self._arrive()

    def _book(self, report: Report) -> None:
        """Book where the vehicle is, and the steps that it has completed and can have completed."""
        progress = self._progress
        self._see(report)
        if report.position is not None:
            north, east, depth = (round(float(part), 2) for part in report.position)
            row = round(self._now, 1), north, east, depth
            if not self._record.track or self._record.track[-1][1:] != row[1:]:
                self._record.track.append(row)
        steps = progress.upload.steps
        for number, step in list(enumerate(steps))[progress.done : max(report.done, 0)]:
            if not progress.believed(number):
                break  # it is not there yet, whatever it says
            progress.done += 1
            progress.since, self._tries = self._now, 0
            if step.ends_leg:
                self._end_leg(step.leg)
        progress.ahead = max(progress.ahead, min(progress.done, len(steps) - 1))
        if self._link.by_legs and report.position is not None and progress.done > progress.first:
            self._pass_corners(progress, report.position)

    def _see(self, report: Report) -> None:
        """Take note of where the vehicle is and can have been since it was last seen."""
        if report.position is None or report.heard > self._limits.silence:
            return
        now = self._now - report.heard * self._link.rate
        before, place = self._sight or (now, report.position)
        self._progress.see(place, report.position, now - before, self._limits.corridor)
        self._sight = now, report.position

    def _pass_corners(self, progress: _Progress, place: Array) -> None:
        """See which corner of its leg the vehicle has passed where it does not say so itself."""
        steps = progress.upload.steps
        while progress.ahead + 1 < len(steps) and not steps[progress.ahead].ends_leg:
            step, after = steps[progress.ahead], steps[progress.ahead + 1]
            if _distance(place, after.left, after.position) >= _distance(place, step.left, step.position):
                return
            progress.ahead += 1

    def _end_leg(self, number: int) -> None:
        """Book legs up to one of a number, from 1."""
        for leg in self._plan.legs[self._count : number]:
            self._route.append(leg.goal)
            if leg.priority > 0.0:
                self._record.tasks.append(self._leg_name(leg))
                self._record.total_priority += leg.priority
            task = ", task done" if leg.priority > 0.0 else ""
            planned = float(leg.times[-1]) + leg.t_wait + leg.t_task
            off = f"{self._now - planned:+.0f} s off the plan"
            run = self._plan.run
            place = run.called(leg.goal) if run.names else f"waypoint {leg.goal}"
            self._say("leg", f"reached {place}{task}, {off}")
        self._count = max(self._count, number)

    def _hear(self) -> None:
        """Take in what is reported from outside."""
        reported = []
        for notice in self._notices.read():
            if isinstance(notice, str):
                self._say("note", notice)
            elif isinstance(notice, ObstacleNotice):
                now = self._now
                obstacle = notice.obstacle
                north, east = (p - v * now for p, v in zip(obstacle.position, obstacle.velocity, strict=True))
                self._plan.add_obstacle(replace(obstacle, position=(north, east)))
                self._say("reported", f"obstacle {obstacle.name}, radius {obstacle.radius:.0f} m")
                self._ahead = -math.inf
                reported.append(obstacle)
            elif isinstance(notice, CurrentNotice):
                place = self._link.wait(0.0).position if notice.position is None else notice.position
                if place is None:
                    self._say("note", "a current was reported before the vehicle's place is known: left out")
                    continue
                offset = self._plan.correct_current(notice.velocity, place, self._now)
                if offset is None:
                    self._say("note", "a current was reported where there is no forecast: left out")
                    continue
                words = ", ".join(f"{part:+.2f}" for part in offset)
                self._say("reported", f"current: the forecast is moved by {words} m/s north, east, down")
                if self._now - self._measured >= _PAUSE:
                    self._due, self._new, self._measured = "current", None, self._now
        if reported:
            self._check_legs(reported)

    def _check_legs(self, reported: list[KnownObstacle]) -> None:
        """See whether reported obstacles are in the way of the legs after the present one."""
        names = reported[0].name if len(reported) == 1 else counted(len(reported), "obstacle")
        for leg in self._plan.legs[self._count + 1 :]:
            if self._plan.clearance(leg.positions, leg.times) < self._plan.margin:
                self._due, self._new = "hazard", None
                self._say("hazard", f"in the way of leg {self._leg_name(leg)}: {names}")
                return

    def _check_end(self) -> None:
        """Say when the time available is over, and give up some time after.

        Raises:
            _SafeEnd: the vehicle is overdue.
        """
        available = self._record.t_available
        if self._now > available and not self._over:
            self._over = True
            self._say("over", f"the time available, {available:.0f} s, is over, and the vehicle is under way")
        if self._now > available + self._limits.overdue:
            raise _SafeEnd(("the link is lost and " if self._silent else "") + "the vehicle is overdue")

    def _reached(self, report: Report) -> bool:
        """Return whether the vehicle and its place are heard of; without a link it goes on with its plan."""
        heard = report.heard <= self._limits.silence
        if heard and report.position is not None:
            if self._silent:
                self._silent, self._progress.since, self._progress.astray = False, self._now, math.inf
                self._say("heard", "the link is there again")
            return True
        if not self._silent:
            self._silent = True
            what = f"nothing heard for {report.heard:.0f} s" if not heard else "its place is not known"
            self._say("lost", f"{what}: {self._goes_on if heard else self._left_alone}")
        return False

    @property
    def _goes_on(self) -> str:
        upload = self._progress.upload
        return (
            f"the vehicle goes on with upload {upload.number}, whose last item is to {upload.itinerary.end}"
        )

    @property
    def _left_alone(self) -> str:
        """What the vehicle does when nobody talks to it, in words."""
        alone = self._link.left_alone
        return f"by its own settings {alone}" if alone else self._goes_on

    def _check_state(self, report: Report) -> None:
        """Give up where the vehicle itself did, or somebody else.

        Raises:
            _SafeEnd: it is in a state of fault, or surfaces; `_Left`: it was stopped.
        """
        if report.state in (State.FAULT, State.SURFACING, State.STOPPED):
            words = f": {report.message}" if report.message else ""
            end = _Left if report.state is State.STOPPED else _SafeEnd
            raise end(f"the vehicle is {report.state.value}{words}")

    def _at_task(self, report: Report) -> bool:
        """Return whether the vehicle is at the place of a task that is not done."""
        progress = self._progress
        if report.position is None or progress.done >= len(progress.upload.steps):
            return False
        step = progress.upload.steps[progress.ahead]
        return step.hold > 0.0 and bool(np.linalg.norm(step.position - report.position) < _AT_TASK)

    def _check_moves(self, report: Report) -> None:
        """Start a vehicle again that has stopped.

        Raises:
            _SafeEnd: it stops again and again.
        """
        progress, now, place = self._progress, self._now, report.position
        if place is None:
            return
        if progress.place is None or np.linalg.norm(place - progress.place) > self._limits.moved:
            progress.place = place
            if report.state not in (State.IDLE, State.HOLDING, State.FINISHED):
                progress.since = now
                return
        allowed = self._limits.idle if report.state is State.IDLE else self._limits.stall
        if self._at_task(report) and report.state is not State.IDLE:
            allowed += progress.upload.steps[progress.ahead].hold
        if now - progress.since <= allowed:
            return
        where = f"{report.state.value}, {report.message}" if report.message else report.state.value
        self._try("stopped", f"no way made for {now - progress.since:.0f} s ({where}): started again")
        if self._asked(self._start_again):
            self._failed = now  # it gets under way before what is left is re-planned for its times
        progress.since = now

    def _start_again(self) -> None:
        """Hand over what the vehicle should have, as it may have lost it, and start it where it was.

        Raises:
            Lost, Refused: it does not.
        """
        progress = self._progress
        self._link.upload(progress.upload)
        self._link.start(progress.ahead)

    def _try(self, kind: str, text: str) -> None:
        """Count an answer to what went wrong.

        Raises:
            _SafeEnd: there were too many in a row.
        """
        self._tries += 1
        if self._tries > self._limits.tries:
            raise _SafeEnd(f"{text.split(':')[0]}, after {self._limits.tries} tries")
        self._say(kind, text)

    def _asked(self, call: Callable[[], None]) -> bool:
        """Ask the vehicle for something; return whether it does it. What fails is tried again later."""
        try:
            call()
        except LinkError as error:
            self._say("failed", str(error))
            self._failed = self._now
            return False
        return True

    def _check_track(self, report: Report) -> None:
        """Hold a vehicle that has left its track, and plan from where it is."""
        progress, place = self._progress, report.position
        if place is None or progress.done >= len(progress.upload.steps):
            return
        off = _distance(place, *progress.line)
        if off <= self._limits.corridor:
            progress.astray = math.inf
        elif progress.astray == math.inf:
            progress.astray = self._now
        elif self._now - progress.astray > self._limits.astray:
            self._hold("drift", f"{off:.0f} m off its track")

    def _check_ahead(self, report: Report) -> None:
        """Hold a vehicle whose track leads through an obstacle within the next minutes."""
        progress, now = self._progress, self._now
        due = now - self._ahead >= self._limits.astray and report.position is not None
        if not due or progress.done >= len(progress.upload.steps) or self._at_task(report):
            return
        self._ahead = now
        assert report.position is not None
        speed = progress.upload.steps[progress.ahead].pace(progress.upload.itinerary.speed)
        places, left = [report.position], _AHEAD * speed
        number = progress.upload.steps[progress.ahead].leg
        for step in progress.upload.steps[progress.ahead :]:
            gap = float(np.linalg.norm(step.position - places[-1]))
            if step.leg != number or left <= 0.0:
                break
            places.append(places[-1] + min(1.0, left / max(gap, 1e-6)) * (step.position - places[-1]))
            left -= gap
        track = np.asarray(places)
        passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(track, axis=0), axis=1))])
        if self._plan.clearance(track, now + passed / speed) < 0.5 * self._plan.margin:
            self._hold("hazard", "an obstacle is in the way of the present leg")

    def _hold(self, kind: str, why: str) -> None:
        """Hold the vehicle where it is, until there is a plan from there.

        Raises:
            _SafeEnd: that was so too often.
        """
        if self._now - self._failed < _PAUSE:
            return
        self._try(kind, f"{why}: the vehicle is held, and the way from there re-planned")
        if self._asked(self._link.hold):
            self._holding, self._new, self._due = True, None, kind
            self._failed = -math.inf
            self._go_on_past()

    def _go_on_past(self) -> None:
        """Plan from where the vehicle holds, and go on.

        Raises:
            _SafeEnd: no plan leads on, try after try.
        """
        if self._now - self._failed < _PAUSE:
            return
        report, cause = self._link.wait(0.0), self._due
        self._book(report)  # it may have ended a leg before it held
        if report.position is None or self._count >= len(self._plan.legs):
            return
        if self._new is not None and (self._count > self._new.kept or self._now - self._new.begins > _LATE):
            self._new = None
        if self._new is None:
            begins, found = self._plan_from(report.position)
            if found is None:
                self._failed = self._now
                self._try("no plan", f"no plan from here: {self._plan.reason}; the vehicle holds")
                return
            upload = Upload(self._plan.itinerary(found, self._count), self._progress.upload.number + 1)
            self._new = _Next(upload, found, self._count, cause, begins)
            legs = counted(len(found.legs) - self._count, "leg")
            self._say("replan", f"{cause}, from {begins:.0f} s: {legs}, planned end {found.ends:.0f} s")
        new = self._new
        if not self._asked(lambda: self._hand_over(new)):
            self._try("failed", "the plan past it was not taken: sent again")

    def _plan_from(self, position: Array) -> tuple[float, Prospect | None]:
        """Plan from where the vehicle holds, [3] m, for when it can be started, twice where that is missed.

        Returns:
            s of mission time that the plan begins at, and the plan, or None.
        """
        for _ in range(2):
            asked = self._now
            begins = asked + self._cost
            found = self._plan.from_position(self._count, position, begins)
            self._cost = self._now - asked
            if found is None or self._now - begins <= _LATE:
                break
        return begins, found

    def _check_time(self, report: Report) -> None:
        """See whether the vehicle is so far off its plan that the rest is re-planned."""
        late = self._late(report)
        if late is None or self._due or self._new is not None or self._settled == self._count:
            return
        if abs(late) > max(self._limits.late, self._plan.tolerance):
            self._due, self._settled = "late" if late > 0.0 else "early", self._count

    def _late(self, report: Report) -> float | None:
        """Return s that the vehicle is behind its plan on this leg; None where that cannot be said."""
        progress = self._progress
        if report.position is None or progress.done >= len(progress.upload.steps) or self._at_task(report):
            return None
        step = progress.upload.steps[progress.ahead]
        if progress.ahead == 0 and progress.upload.origin is None:
            ahead = float(np.linalg.norm(step.position - report.position)) / progress.upload.itinerary.speed
            return self._now + ahead - step.time
        way = step.position - step.left
        length = float(way @ way)
        share = float(np.clip((report.position - step.left) @ way / length, 0.0, 1.0)) if length else 1.0
        return self._now - (step.left_at + share * (step.time - step.left_at))

    def _plan_rest(self) -> None:
        """Re-plan what comes after the leg that the vehicle will be on by then."""
        if not self._due or self._new is not None or self._now - self._failed < _PAUSE:
            return
        legs, late = self._plan.legs, self._late(self._link.wait(0.0)) or 0.0
        kept = self._count + 1
        while kept < len(legs) and _after(legs[kept - 1], late) < self._now + self._cost:
            kept += 1
        if kept >= len(legs):
            self._due = ""
            return
        cause, begin = self._due, self._now
        found = self._plan.from_leg(kept, _after(legs[kept - 1], late))
        if found is None:
            self._due = ""
            self._say("no plan", f"no better plan ({cause}): {self._plan.reason}; it goes on as uploaded")
            return
        present = self._progress.upload.without(self._progress.ahead)
        staying = [_shifted(leg, late) for leg in present.itinerary.legs if leg.number <= kept]
        rest = self._plan.itinerary(found, kept)
        first = present.steps[0]
        origin = first.left, first.left_at + late
        if self._progress.ahead == 0 and present.origin is None:  # it is on its way to the start
            origin = self._progress.line[0], first.left_at
        legs_left = replace(rest, legs=(*staying, *rest.legs))
        upload = Upload(legs_left, self._progress.upload.number + 1, origin)
        self._new = _Next(upload, found, kept, cause)
        self._cost = self._now - begin
        anew = counted(len(found.legs) - kept, "leg")
        self._say("replan", f"{cause}, {late:+.0f} s: {anew} anew, planned end {found.ends:.0f} s")

    def _send(self) -> None:
        """Send what was planned, where that takes or doubles no task."""
        if self._new is None or self._now - self._failed < _PAUSE:
            return
        report, progress, new = self._link.wait(0.0), self._progress, self._new
        self._book(report)
        if self._count >= new.kept:
            self._new, self._due = None, new.cause
            self._say("replan", "the new plan came too late for its first leg")
            return
        if report.position is None or progress.done >= len(progress.upload.steps):
            return
        step = progress.upload.steps[progress.ahead]
        speed = step.pace(progress.upload.itinerary.speed)
        left = float(np.linalg.norm(step.position - report.position)) / speed
        if step.hold > 0.0 and left < 10.0 + 3.0 * self._limits.reply * self._link.rate:
            return
        if not self._asked(lambda: self._hand_over(new)):
            self._try("failed", "the new plan was not taken: sent again")

    def _arrive(self) -> None:
        """Watch the end behaviour, and give the verdict."""
        record, end = self._record, self._progress.upload.itinerary.end
        arrived = self._now
        record.t_mission, record.success = arrived, arrived < record.t_available
        record.reason = "destination reached" + (" in time" if record.success else " too late")
        record.safe = f"the vehicle was not seen to {end} yet"
        while self._now - arrived < self._limits.ending:
            report = self._link.wait(self._limits.look)
            self._book(report)
            if end != "surface":
                record.safe = f"at the end: {end}"
                return
            if self._is_up(report):
                return

    def _end_safely(self, why: str) -> None:
        """Have the vehicle surface, and see that it does; nothing that fails here is raised."""
        record = self._record
        record.reason = why
        if not self._started:
            record.safe = _NOT_STARTED
            return
        upload = self._progress.upload
        record.safe = (
            f"told to surface, not answered; upload {upload.number} ends with {upload.itinerary.end}"
        )
        for attempt in range(self._limits.tries):
            try:
                if attempt:
                    self._link.wait(_PAUSE)
                self._link.abort()
            except Exception as error:
                self._say("failed", one_line(str(error)))
                continue
            record.safe = "told to surface"
            self._watch_rise()
            return

    def _watch_rise(self) -> None:
        """See that the vehicle surfaces."""
        begin, before = self._now, self._record.safe
        while self._now - begin < self._limits.ending:
            try:
                report = self._link.wait(self._limits.look)
            except LinkError as error:
                self._say("failed", str(error))
                return
            if self._is_up(report):
                return
            if report.position is not None:
                self._record.safe = f"{before}, last seen at a depth of {report.position[2]:.1f} m"

    def _is_up(self, report: Report) -> bool:
        """Return whether the vehicle is at the surface by its depth, and record it."""
        up = report.position is not None and bool(report.position[2] < _SURFACE)
        if up:
            self._record.safe = "at the surface"
        return up


def _place(step: Step) -> tuple[float, ...]:
    """Return what distinguishes a step from those of other places and legs."""
    return step.leg, *step.position.tolist()


def _after(leg: LegRecord, late: float) -> float:
    """Return s, when a leg and its task are done by a vehicle that is late."""
    return float(leg.times[-1]) + late + max(leg.t_wait - max(late, 0.0), 0.0) + leg.t_task


def _shifted(leg: PlannedLeg, seconds: float) -> PlannedLeg:
    """Return a leg that is gone later."""
    return replace(leg, times=leg.times + seconds, kept_times=leg.kept_times + seconds)


def _distance(place: Array, first: Array, last: Array) -> float:
    """Return m from a place to the straight line between two others."""
    way = last - first
    length = float(way @ way)
    share = float(np.clip((place - first) @ way / length, 0.0, 1.0)) if length else 0.0
    return float(np.linalg.norm(place - first - share * way))
