"""Survey lines under way: paths that follow them, what they take and what of them counts."""

from dataclasses import replace
from itertools import pairwise

import jax
import numpy as np

from auvplan.executive.context import Followed, Mission, MissionContext
from auvplan.mission import MissionGraph
from auvplan.mission.jobs import jobs_of
from auvplan.mission.survey import LinePart
from auvplan.ocean.currents import combine, partition
from auvplan.ocean.environment import Environment
from auvplan.path import PathPlan, plan_paths
from auvplan.path.follow import follow_line
from auvplan.path.sensitivity import Conditions
from auvplan.path.straight import Straights
from auvplan.records import LegRecord
from auvplan.runtime import prng
from auvplan.runtime.arrays import Array
from auvplan.scenario.lines import SurveyPart, is_shut, standing, survey_parts
from auvplan.simulation.sea import stacked

Edge = tuple[int, int]

#: Number that is folded into a mission's key for the paths that lines are priced by.
_PRICED = 1_000_003

#: Times the time in still water that a line is taken to last, where margins along it are wider.
_SLOWLY = 1.3


def edges_of_lines(context: MissionContext) -> dict[Edge, LinePart]:
    """Return the part of a survey line that each edge follows, in either direction."""
    jobs, tolerance, found = context.area.jobs, context.scenario.mission.line_tolerance, {}
    nodes = {job.name: job.nodes for job in jobs_of(jobs)}
    for line in jobs.lines if jobs else ():
        for (i, j), (start, end) in zip(pairwise(nodes[line.name]), line.parts, strict=True):
            found[i, j] = LinePart(start, end, tolerance)
            found[j, i] = LinePart(end, start, tolerance)
    return found


def rows_of(env: Environment, rows: list[int]) -> Environment:
    """Return the worlds of some legs out of those of a batch."""
    shared, own = partition(env.current)
    own, obstacles = jax.tree.map(lambda leaf: np.asarray(leaf)[rows], (own, env.obstacles))
    return replace(env, current=combine(shared, own), obstacles=obstacles)


def follow(mission: Mission, line: LinePart, place: Array, env: Environment, key: jax.Array) -> PathPlan:
    """Plan a path along a part of a survey line, from where the vehicle is.

    Args:
        mission: that is there now.
        line: the part, in the direction of travel.
        place: [3] m.
        env: the world of this leg alone, as a batch of one.
        key: consumed.
    """
    context, vehicle, known = mission.context, mission.vehicle, mission.known
    planned, config = 0, context.path_config
    if known is not None:  # the whole line keeps what its end asks for
        lasts = _SLOWLY * float(np.linalg.norm(np.asarray(line.end) - place)) / mission.speed
        wider = float(np.asarray(known.after(mission.speed * lasts, lasts).allowance))
        margins = {name: getattr(config, name) + wider for name in ("coast_margin", "obstacle_margin")}
        config = config.replace(**margins)

    def detour(start: Array, goal: Array, depart: float) -> PathPlan:
        nonlocal planned
        planned += 1
        passed = depart - mission.now
        then = None if known is None else known.after(mission.speed * passed, passed)
        return plan_paths(
            np.clip(start, *context.box)[None],
            np.asarray(goal, float)[None],
            env,
            # Lines are surveyed at depths of their own.
            replace(vehicle.without_transit(), navigation=then),
            depart=np.asarray([depart]),
            key=prng.stacked([prng.folded(key, planned)]),
            config=context.path_config,
            world_per_leg=True,
            budget=context.rules.budget,
        )[0]

    own = Conditions(env, vehicle, context.path_config, 0).world()
    ends = np.asarray(line.start, float), np.asarray(line.end, float)
    plan = follow_line(place, ends, own, vehicle, config, mission.now, detour)
    if known is not None:
        vehicle = replace(vehicle, navigation=known)
        plan = replace(plan, conditions=replace(plan.conditions, vehicle=vehicle, config=context.path_config))
    return plan


