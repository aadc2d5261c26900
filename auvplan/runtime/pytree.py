"""Pytrees whose constructors complete what they are given; kinds of arrays in them."""

from dataclasses import fields
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

T = TypeVar("T", bound=type)


def register_without_init(cls: T) -> T:
    """Register a dataclass of data fields as a pytree that JAX rebuilds without its constructor.

    A constructor may fill in defaults and check shapes. JAX rebuilds objects around tracers, placeholders and
    batches, which are taken as they are.
    """
    names = tuple(field.name for field in fields(cls))

    def with_keys(tree: Any) -> tuple[tuple, None]:
        return tuple((jax.tree_util.GetAttrKey(name), getattr(tree, name)) for name in names), None

    def flat(tree: Any) -> tuple[tuple, None]:
        return tuple(getattr(tree, name) for name in names), None

    def rebuilt(_: None, children: Any) -> Any:
        tree = object.__new__(cls)
        for name, child in zip(names, children, strict=True):
            object.__setattr__(tree, name, child)
        return tree

    jax.tree_util.register_pytree_with_keys(cls, with_keys, rebuilt, flat)
    return cls


def row_kinds(tree: Any) -> Any:
    """Return the shapes and types that the rows of a batch have, without looking at its arrays."""
    return jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(np.shape(leaf)[1:], jnp.result_type(leaf)), tree)
