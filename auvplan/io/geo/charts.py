"""Charts from georeferenced pictures and from polygons of land, reefs and closed areas."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon, Polygon

from auvplan.errors import error_context, warn
from auvplan.io.geo.error import GeoError, label, reading
from auvplan.io.geo.features import Features
from auvplan.io.geo.grid import Extent, LocalGrid, around, near, to_local, touched
from auvplan.io.geo.nodes import Source, View, nearest, placed
from auvplan.io.geo.polygons import read_polygons
from auvplan.io.geo.raster import read_raster
from auvplan.io.geo.windows import Hours
from auvplan.ocean.chart import Chart, ChartError, settled
from auvplan.ocean.classify import UNCERTAIN_MAX, classify_picture
from auvplan.ocean.closures import Closure, Zone
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.palette import DEFAULT_COLOURS, ChartColours
from auvplan.site import Site, swapped_hint

# Pixels by which a picture's corner pixels may stick out: half of one is the picture's own edge.
_SLACK = 1.0
#: Properties that state when an area is closed.
_HOURS = ("from", "to", "windows")


class Land(NamedTuple):
    """What a chart's file has of an area and of a rectangle around it.

    Attributes:
        coast: coast where a vehicle cannot or must not be, closed areas left out: land and, of S-57 cells,
            also water that may be shallower than the safety depth, what is not surveyed and areas of hazards;
            None for open water.
        chart: the same, and coast in the areas that the file closes.
        notes: what was assumed, a line each.
        land: of the area, land alone; None where it is `coast`.
        depth: [nx, ny] m below the chart's datum on its pixels, the least that the depth areas around a pixel
            leave open, 0 where there are none; None where the file has no depths.
        hazards: rocks, wrecks and obstructions that are points on the chart, with their depths at low water.
        closed: areas that entry is prohibited to, or that are to be avoided.
    """

    coast: Chart | None = None
    chart: Chart | None = None
    notes: tuple[str, ...] = ()
    land: Chart | None = None
    depth: NDArray[np.float32] | None = None
    hazards: tuple[KnownObstacle, ...] = ()
    closed: tuple[Zone, ...] = ()


def chart_and_notes(
    source: Source,
    site: Site,
    extent: Extent,
    *,
    crs: Any = None,
    classes: Mapping[int, float] | None = None,
    colours: ChartColours = DEFAULT_COLOURS,
) -> tuple[Chart, tuple[str, ...]]:
    """Return a chart of a local rectangle from a georeferenced picture, or from a raster of classes.

    A colour picture is clustered as a whole, on its own pixels (`auvplan.ocean.classify`), and every pixel
    of the chart takes the passability of the picture's nearest one. Where the chart's pixels are coarser than
    the picture's, it takes the least of those that it covers: land is not to fall between them.

    See-through pixels, no data and a black or white frame that reach to the picture's edge are no land: the
    rectangle must not reach into them. A frame of a shade that `colours` name is closed, but on the chart.

    Args:
        source: path of a GeoTIFF, or of a PNG, JPEG or TIFF with a world file (`read_raster`); or an xarray
            array of one band, or of bands red, green, blue and perhaps alpha, with coordinates as
            `auvplan.io.geo.nodes` describes them.
        site: where local coordinates count from.
        extent: of the chart.
        crs: coordinate reference system, where the source has none.
        classes: pixel value to passability (0 coast, (0, 0.35] uncertain, 1 water) of a single-band raster.
            What the file marks as no data is coast, unless it is named here.
        colours: what the picture's colours stand for; with them a band of greys is a picture too.

    Returns:
        The chart, and what was assumed of the picture, a line each.

    Raises:
        ChartError: one line; what is wrong with the file, on which side and by how much the rectangle
            reaches beyond it, where it reaches into what shows no sea area, or what is in doubt about its
            colours.

    Warns:
        ScenarioWarning: the picture does not look like a chart.
    """
    path = label(source)
    with reading(path, ChartError):
        grid = extent.grid()
        given = isinstance(source, str | Path)
        raster = read_raster(source, crs, numbers=classes is not None) if given else source
        plane = raster.isel(band=0, drop=True) if "band" in raster.dims else raster
        plane, nodes = placed(path, plane, site, grid, crs)
        view = View(nodes, site, grid)
        # Before the clustering, which takes longer than anything else.
        view.refuse_beyond(path, "picture", _SLACK)
        raster = raster.transpose(*plane.dims, ...)[:, : nodes.shape[1]]
        passability, notes, outside = _passability(path, raster, plane.coords.get("mask"), classes, colours)
        if outside is not None and outside.any():
            _refuse_outside(path, _least(1.0 - outside, view, grid, 1.0) == 0.0, grid)
        wide = grid.widened(extent.beyond)
        found = _least(passability, view, wide, 1.0)
        if outside is not None:
            found = np.where(_least(1.0 - outside, view, wide, 0.0) == 0.0, 1.0, found)
        return wide.chart(found), notes


def chart_from_raster(source: Source, site: Site, extent: Extent, **options: Any) -> Chart:
    """`chart_and_notes` without the notes."""
    return chart_and_notes(source, site, extent, **options)[0]


def chart_from_polygons(
    source: Features,
    site: Site,
    extent: Extent,
    *,
    fringe: float = 0.0,
    uncertain: Features | None = None,
) -> Chart:
    """Return a chart of a local rectangle from polygons of land: every pixel that land reaches into is coast.

    Land beyond what the chart covers has its fringe in it, but is not in its distance to the coast.

    Args:
        source: GeoJSON of Polygon or MultiPolygon, in features and collections or bare: a file or `Features`.
        site: where local coordinates count from.
        extent: of the chart.
        fringe: m; water within this distance of land is uncertain.
        uncertain: a second such file, of reefs and shoals, which are uncertain.

    Raises:
        ChartError: one line that names the file and the number of the feature that is at fault.

    Warns:
        ScenarioWarning: none of the polygons reaches into the rectangle.
    """
    path = label(source)
    with reading(path, ChartError):
        grid = extent.grid()
        if not (np.isfinite(fringe) and fringe >= 0.0):
            raise GeoError(f"fringe must not be negative, got {fringe}")
        wide = grid.widened(extent.beyond)
        area = around(site, wide, fringe + grid.pixel_size)

        def shapes(of: Features, what: str, margin: float) -> Any:
            """Polygons on the grid and around it, in local metres."""
            found = [one.shape for one in read_polygons(of, area)]
            reaching = near(found, site, wide, margin)
            if shapely.is_empty(reaching):
                _warn_beyond(label(of), what, found, site, grid)
            return reaching

        land = shapes(source, "land", fringe + grid.pixel_size)
        doubtful = touched(land.buffer(fringe), wide) if fringe > 0.0 else np.zeros(wide.shape, bool)
        if uncertain is not None:
            with error_context("", "uncertain"):
                doubtful |= touched(shapes(uncertain, "uncertain area", grid.pixel_size), wide)
        coast = touched(land, wide)
        return wide.chart(np.where(coast, 0.0, np.where(doubtful, UNCERTAIN_MAX, 1.0)))


def with_no_go(chart: Chart | None, polygons: Iterable[Any], extent: Extent | None = None) -> Chart:
    """Return a chart on which closed areas are coast: every pixel that one reaches into.

    Args:
        chart: the chart; None for open water.
        polygons: zones, or shapely polygons in local (north, east), m; what lies off the chart is left.
        extent: of a chart of open water, with what lies beyond; not used with `chart`.

    Raises:
        ChartError: a polygon is none, is empty or crosses itself, or the corners are no corners.
    """
    with reading("closed areas", ChartError):
        if chart is None:
            if extent is None:
                raise GeoError("without a chart, an extent is needed")
            grid = extent.grid().widened(extent.beyond)
        else:
            low, high = (tuple(np.asarray(corner, float).tolist()) for corner in (chart.lower, chart.upper))
            grid = LocalGrid(low, high, float(chart.pixel_size), chart.shape)
        closed = np.zeros(grid.shape, bool)
        for number, given in enumerate(polygons, 1):
            shape = given.polygon if isinstance(given, Zone) else given
            what = f"no-go area {given.name!r}" if isinstance(given, Zone) else f"no-go area {number}"
            if not isinstance(shape, Polygon | MultiPolygon) or shape.is_empty:
                raise GeoError(f"{what}: is no polygon with an area")
            if not np.isfinite(shapely.get_coordinates(shape)).all():
                raise GeoError(f"{what}: a coordinate is not finite")
            if not shape.is_valid:
                raise GeoError(f"{what}: {shapely.is_valid_reason(shape)}")
            closed |= touched(shape, grid)
    if chart is None:
        return grid.chart(~closed)
    burnt = Chart.from_passability(np.where(closed, 0.0, np.asarray(chart.passability)), grid.pixel_size)
    # What the chart knew of a coast beyond its edge stays known.
    distance = jnp.minimum(chart.signed_distance, burnt.signed_distance)
    return replace(chart, passability=burnt.passability, signed_distance=distance)


def read_zones(source: Features, site: Site, extent: Extent | None = None) -> list[Zone]:
    """Closed areas from GeoJSON: Polygon or MultiPolygon, named by their property `name`.

    One that is closed at some hours only states them by `from` and `to`, or by `windows`, as jobs do.

    Raises:
        GeoError: one line that names the file and the number of the feature that is at fault.

    Warns:
        ScenarioWarning: none of them reaches into the area.
    """
    path = label(source)
    with reading(path):
        found = read_polygons(source)
        if extent is not None:
            grid, shapes = extent.grid(None), [feature.shape for feature in found]
            if shapely.is_empty(near(shapes, site, grid, 0.0)):
                _warn_beyond(path, "closed area", shapes, site, grid)
        zones = []
        for feature in found:
            hours = {k: v for k, v in feature.properties.items() if k in _HOURS and v != ""}
            name = str(feature.properties.get("name", feature.number))
            polygon = to_local(feature.shape, site)
            if polygon.is_empty:
                raise GeoError(f"{feature.where}: is no polygon with an area")
            zones.append(Zone(name, polygon, feature.where, hours))
        return zones


def closures_of(
    zones: Iterable[Zone],
    site: Site,
    extent: Extent,
    *,
    margin: float,
    until: float,
    since: float = 0.0,
) -> tuple[Closure, ...]:
    """Return the areas that are closed at some hours, those of the same hours as one.

    Args:
        zones: those without hours are left out.
        site: has the departure that moments count from.
        extent: of the charts on which they are coast.
        margin: s, by which they are closed earlier and longer.
        until: s, when missions are over.
        since: s, when the first departs, 0 or before.

    Raises:
        GeoError: one line that names the file, the feature and the time that is at fault.
        ChartError: as `with_no_go`.
    """
    found: dict[tuple[tuple[float, float], ...], list[Zone]] = {}
    since, until = since - margin, until + margin
    for zone in zones:
        spans = Hours(zone.where, zone.hours, site, until, since).spans() if zone.hours else []
        within = [(first, last) for first, last in spans if last > since and first < until]
        if within:
            found.setdefault(tuple(within), []).append(zone)
    closures = []
    for spans, closed in found.items():
        chart = with_no_go(None, closed, extent)
        begins, ends = np.asarray(spans, np.float32).T
        name = ", ".join(zone.name for zone in closed)
        outline = shapely.to_wkt(shapely.union_all([zone.polygon for zone in closed]), rounding_precision=2)
        closures.append(Closure(chart, begins, ends, name, outline).widened(margin))
    return tuple(closures)


def _warn_beyond(path: str, what: str, shapes: list[Any], site: Site, grid: LocalGrid) -> None:
    """Warn of polygons none of which reaches into a grid."""
    west, south, east, north = shapely.total_bounds(np.asarray(shapes, object))
    hint = swapped_hint(site, lambda other: not shapely.is_empty(near(shapes, other, grid, 0.0)))
    warn(
        f"{path}: none of its polygons reaches into the area, so it has no {what}: they lie at "
        f"longitudes {west:.2f} to {east:.2f} and latitudes {south:.2f} to {north:.2f}{hint}"
    )


def _passability(
    path: str, raster: Any, mask: Any, classes: Mapping[int, float] | None, colours: ChartColours
) -> tuple[NDArray[np.float32], tuple[str, ...], NDArray[np.bool_] | None]:
    """[rows, columns] of a raster's own pixels, what was assumed, and which pixels are off the chart."""
    values, nodata = raster.values, raster.attrs.get("_FillValue", np.nan)
    blank = np.zeros(values.shape[:2], bool) if mask is None else mask.values == 0
    if values.ndim == 2 and classes is None and colours and values.dtype in (np.uint8, np.bool_):
        blank |= values == nodata
        values = np.repeat((values * np.uint8(255 if values.dtype == np.bool_ else 1))[..., None], 3, axis=2)
    if values.ndim == 3:
        if values.shape[2] not in (3, 4) or values.dtype != np.uint8:
            raise GeoError(f"{path}: {values.shape[2]} bands of {values.dtype} are no colours of 8 bit")
        values, blank = values[..., :3], blank | (values[..., 3:] < 128).any(axis=2)
        if classes is not None:
            raise GeoError(f"{path}: classes give a meaning to one band, and it has three")
        found = settled(classify_picture(values, blank, colours=colours), path)
        notes = (*(f"{path}: {note}" for note in found.notes), *(f"{path} {line}" for line in found.warnings))
        return found.passability, notes, found.outside
    if classes is None:
        raise GeoError(
            f"{path}: a single band of values: say by classes which are coast, uncertain and water, or, of a "
            "picture of 256 greys, by chart.colours"
        )
    if values.dtype.kind not in "iub":
        raise GeoError(f"{path}: classes are whole numbers, and its values are {values.dtype}")
    for value, meaning in classes.items():
        if not (meaning in (0.0, 1.0) or 0.0 < meaning <= UNCERTAIN_MAX):
            raise GeoError(f"{path}: class {value} must be 0, in (0, {UNCERTAIN_MAX}] or 1, got {meaning}")
    found, place = np.unique(values, return_inverse=True)
    unknown = [int(value) for value in found if int(value) not in classes and value != nodata]
    if unknown:
        listed = ", ".join(map(str, unknown[:8])) + (" ..." if len(unknown) > 8 else "")
        raise GeoError(f"{path}: classes give no meaning to the values {listed}")
    meanings = np.array([classes.get(int(value), 0.0) for value in found], np.float32)
    return np.where(blank, 0.0, meanings[place].reshape(values.shape)), (), None


