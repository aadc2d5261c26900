"""Plans and executes the legs of B missions, re-planning paths on the way (section 3.2.2)."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime
from functools import partial
from threading import Thread

import numpy as np
from numpy.typing import NDArray

from auvplan.executive.belief import ObstacleBelief
from auvplan.executive.context import Clock, Leg, Mission, MissionContext, Stretch
from auvplan.executive.decide import Act, Facts, Phase, decide
from auvplan.executive.path_calls import plan_legs
from auvplan.executive.replans import Review, detours, hazard, holds, replan, review
from auvplan.executive.surfacing import lost
from auvplan.mission.travel_times import ONE_PLACE
from auvplan.path.motion import Motion
from auvplan.records import LegRecord
from auvplan.runtime import cache, cores
from auvplan.runtime.arrays import Array
from auvplan.runtime.compiled import compiling_ahead
from auvplan.simulation.faults import HeldUp, Obstacle, PlannerOut, SensorOut, absent, appear
from auvplan.simulation.simulator import TIME_STEP, Course, Transit, over_ground, simulate
from auvplan.simulation.world import TrueObstacles, draw_obstacles

log = logging.getLogger(__name__)

#: Scenarios, JSON, whose legs were begun to compile what they need.
_warmed_up: set[str] = set()

#: Share by which the speed that a vehicle makes must differ from what it is asked for to be planned with.
_PACE = 0.02

#: Within this distance of its goal, m, a vehicle goes on without re-planning.
CLOSE = 40.0

#: Share of the speed through the water that an escape is made at; the rest is left to the current.
ESCAPE_SPEED = 0.4


def begin_legs(missions: list[Mission], records: Sequence[LegRecord]) -> None:
    """Set the obstacles of each mission's leg, believe them roughly, and plan all first paths in one call."""
    for mission, record in zip(missions, records, strict=True):
        set_out(mission, record)
    plan_first_paths(missions, "leg")
    context = missions[0].context
    if context.rules.second_look and context.simulated:
        _replan_optimistically([mission for mission in missions if detours(mission.active_leg)])
    parts = context.path_config.t_series
    for mission in missions:
        share = mission.active_leg.followed.travel_time / parts
        mission.active_leg.windows = [mission.now + share * (k + 1) for k in range(parts - 1)]


def plan_first_paths(missions: list[Mission], cause: str) -> None:
    """Plan paths to the ends of legs, and those that are refused once more."""
    plan_legs(missions, cause, cold=True)
    if again := [mission for mission in missions if refusal(mission.active_leg)]:
        plan_legs(again, cause, cold=True)
    for mission in missions:
        mission.active_leg.record.followed = len(mission.active_leg.record.plans) - 1


def set_out(mission: Mission, record: LegRecord, position: Array | None = None) -> None:
    """Put a mission on a leg between two waypoints, or from a position [3] m to the second; no path yet."""
    origin, target = (np.asarray(mission.graph.positions[k]) for k in (record.start, record.goal))
    record.line = mission.parts.get((record.start, record.goal))
    encounter(mission, record, origin if position is None else position, target)


def encounter(mission: Mission, record: LegRecord, origin: Array, target: Array) -> None:
    """Put a mission on a leg between two places [3] m: its true obstacles, and what is believed of them."""
    context = mission.context
    mission.sea.advance(mission.now)
    truth = TrueObstacles.known(context.known_obstacles(mission.now))
    if context.simulated and float(np.linalg.norm(target - origin)) > ONE_PLACE:
        truth = draw_obstacles(context.scenario, origin, target, mission.rng) + truth
    if context.simulated:
        truth += absent(mission.faults.places)
    record.obstacle_radii, record.obstacle_kinds = truth.radius, truth.kinds
    moves = over_ground(mission.sea.field, *truth.motion, now=mission.now)
    belief = ObstacleBelief(truth, moves, mission.now, context.scenario.sensors, mission.rng)
    mission.leg = Leg(record, origin, target, truth, moves, belief)
    if context.simulated:
        look(mission)


def look(mission: Mission) -> NDArray[np.bool_]:
    """Measure the obstacles of a mission's leg that are in sight; return which they are, [M]."""
    leg, blind = mission.active_leg, mission.faults.left(SensorOut, mission.now) > 0.0
    return leg.belief.look(leg.position, leg.truth, leg.moves, mission.now, blind)


