"""Reads the area of a scenario from its files."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np

from auvplan.errors import ScenarioError, ScenarioWarning, blaming
from auvplan.io import currents, geo
from auvplan.io.agreement import check_jobs, check_obstacles, warn_of_contradictions
from auvplan.io.tides import read_tide
from auvplan.mission.jobs import Jobs, Position
from auvplan.ocean import whitsunday
from auvplan.ocean.chart import Chart, classify_file, settled
from auvplan.ocean.closures import Closure
from auvplan.ocean.currents import Current, evaluated
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.ocean.seabed import Seabed
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.settings import BathymetrySettings, ChartSettings
from auvplan.site import Site

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
#: m, farthest and least that land is read beyond the area, and pixels of it from which on less is read.
_LOOK, _NEAR, _WIDE_PIXELS = 5000.0, 500.0, 4_000_000
#: Pixels of a raster made from a current's file at most.
_MAX_PIXELS = 16_000_000

if TYPE_CHECKING:
    from auvplan.io.currents import CurrentFile

Corners = tuple[tuple[float, float, float], tuple[float, float, float]]


#: Warnings that were shown: each is shown once, as Python does with those of one line of code.
_shown: dict[Any, int] = {}


def _kept(read: Callable[..., Any]) -> Callable[..., Any]:
    """`lru_cache` of the last few answers that also warns again of what was warned of."""

    @lru_cache(maxsize=4)
    def heard(*given: Any) -> tuple[Any, list[warnings.WarningMessage]]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", ScenarioWarning)
            found = read(*given)
        return found, caught

    @wraps(read)
    def again(*given: Any) -> Any:
        found, caught = heard(*given)
        for one in caught:
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno, registry=_shown)
        return found

    return again


def load_jobs(
    scenario: Scenario,
    site: Site | None,
    folder: str | Path,
    until: float | None = None,
    current: Current | None = None,
) -> Jobs | None:
    """Read the scenario's file of jobs, if there is one.

    Args:
        scenario, folder, until: as for `load_area`.
        site: where and when local coordinates begin.
        current: as it is forecast, for windows of slack water; None where it is not.

    Raises:
        GeoError: one line that names file, row or feature and reason.
    """
    if scenario.mission.jobs is None:
        return None
    path, depth = _path(str(folder), scenario.mission.jobs), scenario.box[0][2]

    def speed(place: Position, times: np.ndarray) -> np.ndarray:
        assert current is not None
        return np.hypot(*evaluated(current, *place, times)[:2])

    with blaming("mission", "jobs"):
        return geo.read_jobs(
            path,
            site,
            default_depth=depth,
            until=_end(scenario, until),
            speed=None if current is None else speed,
        )


def load_closures(
    scenario: Scenario, site: Site | None, folder: str | Path, until: float | None = None
) -> tuple[Closure, ...]:
    """Read the areas that are closed at some hours; arguments as for `load_area`.

    Raises:
        GeoError: one line that names file, feature and reason.
    """
    settings = scenario.chart
    if settings.no_go is None:
        return ()
    assert site is not None
    lower, upper = scenario.box
    with blaming("chart", "no_go"):
        zones = _zones(settings, site, str(folder))
    return geo.closures_of(
        zones,
        site,
        lower=lower[:2],
        upper=upper[:2],
        pixel_size=settings.pixel_size,
        margin=scenario.safety.closing,
        until=_end(scenario, until),
    )


def charted_zones(scenario: Scenario, folder: str | Path) -> tuple[geo.Zone, ...]:
    """Return the areas that S-57 cells close; none where the chart is of another kind.

    Args:
        scenario, folder: as for `load_area`.

    Raises:
        ChartError: one line that names file and reason.
    """
    if scenario.chart.source != "enc":
        return ()
    return _cells(scenario.chart, _timeless(_site(scenario)), scenario.box, str(folder)).closed


def _zones(settings: ChartSettings, site: Site, home: str, **area: Any) -> list[geo.Zone]:
    """Return the closed areas of a chart; those that tell no hours have its common ones, if there are any.

    Args:
        settings: with a file of closed areas.
        site, area: as for `read_zones`.
        home: folder that relative paths start from.
    """
    assert settings.no_go is not None
    zones = geo.read_zones(_path(home, settings.no_go), site, **area)
    if settings.no_go_windows is None:
        return zones
    common = {"windows": settings.no_go_windows}
    return [
        zone if zone.hours else replace(zone, where="chart.no_go_windows", hours=common) for zone in zones
    ]


def _end(scenario: Scenario, until: float | None) -> float:
    """Return `until`, or the end of the mission's time where it is absent, s since the epoch."""
    return scenario.mission.time_available if until is None else until


