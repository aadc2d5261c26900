"""Migration that favours no axis: differential and covariance."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from auvplan.bbo import BBOConfig, covariance, differential, init, minimize, run, tell
from auvplan.bbo.operators import reflect
from auvplan.bbo.search import evaluate, uniform_population

DIM = 4
LOWER, UPPER = jnp.full(DIM, -5.0), jnp.full(DIM, 5.0)
NAMES = ("differential", "covariance")


def settings(name: str, evaluations: int = 2000) -> BBOConfig:
    return BBOConfig.rotated(DIM, evaluations, name)


def rotation(seed: int, dim: int = DIM) -> jax.Array:
    return jnp.linalg.qr(jax.random.normal(jax.random.key(seed), (dim, dim)))[0]


def ellipsoid(x: jax.Array, turn: jax.Array) -> jax.Array:
    return (((x - 1.0) @ turn) ** 2 * 10.0 ** jnp.linspace(0.0, 4.0, x.shape[1])).sum(axis=1)


def rastrigin(x: jax.Array) -> jax.Array:
    return (x**2 + 10.0 - 10.0 * jnp.cos(2.0 * jnp.pi * x)).sum(axis=1)


def outside(x: jax.Array) -> jax.Array:
    """Its least value within the bounds is at a corner."""
    return x @ jnp.array([1.0, -2.0, 5.0, 10.0])


def test_weights_of_ten_habitats_in_ten_dimensions() -> None:
    """Against the figures of Hansen's tutorial, table 1, for lambda = n = 10, computed by hand."""
    found = covariance.weights(40, jnp.asarray(10), 10)
    raw = np.log(5.5) - np.log(np.arange(1, 6))
    share = raw / raw.sum()
    np.testing.assert_allclose(found.mean[:5], share, rtol=1e-5)
    mass = 1.0 / (share**2).sum()
    assert float(found.mass) == pytest.approx(mass, rel=1e-5)
    assert float(found.step_rate) == pytest.approx((mass + 2) / (15 + mass), rel=1e-5)
    assert float(found.rank_one) == pytest.approx(2 / (11.3**2 + mass), rel=1e-5)
    assert (found.rank[5:10] < 0.0).all()
    assert (found.rank[10:] == 0.0).all()
    # The covariance stays positive: what the worse half takes away is less than what is there.
    assert float(1 - found.rank_one - found.rank_mu + 10 * found.rank_mu * found.rank[5:].sum()) > -1e-6


def test_reflection_is_a_mirror_at_the_bounds() -> None:
    given = jnp.array([[-5.5, 5.25, 15.5, 2.0], [-14.0, 25.0, -5.0, 5.0]])
    np.testing.assert_allclose(
        reflect(given, LOWER, UPPER), [[-4.5, 4.75, -4.5, 2.0], [4.0, 5.0, -5.0, 5.0]], atol=1e-5
    )
    still = jnp.full((1, DIM), 3.0)
    np.testing.assert_array_equal(reflect(still, LOWER * 0 + 1.0, LOWER * 0 + 1.0), still * 0 + 1.0)


def test_covariance_learns_the_same_from_turned_habitats() -> None:
    """A turn of all habitats turns the mean and the covariance and leaves the step."""
    config = BBOConfig(population=12, migration="covariance")
    turn = rotation(1)
    blank = covariance.blank(jnp.zeros((12, DIM)), jnp.zeros(12), config)
    plain = turned = replace(blank, fresh=jnp.bool_(False))
    for key in jax.random.split(jax.random.key(0), 8):
        x = plain.mean + plain.step * jax.random.normal(key, (12, DIM))
        cost = ellipsoid(x, jnp.eye(DIM))
        plain = covariance.tell(plain, x, cost, config, None)
        turned = covariance.tell(turned, x @ turn.T, cost, config, None)
    assert float(jnp.abs(plain.mean).max()) > 0.1
    np.testing.assert_allclose(turned.mean, turn @ plain.mean, atol=1e-3)
    np.testing.assert_allclose(turned.covariance, turn @ plain.covariance @ turn.T, atol=2e-3)
    np.testing.assert_allclose(turned.step, plain.step, rtol=1e-3)


