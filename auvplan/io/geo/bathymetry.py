"""Depth of the sea floor on local pixels, from NetCDF (GEBCO, ETOPO, EMODnet, ROMS, CF) and rasters."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from auvplan.io.currents.files import open_lazily
from auvplan.io.currents.units import length_factor
from auvplan.io.geo.error import GeoError, label, reading
from auvplan.io.geo.grid import Extent, LocalGrid
from auvplan.io.geo.nodes import (
    Source,
    View,
    bilinear,
    closer,
    fall,
    fall_between,
    is_degrees,
    least_around,
    listed,
    placed,
)
from auvplan.io.geo.raster import read_raster
from auvplan.ocean.picture import MAX_PIXELS
from auvplan.site import Site

Array = NDArray[np.floating]

#: Default pixels are half the source's spacing, within these bounds, m, and at most this many a side.
SMALLEST_PIXEL, LARGEST_PIXEL, MOST_PIXELS = 10.0, 500.0, 1024
# Names of variables by which the sense of their values is known, in the order in which they are looked for.
_UP = ("elevation", "z", "topo", "topography", "altitude")
_DOWN = ("deptho", "h", "depth", "bottom_depth", "water_depth")
_UNSIGNED = ("bathymetry", "bathy", "bathymetrie", "depth_average", "band1", "height")
# So begin the names that are standard names; they count down.
_SPELT_OUT = "sea_floor_depth"
# No sea floor lies deeper and no mountain higher, m: such values stand for none, and so do these.
_EXTREME, _SENTINELS = 12_000.0, (-9999.0, 9999.0)
# Rows of a source that are looked through for the signs of its values.
_ROWS = 64


@dataclass(frozen=True, eq=False)
class Bathymetry:
    """Depth of the sea floor on a raster indexed [north, east].

    Attributes:
        depth: [nx, ny] float32, m at pixel centres, positive down: negative above the sea, NaN where it
            is not known; bilinear between them, and there nowhere deeper than the source.
        origin: (north, east) of the corner of pixel (0, 0), m.
        pixel_size: m.
        notes: what was taken for granted, a line each.
    """

    depth: NDArray[np.float32]
    origin: tuple[float, float]
    pixel_size: float
    notes: tuple[str, ...] = ()


def read_bathymetry(
    source: Source | xr.Dataset,
    site: Site,
    extent: Extent,
    *,
    variable: str | None = None,
    positive: str | None = None,
    crs: Any = None,
    keep_shoals: bool = True,
) -> Bathymetry:
    """Read the sea floor under a local rectangle; bilinear in the source's own coordinates.

    Between pixels' centres no place is deeper than in the source: pixels around a shoal are shallower by the
    part of it that would be missed (`fall_between`), outer ones by the rise up to the area's edge. Where the
    source is finer than the pixels, a pixel has the shallowest of all that is within one pixel to every side
    of its centre, with a note.

    Which way values count is given by the attributes `positive` and `standard_name`, else by `positive`, else
    by the variable's name (elevation, z: up; h, depth: down). Where nothing gives it, values of both signs,
    or negative ones alone, in the area and 64 rows of the whole source are heights, with a note; else it is
    asked for. Units are m, km, cm, fathoms or ft. A pixel is NaN where one of the values that bear on its
    centre is missing. Of NetCDF only the window that is needed is read.

    Args:
        source: a path of NetCDF-3 or -4, or of a raster of one band (`read_raster`); or an xarray object with
            coordinates as `auvplan.io.geo.nodes` describes them. An array without a name, units and sense is
            elevation in metres, positive up.
        site: where local coordinates count from.
        extent: of the raster; without a size of pixels, half the source's spacing, from 10 to 500 m and at
            most 1024 pixels a side.
        variable: name of the variable in a NetCDF file or dataset.
        positive: "up" or "down", which way the values count, where the source does not give it.
        crs: coordinate reference system of x and y where the source has none.
        keep_shoals: False for what is interpolated at the pixels' centres and nothing else.

    Raises:
        GeoError: one line; what is wrong with the source, that the sense of its values is not known, or on
            which side and by how much the rectangle reaches beyond its outer cells.
    """
    if positive not in (None, "up", "down"):
        raise GeoError(f'positive must be "up" or "down", got {positive!r}')
    path, notes = label(source), []
    with reading(path):
        # Where no size is given these pixels only stand for the rectangle.
        grid = extent.grid(None)
        with _opened(path, source, variable, crs, notes) as array:
            what = f"{path}: {array.name or 'the band'}"
            array, nodes = placed(what, array, site, grid, crs)
            view = View(nodes, site, grid)
            view.refuse_beyond(path, "data", 0.5 + 1e-6)
            if extent.pixel_size is None:
                spacing = float(np.nanmin(np.hypot(*view.steps().T)))
                size = float(np.clip(spacing / 2, SMALLEST_PIXEL, LARGEST_PIXEL))
                longest = max(b - a for a, b in zip(grid.lower, grid.upper, strict=True))
                grid = extent.grid(max(size, longest / MOST_PIXELS))
            window = _window(path, view, grid)
            values = _load(array, *window)
            if not np.isfinite(values).any():
                raise GeoError(f"{what} has no values in the area")
            sense = _sense(what, array, values, positive, notes)
        unit = str(array.attrs.get("units", "")).strip()
        if not unit:
            notes.append("units are not given: metres")
        if (metres := length_factor(unit.rstrip(".")) if unit else 1.0) is None:
            raise GeoError(f"{what} is in {unit!r}, not in m, km, cm, fathoms or ft")
        values = _without_sentinels(values * metres, notes)
        depth, finer = np.empty(grid.shape, np.float32), np.zeros(grid.shape, bool)
        nodes = sense * values
        for rows, north, east in grid.blocks(around=True):
            row, column = view.find(north, east)
            row, column = row - window[0], column - window[2]
            depth[rows] = bilinear(nodes, row[1:-1, 1:-1], column[1:-1, 1:-1])
            if keep_shoals and (own := closer(row, column)).any():
                finer[rows] = own
                np.minimum(depth[rows], least_around(nodes, row, column), out=depth[rows], where=own)
        if keep_shoals and not finer.all():
            first, last, left, right = window
            own = np.meshgrid(np.arange(first, last + 1), np.arange(left, right + 1), indexing="ij")
            lower = fall_between(depth, *view.pixels(grid, *own), nodes)
            # The outer pixels hold up to the edges of the area.
            sides = grid.outline(centres=True)
            row, column = view.find(*sides)
            edge = fall(depth, *grid.indices(*sides), bilinear(nodes, row - first, column - left))
            depth -= np.where(finer, 0.0, np.maximum(lower, edge))
    if finer.any():
        size = f"pixels of {grid.pixel_size:g} m"
        notes.append(f"its data is finer than the {size}: each has the shallowest depth within a pixel of it")
    if unknown := int(np.isnan(depth).sum()):
        notes.append(f"{unknown} of {depth.size} pixels have no depth: NaN")
    if not (depth > 0.0).any():
        notes.append("no pixel lies below the sea surface")
    return Bathymetry(depth, grid.lower, grid.pixel_size, tuple(notes))


@contextmanager
def _opened(
    path: str, source: Source | xr.Dataset, variable: str | None, crs: Any, notes: list[str]
) -> Iterator[xr.DataArray]:
    """Open the array of a sea floor with its coordinates; values are not read yet."""
    if isinstance(source, xr.DataArray):
        yield source if source.name else source.rename(_UP[0])
        return
    if isinstance(source, xr.Dataset):
        yield _chosen(path, source, variable, notes)
        return
    with Path(source).open("rb") as file:
        start = file.read(4)
    if not start:
        raise GeoError(f"{path}: is empty, neither NetCDF nor a raster")
    if start[:3] == b"CDF" or (start == b"\x89HDF" and Path(source).suffix.lower() != ".bag"):
        with open_lazily(path, GeoError) as dataset:
            yield _chosen(path, dataset, variable, notes)
        return
    array = read_raster(source, crs, numbers=True)
    if array.ndim != 2:
        raise GeoError(f"{path}: three bands are colours, not depths")
    if variable not in (None, array.name):
        raise GeoError(f"{path}: a raster has no variable {variable!r}")
    yield array


def _chosen(path: str, dataset: xr.Dataset, wanted: str | None, notes: list[str]) -> xr.DataArray:
    """Return the variable of the sea floor with the dataset's coordinates."""
    name = _name(path, dataset, notes) if wanted is None else wanted
    if name not in dataset.variables:
        raise GeoError(f"{path}: no variable {name!r}; it has {listed(dataset.variables)}")
    variable = dataset.variables[name]
    if variable.ndim > 2:
        variable = variable.squeeze()
    if variable.ndim != 2:
        raise GeoError(f"{path}: {name} has dimensions {listed(variable.dims)}, not two")
    mapping = variable.attrs.get("grid_mapping", variable.encoding.get("grid_mapping", "spatial_ref"))
    coordinates = {
        other: axis
        for other, axis in dataset.variables.items()
        if other != name and set(axis.dims) <= set(variable.dims) and (axis.ndim or other == mapping)
        if axis.ndim != 2 or _is_axis(dataset, other) or other == "mask_rho"
    }
    if "mask_rho" in coordinates:
        notes.append("where mask_rho is 0 the sea floor was taken as unknown")
    return xr.DataArray(variable, coordinates, name=name)


