"""Plain Python functions of place and time as pytrees."""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields
from inspect import signature
from types import CodeType
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from auvplan.runtime.captured import captured_by

_Kind = TypeVar("_Kind", bound=type)


@dataclass(frozen=True)
class PlainFunction:
    """A function (x, y, z, t) of places [m] and times [s]; compiled code is reused for the same object.

    It is compiled again once a value that it reads from around it has changed, such as a global variable: see
    `captured_by`. Stored programs are found again by its `fingerprint`.
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
        words = [
            _code_words(code),
            repr({name: value for name, value in vars(self).items() if name != "function"}),
        ]
        for shape in ((), (3,)):
            places = [jax.ShapeDtypeStruct(shape, jnp.result_type(float))] * 4
            try:
                # By a function of its own: JAX keeps what it has seen of this one.
                seen = jax.make_jaxpr(lambda *where: self.function(*where))(*places)
            except Exception:  # the planner's own call will say what is wrong with it
                return None
            words.append(str(seen))
            words += [f"{value.dtype} {value.shape} {value.tobytes().hex()}" for value in _constants(seen)]
        stated = "\n".join(words)
        return None if " at 0x" in stated else hashlib.sha256(stated.encode()).hexdigest()


def register_function(kind: _Kind) -> _Kind:
    """Make a class of plain functions a pytree: its fields are static, and what the function captures."""

    def flatten(plain: Any) -> tuple[tuple[()], tuple]:
        parts = tuple(getattr(plain, entry.name) for entry in fields(plain))
        return (), (parts, captured_by(plain.function))

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
    found: Any = kind(given)
    places = [jax.ShapeDtypeStruct((), jnp.result_type(float))] * 4
    try:
        jax.eval_shape(found, *places)
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


def _constants(seen: Any) -> Iterator[np.ndarray]:
    """Yield values that a traced function, and those traced within it, take from around them."""
    for value in getattr(seen, "consts", ()):
        yield np.asarray(value)
    for equation in getattr(seen, "jaxpr", seen).eqns:
        for variable in equation.invars:
            if isinstance(variable, Literal):
                yield np.asarray(variable.val)
        for setting in equation.params.values():
            for inner in setting if isinstance(setting, tuple | list) else (setting,):
                if hasattr(inner, "eqns") or hasattr(inner, "jaxpr"):
                    yield from _constants(inner)
