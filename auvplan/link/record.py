"""What became of a mission that was executed: the record of it, as a file."""

import json
from collections import Counter
from dataclasses import asdict, dataclass, field
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

from auvplan.runtime.files import EXECUTION, output_folder, write_atomically
from auvplan.scenario.provenance import SourceFile, source_files

#: Reason of a record whose mission has not ended.
UNDER_WAY = "under way"


@dataclass(frozen=True)
class Event:
    """Something that happened.

    Attributes:
        time: s of mission time.
        kind: one word, for programs.
        text: one line, for people.
    """

    time: float
    kind: str
    text: str


@dataclass
class ExecutionRecord:
    """An execution from its plan to its verdict.

    Attributes:
        scenario: settings as plain data.
        folder: that its relative paths start from.
        seed: of the planners.
        link: what the vehicle is called.
        t_available: s.
        t_mission: s of mission time at the end.
        success: whether the destination was reached in time.
        reason: the verdict, one line; `UNDER_WAY` until there is one.
        safe: how the vehicle is at the end, in words.
        route: waypoints that were reached, by name, the start first.
        tasks: names of the legs whose task is done, "from - to", in order.
        total_priority: of these tasks.
        planned: legs of the last plan, "from - to".
        uploads: each with its number, steps and cause.
        events: in order.
        track: rows of time s, north, east, depth m, as reported.
    """

    scenario: dict[str, Any]
    folder: str
    seed: int
    link: str
    t_available: float
    t_mission: float = 0.0
    success: bool = False
    reason: str = ""
    safe: str = ""
    route: list[str] = field(default_factory=list)
    tasks: list[str] = field(default_factory=list)
    total_priority: float = 0.0
    planned: list[str] = field(default_factory=list)
    uploads: list[dict[str, Any]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    track: list[tuple[float, float, float, float]] = field(default_factory=list)

    def count(self, kind: str) -> int:
        """Return how many events are of a kind."""
        return sum(event.kind == kind for event in self.events)

    @cached_property
    def _files(self) -> tuple[SourceFile, ...]:
        return source_files(self.scenario, self.folder)

    def summary(self) -> dict[str, Any]:
        """Return the record ready for JSON."""
        plain = asdict(self)
        first = ("success", "reason", "safe", "link", "t_available", "t_mission", "seed")
        last = ("route", "planned", "uploads", "events", "track")
        return {
            **{name: plain[name] for name in first},
            "scenario": self.scenario.get("name", ""),
            "tasks": len(self.tasks),
            "total_priority": self.total_priority,
            "counts": dict(sorted(Counter(event.kind for event in self.events).items())),
            "tasks_done": self.tasks,
            "files": [asdict(file) for file in self._files],
            "version": version("auvplan"),
            **{name: plain[name] for name in last},
        }

    def save(self, folder: str | Path) -> Path:
        """Write the record into a folder, created if needed.

        Raises:
            OutputError: one line that names what cannot be written and why.
        """
        text = json.dumps(self.summary(), indent=1, allow_nan=False) + "\n"
        target = output_folder(folder) / EXECUTION
        return write_atomically(target, lambda part: part.write_text(text, encoding="utf-8"))
