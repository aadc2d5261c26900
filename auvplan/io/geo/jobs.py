"""Jobs from files: GeoJSON (RFC 7946), CSV (RFC 4180, or as spreadsheets write it), GPX, KML, `.plan`."""

import csv
import io
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from auvplan.errors import ScenarioWarning
from auvplan.io.geo.error import Faults, GeoError, read_text, reading
from auvplan.io.geo.geojson import Feature, check_place, is_place, positions, read_features
from auvplan.io.geo.headings import check_headings, slip_of
from auvplan.io.geo.places import READERS, read_places
from auvplan.io.geo.windows import read_falls, read_windows
from auvplan.mission.jobs import JobLine, JobPoint, Jobs, Position
from auvplan.site import Site
from auvplan.words import counted

_MAX_BYTES = 50_000_000
#: What tells when a job may be done and is worth less; a survey line tells it in any of its rows.
_HOURS = ("from", "to", "windows", "window", "priority_after")
_PROPERTIES = {name: name for name in ("depth", "priority", "duration", "name", *_HOURS)}
_HEADINGS = {
    "lon": "lon",
    "longitude": "lon",
    "lat": "lat",
    "latitude": "lat",
    "x": "north",
    "north": "north",
    "y": "east",
    "east": "east",
    **{name: name for name in ("depth", "priority", "duration", "name", "line", *_HOURS)},
}
#: The first line of a table that tells how its cells are parted.
_SEPARATOR = re.compile(r"sep=(.)\s*$", re.IGNORECASE)
#: What numbers that are often written otherwise look like.
_SUCH = {"lon": " of degrees such as -5.4321", "lat": " of degrees such as 56.1234"}
#: Speed of the current, m/s, at a place [3] m and times [n] s.
Speed = Callable[[Position, np.ndarray], np.ndarray]
#: By how much a depth and an elevation may differ and still say the same, m.
_SAME = 1e-3
#: Numbers without a unit that name a place so near the site, m, in degrees are degrees.
_NEAR = 200_000.0


def read_jobs(
    path: str | Path,
    site: Site | None,
    *,
    default_depth: float = 0.0,
    until: float = 86_400.0,
    speed: Speed | None = None,
) -> Jobs:
    """Read points to visit and lines to survey.

    GeoJSON: Point, MultiPoint (a job each, named "name 1", "name 2", ...) and LineString with the properties
    `depth` m, `priority`, `duration` s and `name`; a third coordinate is the elevation, less the depth. CSV,
    with commas, semicolons or tabs: columns longitude and latitude (or lon, lat), or north and east in local
    metres (or x and y, which are read as these, with a warning); depth, priority, duration, name; rows with
    the same value in the column `line` are the vertices of a survey line of that name, in order, and tell its
    priority and duration. GPX: its waypoints, whose elevation is less the depth. KML and KMZ: points, and
    lines to survey, with depth, priority and duration in their extended data. QGroundControl's `.plan`:
    waypoints with their hold time, and the transects of a survey as one line. Headings and properties are
    read in either case; other ones are left, see `check_headings`. A name that is missing is the job's number
    in the file; priority is 1 and duration 0 s by default, which the notes tell of formats for places. A task
    may have a time window, `from` and `to`, or several `windows`: see `read_windows`. `priority_after` says
    at which moments the priority falls, and to what: see `read_falls`.

    Args:
        path: .csv, .txt or .tsv for CSV, .gpx, .kml, .kmz, .plan, else GeoJSON.
        site: where local coordinates count from; None where the file has local metres.
        default_depth: m, of places for which the file tells none.
        until: s since the departure, when missions are over at the latest.
        speed: m/s, of the current at a place [3] m and times [n] s, for windows of slack water; None where
            no current is forecast.

    Returns:
        The jobs, in the order of the file; positions are local north, east, down, m.

    Raises:
        GeoError: names the file and the row or the number of the feature; its `lines` are all that is wrong.

    Warns:
        ScenarioWarning: columns x and y, headings that look as if they were to mean something, and routes and
            tracks of a GPX file, which are left unread.
    """
    if not (np.isfinite(default_depth) and default_depth >= 0.0):
        raise GeoError(f"default_depth must not be negative, got {default_depth}")
    path = Path(path)
    with reading(path):
        if path.suffix.lower() in (".csv", ".txt", ".tsv"):
            jobs = _table(path, site, default_depth, until, speed)
        else:
            jobs = _features(path, site, default_depth, until, speed)
        counts = Counter(job.name for job in (*jobs.points, *jobs.lines))
        twice = [
            f"{path}: {'two' if count == 2 else count} jobs are named {name!r}"
            for name, count in counts.items()
            if count > 1
        ]
        if twice:
            raise GeoError(*twice)
        return jobs


