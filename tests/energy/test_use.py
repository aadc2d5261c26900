"""Energy of legs and of paths: a plain walk beside it, what it grows with, and its gradients."""

from dataclasses import replace
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import auvplan as ap
from auvplan.energy import TERMS, Battery, PowerLaw, PowerModel, PowerTable, energy_along, energy_of_legs
from auvplan.mission.survey import LinePart
from auvplan.ocean.obstacles import Obstacles
from auvplan.path.config import PathConfig
from auvplan.path.cost import Track, evaluate
from auvplan.path.motion import Motion
from auvplan.records import LegRecord
from tests.io.sample_run import at_speeds, make_run

BATTERY = Battery(150.0, usable=0.9, reserve=0.2)
TABLE = PowerTable([0.0, 1.0, 2.0, 3.0], [0.0, 20.0, 90.0, 300.0])
MODEL = PowerModel(TABLE, 30.0, 5.0, 120.0, 80.0, 15.0, 12.0, 500.0, BATTERY)


def winding_leg(current=None, seed=3):
    """A leg in turns and dives, 40 records, with a hold, a wait and a task."""
    rng = np.random.default_rng(seed)
    times = 100.0 + np.cumsum(np.concatenate([[0.0], rng.uniform(2.0, 9.0, 39)]))
    steps = np.stack([rng.normal(1.2, 0.4, 39), rng.normal(0.3, 0.6, 39), rng.normal(0.0, 0.2, 39)], axis=1)
    steps[20] = 0.0  # it is held up
    positions = np.concatenate([np.zeros((1, 3)), np.cumsum(steps * np.diff(times)[:, None], axis=0)])
    positions[:, 2] += 50.0
    ground = np.concatenate([steps, steps[-1:]])
    leg = LegRecord(0, 1, 300.0, 60.0, 3.0, arrived=True, t_hold=20.0, t_wait=15.0)
    leg.times, leg.positions = times, positions
    if current is not None:
        leg.current = np.broadcast_to(np.asarray(current, float), (40, 2)).copy()
    leg.motion = Motion.through_water(
        ground, np.zeros(3) if current is None else np.append(leg.current[0], 0.0)
    )
    return leg


def walk(legs, power, speed, known):
    """J by term, step by step without NumPy's vectors."""
    found, heading = dict.fromkeys(TERMS, 0.0), None
    for leg in legs:
        last = 0.0
        if leg.current is not None:
            last = float(np.hypot(*leg.current[-1]))
        for seconds, task in ((leg.t_hold, 0), (leg.t_wait, 0), (leg.t_task, 1)):
            found["hotel"] += power.hotel * seconds
            found["payload"] += power.payload * seconds
            found["propulsion"] += float(power.propulsion(last)) * seconds
            found["tasks"] += power.task * seconds * task
        found["tasks"] += power.task_start * (leg.priority > 0.0)
        for k, (begin, end) in enumerate(pairwise(leg.times)):
            seconds = end - begin
            moves = bool(np.abs(leg.motion.ground_velocity[k]).max() > 1e-6)
            through = speed if moves else last
            if moves and known and leg.current is not None:
                north, east = leg.motion.ground_velocity[k][:2] - leg.current[k]
                through = float(np.sqrt(north**2 + east**2 + leg.motion.ground_velocity[k][2] ** 2))
            found["hotel"] += power.hotel * seconds
            found["payload"] += power.payload * seconds
            found["propulsion"] += (
                float(np.interp(through, power.propulsion.speeds, power.propulsion.watts)) * seconds
            )
            down = leg.positions[k + 1][2] - leg.positions[k][2]
            found["dive" if down > 0 else "climb"] += (power.dive if down > 0 else power.climb) * abs(down)
            if moves:
                yaw = float(leg.motion.yaw[k])
                if heading is not None:
                    turn = abs(yaw - heading)
                    found["turning"] += power.turning * min(turn, 2.0 * np.pi - turn)
                heading = yaw
    return found


