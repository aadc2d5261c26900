"""Certified clearance never promises more than there is: land and moving spheres against brute force."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import auvplan as ap
from auvplan.ocean.closures import Closure
from auvplan.path import clearance
from tests.path.worlds import CONFIG, chart_with_island

between = jax.jit(clearance.between_circles)
between_slopes = jax.jit(jax.grad(clearance.between_circles, argnums=(0, 1, 2)))
passed = jax.jit(clearance.obstacle_clearance)
land_within = jax.jit(clearance.distance_to_land)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1.0, 80.0), st.integers(1, 40))
@pytest.mark.usefixtures("x64")
def test_no_land_is_nearer_than_certified(seed, gap, count):
    land = np.random.default_rng(seed).uniform(-150.0, 150.0, (count, 2))
    ends = np.array([[0.0, 0.0], [gap, 0.0]])
    first, last = (np.linalg.norm(land - end, axis=1).min() for end in ends)
    along = np.linspace(0.0, 1.0, 201)[:, None] * ends[1]
    true = np.linalg.norm(along[:, None] - land, axis=2).min()
    certified = float(between(first, last, gap))
    assert certified <= true + 1e-3
    # It is worth having: never below half of what is missing between the two circles.
    assert certified >= 0.5 * (first + last - gap) - 1e-3


def least_beside(first, last, gap):
    """Least distance to a segment that a place outside both circles around its ends can have."""
    angles = np.linspace(0.0, np.pi, 20_001)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = np.array([[0.0, 0.0], [gap, 0.0]])
    of_first, of_last = first * around, ends[1] + last * around
    outside = np.concatenate(
        [
            of_first[np.linalg.norm(of_first - ends[1], axis=1) >= last],
            of_last[np.linalg.norm(of_last, axis=1) >= first],
        ]
    )
    beyond = outside[:, 0] - np.clip(outside[:, 0], 0.0, gap)
    return np.hypot(beyond, outside[:, 1]).min()


@pytest.mark.usefixtures("x64")
def test_two_circles_that_meet_certify_all_that_they_cover():
    """A twin by brute force, for all distances that a chart can have: they differ by the gap at most."""
    rng = np.random.default_rng(2)
    gap = rng.uniform(1.0, 60.0, 200)
    first = rng.uniform(0.5, 80.0, 200)
    last = first + rng.uniform(-1.0, 1.0, 200) * gap
    last[::4] = gap[::4] - first[::4] + rng.uniform(0.05, 2.0, 50)  # circles that hardly meet
    usual = (first + last > gap) & (last > 0.0) & (np.abs(first - last) < gap)
    assert usual.sum() > 100
    first, last, gap = first[usual], last[usual], gap[usual]
    certified = np.asarray(between(first, last, gap))
    expected = [least_beside(*row) for row in zip(first, last, gap, strict=True)]
    np.testing.assert_allclose(certified, expected, atol=0.02)


def test_circles_that_only_touch_certify_next_to_nothing():
    """In single precision too, where rounding decides whether they meet."""
    rng = np.random.default_rng(3)
    first, last = rng.uniform(1.0, 100.0, (2, 20_000)).astype(np.float32)
    for gap in (first + last, np.nextafter(first + last, np.float32(0.0))):
        certified = np.asarray(between(first, last, gap))
        assert (certified < 0.5).all()


#: A sphere's growth, m/s, where it ends, m, when it was seen, s, and by how much it has grown at 50 s, m, and
#: how fast it grows then, m/s.
GROWN = [
    (0.2, 60.0, 0.0, 10.0, 0.2),
    (2.0, 60.0, 0.0, 60.0, 0.0),
    (0.2, 60.0, 100.0, 0.0, 0.0),  # seen later
    (0.2, 60.0, 49.5, 0.1, 0.2),
    (0.0, 60.0, 0.0, 0.0, 0.0),
]


@pytest.mark.parametrize(("growth", "most", "seen", "grown", "rate"), GROWN)
@pytest.mark.usefixtures("x64")
def test_boundaries_grow_from_the_look_to_the_end_of_a_segment(growth, most, seen, grown, rate):
    """A sphere of 10 m that lies 100 m beside the middle of a way that lasts from 20 s to 50 s."""
    one = ap.Obstacles.create([[0.0, 100.0, 20.0]], [10.0], growth=growth, growth_max=most, observed_at=seen)
    found, slopes = beside(one)
    assert float(found) == pytest.approx(90.0 - grown, abs=1e-4)
    np.testing.assert_allclose(slopes, [-rate, -rate], atol=1e-6)


@pytest.mark.usefixtures("x64")
def test_a_sphere_that_is_not_there_is_far_away():
    one = ap.Obstacles.create([[0.0, 100.0, 20.0]], [10.0])
    assert float(beside(replace(one, active=jnp.zeros(1, bool)))[0]) == np.inf


@jax.jit
def beside(spheres):
    """Clearance of a way of 60 m past spheres, and its slopes along its beginning and duration."""

    def clear(begin, lasts):
        place, way = ((jnp.asarray([value]) for value in values) for values in ((-30, 0, 20), (60, 0, 0)))
        segments = tuple(map(jnp.float64, place)), tuple(map(jnp.float64, way)), begin[None], lasts[None]
        env = ap.Environment(None, None, spheres, (-500, -500, -500), (500, 500, 500))
        return clearance.obstacle_clearance(segments, env)[0]

    return jax.value_and_grad(clear, argnums=(0, 1))(jnp.float64(20.0), jnp.float64(30.0))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
@pytest.mark.usefixtures("x64")
def test_spheres_are_passed_at_their_nearest(seed):
    rng = np.random.default_rng(seed)
    observed = rng.uniform(-40.0, 15.0)
    spheres = ap.Obstacles.create(
        rng.uniform(-200, 200, (3, 3)),
        rng.uniform(5, 50, 3),
        velocity=rng.uniform(-3, 3, (3, 3)),
        growth=0.2,
        observed_at=observed,
    )
    env = ap.Environment(None, None, spheres, (-500, -500, -500), (500, 500, 500))
    start, step, begin, lasts = rng.uniform(-200, 200, 3), rng.uniform(-60, 60, 3), 20.0, rng.uniform(1, 30)

    def planes(values):
        return tuple(np.array([[value]]) for value in values)

    segments = planes(start), planes(step), np.array([[begin]]), np.array([[lasts]])
    found = passed(segments, env)
    share = np.linspace(0.0, 1.0, 401)[:, None]
    times = begin + share * lasts
    centres = np.asarray(spheres.position) + np.asarray(spheres.velocity) * (times - observed)[..., None]
    away = np.linalg.norm((start + share * step)[:, None] - centres, axis=2)
    true = (away - np.asarray(spheres.boundary(jnp.asarray(times)))).min()
    assert float(found[0, 0]) <= true + 1e-3
    assert float(found[0, 0]) >= true - 0.2 * lasts - 0.5  # growth within the segment, and the grid of times


def test_no_pixel_of_land_is_nearer_than_certified():
    """Along a rough coast, where interpolation errs most; and not for want of a promise."""
    rng = np.random.default_rng(5)
    land = rng.random((40, 40)) < 0.05
    chart = ap.Chart.from_mask(~land, pixel_size=4.0)
    places = rng.uniform(0.0, 160.0, (4000, 2))
    beside = np.abs(places[:, None] - 4.0 * (np.argwhere(land) + 0.5)) - 2.0
    true = np.linalg.norm(np.maximum(beside, 0.0), axis=2).min(axis=1)
    certified = np.asarray(land_within(chart, *places.T))
    assert (certified <= true + 1e-4).all()
    assert np.median((true - certified)[true > 4.0]) < 2.0


def lines(seed, count=7, samples=12):
    """Random lines over the chart with the island: samples [S, P] m, their gaps and durations."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(300.0, 1700.0, (2, 2, count))
    x, y = (np.linspace(*ends[:, axis], samples) for axis in range(2))
    gap = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0))
    return x, y, gap, rng.uniform(5.0, 60.0, gap.shape)