def load_area(
    scenario: Scenario, folder: str | Path | None = None, until: float | None = None
) -> OperatingArea:
    """`read_area` whose notes are all that was assumed or warned of, in the scenario and its files.

    Sheets, pages and the vehicle's files state them.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ScenarioWarning)
        area = read_area(scenario, folder, until)
    heard = []
    for one in caught:
        if issubclass(one.category, ScenarioWarning):
            heard.append(" ".join(str(one.message).split()))
        warnings.warn_explicit(one.message, one.category, one.filename, one.lineno, registry=_shown)
    noted = (*scenario.doubts, *scenario.overrides, *heard, *_lacking(scenario), *area.notes)
    return replace(area, notes=tuple(dict.fromkeys(noted)))


def _lacking(scenario: Scenario) -> Iterator[str]:
    """Yield what is not known of a place on Earth and missions are planned without."""
    if scenario.site is None:
        return
    if scenario.chart.source == "none":
        yield "no coast is known: chart.source is 'none', which is open water"
    elif scenario.chart.accuracy > 0.0:
        yield f"the coast is good to {scenario.chart.accuracy:,.0f} m at best: no chart for navigation"
    if scenario.bathymetry.source == "none":
        yield "no sea bed is known, bathymetry.source is 'none': nothing keeps the vehicle off the bottom"


def read_area(
    scenario: Scenario, folder: str | Path | None = None, until: float | None = None
) -> OperatingArea:
    """Chart, sea bed, current files and jobs of a scenario; files are read once and kept.

    Args:
        scenario: settings.
        folder: that relative paths in the scenario start from; that of its file if absent.
        until: s since the epoch, up to which currents are read; the mission's time available if absent.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: one line that names file, field and reason.

    Warns:
        ScenarioWarning: what can hardly be meant: the files contradict each other, or lack hours or places.
    """
    home, box = scenario.folder if folder is None else str(folder), scenario.box
    site, forecast_file, truth_file = _currents(scenario, home, until)
    charts = _charts(scenario.chart, _timeless(site), box, forecast_file, home)  # type: ignore[arg-type] - frozen models hash
    coast, plain, chart, seen = charts
    _require_area_on_chart(scenario, chart)
    seabed, found = _seabed(scenario, site, box, forecast_file, home)
    cells = _cells(scenario.chart, _timeless(site), box, home) if scenario.chart.source == "enc" else None
    land = plain if cells is None else cells.land  # closed water is no land
    warn_of_contradictions(scenario, land, seabed, forecast_file)
    forecast, truth = forecast_file and forecast_file.field, truth_file and truth_file.field
    if scenario.current.source == "harmonic":
        forecast = truth = _tide(scenario, site, home, until)
    jobs = load_jobs(scenario, site, home, until, forecast)
    if jobs is not None:
        with blaming("mission", "jobs"):
            check_jobs(jobs, site, scenario)
    obstacles = () if cells is None else cells.hazards
    if scenario.obstacles.file is not None:
        assert site is not None
        with blaming("obstacles", "file"):
            named = geo.read_obstacles(_path(home, scenario.obstacles.file), site)
            check_obstacles(named, scenario, land)
            obstacles = (*obstacles, *named)
    notes = [note for file in (forecast_file, truth_file) if file is not None for note in file.notes]
    notes += () if jobs is None else jobs.notes
    return OperatingArea(
        chart,
        seabed,
        site,
        forecast,
        truth,
        jobs,
        obstacles,
        load_closures(scenario, site, home, until),
        tuple(dict.fromkeys((*notes, *seen, *found))),
        coast,
        _always_closed(scenario, site, cells, home),
    )


def _always_closed(
    scenario: Scenario, site: Site | None, cells: geo.Cells | None, home: str
) -> tuple[geo.Zone, ...]:
    """Return the areas that are closed at all times."""
    charted = () if cells is None else cells.closed
    if scenario.chart.no_go is None:
        return charted
    assert site is not None
    return (*charted, *(zone for zone in _zones(scenario.chart, site, home) if not zone.hours))


def _tide(scenario: Scenario, site: Site | None, home: str, until: float | None) -> HarmonicCurrent:
    """Return the current of tidal constituents."""
    assert site is not None
    assert scenario.current.constituents is not None
    with blaming("current", "constituents"):
        return read_tide(_path(home, scenario.current.constituents), site, _end(scenario, until))


def load_truth(scenario: Scenario, folder: str | Path = ".") -> GriddedCurrent | HarmonicCurrent | None:
    """Return the true current of a scenario's files, nothing else of its area.

    None for vortices.
    """
    if scenario.current.source == "harmonic":
        return _tide(scenario, _site(scenario), str(folder), None)
    truth = _currents(scenario, str(folder), None)[2]
    return truth and truth.field


def _currents(
    scenario: Scenario, home: str, until: float | None
) -> "tuple[Site | None, CurrentFile | None, CurrentFile | None]":
    """The site, whose epoch the files may tell, and the currents of forecast and truth."""
    site, settings = _site(scenario), scenario.current
    if settings.source != "file":
        return site, None, None
    assert site is not None
    assert settings.files is not None
    window = (0.0, _end(scenario, until))
    reach = _Reach(settings.spacing, settings.outside, settings.crs, settings.epoch, scenario.chart)
    with blaming("current", "files"):
        forecast = _current(reach, settings.files, site, scenario.box, window, home)  # type: ignore[arg-type] - frozen models hash
    site = replace(site, epoch=forecast.epoch)
    if settings.truth is None:
        return site, forecast, forecast
    with blaming("current", "truth"):
        truth = _current(reach, settings.truth, site, scenario.box, window, home)  # type: ignore[arg-type] - frozen models hash
    return site, forecast, truth


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


def _path(home: str, name: str) -> str:
    """Return a path relative to the scenario's folder; patterns and absolute paths are taken as they are."""
    return str(Path(home) / Path(name).expanduser())


