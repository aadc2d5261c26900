"""Depths along a path against closed forms, a plain programme and the limits of the vehicle."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.mission.travel_times import TravelTimeConfig, Trips, travel_times
from auvplan.ocean.currents import SumCurrent, varies_in_space, varies_with_depth
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.path.profile import levels, profiles
from auvplan.path.stages import Batch, Legs, split
from tests.path.kernels import Layers, leg

WAY, SPEED = 4000.0, 1.5
UNLIMITED = ap.Vehicle(
    SPEED, surge_max=50.0, sway_max=50.0, pitch_max=0.5 * np.pi, depth_toll=np.float64(0.0)
)
#: Of what is planned here, plans with the same settings share compiled programs.
LIGHT = ap.PathConfig.quick().replace(finer=1, refine_steps=0)
#: Half the vehicle's speed against it above 40 m, with it below.
TWO_LAYERS = Layers.of(-0.8, 1.6, 40.0, 3.0)
LAYERED = ap.LambVortices(np.zeros((2, 1, 2)), np.zeros((2, 1)), np.ones((2, 1)), [20.0, 60.0])


def gridded(levels):
    """A current of a file that has so many levels."""
    values = np.random.default_rng(0).uniform(size=(1, levels, 4, 4))
    return GriddedCurrent.from_arrays(values, values, spacing=1000.0, depths=10.0 * np.arange(levels))


def sea(current=TWO_LAYERS, obstacles=None, bottom=100.0):
    return ap.Environment(
        current, obstacles=obstacles, lower=(-1000, -2000, 0), upper=(WAY + 1000, 2000, bottom)
    )


timed_levels = jax.jit(levels, static_argnums=3)
quickest = jax.jit(profiles, static_argnums=(3, 4))


def straight_profile(env, depth=10.0, vehicle=UNLIMITED):
    """Depths at 17 stations, 250 m apart."""
    x = np.linspace(0.0, WAY, 17)[None]
    ends = np.array([0.0, 0.0, depth]), np.array([WAY, 0.0, depth])
    return np.asarray(quickest(x, 0.0 * x, leg(*ends, env, 0.0, vehicle), ap.PathConfig(), 8))[0]


@pytest.mark.parametrize(
    ("current", "with_depth", "in_space"),
    [
        (ap.UniformCurrent(0.5, 0.1), False, False),
        (lambda x, y, z, t: (0.4, 0.2 * (t > 600), 0.0), False, False),
        (lambda x, y, z, t: (0.4, y * 1e-4, 0.01 * z), False, True),
        (jax.jit(lambda x, y, z, t: (0.4, x * 1e-4, 0.01 * z)), False, True),
        (jax.jit(lambda x, y, z, t: (0.4, z * 1e-4, 0.0 * x)), True, True),
        (TWO_LAYERS, True, True),
        (gridded(1), False, True),
        (gridded(2), True, True),
        (SumCurrent(ap.UniformCurrent(0.2), ap.UniformCurrent(0.1)), False, False),
        (SumCurrent(gridded(1), ap.UniformCurrent(0.1)), False, True),
        (SumCurrent(gridded(1), LAYERED), True, True),
        (LAYERED, True, True),
        (
            LAYERED.__class__(*(part[:1] for part in (LAYERED.centers, LAYERED.strength, LAYERED.radius))),
            False,
            True,
        ),
    ],
)
def test_currents_that_depend_on_the_place_are_told_from_others(current, with_depth, in_space):
    env = ap.Environment(current, lower=(0, 0, 0), upper=(1, 1, 1))
    assert varies_with_depth(env.current) is with_depth
    assert varies_in_space(env.current) is in_space


def test_levels_rise_and_lie_where_the_current_changes():
    places = (np.zeros(3, np.float32),) * 3
    found = np.asarray(timed_levels(places, 0.0, 100.0, 20, TWO_LAYERS))
    assert (np.diff(found) > 0.0).all()
    assert found[[0, -1]] == pytest.approx([0.0, 100.0])
    assert ((found > 30.0) & (found < 50.0)).sum() >= 10
    still = ap.Environment(None, lower=(0, 0, 0), upper=(1, 1, 1)).current
    evenly = np.asarray(timed_levels(places, 0.0, 100.0, 20, still))
    np.testing.assert_allclose(evenly, np.linspace(0.0, 100.0, 20), atol=1e-3)


@pytest.mark.slow
def test_the_quicker_layer_is_taken_where_nothing_bounds_the_depth():
    env = ap.Environment(TWO_LAYERS)
    found = straight_profile(env)
    assert np.isfinite(found).all()
    assert 45.0 < np.median(found) < 200.0
    ends = (0, 0, 10), (WAY, 0, 10)
    plan = ap.plan_path(*ends, env, UNLIMITED, key=jax.random.key(0), config=LIGHT)
    assert plan.feasible
    assert plan.travel_time < WAY / 2.0


def plan_of(vehicle, env, goal_depth=60.0):
    """A plan at a depth that is given: no passages are looked for."""
    given = {"key": jax.random.key(0), "config": LIGHT.replace(passages=0)}
    return ap.plan_path((0, 0, 10), (WAY, 0, goal_depth), env, vehicle, **given)


def from_half_way(plan):
    """The plan of the rest of the way."""
    half, given = len(plan.times) // 2, plan.conditions
    where = plan.positions[half], float(plan.times[half]), given.env, given.vehicle
    return ap.replan_path(plan, *where, key=jax.random.key(0), config=given.config)


@cache
def in_two_layers():
    ends = (0, 0, 10), (WAY, 0, 10)
    return ap.plan_path(*ends, sea(), UNLIMITED, key=jax.random.key(0), config=LIGHT)


def test_a_transit_depth_is_kept_between_the_ends_whatever_the_current():
    vehicle = ap.Vehicle(SPEED, transit_depth=30.0)
    whole = plan_of(vehicle, sea())
    for plan in (whole, from_half_way(whole)):
        assert plan.feasible, plan.reason
        assert plan.positions[-1, 2] == pytest.approx(60.0, abs=0.1)
        assert np.median(plan.positions[:, 2]) == pytest.approx(30.0, abs=0.1)
        assert np.degrees(np.abs(plan.pitch)).max() < 30.0
    shallower = plan_of(vehicle, sea(bottom=25.0), goal_depth=10.0)
    assert shallower.positions[:, 2].max() == pytest.approx(25.0, abs=0.1)


@pytest.mark.slow
def test_a_transit_altitude_follows_the_terrain_and_climbs_before_a_bank():
    x = np.arange(-500.0, 5500.0, 50.0)
    bed = ap.Seabed.from_depth(
        np.repeat((100.0 - 60.0 * np.exp(-(((x - 2000.0) / 300.0) ** 2)))[:, None], 80, 1),
        50.0,
        (-500, -2000),
        clearance=5.0,
    )
    env = ap.Environment(
        ap.UniformCurrent(0.3, 0.2), seabed=bed, lower=(-500, -2000, 0), upper=(5500, 2000, 120)
    )
    plan = plan_of(ap.Vehicle(SPEED, transit_altitude=15.0), env)
    assert plan.feasible
    assert from_half_way(plan).feasible
    altitude = bed.altitude(plan.positions)
    ahead = (plan.positions[:, 0] > 300.0) & (plan.positions[:, 0] < WAY - 300.0)
    assert altitude[ahead].min() > 14.0
    assert np.median(altitude) == pytest.approx(15.0, abs=0.5)
    assert np.degrees(np.abs(plan.pitch)).max() < 30.0
    with pytest.raises(ValueError, match="transit_altitude needs a sea bed"):
        plan_of(ap.Vehicle(SPEED, transit_altitude=15.0), sea())


def test_edges_are_timed_at_the_transit_depth():
    """Above 40 m the current is against the vehicle, below it goes along."""
    ends = np.array([[0.0, 0.0, 10.0]]), np.array([[WAY, 0.0, 10.0]])
    for depth in (20.0, 60.0):
        vehicle = ap.Vehicle(SPEED, transit_depth=depth)
        seconds, passable = travel_times(Trips(*ends, np.zeros(1)), sea(), vehicle, TravelTimeConfig())
        plan = plan_of(vehicle, sea(), goal_depth=10.0)
        assert passable.all()
        assert seconds[0] == pytest.approx(plan.travel_time, rel=0.02)


def test_slopes_keep_the_pitch_of_the_vehicle():
    """The sine of the pitch is the vertical speed over that through the water."""
    limit = np.radians(5.0)
    vehicle = replace(UNLIMITED, pitch_max=limit)
    found = straight_profile(sea(), vehicle=vehicle)
    steep = straight_profile(sea())
    step = WAY / 16.0
    middle = 0.5 * (found[1:] + found[:-1])
    ground = SPEED + 0.8 * np.tanh((middle - 40.0) / 3.0)
    rise = np.abs(np.diff(found))
    pitch = np.arcsin(np.minimum(rise / np.hypot(rise, step) * ground / SPEED, 1.0))
    assert np.degrees(pitch.max()) < 6.0  # over the mean current of a step
    assert np.abs(np.diff(steep)).max() > rise.max()


def test_an_obstacle_on_the_way_is_passed_below_or_above():
    obstacle = ap.Obstacles.static([[WAY / 2, 0.0, 60.0]], [25.0])
    still = ap.Environment(None, obstacles=obstacle, lower=(-1000, -2000, 0), upper=(WAY + 1000, 2000, 120.0))
    assert abs(straight_profile(still, 60.0)[8] - 60.0) > 20.0


def naive_time(depths, stations, start, goal, current, speed):
    """Least time over the same depths and stations, in plain loops."""
    step = WAY / stations
    times = np.where(np.arange(len(depths)) == start, 0.0, np.inf)
    for _ in range(stations):
        new = np.full(len(depths), np.inf)
        for here, there in np.ndindex(len(depths), len(depths)):
            between = np.linspace(depths[here], depths[there], 400)
            water = current(between).mean()
            gap = np.hypot(step, depths[there] - depths[here])
            along, across = water * step / gap, abs(water) * abs(depths[there] - depths[here]) / gap
            ground = along + np.sqrt(speed**2 - across**2)
            new[there] = min(new[there], times[here] + gap / ground)
        times = new
    return times[goal]


def test_profile_is_as_quick_as_a_plain_programme_finds():
    found = straight_profile(sea())

    def current(depth):
        return 0.8 * np.tanh((depth - 40.0) / 3.0)

    def seconds(profile):
        step, total = WAY / 16.0, 0.0
        for first, last in pairwise(profile):
            gap, water = np.hypot(step, last - first), current(np.linspace(first, last, 400)).mean()
            across = abs(water) * abs(last - first) / gap
            total += gap / (water * step / gap + np.sqrt(SPEED**2 - across**2))
        return total

    depths = np.unique(np.r_[found, np.linspace(0.0, 100.0, 12)])
    start, goal = (int(np.argmin(np.abs(depths - 10.0))),) * 2
    best = naive_time(depths, 16, start, goal, current, SPEED)
    assert seconds(found) <= best * 1.03


def test_a_path_in_two_layers_is_as_quick_as_the_best_profile():
    """Of the vertical plane: down at once, along below the interface, up at the end."""
    plan = in_two_layers()
    assert plan.feasible
    depths = np.r_[10.0, np.arange(4.0, 100.0, 6.0)]
    depths.sort()
    start = int(np.argmin(np.abs(depths - 10.0)))
    best = naive_time(depths, 40, start, start, lambda z: 0.8 * np.tanh((z - 40.0) / 3.0), SPEED)
    assert plan.travel_time < 1.01 * best


def layer(x, y, z, t):
    """Adverse above 19 m: a dive crosses it within one segment."""
    return 0.6 * jnp.tanh((z - 19.0) / 0.7), 0.0, 0.0


def front(x, y, z, t):
    """Along the way, sharp, 30 m beside the straight line."""
    return 0.6 * jnp.tanh((y - 30.0) / 2.0), 0.0, 0.0


def bands(x, y, z, t):
    """Across the way, adverse, 140 m wide every 3 km."""
    return jnp.where(jnp.abs(jnp.mod(x - 1500.0, 3000.0) - 1500.0) > 1430.0, -0.6, 0.0), 0.0, 0.0


@pytest.mark.slow
@pytest.mark.parametrize("sharp", [layer, front, bands])
def test_what_is_finer_than_samples_is_timed_as_it_is_sailed(sharp):
    """They lie 460 m apart: what a segment crosses must not be hidden from it."""
    vehicle = ap.Vehicle(1.3, surge_max=50.0, sway_max=50.0, pitch_max=0.5)
    env = ap.Environment(sharp, lower=(-2000, -8000, 0), upper=(32_000, 8000, 100))
    ends = (0, 0, 5), (29_000, 0, 5)
    plan = ap.plan_path(*ends, env, vehicle, key=jax.random.key(0), config=ap.PathConfig.quick())
    assert plan.feasible
    share = np.linspace(0.0, len(plan.times) - 1.0, 100_001)
    points = np.stack([np.interp(share, np.arange(len(plan.times)), axis) for axis in plan.positions.T], 1)
    way, middle = np.diff(points, axis=0), 0.5 * (points[1:] + points[:-1])
    gap, water = np.linalg.norm(way, axis=1), np.asarray(sharp(*middle.T, 0.0)[0])
    along = water * way[:, 0] / gap
    ground = along + np.sqrt(1.3**2 - (water**2 - along**2))
    assert plan.travel_time == pytest.approx((gap / ground).sum(), rel=2e-3)
    assert float(ap.travel_time(plan.positions, env, vehicle)) == pytest.approx(plan.travel_time, rel=1e-4)


@pytest.mark.slow
def test_a_gradual_sea_needs_no_finer_path_for_its_time():
    def eddy(x, y, z, t):
        return 0.4 * jnp.sin(y / 4000.0) + 0.0 * x, 0.4 * jnp.sin(x / 4000.0) + 0.0 * y, 0.0

    config = ap.PathConfig.quick()
    env = ap.Environment(eddy, lower=(-2000, -8000, 0), upper=(32_000, 8000, 0))
    plan = ap.plan_path((0, 0, 0), (29_000, 0, 0), env, UNLIMITED, key=jax.random.key(0), config=config)
    assert plan.feasible
    assert len(plan.positions) == config.samples
    assert float(ap.travel_time(plan.positions, env, UNLIMITED)) == pytest.approx(plan.travel_time, rel=1e-4)


def test_a_replan_in_two_layers_stays_below():
    plan = in_two_layers()
    rest = from_half_way(plan)
    assert rest.positions[0, 2] > 45.0
    assert rest.feasible
    assert np.median(rest.positions[:, 2]) > 45.0
    assert rest.travel_time < 1.01 * (plan.times[-1] - rest.times[0])


@pytest.mark.slow
@pytest.mark.parametrize("goal", [(0.0, 0.0, 80.0), (60.0, 20.0, 80.0)])
def test_paths_wind_where_the_straight_line_is_too_steep(goal):
    """Of the least time that the pitch allows, which a helix takes, nearly nothing is lost."""
    vehicle = ap.Vehicle(SPEED, pitch_max=np.radians(20.0))
    env = ap.Environment(None, lower=(-500, -500, 0), upper=(500, 500, 100))
    config = ap.PathConfig.quick()
    plan = ap.plan_path((0.0, 0.0, 5.0), goal, env, vehicle, key=jax.random.key(0), config=config)
    assert plan.feasible, plan.reason
    assert np.degrees(np.abs(plan.pitch)).max() < 20.2
    least = 75.0 / (SPEED * np.sin(vehicle.pitch_max))
    assert least * 0.999 < plan.travel_time < 1.1 * least
    assert plan.lengthened.startswith(f"winds over {plan.length:,.0f} m")
    assert f"{least:,.0f} s at least" in plan.lengthened


@pytest.mark.parametrize(("env", "deeper"), [(sea(), True), (sea(bottom=0.0), False)])
def test_descents_take_greater_steps_in_depth_where_depth_is_searched(env, deeper):
    config = ap.PathConfig(control_points=5)
    legs = Legs(np.zeros((1, 3)), np.array([[WAY, 0.0, 0.0]]), np.zeros(1), None)
    _, shared = split(env, legs=None)
    sizes = Batch.of(legs, shared, UNLIMITED, config).step_sizes(0.01, config)
    north, east, down = np.broadcast_to(sizes, 15).reshape(3, 5)
    np.testing.assert_array_equal([north, east], np.float32(0.01))
    assert ((down > 0.02) == deeper).all()
    assert deeper or sizes.shape == ()  # one number, as it always was