def test_differences_turn_with_the_habitats() -> None:
    """Without crossover and bounds, candidates of turned habitats are turned candidates."""
    config = BBOConfig(population=12, migration="differential")
    wide = jnp.full(DIM, 1e3)
    turn = rotation(2)
    x = jax.random.normal(jax.random.key(0), (12, DIM))
    cost = ellipsoid(x, jnp.eye(DIM))
    asked = []
    for habitats in (x, x @ turn.T):
        state = init(habitats, cost, jnp.zeros(12), config=config)
        memory = replace(state.memory, crossovers=jnp.full(differential.HISTORY, 9.0))
        asked.append(differential.ask(jax.random.key(1), memory, -wide, wide, config))
    np.testing.assert_allclose(asked[1], asked[0] @ turn.T, atol=1e-4)


@pytest.mark.parametrize("name", NAMES)
def test_turned_problems_are_as_easy_as_straight_ones(name: str) -> None:
    config = settings(name, 4000)
    straight, turned = (
        np.median(
            [
                float(
                    minimize(ellipsoid, LOWER, UPPER, key=jax.random.key(k), config=config, args=(turn,)).cost
                )
                for k in range(7)
            ]
        )
        for turn in (jnp.eye(DIM), rotation(3))
    )
    plain = BBOConfig(iterations=39)
    siv = minimize(ellipsoid, LOWER, UPPER, key=jax.random.key(0), config=plain, args=(rotation(3),)).cost
    assert max(straight, turned) < 1e-5 < float(siv)


@pytest.mark.parametrize("name", NAMES)
def test_an_optimum_at_a_corner_is_reached_within_bounds(name: str) -> None:
    result = minimize(outside, LOWER, UPPER, key=jax.random.key(0), config=settings(name))
    np.testing.assert_allclose(result.x, [-5.0, 5.0, -5.0, -5.0], atol=1e-2)
    assert ((result.state.population >= LOWER) & (result.state.population <= UPPER)).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_stall_starts_anew_and_keeps_the_best(name: str) -> None:
    config = settings(name, 18_000)
    result = minimize(rastrigin, LOWER, UPPER, key=jax.random.key(2), config=config)
    assert int(result.state.memory.restarts) >= 1
    assert (jnp.diff(result.history.best) <= 0.0).all()
    assert float(rastrigin(result.x[None])[0]) == pytest.approx(float(result.cost), abs=1e-4)
    once = minimize(rastrigin, LOWER, UPPER, key=jax.random.key(2), config=config.replace(restarts=0))
    assert int(once.state.memory.restarts) == 0
    assert float(result.cost) <= float(once.cost)


@pytest.mark.parametrize("name", NAMES)
def test_the_best_habitats_survive_worse_candidates(name: str) -> None:
    config = settings(name)
    population = uniform_population(jax.random.key(0), config.population, LOWER, UPPER)
    state = init(population, *evaluate(rastrigin, population), config=config)
    worse = jnp.full(config.population, 1e6)
    after = tell(state, population * 0.5, worse, worse * 0.0, config, jax.random.key(1))
    np.testing.assert_array_equal(after.population, state.population)
    np.testing.assert_array_equal(after.cost, state.cost)


@pytest.mark.parametrize("name", NAMES)
def test_a_batch_equals_a_loop(name: str) -> None:
    config = settings(name, 600)
    keys = jax.random.split(jax.random.key(0), 3)
    turns = jnp.stack([rotation(k) for k in range(3)])

    def search(key: jax.Array, turn: jax.Array) -> jax.Array:
        start = uniform_population(key, config.population, LOWER, UPPER)
        return run(key, ellipsoid, start, LOWER, UPPER, config, (turn,)).history.best

    batch = jax.jit(jax.vmap(search))(keys, turns)
    loop = jnp.stack([jax.jit(search)(key, turn) for key, turn in zip(keys, turns, strict=True)])
    np.testing.assert_allclose(batch[:, :8], loop[:, :8], rtol=1e-3)
    # Later, rounding makes the paths part.
    assert (batch[:, -1] <= batch[:, 0] * 0.1).all()


