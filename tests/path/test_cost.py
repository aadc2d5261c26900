"""Path cost (Eqs 10-12) against a naive NumPy twin, closed forms and finite differences."""

from dataclasses import replace
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import auvplan as ap
from auvplan.path import VIOLATIONS, habitats
from auvplan.path import cost as kernel
from auvplan.path.bspline import basis_at
from auvplan.path.cost import CLEARANCE_SCALE
from auvplan.path.kinematics import angle_between
from auvplan.path.motion import Motion
from tests.path import kernels
from tests.path.kernels import (
    Jet,
    curves,
    evaluate,
    judged_within,
    score,
    soft_objective,
    through,
    violations,
)
from tests.path.worlds import GOAL, START, world

CONFIG = ap.PathConfig(control_points=16, samples=48)


def population(count, env, seed=0):
    return kernels.population(count, START, GOAL, env, CONFIG, seed)


@jax.jit
def resolved(env):
    return replace(env, obstacles=env.obstacles.resolved(env.current))


def naive_between(first, last, gap):
    """Least distance on a segment to what lies outside both circles around its ends."""
    if first + last <= gap:
        return 0.5 * (first + last - gap)
    meet = (first**2 - last**2 + gap**2) / (2 * gap)
    if 0 < meet < gap:
        return min(np.sqrt(first**2 - meet**2), first, last)
    return min(first, last)


def naive_steepness(down, sinking, vehicle):
    """Excess of pitch, climb and dive from the vertical speeds of vehicle and water over ground."""
    found = [0.0, 0.0, 0.0]
    if vehicle.pitch_max is not None:
        pitch = np.arcsin(np.clip((down - sinking) / vehicle.speed, -1, 1))
        found[0] = max(abs(np.sin(pitch)) / np.sin(vehicle.pitch_max) - 1, 0)
    for k, (speed, limit) in enumerate(((-down, vehicle.climb_rate_max), (down, vehicle.dive_rate_max)), 1):
        if limit is not None:
            found[k] = max(speed / limit - 1, 0)
    return found


at_place = jax.jit(lambda env, *at: jnp.stack(env.current(*at)))
to_land = jax.jit(lambda chart, *place: chart.distance(*place))


