"""A run's pictures, some of them drawn by a process beside this one.

It loads what drawing needs while the mission is planned. Nothing that takes long to load is imported here.
"""

import os
from collections import deque
from contextlib import suppress
from enum import StrEnum
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Thread
from types import TracebackType
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
    the two of them draw: whoever is free takes the next picture.
    """

    def __init__(self, choice: Pictures = Pictures.ALL):
        """Draw all pictures, that of the mission alone, or none."""
        self._choice = choice
        self.process = None
        self.server: Thread | None = None
        self._drawn: list[Path] = []
        self._error: Exception | None = None

    def __enter__(self) -> Self:
        if self._choice == Pictures.ALL and cores.count() > 1:
            context = get_context("spawn")
            self._pipe, other = context.Pipe()
            self.process = context.Process(target=_paint, args=(other,), daemon=True)
            with cores.ignoring_interrupts():
                self.process.start()
            other.close()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, place: TracebackType | None
    ) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.join()
            if self.server is not None:
                self.server.join()
            self._pipe.close()

    def begin(self, run: "MissionRun", folder: Path) -> None:
        """Begin to draw where that goes on beside other work."""
        self._run, self._folder = run, folder
        every = _NAMES if run.energy is not None else _NAMES[:-1]
        wanted = {Pictures.ALL: every, Pictures.MAIN: _NAMES[:1], Pictures.NONE: ()}[self._choice]
        self._left = deque(wanted)
        if self.process is not None:
            self.server = Thread(target=self._serve, daemon=True)
            self.server.start()

    def finish(self) -> list[Path]:
        """Write the pictures, or what is left of them.

        Raises:
            OutputError: as `draw_run`.
        """
        self._draw_what_is_left()
        if self.server is not None:
            self.server.join()
            self._draw_what_is_left()  # what the process had begun where it ended early
        if self._error is not None:
            raise self._error
        return sorted(self._drawn, key=lambda path: _NAMES.index(path.name))

    def _draw_what_is_left(self) -> None:
        while self._error is None and (name := _next(self._left)):
            from auvplan.plot.run import draw_run

            self._drawn += draw_run(self._run, self._folder, [name])

    def _serve(self) -> None:
        """Hand the process one picture after the other, in a thread."""
        name = None
        try:
            self._pipe.send((self._run, self._folder))
            while self._pipe.recv():  # it is ready for one
                name = _next(self._left)
                self._pipe.send(name)
                if name is None:
                    return
                outcome = self._pipe.recv()
                if isinstance(outcome, Exception):
                    self._error = outcome
                    return
                self._drawn += outcome
        except (EOFError, OSError):  # it has ended before its time
            if name is not None:
                self._left.append(name)


def _next(names: deque[str]) -> str | None:
    try:
        return names.popleft()
    except IndexError:
        return None


def _paint(pipe: Connection) -> None:
    """Draw what is asked for; the other side's end ends it."""
    os.environ["JAX_PLATFORMS"] = "cpu"
    from auvplan.plot.run import draw_run

    with suppress(EOFError, OSError):
        run, folder = pipe.recv()
        while True:
            pipe.send(True)
            name = pipe.recv()
            if name is None:
                return
            try:
                pipe.send(draw_run(run, folder, [name]))
            except Exception as error:  # reported to those who asked for the pictures
                pipe.send(error)
                return
