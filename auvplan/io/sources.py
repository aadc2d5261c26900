"""The checker's own view of a run's sources: land and sea bed as the scenario's files have them.

It reads them with xarray, shapely, pyproj, pyogrio and rasterio alone and shares no code with the readers of
the planner, so that a file which those misread does not vouch for itself.
"""

import json
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import scipy
import shapely
import shapely.geometry
import xarray as xr
from pyproj import Transformer

from auvplan.files import MISSION
from auvplan.io.enc import bed_of_cells, blocked_by_cells
from auvplan.io.hours import closed_at
from auvplan.io.originals import matching, opened, path_of
from auvplan.io.walk import Array, Mask

#: What files of polygons begin with that are no GeoJSON: GeoPackage, FlatGeobuf, Shapefile.
_VECTORS = b"SQLite format 3", b"fgb", b"\0\0\x27\x0a"
#: Metres below a sea bed that is interpolated otherwise than the planner's that are no fault.
_TOLERANCE = 0.5
_CELLS = ("nv", "SCHISM_hgrid_face_nodes", "ele", "elem", "element", "tri")
_EAST = ("eastward_sea_water_velocity", "sea_water_x_velocity", "x_sea_water_velocity")
_EAST_NAMES = ("uo", "u", "water_u", "u_eastward", "utotal")
_POSITIVE = {"up": 1.0, "down": -1.0}
#: Metres in units of sea beds.
_METRES = {
    **dict.fromkeys(("", "m", "metre", "metres", "meter", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet"), 0.3048),
    **dict.fromkeys(("us survey foot", "us-ft"), 1200.0 / 3937.0),
    **dict.fromkeys(("fathom", "fathoms"), 1.8288),
    "cm": 0.01,
    "dm": 0.1,
    "km": 1000.0,
}
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
    chart, bed = (settings.get(name) or {} for name in ("chart", "bathymetry"))
    picture = chart.get({"raster": "file", "image": "image"}.get(str(chart.get("source")), ""))
    if picture:
        notes.append(f"colours of {Path(picture).name} were not judged again: its land is as in {MISSION}")
    if bed.get("source") == "current":
        notes.append(f"sea bed of the current's files was not looked at again: it is as in {MISSION}")
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
    for area, hours in _zones(str(path_of(dataset, chart["no_go"])), chart):
        if hours:
            name = str(area.stated.get("name") or chart["no_go"])
            yield Source(name, "closed area", _inside([area]), partial(closed_at, hours, dataset))


def _zones(path: str, chart: dict[str, Any]) -> Iterator[tuple["_Polygons", dict[str, Any]]]:
    """Yield the features of a file of closed areas, and when they are closed; nothing for always."""
    common = {"windows": chart["no_go_windows"]} if chart.get("no_go_windows") else {}
    for area in _areas(path):
        own = {
            key: area.stated[key]
            for key in ("from", "to", "windows")
            if area.stated.get(key) not in (None, "")
        }
        yield area, own or common


def _files(settings: dict[str, Any]) -> Iterator[tuple[list[str], str, Callable[[list[str]], Any]]]:
    """Yield the files of a scenario, what they tell, and how they are read."""
    chart, bed, current = (settings.get(name) or {} for name in ("chart", "bathymetry", "current"))
    files = current.get("files") or []
    files = [files] if isinstance(files, str) else list(files)
    if chart.get("source") == "polygons":
        yield [chart["file"]], "land", lambda paths: _inside(_areas(paths[0]))
    if chart.get("source") == "raster":
        yield [chart["file"]], "land", lambda paths: _off_picture(paths[0], chart)
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


@dataclass(frozen=True)
class _Polygons:
    """The polygons of a feature.

    Attributes:
        shape: shapely geometry in the coordinates of its file.
        stated: the feature's properties, by lower-case name.
        turn: from longitude and latitude, degrees, to the file's coordinates; None where they are these.
    """

    shape: Any
    stated: dict[str, Any]
    turn: Transformer | None = None


def _areas(path: str) -> list[_Polygons]:
    """Return the polygons of a GeoJSON, GeoPackage, Shapefile or FlatGeobuf, also in a zip archive.

    Raises:
        _UnknownFileError: it is of none of these formats.
    """
    with open(path, "rb") as binary:
        start = binary.read(64)
    if start.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"{"):
        with open(path, encoding="utf-8-sig") as file:
            root = json.load(file)
        return [
            _Polygons(shapely.union_all(shapes), _lower(feature.get("properties") or {}))
            for feature in root.get("features", [root])
            if (shapes := [shapely.make_valid(shape) for shape in _shapes(feature)])
        ]
    if start.startswith(b"PK"):
        with ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith((".shp", ".gpkg", ".fgb"))]
        if len(names) != 1:
            raise _UnknownFileError(f"its archive holds {len(names)} files of polygons")
        path = f"/vsizip/{{{Path(path).absolute()}}}/{names[0]}"
    elif not start.startswith(_VECTORS):
        raise _UnknownFileError("it is neither a GeoJSON, a GeoPackage, a Shapefile nor a FlatGeobuf")
    from pyogrio import list_layers, raw

    flat = ("Point", "Line", "None")
    layer = next(str(name) for name, kind in list_layers(path) if not any(word in str(kind) for word in flat))
    meta, _, geometries, columns = raw.read(path, layer=layer, force_2d=True)
    turn = Transformer.from_crs("EPSG:4326", meta["crs"], always_xy=True)
    found = []
    for row, shape in enumerate(shapely.from_wkb(geometries)):
        if shape is not None:
            stated = {str(name): column[row] for name, column in zip(meta["fields"], columns, strict=True)}
            known = {name: value for name, value in stated.items() if value is not None and value == value}
            found.append(_Polygons(shapely.make_valid(shape), _lower(known), turn))
    return found


