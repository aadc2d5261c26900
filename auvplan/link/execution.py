"""Executes a mission on one vehicle: upload, follow, re-plan the rest, end safely.

The loop sees the vehicle through a `VehicleLink` alone, and does what `decide` says until the next look.
Whatever happens it comes to a verdict: every wait has a limit, and every limit ends in another try or in a
safe end.
"""

import logging
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from auvplan.executive.decide import Act, Decision, Facts, Phase, Waiting, after, decide
from auvplan.export.itinerary import ExportError
from auvplan.link.limits import Limits
from auvplan.link.notices import AllNotices, CurrentNotice, GoneNotice, Notices, ObstacleNotice
from auvplan.link.progress import Progress, staying
from auvplan.link.record import UNDER_WAY, Event, ExecutionRecord
from auvplan.link.rolling import Prospect, RollingPlan
from auvplan.link.vehicle import LinkError, Report, State, Upload, VehicleLink, one_line
from auvplan.records import LegRecord
from auvplan.runtime.arrays import Array
from auvplan.runtime.formatting import counted

_log = logging.getLogger(__name__)

#: Called with every event.
Tell = Callable[[Event], None]

#: Called with the record as far as it goes, when something has happened to a vehicle that is under way.
Keep = Callable[[ExecutionRecord], None]

#: m; a vehicle that is no deeper is at the surface.
_SURFACE = 1.0

#: s of mission time between two tries of something that failed.
_PAUSE = 60.0

#: s of mission time that a plan from a hold may begin later than it was made for.
_LATE = 20.0

#: s by which a plan that ends too late must end sooner than the one in hand to replace it, and by which a
#: mission must be foreseen to end later than before to be re-planned for that.
_SOONER = 60.0

#: s of mission time between two looks at the track ahead under way, where nothing new is reported.
_EVERY = 10.0

#: m from all waypoints beyond which a measured current says nothing of theirs.
_FAR = 100_000.0

#: State of a vehicle that was sent nothing.
_NOT_STARTED = "the vehicle was not started"


class _SafeEnd(Exception):
    """The mission cannot go on; the message says why."""


class _Left(_SafeEnd):
    """Somebody else has ended it; the vehicle is theirs."""


@dataclass(frozen=True)
class _Next:
    """A plan that waits to be handed over.

    Attributes:
        upload: of it.
        prospect: that it is from.
        kept: legs that it has in common with the plan before; they must not be over when it is handed over.
        cause: why it was made.
        begins: s of mission time that it is to be started at; infinite where it joins what is under way.
        sent: what of it was uploaded, without what was completed before, or None.
        known: the step that the vehicle was on its way to then.
    """

    upload: Upload
    prospect: Prospect
    kept: int
    cause: str
    begins: float = math.inf
    sent: Upload | None = None
    known: int = 0


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
    return _Executor(plan, link, limits or Limits(), notices or AllNotices(), tell, keep).run()


