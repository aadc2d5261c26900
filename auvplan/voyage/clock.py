"""Honest clocks for planning calls."""

import time
from collections.abc import Callable, Hashable
from typing import Any

import jax


class Clock:
    """Times calls with compilation apart: a call of a new signature is made twice, the second one timed.

    Attributes:
        compile_seconds: s of all first calls.
    """

    _seen: set[Hashable] = set()  # noqa: RUF012 - compiled code is shared by all voyages of the process

    def __init__(self) -> None:
        self.compile_seconds = 0.0

    def time(self, signature: Hashable, call: Callable[[], Any]) -> tuple[Any, float]:
        """The call's result and its wall-clock seconds, free of compilation."""
        if signature not in self._seen:
            begin = time.perf_counter()
            jax.block_until_ready(call())
            self.compile_seconds += time.perf_counter() - begin
            self._seen.add(signature)
        begin = time.perf_counter()
        result = call()
        jax.block_until_ready(result)
        return result, time.perf_counter() - begin
