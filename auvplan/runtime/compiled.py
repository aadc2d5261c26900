"""Compiled programs, kept on disk from one process to the next.

JAX's own compilation cache spares the compiler, but a program has to be traced and lowered before it is found
there, which takes several times as long as loading it. A `Program` is looked up by what it is called with: by
shapes and types of its arguments, its settings, and all else that compiled code depends on (see `cache`).
Where one is not found, cannot be stored or does not load, it is compiled as `jax.jit` does.
"""

import dataclasses
import enum
import functools
import pickle
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from itertools import chain
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import monitoring
from jax.core import Tracer
from jax.experimental import serialize_executable

from auvplan.runtime import cache
from auvplan.runtime.packed import with_packed
from auvplan.runtime.pytree import is_ours

#: Programs that a process holds at most. Each takes hundreds of mappings of memory, of which Linux gives a
#: process 65,530; without one more it crashes.
MOST = 96

#: LLVM's level of optimisation of large programs. They run as fast as at XLA's 3, and compiling takes a sixth
#: less of the processor's time.
_LEVEL = 1

#: Bits of vector registers of wide programs, see `compiled`.
_WIDTH = 512

#: Threads that programs are loaded by before they are asked for.
_THREADS = 2

#: Occasions, see `expecting`: missions that are simulated, and such that are only planned.
MISSIONS, PLANS = "missions", "plans"

_OCCASIONS = f"{__name__}.expecting"


@dataclasses.dataclass
class _Counts:
    """What this process has compiled, and how long calls have waited for it."""

    compiled: int = 0  # or taken from a cache
    hits: int = 0  # in JAX's own cache
    begun: int = 0  # programs to be stored
    done: int = 0
    waiting: int = 0  # calls that wait now
    since: float = 0.0  # s, when the first of these began to
    waited: float = 0.0  # s


_counts, _counting = _Counts(), threading.Lock()
_listeners: list[Callable[..., None]] = []
_programs: list["Program"] = []
_used: dict[str, str] = {}  # names of the programs by their keys
_thread = threading.local()
_compilers = ThreadPoolExecutor(_THREADS, "auvplan-compile")
_early: dict[str, Future[tuple[Callable[..., list], bytes] | None]] = {}


class _Call(NamedTuple):
    """What calls of a program are distinguished by."""

    tree: Any  # form of the arguments
    kinds: tuple  # shapes and types of their leaves
    settings: tuple
    precise: bool


class _Ready(NamedTuple):
    """An executable of flat arguments and results, and the form of the results."""

    executable: Callable[..., list]
    form: Any

    def __call__(self, leaves: list) -> Any:
        return self.form.unflatten(self.executable(*leaves))