def naive_flight(habitat, env, vehicle, depart, config):
    """One path, segment by segment, in plain Python."""
    free = config.control_points
    points = np.vstack([START, np.asarray(habitat).reshape(3, free).T, GOAL])
    path = basis_at(np.linspace(0, 1, config.samples), free + 2, config.degree) @ points
    t, times, excess, last = depart, [depart], [], None
    for a, b in pairwise(path):
        step = b - a
        gap = np.linalg.norm(step)
        water = np.asarray(at_place(env, *0.5 * (a + b), t), float)
        along = water @ step / gap
        across = np.linalg.norm(water - along * step / gap)
        raw = along + np.sqrt(max(vehicle.speed**2 - across**2, (0.05 * vehicle.speed) ** 2))
        ground = max(raw, 0.05 * vehicle.speed)
        lasts = gap / ground
        yaw = np.arctan2(step[1], step[0])
        turn = 0.0
        if last is not None:
            angle = abs((yaw - last[0] + np.pi) % (2 * np.pi) - np.pi)
            turn = angle / (0.5 * (lasts + last[1]))
        coast = np.inf
        if env.chart is not None:
            ends = [float(to_land(env.chart, *p[:2])) - 0.2 * float(env.chart.pixel_size) for p in (a, b)]
            coast = naive_between(*ends, np.linalg.norm(step[:2]))
        clear = np.inf
        o = env.obstacles
        for m in range(len(o)):
            velocity, since = np.asarray(o.velocity[m]), t - float(o.observed_at[m])
            first = a - np.asarray(o.position[m]) - velocity * since
            last_end = b - np.asarray(o.position[m]) - velocity * (since + lasts)
            share = np.clip(-first @ (last_end - first) / np.sum((last_end - first) ** 2), 0, 1)
            near = np.linalg.norm(first + share * (last_end - first))
            clear = min(clear, near - float(o.boundary(jnp.asarray(t + lasts))[m]))
        excess.append(
            [
                max(ground / vehicle.surge_max - 1, 0),
                max(across / vehicle.sway_max - 1, 0),
                max(turn / vehicle.turn_rate_max - 1, 0),
                max(config.coast_margin - coast, 0) / CLEARANCE_SCALE,
                max(config.obstacle_margin - clear, 0) / CLEARANCE_SCALE,
                max(0.05 - raw / vehicle.speed, 0),
                0.0,
                *naive_steepness(step[2] / lasts, water[2], vehicle),
            ]
        )
        t, last = t + lasts, (yaw, lasts)
        times.append(t)
    return path, np.array(times), np.array(excess).T


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(
    ("chart", "obstacles", "vertical"),
    [
        (True, True, {"pitch_max": 0.03, "climb_rate_max": 0.01, "dive_rate_max": 0.1}),
        (False, False, {"pitch_max": None, "dive_rate_max": 0.1}),
    ],
)
def test_kernel_matches_naive_twin(chart, obstacles, vertical):
    env = resolved(world(chart, obstacles))
    vehicle = ap.Vehicle(surge_max=3.0, sway_max=0.5, turn_rate_max=0.005, **vertical)
    habitats_ = population(4, env)
    trajectory = evaluate(curves(habitats_, START, GOAL, CONFIG), 100.0, env, vehicle, CONFIG)
    for p in range(4):
        path, times, excess = naive_flight(habitats_[p], env, vehicle, 100.0, CONFIG)
        np.testing.assert_allclose(
            np.stack([trajectory.x[:, p], trajectory.y[:, p], trajectory.z[:, p]], axis=1), path, atol=1e-8
        )
        np.testing.assert_allclose(trajectory.times[:, p], times, rtol=1e-7)
        # float32 chart and 1e-8 guards
        np.testing.assert_allclose(np.stack(trajectory.excess)[:, :, p], excess, rtol=1e-5, atol=1e-4)
    broken = np.asarray(violations(trajectory)).any(axis=1)[-3:]
    assert list(broken) == [
        vertical.get(f"{name}_max") is not None for name in ("pitch", "climb_rate", "dive_rate")
    ]


SLOPE = st.floats(-80.0, 80.0)


@given(
    SLOPE, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(5.0, 90.0),
    st.sampled_from(["track", "eq8", "eq11"]),
)  # fmt: skip
@settings(deadline=None, max_examples=30)
def test_pitch_is_that_of_the_hull(slope, along, sinking, most, reading):
    """A straight dive or climb in a current: the limit is on what `Motion` says of the hull."""
    way = np.array([np.cos(np.radians(slope)), 0.0, np.sin(np.radians(slope))])
    places = np.linspace(0.0, 800.0, 5)[:, None] * way
    env = ap.Environment(ap.UniformCurrent(along, 0.0, sinking), None, None, (-1, -1, -900), (900, 1, 900))
    config, vehicle = CONFIG.replace(speed_reading=reading), ap.Vehicle(pitch_max=np.radians(most))
    track = through(*(axis[:, None] for axis in places.T))
    trajectory = evaluate(track, 0.0, env, vehicle, config)
    hull = Motion.along(reading, 2.5, np.diff(places, axis=0), np.tile([along, 0.0, sinking], (4, 1)))
    expected = np.maximum(np.abs(np.sin(hull.pitch)) / np.sin(np.radians(most)) - 1.0, 0.0)
    found = np.asarray(trajectory.excess[VIOLATIONS.index("pitch")])[:, 0]
    np.testing.assert_allclose(found, expected, atol=2e-5)


