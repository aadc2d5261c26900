"""The sections of a scenario, validated one by one."""

import math
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Optional, TypeVar
from zoneinfo import available_timezones

from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from auvplan.errors import RuleError
from auvplan.ocean.palette import ChartColours, as_hex
from auvplan.scenario.power import NavigationSettings, PowerSettings
from auvplan.scenario.section import Finite, NotNegative, Point, Positive, Seconds, Section, optional, setting
from auvplan.site import Site, as_utc

Velocity = tuple[Finite, Finite, Finite]

if TYPE_CHECKING:
    from auvplan.path.saw_tooth import SawTooth

    # The preset fills the value in before anything looks at it: see `PlanningSettings.resolved`.
    _Value = TypeVar("_Value")
    Preset = Annotated[_Value, "None for the preset's"]
else:
    Preset = Optional


def _rising(pair: tuple[Any, Any]) -> tuple[Any, Any]:
    if pair[0] > pair[1]:
        raise ValueError(f"must be the least and then the greatest, got {list(pair)}")
    return pair


#: Least and greatest.
PositiveRange = Annotated[tuple[Positive, Positive], AfterValidator(_rising)]
NotNegativeRange = Annotated[tuple[NotNegative, NotNegative], AfterValidator(_rising)]
PriorityRange = Annotated[
    tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]], AfterValidator(_rising)
]


class SourcedSection(Section):
    """Base of sections whose fields go with some of their sources, by field."""

    #: Given with these sources, and with no other.
    required: ClassVar[dict[str, tuple[str, ...]]] = {}
    #: Given with these alone.
    allowed: ClassVar[dict[str, tuple[str, ...]]] = {}
    #: Without effect with others.
    effective: ClassVar[dict[str, tuple[str, ...]]] = {}

    source: Any

    def _check(self) -> None:
        for field, sources in self.required.items():
            if (self.source in sources) != (getattr(self, field) is not None):
                reason = f"must be given with source {' or '.join(map(repr, sources))}, and only then"
                raise RuleError(reason, field=field, concerns=("source",))
        for field, sources in self.allowed.items():
            given = getattr(self, field) != type(self).model_fields[field].default
            if given and self.source not in sources:
                reason = f"goes with source {' or '.join(map(repr, sources))} alone"
                raise RuleError(reason, field=field, concerns=("source",))


class SiteSettings(Section):
    """Where and when the mission is; without it local metres and seconds stand alone."""

    longitude: Annotated[float, Field(ge=-180, le=360)] = Field(description="degrees east")
    latitude: Annotated[float, Field(gt=-89, lt=89)] = Field(description="degrees north")
    origin: tuple[Finite, Finite] = setting((0.0, 0.0), "m, local north, east of this place")
    departure: datetime | None = optional(
        "UTC unless it says so; if absent the first time of the current's files"
    )

    timezone: str | None = optional(
        "name of the local time zone, such as Australia/Brisbane, for the mission sheet"
    )

    @field_validator("timezone")
    @classmethod
    def _known_zone(cls, name: str | None) -> str | None:
        if name is not None and name not in available_timezones():
            raise ValueError(f"{name!r} is no time zone such as Australia/Brisbane")
        return name

    @field_validator("departure", mode="before")
    @classmethod
    def _no_number(cls, moment: Any) -> Any:
        if isinstance(moment, int | float):  # counted from 1970, 20260301 would be a day of that year
            raise ValueError(f"must be a date such as 2026-03-01T06:00:00Z, got the number {moment}")
        return moment

    @field_validator("departure")
    @classmethod
    def _in_utc(cls, moment: datetime | None) -> datetime | None:
        if moment is not None and not 1800 <= moment.year <= 2200:
            raise ValueError(f"the year {moment.year} is not one of 1800 to 2200")
        return None if moment is None else as_utc(moment)

    @property
    def site(self) -> Site:
        """The site, whose epoch is the departure."""
        return Site(self.longitude, self.latitude, self.departure, self.origin)


