"""Jobs from files: GeoJSON (RFC 7946), CSV (RFC 4180, or as spreadsheets write it), GPX, KML, `.plan`."""

import csv
import difflib
import io
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from auvplan.errors import warn
from auvplan.io.geo.error import Faults, GeoError, label, number_of, reading
from auvplan.io.geo.features import (
    READERS,
    Feature,
    Features,
    check_place,
    local_positions,
    read_features,
)
from auvplan.io.geo.windows import Hours
from auvplan.mission.jobs import JobLine, JobPoint, Jobs, Position
from auvplan.runtime.files import read_text
from auvplan.runtime.formatting import counted
from auvplan.site import Site, is_place

#: When a job may be done and when it is worth less; a survey line states it in any of its rows.
_HOURS = ("from", "to", "windows", "window", "priority_after")
_PROPERTIES = {name: name for name in ("depth", "priority", "duration", "max_error", "name", *_HOURS)}
_HEADINGS = {
    "lon": "lon", "longitude": "lon", "lat": "lat", "latitude": "lat",
    "x": "north", "north": "north", "y": "east", "east": "east", **_PROPERTIES, "line": "line",
}  # fmt: skip
#: A first line that names the separator of a table's cells.
_SEPARATOR = re.compile(r"sep=(.)\s*$", re.IGNORECASE)
#: What numbers that are often written otherwise look like.
_SUCH = {"lon": " of degrees such as -5.4321", "lat": " of degrees such as 56.1234"}
#: Speed of the current, m/s, at a place [3] m and times [n] s.
Speed = Callable[[Position, np.ndarray], np.ndarray]
#: The name of a row in messages, and its cells by heading.
_Row = tuple[str, dict[str, str]]
#: By how much a depth and an elevation may differ and still say the same, m.
_SAME = 1e-3
#: Numbers without a unit that name a place so near the site, m, in degrees are degrees.
_NEAR = 200_000.0
#: What jobs have: in which unit, and what operators and other programs call it.
_WORDS = {
    "duration": ("s", "dwell dwell_time hold hold_time holdtime loiter loiter_time wait wait_time stay time "
                      "time_on_site time_on_station service_time bottom_time seconds secs minutes hours"),
    "priority": ("a number, 0 or more", "weight importance value reward rank score rho profit urgency"),
    "max_error": ("m", "position_error position_std"),
    "depth": ("m, positive down", "z down altitude alt elevation elev height level"),
    "name": ("", "id fid label title job job_name job_id task task_name waypoint wp site station"),
    "from": ("a moment, a time of day or seconds", "earliest start_time not_before begin after opens open"),
    "to": ("a moment, a time of day or seconds",
           "latest end_time not_after end before deadline due closes close"),
    "windows": ("", "time_window time_windows opening_hours"),
    "line": ("", "track transect survey line_id line_name lawnmower segment group"),
    "lon": ("degrees east", "lng x_deg long_deg"),
    "lat": ("degrees north", "y_deg"),
    "north": ("m from the site", "northing n y_local"),
    "east": ("m from the site", "easting e x_local"),
}  # fmt: skip
_MEANT = {word: kind for kind, (_, words) in _WORDS.items() for word in words.split()}
#: What is asked of jobs elsewhere and has no counterpart here.
_UNHEEDED = "speed heading course yaw radius required mandatory enabled skip order sequence seq"
#: A unit or a remark after a name: "depth [m]", "duration_s", "prio.".
_UNIT = re.compile(
    r"[\s_]*[\[({].*|[\s_.]+(m|s|sec|secs|seconds|min|mins|minutes|h|hours|deg|degrees|metres|meters)?\.?$"
)


