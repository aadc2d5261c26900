"""What stands in the way of survey lines, as far as it is known before a mission and stays where it is."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.mission.jobs import Jobs, jobs_of, kept_off
from auvplan.mission.survey import LinePart
from auvplan.ocean.closures import Closure
from auvplan.ocean.currents import UniformCurrent
from auvplan.ocean.environment import Environment
from auvplan.ocean.known import EXCESS, spheres
from auvplan.ocean.obstacles import Obstacles
from auvplan.path import PathConfig
from auvplan.path.follow import blocked_on
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.vehicle import Vehicle


@dataclass(frozen=True)
class SurveyPart:
    """A straight part of a survey line, and what stands in it."""

    name: str  # of the line
    number: int  # of the part, from 1
    part: LinePart  # itself
    blocked: NDArray[np.floating]  # [K, 2] m from its start, where it is left and taken up again
    steep: str  # how far it is too steep in still water, or empty

    @property
    def free(self) -> float:
        """Share of it that can be followed."""
        return 1.0 - float(np.diff(self.blocked, axis=1).sum()) / self.part.length


def survey_parts(scenario: Scenario, area: OperatingArea) -> list[SurveyPart]:
    """Return the parts of all survey lines, line by line.

    Known obstacles that stand still, the coast, areas that are closed all along and the sea bed count. A part
    to a vertex that an obstacle keeps vehicles off is blocked from end to end.
    """
    jobs, found = area.jobs or Jobs(), []
    if not jobs.lines:
        return found
    env, safety = standing(scenario, area), scenario.safety
    config = PathConfig(coast_margin=safety.coast, obstacle_margin=safety.obstacles)
    vehicle, own = Vehicle(speed=scenario.vehicle.speed), scenario.vehicle
    limits = vehicle_limits(scenario, min(own.speed_range or (own.speed,)))
    off = jobs_kept_off(scenario, area)
    for line, job in zip(jobs.lines, jobs_of(jobs)[len(jobs.points) :], strict=True):
        for number, (start, end) in enumerate(line.parts, 1):
            blocked = blocked_on(np.asarray(start, float), np.asarray(end, float), env, vehicle, config)
            part = LinePart(start, end, scenario.mission.line_tolerance)
            if not off.keys().isdisjoint(job.nodes[number - 1 : number + 1]):
                blocked = np.array([[0.0, part.length]])
            found.append(SurveyPart(line.name, number, part, blocked, part.too_steep(limits)))
    return found


def vehicle_limits(scenario: Scenario, speed: float) -> Vehicle:
    """Return a vehicle of a speed, m/s, with what limits its slopes."""
    climb, dive = scenario.vehicle.climb_rate_max, scenario.vehicle.dive_rate_max
    return Vehicle(speed, pitch_max=scenario.pitch_max, climb_rate_max=climb, dive_rate_max=dive)


def jobs_kept_off(scenario: Scenario, area: OperatingArea) -> dict[int, str]:
    """Return the nodes of jobs that known obstacles keep every vehicle off, and why; see `kept_off`."""
    whole = scenario.mission.lines == "whole"
    return kept_off(area.jobs, area.obstacles, scenario.safety.obstacles, whole)


def standing(scenario: Scenario, area: OperatingArea) -> Environment:
    """Return the world in still water, with what stands in it throughout the mission."""
    lower, upper = (jnp.asarray(corner, float) for corner in scenario.box)
    depths = scenario.box[0][2], scenario.box[1][2]
    known = spheres([one for one in area.obstacles if not one.moves], depths, 0.0)
    shut = tuple(closure for closure in area.closures if is_shut(closure, scenario, area))
    obstacles = Obstacles.static(known.position, known.radius) if len(known.radius) else Obstacles.none()
    return Environment(UniformCurrent(), area.chart, obstacles, lower, upper, area.seabed, shut)


def is_shut(closure: Closure, scenario: Scenario, area: OperatingArea) -> bool:
    """Return whether an area is closed as long as missions may last."""
    departs, over = area.hours or (0.0, scenario.mission.time_available)
    return any(begins <= departs and ends >= over for begins, ends in closure.spans)


def line_warnings(scenario: Scenario, area: OperatingArea) -> list[str]:
    """Return a line on each survey line that cannot be followed whole: how much of it, where, and why."""
    parts = survey_parts(scenario, area)
    env, lines = standing(scenario, area), []
    for name in dict.fromkeys(one.name for one in parts):
        length, lost, where, steep = 0.0, 0.0, [], False
        for one in (one for one in parts if one.name == name):
            for begin, end in [(0.0, one.part.length)] if one.steep else one.blocked:
                why = f"too steep: {one.steep}" if one.steep else ""
                why = why or ", ".join(_in_the_way(one, begin, end, env, scenario, area))
                where.append(f"{length + begin:,.0f} to {length + end:,.0f} m" + (f" ({why})" if why else ""))
                lost += end - begin
            length += one.part.length
            steep |= bool(one.steep)
        if steep and scenario.mission.lines == "whole":
            lines.append(
                f"survey line {name!r} is left out: mission.lines is 'whole', and of its {length:,.0f} m "
                f"{lost:,.0f} cannot be followed, {'; '.join(where)}"
            )
        elif where:
            lines.append(
                f"survey line {name!r} cannot be followed whole: {lost:,.0f} of its {length:,.0f} m are left "
                f"out, {'; '.join(where)}"
            )
    return lines


def _in_the_way(
    one: SurveyPart, begin: float, end: float, env: Environment, scenario: Scenario, area: OperatingArea
) -> list[str]:
    """Return what lies nearer to a stretch of a part than paths may go."""
    share = np.linspace(begin, end, max(int(end - begin), 2))[:, None] / one.part.length
    places = np.asarray(one.part.start) * (1.0 - share) + np.asarray(one.part.end) * share
    still = np.zeros(len(places))
    found = []
    for obstacle in area.obstacles:
        most = scenario.safety.obstacles + EXCESS[0] * obstacle.radius + 1.0
        if not obstacle.moves and obstacle.distance(places, still).min() < most:
            found.append(repr(obstacle.name))
    north, east = places[:, 0], places[:, 1]
    charts = (area.chart, "the coast or a closed area"), *((c.chart, repr(c.name)) for c in env.closures)
    for chart, name in charts:
        if chart is not None and np.asarray(chart.distance(north, east)).min() < scenario.safety.coast:
            found.append(name)
    if env.seabed is not None and env.seabed.altitude(places).min() < float(env.seabed.clearance):
        found.append("the sea bed")
    return found