def test_limits_that_a_vehicle_does_not_have_cost_nothing():
    env, many = resolved(world()), population(6, resolved(world()))

    def run(**limits):
        vehicle = ap.Vehicle(**limits)
        compiled = score.lower(many, START, GOAL, 0.0, env, vehicle, CONFIG).compile()
        return compiled(many, START, GOAL, 0.0, env, vehicle), compiled.cost_analysis()["flops"]

    (free, work), (loose, more) = run(pitch_max=None), run(pitch_max=0.5 * np.pi, dive_rate_max=9.0)
    np.testing.assert_array_equal(free, loose)
    assert work < more


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("reading", ["track", "eq8", "eq11"])
def test_slopes_of_limits_in_the_vertical_are_those_of_differences(reading):
    env = resolved(world(obstacles=False, chart=False))
    config = CONFIG.replace(speed_reading=reading)
    habitat = np.asarray(population(3, env, seed=4))[2]

    def broken(habitat, pitch, climb, dive):
        track = kernel.curves(habitat[None], START, GOAL, config)
        vehicle = ap.Vehicle(pitch_max=pitch, climb_rate_max=climb, dive_rate_max=dive)
        return kernel.violations(kernel.evaluate(track, 0.0, env, vehicle, config))[-3:, 0].sum()

    broken, at = jax.jit(broken), (habitat, 0.02, 0.01, 0.05)
    slopes = jax.jit(jax.grad(broken, argnums=(0, 1, 2, 3)))(*at)
    for d in range(0, habitat.size, 5):
        fd = _difference(lambda v, d=d: broken(_with(habitat, d, v), *at[1:]), habitat[d], 1e-4)
        np.testing.assert_allclose(slopes[0][d], fd, rtol=1e-3, atol=1e-6)
    for arg in (1, 2, 3):
        fd = _difference(lambda v, a=arg: broken(*(v if k == a else at[k] for k in range(4))), at[arg], 1e-7)
        np.testing.assert_allclose(slopes[arg], fd, rtol=1e-3)
        assert fd < 0.0


@pytest.mark.parametrize(
    ("stream", "speed_over_ground"),
    [((0.0, 0.0), 2.5), ((1.0, 0.0), 3.5), ((-1.0, 0.0), 1.5), ((0.0, 1.5), 2.0)],
)
@pytest.mark.usefixtures("x64")
def test_straight_path_takes_the_closed_form_time(stream, speed_over_ground):
    start, goal = jnp.array([0.0, 0.0, 10.0]), jnp.array([3000.0, 0.0, 10.0])
    env = ap.Environment(ap.UniformCurrent(*stream), None, None, (-10, -10, 0), (3010, 10, 20))
    line = habitats.straight_line(start, goal, CONFIG)[None]
    cost, violation = score(line, start, goal, 0.0, env, ap.Vehicle(sway_max=2.0), CONFIG)
    assert float(cost[0]) == pytest.approx(3000.0 / speed_over_ground, rel=1e-8)
    assert float(violation[0]) == 0.0


@pytest.mark.usefixtures("x64")
def test_arrival_times_settle_in_a_changing_current():
    # u = a t along a straight track: x(t) = V t + a t^2 / 2.
    start, goal = jnp.array([0.0, 0.0, 0.0]), jnp.array([2000.0, 0.0, 0.0])
    env = ap.Environment(lambda x, y, z, t: (1e-3 * t, 0.0, 0.0), None, None, (-1, -1, 0), (2001, 1, 0))
    line = habitats.straight_line(start, goal, CONFIG)[None]
    exact = (-2.5 + np.sqrt(2.5**2 + 2 * 1e-3 * 2000.0)) / 1e-3
    errors = []
    for samples in (33, 129):
        config = CONFIG.replace(samples=samples)
        cost, _ = score(line, start, goal, 0.0, env, ap.Vehicle(), config)
        errors.append(abs(float(cost[0]) / exact - 1))
    assert errors[0] < 1e-4
    # Middles of segments: the error falls with the square of their length.
    assert errors[1] < 0.09 * errors[0]


def _difference(fun, x, step):
    return (fun(x + step) - fun(x - step)) / (2 * step)


