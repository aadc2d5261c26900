"""GeoJSON by RFC 7946: longitude, latitude, elevation; rings counter-clockwise; cut at the antimeridian."""

import json
from typing import Any

import numpy as np

from auvplan.export.fences import Circle
from auvplan.export.itinerary import (
    DEGREES,
    Itinerary,
    elevation,
    geographic,
    moment,
    rings_around,
    waypoints,
)
from auvplan.export.speeds import ground_share
from auvplan.runtime.arrays import Array
from auvplan.site import Site


def geojson_text(itinerary: Itinerary) -> bytes:
    """Return a FeatureCollection: planned and executed legs as lines of all samples, waypoints, fences."""
    site = itinerary.site
    features = []

    def add(kind: str, geometry: dict[str, Any], about: dict[str, Any]) -> None:
        features.append({"type": "Feature", "geometry": geometry, "properties": {"kind": kind} | about})

    for leg in itinerary.legs:
        line, times = _timed(leg.positions, leg.times, site)
        add("plan", line, {
            "leg": leg.number, "from": leg.start_name, "to": leg.goal_name, "note": leg.note,
            "hold_s": leg.hold, "priority": leg.priority,
            "ground_speed_share": round(ground_share(leg, itinerary.through_water(leg)), 3),
            **_speed(leg.speed),
        } | times)  # fmt: skip
    speeds = {leg.number: leg.speed for leg in itinerary.legs}
    for sequence, row in enumerate(waypoints(itinerary), 1):
        place = [round(row.longitude, DEGREES), round(row.latitude, DEGREES), elevation(row.depth)]
        add("waypoint", {"type": "Point", "coordinates": place}, {
            "sequence": sequence, "leg": row.leg, "name": row.name, "depth_m": row.depth,
            "hold_s": row.hold, "priority": row.priority, "task": row.task,
            "seconds": round(row.seconds, 3), "time": moment(site, row.seconds), **_speed(speeds[row.leg]),
        } | ({} if np.isnan(row.charge) else {"charge": round(row.charge, 4)}))  # fmt: skip
    for number, track in enumerate(itinerary.executed, 1):
        line, times = _timed(track.positions, track.times, site)
        add("executed", line, {"leg": number} | times)
    for turn in itinerary.turns:
        kind, last = ("turn back", -1) if turn.past is None else ("skip", turn.past)
        add(kind, _line(_cut(geographic(site, turn.positions))), {
            "leg": turn.leg + 1, "from": itinerary.legs[turn.leg].goal_name,
            "to": itinerary.legs[last].goal_name,
            "leave_later_than_s": round(turn.latest, 3),
            "leave_later_than": moment(site, turn.latest) if site.epoch else None,
            "takes_s": round(turn.takes, 3),
        })  # fmt: skip
    for fence in itinerary.fences:
        about: dict[str, Any] = {}
        if isinstance(fence, Circle):
            about = ({"name": fence.name} if fence.name else {}) | {"radius_m": fence.radius}
        rings = [[np.round(ring, DEGREES).tolist()] for ring in rings_around(fence.corners, site)]
        add("exclusion", _one_or_many("Polygon", rings), about)
    collection = {
        "type": "FeatureCollection",
        "name": itinerary.name,
        "description": itinerary.description,
        "configuration": itinerary.configuration,
        "features": features,
    }
    return (json.dumps(collection, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()


def _speed(speed: float | None) -> dict[str, float]:
    """The speed through the water of a leg that has its own."""
    return {} if speed is None else {"speed_m_s": round(speed, 4)}


def _timed(positions: Array, times: Array, site: Site) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a line through positions [n, 3] m, and when each of its vertices is passed.

    That is in s since the epoch, and in times of day where there is an epoch: one of each for every vertex,
    part after part, also where the line is cut.
    """
    parts = _cut(np.column_stack([geographic(site, positions), times]))
    passed = [float(row[3]) for part in parts for row in part]
    seconds = [round(time, 3) for time in passed]
    days = [moment(site, time) for time in passed] if site.epoch else None
    return _line(parts), {"seconds": seconds, "times": days}


def _cut(rows: Array) -> list[list[Array]]:
    """Return rows [n, K], of longitudes first, in parts where they cross the antimeridian.

    There each part has a row more, between those on either side.
    """
    parts, start = [], 0
    head: list[Array] = []
    for k in np.flatnonzero(np.abs(np.diff(rows[:, 0])) > 180.0):
        edge = np.copysign(180.0, rows[k, 0])
        there = np.array([rows[k + 1, 0] + 2.0 * edge, *rows[k + 1, 1:]])
        share = (edge - rows[k, 0]) / (there[0] - rows[k, 0]) if there[0] != rows[k, 0] else 0.0
        cut = rows[k] + share * (there - rows[k])
        parts.append([*head, *rows[start : k + 1], np.array([edge, *cut[1:]])])
        head, start = [np.array([-edge, *cut[1:]])], k + 1
    parts.append([*head, *rows[start:]])
    return parts


def _line(parts: list[list[Array]]) -> dict[str, Any]:
    """Return a line of rows of longitude, latitude and m above the surface, in one part or several."""
    lines = [
        [[round(float(x), DEGREES), round(float(y), DEGREES), elevation(-z)] for x, y, z, *_ in part]
        for part in parts
    ]
    return _one_or_many("LineString", lines)


def _one_or_many(kind: str, parts: list[Any]) -> dict[str, Any]:
    one = len(parts) == 1
    return {"type": kind if one else f"Multi{kind}", "coordinates": parts[0] if one else parts}
