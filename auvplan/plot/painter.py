"""A run's pictures, some of them drawn by a process beside this one.

It loads what drawing needs while the mission is planned. Nothing that takes long to load is imported here.
"""

import os
import pickle
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from enum import StrEnum
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, Self

from auvplan.runtime import cores

if TYPE_CHECKING:
    from auvplan.records import MissionRun


class Pictures(StrEnum):
    """Which pictures are drawn."""

    NONE = "none"
    MAIN = "main"
    ALL = "all"


#: All pictures, those that take long first; the last one of vehicles with a power model.
_NAMES = "mission.png", "currents.png", "timeline.png", "convergence.png", "obstacles.png", "energy.png"


class Painter:
    """Draws the pictures of one run: ``with Painter() as painter``, then `begin` and `finish`.

    Where there is a second core, a process beside this one loads what drawing needs from the beginning, and
    draws from `begin` on; what it has not begun by `finish` is drawn here.
    """

    def __init__(self, choice: Pictures = Pictures.ALL):
        """Draw all pictures, that of the mission alone, or none."""
        self._choice = choice
        self._pool: ProcessPoolExecutor | None = None
        self.process: BaseProcess | None = None

    def __enter__(self) -> Self:
        if self._choice == Pictures.ALL and cores.count() > 1:
            self._pool, before = ProcessPoolExecutor(1, get_context("spawn")), set(active_children())
            with cores.ignoring_interrupts():
                self._pool.submit(_load)
            (self.process,) = set(active_children()) - before
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None and self.process is not None:
            self.process.kill()
            self._pool.shutdown()

    def begin(self, run: "MissionRun", folder: Path) -> None:
        """Begin to draw where that goes on beside other work."""
        self._run, self._folder = run, folder
        every = _NAMES if run.energy is not None else _NAMES[:-1]
        self._wanted = {Pictures.ALL: every, Pictures.MAIN: _NAMES[:1], Pictures.NONE: ()}[self._choice]
        self._begun: dict[str, Future[list[Path]]] = {}
        if self._pool is not None:
            sent = pickle.dumps(run)  # the pool does so in a thread, while the run is in use here
            with suppress(BrokenProcessPool):  # it has ended before its time
                for name in self._wanted:
                    self._begun[name] = self._pool.submit(_draw_sent, sent, folder, name)

    def finish(self) -> list[Path]:
        """Write the pictures, or what is left of them.

        Raises:
            OutputError: as `draw_run`.
        """
        drawn: dict[str, list[Path]] = {}
        alive = self.process is not None and self.process.is_alive()
        for name in reversed(self._wanted):  # the process begins with the first
            # What a process leaves that has ended is not cancelled: the pool's thread may be at it.
            if name not in self._begun or (alive and self._begun[name].cancel()):
                drawn[name] = _draw(self._run, self._folder, name)
        for name in self._wanted:
            if name not in drawn:
                try:
                    drawn[name] = self._begun[name].result()
                except BrokenProcessPool:
                    drawn[name] = _draw(self._run, self._folder, name)
        return [path for name in self._wanted for path in drawn[name]]


def _load() -> None:
    """Load what drawing needs, in the process that draws."""
    os.environ["JAX_PLATFORMS"] = "cpu"
    import auvplan.plot.run  # noqa: F401


def _draw_sent(run: bytes, folder: Path, name: str) -> list[Path]:
    return _draw(pickle.loads(run), folder, name)


def _draw(run: "MissionRun", folder: Path, name: str) -> list[Path]:
    from auvplan.plot.run import draw_run

    return draw_run(run, folder, [name])
