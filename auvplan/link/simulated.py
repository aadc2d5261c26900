"""The simulator as a vehicle: it executes uploads among the true obstacles and currents of a scenario."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.executive.loop import make_context, start_mission
from auvplan.link.limits import Allowance
from auvplan.link.notices import CurrentNotice, GoneNotice, Notice, ObstacleNotice
from auvplan.link.vehicle import Lost, Report, State, Step, Upload
from auvplan.mission.travel_times import ONE_PLACE
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.obstacles import CONFIDENCE
from auvplan.path.motion import Motion
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime import prng
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.simulation.faults import (
    FAR_BELOW,
    CurrentStep,
    Fault,
    GivesUp,
    HeldUp,
    LinkOut,
    Obstacle,
    Restarts,
    SensorOut,
    TakenOver,
    WrongForecast,
    absent,
    appear,
)
from auvplan.simulation.sea import stacked
from auvplan.simulation.simulator import TIME_STEP, WIDTH, over_ground, padded_rows, transit
from auvplan.simulation.world import KNOWN, TrueObstacles, draw_obstacles

Array = NDArray[np.floating]

#: m/s at which the vehicle comes up when it surfaces.
_RISE = 0.5

#: m, how far away obstacles are that are gone.
_GONE = 1e6

#: What a vehicle says from the moment at which it strikes.
_STATES = {GivesUp: State.FAULT, TakenOver: State.STOPPED, Restarts: State.IDLE}


class SimulatedVehicle:
    """A vehicle in the simulator; its time passes in `report` alone.

    It meets the true current, which differs from the forecast as the scenario has it, and on each leg the
    obstacles that `auvplan mission` draws for one, which are gone when it is over. What its sensor makes of
    them it reports itself: it is a source of notices too.
    """

    name = "the simulator"
    by_legs = False
    left_alone, allowance = "", Allowance()

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
        self._sea, self._faults, self._scale = self._mission.sea, self._mission.faults, scale
        ends = (fault.at + getattr(fault, "seconds", 0.0) for fault in faults)
        self._changes = sorted({*(fault.at for fault in faults), *ends})
        self._steps = max(1, round(scenario.sensors.interval / TIME_STEP))
        self._now = 0.0
        self._place = np.asarray(self._mission.graph.positions[self._mission.here], float)
        self._uploaded: Upload | None = None
        self._plan: Upload | None = None
        self._done = 0
        self._state = State.IDLE
        self._stays = 0.0  # s that are left of a hold
        self._ahead: tuple[Array, Array, bool] | None = (
            None  # times, places, whether the stretch's end is a goal
        )
        self._heard, self._report = 0.0, Report()  # s, when it was heard of last, and what
        self._legs: set[int] = set()  # numbers of the legs that were begun
        self._truth = TrueObstacles.known(self._context.known_obstacles(0.0)) + absent(self._faults.places)
        self._look = 0.0  # s, when the sensor looks next
        self._seen: dict[int, KnownObstacle] = {}  # what was reported, by its row
        self._gone: list[int] = []  # of it, what is gone meanwhile
        # Times, places [3] m, obstacles [M, 3] m, velocities over ground and of the water until then [3] m/s.
        still = np.zeros(3)
        self._trace: list[tuple[float, Array, Array, Array, Array]] = [
            (0.0, self._place, self._truth.position.copy(), still, still)
        ]

    @property
    def now(self) -> float:
        """Return s of mission time."""
        return self._now

    @property
    def rate(self) -> float:
        """Return 0: time stands still while the executor plans."""
        return 0.0

    def connect(self) -> list[str]:
        """Do nothing: it is there."""
        return []

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

    def close(self) -> None:
        """Do nothing."""

    def report(self, seconds: float) -> Report:
        """Let `seconds` pass."""
        if self._scale:
            time.sleep(seconds / self._scale)
        before, begin = self._place, self._now
        end = self._now + seconds
        while self._now < end:
            self._strike()
            self._move(min([end, *(at for at in self._changes if at > self._now)]))
        if self._is_silent:
            return replace(self._report, heard=self._now - self._heard)
        speed = float(np.linalg.norm(self._place - before)) / (self._now - begin) if seconds else math.nan
        self._heard, self._report = self._now, Report(0.0, self._place, speed, self._state, self._done)
        return self._report

    def read(self) -> Iterator[Notice]:
        """Yield the obstacles that its sensor sees anew or elsewhere, and the currents that are forecast."""
        now, sensors = self._now, self._context.scenario.sensors
        if self._is_silent:
            return
        while self._gone:
            yield GoneNotice(self._seen.pop(self._gone.pop()).name)
        for fault in self._faults.due(CurrentStep, now):
            if fault.known:
                yield CurrentNotice(self._drift()[-1])
        for wrong in self._faults.due(WrongForecast, now):
            yield CurrentNotice(wrong.factor * self._drift()[-1])
        if now < self._look or self._faults.left(SensorOut, now) > 0.0:
            return
        self._look = now + sensors.interval
        away, rng = np.linalg.norm(self._truth.position - self._place, axis=1), self._mission.rng
        margin, moves = CONFIDENCE * np.sqrt(2.0) * sensors.position_std, self._drift()
        for row in map(int, np.flatnonzero(away - self._truth.radius <= sensors.range)):
            if self._truth.kinds[row] == KNOWN:
                continue
            errors, drifts = rng.normal(size=6), self._truth.drift[row] > 0.0
            place = self._truth.position[row] + sensors.position_std * errors[:3]
            radius = max(self._truth.radius[row] + sensors.position_std * errors[3], 1.0) + margin
            velocity = (moves[row, :2] + sensors.velocity_std * errors[4:]).tolist() if drifts else (0.0, 0.0)
            known = self._seen.get(row)
            if known is None or np.linalg.norm(known.after(now).position - place[:2]) > margin:
                north, east, depth = place.tolist()
                span = depth - radius, depth + radius
                found = KnownObstacle(
                    f"sighting {row}", (north, east), radius, *span, (velocity[0], velocity[1])
                )
                self._seen[row] = found.after(-now)
                yield ObstacleNotice(found)

    def record(self) -> MissionRun:
        """Return what it did until now as a mission of one leg."""
        times, places, obstacles, ground, water = zip(*self._trace, strict=True)
        traced = [self._trace[-1][2]]
        for part in obstacles[-2::-1]:  # what was not there yet was far below where it came
            later = traced[-1][len(part) :]
            traced.append(np.concatenate([part, np.c_[later[:, :2], np.full(len(later), FAR_BELOW)]]))
        leg = LegRecord(
            self._mission.run.start,
            self._mission.run.goal,
            0.0,
            0.0,
            0.0,
            times=np.asarray(times),
            positions=np.stack(places),
            motion=Motion.through_water(*(np.stack([*part[1:], part[-1]]) for part in (ground, water))),
            obstacle_positions=np.stack(traced[::-1]),
            obstacle_radii=self._truth.radius,
            obstacle_kinds=self._truth.kinds,
        )
        return replace(self._mission.run, legs=[leg])

    @property
    def _is_silent(self) -> bool:
        return self._faults.left(LinkOut, self._now) > 0.0

    def _hear(self) -> None:
        """Hear what is asked.

        Raises:
            Lost: it does not.
        """
        if self._is_silent:
            raise Lost("the vehicle does not answer")

    def _do(self, state: State) -> None:
        """Begin to do what is asked."""
        self._hear()
        self._state, self._ahead = state, None

    def _strike(self) -> None:
        """Let happen what is due."""
        for kind, state in _STATES.items():
            if self._faults.due(kind, self._now):
                self._state, self._ahead = state, None
        if self._state is State.EXECUTING and self._stays <= 0.0 and self._plan is not None:
            way = self._plan.steps[self._done].position - self._place
            for fault in self._faults.due(Obstacle, self._now):
                appear(fault, self._truth, [row[2][None] for row in self._trace], self._place, way)

    def _move(self, end: float) -> None:
        """Pass time up to `end`, or up to the end of what the vehicle does now."""
        if self._state in (State.SURFACING, State.FAULT):
            depth = max(self._place[2] - _RISE * (end - self._now), 0.0)
            return self._pass(end, np.asarray([*self._place[:2], depth]))
        if self._state is not State.EXECUTING or self._plan is None or self._faults.left(HeldUp, self._now):
            self._ahead = None
            return self._pass(end, self._place)
        if self._stays > 0.0:
            passed = min(self._stays, end - self._now)
            self._stays -= passed
            self._pass(self._now + passed, self._place)
            if self._stays <= 0.0:
                self._complete()
            return None
        if self._ahead is None:
            self._ahead = self._stretch(self._plan.steps[self._done])
        times, places, arrives = self._ahead
        until = min(end, float(times[-1]))
        self._pass(until, np.asarray([np.interp(until, times, axis) for axis in places.T]))
        if until in self._changes:
            self._ahead = None
        if until == times[-1]:
            self._ahead = None
            if arrives:
                self._stays = self._plan.steps[self._done].hold
                if self._stays <= 0.0:
                    self._complete()

    def _pass(self, until: float, place: Array) -> None:
        """Pass time, in which the vehicle goes straight to a place, and obstacles go on."""
        seconds = until - self._now
        if seconds > 0.0:
            moves, ground = self._drift(), (place - self._place) / seconds
            self._truth.position = self._truth.position + seconds * moves[:-1]
            self._trace.append((until, place, self._truth.position.copy(), ground, moves[-1]))
        self._now, self._place = until, place

    def _drift(self) -> Array:
        """Return velocities over ground [M + 1, 3] m/s of the obstacles, and last that of the water here."""
        here = TrueObstacles(self._place[None], np.zeros((1, 3)), np.ones(1), np.ones(1), [KNOWN])
        motion = (self._truth + here).motion
        there = np.abs(motion[0]).max(axis=1) < 0.5 * _GONE  # the others stay where they are
        self._sea.advance(self._now)
        moves = np.zeros(motion[0].shape)
        moves[there] = over_ground(self._sea.field, *(part[there] for part in motion), now=self._now)
        return moves

    def _complete(self) -> None:
        """Go on to the next step, or to the end behaviour."""
        assert self._plan is not None
        self._done += 1
        if self._done == len(self._plan.steps):
            self._state = State.FINISHED
            if self._plan.itinerary.end == "surface":
                self._place = np.asarray([*self._place[:2], 0.0])

    def _begin(self, leg: int) -> None:
        """Draw what is met on a leg of a number that was not begun before; what the last one had is gone."""
        assert self._plan is not None
        if leg in self._legs:
            return
        self._legs.add(leg)
        # What is gone went straight away, and meets nothing on its way.
        over = (self._truth.position[:, 2] < 0.5 * FAR_BELOW) & (np.asarray(self._truth.kinds) != KNOWN)
        away = self._truth.position[over, :2] - self._place[:2]
        self._truth.position[over, :2] += _GONE * away / np.linalg.norm(away, axis=1)[:, None].clip(1e-9)
        self._gone = list(self._seen)
        target = next(step.position for step in reversed(self._plan.steps) if step.leg == leg)
        if float(np.linalg.norm(target - self._place)) > ONE_PLACE:
            self._truth += draw_obstacles(self._context.scenario, self._place, target, self._mission.rng)

    def _stretch(self, step: Step) -> tuple[Array, Array, bool]:
        """Simulate a look's time on the straight way to a step: times, places, and whether it is reached."""
        self._begin(step.leg)
        if np.linalg.norm(step.position - self._place) < 1e-3:
            return np.asarray([self._now, self._now]), np.stack([self._place, step.position]), True
        self._sea.advance(self._now)
        parts = np.linspace(0.0, 1.0, self._context.path_config.samples)[:, None]
        track = self._place + parts * (step.position - self._place)
        none = [padded_rows(np.zeros(shape)) for shape in ((0, 3), (0, 3), (0,))]
        rows = {"track": track, "arc": 0.0, "moving": True, "now": self._now}
        batch = [np.stack([np.asarray(value)] * WIDTH) for value in rows.values()]
        fields = stacked([self._sea.field] * WIDTH)
        obstacles = tuple(np.stack([part] * WIDTH) for part in none)
        share = np.full(WIDTH, self._faults.speed(self._now))
        out = jax.device_get(
            transit(*batch, fields, obstacles, self._context.vehicle, share, steps=self._steps)  # type: ignore[arg-type]
        )
        times = np.concatenate([[self._now], np.asarray(out.times[0], float)])
        places = np.concatenate([self._place[None], np.asarray(out.positions[0], float)])
        fresh = np.concatenate([[True], np.diff(times) > 0.0])
        return times[fresh], places[fresh], bool(out.arrived[0])
