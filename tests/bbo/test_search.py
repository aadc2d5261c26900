"""The search: init / ask / tell and minimize."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan import bbo
from auvplan.bbo import BBOConfig, ask, search
from auvplan.bbo.search import evaluate, run, uniform_population

LOWER, UPPER = np.full(6, -5.0, np.float32), np.full(6, 5.0, np.float32)
SMALL = BBOConfig(population=20, iterations=15)
#: Each of the ways to migrate, to mutate and to replace is in one of these.
VARIANTS = [
    SMALL,
    SMALL.replace(
        migration="fig6", replacement="generational", rates="constant", immigration=0.8, emigration=0.2,
        mutation_max=0.5, elites=1,
    ),
    SMALL.replace(mutation="uniform", mutation_genes=1.0, mutation_law="constant"),
]  # fmt: skip


init, tell = jax.jit(bbo.init), jax.jit(bbo.tell, static_argnums=4)
run_now = jax.jit(run, static_argnames=("fun", "config", "improve", "period"))


def minimize(*args, **settings) -> bbo.Result:
    """As the package has it, in arrays of NumPy, whose comparisons are not compiled."""
    return jax.device_get(bbo.minimize(*args, **settings))


@partial(jax.jit, static_argnums=1)
def begun(key: jax.Array, count: int) -> bbo.State:
    population = uniform_population(key, count, jnp.asarray(LOWER), jnp.asarray(UPPER))
    return bbo.init(population, *evaluate(sphere, population))


def sphere(x: jax.Array) -> jax.Array:
    return (x**2).sum(axis=1)


def rastrigin(x: jax.Array) -> jax.Array:
    return 10.0 * x.shape[1] + (x**2 - 10.0 * jnp.cos(2.0 * jnp.pi * x)).sum(axis=1)


def partly(x: jax.Array, bad: float) -> jax.Array:
    return jnp.where(x[:, 0] < 0.0, bad, sphere(x))


def penalised(x: jax.Array, weight: float) -> tuple[jax.Array, jax.Array]:
    """The first SIV should be at least 1."""
    violation = jnp.maximum(0.0, 1.0 - x[:, 0])
    return sphere(x) + weight * violation, violation


def integer_cost(x: jax.Array) -> jax.Array:
    return jnp.abs(x - 17).sum(axis=1).astype(jnp.float32)


@pytest.mark.parametrize("config", VARIANTS)
def test_best_never_gets_worse(config: BBOConfig) -> None:
    result = minimize(sphere, LOWER, UPPER, key=jax.random.key(1), config=config)
    assert (np.diff(result.history.best) <= 0.0).all()
    assert result.cost == result.history.best[-1]
    assert sphere(result.x[None])[0] == pytest.approx(float(result.cost), rel=1e-6)
    assert (np.diff(result.state.cost) >= 0.0).all()
    assert ((result.state.population >= LOWER) & (result.state.population <= UPPER)).all()


def test_elites_survive_unchanged() -> None:
    config = SMALL.replace(elites=3, replacement="generational")
    state = jax.device_get(begun(jax.random.key(0), 20))
    worse = np.full(20, 1e6)
    after = jax.device_get(tell(state, state.population + 1.0, worse, np.zeros(20), config))
    np.testing.assert_array_equal(after.population[:3], state.population[:3])
    np.testing.assert_array_equal(after.cost[:3], state.cost[:3])
    assert (after.cost[3:] == 1e6).all()


def test_greedy_replacement_keeps_the_better_of_each_pair() -> None:
    state = init(np.arange(4.0)[:, None], np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(4))
    found, costs = np.arange(10.0, 14.0)[:, None], np.array([5.0, 0.5, np.nan, 3.5])
    after = tell(state, found, costs, np.ones(4), BBOConfig(population=4, replacement="greedy"))
    np.testing.assert_allclose(after.cost, [0.5, 1.0, 3.0, 3.5])
    np.testing.assert_allclose(np.asarray(after.population)[:, 0], [11.0, 0.0, 2.0, 13.0])
    np.testing.assert_allclose(after.violation, [1.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("replacement", ["generational", "greedy"])
def test_costs_that_are_not_finite_rank_last_and_never_win(bad: float, replacement: str) -> None:
    config = SMALL.replace(replacement=replacement)
    result = minimize(partly, LOWER, UPPER, key=jax.random.key(2), config=config, args=(bad,))
    assert np.isfinite(result.cost)
    assert result.x[0] >= 0.0
    assert np.isfinite(result.history.mean).all()
    state = init(np.arange(3.0)[:, None], np.array([bad, 1.0, 2.0]), np.zeros(3))
    np.testing.assert_array_equal(state.cost, [1.0, 2.0, np.inf])


def test_a_cost_that_is_never_finite_ends_without_a_winner() -> None:
    result = minimize(partly, LOWER, 0.0 * UPPER - 1.0, key=jax.random.key(0), config=SMALL, args=(np.nan,))
    assert np.isinf(result.cost)


@pytest.mark.parametrize("migration", ["siv", "fig6"])
def test_integers_stay_integers_within_bounds(migration: str) -> None:
    low, high = np.full(8, -200), np.full(8, 100)
    config = BBOConfig(population=30, iterations=60, migration=migration, mutation_genes=1.0)
    result = minimize(integer_cost, low, high, key=jax.random.key(3), config=config)
    population = result.state.population
    assert population.dtype == jnp.asarray(low).dtype
    assert ((population >= -200) & (population <= 100)).all()
    assert result.cost < result.history.best[0]


def test_same_key_same_result() -> None:
    first, again, other = (
        minimize(sphere, LOWER, UPPER, key=jax.random.key(seed), config=SMALL) for seed in (4, 4, 5)
    )
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert (first.x != other.x).any()


def test_it_may_be_called_inside_jit_and_vmap() -> None:
    keys, small = jax.random.split(jax.random.key(7), 3), SMALL.replace(iterations=5)

    def cost(key: jax.Array, upper: jax.Array) -> jax.Array:
        return minimize(sphere, LOWER, upper, key=key, config=small).cost

    alone = [float(minimize(sphere, LOWER, UPPER, key=key, config=small).cost) for key in keys]
    together = jax.jit(jax.vmap(cost, in_axes=(0, None)))(keys, UPPER)
    np.testing.assert_allclose(together, alone, rtol=1e-5)
    with pytest.raises(ValueError, match="vectors of one length"):
        jax.jit(cost)(keys[0], UPPER[:2])


@pytest.mark.parametrize("config", VARIANTS[:2])
def test_ask_and_tell_by_hand_equal_minimize(config: BBOConfig) -> None:
    key = jax.random.key(6)
    low, high = jnp.asarray(LOWER), jnp.asarray(UPPER)
    start_key, run_key = jax.random.split(key)
    state = begun(start_key, config.population)

    @jax.jit
    def step(key: jax.Array, state: bbo.State) -> bbo.State:
        found = ask(key, state, low, high, config=config)
        return bbo.tell(state, found, *evaluate(sphere, found), config)

    for generation_key in jax.random.split(run_key, config.iterations):
        state = step(generation_key, state)
    state = jax.device_get(state)
    result = minimize(sphere, LOWER, UPPER, key=key, config=config)
    np.testing.assert_allclose(result.state.cost, state.cost, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(result.x, state.population[0], rtol=1e-4, atol=1e-4)


def test_history_holds_the_initial_population_and_every_iteration() -> None:
    result = minimize(sphere, LOWER, UPPER, key=jax.random.key(0), config=SMALL)
    for row in jax.tree.leaves(result.history):
        assert row.shape == (SMALL.iterations + 1,)
    nothing = minimize(sphere, LOWER, UPPER, key=jax.random.key(0), config=SMALL.replace(iterations=0))
    assert nothing.history.best.shape == (1,)
    assert nothing.cost == result.history.best[0]


def test_violations_are_reported_beside_the_cost() -> None:
    config = SMALL.replace(iterations=60)
    result = minimize(penalised, LOWER, UPPER, key=jax.random.key(0), config=config, args=(100.0,))
    assert result.history.violation_best[-1] == result.violation
    assert result.history.violation_mean[-1] < result.history.violation_mean[0]
    assert result.violation == pytest.approx(max(0.0, 1.0 - float(result.x[0])), abs=1e-6)
    as_list = minimize(
        lambda x: list(penalised(x, 100.0)), LOWER, UPPER, key=jax.random.key(0), config=config
    )
    np.testing.assert_array_equal(as_list.x, result.x)


def test_a_given_population_is_used() -> None:
    optimum = np.zeros((1, 6), np.float32)
    nothing = {"key": jax.random.key(0), "config": SMALL.replace(iterations=0)}
    result = minimize(sphere, LOWER, UPPER, population=optimum, **nothing)
    assert result.cost == 0.0
    outside = minimize(sphere, LOWER, UPPER, population=optimum + 99, **nothing)
    assert outside.state.population.max() <= 5.0
    again = minimize(
        sphere, LOWER, UPPER, key=jax.random.key(1), config=SMALL, population=result.state.population
    )
    assert again.cost == 0.0


def test_the_default_is_what_plans_paths() -> None:
    """Of real vectors and of integers, with and without settings."""
    planners = ap.PathConfig().bbo.replace(iterations=100)
    for config in (None, planners):
        found = minimize(sphere, LOWER, UPPER, key=jax.random.key(0), config=config)
        assert found.history.best.shape == (101,)
        assert found.cost < 0.05, "uniform samples, as many, reach about 2"
        np.testing.assert_array_equal(
            found.x, minimize(sphere, LOWER, UPPER, key=jax.random.key(0), config=BBOConfig()).x
        )
    assert ap.MissionConfig().bbo.replacement == BBOConfig().replacement
    whole = minimize(integer_cost, np.full(6, 0), np.full(6, 40), key=jax.random.key(0))
    assert whole.x.dtype == jnp.asarray(np.full(6, 0)).dtype
    assert float(whole.cost) < 3.0


@pytest.mark.parametrize("stop", [20.0, 30.0])
def test_a_search_stops_at_a_cost_that_is_good_enough(stop: float) -> None:
    full = minimize(rastrigin, LOWER, UPPER, key=jax.random.key(0), config=SMALL)
    short = minimize(rastrigin, LOWER, UPPER, key=jax.random.key(0), config=SMALL, stop=stop)
    first = int(np.argmax(full.history.best <= stop))
    assert 0 < first < SMALL.iterations
    np.testing.assert_allclose(short.history.best[: first + 1], full.history.best[: first + 1], rtol=1e-4)
    assert (short.history.best[first:] == short.cost).all()


def test_a_violation_does_not_stop_a_search() -> None:
    result = minimize(penalised, LOWER[:2], UPPER[:2], key=jax.random.key(0), stop=1.1, args=(10.0,))
    assert float(result.violation) == 0.0
    assert float(result.cost) <= 1.1


def test_problem_data_in_args_compiles_once() -> None:
    before = search._run._cache_size()

    def shifted(x: jax.Array, centre: jax.Array) -> jax.Array:
        return sphere(x - centre)

    first = minimize(shifted, LOWER, UPPER, key=jax.random.key(0), config=SMALL, args=(jnp.zeros(6),))
    second = minimize(
        shifted, LOWER - 1, UPPER, key=jax.random.key(1), config=SMALL, args=(jnp.zeros(6) + 2.0,)
    )
    assert search._run._cache_size() == before + 1
    assert float(jnp.abs(first.x - second.x).sum()) > 1.0


def test_a_function_is_compiled_again_once_what_it_reads_has_changed() -> None:
    at, settings = [0.0], {"key": jax.random.key(0), "config": BBOConfig()}

    class Shifted:
        def __call__(self, x: jax.Array) -> jax.Array:
            return sphere(x - at[0])

    for fun in (lambda x: sphere(x - at[0]), partial(lambda at, x: sphere(x - at[0]), at), Shifted()):
        at[0] = 0.0
        first = minimize(fun, LOWER, UPPER, **settings)
        at[0] = 2.0
        second = minimize(fun, LOWER, UPPER, **settings)
        np.testing.assert_allclose([first.x, second.x], [np.zeros(6), np.full(6, 2.0)], atol=0.5)


def test_an_array_that_is_changed_in_place_is_read_again() -> None:
    centre = np.zeros(6)

    def shifted(x: jax.Array) -> jax.Array:
        return sphere(x - centre)

    for wanted in (0.0, 2.0, 0.0):
        centre[:] = wanted
        for fun in (shifted, lambda x: sphere(x - centre)):
            found = minimize(fun, LOWER, UPPER, key=jax.random.key(0), config=BBOConfig())
            np.testing.assert_allclose(found.x, centre, atol=0.5)


@dataclass
class Shifted:
    """An object without a hash."""

    by: float

    def __call__(self, x: jax.Array) -> jax.Array:
        return sphere(x - self.by)


def test_an_object_is_minimised_as_it_is_now() -> None:
    shifted = Shifted(0.0)
    for shifted.by in (0.0, 2.0):
        found = minimize(shifted, LOWER, UPPER, key=jax.random.key(0), config=BBOConfig())
        np.testing.assert_allclose(found.x, np.full(6, shifted.by), atol=0.5)


BAD = [
    {"population": 1}, {"iterations": -1}, {"elites": 100}, {"elites": -1}, {"immigration": 1.1},
    {"emigration": 0.0}, {"mutation_max": -0.1}, {"mutation_genes": -1.0}, {"mutation_step": -1.0},
    {"migration": "both"}, {"rates": "square"}, {"mutation_law": "none"}, {"mutation": "cauchy"},
    {"replacement": "all"},
]  # fmt: skip


@pytest.mark.parametrize("setting", BAD)
def test_bad_settings_are_refused(setting: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(setting))):
        BBOConfig(**setting)


def test_bad_arguments_are_refused() -> None:
    key = jax.random.key(0)
    with pytest.raises(ValueError, match="one length"):
        minimize(sphere, LOWER, UPPER[:3], key=key)
    with pytest.raises(ValueError, match="must not exceed"):
        minimize(sphere, UPPER, LOWER, key=key)
    with pytest.raises(ValueError, match="population must be"):
        minimize(sphere, LOWER, UPPER, key=key, config=SMALL, population=np.zeros((21, 6)))
    for bounds in (([False] * 3, [True] * 3), ([0] * 3, [True] * 3), ([0] * 3, ["a"] * 3)):
        with pytest.raises(ValueError, match=r"bounds must be integers or real numbers, got (bool|<U1)"):
            minimize(sphere, *bounds, key=key)
    for fun in (lambda x: (x**2).sum(), lambda x: (sphere(x), 0.0)):
        with pytest.raises(ValueError, match=r"must return \[20\], got shape \(\): jax.vmap"):
            minimize(fun, LOWER, UPPER, key=key, config=SMALL)
    gaussian = SMALL.replace(mutation="gaussian")
    with pytest.raises(ValueError, match="real SIVs"):
        minimize(integer_cost, np.zeros(3, int), np.ones(3, int), key=key, config=gaussian)


def test_a_memetic_step_lowers_the_cost_and_keeps_the_history_whole() -> None:
    """Halving the distance to the optimum always succeeds; a step that finds nothing changes nothing."""
    lower, upper = jnp.asarray(LOWER), jnp.asarray(UPPER)
    population = begun(jax.random.key(0), 20).population
    arguments = (jax.random.key(1), sphere, population, lower, upper, SMALL)
    plain, memetic, idle = (
        jax.device_get(run_now(*arguments, improve=improve, period=4))
        for improve in (None, lambda population: population[:5] / 2.0, lambda population: population[-3:])
    )
    assert memetic.history.best.shape == plain.history.best.shape == (SMALL.iterations + 1,)
    assert memetic.cost < plain.cost
    assert memetic.history.best[1] <= memetic.history.best[0] / 4.0 * (1.0 + 1e-5)
    assert (np.diff(memetic.history.best) <= 0.0).all()
    np.testing.assert_array_equal(plain.state.population, idle.state.population)


def test_the_answer_violates_nothing_where_any_habitat_did_not():
    """The least cost lies where the violation is large: the search goes there, the answer stays."""
    config = SMALL.replace(iterations=60)
    result = minimize(penalised, LOWER, UPPER, key=jax.random.key(3), config=config, args=(0.0,))
    assert float(result.state.violation[0]) > 0.0, "the habitat of least cost is another"
    assert float(result.violation) == 0.0
    assert float(result.x[0]) >= 1.0
    np.testing.assert_allclose(float(result.cost), float((result.x**2).sum()), rtol=1e-6)


@pytest.mark.parametrize("upper", [UPPER, np.array([0.5, *UPPER[1:]], np.float32)])
@pytest.mark.parametrize(("weight", "stop"), [(0.0, None), (3.0, 0.0), (3.0, None)])
@pytest.mark.parametrize("elites", [0, 1])
def test_the_answer_is_the_best_that_was_met_even_where_no_elite_keeps_it(upper, weight, stop, elites):
    """Every habitat that is scored is written down; with an upper bound of 0.5 none is without violation."""
    met = []

    def noted(x: jax.Array) -> tuple[jax.Array, jax.Array]:
        cost, violation = penalised(x, weight)
        jax.debug.callback(lambda *scored: met.append(np.stack(scored)), cost, violation)
        return cost, violation

    config = SMALL.replace(elites=elites, replacement="generational", mutation_max=0.5)
    found = minimize(noted, LOWER, upper, key=jax.random.key(5), config=config, stop=stop)
    jax.effects_barrier()
    cost, violation = np.concatenate(met, axis=1)
    assert len(cost) == config.population * (config.iterations + 1)
    kept = violation == 0.0 if upper[0] > 1.0 else np.isfinite(cost)
    assert float(found.cost) == cost[kept].min()
    assert (float(found.violation) == 0.0) == (upper[0] > 1.0)
    assert penalised(found.x[None], weight)[0][0] == pytest.approx(float(found.cost), rel=1e-6)


def test_without_a_feasible_habitat_the_answer_is_of_least_cost():
    config = SMALL.replace(iterations=60)
    below = np.array([0.5, *UPPER[1:]], np.float32)
    result = minimize(penalised, LOWER, below, key=jax.random.key(3), config=config, args=(0.0,))
    assert float(result.violation) >= 0.5
    assert float(result.cost) == float(result.state.cost[0])


@pytest.mark.parametrize(
    ("kind", "lower", "upper", "best"),
    [
        (np.uint8, 0, 255, 200),
        (np.int8, -128, 127, 100),
        (np.int8, -100, 100, 90),
        (np.int32, -(10**9), 10**9, 5 * 10**8),
    ],
)
def test_integers_of_any_type_are_searched_within_their_bounds(kind, lower, upper, best):
    config = BBOConfig(population=40, iterations=60)
    found = minimize(
        lambda x: jnp.abs(x.astype(float) - best).sum(axis=1),
        np.asarray([lower], kind), np.asarray([upper], kind), key=jax.random.key(0), config=config,
    )  # fmt: skip
    assert abs(float(found.x[0]) - best) < 0.02 * (upper - lower)
    assert lower <= int(found.x[0]) <= upper


@pytest.mark.parametrize(("lower", "upper"), [(0, 2.5), (0.0, 3), (0, 3)])
@pytest.mark.parametrize("traced", [False, True])
def test_integers_are_searched_only_where_both_bounds_are_integers(lower, upper, traced):
    def least(low, high):
        return bbo.minimize(lambda x: ((x - 1.3) ** 2).sum(axis=1), low, high, key=jax.random.key(0)).x

    whole = isinstance(lower, int) and isinstance(upper, int)
    found = (jax.jit(least) if traced else least)(np.full(2, lower), np.full(2, upper))
    assert jnp.issubdtype(found.dtype, jnp.integer) == whole
    np.testing.assert_allclose(found, 1.0 if whole else 1.3, atol=0.01)


@pytest.mark.parametrize("kind", [int, bool])
def test_costs_and_violations_may_be_integers(kind):
    """Without warnings, which fail a test."""
    key, low, high = jax.random.key(0), [-5, -5], [5, 5]
    assert float(minimize(lambda x: (x**2).sum(axis=1), low, high, key=key, config=SMALL).cost) == 0.0
    found = minimize(
        lambda x: ((x**2).sum(axis=1), (x[:, 0] < 2).astype(kind)), low, high, key=key, config=SMALL
    )
    np.testing.assert_array_equal([found.cost, *found.x], [4, 2, 0])


@pytest.mark.parametrize(("lower", "upper"), [(0, 2**31 - 1), (-(2**31), 5), (-(2**30), 2**30)])
def test_more_integers_than_are_counted_are_refused(lower, upper):
    with pytest.raises(ValueError, match=f"integers from {lower} to {upper} are more than int32 holds"):
        minimize(lambda x: x.sum(axis=1), np.asarray([lower]), np.asarray([upper]), key=jax.random.key(0))


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_bounds_are_finite(wrong):
    with pytest.raises(ValueError, match="bounds must be finite"):
        minimize(lambda x: x.sum(axis=1), [-wrong, 0.0], [1.0, 1.0], key=jax.random.key(0))