def _features(path: Path, site: Site | None, default_depth: float, until: float, speed: Speed | None) -> Jobs:
    foreign = path.suffix.lower() in READERS
    if site is None:
        kind = path.suffix.lower() if foreign else "GeoJSON"
        raise GeoError(f"{path}: {kind} is in longitude and latitude, which need a site")
    found: list[JobPoint | JobLine] = []
    faults, notes = Faults(), []
    if foreign:
        features = read_places(path, faults, notes)
        notes += _defaults(path, features, default_depth)
    else:
        features = read_features(path, ("Point", "MultiPoint", "LineString"))
    doubts: dict[str, str] = {}
    slips: dict[str, str] = {}  # what is the same in many features is reported for the first
    for feature in features:
        try:
            doubts = check_headings(feature.where, feature.properties, _PROPERTIES) | doubts
        except GeoError as error:
            slips = {line.removeprefix(feature.where): line for line in error.lines} | slips
        with faults.kept():
            found += _jobs_of(feature, site, default_depth, until, speed, faults)
    _warn_all(doubts.values())
    faults.lines += slips.values()
    faults.refuse(len(features))
    return Jobs(
        tuple(job for job in found if isinstance(job, JobPoint)),
        tuple(job for job in found if isinstance(job, JobLine)),
        tuple(notes),
    )


def _defaults(path: Path, features: list[Feature], default_depth: float) -> list[str]:
    """Return what is assumed of features that do not tell it: formats for places seldom do."""
    notes = []
    for name, words in (("priority", "1"), ("duration", "0 s"), ("depth", f"{default_depth:g} m")):
        lacking = [one for one in features if one.properties.get(name) in (None, "")]
        if name == "depth":
            lacking = [one for one in lacking if not _has_elevation(one)]
        if lacking:
            share = f"{len(lacking)} of {counted(len(features), 'job')}"
            notes.append(f"{path}: {name} is not given by {share}: taken as {words}")
    return notes


def _has_elevation(feature: Feature) -> bool:
    first = feature.coordinates if feature.kind == "Point" else feature.coordinates[0]
    return len(first) > 2


def _warn_all(lines: Iterable[str]) -> None:
    for line in lines:
        warnings.warn(line, ScenarioWarning, stacklevel=2)


def _jobs_of(
    feature: Feature, site: Site, default_depth: float, until: float, speed: Speed | None, faults: Faults
) -> list[JobPoint | JobLine]:
    where, stated = feature.where, feature.properties
    numbers = _numbers(where, stated, faults)
    depth, priority = numbers["depth"], 1.0 if numbers["priority"] is None else numbers["priority"]
    duration = numbers["duration"] or 0.0
    name = str(stated.get("name", "")).strip() or str(feature.number)
    places = _places(feature, site, depth, default_depth)
    job = f"{where}, job {name!r}"
    falls = read_falls(job, stated, site, priority)
    if feature.kind == "LineString":
        windows = read_windows(job, stated, site, None, until, _fastest(speed, places))
        return [_line(where, name, places, priority, duration, windows, falls)]
    names = [name] if feature.kind == "Point" else [f"{name} {k}" for k in range(1, len(places) + 1)]
    return [
        JobPoint(
            one,
            place,
            priority,
            duration,
            read_windows(job, stated, site, duration, until, _fastest(speed, [place])),
            falls,
        )
        for one, place in zip(names, places, strict=True)
    ]


def _fastest(speed: Speed | None, places: Sequence[Position]) -> Callable[[np.ndarray], np.ndarray] | None:
    """Return the current's speed at times, the greatest of those at some places."""
    if speed is None:
        return None
    return lambda times: np.max([speed(place, times) for place in places], axis=0)


def _places(feature: Feature, site: Site, depth: float | None, default_depth: float) -> list[Position]:
    """Local positions of a feature, whose depth may be given by its property or by its elevations."""
    coordinates = [feature.coordinates] if feature.kind == "Point" else feature.coordinates
    at = positions(feature.where, coordinates, 2 if feature.kind == "LineString" else 1)
    north, east = site.to_local(at[:, 0], at[:, 1])
    if not np.isfinite((north, east)).all():
        raise GeoError(f"{feature.where}: has no place in the site's local metres")
    return [
        (float(n), float(e), _depth(feature.where, depth, elevation, default_depth))
        for n, e, elevation in zip(north, east, at[:, 2], strict=True)
    ]


def _depth(where: str, depth: float | None, elevation: float, default_depth: float) -> float:
    if np.isnan(elevation):
        return default_depth if depth is None else depth
    if depth is not None and abs(depth + elevation) > _SAME:
        raise GeoError(
            f"{where}: depth {depth:g} m contradicts the elevation {elevation:g} m, which is its negative"
        )
    if elevation > _SAME:
        raise GeoError(f"{where}: elevation {elevation:g} m is above the sea: a depth of 5 m is -5")
    return max(0.0, -elevation) if depth is None else depth


