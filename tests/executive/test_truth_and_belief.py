"""The simulator's truth and what a vehicle believes of it."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.executive.belief import ObstacleBelief, as_obstacles
from auvplan.executive.context import make_context
from auvplan.executive.legs import ESCAPE_SPEED, escape_track
from auvplan.executive.loop import seed_keys, start_mission
from auvplan.ocean import CurrentUpdate, Seabed
from auvplan.path.motion import Motion
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.settings import SensorSettings
from auvplan.simulation.sea import VortexSea
from auvplan.simulation.simulator import TIME_STEP, Course, simulate
from auvplan.simulation.world import TrueObstacles, draw_obstacles
from tests.executive.small import SMALL, scenario


def uniform_field(u, v):
    empty = jnp.zeros((1, 0))
    return ap.LambVortices(jnp.zeros((1, 0, 2)), empty, empty, jnp.zeros(1), 0.0, jnp.array([u, v, 0.0]))


#: Steps of a simulation, which one program makes for all.
STEPS = 20
NONE = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)


def transit_one(field, track, moving=True, obstacles=NONE, arc=0.0):
    (out,) = simulate(
        [Course(track, arc, moving, 100.0, jax.device_get(field), obstacles)], ap.Vehicle(), 20, STEPS
    )
    return out


def track_of(length):
    return np.linspace([0.0, 0.0, 10.0], [length, 0.0, 10.0], 20)


@pytest.mark.parametrize(("stream", "speed"), [((0, 0), 2.5), ((0.5, 0), 3.0), ((0, 1.5), 2.0)])
def test_vehicle_holds_its_track_at_the_closed_form_speed(stream, speed):
    out = transit_one(uniform_field(*stream), track_of(600.0))
    after = TIME_STEP * np.arange(1, STEPS + 1)
    np.testing.assert_allclose(out.positions[:, 0], speed * after, rtol=1e-4)
    np.testing.assert_allclose(out.positions[:, 1:], [[0.0, 10.0]] * STEPS, atol=1e-3)
    np.testing.assert_allclose(out.water, [[*stream, 0.0]] * STEPS, atol=1e-5)
    np.testing.assert_allclose(out.ground, [[speed, 0.0, 0.0]] * STEPS, atol=1e-4)
    motion = Motion.through_water(out.ground, out.water)
    np.testing.assert_allclose(motion.yaw, -np.arcsin(stream[1] / 2.5), atol=1e-4)
    np.testing.assert_allclose(out.times, 100.0 + after)


def test_arrival_is_timed_within_the_step_and_time_then_stands_still():
    out = transit_one(uniform_field(0.0, 0.0), track_of(100.0))
    assert out.arrived
    assert out.times[-1] == pytest.approx(100.0 + 100.0 / 2.5, rel=1e-5)
    np.testing.assert_allclose(out.positions[-1], [100.0, 0.0, 10.0], atol=1e-3)


def test_a_vehicle_that_keeps_station_heads_into_the_current_and_lets_time_pass():
    out = transit_one(uniform_field(0.0, 1.5), track_of(600.0), moving=False, arc=30.0)
    assert not out.arrived
    np.testing.assert_array_equal(out.ground, 0.0)
    np.testing.assert_allclose(Motion.through_water(out.ground, out.water).yaw, -np.pi / 2)
    np.testing.assert_allclose(out.positions, np.tile([30.0, 0.0, 10.0], (STEPS, 1)), atol=1e-3)
    assert out.times[-1] == pytest.approx(100.0 + STEPS * TIME_STEP)


def test_obstacles_drift_as_their_kind_says():
    velocity = np.array([[0.0, 0, 0], [0, 0, 0], [0.0, 0.2, 0]])
    moving = np.zeros((3, 3)), velocity, np.array([0.0, 1.0, 1.0])
    out = transit_one(uniform_field(0.4, 0.0), track_of(600.0), obstacles=moving)
    np.testing.assert_allclose(out.obstacles[-1], [[0, 0, 0], [24.0, 0, 0], [24.0, 12.0, 0]], atol=1e-4)
    np.testing.assert_allclose(out.moves, [[0, 0, 0], [0.4, 0, 0], [0.4, 0.2, 0]], atol=1e-6)


def test_a_current_that_wins_is_reported():
    assert transit_one(uniform_field(-3.0, 0.0), track_of(600.0)).shortfall > 0.0
    assert transit_one(uniform_field(-1.0, 0.0), track_of(600.0)).shortfall == 0.0


def some_sea(interval=600.0, seed=0, error=0.05):
    field = ap.random_vortices(jax.random.key(seed), (0, 0, 0), (3000, 3000, 0), count=3)
    return VortexSea(jax.random.key(10 + seed), field, CurrentUpdate(), interval, error)


@pytest.mark.usefixtures("light_search")
def test_a_path_is_planned_anew_in_the_current_as_it_is_then():
    """The current changes at every look."""
    changing = {"vortices": 3, "layers": 1, "radius": [300, 600], "peak_speed": 0.8, "update_interval": 30}
    settings = scenario(current=changing, planning=SMALL["planning"] | {"window_change": 0})
    run = ap.run_mission(settings, seed=0)
    later = [plan for leg in run.legs for plan in leg.plans if plan.cause != "leg"]
    assert later
    sea = start_mission(make_context(settings), 0, seed_keys([0])[0], 0).sea
    for plan in later:
        sea.advance(plan.made_at)
        np.testing.assert_array_equal(plan.current.centers, sea.field.centers)


def test_current_updates_come_on_time():
    sea = some_sea()
    before = sea.field.centers
    sea.advance(599.0)
    np.testing.assert_array_equal(sea.field.centers, before)
    sea.advance(600.0)
    assert (sea.field.centers != before).any()


def test_the_current_does_not_depend_on_when_it_was_looked_at():
    often, once = some_sea(), some_sea()
    for now in np.arange(0.0, 1900.0, 100.0):
        often.advance(now)
    once.advance(1800.0)
    np.testing.assert_array_equal(often.field.centers, once.field.centers)
    np.testing.assert_array_equal(often.field.strength, once.field.strength)


def test_telling_errs_by_the_asked_amount_and_anew_every_time():
    sea = some_sea()
    stated, again = sea.forecast(), sea.forecast()
    there = sea.field.strength != 0.0
    error = stated.strength[there] / sea.field.strength[there] - 1.0
    assert 0.0 < np.abs(error).max() < 0.3
    assert (stated.strength != again.strength).any()
    exact = some_sea(error=0.0)
    np.testing.assert_array_equal(exact.forecast().strength, exact.field.strength)


def some_truth():
    return TrueObstacles(
        np.array([[100.0, 0, 0], [5000.0, 0, 0]]),
        np.zeros((2, 3)),
        np.array([1.0, 0.0]),
        np.array([20.0, 30.0]),
        ["afloat", "static"],
    )


def test_sensing_sharpens_only_what_is_in_range():
    sensors = SensorSettings(range=500.0, prior_std=15.0, position_std=1.0)
    moves = np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 0.0]])
    belief = ObstacleBelief(some_truth(), moves, 0.0, sensors, np.random.default_rng(0))
    np.testing.assert_array_equal(belief.std, [15.0, 15.0])
    belief.look(np.zeros(3), some_truth(), moves, 60.0)
    np.testing.assert_array_equal(belief.std, [1.0, 15.0])
    np.testing.assert_array_equal(belief.observed_at, [60.0, 0.0])
    assert np.linalg.norm(belief.position[0] - [100.0, 0, 0]) < 6.0
    np.testing.assert_array_equal(belief.velocity[1], 0.0)  # what stands is known to stand


def test_planner_and_belief_see_the_same_boundary():
    sensors = SensorSettings(growth=0.2, growth_max=25.0)
    belief = ObstacleBelief(some_truth(), np.zeros((2, 3)), 10.0, sensors, np.random.default_rng(1))
    seen = jax.tree.map(lambda a: a[0], as_obstacles([belief], sensors))
    for t in (10.0, 50.0, 1e4):
        place = belief.position[0] + belief.velocity[0] * (t - 10.0)
        inside = belief.clearance(place[None], np.array([t]))[0]
        assert -inside == pytest.approx(float(seen.boundary(jnp.asarray(t))[0]), rel=1e-4)


def test_a_boundary_between_two_places_of_a_path_is_met():
    """A sphere of 40 m crosses half way between places that are 120 m apart, none of which is near it."""
    sensors = SensorSettings(prior_std=0.0, velocity_std=0.0, growth=0.1, growth_max=20.0)
    moves = np.array([[0.0, -1.0, 0.0]])
    truth = TrueObstacles(
        np.array([[180.0, 90.0, 10.0]]), moves, np.ones(1), np.array([40.0]), ["self-motivated"]
    )
    belief = ObstacleBelief(truth, moves, 0.0, sensors, np.random.default_rng(0))
    times = 60.0 * np.arange(4)
    track = np.stack([2.0 * times, 0.0 * times, 0.0 * times + 10.0], axis=1)
    assert min(belief.clearance(track[k][None], times[k][None])[0] for k in range(4)) > 10.0
    fine = np.linspace(0.0, times[-1], 20_001)
    places = np.stack([np.interp(fine, times, axis) for axis in track.T], axis=1)
    for k, found in enumerate(belief.clearance(track, times)[:-1]):
        within = (fine >= times[k]) & (fine <= times[k + 1])
        each = [belief.clearance(places[j][None], fine[j][None])[0] for j in np.flatnonzero(within)[::20]]
        assert found == pytest.approx(min(each), abs=0.5)
    assert belief.clearance(track, times).min() < -30.0


def open_water(seabed=None):
    """What an escape counts on: a vehicle of 2.5 m/s in a box of 20 km, without a coast."""
    area, config = SimpleNamespace(chart=None, seabed=seabed), SimpleNamespace(samples=10)
    return SimpleNamespace(area=area, box=(np.full(3, -1e4), np.full(3, 1e4)), speed=2.5, path_config=config)


def test_escape_goes_away_from_what_comes():
    sensors = SensorSettings(prior_std=0.0, velocity_std=0.0)
    truth = TrueObstacles(
        np.array([[60.0, 0, 0]]), np.array([[-1.0, 0, 0]]), np.ones(1), np.array([40.0]), ["self-motivated"]
    )
    belief = ObstacleBelief(truth, np.array([[-1.0, 0, 0]]), 0.0, sensors, np.random.default_rng(0))
    track = escape_track(open_water(), np.zeros(3), 0.0, 30.0, belief.clearance, ESCAPE_SPEED * 2.5)
    assert track is not None
    assert track[-1, 0] < 0
    # Where the sea bed rises behind the vehicle it gives way to another side.
    depth = np.full((200, 200), 100.0)
    depth[:99] = 2.0
    bed = Seabed.from_depth(depth, 10.0, (-1000.0, -1000.0))
    aside = escape_track(open_water(bed), np.zeros(3), 0.0, 30.0, belief.clearance, ESCAPE_SPEED * 2.5)
    assert aside is None or (bed.altitude(aside) >= 5.0).all()
    far = escape_track(open_water(), np.array([-5e3, 0, 0]), 0.0, 30.0, belief.clearance, ESCAPE_SPEED * 2.5)
    assert far is None or np.linalg.norm(far[-1] - [-5e3, 0, 0]) <= 0.4 * 2.5 * 30 + 1e-6


def test_obstacles_are_drawn_between_the_waypoints_and_off_them():
    scenario = Scenario.model_validate(
        {"simulation": {"obstacles": {"static": 10, "afloat": 10, "self_motivated": 10}}}
    )
    start, goal = np.array([0.0, 0, 50]), np.array([3000.0, 0, 50])
    drawn = draw_obstacles(scenario, start, goal, np.random.default_rng(0))
    near = drawn.position[:, 0] < 1e5
    assert near.sum() > 20
    assert (drawn.position[near, 0] > 0).all()
    assert (drawn.position[near, 0] < 3000).all()
    assert (np.linalg.norm(drawn.position - start, axis=1) > drawn.radius + 149).all()
    assert np.std(drawn.position[near, 1]) < 12.0  # sigma^2 is about the radius
    assert {kind: drawn.kinds.count(kind) for kind in drawn.kinds} == dict.fromkeys(
        ("static", "afloat", "self-motivated"), 10
    )
    speeds = np.linalg.norm(drawn.velocity, axis=1)
    np.testing.assert_allclose(speeds[-10:], 0.3)
    np.testing.assert_array_equal(speeds[:20], 0.0)
