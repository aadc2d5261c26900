"""Timing of planning calls, compilation excluded."""

import time
from collections.abc import Callable
from typing import Any

import jax

from auvplan.runtime.compiled import compilations


class Clock:
    """Times calls with compilation apart: a call that compiled something is made again, and that one timed.

    Attributes:
        compile_seconds: s of all calls that compiled something.
    """

    def __init__(self) -> None:
        self.compile_seconds = 0.0

    def time(self, call: Callable[[], Any]) -> tuple[Any, float]:
        """Return the call's result and its wall-clock seconds, free of compilation."""
        before = compilations()
        result, seconds = _timed(call)
        if compilations() == before:
            return result, seconds
        self.compile_seconds += seconds
        return _timed(call)


class Untimed(Clock):
    """Times nothing and makes no call twice: plans are the same to the last bit."""

    def time(self, call: Callable[[], Any]) -> tuple[Any, float]:
        """Return the call's result and no time at all."""
        return call(), 0.0


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    begin = time.perf_counter()
    result = call()
    jax.block_until_ready(result)
    return result, time.perf_counter() - begin
