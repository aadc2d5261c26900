"""Polygons in longitude and latitude: of GeoJSON, GeoPackage, Shapefile, FlatGeobuf and what GDAL reads."""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import shapely
from pyproj import CRS, Transformer
from shapely.geometry import MultiPolygon, Polygon

from auvplan.errors import reason_of, warn
from auvplan.io.geo.error import GeoError, label
from auvplan.io.geo.features import (
    Feature,
    Features,
    check_place,
    each,
    gdal,
    positions,
    read_features,
    read_layer,
)

#: A shape whose edges cross more often, or with more rings or corners, is refused if it is not valid.
_CROSSINGS, _RINGS, _CORNERS = 20, 100, 100_000
# Edges from one turn of longitude to the next close a polygon around a pole.
_AROUND = 360.0 - 1e-6
# Edges that are looked up at a time, at most.
_TOGETHER = 256
# First bytes of a GeoPackage, a FlatGeobuf, an archive and a Shapefile.
_STARTS, _SHAPEFILE = (b"SQLite format 3", b"fgb", b"PK\x03\x04"), b"\0\0\x27\x0a"
# m, the longest piece of a projection's edge that is straight in degrees too.
_PIECE = 1000.0
#: Parts of a Shapefile in an archive.
_BESIDE = (".shx", ".dbf", ".prj", ".cpg", ".sbn", ".sbx", ".qix", ".qmd", ".xml", ".txt", ".md", ".html")
# Types of layers that may hold polygons.
_AREAS = ("Polygon", "Surface", "Unknown", "GeometryCollection")
_SUFFIXES = (".shp", ".gpkg", ".fgb", ".zip")


def read_polygons(source: Features, area: Any = None) -> list[Feature]:
    """Return the polygons of a GeoJSON, GeoPackage or Shapefile, whose shapes are in degrees.

    Empty ones, which clipping leaves behind, are passed over. A ring that touches itself is parted there, and
    one that crosses itself a few times is repaired.

    Args:
        area: shapely geometry in degrees; polygons that reach nowhere near it may be faulty and are then
            left out. None for everywhere.

    Raises:
        GeoError: see `read_features` and `read_vector_polygons`; rings that are not closed or cross often, no
            area, or every one is empty.

    Warns:
        ScenarioWarning: a ring that was parted or repaired.
    """
    file = Path(source) if isinstance(source, str | Path) else None
    if file and (file.suffix.lower() in _SUFFIXES or _start(file).startswith(_STARTS)):
        features = read_vector_polygons(file)
    else:
        stated = read_features(source, ("Polygon", "MultiPolygon"))
        filled = [one for one in stated if one.coordinates != []]
        features = each(filled, lambda one: [replace(one, shape=_shape(one))])
    if not features:
        raise GeoError(f"{label(source)}: every polygon is empty")

    def sound(feature: Feature) -> list[Feature]:
        if shapely.is_valid(feature.shape):
            return [feature]
        near = area is None or shapely.intersects(shapely.box(*feature.shape.bounds), area)
        return [replace(feature, shape=_repaired(feature))] if near else []

    return each(features, sound)


def _shape(feature: Feature) -> Polygon | MultiPolygon:
    """Return the shape of a Polygon or MultiPolygon of GeoJSON, valid or not."""
    where, polygons = feature.where, []
    parts = feature.coordinates if feature.kind == "MultiPolygon" else [feature.coordinates]
    if not isinstance(parts, list) or not parts:
        raise GeoError(f"{where}: a {feature.kind} without coordinates")
    for rings in parts:
        if not isinstance(rings, list) or not rings:
            raise GeoError(f"{where}: a polygon without rings")
        closed = []
        for ring in rings:
            places = positions(feature, [] if ring is None else ring, 4)[:, :2]
            if (places[0] != places[-1]).any():
                raise GeoError(f"{where}: a ring is not closed: its last position is not its first")
            _refuse_leap(where, places)
            closed.append(places)
        polygons.append(Polygon(closed[0], closed[1:]))
    return polygons[0] if feature.kind == "Polygon" else MultiPolygon(polygons)


