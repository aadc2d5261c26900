"""Compiled programs, kept on disk from one process to the next.

JAX's own compilation cache spares the compiler, but a program has to be traced and lowered before it is found
there, which takes several times as long as loading it. A `Program` is looked up by what it is called with: by
shapes and types of its arguments, its settings, and all else that compiled code depends on (`auvplan.cache`).
Where one is not found, cannot be stored or does not load, it is compiled as `jax.jit` does.
"""

import dataclasses
import enum
import functools
import threading
from collections.abc import Callable, Iterable
from typing import Any

import jax
import numpy as np
from jax import monitoring
from jax.experimental import serialize_executable

from auvplan import cache

#: Packages whose classes are what they were when a program was stored, as long as their versions are.
_OURS = "auvplan", "builtins", "collections", "jax", "jaxlib", "numpy"

_count = 0
_hits = 0
_programs: list["Program"] = []


class Program:
    """A function as `jax.jit` makes it, whose executables are stored.

    Settings that the program is compiled for are given by keyword. Within another traced function it is the
    plain jitted one.
    """

    def __init__(self, function: Callable[..., Any], static_argnames: Iterable[str], options: dict[str, Any]):
        """Compile `function` with XLA's `options`, for every value of the arguments named."""
        functools.update_wrapper(self, function)
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._options = options
        self._static = tuple(sorted(static_argnames))
        self._jitted = jax.jit(function, static_argnames=self._static, compiler_options=options)
        self._ready: dict[Any, Callable[..., Any]] = {}
        self._lock = threading.Lock()
        _programs.append(self)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call the program for these arguments, loaded or compiled where it is the first such call."""
        settings = tuple(kwargs.pop(name) for name in self._static)
        leaves, tree = jax.tree.flatten((args, kwargs))
        kinds = tuple(map(_kind, leaves))
        given = dict(zip(self._static, settings, strict=True))
        if None in kinds or jax.device_count() > 1 or jax.config.jax_disable_jit:
            return self._jitted(*args, **kwargs, **given)
        signature = tree, kinds, settings, jax.config.jax_enable_x64
        ready = self._ready.get(signature)
        if ready is None:
            with self._lock:
                ready = self._ready.get(signature) or self._prepared(signature, args, kwargs, given)
                self._ready[signature] = ready
        return ready(*args, **kwargs)

    def _prepared(self, signature: Any, args: tuple, kwargs: dict, given: dict) -> Callable[..., Any]:
        """The executable for one kind of call: from disk, or else compiled and stored."""
        key = self._key(*signature)
        tree = signature[0]
        if key and (stored := cache.load(self._name, key)):
            try:
                payload, out_tree = stored
                found = serialize_executable.deserialize_and_load(payload, tree, out_tree)
                # Some executables load and do not run.
                jax.block_until_ready(found(*args, **kwargs))
            except Exception as error:  # whatever is wrong with it
                cache.discard(self._name, key, error)
            else:
                _book_one()
                return found
        if not key:
            return functools.partial(self._jitted, **given)
        before = _hits
        made = self._jitted.lower(*args, **kwargs, **given).compile()
        if _hits > before:  # what comes out of JAX's own cache cannot be stored again
            return made
        try:
            payload, _, out_tree = serialize_executable.serialize(made)
        except Exception as error:  # some executables cannot be stored
            cache.log.info("%s is not stored: %s", self._name, error)
        else:
            cache.store(self._name, key, (payload, out_tree))
        return made

    def _key(self, tree: Any, kinds: tuple, settings: tuple, precise: bool) -> str | None:
        """What the executable depends on, as a key; None where that cannot be told or nothing is stored."""
        if not cache.enabled():
            return None
        parts = (_tree_token(tree), _token(settings), _token(sorted(self._options.items())))
        if None in parts:
            return None
        return cache.key_of(self._name, *parts, repr(kinds), repr(precise))

    def drop(self) -> None:
        """Forget what was loaded and compiled."""
        with self._lock:
            self._ready.clear()


def _kind(leaf: Any) -> Any:
    """Shape and type of an argument as programs tell them apart; None where only a trace can tell."""
    if isinstance(leaf, jax.core.Tracer):
        return None
    if isinstance(leaf, jax.Array):
        return leaf.shape, leaf.dtype, getattr(leaf, "weak_type", False)  # keys have none
    if isinstance(leaf, np.ndarray | np.generic):
        return leaf.shape, jax.dtypes.canonicalize_dtype(leaf.dtype), False
    return type(leaf) if isinstance(leaf, bool | int | float | complex) else None


def _token(value: Any) -> str | None:
    """A value in words that are the same in every process; None where there are none."""
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | np.dtype):
        return repr(value)
    if isinstance(value, enum.Enum):
        return f"{type(value).__qualname__}.{value.name}"
    if isinstance(value, tuple | list):
        parts = [_token(item) for item in value]
    elif isinstance(value, dict):
        parts = [_token(item) for pair in value.items() for item in pair]
    elif dataclasses.is_dataclass(value) and _is_ours(type(value)):
        parts = [_token(getattr(value, field.name)) for field in dataclasses.fields(value)]
    else:
        return None
    if None in parts:
        return None
    return f"{type(value).__qualname__}({','.join(map(str, parts))})"


def _tree_token(tree: Any) -> str | None:
    """The form of a pytree in such words."""
    data = tree.node_data()
    if data is None:
        return "*"
    kind, aux = data
    if not _is_ours(kind):
        return None
    if hasattr(kind, "fingerprint"):
        own = tree.unflatten([None] * tree.num_leaves).fingerprint()
    else:
        own = _token(aux)
    parts = [own, *map(_tree_token, tree.children())]
    if None in parts:
        return None
    return f"{kind.__module__}.{kind.__qualname__}({','.join(map(str, parts))})"


def _is_ours(kind: type) -> bool:
    return kind.__module__.split(".")[0] in _OURS


def compiled(
    function: Callable[..., Any], static_argnames: Iterable[str] = (), wide: bool = False, quick: bool = False
) -> Program:
    """`jax.jit` for programs that are called from the host.

    Args:
        function: to be compiled.
        static_argnames: its settings, all of them given by keyword at every call.
        wide: use the CPU's vector registers in all their width: XLA takes half of it by default, which costs
            a path a fifth of its time. Elsewhere it means nothing.
        quick: leave out XLA's newer code generators for fused operations. They make programs of long loops
            faster; others are compiled in two thirds of the time without them.
    """
    options: dict[str, Any] = {"xla_cpu_prefer_vector_width": 512} if wide else {}
    if quick:
        options["xla_cpu_use_fusion_emitters"] = False
    return Program(function, static_argnames, options)


def compilations() -> int:
    """How many programs this process has compiled, or taken from a cache, so far."""
    return _count


def drop_programs() -> None:
    """Forget all programs of this process, as `jax.clear_caches` does those of `jax.jit`."""
    for program in _programs:
        program.drop()


def _book_one() -> None:
    global _count
    _count += 1


def _book(event: str, duration_secs: float, **_: str | int) -> None:
    if event == "/jax/core/compile/backend_compile_duration":
        _book_one()


def _book_hit(event: str, **_: str | int) -> None:
    global _hits
    if event == "/jax/compilation_cache/cache_hits":
        _hits += 1


monitoring.register_event_duration_secs_listener(_book)
monitoring.register_event_listener(_book_hit)
