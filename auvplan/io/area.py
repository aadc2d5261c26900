"""Reads the area of a scenario from its files."""

import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from auvplan.errors import AuvplanError, ScenarioError, ScenarioWarning, error_context
from auvplan.io import currents, geo
from auvplan.io.cross_checks import check_jobs, warn_of_contradictions, warn_of_idle_obstacles
from auvplan.io.land import beyond, cropped, in_folder, on_land, read_land
from auvplan.io.tides import read_tide
from auvplan.mission.jobs import Jobs, Position
from auvplan.ocean import whitsunday
from auvplan.ocean.chart import Chart
from auvplan.ocean.closures import Closure, Zone
from auvplan.ocean.currents import evaluated
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.seabed import Seabed
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.runtime.arguments import instance
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.provenance import changed_at
from auvplan.scenario.scenario import Scenario
from auvplan.site import Site

#: Fields of a scenario that name files in place of which objects can be given.
GIVEN = (
    "current.files", "current.truth", "bathymetry.file", "chart.file", "chart.uncertain", "chart.no_go",
    "chart.no_surfacing",
    "obstacles.file", "mission.jobs",
)  # fmt: skip

#: The most pieces of files that are kept, those that were read last.
_KEPT = 12

_Read = TypeVar("_Read")

_kept: dict[Any, tuple[Any, list[warnings.WarningMessage]]] = {}
#: Warnings that were shown: each is shown once, as Python does with those of one line of code.
_shown: dict[Any, int] = {}


def load_area(
    scenario: Scenario,
    folder: str | Path | None = None,
    until: float | None = None,
    given: Mapping[str, Any] | None = None,
    since: float = 0.0,
) -> OperatingArea:
    """Chart, sea bed, current files and jobs of a scenario; files are read once and kept.

    The notes are all that was assumed or warned of, in the scenario and its files: sheets, pages and the
    vehicle's files state them.

    Args:
        scenario: settings.
        folder: that relative paths in the scenario start from; that of its file if absent.
        until: s since the epoch, up to which currents are read; the mission's time available if absent.
        given: objects that are read in place of the files that the scenario names, by field: for
            "current.files" and "current.truth" an `xarray.Dataset` as the files would hold it, or several;
            for "bathymetry.file" a `Dataset` or `DataArray`; for "chart.file", "chart.uncertain",
            "chart.no_go", "obstacles.file" and "mission.jobs" features, as GeoJSON in a mapping or in
            whatever has a `__geo_interface__`, such as a GeoDataFrame in degrees.
        since: s since the epoch, from which on currents are read; closed areas and windows from 0 or before.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: one line that names file, field and reason.
        ValueError: `given` has a field that cannot be given, or that the scenario leaves out.
        TypeError: the scenario is a file's name.

    Warns:
        ScenarioWarning: implausible inputs: the files contradict each other, or lack hours or places.

    Example:
        >>> import auvplan as ap
        >>> ap.load_area(ap.load_scenario("whitsunday"), given={"current.files": None})
        Traceback (most recent call last):
            ...
        ValueError: given: the scenario has no current.files: name it, such as "in memory"
    """
    instance("scenario", scenario, Scenario, "ap.load_scenario(...)")
    files = AreaFiles(scenario, folder, until, given=given, since=since)
    with gathered_warnings() as lines:
        area = files.area()
    noted = (*scenario.warnings, *scenario.overrides, *lines, *area.notes)
    return replace(area, notes=tuple(dict.fromkeys(noted)))


def load_closures(
    scenario: Scenario,
    site: Site | None,
    folder: str | Path,
    until: float | None = None,
    since: float = 0.0,
) -> tuple[Closure, ...]:
    """Read the areas that are closed at some hours; arguments as for `load_area`.

    Raises:
        GeoError: one line that names file, feature and reason.
    """
    return AreaFiles(scenario, folder, until, site=site, since=since).closures