def _is_axis(dataset: xr.Dataset, name: Any) -> bool:
    return any(is_degrees(name, dataset.variables[name].attrs, kind) for kind in ("longitude", "latitude"))


def _name(path: str, dataset: xr.Dataset, notes: list[str]) -> Any:
    """Return the name of the variable of the sea floor."""
    flat = {
        name: variable.attrs.get("standard_name", "")
        for name, variable in dataset.variables.items()
        if sum(size > 1 for size in variable.shape) == 2
        and variable.dtype.kind in "iuf"
        and not _is_axis(dataset, name)
    }
    names = {str(name).lower(): name for name in reversed(flat)}
    spelt_out = tuple(name for name in names if name.startswith(_SPELT_OUT))
    found = [name for name, standard in flat.items() if _sense_of_standard_name(standard)]
    found = found or [names[name] for name in (*_UP, *_DOWN, *spelt_out, *_UNSIGNED) if name in names]
    if len(found) > 1:
        notes.append(f"{found[0]} was taken, not {listed(found[1:])}")
    elif not found and len(flat) == 1:
        found = list(flat)
        notes.append(f"{found[0]} was taken for the sea floor, being the only grid")
    if not found:
        raise GeoError(
            f"{path}: no variable is known for a sea floor: name one of {listed(dataset.variables)}"
        )
    return found[0]


