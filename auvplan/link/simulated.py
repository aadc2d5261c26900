"""The simulator as a vehicle: it executes uploads in the true current of a scenario and a seed."""

import math
import time
from pathlib import Path

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.executive.loop import make_context, start_mission
from auvplan.link.limits import Allowance
from auvplan.link.vehicle import Report, State, Step, Upload
from auvplan.runtime import prng
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.simulation.sea import stacked
from auvplan.simulation.simulator import TIME_STEP, WIDTH, padded_rows, transit

Array = NDArray[np.floating]

#: m/s at which the vehicle comes up when it surfaces.
_RISE = 0.5


class SimulatedVehicle:
    """A vehicle in the simulator; its time passes in `wait` alone.

    It meets the true current, which differs from the forecast as the scenario has it. The obstacles that
    `auvplan mission` draws are not there: hazards are given from outside.
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
    ) -> None:
        """Start at the mission's start, at rest.

        Args:
            scenario, seed, folder, area: as for `run_mission`.
            scale: s of mission time in one of wall-clock time; as fast as it goes if absent.

        Raises:
            ScenarioError, ChartError, GeoError, CurrentError: the scenario cannot be built.
        """
        self._context = make_context(scenario, folder, area)
        mission = start_mission(self._context, 0, prng.of_seeds([seed])[0], seed)
        self._sea, self._scale = mission.sea, scale
        self._steps = max(1, round(scenario.sensors.interval / TIME_STEP))
        self._now = 0.0
        self._place = np.asarray(mission.graph.positions[mission.here], float)
        self._uploaded: Upload | None = None
        self._plan: Upload | None = None
        self._done = 0
        self._state = State.IDLE
        self._stays = 0.0  # s that are left of a hold
        self._ahead: tuple[Array, Array, bool] | None = (
            None  # times, places, whether the stretch's end is a goal
        )

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
        self._uploaded = plan
        return []

    def start(self, step: int = 0) -> None:
        """Execute the last upload from a step on."""
        self._plan, self._done, self._state = self._uploaded, step, State.EXECUTING
        self._ahead, self._stays = None, 0.0

    def hold(self) -> None:
        """Stay where it is."""
        self._state, self._ahead = State.HOLDING, None

    def surface(self) -> None:
        """Surface."""
        self._state, self._ahead = State.SURFACING, None

    def close(self) -> None:
        """Do nothing."""

    def wait(self, seconds: float) -> Report:
        """Let `seconds` pass."""
        if self._scale:
            time.sleep(seconds / self._scale)
        before, begin = self._place, self._now
        end = self._now + seconds
        while self._now < end:
            self._move(end)
        speed = float(np.linalg.norm(self._place - before)) / (self._now - begin) if seconds else math.nan
        return Report(0.0, self._place, speed, self._state, self._done)

    def _move(self, end: float) -> None:
        """Pass time up to `end`, or up to the end of what the vehicle does now."""
        if self._state is State.SURFACING:
            depth = max(self._place[2] - _RISE * (end - self._now), 0.0)
            self._place = np.asarray([*self._place[:2], depth])
        if self._state is not State.EXECUTING or self._plan is None:
            self._now = end
            return
        if self._stays > 0.0:
            passed = min(self._stays, end - self._now)
            self._now, self._stays = self._now + passed, self._stays - passed
            if self._stays <= 0.0:
                self._complete()
            return
        if self._ahead is None:
            self._ahead = self._stretch(self._plan.steps[self._done])
        times, places, arrives = self._ahead
        until = min(end, float(times[-1]))
        self._place = np.asarray([np.interp(until, times, axis) for axis in places.T])
        self._now = until
        if until == times[-1]:
            self._ahead = None
            if arrives:
                self._stays = self._plan.steps[self._done].hold
                if self._stays <= 0.0:
                    self._complete()

    def _complete(self) -> None:
        """Go on to the next step, or to the end behaviour."""
        assert self._plan is not None
        self._done += 1
        if self._done == len(self._plan.steps):
            self._state = State.FINISHED
            if self._plan.itinerary.end == "surface":
                self._place = np.asarray([*self._place[:2], 0.0])

    def _stretch(self, step: Step) -> tuple[Array, Array, bool]:
        """Simulate a look's time on the straight way to a step: times, places, and whether it is reached."""
        if np.linalg.norm(step.position - self._place) < 1e-3:
            return np.asarray([self._now, self._now]), np.stack([self._place, step.position]), True
        self._sea.advance(self._now)
        share = np.linspace(0.0, 1.0, self._context.path_config.samples)[:, None]
        track = self._place + share * (step.position - self._place)
        none = [padded_rows(np.zeros(shape)) for shape in ((0, 3), (0, 3), (0,))]
        rows = {"track": track, "arc": 0.0, "moving": True, "now": self._now}
        batch = [np.stack([np.asarray(value)] * WIDTH) for value in rows.values()]
        fields = stacked([self._sea.field] * WIDTH)
        obstacles = tuple(np.stack([part] * WIDTH) for part in none)
        out = jax.device_get(transit(*batch, fields, obstacles, self._context.vehicle, steps=self._steps))  # type: ignore[arg-type]
        times = np.concatenate([[self._now], np.asarray(out.times[0], float)])
        places = np.concatenate([self._place[None], np.asarray(out.positions[0], float)])
        fresh = np.concatenate([[True], np.diff(times) > 0.0])
        return times[fresh], places[fresh], bool(out.arrived[0])
