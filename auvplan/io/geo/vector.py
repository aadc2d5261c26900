"""Polygons of GeoPackage, Shapefile, FlatGeobuf and what else GDAL reads, in longitude and latitude."""

import warnings
import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
import shapely
from pyproj import CRS, Transformer
from shapely.geometry import MultiPolygon, Polygon

from auvplan.errors import reason_of
from auvplan.io.geo.error import GeoError

_STARTS = (b"SQLite format 3", b"fgb", b"PK\x03\x04")
_SHAPEFILE = b"\0\0\x27\x0a"
# An edge of a projection in pieces of so many metres is straight in degrees too.
_PIECE = 1000.0
#: Parts of a Shapefile in an archive.
_BESIDE = (".shx", ".dbf", ".prj", ".cpg", ".sbn", ".sbx", ".qix", ".qmd", ".xml", ".txt", ".md", ".html")
# Types of layers that may hold polygons.
_AREAS = ("Polygon", "Surface", "Unknown", "GeometryCollection")
_SUFFIXES = (".shp", ".gpkg", ".fgb", ".zip")


def is_vector_file(path: str | Path) -> bool:
    """Return whether a file is of a vector format other than GeoJSON, by its name or first bytes."""
    if Path(path).suffix.lower() in _SUFFIXES:
        return True
    with Path(path).open("rb") as file:
        return file.read(16).startswith(_STARTS)


def read_vector_polygons(path: str | Path) -> list[tuple[int, dict[str, Any], Polygon | MultiPolygon]]:
    """Return the polygons of a file: number from 1, properties, shape in degrees.

    Rings that cross the antimeridian have longitudes beyond 180 or -180 degrees, but for those of WGS 84.

    Raises:
        GeoError: one line; the file cannot be read, tells no reference system, has no polygons, several
            layers of them, or something else among them.
    """
    try:
        from pyogrio import list_layers, raw
    except ImportError:
        raise GeoError(f"{path}: needs a further package: pip install 'auvplan[readers]'") from None
    if not Path(path).exists():
        raise GeoError(f"{path}: no such file")
    source = _source(Path(path))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what GDAL finds odd and can read
            kinds = {str(name): str(kind) for name, kind in list_layers(source)}
            layers = [name for name, kind in kinds.items() if any(part in kind for part in _AREAS)]
            if len(layers) > 1:
                raise GeoError(
                    f"{path}: has {len(layers)} layers that may be land, {', '.join(layers)[:200]}: keep one "
                    f"of them, such as by `ogr2ogr land.gpkg {Path(path).name} {layers[0]}`"
                )
            if not layers:
                raise GeoError(f"{path}: has no layer of polygons")
            meta, _, geometries, columns = raw.read(source, layer=layers[0], force_2d=True)
    except GeoError:
        raise
    except Exception as error:  # whatever GDAL stumbles over
        raise GeoError(f"{path}: cannot be read ({reason_of(error)})") from None
    if not meta["crs"]:
        raise GeoError(
            f"{path}: tells no coordinate reference system: a Shapefile's is in the .prj beside it"
        )
    crs = CRS.from_user_input(meta["crs"])
    shapes = [None if shape is None else _areas(shape) for shape in shapely.from_wkb(geometries)]
    for number, shape in enumerate(shapes, 1):
        if shape is not None and not isinstance(shape, Polygon | MultiPolygon):
            raise GeoError(f"{path}: feature {number}: a {shape.geom_type}, where polygons are wanted")
    if not crs.equals(CRS.from_epsg(4326), ignore_axis_order=True):
        turn = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
        if crs.is_projected:  # edges are straight in its own metres
            piece = _PIECE / float(crs.axis_info[0].unit_conversion_factor)
            shapes = [_unrolled(shape, turn, piece) for shape in shapes]
        else:
            shapes = shapely.transform(shapes, lambda places: _turned(places, turn))
    names = [str(name).strip().lower() for name in meta["fields"]]
    found = []
    for number, shape in enumerate(shapes, 1):
        if shape is None or shape.is_empty:
            continue
        values = {name: column[number - 1] for name, column in zip(names, columns, strict=True)}
        kept = {name: getattr(value, "item", lambda v=value: v)() for name, value in values.items()}
        found.append((number, {name: value for name, value in kept.items() if value is not None}, shape))
    if not found:
        raise GeoError(f"{path}: every polygon is empty")
    return found


