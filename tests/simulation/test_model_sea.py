"""Missions in currents of files: what is given, what is executed in, what the run reports of both."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.errors import ScenarioError
from auvplan.ocean.currents import SumCurrent, UniformCurrent, combine, partition
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.runtime.compiled import compilations
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.waypoints import lines_clear, make_graph
from auvplan.simulation.sea import ModelSea, stacked
from auvplan.simulation.world import make_sea
from tests.executive.small import SMALL, scenario

PLACES = np.array([[100.0, 200.0, 5.0], [1500.0, 700.0, 20.0], [3900.0, 3000.0, 40.0]])
TIMES = np.array([0.0, 1800.0, 5000.0])


def tide(strength: float = 0.5) -> GriddedCurrent:
    """A stream to the north-east that turns within three hours over the small mission's area."""
    times = np.arange(0.0, 10_801.0, 1800.0)
    swing = strength * np.cos(np.pi * times / 10_800.0)[:, None, None, None] * np.ones((1, 1, 3, 3))
    return GriddedCurrent.from_arrays(swing, 0.5 * swing, spacing=2000.0, times=times)


def modelled(error: float = 0.0) -> ap.Scenario:
    """The small mission in currents of files, which are given as `OperatingArea`."""
    site = {"longitude": 5.0, "latitude": 60.0, "departure": "2026-03-01T06:00:00"}
    current = {"source": "file", "files": "given.nc", "forecast_error": error}
    return scenario(site=site, current=current)


def area(truth: float = 0.6) -> OperatingArea:
    settings = modelled().site
    assert settings is not None
    return OperatingArea(site=settings.site, forecast=tide(), truth=tide(truth))


def test_a_sum_of_currents_adds_up_and_comes_apart():
    total = SumCurrent(UniformCurrent(0.3, -0.1), UniformCurrent(0.2, 0.4, 0.1))
    found = total(*(jnp.asarray(axis) for axis in PLACES.T), jnp.asarray(TIMES))
    np.testing.assert_allclose(np.stack(found), np.tile([[0.5], [0.3], [0.1]], 3), atol=1e-6)
    shared, own = partition(total)
    assert combine(shared, own)(*PLACES.T, TIMES)[0].shape == (3,)
    alone = UniformCurrent(1.0)
    assert partition(alone) == (None, alone)
    assert combine(None, alone) is alone


def test_stacked_currents_share_what_is_shared():
    field = tide()
    seas = [
        ModelSea(field, field, ap.random_vortices(jax.random.key(k), (0, 0, 0), (4000, 4000, 0)))
        for k in (1, 2)
    ]
    both = stacked([sea.forecast() for sea in seas])
    shared, own = partition(both)
    assert shared is field
    assert jax.tree.leaves(own)[0].shape[0] == 2


def test_the_error_of_a_forecast_is_the_missions_own_and_of_the_asked_size():
    known = area(truth=0.5)
    keys = jax.random.split(jax.random.key(3), 3)
    exact = make_sea(modelled(), known, keys[0], keys[1])
    assert exact.difference(PLACES, TIMES) == pytest.approx(0.0, abs=1e-6)
    one, same, other = (make_sea(modelled(0.2), known, key, keys[1]) for key in (keys[0], keys[0], keys[2]))
    assert 0.0 < one.difference(PLACES, TIMES) <= 0.2 * known.forecast.fastest + 1e-6
    assert one.difference(PLACES, TIMES) == same.difference(PLACES, TIMES)
    assert one.difference(PLACES, TIMES) != other.difference(PLACES, TIMES)


def test_tracks_of_any_length_are_compared_by_one_program():
    sea = make_sea(modelled(), area(), *jax.random.split(jax.random.key(4)))
    rng = np.random.default_rng(0)
    sea.difference(PLACES, TIMES)
    for count in (1, 2, 77, 500):
        places, times = rng.uniform(0.0, 40.0, (count, 3)), np.linspace(0.0, 9000.0, count)
        given, true = (np.stack(field(*places.T, times)) for field in (tide(), tide(0.6)))
        by_hand = np.sqrt(((given - true) ** 2).sum(axis=0).mean())
        before = compilations()  # what the line above compiled
        assert sea.difference(places, times) == pytest.approx(by_hand, rel=1e-4)
        assert compilations() == before


@pytest.mark.slow
@pytest.mark.usefixtures("light_search")
def test_another_mission_in_currents_of_files_compiles_nothing():
    ap.run_mission(modelled(0.1), key=jax.random.key(1), area=area())
    compiled = compilations()
    ap.run_mission(modelled(0.1), key=jax.random.key(2), area=area(0.7))
    assert compilations() == compiled


@pytest.mark.slow
@pytest.mark.usefixtures("light_search")
def test_a_mission_is_executed_in_the_truth_and_reports_both_seas():
    run = ap.run_mission(modelled(), key=jax.random.key(0), area=area())
    assert run.done
    forecast = run.summary()["forecast"]
    # The truth is 1.2 times the forecast everywhere: the difference is a fifth of the forecast.
    stated = np.concatenate([
        np.hypot(*tide()(*leg.positions.T, leg.times)[:2]) for leg in run.done
    ])  # fmt: skip
    assert forecast["current_difference"] == pytest.approx(0.2 * np.sqrt((stated**2).mean()), rel=0.05)
    assert forecast["executed_s"] == pytest.approx(sum(leg.t_path for leg in run.done))
    assert forecast["planned_s"] == pytest.approx(sum(leg.t_planned for leg in run.done))
    for leg in run.done:
        planned = leg.plans[leg.followed]
        assert leg.t_planned == pytest.approx(planned.times[-1] - planned.times[0])
    again = ap.run_mission(modelled(), key=jax.random.key(0), area=area())
    assert again.t_mission == run.t_mission


def bank(depth_at_bank: float) -> ap.Seabed:
    """A bed at 60 m with a bank from west to east across its middle."""
    depth = np.full((80, 80), 60.0)
    depth[38:42] = depth_at_bank
    return ap.Seabed.from_depth(depth, 50.0, (0.0, 0.0), clearance=5.0)


def test_waypoints_keep_off_the_sea_bed_and_lines_off_what_dries():
    rng = np.random.default_rng(0)
    shallow = OperatingArea(seabed=bank(12.0))
    graph, _ = make_graph(scenario(), shallow, rng)
    depth = np.asarray(shallow.seabed.depth_at(*graph.positions[:, :2].T))
    assert (graph.positions[:, 2] <= depth - 5.0).all()
    ends = np.array([[500.0, 500.0, 10.0], [3500.0, 500.0, 10.0], [500.0, 3000.0, 10.0]])
    assert lines_clear(ends, scenario(), shallow).all()
    dry = lines_clear(ends, scenario(), OperatingArea(seabed=bank(1.0)))
    np.testing.assert_array_equal(dry, [[1, 0, 1], [0, 1, 0], [1, 0, 1]])


@pytest.mark.parametrize(
    ("start", "words"),
    [([500, 500, 58], "too deep"), ([500, 500, 55.5], "too deep")],
)
def test_a_start_too_near_the_sea_bed_is_refused(start, words):
    deep = scenario(
        area={"lower": [0, 0, 0], "upper": [4000, 4000, 59]}, mission=SMALL["mission"] | {"start": start}
    )
    with pytest.raises(ScenarioError, match=words):
        make_graph(deep, OperatingArea(seabed=bank(30.0)), np.random.default_rng(0))