def read_jobs(
    source: Features,
    site: Site | None,
    *,
    default_depth: float = 0.0,
    until: float = 86_400.0,
    since: float = 0.0,
    speed: Speed | None = None,
) -> Jobs:
    """Read points to visit and lines to survey.

    GeoJSON: Point, MultiPoint (a job each, named "name 1", "name 2", ...) and LineString with the properties
    `depth` m, `priority`, `duration` s and `name`; a third coordinate is the elevation, less the depth. CSV,
    with commas, semicolons or tabs: columns longitude and latitude (or lon, lat), or north and east in local
    metres (or x and y, which are read as these, with a warning); depth, priority, duration, name; rows with
    the same value in the column `line` are the vertices of a survey line of that name, in order, with its
    priority and duration. GPX: its waypoints, whose elevation is less the depth. KML and KMZ: points, and
    lines to survey, with depth, priority and duration in their extended data. QGroundControl's `.plan`:
    waypoints with their hold time, and the transects of a survey as one line. Headings and properties are
    read in either case; other ones are left. A name that is missing is the job's number in the file; priority
    is 1 and duration 0 s by default, which is noted of formats for places. A task may have a time window,
    `from` and `to`, or several `windows`: see `Hours.windows`. `priority_after` says at which moments the
    priority falls, and to what: see `Hours.falls`. `max_error` is the standard deviation, m, that the
    vehicle's position may have on arrival.

    Args:
        source: .csv, .txt or .tsv for CSV, .gpx, .kml, .kmz, .plan, else GeoJSON; or features (`Features`).
        site: where local coordinates count from; None where the file has local metres.
        default_depth: m, of places for which the file gives none.
        until: s since the departure, when missions are over at the latest.
        since: s since the departure, when the first mission departs, 0 or before.
        speed: m/s, of the current at a place [3] m and times [n] s, for windows of slack water; None where
            no current is forecast.

    Returns:
        The jobs, in the order of the file; positions are local north, east, down, m.

    Raises:
        GeoError: names the file and the row or the number of the feature; its `lines` are all that is wrong.

    Warns:
        ScenarioWarning: columns x and y, headings that look as if they were to mean something, and routes and
            tracks of a GPX file, which are ignored.
    """
    if not (np.isfinite(default_depth) and default_depth >= 0.0):
        raise GeoError(f"default_depth must not be negative, got {default_depth}")
    path = label(source)
    with reading(path):
        faults, notes = Faults(), []
        suffix = Path(path).suffix.lower() if isinstance(source, str | Path) else ""
        if suffix in (".csv", ".txt", ".tsv"):
            features = _table(Path(path), site, faults)
        elif suffix in READERS:
            features = list(READERS[suffix](Path(path), faults, notes))
            for name, words in (("priority", "1"), ("duration", "0 s"), ("depth", f"{default_depth:g} m")):
                lacking = 0
                for one in features:
                    first = one.coordinates if one.kind == "Point" else one.coordinates[0]
                    elevated = name == "depth" and len(first) > 2  # which gives the depth too
                    lacking += one.properties.get(name) in (None, "") and not elevated
                if lacking:
                    share = f"{lacking} of {counted(len(features), 'job')}"
                    notes.append(f"{path}: {name} is not given by {share}: taken as {words}")
        else:
            features = read_features(source, ("Point", "MultiPoint", "LineString"))
        if site is None and (placed := [feature.where for feature in features if not feature.local]):
            raise GeoError(f"{placed[0]}: longitude and latitude need a site")
        mission, found = _Mission(site, default_depth, until, since, speed), []
        doubts: dict[str, str] = {}
        slips: dict[str, str] = {}  # what is the same in many features is reported for the first
        for feature in features:
            try:
                doubts = _check_headings(feature.where, feature.properties, _PROPERTIES) | doubts
            except GeoError as error:
                slips = {line.removeprefix(feature.where): line for line in error.lines} | slips
            with faults.kept():
                found += mission.jobs_of(feature, faults)
        for line in doubts.values():
            warn(line)
        faults.lines += slips.values()
        faults.refuse(max(len(features), faults.places))
        counts = Counter(job.name for job in found)
        twice = {name: "two" if count == 2 else count for name, count in counts.items() if count > 1}
        if twice:
            raise GeoError(*(f"{path}: {count} jobs are named {name!r}" for name, count in twice.items()))
        points = tuple(job for job in found if isinstance(job, JobPoint))
        return Jobs(points, tuple(job for job in found if isinstance(job, JobLine)), tuple(notes))


