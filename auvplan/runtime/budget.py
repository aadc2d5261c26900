"""A watch on the wall-clock time of a planning call: what may still be begun, from how long it took before.

A search with a budget runs in chunks that are chosen so that the last one ends in time. How long a piece of
work takes is learnt as it is done, at its slowest of late: beside a busy process it takes longer.
"""

import math
import threading
import time
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import jax
import numpy as np

from auvplan.runtime import cores
from auvplan.runtime.arguments import numbers
from auvplan.runtime.compiled import compilations

T = TypeVar("T")

#: Share of a budget that a chunk of work takes at most.
_CHUNK = 0.08

#: Share that remains of a slow time at every later and quicker one.
_MEMORY = 0.8

#: Share of a budget that is left for what is not watched, and s at least, as far as half of it goes.
_SPARE, _LEAST = 0.05, 0.012

_seconds: dict[Hashable, float] = {}


class Budget:
    """Seconds of wall-clock time for a planning call of several legs or missions.

    Compilation is not counted: a call that compiles something takes as much longer.
    """

    def __init__(self, seconds: float, rows: int = 1):
        """Begin now, with `rows` to be planned by as many threads as there are cores.

        Raises:
            ValueError: the time is not positive, or infinite: None is for all that a search needs.
            TypeError: it is no number, as a `timedelta` is not.
        """
        if np.ndim(seconds) or not 0.0 < numbers("budget", seconds) < math.inf:
            raise ValueError(
                f"budget must be positive and finite, s of wall-clock time, or None, got {seconds}"
            )
        spare = min(max(_SPARE * seconds, _LEAST), 0.5 * seconds)
        self._ends, self._total = time.perf_counter() + seconds - spare, seconds
        self._rows, self._lock = rows, threading.Lock()
        # The first row goes ahead alone, see `rows.batch_map`.
        self._together = min(cores.count(), max(rows - 1, 1))

    @property
    def left(self) -> float:
        """Seconds that are left, negative where it was exceeded."""
        return self._ends - time.perf_counter()

    def next_row(self) -> "Share":
        """Return the next row's share of what is left."""
        with self._lock:
            waves = -(-self._rows // self._together)
            self._rows -= 1
            return Share(self, max(self.left, 0.0) / max(waves, 1))

    def rest(self) -> "Share":
        """Return all that is left, for work on all rows together."""
        return Share(self, max(self.left, 0.0))

    def prolong(self, seconds: float) -> None:
        """Leave out time that was spent on compilation."""
        with self._lock:
            self._ends += seconds


class Share:
    """What one row of a planning call may take of its budget."""

    def __init__(self, whole: Budget, seconds: float):
        """Begin now."""
        self._whole, self._total = whole, seconds
        self._ends = time.perf_counter() + seconds
        self._kept = 0.0

    @property
    def left(self) -> float:
        """Seconds that are left for work that can be done without."""
        return self._ends - self._kept - time.perf_counter()

    def keep_for(self, *work: Hashable) -> None:
        """Keep time for work that has to be done at the end."""
        self._kept = sum(_seconds.get(item, 0.0) for item in work)

    def allows(self, work: Hashable) -> bool:
        """Return whether a piece of work ends in time."""
        return _seconds.get(work, 0.0) < self.left

    def units(self, work: Hashable, most: int) -> int:
        """Return of how many units a chunk of work should be: 0 where no time is left."""
        each = _seconds.get(work)
        if each is None:
            return min(most, 1) if self.left > 0.0 else 0
        if each > self.left:
            return 0
        return max(1, min(most, int(min(_CHUNK * self._total, self.left) / each)))

    def spend(self, work: Hashable, call: Callable[[], T], units: int = 1) -> T:
        """Return what a call returns, and learn how long a unit of this work takes."""
        before, begin = compilations(), time.perf_counter()
        result: Any = jax.block_until_ready(call())
        seconds = time.perf_counter() - begin
        if compilations() != before:
            begin = time.perf_counter()
            result = jax.block_until_ready(call())
            again = time.perf_counter() - begin
            self._whole.prolong(seconds)
            self._ends, seconds = self._ends + seconds, again
        _seconds[work] = max(seconds / units, _MEMORY * _seconds.get(work, 0.0))
        return result


class Unlimited:
    """A share without an end: all work is done, in one chunk."""

    def keep_for(self, *work: Hashable) -> None:
        """Keep nothing."""

    def allows(self, work: Hashable) -> bool:
        """Return that a piece of work ends in time."""
        return True

    def units(self, work: Hashable, most: int) -> int:
        """Return that all units make one chunk."""
        return most

    def spend(self, work: Hashable, call: Callable[[], T], units: int = 1) -> T:
        """Return what a call returns."""
        return call()


UNLIMITED = Unlimited()


def share_of(budget: Budget | None) -> Share | Unlimited:
    """Return the next row's share of a budget; one without an end where there is no budget."""
    return UNLIMITED if budget is None else budget.next_row()
