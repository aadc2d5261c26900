"""Sensitivities of a plan against closed forms and finite differences."""

from dataclasses import dataclass, replace
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import auvplan as ap
from auvplan.bbo import BBOConfig
from auvplan.ocean.currents import is_quasi_steady
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.path.cost import Track, evaluate
from auvplan.path.kinematics import PacedCurrent
from auvplan.path.profile import timed
from auvplan.path.sensitivity import SETTLING_STEPS, Conditions, _Scaled, sensitivity
from tests.path.worlds import GOAL, START, world

CONFIG = ap.PathConfig(samples=48)
#: A search of next to nothing: tests that plan with it share compiled programs.
LIGHT = CONFIG.replace(
    bbo=CONFIG.bbo.replace(population=10, iterations=2), refine_steps=0, passages=0, finer=1
)
#: Places at which a segment meets the current when it is timed.
PLACES = timed(CONFIG, world().current).quadrature
SHARE = np.linspace(0.0, 1.0, 48)[:, None]
#: A path with a bend.
PATH = START + (GOAL - START) * SHARE + 150.0 * np.sin(np.pi * SHARE) * np.array([1.0, -1.0, 0.0])


def tide(x, y, z, t):
    """A stream that turns with time and place, m/s."""
    return 0.4 * jnp.sin(t / 500.0 + x / 900.0), 0.3 * jnp.cos(t / 400.0 - y / 700.0), 0.0 * z


look_up = jax.jit(lambda current, place, time: jnp.stack(current(*place, time)))


def arrivals(depart, speed, factor, current, places=1):
    """[S] s at the samples of `PATH`, its segments executed one after the other.

    Each meets the current at some places, in the middles of equal parts that are executed in turn.
    """
    times, now, pace, before, current = [depart], depart, speed, speed, ap.Environment(current).current
    for a, b in pairwise(PATH):
        gap = np.linalg.norm(b - a)
        for share in (np.arange(places) + 0.5) / places:
            onward = np.clip(pace + 0.75 * (pace - before), 0.5 * pace, 2.0 * pace)
            met = a + share * (b - a), now + 0.5 * gap / places / onward
            water = factor * np.asarray(look_up(current, *met))
            along = water @ (b - a) / gap
            before, pace = pace, along + np.sqrt(speed**2 - (water @ water - along**2))
            now += gap / places / pace
        times.append(now)
    return np.array(times)


def travel_time(depart, speed, factor, current, places=1):
    """s along `PATH`."""
    times = arrivals(depart, speed, factor, current, places)
    return times[-1] - times[0]


@pytest.mark.usefixtures("x64")
def test_slopes_match_finite_differences():
    env = ap.Environment(tide, None, None, (0, 0, 0), (2000, 2000, 100))
    found = sensitivity(PATH, 100.0, Conditions(env, ap.Vehicle(), CONFIG))
    at, steps = np.array([100.0, 2.5, 1.0]), (1e-2, 1e-5, 1e-5)
    for k, (name, step) in enumerate(zip(("departure", "speed", "current"), steps, strict=True)):
        aside = step * np.eye(3)[k]
        ends = (travel_time(*(at + sign * aside), tide, PLACES) for sign in (1, -1))
        difference = np.subtract(*ends)
        assert getattr(found, name) == pytest.approx(difference / (2 * step), rel=1e-4, abs=1e-6)
    steady = Conditions(ap.Environment(world().current), ap.Vehicle(), CONFIG)
    assert sensitivity(PATH, 100.0, steady).departure == 0.0


def gradual_tide():
    """A few nodes of the tide, as files of an ocean model have it: quasi-steady."""
    north, east, times = (
        np.linspace(-200, 2200, 13),
        np.linspace(-200, 2200, 13),
        np.arange(0.0, 3600.0, 600.0),
    )
    t, x, y = np.meshgrid(times, north, east, indexing="ij")
    u, v, _ = tide(x, y, 0.0 * x, t)
    return ap.GriddedCurrent.from_arrays(
        u[:, None], v[:, None], origin=(-200.0, -200.0), spacing=200.0, times=times
    )