class Program:
    """A function as `jax.jit` makes it, whose executables are stored.

    Settings that the program is compiled for are given by keyword. Arrays on grids are taken packed, so that
    other sizes need no other program (see `packed`). Within another traced function it is the plain jitted
    one.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        static_argnames: Iterable[str],
        options: dict[str, Any],
        outlined: bool = False,
    ):
        """Compile `function` with XLA's `options`, for every value of the arguments named.

        Within `compiling_ahead` a program that is `outlined` is compiled and not run.
        """
        functools.update_wrapper(self, function)
        self._function = function
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._options = options
        self._static = tuple(sorted(static_argnames))
        self._outlined = outlined
        self._ready: dict[_Call, Callable[[list], Any]] = {}
        self._outlines: dict[_Call, tuple[Any, list]] = {}
        self._lock = threading.Lock()
        _programs.append(self)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call the program for these arguments, loaded or compiled where it is the first such call."""
        settings = tuple(kwargs.pop(name) for name in self._static)
        leaves, tree = jax.tree.flatten(with_packed((args, kwargs)))
        kinds = tuple(map(_kind, leaves))
        if None in kinds or jax.device_count() > 1 or jax.config.jax_disable_jit:  # type: ignore[attr-defined]
            return self._jitted(*args, **kwargs, **self._named(settings))
        call = _Call(tree, kinds, settings, jax.config.read("jax_enable_x64"))
        if (ready := self._ready.get(call)) is not None:
            return ready(leaves)
        if held() >= MOST:
            drop_programs()
        with self._lock:
            if (ready := self._ready.get(call)) is None:
                if self._outlined and getattr(_thread, "compiling_ahead", False):
                    outline = self._begun(call, leaves)
                    if outline is not None:
                        return outline
                with _counted_as_compilation():
                    self._ready[call], result = self._prepared(call, leaves)
                return result
        return ready(leaves)

    @functools.cached_property
    def _jitted(self) -> Callable[..., Any]:
        return jax.jit(self._function, static_argnames=self._static, compiler_options=self._xla)

    @property
    def _xla(self) -> dict[str, Any]:
        """XLA's options, those that its version knows: they come and go."""
        return {name: value for name, value in self._options.items() if _knows(name, value)}

    def _named(self, settings: tuple) -> dict[str, Any]:
        return dict(zip(self._static, settings, strict=True))

    def _prepared(self, call: _Call, leaves: list) -> tuple[Callable[[list], Any], Any]:
        """An executable for one kind of call, from disk or else compiled and stored, and its first answer."""
        key = self._key(call)
        if not key:

            def plain(leaves: list) -> Any:
                args, kwargs = call.tree.unflatten(leaves)
                return self._jitted(*args, **kwargs, **self._named(call.settings))

            return plain, plain(leaves)
        _used.setdefault(key, self._name)
        early = _early.pop(key, None)
        try:
            if found := early.result() if early else _load(self._name, key):
                ready = _Ready(found[0], pickle.loads(found[1]))
                # Some executables load and do not run.
                result = jax.block_until_ready(ready(leaves))
                _counts.compiled += 1
                return ready, result
        except Exception as error:  # whatever is wrong with it
            cache.discard(self._name, key, error)
        lowered, form = self._lowered(call, leaves)
        ready = _Ready(self._finished(key, lowered, form, len(leaves))[0], form)
        return ready, ready(leaves)

    def _begun(self, call: _Call, leaves: list) -> Any | None:
        """Begin to compile what is neither stored nor begun, and return zeros in the form of its results."""
        if call not in self._outlines:
            key = self._key(call)
            if not key or key in _early or cache.holds(self._name, key):
                return None
            lowered, form = self._lowered(call, leaves)
            _used.setdefault(key, self._name)
            _early[key] = _compilers.submit(self._finished, key, lowered, form, len(leaves))
            self._outlines[call] = form, lowered.out_info
        form, kinds = self._outlines[call]
        return form.unflatten([_zeros(kind) for kind in kinds])

    def _lowered(self, call: _Call, leaves: list) -> tuple[Any, Any]:
        """The program of flat arguments and results, ready to be compiled, and the form of its results.

        Flat, an executable is loaded without the classes that arguments and results are made of.
        """
        forms = []

        def flat(*leaves: Any) -> list[Any]:
            args, kwargs = call.tree.unflatten(leaves)
            found, form = jax.tree.flatten(self._function(*args, **kwargs, **self._named(call.settings)))
            forms.append(form)
            return found

        flat.__name__ = self._function.__name__
        return jax.jit(flat, compiler_options=self._xla).lower(*leaves), forms[0]

    def _finished(self, key: str, lowered: Any, form: Any, count: int) -> tuple[Callable[..., list], bytes]:
        """Compile what is lowered, for `count` arguments; see `_load` for what is returned."""
        before, pickled = _counts.hits, pickle.dumps(form)
        _announce(begun=1)
        made = lowered.compile()
        _announce(done=1)
        if _counts.hits == before:  # what comes out of JAX's own cache cannot be stored again
            try:
                payload, _, _ = serialize_executable.serialize(made)
                cache.store(self._name, key, (payload, (count, form.num_leaves), pickled))
            except Exception as error:  # some executables cannot be stored
                cache.log.info("%s is not stored: %s", self._name, error)
        return made, pickled

    def _key(self, call: _Call) -> str | None:
        """Return what the executable depends on, as a key; None where it has none, or nothing is stored."""
        if cache.enabled():
            with suppress(TypeError):  # of what has no token
                options = sorted(self._options.items())
                tokens = _tree_token(call.tree), _token(call.settings), _token(options)
                return cache.key_of(self._name, *tokens, repr(call.kinds), repr(call.precise))
        return None

    def drop(self) -> None:
        """Forget what was loaded and compiled."""
        with self._lock:
            self._ready.clear()
            self._outlines.clear()
            if "_jitted" in self.__dict__:
                self._jitted.clear_cache()