class Area(Section):
    """Box of the mission: north, east, depth (positive down) in local metres, or corners by place."""

    lower: Point = setting((0.0, 0.0, 0.0), "south-western corner at the least depth")
    upper: Point = setting((10_000.0, 10_000.0, 1000.0), "north-eastern corner at the greatest depth")

    def _check(self) -> None:
        low, high = self.lower, self.upper
        if low[0] >= high[0] or low[1] >= high[1] or low[2] > high[2]:
            raise RuleError("must be below upper (depths may be equal)", field="lower", concerns=("upper",))


Colours = str | tuple[str, ...]


class ColourSettings(Section):
    """What the colours of a chart picture stand for: CSS names, or '#rrggbb' in quotes; one or several.

    Where water and land are both given, every tone of the picture takes the class of the nearest colour.
    """

    water: Colours = setting((), "of water, such as [white, lightblue]")
    land: Colours = setting((), "of land")
    uncertain: Colours = setting((), "of uncertain area, such as shoals")

    @field_validator("water", "land", "uncertain", mode="before")
    @classmethod
    def _colours(cls, given: Any) -> Any:
        if given is None:
            raise ValueError("no colour is given: one that begins with # needs quotes")
        colours = (given,) if isinstance(given, str) else given
        if not isinstance(colours, list | tuple) or not all(isinstance(colour, str) for colour in colours):
            raise ValueError("a colour is a CSS name such as lightblue, or '#rrggbb' in quotes")
        return tuple(as_hex(colour) for colour in colours)

    def _check(self) -> None:
        _ = self.given

    @property
    def given(self) -> ChartColours:
        """The colours by what they stand for."""
        return ChartColours(*(tuple(getattr(self, name)) for name in ("water", "land", "uncertain")))


class ChartSettings(SourcedSection):
    """Where the coast comes from."""

    required: ClassVar = {"image": ("image",), "file": ("raster", "polygons", "enc")}
    allowed: ClassVar = {
        "colours": ("image", "raster"),
        "uncertain": ("polygons",),
        "window": ("whitsunday", "image"),
    }
    effective: ClassVar = {
        "fringe": ("polygons",), "safety_depth": ("enc",), "hazard_radius": ("enc",), "crs": ("raster",),
    }  # fmt: skip

    source: Literal["whitsunday", "image", "raster", "polygons", "enc", "current", "none"] = setting(
        "whitsunday",
        "'image': a picture without a place; 'raster': a GeoTIFF or a picture with a world "
        "file; 'polygons': land as GeoJSON; 'enc': S-57 cells; 'current': where the current's file has no "
        "water; 'none': open water",
    )
    image: str | None = optional("path, relative to the scenario file, of 'image'")
    file: str | None = optional(
        "path of 'raster', 'polygons' or 'enc': of a cell (.000) or a folder with cells"
    )
    crs: str | None = optional("reference system of a raster that names none, such as EPSG:32755")
    uncertain: str | None = optional("path of GeoJSON polygons of uncertain area, such as reefs ('polygons')")
    fringe: NotNegative = setting(0.0, "m of uncertain area along the coast ('polygons')")
    safety_depth: NotNegative = setting(
        5.0, "m below the chart's datum; water that may be shallower is closed ('enc')"
    )
    hazard_radius: Positive = setting(
        50.0, "m, of rocks, wrecks and obstructions that are points or lines on the chart ('enc')"
    )
    colours: ColourSettings = setting(
        ColourSettings(),
        "what a picture's colours stand for ('image', 'raster'); found by rules if absent, which "
        "know blue water and refuse what they are not sure of",
    )
    no_go: str | None = optional(
        "path of GeoJSON polygons that are closed; those with the properties from and to, or "
        "windows, at these hours"
    )
    no_go_windows: str | None = optional(
        "when polygons of no_go that have no hours are closed, 'from/to, from/to' as "
        "windows of jobs; always if absent"
    )
    no_surfacing: str | None = optional(
        "path of GeoJSON polygons in which no vehicle surfaces for a fix, such as lanes; nor does one "
        "in areas of no_go"
    )
    pixel_size: Positive = setting(10.0, "m")
    accuracy: NotNegative = setting(0.0, "m, of the coast; distances to it are stated no finer. 0: not known")
    window: tuple[int, int, int, int] | None = optional(
        "first row (north), first column (east), rows, columns to cut out, pixels"
    )

    def _check(self) -> None:
        super()._check()
        if self.no_go_windows is not None and self.no_go is None:
            raise RuleError("goes with no_go alone", field="no_go_windows", concerns=("no_go",))


