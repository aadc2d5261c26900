"""Jobs by place: points to visit and lines to survey, as an operation graph between a start and a goal."""

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from auvplan.mission.graph import MissionGraph, join_parts, task_graph
from auvplan.mission.timetable import ALWAYS, NONE
from auvplan.ocean.known import KnownObstacle, keeps_off

#: Up to this many waypoints every pair is joined by default; of more, each with this many nearest ones.
COMPLETE, NEIGHBOURS = 40, 7

#: Pairs of places, the nearest first, between which detours are looked for.
_PAIRS = 8

Position = tuple[float, float, float]


@dataclass(frozen=True)
class JobPoint:
    """A place to visit.

    Attributes:
        name: of the job.
        position: north, east, down, m.
        priority: rho >= 0; a point of priority 0 and no duration is a mere waypoint.
        duration: s spent there, >= 0.
        windows: intervals in which the task may begin, s since the departure; any time where there are none.
        falls: moments, s since the departure, after which the priority is another, lower one.
        max_error: m, standard deviation of the vehicle's position on arrival, at most; None for any.
    """

    name: str
    position: Position
    priority: float = 1.0
    duration: float = 0.0
    windows: tuple[tuple[float, float], ...] = ()
    falls: tuple[tuple[float, float], ...] = ()
    max_error: float | None = None


@dataclass(frozen=True)
class JobLine:
    """A line to survey.

    Attributes:
        name: of the job.
        positions: its vertices in order, each north, east, down, m; two or more.
        priority: rho >= 0 of the whole line.
        duration: s spent on it beyond the transit itself, >= 0.
        windows: intervals in one of which each part is surveyed, s since the departure; any time where there
            are none.
        falls: as of a point, of the whole line.
    """

    name: str
    positions: tuple[Position, ...]
    priority: float = 1.0
    duration: float = 0.0
    windows: tuple[tuple[float, float], ...] = ()
    falls: tuple[tuple[float, float], ...] = ()
    max_error: float | None = None

    @property
    def parts(self) -> list[tuple[Position, Position]]:
        """Its straight parts, from vertex to vertex."""
        return list(pairwise(self.positions))


