"""Fixed batch sizes and honest clocks for batched planning calls."""

import time
from collections.abc import Callable, Hashable, Sequence
from typing import Any, TypeVar

import jax

from auvplan.rows import padded_batches

T = TypeVar("T")


def chunks(items: Sequence[T]) -> list[tuple[list[T], int]]:
    """Split into batches, each padded to a size of `auvplan.rows.SIZES` by repeating its first item.

    Returns:
        Pairs of the padded batch and the number of real items at its front.
    """
    return [([items[k] for k in index], real) for index, real in padded_batches(len(items))]


class Clock:
    """Times calls with compilation apart: a call of a new signature is made twice, the second one timed."""

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
