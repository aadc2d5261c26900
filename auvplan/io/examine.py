"""Validation of a scenario: all faults of its text, its fields and the files that it names."""

import warnings
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from auvplan.errors import AuvplanError, ScenarioError, ScenarioWarning
from auvplan.io import geo
from auvplan.scenario.doubts import doubts, unreachable
from auvplan.scenario.faults import Fault, fault_at, in_order
from auvplan.scenario.fields import check_what_is_left
from auvplan.scenario.file import check_scenario
from auvplan.scenario.provenance import FILE_FIELDS
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.settings import (
    BathymetrySettings,
    ChartSettings,
    CurrentSettings,
    ObstacleSettings,
)
from auvplan.scenario.yaml_lines import Document

#: Fields that no file of their section depends on.
_APART = {("mission", "start"), ("mission", "goal")}

# Readers, charts and graphs load JAX and more: fields that are at fault are reported without them.
if TYPE_CHECKING:
    from auvplan.ocean.chart import Chart
    from auvplan.scenario.area import OperatingArea


@dataclass(frozen=True)
class Examination:
    """What was found in a scenario file.

    Attributes:
        source: path or name of the scenario.
        faults: all that is wrong, in the order of the file; empty where it can be executed.
        warnings: what can hardly be meant, a line each.
        notes: assumptions that were made in reading its files, a line each.
        scenario: None where its fields are at fault.
        area: what could be read of its files; the chart is without closed areas. None with `scenario`.
        closed: the closed areas.
    """

    source: str
    faults: tuple[Fault, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    scenario: Scenario | None = None
    area: "OperatingArea | None" = None
    closed: "tuple[geo.Zone, ...]" = ()

    @property
    def lines(self) -> list[str]:
        """A line a fault: `FILE:LINE:COL field: what is wrong`."""
        return [" ".join(fault.line(self.source).split()) for fault in self.faults]


def examine_scenario(source: str | Path) -> Examination:
    """Look for everything that is wrong with a scenario.

    Its text and fields first, and files that are not there. Each file that the scenario names is read by
    itself, so that all their faults show, also where fields of other sections are at fault; then, where the
    fields are sound, start, goal and jobs are looked up in what could be read, and the files are compared.

    Args:
        source: path of a scenario file, or the name of a shipped one.

    Raises:
        ScenarioError: the file cannot be read as text; one line that names it.
    """
    scenario, faults, document = check_scenario(source)
    folder = Path(source).parent if Path(source).is_file() else Path(".")
    missing = _missing(document, folder)
    if scenario is None:
        found = [*faults, *missing.values(), *_file_faults(document, folder, missing)]
        return Examination(str(source), tuple(in_order(found)))
    from auvplan.io.area import load_area

    found = _Findings(scenario, document, folder, list(missing.values()))
    with _heard() as heard:
        parts = _read_apart(scenario, found, missing)
        area, closed = _together(parts), _zones(scenario, parts, folder)
        if not found.faults:  # what contradicts itself may be why places are on land
            found.attempt("scenario", scenario, partial(load_area, scenario, folder))
        found.faults += _places(scenario, area, parts.get("no_go"), document)
        if short := unreachable(scenario):
            found.faults.append(fault_at(("mission", "time_available"), short, document))
        if not found.faults:
            found.attempt("mission", scenario.mission, lambda: _graph(scenario, folder))
    doubtful = [
        fault.line(str(source)) for fault in doubts(scenario, document) if not _is_reported(fault, found)
    ]
    notes = tuple(dict.fromkeys(note for part in found.read for note in part.notes))
    return Examination(
        str(source),
        tuple(in_order(found.faults)),
        tuple(dict.fromkeys((*doubtful, *heard))),
        (*scenario.overrides, *(note for note in notes if note not in heard)),
        scenario,
        area,
        closed,
    )


def examine_folder(folder: Path) -> Iterator[Examination]:
    """`examine_scenario` of every scenario file in a folder, in the order of their names.

    Raises:
        ScenarioError: the folder has none.
    """
    paths = sorted(path for path in folder.iterdir() if path.suffix in (".yaml", ".yml") and path.is_file())
    if not paths:
        raise ScenarioError(f"{folder}: no scenario (*.yaml) in this folder")
    for path in paths:
        try:
            yield examine_scenario(path)
        except ScenarioError as error:
            yield Examination(str(path), (Fault("", error.reason.removeprefix(f"{path}: ")),))


@contextmanager
def _heard() -> Iterator[list[str]]:
    """The lines of what is warned of within, which is not shown; other warnings are, afterwards."""
    lines: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ScenarioWarning)
        yield lines
    for one in caught:
        if issubclass(one.category, ScenarioWarning):
            lines.append(" ".join(str(one.message).split()))
        else:
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)