@pytest.mark.parametrize("kind", ["steady", "tide", "gradual"])
@pytest.mark.usefixtures("x64")
def test_slopes_of_every_arrival_match_finite_differences(kind):
    """Of the times at all samples, and of each segment's duration, their difference."""
    current = {"steady": lambda: world().current, "tide": lambda: tide, "gradual": gradual_tide}[kind]()
    env = ap.Environment(current)
    assert is_quasi_steady(env.current) is (kind == "gradual")
    track = Track.through(*(jnp.asarray(PATH[:, axis, None]) for axis in range(3)))

    def times(depart, speed, factor):
        world = replace(env, current=_Scaled(env.current, factor))
        return evaluate(track, depart, world, ap.Vehicle(speed=speed), CONFIG).times[:, 0]

    at, steps = np.array([100.0, 2.5, 1.0]), (1e-2, 1e-5, 1e-5)
    found = np.stack(jax.jit(jax.jacrev(times, argnums=(0, 1, 2)))(*at))
    twin = env.current
    for k, step in enumerate(steps):
        aside = step * np.eye(3)[k]
        expected = (arrivals(*(at + aside), twin) - arrivals(*(at - aside), twin)) / (2.0 * step)
        rounding = 4.0 * np.spacing(expected.size * 100.0) / step
        for ours, theirs in ((found[k], expected), (np.diff(found[k]), np.diff(expected))):
            np.testing.assert_allclose(ours, theirs, rtol=1e-3, atol=rounding + 1e-4 * np.abs(theirs).max())
    # The departure itself is the first of the times: it moves with itself and with nothing else.
    np.testing.assert_array_equal(found[:, 0], [1.0, 0.0, 0.0])
    if kind == "steady":
        np.testing.assert_allclose(found[0], 1.0)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("places", [None, 3])
def test_in_a_paced_current_times_and_slopes_are_those_of_segments_in_turn(places):
    """The pace to begin with is far off, and sweeps settle it."""
    pace, depart = np.linspace(1.6, 3.2, len(PATH) - 1), 100.0
    config = CONFIG.replace(quadrature=places)

    def travel(positions, current):
        track = Track.through(*(positions[:, axis, None] for axis in range(3)))
        env = replace(ap.Environment(tide), current=current)
        return evaluate(track, jnp.asarray(depart), env, ap.Vehicle(), config).travel_time[0]

    exact = ap.Environment(tide).current
    paced, travel = PacedCurrent(exact, pace), jax.jit(travel)
    assert travel(PATH, paced) == pytest.approx(float(travel(PATH, exact)), rel=1e-4)
    slopes = (jax.jit(jax.grad(travel))(PATH, current) for current in (paced, exact))
    np.testing.assert_allclose(*slopes, rtol=2e-3, atol=5e-4)


@pytest.mark.usefixtures("x64")
def test_travel_times_are_traced_and_differentiated():
    env, vehicle = ap.Environment(world().current), ap.Vehicle(2.0)
    paths = jnp.stack([jnp.asarray(PATH), jnp.asarray(PATH + np.array([0.0, 30.0, 0.0]))])
    of_one = jax.jit(ap.travel_time)
    both = jax.jit(jax.vmap(ap.travel_time, in_axes=(0, None)))(paths, env)
    np.testing.assert_allclose(both, [of_one(path, env) for path in paths], rtol=1e-12)
    assert of_one(paths[0], env, vehicle, 50.0) == pytest.approx(
        travel_time(50.0, 2.0, 1.0, env.current, PLACES), rel=1e-6
    )
    at = paths[0], env.current, vehicle, jnp.asarray(50.0)

    @jax.jit
    def time(points, current, vehicle, depart):
        return ap.travel_time(points, replace(env, current=current), vehicle, depart)

    slopes = jax.jit(jax.grad(time, argnums=(0, 1, 2, 3)))(*at)
    rng = np.random.default_rng(0)
    for k, given in enumerate(at):
        aside = jax.tree.map(lambda leaf: jnp.asarray(rng.normal(size=np.shape(leaf)) * np.abs(leaf)), given)
        ends = [
            time(*at[:k], jax.tree.map(lambda a, b, step=step: a + step * b, given, aside), *at[k + 1 :])
            for step in (1e-6, -1e-6)
        ]
        along = sum(jnp.vdot(a, b) for a, b in zip(*map(jax.tree.leaves, (slopes[k], aside)), strict=True))
        assert float(along) == pytest.approx(float(ends[0] - ends[1]) / 2e-6, rel=1e-4, abs=1e-6)


def test_a_tide_that_is_the_same_everywhere_is_met_as_long_segments_are_passed():
    """Along the way s = v t + a / w sin(w t), which the last moment solves."""
    speed, most, rate, length = 1.2, 0.9, 2.0 * np.pi / 11_178.0, 40_000.0
    one, none = np.float32([[[most]], [[0.0]]]), np.zeros((2, 1, 1), np.float32)
    place, mean = np.zeros((1, 2)), np.zeros((2, 1), np.float32)
    tide = HarmonicCurrent(place, np.float32([rate]), one, none, mean, np.zeros(1), np.ones(1))
    track = np.linspace((0.0, 0.0, 0.0), (length, 0.0, 0.0), 64)
    exact = brentq(lambda t: speed * t + most / rate * np.sin(rate * t) - length, 0.0, length)
    found = ap.travel_time(track, ap.Environment(tide), ap.Vehicle(speed))
    assert float(found) == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("depart", [1e6, 8e6])