@dataclass(frozen=True)
class _Mission:
    """What jobs are read for; attributes as of `read_jobs`."""

    site: Site | None
    default_depth: float
    until: float
    since: float
    speed: Speed | None

    def jobs_of(self, feature: Feature, faults: Faults) -> list[JobPoint] | list[JobLine]:
        """Return the jobs of a feature."""
        where, stated = feature.where, feature.properties
        numbers = _numbers(where, stated, faults)
        priority = 1.0 if numbers["priority"] is None else numbers["priority"]
        duration = numbers["duration"] or 0.0
        name = str(stated.get("name", "")).strip() or str(feature.number)
        job = where if repr(name) in where else f"{where}, job {name!r}"
        hours = Hours(job, stated, self.site, self.until, self.since)
        places, error = self._places(feature, numbers["depth"]), numbers["max_error"]
        falls = ()
        with faults.kept():
            falls = hours.falls(priority)
        if feature.kind == "LineString":
            for k, (a, b) in enumerate(pairwise(places), 1):
                if a == b:
                    raise GeoError(f"{where}: positions {k} and {k + 1} are the same place")
            windows = hours.windows(None, self._fastest(places))
            return [JobLine(name, tuple(places), priority, duration, windows, falls, error)]
        names = [name] if feature.kind == "Point" else [f"{name} {k + 1}" for k in range(len(places))]
        return [
            JobPoint(
                one, place, priority, duration, hours.windows(duration, self._fastest([place])), falls, error
            )
            for one, place in zip(names, places, strict=True)
        ]

    def _fastest(self, places: Sequence[Position]) -> Callable[[np.ndarray], np.ndarray] | None:
        """Return the current's speed at times, the greatest of those at some places."""
        if (speed := self.speed) is None:
            return None
        return lambda times: np.max([speed(place, times) for place in places], axis=0)

    def _places(self, feature: Feature, depth: float | None) -> list[Position]:
        """Local positions of a feature, whose depth may be given by its property or by its elevations."""
        where, found = feature.where, []
        at = local_positions(feature, self.site, 2 if feature.kind == "LineString" else 1)
        for north, east, elevation in at.tolist():
            if depth is not None and abs(depth + elevation) > _SAME:
                what = f"the elevation {elevation:g} m, which is its negative"
                raise GeoError(f"{where}: depth {depth:g} m contradicts {what}")
            if elevation > _SAME:
                raise GeoError(f"{where}: elevation {elevation:g} m is above the sea: a depth of 5 m is -5")
            down = self.default_depth if depth is None else depth
            if depth is None and not np.isnan(elevation):
                down = max(0.0, -elevation)
            found.append((north, east, down))
        return found


def _table(path: Path, site: Site | None, faults: Faults) -> list[Feature]:
    """Return the rows of a table as features; those of a survey line are one, which they state together."""
    given, axes, rows = _rows(path, faults)
    if not faults.lines:
        with faults.kept():
            _check_reading(path, given, rows, site)
    faults.places += len(rows)
    found: list[Feature] = []
    for line, group in groupby(rows, lambda row: row[1].get("line", "")):
        members = list(group)
        name = f"{path}: line {line!r}" if line else ""
        if line and any(one.where == name for one in found):
            faults.lines.append(f"{members[0][0]}: line {line!r} goes on after other rows")
            continue
        for part in [members] if line else [[row] for row in members]:
            places, stated = _stated_together(part, axes, faults)
            if len(places) == len(part):
                kind, at = ("LineString", places) if line else ("Point", places[0])
                own = {"name": line} if line else {}
                found.append(
                    Feature(name or part[0][0], len(found) + 1, kind, at, stated | own, axes[0] == "north")
                )
    return found


def _stated_together(
    rows: list[_Row], axes: tuple[str, str], faults: Faults
) -> tuple[list[list[float]], dict[str, Any]]:
    """Return the places of rows, with elevations where they state a depth, and what else they state together.

    A row that is at fault has no place.
    """
    places, known = [], {}
    for where, row in rows:
        stated: dict[str, Any] = _numbers(where, row, faults)
        depth = stated.pop("depth")
        stated |= {name: row[name] for name in ("name", *_HOURS) if name in row}
        with faults.kept():
            place = []
            for name, value in [(name, _number(where, row, name, least=-np.inf)) for name in axes]:
                if value is None:
                    raise GeoError(f"{where}: {name} is missing")
                place.append(value)
            if axes[0] == "lon":
                check_place(where, *place)
            place += [] if depth is None else [-depth]
            for name, value in stated.items():
                if value is not None and known.setdefault(name, value) != value and name != "name":
                    old, new = (f"{one:g}" if isinstance(one, float) else one for one in (known[name], value))
                    line = f"line {row['line']!r} has {name} {old} in an earlier row, {new} in this"
                    raise GeoError(f"{where}: {line}")
            places.append(place)
    return places, known


def _check_reading(path: Path, given: list[str], rows: list[_Row], site: Site | None) -> None:
    """Warn of columns x and y, and refuse degrees under headings of metres."""
    if "x" in given or "y" in given:
        warn(
            f"{path}: the columns x and y are read as metres north and east of the site: "
            "name them north and east, or longitude and latitude"
        )
    try:
        places = [(float(row["north"]), float(row["east"])) for _, row in rows]
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