def _load(array: xr.DataArray, first: int, last: int, left: int, right: int) -> Array:
    """[rows, columns] of a window in the source's own units and sense, NaN where there is no value.

    Columns beyond the last one count on from the first.
    """
    columns = array.shape[1]
    # In stretches: a window across the antimeridian is two of them.
    breaks = [left, *range(left - left % columns + columns, right + 1, columns), right + 1]
    parts = []
    for a, b in pairwise(breaks):
        part = array[first : last + 1, a % columns : a % columns + b - a]
        raw, attributes = part.values, array.attrs
        values = raw * float(attributes.get("scale_factor", 1.0)) + float(attributes.get("add_offset", 0.0))
        missing = raw == attributes.get("_FillValue", np.nan)
        if "mask" in part.coords:
            missing |= part.coords["mask"].values == 0
        parts.append(np.where(missing, np.nan, values))
    return np.concatenate(parts, axis=1)


def _window(path: str, view: View, grid: LocalGrid) -> tuple[int, int, int, int]:
    """First and last row, first and last column, of the nodes that bear on a grid."""
    spans = []
    for _, north, east in grid.blocks(around=True):
        row, column = view.find(north, east)
        if not np.isnan(row).all():
            spans.append((np.nanmin(row), np.nanmax(row), np.nanmin(column), np.nanmax(column)))
    low, high = np.min(spans, axis=0), np.max(spans, axis=0)
    first, left = int(np.floor(low[0])), int(np.floor(low[2]))
    last, right = int(np.ceil(high[1])), int(np.ceil(high[3]))
    rows, columns = view.nodes.shape
    first, last = (min(max(k, 0), rows - 1) for k in (first, last))
    if not view.nodes.cyclic:
        left, right = (min(max(k, 0), columns - 1) for k in (left, right))
    if (last - first + 1) * (right - left + 1) > MAX_PIXELS:
        raise GeoError(f"{path}: the area holds more than {MAX_PIXELS} values")
    return first, last, left, right