@pytest.mark.parametrize("current", [None, (0.2, -0.3)])
@pytest.mark.parametrize("known", [True, False])
def test_a_plain_walk_agrees(current, known):
    first, second = winding_leg(current), winding_leg(current, seed=8)
    second.times = second.times + first.ends - second.times[0] + second.t_hold
    if current is None:  # whose speed through the water its motion has, at the speed
        for leg in (first, second):
            leg.motion = Motion.along("track", 1.3, np.diff(leg.positions, axis=0), np.zeros((39, 3)))
            leg.motion = Motion.joined([leg.motion, leg.motion[-1:]])
            leg.motion.ground_velocity[20] = 0.0
    use = energy_of_legs([first, second], MODEL, 1.3, known=known)
    walked = walk([first, second], MODEL, 1.3, known)
    for name in TERMS:
        assert use.terms[name].sum() == pytest.approx(walked[name], rel=1e-4), name
    assert use.times[-1] == pytest.approx(second.ends)
    assert len(use.times) == len(use.terms["hotel"]) + 1
    spent = sum(walked.values()) / 3600.0
    assert use.charge[-1] == pytest.approx(1.0 - spent / 135.0, rel=1e-4)
    assert use.charge[0] == 1.0
    assert use.margin == pytest.approx(135.0 * 0.8 - spent, rel=1e-4)
    assert (np.diff(use.charge) < 0.0).all()


def test_a_survey_line_starts_once_where_its_parts_follow_each_other():
    places = (0.0, 0.0, 50.0), (100.0, 0.0, 50.0), (100.0, 90.0, 50.0)
    first, second = winding_leg(), winding_leg(seed=8)
    second.times = second.times + first.ends - second.times[0]
    first.line, second.line = (LinePart(*ends, 5.0) for ends in pairwise(places))

    def starts(*legs):
        found = (
            energy_of_legs(legs, replace(MODEL, task_start=joules), 1.3, known=True).totals["tasks"]
            for joules in (3600.0, 0.0)
        )
        return next(found) - next(found)

    assert starts(first, second) == pytest.approx(1.0)
    assert [starts(first), starts(second)] == pytest.approx([1.0, 1.0])
    assert starts(second, first) == pytest.approx(2.0), "it is come back to"
    assert starts(replace(first, priority=0.0), second) == pytest.approx(1.0), "nothing was covered before"


def test_surfacing_for_a_fix_takes_the_way_up_and_down_at_the_vehicles_speed():
    first, second = winding_leg((0.5, 0.0)), winding_leg((0.2, -0.3), seed=8)
    second.speed, second.t_fix, second.t_hold = 0.9, 150.0, 170.0
    second.times = second.times + first.ends - second.times[0] + second.t_hold
    depth, ways = float(second.positions[0, 2]), (40.0, 50.0)

    def use(t_fix, **given):
        return energy_of_legs([first, replace(second, t_fix=t_fix)], MODEL, 1.3, known=True, **given)

    held, risen = use(None), use(150.0, vertical_times=lambda metres: (0.8 * metres, metres))
    more = {name: risen.terms[name].sum() - held.terms[name].sum() for name in TERMS}
    assert depth == 50.0
    assert more["climb"] == pytest.approx(80.0 * depth)
    assert more["dive"] == pytest.approx(120.0 * depth)
    drifting = float(TABLE(0.5)) * 90.0  # the current at the end of the leg before
    assert more["propulsion"] == pytest.approx(float(TABLE(1.3)) * sum(ways) - drifting)
    for name in ("hotel", "payload", "turning", "tasks"):
        assert more[name] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(risen.times[[0, -1]], held.times[[0, -1]])
    straight = use(150.0).terms["propulsion"].sum() - held.terms["propulsion"].sum()
    assert straight == pytest.approx((float(TABLE(1.3)) - float(TABLE(0.5))) * 2.0 * depth / 1.3)
    short = use(60.0, vertical_times=lambda metres: (0.8 * metres, metres))
    np.testing.assert_allclose(short.times[[0, -1]], held.times[[0, -1]])


def powered(run, power=MODEL):
    return replace(run, vehicle=replace(run.vehicle, power=power))


