"""What links over the air have in common: a thread takes in what comes, and says that somebody is here."""

import logging
import math
import queue
import threading
import time
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from auvplan.link.limits import Limits
from auvplan.link.vehicle import Lost, Refused, Report, State, VehicleLink
from auvplan.runtime.arrays import Array
from auvplan.site import Site

_log = logging.getLogger(__name__)

#: s of the vehicle's time between two heartbeats.
_BEAT = 1.0


class ListeningLink(VehicleLink):
    """A vehicle that is listened to in a thread, which the subclass starts, until `close`.

    What ended the plan holds from then on, for however short a moment the vehicle says so.
    """

    def __init__(self, site: Site, limits: Limits | None, scale: float, over_ground: bool) -> None:
        """Begin before mission time does.

        Args:
            site: that local coordinates count from.
            limits: of replies and tries.
            scale: s of the vehicle's time in one of wall-clock time, for vehicles that are simulated.
            over_ground: whether the vehicle holds a speed over ground, not through the water.
        """
        self._site, self._limits, self.rate = site, limits or Limits(), scale
        self._over_ground = over_ground
        self._begin = math.nan  # s, when mission time began
        self._heard_at = -math.inf  # s, when anything was
        self._position: Array | None = None
        self._placed = -math.inf  # s, when that was heard
        self._speed, self._words, self._done = math.nan, "", 0  # m/s, its own last words, steps
        self._ended, self._faulty = "", False  # how the plan was ended, and whether by a fault
        self._answers: queue.Queue[Any] = queue.Queue()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)

    @property
    def _here(self) -> Array | None:
        """Where the vehicle is, [3] m; None where that was heard too long ago."""
        return self._position if time.monotonic() - self._placed <= self._limits.silence else None

    def _put(self, north: float, east: float, depth: float) -> None:
        """Take in where the vehicle is, m; what is no number is left out."""
        place = np.asarray([north, east, depth], float)
        if np.isfinite(place).all():
            self._position, self._placed = place, time.monotonic()

    @property
    def _started(self) -> bool:
        return not math.isnan(self._begin)

    def _begin_time(self) -> None:
        """Let mission time begin, where it has not."""
        if not self._started:
            self._begin = time.monotonic()

    @property
    def now(self) -> float:
        """Return s of mission time."""
        return (time.monotonic() - self._begin) * self.rate if self._started else 0.0

    def report(self, seconds: float) -> Report:
        """Let `seconds` of mission time pass, and return the newest report."""
        if seconds > 0.0:
            time.sleep(seconds / self.rate)
        age = time.monotonic() - self._heard_at
        return Report(age, self._here, self._speed, self._state(), self._done, self._message)

    def _check_goes_on(self) -> None:
        """See that nobody has ended the plan, nor the vehicle itself."""
        if self._ended:
            raise Refused(f"{self.name} has left the plan: {self._message}: nothing is started again")

    def close(self) -> None:
        """Close the connection."""
        self._closed.set()
        self._thread.join(timeout=2.0)
        self._disconnect()

    def _listen(self) -> None:
        beat = -math.inf
        while not self._closed.is_set():
            if time.monotonic() - beat >= _BEAT / self.rate:
                beat = time.monotonic()
                self._say_hello()
            try:
                self._receive()
            except Exception as error:  # whatever comes in, what comes after it is listened to
                _log.info("a message was left out: %r", error)
                self._closed.wait(0.01)

    def _until(self, so: Callable[[], bool], seconds: float) -> bool:
        """Wait until something is so; return whether it is within some seconds."""
        end = time.monotonic() + seconds
        while not so():
            if time.monotonic() > end:
                return False
            time.sleep(0.005)
        return True

    def _answer(
        self,
        fits: Callable[[Any], bool],
        look: Callable[[], None] = lambda: None,
        done: Callable[[], bool] = lambda: False,
    ) -> Any:
        """Return the next fitting answer within the time of a reply; None without one, or where it is done.

        `look` is called all the time, and may raise.
        """
        end = time.monotonic() + self._limits.reply
        while (left := end - time.monotonic()) > 0.0:
            look()
            try:
                message = self._answers.get(timeout=min(left, 0.05))
            except queue.Empty:
                if done():
                    return None
                continue
            if fits(message):
                return message
        return None

    def _asked(
        self,
        ask: Callable[[], None],
        fits: Callable[[Any], bool],
        lost: str,
        look: Callable[[], None] = lambda: None,
        done: Callable[[], bool] = lambda: False,
    ) -> Any:
        """Ask until there is a fitting answer, which is returned, or until it is done; `look` may raise."""
        for _ in range(self._limits.attempts):
            ask()
            if (answer := self._answer(fits, look, done)) is not None or done():
                return answer
        raise Lost(f"{self.name}: {lost}")

    @property
    def _message(self) -> str:
        """What is said of its state, in words."""
        return self._ended or self._words

    @abstractmethod
    def _say_hello(self) -> None:
        """Send a heartbeat."""

    @abstractmethod
    def _receive(self) -> None:
        """Wait for a tenth of a second for a message, and take it in."""

    @abstractmethod
    def _state(self) -> State:
        """Return what it does by what is known."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Let go of what the connection goes through."""
