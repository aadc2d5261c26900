"""Currents that drawn seas are made of, and currents scaled, with a uniform one added."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

import auvplan as ap
from auvplan.ocean.currents import SumCurrent, UniformCurrent, as_current
from auvplan.ocean.ensemble import (
    ErrorScale,
    Measured,
    SteppedCurrent,
    corrected,
    member_weights,
    perturbed,
    random_fields,
)
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.ocean.vortices import LambVortices, random_vortices

LENGTH, DURATION, ERROR = 2000.0, 7200.0, 0.2


@pytest.fixture(scope="module")
def fields():
    return random_fields(jax.random.key(3), 4000, ERROR, LENGTH, DURATION)


def at(fields, x, y, t):
    """u and v of all fields at one place and time, m/s."""
    where = (jnp.asarray(axis, float) for axis in (x, y, 7.0, t))
    u, v, w = jax.vmap(lambda one, *place: one(*place), in_axes=(0, None, None, None, None))(fields, *where)
    assert not np.any(w)
    return np.asarray(u), np.asarray(v)


def test_each_component_has_the_error_that_is_asked_for(fields):
    for component in at(fields, 500.0, -300.0, 100.0):
        assert abs(component.mean()) < 4.0 * ERROR / np.sqrt(len(component))
        assert component.std() == pytest.approx(ERROR, rel=0.04)


@pytest.mark.parametrize("share", [0.5, 1.0, 2.0])
def test_errors_are_alike_as_far_as_stated(fields, share):
    here, beside = at(fields, 0.0, 0.0, 0.0), at(fields, share * LENGTH, 0.0, 0.0)
    later, square = at(fields, 0.0, 0.0, share * DURATION), 2.0 * ERROR**2
    for there in (beside, later):
        product = sum((one * other).mean() for one, other in zip(here, there, strict=True))
        assert product / square == pytest.approx(np.exp(-0.5 * share**2), abs=0.04)


def test_it_has_no_divergence_and_is_the_sum_of_its_waves(fields):
    one = jax.tree.map(lambda leaf: leaf[5], fields)
    x, y, t = 700.0, -1200.0, 900.0

    def level(place):
        return jnp.stack(one(place[0], place[1], jnp.zeros(()), jnp.asarray(t))[:2])

    slope = np.asarray(jax.jacfwd(level)(jnp.asarray([x, y])))
    assert abs(slope[0, 0] + slope[1, 1]) < 1e-6
    k, m, rate, phase = (np.asarray(leaf, float) for leaf in (one.north, one.east, one.rate, one.phase))
    waves = float(one.speed[0]) * np.cos(k * x + m * y + rate * t + phase) / np.hypot(k, m)
    np.testing.assert_allclose(level(jnp.asarray([x, y])), [-(waves * m).sum(), (waves * k).sum()], atol=1e-5)


def test_a_current_in_steps_is_each_of_its_fields_in_turn():
    keys = jax.random.split(jax.random.key(1), 3)
    parts = [random_vortices(key, (0, 0, 0), (2000, 2000, 20), count=4, layers=2) for key in keys]
    fields: LambVortices = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(x) for x in leaves]), *parts)
    stepped = SteppedCurrent(fields, jnp.asarray(600.0), jnp.asarray(1200.0))
    places = jnp.asarray([400.0, 900.0]), jnp.asarray([1500.0, 100.0]), jnp.asarray([3.0, 12.0])
    for time, number in ((0.0, 0), (1200.0, 0), (1799.0, 0), (1801.0, 1), (2500.0, 2), (9e4, 2)):
        found = stepped(*places, jnp.full(2, time))
        wanted = parts[number](*places, jnp.full(2, time))
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-6)


def test_a_steady_current_in_steps_of_one_is_itself():
    one = SteppedCurrent(
        UniformCurrent(jnp.asarray([0.3]), jnp.asarray([0.1]), jnp.asarray([0.0])), 60.0, 0.0
    )
    u, v, _ = one(jnp.zeros(4), jnp.zeros(4), jnp.zeros(4), jnp.linspace(-1e3, 1e3, 4))
    np.testing.assert_allclose(u, 0.3)
    np.testing.assert_allclose(v, 0.1)


#: Two places a length apart, and a third; of members, the velocities there.
PLACES = np.asarray([[0.0, 0.0, 5.0], [LENGTH, 0.0, 5.0], [300.0, 900.0, 5.0]])
TIMES = np.asarray([0.0, 600.0, 5000.0])
STREAMS = [UniformCurrent(0.3, 0.0), UniformCurrent(0.1, 0.1), UniformCurrent(-0.2, 0.0)]


def weights(measured, members=STREAMS, error=ERROR):
    return member_weights(members, Measured(measured, PLACES, TIMES), ErrorScale(error, LENGTH, DURATION))


def test_members_are_weighed_as_by_the_density_of_their_errors():
    measured = np.asarray([[0.25, 0.05], [0.2, 0.0], [0.1, 0.15]])
    apart = np.linalg.norm(PLACES[:, None] - PLACES, axis=-1) / LENGTH
    later = (TIMES[:, None] - TIMES) / DURATION
    spread = ERROR**2 * np.exp(-0.5 * (apart**2 + later**2)) + 0.02**2 * np.eye(3)
    density = [
        np.prod([multivariate_normal(cov=spread).pdf(measured[:, k] - one) for k, one in enumerate(stream)])
        for stream in ((0.3, 0.0), (0.1, 0.1), (-0.2, 0.0))
    ]
    np.testing.assert_allclose(weights(measured), density / np.sum(density), rtol=1e-5)


def test_what_one_member_has_makes_it_the_likeliest():
    for number, stream in enumerate(STREAMS):
        found = weights(np.tile([stream.u, stream.v], (3, 1)), error=0.1)
        assert found.sum() == pytest.approx(1.0)
        assert found.argmax() == number
    np.testing.assert_allclose(weights(np.zeros((3, 2)), [STREAMS[0]] * 4), 0.25)


def test_where_a_member_is_not_known_nothing_is_learnt():
    def north_of(x, y, z, t):
        return jnp.where(x > 1000.0, 0.3, jnp.nan), 0.0 * x, 0.0 * x

    members = [as_current(north_of), STREAMS[2]]
    measured = np.asarray([[-0.2, 0.0], [0.3, 0.0], [-0.2, 0.0]])
    assert weights(measured, members)[0] > 0.9  # the second place alone counts
    nowhere = [as_current(lambda x, y, z, t: (jnp.nan * x, x, x)), STREAMS[2]]
    np.testing.assert_allclose(weights(measured, nowhere), 0.5)


def on_a_grid(times=range(0, 36_001, 3600)):
    """A still current, at nodes 500 m apart, from -2 to 40 km."""
    still = np.zeros((len(times), 2, 85, 85))
    grid = {"origin": (-2000.0, -2000.0), "spacing": 500.0, "depths": (0.0, 20.0), "times": times}
    return GriddedCurrent.from_arrays(still, still, **grid)


def test_a_forecast_is_corrected_near_what_was_measured():
    """By its most probable error: that of a Gaussian process (kriging), here of one measured current."""
    measured = Measured(np.asarray([[0.3, -0.1]]), PLACES[:1], TIMES[:1])
    field = corrected(on_a_grid(), measured.velocities, measured, ErrorScale(ERROR, LENGTH, DURATION))
    kept = ERROR**2 / (ERROR**2 + 0.02**2)
    for place, share in (
        ((0.0, 0.0, 5.0, 0.0), 1.0),
        ((LENGTH, 0.0, 5.0, 0.0), np.exp(-0.5)),
        ((LENGTH, -1500.0, 15.0, 3600.0), np.exp(-0.5 * (1.0 + 0.75**2 + 0.25))),
        ((3e4, 3e4, 5.0, 0.0), 0.0),
        ((0.0, 0.0, 5.0, 36_000.0), 0.0),
    ):
        np.testing.assert_allclose(field(*place)[:2], kept * share * measured.velocities[0], atol=1e-5)


def test_all_that_was_measured_is_met_where_it_was():
    velocities = np.asarray([[0.25, 0.05], [0.2, 0.0], [0.1, 0.15]])
    measured = Measured(velocities, np.round(PLACES / 500.0) * 500.0 + [0.0, 0.0, 5.0], np.zeros(3))
    field = corrected(on_a_grid((0.0,)), velocities, measured, ErrorScale(0.5, LENGTH, DURATION))
    found = [np.stack(field(*place, 0.0)[:2]) for place in measured.positions]
    np.testing.assert_allclose(found, velocities, atol=0.01)


POINTS = np.array([300.0, 900.0]), np.array([200.0, 700.0]), np.array([5.0, 5.0]), np.array([0.0, 50.0])


def gridded():
    u = np.arange(8.0).reshape(2, 1, 2, 2) / 10.0
    return ap.GriddedCurrent.from_arrays(u, -u, origin=(0.0, 0.0), spacing=1000.0, times=(0.0, 100.0))


def tidal(shares=(1.0, 1.0)):
    """One constituent of a quarter of a day at two places, with a mean."""
    rng = np.random.default_rng(0)
    parts = [rng.uniform(0.1, 0.5, (2, 2, 1)).astype(np.float32) for _ in range(2)]
    places, rate = np.array([[0.0, 0.0], [1000.0, 0.0]], np.float32), np.array([2.9e-4], np.float32)
    mean, depths = np.array([[0.1, 0.2], [0.0, -0.1]], np.float32), np.array([0.0, 50.0], np.float32)
    return HarmonicCurrent(places, rate, *parts, mean, depths, np.array(shares, np.float32))


@pytest.mark.parametrize("kind", ["vortices", "gridded", "sum", "tidal"])
def test_a_current_is_scaled_and_stepped(kind):
    vortices = ap.random_vortices(jax.random.key(0), (0, 0, 0), (1000, 1000, 0), count=3)
    current = {
        "vortices": vortices, "gridded": gridded(), "sum": SumCurrent(gridded(), vortices), "tidal": tidal(),
    }[kind]  # fmt: skip
    before = np.stack(current(*POINTS))
    after = np.stack(perturbed(current, 0.5, np.array([0.3, -0.2, 0.0]))(*POINTS))
    np.testing.assert_allclose(after, 0.5 * before + np.array([[0.3], [-0.2], [0.0]]), atol=1e-5)


def test_an_offset_of_a_tide_is_the_same_at_all_depths():
    current, deep = tidal(shares=(1.0, 0.2)), (100.0, 300.0, 50.0, 60.0)
    gained = np.stack(perturbed(current, offset=(0.3, -0.2, 0.1))(*deep)) - np.stack(current(*deep))
    np.testing.assert_allclose(gained, [0.3, -0.2, 0.1], atol=1e-6)


def test_a_current_of_another_kind_is_refused():
    with pytest.raises(TypeError, match="UniformCurrent"):
        perturbed(ap.UniformCurrent(1.0, 0.0, 0.0), 1.0, np.zeros(3))