def _repaired(feature: Feature) -> Polygon | MultiPolygon:
    """Part a ring where it touches itself, and fill what one that crosses itself may stand for.

    Parting adds no land and takes none. Of a ring that crosses, all that lies inside by either reading is
    kept: by the number of times that it goes around a place, and by whether that number is odd.
    """
    shape = feature.shape
    reason = shapely.is_valid_reason(shape)
    what, _, place = reason.partition("[")
    words = {
        "Self-intersection": "the polygon crosses itself",
        "Ring Self-intersection": "a ring touches itself",
    }
    line = f"{feature.where}: {words.get(what.strip(), f'no valid polygon: {what.strip().lower()}')}"
    if place:
        line += f" at ({', '.join(place.rstrip(']').split())})"
    done, repaired = "parted there", None
    if reason.startswith("Ring Self-intersection"):
        repaired = shapely.make_valid(shape)
    elif reason.startswith(("Self-intersection", "Nested shells")) and _crosses_seldom(shape):
        readings = (
            shapely.make_valid(shape),
            shapely.make_valid(shape, method="structure", keep_collapsed=False),
        )
        parts = [part for reading in readings for part in shapely.get_parts(reading)]
        repaired = shapely.union_all([part for part in parts if isinstance(part, Polygon)])
        done = "repaired, with all inside that may be meant"
    if not isinstance(repaired, Polygon | MultiPolygon) or repaired.is_empty:
        raise GeoError(line)
    warn(f"{line}: it is {done}")
    return repaired


def _crosses_seldom(shape: Polygon | MultiPolygon) -> bool:
    """Return whether edges cross or cover each other seldom: else `make_valid` takes hours and gigabytes."""
    rings = shapely.get_rings(shapely.get_parts(shape))
    if len(rings) > _RINGS or shapely.get_num_coordinates(shape) > _CORNERS:
        return False
    ends = [shapely.get_coordinates(ring) for ring in rings]
    pairs = np.concatenate([np.stack([at[:-1], at[1:]], axis=1) for at in ends])
    edges = np.asarray(shapely.linestrings(pairs), object)
    tree, met = shapely.STRtree(edges), 0
    for start in range(0, len(edges), _TOGETHER):
        some = edges[start : start + _TOGETHER]
        met += len(tree.query(some, "crosses")[0]) + len(tree.query(some, "overlaps")[0])
        if met > 2 * _CROSSINGS:  # each is found from both sides
            return False
    return True


def _refuse_leap(where: str, places: np.ndarray) -> None:
    """Refuse a ring [n, 2] with an edge over more than half of the Earth: it may go either way around."""
    leap = np.abs(np.diff(places[:, 0])).max(initial=0.0)
    if 180.0 < leap < _AROUND:
        raise GeoError(f"{where}: an edge spans {leap:g} degrees of longitude: split it at the antimeridian")