@pytest.mark.usefixtures("x64")
def test_uncertain_areas_cost_what_they_lack_of_passability_by_the_time_spent_there():
    chart, config = chart_with_island(), CONFIG.replace(uncertain_price=3.0)
    x, y, gap, duration = map(jnp.asarray, lines(0))
    env = SimpleNamespace(chart=chart)
    clear, price = clearance.coast_clearance(x, y, gap, duration, env, config)
    lacks = 1.0 - np.asarray(chart.passability_at(x, y))
    by_hand = [
        sum(3.0 * 0.5 * (lacks[k, p] + lacks[k + 1, p]) * float(duration[k, p]) for k in range(len(gap)))
        for p in range(gap.shape[1])
    ]
    assert min(by_hand) < 0.5 * max(by_hand)
    np.testing.assert_allclose(price, by_hand, rtol=1e-6)
    away = np.hypot(np.asarray(x) - 900.0, np.asarray(y) - 1050.0) - 200.0
    assert (np.asarray(clear) <= np.minimum(away[:-1], away[1:]) + 10.0).all()
    far, nothing = clearance.coast_clearance(x, y, gap, duration, SimpleNamespace(chart=None), config)
    assert (far == np.inf).all()
    assert nothing.shape == price.shape
    assert not nothing.any()