def _table(path: Path, site: Site | None, default_depth: float, until: float, speed: Speed | None) -> Jobs:
    given, rows, faults = _rows(path)
    if not faults.lines:
        with faults.kept():
            _check_reading(path, given, rows, site)
    points: list[JobPoint] = []
    vertices: dict[str, list[Position]] = {}
    shared: dict[str, dict[str, float | None]] = {}
    hours: dict[str, dict[str, str]] = {}
    broken: set[str] = set()
    last = ""
    for where, row in rows:
        line, before = row.get("line", ""), last
        last = line
        broken.add(line)  # until all of the row is read
        sound = len(faults.lines)
        stated = _numbers(where, row, faults)
        depth = stated.pop("depth")
        depth = default_depth if depth is None else depth
        with faults.kept():
            place = *_place(where, row, site), depth
            if not line:
                priority = 1.0 if stated["priority"] is None else stated["priority"]
                duration = stated["duration"] or 0.0
                name = row.get("name") or str(len(points) + len(vertices) + 1)
                job = f"{where}, job {name!r}"
                windows = read_windows(job, row, site, duration, until, _fastest(speed, [place]))
                falls = read_falls(job, row, site, priority)
                points.append(JobPoint(name, place, priority, duration, windows, falls))
            elif line in vertices and line != before:
                raise GeoError(f"{where}: line {line!r} goes on after other rows")
            else:
                vertices.setdefault(line, []).append(place)
                _agree(where, line, shared.setdefault(line, dict.fromkeys(stated)), stated)
                _agree_on_hours(where, line, hours.setdefault(line, {}), row)
            if len(faults.lines) == sound:
                broken.discard(line)
    lines = []
    for name, places in vertices.items():
        priority, duration = shared[name]["priority"], shared[name]["duration"]
        priority = 1.0 if priority is None else priority
        with faults.kept():
            if name not in broken:
                where, stated = f"{path}: line {name!r}", hours[name]
                windows = read_windows(where, stated, site, None, until, _fastest(speed, places))
                falls = read_falls(where, stated, site, priority)
                lines.append(_line(where, name, places, priority, duration or 0.0, windows, falls))
    faults.refuse(len(rows))
    return Jobs(tuple(points), tuple(lines))


def _check_reading(
    path: Path, given: list[str], rows: list[tuple[str, dict[str, str]]], site: Site | None
) -> None:
    """Warn of columns x and y, and refuse degrees under headings of metres."""
    if "x" in given or "y" in given:
        warnings.warn(
            f"{path}: the columns x and y are read as metres north and east of the site: "
            "name them north and east, or longitude and latitude",
            ScenarioWarning,
            stacklevel=2,
        )
    places = []
    for _, row in rows:
        try:
            places.append((float(row["north"]), float(row["east"])))
        except (KeyError, ValueError):
            return  # degrees as such, or a fault that is reported for its row
    if site is None or not places:
        return
    names = [name for kind in ("north", "east") for name in given if _HEADINGS.get(name) == kind]
    for order, kinds in ((1, ("longitude", "latitude")), (-1, ("latitude", "longitude"))):
        turned = [place[::order] for place in places]
        if not all(is_place(*place) for place in turned):
            continue
        north, east = site.to_local(*np.transpose(turned))
        if (np.hypot(north - site.origin[0], east - site.origin[1]) < _NEAR).all():
            like = f"{kinds[0]} and {kinds[1]}, such as ({places[0][0]:g}, {places[0][1]:g})"
            raise GeoError(
                f"{path}: columns {names[0]} and {names[1]} are metres from the site, but look like {like}: "
                "rename them"
            )


