from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

import auvplan as ap
from auvplan.ocean.currents import SumCurrent
from auvplan.ocean.deviation import deviation, interpolation_deviation
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.path.bound import lower_bound
from auvplan.path.follow import straight_plan
from auvplan.path.sensitivity import Conditions

VEHICLE = ap.Vehicle(2.5, surge_max=100.0, sway_max=100.0, turn_rate_max=100.0)
COARSE = {"fineness": 0.4}
travel_time = jax.jit(ap.travel_time)
at_places = jax.jit(lambda current, places: jnp.stack(current(*places), axis=-1))


def bound(env, goal, known, start=(0.0, 0.0, 0.0), vehicle=VEHICLE, **settings):
    return lower_bound(
        np.asarray(start, float),
        np.asarray(goal, float),
        env,
        vehicle,
        ap.PathConfig(),
        known=known,
        **settings,
    )


@pytest.mark.parametrize("across", [0.0, 1.5])
def test_straight_line_in_a_uniform_current(across):
    ground = 0.5 + np.sqrt(2.5**2 - across**2)
    found = bound(ap.Environment(ap.UniformCurrent(0.5, across)), (3000.0, 0.0, 0.0), 3000.0 / ground)
    assert found.kind == "certified"
    assert 0.99 * 3000.0 / ground < found.travel_time <= 3000.0 / ground


@pytest.mark.parametrize("level", [0.0, 10.0, 300.0])
def test_dives_in_a_current_that_is_the_same_at_all_depths(level):
    """What is D away in T is |D - c T| = V T through the water, up and down too."""
    current, way, speed = np.array([0.5, 0.3, 0.05]), np.array([0.6 * level, -0.8 * level, 90.0]), 1.5
    gained, along = speed**2 - current @ current, way @ current
    least = (np.sqrt(along**2 + gained * (way @ way)) - along) / gained
    free = ap.Vehicle(speed, surge_max=100.0, sway_max=100.0, pitch_max=None)
    env = ap.Environment(ap.UniformCurrent(*current), lower=(-2000, -2000, 0), upper=(2000, 2000, 100))
    found = bound(env, way + np.array([0.0, 0.0, 5.0]), 1.3 * least, (0.0, 0.0, 5.0), free, **COARSE)
    assert (found.kind, found.travel_time) == ("certified", pytest.approx(least, rel=3e-5))
    assert found.travel_time < least
    dive = 90.0 / (speed * np.sin(0.2) + 0.05)
    steep = bound(
        env,
        way + np.array([0.0, 0.0, 5.0]),
        2.0 * dive,
        (0.0, 0.0, 5.0),
        replace(free, pitch_max=0.2),
        **COARSE,
    )
    assert max(0.98 * dive, 0.99 * least) < steep.travel_time <= max(dive, least)


def test_way_round_a_disc():
    rocks = ap.Obstacles.static([[1500.0, 0.0, 0.0]], [300.0])
    reach = 300.0 + ap.PathConfig().obstacle_margin
    tangents = 2.0 * (np.sqrt(1500.0**2 - reach**2) + reach * np.arcsin(reach / 1500.0))
    env = ap.Environment(None, obstacles=rocks, lower=(-1000, -2000, 0), upper=(4000, 2000, 0))
    found = bound(env, (3000.0, 0.0, 0.0), tangents / 2.5)
    assert 0.97 * tangents / 2.5 < found.travel_time <= tangents / 2.5
    assert found.travel_time > 3000.0 / 2.5  # it knows of the disc


def test_finer_grids_come_nearer():
    env = ap.Environment(ap.LambVortices([[[1500.0, 300.0]]], [[3000.0]], [[400.0]]))
    coarse, fine = (bound(env, (3000.0, 0.0, 0.0), 1300.0, fineness=f).travel_time for f in (0.25, 0.5))
    assert coarse < fine <= 1300.0


def test_no_bound_above_what_is_known():
    found = bound(ap.Environment(None), (3000.0, 0.0, 0.0), 900.0, **COARSE)
    assert found.travel_time <= 900.0


@pytest.mark.parametrize("known", [0.0, np.inf, np.nan])
def test_what_is_known_is_the_time_of_a_path(known):
    with pytest.raises(ValueError, match="known must be the time of a path, s, got"):
        bound(ap.Environment(None), (3000.0, 0.0, 0.0), known)


def test_wall_without_a_gap_is_no_way():
    water = np.ones((100, 60), bool)
    water[45:52] = False
    env = ap.Environment(None, ap.Chart.from_mask(water, 20.0), lower=(0, 0, 0), upper=(2000, 1200, 0))
    found = bound(env, (1800.0, 600.0, 0.0), 1000.0, start=(200.0, 600.0, 0.0), **COARSE)
    assert found.travel_time == np.inf
    water[45:52, 10:20] = True
    env = ap.Environment(None, ap.Chart.from_mask(water, 20.0), lower=(0, 0, 0), upper=(2000, 1200, 0))
    found = bound(env, (1800.0, 600.0, 0.0), 1000.0, start=(200.0, 600.0, 0.0), **COARSE)
    corner = np.hypot(950.0 - 200.0, 600.0 - 400.0) / 2.5  # of the gap, seen from the start, at the most
    assert 1600.0 / 2.5 < found.travel_time < 2.0 * corner + 200.0


