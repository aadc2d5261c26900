"""Depth of the sea floor on local pixels, from NetCDF (GEBCO, ETOPO, EMODnet, ROMS, CF) and rasters."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.io.currents.units import length_factor
from auvplan.io.geo.error import GeoError, reading
from auvplan.io.geo.field import DOWN, SPELT_OUT, UP, Field, netcdf_field, sense_of_standard_name
from auvplan.io.geo.geotiff import is_tiff
from auvplan.io.geo.grid import LocalGrid, bilinear, local_grid, refuse_beyond, steps
from auvplan.io.geo.raster import is_raster, read_raster
from auvplan.ocean.picture import MAX_PIXELS
from auvplan.site import Site

Array = NDArray[np.floating]

#: Default pixels are half the source's spacing, within these bounds, m, and so many a side at most.
SMALLEST_PIXEL, LARGEST_PIXEL, MOST_PIXELS = 10.0, 500.0, 1024
# No sea floor lies deeper and no mountain higher, m: such values stand for none, and so do these.
_EXTREME, _SENTINELS = 12_000.0, (-9999.0, 9999.0)
# Rows of a file that are looked through for the signs of its values.
_ROWS = 64


@dataclass(frozen=True, eq=False)
class Bathymetry:
    """Depth of the sea floor on a raster indexed [north, east].

    Attributes:
        depth: [nx, ny] float32, m at pixel centres, positive down: negative above the sea, NaN where it
            is not known.
        origin: (north, east) of the corner of pixel (0, 0), m.
        pixel_size: m.
        notes: what was taken for granted, a line each.
    """

    depth: NDArray[np.float32]
    origin: tuple[float, float]
    pixel_size: float
    notes: tuple[str, ...] = ()


def read_bathymetry(
    path: str | Path,
    site: Site,
    *,
    lower: Any,
    upper: Any,
    pixel_size: float | None = None,
    variable: str | None = None,
    positive: str | None = None,
    crs: Any = None,
) -> Bathymetry:
    """Read the sea floor under a local rectangle; bilinear in the file's own coordinates.

    Which way values count is given by the attributes `positive` and `standard_name`, else by `positive`, else
    by the variable's name (elevation, z: up; h, depth: down). Where nothing tells it, values of both signs,
    or negative ones alone, in the area and 64 rows of the whole file are heights, with a note; else it is
    asked for. Units are m, km, cm, fathoms or ft. A pixel is NaN where one of the values that bear on it is
    missing. Of NetCDF only the window that is needed is read.

    Args:
        path: NetCDF-3 or -4 with longitude and latitude as two axes or two grids, or a raster of one band
            (`read_raster`).
        site: where local coordinates count from.
        lower: south-western corner (north, east), m.
        upper: north-eastern corner, m; the last pixels may reach beyond it.
        pixel_size: m; None for half the file's spacing, from 10 to 500 m and no more than 1024 pixels a side.
        variable: name of the variable in a NetCDF file.
        positive: "up" or "down", which way the file's values count, where it does not tell.
        crs: coordinate reference system of a raster that tells none.

    Raises:
        GeoError: one line; what is wrong with the file, that it does not tell which way its values count, or
            on which side and by how much the rectangle reaches beyond its outer cells.
    """
    path = Path(path)
    if positive not in (None, "up", "down"):
        raise GeoError(f'positive must be "up" or "down", got {positive!r}')
    with reading(path):
        # Where no size is given these pixels only stand for the rectangle.
        provisional = local_grid(lower, upper, pixel_size)
        with _opened(path, variable, site, provisional, crs) as field:
            nodes = field.nodes
            find = nodes.seen_from(site, provisional)
            refuse_beyond(path, "data", site, find, provisional, nodes, 0.5 + 1e-6)
            grid = provisional
            if pixel_size is None:
                spacing = float(np.nanmin(np.hypot(*steps(find, provisional).T)))
                size = float(np.clip(spacing / 2, SMALLEST_PIXEL, LARGEST_PIXEL))
                longest = max(b - a for a, b in zip(grid.lower, grid.upper, strict=True))
                grid = local_grid(lower, upper, max(size, longest / MOST_PIXELS))
            window = _window(path, find, grid, field)
            values = field.load(*window)
            if not np.isfinite(values).any():
                raise GeoError(f"{path}: {field.name or 'the band'} has no values in the area")
            sense, stated = _sense(path, field, values, positive)
        factor, notes = _factor(path, field)
        values, missing = _without_sentinels(values * factor)
        notes += missing
        if not np.isfinite(values).any():
            raise GeoError(f"{path}: {field.name or 'the band'} has no values in the area")
        depth = np.empty(grid.shape, np.float32)
        for rows, north, east in grid.blocks():
            row, column = find(north, east)
            depth[rows] = sense * bilinear(values, row - window[0], column - window[2])
    unknown = int(np.isnan(depth).sum())
    if unknown == depth.size:
        raise GeoError(f"{path}: {field.name or 'the band'} has no values in the area")
    if unknown:
        notes += (f"{unknown} of {depth.size} pixels have no depth: NaN",)
    if not (depth > 0.0).any():
        notes += ("no pixel lies below the sea surface",)
    return Bathymetry(depth, grid.lower, grid.pixel_size, (*field.notes, *stated, *notes))


@contextmanager
def _opened(path: Path, variable: str | None, site: Site, grid: LocalGrid, crs: Any) -> Iterator[Field]:
    with path.open("rb") as file:
        start = file.read(4)
    is_a_raster = is_tiff(start) or (is_raster(path) and not start.startswith(b"CDF"))
    if not is_a_raster:
        with netcdf_field(path, variable, site, grid) as field:
            yield field
        return
    raster = read_raster(path, crs, indices=True)
    if raster.values.ndim != 2:
        raise GeoError(f"{path}: three bands are colours, not depths")
    stated = raster.attributes
    name = stated.get("netcdf_varname") or stated.get("description") or ""
    if variable is not None and variable != name:
        raise GeoError(f"{path}: a GeoTIFF has no variable {variable!r}")
    attributes = {key: stated[key] for key in ("standard_name", "positive") if key in stated}
    attributes["units"] = stated.get("unittype") or stated.get("units") or ""
    gain, offset = (float(stated.get(key, default)) for key, default in (("scale", 1.0), ("offset", 0.0)))

    def load(first: int, last: int, left: int, right: int) -> Array:
        columns = np.arange(left, right + 1) % raster.values.shape[1]
        raw = raster.values[first : last + 1][:, columns]
        values = raw.astype(float) * gain + offset
        if raster.nodata is not None:
            values[raw == _as_stored(raster.nodata, raw.dtype)] = np.nan
        if raster.blank is not None:
            values[raster.blank[first : last + 1][:, columns]] = np.nan
        return values

    yield Field(name, attributes, raster.nodes(), load)


def _as_stored(number: float, dtype: np.dtype) -> Any:
    """Return a number as a raster keeps it: in single precision -3.4e38 is not quite what the tag tells."""
    with np.errstate(over="ignore"):
        return dtype.type(number) if dtype.kind == "f" else number


def _window(path: Path, find: Any, grid: LocalGrid, field: Field) -> tuple[int, int, int, int]:
    """First and last row, first and last column, of the nodes that bear on a grid."""
    spans = []
    for _, north, east in grid.blocks():
        row, column = find(north, east)
        if np.isnan(row).all():
            continue
        spans.append((np.nanmin(row), np.nanmax(row), np.nanmin(column), np.nanmax(column)))
    if not spans:
        raise GeoError(f"{path}: the area lies wholly beyond the data")
    low, high = np.min(spans, axis=0), np.max(spans, axis=0)
    first, left = int(np.floor(low[0])), int(np.floor(low[2]))
    last, right = int(np.ceil(high[1])), int(np.ceil(high[3]))
    rows, columns = field.nodes.shape
    first, last = (min(max(k, 0), rows - 1) for k in (first, last))
    if not field.nodes.cyclic:
        left, right = (min(max(k, 0), columns - 1) for k in (left, right))
    if (last - first + 1) * (right - left + 1) > MAX_PIXELS:
        raise GeoError(f"{path}: the area holds more than {MAX_PIXELS} values")
    return first, last, left, right


def _factor(path: Path, field: Field) -> tuple[float, tuple[str, ...]]:
    """Return metres in the file's unit."""
    unit = str(field.attributes.get("units", "")).strip()
    if not unit:
        return 1.0, ("units are not given: metres",)
    factor = length_factor(unit.rstrip("."))
    if factor is None:
        raise GeoError(f"{path}: {field.name or 'the band'} is in {unit!r}, not in m, km, cm, fathoms or ft")
    return factor, ()


