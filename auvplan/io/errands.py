"""The checker's own reading of jobs and known obstacles, which shares no code with the planner's readers."""

import csv
import json
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from defusedxml.ElementTree import fromstring

from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.ocean.known import KnownObstacle

#: Longitude and latitude, degrees, to north and east, m.
Placing = Callable[[float, float], tuple[float, float]]

_TABLES = ".csv", ".txt", ".tsv"
_NUMBERS = "lon", "longitude", "lat", "latitude", "x", "north", "y", "east", "depth", "priority", "duration"
_VISITS = 16, 19, 82  # MAVLink's commands for a place to visit


@dataclass(frozen=True)
class Errand:
    """A row of a table, or a point or line of another file.

    Attributes:
        name: as stated, or the number of the row or feature.
        stated: what else is told, by lower-case name, without what is empty.
        places: longitude, latitude, degrees, and elevation, m, where it is told; of a table without these
            columns north and east, m.
        line: whether the places are the vertices of a line.
        local: whether they are north and east.
    """

    name: str
    stated: dict[str, Any]
    places: list[list[float]]
    line: bool = False
    local: bool = False


def errands(path: Path) -> list[Errand]:
    """Return the rows or features of a file of jobs or obstacles; rows of a survey line as one.

    Raises:
        ValueError, KeyError, OSError and others: it is damaged, or of another format than its name tells.
    """
    kind = path.suffix.lower()
    read = _table if kind in _TABLES else _READERS.get(kind, _geojson)
    return list(read(path))


def jobs_of(path: Path, place: Placing, depth: float) -> Jobs:
    """Return the jobs of a file without their time windows.

    Args:
        path: of the file.
        place: to the run's metres.
        depth: m, of places that tell none.
    """
    points, lines = [], []
    for one in errands(path):
        positions = tuple(_position(one, at, place, depth) for at in one.places)
        priority, duration = float(one.stated.get("priority", 1.0)), float(one.stated.get("duration", 0.0))
        if one.line:
            lines.append(JobLine(one.name, positions, priority, duration))
        else:
            points += [JobPoint(one.name, position, priority, duration) for position in positions]
    return Jobs(tuple(points), tuple(lines))


def obstacles_of(path: Path, place: Placing) -> tuple[KnownObstacle, ...]:
    """Return the obstacles of a GeoJSON file, where they are at the scenario's epoch."""
    found = []
    for number, one in enumerate(errands(path), 1):
        stated, (at,) = one.stated, one.places
        way = np.deg2rad(float(stated.get("course", 0.0)))
        speed = float(stated.get("speed", 0.0))
        found.append(
            KnownObstacle(
                str(stated.get("name", f"obstacle {number}")),
                place(at[0], at[1]),
                float(stated["radius"]),
                float(stated.get("depth_min", 0.0)),
                float(stated.get("depth_max", np.inf)),
                (float(speed * np.cos(way)), float(speed * np.sin(way))),
            )
        )
    return tuple(found)


def _position(one: Errand, at: list[float], place: Placing, depth: float) -> tuple[float, float, float]:
    north, east = (at[0], at[1]) if one.local else place(at[0], at[1])
    if "depth" in one.stated:
        depth = float(one.stated["depth"])
    elif len(at) > 2:
        depth = max(-at[2], 0.0)
    return north, east, depth


def _filled(stated: dict[Any, Any]) -> dict[str, Any]:
    return {
        str(name).strip().lower(): value
        for name, value in stated.items()
        if name is not None and value not in (None, "") and str(value).strip()
    }


def _table(path: Path) -> Iterator[Errand]:
    rows = [row for row in path.read_text(encoding="utf-8-sig").splitlines() if row.strip(" \t,;|")]
    mark = None
    if rows[0].lower().startswith("sep="):
        mark = rows.pop(0)[4]
    mark = mark or next((sign for sign in (";", "\t", "|") if sign in rows[0]), ",")
    lines: dict[str, Errand] = {}
    found: list[Errand] = []
    for row in csv.DictReader(rows, delimiter=mark, skipinitialspace=True):
        stated = _filled({key: str(value).strip() for key, value in row.items() if key})
        if mark != ",":
            stated |= {key: stated[key].replace(",", ".") for key in _NUMBERS if key in stated}
        local = not stated.keys() & {"lon", "longitude"}
        names = (("x", "north"), ("y", "east")) if local else (("lon", "longitude"), ("lat", "latitude"))
        at = [float(stated[key]) for pair in names for key in pair if key in stated]
        if line := stated.get("line"):
            if "depth" in stated:
                at.append(-float(stated["depth"]))
            known = lines.get(line)
            if known is None:
                known = lines[line] = Errand(line, {}, [], True, local)
                found.append(known)
            known.places.append(at)
            known.stated.update({key: value for key, value in stated.items() if key != "depth"})
        else:
            found.append(
                Errand(stated.get("name", str(len(found) + 1)), stated, [at] if at else [], local=local)
            )
    yield from found


