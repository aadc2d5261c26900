"""Land, closed areas and sea bed of the files that a scenario names, by pyogrio, rasterio and xarray."""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import shapely
import xarray as xr
from pyproj import Transformer

from auvplan.check.saved import Array, Saved
from auvplan.check.track import Mask
from auvplan.runtime.files import ResultError, require_whole

#: m below a sea bed that is interpolated otherwise than the planner's that are no fault.
_TOLERANCE = 0.5
#: Units of sea beds, m.
_METRES = {
    **dict.fromkeys(("", "m", "metre", "metres", "meter", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet"), 0.3048),
    **dict.fromkeys(("us survey foot", "us-ft"), 1200.0 / 3937.0),
    **dict.fromkeys(("fathom", "fathoms"), 1.8288),
    **{"cm": 0.01, "dm": 0.1, "km": 1000.0},
}
#: From longitude, latitude, degrees, and depth, m, [n] each, to [n] whether there is land or bed.
Blocked = Callable[[Array, Array, Array], Mask]


@dataclass(frozen=True)
class Source:
    """A file: its name, whether it holds "land" or the "sea bed", and where that is."""

    name: str
    kind: str
    blocked: Blocked


class _UnknownFileError(Exception):
    """A file that cannot be judged here; the message says why."""


def read_sources(run: Saved) -> tuple[Source, ...]:
    """Return land and sea bed of the files that its scenario names; notes say which are not looked at."""
    if "site_longitude" not in run.data.attrs:
        return ()
    found, home = [], Path(str(run.data.attrs["scenario_folder"]))
    for name, kind, read in _files(run):
        path = home / Path(name).expanduser()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of odd attributes
                found.append(Source(path.name, kind, read(str(path))))
        except ImportError as error:
            run.notes.append(f"{kind} of {path.name} was not looked at: {error.name} is not installed")
        except Exception as error:  # whatever this view lacks is no fault of the run
            why = str(error) if isinstance(error, _UnknownFileError) else f"{type(error).__name__}: {error}"
            run.notes.append(f"{kind} of {path.name} was not looked at: {' '.join(why.split())}")
    return tuple(found)


def _files(run: Saved) -> Iterator[tuple[str, str, Callable[[str], Blocked]]]:
    """Yield the files of a scenario, "land" or "sea bed", and how each is read."""

    def unread(path: str) -> Blocked:
        raise _UnknownFileError("pictures, S-57 cells and files of currents are not looked at")

    chart, bed, current = (run.section(name) for name in ("chart", "bathymetry", "current"))
    files = current.get("files") or []
    files = ([files] if isinstance(files, str) else files)[:1]
    if chart.get("source") == "polygons":
        yield chart["file"], "land", lambda path: _inside(path)
    elif name := chart.get("file") or chart.get("image"):
        yield name, "land", unread
    if chart.get("no_go") and not chart.get("no_go_windows"):
        yield chart["no_go"], "land", lambda path: _inside(path, always=True)
    if bed.get("source") == "chart":
        yield chart["file"], "sea bed", unread
    elif bed.get("source") == "file":
        yield bed["file"], "sea bed", lambda path: _below(path, bed)
    for kind, section in (("land", chart), ("sea bed", bed)):
        if section.get("source") == "current":
            yield from ((name, kind, unread) for name in files)


def _inside(path: str, always: bool = False) -> Blocked:
    """Return where a file has polygons; `always`: those alone that have no hours."""
    from pyogrio import list_layers, raw

    if path.endswith(".zip"):
        with ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.endswith((".shp", ".gpkg", ".fgb"))]
        if len(names) != 1:
            raise _UnknownFileError(f"its archive holds {len(names)} files of polygons")
        path = f"/vsizip/{{{Path(path).absolute()}}}/{names[0]}"
    flat = ("Point", "Line", "None")
    layers = [str(name) for name, kind in list_layers(path) if not any(word in str(kind) for word in flat)]
    meta, _, geometries, columns = raw.read(path, layer=layers[0], force_2d=True)
    fields = zip((str(name).strip().lower() for name in meta["fields"]), columns, strict=True)
    stated = [column for name, column in fields if name in ("from", "to", "windows")]
    shapes = shapely.from_wkb(geometries)
    hours = [any(column[row] not in (None, "") for column in stated) for row in range(len(shapes))]
    kept = [one for one, timed in zip(shapes, hours, strict=True) if one and not (always and timed)]
    parts = [shapely.make_valid(part) for one in kept for part in shapely.get_parts(one)]
    union = shapely.union_all([part for part in parts if "Polygon" in part.geom_type])
    shapely.prepare(union)
    turn = Transformer.from_crs("EPSG:4326", meta["crs"] or "EPSG:4326", always_xy=True)

    def inside(longitude: Array, latitude: Array, depth: Array) -> Mask:
        places = [turn.transform(longitude + around, latitude) for around in (-360.0, 0.0, 360.0)]
        return np.any([shapely.contains_xy(union, *place) for place in places], axis=0)

    return inside


def _below(path: str, settings: dict[str, Any]) -> Blocked:
    """Return where places lie below a sea bed, linear between the file's values, at its lowest water."""
    with open(path, "rb") as file:
        raster = file.read(3) not in (b"CDF", b"\x89HD") or path.lower().endswith(".bag")
    grid, places = (_of_raster if raster else _of_axes)(path, settings)
    level = float(settings.get("water_level") or 0.0)

    def below(longitude: Array, latitude: Array, depth: Array) -> Mask:
        bed = np.full(len(longitude), np.nan)
        for around in (-360.0, 0.0, 360.0):
            at = zip(grid.dims, places(longitude + around, latitude), strict=True)
            values = grid.interp({dim: xr.DataArray(place, dims="point") for dim, place in at}).values
            bed = np.where(np.isnan(bed), values, bed)
        return np.isfinite(bed) & (-depth < bed - level - _TOLERANCE)

    return below


#: From longitude and latitude, degrees, to coordinates of a grid of heights.
_Places = Callable[[Array, Array], tuple[Array, Array]]


def _of_axes(path: str, settings: dict[str, Any]) -> tuple[xr.DataArray, _Places]:
    """Return heights, m, of a NetCDF file with axes of longitude and latitude."""
    require_whole(path, ResultError)
    with xr.open_dataset(path, decode_times=False) as file:
        data = file.load()
    flat = [str(k) for k, v in data.data_vars.items() if sum(size > 1 for size in v.shape) == 2]
    if settings.get("variable") is None and len(flat) != 1:
        raise _UnknownFileError("it holds several grids")
    grid = data[settings.get("variable") or flat[0]].squeeze(drop=True)
    axes = [dim for word in ("lat", "lon") for dim in grid.indexes if str(dim).lower().startswith(word)]
    if len(axes) != 2 or grid.ndim != 2:
        raise _UnknownFileError("it has no axes of longitude and latitude")
    grid = grid.transpose(*axes).sortby(axes)
    heights = _upward(np.asarray(grid.values, float), grid.attrs, str(grid.name), settings)
    return grid.copy(data=heights), lambda longitude, latitude: (latitude, longitude)


def _of_raster(path: str, settings: dict[str, Any]) -> tuple[xr.DataArray, _Places]:
    """Return heights, m, of a raster of one band."""
    import rasterio

    with rasterio.open(path) as file:
        system = file.crs or settings.get("crs")
        if system is None or file.transform.is_identity:
            raise _UnknownFileError("its place on Earth is not in its own tags")
        if file.count != 1 and file.driver != "BAG":
            raise _UnknownFileError(f"it has {file.count} bands")
        values = file.read(1, masked=True).astype(float).filled(np.nan) * file.scales[0] + file.offsets[0]
        stated = {"units": file.units[0] or ""} | file.tags(1)
        vertical = str(file.crs.to_wkt()).upper().split("VERT_CS")[1:] if file.crs is not None else []
        if file.driver == "GTiff" and "DOWN" in "".join(vertical):  # a BAG keeps heights in such a system
            stated["positive"] = "down"
        heights = _upward(values, stated, file.descriptions[0] or "", settings)
        turn = Transformer.from_crs("EPSG:4326", system, always_xy=True)
        a, b, c, d, e, f = tuple(~file.transform)[:6]

    def places(longitude: Array, latitude: Array) -> tuple[Array, Array]:
        x, y = turn.transform(longitude, latitude)
        return d * x + e * y + f - 0.5, a * x + b * y + c - 0.5

    sizes = {dim: np.arange(size) for dim, size in zip(("row", "column"), heights.shape, strict=True)}
    return xr.DataArray(heights, sizes, ("row", "column")), places


def _upward(values: Array, stated: Any, name: str, settings: dict[str, Any]) -> Array:
    """Return values as heights, m; NaN where there is none."""
    stated = {str(key).lower(): value for key, value in stated.items()}
    unit = str(stated.get("units", "m")).lower()
    if unit not in _METRES:
        raise _UnknownFileError(f"its unit is {unit!r}")
    values = values * _METRES[unit]
    values = np.where(np.abs(values) < 12_000.0, values, np.nan)
    name = str(stated.get("standard_name", name)).lower()
    up = settings.get("positive") or stated.get("positive")
    if up is None and ("depth" in name or name == "h"):
        up = "down"
    elif up is None and name not in ("elevation", "z", "topo", "height", "altitude", "topography"):
        up = "up" if np.nanmin(values) < 0.0 else "down"
    return -values if up == "down" else values