def test_limit_on_ground_speed_counts():
    stream = ap.Environment(ap.UniformCurrent(2.0, 0.0))
    slow = ap.Vehicle(2.5, surge_max=3.0)
    found = bound(stream, (3000.0, 0.0, 0.0), 1000.0, vehicle=slow, **COARSE)
    assert found.travel_time > 0.85 * 3000.0 / 3.03
    assert bound(stream, (3000.0, 0.0, 0.0), 1000.0, **COARSE).travel_time <= 3000.0 / 4.5


vortices = st.lists(
    st.tuples(
        st.floats(0.0, 3000.0), st.floats(-800.0, 800.0), st.floats(-1500.0, 1500.0), st.floats(150.0, 500.0)
    ),
    min_size=1,
    max_size=4,
)


def field(rows):
    x, y, strength, radius = np.asarray(rows, float).T
    return ap.LambVortices(np.c_[x, y][None], strength[None] * 2.0, radius[None])


@settings(max_examples=6, deadline=None)
@given(vortices, st.integers(0, 10_000))
@example([(0.0, 0.0, 300.0, 150.0)], 0)
def test_no_path_beats_it(rows, seed):
    """Crooked paths near the straight line, and the straight line itself, in any field of vortices."""
    rows = (rows * 4)[:4]
    env = ap.Environment(field(rows), lower=(-500, -1200, 0), upper=(3500, 1200, 0))
    rng = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, 400)
    waves = [np.sin(np.pi * k * share) for k in (1, 2, 3)]
    times = []
    for size in (0.0, 30.0, 120.0, 300.0):
        aside = sum(size * rng.normal() / (k + 1) * wave for k, wave in enumerate(waves))
        path = np.c_[3000.0 * share, aside + np.zeros(400), np.zeros(400)]
        times.append(float(travel_time(path, env, VEHICLE)))
    known = min(times)
    assume(np.isfinite(known))  # the current lets one of them be held
    assert bound(env, (3000.0, 0.0, 0.0), known * 1.2, **COARSE).travel_time <= known


@settings(max_examples=12, deadline=None)
@given(st.floats(0.3, 1.0), st.floats(1500.0, 8000.0), st.floats(0.0, 6.3))
@pytest.mark.slow
def test_tide_along_the_way(strength, period, phase):
    """Along one axis alone the straight line is the best path, at the times that it has in the tide."""
    rate = 2.0 * np.pi / period
    tide = HarmonicCurrent(
        places=np.zeros((1, 2)),
        rate=np.array([rate]),
        in_phase=np.array([[[strength * np.cos(phase)]], [[0.0]]]),
        quadrature=np.array([[[strength * np.sin(phase)]], [[0.0]]]),
        mean=np.zeros((2, 1)),
        depths=np.array([0.0]),
        shares=np.array([1.0]),
    )
    env = ap.Environment(jax.tree.map(jnp.asarray, tide))
    t, x = 0.0, 0.0
    while x < 3000.0:  # one second after the other
        speed = 2.5 + strength * np.cos(rate * (t + 0.5) - phase)
        step = min(1.0, (3000.0 - x) / speed)
        t, x = t + step, x + step * speed
    found = bound(env, (3000.0, 0.0, 0.0), t + 1.0, **COARSE)
    assert found.kind == "certified"
    assert 0.97 * t < found.travel_time <= t + 0.05


@pytest.mark.slow
def test_a_dive_into_a_quick_layer():
    def layers(x, y, z, t):
        return 0.5 + jnp.tanh((z - 35.0) / 8.0), 0.0 * z, 0.0 * z

    env = ap.Environment(layers, lower=(-300, -300, 0), upper=(4300, 300, 60))
    vehicle = ap.Vehicle(2.0, surge_max=100.0)
    share = np.linspace(0.0, 1.0, 2000)
    depth = np.interp(share, (0.0, 0.02, 0.98, 1.0), (10.0, 55.0, 55.0, 10.0))
    path = np.c_[4000.0 * share, np.zeros(2000), depth]
    known = float(travel_time(path, env, vehicle))
    found = bound(env, (4000.0, 0.0, 10.0), known, start=(0.0, 0.0, 10.0), vehicle=vehicle, fineness=0.5)
    assert found.kind == "estimated"  # a plain function does not tell how much it may change
    assert len(found.cells) == 3
    assert 0.93 * known < found.travel_time <= known


def test_depth_does_not_matter_where_the_current_is_the_same():
    box = {"lower": (-500, -900, 0), "upper": (3500, 900, 80)}
    env = ap.Environment(ap.UniformCurrent(0.5, 0.0), **box)
    found = bound(env, (3000.0, 0.0, 40.0), 1000.5, start=(0.0, 0.0, 10.0), **COARSE)
    assert len(found.cells) == 2
    assert 0.98 * 1000.0 < found.travel_time <= 1000.5