class _Executor:
    def __init__(
        self, plan: RollingPlan, link: VehicleLink, limits: Limits, notices: Notices, tell: Tell, keep: Keep
    ) -> None:
        self._plan, self._link, self._limits, self._notices = plan, link, limits, notices
        self._tell, self._keep, run = tell, keep, plan.run
        of = run.scenario, run.folder, run.seed, link.name, run.t_available
        self._record = ExecutionRecord(*of, reason=UNDER_WAY)
        self._count = 0  # legs that are done
        self._phase = Phase.READY
        self._new: _Next | None = None
        self._due = ""  # why the rest is to be re-planned
        self._turns = ""  # why its leg is to be left
        # Legs that were done, s that it was late, and s when the mission was to end, when the rest was last
        # re-planned for its times; 0 before that on each leg.
        self._settled = -1, 0.0, 0.0
        self._tries: Counter[str] = Counter()  # answers in a row, by kind, to what did not go away
        self._spent = ""  # what was answered too often
        self._failed = -math.inf  # s, when something failed that is tried again later
        self._looked = -math.inf  # s, when the track ahead was last looked at
        self._blocked = False  # whether an obstacle was on it
        self._aside = False  # whether it has left its plan to give way to one
        self._cost = 0.0  # s of mission time that re-planning takes
        self._end: Report | None = None  # that the vehicle, or somebody else, has ended the mission
        self._measured = -math.inf  # s, when the rest was last re-planned for a current
        # s and [3] m, when and where the vehicle was last seen.
        self._sight: tuple[float, Array] | None = None

    def run(self) -> ExecutionRecord:
        """Execute the mission, and bring the vehicle to a safe end where it cannot go on."""
        record = self._record
        try:
            try:
                self._depart()
                self._follow()
            except _Left as error:
                record.reason, record.safe = str(error), "left to whoever stopped it"
                self._watch_rise()
            except (_SafeEnd, LinkError, ExportError) as error:
                self._end_safely(str(error))
            except Exception as error:  # a vehicle is under way: whatever is wrong here, it is brought up
                _log.exception("the executor failed")
                self._end_safely(one_line(f"the executor failed: {type(error).__name__}: {error}"))
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

    @property
    def _now(self) -> float:
        return self._link.now

    @property
    def _started(self) -> bool:
        return self._phase is not Phase.READY

    @property
    def _silent(self) -> bool:
        return self._record.count("lost") > self._record.count("heard")

    @property
    def _place(self) -> Array:
        """Where the vehicle was last seen, [3] m."""
        assert self._sight is not None
        return self._sight[1]

    def _say(self, kind: str, text: str) -> None:
        event, record = Event(round(self._now, 1), kind, text), self._record
        record.events.append(event)
        self._tell(event)
        if self._started:
            record.planned = [self._leg_name(leg) for leg in self._plan.legs]
            self._keep(record)

    def _leg_name(self, leg: LegRecord) -> str:
        run = self._plan.run
        return f"{run.called(leg.start)} - {run.called(leg.goal)}"

    def _depart(self) -> None:
        """Plan, find the vehicle, upload, start."""
        if not self._plan.plan(self._link.allowance):
            raise _SafeEnd(f"no plan: {self._plan.reason}")
        plan = self._plan.followed
        whole = Upload(self._plan.itinerary(plan, 0))
        for node, why in self._plan.left_out.items():
            self._say("note", f"{self._plan.run.called(node)} is left out: {why}")
        legs, available = counted(len(plan.legs), "leg"), self._record.t_available
        self._say("plan", f"planned: {legs}, {plan.ends:.0f} s of {available:.0f} s")
        notes = self._link.connect()
        self._say("connected", f"connected to {self._link.name}")
        for note in notes:
            self._say("note", note)
        report, first = self._link.report(0.0), whole.steps[0]
        if report.state is State.EXECUTING:
            raise _SafeEnd("the vehicle executes a plan already: end that first")
        if report.state is State.FAULT:
            raise _SafeEnd(_state_in_words(report))
        gap = np.zeros(3) if report.position is None else report.position - first.position
        if (away := float(np.linalg.norm(gap))) > self._limits.away:
            raise _SafeEnd(f"the vehicle is {away:,.0f} m from the mission's start")
        away = float(np.linalg.norm(gap[:2])) / first.speed  # its way down is in the allowance
        if away > _LATE and self._plan.plan(self._link.allowance, away):
            plan = self._plan.followed
            whole = Upload(self._plan.itinerary(plan, 0))
            self._say("plan", f"the vehicle is {away:.0f} s from the start: planned end {plan.ends:.0f} s")
        self._progress = Progress(whole)
        self._see(self._link.report(0.0))
        self._new = _Next(whole, plan, 0, "start")
        self._upload()
        self._start()

    def _follow(self) -> None:
        """Look at the vehicle until it is at the destination, and do what is decided at each look."""
        report = self._look(self._limits.look)
        while True:
            decision = decide(self._facts(report))
            if decision.act is Act.ARRIVE:
                self._phase = after(self._phase, decision.act)
                return self._arrive()
            if decision.act in (Act.LEAVE, Act.SURFACE):
                raise (_Left if decision.act is Act.LEAVE else _SafeEnd)(decision.why)
            if decision.act is not Act.GO_ON:
                _DO[decision.act](self, decision)
            # What was done took time, in which the vehicle may have done something else.
            report = self._look(self._limits.look if decision.act is Act.GO_ON else 0.0)

    def _look(self, seconds: float) -> Report:
        """Return the newest report after some seconds; an end that was reported once holds from then on."""
        report = self._link.report(seconds)
        if self._end is None and report.state in (State.FAULT, State.SURFACING, State.STOPPED):
            self._end = report
        return report

    def _facts(self, report: Report) -> Facts:
        """Take in a report, and what was reported from outside; return what is known now."""
        self._book(report)
        if self._count >= len(self._plan.legs):
            return Facts(self._phase, arrived=True)
        if self._new is None or not self._new.sent:  # what is uploaded is started before anything else
            self._hear()
        now, progress, new, place = self._now, self._progress, self._new, report.position
        heard, idle = self._reached(report), report.state is State.IDLE
        stuck = astray = hazard = approached = ""
        if heard and place is not None and not idle and self._is_blocked(place):
            if self._phase is Phase.HELD or progress.at_task(place):
                approached = "an obstacle comes to where it stays"
            else:
                hazard = "an obstacle is in the way of the present leg"
        if heard and self._phase is Phase.UNDER_WAY:
            assert place is not None
            if still := progress.still(report, now, self._limits):
                where = f"{report.state.value}, {report.message}" if report.message else report.state.value
                stuck = f"no way made for {still:.0f} s ({where})"
            if not idle:
                off = progress.drift(place, now, self._limits)
                astray = f"{off:.0f} m off its track" if off else ""
                progress.time_pace(place, now - report.heard * self._link.rate)
                if not self._due and new is None:
                    self._due = self._off_its_times(place, now)
        end = "" if self._end is None else _state_in_words(self._end)
        taken = self._end is not None and self._end.state is State.STOPPED
        return Facts(
            self._phase,
            taken=end if taken else "",
            given_up=end or self._spent,
            overdue=self._overdue(),
            heard=heard,
            idle=idle,
            stuck=stuck,
            astray=astray,
            hazard=hazard,
            approached=approached,
            turns=self._turns,
            due=self._due,
            waiting=Waiting.NONE if new is None else Waiting.UPLOADED if new.sent else Waiting.MADE,
            missed="" if new is None else self._missed(new),
            busy=self._is_at_task(place),
            resting=now - self._failed < _PAUSE,
        )

    def _off_its_times(self, place: Array, now: float) -> str:
        """Return why the rest is to be re-planned for its times, "late" or "early", or an empty string.

        The vehicle, at [3] m, is off its plan, or will come too late if it goes on as it does.
        """
        late, limit = self._progress.late(place, now) or 0.0, max(self._limits.late, self._plan.tolerance)
        ends = _delays(self._plan.legs[self._count :], now, late, self._progress.slower)[-1].done
        count, known, foreseen = self._settled
        off = abs(late - known) if count == self._count else abs(late)
        known_late = foreseen > self._record.t_available  # and nothing was found against it
        too_late = ends > self._record.t_available and not (known_late and ends - foreseen <= _SOONER)
        if off <= limit and not too_late:
            return ""
        self._settled = self._count, late, ends
        return "late" if too_late or late > 0.0 else "early"

    def _missed(self, new: _Next) -> str:
        """Return why a plan cannot be begun any more, or an empty string."""
        held = self._phase is Phase.HELD
        if self._count > new.kept or (self._count == new.kept and not held and not new.sent):
            return "the vehicle is past the leg that the new plan begins with"
        late = held and not new.sent and self._now - new.begins > _LATE
        return "the new plan was to be begun before" if late else ""

    def _is_at_task(self, place: Array | None) -> bool:
        """Return whether the vehicle, at [3] m, is at a task, or would be before a plan is handed over."""
        progress = self._progress
        if place is None or progress.over or progress.leaves_task(place):
            return True
        near, step = 10.0 + 3.0 * self._limits.reply * self._link.rate, progress.step
        return step.hold > 0.0 and float(np.linalg.norm(step.position - place)) / step.pace < near

    def _is_blocked(self, place: Array) -> bool:
        """Return whether the vehicle meets an obstacle within the next minutes, seen now and then."""
        now, circles = self._now, self._progress.off_task(place, self._now)
        if now - self._looked >= (_EVERY if self._phase is Phase.UNDER_WAY else self._limits.astray):
            self._looked = now
            # By then a held vehicle has a plan, or this is looked at again.
            until = self._cost + 2.0 * self._limits.astray
            stopped = self._phase is Phase.HELD and not self._aside
            track, seconds = staying(place, until) if stopped else self._progress.track_ahead(place, now)
            room = 0.5 * self._plan.margin + (0.0 if stopped else circles)
            self._blocked = self._plan.clearance(track, now + seconds) < room
        return self._blocked

    def _book(self, report: Report) -> None:
        """Keep where the vehicle is, and the steps that it has completed and can have completed."""
        progress, track = self._progress, self._record.track
        self._see(report)
        if report.position is not None:
            north, east, depth = (round(float(part), 2) for part in report.position)
            if not track or track[-1][1:] != (north, east, depth):
                track.append((round(self._now, 1), north, east, depth))
        for step in progress.complete(report.done, self._now):
            if self._aside:
                continue  # this is no step of the mission's
            self._tries.clear()
            if not step.ends_leg:
                continue
            for number, leg in list(enumerate(self._plan.legs))[self._count : step.leg]:
                self._record.route.append(self._plan.run.called(leg.goal))
                if leg.priority > 0.0:
                    self._record.tasks.append(self._leg_name(leg))
                    self._record.total_priority += leg.priority
                task = ", task done" if leg.priority > 0.0 else ""
                # What the vehicle waits for the next leg is part of its stay as well.
                ended = self._now - sum(after.t_hold for after in self._plan.legs[number + 1 : number + 2])
                off = f"{round(ended - leg.ends):+d} s off the plan"
                self._say("leg", f"reached {self._plan.run.place(leg.goal)}{task}, {off}")
                self._plan.ended(number, ended)
            self._count, self._looked = max(self._count, step.leg), -math.inf  # looks at the next leg at once
            self._turns, self._settled = "", (self._count, 0.0, 0.0)
        if self._link.by_legs and report.position is not None:
            progress.pass_corners(report.position)

    def _see(self, report: Report) -> None:
        """Take note of where the vehicle is and can have been since it was last seen."""
        if report.position is None or report.heard > self._limits.silence:
            return
        now = self._now - report.heard * self._link.rate
        before, place = self._sight or (now, report.position)
        self._progress.see(place, report.position, now - before, self._limits.corridor)
        self._sight = now, report.position

    def _hear(self) -> None:
        """Take in what is reported from outside."""
        reported: list[str] = []
        for notice in self._notices.read():
            if isinstance(notice, str):
                self._say("note", notice)
            elif isinstance(notice, ObstacleNotice):
                obstacle = notice.obstacle
                self._plan.add_obstacle(obstacle.after(-self._now))
                self._say("reported", f"obstacle {obstacle.name}, radius {obstacle.radius:.0f} m")
                self._looked = -math.inf
                reported.append(obstacle.name)
            elif isinstance(notice, GoneNotice):
                there = self._plan.remove_obstacle(notice.name)
                end = "is gone" if there else "is reported gone, but was never reported"
                self._say("reported" if there else "note", f"obstacle {notice.name} {end}")
                self._looked = -math.inf
            else:
                self._hear_current(notice)
        if reported:
            self._tries["hazard"] = self._tries["no plan"] = 0  # what is in the way now is something else
            names = reported[0] if len(reported) == 1 else counted(len(reported), "obstacle")
            for leg in self._plan.legs[self._count + 1 :]:
                if self._plan.clearance(leg.positions, leg.times) < self._plan.margin:
                    self._due, self._new = "hazard", None
                    self._say("hazard", f"in the way of leg {self._leg_name(leg)}: {names}")
                    return

    def _hear_current(self, notice: CurrentNotice) -> None:
        """Take in a current that was measured."""
        place = self._link.report(0.0).position if notice.position is None else notice.position
        if place is None:
            self._say("note", "a current was reported before the vehicle's place is known: left out")
            return
        away = np.linalg.norm(np.asarray(self._plan.run.graph.positions) - place, axis=1).min()
        if away > _FAR:
            self._say("note", f"a current was reported {away / 1000.0:,.0f} km from the mission: left out")
            return
        found = self._plan.correct_current(notice.velocity, place, self._now)
        if found is None:
            self._say("note", "a current was reported where there is no forecast: left out")
            return
        words = ", ".join(f"{part:+.2f}" for part in found.offset)
        which = f"member {found.member}, {found.weight:.0%} probable," if found.member else "the forecast"
        self._say("reported", f"current: {which} is off by {words} m/s north, east, down")
        if self._now - self._measured >= _PAUSE:
            self._due, self._new, self._measured = "current", None, self._now

    def _overdue(self) -> str:
        """Say when the time available is over; return that the vehicle is overdue some time after."""
        available = self._record.t_available
        if self._now > available and not self._record.count("over"):
            self._say("over", f"the time available, {available:.0f} s, is over, and the vehicle is under way")
        if self._now <= available + self._limits.overdue:
            return ""
        return ("the link is lost and " if self._silent else "") + "the vehicle is overdue"

    def _reached(self, report: Report) -> bool:
        """Return whether the vehicle and its place are heard of; without a link it goes on with its plan."""
        heard = report.heard <= self._limits.silence
        if heard and report.position is not None:
            if self._silent:
                self._progress.since, self._progress.astray = self._now, math.inf
                self._say("heard", "the link is there again")
            return True
        if not self._silent:
            what = f"nothing heard for {report.heard:.0f} s" if not heard else "its place is not known"
            self._say("lost", f"{what}: {self._goes_on if heard else self._left_alone}")
        return False

    @property
    def _goes_on(self) -> str:
        upload = self._progress.upload
        last = f"whose last item is to {upload.itinerary.end}"
        return f"the vehicle goes on with upload {upload.number}, {last}"

    @property
    def _left_alone(self) -> str:
        """What the vehicle does when nobody talks to it, in words."""
        alone = self._link.left_alone
        return f"by its own settings {alone}" if alone else self._goes_on

    def _try(self, kind: str, text: str) -> bool:
        """Count an answer to what went wrong; return whether there were not too many of its kind in a row."""
        self._tries[kind] += 1
        if self._tries[kind] > self._limits.tries:
            self._spent = f"{text.split(':')[0]}, after {self._limits.tries} tries"
            return False
        self._say(kind, text)
        return True

    def _asked(self, call: Callable[[], None]) -> bool:
        """Ask the vehicle for something; return whether it does it. What fails is tried again later."""
        try:
            call()
        except LinkError as error:
            self._say("failed", str(error))
            self._failed = self._now
            return False
        return True

    def _hand_over(self, decision: Decision) -> None:
        """Upload the plan that waits, or start it."""
        if not self._asked(self._upload if decision.act is Act.UPLOAD else self._start):
            self._try("failed", "the new plan was not taken: sent again")

    def _restart(self, decision: Decision) -> None:
        """Hand over what the vehicle should have, as it may have lost it, and start it where it was."""
        progress = self._progress

        def again() -> None:
            self._link.upload(progress.upload)
            self._link.start(progress.ahead)

        if self._try("stopped", f"{decision.why}: started again") and self._asked(again):
            self._failed = self._now  # it gets under way before the rest is re-planned for its times
        progress.since = self._now

    def _hold(self, decision: Decision) -> None:
        """Hold the vehicle where it is, until there is a plan from there."""
        new, cause, why = self._new, decision.rule, decision.why
        if new is not None and new.sent:
            cause = new.cause
            self._say("replan", f"{why}: it is held")
            self._new = replace(new, sent=None)
        elif not self._try(cause, f"{why}: the vehicle is held, and the way from there re-planned"):
            return
        if self._asked(self._link.hold):
            self._phase, self._new, self._due = after(self._phase, Act.HOLD), None, cause
            self._turns = ""
            self._failed = self._looked = -math.inf
            self._blocked = False

    def _give_way(self, decision: Decision) -> None:
        """Have the vehicle go aside, to wait for a plan from there; a task under way is begun again."""
        self._blocked, before, why = False, self._progress.upload, decision.why
        leg = self._plan.aside(self._count, self._place, self._now)
        if leg is None:
            text = f"{why}: no place near is better, and it stays"
            if self._record.events[-1].text != text:
                self._say("hazard", text)
            return
        gap = float(np.linalg.norm(leg.positions[-1] - leg.positions[0]))
        if self._try("give way", f"{why}: it goes {gap:.0f} m aside"):
            upload = Upload(replace(before.itinerary, legs=(leg,)), before.number + 1).without(1)
            self._new = _Next(upload, self._plan.followed, self._count, "give way")
            if self._asked(self._upload) and self._asked(self._start):
                self._phase, self._aside, self._due = after(self._phase, Act.GIVE_WAY), True, "hazard"
                self._looked = self._failed = self._now  # it gets away before there is a plan from there
            else:
                self._new = None  # no later plan of the mission's; whether to give way is looked at again

    def _drop(self, _: Decision) -> None:
        """Drop the plan that waits; another one is due for the same cause."""
        assert self._new is not None
        if self._phase is not Phase.HELD:
            self._say("replan", "the new plan came too late for its first leg")
        self._new, self._due = None, self._new.cause

    def _upload(self) -> None:
        """Upload the plan that waits, without what the vehicle has completed of it."""
        new, before = self._new, self._progress
        assert new is not None
        fresh = new.upload if before.upload is new.upload else new.upload.without(before.passed(new.upload))
        known = before.ahead
        for note in self._link.upload(fresh):
            self._say("note", note)
        self._new = replace(new, sent=fresh, known=known)

    def _start(self) -> None:
        """Start what was uploaded, at the step that the vehicle has come to meanwhile.

        Where that fails the plan is to be uploaded again.
        """
        new, before = self._new, self._progress
        assert new is not None
        assert new.sent is not None
        self._new = replace(new, sent=None)
        more = min(before.ahead - new.known, len(new.sent.steps) - 1)
        if not self._started:  # it may have started, whatever comes back
            self._phase = after(self._phase, Act.START)
            self._record.route.append(self._plan.run.called(self._plan.run.start))
        self._link.start(more)
        self._phase = after(self._phase, Act.START)
        self._aside, begun = False, None if self._sight is None else self._sight[1]
        pace = new.prospect.states[-1].pace
        self._progress = Progress(new.sent, more, more, more, since=self._now, begun=begun, counted=pace)
        self._progress.stay_on(before)
        self._plan.followed = new.prospect
        self._new, self._due, self._looked, self._blocked = None, "", -math.inf, False
        self._turns = ""
        self._settled = self._count, 0.0, new.prospect.ends
        steps = [[*map(float, step.position.round(3)), step.hold] for step in new.sent.steps]
        number, when = new.upload.number, round(self._now, 1)
        self._record.uploads.append({"number": number, "cause": new.cause, "time": when, "steps": steps})
        self._say("upload", f"upload {number} ({new.cause}): {counted(len(new.sent.steps), 'waypoint')}")

    def _plan_leg(self, decision: Decision) -> None:
        """Plan from where the vehicle holds, for when it can be started, twice where that is missed."""
        cause, again = decision.why, self._tries["no plan"] + 1 < self._limits.tries
        self._plan.patience = again * (_PAUSE + _LATE)
        for _ in range(2):
            asked, self._plan.pace = self._now, self._progress.pace.share
            begins = asked + self._cost
            found = self._plan.from_position(self._count, self._place, begins)
            self._cost = self._now - asked
            if found is None or self._now - begins <= _LATE:
                break
        if found is None:
            self._failed = self._now
            self._try("no plan", f"no plan from here: {self._plan.reason}; the vehicle holds")
            return
        upload = Upload(self._plan.itinerary(found, self._count), self._progress.upload.number + 1)
        self._new = _Next(upload, found, self._count, cause, begins)
        legs = counted(len(found.legs) - self._count, "leg")
        self._say("replan", f"{cause}, from {begins:.0f} s: {legs}, {_ending(found)}")

    def _plan_rest(self, decision: Decision) -> None:
        """Re-plan what comes after the leg that the vehicle will be on by then."""
        cause, legs, progress, begin = decision.why, self._plan.legs, self._progress, self._now
        late, self._plan.pace = progress.late(self._place, begin) or 0.0, progress.pace.share
        delays = dict(enumerate(_delays(legs[self._count :], begin, late, progress.slower), self._count))
        kept = self._count + 1
        while kept < len(legs) and delays[kept - 1].done < begin + self._cost:
            kept += 1
        found, reason, ends = None, "no leg after the present one", delays[len(legs) - 1].done
        if kept < len(legs):
            found = self._plan.from_leg(kept, delays[kept - 1].done, late=True)
            reason = self._plan.reason
        in_time = found is not None and self._plan.in_time(found)
        if not in_time and ends > self._record.t_available:
            moment = self._now + self._cost
            if self._plan.leave_leg(self._count, self._place, moment) is not None:
                self._due, self._turns = "", f"{cause}: the rest of its leg cannot be in time"
                return
            in_time = found is not None and found.ends < ends - _SOONER  # or less late at least
        if found is None or not in_time:
            self._due = ""
            self._say("no plan", f"no better plan ({cause}): {reason}; it goes on as uploaded")
            return
        present = progress.upload.without(progress.ahead)
        staying = []
        for leg in (leg for leg in present.itinerary.legs if leg.number <= kept):
            delay = delays[leg.number - 1]
            times, corners = delay(leg.times), delay(leg.kept_times)
            staying.append(replace(leg, times=times, kept_times=corners, pace=leg.pace / delay.slower))
        rest, first = self._plan.itinerary(found, kept), present.steps[0]
        origin = first.left, float(delays[self._count](first.left_at))
        if progress.ahead == 0 and present.origin is None:  # it is on its way to the start
            origin = progress.line[0], first.left_at
        upload = Upload(replace(rest, legs=(*staying, *rest.legs)), progress.upload.number + 1, origin)
        for number in range(self._count, kept):
            found.legs[number] = replace(legs[number], times=delays[number](legs[number].times))
        self._new = _Next(upload, found, kept, cause)
        self._cost = self._now - begin
        count = counted(len(found.legs) - kept, "leg")
        self._say("replan", f"{cause}, {round(late):+d} s: {count} re-planned, {_ending(found)}")

    def _arrive(self) -> None:
        """Watch the end behaviour, and give the verdict."""
        record, end = self._record, self._progress.upload.itinerary.end
        arrived = self._now
        record.t_mission, record.success = arrived, arrived < record.t_available
        record.reason = "destination reached" + (" in time" if record.success else " too late")
        record.safe = f"the vehicle was not seen to {end} yet"
        while self._now - arrived < self._limits.ending:
            report = self._link.report(self._limits.look)
            self._book(report)
            if end != "surface":
                record.safe = f"at the end: {end}"
            if end != "surface" or self._is_up(report):
                return

    def _end_safely(self, why: str) -> None:
        """Have the vehicle surface, and see that it does; nothing that fails here is raised."""
        record = self._record
        record.reason = why
        if not self._started:
            record.safe = _NOT_STARTED
            return
        upload, end = self._progress.upload, self._progress.upload.itinerary.end
        record.safe = f"told to surface, not answered; upload {upload.number} ends with {end}"
        for attempt in range(self._limits.tries):
            try:
                if attempt:
                    self._link.report(_PAUSE)
                self._link.surface()
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
                report = self._link.report(self._limits.look)
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