class BathymetrySettings(SourcedSection):
    """The sea bed, from which the vehicle keeps its distance."""

    required: ClassVar = {"file": ("file",)}
    effective: ClassVar = {
        **dict.fromkeys(("variable", "positive", "crs"), ("file",)), "pixel_size": ("file", "current"),
    }  # fmt: skip

    source: Literal["none", "file", "current", "chart"] = setting(
        "none",
        "'current': as the current's file has it; 'chart': the least depths of the depth areas "
        "of S-57 cells (chart.source 'enc')",
    )
    file: str | None = optional("path of a NetCDF file, a GeoTIFF or another raster")
    crs: str | None = optional("reference system of a raster that names none, such as EPSG:32755")
    variable: str | None = optional("of the NetCDF file; found by its name if absent")
    positive: Literal["up", "down"] | None = optional(
        "direction in which values grow, where the file does not state it"
    )
    pixel_size: Positive | None = optional("m; half of the source's spacing if absent")
    water_level: Annotated[float, Field(ge=-20.0, le=20.0)] | None = optional(
        "m above the datum of the sea bed, and of charted rocks and wrecks ('enc'), the lowest of the "
        "mission; if absent that of the current's files, where they have it and it is below the datum, else 0"
    )


def _angle(limit: Any) -> Any:
    """Refuse degrees."""
    if isinstance(limit, float) and limit > 0.5 * math.pi:
        raise ValueError(
            f"must be at most a right angle, 1.571 rad, got {limit:g}: {limit:g} degrees are "
            f"{math.radians(limit):.3g} rad"
        )
    return limit


#: rad, or none.
PitchLimit = Annotated[Positive | Literal["none"], AfterValidator(_angle)]


class TransitAltitude(Section):
    """Transit that follows the terrain."""

    altitude: Positive = Field(description="m above the sea bed")


class SawToothSettings(Section):
    """Dives one after the other, as gliders and profilers go; `speed` is that along the glide slope."""

    glide_angle: Annotated[float, Field(ge=5.0, le=80.0)] = Field(description="degrees, to the horizontal")
    shallow: NotNegative = setting(3.0, "m, depth of the upper turns")
    deep: Positive = Field(description="m, depth of the lower turns")
    above_bed: Positive = setting(10.0, "m above the sea bed, at which a descent ends at the latest")
    dives: Annotated[int, Field(ge=0)] = setting(0, "between two surfacings on a leg; 0: none")
    surface_time: NotNegative = setting(0.0, "s at the surface each time")

    def _check(self) -> None:
        if self.surface_time and not self.dives:
            raise RuleError("goes with dives alone", field="surface_time", concerns=("dives",))
        self.made()

    def made(self) -> "SawTooth":
        """Return the shape of the paths."""
        from auvplan.path.saw_tooth import SawTooth  # it loads JAX

        shape: dict[str, Any] = self.model_dump() | {"glide_angle": math.radians(self.glide_angle)}
        return SawTooth(**shape)


def _named(schema: Any) -> BeforeValidator:
    """Take the name of a vehicle for settings that name it alone."""
    return BeforeValidator(lambda given: {"vehicle": given} if isinstance(given, str) else given, schema)