def _with(values, index, value):
    values = np.array(values)
    values[index] = value
    return values


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(
    ("reading", "quadrature"),
    [
        ("track", None),
        pytest.param("eq8", None, marks=pytest.mark.slow),
        pytest.param("eq11", None, marks=pytest.mark.slow),
        pytest.param("track", 2, marks=pytest.mark.slow),
    ],
)
def test_gradients_match_finite_differences(reading, quadrature):
    env = world()
    config = CONFIG.replace(speed_reading=reading, quadrature=quadrature)
    habitat = np.asarray(population(3, env, seed=2))[1]

    def cost(habitat, speed, depart, strength):
        moved = replace(env, current=env.current.scaled(strength))
        seen = replace(moved, obstacles=env.obstacles.resolved(moved.current))
        return score(habitat[None], START, GOAL, depart, seen, ap.Vehicle(speed=speed), config)[0][0]

    cost, at = jax.jit(cost), (habitat, 2.5, 30.0, 1.0)
    slopes = jax.jit(jax.grad(cost, argnums=(0, 1, 2, 3)))(*at)
    # Alone, the habitat's slopes are found by the shorter rules of currents, chart and obstacles.
    np.testing.assert_allclose(jax.jit(jax.grad(cost))(*at), slopes[0], rtol=1e-9, atol=1e-9)
    for d in range(0, habitat.size, 5):
        fd = _difference(lambda v, d=d: cost(_with(habitat, d, v), *at[1:]), habitat[d], 1e-4)
        np.testing.assert_allclose(slopes[0][d], fd, rtol=2e-4, atol=1e-4)
    for arg, step in ((1, 1e-6), (2, 1e-3), (3, 1e-6)):
        fd = _difference(lambda v, a=arg: cost(*(v if k == a else at[k] for k in range(4))), at[arg], step)
        np.testing.assert_allclose(slopes[arg], fd, rtol=2e-4, atol=1e-4)


@pytest.mark.parametrize("quadrature", [None, 2])
def test_gradients_are_finite_at_awkward_places(quadrature):
    # Coinciding control points (zero-length segments), a path through a vortex centre, a current that wins.
    start, goal = jnp.array([0.0, 0.0, 0.0]), jnp.array([1000.0, 0.0, 0.0])
    strong = ap.LambVortices([[[500.0, 0.0]]], [[9000.0]], [[200.0]])
    env = ap.Environment(
        strong, None, ap.Obstacles.static([[0.0, 0.0, 0.0]], [10.0]), (-500, -500, 0), (1500, 500, 0)
    )
    vehicle = ap.Vehicle(climb_rate_max=1.0, dive_rate_max=1.0)
    config = CONFIG.replace(quadrature=quadrature)
    slope = jax.jit(jax.grad(lambda h: score(h[None], start, goal, 0.0, env, vehicle, config)[0][0]))
    for habitat in (jnp.zeros(3 * CONFIG.control_points), habitats.straight_line(start, goal, CONFIG)):
        assert np.isfinite(slope(habitat)).all()


@pytest.mark.slow
def test_a_large_population_is_scored_in_parts():
    env = resolved(world())
    many = population(1203, env)
    cost, violation = score(many, START, GOAL, 0.0, env, ap.Vehicle(), CONFIG)
    for part in (slice(0, 300), slice(900, 1203)):
        few = score(many[part], START, GOAL, 0.0, env, ap.Vehicle(), CONFIG)
        np.testing.assert_allclose(cost[part], few[0], rtol=1e-4)
        np.testing.assert_allclose(violation[part], few[1], rtol=1e-3, atol=1e-6)


def test_guide_is_judged_by_the_score_and_is_less_stiff():
    env = resolved(world())
    many = population(6, env)
    aim, judged = soft_objective(many, START, GOAL, 0.0, env, ap.Vehicle(), CONFIG)
    cost, violation = score(many, START, GOAL, 0.0, env, ap.Vehicle(), CONFIG)
    np.testing.assert_allclose(judged[0], cost, rtol=1e-6)
    np.testing.assert_allclose(judged[1], violation, rtol=1e-6)
    trajectory = evaluate(curves(many, START, GOAL, CONFIG), 0.0, env, ap.Vehicle(), CONFIG)
    bare = trajectory.travel_time + trajectory.price
    broken = np.asarray(violation) > 0.05
    assert broken.any()
    # Penalties are there, but a small share of those of the cost.
    assert (np.asarray(aim - bare)[broken] > 0.0).all()
    assert (np.asarray(aim - bare)[broken] < 0.05 * np.asarray(cost - bare)[broken]).all()


