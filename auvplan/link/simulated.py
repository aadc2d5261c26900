"""The simulator as a vehicle: it executes uploads among the true obstacles and currents of a scenario."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from auvplan.executive.context import Leg, Stretch, make_context
from auvplan.executive.legs import encounter, finish, let_appear, look
from auvplan.executive.loop import start_mission
from auvplan.link.notices import CurrentNotice, GoneNotice, Notice, ObstacleNotice
from auvplan.link.vehicle import Lost, Report, State, Step, Upload, VehicleLink
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.obstacles import CONFIDENCE
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime import prng
from auvplan.runtime.arrays import Array
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.simulation.faults import (
    CurrentStep,
    Fault,
    GivesUp,
    HeldUp,
    LinkOut,
    Restarts,
    SensorOut,
    TakenOver,
    WrongForecast,
)
from auvplan.simulation.simulator import TIME_STEP, Course, over_ground, simulate
from auvplan.simulation.world import KNOWN, TrueObstacles

#: m/s at which the vehicle comes up when it surfaces.
_RISE = 0.5

#: What a vehicle says from the moment at which it strikes.
_STATES = {GivesUp: State.FAULT, TakenOver: State.STOPPED, Restarts: State.IDLE}


class SimulatedVehicle(VehicleLink):
    """A vehicle in the simulator; its time passes in `report` alone, and stands while the executor plans.

    It meets the true current, which differs from the forecast as the scenario has it, and on each leg the
    obstacles that `auvplan mission` draws for one, which are gone when it is over. What its sensor makes of
    them it reports itself: it is a source of notices too.
    """

    name = "the simulator"

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        folder: str | Path | None = None,
        area: OperatingArea | None = None,
        scale: float | None = None,
        faults: Sequence[Fault] = (),
    ) -> None:
        """Start at the mission's start, at rest.

        Args:
            scenario, seed, folder, area: as for `run_mission`.
            scale: s of mission time in one of wall-clock time; as fast as it goes if absent.
            faults: what goes wrong on purpose; those of the planner are not the vehicle's.

        Raises:
            ScenarioError, ChartError, GeoError, CurrentError: the scenario cannot be built.
        """
        self._context = make_context(scenario, folder, area)
        self._context.faults = [faults]
        self._mission = start_mission(self._context, 0, prng.of_seeds([seed])[0], seed)
        self._faults, self._scale = self._mission.faults, scale
        ends = (fault.at + getattr(fault, "seconds", 0.0) for fault in faults)
        self._changes = sorted({*(fault.at for fault in faults), *ends})
        self._steps = max(1, round(scenario.sensors.interval / TIME_STEP))
        self._place = np.asarray(self._mission.graph.positions[self._mission.here], float)
        self._uploaded: Upload | None = None
        self._plan: Upload | None = None
        self._done = 0
        self._state = State.IDLE
        self._stays = 0.0  # s that are left of a hold
        # Times, places, and whether the stretch's end is a goal.
        self._ahead: tuple[Array, Array, bool] | None = None
        self._heard, self._report = 0.0, Report()  # s, when it was heard of last, and what
        self._legs: dict[int, Leg] = {}  # that were begun, by number; 0 before the first
        self._look = 0.0  # s, when the sensor looks next
        self._seen: dict[int, KnownObstacle] = {}  # what was reported on this leg, by row
        self._gone: list[str] = []  # names of what was reported on those before
        self._measured = 1  # legs, when the current was measured last
        self._begin(0, self._place)

    @property
    def now(self) -> float:
        """Return s of mission time."""
        return self._mission.now

    def upload(self, plan: Upload) -> list[str]:
        """Take a plan."""
        self._hear()
        self._uploaded = plan
        return []

    def start(self, step: int = 0) -> None:
        """Execute the last upload from a step on."""
        self._do(State.EXECUTING)
        self._plan, self._done, self._stays = self._uploaded, step, 0.0

    def hold(self) -> None:
        """Stay where it is."""
        self._do(State.HOLDING)

    def surface(self) -> None:
        """Surface."""
        self._do(State.SURFACING)

    def report(self, seconds: float) -> Report:
        """Let `seconds` pass."""
        if self._scale:
            time.sleep(seconds / self._scale)
        before, begin = self._place, self.now
        end = self.now + seconds
        while self.now < end:
            self._strike()
            self._move(min([end, *(at for at in self._changes if at > self.now)]))
        if self._is_silent:
            return replace(self._report, heard=self.now - self._heard)
        speed = float(np.linalg.norm(self._place - before)) / (self.now - begin) if seconds else math.nan
        self._heard, self._report = self.now, Report(0.0, self._place, speed, self._state, self._done)
        return self._report

    def read(self) -> Iterator[Notice]:
        """Yield obstacles that its sensor sees where none was expected, and currents.

        Where there are several forecasts, it measures the current at the beginning of every leg.
        """
        now, sensors = self.now, self._context.scenario.sensors
        if self._is_silent:
            return
        while self._gone:
            yield GoneNotice(self._gone.pop())
        if self._context.area.members and len(self._legs) > self._measured:
            self._measured = len(self._legs)
            yield CurrentNotice(self._moves()[-1])
        for fault in self._faults.due(CurrentStep, now):
            if fault.known:
                yield CurrentNotice(self._moves()[-1])
        for wrong in self._faults.due(WrongForecast, now):
            yield CurrentNotice(wrong.factor * self._moves()[-1])
        if now < self._look or self._faults.left(SensorOut, now) > 0.0:
            return
        self._look = now + sensors.interval
        margin, belief = CONFIDENCE * np.sqrt(2.0) * sensors.position_std, self._leg.belief
        grown = min(sensors.growth * sensors.interval, sensors.growth_max)  # until it is looked at again
        for row in map(int, np.flatnonzero(look(self._mission) & belief.unknown)):
            place, known = belief.position[row], self._seen.get(row)
            if known is None or np.linalg.norm(known.after(now).position - place[:2]) > margin:
                (north, east, depth), velocity = place.tolist(), belief.velocity[row].tolist()
                radius = float(belief.radius[row]) + margin + grown
                found = KnownObstacle(
                    f"sighting {len(self._legs) - 1}.{row}",
                    (north, east),
                    radius,
                    depth - radius,
                    depth + radius,
                    (velocity[0], velocity[1]),
                )
                self._seen[row] = found.after(-now)
                yield ObstacleNotice(found)

    def record(self) -> MissionRun:
        """Return what it did until now as a mission, of the legs that it began."""
        begun = [leg for number, leg in self._legs.items() if number]
        for leg in begun:
            finish(leg)
        return replace(self._mission.run, legs=[leg.record for leg in begun])

    @property
    def _leg(self) -> Leg:
        return self._mission.active_leg

    @property
    def _is_silent(self) -> bool:
        return self._faults.left(LinkOut, self.now) > 0.0

    def _hear(self) -> None:
        """Hear what is asked, or not."""
        if self._is_silent:
            raise Lost("the vehicle does not answer")

    def _do(self, state: State) -> None:
        """Begin to do what is asked."""
        self._hear()
        self._state, self._ahead = state, None

    def _strike(self) -> None:
        """Let happen what is due."""
        for kind, state in _STATES.items():
            if self._faults.due(kind, self.now):
                self._state, self._ahead = state, None
        if self._state is State.EXECUTING and self._stays <= 0.0 and self._plan is not None:
            let_appear(self._mission, self._plan.steps[self._done].position - self._place)

    def _move(self, end: float) -> None:
        """Pass time up to `end`, or up to the end of what the vehicle does now."""
        plan = self._plan
        over = self._state is State.FINISHED and plan is not None and plan.itinerary.end == "surface"
        if over or self._state in (State.SURFACING, State.FAULT):
            depth = max(self._place[2] - _RISE * (end - self.now), 0.0)
            return self._pass(end, np.asarray([*self._place[:2], depth]))
        if self._state is not State.EXECUTING or plan is None or self._faults.left(HeldUp, self.now):
            self._ahead = None
            return self._pass(end, self._place)
        if self._stays > 0.0:
            passed = min(self._stays, end - self.now)
            self._stays -= passed
            self._pass(self.now + passed, self._place)
            if self._stays <= 0.0:
                self._complete()
            return None
        if self._ahead is None:
            self._ahead = self._stretch(plan.steps[self._done])
        times, places, arrives = self._ahead
        until = min(end, float(times[-1]))
        self._pass(until, np.asarray([np.interp(until, times, axis) for axis in places.T]))
        if until in self._changes:
            self._ahead = None
        if until == times[-1]:
            self._ahead = None
            if arrives:
                self._stays = plan.steps[self._done].hold
                if self._stays <= 0.0:
                    self._complete()

    def _pass(self, until: float, place: Array) -> None:
        """Pass time, in which the vehicle goes straight to a place, and obstacles go on."""
        seconds, leg = until - self.now, self._leg
        if seconds > 0.0:
            *moves, water = self._moves()
            leg.moves = np.reshape(moves, (-1, 3))
            leg.truth.position = leg.truth.position + seconds * leg.moves
            ground = (place - self._place) / seconds
            step = [until], place[None], leg.truth.position[None], ground[None], water[None]
            leg.stretches.append(Stretch(*(np.array(part) for part in step)))
        self._mission.now, self._place = until, place

    def _moves(self) -> Array:
        """Return velocities over ground of the leg's obstacles, and last the water's here, [M + 1, 3] m/s."""
        here = TrueObstacles(self._place[None], np.zeros((1, 3)), np.ones(1), np.ones(1), [KNOWN])
        self._mission.sea.advance(self.now)
        return over_ground(self._mission.sea.field, *(self._leg.truth + here).motion, now=self.now)

    def _complete(self) -> None:
        """Go on to the next step, or to the end behaviour."""
        assert self._plan is not None
        self._done += 1
        if self._done == len(self._plan.steps):
            self._state = State.FINISHED

    def _begin(self, number: int, target: Array) -> None:
        """Begin a leg to a place, [3] m, where it was not begun before: what the last one had is gone."""
        if number in self._legs:
            return
        encounter(self._mission, LegRecord(0, 0, 0.0, 0.0, 0.0), self._place, target)
        self._legs[number] = self._leg
        self._leg.set_off(self.now)
        self._gone += [known.name for known in self._seen.values()]
        self._seen = {}

    def _stretch(self, step: Step) -> tuple[Array, Array, bool]:
        """Simulate a look's time on the straight way to a step: times, places, and whether it is reached."""
        assert self._plan is not None
        self._begin(step.leg, next(end.position for end in reversed(self._plan.steps) if end.leg == step.leg))
        if np.linalg.norm(step.position - self._place) < 1e-3:
            return np.asarray([self.now, self.now]), np.stack([self._place, step.position]), True
        self._mission.sea.advance(self.now)
        context, now, field = self._context, self.now, self._mission.sea.field
        samples = context.path_config.samples
        track = self._place + np.linspace(0.0, 1.0, samples)[:, None] * (step.position - self._place)
        none = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)  # what moves there is moved by `_pass`
        share = self._faults.speed(now) * (step.speed / self._plan.itinerary.speed)
        course = Course(track, 0.0, True, now, field, none, share)
        (out,) = simulate([course], context.vehicle, samples, self._steps)
        times = np.concatenate([[now], np.asarray(out.times, float)])
        places = np.concatenate([self._place[None], np.asarray(out.positions, float)])
        fresh = np.concatenate([[True], np.diff(times) > 0.0])
        return times[fresh], places[fresh], bool(out.arrived)
