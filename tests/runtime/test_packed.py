"""Grids packed: other sizes need no other program, and what is looked up has the same bits."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.ocean.closures import Closure
from auvplan.runtime.compiled import compilations, compiled
from auvplan.runtime.packed import Packed, in_form_of
from tests.path.worlds import CONFIG

#: Settings of next to no search, for paths that are straight.
STRAIGHT = CONFIG.replace(bbo=CONFIG.bbo.replace(iterations=2), passages=0, refine_steps=0, finer=1)

#: Times, depths, and nodes of a current; pixels of chart and bed.
ALIKE = [((3, 4, 5, 6), (30, 40)), ((12, 14, 3, 2), (2, 60)), ((5, 3, 4, 9), (40, 22))]


def world(nodes, pixels, even=True, seed=0):
    rng = np.random.default_rng(seed)
    times = 60.0 * np.arange(nodes[0]) if even else np.cumsum(rng.uniform(20.0, 90.0, nodes[0]))
    current = ap.GriddedCurrent.from_arrays(
        *rng.normal(size=(3, *nodes)), spacing=(70.0, 90.0), origin=(-20.0, 10.0), times=times,
        depths=np.cumsum(rng.uniform(1.0, 3.0, nodes[1])),
    )  # fmt: skip
    chart = ap.Chart.from_mask(rng.random(pixels) > 0.1, 10.0)
    bed = ap.Seabed.from_depth(rng.uniform(5.0, 50.0, pixels), 10.0)
    corner = 10.0 * (np.array(pixels) - 1.0)
    return ap.Environment(current, chart, lower=(0, 0, 0), upper=(*corner, 50), seabed=bed)


def looked_up(env, x, y, z, t):
    def toward(x, y, z, t):
        return sum(env.current(x, y, z, t)) + env.chart.distance(x, y) + env.seabed.depth_at(x, y)

    slopes = jax.vmap(jax.grad(toward, argnums=(0, 1, 2, 3)))(x, y, z, t)
    bed = env.seabed.shallowest_at(x, y, 0.1 * jnp.abs(t))
    return env.current(x, y, z, t), env.chart.distance(x, y), bed, slopes, env.chart.upper


def test_grids_of_other_sizes_are_looked_up_by_one_program_with_the_same_bits() -> None:
    program = compiled(lambda env, *places: looked_up(env, *places))
    plain = jax.jit(looked_up)
    rng = np.random.default_rng(1)
    places = [
        jnp.asarray(rng.uniform(-100.0, most, 500), jnp.float32) for most in (900.0, 900.0, 60.0, 900.0)
    ]
    for k, sizes in enumerate(ALIKE[:2]):
        env = world(*sizes, even=False, seed=k)
        jax.tree.map(np.testing.assert_array_equal, program(env, *places), plain(env, *places))
    env = world(*ALIKE[2], even=False)
    before = compilations()
    program(env, *places)
    assert compilations() == before


@pytest.mark.parametrize("even", [True, False])
def test_derivatives_by_what_is_packed_are_those_by_what_is_given(even) -> None:
    rng = np.random.default_rng(2)
    env, places = world(*ALIKE[0], even=even), tuple(rng.uniform(10.0, 200.0, (4, 20)).astype(np.float32))
    hours = np.arange(3.0, dtype=np.float32)
    given = replace(env, closures=(Closure(env.chart, hours, hours + 1.0, "area", "outline"),))

    def toward(env, *places):
        (shut,), found = env.closures, env.current(*places)
        distance, bed = env.chart.distance(*places[:2]), env.seabed.depth_at(*places[:2])
        until = jnp.where(jnp.isfinite(shut.ends), shut.ends, 0.0) ** 2 * shut.chart.distance(*places[:2])[0]
        return sum(map(jnp.sum, (*found, distance, bed, until)))

    def slopes(env, *places):
        leaves = jax.tree.leaves(jax.grad(toward, allow_int=True)(env, *places))
        return [jnp.zeros(()) if leaf.dtype == jax.dtypes.float0 else leaf for leaf in leaves]

    expected, found = jax.jit(slopes)(given, *places), in_form_of(given, compiled(slopes)(given, *places))
    for one, other, leaf in zip(found, expected, jax.tree.leaves(given), strict=True):
        if jnp.issubdtype(jnp.result_type(leaf), jnp.floating):
            assert one.shape == jnp.shape(leaf)
            np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5)
        else:
            assert not one.any()


@pytest.mark.parametrize("config", [STRAIGHT, pytest.param(ap.PathConfig.quick(), marks=pytest.mark.slow)])
def test_a_path_in_an_area_of_another_size_compiles_nothing(config) -> None:
    """Another area with a longer forecast, and a closed area of another name and outline at other hours."""
    for k, sizes in enumerate((ALIKE[0], ((30, *ALIKE[2][0][1:]), ALIKE[2][1]))):
        env = world(*sizes, seed=k)
        open_water = ap.Chart.from_mask(np.ones(sizes[1], bool), 10.0)
        weak = replace(env.current, u=0.1 * env.current.u, v=0.1 * env.current.v, w=0.0 * env.current.w)
        hours = np.arange(3.0 + k) * 86_400.0 + 43_200.0
        shut = Closure(
            ap.Chart.from_mask(np.zeros(sizes[1], bool), 10.0), hours, hours + 60.0, f"{k}", f"{k}"
        )
        env = replace(env, chart=open_water, seabed=None, current=weak, closures=(shut,))
        before = compilations()
        plan = ap.plan_path((40, 40, 5), (250, 190, 5), env, key=jax.random.key(0), config=config)
        assert plan.feasible, plan.reason
    assert compilations() == before


def test_places_that_nothing_traces_are_looked_up_without_compiling() -> None:
    env, rng = world(*ALIKE[0]), np.random.default_rng(2)
    look_up = jax.jit(lambda x, y: (env.chart.distance(x, y), env.seabed.depth_at(x, y)))
    env.chart.distance(0.0, 0.0)
    for count in (3, 5, 17):
        x, y = rng.uniform(-50.0, 450.0, (2, count)).astype(np.float32)
        before = compilations()
        found = env.chart.distance(x, y), env.seabed.depth_at(x, y)
        assert compilations() == before
        jax.tree.map(partial(np.testing.assert_allclose, atol=1e-3), found, look_up(x, y))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Weaker:
    """A current of somebody else's, who looks at the arrays of the one that it is made of."""

    field: ap.GriddedCurrent

    def __call__(self, x, y, z, t):
        return replace(self.field, u=jnp.clip(self.field.u, -0.1, 0.1))(x, y, z, t)


def test_grids_that_classes_of_others_hold_stay_as_they_are() -> None:
    field = world(*ALIKE[0]).current
    program = compiled(lambda current, *place: current(*place)[0])
    assert float(program(Weaker(field), 50.0, 50.0, 2.0, 60.0)) == pytest.approx(
        float(replace(field, u=np.clip(field.u, -0.1, 0.1))(50.0, 50.0, 2.0, 60.0)[0])
    )


def test_what_is_traced_or_stacked_stays_as_it_is() -> None:
    chart = world(*ALIKE[0]).chart
    assert isinstance(chart.packed.signed_distance, Packed)
    assert chart.packed is chart.packed
    both = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), chart)
    assert both.packed is both
    assert jax.jit(lambda chart: chart.packed.signed_distance)(chart).shape == chart.shape
