"""Compilation of whole plans."""

from functools import partial

import jax

#: `jax.jit` for programs that no other program calls. Vector registers as wide as the CPU has them: XLA takes
#: half of them by default, which costs a path a fifth of its time. Elsewhere the option says nothing.
compiled = partial(jax.jit, compiler_options={"xla_cpu_prefer_vector_width": 512})
