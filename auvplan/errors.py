"""Errors about user input, printed as one line by the commands."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

#: Characters of a line; what a file holds, such as a unit, may be a megabyte.
_LINE = 1000


class AuvplanError(ValueError):
    """Bad input or output; the message is one line that names what is wrong.

    Attributes:
        lines: all that was found wrong, a line each; the message is the first, and how many more there are.
        field: what is at fault: a field of a scenario, dotted, such as "chart.file"; an argument of a reader,
            such as "crs"; empty where none is known.
        reason: the message without the field.
    """

    def __init__(self, reason: str = "", *others: str, field: str = "") -> None:
        self.lines = tuple(
            line if len(line) <= _LINE else f"{line[: _LINE - 3]}..." for line in (reason, *others)
        )
        reason = self.lines[0]
        if others:
            reason += f" (and {len(others)} more: auvplan validate lists all)"
        super().__init__(f"{field} {reason}" if field else reason)
        self.field, self.reason = field, reason


class ScenarioError(AuvplanError):
    """A scenario that cannot be built; the message is one line."""


class StudyError(AuvplanError):
    """A study that cannot be run or continued; the message is one line."""


class RuleError(ScenarioError):
    """Fields of a scenario, each of them sound, that do not go together.

    Attributes:
        concerns: the fields that the rule looks at beside `field`.
    """

    def __init__(self, reason: str, *, field: str, concerns: tuple[str, ...] = ()) -> None:
        super().__init__(reason, field=field)
        self.concerns = concerns


class ScenarioWarning(UserWarning):
    """What may not be meant in a scenario or its files, and was assumed; the message is one line."""


def warn(line: str) -> None:
    """Issue a `ScenarioWarning`."""
    warnings.warn(line, ScenarioWarning, stacklevel=3)


def reason_of(error: Exception) -> str:
    """Return what an error says, or what a library's own error before it said, on one line."""
    first = error.__cause__ or error
    text = first.strerror if isinstance(first, OSError) and first.strerror else str(first)
    return " ".join(text.split())[:300] or f"cannot be read ({type(error).__name__})"


@contextmanager
def error_context(section: str, field: str) -> Iterator[None]:
    """Put errors within down to a field of a scenario's section, or to that which the error names.

    Args:
        section: such as "chart"; empty for an argument of a reader.
        field: such as "file".
    """
    try:
        yield
    except AuvplanError as error:
        if "." not in error.field:
            error.field = ".".join(filter(None, (section, error.field or field)))
        raise
