"""Polygons of GeoPackage, Shapefile, FlatGeobuf and what else GDAL reads, in longitude and latitude."""

import warnings
import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import shapely
from pyproj import CRS, Transformer
from shapely.geometry import MultiPolygon, Polygon

from auvplan.io.geo.error import GeoError, reason

_STARTS = (b"SQLite format 3", b"fgb", b"PK\x03\x04")
_SHAPEFILE = b"\0\0\x27\x0a"
# An edge of a projection in pieces of so many metres is straight in degrees too.
_PIECE = 1000.0
#: Parts of a Shapefile in an archive.
_BESIDE = (".shx", ".dbf", ".prj", ".cpg", ".sbn", ".sbx", ".qix", ".qmd", ".xml", ".txt", ".md", ".html")
_SUFFIXES = (".shp", ".gpkg", ".fgb", ".zip")


def is_vector_file(path: str | Path) -> bool:
    """Return whether a file is of a vector format other than GeoJSON, by its name or first bytes."""
    if Path(path).suffix.lower() in _SUFFIXES:
        return True
    with Path(path).open("rb") as file:
        return file.read(16).startswith(_STARTS)


def read_vector_polygons(path: str | Path) -> list[tuple[int, dict[str, Any], Polygon | MultiPolygon]]:
    """Return the polygons of the first layer that has any: number from 1, properties, shape in degrees.

    Raises:
        GeoError: one line; the file cannot be read, tells no reference system, or has no polygons.
    """
    try:
        from pyogrio import list_layers, raw
    except ImportError:
        raise GeoError(f"{path}: needs a further package: pip install 'auvplan[readers]'") from None
    if not Path(path).exists():
        raise GeoError(f"{path}: no such file")
    _require_known(Path(path))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what GDAL finds odd and can read
            layers = [str(name) for name, kind in list_layers(path) if "Polygon" in str(kind)]
            if not layers:
                raise GeoError(f"{path}: has no layer of polygons")
            meta, _, geometries, columns = raw.read(path, layer=layers[0], force_2d=True)
    except GeoError:
        raise
    except Exception as error:  # whatever GDAL stumbles over
        raise GeoError(f"{path}: cannot be read ({reason(error)})") from None
    if not meta["crs"]:
        raise GeoError(
            f"{path}: tells no coordinate reference system: a Shapefile's is in the .prj beside it"
        )
    crs = CRS.from_user_input(meta["crs"])
    shapes = shapely.from_wkb(geometries)
    if not crs.equals(CRS.from_epsg(4326), ignore_axis_order=True):
        turn = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
        if crs.is_projected:  # edges are straight in its own metres
            shapes = shapely.segmentize(shapes, _PIECE / float(crs.axis_info[0].unit_conversion_factor))
        shapes = shapely.transform(shapes, lambda places: _turned(places, turn))
    names = [str(name).strip().lower() for name in meta["fields"]]
    found = []
    for number, shape in enumerate(shapes, 1):
        if not isinstance(shape, Polygon | MultiPolygon) or shape.is_empty:
            continue
        values = {name: column[number - 1] for name, column in zip(names, columns, strict=True)}
        kept = {name: getattr(value, "item", lambda v=value: v)() for name, value in values.items()}
        found.append((number, {name: value for name, value in kept.items() if value is not None}, shape))
    if not found:
        raise GeoError(f"{path}: every polygon is empty")
    return found


def _require_known(path: Path) -> None:
    """Refuse what GDAL takes for other formats, some of which name files and servers that it then reads.

    Raises:
        GeoError: the file, or one in a zip archive, is not of the format that its name tells.
    """
    starts: list[tuple[str, bytes]] = []
    try:
        with path.open("rb") as file:
            starts.append((path.name, file.read(16)))
        if starts[0][1].startswith(b"PK"):
            with ZipFile(path) as archive:
                starts = []
                for entry in archive.infolist():
                    with archive.open(entry) as inside:
                        starts.append((entry.filename, inside.read(16)))
    except (OSError, ValueError, RuntimeError, NotImplementedError, BadZipFile, zlib.error) as error:
        raise GeoError(f"{path}: cannot be read ({reason(error)})") from None
    for name, start in starts:
        kind = Path(name).suffix.lower()
        beside = len(starts) > 1 and kind in _BESIDE
        if not (start.startswith((*_STARTS, _SHAPEFILE)) or beside or name.endswith("/")):
            raise GeoError(f"{path}: {name} is neither a GeoPackage, a Shapefile nor a FlatGeobuf")


def _turned(places: Any, turn: Transformer) -> Any:
    places[:, 0], places[:, 1] = turn.transform(places[:, 0], places[:, 1])
    return places