def test_the_guide_meets_a_current_that_turns_within_a_segment():
    """A dive of 20 degrees in still water that ends in a stream: as steep as that in it, it would be 32."""

    def current(x, y, z, t):
        return jnp.where(z > 35.9, 1.5, 0.0), 0.0 * x, 0.0 * x

    env = ap.Environment(current, None, None, (-1, -1, -1), (500, 1, 100))
    config = ap.PathConfig(control_points=3, degree=1, samples=5)  # its samples are its control points
    start, goal = jnp.array([0.0, 0.0, 0.0]), jnp.array([400.0, 0.0, 36.0])
    dive = jnp.array([[100.0, 200.0, 300.0, 0.0, 0.0, 0.0, 36.0, 36.0, 36.0]])
    for pitch_max, charged in ((np.radians(30.0), True), (np.radians(33.0), False), (None, False)):
        vehicle = ap.Vehicle(pitch_max=pitch_max)
        aim, (cost, violation) = soft_objective(dive, start, goal, 0.0, env, vehicle, config)
        assert float(violation[0]) == 0.0
        assert bool(aim[0] > 1.0001 * cost[0]) is charged


def test_coast_is_forbidden_and_shoals_are_priced():
    env = world(obstacles=False)
    start, goal = jnp.array([900.0, 200.0, 10.0]), jnp.array([900.0, 1900.0, 10.0])
    line = habitats.straight_line(start, goal, CONFIG)[None]
    trajectory = evaluate(curves(line, start, goal, CONFIG), 0.0, env, ap.Vehicle(), CONFIG)
    broken = dict(zip(VIOLATIONS, violations(trajectory)[:, 0], strict=True))
    assert broken["coast"] > 0
    assert broken["obstacle"] == 0
    aside = line.at[0, : CONFIG.control_points].set(1160.0)  # passes over the shoal, clear of the island
    over = evaluate(curves(aside, start, goal, CONFIG), 0.0, env, ap.Vehicle(), CONFIG)
    assert float(over.excess[VIOLATIONS.index("coast")].max()) == 0.0
    unpriced = CONFIG.replace(uncertain_price=0.0)
    free = evaluate(curves(aside, start, goal, CONFIG), 0.0, env, ap.Vehicle(), unpriced)
    assert float(over.price[0]) > 0.0 == float(free.price[0])


_SIDE = st.floats(-100.0, 100.0)


@settings(deadline=None, max_examples=40)
@given(_SIDE, _SIDE, _SIDE, _SIDE)
def test_turns_are_the_angle_between_segments(ax, ay, bx, by):
    short, long = sorted([np.hypot(ax, ay), np.hypot(bx, by)])
    angle, slopes = _angle_of_turn(jnp.array([ax, ay, bx, by]))
    assert 0.0 <= angle <= np.float32(np.pi)
    assert np.isfinite(slopes).all()
    if short * long > 1.0:
        assert angle == pytest.approx(abs(np.angle(complex(bx, by) / complex(ax, ay))), abs=1e-3)


@pytest.mark.parametrize("after", [(-30.0, 0.0), (0.0, 0.0), (-1e-3, 1e-4), (-30.0, 1e-6), (30.0, 0.0)])
def test_turns_at_cusps_have_finite_slopes(after):
    angle, slopes = _angle_of_turn(jnp.array([30.0, 0.0, *after]))
    assert 0.0 <= angle <= np.float32(np.pi)
    assert np.isfinite(slopes).all()
    if after[0] <= -30.0:
        assert angle == pytest.approx(np.pi, abs=1e-6)


@pytest.mark.usefixtures("x64")
def test_slopes_of_turns_are_those_of_differences():
    for ways in ([30.0, 5.0, -20.0, 1.0], [3.0, 5.0, 2.0, -9.0], [0.01, 0.0, 0.004, 0.01]):
        ways = jnp.array(ways)
        slopes = _angle_of_turn(ways)[1]
        for k, step in enumerate(1e-6 * np.eye(4)):
            ends = [_angle_of_turn(ways + sign * step)[0] for sign in (1.0, -1.0)]
            # the polynomial for the arctangent has slopes of its own
            assert slopes[k] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-5 * np.abs(slopes).max())


@jax.jit
def _angle_of_turn(ways):
    def angle(ways):
        ax, ay, bx, by = ways
        return angle_between(ax * by - ay * bx, ax * bx + ay * by)

    return jax.value_and_grad(angle)(ways)


