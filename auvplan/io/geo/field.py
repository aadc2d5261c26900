"""Sea floor grids of NetCDF files: which variable, and where its values lie (CF conventions)."""

import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator

from auvplan.files import require_whole
from auvplan.io.currents.geometry import Curvilinear
from auvplan.io.geo.error import GeoError
from auvplan.io.geo.grid import LocalGrid, Nodes
from auvplan.ocean.picture import MAX_PIXELS
from auvplan.site import Site

Array = NDArray[np.floating]

#: Names of variables by which the sense of their values is known, in the order in which they are looked for.
UP = ("elevation", "z", "topo", "topography", "altitude")
DOWN = ("deptho", "h", "depth", "bottom_depth", "water_depth")
#: So begin the names that are standard names; they count down.
SPELT_OUT = "sea_floor_depth"
UNTOLD = ("bathymetry", "bathy", "bathymetrie", "depth_average", "band1", "height")
# Units and names of coordinates (CF section 4.1 and 4.2), and the name that a plain grid gives them.
_AXES = {
    "longitude": (
        ("degree_east", "degree_e", "degreee"),
        re.compile(r"(nav_)?lon(gitude)?(_\w+)?", re.IGNORECASE),
        "x",
    ),
    "latitude": (
        ("degree_north", "degree_n", "degreen"),
        re.compile(r"(nav_)?lat(itude)?(_\w+)?", re.IGNORECASE),
        "y",
    ),
}
# Nodes of a grid of two-dimensional coordinates that are looked through at most.
_SCATTERED = 1_000_000


@dataclass(frozen=True)
class Field:
    """A variable of a file.

    Attributes:
        name: of the variable; empty where the file tells none.
        attributes: of the variable.
        nodes: where its values lie.
        load: first and last row, first and last column to [rows, columns] float64 in the file's own sense and
            units, NaN where there is no value. Columns beyond the last one count on from the first if the
            nodes are cyclic.
        notes: what is to be noted of it.
    """

    name: str
    attributes: dict[str, Any]
    nodes: Nodes
    load: Callable[[int, int, int, int], Array]
    notes: tuple[str, ...] = ()


def sense_of_standard_name(name: str) -> str | None:
    """Return "up" or "down" where a CF standard name tells it."""
    name = name.lower()
    if name == "depth" or name.startswith("depth_below") or "sea_floor_depth" in name:
        return "down"
    if name == "height" or name.startswith("height_above") or name.endswith("altitude"):
        return "up"
    return None


@contextmanager
def netcdf_field(path: Path, variable: str | None, site: Site, grid: LocalGrid) -> Iterator[Field]:
    """The sea floor in a NetCDF file, open while the context lasts.

    Args:
        path: NetCDF-3 or -4.
        variable: its name; None looks for a known standard name, then for a known name.
        site: where local coordinates count from.
        grid: where values will be wanted, which is what two-dimensional coordinates are searched for.

    Raises:
        GeoError: no such variable, or coordinates that are no longitude and latitude. What else xarray
            raises on a damaged file is passed on.
    """
    with path.open("rb") as file:
        start = file.read(4)
    if start[:3] == b"CDF":
        engine = "scipy"
    elif start == b"\x89HDF":
        engine = "h5netcdf"
    else:
        raise GeoError(f"{path}: neither NetCDF nor GeoTIFF")
    require_whole(path, GeoError)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of odd attributes, which is the reader's affair
        with xr.open_dataset(
            path, engine=engine, decode_times=False, decode_timedelta=False, create_default_indexes=False
        ) as dataset:
            array, notes = _chosen(path, dataset, variable)
            for name in [str(d) for d in array.dims if array.sizes[d] == 1 and array.ndim > 2]:
                array = array.isel({name: 0}, drop=True)
            if array.ndim != 2:
                raise GeoError(f"{path}: {array.name} has dimensions {_listed(array.dims)}, not two")
            field = _placed(path, dataset, array, site, grid)
            yield replace(field, notes=notes + field.notes)


