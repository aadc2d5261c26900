"""All that is wrong with a scenario at once: its text, its fields, and the files that it names."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from auvplan.errors import AuvplanError
from auvplan.io.faults import Fault, fault_at, in_order
from auvplan.io.scenario_file import check_scenario
from auvplan.io.waters import load_waters
from auvplan.io.yaml_lines import Document
from auvplan.voyage.scenario import Scenario
from auvplan.voyage.settings import BathymetrySettings, ChartSettings, CurrentSettings
from auvplan.voyage.waters import Waters
from auvplan.voyage.waypoints import make_graph, misplaced


@dataclass(frozen=True)
class Examination:
    """What was found in a scenario file.

    Attributes:
        source: path or name of the scenario.
        faults: all that is wrong, in the order of the file; empty where it can be sailed.
        notes: assumptions that were made in reading its files, a line each.
    """

    source: str
    faults: tuple[Fault, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def lines(self) -> list[str]:
        """A line a fault: `FILE:LINE:COL field: what is wrong`."""
        return [" ".join(fault.line(self.source).split()) for fault in self.faults]


def examine_scenario(source: str | Path) -> Examination:
    """Look for everything that is wrong with a scenario.

    Its text and fields first. Where these are sound, each file that it names is read by itself, so that all
    their faults show; then start, goal and jobs are looked up in what could be read.

    Args:
        source: path of a scenario file, or the name of a shipped one.

    Raises:
        ScenarioError: the file cannot be read as text; one line that names it.
    """
    scenario, faults, document = check_scenario(source)
    if scenario is None:
        return Examination(str(source), tuple(faults))
    folder = Path(source).parent if Path(source).is_file() else Path(".")
    found = _Findings(scenario, document, folder)
    waters = _read_apart(scenario, found)
    found.faults += _places(scenario, waters, document)
    if not found.faults:
        found.attempt("scenario", scenario, partial(load_waters, scenario, folder))
        found.attempt("mission", scenario.mission, lambda: _graph(scenario, waters))
    notes = tuple(dict.fromkeys(note for part in found.read for note in part.notes))
    return Examination(str(source), tuple(in_order(found.faults)), (*scenario.planning.overrides, *notes))


@dataclass
class _Findings:
    """Faults and notes as they come up."""

    scenario: Scenario
    document: Document
    folder: Path
    faults: list[Fault] = field(default_factory=list)
    read: list[Waters] = field(default_factory=list)

    def attempt(self, section: str, settings: Any, action: Callable[[], Waters | None]) -> Waters | None:
        """What an action gives; None where it fails, which becomes a fault."""
        try:
            waters = action()
        except AuvplanError as error:
            path, reason = self._blamed(section, settings, str(error))
            self.faults.append(fault_at(path, reason, self.document))
            return None
        if waters is not None:
            self.read.append(waters)
        return waters

    def _blamed(self, section: str, settings: Any, message: str) -> tuple[tuple[str, ...], str]:
        """The field that a message of a reader is about, and the message without it."""
        named = re.match(r"(?:scenario\.)?([a-z_]+)\.([a-z_]+):? ", message)
        if named and named[2] in dict(getattr(self.scenario, named[1], None) or {}):
            return (named[1], named[2]), message[named.end() :]
        if message.startswith("area "):
            return ("area",), message
        if section == "truth":
            return ("current", "truth"), message
        if message.startswith("crs: "):
            return (section, "crs"), message.removeprefix("crs: ")
        if " pixels of " in message and section in ("chart", "bathymetry"):
            return (section, "pixel_size"), message
        if message.startswith("a spacing of ") and section == "current":
            return (section, "spacing"), message
        values = {name: value for name, value in settings if isinstance(value, str)}
        told = [name for name, value in values.items() if str(self.folder / value) in message]
        if told:
            return (section, max(told, key=lambda name: len(values[name]))), message
        main = [name for name in ("jobs", "files", "file", "image") if getattr(settings, name, None)]
        return ((section, *main[:1]) if section in Scenario.model_fields else ()), message


def _read_apart(scenario: Scenario, found: _Findings) -> Waters:
    """The waters as far as they can be read, one file after the other."""
    parts: dict[str, Waters | None] = {}
    for section, settings, alone in _apart(scenario):
        if section in ("chart", "bathymetry") and settings.source == "current" and parts["current"] is None:
            continue  # its fault is the current's, which is told
        parts[section] = found.attempt(section, settings, partial(load_waters, alone, found.folder))
    got = {section: part or Waters() for section, part in parts.items()}
    empty = Waters()
    return Waters(
        chart=got.get("chart", empty).chart,
        seabed=got.get("bathymetry", empty).seabed,
        site=next((part.site for part in got.values() if part.site is not None), None),
        jobs=got.get("mission", empty).jobs,
    )


def _apart(scenario: Scenario) -> Iterator[tuple[str, Any, Scenario]]:
    """Section, its settings, and a scenario that reads its files and those alone that they depend on."""
    current = scenario.current
    vortices = CurrentSettings(vortices=0)
    shipped = scenario.chart if scenario.chart.source == "whitsunday" and scenario.site is None else None
    bare = scenario.model_copy(
        update={
            "chart": shipped or ChartSettings(source="none"),
            "bathymetry": BathymetrySettings(),
            "current": vortices,
            "mission": scenario.mission.model_copy(update={"jobs": None}),
        }
    )
    if current.source == "file":
        told = current.model_copy(update={"truth": None})
        yield "current", told, bare.model_copy(update={"current": told})
        if current.truth is not None:
            sailed = current.model_copy(update={"files": current.truth, "truth": None})
            yield "truth", sailed, bare.model_copy(update={"current": sailed})
    for section, settings in (("chart", scenario.chart), ("bathymetry", scenario.bathymetry)):
        needed = current if settings.source == "current" else vortices
        yield section, settings, bare.model_copy(update={section: settings, "current": needed})
    if scenario.mission.jobs is not None:
        yield "mission", scenario.mission, bare.model_copy(update={"mission": scenario.mission})


def _places(scenario: Scenario, waters: Waters, document: Document) -> Iterator[Fault]:
    """Start, goal and jobs that no vehicle can go to."""
    mission = scenario.mission
    for name, point in (("start", mission.start), ("goal", mission.goal)):
        if point is not None and (wrong := misplaced(np.asarray(point), scenario, waters)):
            yield fault_at(("mission", name), f"{point} {wrong}", document)
    if waters.jobs is None:
        return
    places = [(job.name, job.position) for job in waters.jobs.points]
    places += [(job.name, position) for job in waters.jobs.lines for position in job.positions]
    for name, position in places:
        if wrong := misplaced(np.asarray(position), scenario, waters):
            where = "({:.0f}, {:.0f}, {:.0f}) m".format(*position)
            yield fault_at(("mission", "jobs"), f"{mission.jobs}: job {name!r} at {where} {wrong}", document)


def _graph(scenario: Scenario, waters: Waters) -> None:
    make_graph(scenario, waters, np.random.default_rng(0))
