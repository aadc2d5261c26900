"""A scenario: everything that a mission needs to know but its seed, validated."""

import math
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic import ModelWrapValidatorHandler, PrivateAttr, model_validator

from auvplan.errors import RuleError, ScenarioError, ScenarioWarning
from auvplan.scenario.fields import check_fields, first_of
from auvplan.scenario.section import by_degrees, localised
from auvplan.scenario.settings import (
    PITCH_LIMITS,
    PRESETS,
    Area,
    BathymetrySettings,
    ChartSettings,
    CurrentSettings,
    MissionSettings,
    ObstacleSettings,
    PlanningSettings,
    SafetySettings,
    Section,
    SensorSettings,
    SimulationSettings,
    SiteSettings,
    TransitAltitude,
    VehicleSettings,
)
from auvplan.scenario.yaml_lines import Document
from auvplan.site import Site

#: Fields of the vehicle that limit it in the vertical.
VERTICAL_LIMITS = "pitch_max", "climb_rate_max", "dive_rate_max"

#: What says where local metres are on Earth.
_SITE = {"site", "site.longitude", "site.latitude", "site.origin"}

#: What the box of a mission is made of.
_BOX_FIELDS = ("area.lower", "area.upper", "vehicle.depth_min", "vehicle.depth_max")