def _rows(path: Path, faults: Faults) -> tuple[list[str], tuple[str, str], list[_Row]]:
    """The headings, and those of places; the name in messages of each sound row, and its cells by heading."""
    text = read_text(path, GeoError)
    heading = next((line for line in text.splitlines() if line.strip()), "")
    if named := _SEPARATOR.match(heading):  # as some spreadsheets want it
        text = text.replace(heading, "", 1)
    separator = named[1] if named else next((mark for mark in (";", "\t", "|") if mark in heading), ",")
    table = list(csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True))
    filled = [(number, row) for number, row in enumerate(table, 1) if any(cell.strip() for cell in row)]
    if len(filled) < 2:
        raise GeoError(f"{path}: has no rows of jobs under a row of headings")
    given = [cell.strip().lower() for cell in filled[0][1]]
    with faults.kept():
        for line in _check_headings(str(path), given, _HEADINGS).values():
            warn(line)
    columns = [_HEADINGS.get(name) for name in given]
    used = Counter(name for name in columns if name)
    faults.lines += [f"{path}: two columns map to {name}" for name, count in used.items() if count > 1]
    # A column whose heading is all but one that is known is checked as that one.
    for number, name in enumerate(given):
        meant = _HEADINGS.get(_slip_of(name, _HEADINGS)) if columns[number] is None else None
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
        cells = zip(columns, map(str.strip, row), strict=False)
        rows.append((where, {name: cell for name, cell in cells if name and cell}))
    if separator != ",":
        _point_decimals(rows, faults)
    return given, pairs[0], rows


def _point_decimals(rows: list[_Row], faults: Faults) -> None:
    """Replace commas in numbers: where they do not part cells they part decimals, and points do not."""
    numbers = [
        (where, cells, name)
        for where, cells in rows
        for name in cells.keys()
        & {"lon", "lat", "north", "east", "depth", "priority", "duration", "max_error"}
    ]
    commas = any("," in cells[name] for _, cells, name in numbers)
    for where, cells, name in numbers:
        if commas and "." in cells[name]:
            faults.lines.append(
                f"{where}: {name} {cells[name]!r} has a point, where other numbers have commas"
            )
        cells[name] = cells[name].replace(",", ".")


def _numbers(where: str, stated: dict[str, Any], faults: Faults) -> dict[str, float | None]:
    """Return a job's depth, priority, duration and greatest error; None of what is absent or at fault."""
    found: dict[str, float | None] = dict.fromkeys(("depth", "priority", "duration", "max_error"))
    for name in found:
        with faults.kept():
            found[name] = _number(where, stated, name)
    return found


def _number(where: str, stated: dict[str, Any], name: str, least: float = 0.0) -> float | None:
    """Return a finite number >= `least`, or None where there is none."""
    value = stated.get(name)
    if value is None or value == "":
        return None
    if not np.isfinite(number := number_of(value)):
        raise GeoError(
            f"{where}: {name} must be a finite number{_SUCH.get(name, '')}, got {str(value)[:40]!r}"
        )
    if number < least:
        raise GeoError(f"{where}: {name} must be at least {least:g}, got {number:g}")
    return number


def _check_headings(where: str, given: Iterable[str], known: Mapping[str, str]) -> dict[str, str]:
    """Refuse a name that is all but one that means something, and doubt one that may stand for it.

    Returns:
        By name, what to warn of: it is another word for something that is not given, or asks for what jobs do
        not have; it is ignored.

    Raises:
        GeoError: a name differs from a known one by a slip of the pen, an abbreviation or a unit.
    """
    stated = {known[name] for name in given if name in known}
    others = [name for name in dict.fromkeys(given) if name not in known]
    meant = {name: slip for name in others if (slip := _slip_of(name, known))}
    if meant:
        raise GeoError(
            *(
                f"{where}: unknown name {name!r}, did you mean {slip!r}{_in_words(known[slip])}?"
                for name, slip in meant.items()
            )
        )
    doubts = {}
    for name in others:
        kind = _MEANT.get(_plain(name), "")
        if kind in known and kind not in stated:
            doubts[name] = f"{where}: {name!r} is ignored: did you mean {kind!r}{_in_words(kind)}?"
        elif _plain(name) in _UNHEEDED.split():
            what = "jobs have a place, priority, duration, name and time windows alone"
            doubts[name] = f"{where}: {name!r} is ignored: {what}"
    return doubts


def _slip_of(name: str, known: Mapping[str, str]) -> str:
    """Return the known name that a name all but is, or an empty string."""
    plain = _plain(name)
    if plain in known:
        return plain
    if len(plain) < 3 or plain in _MEANT:
        return ""
    begun = [word for word in known if word.startswith(plain)]
    if len(plain) > 3:
        begun += difflib.get_close_matches(plain, [word for word in known if len(word) > 3], 1, cutoff=0.8)
    return begun[0] if begun else ""


def _plain(name: str) -> str:
    return _UNIT.sub("", name.strip()).replace(" ", "_").replace("-", "_")


def _in_words(kind: str) -> str:
    return f" ({_WORDS[kind][0]})" if kind in _WORDS and _WORDS[kind][0] else ""
