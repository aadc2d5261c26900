"""The checker's own view of a run's sources: land and sea bed as the scenario's files have them.

It reads them with xarray, shapely, pyproj and pyogrio alone and shares no code with the readers of the
planner, so that a file which those misread does not vouch for itself.
"""

import json
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import shapely
import shapely.geometry
import xarray as xr
from pyproj import Transformer

from auvplan.io.enc import bed_of_cells, blocked_by_cells
from auvplan.io.hours import closed_at
from auvplan.io.originals import matching, opened, path_of
from auvplan.io.walk import Array, Mask

#: What files of polygons begin with that are no GeoJSON: GeoPackage, FlatGeobuf, Shapefile.
_VECTORS = b"SQLite format 3", b"fgb", b"\0\0\x27\x0a"
# An edge of a projection of so many metres is straight in degrees too.
_STRAIGHT = 500.0
#: Metres below a sea bed that is interpolated otherwise than the planner's that are no fault.
_TOLERANCE = 0.5
_CELLS = ("nv", "SCHISM_hgrid_face_nodes", "ele", "elem", "element", "tri")
_EAST = ("eastward_sea_water_velocity", "sea_water_x_velocity", "x_sea_water_velocity")
_EAST_NAMES = ("uo", "u", "water_u", "u_eastward", "utotal")
_POSITIVE = {"up": 1.0, "down": -1.0}
#: Files are taken as they are: no times, no axes.
_PLAIN = {"decode_times": False, "create_default_indexes": False}


@dataclass(frozen=True)
class Source:
    """A file that tells where a vehicle cannot be.

    Attributes:
        name: as faults name it.
        kind: "land", "sea bed" or "closed area".
        blocked: longitude, latitude, degrees, and depth, m, [n] each, to [n] where there is land or bed, or
            where the area is.
        closed: times, [n] s since the departure, to [n] when it is closed; None for always.
    """

    name: str
    kind: str
    blocked: Callable[[Array, Array, Array], Mask]
    closed: Callable[[Array], Mask] | None = None


class _UnknownFileError(Exception):
    """A file that this view cannot judge; the message says why."""


def read_sources(dataset: xr.Dataset, notes: list[str]) -> tuple[Source, ...]:
    """Return what the files of a saved run's scenario tell of land and sea bed.

    Args:
        dataset: of the run.
        notes: get a line for each file that cannot be looked at, and why.
    """
    settings = json.loads(str(dataset.attrs["scenario"]))
    if "site_longitude" not in dataset.attrs:
        return ()
    found = []
    for names, kind, read in _files(settings):
        paths = [str(path_of(dataset, name)) for name in names]
        label = ", ".join(Path(path).name for path in paths)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of odd attributes
                found.append(Source(label, kind, read(paths)))
        except (
            Exception
        ) as error:  # the run was planned on it: whatever this view lacks is no fault of the run
            why = str(error) if isinstance(error, _UnknownFileError) else f"{type(error).__name__}: {error}"
            notes.append(f"{kind} of {label} was not looked at again: {' '.join(why.split())}")
    try:
        found += _closed_areas(settings, dataset)
    except FileNotFoundError:
        pass  # reported above
    except Exception as error:  # as above
        why = " ".join(f"{type(error).__name__}: {error}".split())
        notes.append(f"hours of closed areas were not looked at again: {why}")
    return tuple(found)


def _closed_areas(settings: dict[str, Any], dataset: xr.Dataset) -> Iterator[Source]:
    """Yield the areas of a scenario that are closed at some hours."""
    chart = settings.get("chart") or {}
    if not chart.get("no_go"):
        return
    for feature, hours in _zones(str(path_of(dataset, chart["no_go"])), chart):
        if hours:
            name = str((feature.get("properties") or {}).get("name") or chart["no_go"])
            yield Source(name, "closed area", _inside(feature), partial(closed_at, hours, dataset))