def _lower(stated: dict[str, Any]) -> dict[str, Any]:
    return {str(name).strip().lower(): value for name, value in stated.items()}


def _always_closed(paths: list[str], chart: dict[str, Any]) -> Callable[[Array, Array, Array], Mask]:
    """Inside the closed areas of a file that tell no hours."""
    return _inside([area for area, hours in _zones(paths[0], chart) if not hours])


def _inside(areas: Sequence[_Polygons]) -> Callable[[Array, Array, Array], Mask]:
    """Inside polygons of one file."""
    union = shapely.union_all([area.shape for area in areas])
    shapely.prepare(union)
    turn = areas[0].turn if areas else None

    def inside(longitude: Array, latitude: Array, depth: Array) -> Mask:
        found = np.zeros(len(longitude), bool)
        for around in (-360.0, 0.0, 360.0):
            x, y = longitude + around, latitude
            if turn is not None:
                x, y = turn.transform(x, y)
            found |= shapely.contains_xy(union, x, y)
        return found

    return inside


def _shapes(node: dict[str, Any]) -> Iterator[Any]:
    kind = node.get("type")
    if kind == "Feature":
        if node.get("geometry"):
            yield from _shapes(node["geometry"])
    elif kind == "GeometryCollection":
        for part in node["geometries"]:
            yield from _shapes(part)
    elif kind in ("Polygon", "MultiPolygon"):
        yield shapely.geometry.shape(node)


def _off_picture(path: str, chart: dict[str, Any]) -> Callable[[Array, Array, Array], Mask]:
    """Beyond a picture, and where it has no data, is see-through or is hidden by a mask.

    Raises:
        _UnknownFileError: it has no place on Earth that GDAL finds.
    """
    with _raster(path) as file:
        shown, pixel = file.dataset_mask() > 127, _pixel(file, chart)

    def hidden(longitude: Array, latitude: Array, depth: Array) -> Mask:
        found = np.ones(len(longitude), bool)
        for around in (-360.0, 0.0, 360.0):
            at = np.stack(pixel(longitude + around, latitude))
            size = np.reshape(shown.shape, (2, 1))
            inside = ((at > -0.5) & (at < size + 0.5)).all(axis=0)  # half a pixel may stick out
            i, j = np.clip(np.floor(np.where(inside, at, 0.0)).astype(int), 0, size - 1)
            found &= ~(inside & shown[i, j])
        return found

    return hidden