def _timeless(site: Site | None) -> Site | None:
    """Return a site without its epoch, which charts do not depend on."""
    return site and replace(site, epoch=None)


@dataclass(frozen=True)
class _Reach:
    """What the reading of a current's files depends on, beside site and box.

    Attributes:
        spacing, outside, crs, epoch: of the current's settings.
        chart: which tells where no current is needed.
    """

    spacing: float | None
    outside: str
    crs: int | str | None
    epoch: datetime | None
    chart: ChartSettings


def _land(settings: ChartSettings, site: Site, box: Corners, home: str) -> Any:
    """Return where a chart tells land, as `read_current` takes it."""
    if settings.source == "current":
        return "mesh"
    _, chart, _ = _plain_chart(settings, _timeless(site), box, None, home)
    if chart is None:
        return None
    low, high = (np.asarray(corner, float) for corner in (chart.lower, chart.upper))

    def land(north: np.ndarray, east: np.ndarray) -> np.ndarray:
        # Rounding may put the nodes on the chart's edge beyond it.
        return ~chart.is_water(np.clip(north, low[0], high[0]), np.clip(east, low[1], high[1]))

    return land


@_kept
def _current(
    reach: _Reach,
    files: str | tuple[str, ...],
    site: Site,
    box: Corners,
    window: tuple[float, float],
    home: str,
) -> "CurrentFile":
    names = (files,) if isinstance(files, str) else files
    paths = [_path(home, name) for name in names]
    times = None if site.epoch is None else window
    found = currents.read_current(
        paths if len(paths) != 1 else paths[0],
        site,
        lower=box[0],
        upper=box[1],
        times=times,
        spacing=reach.spacing,
        outside=reach.outside,
        land=_land(reach.chart, site, box, home),
        crs=reach.crs,
        data_epoch=reach.epoch,
    )
    if times is None:  # the data's first time is the epoch: now it can be seen whether the data lasts
        dated = replace(site, epoch=found.epoch)
        return _current(reach, files, dated, box, window, home)
    return found


def _plain_chart(
    settings: ChartSettings,
    site: Site | None,
    box: Corners,
    current: "CurrentFile | None",
    home: str,
) -> tuple[Chart | None, Chart | None, tuple[str, ...]]:
    """Return the coast, the chart without the closed areas of its own file, and what was assumed.

    Both reach beyond the area, as far as their file and `_beyond` do.
    """
    plain = settings.model_copy(update={"no_go": None, "no_go_windows": None})
    return _read_chart(plain, site, box, current, home)


