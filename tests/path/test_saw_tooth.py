"""Saw-teeth: closed forms in still water, a plain twin in a sheared current, sea bed, ends and limits."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import auvplan as ap
from auvplan.ocean.seabed import Seabed
from auvplan.path import PathConfig
from auvplan.path.follow import straight_plan
from auvplan.path.saw_tooth import SawTooth, saw_tooth_plan, turns
from auvplan.path.sensitivity import Conditions

V, ANGLE = 0.35, math.radians(26.0)
SAW = SawTooth(ANGLE, shallow=3.0, deep=100.0)
STILL = ap.Environment(None, lower=(-500, -500, 0), upper=(9000, 500, 200))


def dived(saw=SAW, env=STILL, start=(0.0, 0.0, 0.0), goal=(6000.0, 0.0, 0.0)):
    vehicle = ap.Vehicle(speed=V)
    conditions = Conditions(env, saw.for_planning(vehicle), PathConfig())
    track = straight_plan(np.asarray(start, float), np.asarray(goal, float), 100.0, conditions)
    return saw_tooth_plan(track, saw, vehicle)


def at_turns(plan):
    at = turns(plan.positions)
    return np.asarray(plan.positions, float)[at], plan.times[at]


def seabed(depth_at):
    north = np.arange(-300.0, 7400.0, 20.0)
    return Seabed.from_depth(np.repeat(depth_at(north)[:, None], 60, 1), 20.0, (-310, -600), clearance=5.0)


@pytest.mark.parametrize("dives", [0, 1, 4])
def test_cycles_take_what_the_closed_form_says(dives):
    saw = SawTooth(ANGLE, 3.0, 100.0, dives=dives, surface_time=600.0 if dives else 0.0)
    plan = dived(saw)
    assert plan.feasible, plan.reason
    places, times = at_turns(plan)
    level, fall = V * math.cos(ANGLE), V * math.sin(ANGLE)
    # Whatever its turns, a glide goes along the track at v cos and in depth at v sin.
    rests = np.count_nonzero(~np.diff(places, axis=0).any(axis=1))
    surfacings = np.count_nonzero(places[1:-1, 2] == 0.0) / 2
    assert surfacings == rests
    assert plan.travel_time == pytest.approx(6000.0 / level + rests * saw.surface_time, rel=1e-6)
    assert plan.length == pytest.approx(6000.0 / math.cos(ANGLE), rel=1e-4)
    steps = np.diff(places, axis=0)
    gone = steps.any(axis=1)
    np.testing.assert_allclose(np.abs(steps[gone, 2]) / steps[gone, 0], math.tan(ANGLE), rtol=1e-3)
    np.testing.assert_allclose(np.abs(steps[gone, 2]) / np.diff(times)[gone], fall, rtol=1e-3)
    if dives == 0:
        cycle = np.diff(times[1:-2:2])
        np.testing.assert_allclose(cycle, 2.0 * 97.0 / fall, rtol=1e-5)
        np.testing.assert_allclose(np.diff(places[1:-2:2, 0]), 2.0 * 97.0 / math.tan(ANGLE), rtol=1e-5)
    else:
        lower = np.flatnonzero(places[:, 2] == 100.0)
        upper = np.flatnonzero(places[:, 2] == 0.0)[1:-1:2]
        assert [np.count_nonzero(lower < at) for at in upper] == [dives * (k + 1) for k in range(len(upper))]
        # From one surfacing to the next the vehicle is as fast as its track is planned for.
        period = np.diff(times[upper])
        np.testing.assert_allclose(np.diff(places[upper, 0]) / period, saw.way_speed(V), rtol=1e-4)


def shear(x, y, z, t):
    return 0.12 * (1.0 - z / 80.0) + 2e-6 * t, 0.1 - 1e-3 * z, 0.01 + 0.0 * z


def test_a_plain_twin_turns_at_the_same_places_and_times():
    plan = dived(env=ap.Environment(shear, lower=(-500, -500, 0), upper=(9000, 500, 200)))
    assert plan.feasible, plan.reason
    places, times = at_turns(plan)
    level, fall, step = V * math.cos(ANGLE), V * math.sin(ANGLE), 0.5
    along, depth, now, sense, found = 0.0, 0.0, 100.0, 1.0, []
    while len(found) < len(times) - 4:
        u, v, w = shear(0.0, 0.0, depth, now)
        rate, bound = sense * fall + w, 100.0 if sense > 0.0 else 3.0
        lasts = min(step, (bound - depth) / rate)
        along += lasts * (u + math.sqrt(level**2 - v**2))
        depth += lasts * rate
        now += lasts
        if lasts < step:
            found.append((along, now))
            sense = -sense
    found = np.asarray(found)
    np.testing.assert_allclose(places[1 : len(found) + 1, 0], found[:, 0], atol=1.0)
    np.testing.assert_allclose(times[1 : len(found) + 1], found[:, 1], atol=0.5)
    # Its velocity less the current is its speed through the water, at the glide angle.
    water = np.stack(
        np.broadcast_arrays(*shear(0, 0, *np.asarray([plan.positions[1:, 2], plan.times[1:]]))), 1
    )
    own = np.diff(np.asarray(plan.positions, float), axis=0) / np.diff(plan.times)[:, None] - plan.water
    np.testing.assert_allclose(np.linalg.norm(own, axis=1), V, rtol=2e-3)
    np.testing.assert_allclose(np.abs(plan.pitch), ANGLE, atol=0.01)
    assert np.abs(plan.water - water).max() < 0.02


def test_a_steeper_glide_goes_further_through_the_water_and_slower_along_it():
    plans = [dived(SawTooth(angle, 3.0, 100.0)) for angle in np.radians([15.0, 26.0, 35.0, 50.0])]
    for less, more in pairwise(plans):
        assert more.length > less.length
        assert more.travel_time > less.travel_time
        assert len(turns(more.positions)) > len(turns(less.positions))


def test_descents_end_above_the_bed():
    bed = seabed(lambda north: 120.0 - 70.0 * np.exp(-(((north - 3000.0) / 1200.0) ** 2)))
    plan = dived(env=ap.Environment(shear, lower=(-200, -500, 0), upper=(7000, 500, 200), seabed=bed))
    assert plan.feasible, plan.reason
    altitude = bed.altitude(plan.positions)
    assert altitude.min() > 9.5
    lower = np.flatnonzero(np.diff(np.sign(np.diff(plan.positions[:, 2]))) < 0) + 1
    shallower = lower[(plan.positions[lower, 2] < 99.0) & (plan.times[lower] < plan.times[-1] - 2000.0)]
    assert len(shallower) > 3
    np.testing.assert_allclose(altitude[shallower], 10.0, atol=0.5)
    # Tracks are planned where the water has room for a dive, and judged by the bed's own clearance.
    roomier = SAW.with_room(bed)
    assert float(roomier.clearance) == 3.0 + 5.0 + 10.0
    np.testing.assert_array_equal(roomier.depth, bed.depth)
    assert SAW.with_room(None) is None
    flat = dived(env=ap.Environment(None, lower=(-200, -500, 0), upper=(7000, 500, 200), seabed=seabed(
        lambda north: 12.0 + 0.0 * north)))  # fmt: skip
    assert flat.broken()[0] == "seabed"
    assert "4.0 m under 10.0" in flat.reason


@pytest.mark.parametrize("goal", [(6000.0, 0.0, 80.0), (6000.0, 0.0, 150.0), (500.0, 300.0, 30.0)])
def test_the_last_dives_end_at_the_goal(goal):
    plan = dived(goal=goal)
    assert plan.feasible, plan.reason
    np.testing.assert_array_equal(plan.positions[[0, -1]], np.asarray([(0.0, 0.0, 0.0), goal], np.float32))
    np.testing.assert_allclose(np.abs(plan.pitch), ANGLE, atol=1e-3)
    assert plan.travel_time == pytest.approx(math.hypot(*goal[:2]) / (V * math.cos(ANGLE)), rel=1e-5)


def test_a_goal_too_far_down_and_a_current_too_strong_are_named():
    assert "dives at 33.7 deg, limit 26.0" in dived(goal=(60.0, 0.0, 40.0)).reason
    against = ap.Environment(ap.UniformCurrent(-0.33, 0.0), lower=(-500, -500, 0), upper=(9000, 500, 200))
    plan = dived(env=against)
    assert plan.broken()[0] == "current"
    assert len(plan.times) < 50, "it does not go on for days"


@pytest.mark.parametrize(
    ("down", "words"), [(-0.2, "0.20 m/s upwards beats"), (0.2, "0.20 m/s downwards beats")]
)
def test_a_vertical_current_that_holds_the_vehicle_is_named(down, words):
    sinks = V * np.sin(ANGLE)
    assert sinks < 0.2
    plan = dived(env=replace(STILL, current=ap.UniformCurrent(0.0, 0.0, down)))
    assert not plan.feasible
    assert plan.status is ap.PathStatus.CURRENT
    assert words in plan.reason
    weaker = ap.UniformCurrent(0.0, 0.0, 0.5 * np.sign(down) * sinks)
    assert dived(env=replace(STILL, current=weaker)).feasible


def test_a_track_straight_down_is_too_steep():
    plan = dived(goal=(0.0, 0.0, 100.0))
    assert plan.broken() == ("pitch",)


def test_a_bent_track_is_held():
    vehicle, config = ap.Vehicle(speed=V), PathConfig()
    track = straight_plan(np.zeros(3), np.array([3000.0, 0.0, 0.0]), 0.0, Conditions(STILL, vehicle, config))
    bent = np.array([(0, 0, 0), (1000, 0, 50), (1000, 400, 50), (1600, 400, 0)], np.float32)
    plan = saw_tooth_plan(replace(track, positions=bent), SAW, vehicle)
    corner = np.linalg.norm(np.asarray(plan.positions)[:, None, :2] - bent[1:3, :2], axis=2).min(axis=0)
    assert corner.max() < 2.0
    assert plan.travel_time == pytest.approx(2000.0 / (V * math.cos(ANGLE)), rel=1e-5)


@pytest.mark.parametrize(
    ("shape", "words"), [((0.0, 3.0, 100.0), "right angle"), ((0.4, 3.0, 7.0), "at least 5 m below shallow")]
)
def test_a_shape_that_is_none_is_refused(shape, words):
    with pytest.raises(ValueError, match=words):
        SawTooth(*shape)
