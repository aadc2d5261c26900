"""Validation of a scenario: all that is found in its text, its fields and the files that it names."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from auvplan.errors import AuvplanError, ScenarioError, warn
from auvplan.ocean.closures import Zone
from auvplan.runtime.formatting import apart, depth
from auvplan.scenario.fields import Finding, finding_at, in_order
from auvplan.scenario.file import check_scenario
from auvplan.scenario.plausibility import implausible, unreachable
from auvplan.scenario.provenance import file_names
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.vehicles import navigation_settings, power_model
from auvplan.scenario.yaml_lines import Document, read_yaml

# Readers, charts and graphs load JAX and more: fields that are at fault are reported without them.
if TYPE_CHECKING:
    from auvplan.io.area import AreaFiles
    from auvplan.scenario.area import OperatingArea

#: Fields that no file of their section depends on.
_APART = {("mission", "start"), ("mission", "goal")}
#: Fields that may name files by a pattern.
_PATTERNS = "current.files", "current.truth", "current.members.files"


@dataclass(frozen=True)
class Examination:
    """What was found in a scenario file.

    Attributes:
        source: path or name of the scenario.
        findings: errors in the order of the file, warnings, and assumptions that were made in
            reading its files; without errors it can be executed.
        scenario: None where its fields are at fault.
        area: what could be read of its files; the chart is without closed areas. None with `scenario`.
        closed: the closed areas.
    """

    source: str
    findings: tuple[Finding, ...] = ()
    scenario: Scenario | None = None
    area: "OperatingArea | None" = None
    closed: tuple[Zone, ...] = ()

    @property
    def faults(self) -> tuple[Finding, ...]:
        """The errors."""
        return tuple(one for one in self.findings if one.severity == "error")

    @property
    def lines(self) -> list[str]:
        """A line an error: `FILE:LINE:COL field: what is wrong`."""
        return self._lines("error")

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings, a line each."""
        return tuple(self._lines("warning"))

    @property
    def notes(self) -> tuple[str, ...]:
        """A line an assumption."""
        return tuple(self._lines("note"))

    def _lines(self, severity: str) -> list[str]:
        return [one.line(self.source) for one in self.findings if one.severity == severity]


def examine_scenario(source: str | Path) -> Examination:
    """Look for everything that is wrong with a scenario, by path or name.

    Its text and fields first, and files that are not there. Each file that the scenario names is read, so
    that all their faults show, also where fields of other sections are at fault; then, where the fields are
    sound, start, goal and jobs are looked up in what could be read.

    Raises:
        ScenarioError: the file cannot be read as text; one line that names it.
    """
    scenario, faults, taken, document = check_scenario(source)
    found, sound = list(faults), None if faults else scenario
    folder = Path(source).parent if Path(source).is_file() else Path(".")
    missing = _missing(document, folder)
    found += missing.values()
    sections = {str(path[0]) for path in taken if path not in _APART}
    if scenario is None or sections & {"site", "area"}:
        return Examination(str(source), tuple(in_order(found)))
    from auvplan.io.area import AreaFiles, UnreadError, gathered_warnings

    if "chart.uncertain" in missing:
        plain = scenario.chart.model_copy(update={"uncertain": None})
        scenario = scenario.model_copy(update={"chart": plain})
    unread = {
        part
        for part, (section, *names) in AreaFiles.PARTS.items()
        if section in sections or any(f"{section}.{name}" in missing for name in names)
    }
    files = AreaFiles(scenario, folder, unread=unread)
    with gathered_warnings(show=False) as lines:
        reported: list[AuvplanError] = []
        for part, (section, *_) in files.PARTS.items():
            try:
                getattr(files, part)
            except AuvplanError as error:  # parts that are made of another one have the same
                wrong = [] if isinstance(error, UnreadError) else _errors(error, section, document)
                if error not in reported:
                    found += [one for one in wrong if one.field.partition(".")[0] not in sections]
                reported.append(error)
        if sound is None:
            return Examination(str(source), tuple(in_order(found)))
        area = files.readable_area
        land, no_go = files.readable("land"), files.readable("no_go")
        closed = (*(land.closed if land else ()), *(no_go or ()))
        found += _misplaced(files, area, document)
        if short := unreachable(sound):
            found.append(finding_at(("mission", "time_available"), short, document))
        for part, read in (
            ("power", lambda: power_model(sound.vehicle.power, folder, sound.vehicle.speed)),
            ("navigation", lambda: navigation_settings(sound.vehicle.navigation, folder)),
        ):
            if f"vehicle.{part}" not in missing:
                try:
                    read()
                except AuvplanError as error:
                    found += _errors(error, "vehicle", document)
        if not found:
            try:
                _check_graph(files)
            except AuvplanError as error:
                found += _errors(error, "mission", document)
    at_fault = {one.field for one in found}
    found = in_order(found) + [one for one in implausible(sound, document) if one.field not in at_fault]
    found += [Finding("", line, None, "warning") for line in lines]
    notes = (note for note in files.notes if note not in lines)
    found += [Finding("", line, None, "note") for line in (*sound.overrides, *notes)]
    return Examination(str(source), tuple(dict.fromkeys(found)), sound, area, closed)