def _chosen(path: Path, dataset: xr.Dataset, wanted: str | None) -> tuple[xr.DataArray, tuple[str, ...]]:
    if wanted is not None:
        if wanted not in dataset.variables:
            raise GeoError(f"{path}: no variable {wanted!r}; it has {_listed(dataset.variables)}")
        return dataset[wanted], ()
    flat = [
        dataset[name]
        for name, variable in dataset.variables.items()
        if sum(size > 1 for size in variable.shape) == 2
        and variable.dtype.kind in "iuf"
        and _axis_kind(dataset, name) is None
    ]
    stated = [array for array in flat if sense_of_standard_name(str(array.attrs.get("standard_name", "")))]
    names = {str(array.name).lower(): array for array in flat[::-1]}
    spelt_out = tuple(name for name in names if name.startswith(SPELT_OUT))
    known = [names[name] for name in (*UP, *DOWN, *spelt_out, *UNTOLD) if name in names]
    for found in (stated, known):
        if found:
            others = [str(array.name) for array in found[1:]]
            more = (f"{found[0].name} was taken, not {_listed(others)}",) if others else ()
            return found[0], more
    if len(flat) == 1:
        return flat[0], (f"{flat[0].name} was taken for the sea floor, being the only grid",)
    raise GeoError(f"{path}: no variable is known for a sea floor: name one of {_listed(dataset.variables)}")


def _placed(path: Path, dataset: xr.Dataset, array: xr.DataArray, site: Site, grid: LocalGrid) -> Field:
    axes = {
        kind: [
            name
            for name, variable in dataset.variables.items()
            if _axis_kind(dataset, name) == kind and variable.ndim and set(variable.dims) <= set(array.dims)
        ]
        for kind in ("longitude", "latitude")
    }
    what = f"{path}: {array.name}"
    for kind, found in axes.items():
        if not found:
            dims = _listed(array.dims)
            raise GeoError(f"{what} has no {kind} on its dimensions {dims}: use gdalwarp -t_srs EPSG:4326")
    longitude, latitude = (dataset[axes[kind][0]] for kind in ("longitude", "latitude"))
    if longitude.ndim == latitude.ndim == 1 and longitude.dims != latitude.dims:
        array = array.transpose(*latitude.dims, *longitude.dims)
        x = _regular_columns(what, np.asarray(longitude.values, float))
        columns = x.size
        y = np.asarray(latitude.values, float)
        _check_axis(f"{what}: latitude", y)
        if np.abs(y).max() > 90.001:
            raise GeoError(f"{what}: latitude reaches beyond 90 degrees")
        step = abs(x[-1] - x[0]) / (x.size - 1)

        def find(longitude: Array, latitude: Array) -> tuple[Array, Array]:
            return _index(y, latitude), _index(x, longitude)

        cyclic = abs(step * x.size - 360.0) < 0.01 * step
        nodes = Nodes(find, (y.size, x.size), float((x[0] + x[-1]) / 2), cyclic)
    elif longitude.ndim == latitude.ndim == 2 and set(longitude.dims) == set(latitude.dims) == set(
        array.dims
    ):
        places = (axis.transpose(*array.dims).values.astype(float) for axis in (longitude, latitude))
        nodes, columns = _scattered(what, *places, site=site, grid=grid), array.shape[1]
    else:
        raise GeoError(f"{what}: longitude and latitude are neither two axes nor two grids of its dimensions")
    mask = dataset.get("mask_rho")
    land = mask.transpose(*array.dims) if mask is not None and set(mask.dims) == set(array.dims) else None

    def load(first: int, last: int, left: int, right: int) -> Array:
        # Read in stretches: a window across the seam is two of them.
        breaks = [left, *range(left - left % columns + columns, right + 1, columns), right + 1]
        parts = []
        for a, b in pairwise(breaks):
            window = np.s_[first : last + 1, a % columns : a % columns + b - a]
            part = np.asarray(array[window].values, float)
            parts.append(
                part if land is None else np.where(np.asarray(land[window].values) == 0, np.nan, part)
            )
        return np.concatenate(parts, axis=1)

    notes = ("where mask_rho is 0 the sea floor was taken as unknown",) if land is not None else ()
    return Field(str(array.name), dict(array.attrs), nodes, load, notes)


