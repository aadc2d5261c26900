"""What a saved run was made from, as it keeps it: jobs, obstacles, closed areas, digests of its files."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from auvplan.check.saved import TIME_TOLERANCE, Array, Saved, near
from auvplan.runtime.files import digest, folder_size

Spans = list[tuple[float, float]]


@dataclass(frozen=True)
class Job:
    """A task at a place, or along the straight lines between several."""

    name: str  # of the job
    places: Array  # [n, 3] m; one of a point, two or more of a line
    nodes: list[int]  # of the graph: its place, or its vertices in order
    priority: float  # before it falls
    duration: float  # s
    #: In which a task at a point begins and a part of a line lies whole, s since the departure; empty: any.
    windows: Spans
    falls: Spans  # moments, s since the departure, and the priority after each
    max_error: float | None = None  # m, standard deviation of the position on arrival, at most

    @property
    def is_line(self) -> bool:
        """Whether it is a survey line."""
        return len(self.places) > 1

    def worth(self, begins: float) -> float:
        """Return the priority at a time, s since the departure."""
        after = [priority for moment, priority in self.falls if begins > moment]
        return after[-1] if after else self.priority


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder that is known beforehand; metres and m/s, at the departure."""

    name: str
    position: tuple[float, float]
    radius: float
    depth_min: float
    depth_max: float
    velocity: tuple[float, float]

    def distance(self, places: Array, times: Array) -> Array:
        """Return the distance [n] m of places [n, 3] at times [n] s to its surface, negative inside."""
        centre = np.asarray(self.position) + times[:, None] * np.asarray(self.velocity)
        level = np.linalg.norm(places[:, :2] - centre, axis=1) - self.radius
        beyond = np.maximum(self.depth_min - places[:, 2], places[:, 2] - self.depth_max)
        return np.where(beyond > 0.0, np.hypot(np.maximum(level, 0.0), beyond), level)


@dataclass(frozen=True)
class ClosedArea:
    """Water that is closed to the vehicle."""

    name: str  # of the area
    shape: Any  # polygons in (north, east) m
    spans: Spans | None  # when it is closed, s since the departure; None for always

    def holds(self, places: Array) -> np.ndarray:
        """Return which of n places [n, 3] m lie in it."""
        return shapely.contains_xy(self.shape, places[:, 0], places[:, 1])

    def closed(self, begins: Array, ends: Array) -> np.ndarray:
        """Return whether it is closed at a moment between two times, [n] s each."""
        if self.spans is None:
            return np.ones(len(begins), bool)
        found = np.zeros(len(begins), bool)
        for first, last in self.spans:
            found |= (ends > first + TIME_TOLERANCE) & (begins < last - TIME_TOLERANCE)
        return found


def within(begins: float, ends: float, spans: Spans, slack: float = TIME_TOLERANCE) -> bool:
    """Return whether a time lies whole in one of several spans."""
    return any(opens - slack <= begins and ends <= closes + slack for opens, closes in spans)


def _spans(stated: list[list[float | None]]) -> Spans:
    return [(-np.inf if a is None else a, np.inf if b is None else b) for a, b in stated]


def read_jobs(run: Saved) -> list[Job] | None:
    """Return the jobs that a run has saved; None where it has saved none.

    The graph has them in this order: the start, a waypoint a point, the vertices of each line.
    """
    stated = run.stated("jobs")
    if stated is None:
        return None
    every = [*stated["points"], *stated["lines"]]
    places = [
        np.asarray(job["positions"] if "positions" in job else [job["position"]], float) for job in every
    ]
    first = np.cumsum([1, *map(len, places)]).tolist()
    return [
        Job(
            job["name"],
            own,
            list(range(*ends)),
            float(job["priority"]),
            float(job["duration"]),
            _spans(job["windows"]),
            [(float(moment), float(after)) for moment, after in job["falls"]],
            job.get("max_error"),
        )
        for job, own, ends in zip(every, places, pairwise(first), strict=True)
    ]