def _geojson(path: Path) -> Iterator[Errand]:
    root = json.loads(path.read_text(encoding="utf-8-sig"))
    for number, feature in enumerate(root.get("features", [root]), 1):
        stated = _filled(feature.get("properties") or {})
        name = str(stated.get("name", number)).strip()
        stack = [feature.get("geometry", feature)]
        while stack:
            shape = stack.pop(0)
            places = shape.get("coordinates")
            if shape["type"] == "GeometryCollection":
                stack = shape["geometries"] + stack
            elif shape["type"] == "MultiPoint":
                yield from (Errand(f"{name} {k}", stated, [at]) for k, at in enumerate(places, 1))
            else:
                line = shape["type"] == "LineString"
                yield Errand(name, stated, places if line else [places], line)


def _plain(element: Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _texts(element: Element) -> dict[str, str]:
    """Return the texts of the children that have one, by name."""
    return {_plain(child): child.text.strip() for child in element if child.text and child.text.strip()}


def _gpx(path: Path) -> Iterator[Errand]:
    root = fromstring(path.read_bytes())
    for number, point in enumerate((child for child in root if _plain(child) == "wpt"), 1):
        texts = _texts(point)
        at = [float(point.get("lon", "")), float(point.get("lat", ""))]
        at += [float(texts["ele"])] if "ele" in texts else []
        yield Errand(texts.get("name", str(number)), {}, [at])


def _kml(path: Path) -> Iterator[Errand]:
    data = path.read_bytes()
    if data.startswith(b"PK"):
        with zipfile.ZipFile(path) as archive:
            (name,) = (name for name in archive.namelist() if name.lower().endswith(".kml"))
            data = archive.read(name)
    marks = (element for element in fromstring(data).iter() if _plain(element) == "Placemark")
    for number, mark in enumerate(marks, 1):
        stated: dict[Any, Any] = {}
        for part in mark.iter():
            if _plain(part) == "Data":
                stated[part.get("name")] = _texts(part).get("value")
            elif _plain(part) == "SimpleData":
                stated[part.get("name")] = part.text
        shapes = [part for part in mark.iter() if _plain(part) in ("Point", "LineString")]
        own = _texts(mark).get("name")
        for count, shape in enumerate(shapes, 1):
            name = f"{own} {count}" if own and len(shapes) > 1 else own or str(number)
            texts = _texts(shape)
            places = [[float(word) for word in at.split(",")] for at in texts["coordinates"].split()]
            if texts.get("altitudeMode", "clampToGround") == "clampToGround":
                places = [at[:2] if at[2:] and at[2] >= 0.0 else at for at in places]
            yield Errand(name, _filled(stated), places, _plain(shape) == "LineString")


def _plan(path: Path) -> Iterator[Errand]:
    for number, item in enumerate(json.loads(path.read_text(encoding="utf-8-sig"))["mission"]["items"], 1):
        if item.get("type") == "SimpleItem" and item.get("command") in _VISITS:
            params = item["params"]
            height = params[6] if item.get("Altitude") is None else item["Altitude"]
            at = [params[5], params[4], *([] if height is None else [height])]
            yield Errand(str(number), {"duration": params[0] or 0.0}, [at])
        elif item.get("complexItemType") in ("survey", "CorridorScan"):
            style = item["TransectStyleComplexItem"]
            height = (style.get("CameraCalc") or {}).get("DistanceToSurface")
            tail = [] if height is None else [height]
            places = [[at[1], at[0], *tail] for at in style["VisualTransectPoints"]]
            kept = [at for at, before in zip(places, [None, *places], strict=False) if at != before]
            yield Errand(f"survey {number}", {}, kept, True)


_READERS = {".gpx": _gpx, ".kml": _kml, ".kmz": _kml, ".plan": _plan}