@_kept
def _read_chart(
    settings: ChartSettings,
    site: Site | None,
    box: Corners,
    current: "CurrentFile | None",
    home: str,
) -> tuple[Chart | None, Chart | None, tuple[str, ...]]:
    """`_plain_chart` of settings that name no closed areas."""
    lower, upper = box[0][:2], box[1][:2]
    coast: Chart | None = None
    notes: tuple[str, ...] = ()
    size = settings.pixel_size
    if settings.source in ("whitsunday", "image", "none"):
        with blaming("chart", "image"):
            coast, chart, notes = _picture_chart(settings, home)  # type: ignore[arg-type] - frozen models hash
        if settings.source == "image":
            notes += _other_size(settings, home)
    elif settings.source == "enc":
        cells = _cells(settings, site, box, home)
        coast, chart, notes = cells.coast, cells.chart, cells.notes
    elif settings.source == "current":
        assert current is not None
        chart = _water_chart(current, box, size)
    else:
        assert site is not None
        assert settings.file is not None
        place = {"lower": lower, "upper": upper, "pixel_size": size, "beyond": _beyond(box, size)}
        file = _path(home, settings.file)
        uncertain = None if settings.uncertain is None else _path(home, settings.uncertain)
        with blaming("chart", "file"):
            if settings.source == "raster":
                chart, notes = geo.chart_and_notes(
                    file, site, crs=settings.crs, colours=settings.colours.given, **place
                )
            else:
                chart = geo.chart_from_polygons(
                    file, site, fringe=settings.fringe, uncertain=uncertain, **place
                )
    if settings.source in ("raster", "image") and chart is not None:
        _warn_of_one_kind(settings, _cropped(chart, settings, box))
    return coast or chart, chart, notes


def _beyond(box: Corners, size: float) -> float:
    """Return how far beyond the area land is read, m: as far as a distance to it is stated.

    That is as far as the area is wide, and fewer pixels than make a chart slow.
    """
    sides = np.subtract(box[1][:2], box[0][:2])
    metres = min(float(sides.max()), _LOOK)
    while metres > _NEAR and np.prod((sides + 2.0 * metres) / size) > _WIDE_PIXELS:
        metres *= 0.8
    return metres


def _cropped(chart: Chart, settings: ChartSettings, box: Corners) -> Chart:
    """Return what a chart of a file with a place has of the area; distances to what lies beyond it stay."""
    if settings.source not in ("polygons", "raster", "enc", "none"):
        return chart
    size, low = float(chart.pixel_size), np.asarray(box[0][:2])
    i, j = np.rint((low - np.asarray(chart.lower, float)) / size).astype(int).tolist()
    north, east = np.maximum(np.ceil((np.asarray(box[1][:2]) - low) / size - 1e-6).astype(int), 1).tolist()
    return replace(chart.crop(i, j, north, east), origin=jnp.asarray(low, jnp.float32))


def _cells(settings: ChartSettings, site: Site | None, box: Corners, home: str) -> geo.Cells:
    """Return what the S-57 cells of a chart tell of the area."""
    assert settings.file is not None
    depths = settings.safety_depth, settings.hazard_radius
    with blaming("chart", "file"):
        return _read_cells(_path(home, settings.file), site, box, settings.pixel_size, *depths)


@_kept
def _read_cells(
    path: str, site: Site, box: Corners, size: float, safety_depth: float, hazard_radius: float
) -> geo.Cells:
    return geo.read_cells(
        path,
        site,
        lower=box[0][:2],
        upper=box[1][:2],
        deepest=box[1][2],
        pixel_size=size,
        safety_depth=safety_depth,
        hazard_radius=hazard_radius,
        beyond=_beyond(box, size),
    )


def _other_size(settings: ChartSettings, home: str) -> tuple[str, ...]:
    """Return what is to be said where a picture's file tells another size of its pixels than the scenario."""
    assert settings.image is not None
    path = _path(home, settings.image)
    with suppress(geo.GeoError):  # the place of such a picture is not used
        stated = geo.pixel_size(path)
        if stated is not None and abs(stated.metres / settings.pixel_size - 1.0) > 0.01:
            return (
                f"{path}: chart.pixel_size is {settings.pixel_size:g} m, the file says {stated.metres:.4g} m",
            )
    return ()


