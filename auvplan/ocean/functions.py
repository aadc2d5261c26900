"""Plain Python functions of place and time as pytrees."""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields
from inspect import signature
from itertools import chain
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

_Kind = TypeVar("_Kind", bound=type)

#: Packages whose functions read nothing that changes.
_LIBRARIES = "auvplan", "builtins", "jax", "numpy", "scipy"

#: Functions, containers and objects within one another that are looked into.
_DEPTH = 4

#: Numbers of an array that are looked at, evenly apart, and entries of what is looked into at most.
_LOOKED_AT = 2**16


@dataclass(frozen=True, eq=False)
class PlainFunction:
    """A function (x, y, z, t) of places [m] and times [s]; compiled code is reused for the same object.

    It is another function, and compiled again, once a value that it reads from around it has changed: a
    global variable, one of an enclosing function, an entry of a list, an attribute, also by way of functions
    that it calls. Stored programs are found again by what the function does: see `fingerprint`.
    """

    function: Callable[..., Any]

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._identity() == other._identity()  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash(self._identity())

    def _identity(self) -> tuple:
        return _fields_of(self), _read_by(self.function)

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
    """Make a class of plain functions a pytree, all of whose fields, and what is read, are static."""

    def flatten(function: Any) -> tuple[tuple[()], tuple]:
        return (), function._identity()

    jax.tree_util.register_pytree_node(kind, flatten, lambda identity, _: kind(*identity[0]))
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


def _fields_of(function: PlainFunction) -> tuple:
    return tuple(getattr(function, entry.name) for entry in fields(function))


@dataclass(frozen=True, eq=False)
class _Same:
    """An object that is equal to itself alone."""

    of: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.of is other.of

    def __hash__(self) -> int:
        return id(self.of)


def _read_by(function: Any, depth: int = _DEPTH) -> tuple:
    """Values that a function reads from around it, as hashable words for them."""
    code = getattr(function, "__code__", None)
    if not isinstance(code, CodeType):
        return (_seen(function, depth),)
    names, around = _names_in(code), function.__globals__
    found = [around[name] for name in names if name in around]
    for cell in function.__closure__ or ():
        with suppress(ValueError):  # it is empty
            found.append(cell.cell_contents)
    found += [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values()]
    return tuple(_seen(value, depth) for value in found)


def _names_in(code: CodeType) -> list[str]:
    """Names that byte code and that of functions defined in it uses."""
    inner = (_names_in(value) for value in code.co_consts if isinstance(value, CodeType))
    return list(dict.fromkeys([*code.co_names, *chain.from_iterable(inner)]))


def _seen(value: Any, depth: int) -> Any:
    """Return a value in hashable words that change when it does; objects that are not looked into as such."""
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        return type(value), repr(value)
    if isinstance(value, np.ndarray) and value.dtype != object:
        part = value.reshape(-1)[:: 1 + value.size // _LOOKED_AT]
        return value.shape, value.dtype, hash(part.tobytes())
    if depth == 0 or isinstance(value, ModuleType | type | jax.Array):
        return _Same(value)
    if isinstance(value, dict | list | tuple | set | frozenset) and len(value) > _LOOKED_AT:
        return _Same(value), len(value)
    if isinstance(value, FunctionType):
        ours = (value.__module__ or "").split(".")[0] in _LIBRARIES
        return _Same(value), () if ours else _read_by(value, depth - 1)
    if isinstance(value, dict):
        return _Same(value), tuple((_seen(k, 0), _seen(v, depth - 1)) for k, v in value.items())
    if isinstance(value, list | tuple | set | frozenset):
        return type(value), tuple(_seen(part, depth - 1) for part in value)
    return _Same(value), tuple((k, _seen(v, depth - 1)) for k, v in getattr(value, "__dict__", {}).items())


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