def _is_reported(doubt: Fault, found: "_Findings") -> bool:
    """Return whether a fault of the same field says it already."""
    return any(fault.field == doubt.field for fault in found.faults)


def _missing(document: Document, folder: Path) -> dict[tuple[str, str], Fault]:
    """Files that are named and not there, by section and field."""
    found = {}
    data = document.data if isinstance(document.data, dict) else {}
    for section, names in FILE_FIELDS.items():
        part = data.get(section)
        if not isinstance(part, dict):
            continue
        for name in names:
            given = part.get(name)
            several = given if isinstance(given, list) else [given]
            paths = [str(folder / Path(entry).expanduser()) for entry in several if isinstance(entry, str)]
            if section == "current" and name != "constituents":
                gone = [f"{path}: no such file" for path in paths if not (glob(path) or Path(path).exists())]
            else:
                gone = [f"{path}: No such file or directory" for path in paths if not Path(path).exists()]
            if gone:
                more = f" (nor {len(gone) - 1} more)" if len(gone) > 1 else ""
                found[section, name] = fault_at((section, name), gone[0] + more, document)
    return found


def _file_faults(document: Document, folder: Path, missing: dict[tuple[str, str], Fault]) -> list[Fault]:
    """Return what is wrong with the files of sections that are sound where fields elsewhere are at fault."""
    scenario, _, taken = check_what_is_left(document, Scenario)
    at_fault = {str(path[0]) for path in taken if path not in _APART}
    if scenario is None or at_fault & {"site", "area"}:
        return []
    found = _Findings(scenario, document, folder)
    with _heard():
        _read_apart(scenario, found, missing, at_fault)
    return [fault for fault in found.faults if fault.field.partition(".")[0] not in at_fault]


@dataclass
class _Findings:
    """Faults and notes as they come up."""

    scenario: Scenario
    document: Document
    folder: Path
    faults: list[Fault] = field(default_factory=list)
    read: "list[OperatingArea]" = field(default_factory=list)

    def attempt(
        self, section: str, settings: Any, action: "Callable[[], OperatingArea | None]"
    ) -> "OperatingArea | None":
        """Return what an action gives; None where it fails, which becomes a fault or more."""
        try:
            area = action()
        except AuvplanError as error:
            path = self._path(section, settings, error.field)
            for reason in error.lines:
                self.faults.append(fault_at(path, reason, self.document))
            return None
        if area is not None:
            self.read.append(area)
        return area

    def _path(self, section: str, settings: Any, field: str) -> tuple[str, ...]:
        """Return the path of a field that an error names, or of the file of a section."""
        if section == "truth":
            return ("current", "truth")
        if field:
            return tuple(field.split("."))
        main = [name for name in ("jobs", "files", "file", "image") if getattr(settings, name, None)]
        return (section, *main[:1]) if section in Scenario.model_fields else ()