@_kept
def _charts(
    settings: ChartSettings,
    site: Site | None,
    box: Corners,
    current: "CurrentFile | None",
    home: str,
) -> tuple[Chart | None, Chart | None, Chart | None, tuple[str, ...]]:
    """Return the coast beyond the area, the chart without its closed areas and with them, and its notes."""
    coast, wide, notes = _plain_chart(settings, site, box, current, home)
    plain = None if wide is None else _cropped(wide, settings, box)
    if settings.no_go is None:
        return coast, plain, plain, notes
    assert site is not None
    lower, upper = box[0][:2], box[1][:2]
    with blaming("chart", "no_go"):
        zones = _zones(settings, site, home, lower=lower, upper=upper)
        always, more = [zone for zone in zones if not zone.hours], _beyond(box, settings.pixel_size)
        more = settings.pixel_size * np.ceil(more / settings.pixel_size)
        area = {"lower": np.subtract(lower, more), "upper": np.add(upper, more)}
        closed = geo.with_no_go(wide, always, **area, pixel_size=settings.pixel_size)
    return coast, plain, _cropped(closed, settings, box), notes


def _warn_of_one_kind(settings: ChartSettings, chart: Chart) -> None:
    """Warn of a picture without land, or with nothing but land."""
    dry = float((np.asarray(chart.passability) == 0.0).mean())
    if dry in (0.0, 1.0):
        what = "no land" if dry == 0.0 else "nothing but land"
        picture = settings.file or settings.image
        line = f"{picture}: shows {what} in the area: land and water are distinguished by their colours"
        warnings.warn(line, ScenarioWarning, stacklevel=2)


def _water_chart(current: "CurrentFile", box: Corners, size: float) -> Chart:
    """Coast where a current's files have no water at a pixel's centre or at one of its corners."""
    pixels = _pixels(box, size, "chart.pixel_size")
    source, site = current.source, current.site
    first = (current.epoch - _EPOCH).total_seconds()
    times = np.asarray(current.field.times, float)
    frames = source.frames(first + times[0], first + times[-1])
    reach = 0.0 if source.kind == "triangles" else min(current.spacing) / 2.0

    def is_water(offset: float, more: int) -> np.ndarray:
        axes = [box[0][k] + size * (np.arange(count + more) + offset) for k, count in enumerate(pixels)]
        north, east = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        wet = source.is_water(*site.to_geographic(north, east), frames, reach)
        return wet.reshape(len(axes[0]), len(axes[1]))

    corners = is_water(0.0, 1)
    water = is_water(0.5, 0) & corners[1:, 1:] & corners[1:, :-1] & corners[:-1, 1:] & corners[:-1, :-1]
    return Chart.from_mask(water, size, box[0][:2])


def _pixels(box: Corners, size: float, field: str) -> np.ndarray:
    """Return the pixels of a box, north and east.

    Raises:
        ScenarioError: they are too many.
    """
    extent = np.asarray(box[1][:2]) - np.asarray(box[0][:2])
    pixels = np.ceil(extent / size - 1e-9).astype(int)
    if pixels.prod() > _MAX_PIXELS:
        makes = f"{size:g} m makes {pixels[0]} x {pixels[1]} pixels, more than {_MAX_PIXELS}"
        raise ScenarioError(makes, field=field)
    return pixels