def test_days_after_the_epoch_travel_times_have_all_their_digits(depart):
    """The same tide from each departure on, half an hour between its nodes."""

    def time(depart):
        u = 0.8 * (-1.0) ** np.arange(6)[:, None, None, None] * np.ones((1, 1, 2, 2))
        when = depart + 1800.0 * np.arange(6)
        current = ap.GriddedCurrent.from_arrays(u, 0.0 * u, spacing=4000.0, times=when)
        track = np.linspace((0.0, 2000.0, 0.0), (2000.0, 2000.0, 0.0), 637)
        return float(ap.travel_time(track, ap.Environment(current), ap.Vehicle(1.2), depart))

    assert time(depart) == pytest.approx(time(0.0), rel=1e-5)


@pytest.mark.parametrize("current", [(-1.95, 0.0), (-2.0, 0.0), (-5.0, 0.0), (0.0, 2.1), (2.9, 2.1)])
def test_tracks_that_the_current_does_not_let_be_held_take_for_ever(current):
    """Against the vehicle, at less than a twentieth of its speed too, across it, and both."""
    points = np.array([[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0], [2000.0, 0.0, 0.0]])

    def time(speed):
        return ap.travel_time(points, ap.Environment(ap.UniformCurrent(*current)), ap.Vehicle(speed))

    assert np.isinf(float(time(2.0)))
    assert float(jax.grad(time)(2.0)) == 0.0
    assert np.isfinite(float(time(7.0)))


def test_travel_time_of_points_that_are_none():
    for points in (np.zeros((1, 3)), np.zeros((4, 2)), np.zeros(3)):
        with pytest.raises(ValueError, match=r"points must be \[S, 3\] m, .*at least two"):
            ap.travel_time(points, ap.Environment(None))


#: Converges to far less than what plans differ by when a leaf is changed by some per cent.
FINE = ap.PathConfig(
    bbo=BBOConfig(population=16, iterations=2), control_points=16, samples=129, passages=4, field_cells=56,
    finer=1, refine_steps=300, refine_count=1,
)  # fmt: skip


def rounding(start, goal, current, position, radius, speed):
    """Plan past an obstacle, through vortices."""
    sphere = replace(ap.Obstacles.static(np.zeros((1, 3)), np.ones(1)), position=position, radius=radius)
    env = ap.Environment(current, None, sphere, (-500.0, -2000.0, 20.0), (3500.0, 2000.0, 20.0))
    return ap.plan_path(start, goal, env, ap.Vehicle(speed), key=jax.random.key(0), config=FINE)


@pytest.mark.slow
def test_slopes_of_a_least_time_by_every_leaf():
    env = ap.Environment(tide, lower=(-500.0, -500.0, 0.0), upper=(3500.0, 500.0, 0.0))

    def time(start, goal, env, vehicle, depart):
        return ap.plan_path(
            start, goal, env, vehicle, key=jax.random.key(0), config=LIGHT, depart=depart
        ).travel_time

    given = (0.0, 0.0, 0.0), (3000.0, 0.0, 0.0), env, ap.Vehicle(), 500.0
    least, slopes = jax.value_and_grad(time, argnums=tuple(range(5)), allow_int=True)(*given)
    plan = ap.plan_path(*given[:4], key=jax.random.key(0), config=LIGHT, depart=500.0)
    assert least == plan.travel_time
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes) if leaf.dtype != jax.dtypes.float0)
    configs = [LIGHT, *(LIGHT.replace(refine_steps=steps) for steps in SETTLING_STEPS)]
    plans = [
        ap.plan_path(*given[:4], key=jax.random.key(0), config=config, depart=500.0) for config in configs
    ]
    known = min(plans, key=lambda plan: plan.travel_time).sensitivity()
    assert (slopes[3].speed, slopes[4]) == pytest.approx((known.speed, known.departure), rel=1e-3)
    assert slopes[0][0] < 0.0 < slopes[1][0]