def _read_apart(
    scenario: Scenario,
    found: _Findings,
    missing: dict[tuple[str, str], Fault],
    at_fault: Collection[str] = (),
) -> "dict[str, OperatingArea | None]":
    """Return the area of each part of a scenario as far as it can be read, one file after the other.

    Sections whose fields are `at_fault` are left out.
    """
    from auvplan.io.area import read_area

    parts: dict[str, OperatingArea | None] = {}
    for part, section, settings, alone in _apart(scenario, missing):
        if section in at_fault:
            continue
        if section in ("chart", "bathymetry") and settings.source == "current" and not parts.get("current"):
            continue  # its fault is the current's, which is reported
        if section == "bathymetry" and settings.source == "chart" and not parts.get("chart"):
            continue  # or the chart's
        unread = "chart" in at_fault or ("chart" in parts and parts["chart"] is None)
        if section in ("current", "bathymetry", "mission") and unread:
            alone = alone.model_copy(update={"chart": ChartSettings(source="none")})
        if section in ("bathymetry", "mission") and not parts.get("current"):
            bare: dict[str, Any] = {"current": CurrentSettings(vortices=0)}
            if section == "mission" or settings.source != "chart":
                bare["chart"] = ChartSettings(source="none")
            alone = alone.model_copy(update=bare)
        parts[part] = found.attempt(section, settings, partial(read_area, alone, found.folder))
    return parts


def _together(parts: "dict[str, OperatingArea | None]") -> "OperatingArea":
    """Return what could be read, in one."""
    from auvplan.scenario.area import OperatingArea

    got = {part: area or OperatingArea() for part, area in parts.items()}
    empty = OperatingArea()
    return OperatingArea(
        chart=got.get("chart", empty).chart,
        seabed=got.get("bathymetry", empty).seabed,
        site=next((part.site for part in got.values() if part.site is not None), None),
        forecast=got.get("current", empty).forecast,
        jobs=got.get("mission", empty).jobs,
        obstacles=(*got.get("chart", empty).obstacles, *got.get("obstacles", empty).obstacles),
    )


def _apart(
    scenario: Scenario, missing: dict[tuple[str, str], Fault]
) -> Iterator[tuple[str, str, Any, Scenario]]:
    """Part, its section and settings, and a scenario that reads its files and those that they depend on.

    Parts whose files are missing are left out.
    """
    current, chart = scenario.current, scenario.chart
    vortices = CurrentSettings(vortices=0)
    shipped = chart if chart.source == "whitsunday" and scenario.site is None else None
    bare = scenario.model_copy(
        update={
            "chart": shipped or ChartSettings(source="none"),
            "bathymetry": BathymetrySettings(),
            "current": vortices,
            "obstacles": ObstacleSettings(),
            "mission": scenario.mission.model_copy(update={"jobs": None}),
        }
    )
    forecast = current.model_copy(update={"truth": None})
    gone = {"uncertain": None} if ("chart", "uncertain") in missing else {}
    plain = chart.model_copy(update={"no_go": None, "no_go_windows": None} | gone)
    there = not missing.keys() & {("chart", "file"), ("chart", "image")}
    if there and chart.source != "current":
        yield "chart", "chart", plain, bare.model_copy(update={"chart": plain})
    # Where a chart has land no current is needed; of a current's own mask a coarse chart will do.
    coarse = max(np.subtract(scenario.box[1][:2], scenario.box[0][:2])) / 32.0
    own = ChartSettings(source="current", pixel_size=float(coarse))
    land = own if chart.source == "current" else plain if there else ChartSettings(source="none")
    named_by = {"file": "files", "harmonic": "constituents"}.get(current.source)
    readable = named_by is not None and ("current", named_by) not in missing
    if readable:
        yield "current", "current", forecast, bare.model_copy(update={"current": forecast, "chart": land})
    if current.truth is not None and ("current", "truth") not in missing:
        truth = current.model_copy(update={"files": current.truth, "truth": None})
        yield "truth", "truth", truth, bare.model_copy(update={"current": truth, "chart": land})
    if there and chart.source == "current":
        yield "chart", "chart", plain, bare.model_copy(update={"chart": plain, "current": forecast})
    if chart.no_go is not None and ("chart", "no_go") not in missing:
        hours = {"no_go": chart.no_go, "no_go_windows": chart.no_go_windows}
        closed = ChartSettings(source="none", pixel_size=chart.pixel_size, **hours)
        yield "no_go", "chart", closed, bare.model_copy(update={"chart": closed})
    if ("bathymetry", "file") not in missing:
        # The current's files tell the lowest water.
        tide = {"current": forecast} if readable else {}
        only = bare.model_copy(update={"bathymetry": scenario.bathymetry, "chart": land} | tide)
        yield "bathymetry", "bathymetry", scenario.bathymetry, only
    if scenario.obstacles.file is not None and ("obstacles", "file") not in missing:
        only = bare.model_copy(update={"obstacles": scenario.obstacles})
        yield "obstacles", "obstacles", scenario.obstacles, only
    if scenario.mission.jobs is not None and ("mission", "jobs") not in missing:
        needed = {"mission": scenario.mission}
        if current.source != "vortices" and ("current", "files") not in missing:
            needed |= {"current": forecast, "chart": land}  # slack water is given by the current
        yield "mission", "mission", scenario.mission, bare.model_copy(update=needed)