def _state_in_words(report: Report) -> str:
    words = f": {report.message}" if report.message else ""
    return f"the vehicle is {report.state.value}{words}"


def _ending(found: Prospect) -> str:
    """Return when a plan ends, and at which pace, in words."""
    pace = found.states[-1].pace
    slow = f" at {pace:.0%} of the speed asked for" if pace < 1.0 else ""
    return f"planned end {found.ends:.0f} s{slow}"


@dataclass(frozen=True)
class _Delay:
    """When a vehicle that is late and slower than planned is at the places of a leg.

    Attributes:
        late: s, at `since`, s by the plan.
        since: s by the plan, from when on all takes `slower` times as long.
        slower: factor.
        done: s, when the leg and its task are done.
    """

    late: float
    since: float
    slower: float
    done: float

    def __call__(self, times: ArrayLike) -> Array:
        """Return s, when it does what was planned for s."""
        times = np.asarray(times, float)
        return times + self.late + (self.slower - 1.0) * (times - self.since)


def _delays(legs: Sequence[LegRecord], now: float, late: float, slower: float) -> list[_Delay]:
    """Return how late each of these legs is of a vehicle that is on the first of them."""
    found: list[_Delay] = []
    for leg in legs:
        planned = float(leg.times[-1])
        since = float(leg.times[0]) if found else min(now - late, planned)
        behind = late + (slower - 1.0) * (planned - since)
        made_up = min(leg.t_wait, max(behind, 0.0))
        found.append(_Delay(late, since, slower, planned + behind + leg.t_wait - made_up + leg.t_task))
        late = behind - made_up
    return found


#: What is done between two looks, by what was decided.
_DO = {
    Act.HOLD: _Executor._hold,
    Act.UPLOAD: _Executor._hand_over,
    Act.START: _Executor._hand_over,
    Act.GIVE_WAY: _Executor._give_way,
    Act.RESTART: _Executor._restart,
    Act.REPLAN_LEG: _Executor._plan_leg,
    Act.REPLAN_REST: _Executor._plan_rest,
    Act.DROP: _Executor._drop,
}