def test_a_run_has_its_energy_and_fails_below_the_reserve():
    run = make_run()
    assert run.energy is None
    assert "energy" not in run.summary()
    enough = powered(run, replace(MODEL, battery=Battery(1000.0)))
    assert enough.success
    found = enough.summary()["energy"]
    assert found["total_wh"] == pytest.approx(sum(found["terms_wh"].values()))
    assert found["margin_wh"] == pytest.approx(800.0 - found["total_wh"])
    assert enough.energy.line.startswith(f"energy {found['total_wh']:,.0f} of 1,000 Wh usable, charge ")
    short = powered(run, replace(MODEL, battery=Battery(found["total_wh"] * 1.1, reserve=0.2)))
    assert not short.success
    assert "the largest term is propulsion" in short.energy.lack
    assert "reserve 20 %" in short.energy.lack
    unmetered = powered(run, replace(MODEL, battery=None))
    assert unmetered.success
    assert unmetered.energy.line == f"energy {found['total_wh']:,.0f} Wh"


def test_refused_legs_take_nothing_and_an_empty_run_neither():
    run = make_run()
    whole = energy_of_legs(run.legs, MODEL, 2.5, known=True).total
    refused = LegRecord(1, 2, 400.0, 60.0, 3.0)
    assert energy_of_legs([*run.legs, refused], MODEL, 2.5, known=True).total == whole
    assert energy_of_legs([], MODEL, 2.5, known=True).total == 0.0
    loiters = energy_of_legs(run.legs, MODEL, 2.5, known=True, loiters=True)
    assert loiters.total > whole


@pytest.mark.parametrize("known", [True, False])
def test_each_leg_takes_the_power_of_its_own_speed(known):
    """As each alone at that speed; one that is stated as the vehicle's own is as if it were not."""
    speeds = (1.2, None, 2.8)
    run, legs = make_run(), at_speeds(make_run(), speeds).legs
    found = energy_of_legs(legs, MODEL, 2.5, known=known)
    alone = [
        energy_of_legs([replace(leg, speed=None)], MODEL, speed or 2.5, known=known)
        for leg, speed in zip(legs, speeds, strict=True)
    ]
    for name in set(TERMS) - {"turning"}:  # legs alone do not turn into each other
        assert found.totals[name] == pytest.approx(sum(use.totals[name] for use in alone)), name
    alike = energy_of_legs([replace(leg, speed=2.5) for leg in run.legs], MODEL, 2.5, known=known)
    plain = energy_of_legs(run.legs, MODEL, 2.5, known=known)
    assert all((alike.terms[name] == plain.terms[name]).all() for name in TERMS)
    loitering = [energy_of_legs(own, MODEL, 2.5, known=known, loiters=True) for own in (legs, run.legs)]
    extra = [
        use.totals["propulsion"] - less.totals["propulsion"]
        for use, less in zip(loitering, (found, plain), strict=True)
    ]
    assert extra[0] == pytest.approx(extra[1], rel=1e-3)  # it loiters at the vehicle's speed


# --- paths -------------------------------------------------------------------------------------------

SHARE = np.linspace(0.0, 1.0, 25)


def track(dive=0.0):
    """North for 1,200 m, winding, down by so many metres and up again."""
    x, y, z = 1200.0 * SHARE, 60.0 * np.sin(6.0 * SHARE), 10.0 + dive * np.sin(np.pi * SHARE)
    return Track.through(*(jnp.asarray(axis)[:, None] for axis in (x, y, z)))


def energies(power, speed=1.5, north=0.0, depart=0.0, dive=0.0, tide=0.0):
    """J by term in a current along the track, one that changes in time where there is a tide."""

    def current(x, y, z, t):
        return north + tide * jnp.sin(t / 900.0), 0.1 * jnp.ones_like(x), jnp.zeros_like(x)

    env = replace(ap.Environment(current), obstacles=Obstacles.none())
    vehicle = ap.Vehicle(speed)
    config = PathConfig.plain()
    return energy_along(
        evaluate(track(dive), jnp.asarray(depart, float), env, vehicle, config), power, vehicle
    )


def total(*arguments, **names):
    return sum(part[0] for part in energies(*arguments, **names).values())


LAW = replace(MODEL, propulsion=PowerLaw(5.0, 12.0), battery=None)


def test_the_pump_counts_once_a_descent():
    plain, pumped = (energies(replace(LAW, pump=pump), dive=20.0)["dive"] for pump in (0.0, 4850.0))
    np.testing.assert_allclose(pumped - plain, 4850.0, rtol=1e-5)
    up = (energies(replace(LAW, pump=pump), dive=-5.0)["dive"] for pump in (0.0, 4850.0))
    np.testing.assert_allclose(np.diff(list(up), axis=0), 4850.0, rtol=1e-5)  # down again at the end