def _areas(shape: Any) -> Any:
    """Return a collection of polygons as one of them all; any other geometry as it is."""
    if shape.geom_type != "GeometryCollection":
        return shape
    parts = [part for inner in shape.geoms for part in shapely.get_parts(_areas(inner))]
    return MultiPolygon(parts) if all(isinstance(part, Polygon) for part in parts) else shape


def _unrolled(shape: Any, turn: Transformer, piece: float) -> Any:
    """Return polygons of a projection in degrees, with longitudes that go on across the antimeridian.

    A ring around a pole is led along it, from one turn to the next.

    Args:
        shape: Polygon or MultiPolygon in the projection, or None.
        turn: from there to degrees.
        piece: edges that are longer are divided.
    """
    if shape is None:
        return None

    def ring(line: Any, about: float | None) -> Any:
        places = _turned(shapely.get_coordinates(shapely.segmentize(line, piece)), turn)
        if not np.isfinite(places).all():
            return places
        east = np.unwrap(places[:, 0], period=360.0)
        # A hole is about where its polygon is; that begins at -180 degrees or east of there.
        turns = (
            np.ceil((-180.0 - east.min()) / 360.0)
            if about is None
            else np.rint((about - east.mean()) / 360.0)
        )
        places[:, 0] = east + 360.0 * turns
        first, last = places[0], places[-1]
        if abs(last[0] - first[0]) > 180.0:
            pole = np.copysign(90.0, places[:, 1].mean())
            return np.array([*places, (last[0], pole), (first[0], pole), first])
        return places

    polygons = []
    for part in shapely.get_parts(shape):
        if not part.is_empty:
            outside = ring(part.exterior, None)
            polygons.append((outside, [ring(hole, outside[:, 0].mean()) for hole in part.interiors]))
    return MultiPolygon(polygons)


def _source(path: Path) -> str:
    """Return what GDAL is to open: the file, or the one in a zip archive.

    Raises:
        GeoError: the file, or one in the archive, is not of the format that its name tells: GDAL takes it for
            others, some of which name files and servers that it then reads; or the archive holds several.
    """
    starts: list[tuple[str, bytes]] = []
    zipped = False
    try:
        with path.open("rb") as file:
            starts.append((path.name, file.read(16)))
        if zipped := starts[0][1].startswith(b"PK"):
            with ZipFile(path) as archive:
                starts = []
                for entry in archive.infolist():
                    if not entry.is_dir():
                        with archive.open(entry) as inside:
                            starts.append((entry.filename, inside.read(16)))
    except (OSError, ValueError, RuntimeError, NotImplementedError, BadZipFile, zlib.error) as error:
        raise GeoError(f"{path}: cannot be read ({reason_of(error)})") from None
    known = [name for name, start in starts if start.startswith((*_STARTS, _SHAPEFILE))]
    main = [name for name in known if Path(name).suffix.lower() != ".shx"]  # begins as its .shp does
    for name, _ in starts:
        beside = len(starts) > 1 and Path(name).suffix.lower() in _BESIDE
        if not (name in known or beside):
            raise GeoError(
                f"{path}: {name} is neither a GeoPackage, a Shapefile nor a FlatGeobuf: bring it to one of "
                "these, such as by `ogr2ogr land.gpkg`"
            )
    if not zipped:
        return str(path)
    if len(main) != 1:
        raise GeoError(
            f"{path}: holds {len(main)} files of land, {', '.join(main)[:200]}: it must hold one"
            if main
            else f"{path}: holds no GeoPackage, Shapefile or FlatGeobuf"
        )
    return f"/vsizip/{{{path.absolute()}}}/{main[0]}"


def _turned(places: Any, turn: Transformer) -> Any:
    places[:, 0], places[:, 1] = turn.transform(places[:, 0], places[:, 1])
    return places