def _zones(path: str, chart: dict[str, Any]) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield the features of a file of closed areas, and when they are closed; nothing for always."""
    root = _root(path)
    common = {"windows": chart["no_go_windows"]} if chart.get("no_go_windows") else {}
    for feature in root.get("features", [root]):
        stated = {str(key).strip().lower(): value for key, value in (feature.get("properties") or {}).items()}
        own = {key: stated[key] for key in ("from", "to", "windows") if stated.get(key) not in (None, "")}
        yield feature, own or common


def _files(settings: dict[str, Any]) -> Iterator[tuple[list[str], str, Callable[[list[str]], Any]]]:
    """Yield the files of a scenario, what they tell, and how they are read."""
    chart, bed, current = (settings.get(name) or {} for name in ("chart", "bathymetry", "current"))
    files = current.get("files") or []
    files = [files] if isinstance(files, str) else list(files)
    if chart.get("source") == "polygons":
        yield [chart["file"]], "land", _polygons
    if chart.get("source") == "enc":
        yield [chart["file"]], "land", lambda paths: blocked_by_cells(paths[0], chart)
    if chart.get("no_go"):
        yield [chart["no_go"]], "land", lambda paths: _always_closed(paths, chart)
    if chart.get("source") == "current":
        yield files, "land", _dry
    if bed.get("source") == "chart":
        low = float(bed.get("water_level") or 0.0)
        yield [chart["file"]], "sea bed", lambda paths: bed_of_cells(paths[0], low)
    if bed.get("source") == "file":
        yield [bed["file"]], "sea bed", lambda paths: _bed(paths[0], bed)


def _polygons(paths: list[str]) -> Callable[[Array, Array, Array], Mask]:
    """Inside the polygons of a GeoJSON, GeoPackage, Shapefile or FlatGeobuf."""
    return _inside(_root(paths[0]))


def _root(path: str) -> dict[str, Any]:
    """Return GeoJSON; what is of another format as GeoJSON of its first layer of polygons.

    Raises:
        _UnknownFileError: it is of none of these formats.
    """
    with open(path, "rb") as binary:
        start = binary.read(64)
    if start.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"{"):
        with open(path, encoding="utf-8-sig") as file:
            return json.load(file)
    if not start.startswith(_VECTORS):
        raise _UnknownFileError("it is neither a GeoJSON, a GeoPackage, a Shapefile nor a FlatGeobuf")
    from pyogrio import list_layers, raw

    layer = next(str(name) for name, kind in list_layers(path) if "Polygon" in str(kind))
    meta, _, geometries, columns = raw.read(path, layer=layer, force_2d=True)
    turn = Transformer.from_crs(meta["crs"], "EPSG:4326", always_xy=True)
    features = []
    for row, shape in enumerate(shapely.from_wkb(geometries)):
        if shape is None:
            continue
        west, south, east, north = shape.bounds
        if max(abs(west), abs(south), abs(east), abs(north)) > 360.0:  # metres, in which edges are straight
            shape = shapely.segmentize(shape, _STRAIGHT)
        placed = shapely.transform(shape, lambda at: np.column_stack(turn.transform(at[:, 0], at[:, 1])))
        stated = {str(name): column[row] for name, column in zip(meta["fields"], columns, strict=True)}
        known = {name: value for name, value in stated.items() if value is not None and value == value}
        features.append(
            {"type": "Feature", "geometry": shapely.geometry.mapping(placed), "properties": known}
        )
    return {"type": "FeatureCollection", "features": features}


def _always_closed(paths: list[str], chart: dict[str, Any]) -> Callable[[Array, Array, Array], Mask]:
    """Inside the closed areas of a file that tell no hours."""
    features = [feature for feature, hours in _zones(paths[0], chart) if not hours]
    return _inside({"type": "FeatureCollection", "features": features})


def _inside(root: dict[str, Any]) -> Callable[[Array, Array, Array], Mask]:
    """Inside the polygons of GeoJSON."""
    shapes = [shapely.make_valid(shape) for shape in _shapes(root)]
    union = shapely.union_all(shapes)
    shapely.prepare(union)

    def inside(longitude: Array, latitude: Array, depth: Array) -> Mask:
        found = np.zeros(len(longitude), bool)
        for turn in (-360.0, 0.0, 360.0):
            found |= shapely.contains_xy(union, longitude + turn, latitude)
        return found

    return inside


def _shapes(node: dict[str, Any]) -> Iterator[Any]:
    kind = node.get("type")
    if kind == "FeatureCollection":
        for feature in node["features"]:
            yield from _shapes(feature)
    elif kind == "Feature":
        if node.get("geometry"):
            yield from _shapes(node["geometry"])
    elif kind == "GeometryCollection":
        for part in node["geometries"]:
            yield from _shapes(part)
    elif kind in ("Polygon", "MultiPolygon"):
        yield shapely.geometry.shape(node)


def _dry(paths: list[str]) -> Callable[[Array, Array, Array], Mask]:
    """Where the files of a current have no water.

    On a mesh that is outside all cells; on a grid it is where all four points around a place lack a value.
    """
    datasets = [opened(name, **_PLAIN) for name in matching(paths)]
    for data in datasets:
        cells = _cells(data)
        if cells is not None:
            return _off_mesh(data, cells)
    return _off_grid(datasets[0])


def _cells(data: xr.Dataset) -> Array | None:
    """[cells, corners, 2] longitude and latitude, NaN where a cell has fewer corners; None without a mesh."""
    name, places = None, None
    for variable in data.variables.values():
        if variable.attrs.get("cf_role") == "mesh_topology" and "face_node_connectivity" in variable.attrs:
            name = variable.attrs["face_node_connectivity"]
            places = str(variable.attrs["node_coordinates"]).split()
    if name is None:
        name = next((name for name in _CELLS if name in data and data[name].ndim == 2), None)
        places = ["lon", "lat"]
    if name is None or places is None or any(place not in data.variables for place in places):
        return None
    if any("degree" not in str(data[place].attrs.get("units", "degree")).lower() for place in places):
        raise _UnknownFileError("its coordinates are of a projection")
    if "lat" in str(data[places[0]].attrs.get("standard_name", places[0])).lower():
        places = places[::-1]
    corners = np.asarray(data[name].values, float)
    if 3 <= corners.shape[0] < corners.shape[1]:
        corners = corners.T
    nodes = np.stack([np.asarray(data[place].values, float).ravel() for place in places], axis=-1)
    start = float(data[name].attrs.get("start_index", np.nanmax(corners) == len(nodes)))
    there = np.isfinite(corners) & (corners >= start) & (corners - start < len(nodes))
    return np.where(there[..., None], nodes[np.where(there, corners - start, 0).astype(int)], np.nan)


def _off_mesh(data: xr.Dataset, cells: Array) -> Callable[[Array, Array, Array], Mask]:
    centre = cells[0, 0, 0]

    def outside(longitude: Array, latitude: Array, depth: Array) -> Mask:
        turned = centre + (longitude - centre + 180.0) % 360.0 - 180.0
        box = [turned.min(), latitude.min(), turned.max(), latitude.max()]
        low, high = np.nanmin(cells, axis=1), np.nanmax(cells, axis=1)
        near = cells[((high >= box[:2]) & (low <= box[2:])).all(axis=1)]
        rings = [shapely.Polygon(cell[np.isfinite(cell[:, 0])]) for cell in near]
        tree = shapely.STRtree(rings)
        points = np.atleast_1d(np.asarray(shapely.points(turned, latitude), object))
        held = tree.query(points, predicate="dwithin", distance=1e-9)[0]
        found = np.ones(len(turned), bool)
        found[held] = False
        return found

    return outside


def _off_grid(data: xr.Dataset) -> Callable[[Array, Array, Array], Mask]:
    name = next(
        (
            str(key)
            for key, v in data.variables.items()
            if v.attrs.get("standard_name") in _EAST and v.ndim > 2
        ),
        next((key for key in _EAST_NAMES if key in data), None),
    )
    if name is None:
        raise _UnknownFileError("the names of its current are not known")
    dims = data[name].dims[-2:]
    if (scattered := _scattered(data, name)) is not None:
        return scattered
    axes = []
    for dim, word in zip(dims, ("lat", "lon"), strict=True):
        own = [k for k, v in data.variables.items() if v.dims == (dim,) and word in str(k).lower()]
        if len(own) != 1:
            raise _UnknownFileError("its grid has no axes of longitude and latitude")
        axes.append(np.asarray(data[own[0]].values, float))
    rows, columns = (np.argsort(axis) for axis in axes)
    values = data[name]
    first = values.isel(dict.fromkeys(values.dims[:-2], 0)).values
    wet = np.isfinite(np.asarray(first, float))[rows][:, columns]
    north, east = axes[0][rows], axes[1][columns]

    def dry(longitude: Array, latitude: Array, depth: Array) -> Mask:
        turned = east[0] + (longitude - east[0]) % 360.0
        i = np.clip(np.searchsorted(north, latitude) - 1, 0, len(north) - 2)
        j = np.clip(np.searchsorted(east, turned) - 1, 0, len(east) - 2)
        return ~(wet[i, j] | wet[i + 1, j] | wet[i, j + 1] | wet[i + 1, j + 1])

    return dry


def _scattered(data: xr.Dataset, name: str) -> Callable[[Array, Array, Array], Mask] | None:
    """Dry where the four nearest points of a grid of two-dimensional coordinates are; None of other grids."""
    for words in (("lon_rho", "lat_rho"), ("longitude", "latitude"), ("lon", "lat"), ("nav_lon", "nav_lat")):
        if all(word in data and data[word].ndim == 2 for word in words):
            break
    else:
        return None
    east, north = (np.asarray(data[word].values, float) for word in words)
    if "mask_rho" in data:
        wet = data["mask_rho"].values == 1
    else:
        values = data[name]
        wet = np.isfinite(np.asarray(values.isel(dict.fromkeys(values.dims[:-2], 0)).values, float))
    if wet.shape != east.shape:
        raise _UnknownFileError("its points and its places differ in number")
    known = np.isfinite(east) & np.isfinite(north)
    tree = scipy.spatial.KDTree(_globe(east[known], north[known]))
    wet = wet[known]

    def dry(longitude: Array, latitude: Array, depth: Array) -> Mask:
        return np.asarray(~wet[tree.query(_globe(longitude, latitude), k=4)[1]].any(axis=1))

    return dry


def _globe(longitude: Array, latitude: Array) -> Array:
    """[n, 3] places on a globe of radius 1."""
    east, north = np.deg2rad(longitude), np.deg2rad(latitude)
    return np.stack([np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)], axis=-1)


def _bed(path: str, settings: dict[str, Any]) -> Callable[[Array, Array, Array], Mask]:
    """Below the sea bed, interpolated linearly between the file's values, at its lowest water."""
    north, east, height = _heights(path, settings)
    level = float(settings.get("water_level") or 0.0)

    def below(longitude: Array, latitude: Array, depth: Array) -> Mask:
        turned = east[0] + (longitude - east[0]) % 360.0
        bed = _linear(north, east, height, latitude, turned) - level
        return np.isfinite(bed) & (-depth < bed - _TOLERANCE)

    return below


