"""Pytrees whose constructors complete what they are given; kinds of arrays in them, and their tangents."""

from dataclasses import fields
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

T = TypeVar("T", bound=type)

#: Packages whose classes are what this package knows them to be, as long as their versions are.
_OURS = "auvplan", "builtins", "collections", "jax", "jaxlib", "numpy"


def is_ours(kind: type) -> bool:
    """Return whether a class is of this package or of what it is built on."""
    return kind.__module__.split(".")[0] in _OURS


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


def is_symbolic_zero(tangents: Any) -> bool:
    """Return whether none of the arguments behind a tree of tangents is differentiated.

    For rules of `jax.custom_jvp` with symbolic zeros, as is `instantiated`.
    """
    return all(isinstance(tangent, SymbolicZero) for tangent in jax.tree.leaves(tangents))


def instantiated(tangents: Any, primals: Any) -> Any:
    """Return the same tree of tangents with arrays in place of symbolic zeros."""

    def dense(tangent: Any, primal: jax.Array) -> Any:
        if not isinstance(tangent, SymbolicZero):
            return tangent
        if not jnp.issubdtype(primal.dtype, jnp.inexact):
            return np.zeros(primal.shape, jax.dtypes.float0)  # what JAX asks for where nothing can change
        return jnp.zeros_like(primal)

    return jax.tree.map(dense, tangents, primals)