@dataclass(frozen=True)
class Jobs:
    """What is to be done.

    Attributes:
        points: places to visit.
        lines: lines to survey.
        notes: what was assumed in reading them, a line each.
    """

    points: tuple[JobPoint, ...] = ()
    lines: tuple[JobLine, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def places(self) -> list[tuple[str, Position]]:
        """Names and positions of all points, then of all corners of lines."""
        corners = [(line.name, position) for line in self.lines for position in line.positions]
        return [*((point.name, point.position) for point in self.points), *corners]

    def after(self, seconds: float) -> "Jobs":
        """Return the same jobs, their times counted from a moment that is `seconds` later."""

        def later(job: Any) -> Any:
            windows = tuple((opens - seconds, closes - seconds) for opens, closes in job.windows)
            falls = tuple((moment - seconds, priority) for moment, priority in job.falls)
            return replace(job, windows=windows, falls=falls)

        points, lines = (tuple(map(later, jobs)) for jobs in (self.points, self.lines))
        return Jobs(points, lines, self.notes)


class Terrain(NamedTuple):
    """What lies between places, and how to get round it.

    Attributes:
        clear: positions [N, 3] m to [N, N] bool, which straight lines are clear; None lets all be.
        around: for two places [3] m with no clear line between them, waypoints [K, 3] m of a detour, with
            clear lines between them, or None. They join the graph where clear lines alone leave it in parts.
        length: of the path between two places [3] m with no clear line between them, m; infinite where there
            is none. Such pairs have an edge as well, but for those of waypoints of detours.
    """

    clear: Callable[[NDArray[np.float64]], Any] | None = None
    around: Callable[[NDArray[np.float64], NDArray[np.float64]], Any] | None = None
    length: Callable[[NDArray[np.float64], NDArray[np.float64]], float] | None = None


def jobs_graph(
    points: Sequence[JobPoint],
    lines: Sequence[JobLine],
    start: Any,
    goal: Any,
    *,
    neighbours: int | None = None,
    whole: bool = False,
    terrain: Terrain | None = None,
    barred: Collection[int] = (),
) -> tuple[MissionGraph, list[str]]:
    """Return the operation graph of jobs: node 0 is the start, the last one the goal.

    In between are the points, the vertices of the lines and the waypoints of detours, in order. A point's
    task is done on arrival, whichever edge leads there. A survey line is a task on each edge between its
    consecutive vertices, in either direction: priority and duration are shared among them by
    length, so that a line half surveyed earns half. These edges are there whatever lies between.

    Args:
        points: places to visit.
        lines: lines to survey.
        start: [3] m, north, east, down.
        goal: [3] m.
        neighbours: each waypoint is joined to this many nearest ones, and more where the graph would fall
            apart; None joins all of 40 waypoints or fewer, and 7 nearest of more.
        whole: whether the ends of lines are joined to the rest as if no edge led off between them, for
            missions without `edges_off_lines`.
        terrain: what lies between the places; nothing by default.
        barred: nodes of jobs, see `kept_off`, that no edge leads to.

    Returns:
        The graph, and the name of each node: "start", "goal", a point's name, a line's with the number of
        the vertex in brackets, from 1, or "(via 1)", "(via 2)" ... of a detour.

    Raises:
        ValueError: a line has less than two vertices or two in one place; a job that no clear line and no
            detour leads to; numbers that make no graph.
    """
    terrain = terrain or Terrain()
    names = ["start", *(point.name for point in points)]
    places = [np.asarray(start, float), *(point.position for point in points)]
    parts: list[tuple[int, int, float, float]] = []
    for line in lines:
        shares = _shares(line)
        first = len(places)
        names += [f"{line.name}[{k}]" for k in range(1, len(line.positions) + 1)]
        places += line.positions
        parts += [
            (first + k, first + k + 1, line.priority * share, line.duration * share)
            for k, share in enumerate(shares)
        ]
    names.append("goal")
    places.append(np.asarray(goal, float))
    positions = np.array([_position(place, name) for place, name in zip(places, names, strict=True)])
    free, own = _passable(positions, terrain.clear), len(positions) - 1
    if len(via := _detours(positions, free, terrain)):
        positions = np.concatenate([positions[:-1], via, positions[-1:]])
        names[-1:] = [*(f"(via {k})" for k in range(1, len(via) + 1)), "goal"]
        free = _passable(positions, terrain.clear)
    line_edges = [(i, j) for i, j, _, _ in parts]
    distance = _distances(positions, free, np.r_[:own, len(positions) - 1], terrain.length)
    adjacency = _joined(distance, neighbours, line_edges, names, barred)
    if whole:
        jobs = Jobs(tuple(points), tuple(lines))
        outward = np.where(_off_lines(jobs, len(names)), np.inf, distance)
        for job in jobs_of(jobs):
            outward[np.ix_(job.nodes, job.nodes)] = np.inf
        adjacency |= _joined(outward, neighbours, line_edges, names, barred)
    tasks = [(k, point.priority, point.duration) for k, point in enumerate(points, 1)]
    edges = [(int(i), int(j)) for i, j in np.argwhere(np.triu(adjacency, 1))]
    return task_graph(positions, edges, parts, tasks).without_waypoints(barred), names


def task_hours(
    points: Sequence[JobPoint], lines: Sequence[JobLine], size: int
) -> dict[str, NDArray[np.float64]]:
    """Return when the tasks of a graph may be done and are worth less, as fields of `Timetable`.

    Empty where all may be done at any time and are worth the same.

    Args:
        points, lines: of the graph, as `jobs_graph` was given them.
        size: number of its waypoints N.
    """
    whose = {"opens": points, "closes": points, "enters": lines, "until": lines}
    counts = {name: max((len(job.windows) for job in jobs), default=0) for name, jobs in whose.items()}
    counts |= dict.fromkeys(("falls", "drops"), max((len(job.falls) for job in (*points, *lines)), default=0))
    found = {name: np.full((size, size, count), NONE[name]) for name, count in counts.items()}
    for name in whose:
        found[name][..., :1] = ALWAYS[name]
    opens, closes, enters, until, falls, drops = found.values()
    for node, point in enumerate(points, 1):
        for k, span in enumerate(point.windows):
            opens[:, node, k], closes[:, node, k] = span
        for k, fall in enumerate(_drops(point)):
            falls[:, node, k], drops[:, node, k] = fall
    first = 1 + len(points)
    for line in lines:
        for part, share in enumerate(_shares(line)):
            edges = [first + part, first + part + 1], [first + part + 1, first + part]
            for k, span in enumerate(line.windows):
                enters[(*edges, k)], until[(*edges, k)] = span
            for k, (moment, drop) in enumerate(_drops(line)):
                falls[(*edges, k)], drops[(*edges, k)] = moment, share * drop
        first += len(line.positions)
    return found if any(part.shape[-1] for part in found.values()) else {}


def _drops(job: JobPoint | JobLine) -> list[tuple[float, float]]:
    """Return the moments at which a priority falls, and by how much."""
    before = [job.priority, *(priority for _, priority in job.falls)]
    return [(moment, last - priority) for last, (moment, priority) in zip(before, job.falls, strict=False)]


def edges_off_lines(jobs: Jobs | None, adjacency: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the edges (i, j), both ways, that lead off a survey line between its ends, or on to it there.

    Without them a line is surveyed whole or not at all, from either end.

    Args:
        jobs: that `jobs_graph` made the graph of; None where its waypoints were drawn.
        adjacency: [N, N] of the graph.
    """
    return [(int(i), int(j)) for i, j in np.argwhere(_off_lines(jobs, len(adjacency)) & adjacency)]


def _off_lines(jobs: Jobs | None, size: int) -> NDArray[np.bool_]:
    """[N, N]: pairs of which one lies between the ends of a line and the other is not its neighbour there."""
    off = np.zeros((size, size), bool)
    for job in jobs_of(jobs):
        for before, node, after in zip(job.nodes, job.nodes[1:], job.nodes[2:], strict=False):
            off[node] = True
            off[node, [before, after]] = False
    return off | off.T


def jobs_done(jobs: Jobs | None, legs: Iterable[tuple[int, int]]) -> set[str]:
    """Return names of the jobs that legs complete.

    Args:
        jobs: that `jobs_graph` made the graph of; None where its waypoints were drawn.
        legs: edges (i, j) that were taken and earned something.
    """
    taken = list(legs)
    ends, edges = {goal for _, goal in taken}, {frozenset(leg) for leg in taken}
    return {
        job.name
        for job in jobs_of(jobs)
        if all(part in edges for part in map(frozenset, pairwise(job.nodes)))
        and (len(job.nodes) > 1 or job.nodes[0] in ends)
    }


class NodesOfJob(NamedTuple):
    """A job and its nodes in the graph: one of a point, all vertices of a line in their order."""

    name: str
    nodes: list[int]


def jobs_of(jobs: Jobs | None) -> list[NodesOfJob]:
    """Return where jobs are in the graph that `jobs_graph` makes of them; empty without any.

    That is said by their order, and by no name: a point may be called as a vertex of a line is.
    """
    found, first = [], 1
    for job in () if jobs is None else (*jobs.points, *jobs.lines):
        last = first + (len(job.positions) if isinstance(job, JobLine) else 1)
        found.append(NodesOfJob(job.name, list(range(first, last))))
        first = last
    return found


def kept_off(
    jobs: Jobs | None, obstacles: Sequence[KnownObstacle], margin: float, whole: bool = False
) -> dict[int, str]:
    """Return the nodes of jobs that obstacles which stand keep every vehicle off, and why.

    Args:
        jobs: that `jobs_graph` makes the graph of; None where its waypoints are drawn.
        obstacles: known beforehand; those that move keep nothing off.
        margin: m, that paths keep off them.
        whole: whether lines are surveyed whole or not at all.
    """
    found, places = dict[int, str](), [] if jobs is None else jobs.places
    for job in jobs_of(jobs):
        own: dict[int, str] = {}
        for k, node in enumerate(job.nodes, 1):
            _, position = places[node - 1]
            if why := keeps_off(np.asarray(position, float), obstacles, margin):
                what = "it" if len(job.nodes) == 1 else f"its vertex {k}"
                own[node] = f"{what} {why}: move it, or correct obstacles.file"
        if own and whole:
            own = dict.fromkeys(job.nodes, next(iter(own.values()))) | own
        found |= own
    return found


def _shares(line: JobLine) -> NDArray[np.float64]:
    """Of each part of a line, its share of the length."""
    places = np.array([_position(place, line.name) for place in line.positions])
    if len(places) < 2:
        raise ValueError(f"line {line.name!r} has {len(places)} vertices, at least two are needed")
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    if not (lengths > 0.0).all():
        k = int(np.argmin(lengths)) + 1
        raise ValueError(f"line {line.name!r}: vertices {k} and {k + 1} are in one place")
    return lengths / lengths.sum()


def _position(place: Any, name: str) -> NDArray[np.float64]:
    position = np.asarray(place, float)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise ValueError(f"{name!r}: a position is finite [north, east, down] m, got {place}")
    return position


def _passable(positions: NDArray, clear: Callable | None) -> NDArray[np.bool_]:
    size = len(positions)
    if clear is None:
        return np.ones((size, size), bool)
    free = np.asarray(clear(positions), bool)
    if free.shape != (size, size):
        raise ValueError(f"clear must give [N, N] = {(size, size)}, got shape {free.shape}")
    return free & free.T


def _detours(positions: NDArray, free: NDArray[np.bool_], terrain: Terrain) -> NDArray[np.float64]:
    """Waypoints [K, 3] m that join the parts of the graph of clear lines `free` as far as possible."""
    via, places = np.empty((0, 3)), positions
    while terrain.around is not None:
        _, label = scipy.sparse.csgraph.connected_components(free, directed=False)
        first = label == label[0]
        detour = None
        gap = np.where(first[:, None] & ~first[None, :], scipy.spatial.distance.cdist(places, places), np.inf)
        for pair in np.argsort(gap, axis=None, kind="stable")[:_PAIRS]:
            i, j = np.unravel_index(pair, gap.shape)
            if (
                np.isfinite(gap[i, j])
                and (detour := terrain.around(places[i], places[j])) is not None
                and len(detour)
            ):
                break
        if detour is None or not len(detour):
            break
        via = np.concatenate([via, detour])
        places = np.concatenate([positions, via])
        free = _passable(places, terrain.clear)
    return via


def _distances(
    positions: NDArray, free: NDArray[np.bool_], own: NDArray[np.int_], length: Callable | None
) -> NDArray[np.float64]:
    """[N, N] m along clear lines `free`, or along paths between the waypoints `own`; infinite without either.

    Of many waypoints, paths are looked for to as many of the nearest as are joined by default.
    """
    straight = scipy.spatial.distance.cdist(positions, positions)
    distance = np.where(free, straight, np.inf)
    np.fill_diagonal(distance, np.inf)
    if length is None or free.all():
        return distance
    blocked = np.where(free, np.inf, straight)[np.ix_(own, own)]
    np.fill_diagonal(blocked, np.inf)
    most = len(own) if len(own) <= COMPLETE else NEIGHBOURS
    for row, nearest in enumerate(np.argsort(blocked, axis=1, kind="stable")[:, :most]):
        for column in nearest[np.isfinite(blocked[row, nearest])]:
            i, j = sorted((int(own[row]), int(own[column])))
            if not np.isfinite(distance[i, j]):
                distance[i, j] = distance[j, i] = length(positions[i], positions[j])
    return distance


def _joined(
    distance: NDArray[np.float64],
    neighbours: int | None,
    kept: list[tuple[int, int]],
    names: list[str],
    barred: Collection[int],
) -> NDArray[np.bool_]:
    """[N, N]: each waypoint joined to its nearest ones, all connected, besides the edges that are kept.

    Waypoints that are barred have none but these.
    """
    size, shut = len(distance), np.isin(np.arange(len(distance)), list(barred))
    distance = np.where(shut[:, None] | shut, np.inf, distance)
    if neighbours is None:
        neighbours = size if size <= COMPLETE else NEIGHBOURS
    if neighbours < 1:
        raise ValueError(f"neighbours must be positive, got {neighbours}")
    adjacency = np.zeros((size, size), bool)
    nearest = np.argsort(distance, axis=1, kind="stable")[:, : min(neighbours, size - 1)]
    adjacency[np.arange(size)[:, None], nearest] = True
    adjacency &= np.isfinite(distance)
    for i, j in kept:
        adjacency[i, j] = not (shut[i] or shut[j])
    adjacency |= adjacency.T
    apart = [k for k in join_parts(adjacency, distance) if not shut[k]]
    if apart:
        cut_off = ", ".join(repr(names[k]) for k in apart[:5])
        raise ValueError(f"no clear line and no detour leads from the start to {cut_off}")
    for i, j in kept:
        adjacency[i, j] = adjacency[j, i] = True
    return adjacency