@pytest.mark.slow
def test_least_times_have_the_slopes_of_plans_made_anew():
    ends = jnp.array([0.0, 0.0, 20.0]), jnp.array([3000.0, 0.0, 20.0])
    current = ap.random_vortices(jax.random.key(3), (0, -1500, 0), (3000, 1500, 40), count=2)
    given = (*ends, current, jnp.array([[1500.0, 60.0, 20.0]]), jnp.array([300.0]), jnp.asarray(2.5))

    def time(*given):
        return rounding(*given).travel_time

    least, slopes = jax.value_and_grad(time, argnums=tuple(range(6)))(*given)
    assert least == time(*given)
    aside = jnp.zeros((1, 3)).at[0, 1].set(40.0)
    for k, step in (
        (0, jnp.array([60.0, 0.0, 0.0])),
        (1, jnp.array([60.0, 0.0, 0.0])),
        (3, aside),
        (4, 40.0),
        (5, 0.1),
    ):
        changed = [time(*given[:k], given[k] + sign * step, *given[k + 1 :]) for sign in (1.0, -1.0)]
        assert float(jnp.vdot(slopes[k], step + 0.0 * given[k])) == pytest.approx(
            0.5 * (changed[0] - changed[1]), rel=0.02
        )
    changed = [
        time(*given[:2], replace(current, strength=share * current.strength), *given[3:])
        for share in (1.1, 0.9)
    ]
    along = 0.1 * float(jnp.vdot(slopes[2].strength, current.strength))
    assert along == pytest.approx(0.5 * (changed[0] - changed[1]), rel=0.02)
    # Forwards too.
    pushed = jax.jvp(time, given, (*map(jnp.zeros_like, given[:2]), jax.tree.map(jnp.zeros_like, current),
                                   *map(jnp.zeros_like, given[3:5]), jnp.ones(())))[1]  # fmt: skip
    assert float(pushed) == pytest.approx(float(slopes[5]), rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4, 6])