@pytest.mark.parametrize("name", NAMES)
def test_same_key_same_result_without_compiling_again(name: str) -> None:
    traces = 0

    def counted(x: jax.Array) -> jax.Array:
        nonlocal traces
        traces += 1
        return rastrigin(x)

    config = settings(name)
    first = minimize(counted, LOWER, UPPER, key=jax.random.key(4), config=config)
    before = traces
    again = minimize(counted, LOWER, UPPER, key=jax.random.key(4), config=config)
    other = minimize(counted, LOWER - 1.0, UPPER, key=jax.random.key(5), config=config)
    assert traces == before
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert (first.x != other.x).any()


@pytest.mark.parametrize("name", NAMES)
def test_costs_that_are_not_finite_never_win(name: str) -> None:
    def partly(x: jax.Array) -> jax.Array:
        return jnp.where(x[:, 0] < 0.0, jnp.nan, rastrigin(x))

    result = minimize(partly, LOWER, UPPER, key=jax.random.key(0), config=settings(name))
    assert float(result.x[0]) >= 0.0
    assert float(result.cost) < 10.0
    never = minimize(
        lambda x: x[:, 0] * jnp.nan, LOWER, UPPER, key=jax.random.key(0), config=settings(name, 600)
    )
    assert jnp.isinf(never.cost)


@pytest.mark.parametrize("name", NAMES)
def test_a_fixed_siv_stays_and_the_others_are_found(name: str) -> None:
    low, high = LOWER.at[1].set(2.0), UPPER.at[1].set(2.0)
    result = minimize(lambda x: (x**2).sum(axis=1), low, high, key=jax.random.key(0), config=settings(name))
    np.testing.assert_allclose(result.x, [0.0, 2.0, 0.0, 0.0], atol=1e-2)


@pytest.mark.parametrize("name", NAMES)
def test_integers_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match="real SIVs"):
        minimize(lambda x: x.sum(axis=1) * 1.0, [0, 0], [9, 9], key=jax.random.key(0), config=settings(name))


def test_defaults_are_covariance_for_reals_and_siv_for_integers() -> None:
    real = minimize(rastrigin, LOWER, UPPER, key=jax.random.key(0))
    assert isinstance(real.state.memory, covariance.Memory)
    whole = minimize(lambda x: (x**2).sum(axis=1) * 1.0, [-9, -9], [9, 9], key=jax.random.key(0))
    assert whole.state.memory == ()
    assert float(whole.cost) == 0.0


def test_too_few_evaluations_are_refused() -> None:
    with pytest.raises(ValueError, match="evaluations"):
        BBOConfig.rotated(DIM, 3)


@pytest.mark.parametrize("config", [BBOConfig(), settings("covariance")])
def test_a_search_stops_at_a_cost_that_is_good_enough(config: BBOConfig) -> None:
    full = minimize(rastrigin, LOWER, UPPER, key=jax.random.key(0), config=config)
    short = minimize(rastrigin, LOWER, UPPER, key=jax.random.key(0), config=config, stop=20.0)
    first = int(jnp.argmax(full.history.best <= 20.0))
    assert 0 < first < config.iterations
    np.testing.assert_allclose(short.history.best[: first + 1], full.history.best[: first + 1], rtol=1e-4)
    assert (short.history.best[first:] == short.cost).all()


def test_a_violation_does_not_stop_a_search() -> None:
    def fun(x: jax.Array) -> tuple[jax.Array, jax.Array]:
        violation = jnp.maximum(0.0, 1.0 - x[:, 0])
        return (x**2).sum(axis=1) + 10.0 * violation, violation

    result = minimize(fun, LOWER, UPPER, key=jax.random.key(0), stop=1.01)
    assert float(result.violation) == 0.0
    assert float(result.cost) <= 1.01
