"""Whole plans: safety, quality, determinism, batching, warm starts and bad input."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import auvplan as ap
from auvplan.ocean.gridded import CurrentError
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.path import plan_least_energy, planner, stages
from auvplan.path.ends import check_ends, check_water
from auvplan.path.habitats import straight_line
from auvplan.runtime.compiled import compilations
from tests.path.worlds import CONFIG, GOAL, LOWER, START, UPPER, world

#: Settings of next to no search, for paths that are straight.
STRAIGHT = CONFIG.replace(bbo=CONFIG.bbo.replace(iterations=2), passages=0, refine_steps=0, finer=1)


def dense(plan, count=3000):
    """Points every metre or less along a plan, with times."""
    share = np.linspace(0, len(plan.times) - 1, count)
    index = np.arange(len(plan.times))
    points = np.stack([np.interp(share, index, plan.positions[:, k]) for k in range(3)], axis=1)
    return points, np.interp(share, index, plan.times)


@pytest.fixture(scope="module")
def plan():
    return ap.plan_path(START, GOAL, world(), key=jax.random.key(0), config=CONFIG)


def test_plan_is_feasible_and_truly_clear(plan):
    env = world()
    assert plan.feasible
    assert plan.status is ap.PathStatus.OK
    np.testing.assert_allclose(plan.positions[[0, -1]], [START, GOAL], atol=1e-2)
    assert (plan.positions >= np.asarray(LOWER) - 1e-2).all()
    assert (plan.positions <= np.asarray(UPPER) + 1e-2).all()
    points, times = dense(plan)
    assert np.asarray(env.chart.is_water(points[:, 0], points[:, 1])).all()
    seen = env.obstacles.resolved(env.current)
    for m in range(len(seen)):
        centre = np.asarray(seen.position[m]) + np.asarray(seen.velocity[m]) * times[:, None]
        assert (np.linalg.norm(points - centre, axis=1) > float(seen.radius[m])).all()
    assert plan.travel_time == pytest.approx(plan.times[-1] - plan.times[0], rel=1e-5)


def test_same_key_same_plan_and_second_call_compiles_nothing(plan):
    env = world()
    again = ap.plan_path(START, GOAL, env, key=jax.random.key(0), config=CONFIG)
    np.testing.assert_array_equal(plan.positions, again.positions)
    compiled = compilations()
    other = ap.plan_path(START + 50.0, GOAL - 50.0, env, key=jax.random.key(2), config=CONFIG, depart=60.0)
    assert compilations() == compiled
    assert not np.array_equal(plan.positions, other.positions)


def test_batched_legs_equal_single_ones():
    env = world()
    starts = np.stack([START, START + np.array([0, 100, 0])])
    goals = np.stack([GOAL, GOAL - np.array([100, 0, 0])])
    keys = jax.random.split(jax.random.key(4), 2)
    together = ap.plan_paths(starts, goals, env, key=keys, config=CONFIG, depart=[0.0, 50.0])
    for b in range(2):
        alone = ap.plan_paths(
            starts[b : b + 1], goals[b : b + 1], env, key=keys[b : b + 1], config=CONFIG, depart=[50.0 * b]
        )[0]
        assert alone.travel_time == pytest.approx(together[b].travel_time, rel=2e-3)
        assert alone.feasible == together[b].feasible


def test_world_per_leg():
    near, far = (ap.UniformCurrent(jnp.asarray(u), jnp.asarray(0.0), jnp.asarray(0.0)) for u in (1.0, -1.0))
    both = jax.tree.map(lambda a, b: jnp.stack([a, b]), near, far)
    none = jax.tree.map(lambda a: jnp.stack([a, a]), ap.Obstacles.none())
    env = ap.Environment(both, None, none, (-100, -100, 0), (2100, 100, 0))
    plans = ap.plan_paths(
        [[0, 0, 0], [0, 0, 0]],
        [[2000, 0, 0]] * 2,
        env,
        key=jax.random.key(0),
        config=STRAIGHT,
        world_per_leg=True,
    )
    np.testing.assert_allclose(plans.travel_time, [2000 / 3.5, 2000 / 1.5], rtol=5e-3)


def test_planar_problem_stays_planar():
    env = ap.Environment(ap.UniformCurrent(0.0, 0.4), lower=(0, 0, 5), upper=(2000, 2000, 5))
    plan = ap.plan_path((200, 200, 5), (1800, 900, 5), env, key=jax.random.key(0), config=STRAIGHT)
    assert plan.feasible
    np.testing.assert_allclose(plan.positions[:, 2], 5.0, atol=1e-4)


@pytest.mark.slow
def test_default_is_no_worse_than_the_paper_preset():
    env = world()
    paper = ap.plan_path(START, GOAL, env, key=jax.random.key(0), config=ap.PathConfig.paper())
    default = ap.plan_path(START, GOAL, env, key=jax.random.key(0))
    assert default.feasible
    assert default.cost <= paper.cost


def test_current_that_wins_everywhere_is_named_with_its_place():
    env = ap.Environment(ap.UniformCurrent(-3.0, 0.0), lower=(0, 0, 0), upper=(2000, 2000, 50))
    plan = ap.plan_path((200, 200, 5), (1800, 900, 5), env, key=jax.random.key(0), config=STRAIGHT)
    assert not plan.feasible
    assert plan.status is ap.PathStatus.CURRENT
    assert "current" in plan.reason
    assert "km" in plan.reason
    assert np.isfinite(plan.travel_time)


def test_replanning_starts_at_the_vehicle_and_keeps_the_quality(plan):
    env = world()
    here, now = plan.positions[25], float(plan.times[25])
    rest = ap.replan_path(plan, here, now, env, key=jax.random.key(1), config=CONFIG)
    np.testing.assert_allclose(rest.positions[0], here, atol=1e-2)
    np.testing.assert_allclose(rest.positions[-1], GOAL, atol=1e-2)
    assert rest.times[0] == pytest.approx(now)
    assert rest.feasible
    assert rest.travel_time <= (plan.times[-1] - now) * 1.01
    assert (
        len(rest.history.best) == CONFIG.window().bbo.iterations + 2
    )  # the start, the windows' share, the polish
    compiled = compilations()
    ap.replan_path(rest, rest.positions[20], float(rest.times[20]), env, key=jax.random.key(2), config=CONFIG)
    assert compilations() == compiled


@pytest.mark.slow
def test_given_population_is_used(plan):
    lazy = CONFIG.replace(bbo=CONFIG.bbo.replace(iterations=0), refine_steps=0, passage_steps=0)
    kept = ap.plan_path(START, GOAL, world(), key=jax.random.key(9), config=lazy, population=plan.population)
    assert kept.travel_time == pytest.approx(plan.travel_time, rel=1e-5)


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        ((900, 1050, 5), (1800, 1500, 5), "start .* on land"),
        ((200, 300, 5), (900, 1050, 5), "goal .* on land"),
        ((-50, 300, 5), (1800, 1500, 5), "start .* outside"),
        ((200, 300, 500), (1800, 1500, 5), "start .* outside"),
        ((200, 300, 5), (200, 300, 5), "coincide"),
        ((float("nan"), 300, 5), (200, 300, 5), "not finite"),
    ],
)
def test_bad_ends_are_named(start, goal, message):
    with pytest.raises(ValueError, match=message):
        ap.plan_path(start, goal, world(), key=jax.random.key(0), config=CONFIG)


@pytest.mark.parametrize("moment", [1.7e9, -1.7e9, 2.0**24])
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("depart", lambda moment, _, **given: ap.plan_path(START, GOAL, **given, depart=moment)),
        ("depart", lambda moment, _, **given: ap.plan_paths([START], [GOAL], **given, depart=[moment])),
        ("now", lambda moment, plan, **given: ap.replan_path(plan, START, moment, **given)),
        ("now", lambda moment, plan, **given: ap.replan_paths([plan], [START], [moment], **given)),
        ("depart", lambda moment, _, **given: plan_least_energy(START, GOAL, **given, depart=moment)),
        ("depart", lambda moment, _, env, **__: ap.travel_time([START, GOAL], env, depart=moment)),
    ],
    ids=["plan_path", "plan_paths", "replan_path", "replan_paths", "plan_least_energy", "travel_time"],
)
def test_moments_that_are_rounded_by_more_than_a_second_are_refused(plan, name, call, moment):
    given = {"env": world(), "vehicle": ap.Vehicle(), "key": jax.random.key(0)}
    with pytest.raises(ValueError, match=rf"^{name} of .* s is rounded to .* s in single precision: count"):
        call(moment, plan, **given)


@pytest.mark.parametrize("apart", [1.0, 71.0, 30_000.0])
@pytest.mark.parametrize(("north", "passes"), [(2.0e6, True), (2.2e6, False), (-6_263_397.0, False)])
def test_places_that_are_rounded_by_decimetres_are_refused(apart, north, passes):
    """Unless they are computed with in double precision; however long the leg is."""
    ends = np.array([[north, 359_002.3, 5.0]]), np.array([[north + apart, 359_002.3, 5.0]])
    env = ap.Environment(None)
    if passes:
        return check_ends(*ends, env, ap.Vehicle())
    with pytest.raises(ValueError, match=r"^goal of leg 0 at .* is rounded to 0.\d+ m in single precision"):
        check_ends(*ends, env, ap.Vehicle())
    with jax.enable_x64(True):
        check_ends(*ends, env, ap.Vehicle())


def test_a_current_that_is_infinite_is_refused():
    """Its slopes leave no path that could be followed: it is looked at all over the box."""
    env = ap.Environment(
        lambda x, y, z, t: (jnp.where(x > 1000.0, jnp.inf, 0.1), 0.0, 0.0),
        lower=(0, 0, 0),
        upper=(2500, 2500, 60),
    )
    nowhere, ends = np.full((1, 4, 3), np.nan), (START[None], GOAL[None])
    with pytest.raises(CurrentError, match=r"current is infinite at \(1\d\d\d, .*, and leg 0 finds no path"):
        check_water(nowhere[:, :-1], nowhere, np.zeros((1, 4)), ends, env)


def test_traced_moments_and_near_ones_pass():
    env, points = ap.Environment(ap.UniformCurrent(0.5, 0.0)), np.array([[0.0, 0, 0], [1500, 0, 0]])
    assert float(ap.travel_time(points, env, depart=2.0**24 - 1.0)) == pytest.approx(500.0, abs=1.0)
    traced = jax.jit(lambda depart: ap.travel_time(points, env, depart=depart))
    assert np.isfinite(traced(1.7e9))


def test_no_leg_is_refused():
    with pytest.raises(ValueError, match=r"of one leg at least, got shapes \(0, 3\)"):
        ap.plan_paths(np.zeros((0, 3)), np.zeros((0, 3)), world(), key=jax.random.key(0), config=CONFIG)


def test_populations_of_another_shape_are_refused():
    right, given = (1, CONFIG.bbo.population, 3 * CONFIG.control_points), (1, 7, 3)
    with pytest.raises(ValueError, match="population") as refused:
        ap.plan_path(
            START, GOAL, world(), key=jax.random.key(0), config=CONFIG, population=np.zeros(given[1:])
        )
    assert str(right) in str(refused.value)
    assert str(given) in str(refused.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"control_points": 0},
        {"samples": 5},
        {"t_series": 0},
        {"width": 0.0},
        {"dense_cells": 4},
        {"settled": -1.0},
        {"fine_steps": -1},
    ],
)
def test_bad_settings_are_refused(changes):
    with pytest.raises(ValueError, match=next(iter(changes))):
        ap.PathConfig(**changes)


def walled(gap):
    """2 km by 2 km of water with a wall from side to side, open over `gap` pixels of 10 m."""
    water = np.ones((200, 200), bool)
    water[95:105] = False
    if gap:
        water[95:105, gap] = True
    return replace(world(), chart=ap.Chart.from_mask(water, 10.0))


def test_a_wall_is_told_to_leave_no_way():
    plan = ap.plan_path(START, GOAL, walled(None), key=jax.random.key(0), config=CONFIG)
    assert not plan.feasible
    assert plan.status is ap.PathStatus.NO_WAY
    assert plan.reason.startswith("no passage as wide as ")
    assert plan.reason.endswith(ap.PathStatus.NO_WAY.value)
    through = ap.plan_path(START, GOAL, walled(slice(20, 28)), key=jax.random.key(0), config=CONFIG)
    assert through.feasible
    assert through.closed == 0.0


def test_the_unit_of_length_does_not_matter():
    """Powers of two change no digits: whatever differs would be a length in the search."""
    env, vehicle, times = world(obstacles=False), ap.Vehicle(), []
    for unit in (1.0, 2.0**-10, 128.0):
        chart = ap.Chart.from_passability(env.chart.passability, 10.0 * unit)
        current = replace(
            env.current,
            centers=env.current.centers * unit,
            strength=env.current.strength * unit,
            radius=env.current.radius * unit,
            depths=env.current.depths * unit,
            vertical_scale=env.current.vertical_scale * unit,
        )
        rock = ap.Obstacles.static([[1300.0 * unit, 1250.0 * unit, 50.0 * unit]], [60.0 * unit])
        box = np.asarray(LOWER) * unit, np.asarray(UPPER) * unit
        plan = ap.plan_path(
            START * unit,
            GOAL * unit,
            ap.Environment(current, chart, rock, *box),
            replace(vehicle, turn_rate_max=0.1 / unit),
            key=jax.random.key(0),
            config=CONFIG.replace(coast_margin=10.0 * unit, obstacle_margin=5.0 * unit),
        )
        assert plan.feasible
        times.append(plan.travel_time / unit)
    np.testing.assert_allclose(times, times[0], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("current", [(0.0, 0.0), (0.3, 0.2)])
def test_dives_in_place_take_a_turning_circle(current):
    env = ap.Environment(ap.UniformCurrent(*current), lower=(-500, -500, 0), upper=(500, 500, 50))
    vehicle, goals = ap.Vehicle(speed=1.5, turn_rate_max=0.1), [(0, 0, 7), (0, 0, 10), (0, 0, 35)]
    plans = ap.plan_paths([(0, 0, 5)] * 3, goals, env, vehicle, key=jax.random.key(0), config=CONFIG)
    circle = 2.0 * np.pi * 1.5 / 0.1
    for plan in plans:
        assert plan.feasible, plan.reason
        assert circle < plan.length < (1.2 if current == (0.0, 0.0) else 1.7) * circle


def deep(pillar=(450.0, 450.0, 0.0), radius=1.0):
    """Still water with a pillar, out of the way or where it is given: one program serves all."""
    pillars = ap.Obstacles.static([pillar], [radius])
    return ap.Environment(None, obstacles=pillars, lower=(-500, -500, 0), upper=(500, 500, 60))


def test_short_steep_legs_wind_along_the_major_arc_of_a_turning_circle():
    speed, rate, dive = 2.0, 0.1, 15.0
    level = np.array([1e-3, 2.0, 10.0, 20.0])
    goals = np.stack([0.6 * level, 0.8 * level, 10.0 + dive + 0.0 * level], axis=1)
    vehicle, key = ap.Vehicle(speed, turn_rate_max=rate), jax.random.key(0)
    plans = ap.plan_paths([(0, 0, 10)] * 4, goals, deep(), vehicle, key=key, config=CONFIG)
    assert plans.feasible.all()
    # Of all lines that turn no more than that and are long enough for the dive.
    least = 2.0 * speed / rate * (np.pi - np.arcsin(0.5 * level * rate / speed))
    took = np.asarray(plans.travel_time)
    assert (took > np.hypot(least, dive) / speed).all()
    assert (took < 1.2 * np.hypot(least, dive) / speed).all()


@pytest.mark.parametrize("level", [1e-3, 22.0, 60.0])
def test_climbs_that_are_too_fast_wind_for_as_long_as_they_take(level):
    rise, rate, speed = 25.0, 0.25, 1.2
    ends = np.array([[0.0, 0.0, 30.0]] * 4), np.array([[0.6 * level, 0.8 * level, 30.0 - rise]] * 4)
    by_rate, by_pitch = (
        ap.Vehicle(speed, turn_rate_max=0.1, **limit)
        for limit in (
            {"pitch_max": None, "climb_rate_max": rate},
            {"pitch_max": float(np.arcsin(rate / speed))},
        )
    )
    for vehicle in (by_rate, by_pitch):
        plans = ap.plan_paths(*ends, deep(), vehicle, key=jax.random.key(0), config=CONFIG)
        assert plans.feasible.all()
        assert (np.asarray(plans.travel_time) > rise / rate).all()
        assert (np.asarray(plans.travel_time) < 1.05 * rise / rate).all()


@pytest.mark.parametrize(
    "bearing",
    [45.0, 270.0, *(pytest.param(bearing, marks=pytest.mark.slow) for bearing in (0.0, 90.0, 180.0))],
)
def test_a_vertical_station_beside_a_wall_is_dived_at_on_the_open_side(bearing):
    toward, room = np.array([np.cos(np.radians(bearing)), np.sin(np.radians(bearing)), 0.0]), 15.0
    env, vehicle = deep((2000.0 + room) * toward, 2000.0), ap.Vehicle(1.2, turn_rate_max=0.1)
    ends = [(0, 0, 8)] * 4, [(0, 0, 22)] * 4
    plan = ap.plan_paths(*ends, env, vehicle, key=jax.random.key(0), config=CONFIG)[0]
    assert plan.feasible, plan.reason
    assert (np.asarray(plan.positions) @ toward < room).all()


def test_winding_ways_are_planned_with_more_control_points():
    water = np.ones((200, 200), bool)
    for k, side in enumerate((np.s_[:150], np.s_[50:], np.s_[:150])):
        water[50 + 40 * k : 55 + 40 * k, side] = False
    env = ap.Environment(None, ap.Chart.from_mask(water, 10.0), None, LOWER, UPPER)
    few = CONFIG.replace(control_points=3, samples=40)
    starts, goals = (
        np.array([[200.0, 300.0, 0.0]] * 2),
        np.array([[1800.0, 300.0, 0.0], [300.0, 1500.0, 0.0]]),
    )
    keys = jax.random.split(jax.random.key(0), 2)
    finely = few.replace(finer=3, settled=1.0)  # paths that are worse than what the fields know alone
    plans = ap.plan_paths(starts, goals, env, key=keys, config=finely)
    alone = ap.plan_paths(starts, goals, env, key=keys, config=few)
    assert plans.feasible.all()
    assert not alone[0].feasible or plans[0].travel_time < alone[0].travel_time
    # Nothing was wanting of the second leg: it is the same path, whatever its neighbours are.
    assert list(plans.finer) == [0]
    for one, other in zip(jax.tree.leaves(vars(plans[1])), jax.tree.leaves(vars(alone[1])), strict=True):
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)
    fine = plans[0]
    assert (len(fine.times), len(fine.control_points)) == (3 * 39 + 1, 3 * 3 + 2)
    # Arrays of the batch show the finer path at every third sample.
    np.testing.assert_array_equal(plans.positions[0], fine.positions[::3])
    np.testing.assert_array_equal(plans.times[0], fine.times[::3])
    assert plans.travel_time[0] == fine.travel_time
    for plan in plans:
        assert plan.population.shape == alone[0].population.shape
        assert plan.excess.shape[1] == len(plan.water) == len(plan.times) - 1
        points, _ = dense(plan)
        assert np.asarray(env.chart.is_water(points[:, 0], points[:, 1])).all()
    here, now = fine.positions[40], float(fine.times[40])
    rest = ap.replan_path(fine, here, now, env, key=keys[0], config=finely)
    assert rest.feasible
    assert rest.travel_time <= 1.02 * (fine.times[-1] - now)


@pytest.mark.slow
def test_a_path_that_the_last_polish_still_improves_is_polished_finely():
    # With few steps before it the last polish has something left to improve.
    env, key, config = world(), jax.random.key(0), CONFIG.replace(passage_steps=3)
    usual = ap.plan_path(START, GOAL, env, key=key, config=config)
    fine = ap.plan_path(START, GOAL, env, key=key, config=config.replace(finer=2, settled=0.0))
    assert fine.feasible
    assert len(fine.times) == 2 * 63 + 1
    assert fine.travel_time < usual.travel_time
    # What counts as settled is left as it is.
    calm = ap.plan_path(START, GOAL, env, key=key, config=config.replace(finer=2, settled=1.0))
    assert calm.travel_time == usual.travel_time


def jet(x, y, z, t):
    """2.4 m/s across the straight line, where the vehicle may have 1.5 across its track."""
    return 0.0 * x, 2.4 * jnp.exp(-(((x - 1000.0) / 200.0) ** 2)), 0.0 * x


def test_a_path_that_breaks_a_limit_is_polished_strictly(monkeypatch):
    config = CONFIG.replace(
        control_points=8, samples=80, finer=2, fine_steps=40, refine_step_size=0.004, passages=0
    )
    env = ap.Environment(jet, lower=(0, -1500, 0), upper=(2000, 1500, 0))
    ends = np.array([[0.0, 0.0, 0.0]]), np.array([[2000.0, 0.0, 0.0]])
    own, shared = stages.split(env, None)
    legs = stages.Legs(*ends, np.zeros(1), own)
    line = np.asarray(straight_line(jnp.asarray(ends[0][0]), jnp.asarray(ends[1][0]), config))[None]
    keys = jax.random.split(jax.random.key(0), 1)
    batch = stages.Batch.of(legs, shared, ap.Vehicle(), config)
    polish = partial(stages.polish_finely, keys, batch, line, config, again=False)
    strict = polish()
    assert not strict["violations"].any()
    monkeypatch.setattr(stages, "_STRICTER", ())
    assert polish()["violations"].any()


def test_a_goal_nearer_to_land_than_the_margin_is_stated():
    """The leg is polished, and searched once more, in vain."""
    goal = np.array([900.0, 1050.0 - 200.0 - 8.0, 60.0])
    plan = ap.plan_path(START, goal, world(), key=jax.random.key(0), config=CONFIG)
    assert plan.status is ap.PathStatus.COAST
    np.testing.assert_allclose(plan.positions[-1], goal, atol=1e-2)
    assert 0.0 < plan.clearance < CONFIG.coast_margin


def test_without_passages_none_are_looked_for_again():
    """Not even for a path that breaks a limit."""
    config = CONFIG.replace(passages=0, finer=2, refine_steps=0, fine_steps=2, control_points=3)
    env = ap.Environment(ap.UniformCurrent(0.0, 1.9), lower=(0, -50, 0), upper=(2000, 50, 0))
    plan = ap.plan_path((0, 0, 0), (2000, 0, 0), env, key=jax.random.key(0), config=config)
    assert plan.status is ap.PathStatus.SWAY


@pytest.mark.slow
@pytest.mark.parametrize(
    ("across", "finer", "sways"), [(1.9, 1, [1.5, 1.485]), (1.9, 2, [1.5, 1.485]), (0.5, 2, [1.5])]
)
def test_a_leg_that_still_breaks_a_limit_is_searched_once_more_inside_it(monkeypatch, across, finer, sways):
    config = CONFIG.replace(
        passages=2,
        finer=finer,
        passage_steps=3,
        refine_steps=2,
        fine_steps=2,
        control_points=3,
        dense_cells=48,
    )
    env = ap.Environment(ap.UniformCurrent(0.0, across), lower=(0, -50, 0), upper=(2000, 50, 0))
    searched, search = [], planner.search_legs
    monkeypatch.setattr(
        planner,
        "search_legs",
        lambda *a, **k: searched.append(float(a[1].vehicle.sway_max)) or search(*a, **k),
    )
    plan = ap.plan_path((0, 0, 0), (2000, 0, 0), env, key=jax.random.key(0), config=config)
    assert searched == pytest.approx(sways)
    assert plan.status is (ap.PathStatus.SWAY if across > 1.5 else ap.PathStatus.OK)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("period", "config"), [(44_714.0, ap.PathConfig.quick()), (22_357.0, ap.PathConfig())], ids=["one", "two"]
)
def test_long_legs_in_a_tide_are_planned_to_the_closed_form_optimum(period, config):
    """The same everywhere, it moves the vehicle as it does the water: one heading is best, and the goal minus
    what the water moves by in T is as far as the vehicle goes through it in T."""
    rate, speed, (most, later) = 2.0 * np.pi / period, 1.2, np.array([[0.8, 0.2], [0.1, 0.3]])
    waves, place, mean = (most, later), np.zeros((1, 2)), np.zeros((2, 1), np.float32)
    waves = (np.float32(wave)[:, None, None] for wave in waves)
    tide = HarmonicCurrent(place, np.float32([rate]), *waves, mean, np.zeros(1), np.ones(1))
    goal = np.array([40_000.0, 20_000.0])

    def lacks(t):
        drift = (most * np.sin(rate * t) + later * (1.0 - np.cos(rate * t))) / rate
        return np.linalg.norm(goal - drift) - speed * t

    moments = np.linspace(0.0, 80_000.0, 2_001)
    first = np.argmax([lacks(t) <= 0.0 for t in moments])
    least = brentq(lacks, *moments[first - 1 : first + 1])
    env = ap.Environment(tide, lower=(-4e4, -4e4, 0), upper=(8e4, 8e4, 0))
    vehicle, ends = ap.Vehicle(speed, surge_max=9.0, sway_max=5.0), ((0.0, 0.0, 0.0), (*goal, 0.0))
    plan = ap.plan_path(*ends, env, vehicle, key=jax.random.key(0), config=config)
    assert float(plan.travel_time) == pytest.approx(least, rel=5e-4)


def tidal(times, north, east, island):
    """12 km of water with a tide [T, 2, Y] m/s, the same all along the north; sizes of one program."""
    apart = (12_000.0, 12_000.0 / (north.shape[2] - 1))
    field = ap.GriddedCurrent.from_arrays(
        north[:, None], east[:, None], origin=(-6000.0, -6000.0), spacing=apart, times=times
    )
    x, y = np.meshgrid(*(-6000.0 + 20.0 * (np.arange(600) + 0.5),) * 2, indexing="ij")
    land = island & (np.abs(x) < 1500.0) & (np.abs(y) < 700.0)
    chart = ap.Chart.from_mask(~land, 20.0, (-6000.0, -6000.0))
    return ap.Environment(field, chart, lower=(-6000, -6000, 0), upper=(6000, 6000, 0))


@pytest.mark.parametrize(
    ("period", "speed", "swing", "depart"), [(44_712.0, 1.0, 0.65, 12_000.0), (3_600.0, 1.2, 0.7, 500.0)]
)
def test_legs_on_which_a_gridded_current_turns_are_planned_to_the_closed_form_optimum(
    period, speed, swing, depart
):
    """As above, on legs that last an hour in still water: the tide holds the first up for three."""
    nodes, rate = np.arange(0.0, 36_000.0, 300.0), 2.0 * np.pi / period
    north, east = swing * np.cos(rate * nodes), swing * np.cos(rate * nodes + 1.2)
    everywhere = [part[:, None, None] * np.ones((2, 49)) for part in (north, east)]
    goal, moments = np.array([4000.0, 1000.0]), np.linspace(0.0, 20_000.0, 200_001)
    water = np.stack([np.interp(depart + moments, nodes, part) for part in (north, east)], axis=1)
    drift = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * (water[1:] + water[:-1]) * moments[1], axis=0)])
    least = moments[np.argmax(np.linalg.norm(goal - drift, axis=1) <= speed * moments)]
    env = tidal(nodes, *everywhere, island=False)
    ends, how = ((0.0, 0.0, 0.0), (*goal, 0.0)), {"key": jax.random.key(0), "depart": depart}
    plan = ap.plan_path(*ends, env, ap.Vehicle(speed), config=ap.PathConfig.quick(), **how)
    assert float(plan.travel_time) == pytest.approx(least, rel=5e-4)


def test_a_tide_beside_a_calm_line_is_met_at_its_times(monkeypatch):
    """The straight line says nothing of it; the paths that an island sends there do."""
    period, nodes = 2400.0, np.linspace(-6000.0, 6000.0, 49)
    times = np.arange(0.0, 12_000.0, period / 24.0)
    beside = np.clip((np.abs(nodes) - 150.0) / 300.0, 0.0, 1.0) * np.ones((2, 1))
    north = 0.9 * np.cos(2.0 * np.pi * times / period)[:, None, None] * beside
    env = tidal(times, north, 0.0 * north, island=True)
    how = {"key": jax.random.key(0), "depart": 500.0, "config": ap.PathConfig.quick()}
    ends, vehicle = ((-4000.0, 0.0, 0.0), (4000.0, 0.0, 0.0)), ap.Vehicle(1.2, surge_max=9.0, sway_max=5.0)
    found = ap.plan_path(*ends, env, vehicle, **how)
    monkeypatch.setattr(stages, "_MISSED", -1.0)
    in_turn = ap.plan_path(*ends, env, vehicle, **how)
    assert float(found.travel_time) == pytest.approx(float(in_turn.travel_time), rel=1e-3)
    assert bool(found.feasible)


@pytest.mark.parametrize("period", [40.0, 90.0])
def test_travel_times_hold_where_the_current_changes_within_segments(period):
    """A tide of seconds, walked along the plan in steps far shorter than its segments."""
    rate, speed = 2.0 * np.pi / period, 2.0
    env = ap.Environment(Surge(rate), lower=(-200, -200, 0), upper=(3500, 3500, 60))
    ends = (0.0, 0.0, 20.0), (3000.0, 1500.0, 20.0)
    few = {"bbo": CONFIG.bbo.replace(iterations=2), "samples": 253, "passages": 0, "refine_steps": 0}
    how = {"key": jax.random.key(0), "config": CONFIG.replace(**few)}
    plan = ap.plan_path(*ends, env, vehicle=ap.Vehicle(speed=speed), **how)
    now, steps = 0.0, 100
    for way in np.diff(np.asarray(plan.positions, float), axis=0):
        length = np.linalg.norm(way)
        for _ in range(steps):
            half = now + 0.5 * length / steps / pace(now, way / length, rate, speed)
            now += length / steps / pace(half, way / length, rate, speed)
    assert float(plan.travel_time) == pytest.approx(now, rel=1e-4)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Surge:
    """A tide the same everywhere; one program serves all of its rates, rad/s."""

    rate: float

    def __call__(self, x, y, z, t):
        level = 0.8 * jnp.sin(self.rate * t)
        return level, 0.0 * level, 0.0 * level


def pace(now, heading, rate, speed):
    """m/s over ground along a heading in the tide above."""
    north = 0.8 * np.sin(rate * now)
    return north * heading[0] + np.sqrt(speed**2 - north**2 * (1.0 - heading[0] ** 2))