@contextmanager
def gathered_warnings(show: bool = True) -> Iterator[list[str]]:
    """Gather the lines of what is warned of within.

    Args:
        show: whether the warnings are shown afterwards; those of other kinds always are.
    """
    lines: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ScenarioWarning)
        yield lines
    own = [issubclass(one.category, ScenarioWarning) for one in caught]
    lines += [" ".join(str(one.message).split()) for one, its in zip(caught, own, strict=True) if its]
    _warn_again([one for one, its in zip(caught, own, strict=True) if show or not its])


def _warn_again(caught: list[warnings.WarningMessage]) -> None:
    for one in caught:
        warnings.warn_explicit(one.message, one.category, one.filename, one.lineno, registry=_shown)


class UnreadError(AuvplanError):
    """A part of an area that was not to be read."""


class _Part(Generic[_Read]):
    """A part of an area that is read when it is first asked for; what it gives is kept, an error as well."""

    def __init__(self, read: Callable[[Any], _Read]) -> None:
        self.read, self.name = read, read.__name__
        self.__doc__ = read.__doc__

    def __get__(self, files: "AreaFiles", owner: Any = None) -> _Read:
        if self.name not in files.outcomes:
            try:
                files.outcomes[self.name] = self.read(files)
            except AuvplanError as error:
                files.outcomes[self.name] = error
        if isinstance(found := files.outcomes[self.name], AuvplanError):
            raise found
        return found