def _start(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(16)


def read_vector_polygons(path: str | Path) -> list[Feature]:
    """Return the polygons of a GeoPackage, Shapefile or the like, valid or not, whose shapes are in degrees.

    Rings that cross the antimeridian have longitudes beyond 180 or -180 degrees, but for those of WGS 84.

    Raises:
        GeoError: one line; the file cannot be read, has no reference system, has no polygons, several
            layers of them, something else among them, or one lies off the Earth.
    """
    path = Path(path)
    list_layers = gdal(path).list_layers
    try:
        source = _source(path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what GDAL finds odd and can read
            kinds = {str(name): str(kind) for name, kind in list_layers(source)}
            layers = [name for name, kind in kinds.items() if any(part in kind for part in _AREAS)]
            if len(layers) > 1:
                raise GeoError(
                    f"{path}: has {len(layers)} layers that may be land, {', '.join(layers)[:200]}: keep one "
                    f"of them, such as by `ogr2ogr land.gpkg {path.name} {layers[0]}`"
                )
            if not layers:
                raise GeoError(f"{path}: has no layer of polygons")
            features, system = read_layer(path, source, layers[0])
    except GeoError:
        raise
    except Exception as error:  # whatever GDAL stumbles over
        raise GeoError(f"{path}: cannot be read ({reason_of(error)})") from None
    if not system:
        raise GeoError(f"{path}: has no coordinate reference system: a Shapefile's is in the .prj beside it")
    shapes = [None if one.shape is None else _flattened(one.shape) for one in features]
    for feature, shape in zip(features, shapes, strict=True):
        if shape is not None and not isinstance(shape, Polygon | MultiPolygon):
            raise GeoError(f"{feature.where}: a {shape.geom_type}, where polygons are wanted")
    found = []
    for feature, shape in zip(features, _in_degrees(shapes, CRS.from_user_input(system)), strict=True):
        if shape is None or shape.is_empty:
            continue
        west, south, east, north = shape.bounds
        for longitude, latitude in ((west, south), (east, north)):
            check_place(feature.where, longitude, latitude)
        for ring in shapely.get_rings(shape):
            _refuse_leap(feature.where, shapely.get_coordinates(ring))
        stated = {name.strip().lower(): value for name, value in feature.properties.items()}
        found.append(replace(feature, kind=shape.geom_type, properties=stated, shape=shape))
    return found


def _source(path: Path) -> str:
    """Return what GDAL is to open: the file, or the one in a zip archive.

    What is not of the format that its name states is refused: GDAL takes it for others, some of which name
    files and servers that it then reads.
    """
    starts = [(path.name, _start(path))]
    if zipped := starts[0][1].startswith(b"PK"):
        with ZipFile(path) as archive:
            files = [entry for entry in archive.infolist() if not entry.is_dir()]
            starts = [(entry.filename, archive.open(entry).read(16)) for entry in files]
    known = [name for name, start in starts if start.startswith((*_STARTS, _SHAPEFILE))]
    main = [name for name in known if Path(name).suffix.lower() != ".shx"]  # begins as its .shp does
    for name, _ in starts:
        if name not in known and not (len(starts) > 1 and Path(name).suffix.lower() in _BESIDE):
            raise GeoError(
                f"{path}: {name} is neither a GeoPackage, a Shapefile nor a FlatGeobuf: bring it to one of "
                "these, such as by `ogr2ogr land.gpkg`"
            )
    if not zipped:
        return str(path)
    if len(main) != 1:
        several = f"{len(main)} files of land, {', '.join(main)[:200]}: it must hold one"
        raise GeoError(f"{path}: holds {several if main else 'no GeoPackage, Shapefile or FlatGeobuf'}")
    return f"/vsizip/{{{path.absolute()}}}/{main[0]}"


def _flattened(shape: Any) -> Any:
    """Return a collection of polygons as one of them all; any other geometry as it is."""
    if shape.geom_type != "GeometryCollection":
        return shape
    parts = [part for inner in shape.geoms for part in shapely.get_parts(_flattened(inner))]
    return MultiPolygon(parts) if all(isinstance(part, Polygon) for part in parts) else shape


def _in_degrees(shapes: list[Any], system: CRS) -> list[Any]:
    """Return polygons of a reference system in WGS 84.

    Those of a projection go on across the antimeridian, in longitudes beyond 180 degrees; their edges are
    divided to be straight in degrees as well. A ring around a pole is led along it from one turn to the next.
    """
    if system.equals(CRS.from_epsg(4326), ignore_axis_order=True):
        return shapes
    transformer = Transformer.from_crs(system, "EPSG:4326", always_xy=True)

    def turned(places: Any) -> Any:
        places[:, 0], places[:, 1] = transformer.transform(places[:, 0], places[:, 1])
        return places

    if not system.is_projected:
        return list(shapely.transform(shapes, turned))
    piece = _PIECE / float(system.axis_info[0].unit_conversion_factor)

    def ring(line: Any, about: float | None = None) -> Any:
        places = turned(shapely.get_coordinates(shapely.segmentize(line, piece)))
        if not np.isfinite(places).all():
            return places
        east = np.unwrap(places[:, 0], period=360.0)
        # A hole is about where its polygon is; that begins at -180 degrees or east of there.
        turns = np.ceil((-180.0 - east.min()) / 360.0)
        if about is not None:
            turns = np.rint((about - east.mean()) / 360.0)
        places[:, 0] = east + 360.0 * turns
        first, last = places[0], places[-1]
        if abs(last[0] - first[0]) > 180.0:
            pole = np.copysign(90.0, places[:, 1].mean())
            return np.array([*places, (last[0], pole), (first[0], pole), first])
        return places

    def polygon(part: Any) -> Any:
        outside = ring(part.exterior)
        return outside, [ring(hole, outside[:, 0].mean()) for hole in part.interiors]

    return [
        None
        if shape is None
        else MultiPolygon([polygon(part) for part in shapely.get_parts(shape) if not part.is_empty])
        for shape in shapes
    ]
