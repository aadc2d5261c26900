"""Places of other programs' files as features: GPX waypoints, KML placemarks, QGroundControl's items."""

import json
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError
from zipfile import ZipFile

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from auvplan.errors import ScenarioWarning
from auvplan.io.geo.error import Faults, GeoError, read_text
from auvplan.io.geo.geojson import Feature

#: Larger files hold no jobs.
_MAX_BYTES = 50_000_000
#: KML's altitudes that count from the surface of the sea, and those that count for nothing.
_ABSOLUTE, _CLAMPED = ("absolute", "relativeToGround"), ("", "clampToGround")
_LONELY = ("Polygon", "Track", "MultiTrack", "Model", "LinearRing")
#: MAVLink's commands for a place to visit; their first parameter is the time spent there, s.
_VISITS = (16, 19, 82)
#: MAVLink's frames whose altitudes count from the ground.
_TERRAIN = (10, 11)
_SURVEYS = ("survey", "CorridorScan")

Reader = Callable[[Path, Faults, list[str]], Iterator[Feature]]


def read_places(path: Path, faults: Faults, notes: list[str]) -> list[Feature]:
    """Return what a GPX, KML, KMZ or `.plan` file tells of places, with what it tells of priority and so on.

    Args:
        path: of the file.
        faults: gets what is wrong with single ones.
        notes: gets what is left unread, a line each.

    Raises:
        GeoError: one line; the file cannot be read as what its name says, or has no places.

    Warns:
        ScenarioWarning: routes and tracks of a GPX file, which are left unread.
    """
    return list(READERS[path.suffix.lower()](path, faults, notes))


def _gpx(path: Path, faults: Faults, notes: list[str]) -> Iterator[Feature]:
    root = read_xml(path, "gpx")
    points = list(children(root, "wpt"))
    if not points:
        raise GeoError(f"{path}: has no waypoints (wpt): its routes and tracks are not read as jobs")
    if any(True for _ in children(root, "rte", "trk")):
        line = f"{path}: routes and tracks are left unread: jobs are its waypoints (wpt)"
        warnings.warn(line, ScenarioWarning, stacklevel=2)
    for number, point in enumerate(points, 1):
        name = text_of(point, "name")
        where = f"{path}: waypoint {number}{_quoted(name)}"
        with faults.kept():
            place = [number_of(where, key, point.get(key, "")) for key in ("lon", "lat")]
            if elevation := text_of(point, "ele"):
                place.append(number_of(where, "ele", elevation))
            yield Feature(where, number, "Point", place, {"name": name})


def _kml(path: Path, faults: Faults, notes: list[str]) -> Iterator[Feature]:
    marks = [element for element in read_xml(path, "kml").iter() if plain(element) == "Placemark"]
    if not marks:
        raise GeoError(f"{path}: has no placemarks")
    flat = 0
    for number, mark in enumerate(marks, 1):
        stated = {"name": text_of(mark, "name")} | _extended(mark)
        where = f"{path}: placemark {number}{_quoted(stated['name'])}"
        with faults.kept():
            shapes = list(_shapes(where, mark))
            if not shapes:
                raise GeoError(f"{where}: has no geometry")
            for count, shape in enumerate(shapes, 1):
                places, ignored = _coordinates(where, shape)
                flat += ignored
                own = (
                    stated
                    if len(shapes) == 1 or not stated["name"]
                    else stated | {"name": f"{stated['name']} {count}"}
                )
                if plain(shape) == "Point":
                    yield Feature(where, number, "Point", places[0], own)
                else:
                    yield Feature(where, number, "LineString", places, own)
    if flat:
        notes.append(f"{path}: altitudes above the ground that KML lays places on count for nothing")


def _extended(mark: Element) -> dict[str, str]:
    """Return the data that a placemark carries, by lower-case name."""
    found = {}
    for holder in children(mark, "ExtendedData"):
        for data in holder.iter():
            if plain(data) == "Data":
                found[data.get("name", "")] = text_of(data, "value")
            elif plain(data) == "SimpleData":
                found[data.get("name", "")] = (data.text or "").strip()
    return {name.strip().lower(): value for name, value in found.items() if name and value}