def test_costs_of_cusps_keep_their_digits():
    """Single precision against double, on wild paths far from the origin, with segments of centimetres."""
    env = resolved(world())
    wild = np.array(population(100, env))
    wild[:, 5] = wild[:, 4] - 300.0  # a loop or a cusp on every path
    with_cusps = (wild, START, GOAL, 0.0, env, ap.Vehicle())
    costs = {}
    for bits, real in ((32, np.float32), (64, np.float64)):
        with jax.enable_x64(bits == 64):
            given = jax.tree.map(lambda leaf, real=real: _as_real(leaf, real), with_cusps)
            costs[bits] = np.asarray(score(*given, CONFIG)[0], float)
    np.testing.assert_allclose(costs[32], costs[64], rtol=1e-5)


def _as_real(leaf, real):
    leaf = np.asarray(leaf)
    return leaf.astype(real) if np.issubdtype(leaf.dtype, np.floating) else leaf


@pytest.mark.parametrize(
    ("limit", "jet", "excess"),
    [
        ("sway", (0.0, 1.8, 0.0), 1.8 / 1.5 - 1.0),
        ("sway", (0.0, 1.504, 0.0), 0.0),  # a quarter of a per cent is let pass
        ("surge", (2.0, 0.0, 0.0), 4.5 / 4.0 - 1.0),
        ("pitch", (0.0, 0.0, 1.4), 1.4 / 1.25 - 1.0),  # a level way, and the nose up against a downdraught
    ],
)
def test_a_jet_that_all_middles_miss_is_seen_when_the_path_is_judged(limit, jet, excess):
    """Four segments of 100 m, and a jet 20 m wide across a quarter of the second one."""
    env = ap.Environment(Jet(jet, 125.0, 10.0), None, None, (-500, -500, 0), (500, 500, 100))
    vehicle, config = ap.Vehicle(surge_max=4.0, sway_max=1.5), ap.PathConfig()
    x = np.arange(5.0)[:, None] * 100.0
    trajectory = evaluate(through(x, 0.0 * x, 0.0 * x), 0.0, env, vehicle, config)
    assert not violations(trajectory).any()
    judged = judged_within(trajectory, env, vehicle, config)
    broken = np.asarray(judged.excess[VIOLATIONS.index(limit)])[:, 0]
    np.testing.assert_allclose(broken, [0.0, excess, 0.0, 0.0], atol=1e-5)
    assert float(violations(judged).sum()) == pytest.approx(excess / 4.0, abs=1e-5)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(("changing", "reading"), [(True, "track"), (False, "eq8")])
def test_current_met_at_several_places_is_that_of_shorter_segments(changing, reading):
    """Quarters of straight segments, each met in its middle, one after the other."""

    def current(x, y, z, t):
        tide = jnp.cos(t / 4000.0) if changing else 1.0
        return 0.9 * jnp.tanh((z - 20.0) / 2.0) * tide, 0.4 * jnp.sin(x / 150.0), 0.05 * tide + 0.0 * x

    env = ap.Environment(current, None, None, (-500, -500, 0), (2500, 500, 100))
    vehicle, rng = ap.Vehicle(1.8, pitch_max=0.3), np.random.default_rng(3)
    corners = np.stack([np.linspace(0, 2000, 9), rng.normal(0, 60, 9), rng.uniform(0, 60, 9)], axis=1)
    marks = np.arange(33) / 4.0
    quarters = np.stack([np.interp(marks, np.arange(9), axis) for axis in corners.T], axis=1)

    def followed(points, count):
        config = ap.PathConfig(quadrature=count, speed_reading=reading)
        return evaluate(through(*points.T[:, :, None]), 0.0, env, vehicle, config)

    often, short = followed(corners, 4), followed(quarters, None)
    np.testing.assert_allclose(often.times[:, 0], short.times[::4, 0], rtol=1e-3 if changing else 1e-9)
    for limit in ("sway", "pitch"):
        index = VIOLATIONS.index(limit)
        worst = np.asarray(short.excess[index][:, 0]).reshape(8, 4).max(axis=1)
        np.testing.assert_allclose(often.excess[index][:, 0], worst, atol=2e-2 if changing else 1e-9)
    once = followed(corners, None)
    assert abs(float(once.travel_time[0] / short.travel_time[0]) - 1.0) > 0.02, "the middles alone are wrong"
