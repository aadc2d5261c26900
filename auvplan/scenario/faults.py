"""What is wrong with a scenario file: every fault with its field and its place in the text."""

from collections.abc import Iterable
from dataclasses import dataclass

from auvplan.scenario.yaml_lines import Document, Path, Place

#: Characters of a reason that are shown.
_LONGEST = 500


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        field: dotted, such as "mission.time_available"; empty for the file as a whole.
        reason: one line.
        place: line and column in the file, from 1, or None.
    """

    field: str
    reason: str
    place: Place | None = None

    def line(self, source: str) -> str:
        """As compilers write it: `FILE:LINE:COL field: what is wrong`."""
        where = source if self.place is None else f"{source}:{self.place[0]}:{self.place[1]}"
        return f"{where} {self.field or 'scenario'}: {self.reason}"


def fault_at(path: Path, reason: str, document: Document, place: Place | None = None) -> Fault:
    """Return a fault of a value in a document."""
    line = " ".join(reason.split())
    line = line if len(line) <= _LONGEST else f"{line[:_LONGEST]} ..."
    return Fault(dotted(path), line, place or document.place(path))


def in_order(faults: Iterable[Fault]) -> list[Fault]:
    """As they stand in the file, those without a place last; each once."""
    return sorted(dict.fromkeys(faults), key=lambda fault: fault.place or (1 << 30, 0))


def first_of(faults: list[Fault], source: str, is_file: bool) -> str:
    """Return the first fault on one line that names the file, and how many more there are."""
    first, more = faults[0], len(faults) - 1
    where = f"{source}:{first.place[0]}" if first.place is not None else source
    line = f"{where}: {first.field or 'scenario'}: {first.reason}"
    if not more:
        return line
    return (
        f"{line} (and {more} more: auvplan validate {source} lists all)"
        if is_file
        else f"{line} (and {more} more)"
    )


def dotted(path: Path) -> str:
    """Return a path as one word that can be printed, whatever its keys hold."""
    parts = (str(part) for part in path)
    return ".".join(
        part if part.isprintable() and len(part) <= 80 else ascii(part[:80])[1:-1] for part in parts
    )