def _pixel(file: Any, section: dict[str, Any]) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Return the way from longitude and latitude to row and column, from the outer corner of the first pixel.

    Args:
        file: open, with rasterio.
        section: of the scenario, whose `crs` counts where the file tells none.

    Raises:
        _UnknownFileError: the file has no place on Earth that GDAL finds.
    """
    system = file.crs or section.get("crs")
    if system is None or file.transform.is_identity:
        raise _UnknownFileError("its place on Earth is not in its own tags")
    turn = Transformer.from_crs("EPSG:4326", system, always_xy=True)
    a, b, c, d, e, f = tuple(file.transform)[:6]
    back = np.linalg.inv([[a, b], [d, e]])

    def pixel(longitude: Array, latitude: Array) -> tuple[Array, Array]:
        x, y = turn.transform(longitude, latitude)
        column, row = back @ np.stack([np.asarray(x) - c, np.asarray(y) - f])
        return row, column

    return pixel


def _raster(path: str) -> Any:
    """Open a raster.

    Raises:
        _UnknownFileError: rasterio is not installed.
    """
    try:
        import rasterio
    except ImportError:
        raise _UnknownFileError("it is read with rasterio, which is not installed") from None
    return rasterio.open(path)


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
    with open(path, "rb") as file:
        raster = file.read(3) not in (b"CDF", b"\x89HD") or path.lower().endswith(".bag")
    height = (_raster_heights if raster else _axes_heights)(path, settings)
    level = float(settings.get("water_level") or 0.0)

    def below(longitude: Array, latitude: Array, depth: Array) -> Mask:
        bed = height(longitude, latitude) - level
        return np.isfinite(bed) & (-depth < bed - _TOLERANCE)

    return below


def _axes_heights(path: str, settings: dict[str, Any]) -> Callable[[Array, Array], Array]:
    """Heights, m, at longitudes and latitudes, from a NetCDF file with axes of these."""
    data = opened(path, **_PLAIN)
    name = settings.get("variable") or _grid_name(data)
    grid = data[name]
    grid = grid.isel({dim: 0 for dim in grid.dims if grid.sizes[dim] == 1 and grid.ndim > 2})
    if grid.ndim != 2 or any(dim not in data.variables for dim in grid.dims):
        raise _UnknownFileError("it has no axes of longitude and latitude")
    first = str(data[grid.dims[0]].attrs.get("units", grid.dims[0])).lower()
    grid = grid if "n" in first.removeprefix("degree") or "lat" in first else grid.T
    north, east = (np.asarray(data[dim].values, float) for dim in grid.dims)
    stated = {k.lower(): v for k, v in grid.attrs.items()}
    values = _upward(np.asarray(grid.values, float), stated, str(name), settings)
    rows, columns = np.argsort(north), np.argsort(east)
    north, east, values = north[rows], east[columns], values[rows][:, columns]

    def height(longitude: Array, latitude: Array) -> Array:
        turned = east[0] + (longitude - east[0]) % 360.0
        i, j = (
            np.interp(at, axis, np.arange(len(axis)), np.nan, np.nan)
            for at, axis in ((latitude, north), (turned, east))
        )
        return _linear(values, i, j)

    return height


def _raster_heights(path: str, settings: dict[str, Any]) -> Callable[[Array, Array], Array]:
    """Heights, m, at longitudes and latitudes, from a raster of one band."""
    with _raster(path) as file:
        pixel = _pixel(file, settings)
        if file.count != 1 and file.driver != "BAG":
            raise _UnknownFileError(f"it has {file.count} bands")
        raw = file.read(1, masked=True).astype(float).filled(np.nan)
        stated = {"units": file.units[0] or ""} | {k.lower(): v for k, v in file.tags(1).items()}
        # A BAG keeps heights in a system of depths.
        vertical = str(file.crs.to_wkt()).upper().split("VERT_CS")[1:] if file.crs is not None else []
        down = file.driver == "GTiff" and "DOWN" in "".join(vertical)
        values = raw * file.scales[0] + file.offsets[0]
        name = file.descriptions[0] or ""
    values = _upward(values, stated | ({"positive": "down"} if down else {}), name, settings)

    def height(longitude: Array, latitude: Array) -> Array:
        found = np.full(len(longitude), np.nan)
        for around in (-360.0, 0.0, 360.0):
            row, column = pixel(longitude + around, latitude)
            found = np.where(np.isnan(found), _linear(values, row - 0.5, column - 0.5), found)
        return found

    return height


def _upward(values: Array, stated: dict[str, Any], name: str, settings: dict[str, Any]) -> Array:
    """Return values as heights, m; NaN where there is none.

    Raises:
        _UnknownFileError: their unit is not known.
    """
    unit = str(stated.get("units", "m")).lower()
    if unit not in _METRES:
        raise _UnknownFileError(f"its unit is {unit!r}")
    values = values * _METRES[unit]
    values = np.where(np.abs(values) < 12_000.0, values, np.nan)
    up = (
        settings.get("positive")
        or stated.get("positive")
        or _stated_by_name(str(stated.get("standard_name", name)))
    )
    if up is None:
        up = "up" if np.nanmin(values) < 0.0 else "down"
    return _POSITIVE[str(up)] * values


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


def _linear(values: Array, row: Array, column: Array) -> Array:
    """[n] values between four others, NaN beyond them; rows and columns of nodes are whole numbers."""
    last = np.asarray(values.shape) - 1
    inside = (row >= 0.0) & (row <= last[0]) & (column >= 0.0) & (column <= last[1])
    i, j = (
        np.clip(np.floor(np.where(inside, at, 0.0)).astype(int), 0, max(size - 1, 0))
        for at, size in zip((row, column), last, strict=True)
    )
    a, b = row - i, column - j
    south = values[i, j] * (1.0 - b) + values[i, j + 1] * b
    upper = values[i + 1, j] * (1.0 - b) + values[i + 1, j + 1] * b
    return np.where(inside, south * (1.0 - a) + upper * a, np.nan)
