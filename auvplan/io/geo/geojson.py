"""GeoJSON (RFC 7946) read strictly: every fault is one line with the file and the number of the feature."""

import json
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon

from auvplan.errors import ScenarioWarning
from auvplan.io.geo.error import Faults, GeoError, PlaceError, read_text
from auvplan.io.geo.vector import is_vector_file, read_vector_polygons

#: A shape whose edges cross more often, or with more rings or corners, is refused if it is not valid.
_CROSSINGS, _RINGS, _CORNERS = 20, 100, 100_000
# Edges from one turn of longitude to the next close a polygon around a pole.
_AROUND = 360.0 - 1e-6
# Edges that are looked up at a time, at most.
_TOGETHER = 256
#: What files of other formats begin with, in lower case.
_FORMATS = {
    b"<": "XML",
    b"pk\x03\x04": "an archive or a spreadsheet",
    b"sqlite format 3": "a GeoPackage or another database",
    b"fgb": "FlatGeobuf",
    b"\0\0\x27\x0a": "a Shapefile",
    b"!table": "a MapInfo table",
}
#: Larger files are no charts of a mission's area.
MAX_BYTES = 200_000_000
# CRS 84 and WGS 84 by their names in the old member "crs"; RFC 7946 knows no other.
_WGS84 = re.compile(r"(CRS:?84h?|EPSG[:/]+([\d.]+[:/]+)?4326|^WGS ?84)$", re.IGNORECASE)
_GEOMETRIES = (
    "Point",
    "MultiPoint",
    "LineString",
    "MultiLineString",
    "Polygon",
    "MultiPolygon",
    "GeometryCollection",
)


@dataclass(frozen=True)
class Feature:
    """A geometry of a GeoJSON file that is no collection.

    Attributes:
        where: file and number, as messages name it.
        number: of the feature in the file, from 1.
        kind: the geometry's type.
        coordinates: as in the file.
        properties: of the feature, by lower-case name; those that are null left out.
    """

    where: str
    number: int
    kind: str
    coordinates: Any
    properties: dict[str, Any]


def read_features(path: str | Path, kinds: tuple[str, ...]) -> list[Feature]:
    """Return the features of a GeoJSON file, a bare geometry being one without properties.

    Args:
        path: of the file.
        kinds: the types of geometry that are wanted, in collections too; any other is refused.

    Raises:
        GeoError: the file is missing, no GeoJSON, empty, in other coordinates than WGS 84, or holds something
            else; its `lines` are all that is wrong.
    """
    _refuse_other(path)
    try:
        root = json.loads(read_text(path, MAX_BYTES))
    except (json.JSONDecodeError, RecursionError):
        raise GeoError(f"{path}: not valid JSON") from None
    if not isinstance(root, dict) or "type" not in root:
        raise GeoError(f"{path}: not GeoJSON: it has no type")
    _check_crs(path, root.get("crs"))
    if root["type"] == "FeatureCollection":
        features = root.get("features")
        if not isinstance(features, list):
            raise GeoError(f"{path}: a FeatureCollection without a list of features")
    elif root["type"] == "Feature":
        features = [root]
    elif root["type"] in _GEOMETRIES:
        features = [{"type": "Feature", "geometry": root, "properties": {}}]
    else:
        raise GeoError(f"{path}: {root['type']!r} is no type of GeoJSON")
    if not features:
        raise GeoError(f"{path}: has no features")
    found: list[Feature] = []
    faults = Faults()
    for number, feature in enumerate(features, 1):
        with faults.kept():
            found += _parts(f"{path}: feature {number}", number, feature, kinds)
    faults.refuse()
    return found


def _parts(where: str, number: int, feature: Any, kinds: tuple[str, ...]) -> list[Feature]:
    """Return the geometries of a feature as features."""
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        raise GeoError(f"{where}: is no Feature")
    _check_crs(where, feature.get("crs"))
    properties = feature.get("properties")
    if properties is not None and not isinstance(properties, dict):
        raise GeoError(f"{where}: properties must be a mapping, got {type(properties).__name__}")
    kept = {
        str(name).strip().lower(): value for name, value in (properties or {}).items() if value is not None
    }
    return [
        Feature(where, number, geometry["type"], geometry.get("coordinates"), kept)
        for geometry in _simple(where, feature.get("geometry"), kinds)
    ]


def _refuse_other(path: str | Path) -> None:
    """Refuse a file that is of another known format, with what to do.

    Raises:
        GeoError: it is.
    """
    with Path(path).open("rb") as file:
        start = file.read(1000).lstrip(b"\xef\xbb\xbf \r\n\t").lower()
    kind = next((name for first, name in _FORMATS.items() if start.startswith(first)), None)
    if kind == "XML":
        kind = next((name for name in ("GPX", "KML", "GML") if f"<{name.lower()}".encode() in start), kind)
    if kind is not None:
        raise GeoError(f"{path}: is no GeoJSON but {kind}, which `ogr2ogr -f GeoJSON` or QGIS brings to it")


