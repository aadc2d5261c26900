"""GeoJSON by RFC 7946: longitude, latitude, elevation; rings counter-clockwise; cut at the antimeridian."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from auvplan.export.fences import Circle
from auvplan.export.itinerary import DEGREES, Itinerary, elevation, moment, waypoints
from auvplan.export.speeds import ground_share
from auvplan.runtime.files import write_atomically
from auvplan.site import Site

Array = NDArray[np.floating]


def geojson(itinerary: Itinerary) -> dict[str, Any]:
    """Return a FeatureCollection: planned and executed legs as lines of all samples, waypoints, fences."""
    site = itinerary.site
    features = []
    for leg in itinerary.legs:
        about = {
            "kind": "plan", "leg": leg.number, "from": leg.start_name, "to": leg.goal_name, "note": leg.note,
            "hold_s": leg.hold, "priority": leg.priority,
            "ground_speed_share": round(ground_share(leg, itinerary.speed), 3),
        }  # fmt: skip
        features.append(_feature(_line(leg.positions, site), about | _times(leg.times, site)))
    for sequence, row in enumerate(waypoints(itinerary), 1):
        about = {
            "kind": "waypoint", "sequence": sequence, "leg": row.leg, "name": row.name, "depth_m": row.depth,
            "hold_s": row.hold, "priority": row.priority, "task": row.task,
            "seconds": round(row.seconds, 3), "time": moment(site, row.seconds),
        }  # fmt: skip
        place = [round(row.longitude, DEGREES), round(row.latitude, DEGREES), elevation(row.depth)]
        features.append(_feature({"type": "Point", "coordinates": place}, about))
    for number, track in enumerate(itinerary.executed, 1):
        about = {"kind": "executed", "leg": number} | _times(track.times, site)
        features.append(_feature(_line(track.positions, site), about))
    for fence in itinerary.fences:
        about = {"kind": "exclusion"}
        if isinstance(fence, Circle):
            about |= ({"name": fence.name} if fence.name else {}) | {"radius_m": fence.radius}
        features.append(_feature(_area(fence.corners, site), about))
    return {
        "type": "FeatureCollection",
        "name": itinerary.name,
        "description": itinerary.description,
        "configuration": itinerary.configuration,
        "features": features,
    }


def write_geojson(itinerary: Itinerary, path: str | Path) -> Path:
    """Write a `.geojson` file.

    Raises:
        OutputError: the operating system refused; one line that names the file.
    """
    text = json.dumps(geojson(itinerary), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    return write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _times(times: Array, site: Site) -> dict[str, Any]:
    """When the samples are passed: s since the epoch, and times of day where there is an epoch."""
    seconds = [round(float(time), 3) for time in times]
    return {"seconds": seconds, "times": [moment(site, time) for time in times] if site.epoch else None}


def _line(positions: Array, site: Site) -> dict[str, Any]:
    """Return a line through positions [n, 3] m, in parts where it crosses the antimeridian."""
    longitude, latitude = site.to_geographic(positions[:, 0], positions[:, 1])
    rows = np.stack([longitude, latitude, -positions[:, 2]], axis=1)
    parts, start = [], 0
    steps = np.diff(rows[:, 0])
    head: list[Array] = []
    for k in np.flatnonzero(np.abs(steps) > 180.0):
        edge = np.copysign(180.0, rows[k, 0])
        there = rows[k + 1] + np.array([2.0 * edge, 0.0, 0.0])
        share = (edge - rows[k, 0]) / (there[0] - rows[k, 0]) if there[0] != rows[k, 0] else 0.0
        cut = rows[k] + share * (there - rows[k])
        parts.append([*head, *rows[start : k + 1], np.array([edge, *cut[1:]])])
        head, start = [np.array([-edge, *cut[1:]])], k + 1
    parts.append([*head, *rows[start:]])
    lines = [
        [[round(float(row[0]), DEGREES), round(float(row[1]), DEGREES), elevation(-row[2])] for row in part]
        for part in parts
    ]
    return _one_or_many("LineString", lines)


def _area(corners: Array, site: Site) -> dict[str, Any]:
    """Return a polygon by corners [k, 2] m north, east; two where it lies across the antimeridian."""
    longitude, latitude = site.to_geographic(corners[:, 0], corners[:, 1])
    near = np.degrees(np.unwrap(np.radians(longitude)))
    whole = shapely.Polygon(np.stack([near, latitude], axis=1))
    rings = []
    for turn in (-360.0, 0.0, 360.0):
        world = shapely.box(turn - 180.0, -90.0, turn + 180.0, 90.0)
        if whole.within(world):
            parts = [whole]
        else:
            parts = [part for part in shapely.get_parts(whole.intersection(world)) if part.area > 0.0]
        for part in parts:
            ring = np.asarray(shapely.orient_polygons(part).exterior.coords) - (turn, 0.0)
            rings.append([np.round(ring, DEGREES).tolist()])
    return _one_or_many("Polygon", rings)


def _one_or_many(kind: str, parts: list[Any]) -> dict[str, Any]:
    one = len(parts) == 1
    return {"type": kind if one else f"Multi{kind}", "coordinates": parts[0] if one else parts}