def _without_sentinels(values: Array, notes: list[str]) -> Array:
    """NaN for numbers that stand for none without the file saying so; metres."""
    with np.errstate(invalid="ignore"):
        odd = (np.abs(values) > _EXTREME) | np.isin(values, _SENTINELS)
    if count := int(odd.sum()):
        such = f"such as {values[odd][0]:g} m"
        notes.append(f"{count} values that no sea floor has, {such}, were taken as missing")
    return np.where(odd, np.nan, values)


def _sense_of_standard_name(name: Any) -> str | None:
    """Return "up" or "down" where a CF standard name gives it."""
    name = str(name).lower()
    if name == "depth" or name.startswith("depth_below") or "sea_floor_depth" in name:
        return "down"
    if name == "height" or name.startswith("height_above") or name.endswith("altitude"):
        return "up"
    return None


def _sense(what: str, array: xr.DataArray, values: Array, positive: str | None, notes: list[str]) -> float:
    """Return the factor that makes values positive down."""
    stated = {}
    attribute = str(array.attrs.get("positive", "")).strip().lower()
    if attribute in ("up", "down"):
        stated["its attribute positive"] = attribute
    standard = array.attrs.get("standard_name", "")
    if sense := _sense_of_standard_name(standard):
        stated[f"its standard_name {standard}"] = sense
    if positive is not None:
        stated["the argument positive"] = positive
    if len(set(stated.values())) > 1:
        sources = ", ".join(f"{source} says {sense}" for source, sense in stated.items())
        raise GeoError(f"{what} has a contradictory sign convention: {sources}")
    name = str(array.name or "").lower()
    if not stated and (name in (*_UP, *_DOWN) or name.startswith(_SPELT_OUT)):
        stated["its name"] = "up" if name in _UP else "down"
    if stated:
        source, sense = next(iter(stated.items()))
        if sense == "down" and positive is None and (values[np.isfinite(values)] < 0.0).all():
            raise GeoError(
                f'{what} is positive down by {source}, but all its values are negative: say positive="up"'
            )
        return 1.0 if sense == "down" else -1.0
    # The area, and evenly spaced rows of the whole source.
    rows, columns = array.shape
    sample = [values.ravel()]
    for row in np.unique(np.linspace(0, rows - 1, min(rows, _ROWS)).astype(int)).tolist():
        sample.append(_load(array, row, row, 0, columns - 1).ravel())
    known = np.concatenate(sample)
    known = known[np.isfinite(known) & ~np.isin(known, _SENTINELS)]
    least, most = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    if most <= 0.0 or (least < 0.0 and not name.startswith("bathy") and "depth" not in name):
        kind = "of both signs" if most > 0.0 else "negative"
        notes.append(f"{array.name or 'the band'} was taken as positive up: its values are {kind}")
        return -1.0
    raise GeoError(
        f"{what} does not give whether its values, {least:g} to {most:g}, are heights or depths: say "
        'positive="up" or "down" (bathymetry.positive)'
    )