def positions(where: str, coordinates: Any, least: int = 1) -> np.ndarray:
    """[n, 3]: longitude and latitude, degrees, and elevation, m, which is NaN where none is given.

    Raises:
        GeoError: fewer than `least`, no numbers, or off the Earth.
    """
    if not isinstance(coordinates, list) or len(coordinates) < least:
        count = len(coordinates) if isinstance(coordinates, list) else "no"
        raise GeoError(f"{where}: needs at least {least} positions, got {count}")
    for position in coordinates:
        if (
            not isinstance(position, list)
            or len(position) < 2
            or not all(_is_number(c) for c in position[:3])
        ):
            raise GeoError(f"{where}: {_short(position)} is no position [longitude, latitude]")
        if not np.isfinite(position[:3]).all():
            raise GeoError(f"{where}: {_short(position)} is not finite")
        check_place(where, position[0], position[1])
    return np.array(
        [[*position[:2], position[2] if len(position) > 2 else np.nan] for position in coordinates]
    )


def check_place(where: str, longitude: float, latitude: float) -> None:
    """Refuse what lies off the Earth.

    Raises:
        GeoError: longitude not in [-180, 360] or latitude not in [-90, 90], degrees.
    """
    if not is_place(longitude, latitude):
        hint = ""
        if is_place(latitude, longitude):
            hint = ": longitude and latitude seem swapped"
        elif max(abs(longitude), abs(latitude)) > 1000.0:
            hint = ": metres of a projection must be brought to degrees"
        error = PlaceError(
            f"{where}: ({longitude:g}, {latitude:g}) is no longitude in [-180, 360] and latitude in [-90, 90]"
            + hint
        )
        error.swapped = is_place(latitude, longitude)
        raise error


def is_place(longitude: float, latitude: float) -> bool:
    """Return whether degrees are on the Earth."""
    return bool(-180.0 <= longitude <= 360.0 and -90.0 <= latitude <= 90.0)


def read_polygons(path: str | Path, area: Any = None) -> list[tuple[Feature, Polygon | MultiPolygon]]:
    """The polygons of a GeoJSON, GeoPackage or Shapefile, in degrees, with the features that they are of.

    Empty ones, which clipping leaves behind, are passed over. A ring that touches itself is parted there, and
    one that crosses itself a few times is repaired.

    Args:
        path: of the file.
        area: shapely geometry in degrees; polygons that reach nowhere near it may be faulty and are then
            left out. None for everywhere.

    Raises:
        GeoError: see `read_features` and `read_vector_polygons`; rings that are not closed or cross often, no
            area, or every one is empty.

    Warns:
        ScenarioWarning: a ring that was parted or repaired.
    """
    found, faults = [], Faults()
    for feature, shape in _vector_shapes(path) if is_vector_file(path) else _shapes(path):
        if not shapely.is_valid(shape):
            if area is not None and not shapely.intersects(shapely.box(*shape.bounds), area):
                continue
            with faults.kept():
                found.append((feature, _repaired(feature, shape)))
        else:
            found.append((feature, shape))
    faults.refuse()
    return found


def _shapes(path: str | Path) -> list[tuple[Feature, Polygon | MultiPolygon]]:
    """The polygons of a GeoJSON file, valid or not."""
    features = [part for part in read_features(path, ("Polygon", "MultiPolygon")) if part.coordinates != []]
    if not features:
        raise GeoError(f"{path}: every polygon is empty")
    found, faults = [], Faults()
    for feature in features:
        with faults.kept():
            found.append((feature, _shape(feature)))
    faults.refuse(len(features))
    return found


def _vector_shapes(path: str | Path) -> list[tuple[Feature, Polygon | MultiPolygon]]:
    """The polygons of a GeoPackage, Shapefile or the like, valid or not.

    Raises:
        GeoError: see `read_vector_polygons`; or one lies off the Earth.
    """
    found = []
    for number, properties, shape in read_vector_polygons(path):
        where = f"{path}: feature {number}"
        west, south, east, north = shape.bounds
        for longitude, latitude in ((west, south), (east, north)):
            check_place(where, longitude, latitude)
        for ring in shapely.get_rings(shape):
            _refuse_leap(where, shapely.get_coordinates(ring))
        found.append((Feature(where, number, shape.geom_type, None, properties), shape))
    return found


