"""What functions read from around them, which programs compiled of them hold as constants."""

import dis
import weakref
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import chain
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import jax
import numpy as np

#: Packages whose functions read nothing that changes.
_LIBRARIES = "auvplan", "builtins", "jax", "numpy", "scipy"

#: Functions, containers and objects within one another that are looked into.
_DEPTH = 4

#: Numbers of an array, and entries of a container, that are looked at, evenly apart.
_NUMBERS, _ENTRIES = 2**16, 2**10

#: Arrays that functions have been seen to read, and what was in them, by their identities.
_arrays: dict[int, tuple[weakref.ref, tuple]] = {}


@dataclass(frozen=True, eq=False)
class _Same:
    """An object that is equal to itself alone."""

    of: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.of is other.of

    def __hash__(self) -> int:
        return id(self.of)


def captured_by(function: Any, depth: int = _DEPTH) -> tuple:
    """Return values that a function reads from around it, as hashable words that change when they do.

    They are those of variables of its module and others, of enclosing functions, of its defaults and of the
    object whose method it is: numbers, arrays, entries and attributes, and what functions among them read.
    What is not looked into, such as arrays of JAX, stands for itself.

    Raises:
        ValueError: an array of NumPy that the function reads was changed in place since it was seen last.
    """
    if isinstance(function, partial):
        parts = function.func, function.args, function.keywords
        return tuple(_seen(part, depth) for part in parts)
    code = getattr(function, "__code__", None)
    if not isinstance(code, CodeType):
        return _seen(function, depth), _seen(vars(type(function)).get("__call__"), depth)
    variables, attributes = _names_read(code)
    around = function.__globals__
    found = [around[name] for name in variables if name in around]
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        with suppress(ValueError):  # it is empty
            found += [cell.cell_contents] if name in variables else []
    for module in [value for value in found if isinstance(value, ModuleType)]:
        if not _is_library(module.__name__):
            found += [value for name, value in vars(module).items() if name in attributes]
    found.append(getattr(function, "__self__", None))
    found += [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values()]
    return tuple(_seen(value, depth) for value in found)


@lru_cache(maxsize=1024)
def _names_read(code: CodeType) -> tuple[frozenset[str], frozenset[str]]:
    """Variables that byte code, and that of functions in it, reads and does not assign to, and attributes."""
    codes = [code]
    for outer in codes:
        codes += [value for value in outer.co_consts if isinstance(value, CodeType)]
    names: dict[str, set[str]] = {"LOAD": set(code.co_freevars), "STORE": set(), "ATTR": set()}
    for step in chain.from_iterable(map(dis.get_instructions, codes)):
        kind, _, of = step.opname.partition("_")
        if of in ("GLOBAL", "NAME", "DEREF") and kind in names:
            names[kind].add(step.argval)
        elif kind == "LOAD" and of in ("ATTR", "METHOD"):
            names["ATTR"].add(step.argval)
    return frozenset(names["LOAD"] - names["STORE"]), frozenset(names["ATTR"])


def _is_library(module: str | None) -> bool:
    return (module or "").split(".")[0] in _LIBRARIES


def _seen(value: Any, depth: int) -> Any:
    """Return a value in hashable words that change when it does; objects that are not looked into as such."""
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        return type(value), repr(value)
    if isinstance(value, np.ndarray) and value.dtype != object:
        part = value.reshape(-1)[:: 1 + value.size // _NUMBERS]
        words = value.shape, value.dtype, hash(part.tobytes())
        _check_unchanged(value, words)
        return words
    if depth == 0 or isinstance(value, ModuleType | type | jax.Array):
        return _Same(value)
    if isinstance(value, partial):
        return captured_by(value, depth - 1)
    if isinstance(value, FunctionType | MethodType):
        return _Same(value), () if _is_library(value.__module__) else captured_by(value, depth - 1)
    if isinstance(value, dict | list | tuple | set | frozenset):
        entries = list(value.items() if isinstance(value, dict) else value)
        some = entries[:: 1 + len(entries) // _ENTRIES]
        return type(value), len(entries), tuple(_seen(part, depth - 1) for part in some)
    return _Same(value), tuple((k, _seen(v, depth - 1)) for k, v in getattr(value, "__dict__", {}).items())


def _check_unchanged(array: np.ndarray, words: tuple) -> None:
    """Refuse an array that was seen before, with other words for what is in it."""
    key = id(array)
    known, before = _arrays.get(key, (None, words))
    if known is not None and known() is array and before != words:
        raise ValueError(
            "an array that a function reads has been changed in place, which JAX does not see: make a "
            "new one, as in a = 2.0 * a for a *= 2.0"
        )
    _arrays[key] = weakref.ref(array, lambda _: _arrays.pop(key, None)), words
