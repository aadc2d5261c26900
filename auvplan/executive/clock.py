"""Timing of planning calls, compilation excluded."""

import time
from collections.abc import Callable
from typing import Any

import jax

from auvplan.runtime.compiled import compilations, compile_seconds

#: s without compilation from which on a call is not made again to be timed.
_LONG = 2.0


class Clock:
    """Times calls with compilation apart: a short call that compiled is made again, and that one is timed.

    Attributes:
        compile_seconds: s of all calls that compiled something; of long ones what compilation took.
    """

    def __init__(self) -> None:
        self.compile_seconds = 0.0

    def time(self, call: Callable[[], Any]) -> tuple[Any, float]:
        """Return the call's result and its wall-clock seconds, free of compilation."""
        before, waited = compilations(), compile_seconds()
        result, seconds = _timed(call)
        if compilations() == before:
            return result, seconds
        compiling = min(compile_seconds() - waited, seconds)
        if seconds - compiling > _LONG:
            self.compile_seconds += compiling
            return result, seconds - compiling
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