def test_of_a_plan():
    env = ap.Environment(ap.UniformCurrent(0.5, 0.0), lower=(-500, -500, 0), upper=(3500, 500, 0))
    conditions = Conditions(env, VEHICLE, ap.PathConfig())
    plan = straight_plan(np.zeros(3), np.array([3000.0, 0.0, 0.0]), 0.0, conditions)
    assert plan.lower_bound == plan.bound.travel_time <= plan.travel_time
    assert plan.gap == pytest.approx(plan.travel_time / plan.lower_bound - 1.0)
    assert 0.0 <= plan.gap < 0.01
    assert plan.bounded(0.3).travel_time <= plan.lower_bound + 1e-3


# Means of currents


def departs(current, centre, edges, rng):
    """How far a current at means of points of a box is from its mean at these, at most of 300 draws."""
    centre, edges = np.asarray(centre, float), np.asarray(edges, float)
    with jax.enable_x64(True):
        points = centre + edges * rng.uniform(-0.5, 0.5, (300, 4, 4))
        corners = centre + edges * (rng.integers(0, 2, (300, 4, 4)) - 0.5)
        points = np.where(rng.random((300, 1, 1)) < 0.5, points, corners)
        weights = rng.dirichlet(np.ones(4), 300)
        mean = (weights[..., None] * points).sum(axis=1)
        there, at_mean = (np.asarray(at_places(current, list(np.moveaxis(p, -1, 0)))) for p in (points, mean))
    return np.linalg.norm(at_mean - (weights[..., None] * there).sum(axis=1), axis=1).max()


def told(current, centre, edges):
    return float(deviation(current, [np.array([c]) for c in np.asarray(centre, float)], edges)[0])


def vortices_and_box(rng):
    centers, radius = rng.uniform(0, 900, (3, 3, 2)), rng.uniform(80, 300, (3, 3))
    current = ap.LambVortices(
        centers, rng.normal(0, 800, (3, 3)), radius, [0.0, 20.0, 30.0], vertical_scale=5.0
    )
    return current, rng.uniform(0.0, (900, 600, 30, 0)), rng.uniform((10, 10, 0, 10), (600, 600, 60, 10))


def grid_and_box(rng):
    u, v = rng.normal(0, 1, (2, 4, 3, 7, 6))
    current = ap.GriddedCurrent.from_arrays(
        u, v, spacing=(100.0, 130.0), depths=(0.0, 10.0, 40.0), times=(0.0, 300.0, 900.0, 1500.0)
    )
    edges = rng.uniform((5, 5, 0, 0), (250, 250, 40, 900)) * (rng.random(4) < 0.8)
    return current, rng.uniform((-100, -100, -5, -100), (800, 800, 45, 1600)), edges


def tide_and_box(rng):
    tide = HarmonicCurrent(
        places=np.zeros((1, 2)),
        rate=rng.uniform(1e-4, 1e-3, 3),
        in_phase=rng.normal(0, 1, (2, 1, 3)),
        quadrature=rng.normal(0, 1, (2, 1, 3)),
        mean=rng.normal(0, 1, (2, 1)),
        depths=np.array([0.0, 10.0, 50.0]),
        shares=np.array([1.0, 0.7, 0.2]),
    )
    return tide, rng.uniform(0.0, (0, 0, 50, 1e5)), rng.uniform((100, 100, 0, 0), (100, 100, 40, 6000))


@pytest.mark.parametrize("drawn", [vortices_and_box, grid_and_box, tide_and_box])
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_currents_tell_how_far_they_depart_from_means(drawn, seed):
    rng = np.random.default_rng(seed)
    current, centre, edges = drawn(rng)
    assert departs(current, centre, edges, rng) <= told(current, centre, edges) + 1e-5
    if drawn is tide_and_box:
        both = SumCurrent(current, ap.UniformCurrent(0.3, 0.1))
        assert told(both, centre, edges) == pytest.approx(told(current, centre, edges))


def test_functions_do_not_tell():
    env = ap.Environment(lambda x, y, z, t: (0.1 * x, 0.0, 0.0))
    assert deviation(env.current, [np.zeros(1)] * 4, (1.0,) * 4) is None


def test_a_departure_is_as_great_as_the_kink_of_a_box_and_nothing_beside_it():
    """A quarter of jump times edge where the kink is in the middle; a box that ends at it has none."""
    line, values = np.arange(5.0), np.array([0.0, 0.0, 0.0, 3.0, 6.0])
    places, edges = [np.array([2.0, 1.5, 2.3, 0.2])], [np.array([1.0, 1.0, 0.8, 0.3])]
    found = interpolation_deviation([values], [line], places, edges)
    assert found == pytest.approx([0.75, 0.0, 0.6, 0.0])