def _replan_optimistically(missions: list[Mission]) -> None:
    """Look for a shorter path past obstacles as they will be seen from near, in boundaries that do not grow.

    On a way around an island for the sake of an obstacle that is far away, a vehicle gives up the time that
    a second look could save: what is in the way when it comes into sensor range is planned around then.
    """
    before = [mission.active_leg.followed for mission in missions]
    plan_legs(missions, "leg", cold=True, growing=False)
    for mission, plan in zip(missions, before, strict=True):
        leg = mission.active_leg
        if refusal(leg) or leg.followed.travel_time > plan.travel_time:
            leg.follow(plan)
        else:
            leg.record.followed = len(leg.record.plans) - 1


def refusal(leg: Leg, epoch: datetime | None = None) -> str:
    """Return why a leg must not be begun, or an empty string; times of day count from the epoch.

    Obstacles that are not certain do not stand against it: they move, and are known better from near.
    """
    broken = [limit for limit in leg.followed.broken() if limit != "obstacle" or leg.belief.certain]
    return leg.followed.explain(broken[0], epoch) if broken else ""


def unfit(mission: Mission) -> str:
    """Return why a mission's leg cannot be begun whatever time is left, or an empty string.

    That is a limit that its path breaks, a position that is not known well enough at its end, or a known
    obstacle that comes to its goal during its task, or is on the circle that the vehicle makes there.
    """
    context, leg = mission.context, mission.active_leg
    if why := refusal(leg, context.epoch) or lost(mission):
        return why
    record, timetable, margin = leg.record, mission.graph.timetable, context.scenario.safety.obstacles
    circle = context.circle if record.t_task > 0.0 else 0.0
    for obstacle in (known for known in context.area.obstacles if known.moves or circle):
        arrives = float(leg.followed.times[-1])
        begins = arrives if timetable is None else timetable.begins(record.start, record.goal, arrives)
        ends = (begins if np.isfinite(begins) else arrives) + record.t_task
        when, apart = obstacle.closest(leg.target, arrives, ends)
        if apart < margin + circle:
            near = "comes" if obstacle.moves else "is"
            where = f"{obstacle.name} {near} within {margin + circle:g} m of its goal"
            if circle:
                where += f", which the vehicle circles at {circle:g} m"
            return f"{where} {context.moment(when)}, while the vehicle is there" if obstacle.moves else where
    return ""


def advance(missions: list[Mission]) -> None:
    """One stretch of every mission's leg: look, re-plan where it is due, and advance to the next look."""
    context = missions[0].context
    for mission in missions:
        mission.sea.advance(mission.now)
        leg = mission.active_leg
        if mission.faults and leg.stretches:
            ends = np.clip([leg.arc - 5.0, leg.arc + 5.0], 0.0, leg.marks[-1])
            tangent = [np.diff(np.interp(ends, leg.marks, axis))[0] for axis in leg.followed.positions.T]
            let_appear(mission, np.asarray(tangent))
    _react(missions)
    steps = max(1, round(context.scenario.sensors.interval / TIME_STEP))
    courses = [_course(mission) for mission in missions]
    executed = simulate(courses, context.vehicle, context.path_config.samples, steps)
    for mission, course, out in zip(missions, courses, executed, strict=True):
        _take(mission, course.moving, out)
        if mission.active_leg.under_way and mission.now >= context.scenario.mission.time_available:
            mission.active_leg.stopped = "time ran out"


def _course(mission: Mission) -> Course:
    """Return what a vehicle does until the next look; one that is held up keeps station."""
    leg, now, faults = mission.active_leg, mission.now, mission.faults
    moving, share = leg.moving and not faults.left(HeldUp, now), faults.speed(now)
    share *= mission.asked_speed / mission.context.speed
    return Course(leg.track, leg.arc, moving, now, mission.sea.field, leg.truth.motion, share)