def _heights(path: str, settings: dict[str, Any]) -> tuple[Array, Array, Array]:
    """Latitudes, longitudes, rising, and heights, m, positive up."""
    with open(path, "rb") as file:
        start = file.read(4)
    if start[:2] in (b"II", b"MM"):
        north, east, values, stated = _tiff(path)
        name = ""
    else:
        data = opened(path, **_PLAIN)
        name = settings.get("variable") or _grid_name(data)
        grid = data[name]
        grid = grid.isel({dim: 0 for dim in grid.dims if grid.sizes[dim] == 1 and grid.ndim > 2})
        if grid.ndim != 2 or any(dim not in data.variables for dim in grid.dims):
            raise _UnknownFileError("it has no axes of longitude and latitude")
        first = str(data[grid.dims[0]].attrs.get("units", grid.dims[0])).lower()
        grid = grid if "n" in first.removeprefix("degree") or "lat" in first else grid.T
        north, east = (np.asarray(data[dim].values, float) for dim in grid.dims)
        values, stated = np.asarray(grid.values, float), {k.lower(): v for k, v in grid.attrs.items()}
    unit = str(stated.get("units", "m")).lower()
    if unit not in ("", "m", "metre", "metres", "meter", "meters"):
        raise _UnknownFileError(f"its unit is {unit!r}")
    values = np.where(np.abs(values) < 12_000.0, values, np.nan)
    rows, columns = np.argsort(north), np.argsort(east)
    up = (
        settings.get("positive")
        or stated.get("positive")
        or _stated_by_name(str(stated.get("standard_name", name)))
    )
    if up is None:
        up = "up" if np.nanmin(values) < 0.0 else "down"
    return north[rows], east[columns], (_POSITIVE[str(up)] * values)[rows][:, columns]