class VehicleSettings(Section):
    """Speed and limits, m/s and rad/s, and the depths that it may go to."""

    speed: Positive = setting(2.5, "m/s through the water")
    speed_range: tuple[Positive, Positive] | None = optional(
        "m/s through the water, least and greatest: the speed of each leg is chosen between them with the "
        "order of tasks; needs power; all legs are gone at speed if absent"
    )
    surge_max: Positive = setting(5.0, "m/s, of the ground speed along the track")
    sway_max: Positive = setting(1.5, "m/s, of the current across the track")
    turn_rate_max: Positive = setting(0.1, "rad/s, of the course over ground")
    pitch_max: PitchLimit | None = optional(
        "rad, of the hull, nose up or down; 'none' for no limit; default 0.524 (30 degrees), paper 'none'"
    )
    climb_rate_max: Positive | None = optional(
        "m/s, of the vertical speed over ground upwards; no limit if absent"
    )
    dive_rate_max: Positive | None = optional(
        "m/s, of the vertical speed over ground downwards; no limit if absent"
    )
    depth_min: NotNegative = setting(0.0, "m")
    depth_max: Positive | None = optional("m; the area's if absent")
    transit_depth: NotNegative | TransitAltitude | None = optional(
        "m, that paths keep between their ends, or 'altitude: m' above the sea bed; if absent "
        "the depths at which they are quickest"
    )
    power: Annotated[PowerSettings | None, _named(str | PowerSettings | None)] = optional(
        "what it draws, and its battery: a mapping, the name of a shipped vehicle, or path of a YAML file; "
        "energy does not count if absent"
    )
    navigation: Annotated[NavigationSettings | None, _named(str | NavigationSettings | None)] = optional(
        "how well it knows where it is: a mapping, the name of a shipped vehicle, or path of a YAML file; "
        "exactly if absent"
    )
    saw_tooth: SawToothSettings | None = optional(
        "the dives of a glider or profiler, whose speed is that along the slope; paths are level or as depth "
        "makes them quickest if absent"
    )

    @property
    def way_speed(self) -> float:
        """Speed through the water along the horizontal, surfacings included, m/s."""
        return self.saw_tooth.made().way_speed(self.speed) if self.saw_tooth else self.speed

    def _check(self) -> None:
        if self.speed_range is not None:
            least, greatest = self.speed_range
            if self.power is None:
                raise RuleError("needs the vehicle's power", field="speed_range", concerns=("power",))
            if not least < greatest:
                raise RuleError("must be the least and then the greatest speed", field="speed_range")
            if not least <= self.speed <= greatest:
                reason = f"must have vehicle.speed, {self.speed:g} m/s, between its two"
                raise RuleError(reason, field="speed_range", concerns=("speed",))


class MemberSettings(Section):
    """How the true current may differ from the forecast: promises are kept in seas drawn by it."""

    files: str | tuple[str, ...] | None = optional(
        "other forecasts of the same sea, such as older runs or other models, each a path or the pattern of "
        "one's files; of a file that holds an ensemble every member is one ('file')"
    )
    error: NotNegative = setting(0.0, "m/s, root mean square by which each component of a forecast errs")
    length: Positive = setting(5000.0, "m, over which that error is much the same")
    duration: Seconds = setting(21_600.0, "s, the same in time")