class AreaFiles:
    """The files of a scenario, part by part.

    A part that cannot be read raises its error whenever it is asked for. Parts that another one improves, as
    the coast does a current, do without it where it cannot be read; those made of it raise its error.
    """

    #: The parts in the order in which they are read; of each the section of the scenario that it belongs to,
    #: and the fields of that which name its files.
    PARTS: ClassVar[dict[str, tuple[str, ...]]] = {
        "charted": ("chart", "image", "file"),
        "land": ("chart", "image", "file"),
        "current": ("current", "files"),
        "truth": ("current", "truth"),
        "members": ("current", "members.files"),
        "no_go": ("chart", "no_go"),
        "chart": ("chart",),
        "seabed": ("bathymetry", "file"),
        "contradictions": ("chart",),
        "tide": ("current", "constituents"),
        "jobs": ("mission", "jobs"),
        "obstacles": ("obstacles", "file"),
        "closures": ("chart",),
        "no_surfacing": ("chart", "no_surfacing"),
    }

    def __init__(
        self,
        scenario: Scenario,
        folder: str | Path | None = None,
        until: float | None = None,
        *,
        site: Site | None = None,
        unread: Collection[str] = (),
        given: Mapping[str, Any] | None = None,
        since: float = 0.0,
    ) -> None:
        """Read nothing yet.

        Args:
            scenario, folder, until, given, since: as for `load_area`.
            site: where and when local coordinates begin; as the scenario has it if absent.
        """
        self.scenario, self.home = scenario, scenario.folder if folder is None else str(folder)
        self.until, self.since = scenario.mission.time_available if until is None else until, since
        #: From when on closed areas and windows are read.
        self.first = min(since, 0.0)
        self.given = dict(given or {})
        for field in self.given:
            if field not in GIVEN:
                raise ValueError(f"given: {field!r} cannot be given: {', '.join(GIVEN)} can be")
            section, name = field.split(".")
            if getattr(getattr(scenario, section), name) is None:
                raise ValueError(f'given: the scenario has no {field}: name it, such as "in memory"')
        self.outcomes: dict[str, Any] = {part: UnreadError(part) for part in unread}
        self._stated = _site(scenario) if site is None else site
        self._place = self._stated and replace(self._stated, epoch=None)  # charts do not depend on the epoch
        self._box = scenario.box

    def area(self) -> OperatingArea:
        """Return all of it; raises and warns as `load_area`."""
        for part in self.PARTS:
            getattr(self, part)
        area = self.readable_area
        if self.scenario.chart.no_go is None:
            return area
        return replace(area, chart=self._closed_on(self.land.chart))

    @property
    def readable_area(self) -> OperatingArea:
        """What can be read, in one; closed areas are no coast on its chart."""
        land = self.readable("land") or geo.Land()
        return OperatingArea(
            self.readable("chart"),
            (self.readable("seabed") or (None,))[0],
            self.site,
            self.readable("forecast"),
            self.readable("true_current"),
            self.readable("jobs"),
            (*land.hazards, *(self.readable("obstacles") or ())),
            self.readable("closures") or (),
            self.notes,
            land.coast,
            (*land.closed, *(zone for zone in self.readable("no_go") or () if not zone.hours)),
            tuple(member.field for member in self.readable("members") or ()),
            self.readable("no_surfacing") or (),
            (self.first, self.until),
        )

    def readable(self, part: str) -> Any:
        """Return a part, or None where it cannot be read."""
        try:
            return getattr(self, part)
        except AuvplanError:
            return None

    @property
    def notes(self) -> tuple[str, ...]:
        """What is not known, and what was assumed of the files that can be read, a line each."""
        found = [self.readable(part) for part in ("current", "truth", "jobs", "land")]
        notes = [note for part in found if part is not None for note in part.notes]
        _, of_seabed = self.readable("seabed") or (None, ())
        chart, lacking = self.scenario.chart, []
        if self.scenario.site is not None and chart.source == "none":
            lacking.append("no coast is known: chart.source is 'none', which is open water")
        elif self.scenario.site is not None and chart.accuracy > 0.0:
            lacking.append(f"the coast is good to {chart.accuracy:,.0f} m at best: no chart for navigation")
        if self.scenario.site is not None and self.scenario.bathymetry.source == "none":
            what = "no sea bed is known, bathymetry.source is 'none'"
            lacking.append(f"{what}: nothing keeps the vehicle off the bottom")
        return tuple(dict.fromkeys((*lacking, *notes, *of_seabed)))

    @property
    def site(self) -> Site | None:
        """Where and when: without a departure the epoch is the first time of the current's files."""
        current = self.readable("current")
        stated = self._stated
        return stated if stated is None or current is None else replace(stated, epoch=current.epoch)

    @property
    def forecast(self) -> GriddedCurrent | HarmonicCurrent | None:
        """The current as planners know it."""
        return self.tide if self.current is None else self.current.field

    @property
    def true_current(self) -> GriddedCurrent | HarmonicCurrent | None:
        """The current that vehicles meet; None for vortices."""
        return self.tide if self.truth is None else self.truth.field

    @property
    def dry_land(self) -> Chart | None:
        """The chart of the area without closed areas and water; None where it cannot be read."""
        land = self.readable("land") or geo.Land()
        if land.land is not None or land.chart is None:
            return land.land
        return cropped(land.chart, self.scenario.chart, self._box)

    @_Part
    def charted(self) -> geo.Land:
        """What the chart's file has, with the water level that the scenario states."""
        return self._land_at(self.scenario.bathymetry.water_level or 0.0)

    @_Part
    def land(self) -> geo.Land:
        """What the chart's file has of the area and around it, rocks and wrecks as deep as at low water."""
        charted, low = self.charted, 0.0
        if self.scenario.chart.source == "enc" and self.scenario.bathymetry.water_level is None:
            low, _ = self._low_water()
        return self._land_at(low) if low else charted

    def _land_at(self, low_water: float) -> geo.Land:
        """Read the chart's file; m above its datum."""
        settings = self.scenario.chart.model_copy(update={"no_go": None, "no_go_windows": None})
        current = self.current if settings.source == "current" else None
        key, files = (settings, self._place, self._box, current), self._chart_files
        read = partial(read_land, *key, *files, low_water)
        return self._once(read, files, "land", self.home, low_water, *key)

    @_Part
    def chart(self) -> Chart | None:
        """The chart of the area, without the closed areas of a file of their own."""
        wide, area = self.land.chart, self.scenario.area
        if wide is None:
            return None
        chart = cropped(wide, self.scenario.chart, self._box)
        low, high = np.asarray(chart.lower), np.asarray(chart.upper)
        asked = (np.asarray(corner[:2]) for corner in (area.lower, area.upper))
        if any(((corner < low - 1e-3) | (corner > high + 1e-3)).any() for corner in asked):
            raise ScenarioError(
                f"{area.lower[:2]} to {area.upper[:2]} m reaches beyond the chart, which covers "
                f"{tuple(float(v) for v in low)} to {tuple(float(v) for v in high)} m",
                field="area",
            )
        return chart

    @_Part
    def no_go(self) -> tuple[Zone, ...]:
        """Closed areas of a file of their own; those without hours have the common ones, if there are any."""
        zones, windows = self._zones("no_go"), self.scenario.chart.no_go_windows
        if windows is None:
            return zones
        common = {"where": "chart.no_go_windows", "hours": {"windows": windows}}
        return tuple(zone if zone.hours else replace(zone, **common) for zone in zones)

    @_Part
    def no_surfacing(self) -> tuple[Zone, ...]:
        """Areas in which no vehicle surfaces for a fix."""
        return self._zones("no_surfacing")

    @_Part
    def closures(self) -> tuple[Closure, ...]:
        """Areas that are closed at some hours."""
        if not self.no_go:
            return ()
        assert self.site is not None
        extent, margin = self._extent(self.scenario.chart.pixel_size), self.scenario.safety.closing
        with error_context("chart", "no_go"):
            hours = {"until": self.until, "since": self.first}
            return geo.closures_of(self.no_go, self.site, extent, margin=margin, **hours)

    @_Part
    def current(self) -> "currents.CurrentFile | None":
        """The forecast of an ocean model."""
        if self.scenario.current.source != "file" or self.scenario.current.files is None:
            return None
        return self._current_of("files", self._on_earth)

    @_Part
    def truth(self) -> "currents.CurrentFile | None":
        """The true current by an ocean model."""
        if self.scenario.current.truth is None:
            return self.current
        assert self.site is not None
        return self._current_of("truth", self.site)

    @_Part
    def members(self) -> "tuple[currents.CurrentFile, ...]":
        """Other forecasts of the current."""
        settings = self.scenario.current.members
        if settings is None or settings.files is None:
            return ()
        assert self.site is not None
        names = (settings.files,) if isinstance(settings.files, str) else settings.files
        with error_context("current", "members.files"):
            sources = [one for name in names for one in currents.open_members(in_folder(self.home, name))]
        return tuple(self._current_of("members.files", self.site, [source]) for source in sources)

    @_Part
    def tide(self) -> HarmonicCurrent | None:
        """The current of tidal constituents, which is the true one and its forecast."""
        constituents = self.scenario.current.constituents
        if constituents is None:
            return None
        with error_context("current", "constituents"):
            return read_tide(in_folder(self.home, constituents), self._on_earth, self.until, self.first)

    @_Part
    def jobs(self) -> Jobs | None:
        """Jobs of a file."""
        if self.scenario.mission.jobs is None:
            return None
        forecast = self.readable("forecast")

        def speed(place: Position, times: np.ndarray) -> np.ndarray:
            return np.hypot(*evaluated(forecast, *place, times)[:2])

        with error_context("mission", "jobs"):
            jobs = geo.read_jobs(
                self._source("mission.jobs"),
                self.site,
                default_depth=self._box[0][2],
                until=self.until,
                since=self.first,
                speed=None if forecast is None else speed,
            )
            check_jobs(jobs, self.site, self.scenario)
        return jobs

    @_Part
    def obstacles(self) -> tuple[KnownObstacle, ...]:
        """Known obstacles of a file."""
        if self.scenario.obstacles.file is None:
            return ()
        with error_context("obstacles", "file"):
            named = geo.read_obstacles(self._source("obstacles.file"), self._on_earth)
            warn_of_idle_obstacles(named, self.scenario, self.dry_land)
        return named

    @_Part
    def seabed(self) -> tuple[Seabed | None, tuple[str, ...]]:
        """The sea bed, and what was assumed of its file, a line each."""
        settings = self.scenario.bathymetry
        if settings.source == "none":
            return None, ()
        low, notes = self._low_water()
        if settings.source == "file":
            given = settings.model_dump(include={"variable", "positive", "crs"})
            with error_context("bathymetry", "file"):
                path = self._source("bathymetry.file")
                found = geo.read_bathymetry(path, self._on_earth, self._extent(settings.pixel_size), **given)
                if not (found.depth > 0.0).any():
                    raise ScenarioError(
                        f"{settings.file}: no pixel of the area lies below the sea surface: say by "
                        "bathymetry.positive which way its values count"
                    )
            depth, size, corner = found.depth, found.pixel_size, found.origin
            notes = *(f"{settings.file}: {note}" for note in found.notes), *notes
        elif settings.source == "chart":
            land, depth = self.land.land, self.land.depth
            assert land is not None
            assert depth is not None
            size, corner = float(land.pixel_size), land.lower
        else:
            current = self.current
            assert current is not None
            if current.sea_floor is None:
                raise ScenarioError(
                    "'current': the current's files do not give the depth", field="bathymetry.source"
                )
            with error_context("bathymetry", "pixel_size"):
                grid = self._extent(settings.pixel_size or min(current.spacing) / 2.0).grid()
            centres = [axis.ravel() for axis in grid.degrees(current.site)]
            depth = current.source.sea_floor(*centres)
            assert depth is not None
            depth, size, corner = depth.reshape(grid.shape), grid.pixel_size, grid.lower
            longitude, latitude, least = current.source.soundings(*centres)
            among = grid.indices(*current.site.to_local(longitude, latitude))
            depth = depth - geo.fall(depth, *among, least)
        clearance = self.scenario.safety.seabed
        return Seabed.from_depth(depth + low, size, np.asarray(corner), clearance=clearance), notes

    @_Part
    def contradictions(self) -> None:
        """Warn where chart, sea bed and current have land in other places than each other."""
        files = [self.readable("current"), self.readable("truth")]
        seabed, _ = self.readable("seabed") or (None, ())
        if self.readable("land") is not None:
            warn_of_contradictions(self.scenario, self.dry_land, seabed, files)

    def _zones(self, field: str) -> tuple[Zone, ...]:
        """Return the areas of the file that a field of the chart names, if it names one."""
        if getattr(self.scenario.chart, field) is None:
            return ()
        with error_context("chart", field):
            return tuple(geo.read_zones(self._source(f"chart.{field}"), self._on_earth, self._extent()))

    def _extent(self, pixel_size: float | None = None) -> geo.Extent:
        """Return the area with pixels of a size, m."""
        return geo.Extent(self._box[0][:2], self._box[1][:2], pixel_size)

    @property
    def _on_earth(self) -> Site:
        """The site, which scenarios with files of places have."""
        assert self._stated is not None
        return self._stated

    def _once(self, read: Callable[[], _Read], files: Sequence[Any], *key: Any) -> _Read:
        """Return what a reader gives, and warn again of what it warned of.

        It is kept by its key as long as files stay as they are; where objects are given, nothing is.
        """
        if self.given or not all(isinstance(file, str | Path | None) for file in files):
            return read()
        key += tuple(changed_at(Path(file)) for file in files if file is not None)
        if key not in _kept:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", ScenarioWarning)
                found = read()
            while len(_kept) >= _KEPT:
                del _kept[next(iter(_kept))]
            _kept[key] = found, caught
        found, caught = _kept[key] = _kept.pop(key)  # the last to be forgotten
        _warn_again(caught)
        return found

    def _source(self, field: str) -> Any:
        """Return the path of the file that a field names, or what is given in its place; else None."""
        section, name = field.split(".")
        file = getattr(getattr(self.scenario, section), name)
        return self.given.get(field, file and in_folder(self.home, file))

    @property
    def _chart_files(self) -> tuple[Any, Any]:
        """The chart, and areas whose coast is uncertain; None where there are none."""
        settings = self.scenario.chart
        picture = settings.image and in_folder(self.home, settings.image)
        return self._source("chart.file") or picture, self._source("chart.uncertain")

    def _current_of(self, field: str, site: Site, sources: Sequence[Any] = ()) -> "currents.CurrentFile":
        """Read the files of a current that a field names, or such sources, on the box, clear of the coast."""
        settings, box, chart = self.scenario.current, self._box, self.scenario.chart
        land = "mesh"
        if chart.source != "current":
            own = self.readable("charted")
            land = None if own is None or own.chart is None else on_land(own.chart)
            chart = None if own is None else chart.model_copy(update={"no_go": None, "no_go_windows": None})
        if sources:
            paths = list(sources)
        else:
            files = getattr(settings, field)
            paths = [in_folder(self.home, name) for name in ((files,) if isinstance(files, str) else files)]
        source = self.given.get(f"current.{field}", paths if len(paths) != 1 else paths[0])
        how: dict[str, Any] = settings.model_dump(include={"spacing", "outside", "crs"})
        how |= {"data_epoch": settings.epoch, "lower": box[0], "upper": box[1]}
        # Data that states the epoch begins with it.
        lasts = self.until if self.until > 0.0 else self.scenario.mission.time_available
        how["times"] = site.epoch and ((self.since, self.until) if self._on_earth.epoch else (0.0, lasts))
        key = "current", tuple(paths), site, tuple(how.values()), chart

        def read() -> "currents.CurrentFile":
            return currents.read_current(source, site, land=land, **how)

        with error_context("current", field):
            found = self._once(read, [*paths, *self._chart_files], *key)
        if site.epoch is None:  # the data's first time is it: now it can be seen whether the data lasts
            return self._current_of(field, replace(site, epoch=found.epoch))
        return found

    @_Part
    def closed_water(self) -> Chart | None:
        """Areas of `no_go` that are always closed, alone on a chart; None where the scenario names none."""
        return None if self.scenario.chart.no_go is None else self._closed_on(None)

    def _closed_on(self, wide: Chart | None) -> Chart:
        """Return a chart of the area on which areas that are always closed are coast, beside that of another.

        Args:
            wide: the other chart, which reaches as far beyond the area; None for open water.
        """
        settings, box = self.scenario.chart, self._box
        always, size = [zone for zone in self.no_go if not zone.hours], settings.pixel_size
        extent = self._extent(size)._replace(beyond=beyond(box, size))

        def burnt() -> Chart:
            with error_context("chart", "no_go"):
                closed = geo.with_no_go(wide, always, extent)
            return cropped(closed, settings, box)

        current = self.readable("current") if settings.source == "current" else None
        key = settings, self._place, box, self.home, current, wide is None
        return self._once(burnt, [self._source("chart.no_go")], "closed", *key)

    def _low_water(self) -> tuple[float, tuple[str, ...]]:
        """Return the surface at its lowest, m above the sea bed's datum, and what is to be noted of it.

        Depths of a vehicle count from the moving surface, those of the bed and of rocks from their datum.
        """
        if (level := self.scenario.bathymetry.water_level) is not None:
            return level, ()
        current = self.readable("current")
        stated = None if current is None else current.low_water
        if stated is None or not np.isfinite(stated).any():
            return 0.0, (
                "the sea bed is taken at its datum: at low water there is less above it, which "
                "bathymetry.water_level would count",
            )
        lowest = min(float(np.nanmin(stated)), 0.0)
        if lowest == 0.0:
            return 0.0, ()
        low = f"{-lowest:.2f} m below their datum"
        return lowest, (f"the sea bed counts from the lowest water of the current's files, {low}",)


def _site(scenario: Scenario) -> Site | None:
    """Return the scenario's site, or that of the shipped chart."""
    if scenario.site is not None:
        return scenario.site.site
    if scenario.chart.source != "whitsunday":
        return None
    row, column, rows, _ = scenario.chart.window or (0, 0, whitsunday.PIXELS, whitsunday.PIXELS)
    size, half = whitsunday.EXTENT / whitsunday.PIXELS, whitsunday.EXTENT / 2.0
    south = (whitsunday.PIXELS - row - rows) * size
    return Site(*whitsunday.CENTRE, origin=(half - south, half - column * size))
