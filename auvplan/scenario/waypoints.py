"""Builds the task graph of a mission from a scenario: waypoints drawn in the water, or the jobs of a file."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auvplan.errors import ScenarioError, error_context
from auvplan.mission.graph import MissionGraph, random_graph
from auvplan.mission.jobs import (
    NEIGHBOURS,
    JobPoint,
    Jobs,
    Terrain,
    jobs_graph,
    jobs_of,
    task_hours,
)
from auvplan.mission.survey import slope_limit
from auvplan.mission.timetable import Timetable
from auvplan.ocean.known import keeps_off
from auvplan.ocean.seabed import Seabed
from auvplan.runtime.formatting import apart
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.detours import DetourFinder, clear_lines
from auvplan.scenario.lines import jobs_kept_off, vehicle_limits
from auvplan.scenario.scenario import Scenario
from auvplan.site import at_time

#: m, apart that far two waypoints are at one place.
_ONE_PLACE = 0.01

#: Draws of waypoints before a scenario is declared too cramped.
_TRIES = 200


def make_graph(
    scenario: Scenario, area: OperatingArea, rng: np.random.Generator, detours: DetourFinder | None = None
) -> tuple[MissionGraph, list[str]]:
    """Waypoints in the water, the edges between them whose straight line is clear, and the waypoints' names.

    Waypoint 0 is the start, the last one the destination. The names are empty where waypoints are drawn. Two
    waypoints are one leg, without a task. Between jobs a path round what lies between them is an edge too,
    known to `detours` from then on.

    Raises:
        ScenarioError: a given start, goal or job lies on land or too deep, or no connected set of waypoints
            was found.

    Differences from the paper:
        It draws waypoints over the whole area once for all runs in section 2, and again for every run
        in 4.2: the latter is done here, and they keep a clearance to the coast. It does not say which
        waypoints have an edge; each has one to its nearest that a straight line over water reaches.
    """
    settings = scenario.mission
    for name, point in (("start", settings.start), ("goal", settings.goal)):
        if point is not None and (fault := misplaced_end(np.asarray(point), scenario, area)):
            raise ScenarioError(f"{point} {fault}", field=f"mission.{name}")
    if area.jobs is not None:
        with error_context("mission", "jobs"):
            return _jobs_graph(scenario, area, area.jobs, detours or DetourFinder(scenario, area))
    ends = {0: settings.start, settings.waypoints - 1: settings.goal}
    for _ in range(_TRIES):
        positions = _drawn_waypoints(scenario, area, rng)
        for index, point in ends.items():
            if point is not None:
                positions[index] = point
        passable = lines_clear(positions, scenario, area)
        figures = settings.neighbours or NEIGHBOURS, settings.priority, settings.duration
        try:
            graph = random_graph(rng, positions, *figures, passable)
        except ValueError:
            continue
        if graph.size == 2:
            graph = replace(graph, priority=0.0 * graph.priority, duration=0.0 * graph.duration)
        return graph, []
    raise ScenarioError(
        f"no connected set of {settings.waypoints} waypoints was found in {_TRIES} draws: "
        "lower mission.waypoint_clearance or move mission.start and mission.goal"
    )


def slope_warnings(scenario: Scenario, graph: MissionGraph, names: Sequence[str]) -> list[str]:
    """Return a line on each waypoint that no straight edge leads to as flatly as the vehicle dives or climbs.

    In still water: paths there are longer than the straight line.
    """
    vehicle = vehicle_limits(scenario, scenario.vehicle.speed)
    limits = {down: slope_limit(vehicle, down) for down in (True, False)}
    lines: list[str] = []
    for node in range(graph.size):
        found = []
        for other in np.flatnonzero(graph.adjacency[:, node]).tolist():
            step = graph.positions[node] - graph.positions[other]
            length, down = max(float(np.linalg.norm(step)), _ONE_PLACE), float(step[2])
            angle, field = limits[down > 0.0]
            needed = abs(down) / math.sin(angle)
            slope = math.degrees(math.asin(min(abs(down) / length, 1.0)))
            own, most = apart(slope, math.degrees(angle), digits=0)
            line = (
                f"{names[node]} lies {abs(down):,.0f} m {'below' if down > 0.0 else 'above'} {names[other]}, "
                f"{length:,.0f} m away: {own} degrees where vehicle.{field} allows {most}, and a path must "
                f"be {needed:,.0f} m long"
            )
            found.append((needed / length, line))
        if found and min(found)[0] > 1.0 + 1e-6:
            lines.append(min(found)[1])
    return lines


def _drawn_waypoints(scenario: Scenario, area: OperatingArea, rng: np.random.Generator) -> np.ndarray:
    """[N, 3] m, off the coast and clear of the sea bed."""
    settings, clearance = scenario.mission, scenario.mission.waypoint_clearance
    charts = [(closure.chart, scenario.safety.coast) for closure in area.closures]
    charts += [] if area.chart is None else [(area.chart, clearance)]
    lower, upper = (np.asarray(corner) for corner in scenario.box)
    margin = min(clearance, 0.05 * float((upper - lower)[:2].min()))
    inset = np.array([margin, margin, 0.0])
    positions = np.empty((0, 3))
    while len(positions) < settings.waypoints:
        drawn = rng.uniform(lower + inset, upper - inset, (512, 3))
        free = np.ones(len(drawn), bool)
        for chart, off in charts:
            free &= np.asarray(chart.distance(drawn[:, 0], drawn[:, 1])) > off
        if area.seabed is not None:
            deepest = _deepest(drawn, area.seabed)
            drawn[:, 2] = np.minimum(drawn[:, 2], deepest)
            free &= deepest >= lower[2]
        drawn = drawn[free]
        if not len(drawn):
            reason = "and the sea bed leave no water for waypoints"
            raise ScenarioError(reason, field="mission.waypoint_clearance")
        positions = np.concatenate([positions, drawn])[: settings.waypoints]
    return positions


def _jobs_graph(
    scenario: Scenario, area: OperatingArea, jobs: Jobs, detours: DetourFinder
) -> tuple[MissionGraph, list[str]]:
    """Return the graph of the jobs of a file."""
    settings, source = scenario.mission, scenario.mission.jobs
    jobs = replace(jobs, points=tuple(_while_open(point, scenario, area) for point in jobs.points))
    for name, position in jobs.places:
        if fault := misplaced(np.asarray(position), scenario, area):
            where = "({:.0f}, {:.0f}, {:.0f}) m".format(*position)
            raise ScenarioError(f"{source}: job {name!r} at {where} {fault}")
    try:
        graph, names = jobs_graph(
            jobs.points,
            jobs.lines,
            settings.start,
            settings.goal,
            neighbours=settings.neighbours,
            whole=settings.lines == "whole",
            terrain=Terrain(
                lambda positions: lines_clear(positions, scenario, area), detours, detours.length
            ),
            barred=jobs_kept_off(scenario, area),
        )
    except ValueError as error:
        raise ScenarioError(f"{source}: {error}") from None
    positions, travel_time = np.asarray(graph.positions), np.array(graph.travel_time)
    blocked = np.asarray(graph.adjacency) & ~lines_clear(positions, scenario, area)
    for i, j in np.argwhere(np.triu(blocked)):
        seconds = detours.length(positions[i], positions[j]) / scenario.vehicle.way_speed
        if np.isfinite(seconds):  # what of a survey line nothing leads round is not passed
            travel_time[i, j] = travel_time[j, i] = seconds
    graph = replace(graph, travel_time=travel_time)
    if hours := task_hours(jobs.points, jobs.lines, graph.size):
        still = graph.leg_times(scenario.vehicle.way_speed) - graph.duration
        waiting = settings.wait != "none"
        graph = graph.with_timetable(Timetable(np.zeros(1), still[None], **hours, waiting=waiting))
    return graph, names


def _while_open(point: JobPoint, scenario: Scenario, area: OperatingArea) -> JobPoint:
    """Return a job with windows that leave time to be out of an area before it closes.

    That takes the transit there at half the vehicle's speed, and the time between two departures of the
    arrival functions, for which an edge counts as closed before it is.
    """
    north, east, _ = point.position
    step = scenario.mission.time_available / max(scenario.planning.resolved.departures - 1, 1)
    departs = 0.0 if area.hours is None else area.hours[0]
    for closure in area.closures:
        out = scenario.safety.coast - float(closure.chart.distance(north, east))
        if out <= 0.0:
            continue
        early = point.duration + step + 2.0 * out / scenario.vehicle.way_speed
        spans = point.windows or ((-np.inf, np.inf),)
        for begins, ends in closure.spans:
            parts = [((first, min(last, begins - early)), (max(first, ends), last)) for first, last in spans]
            spans = tuple(
                (first, last) for pair in parts for first, last in pair if first < last and last > departs
            )
        if not spans:
            raise ScenarioError(
                f"{scenario.mission.jobs}: job {point.name!r} lies in the closed area {closure.name!r}: "
                f"its hours leave no time for it and the {early - point.duration:.0f} s to be out of it again"
            )
        point = replace(point, windows=spans)
    return point


def misplaced(position: np.ndarray, scenario: Scenario, area: OperatingArea) -> str:
    """Return what is wrong with a waypoint [3] m, or an empty string."""
    lower, upper = (np.asarray(corner) for corner in scenario.box)
    if (position[:2] < lower[:2] - 1e-6).any() or (position[:2] > upper[:2] + 1e-6).any():
        return "lies outside the area"
    if not lower[2] - 1e-6 <= position[2] <= upper[2] + 1e-6:
        return f"lies outside the depths {lower[2]:g} to {upper[2]:g} m of area and vehicle"
    if area.chart is not None and not bool(area.chart.is_water(position[0], position[1])):
        return "lies on land" + (" or in closed water" if scenario.chart.source == "enc" else "")
    if area.seabed is not None:
        room = float(_deepest(position[None], area.seabed)[0]) - position[2]
        if room < 0.0:
            return f"is {-room:.1f} m too deep for the clearance of the sea bed"
    return ""


def misplaced_end(position: np.ndarray, scenario: Scenario, area: OperatingArea) -> str:
    """Return what is wrong with a mission's start or goal [3] m, or an empty string.

    Jobs may lie in a known obstacle, and are left out: the others are done.
    """
    if fault := misplaced(position, scenario, area):
        return fault
    return keeps_off(np.asarray(position, float), area.obstacles, 0.0)


def left_out_jobs(scenario: Scenario, area: OperatingArea) -> list[str]:
    """Return a line on each job, or part of one, that known obstacles keep the vehicle off."""
    whole = scenario.mission.lines == "whole"
    off = jobs_kept_off(scenario, area)
    return [
        f"{scenario.mission.jobs}: job {job.name!r} is left out{part}: {why}"
        for job in jobs_of(area.jobs)
        for part in ["" if whole or len(job.nodes) == 1 else " in part"]
        for why in dict.fromkeys(off[node] for node in job.nodes if node in off)
    ]


def shut_in(position: np.ndarray, area: OperatingArea, now: float) -> str:
    """Return in which area, closed at `now`, s, a place [3] m lies, and until when; or an empty string."""
    for closure in area.closures:
        if (until := closure.shut_until(position, now)) is not None:
            epoch = None if area.site is None else area.site.epoch
            opens = f"opens {at_time(until, epoch)}" if np.isfinite(until) else "does not open"
            return f"lies in the closed area {closure.name!r}, which {opens}"
    return ""


def _deepest(positions: np.ndarray, seabed: Seabed) -> np.ndarray:
    """[N] m, depths to which a vehicle may go at places [N, 3]."""
    shallowest = np.asarray(seabed.shallowest_at(positions[:, 0], positions[:, 1], 0.0))
    return shallowest - float(seabed.clearance) - 0.5


def lines_clear(positions: np.ndarray, scenario: Scenario, area: OperatingArea) -> np.ndarray:
    """[N, N] bool: whether the straight line between two waypoints keeps clear of coast and shallows."""
    size = len(positions)
    if size == 2:  # two waypoints are a single leg: the path planner finds the path round
        return np.ones((size, size), bool)
    clear = clear_lines(positions[:, None], positions[None], scenario, area)
    return clear & clear.T
