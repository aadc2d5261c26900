"""XML: GPX 1.1 and KML 2.2, and what others are written with. Elevations and altitudes are minus depth.

GPX has the plan as a route and what was executed as a track. KML has Google's tracks, which can be played in
time; its altitudes are absolute: by default they would be ignored and everything be laid on the ground.
"""

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from auvplan.export.fences import Circle
from auvplan.export.itinerary import Itinerary, degrees, metres, moment, waypoints
from auvplan.runtime.files import write_atomically
from auvplan.runtime.formatting import plain
from auvplan.site import Site

Array = NDArray[np.floating]
Element = ElementTree.Element

_GPX = "http://www.topografix.com/GPX/1/1"
_KML, _GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"

#: Colours, aabbggrr: plan, executed, fences.
_COLOURS = {"plan": "ffb8680a", "executed": "ff2b9af2", "fence": "ff3030c0"}


def child(
    parent: Element, name: str, text: str | None = None, attributes: Mapping[str, str] | None = None
) -> Element:
    """Append an element; characters that XML does not know become question marks."""
    clean = {key: plain(value) for key, value in (attributes or {}).items()}
    element = ElementTree.SubElement(parent, name, clean)
    element.text = None if text is None else plain(text)
    return element


def write_xml(root: Element, path: str | Path) -> Path:
    """Write a document in UTF-8, indented.

    Raises:
        OutputError: the operating system refused; one line that names the file.
    """
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return write_atomically(path, lambda part: part.write_bytes(text + b"\n"))


def write_gpx(itinerary: Itinerary, path: str | Path) -> Path:
    """Write a `.gpx` file; without times where the site has no epoch.

    Raises:
        OutputError: the operating system refused; one line that names the file.
    """
    ElementTree.register_namespace("", _GPX)
    creator = f"auvplan {itinerary.version}".strip()
    root = ElementTree.Element(f"{{{_GPX}}}gpx", {"version": "1.1", "creator": creator})
    about = _gpx(root, "metadata")
    _gpx(about, "name", itinerary.name)
    _gpx(about, "desc", itinerary.description)
    site = itinerary.site
    route = _gpx(root, "rte")
    _gpx(route, "name", f"{itinerary.name}, plan")
    _gpx(route, "desc", "; ".join(leg.note for leg in itinerary.legs))
    for row in waypoints(itinerary):
        point = _gpx_point(route, "rtept", row.longitude, row.latitude, -row.depth, moment(site, row.seconds))
        _gpx(point, "name", row.name)
        if row.task:
            _gpx(point, "desc", row.task)
    if itinerary.executed:
        track = _gpx(root, "trk")
        _gpx(track, "name", f"{itinerary.name}, executed")
        for leg in itinerary.executed:
            segment = _gpx(track, "trkseg")
            longitude, latitude = site.to_geographic(leg.positions[:, 0], leg.positions[:, 1])
            for k, time in enumerate(leg.times):
                place = float(longitude[k]), float(latitude[k]), -leg.positions[k, 2]
                _gpx_point(segment, "trkpt", *place, moment(site, float(time)))
    return write_xml(root, path)


def _gpx(parent: Element, name: str, text: str | None = None) -> Element:
    return child(parent, f"{{{_GPX}}}{name}", text)


def _gpx_point(
    parent: Element, name: str, longitude: float, latitude: float, elevation: float, when: str | None
) -> Element:
    east = degrees(longitude)
    # The schema's longitudes end just before 180.
    place = {"lat": degrees(latitude), "lon": degrees(-180.0) if east == degrees(180.0) else east}
    point = child(parent, f"{{{_GPX}}}{name}", None, place)
    _gpx(point, "ele", metres(elevation))
    if when is not None:
        _gpx(point, "time", when)
    return point


