"""Pytrees that JAX rebuilds without their constructors."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

import auvplan as ap
from auvplan.runtime.pytree import register_without_init


@register_without_init
@dataclass(frozen=True)
class Checked:
    """A class whose constructor completes and checks."""

    numbers: jax.Array
    scale: float = 1.0

    def __post_init__(self):
        object.__setattr__(self, "numbers", jnp.asarray(self.numbers, float))
        assert self.numbers.ndim == 1


def test_batches_placeholders_and_host_arrays_pass_unchecked():
    one = Checked([1.0, 2.0])
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), one, one)
    assert isinstance(batch.numbers, np.ndarray)
    assert batch.numbers.shape == (2, 2)
    assert jax.tree.map(lambda _: None, one, is_leaf=lambda leaf: leaf is None).numbers is None
    doubled = jax.jit(jax.vmap(lambda tree: tree.numbers.sum() * tree.scale))(batch)
    np.testing.assert_allclose(doubled, [3.0, 3.0])


def test_paths_of_leaves_carry_the_names_of_fields():
    leaves = jax.tree_util.tree_flatten_with_path(Checked([1.0]))[0]
    assert [jax.tree_util.keystr(path) for path, _ in leaves] == [".numbers", ".scale"]


def test_vortices_may_be_stacked_on_the_host():
    fields = [ap.random_vortices(jax.random.key(k), (0, 0, 0), (900, 900, 0), count=3) for k in range(2)]
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *fields)
    assert stacked.centers.shape == (2, *fields[0].centers.shape)
    first = jax.tree.map(lambda leaf: leaf[0], stacked)
    point = jnp.array([100.0]), jnp.array([200.0]), jnp.array([0.0]), 0.0
    for mine, theirs in zip(first(*point), fields[0](*point), strict=True):
        np.testing.assert_array_equal(mine, theirs)
