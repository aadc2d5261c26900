"""Plans in gridded currents: against the field that they were sampled from, and by their times in a tide."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.io.currents import open_ocean, read_current
from auvplan.ocean import FunctionCurrent, GriddedCurrent
from auvplan.site import Site

START, GOAL = np.array([400.0, 500.0, 10.0]), np.array([3500.0, 3200.0, 30.0])
LOWER, UPPER = (0.0, 0.0, 0.0), (4000.0, 4000.0, 40.0)
HOURS = np.arange(6)
SMALL = ap.PathConfig.quick().replace(
    bbo=ap.PathConfig.quick().bbo.replace(population=24, iterations=6),
    passages=0,
    samples=48,
    refine_steps=60,
    refine_count=2,
    finer=1,
)
VORTICES = ap.random_vortices(
    jax.random.key(2), LOWER, UPPER, count=6, layers=2, radius=(500.0, 1000.0), peak_speed=1.0
)


def sampled(strength):
    """The vortices at nodes 50 m apart, [T] times as strong, hour by hour."""
    depths, along = np.linspace(0.0, 40.0, 3), np.linspace(0.0, 4000.0, 81)
    z, x, y = np.meshgrid(depths, along, along, indexing="ij")
    u, v, w = (np.asarray(c) * np.reshape(strength, (-1, 1, 1, 1)) for c in VORTICES(x, y, z, np.zeros(())))
    times = 3600.0 * np.arange(len(strength))
    return GriddedCurrent.from_arrays(u, v, w, spacing=50.0, depths=depths, times=times)


@pytest.fixture(scope="module")
def tide():
    """The vortices as a semidiurnal tide turns them about."""
    return sampled(np.cos(2.0 * np.pi * HOURS / 12.42))


def plan(current, seed=0, depart=0.0, config=SMALL):
    env = ap.Environment(current, lower=LOWER, upper=UPPER)
    return ap.plan_path(START, GOAL, env, key=jax.random.key(seed), config=config, depart=depart)


def executed(current, positions, depart, speed=2.5, parts=1):
    """Times at positions [S, 3], one part of a segment after the other, the current met in its middle."""
    share = np.linspace(0.0, len(positions) - 1, parts * (len(positions) - 1) + 1)
    line = np.stack([np.interp(share, np.arange(len(positions)), axis) for axis in positions.T], axis=1)
    times, ground = [depart], speed
    ask = jax.jit(lambda x, y, z, t: jnp.stack(current(x, y, z, t)))
    for a, b in pairwise(line):
        gap = np.linalg.norm(b - a)
        water = np.asarray(ask(*(0.5 * (a + b)), times[-1] + 0.5 * gap / ground))
        along = water @ (b - a) / gap
        across = np.sqrt(max(water @ water - along**2, 0.0))
        ground = along + np.sqrt((speed - across) * (speed + across))
        times.append(times[-1] + gap / ground)
    return np.array(times[::parts])


@pytest.mark.slow
@pytest.mark.parametrize("depart", [0.0, 7000.0, 17_500.0])
def test_times_in_a_tide_are_those_of_stepping_through_it(tide, depart):
    found = plan(tide, depart=depart)
    assert found.feasible
    travel = found.travel_time
    np.testing.assert_allclose(found.times, executed(tide, found.positions, depart), atol=1e-4 * travel)
    fine = executed(tide, found.positions, depart, parts=20)
    assert travel == pytest.approx(fine[-1] - depart, rel=1e-3)


@pytest.mark.slow
def test_pacing_the_search_loses_next_to_nothing(tide):
    exact = FunctionCurrent(lambda x, y, z, t: tide(x, y, z, t))
    departs = (0.0, 7000.0, 14_000.0)
    paced = [plan(tide, seed, depart).travel_time for seed, depart in enumerate(departs)]
    scanned = [plan(exact, seed, depart).travel_time for seed, depart in enumerate(departs)]
    assert (np.array(paced) < 1.002 * np.array(scanned)).all()


@pytest.mark.slow
def test_a_leg_in_a_fjord_at_each_hour_of_a_day(shared):
    path = shared / "data" / "currents" / "norfjords160_roms_native_24h.nc"
    if not path.is_file():
        pytest.skip(f"needs {path}")
    with open_ocean(path) as ocean:
        middle = [0.5 * (axis.min() + axis.max()) for axis in (ocean.longitude, ocean.latitude)]
    # The model's grid lies askew in this box; the leg, down the channel west of the island, is well within.
    box = np.array([-1200.0, -1000.0, 0.0]), np.array([1200.0, 1000.0, 20.0])
    file = read_current(
        path, Site(*map(float, middle)), lower=box[0], upper=box[1], outside="clamp", spacing=100.0
    )
    field = file.field
    assert file.spacing == (100.0, 100.0)
    chart = ap.Chart.from_mask(file.water, 100.0, tuple(edge - 50.0 for edge in file.origin))
    start, goal = np.array([650.0, -250.0, 5.0]), np.array([-300.0, -450.0, 5.0])
    env = ap.Environment(field, chart, lower=box[0], upper=box[1])
    departs = 3600.0 * np.arange(24)
    np.testing.assert_allclose(field.times, departs)
    ends = np.tile(start, (24, 1)), np.tile(goal, (24, 1))
    vehicle = ap.Vehicle(speed=1.0, surge_max=2.0, sway_max=0.7)
    plans = ap.plan_paths(*ends, env, vehicle, key=jax.random.key(0), config=SMALL, depart=departs)
    assert plans.feasible.all()
    travel = plans.travel_time
    for hour in (0, 11, 18):
        found = plans[hour]
        exact = executed(field, found.positions, departs[hour], speed=1.0)
        np.testing.assert_allclose(
            found.times - departs[hour], exact - departs[hour], atol=1e-3 * travel[hour]
        )
        assert np.asarray(chart.is_water(found.positions[:, 0], found.positions[:, 1])).all()
    # Travel times follow the tide: what the water does along the straight way tells them apart.
    line = start + np.linspace(0.0, 1.0, 50)[:, None] * (goal - start)
    way = (goal - start) / np.linalg.norm(goal - start)
    along = [
        np.mean(way @ np.stack(field(*line.T, t + np.linspace(0.0, travel[k], 50))))
        for k, t in enumerate(departs)
    ]
    still = np.linalg.norm(goal - start)
    assert travel.max() > 1.15 * travel.min()
    assert np.corrcoef(travel, still / (1.0 + np.array(along)))[0, 1] > 0.97