def _rows(path: Path) -> tuple[list[str], list[tuple[str, dict[str, str]]], Faults]:
    """The headings; each sound row with what messages call it and its filled cells by their plain heading."""
    text = read_text(path, _MAX_BYTES)
    heading = next((line for line in text.splitlines() if line.strip()), "")
    if said := _SEPARATOR.match(heading):  # as some spreadsheets want it
        text = text.replace(heading, "", 1)
    separator = said[1] if said else next((mark for mark in (";", "\t", "|") if mark in heading), ",")
    table = list(csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True))
    filled = [(number, row) for number, row in enumerate(table, 1) if any(cell.strip() for cell in row)]
    if len(filled) < 2:
        raise GeoError(f"{path}: has no rows of jobs under a row of headings")
    given = [cell.strip().lower() for cell in filled[0][1]]
    faults = Faults()
    with faults.kept():
        _warn_all(check_headings(str(path), given, _HEADINGS).values())
    columns = [_HEADINGS.get(name) for name in given]
    used = Counter(name for name in columns if name)
    faults.lines += [f"{path}: two columns tell {name}" for name, count in used.items() if count > 1]
    # A column whose heading is all but one that is known is checked as that one.
    for number, name in enumerate(given):
        meant = _HEADINGS.get(slip_of(name, _HEADINGS)) if columns[number] is None else None
        if meant and not used[meant]:
            columns[number], used[meant] = meant, 1
    pairs = [pair for pair in (("lon", "lat"), ("north", "east")) if set(pair) & used.keys()]
    if len(pairs) != 1 or not set(pairs[0]) <= used.keys():
        faults.lines.append(
            f"{path}: needs the columns longitude and latitude, or north and east; "
            f"it has {', '.join(given)[:80]}"
        )
        faults.refuse()
    rows = []
    for number, row in filled[1:]:
        where = f"{path}: row {number}"
        if len(row) > len(columns) and any(cell.strip() for cell in row[len(columns) :]):
            faults.lines.append(f"{where}: has {len(row)} cells under {len(columns)} headings")
            continue
        cells = {
            name: cell.strip() for name, cell in zip(columns, row, strict=False) if name and cell.strip()
        }
        rows.append((where, cells))
    if separator != ",":
        _point_decimals(rows, faults)
    return given, rows, faults


def _point_decimals(rows: list[tuple[str, dict[str, str]]], faults: Faults) -> None:
    """Replace commas in numbers: where they do not part cells they part decimals, and points do not."""
    numbers = [
        (where, cells, name)
        for where, cells in rows
        for name in cells.keys() & {"lon", "lat", "north", "east", "depth", "priority", "duration"}
    ]
    commas = any("," in cells[name] for _, cells, name in numbers)
    for where, cells, name in numbers:
        if commas and "." in cells[name]:
            faults.lines.append(
                f"{where}: {name} {cells[name]!r} has a point, where other numbers have commas"
            )
        cells[name] = cells[name].replace(",", ".")


def _place(where: str, row: dict[str, str], site: Site | None) -> tuple[float, float]:
    """Local north and east of a row, m."""
    names = ("lon", "lat") if {"lon", "lat"} & row.keys() else ("north", "east")
    a, b = (_number(where, row, name, None, least=-np.inf) for name in names)
    if a is None or b is None:
        raise GeoError(f"{where}: {names[0] if a is None else names[1]} is missing")
    if names[0] == "north":
        return a, b
    check_place(where, a, b)
    if site is None:
        raise GeoError(f"{where}: longitude and latitude need a site")
    north, east = (float(c) for c in site.to_local(a, b))
    if not np.isfinite((north, east)).all():
        raise GeoError(f"{where}: has no place in the site's local metres")
    return north, east


def _agree(where: str, line: str, known: dict[str, float | None], stated: dict[str, float | None]) -> None:
    for name, value in stated.items():
        if value is None:
            continue
        if known[name] is not None and known[name] != value:
            raise GeoError(
                f"{where}: line {line!r} has {name} {known[name]:g} in an earlier row, {value:g} in this"
            )
        known[name] = value


def _agree_on_hours(where: str, line: str, known: dict[str, str], row: dict[str, str]) -> None:
    for name in _HOURS:
        if name in row and known.setdefault(name, row[name]) != row[name]:
            raise GeoError(
                f"{where}: line {line!r} has {name} {known[name]} in an earlier row, {row[name]} in this"
            )


def _line(
    where: str,
    name: str,
    places: list[Position],
    priority: float,
    duration: float,
    windows: tuple[tuple[float, float], ...],
    falls: tuple[tuple[float, float], ...],
) -> JobLine:
    if len(places) < 2:
        raise GeoError(f"{where}: a survey line needs at least two positions, got {len(places)}")
    for k, (a, b) in enumerate(pairwise(places), 1):
        if a == b:
            raise GeoError(f"{where}: positions {k} and {k + 1} are the same place")
    return JobLine(name, tuple(places), priority, duration, windows, falls)


def _numbers(where: str, stated: dict[str, Any], faults: Faults) -> dict[str, float | None]:
    """Return what a job tells of its depth, priority and duration; None of what is absent or at fault."""
    found: dict[str, float | None] = dict.fromkeys(("depth", "priority", "duration"))
    for name in found:
        with faults.kept():
            found[name] = _number(where, stated, name, None)
    return found


def _number(where: str, stated: dict[str, Any], name: str, default: Any, least: float = 0.0) -> Any:
    """Return a finite number >= `least`, or the default where there is none."""
    value = stated.get(name)
    if value is None or value == "":
        return default
    try:
        number = float("nan") if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = float("nan")
    if not np.isfinite(number):
        what = f"a finite number{_SUCH.get(name, '')}"
        raise GeoError(f"{where}: {name} must be {what}, got {str(value)[:40]!r}")
    if number < least:
        raise GeoError(f"{where}: {name} must be at least {least:g}, got {number:g}")
    return number
