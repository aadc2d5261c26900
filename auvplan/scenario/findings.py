"""What is found in a scenario and its files: with the field that it is about and its place in the text."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from auvplan.scenario.yaml_lines import Document, Path, Place

#: Characters of a reason that are shown.
_LONGEST = 500


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, may not be meant, or was assumed.

    Attributes:
        field: dotted, such as "mission.time_available"; empty for the file as a whole.
        reason: one line.
        place: line and column in the file, from 1, or None.
        severity: an error stands in the way of a mission.
    """

    field: str
    reason: str
    place: Place | None = None
    severity: Literal["error", "warning", "note"] = "error"

    def line(self, source: str) -> str:
        """As compilers write it: `FILE:LINE:COL field: reason`; the reason alone of what is no field's."""
        if self.severity != "error" and not self.field:
            return self.reason
        where = source if self.place is None else f"{source}:{self.place[0]}:{self.place[1]}"
        return " ".join(f"{where} {self.field or 'scenario'}: {self.reason}".split())


def finding_at(
    path: Path,
    reason: str,
    document: Document,
    place: Place | None = None,
    severity: Literal["error", "warning", "note"] = "error",
) -> Finding:
    """Return a finding on a value in a document."""
    line = " ".join(reason.split())
    line = line if len(line) <= _LONGEST else f"{line[:_LONGEST]} ..."
    # One word that can be printed, whatever the keys hold.
    parts = (str(part) for part in path)
    field = ".".join(
        part if part.isprintable() and len(part) <= 80 else ascii(part[:80])[1:-1] for part in parts
    )
    return Finding(field, line, place or document.place(path), severity)


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """As they stand in the file, those without a place last; each once."""
    return sorted(dict.fromkeys(findings), key=lambda finding: finding.place or (1 << 30, 0))


def first_of(findings: list[Finding], source: str, is_file: bool) -> str:
    """Return the first finding on one line that names the file, and how many more there are."""
    first, more = findings[0], len(findings) - 1
    where = f"{source}:{first.place[0]}" if first.place is not None else source
    line = f"{where}: {first.field or 'scenario'}: {first.reason}"
    if not more:
        return line
    return f"{line} (and {more} more{f': auvplan validate {source} lists all' if is_file else ''})"
