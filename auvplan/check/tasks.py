"""Visits and tasks of a saved run, counted again from its scenario and its track, and their windows.

What a leg earned is worked out here, by this module's own rules: tasks at places and along lines come from
the jobs that the run was planned for where it has some, else from the graph that the seed drew.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from auvplan.check.inputs import Job, job_faults, read_jobs, within
from auvplan.check.lines import line_faults, line_of, share_of_line
from auvplan.check.saved import PLACE_TOLERANCE, TIME_TOLERANCE, Array, Leg, Saved, near
from auvplan.runtime.files import MISSION, SUMMARY

#: Priorities may differ by so much where they should agree.
_PRIORITY_TOLERANCE = 1e-6
#: Share of a priority by which one may be off that counts by the length covered of a line.
_LINE_TOLERANCE = 1e-3

#: s from the edge of a window within which an arrival may have missed it.
_EDGE = 1.0

#: Standard deviations by which the time of a task that scatters may be off.
_SPREAD = 6.0

#: A path over waypoints not yet visited counts as open if it takes less than this share of the time left, at
#: the least speed that may be chosen, in still water: a contrary current may double the time of a path.
_SURELY_IN_TIME = 0.5


@dataclass(frozen=True)
class Earned:
    """What a leg does: priority, time on station in s, and the number of tasks that it completes."""

    priority: float
    duration: float
    tasks: int


def task_faults(run: Saved) -> Iterator[str]:
    """Waypoints that are visited twice, and tasks that are counted twice, not at all or wrongly."""
    jobs, planning = read_jobs(run), run.section("planning")
    once = (planning.get("visits") or ("edges" if planning.get("preset") == "paper" else "once")) == "once"
    if jobs is not None:
        yield from job_faults(run, jobs)
    elif run.section("mission").get("jobs") is not None:
        run.notes.append(
            f"jobs were not saved: tasks were counted from the graph in {MISSION}, without windows"
        )
    account = _tasks_of(run, jobs, once)
    under_way = _under_way(run)
    scatter = _SPREAD * float(run.section("mission").get("duration_error") or 0.0) * run.simulated
    visited, refused = {int(run.number("start"))}, set()
    total, tasks, slack = 0.0, 0, _PRIORITY_TOLERANCE
    for leg in run.legs:
        if not leg.executed:
            refused |= {(leg.start, leg.goal), (leg.goal, leg.start)}
        if not leg.arrived or leg.goal not in range(len(run.adjacency)):
            continue
        revisit = leg.goal in visited
        if revisit and once and (path := _path_left(run, leg, visited, refused)):
            yield f"{leg}: waypoint {leg.goal} is visited twice, although {path}"
        share = share_of_line(run, leg)
        earned = account.earn(leg, revisit, share)
        if leg.missed:  # whether its window was, is looked up with the windows
            earned = Earned(0.0, 0.0, 0)
        allowed = _PRIORITY_TOLERANCE + (0.0 if share == 1.0 else _LINE_TOLERANCE * earned.priority)
        slack += allowed
        if abs(earned.priority - leg.priority) > allowed:
            yield f"{leg}: counts a priority of {leg.priority:g}, its tasks are worth {earned.priority:g}"
        takes = 0.0 if under_way else earned.duration
        if abs(takes - leg.t_task) > TIME_TOLERANCE + scatter * takes:
            yield f"{leg}: spends {leg.t_task:.2f} s on tasks that take {takes:.2f} s"
        total, tasks = total + earned.priority, tasks + earned.tasks
        visited |= {leg.start, leg.goal}
    summary = run.summary
    if summary["tasks"] != tasks or not abs(summary["total_priority"] - total) <= slack:
        given = f"{summary['tasks']} tasks of priority {summary['total_priority']:g}"
        yield f"{given} in {SUMMARY}, {tasks} of {total:g} were done"
    yield from line_faults(run)
    yield from _route_faults(run, jobs, once)


def _tasks_of(run: Saved, jobs: list[Job] | None, once: bool) -> "_GraphTasks | _JobTasks":
    """Return the tasks that are to be done."""
    return _GraphTasks.of(run, once) if jobs is None else _JobTasks.of(jobs)


def _route_faults(run: Saved, jobs: list[Job] | None, once: bool) -> Iterator[str]:
    """Yield routes that expect the impossible, or a priority that its tasks do not have."""
    if "route_nodes" not in run or not run.legs:
        return
    # Without jobs, or times of the legs, it is not known by how much priorities fall.
    falling = any(name in run for name in ("edge_enters", "edge_falls", "window_opens"))
    start, under_way = int(run.number("start")), _under_way(run)
    fastest = float(run.data.attrs.get("vehicle_surge_max", np.inf))
    free = run.get("task_followable", np.ones(run.adjacency.shape))
    for number, made_at in enumerate(run["route_made_at"]):
        account = _tasks_of(run, jobs, once)
        visited, total = {start}, 0.0
        done = [leg for leg in run.legs if leg.arrived and leg.begins < made_at - TIME_TOLERANCE]
        ahead = _expected_legs(run, number)
        for place, leg in enumerate((*done, *ahead)):
            revisit, share = leg.goal in visited, float(free[leg.start, leg.goal])
            if jobs is not None and place >= len(done):
                takes = replace(account).earn(leg, revisit, share).duration
                leg = replace(leg, times=leg.times - takes)
            earned = account.earn(leg, revisit, share)
            if place >= len(done):
                total += earned.priority
                lasts = leg.t_expected - (0.0 if under_way else earned.duration)
                length = float(np.linalg.norm(leg.positions[1] - leg.positions[0]))
                if length > fastest * lasts + PLACE_TOLERANCE:
                    yield (
                        f"route {number}: expects to make the {length:.0f} m from waypoint {leg.start} to "
                        f"{leg.goal} in {lasts:.0f} s, the vehicle's limit is {fastest:g} m/s over ground"
                    )
            visited |= {leg.start, leg.goal}
        given = float(run["route_priority"][number])
        timed = falling and (jobs is None or not all(np.isfinite(leg.t_expected) for leg in ahead))
        if given - total > _PRIORITY_TOLERANCE or (not timed and total - given > _PRIORITY_TOLERANCE):
            yield f"route {number}: its tasks are worth {total:g}, its priority is given as {given:g}"


def _expected_legs(run: Saved, number: int) -> list[Leg]:
    """Return the legs that a route expects, in the form of one: their times are when it is left again."""
    nodes = run["route_nodes"][number]
    nodes = nodes[nodes >= 0]
    lasts, waits = np.full(len(nodes), np.nan), np.zeros(len(nodes))
    if "route_leg_time" in run:
        lasts, waits = (run[f"route_{name}"][number] for name in ("leg_time", "wait"))
    left = float(run["route_made_at"][number]) + np.cumsum(lasts)
    return [
        replace(
            run.legs[0], start=i, goal=j, positions=run.places[[i, j]], times=left[[k]], t_wait=0.0,
            t_expected=float(lasts[k] - waits[k]),
        )
        for k, (i, j) in enumerate(pairwise(nodes.tolist()))
    ]  # fmt: skip


def _under_way(run: Saved) -> bool:
    """Return whether tasks are done along the paths, in no time of their own."""
    planning = run.section("planning")
    rule = planning.get("task_time") or ("expected" if planning.get("preset") == "paper" else "whole")
    return rule == "expected" and run.section("mission").get("jobs") is None


def _path_left(run: Saved, leg: Leg, visited: set[int], refused: set[tuple[int, int]]) -> str:
    """The path over other waypoints that was left when a leg led back to a visited one; empty if none."""
    from scipy.sparse import csr_array  # few runs come here, and it takes long to load
    from scipy.sparse.csgraph import dijkstra

    open_ = run.adjacency.copy()
    for i, j in refused:
        open_[i, j] = False
    fresh = np.ones(len(open_), bool)
    fresh[list(visited - {leg.start})] = False
    open_ &= fresh[:, None] & fresh
    distance = np.linalg.norm(run.places[:, None] - run.places, axis=2)
    open_legs = csr_array(np.where(open_, np.maximum(distance, 1e-3), 0.0))
    metres = float(dijkstra(open_legs, indices=leg.start)[int(run.number("goal"))])
    seconds, left = metres / run.speed_range[0], run.number("t_available") - float(leg.times[0])
    if not seconds < _SURELY_IN_TIME * left:
        return ""
    return f"a path of {seconds:.0f} s over others led to the destination in the {left:.0f} s left"


@dataclass
class _GraphTasks:
    """Tasks on the edges of a graph and at its waypoints that are still to be done."""

    priority: Array  # [N, N], of the edges alone; s
    duration: Array
    at_priority: Array  # [N], of the waypoints; s
    at_duration: Array
    once: bool  # whether a waypoint that is visited again is passed without a task
    taken: set[frozenset[int]] = field(default_factory=set)  # edges whose tasks are done, either way

    @classmethod
    def of(cls, run: Saved, once: bool) -> "_GraphTasks":
        at = [np.array(run[f"waypoint_{name}"], float) for name in ("priority", "duration")]
        whole = [np.array(run[f"task_{name}"], float) for name in ("priority", "duration")]
        priority, duration = (
            np.where(run.adjacency, own - part, 0.0) for own, part in zip(whole, at, strict=True)
        )
        return cls(priority, duration, at[0], at[1], once)

    def earn(self, leg: Leg, revisit: bool, share: float) -> Earned:
        """Take what a leg that arrived does off the account; of a task along its edge a share is done.

        Both tasks, each the first time; none at all where a waypoint is merely passed.
        """
        edge = (leg.start, leg.goal)
        if revisit and self.once:
            return Earned(0.0, 0.0, 0)
        priority, duration = float(self.at_priority[leg.goal]), float(self.at_duration[leg.goal])
        self.at_priority[leg.goal] = self.at_duration[leg.goal] = 0.0
        if frozenset(edge) not in self.taken:
            priority, duration = priority + share * self.priority[edge], duration + self.duration[edge]
            self.taken.add(frozenset(edge))
        return Earned(float(priority), float(duration), int(priority > 0.0))


@dataclass(frozen=True, eq=False)
class _Task:
    """A task at a place, or along the straight line between two."""

    job: Job
    nodes: tuple[int, ...]  # of the graph, its place or the ends of the line
    ends: tuple[Array, ...]  # [3] m
    share: float = 1.0  # of its job

    @property
    def is_point(self) -> bool:
        return len(self.nodes) == 1

    def is_done_by(self, leg: Leg) -> bool:
        """Return whether a leg ends at its place, or leads along its line, either way.

        Of tasks in one place it is the one whose waypoints the leg's are.
        """
        if self.is_point:
            return (leg.goal,) == self.nodes and near(leg.positions[-1], self.ends[0])
        if (way := (leg.start, leg.goal)) not in (self.nodes, self.nodes[::-1]):
            return False
        first, last = self.ends if way == self.nodes else self.ends[::-1]
        return near(leg.positions[0], first) and near(leg.positions[-1], last)

    def worth(self, leg: Leg, share: float) -> float:
        """Return its priority at the time when a leg does it, or a share of it along a line."""
        begins = float(leg.times[-1]) + (leg.t_wait if self.is_point else 0.0)
        worth = self.share * self.job.worth(begins)
        return worth if self.is_point else share * worth


@dataclass
class _JobTasks:
    """Jobs: points are done where a leg ends, parts of lines by a leg from vertex to vertex."""

    left: list[_Task]  # tasks still to be done

    @classmethod
    def of(cls, jobs: list[Job]) -> "_JobTasks":
        tasks: list[_Task] = []
        for job in jobs:
            lengths = np.linalg.norm(np.diff(job.places, axis=0), axis=1)
            parts = zip(pairwise(job.nodes), pairwise(job.places), lengths, strict=True)
            tasks += [_Task(job, nodes, ends, float(length / lengths.sum())) for nodes, ends, length in parts]
            tasks += [] if job.is_line else [_Task(job, tuple(job.nodes), tuple(job.places))]
        return cls(tasks)

    def earn(self, leg: Leg, revisit: bool, share: float) -> Earned:
        """Take the task at the end of a leg that arrived, or along it, off the account."""
        done = [task for task in self.left if task.is_done_by(leg)]
        if share == 0.0:  # the line was passed, and nothing of it done
            done = [task for task in done if task.is_point]
        self.left = [task for task in self.left if task not in done]
        open_ = {task.job.name for task in self.left}
        complete = {task.job.name for task in done if task.share * task.job.priority > 0.0} - open_
        priority = sum(task.worth(leg, share) for task in done)
        return Earned(priority, sum(task.share * task.job.duration for task in done), len(complete))


def window_faults(run: Saved) -> Iterator[str]:
    """Yield tasks that were begun or ended outside their windows, and waiting for none."""
    jobs = read_jobs(run)
    if jobs is None and run.section("mission").get("jobs"):
        return  # that they were not saved is noted with the tasks
    timed = [job for job in jobs or () if job.windows]
    # For an area to open a vehicle waits where no window asks for it.
    closing = bool(run.section("chart").get("no_go"))
    for leg in run.legs:
        if not leg.arrived:
            continue
        if (line := line_of(timed, leg)) is not None:
            begins, ends = float(leg.times[0]), float(leg.times[-1]) + leg.t_task
            if leg.priority > 0.0 and not within(begins, ends, line.windows):
                what = f"a part of line {line.name!r} from {begins:.0f} to {ends:.0f} s"
                yield f"{leg}: {what} is in none of its windows"
            continue
        point = next((job for job in timed if job.nodes == [leg.goal]), None)
        if point is None:
            if leg.t_wait > TIME_TOLERANCE and not closing:
                yield f"{leg}: waits {leg.t_wait:.0f} s for a task without a time window"
            continue
        yield from _point_faults(run, leg, point)


def _point_faults(run: Saved, leg: Leg, job: Job) -> Iterator[str]:
    """Yield that a task at a point does not begin in a window of it, or is missed although it could."""
    arrival = float(leg.times[-1])
    if leg.missed:
        open_ = within(arrival, arrival, job.windows, -_EDGE)
        if open_ and "window_opens" in run:  # which areas that are closed may have narrowed
            ends = (run[f"window_{name}"][leg.goal] for name in ("opens", "closes"))
            open_ = within(arrival, arrival, list(zip(*ends, strict=True)), -_EDGE)
        if open_:
            yield f"{leg}: misses the task at {job.name!r}, in whose window it arrives"
    begins = arrival + leg.t_wait
    # Without a priority it was done before, or missed.
    if leg.priority > 0.0 and not within(begins, begins, job.windows):
        what = f"the task at {job.name!r} from {begins:.0f} to {begins + leg.t_task:.0f} s"
        yield f"{leg}: {what} is in none of its windows"
