"""XML: GPX 1.1 and KML 2.2, and what others are written with. Elevations and altitudes are minus depth.

GPX has the plan as a route and what was executed as a track. KML has Google's tracks, which can be played in
time; its altitudes are absolute: by default they would be ignored and everything be laid on the ground.
Without an epoch there are no times, and lines take the place of KML's tracks.
"""

from functools import partial
from xml.etree import ElementTree

import numpy as np

from auvplan.export.fences import Circle
from auvplan.export.itinerary import (
    Itinerary,
    degrees,
    geographic,
    metres,
    moment,
    rings_around,
    waypoints,
)
from auvplan.runtime.arrays import Array
from auvplan.runtime.formatting import plain
from auvplan.site import Site

Element = ElementTree.Element

_GPX = "http://www.topografix.com/GPX/1/1"
_KML, _GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"

#: Colours, aabbggrr: plan, executed, fences.
_COLOURS = {"plan": "ffb8680a", "executed": "ff2b9af2", "fence": "ff3030c0"}


def child(parent: Element, name: str, text: str | None = None, *, space: str = "", **given: str) -> Element:
    """Append an element, of a namespace; characters that XML does not know become question marks."""
    clean = {key: plain(value) for key, value in given.items()}
    element = ElementTree.SubElement(parent, f"{{{space}}}{name}" if space else name, clean)
    element.text = None if text is None else plain(text)
    return element


def xml_text(root: Element) -> bytes:
    """Return a document in UTF-8, indented."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def gpx_text(itinerary: Itinerary) -> bytes:
    """Return a GPX document."""
    ElementTree.register_namespace("", _GPX)
    add, site = partial(child, space=_GPX), itinerary.site
    creator = f"auvplan {itinerary.version}".strip()
    root = ElementTree.Element(f"{{{_GPX}}}gpx", {"version": "1.1", "creator": creator})

    def add_point(parent: Element, name: str, place: Array, seconds: float) -> Element:
        longitude, latitude, altitude = place
        east = degrees(longitude)
        # The schema's longitudes end just before 180.
        east = degrees(-180.0) if east == degrees(180.0) else east
        point = add(parent, name, lat=degrees(latitude), lon=east)
        add(point, "ele", metres(altitude))
        if (when := moment(site, seconds)) is not None:
            add(point, "time", when)
        return point

    about = add(root, "metadata")
    add(about, "name", itinerary.name)
    add(about, "desc", itinerary.description)
    route = add(root, "rte")
    add(route, "name", f"{itinerary.name}, plan")
    add(route, "desc", "; ".join(leg.note for leg in itinerary.legs))
    for row in waypoints(itinerary):
        place = np.array([row.longitude, row.latitude, -row.depth])
        point = add_point(route, "rtept", place, row.seconds)
        add(point, "name", row.name)
        if row.task:
            add(point, "desc", row.task)
    if itinerary.executed:
        track = add(root, "trk")
        add(track, "name", f"{itinerary.name}, executed")
        for leg in itinerary.executed:
            segment = add(track, "trkseg")
            for place, time in zip(geographic(site, leg.positions), leg.times.tolist(), strict=True):
                add_point(segment, "trkpt", place, time)
    return xml_text(root)


def kml_text(itinerary: Itinerary) -> bytes:
    """Return a KML document."""
    ElementTree.register_namespace("", _KML)
    ElementTree.register_namespace("gx", _GX)
    add, site = partial(child, space=_KML), itinerary.site
    root = ElementTree.Element(f"{{{_KML}}}kml")
    document = add(root, "Document")
    add(document, "name", itinerary.name)
    add(document, "description", itinerary.description)
    for name, colour in _COLOURS.items():
        style = add(document, "Style", id=name)
        line = add(style, "LineStyle")
        add(line, "color", colour)
        add(line, "width", "2")
        add(add(style, "PolyStyle"), "color", "60" + colour[2:])

    def add_folder(name: str) -> Element:
        folder = add(document, "Folder")
        add(folder, "name", name)
        return folder

    def add_mark(folder: Element, name: str, style: str, about: str | None = None) -> Element:
        mark = add(folder, "Placemark")
        add(mark, "name", name)
        if about is not None:
            add(mark, "description", about)
        add(mark, "styleUrl", f"#{style}")
        return mark

    def add_path(mark: Element, positions: Array, times: Array) -> None:
        places = _tuples(positions, site)
        if site.epoch is None:
            line = add(mark, "LineString")
            add(line, "altitudeMode", "absolute")
            add(line, "coordinates", " ".join(map(",".join, places)))
            return
        track = add(mark, "Track", space=_GX)
        add(track, "altitudeMode", "absolute")
        for time in times.tolist():
            add(track, "when", moment(site, time))
        for place in places:
            add(track, "coord", " ".join(place), space=_GX)

    plan = add_folder("plan")
    for leg in itinerary.legs:
        title = f"leg {leg.number}: {leg.start_name} to {leg.goal_name}"
        add_path(add_mark(plan, title, "plan", leg.note), leg.positions, leg.times)
    marks = add_folder("waypoints")
    for row in waypoints(itinerary):
        left = "" if np.isnan(row.charge) else f", charge {100.0 * row.charge:.0f} %"
        about = f"depth {row.depth:.1f} m, leg {row.leg}{left}. {row.task}".strip()
        mark = add_mark(marks, row.name, "plan", about)
        if (when := moment(site, row.seconds)) is not None:
            # A time comes before a style in the schema's order of elements.
            stamp = ElementTree.Element(f"{{{_KML}}}TimeStamp")
            add(stamp, "when", when)
            mark.insert(len(mark) - 1, stamp)
        point = add(mark, "Point")
        add(point, "altitudeMode", "absolute")
        add(point, "coordinates", ",".join(*_tuples(row.position[None], site)))
    executed = add_folder("executed")
    for number, track in enumerate(itinerary.executed, 1):
        add_path(add_mark(executed, f"leg {number}, executed", "executed"), track.positions, track.times)
    fences = add_folder("fences")
    for number, fence in enumerate(itinerary.fences, 1):
        name = fence.name if isinstance(fence, Circle) and fence.name else f"exclusion {number}"
        parent, rings = add_mark(fences, name, "fence"), rings_around(fence.corners, site)
        if len(rings) > 1:
            parent = add(parent, "MultiGeometry")
        for corners in rings:
            ring = add(add(add(parent, "Polygon"), "outerBoundaryIs"), "LinearRing")
            places = (f"{degrees(x)},{degrees(y)},{metres(0.0)}" for x, y in corners.tolist())
            add(ring, "coordinates", " ".join(places))
    return xml_text(root)


def _tuples(positions: Array, site: Site) -> list[tuple[str, str, str]]:
    """Longitude, latitude and altitude of positions [n, 3] m, as text."""
    return [(degrees(x), degrees(y), metres(z)) for x, y, z in geographic(site, positions)]