def go_as_planned(missions: list[Mission]) -> None:
    """Go every mission's leg to its end along its path, in the time that is planned for it."""
    for mission in missions:
        leg, plan = mission.active_leg, mission.active_leg.followed
        times, places = np.asarray(plan.times, float), np.asarray(plan.positions, float)
        since = (times - mission.now)[:, None, None]
        obstacles = leg.truth.position + since * leg.truth.velocity
        ground = np.diff(places, axis=0) / np.diff(times)[:, None]
        leg.stretches.append(Stretch(times, places, obstacles, ground, np.asarray(plan.water, float)))
        leg.arc, leg.record.arrived = float(leg.marks[-1]), True
        mission.now = float(times[-1])


def _take(mission: Mission, moving: bool, out: Transit) -> None:
    """Keep what one vehicle did in a stretch."""
    leg, times = mission.active_leg, np.asarray(out.times, float)
    # Time stands still after the arrival: keep the steps that moved it.
    fresh = np.diff(times, prepend=mission.now) > 0
    if not leg.stretches:
        leg.set_off(mission.now)
    parts = times, out.positions, out.obstacles, out.ground, out.water
    leg.stretches.append(Stretch(*(np.asarray(part, float)[fresh] for part in parts)))
    leg.truth.position = np.asarray(out.obstacles[-1], float)
    leg.moves, leg.arc = np.asarray(out.moves, float), float(out.arc)
    mission.now = float(times[-1])
    if moving and fresh.any():
        ground, water = leg.stretches[-1].ground[-1], leg.stretches[-1].water[-1]
        made = float(np.linalg.norm(ground - water)) / mission.asked_speed
        mission.pace = made if abs(made - 1.0) > _PACE else 1.0
        leg.met = water
    # The end of an escape is not the goal.
    leg.record.arrived = bool(out.arrived) and not leg.escaping
    if out.shortfall > 0 and moving:
        place = f"km {leg.arc / 1000.0:.1f} of {leg.marks[-1] / 1000.0:.1f}"
        leg.stopped = f"the current beat the vehicle at {place}, {mission.context.moment(mission.now)}"


def finish(leg: Leg) -> None:
    """Write what was executed into the leg's record."""
    parts = [np.concatenate(part) for part in zip(*leg.stretches, strict=True)]
    leg.record.times, leg.record.positions, leg.record.obstacle_positions, ground, water = parts
    # The velocity of a step holds from its first record on; the arrival keeps that of the last step.
    if len(ground):
        ground, water = (np.concatenate([part, part[-1:]]) for part in (ground, water))
        leg.record.motion = Motion.through_water(ground, water)
    else:
        leg.record.motion = Motion.none(len(leg.record.times))


def _react(missions: list[Mission]) -> None:
    """Look, and re-plan or give way where that is decided."""
    due: list[Review] = []
    for mission in missions:
        leg = mission.active_leg
        if leg.stretches:
            look(mission)
        if np.linalg.norm(leg.target - leg.position) < CLOSE and leg.moving and not leg.escaping:
            continue
        window = bool(leg.windows) and mission.now >= leg.windows[0]
        if window:
            leg.windows = [t for t in leg.windows if t > mission.now]
            mission.sea.begin_window()
        facts = _facts(mission, window)
        act = decide(facts).act
        if act is Act.GIVE_WAY:
            _give_way(mission)
        elif act is Act.REPLAN_LEG:
            urgent = bool(facts.hazard) or facts.held
            one = review(mission, "hazard" if urgent else "window")
            if urgent or not holds(one):
                due.append(one)
    replan(due)
    for one in due:
        # What no plan can clear the vehicle waits for, or gives way to.
        if decide(replace(_facts(one.mission), planner=False)).act is Act.GIVE_WAY:
            _give_way(one.mission)


def _facts(mission: Mission, window: bool = False) -> Facts:
    """Return what is known of a mission on a leg that is simulated here."""
    leg = mission.active_leg
    return Facts(
        Phase.HELD if leg.escaping or not leg.moving else Phase.UNDER_WAY,
        hazard="an obstacle is ahead" if hazard(mission) else "",
        window=window,
        uploads=False,
        planner=not mission.faults.left(PlannerOut, mission.now),
    )