def _zones(
    scenario: Scenario, parts: "dict[str, OperatingArea | None]", folder: Path
) -> "tuple[geo.Zone, ...]":
    """Return the closed areas, where they could be read."""
    from auvplan.io.area import charted_zones

    found: tuple[geo.Zone, ...] = ()
    if parts.get("chart") is not None:
        found = charted_zones(scenario, folder)
    closed = parts.get("no_go")
    if closed is None or closed.site is None or scenario.chart.no_go is None:
        return found
    return (*found, *geo.read_zones(folder / Path(scenario.chart.no_go).expanduser(), closed.site))


def _places(
    scenario: Scenario, area: "OperatingArea", closed: "OperatingArea | None", document: Document
) -> Iterator[Fault]:
    """Start, goal and jobs that no vehicle can go to."""
    from auvplan.path.clearance import distance_to_land
    from auvplan.scenario.area import OperatingArea
    from auvplan.scenario.waypoints import misplaced

    mission = scenario.mission

    def wrong_with(point: Any) -> str:
        at = np.asarray(point)
        wrong = misplaced(at, scenario, area)
        if not wrong and closed is not None and misplaced(at, scenario, OperatingArea(chart=closed.chart)):
            wrong = f"lies in a closed area ({scenario.chart.no_go})"
        return wrong or too_near(at, area.chart, "the coast")

    def too_near(at: np.ndarray, chart: "Chart | None", what: str) -> str:
        asked = scenario.safety.coast
        if chart is None or (away := float(distance_to_land(chart, *at[:2]))) >= asked:  # type: ignore[arg-type]
            return ""
        return f"lies {max(away, 0.0):.0f} m from {what}: safety.coast asks for {asked:g} m"

    def stated(position: Any) -> str:
        north, east, depth = (float(axis) for axis in position)
        local = f"({round(north)}, {round(east)}, {round(depth)}) m"
        if scenario.site is None:
            return local
        longitude, latitude = (float(a) for a in scenario.site.site.to_geographic(north, east))
        return f"longitude {longitude:.5f}, latitude {latitude:.5f}, {depth:.0f} m deep, {local},"

    for name, point in (("start", mission.start), ("goal", mission.goal)):
        if point is not None and (wrong := wrong_with(point)):
            yield fault_at(("mission", name), f"{stated(point)} {wrong}", document)
    if area.jobs is None:
        return
    places = [(job.name, job.position) for job in area.jobs.points]
    places += [(job.name, position) for job in area.jobs.lines for position in job.positions]
    for name, position in places:
        if wrong := wrong_with(position):
            line = f"{mission.jobs}: job {name!r} at {stated(position)} {wrong}"
            yield fault_at(("mission", "jobs"), line, document)


def _graph(scenario: Scenario, folder: Path) -> None:
    from auvplan.io.area import load_area
    from auvplan.scenario.lines import line_warnings
    from auvplan.scenario.waypoints import make_graph, slope_warnings

    area = load_area(scenario, folder)
    graph, names = make_graph(scenario, area, np.random.default_rng(0))
    stated = area.jobs is not None or graph.size == 2
    steep = slope_warnings(scenario, graph, names or ["start", "goal"]) if stated else []
    for line in [*line_warnings(scenario, area), *steep]:
        warnings.warn(line, ScenarioWarning, stacklevel=1)
