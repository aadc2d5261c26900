"""Pytrees whose constructors complete what they are given."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax

T = TypeVar("T", bound=type)


def register_without_init(*fields: str) -> Callable[[T], T]:
    """Register a dataclass as a pytree that JAX rebuilds without its constructor.

    A constructor that fills in defaults and checks shapes is for people. JAX rebuilds objects around tracers,
    placeholders and batches, which are to be taken as they are.

    Args:
        fields: names of all fields, each of them data.
    """

    def register(cls: T) -> T:
        def with_keys(tree: Any) -> tuple[tuple, None]:
            return tuple((jax.tree_util.GetAttrKey(name), getattr(tree, name)) for name in fields), None

        def flat(tree: Any) -> tuple[tuple, None]:
            return tuple(getattr(tree, name) for name in fields), None

        def rebuilt(_: None, children: Any) -> Any:
            tree = object.__new__(cls)
            for name, child in zip(fields, children, strict=True):
                object.__setattr__(tree, name, child)
            return tree

        jax.tree_util.register_pytree_with_keys(cls, with_keys, rebuilt, flat)
        return cls

    return register