@pytest.mark.parametrize("water", [(0.0, 0.0), (0.4, -0.2)])
def test_the_energy_along_a_path_is_that_of_its_times_dives_and_turns(water):
    """North, straight down, then east, straight up and back; in a current the vehicle has headings there."""
    places = np.array([
        [0, 0, 5], [100, 0, 5], [100, 0, 20], [100, 0, 40], [100, 90, 40], [100, 90, 10], [0, 90, 10],
    ])  # fmt: skip
    env = replace(ap.Environment(ap.UniformCurrent(*water)), obstacles=Obstacles.none())
    model, vehicle = replace(LAW, hotel=21.0, dive=130.0, climb=60.0, turning=70.0), ap.Vehicle(1.3)
    way = Track.through(*(jnp.asarray(axis, float)[:, None] for axis in places.T))
    found = evaluate(way, jnp.asarray(0.0), env, vehicle, PathConfig.plain())
    spent = {name: float(part[0]) for name, part in energy_along(found, model, vehicle).items()}
    seconds = np.diff(np.asarray(found.times, float)[:, 0])
    own = np.diff(places, axis=0)[:, :2] / seconds[:, None] - water
    headings = np.arctan2(own[:, 1], own[:, 0])[np.linalg.norm(own, axis=1) > 1e-3]
    turned = np.abs((np.diff(headings) + np.pi) % (2.0 * np.pi) - np.pi).sum()
    if water == (0.0, 0.0):
        assert turned == pytest.approx(np.pi)
    assert spent["turning"] == pytest.approx(70.0 * turned, rel=1e-4)
    assert spent["dive"] == pytest.approx(130.0 * 35.0)
    assert spent["climb"] == pytest.approx(60.0 * 30.0)
    assert spent["hotel"] == pytest.approx(21.0 * seconds.sum(), rel=1e-5)
    assert spent["propulsion"] == pytest.approx((5.0 + 12.0 * 1.3**3) * seconds.sum(), rel=1e-5)


compiled_total = jax.jit(total)
slopes_of = jax.jit(jax.value_and_grad(total, argnums=(1, 2, 3, 5)))


@settings(max_examples=25, deadline=None)
@given(
    hotel=st.floats(1.0, 80.0),
    against=st.floats(0.0, 0.9),
    dive=st.floats(0.0, 60.0),
    more=st.floats(0.05, 0.4),
)
def test_energy_grows_with_load_opposing_current_and_depth(hotel, against, dive, more):
    model = replace(LAW, hotel=hotel)
    base = float(compiled_total(model, 1.5, -against, 0.0, dive))
    assert float(compiled_total(replace(LAW, hotel=hotel * (1.0 + more)), 1.5, -against, 0.0, dive)) > base
    assert float(compiled_total(model, 1.5, -against - more, 0.0, dive)) > base
    assert float(compiled_total(model, 1.5, -against, 0.0, dive + 10.0 * more)) > base


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("model", [LAW, MODEL], ids=["law", "table"])
def test_gradients_against_differences(model):
    """By speed, current, departure and tide."""
    at = np.array([1.5, -0.3, 300.0, 20.0, 0.25])

    def of(values):
        return slopes_of(model, *values)

    slopes = of(at)[1]
    for k, slope in zip((0, 1, 2, 4), slopes, strict=True):
        step = 1e-4 * max(abs(at[k]), 1.0) * np.eye(5)[k]
        differences = float(of(at + step)[0] - of(at - step)[0]) / (2.0 * step[k])
        assert float(slope) == pytest.approx(differences, rel=2e-4)


@pytest.mark.usefixtures("x64")
def test_gradients_by_the_model_are_finite_and_right():
    at = 1.5, 0.0, 0.0, 20.0
    slopes = jax.jit(jax.grad(total))(jax.tree.map(jnp.asarray, LAW), *at)
    seconds = float(jax.jit(energies)(LAW, *at)["hotel"][0]) / 30.0
    assert float(slopes.hotel) == pytest.approx(seconds)
    assert float(slopes.dive) == pytest.approx(20.0, rel=0.01)
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(slopes))