def _without_sentinels(values: Array) -> tuple[Array, tuple[str, ...]]:
    """NaN for numbers that stand for none without the file saying so; metres."""
    with np.errstate(invalid="ignore"):
        odd = (np.abs(values) > _EXTREME) | np.isin(values, _SENTINELS)
    count = int(odd.sum())
    notes = (
        (f"{count} values that no sea floor has, such as {values[odd][0]:g} m, were taken as missing",)
        if count
        else ()
    )
    return np.where(odd, np.nan, values), notes


def _sense(path: Path, field: Field, values: Array, positive: str | None) -> tuple[float, tuple[str, ...]]:
    """Return the factor that makes values positive down, and what was taken for granted."""
    what = f"{path}: {field.name or 'the band'}"
    stated = {}
    attribute = str(field.attributes.get("positive", "")).strip().lower()
    if attribute in ("up", "down"):
        stated["its attribute positive"] = attribute
    standard = str(field.attributes.get("standard_name", ""))
    if sense := sense_of_standard_name(standard):
        stated[f"its standard_name {standard}"] = sense
    if positive is not None:
        stated["the argument positive"] = positive
    if len(set(stated.values())) > 1:
        listed = ", ".join(f"{source} says {sense}" for source, sense in stated.items())
        raise GeoError(f"{what} has a contradictory sign convention: {listed}")
    name = field.name.lower()
    if not stated and (name in (*UP, *DOWN) or name.startswith(SPELT_OUT)):
        stated["its name"] = "up" if name in UP else "down"
    if stated:
        source, sense = next(iter(stated.items()))
        if sense == "down" and positive is None and (values[np.isfinite(values)] < 0.0).all():
            raise GeoError(
                f'{what} is positive down by {source}, but all its values are negative: say positive="up"'
            )
        return (1.0 if sense == "down" else -1.0), ()
    least, most = _extremes(field, values)
    if most <= 0.0 or (least < 0.0 and not name.startswith("bathy") and "depth" not in name):
        kind = "of both signs" if most > 0.0 else "negative"
        return -1.0, (f"{field.name or 'the band'} was taken as positive up: its values are {kind}",)
    raise GeoError(
        f"{what} does not tell whether its values, {least:g} to {most:g}, are heights or depths: say "
        'positive="up" or "down" (bathymetry.positive)'
    )


def _extremes(field: Field, values: Array) -> tuple[float, float]:
    """Return the least and largest of some values and of evenly spaced rows of the whole file."""
    rows, columns = field.nodes.shape
    sample = [values.ravel()]
    for row in np.unique(np.linspace(0, rows - 1, min(rows, _ROWS)).astype(int)):
        sample.append(field.load(int(row), int(row), 0, columns - 1).ravel())
    known = np.concatenate(sample)
    known = known[np.isfinite(known) & ~np.isin(known, _SENTINELS)]
    return (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