def _refuse_outside(path: str | Path, reached: NDArray[np.bool_], grid: LocalGrid) -> None:
    """Refuse a grid some of whose pixels show no sea area, but for those wholly beyond what was asked for."""
    north, east = (grid.lower[k] + grid.pixel_size * np.arange(grid.shape[k]) for k in range(2))
    asked = np.ix_(
        north + 0.5 * grid.pixel_size < grid.upper[0], east + 0.5 * grid.pixel_size < grid.upper[1]
    )
    reached = reached[asked]
    if not reached.any():
        return
    (i, j), size = np.nonzero(reached), grid.pixel_size
    south, west = north[i.min()], east[j.min()]
    raise GeoError(
        f"{path}: the area reaches with {reached.mean():.1%} of it into what shows no sea area (see-through, "
        f"no data, or a black or white frame), between {south:.0f} and {north[i.max()] + size:.0f} m north, "
        f"{west:.0f} and {east[j.max()] + size:.0f} m east: keep off it, or say by chart.colours what a "
        "frame's colour stands for"
    )


def _least(passability: NDArray, view: View, grid: LocalGrid, nothing: float) -> NDArray[np.float32]:
    """[nx, ny]: the nearest pixel's, or the least over as many as a pixel of the chart covers.

    Where there is no pixel within `_SLACK` it is `nothing`.
    """
    # Over how many rows and columns a pixel of the chart reaches, which may lie across them.
    nodes, ratio = view.nodes, grid.pixel_size * np.abs(np.linalg.inv(view.steps().T)).sum(axis=1)
    # A tenth of a pixel more or less, as between two projections, is no reason to look at its neighbours.
    window = tuple(2 * max(int(np.ceil((r - 1.0) / 2.0 - 0.1)), 0) + 1 for r in ratio)
    if max(window) > 1:
        passability = scipy.ndimage.minimum_filter(passability, size=window, mode="nearest")
    out = np.empty(grid.shape, np.float32)
    for rows, north, east in grid.blocks():
        row, column = view.find(north, east)
        there = (row > -1.0 - _SLACK) & (row < nodes.shape[0] + _SLACK)
        there &= nodes.cyclic | ((column > -1.0 - _SLACK) & (column < nodes.shape[1] + _SLACK))
        row, column = (np.where(there, axis, 0.0) for axis in (row, column))
        out[rows] = np.where(there, nearest(passability, row, column, nodes.cyclic), nothing)
    return out