class CurrentSettings(SourcedSection):
    """The true current, and its forecast for the planner.

    Layered Lamb vortices that change at every update (Eqs 1-2), or files of an ocean model.
    """

    required: ClassVar = {"files": ("file",), "constituents": ("harmonic",)}
    allowed: ClassVar = {"truth": ("file",), "members": ("file", "harmonic")}
    effective: ClassVar = {
        **dict.fromkeys(("outside", "spacing"), ("file",)),
        **dict.fromkeys(("layers", "peak_speed", "vertical_scale", "uniform", "update_rate"), ("vortices",)),
        **dict.fromkeys(("center_std", "radius_std", "strength_std"), ("vortices",)),
    }

    source: Literal["vortices", "file", "harmonic"] = setting(
        "vortices",
        "'vortices': random Lamb vortices; 'file': an ocean model's files; 'harmonic': tidal constituents",
    )
    files: str | tuple[str, ...] | None = optional(
        "path, pattern or paths of the forecast, relative to the scenario file ('file')"
    )
    constituents: str | None = optional("path of a YAML file of tidal constituents ('harmonic')")
    truth: str | tuple[str, ...] | None = optional(
        "the same of the true current; the forecast if absent ('file')"
    )
    members: MemberSettings | None = optional(
        "how the truth may differ from the forecast, for planning.promise; vortices differ by "
        "update_interval and forecast_error"
    )
    outside: Literal["refuse", "clamp"] = setting(
        "refuse", "what is done where the files do not reach: 'clamp' holds the nearest"
    )
    spacing: Positive | None = optional("m of the local grid; the files' if absent")
    crs: int | str | None = optional("projection of the files' coordinates, such as 32633, if they name none")
    epoch: datetime | None = optional("UTC, the moment that the files' times count from, if they name none")
    vortices: Annotated[int, Field(ge=0, le=64, description="in each layer")] = 12
    layers: Annotated[int, Field(ge=1, le=10, description="of vortices, spread over the area's depths")] = 3
    radius: PositiveRange = setting((500.0, 1500.0), "m")
    peak_speed: NotNegative = setting(1.25, "m/s")
    vertical_scale: NotNegative = setting(5.0, "gamma of Eq. 1, m")
    uniform: Velocity = setting((0.0, 0.0, 0.0), "m/s north, east, down, added everywhere")
    update_interval: Seconds = setting(600.0, "s")
    update_rate: NotNegative = setting(1.0, "U_R^C of Eq. 2")
    center_std: NotNegative = setting(50.0, "m per update")
    radius_std: NotNegative = setting(20.0, "m per update")
    strength_std: NotNegative = setting(0.05, "share per update")
    forecast_error: NotNegative = setting(
        0.02,
        "relative error of the forecast; of files, that of random vortices which are "
        "added to the forecast, as a share of its largest speed (none if not given)",
    )

    @model_validator(mode="before")
    @classmethod
    def _files_are_taken_as_forecast(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("source") in ("file", "harmonic"):
            return {"forecast_error": 0.0} | given
        return given

    def _check(self) -> None:
        super()._check()
        for name in ("files", "truth"):
            if getattr(self, name) == ():
                raise RuleError("names no file", field=name)
        if self.members is not None and self.members.files is not None:
            if self.members.files == ():
                raise RuleError("names no file", field="members.files")
            if self.source != "file":
                raise RuleError("goes with source 'file' alone", field="members.files", concerns=("source",))


class ObstacleSettings(Section):
    """Obstacles that are known before the mission: plans keep clear of them and vehicle files fence them."""

    file: str | None = optional(
        "path of GeoJSON points with radius, and depth_min, depth_max, course and speed where they have them"
    )


class SafetySettings(Section):
    """What every path keeps, and how a vehicle's mission ends."""

    coast: NotNegative = setting(10.0, "m, least distance of paths to the coast")
    obstacles: NotNegative = setting(5.0, "m, least distance of paths to the boundaries of obstacles")
    seabed: NotNegative = setting(5.0, "m, least height of paths above the sea bed")
    confidence: NotNegative = setting(
        2.0,
        "standard deviations of the vehicle's position, by which paths keep the farther off coast and "
        "obstacles; without effect where vehicle.navigation is absent",
    )
    closing: NotNegative = setting(
        60.0, "s, how long before an area closes, and after it opens, no path is in it"
    )
    end: Literal["surface", "station", "loiter"] = setting(
        "surface", "at the destination: surface there, or keep station or loiter at its depth until told"
    )


class SimulatedObstacles(Section):
    """Obstacles that only the simulator knows, drawn again between the two waypoints of each leg."""

    static: Annotated[int, Field(ge=0, le=50, description="that stay where they are, on each leg")] = 2
    afloat: Annotated[int, Field(ge=0, le=50, description="that the current carries")] = 2
    self_motivated: Annotated[int, Field(ge=0, le=50, description="that move by themselves as well")] = 2
    radius: PositiveRange = setting((20.0, 60.0), "m")
    speed: NotNegative = setting(0.3, "m/s, own speed of self-motivated ones")

    @property
    def total(self) -> int:
        """Number of obstacles on each leg."""
        return self.static + self.afloat + self.self_motivated


class SimulationSettings(Section):
    """What a simulated mission meets and no plan knows of."""

    obstacles: SimulatedObstacles = SimulatedObstacles()
    draw: Positive = setting(1.0, "what the vehicle draws in truth, in shares of what its power model says")


class SensorSettings(Section):
    """What the vehicle knows of obstacles, before and within sensor range."""

    range: NotNegative = setting(600.0, "m")
    interval: Seconds = setting(30.0, "s between looks")
    prior_std: NotNegative = setting(10.0, "m, position and radius, known beforehand")
    position_std: NotNegative = setting(2.0, "m, within range")
    velocity_std: NotNegative = setting(0.03, "m/s")
    growth: NotNegative = setting(0.1, "m/s, growth of the boundary since the last look")
    growth_max: NotNegative = setting(
        24.0, "m; what grows while a vehicle travels as far as its sensors reach"
    )


class MissionSettings(Section):
    """The task graph: random waypoints in the water, each linked to its nearest, or jobs from a file."""

    jobs: str | None = optional(
        "path of jobs: GeoJSON, CSV, GPX, KML or QGroundControl's .plan; waypoints, priority, "
        "duration count for none then"
    )
    waypoints: Annotated[
        int, Field(ge=2, le=1000, description="start and goal among them; 2: one leg, no task")
    ] = 40
    neighbours: Annotated[int, Field(ge=1, le=100)] | None = optional(
        "nearest ones that each waypoint is linked to; if absent 7, of up to 40 jobs all"
    )
    priority: PriorityRange = setting((1, 5), "least and greatest")
    duration: NotNegativeRange = setting((30.0, 300.0), "s")
    duration_error: Annotated[float, Field(ge=0.0, le=1.0)] = setting(
        0.0, "share by which a task takes longer or shorter than planned, one standard deviation"
    )
    time_available: Seconds = setting(14_400.0, "s")
    lines: Literal["part", "whole"] = setting(
        "part",
        "survey lines: 'part': a part of a line earns its share; 'whole': it is begun only to be "
        "surveyed from one end to the other, and left only where nothing else is possible",
    )
    line_tolerance: Positive = setting(
        10.0,
        "m off a survey line within which it is surveyed; what is passed farther off, around an "
        "obstacle, does not count",
    )
    wait: Literal["station", "loiter", "none"] = setting(
        "station",
        "what a vehicle does that comes before a task's time window: keep station, loiter, or "
        "'none', which takes no way that leads there too early",
    )
    waypoint_clearance: NotNegative = setting(
        150.0, "m, least distance to the coast of waypoints that are drawn"
    )
    start: Point | None = optional("m north, east, depth; drawn if absent")
    goal: Point | None = optional("m north, east, depth; drawn if absent")

    def _check(self) -> None:
        if self.jobs is not None and (self.start is None or self.goal is None):
            raise RuleError("must be given with jobs, as must goal", field="start", concerns=("goal", "jobs"))


#: What the presets "default" and "paper" set where the scenario is silent, by field of `PlanningSettings`.
_BY_PRESET: dict[str, tuple[Any, Any]] = {
    "objective": ("priority", "eq15"),
    "travel_times": ("sea", "distance"),
    "task_time": ("whole", "expected"),
    "departures": (24, 1),
    "visits": ("once", "edges"),
    "reserve": (60.0, 0.0),
    "return_margin": (None, 0.0),  # by default it depends on the travel times
    "guard_return": (True, False),
    "second_look": (True, False),
    "window_change": (0.01, 0.0),
    "replan": ("deviation", "late"),
    "routes_from": ("fresh", "kept"),
    "current_updates": ("interval", "window"),
}
PRESETS: dict[str, dict[str, Any]] = {
    preset: {name: pair[k] for name, pair in _BY_PRESET.items() if pair[k] is not None}
    for k, preset in enumerate(("default", "paper"))
}

#: rad, what a preset sets for `vehicle.pitch_max` where the scenario is silent; the paper has no such limit.
PITCH_LIMITS: dict[str, float | None] = {"default": math.radians(30.0), "paper": None}

#: Fields that went elsewhere, with what there is to say of it.
MOVED = {
    **{
        f"obstacles.{name}": f"simulation.obstacles.{name}: those here are known, from a file"
        for name in SimulatedObstacles.model_fields
    },
    "chart.clearance": "mission.waypoint_clearance, for waypoints that are drawn; paths keep safety.coast",
    "bathymetry.clearance": "safety.seabed",
}

#: Share by which the way back is taken to last longer where neither scenario nor preset says it.
_RETURN_MARGINS = {"sea": 0.2, "distance": 0.4, "learnt": 0.4}


def by_preset(name: str, description: str) -> Any:
    """Return a field whose default is the preset's: None, until `PlanningSettings.resolved` has that."""
    pair = _BY_PRESET[name]
    shown = (
        repr(v) if isinstance(v, str) else str(v).lower() if isinstance(v, bool) else f"{v:g}" for v in pair
    )
    default, paper = shown
    return optional(f"{description}; default {default}, paper {paper}")


class PlanningSettings(Section):
    """How the mission is planned and re-planned.

    A field that is absent here takes the preset's value, which `resolved` has.

    Differences from the paper:
        The preset "paper" keeps its rules. The default times edges in the forecast current, visits waypoints
        once, keeps time for the return, re-plans paths where the current has changed and the mission where
        its route no longer fits.
    """

    preset: Literal["default", "paper"] = setting(
        "default", "'paper': planners and re-planning rules as published"
    )
    effort: Literal["quick", "full", "plain"] = setting(
        "quick",
        "of the preset 'default': 'quick' plans paths and later routes in a fifth of the time of "
        "'full'; 'plain' is the search alone, without passages, beams, local search and gradients",
    )
    objective: Preset[Literal["priority", "eq15"]] = by_preset("objective", "of the route")
    phi: tuple[NotNegative, NotNegative] = setting(
        (1.0, 100.0), "Phi_1, per second, and Phi_2 of Eq. 15 ('eq15')"
    )
    control_points: Annotated[int, Field(ge=2, le=60)] | None = optional(
        "free control points of a path; if absent 8 to 32 by effort, paper 4"
    )
    path_width: Positive | None = optional(
        "share of a leg's length by which control points may lie off its straight line; if "
        "absent 0.75, paper 0.35"
    )
    travel_times: Preset[Literal["sea", "distance", "learnt"]] = by_preset(
        "travel_times",
        "of the edges: 'sea' in the forecast current, 'distance' d / |v| as in Eq. 13, 'learnt' as much "
        "longer as the legs so far took",
    )
    task_time: Preset[Literal["whole", "clock", "expected"]] = by_preset(
        "task_time",
        "what a task's delta_ij counts in besides t_ij: 'whole' in the time that a leg takes and is "
        "compared by; 'clock' in the time it takes, while T_path alone is compared; 'expected' in neither, "
        "as for tasks along the path, but not for jobs",
    )
    visits: Preset[Literal["once", "edges"]] = by_preset(
        "visits",
        "'once': no waypoint is visited twice in a mission (rule 3 of section 3.3), but for the only way to "
        "the destination; 'edges': passed edges alone are barred (3.3.2), each task counts once",
    )
    departures: Preset[Annotated[int, Field(ge=1, le=200)]] = by_preset(
        "departures",
        "times of departure, over the time available, at which every edge is timed where currents are "
        "forecast to change; 1 takes the sea to stay as it is",
    )
    detour: NotNegative = setting(3.5, "s that each obstacle is taken to cost a leg; with travel_times 'sea'")
    t_series: Annotated[int, Field(ge=1, le=20, description="windows of a leg")] = 4
    current_updates: Preset[Literal["interval", "window"]] = by_preset(
        "current_updates",
        "when vortices change: every current.update_interval, or at each window of a leg (T-Series)",
    )
    replan_from: Literal["kept", "fresh"] = setting(
        "kept", "population that a path is re-planned from on the way"
    )
    routes_from: Preset[Literal["kept", "fresh"]] = by_preset(
        "routes_from", "population that a route is re-planned from, 'fresh' beside the rest of the last route"
    )
    window_change: Preset[NotNegative] = by_preset(
        "window_change",
        "share by which the time left on a path must have changed for a window to re-plan it; 0 does at "
        "every window",
    )
    reserve: Preset[NotNegative] = by_preset(
        "reserve", "s of the available time that no route is planned to use"
    )
    allowance: NotNegative = setting(
        0.0,
        "share by which a mission is taken to last longer than expected when its tasks "
        "are chosen, for what no plan can know; what it leaves is used on the way ('deviation')",
    )
    promise: Annotated[float, Field(gt=0.0, lt=1.0)] | None = optional(
        "least probability that the destination is reached in time, over seas drawn by what is known of the "
        "forecast's errors: as much time and energy is kept back as that takes"
    )
    turn_back: bool = setting(
        False,
        "whether a plan has a rule by which the vehicle goes past the next task, or straight to the "
        "destination, from a stop that is left too late; the promise is then that of plan and rule together",
    )
    return_margin: Preset[NotNegative] = optional(
        "share by which the way back is taken to last longer than expected; default 0.2 with travel times "
        "of the sea, 0.4 by distance; paper 0"
    )
    guard_return: Preset[bool] = by_preset(
        "guard_return", "whether a leg is refused whose path would leave too little time for the way back"
    )
    second_look: Preset[bool] = by_preset(
        "second_look",
        "whether a path that takes much longer than expected of its leg is compared with one past obstacles "
        "whose boundaries do not grow",
    )
    replan: Preset[Literal["late", "deviation"]] = by_preset(
        "replan",
        "'late' after every leg that took longer than expected (3.3.2); 'deviation' when the rest of the "
        "route no longer fits the time that is left, or would leave much of it",
    )
    tolerance: NotNegative = setting(
        30.0, "s by which the rest of a route may overrun the reserve ('deviation')"
    )
    gain: Seconds = setting(120.0, "s left over that make a new route worth planning ('deviation')")
    charge_compute: bool = setting(False, "charge planning time to the mission clock (Eq. 16)")
    budget: Positive | None = optional(
        "s of wall-clock time that a planning call may take, compilation left out; the best plan "
        "so far is followed then, so that a seed gives other missions on other machines; no limit if absent"
    )
    saves: Literal["time", "energy"] = setting(
        "energy",
        "what decides between routes of equal priority where the vehicle has a power model: 'energy' goes as "
        "slowly as the time allows, 'time' as fast as the energy does",
    )
    lower_bounds: bool = setting(
        False,
        "say of each path how much longer than the quickest possible one it can be; takes longer "
        "than planning it",
    )

    def _check(self) -> None:
        if self.preset != "paper" and self.task_time not in (None, "whole"):
            reason = f"'{self.task_time}' goes with preset 'paper' alone"
            raise RuleError(reason, field="task_time", concerns=("preset",))

    @property
    def promises(self) -> bool:
        """Whether plans are to say how sure they are to be home in time, and to see to it."""
        return self.promise is not None or self.turn_back

    @property
    def resolved(self) -> "PlanningSettings":
        """The same with the preset's values for what is absent."""
        preset = PRESETS[self.preset].items()
        values = {name: value for name, value in preset if getattr(self, name) is None}
        if self.return_margin is None and "return_margin" not in values:
            travel_times = values.get("travel_times", self.travel_times)
            values["return_margin"] = _RETURN_MARGINS[travel_times]
        return self.model_copy(update=values)

    def late(self, t_path: Any, t_task: Any, t_expected: Any) -> Any:
        """Whether legs took longer than expected (3.3.2); of numbers or arrays, s; of `resolved` settings."""
        return t_path + (0.0 if self.task_time == "clock" else t_task) > t_expected
