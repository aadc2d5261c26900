"""Compilation of whole plans."""

from functools import partial

import jax
from jax import monitoring

#: Vector registers as wide as the CPU has them: XLA takes half of them by default, which costs a path a fifth
#: of its time. Elsewhere the option says nothing.
_WIDE = {"xla_cpu_prefer_vector_width": 512}

#: `jax.jit` for programs that no other program calls.
compiled = partial(jax.jit, compiler_options=_WIDE)

#: The same for programs that do little: without XLA's newer code generators for fused operations, which make
#: programs of long loops faster, they are compiled in two thirds of the time.
quickly_compiled = partial(jax.jit, compiler_options=_WIDE | {"xla_cpu_use_fusion_emitters": False})

_count = 0


def compilations() -> int:
    """How many programs this process has compiled, or taken from JAX's cache, so far."""
    return _count


def _book(event: str, duration_secs: float, **_: str | int) -> None:
    global _count
    if event == "/jax/core/compile/backend_compile_duration":
        _count += 1


monitoring.register_event_duration_secs_listener(_book)