def test_least_times_of_default_settings_have_these_slopes_too(seed):
    """Past an obstacle a default path may be so far from stationary that the limit seems to cost nothing."""
    current = ap.random_vortices(jax.random.key(seed), (0, -1500, 0), (3000, 1500, 40), count=2)

    def time(radius, config=None):
        sphere = ap.Obstacles.static(np.array([[1500.0, 40.0, 20.0]]), np.ones(1))
        env = ap.Environment(
            current, None, replace(sphere, radius=radius[None]), (-500, -2000, 20), (3500, 2000, 20)
        )
        ends = (0.0, 0.0, 20.0), (3000.0, 0.0, 20.0)
        return ap.plan_path(*ends, env, key=jax.random.key(0), config=config).travel_time

    radius, settled = jnp.asarray(250.0), ap.PathConfig(refine_steps=3000)
    changed = [float(time(radius + step, settled)) for step in (20.0, -20.0)]
    assert float(jax.grad(time)(radius)) == pytest.approx((changed[0] - changed[1]) / 40.0, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("depth", ["flat", "sill"])
def test_least_times_over_a_bed_have_the_slopes_of_plans_of_other_clearances(depth):
    """In a following current that grows with depth the vehicle keeps as deep as it may."""
    north = np.arange(-100.0, 3110.0, 10.0)
    below = {"flat": 63.0 + 0.0 * north, "sill": 80.0 - 35.0 * np.exp(-(((north - 1500.0) / 400.0) ** 2))}
    bed = ap.Seabed.from_depth(np.repeat(below[depth][:, None], 21, 1), 10.0, (-105.0, -105.0), clearance=3.0)
    vehicle = ap.Vehicle(1.5, sway_max=5.0, surge_max=9.0, turn_rate_max=10.0)

    def time(clearance, config=None):
        seabed = replace(bed, clearance=clearance)
        env = ap.Environment(sheared, None, None, (-100, -100, 0), (3100, 100, 90), seabed=seabed)
        ends = (0.0, 0.0, 5.0), (3000.0, 0.0, 5.0)
        return ap.plan_path(*ends, env, vehicle, key=jax.random.key(0), config=config).travel_time

    clearance, settled = jnp.asarray(3.0), ap.PathConfig(refine_steps=3000)
    changed = [float(time(clearance + step, settled)) for step in (2.0, -2.0)]
    assert float(jax.grad(time)(clearance)) == pytest.approx((changed[0] - changed[1]) / 4.0, rel=0.06)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Crossed:
    """A stream along the way, faster on one side, and one across it in its middle, m/s."""

    along: jax.Array
    across: jax.Array

    def __call__(self, x, y, z, t):
        north = self.along * jnp.exp(-(((y + 500.0) / 400.0) ** 2))
        return north + 0.0 * x, self.across * jnp.exp(-(((x - 2000.0) / 700.0) ** 2)) + 0.0 * y, 0.0 * x


@pytest.mark.slow
@pytest.mark.parametrize("most", [2.25, 2.3, 2.35, 2.4])
def test_a_limit_on_the_speed_over_ground_that_binds_has_its_slope(most):
    """The stream along the way would make the vehicle faster than it may be."""
    stream = Crossed(jnp.asarray(0.6), jnp.asarray(1.2))
    env = ap.Environment(stream, lower=(-500.0, -1500.0, 0.0), upper=(4500.0, 1500.0, 20.0))

    def time(most):
        vehicle = ap.Vehicle(2.0, surge_max=most, sway_max=1.5)
        return ap.plan_path((0, 0, 10), (4000, 0, 10), env, vehicle, key=jax.random.key(0)).travel_time

    # Plans of limits that differ by less differ by how far they have settled as well.
    changed = [float(time(most + step)) for step in (0.04, -0.04)]
    slope = float(jax.grad(time)(jnp.asarray(most)))
    assert slope == pytest.approx((changed[0] - changed[1]) / 0.08, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("most", [0.6, 0.8])
def test_a_limit_on_the_current_across_that_binds_has_its_slope(most):
    """It goes round the fastest of a stream that it may not cross."""

    def jet(x, y, z, t):
        return 0.0 * x, 1.2 * jnp.exp(-(((x - 2000.0) / 700.0) ** 2) - (y / 600.0) ** 2), 0.0 * x

    env = ap.Environment(jet, lower=(-500.0, -2500.0, 0.0), upper=(4500.0, 2500.0, 20.0))

    def time(most):
        vehicle = ap.Vehicle(2.0, surge_max=9.0, sway_max=most)
        return ap.plan_path((0, 0, 10), (4000, 0, 10), env, vehicle, key=jax.random.key(0)).travel_time

    changed = [float(time(most + step)) for step in (0.04, -0.04)]
    slope = float(jax.grad(time)(jnp.asarray(most)))
    assert slope == pytest.approx((changed[0] - changed[1]) / 0.08, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["pitch_max", "dive_rate_max"])
def test_a_limit_on_how_steep_it_dives_that_binds_has_its_slope(kind):
    """A dive that winds takes the depth over the rate, v sin(pitch), whatever lies below."""
    env, speed, depth = ap.Environment(None, lower=(-600, -600, 0), upper=(600, 600, 260)), 2.0, 200.0
    limit = {"pitch_max": np.radians(30.0), "dive_rate_max": 0.8}[kind]

    def time(limit, depth):
        vehicle = ap.Vehicle(speed, **{"pitch_max": None, kind: limit})
        goal = jnp.asarray([-120.0, 0.0, 0.0]).at[2].set(depth)
        return ap.plan_path((0, 0, 0), goal, env, vehicle, key=jax.random.key(0)).travel_time

    rate = speed * np.sin(limit) if kind == "pitch_max" else limit
    by_rate = -depth / rate**2
    expected = (by_rate * speed * np.cos(limit) if kind == "pitch_max" else by_rate), 1.0 / rate
    found = jax.grad(time, argnums=(0, 1))(jnp.asarray(limit), jnp.asarray(depth))
    np.testing.assert_allclose(found, expected, rtol=0.03)


def sheared(x, y, z, t):
    """A stream to the north that grows with depth, m/s."""
    return 0.012 * z, 0.0, 0.0


def test_what_cannot_be_traced_says_what_can():
    env = ap.Environment(tide, lower=(-500.0, -500.0, 0.0), upper=(3500.0, 500.0, 0.0))
    given = jnp.zeros(3), jnp.array([3000.0, 0.0, 0.0]), env

    def time(speed):
        return ap.plan_path(*given, ap.Vehicle(speed), key=jax.random.key(0), config=LIGHT).travel_time

    def times(speed):
        ends = (end[None] for end in given[:2])
        return ap.plan_paths(*ends, env, ap.Vehicle(speed), key=jax.random.key(0), config=LIGHT).travel_time

    second = jax.grad(jax.grad(time))
    batch = lambda speed: jax.vmap(time)(jnp.stack([speed, speed])).sum()  # noqa: E731
    for traced in (jax.jit(time), jax.jit(jax.grad(time)), batch, second, jax.grad(times)):
        with pytest.raises(
            TypeError, match=r"^plan_paths? cannot be traced here: .*ap\.plan_paths, .*ap\.travel_time "
        ):
            traced(jnp.asarray(2.5))
    slow = ap.Vehicle(2.5, sway_max=1e-3)
    with pytest.raises(ValueError, match="breaks a limit"):
        jax.grad(
            lambda goal: (
                ap.plan_path(given[0], goal, env, slow, key=jax.random.key(0), config=LIGHT).travel_time
            )
        )(given[1])