def read_obstacles(run: Saved) -> list[Cylinder]:
    """Return the obstacles known beforehand; a note says where the run has not saved them."""
    stated = run.stated("known_obstacles")
    if stated is None:
        if run.section("obstacles").get("file"):
            run.notes.append("known obstacles were not saved and not looked at")
        return []
    deep = (np.inf if one["depth_max"] is None else one["depth_max"] for one in stated)
    return [Cylinder(**(one | {"depth_max": depth})) for one, depth in zip(stated, deep, strict=True)]


def read_closed_areas(run: Saved) -> list[ClosedArea]:
    """Return the areas closed always or at some hours; notes say what the run has not saved."""
    always, stated = run.stated("closed_areas") or [], run.stated("closures")
    found = [ClosedArea(name, shapely.from_wkt(text), None) for name, text in always]
    if stated is None and run.section("chart").get("no_go"):
        run.notes.append("hours of closed areas were not saved and not looked at")
    for one in stated or []:
        if one["area"]:
            found.append(ClosedArea(one["name"], shapely.from_wkt(one["area"]), _spans(one["closed"])))
        else:
            run.notes.append(f"the outline of closed area {one['name']!r} was not saved and not looked at")
    for area in found:
        shapely.prepare(area.shape)
    return found


def source_faults(run: Saved) -> Iterator[str]:
    """Yield files beside a run that are not those it was made from; notes say what cannot be compared."""
    stated = run.stated("sources")
    if stated is None:
        run.notes.append("digests of the files that the run was made from were not saved")
    for one in stated or []:
        path = Path(one["path"])
        try:
            same = folder_size(path) == one["size"] and (not one["sha256"] or digest(path) == one["sha256"])
        except OSError:
            run.notes.append(f"{one['field']}: {path.name} is not there any more and was not compared")
            continue
        if not same:
            yield f"{one['field']}: {path.name} is not the file that the run was made from"


def job_faults(run: Saved, jobs: list[Job]) -> Iterator[str]:
    """Yield jobs that the graph of the run has in another place, of other worth or with other windows."""
    for job in jobs:
        wanted = [f"{job.name}[{k}]" for k in range(1, len(job.places) + 1)] if job.is_line else [job.name]
        chain = job.nodes
        same = chain[-1] < len(run.places) and run.names[chain[0] : chain[-1] + 1] == wanted
        if not (same and all(near(*pair) for pair in zip(run.places[chain], job.places, strict=True))):
            yield f"job {job.name!r} is not where the graph has it"
            continue
        for name, value in (("priority", job.priority), ("duration", job.duration)):
            at, along = (run[f"{of}_{name}"] for of in ("waypoint", "task"))
            own = sum(float(along[i, j]) for i, j in pairwise(chain)) if job.is_line else float(at[chain[0]])
            if not np.isclose(own, value, rtol=1e-5, atol=TIME_TOLERANCE / 10.0):
                yield f"job {job.name!r}: its {name} is {value:g}, {own:g} in the graph"
        if job.is_line or "window_opens" not in run:
            continue
        pairs = zip(*(run[f"window_{name}"][chain[0]] for name in ("opens", "closes")), strict=True)
        given = [(float(opens), float(closes)) for opens, closes in pairs if opens <= closes]
        wanted = job.windows or [(-np.inf, np.inf)]
        # Closed areas may narrow them.
        whole = bool(run.stated("closures")) or all(within(*span, given) for span in wanted)
        if not (whole and all(within(*span, wanted) for span in given)):
            yield f"job {job.name!r}: its windows are not those of the graph"


def places_of(run: Saved) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Return the conversion from m north and east of a run with a site to longitude and latitude, degrees."""
    from pyproj import Transformer  # few runs are looked at in degrees, and it takes long to load

    longitude, latitude = run.number("site_longitude"), run.number("site_latitude")
    frame = f"+proj=aeqd +lon_0={longitude!r} +lat_0={latitude!r} +datum=WGS84 +units=m"
    back = Transformer.from_crs(frame, "EPSG:4326", always_xy=True)
    origin = np.asarray(run.data.attrs["site_origin"], float)

    def places(north: Array, east: Array) -> tuple[Array, Array]:
        longitude, latitude = back.transform(np.asarray(east) - origin[1], np.asarray(north) - origin[0])
        return np.asarray(longitude), np.asarray(latitude)

    return places
