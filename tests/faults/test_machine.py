"""Rules fired at random over a mission: whatever goes wrong, it stays safe and ends with a reason."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.executive.legs import finish
from auvplan.executive.loop import step
from auvplan.runtime.files import OutputError, ResultError
from auvplan.simulation.faults import (
    CurrentStep,
    HeldUp,
    Obstacle,
    PlannerOut,
    SensorOut,
    Slower,
    WrongForecast,
)
from benchmarks.collisions import collisions
from tests.faults.disk import full_disk
from tests.faults.sea import PLACES, begun, context, scenario

#: Looks that no mission of the small scenario needs: it lasts 2,400 s.
ENOUGH = 500

angles = st.floats(0.0, 2.0 * np.pi)
seconds = st.floats(30.0, 600.0)


def level(speed: float, angle: float) -> tuple[float, float]:
    return speed * np.cos(angle), speed * np.sin(angle)


class Executed(RuleBasedStateMachine):
    """One mission; rules inject a fault now, or let it go on for a few looks."""

    shared = None
    #: Whether these happened to a result of this machine: once is enough, they take long.
    cut_short = filled = False

    @initialize(seed=st.integers(0, 3))
    def begin(self, seed):
        if Executed.shared is None:
            Executed.shared = context(
                scenario(mission=scenario().mission.model_dump() | {"time_available": 2400})
            )
        self.mission = begun(Executed.shared, seed)
        self.legs_seen = 0

    def strike(self, fault):
        self.mission.faults.given.append(fault)

    def go_on(self):
        before = self.mission.now, len(self.mission.run.legs), self.mission.refusals
        step([self.mission])
        after = self.mission.now, len(self.mission.run.legs), self.mission.refusals
        assert self.mission.ended or after != before, "neither time nor mission went on"
        if len(self.mission.run.legs) > self.legs_seen:
            self.legs_seen = len(self.mission.run.legs)
            if self.mission.leg is not None:
                self.lateness_is_noticed()

    def lateness_is_noticed(self):
        """A leg is begun past the reserve only where the route was made knowing it, or none fits."""
        mission, rules = self.mission, Executed.shared.rules
        began = mission.active_leg.stretches[0][0][0]
        times, rest = mission.timed.leg_times(Executed.shared.speed), mission.rest
        left = mission.run.t_available - rules.reserve - (began + times[rest[:-1], rest[1:]].sum())
        replanned = mission.run.routes[-1].made_at >= began - 1e-6 or mission.no_route
        assert left >= -rules.tolerance - 1.0 or mission.slack < 0.0 or replanned

    @property
    def under_way(self):
        return not self.mission.ended

    @precondition(lambda self: self.under_way)
    @rule(looks=st.integers(1, 6))
    def goes_on(self, looks):
        for _ in range(looks):
            if self.under_way:
                self.go_on()

    # In all they and the vortices stay slower than the vehicle, which could not get out of a way otherwise.
    @precondition(lambda self: self.under_way and self.struck(CurrentStep) < 3)
    @rule(speed=st.floats(0.05, 0.4), angle=angles, known=st.booleans())
    def current_steps(self, speed, angle, known):
        self.strike(CurrentStep(self.mission.now, level(speed, angle), known))

    @precondition(lambda self: self.under_way and self.struck(WrongForecast) < 3)
    @rule(factor=st.sampled_from([-1.0, 0.0, 0.5, 2.0]))
    def forecast_is_wrong(self, factor):
        self.strike(WrongForecast(self.mission.now, factor))

    @precondition(lambda self: self.under_way and self.free_places)
    @rule(
        gap=st.one_of(st.floats(0.5, 5.0), st.floats(20.0, 300.0)),
        aside=st.floats(-20.0, 20.0),
        radius=st.floats(20.0, 60.0),
        speed=st.floats(0.0, 0.5),
        angle=angles,
    )
    def obstacle_appears(self, gap, aside, radius, speed, angle):
        ahead = float(np.sqrt((radius + gap) ** 2 - aside**2))
        self.strike(Obstacle(self.mission.now, ahead, aside, radius, level(speed, angle)))

    @property
    def free_places(self):
        return self.struck(Obstacle) < 2 * PLACES

    def struck(self, kind):
        """How often a fault of a kind struck this mission."""
        return sum(isinstance(fault, kind) for fault in self.mission.faults.given)

    @precondition(lambda self: self.under_way)
    @rule(kind=st.sampled_from([SensorOut, HeldUp, PlannerOut]), seconds=seconds)
    def something_is_out(self, kind, seconds):
        self.strike(kind(self.mission.now, seconds))

    @precondition(lambda self: self.under_way and self.mission.faults.speed(self.mission.now) > 0.6)
    @rule(factor=st.floats(0.6, 0.95))
    def vehicle_is_slower(self, factor):
        self.strike(Slower(self.mission.now, factor))

    @precondition(lambda self: not self.under_way)
    @rule(seed=st.integers(0, 3))
    def another_begins(self, seed):
        self.ended_well()
        self.begin(seed)

    @precondition(lambda self: not self.under_way and not self.cut_short)
    @rule(keep=st.floats(0.0, 0.99), name=st.sampled_from(["summary.json", "mission.nc"]))
    def saved_file_is_cut_short(self, keep, name):
        self.cut_short = True
        with TemporaryDirectory() as folder:
            ap.save_run(self.mission.run, folder)
            file = Path(folder) / name
            file.write_bytes(file.read_bytes()[: int(keep * file.stat().st_size)])
            with pytest.raises(ResultError) as stated:
                check_run(folder)
            assert str(file) in str(stated.value)
            assert "\n" not in str(stated.value)

    @precondition(lambda self: not self.under_way and not self.filled)
    @rule()
    def disk_is_full(self):
        self.filled = True
        with TemporaryDirectory() as folder:
            ap.save_run(self.mission.run, folder)
            before = {file.name: file.read_bytes() for file in Path(folder).iterdir()}
            with full_disk(), pytest.raises(OutputError) as stated:
                ap.save_run(self.mission.run, folder)
            assert "\n" not in str(stated.value)
            assert {file.name: file.read_bytes() for file in Path(folder).iterdir()} == before

    @invariant()
    def tasks_count_once(self):
        if not hasattr(self, "mission"):
            return
        earning = self.mission.run.earning
        assert len({frozenset((leg.start, leg.goal)) for leg in earning}) == len(earning)
        assert len({leg.goal for leg in earning}) == len(earning)
        priority = self.mission.run.graph.priority
        assert self.mission.run.total_priority == sum(priority[leg.start, leg.goal] for leg in earning)

    def teardown(self):
        if not hasattr(self, "mission"):
            return
        for _ in range(ENOUGH):
            if self.mission.ended:
                break
            self.go_on()
        self.ended_well()

    def ended_well(self):
        run = self.mission.run
        assert self.mission.ended
        assert run.reason
        assert "\n" not in run.reason
        assert run.success == (run.reason == "destination reached in time")
        assert not [str(hit) for hit in collisions(run, self.mission.faults.given) if hit.avoidable]


def test_a_slow_vehicle_gives_way_by_the_pace_that_it_makes():
    """At six tenths of its speed it met what moves on the first leg where it was foreseen at all of it."""
    mission = begun(context(scenario(mission=scenario().mission.model_dump() | {"time_available": 2400})), 1)
    steps = [CurrentStep(0.0, (0.05, 0.0), known=True)] * 2
    mission.faults.given += [*steps, Slower(0.0, 0.6)]
    while mission.now < 200.0:
        step([mission])
    finish(mission.active_leg)
    assert not collisions(mission.run, mission.faults.given)


def test_what_moves_away_is_not_run_into_by_a_forecast_that_is_far_off():
    """Twice the current was foreseen the other way: it went on at once, into the obstacle before it."""
    mission = begun(context(scenario(mission=scenario().mission.model_dump() | {"time_available": 2400})), 2)
    near = Obstacle(
        0.0, 36.97343683445647, -5.960504420105897, 35.0, level(0.49164255768045906, 2.423298111864592)
    )
    far = Obstacle(
        0.0, 244.75619628427822, -10.92723114296893, 50.0, level(0.35748191436528604, 1.1501492987859765)
    )
    beside = Obstacle(0.0, 66.88382879386779, 0.001, 46.88382880134344, level(0.5, 3.20845168794977))
    steps = [
        CurrentStep(0.0, level(0.09470381904585055, 1.11018220127437), known=True),
        CurrentStep(0.0, level(0.06485610692060467, 2.8696693569139393), known=True),
    ]
    wrong = [WrongForecast(0.0, 2.0), WrongForecast(0.0, -1.0)]
    mission.faults.given += [near, far, beside, *wrong, Slower(0.0, 0.6402927805430884), *steps]
    while mission.now < 200.0:
        step([mission])
    finish(mission.active_leg)
    assert not [str(hit) for hit in collisions(mission.run, mission.faults.given) if hit.avoidable]


def fired(examples: int, steps: int) -> None:
    checks = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
    run_state_machine_as_test(
        Executed,
        settings=settings(
            max_examples=examples, stateful_step_count=steps, deadline=None, suppress_health_check=checks,
            database=None, phases=[Phase.generate], derandomize=True,
        ),
    )  # fmt: skip


def test_200_steps():
    fired(4, 50)


@pytest.mark.slow
def test_10_000_steps():
    fired(200, 50)