def _load(name: str, key: str) -> tuple[Callable[..., list], bytes] | None:
    """Return a stored executable and the pickled form of its results; None where there is none."""
    stored = cache.load(name, key)
    if stored is None:
        return None
    payload, counts, form = stored
    arguments, results = jax.tree.structure(((0,) * counts[0], {})), jax.tree.structure([0] * counts[1])
    return serialize_executable.deserialize_and_load(payload, arguments, results), form


@contextmanager
def compiling_ahead() -> Iterator[None]:
    """Calls of large programs in this thread return zeros at once, and compile beside what follows.

    Code that does not mind zeros goes through all that leads to a result so, and the programs that it will
    call are compiled side by side.
    """
    _thread.compiling_ahead = True
    try:
        yield
    finally:
        _thread.compiling_ahead = False


def _zeros(leaf: jax.ShapeDtypeStruct) -> Any:
    if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        # Made on the host: a small program would wait behind the large ones that are being compiled.
        data = jax.eval_shape(jax.random.key_data, leaf)
        return jax.random.wrap_key_data(jnp.asarray(np.zeros(data.shape, data.dtype)))
    return np.zeros(leaf.shape, leaf.dtype)


@contextmanager
def expecting(occasion: str, of: str = "") -> Iterator[None]:
    """Load what the last such occasion used beside what is done meanwhile; remember what this one uses.

    Args:
        occasion: its name.
        of: what it is an occasion of, such as the settings of a scenario, by which occasions that use
            different programs are distinguished; a new one begins with those of the last one.
    """
    preload(occasion, of)
    before = set(_used)
    yield
    if cache.enabled():
        fresh = [(name, key) for key, name in _used.items() if key not in before]
        for place in _places(occasion, of):
            listed = cache.load(_OCCASIONS, place) or []
            used = list(dict.fromkeys([*((name, key) for name, key in listed if key in _used), *fresh]))
            if used != listed:
                cache.store(_OCCASIONS, place, used)


def preload(occasion: str, of: str = "") -> None:
    """Begin to load what such an occasion used last, in threads of their own; see `expecting`."""
    if not cache.enabled():
        return
    lists = (cache.load(_OCCASIONS, place) for place in _places(occasion, of))
    listed = [(name, key) for name, key in next(filter(None, lists), ()) if key not in {**_used, **_early}]
    if listed:
        pool = ThreadPoolExecutor(_THREADS, "auvplan-preload")
        for name, key in listed:
            _early[key] = pool.submit(_load, name, key)
        pool.shutdown(wait=False)


def _places(occasion: str, of: str) -> list[str]:
    """Return where lists are kept in the cache: that of this very occasion first."""
    return [cache.key_of(f"{occasion} {of}"), cache.key_of(occasion)]


def _kind(leaf: Any) -> Any:
    """Shape and type of an argument as programs distinguish them; None where only a trace can."""
    if isinstance(leaf, Tracer):
        return None
    if isinstance(leaf, jax.Array):
        return leaf.shape, leaf.dtype, getattr(leaf, "weak_type", False)  # keys have none
    if isinstance(leaf, np.ndarray | np.generic):
        return leaf.shape, jax.dtypes.canonicalize_dtype(leaf.dtype), False
    return type(leaf) if isinstance(leaf, bool | int | float | complex) else None


