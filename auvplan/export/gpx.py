"""GPX 1.1: the plan as a route, what was executed as a track; elevation is minus depth."""

from pathlib import Path
from xml.etree import ElementTree

from auvplan.export.itinerary import Itinerary
from auvplan.export.markup import Element, child, write_xml
from auvplan.export.places import degrees, metres, moment, waypoints

_GPX = "http://www.topografix.com/GPX/1/1"


def write_gpx(itinerary: Itinerary, path: str | Path) -> Path:
    """Write a `.gpx` file; without times where the site has no epoch.

    Raises:
        OutputError: the operating system refused; one line that names the file.
    """
    ElementTree.register_namespace("", _GPX)
    root = ElementTree.Element(
        f"{{{_GPX}}}gpx", {"version": "1.1", "creator": f"auvplan {itinerary.version}".strip()}
    )
    about = _add(root, "metadata")
    _add(about, "name", itinerary.name)
    _add(about, "desc", itinerary.description)
    site = itinerary.site
    route = _add(root, "rte")
    _add(route, "name", f"{itinerary.name}, plan")
    _add(route, "desc", "; ".join(leg.note for leg in itinerary.legs))
    for row in waypoints(itinerary):
        point = _point(route, "rtept", row.longitude, row.latitude, -row.depth, moment(site, row.seconds))
        _add(point, "name", row.name)
        if row.task:
            _add(point, "desc", row.task)
    if itinerary.executed:
        track = _add(root, "trk")
        _add(track, "name", f"{itinerary.name}, executed")
        for leg in itinerary.executed:
            segment = _add(track, "trkseg")
            longitude, latitude = site.to_geographic(leg.positions[:, 0], leg.positions[:, 1])
            for k, time in enumerate(leg.times):
                when = moment(site, float(time))
                _point(segment, "trkpt", float(longitude[k]), float(latitude[k]), -leg.positions[k, 2], when)
    return write_xml(root, path)


def _add(parent: Element, name: str, text: str | None = None) -> Element:
    return child(parent, f"{{{_GPX}}}{name}", text)


def _point(
    parent: Element, name: str, longitude: float, latitude: float, elevation: float, when: str | None
) -> Element:
    east = degrees(longitude)
    # The schema's longitudes end just before 180.
    place = {"lat": degrees(latitude), "lon": degrees(-180.0) if east == degrees(180.0) else east}
    point = child(parent, f"{{{_GPX}}}{name}", None, place)
    _add(point, "ele", metres(elevation))
    if when is not None:
        _add(point, "time", when)
    return point