def _shapes(where: str, element: Element) -> Iterator[Element]:
    """Yield the points and lines of a placemark, those of collections one by one."""
    for shape in element:
        kind = plain(shape)
        if kind == "MultiGeometry":
            yield from _shapes(where, shape)
        elif kind in ("Point", "LineString"):
            yield shape
        elif kind in _LONELY:
            raise GeoError(f"{where}: a {kind}, where Point or LineString is wanted")


def _coordinates(where: str, shape: Element) -> tuple[list[list[float]], bool]:
    """Longitude, latitude and, where it counts, elevation; and whether one was given that does not."""
    mode, ignored, found = text_of(shape, "altitudeMode"), False, []
    if mode not in (*_ABSOLUTE, *_CLAMPED):
        raise GeoError(f"{where}: altitudeMode {mode} counts from the sea bed: use absolute, minus depth")
    for part in text_of(shape, "coordinates").split():
        place = [number_of(where, "coordinates", number) for number in part.split(",")]
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
    try:
        root = json.loads(read_text(path, _MAX_BYTES))
    except (json.JSONDecodeError, RecursionError):
        raise GeoError(f"{path}: not valid JSON") from None
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
        notes.append(f"{path}: items that are no waypoints or surveys are left unread: {', '.join(left)}")
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
    altitude = item.get("Altitude") if item.get("Altitude") is not None else params[6]
    place = [params[5], params[4]]
    if altitude is not None:
        place.append(altitude)
    if not all(_is_number(value) for value in place):
        raise GeoError(f"{where}: params must tell latitude, longitude and altitude as numbers, got {params}")
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


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _quoted(name: str) -> str:
    return f" {name[:40]!r}" if name else ""


def read_xml(path: Path, kind: str) -> Element:
    """Return the root of an XML file, or of the one `.kml` in a zip archive.

    Args:
        path: of the file.
        kind: the name that the root has without its namespace.

    Raises:
        GeoError: one line; the file is too large, no XML, of another kind, or has a document type.
    """
    try:
        root = fromstring(_content(path), forbid_dtd=True)
    except DefusedXmlException:
        raise GeoError(f"{path}: has a document type or entities, which are not read") from None
    except ParseError as error:
        line, column = error.position
        raise GeoError(f"{path}: line {line}, column {column + 1}: not valid XML") from None
    if plain(root) != kind:
        raise GeoError(f"{path}: is no {kind.upper()}: its root is {plain(root)}")
    return root


def plain(element: Element) -> str:
    """Return an element's name without its namespace."""
    return str(element.tag).rpartition("}")[2]


def children(element: Element, *names: str) -> Iterator[Element]:
    """Yield the direct children of some names."""
    return (child for child in element if plain(child) in names)


def text_of(element: Element, name: str) -> str:
    """Return the text of the first child of a name; empty where there is none."""
    found = next(children(element, name), None)
    return "" if found is None else (found.text or "").strip()


def number_of(where: str, name: str, text: str) -> float:
    """Return a number that is written in a file.

    Raises:
        GeoError: it is none; the line names the field.
    """
    try:
        return float(text)
    except ValueError:
        raise GeoError(f"{where}: {name} must be a number, got {text[:40]!r}") from None


def _content(path: Path) -> bytes:
    if path.suffix.lower() != ".kmz":
        if path.stat().st_size > _MAX_BYTES:
            raise GeoError(f"{path}: larger than {_MAX_BYTES} bytes")
        return path.read_bytes()
    with ZipFile(path) as archive:
        inside = [entry for entry in archive.infolist() if entry.filename.lower().endswith(".kml")]
        if not inside:
            raise GeoError(f"{path}: has no .kml inside")
        if len(inside) > 1:
            listed = ", ".join(entry.filename for entry in inside)[:200]
            raise GeoError(f"{path}: holds {len(inside)} .kml, {listed}: it must hold one")
        with archive.open(inside[0]) as file:
            content = file.read(_MAX_BYTES + 1)  # whatever size the archive claims
    if len(content) > _MAX_BYTES:
        raise GeoError(f"{path}: {inside[0].filename} is larger than {_MAX_BYTES} bytes")
    return content


#: How files are read, by the ends of their names.
READERS: dict[str, Reader] = {".gpx": _gpx, ".kml": _kml, ".kmz": _kml, ".plan": _plan}