def _stated_by_name(name: str) -> str | None:
    name = name.lower()
    if "depth" in name or name == "h":
        return "down"
    return "up" if name in ("elevation", "z", "topo", "height", "altitude", "topography") else None


def _grid_name(data: xr.Dataset) -> str:
    flat = [str(k) for k, v in data.data_vars.items() if sum(size > 1 for size in v.shape) == 2]
    if len(flat) != 1:
        raise _UnknownFileError("it holds several grids")
    return flat[0]


def _tiff(path: str) -> tuple[Array, Array, Array, dict[str, Any]]:
    try:
        import rasterio
    except ImportError:
        raise _UnknownFileError("a GeoTIFF is read with rasterio, which is not installed") from None
    with rasterio.open(path) as file:
        if file.crs is None or not file.crs.is_geographic or file.count != 1:
            raise _UnknownFileError("it is not in longitude and latitude")
        values = file.read(1, masked=True).astype(float).filled(np.nan)
        stated = {"units": file.units[0] or ""} | {k.lower(): v for k, v in file.tags(1).items()}
        east = np.array([(file.transform * (k + 0.5, 0.5))[0] for k in range(file.width)])
        north = np.array([(file.transform * (0.5, k + 0.5))[1] for k in range(file.height)])
    return north, east, values, stated


def _linear(north: Array, east: Array, values: Array, latitude: Array, longitude: Array) -> Array:
    """[n] values between four others, NaN beyond them."""
    i = np.clip(np.searchsorted(north, latitude) - 1, 0, len(north) - 2)
    j = np.clip(np.searchsorted(east, longitude) - 1, 0, len(east) - 2)
    a = (latitude - north[i]) / (north[i + 1] - north[i])
    b = (longitude - east[j]) / (east[j + 1] - east[j])
    south = values[i, j] * (1.0 - b) + values[i, j + 1] * b
    upper = values[i + 1, j] * (1.0 - b) + values[i + 1, j + 1] * b
    inside = (a >= 0.0) & (a <= 1.0) & (b >= 0.0) & (b <= 1.0)
    return np.where(inside, south * (1.0 - a) + upper * a, np.nan)