def _regular_columns(what: str, x: Array) -> Array:
    """Continuous longitudes, of one turn at most."""
    if not np.isfinite(x).all():
        raise GeoError(f"{what}: longitude has values that are not finite")
    x = np.unwrap(x, period=360.0)
    if x.size > 2 and abs(x[-1] - x[0]) > 360.0 - 1e-6:
        x = x[:-1]  # the meridian of the seam is given twice
    _check_axis(f"{what}: longitude", x)
    if np.abs(x).max() > 720.0 or abs(x[-1] - x[0]) > 360.0:
        raise GeoError(f"{what}: longitude runs from {x[0]:g} to {x[-1]:g}, which are no degrees")
    return x


def _check_axis(what: str, axis: Array) -> None:
    if axis.size < 2:
        raise GeoError(f"{what} has {axis.size} value, at least two are needed")
    steps = np.diff(axis)
    if not np.isfinite(axis).all() or not ((steps > 0).all() or (steps < 0).all()):
        raise GeoError(f"{what} neither rises nor falls throughout")


def _index(axis: Array, at: Array) -> Array:
    """Fractional index along a monotonic axis, going on beyond its ends at the pace of its ends."""
    if axis[0] > axis[-1]:
        axis, at = -axis, -at
    last = axis.size - 1
    inside = np.interp(at, axis, np.arange(axis.size, dtype=float))
    before, after = (at - axis[0]) / (axis[1] - axis[0]), last + (at - axis[-1]) / (axis[-1] - axis[-2])
    return np.where(at < axis[0], before, np.where(at > axis[-1], after, inside))


def _scattered(what: str, longitude: Array, latitude: Array, *, site: Site, grid: LocalGrid) -> Nodes:
    """Return nodes of two-dimensional coordinates.

    Row and column are interpolated on triangles of local metres.
    """
    north, east = site.to_local(longitude, np.clip(latitude, -90.0, 90.0))
    known = np.isfinite(north) & np.isfinite(east) & (np.abs(latitude) <= 90.0)
    if known.sum() < 4 or min(longitude.shape) < 2:
        raise GeoError(f"{what}: its longitudes and latitudes are no grid")
    if Curvilinear(("row", "column"), np.asarray(longitude, float), np.asarray(latitude, float)).folds:
        raise GeoError(f"{what}: its longitudes and latitudes contradict each other, the grid folds")
    middle = (np.asarray(grid.lower) + np.asarray(grid.upper)) / 2
    gap = np.where(known, np.hypot(north - middle[0], east - middle[1]), np.inf)
    i, j = np.unravel_index(np.argmin(gap), gap.shape)
    around = gap[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]
    reach = np.hypot(*(np.asarray(grid.upper) - grid.lower)) / 2 + 4 * np.max(
        around, where=np.isfinite(around), initial=0.0
    )
    rows, columns = np.nonzero(gap <= reach)
    part = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    count = known[part].sum()
    if count > min(_SCATTERED, MAX_PIXELS):
        raise GeoError(f"{what}: {count} nodes lie about the area, more than {_SCATTERED}")
    r, c = np.nonzero(known[part])
    index = np.stack([r + rows.min(), c + columns.min()], axis=-1).astype(float)
    try:
        lookup = LinearNDInterpolator(np.stack([north[part][r, c], east[part][r, c]], axis=-1), index)
    except Exception:
        raise GeoError(f"{what}: its longitudes and latitudes are no grid") from None

    def find(longitude: Array, latitude: Array) -> tuple[Array, Array]:
        found = lookup(*site.to_local(longitude, latitude))
        return found[..., 0], found[..., 1]

    return Nodes(find, longitude.shape)  # type: ignore[arg-type]


def _axis_kind(dataset: xr.Dataset, name: Any) -> str | None:
    """Return "longitude" or "latitude" where a variable is one, by standard name, units or its own name."""
    attributes = dataset.variables[name].attrs
    standard = str(attributes.get("standard_name", "")).lower()
    if standard:
        return standard if standard in _AXES else None
    unit = str(attributes.get("units", "")).lower().replace("degrees", "degree")
    for kind, (units, names, bare) in _AXES.items():
        if (
            unit in units
            or names.fullmatch(str(name))
            or (str(name).lower() == bare and unit in ("", "degree"))
        ):
            return kind
    return None


def _listed(names: Any) -> str:
    every = [str(name) for name in names]
    return ", ".join(every[:12]) + (" ..." if len(every) > 12 else "")
