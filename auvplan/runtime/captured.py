"""What functions read from around them, which programs compiled of them hold as constants."""

import hashlib
import re
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.extend.core import ClosedJaxpr, Literal, jaxpr_as_fun

#: What functions capture as long as nobody can change it, by functions and arguments.
_held: ContextVar[dict[tuple, tuple] | None] = ContextVar("captured", default=None)

#: Digests of arrays of JAX, which nobody changes, by their identities.
_digests: dict[int, tuple[weakref.ref, str]] = {}


def captured_by(function: Callable[..., Any], *given: Any) -> tuple:
    """Return what JAX sees of a function, as hashable words that change when what the function reads does.

    Variables of modules and enclosing functions, entries, attributes and arrays are all there as far as the
    function's values depend on them. Empty where JAX cannot trace the function: its call says why.

    Args:
        function: to be traced, however often it was before.
        given: trees of its arguments, or of their shapes and types.
    """
    held = _held.get()
    if held is None:
        return _words(function, *given)
    leaves, tree = jax.tree.flatten(given)
    kinds = tuple((np.shape(leaf), jax.dtypes.result_type(leaf)) for leaf in leaves)
    key = id(function), tree, kinds
    if key not in held:
        held[key] = function, _words(function, *given)
    return held[key][1]


def as_hashable(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function, or the method that an object without a hash is called by."""
    try:
        hash(function)
    except TypeError:
        return function.__call__
    return function


@contextmanager
def captured_once() -> Iterator[None]:
    """Trace each function once: nobody changes what it reads until the end."""
    if _held.get() is not None:
        yield
        return
    token = _held.set({})
    try:
        yield
    finally:
        _held.reset(token)


def traced(function: Callable[..., Any], *given: Any) -> list[Any]:
    """Return the program that JAX makes of a function and all values in it; see `captured_by`."""
    try:
        # By a function of its own: JAX keeps what it has seen of this one.
        seen = jax.make_jaxpr(lambda *given: function(*given))(*given)
    except Exception:
        return []
    return [str(seen), *map(_word, _constants(seen))]


@dataclass(frozen=True)
class Captured:
    """A function that leaves no arrays of its own with the programs which are made of it.

    JAX remembers what was in an array of NumPy for as long as some program holds it: another program that is
    made of it meanwhile has what was there before, whatever has been written to the array since.
    """

    function: Callable[..., Any]

    def __call__(self, *given: Any) -> Any:
        """Call the function; where arguments are traced, with copies of the arrays that it reads."""
        leaves = jax.tree.leaves(given)
        if not any(isinstance(leaf, Tracer) for leaf in leaves):
            return self.function(*given)
        try:
            seen, kinds = jax.make_jaxpr(lambda *given: self.function(*given), return_shape=True)(*given)
        except TypeError:  # it returns what is no array
            return self.function(*given)
        copies = [np.array(value) if isinstance(value, np.ndarray) else value for value in seen.consts]
        found = jaxpr_as_fun(ClosedJaxpr(seen.jaxpr, copies))(*leaves)
        return jax.tree.unflatten(jax.tree.structure(kinds), found)


def _words(function: Callable[..., Any], *given: Any) -> tuple:
    """Return `traced` without places in memory: rules for derivatives are other objects in each trace."""
    return tuple(
        re.sub(r" at 0x[0-9a-f]+", "", word) if isinstance(word, str) and "callback" not in word else word
        for word in traced(function, *given)
    )


def _word(value: Any) -> Any:
    """Return a value as a hashable word: traced ones as themselves, others as what is in them."""
    if isinstance(value, Tracer):
        return _Same(value)
    known, digest = _digests.get(id(value), (None, ""))
    if known is not None and known() is value:
        return digest
    is_key = jnp.issubdtype(value.dtype, jax.dtypes.prng_key)
    numbers = np.asarray(jax.random.key_data(value) if is_key else value)
    digest = f"{value.dtype} {np.shape(value)} {hashlib.sha1(numbers.tobytes()).hexdigest()}"
    if isinstance(value, jax.Array):
        _digests[id(value)] = weakref.ref(value, partial(_forget, id(value))), digest
    return digest


def _forget(identity: int, _: weakref.ref) -> None:
    _digests.pop(identity, None)


@dataclass(frozen=True, eq=False)
class _Same:
    """An object that is equal to itself alone."""

    of: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.of is other.of

    def __hash__(self) -> int:
        return id(self.of)


def _constants(seen: Any) -> Iterator[Any]:
    """Yield values that a traced function, and those traced within it, take from around them."""
    yield from getattr(seen, "consts", ())
    for equation in getattr(seen, "jaxpr", seen).eqns:
        yield from (np.asarray(each.val) for each in equation.invars if isinstance(each, Literal))
        for setting in equation.params.values():
            for inner in setting if isinstance(setting, tuple | list) else (setting,):
                if hasattr(inner, "eqns") or hasattr(inner, "jaxpr"):
                    yield from _constants(inner)