def examine_folder(folder: Path) -> Iterator[Examination]:
    """`examine_scenario` of every scenario file in a folder, in the order of their names.

    Raises:
        ScenarioError: the folder has none.
    """
    paths = sorted(path for path in folder.iterdir() if path.suffix in (".yaml", ".yml") and path.is_file())
    # What a scenario names, such as constituents of a tide, is none itself.
    named = set()
    for path in paths:
        with suppress(OSError, ValueError):  # a faulty text, which is reported below
            plain = read_yaml(path.read_text(encoding="utf-8")).data
            named |= {(folder / name).resolve() for _, name in file_names(plain)}
    paths = [path for path in paths if path.resolve() not in named]
    if not paths:
        raise ScenarioError(f"{folder}: no scenario (*.yaml) in this folder")
    for path in paths:
        try:
            yield examine_scenario(path)
        except ScenarioError as error:
            yield Examination(str(path), (Finding("", error.reason.removeprefix(f"{path}: ")),))


def _missing(document: Document, folder: Path) -> dict[str, Finding]:
    """Files that are named and not there, by field."""
    found: dict[str, Finding] = {}
    gone: dict[str, list[str]] = {}
    for field, name in file_names(document.data if isinstance(document.data, dict) else {}):
        path, patterns = str(folder / Path(name).expanduser()), field in _PATTERNS
        if not (Path(path).exists() or (patterns and glob(path))):
            gone.setdefault(field, []).append(path)
    for field, paths in gone.items():
        what = "no such file" if field in _PATTERNS else "No such file or directory"
        more = f" (nor {len(paths) - 1} more)" if len(paths) > 1 else ""
        found[field] = finding_at(tuple(field.split(".")), f"{paths[0]}: {what}{more}", document)
    return found


def _errors(error: AuvplanError, section: str, document: Document) -> list[Finding]:
    path = tuple(error.field.split(".")) if error.field else (section,)
    return [finding_at(path, reason, document) for reason in error.lines]


def _misplaced(files: "AreaFiles", area: "OperatingArea", document: Document) -> Iterator[Finding]:
    """Start, goal and jobs that no vehicle can go to."""
    from auvplan.path.clearance import distance_to_land
    from auvplan.scenario.area import OperatingArea
    from auvplan.scenario.waypoints import misplaced, misplaced_end

    scenario, closed = files.scenario, OperatingArea(chart=files.readable("closed_water"))
    mission, asked = scenario.mission, scenario.safety.coast

    def wrong_with(position: Any, end: bool = False) -> str:
        """What is wrong with a place, an end of the mission or a job's, and where it is; or nothing."""
        at = np.asarray(position)
        wrong = (misplaced_end if end else misplaced)(at, scenario, area)
        if not wrong and misplaced(at, scenario, closed):
            wrong = f"lies in a closed area ({scenario.chart.no_go})"
        if not wrong and area.chart is not None:
            away = float(distance_to_land(area.chart, *at[:2]))  # type: ignore[arg-type]
            if away < asked:
                own, least = apart(max(away, 0.0), asked, digits=0)
                wrong = f"lies {own} m from the coast: safety.coast asks for {least} m"
        north, east, down = (float(axis) for axis in position)
        local = f"({round(north)}, {round(east)}, {depth(down)}) m"
        if wrong and scenario.site is not None:
            longitude, latitude = (float(a) for a in scenario.site.site.to_geographic(north, east))
            local = f"longitude {longitude:.5f}, latitude {latitude:.5f}, {depth(down)} m deep, {local},"
        return wrong and f"{local} {wrong}"

    for name, point in (("start", mission.start), ("goal", mission.goal)):
        if point is not None and (wrong := wrong_with(point, end=True)):
            yield finding_at(("mission", name), wrong, document)
    for name, position in () if area.jobs is None else area.jobs.places:
        if wrong := wrong_with(position):
            yield finding_at(("mission", "jobs"), f"{mission.jobs}: job {name!r} at {wrong}", document)


def _check_graph(files: "AreaFiles") -> None:
    """Raise where no graph can be made; warn of jobs in obstacles, steep legs and lines that are blocked."""
    from auvplan.scenario.lines import line_warnings
    from auvplan.scenario.waypoints import left_out_jobs, make_graph, shut_in, slope_warnings

    scenario, area = files.scenario, files.area()
    if (start := scenario.mission.start) is not None and (why := shut_in(np.asarray(start), area, 0.0)):
        warn(f"mission.start {why}: depart later, or start elsewhere")
    graph, names = make_graph(scenario, area, np.random.default_rng(0))
    stated = area.jobs is not None or graph.size == 2
    steep = slope_warnings(scenario, graph, names or ["start", "goal"]) if stated else []
    for line in [*left_out_jobs(scenario, area), *line_warnings(scenario, area), *steep]:
        warn(line)