@pytest.mark.usefixtures("x64")
def test_closed_areas_are_kept_clear_of_while_they_are_closed_alone():
    chart = chart_with_island()
    x, y, gap, duration = map(jnp.asarray, lines(1))
    times = jnp.concatenate([jnp.zeros((1, gap.shape[1])), jnp.cumsum(duration, axis=0)])
    closure = Closure(chart, np.array([100.0]), np.array([200.0]))
    env = SimpleNamespace(chart=chart, closures=(closure,))
    found = clearance.closed_clearance(x, y, gap, times, env)
    coast, _ = clearance.coast_clearance(x, y, gap, duration, env, CONFIG)
    meets = (np.asarray(times)[1:] > 100.0) & (np.asarray(times)[:-1] < 200.0)
    assert meets.any()
    assert not meets.all()
    np.testing.assert_allclose(found, np.where(meets, coast, np.inf))


class Bed:
    """A sea bed that covers nothing but its samples, and keeps what it was asked."""

    reach = (0.0, 50.0)

    def __init__(self, depth):
        self._depth = depth

    def shallowest_at(self, x, y, longer):
        self.asked = longer
        return self._depth


@pytest.mark.usefixtures("x64")
def test_altitude_of_a_segment_is_that_of_its_halves_over_their_ends():
    """A naive twin: a half is no deeper than its deeper end, over the bed at the segment's end."""
    rng = np.random.default_rng(0)
    for span in (20.0, 200.0, 4000.0):  # the longest look-ups are those of the straight line, or the bed's
        z, depth = (rng.uniform(0.0, most, (9, 5)) for most in (50.0, 80.0))
        even = np.linspace(0.0, span, 9)[:, None]
        x, y = (even * rng.uniform(0.5, 1.5, (1, 5)) + rng.uniform(0.0, 0.03 * span, (9, 5)) for _ in "xy")
        gap = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0))
        bed = Bed(depth)
        env = SimpleNamespace(seabed=bed)
        found = clearance.bed_altitude(*map(jnp.asarray, (x, y, z, gap)), env)
        usual = np.minimum(1.5 * np.hypot(x[-1] - x[0], y[-1] - y[0]) / 8, 100.0)
        for k in range(8):
            middle = 0.5 * (z[k] + z[k + 1])
            first, last = depth[k] - np.maximum(z[k], middle), depth[k + 1] - np.maximum(middle, z[k + 1])
            np.testing.assert_allclose(found[k], np.minimum(first, last))
        for k in range(9):
            longest = np.maximum(gap[max(k - 1, 0)], gap[min(k, 7)])
            np.testing.assert_allclose(bed.asked[k], np.maximum(longest, usual))


def _slope(fun, at, step=1e-5):
    return (fun(at + step) - fun(at - step)) / (2 * step)


@settings(max_examples=40, deadline=None)
@given(st.floats(-60.0, 90.0), st.floats(-60.0, 90.0), st.floats(1.0, 80.0))
@pytest.mark.usefixtures("x64")
def test_slopes_between_two_circles_match_finite_differences(first, last, gap):
    at = np.array([first, last, gap])
    slopes = between_slopes(*at)
    for slope, unit in zip(slopes, np.eye(3), strict=True):

        def along(d, unit=unit):
            return float(between(*at + d * unit))

        below, above = _slope(along, -1e-4), _slope(along, 1e-4)
        assume(abs(below - above) < 1e-3 * (1.0 + abs(above)))  # a kink has no slope
        assert float(slope) == pytest.approx(0.5 * (below + above), rel=1e-2, abs=1e-3)


@pytest.mark.usefixtures("x64")
def test_slopes_past_moving_spheres_match_finite_differences():
    rng = np.random.default_rng(4)
    spheres = ap.Obstacles.create(
        rng.uniform(-200, 200, (5, 3)), rng.uniform(5, 50, 5), velocity=rng.uniform(-3, 3, (5, 3)), growth=0.2
    )
    env = ap.Environment(None, None, spheres, (-500, -500, -500), (500, 500, 500))
    values = np.concatenate([rng.uniform(-200, 200, 3), rng.uniform(-60, 60, 3), [20.0, 15.0]])

    @jax.jit
    def clear(values, env):
        x, y, z, dx, dy, dz, begin, lasts = (value[None] for value in values)
        return clearance.obstacle_clearance(((x, y, z), (dx, dy, dz), begin, lasts), env)[0]

    slopes = jax.jit(jax.grad(clear))(jnp.asarray(values), env)
    for k in range(8):
        unit = np.eye(8)[k]
        difference = _slope(lambda d, u=unit: float(clear(jnp.asarray(values + d * u), env)), 0.0)
        assert float(slopes[k]) == pytest.approx(difference, rel=1e-5, abs=1e-6)
    # By the spheres as well, through the general rule.
    joint = jax.grad(clear, argnums=(0, 1), allow_int=True)(jnp.asarray(values), env)
    np.testing.assert_allclose(joint[0], slopes, rtol=1e-9)
    np.testing.assert_allclose(joint[1].obstacles.position.sum(axis=0), -slopes[:3], rtol=1e-9)
