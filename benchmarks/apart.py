"""Numbered cases in a process of their own, which may die, take too long or take too much memory."""

import contextlib
import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import Connection
from typing import Any


class Late(BaseException):
    """A case takes too long; nothing takes this for a fault of its file."""


@contextlib.contextmanager
def within(seconds: float) -> Iterator[None]:
    """Raise `Late` after so much processor time."""

    def late(*_: object) -> None:
        raise Late(f"longer than {seconds:g} s")

    signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def run_apart(
    work: Callable[..., None], given: tuple[Any, ...], numbers: Iterable[int], method: str,
    patience: float | None = None, more: Callable[[], bool] = lambda: True,
) -> Iterator[tuple[Any, ...]]:  # fmt: skip
    """Yield what becomes of each case.

    A process that dies may have tripped over what an earlier case left in its memory: its case is begun once
    more in a new one.

    Args:
        work: ``work(*given, pipe)`` receives numbers; for each it sends the change before the case, and a
            tuple of what became of it afterwards.
        method: by which processes start.
        patience: s of wall-clock time after which a case's process is ended; None for ever.
        more: whether to begin another case.

    Yields:
        ``(number, change, *became)``; ``(number, change, fault)`` where its process died twice.
    """
    context, process, pipe = multiprocessing.get_context(method), None, None

    def answer(pipe: Connection) -> Any:
        if not pipe.poll(patience):
            raise TimeoutError(f"no answer in {patience:.0f} s")
        return pipe.recv()

    for number in numbers:
        if not more():
            break
        for is_last in (False, True):
            if process is None:
                pipe, theirs = context.Pipe()
                process = context.Process(target=work, args=(*given, theirs), daemon=True)
                process.start()
                theirs.close()
            change = fault = ""
            try:
                pipe.send(number)
                change = answer(pipe)
                became = answer(pipe)
            except TimeoutError as error:
                fault = str(error)
            except (EOFError, ConnectionError):
                process.join()
                fault = f"the process died ({process.exitcode})"
            if not fault:
                yield number, change, *became
                break
            process.kill()
            process.join()
            process = None
            if not change:
                raise RuntimeError(f"{fault} by itself")
            if is_last:
                yield number, change, fault
    if process is not None:
        process.kill()
        process.join()
