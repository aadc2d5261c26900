"""Files of places as features: GeoJSON (RFC 7946), GPX, KML and KMZ, QGroundControl's plans, vector layers.

Every fault is one line with the file and the number of the feature, waypoint, placemark or item.
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree.ElementTree import Element, ParseError
from zipfile import ZipFile

import numpy as np
import shapely
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from auvplan.errors import warn
from auvplan.io.geo.error import Faults, GeoError, PlaceError, label, number_of
from auvplan.runtime.files import read_text
from auvplan.scenario.yaml_lines import short
from auvplan.site import Site, is_place

#: What files of other formats begin with, in lower case.
_FORMATS = {
    b"<": "XML",
    b"pk\x03\x04": "an archive or a spreadsheet",
    b"sqlite format 3": "a GeoPackage or another database",
    b"fgb": "FlatGeobuf",
    b"\0\0\x27\x0a": "a Shapefile",
    b"!table": "a MapInfo table",
}
# CRS 84 and WGS 84 by their names in the old member "crs"; RFC 7946 knows no other.
_WGS84 = re.compile(r"(CRS:?84h?|EPSG[:/]+([\d.]+[:/]+)?4326|^WGS ?84)$", re.IGNORECASE)
_GEOMETRIES = (
    "Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection",
)  # fmt: skip
#: KML's altitudes that count from the surface of the sea, and those that are ignored.
_ABSOLUTE, _CLAMPED = ("absolute", "relativeToGround"), ("", "clampToGround")
_OTHER_SHAPES = ("Polygon", "Track", "MultiTrack", "Model", "LinearRing")
#: MAVLink's commands for a place to visit; their first parameter is the time spent there, s.
_VISITS = (16, 19, 82)
#: MAVLink's frames whose altitudes count from the ground.
_TERRAIN = (10, 11)
_SURVEYS = ("survey", "CorridorScan")


@dataclass(frozen=True)
class Feature:
    """A geometry with properties, as any of the formats has it."""

    where: str  # file and number, as messages name it
    number: int  # in the file, from 1
    kind: str  # the geometry's type, as GeoJSON calls it; of an object of an S-57 cell its class
    #: Of Point, MultiPoint and LineString, longitude, latitude and perhaps elevation, as in the file; of
    #: polygons of GeoJSON, their rings.
    coordinates: Any = None
    #: By name, in lower case but for S-57's; those that are null left out.
    properties: dict[str, Any] = field(default_factory=dict)
    local: bool = False  # whether coordinates are north and east, m, instead of degrees
    shape: Any = None  # shapely geometry, where the format has one


#: A file, or GeoJSON in memory: a mapping, or what has it as its `__geo_interface__`, such as a GeoDataFrame.
Features = str | Path | Mapping[str, Any] | Any


def read_features(source: Features, kinds: tuple[str, ...]) -> list[Feature]:
    """Return the features of GeoJSON, a bare geometry being one without properties.

    Args:
        source: a file or an object in its place.
        kinds: the types of geometry that are wanted, in collections too; any other is refused.

    Raises:
        GeoError: the file is missing, no GeoJSON, empty, in other coordinates than WGS 84, or holds something
            else; its `lines` are all that is wrong.
    """
    path = label(source)
    if isinstance(source, str | Path):
        with Path(source).open("rb") as file:
            start = file.read(1000).lstrip(b"\xef\xbb\xbf \r\n\t").lower()
        if other := next((name for first, name in _FORMATS.items() if start.startswith(first)), None):
            if other == "XML":
                other = next(
                    (name for name in ("GPX", "KML", "GML") if f"<{name}".lower().encode() in start), other
                )
            raise GeoError(
                f"{path}: is no GeoJSON but {other}, which `ogr2ogr -f GeoJSON` or QGIS brings to it"
            )
        root = _json(source)
    else:
        root = json.loads(json.dumps(getattr(source, "__geo_interface__", source)))
    if not isinstance(root, dict) or "type" not in root:
        raise GeoError(f"{path}: not GeoJSON: it has no type")
    _check_crs(path, root.get("crs"))
    features: Any = [root]
    if root["type"] == "FeatureCollection":
        features = root.get("features")
        if not isinstance(features, list):
            raise GeoError(f"{path}: a FeatureCollection without a list of features")
    elif root["type"] in _GEOMETRIES:
        features = [{"type": "Feature", "geometry": root}]
    elif root["type"] != "Feature":
        raise GeoError(f"{path}: {root['type']!r} is no type of GeoJSON")
    if not features:
        raise GeoError(f"{path}: has no features")
    numbered = list(enumerate(features, 1))
    return each(numbered, lambda one: _parts(f"{path}: feature {one[0]}", one[0], one[1], kinds))


def each(parts: list[Any], read: Callable[[Any], list[Any]]) -> list[Any]:
    """Return what is read of all parts of a file, or refuse what is wrong with all of them at once."""
    found, faults = [], Faults()
    for part in parts:
        with faults.kept():
            found += read(part)
    faults.refuse(len(parts))
    return found


def _parts(where: str, number: int, feature: Any, kinds: tuple[str, ...]) -> list[Feature]:
    """Return the geometries of a feature as features, those of collections one by one."""
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        raise GeoError(f"{where}: is no Feature")
    _check_crs(where, feature.get("crs"))
    properties = {} if feature.get("properties") is None else feature["properties"]
    if not isinstance(properties, dict):
        raise GeoError(f"{where}: properties must be a mapping, got {type(properties).__name__}")
    kept = {str(name).strip().lower(): value for name, value in properties.items() if value is not None}
    found, stack = [], [feature.get("geometry")]
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
            found.append(Feature(where, number, kind, part.get("coordinates"), kept))
        elif kind in _GEOMETRIES:
            raise GeoError(f"{where}: a {kind}, where {' or '.join(kinds)} is wanted")
        else:
            raise GeoError(f"{where}: {short(kind)} is no type of geometry")
    return found


def _check_crs(where: str, member: Any) -> None:
    """Refuse another reference system than WGS 84."""
    properties = member.get("properties") if isinstance(member, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if member is not None and not (isinstance(name, str) and _WGS84.search(name.strip())):
        raise GeoError(
            f"{where}: crs is {short(name or member)}: GeoJSON is in WGS 84 longitude and latitude"
        )


def positions(feature: Feature, coordinates: Any = None, least: int = 1) -> np.ndarray:
    """[n, 3]: longitude and latitude, degrees, and elevation, m, which is NaN where none is given.

    Of coordinates, or the feature's own; at least as many as said are needed.

    Raises:
        GeoError: fewer than `least`, no numbers, or off the Earth.
    """
    where = feature.where
    if coordinates is None:
        coordinates = [feature.coordinates] if feature.kind == "Point" else feature.coordinates
    if not isinstance(coordinates, list) or len(coordinates) < least:
        count = len(coordinates) if isinstance(coordinates, list) else "no"
        raise GeoError(f"{where}: needs at least {least} positions, got {count}")
    for position in coordinates:
        whole = isinstance(position, list) and len(position) >= 2
        if not (whole and all(map(_is_number, position[:3]))):
            raise GeoError(f"{where}: {short(position)} is no position [longitude, latitude]")
        if not np.isfinite(position[:3]).all():
            raise GeoError(f"{where}: {short(position)} is not finite")
        if not feature.local:
            check_place(where, position[0], position[1])
    return np.array(
        [[*position[:2], position[2] if len(position) > 2 else np.nan] for position in coordinates]
    )


def local_positions(feature: Feature, site: Site | None, least: int = 1) -> np.ndarray:
    """[n, 3]: local north and east, and elevation, m, as `positions` has it.

    Raises:
        GeoError: as `positions`; or a place is none in local metres.
    """
    at = positions(feature, least=least)
    if not feature.local:
        assert site is not None
        at[:, 0], at[:, 1] = site.to_local(at[:, 0], at[:, 1])
        if not np.isfinite(at[:, :2]).all():
            raise GeoError(f"{feature.where}: has no place in the site's local metres")
    return at


def check_place(where: str, longitude: float, latitude: float) -> None:
    """Refuse what lies off the Earth.

    Raises:
        GeoError: longitude not in [-180, 360] or latitude not in [-90, 90], degrees.
    """
    if is_place(longitude, latitude):
        return
    hint, swapped = "", is_place(latitude, longitude)
    if swapped:
        hint = ": longitude and latitude seem swapped"
    elif max(abs(longitude), abs(latitude)) > 1000.0:
        hint = ": metres of a projection must be brought to degrees"
    place = f"({longitude:g}, {latitude:g})"
    raise PlaceError(
        f"{where}: {place} is no longitude in [-180, 360] and latitude in [-90, 90]{hint}", swapped
    )


def _gpx(path: Path, faults: Faults, notes: list[str]) -> Iterator[Feature]:
    root = _xml(path, "gpx")
    points = root.findall("{*}wpt")
    if not points:
        raise GeoError(f"{path}: has no waypoints (wpt): its routes and tracks are not read as jobs")
    if root.findall("{*}rte") or root.findall("{*}trk"):
        warn(f"{path}: routes and tracks are ignored: jobs are its waypoints (wpt)")
    for number, point in enumerate(points, 1):
        name = _text_of(point, "name")
        where = f"{path}: waypoint {number}{_quoted(name)}"
        with faults.kept():
            place = [_number(where, key, point.get(key, "")) for key in ("lon", "lat")]
            if elevation := _text_of(point, "ele"):
                place.append(_number(where, "ele", elevation))
            yield Feature(where, number, "Point", place, {"name": name})


def _kml(path: Path, faults: Faults, notes: list[str]) -> Iterator[Feature]:
    marks = _xml(path, "kml").findall(".//{*}Placemark")
    if not marks:
        raise GeoError(f"{path}: has no placemarks")
    flat = 0
    for number, mark in enumerate(marks, 1):
        extended = {}
        for data in (data for holder in mark.findall("{*}ExtendedData") for data in holder.iter()):
            if _plain_name(data) == "Data":
                extended[data.get("name", "")] = _text_of(data, "value")
            elif _plain_name(data) == "SimpleData":
                extended[data.get("name", "")] = (data.text or "").strip()
        given = {name.strip().lower(): value for name, value in extended.items() if name and value}
        stated = {"name": _text_of(mark, "name")} | given
        where = f"{path}: placemark {number}{_quoted(stated['name'])}"
        with faults.kept():
            shapes = list(_shapes(where, mark))
            if not shapes:
                raise GeoError(f"{where}: has no geometry")
            for count, shape in enumerate(shapes, 1):
                places, ignored = _coordinates(where, shape)
                flat += ignored
                name = stated["name"] and f"{stated['name']}{f' {count}' if len(shapes) > 1 else ''}"
                kind = _plain_name(shape)
                at = places[0] if kind == "Point" else places
                yield Feature(where, number, kind, at, stated | {"name": name})
    if flat:
        notes.append(f"{path}: altitudes above the ground that KML lays places on are ignored")


def _shapes(where: str, element: Element) -> Iterator[Element]:
    """Yield the points and lines of a placemark, those of collections one by one."""
    for shape in element:
        kind = _plain_name(shape)
        if kind == "MultiGeometry":
            yield from _shapes(where, shape)
        elif kind in ("Point", "LineString"):
            yield shape
        elif kind in _OTHER_SHAPES:
            raise GeoError(f"{where}: a {kind}, where Point or LineString is wanted")


def _coordinates(where: str, shape: Element) -> tuple[list[list[float]], bool]:
    """Longitude, latitude and, where it counts, elevation; and whether one was given that does not."""
    mode, ignored, found = _text_of(shape, "altitudeMode"), False, []
    if mode not in (*_ABSOLUTE, *_CLAMPED):
        raise GeoError(f"{where}: altitudeMode {mode} counts from the sea bed: use absolute, minus depth")
    for part in _text_of(shape, "coordinates").split():
        place = [_number(where, "coordinates", number) for number in part.split(",")]
        if len(place) not in (2, 3):
            raise GeoError(f"{where}: coordinates must be longitude,latitude or longitude,latitude,altitude")
        # Without a mode, programs write depths all the same, and 0 where they know none.
        if len(place) == 3 and mode in _CLAMPED and place[2] >= 0.0:
            ignored |= place.pop() > 0.0
        found.append(place)
    if not found:
        raise GeoError(f"{where}: has no coordinates")
    return found, ignored


def _plan(path: Path, faults: Faults, notes: list[str]) -> Iterator[Feature]:
    root = _json(path)
    mission = root.get("mission") if isinstance(root, dict) and root.get("fileType") == "Plan" else None
    items = mission.get("items") if isinstance(mission, dict) else None
    if not isinstance(items, list):
        raise GeoError(f"{path}: is no plan of QGroundControl: it has no mission.items")
    left = []
    for number, item in enumerate(items, 1):
        where = f"{path}: item {number}"
        with faults.kept():
            if not isinstance(item, dict):
                raise GeoError(f"{where}: is no mission item")
            if item.get("type") == "SimpleItem" and item.get("command") in _VISITS:
                yield _visit(where, number, item)
            elif item.get("complexItemType") in _SURVEYS:
                yield _survey(where, number, item)
            else:
                left.append(f"{number} ({item.get('complexItemType') or item.get('command')})")
    if left:
        notes.append(f"{path}: items that are no waypoints or surveys are ignored: {', '.join(left)}")
    elif not items:
        raise GeoError(f"{path}: has no mission items")


def _visit(where: str, number: int, item: dict[str, Any]) -> Feature:
    params = item.get("params")
    if not isinstance(params, list) or len(params) != 7:
        raise GeoError(f"{where}: params must be seven values")
    if item.get("frame") in _TERRAIN:
        raise GeoError(
            f"{where}: frame {item['frame']}: the altitude counts from the ground, not the surface"
        )
    altitude = params[6] if item.get("Altitude") is None else item["Altitude"]
    place = [params[5], params[4]] + ([] if altitude is None else [altitude])
    if not all(map(_is_number, place)):
        raise GeoError(f"{where}: params must give latitude, longitude and altitude as numbers, got {params}")
    return Feature(where, number, "Point", place, {"duration": params[0] or 0.0})


def _survey(where: str, number: int, item: dict[str, Any]) -> Feature:
    """The transects of a survey, in the order in which they are flown, as one line."""
    style = item.get("TransectStyleComplexItem")
    points = style.get("VisualTransectPoints") if isinstance(style, dict) else None
    if not isinstance(style, dict) or not isinstance(points, list) or len(points) < 2:
        raise GeoError(f"{where}: the survey has no VisualTransectPoints: open and save it in QGroundControl")
    camera = style.get("CameraCalc")
    altitude = camera.get("DistanceToSurface") if isinstance(camera, dict) else None
    places = []
    for point in points:
        if not isinstance(point, list) or len(point) < 2 or not all(map(_is_number, point[:2])):
            raise GeoError(f"{where}: VisualTransectPoints must be latitudes and longitudes, got {point}")
        place = [point[1], point[0]] + ([] if altitude is None else [altitude])
        if not places or place != places[-1]:
            places.append(place)
    return Feature(where, number, "LineString", places, {"name": f"survey {number}"})


#: How files of other programs are read, by the ends of their names. A reader adds to the faults of the file
#: and to the notes on what is left out.
READERS: dict[str, Callable[[Path, Faults, list[str]], Iterator[Feature]]] = {
    ".gpx": _gpx, ".kml": _kml, ".kmz": _kml, ".plan": _plan,
}  # fmt: skip


def gdal(path: Path) -> ModuleType:
    """Return pyogrio, by which GDAL reads vector layers of the file `path`.

    Raises:
        GeoError: it is not installed.
    """
    try:
        import pyogrio
    except ImportError:
        raise GeoError(f"{path}: needs a further package: pip install 'auvplan[readers]'") from None
    return pyogrio


def read_layer(
    path: Path, source: str | Path, layer: str, **options: str
) -> tuple[list[Feature], str | None]:
    """Return the features of a layer of `source`, with its own names of properties, and its reference system.

    Shapes are valid or not, and None where there is none; kinds are the layer's name.
    """
    meta, _, geometries, columns = gdal(path).raw.read(source, layer=layer, force_2d=True, **options)
    names, found = [str(name) for name in meta["fields"]], []
    shapes = [None] * len(columns[0]) if geometries is None else shapely.from_wkb(geometries)
    for number, shape in enumerate(shapes, 1):
        values = (column[number - 1] for column in columns)
        plain = [value.item() if isinstance(value, np.generic) else value for value in values]
        stated = {
            name: value
            for name, value in zip(names, plain, strict=True)
            if value is not None and not (isinstance(value, float) and np.isnan(value))
        }
        found.append(Feature(f"{path}: feature {number}", number, layer, properties=stated, shape=shape))
    return found, meta["crs"]


def _is_number(value: Any) -> bool:
    # A whole number beyond all floats cannot even be compared with one.
    return isinstance(value, float) or (type(value) is int and abs(value) < 10**300)


def _quoted(name: str) -> str:
    return f" {name[:40]!r}" if name else ""


def _json(path: str | Path) -> Any:
    """Return the content of a JSON file."""
    try:
        return json.loads(read_text(path, GeoError))
    except (json.JSONDecodeError, RecursionError):
        raise GeoError(f"{path}: not valid JSON") from None


def _xml(path: Path, kind: str) -> Element:
    """Return the root of an XML file, or of the one `.kml` in a zip archive, whose plain name is `kind`."""
    try:
        content = path.read_bytes()
        if path.suffix.lower() == ".kmz":
            with ZipFile(path) as archive:
                inside = [name for name in archive.namelist() if name.lower().endswith(".kml")]
                if len(inside) != 1:
                    several = f"holds {len(inside)} .kml, {', '.join(inside)[:200]}: it must hold one"
                    raise GeoError(f"{path}: {several if inside else 'has no .kml inside'}")
                content = archive.read(inside[0])
        root = fromstring(content, forbid_dtd=True)
    except DefusedXmlException:
        raise GeoError(f"{path}: has a document type or entities, which are not read") from None
    except ParseError as error:
        line, column = error.position
        raise GeoError(f"{path}: line {line}, column {column + 1}: not valid XML") from None
    if _plain_name(root) != kind:
        raise GeoError(f"{path}: is no {kind.upper()}: its root is {_plain_name(root)}")
    return root


def _plain_name(element: Element) -> str:
    """Return an element's name without its namespace."""
    return str(element.tag).rpartition("}")[2]


def _text_of(element: Element, name: str) -> str:
    """Return the text of the first child of a name; empty where there is none."""
    return (element.findtext(f"{{*}}{name}") or "").strip()


def _number(where: str, name: str, text: str) -> float:
    if np.isnan(number := number_of(text)):
        raise GeoError(f"{where}: {name} must be a number, got {text[:40]!r}")
    return number