def write_kml(itinerary: Itinerary, path: str | Path) -> Path:
    """Write a `.kml` file; where the site has no epoch, lines without times take the place of tracks.

    Raises:
        OutputError: the operating system refused; one line that names the file.
    """
    ElementTree.register_namespace("", _KML)
    ElementTree.register_namespace("gx", _GX)
    root = ElementTree.Element(f"{{{_KML}}}kml")
    document = _add(root, "Document")
    _add(document, "name", itinerary.name)
    _add(document, "description", itinerary.description)
    for name, colour in _COLOURS.items():
        style = child(document, f"{{{_KML}}}Style", None, {"id": name})
        line = _add(style, "LineStyle")
        _add(line, "color", colour)
        _add(line, "width", "2")
        _add(_add(style, "PolyStyle"), "color", "60" + colour[2:])
    site = itinerary.site
    plan = _folder(document, "plan")
    for leg in itinerary.legs:
        title = f"leg {leg.number}: {leg.start_name} to {leg.goal_name}"
        _path(_placemark(plan, title, "plan", leg.note), leg.positions, leg.times, site)
    marks = _folder(document, "waypoints")
    for row in waypoints(itinerary):
        about = f"depth {row.depth:.1f} m, leg {row.leg}. {row.task}".strip()
        mark = _placemark(marks, row.name, "plan", about)
        when = moment(site, row.seconds)
        if when is not None:
            # A time comes before a style in the schema's order of elements.
            stamp = ElementTree.Element(f"{{{_KML}}}TimeStamp")
            _add(stamp, "when", when)
            mark.insert(len(mark) - 1, stamp)
        point = _add(mark, "Point")
        _add(point, "altitudeMode", "absolute")
        _add(point, "coordinates", _tuples(row.position[None], site, ","))
    executed = _folder(document, "executed")
    for number, track in enumerate(itinerary.executed, 1):
        _path(_placemark(executed, f"leg {number}, executed", "executed"), track.positions, track.times, site)
    fences = _folder(document, "fences")
    for number, fence in enumerate(itinerary.fences, 1):
        name = fence.name if isinstance(fence, Circle) and fence.name else f"exclusion {number}"
        polygon = _add(_placemark(fences, name, "fence"), "Polygon")
        ring = _add(_add(polygon, "outerBoundaryIs"), "LinearRing")
        # Counter-clockwise, at the surface; the first corner again at the end.
        corners = np.pad([*fence.corners[::-1], fence.corners[-1]], ((0, 0), (0, 1)))
        _add(ring, "coordinates", _tuples(corners, site, ","))
    return write_xml(root, path)


def _add(parent: Element, name: str, text: str | None = None, space: str = _KML) -> Element:
    return child(parent, f"{{{space}}}{name}", text)


def _folder(document: Element, name: str) -> Element:
    folder = _add(document, "Folder")
    _add(folder, "name", name)
    return folder


def _placemark(folder: Element, name: str, style: str, description: str | None = None) -> Element:
    mark = _add(folder, "Placemark")
    _add(mark, "name", name)
    if description is not None:
        _add(mark, "description", description)
    _add(mark, "styleUrl", f"#{style}")
    return mark


def _path(mark: Element, positions: Array, times: Array, site: Site) -> None:
    """A track in time, or a line where there is no epoch."""
    if site.epoch is None:
        line = _add(mark, "LineString")
        _add(line, "altitudeMode", "absolute")
        _add(line, "coordinates", _tuples(positions, site, ","))
        return
    track = _add(mark, "Track", space=_GX)
    _add(track, "altitudeMode", "absolute")
    for time in times:
        _add(track, "when", moment(site, float(time)))
    for place in _tuples(positions, site, " ", "\n").split("\n"):
        _add(track, "coord", place, _GX)


def _tuples(positions: Array, site: Site, comma: str, between: str = " ") -> str:
    """Longitude, latitude, altitude of positions [n, 3] m, as text."""
    longitude, latitude = site.to_geographic(positions[:, 0], positions[:, 1])
    rows = zip(longitude, latitude, -positions[:, 2], strict=True)
    return between.join(comma.join((degrees(x), degrees(y), metres(z))) for x, y, z in rows)