def _token(value: Any) -> str:
    """Return a value in words that are the same in every process.

    Raises:
        TypeError: there are none.
    """
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | np.dtype):
        return repr(value)
    if isinstance(value, enum.Enum):
        return f"{type(value).__qualname__}.{value.name}"
    if isinstance(value, tuple | list):
        parts = value
    elif isinstance(value, dict):
        parts = chain.from_iterable(value.items())
    elif dataclasses.is_dataclass(value) and is_ours(type(value)):
        parts = (getattr(value, field.name) for field in dataclasses.fields(value))
    else:
        raise TypeError(f"{type(value).__name__} has no token")
    return f"{type(value).__qualname__}({','.join(map(_token, parts))})"


def _tree_token(tree: Any) -> str:
    """Return the form of a pytree in such words."""
    data = tree.node_data()
    if data is None:
        return "*"
    kind, aux = data
    if not is_ours(kind):
        raise TypeError(f"{kind.__name__} has no token")
    if hasattr(kind, "fingerprint"):
        own = tree.unflatten([None] * tree.num_leaves).fingerprint()  # None, a TypeError below, without one
    else:
        own = _token(aux)
    return f"{kind.__module__}.{kind.__qualname__}({','.join([own, *map(_tree_token, tree.children())])})"


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
    options: dict[str, Any] = {"xla_cpu_prefer_vector_width": _WIDTH} if wide else {}
    if quick:
        options["xla_cpu_use_fusion_emitters"] = False
    if options:  # programs without any may be called within others, which options may not
        options["xla_backend_optimization_level"] = _LEVEL
    return Program(function, static_argnames, options, outlined=wide)


@functools.cache
def _knows(name: str, value: Any) -> bool:
    """Return whether XLA compiles with an option, tried on a program of nothing."""
    try:
        jax.jit(lambda: (), compiler_options={name: value}).lower().compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True


def compilations() -> int:
    """Return how many programs this process has compiled, or taken from a cache, so far."""
    return _counts.compiled


def compile_seconds() -> float:
    """Return for how long calls have waited for programs to be compiled or loaded so far, wall-clock s.

    What `compiling_ahead` waits for does not count.
    """
    return _counts.waited


def held() -> int:
    """Return how many programs this process holds."""
    return sum(len(program._ready) for program in _programs)


def drop_programs() -> None:
    """Forget all programs of this process, as `jax.clear_caches` does those of `jax.jit`."""
    for program in _programs:
        program.drop()


@contextmanager
def listening(report: Callable[..., None]) -> Iterator[None]:
    """Call `report(begun=, done=)` with numbers of programs whenever one to be stored is compiled."""
    _listeners.append(report)
    try:
        yield
    finally:
        _listeners.remove(report)


def _announce(begun: int = 0, done: int = 0) -> None:
    """Count programs as begun or done, and notify the listeners."""
    with _counting:
        _counts.begun += begun
        _counts.done += done
        now = {"begun": _counts.begun, "done": _counts.done}
    for report in tuple(_listeners):
        report(**now)


@contextmanager
def _counted_as_compilation() -> Iterator[None]:
    """Count the time until the end as `compile_seconds`, that of several threads at once but once."""
    if getattr(_thread, "compiling_ahead", False):
        yield
        return
    with _counting:
        if not _counts.waiting:
            _counts.since = time.perf_counter()
        _counts.waiting += 1
    try:
        yield
    finally:
        with _counting:
            _counts.waiting -= 1
            if not _counts.waiting:
                _counts.waited += time.perf_counter() - _counts.since


def _count(event: str, duration_secs: Any = 0.0, **_: Any) -> None:
    _counts.compiled += event == "/jax/core/compile/backend_compile_duration"
    _counts.hits += event == "/jax/compilation_cache/cache_hits"


monitoring.register_event_duration_secs_listener(_count)
monitoring.register_event_listener(_count)