def count_line(mission: Mission, record: LegRecord) -> None:
    """Leave of a leg's priority what was covered of its survey line."""
    if record.line is None or record.coverage is None or record.missed:
        return
    at = float(mission.graph.waypoint_priority[record.goal])
    record.priority = at + (record.priority - at) * record.line.share(record.coverage)


def follow_parts(mission: Mission) -> dict[Edge, Followed]:
    """Return how each edge along a survey line can be followed, by what is known before the mission.

    Where something stands in a line the way around it is planned as on a leg, once for all missions.
    """
    context = mission.context
    if context.followed is None:
        parts = {(one.part.start, one.part.end): one for one in survey_parts(context.scenario, context.area)}
        found: dict[Edge, Followed] = {}
        for (i, j), line in mission.parts.items():
            if (one := parts.get((line.start, line.end))) is not None:
                found[i, j] = found[j, i] = _followed(mission, one)
        context.followed = found
    return context.followed


def _followed(mission: Mission, one: SurveyPart) -> Followed:
    """Return how a part can be followed."""
    context = mission.context
    if not len(one.blocked):
        return Followed(1.0, 1.0)
    still = standing(context.scenario, context.area)
    obstacles = still.obstacles.padded(len(still.obstacles) + context.surprises)
    obstacles = jax.tree.map(lambda leaf: np.asarray(leaf)[None], obstacles)
    env = replace(still, current=stacked([mission.sea.forecast()]), obstacles=obstacles)
    key = prng.folded(mission.key, _PRICED, one.number)
    plan = follow(mission, one.part, np.asarray(one.part.start, float), env, key)
    # A way that does not keep every limit may be found yet when the leg is begun.
    return Followed(one.free, max(plan.length / one.part.length, 1.0))


def line_times(mission: Mission, departs: Array) -> tuple[list[Edge], Array]:
    """Edges along survey lines that are left, and their travel times [M, E] s at departures [M] s.

    They are those of the line itself in the current of that time, longer by the detours round what is in
    it; infinite where the current does not let the line be followed, or an area on it closes for a time.
    """
    context, edges = mission.context, [edge for edge in mission.parts if mission.graph.adjacency[edge]]
    if not edges:
        return [], np.zeros((len(departs), 0))
    followed = follow_parts(mission)
    env = replace(context.environment(mission.sea.forecast()), chart=None, seabed=None)
    shut = [closure for closure in env.closures if not is_shut(closure, context.scenario, context.area)]
    sea = Straights.through(
        replace(env, closures=tuple(shut)), context.vehicle, context.path_config.speed_reading
    )
    first, last = (
        np.tile([getattr(mission.parts[edge], end) for edge in edges], (len(departs), 1))
        for end in ("start", "end")
    )
    begin = np.repeat(departs, len(edges))
    lasts = np.linalg.norm(last - first, axis=1) / context.speed
    for _ in range(2):
        lasts, room = sea.pass_lines(first, last, begin, lasts)
    kept = (room[0] >= context.path_config.coast_margin) & (room[3:] >= -1e-5).all(axis=0)
    longer = np.array([followed[edge].longer for edge in edges])
    return edges, np.where(kept, lasts, np.inf).reshape(len(departs), -1) * longer


def as_followed(mission: Mission, graph: MissionGraph) -> MissionGraph:
    """Return a mission's graph with survey lines worth what of them can be followed."""
    if not mission.parts:
        return graph
    share = np.ones(graph.adjacency.shape)
    for edge, part in follow_parts(mission).items():
        share[edge] = part.free
    mission.run.followable, at = share, np.asarray(graph.waypoint_priority)
    timetable = graph.timetable
    if timetable is not None and timetable.drops.shape[-1]:
        timetable = replace(timetable, drops=timetable.drops * share[..., None])
    return replace(graph, priority=at + (graph.priority - at) * share, timetable=timetable)