def _seabed(
    scenario: Scenario,
    site: Site | None,
    box: Corners,
    current: "CurrentFile | None",
    home: str,
) -> tuple[Seabed | None, tuple[str, ...]]:
    """Return the sea bed, and what was assumed of its file."""
    settings, clearance = scenario.bathymetry, scenario.safety.seabed
    if settings.source == "none":
        return None, ()
    low, water = _low_water(settings, current)
    if settings.source == "current":
        assert current is not None
        if current.sea_floor is None:
            raise ScenarioError(
                "'current': the current's files do not tell the depth", field="bathymetry.source"
            )
        size = settings.pixel_size or min(current.spacing) / 2.0
        pixels = _pixels(box, size, "bathymetry.pixel_size")
        centres = [box[0][k] + size * (np.arange(count) + 0.5) for k, count in enumerate(pixels)]
        places = current.site.to_geographic(*(axis.ravel() for axis in np.meshgrid(*centres, indexing="ij")))
        depth = current.source.sea_floor(*places)
        assert depth is not None
        depth = depth.reshape(pixels) + low
        return Seabed.from_depth(depth, size, np.asarray(box[0][:2]), clearance=clearance), water
    if settings.source == "chart":
        cells = _cells(scenario.chart, _timeless(site), box, home)
        corner, size = np.asarray(cells.land.lower), float(cells.land.pixel_size)
        depth = cells.depth + np.float32(low)
        return Seabed.from_depth(depth, size, corner, clearance=clearance), water
    assert site is not None
    assert settings.file is not None
    path = _path(home, settings.file)
    with blaming("bathymetry", "file"):
        found = geo.read_bathymetry(
            path,
            site,
            lower=box[0][:2],
            upper=box[1][:2],
            pixel_size=settings.pixel_size,
            variable=settings.variable,
            positive=settings.positive,
            crs=settings.crs,
        )
        if not (found.depth > 0.0).any():
            raise ScenarioError(
                f"{path}: no pixel of the area lies below the sea surface: say by bathymetry.positive which "
                "way its values count"
            )
    depth = found.depth + np.float32(low)
    bed = Seabed.from_depth(depth, found.pixel_size, np.asarray(found.origin), clearance=clearance)
    return bed, (*(f"{settings.file}: {note}" for note in found.notes), *water)


def _low_water(settings: BathymetrySettings, current: "CurrentFile | None") -> tuple[float, tuple[str, ...]]:
    """Return the surface at its lowest, m above the sea bed's datum, and what is to be noted of it.

    Depths of a vehicle count from the moving surface, those of the bed from its datum.
    """
    if settings.water_level is not None:
        return settings.water_level, ()
    stated = None if current is None else current.low_water
    if stated is None or not np.isfinite(stated).any():
        return 0.0, (
            "the sea bed is taken at its datum: at low water there is less above it, which "
            "bathymetry.water_level would count",
        )
    lowest = min(float(np.nanmin(stated)), 0.0)
    if lowest == 0.0:
        return 0.0, ()
    return lowest, (
        f"the sea bed counts from the lowest water of the current's files, {-lowest:.2f} m below their datum",
    )


@lru_cache(maxsize=4)
def _picture_chart(
    settings: ChartSettings, folder: str
) -> tuple[Chart | None, Chart | None, tuple[str, ...]]:
    """Return all of a picture as a chart, or none, its window, and what was assumed of it, a line each.

    Raises:
        ScenarioError: the window does not fit the picture.
        ChartError: the picture cannot be read, or what is water in it is in doubt.
    """
    notes: tuple[str, ...] = ()
    if settings.source == "none":
        return None, None, notes
    if settings.source == "whitsunday":
        chart = whitsunday.whitsunday_chart()
    else:
        assert settings.image is not None
        path = _path(folder, settings.image)
        found = settled(classify_file(path, colours=settings.colours.given), path)
        chart = Chart.from_classified(found, settings.pixel_size)
        notes = (*(f"{path}: {note}" for note in found.notes), *(f"{path} {line}" for line in found.warnings))
    if settings.window is not None:
        # The window counts rows from the north, the raster from the south.
        row, column, rows, columns = settings.window
        north = chart.shape[0]
        if (
            row < 0
            or column < 0
            or rows < 2
            or columns < 2
            or row + rows > north
            or column + columns > chart.shape[1]
        ):
            raise ScenarioError(
                f"{settings.window} does not fit a chart of {chart.shape} pixels", field="chart.window"
            )
        part = chart.crop(north - row - rows, column, rows, columns)
        # Local metres count from the window's corner.
        whole = replace(chart, origin=chart.origin - part.origin)
        return whole, replace(part, origin=jnp.zeros_like(part.origin)), notes
    return chart, chart, notes


def _require_area_on_chart(scenario: Scenario, chart: Chart | None) -> None:
    """Raise ScenarioError where the area reaches beyond the chart."""
    if chart is None:
        return
    low, high = np.asarray(chart.lower), np.asarray(chart.upper)
    area = scenario.area
    if (np.asarray(area.lower[:2]) < low - 1e-3).any() or (np.asarray(area.upper[:2]) > high + 1e-3).any():
        raise ScenarioError(
            f"{area.lower[:2]} to {area.upper[:2]} m reaches beyond the chart, which covers "
            f"{tuple(float(v) for v in low)} to {tuple(float(v) for v in high)} m",
            field="area",
        )