def let_appear(mission: Mission, tangent: Array) -> None:
    """Let the obstacles appear that are due before a vehicle that goes along a tangent [3] of its track."""
    leg = mission.active_leg
    for fault in mission.faults.due(Obstacle, mission.now):
        appear(fault, leg.truth, [part.obstacles for part in leg.stretches], leg.position, tangent)
        leg.record.obstacle_radii = leg.truth.radius
        leg.moves = over_ground(mission.sea.field, *leg.truth.motion, now=mission.now)


def _give_way(mission: Mission) -> None:
    """Keep station, or escape where something comes too near."""
    leg, interval = mission.active_leg, mission.context.scenario.sensors.interval
    speed, clearance = ESCAPE_SPEED * mission.speed, leg.belief.clearance
    track = escape_track(mission.context, leg.position, mission.now, interval, clearance, speed)
    leg.moving = leg.escaping = track is not None
    if track is not None:
        leg.track, leg.arc = track, 0.0


def escape_track(
    context: MissionContext,
    position: Array,
    now: float,
    seconds: float,
    clearance: Callable[[Array, Array], Array],
    speed: float,
    stay: float = 0.0,
) -> Array | None:
    """Return the straight track of most clearance among sixteen headings, off coast, sea bed and box.

    Args:
        context: of the mission.
        position, now: [3] m and s, where and when the vehicle is.
        seconds: how long the escape lasts.
        clearance: [n] m, of places [n, 3] m at [n] s to the nearest obstacle.
        speed: m/s over ground that are reckoned with.
        stay: s that station is kept at its end.

    Returns:
        [S, 3] m, or None where keeping station is as good.
    """
    (lower, upper), chart, seabed = context.box, context.area.chart, context.area.seabed
    samples = context.path_config.samples
    parts = np.linspace(0.0, 1.0, samples)
    times = now + parts * (seconds + stay)
    gone = np.minimum(parts * (1.0 + stay / seconds), 1.0)
    best, choice = _worth(clearance(np.broadcast_to(position, (samples, 3)), times)), None
    for heading in np.arange(16) * np.pi / 8.0:
        way = speed * seconds * np.array([np.cos(heading), np.sin(heading), 0.0])
        track = position + gone[:, None] * way
        if (track[-1] < lower).any() or (track[-1] > upper).any():
            continue
        if chart is not None and float(np.min(np.asarray(chart.distance(track[:, 0], track[:, 1])))) < 20.0:
            continue
        if seabed is not None and seabed.altitude(track).min() < float(seabed.clearance):
            continue
        worth = _worth(clearance(track, times))
        if worth > best + 1.0:
            best, choice = worth, track
    return choice


def _worth(apart: Array) -> float:
    """Return how well a track keeps clear, m, from its clearance [n] m.

    Where it begins inside a boundary, no track has more at its least: how soon it leaves distinguishes them.
    """
    return float(apart.min() + min(apart[len(apart) // 4 :].min(), 0.0))


def warm_up(context: MissionContext, start_mission: Callable[[MissionContext], Mission]) -> None:
    """Let a mission that nobody waits for begin a leg, in a thread of its own, where a core is free for that.

    Args:
        context: what it shares with the missions to come. A scenario is begun so once, in one process.
        start_mission: makes the mission, given what it shares with others.
    """
    if cores.count() == 1 or not cache.enabled():
        return
    scenario = context.scenario.fingerprint
    if scenario in _warmed_up:
        return
    _warmed_up.add(scenario)
    mark = cache.key_of(__name__, scenario, repr(context.simulated))
    if cache.holds(__name__, mark):  # what this would compile is on disk
        return
    cache.store(__name__, mark, True)
    own = replace(context, clock=Clock())
    Thread(target=begin_a_leg, args=(partial(start_mission, own),), daemon=True).start()


def begin_a_leg(start_mission: Callable[[], Mission]) -> None:
    """Plan and simulate the beginning of a leg with zeros for results, which compiles what it needs."""
    try:
        mission = start_mission()
        start = mission.here
        goal = int(mission.graph.adjacency[start].argmax())
        with compiling_ahead():
            begin_legs([mission], [LegRecord(start, goal, 0.0, 0.0, 0.0)])
            plan_legs([mission], "window")
            advance([mission])
    except Exception as error:  # what is wrong shows where it matters
        log.info("programs are not compiled side by side: %s", error)
