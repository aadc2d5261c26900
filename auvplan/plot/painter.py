"""A run's pictures, some of them drawn by a process beside this one.

It loads what drawing needs while the mission is planned. Nothing that takes long to load is imported here.
"""

import os
from contextlib import suppress
from enum import StrEnum
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from auvplan import cores

if TYPE_CHECKING:
    from auvplan.records import MissionRun


class Pictures(StrEnum):
    """Which pictures are drawn."""

    NONE = "none"
    MAIN = "main"
    ALL = "all"


#: What the process beside this one draws; the other half of the work is the picture of the mission.
_BESIDE = "timeline.png", "currents.png", "obstacles.png", "convergence.png"


class Painter:
    """Draws the pictures of one run: ``with Painter() as painter``, then `begin` and `finish`."""

    def __init__(self, choice: Pictures = Pictures.ALL):
        """Draw all pictures, that of the mission alone, or none."""
        self._choice = choice
        self._process = None
        self._beside: tuple[str, ...] = ()

    def __enter__(self) -> Self:
        if self._choice == Pictures.ALL and cores.count() > 1:
            context = get_context("spawn")
            self._pipe, other = context.Pipe()
            self._process = context.Process(target=_paint, args=(other,), daemon=True)
            with cores.deaf():
                self._process.start()
            other.close()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, place: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._pipe.close()
            self._process.kill()
            self._process.join()

    def begin(self, run: "MissionRun", folder: Path) -> None:
        """Begin to draw where that goes on beside other work."""
        self._run, self._folder = run, folder
        if self._process is not None:
            with suppress(OSError):  # it has ended before its time: all is drawn here
                self._pipe.send((run, folder))
                self._beside = _BESIDE

    def finish(self) -> list[Path]:
        """Write the pictures, or what is left of them.

        Returns:
            The paths of all.

        Raises:
            OutputError: as `draw_run`.
        """
        if self._choice == Pictures.NONE:
            return []
        from auvplan.plot.run import FIGURES, draw_run

        names = FIGURES if self._choice == Pictures.ALL else ["mission.png"]
        found = draw_run(self._run, self._folder, [name for name in names if name not in self._beside])
        if self._beside:
            try:
                outcome = self._pipe.recv()
            except (EOFError, OSError):  # it ended on the way
                outcome = draw_run(self._run, self._folder, self._beside)
            if isinstance(outcome, Exception):
                raise outcome
            found += outcome
        return found


def _paint(pipe: Connection) -> None:
    """Draw what is sent; the other side's closing the pipe ends it."""
    os.environ["JAX_PLATFORMS"] = "cpu"
    from auvplan.plot.run import draw_run

    with suppress(EOFError):
        run, folder = pipe.recv()
        try:
            pipe.send(draw_run(run, folder, _BESIDE))
        except Exception as error:  # reported to those who asked for the pictures
            pipe.send(error)