class Scenario(Section):
    """A whole scenario; see each section.

    Places may be given as mappings of longitude, latitude [deg] and depth [m]; they are kept in local metres,
    and stay where they are on Earth where `with_` moves the site.
    """

    name: str = "unnamed"
    description: str = ""
    site: SiteSettings | None = None
    area: Area = Area()
    chart: ChartSettings = ChartSettings()
    bathymetry: BathymetrySettings = BathymetrySettings()
    vehicle: VehicleSettings = VehicleSettings()
    current: CurrentSettings = CurrentSettings()
    obstacles: ObstacleSettings = ObstacleSettings()
    safety: SafetySettings = SafetySettings()
    sensors: SensorSettings = SensorSettings()
    simulation: SimulationSettings = SimulationSettings()
    mission: MissionSettings = MissionSettings()
    planning: PlanningSettings = PlanningSettings()

    _folder: str = PrivateAttr(default=".")
    _warnings: tuple[str, ...] = PrivateAttr(default=())
    _by_degrees: dict[tuple[str, str], dict[str, Any]] = PrivateAttr(default_factory=dict)

    @property
    def folder(self) -> str:
        """That relative paths start from: of the scenario's file, or the working directory without one."""
        return self._folder

    @property
    def warnings(self) -> tuple[str, ...]:
        """Implausible settings of the scenario's file that were not changed since, a line each."""
        return self._warnings

    @property
    def differs_by_seed(self) -> str:
        """Why each seed makes another mission altogether, in which no plan of one holds; else empty."""
        current, mission = self.current, self.mission
        if current.source == "vortices" and current.vortices > 0:
            return "current.source 'vortices' draws another sea for each mission"
        if mission.jobs is None and (mission.waypoints > 2 or mission.start is None or mission.goal is None):
            return "mission.waypoints are drawn again for each mission"
        return ""

    @property
    def fingerprint(self) -> str:
        """All settings that programs are compiled for, as text."""
        return self.model_dump_json(exclude={"vehicle": {"power"}})

    def in_folder(self, folder: str | Path, warnings: tuple[str, ...] = ()) -> "Scenario":
        """Return the same settings with relative paths from `folder`, and what may not be meant in them."""
        moved = self.model_copy()
        moved._folder, moved._warnings = str(folder), warnings
        return moved

    def with_(self, changes: Mapping[str, Any]) -> "Scenario":
        """Return the same with other values of some fields, validated as a scenario's file is.

        Args:
            changes: values by "section.field", as `--set` and `--sweep` name them; of a whole section by its
                name.

        Raises:
            ScenarioError: a field is not known or a value does not fit; one line that names the field.

        Example:
            >>> import auvplan as ap
            >>> scenario = ap.load_scenario("whitsunday").with_({"vehicle.speed": 2, "mission.waypoints": 12})
            >>> scenario.vehicle.speed, scenario.mission.waypoints
            (2.0, 12)
            >>> scenario.with_({"vehicle.sped": 2})
            Traceback (most recent call last):
                ...
            auvplan.errors.ScenarioError: scenario: vehicle.sped: unknown key 'sped', did you mean 'speed'?
        """
        return change_scenario(self, changes)

    @model_validator(mode="wrap")
    @classmethod
    def _in_local_metres(cls, given: Any, handler: ModelWrapValidatorHandler["Scenario"]) -> "Scenario":
        if not isinstance(given, dict):
            return handler(given)
        site = Site(0.0, 0.0)  # where it is at fault, which its validation reports
        with suppress(ValueError):
            stated = given.get("site")
            site = None if stated is None else SiteSettings.model_validate(stated).site
        scenario = handler(localised(given, site))
        scenario._by_degrees = by_degrees(given)
        return scenario

    def _check(self) -> None:
        def refuse(wrong: bool, field: str, reason: str, *concerns: str) -> None:
            if wrong:
                raise RuleError(reason, field=field, concerns=concerns)

        chart, bed, current, safety = self.chart, self.bathymetry, self.current, self.safety
        site = "needs the section site: where on Earth the origin lies"
        for field, source, placed in (
            ("chart.source", chart.source, chart.source in ("raster", "polygons", "enc")),
            ("chart.no_go", None, chart.no_go is not None),
            ("chart.no_surfacing", None, chart.no_surfacing is not None),
            ("bathymetry.source", bed.source, bed.source == "file"),
            ("current.source", current.source, current.source in ("file", "harmonic")),
            ("obstacles.file", None, self.obstacles.file is not None),
        ):
            refuse(placed and self.site is None, field, f"{source!r} {site}" if source else site, "site")
        of_current, lacking = "'current' needs current.source 'file'", current.source != "file"
        refuse(chart.source == "current" and lacking, "chart.source", of_current, "current.source")
        refuse(bed.source == "current" and lacking, "bathymetry.source", of_current, "current.source")
        of_cells, lacking = "'chart' needs chart.source 'enc'", chart.source != "enc"
        refuse(bed.source == "chart" and lacking, "bathymetry.source", of_cells, "chart.source")
        untimed = self.mission.jobs is not None and self.planning.task_time == "expected"
        reason = "'expected' leaves out the time that jobs take"
        refuse(untimed, "planning.task_time", reason, "mission.jobs")
        fixed = self.vehicle.speed_range is not None and self.planning.resolved.objective != "priority"
        reason = "speeds are chosen for objective 'priority' alone"
        refuse(fixed, "vehicle.speed_range", reason, "planning.objective", "planning.preset")
        glides = self.vehicle.speed_range is not None and self.vehicle.saw_tooth is not None
        refuse(glides, "vehicle.speed_range", "does not go with a saw-tooth", "vehicle.saw_tooth")
        glides = self.planning.promise is not None and self.vehicle.saw_tooth is not None
        reason = "does not follow a saw-tooth's dives: keep time back by a shorter mission.time_available"
        refuse(glides, "planning.promise", reason, "vehicle.saw_tooth")
        low, high = self.box
        nothing = "leaves, with depth_max, nothing of the area's depths"
        refuse(low[2] > high[2], "vehicle.depth_min", nothing, *_BOX_FIELDS)
        transit, outside = self.vehicle.transit_depth, "lies outside the area or the vehicle's depths"
        if isinstance(transit, TransitAltitude):
            reason = "an altitude needs a sea bed"
            refuse(bed.source == "none", "vehicle.transit_depth", reason, "bathymetry.source")
            reason = f"{transit.altitude:g} m are less than the clearance of {safety.seabed:g} m"
            refuse(transit.altitude < safety.seabed, "vehicle.transit_depth", reason, "safety.seabed")
        elif transit is not None:
            inside = low[2] <= transit <= high[2]
            refuse(not inside, "vehicle.transit_depth", f"{transit:g} m {outside}", *_BOX_FIELDS)
        if (saw := self.vehicle.saw_tooth) is not None:
            steep = math.radians(saw.glide_angle) > (self.pitch_max or math.inf) + 1e-6
            low_bed = bed.source != "none" and saw.above_bed < safety.seabed
            for wrong, reason, *concerns in (
                (transit is not None, "excludes transit_depth", "vehicle.transit_depth"),
                (self.planning.preset == "paper", "goes with preset 'default' alone", "planning.preset"),
                (saw.shallow < low[2] or saw.deep > high[2], f"has a turn that {outside}", *_BOX_FIELDS),
                (saw.dives > 0 < low[2], "surfaces, and depth 0 is outside the area", *_BOX_FIELDS),
                (low_bed, f"above_bed is less than the clearance of {safety.seabed:g} m", "safety.seabed"),
                (steep, "glide_angle is more than pitch_max", "vehicle.pitch_max"),
            ):
                refuse(bool(wrong), "vehicle.saw_tooth", str(reason), *map(str, concerns))
        for name, point in (("start", self.mission.start), ("goal", self.mission.goal)):
            inside = point is None or all(a <= p <= b for a, p, b in zip(low, point, high, strict=True))
            refuse(not inside, f"mission.{name}", f"{point} {outside}", *_BOX_FIELDS)

    @property
    def tasks_under_way(self) -> bool:
        """Whether tasks are done along the path, in no time of their own; jobs from a file never are."""
        return self.planning.resolved.task_time == "expected" and self.mission.jobs is None

    @property
    def pitch_max(self) -> float | None:
        """Limit on the vehicle's pitch, rad; None for no limit."""
        given = self.vehicle.pitch_max
        if given is None:
            return PITCH_LIMITS[self.planning.preset]
        return None if given == "none" else given

    @property
    def overrides(self) -> list[str]:
        """One line for each setting that differs from what the preset 'paper' fixes; none for 'default'."""
        if self.planning.preset != "paper":
            return []
        fixed = ((name, getattr(self.planning, name), value) for name, value in PRESETS["paper"].items())
        found = [
            f"planning.{name} is {given!r}, preset 'paper' has {value!r}"
            for name, given, value in fixed
            if given is not None and given != value
        ]
        limits = ((name, getattr(self.vehicle, name)) for name in VERTICAL_LIMITS)
        found += [
            f"vehicle.{name} is {given!r}, preset 'paper' has no such limit"
            for name, given in limits
            if given not in (None, "none")
        ]
        return [f"{line}: the mission is not the paper's" for line in found]

    @property
    def box(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Corners of the area, m, at the depths that the vehicle may go to."""
        low, high, vehicle = self.area.lower, self.area.upper, self.vehicle
        deepest = high[2] if vehicle.depth_max is None else min(high[2], vehicle.depth_max)
        return (low[0], low[1], max(low[2], vehicle.depth_min)), (high[0], high[1], deepest)


def change_scenario(
    scenario: Scenario,
    changes: Mapping[str, Any],
    source: str = "scenario",
    sources: Mapping[str, str] | None = None,
) -> Scenario:
    """Return a scenario with other values of some fields, validated as one from a file; see `Scenario.with_`.

    An error names the `source`, or that of its field in `sources`.

    Raises:
        ScenarioError: a field is not known or a value does not fit; one line that names source and field.
    """
    plain = scenario.model_dump(mode="json")
    if not _SITE.isdisjoint(changes):
        for (section, field), place in scenario._by_degrees.items():
            plain[section][field] = place
    if unknown := put_fields(plain, changes):
        raise ScenarioError(f"{(sources or {}).get(unknown, source)}: {unknown}: unknown key")
    changed, faults, _ = check_fields(Document(plain), type(scenario))
    if faults or changed is None:
        # What was given, its section, or something within it, is reported before what it leads to elsewhere.
        given = [
            (fault, name)
            for fault in faults
            for name in changes
            if f"{fault.field}.".startswith(f"{name}.") or f"{name}.".startswith(f"{fault.field}.")
        ]
        faults = list(dict.fromkeys([*(fault for fault, _ in given), *faults]))
        source = (sources or {}).get(given[0][1], source) if given else source
        raise ScenarioError(first_of(faults, source, is_file=False))
    for (section, field), place in scenario._by_degrees.items():
        if getattr(getattr(changed, section), field) == getattr(getattr(scenario, section), field):
            changed._by_degrees.setdefault((section, field), place)
    warn_of_overrides(changed)
    doubtful = (line for line in scenario.warnings if not any(f": {name}: " in line for name in changes))
    return changed.in_folder(scenario.folder, tuple(doubtful))


def put_fields(plain: dict[str, Any], changes: Mapping[str, Any]) -> str:
    """Put values by "section.field" into plain data, in place; return the first without a section, or ""."""
    for name, value in changes.items():
        *sections, field = name.split(".")
        inside: Any = plain
        for section in sections:
            if isinstance(inside, dict) and inside.get(section) is None:
                inside[section] = {}
            inside = inside.get(section) if section and isinstance(inside, dict) else None
        if not isinstance(inside, dict):
            return name
        inside[field] = value
    return ""


def warn_of_overrides(scenario: Scenario) -> None:
    """Warn of settings that differ from what the preset fixes."""
    for line in scenario.overrides:
        warnings.warn(line, ScenarioWarning, stacklevel=1)
