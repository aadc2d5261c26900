"""Plain Python functions of place and time as pytrees."""

import hashlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields
from inspect import signature
from itertools import chain
from types import CodeType
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from auvplan.runtime.captured import as_hashable, captured_by, traced

_Kind = TypeVar("_Kind", bound=type)


@dataclass(frozen=True)
class PlainFunction:
    """A function (x, y, z, t) of places [m] and times [s]; compiled code is reused for the same object.

    It is compiled again once a value that it reads from around it has changed, such as a global variable, an
    array or an attribute of anything: see `captured_by`. Stored programs are found again by its
    `fingerprint`.
    """

    function: Callable[..., Any]

    def fingerprint(self) -> str | None:
        """Return what the function does, in words that are the same in every process.

        None where there are none.

        They are its byte code and what JAX sees of it at points and in a row of points, with the values of
        all that it takes from around it.
        """
        code = getattr(self.function, "__code__", None)
        if not isinstance(code, CodeType):
            return None
        given = [traced(self.function, *places) for places in _places()]
        if not all(given) or not all(isinstance(word, str) for word in chain(*given)):
            return None
        settings = repr({name: value for name, value in vars(self).items() if name != "function"})
        stated = "\n".join([_code_words(code), settings, *chain(*given)])
        return None if " at 0x" in stated else hashlib.sha256(stated.encode()).hexdigest()


def _places() -> list[list[jax.ShapeDtypeStruct]]:
    """Return x, y, z and t as functions are traced with them: of a point, and of a row of points."""
    return [[jax.ShapeDtypeStruct(shape, jnp.result_type(float))] * 4 for shape in ((), (3,))]


def register_function(kind: _Kind) -> _Kind:
    """Make a class of plain functions a pytree: its fields are static, and what the function captures."""

    def flatten(plain: Any) -> tuple[tuple[()], tuple]:
        parts = tuple(getattr(plain, entry.name) for entry in fields(plain))
        return (), (parts, *(captured_by(plain.function, *places) for places in _places()))

    jax.tree_util.register_pytree_node(kind, flatten, lambda static, _: kind(*static[0]))
    return kind


def as_pytree(given: Any, kind: type[PlainFunction], name: str, returns: str) -> Any:
    """Return a pytree that is callable, and a plain function of the same signature as one of a kind.

    A function is traced as planners will, so that one that cannot be is refused where it is given.

    Raises:
        TypeError: it does not take (x, y, z, t), or JAX cannot trace it; one line that says what to do.
        ValueError: what it returns does not fit its arguments.
    """
    leaves = jax.tree.leaves(given)
    if len(leaves) != 1 or leaves[0] is not given:
        return given
    wanted = f"{name} must be callable as (x, y, z, t) -> {returns}"
    if not callable(given):
        raise TypeError(f"{wanted}, got {type(given).__name__}")
    with suppress(ValueError):  # what has no signature is not looked at
        try:
            signature(given).bind(*"xyzt")
        except TypeError as error:
            raise TypeError(f"{wanted}: {error}") from None
    found: Any = kind(as_hashable(given))
    try:
        jax.eval_shape(found, *_places()[0])
    except jax.errors.TracerArrayConversionError:
        does, write = "hands its arguments to NumPy", "it with jax.numpy, such as jnp.sin for np.sin"
    except jax.errors.TracerBoolConversionError:
        does, write = "branches on its arguments", "jnp.where(condition, this, that) for if"
    except jax.errors.ConcretizationTypeError:
        does = "makes plain numbers of its arguments"
        write = "it with jax.numpy, such as jnp.sin for math.sin"
    else:
        return found
    raise TypeError(f"the {name}'s function {does}, which JAX cannot trace: write {write}")


def _code_words(code: CodeType) -> str:
    """Byte code, with that of the functions defined in it."""
    inner = [_code_words(value) if isinstance(value, CodeType) else repr(value) for value in code.co_consts]
    return f"{code.co_code.hex()} {code.co_names} {code.co_freevars} {inner}"
