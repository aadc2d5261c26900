"""Paths of vehicles that dead-reckon: margins as certified, and the risk of contact against drawn errors."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.navigation import Navigation
from auvplan.path.risk import contact_bound, exposed
from auvplan.runtime.compiled import compilations
from tests.path.kernels import evaluate, score, through
from tests.path.worlds import CONFIG, GOAL, LOWER, START, UPPER

KNOWN = Navigation(drift=0.02, current_error=0.03, fix=5.0)


def sea(**more) -> ap.Environment:
    """An island on the straight line, and an obstacle that leaves a passage beside it."""
    north, east = np.meshgrid(*(np.arange(200) * 10.0 + 5.0,) * 2, indexing="ij")
    island = ap.Chart.from_mask(np.hypot(north - 1000.0, east - 950.0) > 200.0, pixel_size=10.0)
    obstacle = ap.Obstacles.static([[900.0, 1450.0, 50.0]], [60.0])
    given = {"chart": island, "obstacles": obstacle, "lower": LOWER, "upper": UPPER} | more
    return ap.Environment(ap.UniformCurrent(0.3, 0.2), **given)


def plan(known: Navigation) -> ap.PathPlan:
    vehicle = ap.Vehicle(navigation=known)
    return ap.plan_path(START, GOAL, sea(), vehicle, key=jax.random.key(1), config=CONFIG)


@pytest.fixture(scope="module")
def found() -> ap.PathPlan:
    return plan(KNOWN)


def test_nothing_uncertain_changes_no_bit():
    env, vehicle = sea(), ap.Vehicle()
    exact = replace(vehicle, navigation=Navigation(confidence=0.0))
    habitats = jax.random.uniform(jax.random.key(2), (16, 3 * CONFIG.control_points), maxval=2000.0)
    scored = [score(habitats, START, GOAL, 0.0, env, one, CONFIG) for one in (vehicle, exact)]
    np.testing.assert_array_equal(*(np.asarray(part[0]) for part in scored))
    assert len(jax.tree.leaves(vehicle)) == len(jax.tree.leaves(exact)) - 6


def test_margins_are_wider_all_along(found):
    assert found.feasible
    met = exposed(found)
    assert met is not None
    margin = min(CONFIG.coast_margin, CONFIG.obstacle_margin)
    assert (met.clearance >= margin + 2.0 * met.std[1:] - 0.05).all()
    # The closed form along the path, in open water without bottom lock.
    since = np.asarray(found.times - found.times[0], float)
    expected = np.sqrt(5.0**2 + (0.02 * 2.5 * since) ** 2 + (0.03 * since) ** 2)
    np.testing.assert_allclose(met.std, expected, rtol=1e-4)
    assert found.travel_time > plan(replace(KNOWN, confidence=0.0)).travel_time


def test_excess_is_that_of_the_wider_margin(found):
    track = through(*(jnp.asarray(found.positions[:, k, None]) for k in range(3)))
    env = sea()
    env = replace(env, obstacles=env.obstacles.resolved(env.current))
    near = Navigation(drift=0.1, fix=20.0)
    exact = evaluate(track, 0.0, env, ap.Vehicle(), CONFIG)
    wide = evaluate(track, 0.0, env, ap.Vehicle(navigation=near), CONFIG)
    since = np.asarray(exact.times[1:] - exact.times[0], float)
    margin = CONFIG.coast_margin + 2.0 * np.hypot(20.0, 0.1 * 2.5 * since)
    excess = np.maximum(margin - np.asarray(exact.coast, float), 0.0) / 50.0
    assert excess.max() > 0.0
    np.testing.assert_allclose(wide.excess[3], excess, atol=1e-4)
    np.testing.assert_array_equal(wide.times, exact.times)


def test_bottom_lock_stops_the_error_of_the_current():
    north = np.arange(0.5, 200.0)[:, None] * 10.0
    depth = np.broadcast_to(np.where(north < 1000.0, 60.0, 200.0), (200, 200))
    env = sea(chart=None, obstacles=None, seabed=ap.Seabed.from_depth(depth, 10.0))
    x = np.linspace(100.0, 1900.0, 181)
    track = through(*(jnp.asarray(axis)[:, None] for axis in (x, 0.0 * x + 500.0, 0.0 * x + 30.0)))
    known = Navigation(current_error=0.1, bottom_lock=50.0)
    found = evaluate(track, 0.0, env, ap.Vehicle(navigation=known), CONFIG)
    assert found.known is not None
    std, times = np.asarray(found.known.std)[:, 0], np.asarray(found.times)[1:, 0]
    locked = x[1:] < 990.0
    assert std[locked] == pytest.approx(0.0, abs=1e-3)
    passed = times[x[1:] > 1010.0] - times[np.searchsorted(x[1:], 1000.0)]
    np.testing.assert_allclose(std[x[1:] > 1010.0], 0.1 * passed, atol=1.0)
    assert (np.diff(std) >= 0.0).all()


def test_legs_of_a_batch_have_their_own_errors_and_later_ones_compile_nothing(found):
    since = KNOWN.since(np.array([0.0, 1500.0]), np.array([0.0, 600.0]))
    common = {"key": jnp.stack([jax.random.key(1)] * 2), "config": CONFIG}
    starts, goals = np.stack([START] * 2), np.stack([GOAL] * 2)
    both = ap.plan_paths(starts, goals, sea(), ap.Vehicle(navigation=since), **common)
    np.testing.assert_allclose(both[0].positions, found.positions, atol=2.0)
    late = exposed(both[1])
    assert late is not None
    assert late.std[0] == pytest.approx(float(KNOWN.after(1500.0, 600.0).std), rel=1e-5)
    assert float(both[1].conditions.vehicle.navigation.way) == 1500.0
    assert both[1].clearance > both[0].clearance + 20.0
    before = compilations()
    plan(KNOWN.since(700.0, 300.0))
    plan(Navigation(drift=0.03, current_error=0.01, fix=2.0, confidence=1.0))
    assert compilations() == before


def contacts(found: ap.PathPlan, known: Navigation, turned: bool, draws: int = 20_000) -> float:
    """Share of drawn errors whose displaced track meets land or the obstacle; plain NumPy."""
    rng, env = np.random.default_rng(3), sea()
    times = np.asarray(found.times - found.times[0], float)
    dense = np.linspace(0.0, times[-1], 6 * len(times))
    x, y, z = (np.interp(dense, times, axis) for axis in np.asarray(found.positions, float).T)
    fix, bias, current = rng.normal(size=(3, draws, 2))
    hit = np.zeros(draws, bool)
    for k, now in enumerate(dense):
        way = 2.5 * now * bias
        if turned:  # errors of heading and scale that turn with the vehicle, in place of a steady bias
            dx, dy = x[k] - x[0], y[k] - y[0]
            way = np.stack([bias[:, 0] * dx - bias[:, 1] * dy, bias[:, 0] * dy + bias[:, 1] * dx], axis=1)
        error = known.fix * fix + known.drift * way + known.current_error * now * current
        north, east = x[k] + error[:, 0], y[k] + error[:, 1]
        inside = np.asarray(env.chart.contains(north, east))
        hit |= inside & ~np.asarray(env.chart.is_water(north, east))
        hit |= np.sqrt((north - 900.0) ** 2 + (east - 1450.0) ** 2 + (z[k] - 50.0) ** 2) < 60.0
    return float(hit.mean())


@pytest.mark.parametrize("confidence", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("turned", [False, True])
def test_no_more_contacts_than_the_risk_says(confidence, turned):
    known = replace(KNOWN, confidence=confidence)
    found = plan(known)
    met = exposed(found)
    assert met is not None
    share = contacts(found, known, turned)
    assert share <= met.risk + 3.0 * np.sqrt(met.risk * (1.0 - met.risk) / 20_000)
    if confidence == 2.0:
        assert 0.0 < met.risk < 0.5


def test_risk_by_chance_of_one_place_and_its_bounds():
    clear, std = np.full(20, 30.0), np.full(21, 10.0)
    once = np.exp(-0.5 * 3.0**2)
    assert once <= contact_bound(clear, std) <= 2.0 * once
    assert contact_bound(clear, np.linspace(5.0, 10.0, 21)) < contact_bound(clear, std)
    assert contact_bound(clear, std, turns=(5, 10)) >= contact_bound(clear, std)
    assert contact_bound(np.zeros(20), std) == 1.0
    assert contact_bound(np.full(20, np.inf), std) == 0.0
    risks = [contact_bound(np.full(20, d), std) for d in (5.0, 10.0, 20.0, 40.0)]
    assert (np.diff(risks) <= 0.0).all()


def test_a_vehicle_without_navigation_has_no_exposure(found):
    exact = replace(found.conditions, vehicle=ap.Vehicle())
    assert exposed(replace(found, conditions=exact)) is None
