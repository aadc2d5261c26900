"""Tangents in rules of differentiation (`jax.custom_jvp` with symbolic zeros)."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero


def is_symbolic_zero(tangents: Any) -> bool:
    """Return whether none of the arguments behind a tree of tangents is differentiated."""
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
