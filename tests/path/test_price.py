"""What places cost beside their time: a user's own term of Eq. 12."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from tests.path.kernels import score

LIGHT = ap.PathConfig.quick().replace(finer=1, passages=0)
BOX = {"lower": (-500.0, -1500.0, 0.0), "upper": (2500.0, 1500.0, 0.0)}
START, GOAL = (0.0, 0.0, 0.0), (2000.0, 0.0, 0.0)
MIDDLE = jnp.array([1000.0, 100.0])


def lane(x, y, z, t):
    """Dear within some 300 m of a point beside the straight line."""
    return 20.0 * jnp.exp(-((x - MIDDLE[0]) ** 2 + (y - MIDDLE[1]) ** 2) / 300.0**2)


def plan(price, **more):
    env = ap.Environment(None, price=price, **BOX)
    return ap.plan_path(START, GOAL, env, key=jax.random.key(0), config=LIGHT, **more)


@pytest.mark.slow
def test_a_price_that_is_the_same_everywhere_multiplies_the_time():
    found = plan(lambda x, y, z, t: 0.5)
    assert found.travel_time == pytest.approx(2000.0 / 2.5, rel=1e-3)
    assert found.cost == pytest.approx(1.5 * found.travel_time, rel=1e-5)


@pytest.mark.slow
def test_paths_keep_off_dear_places_as_far_as_it_pays():
    free, priced = 2000.0 / 2.5, plan(lane)
    nearest = np.linalg.norm(priced.positions[:, :2] - np.asarray(MIDDLE), axis=1).min()
    assert nearest > 300.0
    assert free < priced.travel_time < 1.5 * free
    straight = free + 20.0 * 300.0 * np.sqrt(np.pi) * np.exp(-((100 / 300) ** 2)) / 2.5
    assert priced.cost < 0.5 * straight, "the integral along the straight line, in closed form"
    step = np.linalg.norm(np.diff(priced.positions, axis=0), axis=1)
    middle = 0.5 * (priced.positions[1:] + priced.positions[:-1])
    due = (np.asarray(lane(*middle.T, 0.0)) * step / 2.5).sum()
    assert priced.cost == pytest.approx(priced.travel_time + due, rel=1e-3)


@pytest.mark.slow
def test_prices_that_are_negative_count_as_none():
    assert plan(lambda x, y, z, t: -0.5).cost == pytest.approx(2000.0 / 2.5, rel=1e-3)


def test_the_price_has_gradients():
    env, vehicle = ap.Environment(None, price=lane, **BOX), ap.Vehicle()
    config = LIGHT.replace(control_points=4)
    rows = np.array([[400.0, 800.0, 1200.0, 1600.0, -100.0, -200.0, -250.0, -100.0, 0.0, 0.0, 0.0, 0.0]])

    def cost(rows):
        return score(rows, jnp.array(START), jnp.array(GOAL), 0.0, env, vehicle, config)[0][0]

    cost = jax.jit(cost)
    slope = jax.jit(jax.grad(cost))(rows)[0]
    for k in (1, 5, 6):
        step = 2.0 * np.eye(12)[k]
        by_difference = (cost(rows + step) - cost(rows - step)) / 4.0
        assert slope[k] == pytest.approx(float(by_difference), rel=0.02, abs=2e-3)


@pytest.mark.parametrize(
    ("price", "words"),
    [
        (3.0, "price must be callable"),
        (lambda x, y: 1.0, "price must be callable as"),
        (lambda x, y, z, t: np.sin(x), "JAX cannot trace"),
        (lambda x, y, z, t: (x, y), "one number for each place"),
    ],
)
def test_what_is_no_price_is_refused(price, words):
    with pytest.raises((TypeError, ValueError), match=words):
        ap.Environment(None, price=price, **BOX)
