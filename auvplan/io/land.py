"""Land of a scenario: its chart, from pictures, polygons, S-57 cells or where a current has no water."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np

from auvplan.errors import ScenarioError, error_context, warn
from auvplan.io import geo
from auvplan.ocean import whitsunday
from auvplan.ocean.chart import Chart, classify_file, settled
from auvplan.scenario.settings import ChartSettings
from auvplan.site import Site

if TYPE_CHECKING:
    from auvplan.io.currents import CurrentFile

#: m, farthest and least that land is read beyond the area, and pixels of it from which on less is read.
_LOOK, _NEAR, _WIDE_PIXELS = 5000.0, 500.0, 4_000_000

Corners = tuple[tuple[float, float, float], tuple[float, float, float]]


def read_land(
    settings: ChartSettings,
    site: Site | None,
    box: Corners,
    current: "CurrentFile | None",
    file: Any,
    uncertain: Any,
    low_water: float = 0.0,
) -> geo.Land:
    """Read a chart's file, or what is given in its place, as far beyond the area as it and `beyond` do.

    What stands in its water is as deep as at low water, m above the chart's datum.

    Raises:
        ScenarioError, ChartError, CurrentError: one line that names file, field and reason.

    Warns:
        ScenarioWarning: a picture shows no land, or nothing else.
    """
    if settings.source == "none":
        return geo.Land()
    size, notes, coast = settings.pixel_size, (), None
    extent = geo.Extent(box[0][:2], box[1][:2], size, beyond(box, size))
    of = {"whitsunday": "image", "image": "image", "current": "pixel_size"}
    with error_context("chart", of.get(settings.source, "file")):
        if settings.source in ("whitsunday", "image"):
            coast, chart, notes = _picture(settings, file)
        elif settings.source == "current":
            assert current is not None
            chart = _water_chart(current, extent.grid())
        else:
            assert site is not None
            if settings.source == "enc":
                limits = {"safety_depth": settings.safety_depth, "hazard_radius": settings.hazard_radius}
                limits |= {"deepest": box[1][2], "low_water": low_water}
                return geo.read_cells(file, site, extent, **limits)
            if settings.source == "raster":
                colours = settings.colours.given
                chart, notes = geo.chart_and_notes(file, site, extent, crs=settings.crs, colours=colours)
            else:
                margin = {"fringe": settings.fringe, "uncertain": uncertain}
                chart = geo.chart_from_polygons(file, site, extent, **margin)
    if settings.source in ("raster", "image"):
        dry = float((np.asarray(cropped(chart, settings, box).passability) == 0.0).mean())
        if dry in (0.0, 1.0):
            what = "no land" if dry == 0.0 else "nothing but land"
            picture = settings.file or settings.image
            warn(f"{picture}: shows {what} in the area: land and water are distinguished by their colours")
    return geo.Land(chart if coast is None else coast, chart, notes)


def _picture(settings: ChartSettings, path: str) -> tuple[Chart, Chart, tuple[str, ...]]:
    """Return all of a picture as a chart, its window, and what was assumed of it, a line each."""
    notes: tuple[str, ...] = ()
    if settings.source == "whitsunday":
        chart = whitsunday.whitsunday_chart()
    else:
        found = settled(classify_file(path, colours=settings.colours.given), path)
        chart = Chart.from_classified(found, settings.pixel_size)
        notes = (*(f"{path}: {note}" for note in found.notes), *(f"{path} {line}" for line in found.warnings))
        with suppress(geo.GeoError):  # the place of such a picture is not used
            stated = geo.pixel_size(path)
            if stated is not None and abs(stated.metres / settings.pixel_size - 1.0) > 0.01:
                size = f"chart.pixel_size is {settings.pixel_size:g} m, the file says {stated.metres:.4g} m"
                notes += (f"{path}: {size}",)
    if settings.window is None:
        return chart, chart, notes
    # The window counts rows from the north, the raster from the south.
    (row, column, rows, columns), (north, east) = settings.window, chart.shape
    if min(row, column) < 0 or min(rows, columns) < 2 or row + rows > north or column + columns > east:
        raise ScenarioError(
            f"{settings.window} does not fit a chart of {chart.shape} pixels", field="chart.window"
        )
    part = chart.crop(north - row - rows, column, rows, columns)
    # Local metres count from the window's corner.
    whole = replace(chart, origin=chart.origin - part.origin)
    return whole, replace(part, origin=jnp.zeros_like(part.origin)), notes


def cropped(chart: Chart, settings: ChartSettings, box: Corners) -> Chart:
    """Return what a chart of a file with a place has of the area; distances to what lies beyond stay."""
    if settings.source not in ("polygons", "raster", "enc", "none"):
        return chart
    size, (low, high) = float(chart.pixel_size), (np.asarray(corner[:2]) for corner in box)
    i, j = np.rint((low - np.asarray(chart.lower, float)) / size).astype(int).tolist()
    north, east = np.maximum(np.ceil((high - low) / size - 1e-6).astype(int), 1).tolist()
    return replace(chart.crop(i, j, north, east), origin=jnp.asarray(low, jnp.float32))


def beyond(box: Corners, size: float) -> float:
    """Return how far beyond the area land is read, m: as far as a distance to it is stated.

    That is as far as the area is wide, and fewer pixels than make a chart slow.
    """
    sides = np.subtract(box[1][:2], box[0][:2])
    metres = min(float(sides.max()), _LOOK)
    while metres > _NEAR and np.prod((sides + 2.0 * metres) / size) > _WIDE_PIXELS:
        metres *= 0.8
    return metres


def on_land(chart: Chart) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return where a chart has land, as `read_current` takes it."""
    low, high = (np.asarray(corner, float) for corner in (chart.lower, chart.upper))

    def land(north: np.ndarray, east: np.ndarray) -> np.ndarray:
        # Rounding may put the nodes on the chart's edge beyond it.
        return ~chart.is_water(np.clip(north, low[0], high[0]), np.clip(east, low[1], high[1]))

    return land


def _water_chart(current: "CurrentFile", grid: geo.LocalGrid) -> Chart:
    """Coast where a current's files have no water at a pixel's centre or at one of its corners."""
    from auvplan.io.currents.times import seconds_of

    source, first = current.source, float(seconds_of(current.epoch))
    times = np.asarray(current.field.times, float)
    frames = source.frames(first + times[0], first + times[-1])
    reach = 0.0 if source.kind == "triangles" else min(current.spacing) / 2.0

    def is_water(offset: float) -> np.ndarray:
        longitude, latitude = grid.degrees(current.site, offset)
        return source.is_water(longitude.ravel(), latitude.ravel(), frames, reach).reshape(longitude.shape)

    corners, water = is_water(0.0), is_water(0.5)
    water &= corners[1:, 1:] & corners[1:, :-1] & corners[:-1, 1:] & corners[:-1, :-1]
    return Chart.from_mask(water, grid.pixel_size, grid.lower)


def in_folder(folder: str | Path, name: str) -> str:
    """Return a path relative to the scenario's folder; patterns and absolute paths as they are."""
    return str(Path(folder) / Path(name).expanduser())