def _shape(feature: Feature) -> Polygon | MultiPolygon:
    """Return the shape of a Polygon or MultiPolygon feature in longitude and latitude, valid or not.

    Raises:
        GeoError: rings that are not closed, or coordinates off the Earth.
    """
    coordinates = feature.coordinates
    parts = coordinates if feature.kind == "MultiPolygon" else [coordinates]
    if not isinstance(parts, list) or not parts:
        raise GeoError(f"{feature.where}: a {feature.kind} without coordinates")
    polygons = [_polygon(feature.where, rings) for rings in parts]
    return polygons[0] if feature.kind == "Polygon" else MultiPolygon(polygons)


def _repaired(feature: Feature, shape: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
    """Part a ring where it touches itself, and fill what one that crosses itself may stand for.

    Parting adds no land and takes none. Of a ring that crosses, all that lies inside by either reading is
    kept: by the number of times that it goes around a place, and by whether that number is odd.

    Raises:
        GeoError: it crosses too often, is faulty otherwise, or has no area.

    Warns:
        ScenarioWarning: a ring was repaired.
    """
    reason = shapely.is_valid_reason(shape)
    line = f"{feature.where}: {_fault(reason)}"
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
    warnings.warn(f"{line}: it is {done}", ScenarioWarning, stacklevel=3)
    return repaired


def _crosses_seldom(shape: Polygon | MultiPolygon) -> bool:
    """Return whether the edges of a shape cross or cover each other so seldom that it can be made valid.

    Of many crossings that takes hours, and gigabytes.
    """
    rings = shapely.get_rings(shapely.get_parts(shape))
    if len(rings) > _RINGS or shapely.get_num_coordinates(shape) > _CORNERS:
        return False
    ends = [shapely.get_coordinates(ring) for ring in rings]
    pairs = np.concatenate([np.stack([at[:-1], at[1:]], axis=1) for at in ends])
    edges = np.asarray(shapely.linestrings(pairs), object)
    tree, met, start, count = shapely.STRtree(edges), 0, 0, 2
    while start < len(edges):
        some = edges[start : start + count]
        start, count = start + count, min(2 * count, _TOGETHER)
        met += len(tree.query(some, "crosses")[0]) + len(tree.query(some, "overlaps")[0])
        if met > 2 * _CROSSINGS:  # each is found from both sides
            return False
    return True


def _simple(where: str, geometry: Any, kinds: tuple[str, ...]) -> Iterator[dict]:
    """Yield the geometries of a geometry, those of collections one by one."""
    stack = [geometry]
    while stack:
        part = stack.pop()
        if part is None:
            raise GeoError(f"{where}: has no geometry")
        kind = part.get("type") if isinstance(part, dict) else None
        if kind == "GeometryCollection":
            inner = part.get("geometries")
            if not isinstance(inner, list) or not inner:
                raise GeoError(f"{where}: an empty GeometryCollection")
            stack += inner[::-1]
        elif kind in kinds:
            yield part
        elif kind in _GEOMETRIES:
            raise GeoError(f"{where}: a {kind}, where {' or '.join(kinds)} is wanted")
        else:
            raise GeoError(f"{where}: {_short(kind)} is no type of geometry")


def _polygon(where: str, rings: Any) -> Polygon:
    if not isinstance(rings, list) or not rings:
        raise GeoError(f"{where}: a polygon without rings")
    closed = []
    for ring in rings:
        places = positions(where, ring, 4)[:, :2]
        if (places[0] != places[-1]).any():
            raise GeoError(f"{where}: a ring is not closed: its last position is not its first")
        _refuse_leap(where, places)
        closed.append(places)
    return Polygon(closed[0], closed[1:])


def _refuse_leap(where: str, places: np.ndarray) -> None:
    """Refuse a ring [n, 2] an edge of which spans more than half of the Earth, but not all of it.

    Raises:
        GeoError: one does; it may go either way around.
    """
    leap = np.abs(np.diff(places[:, 0])).max(initial=0.0)
    if 180.0 < leap < _AROUND:
        raise GeoError(f"{where}: an edge spans {leap:g} degrees of longitude: split it at the antimeridian")


def _check_crs(where: str | Path, member: Any) -> None:
    if member is None:
        return
    properties = member.get("properties") if isinstance(member, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str) or not _WGS84.search(name.strip()):
        raise GeoError(
            f"{where}: crs is {_short(name or member)}: GeoJSON is in WGS 84 longitude and latitude"
        )


def _fault(said: str) -> str:
    """Shapely's reason in words of the field, with the place."""
    what, _, place = said.partition("[")
    words = {
        "Self-intersection": "the polygon crosses itself",
        "Ring Self-intersection": "a ring touches itself",
    }
    stated = words.get(what.strip(), f"no valid polygon: {what.strip().lower()}")
    return f"{stated} at ({', '.join(place.rstrip(']').split())})" if place else stated


def _is_number(value: Any) -> bool:
    # A whole number beyond all floats cannot even be compared with one.
    return isinstance(value, float) or (type(value) is int and abs(value) < 10**300)


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
