"""Numbered cases in a process of their own, which may die, take too long or take too much memory."""

import contextlib
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
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
    work: Callable[..., None],
    given: tuple[Any, ...],
    numbers: Sequence[int],
    method: str,
    patience: float | None = None,
    more: Callable[[], bool] = lambda: True,
) -> Iterator[tuple[Any, ...]]:
    """Yield what becomes of each case.

    A process that dies may have tripped over what an earlier case left in its memory: its case is begun once
    more in a new one.

    Args:
        work: ``work(*given, numbers, pipe)`` sends ``(number, change)`` before a case, the same and what
            became of it afterwards, None at the end.
        method: by which processes start.
        patience: s of wall-clock time after which a case's process is ended; None for ever.
        more: whether to go on.

    Yields:
        What was sent after a case; ``(number, change, fault)`` where its process died twice.
    """
    context, died = multiprocessing.get_context(method), None
    while numbers and (died is not None or more()):
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=work, args=(*given, numbers, theirs), daemon=True)
        process.start()
        theirs.close()
        begun, fault = None, ""
        while not fault and numbers and (begun is not None or died is not None or more()):
            if not ours.poll(patience):
                fault = f"no answer in {patience:.0f} s"
                continue
            try:
                message = ours.recv()
            except EOFError:
                process.join()
                fault = f"the process died ({process.exitcode})"
                continue
            if message is None:
                numbers = []
            elif len(message) == 2:
                begun = message
            else:
                begun, died, numbers = None, None, numbers[1:]
                yield message
        process.kill()
        process.join()
        if fault and begun is None:
            raise RuntimeError(f"{fault} by itself")
        if fault and died is None:
            died = begun[0]
        elif fault:
            died, numbers = None, numbers[1:]
            yield *begun, fault
