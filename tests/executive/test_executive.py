"""The hierarchical loop on small missions: success, safety, determinism, one compilation, failures."""

import jax
import numpy as np
import pytest

import auvplan as ap
from auvplan.errors import ScenarioError
from auvplan.executive import execute_missions
from auvplan.io.area import load_area
from auvplan.runtime.compiled import compilations
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.waypoints import make_graph
from auvplan.simulation.simulator import TIME_STEP
from tests.executive.small import SMALL, planning, scenario

pytestmark = pytest.mark.usefixtures("light_search")


@pytest.fixture(scope="module")
def three(light_search):
    """Three missions with a light search, two of them in lockstep at a time."""
    found = dict(execute_missions(scenario(), seeds=range(3), together=2))
    return [found[number] for number in range(3)]


def test_missions_end_at_the_destination_in_time_and_unharmed(three):
    for run in three:
        assert run.success, run.reason
        assert run.legs[-1].goal == run.goal
        assert 0.0 < run.t_mission < run.t_available
        assert run.collisions == 0


def test_times_add_up_and_legs_connect(three):
    for run in three:
        assert run.t_mission == pytest.approx(sum(leg.t_path + leg.t_task for leg in run.done), abs=0.1)
        assert [leg.start for leg in run.done] == [run.start, *(leg.goal for leg in run.done[:-1])]
        clock = 0.0
        for leg in run.done:
            assert leg.times[0] == pytest.approx(clock, abs=0.1)
            assert (np.diff(leg.times) > 0).all()
            np.testing.assert_allclose(leg.positions[0], run.graph.positions[leg.start], atol=1.0)
            np.testing.assert_allclose(leg.positions[-1], run.graph.positions[leg.goal], atol=1.0)
            clock = leg.times[-1] + leg.t_task


def test_tracks_carry_the_motion_that_they_were_executed_at(three):
    for run in three:
        for leg in run.done:
            assert len(leg.motion) == len(leg.times)
            elapsed = np.diff(leg.times)[:, None]
            executed = np.diff(leg.positions, axis=0) / elapsed
            velocity = leg.motion.ground_velocity[:-1]
            # The tangent at a step's beginning against its chord: they differ by what it turns in a step.
            turn = float(run.vehicle.turn_rate_max) * TIME_STEP * np.linalg.norm(velocity, axis=1).max()
            np.testing.assert_allclose(velocity[:-1], executed[:-1], atol=turn)
            assert np.median(np.abs(velocity - executed)) < 0.02
        for plan in (plan for leg in run.done for plan in leg.plans):
            assert len(plan.motion) == len(plan.times) - 1
            # Peak currents of 0.8 of the vehicle's speed: no faster than both together.
            assert np.linalg.norm(plan.motion.ground_velocity, axis=1).max() < 1.8 * 2.5


def test_no_task_is_done_twice(three):
    for run in three:
        used = [frozenset((leg.start, leg.goal)) for leg in run.done]
        assert len(used) == len(set(used))


def test_paths_are_replanned_at_every_window(three):
    for run in three:
        for leg in run.done:
            causes = [plan.cause for plan in leg.plans]
            assert causes[0] == "leg"
            assert causes.count("window") <= 2
            for plan in leg.plans[1:]:
                place = [np.interp(plan.made_at, leg.times, leg.positions[:, k]) for k in range(3)]
                np.testing.assert_allclose(plan.positions[0], place, atol=1.0)


def test_a_mission_is_the_same_alone_and_later_ones_compile_nothing(three):
    """To the last bit, by its seed; nor does a scenario with other numbers of things compile any."""
    alone = ap.run_mission(scenario(), seed=1)
    compiled = compilations()
    larger = scenario(
        current=SMALL["current"] | {"vortices": 4},
        simulation={"obstacles": {"static": 2, "afloat": 1, "self_motivated": 1}},
        mission=SMALL["mission"] | {"waypoints": 11},
    )
    other = ap.run_mission(larger, seed=6)
    assert compilations() == compiled
    assert alone.seed == 1
    assert [leg.goal for leg in alone.done] == [leg.goal for leg in three[1].done]
    for mine, theirs in zip(alone.legs, three[1].legs, strict=True):
        np.testing.assert_array_equal(mine.positions, theirs.positions)
        np.testing.assert_array_equal(mine.times, theirs.times)
    assert len({other.t_mission, *(run.t_mission for run in three)}) == 4


def test_windows_plan_anew_always_never_or_where_the_sea_changed(three):
    def windows(run):
        assert run.success
        return sum(plan.cause == "window" for leg in run.legs for plan in leg.plans)

    every, none = (windows(ap.run_mission(planning(window_change=least), seed=1)) for least in (0.0, 1e6))
    assert every > windows(three[1]) >= none


def test_planning_time_is_charged_only_when_asked():
    charged = ap.run_mission(planning(charge_compute=True), key=jax.random.key(0))
    assert charged.charged_compute > 0.0
    total = sum(leg.t_path + leg.t_task for leg in charged.done) + charged.charged_compute
    assert charged.t_mission == pytest.approx(total, abs=0.1)


@pytest.mark.slow
def test_a_current_that_wins_ends_the_mission_with_its_reason():
    strong = SMALL["current"] | {"uniform": [-3.5, 0.0, 0.0]}
    run = ap.run_mission(scenario(current=strong), key=jax.random.key(0))
    assert not run.success
    assert "current" in run.reason
    assert "km" in run.reason


def test_too_little_time_is_reported_before_transit():
    run = ap.run_mission(scenario(mission=SMALL["mission"] | {"time_available": 60}), key=jax.random.key(0))
    assert not run.success
    assert not run.legs
    assert "time" in run.reason


def test_graph_keeps_to_the_water_and_is_connected():
    real = Scenario.model_validate({"mission": {"waypoints": 20}})
    area = load_area(real)
    graph, names = make_graph(real, area, np.random.default_rng(0))
    chart = area.chart
    assert names == []
    assert (np.asarray(chart.distance(*graph.positions[:, :2].T)) >= 149.0).all()
    for i, j in np.argwhere(graph.adjacency):
        share = np.linspace(0, 1, 50)[:, None]
        line = graph.positions[i] * (1 - share) + graph.positions[j] * share
        assert np.asarray(chart.is_water(line[:, 0], line[:, 1])).all()


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"mission": {"start": [8000.0, 6500.0, 10.0]}}, "land"),
        ({"area": {"lower": [0, 0, 0], "upper": [20000, 10000, 10]}}, "beyond the chart"),
        ({"mission": {"waypoint_clearance": 3000.0}}, "water|connected"),
    ],
)
def test_scenarios_that_cannot_be_built(sections, message):
    bad = Scenario.model_validate(sections)
    with pytest.raises(ScenarioError, match=message):
        ap.run_mission(bad, key=jax.random.key(0))
